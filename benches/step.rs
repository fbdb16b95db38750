//! One step of each observer, and what a user would write by hand for the smallest of them.
//!
//! Every iteration is a step of a run: memory, time and sample move on, so nothing is hoisted.

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, criterion_group, criterion_main};
use hgo_rs::models::{Correction, Crackle, Diffusion, Lee, SanfelicePraly, Ship, VanDerPol};
use hgo_rs::nalgebra::{SVector, Vector2, Vector3};
use hgo_rs::observer::Measurement;
use hgo_rs::prelude::*;
use std::hint::black_box;
use std::time::Duration;

/// Samples of one period of the measured signal, walked through again and again.
const PERIOD: usize = 1024;

/// Steps of `observer`, the sample from a sine of unit amplitude plus `offset`.
fn step<T: Scalar, O: Observer<T>>(
    group: &mut BenchmarkGroup<'_, WallTime>,
    name: &str,
    observer: O,
    offset: f64,
    u: O::Input,
) {
    let samples: Vec<O::Measurement> = (0..PERIOD)
        .map(|k| {
            let phase = core::f64::consts::TAU * k as f64 / PERIOD as f64;
            O::Measurement::fill(|| T::from_f64(offset + 0.1 * phase.sin()))
        })
        .collect();
    let dt = T::from_f64(1e-3);
    group.bench_function(name, |bencher| {
        let observer = black_box(observer);
        let mut z = observer.initial();
        let (mut k, mut t) = (0, T::ZERO);
        bencher.iter(|| {
            observer.step(&mut z, black_box(&samples[k % PERIOD]), &u, t, dt);
            k += 1;
            t += dt;
        });
        black_box(&z);
    });
}

/// The standard observer of order 2 as one writes it without a library.
fn by_hand(group: &mut BenchmarkGroup<'_, WallTime>, name: &str) {
    let samples: Vec<f64> = (0..PERIOD)
        .map(|k| 0.1 * (core::f64::consts::TAU * k as f64 / PERIOD as f64).sin())
        .collect();
    group.bench_function(name, |bencher| {
        let (l1, l2, dt) = black_box((200.0, 20_000.0, 1e-3));
        let mut x_hat = [0.0, 0.0];
        let mut k = 0;
        bencher.iter(|| {
            let e = black_box(samples[k % PERIOD]) - x_hat[0];
            let [x1, x2] = x_hat;
            x_hat = [x1 + dt * (x2 + l1 * e), x2 + dt * (l2 * e)];
            k += 1;
        });
        black_box(x_hat);
    });
}

/// The paper's coefficients of order 5.
const ALPHA: [f64; 5] = [3.0, 3.0, 3.0, 3.0, 2.0];
const BETA: [f64; 5] = [8.5714, 3.2122, 1.4267, 0.5347, 0.0];
const FIVE: [f64; 5] = [7.5, 22.1875, 32.343_75, 23.218_75, 6.5625];

fn chains<T: Scalar>(group: &mut BenchmarkGroup<'_, WallTime>) -> Result<(), DesignError> {
    let c = T::from_f64;
    let two = [c(2.0); 2];
    let law = StandardObserver::<T, _, _, 2>::new(two, ConstantGain::new(c(100.0))?, Unknown)?;
    step(group, "standard, n = 2, euler", Discretised { law, scheme: Euler }, 0.0, no_input());
    let law = StandardObserver::<T, _, _, 2>::new(two, ConstantGain::new(c(100.0))?, Lee)?;
    let observer = Discretised { law, scheme: Euler };
    step(group, "standard, n = 2, model (38), euler", observer, 0.0, no_input());
    let crackle = Crackle::new(c(3.0))?;
    let ell = ConstantGain::new(c(7.0))?;
    let law = StandardObserver::new(FIVE.map(c), ell, crackle)?;
    step(group, "standard, n = 5, euler", Discretised { law, scheme: Euler }, 0.0, no_input());
    let (alpha, beta) = (ALPHA.map(c), BETA.map(c));
    let law = LowPowerObserver::new(alpha, beta, ell, crackle, NoSaturation)?;
    step(group, "low-power, n = 5, euler", Discretised { law, scheme: Euler }, 0.0, no_input());
    let clip = HardClip::new([c(3.0); 5])?;
    let law = PeakingFreeObserver::new(alpha, beta, ell, crackle, clip)?;
    let observer = Discretised { law, scheme: Euler };
    step(group, "peaking-free, n = 5, hard clip, euler", observer, 0.0, no_input());
    let scheme = RungeKutta { integrator: Integrator::Rk4, hold: Hold::Measurement };
    let observer = Discretised { law, scheme };
    step(group, "peaking-free, n = 5, hard clip, rk4", observer, 0.0, no_input());
    let smooth = SmoothSaturation::new([c(3.0); 5])?;
    let law = PeakingFreeObserver::new(alpha, beta, ell, crackle, smooth)?;
    let observer = Discretised { law, scheme: Euler };
    step(group, "peaking-free, n = 5, smooth, euler", observer, 0.0, no_input());
    let plant = SanfelicePraly::new(c(1.9), c(0.1))?;
    let adaptive = AdaptiveGain::new(c(10.0), c(0.0025), c(0.183))?;
    let law = StandardObserver::new(two, adaptive, plant)?;
    step(group, "adaptive, n = 2, euler", Discretised { law, scheme: Euler }, 0.0, no_input());
    Ok(())
}

