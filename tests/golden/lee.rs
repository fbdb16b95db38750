//! Lee, Choi and Khalil: fixed and decreasing steps, by exact covariance and by Monte Carlo.

use super::{Metrics, QUIET, Watch, close, experiment, printed};
use hgo_rs::Observer;
use hgo_rs::covariance::ErrorCovariance;
use hgo_rs::gain::ConstantGain;
use hgo_rs::integrate::{Integrator, PlantScheme};
use hgo_rs::metrics::{Moments, Window};
use hgo_rs::model::Unknown;
use hgo_rs::models::Lee;
use hgo_rs::noise::{Draw, Noise};
use hgo_rs::observer::{Discretised, Euler};
use hgo_rs::observers::{StandardObserver, StandardState};
use hgo_rs::schedule::{FixedStep, Schedule, StochasticApproximation};
use hgo_rs::simulate::Experiment;
use nalgebra::{SMatrix, Vector2};

const EPSILON: f64 = 0.01;
const T: f64 = 0.0004;
const UNIFORM: Draw<'static, f64> = Draw::Uniform { low: -0.5, high: 0.5 };
const WINDOWS: [(u64, u64); 6] = [
    (20_000, 50_000),
    (50_000, 100_000),
    (100_000, 200_000),
    (200_000, 400_000),
    (400_000, 800_000),
    (800_000, 1_600_000),
];
const EULER: PlantScheme = PlantScheme::Deterministic(Integrator::Euler);

type HighGain = Discretised<StandardObserver<f64, ConstantGain<f64>, Unknown, 2>, Euler>;

/// (42) and (44): h = (2, 2), φ = 0.
fn observer() -> HighGain {
    let gain = ConstantGain::from_epsilon(EPSILON).unwrap();
    Discretised { law: StandardObserver::new([2.0, 2.0], gain, Unknown).unwrap(), scheme: Euler }
}

fn x0() -> Vector2<f64> {
    Vector2::new(10.0, 10.0)
}

/// T or a(k), so that plant and observer may differ.
#[derive(Clone, Copy)]
enum Clock {
    Fixed(FixedStep<f64>),
    Decreasing(StochasticApproximation<f64>),
}

impl Schedule<f64> for Clock {
    fn dt(&self, k: u64) -> f64 {
        match self {
            Self::Fixed(s) => s.dt(k),
            Self::Decreasing(s) => s.dt(k),
        }
    }
    fn next_time(&self, t: f64, k: u64, dt: f64) -> f64 {
        match self {
            Self::Fixed(s) => s.next_time(t, k, dt),
            Self::Decreasing(s) => s.next_time(t, k, dt),
        }
    }
}

fn fixed() -> Clock {
    Clock::Fixed(FixedStep::new(T).unwrap())
}

fn decreasing() -> Clock {
    Clock::Decreasing(StochasticApproximation::new(0.04, EPSILON, 20_000.0, 1.0).unwrap())
}

/// Exact mean and covariance: the windows' RMS (e1, e2) and the last covariance.
fn exact(
    clock: Clock,
    plant_clock: Option<Clock>,
    windows: &[(u64, u64)],
) -> (Vec<[f64; 2]>, SMatrix<f64, 2, 2>) {
    let steps = windows.last().unwrap().1;
    let run = Experiment { plant_schedule: plant_clock, ..experiment(Lee, EULER, clock, steps) };
    let windows: Vec<_> = windows.iter().map(|(a, b)| Window { from: *a, to: *b }).collect();
    let mut moments = vec![Moments::default(); 2 * windows.len()];
    let injection = [2.0 / EPSILON, 2.0 / EPSILON.powi(2)];
    let mut probe =
        ErrorCovariance::new(clock, injection, 1.0 / 12.0, &windows, &mut moments, || false);
    run.sampled(&observer(), |u| *u, 0, x0(), observer().initial(), &mut probe);
    let covariance = probe.covariance;
    (moments.chunks(2).map(|m| [m[0].rms(), m[1].rms()]).collect(), covariance)
}

/// Pooled RMS over seeds, by simulation.
fn monte_carlo(clock: Clock, windows: &[(u64, u64)], runs: u64) -> Vec<[f64; 2]> {
    let steps = windows.last().unwrap().1;
    let noise = Noise { draw: UNIFORM, ..QUIET };
    let study = Experiment { noise, ..experiment(Lee, EULER, clock, steps) };
    let mut squares = vec![[0.0; 2]; windows.len()];
    for run in 0..runs {
        let mut metrics = Metrics::new(windows, 2, 2);
        let end = study.sampled(&observer(), |u| *u, run, x0(), observer().initial(), &mut metrics);
        assert_eq!(end.diverged_at, None);
        for (w, square) in squares.iter_mut().enumerate() {
            for (i, sum) in square.iter_mut().enumerate() {
                *sum += metrics.signal(w, i).rms().powi(2) / runs as f64;
            }
        }
    }
    squares.iter().map(|s| s.map(f64::sqrt)).collect()
}

#[test]
fn fixed_step_stationary_std() {
    let (_, covariance) = exact(fixed(), None, &[(0, 50_000)]);
    let [e1, e2] = [covariance[(0, 0)].sqrt(), covariance[(1, 1)].sqrt()];
    printed("std e1", e1, 0.072_158_8, 7);
    close("std e2", e2, 6.011_561, 1e-6);
}

