//! Floor 1. Shapes: what stands between the innovation e of an observer and its injection Λ(r) K v.
//!
//! A shape is a choice of its own, worn by any gain law through [`crate::gain::Shaped`]. [`Stubborn`] and
//! [`DeadZone`] give all rows one value v, so any structure takes them; the others give row i a vᵢ of its own
//! and belong to the [`crate::observers::StandardObserver`]. A missing sample is e = 0: v = 0.
//!
//! Alessandri and Zaccarian, Automatica 88 (2018); Astolfi, Alessandri and Zaccarian, IEEE TAC 66 (2021) 667;
//! Prasov and Khalil, IEEE TAC 58 (2013) 569; Han, IEEE TIE 56 (2009) 900; Andrieu, Praly and Astolfi, SIAM J.
//! Control Optim. 47 (2008) 1814; Cruz-Zavala and Moreno, IEEE TAC 64 (2019).

use crate::Scalar;
use crate::error::{DesignError, finite, positive, require};
use crate::memory::Memory;
use crate::polynomial::roots;
use nalgebra::SVector;

/// What an observer injects in the place of its innovation.
pub trait Shape<T: Scalar>: Copy {
    /// What the shape remembers: nothing, or a threshold σ.
    type Memory: Memory<T>;
    /// Whether all rows take one value.
    const ALIKE: bool;
    /// The memory to start from.
    fn initial(&self) -> Self::Memory;
    /// vᵢ for each row of the injection.
    fn rows(&self, memory: &Self::Memory, e: T, rows: &mut [T]);
    /// Time derivative of the memory.
    fn rate(&self, memory: &Self::Memory, e: T) -> Self::Memory;
    /// The memory brought back into the set that the shape lives in.
    fn admissible(&self, memory: Self::Memory) -> Self::Memory;
    /// As [`crate::gain::GainLaw::fits`].
    ///
    /// # Errors
    /// An order or a structure that the shape was not made for; coefficients for which the observer may not
    /// converge.
    fn fits(&self, k: Option<&[T]>) -> Result<(), DesignError>;
    /// As [`crate::gain::GainLaw::placed`].
    ///
    /// # Errors
    /// Rows that are not alike.
    fn placed(&self) -> Result<(), DesignError> {
        let allowed = "the rows of this shape differ, so that no eigenvalues can be placed; choose method \
                       rk4 or euler";
        if Self::ALIKE { Ok(()) } else { Err(unlike(allowed)) }
    }
}

/// A refusal of rows that are not alike.
const fn unlike(allowed: &'static str) -> DesignError {
    DesignError { parameter: "shape", value: 1.0, allowed }
}

/// ⌊s⌉ᵖ = sign(s) |s|ᵖ for p ≥ 0, and 0 at s = 0.
#[inline(always)]
pub fn signed_power<T: Scalar>(s: T, p: T) -> T {
    let size = s.abs();
    size.where_above(T::ZERO, size.powf(p).copysign(s), T::ZERO)
}

/// The coefficients of a structure that gives each state a row of its own.
fn of_rows<T: Scalar>(k: Option<&[T]>) -> Result<&[T], DesignError> {
    let allowed = "the rows of this shape differ, which is for the standard observer alone; choose that, or \
                   a shape whose rows are alike (stubborn, dead-zone)";
    k.ok_or(unlike(allowed))
}

/// Refuse a shape of `count` rows for another number of states.
fn one_each<T: Scalar>(count: usize, k: &[T]) -> Result<(), DesignError> {
    let allowed = "one row of the shape for each state of the observer";
    require("rows of the shape", T::from_u64(count as u64), k.len() == count, allowed).map(|_| ())
}

/// The threshold √σ that two shapes share: σ̇ = −λσ + γe², σ ≥ 0.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct Threshold<T> {
    decay: T,
    growth: T,
    sigma0: T,
}

