//! Floor 1. Gain laws: how the high gain ℓ (written r where it moves) is chosen and adapted.
//!
//! A gain law is a choice of its own: any structure of [`crate::observers`] takes any of them. [`Shaped`]
//! puts a [`Shape`] between the innovation and the injection of any of them.

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
    fn fits(&self, _: Option<&[T]>) -> Result<(), DesignError> {
        Ok(())
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
    fn fits(&self, k: Option<&[T]>) -> Result<(), DesignError> {
        self.gain.fits(k)?;
        self.shape.fits(k)
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
    fn admissible(&self, (r, sigma): Self::Memory) -> Self::Memory {
        (self.gain.admissible(r), self.shape.admissible(sigma))
    }
}
