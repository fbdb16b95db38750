//! Floor 2. Experiments with many runs: threads, interruption, results as arrays.

use crate::errors::{Result, refused};
use crate::interrupt::StopFlag;
use crate::values::matrix;
use hgo_ir::choices::Manner;
use hgo_ir::recursion::AnyObserver;
use hgo_ir::systems::AnyPlant;
use hgo_ir::{Numbers, Spec};
use hgo_rs::ensemble::{Block, Columns};
use hgo_rs::integrate::{Integrator, PlantScheme};
use hgo_rs::lanes::{LANES, Lane, LaneMetrics};
use hgo_rs::memory::Memory;
use hgo_rs::metrics::{LogHistogram, Moments, SettlingTime, Wanted, Window};
use hgo_rs::model::{Plant, StochasticIntegrator};
use hgo_rs::noise::{Draw, Noise, Sine};
use hgo_rs::observer::{Discretisation, Hold, Measurement, Observer, RungeKutta};
use hgo_rs::schedule::{FixedStep, Schedule, StochasticApproximation};
use hgo_rs::simulate::{Experiment, Finish, Probe, RunMetrics, Sample};
use hgo_rs::vectors::Vectors;
use nalgebra::SVector;
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use std::slice::ChunksExactMut;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

pub const NO_PLANT: &str = "this observer's order fits none of the plants: simulate takes \
    observers of order 2 (lee, sanfelice-praly, van-der-pol), 5 (crackle) or the ship's";

/// An observer, and its studies beside the papers' plants.
pub trait Studied: Send + Sync {
    fn law(&self) -> &dyn AnyObserver;
    fn study(&self, plan: &Plan, stop: &StopFlag) -> Result<StudyResult>;
}

/// Studies of tables begin elsewhere, with the plant's table too.
impl Studied for Box<dyn AnyObserver> {
    fn law(&self) -> &dyn AnyObserver {
        &**self
    }
    fn study(&self, _: &Plan, _: &StopFlag) -> Result<StudyResult> {
        Err(refused("this computation takes the papers' plants and observers only"))
    }
}

/// A schedule chosen at run time.
#[derive(Clone, Copy)]
pub enum AnySchedule {
    Fixed(FixedStep<f64>),
    Decreasing(StochasticApproximation<f64>),
}

impl Schedule<f64> for AnySchedule {
    #[inline(always)]
    fn dt(&self, k: u64) -> f64 {
        match self {
            Self::Fixed(schedule) => schedule.dt(k),
            Self::Decreasing(schedule) => schedule.dt(k),
        }
    }
    #[inline(always)]
    fn next_time(&self, t: f64, k: u64, dt: f64) -> f64 {
        match self {
            Self::Fixed(schedule) => schedule.next_time(t, k, dt),
            Self::Decreasing(schedule) => schedule.next_time(t, k, dt),
        }
    }
}

impl AnySchedule {
    fn read(spec: &Spec<'_>) -> Result<Self> {
        let kind = spec.text("kind")?;
        match kind.as_str() {
            "fixed" => {
                spec.only(&["kind", "dt"])?;
                Ok(Self::Fixed(FixedStep::new(spec.f64("dt")?)?))
            }
            "stochastic-approximation" => {
                spec.only(&["kind", "alpha", "epsilon", "k0", "p"])?;
                Ok(Self::Decreasing(StochasticApproximation::new(
                    spec.f64("alpha")?,
                    spec.f64("epsilon")?,
                    spec.f64("k0")?,
                    spec.f64("p")?,
                )?))
            }
            other => {
                Err(spec.unknown("kind", other, &["fixed", "stochastic-approximation"]).into())
            }
        }
    }
}

enum DrawKind {
    None,
    Uniform(f64, f64),
    Normal(f64, f64),
    /// All values, and how many belong to one run (0: all runs share them).
    Samples(Arc<Numbers>, usize),
}

/// An experiment as it was asked for.
pub struct Plan {
    pub plant: AnyPlant,
    joint: bool,
    pub plant_scheme: PlantScheme,
    plant_method: String,
    pub substeps: u32,
    pub schedule: AnySchedule,
    pub plant_schedule: Option<AnySchedule>,
    draw: DrawKind,
    hold: u64,
    sines: Vec<Sine<f64>>,
    pub steps: u64,
    runs: usize,
    seed: u64,
    first_run: u64,
    pub windows: Vec<Window>,
    wanted: Wanted,
    settle: Option<f64>,
    histogram: Option<Window>,
    every: u64,
    pub x0: Vec<f64>,
    pub memory0: Vec<f64>,
    memory_len: usize,
}

