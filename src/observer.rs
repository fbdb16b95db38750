//! Floor 1. What an observer is: a fixed law (`&self`) and the memory that it moves (`&mut`).
//!
//! A *continuous* law gives a rate and is discretised by a [`Discretisation`], or integrated
//! together with the plant. A *sampled* law gives its own recursion. Both end as an [`Observer`].

use crate::Scalar;
use crate::integrate::{Integrator, RightHandSide};
pub use crate::measurement::Measurement;
use crate::memory::Memory;

/// Whether the estimate at sample k uses the sample y(k) itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Timing {
    /// The estimate at k uses samples up to k − 1 (the papers' recursions).
    Predictor,
    /// The estimate at k uses samples up to k.
    Current,
}

impl Timing {
    /// How many entries a memory has beside its law's: see [`Current`].
    pub const fn held(self) -> usize {
        match self {
            Self::Predictor => 0,
            Self::Current => 1,
        }
    }
}

/// What one step made of its sample. The last three come from an [`crate::Estimator`] only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Status {
    /// The sample was used.
    Updated = 0,
    /// The sample was missing (NaN or infinite): the law predicted over it.
    Predicted = 1,
    /// The model has no value at this sample; the estimate was held.
    ModelUndefined = 2,
    /// The step was longer than the stability limit: the law predicted over it.
    StepTooLong = 3,
    /// The step was no length of time and was not taken.
    StepRefused = 4,
    /// The memory is not finite any more.
    Diverged = 5,
}

impl Status {
    /// Of a sample that a law takes.
    #[inline(always)]
    pub fn of<T: Scalar>(y: &impl Measurement<T>) -> Self {
        if y.is_present() { Self::Updated } else { Self::Predicted }
    }
}

/// A law in continuous time: ẑ = rate(t, z, e, u), e the innovation.
pub trait ContinuousLaw<T: Scalar>: Copy {
    /// Memory z.
    type State: Memory<T>;
    /// Known input u.
    type Input: Copy;
    /// Innovation(s): one scalar, or one for each copy of a collection.
    type Innovation: Copy;
    /// How many states are estimated: the first entries of the memory.
    const ESTIMATED: usize;
    /// Memory at x̂ = 0 (and r = 1 where the gain moves).
    fn initial(&self) -> Self::State;
    /// e = y − x̂₁; 0 where y is missing.
    fn innovation(&self, z: &Self::State, y: T) -> Self::Innovation;
    /// ż.
    fn rate(&self, t: T, z: &Self::State, e: &Self::Innovation, u: &Self::Input) -> Self::State;
    /// What of the rate is due to the innovation: the rate less that of a missing sample.
    fn injection(&self, z: &Self::State, e: &Self::Innovation) -> Self::State;
    /// What of the rate is neither the chain's own nor known of the system: see
    /// [`crate::injection::Proper`].
    #[inline(always)]
    fn kick(&self, z: &Self::State, e: &Self::Innovation) -> Self::State {
        self.injection(z, e)
    }
    /// Turn a forward Euler step `new` from `old` into a staggered one, in which every state is
    /// moved by the new value of the state above it in the chain.
    fn stagger(&self, old: &Self::State, new: Self::State, dt: T) -> Self::State;
    /// The memory at a sample of the innovation `e`, before its step: what of it moves at once.
    #[inline(always)]
    fn jumped(&self, z: Self::State, _e: &Self::Innovation) -> Self::State {
        z
    }
    /// The memory brought back into the set that the law lives in.
    #[inline(always)]
    fn admissible(&self, z: Self::State) -> Self::State {
        z
    }
    /// By how much a gain that moves has shortened the stability limit: r, or 1.
    fn speed(&self, z: &Self::State) -> T;
    /// x̂.
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [T];
}

