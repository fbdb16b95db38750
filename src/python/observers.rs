//! From a spec to an observer of the core, and the class `Observer` that Python steps and runs.

use super::design::order_refused;
use super::errors::refused;
use super::interrupt::{StopFlag, interruptible};
use super::spec::{Spec, matrix, numbers};
use super::study::{self, Plan, StudyResult};
use super::systems::{AnyModel, read_ship, read_van_der_pol};
use crate::dispatch_order;
use crate::gain::{AdaptiveGain, ConstantGain, DeadZoneGain, GainLaw};
use crate::integrate::Integrator;
use crate::memory::Memory;
use crate::models::Correction;
use crate::observer::{
    Discretisation, Discretised, Hold, Observer as CoreObserver, RungeKutta, Status, Timing,
};
use crate::observers::{
    HardClip, LowPower, ModifiedObserver, NoSaturation, ReducedOrderObserver, RepelledCollection,
    SampledDataObserver, Saturation, SmoothSaturation, StandardObserver,
};
use nalgebra::SVector;
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// The adaptive and the dead-zone law behind one memory r.
#[derive(Clone, Copy)]
pub enum MovingGain {
    Adaptive(AdaptiveGain<f64>),
    DeadZone(DeadZoneGain<f64>),
}

impl GainLaw<f64> for MovingGain {
    type Memory = f64;
    #[inline(always)]
    fn initial(&self) -> f64 {
        1.0
    }
    #[inline(always)]
    fn fixed(&self) -> f64 {
        1.0
    }
    #[inline(always)]
    fn moving(&self, r: &f64) -> f64 {
        *r
    }
    #[inline(always)]
    fn rate<const N: usize>(&self, r: &f64, e: f64) -> f64 {
        match self {
            Self::Adaptive(law) => law.rate::<N>(r, e),
            Self::DeadZone(law) => law.rate::<N>(r, e),
        }
    }
    #[inline(always)]
    fn admissible(&self, r: f64) -> f64 {
        match self {
            Self::Adaptive(law) => law.admissible(r),
            Self::DeadZone(law) => law.admissible(r),
        }
    }
}

enum AnyGain {
    Constant(ConstantGain<f64>),
    Moving(MovingGain),
}

impl AnyGain {
    fn read(spec: &Spec<'_>) -> PyResult<Self> {
        let law = spec.text("law")?;
        if law == "constant" {
            spec.only(&["law", "ell"])?;
            return Ok(Self::Constant(ConstantGain::new(spec.f64("ell")?)?));
        }
        let moving = ["law", "p1", "p2", "b"];
        let of = |key| spec.f64(key);
        match law.as_str() {
            "adaptive" => {
                spec.only(&moving)?;
                let law = AdaptiveGain::new(of("p1")?, of("p2")?, of("b")?)?;
                Ok(Self::Moving(MovingGain::Adaptive(law)))
            }
            "dead-zone" => {
                spec.only(&moving)?;
                let law = DeadZoneGain::new(of("p1")?, of("p2")?, of("b")?)?;
                Ok(Self::Moving(MovingGain::DeadZone(law)))
            }
            other => Err(spec.unknown("law", other, &["constant", "adaptive", "dead-zone"])),
        }
    }
}

#[derive(Clone, Copy)]
pub enum AnySaturation<const N: usize> {
    None,
    Hard(HardClip<f64, N>),
    Smooth(SmoothSaturation<f64, N>),
}

impl<const N: usize> Saturation<f64> for AnySaturation<N> {
    #[inline(always)]
    fn apply(&self, i: usize, eta: f64) -> f64 {
        match self {
            Self::None => NoSaturation.apply(i, eta),
            Self::Hard(clip) => clip.apply(i, eta),
            Self::Smooth(smooth) => smooth.apply(i, eta),
        }
    }
}

const METHODS: [&str; 5] =
    ["euler", "staggered-euler", "rk4", "rk4-innovation-held", "bogacki-shampine"];

