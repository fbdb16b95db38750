//! A study beside the same runs of a typed experiment.

use hgo_ir::study::{AnySchedule, LANES, RunResult, Study, StudyResult};
use hgo_ir::{Spec, Value};
use hgo_rs::integrate::{Integrator, PlantScheme, StochasticIntegrator};
use hgo_rs::memory::Memory;
use hgo_rs::metrics::{LogHistogram, Moments, SettlingTime, Window};
use hgo_rs::model::Plant;
use hgo_rs::noise::{Draw, Law, Noise, Sine};
use hgo_rs::observer::{ContinuousLaw, Measurement, Observer, Status};
use hgo_rs::schedule::{FixedStep, StochasticApproximation};
use hgo_rs::simulate::{DIVERGED, Experiment, Finish, Probe, RunMetrics, Sample};

/// Number of the first run of every study.
pub const FIRST: u64 = 5;
const SEED: u64 = 11;
const THRESHOLD: f64 = 0.05;

/// Runs of a study: so few that each is alone, and more than a block of them.
pub const FEW_AND_MANY: [usize; 2] = [3, LANES + 5];

/// When a clock ticks.
#[derive(Clone, Copy, Debug)]
pub enum Clock {
    Fixed(f64),
    /// α, ε, k₀ and p.
    Decreasing([f64; 4]),
}

impl Clock {
    fn schedule(self) -> AnySchedule {
        match self {
            Self::Fixed(dt) => AnySchedule::Fixed(FixedStep::new(dt).unwrap()),
            Self::Decreasing([alpha, epsilon, k0, p]) => {
                let schedule = StochasticApproximation::new(alpha, epsilon, k0, p);
                AnySchedule::Decreasing(schedule.unwrap())
            }
        }
    }

    fn toml(self) -> String {
        match self {
            Self::Fixed(dt) => format!("{{ kind = 'fixed', dt = {dt:?} }}"),
            Self::Decreasing([alpha, epsilon, k0, p]) => format!(
                "{{ kind = 'stochastic-approximation', alpha = {alpha:?}, epsilon = {epsilon:?}, \
                 k0 = {k0:?}, p = {p:?} }}"
            ),
        }
    }
}

/// What is drawn of the measurement's noise.
#[derive(Clone, Debug)]
pub enum Drawn {
    Nothing,
    Uniform(f64, f64),
    Normal(f64, f64),
    /// Of heavy tails: mean and scale.
    Law(Law, f64, f64),
    /// Recorded: a row for all runs, or one a run.
    Recorded(Vec<Vec<f64>>),
}

/// What is the same for a study and its runs one by one.
#[derive(Clone, Debug)]
pub struct Setup {
    pub plant_method: &'static str,
    pub substeps: u32,
    pub clock: Clock,
    pub plant_clock: Option<Clock>,
    pub drawn: Drawn,
    pub hold: u64,
    pub sines: Vec<Sine<f64>>,
    pub steps: u64,
    /// Windows of the moments; the last is that of the histogram too.
    pub windows: Vec<Window>,
    /// The metrics that are asked for; none: all.
    pub metrics: Option<Vec<&'static str>>,
    /// Each so many samples a frame.
    pub every: u64,
    /// The states of an own plant that the observer estimates; none: the first.
    pub truth: Option<Vec<usize>>,
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            plant_method: "rk4",
            substeps: 2,
            clock: Clock::Fixed(1e-3),
            plant_clock: None,
            drawn: Drawn::Uniform(-0.5, 0.5),
            hold: 1,
            sines: Vec::new(),
            steps: 300,
            windows: vec![Window { from: 0, to: 40 }, Window { from: 100, to: 301 }],
            metrics: None,
            every: 0,
            truth: None,
        }
    }
}

/// Noise of mean not 0, each draw held for three steps.
pub fn normal_held() -> Setup {
    Setup { drawn: Drawn::Normal(-0.02, 0.015), hold: 3, ..Setup::default() }
}

/// Numbers as TOML writes them.
pub fn list(values: &[f64]) -> String {
    let shown = |value: &f64| if value.is_nan() { "nan".to_owned() } else { format!("{value:?}") };
    format!("[{}]", values.iter().map(shown).collect::<Vec<_>>().join(", "))
}

fn rows(rows: &[Vec<f64>]) -> String {
    match rows {
        [one] => list(one),
        all => format!("[{}]", all.iter().map(|row| list(row)).collect::<Vec<_>>().join(", ")),
    }
}

