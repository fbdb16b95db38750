//! A step in two halves, a clock, and time and input in every function of a model: against recursions
//! that are written out here.

#![allow(clippy::float_cmp)] // where two numbers are compared for equality, equal bits are meant

use hgo_rs::estimator::{Clock, Counts};
use hgo_rs::integrate::{Integrator, WienerIncrement};
use hgo_rs::memory::Memory;
use hgo_rs::model::{SampledModel, StochasticIntegrator, StrictFeedback};
use hgo_rs::observer::CurrentState;
use hgo_rs::observer::{ContinuousLaw, Measurement, Rk4, Timing};
use hgo_rs::observers::StandardState;
use hgo_rs::prelude::*;
use hgo_rs::simulate::{Probe, Sample};
use nalgebra::{Matrix1, SVector, Vector1, Vector2, Vector3, Vector4};

fn close(ours: f64, expected: f64) {
    assert!((ours - expected).abs() <= 1e-12 * expected.abs().max(1.0), "{ours}, not {expected}");
}

/// φ = 3t + 2u − x₁ x₂: nothing that is passed on may be left out.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Everything;

impl<const N: usize> Model<f64, N, 1> for Everything {
    fn f_hat(&self, t: f64, x: &SVector<f64, N>, u: &Vector1<f64>) -> SVector<f64, N> {
        last(self.phi(t, x, u))
    }
}

impl<const N: usize> PhaseVariable<f64, N, 1> for Everything {
    fn phi(&self, t: f64, x: &SVector<f64, N>, u: &Vector1<f64>) -> f64 {
        3.0 * t + 2.0 * u.x - x[0] * x[1]
    }
}

const ELL: f64 = 20.0;

fn everything() -> StandardObserver<f64, ConstantGain<f64>, Everything, 2, 1> {
    StandardObserver::new([2.0, 1.0], ConstantGain::new(ELL).unwrap(), Everything).unwrap()
}

/// The placed observer of two real poles −ℓ, written out: with z = e^{−ℓT}, T the time since the last
/// sample used, K = (1 − z², (1 − z)²/T); between the samples the chain is moved exactly, φ is held.
struct Filter {
    x: [f64; 2],
    elapsed: f64,
}

impl Filter {
    fn correct(&mut self, y: f64) {
        if y.is_finite() && self.elapsed > 0.0 {
            let z = (-ELL * self.elapsed).exp();
            let e = y - self.x[0];
            self.x[0] += (1.0 - z * z) * e;
            self.x[1] += (1.0 - z).powi(2) / self.elapsed * e;
        }
        if y.is_finite() {
            self.elapsed = 0.0;
        }
    }
    fn predict(&mut self, phi: f64, dt: f64) {
        self.x[0] += dt * self.x[1] + dt * dt / 2.0 * phi;
        self.x[1] += dt * phi;
        self.elapsed += dt;
    }
}

/// Samples at 10 to 40 ms, in 1024ths of a second so that sums of times are exact; two gaps.
fn record() -> Vec<(f64, f64, f64)> {
    let mut stream = Stream::new(5, 0, Channel::Measurement);
    (0..200)
        .map(|k| {
            let (a, b) = stream.normal_pair();
            let dt = (25.0 + 8.0 * a).round().clamp(10.0, 41.0) / 1024.0;
            let missing = (40..43).contains(&k) || k == 0 || k == 120;
            (if missing { f64::NAN } else { b }, (0.3 * f64::from(k)).sin(), dt)
        })
        .collect()
}

#[test]
fn halves_under_jitter_gaps_time_and_input_written_out() {
    let law = everything();
    let observer = Current { law, scheme: Placed::new(&law, Placement::Exact).unwrap() };
    let mut estimator = Estimator::new(observer, 1.0).unwrap();
    let mut z = observer.initial();
    let (mut filter, mut t) = (Filter { x: [0.0; 2], elapsed: 0.0 }, 0.0);
    for (k, (y, u, dt)) in record().into_iter().enumerate() {
        let told = Vector1::new(u);
        let status = if y.is_finite() { Status::Updated } else { Status::Predicted };
        assert_eq!(estimator.correct(&y), status);
        assert_eq!(observer.correct(&mut z, &y, t), status);
        filter.correct(y);
        for (ours, expected) in estimator.estimate().iter().zip(filter.x) {
            assert!((ours - expected).abs() < 1e-9 * expected.abs().max(1.0), "sample {k}");
        }
        // the loop over a record has the bits of the loop on line
        assert_eq!(*estimator.memory(), z, "sample {k}");
        assert_eq!(estimator.predict(&told, dt), Status::Predicted);
        observer.advance(&mut z, &y, &told, t, dt);
        filter.predict(3.0 * t + 2.0 * u - filter.x[0] * filter.x[1], dt);
        t += dt;
        assert_eq!((estimator.time(), z.elapsed), (t, filter.elapsed));
    }
}

