//! Many runs at once against one run at a time: the same bits, whatever the instructions.

use hgo_rs::ensemble::{Block, Columns, coupled_block};
use hgo_rs::gain::{AdaptiveGain, ConstantGain};
use hgo_rs::integrate::{Integrator, PlantScheme, StochasticIntegrator};
use hgo_rs::lanes::{LANES, Lane, LaneMetrics};
use hgo_rs::memory::Memory;
use hgo_rs::metrics::{LogHistogram, Moments, SettlingTime, Wanted, Window};
use hgo_rs::model::{Plant, Unknown};
use hgo_rs::models::{Correction, Crackle, Diffusion, Lee, SanfelicePraly, Ship, VanDerPol};
use hgo_rs::noise::{Channel, Draw, Noise, Stream};
use hgo_rs::observer::{ContinuousLaw, Discretised, Euler, Observer, Rk4};
use hgo_rs::observers::{
    HardClip, PeakingFreeObserver, ReducedOrderObserver, SampledDataObserver, StandardObserver,
};
use hgo_rs::schedule::{FixedStep, Schedule, StochasticApproximation};
use hgo_rs::simulate::{Experiment, Finish, RunMetrics, coupled_paths};
use hgo_rs::vectors::{Task, Vectors};
use nalgebra::{SVector, Vector2, Vector3};

const WINDOWS: [Window; 2] = [Window { from: 0, to: 40 }, Window { from: 100, to: 701 }];
const THRESHOLD: f64 = 0.05;

fn experiment<P: Plant<f64>, S: Schedule<f64>>(
    plant: P,
    plant_scheme: PlantScheme,
    schedule: S,
    noise: Noise<'static, f64>,
) -> Experiment<'static, f64, P, S> {
    let (plant_schedule, seed) = (None, 11);
    Experiment {
        plant,
        plant_scheme,
        substeps: 2,
        schedule,
        plant_schedule,
        noise,
        steps: 700,
        seed,
    }
}

/// What a run gave, as bits.
fn bits(
    moments: &[Moments<f64>],
    peak: &[f64],
    settled: f64,
    x: &impl Memory<f64>,
    z: &impl Memory<f64>,
) -> Vec<u64> {
    let mut all = Vec::new();
    for m in moments {
        all.extend([m.mean(), m.rms(), m.max()].map(f64::to_bits));
    }
    all.extend(peak.iter().map(|p| p.to_bits()));
    all.push(settled.to_bits());
    x.visit(&mut |v| all.push(v.to_bits()));
    z.visit(&mut |v| all.push(v.to_bits()));
    all
}