/// Names of the metrics that can be asked for.
const METRICS: [&str; 4] = ["mean", "rms", "max", "peak"];

fn read_wanted(spec: &Spec<'_>) -> Result<Wanted> {
    let Some(names) = spec.texts("metrics")? else { return Ok(Wanted::ALL) };
    if let Some(unknown) = names.iter().find(|name| !METRICS.contains(&name.as_str())) {
        return Err(spec.unknown("metrics", unknown, &METRICS).into());
    }
    let [mean, rms, max, peak] = METRICS.map(|name| names.iter().any(|given| given == name));
    Ok(Wanted { mean, rms, max, peak })
}

fn window(values: &[f64], name: &str) -> Result<Window> {
    match values {
        [from, to] if *from >= 0.0 && to > from && from.fract() == 0.0 && to.fract() == 0.0 =>
        {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            Ok(Window { from: *from as u64, to: *to as u64 })
        }
        other => Err(refused(&format!(
            "{name} = {other:?} is not allowed: a window is [first step, one past the last step]"
        ))),
    }
}

impl Plan {
    const KEYS: [&'static str; 19] = [
        "plant",
        "observer",
        "mode",
        "steps",
        "schedule",
        "plant_schedule",
        "plant_method",
        "substeps",
        "x0",
        "memory0",
        "noise",
        "runs",
        "seed",
        "first_run",
        "windows",
        "metrics",
        "settle",
        "histogram",
        "every",
    ];

    /// From a spec, for an observer of `memory_len` entries; `also` are keys that the caller reads.
    pub fn read(spec: &Spec<'_>, memory_len: usize, also: &[&str]) -> Result<Self> {
        spec.only(&[&Self::KEYS, also].concat())?;
        let plant = AnyPlant::read(&spec.sub("plant")?)?;
        let mode = spec.text_or("mode", "sampled")?;
        let joint = match mode.as_str() {
            "sampled" => false,
            "joint" => true,
            other => return Err(spec.unknown("mode", other, &["sampled", "joint"]).into()),
        };
        let method = spec.text_or("plant_method", "euler")?;
        let runs = spec.whole_or("runs", 1)?;
        let runs = usize::try_from(runs).ok().filter(|r| *r >= 1).ok_or_else(|| {
            refused(&format!("runs = {runs} is not allowed: it must be at least 1"))
        })?;
        let steps = spec.whole("steps")?;
        if steps == 0 {
            return Err(refused("steps = 0 is not allowed: it must be at least 1"));
        }
        let (draw, hold, sines) = match spec.get("noise") {
            None => (DrawKind::None, 1, Vec::new()),
            Some(_) => Self::read_noise(&spec.sub("noise")?, runs, steps)?,
        };
        let mut windows = Vec::new();
        if spec.has("windows") {
            let given = spec.numbers("windows")?;
            if !given.values.is_empty() && !matches!(given.shape.as_slice(), [_, 2]) {
                return Err(refused(&format!(
                    "windows have shape {:?}; they must be (W, 2)",
                    given.shape
                )));
            }
            for pair in given.values.chunks(2) {
                windows.push(window(pair, "windows")?);
            }
        }
        let histogram = match spec.get("histogram") {
            None => None,
            Some(_) => Some(window(&spec.numbers("histogram")?.values, "histogram")?),
        };
        let settle = match spec.get("settle") {
            None => None,
            Some(_) => Some(hgo_rs::error::positive("settle", spec.f64("settle")?)?),
        };
        let memory0 = spec.rows("memory0", memory_len, runs)?;
        Ok(Self {
            plant,
            joint,
            plant_scheme: read_plant_scheme(spec, &method)?,
            plant_method: method,
            substeps: u32::try_from(spec.whole_or("substeps", 1)?).unwrap_or(u32::MAX),
            schedule: AnySchedule::read(&spec.sub("schedule")?)?,
            plant_schedule: match spec.get("plant_schedule") {
                None => None,
                Some(_) => Some(AnySchedule::read(&spec.sub("plant_schedule")?)?),
            },
            draw,
            hold,
            sines,
            steps,
            runs,
            seed: spec.whole_or("seed", 0)?,
            first_run: spec.whole_or("first_run", 0)?,
            windows,
            wanted: read_wanted(spec)?,
            settle,
            histogram,
            every: spec.whole_or("every", 0)?,
            x0: spec.rows("x0", plant.len(), runs)?,
            memory0,
            memory_len,
        })
    }

