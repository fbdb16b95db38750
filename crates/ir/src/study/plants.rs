//! Floor 5. Plants as tables: the papers' and the user's own.

use crate::error::{Result, refused};
use crate::order::{CHAINS, MAX_INPUTS};
use crate::spec::Spec;
use crate::systems::AnyPlant;
use crate::table::Table;
use crate::trace::{self, Setting, Traced, input, inputs, named, trace};
use hgo_rs::Scalar;
use hgo_rs::integrate::{PlantScheme, WienerIncrement, plant_step};
use hgo_rs::memory::Memory;
use hgo_rs::model::{Plant, StochasticIntegrator};
use nalgebra::SVector;

/// States that a plant of the user's own may have.
pub const MAX_STATES: usize = 32;

/// A plant as tables.
pub struct PlantTables {
    /// Entries of its state.
    pub n: usize,
    /// Inputs.
    pub n_u: usize,
    /// How many of them a feedback has to give: all, or none where the plant gives its own.
    pub open: usize,
    /// Outputs.
    pub n_y: usize,
    /// Whether it has process noise.
    pub noisy: bool,
    /// Whether it takes Euler-Maruyama, Milstein, the order 1.5 scheme.
    supports: [bool; 3],
    /// The states that an observer is asked for.
    pub truth: Vec<usize>,
    /// (t, dt, x, open inputs) → (own inputs, y): the inputs that the plant gives itself, held over the
    /// period dt, and the output under the inputs that are in force.
    pub output: Table,
    /// (t, h, x, u, ξ₁, ξ₂) → x⁺.
    pub step: Table,
    /// (t, x, u) → (ẋ, y).
    pub drift: Table,
}

impl PlantTables {
    /// Whether the plant gives what this stochastic scheme needs.
    pub fn supports(&self, scheme: StochasticIntegrator) -> bool {
        self.supports[scheme as usize]
    }

    /// Of a plant that moves by this scheme; `truth` are the states that the observer estimates, of a
    /// plant of the user's own.
    ///
    /// # Errors
    /// A spec that is no plant; states that it has not.
    pub fn read(spec: &Spec<'_>, scheme: PlantScheme, truth: Option<Vec<usize>>) -> Result<Self> {
        if spec.text("kind")? == "own-plant" {
            let own = OwnPlant::read(spec, scheme)?;
            let truth = own.estimated(truth)?;
            let tables = Self::of((own.n, own.n_u), scheme, truth, || Ok(Tabled(&own)))?;
            return own.with_outputs(tables);
        }
        if truth.is_some() {
            return Err(refused("truth names states of an own plant"));
        }
        macro_rules! paper {
            ($($variant:ident),+) => {
                match AnyPlant::<f64>::read(spec)? {
                    $(AnyPlant::$variant(_) => Self::known(scheme, || {
                        match AnyPlant::<Traced>::read(spec)? {
                            AnyPlant::$variant(plant) => Ok(plant),
                            _ => Err(refused("another plant")),
                        }
                    }),)+
                    AnyPlant::Own => Err(refused("another plant")),
                }
            };
        }
        paper!(Lee, SanfelicePraly, VanDerPol, Crackle, Ship)
    }

    fn known<P>(scheme: PlantScheme, build: impl Fn() -> Result<P>) -> Result<Self>
    where
        P: Plant<Traced>,
    {
        let (first, count) = P::TRUTH;
        let sizes = (P::State::LEN, P::Input::LEN);
        Self::of(sizes, scheme, (first..first + count).collect(), build)
    }

    fn of<P>(
        (n, n_u): (usize, usize),
        scheme: PlantScheme,
        truth: Vec<usize>,
        build: impl Fn() -> Result<P>,
    ) -> Result<Self>
    where
        P: Plant<Traced>,
    {
        use StochasticIntegrator::{EulerMaruyama, Milstein, Taylor15};
        let setting = Setting::usual(false);
        let n_y = P::Output::LEN;
        let (mut noisy, mut supports) = (false, [false; 3]);
        trace(setting, || {
            let plant = build()?;
            noisy = plant.has_process_noise();
            supports = [EulerMaruyama, Milstein, Taylor15].map(|scheme| plant.supports(scheme));
            Ok(Vec::new())
        })?;
        let state = || P::State::read(&inputs("x", n));
        let given = || P::Input::read(&inputs("u", n_u));
        let output = trace(setting, || {
            let (t, dt, x, plant) = (input("t"), input("dt"), state(), build()?);
            let u = plant.control(t, &x, dt);
            let y = plant.output(t, &x, &u);
            Ok([named("u", &flat(&u, n_u)), named("y", &flat(&y, n_y))].concat())
        })?;
        let step = trace(setting, || {
            let (t, h) = (input("t"), input("h"));
            let (x, u, xi, plant) = (state(), given(), inputs("xi", 2), build()?);
            let moved = match scheme {
                PlantScheme::Held => x,
                PlantScheme::Deterministic(scheme) => plant_step(scheme, &plant, t, &x, &u, h),
                PlantScheme::Stochastic(scheme) => {
                    let w = WienerIncrement::from_normals((xi[0], xi[1]), h);
                    scheme.step(&plant, t, &x, &u, h, w)
                }
            };
            Ok(named("x", &flat(&moved, n)))
        })?;
        let drift = trace(setting, || {
            let (t, x, u, plant) = (input("t"), state(), given(), build()?);
            let (rate, y) = (plant.drift(t, &x, &u), plant.output(t, &x, &u));
            Ok([named("x", &flat(&rate, n)), named("y", &flat(&y, n_y))].concat())
        })?;
        Ok(Self { n, n_u, open: 0, n_y, noisy, supports, truth, output, step, drift })
    }
}

