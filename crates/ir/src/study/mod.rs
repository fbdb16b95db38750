//! Floor 10. Studies: many runs of a plant beside an observer, over their tables.
//!
//! Any plant goes with any observer. The interpreter of the tables runs a study everywhere; a [`Kernel`],
//! compiled of the same tables, takes its place where there is one, with the same bits.

mod block;
pub mod exact;
mod feedback;
mod interpreter;
mod kernel;
mod plan;
mod plants;
mod tables;

use crate::choices::Manner;
use crate::error::{Error, Result, refused};
use crate::laws::wraps;
use crate::spec::Spec;
use crate::tables::Tables;
use crate::trace::{PlacedGains, Setting};
use crate::vectors::Vectors;
use block::Frames;
pub use block::{Block, Instant, LANES, Layout, Span};
pub use feedback::Feedback;
use hgo_rs::integrate::Integrator;
use hgo_rs::metrics::{LogHistogram, Moments, Window};
use hgo_rs::observer::{Discretisation, Hold, RungeKutta};
use hgo_rs::schedule::Schedule;
use interpreter::{Interpreter, Programs};
pub use kernel::Kernel;
use kernel::Vectored;
pub use plan::{AnySchedule, DrawKind, Own, Plan, STOCHASTIC_METHODS, stochastic};
pub use plants::PlantTables;
use rand::distr::Distribution;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};
use tables::StudyTables;

const PREDICTOR_ONLY: &str = "mode = 'joint' is not allowed: plant and law are one differential \
    equation there, whose method is euler, rk4 or bogacki-shampine and whose timing is predictor";

const SAMPLED_ONLY: &str = "mode = 'joint' is not allowed: this observer is a recursion in \
    discrete time; use mode 'sampled'";

/// What a run gave.
#[derive(Clone, Debug)]
pub struct RunResult {
    /// Of each window each signal's: the errors x̂ − x, then the rest of the memory, then what is watched.
    pub moments: Vec<Moments<f64>>,
    /// Largest magnitude of each entry of the memory, then of what is watched.
    pub peak: Vec<f64>,
    /// Last time at which ‖x̂ − x‖ was at or above the threshold, in s.
    pub settling_time: f64,
    /// For each watched signal the last time at which its magnitude was at or above its threshold, in s.
    pub settled: Vec<f64>,
    /// Last state of the plant, then the feedback's columns.
    pub final_x: Vec<f64>,
    /// Last memory of the observer.
    pub final_memory: Vec<f64>,
    /// First sample at which a state was not finite or beyond [`DIVERGED`](hgo_rs::simulate::DIVERGED).
    pub diverged_at: Option<u64>,
    /// First sample at which the observer's model had no value.
    pub undefined_at: Option<u64>,
}

/// Kept frames of all runs, each (runs, length, width).
#[derive(Clone, Debug, Default)]
pub struct AllFrames {
    /// Times of the frames, in s.
    pub t: Vec<f64>,
    /// Numbers in a frame of the plant's state with the feedback's columns, the memory and the measurement.
    pub widths: [usize; 3],
    /// Plant states, memories, measurements.
    pub values: [Vec<f64>; 3],
}

/// What all runs of a study gave.
#[derive(Clone, Debug)]
pub struct StudyResult {
    /// Run by run.
    pub runs: Vec<RunResult>,
    /// Signals that have moments, what is watched among them.
    pub signals: usize,
    /// Counts of the histogram of ‖x̂ − x‖², empty without.
    pub counts: Vec<u64>,
    /// Kept frames.
    pub frames: AllFrames,
}

impl StudyResult {
    /// All its numbers as bits.
    fn bits(&self) -> Vec<u64> {
        let mut bits = self.counts.clone();
        for run in &self.runs {
            for moments in &run.moments {
                bits.extend([moments.mean(), moments.rms(), moments.max()].map(f64::to_bits));
            }
            let numbers = run.peak.iter().chain(&run.final_x).chain(&run.final_memory);
            let times = run.settled.iter().chain([&run.settling_time]);
            bits.extend(numbers.chain(times).map(|value| value.to_bits()));
            bits.extend([run.diverged_at, run.undefined_at].map(|k| k.unwrap_or(u64::MAX)));
        }
        bits.extend(self.frames.values.iter().flatten().map(|value| value.to_bits()));
        bits
    }
}

