//! Floor 3. Many runs at once: time in the outer loop, a block of runs in the inner one.
//!
//! The memories of L runs stand in columns, each scalar of all runs side by side. The inner loop
//! takes one run out, lets the same plant, noise and observer step as everywhere else, and puts it
//! back; as nothing in a step branches on a run's own values, the compiler makes vector code of that
//! loop. Run i sees the same operations in the same order as in [`Experiment::sampled`], so its bits
//! do not depend on L, on its neighbours or on the processor's instruction set.

// The form that a compiler makes vector code of: an index, and no branch between two truths.
#![allow(clippy::needless_range_loop, clippy::needless_bitwise_bool)]

use crate::Scalar;
use crate::integrate::{Integrator, PlantScheme};
use crate::memory::Memory;
use crate::metrics::{Moments, Window};
use crate::model::{Plant, StochasticIntegrator};
use crate::noise::{Channel, Draw, Noise, Stream};
use crate::observer::{ContinuousLaw, Entries, Measurement, Observer, Status, Timing};
use crate::schedule::Schedule;
use crate::simulate::{DIVERGED, Experiment};

/// Runs in a block: two vectors of `f64` where there are 512 bits.
pub const LANES: usize = 16;

/// Entries of a memory that a block can keep metrics of.
pub const MAX_SIGNALS: usize = 32;

/// One number of every run of a block.
type Lane<T> = [T; LANES];

/// Sums of one signal over one window, for every run.
#[derive(Clone, Copy, Debug)]
pub struct LaneMoments<T> {
    count: Lane<u64>,
    sum: Lane<T>,
    sum_of_squares: Lane<T>,
    max: Lane<T>,
}

impl<T: Scalar> LaneMoments<T> {
    /// Nothing taken yet.
    pub fn new() -> Self {
        let zero = [T::ZERO; LANES];
        Self { count: [0; LANES], sum: zero, sum_of_squares: zero, max: zero }
    }

    /// Those of one run.
    pub fn of(&self, lane: usize) -> Moments<T> {
        let at = lane % LANES;
        Moments::from_sums(self.count[at], self.sum[at], self.sum_of_squares[at], self.max[at])
    }

    #[inline(always)]
    fn push(&mut self, values: &Lane<T>, alive: &Lane<u64>) {
        for lane in 0..LANES {
            let value = if alive[lane] == 1 { values[lane] } else { T::ZERO };
            self.count[lane] += alive[lane];
            self.sum[lane] += value;
            self.sum_of_squares[lane] += value * value;
            self.max[lane] = self.max[lane].max(value.abs());
        }
    }
}

impl<T: Scalar> Default for LaneMoments<T> {
    fn default() -> Self {
        Self::new()
    }
}

/// The metrics of a block of runs, over buffers of the caller; see
/// [`RunMetrics`](crate::simulate::RunMetrics).
#[derive(Debug)]
pub struct LaneMetrics<'a, T> {
    /// Windows of samples.
    pub windows: &'a [Window],
    /// Signals in the moments, at most [`MAX_SIGNALS`].
    pub signals: usize,
    /// windows × signals.
    pub moments: &'a mut [LaneMoments<T>],
    /// Largest magnitude of each memory entry.
    pub peak: &'a mut [Lane<T>],
    /// Threshold of the settling time of ‖x̂ − x‖, and the times.
    pub settling: Option<(T, Lane<T>)>,
}

/// A block of runs: where each stands.
#[derive(Clone, Copy, Debug)]
pub struct Block<X, Z> {
    /// Plant states, in columns.
    pub x: X,
    /// Observer memories, in columns.
    pub z: Z,
    /// Samples before the first at which a state was not finite or too large.
    pub sound: Lane<u64>,
    /// First sample at which the model had no value; `u64::MAX`: none.
    pub undefined_at: Lane<u64>,
}

impl<X, Z> Block<X, Z> {
    /// Runs that start from these columns.
    pub fn new(x: X, z: Z) -> Self {
        Self { x, z, sound: [0; LANES], undefined_at: [u64::MAX; LANES] }
    }
}

/// A random stream for every run, in columns.
struct Streams([Lane<u64>; 4]);

impl Streams {
    fn new(seed: u64, first_run: u64, channel: Channel) -> Self {
        let mut columns = [[0; LANES]; 4];
        for (lane, run) in (first_run..).take(LANES).enumerate() {
            let state = Stream::new(seed, run, channel).state();
            for (column, word) in columns.iter_mut().zip(state) {
                column[lane] = word;
            }
        }
        Self(columns)
    }
    #[inline(always)]
    fn load(&self, lane: usize) -> Stream {
        let [a, b, c, d] = &self.0;
        Stream::from_state([a[lane], b[lane], c[lane], d[lane]])
    }
    #[inline(always)]
    fn store(&mut self, stream: &Stream, lane: usize) {
        for (column, word) in self.0.iter_mut().zip(stream.state()) {
            column[lane] = word;
        }
    }
}

