//! Feature `serde`: what is written is read back bit for bit, and what a constructor would refuse
//! is refused when it is read.
#![cfg(feature = "serde")]
#![allow(clippy::float_cmp)] // where two numbers are compared for equality, equal bits are meant

mod catalogue;

use catalogue::{ALPHA, BETA, Stored, Visitor, observers, visit_all};
use hgo_rs::estimator::Counts;
use hgo_rs::gain::{AdaptiveGain, ConstantGain, DeadZoneGain};
use hgo_rs::integrate::{Integrator, PlantScheme, StochasticIntegrator, WienerIncrement};
use hgo_rs::memory::Memory;
use hgo_rs::metrics::{Moments, SettlingTime, Window};
use hgo_rs::model::{InputGain, Unknown, no_input};
use hgo_rs::models::{Correction, Crackle, Diffusion, Lee, SanfelicePraly, Ship, VanDerPol};
use hgo_rs::noise::{Channel, Draw, Noise, SecondOrderSections, Sine, Stream};
use hgo_rs::observer::{
    Discretisation, Discretised, Euler, Hold, Measurement, Observer, StaggeredEuler, Status, Timing,
};
use hgo_rs::observers::{
    HardClip, LowPowerObserver, LowPowerState, NoSaturation, PeakingFreeObserver,
    ReducedOrderObserver, ReducedOrderState, RepelledCollection, SmoothSaturation,
    StandardObserver,
};
use hgo_rs::polynomial::{coefficients_from_poles, low_power_coefficients_from_poles};
use hgo_rs::schedule::{FixedStep, StochasticApproximation};
use hgo_rs::simulate::{Experiment, Finish};
use hgo_rs::{DesignError, Estimator, Scalar};
use nalgebra::{SVector, Vector2};
use proptest::prelude::*;
use serde::de::DeserializeOwned;
use serde::de::value::{Error, MapDeserializer};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fmt::Debug;

/// Through postcard, a format of bytes that needs no heap.
fn through_bytes<X: Serialize + DeserializeOwned>(value: &X) -> X {
    let mut buffer = [0; 2048];
    let bytes = postcard::to_slice(value, &mut buffer).unwrap();
    postcard::from_bytes(bytes).unwrap()
}

/// Through JSON, which holds finite numbers only.
fn through_text<X: Serialize + DeserializeOwned>(value: &X) -> X {
    let text = serde_json::to_string(value).unwrap();
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

/// `Debug` shows every private field, and a float's shortest digits tell all its bits.
#[track_caller]
fn returns<X: Serialize + DeserializeOwned + Debug>(value: &X) {
    let shown = format!("{value:?}");
    assert_eq!(format!("{:?}", through_bytes(value)), shown);
    assert_eq!(format!("{:?}", through_text(value)), shown);
}

fn bits<T: Scalar>(memory: &impl Memory<T>) -> Vec<u64> {
    let mut bits = Vec::new();
    memory.visit(&mut |z| bits.push(z.to_f64().to_bits()));
    bits
}

/// Writes every observer and reads it; stops it in the middle of a run and goes on from its bytes
/// and from its text.
struct RoundTrip(u64);

impl<T: Scalar + Stored> Visitor<T> for RoundTrip {
    fn visit<O>(
        &mut self,
        law: &'static str,
        scheme: &'static str,
        observer: O,
        input: fn(T) -> O::Input,
    ) where
        O: Observer<T> + Debug + Stored,
        O::State: PartialEq + Debug + Stored,
    {
        self.0 += 1;
        returns(&observer);
        returns(&observer.initial());
        let mut whole = Estimator::new(observer, T::from_f64(0.011)).unwrap();
        let mut restored = [whole; 2];
        for k in 0..60_u32 {
            if k == 30 {
                restored = [through_bytes(&whole), through_text(&whole)];
                returns(&whole);
            }
            let y = if k % 7 == 3 { f64::NAN } else { (0.01 * f64::from(k)).sin() };
            let dt = match k % 11 {
                4 => 0.02, // too long
                8 => 0.0,  // no length of time
                _ => 0.01,
            };
            let (y, dt) = (T::from_f64(y), T::from_f64(dt));
            let (sample, u) = (O::Measurement::fill(|| y), input(T::from_f64(0.3)));
            let status = whole.step(&sample, &u, dt);
            for estimator in &mut restored {
                assert_eq!(estimator.step(&sample, &u, dt), status, "{law}, {scheme}");
                assert_eq!(bits(estimator.memory()), bits(whole.memory()), "{law}, {scheme}");
                assert_eq!(estimator.time(), whole.time());
                assert_eq!(estimator.counts(), whole.counts());
            }
        }
        assert_ne!(bits(whole.memory()), bits(&observer.initial()), "{law}, {scheme}");
        let mut values = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -0.0, 1e-310].into_iter();
        let mut z = observer.initial();
        z.visit_mut(&mut |entry| *entry = T::from_f64(values.next().unwrap_or(1.5)));
        assert_eq!(bits(&through_bytes(&z)), bits(&z), "{law}, {scheme}");
    }
}