    fn read_noise(
        spec: &Spec<'_>,
        runs: usize,
        steps: u64,
    ) -> Result<(DrawKind, u64, Vec<Sine<f64>>)> {
        let kind = spec.text("kind")?;
        let finite =
            |key: &'static str| -> Result<f64> { Ok(hgo_rs::error::finite(key, spec.f64(key)?)?) };
        let draw = match kind.as_str() {
            "none" => DrawKind::None,
            "uniform" => {
                let (low, high) = (finite("low")?, finite("high")?);
                hgo_rs::error::require("high", high, high >= low, "it must be at least low")?;
                DrawKind::Uniform(low, high)
            }
            "normal" => {
                let std = finite("std")?;
                hgo_rs::error::require("std", std, std >= 0.0, "it must be at least 0")?;
                DrawKind::Normal(hgo_rs::error::finite("mean", spec.f64_or("mean", 0.0)?)?, std)
            }
            "samples" => {
                let given = spec.numbers("values")?;
                let per_run = match given.shape.as_slice() {
                    [_] => 0,
                    [rows, columns] if *rows == runs => *columns,
                    other => {
                        return Err(refused(&format!(
                            "noise values have shape {other:?}; they must be (steps + 1,) or \
                             ({runs}, steps + 1)"
                        )));
                    }
                };
                DrawKind::Samples(given, per_run)
            }
            other => {
                return Err(spec
                    .unknown("kind", other, &["none", "uniform", "normal", "samples"])
                    .into());
            }
        };
        spec.only(match draw {
            DrawKind::None => &["kind", "hold", "sines"],
            DrawKind::Uniform(..) => &["kind", "hold", "sines", "low", "high"],
            DrawKind::Normal(..) => &["kind", "hold", "sines", "mean", "std"],
            DrawKind::Samples(..) => &["kind", "hold", "sines", "values"],
        })?;
        let mut sines = Vec::new();
        if spec.has("sines") {
            for row in spec.numbers("sines")?.values.chunks(3) {
                match row {
                    [amplitude, omega, phase] if row.iter().all(|v| v.is_finite()) => {
                        sines.push(Sine { amplitude: *amplitude, omega: *omega, phase: *phase });
                    }
                    other => {
                        return Err(refused(&format!(
                            "sines row {other:?} is not allowed: give finite amplitude, omega in \
                             rad/s, phase in rad"
                        )));
                    }
                }
            }
        }
        let hold = spec.whole_or("hold", 1)?;
        if hold == 0 {
            return Err(refused("hold = 0 is not allowed: a draw is held for at least 1 step"));
        }
        if let DrawKind::Samples(values, per_run) = &draw {
            let given = if *per_run == 0 { values.values.len() } else { *per_run } as u64;
            let needed = steps / hold + 1;
            if given < needed {
                return Err(refused(&format!(
                    "noise values: {given} a run are too few for {steps} steps; give {needed}"
                )));
            }
        }
        Ok((draw, hold, sines))
    }

    /// Variance of a noise that is white with mean zero.
    pub fn noise_variance(&self) -> Option<f64> {
        let plain = self.hold == 1 && self.sines.is_empty();
        match self.draw {
            DrawKind::Uniform(low, high) if plain && (low + high).abs() < 1e-12 * high.abs() => {
                Some((high - low) * (high - low) / 12.0)
            }
            DrawKind::Normal(mean, std) if plain && mean.abs() < 1e-12 * std => Some(std * std),
            _ => None,
        }
    }

