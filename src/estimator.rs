//! Floor 3. An observer in use on line: law, memory, clock, the longest step, and what went wrong.
//!
//! An [`Observer`] is a formula and trusts its caller. An [`Estimator`] is what runs in an
//! interrupt: it takes what comes (a lost sample, a late timer, a clock that ran backwards),
//! never uses it silently, and counts it.

use crate::Scalar;
use crate::error::{DesignError, positive};
use crate::memory::Memory;
use crate::observer::{Measurement, Observer, Status};

/// How many steps ended in which [`Status`]; the counts stop at `u32::MAX`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Counts {
    /// Samples that were used.
    pub updated: u32,
    /// Missing samples (NaN or infinite) that were predicted over.
    pub predicted: u32,
    /// Samples at which the model has no value.
    pub model_undefined: u32,
    /// Steps beyond the limit, predicted over.
    pub step_too_long: u32,
    /// Steps that are no lengths of time (NaN, infinite, zero, negative) and were not taken.
    pub step_refused: u32,
    /// Steps after which the memory was not finite.
    pub diverged: u32,
}

impl Counts {
    fn add(&mut self, status: Status) {
        let count = match status {
            Status::Updated => &mut self.updated,
            Status::Predicted => &mut self.predicted,
            Status::ModelUndefined => &mut self.model_undefined,
            Status::StepTooLong => &mut self.step_too_long,
            Status::StepRefused => &mut self.step_refused,
            Status::Diverged => &mut self.diverged,
        };
        *count = count.saturating_add(1);
    }
}

/// An observer with its memory and clock.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Estimator<T, O: Observer<T>>
where
    T: Scalar,
{
    observer: O,
    z: O::State,
    t: T,
    dt_max: T,
    counts: Counts,
}

crate::error::through_constructor! {
    [T: Scalar, O: Observer<T>]
    Estimator<T, O>: estimator => {
        observer: O = estimator.observer,
        z: O::State = estimator.z,
        t: T = estimator.t,
        dt_max: T = estimator.dt_max,
        counts: Counts = estimator.counts,
    }
    => crate::error::require("t", t, t >= T::ZERO, "it must be >= 0")
        .and_then(|t| Ok(Self { z, t, counts, ..Self::new(observer, dt_max)? }))
}

impl<T: Scalar, O: Observer<T>> Estimator<T, O> {
    /// From an observer and the longest step in s that it may take: its stability limit
    /// ([`crate::polynomial::euler_limit`]; in Python `observer.step_limit().dt`) or less. For a
    /// gain that moves the limit is that at r = 1; at r it is `dt_max`/r.
    ///
    /// # Errors
    /// `dt_max` not finite or ≤ 0.
    pub fn new(observer: O, dt_max: T) -> Result<Self, DesignError> {
        let dt_max = positive("dt_max", dt_max)?;
        Ok(Self { observer, z: observer.initial(), t: T::ZERO, dt_max, counts: Counts::default() })
    }

    /// Take the sample y and the input u; advance by `dt` in s.
    ///
    /// A step beyond the limit would amplify the error: the observer predicts over it as over a
    /// missing sample. A `dt` that is no length of time changes nothing but the counts.
    #[inline]
    pub fn step(&mut self, y: &O::Measurement, u: &O::Input, dt: T) -> Status {
        let status = if dt > T::ZERO && dt.is_finite() {
            let stable = dt * self.observer.speed(&self.z) <= self.dt_max;
            let missing = O::Measurement::fill(|| T::from_f64(f64::NAN));
            let sample = if stable { y } else { &missing };
            let taken = self.observer.step(&mut self.z, sample, u, self.t, dt);
            self.t += dt;
            let mut finite = true;
            self.z.visit(&mut |z| finite &= z.is_finite());
            match (finite, stable) {
                (false, _) => Status::Diverged,
                (true, false) => Status::StepTooLong,
                (true, true) => taken,
            }
        } else {
            Status::StepRefused
        };
        self.counts.add(status);
        status
    }

    /// The estimate.
    #[inline]
    pub fn estimate(&self) -> &[T] {
        self.observer.estimate(&self.z)
    }

    /// The memory.
    pub fn memory(&self) -> &O::State {
        &self.z
    }

    /// Start again from a memory of the caller's, at time 0; the counts go on.
    pub fn restart(&mut self, z: O::State) {
        (self.z, self.t) = (z, T::ZERO);
    }

    /// Time since the start in s.
    pub fn time(&self) -> T {
        self.t
    }

    /// What the steps ended in so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }
}
