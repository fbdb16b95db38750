//! Studies whose plant or model is known at run time only.
//!
//! Blocks of runs go through programs. What only single runs give (frames, each run's own recorded
//! noise) goes through the loop of compiled plants and laws, with the tables behind their traits: the
//! same operations, and so the same bits.

use super::compile::Compiled;
use super::errors::refused;
use super::interrupt::{StopFlag, interruptible};
use super::plan::{AnySchedule, BlockOf, Plan, SAMPLED_ONLY, StudyResult, vectors};
use super::programs::Tables;
use super::spec::Spec;
use super::systems::AnyPlant;
use super::table::Table;
use super::trace::{self, PlacedGains, Setting, Traced, input, inputs, named, trace};
use crate::Scalar;
use crate::ensemble::Programs;
use crate::integrate::{Integrator, PlantScheme, WienerIncrement, plant_step};
use crate::lanes::LaneMetrics;
use crate::memory::Memory;
use crate::model::{Plant, StochasticIntegrator};
use crate::noise::Sine;
use crate::observer::{ContinuousLaw, Observer, Status, Timing};
use crate::program::Registers;
use crate::simulate::Experiment;
use crate::vectors::Task;
use nalgebra::SVector;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Room for a plant's state and for an observer's memory.
const X: usize = 12;
const Z: usize = 40;

type PlantState<T> = SVector<T, X>;
type NoInput<T> = SVector<T, 0>;

/// A plant of the user's own.
pub struct OwnPlant {
    pub n: usize,
    noisy: bool,
    /// (t, x, parameters) → (drift, diffusion if there is noise, output).
    table: Table,
    parameters: Vec<f64>,
    /// State i of a simulation is this one of the plant: those that the observer estimates come first.
    order: Vec<usize>,
}

impl OwnPlant {
    pub fn read(spec: &Spec<'_>) -> PyResult<Self> {
        spec.only(&["kind", "n", "n_u", "noisy", "table", "parameters", "names"])?;
        let (n, noisy) = (spec.count("n")?, spec.flag_or("noisy", false)?);
        if !(1..=X).contains(&n) {
            return Err(refused(&format!("n = {n} is not allowed: a plant has 1 to {X} states")));
        }
        let table = Table::read(&spec.sub("table")?)?;
        let parameters = spec.numbers("parameters")?.values;
        if let Some(bad) = parameters.iter().find(|value| !value.is_finite()) {
            return Err(refused(&format!("a parameter of the plant is {bad}; it must be finite")));
        }
        let (given, made) = (1 + n + parameters.len(), n + usize::from(noisy) * n + 1);
        if table.inputs.len() != given || table.outputs.len() != made {
            return Err(refused(&format!(
                "the plant's table has {} inputs and {} outputs; it must have {given} and {made}",
                table.inputs.len(),
                table.outputs.len()
            )));
        }
        Ok(Self { n, noisy, table, parameters, order: (0..n).collect() })
    }

    /// With the states first that an observer estimates.
    fn estimated(mut self, truth: &[usize]) -> PyResult<Self> {
        let twice = (1..truth.len()).any(|i| truth[..i].contains(&truth[i]));
        if twice || truth.iter().any(|i| *i >= self.n) {
            return Err(refused(&format!(
                "truth = {truth:?} is not allowed: it must name some of the plant's {} states, each \
                 once",
                self.n
            )));
        }
        let rest = (0..self.n).filter(|i| !truth.contains(i));
        self.order = truth.iter().copied().chain(rest).collect();
        Ok(self)
    }

    /// Drift, diffusion if there is noise, output: within a trace.
    fn call(&self, t: Traced, x: &[Traced]) -> Vec<Traced> {
        let mut given = vec![t; 1 + self.n];
        self.order.iter().zip(x).for_each(|(place, x)| given[1 + place] = *x);
        given.extend(self.parameters.iter().map(|value| Traced::from_f64(*value)));
        let made = trace::inline(&self.table, &given);
        let (rates, output) = made.split_at(made.len() - 1);
        let rows = rates.chunks_exact(self.n);
        let ordered = rows.flat_map(|row| self.order.iter().map(|place| row[*place]));
        ordered.chain(output.iter().copied()).collect()
    }
}

