//! Floor 5. From a spec to an observer of the core, and the class `Observer` that Python steps and runs.

use crate::errors::{Result, refused};
use crate::halves::{Halved, halves, known_halves};
use crate::interrupt::StopFlag;
use crate::plan::{NO_PLANT, Plan, Studied, StudyResult};
use crate::record::{self, Clock};
use crate::study;
use crate::values::{contiguous, read_dict};
use hgo_ir::Spec;
use hgo_ir::choices::{AnyGain, AnySaturation, Manner, MovingGain};
use hgo_ir::dispatch_order;
use hgo_ir::order::order_refused;
use hgo_ir::recursion::{AnyObserver, Recursion};
use hgo_ir::systems::{AnyModel, read_ship, read_van_der_pol};
use hgo_rs::memory::Memory;
use hgo_rs::model::Unknown;
use hgo_rs::models::Correction;
use hgo_rs::observer::{
    BogackiShampine, ContinuousLaw, Discretisation, Discretised, Euler, Observer as CoreObserver,
    Rk4, Rk4InnovationHeld, StaggeredEuler, Status, Timing,
};
use hgo_rs::observers::{
    LowPower, ModifiedObserver, NoSaturation, ReducedOrderObserver, RepelledCollection,
    SampledDataObserver, StandardObserver,
};
use nalgebra::SVector;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyFloat, PyFloatMethods};

type Study<O> = fn(&O, &Plan, &StopFlag) -> Result<StudyResult>;

struct Boxed<O> {
    observer: O,
    /// The same observer, its types chosen once for all steps.
    recursion: Box<dyn Recursion>,
    n: usize,
    n_u: usize,
    study: Study<O>,
}

impl<O> AnyObserver for Boxed<O>
where
    O: CoreObserver<f64> + Send + Sync,
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
    fn recursion(&self) -> &dyn Recursion {
        &*self.recursion
    }
}

impl<O> Studied for Boxed<O>
where
    O: CoreObserver<f64> + Send + Sync,
{
    fn law(&self) -> &dyn AnyObserver {
        self
    }
    fn study(&self, plan: &Plan, stop: &StopFlag) -> Result<StudyResult> {
        (self.study)(&self.observer, plan, stop)
    }
}

type Continuous<L> = Discretised<L, Discretisation>;

/// A continuous law under a scheme that nothing is left to choose in.
fn recursion<L>(law: L, scheme: Discretisation) -> Box<dyn Recursion>
where
    L: ContinuousLaw<f64> + Send + Sync + 'static,
    L::Input: Memory<f64>,
{
    match scheme {
        Discretisation::Euler => Box::new(Discretised { law, scheme: Euler }),
        Discretisation::StaggeredEuler => Box::new(Discretised { law, scheme: StaggeredEuler }),
        Discretisation::RungeKutta(Rk4::CHOICE) => Box::new(Discretised { law, scheme: Rk4 }),
        Discretisation::RungeKutta(Rk4InnovationHeld::CHOICE) => {
            Box::new(Discretised { law, scheme: Rk4InnovationHeld })
        }
        Discretisation::RungeKutta(BogackiShampine::CHOICE) => {
            Box::new(Discretised { law, scheme: BogackiShampine })
        }
        Discretisation::RungeKutta(scheme) => Box::new(Discretised { law, scheme }),
    }
}

/// A continuous law whose studies are `study`, and which steps by `recursion`.
fn continuous<L>(
    law: L,
    scheme: Discretisation,
    model: AnyModel,
    recursion: Box<dyn Recursion>,
    study: Study<Continuous<L>>,
) -> Box<dyn Studied>
where
    L: ContinuousLaw<f64, Input = SVector<f64, 1>> + Send + Sync + 'static,
{
    let n_u = usize::from(matches!(model, AnyModel::Input(_)));
    let observer = Discretised { law, scheme };
    Box::new(Boxed { observer, recursion, n: L::ESTIMATED, n_u, study })
}

/// Orders 2 and 5 are those of the plants, so only their laws carry a study function.
///
/// `$recursion` makes a recursion of a scheme, `$halves` the halves of a step from that.
macro_rules! boxed {
    ($n:ident, $law:expr, $manner:expr, $model:expr, $recursion:expr, $halves:expr) => {{
        let Some(scheme) = $manner.whole() else {
            let n_u = usize::from(matches!($model, AnyModel::Input(_)));
            return Ok(Box::new(Halved::new($halves, $n, n_u, $manner.timing)));
        };
        let recursion = $recursion(scheme);
        match $n {
            2 => Ok(continuous($law, scheme, $model, recursion, study::of_order_2)),
            5 => Ok(continuous($law, scheme, $model, recursion, study::of_order_5)),
            _ => Ok(continuous($law, scheme, $model, recursion, |_, _, _| Err(refused(NO_PLANT)))),
        }
    }};
}

