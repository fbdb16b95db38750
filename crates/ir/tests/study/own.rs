//! Plants and models of the user's own, as tables, against the same equations in Rust; and what was not
//! possible while plants and observers were compiled in pairs.

use crate::experiment::{Clock, Drawn, FIRST, Kinds, Setup, Starts, joint, normal_held, sampled};
use hgo_ir::study::{LANES, Study};
use hgo_ir::{Error, Spec, Value};
use hgo_rs::Scalar;
use hgo_rs::gain::ConstantGain;
use hgo_rs::integrate::Integrator;
use hgo_rs::model::{Model, Plant, StochasticIntegrator, Unknown, last, no_input};
use hgo_rs::models::{Diffusion, Lee};
use hgo_rs::observer::{ContinuousLaw, Discretised, Euler, Observer, Status, Timing};
use hgo_rs::observers::StandardObserver;
use nalgebra::SVector;

type Nothing = SVector<f64, 0>;

fn nothing(u: &Nothing) -> Nothing {
    *u
}

fn standard<const N: usize>(
    k: [f64; N],
) -> Discretised<StandardObserver<f64, ConstantGain<f64>, Unknown, N>, Euler> {
    let gain = ConstantGain::new(20.0).unwrap();
    Discretised { law: StandardObserver::new(k, gain, Unknown).unwrap(), scheme: Euler }
}

fn kind(k: &[f64]) -> String {
    format!(
        "kind = 'standard'\nn = {}\nk = {k:?}\ngain = {{ law = 'constant', ell = 20.0 }}",
        k.len()
    )
}

/// Lee's plant: ẋ₂ = −x₁/(1 + x₁²) − x₂.
const LEE: &str = "kind = 'own-plant'\nn = 2\nparameters = []\n[plant.table]\n\
    inputs = ['t', 'x1', 'x2']\nconstants = [1.0]\n\
    ops = [['mul', 1, 1], ['add', 3, 4], ['neg', 1], ['div', 6, 5], ['sub', 7, 2]]\n\
    outputs = [2, 8, 1]";

/// An observer of order 3 beside plants of two states: built in and of the user's own.
#[test]
fn an_observer_of_another_order_than_the_plant() {
    let start: (&[f64], &[f64]) = (&[1.0, -1.0], &[0.5, 0.0, 0.0]);
    let (k, observer) = ([3.0, 3.0, 1.0], standard([3.0, 3.0, 1.0]));
    for plant in ["kind = 'lee'", LEE] {
        sampled(&normal_held(), (Lee, plant), (observer, &kind(&k)), nothing, start);
    }
}

/// A pendulum beside a slow mode, both driven, with an output that drifts: all depends on time.
#[derive(Clone, Copy, Debug)]
struct Driven;

const DRIVEN: &str = "kind = 'own-plant'\nn = 3\nparameters = [0.25]\n[plant.table]\n\
    inputs = ['t', 'x1', 'x2', 'x3', 'drift']\n\
    ops = [['sin', 0], ['sub', 5, 1], ['cos', 0], ['sin', 2], ['sub', 7, 8], ['mul', 4, 0], \
    ['add', 2, 10]]\noutputs = [6, 3, 9, 11]";

impl Plant<f64> for Driven {
    type State = SVector<f64, 3>;
    type Input = Nothing;
    type Output = f64;
    const TRUTH: (usize, usize) = (1, 2);
    fn drift(&self, t: f64, x: &Self::State, _: &Nothing) -> Self::State {
        let pendulum = Scalar::cos(t) - Scalar::sin(x.y);
        SVector::from([Scalar::sin(t) - x.x, x.z, pendulum])
    }
    fn output(&self, t: f64, x: &Self::State, _: &Nothing) -> f64 {
        x.y + 0.25 * t
    }
    fn truth<'a>(&self, x: &'a Self::State) -> &'a [f64] {
        &x.as_slice()[1..]
    }
    fn control(&self, _: f64, _: &Self::State, _: f64) -> Nothing {
        no_input()
    }
}

