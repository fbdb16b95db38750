//! Specs in, arrays out: dicts whose keys, types and shapes are checked one by one.

use super::errors::refused;
use numpy::ndarray::{Dim, Dimension};
use numpy::{
    Element, IntoPyArray, PyArray, PyArray2, PyArrayMethods, PyReadonlyArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

/// A dict with a name for messages.
pub struct Spec<'py> {
    dict: Bound<'py, PyDict>,
    name: String,
}

/// Numbers with their shape.
pub struct Numbers {
    pub values: Vec<f64>,
    pub shape: Vec<usize>,
}

impl<'py> Spec<'py> {
    pub fn new(object: &Bound<'py, PyAny>, name: &str) -> PyResult<Self> {
        let dict = object
            .cast::<PyDict>()
            .map_err(|_| refused(&format!("{name} must be a dict, not {}", kind_of(object))))?;
        Ok(Self { dict: dict.clone(), name: name.to_owned() })
    }

    /// Refuse keys that nothing reads.
    pub fn only(&self, known: &[&str]) -> PyResult<()> {
        for key in self.dict.keys() {
            let key: String = key.extract()?;
            if !known.contains(&key.as_str()) {
                let message = format!(
                    "{} has an unknown key {key:?}; known keys: {}",
                    self.name,
                    known.join(", ")
                );
                return Err(refused(&message));
            }
        }
        Ok(())
    }

    pub fn get(&self, key: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        Ok(self.dict.get_item(key)?.filter(|value| !value.is_none()))
    }

    fn need(&self, key: &str) -> PyResult<Bound<'py, PyAny>> {
        self.get(key)?.ok_or_else(|| refused(&format!("{} needs {key:?}", self.name)))
    }

    /// Refusal of a value that could not be read; an interrupt while reading it passes through.
    fn wrong(&self, error: PyErr, key: &str, value: &Bound<'py, PyAny>, wanted: &str) -> PyErr {
        if !error.is_instance_of::<PyException>(value.py()) {
            return error;
        }
        let shown = value.repr().map_or_else(|_| kind_of(value), |text| text.to_string());
        refused(&format!("{}[{key:?}] = {shown} is not {wanted}", self.name))
    }

    pub fn sub(&self, key: &str) -> PyResult<Spec<'py>> {
        Spec::new(&self.need(key)?, key)
    }

    /// The dict itself.
    pub fn to_any(&self) -> Py<PyAny> {
        self.dict.clone().into_any().unbind()
    }

    /// A list of dicts.
    pub fn list(&self, key: &str) -> PyResult<Vec<Spec<'py>>> {
        let value = self.need(key)?;
        let rows = value.try_iter().map_err(|e| self.wrong(e, key, &value, "a list of dicts"))?;
        rows.map(|row| Spec::new(&row?, key)).collect()
    }

    pub fn text(&self, key: &str) -> PyResult<String> {
        let value = self.need(key)?;
        value.extract().map_err(|e| self.wrong(e, key, &value, "a string"))
    }

    pub fn text_or(&self, key: &str, default: &str) -> PyResult<String> {
        if self.get(key)?.is_some() { self.text(key) } else { Ok(default.to_owned()) }
    }

    /// A list of strings, if it is there.
    pub fn texts(&self, key: &str) -> PyResult<Option<Vec<String>>> {
        let Some(value) = self.get(key)? else { return Ok(None) };
        let read = value.extract().map(Some);
        read.map_err(|e| self.wrong(e, key, &value, "a list of strings"))
    }

    pub fn f64(&self, key: &str) -> PyResult<f64> {
        let value = self.need(key)?;
        value.extract().map_err(|e| self.wrong(e, key, &value, "a number"))
    }

    pub fn f64_or(&self, key: &str, default: f64) -> PyResult<f64> {
        if self.get(key)?.is_some() { self.f64(key) } else { Ok(default) }
    }

    pub fn whole(&self, key: &str) -> PyResult<u64> {
        let value = self.need(key)?;
        value.extract().map_err(|e| self.wrong(e, key, &value, "a whole number >= 0"))
    }

    pub fn whole_or(&self, key: &str, default: u64) -> PyResult<u64> {
        if self.get(key)?.is_some() { self.whole(key) } else { Ok(default) }
    }

    pub fn count(&self, key: &str) -> PyResult<usize> {
        let value = self.need(key)?;
        value.extract().map_err(|e| self.wrong(e, key, &value, "a whole number >= 0"))
    }

    pub fn flag_or(&self, key: &str, default: bool) -> PyResult<bool> {
        match self.get(key)? {
            None => Ok(default),
            Some(value) => value.extract().map_err(|e| self.wrong(e, key, &value, "True or False")),
        }
    }

    pub fn numbers(&self, key: &str) -> PyResult<Numbers> {
        let value = self.need(key)?;
        numbers(&value).map_err(|e| self.wrong(e, key, &value, "an array of numbers"))
    }

    /// A vector of `N` numbers, the given ones first; `given` of them must be there.
    pub fn vector<const N: usize>(&self, key: &str, given: usize) -> PyResult<[f64; N]> {
        let Numbers { values, shape } = self.numbers(key)?;
        if shape.len() != 1 || values.len() != given {
            let message =
                format!("{}[{key:?}] has shape {shape:?}; it must have {given} entries", self.name);
            return Err(refused(&message));
        }
        Ok(std::array::from_fn(|i| values.get(i).copied().unwrap_or(0.0)))
    }

    /// Rows of `columns` finite numbers: one for all runs, or one a run.
    pub fn rows(&self, key: &str, columns: usize, runs: usize) -> PyResult<Vec<f64>> {
        let Numbers { values, shape } = self.numbers(key)?;
        let fits = matches!(shape.as_slice(), [c] if *c == columns)
            || matches!(shape.as_slice(), [r, c] if *r == runs && *c == columns);
        if !fits {
            let message = format!(
                "{}[{key:?}] has shape {shape:?}; it must be ({columns},) or ({runs}, {columns})",
                self.name
            );
            return Err(refused(&message));
        }
        if let Some(bad) = values.iter().find(|value| !value.is_finite()) {
            let message = format!("{}[{key:?}] holds {bad}; it must be finite", self.name);
            return Err(refused(&message));
        }
        Ok(values)
    }

    pub fn unknown(&self, key: &str, value: &str, known: &[&str]) -> PyErr {
        let message = format!(
            "{}[{key:?}] = {value:?} is not known; choose from {}",
            self.name,
            known.join(", ")
        );
        refused(&message)
    }
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