/// `step` belongs to the period that is over, and its first call only corrects.
#[test]
fn a_step_is_predict_then_correct() {
    fn compare<O: Causal<f64, Measurement = f64, Input = Vector1<f64>>>(observer: O)
    where
        O::State: PartialEq + core::fmt::Debug,
    {
        let mut halves = Estimator::new(observer, 1.0).unwrap();
        let mut whole = halves;
        let (mut z, mut over, mut t) = (observer.initial(), None, 0.0);
        for (y, u, dt) in record() {
            let u = Vector1::new(u);
            let status = halves.correct(&y);
            let (last, length) = over.unwrap_or((u, f64::NAN));
            assert_eq!(whole.step(&y, &last, length), status);
            assert_eq!(halves.memory(), whole.memory());
            if over.is_some() {
                observer.step(&mut z, &y, &last, t - length, length);
                assert_eq!(z, *whole.memory());
            }
            halves.predict(&u, dt);
            over = Some((u, dt));
            t += dt;
        }
    }
    let law = everything();
    compare(Current { law, scheme: Placed::new(&law, Placement::Exact).unwrap() });
    compare(Current { law, scheme: Placed::new(&law, Placement::Bilinear).unwrap() });
    compare(Current { law, scheme: Euler });
    compare(Current { law, scheme: Rk4 });
}

/// A correction of the methods that are not placed is for the last period, by forward Euler.
#[test]
fn a_correction_of_euler_is_for_the_last_period() {
    let law = everything();
    let observer = Current { law, scheme: Euler };
    let mut z = observer.initial();
    let (u, dt) = (Vector1::new(0.5), [0.02, 0.03]);
    observer.correct(&mut z, &5.0, 1.0);
    assert_eq!(z, observer.initial()); // for no time: nothing
    let mut x = [0.0; 2];
    let mut t = 1.0;
    for (k, dt) in dt.into_iter().enumerate() {
        let phi = 3.0 * t + 1.0 - x[0] * x[1];
        x = [x[0] + dt * x[1], x[1] + dt * phi];
        assert_eq!(observer.advance(&mut z, &9.0, &u, t, dt), Status::Predicted);
        t += dt;
        let y = if k == 0 { f64::NAN } else { 0.7 };
        observer.correct(&mut z, &y, t);
    }
    let e = 0.7 - x[0];
    close(z.law.x_hat.x, x[0] + 0.03 * 2.0 * ELL * e);
    close(z.law.x_hat.y, x[1] + 0.03 * ELL * ELL * e);
    assert_eq!(z.elapsed, 0.0);
    let held = z;
    assert_eq!(observer.correct(&mut z, &0.1, t), Status::Updated); // twice: nothing more
    assert_eq!(z, held);
}

/// The flow of the placed low-power law: x̂ᵢ + Tηᵢ + T²/2 ηᵢ₊₁ + …, φ(t, x̂, u) held at the end.
#[test]
fn a_low_power_flow_is_told_time_and_input() {
    let gain = ConstantGain::new(5.0).unwrap();
    let (alpha, beta) = ([3.0, 3.0, 2.0], [3.2, 1.4, 0.0]);
    let law = LowPowerObserver::<f64, _, _, 3, 1>::new(alpha, beta, gain, Everything, NoSaturation);
    let law = law.unwrap();
    let observer = Current { law, scheme: Placed::new(&law, Placement::Exact).unwrap() };
    let (x, eta, t, u, dt) = ([0.2, -0.4, 0.9], [2.5, -1.7], 1.3, 0.7, 0.04);
    let mut z = Memory::read(&[x[0], x[1], x[2], eta[0], eta[1], 0.0]);
    observer.predict(&mut z, &Vector1::new(u), t, dt);
    let phi = 3.0 * t + 2.0 * u - x[0] * x[1];
    let (half, sixth) = (dt * dt / 2.0, dt * dt * dt / 6.0);
    let expected = [
        x[0] + dt * eta[0] + half * eta[1] + sixth * phi,
        x[1] + dt * eta[1] + half * phi,
        x[2] + dt * phi,
        eta[0] + dt * eta[1] + half * phi,
        eta[1] + dt * phi,
        dt, // the time that the next correction is for
    ];
    let mut ours = [0.0; 6];
    z.write(&mut ours);
    for (ours, expected) in ours.into_iter().zip(expected) {
        close(ours, expected);
    }
}

/// f = (x₂ + t, u), K_T = (t + u + y, x̂₁ dt), h = 2x₁ + t + u.
#[derive(Clone, Copy)]
struct Discrete;

impl SampledModel<f64, 2, 1> for Discrete {
    fn f(&self, t: f64, x: &Vector2<f64>, u: &Vector1<f64>) -> Vector2<f64> {
        Vector2::new(x.y + t, u.x)
    }
    fn correction(
        &self,
        t: f64,
        x: &Vector2<f64>,
        u: &Vector1<f64>,
        y: f64,
        dt: f64,
    ) -> Vector2<f64> {
        Vector2::new(t + u.x + y, x.x * dt)
    }
    fn output(&self, t: f64, x: &Vector2<f64>, u: &Vector1<f64>) -> f64 {
        2.0 * x.x + t + u.x
    }
}