const DOUBLE: Setting =
    Setting { single: false, present: true, answer: None, gains: PlacedGains::Computed };

/// An own plant behind the trait of all plants: over traced numbers, its table is taken in.
#[derive(Clone, Copy)]
struct Tabled<'a>(&'a OwnPlant);

impl Tabled<'_> {
    fn outputs(self, t: Traced, x: &PlantState<Traced>) -> Vec<Traced> {
        self.0.call(t, &x.as_slice()[..self.0.n])
    }
    fn state(values: &[Traced]) -> PlantState<Traced> {
        PlantState::from_fn(|i, _| values.get(i).copied().unwrap_or(Traced::ZERO))
    }
}

impl Plant<Traced> for Tabled<'_> {
    type State = PlantState<Traced>;
    type Input = NoInput<Traced>;
    type Output = Traced;
    const TRUTH: (usize, usize) = (0, X);
    const NOISY: bool = true;
    fn drift(&self, t: Traced, x: &Self::State, _: &Self::Input) -> Self::State {
        Self::state(&self.outputs(t, x)[..self.0.n])
    }
    fn output(&self, t: Traced, x: &Self::State, _: &Self::Input) -> Traced {
        self.outputs(t, x).last().copied().unwrap_or_default()
    }
    fn truth<'a>(&self, x: &'a Self::State) -> &'a [Traced] {
        x.as_slice()
    }
    fn control(&self, _: Traced, _: &Self::State, _: Traced) -> Self::Input {
        crate::model::no_input()
    }
    fn has_process_noise(&self) -> bool {
        self.0.noisy
    }
    fn supports(&self, scheme: StochasticIntegrator) -> bool {
        self.0.noisy && scheme == StochasticIntegrator::EulerMaruyama
    }
    fn diffusion(&self, t: Traced, x: &Self::State, _: &Self::Input) -> Self::State {
        let n = self.0.n;
        if self.0.noisy { Self::state(&self.outputs(t, x)[n..2 * n]) } else { Self::State::zero() }
    }
}

/// The first error of a function that is called: the study ends by it.
#[derive(Default)]
struct Failure {
    occurred: AtomicBool,
    error: Mutex<Option<PyErr>>,
}

/// A function of single runs: a program, or a table with calls.
enum Part {
    Compiled(Compiled),
    Called(Table, Arc<Failure>),
}

impl Part {
    fn of(table: Table, failure: &Arc<Failure>) -> PyResult<Self> {
        if table.calls.is_empty() {
            return Ok(Self::Compiled(table.compile()?));
        }
        Ok(Self::Called(table, failure.clone()))
    }

    /// The outputs; NaN once a function has failed.
    fn evaluate(&self, inputs: &[f64]) -> Vec<f64> {
        let (table, failure) = match self {
            Self::Compiled(compiled) => return compiled.evaluate(inputs),
            Self::Called(table, failure) => (table, failure),
        };
        let nothing = || vec![f64::NAN; table.outputs.len()];
        if failure.occurred.load(Ordering::Relaxed) {
            return nothing();
        }
        table.evaluate(inputs).unwrap_or_else(|error| {
            failure.occurred.store(true, Ordering::Relaxed);
            let mut first = failure.error.lock().unwrap_or_else(PoisonError::into_inner);
            first.get_or_insert(error);
            nothing()
        })
    }
}

/// A plant as programs, for single runs.
#[derive(Clone, Copy)]
struct Evaluated<'a> {
    n: usize,
    noisy: bool,
    /// Whether it supports Euler-Maruyama, Milstein, the order 1.5 scheme.
    supports: [bool; 3],
    parts: &'a Parts<Part>,
}

