//! Floor 6. The functions of `hgo_rs._core`.

use crate::errors::{Result, refused};
use crate::interrupt::interruptible;
use crate::values::{matrix, numbers, read_dict};
use hgo_ir::Spec;
use hgo_ir::study::{Plan, STOCHASTIC_METHODS, stochastic};
use hgo_ir::systems::AnyPlant;
use hgo_rs::covariance::ErrorCovariance;
use hgo_rs::gain::ConstantGain;
use hgo_rs::memory::Memory;
use hgo_rs::metrics::Moments;
use hgo_rs::model::{Plant, StochasticIntegrator, Unknown};
use hgo_rs::noise::{Channel, Draw, Noise, SecondOrderSections, Stream};
use hgo_rs::observer::{Discretised, Euler};
use hgo_rs::observers::StandardObserver;
use hgo_rs::simulate::{Experiment, coupled_paths as coupled_paths_of};
use nalgebra::Vector2;
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;

/// Coarse and fine paths of a stochastic plant on the same Brownian motion.
#[pyfunction]
pub fn coupled_paths<'py>(py: Python<'py>, spec: &Bound<'py, PyAny>) -> Result<Bound<'py, PyDict>> {
    let value = read_dict(spec, "coupled paths")?;
    let spec = Spec::new(&value, "coupled paths")?;
    spec.only(&["plant", "x0", "t_end", "coarse", "fine", "method", "runs", "seed", "first_run"])?;
    let AnyPlant::VanDerPol(plant) = AnyPlant::<f64>::read(&spec.sub("plant")?)? else {
        return Err(refused("plant must have process noise: choose van-der-pol"));
    };
    let runs = if spec.has("runs") { spec.count("runs")? } else { 1 };
    let x0 = spec.rows("x0", 2, runs)?;
    let t_end = hgo_rs::error::positive("t_end", spec.f64("t_end")?)?;
    let count = |key: &str| -> Result<u32> {
        let value = spec.whole(key)?;
        u32::try_from(value)
            .ok()
            .filter(|n| *n >= 1)
            .ok_or_else(|| refused(&format!("{key} = {value} is not allowed: 1 to 4294967295")))
    };
    let (coarse, fine) = (count("coarse")?, count("fine")?);
    let method = spec.text("method")?;
    let scheme = stochastic(&method)
        .filter(|scheme| Plant::<f64>::supports(&plant, *scheme))
        .ok_or_else(|| spec.unknown("method", &method, &STOCHASTIC_METHODS))?;
    let finest = if Plant::<f64>::supports(&plant, StochasticIntegrator::Taylor15) {
        StochasticIntegrator::Taylor15
    } else {
        StochasticIntegrator::Milstein
    };
    let (seed, first) = (spec.whole_or("seed", 0)?, spec.whole_or("first_run", 0)?);
    let pairs: Vec<_> = interruptible(py, |stop| {
        let pair = |run: usize| {
            let start = Vector2::read(if x0.len() == 2 { &x0 } else { &x0[2 * run..] });
            let mut stream = Stream::new(seed, first.wrapping_add(run as u64), Channel::Process);
            let (steps, stop) = ((coarse, fine), || stop.is_set());
            coupled_paths_of(&plant, scheme, finest, start, t_end, steps, &mut stream, stop)
        };
        Ok((0..runs).into_par_iter().map(pair).collect())
    })?;
    let out = PyDict::new(py);
    let coarse_end = pairs.iter().flat_map(|(a, _)| [a.x, a.y]).collect();
    let fine_end = pairs.iter().flat_map(|(_, b)| [b.x, b.y]).collect();
    out.set_item("coarse", matrix(py, coarse_end, runs)?)?;
    out.set_item("fine", matrix(py, fine_end, runs)?)?;
    Ok(out)
}

/// Exact RMS error of a linear standard observer of order 2 under forward Euler and white noise.
///
/// The spec is that of [`simulate`]; `variance`, if given, stands for the noise's.
#[pyfunction]
pub fn mean_covariance<'py>(
    py: Python<'py>,
    spec: &Bound<'py, PyAny>,
) -> Result<Bound<'py, PyDict>> {
    const N: usize = 2;
    let value = read_dict(spec, "covariance")?;
    let spec = Spec::new(&value, "covariance")?;
    let observer_spec = spec.sub("observer")?;
    let (k, gain) = (observer_spec.vector::<N>("k", N)?, observer_spec.sub("gain")?);
    let linear = observer_spec.text("kind")? == "standard"
        && gain.text("law")? == "constant"
        && observer_spec.sub("model")?.text("kind")? == "none"
        && observer_spec.text_or("method", "euler")? == "euler";
    if !linear {
        return Err(refused(
            "observer must be linear: kind standard, constant gain, model none, method euler",
        ));
    }
    let ell = gain.f64("ell")?;
    let plan = Plan::read(&spec, &["variance"])?.starting(&spec, (N, N))?;
    let variance = match (spec.get("variance"), plan.noise_variance()) {
        (Some(_), _) => hgo_rs::error::positive("variance", spec.f64("variance")?)?,
        (None, Some(variance)) => variance,
        (None, None) => {
            return Err(refused(
                "give variance, or uniform or normal noise without hold, sines or mean",
            ));
        }
    };
    let AnyPlant::Lee(plant) = AnyPlant::<f64>::read(&spec.sub("plant")?)? else {
        return Err(refused("plant must be without process noise: choose lee"));
    };
    let law: StandardObserver<f64, _, _, N, 0> =
        StandardObserver::new(k, ConstantGain::new(ell)?, Unknown)?;
    let (moments, covariance) = interruptible(py, |stop| {
        let mut moments = vec![Moments::default(); plan.windows.len() * N];
        let experiment = Experiment {
            plant,
            plant_scheme: plan.plant_scheme,
            substeps: plan.substeps,
            schedule: plan.schedule,
            plant_schedule: plan.plant_schedule,
            noise: Noise { draw: Draw::None, hold: 1, sines: &[] },
            steps: plan.steps,
            seed: 0,
        };
        experiment.check()?;
        let mut probe = ErrorCovariance::new(
            plan.schedule,
            [k[0] * ell, k[1] * ell * ell],
            variance,
            &plan.windows,
            &mut moments,
            || stop.is_set(),
        );
        let (x0, z0) = (Memory::read(&plan.x0), Memory::read(&plan.memory0));
        let observer = Discretised { law, scheme: Euler };
        experiment.sampled(&observer, |u| *u, 0, x0, z0, &mut probe);
        let covariance = probe.covariance;
        Ok((moments, covariance))
    })?;
    let out = PyDict::new(py);
    let rms: Vec<f64> = moments.iter().map(Moments::rms).collect();
    out.set_item("rms", matrix(py, rms, plan.windows.len())?)?;
    out.set_item("final_covariance", matrix(py, covariance.as_slice().to_vec(), N)?)?;
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
