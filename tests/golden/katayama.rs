//! Katayama: the reduced-order observer of a ship under control.

use super::{Metrics, RK4, Watch, close, experiment, printed, steps};
use hgo_rs::Observer;
use hgo_rs::integrate::{Integrator, plant_step};
use hgo_rs::model::Plant;
use hgo_rs::models::Ship;
use hgo_rs::observers::ReducedOrderObserver;
use hgo_rs::schedule::FixedStep;
use hgo_rs::simulate::Experiment;
use nalgebra::Vector3;

type Reduced = ReducedOrderObserver<f64, Ship<f64>, 3, 3, 2>;

fn observer(epsilon: f64) -> Reduced {
    let known = Ship::new(0.0, [0.0; 3]).unwrap();
    ReducedOrderObserver::new([0.1, 0.2, 0.2], epsilon, known).unwrap()
}

fn start() -> (Vector3<f64>, Vector3<f64>) {
    (Vector3::new(0.0, 10.0, core::f64::consts::FRAC_PI_6), Vector3::new(0.5, -0.5, -0.5))
}

/// The closed loop under RK4 with substeps of 5 ms.
fn voyage(
    period: f64,
    delta: f64,
    w: [f64; 3],
    seconds: f64,
) -> Experiment<'static, f64, Ship<f64>, FixedStep<f64>> {
    let plant = Ship::new(delta, w).unwrap();
    let clock = FixedStep::new(period).unwrap();
    let total = steps(seconds, period);
    let substeps = u32::try_from(steps(period, 0.005)).unwrap();
    Experiment { substeps, ..experiment(plant, RK4, clock, total) }
}

/// RMS of z − ẑ over [5, 20) s.
fn rms(period: f64, epsilon: f64, delta: f64) -> [f64; 3] {
    let run = voyage(period, delta, [0.0; 3], 20.0);
    let window = (steps(5.0, period), steps(20.0, period));
    let mut metrics = Metrics::new(&[window], 3, 3);
    let observer = observer(epsilon);
    let end = run.sampled(&observer, |u| *u, 0, start(), observer.initial(), &mut metrics);
    assert_eq!((end.diverged_at, end.undefined_at), (None, None));
    core::array::from_fn(|i| metrics.signal(0, i).rms())
}

#[test]
fn rms_table() {
    let table = [
        (0.1, 1.0, [0.16195, 0.07768, 0.07184], [0.19775, 0.05974, 0.02543]),
        (0.1, 0.1, [0.00027, 0.00148, 0.00086], [0.00037, 0.00209, 0.00189]),
        (0.1, 0.05, [0.00011, 0.00161, 0.00072], [0.00012, 0.00154, 0.00051]),
        (0.01, 1.0, [0.16965, 0.07524, 0.07481], [0.20457, 0.05958, 0.02679]),
        (0.01, 0.1, [0.00058, 0.00014, 0.00008], [0.00073, 0.00263, 0.00210]),
        (0.01, 0.01, [0.00001, 0.00017, 0.00005], [0.00001, 0.00025, 0.00012]),
    ];
    for (period, epsilon, certain, uncertain) in table {
        for (delta, expected) in [(0.0, certain), (0.5, uncertain)] {
            let ours = rms(period, epsilon, delta);
            for i in 0..3 {
                let what = format!("T = {period}, eps = {epsilon}, delta = {delta}, z{}", i + 1);
                printed(&what, ours[i], expected[i], 5);
            }
        }
    }
}

#[test]
fn closed_loop_reaches_its_speed() {
    // the surge starts at its smallest value: A3 (z1 > 0) holds throughout
    let mut slowest = f64::INFINITY;
    let watch = |t: f64, z: &[f64], _: &[f64]| {
        if t > 0.0 {
            slowest = slowest.min(z[0]);
        }
    };
    let observer = observer(0.1);
    let run = voyage(0.01, 0.0, [0.0; 3], 120.0);
    let end = run.sampled(&observer, |u| *u, 0, start(), observer.initial(), &mut Watch(watch));
    assert!(slowest > 0.5, "{slowest}");
    // 2 ms after the start
    let (ship, dt) = (Ship::new(0.0, [0.0; 3]).unwrap(), 0.002);
    let u = ship.control(0.0, &start(), 0.01);
    let moved = plant_step(Integrator::Rk4, &ship, 0.0, &start(), &u, dt);
    printed("z1(2 ms)", moved.1.x, 0.5019, 4);
    assert!((end.x.1 - Vector3::new(0.8, 0.0, 0.0)).amax() < 1e-6, "{}", end.x.1);
}

/// e∞ = (ε/h̄ᵢ)·wᵢ/(1 + δ̄).
#[test]
fn disturbance_offset() {
    let observer = observer(0.01);
    let run = voyage(0.01, 0.5, [0.4, 0.2, 0.1], 130.0);
    let mut metrics = Metrics::new(&[(12_000, 13_001)], 3, 3);
    run.sampled(&observer, |u| *u, 0, start(), observer.initial(), &mut metrics);
    for (i, expected) in [0.026_667, 0.006_667, 0.003_333].into_iter().enumerate() {
        let [h_bar, w] = [[0.1, 0.4], [0.2, 0.2], [0.2, 0.1]][i];
        let exact = 0.01 / h_bar * w / 1.5;
        close("e∞", metrics.signal(0, i).max(), exact, 1e-4);
        close("e∞", metrics.signal(0, i).mean().abs(), exact, 1e-4);
        printed("the formula", exact, expected, 6);
    }
}

/// A5 is exact: T < 10 ε.
#[test]
fn largest_stable_period() {
    let observer = observer(0.01);
    let ends_at = |period: f64| {
        let run = Experiment { substeps: 20, ..voyage(period, 0.0, [0.0; 3], 600.0) };
        let mut nothing = Watch(|_, _: &[f64], _: &[f64]| {});
        let end = run.sampled(&observer, |u| *u, 0, start(), observer.initial(), &mut nothing);
        (end.z.z_hat - end.x.1).amax()
    };
    assert!(ends_at(0.099) < 1e-3, "{}", ends_at(0.099));
    assert!(ends_at(0.101) > 1e3, "{}", ends_at(0.101));
}

#[test]
fn no_peaking() {
    for (period, epsilon) in [(0.1, 1.0), (0.1, 0.1), (0.01, 0.1), (0.01, 0.01)] {
        for delta in [0.0, 0.5] {
            let (mut first, mut largest) = (None, 0.0_f64);
            let watch = |_, z: &[f64], z_hat: &[f64]| {
                let error = (0..3).map(|i| (z[i] - z_hat[i]).powi(2)).sum::<f64>().sqrt();
                largest = largest.max(error / *first.get_or_insert(error));
            };
            let observer = observer(epsilon);
            voyage(period, delta, [0.0; 3], 20.0).sampled(
                &observer,
                |u| *u,
                0,
                start(),
                observer.initial(),
                &mut Watch(watch),
            );
            assert!(largest <= 1.02, "T = {period}, eps = {epsilon}: {largest}");
        }
    }
}
