//! Floor 1. From Python to plain data, and arrays back.

use crate::errors::Result;
use hgo_ir::{Function, Numbers, Value};
use numpy::ndarray::{Dim, Dimension};
use numpy::{
    Element, IntoPyArray, PyArray, PyArray2, PyArrayDescrMethods, PyArrayMethods,
    PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use std::sync::Arc;

/// A function in Python.
struct PyFunction(Py<PyAny>);

impl Function for PyFunction {
    fn call(&self, arguments: &[f64]) -> hgo_ir::Result<Vec<f64>> {
        let made = Python::attach(|py| self.0.bind(py).call1((arguments.to_vec(),))?.extract());
        made.map_err(|error: PyErr| hgo_ir::Error::Called(Arc::new(error)))
    }
}

/// A dict, with all that it holds, as plain data; `name` is its name in messages.
pub fn read_dict(object: &Bound<'_, PyAny>, name: &str) -> Result<Value> {
    let Ok(dict) = object.cast::<PyDict>() else {
        let message = format!("{name} must be a dict, not {}", kind_of(object));
        return Err(hgo_ir::error::refused(message).into());
    };
    Ok(map(dict, 0)?)
}

/// Levels of a spec that are read: it may hold itself.
const DEEPEST: usize = 16;

fn map(dict: &Bound<'_, PyDict>, depth: usize) -> PyResult<Value> {
    // its items in a list of their own: reading one may change the dict
    let read = |item: Bound<'_, PyAny>| {
        let (key, entry): (String, Bound<'_, PyAny>) = item.extract()?;
        Ok((key, value(&entry, depth + 1)?))
    };
    dict.items().iter().map(read).collect::<PyResult<_>>().map(Value::Map)
}

/// What was read, or nothing for an object that is of another kind; an interrupt while reading it
/// passes through.
fn unless_interrupted<T>(py: Python<'_>, read: PyResult<T>) -> PyResult<Option<T>> {
    match read {
        Ok(value) => Ok(Some(value)),
        Err(error) if error.is_instance_of::<PyException>(py) => Ok(None),
        Err(error) => Err(error),
    }
}

fn value(object: &Bound<'_, PyAny>, depth: usize) -> PyResult<Value> {
    if object.is_none() {
        return Ok(Value::Nothing);
    }
    if let Ok(number) = object.cast_exact::<PyFloat>() {
        return Ok(Value::Number(number.value()));
    }
    if let Ok(whole) = object.cast_exact::<PyInt>()
        && let Ok(whole) = whole.extract::<i64>()
    {
        return Ok(Value::Whole(whole.into()));
    }
    if let Ok(text) = object.cast::<PyString>() {
        return Ok(Value::Text(text.extract()?));
    }
    if depth > DEEPEST {
        return Ok(other(object, "..."));
    }
    if let Ok(dict) = object.cast::<PyDict>() {
        return map(dict, depth);
    }
    let list = |rows: PyResult<_>| rows.map(Value::List);
    if let Ok(given) = object.cast::<PyList>() {
        return list(given.iter().map(|entry| value(&entry, depth + 1)).collect());
    }
    if let Ok(given) = object.cast::<PyTuple>() {
        return list(given.iter().map(|entry| value(&entry, depth + 1)).collect());
    }
    if let Ok(array) = object.cast::<PyUntypedArray>() {
        // entries of another type (strings, objects) are read one by one
        return if !b"biuf".contains(&array.dtype().kind()) {
            value(&object.call_method0("tolist")?, depth + 1)
        } else if array.ndim() == 0 {
            Ok(Value::Number(object.extract()?))
        } else {
            numbers(object).map(shared)
        };
    }
    let py = object.py();
    if let Some(flag) = unless_interrupted(py, object.extract())? {
        return Ok(Value::Flag(flag));
    }
    if let Some(whole) = unless_interrupted(py, object.extract())? {
        return Ok(Value::Whole(whole));
    }
    if let Some(number) = unless_interrupted(py, object.extract())? {
        return Ok(Value::Number(number));
    }
    if object.is_callable() {
        return Ok(Value::Function(Arc::new(PyFunction(object.clone().unbind()))));
    }
    // what is no number at all, and too large an integer is no array either
    if !object.is_instance_of::<PyInt>()
        && let Some(numbers) = unless_interrupted(py, numbers(object))?
    {
        return Ok(shared(numbers));
    }
    let shown = unless_interrupted(py, object.repr())?;
    Ok(other(object, &shown.map_or_else(|| kind_of(object), |text| text.to_string())))
}

fn other(object: &Bound<'_, PyAny>, shown: &str) -> Value {
    Value::Other { kind: kind_of(object), shown: shown.to_owned() }
}

fn shared(numbers: Numbers) -> Value {
    Value::Numbers(Arc::new(numbers))
}

fn kind_of(object: &Bound<'_, PyAny>) -> String {
    object.get_type().name().map_or_else(|_| "this object".to_owned(), |name| name.to_string())
}

/// Anything that NumPy reads as an array of numbers; itself if it is one in C order.
pub fn contiguous<'py>(object: &Bound<'py, PyAny>) -> PyResult<PyReadonlyArrayDyn<'py, f64>> {
    let numpy = object.py().import("numpy")?;
    // ascontiguousarray makes a scalar an array of one entry
    numpy.call_method1("ascontiguousarray", (object, "float64"))?.extract()
}

/// The same, copied.
pub fn numbers(object: &Bound<'_, PyAny>) -> PyResult<Numbers> {
    let array = contiguous(object)?;
    Ok(Numbers { shape: array.shape().to_vec(), values: array.to_vec()? })
}
/// A matrix of `rows` rows.
pub fn matrix(py: Python<'_>, values: Vec<f64>, rows: usize) -> PyResult<Bound<'_, PyArray2<f64>>> {
    let columns = values.len().checked_div(rows).unwrap_or(0);
    values.into_pyarray(py).reshape([rows, columns])
}

/// An array whose entries are still to be written.
pub fn empty<T: Element, const D: usize>(
    py: Python<'_>,
    shape: [usize; D],
) -> PyResult<Bound<'_, PyArray<T, Dim<[usize; D]>>>>
where
    Dim<[usize; D]>: Dimension,
{
    let numpy = py.import("numpy")?;
    let made = numpy.call_method1("empty", (PyTuple::new(py, shape)?, T::get_dtype(py)))?;
    Ok(made.cast_into()?)
}
