//! Observers whose model is known at run time only: their steps as programs of the core.
//!
//! The laws are the core's own. Run over [`Traced`] numbers, with the model's table in the place of a
//! compiled model, each writes down its step once; the program of that step is what runs.

use super::called::Called;
use super::choices::{AnyGain, AnyMethod, AnySaturation, Manner, MovingGain};
use super::compile::Compiled;
use super::design::order_refused;
use super::errors::refused;
use super::interrupt::StopFlag;
use super::plan::{Plan, StudyResult};
use super::recursion::{AnyObserver, Block, Recursion};
use super::spec::Spec;
use super::systems::{AnyModel, read_ship, read_van_der_pol};
use super::table::Table;
use super::tabled::{Gains, LawTables, MAX_INPUTS, flat};
use super::trace::{self, PlacedGains, Setting, Traced, call, input, inputs, named, trace};
use crate::Scalar;
use crate::dispatch_order;
use crate::gain::ConstantGain;
use crate::injection::Placement;
use crate::memory::Memory;
use crate::model::{Model, PhaseVariable, SampledModel, StrictFeedback, Unknown, last};
use crate::models::{Correction, Ship};
use crate::observer::{Observer, Status, Timing};
use crate::observers::{
    LowPower, ModifiedObserver, ReducedOrderObserver, RepelledCollection, SampledDataObserver,
    StandardObserver,
};
use crate::program::{REGISTERS, Registers};
use nalgebra::{SMatrix, SVector};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::cmp::Ordering;
use std::sync::Arc;

/// Outputs that a model of chains may have.
pub const CHAINS: usize = 12;

/// For each chain, the bits of the time that a correction is for.
type Lengths = [u64; CHAINS];

/// A model as it was given.
pub struct OwnModel {
    form: String,
    n: usize,
    n_u: usize,
    table: Table,
    parameters: Vec<f64>,
    /// Orders of the chains, one for each output.
    orders: Vec<usize>,
    /// Unmeasured states of the strict-feedback form.
    n_z: usize,
}

