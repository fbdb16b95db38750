//! Every observer of the crate in a scenario of its paper: the same source for host, chip and web.
//!
//! A case names an observer and the experiment that feeds it. `run` simulates plant, noise and
//! observer in the chosen precision and digests every state on the way into one number, so that
//! two machines agree on the number only if they agree on every bit of every step.
#![no_std]

mod families;
mod papers;

pub use families::*;
pub use papers::*;

use hgo_rs::Timing;
use hgo_rs::observer::Measurement;
use hgo_rs::prelude::*;
use hgo_rs::simulate::{Probe, Sample};

/// Steps of every run.
pub const STEPS: u64 = 10_000;

/// What a case's observer remembers, takes and is told.
pub type State<T, C> = <<C as Case<T>>::Observer as Observer<T>>::State;

/// An observer and the experiment that feeds it.
pub trait Case<T: Scalar> {
    /// The case's name in linker symbols.
    const SYMBOL: &'static str;
    /// The observer's name in reports.
    const NAME: &'static str;
    /// Its order.
    const N: usize;
    /// The observer.
    type Observer: Observer<T>;
    /// The plant that it observes.
    type Plant: Plant<
            T,
            Input = <Self::Observer as Observer<T>>::Input,
            Output = <Self::Observer as Observer<T>>::Measurement,
        >;

    /// The observer with the paper's numbers, each seen through `number`.
    ///
    /// # Errors
    /// None with the paper's numbers; a number that the constructor refuses.
    fn observer(number: impl Fn(f64) -> T) -> Result<Self::Observer, DesignError>;

    /// Plant, noise and starts.
    ///
    /// # Errors
    /// None with the paper's numbers.
    fn scenario() -> Result<Scenario<T, Self::Plant, State<T, Self>>, DesignError>
    where
        Self: Sized;

    /// When the observer steps. A clock that is part of the observer goes through `I`.
    ///
    /// # Errors
    /// None with the paper's numbers.
    fn schedule<I: Instrument<T>>() -> Result<impl Schedule<T>, DesignError>;
}

/// What feeds an observer.
pub struct Scenario<T, P: Plant<T>, Z>
where
    T: Scalar,
{
    /// The plant.
    pub plant: P,
    /// How it moves.
    pub scheme: PlantScheme,
    /// Measurement noise, drawn at every step.
    pub draw: Draw<'static, T>,
    /// Where the plant starts.
    pub x0: P::State,
    /// Where the observer's memory starts.
    pub z0: Z,
}

/// Looks over an observer's shoulder: what runs is the observer, but each step passes through here, as
/// its two halves.
pub trait Instrument<T: Scalar> {
    /// The first half of a step: the sample is taken, with current timing.
    fn correct<O: Observer<T>>(observer: &O, z: &mut O::State, y: &O::Measurement, t: T) -> Status;
    /// The second half: the period passes.
    fn advance<O: Observer<T>>(
        observer: &O,
        z: &mut O::State,
        y: &O::Measurement,
        u: &O::Input,
        t: T,
        dt: T,
    ) -> Status;
    /// The next step length of a clock.
    fn dt<S: Schedule<T>>(schedule: &S, k: u64) -> T;
}

/// Nothing looks on.
pub struct Plain;

impl<T: Scalar> Instrument<T> for Plain {
    fn correct<O: Observer<T>>(observer: &O, z: &mut O::State, y: &O::Measurement, t: T) -> Status {
        observer.correct(z, y, t)
    }
    fn advance<O: Observer<T>>(
        observer: &O,
        z: &mut O::State,
        y: &O::Measurement,
        u: &O::Input,
        t: T,
        dt: T,
    ) -> Status {
        observer.advance(z, y, u, t, dt)
    }
    fn dt<S: Schedule<T>>(schedule: &S, k: u64) -> T {
        schedule.dt(k)
    }
}

/// An observer or a clock whose steps pass through the instrument I.
pub struct Watched<W, I> {
    watched: W,
    instrument: core::marker::PhantomData<I>,
}

impl<W, I> Watched<W, I> {
    /// Watch it.
    pub const fn new(watched: W) -> Self {
        Self { watched, instrument: core::marker::PhantomData }
    }
}

impl<W: Copy, I> Clone for Watched<W, I> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<W: Copy, I> Copy for Watched<W, I> {}

impl<T: Scalar, O: Observer<T>, I: Instrument<T>> Observer<T> for Watched<O, I> {
    type State = O::State;
    type Measurement = O::Measurement;
    type Input = O::Input;
    const TIMING: Timing = O::TIMING;
    const ESTIMATED: usize = O::ESTIMATED;
    fn initial(&self) -> O::State {
        self.watched.initial()
    }
    fn correct(&self, z: &mut O::State, y: &O::Measurement, t: T) -> Status {
        I::correct(&self.watched, z, y, t)
    }
    fn advance(&self, z: &mut O::State, y: &O::Measurement, u: &O::Input, t: T, dt: T) -> Status {
        I::advance(&self.watched, z, y, u, t, dt)
    }
    fn estimate<'a>(&self, z: &'a O::State) -> &'a [T] {
        self.watched.estimate(z)
    }
    fn innovation(&self, t: T, z: &O::State, y: &O::Measurement, u: &O::Input) -> O::Measurement {
        self.watched.innovation(t, z, y, u)
    }
}

