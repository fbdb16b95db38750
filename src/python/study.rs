//! Experiments with many runs: threads, interruption, results as arrays.

use super::errors::refused;
use super::observers::{
    AnyObserver, build, matrix, read_crackle, read_lee, read_sanfelice_praly, read_ship,
    read_van_der_pol,
};
use super::spec::{Spec, numbers};
use crate::covariance::ErrorCovariance;
use crate::gain::ConstantGain;
use crate::integrate::{Integrator, PlantScheme};
use crate::memory::Memory;
use crate::metrics::{LogHistogram, Moments, SettlingTime, Window};
use crate::model::{Plant, StochasticIntegrator, Unknown};
use crate::models::{Correction, Crackle, Lee, SanfelicePraly, Ship, VanDerPol};
use crate::noise::{Channel, Draw, Noise, SecondOrderSections, Sine, Stream};
use crate::observer::{
    ContinuousLaw, Discretisation, Discretised, Euler, Hold, Measurement, RungeKutta,
};
use crate::observers::{ReducedOrderObserver, SampledDataObserver, StandardObserver};
use crate::schedule::{FixedStep, Schedule, StochasticApproximation};
use crate::simulate::{Experiment, Finish, Probe, RunMetrics, Sample, coupled_paths as couple};
use nalgebra::{SVector, Vector2};
use numpy::{IntoPyArray, PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;
use std::time::Duration;

pub const NO_PLANT: &str = "this observer's order fits none of the plants: simulate takes \
    observers of order 2 (lee, sanfelice-praly, van-der-pol), 5 (crackle) or the ship's";

/// Set when the user interrupts.
pub struct StopFlag(AtomicBool);

impl StopFlag {
    #[inline(always)]
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Run `work` without the interpreter lock; Ctrl-C stops it.
pub fn interruptible<R: Send>(
    py: Python<'_>,
    work: impl FnOnce(&StopFlag) -> PyResult<R> + Send,
) -> PyResult<R> {
    let stop = StopFlag(AtomicBool::new(false));
    let (result, signal) = py.detach(|| {
        std::thread::scope(|scope| {
            let (done, finished) = mpsc::channel::<()>();
            let stop = &stop;
            let worker = scope.spawn(move || {
                let result = work(stop);
                drop(done);
                result
            });
            let mut signal = Ok(());
            while matches!(
                finished.recv_timeout(Duration::from_millis(50)),
                Err(mpsc::RecvTimeoutError::Timeout)
            ) {
                if signal.is_ok() {
                    #[allow(clippy::redundant_closure_for_method_calls)]
                    // its lifetime does not unify
                    let checked = Python::attach(|py| py.check_signals());
                    signal = checked;
                    if signal.is_err() {
                        stop.0.store(true, Ordering::Relaxed);
                    }
                }
            }
            (worker.join(), signal)
        })
    });
    signal?;
    result.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
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
    fn read(spec: &Spec<'_>) -> PyResult<Self> {
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
            other => Err(spec.unknown("kind", other, &["fixed", "stochastic-approximation"])),
        }
    }
}

/// The papers' plants.
#[derive(Clone, Copy)]
pub enum AnyPlant {
    Lee(Lee),
    SanfelicePraly(SanfelicePraly<f64>),
    VanDerPol(VanDerPol<f64>),
    Crackle(Crackle<f64>),
    Ship(Ship<f64>),
}

impl AnyPlant {
    fn read(spec: &Spec<'_>) -> PyResult<Self> {
        let kind = spec.text("kind")?;
        Ok(match kind.as_str() {
            "lee" => Self::Lee(read_lee(spec)?),
            "sanfelice-praly" => Self::SanfelicePraly(read_sanfelice_praly(spec)?),
            "van-der-pol" => Self::VanDerPol(read_van_der_pol(spec, Correction::Derived)?),
            "crackle" => Self::Crackle(read_crackle(spec)?),
            "ship" => Self::Ship(read_ship(spec)?),
            other => {
                let known = ["lee", "sanfelice-praly", "van-der-pol", "crackle", "ship"];
                return Err(spec.unknown("kind", other, &known));
            }
        })
    }

    fn len(&self) -> usize {
        match self {
            Self::Lee(_) | Self::SanfelicePraly(_) | Self::VanDerPol(_) => 2,
            Self::Crackle(_) => 5,
            Self::Ship(_) => 6,
        }
    }
}

enum DrawKind {
    None,
    Uniform(f64, f64),
    Normal(f64, f64),
    /// All values, and how many belong to one run (0: all runs share them).
    Samples(Vec<f64>, usize),
}

/// An experiment as it was asked for.
pub struct Plan {
    plant: AnyPlant,
    joint: bool,
    plant_scheme: PlantScheme,
    substeps: u32,
    schedule: AnySchedule,
    plant_schedule: Option<AnySchedule>,
    draw: DrawKind,
    hold: u64,
    sines: Vec<Sine<f64>>,
    steps: u64,
    runs: usize,
    seed: u64,
    first_run: u64,
    windows: Vec<Window>,
    settle: Option<f64>,
    histogram: Option<Window>,
    every: u64,
    x0: Vec<f64>,
    memory0: Vec<f64>,
    memory_len: usize,
}

fn window(values: &[f64], name: &str) -> PyResult<Window> {
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
        "variance",
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
        "settle",
        "histogram",
        "every",
    ];

    fn read(spec: &Spec<'_>, observer: &dyn AnyObserver) -> PyResult<Self> {
        spec.only(&Self::KEYS)?;
        let plant = AnyPlant::read(&spec.sub("plant")?)?;
        let mode = spec.text_or("mode", "sampled")?;
        let joint = match mode.as_str() {
            "sampled" => false,
            "joint" => true,
            other => return Err(spec.unknown("mode", other, &["sampled", "joint"])),
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
        let (draw, hold, sines) = match spec.get("noise")? {
            None => (DrawKind::None, 1, Vec::new()),
            Some(_) => Self::read_noise(&spec.sub("noise")?, runs)?,
        };
        let mut windows = Vec::new();
        if spec.get("windows")?.is_some() {
            let given = spec.numbers("windows")?;
            for pair in given.values.chunks(2) {
                windows.push(window(pair, "windows")?);
            }
        }
        let histogram = match spec.get("histogram")? {
            None => None,
            Some(_) => Some(window(&spec.numbers("histogram")?.values, "histogram")?),
        };
        let settle = match spec.get("settle")? {
            None => None,
            Some(_) => Some(crate::error::positive("settle", spec.f64("settle")?)?),
        };
        let memory_len = observer.initial().len();
        let memory0 = spec.rows("memory0", memory_len, runs)?;
        Ok(Self {
            plant,
            joint,
            plant_scheme: read_plant_scheme(spec, &method)?,
            substeps: u32::try_from(spec.whole_or("substeps", 1)?).unwrap_or(u32::MAX),
            schedule: AnySchedule::read(&spec.sub("schedule")?)?,
            plant_schedule: match spec.get("plant_schedule")? {
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
            settle,
            histogram,
            every: spec.whole_or("every", 0)?,
            x0: spec.rows("x0", plant.len(), runs)?,
            memory0,
            memory_len,
        })
    }

    fn read_noise(spec: &Spec<'_>, runs: usize) -> PyResult<(DrawKind, u64, Vec<Sine<f64>>)> {
        let kind = spec.text("kind")?;
        let finite =
            |key: &'static str| -> PyResult<f64> { Ok(crate::error::finite(key, spec.f64(key)?)?) };
        let draw = match kind.as_str() {
            "none" => DrawKind::None,
            "uniform" => DrawKind::Uniform(finite("low")?, finite("high")?),
            "normal" => DrawKind::Normal(finite("mean")?, finite("std")?),
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
                DrawKind::Samples(given.values, per_run)
            }
            other => {
                return Err(spec.unknown("kind", other, &["none", "uniform", "normal", "samples"]));
            }
        };
        spec.only(match draw {
            DrawKind::None => &["kind", "hold", "sines"],
            DrawKind::Uniform(..) => &["kind", "hold", "sines", "low", "high"],
            DrawKind::Normal(..) => &["kind", "hold", "sines", "mean", "std"],
            DrawKind::Samples(..) => &["kind", "hold", "sines", "values"],
        })?;
        let mut sines = Vec::new();
        if spec.get("sines")?.is_some() {
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
        Ok((draw, hold, sines))
    }

    fn noise(&self, run: usize) -> Noise<'_, f64> {
        let draw = match &self.draw {
            DrawKind::None => Draw::None,
            DrawKind::Uniform(low, high) => Draw::Uniform { low: *low, high: *high },
            DrawKind::Normal(mean, std) => Draw::Normal { mean: *mean, std: *std },
            DrawKind::Samples(values, 0) => Draw::Samples(values),
            DrawKind::Samples(values, per_run) => {
                Draw::Samples(values.get(run * per_run..(run + 1) * per_run).unwrap_or(&[]))
            }
        };
        Noise { draw, hold: self.hold, sines: &self.sines }
    }

    /// Row `run` of a table that has one row for all runs or one a run.
    fn row(table: &[f64], columns: usize, run: usize) -> &[f64] {
        if table.len() == columns { table } else { &table[run * columns..(run + 1) * columns] }
    }

    /// All runs of the experiment with `plant`; `go` performs one.
    fn execute<P, Z>(
        &self,
        plant: P,
        signals: usize,
        peaks: usize,
        stop: &StopFlag,
        go: impl Fn(
            &Experiment<'_, f64, P, AnySchedule>,
            u64,
            P::State,
            Z,
            &mut Watch<'_>,
        ) -> Finish<P::State, Z>
        + Sync,
    ) -> PyResult<StudyResult>
    where
        P: Plant<f64> + Send + Sync,
        Z: Memory<f64>,
    {
        let experiment = |run| Experiment {
            plant,
            plant_scheme: self.plant_scheme,
            substeps: self.substeps,
            schedule: self.schedule,
            plant_schedule: self.plant_schedule,
            noise: self.noise(run),
            steps: self.steps,
            seed: self.seed,
        };
        experiment(0).check()?;
        // Whole numbers: the sum does not depend on the order in which runs end.
        let bins = if self.histogram.is_some() { LogHistogram::BINS } else { 0 };
        let pooled: Vec<AtomicU64> = (0..bins).map(|_| AtomicU64::new(0)).collect();
        let one = |run: usize| -> RunResult {
            let mut moments = vec![Moments::default(); self.windows.len() * signals];
            let mut peak = vec![0.0; peaks];
            let mut counts = vec![0; bins];
            let mut watch = Watch {
                metrics: RunMetrics {
                    windows: &self.windows,
                    signals,
                    moments: &mut moments,
                    peak: &mut peak,
                    settling: self.settle.map(SettlingTime::new),
                    histogram: self
                        .histogram
                        .map(|window| (window, LogHistogram::new(&mut counts))),
                },
                every: self.every,
                frames: Frames::default(),
                stop,
            };
            let x0 = P::State::read(Self::row(&self.x0, P::State::LEN, run));
            let z0 = Z::read(Self::row(&self.memory0, Z::LEN, run));
            let index = self.first_run.wrapping_add(run as u64);
            let end = go(&experiment(run), index, x0, z0, &mut watch);
            let settling_time =
                watch.metrics.settling.as_ref().map_or(f64::NAN, SettlingTime::time);
            let frames = std::mem::take(&mut watch.frames);
            let mut result = RunResult {
                moments,
                peak,
                settling_time,
                frames,
                final_x: vec![0.0; P::State::LEN],
                final_memory: vec![0.0; Z::LEN],
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
        let runs: Vec<RunResult> = (0..self.runs).into_par_iter().map(one).collect();
        let counts = pooled.into_iter().map(AtomicU64::into_inner).collect();
        Ok(StudyResult { runs, signals, counts })
    }
}

const PLANT_METHODS: [&str; 7] =
    ["euler", "rk4", "bogacki-shampine", "held", "euler-maruyama", "milstein", "taylor-1.5"];

fn stochastic(method: &str) -> Option<StochasticIntegrator> {
    match method {
        "euler-maruyama" => Some(StochasticIntegrator::EulerMaruyama),
        "milstein" => Some(StochasticIntegrator::Milstein),
        "taylor-1.5" => Some(StochasticIntegrator::Taylor15),
        _ => None,
    }
}

fn read_plant_scheme(spec: &Spec<'_>, method: &str) -> PyResult<PlantScheme> {
    Ok(match method {
        "held" => PlantScheme::Held,
        "euler" => PlantScheme::Deterministic(Integrator::Euler),
        "rk4" => PlantScheme::Deterministic(Integrator::Rk4),
        "bogacki-shampine" => PlantScheme::Deterministic(Integrator::BogackiShampine),
        other => match stochastic(other) {
            Some(scheme) => PlantScheme::Stochastic(scheme),
            None => return Err(spec.unknown("plant_method", other, &PLANT_METHODS)),
        },
    })
}

/// Kept frames of one run.
#[derive(Default)]
struct Frames {
    t: Vec<f64>,
    x: Vec<f64>,
    memory: Vec<f64>,
    y: Vec<f64>,
}

/// Metrics, frames and the user's Ctrl-C.
struct Watch<'a> {
    metrics: RunMetrics<'a, f64>,
    every: u64,
    frames: Frames,
    stop: &'a StopFlag,
}

impl Probe<f64> for Watch<'_> {
    #[inline(always)]
    fn sample<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
        &mut self,
        sample: &Sample<'_, f64, X, Z, Y>,
    ) {
        self.metrics.sample(sample);
        if self.every > 0 && sample.k.is_multiple_of(self.every) {
            self.frames.t.push(sample.t);
            sample.x.visit(&mut |v| self.frames.x.push(v));
            sample.z.visit(&mut |v| self.frames.memory.push(v));
            sample.y.each(&mut |v| self.frames.y.push(v));
        }
    }
    #[inline(always)]
    fn interrupted(&mut self, k: u64) -> bool {
        k.is_multiple_of(4096) && self.stop.is_set()
    }
}

