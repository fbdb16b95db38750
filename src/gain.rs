//! Floor 1. Gain laws: how the high gain ℓ (written r where it moves) is chosen and adapted.
//!
//! A gain law is a choice of its own: any structure of [`crate::observers`] takes any of them. [`Shaped`]
//! puts a [`Shape`] between the innovation and the injection of any of them.
//!
//! Levant, Int. J. Control 76 (2003) 924; Ahrens and Khalil, Automatica 45 (2009) 936; Holloway and Krstic, IEEE
//! TAC 64 (2019) 3905.

use crate::Scalar;
use crate::error::{DesignError, positive, require};
use crate::memory::Memory;
use crate::shape::Shape;

/// The gain of an observer: a part that is fixed before the run, times a part that a law moves.
///
/// The fixed part is folded into an observer's coefficients once, so that a step only pays for
/// the part that moves.
pub trait GainLaw<T: Scalar>: Copy {
    /// What the law remembers: nothing, or r.
    type Memory: Memory<T>;
    /// Whether the gain is the same at every sample.
    const STILL: bool = <Self::Memory as Memory<T>>::LEN == 0;
    /// Whether [`Self::rows`] writes one value, the same for every row.
    const ALIKE: bool = true;
    /// The memory to start from: r(0) = 1.
    fn initial(&self) -> Self::Memory;
    /// The part of the gain that is fixed: ℓ, or 1.
    fn fixed(&self) -> T;
    /// The part of the gain that moves, under the innovation `e`: 1, or r.
    fn moving(&self, memory: &Self::Memory, e: T) -> T;
    /// By how much the gain has shortened the stability limit of a step: r, or 1.
    #[inline(always)]
    fn speed(&self, memory: &Self::Memory) -> T {
        self.moving(memory, T::ZERO)
    }
    /// What the rows of the injection take in the place of the innovation `e`: see [`Shape`].
    #[inline(always)]
    fn rows(&self, _: &Self::Memory, e: T, rows: &mut [T]) {
        rows.fill(e);
    }
    /// Refuse a structure that the law is not defined for: one with a row for each state of a chain, of
    /// these coefficients, or one whose rows all take the same value (`None`).
    ///
    /// # Errors
    /// An order or a structure that the law was not made for; coefficients for which it may not converge.
    #[inline(always)]
    fn fits(&self, _: Option<usize>, _: Option<&[T]>) -> Result<(), DesignError> {
        Ok(())
    }
    /// Which innovation moves the gain: e = y − x̂₁, or what a filter in front of the chain lets through.
    #[inline(always)]
    fn seen(&self, e: T, _filtered: T) -> T {
        e
    }
    /// Refuse the implicit step.
    ///
    /// # Errors
    /// A gain whose value at the end of the step is the root of no polynomial.
    fn closed(&self) -> Result<(), DesignError> {
        Ok(())
    }
    /// 1/r at the end of an implicit step, whose innovation e⁺ solves e⁺ (1 + Σ gᵢ rⁱ) = b.
    #[inline(always)]
    fn closing(&self, memory: &Self::Memory, b: T, _g: &[T]) -> T {
        T::ONE / self.moving(memory, b)
    }
    /// Refuse a correction whose eigenvalues are [placed](crate::injection).
    ///
    /// # Errors
    /// Rows of an injection that are not alike, which no eigenvalues describe.
    fn placed(&self) -> Result<(), DesignError> {
        Ok(())
    }
    /// Time derivative of the memory under the innovation `e` = y − ŷ of an observer of order N.
    fn rate<const N: usize>(&self, memory: &Self::Memory, e: T) -> Self::Memory;
    /// The memory at a sample of the innovation `e`, before the step: a law that switches at samples moves it
    /// at once here.
    #[inline(always)]
    fn jumped(&self, memory: Self::Memory, _e: T) -> Self::Memory {
        memory
    }
    /// The memory brought back into the set that the law lives in (r ≥ 1).
    fn admissible(&self, memory: Self::Memory) -> Self::Memory;
}

/// A fixed gain ℓ > 0 (ε = 1/ℓ in Khalil's notation).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ConstantGain<T> {
    ell: T,
}

crate::error::through_constructor! {
    [T: Scalar] ConstantGain<T>: gain => { ell: T = gain.ell }
    => Self::new(ell)
}

