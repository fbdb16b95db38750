//! The high-gain extended Kalman filter, Deza, Busvelle, Gauthier and Rakotopara (1992).
//!
//! θ ≥ 1 the gain, Δ = diag(1, θ, …, θⁿ⁻¹), Q_θ = θ Δ Q Δ, R_θ = R/θ, J = A + ∂f̂/∂x(x̂, u, t):
//!
//!   x̂̇ = A x̂ + f̂(x̂, u, t) + P Cᵀ R_θ⁻¹ (y − C x̂)                                                   (1)
//!   Ṗ = J P + P Jᵀ + Q_θ − P Cᵀ R_θ⁻¹ C P                                                        (2)
//!
//! θ = 1 is the extended Kalman filter. With f̂ = 0 the gains come to rest at kᵢθⁱ, those of the standard law
//! with ℓ = θ and k from the Riccati equation (2) at θ = 1. P moves as [`Factor`], L and D of L D Lᵀ: with
//! F = L⁻¹ J L and M = F D + D Fᵀ + L⁻¹ Q_θ L⁻ᵀ, (2) is
//!
//!   Ḋ = diag M − e₁ e₁ᵀ d₁²/R_θ,     L̇ = L X,  Xᵢⱼ = Mᵢⱼ/dⱼ for i > j, else 0                      (3)
//!
//! Between samples (1) and (2) have no sample: x̂ by the model, and L by its variational equation, Ẇ = J W from
//! W(0) = L, both by Runge and Kutta; then P = W D Wᵀ + ∫ e^{As} Q_θ e^{Aᵀs} ds. [`super::SampledEkf`] moves so.
//!
//! Boizot, Busvelle and Gauthier, Automatica 46 (2010) 1483, have the law in these terms.

use super::{driven, one_row, swept};
use crate::dual::{Dual, times};
use crate::error::{DesignError, positive, require};
use crate::factor::Factor;
use crate::gain::GainLaw;
use crate::integrate::{RightHandSide, rk4};
use crate::memory::Memory;
use crate::model::Model;
use crate::observer::ContinuousLaw;
use crate::scalar::{Constant, Scalar};
use nalgebra::{SMatrix, SVector};

/// The largest order.
const MOST: usize = 6;
/// Entries of the lists of a covariance, of which a law of order N takes the first N(N + 1)/2.
pub const PACKED: usize = MOST * (MOST + 1) / 2;

/// Steps of the model between two samples.
const SUBSTEPS: u32 = 2;

crate::memory_struct! {
    /// Memory of a high-gain EKF.
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    pub struct HighGainEkfState<T, R: Memory; const N: usize> {
        /// Estimate x̂.
        pub x_hat: SVector<T, N>,
        /// P = L D Lᵀ.
        pub p: Factor<T, N>,
        /// The gain law's memory: r where the gain moves, else nothing.
        pub r: R,
    }
}

/// x̂ and W, by its columns.
type Ahead<T, const N: usize> = (SVector<T, N>, [SVector<T, N>; N]);

/// A model of chains and the noise that drives it: what moves x̂ and P between samples.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub(super) struct Driven<T: Scalar, Md, const N: usize, const M: usize> {
    /// Q_θ, θ the fixed part of the gain.
    noise: Factor<T, N>,
    pub(super) model: Md,
    /// For each state the first one of its chain.
    first: [usize; N],
}

/// The same under an input that is held.
struct Held<'a, D, U> {
    driven: &'a D,
    u: &'a U,
}

impl<T, Md, const N: usize, const M: usize> RightHandSide<T, Ahead<T, N>>
    for Held<'_, Driven<T, Md, N, M>, SVector<T, M>>
where
    T: Scalar,
    Md: Model<Dual<T, N>, N, M>,
{
    #[inline(always)]
    fn at(&self, t: T, (x_hat, w): &Ahead<T, N>) -> Ahead<T, N> {
        self.driven.rate(t, x_hat, w, self.u)
    }
}