/// Orders up to which laws that know nothing or an input are compiled for that alone. Above, choosing
/// the model costs little beside the rest, and the code is large.
const TYPED: usize = 6;

fn standard<const N: usize>(
    spec: &Spec<'_>,
    model: AnyModel,
    manner: Manner,
) -> Result<Box<dyn Studied>> {
    spec.only(&["kind", "n", "k", "gain", "model", "method", "timing"])?;
    let k = spec.vector::<N>("k", N)?;
    match AnyGain::read(&spec.sub("gain")?)? {
        AnyGain::Constant(gain) => {
            let law = StandardObserver::<f64, _, _, N, 1>::new(k, gain, model)?;
            let whole = |scheme| match model {
                AnyModel::Unknown if const { N <= TYPED } => {
                    recursion(law.typed::<_, _, 0>(gain, Unknown), scheme)
                }
                AnyModel::Input(known) if const { N <= TYPED } => {
                    recursion(law.typed::<_, _, 1>(gain, known), scheme)
                }
                _ => recursion(law, scheme),
            };
            boxed!(N, law, manner, model, whole, halves(manner, law, whole)?)
        }
        AnyGain::Moving(gain) => {
            let law = StandardObserver::<f64, _, _, N, 1>::new(k, gain, model)?;
            let whole = |scheme| recursion(law, scheme);
            boxed!(N, law, manner, model, whole, halves(manner, law, whole)?)
        }
    }
}

fn low_power<const N: usize>(
    spec: &Spec<'_>,
    model: AnyModel,
    manner: Manner,
    saturated: bool,
) -> Result<Box<dyn Studied>> {
    let saturation = AnySaturation::<N>::read(spec, saturated)?;
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
            let whole = |scheme| match (model, saturation) {
                (AnyModel::Unknown, AnySaturation::None) if const { N <= TYPED } => {
                    recursion(law.typed::<_, _, 0>(Unknown, NoSaturation), scheme)
                }
                (AnyModel::Input(known), AnySaturation::None) if const { N <= TYPED } => {
                    recursion(law.typed::<_, _, 1>(known, NoSaturation), scheme)
                }
                _ => recursion(law, scheme),
            };
            boxed!(N, law, manner, model, whole, halves(manner, law, whole)?)
        }
        AnyGain::Moving(gain) => {
            let law = LowPower::<f64, _, _, _, N, 1>::new(alpha, beta, gain, model, saturation)?;
            let whole = |scheme| recursion(law, scheme);
            boxed!(N, law, manner, model, whole, halves(manner, law, whole)?)
        }
    }
}

fn copies<L>(law: L, manner: Manner, model: AnyModel) -> Result<Box<dyn Studied>>
where
    L: ContinuousLaw<f64, Input = SVector<f64, 1>> + Send + Sync + 'static,
{
    match manner.whole() {
        None => {
            let n_u = usize::from(matches!(model, AnyModel::Input(_)));
            let halves = known_halves(manner, law, |scheme| recursion(law, scheme))?;
            Ok(Box::new(Halved::new(halves, L::ESTIMATED, n_u, manner.timing)))
        }
        Some(scheme) => {
            let recursion = recursion(law, scheme);
            Ok(continuous(law, scheme, model, recursion, study::of_copies))
        }
    }
}

fn collection<const C: usize>(
    spec: &Spec<'_>,
    model: AnyModel,
    manner: Manner,
    modified: bool,
) -> Result<Box<dyn Studied>> {
    const N: usize = 2;
    spec.only(&["kind", "n", "k", "k_bar", "copies", "gain", "model", "method", "timing"])?;
    let AnyGain::Moving(MovingGain::Adaptive(gain)) = AnyGain::read(&spec.sub("gain")?)? else {
        return Err(refused("a collection needs the adaptive gain law, Sanfelice and Praly (23)"));
    };
    let (k, k_bar) = (spec.vector::<N>("k", N)?, spec.vector::<N>("k_bar", N)?);
    let collection = RepelledCollection::<f64, _, N, C, 1>::new(k, k_bar, gain, model)?;
    if modified {
        copies(ModifiedObserver { collection }, manner, model)
    } else {
        copies(collection, manner, model)
    }
}

