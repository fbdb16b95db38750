//! Observers whose model is known at run time only: their steps as programs of the core.
//!
//! The laws are the core's own. Run over [`Traced`] numbers, with the model's table in the place of a
//! compiled model, each writes down its step once; the program of that step is what runs.

use super::design::order_refused;
use super::errors::refused;
use super::interrupt::StopFlag;
use super::observers::{AnyGain, AnyObserver, AnySaturation, MovingGain, Recursion, read_method};
use super::record::Block;
use super::spec::Spec;
use super::study::{Plan, StudyResult};
use super::systems::{AnyModel, read_van_der_pol};
use super::table::{Compiled, Table};
use super::trace::{self, Setting, Traced, call, input, inputs, named, trace};
use crate::Scalar;
use crate::dispatch_order;
use crate::memory::Memory;
use crate::model::{Model, PhaseVariable, SampledModel, last};
use crate::models::Correction;
use crate::observer::{ContinuousLaw, Discretised, Observer, Scheme, Status, Timing};
use crate::observers::{
    LowPower, ModifiedObserver, RepelledCollection, SampledDataObserver, StandardObserver,
};
use crate::program::Registers;
use nalgebra::SVector;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Known inputs that a model may have.
const MAX_INPUTS: usize = 8;

/// A model as it was given.
pub struct OwnModel {
    form: String,
    n: usize,
    n_u: usize,
    table: Table,
    parameters: Vec<f64>,
}

impl OwnModel {
    fn read(spec: &Spec<'_>) -> PyResult<Self> {
        spec.only(&["kind", "form", "n", "n_u", "table", "parameters", "names"])?;
        let (form, n, n_u) = (spec.text("form")?, spec.count("n")?, spec.count("n_u")?);
        let table = Table::read(&spec.sub("table")?)?;
        let parameters = spec.numbers("parameters")?.values;
        if let Some(bad) = parameters.iter().find(|value| !value.is_finite()) {
            return Err(refused(&format!("a parameter of the model is {bad}; it must be finite")));
        }
        if n_u > MAX_INPUTS {
            let message =
                format!("n_u = {n_u} is not allowed: a model has 0 to {MAX_INPUTS} inputs");
            return Err(refused(&message));
        }
        let (given, made) = match form.as_str() {
            "phase" => (1 + n + n_u, 1),
            "triangular" => (1 + n + n_u, n),
            "sampled" => (3 + n + n_u, 2 * n + 1),
            other => {
                return Err(spec.unknown("form", other, &["phase", "triangular", "sampled"]));
            }
        };
        let given = given + parameters.len();
        if table.inputs.len() != given || table.outputs.len() != made {
            return Err(refused(&format!(
                "the model's table has {} inputs and {} outputs; its form {form:?} has {given} and \
                 {made}",
                table.inputs.len(),
                table.outputs.len()
            )));
        }
        Ok(Self { form, n, n_u, table, parameters })
    }

    /// Names of the parameters: the last inputs of the table.
    fn names(&self) -> &[String] {
        &self.table.inputs[self.table.inputs.len() - self.parameters.len()..]
    }
}

/// A model that observers over traced numbers know.
#[derive(Clone, Copy)]
enum Known {
    Paper(AnyModel<Traced>),
    Own { function: usize, n_u: usize },
}

impl Known {
    /// Outputs of an own model's table.
    fn call(function: usize, t: Traced, x: &[Traced], u: &[Traced]) -> Vec<Traced> {
        call(function, &[&[t], x, u].concat())
    }
}

/// The first K inputs.
fn told<const K: usize>(u: &SVector<Traced, MAX_INPUTS>) -> SVector<Traced, K> {
    SVector::from_fn(|i, _| u[i])
}

impl<const N: usize> Model<Traced, N, MAX_INPUTS> for Known {
    fn f_hat(
        &self,
        t: Traced,
        x: &SVector<Traced, N>,
        u: &SVector<Traced, MAX_INPUTS>,
    ) -> SVector<Traced, N> {
        match self {
            Self::Paper(model) => model.f_hat(t, x, &told::<1>(u)),
            Self::Own { function, n_u } => {
                let made = Self::call(*function, t, x.as_slice(), &u.as_slice()[..*n_u]);
                match made.as_slice() {
                    [phi] => last(*phi),
                    f => SVector::from_fn(|i, _| f.get(i).copied().unwrap_or_default()),
                }
            }
        }
    }
}