    /// The noise of the runs from `run` on.
    fn noise(&self, run: usize) -> Noise<'_, f64> {
        let draw = match &self.draw {
            DrawKind::None => Draw::None,
            DrawKind::Uniform(low, high) => Draw::Uniform { low: *low, high: *high },
            DrawKind::Normal(mean, std) => Draw::Normal { mean: *mean, std: *std },
            DrawKind::Samples(values, 0) => Draw::Samples(&values.values),
            DrawKind::Samples(values, per_run) => {
                let values = values.values.get(run * per_run..).unwrap_or(&[]);
                Draw::RunSamples { values, draws: *per_run }
            }
        };
        Noise { draw, hold: self.hold, sines: &self.sines }
    }

    /// Entries of the observer's memory.
    pub fn memory_len(&self) -> usize {
        self.memory_len
    }

    /// Whether plant and observer are one differential equation.
    pub fn is_joint(&self) -> bool {
        self.joint
    }

    /// The integrator of a joint study, from the observer's spec.
    pub fn joint_integrator(&self, observer: &Spec<'_>) -> Result<Option<Integrator>> {
        if !self.joint {
            return Ok(None);
        }
        let scheme = Manner::read(observer)?.whole().ok_or_else(|| refused(PREDICTOR_ONLY))?;
        joint_integrator(scheme).map(Some)
    }

    /// The sines of the noise.
    pub fn sines(&self) -> &[Sine<f64>] {
        &self.sines
    }

    /// Whether the noise is drawn only.
    pub fn has_no_sines(&self) -> bool {
        self.sines.is_empty()
    }

    /// Whether there are runs for a block, and no frames are asked for, which only single runs give.
    pub fn fits_lanes(&self) -> bool {
        self.runs >= LANES / 4 && self.every == 0
    }

    /// All runs of the experiment with `plant`, a block at a time; `kept` entries of the memory have
    /// metrics, `go` performs a block. `None` if this processor cannot.
    pub fn execute_blocks<P, Z>(
        &self,
        plant: P,
        kept: usize,
        go: impl Fn(
            Vectors,
            &Experiment<'_, f64, P, AnySchedule>,
            u64,
            BlockOf<P::State, Z>,
            &mut LaneMetrics<'_, f64>,
        ) -> Option<BlockOf<P::State, Z>>
        + Sync,
    ) -> Option<Result<StudyResult>>
    where
        P: Plant<f64> + Send + Sync,
        Z: Memory<f64>,
    {
        let vectors = match vectors(self).and_then(|vectors| {
            self.check(plant)?;
            Ok(vectors)
        }) {
            Ok(vectors) => vectors?,
            Err(error) => return Some(Err(error)),
        };
        // Whole numbers: the sum does not depend on the order in which blocks end.
        let bins = if self.histogram.is_some() { LogHistogram::BINS } else { 0 };
        let pooled: Vec<AtomicU64> = (0..bins).map(|_| AtomicU64::new(0)).collect();
        let one = |number: usize| -> Option<Vec<RunResult>> {
            let first = number * LANES;
            let length = LaneMetrics::<f64>::buffer(self.windows.len(), kept, self.wanted);
            let mut buffers = vec![Lane([0.0; LANES]); 2 * length];
            let (now, before) = buffers.split_at_mut(length);
            let (windows, wanted) = (&self.windows, self.wanted);
            let metrics = LaneMetrics::new(windows, kept, wanted, self.settle, [now, before])?;
            let (mut counts, mut counts_before) = (vec![0; bins], vec![0; bins]);
            let mut metrics = match self.histogram {
                None => metrics,
                Some(window) => {
                    let runs = self.runs - first;
                    metrics.with_histogram(window, runs, [&mut counts, &mut counts_before])
                }
            };
            let mut x = P::State::zero().in_columns::<LANES>();
            let mut z = Z::zero().in_columns::<LANES>();
            for lane in 0..LANES {
                // the last block is filled up with its last run
                let run = (first + lane).min(self.runs - 1);
                P::State::read(row(&self.x0, self.plant.len(), run)).store(&mut x, lane);
                Z::read(row(&self.memory0, self.memory_len, run)).store(&mut z, lane);
            }
            let index = self.first_run.wrapping_add(first as u64);
            let experiment = self.experiment(plant, first);
            let end = go(vectors, &experiment, index, Block::new(x, z), &mut metrics)?;
            let of_lane = |lane: usize| {
                let sound = end.sound.0[lane];
                let of_window = |w| (0..kept).map(move |s| (w, s));
                let all = (0..windows.len()).flat_map(of_window);
                let mut result = RunResult {
                    moments: all.map(|(w, s)| metrics.moments(w, s, lane, sound)).collect(),
                    peak: (0..kept).map(|entry| metrics.peak(entry, lane)).collect(),
                    settling_time: self.settle.map_or(f64::NAN, |_| metrics.settling_time(lane)),
                    missing: 0,
                    final_x: vec![0.0; self.plant.len()],
                    final_memory: vec![0.0; self.memory_len],
                    diverged_at: Some(sound).filter(|k| *k <= self.steps),
                    undefined_at: Some(end.undefined_at.0[lane]).filter(|k| *k != u64::MAX),
                };
                P::State::load(&end.x.0, lane).write(&mut result.final_x);
                Z::load(&end.z.0, lane).write(&mut result.final_memory);
                result
            };
            let runs = (0..LANES.min(self.runs - first)).map(of_lane).collect();
            for (sum, count) in pooled.iter().zip(counts) {
                sum.fetch_add(count, Ordering::Relaxed);
            }
            Some(runs)
        };
        let blocks = self.runs.div_ceil(LANES);
        let done: Option<Vec<Vec<RunResult>>> = (0..blocks).into_par_iter().map(one).collect();
        let runs = done?.into_iter().flatten().collect();
        let counts = pooled.into_iter().map(AtomicU64::into_inner).collect();
        let frames = Frames::default();
        Some(Ok(StudyResult { runs, signals: kept, counts, frames }))
    }

    /// Refuse what does not go together.
    fn check<P: Plant<f64>>(&self, plant: P) -> Result<()> {
        self.check_method(&plant)?;
        Ok(self.experiment(plant, 0).check()?)
    }

    /// The experiment of the runs from `run` on.
    fn experiment<P: Plant<f64>>(
        &self,
        plant: P,
        run: usize,
    ) -> Experiment<'_, f64, P, AnySchedule> {
        Experiment {
            plant,
            plant_scheme: self.plant_scheme,
            substeps: self.substeps,
            schedule: self.schedule,
            plant_schedule: self.plant_schedule,
            noise: self.noise(run),
            steps: self.steps,
            seed: self.seed,
        }
    }

    /// Refuse, by its name, a scheme that the plant does not take.
    fn check_method<P: Plant<f64>>(&self, plant: &P) -> Result<()> {
        let (fits, allowed) = match self.plant_scheme {
            PlantScheme::Held => (true, ""),
            PlantScheme::Deterministic(_) => (
                !plant.has_process_noise(),
                "the plant has process noise, which a deterministic scheme would leave out: choose \
                 euler-maruyama, milstein or taylor-1.5, or sigma = 0",
            ),
            PlantScheme::Stochastic(scheme) => (
                plant.supports(scheme),
                "a stochastic scheme needs a plant with process noise, and taylor-1.5 needs it to \
                 be additive: choose euler, rk4 or bogacki-shampine, or milstein",
            ),
        };
        if fits {
            Ok(())
        } else {
            Err(refused(&format!(
                "plant_method = {:?} is not allowed: {allowed}",
                self.plant_method
            )))
        }
    }

    /// All runs with an observer in discrete time beside a plant without input; `kept` entries of its
    /// memory are signals.
    pub fn sampled<P, O>(
        &self,
        observer: &O,
        plant: P,
        kept: usize,
        stop: &StopFlag,
    ) -> Result<StudyResult>
    where
        P: Plant<f64, Output = f64, Input = SVector<f64, 0>> + Send + Sync,
        O: Observer<f64, Measurement = f64, Input = SVector<f64, 1>> + Sync,
    {
        self.execute(plant, kept, stop, |experiment, run, x0, z0, watch| {
            experiment.sampled(observer, told_nothing, run, x0, z0, watch)
        })
    }

    /// All runs of the experiment with `plant`; `go` performs one. `kept` entries of the observer's
    /// memory are signals.
    pub fn execute<P, Z>(
        &self,
        plant: P,
        kept: usize,
        stop: &StopFlag,
        go: impl Fn(
            &Experiment<'_, f64, P, AnySchedule>,
            u64,
            P::State,
            Z,
            &mut Watch<'_>,
        ) -> Finish<P::State, Z>
        + Sync,
    ) -> Result<StudyResult>
    where
        P: Plant<f64> + Send + Sync,
        Z: Memory<f64>,
    {
        self.check(plant)?;
        // Whole numbers: the sum does not depend on the order in which runs end.
        let bins = if self.histogram.is_some() { LogHistogram::BINS } else { 0 };
        let pooled: Vec<AtomicU64> = (0..bins).map(|_| AtomicU64::new(0)).collect();
        let one = |(run, frames): (usize, FramesOfRun<'_>)| -> RunResult {
            let mut moments = vec![Moments::default(); self.windows.len() * kept];
            let mut peak = vec![0.0; kept];
            let mut counts = vec![0; bins];
            let mut watch = Watch {
                metrics: RunMetrics {
                    windows: &self.windows,
                    signals: kept,
                    moments: &mut moments,
                    peak: &mut peak,
                    settling: self.settle.map(SettlingTime::new),
                    histogram: self
                        .histogram
                        .map(|window| (window, LogHistogram::new(&mut counts))),
                },
                every: self.every,
                frames,
                stop,
                patience: (4096 / u64::from(self.substeps.max(1))).max(1),
            };
            let x0 = P::State::read(row(&self.x0, self.plant.len(), run));
            let z0 = Z::read(row(&self.memory0, self.memory_len, run));
            let index = self.first_run.wrapping_add(run as u64);
            let end = go(&self.experiment(plant, run), index, x0, z0, &mut watch);
            let settling_time =
                watch.metrics.settling.as_ref().map_or(f64::NAN, SettlingTime::time);
            let missing = watch.frames.end();
            let mut result = RunResult {
                moments,
                peak,
                settling_time,
                missing,
                final_x: vec![0.0; self.plant.len()],
                final_memory: vec![0.0; self.memory_len],
                diverged_at: end.diverged_at,
                undefined_at: end.undefined_at,
            };
            end.x.write(&mut result.final_x);
            end.z.write(&mut result.final_memory);
            for (sum, count) in pooled.iter().zip(counts) {
                sum.fetch_add(count, Ordering::Relaxed);
            }
            result
        };
        let mut frames = Frames::new(self, [self.plant.len(), self.memory_len, P::Output::LEN]);
        let runs: Vec<RunResult> =
            frames.of_runs(self.runs).into_par_iter().enumerate().map(one).collect();
        frames.close(self, runs.iter().map(|run| run.missing).min().unwrap_or(0));
        let counts = pooled.into_iter().map(AtomicU64::into_inner).collect();
        Ok(StudyResult { runs, signals: kept, counts, frames })
    }
}

