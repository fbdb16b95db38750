//! Floor 1. Schedules: when time advances.

use crate::Scalar;
use crate::error::{DesignError, positive};

/// A sequence of step lengths.
pub trait Schedule<T: Scalar>: Copy {
    /// Length of the step from sample k to k + 1, in s.
    fn dt(&self, k: u64) -> T;
    /// Time of sample k + 1, given that of sample k and the step between them, in s.
    fn next_time(&self, t: T, k: u64, dt: T) -> T;
}

/// A fixed sampling period T.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FixedStep<T> {
    dt: T,
}

crate::error::through_constructor! {
    [T: Scalar] FixedStep<T>: step => { dt: T = step.dt }
    => Self::new(dt)
}

impl<T: Scalar> FixedStep<T> {
    /// Period in s.
    ///
    /// # Errors
    /// dt not finite or ≤ 0.
    pub fn new(dt: T) -> Result<Self, DesignError> {
        Ok(Self { dt: positive("dt", dt)? })
    }
}

impl<T: Scalar> Schedule<T> for FixedStep<T> {
    #[inline(always)]
    fn dt(&self, _: u64) -> T {
        self.dt
    }
    /// (k + 1)·T: no rounding is carried on.
    #[inline(always)]
    fn next_time(&self, _: T, k: u64, _: T) -> T {
        T::from_u64(k + 1) * self.dt
    }
}

/// Stochastic approximation, Lee, Choi and Khalil (21): a(k) = α ε b(k), b(k) = (1 + k/k₀)^{−p}.
///
/// The steps decrease, so that measurement noise averages out. Condition (A.2) of the paper,
/// Σ a = ∞ and Σ a² < ∞, holds exactly for ½ < p ≤ 1; for p > 1 the clock stops at a finite time.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StochasticApproximation<T> {
    alpha: T,
    epsilon: T,
    k0: T,
    p: T,
}

crate::error::through_constructor! {
    [T: Scalar]
    StochasticApproximation<T>: a => {
        alpha: T = a.alpha,
        epsilon: T = a.epsilon,
        k0: T = a.k0,
        p: T = a.p,
    }
    => Self::new(alpha, epsilon, k0, p)
}

impl<T: Scalar> StochasticApproximation<T> {
    /// α > 0, ε > 0 in s, k₀ > 0 in steps, p > 0.
    ///
    /// # Errors
    /// A parameter that is not finite or ≤ 0.
    pub fn new(alpha: T, epsilon: T, k0: T, p: T) -> Result<Self, DesignError> {
        Ok(Self {
            alpha: positive("alpha", alpha)?,
            epsilon: positive("epsilon", epsilon)?,
            k0: positive("k0", k0)?,
            p: positive("p", p)?,
        })
    }

    /// b(k).
    #[inline(always)]
    #[allow(clippy::float_cmp)]
    pub fn b(&self, k: u64) -> T {
        let base = T::ONE + T::from_u64(k) / self.k0;
        if self.p == T::ONE { T::ONE / base } else { base.powf(-self.p) }
    }
}

impl<T: Scalar> Schedule<T> for StochasticApproximation<T> {
    #[inline(always)]
    fn dt(&self, k: u64) -> T {
        self.alpha * self.epsilon * self.b(k) // (21)
    }
    #[inline(always)]
    fn next_time(&self, t: T, _: u64, dt: T) -> T {
        t + dt
    }
}