/// The functions of a plant.
struct Parts<F> {
    /// (t, x) → ẋ.
    drift: F,
    /// (t, x) → y.
    output: F,
    /// (t, x) → b.
    diffusion: F,
    /// (t, x) → (∂b/∂x)·b.
    slope: F,
    /// (t, x, v) → (∂a/∂x)·v.
    jacobian_times: F,
    /// (t, x) → ∂a/∂t + ½ bᵀ(∂²a/∂x²)b.
    curvature: F,
}

impl Evaluated<'_> {
    fn state(part: &Part, given: &[&[f64]]) -> PlantState<f64> {
        PlantState::read(&part.evaluate(&given.concat()))
    }
    fn known<'a>(&self, x: &'a PlantState<f64>) -> &'a [f64] {
        &x.as_slice()[..self.n]
    }
}

impl Plant<f64> for Evaluated<'_> {
    type State = PlantState<f64>;
    type Input = NoInput<f64>;
    type Output = f64;
    const TRUTH: (usize, usize) = (0, X);
    const NOISY: bool = true;
    fn drift(&self, t: f64, x: &Self::State, _: &Self::Input) -> Self::State {
        Self::state(&self.parts.drift, &[&[t], self.known(x)])
    }
    fn output(&self, t: f64, x: &Self::State, _: &Self::Input) -> f64 {
        let given = [&[t], self.known(x)].concat();
        self.parts.output.evaluate(&given).first().copied().unwrap_or(f64::NAN)
    }
    fn truth<'a>(&self, x: &'a Self::State) -> &'a [f64] {
        self.known(x)
    }
    fn control(&self, _: f64, _: &Self::State, _: f64) -> Self::Input {
        crate::model::no_input()
    }
    fn has_process_noise(&self) -> bool {
        self.noisy
    }
    fn supports(&self, scheme: StochasticIntegrator) -> bool {
        self.supports[scheme as usize]
    }
    fn diffusion(&self, t: f64, x: &Self::State, _: &Self::Input) -> Self::State {
        Self::state(&self.parts.diffusion, &[&[t], self.known(x)])
    }
    fn diffusion_slope(&self, t: f64, x: &Self::State, _: &Self::Input) -> Self::State {
        Self::state(&self.parts.slope, &[&[t], self.known(x)])
    }
    fn jacobian_times(
        &self,
        t: f64,
        x: &Self::State,
        _: &Self::Input,
        v: &Self::State,
    ) -> Self::State {
        Self::state(&self.parts.jacobian_times, &[&[t], self.known(x), self.known(v)])
    }
    fn curvature(&self, t: f64, x: &Self::State, _: &Self::Input) -> Self::State {
        Self::state(&self.parts.curvature, &[&[t], self.known(x)])
    }
}

/// An observer as programs of (t, dt, z, y), for single runs.
#[derive(Clone, Copy)]
struct Recursion<'a, const CURRENT: bool> {
    correct: Option<&'a Part>,
    advance: &'a Part,
    n: usize,
    memory: usize,
}

impl<const CURRENT: bool> Recursion<'_, CURRENT> {
    fn moved(&self, of: &Part, z: &mut SVector<f64, Z>, y: f64, t: f64, dt: f64) -> Status {
        let mut given = vec![t, dt];
        given.extend_from_slice(&z.as_slice()[..self.memory]);
        given.push(y);
        let next = SVector::<f64, Z>::read(&of.evaluate(&given)[..self.memory]);
        if !next.within(f64::MAX) && z.within(f64::MAX) {
            return Status::ModelUndefined; // the memory is held
        }
        *z = next;
        Status::of(&y)
    }
}

impl<const CURRENT: bool> Observer<f64> for Recursion<'_, CURRENT> {
    type State = SVector<f64, Z>;
    type Measurement = f64;
    type Input = NoInput<f64>;
    const TIMING: Timing = if CURRENT { Timing::Current } else { Timing::Predictor };
    const ESTIMATED: usize = Z;
    fn initial(&self) -> Self::State {
        Self::State::zero()
    }
    fn correct(&self, z: &mut Self::State, y: &f64, t: f64) -> Status {
        self.correct.map_or(Status::of(y), |correct| self.moved(correct, z, *y, t, 0.0))
    }
    fn advance(&self, z: &mut Self::State, y: &f64, _: &Self::Input, t: f64, dt: f64) -> Status {
        self.moved(self.advance, z, *y, t, dt)
    }
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [f64] {
        &z.as_slice()[..self.n]
    }
    fn innovation(&self, _: f64, z: &Self::State, y: &f64, _: &Self::Input) -> f64 {
        *y - z[0]
    }
}

