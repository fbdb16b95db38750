//! Floor 1. What an observer is: a fixed law (`&self`) and the memory that it moves (`&mut`).
//!
//! A *continuous* law gives a rate and is discretised by a [`Discretisation`], or integrated
//! together with the plant. A *sampled* law gives its own recursion. Both end as an [`Observer`].

use crate::Scalar;
use crate::integrate::{Integrator, RightHandSide};
pub use crate::measurement::{Entries, Measurement};
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
    /// How many entries a memory has beside its law's, with that many inputs: see [`Current`].
    pub const fn held(self, inputs: usize) -> usize {
        match self {
            Self::Predictor => 0,
            Self::Current => 2 + inputs,
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
    #[inline(always)]
    fn injection(
        &self,
        t: T,
        z: &Self::State,
        e: &Self::Innovation,
        u: &Self::Input,
    ) -> Self::State {
        let free = self.rate(t, z, &self.innovation(z, missing()), u);
        self.rate(t, z, e, u).zip(&free, |rate, free| rate - free)
    }
    /// Turn a forward Euler step `new` from `old` into a staggered one, in which every state is
    /// moved by the new value of the state above it in the chain.
    fn stagger(&self, old: &Self::State, new: Self::State, dt: T) -> Self::State;
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
pub trait Observer<T: Scalar>: Copy {
    /// Memory.
    type State: Memory<T>;
    /// Sample y.
    type Measurement: Measurement<T>;
    /// Known input u.
    type Input: Copy;
    /// Whether `estimate` after a step with y(k) is meant for k or for k + 1.
    const TIMING: Timing;
    /// How many states are estimated: the first entries of the memory.
    const ESTIMATED: usize;
    /// Memory to start from when nothing is known.
    fn initial(&self) -> Self::State;
    /// Take the sample y and the input u at time t; advance by `dt`.
    fn step(
        &self,
        z: &mut Self::State,
        y: &Self::Measurement,
        u: &Self::Input,
        t: T,
        dt: T,
    ) -> Status;
    /// By how much a gain that moves has shortened the stability limit: r, or 1.
    #[inline(always)]
    fn speed(&self, _: &Self::State) -> T {
        T::ONE
    }
    /// The estimate.
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [T];
    /// What the sample y at time t tells beyond what the memory before the step predicts for it: y − ŷ,
    /// written entry by entry.
    fn innovation(&self, t: T, z: &Self::State, y: &Self::Measurement) -> Self::Measurement;
    /// The same observer with all computed that steps of length `dt` need again and again.
    #[inline(always)]
    #[must_use]
    fn prepared(&self, _dt: T) -> Self {
        *self
    }
}

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
fn missing<T: Scalar>() -> T {
    T::from_f64(f64::NAN)
}

/// How a continuous law becomes a recursion.
///
/// With predictor timing z⁻(k+1) = `advance`(z⁻(k), y(k)). With current timing the step is cut in two:
/// z⁻(k) = `predict`(z⁺(k−1)) over the past period, then z⁺(k) = `correct`(z⁻(k), y(k)).
pub trait Scheme<T: Scalar, L: ContinuousLaw<T>>: Copy {
    /// Whether `correct` is for all the time since the last sample, not for the past step alone: true
    /// if it is stable for any time. A sample after a gap, or of a slow sensor, then counts in full.
    const OVER_GAPS: bool = false;
    /// Memory after a step of length dt from (t, z) with sample y and input u.
    fn advance(&self, law: &L, t: T, z: &L::State, y: T, u: &L::Input, dt: T) -> L::State;
    /// Memory after a step of length dt from (t, z) without a sample.
    #[inline(always)]
    fn predict(&self, law: &L, t: T, z: &L::State, u: &L::Input, dt: T) -> L::State {
        self.advance(law, t, z, missing(), u, dt)
    }
    /// Memory after the use of sample y that ends a time dt: what the sample injects in that time, by
    /// forward Euler.
    #[inline(always)]
    fn correct(&self, law: &L, t: T, z: &L::State, y: T, u: &L::Input, dt: T) -> L::State {
        z.plus(dt, &law.injection(t, z, &law.innovation(z, y), u))
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

/// A scheme that is fixed in its type: number METHOD of [`METHODS`]. A loop over many runs then has no
/// choice left in it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Method<const METHOD: usize>;

/// The schemes by number.
pub const METHODS: [Discretisation; 5] = {
    use Discretisation::RungeKutta as Rk;
    use Hold::{Innovation, Measurement};
    [
        Discretisation::Euler,
        Discretisation::StaggeredEuler,
        Rk(RungeKutta { integrator: Integrator::Rk4, hold: Measurement }),
        Rk(RungeKutta { integrator: Integrator::Rk4, hold: Innovation }),
        Rk(RungeKutta { integrator: Integrator::BogackiShampine, hold: Measurement }),
    ]
};

impl<T: Scalar, L: ContinuousLaw<T>, const METHOD: usize> Scheme<T, L> for Method<METHOD> {
    #[inline(always)]
    fn advance(&self, law: &L, t: T, z: &L::State, y: T, u: &L::Input, dt: T) -> L::State {
        const { METHODS[METHOD] }.advance(law, t, z, y, u, dt)
    }
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
    fn step(&self, z: &mut L::State, y: &T, u: &L::Input, t: T, dt: T) -> Status {
        let next = self.law.admissible(self.scheme.advance(&self.law, t, z, *y, u, dt));
        *z = z.zip(&next, |_, new| new);
        if y.is_present() { Status::Updated } else { Status::Predicted }
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
    fn innovation(&self, _: T, z: &L::State, y: &T) -> T {
        match self.estimate(z).first() {
            Some(x1) => *y - *x1,
            None => *y,
        }
    }

    #[inline(always)]
    fn prepared(&self, dt: T) -> Self {
        Self { law: self.law, scheme: self.scheme.prepared(&self.law, dt) }
    }
}

/// A continuous law under a discretisation: an observer with current timing.
///
/// A step with y(k) predicts over the period before it, under the input that was held, and corrects;
/// the first one only corrects, as if a period as long as the next one had passed. Memory: the law's;
/// the time from the last sample used (or the start) to the next one, the period, the input.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Current<L, S> {
    /// The law.
    pub law: L,
    /// The scheme.
    pub scheme: S,
}

/// A law's memory, the time from the last sample used to the next one, the period, the input.
type WithHeld<Z, T, U> = (Z, (T, (T, U)));

impl<L, S> Current<L, S> {
    /// The law's memory predicted up to time t.
    #[inline(always)]
    fn before<T>(
        &self,
        t: T,
        (state, (_, (period, u))): &WithHeld<L::State, T, L::Input>,
    ) -> L::State
    where
        T: Scalar,
        L: ContinuousLaw<T>,
        S: Scheme<T, L>,
    {
        let Self { law, scheme } = self;
        law.admissible(scheme.predict(law, t - *period, state, u, *period))
    }
}

impl<T, L, S> Observer<T> for Current<L, S>
where
    T: Scalar,
    L: ContinuousLaw<T, Input: Memory<T>>,
    S: Scheme<T, L>,
{
    type State = WithHeld<L::State, T, L::Input>;
    type Measurement = T;
    type Input = L::Input;
    const TIMING: Timing = Timing::Current;
    const ESTIMATED: usize = L::ESTIMATED;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        (self.law.initial(), (T::ZERO, (T::ZERO, L::Input::zero())))
    }

    #[inline(always)]
    fn step(&self, z: &mut Self::State, y: &T, u: &L::Input, t: T, dt: T) -> Status {
        let Self { law, scheme } = self;
        let (_, (elapsed, (period, _))) = *z;
        let before = self.before(t, z);
        let time = if S::OVER_GAPS { elapsed } else { period };
        let next = law.admissible(scheme.correct(law, t, &before, *y, u, time.or(dt)));
        let elapsed = dt + elapsed.while_missing(*y);
        *z = (z.0.zip(&next, |_, new| new), (elapsed, (dt, *u)));
        if y.is_present() { Status::Updated } else { Status::Predicted }
    }

    #[inline(always)]
    fn speed(&self, z: &Self::State) -> T {
        self.law.speed(&z.0)
    }

    #[inline(always)]
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [T] {
        self.law.estimate(&z.0)
    }

    #[inline(always)]
    fn innovation(&self, t: T, z: &Self::State, y: &T) -> T {
        match self.law.estimate(&self.before(t, z)).first() {
            Some(x1) => *y - *x1,
            None => *y,
        }
    }

    #[inline(always)]
    fn prepared(&self, dt: T) -> Self {
        Self { law: self.law, scheme: self.scheme.prepared(&self.law, dt) }
    }
}