/// What the observer estimates stands in the middle of the plant's state.
#[test]
fn time_reaches_a_plant_and_its_output() {
    let observer = (standard([2.0, 1.0]), &*kind(&[2.0, 1.0]));
    let setup = |plant_method, plant_clock| Setup {
        plant_method,
        plant_clock,
        clock: Clock::Fixed(0.01),
        every: 16,
        truth: Some(vec![1, 2]),
        ..Setup::default()
    };
    let start: (&[f64], &[f64]) = (&[1.0, 0.5, -1.0], &[0.5, 0.0]);
    for setup in [
        setup("euler", None),
        setup("rk4", Some(Clock::Fixed(0.013))),
        setup("bogacki-shampine", Some(Clock::Decreasing([0.1, 0.2, 50.0, 1.0]))),
    ] {
        sampled(&setup, (Driven, DRIVEN), observer, nothing, start);
    }
    // within a step too, where plant and law are one equation
    let (law, rk4) = (standard([2.0, 1.0]).law, kind(&[2.0, 1.0]) + "\nmethod = 'rk4'");
    joint(&setup("rk4", None), (Driven, DRIVEN), (law, &rk4), Integrator::Rk4, start);
}

/// (t, x₁, x₂, ε, σ) → drift, diffusion, output of Fu, Kang and Li (18).
fn van_der_pol(diffusion: Diffusion) -> String {
    let noise = match diffusion {
        Diffusion::Additive => "['mul', 4, 6]",
        Diffusion::Multiplicative => "['mul', 4, 2]",
    };
    format!(
        "kind = 'own-plant'\nn = 2\nnoisy = true\nparameters = [0.8, 0.5]\n[plant.table]\n\
         inputs = ['t', 'x1', 'x2', 'epsilon', 'sigma']\nconstants = [0.0, 1.0]\n\
         ops = [['neg', 1], ['mul', 1, 1], ['sub', 6, 8], ['mul', 3, 9], ['mul', 10, 2], \
         ['add', 7, 11], {noise}]\noutputs = [2, 12, 5, 13, 1]"
    )
}

/// Both by the same scheme and the same draws: derived and written down derivatives differ by rounding.
#[test]
fn schemes_with_derivatives_of_an_own_plant() {
    use Diffusion::{Additive, Multiplicative};
    let observer = kind(&[2.0, 1.0]);
    let starts = Starts::Spread(vec![1.0, -0.5], vec![0.5, 0.0]);
    for (plant_method, diffusion) in [
        ("euler-maruyama", Additive),
        ("euler-maruyama", Multiplicative),
        ("milstein", Additive),
        ("milstein", Multiplicative),
        ("taylor-1.5", Additive),
    ] {
        let setup = Setup { plant_method, clock: Clock::Fixed(0.01), ..Setup::default() };
        let run = |plant: &str| {
            let kinds = Kinds { plant, observer: &observer, joint: false };
            setup.study(kinds, &starts, LANES).run(None, &|| false).unwrap()
        };
        let multiplicative = diffusion == Multiplicative;
        let built_in = run(&format!(
            "kind = 'van-der-pol'\nepsilon = 0.8\nsigma = 0.5\nmultiplicative = {multiplicative}"
        ));
        let own = run(&van_der_pol(diffusion));
        for (own, built_in) in own.runs.iter().zip(&built_in.runs) {
            for (own, built_in) in own.final_x.iter().zip(&built_in.final_x) {
                let close = (own - built_in).abs() <= 1e-12 * (1.0 + built_in.abs());
                assert!(close, "{plant_method}, {diffusion:?}: {own} and {built_in}");
            }
        }
        // and neither is the one of a simpler scheme
        let simple = Setup { plant_method: "euler-maruyama", ..setup.clone() };
        let kinds = Kinds { plant: &van_der_pol(diffusion), observer: &observer, joint: false };
        let simple = simple.study(kinds, &starts, LANES).run(None, &|| false).unwrap();
        let differs = simple.runs[0].final_x != own.runs[0].final_x;
        let same =
            plant_method == "euler-maruyama" || (plant_method, diffusion) == ("milstein", Additive);
        assert_eq!(differs, !same, "{plant_method}, {diffusion:?}");
    }
}

/// dx = (sin t − x³) dt + 0.3 dW: every term of the scheme of order 1.5 counts.
#[derive(Clone, Copy, Debug)]
struct Cubic;