impl<T: Scalar> Threshold<T> {
    fn new(decay: T, growth: T, sigma0: T) -> Result<Self, DesignError> {
        let decay = positive("decay", decay)?;
        let (growth, sigma0) = (finite("growth", growth)?, finite("sigma0", sigma0)?);
        require("sigma0", sigma0, sigma0 >= T::ZERO, "a squared output error >= 0")?;
        Ok(Self { decay, growth, sigma0 })
    }

    /// sat_√σ(e).
    #[inline(always)]
    fn within(sigma: T, e: T) -> T {
        let level = sigma.sqrt();
        e.clip(-level, level)
    }
}

/// Stubborn redesign, Alessandri and Zaccarian (2018): v = sat_√σ(e), σ̇ = −λσ + γe², so that an outlier
/// moves the estimate by no more than what was usual before it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Stubborn<T> {
    threshold: Threshold<T>,
}

/// Dead-zone redesign, Astolfi, Alessandri and Zaccarian (2021): v = e − sat_√σ(e), σ̇ = −λσ + γe², so that
/// persistent small noise is not injected.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DeadZone<T> {
    threshold: Threshold<T>,
}

crate::error::through_constructor! {
    [T: Scalar] Stubborn<T>: shape => {
        decay: T = shape.threshold.decay,
        growth: T = shape.threshold.growth,
        sigma0: T = shape.threshold.sigma0,
    }
    => Self::new(decay, growth, sigma0)
}

crate::error::through_constructor! {
    [T: Scalar] DeadZone<T>: shape => {
        decay: T = shape.threshold.decay,
        growth: T = shape.threshold.growth,
        sigma0: T = shape.threshold.sigma0,
    }
    => Self::new(decay, growth, sigma0)
}

/// What the two shapes of a threshold say the same way: how they are made, v, and which γ they take.
macro_rules! of_threshold {
    ($($name:ident: |$sigma:ident, $e:ident| $v:expr,
        |$growth:ident, $decay:ident| $holds:expr, $allowed:literal;)+) => {$(
        impl<T: Scalar> $name<T> {
            /// λ > 0 and γ (1/s), σ(0) ≥ 0 (the square of the output's unit).
            ///
            /// # Errors
            /// A parameter outside its range.
            pub fn new($decay: T, $growth: T, sigma0: T) -> Result<Self, DesignError> {
                let threshold = Threshold::new($decay, $growth, sigma0)?;
                require("growth", $growth, $holds, $allowed)?;
                Ok(Self { threshold })
            }
        }

        impl<T: Scalar> Shape<T> for $name<T> {
            type Memory = T;
            const ALIKE: bool = true;
            #[inline(always)]
            fn initial(&self) -> T {
                self.threshold.sigma0
            }
            #[inline(always)]
            fn rows(&self, $sigma: &T, $e: T, rows: &mut [T]) {
                rows.fill($v);
            }
            #[inline(always)]
            fn rate(&self, sigma: &T, e: T) -> T {
                self.threshold.growth * (e * e) - self.threshold.decay * *sigma
            }
            #[inline(always)]
            fn admissible(&self, sigma: T) -> T {
                sigma.max(T::ZERO)
            }
            fn fits(&self, _: Option<&[T]>) -> Result<(), DesignError> {
                Ok(())
            }
        }
    )+};
}

of_threshold! {
    Stubborn: |sigma, e| Threshold::within(*sigma, e),
        |growth, decay| growth >= decay,
        "at least decay: below it every slow correction is weakened";
    DeadZone: |sigma, e| e - Threshold::within(*sigma, e),
        |growth, decay| growth >= T::ZERO && growth < decay,
        "0 or more, and less than decay: at or above it a steady error is never injected";
}

/// A shape without memory.
macro_rules! forgets {
    () => {
        type Memory = ();
        const ALIKE: bool = false;
        #[inline(always)]
        fn initial(&self) {}
        #[inline(always)]
        fn rate(&self, (): &(), _: T) {}
        #[inline(always)]
        fn admissible(&self, (): ()) {}
    };
}