/// One run alone.
fn alone<X: Memory<f64>, Z: Memory<f64>>(
    signals: usize,
    go: impl FnOnce(&mut RunMetrics<'_, f64>) -> Finish<X, Z>,
) -> Alone {
    let mut moments = vec![Moments::default(); WINDOWS.len() * signals];
    let mut peak = vec![0.0; signals];
    let mut counts = vec![0; LogHistogram::BINS];
    let mut metrics = RunMetrics {
        windows: &WINDOWS,
        signals,
        moments: &mut moments,
        peak: &mut peak,
        settling: Some(SettlingTime::new(THRESHOLD)),
        histogram: Some((WINDOWS[1], LogHistogram::new(&mut counts))),
    };
    let end = go(&mut metrics);
    let settled = metrics.settling.map_or(0.0, |settling| settling.time());
    let ends = (end.diverged_at, end.undefined_at);
    Alone { bits: bits(&moments, &peak, settled, &end.x, &end.z), ends, counts }
}

/// What one run alone gave.
struct Alone {
    bits: Vec<u64>,
    ends: (Option<u64>, Option<u64>),
    counts: Vec<u64>,
}

type BlockOf<X, Z> = Block<Columns<f64, X>, Columns<f64, Z>>;

/// Runs of the block that the histogram counts.
const COUNTED: usize = LANES - 3;

/// A block by every kind of instructions, each run of it against the run alone: with all metrics and
/// with some. How many runs diverged, and how often a block was run.
fn compare<X: Memory<f64>, Z: Memory<f64>, K: Task<Output = BlockOf<X, Z>>>(
    signals: usize,
    steps: u64,
    task: impl Fn(*mut LaneMetrics<'static, f64>) -> K,
    one: impl Fn(u64, &mut RunMetrics<'_, f64>) -> Finish<X, Z>,
) -> (u64, u64) {
    let first = 5;
    let alone: Vec<Alone> =
        (first..).take(LANES).map(|run| alone(signals, |m| one(run, m))).collect();
    let mut counted = vec![0; LogHistogram::BINS];
    for run in &alone[..COUNTED] {
        counted.iter_mut().zip(&run.counts).for_each(|(sum, count)| *sum += count);
    }
    let some = Wanted { mean: false, rms: true, max: false, peak: false };
    let (mut diverged, mut kinds) = (0, 0);
    for vectors in Vectors::ALL.into_iter().filter(|vectors| vectors.are_available()) {
        for wanted in [Wanted::ALL, some] {
            let length = LaneMetrics::<f64>::buffer(WINDOWS.len(), signals, wanted);
            let buffers: [_; 2] = [(); 2].map(|()| vec![Lane([f64::NAN; LANES]); length].leak());
            let counts: [_; 2] = [(); 2].map(|()| vec![0; LogHistogram::BINS].leak());
            let metrics = LaneMetrics::new(&WINDOWS, signals, wanted, Some(THRESHOLD), buffers);
            let mut metrics = metrics.unwrap().with_histogram(WINDOWS[1], COUNTED, counts);
            let end = vectors.run(task(&raw mut metrics)).unwrap();
            kinds += 1;
            for (lane, alone) in alone.iter().enumerate() {
                let run = first + lane as u64;
                let sound = end.sound.0[lane];
                let all = (0..WINDOWS.len()).flat_map(|w| (0..signals).map(move |s| (w, s)));
                let moments: Vec<_> =
                    all.map(|(w, s)| metrics.moments(w, s, lane, sound)).collect();
                let peak: Vec<_> = (0..signals).map(|entry| metrics.peak(entry, lane)).collect();
                let settled = metrics.settling_time(lane);
                let (x, z) = (X::load(&end.x.0, lane), Z::load(&end.z.0, lane));
                let mut expected = alone.bits.clone();
                let mut bits = bits(&moments, &peak, settled, &x, &z);
                if wanted != Wanted::ALL {
                    // mean, rms, max of every window and signal, then the peaks: rms alone is there
                    let rms = |all: &mut Vec<u64>| {
                        let moments = 3 * WINDOWS.len() * signals;
                        let kept: Vec<u64> =
                            (all.iter().enumerate())
                                .filter(|(i, _)| {
                                    if *i < moments { i % 3 == 1 } else { *i >= moments + signals }
                                })
                                .map(|(_, bits)| *bits)
                                .collect();
                        *all = kept;
                    };
                    rms(&mut expected);
                    rms(&mut bits);
                }
                assert_eq!(bits, expected, "{vectors:?}, run {run}");
                let undefined_at = Some(end.undefined_at.0[lane]).filter(|k| *k < u64::MAX);
                assert_eq!((Some(sound).filter(|k| *k <= steps), undefined_at), alone.ends);
                diverged += u64::from(alone.ends.0.is_some());
            }
            assert_eq!(metrics.counts(), counted, "{vectors:?}");
        }
    }
    (diverged, kinds)
}

struct Sampled<'a, P, S, O: Observer<f64>>
where
    P: Plant<f64>,
{
    experiment: &'a Experiment<'static, f64, P, S>,
    observer: &'a O,
    start: (P::State, O::State),
    metrics: *mut LaneMetrics<'static, f64>,
}

#[allow(unsafe_code)] // the metrics outlive the task
impl<P, S, O> Task for Sampled<'_, P, S, O>
where
    P: Plant<f64>,
    S: Schedule<f64>,
    O: Observer<f64, Measurement = P::Output, Input = P::Input>,
{
    type Output = BlockOf<P::State, O::State>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let (x, z) = (self.start.0.in_columns(), self.start.1.in_columns());
        // SAFETY: `compare` keeps them alive, and nothing else looks at them.
        let metrics = unsafe { &mut *self.metrics };
        let block = Block::new(x, z);
        self.experiment.sampled_block(self.observer, 5, block, metrics, || false)
    }
}

fn sampled<P, S, O>(
    experiment: &Experiment<'static, f64, P, S>,
    observer: &O,
    start: (P::State, O::State),
) -> (u64, u64)
where
    P: Plant<f64>,
    S: Schedule<f64>,
    O: Observer<f64, Measurement = P::Output, Input = P::Input>,
{
    experiment.check().unwrap();
    compare(
        O::State::LEN,
        experiment.steps,
        |metrics| Sampled { experiment, observer, start, metrics },
        |run, metrics| experiment.sampled(observer, |u| *u, run, start.0, start.1, metrics),
    )
}

const RK4: PlantScheme = PlantScheme::Deterministic(Integrator::Rk4);
const UNIFORM: Noise<'static, f64> =
    Noise { draw: Draw::Uniform { low: -0.5, high: 0.5 }, hold: 1, sines: &[] };
const NORMAL: Noise<'static, f64> =
    Noise { draw: Draw::Normal { mean: -0.02, std: 0.015 }, hold: 3, sines: &[] };
const NONE: Noise<'static, f64> = Noise { draw: Draw::None, hold: 1, sines: &[] };

#[test]
fn lee_under_both_schedules() {
    let gain = ConstantGain::new(100.0).unwrap();
    let law = StandardObserver::<f64, _, _, 2>::new([2.0; 2], gain, Unknown).unwrap();
    let observer = Discretised { law, scheme: Euler };
    let start = (Vector2::new(10.0, 10.0), (Vector2::zeros(), ()));
    let fixed = FixedStep::new(4e-4).unwrap();
    assert!(sampled(&experiment(Lee, RK4, fixed, UNIFORM), &observer, start).1 >= 2);
    // one pass for draw, observer and plant
    let euler = PlantScheme::Deterministic(Integrator::Euler);
    let study = Experiment { substeps: 1, ..experiment(Lee, euler, fixed, UNIFORM) };
    sampled(&study, &observer, start);
    let decreasing = StochasticApproximation::new(0.04, 0.01, 20_000.0, 1.0).unwrap();
    sampled(&experiment(Lee, RK4, decreasing, UNIFORM), &observer, start);
}

#[test]
fn adaptive_gain_at_a_held_plant() {
    let plant = SanfelicePraly::new(1.9, 0.1).unwrap();
    let gain = AdaptiveGain::new(10.0, 0.0025, 0.183).unwrap();
    let law = StandardObserver::<f64, _, _, 2>::new([2.0; 2], gain, plant).unwrap();
    let observer = Discretised { law, scheme: Rk4 };
    let start = (Vector2::new(-0.1 / 1.9, 0.0), (Vector2::new(1.0, 0.0), 1.0));
    let held = experiment(plant, PlantScheme::Held, FixedStep::new(9e-3).unwrap(), NORMAL);
    sampled(&held, &observer, start);
}

#[test]
fn process_noise_and_runs_that_diverge() {
    let model = VanDerPol::new(0.8, 0.5, Diffusion::Additive, Correction::Derived).unwrap();
    let observer = SampledDataObserver::<_, 2> { model };
    let start = (Vector2::new(1.0, 0.0), Vector2::new(0.0, 1.0));
    for (scheme, dt) in [
        (StochasticIntegrator::EulerMaruyama, 0.3),
        (StochasticIntegrator::Milstein, 0.03),
        (StochasticIntegrator::Taylor15, 0.1),
    ] {
        let schedule = FixedStep::new(dt).unwrap();
        let study = experiment(model, PlantScheme::Stochastic(scheme), schedule, NONE);
        let study = Experiment { substeps: 1, ..study };
        let (diverged, kinds) = sampled(&study, &observer, start);
        // at 0.3 s some runs diverge beside others that do not
        let some = diverged > 0 && diverged < kinds * LANES as u64;
        assert_eq!(some, dt > 0.2, "{diverged}");
    }
}

#[test]
fn a_filter_with_inputs() {
    let ship = Ship::new(0.1, [0.01, 0.0, 0.0]).unwrap();
    let observer = ReducedOrderObserver::new([0.1, 0.2, 0.2], 0.1, ship).unwrap();
    let x0 = (Vector3::new(0.0, 10.0, 0.5), Vector3::new(0.5, -0.5, -0.5));
    let study = experiment(ship, RK4, FixedStep::new(0.01).unwrap(), NONE);
    sampled(&study, &observer, (x0, observer.initial()));
}

struct Joint<'a, P: Plant<f64>, S, L: ContinuousLaw<f64>> {
    experiment: &'a Experiment<'static, f64, P, S>,
    law: &'a L,
    start: (P::State, L::State),
    metrics: *mut LaneMetrics<'static, f64>,
}

#[allow(unsafe_code)] // the metrics outlive the task
impl<P, S, L> Task for Joint<'_, P, S, L>
where
    P: Plant<f64, Output = f64>,
    S: Schedule<f64>,
    L: ContinuousLaw<f64, Input = P::Input>,
{
    type Output = BlockOf<P::State, L::State>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let block = Block::new(self.start.0.in_columns(), self.start.1.in_columns());
        // SAFETY: `compare` keeps them alive, and nothing else looks at them.
        let metrics = unsafe { &mut *self.metrics };
        let scheme = Integrator::BogackiShampine;
        self.experiment.joint_block(self.law, scheme, 5, block, metrics, || false)
    }
}