/// What an observer that may have an input is told of a plant that has none.
#[allow(clippy::trivially_copy_pass_by_ref)] // the observers' drivers hand the state by reference
pub fn told_nothing(_: &SVector<f64, 0>) -> SVector<f64, 1> {
    SVector::<f64, 1>::new(0.0)
}

/// Row `run` of a table that has one row for all runs or one a run.
pub fn row(table: &[f64], columns: usize, run: usize) -> &[f64] {
    if table.len() == columns { table } else { &table[run * columns..(run + 1) * columns] }
}

const PLANT_METHODS: [&str; 7] =
    ["euler", "rk4", "bogacki-shampine", "held", "euler-maruyama", "milstein", "taylor-1.5"];

/// The schemes for plants with process noise.
pub const STOCHASTIC_METHODS: [&str; 3] = ["euler-maruyama", "milstein", "taylor-1.5"];

/// A stochastic scheme by name.
pub fn stochastic(method: &str) -> Option<StochasticIntegrator> {
    match method {
        "euler-maruyama" => Some(StochasticIntegrator::EulerMaruyama),
        "milstein" => Some(StochasticIntegrator::Milstein),
        "taylor-1.5" => Some(StochasticIntegrator::Taylor15),
        _ => None,
    }
}

fn read_plant_scheme(spec: &Spec<'_>, method: &str) -> Result<PlantScheme> {
    Ok(match method {
        "held" => PlantScheme::Held,
        "euler" => PlantScheme::Deterministic(Integrator::Euler),
        "rk4" => PlantScheme::Deterministic(Integrator::Rk4),
        "bogacki-shampine" => PlantScheme::Deterministic(Integrator::BogackiShampine),
        other => match stochastic(other) {
            Some(scheme) => PlantScheme::Stochastic(scheme),
            None => return Err(spec.unknown("plant_method", other, &PLANT_METHODS).into()),
        },
    })
}