/// Stochastic approximation: a step of the schedule a(k), then one of the observer.
fn stochastic_approximation(group: &mut BenchmarkGroup<'_, WallTime>) -> Result<(), DesignError> {
    let law = StandardObserver::<f64, _, _, 2>::new([2.0; 2], ConstantGain::new(100.0)?, Unknown)?;
    let observer = Discretised { law, scheme: Euler };
    let schedule = StochasticApproximation::new(0.04, 0.01, 20_000.0, 1.0)?;
    group.bench_function("stochastic approximation, n = 2, euler", |bencher| {
        let (observer, schedule) = black_box((observer, schedule));
        let mut z = observer.initial();
        let (mut k, mut t) = (0_u64, 0.0);
        bencher.iter(|| {
            let dt = schedule.dt(k);
            observer.step(&mut z, black_box(&0.1), &no_input(), t, dt);
            t = schedule.next_time(t, k, dt);
            k += 1;
        });
        black_box(&z);
    });
    Ok(())
}

fn others(group: &mut BenchmarkGroup<'_, WallTime>) -> Result<(), DesignError> {
    let none: SVector<f64, 0> = no_input();
    let two = [2.0, 2.0];
    let plant = SanfelicePraly::new(1.9, 0.1)?;
    let law = StandardObserver::new(two, DeadZoneGain::new(10.0, 0.0025, 0.183)?, plant)?;
    step(group, "dead zone, n = 2, euler", Discretised { law, scheme: Euler }, 0.0, none);
    let gain = AdaptiveGain::new(10.0, 0.0025, 0.183)?;
    let collection = RepelledCollection::<_, _, 2, 3>::new(two, [0.0558, 0.0317], gain, plant)?;
    let observer = Discretised { law: collection, scheme: Euler };
    step(group, "collection of 3, euler", observer, 0.0, none);
    let observer = Discretised { law: ModifiedObserver { collection }, scheme: Euler };
    step(group, "modified, 3 copies, euler", observer, 0.0, none);
    let model = VanDerPol::new(0.8, 0.5, Diffusion::Additive, Correction::Derived)?;
    step(group, "sampled-data, n = 2", SampledDataObserver::<_, 2> { model }, 0.0, none);
    let ship = Ship::new(0.0, [0.0; 3])?;
    let observer = ReducedOrderObserver::<f64, _, 3, 3, 2>::new([0.1, 0.2, 0.2], 0.1, ship)?;
    // the sample walks in all three entries, so that the velocity is never 0
    let walk = |k: usize| {
        let phase = core::f64::consts::TAU * k as f64 / PERIOD as f64;
        Vector3::new(phase.sin(), phase.cos(), 0.3 * phase.sin())
    };
    let samples: Vec<_> = (0..PERIOD).map(walk).collect();
    group.bench_function("reduced-order, n = 3 + 3", |bencher| {
        let observer = black_box(observer);
        let (u, mut z, mut k) = (Vector2::new(0.1, 0.2), observer.initial(), 0);
        bencher.iter(|| {
            observer.step(&mut z, black_box(&samples[k % PERIOD]), &u, 0.0, 0.01);
            k += 1;
        });
        black_box(&z);
    });
    Ok(())
}

fn steps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("f64");
    by_hand(&mut group, "by hand: standard, n = 2, euler");
    chains::<f64>(&mut group).expect("the papers' designs");
    stochastic_approximation(&mut group).expect("the papers' designs");
    others(&mut group).expect("the papers' designs");
    group.finish();
    let mut group = criterion.benchmark_group("f32");
    chains::<f32>(&mut group).expect("the papers' designs");
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_millis(1200))
        .sample_size(50);
    targets = steps
}
criterion_main!(benches);