#[test]
fn plant_and_law_as_one_equation() {
    let crackle = Crackle::new(3.0).unwrap();
    let (alpha, beta) = ([3.0, 3.0, 3.0, 3.0, 2.0], [8.5714, 3.2122, 1.4267, 0.5347, 0.0]);
    let (ell, clip) = (ConstantGain::new(7.0).unwrap(), HardClip::new([3.0; 5]).unwrap());
    let law = PeakingFreeObserver::<f64, _, _, _, 5>::new(alpha, beta, ell, crackle, clip).unwrap();
    let x0 = SVector::from([-0.8, 0.0, 0.0, 0.0, 0.0]);
    let start = (x0, law.initial());
    let schedule = FixedStep::new(1e-3).unwrap();
    let experiment = experiment(crackle, RK4, schedule, NORMAL);
    let scheme = Integrator::BogackiShampine;
    compare(
        9,
        experiment.steps,
        |metrics| Joint { experiment: &experiment, law: &law, start, metrics },
        |run, m| experiment.joint(&law, |u| *u, scheme, run, start.0, start.1, m),
    );
}

struct Coupled {
    plant: VanDerPol<f64>,
    schemes: [StochasticIntegrator; 2],
    starts: [Vector2<f64>; LANES],
}

const COARSE_AND_FINE: (u32, u32) = (7, 70);
const T_END: f64 = 0.7;
const FIRST_RUN: u64 = 5;

