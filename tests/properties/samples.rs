//! Missing and extreme samples.

use super::config;
use crate::catalogue::{SCHEMES, Visitor, visit_all};
use hgo_rs::gain::{AdaptiveGain, ConstantGain};
use hgo_rs::memory::Memory;
use hgo_rs::model::{StrictFeedback, Unknown, no_input};
use hgo_rs::models::{SanfelicePraly, Ship};
use hgo_rs::observer::{Discretisation, Discretised, Measurement};
use hgo_rs::observers::{ReducedOrderObserver, StandardObserver, StandardState};
use hgo_rs::{Observer, Scalar, Status};
use nalgebra::{Vector2, Vector3};
use proptest::prelude::*;
use std::fmt::Debug;

const MISSING: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

/// Feeds every observer the same samples and inspects memory and status after each.
struct Feed<'a> {
    samples: &'a [f64],
    seen: u32,
}

impl<T: Scalar> Visitor<T> for Feed<'_> {
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
        let dt = T::from_f64(2e-3);
        let mut z = observer.initial();
        for (k, y) in self.samples.iter().enumerate() {
            let t = T::from_f64(k as f64) * dt;
            let before = z;
            let sample = O::Measurement::fill(|| T::from_f64(*y));
            let status = observer.step(&mut z, &sample, &input(T::from_f64(0.1)), t, dt);
            let mut finite = true;
            z.visit(&mut |x| finite &= x.is_finite());
            assert!(finite, "{law}, {scheme}: {y} at {k} made {before:?} into {z:?}");
            if law != "reduced-order" {
                let expected = if y.is_finite() { Status::Updated } else { Status::Predicted };
                assert_eq!(status, expected, "{law}, {scheme}: {y} at {k}");
            }
        }
        self.seen += 1;
    }
}

fn recorded() -> impl Strategy<Value = Vec<f64>> {
    let value = prop_oneof![4 => -1.0..1.0, 1 => prop::sample::select(&MISSING[..])];
    prop::collection::vec(value, 1..60)
}

proptest! {
    #![proptest_config(config(48))]

    #[test]
    fn a_missing_sample_never_reaches_the_memory(samples in recorded()) {
        let mut feed = Feed { samples: &samples, seen: 0 };
        visit_all::<f64>(&mut feed).unwrap();
        visit_all::<f32>(&mut feed).unwrap();
        prop_assert!(feed.seen >= 144, "{}", feed.seen);
    }

    /// Over a missing sample the law moves as if the sample had been its own estimate.
    #[test]
    fn a_missing_sample_means_no_innovation(
        x1 in -2.0..2.0, x2 in -2.0..2.0, r in 1.0..4.0, dt in 1e-4..0.1,
    ) {
        let gain = AdaptiveGain::new(10.0, 0.0025, 0.183).unwrap();
        let model = SanfelicePraly::new(1.9, 0.1).unwrap();
        let law = StandardObserver::new([2.0, 2.0], gain, model).unwrap();
        for scheme in [Discretisation::Euler, Discretisation::StaggeredEuler] {
            let observer = Discretised { law, scheme };
            for y in MISSING {
                let mut missing = StandardState { x_hat: Vector2::new(x1, x2), r };
                let mut own = missing;
                observer.step(&mut missing, &y, &no_input(), 0.0, dt);
                observer.step(&mut own, &x1, &no_input(), 0.0, dt);
                prop_assert_eq!(missing, own);
            }
        }
        // without a model and under any scheme of order 2 or more: x̂₁ + x̂₂t, exactly
        let gain = ConstantGain::new(50.0).unwrap();
        let law = StandardObserver::new([2.0, 2.0], gain, Unknown).unwrap();
        for (name, scheme) in &SCHEMES[1..] {
            let mut z = StandardState { x_hat: Vector2::new(x1, x2), r: () };
            Discretised { law, scheme: *scheme }
                .step(&mut z, &f64::NAN, &no_input(), 0.0, dt);
            prop_assert!((z.x_hat.x - (x1 + dt * x2)).abs() < 1e-14, "{}", name);
            prop_assert_eq!(z.x_hat.y, x2);
        }
    }
}

