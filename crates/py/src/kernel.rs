//! Floor 2. Kernels: studies and records that LLVM has compiled, called by their addresses.

use crate::errors::{Result, refused};
use crate::values::read_dict;
use hgo_ir::Spec;
use hgo_ir::llvm::{SUMS, record_source as source_of};
use hgo_ir::record::{self, Stretch};
use hgo_ir::recursion::{AnyObserver, Widths};
use hgo_ir::study::{Block, Kernel, LANES, Layout, Span, Study};
use hgo_rs::program::Lane;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// A compiled span: columns, the plants' shared state, random streams of measurement and process, the
/// rows of the samples, recorded noise, what a frame shows, sums of squares of all states, distances; and how
/// many samples there are.
type Function = unsafe extern "C" fn(
    *mut f64,
    *mut f64,
    *mut u64,
    *mut u64,
    *const f64,
    *const f64,
    *mut f64,
    *mut f64,
    *mut f64,
    u64,
);

/// The functions of a study's source, compiled.
#[pyclass(frozen, module = "hgo_rs._core")]
pub struct StudyKernel {
    /// Runs that a call moves.
    runs: usize,
    /// For each number of open windows, with and without distances, its function.
    functions: Vec<(usize, bool, Function)>,
}

#[pymethods]
impl StudyKernel {
    /// From runs that a call moves, and for each form (open windows, distances, address). The addresses
    /// must be those of functions compiled from [`study_source`], which live as long as this does.
    #[new]
    fn new(runs: usize, forms: Vec<(usize, bool, usize)>) -> Result<Self> {
        if runs == 0 || !LANES.is_multiple_of(runs) || forms.iter().any(|(.., at)| *at == 0) {
            return Err(refused("a kernel needs functions, for a part of a block of runs"));
        }
        let function = |(open, distances, address): (usize, bool, usize)| {
            // SAFETY: the caller says that a function of this type stands there.
            #[allow(unsafe_code)]
            let function = unsafe { std::mem::transmute::<usize, Function>(address) };
            (open, distances, function)
        };
        Ok(Self { runs, functions: forms.into_iter().map(function).collect() })
    }
}

impl Kernel for StudyKernel {
    fn span(&self, _: &Layout, block: &mut Block<LANES>, span: &Span<'_, LANES>) -> bool {
        let form = |(open, distances, _): &&(usize, bool, Function)| {
            (*open, *distances) == (span.open, span.distances)
        };
        let Some((.., function)) = self.functions.iter().find(form) else { return false };
        let shared = block.shared.clone();
        let mut squares = [Lane([0.0; LANES]); SUMS];
        for first in (0..LANES).step_by(self.runs) {
            block.shared.copy_from_slice(&shared);
            let [measurement, process] = &mut block.streams;
            // SAFETY: a lane is an array of numbers, and so are lanes one after the other; the function
            // moves `runs` of them from the first on, within what its source says these hold.
            #[allow(unsafe_code)]
            unsafe {
                function(
                    block.columns.as_mut_ptr().cast::<f64>().add(first),
                    block.shared.as_mut_ptr(),
                    measurement.as_mut_ptr().cast::<u64>().add(first),
                    process.as_mut_ptr().cast::<u64>().add(first),
                    span.instants.as_ptr().cast::<f64>(),
                    span.recorded.as_ptr().cast::<f64>().wrapping_add(first),
                    block.shown.as_mut_ptr().cast::<f64>().wrapping_add(first),
                    squares.as_mut_ptr().cast::<f64>().add(first),
                    block.distances.as_mut_ptr().cast::<f64>().wrapping_add(first),
                    span.instants.len() as u64,
                );
            }
        }
        for (lane, worst) in block.worst.0.iter_mut().enumerate() {
            *worst = squares.iter().map(|squares| squares.0[lane]).sum::<f64>().sqrt();
        }
        true
    }
}

