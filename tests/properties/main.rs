//! What holds for every design, every observer, every sample: properties, tried on random cases.

#![allow(clippy::extra_unused_type_parameters)] // every row of the list of laws has the same ones
#![allow(clippy::float_cmp)] // where two numbers are compared for equality, equal bits are meant

#[path = "../catalogue/mod.rs"]
mod catalogue;
mod designs;
mod duals;
mod elementary;
mod estimators;
mod exact;
mod factors;
mod families;
mod gains;
mod laws;
mod memories;
mod metrics;
mod placement;
mod polynomials;
mod samples;
mod saturations;
mod streams;

use proptest::prelude::*;

fn config(cases: u32) -> ProptestConfig {
    let cases = if cfg!(debug_assertions) { cases / 8 } else { cases };
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * b.abs().max(1e-300)
}
