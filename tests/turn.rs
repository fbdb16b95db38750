//! Turns: the nearest whole number, and whole turns of a value, in both precisions.

#![allow(clippy::float_cmp)] // whole numbers are meant to the last bit

use hgo_rs::Scalar;
use hgo_rs::turn::Turn;

fn whole_numbers<T: Scalar>(largest: f64, digits: f64) {
    for k in [0.0, 1.0, 2.0, 7.0, 1001.0, largest] {
        for sign in [1.0, -1.0] {
            let given = T::from_f64(sign * (k + 0.4375 * digits));
            assert_eq!(given.nearest().to_f64(), sign * k, "{given:?}");
        }
    }
    // of two the even one, as IEEE 754 rounds
    let halves = [0.5, 1.5, 2.5, -0.5, -1.5].map(|half| T::from_f64(half).nearest().to_f64());
    assert_eq!(halves, [0.0, 2.0, 2.0, 0.0, -2.0]);
    assert!(T::from_f64(f64::NAN).nearest() != T::from_f64(f64::NAN).nearest());
    assert!(!T::from_f64(f64::INFINITY).nearest().is_finite());
}

#[test]
fn the_nearest_whole_number_is_exact_up_to_what_it_says() {
    whole_numbers::<f32>(4_194_303.0, 0.0);
    whole_numbers::<f32>(1001.0, 1.0);
    whole_numbers::<f64>(2_251_799_813_685_247.0, 0.0);
    whole_numbers::<f64>(1e9, 1.0);
}

#[test]
fn a_value_less_its_whole_turns_lies_within_half_a_turn() {
    let turn = Turn::new(std::f64::consts::TAU).unwrap();
    for k in -1000..1000 {
        let value = f64::from(k) * 0.37;
        let left = value - turn.whole(value);
        assert!(left.abs() <= std::f64::consts::PI + 1e-12, "{value} {left}");
        assert!((left.sin() - value.sin()).abs() < 1e-12, "{value} {left}");
    }
    for refused in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-320] {
        assert_eq!(Turn::new(refused).unwrap_err().parameter.get(..4), Some("wrap"));
    }
}