#[test]
fn a_sampled_model_is_told_time_and_input() {
    let observer = SampledDataObserver::<_, 2, 1> { model: Discrete };
    let (mut z, u, t, dt) = (Vector2::new(0.3, -0.2), Vector1::new(0.5), 4.0, 0.1);
    close(observer.innovation(t, &z, &7.0, &u), 7.0 - (0.6 + 4.0 + 0.5));
    assert_eq!(observer.advance(&mut z, &7.0, &u, t, dt), Status::Updated);
    close(z.x, 0.3 + 0.1 * (-0.2 + 4.0) + (4.0 + 0.5 + 7.0));
    close(z.y, -0.2 + 0.1 * 0.5 + 0.3 * 0.1);
    let x = z;
    assert_eq!(observer.advance(&mut z, &f64::NAN, &u, t, dt), Status::Predicted);
    close(z.x, x.x + 0.1 * (x.y + 4.0));
    close(z.y, x.y + 0.1 * 0.5);
    // without a correction of its own it is step, and no sample is taken before
    let (mut whole, mut corrected) = (x, x);
    observer.step(&mut whole, &f64::NAN, &u, t, dt);
    assert_eq!(whole, z);
    assert_eq!(observer.correct(&mut corrected, &7.0, t), Status::Updated);
    assert_eq!(corrected, x);
}

/// ẋ = t + u + (2 + t) z, ż = 3t + u − z + x/10.
#[derive(Clone, Copy)]
struct Cascade;

impl StrictFeedback<f64, 1, 1, 1> for Cascade {
    fn f1(&self, t: f64, x: &Vector1<f64>, u: &Vector1<f64>) -> Vector1<f64> {
        Vector1::new(t + u.x + x.x)
    }
    fn g(&self, t: f64, x: &Vector1<f64>, u: &Vector1<f64>) -> Matrix1<f64> {
        Matrix1::new(2.0 + t + u.x + x.x)
    }
    fn f2(&self, t: f64, x: &Vector1<f64>, z: &Vector1<f64>, u: &Vector1<f64>) -> Vector1<f64> {
        Vector1::new(3.0 * t + u.x - z.x + 0.1 * x.x)
    }
}

/// Katayama (8) with a missing sample between, written out: Ψ from the functions at the last sample, f₂ at
/// the beginning of the step that is closed; and the innovation y − y₀ − T(f₁ + gẑ).
#[test]
fn a_reduced_order_observer_is_told_time_and_input() {
    let observer = ReducedOrderObserver::<f64, _, 1, 1, 1>::new([0.5], 0.25, Cascade).unwrap();
    let h = 2.0;
    let (one, missing) = (|v: f64| Vector1::new(v), Vector1::new(f64::NAN));
    let (t0, [d1, d2], [u1, u2], [y0, y2]) = (3.0, [0.1, 0.15], [0.4, -0.3], [1.2, 1.9]);
    let mut z = observer.initial();
    z.z_hat = one(0.7);
    assert_eq!(observer.correct(&mut z, &one(y0), t0), Status::Updated);
    assert_eq!(z.z_hat.x, 0.7);
    observer.advance(&mut z, &one(y0), &one(u1), t0, d1);
    let (t1, t2) = (t0 + d1, t0 + d1 + d2);
    assert_eq!(observer.correct(&mut z, &missing, t1), Status::Predicted);
    let after = 0.7 + d1 * (3.0 * t0 + u1 - 0.7 + 0.1 * y0);
    close(z.z_hat.x, after);
    observer.advance(&mut z, &missing, &one(u2), t1, d2);

    let (f1, g) = (t0 + u2 + y0, 2.0 + t0 + u2 + y0);
    let innovation = observer.innovation(t2, &z, &one(y2), &one(9.0)).x;
    close(innovation, y2 - y0 - (d1 + d2) * (f1 + g * after));

    assert_eq!(observer.correct(&mut z, &one(y2), t2), Status::Updated);
    let psi = ((y2 - y0) / (d1 + d2) - f1) / g;
    let f2 = 3.0 * t1 + u2 - psi + 0.1 * y0;
    close(z.z_hat.x, after + d2 * (h * (psi - after) + f2));
    assert_eq!((z.y.x, z.elapsed, z.period), (y2, 0.0, 0.0));

    // the step ends at t + dt, and so it corrects
    let end = z;
    observer.step(&mut z, &one(2.5), &one(u1), t2, d1);
    let mut by_halves = end;
    observer.predict(&mut by_halves, &one(u1), t2, d1);
    observer.correct(&mut by_halves, &one(2.5), t2 + d1);
    assert_eq!(z, by_halves);
    let psi = ((2.5 - y2) / d1 - (t2 + u1 + y2)) / (2.0 + t2 + u1 + y2);
    let f2 = 3.0 * t2 + u1 - psi + 0.1 * y2;
    close(z.z_hat.x, end.z_hat.x + d1 * (h * (psi - end.z_hat.x) + f2));
}