/// Kept frames of all runs: arrays (runs, length, width), which Python gets as they are.
#[derive(Default)]
struct Frames {
    t: Vec<f64>,
    length: usize,
    /// Numbers in a frame of the plant's state, the memory and the measurement.
    widths: [usize; 3],
    values: [Vec<f64>; 3],
}

/// Frames of one run that are still to be written.
struct FramesOfRun<'a> {
    x: ChunksExactMut<'a, f64>,
    memory: ChunksExactMut<'a, f64>,
    y: ChunksExactMut<'a, f64>,
}

impl Frames {
    /// Room for all frames that are asked for.
    fn new(plan: &Plan, widths: [usize; 3]) -> Self {
        let length = plan.steps.checked_div(plan.every).map_or(0, |last| last + 1);
        let length = usize::try_from(length).unwrap_or(usize::MAX);
        let room = |width| vec![0.0; plan.runs.saturating_mul(length).saturating_mul(width)];
        Self { t: Vec::new(), length, widths, values: widths.map(room) }
    }

    /// Each run's part.
    fn of_runs(&mut self, runs: usize) -> Vec<FramesOfRun<'_>> {
        let (length, widths) = (self.length, self.widths);
        let mut rest = self.values.each_mut().map(Vec::as_mut_slice);
        let mut take = |i: usize| {
            let part = rest[i].split_off_mut(..length * widths[i]).unwrap_or_default();
            part.chunks_exact_mut(widths[i])
        };
        (0..runs).map(|_| FramesOfRun { x: take(0), memory: take(1), y: take(2) }).collect()
    }

    /// Put the times beside the frames; cut off the last ones, `missing` in every run.
    fn close(&mut self, plan: &Plan, missing: usize) {
        let (whole, length) = (self.length, self.length - missing);
        let (mut t, mut k) = (0.0, 0);
        while self.t.len() < length {
            if k % plan.every == 0 {
                self.t.push(t);
            }
            t = plan.schedule.next_time(t, k, plan.schedule.dt(k));
            k += 1;
        }
        if missing > 0 {
            for (values, width) in self.values.iter_mut().zip(self.widths) {
                for run in 1..plan.runs {
                    let start = run * whole * width;
                    values.copy_within(start..start + length * width, run * length * width);
                }
                values.truncate(plan.runs * length * width);
            }
        }
    }
}