/// An observer in discrete time, as it is used on line.
///
/// A loop over samples y(k) at the times t(k) is the same for both timings:
///
/// ```text
/// correct(y(k), t(k))                    the estimate is shown, an input u(k) computed from it
/// advance(y(k), u(k), t(k), dt(k))       to t(k + 1) = t(k) + dt(k)
/// ```
///
/// With current timing `correct` takes the sample and `advance` predicts; with predictor timing
/// `correct` does nothing and `advance` is the papers' recursion. [`step`](Observer::step) is one call
/// a sample: with current timing it begins with the period that is over.
pub trait Observer<T: Scalar>: Copy {
    /// Memory.
    type State: Memory<T>;
    /// Sample y.
    type Measurement: Measurement<T>;
    /// Known input u.
    type Input: Copy;
    /// Whether the estimate at sample k uses y(k).
    const TIMING: Timing;
    /// How many states are estimated: the first entries of the memory.
    const ESTIMATED: usize;
    /// Memory to start from when nothing is known.
    fn initial(&self) -> Self::State;
    /// Take the sample y at time t, for the time that has passed since the last sample used.
    ///
    /// With current timing the estimate is then x̂(k|k). A correction for no time, as the first one at
    /// the start, changes no estimate. With predictor timing nothing moves: [`Observer::advance`]
    /// takes the sample.
    #[inline(always)]
    fn correct(&self, _z: &mut Self::State, y: &Self::Measurement, _t: T) -> Status {
        Status::of(y)
    }
    /// Move over the period `dt` that begins at time t, under the input u that is held over it. With
    /// predictor timing the sample y of its beginning is used; with current timing it was already.
    fn advance(
        &self,
        z: &mut Self::State,
        y: &Self::Measurement,
        u: &Self::Input,
        t: T,
        dt: T,
    ) -> Status;
    /// Move over the period `dt` that begins at time t without a sample.
    #[inline(always)]
    fn predict(&self, z: &mut Self::State, u: &Self::Input, t: T, dt: T) -> Status {
        self.advance(z, &absent(), u, t, dt)
    }
    /// One call a sample, from time t over `dt`.
    ///
    /// With predictor timing y is the sample at t, u the input from t on, and `dt` the time until the
    /// next sample. With current timing y is the sample at t + dt, u the input over the period that has
    /// just ended, and `dt` its length: predict, then correct.
    #[inline(always)]
    fn step(
        &self,
        z: &mut Self::State,
        y: &Self::Measurement,
        u: &Self::Input,
        t: T,
        dt: T,
    ) -> Status {
        match Self::TIMING {
            Timing::Predictor => self.advance(z, y, u, t, dt),
            Timing::Current => match self.predict(z, u, t, dt) {
                Status::ModelUndefined => Status::ModelUndefined,
                _ => self.correct(z, y, t + dt),
            },
        }
    }
    /// The memory after a period over which the model had no value: the estimate is held, and the time
    /// of the next correction counts.
    #[inline(always)]
    fn held(&self, z: &Self::State, _dt: T) -> Self::State {
        *z
    }
    /// By how much a gain that moves has shortened the stability limit: r, or 1.
    #[inline(always)]
    fn speed(&self, _: &Self::State) -> T {
        T::ONE
    }
    /// The estimate.
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [T];
    /// What the sample y at time t tells beyond what the memory before its use predicts for it under the
    /// input u: y − ŷ, written entry by entry.
    fn innovation(
        &self,
        t: T,
        z: &Self::State,
        y: &Self::Measurement,
        u: &Self::Input,
    ) -> Self::Measurement;
    /// The same observer with all computed that steps of length `dt` need again and again.
    #[inline(always)]
    #[must_use]
    fn prepared(&self, _dt: T) -> Self {
        *self
    }
}

/// An observer with current timing, whose two halves a control loop calls apart.
pub trait Causal<T: Scalar>: Observer<T> {}

/// What is frozen over a step of a Runge-Kutta scheme.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Hold {
    /// The sample y: the innovation is formed anew at every stage.
    Measurement,
    /// The innovation y − x̂₁ of the step's beginning.
    Innovation,
}

