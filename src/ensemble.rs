//! Floor 3. Many runs at once: time in the outer loop, a block of runs in the inner one.
//!
//! The memories of a block's runs stand in columns, each scalar of all runs side by side. The inner
//! loop takes one run out, lets the same plant, noise and observer step as everywhere else, and puts
//! it back; as nothing in a step branches on a run's own values, the compiler makes vector code of
//! that loop. Run i sees the same operations in the same order as in [`Experiment::sampled`], so its
//! bits do not depend on its neighbours or on the processor's instruction set.
//!
//! A run that diverges is found in spans: all runs move over a span of samples; if a state was out of
//! bounds anywhere in it, the span is undone and moved over sample by sample, so that the run ends at
//! the very sample at which it ends alone. From then on it is put back after every span.

// The form that a compiler makes vector code of: an index, and no branch between two truths.
#![allow(clippy::needless_range_loop)]

use crate::Scalar;
use crate::integrate::{Integrator, PlantScheme, WienerIncrement};
use crate::lanes::{Aligned, LANES, Lane, LaneMetrics, Shown};
use crate::memory::Memory;
use crate::model::{Plant, StochasticIntegrator};
use crate::noise::{Channel, Draw, Noise, Stream, radius_of, radius_parts, turned};
use crate::observer::{ContinuousLaw, Entries, Measurement, Observer, Status, Timing};
use crate::program::{Program, REGISTERS, Registers};
use crate::schedule::Schedule;
use crate::simulate::{DIVERGED, Experiment};
use nalgebra::SVector;

/// Samples between two looks at the bounds (and at whether to stop).
const SPAN: u64 = 64;

/// Columns of a block.
pub type Columns<T, M> = <M as Memory<T>>::Columns<LANES>;

/// A block of runs: where each stands.
#[derive(Clone, Copy, Debug)]
pub struct Block<X, Z> {
    /// Plant states, in columns.
    pub x: Aligned<X>,
    /// Observer memories, in columns.
    pub z: Aligned<Z>,
    /// Samples before the first at which a state was not finite or too large.
    pub sound: Lane<u64>,
    /// First sample at which the model had no value; `u64::MAX`: none.
    pub undefined_at: Lane<u64>,
}

impl<X, Z> Block<X, Z> {
    /// Runs that start from these columns.
    pub fn new(x: X, z: Z) -> Self {
        let (sound, undefined_at) = (Lane([u64::MAX; LANES]), Lane([u64::MAX; LANES]));
        Self { x: Aligned(x), z: Aligned(z), sound, undefined_at }
    }
}

/// A random stream for every run, in columns.
#[derive(Clone, Copy)]
struct Streams([Lane<u64>; 4]);

impl Streams {
    fn new(seed: u64, first_run: u64, channel: Channel) -> Self {
        let mut columns = [Lane([0; LANES]); 4];
        for lane in 0..LANES {
            let run = first_run.wrapping_add(lane as u64);
            let state = Stream::new(seed, run, channel).state();
            for (column, word) in columns.iter_mut().zip(state) {
                column.0[lane] = word;
            }
        }
        Self(columns)
    }
    #[inline(always)]
    fn load(&self, lane: usize) -> Stream {
        let [a, b, c, d] = &self.0;
        Stream::from_state([a.0[lane], b.0[lane], c.0[lane], d.0[lane]])
    }
    #[inline(always)]
    fn store(&mut self, stream: &Stream, lane: usize) {
        for (column, word) in self.0.iter_mut().zip(stream.state()) {
            column.0[lane] = word;
        }
    }
    /// A standard normal pair of every run, the second only where it is wanted. In several passes,
    /// as all draws: the processor works on more runs at once where the chain of each is short.
    #[inline(always)]
    fn normal_pairs(&mut self, both: bool) -> [Lane<f64>; 2] {
        let [mut first, mut second, mut third] = [Lane([0.0; LANES]); 3];
        for lane in 0..LANES {
            let mut stream = self.load(lane);
            (first.0[lane], second.0[lane]) = (stream.uniform(), stream.uniform());
            self.store(&stream, lane);
        }
        for lane in 0..LANES {
            (first.0[lane], third.0[lane]) = radius_parts(first.0[lane]);
        }
        for lane in 0..LANES {
            first.0[lane] = radius_of((first.0[lane], third.0[lane]));
        }
        for lane in 0..LANES {
            let pair = turned(first.0[lane], second.0[lane]);
            first.0[lane] = pair.0;
            if both {
                second.0[lane] = pair.1;
            }
        }
        [first, second]
    }
}