impl Setup {
    fn scheme(&self) -> PlantScheme {
        match self.plant_method {
            "held" => PlantScheme::Held,
            "euler" => PlantScheme::Deterministic(Integrator::Euler),
            "rk4" => PlantScheme::Deterministic(Integrator::Rk4),
            "bogacki-shampine" => PlantScheme::Deterministic(Integrator::BogackiShampine),
            "euler-maruyama" => PlantScheme::Stochastic(StochasticIntegrator::EulerMaruyama),
            "milstein" => PlantScheme::Stochastic(StochasticIntegrator::Milstein),
            "taylor-1.5" => PlantScheme::Stochastic(StochasticIntegrator::Taylor15),
            other => panic!("{other}"),
        }
    }

    /// The experiment of run number `run` of the study.
    fn experiment<P>(&self, plant: P, run: usize) -> Experiment<'_, f64, P, AnySchedule> {
        let draw = match &self.drawn {
            Drawn::Nothing => Draw::None,
            Drawn::Uniform(low, high) => Draw::Uniform { low: *low, high: *high },
            Drawn::Normal(mean, std) => Draw::Normal { mean: *mean, std: *std },
            Drawn::Law(law, mean, scale) => Draw::Law { law: *law, mean: *mean, scale: *scale },
            Drawn::Recorded(rows) => Draw::Samples(&rows[run.min(rows.len() - 1)]),
        };
        Experiment {
            plant,
            plant_scheme: self.scheme(),
            substeps: self.substeps,
            schedule: self.clock.schedule(),
            plant_schedule: self.plant_clock.map(Clock::schedule),
            noise: Noise { draw, hold: self.hold, sines: &self.sines },
            steps: self.steps,
            seed: SEED,
        }
    }

    fn noise(&self, runs: usize) -> String {
        let drawn = match &self.drawn {
            Drawn::Nothing => "kind = 'none'".to_owned(),
            Drawn::Uniform(low, high) => {
                format!("kind = 'uniform', low = {low:?}, high = {high:?}")
            }
            Drawn::Normal(mean, std) => format!("kind = 'normal', mean = {mean:?}, std = {std:?}"),
            Drawn::Law(law, mean, scale) => {
                let law = match law {
                    Law::StudentT { nu } => format!("'student-t', nu = {nu:?}"),
                    Law::Laplace => "'laplace'".to_owned(),
                    Law::Impulsive { probability, ratio } => {
                        format!("'impulsive', probability = {probability:?}, ratio = {ratio:?}")
                    }
                };
                format!("kind = {law}, mean = {mean:?}, scale = {scale:?}")
            }
            Drawn::Recorded(values) => {
                format!("kind = 'samples', values = {}", rows(&values[..runs.min(values.len())]))
            }
        };
        let sine = |sine: &Sine<f64>| vec![sine.amplitude, sine.omega, sine.phase];
        let mut sines: Vec<Vec<f64>> = self.sines.iter().map(sine).collect();
        sines.push(vec![0.0, 1.0, 0.0]); // so that one sine is rows too
        let sines = if self.sines.is_empty() {
            String::new()
        } else {
            format!(", sines = {}", rows(&sines))
        };
        format!("{{ {drawn}, hold = {}{sines} }}", self.hold)
    }

    /// The study of a plant beside an observer, each as its table of a spec.
    pub fn study(&self, kinds: Kinds<'_>, starts: &Starts, runs: usize) -> Study {
        let window = |window: &Window| format!("[{}, {}]", window.from, window.to);
        let windows: Vec<String> = self.windows.iter().map(window).collect();
        let mut text = format!(
            "mode = '{}'\nruns = {runs}\nseed = {SEED}\nfirst_run = {FIRST}\nsteps = {}\nevery = {}\n\
             plant_method = '{}'\nsubsteps = {}\nschedule = {}\nnoise = {}\nwindows = [{}]\n\
             settle = {THRESHOLD}\nx0 = {}\nmemory0 = {}\n",
            if kinds.joint { "joint" } else { "sampled" },
            self.steps,
            self.every,
            self.plant_method,
            self.substeps,
            self.clock.toml(),
            self.noise(runs),
            windows.join(", "),
            rows(&starts.rows(runs, |(x, _)| x)),
            rows(&starts.rows(runs, |(_, z)| z)),
        );
        if let Some(clock) = self.plant_clock {
            text += &format!("plant_schedule = {}\n", clock.toml());
        }
        if let Some(truth) = &self.truth {
            text += &format!("truth = {truth:?}\n");
        }
        if let Some(metrics) = &self.metrics {
            text += &format!("metrics = {metrics:?}\n");
        }
        if let Some(last) = windows.last() {
            text += &format!("histogram = {last}\n");
        }
        text += &format!("[plant]\n{}\n[observer]\n{}\n", kinds.plant, kinds.observer);
        let value = Value::from_toml(&text).unwrap_or_else(|error| panic!("{error}\n{text}"));
        let study = Spec::new(&value, "study").and_then(|spec| Study::read(&spec));
        study.unwrap_or_else(|error| panic!("{error}\n{text}"))
    }
}

