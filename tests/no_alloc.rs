//! No heap: constructing and stepping every observer, and simulating, never call the allocator.

#![allow(unsafe_code)] // a global allocator is `unsafe` by its signature

mod catalogue;

use catalogue::{Visitor, observers, visit_all};
use hgo_rs::covariance::ErrorCovariance;
use hgo_rs::gain::ConstantGain;
use hgo_rs::integrate::{Integrator, PlantScheme, StochasticIntegrator};
use hgo_rs::metrics::{LogHistogram, Moments, SettlingTime, Window};
use hgo_rs::model::Unknown;
use hgo_rs::models::{Correction, Diffusion, Lee, VanDerPol};
use hgo_rs::noise::{Channel, Draw, Noise, Sine, Stream};
use hgo_rs::observer::{Discretised, Euler, Measurement};
use hgo_rs::observers::{SampledDataObserver, StandardObserver};
use hgo_rs::polynomial::{coefficients_from_poles, low_power_coefficients_from_poles};
use hgo_rs::schedule::{FixedStep, StochasticApproximation};
use hgo_rs::simulate::{Experiment, RunMetrics, coupled_paths};
use hgo_rs::{Observer, Scalar};
use nalgebra::Vector2;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::fmt::Debug;

/// The system's allocator, counting the calls of each thread.
struct Counting;

thread_local! {
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    CALLS.with(|calls| calls.set(calls.get() + 1));
}

unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Calls of the allocator by `f` on this thread, and what `f` returns.
fn allocations<R>(f: impl FnOnce() -> R) -> (u64, R) {
    let before = CALLS.with(Cell::get);
    let result = f();
    (CALLS.with(Cell::get) - before, result)
}

#[test]
fn the_counter_counts() {
    let (calls, grown) = allocations(|| {
        let mut values = vec![1_u8];
        values.reserve_exact(100_000); // a realloc
        values
    });
    assert_eq!(calls, 2, "{}", grown.len());
}

/// Steps every observer, with present and missing samples.
struct Stepper {
    observers: u64,
    steps: u64,
}

impl<T: Scalar> Visitor<T> for Stepper {
    fn visit<O>(&mut self, _: &'static str, _: &'static str, observer: O, input: fn(T) -> O::Input)
    where
        O: Observer<T>,
        O::State: PartialEq + Debug,
    {
        self.observers += 1;
        let mut z = observer.initial();
        let dt = T::from_f64(1e-3);
        for k in 0..100_u32 {
            let t = T::from_f64(f64::from(k)) * dt;
            let y = if k % 7 == 3 { T::from_f64(f64::NAN) } else { t.sin() };
            observer.step(&mut z, &O::Measurement::fill(|| y), &input(y), t, dt);
            self.steps += u64::from(!observer.estimate(&z).is_empty());
        }
    }
}

#[test]
fn every_observer_is_built_and_stepped_without_the_heap() {
    let mut stepper = Stepper { observers: 0, steps: 0 };
    let (calls, built) = allocations(|| {
        visit_all::<f64>(&mut stepper)?;
        visit_all::<f32>(&mut stepper)
    });
    built.unwrap();
    assert_eq!(calls, 0);
    assert_eq!(stepper.observers, 2 * observers());
    assert_eq!(stepper.steps, 100 * stepper.observers);
}

#[test]
fn designs_and_refusals_need_no_heap() {
    let (calls, refused) = allocations(|| {
        let poles = core::array::from_fn(|i| (-1.0 - 0.1 * i as f64, 0.0));
        let designed = low_power_coefficients_from_poles::<f64, 5, 9>(poles);
        let unstable = coefficients_from_poles([(0.5, 0.0)]);
        designed.is_ok() && unstable.is_err()
    });
    assert_eq!(calls, 0);
    assert!(refused);
}