impl<T, Md, const N: usize, const M: usize> Driven<T, Md, N, M>
where
    T: Scalar,
    Md: Model<Dual<T, N>, N, M>,
{
    /// Chains that begin at these states.
    pub(super) fn new(noise: Factor<T, N>, model: Md, first: [usize; N]) -> Self {
        Self { noise, model, first }
    }

    /// A x̂ + f̂, and J W.
    #[inline(always)]
    fn rate(
        &self,
        t: T,
        x_hat: &SVector<T, N>,
        w: &[SVector<T, N>; N],
        u: &SVector<T, M>,
    ) -> Ahead<T, N> {
        let x = SVector::from_fn(|i, _| Dual::along(x_hat[i], i));
        let (t, u) = (Dual::from(t), SVector::from_fn(|i, _| Dual::from(u[i])));
        let f: SVector<Dual<T, N>, N> = self.model.f_hat(t, &x, &u);
        let of = |i: usize| {
            if i + 1 == N || self.first[i + 1] != self.first[i] {
                f[i]
            } else if i + 2 == N {
                self.model.enters(t, &x, x[i + 1], &u) + f[i]
            } else {
                x[i + 1] + f[i]
            }
        };
        let rate: SVector<Dual<T, N>, N> = SVector::from_fn(|i, _| of(i));
        let moved = |v: &SVector<T, N>| {
            SVector::from_fn(|i, _| {
                let mut sum = T::NEG_ZERO;
                for j in 0..N {
                    sum += times(rate[i].slopes[j], v[j]);
                }
                sum
            })
        };
        (SVector::from_fn(|i, _| rate[i].value), core::array::from_fn(|k| moved(&w[k])))
    }

    /// By how much the last state moves the one before it.
    #[inline(always)]
    fn unit(&self, x_hat: &SVector<T, N>) -> T {
        self.model.slope(&SVector::from_fn(|i, _| Dual::from(x_hat[i]))).value
    }

    /// Column j of L of Q_θ and its entry of D, where the gain has grown by r.
    #[inline(always)]
    fn noise(&self, j: usize, r: T) -> (SVector<T, N>, T) {
        let power = |i: usize| i - self.first[i];
        let column = SVector::from_fn(|i, _| {
            if i < j || self.first[i] != self.first[j] {
                T::NEG_ZERO
            } else {
                times(self.noise.l(i, j), r.powi(power(i) - power(j)))
            }
        });
        (column, self.noise.d(j) * r.powi(2 * power(j) + 1))
    }

    /// x a time dt after t by the model alone.
    #[inline(always)]
    pub(super) fn free(&self, t: T, x: &SVector<T, N>, u: &SVector<T, M>, dt: T) -> SVector<T, N> {
        let still = core::array::from_fn(|_| SVector::from_element(T::NEG_ZERO));
        let h = dt * T::from_f64(1.0 / f64::from(SUBSTEPS));
        let (mut moved, mut begun) = (*x, t);
        for _ in 0..SUBSTEPS {
            moved = rk4(|t: T, x: &SVector<T, N>| self.rate(t, x, &still, u).0, begun, &moved, h);
            begun += h;
        }
        moved
    }

    /// x̂ and P a time dt after t, without a sample.
    #[inline(always)]
    pub(super) fn ahead(
        &self,
        t: T,
        (x_hat, p): (&SVector<T, N>, &Factor<T, N>),
        u: &SVector<T, M>,
        dt: T,
        r: T,
    ) -> (SVector<T, N>, Factor<T, N>) {
        let h = dt * T::from_f64(1.0 / f64::from(SUBSTEPS));
        let (mut moved, mut begun) = ((*x_hat, p.columns()), t);
        for _ in 0..SUBSTEPS {
            moved = rk4(Held { driven: self, u }, begun, &moved, h);
            begun += h;
        }
        (moved.0, self.with_noise(p.moved(moved.1), (dt, self.unit(x_hat)), r))
    }

    /// P + ∫ e^{As} Q_θ e^{Aᵀs} ds over dt. With Legendre's polynomials over the period,
    /// sᵃ/a! = Σₘ cₐₘ Pₘ(s), cₐₘ = dtᵃ a! (2m + 1)/((a − m)! (a + m + 1)!), the integral of a column l of
    /// Q_θ's factor is Σₘ dt/(2m + 1) vₘ vₘᵀ, vₘ = Σₐ cₐₘ Aᵃ l: no entry is a difference. The last state is in
    /// the unit that it has at the period's beginning.
    #[inline(always)]
    fn with_noise(&self, mut p: Factor<T, N>, (dt, unit): (T, T), r: T) -> Factor<T, N> {
        for j in 0..N {
            let (l, d) = self.noise(j, r);
            if self.noise.d(j).is_nothing() {
                continue;
            }
            for m in 0..N {
                let share = |i: usize, a: usize| {
                    let from = i + a;
                    if a < m || from >= N || self.first[from] != self.first[i] {
                        return T::NEG_ZERO;
                    }
                    let unit = if from + 1 == N && a > 0 { unit } else { T::ONE };
                    times(l[from], dt.powi(a) * T::constant(of(LEGENDRE.get(a), m)) * unit)
                };
                let v = SVector::from_fn(|i, _| {
                    let mut sum = T::NEG_ZERO;
                    for a in m..N {
                        sum += share(i, a);
                    }
                    sum
                });
                let weight = d * (dt * T::constant(of(Some(&ODD), m)));
                p = p.plus_noise(weight, v);
            }
        }
        p
    }
}