/// What is the same for all runs at one sample.
#[derive(Clone, Copy)]
struct Instant<T> {
    k: u64,
    t: T,
    dt: T,
    sines: T,
    more: bool,
}

/// What a sample shows of every run.
struct Shown<T> {
    /// Errors, then the rest of the memory.
    signals: [Lane<T>; MAX_SIGNALS],
    /// The memory.
    memory: [Lane<T>; MAX_SIGNALS],
    /// ‖x̂ − x‖².
    square: Lane<T>,
    alive: Lane<u64>,
}

impl<T: Scalar> Shown<T> {
    /// What a run shows: `estimated` entries of z beside those of x that `truth` names.
    #[inline(always)]
    fn take<X: Memory<T>, Z: Memory<T>>(
        &mut self,
        lane: usize,
        x: &X,
        z: &Z,
        (from, length): (usize, usize),
        estimated: usize,
    ) {
        let mut truth = [T::ZERO; MAX_SIGNALS];
        let mut index = 0;
        x.visit(&mut |value| {
            if let Some(slot) = truth.get_mut(usize::wrapping_sub(index, from)) {
                *slot = value;
            }
            index += 1;
        });
        let known = length.min(estimated);
        let mut square = T::ZERO;
        let mut index = 0;
        z.visit(&mut |value| {
            if index < MAX_SIGNALS {
                self.memory[index][lane] = value;
                let mut signal = value;
                if index < known {
                    signal -= truth[index];
                    square += signal * signal;
                }
                self.signals[index][lane] = signal;
            }
            index += 1;
        });
        self.square[lane] = square;
    }
}

impl<T: Scalar> LaneMetrics<'_, T> {
    #[inline(always)]
    fn sample(&mut self, at: &Instant<T>, shown: &Shown<T>) {
        let rows = self.moments.chunks_exact_mut(self.signals.max(1));
        for (window, row) in self.windows.iter().zip(rows) {
            if window.contains(at.k) {
                for (moments, values) in row.iter_mut().zip(&shown.signals) {
                    moments.push(values, &shown.alive);
                }
            }
        }
        for (peak, values) in self.peak.iter_mut().zip(&shown.memory) {
            for lane in 0..LANES {
                let size = if shown.alive[lane] == 1 { values[lane].abs() } else { T::ZERO };
                peak[lane] = peak[lane].max(size);
            }
        }
        if let Some((threshold, last)) = &mut self.settling {
            for lane in 0..LANES {
                let outside = shown.square[lane].sqrt() >= *threshold;
                last[lane] = if outside & (shown.alive[lane] == 1) { at.t } else { last[lane] };
            }
        }
    }
}

/// Draws from a stream.
struct Drawn<'a, T> {
    noise: &'a Noise<'a, T>,
    stream: &'a mut Stream,
}

impl<T: Scalar> Entries<T> for Drawn<'_, T> {
    #[inline(always)]
    fn next_entry(&mut self) -> T {
        self.noise.fresh(self.stream, 0)
    }
}

/// A draw for every run.
#[inline(always)]
fn fill<T: Scalar, Y: Measurement<T>>(
    draw: Draw<'_, T>,
    streams: &mut Streams,
    held: &mut Columns<T, Y>,
) {
    let noise = Noise { draw, hold: 1, sines: &[] };
    for lane in 0..LANES {
        let mut stream = streams.load(lane);
        Y::fill(Drawn { noise: &noise, stream: &mut stream }).store(held, lane);
        streams.store(&stream, lane);
    }
}

/// `new` where `take`, else `old`.
#[inline(always)]
fn select<T: Scalar, M: Memory<T>>(take: bool, new: &M, old: &M) -> M {
    new.zip(old, |a, b| if take { a } else { b })
}

/// Columns of L runs.
type Columns<T, M> = <M as Memory<T>>::Columns<LANES>;

