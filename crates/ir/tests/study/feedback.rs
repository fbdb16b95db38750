//! Loops: a study's feedback, a table, against a closure over the core's experiment.

use crate::experiment::{Setup, closed, normal_held};
use hgo_rs::Scalar;
use hgo_rs::gain::ConstantGain;
use hgo_rs::model::{InputGain, Plant};
use hgo_rs::observer::{Current, Discretised, Euler};
use hgo_rs::observers::StandardObserver;
use nalgebra::{SVector, Vector1, Vector2};

/// ẋ₁ = x₂, ẋ₂ = u − sin x₁, y = x₁ + u/8.
#[derive(Clone, Copy, Debug)]
struct Pendulum;

const PENDULUM: &str = "kind = 'own-plant'\nn = 2\nn_u = 1\nparameters = []\n[plant.table]\n\
    inputs = ['t', 'x1', 'x2', 'u']\nconstants = [0.125]\n\
    ops = [['sin', 1], ['sub', 3, 5], ['mul', 4, 3], ['add', 1, 7]]\noutputs = [2, 6, 8]";

impl Plant<f64> for Pendulum {
    type State = Vector2<f64>;
    type Input = Vector1<f64>;
    type Output = f64;
    const TRUTH: (usize, usize) = (0, 2);
    fn drift(&self, _: f64, x: &Self::State, u: &Self::Input) -> Self::State {
        Vector2::new(x.y, u.x - Scalar::sin(x.x))
    }
    fn output(&self, _: f64, x: &Self::State, u: &Self::Input) -> f64 {
        x.x + 0.125 * u.x
    }
    fn truth<'a>(&self, x: &'a Self::State) -> &'a [f64] {
        x.as_slice()
    }
    fn control(&self, _: f64, _: &Self::State, _: f64) -> Self::Input {
        Vector1::zeros()
    }
}

const OBSERVER: &str = "kind = 'standard'\nn = 2\nk = [2.0, 1.0]\n\
    gain = { law = 'constant', ell = 30.0 }\nmodel = { kind = 'input', b0 = 1.0 }\n";

/// u = min(max(sin t + y/10 − 2x̂₁ − 3x̂₂, −1), 1).
const FEEDBACK: &str = "[feedback]\nfrom = 'estimate'\ndelay = 0\nstart = []\nparameters = []\n\
    settle = []\ntells = [0]\n[feedback.law]\ninputs = ['t', 'y', 'x1_hat', 'x2_hat']\n\
    constants = [0.1, 2.0, 3.0, 1.0, -1.0]\n\
    ops = [['sin', 0], ['mul', 4, 1], ['add', 9, 10], ['mul', 5, 2], ['sub', 11, 12], \
    ['mul', 6, 3], ['sub', 13, 14], ['max', 15, 8], ['min', 16, 7]]\noutputs = [17]\n\
    [feedback.signals]\ninputs = ['t', 'x1', 'x2', 'u', 'y', 'x1_hat', 'x2_hat']\noutputs = []";

fn control(t: f64, y: &f64, x_hat: &[f64]) -> Vector1<f64> {
    let u = Scalar::sin(t) + 0.1 * y - 2.0 * x_hat[0] - 3.0 * x_hat[1];
    Vector1::new(u.clamp(-1.0, 1.0))
}

fn told(u: &Vector1<f64>) -> SVector<f64, 1> {
    *u
}

#[test]
fn loops_are_those_of_a_closure() {
    let law = StandardObserver::<f64, _, _, 2, 1>::new(
        [2.0, 1.0],
        ConstantGain::new(30.0).unwrap(),
        InputGain { b0: 1.0 },
    );
    let (law, start): (_, (&[f64], &[f64])) = (law.unwrap(), (&[0.4, -0.1], &[0.0, 0.0]));
    let predictor = Discretised { law, scheme: Euler };
    let form = format!("{OBSERVER}method = 'euler'\ntiming = 'predictor'\n{FEEDBACK}");
    for setup in [normal_held(), Setup { every: 7, ..Setup::default() }] {
        closed(&setup, (Pendulum, PENDULUM), (predictor, &form), control, told, start);
    }
    let current = Current { law, scheme: Euler };
    let form = format!("{OBSERVER}method = 'euler'\ntiming = 'current'\n{FEEDBACK}");
    let start: (&[f64], &[f64]) = (&[0.4, -0.1], &[0.0, 0.0, 0.0]);
    closed(&normal_held(), (Pendulum, PENDULUM), (current, &form), control, told, start);
}