/// Piecewise-linear gain, Prasov and Khalil (2013): vᵢ = e − (1 − ρⁱ) sat_d(e), the gain ρℓ within |e| ≤ d and ℓ
/// outside, continuous.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PiecewiseLinear<T> {
    ratio: T,
    zone: T,
}

crate::error::through_constructor! {
    [T: Scalar] PiecewiseLinear<T>: shape => { ratio: T = shape.ratio, zone: T = shape.zone }
    => Self::new(ratio, zone)
}

impl<T: Scalar> PiecewiseLinear<T> {
    /// Gain inside over gain outside, in (0, 1], and the zone d > 0 in the output's unit.
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn new(ratio: T, zone: T) -> Result<Self, DesignError> {
        let ratio = positive("ratio", ratio)?;
        require(
            "ratio",
            ratio,
            ratio <= T::ONE,
            "at most 1: inside the zone the gain is the smaller one",
        )?;
        Ok(Self { ratio, zone: positive("zone", zone)? })
    }

    /// The circle criterion, Re p₂(jω) p̄₁(jω) > 0 for all ω: a polynomial in ω² with no root ≥ 0.
    fn converges(&self, k: &[T]) -> bool {
        const MOST: usize = 13; // orders to 12
        let n = k.len();
        let (mut inner, mut outer) = ([0.0; MOST], [0.0; MOST]);
        let (mut power, ratio) = (1.0, self.ratio.to_f64());
        let entries = core::iter::once(1.0).chain(k.iter().map(|k| k.to_f64()));
        for ((inner, outer), entry) in inner.iter_mut().zip(&mut outer).zip(entries) {
            (*outer, *inner) = (entry, entry * power);
            power *= ratio;
        }
        let mut trailing = [0.0; MOST];
        for (i, a) in outer.iter().enumerate() {
            for (j, b) in inner.iter().enumerate() {
                let sign = if i.abs_diff(j) % 4 == 0 { 1.0 } else { -1.0 };
                if (i + j) % 2 == 0
                    && let Some(slot) =
                        i.midpoint(j).checked_sub(1).and_then(|at| trailing.get_mut(at))
                {
                    *slot += sign * a * b;
                }
            }
        }
        let mut found = [(0.0, 0.0); MOST];
        let (Some(trailing), Some(found)) = (trailing.get(..n), found.get_mut(..n)) else {
            return false;
        };
        roots(trailing, found);
        // two that meet on the axis leave it again: within rounding they are on it
        found.iter().all(|(re, im)| *re <= 0.0 || im.abs() > 1e-6 * re)
    }
}

impl<T: Scalar> Shape<T> for PiecewiseLinear<T> {
    forgets!();
    #[inline(always)]
    fn rows(&self, (): &(), e: T, rows: &mut [T]) {
        let (within, mut power) = (e.clip(-self.zone, self.zone), T::ONE);
        for row in rows {
            power *= self.ratio;
            *row = e - (T::ONE - power) * within;
        }
    }
    fn fits(&self, k: Option<&[T]>) -> Result<(), DesignError> {
        let k = of_rows(k)?;
        let allowed = "from order 3 on the two gains must satisfy the circle criterion, \
                       Re p2(jw) conj p1(jw) > 0 at all w; choose a ratio closer to 1";
        require("ratio", self.ratio, k.len() < 3 || self.converges(k), allowed).map(|_| ())
    }
}

/// Han's nonlinear gains (2009): vᵢ = fal(e, αᵢ, δ), e/δ^{1−αᵢ} within |e| ≤ δ and ⌊e⌉^{αᵢ} outside.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Fal<T, const N: usize> {
    alpha: SVector<T, N>,
    delta: T,
}

crate::error::through_constructor! {
    [T: Scalar, const N: usize]
    Fal<T, N>: shape => { alpha: SVector<T, N> = shape.alpha, delta: T = shape.delta }
    => Self::new(alpha.into(), delta)
}