/// A continuous law as programs, for single runs that are integrated together with their plants. Its
/// innovation is the sample itself, from which the rate takes what it needs.
#[derive(Clone, Copy)]
struct Evolution<'a> {
    rate: &'a Part,
    admissible: &'a Part,
    n: usize,
    memory: usize,
}

impl ContinuousLaw<f64> for Evolution<'_> {
    type State = SVector<f64, Z>;
    type Input = NoInput<f64>;
    type Innovation = f64;
    const ESTIMATED: usize = Z;
    fn initial(&self) -> Self::State {
        Self::State::zero()
    }
    fn innovation(&self, _: &Self::State, y: f64) -> f64 {
        y
    }
    fn rate(&self, t: f64, z: &Self::State, y: &f64, _: &Self::Input) -> Self::State {
        let mut given = vec![t];
        given.extend_from_slice(&z.as_slice()[..self.memory]);
        given.push(*y);
        Self::State::read(&self.rate.evaluate(&given))
    }
    /// Joint integration takes rates alone.
    fn injection(&self, _: &Self::State, _: &f64) -> Self::State {
        Self::State::zero()
    }
    fn stagger(&self, _: &Self::State, new: Self::State, _: f64) -> Self::State {
        new
    }
    fn admissible(&self, z: Self::State) -> Self::State {
        Self::State::read(&self.admissible.evaluate(&z.as_slice()[..self.memory]))
    }
    fn speed(&self, _: &Self::State) -> f64 {
        1.0
    }
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [f64] {
        &z.as_slice()[..self.n]
    }
}

/// A plant as tables.
struct PlantTables {
    /// (t, h, x, ξ₁, ξ₂) → x⁺.
    step: Table,
    parts: Parts<Table>,
    noisy: bool,
    supports: [bool; 3],
}

impl Parts<Table> {
    fn made(&self, failure: &Arc<Failure>) -> PyResult<Parts<Part>> {
        let part = |table: &Table| Part::of(table.clone(), failure);
        Ok(Parts {
            drift: part(&self.drift)?,
            output: part(&self.output)?,
            diffusion: part(&self.diffusion)?,
            slope: part(&self.slope)?,
            jacobian_times: part(&self.jacobian_times)?,
            curvature: part(&self.curvature)?,
        })
    }
    /// Whether functions are called.
    fn calls(&self) -> bool {
        let Self { drift, output, diffusion, .. } = self;
        [drift, output, diffusion].iter().any(|table| !table.calls.is_empty())
    }
}