/// A study that can run.
pub struct Study {
    /// What was asked for.
    pub plan: Plan,
    /// Where the numbers of a run stand.
    pub layout: Layout,
    /// What is evaluated.
    pub tables: StudyTables,
    programs: Programs,
    /// Whether the plants' motion is the same for all runs, and so is computed once.
    pub plants_are_shared: bool,
    /// Whether no sample can be missing while the plant's state is finite: what is measured are states of
    /// the plant and noise that is a number.
    pub samples_are_there: bool,
}

impl Study {
    /// From the spec of a simulation.
    ///
    /// # Errors
    /// What is not allowed.
    pub fn read(spec: &Spec<'_>) -> Result<Self> {
        Self::of(spec, Plan::read(spec, &[])?)
    }

    /// The same, its noise drawn by a law of `rand_distr` (or any other distribution of the crate `rand`)
    /// from the stream of each run; NaN is a missing sample. All outputs of a plant have the same noise.
    /// `hold` and `sines` may stand in the spec's noise, whose kind must be "none".
    ///
    /// # Errors
    /// What is not allowed; noise of another kind.
    pub fn with_noise(
        spec: &Spec<'_>,
        law: impl Distribution<f64> + Send + Sync + 'static,
    ) -> Result<Self> {
        let plan = Plan::read(spec, &[])?;
        if !matches!(plan.draw, DrawKind::None) {
            return Err(refused(
                "noise is given twice: by the law, and by its kind in the spec, which must be \"none\"",
            ));
        }
        Self::of(spec, Plan { draw: DrawKind::Own(Own::new(law)), ..plan })
    }

    fn of(spec: &Spec<'_>, plan: Plan) -> Result<Self> {
        let of_observer = spec.sub("observer")?;
        if wraps(&of_observer) {
            return Err(refused(
                "wrap is not allowed for the observer of a simulation: leave it out; a simulated output \
                 does not wrap, and with wrap the errors would be defined up to whole turns only; while \
                 innovations are below half a turn the estimates are the same",
            ));
        }
        // gains for the length of a step are constants
        let gains = match plan.schedule {
            AnySchedule::Fixed(fixed) => PlacedGains::For(fixed.dt(0)),
            AnySchedule::Decreasing(_) => PlacedGains::Computed,
        };
        let usual = Setting::usual(false);
        let mut observer = Tables::read(&of_observer, Setting { gains, ..usual })?;
        let truth = spec.wholes("truth")?;
        let plant = PlantTables::read(&spec.sub("plant")?, plan.plant_scheme, truth)?;
        plan.check_method(plant.noisy, |scheme| plant.supports(scheme))?;
        if observer.n_y() != plant.n_y {
            return Err(refused(format!(
                "an observer of {} outputs does not fit this plant, which has {}",
                observer.n_y(),
                plant.n_y
            )));
        }
        let feedback = if spec.has("feedback") {
            Some(Feedback::read(&spec.sub("feedback")?, &plant, observer.n())?)
        } else if plant.open > 0 {
            return Err(refused(format!(
                "feedback is missing: it gives the plant's {} inputs",
                plant.open
            )));
        } else {
            None
        };
        let mut plan = plan.starting(spec, (plant.n, observer.memory_len()))?;
        let alike = plan.x0.len() == plant.n;
        if let Some(feedback) = &feedback {
            if plan.joint {
                feedback.check_joint(&plant)?;
            }
            let rows = plan.x0.chunks(plant.n.max(1));
            plan.x0 = rows.flat_map(|row| [row, &feedback.starts()].concat()).collect();
        }
        if let (PlacedGains::For(dt), true) = (gains, observer.is_current())
            && waits(&plan, &plant, observer.memory_len(), dt)
        {
            observer = Tables::read(&of_observer, usual)?;
        }
        let joint = if plan.joint { Some(integrator(&of_observer)?) } else { None };
        let tables = StudyTables::of(&plan, &observer, &plant, feedback.as_ref(), joint)?;
        let known = plant.truth.len().min(observer.n());
        let closed = feedback.as_ref();
        let layout = Layout {
            x: plant.n + closed.map_or(0, Feedback::columns),
            plant: plant.n,
            now: closed.map_or(0, Feedback::now),
            watched: closed.map_or(0, |feedback| feedback.watched),
            z: observer.memory_len(),
            y: plant.n_y,
            noises: plant.n_y * plan.ar.len().max(1),
            u: plant.n_u,
            errors: if plan.errors { observer.signals() } else { 0 },
            truth: plant.truth[..known].to_vec(),
            kinds: [plan.wanted.mean, plan.wanted.rms, plan.wanted.max],
            peaks: plan.wanted.peak,
            settle: plan.settle,
            settles: closed.map_or_else(Vec::new, |feedback| {
                let levels = feedback.settle.iter().enumerate();
                levels.filter_map(|(i, level)| Some((i, (*level)?))).collect()
            }),
        };
        let programs = Programs::of(&tables)?;
        let moves = tables.plant.as_ref().is_some_and(|plant| plant.calls.is_empty());
        let alike = alike && feedback.is_none() && plant.n_u == 0 && !tables.is_random;
        let plants_are_shared = moves && alike;
        let measured = plant.output.outputs.iter().skip(plant.n_u);
        let plain = { measured }.all(|output| *output < plant.output.inputs.len());
        let samples_are_there = plain && !plan.samples_miss();
        Ok(Self { plan, layout, tables, programs, plants_are_shared, samples_are_there })
    }

