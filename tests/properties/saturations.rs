//! The hard clip and the smooth saturation.

use super::config;
use hgo_rs::observers::{HardClip, Saturation, SmoothSaturation};
use proptest::prelude::*;

proptest! {
    #![proptest_config(config(512))]

    #[test]
    fn bounded_odd_monotone_and_smooth(level in 0.1..10.0, s in -50.0..50.0, step in 1e-6..5.0) {
        let hard = HardClip::<f64, 2>::new([level, 0.0]).unwrap();
        let smooth = SmoothSaturation::<f64, 2>::new([level, 0.0]).unwrap();
        let (h, c) = (|s| hard.apply(0, s), |s| smooth.apply(0, s));
        prop_assert!(h(s).abs() <= level && c(s).abs() < level + 1.0);
        prop_assert!(h(-s) == -h(s) && c(-s) == -c(s));
        prop_assert!(h(s + step) >= h(s));
        prop_assert!(c(s + step) > c(s), "strictly");
        // no steeper than the identity, and the identity within the level
        prop_assert!(h(s + step) - h(s) <= step * (1.0 + 1e-9));
        prop_assert!(c(s + step) - c(s) <= step * (1.0 + 1e-9));
        let inner = s / 50.0 * level;
        prop_assert!(h(inner) == inner && c(inner) == inner);
        // C¹: the slope 1/(1 + u)² outside, which is 1 at the level, as inside
        let (u, width) = (s.abs() / 10.0, 1e-6);
        let slope = (c(level + u + width) - c(level + u)) / width;
        prop_assert!((slope - (1.0 + u).powi(-2)).abs() < 1e-5, "{}", slope);
        let across = (c(level + width) - c(level - width)) / (2.0 * width);
        prop_assert!((across - 1.0).abs() < 1e-5, "{}", across);
    }
}

#[test]
fn extreme_arguments() {
    let hard = HardClip::<f64, 2>::new([3.0, 0.0]).unwrap();
    let smooth = SmoothSaturation::<f64, 2>::new([3.0, 0.0]).unwrap();
    for (s, sign) in [(1e300, 1.0), (-1e300, -1.0), (f64::INFINITY, 1.0)] {
        assert!((hard.apply(0, s) - 3.0 * sign).abs() < 1e-15);
        if s.is_finite() {
            assert!((smooth.apply(0, s) - 4.0 * sign).abs() < 1e-15);
        }
    }
}