/// A sample that is missing.
#[inline(always)]
pub fn absent<T: Scalar, Y: Measurement<T>>() -> Y {
    Y::fill(|| T::from_f64(f64::NAN))
}

/// How a continuous law becomes a recursion.
///
/// With predictor timing z⁻(k+1) = `advance`(z⁻(k), y(k)). With current timing the step is cut in two:
/// z⁻(k) = `predict`(z⁺(k−1)) over the past period, then z⁺(k) = `correct`(z⁻(k), y(k)).
pub trait Scheme<T: Scalar, L: ContinuousLaw<T>>: Copy {
    /// True if `correct` covers all the time since the last sample, because it is stable for any time:
    /// a sample after a gap, or of a slow sensor, then counts in full. False if it covers the last
    /// period alone.
    const OVER_GAPS: bool = false;
    /// Memory after a step of length dt from (t, z) with sample y and input u.
    fn advance(&self, law: &L, t: T, z: &L::State, y: T, u: &L::Input, dt: T) -> L::State;
    /// Memory after a step of length dt from (t, z) without a sample.
    #[inline(always)]
    fn predict(&self, law: &L, t: T, z: &L::State, u: &L::Input, dt: T) -> L::State {
        self.advance(law, t, z, absent(), u, dt)
    }
    /// Memory after the use of sample y that ends a time dt: what the sample injects in that time, by
    /// forward Euler.
    #[inline(always)]
    fn correct(&self, law: &L, z: &L::State, y: T, dt: T) -> L::State {
        z.plus(dt, &law.injection(z, &law.innovation(z, y)))
    }
    /// The same scheme with all computed that steps of length `dt` need again and again.
    #[inline(always)]
    #[must_use]
    fn prepared(&self, _law: &L, _dt: T) -> Self {
        *self
    }
}

/// Forward Euler: z⁺ = z + dt·ż.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Euler;

impl<T: Scalar, L: ContinuousLaw<T>> Scheme<T, L> for Euler {
    #[inline(always)]
    fn advance(&self, law: &L, t: T, z: &L::State, y: T, u: &L::Input, dt: T) -> L::State {
        z.plus(dt, &law.rate(t, z, &law.innovation(z, y), u))
    }
}

/// Staggered (semi-implicit) Euler: the chain is swept from the last state to the first, each
/// one moved by the new value of the next. It keeps the damping that forward Euler loses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StaggeredEuler;

impl<T: Scalar, L: ContinuousLaw<T>> Scheme<T, L> for StaggeredEuler {
    #[inline(always)]
    fn advance(&self, law: &L, t: T, z: &L::State, y: T, u: &L::Input, dt: T) -> L::State {
        law.stagger(z, Euler.advance(law, t, z, y, u, dt), dt)
    }
}

/// A Runge-Kutta scheme with the measurement or the innovation held over the step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RungeKutta {
    /// Which scheme.
    pub integrator: Integrator,
    /// What is frozen over the step.
    pub hold: Hold,
}

impl<T: Scalar, L: ContinuousLaw<T>> Scheme<T, L> for RungeKutta {
    #[inline(always)]
    fn advance(&self, law: &L, t: T, z: &L::State, y: T, u: &L::Input, dt: T) -> L::State {
        match self.hold {
            Hold::Measurement => self.integrator.step(Measured { law, y, u }, t, z, dt),
            Hold::Innovation => {
                let e = &law.innovation(z, y);
                self.integrator.step(Innovated { law, e, u }, t, z, dt)
            }
        }
    }
}

/// A law under a measurement that is held.
struct Measured<'a, T, L, U> {
    law: &'a L,
    y: T,
    u: &'a U,
}

impl<T: Scalar, L: ContinuousLaw<T>> RightHandSide<T, L::State> for Measured<'_, T, L, L::Input> {
    #[inline(always)]
    fn at(&self, t: T, z: &L::State) -> L::State {
        self.law.rate(t, z, &self.law.innovation(z, self.y), self.u)
    }
}