impl Plant<f64> for Cubic {
    type State = SVector<f64, 1>;
    type Input = Nothing;
    type Output = f64;
    const TRUTH: (usize, usize) = (0, 1);
    fn drift(&self, t: f64, x: &Self::State, _: &Nothing) -> Self::State {
        SVector::from([Scalar::sin(t) - x.x * x.x * x.x])
    }
    fn output(&self, _: f64, x: &Self::State, _: &Nothing) -> f64 {
        x.x
    }
    fn truth<'a>(&self, x: &'a Self::State) -> &'a [f64] {
        x.as_slice()
    }
    fn control(&self, _: f64, _: &Self::State, _: f64) -> Nothing {
        no_input()
    }
    fn has_process_noise(&self) -> bool {
        true
    }
    fn supports(&self, _: StochasticIntegrator) -> bool {
        true
    }
    fn diffusion(&self, _: f64, _: &Self::State, _: &Nothing) -> Self::State {
        SVector::from([0.3])
    }
    fn jacobian_times(&self, _: f64, x: &Self::State, _: &Nothing, v: &Self::State) -> Self::State {
        v * (-3.0 * x.x * x.x)
    }
    fn curvature(&self, t: f64, x: &Self::State, _: &Nothing) -> Self::State {
        SVector::from([Scalar::cos(t) - 0.5 * 6.0 * x.x * 0.09])
    }
}

const CUBIC: &str = "kind = 'own-plant'\nn = 1\nnoisy = true\nparameters = []\n[plant.table]\n\
    inputs = ['t', 'x']\nconstants = [0.3]\n\
    ops = [['sin', 0], ['mul', 1, 1], ['mul', 4, 1], ['sub', 3, 5]]\noutputs = [6, 2, 1]";

#[test]
fn the_scheme_of_order_one_and_a_half_in_full() {
    use hgo_rs::integrate::WienerIncrement;
    use hgo_rs::noise::{Channel, Draw, Noise, Stream};
    let setup = Setup {
        plant_method: "taylor-1.5",
        substeps: 1,
        clock: Clock::Fixed(0.1),
        drawn: Drawn::Nothing,
        ..Setup::default()
    };
    let kinds = Kinds { plant: CUBIC, observer: &kind(&[1.0]), joint: false };
    let starts = Starts::Spread(vec![0.5], vec![0.0]);
    let result = setup.study(kinds, &starts, LANES).run(None, &|| false).unwrap();
    let noise = Noise { draw: Draw::<f64>::None, hold: 1, sines: &[] };
    assert_eq!(noise.hold, setup.hold);
    for (run, told) in result.runs.iter().enumerate() {
        let mut stream = Stream::new(11, FIRST + run as u64, Channel::Process);
        let mut x = SVector::from([0.5 * (1.0 + 0.01 * run as f64)]);
        for k in 0..setup.steps {
            let w = WienerIncrement::from_normals(stream.normal_pair(), 0.1);
            let scheme = StochasticIntegrator::Taylor15;
            x = scheme.step(&Cubic, k as f64 * 0.1, &x, &no_input(), 0.1, w);
        }
        let own = told.final_x[0];
        assert!((own - x.x).abs() <= 1e-12 * (1.0 + x.x.abs()), "run {run}: {own} and {}", x.x);
    }
}

/// Two swings that drive each other, both measured.
#[derive(Clone, Copy, Debug)]
struct TwoSwings;

const TWO_SWINGS: &str = "kind = 'own-plant'\nn = 4\nn_y = 2\nparameters = []\n[plant.table]\n\
    inputs = ['t', 'a', 'b', 'c', 'd']\nops = [['sub', 3, 1], ['mul', 1, 3], ['neg', 6]]\n\
    outputs = [2, 5, 4, 7, 1, 3]";

impl Plant<f64> for TwoSwings {
    type State = SVector<f64, 4>;
    type Input = Nothing;
    type Output = SVector<f64, 2>;
    const TRUTH: (usize, usize) = (0, 4);
    fn drift(&self, _: f64, x: &Self::State, _: &Nothing) -> Self::State {
        SVector::from([x[1], x[2] - x[0], x[3], -(x[0] * x[2])])
    }
    fn output(&self, _: f64, x: &Self::State, _: &Nothing) -> Self::Output {
        SVector::from([x[0], x[2]])
    }
    fn truth<'a>(&self, x: &'a Self::State) -> &'a [f64] {
        x.as_slice()
    }
    fn control(&self, _: f64, _: &Self::State, _: f64) -> Nothing {
        no_input()
    }
}

/// What one of the swings knows: the other's angle stands at its estimate.
#[derive(Clone, Copy, Debug)]
struct Swing {
    first: bool,
    other: f64,
}

impl Model<f64, 2> for Swing {
    fn f_hat(&self, _: f64, x: &SVector<f64, 2>, _: &Nothing) -> SVector<f64, 2> {
        last(if self.first { self.other - x.x } else { -(self.other * x.x) })
    }
}