struct RunResult {
    moments: Vec<Moments<f64>>,
    peak: Vec<f64>,
    settling_time: f64,
    frames: Frames,
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
}

#[allow(clippy::cast_possible_wrap)]
fn index_or_minus_one(index: Option<u64>) -> i64 {
    index.map_or(-1, |k| k as i64)
}

impl StudyResult {
    fn into_dict<'py>(self, py: Python<'py>, plan: &Plan) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        let shape = [self.runs.len(), plan.windows.len(), self.signals];
        let set = |key: &str, of: fn(&Moments<f64>) -> f64| -> PyResult<()> {
            let values: Vec<f64> =
                self.runs.iter().flat_map(|r| r.moments.iter().map(of)).collect();
            out.set_item(key, values.into_pyarray(py).reshape(shape)?)
        };
        set("mean", Moments::mean)?;
        set("rms", Moments::rms)?;
        set("max", Moments::max)?;
        let rows = self.runs.len();
        let flat = |of: fn(&RunResult) -> &[f64]| -> Vec<f64> {
            self.runs.iter().flat_map(|r| of(r).iter().copied()).collect()
        };
        out.set_item("peak", matrix(py, flat(|r| &r.peak), rows)?)?;
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
            let longest = self.runs.iter().max_by_key(|r| r.frames.t.len());
            let t = longest.map_or_else(Vec::new, |r| r.frames.t.clone());
            let frames = t.len();
            out.set_item("t", t.into_pyarray(py))?;
            for (key, of) in [
                ("x", (|r| &r.frames.x) as fn(&RunResult) -> &Vec<f64>),
                ("memory", |r| &r.frames.memory),
                ("y", |r| &r.frames.y),
            ] {
                // a run that stopped early is filled up with NaN
                let full = self.runs.iter().map(|r| of(r).len()).max().unwrap_or(0);
                let mut values = Vec::with_capacity(full * rows);
                for run in &self.runs {
                    values.extend_from_slice(of(run));
                    values.resize(values.len() + full - of(run).len(), f64::NAN);
                }
                let width = full.checked_div(frames).unwrap_or(0);
                out.set_item(key, values.into_pyarray(py).reshape([rows, frames, width])?)?;
            }
        }
        Ok(out)
    }
}

