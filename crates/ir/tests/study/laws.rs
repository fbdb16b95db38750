//! The papers' plants beside the laws, under schemes, timings, gains, schedules, noises and metrics.

use crate::experiment::{Clock, Drawn, Setup, joint, normal_held, sampled};
use hgo_rs::gain::{AdaptiveGain, ConstantGain, DeadZoneGain};
use hgo_rs::injection::{Placed, Placement};
use hgo_rs::integrate::Integrator;
use hgo_rs::metrics::Window;
use hgo_rs::model::{InputGain, Plant, Unknown};
use hgo_rs::models::{Correction, Crackle, Diffusion, Lee, SanfelicePraly, Ship, VanDerPol};
use hgo_rs::noise::{Law, Sine};
use hgo_rs::observer::{
    BogackiShampine, Current, Discretised, Euler, Observer, Rk4, Rk4InnovationHeld, StaggeredEuler,
};
use hgo_rs::observers::{
    HardClip, LowPowerObserver, ModifiedObserver, NoSaturation, PeakingFreeObserver,
    ReducedOrderObserver, RepelledCollection, SampledDataObserver, SmoothSaturation,
    StandardObserver,
};
use nalgebra::SVector;

type Nothing = SVector<f64, 0>;

fn nothing(u: &Nothing) -> Nothing {
    *u
}

const LEE: &str = "kind = 'lee'";
const SHIP: &str = "kind = 'ship'\ndelta = 0.1\nw = [0.01, 0.0, 0.0]";
const OSCILLATOR: &str = "kind = 'sanfelice-praly'\nnu1 = 1.9\nnu2 = 0.1";
const CRACKLE: &str = "kind = 'crackle'\nphi_max = 3.0";

fn oscillator() -> SanfelicePraly<f64> {
    SanfelicePraly::new(1.9, 0.1).unwrap()
}

fn crackle() -> Crackle<f64> {
    Crackle::new(3.0).unwrap()
}

fn van_der_pol(
    sigma: f64,
    diffusion: Diffusion,
    correction: Correction,
) -> (VanDerPol<f64>, String) {
    let plant = VanDerPol::new(0.8, sigma, diffusion, correction).unwrap();
    let multiplicative = diffusion == Diffusion::Multiplicative;
    let kind = format!(
        "kind = 'van-der-pol'\nepsilon = 0.8\nsigma = {sigma:?}\nmultiplicative = {multiplicative}"
    );
    (plant, kind)
}

fn ell(ell: f64) -> ConstantGain<f64> {
    ConstantGain::new(ell).unwrap()
}

/// A standard observer of order 2 that knows nothing.
fn standard(gain: f64) -> StandardObserver<f64, ConstantGain<f64>, Unknown, 2> {
    StandardObserver::new([2.0; 2], ell(gain), Unknown).unwrap()
}

fn standard_kind(gain: f64, manner: &str) -> String {
    format!(
        "kind = 'standard'\nn = 2\nk = [2.0, 2.0]\ngain = {{ law = 'constant', ell = {gain:?} }}\n{manner}"
    )
}

const CURRENT_ZOH: &str = "method = 'zoh'\ntiming = 'current'";

#[test]
fn lee_under_all_clocks() {
    let at_start: (&[f64], &[f64]) = (&[10.0, 10.0], &[0.0, 0.0]);
    let observer = Discretised { law: standard(100.0), scheme: Euler };
    let kind = standard_kind(100.0, "");
    let fixed = Setup { clock: Clock::Fixed(4e-4), ..Setup::default() };
    let decreasing =
        Setup { clock: Clock::Decreasing([0.04, 0.01, 20_000.0, 1.0]), ..fixed.clone() };
    for setup in [
        fixed.clone(),
        // one pass for draw, observer and plant
        Setup { plant_method: "euler", substeps: 1, ..fixed.clone() },
        decreasing.clone(),
        // plants by a schedule of their own: slower, and at steps of another kind
        Setup { plant_clock: Some(Clock::Fixed(3e-4)), ..fixed.clone() },
        Setup { plant_clock: Some(Clock::Fixed(3e-4)), every: 7, ..decreasing.clone() },
    ] {
        let told = sampled(&setup, (Lee, LEE), (observer, &kind), nothing, at_start);
        assert!(told.iter().all(|run| run.diverged_at.is_none()));
    }
    // gains that are constants of the table, and gains that it computes
    for setup in [fixed, decreasing] {
        let law = standard(100.0);
        let placed = |at| Placed::new(&law, at).unwrap();
        let (exact, bilinear) = (placed(Placement::Exact), placed(Placement::Bilinear));
        let observer = Current { law, scheme: exact };
        let kind = standard_kind(100.0, CURRENT_ZOH);
        let with_elapsed: (&[f64], &[f64]) = (&[10.0, 10.0], &[0.0, 0.0, 0.0]);
        sampled(&setup, (Lee, LEE), (observer, &kind), nothing, with_elapsed);
        let observer = Discretised { law, scheme: bilinear };
        let kind = standard_kind(100.0, "method = 'bilinear'");
        sampled(&setup, (Lee, LEE), (observer, &kind), nothing, at_start);
    }
}