/// What a study is of, as tables of its spec.
#[derive(Clone, Copy, Debug)]
pub struct Kinds<'a> {
    pub plant: &'a str,
    pub observer: &'a str,
    pub joint: bool,
}

/// States of plants and memories of observers at the start.
#[derive(Clone, Debug)]
pub enum Starts {
    /// The same for all runs.
    Shared(Vec<f64>, Vec<f64>),
    /// The same, given run by run.
    Repeated(Vec<f64>, Vec<f64>),
    /// Another one a run: the first state of the plant grows by 1 % from run to run.
    Spread(Vec<f64>, Vec<f64>),
}

impl Starts {
    fn of(&self, run: usize) -> (Vec<f64>, Vec<f64>) {
        match self {
            Self::Shared(x, z) | Self::Repeated(x, z) => (x.clone(), z.clone()),
            Self::Spread(x, z) => {
                let mut x = x.clone();
                x[0] *= 1.0 + 0.01 * run as f64;
                (x, z.clone())
            }
        }
    }

    fn rows(&self, runs: usize, part: impl Fn((Vec<f64>, Vec<f64>)) -> Vec<f64>) -> Vec<Vec<f64>> {
        let given = if matches!(self, Self::Shared(..)) { 1 } else { runs };
        (0..given).map(|run| part(self.of(run))).collect()
    }
}

fn bits(value: f64) -> u64 {
    if value.is_nan() { f64::NAN.to_bits() } else { value.to_bits() }
}

fn flat(memory: &impl Memory<f64>) -> Vec<f64> {
    let mut values = Vec::new();
    memory.visit(&mut |value| values.push(value));
    values
}

/// What a run gave.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Told {
    /// Of each window each signal's mean, root mean square and largest magnitude.
    moments: Vec<[u64; 3]>,
    peak: Vec<u64>,
    settled: u64,
    x: Vec<u64>,
    z: Vec<u64>,
    pub diverged_at: Option<u64>,
    pub undefined_at: Option<u64>,
    /// Time, state, memory and measurement.
    frames: Vec<Vec<u64>>,
}

/// A run alone, and the counts of its histogram.
fn alone<X: Memory<f64>, Z: Memory<f64>>(
    setup: &Setup,
    signals: usize,
    go: impl FnOnce(&mut Watch<'_>) -> Finish<X, Z>,
) -> (Told, Vec<u64>) {
    let mut moments = vec![Moments::default(); setup.windows.len() * signals];
    let (mut peak, mut counts) = (vec![0.0; signals], vec![0; LogHistogram::BINS]);
    let histogram = setup.windows.last().map(|last| (*last, LogHistogram::new(&mut counts)));
    let metrics = RunMetrics {
        windows: &setup.windows,
        signals,
        moments: &mut moments,
        peak: &mut peak,
        settling: Some(SettlingTime::new(THRESHOLD)),
        histogram,
    };
    let mut watch = Watch { metrics, every: setup.every, frames: Vec::new() };
    let end = go(&mut watch);
    let settled = watch.metrics.settling.map_or(f64::NAN, |settling| settling.time());
    let frames = watch.frames;
    let told = Told {
        moments: moments.iter().map(|m| [m.mean(), m.rms(), m.max()].map(bits)).collect(),
        peak: peak.into_iter().map(bits).collect(),
        settled: bits(settled),
        x: flat(&end.x).into_iter().map(bits).collect(),
        z: flat(&end.z).into_iter().map(bits).collect(),
        diverged_at: end.diverged_at,
        undefined_at: end.undefined_at,
        frames,
    };
    (told, counts)
}

/// The metrics of a run, and its frames.
pub struct Watch<'a> {
    metrics: RunMetrics<'a, f64>,
    every: u64,
    frames: Vec<Vec<u64>>,
}

impl Probe<f64> for Watch<'_> {
    fn sample<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
        &mut self,
        sample: &Sample<'_, f64, X, Z, Y>,
    ) {
        self.metrics.sample(sample);
        if self.every > 0 && sample.k.is_multiple_of(self.every) {
            let all = [vec![sample.t], flat(sample.x), flat(sample.z), flat(sample.y)].concat();
            self.frames.push(all.into_iter().map(bits).collect());
        }
    }
}