/// 1/(2m + 1).
const ODD: [Constant; MOST] = {
    let (mut odd, mut m) = ([Constant::new(1.0); MOST], 1);
    while m < MOST {
        odd[m] = Constant::new(1.0 / (2.0 * m as f64 + 1.0));
        m += 1;
    }
    odd
};
/// cₐₘ over dtᵃ.
const LEGENDRE: [[Constant; MOST]; MOST] = {
    let (mut c, mut a) = ([[Constant::new(0.0); MOST]; MOST], 0);
    while a < MOST {
        let mut m = 0;
        while m < MOST {
            c[a][m] = Constant::new(legendre(a, m));
            m += 1;
        }
        a += 1;
    }
    c
};

/// An entry of a row, where there are both.
#[inline(always)]
fn of(row: Option<&[Constant; MOST]>, m: usize) -> Constant {
    row.and_then(|row| row.get(m)).copied().unwrap_or(Constant::new(0.0))
}

/// a! (2m + 1)/((a − m)! (a + m + 1)!), 0 for m > a.
const fn legendre(a: usize, m: usize) -> f64 {
    if m > a {
        return 0.0;
    }
    let (mut made, mut i) = ((2 * m + 1) as f64, 1);
    while i <= a + m + 1 {
        if i > a {
            made /= i as f64;
        }
        if i > a - m && i <= a {
            made *= i as f64;
        }
        i += 1;
    }
    let mut i = 1;
    while i <= a {
        made /= i as f64;
        i += 1;
    }
    made
}

