//! Astolfi, Marconi, Praly and Teel: tables 1 to 4, coefficients, step limits.

use super::{Metrics, RK4, Watch, close, experiment, printed, steps};
use hgo_rs::gain::ConstantGain;
use hgo_rs::integrate::{Integrator, PlantScheme};
use hgo_rs::memory::Memory;
use hgo_rs::model::{Model, Unknown};
use hgo_rs::models::Crackle;
use hgo_rs::noise::{Draw, Noise, Sine};
use hgo_rs::observer::{ContinuousLaw, Discretisation, Discretised, Hold, Measurement, RungeKutta};
use hgo_rs::observers::{
    HardClip, LowPowerObserver, NoSaturation, PeakingFreeObserver, SmoothSaturation,
    StandardObserver, StandardState,
};
use hgo_rs::polynomial::{coefficients_from_poles, low_power_coefficients_from_poles};
use hgo_rs::schedule::FixedStep;
use hgo_rs::simulate::{Experiment, Probe, Sample};
use nalgebra::SVector;

const X0: [f64; 5] = [-0.8, 0.0, 0.0, 0.0, 0.0];
const K: [f64; 5] = [7.5, 22.1875, 32.343_75, 23.218_75, 6.5625];

/// As the paper prints them: what its tables were computed with.
const ALPHA: [f64; 5] = [3.0, 3.0, 3.0, 3.0, 2.0];
const BETA: [f64; 5] = [8.5714, 3.2122, 1.4267, 0.5347, 0.0];

/// Real poles from −1 to −2 and one more −2: the paper's coefficients to all digits.
fn coefficients() -> ([f64; 5], [f64; 5]) {
    let pole = |i: usize| if i < 8 { -1.0 - i as f64 / 7.0 } else { -2.0 };
    low_power_coefficients_from_poles(core::array::from_fn::<_, 9, _>(|i| (pole(i), 0.0))).unwrap()
}

fn crackle() -> Crackle<f64> {
    Crackle::new(3.0).unwrap()
}

fn gain(ell: f64) -> ConstantGain<f64> {
    ConstantGain::new(ell).unwrap()
}

fn peaking_free<Md: hgo_rs::model::PhaseVariable<f64, 5>>(
    ell: f64,
    model: Md,
) -> PeakingFreeObserver<f64, ConstantGain<f64>, Md, HardClip<f64, 5>, 5> {
    let clip = HardClip::new([3.0; 5]).unwrap();
    PeakingFreeObserver::new(ALPHA, BETA, gain(ell), model, clip).unwrap()
}

fn standard<Md: Model<f64, 5>>(
    ell: f64,
    model: Md,
) -> StandardObserver<f64, ConstantGain<f64>, Md, 5> {
    StandardObserver::new(K, gain(ell), model).unwrap()
}

fn joint_run(dt: f64, seconds: f64) -> Experiment<'static, f64, Crackle<f64>, FixedStep<f64>> {
    let clock = FixedStep::new(dt).unwrap();
    experiment(crackle(), PlantScheme::Held, clock, steps(seconds, dt))
}

/// Last time at which ‖x̂ − x‖ comes below 0.01, between samples, and peaks of the memory.
struct Worst {
    before: (f64, f64),
    time: f64,
    last_sample: f64,
    peaks: Vec<f64>,
}

impl Probe<f64> for Worst {
    fn sample<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
        &mut self,
        sample: &Sample<'_, f64, X, Z, Y>,
    ) {
        let pairs = sample.estimate.iter().zip(sample.truth);
        let distance = pairs.map(|(e, x)| (e - x).powi(2)).sum::<f64>().sqrt();
        let (t, above) = self.before;
        if distance >= 0.01 {
            self.last_sample = self.last_sample.max(sample.t);
        } else if above >= 0.01 {
            let crossing = t + (sample.t - t) * (above - 0.01) / (above - distance);
            self.time = self.time.max(crossing);
        }
        self.before = (sample.t, distance);
        let mut peaks = self.peaks.iter_mut();
        sample.z.visit(&mut |z| {
            let peak = peaks.next().unwrap();
            *peak = peak.max(z.abs());
        });
    }
}

/// The worst case over all vertices of ±3 of the memory.
fn worst_case<L>(law: &L, dt: f64, seconds: f64) -> Worst
where
    L: ContinuousLaw<f64, Input = SVector<f64, 0>>,
{
    // the plant moves: its scheme is the joint one
    let run = Experiment { plant_scheme: RK4, ..joint_run(dt, seconds) };
    let length = L::State::LEN;
    let none = (0.0, 0.0);
    let mut worst = Worst { before: none, time: 0.0, last_sample: 0.0, peaks: vec![0.0; length] };
    for vertex in 0..1_u32 << length {
        let corner = |i: usize| if vertex >> i & 1 == 0 { 3.0 } else { -3.0 };
        let start: Vec<f64> = (0..length).map(corner).collect();
        let (scheme, z0) = (Integrator::BogackiShampine, L::State::read(&start));
        worst.before = none;
        let end = run.joint(law, |u| *u, scheme, 0, X0.into(), z0, &mut worst);
        assert_eq!(end.diverged_at, None);
    }
    worst
}

