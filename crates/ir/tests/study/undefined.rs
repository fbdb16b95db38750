//! Models that have no value at some states: the memory is held there, and the sample is named.

use crate::experiment::{Clock, Setup, joint, sampled};
use hgo_rs::Scalar;
use hgo_rs::gain::ConstantGain;
use hgo_rs::injection::{Placed, Placement};
use hgo_rs::integrate::Integrator;
use hgo_rs::memory::Memory;
use hgo_rs::model::{Model, PhaseVariable, SampledModel, last};
use hgo_rs::models::{Lee, Ship};
use hgo_rs::observer::{Current, Discretised, Euler, Observer, Rk4};
use hgo_rs::observers::{ReducedOrderObserver, SampledDataObserver, StandardObserver};
use nalgebra::SVector;

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

/// The yaw of a ship that rests is atan(0/0).
#[test]
fn a_ship_that_rests() {
    let ship = Ship::new(0.0, [0.0; 3]).unwrap();
    let observer = ReducedOrderObserver::new([0.1, 0.2, 0.2], 0.1, ship).unwrap();
    let kind = "kind = 'reduced-order'\nh_bar = [0.1, 0.2, 0.2]\nepsilon = 0.1\n\
                [observer.model]\nkind = 'ship'";
    let (mut z, x) = (Vec::new(), [0.0, 10.0, 0.5, 0.5, -0.5, -0.5]);
    observer.initial().visit(&mut |value| z.push(value));
    z[0] = f64::MAX; // beyond all bounds from the start
    let setup = Setup { clock: Clock::Fixed(0.01), ..setup() };
    let told = sampled(&setup, (ship, "kind = 'ship'"), (observer, kind), |u| *u, (&x, &z));
    assert!(told.iter().all(|run| run.diverged_at == Some(0)));
}