#[test]
fn fixed_step_std_by_monte_carlo() {
    let windows = [(5_000, 105_000)];
    let [e1, e2] = monte_carlo(fixed(), &windows, 8)[0];
    close("std e1", e1, 0.072_158_8, 0.015);
    close("std e2", e2, 6.011_561, 0.015);
}

#[test]
fn stochastic_approximation_windows() {
    let (rms, _) = exact(decreasing(), None, &WINDOWS);
    let e1 = [0.04353, 0.03299, 0.02469, 0.01801, 0.01294, 0.00923];
    let e2 = [3.5823, 2.7055, 2.0209, 1.4725, 1.0578, 0.7540];
    for (w, ours) in rms.iter().enumerate() {
        printed("RMS e1", ours[0], e1[w], 5);
        printed("RMS e2", ours[1], e2[w], 4);
    }
    // For small steps the variance follows b(k): 5.7735² b(k), b averaged over the window.
    let k0 = 20_000.0;
    for (ours, (from, to)) in rms.iter().zip(WINDOWS).skip(3) {
        let (from, to) = (from as f64, to as f64);
        let mean_b = k0 / (to - from) * ((k0 + to) / (k0 + from)).ln();
        close("RMS e2 and b(k)", ours[1], 10.0 / 3_f64.sqrt() * mean_b.sqrt(), 0.004);
    }
}

#[test]
fn plant_at_fixed_period_biases_the_observer() {
    let windows = &WINDOWS;
    let (rms, _) = exact(decreasing(), Some(fixed()), windows);
    let e2 = [3.5835, 2.7134, 2.0725, 1.9626, 3.0781, 0.7540];
    for (ours, expected) in rms.iter().zip(e2) {
        printed("RMS e2", ours[1], expected, 4);
    }
}

#[test]
fn stochastic_approximation_windows_by_monte_carlo() {
    let rms = monte_carlo(decreasing(), &WINDOWS, 48);
    let e1 = [0.04353, 0.03299, 0.02469, 0.01801, 0.01294, 0.00923];
    let e2 = [3.5823, 2.7055, 2.0209, 1.4725, 1.0578, 0.7540];
    for (w, ours) in rms.iter().enumerate() {
        close("RMS e1", ours[0], e1[w], 0.015);
        close("RMS e2", ours[1], e2[w], 0.015);
    }
}

/// P(k+1) = M P(k) Mᵀ + dt² L Lᵀ σ² from P(0) = 0, written out for three decreasing steps.
#[test]
fn covariance_belongs_to_the_last_sample() {
    let clock = decreasing();
    let (l1, l2) = (2.0 / EPSILON, 2.0 / EPSILON.powi(2));
    let (mut p11, mut p12, mut p22) = (0.0, 0.0, 0.0);
    for k in 0..3 {
        let dt = clock.dt(k);
        let (a, b) = (1.0 - dt * l1, -dt * l2); // M = [[a, dt], [b, 1]]
        let noise = dt * dt / 12.0;
        let next11 = a * a * p11 + 2.0 * a * dt * p12 + dt * dt * p22 + noise * l1 * l1;
        let next12 = a * b * p11 + (a + dt * b) * p12 + dt * p22 + noise * l1 * l2;
        let next22 = b * b * p11 + 2.0 * b * p12 + p22 + noise * l2 * l2;
        (p11, p12, p22) = (next11, next12, next22);
    }
    let (_, covariance) = exact(clock, None, &[(0, 3)]);
    close("P11(3)", covariance[(0, 0)], p11, 1e-12);
    close("P12(3)", covariance[(0, 1)], p12, 1e-12);
    close("P22(3)", covariance[(1, 1)], p22, 1e-12);
}

#[test]
fn time_of_the_decreasing_steps_and_peak() {
    let mut last = 0.0;
    let mut peak = 0.0_f64;
    let watch = |t, _: &[f64], z: &[f64]| {
        last = t;
        peak = peak.max(z[1].abs());
    };
    let run = experiment(Lee, EULER, decreasing(), 100_000);
    run.sampled(&observer(), |u| *u, 0, x0(), observer().initial(), &mut Watch(watch));
    close("t(1e5) = 8 ln(1 + k/k0)", last, 8.0 * 6_f64.ln(), 1e-4);
    printed("peak of x2 estimate", peak, 669.0, 0);
}

/// I + αb·A₀ is Schur exactly for αb < 1 when h = (2, 2), so for T < ε.
#[test]
fn largest_stable_period_is_epsilon() {
    let error_after = |period: f64| {
        let clock = Clock::Fixed(FixedStep::new(period).unwrap());
        let run = experiment(Lee, PlantScheme::Held, clock, 4_000);
        let start = StandardState { x_hat: Vector2::new(1.0, 0.0), r: () };
        run.sampled(
            &observer(),
            |u| *u,
            0,
            Vector2::zeros(),
            start,
            &mut Watch(|_, _: &_, _: &_| {}),
        )
    };
    let below = error_after(0.99 * EPSILON);
    assert!(below.diverged_at.is_none() && below.z.x_hat.amax() < 1e-6, "{below:?}");
    assert!(error_after(1.01 * EPSILON).diverged_at.is_some());
}
