//! Slopes of dual numbers are the limits of quotients.

use super::config;
use hgo_rs::Scalar;
use hgo_rs::dual::Dual;
use hgo_rs::scalar::Constant;
use proptest::prelude::*;

/// All functions of a number, in two variables, smooth where they are tried.
fn functions<S: Scalar>(x: S, y: S) -> Vec<S> {
    let two = S::from_f64(2.0);
    let positive = x * x + S::ONE;
    vec![
        x + y,
        x - y * two,
        x * y,
        x / (y * y + S::ONE),
        -x,
        x.abs() * y,
        positive.sqrt(),
        x.sin() * y,
        y.cos(),
        (x * S::from_f64(0.3)).tan(),
        x.atan(),
        y.atan2(positive),
        x.tanh(),
        positive.ln(),
        y.exp(),
        positive.powf(y),
        positive.powf(S::from_f64(2.5)),
        x.copysign(y),
        x.min(y),
        x.max(y),
        x.clip(-two, y.abs() + two),
        x.powi(3),
        y.nearest() * x,
        x.or(y),
        x.passed(y),
        x.innovation(y),
        x.while_missing(S::from_f64(f64::NAN)),
        x.while_missing(y),
        x.where_above(y, x * y, y),
    ]
}

proptest! {
    #![proptest_config(config(300))]

    #[test]
    fn slopes_are_limits_of_quotients(x in -3.0..3.0_f64, y in -3.0..3.0_f64) {
        prop_assume!(x.abs() > 1e-2 && y.abs() > 1e-2 && (x.abs() - y.abs()).abs() > 1e-2);
        prop_assume!((2.0 * y - (2.0 * y).round()).abs() > 1e-2);
        prop_assume!((x.abs() - 2.0).abs() > 1e-2 && (x.abs() - y.abs() - 2.0).abs() > 1e-2);
        let made = functions(Dual::<f64, 2>::along(x, 0), Dual::along(y, 1));
        let values = functions(x, y);
        let h = 1e-4;
        let near = |i: f64, j: f64| functions(x + i * h, y + j * h);
        for (direction, (i, j)) in [(1.0, 0.0), (0.0, 1.0)].into_iter().enumerate() {
            let around = [near(-2.0 * i, -2.0 * j), near(-i, -j), near(i, j), near(2.0 * i, 2.0 * j)];
            for (k, (made, value)) in made.iter().zip(&values).enumerate() {
                prop_assert_eq!(made.value.to_bits(), value.to_bits(), "value of function {}", k);
                let [a, b, c, d] = [0, 1, 2, 3].map(|at: usize| around[at][k]);
                let quotient = (8.0 * (c - b) - (d - a)) / (12.0 * h);
                let size = 1e-8 * (1.0 + quotient.abs() + value.abs());
                let slope = made.slopes[direction];
                prop_assert!((slope - quotient).abs() < size, "{k}: {slope} {quotient}");
            }
        }
    }
}

/// x² at 0 by a power, whose logarithm is infinite there; a missing sample has no innovation and no slope.
#[test]
fn slopes_that_are_not_there_take_nothing_with_them() {
    let x = Dual::<f64, 1>::along(0.0, 0);
    assert_eq!(x.powf(Dual::from(2.0)).slopes, [0.0]);
    let missing = Dual::<f64, 1>::along(f64::NAN, 0).innovation(Dual::from(1.0));
    assert_eq!((missing.value, missing.slopes), (0.0, [0.0]));
    assert!(x < Dual::from(1.0) && x == Dual::ZERO && Dual::<f64, 1>::default() == Dual::ZERO);
}

fn agrees<T: Scalar>(value: f64) {
    let (by_table, by_rounding) = (T::constant(Constant::new(value)), T::from_f64(value));
    assert!(by_table == by_rounding, "{value}");
    assert_eq!(by_table.is_nothing(), value.abs() < 1e-40);
    let dual = Dual::<T, 2>::constant(Constant::new(value));
    assert!(dual.value == by_rounding && dual.is_nothing() == by_table.is_nothing());
    assert!(dual.slopes.iter().all(|slope| slope.is_nothing()));
}

/// What a table holds is the nearest number of each precision, and 1/i is that of a division there.
#[test]
fn constants_are_rounded_as_numbers_are() {
    for value in [0.0, -0.0, 1e-300, 5e-324, 1e-30, 0.1, -1.0 / 3.0, 1e30, f64::INFINITY] {
        agrees::<f32>(value);
        if value == 0.0 || value.abs() > 1e-200 {
            let dual = Dual::<f64, 1>::constant(Constant::new(value));
            assert!(dual.value.to_bits() == value.to_bits() && dual.is_nothing() == (value == 0.0));
        }
    }
    assert!(f64::constant(Constant::new(5e-324)).is_nothing());
    for (over, i) in Constant::reciprocals::<40>(3).into_iter().zip(3_u8..) {
        assert!(
            f64::constant(over) == 1.0 / f64::from(i) && f32::constant(over) == 1.0 / f32::from(i)
        );
    }
}
