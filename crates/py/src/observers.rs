//! Floor 4. The class `Observer` that Python steps and runs.

use crate::errors::{Result, refused};
use crate::kernel::{self, RecordKernel};
use crate::record::{self, Clock};
use crate::values::{contiguous, read_dict};
use hgo_ir::Spec;
use hgo_ir::recursion::AnyObserver;
use hgo_rs::observer::Status;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyFloat, PyFloatMethods};

/// An observer of the core, from its spec.
#[pyclass(frozen, module = "hgo_rs._core")]
pub struct Observer {
    inner: Box<dyn AnyObserver>,
    memory_len: usize,
}

impl Observer {
    pub fn law(&self) -> &dyn AnyObserver {
        &*self.inner
    }
}

#[pymethods]
impl Observer {
    #[new]
    fn new(spec: &Bound<'_, PyAny>) -> Result<Self> {
        let inner =
            hgo_ir::observer::build(&Spec::new(&read_dict(spec, "observer")?, "observer")?)?;
        let memory_len = inner.initial().len();
        Ok(Self { inner, memory_len })
    }

    /// Number of estimated states.
    #[getter]
    fn n(&self) -> usize {
        self.law().n()
    }

    /// Number of measured outputs.
    #[getter]
    fn n_y(&self) -> usize {
        self.law().n_y()
    }

    /// Number of known inputs.
    #[getter]
    fn n_u(&self) -> usize {
        self.law().n_u()
    }

    /// Number of memory entries.
    #[getter]
    pub fn memory_len(&self) -> usize {
        self.memory_len
    }

    /// Whether the estimate at k uses y(k).
    #[getter]
    fn is_current(&self) -> bool {
        self.law().is_current()
    }

    /// Memory to start from when nothing is known.
    fn initial<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.law().initial().into_pyarray(py)
    }

    /// A memory with its estimates of the outputs at first samples, (n_y,), those that are there; None where
    /// the law has no such start.
    fn begin<'py>(
        &self,
        py: Python<'py>,
        memory: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
    ) -> Result<Option<Bound<'py, PyArray1<f64>>>> {
        let mut memory = sized("memory", memory, self.memory_len)?.as_slice()?.to_vec();
        let y = sized("y", y, self.law().n_y())?;
        let begun = self.law().begin(&mut memory, y.as_slice()?)?;
        Ok(begun.then(|| memory.into_pyarray(py)))
    }

    /// (memory, status) after one step, from time t over dt; status 0 updated, 1 predicted, 2 model
    /// undefined. With current timing u and dt belong to the period that ends with the sample.
    fn step<'py>(
        &self,
        py: Python<'py>,
        memory: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
        u: &Bound<'py, PyAny>,
        t: f64,
        dt: f64,
    ) -> Result<(Bound<'py, PyArray1<f64>>, u8)> {
        if !self.law().is_current() {
            return self.advance(py, memory, y, u, t, dt);
        }
        let (moved, status) = self.advance(py, memory, y, u, t, dt)?;
        if status == Status::ModelUndefined as u8 {
            return Ok((moved, status));
        }
        self.correct(py, moved.as_any(), y, t + dt)
    }

    /// (memory, status) after the sample of time t is used, with current timing.
    fn correct<'py>(
        &self,
        py: Python<'py>,
        memory: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
        t: f64,
    ) -> Result<(Bound<'py, PyArray1<f64>>, u8)> {
        let mut memory = sized("memory", memory, self.memory_len)?.as_slice()?.to_vec();
        let y = sized("y", y, self.law().n_y())?;
        let status = self.law().recursion().correct(&mut memory, y.as_slice()?, t)?;
        Ok((memory.into_pyarray(py), status as u8))
    }

    /// (memory, status) at time t + dt from that at t; with predictor timing by the sample y of t.
    fn advance<'py>(
        &self,
        py: Python<'py>,
        memory: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
        u: &Bound<'py, PyAny>,
        t: f64,
        dt: f64,
    ) -> Result<(Bound<'py, PyArray1<f64>>, u8)> {
        let mut memory = sized("memory", memory, self.memory_len)?.as_slice()?.to_vec();
        let y = sized("y", y, self.law().n_y())?;
        let u = sized("u", u, self.law().n_u())?;
        let (y, u) = (y.as_slice()?, u.as_slice()?);
        let status = self.law().recursion().advance(&mut memory, y, u, t, dt)?;
        Ok((memory.into_pyarray(py), status as u8))
    }

    /// The observer over a record as LLVM IR: a dict of `text`, `name`, `operations` of a sample and
    /// `widths` of its rows; None where functions of the user's are called.
    fn record_source<'py>(&self, py: Python<'py>) -> Result<Option<Bound<'py, PyDict>>> {
        kernel::record_source(py, self.law())
    }

    /// Run over a record: times (N,) or a period, samples (N, n_y), inputs (N, n_u), memory to start
    /// from; with `until`, on to that time after the last sample. Gives the track, a copy of the samples,
    /// what the checks found, and the memory at the end (`next`). A kernel takes what it can of it.
    #[pyo3(signature = (t, y, u, memory0, innovation=true, until=None, kernel=None))]
    #[allow(clippy::too_many_arguments)] // the record, and what is asked of it, by keyword
    fn run<'py>(
        &self,
        py: Python<'py>,
        t: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
        u: &Bound<'py, PyAny>,
        memory0: &Bound<'py, PyAny>,
        innovation: bool,
        until: Option<f64>,
        kernel: Option<&Bound<'py, RecordKernel>>,
    ) -> Result<Bound<'py, PyDict>> {
        let kernel = kernel.map(Bound::get);
        if kernel.is_some_and(|kernel| !kernel.suits(self.law())) {
            return Err(refused("this kernel was compiled for another observer"));
        }
        let y = contiguous(y)?;
        let samples = y.len() / self.law().n_y();
        let y = checked_size("y", y, samples * self.law().n_y())?;
        let period = t.cast::<PyFloat>().ok().map(|t| Clock::Period(t.value()));
        let times = if period.is_none() { Some(sized("t", t, samples)?) } else { None };
        let u = sized("u", u, samples * self.law().n_u())?;
        let mut memory = sized("memory0", memory0, self.memory_len)?.as_slice()?.to_vec();
        let clock = match &times {
            Some(t) => Clock::Times(t.as_slice()?),
            None => period.unwrap_or(Clock::Times(&[])),
        };
        let record = (clock, y.as_slice()?, u.as_slice()?);
        let out = record::run(py, (self.law(), kernel), &mut memory, record, until, innovation)?;
        out.set_item("next", memory.into_pyarray(py))?;
        Ok(out)
    }
}

/// `len` numbers, whatever their shape.
fn sized<'py>(
    name: &str,
    object: &Bound<'py, PyAny>,
    len: usize,
) -> Result<PyReadonlyArrayDyn<'py, f64>> {
    checked_size(name, contiguous(object)?, len)
}

fn checked_size<'py>(
    name: &str,
    given: PyReadonlyArrayDyn<'py, f64>,
    len: usize,
) -> Result<PyReadonlyArrayDyn<'py, f64>> {
    if given.len() != len {
        let message = format!("{name} has shape {:?}; it must hold {len} numbers", given.shape());
        return Err(refused(&message));
    }
    Ok(given)
}