/// The first entries of a memory.
pub fn flat<M: Memory<Traced>>(memory: &M, count: usize) -> Vec<Traced> {
    let mut values = vec![Traced::ZERO; count];
    memory.write(&mut values);
    values
}

/// A plant of the user's own.
struct OwnPlant {
    n: usize,
    n_u: usize,
    n_y: usize,
    noisy: bool,
    /// (t, x, u, parameters) → (drift, diffusion if there is noise, outputs).
    table: Table,
    /// Its derivatives, and theirs, where the scheme needs them.
    slopes: Option<[Table; 2]>,
    parameters: Vec<f64>,
}

impl OwnPlant {
    fn read(spec: &Spec<'_>, scheme: PlantScheme) -> Result<Self> {
        use StochasticIntegrator::{Milstein, Taylor15};
        spec.only(&["kind", "n", "n_u", "n_y", "noisy", "table", "parameters", "names"])?;
        let (n, noisy) = (spec.count("n")?, spec.flag_or("noisy", false)?);
        let n_y = if spec.has("n_y") { spec.count("n_y")? } else { 1 };
        let n_u = if spec.has("n_u") { spec.count("n_u")? } else { 0 };
        if n_u > MAX_INPUTS {
            return Err(refused(format!(
                "n_u = {n_u} is not allowed: a plant has at most {MAX_INPUTS} inputs"
            )));
        }
        if !(1..=CHAINS).contains(&n_y) {
            return Err(refused(format!(
                "n_y = {n_y} is not allowed: a plant has 1 to {CHAINS} outputs"
            )));
        }
        if !(1..=MAX_STATES).contains(&n) {
            return Err(refused(format!(
                "n = {n} is not allowed: a plant has 1 to {MAX_STATES} states"
            )));
        }
        let table = Table::read(&spec.sub("table")?)?;
        let parameters = spec.numbers("parameters")?.values.clone();
        if let Some(bad) = parameters.iter().find(|value| !value.is_finite()) {
            return Err(refused(format!("a parameter of the plant is {bad}; it must be finite")));
        }
        let (given, made) = (1 + n + n_u + parameters.len(), n + usize::from(noisy) * n + n_y);
        if table.inputs.len() != given || table.outputs.len() != made {
            return Err(refused(format!(
                "the plant's table has {} inputs and {} outputs; it must have {given} and {made}",
                table.inputs.len(),
                table.outputs.len()
            )));
        }
        let slopes = match scheme {
            PlantScheme::Stochastic(Milstein | Taylor15) if noisy => {
                let first = table.derivative()?;
                let second = first.derivative()?;
                Some([first, second])
            }
            _ => None,
        };
        Ok(Self { n, n_u, n_y, noisy, table, slopes, parameters })
    }

    /// The states that an observer estimates: those that are named, or the first.
    fn estimated(&self, truth: Option<Vec<usize>>) -> Result<Vec<usize>> {
        let Some(truth) = truth else { return Ok((0..self.n).collect()) };
        let twice = (1..truth.len()).any(|i| truth[..i].contains(&truth[i]));
        if twice || truth.iter().any(|i| *i >= self.n) {
            return Err(refused(format!(
                "truth = {truth:?} is not allowed: it must name some of the plant's {} states, each \
                 once",
                self.n
            )));
        }
        Ok(truth)
    }

    fn parameters(&self) -> impl Iterator<Item = Traced> {
        self.parameters.iter().map(|value| Traced::from_f64(*value))
    }

    /// Inputs of the table.
    fn inputs(&self, t: Traced, x: &[Traced], u: &[Traced]) -> Vec<Traced> {
        let given = [&[t], &x[..self.n], &u[..self.n_u]].concat();
        given.into_iter().chain(self.parameters()).collect()
    }

    /// Drift, diffusion if there is noise, output: within a trace.
    fn outputs(&self, t: Traced, x: &[Traced], u: &[Traced]) -> Vec<Traced> {
        trace::inline(&self.table, &self.inputs(t, x, u))
    }

    /// With all its outputs, and inputs that are open.
    fn with_outputs(&self, tables: PlantTables) -> Result<PlantTables> {
        let setting = Setting::usual(false);
        let last = |made: &[Traced]| named("y", &made[made.len() - self.n_y..]);
        let output = trace(setting, || {
            let (t, _, x) = (input("t"), input("dt"), inputs("x", self.n));
            Ok(last(&self.outputs(t, &x, &inputs("u", self.n_u))))
        })?;
        let drift = trace(setting, || {
            let (t, x) = (input("t"), inputs("x", self.n));
            let made = self.outputs(t, &x, &inputs("u", self.n_u));
            Ok([named("x", &made[..self.n]), last(&made)].concat())
        })?;
        Ok(PlantTables { n_y: self.n_y, open: self.n_u, output, drift, ..tables })
    }