fn read_method(spec: &Spec<'_>) -> PyResult<Discretisation> {
    let held = |integrator, hold| Discretisation::RungeKutta(RungeKutta { integrator, hold });
    let method = spec.text_or("method", "euler")?;
    Ok(match method.as_str() {
        "euler" => Discretisation::Euler,
        "staggered-euler" => Discretisation::StaggeredEuler,
        "rk4" => held(Integrator::Rk4, Hold::Measurement),
        "rk4-innovation-held" => held(Integrator::Rk4, Hold::Innovation),
        "bogacki-shampine" => held(Integrator::BogackiShampine, Hold::Measurement),
        other => return Err(spec.unknown("method", other, &METHODS)),
    })
}

/// A record to run over: one row a sample.
pub struct Record {
    pub t: Vec<f64>,
    pub y: Vec<f64>,
    pub u: Vec<f64>,
}

/// What a run over a record gives, one row a sample.
#[derive(Default)]
pub struct Track {
    pub memory: Vec<f64>,
    pub innovation: Vec<f64>,
    pub status: Vec<u8>,
}

/// Any observer, with its memory as a flat vector.
pub trait AnyObserver: Send + Sync {
    fn n(&self) -> usize;
    fn n_y(&self) -> usize;
    fn n_u(&self) -> usize;
    fn is_current(&self) -> bool;
    fn initial(&self) -> Vec<f64>;
    fn step(&self, memory: &mut [f64], y: &[f64], u: &[f64], t: f64, dt: f64) -> Status;
    fn run(&self, record: &Record, memory0: &[f64], stop: &StopFlag) -> Track;
    fn study(&self, plan: &Plan, stop: &StopFlag) -> PyResult<StudyResult>;
}

type Study<O> = fn(&O, &Plan, &StopFlag) -> PyResult<StudyResult>;

struct Boxed<O> {
    observer: O,
    n: usize,
    n_u: usize,
    study: Study<O>,
}

impl<O> AnyObserver for Boxed<O>
where
    O: CoreObserver<f64> + Send + Sync,
    O::Measurement: Memory<f64>,
    O::Input: Memory<f64>,
{
    fn n(&self) -> usize {
        self.n
    }
    fn n_y(&self) -> usize {
        O::Measurement::LEN
    }
    fn n_u(&self) -> usize {
        self.n_u
    }
    fn is_current(&self) -> bool {
        O::TIMING == Timing::Current
    }
    fn initial(&self) -> Vec<f64> {
        let mut memory = vec![0.0; O::State::LEN];
        self.observer.initial().write(&mut memory);
        memory
    }
    fn step(&self, memory: &mut [f64], y: &[f64], u: &[f64], t: f64, dt: f64) -> Status {
        let mut z = O::State::read(memory);
        let (y, u) = (O::Measurement::read(y), O::Input::read(u));
        let status = self.observer.step(&mut z, &y, &u, t, dt);
        z.write(memory);
        status
    }
    fn run(&self, record: &Record, memory0: &[f64], stop: &StopFlag) -> Track {
        let samples = record.t.len();
        let (m, p, q) = (O::State::LEN, O::Measurement::LEN, self.n_u);
        let mut track = Track {
            memory: vec![0.0; samples * m],
            innovation: vec![0.0; samples * p],
            status: vec![0; samples],
        };
        let mut z = O::State::read(memory0);
        let rows = track.memory.chunks_exact_mut(m).zip(track.innovation.chunks_exact_mut(p));
        for (k, ((row, innovation), status)) in rows.zip(&mut track.status).enumerate() {
            if k % 4096 == 0 && stop.is_set() {
                break;
            }
            let y = O::Measurement::read(&record.y[k * p..]);
            let u = O::Input::read(&record.u[k * q..(k + 1) * q]);
            let t = record.t[k];
            let dt = match record.t.get(k + 1) {
                Some(next) => next - t,
                None => t - record.t[k.saturating_sub(1)],
            };
            self.observer.innovation(&z, &y).write(innovation);
            let before = z;
            let outcome = self.observer.step(&mut z, &y, &u, t, dt);
            let shown = if self.is_current() { &z } else { &before };
            shown.write(row);
            *status = outcome as u8;
        }
        track
    }
    fn study(&self, plan: &Plan, stop: &StopFlag) -> PyResult<StudyResult> {
        (self.study)(&self.observer, plan, stop)
    }
}

