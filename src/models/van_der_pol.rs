//! The stochastic Van der Pol oscillator of Fu, Kang and Li (18):
//!
//!   dx₁ = x₂ dt,   dx₂ = [−x₁ + ε(1 − x₁²)x₂] dt + g(x) dW,   y = x₁
//!
//! and the correction `K_T` of its sampled-data observer.

use crate::Scalar;
use crate::error::{DesignError, finite};
use crate::model::{Model, PhaseVariable, Plant, SampledModel, StochasticIntegrator, last};
use nalgebra::{SVector, Vector2};

/// Where the process noise enters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Diffusion {
    /// g = σ, as in the paper.
    Additive,
    /// g = σ x₂, for the study of strong orders.
    Multiplicative,
}

/// Which first correction gain l₁ the observer uses, with μ = ε(1 − y²).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Correction {
    /// l₁ = (5 + μ)T: the error matrix has the constant spectrum {−2, −3}.
    Derived,
    /// l₁ = (5 − μ)T, as the paper prints it.
    Printed,
}

/// Plant (18) and its observer's correction.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct VanDerPol<T> {
    epsilon: T,
    sigma: T,
    diffusion: Diffusion,
    correction: Correction,
}

crate::error::through_constructor! {
    [T: Scalar]
    VanDerPol<T>: plant => {
        epsilon: T = plant.epsilon,
        sigma: T = plant.sigma,
        diffusion: Diffusion = plant.diffusion,
        correction: Correction = plant.correction,
    }
    => Self::new(epsilon, sigma, diffusion, correction)
}

impl<T: Scalar> VanDerPol<T> {
    /// Damping ε, noise intensity σ.
    ///
    /// # Errors
    /// A parameter that is not finite.
    pub fn new(
        epsilon: T,
        sigma: T,
        diffusion: Diffusion,
        correction: Correction,
    ) -> Result<Self, DesignError> {
        let (epsilon, sigma) = (finite("epsilon", epsilon)?, finite("sigma", sigma)?);
        Ok(Self { epsilon, sigma, diffusion, correction })
    }
}

impl<T: Scalar, S: Scalar + From<T>> PhaseVariable<S, 2> for VanDerPol<T> {
    #[inline(always)]
    fn phi(&self, _: S, x: &Vector2<S>, _: &SVector<S, 0>) -> S {
        -x.x + S::from(self.epsilon) * (S::ONE - x.x * x.x) * x.y
    }
}

impl<T: Scalar, S: Scalar + From<T>> Model<S, 2> for VanDerPol<T> {
    #[inline(always)]
    fn f_hat(&self, t: S, x: &Vector2<S>, u: &SVector<S, 0>) -> Vector2<S> {
        last(self.phi(t, x, u))
    }
}

impl<T: Scalar> Plant<T> for VanDerPol<T> {
    first_state_measured!(2);
    #[inline(always)]
    fn drift(&self, t: T, x: &Vector2<T>, u: &SVector<T, 0>) -> Vector2<T> {
        Vector2::new(x.y, self.phi(t, x, u))
    }
    #[inline(always)]
    fn has_process_noise(&self) -> bool {
        self.sigma != T::ZERO
    }
    #[inline(always)]
    fn supports(&self, scheme: StochasticIntegrator) -> bool {
        scheme != StochasticIntegrator::Taylor15 || self.diffusion == Diffusion::Additive
    }
    #[inline(always)]
    fn diffusion(&self, _: T, x: &Vector2<T>, _: &SVector<T, 0>) -> Vector2<T> {
        let g = match self.diffusion {
            Diffusion::Additive => self.sigma,
            Diffusion::Multiplicative => self.sigma * x.y,
        };
        Vector2::new(T::ZERO, g)
    }
    #[inline(always)]
    fn diffusion_slope(&self, _: T, x: &Vector2<T>, _: &SVector<T, 0>) -> Vector2<T> {
        let slope = match self.diffusion {
            Diffusion::Additive => T::ZERO,
            Diffusion::Multiplicative => self.sigma * self.sigma * x.y,
        };
        Vector2::new(T::ZERO, slope)
    }
    #[inline(always)]
    fn jacobian_times(
        &self,
        _: T,
        x: &Vector2<T>,
        _: &SVector<T, 0>,
        v: &Vector2<T>,
    ) -> Vector2<T> {
        let two = T::from_f64(2.0);
        let by_x1 = -T::ONE - two * self.epsilon * x.x * x.y;
        let by_x2 = self.epsilon * (T::ONE - x.x * x.x);
        Vector2::new(v.y, by_x1 * v.x + by_x2 * v.y)
    }
    /// Zero: ∂²f₂/∂x₂² = 0 and the noise enters x₂ only.
    #[inline(always)]
    fn curvature(&self, _: T, _: &Vector2<T>, _: &SVector<T, 0>) -> Vector2<T> {
        Vector2::new(T::ZERO, T::ZERO)
    }
}

impl<T: Scalar> SampledModel<T, 2> for VanDerPol<T> {
    #[inline(always)]
    fn f(&self, t: T, x_hat: &Vector2<T>, u: &SVector<T, 0>) -> Vector2<T> {
        self.drift(t, x_hat, u)
    }
    #[inline(always)]
    fn correction(&self, _: T, x_hat: &Vector2<T>, _: &SVector<T, 0>, y: T, dt: T) -> Vector2<T> {
        let five = T::from_f64(5.0);
        let mu = self.epsilon * (T::ONE - y * y);
        let l1 = match self.correction {
            Correction::Derived => (five + mu) * dt,
            Correction::Printed => (five - mu) * dt,
        };
        let l2 = (five - self.epsilon * (x_hat.x + y) * x_hat.y + (five + mu) * mu) * dt;
        Vector2::new(l1, l2) * (y - x_hat.x)
    }
    #[inline(always)]
    fn output(&self, _: T, x_hat: &Vector2<T>, _: &SVector<T, 0>) -> T {
        x_hat.x
    }
}