impl FramesOfRun<'_> {
    /// Write the next frame.
    #[inline(always)]
    fn keep<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
        &mut self,
        sample: &Sample<'_, f64, X, Z, Y>,
    ) {
        if let (Some(x), Some(z), Some(y)) = (self.x.next(), self.memory.next(), self.y.next()) {
            sample.x.write(x);
            sample.z.write(z);
            sample.y.write(y);
        }
    }

    /// NaN where the run did not come; how many frames that are.
    fn end(&mut self) -> usize {
        let missing = self.x.len();
        for frames in [&mut self.x, &mut self.memory, &mut self.y] {
            frames.for_each(|frame| frame.fill(f64::NAN));
        }
        missing
    }
}

/// Metrics, frames and the user's Ctrl-C.
pub struct Watch<'a> {
    metrics: RunMetrics<'a, f64>,
    every: u64,
    frames: FramesOfRun<'a>,
    stop: &'a StopFlag,
    /// Steps between two looks at `stop`.
    patience: u64,
}

impl Probe<f64> for Watch<'_> {
    #[inline(always)]
    fn sample<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
        &mut self,
        sample: &Sample<'_, f64, X, Z, Y>,
    ) {
        self.metrics.sample(sample);
        if self.every > 0 && sample.k.is_multiple_of(self.every) {
            self.frames.keep(sample);
        }
    }
    #[inline(always)]
    fn interrupted(&mut self, k: u64) -> bool {
        k.is_multiple_of(self.patience) && self.stop.is_set()
    }
}

struct RunResult {
    moments: Vec<Moments<f64>>,
    peak: Vec<f64>,
    settling_time: f64,
    /// Frames that it did not reach.
    missing: usize,
    final_x: Vec<f64>,
    final_memory: Vec<f64>,
    diverged_at: Option<u64>,
    undefined_at: Option<u64>,
}

/// What all runs of an experiment gave.
pub struct StudyResult {
    runs: Vec<RunResult>,
    signals: usize,
    counts: Vec<u64>,
    frames: Frames,
}

#[allow(clippy::cast_possible_wrap)]
fn index_or_minus_one(index: Option<u64>) -> i64 {
    index.map_or(-1, |k| k as i64)
}

impl StudyResult {
    /// Put entry i of every plant state in the place `order[i]`.
    pub fn reorder_states(&mut self, order: &[usize]) {
        let [x, ..] = &mut self.frames.values;
        let rows = self.runs.iter_mut().map(|run| run.final_x.as_mut_slice());
        for row in rows.chain(x.chunks_exact_mut(order.len())) {
            let given = row.to_vec();
            order.iter().zip(given).for_each(|(place, value)| row[*place] = value);
        }
    }

