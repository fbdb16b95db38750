//! Floor 6. An observer in use from Python, a sample a call: law, memory and clock.
//!
//! A call that is surely sound (numbers, no step longer than before) costs its step and its array.
//! Every other one is handed to the checks in Python, which have the words for what is wrong.

use crate::errors::{Result, refused};
use crate::observers::Observer;
use hgo_ir::CHAINS;
use hgo_ir::MAX_INPUTS;
use hgo_rs::estimator::Clock;
use hgo_rs::observer::Status;
use numpy::npyffi::{
    _PyArray_GET_ITEM_DATA, NPY_ARRAY_ALIGNED, NPY_ARRAY_C_CONTIGUOUS, NPY_ARRAY_WRITEABLE,
};
use numpy::{PyArray1, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyFloat, PyInt, PyString, PyTuple};

/// An estimate beyond this many times what the samples and the gain's powers explain diverged.
const DIVERGED: f64 = 1e12;

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
    clock: Clock<f64>,
    /// Whether a sample was taken since the start.
    #[pyo3(get, set, name = "_started")]
    started: bool,
    /// Whether a period was predicted over that no sample has ended.
    #[pyo3(get, set, name = "_open")]
    open: bool,
    /// The longest step that was found stable: shorter ones are.
    stable_dt: f64,
    allow_unstable: bool,
    /// How far start-up peaks may rise above the samples.
    lift: f64,
}

/// What a call does.
#[derive(Clone, Copy, PartialEq)]
enum Verb {
    Step,
    Correct,
    Predict,
}

/// What became of a call.
enum Outcome {
    Taken,
    /// Nothing was taken: the estimate would diverge.
    Diverged,
    /// Nothing was taken: the model has no value.
    Undefined,
}

/// What is asked of an observer, numbers that have been checked.
struct Asked<'a> {
    verb: Verb,
    y: &'a [f64],
    u: &'a [f64],
    dt: f64,
}

impl Online {
    fn law<'a>(&'a self, py: Python<'a>) -> Result<&'a Observer> {
        let law = self.law.as_ref().ok_or_else(|| refused("Observer.__init__ was not called"))?;
        Ok(law.bind(py).get())
    }

    /// Take back the memory that was shown.
    fn settle(&mut self, py: Python<'_>) -> Result<()> {
        match &self.shown {
            Some(shown) if !read(shown.bind(py), &mut self.memory) => Err(refused(&format!(
                "memory must stay a float64 array of {} entries: it was made another one; assign a \
                 new one, or call reset()",
                self.memory.len()
            ))),
            _ => Ok(()),
        }
    }

    /// Do what is asked, unless the estimate would diverge or the model has no value.
    fn take(&mut self, py: Python<'_>, asked: &Asked<'_>) -> Result<Outcome> {
        self.settle(py)?;
        let mut next = std::mem::take(&mut self.next);
        next.clone_from(&self.memory);
        let outcome = self.moved(py, &mut next, asked);
        if let Ok(Outcome::Taken) = outcome {
            std::mem::swap(&mut self.memory, &mut next);
            self.shown = None;
        }
        self.next = next;
        outcome
    }

    /// What is asked, on a copy of the memory; the clock goes on if it is taken.
    fn moved(&mut self, py: Python<'_>, next: &mut [f64], asked: &Asked<'_>) -> Result<Outcome> {
        let Asked { verb, y, u, dt } = *asked;
        let observer = self.law(py)?;
        let law = observer.law();
        if (y.len(), u.len(), next.len()) != (law.n_y(), law.n_u(), observer.memory_len()) {
            return Err(refused("the observer was made another one during the call"));
        }
        let (recursion, t) = (law.recursion(), self.clock.time());
        let current = law.is_current();
        let passes = match verb {
            Verb::Correct => false,
            Verb::Predict => true,
            Verb::Step => !current || self.started,
        };
        let mut clock = self.clock;
        let mut status = Status::Predicted;
        if passes && self.open && current {
            // the period before, which no sample ended
            status = recursion.correct(next, &[f64::NAN; CHAINS][..y.len()], t)?;
        }
        if passes && status != Status::ModelUndefined {
            status = recursion.advance(next, y, u, t, dt)?;
            clock.pass(dt);
        }
        if status != Status::ModelUndefined && current && verb != Verb::Predict {
            status = recursion.correct(next, y, clock.time())?;
        }
        let start = largest(&self.memory);
        let finite = next.iter().all(|z| z.is_finite());
        if status == Status::ModelUndefined || (!finite && start <= DIVERGED * self.lift) {
            return Ok(Outcome::Undefined);
        }
        let bound = self.bound(start, largest(y));
        if !finite || (!self.allow_unstable && !next.iter().all(|z| z.abs() <= bound)) {
            return Ok(Outcome::Diverged);
        }
        self.clock = clock;
        self.open = verb == Verb::Predict;
        self.started |= verb != Verb::Predict;
        Ok(Outcome::Taken)
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
            clock: Clock::new(),
            started: false,
            open: false,
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
        (self.shown, self.clock, self.stable_dt) = (None, Clock::new(), 0.0);
        (self.started, self.open) = (false, false);
        (self.allow_unstable, self.lift) = (allow_unstable, lift);
    }

