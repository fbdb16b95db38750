//! Feature `defmt`: what a chip can log, written to a logger of this test's own.
#![cfg(feature = "defmt")]
#![allow(unsafe_code)] // a logger is `unsafe` by its signature

mod catalogue;

use catalogue::{Logged, Visitor, observers, visit_all};
use defmt::Format;
use hgo_rs::estimator::Counts;
use hgo_rs::gain::{AdaptiveGain, ConstantGain, DeadZoneGain};
use hgo_rs::integrate::{Integrator, PlantScheme, StochasticIntegrator, WienerIncrement};
use hgo_rs::memory::Memory;
use hgo_rs::metrics::{Moments, SettlingTime, Window};
use hgo_rs::model::{InputGain, Unknown};
use hgo_rs::models::{Correction, Crackle, Diffusion, Lee, SanfelicePraly, Ship, VanDerPol};
use hgo_rs::noise::{Channel, Draw, Noise, SecondOrderSections, Sine, Stream};
use hgo_rs::observer::{
    Discretisation, Euler, Hold, Observer, RungeKutta, StaggeredEuler, Status, Timing,
};
use hgo_rs::observers::{
    HardClip, LowPowerState, NoSaturation, ReducedOrderState, SmoothSaturation,
};
use hgo_rs::schedule::{FixedStep, StochasticApproximation};
use hgo_rs::simulate::{Experiment, Finish};
use hgo_rs::{DesignError, Estimator, Scalar};
use std::fmt::Debug;
use std::sync::Mutex;

/// Keeps what is logged.
#[defmt::global_logger]
struct Recorder;

static LOG: Mutex<Vec<u8>> = Mutex::new(Vec::new());

unsafe impl defmt::Logger for Recorder {
    fn acquire() {}
    unsafe fn flush() {}
    unsafe fn release() {}
    unsafe fn write(bytes: &[u8]) {
        LOG.lock().unwrap().extend_from_slice(bytes);
    }
}

defmt::timestamp!("");

/// The bytes of a log of `value`.
fn log(value: &impl Format) -> Vec<u8> {
    LOG.lock().unwrap().clear();
    defmt::println!("{}", value);
    std::mem::take(&mut *LOG.lock().unwrap())
}

/// Counts the type if its instance of `format` is there.
fn logged<X: Format>(count: &mut u32) {
    let format: fn(&X, defmt::Formatter<'_>) = X::format;
    *count += u32::from(format as usize != 0);
}

struct Logs(u64);

impl Visitor<f32> for Logs {
    fn visit<O>(&mut self, law: &'static str, _: &'static str, observer: O, _: fn(f32) -> O::Input)
    where
        O: Observer<f32> + Debug + Logged,
        O::State: PartialEq + Debug + Logged,
    {
        self.0 += 1;
        assert!(!log(&observer).is_empty());
        let mut z = observer.initial();
        z.visit_mut(&mut |entry| *entry = std::f32::consts::PI);
        let mut estimator = Estimator::new(observer, 1.0).unwrap();
        estimator.restart(z);
        let pi = std::f32::consts::PI.to_le_bytes();
        // every number of the memory stands in the log of the memory and in the estimator's
        for bytes in [log(&z), log(&estimator)] {
            let found = bytes.windows(pi.len()).filter(|window| *window == pi).count();
            assert_eq!(found, O::State::LEN, "{law}");
        }
    }
}

fn of_precision<T: Scalar + Format>(count: &mut u32) {
    logged::<(ConstantGain<T>, AdaptiveGain<T>, DeadZoneGain<T>)>(count);
    logged::<(HardClip<T, 5>, SmoothSaturation<T, 5>, InputGain<T>)>(count);
    logged::<(Crackle<T>, SanfelicePraly<T>, Ship<T>, VanDerPol<T>)>(count);
    logged::<(FixedStep<T>, StochasticApproximation<T>)>(count);
    logged::<(LowPowerState<T, T, 5>, ReducedOrderState<T, 3, 3, 2>)>(count);
    logged::<(Moments<T>, SettlingTime<T>, WienerIncrement<T>)>(count);
    logged::<(Sine<T>, Draw<T>, Noise<T>, SecondOrderSections<T, 2>)>(count);
    logged::<(Experiment<T, Lee, FixedStep<T>>, Finish<T, T>)>(count);
}

#[test]
fn every_configuration_memory_error_and_status_can_be_logged() {
    let mut logs = Logs(0);
    visit_all::<f32>(&mut logs).unwrap(); // the chip's
    assert_eq!(logs.0, observers());
    let refused = ConstantGain::new(-1.5).unwrap_err();
    assert!(log(&refused).windows(8).any(|bytes| bytes == (-1.5_f64).to_le_bytes()));
    assert_ne!(log(&Status::Updated), log(&Status::Diverged));
    let mut count = 0;
    of_precision::<f32>(&mut count);
    of_precision::<f64>(&mut count);
    logged::<(DesignError, Status, Counts, Timing)>(&mut count);
    logged::<(Euler, StaggeredEuler, RungeKutta, Discretisation, Hold)>(&mut count);
    logged::<(Integrator, StochasticIntegrator, PlantScheme)>(&mut count);
    logged::<(Unknown, NoSaturation, Lee, Diffusion, Correction)>(&mut count);
    logged::<(Channel, Stream, Window)>(&mut count);
    assert_eq!(count, 2 * 8 + 5);
}