/// What is the same for all runs at one sample.
#[derive(Clone, Copy)]
struct Instant<T> {
    k: u64,
    t: T,
    dt: T,
    /// Length of the plants' step.
    plant_dt: T,
    /// Sum of the sines.
    sines: T,
    /// Whether a sample follows.
    more: bool,
}

/// Columns of what a plant's runs are given: measurement noise and inputs.
type Given<T, P> = (Columns<T, <P as Plant<T>>::Output>, Columns<T, <P as Plant<T>>::Input>);

/// Columns of plant states and observer memories.
type BlockOf<T, P, Z> = Block<Columns<T, <P as Plant<T>>::State>, Columns<T, Z>>;

/// What moves beside the states.
#[derive(Clone, Copy)]
struct Running<T, G, X> {
    measurement: Streams,
    process: Streams,
    given: Aligned<G>,
    /// Where plants that have moved stand, until their sample has been shown.
    next: Aligned<X>,
    t: T,
    plant_t: T,
}

/// What moves beside the states of such plants.
type RunningOf<T, P> = Running<T, Given<T, P>, Columns<T, <P as Plant<T>>::State>>;

/// Two zeros for every run.
const NOTHING: [Lane<f64>; 2] = [Lane([0.0; LANES]); 2];

impl<T, G, X> Running<T, G, X> {
    /// The normal values that the scheme takes for a substep of every plant.
    #[inline(always)]
    fn normals(&mut self, scheme: PlantScheme) -> [Lane<f64>; 2] {
        let both = scheme == PlantScheme::Stochastic(StochasticIntegrator::Taylor15);
        if let PlantScheme::Stochastic(_) = scheme {
            self.process.normal_pairs(both)
        } else {
            NOTHING
        }
    }
}

/// How observers move beside their plants.
trait Mover<T: Scalar, P: Plant<T>, S: Schedule<T>> {
    /// Memory of an observer.
    type Memory: Memory<T>;
    /// Whether a sample shows the memory after its use.
    fn filters(&self) -> bool;
    /// How many states are estimated: the first entries of the memory.
    fn estimated(&self) -> usize;

    /// Every observer takes its sample; `worst` becomes the largest magnitude of any state so far.
    /// What can be done for all that follows in the same pass is done, and told.
    fn observe(
        &mut self,
        study: &Experiment<'_, T, P, S>,
        at: &Instant<T>,
        running: &mut RunningOf<T, P>,
        block: &mut BlockOf<T, P, Self::Memory>,
        worst: &mut Lane<T>,
    ) -> Moved;

    /// Every observer that filters moves to the next sample, after its estimate was shown.
    #[inline(always)]
    fn predict(
        &mut self,
        _at: &Instant<T>,
        _running: &RunningOf<T, P>,
        _block: &mut BlockOf<T, P, Self::Memory>,
    ) {
    }

    /// Every plant moves to the next sample, from time `running.plant_t` over `at.plant_dt`.
    fn advance(
        &mut self,
        study: &Experiment<'_, T, P, S>,
        at: &Instant<T>,
        running: &mut RunningOf<T, P>,
        block: &mut BlockOf<T, P, Self::Memory>,
    );
}

/// Whether the plants have moved already.
#[derive(Clone, Copy)]
enum Moved {
    Yes,
    /// To `Running::next`, so that the sample can be shown.
    Aside,
    No,
}

/// Observers in discrete time beside plants that move by a scheme of their own.
struct Sampled<'a, O>(&'a O);

/// Laws in continuous time that are integrated together with their plants.
struct Joint<'a, L>(&'a L, Integrator);

impl<O> Sampled<'_, O> {
    /// One pass over the runs: the observer's step, and the plant's, if its scheme is given (by its
    /// name, so that the loop is compiled for it alone).
    #[inline(always)]
    fn pass<T, P, S>(
        &self,
        study: &Experiment<'_, T, P, S>,
        at: &Instant<T>,
        running: &mut RunningOf<T, P>,
        block: &mut BlockOf<T, P, O::State>,
        worst: &mut Lane<T>,
        scheme: Option<PlantScheme>,
    ) where
        T: Scalar,
        P: Plant<T>,
        S: Schedule<T>,
        O: Observer<T, Measurement = P::Output, Input = P::Input>,
    {
        let xi = if let Some(scheme) = scheme { running.normals(scheme) } else { NOTHING };
        for lane in 0..LANES {
            let x = P::State::load(&block.x.0, lane);
            let mut z = O::State::load(&block.z.0, lane);
            worst.0[lane] = z.largest(x.largest(worst.0[lane]));
            let noise = P::Output::load(&running.given.0.0, lane);
            let u = study.plant.control(running.plant_t, &x, at.dt);
            let output = study.plant.output(running.plant_t, &x, &u);
            let y = output.plus(noise).plus(P::Output::fill(Same(at.sines)));
            let status = if O::TIMING == Timing::Current {
                self.0.correct(&mut z, &y, at.t)
            } else {
                self.0.advance(&mut z, &y, &u, at.t, at.dt)
            };
            let here = if status == Status::ModelUndefined { at.k } else { u64::MAX };
            block.undefined_at.0[lane] = block.undefined_at.0[lane].min(here);
            z.store(&mut block.z.0, lane);
            if let Some(scheme) = scheme {
                let xi = (xi[0].0[lane], xi[1].0[lane]);
                let next = study.substep(scheme, xi, running.plant_t, &x, &u, at.plant_dt);
                if O::TIMING == Timing::Current {
                    next.store(&mut running.next.0, lane); // the sample is shown first
                } else {
                    next.store(&mut block.x.0, lane);
                }
            }
            if scheme.is_none() || O::TIMING == Timing::Current {
                u.store(&mut running.given.0.1, lane);
            }
        }
    }
}