type Continuous<L> = Discretised<L, Discretisation>;

/// A SISO plant with a continuous law, sampled or joint.
fn with_plant<P, L>(
    observer: &Continuous<L>,
    plant: P,
    plan: &Plan,
    stop: &StopFlag,
) -> PyResult<StudyResult>
where
    P: Plant<f64, Output = f64, Input = SVector<f64, 0>> + Send + Sync,
    L: ContinuousLaw<f64, Input = SVector<f64, 1>> + Sync,
{
    let tell = |_: &SVector<f64, 0>| SVector::<f64, 1>::new(0.0);
    let m = plan.memory_len;
    if !plan.joint {
        return plan.execute(plant, m, m, stop, |experiment, run, x0, z0, watch| {
            experiment.sampled(observer, tell, run, x0, z0, watch)
        });
    }
    let integrator = match observer.scheme {
        Discretisation::Euler => Integrator::Euler,
        Discretisation::RungeKutta(RungeKutta { integrator, hold: Hold::Measurement }) => {
            integrator
        }
        _ => {
            return Err(refused(
                "method is not allowed in mode 'joint': choose euler, rk4 or bogacki-shampine",
            ));
        }
    };
    plan.execute(plant, m, m, stop, |experiment, run, x0, z0, watch| {
        experiment.joint(&observer.law, tell, integrator, run, x0, z0, watch)
    })
}

