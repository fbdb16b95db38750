//! An observer in use from Python, a sample a call: law, memory and clock.
//!
//! A call that is surely sound (numbers, no step longer than before) costs its step and its array.
//! Every other one is handed to the checks in Python, which have the words for what is wrong.

use super::errors::refused;
use super::observers::Observer;
use crate::observer::Status;
use numpy::npyffi::{_PyArray_GET_ITEM_DATA, NPY_ARRAY_WRITEABLE};
use numpy::{PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyFloat, PyInt, PyString, PyTuple};

/// An estimate beyond this many times what the samples and the gain's powers explain diverged.
const DIVERGED: f64 = 1e12;
/// No law has more outputs or inputs.
const WIDEST: usize = 3;

/// Law, memory and clock; the base of the observers in Python.
#[pyclass(subclass, module = "hgo_rs._core")]
pub struct Online {
    /// Missing until `__init__`.
    law: Option<Py<Observer>>,
    memory: Vec<f64>,
    /// The memory after the step that is being taken.
    next: Vec<f64>,
    /// The memory in Python's hands, who may write to it until the next step.
    shown: Option<Py<PyArray1<f64>>>,
    /// Time since the start [s].
    #[pyo3(get, set, name = "_time")]
    time: f64,
    /// The longest step that was found stable: shorter ones are.
    stable_dt: f64,
    allow_unstable: bool,
    /// How far start-up peaks may rise above the samples.
    lift: f64,
}

impl Online {
    fn law<'a>(&'a self, py: Python<'a>) -> PyResult<&'a Observer> {
        let law = self.law.as_ref().ok_or_else(|| refused("Observer.__init__ was not called"))?;
        Ok(law.bind(py).get())
    }

    /// Take back the memory that was shown.
    fn settle(&mut self, py: Python<'_>) {
        if let Some(shown) = &self.shown {
            read(shown.bind(py), &mut self.memory);
        }
    }

    /// Take a step that has been checked, unless the estimate would diverge.
    fn take(&mut self, py: Python<'_>, y: &[f64], u: &[f64], dt: f64) -> PyResult<Option<Status>> {
        self.settle(py);
        let mut next = std::mem::take(&mut self.next);
        next.copy_from_slice(&self.memory);
        let status = self.law(py)?.law().recursion().step(&mut next, y, u, self.time, dt);
        let bound = self.bound(largest(&self.memory), largest(y));
        let holds = self.allow_unstable || next.iter().all(|z| z.abs() <= bound);
        if holds {
            std::mem::swap(&mut self.memory, &mut next);
            self.shown = None;
            self.time += dt;
        }
        self.next = next;
        Ok(holds.then_some(status))
    }
}

#[pymethods]
impl Online {
    /// Subclasses are made with arguments of their own.
    #[new]
    #[pyo3(signature = (*_args, **_kwargs))]
    fn new(_args: &Bound<'_, PyTuple>, _kwargs: Option<&Bound<'_, PyDict>>) -> Self {
        Self {
            law: None,
            memory: Vec::new(),
            next: Vec::new(),
            shown: None,
            time: 0.0,
            stable_dt: 0.0,
            allow_unstable: false,
            lift: 1.0,
        }
    }

    /// An observer of this law at its initial memory; start-up peaks may reach `lift` times the
    /// samples.
    fn __init__(&mut self, law: Bound<'_, Observer>, lift: f64, allow_unstable: bool) {
        self.memory = law.get().law().initial();
        self.next = self.memory.clone();
        self.law = Some(law.unbind());
        (self.shown, self.time, self.stable_dt) = (None, 0.0, 0.0);
        (self.allow_unstable, self.lift) = (allow_unstable, lift);
    }