    /// All runs. `kernel` takes the interpreter's place where there is one; `stop` is asked now and then
    /// whether to end early.
    ///
    /// # Errors
    /// An instruction set that this processor has not; a function of the user's that failed.
    pub fn run(
        &self,
        kernel: Option<&dyn Kernel>,
        stop: &(dyn Fn() -> bool + Sync),
    ) -> Result<StudyResult> {
        let vectors = Vectors::asked()?;
        let few = self.plan.runs < LANES / 4 || self.tables.calls();
        let Some(vectors) = vectors.filter(|_| !few) else {
            return self.in_blocks::<1>(|first, counts, frames| {
                block::run::<1, _>(self, &mut Interpreter::new(self), first, counts, frames, stop)
            });
        };
        self.in_blocks::<LANES>(|first, counts, frames| {
            let (layout, interpreter) = (&self.layout, Interpreter::new(self));
            let mut engine = Vectored { kernel, layout, interpreter, vectors };
            block::run(self, &mut engine, first, counts, frames, stop)
        })
    }

    /// Whether a kernel gives the interpreter's bits: for every number of windows that may be open, the
    /// first runs over some samples by both.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn agrees(&mut self, kernel: &dyn Kernel) -> Result<bool> {
        const SAMPLES: u64 = 96;
        let whole = self.plan.clone();
        let runs = whole.runs.min(LANES);
        let rows =
            |table: &[f64], columns: usize| table.get(..runs * columns).unwrap_or(table).to_vec();
        let steps = whole.steps.min(SAMPLES);
        let mut agree = true;
        for (open, distances) in self.forms() {
            let window = |is_open: bool| Window { from: 0, to: if is_open { steps } else { 0 } };
            self.plan = Plan {
                steps,
                runs,
                x0: rows(&whole.x0, self.layout.x),
                memory0: rows(&whole.memory0, self.layout.z),
                windows: (0..whole.windows.len()).map(|i| window(i < open)).collect(),
                histogram: whole.histogram.map(|_| window(distances)),
                ..whole.clone()
            };
            let never = || false;
            let results = (self.run(None, &never), self.run(Some(kernel), &never));
            agree &= match &results {
                (Ok(ours), Ok(other)) => ours.bits() == other.bits(),
                _ => false,
            };
            if let (Err(error), _) | (_, Err(error)) = results {
                self.plan = whole;
                return Err(error);
            }
        }
        self.plan = whole;
        Ok(agree)
    }

    /// Whether a sample needs what stood in a column of the state before it.
    pub(crate) fn needs(&self, column: usize) -> bool {
        let sample = &self.tables.sample;
        let given = sample.inputs.len() - self.layout.y - self.layout.x + column;
        let depends = sample.depends(|input| input == given);
        sample.outputs.iter().any(|output| depends[*output])
    }

    /// Runs in blocks of L, which `go` moves: from the first run of each, with the counts of its
    /// histogram and room for its frames.
    fn in_blocks<const L: usize>(
        &self,
        go: impl Fn(usize, &mut [u64], Option<Frames<'_>>) -> Result<(Vec<RunResult>, usize)> + Sync,
    ) -> Result<StudyResult> {
        let plan = &self.plan;
        // whole numbers: the sum does not depend on the order in which blocks end
        let bins = if plan.histogram.is_some() { LogHistogram::BINS } else { 0 };
        let pooled: Vec<AtomicU64> = (0..bins).map(|_| AtomicU64::new(0)).collect();
        let mut frames = self.frames();
        let length = self.frame_count();
        let one = |(number, frames): (usize, Option<Frames<'_>>)| {
            let mut counts = vec![0; bins];
            let made = go(number * L, &mut counts, frames)?;
            for (sum, count) in pooled.iter().zip(counts) {
                sum.fetch_add(count, Ordering::Relaxed);
            }
            Ok::<_, Error>(made)
        };
        let blocks = parts(&mut frames, (length, plan.runs, L));
        let done: Result<Vec<_>> = blocks.into_par_iter().enumerate().map(one).collect();
        let done = done?;
        let reached = done.iter().map(|(_, frames)| *frames).max().unwrap_or(0);
        let runs = done.into_iter().flat_map(|(runs, _)| runs).collect();
        self.close(&mut frames, (length, reached));
        let counts = pooled.into_iter().map(AtomicU64::into_inner).collect();
        Ok(StudyResult { runs, signals: self.layout.signals(), counts, frames })
    }

    /// Frames of a run.
    fn frame_count(&self) -> usize {
        let last = self.plan.steps.checked_div(self.plan.every);
        last.map_or(0, |last| usize::try_from(last.saturating_add(1)).unwrap_or(usize::MAX))
    }

    /// Room for all frames: NaN where a run does not come.
    fn frames(&self) -> AllFrames {
        let widths = [self.layout.x, self.layout.z, self.layout.y];
        let runs = self.plan.runs.saturating_mul(self.frame_count());
        AllFrames {
            t: Vec::new(),
            widths,
            values: widths.map(|width| vec![f64::NAN; runs.saturating_mul(width)]),
        }
    }

    /// Put the times beside the frames; cut off those that no run reached.
    fn close(&self, frames: &mut AllFrames, (whole, length): (usize, usize)) {
        let (plan, mut t, mut k) = (&self.plan, 0.0, 0);
        while frames.t.len() < length {
            if k % plan.every == 0 {
                frames.t.push(t);
            }
            t = plan.schedule.next_time(t, k, plan.schedule.dt(k));
            k += 1;
        }
        if length < whole {
            for (values, width) in frames.values.iter_mut().zip(frames.widths) {
                for run in 1..plan.runs {
                    let start = run * whole * width;
                    values.copy_within(start..start + length * width, run * length * width);
                }
                values.truncate(plan.runs * length * width);
            }
        }
    }
}