impl<T: Scalar> ConstantGain<T> {
    /// Gain ℓ, in 1/s.
    ///
    /// # Errors
    /// ℓ not finite or ≤ 0.
    pub fn new(ell: T) -> Result<Self, DesignError> {
        Ok(Self { ell: positive("ell", ell)? })
    }

    /// Gain ℓ = 1/ε, ε in s.
    ///
    /// # Errors
    /// ε not finite or ≤ 0; 1/ε not finite.
    pub fn from_epsilon(epsilon: T) -> Result<Self, DesignError> {
        Self::new(T::ONE / positive("epsilon", epsilon)?)
    }
}

impl<T: Scalar> GainLaw<T> for ConstantGain<T> {
    type Memory = ();
    #[inline(always)]
    fn initial(&self) {}
    #[inline(always)]
    fn fixed(&self) -> T {
        self.ell
    }
    #[inline(always)]
    fn moving(&self, (): &(), _: T) -> T {
        T::ONE
    }
    #[inline(always)]
    fn rate<const N: usize>(&self, (): &(), _: T) {}
    #[inline(always)]
    fn admissible(&self, (): ()) {}
}

/// What every law whose gain r moves in [1, ∞) says the same way, inside its `impl GainLaw`: r is the
/// whole gain and the memory, and begins at 1.
#[macro_export]
#[doc(hidden)]
macro_rules! moves_in_one_to_infinity {
    () => {
        type Memory = T;
        #[inline(always)]
        fn initial(&self) -> T {
            T::ONE
        }
        #[inline(always)]
        fn fixed(&self) -> T {
            T::ONE
        }
        #[inline(always)]
        fn moving(&self, r: &T, _: T) -> T {
            *r
        }
        #[inline(always)]
        fn admissible(&self, r: T) -> T {
            r.max(T::ONE)
        }
    };
}

/// What the two adaptive laws of Sanfelice and Praly share: speed p₁, threshold p₂, exponent b.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct Adaptation<T> {
    p1: T,
    p2: T,
    b: T,
    /// 1 − 2b.
    exponent: T,
}

impl<T: Scalar> Adaptation<T> {
    fn new(p1: T, p2: T, b: T) -> Result<Self, DesignError> {
        let (p1, p2) = (positive("p1", p1)?, positive("p2", p2)?);
        let inside = b > T::ZERO && b < T::from_f64(0.5);
        require("b", b, inside, "it must lie in (0, 1/2), Sanfelice and Praly (8)-(10)")?;
        Ok(Self { p1, p2, b, exponent: T::ONE - (b + b) })
    }

    /// r^{1−2b}.
    #[inline(always)]
    fn growth(&self, r: T) -> T {
        r.powf(self.exponent)
    }
}

/// Gain adaptation, Sanfelice and Praly (6): ṙ = p₁( ((ŷ−y)² − p₂) r^{1−2b} + p₂/r^{2n} ).
///
/// r grows while the output error exceeds √p₂ and comes back towards 1 when it does not;
/// [1, ∞) is forward invariant.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AdaptiveGain<T> {
    law: Adaptation<T>,
}

crate::error::through_constructor! {
    [T: Scalar]
    AdaptiveGain<T>: gain => { p1: T = gain.law.p1, p2: T = gain.law.p2, b: T = gain.law.b }
    => Self::new(p1, p2, b)
}

impl<T: Scalar> AdaptiveGain<T> {
    /// p₁ > 0 (speed), p₂ > 0 (squared output-error threshold), b in (0, ½).
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn new(p1: T, p2: T, b: T) -> Result<Self, DesignError> {
        Ok(Self { law: Adaptation::new(p1, p2, b)? })
    }

    /// b.
    #[inline(always)]
    pub fn b(&self) -> T {
        self.law.b
    }
}

impl<T: Scalar> GainLaw<T> for AdaptiveGain<T> {
    moves_in_one_to_infinity!();
    #[inline(always)]
    fn rate<const N: usize>(&self, r: &T, e: T) -> T {
        let Adaptation { p1, p2, .. } = self.law;
        p1 * ((e * e - p2) * self.law.growth(*r) + p2 / r.powi(2 * N)) // (6)
    }
}

/// Adaptation with a dead zone, Sanfelice and Praly (4): ṙ = p₁ max{0, (ŷ−y)² − p₂} r^{1−2b}.
///
/// r never decreases.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct DeadZoneGain<T> {
    law: Adaptation<T>,
}

crate::error::through_constructor! {
    [T: Scalar]
    DeadZoneGain<T>: gain => { p1: T = gain.law.p1, p2: T = gain.law.p2, b: T = gain.law.b }
    => Self::new(p1, p2, b)
}