impl<T: Scalar, const N: usize> Fal<T, N> {
    /// Exponents αᵢ in (0, 1], one a state, and δ > 0 in the output's unit.
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn new(alpha: [T; N], delta: T) -> Result<Self, DesignError> {
        for entry in alpha {
            let inside = positive("alpha", entry)? <= T::ONE;
            require(
                "alpha",
                entry,
                inside,
                "at most 1: an exponent of a growth slower than linear",
            )?;
        }
        Ok(Self { alpha: alpha.into(), delta: positive("delta", delta)? })
    }
}

impl<T: Scalar, const N: usize> Shape<T> for Fal<T, N> {
    forgets!();
    #[inline(always)]
    fn rows(&self, (): &(), e: T, rows: &mut [T]) {
        let size = e.abs().max(self.delta);
        for (row, alpha) in rows.iter_mut().zip(self.alpha.iter()) {
            *row = e * size.powf(*alpha - T::ONE); // |e|^{α−1} outside δ, δ^{α−1} within
        }
    }
    fn fits(&self, k: Option<&[T]>) -> Result<(), DesignError> {
        one_each(N, of_rows(k)?)
    }
}

/// Functions homogeneous of one degree near 0 and of another far away, Andrieu, Praly and Astolfi (2008),
/// Cruz-Zavala and Moreno (2019): v₁ = φ₁(e), vᵢ = φᵢ(vᵢ₋₁), φᵢ(s) = κᵢ⌊s⌉^{pᵢ} + θᵢ⌊s⌉^{qᵢ},
/// pᵢ = (1 − (n−i−1)d₀)/(1 − (n−i)d₀) and qᵢ the same with d∞.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BiHomogeneous<T, const N: usize> {
    kappa: SVector<T, N>,
    theta: SVector<T, N>,
    near: T,
    far: T,
    p: SVector<T, N>,
    q: SVector<T, N>,
}

crate::error::through_constructor! {
    [T: Scalar, const N: usize]
    BiHomogeneous<T, N>: shape => {
        near: T = shape.near,
        far: T = shape.far,
        kappa: SVector<T, N> = shape.kappa,
        theta: SVector<T, N> = shape.theta,
    }
    => Self::new(near, far, kappa.into(), theta.into())
}

impl<T: Scalar, const N: usize> BiHomogeneous<T, N> {
    /// Degrees −1 ≤ d₀ ≤ d∞ < 1/(n−1), κᵢ and θᵢ ≥ 0, not both 0.
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn new(near: T, far: T, kappa: [T; N], theta: [T; N]) -> Result<Self, DesignError> {
        require("near", near, near >= -T::ONE && near <= far, "in [-1, far]")?;
        let count = |i: usize| T::from_u64(i as u64);
        let below = far * count(N.saturating_sub(1)) < T::ONE;
        require("far", far, far.is_finite() && below, "below 1/(n - 1)")?;
        for (kappa, theta) in kappa.into_iter().zip(theta) {
            let holds = kappa >= T::ZERO && theta >= T::ZERO && kappa + theta > T::ZERO;
            let allowed = "0 or more, and not both of kappa and theta 0";
            require("kappa", kappa, holds && finite("theta", kappa + theta).is_ok(), allowed)?;
        }
        let powers = |d: T| {
            SVector::from_fn(|i, _| {
                let left = count(N - 1 - i); // n − i in the paper's count
                (T::ONE + d - left * d) / (T::ONE - left * d)
            })
        };
        let (p, q) = (powers(near), powers(far));
        Ok(Self { kappa: kappa.into(), theta: theta.into(), near, far, p, q })
    }
}

impl<T: Scalar, const N: usize> Shape<T> for BiHomogeneous<T, N> {
    forgets!();
    #[inline(always)]
    fn rows(&self, (): &(), e: T, rows: &mut [T]) {
        let mut s = e;
        for (i, row) in rows.iter_mut().enumerate().take(N) {
            s = self.kappa[i] * signed_power(s, self.p[i])
                + self.theta[i] * signed_power(s, self.q[i]); // φᵢ(vᵢ₋₁)
            *row = s;
        }
    }
    fn fits(&self, k: Option<&[T]>) -> Result<(), DesignError> {
        one_each(N, of_rows(k)?)
    }
}
