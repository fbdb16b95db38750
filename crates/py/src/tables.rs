//! Floor 2. Tables of operations at the Python border.

use crate::errors::Result;
use crate::values::{numbers, read_dict};
use hgo_ir::Spec;
use hgo_ir::table::Table;
use hgo_ir::tables::Tables;
use hgo_ir::trace::{PlacedGains, Setting};
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
/// of this length only; with `held`, those of their gains that no operations compute are inputs behind the
/// parameters, see [`placed_gains`].
#[pyfunction]
#[pyo3(signature = (spec, single=false, missing=false, dt=None, part="step", held=false))]
pub fn trace_step<'py>(
    py: Python<'py>,
    spec: &Bound<'py, PyAny>,
    single: bool,
    missing: bool,
    dt: Option<f64>,
    part: &str,
    held: bool,
) -> Result<Bound<'py, PyDict>> {
    let computed = if held { PlacedGains::Held } else { PlacedGains::Computed };
    let gains = dt.map_or(computed, PlacedGains::For);
    let setting = Setting { gains, ..Setting::usual(single) };
    let spec = read_dict(spec, "observer")?;
    let tables = Tables::read(&Spec::new(&spec, "observer")?, setting)?;
    to_dict(py, &tables.part(part, missing, single)?)
}

/// Gains for corrections that are for times of these lengths, as [`trace_step`] takes them with `held`:
/// for each chain that takes any, which sample corrects it, where its time stands in the memory (with
/// current timing; else it is the step's length), and a row of gains for each length.
#[pyfunction]
#[pyo3(signature = (spec, lengths, single=false))]
#[allow(clippy::needless_pass_by_value, clippy::type_complexity)]
pub fn placed_gains(
    spec: &Bound<'_, PyAny>,
    lengths: Vec<f64>,
    single: bool,
) -> Result<Vec<(usize, Option<usize>, Vec<Vec<f64>>)>> {
    let setting = Setting { gains: PlacedGains::Held, ..Setting::usual(single) };
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
