//! Memories flatten, read back and add.

use super::config;
use crate::catalogue::{Visitor, visit_all};
use hgo_rs::memory::Memory;
use hgo_rs::{Observer, Scalar};
use proptest::prelude::*;
use std::fmt::Debug;

/// Flattens the memory of every observer and reads it back.
struct RoundTrip<'a> {
    values: &'a [f64],
}

impl<T: Scalar> Visitor<T> for RoundTrip<'_> {
    fn visit<O>(&mut self, law: &'static str, _: &'static str, _: O, _: fn(T) -> O::Input)
    where
        O: Observer<T>,
        O::State: PartialEq + Debug,
    {
        let length = O::State::LEN;
        let values: Vec<T> = self.values[..length].iter().map(|v| T::from_f64(*v)).collect();
        let memory = O::State::read(&values);
        let mut count = 0;
        memory.visit(&mut |_| count += 1);
        assert_eq!(count, length, "{law}");
        let mut written = vec![T::from_f64(-7.0); length + 2];
        memory.write(&mut written);
        assert_eq!(written[..length], values[..], "{law}");
        assert_eq!(written[length..], [T::from_f64(-7.0); 2], "{law}: wrote too far");
        assert_eq!(O::State::read(&written), memory, "{law}");
        // a short buffer fills what it has; a short record leaves zeros
        let mut short = vec![T::ZERO; length - 1];
        memory.write(&mut short);
        assert_eq!(short[..], values[..length - 1], "{law}");
        let mut last = T::ONE;
        O::State::read(&short).visit(&mut |x| last = x);
        assert_eq!(last, T::ZERO, "{law}");
        // the vector space: x + 2x − 3x = 0
        let twice = memory.plus(T::from_f64(2.0), &memory);
        let none = twice.plus(T::from_f64(-3.0), &memory);
        assert!(none.within(T::from_f64(1e-4)), "{law}: {none:?}");
        assert!(!O::State::read(&[T::from_f64(f64::NAN)]).within(T::from_f64(1e300)));
    }
}

proptest! {
    #![proptest_config(config(64))]

    #[test]
    fn flatten_and_read_back(values in prop::collection::vec(-100.0..100.0, 32)) {
        let mut trip = RoundTrip { values: &values };
        visit_all::<f64>(&mut trip).unwrap();
        visit_all::<f32>(&mut trip).unwrap();
    }
}