impl<T, P, S, O> Mover<T, P, S> for Sampled<'_, O>
where
    T: Scalar,
    P: Plant<T>,
    S: Schedule<T>,
    O: Observer<T, Measurement = P::Output, Input = P::Input>,
{
    type Memory = O::State;

    #[inline(always)]
    fn filters(&self) -> bool {
        O::TIMING == Timing::Current
    }

    #[inline(always)]
    fn estimated(&self) -> usize {
        O::ESTIMATED
    }

    #[inline(always)]
    fn observe(
        &mut self,
        study: &Experiment<'_, T, P, S>,
        at: &Instant<T>,
        running: &mut RunningOf<T, P>,
        block: &mut BlockOf<T, P, O::State>,
        worst: &mut Lane<T>,
    ) -> Moved {
        const EULER: PlantScheme = PlantScheme::Deterministic(Integrator::Euler);
        const MARUYAMA: PlantScheme = PlantScheme::Stochastic(StochasticIntegrator::EulerMaruyama);
        const RK4: PlantScheme = PlantScheme::Deterministic(Integrator::Rk4);
        study.draw_lanes(at.k, &mut running.measurement, &mut running.given.0.0);
        // short steps go together: what both load is loaded once; and those of plants with a control:
        // what it computes of the state, the first stage does too
        let single = at.more && study.substeps == 1;
        let short = single && O::TIMING == Timing::Predictor;
        match study.plant_scheme {
            EULER if short => self.pass(study, at, running, block, worst, Some(EULER)),
            MARUYAMA if short && P::NOISY => {
                self.pass(study, at, running, block, worst, Some(MARUYAMA));
            }
            RK4 if single && P::Input::LEN > 0 => {
                self.pass(study, at, running, block, worst, Some(RK4));
            }
            _ => {
                self.pass(study, at, running, block, worst, None);
                return Moved::No;
            }
        }
        if O::TIMING == Timing::Current { Moved::Aside } else { Moved::Yes }
    }

    #[inline(always)]
    fn predict(
        &mut self,
        at: &Instant<T>,
        running: &RunningOf<T, P>,
        block: &mut BlockOf<T, P, O::State>,
    ) {
        for lane in 0..LANES {
            let mut z = O::State::load(&block.z.0, lane);
            let u = P::Input::load(&running.given.0.1, lane);
            let status = self.0.predict(&mut z, &u, at.t, at.dt);
            let here = if status == Status::ModelUndefined { at.k } else { u64::MAX };
            block.undefined_at.0[lane] = block.undefined_at.0[lane].min(here);
            z.store(&mut block.z.0, lane);
        }
    }

    #[inline(always)]
    fn advance(
        &mut self,
        study: &Experiment<'_, T, P, S>,
        at: &Instant<T>,
        running: &mut RunningOf<T, P>,
        block: &mut BlockOf<T, P, O::State>,
    ) {
        // each scheme by its name, as above
        macro_rules! choose {
            ($($scheme:pat => $named:expr),+ $(,)?) => {
                match study.plant_scheme {
                    $($scheme => study.move_lanes($named, at.plant_dt, running, &mut block.x.0),)+
                    _ => {} // held
                }
            };
        }
        use Integrator::{BogackiShampine, Euler, Rk4};
        use PlantScheme::{Deterministic, Stochastic};
        use StochasticIntegrator::{EulerMaruyama, Milstein, Taylor15};
        if P::NOISY && matches!(study.plant_scheme, Stochastic(_)) {
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
}

impl<T, P, S, L> Mover<T, P, S> for Joint<'_, L>
where
    T: Scalar,
    P: Plant<T, Output = T>,
    S: Schedule<T>,
    L: ContinuousLaw<T, Input = P::Input>,
{
    type Memory = L::State;

    #[inline(always)]
    fn filters(&self) -> bool {
        false
    }

    #[inline(always)]
    fn estimated(&self) -> usize {
        L::ESTIMATED
    }

    #[inline(always)]
    fn observe(
        &mut self,
        study: &Experiment<'_, T, P, S>,
        at: &Instant<T>,
        running: &mut RunningOf<T, P>,
        block: &mut BlockOf<T, P, L::State>,
        worst: &mut Lane<T>,
    ) -> Moved {
        study.draw_lanes(at.k, &mut running.measurement, &mut running.given.0.0);
        for lane in 0..LANES {
            let x = P::State::load(&block.x.0, lane);
            let z = L::State::load(&block.z.0, lane);
            worst.0[lane] = z.largest(x.largest(worst.0[lane]));
        }
        Moved::No
    }

    #[inline(always)]
    fn advance(
        &mut self,
        study: &Experiment<'_, T, P, S>,
        at: &Instant<T>,
        running: &mut RunningOf<T, P>,
        block: &mut BlockOf<T, P, L::State>,
    ) {
        let frozen = study.plant_scheme == PlantScheme::Held;
        let Self(law, integrator) = self;
        for lane in 0..LANES {
            let x = P::State::load(&block.x.0, lane);
            let z = L::State::load(&block.z.0, lane);
            let u = study.plant.control(at.t, &x, at.dt);
            let both = study.both(*law, &[], running.given.0.0[lane], frozen, &u, &u);
            let (x, z) = integrator.step(both, at.t, &(x, z), at.dt);
            x.store(&mut block.x.0, lane);
            law.admissible(z).store(&mut block.z.0, lane);
        }
    }
}

/// Observers, and plants or both together, as programs.
///
/// Inputs stand in the first registers, results where the programs' outputs say.
#[derive(Debug)]
pub struct Programs<'a, T, const Z: usize> {
    /// What observers make of a sample: (t, dt, z, x, drawn noise, sum of the sines, the plant's time) →
    /// z⁺; or both's, see `joint`.
    pub observers: Program<'a>,
    /// How observers that filter go on after it: (t, dt, z) → z⁺.
    pub predictors: Option<Program<'a>>,
    /// Plants' step: (t, h, x, ξ₁, ξ₂) → x⁺, ξ two normal values. `None`: they do not move by it.
    pub plants: Option<Program<'a>>,
    /// Whether `observers` moves both: (t, dt, z, x, drawn noise) → (z⁺, x⁺).
    pub joint: bool,
    /// Registers of the programs for observers, plants and predictors, constants in their places.
    pub registers: [&'a mut Registers<Lane<T>>; 3],
    /// Entries of a plant's state and of an observer's memory.
    pub entries: (usize, usize),
    /// How many states are estimated.
    pub estimated: usize,
    /// Whether a sample shows the memory after its use.
    pub filters: bool,
}

/// Columns into registers.
#[inline(always)]
fn put<T: Scalar>(to: &mut [Lane<T>], from: &[[T; LANES]]) {
    to.iter_mut().zip(from).for_each(|(to, from)| to.0 = *from);
}

/// `worst` becomes the largest magnitude so far.
#[inline(always)]
fn look<T: Scalar>(columns: &[[T; LANES]], worst: &mut Lane<T>) {
    for column in columns {
        let so_far = worst.0; // a copy: what is chosen is stored, not where
        for lane in 0..LANES {
            worst.0[lane] = so_far[lane].max(column[lane].abs());
        }
    }
}

/// Results back into columns.
#[inline(always)]
fn take<T: Scalar>(r: &[Lane<T>; REGISTERS], outputs: &[u8], to: &mut [[T; LANES]]) {
    for (to, output) in to.iter_mut().zip(outputs) {
        *to = r[usize::from(*output)].0;
    }
}

/// Where the memory after a step is not finite although all was sound before it, the model has no value:
/// the memory is held.
#[inline(always)]
fn hold<T: Scalar, X: Memory<T>, M: Memory<T>>(
    r: &[Lane<T>; REGISTERS],
    outputs: &[u8],
    stood: &Aligned<Columns<T, M>>,
    block: &mut Block<Columns<T, X>, Columns<T, M>>,
    k: u64,
) {
    let mut spoilt = Lane([T::ZERO; LANES]); // NaN where an entry is not finite
    for output in outputs {
        let column = r[usize::from(*output)].0;
        for lane in 0..LANES {
            spoilt.0[lane] += T::ZERO * column[lane];
        }
    }
    if spoilt.0.iter().fold(true, |sound, spoilt| sound & spoilt.is_finite()) {
        return;
    }
    let bound = T::from_f64(DIVERGED);
    for lane in 0..LANES {
        let held = M::load(&stood.0, lane);
        let sound = held.within(bound) && X::load(&block.x.0, lane).within(bound);
        if !spoilt.0[lane].is_finite() && sound {
            held.store(&mut block.z.0, lane);
            block.undefined_at.0[lane] = block.undefined_at.0[lane].min(k);
        }
    }
}

impl<T, P, S, const X: usize, const Z: usize> Mover<T, P, S> for Programs<'_, T, Z>
where
    T: Scalar,
    P: Plant<T, Output = T, State = SVector<T, X>>,
    S: Schedule<T>,
{
    type Memory = SVector<T, Z>;

    #[inline(always)]
    fn filters(&self) -> bool {
        self.filters
    }

    #[inline(always)]
    fn estimated(&self) -> usize {
        self.estimated
    }

    #[inline(always)]
    fn observe(
        &mut self,
        study: &Experiment<'_, T, P, S>,
        at: &Instant<T>,
        running: &mut RunningOf<T, P>,
        block: &mut BlockOf<T, P, SVector<T, Z>>,
        worst: &mut Lane<T>,
    ) -> Moved {
        study.draw_lanes(at.k, &mut running.measurement, &mut running.given.0.0);
        let (n_x, n_z) = self.entries;
        let program = self.observers;
        let r = &mut *self.registers[0];
        let [t, dt, rest @ ..] = &mut r.0;
        (t.0, dt.0) = ([at.t; LANES], [at.dt; LANES]);
        let (z, rest) = rest.split_at_mut(n_z.min(REGISTERS / 4));
        put(z, &block.z.0);
        let (x, rest) = rest.split_at_mut(n_x.min(REGISTERS / 4));
        put(x, &block.x.0);
        look(block.z.0.get(..n_z).unwrap_or_default(), worst);
        look(block.x.0.get(..n_x).unwrap_or_default(), worst);
        if let [noise, sines, plant_t, ..] = rest {
            noise.0 = running.given.0.0;
            if !self.joint {
                (sines.0, plant_t.0) = ([at.sines; LANES], [running.plant_t; LANES]);
            }
        }
        if !at.more && self.joint {
            return Moved::Yes; // a look at the bounds
        }
        program.run_lanes(r);
        let (of_z, of_x) = program.outputs.split_at(n_z.min(program.outputs.len()));
        let stood = block.z;
        take(&r.0, of_z, &mut block.z.0);
        take(&r.0, of_x, &mut block.x.0);
        hold::<T, P::State, SVector<T, Z>>(&r.0, of_z, &stood, block, at.k);
        if self.joint { Moved::Yes } else { Moved::No }
    }

    #[inline(always)]
    fn predict(
        &mut self,
        at: &Instant<T>,
        _: &RunningOf<T, P>,
        block: &mut BlockOf<T, P, SVector<T, Z>>,
    ) {
        let (Some(program), (_, n_z)) = (self.predictors, self.entries) else { return };
        let r = &mut *self.registers[2];
        let [t, dt, rest @ ..] = &mut r.0;
        (t.0, dt.0) = ([at.t; LANES], [at.dt; LANES]);
        let (z, _) = rest.split_at_mut(n_z.min(REGISTERS / 4));
        put(z, &block.z.0);
        program.run_lanes(r);
        let stood = block.z;
        take(&r.0, program.outputs, &mut block.z.0);
        hold::<T, P::State, SVector<T, Z>>(&r.0, program.outputs, &stood, block, at.k);
    }

    #[inline(always)]
    fn advance(
        &mut self,
        study: &Experiment<'_, T, P, S>,
        at: &Instant<T>,
        running: &mut RunningOf<T, P>,
        block: &mut BlockOf<T, P, SVector<T, Z>>,
    ) {
        let (Some(program), (n_x, _)) = (self.plants, self.entries) else { return };
        let r = &mut *self.registers[1];
        let h = at.plant_dt / T::from_f64(f64::from(study.substeps));
        let noisy = matches!(study.plant_scheme, PlantScheme::Stochastic(_));
        for i in 0..study.substeps {
            let time = running.plant_t + T::from_f64(f64::from(i)) * h;
            let [t, step, rest @ ..] = &mut r.0;
            (t.0, step.0) = ([time; LANES], [h; LANES]);
            let (x, rest) = rest.split_at_mut(n_x.min(REGISTERS / 4));
            put(x, &block.x.0); // looked at with the next sample
            if noisy && let [first, second, ..] = rest {
                for lane in 0..LANES {
                    let mut stream = running.process.load(lane);
                    let (xi1, xi2) = stream.normal_pair();
                    (first.0[lane], second.0[lane]) = (T::from_f64(xi1), T::from_f64(xi2));
                    running.process.store(&stream, lane);
                }
            }
            program.run_lanes(r);
            take(&r.0, program.outputs, &mut block.x.0);
        }
    }
}

/// One value for every entry of a measurement.
struct Same<T>(T);

impl<T: Scalar> Entries<T> for Same<T> {
    #[inline(always)]
    fn next_entry(&mut self) -> T {
        self.0
    }
}

/// Draws from a stream.
struct Drawn<'a, T> {
    draw: Draw<'a, T>,
    stream: &'a mut Stream,
}

impl<T: Scalar> Entries<T> for Drawn<'_, T> {
    #[inline(always)]
    fn next_entry(&mut self) -> T {
        Noise { draw: self.draw, hold: 1, sines: &[] }.fresh(self.stream, 0)
    }
}

