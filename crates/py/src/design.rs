//! Floor 1. The list of laws, and coefficients from poles, at the Python border.

use crate::errors::{Result, refused};
use hgo_ir::design::{self, AlphaBeta};
use hgo_ir::order::order_refused;
use hgo_rs::laws::{Form, Gain, Law, Part, Sizes};
use hgo_rs::observers::{LAWS, MAX_ORDER};
use hgo_rs::polynomial;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The list of laws: a dict each, its entries those of [`Law`], counts in words.
#[pyfunction]
pub fn laws(py: Python<'_>) -> Result<Vec<Bound<'_, PyDict>>> {
    let words = |parts: &'static [Part]| -> Vec<(&str, &str)> {
        parts.iter().map(|part| (part.name, part.count)).collect()
    };
    let row = |law: &'static Law| {
        let row = PyDict::new(py);
        row.set_item("kind", law.kind)?;
        row.set_item("title", law.title)?;
        row.set_item("coefficients", words(law.coefficients))?;
        row.set_item("size", law.size.map(|(name, values)| (name, values.to_vec())))?;
        row.set_item("orders", law.orders.to_vec())?;
        row.set_item("poles", law.design.map(|design| design.poles.count))?;
        let gain = match law.gain {
            Gain::Any => "any",
            Gain::Adaptive => "adaptive",
            Gain::Constant => "constant",
            Gain::None => "none",
        };
        row.set_item("gain", gain)?;
        row.set_item("saturated", law.saturated)?;
        row.set_item("open", law.open)?;
        let form = match law.form {
            Form::Unknown => "unknown",
            Form::Phase => "phase",
            Form::Triangular => "triangular",
            Form::Chain => "nonlinear-chain",
            Form::Sampled => "sampled",
            Form::StrictFeedback => "strict-feedback",
        };
        row.set_item("form", form)?;
        row.set_item("continuous", law.continuous)?;
        row.set_item("placed", law.placed())?;
        row.set_item("flows", law.flows())?;
        row.set_item("memory", words(law.memory))?;
        row.set_item("source", law.source)?;
        Ok(row)
    };
    LAWS.iter().map(row).collect()
}

fn found(kind: &str) -> Result<&'static Law> {
    Law::find(LAWS, kind).ok_or_else(|| refused(&format!("kind = {kind:?} is not known")))
}

/// Entries of each list of coefficients and of each part of the memory, and how many poles make the
/// coefficients, for order n, second size m and a gain that moves or not.
#[pyfunction]
pub fn law_sizes<'py>(
    py: Python<'py>,
    kind: &str,
    n: usize,
    m: usize,
    moves: bool,
) -> Result<Bound<'py, PyDict>> {
    let (law, sizes) = (found(kind)?, Sizes { n, m, moves, ..Sizes::default() });
    let counted = |parts: &[Part]| -> Vec<(&str, usize)> {
        parts.iter().map(|part| (part.name, (part.len)(&sizes))).collect()
    };
    let out = PyDict::new(py);
    out.set_item("coefficients", counted(law.coefficients))?;
    out.set_item("memory", counted(law.memory))?;
    out.set_item("poles", law.design.map(|design| (design.poles.len)(&sizes)))?;
    Ok(out)
}

/// Q and P(0) of the high-gain EKF: see [`design::covariances`].
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn ekf_covariances(
    n: usize,
    sampled: bool,
    q: Vec<f64>,
    r: f64,
    p0: Option<Vec<f64>>,
    theta: f64,
) -> Result<(Vec<f64>, Vec<f64>)> {
    let made = design::covariances(n, sampled, &q, r, p0.as_deref(), theta)?;
    Ok((made.q, made.p0))
}

/// The lists of coefficients of a law from poles given as (real, imaginary) pairs; the usual ones without.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn law_coefficients(
    kind: &str,
    n: usize,
    m: usize,
    poles: Option<Vec<(f64, f64)>>,
) -> Result<Vec<Vec<f64>>> {
    let sizes = Sizes { n, m, ..Sizes::default() };
    Ok(design::of_law(found(kind)?, &sizes, poles.as_deref())?)
}

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
