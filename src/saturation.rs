//! Floor 1. Saturations: what keeps the auxiliary states of the peaking-free observer from peaking.
//!
//! Astolfi, Marconi, Praly and Teel (10), (11): levels rᵢ ≥ max |xᵢ| over the states of interest.

use crate::Scalar;
use crate::error::{DesignError, positive};
use nalgebra::SVector;

/// A saturation function for each auxiliary state.
pub trait Saturation<T: Scalar>: Copy {
    /// `sat(η)` for the auxiliary state in slot i, which estimates x of index i + 2.
    fn apply(&self, i: usize, eta: T) -> T;
    /// Whether nothing is saturated: sat(η) = η.
    #[inline(always)]
    fn is_identity(&self) -> bool {
        false
    }
}

/// The identity: the low-power observer (5).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NoSaturation;

impl<T: Scalar> Saturation<T> for NoSaturation {
    #[inline(always)]
    fn apply(&self, _: usize, eta: T) -> T {
        eta
    }
    #[inline(always)]
    fn is_identity(&self) -> bool {
        true
    }
}

/// sat(s) = s within ±r, ±r outside: what the paper's tables were computed with.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HardClip<T, const N: usize> {
    levels: SVector<T, N>,
}

crate::error::through_constructor! {
    [T: Scalar, const N: usize] HardClip<T, N>: clip => { levels: SVector<T, N> = clip.levels }
    => Self::new(levels.into())
}

/// A strictly increasing C¹ saturation as the paper's text defines it: s within ±r and
/// ±(r + u/(1 + u)), u = |s| − r, outside; bounded by r + 1.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SmoothSaturation<T, const N: usize> {
    levels: SVector<T, N>,
}

crate::error::through_constructor! {
    [T: Scalar, const N: usize]
    SmoothSaturation<T, N>: clip => { levels: SVector<T, N> = clip.levels }
    => Self::new(levels.into())
}

fn checked_levels<T: Scalar, const N: usize>(levels: [T; N]) -> Result<SVector<T, N>, DesignError> {
    for level in levels.iter().take(N.saturating_sub(1)) {
        positive("saturation", *level)?;
    }
    Ok(SVector::from_fn(|i, _| levels[i]))
}

impl<T: Scalar, const N: usize> HardClip<T, N> {
    /// Levels r₂ … rₙ ≥ max |xᵢ| (10); the N-th entry is not used.
    ///
    /// # Errors
    /// A level not finite or ≤ 0.
    pub fn new(levels: [T; N]) -> Result<Self, DesignError> {
        Ok(Self { levels: checked_levels(levels)? })
    }
}

impl<T: Scalar, const N: usize> SmoothSaturation<T, N> {
    /// Levels r₂ … rₙ ≥ max |xᵢ| (10); the N-th entry is not used.
    ///
    /// # Errors
    /// A level not finite or ≤ 0.
    pub fn new(levels: [T; N]) -> Result<Self, DesignError> {
        Ok(Self { levels: checked_levels(levels)? })
    }
}

impl<T: Scalar, const N: usize> Saturation<T> for HardClip<T, N> {
    #[inline(always)]
    fn apply(&self, i: usize, eta: T) -> T {
        let level = self.levels[i];
        eta.clip(-level, level)
    }
}

impl<T: Scalar, const N: usize> Saturation<T> for SmoothSaturation<T, N> {
    #[inline(always)]
    fn apply(&self, i: usize, eta: T) -> T {
        let level = self.levels[i];
        let beyond = (eta.abs() - level).max(T::ZERO);
        eta.clip(-level, level) + (beyond / (T::ONE + beyond)).copysign(eta)
    }
}
