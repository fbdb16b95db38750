//! Floor 1. One step of an ordinary or stochastic differential equation.
//!
//! Deterministic schemes work on any right-hand side `f(t, x)`, so the plant alone, an observer
//! alone, or both together as one system are integrated by the same few lines.

// A right-hand side is a pair of references: it goes by value.
#![allow(clippy::needless_pass_by_value)]

use crate::Scalar;
use crate::memory::Memory;
use crate::model::Plant;
pub use crate::model::StochasticIntegrator;

/// A right-hand side ẋ = f(t, x): any `Fn(T, &X) -> X`, or a type whose method is sure to be inlined,
/// as a closure's is not.
pub trait RightHandSide<T, X> {
    /// f(t, x).
    fn at(&self, t: T, x: &X) -> X;
}

impl<T, X, F: Fn(T, &X) -> X> RightHandSide<T, X> for F {
    #[inline(always)]
    fn at(&self, t: T, x: &X) -> X {
        self(t, x)
    }
}

/// Forward Euler, order 1.
#[inline(always)]
pub fn euler<T: Scalar, X: Memory<T>>(f: impl RightHandSide<T, X>, t: T, x: &X, h: T) -> X {
    x.plus(h, &f.at(t, x))
}

/// Bogacki and Shampine's third-order pair, used with a fixed step.
#[inline(always)]
pub fn bogacki_shampine<T: Scalar, X: Memory<T>>(
    f: impl RightHandSide<T, X>,
    t: T,
    x: &X,
    h: T,
) -> X {
    let [half, three_quarters] = [0.5, 0.75].map(|c| T::from_f64(c) * h);
    let k1 = f.at(t, x);
    let k2 = f.at(t + half, &x.plus(half, &k1));
    let k3 = f.at(t + three_quarters, &x.plus(three_quarters, &k2));
    let [three, four, ninth] = [3.0, 4.0, 9.0].map(T::from_f64);
    // a + a, which is 2a to the bit: LLVM's vectoriser loses a term where products stand in both places of
    // this sum (docs/llvm-slp)
    let weighted = k1.zip(&k2, |a, b| (a + a) + three * b).plus(four, &k3);
    x.plus(h / ninth, &weighted)
}

/// The classical Runge-Kutta scheme, order 4.
#[inline(always)]
pub fn rk4<T: Scalar, X: Memory<T>>(f: impl RightHandSide<T, X>, t: T, x: &X, h: T) -> X {
    let half = T::from_f64(0.5) * h;
    let k1 = f.at(t, x);
    let k2 = f.at(t + half, &x.plus(half, &k1));
    let k3 = f.at(t + half, &x.plus(half, &k2));
    let k4 = f.at(t + h, &x.plus(h, &k3));
    let two = T::from_f64(2.0);
    let weighted = k1.zip(&k4, |a, d| a + d).plus(two, &k2.zip(&k3, |b, c| b + c));
    x.plus(h / T::from_f64(6.0), &weighted)
}

/// A choice among the deterministic schemes at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Integrator {
    /// [`euler`].
    Euler,
    /// [`bogacki_shampine`].
    BogackiShampine,
    /// [`rk4`].
    Rk4,
}

impl Integrator {
    /// One step of length h from (t, x).
    #[inline(always)]
    pub fn step<T: Scalar, X: Memory<T>>(
        self,
        f: impl RightHandSide<T, X>,
        t: T,
        x: &X,
        h: T,
    ) -> X {
        match self {
            Self::Euler => euler(f, t, x, h),
            Self::BogackiShampine => bogacki_shampine(f, t, x, h),
            Self::Rk4 => rk4(f, t, x, h),
        }
    }
}

/// Increments of a Wiener process over one step: ΔW and ΔZ = ∫ (W(s) − W(t)) ds.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WienerIncrement<T> {
    /// ΔW, variance h.
    pub dw: T,
    /// ΔZ, variance h³/3, covariance with ΔW h²/2.
    pub dz: T,
}

impl<T: Scalar> WienerIncrement<T> {
    /// From two independent standard normal values.
    #[inline(always)]
    pub fn from_normals(xi: (T, T), h: T) -> Self {
        let root_h = h.sqrt();
        let half = T::from_f64(0.5);
        let inv_root3 = T::from_f64(1.0 / 1.732_050_807_568_877_2);
        Self { dw: root_h * xi.0, dz: half * h * root_h * (xi.0 + xi.1 * inv_root3) }
    }

    /// The increment over this step of length `h` followed by `next`.
    #[inline(always)]
    #[must_use]
    pub fn then(self, next: Self, next_h: T) -> Self {
        Self { dw: self.dw + next.dw, dz: self.dz + next.dz + self.dw * next_h }
    }
}

impl StochasticIntegrator {
    /// One step of length h from (t, x) under the increment `w`.
    #[inline(always)]
    pub fn step<T: Scalar, P: Plant<T>>(
        self,
        plant: &P,
        t: T,
        x: &P::State,
        u: &P::Input,
        h: T,
        w: WienerIncrement<T>,
    ) -> P::State {
        let a = plant.drift(t, x, u);
        let b = plant.diffusion(t, x, u);
        let half = T::from_f64(0.5);
        let euler_maruyama = x.plus(h, &a).plus(w.dw, &b);
        match self {
            Self::EulerMaruyama => euler_maruyama,
            Self::Milstein => {
                let quadratic = half * (w.dw * w.dw - h);
                euler_maruyama.plus(quadratic, &plant.diffusion_slope(t, x, u))
            }
            Self::Taylor15 => {
                let along = plant.jacobian_times(t, x, u, &a);
                let l0_a = along.plus(T::ONE, &plant.curvature(t, x, u));
                let l1_a = plant.jacobian_times(t, x, u, &b);
                euler_maruyama.plus(w.dz, &l1_a).plus(half * h * h, &l0_a)
            }
        }
    }
}

/// How a simulated plant moves over one sampling period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PlantScheme {
    /// The state stays where it is: a plant at an equilibrium, kept free of rounding growth.
    Held,
    /// A deterministic scheme.
    Deterministic(Integrator),
    /// A stochastic scheme.
    Stochastic(StochasticIntegrator),
}

/// A plant under an input that is held.
struct Driven<'a, P, U> {
    plant: &'a P,
    u: &'a U,
}

impl<T: Scalar, P: Plant<T>> RightHandSide<T, P::State> for Driven<'_, P, P::Input> {
    #[inline(always)]
    fn at(&self, t: T, x: &P::State) -> P::State {
        self.plant.drift(t, x, self.u)
    }
}

/// One deterministic step of a plant under an input held over it.
#[inline(always)]
pub fn plant_step<T: Scalar, P: Plant<T>>(
    scheme: Integrator,
    plant: &P,
    t: T,
    x: &P::State,
    u: &P::Input,
    h: T,
) -> P::State {
    scheme.step(Driven { plant, u }, t, x, h)
}
