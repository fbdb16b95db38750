//! The figures of the five papers, corrected where a paper contradicts itself, computed by the core.
//!
//! Expected values come from independent solvers (exact covariance recursions, adaptive
//! Runge-Kutta integration, closed forms) or from the papers' tables; none from this crate.
//! Millions of steps: they run under `cargo test --release` only.
#![cfg(not(debug_assertions))]

mod astolfi;
mod fu;
mod katayama;
mod lee;
mod sanfelice_praly;

use hgo_rs::Observer;
use hgo_rs::gain::{AdaptiveGain, ConstantGain, GainLaw};
use hgo_rs::integrate::{Integrator, PlantScheme};
use hgo_rs::memory::Memory;
use hgo_rs::metrics::{Moments, SettlingTime, Window};
use hgo_rs::model::{Plant, Unknown, no_input};
use hgo_rs::models::{Lee, SanfelicePraly};
use hgo_rs::noise::{Draw, Noise, Sine};
use hgo_rs::observer::{ContinuousLaw, Discretised, Measurement, StaggeredEuler};
use hgo_rs::observers::{StandardObserver, StandardState};
use hgo_rs::schedule::{FixedStep, Schedule};
use hgo_rs::simulate::{Experiment, Probe, RunMetrics, Sample};
use nalgebra::Vector2;

const QUIET: Noise<'static, f64> = Noise { draw: Draw::None, hold: 1, sines: &[] };
const RK4: PlantScheme = PlantScheme::Deterministic(Integrator::Rk4);

/// Whole steps of length dt in a time.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
fn steps(time: f64, dt: f64) -> u64 {
    (time / dt).round() as u64
}

/// |ours − expected| ≤ tolerance · |expected|.
#[track_caller]
fn close(what: &str, ours: f64, expected: f64, tolerance: f64) {
    let off = (ours - expected).abs() / expected.abs();
    assert!(off <= tolerance, "{what}: {ours} instead of {expected}, off by {off:.2e}");
}

/// The value agrees with one printed with this many decimals.
#[track_caller]
fn printed(what: &str, ours: f64, expected: f64, decimals: i32) {
    let unit = 10_f64.powi(-decimals);
    let same = (ours - expected).abs() <= 0.5 * unit * (1.0 + 1e-9);
    assert!(same, "{what}: {ours} does not round to {expected}");
}

fn experiment<P: Plant<f64>, S: Schedule<f64>>(
    plant: P,
    plant_scheme: PlantScheme,
    schedule: S,
    steps: u64,
) -> Experiment<'static, f64, P, S> {
    Experiment {
        plant,
        plant_scheme,
        substeps: 1,
        schedule,
        plant_schedule: None,
        noise: QUIET,
        steps,
        seed: 1,
    }
}

/// Moments of the errors (and further memory entries), peaks and settling time of a run.
struct Metrics {
    windows: Vec<Window>,
    signals: usize,
    moments: Vec<Moments<f64>>,
    peak: Vec<f64>,
    settling: SettlingTime<f64>,
}

impl Metrics {
    fn new(windows: &[(u64, u64)], signals: usize, memory: usize) -> Self {
        Self {
            windows: windows.iter().map(|(from, to)| Window { from: *from, to: *to }).collect(),
            signals,
            moments: vec![Moments::default(); windows.len() * signals],
            peak: vec![0.0; memory],
            settling: SettlingTime::new(0.01),
        }
    }

    fn signal(&self, window: usize, index: usize) -> &Moments<f64> {
        &self.moments[window * self.signals + index]
    }
}

impl Probe<f64> for Metrics {
    fn sample<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
        &mut self,
        sample: &Sample<'_, f64, X, Z, Y>,
    ) {
        let mut metrics = RunMetrics {
            windows: &self.windows,
            signals: self.signals,
            moments: &mut self.moments,
            peak: &mut self.peak,
            settling: Some(self.settling),
            histogram: None,
        };
        metrics.sample(sample);
        self.settling = metrics.settling.unwrap();
    }
}