/// The factor of Q_θ from Q, for states with these gains θ in chains that begin at these states.
pub(super) fn of_gain<T: Scalar, const N: usize>(
    q: &SMatrix<T, N, N>,
    theta: impl Fn(usize) -> T,
    first: &[usize; N],
) -> Result<Factor<T, N>, DesignError> {
    let power = |i: usize| i - first[i];
    let (given, q) = (q, Factor::of("Q", q)?);
    let mut between = T::ZERO;
    for i in 0..N {
        for j in 0..i {
            if first[i] != first[j] && !q.l(i, j).is_nothing() {
                between = given[(i, j)].or(q.l(i, j));
            }
        }
        let theta = theta(i);
        require("theta", theta, theta >= T::ONE, "the gain must be at least 1")?;
    }
    let allowed = "entries between states of different chains must be 0";
    require("Q", between, between.is_nothing(), allowed)?;
    let noise = Factor::from_fn(|i, j| {
        if i == j {
            q.d(j) * theta(j).powi(2 * power(j) + 1)
        } else if q.l(i, j).is_nothing() {
            T::ZERO
        } else {
            q.l(i, j) * theta(i).powi(power(i) - power(j))
        }
    });
    let mut fits = true;
    noise.visit(&mut |entry| fits &= entry.is_finite());
    let largest = (0..N).fold(T::ONE, |largest, i| largest.max(theta(i)));
    require("theta", largest, fits, "its powers times q must be finite in the chosen precision")?;
    Ok(noise)
}

/// The factor of P(0).
pub(super) fn started<T: Scalar, const N: usize>(
    p0: &SMatrix<T, N, N>,
) -> Result<Factor<T, N>, DesignError> {
    let start = Factor::of("P0", p0)?;
    for i in 0..N {
        positive("P0", start.d(i))?;
    }
    Ok(start)
}

/// High-gain EKF of order N, with M known inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HighGainEkf<T: Scalar, G, Md, const N: usize, const M: usize = 0> {
    q: SMatrix<T, N, N>,
    r: T,
    p0: SMatrix<T, N, N>,
    gain: G,
    /// P(0).
    start: Factor<T, N>,
    /// R_θ, θ the fixed part of the gain.
    variance: T,
    driven: Driven<T, Md, N, M>,
}

crate::error::through_constructor! {
    [
        T: Scalar, G: GainLaw<T>, Md: Model<Dual<T, N>, N, M>, const N: usize, const M: usize
    ]
    HighGainEkf<T, G, Md, N, M>: law => {
        q: SMatrix<T, N, N> = law.q,
        r: T = law.r,
        p0: SMatrix<T, N, N> = law.p0,
        gain: G = law.gain,
        model: Md = law.driven.model,
    }
    => Self::with(&q, r, &p0, gain, model)
}

impl<T, G, Md, const N: usize, const M: usize> HighGainEkf<T, G, Md, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: Model<Dual<T, N>, N, M>,
{
    /// As [`HighGainEkf::with`], Q and P(0) by their lower triangles, row by row, with zeros behind.
    ///
    /// # Errors
    /// As there.
    pub fn new(
        q: [T; PACKED],
        r: [T; 1],
        p0: [T; PACKED],
        gain: G,
        model: Md,
    ) -> Result<Self, DesignError> {
        let [r] = r;
        let full = |packed: [T; PACKED]| {
            SMatrix::from_fn(|i: usize, j: usize| {
                let (low, high) = (i.min(j), i.max(j));
                packed.get(high * (high + 1) / 2 + low).copied().unwrap_or(T::ZERO)
            })
        };
        Self::with(&full(q), r, &full(p0), gain, model)
    }

    /// Intensities Q of white noise in ẋ and R of white noise in y (variance of a sample times the period),
    /// covariance P(0) of the first estimate, gain law, model.
    ///
    /// # Errors
    /// An order above 6; Q that is not positive semidefinite; R or P(0) that is not positive; a gain below 1,
    /// or whose powers the precision does not hold.
    pub fn with(
        q: &SMatrix<T, N, N>,
        r: T,
        p0: &SMatrix<T, N, N>,
        gain: G,
        model: Md,
    ) -> Result<Self, DesignError> {
        let order = T::from_f64(N as f64);
        require("n", order, (1..=MOST).contains(&N), "the order must be 1 to 6")?;
        positive("R", r)?;
        gain.fits(None, None)?;
        let theta = gain.fixed();
        let (start, noise) = (started(p0)?, of_gain(q, |_| theta, &[0; N])?);
        let driven = Driven::new(noise, model, [0; N]);
        Ok(Self { q: *q, r, p0: *p0, gain, start, variance: positive("R", r / theta)?, driven })
    }