/// An observer from its spec.
pub fn build(spec: &Spec<'_>) -> Result<Box<dyn Studied>> {
    let kind = spec.text("kind")?;
    if kind == "chains" || (spec.has("model") && spec.sub("model")?.text_or("kind", "")? == "own") {
        return Ok(Box::new(hgo_ir::observer::build(spec)?));
    }
    match kind.as_str() {
        "sampled-data" => {
            spec.only(&["kind", "model", "gain"])?;
            let gain = spec.text_or("gain", "derived")?;
            let correction = match gain.as_str() {
                "derived" => Correction::Derived,
                "printed" => Correction::Printed,
                other => return Err(spec.unknown("gain", other, &["derived", "printed"]).into()),
            };
            let known = spec.sub("model")?;
            let name = known.text("kind")?;
            if name != "van-der-pol" {
                return Err(known.unknown("kind", &name, &["van-der-pol"]).into());
            }
            let observer: SampledDataObserver<_, 2> =
                SampledDataObserver { model: read_van_der_pol(&known, correction)? };
            let (recursion, study) = (Box::new(observer), study::of_sampled_data);
            return Ok(Box::new(Boxed { observer, recursion, n: 2, n_u: 0, study }));
        }
        "reduced-order" => {
            spec.only(&["kind", "model", "h_bar", "epsilon"])?;
            let known = spec.sub("model")?;
            let name = known.text("kind")?;
            if name != "ship" {
                return Err(known.unknown("kind", &name, &["ship"]).into());
            }
            let h_bar = spec.vector::<3>("h_bar", 3)?;
            let observer =
                ReducedOrderObserver::new(h_bar, spec.f64("epsilon")?, read_ship(&known)?)?;
            let (recursion, study) = (Box::new(observer), study::of_reduced_order);
            return Ok(Box::new(Boxed { observer, recursion, n: 3, n_u: 2, study }));
        }
        _ => {}
    }
    let model = match spec.get("model") {
        None => AnyModel::Unknown,
        Some(_) => AnyModel::read(&spec.sub("model")?)?,
    };
    let manner = Manner::read(spec)?;
    let n = spec.count("n")?;
    if let Some(order) = model.order()
        && order != n
    {
        let message = format!("n = {n} does not fit the model, which has order {order}");
        return Err(refused(&message));
    }
    match kind.as_str() {
        "standard" => {
            dispatch_order!(n, N => standard::<N>(spec, model, manner), else Err(order_refused(n).into()))
        }
        "low-power" | "peaking-free" => {
            let saturated = kind == "peaking-free";
            dispatch_order!(n, N => low_power::<N>(spec, model, manner, saturated),
                            else Err(order_refused(n).into()))
        }
        "collection" | "modified" => {
            if n != 2 {
                let message = format!("n = {n} is not allowed: a collection has n = 2 from Python");
                return Err(refused(&message));
            }
            let modified = kind == "modified";
            match spec.count("copies")? {
                2 => collection::<2>(spec, model, manner, modified),
                3 => collection::<3>(spec, model, manner, modified),
                4 => collection::<4>(spec, model, manner, modified),
                5 => collection::<5>(spec, model, manner, modified),
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
            Err(spec.unknown("kind", other, &known).into())
        }
    }
}

/// An observer of the core, from its spec.
#[pyclass(frozen, module = "hgo_rs._core")]
pub struct Observer {
    inner: Box<dyn Studied>,
    memory_len: usize,
}

impl Observer {
    pub fn law(&self) -> &dyn AnyObserver {
        self.inner.law()
    }
}

#[pymethods]
impl Observer {
    #[new]
    fn new(spec: &Bound<'_, PyAny>) -> Result<Self> {
        let inner = build(&Spec::new(&read_dict(spec, "observer")?, "observer")?)?;
        let memory_len = inner.law().initial().len();
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

    /// Run over a record: times (N,) or a period, samples (N, n_y), inputs (N, n_u), memory to start
    /// from; with `until`, on to that time after the last sample. Gives the track, a copy of the samples,
    /// what the checks found, and the memory at the end (`next`).
    #[pyo3(signature = (t, y, u, memory0, innovation=true, until=None))]
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
    ) -> Result<Bound<'py, PyDict>> {
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
        let out = record::run(py, self.law(), &mut memory, record, until, innovation)?;
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
