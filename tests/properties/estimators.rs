//! An estimator: what it takes, what it refuses, and that it counts both.

use super::config;
use crate::catalogue::{Visitor, visit_all};
use hgo_rs::estimator::Counts;
use hgo_rs::gain::{AdaptiveGain, ConstantGain};
use hgo_rs::memory::Memory;
use hgo_rs::model::{Unknown, no_input};
use hgo_rs::observer::{Discretised, Euler, Measurement};
use hgo_rs::observers::{StandardObserver, StandardState};
use hgo_rs::polynomial::euler_limit;
use hgo_rs::{Estimator, Observer, Scalar, Status, Timing};
use nalgebra::Vector2;
use proptest::prelude::*;
use std::fmt::Debug;

/// A step as a chip may see it: dt as bits, the sample as bits.
type Event = (u64, u64);

/// Sends every observer through the same events.
struct Stress<'a>(&'a [Event]);

impl<T: Scalar> Visitor<T> for Stress<'_> {
    fn visit<O>(
        &mut self,
        law: &'static str,
        scheme: &'static str,
        observer: O,
        input: fn(T) -> O::Input,
    ) where
        O: Observer<T>,
        O::State: PartialEq + Debug,
    {
        let dt_max = T::from_f64(0.01);
        let mut estimator = Estimator::new(observer, dt_max).unwrap();
        let (mut seen, mut started) = ([0_u32; 6], false);
        for (dt, y) in self.0 {
            let (dt, y) = (T::from_f64(f64::from_bits(*dt)), T::from_f64(f64::from_bits(*y)));
            let (before, time) = (*estimator.memory(), estimator.time());
            let status = estimator.step(&O::Measurement::fill(|| y), &input(T::ONE), dt);
            seen[status as usize] += 1;
            // with current timing the first call only corrects
            let moves = started || O::TIMING == Timing::Predictor;
            let is_taken = !moves || (dt.is_finite() && dt > T::ZERO);
            started = true;
            assert_eq!(status == Status::StepRefused, !is_taken, "{law}, {scheme}");
            if is_taken {
                assert!(estimator.time() >= time, "{law}, {scheme}");
            } else {
                assert_eq!(*estimator.memory(), before, "{law}, {scheme}");
                assert_eq!(estimator.time(), time);
            }
            let mut finite = true;
            estimator.memory().visit(&mut |z| finite &= z.is_finite());
            assert_eq!(is_taken && !finite, status == Status::Diverged, "{law}, {scheme}");
            if status == Status::Updated {
                assert!(y.is_finite() && (!moves || dt <= dt_max), "{law}, {scheme}");
            }
            if !finite {
                estimator.restart(observer.initial());
                started = false;
            }
        }
        let c = estimator.counts();
        let counted = [
            c.updated,
            c.predicted,
            c.model_undefined,
            c.step_too_long,
            c.step_refused,
            c.diverged,
        ];
        assert_eq!(counted, seen, "{law}, {scheme}");
    }
}

/// Lengths of time that a clock gives, and bits that it should not give.
fn dt() -> impl Strategy<Value = u64> {
    prop_oneof![
        (1e-6..0.02).prop_map(f64::to_bits),
        any::<u64>(),
        Just(f64::NAN.to_bits()),
        Just(f64::INFINITY.to_bits()),
        Just((-0.001_f64).to_bits()),
        Just(0.0_f64.to_bits()),
    ]
}

fn sample() -> impl Strategy<Value = u64> {
    prop_oneof![
        4 => (-2.0..2.0).prop_map(f64::to_bits),
        1 => any::<u64>(),
        1 => Just(f64::NAN.to_bits()),
        1 => Just(f64::NEG_INFINITY.to_bits()),
    ]
}

proptest! {
    #![proptest_config(config(48))]

    #[test]
    fn whatever_comes_is_used_or_counted(events in prop::collection::vec((dt(), sample()), 60)) {
        visit_all::<f64>(&mut Stress(&events)).unwrap();
        visit_all::<f32>(&mut Stress(&events)).unwrap();
    }
}

const K: [f64; 2] = [2.0, 1.0];

#[test]
fn a_late_sample_is_predicted_over_and_reported() {
    let ell = 100.0;
    let law = StandardObserver::<f64, _, _, 2>::new(K, ConstantGain::new(ell).unwrap(), Unknown);
    let observer = Discretised { law: law.unwrap(), scheme: Euler };
    let dt_max = euler_limit(&K) / ell;
    let mut estimator = Estimator::new(observer, dt_max).unwrap();
    estimator.restart(StandardState { x_hat: Vector2::new(1.0, 2.0), r: () });
    assert_eq!(estimator.step(&5.0, &no_input(), 1.001 * dt_max), Status::StepTooLong);
    let (x, dt) = (estimator.estimate(), 1.001 * dt_max);
    assert_eq!(x, [1.0 + dt * 2.0, 2.0]); // the chain alone: x1 moves with x2
    assert_eq!(estimator.step(&5.0, &no_input(), 0.5 * dt_max), Status::Updated);
    let counts = Counts { updated: 1, step_too_long: 1, ..Counts::default() };
    assert_eq!(estimator.counts(), counts);
    assert!((estimator.time() - 1.501 * dt_max).abs() < 1e-15);
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(Estimator::new(observer, bad).unwrap_err().parameter, "dt_max");
    }
}

#[test]
fn a_gain_that_grew_shortens_the_limit() {
    let gain = AdaptiveGain::new(10.0, 0.0025, 0.183).unwrap();
    let law = StandardObserver::<f64, _, _, 2>::new(K, gain, Unknown).unwrap();
    let observer = Discretised { law, scheme: Euler };
    let mut estimator = Estimator::new(observer, 0.1).unwrap();
    assert_eq!(estimator.step(&0.0, &no_input(), 0.099), Status::Updated);
    estimator.restart(StandardState { x_hat: Vector2::new(0.0, 0.0), r: 5.0 });
    assert_eq!(estimator.step(&0.0, &no_input(), 0.021), Status::StepTooLong);
    estimator.restart(StandardState { x_hat: Vector2::new(0.0, 0.0), r: 5.0 });
    assert_eq!(estimator.step(&0.0, &no_input(), 0.019), Status::Updated);
}

#[test]
fn divergence_is_reported_and_a_restart_ends_it() {
    let law = StandardObserver::<f64, _, _, 2>::new(K, ConstantGain::new(1.0).unwrap(), Unknown);
    let observer = Discretised { law: law.unwrap(), scheme: Euler };
    let mut estimator = Estimator::new(observer, 1.0).unwrap();
    estimator.restart(StandardState { x_hat: Vector2::new(1e300, 1e300), r: () });
    assert_eq!(estimator.step(&0.0, &no_input(), 0.9), Status::Updated);
    estimator.restart(StandardState { x_hat: Vector2::new(0.0, f64::NAN), r: () });
    assert_eq!(estimator.step(&0.0, &no_input(), 0.9), Status::Diverged);
    assert_eq!(estimator.step(&0.0, &no_input(), 0.9), Status::Diverged);
    estimator.restart(observer.initial());
    assert_eq!(estimator.step(&0.0, &no_input(), 0.9), Status::Updated);
    assert_eq!(estimator.counts().diverged, 2);
}