/// Laws of order 2 with the plants of order 2.
pub fn of_order_2<L>(o: &Continuous<L>, plan: &Plan, stop: &StopFlag) -> PyResult<StudyResult>
where
    L: ContinuousLaw<f64, Input = SVector<f64, 1>> + Sync,
{
    match plan.plant {
        AnyPlant::Lee(plant) => with_plant(o, plant, plan, stop),
        AnyPlant::SanfelicePraly(plant) => with_plant(o, plant, plan, stop),
        AnyPlant::VanDerPol(plant) => with_plant(o, plant, plan, stop),
        _ => Err(refused(NO_PLANT)),
    }
}

/// Laws of order 5 with the plant of order 5.
pub fn of_order_5<L>(o: &Continuous<L>, plan: &Plan, stop: &StopFlag) -> PyResult<StudyResult>
where
    L: ContinuousLaw<f64, Input = SVector<f64, 1>> + Sync,
{
    match plan.plant {
        AnyPlant::Crackle(plant) => with_plant(o, plant, plan, stop),
        _ => Err(refused(NO_PLANT)),
    }
}

const SAMPLED_ONLY: &str = "mode = 'joint' is not allowed: this observer is a recursion in \
    discrete time; use mode 'sampled'";

pub fn of_sampled_data(
    observer: &SampledDataObserver<VanDerPol<f64>, 2>,
    plan: &Plan,
    stop: &StopFlag,
) -> PyResult<StudyResult> {
    let AnyPlant::VanDerPol(plant) = plan.plant else { return Err(refused(NO_PLANT)) };
    if plan.joint {
        return Err(refused(SAMPLED_ONLY));
    }
    plan.execute(plant, 2, 2, stop, |experiment, run, x0, z0, watch| {
        experiment.sampled(observer, |u| *u, run, x0, z0, watch)
    })
}