type Continuous<L> = Discretised<L, Discretisation>;

/// Box a continuous law of order N with the plants that it can be simulated with.
fn continuous<L>(law: L, scheme: Discretisation, n: usize, model: AnyModel) -> Box<dyn AnyObserver>
where
    L: crate::observer::ContinuousLaw<f64, Input = SVector<f64, 1>> + Send + Sync + 'static,
{
    let study: Study<Continuous<L>> = |_, _, _| Err(refused(study::NO_PLANT));
    let n_u = usize::from(matches!(model, AnyModel::Input(_)));
    Box::new(Boxed { observer: Discretised { law, scheme }, n, n_u, study })
}

/// As [`continuous`], with a study function.
fn studied<L>(law: L, scheme: Discretisation, n: usize, model: AnyModel) -> Box<dyn AnyObserver>
where
    L: crate::observer::ContinuousLaw<f64, Input = SVector<f64, 1>> + Send + Sync + 'static,
{
    let study: Study<Continuous<L>> =
        if n == 5 { study::of_order_5::<L> } else { study::of_order_2::<L> };
    let n_u = usize::from(matches!(model, AnyModel::Input(_)));
    Box::new(Boxed { observer: Discretised { law, scheme }, n, n_u, study })
}

/// Orders 2 and 5 are those of the plants, so only their laws carry a study function.
macro_rules! boxed {
    ($n:ident, $law:expr, $scheme:expr, $model:expr) => {
        if $n == 2 || $n == 5 {
            Ok(studied($law, $scheme, $n, $model))
        } else {
            Ok(continuous($law, $scheme, $n, $model))
        }
    };
}

fn standard<const N: usize>(
    spec: &Spec<'_>,
    model: AnyModel,
    scheme: Discretisation,
) -> PyResult<Box<dyn AnyObserver>> {
    spec.only(&["kind", "n", "k", "gain", "model", "method"])?;
    let k = spec.vector::<N>("k", N)?;
    match AnyGain::read(&spec.sub("gain")?)? {
        AnyGain::Constant(gain) => {
            boxed!(N, StandardObserver::<f64, _, _, N, 1>::new(k, gain, model)?, scheme, model)
        }
        AnyGain::Moving(gain) => {
            boxed!(N, StandardObserver::<f64, _, _, N, 1>::new(k, gain, model)?, scheme, model)
        }
    }
}

fn low_power<const N: usize>(
    spec: &Spec<'_>,
    model: AnyModel,
    scheme: Discretisation,
    saturated: bool,
) -> PyResult<Box<dyn AnyObserver>> {
    let mut known = vec!["kind", "n", "alpha", "beta", "gain", "model", "method"];
    let saturation = if saturated {
        known.extend(["saturation", "clip"]);
        let levels = spec.vector::<N>("saturation", N - 1)?;
        let clip = spec.text_or("clip", "hard")?;
        match clip.as_str() {
            "hard" => AnySaturation::Hard(HardClip::new(levels)?),
            "smooth" => AnySaturation::Smooth(SmoothSaturation::new(levels)?),
            other => return Err(spec.unknown("clip", other, &["hard", "smooth"])),
        }
    } else {
        AnySaturation::None
    };
    spec.only(&known)?;
    if matches!(model, AnyModel::SanfelicePraly(_)) {
        return Err(refused(
            "model = 'sanfelice-praly' is not allowed here: the low-power and the peaking-free \
             observer need a phase-variable model (known terms in the last equation only); use \
             the standard observer",
        ));
    }
    let (alpha, beta) = (spec.vector::<N>("alpha", N)?, spec.vector::<N>("beta", N - 1)?);
    match AnyGain::read(&spec.sub("gain")?)? {
        AnyGain::Constant(gain) => {
            let law = LowPower::<f64, _, _, _, N, 1>::new(alpha, beta, gain, model, saturation)?;
            boxed!(N, law, scheme, model)
        }
        AnyGain::Moving(gain) => {
            let law = LowPower::<f64, _, _, _, N, 1>::new(alpha, beta, gain, model, saturation)?;
            boxed!(N, law, scheme, model)
        }
    }
}