    /// As a dict of arrays.
    pub fn into_dict<'py>(self, py: Python<'py>, plan: &Plan) -> Result<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        let shape = [self.runs.len(), plan.windows.len(), self.signals];
        let set = |key: &str, of: fn(&Moments<f64>) -> f64| -> Result<()> {
            let values: Vec<f64> =
                self.runs.iter().flat_map(|r| r.moments.iter().map(of)).collect();
            Ok(out.set_item(key, values.into_pyarray(py).reshape(shape)?)?)
        };
        let Wanted { mean, rms, max, peak } = plan.wanted;
        for (key, wanted, of) in [
            ("mean", mean, Moments::mean as fn(&Moments<f64>) -> f64),
            ("rms", rms, Moments::rms),
            ("max", max, Moments::max),
        ] {
            if wanted {
                set(key, of)?;
            }
        }
        let rows = self.runs.len();
        let flat = |of: fn(&RunResult) -> &[f64]| -> Vec<f64> {
            self.runs.iter().flat_map(|r| of(r).iter().copied()).collect()
        };
        if peak {
            out.set_item("peak", matrix(py, flat(|r| &r.peak), rows)?)?;
        }
        out.set_item("final_x", matrix(py, flat(|r| &r.final_x), rows)?)?;
        out.set_item("final_memory", matrix(py, flat(|r| &r.final_memory), rows)?)?;
        let settling: Vec<f64> = self.runs.iter().map(|r| r.settling_time).collect();
        out.set_item("settling_time", settling.into_pyarray(py))?;
        let diverged: Vec<i64> =
            self.runs.iter().map(|r| index_or_minus_one(r.diverged_at)).collect();
        out.set_item("diverged_at", diverged.into_pyarray(py))?;
        let undefined: Vec<i64> =
            self.runs.iter().map(|r| index_or_minus_one(r.undefined_at)).collect();
        out.set_item("undefined_at", undefined.into_pyarray(py))?;
        if plan.histogram.is_some() {
            let counts: Vec<i64> =
                self.counts.iter().map(|c| i64::try_from(*c).unwrap_or(i64::MAX)).collect();
            let edges: Vec<f64> = (0..=LogHistogram::BINS).map(LogHistogram::edge).collect();
            let histogram = PyDict::new(py);
            histogram.set_item("edges", edges.into_pyarray(py))?;
            histogram.set_item("counts", counts.into_pyarray(py))?;
            out.set_item("histogram", histogram)?;
        }
        if plan.every > 0 {
            let Frames { t, widths, values, .. } = self.frames;
            let length = t.len();
            out.set_item("t", t.into_pyarray(py))?;
            for ((key, values), width) in ["x", "memory", "y"].into_iter().zip(values).zip(widths) {
                out.set_item(key, values.into_pyarray(py).reshape([rows, length, width])?)?;
            }
        }
        Ok(out)
    }
}

/// A block of runs in columns.
pub type BlockOf<X, Z> = Block<Columns<f64, X>, Columns<f64, Z>>;

/// The variable that holds studies to an instruction set.
const FORCE: &str = "HGO_INSTRUCTION_SET";

/// The instructions of a study that gains from them and asks for nothing that only single runs give:
/// the widest of this processor, or those that the environment allows. `None`: one run at a time.
pub fn vectors(plan: &Plan) -> Result<Option<Vectors>> {
    let refuse = |given: &str, allowed: &str| {
        Err(refused(&format!("{FORCE} = {given:?} is not allowed: {allowed}, or leave it unset")))
    };
    let asked = match std::env::var(FORCE).as_deref() {
        Err(_) => Some(Vectors::widest()),
        Ok("plain") => None,
        Ok("baseline") => Some(Vectors::Baseline),
        Ok("avx2") => Some(Vectors::Avx2),
        Ok("avx512") => Some(Vectors::Avx512),
        Ok(other) => return refuse(other, "choose plain, baseline, avx2 or avx512"),
    };
    if let Some(vectors) = asked
        && !vectors.are_available()
    {
        return refuse(&format!("{vectors:?}").to_lowercase(), "this processor has it not");
    }
    Ok(asked.filter(|_| plan.fits_lanes()))
}

/// The integrator of plant and observer as one differential equation.
pub fn joint_integrator(scheme: Discretisation) -> Result<Integrator> {
    match scheme {
        Discretisation::Euler => Ok(Integrator::Euler),
        Discretisation::RungeKutta(RungeKutta { integrator, hold: Hold::Measurement }) => {
            Ok(integrator)
        }
        _ => Err(refused(
            "method is not allowed in mode 'joint': choose euler, rk4 or bogacki-shampine",
        )),
    }
}

pub const PREDICTOR_ONLY: &str = "mode = 'joint' is not allowed: plant and law are one differential \
    equation there, whose method is euler, rk4 or bogacki-shampine and whose timing is predictor";

pub const SAMPLED_ONLY: &str = "mode = 'joint' is not allowed: this observer is a recursion in \
    discrete time; use mode 'sampled'";
