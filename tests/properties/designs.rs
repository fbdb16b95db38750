//! Parameters outside their range are refused by name.

use hgo_rs::DesignError;
use hgo_rs::gain::{AdaptiveGain, ConstantGain, DeadZoneGain};
use hgo_rs::integrate::{PlantScheme, StochasticIntegrator};
use hgo_rs::model::Unknown;
use hgo_rs::models::{Crackle, Diffusion, SanfelicePraly, Ship, VanDerPol};
use hgo_rs::noise::{Draw, Noise};
use hgo_rs::observers::{
    HardClip, ReducedOrderObserver, RepelledCollection, SmoothSaturation, StandardObserver,
};
use hgo_rs::schedule::{FixedStep, StochasticApproximation};
use hgo_rs::simulate::Experiment;
use std::fmt::Debug;

#[track_caller]
fn refused<T: Debug>(parameter: &str, result: Result<T, DesignError>) {
    let error = result.unwrap_err();
    assert_eq!(error.parameter, parameter);
    let text = error.to_string();
    assert!(text.contains(parameter) && text.contains(error.allowed), "{text}");
}

#[test]
fn parameters_outside_their_range_are_named() {
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        refused("ell", ConstantGain::new(bad));
        refused("epsilon", ConstantGain::from_epsilon(bad));
        refused("p1", AdaptiveGain::new(bad, 0.01, 0.2));
        refused("p2", AdaptiveGain::new(1.0, bad, 0.2));
        refused("p1", DeadZoneGain::new(bad, 0.01, 0.2));
        refused("p2", DeadZoneGain::new(1.0, bad, 0.2));
        refused("dt", FixedStep::new(bad));
        refused("alpha", StochasticApproximation::new(bad, 0.01, 1e4, 1.0));
        refused("epsilon", StochasticApproximation::new(0.04, bad, 1e4, 1.0));
        refused("k0", StochasticApproximation::new(0.04, 0.01, bad, 1.0));
        refused("p", StochasticApproximation::new(0.04, 0.01, 1e4, bad));
        refused("saturation", HardClip::<_, 3>::new([1.0, bad, 1.0]));
        refused("saturation", SmoothSaturation::<_, 3>::new([1.0, bad, 1.0]));
        refused("phi_max", Crackle::new(bad));
        refused("epsilon", reduced([0.1, 0.2, 0.2], bad));
    }
    for bad in [0.0, 0.5, -0.1, 1.0, f64::NAN] {
        refused("b", AdaptiveGain::new(1.0, 0.01, bad));
        refused("b", DeadZoneGain::new(1.0, 0.01, bad));
    }
    for bad in [f64::NAN, f64::INFINITY] {
        refused("nu1", SanfelicePraly::new(bad, 0.1));
        refused("nu2", SanfelicePraly::new(1.9, bad));
        refused("w", Ship::new(0.0, [0.0, bad, 0.0]));
        let gain = AdaptiveGain::new(1.0, 0.01, 0.2).unwrap();
        let model = SanfelicePraly::new(1.9, 0.1).unwrap();
        let two = [2.0, 2.0];
        refused("k_bar", RepelledCollection::<_, _, 2, 3>::new(two, [bad, 0.1], gain, model));
    }
    refused("delta", Ship::new(0.51, [0.0; 3]));
    refused("delta", Ship::new(f64::NAN, [0.0; 3]));
    for bad in [0.0, 1.0, -0.1, f64::NAN] {
        refused("h_bar", reduced([0.1, bad, 0.2], 0.1));
    }
    let gain = ConstantGain::new(1.0).unwrap();
    refused("n", StandardObserver::<f64, _, _, 13>::new([1.0; 13], gain, Unknown));
    let gain = AdaptiveGain::new(1.0, 0.01, 0.2).unwrap();
    let model = SanfelicePraly::new(1.9, 0.1).unwrap();
    let single = RepelledCollection::<f64, _, 2, 1>::new([2.0, 2.0], [0.1, 0.1], gain, model);
    refused("copies", single);
}

fn reduced(
    h_bar: [f64; 3],
    epsilon: f64,
) -> Result<ReducedOrderObserver<f64, Ship<f64>, 3, 3, 2>, DesignError> {
    ReducedOrderObserver::new(h_bar, epsilon, Ship::new(0.0, [0.0; 3])?)
}

#[test]
fn experiments_that_mean_nothing_are_refused() {
    let correction = hgo_rs::models::Correction::Derived;
    let multiplicative = VanDerPol::new(0.8, 0.5, Diffusion::Multiplicative, correction).unwrap();
    let good = Experiment {
        plant: multiplicative,
        plant_scheme: PlantScheme::Stochastic(StochasticIntegrator::Milstein),
        substeps: 1,
        schedule: FixedStep::new(0.1).unwrap(),
        plant_schedule: None,
        noise: Noise { draw: Draw::None, hold: 1, sines: &[] },
        steps: 1,
        seed: 0,
    };
    assert_eq!(good.check(), Ok(()));
    let taylor = PlantScheme::Stochastic(StochasticIntegrator::Taylor15);
    let bad = Experiment { plant_scheme: taylor, ..good };
    refused("plant_method (strong order)", bad.check());
    refused("substeps", Experiment { substeps: 0, ..good }.check());
    let noise = Noise { draw: Draw::None, hold: 0, sines: &[] };
    refused("hold", Experiment { noise, ..good }.check());
}