    /// Time since the start [s].
    #[getter(_time)]
    fn time(&self) -> f64 {
        self.clock.time()
    }

    /// The clock itself, for copies.
    #[getter(_clock)]
    fn parts(&self) -> (u32, [f64; 3]) {
        self.clock.parts()
    }

    #[setter(_clock)]
    fn set_parts(&mut self, parts: (u32, [f64; 3])) {
        self.clock = Clock::from_parts(parts);
    }

    #[setter(_time)]
    fn set_time(&mut self, time: f64) {
        self.clock = Clock::new();
        self.clock.pass(time);
        (self.started, self.open) = (time > 0.0, false);
    }

    /// Where it stands, (m,): x_hat first, then auxiliary states, then the gain r where it moves.
    #[getter]
    fn memory<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let shown =
            self.shown.get_or_insert_with(|| PyArray1::from_slice(py, &self.memory).unbind());
        shown.bind(py).clone()
    }

    #[setter]
    fn set_memory(slf: &Bound<'_, Self>, memory: &Bound<'_, PyAny>) -> Result<()> {
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
    /// With predictor timing y is the sample of now, u the input from now on, dt the time to the next
    /// sample, and the estimate is for the next sample. With current timing u and dt belong to the
    /// period that has just ended, and the estimate is for this sample: `predict(u, dt)`, then
    /// `correct(y)`; the first call after a start only corrects.
    ///
    /// Parameters
    /// ----------
    /// y : float or (n_y,)
    ///     Sample; None or NaN: missing, the law predicts over it.
    /// u : float or (n_u,), optional
    ///     Known input, held over the period.
    /// dt : float
    ///     Length of the period [s].
    /// out : (n,) ndarray of float64, optional
    ///     Where to write the estimate: it is returned, and nothing is allocated.
    ///
    /// Raises
    /// ------
    /// HgoError
    ///     An infinite sample, an input that is not finite, dt not positive or at or above the
    ///     stability limit (`allow_unstable=True` in the constructor to study it); a model without a
    ///     value; an estimate that would diverge; an `out` that cannot take the estimate: the sample
    ///     is not taken.
    #[pyo3(signature = (y, u=None, *, dt, out=None))]
    fn step<'py>(
        slf: &Bound<'py, Self>,
        y: &Bound<'py, PyAny>,
        u: Option<&Bound<'py, PyAny>>,
        dt: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> Result<Bound<'py, PyArray1<f64>>> {
        call(slf, Verb::Step, Some(y), u, Some(dt), out)
    }

    /// Take the sample of now; return the estimate x_hat(k|k), (n,). Current timing only.
    ///
    /// The correction is for the time that has passed since the last sample used; for none, as at the
    /// start, it changes nothing.
    ///
    /// Parameters
    /// ----------
    /// y : float or (n_y,)
    ///     Sample; None or NaN: missing, nothing is corrected.
    /// out : (n,) ndarray of float64, optional
    ///     Where to write the estimate: it is returned, and nothing is allocated.
    ///
    /// Raises
    /// ------
    /// HgoError
    ///     An observer with predictor timing; an infinite sample; an estimate that would diverge.
    #[pyo3(signature = (y, *, out=None))]
    fn correct<'py>(
        slf: &Bound<'py, Self>,
        y: &Bound<'py, PyAny>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> Result<Bound<'py, PyArray1<f64>>> {
        call(slf, Verb::Correct, Some(y), None, None, out)
    }

    /// Move over the period that begins; return the estimate at its end, (n,). Current timing only.
    ///
    /// Parameters
    /// ----------
    /// u : float or (n_u,), optional
    ///     Input that is applied from now on, held over the period.
    /// dt : float
    ///     Length of the period [s].
    /// out : (n,) ndarray of float64, optional
    ///     Where to write the estimate: it is returned, and nothing is allocated.
    ///
    /// Raises
    /// ------
    /// HgoError
    ///     An observer with predictor timing; an input that is not finite; dt not positive, or at or
    ///     above the stability limit; a model without a value; an estimate that would diverge.
    #[pyo3(signature = (u=None, dt=None, *, out=None))]
    fn predict<'py>(
        slf: &Bound<'py, Self>,
        u: Option<&Bound<'py, PyAny>>,
        dt: Option<&Bound<'py, PyAny>>,
        out: Option<&Bound<'py, PyAny>>,
    ) -> Result<Bound<'py, PyArray1<f64>>> {
        let missing = || refused("dt is missing: predict(u, dt) takes the period's length [s]");
        call(slf, Verb::Predict, None, u, Some(dt.ok_or_else(missing)?), out)
    }
}

