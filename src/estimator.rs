//! Floor 3. An observer in use on line: law, memory, clock, the longest step, and what went wrong.
//!
//! An [`Observer`] is a formula and trusts its caller. An [`Estimator`] is what runs in an
//! interrupt: it takes what comes (a lost sample, a late timer, a clock that ran backwards),
//! never uses it silently, and counts it.

use crate::Scalar;
use crate::error::{DesignError, positive};
use crate::memory::Memory;
use crate::observer::{Causal, Observer, Status, Timing, absent};

/// A memory within this magnitude has not diverged.
const SOUND: f64 = 1e12;

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

/// Time since a start, of steps that need not be alike.
///
/// Steps of one length are counted, so that k of them end at k·dt: a sum in `f32` would stand still
/// after some hours. Where the length changes, what was counted is added to a sum of two numbers, which
/// keeps what a rounding of the first one drops.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Clock<T> {
    /// Steps of the last length, and that length in s.
    steps: u32,
    dt: T,
    /// Time before them in s, and what its rounding dropped.
    before: T,
    dropped: T,
}

impl<T: Scalar> Clock<T> {
    /// At time 0.
    pub fn new() -> Self {
        Self { steps: 0, dt: T::ZERO, before: T::ZERO, dropped: T::ZERO }
    }

    /// What it holds, to be kept and given to [`Clock::from_parts`]: steps and their length; the time
    /// before them, and what its rounding dropped.
    pub fn parts(&self) -> (u32, [T; 3]) {
        (self.steps, [self.dt, self.before, self.dropped])
    }

    /// The clock that gave these parts.
    pub fn from_parts((steps, [dt, before, dropped]): (u32, [T; 3])) -> Self {
        Self { steps, dt, before, dropped }
    }

    /// Time since the start in s.
    #[inline(always)]
    pub fn time(&self) -> T {
        let counted = T::from_u64(u64::from(self.steps)) * self.dt;
        self.before + (self.dropped + counted)
    }

    /// A step of length `dt` has passed.
    #[inline(always)]
    #[allow(clippy::float_cmp)]
    pub fn pass(&mut self, dt: T) {
        if dt == self.dt && self.steps < u32::MAX {
            self.steps += 1;
        } else {
            self.add(dt);
        }
    }

    /// The steps counted so far go into the sum (Knuth's exact addition); counting begins anew.
    fn add(&mut self, dt: T) {
        let (a, b) = (self.before, T::from_u64(u64::from(self.steps)) * self.dt + self.dropped);
        let sum = a + b;
        let rounded = sum - a;
        self.dropped = (a - (sum - rounded)) + (b - rounded);
        (self.before, self.steps, self.dt) = (sum, 1, dt);
    }
}

impl<T: Scalar> Default for Clock<T> {
    fn default() -> Self {
        Self::new()
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
    moving: Moving<T, O::State>,
}

/// What of an estimator moves, and the limit.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct Moving<T, Z> {
    z: Z,
    clock: Clock<T>,
    dt_max: T,
    counts: Counts,
    /// Whether a sample was offered since the start.
    started: bool,
    /// Whether the time since the last sample used is within the limit.
    stable: bool,
}

crate::error::through_constructor! {
    [T: Scalar, O: Observer<T>]
    Estimator<T, O>: estimator => {
        observer: O = estimator.observer,
        z: O::State = estimator.moving.z,
        clock: Clock<T> = estimator.moving.clock,
        dt_max: T = estimator.moving.dt_max,
        counts: Counts = estimator.moving.counts,
        started: bool = estimator.moving.started,
        stable: bool = estimator.moving.stable,
    }
    => crate::error::require("t", clock.time(), clock.time() >= T::ZERO, "it must be >= 0")
        .and_then(|_| positive("dt_max", dt_max))
        .map(|dt_max| Self { observer, moving: Moving { z, clock, dt_max, counts, started, stable } })
}

impl<T: Scalar, O: Observer<T>> Estimator<T, O> {
    /// From an observer and the longest step in s that it may take: its stability limit
    /// ([`crate::polynomial::euler_limit`], with current timing
    /// [`crate::polynomial::euler_current_limit`]; in Python `observer.step_limit().dt`) or less. For a
    /// gain that moves the limit is that at r = 1; at r it is `dt_max`/r.
    ///
    /// # Errors
    /// `dt_max` not finite or ≤ 0.
    pub fn new(observer: O, dt_max: T) -> Result<Self, DesignError> {
        let (dt_max, z) = (positive("dt_max", dt_max)?, observer.initial());
        let (clock, counts) = (Clock::new(), Counts::default());
        let moving = Moving { z, clock, dt_max, counts, started: false, stable: true };
        Ok(Self { observer, moving })
    }

    /// One call a sample y.
    ///
    /// With predictor timing u is the input from this sample on and `dt` the time to the next one, in s.
    /// With current timing both belong to the period that has just ended; the first call only corrects.
    ///
    /// A step beyond the limit would amplify the error: the observer predicts over it as over a
    /// missing sample. A `dt` that is no length of time changes nothing but the counts.
    #[inline]
    pub fn step(&mut self, y: &O::Measurement, u: &O::Input, dt: T) -> Status {
        self.moving.step(&self.observer, y, u, dt)
    }

