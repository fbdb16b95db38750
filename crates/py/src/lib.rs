//! The Python module `hgo_rs._core`.
//!
//! Specs (plain dicts) come in, arrays go out; every law that runs here is the core's own.

mod design;
mod errors;
mod functions;
mod interrupt;
mod kernel;
mod logs;
mod observers;
mod online;
mod record;
mod study;
mod tables;
mod values;

use pyo3::prelude::*;

/// The compiled core of `hgo_rs`.
#[pymodule]
mod _core {
    #[pymodule_export]
    use crate::design::{
        coefficients_from_poles, ekf_covariances, is_hurwitz, law_coefficients, law_sizes, laws,
        low_power_coefficients, low_power_coefficients_from_poles, low_power_polynomial,
    };
    #[pymodule_export]
    use crate::functions::{coupled_paths, elementary_source, filtered, mean_covariance, random};
    #[pymodule_export]
    use crate::kernel::{RecordKernel, StudyKernel, study_source};
    #[pymodule_export]
    use crate::logs::{TextReader, text_cells, text_is_idle, text_kind, text_lines};
    #[pymodule_export]
    use crate::observers::Observer;
    #[pymodule_export]
    use crate::online::Online;
    #[pymodule_export]
    use crate::study::{kernel_agrees, simulate};
    #[pymodule_export]
    use crate::tables::{evaluate_table, live_numbers, placed_gains, run_single, trace_step};
}