pub fn of_reduced_order(
    observer: &ReducedOrderObserver<f64, Ship<f64>, 3, 3, 2>,
    plan: &Plan,
    stop: &StopFlag,
) -> PyResult<StudyResult> {
    let AnyPlant::Ship(plant) = plan.plant else { return Err(refused(NO_PLANT)) };
    if plan.joint {
        return Err(refused(SAMPLED_ONLY));
    }
    plan.execute(plant, 3, 3, stop, |experiment, run, x0, z0, watch| {
        experiment.sampled(observer, |u: &Vector2<f64>| *u, run, x0, z0, watch)
    })
}

/// Run an experiment described by a spec.
#[pyfunction]
pub fn simulate<'py>(py: Python<'py>, spec: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    let spec = Spec::new(spec, "simulation")?;
    let observer = build(&spec.sub("observer")?)?;
    let plan = Plan::read(&spec, observer.as_ref())?;
    let result = interruptible(py, |stop| observer.study(&plan, stop))?;
    result.into_dict(py, &plan)
}

/// Coarse and fine paths of a stochastic plant on the same Brownian motion.
#[pyfunction]
pub fn coupled_paths<'py>(
    py: Python<'py>,
    spec: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyDict>> {
    let spec = Spec::new(spec, "coupled paths")?;
    spec.only(&["plant", "x0", "t_end", "coarse", "fine", "method", "runs", "seed", "first_run"])?;
    let AnyPlant::VanDerPol(plant) = AnyPlant::read(&spec.sub("plant")?)? else {
        return Err(refused("plant must have process noise: choose van-der-pol"));
    };
    let runs = spec.count("runs")?;
    let x0 = spec.rows("x0", 2, runs)?;
    let t_end = crate::error::positive("t_end", spec.f64("t_end")?)?;
    let count = |key: &str| -> PyResult<u32> {
        let value = spec.whole(key)?;
        u32::try_from(value)
            .ok()
            .filter(|n| *n >= 1)
            .ok_or_else(|| refused(&format!("{key} = {value} is not allowed: 1 to 4294967295")))
    };
    let (coarse, fine) = (count("coarse")?, count("fine")?);
    let method = spec.text("method")?;
    let scheme = stochastic(&method)
        .filter(|scheme| Plant::<f64>::supports(&plant, *scheme))
        .ok_or_else(|| spec.unknown("method", &method, &PLANT_METHODS[4..]))?;
    let finest = if Plant::<f64>::supports(&plant, StochasticIntegrator::Taylor15) {
        StochasticIntegrator::Taylor15
    } else {
        StochasticIntegrator::Milstein
    };
    let (seed, first) = (spec.whole_or("seed", 0)?, spec.whole_or("first_run", 0)?);
    let pairs = interruptible(py, |stop| {
        Ok((0..runs)
            .into_par_iter()
            .map(|run| {
                let start = Vector2::read(Plan::row(&x0, 2, run));
                if stop.is_set() {
                    return (start, start);
                }
                let mut stream = Stream::new(seed, first + run as u64, Channel::Process);
                couple(&plant, scheme, finest, start, t_end, (coarse, fine), &mut stream)
            })
            .collect::<Vec<(Vector2<f64>, Vector2<f64>)>>())
    })?;
    let out = PyDict::new(py);
    let coarse_end = pairs.iter().flat_map(|(a, _)| [a.x, a.y]).collect();
    let fine_end = pairs.iter().flat_map(|(_, b)| [b.x, b.y]).collect();
    out.set_item("coarse", matrix(py, coarse_end, runs)?)?;
    out.set_item("fine", matrix(py, fine_end, runs)?)?;
    Ok(out)
}