/// The paper's own column, by its own scheme (order 3, 1 ms): every printed digit.
#[test]
fn table_1_for_ell_70() {
    let worst = worst_case(&peaking_free(70.0, crackle()), 1e-3, 1.0);
    printed("T", worst.last_sample, 0.471, 3);
    assert!((worst.peaks[0] - 3.0).abs() < 1e-12, "{}", worst.peaks[0]);
    let expected = [4.03, 3.59, 3.29, 3.02, 421.98, 312.22, 159.90, 68.35];
    for (ours, expected) in worst.peaks[1..].iter().zip(expected) {
        printed("peak", *ours, expected, 2);
    }
}

/// Converged values, peaks to 4e-5 of themselves: T with the first step, the peaks, which lie in
/// the first moments and at corners of the saturation, with the second.
fn converged<L>(law: &L, seconds: [f64; 2], dt: [f64; 2], time: f64, peaks: &[(f64, i32)])
where
    L: ContinuousLaw<f64, Input = SVector<f64, 0>>,
{
    let settled = worst_case(law, dt[0], seconds[0]).time;
    assert!((settled - time).abs() <= 5e-5 + 5e-5, "T = {settled} instead of {time}");
    let worst = worst_case(law, dt[1], seconds[1]);
    for (ours, (expected, decimals)) in worst.peaks[1..].iter().zip(peaks) {
        let tolerance = 4e-5 * expected + 0.5 * 10_f64.powi(-decimals);
        assert!((ours - expected).abs() <= tolerance, "peak {ours} instead of {expected}");
    }
}

#[test]
fn table_1_converged() {
    let low = [(4.1027, 4), (3.6982, 4), (3.3703, 4), (3.2072, 4)];
    let peaks = [(43.886, 3), (33.360, 3), (18.430, 3), (9.1911, 4)];
    let both = [low, peaks].concat();
    converged(&peaking_free(7.0, crackle()), [5.5, 1.5], [1e-3, 1e-4], 4.8807, &both);
    let low = [(4.0374, 4), (3.6048, 4), (3.2996, 4), (3.0475, 4)];
    let peaks = [(181.92, 2), (135.19, 2), (69.935, 3), (30.791, 3)];
    let both = [low, peaks].concat();
    converged(&peaking_free(30.0, crackle()), [1.5, 0.3], [2e-4, 2e-5], 0.9952, &both);
    let low = [(4.0277, 4), (3.5912, 4), (3.2857, 4), (3.0203, 4)];
    let peaks = [(422.20, 2), (312.58, 2), (159.883, 3), (68.357, 3)];
    let both = [low, peaks].concat();
    converged(&peaking_free(70.0, crackle()), [0.7, 0.15], [1e-4, 1e-5], 0.4715, &both);
}

#[test]
fn table_2_converged() {
    let peaks = [(41.844, 3), (222.600, 3), (613.616, 3), (690.730, 3)];
    converged(&standard(4.17, crackle()), [6.0, 1.5], [1e-3, 1e-4], 4.9011, &peaks);
    let peaks = [(194.227, 3), (4923.2, 1), (65706.0, 0), (355_531.0, 0)];
    converged(&standard(20.0, crackle()), [1.5, 0.3], [2e-4, 2e-5], 1.1364, &peaks);
    let peaks = [(403.328, 3), (21316.2, 1), (593_570.0, -1), (6.698e6, -3)];
    converged(&standard(41.7, crackle()), [0.8, 0.15], [1e-4, 1e-5], 0.6047, &peaks);
}

/// Tables 3 and 4, columns (b) and (d): A sin ωt in the measurement, sup over [from, 10] s.
#[test]
fn sinusoidal_noise() {
    fn errors<L>(law: &L, z0: L::State, amplitude: f64, omega: f64, from: f64) -> [f64; 5]
    where
        L: ContinuousLaw<f64, Input = SVector<f64, 0>>,
    {
        let sines = [Sine { amplitude, omega, phase: 0.0 }];
        let noise = Noise { draw: Draw::None, hold: 1, sines: &sines };
        let run = Experiment { plant_scheme: RK4, noise, ..joint_run(1e-4, 10.0) };
        let mut metrics = Metrics::new(&[(steps(from, 1e-4), 100_001)], 5, 0);
        run.joint(law, |u| *u, Integrator::BogackiShampine, 0, X0.into(), z0, &mut metrics);
        core::array::from_fn(|i| metrics.signal(0, i).max())
    }
    let ones = SVector::from_element(1.0);
    let law = peaking_free(7.0, crackle());
    let z0 = Memory::read(&[1.0, 1.0, 1.0, 1.0, 1.0]);
    let table = [
        (0.298, 100.0, [0.0650, 0.2628, 0.4043, 0.2783, 0.0415], [4, 4, 4, 4, 4]),
        (4.4894, 5000.0, [0.01886, 0.00161, 0.00042, 0.00201, 0.00383], [5, 5, 5, 5, 5]),
    ];
    for (amplitude, omega, expected, decimals) in table {
        let ours = errors(&law, z0, amplitude, omega, 4.881);
        for i in 0..5 {
            printed("table 3", ours[i], expected[i], decimals[i]);
        }
    }
    let law = standard(4.17, crackle());
    let table = [
        (0.298, 100.0, [0.0923, 1.1380, 6.9186, 20.7128, 24.4165]),
        (4.4894, 5000.0, [0.0281, 0.3465, 2.1064, 6.3071, 7.4393]),
    ];
    for (amplitude, omega, expected) in table {
        let ours = errors(&law, StandardState { x_hat: ones, r: () }, amplitude, omega, 4.901);
        for i in 0..5 {
            close("table 4", ours[i], expected[i], 2e-3);
        }
    }
}