/// After a gap the reduced-order observer divides by the whole time between present samples.
#[test]
fn reduced_order_bridges_a_gap() {
    let ship = Ship::new(0.0, [0.0; 3]).unwrap();
    let observer = ReducedOrderObserver::new([0.1, 0.2, 0.2], 0.1, ship).unwrap();
    let (dt, v) = (0.05, Vector3::new(0.7, 0.02, 0.1));
    let u = Vector2::new(0.01, 0.02);
    let y = |k: f64| Vector3::new(0.1, 0.2, 0.3) + v * (k * dt);
    let mut z = observer.initial();
    z.z_hat = Vector3::new(0.5, 0.1, 0.0);
    assert_eq!(observer.step(&mut z, &y(0.0), &u, 0.0, dt), Status::Updated);
    assert_eq!(z.z_hat, Vector3::new(0.5, 0.1, 0.0)); // one sample tells no velocity
    let gap = Vector3::from_element(f64::NAN);
    let mut expected = z.z_hat;
    for k in 1..3 {
        assert_eq!(observer.step(&mut z, &gap, &u, 0.0, dt), Status::Predicted);
        expected += ship.f2(0.0, &y(0.0), &expected, &u) * dt;
        assert!((z.z_hat - expected).amax() < 1e-15, "after {k} missing samples");
    }
    observer.step(&mut z, &y(3.0), &u, 0.0, dt);
    let (sin, cos) = (0.3_f64.sin(), 0.3_f64.cos());
    let psi = Vector3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z);
    let h = Vector3::new(1.0, 2.0, 2.0);
    let rate = h.component_mul(&(psi - expected)) + ship.f2(0.0, &y(0.0), &psi, &u);
    assert!((z.z_hat - (expected + rate * dt)).amax() < 1e-13, "{}", z.z_hat);
}

/// z at which the model has no value (atan 0/0) holds the estimate and says so.
#[test]
fn reduced_order_reports_an_undefined_model() {
    let ship = Ship::new(0.0, [0.0; 3]).unwrap();
    let observer = ReducedOrderObserver::new([0.1, 0.2, 0.2], 0.1, ship).unwrap();
    let mut z = observer.initial();
    let y = Vector3::new(1.0, 2.0, 0.5);
    observer.step(&mut z, &y, &Vector2::zeros(), 0.0, 0.1);
    let held = z.z_hat;
    let status = observer.step(&mut z, &y, &Vector2::zeros(), 0.1, 0.1); // at rest: Ψ = 0
    assert_eq!((status, z.z_hat), (Status::ModelUndefined, held));
}

/// Steps every observer through extreme samples, memories, inputs and periods.
struct Extremes {
    steps: u64,
}

impl<T: Scalar> Visitor<T> for Extremes {
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
        let values = [0.0, -0.0, 1e300, -1e300, 3e38, -3e38, 5e-324, 1e-45, f64::MAX, f64::MIN]
            .into_iter()
            .chain(MISSING)
            .map(T::from_f64);
        let adaptive = ["adaptive", "dead zone", "low-power, adaptive"].contains(&law);
        for y in values.clone() {
            for start in values.clone() {
                for dt in [1e-3, 5e-324, 1e300].map(T::from_f64) {
                    let mut z = observer.initial();
                    z.visit_mut(&mut |entry| *entry = start);
                    for k in 0..3_u8 {
                        let sample = O::Measurement::fill(|| y);
                        let t = T::from_f64(f64::from(k)) * dt;
                        let status = observer.step(&mut z, &sample, &input(start), t, dt);
                        let present = sample.is_present();
                        assert!(present || status != Status::Updated, "{law}, {scheme}");
                        // last, or followed by one time
                        let mut last = [T::ZERO; 2];
                        z.visit(&mut |entry| last = [last[1], entry]);
                        let r = last[1 - O::TIMING.held()];
                        let r_is_sound = r >= T::ONE || r.to_f64().is_nan();
                        assert!(!adaptive || r_is_sound, "{law}, {scheme}: r = {r:?}");
                        self.steps += 1;
                    }
                    observer.innovation(T::ZERO, &z, &O::Measurement::fill(|| y), &input(start));
                }
            }
        }
    }
}

/// A panic in the step path (overflow checks are on in a debug build) fails this test.
#[test]
fn no_sample_makes_a_step_panic() {
    let mut extremes = Extremes { steps: 0 };
    visit_all::<f64>(&mut extremes).unwrap();
    visit_all::<f32>(&mut extremes).unwrap();
    assert_eq!(extremes.steps % (13 * 13 * 9), 0);
    assert!(extremes.steps >= 144 * 13 * 13 * 9, "{}", extremes.steps);
}
