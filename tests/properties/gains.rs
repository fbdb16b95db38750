//! Gain laws and schedules.

use super::{close, config};
use crate::catalogue::SCHEMES;
use hgo_rs::Observer;
use hgo_rs::gain::{AdaptiveGain, DeadZoneGain, GainLaw};
use hgo_rs::model::{Unknown, no_input};
use hgo_rs::observer::Discretised;
use hgo_rs::observers::{StandardObserver, StandardState};
use hgo_rs::schedule::{Schedule, StochasticApproximation};
use hgo_rs::simulate::DIVERGED;
use nalgebra::Vector2;
use proptest::prelude::*;

fn r_after<G, S>(gain: G, scheme: S, samples: &[f64], dt: f64, start: f64) -> Vec<f64>
where
    G: GainLaw<f64, Memory = f64>,
    S: hgo_rs::observer::Scheme<f64, StandardObserver<f64, G, Unknown, 2>>,
{
    let law = StandardObserver::<f64, _, _, 2>::new([2.0, 2.0], gain, Unknown).unwrap();
    let observer = Discretised { law, scheme };
    let mut z = StandardState { x_hat: Vector2::zeros(), r: start };
    let mut trace = Vec::new();
    for y in samples {
        observer.step(&mut z, y, &no_input(), 0.0, dt);
        trace.push(z.r);
    }
    trace
}

proptest! {
    #![proptest_config(config(256))]

    #[test]
    fn the_adapted_gain_stays_at_or_above_1(
        p1 in 0.1..50.0, p2 in 1e-5..1.0, b in 0.01..0.49, dt in 1e-4..0.5,
        start in 1.0..8.0, samples in prop::collection::vec(-3.0..3.0, 40),
        scheme in 0_usize..5,
    ) {
        let (_, scheme) = SCHEMES[scheme];
        let adaptive = AdaptiveGain::new(p1, p2, b).unwrap();
        let dead_zone = DeadZoneGain::new(p1, p2, b).unwrap();
        // never below 1; a run that too long a step blows up ends in NaN and shows it
        let trace = r_after(adaptive, scheme, &samples, dt, start);
        let sound = trace.iter().position(|r| r.is_nan()).unwrap_or(40);
        prop_assert!(trace[..sound].iter().all(|r| *r >= 1.0));
        prop_assert!(trace[sound..].iter().all(|r| r.is_nan()));
        // the dead zone's never comes back (until too long a step lets the run diverge)
        let mut trace = r_after(dead_zone, scheme, &samples, dt, start);
        trace.truncate(trace.iter().position(|r| r.is_nan() || *r > DIVERGED).unwrap_or(40));
        prop_assert!(trace.first().is_none_or(|r| *r >= start) && trace.is_sorted(), "{:?}", trace);
    }

    /// (6) at r = 1 is p₁e² ≥ 0, so [1, ∞) is invariant; it falls where r is large and e small.
    #[test]
    fn the_adaptive_law_points_inwards(
        p1 in 0.1..50.0, p2 in 1e-5..1.0, b in 0.01..0.49, e in -3.0..3.0,
    ) {
        let gain = AdaptiveGain::new(p1, p2, b).unwrap();
        prop_assert!(close(gain.rate::<5>(&1.0, e), p1 * e * e, 1e-9 * (1.0 + p2 / (e * e))));
        let r: f64 = 1.7;
        let right = p1 * ((e * e - p2) * r.powf(1.0 - 2.0 * b) + p2 * r.powi(-6)); // (6), n = 3
        prop_assert!((gain.rate::<3>(&r, e) - right).abs() <= 1e-12 * p1 * (e * e + p2) * r);
        prop_assert!(gain.rate::<1>(&2.0, 0.0) < 0.0 && gain.rate::<12>(&2.0, 0.0) < 0.0);
        let dead_zone = DeadZoneGain::new(p1, p2, b).unwrap();
        prop_assert_eq!(dead_zone.rate::<2>(&2.0, 0.99 * p2.sqrt()), 0.0);
        prop_assert!(dead_zone.rate::<2>(&2.0, 1.01 * p2.sqrt()) > 0.0);
        // the law of e and of −e is the same
        prop_assert_eq!(gain.rate::<3>(&1.7, e), gain.rate::<3>(&1.7, -e));
    }

    /// Σ a(k) and its limits: a(0) = αε, decreasing, b(k₀) = 2^{−p}.
    #[test]
    fn the_steps_decrease(alpha in 0.01..0.9, epsilon in 1e-3..0.1, p in 0.51..1.5) {
        let a = StochasticApproximation::new(alpha, epsilon, 1000.0, p).unwrap();
        prop_assert_eq!(a.dt(0), alpha * epsilon);
        prop_assert!((1..2000).all(|k| a.dt(k) < a.dt(k - 1)));
        prop_assert!(close(a.b(1000), 0.5_f64.powf(p), 1e-14));
    }
}
