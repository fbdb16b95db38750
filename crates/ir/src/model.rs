//! Floor 6. Models that are known at run time only, within a trace: a table in the place of a compiled
//! model.

use crate::derivative::call_dual;
use crate::error::{Result, refused};
use crate::order::MAX_INPUTS;
use crate::spec::Spec;
use crate::systems::AnyModel;
use crate::table::Table;
use crate::trace::{self, Traced, call, input, inputs};
use hgo_rs::Scalar;
use hgo_rs::dual::Dual;
use hgo_rs::model::{Model, PhaseVariable, SampledModel, StrictFeedback, last};
use nalgebra::{SMatrix, SVector};

/// The form of a nonlinear chain: right-hand sides as of the triangular form, then the slope of each of the states
/// behind the first in the rate of the one before it.
pub(crate) const CHAINED: &str = "nonlinear-chain";

/// A model as it was given.
pub struct OwnModel {
    pub(crate) form: String,
    pub(crate) n: usize,
    pub(crate) n_u: usize,
    pub(crate) table: Table,
    pub(crate) parameters: Vec<f64>,
    /// Orders of the chains, one for each output.
    pub(crate) orders: Vec<usize>,
    /// Unmeasured states of the strict-feedback form.
    pub(crate) n_z: usize,
    /// For each chain, whether its last state is an unknown that enters the equation before it; empty
    /// where none is. The slopes in the unknowns are then the last outputs of the table, one a chain.
    pub(crate) unknown: Vec<bool>,
}

impl OwnModel {
    pub(crate) fn read(spec: &Spec<'_>) -> Result<Self> {
        let sizes = ["form", "n", "n_u", "orders", "n_z", "unknown"];
        spec.only(&[&["kind", "table", "parameters", "names", "units"], &sizes[..]].concat())?;
        let (form, n, n_u) = (spec.text("form")?, spec.count("n")?, spec.count("n_u")?);
        let table = Table::read(&spec.sub("table")?)?;
        let parameters = spec.numbers("parameters")?.values.clone();
        if let Some(bad) = parameters.iter().find(|value| !value.is_finite()) {
            return Err(refused(format!("a parameter of the model is {bad}; it must be finite")));
        }
        if n_u > MAX_INPUTS {
            let message =
                format!("n_u = {n_u} is not allowed: a model has 0 to {MAX_INPUTS} inputs");
            return Err(refused(&message));
        }
        let orders = spec.wholes("orders")?.unwrap_or_else(|| vec![n]);
        if orders.iter().sum::<usize>() != n || orders.contains(&0) {
            let message =
                format!("orders = {orders:?} is not allowed: they must add up to n = {n}");
            return Err(refused(&message));
        }
        let n_z = if form == "strict-feedback" { spec.count("n_z")? } else { 0 };
        let unknown: Vec<bool> =
            spec.wholes("unknown")?.unwrap_or_default().iter().map(|of| *of > 0).collect();
        if !unknown.is_empty() {
            let carries = ["phase", "triangular", "chains"].contains(&form.as_str());
            let longer = orders.iter().zip(&unknown).all(|(n, of)| *n > usize::from(*of));
            if !carries || !longer || unknown.len() != orders.len() {
                return Err(refused(format!(
                    "unknown = {unknown:?} is not allowed: give one entry for each chain (forms phase, \
                     triangular, chains), 1 where the chain's last state is an unknown, else 0; such a \
                     chain has two states at least"
                )));
            }
        }
        let (given, made) = match form.as_str() {
            "strict-feedback" => (1 + n + n_z + n_u, n + n * n_z + n_z),
            "chains" => (1 + n + n_u, orders.len()),
            "phase" => (1 + n + n_u, 1),
            "triangular" => (1 + n + n_u, n - unknown.len()),
            CHAINED => (1 + n + n_u, n),
            "sampled" => (3 + n + n_u, 2 * n + 1),
            other => {
                return Err(spec.unknown(
                    "form",
                    other,
                    &["phase", "triangular", CHAINED, "chains", "sampled", "strict-feedback"],
                ));
            }
        };
        let slopes = if form == CHAINED { n - 1 } else { unknown.len() };
        let (given, made) = (given + parameters.len(), made + slopes);
        if table.inputs.len() != given || table.outputs.len() != made {
            return Err(refused(format!(
                "the model's table has {} inputs and {} outputs; its form {form:?} has {given} and \
                 {made}",
                table.inputs.len(),
                table.outputs.len()
            )));
        }
        // a correction is told neither time nor input
        let moves = table.depends(|i| i == 0 || (1 + n..1 + n + n_u).contains(&i));
        let divides = |chain: usize| unknown.get(chain).copied().unwrap_or(true);
        let mut outputs = table.outputs.iter().skip(made - slopes).enumerate();
        if outputs.any(|(chain, slope)| divides(chain) && moves[*slope]) {
            return Err(refused(
                "the slope of an unknown or of a nonlinear chain depends on time or an input: it must depend on states and \
                 parameters only; take the whole term as the state",
            ));
        }
        Ok(Self { form, n, n_u, table, parameters, orders, n_z, unknown })
    }