#[test]
fn every_observer_goes_on_from_what_was_written() {
    let mut trip = RoundTrip(0);
    visit_all::<f64>(&mut trip).unwrap();
    assert_eq!(trip.0, observers());
}

fn every_type_returns<T: Scalar + Stored>() -> Result<(), DesignError> {
    let c = T::from_f64;
    returns(&ConstantGain::new(c(0.1))?);
    returns(&AdaptiveGain::new(c(10.0), c(0.0025), c(0.183))?);
    returns(&DeadZoneGain::new(c(10.0), c(0.0025), c(0.183))?);
    returns(&FixedStep::new(c(1e-3))?);
    returns(&StochasticApproximation::new(c(0.04), c(0.01), c(2e4), c(0.7))?);
    returns(&HardClip::new([0.1, 0.2, 0.3].map(c))?);
    returns(&SmoothSaturation::new([0.1, 0.2, -0.3].map(c))?); // the last level is not used
    returns(&InputGain { b0: c(0.7) });
    returns(&Crackle::new(c(3.3))?);
    returns(&SanfelicePraly::new(c(1.9), c(0.1))?);
    returns(&Ship::new(c(-0.3), [0.1, -0.0, 1e-40].map(c))?);
    for diffusion in [Diffusion::Additive, Diffusion::Multiplicative] {
        for correction in [Correction::Derived, Correction::Printed] {
            returns(&VanDerPol::new(c(0.8), c(0.5), diffusion, correction)?);
        }
    }
    let ship = Ship::new(c(0.0), [c(0.0); 3])?;
    returns(&ReducedOrderObserver::new([0.1, 0.2, 0.3].map(c), c(0.07), ship)?);
    returns(&LowPowerState::<T, T, 3> {
        x_hat: SVector::from([0.1, 0.2, 0.3].map(c)),
        eta: SVector::from([1.1, 1.2, 1.3].map(c)).into(),
        r: c(1.4),
    });
    returns(&ReducedOrderState::<T, 2, 3, 1> {
        z_hat: SVector::from([0.1, 0.2, 0.3].map(c)),
        y: SVector::from([0.4, 0.5].map(c)),
        u: SVector::from([c(0.6)]),
        elapsed: c(0.7),
        period: c(0.8),
    });
    let (mut moments, mut settling) = (Moments::default(), SettlingTime::new(c(0.1)));
    let mut filter = SecondOrderSections::new([[0.1, 0.2, 0.1, -0.9, 0.3].map(c); 2]);
    for i in 0..10_u32 {
        let value = c(1.0 / f64::from(1 + i));
        moments.push(value);
        settling.push(value, value);
        filter.filter(value);
    }
    returns(&moments);
    returns(&settling);
    returns(&filter);
    returns(&WienerIncrement::from_normals((c(0.3), c(-0.4)), c(0.01)));
    returns(&Sine { amplitude: c(0.1), omega: c(20.0), phase: c(-0.5) });
    let (x, z) = (Vector2::new(c(0.1), c(0.2)), c(0.3));
    returns(&Finish { x, z, diverged_at: Some(u64::MAX), undefined_at: None });
    Ok(())
}

#[test]
fn every_configuration_and_state_returns_bit_for_bit() {
    use Status::{Diverged, ModelUndefined, Predicted, StepRefused, StepTooLong, Updated};
    use StochasticIntegrator::{EulerMaruyama, Milstein, Taylor15};
    every_type_returns::<f32>().unwrap();
    every_type_returns::<f64>().unwrap();
    returns(&Window { from: 3, to: u64::MAX });
    returns(&Counts { updated: 1, predicted: u32::MAX, ..Counts::default() });
    for scheme in [Integrator::Euler, Integrator::BogackiShampine, Integrator::Rk4] {
        returns(&scheme);
        returns(&PlantScheme::Deterministic(scheme));
    }
    for scheme in [EulerMaruyama, Milstein, Taylor15] {
        returns(&PlantScheme::Stochastic(scheme));
    }
    for (_, scheme) in catalogue::SCHEMES {
        returns(&scheme);
    }
    returns(&[Updated, Predicted, ModelUndefined, StepTooLong, StepRefused, Diverged]);
    returns(&(PlantScheme::Held, Timing::Predictor, Timing::Current, Hold::Innovation));
    returns(&(Unknown, NoSaturation, Lee, Euler, StaggeredEuler));
    returns(&(Channel::Measurement, Channel::Process));
    let mut stream = Stream::new(1, 2, Channel::Process);
    let mut read = through_text(&stream);
    assert_eq!([stream.next_u64(), stream.next_u64()], [read.next_u64(), read.next_u64()]);
}