impl<const N: usize> PhaseVariable<Traced, N, MAX_INPUTS> for Known {
    fn phi(&self, t: Traced, x: &SVector<Traced, N>, u: &SVector<Traced, MAX_INPUTS>) -> Traced {
        match self {
            Self::Paper(model) => model.phi(t, x, &told::<1>(u)),
            Self::Own { function, n_u } => {
                let made = Self::call(*function, t, x.as_slice(), &u.as_slice()[..*n_u]);
                made.first().copied().unwrap_or_default()
            }
        }
    }
}

/// A model of the sampled-data observer.
#[derive(Clone, Copy)]
struct OwnSampled {
    function: usize,
    n: usize,
    n_u: usize,
}

impl OwnSampled {
    fn call(&self, x: &[Traced], u: &[Traced], y: Traced, dt: Traced) -> Vec<Traced> {
        call(self.function, &[&[Traced::ZERO], x, &u[..self.n_u], &[y, dt]].concat())
    }
}

impl<const N: usize> SampledModel<Traced, N, MAX_INPUTS> for OwnSampled {
    fn f(&self, x: &SVector<Traced, N>, u: &SVector<Traced, MAX_INPUTS>) -> SVector<Traced, N> {
        let made = self.call(x.as_slice(), u.as_slice(), Traced::ZERO, Traced::ZERO);
        SVector::from_fn(|i, _| made[i])
    }
    fn correction(&self, x: &SVector<Traced, N>, y: Traced, dt: Traced) -> SVector<Traced, N> {
        let made = self.call(x.as_slice(), &[Traced::ZERO; MAX_INPUTS], y, dt);
        SVector::from_fn(|i, _| made[self.n + i])
    }
}

/// What a step is made of.
struct Shape {
    n: usize,
    n_y: usize,
    n_u: usize,
    memory: usize,
    current: bool,
    initial: Vec<f64>,
}

/// An observer as tables.
pub struct Tables {
    shape: Shape,
    /// (t, dt, z, y, u, parameters) → (z⁺, innovation).
    step: Table,
    /// The same where the sample is missing, if that is another law.
    missing: Option<Table>,
    /// A continuous law: (t, z, y, u, parameters) → ż, and z → z within the set that it lives in.
    law: Option<(Table, Table)>,
    parameters: Vec<f64>,
}

/// What an observer knows, as its spec says it.
enum Given<'py> {
    Paper(Option<Spec<'py>>),
    Own(OwnModel),
}

impl<'py> Given<'py> {
    fn read(spec: &Spec<'py>) -> PyResult<Self> {
        if spec.get("model")?.is_none() {
            return Ok(Self::Paper(None));
        }
        let model = spec.sub("model")?;
        if model.text("kind")? == "own" {
            return Ok(Self::Own(OwnModel::read(&model)?));
        }
        Ok(Self::Paper(Some(model)))
    }

    /// Number of known inputs.
    fn n_u(&self) -> PyResult<usize> {
        match self {
            Self::Paper(None) => Ok(0),
            Self::Paper(Some(model)) => Ok(usize::from(model.text("kind")? == "input")),
            Self::Own(own) => Ok(own.n_u),
        }
    }

    fn parameters(&self) -> &[f64] {
        if let Self::Own(own) = self { &own.parameters } else { &[] }
    }

    /// Within a trace: inputs for the parameters, and the model over them.
    fn install(&self, n: usize) -> PyResult<Known> {
        let (order, known) = match self {
            Self::Paper(None) => (None, Known::Paper(AnyModel::Unknown)),
            Self::Paper(Some(spec)) => {
                let model = AnyModel::read(spec)?;
                (model.order(), Known::Paper(model))
            }
            Self::Own(own) => {
                if own.form == "sampled" {
                    return Err(refused(
                        "a model of sampled-data form fits the sampled-data observer only",
                    ));
                }
                let parameters = own.names().iter().map(|name| input(name)).collect();
                let function = trace::function(own.table.clone(), parameters);
                (Some(own.n), Known::Own { function, n_u: own.n_u })
            }
        };
        match order {
            Some(order) if order != n => {
                Err(refused(&format!("n = {n} does not fit the model, which has order {order}")))
            }
            _ => Ok(known),
        }
    }
}

fn flat<M: Memory<Traced>>(memory: &M) -> Vec<Traced> {
    let mut values = vec![Traced::ZERO; M::LEN];
    memory.write(&mut values);
    values
}

