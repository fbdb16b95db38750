//! What streams past against what was stored.

use super::close;
use hgo_rs::gain::{AdaptiveGain, ConstantGain};
use hgo_rs::integrate::{Integrator, PlantScheme};
use hgo_rs::memory::Memory;
use hgo_rs::metrics::{LogHistogram, Moments, SettlingTime, Window};
use hgo_rs::model::Unknown;
use hgo_rs::models::{Lee, SanfelicePraly};
use hgo_rs::noise::{Channel, Draw, Noise, Sine, Stream};
use hgo_rs::observer::{Discretised, Euler, Measurement};
use hgo_rs::observers::{StandardObserver, StandardState};
use hgo_rs::schedule::{FixedStep, StochasticApproximation};
use hgo_rs::simulate::{DIVERGED, Experiment, Probe, RunMetrics, Sample};
use nalgebra::Vector2;

/// Keeps every sample of a run.
#[derive(Default)]
struct Recorder {
    t: Vec<f64>,
    error: Vec<[f64; 2]>,
    memory: Vec<[f64; 3]>,
    y: Vec<f64>,
}

impl Probe<f64> for Recorder {
    fn sample<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
        &mut self,
        sample: &Sample<'_, f64, X, Z, Y>,
    ) {
        assert_eq!(sample.k, self.t.len() as u64);
        self.t.push(sample.t);
        self.error.push(core::array::from_fn(|i| sample.estimate[i] - sample.truth[i]));
        let mut memory = [0.0; 3];
        sample.z.write(&mut memory);
        self.memory.push(memory);
        sample.y.each(&mut |y| self.y.push(y));
    }
}

fn experiment(
    sines: &[Sine<f64>],
) -> Experiment<'_, f64, SanfelicePraly<f64>, StochasticApproximation<f64>> {
    Experiment {
        plant: SanfelicePraly::new(-0.5, 0.1).unwrap(),
        plant_scheme: PlantScheme::Deterministic(Integrator::Rk4),
        substeps: 3,
        schedule: StochasticApproximation::new(0.5, 0.05, 300.0, 0.8).unwrap(),
        plant_schedule: None,
        noise: Noise { draw: Draw::Normal { mean: 0.0, std: 0.05 }, hold: 4, sines },
        steps: 900,
        seed: 9,
    }
}

fn observer() -> Discretised<StandardObserver<f64, AdaptiveGain<f64>, SanfelicePraly<f64>, 2>, Euler>
{
    let gain = AdaptiveGain::new(10.0, 0.0025, 0.183).unwrap();
    let model = SanfelicePraly::new(-0.5, 0.1).unwrap();
    Discretised { law: StandardObserver::new([2.0, 2.0], gain, model).unwrap(), scheme: Euler }
}

/// Streaming metrics against the same quantities from a stored run.
#[test]
fn streaming_metrics_are_those_of_the_stored_run() {
    let sines = [Sine { amplitude: 0.02, omega: 9.0, phase: 0.4 }];
    let run = experiment(&sines);
    let (x0, z0) =
        (Vector2::new(1.0, 0.5), StandardState { x_hat: Vector2::new(0.0, 0.0), r: 1.0 });
    let mut stored = Recorder::default();
    run.sampled(&observer(), |u| *u, 7, x0, z0, &mut stored);
    let windows = [Window { from: 0, to: 901 }, Window { from: 500, to: 700 }];
    let (mut moments, mut peak) = ([Moments::default(); 6], [0.0; 3]);
    let mut counts = vec![0; LogHistogram::BINS];
    let mut probe = RunMetrics {
        windows: &windows,
        signals: 3,
        moments: &mut moments,
        peak: &mut peak,
        settling: Some(SettlingTime::new(0.2)),
        histogram: Some((windows[1], LogHistogram::new(&mut counts))),
    };
    run.sampled(&observer(), |u| *u, 7, x0, z0, &mut probe);
    let settling = probe.settling.unwrap().time();

    assert_eq!((stored.t.len(), stored.y.len()), (901, 901));
    for (w, range) in [(0, 0..901), (1, 500..700)] {
        for signal in 0..3 {
            let value = |k: usize| match signal {
                2 => stored.memory[k][2],
                _ => stored.error[k][signal],
            };
            let count = range.len() as f64;
            let mean = range.clone().map(value).sum::<f64>() / count;
            let square = range.clone().map(|k| value(k).powi(2)).sum::<f64>() / count;
            let largest = range.clone().map(|k| value(k).abs()).fold(0.0, f64::max);
            let ours = moments[3 * w + signal];
            assert!(close(ours.mean(), mean, 1e-12) && close(ours.rms(), square.sqrt(), 1e-12));
            assert_eq!(ours.max(), largest);
        }
    }
    for i in 0..3 {
        assert_eq!(peak[i], stored.memory.iter().map(|z| z[i].abs()).fold(0.0, f64::max));
    }
    let distance = |k: usize| stored.error[k][0].hypot(stored.error[k][1]);
    let last = (0..901).rev().find(|k| distance(*k) >= 0.2).unwrap();
    assert_eq!(settling, stored.t[last]);
    assert!(0 < last && last < 900, "{last}");
    // quantiles of ‖e‖² within a bin, a ratio of 2^(1/32)
    let mut squares: Vec<f64> = (500..700).map(|k| distance(k).powi(2)).collect();
    squares.sort_by(f64::total_cmp);
    assert_eq!(counts.iter().sum::<u64>(), 200);
    let histogram = LogHistogram::new(&mut counts);
    for (q, k) in [(0.1, 19), (0.5, 99), (0.95, 189)] {
        let ratio = histogram.quantile(q) / squares[k];
        assert!((ratio.log2() * 32.0).abs() < 2.0, "quantile {q}: ratio {ratio}");
    }
    // time is the sum of the decreasing steps
    let clock: f64 = (0..900).map(|k| 0.025 * (1.0 + f64::from(k) / 300.0).powf(-0.8)).sum();
    assert!(close(stored.t[900], clock, 1e-12));
}