fn plant_tables<P>(
    n: usize,
    scheme: PlantScheme,
    build: impl Fn() -> PyResult<P>,
) -> PyResult<PlantTables>
where
    P: Plant<Traced, Output = Traced, Input = NoInput<Traced>>,
{
    let u = crate::model::no_input();
    let state = |name| P::State::read(&inputs(name, n));
    let flat = |state: P::State| {
        let mut values = vec![Traced::ZERO; n];
        state.write(&mut values);
        Ok(named("x", &values))
    };
    let step = trace(DOUBLE, || {
        let (t, h) = (input("t"), input("h"));
        let (x, xi) = (state("x"), inputs("xi", 2));
        let plant = build()?;
        flat(match scheme {
            PlantScheme::Held => x,
            PlantScheme::Deterministic(scheme) => plant_step(scheme, &plant, t, &x, &u, h),
            PlantScheme::Stochastic(scheme) => {
                let w = WienerIncrement::from_normals((xi[0], xi[1]), h);
                scheme.step(&plant, t, &x, &u, h, w)
            }
        })
    })?;
    let parts = Parts {
        drift: trace(DOUBLE, || {
            let (t, x) = (input("t"), state("x"));
            flat(build()?.drift(t, &x, &u))
        })?,
        output: trace(DOUBLE, || {
            let (t, x) = (input("t"), state("x"));
            Ok(named("y", &[build()?.output(t, &x, &u)]))
        })?,
        diffusion: trace(DOUBLE, || {
            let (t, x) = (input("t"), state("x"));
            flat(build()?.diffusion(t, &x, &u))
        })?,
        slope: trace(DOUBLE, || {
            let (t, x) = (input("t"), state("x"));
            flat(build()?.diffusion_slope(t, &x, &u))
        })?,
        jacobian_times: trace(DOUBLE, || {
            let (t, x, v) = (input("t"), state("x"), state("v"));
            flat(build()?.jacobian_times(t, &x, &u, &v))
        })?,
        curvature: trace(DOUBLE, || {
            let (t, x) = (input("t"), state("x"));
            flat(build()?.curvature(t, &x, &u))
        })?,
    };
    let (mut noisy, mut supports) = (false, [false; 3]);
    trace(DOUBLE, || {
        use StochasticIntegrator::{EulerMaruyama, Milstein, Taylor15};
        let plant = build()?;
        noisy = plant.has_process_noise();
        supports = [EulerMaruyama, Milstein, Taylor15].map(|scheme| plant.supports(scheme));
        Ok(Vec::new())
    })?;
    Ok(PlantTables { step, parts, noisy, supports })
}

/// What simulates: the plant's and the observer's tables and the plan.
struct Study<'a> {
    plan: &'a Plan,
    observer: &'a Tables,
    /// [`Tables::taking`].
    taking: Table,
    plant: PlantTables,
}

impl Study<'_> {
    /// The observer's inputs: none is known of a plant without one.
    fn told(&self) -> Vec<Traced> {
        let parameters = self.observer.parameters().iter().map(|value| Traced::from_f64(*value));
        std::iter::repeat_n(Traced::ZERO, self.observer.n_u()).chain(parameters).collect()
    }

    /// What takes the sample: (t, dt, z, x, drawn noise, sines, the plant's time) → z⁺.
    fn observers(&self) -> PyResult<Compiled> {
        trace(DOUBLE, || {
            let (t, dt) = (input("t"), input("dt"));
            let z = inputs("z", self.plan.memory_len());
            let x = inputs("x", self.plan.plant.len());
            let (noise, sines, plant_t) = (input("noise"), input("sines"), input("plant_t"));
            let output =
                trace::inline(&self.plant.parts.output, &[&[plant_t], x.as_slice()].concat());
            let y = output[0] + noise + sines;
            let given = [&[t, dt], z.as_slice(), &[y], &self.told()].concat();
            let mut made = trace::inline(&self.taking, &given);
            made.truncate(z.len());
            Ok(named("z", &made))
        })?
        .compile()
    }

    /// The way on after the sample, with current timing: (t, dt, z) → z⁺.
    fn predictors(&self) -> PyResult<Option<Compiled>> {
        if self.observer.correct().is_none() {
            return Ok(None);
        }
        let table = trace(DOUBLE, || {
            let (t, dt) = (input("t"), input("dt"));
            let z = inputs("z", self.plan.memory_len());
            let given = [&[t, dt], z.as_slice(), &[Traced::ZERO], &self.told()].concat();
            Ok(named("z", &trace::inline(self.observer.advance(), &given)))
        })?;
        table.compile().map(Some)
    }

    /// (t, dt, z, x, drawn noise) → (z⁺, x⁺), as one differential equation.
    fn both(&self, integrator: Integrator) -> PyResult<Compiled> {
        let Some((rate, admissible)) = self.observer.law() else {
            return Err(refused(SAMPLED_ONLY));
        };
        trace(DOUBLE, || {
            let (t, dt) = (input("t"), input("dt"));
            let z = inputs("z", self.plan.memory_len());
            let x = inputs("x", self.plan.plant.len());
            let held = input("noise");
            let of = |sine: &Sine<f64>| Sine {
                amplitude: Traced::from_f64(sine.amplitude),
                omega: Traced::from_f64(sine.omega),
                phase: Traced::from_f64(sine.phase),
            };
            let sines: Vec<Sine<Traced>> = self.plan.sines().iter().map(of).collect();
            let told = self.told();
            let frozen = self.plan.plant_scheme == PlantScheme::Held;
            let system = |t: Traced, both: &SVector<Traced, { X + Z }>| {
                let (z, x) = both.as_slice().split_at(z.len());
                let x = &x[..self.plan.plant.len()];
                let output = trace::inline(&self.plant.parts.output, &[&[t], x].concat());
                let y = output[0] + held + Sine::sum(&sines, t);
                let given = [&[t], z, &[y], told.as_slice()].concat();
                let mut rates = trace::inline(rate, &given);
                if !frozen {
                    rates.extend(trace::inline(&self.plant.parts.drift, &[&[t], x].concat()));
                }
                SVector::read(&rates)
            };
            let start = SVector::read(&[z.as_slice(), &x].concat());
            let end = integrator.step(system, t, &start, dt);
            let (z, x) = end.as_slice().split_at(z.len());
            let x = &x[..self.plan.plant.len()];
            Ok([named("z", &trace::inline(admissible, z)), named("x", x)].concat())
        })?
        .compile()
    }
}