/// A law under an innovation that is held.
struct Innovated<'a, L, E, U> {
    law: &'a L,
    e: &'a E,
    u: &'a U,
}

impl<T: Scalar, L: ContinuousLaw<T>> RightHandSide<T, L::State>
    for Innovated<'_, L, L::Innovation, L::Input>
{
    #[inline(always)]
    fn at(&self, t: T, z: &L::State) -> L::State {
        self.law.rate(t, z, self.e, self.u)
    }
}

/// A choice among the schemes at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Discretisation {
    /// [`Euler`].
    Euler,
    /// [`StaggeredEuler`].
    StaggeredEuler,
    /// [`RungeKutta`].
    RungeKutta(RungeKutta),
}

impl<T: Scalar, L: ContinuousLaw<T>> Scheme<T, L> for Discretisation {
    #[inline(always)]
    fn advance(&self, law: &L, t: T, z: &L::State, y: T, u: &L::Input, dt: T) -> L::State {
        match self {
            Self::Euler => Euler.advance(law, t, z, y, u, dt),
            Self::StaggeredEuler => StaggeredEuler.advance(law, t, z, y, u, dt),
            Self::RungeKutta(scheme) => scheme.advance(law, t, z, y, u, dt),
        }
    }
}

macro_rules! fixed_runge_kutta {
    ($($(#[$doc:meta])* $name:ident = $integrator:ident, $hold:ident;)+) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        #[cfg_attr(feature = "defmt", derive(defmt::Format))]
        pub struct $name;

        impl $name {
            /// The same scheme as a choice at run time.
            pub const CHOICE: RungeKutta =
                RungeKutta { integrator: Integrator::$integrator, hold: Hold::$hold };
        }

        impl<T: Scalar, L: ContinuousLaw<T>> Scheme<T, L> for $name {
            #[inline(always)]
            fn advance(&self, law: &L, t: T, z: &L::State, y: T, u: &L::Input, dt: T) -> L::State {
                const { Self::CHOICE }.advance(law, t, z, y, u, dt)
            }
        }
    )+};
}

// Schemes that are fixed in their type: a loop over many runs then has no choice left in it.
fixed_runge_kutta! {
    /// The classical Runge-Kutta scheme, the sample held over the step.
    Rk4 = Rk4, Measurement;
    /// The same, the innovation of the step's beginning held.
    Rk4InnovationHeld = Rk4, Innovation;
    /// Bogacki and Shampine's third-order scheme, the sample held over the step.
    BogackiShampine = BogackiShampine, Measurement;
}

/// A continuous law under a discretisation: an observer with predictor timing.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Discretised<L, S> {
    /// The law.
    pub law: L,
    /// The scheme.
    pub scheme: S,
}

impl<T, L, S> Observer<T> for Discretised<L, S>
where
    T: Scalar,
    L: ContinuousLaw<T>,
    S: Scheme<T, L>,
{
    type State = L::State;
    type Measurement = T;
    type Input = L::Input;
    const TIMING: Timing = Timing::Predictor;
    const ESTIMATED: usize = L::ESTIMATED;

    #[inline(always)]
    fn initial(&self) -> L::State {
        self.law.initial()
    }

    #[inline(always)]
    fn advance(&self, z: &mut L::State, y: &T, u: &L::Input, t: T, dt: T) -> Status {
        let (law, scheme) = (&self.law, &self.scheme);
        let begin = law.jumped(*z, &law.innovation(z, *y));
        let next = law.admissible(scheme.advance(law, t, &begin, *y, u, dt));
        *z = z.zip(&next, |_, new| new);
        Status::of(y)
    }

    #[inline(always)]
    fn speed(&self, z: &L::State) -> T {
        self.law.speed(z)
    }

    #[inline(always)]
    fn estimate<'a>(&self, z: &'a L::State) -> &'a [T] {
        self.law.estimate(z)
    }

    #[inline(always)]
    fn innovation(&self, _: T, z: &L::State, y: &T, _: &L::Input) -> T {
        beyond_first(self.estimate(z), *y)
    }

    #[inline(always)]
    fn prepared(&self, dt: T) -> Self {
        Self { law: self.law, scheme: self.scheme.prepared(&self.law, dt) }
    }
}