/// A period whose input has no value moves no estimate, and counts for the next correction.
#[test]
fn a_reduced_order_observer_counts_a_period_without_a_value() {
    let observer = ReducedOrderObserver::<f64, _, 1, 1, 1>::new([0.5], 0.25, Cascade).unwrap();
    let mut online = Estimator::new(observer, 0.4).unwrap();
    let one = |v: f64| Vector1::new(v);
    online.correct(&one(1.2));
    online.predict(&one(0.4), 0.1);
    online.correct(&one(1.3));
    let before = *online.memory();
    assert_eq!(online.predict(&one(f64::NAN), 0.15), Status::ModelUndefined);
    let after = *online.memory();
    assert_eq!((after.z_hat, after.u, after.period), (before.z_hat, before.u, before.period));
    assert_eq!(after.elapsed, 0.15);
    online.predict(&one(0.4), 0.1);
    assert_eq!(online.correct(&one(1.9)), Status::Updated);
    // the slope is that over both periods, the estimate moves over the second one
    let t = 0.1;
    let psi = ((1.9 - 1.3) / 0.25 - (t + 0.4 + 1.3)) / (2.0 + t + 0.4 + 1.3);
    let f2 = 3.0 * 0.25 + 0.4 - psi + 0.1 * 1.3;
    let z = before.z_hat.x;
    close(online.memory().z_hat.x, z + 0.1 * (2.0 * (psi - z) + f2));
}

/// A pendulum under a torque: q̈ = u − w/2 − 9.81 sin q.
#[derive(Clone, Copy)]
struct Pendulum;

impl Model<f64, 2, 1> for Pendulum {
    fn f_hat(&self, t: f64, x: &Vector2<f64>, u: &Vector1<f64>) -> Vector2<f64> {
        last(self.phi(t, x, u))
    }
}

impl PhaseVariable<f64, 2, 1> for Pendulum {
    fn phi(&self, _: f64, x: &Vector2<f64>, u: &Vector1<f64>) -> f64 {
        u.x - 0.5 * x.y - 9.81 * x.x.sin()
    }
}

/// Ten seconds of a loop at 100 Hz around the pendulum; the RMS of the error of w. `estimate(y, u)` takes
/// the sample and the input that was applied before it; `applied(u)` is told the new one.
fn closed_loop<O>(
    observer: &mut O,
    estimate: fn(&mut O, f64, f64) -> [f64; 2],
    applied: fn(&mut O, f64),
) -> f64 {
    const DT: f64 = 0.01;
    let (mut x, mut u, mut sum) = (Vector2::new(0.3, 0.0), 0.0, 0.0);
    for k in 0..1000 {
        let [q, w] = estimate(observer, x.x, u);
        sum += (w - x.y).powi(2);
        let aim = core::f64::consts::FRAC_PI_2 * (f64::from(k) * DT).sin().signum();
        u = (9.81 * q.sin() - 40.0 * (q - aim) - 12.0 * w).clamp(-60.0, 60.0);
        applied(observer, u);
        for _ in 0..10 {
            let rate = |_: f64, x: &Vector2<f64>| {
                Vector2::new(x.y, Pendulum.phi(0.0, x, &Vector1::new(u)))
            };
            x = hgo_rs::integrate::rk4(rate, 0.0, &x, DT / 10.0);
        }
    }
    (sum / 1000.0).sqrt()
}

#[test]
fn a_stiff_loop_sees_the_input_that_is_applied() {
    const DT: f64 = 0.01;
    let gain = ConstantGain::new(40.0).unwrap();
    let law = StandardObserver::<f64, _, _, 2, 1>::new([2.0, 1.0], gain, Pendulum).unwrap();
    let observer = Current { law, scheme: Placed::new(&law, Placement::Exact).unwrap() };
    let law = StandardState { x_hat: Vector2::new(0.3, 0.0), r: () };
    let start = CurrentState { law, elapsed: 0.0 };
    let mut estimator = Estimator::new(observer, 1.0).unwrap();
    estimator.restart(start);
    let mut stale = estimator;
    let causal = closed_loop(
        &mut estimator,
        |observer, y, _| {
            observer.correct(&y);
            [observer.estimate()[0], observer.estimate()[1]]
        },
        |observer, u| {
            observer.predict(&Vector1::new(u), DT);
        },
    );
    // the same filter by hand, whose memory is moved under the input once that is known
    let mut by_hand = [0.3, 0.0, f64::NAN];
    let patched = closed_loop(
        &mut by_hand,
        |[q, w, u], y, _| {
            if u.is_finite() {
                let phi = *u - 0.5 * *w - 9.81 * q.sin();
                (*q, *w) = (*q + DT * *w + DT * DT / 2.0 * phi, *w + DT * phi);
                let (e, z) = (y - *q, (-40.0 * DT).exp());
                (*q, *w) = (*q + (1.0 - z * z) * e, *w + (1.0 - z).powi(2) / DT * e);
            }
            [*q, *w]
        },
        |memory, u| memory[2] = u,
    );
    assert!(causal <= 1.1 * patched && causal < 4e-3, "{causal}, by hand {patched}");
    // and one that is moved under the input before shows what the two halves are for
    let late = closed_loop(
        &mut (&mut stale, 0.0),
        |(observer, _), y, _| {
            observer.correct(&y);
            [observer.estimate()[0], observer.estimate()[1]]
        },
        |(observer, before), u| {
            observer.predict(&Vector1::new(*before), DT);
            *before = u;
        },
    );
    assert!(late > 5.0 * causal, "{late}");
}

