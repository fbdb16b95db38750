//! Models that have no value at some states: the memory is held there, and the sample is named.

use crate::experiment::{Clock, Drawn, Setup, joint, sampled};
use hgo_ir::MAX_INPUTS;
use hgo_rs::Scalar;
use hgo_rs::gain::ConstantGain;
use hgo_rs::injection::{Placed, Placement};
use hgo_rs::integrate::Integrator;
use hgo_rs::memory::Memory;
use hgo_rs::model::{Model, PhaseVariable, Plant, SampledModel, StrictFeedback, last, no_input};
use hgo_rs::models::Lee;
use hgo_rs::observer::{Current, Discretised, Euler, Observer, Rk4};
use hgo_rs::observers::{ReducedOrderObserver, SampledDataObserver, StandardObserver};
use nalgebra::{SMatrix, SVector};

/// φ = ln x₁, and the same as f of a sampled-data observer.
#[derive(Clone, Copy, Debug)]
struct Logarithm;

type State = SVector<f64, 2>;
type Nothing = SVector<f64, 0>;

impl PhaseVariable<f64, 2> for Logarithm {
    fn phi(&self, _: f64, x: &State, _: &Nothing) -> f64 {
        Scalar::ln(x.x)
    }
}

impl Model<f64, 2> for Logarithm {
    fn f_hat(&self, t: f64, x: &State, u: &Nothing) -> State {
        last(self.phi(t, x, u))
    }
}

impl SampledModel<f64, 2> for Logarithm {
    fn f(&self, _: f64, x: &State, _: &Nothing) -> State {
        State::new(x.y, Scalar::ln(x.x))
    }
    fn correction(&self, _: f64, x: &State, _: &Nothing, y: f64, dt: f64) -> State {
        State::new(dt * (y - x.x), dt * (y - x.x))
    }
    fn output(&self, _: f64, x: &State, _: &Nothing) -> f64 {
        x.x
    }
}

const PHASE: &str = "[observer.model]\nkind = 'own'\nform = 'phase'\nn = 2\nn_u = 0\nparameters = []\n\
    table = { inputs = ['t', 'x1', 'x2'], ops = [['log', 1]], outputs = [3] }";

const SAMPLED: &str = "kind = 'sampled-data'\n[observer.model]\nkind = 'own'\nform = 'sampled'\nn = 2\n\
    n_u = 0\nparameters = []\n[observer.model.table]\ninputs = ['t', 'x1', 'x2', 'y', 'dt']\n\
    ops = [['log', 1], ['sub', 3, 1], ['mul', 4, 6]]\noutputs = [2, 5, 7, 7, 1]";

fn setup() -> Setup {
    Setup { clock: Clock::Fixed(5e-3), every: 20, ..Setup::default() }
}

fn nothing(u: &Nothing) -> Nothing {
    *u
}

fn some_are_undefined(told: &[crate::experiment::Told]) {
    let undefined = told.iter().filter(|run| run.undefined_at.is_some()).count();
    assert!(undefined > 0, "{told:?}");
    assert!(told.iter().all(|run| run.diverged_at.is_none()));
}