    /// The same by another observer of the same memory, as the papers' recursion of a law whose causal
    /// form this is.
    #[inline]
    pub fn step_by<P>(&mut self, other: &P, y: &P::Measurement, u: &P::Input, dt: T) -> Status
    where
        P: Observer<T, State = O::State>,
    {
        self.moving.step(other, y, u, dt)
    }

    /// The observer.
    pub fn observer(&self) -> &O {
        &self.observer
    }

    /// The estimate.
    #[inline]
    pub fn estimate(&self) -> &[T] {
        self.observer.estimate(&self.moving.z)
    }

    /// The memory.
    pub fn memory(&self) -> &O::State {
        &self.moving.z
    }

    /// Start again from a memory of the caller's, at time 0; the counts go on.
    pub fn restart(&mut self, z: O::State) {
        let Moving { dt_max, counts, .. } = self.moving;
        let clock = Clock::new();
        self.moving = Moving { z, clock, dt_max, counts, started: false, stable: true };
    }

    /// Time since the start in s.
    pub fn time(&self) -> T {
        self.moving.clock.time()
    }

    /// What the steps ended in so far.
    pub fn counts(&self) -> Counts {
        self.moving.counts
    }
}

impl<T: Scalar, O: Causal<T>> Estimator<T, O> {
    /// Use the present sample y; the estimate is then x̂(k|k). The correction covers the time since the
    /// last sample used; over an interval of length 0, as at the start, nothing changes.
    #[inline]
    pub fn correct(&mut self, y: &O::Measurement) -> Status {
        let status = self.moving.corrected(&self.observer, y);
        self.moving.counts.add(status);
        status
    }

    /// Predict over the coming period of length `dt` [s] under the input u applied in it. Only failures
    /// are counted; the status of a sample is counted by [`Estimator::correct`].
    #[inline]
    pub fn predict(&mut self, u: &O::Input, dt: T) -> Status {
        let status = self.moving.moved(&self.observer, &absent(), u, dt);
        if !matches!(status, Status::Predicted | Status::StepTooLong) {
            self.moving.counts.add(status);
        }
        status
    }
}

impl<T: Scalar, Z: Memory<T>> Moving<T, Z> {
    /// One call a sample.
    #[inline(always)]
    fn step<O>(&mut self, observer: &O, y: &O::Measurement, u: &O::Input, dt: T) -> Status
    where
        O: Observer<T, State = Z>,
    {
        let status = match O::TIMING {
            Timing::Predictor => self.moved(observer, y, u, dt),
            Timing::Current => {
                let moved = if self.started {
                    self.moved(observer, &absent(), u, dt)
                } else {
                    Status::Predicted
                };
                match moved {
                    Status::Predicted | Status::StepTooLong => self.corrected(observer, y),
                    refused => refused,
                }
            }
        };
        self.counts.add(status);
        status
    }

    /// The memory moves over the period dt that begins, by a sample y of its beginning.
    #[inline(always)]
    fn moved<O>(&mut self, observer: &O, y: &O::Measurement, u: &O::Input, dt: T) -> Status
    where
        O: Observer<T, State = Z>,
    {
        let before = self.z;
        let stable = dt * observer.speed(&before) <= self.dt_max;
        // what is within the limit is finite
        if !(dt > T::ZERO && (stable || dt.is_finite())) {
            return Status::StepRefused;
        }
        self.stable = stable;
        let sample = if stable { *y } else { absent() };
        let taken = observer.advance(&mut self.z, &sample, u, self.clock.time(), dt);
        self.clock.pass(dt);
        match self.judged(&before, taken) {
            Status::ModelUndefined => {
                self.z = observer.held(&before, dt);
                Status::ModelUndefined
            }
            Status::Diverged => Status::Diverged,
            taken if stable => taken,
            _ => Status::StepTooLong,
        }
    }

    /// The memory takes a sample, with current timing.
    #[inline(always)]
    fn corrected<O>(&mut self, observer: &O, y: &O::Measurement) -> Status
    where
        O: Observer<T, State = Z>,
    {
        let before = self.z;
        self.started = true;
        let sample = if self.stable { *y } else { absent() };
        let taken = observer.correct(&mut self.z, &sample, self.clock.time());
        match self.judged(&before, taken) {
            Status::ModelUndefined => {
                self.z = before;
                Status::ModelUndefined
            }
            Status::Diverged => Status::Diverged,
            taken if self.stable => taken,
            _ => Status::StepTooLong,
        }
    }

    /// What a move from `before` ended in: a memory that was sound and is not finite now shows a model
    /// without a value; one that had grown beyond all bounds has diverged.
    #[inline(always)]
    fn judged(&self, before: &Z, taken: Status) -> Status {
        let mut finite = true;
        self.z.visit(&mut |z| finite &= z.is_finite());
        if finite {
            taken
        } else if before.within(T::from_f64(SOUND)) {
            Status::ModelUndefined
        } else {
            Status::Diverged
        }
    }
}