fn collection<const C: usize>(
    spec: &Spec<'_>,
    model: AnyModel,
    scheme: Discretisation,
    modified: bool,
) -> PyResult<Box<dyn AnyObserver>> {
    const N: usize = 2;
    spec.only(&["kind", "n", "k", "k_bar", "copies", "gain", "model", "method"])?;
    let AnyGain::Moving(MovingGain::Adaptive(gain)) = AnyGain::read(&spec.sub("gain")?)? else {
        return Err(refused("a collection needs the adaptive gain law, Sanfelice and Praly (23)"));
    };
    let (k, k_bar) = (spec.vector::<N>("k", N)?, spec.vector::<N>("k_bar", N)?);
    let collection = RepelledCollection::<f64, _, N, C, 1>::new(k, k_bar, gain, model)?;
    Ok(if modified {
        studied(ModifiedObserver { collection }, scheme, N, model)
    } else {
        studied(collection, scheme, N, model)
    })
}

/// An observer from its spec.
pub fn build(spec: &Spec<'_>) -> PyResult<Box<dyn AnyObserver>> {
    let kind = spec.text("kind")?;
    match kind.as_str() {
        "sampled-data" => {
            spec.only(&["kind", "model", "gain"])?;
            let gain = spec.text_or("gain", "derived")?;
            let correction = match gain.as_str() {
                "derived" => Correction::Derived,
                "printed" => Correction::Printed,
                other => return Err(spec.unknown("gain", other, &["derived", "printed"])),
            };
            let known = spec.sub("model")?;
            let name = known.text("kind")?;
            if name != "van-der-pol" {
                return Err(known.unknown("kind", &name, &["van-der-pol"]));
            }
            let observer: SampledDataObserver<_, 2> =
                SampledDataObserver { model: read_van_der_pol(&known, correction)? };
            return Ok(Box::new(Boxed { observer, n: 2, n_u: 0, study: study::of_sampled_data }));
        }
        "reduced-order" => {
            spec.only(&["kind", "model", "h_bar", "epsilon"])?;
            let known = spec.sub("model")?;
            let name = known.text("kind")?;
            if name != "ship" {
                return Err(known.unknown("kind", &name, &["ship"]));
            }
            let h_bar = spec.vector::<3>("h_bar", 3)?;
            let observer =
                ReducedOrderObserver::new(h_bar, spec.f64("epsilon")?, read_ship(&known)?)?;
            return Ok(Box::new(Boxed { observer, n: 3, n_u: 2, study: study::of_reduced_order }));
        }
        _ => {}
    }
    let model = match spec.get("model")? {
        None => AnyModel::Unknown,
        Some(_) => AnyModel::read(&spec.sub("model")?)?,
    };
    let scheme = read_method(spec)?;
    let n = spec.count("n")?;
    if let Some(order) = model.order()
        && order != n
    {
        let message = format!("n = {n} does not fit the model, which has order {order}");
        return Err(refused(&message));
    }
    match kind.as_str() {
        "standard" => {
            dispatch_order!(n, N => standard::<N>(spec, model, scheme), else Err(order_refused(n)))
        }
        "low-power" | "peaking-free" => {
            let saturated = kind == "peaking-free";
            dispatch_order!(n, N => low_power::<N>(spec, model, scheme, saturated),
                            else Err(order_refused(n)))
        }
        "collection" | "modified" => {
            if n != 2 {
                let message = format!("n = {n} is not allowed: a collection has n = 2 from Python");
                return Err(refused(&message));
            }
            let modified = kind == "modified";
            match spec.count("copies")? {
                2 => collection::<2>(spec, model, scheme, modified),
                3 => collection::<3>(spec, model, scheme, modified),
                4 => collection::<4>(spec, model, scheme, modified),
                5 => collection::<5>(spec, model, scheme, modified),
                copies => {
                    let message = format!("copies = {copies} is not allowed: 2 to 5 from Python");
                    Err(refused(&message))
                }
            }
        }
        other => {
            let known = [
                "standard",
                "low-power",
                "peaking-free",
                "collection",
                "modified",
                "sampled-data",
                "reduced-order",
            ];
            Err(spec.unknown("kind", other, &known))
        }
    }
}