/// A standard observer for each of the swings.
#[derive(Clone, Copy, Debug)]
struct TwoObservers;

impl Observer<f64> for TwoObservers {
    type State = SVector<f64, 4>;
    type Measurement = SVector<f64, 2>;
    type Input = Nothing;
    const TIMING: Timing = Timing::Predictor;
    const ESTIMATED: usize = 4;
    fn initial(&self) -> Self::State {
        SVector::zeros()
    }
    fn advance(
        &self,
        z: &mut Self::State,
        y: &Self::Measurement,
        u: &Nothing,
        t: f64,
        dt: f64,
    ) -> Status {
        let before = *z;
        for (chain, ell) in [(0, 20.0), (1, 30.0)] {
            let model = Swing { first: chain == 0, other: before[2 - 2 * chain] };
            let gain = ConstantGain::new(ell).unwrap();
            let law = StandardObserver::<f64, _, _, 2>::new([2.0, 1.0], gain, model).unwrap();
            let x_hat = SVector::from([before[2 * chain], before[2 * chain + 1]]);
            let mut memory = law.initial();
            memory.x_hat = x_hat;
            Discretised { law, scheme: Euler }.advance(&mut memory, &y[chain], u, t, dt);
            z.as_mut_slice()[2 * chain..2 * chain + 2].copy_from_slice(memory.x_hat.as_slice());
        }
        Status::of(y)
    }
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [f64] {
        z.as_slice()
    }
    fn innovation(
        &self,
        _: f64,
        z: &Self::State,
        y: &Self::Measurement,
        _: &Nothing,
    ) -> Self::Measurement {
        y - SVector::from([z[0], z[2]])
    }
}

#[test]
fn a_plant_of_several_outputs_and_an_observer_for_each() {
    let one = |ell: f64| {
        format!(
            "[[observer.observers]]\nkind = 'standard'\nn = 2\nk = [2.0, 1.0]\n\
             gain = {{ law = 'constant', ell = {ell:?} }}\n"
        )
    };
    let kind = format!(
        "kind = 'chains'\n{}{}[observer.model]\nkind = 'own'\nform = 'chains'\nn = 4\nn_u = 0\n\
         orders = [2, 2]\nparameters = []\n[observer.model.table]\ninputs = ['t', 'a', 'b', 'c', 'd']\n\
         ops = [['sub', 3, 1], ['mul', 1, 3], ['neg', 6]]\noutputs = [5, 7]",
        one(20.0),
        one(30.0)
    );
    let start: (&[f64], &[f64]) = (&[1.0, 0.0, 0.5, -0.5], &[0.5, 0.0, 0.0, 0.0]);
    for setup in [normal_held(), Setup { every: 9, ..Setup::default() }] {
        sampled(&setup, (TwoSwings, TWO_SWINGS), (TwoObservers, &kind), nothing, start);
    }
}

fn refusal(text: &str) -> String {
    let value = Value::from_toml(text).unwrap();
    match Spec::new(&value, "study").and_then(|spec| Study::read(&spec)) {
        Err(Error::Refused(message)) => message,
        Err(other) => panic!("another error: {other}"),
        Ok(_) => panic!("nothing was refused: {text}"),
    }
}

#[test]
fn what_a_plant_does_not_take_is_refused_by_name() {
    let study = |method: &str, plant: &str| {
        refusal(&format!(
            "steps = 5\nplant_method = '{method}'\nschedule = {{ kind = 'fixed', dt = 0.01 }}\n\
             x0 = [1.0, 0.0]\nmemory0 = [0.0, 0.0]\n[observer]\n{}\n[plant]\n{plant}",
            kind(&[2.0, 1.0])
        ))
    };
    let noisy = van_der_pol(Diffusion::Multiplicative);
    let message = study("taylor-1.5", &noisy);
    assert!(message.contains("'taylor-1.5'") || message.contains("\"taylor-1.5\""), "{message}");
    assert!(message.contains("additive"), "{message}");
    let message = study("rk4", &noisy);
    assert!(message.contains("process noise") && message.contains("milstein"), "{message}");
    let message = study("milstein", LEE);
    assert!(message.contains("needs a plant with process noise"), "{message}");
    let message = study("rk4", "kind = 'ship'");
    assert!(message.contains("1 outputs does not fit this plant, which has 3"), "{message}");
    let message = study("heun", LEE);
    assert!(message.contains("\"heun\" is not known"), "{message}");
}
