//! Floor 1. Coefficients from poles, at the Python border.

use crate::errors::{Result, refused};
use hgo_ir::dispatch_order;
use hgo_ir::order::order_refused;
use hgo_rs::observers::MAX_ORDER;
use hgo_rs::polynomial;
use pyo3::prelude::*;

fn pairs<const N: usize>(poles: &[(f64, f64)]) -> [(f64, f64); N] {
    std::array::from_fn(|i| poles.get(i).copied().unwrap_or((0.0, 0.0)))
}

/// Coefficients [k_1 ... k_n] from poles given as (real, imaginary) pairs.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn coefficients_from_poles(poles: Vec<(f64, f64)>) -> Result<Vec<f64>> {
    dispatch_order!(poles.len(), N => {
        Ok(polynomial::coefficients_from_poles::<f64, N>(pairs(&poles))?.to_vec())
    }, else Err(order_refused(poles.len()).into()))
}

/// Whether s^n + c_1 s^(n-1) + ... + c_n has all roots in the left half plane.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn is_hurwitz(coefficients: Vec<f64>) -> bool {
    polynomial::is_hurwitz(&coefficients)
}

type AlphaBeta = (Vec<f64>, Vec<f64>);

fn without_last(alpha: &[f64], beta: &[f64]) -> AlphaBeta {
    (alpha.to_vec(), beta.split_last().map_or_else(Vec::new, |(_, rest)| rest.to_vec()))
}

/// (alpha, beta) from the trailing coefficients of a Hurwitz polynomial of degree 2n - 1.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn low_power_coefficients(coefficients: Vec<f64>) -> Result<AlphaBeta> {
    let order = coefficients.len().div_ceil(2);
    dispatch_order!(order, N => {
        let (alpha, beta) = polynomial::low_power_coefficients::<f64, N>(&coefficients)?;
        Ok(without_last(&alpha, &beta))
    }, else Err(order_refused(order).into()))
}

/// (alpha, beta) from 2n - 1 poles given as (real, imaginary) pairs.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn low_power_coefficients_from_poles(poles: Vec<(f64, f64)>) -> Result<AlphaBeta> {
    macro_rules! made {
        ($n:literal) => {{
            let made = polynomial::low_power_coefficients_from_poles::<f64, $n, { 2 * $n - 1 }>(
                pairs(&poles),
            )?;
            Ok(without_last(&made.0, &made.1))
        }};
    }
    match poles.len() {
        1 => made!(1),
        3 => made!(2),
        5 => made!(3),
        7 => made!(4),
        9 => made!(5),
        11 => made!(6),
        13 => made!(7),
        15 => made!(8),
        17 => made!(9),
        19 => made!(10),
        21 => made!(11),
        23 => made!(12),
        other => Err(refused(&format!(
            "{other} poles are not allowed: the low-power observer of order n needs 2n - 1 poles, \
             n = 1 to {MAX_ORDER}"
        ))),
    }
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
