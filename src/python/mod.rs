//! Floor 4. The Python module `hgo_rs._core`.
//!
//! Specs (plain dicts) come in, arrays go out; every law that runs here is the core's own.

mod called;
mod choices;
mod compile;
mod design;
mod errors;
mod functions;
mod halves;
mod interrupt;
mod lanes;
mod observers;
mod online;
mod plan;
mod program_study;
mod programs;
mod record;
mod recursion;
mod spec;
mod study;
mod systems;
mod table;
mod tabled;
mod trace;

use pyo3::prelude::*;

/// The compiled core of `hgo_rs`.
#[pymodule]
mod _core {
    #[pymodule_export]
    use super::design::{
        coefficients_from_poles, is_hurwitz, low_power_coefficients,
        low_power_coefficients_from_poles, low_power_polynomial,
    };
    #[pymodule_export]
    use super::functions::{coupled_paths, filtered, mean_covariance, random, simulate};
    #[pymodule_export]
    use super::observers::Observer;
    #[pymodule_export]
    use super::online::Online;
    #[pymodule_export]
    use super::programs::{evaluate_table, placed_gains, run_single, trace_step};
    /// The source of the elementary functions: `hgo_rs.exports` prints them into other programs.
    #[pymodule_export]
    const ELEMENTARY: &str = include_str!("../elementary.rs");
}
