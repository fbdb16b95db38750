//! Floor 3. A study as it was asked for: plain data, read from a spec.

use crate::error::{Result, refused};
use crate::spec::Spec;
use hgo_rs::integrate::{Integrator, PlantScheme};
use hgo_rs::metrics::{Wanted, Window};
use hgo_rs::model::StochasticIntegrator;
use hgo_rs::noise::{Law, Sine, Stream};
use hgo_rs::program::Lane;
use hgo_rs::schedule::{FixedStep, Schedule, StochasticApproximation};
use rand::distr::Distribution;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;

/// A schedule chosen at run time.
#[derive(Clone, Copy, Debug)]
pub enum AnySchedule {
    /// Steps of one length.
    Fixed(FixedStep<f64>),
    /// Steps that decrease.
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
            other => Err(spec.unknown("kind", other, &["fixed", "stochastic-approximation"])),
        }
    }
}

/// What is drawn at a sample and held.
#[derive(Clone, Debug)]
pub enum DrawKind {
    /// Nothing.
    None,
    /// Uniform between two ends.
    Uniform(f64, f64),
    /// Normal: mean and standard deviation.
    Normal(f64, f64),
    /// Of heavy tails: mean and scale.
    Law(Law, f64, f64),
    /// Of any law, drawn by each run's stream; the same for all outputs.
    Own(Own),
    /// A recorded sequence for all runs alike.
    Shared(Vec<f64>),
    /// One for each run, `per_run` values each.
    Recorded {
        /// All, run by run.
        values: Vec<f64>,
        /// Values of one run.
        per_run: usize,
    },
}

/// A law that is given as a function of a stream.
#[derive(Clone)]
pub struct Own(pub Arc<dyn Fn(&mut Stream) -> f64 + Send + Sync>);

impl Own {
    /// A law of `rand_distr`, or any other distribution of the crate `rand`.
    pub fn new(law: impl Distribution<f64> + Send + Sync + 'static) -> Self {
        Self(Arc::new(move |stream| law.sample(stream)))
    }
}

impl fmt::Debug for Own {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Own")
    }
}

/// An experiment as it was asked for.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Whether plant and observer are one differential equation.
    pub joint: bool,
    /// How the plant moves, and its name.
    pub plant_scheme: PlantScheme,
    pub(super) plant_method: String,
    /// Equal substeps of the plant in one step.
    pub substeps: u32,
    /// When the observer steps.
    pub schedule: AnySchedule,
    /// When the plant steps, if not with the observer.
    pub plant_schedule: Option<AnySchedule>,
    /// Measurement noise that is drawn.
    pub draw: DrawKind,
    /// Coefficients a₁, a₂, … of coloured noise: v = a₁v₋₁ + a₂v₋₂ + … + a draw; none where it is white.
    pub ar: Vec<f64>,
    /// What standard normal values are multiplied by to give v₋₁, v₋₂, … before the first sample: a square
    /// matrix, row by row.
    pub ar_start: Vec<f64>,
    /// Steps over which a draw is held.
    pub hold: u64,
    /// Sines added to it.
    pub sines: Vec<Sine<f64>>,
    /// Steps of a run; samples are 0 to `steps`.
    pub steps: u64,
    /// Number of runs.
    pub runs: usize,
    /// Seed of the study.
    pub seed: u64,
    /// Number of the first run.
    pub first_run: u64,
    /// Windows of the moments, in samples.
    pub windows: Vec<Window>,
    /// Which metrics.
    pub wanted: Wanted,
    /// Whether the errors and the rest of the memory have metrics, besides what is watched.
    pub errors: bool,
    /// Threshold of the settling time.
    pub settle: Option<f64>,
    /// Window of the histogram.
    pub histogram: Option<Window>,
    /// Each so many samples a frame is kept; 0: none.
    pub every: u64,
    /// Starts of the plants: one row, or one a run.
    pub x0: Vec<f64>,
    /// Starts of the observers.
    pub memory0: Vec<f64>,
}

/// Names of the metrics that can be asked for.
const METRICS: [&str; 4] = ["mean", "rms", "max", "peak"];