    /// How the unknown of a chain enters, if it has one.
    fn entry(&self, chain: usize) -> Option<Entry> {
        let slope = self.table.outputs.len() - self.unknown.len();
        let side = if self.orders.len() > 1 { chain } else { slope.saturating_sub(1) };
        let entry = Entry { side, slope: slope + chain };
        self.unknown.get(chain).is_some_and(|of| *of).then_some(entry)
    }

    /// Names of the parameters: the last inputs of the table.
    pub(crate) fn names(&self) -> &[String] {
        &self.table.inputs[self.table.inputs.len() - self.parameters.len()..]
    }
}

/// Where in a table an unknown stands, which is the last state of a chain.
#[derive(Clone, Copy)]
pub(crate) struct Entry {
    /// The right-hand side that it enters.
    side: usize,
    /// Its slope.
    slope: usize,
}

/// A model that observers over traced numbers know.
#[derive(Clone, Copy)]
pub(crate) enum Known {
    Paper(AnyModel<Traced>),
    Own {
        function: usize,
        n_u: usize,
        unknown: Option<Entry>,
        /// Whether it is a nonlinear chain.
        chained: bool,
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
        unknown: Option<Entry>,
    },
}

impl Known {
    /// Outputs of an own model, by what calls a function over these numbers.
    fn call<S: Scalar + From<Traced>>(
        &self,
        (t, x, u): (S, &[S], &[S]),
        call: impl Fn(usize, &[S]) -> Vec<S>,
    ) -> Vec<S> {
        match *self {
            Self::Paper(_) => Vec::new(),
            Self::Own { function, n_u, .. } => call(function, &[&[t], x, &u[..n_u]].concat()),
            Self::Chain { function, shared, n_u, n, first, .. } => {
                let (_, shared) = trace::kept(shared);
                let mut all: Vec<S> = shared.into_iter().take(n).map(S::from).collect();
                all[first..first + x.len()].copy_from_slice(x);
                call(function, &[&[t], all.as_slice(), &u[..n_u]].concat())
            }
        }
    }

    /// How the last state enters, where it is an unknown.
    fn unknown(&self) -> Option<Entry> {
        match *self {
            Self::Paper(_) => None,
            Self::Own { unknown, .. } | Self::Chain { unknown, .. } => unknown,
        }
    }
}

/// The first K inputs.
fn told<S: Scalar, const K: usize>(u: &SVector<S, MAX_INPUTS>) -> SVector<S, K> {
    SVector::from_fn(|i, _| u[i])
}