/// φ = 1/u: no value without an input.
#[derive(Clone, Copy)]
struct Quotient;

impl Model<f64, 2, 1> for Quotient {
    fn f_hat(&self, _: f64, _: &Vector2<f64>, u: &Vector1<f64>) -> Vector2<f64> {
        last(1.0 / u.x)
    }
}

#[test]
fn a_model_without_a_value_holds_the_estimate_and_time_passes() {
    let gain = ConstantGain::new(ELL).unwrap();
    let law = StandardObserver::<f64, _, _, 2, 1>::new([2.0, 1.0], gain, Quotient).unwrap();
    let observer = Current { law, scheme: Placed::new(&law, Placement::Exact).unwrap() };
    let mut estimator = Estimator::new(observer, 1.0).unwrap();
    let (zero, one) = (Vector1::new(0.0), Vector1::new(1.0));
    assert_eq!(estimator.correct(&2.0), Status::Updated);
    assert_eq!(*estimator.memory(), observer.initial()); // at the start, for no time
    assert_eq!(estimator.predict(&one, 0.1), Status::Predicted);
    let held = *estimator.memory();
    assert_eq!(estimator.predict(&zero, 0.2), Status::ModelUndefined);
    let CurrentState { law: memory, elapsed } = *estimator.memory();
    assert_eq!(memory, held.law);
    close(elapsed, 0.3);
    close(estimator.time(), 0.3);
    estimator.correct(&2.0);
    let z = (-ELL * 0.3).exp();
    close(estimator.estimate()[0], held.law.x_hat.x + (1.0 - z * z) * (2.0 - held.law.x_hat.x));
    let corrected = *estimator.memory();
    assert_eq!(estimator.correct(&-5.0), Status::Updated);
    assert_eq!(*estimator.memory(), corrected);
    // refused: nothing moves but the count
    for dt in [0.0, -0.1, f64::NAN, f64::INFINITY] {
        assert_eq!(estimator.predict(&one, dt), Status::StepRefused);
    }
    assert_eq!(*estimator.memory(), corrected);
    let counts = Counts { updated: 3, model_undefined: 1, step_refused: 4, ..Counts::default() };
    assert_eq!(estimator.counts(), counts);
    // a step over a period without a value says so, and does not take the sample
    let mut whole = Estimator::new(observer, 1.0).unwrap();
    assert_eq!(whole.step(&2.0, &zero, 0.1), Status::Updated); // the first call only corrects
    assert_eq!((*whole.memory(), whole.time()), (observer.initial(), 0.0));
    assert_eq!(whole.step(&2.0, &zero, 0.1), Status::ModelUndefined);
    assert_eq!(*whole.memory(), CurrentState { elapsed: 0.1, ..observer.initial() });
}

/// Beyond the limit a sample is predicted over, once, and the time since the last one used counts.
#[test]
fn a_sample_after_too_long_a_period_is_predicted_over() {
    let law = everything();
    let observer = Current { law, scheme: Placed::new(&law, Placement::Exact).unwrap() };
    let mut estimator = Estimator::new(observer, 0.1).unwrap();
    let u = Vector1::new(0.0);
    estimator.correct(&1.0);
    assert_eq!(estimator.predict(&u, 0.1001), Status::StepTooLong);
    let predicted = *estimator.memory();
    for _ in 0..2 {
        assert_eq!(estimator.correct(&1.0), Status::StepTooLong); // asked again, no sooner
        assert_eq!(*estimator.memory(), predicted);
    }
    assert_eq!(estimator.predict(&u, 0.1), Status::Predicted);
    close(estimator.memory().elapsed, 0.2001);
    assert_eq!(estimator.correct(&1.0), Status::Updated);
    assert_eq!(estimator.memory().elapsed, 0.0);
    let counts = Counts { updated: 2, step_too_long: 2, ..Counts::default() };
    assert_eq!(estimator.counts(), counts);
}