/// An observer of the core, from its spec.
#[pyclass(frozen, module = "hgo_rs._core")]
pub struct Observer {
    inner: Box<dyn AnyObserver>,
}

#[pymethods]
impl Observer {
    #[new]
    fn new(spec: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(Self { inner: build(&Spec::new(spec, "observer")?)? })
    }

    /// Number of estimated states.
    #[getter]
    fn n(&self) -> usize {
        self.inner.n()
    }

    /// Number of measured outputs.
    #[getter]
    fn n_y(&self) -> usize {
        self.inner.n_y()
    }

    /// Number of known inputs.
    #[getter]
    fn n_u(&self) -> usize {
        self.inner.n_u()
    }

    /// Number of memory entries.
    #[getter]
    fn memory_len(&self) -> usize {
        self.inner.initial().len()
    }

    /// Whether the estimate at k uses y(k).
    #[getter]
    fn is_current(&self) -> bool {
        self.inner.is_current()
    }

    /// Memory to start from when nothing is known.
    fn initial<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.inner.initial().into_pyarray(py)
    }

    /// (memory, status) after one step; status 0 updated, 1 predicted, 2 model undefined.
    fn step<'py>(
        &self,
        py: Python<'py>,
        memory: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
        u: &Bound<'py, PyAny>,
        t: f64,
        dt: f64,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, u8)> {
        let mut memory = sized("memory", memory, self.memory_len())?;
        let y = sized("y", y, self.inner.n_y())?;
        let u = sized("u", u, self.inner.n_u())?;
        let status = self.inner.step(&mut memory, &y, &u, t, dt);
        Ok((memory.into_pyarray(py), status as u8))
    }

    /// Run over a record: times (N,), samples (N, n_y), inputs (N, n_u), memory to start from.
    fn run<'py>(
        &self,
        py: Python<'py>,
        t: &Bound<'py, PyAny>,
        y: &Bound<'py, PyAny>,
        u: &Bound<'py, PyAny>,
        memory0: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let t = numbers(t)?.values;
        let samples = t.len();
        let y = sized("y", y, samples * self.inner.n_y())?;
        let u = sized("u", u, samples * self.inner.n_u())?;
        let memory0 = sized("memory0", memory0, self.memory_len())?;
        let record = Record { t, y, u };
        let track = interruptible(py, |stop| Ok(self.inner.run(&record, &memory0, stop)))?;
        let out = PyDict::new(py);
        out.set_item("memory", matrix(py, track.memory, samples)?)?;
        out.set_item("innovation", matrix(py, track.innovation, samples)?)?;
        let missing: Vec<bool> = track.status.iter().map(|status| *status == 1).collect();
        out.set_item("missing", missing.into_pyarray(py))?;
        out.set_item("status", track.status.into_pyarray(py))?;
        Ok(out)
    }
}

/// `len` numbers, whatever their shape.
fn sized(name: &str, object: &Bound<'_, PyAny>, len: usize) -> PyResult<Vec<f64>> {
    let given = numbers(object)?;
    if given.values.len() != len {
        let message = format!("{name} has shape {:?}; it must hold {len} numbers", given.shape);
        return Err(refused(&message));
    }
    Ok(given.values)
}
