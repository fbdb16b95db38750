//! Fu, Kang and Li: the spectrum of the error and its stationary size.

use super::{close, experiment, steps};
use hgo_rs::Observer;
use hgo_rs::integrate::{Integrator, PlantScheme, StochasticIntegrator, plant_step};
use hgo_rs::metrics::{LogHistogram, Moments, Window};
use hgo_rs::model::no_input;
use hgo_rs::models::{Correction, Diffusion, VanDerPol};
use hgo_rs::observers::SampledDataObserver;
use hgo_rs::schedule::FixedStep;
use hgo_rs::simulate::{Experiment, RunMetrics};
use nalgebra::Vector2;

fn model(correction: Correction) -> VanDerPol<f64> {
    VanDerPol::new(0.8, 0.5, Diffusion::Additive, correction).unwrap()
}

/// (e⁺ − e)/T as a matrix of e, for a plant and an observer that both take one Euler step.
fn error_matrix(correction: Correction, y: f64, x2: f64, dt: f64) -> [[f64; 2]; 2] {
    let model = model(correction);
    let observer = SampledDataObserver::<_, 2> { model };
    let x = Vector2::new(y, x2);
    let column = |e: Vector2<f64>| {
        let mut x_hat = x - e;
        observer.step(&mut x_hat, &y, &no_input(), 0.0, dt);
        let moved = plant_step(Integrator::Euler, &model, 0.0, &x, &no_input(), dt);
        (moved - x_hat - e) / dt
    };
    let (first, second) = (column(Vector2::x()), column(Vector2::y()));
    [[first.x, second.x], [first.y, second.y]]
}

/// λ² + 5λ + 6 at every y and x̂: the spectrum {−2, −3} of the derived correction.
#[test]
fn derived_correction_has_the_spectrum_minus_2_minus_3() {
    for (y, x2) in [(0.0, 0.0), (1.0, -0.5), (-1.7, 2.0), (2.0, 1.0), (0.3, -3.0)] {
        for dt in [0.003, 0.03, 0.3] {
            let [[a, b], [c, d]] = error_matrix(Correction::Derived, y, x2, dt);
            assert!((a + d + 5.0).abs() < 1e-10, "trace {}", a + d);
            assert!((a * d - b * c - 6.0).abs() < 1e-10, "determinant {}", a * d - b * c);
        }
    }
    // As printed, −5 + 2μ replaces the trace: not constant, and 2μ > 5 does not occur here.
    let trace = |y| {
        let [[a, _], [_, d]] = error_matrix(Correction::Printed, y, 0.5, 0.03);
        a + d
    };
    close("trace as printed, y = 0", trace(0.0), -5.0 + 2.0 * 0.8, 1e-12);
    close("trace as printed, y = 2", trace(2.0), -5.0 - 2.0 * 2.4, 1e-12);
}

/// Stationary E‖e‖² on [21, 99) s, its median and its 95 % quantile.
fn stationary(correction: Correction, dt: f64, substeps: u32, runs: u64) -> [f64; 3] {
    let model = model(correction);
    let observer = SampledDataObserver::<_, 2> { model };
    let taylor = PlantScheme::Stochastic(StochasticIntegrator::Taylor15);
    let clock = FixedStep::new(dt).unwrap();
    let total = steps(99.0, dt);
    let study = Experiment { substeps, ..experiment(model, taylor, clock, total) };
    let window = Window { from: steps(21.0, dt), to: total };
    let mut counts = vec![0; LogHistogram::BINS];
    let mut mean = 0.0;
    for run in 0..runs {
        let (mut moments, mut peak) = ([Moments::default(); 2], [0.0; 2]);
        let mut probe = RunMetrics {
            windows: &[window],
            signals: 2,
            moments: &mut moments,
            peak: &mut peak,
            settling: None,
            histogram: Some((window, LogHistogram::new(&mut counts))),
        };
        let (x0, z0) = (Vector2::new(1.0, 0.0), Vector2::new(0.0, 1.0));
        let end = study.sampled(&observer, |u| *u, run, x0, z0, &mut probe);
        assert_eq!(end.diverged_at, None, "run {run}");
        mean += moments.iter().map(|m| m.rms().powi(2)).sum::<f64>() / runs as f64;
    }
    let histogram = LogHistogram::new(&mut counts);
    [mean, histogram.quantile(0.5), histogram.quantile(0.95)]
}

#[test]
fn stationary_error_in_a_short_study() {
    let [mean, ..] = stationary(Correction::Derived, 0.1, 5, 24);
    close("E|e|^2, T = 0.1", mean, 0.1128, 0.06);
}

#[test]
fn stationary_error() {
    // T, substeps, mean, median, 95 %
    let table = [
        (Correction::Derived, 0.03, 6, [0.1032, 0.0442, 0.405], 0.03),
        (Correction::Derived, 0.1, 20, [0.1128, 0.0481, 0.443], 0.03),
        (Correction::Derived, 0.3, 60, [0.2947, 0.127, 1.21], 0.03),
        (Correction::Printed, 0.1, 20, [0.1095, 0.0461, 0.434], 0.03),
        (Correction::Printed, 0.3, 60, [0.380, 0.136, 1.60], 0.06),
    ];
    for (correction, dt, substeps, expected, tolerance) in table {
        let ours = stationary(correction, dt, substeps, 800);
        for (what, i) in [("mean", 0), ("median", 1), ("95 %", 2)] {
            close(&format!("{what}, {correction:?}, T = {dt}"), ours[i], expected[i], tolerance);
        }
    }
}
