//! Samples that are missing: recorded noise with NaN, the same for all runs and another one a run.

use crate::experiment::{Clock, Drawn, FEW_AND_MANY, Setup, sampled};
use hgo_rs::gain::{AdaptiveGain, ConstantGain};
use hgo_rs::injection::{Placed, Placement};
use hgo_rs::memory::Memory;
use hgo_rs::model::Unknown;
use hgo_rs::models::{Correction, Diffusion, Lee, Ship, VanDerPol};
use hgo_rs::observer::{Current, Discretised, Euler, Observer};
use hgo_rs::observers::{
    LowPowerObserver, NoSaturation, ReducedOrderObserver, SampledDataObserver, StandardObserver,
};
use nalgebra::SVector;

const STEPS: u64 = 150;

/// Samples of a slow sensor, of which some more are missing; another pattern a run.
fn row(run: usize) -> Vec<f64> {
    let value = |k: usize| {
        let there = (k + run).is_multiple_of(3) && !(40..60 + run % 7).contains(&k);
        if there { 1e-4 * ((7 * k + run) % 11) as f64 } else { f64::NAN }
    };
    (0..=usize::try_from(STEPS).unwrap()).map(value).collect()
}

/// Each of the setups.
fn setups(clock: Clock) -> Vec<Setup> {
    let most = FEW_AND_MANY.into_iter().max().unwrap();
    let of =
        |drawn, hold| Setup { drawn, hold, clock, steps: STEPS, every: 13, ..Setup::default() };
    vec![
        of(Drawn::Recorded(vec![row(0)]), 1),
        of(Drawn::Recorded(vec![row(1)]), 2),
        of(Drawn::Recorded((0..most).map(row).collect()), 1),
    ]
}

fn nothing(u: &SVector<f64, 0>) -> SVector<f64, 0> {
    *u
}

/// An observer beside Lee's plant.
fn beside_lee<O>(observer: O, kind: &str, clock: Clock)
where
    O: Observer<f64, Measurement = f64, Input = SVector<f64, 0>>,
{
    let mut z = Vec::new();
    observer.initial().visit(&mut |value| z.push(value));
    for setup in setups(clock) {
        sampled(&setup, (Lee, "kind = 'lee'"), (observer, kind), nothing, (&[1.0, 1.0], &z));
    }
}

const CONSTANT: &str = "gain = { law = 'constant', ell = 20.0 }";
const CURRENT_ZOH: &str = "method = 'zoh'\ntiming = 'current'";
const FIXED: Clock = Clock::Fixed(5e-3);
const DECREASING: Clock = Clock::Decreasing([0.4, 0.05, 50.0, 0.9]);

#[test]
fn corrections_over_gaps() {
    let gain = ConstantGain::new(20.0).unwrap();
    let law = StandardObserver::<f64, _, _, 2>::new([2.0; 2], gain, Unknown).unwrap();
    let observer = Current { law, scheme: Placed::new(&law, Placement::Exact).unwrap() };
    let kind = format!("kind = 'standard'\nn = 2\nk = [2.0, 2.0]\n{CONSTANT}\n{CURRENT_ZOH}");
    beside_lee(observer, &kind, FIXED);
    beside_lee(observer, &kind, DECREASING);

    let gain = AdaptiveGain::new(10.0, 0.0025, 0.183).unwrap();
    let law = StandardObserver::<f64, _, _, 2>::new([2.0; 2], gain, Unknown).unwrap();
    let observer = Current { law, scheme: Placed::new(&law, Placement::Bilinear).unwrap() };
    let kind = "kind = 'standard'\nn = 2\nk = [2.0, 2.0]\nmethod = 'bilinear'\ntiming = 'current'\n\
                gain = { law = 'adaptive', p1 = 10.0, p2 = 0.0025, b = 0.183 }";
    beside_lee(observer, kind, FIXED);
}

#[test]
fn gains_that_the_law_computes() {
    let gain = ConstantGain::new(20.0).unwrap();
    let (alpha, beta) = ([2.0, 2.0], [2.0, 0.0]);
    let law = LowPowerObserver::<f64, _, _, 2>::new(alpha, beta, gain, Unknown, NoSaturation);
    let law = law.unwrap();
    let scheme = Placed::new(&law, Placement::Exact).unwrap();
    let kind = format!("kind = 'low-power'\nn = 2\nalpha = [2.0, 2.0]\nbeta = [2.0]\n{CONSTANT}");
    beside_lee(Current { law, scheme }, &format!("{kind}\n{CURRENT_ZOH}"), FIXED);
    beside_lee(Discretised { law, scheme }, &format!("{kind}\nmethod = 'zoh'"), DECREASING);
}

#[test]
fn predictors() {
    let gain = ConstantGain::new(20.0).unwrap();
    let law = StandardObserver::<f64, _, _, 2>::new([2.0; 2], gain, Unknown).unwrap();
    let kind = format!("kind = 'standard'\nn = 2\nk = [2.0, 2.0]\n{CONSTANT}");
    beside_lee(Discretised { law, scheme: Euler }, &kind, FIXED);
    let current = format!("{kind}\ntiming = 'current'");
    beside_lee(Current { law, scheme: Euler }, &current, FIXED);

    let model = VanDerPol::new(0.8, 0.5, Diffusion::Additive, Correction::Derived).unwrap();
    let plant = "kind = 'van-der-pol'\nepsilon = 0.8\nsigma = 0.5";
    let kind = format!("kind = 'sampled-data'\n[observer.model]\n{plant}");
    for setup in setups(Clock::Fixed(0.02)) {
        let setup = Setup { plant_method: "taylor-1.5", substeps: 1, ..setup };
        let observer = (SampledDataObserver::<_, 2> { model }, kind.as_str());
        sampled(&setup, (model, plant), observer, nothing, (&[1.0, 0.0], &[0.0, 1.0]));
    }
}

#[test]
fn a_filter_before_and_after_its_first_sample() {
    let ship = Ship::new(0.0, [0.0; 3]).unwrap();
    let observer = ReducedOrderObserver::new([0.1, 0.2, 0.2], 0.1, ship).unwrap();
    let plant = "kind = 'ship'";
    let kind = format!(
        "kind = 'reduced-order'\nh_bar = [0.1, 0.2, 0.2]\nepsilon = 0.1\n[observer.model]\n{plant}"
    );
    let (mut z, x) = (Vec::new(), [0.0, 10.0, 0.5, 0.5, -0.5, -0.5]);
    observer.initial().visit(&mut |value| z.push(value));
    for setup in setups(Clock::Fixed(0.01)) {
        sampled(&setup, (ship, plant), (observer, &kind), |u| *u, (&x, &z));
    }
}