/// The table of one step of the observer that `build` makes within the trace.
fn step_table<O>(
    setting: Setting,
    n_u: usize,
    build: impl FnOnce() -> PyResult<O>,
) -> PyResult<Table>
where
    O: Observer<Traced>,
    O::Input: Memory<Traced>,
{
    trace(setting, || {
        let (t, dt) = (input("t"), input("dt"));
        let mut z = O::State::read(&inputs("z", O::State::LEN));
        let y = O::Measurement::read(&inputs("y", O::Measurement::LEN));
        let u = O::Input::read(&inputs("u", n_u));
        let observer = build()?;
        let innovation = flat(&observer.innovation(&z, &y));
        observer.step(&mut z, &y, &u, t, dt);
        Ok([named("z", &flat(&z)), named("innovation", &innovation)].concat())
    })
}

/// Tables of a continuous law under a scheme.
fn continuous<L, S>(
    given: &Given<'_>,
    single: bool,
    build: impl Fn() -> PyResult<Discretised<L, S>>,
) -> PyResult<Tables>
where
    L: ContinuousLaw<Traced>,
    L::Input: Memory<Traced>,
    S: Scheme<Traced>,
{
    let setting = Setting { single, present: true };
    let n_u = given.n_u()?;
    let step = step_table(setting, n_u, &build)?;
    let rate = trace(setting, || {
        let t = input("t");
        let z = L::State::read(&inputs("z", L::State::LEN));
        let y = input("y[0]");
        let u = L::Input::read(&inputs("u", n_u));
        let law = build()?.law;
        Ok(named("z", &flat(&law.rate(t, &z, &law.innovation(&z, y), &u))))
    })?;
    let admissible = trace(setting, || {
        let z = L::State::read(&inputs("z", L::State::LEN));
        Ok(named("z", &flat(&build()?.law.admissible(z))))
    })?;
    let shape = shape::<Discretised<L, S>>(n_u, &build)?;
    let parameters = given.parameters().to_vec();
    Ok(Tables { shape, step, missing: None, law: Some((rate, admissible)), parameters })
}

fn shape<O: Observer<Traced>>(n_u: usize, build: impl FnOnce() -> PyResult<O>) -> PyResult<Shape> {
    let mut initial = Vec::new();
    trace(Setting { single: false, present: true }, || {
        initial = flat(&build()?.initial()).into_iter().map(Scalar::to_f64).collect();
        Ok(Vec::new())
    })?;
    Ok(Shape {
        n: O::ESTIMATED,
        n_y: O::Measurement::LEN,
        n_u,
        memory: O::State::LEN,
        current: O::TIMING == Timing::Current,
        initial,
    })
}

fn standard<const N: usize>(spec: &Spec<'_>, given: &Given<'_>, single: bool) -> PyResult<Tables> {
    spec.only(&["kind", "n", "k", "gain", "model", "method"])?;
    let (k, scheme) = (spec.vector::<N>("k", N)?, read_method(spec)?);
    let gain = spec.sub("gain")?;
    macro_rules! law {
        ($gain:pat => $made:expr) => {
            continuous(given, single, || {
                let model = given.install(N)?;
                let $gain = AnyGain::read(&gain)? else { return Err(refused("another gain law")) };
                let k = k.map(Traced::from_f64);
                let law = StandardObserver::<Traced, _, _, N, MAX_INPUTS>::new(k, $made, model)?;
                Ok(Discretised { law, scheme })
            })
        };
    }
    if gain.text("law")? == "constant" {
        law!(AnyGain::Constant(gain) => gain)
    } else {
        law!(AnyGain::Moving(gain) => gain)
    }
}

fn low_power<const N: usize>(
    spec: &Spec<'_>,
    given: &Given<'_>,
    single: bool,
    saturated: bool,
) -> PyResult<Tables> {
    let scheme = read_method(spec)?;
    if let Given::Own(own) = given
        && own.form == "triangular"
    {
        return Err(refused(
            "a triangular model is not allowed here: the low-power and the peaking-free observer \
             need a phase-variable model (known terms in the last equation only); use the standard \
             observer",
        ));
    }
    let (alpha, beta) = (spec.vector::<N>("alpha", N)?, spec.vector::<N>("beta", N - 1)?);
    let gain = spec.sub("gain")?;
    macro_rules! law {
        ($gain:pat => $made:expr) => {
            continuous(given, single, || {
                let model = given.install(N)?;
                let saturation = AnySaturation::<N, Traced>::read(spec, saturated)?;
                let $gain = AnyGain::read(&gain)? else { return Err(refused("another gain law")) };
                let [alpha, beta] = [alpha, beta].map(|k| k.map(Traced::from_f64));
                let law = LowPower::<Traced, _, _, _, N, MAX_INPUTS>::new(
                    alpha, beta, $made, model, saturation,
                )?;
                Ok(Discretised { law, scheme })
            })
        };
    }
    if gain.text("law")? == "constant" {
        law!(AnyGain::Constant(gain) => gain)
    } else {
        law!(AnyGain::Moving(gain) => gain)
    }
}