/// A block of runs.
struct BlockTask<'a, 'b> {
    experiment: &'a Experiment<'a, f64, Evaluated<'a>, AnySchedule>,
    programs: Programs<'a, f64, Z>,
    first_run: u64,
    block: BlockOf<PlantState<f64>, SVector<f64, Z>>,
    metrics: &'a mut LaneMetrics<'b, f64>,
    stop: &'a StopFlag,
}

impl Task for BlockTask<'_, '_> {
    type Output = BlockOf<PlantState<f64>, SVector<f64, Z>>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self { experiment, programs, first_run, block, metrics, stop } = self;
        experiment.programs_block(programs, first_run, block, metrics, || stop.is_set())
    }
}

/// Whether a simulation runs as programs: its plant or its model is the user's own, or it is a pair
/// that is not compiled.
pub fn is_programmed(spec: &Spec<'_>) -> PyResult<bool> {
    let (observer, plant) = (spec.sub("observer")?, spec.sub("plant")?.text_or("kind", "")?);
    let model = observer.get("model")?.is_some() && {
        observer.sub("model")?.text_or("kind", "")? == "own"
    };
    let copies = matches!(observer.text_or("kind", "")?.as_str(), "collection" | "modified");
    let copied = copies && matches!(plant.as_str(), "lee" | "van-der-pol");
    Ok(model || plant == "own-plant" || copied)
}

/// Whether recorded noise has samples that are missing.
fn samples_miss(spec: &Spec<'_>) -> PyResult<bool> {
    if spec.get("noise")?.is_none() {
        return Ok(false);
    }
    let noise = spec.sub("noise")?;
    Ok(noise.get("values")?.is_some()
        && noise.numbers("values")?.values.iter().any(|value| !value.is_finite()))
}

