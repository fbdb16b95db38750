//! The high-gain observer by stochastic approximation (Lee, Choi and Khalil): decreasing steps
//! a(k) average measurement noise out that a fixed step T keeps for ever.
//!
//! `cargo run --release --example stochastic_approximation`

use hgo_rs::integrate::PlantScheme;
use hgo_rs::metrics::{Moments, Window};
use hgo_rs::models::Lee;
use hgo_rs::nalgebra::Vector2;
use hgo_rs::noise::{Draw, Noise};
use hgo_rs::prelude::*;
use hgo_rs::simulate::{Experiment, RunMetrics};

/// RMS of x̂₂ − x₂ over the windows, by one run under `schedule`.
fn study(schedule: impl Schedule<f64>, windows: &[Window; 4]) -> Result<[f64; 4], DesignError> {
    let gain = ConstantGain::from_epsilon(0.01)?;
    let law = StandardObserver::new([2.0, 2.0], gain, Unknown)?; // (39) with h = (2, 2)
    let observer = Discretised { law, scheme: Euler };
    let experiment = Experiment {
        plant: Lee,
        plant_scheme: PlantScheme::Deterministic(Integrator::Euler),
        substeps: 1,
        schedule,
        plant_schedule: None,
        noise: Noise { draw: Draw::Uniform { low: -0.5, high: 0.5 }, hold: 1, sines: &[] },
        steps: windows[3].to,
        seed: 1,
    };
    let (mut moments, mut peak) = ([Moments::default(); 8], [0.0; 2]);
    let mut metrics = RunMetrics {
        windows,
        signals: 2,
        moments: &mut moments,
        peak: &mut peak,
        settling: None,
        histogram: None,
    };
    let x0 = Vector2::new(10.0, 10.0);
    experiment.sampled(&observer, |u| *u, 0, x0, observer.initial(), &mut metrics);
    Ok(core::array::from_fn(|w| moments[2 * w + 1].rms()))
}

fn main() -> Result<(), DesignError> {
    let windows = [20_000, 50_000, 100_000, 200_000].map(|k| Window { from: k, to: 2 * k });
    let fixed = study(FixedStep::new(0.0004)?, &windows)?; // (42)
    let decreasing = StochasticApproximation::new(0.04, 0.01, 20_000.0, 1.0)?;
    let approximated = study(decreasing, &windows)?; // (44)
    println!("{:>18} {:>10} {:>10}", "samples", "fixed T", "a(k)");
    for (w, (fixed, approximated)) in windows.iter().zip(fixed.iter().zip(approximated)) {
        println!("{:>8} to {:>6} {fixed:>10.3} {approximated:>10.3}", w.from, w.to);
    }
    Ok(())
}
