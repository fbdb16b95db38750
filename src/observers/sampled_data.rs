//! The sampled-data observer on an Euler-Maruyama model, Fu, Kang and Li (5):
//!
//!   x̂(k+1) = x̂(k) + T f(t(k), x̂(k), u(k)) + K_T(t(k), x̂(k), u(k), y(k))

use crate::Scalar;
use crate::model::SampledModel;
use crate::observer::{Observer, Status, Timing};
use nalgebra::SVector;

/// Sampled-data observer for any f and `K_T`; memory x̂.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SampledDataObserver<Md, const N: usize, const M: usize = 0> {
    /// f and `K_T`.
    pub model: Md,
}

impl<T: Scalar, Md: SampledModel<T, N, M>, const N: usize, const M: usize> Observer<T>
    for SampledDataObserver<Md, N, M>
{
    type State = SVector<T, N>;
    type Measurement = T;
    type Input = SVector<T, M>;
    const TIMING: Timing = Timing::Predictor;
    const ESTIMATED: usize = N;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        SVector::from_element(T::ZERO)
    }

    #[inline(always)]
    fn advance(&self, x_hat: &mut Self::State, y: &T, u: &Self::Input, t: T, dt: T) -> Status {
        let predicted = *x_hat + self.model.f(t, x_hat, u) * dt;
        if y.is_finite() {
            *x_hat = predicted + self.model.correction(t, x_hat, u, *y, dt); // (5)
            Status::Updated
        } else {
            *x_hat = predicted;
            Status::Predicted
        }
    }

    #[inline(always)]
    fn estimate<'a>(&self, x_hat: &'a Self::State) -> &'a [T] {
        x_hat.as_slice()
    }

    #[inline(always)]
    fn innovation(&self, t: T, x_hat: &Self::State, y: &T, u: &Self::Input) -> T {
        *y - self.model.output(t, x_hat, u)
    }
}