/// A model over these numbers, over which functions are called so.
macro_rules! known_over {
    ($number:ty, $call:ident) => {
        impl<const N: usize> Model<$number, N, MAX_INPUTS> for Known {
            fn f_hat(
                &self,
                t: $number,
                x: &SVector<$number, N>,
                u: &SVector<$number, MAX_INPUTS>,
            ) -> SVector<$number, N> {
                let made = self.call((t, x.as_slice(), u.as_slice()), $call);
                match (self, self.unknown()) {
                    (Self::Paper(model), _) => model.f_hat(t, x, &told::<_, 1>(u)),
                    (Self::Chain { chain, .. }, None) => last(made[*chain]),
                    (Self::Own { .. }, None) => match made.as_slice() {
                        [phi] => last(*phi),
                        f => SVector::from_fn(|i, _| f.get(i).copied().unwrap_or_default()),
                    },
                    // the equation that an unknown enters is where the unknown does
                    (Self::Own { .. }, Some(Entry { side, .. })) => {
                        SVector::from_fn(|i, _| if i < side { made[i] } else { Scalar::NEG_ZERO })
                    }
                    (Self::Chain { .. }, Some(_)) => SVector::from_element(Scalar::NEG_ZERO),
                }
            }
            fn enters(
                &self,
                t: $number,
                x: &SVector<$number, N>,
                last: $number,
                u: &SVector<$number, MAX_INPUTS>,
            ) -> $number {
                let Some(Entry { side, .. }) = self.unknown() else { return last };
                let mut x = *x;
                x[N - 1] = last;
                self.call((t, x.as_slice(), u.as_slice()), $call)[side]
            }
            fn slope(&self, x: &SVector<$number, N>) -> $number {
                let Some(Entry { slope, .. }) = self.unknown() else { return Scalar::ONE };
                let nothing = [Scalar::ZERO; MAX_INPUTS];
                self.call((Scalar::ZERO, x.as_slice(), &nothing), $call)[slope]
            }
            fn slopes(&self, x: &SVector<$number, N>) -> SVector<$number, N> {
                if !matches!(self, Self::Own { chained: true, .. }) {
                    let last = Model::<$number, N, MAX_INPUTS>::slope(self, x);
                    return SVector::from_fn(|i, _| if i + 1 == N { last } else { Scalar::ONE });
                }
                let nothing = [Scalar::ZERO; MAX_INPUTS];
                let made = self.call((Scalar::ZERO, x.as_slice(), &nothing), $call);
                SVector::from_fn(|i, _| if i == 0 { Scalar::ONE } else { made[N + i - 1] })
            }
            fn carries(&self) -> bool {
                self.unknown().is_some()
            }
        }
    };
}
known_over!(Traced, call);
known_over!(Dual<Traced, N>, call_dual);

impl<const N: usize> PhaseVariable<Traced, N, MAX_INPUTS> for Known {
    fn phi(&self, t: Traced, x: &SVector<Traced, N>, u: &SVector<Traced, MAX_INPUTS>) -> Traced {
        match self {
            Self::Paper(model) => model.phi(t, x, &told::<_, 1>(u)),
            _ => Model::f_hat(self, t, x, u)[N - 1],
        }
    }
}

/// All chains of a model with several outputs, for laws that need its slopes.
#[derive(Clone, Copy)]
pub(crate) struct OwnChains<const N: usize, const K: usize> {
    pub(crate) function: usize,
    pub(crate) n_u: usize,
    /// The last state of each chain.
    pub(crate) last: [usize; K],
}

impl<const N: usize, const K: usize> Model<Dual<Traced, N>, N, MAX_INPUTS> for OwnChains<N, K> {
    fn f_hat(
        &self,
        t: Dual<Traced, N>,
        x: &SVector<Dual<Traced, N>, N>,
        u: &SVector<Dual<Traced, N>, MAX_INPUTS>,
    ) -> SVector<Dual<Traced, N>, N> {
        let given = [&[t], x.as_slice(), &u.as_slice()[..self.n_u]].concat();
        let mut f = SVector::from_element(Dual::NEG_ZERO);
        for (place, phi) in self.last.iter().zip(call_dual(self.function, &given)) {
            f[*place] = phi;
        }
        f
    }
}