/// Run number `run` of a study of plants of n states, as it is told of one alone.
fn of_study(result: &StudyResult, run: usize, n: usize) -> Told {
    let RunResult { moments, peak, settling_time, final_x, final_memory, .. } = &result.runs[run];
    let frames = &result.frames;
    let frame = |(k, t): (usize, &f64)| {
        let mut all = vec![*t];
        for (values, width) in frames.values.iter().zip(&frames.widths) {
            let at = (run * frames.t.len() + k) * width;
            // behind a plant's state stand the feedback's columns
            let kept = if all.len() == 1 { n } else { *width };
            all.extend_from_slice(&values[at..at + kept]);
        }
        all.into_iter().map(bits).collect()
    };
    let all = |values: &[f64]| values.iter().copied().map(bits).collect();
    Told {
        moments: moments.iter().map(|m| [m.mean(), m.rms(), m.max()].map(bits)).collect(),
        peak: all(peak),
        settled: bits(*settling_time),
        x: all(&final_x[..n]),
        z: all(final_memory),
        diverged_at: result.runs[run].diverged_at,
        undefined_at: result.runs[run].undefined_at,
        frames: frames.t.iter().enumerate().map(frame).collect(),
    }
}

/// Leave out what is not asked for.
fn keep_wanted(told: &mut Told, metrics: Option<&Vec<&str>>) {
    let Some(metrics) = metrics else { return };
    let wanted = |name: &str| metrics.contains(&name);
    for moments in &mut told.moments {
        for (moment, name) in moments.iter_mut().zip(["mean", "rms", "max"]) {
            *moment = if wanted(name) { *moment } else { 0 };
        }
    }
    if !wanted("peak") {
        told.peak.fill(0);
    }
}