/// Calls a closure with (t, truth, memory).
struct Watch<F>(F);

impl<F: FnMut(f64, &[f64], &[f64])> Probe<f64> for Watch<F> {
    fn sample<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
        &mut self,
        sample: &Sample<'_, f64, X, Z, Y>,
    ) {
        let mut memory = [0.0; 32];
        sample.z.write(&mut memory);
        (self.0)(sample.t, sample.truth, &memory[..Z::LEN]);
    }
}

fn std_of(moments: &Moments<f64>) -> f64 {
    (moments.rms().powi(2) - moments.mean().powi(2)).sqrt()
}

/// Under A sin ωt at a plant at rest, the standard law is a linear filter: its error has the
/// amplitude A·|H(jω)|, H₁ = (k₁ℓs + k₂ℓ²)/(s² + k₁ℓs + k₂ℓ²), H₂ = k₂ℓ²s/(s² + k₁ℓs + k₂ℓ²).
#[test]
fn joint_integration_carries_sines_continuously() {
    let (ell, omega, amplitude) = (20.0, 30.0, 0.5);
    let gain = ConstantGain::new(ell).unwrap();
    let law = StandardObserver::new([2.0, 2.0], gain, Unknown).unwrap();
    let sines = [Sine { amplitude, omega, phase: 0.7 }];
    let period = core::f64::consts::TAU / omega;
    let clock = FixedStep::new(period / 100.0).unwrap();
    let run = Experiment {
        noise: Noise { draw: Draw::None, hold: 1, sines: &sines },
        ..experiment(Lee, PlantScheme::Held, clock, 3_000)
    };
    let mut metrics = Metrics::new(&[(2_000, 3_000)], 2, 2);
    let z0 = law.initial();
    run.joint(&law, |u| *u, Integrator::Rk4, 0, Vector2::zeros(), z0, &mut metrics);
    let (a1, a0) = (2.0 * ell, 2.0 * ell * ell);
    let denominator = ((a0 - omega * omega).powi(2) + (a1 * omega).powi(2)).sqrt();
    let h = [((a1 * omega).powi(2) + a0 * a0).sqrt() / denominator, a0 * omega / denominator];
    for (i, h) in h.into_iter().enumerate() {
        let rms = amplitude * h / core::f64::consts::SQRT_2;
        close("RMS of the response", metrics.signal(0, i).rms(), rms, 1e-6);
    }
}

/// A gain law is a choice of its own: the staggered scheme moves r by forward Euler.
#[test]
fn staggered_step_written_out() {
    let gain = AdaptiveGain::new(10.0, 0.0025, 0.183).unwrap();
    let model = SanfelicePraly::new(1.9, 0.1).unwrap();
    let law = StandardObserver::new([2.0, 2.0], gain, model).unwrap();
    let observer = Discretised { law, scheme: StaggeredEuler };
    let (x1, x2, r, y, dt) = (0.3, -0.2, 1.4_f64, 0.5, 0.01);
    let mut z = StandardState { x_hat: Vector2::new(x1, x2), r };
    observer.step(&mut z, &y, &no_input(), 0.0, dt);
    let e = y - x1;
    let new2 = x2 + dt * 2.0 * r * r * e;
    let new1 = x1 + dt * (new2 + 1.9 * x1 + 2.0 * r * e);
    let rate = 10.0 * ((e * e - 0.0025) * r.powf(1.0 - 2.0 * 0.183) + 0.0025 / r.powi(4));
    close("x1", z.x_hat.x, new1, 1e-14);
    close("x2", z.x_hat.y, new2, 1e-14);
    close("r", z.r, r + dt * rate, 1e-14);
    assert_eq!(gain.rate::<2>(&r, e).to_bits(), gain.rate::<2>(&r, -e).to_bits());
}