/// The frames of each block of L runs, as parts that can be written side by side.
fn parts(
    frames: &mut AllFrames,
    (length, runs, lanes): (usize, usize, usize),
) -> Vec<Option<Frames<'_>>> {
    let blocks = runs.div_ceil(lanes);
    if length == 0 {
        return (0..blocks).map(|_| None).collect();
    }
    let widths = frames.widths;
    let [x, z, y] = frames.values.each_mut().map(Vec::as_mut_slice);
    let mut of_runs = [x, z, y].map(|values| values);
    let mut take = |i: usize| {
        let rest = std::mem::take(&mut of_runs[i]);
        let (part, rest) = rest.split_at_mut(length * widths[i]);
        of_runs[i] = rest;
        part
    };
    let mut all: Vec<[&mut [f64]; 3]> = (0..runs).map(|_| [take(0), take(1), take(2)]).collect();
    let mut blocks = Vec::new();
    while !all.is_empty() {
        let rest = all.split_off(lanes.min(all.len()));
        blocks.push(Some(Frames { runs: std::mem::replace(&mut all, rest) }));
    }
    blocks
}

/// Whether a correction may be for another time than a step: one after missing samples is for all the
/// time since the last sample.
fn waits(plan: &Plan, plant: &PlantTables, memory: usize, dt: f64) -> bool {
    let rows = plan.memory0.chunks_exact(memory.max(1));
    let mut starts = rows.filter_map(|row| row.last());
    plan.samples_miss()
        || plant.output.may_lack_value()
        || !starts.all(|elapsed| [0.0, dt].contains(elapsed))
}

/// The integrator of plant and observer as one differential equation.
fn integrator(observer: &Spec<'_>) -> Result<Integrator> {
    match Manner::read(observer)?.whole().ok_or_else(|| refused(PREDICTOR_ONLY))? {
        Discretisation::Euler => Ok(Integrator::Euler),
        Discretisation::RungeKutta(RungeKutta { integrator, hold: Hold::Measurement }) => {
            Ok(integrator)
        }
        _ => Err(refused(
            "method is not allowed in mode 'joint': choose euler, rk4 or bogacki-shampine",
        )),
    }
}