/// Exact RMS error of a linear standard observer of order 2 under forward Euler and white noise.
///
/// The spec is that of [`simulate`] with `variance` in place of the noise.
#[pyfunction]
pub fn mean_covariance<'py>(
    py: Python<'py>,
    spec: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyDict>> {
    const N: usize = 2;
    let spec = Spec::new(spec, "covariance")?;
    let observer_spec = spec.sub("observer")?;
    let (k, gain) = (observer_spec.vector::<N>("k", N)?, observer_spec.sub("gain")?);
    let linear = observer_spec.text("kind")? == "standard"
        && gain.text("law")? == "constant"
        && observer_spec.sub("model")?.text("kind")? == "none"
        && observer_spec.text_or("method", "euler")? == "euler";
    if !linear {
        return Err(refused(
            "observer must be linear: kind standard, constant gain, model none, method euler",
        ));
    }
    let ell = gain.f64("ell")?;
    let variance = crate::error::positive("variance", spec.f64("variance")?)?;
    let observer = build(&observer_spec)?;
    let plan = Plan::read(&spec, observer.as_ref())?;
    let AnyPlant::Lee(plant) = plan.plant else {
        return Err(refused("plant must be without process noise: choose lee"));
    };
    let law: StandardObserver<f64, _, _, N, 0> =
        StandardObserver::new(k, ConstantGain::new(ell)?, Unknown)?;
    let (moments, covariance) = interruptible(py, |_| {
        let mut moments = vec![Moments::default(); plan.windows.len() * N];
        let experiment = Experiment {
            plant,
            plant_scheme: plan.plant_scheme,
            substeps: plan.substeps,
            schedule: plan.schedule,
            plant_schedule: plan.plant_schedule,
            noise: Noise { draw: Draw::None, hold: 1, sines: &[] },
            steps: plan.steps,
            seed: 0,
        };
        experiment.check()?;
        let mut probe = ErrorCovariance {
            schedule: plan.schedule,
            injection: [k[0] * ell, k[1] * ell * ell],
            variance,
            windows: &plan.windows,
            moments: &mut moments,
            covariance: nalgebra::SMatrix::zeros(),
        };
        let (x0, z0) = (Memory::read(&plan.x0), Memory::read(&plan.memory0));
        let observer = Discretised { law, scheme: Euler };
        experiment.sampled(&observer, |u| *u, 0, x0, z0, &mut probe);
        let covariance = probe.covariance;
        Ok((moments, covariance))
    })?;
    let out = PyDict::new(py);
    let rms: Vec<f64> = moments.iter().map(Moments::rms).collect();
    out.set_item("rms", matrix(py, rms, plan.windows.len())?)?;
    out.set_item("final_covariance", matrix(py, covariance.as_slice().to_vec(), N)?)?;
    Ok(out)
}