    /// R_θ where the gain has grown by r.
    #[inline(always)]
    fn variance(&self, r: T) -> T {
        self.variance / r
    }
}

impl<T, G, Md, const N: usize, const M: usize> ContinuousLaw<T> for HighGainEkf<T, G, Md, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: Model<Dual<T, N>, N, M>,
{
    type State = HighGainEkfState<T, G::Memory, N>;
    type Input = SVector<T, M>;
    /// y − x̂₁, and 1, or 0 where y is missing.
    type Innovation = (T, T);
    const ESTIMATED: usize = N;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        HighGainEkfState { p: self.start, r: self.gain.initial(), ..HighGainEkfState::zero() }
    }

    #[inline(always)]
    fn innovation(&self, z: &Self::State, y: T) -> (T, T) {
        (y.innovation(z.x_hat[0]), T::ONE - T::ONE.while_missing(y))
    }

    #[inline(always)]
    fn rate(&self, t: T, z: &Self::State, (e, taken): &(T, T), u: &Self::Input) -> Self::State {
        let HighGainEkfState { x_hat, p, r } = z;
        let (g, v) = (self.gain.moving(r, *e), one_row(&self.gain, r, *e));
        let (x, jl) = self.driven.rate(t, x_hat, &p.columns(), u);
        let f: [SVector<T, N>; N] = core::array::from_fn(|k| p.solve(&jl[k])); // F, by its columns
        let mut m = SMatrix::<T, N, N>::from_fn(|i, j| f[j][i] * p.d(j) + p.d(i) * f[i][j]);
        for k in 0..N {
            if self.driven.noise.d(k).is_nothing() {
                continue;
            }
            let (column, d) = self.driven.noise(k, g);
            let column = p.solve(&column);
            m = SMatrix::from_fn(|i, j| m[(i, j)] + times(column[i], column[j] * d));
        }
        let down = *taken / self.variance(g);
        let l = p.columns();
        let p_rate = Factor::from_fn(|i, j| {
            if i == j {
                // (3)
                return if i == 0 { m[(0, 0)] - p.d(0) * p.d(0) * down } else { m[(i, i)] };
            }
            let mut sum = T::NEG_ZERO;
            for k in j + 1..=i {
                sum += l[k][i] * m[(k, j)];
            }
            sum / p.d(j).or(T::ONE)
        });
        let by = p.d(0) * v / self.variance(g);
        HighGainEkfState {
            x_hat: SVector::from_fn(|i, _| x[i] + l[0][i] * by), // (1)
            p: p_rate,
            r: self.gain.rate::<N>(r, *e),
        }
    }

    #[inline(always)]
    fn injection(&self, z: &Self::State, (e, taken): &(T, T)) -> Self::State {
        let HighGainEkfState { p, r, .. } = z;
        let (d, variance) = (p.d(0), self.variance(self.gain.moving(r, *e)));
        let by = d * one_row(&self.gain, r, *e) / variance;
        let down = -(d * d * (*taken / variance));
        HighGainEkfState {
            x_hat: SVector::from_fn(|i, _| p.l(i, 0) * by),
            p: Factor::from_fn(|i, _| if i == 0 { down } else { T::ZERO }),
            r: driven::<T, G, N>(&self.gain, r, *e),
        }
    }

    /// The chain is swept, its last state by its unit; P is not.
    #[inline(always)]
    fn stagger(&self, old: &Self::State, mut new: Self::State, dt: T) -> Self::State {
        let unit = self.driven.unit(&old.x_hat);
        let slopes = SVector::from_fn(|i, _| if i + 1 == N { unit } else { T::ONE });
        new.x_hat = swept(&old.x_hat, new.x_hat, &slopes, dt);
        new
    }

    super::of_gain_and_estimate!(HighGainEkfState, gain, e in (e, _));
}