/// 2²⁶ steps of 1 ms, 18.6 h: a sum in f32 stops at 9.1 h. And jitter between two lengths.
#[test]
fn a_clock_in_single_precision_goes_on() {
    let exact = |time: f32, expected: f64| {
        let off = (f64::from(time) - expected).abs() / expected;
        assert!(off < 2e-7, "{time} s instead of {expected} s");
    };
    let mut clock = Clock::<f32>::new();
    assert_eq!(clock.time(), 0.0);
    for k in 1..=1_u32 << 26 {
        clock.pass(1e-3);
        assert!(k > 10_000 || clock.time() == k as f32 * 1e-3, "step {k}"); // counted, not summed
    }
    exact(clock.time(), f64::from(1_u32 << 26) * f64::from(1e-3_f32));
    // the length changes at every step: nothing is counted, all is summed
    let (mut clock, mut sum) = (Clock::<f32>::new(), 0.0);
    for k in 0..1_u32 << 22 {
        let dt = if k % 2 == 0 { 0.9e-3 } else { 1.1e-3_f32 };
        clock.pass(dt);
        sum += f64::from(dt);
    }
    exact(clock.time(), sum);
}

/// Steps of one length are counted, up to the last that a count holds; the parts make the clock again.
#[test]
fn a_clock_counts_and_is_made_again_from_its_parts() {
    let mut clock = Clock::<f32>::new();
    for dt in [0.5, 0.25, 0.25, 0.25] {
        clock.pass(dt);
    }
    assert_eq!(clock.parts(), (3, [0.25, 0.5, 0.0]));
    assert_eq!(Clock::from_parts(clock.parts()), clock);
    let mut full = Clock::from_parts((u32::MAX, [0.25_f64, 0.0, 0.0]));
    full.pass(0.25);
    assert_eq!(full.time(), 0.25 * (f64::from(u32::MAX) + 1.0));
    assert_eq!(full.parts().0, 1);
}

/// The last time of a correction and of an advance, the input and the period that it was told.
#[derive(Clone, Copy)]
struct Spy;

impl Observer<f64> for Spy {
    type State = Vector4<f64>;
    type Measurement = f64;
    type Input = Vector1<f64>;
    const TIMING: Timing = Timing::Current;
    const ESTIMATED: usize = 1;
    fn initial(&self) -> Vector4<f64> {
        Vector4::zeros()
    }
    fn correct(&self, z: &mut Vector4<f64>, y: &f64, t: f64) -> Status {
        z.x = t;
        Status::of(y)
    }
    fn advance(&self, z: &mut Vector4<f64>, _: &f64, u: &Vector1<f64>, t: f64, dt: f64) -> Status {
        (z.y, z.z, z.w) = (t, u.x, dt);
        // a model without a value at the third sample
        if (t - 0.02).abs() < 1e-9 { Status::ModelUndefined } else { Status::Predicted }
    }
    fn estimate<'a>(&self, z: &'a Vector4<f64>) -> &'a [f64] {
        &z.as_slice()[..1]
    }
    fn innovation(&self, _: f64, _: &Vector4<f64>, y: &f64, _: &Vector1<f64>) -> f64 {
        *y
    }
}

/// ẋ = cos t + u, y = x + 5t + u, u = 10t + dt.
#[derive(Clone, Copy)]
struct Clockwork;

impl Plant<f64> for Clockwork {
    type State = Vector1<f64>;
    type Input = Vector1<f64>;
    type Output = f64;
    const TRUTH: (usize, usize) = (0, 1);
    fn drift(&self, t: f64, _: &Vector1<f64>, u: &Vector1<f64>) -> Vector1<f64> {
        Vector1::new(t.cos() + u.x)
    }
    fn output(&self, t: f64, x: &Vector1<f64>, u: &Vector1<f64>) -> f64 {
        x.x + 5.0 * t + u.x
    }
    fn truth<'a>(&self, x: &'a Vector1<f64>) -> &'a [f64] {
        x.as_slice()
    }
    fn control(&self, t: f64, _: &Vector1<f64>, dt: f64) -> Vector1<f64> {
        Vector1::new(10.0 * t + dt)
    }
}

const QUIET: Noise<'static, f64> = Noise { draw: Draw::None, hold: 1, sines: &[] };

struct Seen(Vec<([f64; 4], f64, f64)>);

impl Probe<f64> for Seen {
    fn sample<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
        &mut self,
        sample: &Sample<'_, f64, X, Z, Y>,
    ) {
        let (mut z, mut y) = ([0.0; 4], 0.0);
        sample.z.write(&mut z);
        sample.y.each(&mut |entry| y = entry);
        self.0.push((z, y, sample.t));
    }
}