fn collection<const C: usize>(
    spec: &Spec<'_>,
    given: &Given<'_>,
    single: bool,
    modified: bool,
) -> PyResult<Tables> {
    const N: usize = 2;
    spec.only(&["kind", "n", "k", "k_bar", "copies", "gain", "model", "method"])?;
    let (k, k_bar) = (spec.vector::<N>("k", N)?, spec.vector::<N>("k_bar", N)?);
    let (gain, scheme) = (spec.sub("gain")?, read_method(spec)?);
    let copies = || {
        let model = given.install(N)?;
        let AnyGain::Moving(MovingGain::Adaptive(gain)) = AnyGain::read(&gain)? else {
            return Err(refused(
                "a collection needs the adaptive gain law, Sanfelice and Praly (23)",
            ));
        };
        let [k, k_bar] = [k, k_bar].map(|k| k.map(Traced::from_f64));
        Ok(RepelledCollection::<Traced, _, N, C, MAX_INPUTS>::new(k, k_bar, gain, model)?)
    };
    if modified {
        continuous(given, single, || {
            Ok(Discretised { law: ModifiedObserver { collection: copies()? }, scheme })
        })
    } else {
        continuous(given, single, || Ok(Discretised { law: copies()?, scheme }))
    }
}

/// Tables of a sampled-data observer that `build` makes.
fn sampled<O>(given: &Given<'_>, single: bool, build: impl Fn() -> PyResult<O>) -> PyResult<Tables>
where
    O: Observer<Traced>,
    O::Input: Memory<Traced>,
{
    let n_u = given.n_u()?;
    let step = |present| step_table(Setting { single, present }, n_u, &build);
    Ok(Tables {
        shape: shape(n_u, &build)?,
        step: step(true)?,
        missing: Some(step(false)?),
        law: None,
        parameters: given.parameters().to_vec(),
    })
}

fn own_sampled<const N: usize>(
    given: &Given<'_>,
    own: &OwnModel,
    single: bool,
) -> PyResult<Tables> {
    if own.form != "sampled" {
        return Err(refused(
            "the sampled-data observer needs a model of sampled-data form: f, K_T and h",
        ));
    }
    sampled(given, single, || {
        let parameters = own.names().iter().map(|name| input(name)).collect();
        let function = trace::function(own.table.clone(), parameters);
        let model = OwnSampled { function, n: own.n, n_u: own.n_u };
        Ok(SampledDataObserver::<_, N, MAX_INPUTS> { model })
    })
}

impl Tables {
    /// Of the observer that a spec describes; with `single` in single precision.
    pub fn read(spec: &Spec<'_>, single: bool) -> PyResult<Self> {
        let kind = spec.text("kind")?;
        let given = Given::read(spec)?;
        if kind == "sampled-data" {
            spec.only(&["kind", "model", "gain"])?;
            if let Given::Own(own) = &given {
                return dispatch_order!(own.n, N => own_sampled::<N>(&given, own, single),
                                       else Err(order_refused(own.n)));
            }
            let correction = match spec.text_or("gain", "derived")?.as_str() {
                "printed" => Correction::Printed,
                _ => Correction::Derived,
            };
            return sampled(&given, single, || {
                let model = read_van_der_pol::<Traced>(&spec.sub("model")?, correction)?;
                Ok(SampledDataObserver::<_, 2, 0> { model })
            });
        }
        if kind == "reduced-order" {
            return Err(refused(
                "the reduced-order observer decides on its samples: it has no table",
            ));
        }
        let n = spec.count("n")?;
        match kind.as_str() {
            "standard" => {
                dispatch_order!(n, N => standard::<N>(spec, &given, single),
                                else Err(order_refused(n)))
            }
            "low-power" | "peaking-free" => {
                let saturated = kind == "peaking-free";
                dispatch_order!(n, N => low_power::<N>(spec, &given, single, saturated),
                                else Err(order_refused(n)))
            }
            "collection" | "modified" => {
                let modified = kind == "modified";
                match spec.count("copies")? {
                    2 => collection::<2>(spec, &given, single, modified),
                    3 => collection::<3>(spec, &given, single, modified),
                    4 => collection::<4>(spec, &given, single, modified),
                    5 => collection::<5>(spec, &given, single, modified),
                    copies => Err(refused(&format!(
                        "copies = {copies} is not allowed: 2 to 5 from Python"
                    ))),
                }
            }
            other => Err(spec.unknown(
                "kind",
                other,
                &[
                    "standard",
                    "low-power",
                    "peaking-free",
                    "collection",
                    "modified",
                    "sampled-data",
                ],
            )),
        }
    }
}

/// An observer whose step is a program.
pub struct Programmed {
    tables: Tables,
    step: Compiled,
    missing: Option<Compiled>,
    /// Registers with constants and parameters in their places.
    at_rest: [Registers<f64>; 2],
}

/// An observer with a model of the user's own.
pub fn build(spec: &Spec<'_>) -> PyResult<Box<dyn AnyObserver>> {
    let tables = Tables::read(spec, false)?;
    let step = tables.step.compile()?;
    let missing = tables.missing.as_ref().map(Table::compile).transpose()?;
    let at_rest = [tables.at_rest(&step), tables.at_rest(missing.as_ref().unwrap_or(&step))];
    Ok(Box::new(Programmed { tables, step, missing, at_rest }))
}

impl Tables {
    pub fn n(&self) -> usize {
        self.shape.n
    }
    pub fn n_y(&self) -> usize {
        self.shape.n_y
    }
    pub fn n_u(&self) -> usize {
        self.shape.n_u
    }
    pub fn memory_len(&self) -> usize {
        self.shape.memory
    }
    pub fn is_current(&self) -> bool {
        self.shape.current
    }
    pub fn step(&self) -> &Table {
        &self.step
    }
    /// Rate and admissible set of a continuous law.
    pub fn law(&self) -> Option<&(Table, Table)> {
        self.law.as_ref()
    }
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// Registers of the step's program before a run.
    fn at_rest<T: Scalar>(&self, step: &Compiled) -> Registers<T> {
        let mut registers = step.registers();
        let Shape { memory, n_y, n_u, .. } = self.shape;
        let first = 2 + memory + n_y + n_u;
        for (slot, value) in registers.0.iter_mut().skip(first).zip(&self.parameters) {
            *slot = T::from_f64(*value);
        }
        registers
    }
}

impl Programmed {
    /// One step in place: the memory stands in the registers from 2 on.
    #[inline(always)]
    fn advance_one(
        &self,
        registers: &mut [Registers<f64>; 2],
        (t, dt): (f64, f64),
        y: &[f64],
        u: &[f64],
        innovation: Option<&mut [f64]>,
    ) -> Status {
        let Shape { memory, n_y, .. } = self.tables.shape;
        let present = y.iter().all(|y| y.is_finite());
        let (program, r) = match (&self.missing, present) {
            (Some(missing), false) => {
                let [first, second] = registers;
                second.0[2..2 + memory].copy_from_slice(&first.0[2..2 + memory]);
                (missing, second)
            }
            _ => (&self.step, &mut registers[0]),
        };
        (r.0[0], r.0[1]) = (t, dt);
        r.0.iter_mut().skip(2 + memory).zip(y.iter().chain(u)).for_each(|(slot, y)| *slot = *y);
        program.program().run(r);
        let (next, told) = program.outputs.split_at(memory);
        let mut spoilt = 0.0;
        for output in next {
            spoilt += 0.0 * r.0[usize::from(*output)];
        }
        if let Some(innovation) = innovation {
            for (slot, output) in innovation.iter_mut().zip(told) {
                *slot = r.0[usize::from(*output)];
            }
        }
        if spoilt != 0.0 || spoilt.is_nan() {
            return Status::ModelUndefined; // the memory is kept
        }
        let mut moved = [0.0; crate::program::REGISTERS];
        for (slot, output) in moved.iter_mut().zip(next) {
            *slot = r.0[usize::from(*output)];
        }
        registers[0].0[2..2 + memory].copy_from_slice(&moved[..memory]);
        debug_assert_eq!(y.len(), n_y);
        if present { Status::Updated } else { Status::Predicted }
    }
}

impl Recursion for Programmed {
    fn step(&self, memory: &mut [f64], y: &[f64], u: &[f64], t: f64, dt: f64) -> Status {
        let mut registers = self.at_rest;
        registers[0].0[2..2 + memory.len()].copy_from_slice(memory);
        let status = self.advance_one(&mut registers, (t, dt), y, u, None);
        memory.copy_from_slice(&registers[0].0[2..2 + memory.len()]);
        status
    }

    fn advance(&self, memory: &mut [f64], block: Block<'_>) -> f64 {
        let Block { t, dt, y, u, memory: rows, innovation, status } = block;
        let Shape { n_y: p, n_u: q, current, .. } = self.tables.shape;
        let m = memory.len();
        let mut registers = self.at_rest;
        registers[0].0[2..2 + m].copy_from_slice(memory);
        let mut largest = [0.0_f64; crate::program::REGISTERS];
        for (k, status) in status.iter_mut().enumerate() {
            let row = &mut rows[k * m..(k + 1) * m];
            if !current {
                row.copy_from_slice(&registers[0].0[2..2 + m]);
            }
            let told = innovation.get_mut(k * p..(k + 1) * p);
            let (y, u) = (&y[k * p..(k + 1) * p], &u[k * q..(k + 1) * q]);
            *status = self.advance_one(&mut registers, (t[k], dt[k]), y, u, told) as u8;
            if current {
                row.copy_from_slice(&registers[0].0[2..2 + m]);
            }
            for (largest, value) in largest.iter_mut().zip(&*row) {
                *largest = if value.abs() > *largest { value.abs() } else { *largest };
            }
        }
        memory.copy_from_slice(&registers[0].0[2..2 + m]);
        largest.iter().fold(0.0, |most: f64, value| most.max(*value))
    }
}

impl AnyObserver for Programmed {
    fn n(&self) -> usize {
        self.tables.shape.n
    }
    fn n_y(&self) -> usize {
        self.tables.shape.n_y
    }
    fn n_u(&self) -> usize {
        self.tables.shape.n_u
    }
    fn is_current(&self) -> bool {
        self.tables.shape.current
    }
    fn initial(&self) -> Vec<f64> {
        self.tables.shape.initial.clone()
    }
    fn recursion(&self) -> &dyn Recursion {
        self
    }
    /// Studies of programs begin at [`simulate`], which has the plant's table too.
    fn study(&self, _plan: &Plan, _stop: &StopFlag) -> PyResult<StudyResult> {
        Err(refused("this computation takes the papers' plants and observers only"))
    }
}

/// One step of the observer that `spec` describes, as a table: (t, dt, z, y, u, parameters) in,
/// (z after the step, innovation) out; with `missing` the step over a missing sample.
#[pyfunction]
#[pyo3(signature = (spec, single=false, missing=false))]
pub fn trace_step<'py>(
    py: Python<'py>,
    spec: &Bound<'py, PyAny>,
    single: bool,
    missing: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let tables = Tables::read(&Spec::new(spec, "observer")?, single)?;
    let table = match (tables.missing, missing) {
        (Some(table), true) => table,
        _ => tables.step,
    };
    table.to_dict(py)
}

/// Outputs of a table for rows of inputs, in double or single precision.
#[pyfunction]
#[pyo3(signature = (table, inputs, single=false))]
pub fn evaluate_table(
    table: &Bound<'_, PyAny>,
    inputs: &Bound<'_, PyAny>,
    single: bool,
) -> PyResult<Vec<Vec<f64>>> {
    let table = Table::read(&Spec::new(table, "table")?)?;
    let given = super::spec::numbers(inputs)?;
    let columns = table.inputs.len();
    if given.shape.len() != 2 || given.shape[1] != columns {
        let shape = given.shape;
        return Err(refused(&format!("inputs have shape {shape:?}; they must be (N, {columns})")));
    }
    let compiled = table.compile()?;
    let rows = given.values.chunks_exact(columns.max(1));
    #[allow(clippy::cast_possible_truncation)]
    Ok(rows
        .map(|row| {
            if single {
                let row: Vec<f32> = row.iter().map(|value| *value as f32).collect();
                compiled.evaluate(&row).into_iter().map(f64::from).collect()
            } else {
                compiled.evaluate(row)
            }
        })
        .collect())
}
