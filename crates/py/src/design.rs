//! Floor 1. Coefficients from poles, at the Python border.

use crate::errors::{Result, refused};
use hgo_ir::design::{self, AlphaBeta};
use hgo_ir::order::order_refused;
use hgo_rs::observers::MAX_ORDER;
use hgo_rs::polynomial;
use pyo3::prelude::*;

/// Coefficients [k_1 ... k_n] from poles given as (real, imaginary) pairs.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn coefficients_from_poles(poles: Vec<(f64, f64)>) -> Result<Vec<f64>> {
    Ok(design::coefficients_from_poles(&poles)?)
}

/// Whether s^n + c_1 s^(n-1) + ... + c_n has all roots in the left half plane.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn is_hurwitz(coefficients: Vec<f64>) -> bool {
    polynomial::is_hurwitz(&coefficients)
}

/// (alpha, beta) from the trailing coefficients of a Hurwitz polynomial of degree 2n - 1.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn low_power_coefficients(coefficients: Vec<f64>) -> Result<AlphaBeta> {
    Ok(design::low_power_coefficients(&coefficients)?)
}

/// (alpha, beta) from 2n - 1 poles given as (real, imaginary) pairs.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn low_power_coefficients_from_poles(poles: Vec<(f64, f64)>) -> Result<AlphaBeta> {
    Ok(design::low_power_coefficients_from_poles(&poles)?)
}

/// Trailing coefficients of the characteristic polynomial of M_n for alpha (n) and beta (n - 1).
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn low_power_polynomial(alpha: Vec<f64>, beta: Vec<f64>) -> Result<Vec<f64>> {
    let order = alpha.len();
    if order == 0 || order > MAX_ORDER {
        return Err(order_refused(order).into());
    }
    if beta.len() + 1 != order {
        let message = format!("beta has {} entries; it must have {}", beta.len(), order - 1);
        return Err(refused(&message));
    }
    let mut out = vec![0.0; 2 * order - 1];
    polynomial::low_power_polynomial(&alpha, &beta, &mut out);
    Ok(out)
}
