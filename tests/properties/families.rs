//! What the families are by definition: exponentials, integrals and powers, written once more in plain arithmetic.

use super::{close, config};
use hgo_rs::Observer;
use hgo_rs::covariance::ErrorCovariance;
use hgo_rs::gain::{ConstantGain, GainLaw, HomogeneousGain, PrescribedTimeGain};
use hgo_rs::injection::Placement;
use hgo_rs::inter_sample::InterSample;
use hgo_rs::metrics::{Moments, Window};
use hgo_rs::model::{Unknown, no_input};
use hgo_rs::motion::Held;
use hgo_rs::observer::{Discretised, Euler};
use hgo_rs::observers::{StandardObserver, StandardState};
use hgo_rs::schedule::FixedStep;
use hgo_rs::simulate::{Probe, Sample};
use nalgebra::{Matrix2, Vector2, Vector3};
use proptest::prelude::*;

type Chain3 = StandardObserver<f64, ConstantGain<f64>, Unknown, 3>;

/// A complex number times another.
fn times((a, b): (f64, f64), (c, d): (f64, f64)) -> (f64, f64) {
    (a * c - b * d, a * d + b * c)
}

/// One over a complex number.
fn inverse((a, b): (f64, f64)) -> (f64, f64) {
    let square = a * a + b * b;
    (a / square, -b / square)
}

/// Steps of the predictor's two equations in time, by Runge and Kutta's method of order 4.
fn integrated(k: [f64; 3], x: Vector3<f64>, y: f64, dt: f64) -> Vector3<f64> {
    let rate = |(x, w): (Vector3<f64>, f64)| {
        let e = w - x.x;
        (Vector3::new(x.y + k[0] * e, x.z + k[1] * e, k[2] * e), x.y)
    };
    let plus =
        |a: (Vector3<f64>, f64), b: (Vector3<f64>, f64), h: f64| (a.0 + b.0 * h, a.1 + b.1 * h);
    let (steps, mut z) = (4000, (x, y));
    let h = dt / f64::from(steps);
    for _ in 0..steps {
        let k1 = rate(z);
        let k2 = rate(plus(z, k1, 0.5 * h));
        let k3 = rate(plus(z, k2, 0.5 * h));
        let k4 = rate(plus(z, k3, h));
        let sum = plus(plus(k1, k4, 1.0), plus(k2, k3, 1.0), 2.0);
        z = plus(z, sum, h / 6.0);
    }
    z.0
}

