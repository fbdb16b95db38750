//! Velocity and acceleration from noisy positions: the low-power observer as a differentiator.
//!
//! `cargo run --release --example differentiate`

use hgo_rs::noise::{Channel, Stream};
use hgo_rs::prelude::*;

fn main() -> Result<(), DesignError> {
    // Order 3 estimates position, velocity and acceleration; 2·3 − 1 = 5 poles, all at −1.
    let (alpha, beta) = low_power_coefficients_from_poles::<f64, 3, 5>([(-1.0, 0.0); 5])?;
    // In 1/s. A smaller gain lags behind the signal, a larger one amplifies its noise.
    let gain = ConstantGain::new(80.0)?;
    let law = LowPowerObserver::new(alpha, beta, gain, Unknown, NoSaturation)?;
    let scheme = RungeKutta { integrator: Integrator::Rk4, hold: Hold::Innovation };
    let observer = Discretised { law, scheme };

    let (dt, omega) = (1e-3, 2.0_f64);
    let mut noise = Stream::new(1, 0, Channel::Measurement);
    let mut z = observer.initial();
    let (mut squares, mut count) = ([0.0; 2], 0.0);
    println!("{:>5} {:>9} {:>9} {:>9} {:>9}", "t", "velocity", "true", "accel.", "true");
    for k in 0..10_000_u32 {
        let t = f64::from(k) * dt;
        let (velocity, acceleration) =
            (omega * (omega * t).cos(), -omega * omega * (omega * t).sin());
        let estimate = observer.estimate(&z);
        if k % 1_000 == 0 && k > 0 {
            println!(
                "{t:5.1} {:9.4} {velocity:9.4} {:9.4} {acceleration:9.4}",
                estimate[1], estimate[2]
            );
        }
        if k >= 1_000 {
            squares[0] += (estimate[1] - velocity).powi(2);
            squares[1] += (estimate[2] - acceleration).powi(2);
            count += 1.0;
        }
        // A sample may be missing: the observer then predicts over it.
        let missing = (4_000..4_020).contains(&k);
        let y = if missing { f64::NAN } else { (omega * t).sin() + 1e-3 * noise.normal() };
        observer.step(&mut z, &y, &no_input(), t, dt);
    }
    let [velocity, acceleration] = squares.map(|sum| (sum / count).sqrt());
    println!("RMS error after 1 s: velocity {velocity:.4}, acceleration {acceleration:.3}");
    Ok(())
}