impl<T: Scalar> DeadZoneGain<T> {
    /// p₁ > 0 (speed), p₂ > 0 (squared output-error threshold), b in (0, ½).
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn new(p1: T, p2: T, b: T) -> Result<Self, DesignError> {
        Ok(Self { law: Adaptation::new(p1, p2, b)? })
    }
}

impl<T: Scalar> GainLaw<T> for DeadZoneGain<T> {
    moves_in_one_to_infinity!();
    #[inline(always)]
    fn rate<const N: usize>(&self, r: &T, e: T) -> T {
        let Adaptation { p1, p2, .. } = self.law;
        p1 * (e * e - p2).max(T::ZERO) * self.law.growth(*r) // (4)
    }
}

/// Homogeneous gain, Levant (2003): r(e) = ρ |e|ᵖ (1 + μ|e|), p = d/(1 − (n−1)d), for an observer of order n.
///
/// With d = −1, μ = 0 and ρ = L^{1/n} the standard observer is Levant's differentiator, which injects
/// kᵢ L^{i/n} ⌊e⌉^{(n−i)/n}; d = 0 is the constant gain ρ; d = −1 and μ > 0 is the uniform differentiator.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HomogeneousGain<T> {
    rho: T,
    degree: T,
    mu: T,
    order: usize,
    /// p.
    exponent: T,
}

crate::error::through_constructor! {
    [T: Scalar]
    HomogeneousGain<T>: gain => {
        rho: T = gain.rho, degree: T = gain.degree, mu: T = gain.mu, order: usize = gain.order,
    }
    => Self::new(rho, degree, mu, order)
}

/// The smallest |e| at which r(e) grows: below it the injection is linear, and 0 at e = 0 where r would be
/// infinite.
const LEAST_ERROR: f64 = 1e-30;

impl<T: Scalar> HomogeneousGain<T> {
    /// Scale ρ > 0, degree d in [−1, 0], μ ≥ 0, order 2 to 12.
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn new(rho: T, degree: T, mu: T, order: usize) -> Result<Self, DesignError> {
        let inside = degree >= -T::ONE && degree <= T::ZERO;
        require("degree", degree, inside, "it must lie in [-1, 0]")?;
        require("mu", mu, mu.is_finite() && mu >= T::ZERO, "it must be finite and >= 0")?;
        let allowed = "a homogeneous gain is for the orders 2 to 12";
        let count = T::from_u64(order as u64);
        require("n", count, (2..=12).contains(&order), allowed)?;
        let exponent = degree / (T::ONE - (count - T::ONE) * degree);
        Ok(Self { rho: positive("rho", rho)?, degree, mu, order, exponent })
    }

    /// L of [`Self::new`]: ρ = L^{1/n}, d = −1, for |φ − φ̂| ≤ L.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn levant(bound: T, order: usize) -> Result<Self, DesignError> {
        let power = T::ONE / T::from_u64(order.max(1) as u64);
        Self::new(positive("bound", bound)?.powf(power), -T::ONE, T::ZERO, order)
    }
}