/// A file says what the constructor takes: coefficients without the gain's powers.
#[test]
fn a_configuration_reads_as_its_constructor() {
    type Law = StandardObserver<f64, ConstantGain<f64>, InputGain<f64>, 2, 1>;
    let text = r#"{
        "law": {"k": [2.0, 1.0], "gain": {"ell": 50.0}, "model": {"b0": 3.0}},
        "scheme": "Euler"
    }"#;
    let read: Discretised<Law, Discretisation> = serde_json::from_str(text).unwrap();
    let gain = ConstantGain::new(50.0).unwrap();
    let law = Law::new([2.0, 1.0], gain, InputGain { b0: 3.0 }).unwrap();
    assert_eq!(read, Discretised { law, scheme: Discretisation::Euler });
    let written = serde_json::to_value(read).unwrap();
    assert_eq!(written, serde_json::from_str::<Value>(text).unwrap());

    let alpha = ALPHA.map(|a| a * 1.1);
    let gain = ConstantGain::new(7.0).unwrap();
    let law = LowPowerObserver::<f64, _, _, 5>::new(alpha, BETA, gain, Unknown, NoSaturation);
    let written = serde_json::to_value(law.unwrap()).unwrap();
    for (written, alpha) in written["alpha"].as_array().unwrap().iter().zip(alpha) {
        assert!((written.as_f64().unwrap() - alpha).abs() <= f64::EPSILON * alpha);
    }
    assert_eq!(written["gain"]["ell"], 7.0);
}

/// Reading `text` gives the error that the constructor gives for the same values.
#[track_caller]
fn refused<X: DeserializeOwned + Debug>(text: Value, constructed: Result<X, DesignError>) {
    let (read, wanted) = (serde_json::from_value::<X>(text).unwrap_err(), constructed.unwrap_err());
    assert_eq!(read.to_string(), wanted.to_string());
}

#[test]
fn a_bad_configuration_is_refused_with_the_constructors_text() {
    for bad in [0.0, -1.0, -1e-300] {
        refused(json!({"ell": bad}), ConstantGain::new(bad));
        refused(json!({"dt": bad}), FixedStep::new(bad));
        refused(json!({"phi_max": bad}), Crackle::new(bad));
        let text = json!({"p1": 10.0, "p2": bad, "b": 0.2});
        refused(text.clone(), AdaptiveGain::new(10.0, bad, 0.2));
        refused(text, DeadZoneGain::new(10.0, bad, 0.2));
        let text = json!({"alpha": 1.0, "epsilon": 1.0, "k0": 1.0, "p": bad});
        refused(text, StochasticApproximation::new(1.0, 1.0, 1.0, bad));
        let text = json!({"levels": [1.0, bad, 1.0]});
        refused(text.clone(), HardClip::new([1.0, bad, 1.0]));
        refused(text, SmoothSaturation::new([1.0, bad, 1.0]));
    }
    for bad in [0.0, 0.5, 0.7, -0.1] {
        let text = json!({"p1": 10.0, "p2": 1.0, "b": bad});
        refused(text.clone(), AdaptiveGain::new(10.0, 1.0, bad));
        refused(text, DeadZoneGain::new(10.0, 1.0, bad));
    }
    refused(json!({"phi_max": 0.4}), Crackle::new(0.4));
    refused(json!({"delta": 0.6, "w": [0.0, 0.0, 0.0]}), Ship::new(0.6, [0.0; 3]));
    let error = serde_json::from_value::<Stream>(json!({"s": [0, 0, 0, 0]})).unwrap_err();
    assert!(error.to_string().contains("must not be 0 throughout"), "{error}");
}

type Standard<T, const N: usize> = StandardObserver<T, ConstantGain<T>, Unknown, N>;