/// A study against its runs alone, which `one` makes by number and start. What the runs told.
fn compare<X: Memory<f64>, Z: Memory<f64>>(
    setup: &Setup,
    kinds: Kinds<'_>,
    starts: &Starts,
    runs: usize,
    one: impl Fn(usize, (X, Z), &mut Watch<'_>) -> Finish<X, Z>,
) -> Vec<Told> {
    let study = setup.study(kinds, starts, runs);
    let result = study.run(None, &|| false).unwrap();
    assert_eq!(result.runs.len(), runs);
    let mut counted = vec![0; LogHistogram::BINS];
    let mut all = Vec::new();
    for run in 0..runs {
        let (x, z) = starts.of(run);
        assert_eq!(z.len(), Z::LEN, "{kinds:?}");
        let start = (X::read(&x), Z::read(&z));
        let (mut expected, counts) =
            alone(setup, study.layout.errors, |watch| one(run, start, watch));
        counted.iter_mut().zip(counts).for_each(|(sum, count)| *sum += count);
        // a run that ended has no frames any more, as long as others have
        let width = 1 + X::LEN + Z::LEN + study.layout.y;
        for t in result.frames.t.iter().skip(expected.frames.len()) {
            let nothing = vec![f64::NAN; width - 1];
            expected.frames.push([vec![*t], nothing].concat().into_iter().map(bits).collect());
        }
        let mut told = of_study(&result, run, study.layout.plant);
        keep_wanted(&mut told, setup.metrics.as_ref());
        keep_wanted(&mut expected, setup.metrics.as_ref());
        assert_eq!(told, expected, "run {run} of {runs}: {kinds:?}, {setup:?}");
        all.push(told);
    }
    if !setup.windows.is_empty() {
        assert_eq!(result.counts, counted, "{kinds:?}, {setup:?}");
    }
    all
}

/// The same for few and many runs, and for starts that are shared, given run by run and different; `moves`
/// tells whether all plants move alike where they start alike. What the runs of all studies told.
fn in_all_sizes<X: Memory<f64>, Z: Memory<f64>>(
    setup: &Setup,
    kinds: Kinds<'_>,
    (x, z): (&[f64], &[f64]),
    moves_alike: bool,
    one: impl Fn(usize, (X, Z), &mut Watch<'_>) -> Finish<X, Z>,
) -> Vec<Told> {
    let mut all = Vec::new();
    for runs in FEW_AND_MANY {
        for starts in [Starts::Shared, Starts::Repeated, Starts::Spread] {
            let starts = starts(x.to_vec(), z.to_vec());
            let shared = matches!(starts, Starts::Shared(..)) && moves_alike;
            assert_eq!(setup.study(kinds, &starts, runs).plants_are_shared, shared);
            all.extend(compare(setup, kinds, &starts, runs, &one));
        }
    }
    all
}

/// An observer in discrete time beside a plant.
pub fn sampled<P, O>(
    setup: &Setup,
    (plant, plant_kind): (P, &str),
    (observer, observer_kind): (O, &str),
    tell: impl Fn(&P::Input) -> O::Input + Copy,
    start: (&[f64], &[f64]),
) -> Vec<Told>
where
    P: Plant<f64>,
    O: Observer<f64, Measurement = P::Output>,
{
    let kinds = Kinds { plant: plant_kind, observer: observer_kind, joint: false };
    let random = matches!(setup.scheme(), PlantScheme::Stochastic(_));
    let alike = !random && setup.scheme() != PlantScheme::Held && P::Input::LEN == 0;
    in_all_sizes(setup, kinds, start, alike, |run, (x, z), watch| {
        let experiment = setup.experiment(plant, run);
        experiment.check().unwrap();
        experiment.sampled(&Holding(observer), tell, FIRST + run as u64, x, z, watch)
    })
}

/// A loop of an observer in discrete time: the study's feedback stands behind its observer.
pub fn closed<P, O>(
    setup: &Setup,
    (plant, plant_kind): (P, &str),
    (observer, observer_kind): (O, &str),
    control: impl Fn(f64, &P::Output, &[f64]) -> P::Input + Copy,
    tell: impl Fn(&P::Input) -> O::Input + Copy,
    start: (&[f64], &[f64]),
) -> Vec<Told>
where
    P: Plant<f64>,
    O: Observer<f64, Measurement = P::Output>,
{
    let kinds = Kinds { plant: plant_kind, observer: observer_kind, joint: false };
    in_all_sizes(setup, kinds, start, false, |run, start, watch| {
        let experiment = setup.experiment(plant, run);
        experiment.check().unwrap();
        let run = FIRST + run as u64;
        experiment.closed(&Holding(observer), control, tell, run, start, watch)
    })
}

/// A continuous law integrated together with a plant.
pub fn joint<P, L>(
    setup: &Setup,
    (plant, plant_kind): (P, &str),
    (law, observer_kind): (L, &str),
    integrator: Integrator,
    start: (&[f64], &[f64]),
) -> Vec<Told>
where
    P: Plant<f64, Output = f64>,
    L: ContinuousLaw<f64, Input = P::Input>,
{
    let kinds = Kinds { plant: plant_kind, observer: observer_kind, joint: true };
    in_all_sizes(setup, kinds, start, false, |run, (x, z), watch| {
        let experiment = setup.experiment(plant, run);
        experiment.joint(&law, |u| *u, integrator, FIRST + run as u64, x, z, watch)
    })
}

/// An observer whose memory is held, as a whole, where its model has no value: the way of an
/// [`Estimator`](hgo_rs::Estimator), and of a study.
#[derive(Clone, Copy, Debug)]
struct Holding<O>(O);

impl<O> Holding<O> {
    fn held<Z: Memory<f64>>(z: &mut Z, before: Z, made: Status) -> Status {
        let finite = flat(z).iter().all(|value| value.is_finite());
        if made == Status::ModelUndefined || (!finite && before.within(DIVERGED)) {
            *z = before;
            return Status::ModelUndefined;
        }
        made
    }
}

impl<O: Observer<f64>> Observer<f64> for Holding<O> {
    type State = O::State;
    type Measurement = O::Measurement;
    type Input = O::Input;
    const TIMING: hgo_rs::observer::Timing = O::TIMING;
    const ESTIMATED: usize = O::ESTIMATED;

    fn initial(&self) -> O::State {
        self.0.initial()
    }
    fn correct(&self, z: &mut O::State, y: &O::Measurement, t: f64) -> Status {
        let before = *z;
        let made = self.0.correct(z, y, t);
        Self::held(z, before, made)
    }
    fn advance(
        &self,
        z: &mut O::State,
        y: &O::Measurement,
        u: &O::Input,
        t: f64,
        dt: f64,
    ) -> Status {
        let before = *z;
        let made = self.0.advance(z, y, u, t, dt);
        Self::held(z, before, made)
    }
    fn estimate<'a>(&self, z: &'a O::State) -> &'a [f64] {
        self.0.estimate(z)
    }
    fn innovation(&self, t: f64, z: &O::State, y: &O::Measurement, u: &O::Input) -> O::Measurement {
        self.0.innovation(t, z, y, u)
    }
}