impl Task for Coupled {
    type Output = [Columns<f64, Vector2<f64>>; 2];
    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self { plant, schemes: [scheme, fine], starts } = self;
        let mut x0 = starts[0].in_columns();
        starts.iter().enumerate().for_each(|(lane, start)| start.store(&mut x0, lane));
        let of = (1, FIRST_RUN);
        coupled_block(&plant, scheme, fine, x0, T_END, COARSE_AND_FINE, of, || false)
    }
}

#[test]
fn coupled_paths_of_many_runs() {
    use StochasticIntegrator::{EulerMaruyama, Milstein, Taylor15};
    let starts = core::array::from_fn(|lane| Vector2::new(1.0, -0.1 * lane as f64));
    for (diffusion, schemes) in [
        (Diffusion::Additive, [EulerMaruyama, Taylor15]),
        (Diffusion::Additive, [Taylor15, Taylor15]),
        (Diffusion::Multiplicative, [Milstein, Milstein]),
    ] {
        let plant = VanDerPol::new(0.8, 0.5, diffusion, Correction::Derived).unwrap();
        for vectors in Vectors::ALL.into_iter().filter(|vectors| vectors.are_available()) {
            let [coarse, fine] = vectors.run(Coupled { plant, schemes, starts }).unwrap();
            for (lane, start) in starts.iter().enumerate() {
                let mut stream = Stream::new(1, FIRST_RUN + lane as u64, Channel::Process);
                let [scheme, finest] = schemes;
                let steps = COARSE_AND_FINE;
                let alone = coupled_paths(
                    &plant,
                    scheme,
                    finest,
                    *start,
                    T_END,
                    steps,
                    &mut stream,
                    || false,
                );
                let together = (Vector2::load(&coarse, lane), Vector2::load(&fine, lane));
                let bits =
                    |(a, b): (Vector2<f64>, Vector2<f64>)| [a.x, a.y, b.x, b.y].map(f64::to_bits);
                assert_eq!(bits(together), bits(alone), "{vectors:?}, {schemes:?}, run {lane}");
            }
        }
    }
}