/// The verbs' common way: every question to Python first, then the step.
fn call<'py>(
    slf: &Bound<'py, Online>,
    verb: Verb,
    y: Option<&Bound<'py, PyAny>>,
    u: Option<&Bound<'py, PyAny>>,
    dt: Option<&Bound<'py, PyAny>>,
    out: Option<&Bound<'py, PyAny>>,
) -> Result<Bound<'py, PyArray1<f64>>> {
    let py = slf.py();
    let (n, n_y, n_u, stable_dt, started) = {
        let me = slf.try_borrow()?;
        let law = me.law(py)?.law();
        if verb != Verb::Step && !law.is_current() {
            return Err(refused(
                "correct and predict are not allowed with timing = 'predictor', whose recursion takes \
                 sample and input at once: use step, or, where the law takes a timing, make the \
                 observer with timing='current'",
            ));
        }
        (law.n(), law.n_y(), law.n_u(), me.stable_dt, me.started || me.clock.time() > 0.0)
    };
    if let Some(out) = out
        && place(out, n).is_none()
    {
        return Err(PyErr::from_value(slf.call_method1("_no_place", (out,))?).into());
    }
    let none = py.None();
    let none = none.bind(py);
    let dt = match dt.map(|dt| (dt, dt.cast::<PyFloat>())) {
        None => 0.0,
        Some((_, Ok(dt))) if 0.0 < dt.value() && dt.value() <= stable_dt => dt.value(),
        Some((given, _)) => {
            let dt: f64 = slf.call_method1(intern!(py, "_checked_dt"), (given,))?.extract()?;
            if !(dt > 0.0 && dt.is_finite()) {
                return Err(refused(&format!("dt = {dt} is not allowed: > 0")));
            }
            slf.try_borrow_mut()?.stable_dt = stable_dt.max(dt);
            dt
        }
    };
    let (mut sample, mut input) = ([f64::NAN; CHAINS], [0.0; MAX_INPUTS]);
    let (Some(sample), Some(input)) = (sample.get_mut(..n_y), input.get_mut(..n_u)) else {
        return Err(refused(&format!("{n_y} outputs and {n_u} inputs are more than a step takes")));
    };
    if let Some(y) = y {
        let sampled = y.is_none() || (read(y, sample) && !sample.iter().any(|y| y.is_infinite()));
        if !sampled {
            ask(slf, intern!(py, "_checked_sample"), y, sample)?;
        }
    }
    if verb != Verb::Correct {
        let u = u.unwrap_or(none);
        let told = if n_u == 0 {
            u.is_none()
        } else {
            read(u, input) && input.iter().all(|u| u.is_finite())
        };
        if !told {
            ask(slf, intern!(py, "_checked_input"), u, input)?;
        }
    }
    if !started {
        slf.call_method1(intern!(py, "_check_start"), (slf.getattr("memory")?,))?;
    }
    let mut me = slf.try_borrow_mut()?;
    let outcome = me.take(py, &Asked { verb, y: sample, u: input, dt })?;
    if let Outcome::Taken = outcome {
        let x_hat = me.memory.get(..n).unwrap_or(&[]);
        let Some(out) = out else { return Ok(PyArray1::from_slice(py, x_hat)) };
        let given = place(out, n).ok_or_else(|| {
            refused(
                "out was made another array during the call: the sample was taken, x_hat holds the \
                 estimate",
            )
        })?;
        write(given, x_hat)?;
        return Ok(given.clone());
    }
    drop(me);
    let error = match outcome {
        Outcome::Undefined => {
            slf.call_method1(intern!(py, "_no_value"), (sample.to_vec(), input.to_vec()))?
        }
        _ => slf.call_method0(intern!(py, "_divergence"))?,
    };
    Err(PyErr::from_value(error).into())
}

/// Numbers by one of Python's checks, which refuses what is wrong.
fn ask<'py>(
    slf: &Bound<'py, Online>,
    check: &Bound<'py, PyString>,
    value: &Bound<'py, PyAny>,
    into: &mut [f64],
) -> Result<()> {
    let checked = slf.call_method1(check, (value,))?;
    if read(&checked, into) || into.is_empty() {
        return Ok(());
    }
    Err(refused(&format!("{check} gave {checked}, not {} numbers", into.len())))
}

/// `out` if n numbers can be written there. Asked again after calls to Python, which may change it.
fn place<'a, 'py>(out: &'a Bound<'py, PyAny>, n: usize) -> Option<&'a Bound<'py, PyArray1<f64>>> {
    const WANTED: i32 = NPY_ARRAY_C_CONTIGUOUS | NPY_ARRAY_ALIGNED | NPY_ARRAY_WRITEABLE;
    let array = out.cast::<PyArray1<f64>>().ok()?;
    // SAFETY: a Bound array is alive, and this thread is attached to the interpreter
    #[allow(unsafe_code)] // the crate numpy has no name for these flags together
    let flags = unsafe { (*_PyArray_GET_ITEM_DATA(array.as_array_ptr())).flags };
    (flags & WANTED == WANTED && array.len() == n).then_some(array)
}

/// Write to an array that `place` let through.
#[allow(unsafe_code)] // the safe way registers the array, which allocates
fn write(array: &Bound<'_, PyArray1<f64>>, values: &[f64]) -> Result<()> {
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