fn read_wanted(spec: &Spec<'_>) -> Result<Wanted> {
    let Some(names) = spec.texts("metrics")? else { return Ok(Wanted::ALL) };
    if let Some(unknown) = names.iter().find(|name| !METRICS.contains(&name.as_str())) {
        return Err(spec.unknown("metrics", unknown, &METRICS));
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
        other => Err(refused(format!(
            "{name} = {other:?} is not allowed: a window is [first step, one past the last step]"
        ))),
    }
}

impl Plan {
    const KEYS: [&'static str; 22] = [
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
        "truth",
        "feedback",
        "errors",
    ];

    /// From a spec; `also` are keys that the caller reads. The starts are read by [`Self::starting`], once
    /// their lengths are known.
    ///
    /// # Errors
    /// What is not allowed.
    pub fn read(spec: &Spec<'_>, also: &[&str]) -> Result<Self> {
        spec.only(&[&Self::KEYS, also].concat())?;
        let mode = spec.text_or("mode", "sampled")?;
        let joint = match mode.as_str() {
            "sampled" => false,
            "joint" => true,
            other => return Err(spec.unknown("mode", other, &["sampled", "joint"])),
        };
        let method = spec.text_or("plant_method", "euler")?;
        let runs = spec.whole_or("runs", 1)?;
        let runs = usize::try_from(runs).ok().filter(|r| *r >= 1).ok_or_else(|| {
            refused(format!("runs = {runs} is not allowed: it must be at least 1"))
        })?;
        let steps = spec.whole("steps")?;
        if steps == 0 {
            return Err(refused("steps = 0 is not allowed: it must be at least 1"));
        }
        let substeps = u32::try_from(spec.whole_or("substeps", 1)?).unwrap_or(u32::MAX);
        if substeps == 0 {
            return Err(refused("substeps = 0 is not allowed: it must be at least 1"));
        }
        let (draw, hold, sines, (ar, ar_start)) = if spec.has("noise") {
            Self::read_noise(&spec.sub("noise")?, runs, steps)?
        } else {
            (DrawKind::None, 1, Vec::new(), (Vec::new(), Vec::new()))
        };
        let mut windows = Vec::new();
        if spec.has("windows") {
            let given = spec.numbers("windows")?;
            if !given.values.is_empty() && !matches!(given.shape.as_slice(), [_, 2]) {
                return Err(refused(format!(
                    "windows have shape {:?}; they must be (W, 2)",
                    given.shape
                )));
            }
            for pair in given.values.chunks(2) {
                windows.push(window(pair, "windows")?);
            }
        }
        let histogram = if spec.has("histogram") {
            Some(window(&spec.numbers("histogram")?.values, "histogram")?)
        } else {
            None
        };
        let settle = if spec.has("settle") {
            Some(hgo_rs::error::positive("settle", spec.f64("settle")?)?)
        } else {
            None
        };
        Ok(Self {
            joint,
            plant_scheme: read_plant_scheme(spec, &method)?,
            plant_method: method,
            substeps,
            schedule: AnySchedule::read(&spec.sub("schedule")?)?,
            plant_schedule: if spec.has("plant_schedule") {
                Some(AnySchedule::read(&spec.sub("plant_schedule")?)?)
            } else {
                None
            },
            draw,
            ar,
            ar_start,
            hold,
            sines,
            steps,
            runs,
            seed: spec.whole_or("seed", 0)?,
            first_run: spec.whole_or("first_run", 0)?,
            windows,
            wanted: read_wanted(spec)?,
            errors: spec.flag_or("errors", true)?,
            settle,
            histogram,
            every: spec.whole_or("every", 0)?,
            x0: Vec::new(),
            memory0: Vec::new(),
        })
    }

    /// With the starts of a plant of n states and of a memory of m entries.
    ///
    /// # Errors
    /// Starts of another shape, or not finite.
    pub fn starting(mut self, spec: &Spec<'_>, (n, m): (usize, usize)) -> Result<Self> {
        self.x0 = spec.rows("x0", n, self.runs)?;
        self.memory0 = spec.rows("memory0", m, self.runs)?;
        Ok(self)
    }