/// y(k) = x₁(k) + a draw held for four steps + the sine at t(k); runs are independent.
#[test]
fn measurements_are_output_plus_noise() {
    let sines = [Sine { amplitude: 0.02, omega: 9.0, phase: 0.4 }];
    let run = experiment(&sines);
    let (x0, z0) =
        (Vector2::new(1.0, 0.5), StandardState { x_hat: Vector2::new(0.0, 0.0), r: 1.0 });
    let (mut noisy, mut other) = (Recorder::default(), Recorder::default());
    run.sampled(&observer(), |u| *u, 7, x0, z0, &mut noisy);
    run.sampled(&observer(), |u| *u, 8, x0, z0, &mut other);
    assert_ne!(noisy.y, other.y);
    let mut stream = Stream::new(9, 7, Channel::Measurement);
    let mut held = 0.0;
    for (k, y) in noisy.y.iter().enumerate() {
        if k % 4 == 0 {
            held = 0.05 * stream.normal();
        }
        let x1 = noisy.memory[k][0] - noisy.error[k][0];
        let sine = 0.02 * (9.0 * noisy.t[k] + 0.4).sin();
        assert!((y - (x1 + held + sine)).abs() < 1e-14, "k = {k}");
    }
}

/// The largest entry of the memory.
struct Largest<'a>(&'a mut f64);
impl Probe<f64> for Largest<'_> {
    fn sample<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
        &mut self,
        sample: &Sample<'_, f64, X, Z, Y>,
    ) {
        sample.z.visit(&mut |z| *self.0 = self.0.max(z.abs()));
    }
}

/// Stops at k = 1 and says where it was.
struct Stop(u64);
impl Probe<f64> for Stop {
    fn sample<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
        &mut self,
        sample: &Sample<'_, f64, X, Z, Y>,
    ) {
        self.0 = sample.k;
    }
    fn interrupted(&mut self, k: u64) -> bool {
        k == 1
    }
}

/// A run that leaves 10¹² stops there, and one with a NaN start at once.
#[test]
fn a_diverging_run_stops() {
    let gain = ConstantGain::new(100.0).unwrap();
    let law = StandardObserver::new([2.0, 2.0], gain, Unknown).unwrap();
    let observer = Discretised { law, scheme: Euler };
    let run = Experiment {
        plant: Lee,
        plant_scheme: PlantScheme::Held,
        substeps: 1,
        schedule: FixedStep::new(0.05).unwrap(), // ℓT = 5
        plant_schedule: None,
        noise: Noise { draw: Draw::None, hold: 1, sines: &[] },
        steps: 1_000,
        seed: 0,
    };
    let mut largest = 0.0;
    let start = StandardState { x_hat: Vector2::new(1.0, 0.0), r: () };
    let probe = &mut Largest(&mut largest);
    let end = run.sampled(&observer, |u| *u, 0, Vector2::zeros(), start, probe);
    let stopped = end.diverged_at.unwrap();
    assert!((3..50).contains(&stopped), "{stopped}");
    assert!(largest <= DIVERGED && end.z.x_hat.amax() > DIVERGED);
    let nan = Vector2::new(f64::NAN, 0.0);
    let probe = &mut Largest(&mut largest);
    let end = run.sampled(&observer, |u| *u, 0, nan, start, probe);
    assert_eq!(end.diverged_at, Some(0));
    // an interrupted run is not a diverged one
    let mut stop = Stop(0);
    let end = run.sampled(&observer, |u| *u, 0, Vector2::zeros(), start, &mut stop);
    assert_eq!((stop.0, end.diverged_at), (1, None));
}

/// Of the same values one by one, and of sums that were added up elsewhere.
#[test]
fn moments_are_made_of_their_sums() {
    let values = [0.5, -2.0, 1.25, 0.0];
    let mut one_by_one = Moments::<f64>::default();
    for value in values {
        one_by_one.push(value);
    }
    let of_sums = Moments::from_sums(4, -0.25, 5.8125, 2.0);
    assert_eq!(one_by_one, of_sums);
    assert_eq!((of_sums.mean(), of_sums.max()), (-0.0625, 2.0));
    assert!(close(of_sums.rms(), 1.453_125_f64.sqrt(), 1e-15));
}