    /// A direction in the inputs.
    fn direction(&self, t: Traced, x: &[Traced]) -> Vec<Traced> {
        let mut direction = vec![Traced::ZERO; 1 + self.n + self.n_u + self.parameters.len()];
        direction[0] = t;
        direction[1..=self.n].copy_from_slice(&x[..self.n]);
        direction
    }

    /// The derivatives of all outputs in a direction.
    fn slopes(&self, at: Point<'_>, direction: &[Traced]) -> Vec<Traced> {
        let (t, x, u) = at;
        let Some([first, _]) = &self.slopes else { return self.outputs(t, x, u) };
        trace::inline(first, &[self.inputs(t, x, u), direction.to_vec()].concat())
    }

    /// The second derivatives of all outputs, twice in a direction.
    fn curvatures(&self, at: Point<'_>, direction: &[Traced]) -> Vec<Traced> {
        let (t, x, u) = at;
        let Some([_, second]) = &self.slopes else { return self.outputs(t, x, u) };
        let still = vec![Traced::ZERO; direction.len()];
        let point = [self.inputs(t, x, u), direction.to_vec()].concat();
        trace::inline(second, &[point, direction.to_vec(), still].concat())
    }
}

type State = SVector<Traced, MAX_STATES>;
type Input = SVector<Traced, MAX_INPUTS>;
/// Time, state and input.
type Point<'a> = (Traced, &'a [Traced], &'a [Traced]);

/// An own plant behind the trait of all plants.
#[derive(Clone, Copy)]
struct Tabled<'a>(&'a OwnPlant);

impl Tabled<'_> {
    fn diffusion_of(self, made: &[Traced]) -> State {
        let n = self.0.n;
        if self.0.noisy { State::read(&made[n..2 * n]) } else { State::zero() }
    }
}

impl Plant<Traced> for Tabled<'_> {
    type State = State;
    type Input = Input;
    type Output = Traced;
    const TRUTH: (usize, usize) = (0, MAX_STATES);
    fn drift(&self, t: Traced, x: &State, u: &Input) -> State {
        State::read(&self.0.outputs(t, x.as_slice(), u.as_slice())[..self.0.n])
    }
    fn output(&self, t: Traced, x: &State, u: &Input) -> Traced {
        self.0.outputs(t, x.as_slice(), u.as_slice()).last().copied().unwrap_or_default()
    }
    fn truth<'a>(&self, x: &'a State) -> &'a [Traced] {
        x.as_slice()
    }
    /// A feedback gives the inputs.
    fn control(&self, _: Traced, _: &State, _: Traced) -> Input {
        Input::zero()
    }
    fn has_process_noise(&self) -> bool {
        self.0.noisy
    }
    /// The scheme of order 1.5 is for noise that is additive and does not change with time.
    fn supports(&self, scheme: StochasticIntegrator) -> bool {
        let own = self.0;
        let steady = || {
            let diffusion = own.n..2 * own.n;
            own.table.outputs.get(diffusion).is_some_and(|outputs| {
                let depends = own.table.depends(|input| input <= own.n + own.n_u);
                outputs.iter().all(|output| !depends[*output])
            })
        };
        own.noisy && (scheme != StochasticIntegrator::Taylor15 || steady())
    }
    fn diffusion(&self, t: Traced, x: &State, u: &Input) -> State {
        self.diffusion_of(&self.0.outputs(t, x.as_slice(), u.as_slice()))
    }
    fn diffusion_slope(&self, t: Traced, x: &State, u: &Input) -> State {
        let b = self.diffusion(t, x, u);
        let direction = self.0.direction(Traced::ZERO, b.as_slice());
        self.diffusion_of(&self.0.slopes((t, x.as_slice(), u.as_slice()), &direction))
    }
    fn jacobian_times(&self, t: Traced, x: &State, u: &Input, v: &State) -> State {
        let direction = self.0.direction(Traced::ZERO, v.as_slice());
        State::read(&self.0.slopes((t, x.as_slice(), u.as_slice()), &direction)[..self.0.n])
    }
    fn curvature(&self, t: Traced, x: &State, u: &Input) -> State {
        let (at, still) = ((t, x.as_slice(), u.as_slice()), [Traced::ZERO; MAX_STATES]);
        let in_time = self.0.slopes(at, &self.0.direction(Traced::ONE, &still));
        let b = self.diffusion(t, x, u);
        let twice = self.0.curvatures(at, &self.0.direction(Traced::ZERO, b.as_slice()));
        let half = Traced::from_f64(0.5);
        State::from_fn(
            |i, _| if i < self.0.n { in_time[i] + half * twice[i] } else { Traced::ZERO },
        )
    }
}