/// y − x̂₁.
#[inline(always)]
fn beyond_first<T: Scalar>(x_hat: &[T], y: T) -> T {
    match x_hat.first() {
        Some(x1) => y - *x1,
        None => y,
    }
}

crate::memory_struct! {
    /// Memory of an observer with current timing.
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    pub struct CurrentState<T, Z: Memory> {
        /// The law's own memory.
        pub law: Z,
        /// The time that the next correction is for, in s.
        pub elapsed: T,
    }
}

/// A continuous law under a discretisation: an observer with current timing.
///
/// Its memory holds the time that the next correction is for. `advance` predicts and adds to that
/// time (where the scheme corrects [over gaps](Scheme::OVER_GAPS)) or sets it; `correct` uses it up.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Current<L, S> {
    /// The law.
    pub law: L,
    /// The scheme.
    pub scheme: S,
}

impl<L, S> Current<L, S> {
    /// The time that a correction after a period is for.
    #[inline(always)]
    fn elapsed<T: Scalar>(elapsed: T, dt: T) -> T
    where
        L: ContinuousLaw<T>,
        S: Scheme<T, L>,
    {
        if S::OVER_GAPS { elapsed + dt } else { dt }
    }
}

impl<T, L, S> Observer<T> for Current<L, S>
where
    T: Scalar,
    L: ContinuousLaw<T>,
    S: Scheme<T, L>,
{
    type State = CurrentState<T, L::State>;
    type Measurement = T;
    type Input = L::Input;
    const TIMING: Timing = Timing::Current;
    const ESTIMATED: usize = L::ESTIMATED;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        CurrentState { law: self.law.initial(), elapsed: T::ZERO }
    }

    #[inline(always)]
    fn correct(&self, z: &mut Self::State, y: &T, _: T) -> Status {
        let Self { law, scheme } = self;
        let left = z.elapsed.while_missing(*y);
        // the time of this correction: none for a missing sample, which changes nothing
        let begin = law.jumped(z.law, &law.innovation(&z.law, *y));
        let next = law.admissible(scheme.correct(law, &begin, *y, z.elapsed - left));
        *z = CurrentState { law: z.law.zip(&next, |_, new| new), elapsed: left };
        Status::of(y)
    }

    #[inline(always)]
    fn advance(&self, z: &mut Self::State, _: &T, u: &L::Input, t: T, dt: T) -> Status {
        let Self { law, scheme } = self;
        let next = law.admissible(scheme.predict(law, t, &z.law, u, dt));
        let elapsed = Self::elapsed(z.elapsed, dt);
        *z = CurrentState { law: z.law.zip(&next, |_, new| new), elapsed };
        Status::Predicted
    }

    #[inline(always)]
    fn held(&self, z: &Self::State, dt: T) -> Self::State {
        CurrentState { law: z.law, elapsed: Self::elapsed(z.elapsed, dt) }
    }

    #[inline(always)]
    fn speed(&self, z: &Self::State) -> T {
        self.law.speed(&z.law)
    }

    #[inline(always)]
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [T] {
        self.law.estimate(&z.law)
    }

    #[inline(always)]
    fn innovation(&self, _: T, z: &Self::State, y: &T, _: &L::Input) -> T {
        beyond_first(self.estimate(z), *y)
    }

    #[inline(always)]
    fn prepared(&self, dt: T) -> Self {
        Self { law: self.law, scheme: self.scheme.prepared(&self.law, dt) }
    }
}

impl<T, L, S> Causal<T> for Current<L, S>
where
    T: Scalar,
    L: ContinuousLaw<T>,
    S: Scheme<T, L>,
{
}