#[test]
fn coefficients_from_the_papers_poles() {
    let (alpha, beta) = coefficients();
    for (ours, expected) in alpha.iter().zip([3.0, 3.0, 3.0, 3.0, 2.0]) {
        close("alpha", *ours, expected, 1e-9);
    }
    for (ours, expected) in beta.iter().zip([8.571_429, 3.212_245, 1.426_736, 0.534_670]) {
        printed("beta", *ours, expected, 6);
    }
    let equidistant = core::array::from_fn::<_, 5, _>(|i| (-1.0 - 0.25 * i as f64, 0.0));
    for (ours, expected) in coefficients_from_poles(equidistant).unwrap().iter().zip(K) {
        close("k", *ours, expected, 1e-14);
    }
}

/// The largest c = ℓT with bounded trajectories, to 1 %.
#[test]
fn step_limits() {
    fn ends<L>(law: L, scheme: Discretisation, c: f64, start: &[f64]) -> (bool, f64)
    where
        L: ContinuousLaw<f64, Input = SVector<f64, 0>>,
    {
        let observer = Discretised { law, scheme };
        let clock = FixedStep::new(c).unwrap(); // ℓ = 1
        let run = experiment(crackle(), PlantScheme::Held, clock, 4_000);
        let mut nothing = Watch(|_, _: &[f64], _: &[f64]| {});
        let z0 = L::State::read(start);
        let end = run.sampled(&observer, |u| *u, 0, SVector::zeros(), z0, &mut nothing);
        let mut norm = 0.0_f64;
        end.z.visit(&mut |z| norm = norm.max(z.abs()));
        (end.diverged_at.is_none(), norm)
    }
    let low_power = LowPowerObserver::new(ALPHA, BETA, gain(1.0), Unknown, NoSaturation).unwrap();
    let held = |hold| Discretisation::RungeKutta(RungeKutta { integrator: Integrator::Rk4, hold });
    // a start far beyond the saturation, so that block 1 decides
    let far = [1e6, 1e3, 1e3, 1e3, 1e3, 1e6, 1e3, 1e3, 1e3];
    let table = [
        (Discretisation::Euler, [1.000, 0.979, 0.350]),
        (held(Hold::Measurement), [1.392, 1.369, 0.894]),
        (held(Hold::Innovation), [0.273, 0.636, 0.665]),
    ];
    for (scheme, limits) in table {
        for (i, limit) in limits.into_iter().enumerate() {
            let run = |c| match i {
                0 => ends(standard(1.0, Unknown), scheme, c, &far[..5]),
                1 => ends(low_power, scheme, c, &far),
                _ => ends(peaking_free(1.0, Unknown), scheme, c, &far),
            };
            let (bounded, size) = run(0.985 * limit);
            assert!(bounded && size < 1e6, "{scheme:?}, law {i}, below {limit}: {size}");
            let (bounded, size) = run(1.015 * limit);
            assert!(!bounded || size > 1e6, "{scheme:?}, law {i}, above {limit}: {size}");
        }
    }
}

/// The C¹ saturation of the text against the hard clip of the tables: they differ.
#[test]
fn smooth_saturation_is_another_observer() {
    let smooth = SmoothSaturation::new([3.0; 5]).unwrap();
    let smooth = PeakingFreeObserver::new(ALPHA, BETA, gain(70.0), crackle(), smooth).unwrap();
    let start = [3.0, -3.0, 3.0, -3.0, 3.0, -3.0, 3.0, -3.0, 3.0];
    let run = Experiment { plant_scheme: RK4, ..joint_run(1e-3, 1.0) };
    let (mut a, mut b) = (Metrics::new(&[], 5, 9), Metrics::new(&[], 5, 9));
    let third = Integrator::BogackiShampine;
    let hard = peaking_free(70.0, crackle());
    run.joint(&smooth, |u| *u, third, 0, X0.into(), Memory::read(&start), &mut a);
    run.joint(&hard, |u| *u, third, 0, X0.into(), Memory::read(&start), &mut b);
    let largest = (1..9).map(|i| (a.peak[i] / b.peak[i] - 1.0).abs()).fold(0.0, f64::max);
    assert!((0.05..0.4).contains(&largest), "largest difference of a peak {largest}");
    // both settle, and no estimate passes its bound by far
    assert!(a.settling.time() < 0.6 && a.peak[..5].iter().all(|p| *p < 6.0), "{:?}", a.peak);
}