/// `count` raw values of a stream: "bits", "uniform" or "normal".
#[pyfunction]
#[pyo3(signature = (kind, count, seed, run=0, channel=0))]
pub fn random<'py>(
    py: Python<'py>,
    kind: &str,
    count: usize,
    seed: u64,
    run: u64,
    channel: u64,
) -> PyResult<Bound<'py, PyAny>> {
    let channel = match channel {
        0 => Channel::Measurement,
        1 => Channel::Process,
        other => return Err(refused(&format!("channel = {other} is not allowed: 0 or 1"))),
    };
    let mut stream = Stream::new(seed, run, channel);
    let mut values = |of: fn(&mut Stream) -> f64| -> Bound<'py, PyArray1<f64>> {
        (0..count).map(|_| of(&mut stream)).collect::<Vec<_>>().into_pyarray(py)
    };
    match kind {
        "uniform" => Ok(values(Stream::uniform).into_any()),
        "normal" => Ok(values(Stream::normal).into_any()),
        "bits" => {
            let bits: Vec<u64> = (0..count).map(|_| stream.next_u64()).collect();
            Ok(bits.into_pyarray(py).into_any())
        }
        other => Err(refused(&format!("kind = {other:?} is not known; bits, uniform or normal"))),
    }
}

/// A sequence coloured by second-order sections (rows b0, b1, b2, a0 = 1, a1, a2, as SciPy's).
#[pyfunction]
pub fn filtered<'py>(
    py: Python<'py>,
    values: &Bound<'py, PyAny>,
    sections: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let mut signal = numbers(values)?.values;
    let rows = numbers(sections)?;
    if rows.shape.get(1) != Some(&6) {
        let message = format!("sections have shape {:?}; they must be (S, 6)", rows.shape);
        return Err(refused(&message));
    }
    for row in rows.values.chunks_exact(6) {
        if (row[3] - 1.0).abs() > 0.0 {
            return Err(refused("sections must have a0 = 1 in column 3"));
        }
        let mut section = SecondOrderSections::new([[row[0], row[1], row[2], row[4], row[5]]]);
        for value in &mut signal {
            *value = section.filter(*value);
        }
    }
    Ok(signal.into_pyarray(py))
}