#[test]
fn a_bad_standard_observer_is_refused_with_the_constructors_text() {
    fn new<T: Scalar, const N: usize>(
        k: [f64; N],
        ell: f64,
    ) -> Result<Standard<T, N>, DesignError> {
        Standard::new(k.map(T::from_f64), ConstantGain::new(T::from_f64(ell))?, Unknown)
    }
    let text = |k: &[f64], ell: f64| json!({"k": k, "gain": {"ell": ell}, "model": null});
    let good: Standard<f64, 2> = serde_json::from_value(text(&[2.0, 1.0], 9.0)).unwrap();
    assert_eq!(good, new([2.0, 1.0], 9.0).unwrap());
    for (k, ell) in [
        ([2.0, -1.0], 1.0),
        ([0.0, 1.0], 1.0),
        ([2.0, 1.0], -1.0),
        ([2.0, 1.0], 1e200),  // its square is infinite
        ([2.0, 1.0], 1e-200), // or 0
    ] {
        refused(text(&k, ell), new::<f64, 2>(k, ell));
    }
    refused(text(&[2.0, 1.0], 1e30), new::<f32, 2>([2.0, 1.0], 1e30));
    refused(text(&[1.0; 13], 1.0), new::<f64, 13>([1.0; 13], 1.0));
}

#[test]
fn a_bad_low_power_observer_is_refused_with_the_constructors_text() {
    type Clipped = PeakingFreeObserver<f64, ConstantGain<f64>, Unknown, HardClip<f64, 2>, 2>;
    let new = |alpha: [f64; 2], beta: [f64; 2], level: f64| {
        let (gain, clip) = (ConstantGain::new(5.0)?, HardClip::new([level, 1.0])?);
        Clipped::new(alpha, beta, gain, Unknown, clip)
    };
    let text = |alpha: [f64; 2], beta: [f64; 2], level: f64| {
        let saturation = json!({"levels": [level, 1.0]});
        let gain = json!({"ell": 5.0});
        json!({"alpha": alpha, "beta": beta, "gain": gain, "model": null, "saturation": saturation})
    };
    let (two, one) = ([2.0, 2.0], [2.0, 0.0]);
    let good: Clipped = serde_json::from_value(text(two, one, 1.0)).unwrap();
    assert_eq!(good, new(two, one, 1.0).unwrap());
    for (alpha, beta, level) in [([2.0, -1.0], one, 1.0), (two, [-2.0, 0.0], 1.0), (two, one, -1.0)]
    {
        refused(text(alpha, beta, level), new(alpha, beta, level));
    }
}

#[test]
fn a_bad_collection_is_refused_with_the_constructors_text() {
    type Collection<const C: usize> = RepelledCollection<f64, SanfelicePraly<f64>, 2, C>;
    let gain = AdaptiveGain::new(10.0, 0.01, 0.2).unwrap();
    let model = SanfelicePraly::new(1.9, 0.1).unwrap();
    let text = |k: [f64; 2]| {
        let (gain, model) =
            (json!({"p1": 10.0, "p2": 0.01, "b": 0.2}), json!({"nu1": 1.9, "nu2": 0.1}));
        json!({"k": k, "k_bar": [0.1, 0.1], "gain": gain, "model": model})
    };
    let (two, unstable) = ([2.0, 1.0], [2.0, -1.0]);
    let good: Collection<3> = serde_json::from_value(text(two)).unwrap();
    assert_eq!(good, Collection::new(two, [0.1; 2], gain, model).unwrap());
    refused(text(unstable), Collection::<3>::new(unstable, [0.1; 2], gain, model));
    refused(text(two), Collection::<1>::new(two, [0.1; 2], gain, model));
}

/// It is written as the diagonal of H, h̄/ε, which is all that it keeps.
#[test]
fn a_bad_reduced_order_observer_is_refused() {
    type Reduced = ReducedOrderObserver<f64, Ship<f64>, 3, 3, 2>;
    let ship = Ship::new(0.0, [0.0; 3]).unwrap();
    let text = |h: [f64; 3]| json!({"h": h, "model": {"delta": 0.0, "w": [0.0, 0.0, 0.0]}});
    let good: Reduced = serde_json::from_value(text([1.0, 2.0, 2.0])).unwrap();
    assert_eq!(good, Reduced::new([0.125, 0.25, 0.25], 0.125, ship).unwrap());
    let error = serde_json::from_value::<Reduced>(text([1.0, -2.0, 2.0])).unwrap_err();
    let wanted = "h (h_bar / epsilon) = -2 is not allowed: it must be finite and > 0";
    assert_eq!(error.to_string(), wanted);
    let error = Reduced::new([0.1; 3], 1e-310, ship).unwrap_err().to_string();
    assert_eq!(error, "h (h_bar / epsilon) = inf is not allowed: it must be finite and > 0");
}