impl<T: Scalar> GainLaw<T> for HomogeneousGain<T> {
    type Memory = ();
    const STILL: bool = false;
    #[inline(always)]
    fn initial(&self) {}
    #[inline(always)]
    fn fixed(&self) -> T {
        self.rho
    }
    #[inline(always)]
    fn moving(&self, (): &(), e: T) -> T {
        let size = e.abs();
        size.max(T::from_f64(LEAST_ERROR)).powf(self.exponent) * (T::ONE + self.mu * size) // r(e)/ρ
    }
    /// No limit of a step is known by the gain: it moves with the error.
    #[inline(always)]
    fn speed(&self, (): &()) -> T {
        T::ONE
    }
    #[inline(always)]
    fn rate<const N: usize>(&self, (): &(), _: T) {}
    #[inline(always)]
    fn admissible(&self, (): ()) {}
    fn fits(&self, order: Option<usize>, _: Option<&[T]>) -> Result<(), DesignError> {
        let allowed = "the homogeneous gain is made for the standard observer of its own order, or a filtered \
                       one of this order with the filter's states counted";
        let count = T::from_u64(self.order as u64);
        require("order of the gain", count, order == Some(self.order), allowed).map(|_| ())
    }
    #[inline(always)]
    fn seen(&self, _: T, filtered: T) -> T {
        filtered
    }
    fn closed(&self) -> Result<(), DesignError> {
        let of_levant = self.degree == -T::ONE || self.degree == T::ZERO;
        let allowed = "the implicit step is for degree -1 or 0 and mu = 0; choose method zoh";
        require("degree", self.degree, of_levant && self.mu == T::ZERO, allowed).map(|_| ())
    }
    /// s = |e⁺|^{1/n} of degree −1, the root of sⁿ + g₁sⁿ⁻¹ + … + gₙ₋₁s = |b| − gₙ, or 0 where there is none
    /// above 0. Newton's method comes down to it from a larger s and never passes it, as the left side is
    /// convex: n + 3 steps reach the last digits, and one or two are to spare.
    #[inline(always)]
    fn closing(&self, (): &(), b: T, g: &[T]) -> T {
        if self.degree == T::ZERO {
            return T::ONE;
        }
        let n = g.len();
        let at = |i: usize| g.get(i).copied().unwrap_or(T::ZERO);
        let left = (b.abs() - at(n - 1)).max(T::ZERO);
        let root = left.max(T::from_f64(LEAST_ERROR)).powf(-self.exponent);
        let mut s = root.min(left / at(n.wrapping_sub(2)).or(T::ONE));
        for _ in 0..n + 5 {
            let (mut value, mut slope) = (T::ONE, T::ZERO);
            for i in 0..n {
                slope = slope * s + value;
                value = if i + 1 < n { value * s + at(i) } else { value * s };
            }
            s = (s - (value - left) / slope.or(T::ONE)).max(T::ZERO);
        }
        s
    }
}

/// What the laws whose memory is a time s that begins at 0 say the same way, inside their `impl GainLaw`.
macro_rules! counts_time {
    () => {
        type Memory = T;
        #[inline(always)]
        fn initial(&self) -> T {
            T::ZERO
        }
    };
}

/// Switched gain, Ahrens and Khalil (2009): ℓ while the error is large or was within the last T_d, ρℓ after.
///
/// Its memory is the quiet time s ≥ 0, set to 0 by a sample with |e| > d.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SwitchedGain<T> {
    fast: T,
    slow: T,
    zone: T,
    delay: T,
    /// Slow over fast.
    ratio: T,
}

crate::error::through_constructor! {
    [T: Scalar]
    SwitchedGain<T>: gain => {
        fast: T = gain.fast, slow: T = gain.slow, zone: T = gain.zone, delay: T = gain.delay,
    }
    => Self::new(fast, slow, zone, delay)
}

impl<T: Scalar> SwitchedGain<T> {
    /// Gains 0 < slow ≤ fast (1/s), zone d > 0 in the output's unit, delay T_d ≥ 0 (s).
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn new(fast: T, slow: T, zone: T, delay: T) -> Result<Self, DesignError> {
        let (fast, slow) = (positive("fast", fast)?, positive("slow", slow)?);
        require("slow", slow, slow <= fast, "it must be at most the fast gain")?;
        require("delay", delay, delay.is_finite() && delay >= T::ZERO, "a time >= 0, in s")?;
        Ok(Self { fast, slow, zone: positive("zone", zone)?, delay, ratio: slow / fast })
    }
}

impl<T: Scalar> GainLaw<T> for SwitchedGain<T> {
    counts_time!();
    #[inline(always)]
    fn fixed(&self) -> T {
        self.fast
    }
    #[inline(always)]
    fn moving(&self, s: &T, e: T) -> T {
        let quiet = self.delay.where_above(*s, T::ONE, self.ratio); // fast while s < T_d
        e.abs().where_above(self.zone, T::ONE, quiet) // and while |e| > d
    }
    /// The limit of a step is that of the fast gain.
    #[inline(always)]
    fn speed(&self, _: &T) -> T {
        T::ONE
    }
    #[inline(always)]
    fn jumped(&self, s: T, e: T) -> T {
        e.abs().where_above(self.zone, T::ZERO, s) // s ← 0 if |e| > d
    }
    #[inline(always)]
    fn rate<const N: usize>(&self, _: &T, e: T) -> T {
        e.abs().where_above(self.zone, T::ZERO, T::ONE) // else s + T
    }
    /// A correction takes the time that it is for, which a gap makes longer than the quiet time.
    #[inline(always)]
    fn admissible(&self, s: T) -> T {
        s.max(T::ZERO)
    }
}

