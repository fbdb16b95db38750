//! The plant of Sanfelice and Praly (19): ẋ₁ = x₂ + ν₁x₁ + ν₂, ẋ₂ = 0, y = x₁.
//!
//! The observer knows ν₁ and not ν₂: f̂(x̂) = (ν₁x̂₁, 0).

use crate::Scalar;
use crate::error::{DesignError, finite};
use crate::model::{Model, Plant};
use nalgebra::{SVector, Vector2};

/// Plant (19) with the known ν₁ and the unknown ν₂.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SanfelicePraly<T> {
    nu1: T,
    nu2: T,
}

crate::error::through_constructor! {
    [T: Scalar] SanfelicePraly<T>: plant => { nu1: T = plant.nu1, nu2: T = plant.nu2 }
    => Self::new(nu1, nu2)
}

impl<T: Scalar> SanfelicePraly<T> {
    /// ν₁ in 1/s, ν₂ in units of x a second.
    ///
    /// # Errors
    /// A parameter that is not finite.
    pub fn new(nu1: T, nu2: T) -> Result<Self, DesignError> {
        Ok(Self { nu1: finite("nu1", nu1)?, nu2: finite("nu2", nu2)? })
    }
}

impl<T: Scalar, S: Scalar + From<T>> Model<S, 2> for SanfelicePraly<T> {
    #[inline(always)]
    fn f_hat(&self, _: S, x_hat: &Vector2<S>, _: &SVector<S, 0>) -> Vector2<S> {
        Vector2::new(S::from(self.nu1) * x_hat.x, S::NEG_ZERO)
    }
}

impl<T: Scalar> Plant<T> for SanfelicePraly<T> {
    first_state_measured!(2);
    #[inline(always)]
    fn drift(&self, _: T, x: &Vector2<T>, _: &SVector<T, 0>) -> Vector2<T> {
        Vector2::new(x.y + self.nu1 * x.x + self.nu2, T::ZERO)
    }
}
