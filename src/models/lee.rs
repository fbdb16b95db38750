//! The plant of Lee, Choi and Khalil (38): ẋ₁ = x₂, ẋ₂ = −x₁/(1 + x₁²) − x₂, y = x₁.

use crate::Scalar;
use crate::model::{Model, PhaseVariable, Plant, last};
use nalgebra::{SVector, Vector2};

/// Plant (38).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Lee;

impl<T: Scalar> PhaseVariable<T, 2> for Lee {
    #[inline(always)]
    fn phi(&self, _: T, x: &Vector2<T>, _: &SVector<T, 0>) -> T {
        -x.x / (T::ONE + x.x * x.x) - x.y
    }
}

impl<T: Scalar> Model<T, 2> for Lee {
    #[inline(always)]
    fn f_hat(&self, t: T, x: &Vector2<T>, u: &SVector<T, 0>) -> Vector2<T> {
        last(self.phi(t, x, u))
    }
}

impl<T: Scalar> Plant<T> for Lee {
    first_state_measured!(2);
    #[inline(always)]
    fn drift(&self, t: T, x: &Vector2<T>, u: &SVector<T, 0>) -> Vector2<T> {
        Vector2::new(x.y, self.phi(t, x, u))
    }
}