impl OwnModel {
    fn read(spec: &Spec<'_>) -> PyResult<Self> {
        spec.only(&["kind", "form", "n", "n_u", "table", "parameters", "names", "orders", "n_z"])?;
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
        let orders: Vec<usize> = match spec.get("orders")? {
            Some(orders) => orders.extract()?,
            None => vec![n],
        };
        if orders.iter().sum::<usize>() != n || orders.contains(&0) {
            let message =
                format!("orders = {orders:?} is not allowed: they must add up to n = {n}");
            return Err(refused(&message));
        }
        let n_z = if form == "strict-feedback" { spec.count("n_z")? } else { 0 };
        let (given, made) = match form.as_str() {
            "strict-feedback" => (1 + n + n_z + n_u, n + n * n_z + n_z),
            "chains" => (1 + n + n_u, orders.len()),
            "phase" => (1 + n + n_u, 1),
            "triangular" => (1 + n + n_u, n),
            "sampled" => (3 + n + n_u, 2 * n + 1),
            other => {
                return Err(spec.unknown(
                    "form",
                    other,
                    &["phase", "triangular", "chains", "sampled", "strict-feedback"],
                ));
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
        Ok(Self { form, n, n_u, table, parameters, orders, n_z })
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
    Own {
        function: usize,
        n_u: usize,
    },
    /// One of the chains of a model with several outputs: the states of the others, `shared`, are held
    /// over the step.
    Chain {
        function: usize,
        shared: usize,
        n_u: usize,
        n: usize,
        chain: usize,
        first: usize,
    },
}

impl Known {
    /// Outputs of an own model.
    fn call(&self, t: Traced, x: &[Traced], u: &[Traced]) -> Vec<Traced> {
        match *self {
            Self::Paper(_) => Vec::new(),
            Self::Own { function, n_u } => call(function, &[&[t], x, &u[..n_u]].concat()),
            Self::Chain { function, shared, n_u, n, chain, first } => {
                let mut all = trace::parameters(shared);
                all.truncate(n);
                all[first..first + x.len()].copy_from_slice(x);
                let made = call(function, &[&[t], all.as_slice(), &u[..n_u]].concat());
                vec![made[chain]]
            }
        }
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
            own => match own.call(t, x.as_slice(), u.as_slice()).as_slice() {
                [phi] => last(*phi),
                f => SVector::from_fn(|i, _| f.get(i).copied().unwrap_or_default()),
            },
        }
    }
}

impl<const N: usize> PhaseVariable<Traced, N, MAX_INPUTS> for Known {
    fn phi(&self, t: Traced, x: &SVector<Traced, N>, u: &SVector<Traced, MAX_INPUTS>) -> Traced {
        match self {
            Self::Paper(model) => model.phi(t, x, &told::<1>(u)),
            own => {
                let made = own.call(t, x.as_slice(), u.as_slice());
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
    fn call(&self, t: Traced, x: &[Traced], u: &[Traced], y: Traced, dt: Traced) -> Vec<Traced> {
        call(self.function, &[&[t], x, &u[..self.n_u], &[y, dt]].concat())
    }
}

impl<const N: usize> SampledModel<Traced, N, MAX_INPUTS> for OwnSampled {
    fn f(
        &self,
        t: Traced,
        x: &SVector<Traced, N>,
        u: &SVector<Traced, MAX_INPUTS>,
    ) -> SVector<Traced, N> {
        let made = self.call(t, x.as_slice(), u.as_slice(), Traced::ZERO, Traced::ZERO);
        SVector::from_fn(|i, _| made[i])
    }
    fn correction(
        &self,
        t: Traced,
        x: &SVector<Traced, N>,
        u: &SVector<Traced, MAX_INPUTS>,
        y: Traced,
        dt: Traced,
    ) -> SVector<Traced, N> {
        let made = self.call(t, x.as_slice(), u.as_slice(), y, dt);
        SVector::from_fn(|i, _| made[self.n + i])
    }
    fn output(&self, t: Traced, x: &SVector<Traced, N>, u: &SVector<Traced, MAX_INPUTS>) -> Traced {
        let made = self.call(t, x.as_slice(), u.as_slice(), Traced::ZERO, Traced::ZERO);
        made[2 * self.n]
    }
}

/// A model of the reduced-order observer.
#[derive(Clone, Copy)]
struct OwnStrictFeedback {
    function: usize,
    n_u: usize,
}

impl OwnStrictFeedback {
    /// f₁, g and f₂; f₁ and g do not depend on z.
    fn call(&self, t: Traced, x: &[Traced], z: &[Traced], u: &[Traced]) -> Vec<Traced> {
        call(self.function, &[&[t], x, z, &u[..self.n_u]].concat())
    }
}

impl<const NX: usize, const NZ: usize> StrictFeedback<Traced, NX, NZ, MAX_INPUTS>
    for OwnStrictFeedback
{
    fn f1(
        &self,
        t: Traced,
        x: &SVector<Traced, NX>,
        u: &SVector<Traced, MAX_INPUTS>,
    ) -> SVector<Traced, NX> {
        let made = self.call(t, x.as_slice(), &[Traced::ZERO; NZ], u.as_slice());
        SVector::from_fn(|i, _| made[i])
    }
    fn g(
        &self,
        t: Traced,
        x: &SVector<Traced, NX>,
        u: &SVector<Traced, MAX_INPUTS>,
    ) -> SMatrix<Traced, NX, NZ> {
        let made = self.call(t, x.as_slice(), &[Traced::ZERO; NZ], u.as_slice());
        SMatrix::from_fn(|i, j| made[NX + i * NZ + j])
    }
    fn f2(
        &self,
        t: Traced,
        x: &SVector<Traced, NX>,
        z: &SVector<Traced, NZ>,
        u: &SVector<Traced, MAX_INPUTS>,
    ) -> SVector<Traced, NZ> {
        let made = self.call(t, x.as_slice(), z.as_slice(), u.as_slice());
        SVector::from_fn(|i, _| made[NX + NX * NZ + i])
    }
}

/// What a step is made of.
struct Shape {
    n: usize,
    n_y: usize,
    n_u: usize,
    memory: usize,
    /// Entries of the memory without the time that current timing holds beside them.
    signals: usize,
    current: bool,
    initial: Vec<f64>,
}

/// An observer as tables.
pub struct Tables {
    shape: Shape,
    /// The use of a sample with current timing: (t, dt, z, y, u, parameters, gains) → (z⁺, innovation).
    correct: Option<Table>,
    /// The way to the next sample, of the same inputs: z⁺, and the innovation with predictor timing.
    advance: Table,
    /// What takes the sample (the correction with current timing, else the way to the next one) where
    /// the sample is missing, if that is another law.
    missing: Option<Table>,
    /// The same with and without a sample, for a law that has not started: the entry of its memory of
    /// this index is not positive.
    unstarted: Option<(usize, [Table; 2])>,
    /// For each chain whose eigenvalues are placed by gains that are inputs, these gains, in order.
    placed: Vec<PlacedChain>,
    /// A continuous law: (t, z, y, u, parameters) → ż, and z → z within the set that it lives in.
    law: Option<(Table, Table)>,
    parameters: Vec<f64>,
}

/// A chain whose corrections are placed.
struct PlacedChain {
    /// Which sample corrects it.
    channel: usize,
    /// Where the time stands in the memory that a correction is for, with current timing; else it is the
    /// step's length.
    elapsed: Option<usize>,
    gains: Arc<Gains>,
}

/// What an observer knows, as its spec says it.
enum Given<'py, 'a> {
    Paper(Option<Spec<'py>>),
    Own(Box<OwnModel>),
    /// Chain number `chain` of a model with several outputs.
    Chain(&'a OwnModel, usize),
}

impl<'py> Given<'py, '_> {
    fn read(spec: &Spec<'py>) -> PyResult<Self> {
        if spec.get("model")?.is_none() {
            return Ok(Self::Paper(None));
        }
        let model = spec.sub("model")?;
        if model.text("kind")? == "own" {
            return Ok(Self::Own(Box::new(OwnModel::read(&model)?)));
        }
        Ok(Self::Paper(Some(model)))
    }

    /// Number of known inputs.
    fn n_u(&self) -> PyResult<usize> {
        match self {
            Self::Paper(None) => Ok(0),
            Self::Paper(Some(model)) => Ok(usize::from(model.text("kind")? == "input")),
            Self::Own(own) => Ok(own.n_u),
            Self::Chain(own, _) => Ok(own.n_u),
        }
    }

    fn parameters(&self) -> &[f64] {
        match self {
            Self::Own(own) => &own.parameters,
            Self::Chain(own, _) => &own.parameters,
            Self::Paper(_) => &[],
        }
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
                if own.form != "phase" && own.form != "triangular" {
                    return Err(refused(&format!(
                        "a model of form {:?} does not fit this observer: it needs the phase-variable \
                         or the triangular form",
                        own.form
                    )));
                }
                let parameters = own.names().iter().map(|name| input(name)).collect();
                let function = trace::function(own.table.clone(), parameters);
                (Some(own.n), Known::Own { function, n_u: own.n_u })
            }
            Self::Chain(own, chain) => {
                let (n, n_u, chain) = (own.n, own.n_u, *chain);
                let shared = trace::function(Table::default(), inputs("shared", n));
                let parameters = own.names().iter().map(|name| input(name)).collect();
                let function = trace::function(own.table.clone(), parameters);
                let first = own.orders[..chain].iter().sum();
                let order = own.orders[chain];
                (Some(order), Known::Chain { function, shared, n_u, n, chain, first })
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

/// A half of a step of the observer that `build` makes within the trace: the use of a sample, or the
/// way to the next one.
fn half_table<O>(
    setting: Setting,
    n_u: usize,
    corrects: bool,
    build: impl FnOnce() -> PyResult<O>,
) -> PyResult<Table>
where
    O: Observer<Traced, Input: Memory<Traced>>,
{
    trace(setting, || {
        let (t, dt) = (input("t"), input("dt"));
        let mut z = O::State::read(&inputs("z", O::State::LEN));
        let y = O::Measurement::read(&inputs("y", O::Measurement::LEN));
        let u = O::Input::read(&inputs("u", n_u));
        let observer = build()?;
        let mut innovation = Vec::new();
        if corrects == (O::TIMING == Timing::Current) {
            innovation = flat(&observer.innovation(t, &z, &y, &u));
        }
        if corrects {
            observer.correct(&mut z, &y, t);
        } else {
            observer.advance(&mut z, &y, &u, t, dt);
        }
        Ok([named("z", &flat(&z)), named("innovation", &innovation)].concat())
    })
}

impl Tables {
    /// Of a continuous law.
    fn continuous(
        given: &Given<'_, '_>,
        setting: Setting,
        manner: Manner,
        law: &LawTables,
    ) -> PyResult<Self> {
        let current = manner.timing == Timing::Current;
        let memory = law.memory(manner.timing);
        let mut initial = law.initial.clone();
        initial.resize(memory, 0.0);
        let placed = matches!(manner.method, AnyMethod::Placed(_));
        let together = !current && !placed;
        Ok(Self {
            shape: Shape {
                n: law.n,
                n_y: 1,
                n_u: given.n_u()?,
                memory,
                signals: law.len,
                current,
                initial,
            },
            correct: law.correct(setting, manner)?,
            advance: law.advance(setting, manner)?,
            missing: None,
            unstarted: None,
            placed: law.gains().map_or_else(Vec::new, |gains| {
                let elapsed = current.then_some(law.len);
                vec![PlacedChain { channel: 0, elapsed, gains: gains.clone() }]
            }),
            law: if together { Some(law.together(setting)?) } else { None },
            parameters: given.parameters().to_vec(),
        })
    }
}

/// What a recursion of its own is made of.
fn shape<O>(n_u: usize, build: impl FnOnce() -> PyResult<O>) -> PyResult<Shape>
where
    O: Observer<Traced, Input: Memory<Traced>>,
{
    let mut initial = Vec::new();
    trace(Setting::usual(false), || {
        initial = flat(&build()?.initial()).into_iter().map(Scalar::to_f64).collect();
        Ok(Vec::new())
    })?;
    let (n, n_y, memory) = (O::ESTIMATED, O::Measurement::LEN, O::State::LEN);
    let current = O::TIMING == Timing::Current;
    Ok(Shape { n, n_y, n_u, memory, signals: memory, current, initial })
}

/// A gain that does not move.
fn constant<T: Scalar>(spec: &Spec<'_>) -> PyResult<ConstantGain<T>> {
    match AnyGain::read(spec)? {
        AnyGain::Constant(gain) => Ok(gain),
        AnyGain::Moving(_) => Err(refused("a gain that moves has no gains for a length alone")),
    }
}

fn standard<const N: usize>(
    spec: &Spec<'_>,
    given: &Given<'_, '_>,
    setting: Setting,
) -> PyResult<Tables> {
    spec.only(&["kind", "n", "k", "gain", "model", "method", "timing"])?;
    let (k, manner) = (spec.vector::<N>("k", N)?, Manner::read(spec)?);
    let gain = spec.sub("gain")?;
    macro_rules! law {
        ($gain:pat => $made:expr) => {
            LawTables::any(
                setting,
                manner,
                given.n_u()?,
                || {
                    let model = given.install(N)?;
                    let $gain = AnyGain::read(&gain)? else {
                        return Err(refused("another gain law"));
                    };
                    let k = k.map(Traced::from_f64);
                    Ok(StandardObserver::<Traced, _, _, N, MAX_INPUTS>::new(k, $made, model)?)
                },
                |at| {
                    let gain = constant(&gain)?;
                    Gains::new(
                        StandardObserver::<f64, _, _, N, 1>::new(k, gain, AnyModel::Unknown)?,
                        at,
                    )
                },
            )
        };
    }
    let law = if gain.text("law")? == "constant" {
        law!(AnyGain::Constant(gain) => gain)
    } else {
        law!(AnyGain::Moving(gain) => gain)
    };
    Tables::continuous(given, setting, manner, &law?)
}

/// The gains of placed corrections of a low-power law, which depend on no model.
fn low_power_gains<T: Scalar + Send + Sync, const N: usize>(
    spec: &Spec<'_>,
    at: Placement,
    saturated: bool,
) -> PyResult<Arc<Gains>> {
    let saturation = AnySaturation::<N, T>::read(spec, saturated)?;
    let [alpha, beta] = [spec.vector::<N>("alpha", N)?, spec.vector::<N>("beta", N - 1)?];
    let [alpha, beta] = [alpha, beta].map(|k| k.map(T::from_f64));
    let gain = constant(&spec.sub("gain")?)?;
    let law = LowPower::<T, _, _, _, N, 0>::new(alpha, beta, gain, Unknown, saturation)?;
    Gains::new::<T, _>(law, at)
}

fn low_power<const N: usize>(
    spec: &Spec<'_>,
    given: &Given<'_, '_>,
    setting: Setting,
    saturated: bool,
) -> PyResult<Tables> {
    let manner = Manner::read(spec)?;
    if matches!(given, Given::Own(own) if own.form == "triangular") {
        return Err(refused(
            "a triangular model is not allowed here: the low-power and the peaking-free observer \
             need a phase-variable model (known terms in the last equation only); use the standard \
             observer",
        ));
    }
    if matches!(manner.method, AnyMethod::Placed(_)) && spec.sub("gain")?.text("law")? != "constant"
    {
        return Err(refused(
            "method = 'zoh' or 'bilinear' is not allowed for this law with a model of one's own and a \
             gain that moves: choose a constant gain, the standard law, or rk4",
        ));
    }
    let (alpha, beta) = (spec.vector::<N>("alpha", N)?, spec.vector::<N>("beta", N - 1)?);
    let gain = spec.sub("gain")?;
    macro_rules! law {
        ($gain:pat => $made:expr) => {
            LawTables::any(
                setting,
                manner,
                given.n_u()?,
                || {
                    let model = given.install(N)?;
                    let saturation = AnySaturation::<N, Traced>::read(spec, saturated)?;
                    let $gain = AnyGain::read(&gain)? else {
                        return Err(refused("another gain law"));
                    };
                    let [alpha, beta] = [alpha, beta].map(|k| k.map(Traced::from_f64));
                    Ok(LowPower::<Traced, _, _, _, N, MAX_INPUTS>::new(
                        alpha, beta, $made, model, saturation,
                    )?)
                },
                |at| match setting.single {
                    true => low_power_gains::<f32, N>(spec, at, saturated),
                    false => low_power_gains::<f64, N>(spec, at, saturated),
                },
            )
        };
    }
    let law = if gain.text("law")? == "constant" {
        law!(AnyGain::Constant(gain) => gain)
    } else {
        law!(AnyGain::Moving(gain) => gain)
    };
    Tables::continuous(given, setting, manner, &law?)
}

fn collection<const C: usize>(
    spec: &Spec<'_>,
    given: &Given<'_, '_>,
    setting: Setting,
    modified: bool,
) -> PyResult<Tables> {
    const N: usize = 2;
    spec.only(&["kind", "n", "k", "k_bar", "copies", "gain", "model", "method", "timing"])?;
    let (k, k_bar) = (spec.vector::<N>("k", N)?, spec.vector::<N>("k_bar", N)?);
    let (gain, manner) = (spec.sub("gain")?, Manner::read(spec)?);
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
    let n_u = given.n_u()?;
    let law = if modified {
        let modified = || Ok(ModifiedObserver { collection: copies()? });
        LawTables::known(setting, manner, n_u, modified)?
    } else {
        LawTables::known(setting, manner, n_u, copies)?
    };
    Tables::continuous(given, setting, manner, &law)
}

/// Tables of a sampled-data observer that `build` makes.
fn sampled<O>(
    given: &Given<'_, '_>,
    setting: Setting,
    build: impl Fn() -> PyResult<O>,
) -> PyResult<Tables>
where
    O: Observer<Traced>,
    O::Input: Memory<Traced>,
{
    let n_u = given.n_u()?;
    let advance = |present| half_table(Setting { present, ..setting }, n_u, false, &build);
    Ok(Tables {
        shape: shape(n_u, &build)?,
        correct: None,
        advance: advance(true)?,
        missing: Some(advance(false)?),
        unstarted: None,
        placed: Vec::new(),
        law: None,
        parameters: given.parameters().to_vec(),
    })
}

fn own_sampled<const N: usize>(
    given: &Given<'_, '_>,
    own: &OwnModel,
    setting: Setting,
) -> PyResult<Tables> {
    if own.form != "sampled" {
        return Err(refused(
            "the sampled-data observer needs a model of sampled-data form: f, K_T and h",
        ));
    }
    sampled(given, setting, || {
        let parameters = own.names().iter().map(|name| input(name)).collect();
        let function = trace::function(own.table.clone(), parameters);
        let model = OwnSampled { function, n: own.n, n_u: own.n_u };
        Ok(SampledDataObserver::<_, N, MAX_INPUTS> { model })
    })
}

fn own_reduced_order<const NX: usize, const NZ: usize>(
    spec: &Spec<'_>,
    given: &Given<'_, '_>,
    own: &OwnModel,
    setting: Setting,
) -> PyResult<Tables> {
    let n_u = own.n_u;
    reduced_order::<_, NX, NZ, MAX_INPUTS>(spec, given, n_u, setting, || {
        let parameters = own.names().iter().map(|name| input(name)).collect();
        Ok(OwnStrictFeedback { function: trace::function(own.table.clone(), parameters), n_u })
    })
}

/// Tables of a reduced-order observer with the model that `model` makes.
fn reduced_order<Md, const NX: usize, const NZ: usize, const M: usize>(
    spec: &Spec<'_>,
    given: &Given<'_, '_>,
    n_u: usize,
    setting: Setting,
    model: impl Fn() -> PyResult<Md>,
) -> PyResult<Tables>
where
    Md: StrictFeedback<Traced, NX, NZ, M>,
{
    let (h_bar, epsilon) = (spec.vector::<NZ>("h_bar", NZ)?, spec.f64("epsilon")?);
    let build = || -> PyResult<ReducedOrderObserver<Traced, Md, NX, NZ, M>> {
        let h_bar = h_bar.map(Traced::from_f64);
        Ok(ReducedOrderObserver::new(h_bar, Traced::from_f64(epsilon), model()?)?)
    };
    let correct = |started, present| {
        let answer = Some(if started { Ordering::Greater } else { Ordering::Equal });
        half_table(Setting { present, answer, ..setting }, n_u, true, &build)
    };
    Ok(Tables {
        shape: shape(n_u, &build)?,
        correct: Some(correct(true, true)?),
        advance: half_table(setting, n_u, false, &build)?,
        missing: Some(correct(true, false)?),
        unstarted: Some((NZ + NX + M, [correct(false, true)?, correct(false, false)?])),
        placed: Vec::new(),
        law: None,
        parameters: given.parameters().to_vec(),
    })
}

impl Tables {
    /// Of the observer that a spec describes.
    pub fn read(spec: &Spec<'_>, setting: Setting) -> PyResult<Self> {
        if spec.text("kind")? == "chains" {
            return Self::of_chains(spec, setting);
        }
        Self::of(spec, &Given::read(spec)?, setting)
    }

    /// Of an observer of several outputs: one observer for each chain, which takes the states of the
    /// other chains as they stand at the beginning of a step.
    fn of_chains(spec: &Spec<'_>, setting: Setting) -> PyResult<Self> {
        spec.only(&["kind", "observers", "model"])?;
        let own = OwnModel::read(&spec.sub("model")?)?;
        if own.form != "chains" {
            return Err(refused("an observer of several outputs needs a model of chains"));
        }
        let specs = spec.list("observers")?;
        if specs.len() > CHAINS {
            return Err(refused(&format!(
                "{} outputs are not allowed: 1 to {CHAINS}",
                specs.len()
            )));
        }
        if specs.len() != own.orders.len() {
            return Err(refused(&format!(
                "{} observers do not fit a model of {} chains",
                specs.len(),
                own.orders.len()
            )));
        }
        let chains: Vec<Self> = specs
            .iter()
            .enumerate()
            .map(|(chain, spec)| Self::of(spec, &Given::Chain(&own, chain), setting))
            .collect::<PyResult<_>>()?;
        if chains.iter().any(|of| of.shape.current != chains[0].shape.current) {
            return Err(refused("the observers of a model of chains must have the same timing"));
        }
        // the memory: the estimates of all chains, then the rest of each
        let mut place = Vec::new();
        let (mut x, mut rest) = (0, own.n);
        for of in &chains {
            let Shape { n, memory, .. } = of.shape;
            place.push((x..x + n).chain(rest..rest + memory - n).collect::<Vec<usize>>());
            (x, rest) = (x + n, rest + memory - n);
        }
        let mut initial = vec![0.0; rest];
        for (of, place) in chains.iter().zip(&place) {
            place.iter().zip(&of.shape.initial).for_each(|(place, value)| initial[*place] = *value);
        }
        let placed = chains.iter().zip(&place).enumerate().flat_map(|(channel, (of, place))| {
            of.placed.iter().map(move |PlacedChain { elapsed, gains, .. }| PlacedChain {
                channel,
                elapsed: elapsed.map(|elapsed| place[elapsed]),
                gains: gains.clone(),
            })
        });
        let placed = placed.collect();
        let joined = |half: &dyn Fn(&Self) -> Table| {
            trace(setting, || {
                let (t, dt) = (input("t"), input("dt"));
                let (z, y) = (inputs("z", rest), inputs("y", chains.len()));
                let u = inputs("u", own.n_u);
                let parameters: Vec<Traced> = own.names().iter().map(|name| input(name)).collect();
                let (mut moved, mut innovation) = (z.clone(), Vec::new());
                for (chain, ((of, place), y)) in chains.iter().zip(&place).zip(&y).enumerate() {
                    let memory: Vec<Traced> = place.iter().map(|place| z[*place]).collect();
                    let count = of.placed.first().map_or(0, |placed| placed.gains.count);
                    let gains = inputs(&format!("gains{chain}"), count);
                    let (memory, shared) = (memory.as_slice(), &z[..own.n]);
                    let given = [&[t, dt], memory, &[*y], &u, shared, &parameters, &gains];
                    let made = trace::inline(&half(of), &given.concat());
                    place.iter().zip(&made).for_each(|(place, value)| moved[*place] = *value);
                    innovation.extend_from_slice(&made[memory.len()..]);
                }
                Ok([named("z", &moved), named("innovation", &innovation)].concat())
            })
        };
        let corrects = chains.iter().all(|of| of.correct.is_some());
        let correct = if corrects {
            Some(joined(&|of| of.correct.clone().unwrap_or_default())?)
        } else {
            None
        };
        let advance = joined(&|of| of.advance.clone())?;
        let current = chains.first().is_some_and(|of| of.shape.current);
        let (n, n_y, n_u, memory) = (own.n, chains.len(), own.n_u, rest);
        let shape = Shape { n, n_y, n_u, memory, signals: memory, current, initial };
        Ok(Self {
            shape,
            correct,
            advance,
            missing: None,
            unstarted: None,
            placed,
            law: None,
            parameters: own.parameters,
        })
    }

    fn of(spec: &Spec<'_>, given: &Given<'_, '_>, setting: Setting) -> PyResult<Self> {
        let kind = spec.text("kind")?;
        if kind == "sampled-data" {
            spec.only(&["kind", "model", "gain"])?;
            if let Given::Own(own) = given {
                return dispatch_order!(own.n, N => own_sampled::<N>(given, own, setting),
                                       else Err(order_refused(own.n)));
            }
            let correction = match spec.text_or("gain", "derived")?.as_str() {
                "printed" => Correction::Printed,
                _ => Correction::Derived,
            };
            return sampled(given, setting, || {
                let model = read_van_der_pol::<Traced>(&spec.sub("model")?, correction)?;
                Ok(SampledDataObserver::<_, 2, 0> { model })
            });
        }
        if kind == "reduced-order" {
            spec.only(&["kind", "model", "h_bar", "epsilon"])?;
            let Given::Own(own) = &given else {
                return reduced_order::<Ship<Traced>, 3, 3, 2>(spec, given, 2, setting, || {
                    read_ship(&spec.sub("model")?)
                });
            };
            if own.form != "strict-feedback" {
                return Err(refused("the reduced-order observer needs a strict-feedback model"));
            }
            macro_rules! sizes {
                ($(($x:literal, $z:literal)),+) => {
                    match (own.n, own.n_z) {
                        $(($x, $z) => own_reduced_order::<$x, $z>(spec, given, own, setting),)+
                        (n_x, n_z) => Err(refused(&format!(
                            "{n_x} measured and {n_z} unmeasured states are not allowed: the \
                             reduced-order observer takes 1 to 4, and no more unmeasured than measured"
                        ))),
                    }
                };
            }
            return sizes! {
                (1, 1), (2, 1), (2, 2), (3, 1), (3, 2), (3, 3), (4, 1), (4, 2), (4, 3), (4, 4)
            };
        }
        let n = spec.count("n")?;
        match kind.as_str() {
            "standard" => {
                dispatch_order!(n, N => standard::<N>(spec, given, setting),
                                else Err(order_refused(n)))
            }
            "low-power" | "peaking-free" => {
                let saturated = kind == "peaking-free";
                dispatch_order!(n, N => low_power::<N>(spec, given, setting, saturated),
                                else Err(order_refused(n)))
            }
            "collection" | "modified" => {
                let modified = kind == "modified";
                match spec.count("copies")? {
                    2 => collection::<2>(spec, given, setting, modified),
                    3 => collection::<3>(spec, given, setting, modified),
                    4 => collection::<4>(spec, given, setting, modified),
                    5 => collection::<5>(spec, given, setting, modified),
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

/// A step of an observer, or a half of it, as a program, with registers in which constants and
/// parameters stand.
struct Step {
    compiled: Compiled,
    at_rest: Registers<f64>,
    /// Where among the outputs the memory stands that a record shows; the first are the next memory.
    shown: usize,
    /// Whether an entry of the memory is handed on to a later one: it must be read before its place is
    /// written.
    hands_on: bool,
}

/// A step in all its forms.
pub struct Steps<S> {
    usual: Arc<S>,
    /// The same for a missing sample, if that is another law.
    missing: Option<Arc<S>>,
    /// The same with and without a sample for a law that has not started, see [`Tables::unstarted`].
    unstarted: Option<(usize, [Arc<S>; 2])>,
}

impl<S> Steps<S> {
    /// The step for such a sample.
    pub fn choose(&self, memory: &[f64], present: bool) -> &Arc<S> {
        if let Some((index, [with, without])) = &self.unstarted
            && memory.get(*index).is_some_and(|entry| *entry <= 0.0)
        {
            return if present { with } else { without };
        }
        match &self.missing {
            Some(missing) if !present => missing,
            _ => &self.usual,
        }
    }
}

/// An observer whose step is a program.
pub struct Programmed {
    tables: Tables,
    /// From sample to sample of a record; with current timing a correction, shown, and the way on.
    whole: Steps<Step>,
    /// The halves: the use of a sample with current timing, and the way to the next one.
    correct: Option<Steps<Step>>,
    advance: Steps<Step>,
}

/// An observer with a model of the user's own.
pub fn build(spec: &Spec<'_>) -> PyResult<Box<dyn AnyObserver>> {
    let setting = Setting { gains: PlacedGains::Given, ..Setting::usual(false) };
    let tables = Tables::read(spec, setting)?;
    let calls = |table: &Table| !table.calls.is_empty();
    if calls(&tables.advance) || tables.correct.as_ref().is_some_and(calls) {
        let (correct, advance) = tables.halves(|table| Ok(table.clone()))?;
        return Ok(Box::new(Called::new(tables, correct, advance)));
    }
    let (correct, advance) = tables.halves(|table| tables.program(table, 0))?;
    let whole = match &tables.correct {
        None => tables.forms(&tables.advance, |table| tables.program(table, 0))?,
        Some(correct) => tables.forms(correct, |correct| {
            tables.program(&tables.whole(correct)?, correct.outputs.len())
        })?,
    };
    Ok(Box::new(Programmed { tables, whole, correct, advance }))
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
    /// Entries of the memory that studies have metrics of.
    pub fn signals(&self) -> usize {
        self.shape.signals
    }
    pub fn is_current(&self) -> bool {
        self.shape.current
    }
    /// The use of a sample with current timing.
    pub fn correct(&self) -> Option<&Table> {
        self.correct.as_ref()
    }
    /// What takes a sample that is there, or one that is missing, whether the law has started or not: the
    /// correction with current timing, else the way to the next sample.
    pub fn taking(&self, missing: bool, single: bool) -> PyResult<Table> {
        let usual = self.correct.as_ref().unwrap_or(&self.advance);
        let usual = self.missing.as_ref().filter(|_| missing).unwrap_or(usual);
        let Some((index, unstarted)) = &self.unstarted else { return Ok(usual.clone()) };
        trace(Setting::usual(single), || {
            let given: Vec<Traced> = usual.inputs.iter().map(|name| input(name)).collect();
            let made = trace::inline(usual, &given);
            let first = trace::inline(&unstarted[usize::from(missing)], &given);
            let started = given[MEMORY + index];
            let chosen = made.iter().zip(&first);
            let chosen: Vec<Traced> =
                chosen.map(|(a, b)| trace::if_positive(started, *a, *b)).collect();
            Ok(usual.output_names.iter().cloned().zip(chosen).collect())
        })
    }
    /// The way to the next sample after a period that no sample has ended, as [`Observer::predict`]: a law
    /// that closes its periods by samples closes that one first, and holds its estimate where the model has
    /// no value.
    fn predict(&self, single: bool) -> PyResult<Table> {
        let advance = &self.advance;
        let Some((index, _)) = self.unstarted else { return Ok(advance.clone()) };
        let closing = self.taking(true, single)?;
        trace(Setting::usual(single), || {
            let given: Vec<Traced> = advance.inputs.iter().map(|name| input(name)).collect();
            let memory = MEMORY..MEMORY + self.shape.memory;
            let mut closed = given.clone();
            let made = trace::inline(&closing, &given);
            let mut spoilt = Traced::NEG_ZERO; // or NaN
            made.iter().take(self.shape.n).for_each(|entry| spoilt += *entry - *entry);
            let made = made.iter().zip(&given[memory.clone()]);
            closed[memory.clone()].iter_mut().zip(made).for_each(|(closed, (made, before))| {
                *closed = trace::if_equal([spoilt, spoilt], *made, *before);
            });
            let open = given[memory][index + 1]; // length of the period
            let (usual, late) = (trace::inline(advance, &given), trace::inline(advance, &closed));
            let chosen = usual.iter().zip(&late);
            let chosen: Vec<Traced> =
                chosen.map(|(usual, late)| trace::if_positive(open, *late, *usual)).collect();
            Ok(advance.output_names.iter().cloned().zip(chosen).collect())
        })
    }
    /// The way to the next sample.
    pub fn advance(&self) -> &Table {
        &self.advance
    }
    /// Rate and admissible set of a continuous law.
    pub fn law(&self) -> Option<&(Table, Table)> {
        self.law.as_ref()
    }
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// A correction and the way on as one step: (next memory, innovation, memory after the correction).
    fn whole(&self, correct: &Table) -> PyResult<Table> {
        let m = self.shape.memory;
        trace(Setting::usual(false), || {
            let given: Vec<Traced> = correct.inputs.iter().map(|name| input(name)).collect();
            let corrected = trace::inline(correct, &given);
            let mut on = given;
            on[MEMORY..MEMORY + m].copy_from_slice(&corrected[..m]);
            let next = trace::inline(&self.advance, &on);
            let (z, innovation) = corrected.split_at(m);
            Ok([named("z", &next), named("innovation", innovation), named("shown", z)].concat())
        })
    }

    /// The halves of a step, as `make` makes them of their tables: the use of a sample with current
    /// timing, and the way to the next one.
    fn halves<S>(
        &self,
        make: impl Fn(&Table) -> PyResult<S>,
    ) -> PyResult<(Option<Steps<S>>, Steps<S>)> {
        let Some(correct) = &self.correct else {
            return Ok((None, self.forms(&self.advance, make)?));
        };
        let usual = Arc::new(make(&self.advance)?);
        let advance = Steps { usual, missing: None, unstarted: None };
        Ok((Some(self.forms(correct, make)?), advance))
    }

    /// What `make` makes of a table that takes the sample, in all forms that it has.
    fn forms<S>(&self, usual: &Table, make: impl Fn(&Table) -> PyResult<S>) -> PyResult<Steps<S>> {
        let step = |table: &Table| Ok::<_, PyErr>(Arc::new(make(table)?));
        let unstarted = match &self.unstarted {
            None => None,
            Some((index, [with, without])) => Some((*index, [step(with)?, step(without)?])),
        };
        let missing = self.missing.as_ref().map(step).transpose()?;
        Ok(Steps { usual: step(usual)?, missing, unstarted })
    }

    /// The program of a step.
    fn program(&self, table: &Table, shown: usize) -> PyResult<Step> {
        let (compiled, m) = (table.compile()?, self.shape.memory);
        let of = |from: usize| compiled.outputs.iter().skip(from).take(m);
        let next = (MEMORY..).zip(of(0).zip(of(shown)));
        let before = |place, of: &u8| (MEMORY..place).contains(&usize::from(*of));
        let hands_on = { next }.any(|(place, (a, b))| before(place, a) || before(place, b));
        Ok(Step { at_rest: self.at_rest(&compiled), compiled, shown, hands_on })
    }

    /// Memory to start from when nothing is known.
    pub fn initial(&self) -> &[f64] {
        &self.shape.initial
    }

    /// The inputs of a step: (t, dt, z, y, u, parameters, gains).
    pub fn inputs(
        &self,
        memory: &[f64],
        (y, u): (&[f64], &[f64]),
        (t, dt): (f64, f64),
    ) -> Vec<f64> {
        let mut inputs = [&[t, dt], memory, y, u, self.parameters.as_slice()].concat();
        for placed in &self.placed {
            let (first, gains) = (inputs.len(), &placed.gains);
            inputs.resize(first + gains.count, 0.0);
            gains.write(f64::from_bits(length_of(placed, memory, y, dt)), &mut inputs[first..]);
        }
        inputs
    }

    /// Inputs of a step before its parameters.
    fn given(&self) -> usize {
        let Shape { memory, n_y, n_u, .. } = self.shape;
        2 + memory + n_y + n_u
    }

    /// Registers of the step's program before a run.
    fn at_rest<T: Scalar>(&self, step: &Compiled) -> Registers<T> {
        let mut registers = step.registers();
        let places = registers.0.iter_mut().skip(self.given());
        places.zip(&self.parameters).for_each(|(place, value)| *place = T::from_f64(*value));
        registers
    }
}

/// Where the memory stands among the inputs of a step.
const MEMORY: usize = 2;

impl Step {
    /// Evaluate for a sample; the memory stands in the registers and is moved there, unless it would
    /// not be finite any more. What is shown goes to a row, as in [`keep`].
    #[inline(always)]
    fn advance(
        &self,
        r: &mut Registers<f64>,
        memory: usize,
        (t, dt): (f64, f64),
        (y, u): (&[f64], &[f64]),
        (row, largest): (&mut [f64], &mut [f64]),
    ) -> bool {
        (r.0[0], r.0[1]) = (t, dt);
        let given = r.0.get_mut(MEMORY + memory..).unwrap_or_default();
        given.iter_mut().zip(y).for_each(|(slot, y)| *slot = *y);
        let given = given.get_mut(y.len()..).unwrap_or_default();
        given.iter_mut().zip(u).for_each(|(slot, u)| *slot = *u);
        self.compiled.program().run(r);
        let next = self.compiled.outputs.get(..memory).unwrap_or(&[]);
        let shown = self.compiled.outputs.get(self.shown..self.shown + memory).unwrap_or(&[]);
        let mut spoilt = 0.0;
        for output in next {
            spoilt += 0.0 * r.0[usize::from(*output)];
        }
        let moved = !spoilt.is_nan();
        if moved && !self.hands_on {
            // at once: a number that was just written is soon read again as it was written, by itself
            for (i, (output, shown)) in next.iter().zip(shown).enumerate() {
                let (value, shown) = (r.0[usize::from(*output)], r.0[usize::from(*shown)]);
                if let Some(place) = r.0.get_mut(MEMORY + i) {
                    *place = value;
                }
                keep(shown, row.get_mut(i), largest.get_mut(i));
            }
            return true;
        }
        let numbers = |outputs: &[u8], r: &Registers<f64>| -> Vec<f64> {
            outputs.iter().map(|output| r.0[usize::from(*output)]).collect()
        };
        let (next, shown) = (numbers(next, r), numbers(shown, r));
        let taken = self.shown > 0 && shown.iter().all(|value| value.is_finite());
        if moved {
            r.0[MEMORY..MEMORY + memory].copy_from_slice(&next);
        } else if taken {
            // the sample was taken, the way on has no value
            r.0[MEMORY..MEMORY + memory].copy_from_slice(&shown);
        }
        if moved || taken {
            for (i, value) in shown.iter().enumerate() {
                keep(*value, row.get_mut(i), largest.get_mut(i));
            }
        } else {
            show(r, row, largest);
        }
        moved
    }
}

impl Programmed {
    /// The times that a sample's corrections are for.
    fn lengths(&self, memory: &[f64], y: &[f64], dt: f64) -> Lengths {
        let mut lengths = [0; CHAINS];
        for (length, placed) in lengths.iter_mut().zip(&self.tables.placed) {
            *length = length_of(placed, memory, y, dt);
        }
        lengths
    }

    /// Whether these are they.
    #[inline(always)]
    fn are_lengths(&self, known: &Lengths, memory: &[f64], y: &[f64], dt: f64) -> bool {
        let mut chains = known.iter().zip(&self.tables.placed);
        chains.all(|(known, placed)| *known == length_of(placed, memory, y, dt))
    }

    /// Gains for corrections of these lengths into their registers.
    fn put_gains(&self, lengths: &Lengths, r: &mut Registers<f64>) {
        let mut place = self.tables.given() + self.tables.parameters.len();
        for (length, PlacedChain { gains, .. }) in lengths.iter().zip(&self.tables.placed) {
            if let Some(registers) = r.0.get_mut(place..place + gains.count) {
                gains.write(f64::from_bits(*length), registers);
            }
            place += gains.count;
        }
    }

    /// Step over a block with m entries of memory, at best a number that the compiler knows.
    #[inline(always)]
    fn advance_by(&self, m: usize, memory: &mut [f64], block: Block<'_>) -> f64 {
        match self.tables.shape {
            Shape { n_y: 1, n_u: 0, .. } => self.advance_with(m, (1, 0), memory, block),
            Shape { n_y, n_u, .. } => self.advance_with(m, (n_y, n_u), memory, block),
        }
    }

    /// The same with p entries of a sample and q inputs.
    #[inline(always)]
    fn advance_with(
        &self,
        m: usize,
        (p, q): (usize, usize),
        memory: &mut [f64],
        block: Block<'_>,
    ) -> f64 {
        let Block { t, dt, mut y, u, memory: rows, innovation, status: made } = block;
        let current = self.tables.shape.current;
        let place = MEMORY..MEMORY + m;
        let one = self.whole.missing.is_none() && self.whole.unstarted.is_none();
        let mut lengths: Option<Lengths> = None;
        let mut step = self.whole.choose(memory, true).clone();
        let mut r = step.at_rest;
        r.0[place.clone()].copy_from_slice(memory);
        let mut largest = [0.0_f64; REGISTERS];
        if !current {
            show(&r, rows.get_mut(..m).unwrap_or_default(), &mut largest);
        }
        for (k, made) in made.iter_mut().enumerate() {
            let shown = k + usize::from(!current); // before the next sample, or after this one
            let row = rows.get_mut(shown * m..(shown + 1) * m).unwrap_or_default();
            let sample = y.take(k, p);
            let present = sample.iter().all(|y| y.is_finite());
            // a record's last sample: nothing comes after it
            let last = dt.get(k).is_none();
            if last && !current {
                *made = status(true, present) as u8;
                if let Some(slots) = innovation.get_mut(k * p..(k + 1) * p) {
                    self.told(
                        &step,
                        &mut r.clone(),
                        (t[k], 1.0),
                        (sample, &u[k * q..(k + 1) * q]),
                        slots,
                    );
                }
                continue;
            }
            if !one || last {
                let steps = self.correct.as_ref().filter(|_| last).unwrap_or(&self.whole);
                let wanted = steps.choose(&r.0[place.clone()], present);
                if !Arc::ptr_eq(wanted, &step) {
                    let mut fresh = wanted.at_rest;
                    fresh.0[place.clone()].copy_from_slice(&r.0[place.clone()]);
                    (step, r, lengths) = (wanted.clone(), fresh, None);
                }
            }
            let dt = dt.get(k).copied().unwrap_or(0.0);
            if !self.tables.placed.is_empty() {
                let memory = &r.0[place.clone()];
                if !lengths.is_some_and(|known| self.are_lengths(&known, memory, sample, dt)) {
                    let new = self.lengths(memory, sample, dt);
                    self.put_gains(&new, &mut r);
                    lengths = Some(new);
                }
            }
            let given = (sample, &u[k * q..(k + 1) * q]);
            let moved = step.advance(&mut r, m, (t[k], dt), given, (row, &mut largest));
            *made = status(moved, present) as u8;
            if let Some(slots) = innovation.get_mut(k * p..(k + 1) * p) {
                for (slot, output) in slots.iter_mut().zip(&step.compiled.outputs[m..]) {
                    *slot = r.0[usize::from(*output)];
                }
            }
        }
        memory.copy_from_slice(&r.0[place]);
        largest.iter().fold(0.0, |most: f64, value| most.max(*value))
    }

    /// The innovation of a sample over which nothing is stepped.
    fn told(
        &self,
        step: &Step,
        r: &mut Registers<f64>,
        of: (f64, f64),
        given: (&[f64], &[f64]),
        slots: &mut [f64],
    ) {
        let m = self.tables.shape.memory;
        step.advance(r, m, of, given, (&mut [], &mut []));
        for (slot, output) in slots.iter_mut().zip(&step.compiled.outputs[m..]) {
            *slot = r.0[usize::from(*output)];
        }
    }

    /// One half of a step for one sample.
    fn one(
        &self,
        steps: &Steps<Step>,
        memory: &mut [f64],
        (y, u): (&[f64], &[f64]),
        (t, dt): (f64, f64),
    ) -> Status {
        let present = y.iter().all(|y| y.is_finite());
        let step = steps.choose(memory, present);
        let mut r = step.at_rest;
        self.put_gains(&self.lengths(memory, y, dt), &mut r);
        r.0[MEMORY..MEMORY + memory.len()].copy_from_slice(memory);
        let moved = step.advance(&mut r, memory.len(), (t, dt), (y, u), (memory, &mut []));
        status(moved, present)
    }
}

/// The time that a chain's correction is for, in bits; with current timing none for a missing sample.
#[inline(always)]
fn length_of(placed: &PlacedChain, memory: &[f64], y: &[f64], dt: f64) -> u64 {
    let elapsed = placed.elapsed.and_then(|place| memory.get(place)).copied();
    let sample = y.get(placed.channel).copied().unwrap_or(f64::NAN);
    elapsed.map_or(dt, |elapsed| elapsed - elapsed.while_missing(sample)).to_bits()
}

/// An entry of the memory into its place in a row, if there is one, and its largest magnitude so far.
#[inline(always)]
fn keep(value: f64, slot: Option<&mut f64>, largest: Option<&mut f64>) {
    let Some(slot) = slot else { return };
    *slot = value;
    if let Some(largest) = largest {
        *largest = if value.abs() > *largest { value.abs() } else { *largest };
    }
}

/// The memory into a row.
#[inline(always)]
fn show(r: &Registers<f64>, row: &mut [f64], largest: &mut [f64]) {
    for (i, value) in r.0.iter().skip(MEMORY).take(row.len()).enumerate() {
        keep(*value, row.get_mut(i), largest.get_mut(i));
    }
}

fn status(moved: bool, present: bool) -> Status {
    match (moved, present) {
        (false, _) => Status::ModelUndefined,
        (true, true) => Status::Updated,
        (true, false) => Status::Predicted,
    }
}

impl Recursion for Programmed {
    fn correct(&self, memory: &mut [f64], y: &[f64], t: f64) -> PyResult<Status> {
        let Some(correct) = &self.correct else {
            return Ok(status(true, y.iter().all(|y| y.is_finite())));
        };
        let u = [0.0; MAX_INPUTS];
        let u = u.get(..self.tables.shape.n_u).unwrap_or(&[]); // no correction depends on it
        Ok(self.one(correct, memory, (y, u), (t, 0.0)))
    }

    fn advance(
        &self,
        memory: &mut [f64],
        y: &[f64],
        u: &[f64],
        t: f64,
        dt: f64,
    ) -> PyResult<Status> {
        Ok(self.one(&self.advance, memory, (y, u), (t, dt)))
    }

    fn over_block(&self, memory: &mut [f64], block: Block<'_>) -> PyResult<f64> {
        Ok(match memory.len() {
            1 => self.advance_by(1, memory, block),
            2 => self.advance_by(2, memory, block),
            3 => self.advance_by(3, memory, block),
            4 => self.advance_by(4, memory, block),
            5 => self.advance_by(5, memory, block),
            6 => self.advance_by(6, memory, block),
            7 => self.advance_by(7, memory, block),
            8 => self.advance_by(8, memory, block),
            m => self.advance_by(m, memory, block),
        })
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

/// A part of the step of the observer that `spec` describes, as a table over (t, dt, z, y, u,
/// parameters, gains), without the inputs that the part does not take. "step", with predictor timing: (z
/// after the step, innovation). With current timing "correct", the use of a sample, of (t, z, y): (z,
/// innovation); and "predict", the way to the next one, of (t, dt, z, u): z. With `missing` the part that
/// takes the sample where it is missing. With `dt`, corrections that are placed (zoh, bilinear) are right
/// for times of this length only; with `held`, those of their gains that no operations compute are
/// inputs, see [`placed_gains`].
#[pyfunction]
#[pyo3(signature = (spec, single=false, missing=false, dt=None, part="step", held=false))]
pub fn trace_step<'py>(
    py: Python<'py>,
    spec: &Bound<'py, PyAny>,
    single: bool,
    missing: bool,
    dt: Option<f64>,
    part: &str,
    held: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let computed = if held { PlacedGains::Held } else { PlacedGains::Computed };
    let gains = dt.map_or(computed, PlacedGains::For);
    let setting = Setting { gains, ..Setting::usual(single) };
    let tables = Tables::read(&Spec::new(spec, "observer")?, setting)?;
    let Shape { memory, n_y, n_u, .. } = tables.shape;
    let y = MEMORY + memory..MEMORY + memory + n_y;
    let u = y.end..y.end + n_u;
    let table = match (part, &tables.correct) {
        ("step", None) => tables.taking(missing, single)?,
        ("correct", Some(_)) => {
            let step = MEMORY - 1; // its length
            tables.taking(missing, single)?.without_inputs(|i| i == step || u.contains(&i))
        }
        ("predict", Some(_)) => tables.predict(single)?.without_inputs(|i| y.contains(&i)),
        (other, correct) => {
            let parts = if correct.is_some() { "correct or predict" } else { "step" };
            return Err(refused(&format!("part = {other:?} is not allowed: {parts}")));
        }
    };
    table.to_dict(py)
}

/// Gains for corrections that are for times of these lengths, as [`trace_step`] takes them with `held`:
/// for each chain that takes any, which sample corrects it, where its time stands in the memory (with
/// current timing; else it is the step's length), and a row of gains for each length.
#[pyfunction]
#[pyo3(signature = (spec, lengths, single=false))]
#[allow(clippy::needless_pass_by_value)]
pub fn placed_gains(
    spec: &Bound<'_, PyAny>,
    lengths: Vec<f64>,
    single: bool,
) -> PyResult<Vec<(usize, Option<usize>, Vec<Vec<f64>>)>> {
    let setting = Setting { gains: PlacedGains::Held, ..Setting::usual(single) };
    let tables = Tables::read(&Spec::new(spec, "observer")?, setting)?;
    let of_chain = |PlacedChain { channel, elapsed, gains }: &PlacedChain| {
        let row = |length: &f64| {
            let mut row = vec![0.0; gains.count];
            gains.write(*length, &mut row);
            row
        };
        (*channel, *elapsed, lengths.iter().map(row).collect())
    };
    Ok(tables.placed.iter().map(of_chain).collect())
}

/// Memories along a record in single precision: times (N,), samples (N, n_y), inputs (N, n_u), memory
/// to start from. Row k stands before sample k, or after it if the law filters.
#[pyfunction]
#[allow(clippy::cast_possible_truncation, clippy::needless_pass_by_value)]
pub fn run_single(
    spec: &Bound<'_, PyAny>,
    t: Vec<f64>,
    y: &Bound<'_, PyAny>,
    u: &Bound<'_, PyAny>,
    memory0: Vec<f64>,
) -> PyResult<Vec<Vec<f32>>> {
    let tables = Tables::read(&Spec::new(spec, "observer")?, Setting::usual(true))?;
    let Shape { memory, n_y, n_u, .. } = tables.shape;
    let (y, u) = (super::spec::numbers(y)?.values, super::spec::numbers(u)?.values);
    let samples = t.len();
    if y.len() != samples * n_y || u.len() != samples * n_u || memory0.len() != memory {
        let message = "t, y, u and memory0 must have N, N n_y, N n_u and m entries";
        return Err(refused(message));
    }
    let compile = |table: &Table| {
        table.compile().map(|compiled| (tables.at_rest::<f32>(&compiled), compiled))
    };
    let correct = tables.correct.as_ref().map(compile).transpose()?;
    let advance = compile(&tables.advance)?;
    let missing = tables.missing.as_ref().map(compile).transpose()?;
    let unstarted = match &tables.unstarted {
        Some((index, [with, without])) => Some((*index, [compile(with)?, compile(without)?])),
        None => None,
    };
    let mut z: Vec<f32> = memory0.iter().map(|value| *value as f32).collect();
    let mut rows = Vec::with_capacity(samples);
    for k in 0..samples {
        let (y, u) = (&y[k * n_y..(k + 1) * n_y], &u[k * n_u..(k + 1) * n_u]);
        let present = y.iter().all(|y| y.is_finite());
        let take = |z: &[f32], usual| {
            let fresh = unstarted.as_ref().filter(|(index, _)| z[*index] <= 0.0);
            match fresh {
                Some((_, forms)) => &forms[usize::from(!present)],
                None => missing.as_ref().filter(|_| !present).unwrap_or(usual),
            }
        };
        let dt = t.get(k + 1).map(|next| (next - t[k]) as f32);
        let evaluate = |z: &mut Vec<f32>, of: &(Registers<f32>, Compiled), dt: f32| {
            let (at_rest, step) = of;
            let mut r = *at_rest;
            let sample = y.iter().chain(u).map(|value| *value as f32);
            let given = [t[k] as f32, dt].into_iter().chain(z.iter().copied()).chain(sample);
            r.0.iter_mut().zip(given).for_each(|(slot, value)| *slot = value);
            step.program().run(&mut r);
            let next = step.outputs.iter().take(memory).map(|output| r.0[usize::from(*output)]);
            let next: Vec<f32> = next.collect();
            if !next.iter().all(|value| value.is_finite()) {
                return Err(refused(&format!("the model has no value at sample {k}")));
            }
            *z = next;
            Ok(())
        };
        if let Some(correct) = &correct {
            let of = take(&z, correct);
            evaluate(&mut z, of, 0.0)?;
        }
        rows.push(z.clone());
        if let Some(dt) = dt {
            let of = if correct.is_some() { &advance } else { take(&z, &advance) };
            evaluate(&mut z, of, dt)?;
        }
    }
    Ok(rows)
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