/// Prescribed-time gain, Holloway and Krstic (2019): r(t) = μ₀/(T_p − t) until it reaches r_max, then r_max.
///
/// Its memory is the time s since the start.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PrescribedTimeGain<T> {
    mu0: T,
    deadline: T,
    r_max: T,
    /// μ₀/r_max: the time before the deadline from which on r is r_max.
    rest: T,
}

crate::error::through_constructor! {
    [T: Scalar]
    PrescribedTimeGain<T>: gain => { mu0: T = gain.mu0, deadline: T = gain.deadline, r_max: T = gain.r_max }
    => Self::new(mu0, deadline, r_max)
}

impl<T: Scalar> PrescribedTimeGain<T> {
    /// μ₀ > 0, deadline T_p > 0 (s), r_max > μ₀/T_p (1/s).
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn new(mu0: T, deadline: T, r_max: T) -> Result<Self, DesignError> {
        let (mu0, deadline) = (positive("mu0", mu0)?, positive("deadline", deadline)?);
        let r_max = positive("r_max", r_max)?;
        require(
            "r_max",
            r_max,
            r_max > mu0 / deadline,
            "above mu0/deadline, where the gain begins",
        )?;
        Ok(Self { mu0, deadline, r_max, rest: mu0 / r_max })
    }
}

impl<T: Scalar> GainLaw<T> for PrescribedTimeGain<T> {
    counts_time!();
    #[inline(always)]
    fn fixed(&self) -> T {
        T::ONE
    }
    #[inline(always)]
    fn moving(&self, s: &T, _: T) -> T {
        self.mu0 / (self.deadline - *s).max(self.rest) // min(μ₀/(T_p − s), r_max)
    }
    #[inline(always)]
    fn rate<const N: usize>(&self, _: &T, _: T) -> T {
        T::ONE
    }
    #[inline(always)]
    fn admissible(&self, s: T) -> T {
        s
    }
}

/// Refusal of the implicit step under a shape.
pub const fn unshaped() -> DesignError {
    let allowed = "method implicit takes no shape: leave the shape out, or choose another method";
    DesignError { parameter: "shape", value: 1.0, allowed }
}

/// A gain law with a [`Shape`] between innovation and injection: a gain law itself.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Shaped<G, S> {
    /// The gain law, which sees the innovation itself.
    pub gain: G,
    /// The shape.
    pub shape: S,
}

impl<T: Scalar, G: GainLaw<T>, S: Shape<T>> GainLaw<T> for Shaped<G, S> {
    type Memory = (G::Memory, S::Memory);
    const STILL: bool = G::STILL;
    const ALIKE: bool = S::ALIKE;
    #[inline(always)]
    fn initial(&self) -> Self::Memory {
        (self.gain.initial(), self.shape.initial())
    }
    #[inline(always)]
    fn fixed(&self) -> T {
        self.gain.fixed()
    }
    #[inline(always)]
    fn moving(&self, (r, _): &Self::Memory, e: T) -> T {
        self.gain.moving(r, e)
    }
    #[inline(always)]
    fn speed(&self, (r, _): &Self::Memory) -> T {
        self.gain.speed(r)
    }
    #[inline(always)]
    fn rows(&self, (_, sigma): &Self::Memory, e: T, rows: &mut [T]) {
        self.shape.rows(sigma, e, rows);
    }
    fn fits(&self, order: Option<usize>, k: Option<&[T]>) -> Result<(), DesignError> {
        self.gain.fits(order, k)?;
        self.shape.fits(k)
    }
    #[inline(always)]
    fn seen(&self, e: T, filtered: T) -> T {
        self.gain.seen(e, filtered)
    }
    fn closed(&self) -> Result<(), DesignError> {
        Err(unshaped())
    }
    fn placed(&self) -> Result<(), DesignError> {
        self.gain.placed()?;
        self.shape.placed()
    }
    #[inline(always)]
    fn rate<const N: usize>(&self, (r, sigma): &Self::Memory, e: T) -> Self::Memory {
        (self.gain.rate::<N>(r, e), self.shape.rate(sigma, e))
    }
    #[inline(always)]
    fn jumped(&self, (r, sigma): Self::Memory, e: T) -> Self::Memory {
        (self.gain.jumped(r, e), sigma)
    }
    #[inline(always)]
    fn admissible(&self, (r, sigma): Self::Memory) -> Self::Memory {
        (self.gain.admissible(r), self.shape.admissible(sigma))
    }
}
