//! Floor 2. Tables of operations at the Python border.

use crate::errors::{Result, refused};
use crate::values::{numbers, read_dict};
use hgo_ir::Spec;
use hgo_ir::table::Table;
use hgo_ir::tables::Tables;
use hgo_ir::trace::{PlacedGains, Setting};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyInt, PyList, PyString, PyTuple};

/// A table as a dict.
fn to_dict<'py>(py: Python<'py>, table: &Table) -> Result<Bound<'py, PyDict>> {
    let out = PyDict::new(py);
    let rows = PyList::empty(py);
    for (name, values) in table.rows()? {
        let mut row = vec![PyString::new(py, name).into_any()];
        row.extend(values.iter().map(|value| PyInt::new(py, *value).into_any()));
        rows.append(PyTuple::new(py, row)?)?;
    }
    out.set_item("inputs", &table.inputs)?;
    out.set_item("constants", &table.constants)?;
    out.set_item("ops", rows)?;
    out.set_item("outputs", &table.outputs)?;
    out.set_item("output_names", &table.output_names)?;
    Ok(out)
}

/// A part of the step of the observer that `spec` describes, as a table over (t, dt, z, y, u,
/// parameters), without the inputs that the part does not take. "step", with predictor timing: (z after
/// the step, innovation). With current timing "correct", the use of a sample, of (t, z, y): (z, innovation);
/// and "predict", the way to the next one, of (t, dt, z, u): z. With `missing` the part that takes the
/// sample where it is missing. With `dt`, corrections that are placed (zoh, bilinear) are right for times
/// of this length only; else their `gains` are "computed" in the table; or those that no operations
/// compute ("held"), or all that depend on that time alone ("given"), are inputs behind the parameters,
/// see [`placed_gains`]. With `fixed_dt` every step has this length: dt is no input, and what depends on
/// it alone is a constant.
#[pyfunction]
#[pyo3(signature = (
    spec, single=false, missing=false, dt=None, part="step", gains="computed", fixed_dt=None
))]
#[allow(clippy::too_many_arguments)]
pub fn trace_step<'py>(
    py: Python<'py>,
    spec: &Bound<'py, PyAny>,
    single: bool,
    missing: bool,
    dt: Option<f64>,
    part: &str,
    gains: &str,
    fixed_dt: Option<f64>,
) -> Result<Bound<'py, PyDict>> {
    let gains = dt.map_or(read_gains(gains), |dt| Ok(PlacedGains::For(dt)))?;
    let setting = Setting { gains, ..Setting::usual(single) };
    let spec = read_dict(spec, "observer")?;
    let tables = Tables::read(&Spec::new(&spec, "observer")?, setting)?;
    to_dict(py, &tables.part(part, missing, single, fixed_dt)?)
}

/// "computed", "held" or "given".
fn read_gains(word: &str) -> Result<PlacedGains> {
    match word {
        "computed" => Ok(PlacedGains::Computed),
        "held" => Ok(PlacedGains::Held),
        "given" => Ok(PlacedGains::Given),
        other => {
            Err(refused(&format!("gains = {other:?} is not allowed: computed, held or given")))
        }
    }
}

/// Gains for corrections that are for times of these lengths, as [`trace_step`] takes them with the same
/// `gains`, "held" or "given": for each chain that takes any, which sample corrects it, where its time stands in the memory (with
/// current timing; else it is the step's length), and a row of gains for each length.
#[pyfunction]
#[pyo3(signature = (spec, lengths, single=false, gains="held"))]
#[allow(clippy::needless_pass_by_value, clippy::type_complexity)]
pub fn placed_gains(
    spec: &Bound<'_, PyAny>,
    lengths: Vec<f64>,
    single: bool,
    gains: &str,
) -> Result<Vec<(usize, Option<usize>, Vec<Vec<f64>>)>> {
    let setting = Setting { gains: read_gains(gains)?, ..Setting::usual(single) };
    let spec = read_dict(spec, "observer")?;
    let tables = Tables::read(&Spec::new(&spec, "observer")?, setting)?;
    let held = tables.held(&lengths).into_iter();
    Ok(held.map(|of| (of.channel, of.elapsed, of.rows)).collect())
}

/// Memories along a record in single precision: times (N,), samples (N, n_y), inputs (N, n_u), memory
/// to start from. Row k stands before sample k, or after it if the law filters.
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn run_single(
    spec: &Bound<'_, PyAny>,
    t: Vec<f64>,
    y: &Bound<'_, PyAny>,
    u: &Bound<'_, PyAny>,
    memory0: Vec<f64>,
) -> Result<Vec<Vec<f32>>> {
    let spec = read_dict(spec, "observer")?;
    let tables = Tables::read(&Spec::new(&spec, "observer")?, Setting::usual(true))?;
    let (y, u) = (numbers(y)?.values, numbers(u)?.values);
    Ok(tables.run_single(&t, (&y, &u), &memory0)?)
}

/// Outputs of a table for rows of inputs, in double or single precision.
#[pyfunction]
#[pyo3(signature = (table, inputs, single=false))]
pub fn evaluate_table(
    table: &Bound<'_, PyAny>,
    inputs: &Bound<'_, PyAny>,
    single: bool,
) -> Result<Vec<Vec<f64>>> {
    let table = read_dict(table, "table")?;
    let table = Table::read(&Spec::new(&table, "table")?)?;
    Ok(table.evaluate_rows(&numbers(inputs)?, single)?)
}

/// The numbers of an observer for the module of a page: see [`hgo_ir::live`].
#[pyfunction]
pub fn live_numbers<'py>(
    py: Python<'py>,
    spec: &Bound<'py, PyAny>,
) -> Result<Bound<'py, PyArray1<f64>>> {
    let spec = read_dict(spec, "observer")?;
    Ok(hgo_ir::live::numbers(&Spec::new(&spec, "observer")?)?.into_pyarray(py))
}