/// A draw for every run.
#[inline(always)]
fn fill<T: Scalar, Y: Measurement<T>>(
    draw: Draw<'_, T>,
    streams: &mut Streams,
    held: &mut Columns<T, Y>,
) {
    for lane in 0..LANES {
        let mut stream = streams.load(lane);
        Y::fill(Drawn { draw, stream: &mut stream }).store(held, lane);
        streams.store(&stream, lane);
    }
}

impl<T: Scalar, P: Plant<T>, S: Schedule<T>> Experiment<'_, T, P, S> {
    /// Draw the noise of sample k for every run.
    #[inline(always)]
    fn draw_lanes(&self, k: u64, streams: &mut Streams, held: &mut Columns<T, P::Output>) {
        if self.noise.hold > 1 && !k.is_multiple_of(self.noise.hold) {
            return;
        }
        // one loop for each kind of noise, with the choice outside of it
        match self.noise.draw {
            Draw::None => {}
            Draw::Uniform { low, high } => {
                fill::<T, P::Output>(Draw::Uniform { low, high }, streams, held);
            }
            Draw::Normal { mean, std } => {
                fill::<T, P::Output>(Draw::Normal { mean, std }, streams, held);
            }
            Draw::Samples(_) => {
                // the same for all runs
                let draw = P::Output::fill(Same(self.noise.fresh(&mut streams.load(0), k)));
                *held = draw.in_columns::<LANES>();
            }
            Draw::RunSamples { .. } => {
                for lane in 0..LANES {
                    let noise = Noise { draw: self.noise.draw.of_lane(lane), ..self.noise };
                    let draw = Same(noise.fresh(&mut streams.load(lane), k));
                    P::Output::fill(draw).store(held, lane);
                }
            }
        }
    }

    /// Move every plant by the scheme, which stands outside of the loop.
    #[inline(always)]
    fn move_lanes(
        &self,
        scheme: PlantScheme,
        dt: T,
        running: &mut RunningOf<T, P>,
        x: &mut Columns<T, P::State>,
    ) {
        let h = dt / T::from_f64(f64::from(self.substeps));
        for i in 0..self.substeps {
            let time = running.plant_t + T::from_f64(f64::from(i)) * h;
            let xi = running.normals(scheme);
            for lane in 0..LANES {
                let input = P::Input::load(&running.given.0.1, lane);
                let state = P::State::load(x, lane);
                let xi = (xi[0].0[lane], xi[1].0[lane]);
                self.substep(scheme, xi, time, &state, &input, h).store(x, lane);
            }
        }
    }

    /// Samples `from` to `to`, not including it, of every run.
    #[inline(always)]
    fn span<M: Mover<T, P, S>>(
        &self,
        mover: &mut M,
        (from, to): (u64, u64),
        running: &mut RunningOf<T, P>,
        block: &mut BlockOf<T, P, M::Memory>,
        metrics: &mut LaneMetrics<'_, T>,
        dead: &Lane<bool>,
    ) -> Lane<T> {
        let truth = (P::TRUTH.0, P::TRUTH.1.min(mover.estimated()));
        let mut worst = Lane([T::ZERO; LANES]);
        for k in from..to {
            let (dt, more) = (self.schedule.dt(k), k < self.steps);
            let plants = self.plant_schedule.unwrap_or(self.schedule);
            let (t, plant_dt) = (running.t, plants.dt(k));
            let at = Instant { k, t, dt, plant_dt, sines: self.noise.sines(t), more };
            let filters = mover.filters();
            if !filters {
                let shown = Shown { k, x: &block.x.0, z: &block.z.0, truth };
                metrics.sample::<P::State, M::Memory>(t, &shown, dead);
            }
            let mut moved = Moved::No;
            if more || filters {
                moved = mover.observe(self, &at, running, block, &mut worst);
            }
            if filters {
                let shown = Shown { k, x: &block.x.0, z: &block.z.0, truth };
                metrics.sample::<P::State, M::Memory>(t, &shown, dead);
            }
            if more {
                if filters {
                    mover.predict(&at, running, block);
                }
                match moved {
                    Moved::No => mover.advance(self, &at, running, block),
                    Moved::Aside => block.x = running.next,
                    Moved::Yes => {}
                }
                running.plant_t = plants.next_time(running.plant_t, k, plant_dt);
                running.t = self.schedule.next_time(t, k, dt);
            }
        }
        worst
    }

    /// All samples of a block.
    #[inline(always)]
    fn block<M: Mover<T, P, S>>(
        &self,
        mover: &mut M,
        first_run: u64,
        mut block: BlockOf<T, P, M::Memory>,
        metrics: &mut LaneMetrics<'_, T>,
        stop: impl Fn() -> bool,
    ) -> BlockOf<T, P, M::Memory> {
        let bound = T::from_f64(DIVERGED);
        let mut running = Running {
            measurement: Streams::new(self.seed, first_run, Channel::Measurement),
            process: Streams::new(self.seed, first_run, Channel::Process),
            given: Aligned((
                P::Output::zero().in_columns::<LANES>(),
                P::Input::zero().in_columns::<LANES>(),
            )),
            next: block.x,
            t: T::ZERO,
            plant_t: T::ZERO,
        };
        let mut dead = Lane([false; LANES]);
        let lives = |block: &BlockOf<T, P, M::Memory>, lane| {
            within::<T, P::State, M::Memory>(block, lane, bound)
        };
        for lane in 0..LANES {
            if !lives(&block, lane) {
                (dead.0[lane], block.sound.0[lane]) = (true, 0);
            }
        }
        // fewer where each sample takes many substeps, so that `stop` is asked often
        let long = (SPAN / u64::from(self.substeps.max(1))).max(1);
        let (mut k, mut length, mut careful_until) = (0, long, 0);
        while k <= self.steps && dead != Lane([true; LANES]) && !stop() {
            let to = k.saturating_add(length).min(self.steps.saturating_add(1));
            let (ran, stood) = (running, block);
            metrics.begin(k, to);
            let worst = self.span(mover, (k, to), &mut running, &mut block, metrics, &dead);
            let mut fell = Lane([false; LANES]);
            for lane in 0..LANES {
                let stands = worst.0[lane] <= bound && lives(&block, lane);
                fell.0[lane] = !dead.0[lane] && !stands;
            }
            if to - k > 1 && fell != Lane([false; LANES]) {
                (running, block) = (ran, stood);
                metrics.undo();
                (length, careful_until) = (1, to);
                continue;
            }
            if dead != Lane([false; LANES]) {
                metrics.undo_where(&dead);
                put_back::<T, P::State, M::Memory>(&mut block, &stood, &dead);
            }
            for lane in 0..LANES {
                if fell.0[lane] {
                    (dead.0[lane], block.sound.0[lane]) = (true, to);
                }
            }
            k = to;
            length = if k < careful_until { 1 } else { long };
        }
        for lane in 0..LANES {
            if !dead.0[lane] {
                block.sound.0[lane] = k;
            }
        }
        block
    }

    /// [`Experiment::sampled`] for the runs `first_run` to `first_run + LANES − 1`. `stop` is asked
    /// before every 64th substep or so whether to end early. [`Draw::Samples`] are the same for all
    /// runs.
    #[inline(always)]
    pub fn sampled_block<O>(
        &self,
        observer: &O,
        first_run: u64,
        block: BlockOf<T, P, O::State>,
        metrics: &mut LaneMetrics<'_, T>,
        stop: impl Fn() -> bool,
    ) -> BlockOf<T, P, O::State>
    where
        O: Observer<T, Measurement = P::Output, Input = P::Input>,
    {
        // a copy of our own: nothing that is written can be what it holds
        let observer = *observer;
        (*self).block(&mut Sampled(&observer), first_run, block, metrics, stop)
    }

    /// [`Experiment::joint`] for the runs `first_run` to `first_run + LANES − 1`; `stop` as above. The
    /// noise must have no sines, which would be taken within each step.
    #[inline(always)]
    pub fn joint_block<L>(
        &self,
        law: &L,
        integrator: Integrator,
        first_run: u64,
        block: BlockOf<T, P, L::State>,
        metrics: &mut LaneMetrics<'_, T>,
        stop: impl Fn() -> bool,
    ) -> BlockOf<T, P, L::State>
    where
        L: ContinuousLaw<T, Input = P::Input>,
        P: Plant<T, Output = T>,
    {
        let law = *law;
        (*self).block(&mut Joint(&law, integrator), first_run, block, metrics, stop)
    }
}