/// A plant at twice the observer's pace: each function is told the time of its own clock.
#[test]
fn plant_and_observer_have_a_clock_each() {
    let clock = |dt| FixedStep::new(dt).unwrap();
    let experiment = Experiment {
        plant: Clockwork,
        plant_scheme: PlantScheme::Held,
        substeps: 1,
        schedule: clock(0.01),
        plant_schedule: Some(clock(0.02)),
        noise: QUIET,
        steps: 5,
        seed: 1,
    };
    let mut seen = Seen(Vec::new());
    let start = Vector1::new(0.25);
    let end = experiment.sampled(&Spy, |u| *u, 0, start, Spy.initial(), &mut seen);
    assert_eq!((end.undefined_at, end.diverged_at), (Some(2), None));
    assert_eq!(seen.0.len(), 6);
    let input = |k: f64| 10.0 * (0.02 * k) + 0.01;
    for (k, ([corrected, advanced, u, dt], y, t)) in seen.0.into_iter().enumerate() {
        let k = k as f64;
        close(t, 0.01 * k);
        close(corrected, t);
        close(y, 0.25 + 5.0 * 0.02 * k + input(k));
        if k > 0.0 {
            close(advanced, 0.01 * (k - 1.0));
            close(u, input(k - 1.0));
            close(dt, 0.01);
        }
    }
    // and the plant moves by its own: x = sin t + Σ u(k) dt
    let rk4 = PlantScheme::Deterministic(Integrator::Rk4);
    let moving = Experiment { plant_scheme: rk4, substeps: 3, ..experiment };
    let end = moving.sampled(&Spy, |u| *u, 0, start, Spy.initial(), &mut Seen(Vec::new()));
    let held: f64 = (0..5).map(|k| 0.02 * input(f64::from(k))).sum();
    close(end.x.x, 0.25 + 0.1_f64.sin() + held);
}

/// ẋ₁ = x₂, ẋ₂ = cos t + u, and the same as a model.
#[derive(Clone, Copy)]
struct Swing;

impl Model<f64, 2, 1> for Swing {
    fn f_hat(&self, t: f64, _: &Vector2<f64>, u: &Vector1<f64>) -> Vector2<f64> {
        last(t.cos() + u.x)
    }
}

impl Plant<f64> for Swing {
    type State = Vector2<f64>;
    type Input = Vector1<f64>;
    type Output = f64;
    const TRUTH: (usize, usize) = (0, 2);
    fn drift(&self, t: f64, x: &Vector2<f64>, u: &Vector1<f64>) -> Vector2<f64> {
        Vector2::new(x.y, t.cos() + u.x)
    }
    fn output(&self, _: f64, x: &Vector2<f64>, u: &Vector1<f64>) -> f64 {
        x.x + u.x - 0.5
    }
    fn truth<'a>(&self, x: &'a Vector2<f64>) -> &'a [f64] {
        x.as_slice()
    }
    fn control(&self, _: f64, _: &Vector2<f64>, _: f64) -> Vector1<f64> {
        Vector1::new(0.5)
    }
}

/// Plant and law as one equation: a law that is told time and input like the plant stays on it.
#[test]
fn joint_integration_tells_time_and_input() {
    let gain = ConstantGain::new(5.0).unwrap();
    let law = StandardObserver::<f64, _, _, 2, 1>::new([2.0, 1.0], gain, Swing).unwrap();
    let experiment = Experiment {
        plant: Swing,
        plant_scheme: PlantScheme::Deterministic(Integrator::Rk4),
        substeps: 1,
        schedule: FixedStep::new(0.01).unwrap(),
        plant_schedule: None,
        noise: QUIET,
        steps: 200,
        seed: 1,
    };
    let start = Vector2::new(0.1, 0.2);
    let mut seen = Seen(Vec::new());
    let scheme = Integrator::Rk4;
    let end = experiment.joint(
        &law,
        |u| *u,
        scheme,
        0,
        start,
        StandardState { x_hat: start, r: () },
        &mut seen,
    );
    assert!((end.z.x_hat - end.x).amax() < 1e-12, "{} {}", end.z.x_hat, end.x);
    let t = 2.0_f64;
    let exact =
        Vector2::new(0.1 + 0.2 * t + (1.0 - t.cos()) + 0.25 * t * t, 0.2 + t.sin() + 0.5 * t);
    assert!((end.x - exact).amax() < 1e-9, "{} {exact}", end.x);
}

/// All that a stochastic scheme asks for, each another number of t and u.
#[derive(Clone, Copy)]
struct Driven;

impl Plant<f64> for Driven {
    type State = Vector1<f64>;
    type Input = Vector1<f64>;
    type Output = f64;
    const TRUTH: (usize, usize) = (0, 1);
    fn drift(&self, t: f64, x: &Vector1<f64>, u: &Vector1<f64>) -> Vector1<f64> {
        Vector1::new(t + 2.0 * u.x + x.x)
    }
    fn output(&self, _: f64, x: &Vector1<f64>, _: &Vector1<f64>) -> f64 {
        x.x
    }
    fn truth<'a>(&self, x: &'a Vector1<f64>) -> &'a [f64] {
        x.as_slice()
    }
    fn control(&self, _: f64, _: &Vector1<f64>, _: f64) -> Vector1<f64> {
        Vector1::zeros()
    }
    fn diffusion(&self, t: f64, x: &Vector1<f64>, u: &Vector1<f64>) -> Vector1<f64> {
        Vector1::new(3.0 * t + u.x + x.x)
    }
    fn diffusion_slope(&self, t: f64, x: &Vector1<f64>, u: &Vector1<f64>) -> Vector1<f64> {
        Vector1::new(t + 5.0 * u.x + x.x)
    }
    fn jacobian_times(
        &self,
        t: f64,
        x: &Vector1<f64>,
        u: &Vector1<f64>,
        v: &Vector1<f64>,
    ) -> Vector1<f64> {
        v * (t + 7.0 * u.x + x.x)
    }
    fn curvature(&self, t: f64, x: &Vector1<f64>, u: &Vector1<f64>) -> Vector1<f64> {
        Vector1::new(11.0 * t + u.x + x.x)
    }
}

