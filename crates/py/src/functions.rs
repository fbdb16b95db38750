//! Floor 6. The functions of `hgo_rs._core`.

use crate::errors::{Result, refused};
use crate::interrupt::interruptible;
use crate::values::{matrix, numbers, read_dict};
use hgo_ir::Spec;
use hgo_ir::study::exact;
use hgo_rs::noise::{Channel, SecondOrderSections, Stream};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Coarse and fine paths of a stochastic plant on the same Brownian motion.
#[pyfunction]
pub fn coupled_paths<'py>(py: Python<'py>, spec: &Bound<'py, PyAny>) -> Result<Bound<'py, PyDict>> {
    let value = read_dict(spec, "coupled paths")?;
    let spec = Spec::new(&value, "coupled paths")?;
    let pairs = interruptible(py, |stop| Ok(exact::coupled_paths(&spec, &|| stop.is_set())?))?;
    let out = PyDict::new(py);
    for (name, of) in [("coarse", 0), ("fine", 1)] {
        let ends = pairs.iter().flat_map(|pair| pair[of]).collect();
        out.set_item(name, matrix(py, ends, pairs.len())?)?;
    }
    Ok(out)
}

/// Exact RMS error of a linear standard observer of order 2 under forward Euler and white noise.
///
/// The spec is that of [`simulate`](crate::study::simulate); `variance`, if given, stands for the noise's.
#[pyfunction]
pub fn mean_covariance<'py>(
    py: Python<'py>,
    spec: &Bound<'py, PyAny>,
) -> Result<Bound<'py, PyDict>> {
    let value = read_dict(spec, "covariance")?;
    let spec = Spec::new(&value, "covariance")?;
    let exact::Covariances { rms, windows, last } =
        interruptible(py, |stop| Ok(exact::covariances(&spec, &|| stop.is_set())?))?;
    let out = PyDict::new(py);
    out.set_item("rms", matrix(py, rms, windows)?)?;
    let rows = last.len();
    out.set_item("final_covariance", matrix(py, last.concat(), rows)?)?;
    Ok(out)
}

/// `count` raw values of a stream: "bits", "uniform" or "normal".
#[pyfunction]
#[pyo3(signature = (kind, count, seed, run=0, channel=0))]
pub fn random<'py>(
    py: Python<'py>,
    kind: &str,
    count: usize,
    seed: u64,
    run: u64,
    channel: u64,
) -> Result<Bound<'py, PyAny>> {
    let channel = match channel {
        0 => Channel::Measurement,
        1 => Channel::Process,
        other => return Err(refused(&format!("channel = {other} is not allowed: 0 or 1"))),
    };
    let mut stream = Stream::new(seed, run, channel);
    let mut values = |of: fn(&mut Stream) -> f64| -> Bound<'py, PyArray1<f64>> {
        (0..count).map(|_| of(&mut stream)).collect::<Vec<_>>().into_pyarray(py)
    };
    match kind {
        "uniform" => Ok(values(Stream::uniform).into_any()),
        "normal" => Ok(values(Stream::normal).into_any()),
        "bits" => {
            let bits: Vec<u64> = (0..count).map(|_| stream.next_u64()).collect();
            Ok(bits.into_pyarray(py).into_any())
        }
        other => Err(refused(&format!("kind = {other:?} is not known; bits, uniform or normal"))),
    }
}

/// A sequence coloured by second-order sections (rows b0, b1, b2, a0 = 1, a1, a2, as SciPy's).
#[pyfunction]
pub fn filtered<'py>(
    py: Python<'py>,
    values: &Bound<'py, PyAny>,
    sections: &Bound<'py, PyAny>,
) -> Result<Bound<'py, PyArray1<f64>>> {
    let mut signal = numbers(values)?.values;
    let rows = numbers(sections)?;
    if rows.shape.get(1) != Some(&6) {
        let message = format!("sections have shape {:?}; they must be (S, 6)", rows.shape);
        return Err(refused(&message));
    }
    for row in rows.values.chunks_exact(6) {
        if (row[3] - 1.0).abs() > 0.0 {
            return Err(refused("sections must have a0 = 1 in column 3"));
        }
        let mut section = SecondOrderSections::new([[row[0], row[1], row[2], row[4], row[5]]]);
        for value in &mut signal {
            *value = section.filter(*value);
        }
    }
    Ok(signal.into_pyarray(py))
}

/// The source of elementary functions and of what they need, in "c" (called `prefix_name`), "rust" or "llvm"
/// (of `lanes` numbers side by side): the core's own, operation by operation.
#[pyfunction]
#[pyo3(signature = (language, precision, names, prefix="hgo", lanes=1))]
#[allow(clippy::needless_pass_by_value)]
pub fn elementary_source(
    language: &str,
    precision: &str,
    names: Vec<String>,
    prefix: &str,
    lanes: usize,
) -> Result<String> {
    Ok(hgo_ir::elementary::source(language, precision, &names, prefix, lanes)?)
}