impl<T: Scalar, S: Schedule<T>, I: Instrument<T>> Schedule<T> for Watched<S, I> {
    fn dt(&self, k: u64) -> T {
        I::dt(&self.watched, k)
    }
    fn next_time(&self, t: T, k: u64, dt: T) -> T {
        self.watched.next_time(t, k, dt)
    }
}

/// A digest of every scalar that it is shown, by its bits; every NaN counts as the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digest {
    /// The digest.
    pub hash: u64,
    /// How many samples went in.
    pub samples: u64,
}

impl Default for Digest {
    fn default() -> Self {
        Self { hash: 0xCBF2_9CE4_8422_2325, samples: 0 }
    }
}

impl Digest {
    /// Take one number: FNV-1a over 64-bit words, then a rotation, so that high bits spread too.
    fn take<T: Scalar>(&mut self, x: T) {
        let wide = x.to_f64(); // exact, and the same for both precisions
        let bits = if wide.is_nan() { 0x7FF8_0000_0000_0000 } else { wide.to_bits() };
        self.hash = (self.hash ^ bits).wrapping_mul(0x0100_0000_01B3).rotate_left(29);
    }
}

impl<T: Scalar> Probe<T> for Digest {
    fn sample<X: Memory<T>, Z: Memory<T>, Y: Measurement<T>>(
        &mut self,
        sample: &Sample<'_, T, X, Z, Y>,
    ) {
        self.samples += 1;
        sample.y.each(&mut |y| self.take(y));
        sample.z.visit(&mut |z| self.take(z));
    }
}

/// Run a case for [`STEPS`] steps under the eyes of `I`.
///
/// # Errors
/// None with the papers' numbers.
pub fn run<T: Scalar, C: Case<T>, I: Instrument<T>>() -> Result<Digest, DesignError> {
    let observer = Watched::<_, I>::new(C::observer(T::from_f64)?);
    run_instead::<T, C, I, _>(&observer, C::scenario()?.z0)
}

/// Run a case's scenario with another observer in the place of its own.
///
/// # Errors
/// None with the papers' numbers.
pub fn run_instead<T: Scalar, C: Case<T>, I: Instrument<T>, O>(
    observer: &O,
    z0: O::State,
) -> Result<Digest, DesignError>
where
    O: Observer<
            T,
            Measurement = <C::Observer as Observer<T>>::Measurement,
            Input = <C::Observer as Observer<T>>::Input,
        >,
{
    let Scenario { plant, scheme, draw, x0, .. } = C::scenario()?;
    let experiment = Experiment {
        plant,
        plant_scheme: scheme,
        substeps: 1,
        schedule: C::schedule::<I>()?,
        plant_schedule: None,
        noise: Noise { draw, hold: 1, sines: &[] },
        steps: STEPS,
        seed: 1,
    };
    experiment.check()?;
    let mut digest = Digest::default();
    experiment.sampled(observer, |u| *u, 0, x0, z0, &mut digest);
    Ok(digest)
}

/// Every case but the one whose clock is a part of it, for the macro `$then`.
#[macro_export]
macro_rules! each_case {
    ($then:ident) => {
        $then! {
            Standard2 Standard3 Standard5 Zoh2 Zoh5 LowPower5 PeakingFree5 Filtered2 LimitedGain5
            Cascade5 ReducedChain5 Adaptive2 DeadZone2 Collection2 Modified2 SampledData2 ReducedOrder3
            Window2
            Proper3 Implicit3 InterSample3 FilteredLevant2 Switched2 PrescribedTime2 DeadZoneShape2
            PiecewiseLinear2 Fal2 BiHomogeneous2 NonlinearChain2 HighGainEkf2 SampledEkf2 AdaptiveEkf2
        }
    };
}

/// What is done with each case.
pub trait Visitor {
    /// Take a case in a precision.
    fn visit<T: Scalar, C: Case<T>>(&mut self, scalar: &'static str);
}

/// Show every case in both precisions.
pub fn visit_all(visitor: &mut impl Visitor) {
    visit_precision::<f32>(visitor, "f32");
    visit_precision::<f64>(visitor, "f64");
}

fn visit_precision<T: Scalar>(visitor: &mut impl Visitor, scalar: &'static str) {
    macro_rules! visit {
        ($($case:ident)*) => {$( visitor.visit::<T, $case>(scalar); )*};
    }
    each_case!(visit);
    visitor.visit::<T, StochasticApproximation2>(scalar);
}