/// Run an experiment with a plant or a model of the user's own.
pub fn simulate<'py>(py: Python<'py>, spec: &Spec<'py>) -> PyResult<Bound<'py, PyDict>> {
    let of_observer = spec.sub("observer")?;
    let schedule = spec.sub("schedule")?;
    // gains for the length of a step are constants
    let gains = if schedule.text("kind")? == "fixed" {
        PlacedGains::For(schedule.f64("dt")?)
    } else {
        PlacedGains::Computed
    };
    let mut observer = Tables::read(&of_observer, Setting { gains, ..DOUBLE })?;
    let mut plan = Plan::read(spec, observer.memory_len(), &["truth"])?;
    if observer.n_y() != 1 || plan.memory_len() > Z {
        return Err(refused("an own plant or model is simulated with one output"));
    }
    let plant_spec = spec.sub("plant")?;
    let (n, scheme) = (plan.plant.len(), plan.plant_scheme);
    let truth: Option<Vec<usize>> = spec.get("truth")?.map(|truth| truth.extract()).transpose()?;
    let own = match (&plan.plant, truth) {
        (AnyPlant::Own { .. }, None) => Some(OwnPlant::read(&plant_spec)?),
        (AnyPlant::Own { .. }, Some(truth)) => {
            Some(OwnPlant::read(&plant_spec)?.estimated(&truth)?)
        }
        (_, None) => None,
        (_, Some(_)) => return Err(refused("truth names states of an own plant")),
    };
    if let Some(own) = &own {
        for row in plan.x0.chunks_exact_mut(n) {
            let given = row.to_vec();
            row.iter_mut().zip(&own.order).for_each(|(x, place)| *x = given[*place]);
        }
    }
    macro_rules! paper {
        ($variant:ident) => {
            plant_tables(n, scheme, || match AnyPlant::<Traced>::read(&plant_spec)? {
                AnyPlant::$variant(plant) => Ok(plant),
                _ => Err(refused("another plant")),
            })?
        };
    }
    let plant = match plan.plant {
        AnyPlant::Lee(_) => paper!(Lee),
        AnyPlant::SanfelicePraly(_) => paper!(SanfelicePraly),
        AnyPlant::VanDerPol(_) => paper!(VanDerPol),
        AnyPlant::Crackle(_) => paper!(Crackle),
        AnyPlant::Ship(_) => {
            return Err(refused("the ship is simulated with the reduced-order observer only"));
        }
        AnyPlant::Own { .. } => match &own {
            Some(own) => plant_tables(n, scheme, || Ok(Tabled(own)))?,
            None => return Err(refused("another plant")),
        },
    };
    // a correction after missing samples is for all the time since the last one; the low-power laws have
    // no table for any time, and no value then
    let waits = || -> PyResult<bool> {
        let dt = schedule.f64("dt")?;
        let rows = plan.memory0.chunks_exact(plan.memory_len().max(1));
        let mut starts = rows.filter_map(|row| row.last());
        Ok(samples_miss(spec)?
            || plant.parts.output.may_lack_value()
            || !starts.all(|elapsed| [0.0, dt].contains(elapsed)))
    };
    let standard = of_observer.text("kind")? == "standard" && observer.is_current();
    if standard && matches!(gains, PlacedGains::For(_)) && waits()? {
        observer = Tables::read(&of_observer, DOUBLE)?;
    }
    let study =
        Study { plan: &plan, observer: &observer, taking: observer.taking(false, false)?, plant };
    if n < observer.n() {
        return Err(refused(&format!(
            "the observer estimates {} states; the plant has {n}",
            observer.n()
        )));
    }
    let integrator = plan.joint_integrator(&spec.sub("observer")?)?;
    let alone = integrator.is_some() && !plan.has_no_sines();
    let mut result = if !alone && !study.calls() && vectors(&plan)?.is_some() {
        study.in_blocks(py, integrator)?
    } else {
        study.one_by_one(py, integrator)?
    };
    if let Some(own) = &own {
        result.reorder_states(&own.order);
    }
    result.into_dict(py, &plan)
}