proptest! {
    #![proptest_config(config(256))]

    /// e^h, (2 + h)/(2 − h) and 1/(1 − h) less 1, for any h of the left half plane.
    #[test]
    fn eigenvalues_are_placed_where_the_rule_says(a in -60.0..0.0, b in -20.0..20.0) {
        let (grown, angle): (f64, f64) = (f64::exp(a), b);
        let exact = (grown * angle.cos() - 1.0, grown * angle.sin());
        let bilinear = times((2.0 + a, b), inverse((2.0 - a, -b)));
        let mapped = inverse((1.0 - a, -b));
        for (rule, (re, im)) in [
            (Placement::Exact, exact),
            (Placement::Bilinear, (bilinear.0 - 1.0, bilinear.1)),
            (Placement::ImplicitMap, (mapped.0 - 1.0, mapped.1)),
        ] {
            let found = rule.shift((a, b));
            prop_assert!((found.0 - re).abs() < 1e-13 && (found.1 - im).abs() < 1e-13, "{rule:?}: {found:?}");
        }
    }

    /// A step of the inter-sample predictor is the solution of its two equations.
    #[test]
    fn between_samples_the_output_is_predicted_too(
        dt in 1e-3..1.0, ell in 1.0..30.0, x in prop::array::uniform3(-2.0..2.0), y in -2.0..2.0,
    ) {
        let k = [3.0, 3.0, 1.0];
        let law = Chain3::new(k, ConstantGain::new(ell).unwrap(), Unknown).unwrap();
        let observer = InterSample { law, motion: Held };
        let mut z = observer.initial();
        z.0.x_hat = Vector3::from(x);
        observer.step(&mut z, &y, &no_input(), 0.0, dt);
        let gains = [k[0] * ell, k[1] * ell.powi(2), k[2] * ell.powi(3)];
        let right = integrated(gains, Vector3::from(x), y, dt);
        let size = gains.iter().sum::<f64>() * dt.min(1.0) + 1.0;
        prop_assert!((z.0.x_hat - right).amax() < 1e-9 * size, "{} {right}", z.0.x_hat);
    }

    /// Levant's differentiator injects kᵢ L^{i/n} |e|^{(n−i)/n} sign e; d in between and μ by r(e).
    #[test]
    fn homogeneous_injections_are_powers(
        bound in 0.1..50.0, e in -3.0..3.0, degree in -1.0..0.0, mu in 0.0..4.0, dt in 1e-4..1e-2,
    ) {
        let k = [2.0, 2.121, 1.1];
        let law = StandardObserver::<f64, _, _, 3>::new(k, HomogeneousGain::levant(bound, 3).unwrap(), Unknown);
        let observer = Discretised { law: law.unwrap(), scheme: Euler };
        let mut z = StandardState { x_hat: Vector3::zeros(), r: () };
        observer.step(&mut z, &e, &no_input(), 0.0, dt);
        for (i, k) in (1..=3_i32).zip(k) {
            let power = f64::from(3 - i) / 3.0;
            let right = dt * k * bound.powf(f64::from(i) / 3.0) * e.abs().powf(power) * e.signum();
            prop_assert!(close(z.x_hat[usize::try_from(i).unwrap() - 1], right, 1e-12));
        }
        let gain = HomogeneousGain::new(2.0, degree, mu, 4).unwrap();
        let r = e.abs().powf(degree / (1.0 - 3.0 * degree)) * (1.0 + mu * e.abs());
        prop_assert!(close(gain.moving(&(), e), r, 1e-12));
    }

    /// μ₀/(T_p − t) at every step, then r_max.
    #[test]
    fn the_prescribed_gain_grows_until_its_deadline(
        mu0 in 1.0..6.0, deadline in 0.2..2.0, most in 10.0..100.0, y in -1.0..1.0,
    ) {
        prop_assume!(most > 1.01 * mu0 / deadline);
        let gain = PrescribedTimeGain::new(mu0, deadline, most).unwrap();
        let law = StandardObserver::<f64, _, _, 2>::new([2.0, 1.0], gain, Unknown).unwrap();
        let observer = Discretised { law, scheme: Euler };
        let (mut z, dt) = (observer.initial(), 1e-3);
        let (mut x1, mut x2) = (0.0, 0.0);
        for k in 0..2500_u32 {
            let ell = (mu0 / (deadline - 1e-3 * f64::from(k)).max(1e-12)).min(most);
            let e = y - x1;
            (x1, x2) = (x1 + dt * (x2 + 2.0 * ell * e), x2 + dt * ell * ell * e);
            observer.step(&mut z, &y, &no_input(), 0.0, dt);
            prop_assert!((z.x_hat - Vector2::new(x1, x2)).amax() < 1e-7 * (1.0 + x2.abs()));
        }
    }

    /// P(k + 1) = M P Mᵀ + dt² L Lᵀ σ², and e² on average is the mean's square and P's diagonal.
    #[test]
    fn the_error_has_the_covariance_of_its_recursion(
        l in prop::array::uniform2(0.5..20.0), sigma in 0.01..1.0, dt in 1e-3..2e-2,
        truth in prop::array::uniform2(-1.0..1.0), estimate in prop::array::uniform2(-1.0..1.0),
    ) {
        let windows = [Window { from: 3, to: 9 }];
        let mut moments = vec![Moments::default(); 2];
        let clock = FixedStep::<f64>::new(dt).unwrap();
        let mut probe = ErrorCovariance::new(clock, l, sigma * sigma, &windows, &mut moments, || false);
        let m = Matrix2::new(1.0 - dt * l[0], dt, -dt * l[1], 1.0);
        let b: Vector2<f64> = Vector2::from(l) * (dt * sigma);
        let (mut p, mut squares) = (Matrix2::<f64>::zeros(), [0.0; 2]);
        for k in 0..9 {
            let (x, z, y) = (Vector2::from(truth), Vector2::from(estimate), 0.0);
            probe.sample(&Sample { k, t: 0.0, x: &x, z: &z, y: &y, truth: &truth, estimate: &estimate });
            prop_assert!((probe.covariance - p).amax() <= 1e-13 * p.amax());
            if k >= 3 {
                for (i, square) in squares.iter_mut().enumerate() {
                    *square += (f64::powi(estimate[i] - truth[i], 2) + p[(i, i)]) / 6.0;
                }
            }
            p = m * p * m.transpose() + b * b.transpose();
        }
        for (moment, square) in moments.iter().zip(squares) {
            prop_assert!(close(moment.rms(), square.sqrt(), 1e-12));
        }
    }
}

/// The implicit step has a closed form for the degrees -1 and 0 without a uniform part.
#[test]
fn the_implicit_step_is_for_two_degrees() {
    for (degree, mu, closed) in
        [(-1.0, 0.0, true), (0.0, 0.0, true), (-0.5, 0.0, false), (-1.0, 0.1, false)]
    {
        let gain = HomogeneousGain::new(2.0, degree, mu, 3).unwrap();
        assert_eq!(gain.closed().is_ok(), closed, "{degree}, {mu}");
    }
}