    /// Refuse, by its name, a scheme that the plant does not take.
    ///
    /// # Errors
    /// A deterministic scheme for a plant with process noise; a stochastic one for another.
    pub fn check_method(
        &self,
        noisy: bool,
        supports: impl Fn(StochasticIntegrator) -> bool,
    ) -> Result<()> {
        let (fits, allowed) = match self.plant_scheme {
            PlantScheme::Held => (true, ""),
            PlantScheme::Deterministic(_) => (
                !noisy,
                "the plant has process noise, which a deterministic scheme would leave out: choose \
                 euler-maruyama, milstein or taylor-1.5, or sigma = 0",
            ),
            PlantScheme::Stochastic(scheme) => (
                supports(scheme),
                "a stochastic scheme needs a plant with process noise, and taylor-1.5 needs it to \
                 be additive: choose euler, rk4 or bogacki-shampine, or milstein",
            ),
        };
        if fits {
            Ok(())
        } else {
            Err(refused(format!(
                "plant_method = {:?} is not allowed: {allowed}",
                self.plant_method
            )))
        }
    }

    /// The value of the noise of sample k that is recorded for all runs alike.
    pub fn shared_noise(&self, k: u64) -> f64 {
        match &self.draw {
            DrawKind::Shared(values) => self.place(k).and_then(|i| values.get(i)).copied(),
            _ => None,
        }
        .unwrap_or(0.0)
    }

    /// The recorded noise of the runs from `first` on at some samples, a row each; none where it is not
    /// recorded run by run.
    pub fn recorded<const L: usize>(
        &self,
        first: usize,
        samples: Range<u64>,
        into: &mut Vec<Lane<f64, L>>,
    ) {
        into.clear();
        let DrawKind::Recorded { values, per_run } = &self.draw else { return };
        into.extend(samples.map(|k| {
            let place = self.place(k).filter(|place| place < per_run);
            Lane(std::array::from_fn(|lane| {
                let run = (first + lane).min(self.runs - 1);
                place.and_then(|place| values.get(run * per_run + place)).copied().unwrap_or(0.0)
            }))
        }));
    }

    fn place(&self, k: u64) -> Option<usize> {
        usize::try_from(k / self.hold).ok()
    }

    /// Whether the noise is drawn at every sample, if at all, and has no sines.
    pub fn is_plain(&self) -> bool {
        self.hold <= 1 && self.sines.is_empty() && !matches!(self.draw, DrawKind::Shared(_))
    }

    /// The law of a drawn noise that is not uniform (none: the normal law), its mean and its scale.
    pub fn law(&self) -> Option<(Option<Law>, f64, f64)> {
        match self.draw {
            DrawKind::Normal(mean, std) => Some((None, mean, std)),
            DrawKind::Law(law, mean, scale) => Some((Some(law), mean, scale)),
            _ => None,
        }
    }

    /// Whether a sample needs the noise of the one before.
    pub fn noise_lasts(&self) -> bool {
        let drawn = self.law().is_some() || matches!(self.draw, DrawKind::Uniform(..));
        drawn && (self.hold > 1 || !self.ar.is_empty())
    }

    /// Noise of one output before the first sample, v₋₁, v₋₂, ….
    pub fn noise_before(&self, stream: &mut Stream) -> Vec<f64> {
        let normal: Vec<f64> = self.ar.iter().map(|_| stream.normal()).collect();
        let rows = self.ar_start.chunks_exact(self.ar.len().max(1));
        rows.map(|row| row.iter().zip(&normal).fold(0.0, |sum, (a, b)| sum + a * b)).collect()
    }

    /// Whether samples may be missing: recorded noise that is not finite, or a law that may give such.
    pub fn samples_miss(&self) -> bool {
        match &self.draw {
            DrawKind::Shared(values) | DrawKind::Recorded { values, .. } => {
                !values.iter().all(|value| value.is_finite())
            }
            DrawKind::Own(_) => true,
            _ => false,
        }
    }

