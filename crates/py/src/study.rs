//! Floor 3. Studies: a spec in, arrays out.

use crate::errors::Result;
use crate::interrupt::interruptible;
use crate::kernel::StudyKernel;
use crate::values::{matrix, read_dict};
use hgo_ir::Spec;
use hgo_ir::study::{Kernel, Study, StudyResult};
use hgo_rs::metrics::{LogHistogram, Moments};
use numpy::{IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Run an experiment described by a spec, by the interpreter or by a kernel of its own source.
#[pyfunction]
#[pyo3(signature = (spec, kernel=None))]
pub fn simulate<'py>(
    py: Python<'py>,
    spec: &Bound<'py, PyAny>,
    kernel: Option<&Bound<'py, StudyKernel>>,
) -> Result<Bound<'py, PyDict>> {
    let value = read_dict(spec, "simulation")?;
    let study = Study::read(&Spec::new(&value, "simulation")?)?;
    let kernel = kernel.map(|kernel| kernel.get() as &dyn Kernel);
    let result = interruptible(py, |stop| Ok(study.run(kernel, &|| stop.is_set())?))?;
    as_dict(py, &study, result)
}

/// Whether a kernel gives the interpreter's bits, over the first samples of a study's first runs.
#[pyfunction]
pub fn kernel_agrees(
    py: Python<'_>,
    spec: &Bound<'_, PyAny>,
    kernel: &Bound<'_, StudyKernel>,
) -> Result<bool> {
    let value = read_dict(spec, "simulation")?;
    let mut study = Study::read(&Spec::new(&value, "simulation")?)?;
    let kernel = kernel.get();
    Ok(py.detach(|| study.agrees(kernel))?)
}

/// The index of a sample, or -1.
fn index(k: Option<u64>) -> i64 {
    k.and_then(|k| i64::try_from(k).ok()).unwrap_or(-1)
}

/// What the runs gave, as a dict of arrays.
fn as_dict<'py>(py: Python<'py>, study: &Study, result: StudyResult) -> Result<Bound<'py, PyDict>> {
    let (out, plan) = (PyDict::new(py), &study.plan);
    let StudyResult { runs, signals, counts, frames } = result;
    let rows = runs.len();
    let shared: &[&str] = if study.plants_are_shared { &["plant"] } else { &[] };
    out.set_item("shared", shared)?;
    let layout = &study.layout;
    let watches = layout.watched > 0;
    let [mean, rms, max] = layout.kinds;
    for (key, wanted, of) in [
        ("mean", mean, Moments::mean as fn(&Moments<f64>) -> f64),
        ("rms", rms, Moments::rms),
        ("max", max, Moments::max),
    ] {
        if wanted {
            let moments = runs.iter().flat_map(|run| run.moments.chunks(signals.max(1)));
            let [mut of_errors, mut of_watched] = [const { Vec::new() }; 2];
            for row in moments {
                let (errors, watched) = row.split_at(layout.errors.min(row.len()));
                of_errors.extend(errors.iter().map(of));
                of_watched.extend(watched.iter().map(of));
            }
            let windows = plan.windows.len();
            let errors = of_errors.into_pyarray(py).reshape([rows, windows, layout.errors])?;
            out.set_item(key, errors)?;
            if watches {
                let shape = [rows, windows, layout.watched];
                let watched = of_watched.into_pyarray(py).reshape(shape)?;
                out.set_item(format!("signal_{key}"), watched)?;
            }
        }
    }
    let flat = |of: fn(&hgo_ir::study::RunResult) -> &[f64]| -> Vec<f64> {
        runs.iter().flat_map(|run| of(run).iter().copied()).collect()
    };
    if layout.peaks {
        let of = |from: usize, to: usize| {
            runs.iter().flat_map(|run| run.peak[from..to].to_vec()).collect()
        };
        out.set_item("peak", matrix(py, of(0, layout.errors), rows)?)?;
        if watches {
            out.set_item("signal_peak", matrix(py, of(layout.errors, signals), rows)?)?;
        }
    }
    if watches {
        out.set_item("signal_settling_time", matrix(py, flat(|run| &run.settled), rows)?)?;
    }
    out.set_item("final_x", matrix(py, flat(|run| &run.final_x), rows)?)?;
    out.set_item("final_memory", matrix(py, flat(|run| &run.final_memory), rows)?)?;
    let settling: Vec<f64> = runs.iter().map(|run| run.settling_time).collect();
    out.set_item("settling_time", settling.into_pyarray(py))?;
    let diverged: Vec<i64> = runs.iter().map(|run| index(run.diverged_at)).collect();
    out.set_item("diverged_at", diverged.into_pyarray(py))?;
    let undefined: Vec<i64> = runs.iter().map(|run| index(run.undefined_at)).collect();
    out.set_item("undefined_at", undefined.into_pyarray(py))?;
    if plan.histogram.is_some() {
        let counts: Vec<i64> =
            counts.iter().map(|count| i64::try_from(*count).unwrap_or(i64::MAX)).collect();
        let edges: Vec<f64> = (0..=LogHistogram::BINS).map(LogHistogram::edge).collect();
        let histogram = PyDict::new(py);
        histogram.set_item("edges", edges.into_pyarray(py))?;
        histogram.set_item("counts", counts.into_pyarray(py))?;
        out.set_item("histogram", histogram)?;
    }
    if plan.every > 0 {
        let length = frames.t.len();
        out.set_item("t", frames.t.into_pyarray(py))?;
        let parts = ["x", "memory", "y"].into_iter().zip(frames.values).zip(frames.widths);
        for ((key, values), width) in parts {
            out.set_item(key, values.into_pyarray(py).reshape([rows, length, width])?)?;
        }
    }
    Ok(out)
}