/// A study as LLVM IR, for vectors of `lanes` runs, `copies` of them side by side (0: as suits it and registers
/// of `lanes` numbers):
/// a dict of `text`, `forms` (open windows, distances, name), `runs` that a call moves, and `operations`
/// of a sample; None where functions of the user's are called.
#[pyfunction]
#[pyo3(signature = (spec, lanes, copies=0))]
pub fn study_source<'py>(
    py: Python<'py>,
    spec: &Bound<'py, PyAny>,
    lanes: usize,
    copies: usize,
) -> Result<Option<Bound<'py, PyDict>>> {
    let value = read_dict(spec, "simulation")?;
    let study = Study::read(&Spec::new(&value, "simulation")?)?;
    let (lanes, copies) = if copies == 0 { study.shape(lanes) } else { (lanes, copies) };
    let Some(source) = study.kernel(lanes, copies) else { return Ok(None) };
    let out = PyDict::new(py);
    out.set_item("text", source.text)?;
    out.set_item("forms", source.names)?;
    out.set_item("runs", lanes * copies)?;
    out.set_item("width", study.tables.width())?;
    out.set_item("operations", study.tables.operations(study.plan.substeps))?;
    Ok(Some(out))
}

/// A compiled record: memory, times, samples, inputs, what stands still, rows, innovations, the step's
/// length, and how many samples there are; gives how many were taken.
type Steps = unsafe extern "C" fn(
    *mut f64,
    *const f64,
    *const f64,
    *const f64,
    *const f64,
    *mut f64,
    *mut f64,
    f64,
    u64,
) -> u64;

/// The function of a record's source, compiled.
#[pyclass(frozen, module = "hgo_rs._core")]
pub struct RecordKernel {
    function: Steps,
    /// Numbers of a row: memory, sample, input, and what stands still.
    widths: [usize; 4],
}

#[pymethods]
impl RecordKernel {
    /// From the address of the function compiled from an observer's source, which lives as long as this
    /// does, and the numbers of its rows.
    #[new]
    fn new(address: usize, widths: [usize; 4]) -> Result<Self> {
        if address == 0 {
            return Err(refused("a kernel needs a function"));
        }
        // SAFETY: the caller says that a function of this type stands there.
        #[allow(unsafe_code)]
        let function = unsafe { std::mem::transmute::<usize, Steps>(address) };
        Ok(Self { function, widths })
    }
}

impl RecordKernel {
    /// Whether it was compiled for rows as this observer's.
    pub fn suits(&self, observer: &dyn AnyObserver) -> bool {
        observer.tabled().is_some_and(|tabled| widths(tabled.widths()) == self.widths)
    }
}

fn widths(of: Widths) -> [usize; 4] {
    [of.memory, of.n_y, of.n_u, of.fixed]
}

impl record::RecordKernel for RecordKernel {
    fn steps(&self, stretch: Stretch<'_>) -> usize {
        let Stretch { memory, t, dt, y, u, fixed, rows, innovation } = stretch;
        let [m, n_y, n_u, still] = self.widths;
        let n = t.len();
        let fits = memory.len() >= m && fixed.len() >= still && y.len() >= n * n_y;
        let room = u.len() >= n * n_u && rows.len() >= n * m && innovation.len() >= n * n_y;
        if n == 0 || !fits || !room {
            return 0;
        }
        // SAFETY: the function reads and writes n rows of these widths, which are there.
        #[allow(unsafe_code)]
        let taken = unsafe {
            (self.function)(
                memory.as_mut_ptr(),
                t.as_ptr(),
                y.as_ptr(),
                u.as_ptr(),
                fixed.as_ptr(),
                rows.as_mut_ptr(),
                innovation.as_mut_ptr(),
                dt,
                n as u64,
            )
        };
        usize::try_from(taken).unwrap_or(0)
    }
}

/// An observer over a record as LLVM IR: a dict of `text`, `name`, `operations` of a sample and `widths` of
/// its rows; None where functions of the user's are called.
pub fn record_source<'py>(
    py: Python<'py>,
    observer: &dyn AnyObserver,
) -> Result<Option<Bound<'py, PyDict>>> {
    let Some(tabled) = observer.tabled() else { return Ok(None) };
    let Some(source) = source_of(tabled) else { return Ok(None) };
    let out = PyDict::new(py);
    out.set_item("text", source.text)?;
    out.set_item("name", source.name)?;
    out.set_item("operations", source.operations)?;
    out.set_item("widths", widths(tabled.widths()))?;
    Ok(Some(out))
}
