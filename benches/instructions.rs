//! The steps of every observer, one after the other, for an instruction counter.
//!
//! benches/compare/instructions.py runs this under callgrind, which counts inside `counted` and
//! takes down its count at `counted_one`: a line of the output for each observer, in that order.

#[path = "../tests/catalogue/mod.rs"]
mod catalogue;

use catalogue::{Logged, Stored, Visitor, visit_all};
use hgo_rs::observer::Measurement;
use hgo_rs::{DesignError, Observer, Scalar};
use std::fmt::Debug;
use std::hint::black_box;

/// Steps of each observer.
const STEPS: u32 = 1000;

/// One step; the samples, the input and the clock are made outside.
#[inline(never)]
fn counted<T: Scalar, O: Observer<T>>(
    observer: &O,
    z: &mut O::State,
    y: &O::Measurement,
    u: &O::Input,
    t: T,
    dt: T,
) {
    observer.step(z, y, u, t, dt);
}

/// An observer has been counted.
#[inline(never)]
fn counted_one(law: &str, scheme: &str) {
    println!("row {law}|{scheme}|{STEPS}");
}

struct Stepper;

impl<T: Scalar> Visitor<T> for Stepper {
    fn visit<O>(
        &mut self,
        law: &'static str,
        scheme: &'static str,
        observer: O,
        input: fn(T) -> O::Input,
    ) where
        O: Observer<T> + Debug + Stored + Logged,
        O::State: PartialEq + Debug + Stored + Logged,
    {
        let observer = black_box(observer);
        let (mut z, dt) = (observer.initial(), T::from_f64(1e-3));
        for k in 1..=STEPS {
            let t = T::from_f64(f64::from(k)) * dt;
            let mut phase = T::ZERO;
            let y = O::Measurement::fill(|| {
                phase += T::ONE; // not the same in all entries, so that a speed is never 0
                T::from_f64(0.1) * (t + phase).sin()
            });
            counted(&observer, &mut z, black_box(&y), black_box(&input(t)), t, dt);
        }
        black_box(&z);
        counted_one(law, scheme);
    }
}

/// On a stack of its own: paths and environment stand at the foot of the first one, and how long they
/// are moves what is above, and with it the instructions of a long copy.
fn main() -> Result<(), DesignError> {
    let counting = std::thread::spawn(|| visit_all::<f64>(&mut Stepper));
    counting.join().expect("a step panicked")
}