    /// Where it stands, (m,): x_hat first, then auxiliary states, then the gain r where it moves.
    #[getter]
    fn memory<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let shown =
            self.shown.get_or_insert_with(|| PyArray1::from_slice(py, &self.memory).unbind());
        shown.bind(py).clone()
    }

    #[setter]
    fn set_memory(slf: &Bound<'_, Self>, memory: &Bound<'_, PyAny>) -> PyResult<()> {
        let len = slf.borrow().memory.len();
        let fits = memory.cast_exact::<PyArray1<f64>>().ok().filter(|array| array.len() == len);
        let array = match fits {
            Some(array) => array.clone(),
            None => slf.call_method1("_checked_memory", (memory,))?.cast_into()?,
        };
        slf.borrow_mut().shown = Some(array.unbind());
        Ok(())
    }

    /// Let `step` and `run` use a step beyond the stability limit.
    #[getter]
    fn allow_unstable(&self) -> bool {
        self.allow_unstable
    }

    #[setter]
    fn set_allow_unstable(&mut self, allow_unstable: bool) {
        self.allow_unstable = allow_unstable;
        self.stable_dt = 0.0;
    }

    /// The largest magnitude of a memory that did not diverge, from those of start and samples.
    #[pyo3(name = "_bound")]
    fn bound(&self, start: f64, samples: f64) -> f64 {
        let given = 1.0_f64.max(start).max(samples);
        (DIVERGED * given * self.lift).min(f64::MAX)
    }

    /// Take one sample; return the estimate, (n,).
    ///
    /// With predictor timing the estimate is for the next sample, dt later; with current timing it
    /// is for this sample.
    ///
    /// Parameters
    /// ----------
    /// y : float or (n_y,)
    ///     Sample; None or NaN: missing, the law predicts over it.
    /// u : float or (n_u,), optional
    ///     Known input, held until the next sample.
    /// dt : float
    ///     Time to the next sample [s].
    /// out : (n,) ndarray of float64, optional
    ///     Where to write the estimate: it is returned, and nothing is allocated.
    ///
    /// Raises
    /// ------
    /// HgoError
    ///     An infinite sample, an input that is not finite, dt not positive or at or above the
    ///     stability limit (`allow_unstable=True` in the constructor to study it); an estimate
    ///     that would diverge; an `out` that cannot take the estimate: the sample is not taken.
    #[pyo3(signature = (y, u=None, *, dt, out=None))]
    fn step<'py>(
        slf: &Bound<'py, Self>,
        y: &Bound<'py, PyAny>,
        u: Option<&Bound<'py, PyAny>>,
        dt: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let py = slf.py();
        let (n, n_y, n_u, stable_dt, time) = {
            let me = slf.borrow();
            let law = me.law(py)?.law();
            (law.n(), law.n_y(), law.n_u(), me.stable_dt, me.time)
        };
        let place = out.map(|out| place(slf, out, n)).transpose()?;
        let dt = match dt.cast::<PyFloat>() {
            Ok(dt) if 0.0 < dt.value() && dt.value() <= stable_dt => dt.value(),
            _ => {
                let dt = slf.call_method1(intern!(py, "_checked_dt"), (dt,))?.extract()?;
                slf.borrow_mut().stable_dt = stable_dt.max(dt);
                dt
            }
        };
        let none = py.None();
        let (mut sample, mut input) = ([f64::NAN; WIDEST], [0.0; WIDEST]);
        let (sample, input) = (&mut sample[..n_y], &mut input[..n_u]);
        let sampled = y.is_none() || (read(y, sample) && !sample.iter().any(|y| y.is_infinite()));
        if !sampled {
            ask(slf, intern!(py, "_checked_sample"), y, sample)?;
        }
        let u = u.unwrap_or(none.bind(py));
        let told = if n_u == 0 {
            u.is_none()
        } else {
            read(u, input) && input.iter().all(|u| u.is_finite())
        };
        if !told {
            ask(slf, intern!(py, "_checked_input"), u, input)?;
        }
        if time == 0.0 {
            slf.call_method1(intern!(py, "_check_start"), (slf.getattr("memory")?,))?;
        }
        let taken = slf.borrow_mut().take(py, sample, input, dt)?;
        let refusal = match taken {
            None => Some(slf.call_method0(intern!(py, "_divergence"))?),
            Some(Status::ModelUndefined) if !sample.iter().any(|y| y.is_nan()) => {
                Some(slf.call_method1(intern!(py, "_no_value"), (sample.to_vec(),))?)
            }
            Some(_) => None,
        };
        if let Some(error) = refusal {
            return Err(PyErr::from_value(error));
        }
        let me = slf.borrow();
        let x_hat = &me.memory[..n];
        Ok(match place {
            None => PyArray1::from_slice(py, x_hat),
            Some(place) => {
                write(&place, x_hat)?;
                place
            }
        })
    }
}

/// Numbers by one of Python's checks, which refuses what is wrong.
fn ask<'py>(
    slf: &Bound<'py, Online>,
    check: &Bound<'py, PyString>,
    value: &Bound<'py, PyAny>,
    into: &mut [f64],
) -> PyResult<()> {
    let checked = slf.call_method1(check, (value,))?;
    if read(&checked, into) || into.is_empty() {
        return Ok(());
    }
    Err(refused(&format!("{check} gave {checked}, not {} numbers", into.len())))
}

/// `out` if the estimate can be written there.
fn place<'py>(
    slf: &Bound<'py, Online>,
    out: &Bound<'py, PyAny>,
    n: usize,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    if let Ok(array) = out.cast::<PyArray1<f64>>()
        && array.len() == n
        && array.is_c_contiguous()
        && array.is_aligned()
        && is_writeable(array)
    {
        return Ok(array.clone());
    }
    Err(PyErr::from_value(slf.call_method1("_no_place", (out,))?))
}

#[allow(unsafe_code)] // the flag has no name in the crate numpy
fn is_writeable(array: &Bound<'_, PyArray1<f64>>) -> bool {
    // SAFETY: a Bound array is alive, and this thread is attached to the interpreter
    unsafe { (*_PyArray_GET_ITEM_DATA(array.as_array_ptr())).flags & NPY_ARRAY_WRITEABLE != 0 }
}

/// Write to an array that `place` let through.
#[allow(unsafe_code)] // the safe way registers the array, which allocates
fn write(array: &Bound<'_, PyArray1<f64>>, values: &[f64]) -> PyResult<()> {
    // SAFETY: attached to the interpreter, and without another reference into an array of Python's
    unsafe { array.as_slice_mut() }?.copy_from_slice(values);
    Ok(())
}

/// Whether these are as many numbers as `into` takes, read without a question: a float, an integer
/// or a plain array. What is not may be numbers all the same.
fn read(object: &Bound<'_, PyAny>, into: &mut [f64]) -> bool {
    if let [slot] = into {
        if let Ok(number) = object.cast::<PyFloat>() {
            *slot = number.value();
            return true;
        }
        if let Ok(number) = object.cast_exact::<PyInt>() {
            return number.extract().map(|number| *slot = number).is_ok();
        }
    }
    let Ok(array) = object.cast_exact::<PyArray1<f64>>() else { return false };
    let mut each = into.iter_mut().enumerate();
    array.len() == each.len()
        && array.is_aligned()
        && each.all(|(i, slot)| array.get_owned(i).map(|value| *slot = value).is_some())
}

/// The largest magnitude of the numbers among `values`.
fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |largest, value| largest.max(value.abs()))
}