impl<T: Scalar, P, S: Schedule<T>, const X: usize> Experiment<'_, T, P, S>
where
    P: Plant<T, Output = T, State = SVector<T, X>>,
{
    /// [`Experiment::sampled_block`] or [`Experiment::joint_block`] with plant and observer as
    /// programs. The plant of the experiment says how large its state is, and no more.
    #[inline(always)]
    pub fn programs_block<const Z: usize>(
        &self,
        mut programs: Programs<'_, T, Z>,
        first_run: u64,
        block: BlockOf<T, P, SVector<T, Z>>,
        metrics: &mut LaneMetrics<'_, T>,
        stop: impl Fn() -> bool,
    ) -> BlockOf<T, P, SVector<T, Z>> {
        (*self).block(&mut programs, first_run, block, metrics, stop)
    }
}

/// [`coupled_paths`](crate::simulate::coupled_paths) for the runs `first_run` to
/// `first_run + LANES − 1`: where the coarse and the fine paths end. `stop` is asked before every
/// 64th fine step or so.
#[allow(clippy::too_many_arguments)]
#[inline(always)]
pub fn coupled_block<T: Scalar, P: Plant<T>>(
    plant: &P,
    scheme: StochasticIntegrator,
    fine_scheme: StochasticIntegrator,
    x0: Columns<T, P::State>,
    t_end: T,
    (coarse, fine): (u32, u32),
    (seed, first_run): (u64, u64),
    stop: impl Fn() -> bool,
) -> [Columns<T, P::State>; 2] {
    let h_coarse = t_end / T::from_f64(f64::from(coarse));
    let h = h_coarse / T::from_f64(f64::from(fine));
    let mut streams = Streams::new(seed, first_run, Channel::Process);
    let (mut x_coarse, mut x_fine) = (Aligned(x0), Aligned(x0));
    let mut inputs = Aligned(P::Input::zero().in_columns::<LANES>());
    for i in 0..coarse {
        let t = T::from_f64(f64::from(i)) * h_coarse;
        for lane in 0..LANES {
            let x = P::State::load(&x_fine.0, lane);
            plant.control(t, &x, h_coarse).store(&mut inputs.0, lane);
        }
        let [mut dw, mut dz] = [Lane([T::ZERO; LANES]); 2];
        for j in 0..fine {
            if u64::from(j).is_multiple_of(SPAN) && stop() {
                return [x_coarse.0, x_fine.0];
            }
            let time = t + T::from_f64(f64::from(j)) * h;
            let xi = streams.normal_pairs(true);
            for lane in 0..LANES {
                let xi = (T::from_f64(xi[0].0[lane]), T::from_f64(xi[1].0[lane]));
                let w = WienerIncrement::from_normals(xi, h);
                let (x, u) = (P::State::load(&x_fine.0, lane), P::Input::load(&inputs.0, lane));
                fine_scheme.step(plant, time, &x, &u, h, w).store(&mut x_fine.0, lane);
                let sum = WienerIncrement { dw: dw.0[lane], dz: dz.0[lane] }.then(w, h);
                (dw.0[lane], dz.0[lane]) = (sum.dw, sum.dz);
            }
        }
        for lane in 0..LANES {
            let w = WienerIncrement { dw: dw.0[lane], dz: dz.0[lane] };
            let (x, u) = (P::State::load(&x_coarse.0, lane), P::Input::load(&inputs.0, lane));
            scheme.step(plant, t, &x, &u, h_coarse, w).store(&mut x_coarse.0, lane);
        }
    }
    [x_coarse.0, x_fine.0]
}

/// Whether all entries of a run are finite and within a bound.
fn within<T: Scalar, X: Memory<T>, Z: Memory<T>>(
    block: &Block<Columns<T, X>, Columns<T, Z>>,
    lane: usize,
    bound: T,
) -> bool {
    X::load(&block.x.0, lane).within(bound) && Z::load(&block.z.0, lane).within(bound)
}

/// Put some of the runs back to where they stood.
fn put_back<T: Scalar, X: Memory<T>, Z: Memory<T>>(
    block: &mut Block<Columns<T, X>, Columns<T, Z>>,
    stood: &Block<Columns<T, X>, Columns<T, Z>>,
    which: &Lane<bool>,
) {
    for lane in 0..LANES {
        if which.0[lane] {
            X::load(&stood.x.0, lane).store(&mut block.x.0, lane);
            Z::load(&stood.z.0, lane).store(&mut block.z.0, lane);
        }
    }
    block.undefined_at.put_back(&stood.undefined_at, which);
}
