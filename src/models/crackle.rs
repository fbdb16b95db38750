//! The chaotic crackle system of Astolfi, Marconi, Praly and Teel (1), (20), n = 5:
//!
//!   ẋᵢ = xᵢ₊₁,   ẋ₅ = φ(x) = 0.2(x₁² − 1) − x₂ − x₃ − 4x₄ − x₅,   y = x₁
//!
//! The observer uses `φ_s`: φ clipped at ±`phi_max`.

use crate::Scalar;
use crate::error::{DesignError, positive};
use crate::model::{Model, PhaseVariable, Plant, last};
use nalgebra::{SVector, Vector5};

/// Plant (20) and the bound of its observer's `φ_s`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Crackle<T> {
    phi_max: T,
}

crate::error::through_constructor! {
    [T: Scalar] Crackle<T>: plant => { phi_max: T = plant.phi_max }
    => Self::new(phi_max)
}

impl<T: Scalar> Crackle<T> {
    /// Bound of `φ_s`; the paper takes 3.
    ///
    /// # Errors
    /// Not finite, or below 0.5, the bound of |φ| along the paper's trajectory.
    pub fn new(phi_max: T) -> Result<Self, DesignError> {
        positive("phi_max", phi_max)?;
        let allowed = "it must be at least 0.5, the bound of |φ| along the system's own trajectory";
        let half = T::from_f64(0.5);
        Ok(Self { phi_max: crate::error::require("phi_max", phi_max, phi_max >= half, allowed)? })
    }

    /// φ (20), not saturated.
    #[inline(always)]
    fn crackle<S: Scalar>(x: &Vector5<S>) -> S {
        let fifth = S::from_f64(0.2);
        let four = S::from_f64(4.0);
        fifth * (x[0] * x[0] - S::ONE) - x[1] - x[2] - four * x[3] - x[4]
    }
}

impl<T: Scalar, S: Scalar + From<T>> PhaseVariable<S, 5> for Crackle<T> {
    #[inline(always)]
    fn phi(&self, _: S, x_hat: &Vector5<S>, _: &SVector<S, 0>) -> S {
        Self::crackle(x_hat).clip(S::from(-self.phi_max), S::from(self.phi_max))
    }
}

impl<T: Scalar, S: Scalar + From<T>> Model<S, 5> for Crackle<T> {
    #[inline(always)]
    fn f_hat(&self, t: S, x_hat: &Vector5<S>, u: &SVector<S, 0>) -> Vector5<S> {
        last(self.phi(t, x_hat, u))
    }
}

impl<T: Scalar> Plant<T> for Crackle<T> {
    first_state_measured!(5);
    #[inline(always)]
    fn drift(&self, _: T, x: &Vector5<T>, _: &SVector<T, 0>) -> Vector5<T> {
        Vector5::new(x[1], x[2], x[3], x[4], Self::crackle(x))
    }
}