impl Study<'_> {
    fn evaluated<'a>(&self, parts: &'a Parts<Part>) -> Evaluated<'a> {
        let PlantTables { noisy, supports, .. } = self.plant;
        Evaluated { n: self.plan.plant.len(), noisy, supports, parts }
    }

    fn in_blocks(&self, py: Python<'_>, integrator: Option<Integrator>) -> PyResult<StudyResult> {
        let (plan, observer) = (self.plan, self.observer);
        let parts = self.plant.parts.made(&Arc::default())?;
        let plants = self.plant.step.compile()?;
        let (observers, joint) = match integrator {
            None => (self.observers()?, false),
            Some(integrator) => (self.both(integrator)?, true),
        };
        let moves = !joint && plan.plant_scheme != PlantScheme::Held;
        let predictors = if joint { None } else { self.predictors()? };
        let on = predictors.as_ref().unwrap_or(&plants); // its registers are not used without
        let rest = [&observers, &plants, on].map(Compiled::registers::<f64>);
        interruptible(py, |stop| {
            let plant = self.evaluated(&parts);
            let (kept, memory) = (observer.signals(), plan.memory_len());
            let done = plan.execute_blocks::<Evaluated<'_>, SVector<f64, Z>>(
                plant,
                kept,
                |vectors, experiment, first_run, block, metrics| {
                    let mut registers = rest.map(|rest| Box::new(Registers::in_lanes(&rest)));
                    let [of_observers, of_plants, on] = &mut registers;
                    let programs = Programs {
                        observers: observers.program(),
                        plants: moves.then(|| plants.program()),
                        joint,
                        predictors: predictors.as_ref().map(Compiled::program),
                        registers: [of_observers, of_plants, on],
                        entries: (plan.plant.len(), memory),
                        estimated: observer.n(),
                        filters: observer.is_current(),
                    };
                    let task = BlockTask { experiment, programs, first_run, block, metrics, stop };
                    vectors.run(task)
                },
            );
            done.unwrap_or_else(|| Err(refused("this processor lacks the instructions")))
        })
    }

    fn one_by_one(&self, py: Python<'_>, integrator: Option<Integrator>) -> PyResult<StudyResult> {
        let (plan, observer) = (self.plan, self.observer);
        let failure = Arc::<Failure>::default();
        let parts = self.plant.parts.made(&failure)?;
        let (n, memory, kept) = (observer.n(), plan.memory_len(), observer.signals());
        // what is known of the observer's inputs and parameters, taken in
        let alone = |table: &Table, own: usize| {
            let alone = trace(DOUBLE, || {
                let given = inputs("given", own);
                let outputs = trace::inline(table, &[given, self.told()].concat());
                Ok(named("z", &outputs))
            })?;
            Part::of(alone, &failure)
        };
        let half = |table: &Table| alone(table, 2 + memory + 1);
        let current = observer.is_current();
        let correct = if current { Some(half(&self.taking)?) } else { None };
        let advance = if current { half(observer.advance())? } else { half(&self.taking)? };
        let law = match (integrator, observer.law()) {
            (None, _) => None,
            (Some(_), None) => return Err(refused(SAMPLED_ONLY)),
            (Some(integrator), Some((rate, admissible))) => Some((
                integrator,
                alone(rate, 1 + memory + 1)?,
                Part::of(admissible.clone(), &failure)?,
            )),
        };
        let result = interruptible(py, |stop| {
            let plant = self.evaluated(&parts);
            let tell = |u: &NoInput<f64>| *u;
            if let Some((integrator, rate, admissible)) = &law {
                let law = Evolution { rate, admissible, n, memory };
                return plan.execute(
                    plant,
                    observer.signals(),
                    stop,
                    |experiment, run, x, z, watch| {
                        experiment.joint(&law, tell, *integrator, run, x, z, watch)
                    },
                );
            }
            if observer.is_current() {
                let observer =
                    Recursion::<true> { correct: correct.as_ref(), advance: &advance, n, memory };
                plan.execute(plant, kept, stop, |experiment, run, x, z, watch| {
                    experiment.sampled(&observer, tell, run, x, z, watch)
                })
            } else {
                let observer = Recursion::<false> { correct: None, advance: &advance, n, memory };
                plan.execute(plant, kept, stop, |experiment, run, x, z, watch| {
                    experiment.sampled(&observer, tell, run, x, z, watch)
                })
            }
        });
        let failed = failure.error.lock().unwrap_or_else(PoisonError::into_inner).take();
        failed.map_or(result, Err)
    }

    /// Whether Python functions are called.
    fn calls(&self) -> bool {
        let tables = [&self.taking, self.observer.advance()];
        self.plant.parts.calls() || tables.iter().any(|table| !table.calls.is_empty())
    }
}