#[test]
fn noises_windows_and_metrics() {
    let start: (&[f64], &[f64]) = (&[1.0, 1.0], &[0.0, 0.0]);
    let observer = Discretised { law: standard(30.0), scheme: Rk4 };
    let kind = standard_kind(30.0, "method = 'rk4'");
    let sines = vec![
        Sine { amplitude: 0.05, omega: 377.0, phase: 0.0 },
        Sine { amplitude: 0.01, omega: 6.0, phase: 1.0 },
    ];
    let with_unit = [sines.clone(), vec![Sine { amplitude: 0.0, omega: 1.0, phase: 0.0 }]].concat();
    let ramp: Vec<f64> = (0..301).map(|k| 1e-3 * f64::from(k % 13)).collect();
    let window = |from, to| Window { from, to };
    for setup in [
        normal_held(),
        Setup { drawn: Drawn::Law(Law::StudentT { nu: 2.5 }, 0.1, 0.01), ..Setup::default() },
        Setup { drawn: Drawn::Law(Law::Laplace, 0.0, 0.02), hold: 3, ..Setup::default() },
        Setup {
            drawn: Drawn::Law(Law::Impulsive { probability: 0.1, ratio: 20.0 }, 0.0, 0.02),
            ..Setup::default()
        },
        Setup { drawn: Drawn::Nothing, ..Setup::default() },
        Setup { drawn: Drawn::Nothing, sines: with_unit.clone(), ..Setup::default() },
        Setup { drawn: Drawn::Uniform(-0.1, 0.3), hold: 4, sines: with_unit, ..Setup::default() },
        Setup { drawn: Drawn::Recorded(vec![ramp.clone()]), ..Setup::default() },
        Setup { drawn: Drawn::Recorded(vec![ramp]), hold: 2, ..Setup::default() },
        // some metrics; no window, overlapping ones, and those that reach beyond the end
        Setup { metrics: Some(vec!["rms"]), ..normal_held() },
        Setup { metrics: Some(vec!["max", "peak"]), ..normal_held() },
        Setup { windows: Vec::new(), ..normal_held() },
        Setup {
            windows: vec![window(0, 1), window(10, 200), window(64, 128), window(150, 1000)],
            ..normal_held()
        },
        // a frame each sample, and more seldom than spans end
        Setup { every: 1, steps: 70, ..normal_held() },
        Setup { every: 90, ..normal_held() },
        // one step: the last sample moves nothing
        Setup { steps: 1, every: 1, ..normal_held() },
    ] {
        sampled(&setup, (Lee, LEE), (observer, &kind), nothing, start);
    }
}