#[test]
fn an_estimator_that_could_not_have_been_is_refused() {
    type Read = Estimator<f64, Discretised<Standard<f64, 2>, Euler>>;
    let law = Standard::new([2.0, 1.0], ConstantGain::new(5.0).unwrap(), Unknown).unwrap();
    let estimator = Estimator::new(Discretised { law, scheme: Euler }, 0.1).unwrap();
    let good = serde_json::to_value(estimator).unwrap();
    assert_eq!(serde_json::from_value::<Read>(good.clone()).unwrap(), estimator);
    for (at, value, text) in [
        ("/dt_max", -0.1, "dt_max = -0.1 is not allowed: it must be finite and > 0"),
        ("/dt_max", 0.0, "dt_max = 0 is not allowed: it must be finite and > 0"),
        ("/clock/before", -1.0, "t = -1 is not allowed: it must be >= 0"),
        ("/observer/law/gain/ell", -1.0, "ell = -1 is not allowed: it must be finite and > 0"),
        ("/observer/law/k/1", -1.0, "k = 2 is not allowed: s^n + k_1 s^(n-1) + ... + k_n must"),
    ] {
        let mut bad = good.clone();
        *bad.pointer_mut(at).unwrap() = value.into();
        let error = serde_json::from_value::<Read>(bad).unwrap_err().to_string();
        assert!(error.starts_with(text), "{at}: {error}");
    }
    // NaN and infinity are null in JSON, and no number
    let mut bad = good;
    *bad.pointer_mut("/observer/law/gain/ell").unwrap() = f64::NAN.into();
    let error = serde_json::from_value::<Read>(bad).unwrap_err().to_string();
    assert!(error.starts_with("invalid type: null"), "{error}");
}

/// Read from pairs of names and numbers: a format that holds NaN.
fn from_pairs<X: DeserializeOwned>(pairs: &[(&'static str, f64)]) -> Result<X, Error> {
    X::deserialize(MapDeserializer::new(pairs.iter().copied()))
}

#[test]
fn nan_and_infinity_are_refused() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let error = from_pairs::<ConstantGain<f64>>(&[("ell", bad)]).unwrap_err();
        assert_eq!(error.to_string(), ConstantGain::new(bad).unwrap_err().to_string());
        let error = from_pairs::<SanfelicePraly<f64>>(&[("nu1", 1.9), ("nu2", bad)]).unwrap_err();
        assert_eq!(error.to_string(), SanfelicePraly::new(1.9, bad).unwrap_err().to_string());
    }
    // as bytes: a tuple of its fields is what postcard writes for a struct
    let mut buffer = [0; 64];
    for (k1, ell) in [(2.0, 5.0), (f64::NAN, 5.0), (2.0, f64::NAN), (2.0, f64::INFINITY)] {
        let bytes = postcard::to_slice(&((k1, 1.0), ell, ()), &mut buffer).unwrap();
        let read = postcard::from_bytes::<Standard<f64, 2>>(bytes);
        assert_eq!(read.is_ok(), k1 == 2.0 && ell == 5.0, "{read:?}");
    }
}

/// The observers of order N with poles at −`poles` and the gain `ell`, in one precision.
fn returns_under_gain<T: Scalar + Stored, const N: usize>(poles: [f64; N], ell: f64) {
    let real = poles.map(|p| (T::from_f64(-p), T::ZERO));
    let gain = ConstantGain::new(T::from_f64(ell)).unwrap();
    let k = coefficients_from_poles(real).unwrap();
    // what the constructor takes, the file may say
    if let Ok(law) = StandardObserver::<T, _, _, N>::new(k, gain, Unknown) {
        returns(&law);
    }
}

#[test]
fn large_and_small_gains_return() {
    let five = [1.0, 1.3, 1.7, 2.0, 2.5];
    let k = coefficients_from_poles(five.map(|p| (f32::from_f64(-p), 0.0))).unwrap();
    let law = Standard::<f32, 5>::new(k, ConstantGain::new(1e4).unwrap(), Unknown).unwrap();
    returns(&law);
    let twelve: [f64; 12] = core::array::from_fn(|i| 1.0 + 0.1 * i as f64);
    let k = coefficients_from_poles(twelve.map(|p| (-p, 0.0))).unwrap();
    let law = Standard::<f64, 12>::new(k, ConstantGain::new(1e6).unwrap(), Unknown).unwrap();
    returns(&law);
    for tenths in -30..=60 {
        let ell = 10.0_f64.powf(0.1 * f64::from(tenths));
        // repeated poles: the hardest case of the Routh array
        returns_under_gain::<f32, 12>([1.0; 12], ell);
        returns_under_gain::<f64, 12>([1.0; 12], ell);
    }
}

