//! Floor 6. Recorded logs as text: blocks of bytes in, columns out, and the other way round.

use crate::errors::{Result, refused};
use hgo_logs::{Cells, Kind, Layout, Reader, Sign, Values, What, append, cells_of, is_idle};
use numpy::{IntoPyArray, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};

/// Reads blocks of lines as columns, one block after the other.
#[pyclass]
pub struct TextReader(Reader);

#[pymethods]
impl TextReader {
    /// `columns`: place in the line and kind ("number", "moment" or "daytime") of the wanted cells.
    #[new]
    #[pyo3(signature = (delimiter, width, columns, line, trailing))]
    fn new(
        delimiter: Option<u8>,
        width: usize,
        columns: Vec<(usize, String)>,
        line: u64,
        trailing: bool,
    ) -> Result<Self> {
        let columns = columns
            .into_iter()
            .map(|(place, kind)| match kind.as_str() {
                _ if place >= width => {
                    Err(refused(&format!("column {place}: must be below {width}")))
                }
                "number" => Ok((place, Kind::Number)),
                "moment" => Ok((place, Kind::Moment)),
                "daytime" => Ok((place, Kind::Daytime)),
                _ => Err(refused(&format!("kind {kind}: must be number, moment or daytime"))),
            })
            .collect::<Result<_>>()?;
        Ok(Self(Reader::new(Layout { delimiter, width, columns, trailing }, line)))
    }

    /// Whether decimal commas were seen.
    #[getter]
    fn commas(&self) -> bool {
        self.0.sign() == Sign::Comma
    }

    /// The number of the next line.
    #[getter]
    fn line(&self) -> u64 {
        self.0.line()
    }

    /// From `begin` of a block on: columns (values, rows of large whole numbers, these), the lines of the rows, and the bytes read; or a
    /// dict that says what is wrong with which line.
    fn read<'py>(
        &mut self,
        py: Python<'py>,
        block: &[u8],
        begin: usize,
        most: usize,
        last: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let block = block.get(begin..).unwrap_or_default();
        let read = py.detach(|| self.0.read(block, most, last));
        let fault = match read {
            Ok(rows) => {
                let columns: Vec<_> = rows
                    .columns
                    .into_iter()
                    .map(|column| {
                        let values = match column.values {
                            Values::Numbers(values) => values.into_pyarray(py).into_any(),
                            Values::Nanoseconds(values) => values.into_pyarray(py).into_any(),
                        };
                        (values, column.large_rows.into_pyarray(py), column.large.into_pyarray(py))
                    })
                    .collect();
                let lines = rows.lines.into_pyarray(py);
                return Ok((columns, lines, rows.read).into_pyobject(py)?.into_any());
            }
            Err(fault) => fault,
        };
        let told = PyDict::new(py);
        told.set_item("line", fault.line)?;
        told.set_item("text", PyBytes::new(py, &fault.text))?;
        match fault.what {
            What::Cells(count) => told.set_item("cells", count)?,
            What::Cell(column, cell) => told.set_item("cell", (column, PyBytes::new(py, &cell)))?,
            What::Zone(column, cell) => told.set_item("zone", (column, PyBytes::new(py, &cell)))?,
            What::Long => told.set_item("long", true)?,
            What::Open => told.set_item("quote", "open")?,
            What::Quote => told.set_item("quote", "inside")?,
        }
        Ok(told.into_any())
    }
}

/// The cells of a line, without blanks around them; None: a quote is out of place.
#[pyfunction]
pub fn text_cells<'py>(
    py: Python<'py>,
    line: &[u8],
    delimiter: Option<u8>,
) -> Option<Vec<Bound<'py, PyBytes>>> {
    let cells = cells_of(line, delimiter)?;
    Some(cells.iter().map(|cell| PyBytes::new(py, cell)).collect())
}

/// Whether a line is blank or a comment.
#[pyfunction]
pub fn text_is_idle(line: &[u8]) -> bool {
    is_idle(line)
}

/// What a cell holds: "missing", "number", "moment", "daytime", or None.
#[pyfunction]
pub fn text_kind(cell: &[u8], commas: bool) -> Option<&'static str> {
    if hgo_logs::is_missing(cell) {
        return Some("missing");
    }
    let number = hgo_logs::number(cell, &mut Sign::Unseen, commas).map(|_| "number");
    let moment = || hgo_logs::moment(cell).map(|_| "moment");
    number.or_else(moment).or_else(|| hgo_logs::daytime(cell).map(|_| "daytime"))
}

#[derive(FromPyObject)]
enum Numbers<'py> {
    Floats(PyReadonlyArray1<'py, f64>),
    Integers(PyReadonlyArray1<'py, i64>),
}

/// A line for each row of columns of float64 or int64, as CSV.
#[pyfunction]
pub fn text_lines<'py>(
    py: Python<'py>,
    columns: &Bound<'py, PyList>,
) -> Result<Bound<'py, PyBytes>> {
    let held =
        columns.iter().map(|column| column.extract()).collect::<PyResult<Vec<Numbers<'_>>>>()?;
    let mut cells = Vec::with_capacity(held.len());
    for column in &held {
        cells.push(match column {
            Numbers::Floats(values) => Cells::Numbers(values.as_slice()?),
            Numbers::Integers(values) => Cells::Integers(values.as_slice()?),
        });
    }
    let mut out = Vec::new();
    py.detach(|| append(&cells, &mut out));
    Ok(PyBytes::new(py, &out))
}