#[test]
fn stochastic_schemes_tell_time_and_input() {
    let (t, x, u, h, dw, dz) = (2.0, 0.3, 0.7, 0.01, 0.05, 2e-4);
    let w = WienerIncrement { dw, dz };
    let after = |scheme: StochasticIntegrator| {
        scheme.step(&Driven, t, &Vector1::new(x), &Vector1::new(u), h, w).x
    };
    let (a, b) = (t + 2.0 * u + x, 3.0 * t + u + x);
    let euler = x + h * a + dw * b;
    close(after(StochasticIntegrator::EulerMaruyama), euler);
    let milstein = euler + 0.5 * (dw * dw - h) * (t + 5.0 * u + x);
    close(after(StochasticIntegrator::Milstein), milstein);
    let jacobian = t + 7.0 * u + x;
    let taylor = euler + dz * (jacobian * b) + 0.5 * h * h * (jacobian * a + 11.0 * t + u + x);
    close(after(StochasticIntegrator::Taylor15), taylor);
}

/// Every output of several has its own innovation, and one that is missing keeps the sample from use.
#[test]
fn several_outputs() {
    let ship = hgo_rs::models::Ship::new(0.0, [0.0; 3]).unwrap();
    let observer = ReducedOrderObserver::new([0.1, 0.2, 0.2], 0.1, ship).unwrap();
    let (y0, v) = (Vector3::new(1.0, 2.0, 0.5), Vector3::new(0.7, 0.1, -0.2));
    let mut z = observer.initial();
    z.z_hat = v;
    observer.correct(&mut z, &y0, 0.0);
    observer.advance(&mut z, &y0, &Vector2::new(0.1, 0.2), 0.0, 0.1);
    let (sin, cos) = 0.5_f64.sin_cos();
    let y = Vector3::new(1.3, 1.8, 0.6);
    let rate = Vector3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z);
    let expected = y - y0 - rate * 0.1;
    let ours = observer.innovation(0.1, &z, &y, &Vector2::zeros());
    assert!((ours - expected).amax() < 1e-14, "{ours}");
    let one_missing = Vector3::new(1.3, f64::NAN, 0.6);
    assert_eq!(observer.correct(&mut z, &one_missing, 0.1), Status::Predicted);
    assert_eq!(z.y, y0);
}

/// A law's injection is its rate less that of a missing sample.
#[test]
fn an_injection_is_what_a_sample_adds_to_the_rate() {
    fn compare<L: ContinuousLaw<f64, Input = SVector<f64, 0>>>(law: L) {
        let mut z = law.initial();
        let mut value = 0.9;
        z.visit_mut(&mut |entry| {
            value *= -1.1;
            *entry = value + 3.0;
        });
        let (e, none) = (law.innovation(&z, 5.5), law.innovation(&z, f64::NAN));
        let with = law.rate(0.3, &z, &e, &no_input());
        let difference = with.zip(&law.rate(0.3, &z, &none, &no_input()), |a, b| a - b);
        let mut entries = [[0.0; 16]; 2];
        difference.write(&mut entries[0]);
        law.injection(&z, &e).write(&mut entries[1]);
        for (expected, ours) in entries[0].into_iter().zip(entries[1]) {
            assert!((ours - expected).abs() < 1e-9 * expected.abs().max(1.0), "{entries:?}");
        }
        assert!(entries[1][0] != 0.0);
    }
    let gain = ConstantGain::new(3.0).unwrap();
    let adaptive = AdaptiveGain::new(10.0, 0.0025, 0.183).unwrap();
    let (alpha, beta) = ([3.0, 3.0, 2.0], [3.2, 1.4, 0.0]);
    let clip = HardClip::new([0.8, 0.5, 0.0]).unwrap();
    compare(StandardObserver::new([2.0, 1.0], gain, Unknown).unwrap());
    compare(StandardObserver::new([2.0, 1.0], adaptive, Unknown).unwrap());
    compare(LowPowerObserver::<_, _, _, 3>::new(alpha, beta, gain, Unknown, NoSaturation).unwrap());
    compare(
        LowPowerObserver::<_, _, _, 3>::new(alpha, beta, adaptive, Unknown, NoSaturation).unwrap(),
    );
    compare(PeakingFreeObserver::<_, _, _, _, 3>::new(alpha, beta, gain, Unknown, clip).unwrap());
    let k_bar = [0.0558, 0.0317];
    let collection =
        RepelledCollection::<_, _, 2, 3>::new([2.0, 2.0], k_bar, adaptive, Unknown).unwrap();
    compare(collection);
    compare(ModifiedObserver { collection });
}