    fn read_noise(
        spec: &Spec<'_>,
        runs: usize,
        steps: u64,
    ) -> Result<(DrawKind, u64, Vec<Sine<f64>>, Coloured)> {
        let kind = spec.text("kind")?;
        let finite =
            |key: &'static str| -> Result<f64> { Ok(hgo_rs::error::finite(key, spec.f64(key)?)?) };
        let scaled = |law: Law| -> Result<DrawKind> {
            let scale = finite("scale")?;
            hgo_rs::error::require("scale", scale, scale >= 0.0, "it must be at least 0")?;
            let mean = hgo_rs::error::finite("mean", spec.f64_or("mean", 0.0)?)?;
            Ok(DrawKind::Law(law.checked()?, mean, scale))
        };
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
            "student-t" => scaled(Law::StudentT { nu: finite("nu")? })?,
            "laplace" => scaled(Law::Laplace)?,
            "impulsive" => scaled(Law::Impulsive {
                probability: finite("probability")?,
                ratio: finite("ratio")?,
            })?,
            "samples" => {
                let given = spec.numbers("values")?;
                let per_run = match given.shape.as_slice() {
                    [_] => 0,
                    [rows, columns] if *rows == runs => *columns,
                    other => {
                        return Err(refused(format!(
                            "noise values have shape {other:?}; they must be (steps + 1,) or \
                             ({runs}, steps + 1)"
                        )));
                    }
                };
                if per_run == 0 {
                    DrawKind::Shared(given.values.clone())
                } else {
                    DrawKind::Recorded { values: given.values.clone(), per_run }
                }
            }
            other => {
                return Err(spec.unknown("kind", other, &NOISES));
            }
        };
        let own: &[&str] = match draw {
            DrawKind::None | DrawKind::Own(_) => &[],
            DrawKind::Uniform(..) => &["low", "high"],
            DrawKind::Normal(..) => &["mean", "std", "ar", "start"],
            DrawKind::Law(Law::StudentT { .. }, ..) => &["mean", "scale", "nu"],
            DrawKind::Law(Law::Laplace, ..) => &["mean", "scale"],
            DrawKind::Law(Law::Impulsive { .. }, ..) => &["mean", "scale", "probability", "ratio"],
            DrawKind::Shared(_) | DrawKind::Recorded { .. } => &["values"],
        };
        spec.only(&[&["kind", "hold", "sines"], own].concat())?;
        let coloured = read_coloured(spec)?;
        let mut sines = Vec::new();
        if spec.has("sines") {
            for row in spec.numbers("sines")?.values.chunks(3) {
                match row {
                    [amplitude, omega, phase] if row.iter().all(|v| v.is_finite()) => {
                        sines.push(Sine { amplitude: *amplitude, omega: *omega, phase: *phase });
                    }
                    other => {
                        return Err(refused(format!(
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
        let given = match &draw {
            DrawKind::Shared(values) => Some(values.len()),
            DrawKind::Recorded { per_run, .. } => Some(*per_run),
            _ => None,
        };
        if let Some(given) = given.map(|given| given as u64) {
            let needed = steps / hold + 1;
            if given < needed {
                return Err(refused(format!(
                    "noise values: {given} a run are too few for {steps} steps; give {needed}"
                )));
            }
        }
        Ok((draw, hold, sines, coloured))
    }

    /// Variance of a noise that is white with mean zero.
    pub fn noise_variance(&self) -> Option<f64> {
        let plain = self.hold == 1 && self.sines.is_empty() && self.ar.is_empty();
        match self.draw {
            DrawKind::Uniform(low, high) if plain && (low + high).abs() < 1e-12 * high.abs() => {
                Some((high - low) * (high - low) / 12.0)
            }
            DrawKind::Normal(mean, std) if plain && mean.abs() < 1e-12 * std => Some(std * std),
            _ => None,
        }
    }
}

/// Coefficients of coloured noise, and what it begins with.
type Coloured = (Vec<f64>, Vec<f64>);

fn read_coloured(spec: &Spec<'_>) -> Result<Coloured> {
    let (mut ar, mut ar_start) = (Vec::new(), Vec::new());
    if spec.has("ar") {
        ar.clone_from(&spec.numbers("ar")?.values);
        let start = spec.numbers("start")?;
        if start.shape != [ar.len(), ar.len()] {
            return Err(refused(format!(
                "start has shape {:?}; it must be ({n}, {n}), as there are {n} coefficients ar",
                start.shape,
                n = ar.len()
            )));
        }
        ar_start.clone_from(&start.values);
        if !ar.iter().chain(&ar_start).all(|value| value.is_finite()) {
            return Err(refused("ar and start must be finite"));
        }
    }
    Ok((ar, ar_start))
}

const NOISES: [&str; 7] =
    ["none", "uniform", "normal", "student-t", "laplace", "impulsive", "samples"];

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
            None => return Err(spec.unknown("plant_method", other, &PLANT_METHODS)),
        },
    })
}