impl<T: Scalar, P: Plant<T>, S: Schedule<T>> Experiment<'_, T, P, S> {
    /// Draw the noise of sample k for every run.
    #[inline(always)]
    fn draw_lanes<Y: Measurement<T>>(
        &self,
        streams: &mut Streams,
        k: u64,
        held: &mut Columns<T, Y>,
    ) {
        if self.noise.hold > 1 && !k.is_multiple_of(self.noise.hold) {
            return;
        }
        // one loop for each kind of noise, with the choice outside of it
        match self.noise.draw {
            Draw::None | Draw::Samples(_) => {}
            Draw::Uniform { low, high } => {
                fill::<T, Y>(Draw::Uniform { low, high }, streams, held);
            }
            Draw::Normal { mean, std } => fill::<T, Y>(Draw::Normal { mean, std }, streams, held),
        }
    }

    /// Move the plants by the scheme, which stands outside of the loop.
    #[inline(always)]
    fn move_by(
        &self,
        scheme: PlantScheme,
        streams: &mut Streams,
        (t, dt): (T, T),
        x: &mut Columns<T, P::State>,
        u: &Columns<T, P::Input>,
        alive: &Lane<u64>,
    ) {
        let h = dt / T::from_f64(f64::from(self.substeps));
        for i in 0..self.substeps {
            let time = t + T::from_f64(f64::from(i)) * h;
            for lane in 0..LANES {
                let mut stream = streams.load(lane);
                let (state, input) = (P::State::load(x, lane), P::Input::load(u, lane));
                let moved = self.substep(scheme, &mut stream, time, &state, &input, h);
                select(alive[lane] == 1, &moved, &state).store(x, lane);
                if let PlantScheme::Stochastic(_) = scheme {
                    streams.store(&stream, lane);
                }
            }
        }
    }

    /// Move the plant of every run that is alive.
    #[inline(always)]
    fn move_lanes(
        &self,
        streams: &mut Streams,
        span: (T, T),
        x: &mut Columns<T, P::State>,
        u: &Columns<T, P::Input>,
        alive: &Lane<u64>,
    ) {
        // each scheme by its name, so that the loop inside is compiled for it alone
        macro_rules! choose {
            ($($scheme:pat => $named:expr),+ $(,)?) => {
                match self.plant_scheme {
                    $($scheme => self.move_by($named, streams, span, x, u, alive),)+
                    _ => {} // held
                }
            };
        }
        use Integrator::{BogackiShampine, Euler, Rk4};
        use PlantScheme::{Deterministic, Stochastic};
        use StochasticIntegrator::{EulerMaruyama, Milstein, Taylor15};
        if P::NOISY && matches!(self.plant_scheme, Stochastic(_)) {
            choose! {
                Stochastic(EulerMaruyama) => Stochastic(EulerMaruyama),
                Stochastic(Milstein) => Stochastic(Milstein),
                Stochastic(Taylor15) => Stochastic(Taylor15),
            }
        } else {
            choose! {
                Deterministic(Euler) => Deterministic(Euler),
                Deterministic(BogackiShampine) => Deterministic(BogackiShampine),
                Deterministic(Rk4) => Deterministic(Rk4),
            }
        }
    }

    /// [`Experiment::sampled`] for the runs `first_run` to `first_run + LANES − 1`. `stop` is asked
    /// before every 512th substep or so whether to end early.
    #[inline(always)]
    pub fn sampled_block<O>(
        &self,
        observer: &O,
        tell: impl Fn(&P::Input) -> O::Input,
        first_run: u64,
        mut block: Block<Columns<T, P::State>, Columns<T, O::State>>,
        metrics: &mut LaneMetrics<'_, T>,
        stop: impl Fn() -> bool,
    ) -> Block<Columns<T, P::State>, Columns<T, O::State>>
    where
        O: Observer<T, Measurement = P::Output>,
        P::Output: Measurement<T>,
    {
        // copies of our own: nothing that is written can be what they hold
        let (here, observer) = (*self, *observer);
        let mut measurement = Streams::new(here.seed, first_run, Channel::Measurement);
        let mut process = Streams::new(here.seed, first_run, Channel::Process);
        let mut held = P::Output::zero().in_columns::<LANES>();
        let mut inputs = P::Input::zero().in_columns::<LANES>();
        let zero = [T::ZERO; LANES];
        let mut shown = Shown {
            signals: [zero; MAX_SIGNALS],
            memory: [zero; MAX_SIGNALS],
            square: zero,
            alive: [1; LANES],
        };
        let (mut t, mut plant_t) = (T::ZERO, T::ZERO);
        let bound = T::from_f64(DIVERGED);
        // samples between two looks at `stop`: fewer where each takes many substeps
        let patience = (512 / u64::from(here.substeps.max(1))).max(1);
        for k in 0..=here.steps {
            if k.is_multiple_of(patience) && (stop() || shown.alive == [0; LANES]) {
                break;
            }
            let (dt, more) = (here.schedule.dt(k), k < here.steps);
            let at = Instant { k, t, dt, sines: here.noise.sines(t), more };
            here.draw_lanes::<P::Output>(&mut measurement, k, &mut held);
            for lane in 0..LANES {
                let x = P::State::load(&block.x, lane);
                let old = O::State::load(&block.z, lane);
                let was = shown.alive[lane] == 1;
                let alive = was & x.within(bound) & old.within(bound);
                shown.alive[lane] = u64::from(alive);
                block.sound[lane] += u64::from(alive);
                let noise = P::Output::load(&held, lane);
                let y = here.plant.output(&x).plus(noise).plus(P::Output::fill(|| at.sines));
                let u = here.plant.control(&x, at.dt);
                let mut new = old.zip(&old, |z, _| z);
                // a predictor's step at the last sample is made and not kept: no branch
                let status = observer.step(&mut new, &y, &tell(&u), at.t, at.dt);
                let takes = alive & (at.more | (O::TIMING == Timing::Current));
                let undefined = (status == Status::ModelUndefined) & takes;
                let here = if undefined { k } else { u64::MAX };
                block.undefined_at[lane] = block.undefined_at[lane].min(here);
                let current = if O::TIMING == Timing::Current { &new } else { &old };
                shown.take(lane, &x, current, P::TRUTH, O::ESTIMATED);
                select(takes, &new, &old).store(&mut block.z, lane);
                u.store(&mut inputs, lane);
            }
            metrics.sample(&at, &shown);
            if more {
                let schedule = here.plant_schedule.unwrap_or(here.schedule);
                let plant_dt = schedule.dt(k);
                let span = (plant_t, plant_dt);
                here.move_lanes(&mut process, span, &mut block.x, &inputs, &shown.alive);
                plant_t = schedule.next_time(plant_t, k, plant_dt);
                t = here.schedule.next_time(t, k, dt);
            }
        }
        block
    }

    /// [`Experiment::joint`] for the runs `first_run` to `first_run + LANES − 1`; `stop` as above. The
    /// noise must have no sines, which would be taken within each step.
    #[allow(clippy::too_many_arguments)]
    #[inline(always)]
    pub fn joint_block<L>(
        &self,
        law: &L,
        tell: impl Fn(&P::Input) -> L::Input,
        integrator: Integrator,
        first_run: u64,
        mut block: Block<Columns<T, P::State>, Columns<T, L::State>>,
        metrics: &mut LaneMetrics<'_, T>,
        stop: impl Fn() -> bool,
    ) -> Block<Columns<T, P::State>, Columns<T, L::State>>
    where
        L: ContinuousLaw<T>,
        P: Plant<T, Output = T>,
    {
        let (here, law) = (*self, *law);
        let mut measurement = Streams::new(here.seed, first_run, Channel::Measurement);
        let mut held = [T::ZERO; LANES];
        let zero = [T::ZERO; LANES];
        let mut shown = Shown {
            signals: [zero; MAX_SIGNALS],
            memory: [zero; MAX_SIGNALS],
            square: zero,
            alive: [1; LANES],
        };
        let mut t = T::ZERO;
        let bound = T::from_f64(DIVERGED);
        // samples between two looks at `stop`: fewer where each takes many substeps
        let patience = (512 / u64::from(here.substeps.max(1))).max(1);
        let frozen = here.plant_scheme == PlantScheme::Held;
        for k in 0..=here.steps {
            if k.is_multiple_of(patience) && (stop() || shown.alive == [0; LANES]) {
                break;
            }
            let (dt, more) = (here.schedule.dt(k), k < here.steps);
            let at = Instant { k, t, dt, sines: T::ZERO, more };
            here.draw_lanes::<T>(&mut measurement, k, &mut held);
            for lane in 0..LANES {
                let x = P::State::load(&block.x, lane);
                let z = L::State::load(&block.z, lane);
                let was = shown.alive[lane] == 1;
                let alive = was & x.within(bound) & z.within(bound);
                shown.alive[lane] = u64::from(alive);
                block.sound[lane] += u64::from(alive);
                shown.take(lane, &x, &z, P::TRUTH, L::ESTIMATED);
                let u = here.plant.control(&x, at.dt);
                let told = tell(&u);
                let noise = held[lane];
                let both = here.both(&law, &[], noise, frozen, &u, &told);
                let (new_x, new_z) = integrator.step(both, at.t, &(x, z), at.dt);
                let moves = alive & at.more;
                select(moves, &new_x, &x).store(&mut block.x, lane);
                select(moves, &law.admissible(new_z), &z).store(&mut block.z, lane);
            }
            metrics.sample(&at, &shown);
            if more {
                t = here.schedule.next_time(t, k, dt);
            }
        }
        block
    }
}