/// A model of the sampled-data observer.
#[derive(Clone, Copy)]
pub(crate) struct OwnSampled {
    pub(crate) function: usize,
    pub(crate) n: usize,
    pub(crate) n_u: usize,
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
pub(crate) struct OwnStrictFeedback {
    pub(crate) function: usize,
    pub(crate) n_u: usize,
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

/// What an observer knows, as its spec says it.
pub(crate) enum Given<'a> {
    Paper(Option<Spec<'a>>),
    Own(Box<OwnModel>),
    /// Chain number `chain` of a model with several outputs.
    Chain(&'a OwnModel, usize),
}

impl<'a> Given<'a> {
    pub(crate) fn read(spec: &Spec<'a>) -> Result<Self> {
        if !spec.has("model") {
            return Ok(Self::Paper(None));
        }
        let model = spec.sub("model")?;
        if model.text("kind")? == "own" {
            return Ok(Self::Own(Box::new(OwnModel::read(&model)?)));
        }
        Ok(Self::Paper(Some(model)))
    }

    /// Whether anything is said of the system.
    pub(crate) fn says(&self) -> Result<bool> {
        match self {
            Self::Paper(None) => Ok(false),
            Self::Paper(Some(model)) => Ok(model.text("kind")? != "none"),
            Self::Own(_) | Self::Chain(..) => Ok(true),
        }
    }

    /// Number of known inputs.
    pub(crate) fn n_u(&self) -> Result<usize> {
        match self {
            Self::Paper(None) => Ok(0),
            Self::Paper(Some(model)) => Ok(match model.text("kind")?.as_str() {
                "input" => 1,
                "ship" => 2,
                _ => 0,
            }),
            Self::Own(own) => Ok(own.n_u),
            Self::Chain(own, _) => Ok(own.n_u),
        }
    }

    pub(crate) fn parameters(&self) -> &[f64] {
        match self {
            Self::Own(own) => &own.parameters,
            Self::Chain(own, _) => &own.parameters,
            Self::Paper(_) => &[],
        }
    }

    /// Within a trace: inputs for the parameters, and the model over them.
    pub(crate) fn install(&self, n: usize) -> Result<Known> {
        let (order, known) = match self {
            Self::Paper(None) => (None, Known::Paper(AnyModel::Unknown)),
            Self::Paper(Some(spec)) => {
                let model = AnyModel::read(spec)?;
                (model.order(), Known::Paper(model))
            }
            Self::Own(own) => {
                if !["phase", "triangular", CHAINED].contains(&own.form.as_str()) {
                    return Err(refused(format!(
                        "a model of form {:?} does not fit this observer: it needs the phase-variable \
                         or the triangular form, or a nonlinear chain",
                        own.form
                    )));
                }
                let parameters = own.names().iter().map(|name| input(name)).collect();
                let function = trace::function(own.table.clone(), parameters);
                let (n_u, unknown, chained) = (own.n_u, own.entry(0), own.form == CHAINED);
                (Some(own.n), Known::Own { function, n_u, unknown, chained })
            }
            Self::Chain(own, chain) => {
                let (n, n_u, chain) = (own.n, own.n_u, *chain);
                let shared = trace::function(Table::default(), inputs("shared", n));
                let parameters = own.names().iter().map(|name| input(name)).collect();
                let function = trace::function(own.table.clone(), parameters);
                let first = own.orders[..chain].iter().sum();
                let order = own.orders[chain];
                let unknown = own.entry(chain);
                (Some(order), Known::Chain { function, shared, n_u, n, chain, first, unknown })
            }
        };
        match order {
            Some(order) if order != n => {
                Err(refused(format!("n = {n} does not fit the model, which has order {order}")))
            }
            _ => Ok(known),
        }
    }
}