/// Coefficients whose product with the gain, divided by it and multiplied again, is another number.
#[test]
fn coefficients_that_a_division_loses_return() {
    for (k, ell) in [(1.126_409_2_f32, 1.775_553_8_f32), (1.407_299_3, 1.421_161_9)] {
        assert_ne!(k * ell / ell * ell, k * ell);
        returns(&Standard::new([k], ConstantGain::new(ell).unwrap(), Unknown).unwrap());
    }
    let lost = [
        (1.447_153_891_086_546_7_f64, 1.382_023_026_243_855_5_f64),
        (1.211_285_998_613_056_6, 1.651_137_718_334_096_7),
    ];
    for (k, ell) in lost {
        assert_ne!(k * ell / ell * ell, k * ell);
        returns(&Standard::new([k], ConstantGain::new(ell).unwrap(), Unknown).unwrap());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn coefficients_return_under_any_gain(
        poles in prop::array::uniform12(0.3..3.0_f64),
        nine in prop::array::uniform9(0.5..2.0_f64),
        exponent in -3.0..6.0_f64,
    ) {
        let ell = 10.0_f64.powf(exponent);
        let [a, b, c, d, e, ..] = poles;
        returns_under_gain::<f32, 2>([a, b], ell);
        returns_under_gain::<f64, 2>([a, b], ell);
        returns_under_gain::<f32, 5>([a, b, c, d, e], ell);
        returns_under_gain::<f64, 5>([a, b, c, d, e], ell);
        returns_under_gain::<f32, 12>(poles, ell);
        returns_under_gain::<f64, 12>(poles, ell);
        let gain = ConstantGain::new(ell).unwrap();
        let designed = low_power_coefficients_from_poles::<f64, 5, 9>(nine.map(|p| (-p, 0.0)));
        let (alpha, beta) = designed.unwrap();
        let law = LowPowerObserver::<_, _, _, 5>::new(alpha, beta, gain, Unknown, NoSaturation);
        returns(&law.unwrap());
    }
}

#[test]
fn what_borrows_is_written() {
    let samples = [0.25, 0.5];
    let sines = [Sine { amplitude: 0.1, omega: 20.0, phase: 0.0 }];
    let experiment = Experiment {
        plant: Lee,
        plant_scheme: PlantScheme::Deterministic(Integrator::Rk4),
        substeps: 2,
        schedule: FixedStep::new(0.1).unwrap(),
        plant_schedule: None,
        noise: Noise { draw: Draw::Samples(&samples), hold: 3, sines: &sines },
        steps: 7,
        seed: 1,
    };
    let written = serde_json::to_value(experiment).unwrap();
    assert_eq!(written["noise"]["draw"], json!({"Samples": [0.25, 0.5]}));
    assert_eq!(written["noise"]["sines"][0]["omega"], 20.0);
    assert_eq!(written["schedule"]["dt"], 0.1);
    let error = serde_json::to_value(ConstantGain::new(-1.0).unwrap_err()).unwrap();
    assert_eq!(error["parameter"], "ell");
    assert_eq!(error["value"], -1.0);
}

/// A model of a user's, to be stored, needs no more than serde's own derive.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Spring {
    stiffness: f64,
}

impl hgo_rs::model::Model<f64, 2> for Spring {
    fn f_hat(&self, _: f64, x: &Vector2<f64>, _: &SVector<f64, 0>) -> Vector2<f64> {
        hgo_rs::model::last(-self.stiffness * x.x)
    }
}

#[test]
fn a_users_model_is_stored_with_its_observer() {
    let gain = ConstantGain::new(30.0).unwrap();
    let law = StandardObserver::<f64, _, _, 2>::new([2.0, 1.0], gain, Spring { stiffness: 0.1 });
    let mut estimator =
        Estimator::new(Discretised { law: law.unwrap(), scheme: StaggeredEuler }, 0.05).unwrap();
    estimator.step(&1.0, &no_input(), 0.01);
    assert_eq!(through_text(&estimator), estimator);
}