/// Every law that needs no model, beside a plant with one output and no input.
fn pairs<P>(plant: P, plant_kind: &str, plant_method: &'static str, x: &[f64])
where
    P: Plant<f64, Output = f64, Input = Nothing>,
{
    let setup = Setup {
        plant_method,
        substeps: 3,
        clock: Clock::Fixed(2e-3),
        steps: 130,
        every: 50,
        windows: vec![Window { from: 20, to: 131 }],
        ..normal_held()
    };
    let go = |observer_kind: &str, z: &[f64], check: &dyn Fn(&str, &[f64])| check(observer_kind, z);
    macro_rules! beside {
        ($observer:expr, $kind:expr, $z:expr) => {
            go(&$kind, &$z, &|kind, z| {
                sampled(&setup, (plant, plant_kind), ($observer, kind), nothing, (x, z));
            });
        };
    }
    let gain = "gain = { law = 'constant', ell = 9.0 }";
    // fewer states than the plant, as many, and more
    let law = StandardObserver::<f64, _, _, 1>::new([1.0], ell(9.0), Unknown).unwrap();
    let kind = format!("kind = 'standard'\nn = 1\nk = [1.0]\n{gain}\nmethod = 'bogacki-shampine'");
    beside!(Discretised { law, scheme: BogackiShampine }, kind, [0.5]);
    let law = standard(9.0);
    let scheme = Placed::new(&law, Placement::Exact).unwrap();
    beside!(Current { law, scheme }, standard_kind(9.0, CURRENT_ZOH), [0.5, 0.0, 0.0]);
    let law = StandardObserver::<f64, _, _, 3>::new([3.0, 3.0, 1.0], ell(9.0), Unknown).unwrap();
    let kind = format!(
        "kind = 'standard'\nn = 3\nk = [3.0, 3.0, 1.0]\n{gain}\nmethod = 'staggered-euler'"
    );
    beside!(Discretised { law, scheme: StaggeredEuler }, kind, [0.5, 0.0, 0.0]);

    let (alpha, beta) = ([2.0, 2.0], [2.0, 0.0]);
    let low_power = "kind = 'low-power'\nn = 2\nalpha = [2.0, 2.0]\nbeta = [2.0]";
    let law = LowPowerObserver::<f64, _, _, 2>::new(alpha, beta, ell(9.0), Unknown, NoSaturation);
    let law = law.unwrap();
    let scheme = Placed::new(&law, Placement::Exact).unwrap();
    let kind = format!("{low_power}\n{gain}\n{CURRENT_ZOH}");
    beside!(Current { law, scheme }, kind, [0.5, 0.0, 0.0, 0.0]);
    let adaptive = AdaptiveGain::new(10.0, 0.0025, 0.183).unwrap();
    let moving = "gain = { law = 'adaptive', p1 = 10.0, p2 = 0.0025, b = 0.183 }";
    let law = LowPowerObserver::<f64, _, _, 2>::new(alpha, beta, adaptive, Unknown, NoSaturation);
    let (law, kind) = (law.unwrap(), format!("{low_power}\n{moving}"));
    beside!(Discretised { law, scheme: Euler }, kind, [0.5, 0.0, 0.0, 1.0]);
    let clip = HardClip::new([3.0; 2]).unwrap();
    let law = PeakingFreeObserver::<f64, _, _, _, 2>::new(alpha, beta, ell(9.0), Unknown, clip);
    let kind = format!(
        "kind = 'peaking-free'\nn = 2\nalpha = [2.0, 2.0]\nbeta = [2.0]\nsaturation = [3.0]\n{gain}\n\
         method = 'rk4-innovation-held'"
    );
    beside!(Discretised { law: law.unwrap(), scheme: Rk4InnovationHeld }, kind, [0.5, 0.0, 0.0]);

    let copies = "n = 2\nk = [2.0, 2.0]\nk_bar = [0.0558, 0.0317]\ncopies = 3";
    let (k, k_bar) = ([2.0; 2], [0.0558, 0.0317]);
    let collection = RepelledCollection::<f64, _, 2, 3>::new(k, k_bar, adaptive, Unknown).unwrap();
    let three: Vec<f64> = collection_start(&collection);
    let kind = format!("kind = 'collection'\n{copies}\n{moving}");
    beside!(Discretised { law: collection, scheme: Euler }, kind, three);
    let law = ModifiedObserver { collection };
    let kind = format!("kind = 'modified'\n{copies}\n{moving}\nmethod = 'rk4'");
    let four: Vec<f64> = collection_start(&law);
    beside!(Discretised { law, scheme: Rk4 }, kind, four);

    let (model, model_kind) = van_der_pol(0.5, Diffusion::Additive, Correction::Derived);
    let kind = format!("kind = 'sampled-data'\n[observer.model]\n{model_kind}");
    beside!(SampledDataObserver::<_, 2> { model }, kind, [0.5, 0.0]);
}

/// Copies that differ.
fn collection_start<L>(collection: &L) -> Vec<f64>
where
    L: hgo_rs::observer::ContinuousLaw<f64>,
{
    use hgo_rs::memory::Memory;
    let mut z = Vec::new();
    collection.initial().visit(&mut |value| z.push(value + 1e-2 * z.len() as f64));
    z
}

#[test]
fn all_pairs() {
    pairs(Lee, LEE, "rk4", &[1.0, -1.0]);
    pairs(oscillator(), OSCILLATOR, "bogacki-shampine", &[-0.1 / 1.9, 0.0]);
    pairs(oscillator(), OSCILLATOR, "held", &[-0.1 / 1.9, 0.0]);
    pairs(crackle(), CRACKLE, "euler", &[-0.8, 0.0, 0.0, 0.0, 0.0]);
    let (still, kind) = van_der_pol(0.0, Diffusion::Additive, Correction::Derived);
    pairs(still, &kind, "rk4", &[1.0, 0.0]);
    let (noisy, kind) = van_der_pol(0.5, Diffusion::Additive, Correction::Derived);
    pairs(noisy, &kind, "taylor-1.5", &[1.0, 0.0]);
}

#[test]
fn gains_that_move_and_models_that_are_known() {
    let plant = oscillator();
    let start: (&[f64], &[f64]) = (&[-0.1 / 1.9, 0.0], &[1.0, 0.0, 1.0]);
    let setup = Setup { clock: Clock::Fixed(9e-3), plant_method: "held", ..normal_held() };
    let kind = |law: &str, manner: &str| {
        format!(
            "kind = 'standard'\nn = 2\nk = [2.0, 2.0]\n{manner}\n\
             gain = {{ law = '{law}', p1 = 10.0, p2 = 0.0025, b = 0.183 }}\n\
             [observer.model]\n{OSCILLATOR}"
        )
    };
    let gain = AdaptiveGain::new(10.0, 0.0025, 0.183).unwrap();
    let law = StandardObserver::<f64, _, _, 2>::new([2.0; 2], gain, plant).unwrap();
    let observer = Discretised { law, scheme: Rk4 };
    let rk4 = kind("adaptive", "method = 'rk4'");
    sampled(&setup, (plant, OSCILLATOR), (observer, &rk4), nothing, start);
    let moving = Setup { plant_method: "rk4", ..setup };
    let observer = Current { law, scheme: Placed::new(&law, Placement::Exact).unwrap() };
    let current: (&[f64], &[f64]) = (start.0, &[1.0, 0.0, 1.0, 0.0]);
    let zoh = kind("adaptive", CURRENT_ZOH);
    sampled(&moving, (plant, OSCILLATOR), (observer, &zoh), nothing, current);
    let gain = DeadZoneGain::new(10.0, 0.0025, 0.183).unwrap();
    let law = StandardObserver::<f64, _, _, 2>::new([2.0; 2], gain, plant).unwrap();
    let observer = Discretised { law, scheme: StaggeredEuler };
    let staggered = kind("dead-zone", "method = 'staggered-euler'");
    sampled(&moving, (plant, OSCILLATOR), (observer, &staggered), nothing, start);
    // an input that the plant has not is told to be 0
    let law = StandardObserver::<f64, _, _, 2, 1>::new([2.0; 2], ell(20.0), InputGain { b0: 3.0 });
    let observer = Discretised { law: law.unwrap(), scheme: Euler };
    let input = standard_kind(20.0, "[observer.model]\nkind = 'input'\nb0 = 3.0");
    let tell = |_: &Nothing| SVector::<f64, 1>::zeros();
    sampled(&moving, (Lee, LEE), (observer, &input), tell, (&[1.0, 1.0], &[0.0, 0.0]));
}

#[test]
fn order_five_of_each_kind() {
    let (alpha, beta) = ([3.0, 3.0, 3.0, 3.0, 2.0], [8.5714, 3.2122, 1.4267, 0.5347, 0.0]);
    let gain = "gain = { law = 'constant', ell = 7.0 }";
    let model = format!("[observer.model]\n{CRACKLE}");
    let x: &[f64] = &[-0.8, 0.0, 0.0, 0.0, 0.0];
    let setup = Setup { steps: 150, ..normal_held() };
    let k = [7.5, 22.1875, 32.343_75, 23.218_75, 6.5625];
    let law = StandardObserver::<f64, _, _, 5>::new(k, ell(7.0), crackle()).unwrap();
    let observer = Discretised { law, scheme: Placed::new(&law, Placement::Exact).unwrap() };
    let kind = format!("kind = 'standard'\nn = 5\nk = {k:?}\n{gain}\nmethod = 'zoh'\n{model}");
    sampled(&setup, (crackle(), CRACKLE), (observer, &kind), nothing, (x, &[0.0; 5]));
    let coefficients = format!("n = 5\nalpha = {alpha:?}\nbeta = {:?}\n{gain}", &beta[..4]);
    let low_power =
        LowPowerObserver::<f64, _, _, 5>::new(alpha, beta, ell(7.0), crackle(), NoSaturation);
    let law = low_power.unwrap();
    let scheme = Placed::new(&law, Placement::Exact).unwrap();
    let kind = format!("kind = 'low-power'\n{coefficients}\nmethod = 'zoh'\n{model}");
    let observer = Discretised { law, scheme };
    sampled(&setup, (crackle(), CRACKLE), (observer, &kind), nothing, (x, &[0.0; 9]));
    let smooth = SmoothSaturation::new([3.0; 5]).unwrap();
    let law = PeakingFreeObserver::<f64, _, _, _, 5>::new(alpha, beta, ell(7.0), crackle(), smooth);
    let observer = Discretised { law: law.unwrap(), scheme: BogackiShampine };
    let kind = format!(
        "kind = 'peaking-free'\n{coefficients}\nsaturation = [3.0, 3.0, 3.0, 3.0]\nclip = 'smooth'\n\
         method = 'bogacki-shampine'\n{model}"
    );
    sampled(&setup, (crackle(), CRACKLE), (observer, &kind), nothing, (x, &[0.0; 9]));
}

#[test]
fn process_noise_and_runs_that_diverge() {
    let start: (&[f64], &[f64]) = (&[1.0, 0.0], &[0.0, 1.0]);
    for (plant_method, dt, diffusion, correction) in [
        ("euler-maruyama", 0.3, Diffusion::Additive, Correction::Derived),
        ("milstein", 0.03, Diffusion::Multiplicative, Correction::Derived),
        ("taylor-1.5", 0.1, Diffusion::Additive, Correction::Printed),
    ] {
        let (model, kind) = van_der_pol(0.5, diffusion, correction);
        let printed = if correction == Correction::Printed { "printed" } else { "derived" };
        let observer_kind =
            format!("kind = 'sampled-data'\ngain = '{printed}'\n[observer.model]\n{kind}");
        let setup = Setup {
            plant_method,
            substeps: 1,
            clock: Clock::Fixed(dt),
            drawn: Drawn::Nothing,
            steps: 700,
            windows: vec![Window { from: 0, to: 40 }, Window { from: 100, to: 701 }],
            every: 64,
            ..Setup::default()
        };
        let observer = SampledDataObserver::<_, 2> { model };
        let told = sampled(&setup, (model, &kind), (observer, &observer_kind), nothing, start);
        // at 0.3 s some runs diverge beside others that do not
        let ends: Vec<u64> = told.iter().filter_map(|run| run.diverged_at).collect();
        let some = !ends.is_empty() && ends.len() < told.len();
        assert_eq!(some, dt > 0.2, "{ends:?}");
        // in the middle of a span, and not all at once
        assert!(!some || ends.iter().any(|k| k % 64 != 0) && ends.iter().any(|k| *k != ends[0]));
    }
    // all at once: an observer beyond its step limit
    let observer = Discretised { law: standard(100.0), scheme: Euler };
    let setup = Setup { clock: Clock::Fixed(0.05), every: 10, ..normal_held() };
    let kind = standard_kind(100.0, "");
    let told = sampled(&setup, (Lee, LEE), (observer, &kind), nothing, (&[1.0; 2], &[0.0; 2]));
    assert!(told.iter().all(|run| run.diverged_at.is_some_and(|k| k > 1)));
    // before the first step
    let start: (&[f64], &[f64]) = (&[1.0; 2], &[2e12, 0.0]);
    let told = sampled(&setup, (Lee, LEE), (observer, &kind), nothing, start);
    assert!(told.iter().all(|run| run.diverged_at == Some(0)));
}

#[test]
fn a_filter_with_inputs() {
    let ship = Ship::new(0.1, [0.01, 0.0, 0.0]).unwrap();
    let observer = ReducedOrderObserver::new([0.1, 0.2, 0.2], 0.1, ship).unwrap();
    let kind = format!(
        "kind = 'reduced-order'\nh_bar = [0.1, 0.2, 0.2]\nepsilon = 0.1\n[observer.model]\n{SHIP}"
    );
    let (mut z, x) = (Vec::new(), [0.0, 10.0, 0.5, 0.5, -0.5, -0.5]);
    hgo_rs::memory::Memory::visit(&observer.initial(), &mut |value| z.push(value));
    for drawn in [Drawn::Nothing, Drawn::Uniform(-1e-4, 1e-4), Drawn::Normal(0.0, 1e-4)] {
        let setup = Setup { drawn, clock: Clock::Fixed(0.01), every: 25, ..Setup::default() };
        sampled(&setup, (ship, SHIP), (observer, &kind), |u| *u, (&x, &z));
    }
}

#[test]
fn plant_and_law_as_one_equation() {
    let sines = vec![
        Sine { amplitude: 0.05, omega: 377.0, phase: 0.5 },
        Sine { amplitude: 0.0, omega: 1.0, phase: 0.0 },
    ];
    let kind = standard_kind(30.0, "");
    for setup in [
        normal_held(),
        Setup { sines, every: 30, ..normal_held() },
        Setup { plant_method: "held", ..Setup::default() },
        Setup { clock: Clock::Decreasing([0.04, 0.01, 200.0, 0.8]), ..Setup::default() },
    ] {
        let start: (&[f64], &[f64]) = (&[1.0, 1.0], &[0.0, 0.0]);
        joint(&setup, (Lee, LEE), (standard(30.0), &kind), Integrator::Euler, start);
    }
    let gain = AdaptiveGain::new(10.0, 0.0025, 0.183).unwrap();
    let law = StandardObserver::<f64, _, _, 2>::new([2.0; 2], gain, oscillator()).unwrap();
    let kind = format!(
        "kind = 'standard'\nn = 2\nk = [2.0, 2.0]\nmethod = 'rk4'\n\
         gain = {{ law = 'adaptive', p1 = 10.0, p2 = 0.0025, b = 0.183 }}\n[observer.model]\n{OSCILLATOR}"
    );
    let start: (&[f64], &[f64]) = (&[-0.1 / 1.9, 0.0], &[1.0, 0.0, 1.0]);
    joint(&normal_held(), (oscillator(), OSCILLATOR), (law, &kind), Integrator::Rk4, start);
    let (alpha, beta) = ([3.0, 3.0, 3.0, 3.0, 2.0], [8.5714, 3.2122, 1.4267, 0.5347, 0.0]);
    let clip = HardClip::new([3.0; 5]).unwrap();
    let law = PeakingFreeObserver::<f64, _, _, _, 5>::new(alpha, beta, ell(7.0), crackle(), clip);
    let kind = format!(
        "kind = 'peaking-free'\nn = 5\nalpha = {alpha:?}\nbeta = {:?}\nmethod = 'bogacki-shampine'\n\
         saturation = [3.0, 3.0, 3.0, 3.0]\ngain = {{ law = 'constant', ell = 7.0 }}\n\
         [observer.model]\n{CRACKLE}",
        &beta[..4]
    );
    let start: (&[f64], &[f64]) = (&[-0.8, 0.0, 0.0, 0.0, 0.0], &[0.0; 9]);
    let scheme = Integrator::BogackiShampine;
    joint(&normal_held(), (crackle(), CRACKLE), (law.unwrap(), &kind), scheme, start);
    // beyond the step limit
    let setup = Setup { clock: Clock::Fixed(0.3), ..normal_held() };
    let told = joint(
        &setup,
        (Lee, LEE),
        (standard(30.0), &standard_kind(30.0, "")),
        Integrator::Euler,
        (&[1.0, 1.0], &[0.0, 0.0]),
    );
    assert!(told.iter().all(|run| run.diverged_at.is_some()));
}