#[test]
fn a_memory_is_held_where_the_model_has_no_value() {
    let lee = (Lee, "kind = 'lee'");
    let x: &[f64] = &[1.0, -1.0];
    let gain = ConstantGain::new(20.0).unwrap();
    let law = StandardObserver::<f64, _, _, 2>::new([2.0; 2], gain, Logarithm).unwrap();
    let kind = |manner: &str| {
        format!(
            "kind = 'standard'\nn = 2\nk = [2.0, 2.0]\ngain = {{ law = 'constant', ell = 20.0 }}\n\
             {manner}\n{PHASE}"
        )
    };
    let observer = Discretised { law, scheme: Euler };
    let told = sampled(&setup(), lee, (observer, &kind("")), nothing, (x, &[0.5, 0.0]));
    some_are_undefined(&told);
    let rk4 = kind("method = 'rk4'");
    let observer = Discretised { law, scheme: Rk4 };
    some_are_undefined(&sampled(&setup(), lee, (observer, &rk4), nothing, (x, &[0.5, 0.0])));
    let observer = Current { law, scheme: Placed::new(&law, Placement::Exact).unwrap() };
    let zoh = kind("method = 'zoh'\ntiming = 'current'");
    let told = sampled(&setup(), lee, (observer, &zoh), nothing, (x, &[0.5, 0.0, 0.0]));
    some_are_undefined(&told);
    some_are_undefined(&joint(&setup(), lee, (law, &rk4), Integrator::Rk4, (x, &[0.5, 0.0])));
    let observer = SampledDataObserver::<_, 2> { model: Logarithm };
    some_are_undefined(&sampled(&setup(), lee, (observer, SAMPLED), nothing, (x, &[0.1, 0.0])));
}

/// ẋ = z, ż = −1, y = x: a fall, of which the observer believes that ż = ln z.
#[derive(Clone, Copy, Debug)]
struct Fall;

const FALL: &str = "kind = 'own-plant'\nn = 2\nparameters = []\n\
    table = { inputs = ['t', 'x', 'z'], constants = [-1.0], outputs = [2, 3, 1] }";

const FALSE_FALL: &str = "kind = 'reduced-order'\nh_bar = [0.2]\nepsilon = 0.1\n[observer.model]\n\
    kind = 'own'\nform = 'strict-feedback'\nn = 1\nn_z = 1\nn_u = 0\nparameters = []\n\
    [observer.model.table]\ninputs = ['t', 'x', 'z']\nconstants = [0.0, 1.0]\nops = [['log', 2]]\n\
    outputs = [3, 4, 5]";

type One = SVector<f64, 1>;

impl Plant<f64> for Fall {
    type State = State;
    type Input = Nothing;
    type Output = One;
    const TRUTH: (usize, usize) = (1, 1);
    fn drift(&self, _: f64, x: &State, _: &Nothing) -> State {
        State::new(x.y, -1.0)
    }
    fn output(&self, _: f64, x: &State, _: &Nothing) -> One {
        One::new(x.x)
    }
    fn truth<'a>(&self, x: &'a State) -> &'a [f64] {
        &x.as_slice()[1..]
    }
    fn control(&self, _: f64, _: &State, _: f64) -> Nothing {
        no_input()
    }
}

impl<const M: usize> StrictFeedback<f64, 1, 1, M> for Fall {
    fn f1(&self, _: f64, _: &One, _: &SVector<f64, M>) -> One {
        One::new(0.0)
    }
    fn g(&self, _: f64, _: &One, _: &SVector<f64, M>) -> SMatrix<f64, 1, 1> {
        SMatrix::from_element(1.0)
    }
    fn f2(&self, _: f64, _: &One, z: &One, _: &SVector<f64, M>) -> One {
        One::new(Scalar::ln(z.x))
    }
}

/// The memory is held as a whole: the next sample explains the time since the last one that was used.
#[test]
fn a_filter_is_held_where_the_model_has_no_value() {
    let observer = ReducedOrderObserver::<f64, _, 1, 1, MAX_INPUTS>::new([0.2], 0.1, Fall).unwrap();
    let mut z = Vec::new();
    observer.initial().visit(&mut |value| z.push(value));
    z[0] = 0.5;
    let tell = |_: &Nothing| SVector::zeros();
    for drawn in [Drawn::Nothing, Drawn::Uniform(-1e-3, 1e-3)] {
        let setup = Setup { drawn, clock: Clock::Fixed(0.01), truth: Some(vec![1]), ..setup() };
        let told = sampled(&setup, (Fall, FALL), (observer, FALSE_FALL), tell, (&[0.1, 0.5], &z));
        some_are_undefined(&told);
    }
}