#[test]
fn a_simulation_runs_without_the_heap() {
    let law = StandardObserver::new([2.0, 2.0], ConstantGain::new(100.0).unwrap(), Unknown);
    let observer = Discretised { law: law.unwrap(), scheme: Euler };
    let schedule = StochasticApproximation::new(0.04, 0.01, 20_000.0, 1.0).unwrap();
    let sines = [Sine { amplitude: 0.1, omega: 20.0, phase: 0.0 }];
    let experiment = Experiment {
        plant: Lee,
        plant_scheme: PlantScheme::Deterministic(Integrator::Rk4),
        substeps: 2,
        schedule,
        plant_schedule: None,
        noise: Noise { draw: Draw::Uniform { low: -0.5, high: 0.5 }, hold: 3, sines: &sines },
        steps: 2_000,
        seed: 1,
    };
    let windows = [Window { from: 500, to: 2_000 }];
    let (mut moments, mut peak) = ([Moments::default(); 2], [0.0; 2]);
    let mut counts = vec![0; LogHistogram::BINS];
    let mut probe = RunMetrics {
        windows: &windows,
        signals: 2,
        moments: &mut moments,
        peak: &mut peak,
        settling: Some(SettlingTime::new(0.01)),
        histogram: Some((windows[0], LogHistogram::new(&mut counts))),
    };
    let x0 = Vector2::new(10.0, 10.0);
    let (calls, (sampled, joint)) = allocations(|| {
        experiment.check().unwrap();
        let sampled = experiment.sampled(&observer, |u| *u, 0, x0, observer.initial(), &mut probe);
        let z0 = observer.initial();
        let rk4 = Integrator::Rk4;
        let joint = experiment.joint(&observer.law, |u| *u, rk4, 1, x0, z0, &mut probe);
        (sampled, joint)
    });
    assert_eq!(calls, 0);
    assert_eq!((sampled.diverged_at, joint.diverged_at), (None, None));
    assert!(moments[1].rms() > 0.0 && counts.iter().sum::<u64>() == 2 * 1_500);

    let mut exact = [Moments::default(); 2];
    let mut covariance =
        ErrorCovariance::new(schedule, [200.0, 2e4], 1.0 / 12.0, &windows, &mut exact, || false);
    let (calls, _) = allocations(|| {
        experiment.sampled(&observer, |u| *u, 0, x0, observer.initial(), &mut covariance)
    });
    assert_eq!(calls, 0);
    assert!(covariance.covariance[(1, 1)] > 0.0);
}

#[test]
fn a_stochastic_simulation_runs_without_the_heap() {
    let model = VanDerPol::new(0.8, 0.5, Diffusion::Additive, Correction::Derived).unwrap();
    let observer = SampledDataObserver::<_, 2> { model };
    let experiment = Experiment {
        plant: model,
        plant_scheme: PlantScheme::Stochastic(StochasticIntegrator::Taylor15),
        substeps: 10,
        schedule: FixedStep::new(0.03).unwrap(),
        plant_schedule: None,
        noise: Noise { draw: Draw::None, hold: 1, sines: &[] },
        steps: 500,
        seed: 1,
    };
    let windows = [Window { from: 100, to: 501 }];
    let (mut moments, mut peak) = ([Moments::default(); 2], [0.0; 2]);
    let mut probe = RunMetrics {
        windows: &windows,
        signals: 2,
        moments: &mut moments,
        peak: &mut peak,
        settling: None,
        histogram: None,
    };
    let (x0, z0) = (Vector2::new(1.0, 0.0), Vector2::new(0.0, 1.0));
    let (calls, paths) = allocations(|| {
        experiment.sampled(&observer, |u| *u, 0, x0, z0, &mut probe);
        let (coarse, fine) = (StochasticIntegrator::EulerMaruyama, StochasticIntegrator::Taylor15);
        let mut stream = Stream::new(1, 0, Channel::Process);
        coupled_paths(&model, coarse, fine, x0, 1.0, (16, 8), &mut stream, || false)
    });
    assert_eq!(calls, 0);
    assert!(moments[0].rms() > 0.0 && paths.0 != paths.1);
}

/// Writes every observer in use and reads it again.
#[cfg(feature = "serde")]
struct Storer {
    observers: u64,
    bytes: usize,
}

#[cfg(feature = "serde")]
impl<T: Scalar + catalogue::Stored> Visitor<T> for Storer {
    fn visit<O>(&mut self, _: &'static str, _: &'static str, observer: O, _: fn(T) -> O::Input)
    where
        O: Observer<T> + Debug + catalogue::Stored,
        O::State: PartialEq + Debug + catalogue::Stored,
    {
        let mut buffer = [0; 2048];
        let written = hgo_rs::Estimator::new(observer, T::ONE)
            .map(|estimator| postcard::to_slice(&estimator, &mut buffer).map_or(0, |b| b.len()));
        let length = written.unwrap_or(0);
        let read = postcard::from_bytes::<hgo_rs::Estimator<T, O>>(&buffer[..length]);
        self.observers += u64::from(read.is_ok());
        self.bytes = self.bytes.max(length);
    }
}

#[cfg(feature = "serde")]
#[test]
fn every_observer_is_written_and_read_without_the_heap() {
    let mut storer = Storer { observers: 0, bytes: 0 };
    let (calls, built) = allocations(|| visit_all::<f64>(&mut storer));
    built.unwrap();
    assert_eq!(calls, 0);
    assert_eq!(storer.observers, observers());
    assert!(storer.bytes < 768, "{}", storer.bytes);
}
