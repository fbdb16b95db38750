//! Orders of convergence: each scheme on problems whose exact solution is known.

use hgo_rs::gain::ConstantGain;
use hgo_rs::integrate::{
    Integrator, StochasticIntegrator, WienerIncrement, bogacki_shampine, euler, rk4,
};
use hgo_rs::model::{Model, PhaseVariable, Plant, Unknown, last, no_input};
use hgo_rs::noise::{Channel, Stream};
use hgo_rs::observer::{ContinuousLaw, Discretisation, Discretised, Hold, RungeKutta};
use hgo_rs::observers::{
    HardClip, LowPowerObserver, NoSaturation, PeakingFreeObserver, StandardObserver, StandardState,
};
use hgo_rs::simulate::coupled_paths;
use hgo_rs::{Observer, memory::Memory};
use nalgebra::{SVector, Vector1, Vector2};

/// Least-squares slope of ln(error) over ln(h).
fn slope(points: &[(f64, f64)]) -> f64 {
    let logs: Vec<(f64, f64)> = points.iter().map(|(h, e)| (h.ln(), e.ln())).collect();
    let count = logs.len() as f64;
    let (mean_h, mean_e) =
        logs.iter().fold((0.0, 0.0), |(a, b), (h, e)| (a + h / count, b + e / count));
    let covariance: f64 = logs.iter().map(|(h, e)| (h - mean_h) * (e - mean_e)).sum();
    covariance / logs.iter().map(|(h, _)| (h - mean_h).powi(2)).sum::<f64>()
}

#[track_caller]
fn order(what: &str, points: &[(f64, f64)], expected: f64, tolerance: f64) {
    let found = slope(points);
    assert!((found - expected).abs() <= tolerance, "{what}: order {found}, {points:?}");
}

mod ordinary {
    use super::*;

    /// ẋ₁ = −2t x₁², x₁ = 1/(1 + t²); ẋ₂ = x₂ cos t, x₂ = e^{sin t}: neither linear nor autonomous.
    fn error_at_2(step: impl Fn(f64, &Vector2<f64>, f64) -> Vector2<f64>, steps: u32) -> f64 {
        let h = 2.0 / f64::from(steps);
        let mut x = Vector2::new(1.0, 1.0);
        for i in 0..steps {
            x = step(f64::from(i) * h, &x, h);
        }
        (x - Vector2::new(0.2, 2_f64.sin().exp())).amax()
    }

    fn rate(t: f64, x: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(-2.0 * t * x.x * x.x, x.y * t.cos())
    }

    #[test]
    fn of_the_deterministic_schemes() {
        type Step = fn(f64, &Vector2<f64>, f64) -> Vector2<f64>;
        let schemes: [(&str, Step, f64); 6] = [
            ("euler", |t, x, h| euler(rate, t, x, h), 1.0),
            ("bogacki_shampine", |t, x, h| bogacki_shampine(rate, t, x, h), 3.0),
            ("rk4", |t, x, h| rk4(rate, t, x, h), 4.0),
            ("Euler", |t, x, h| Integrator::Euler.step(rate, t, x, h), 1.0),
            ("BogackiShampine", |t, x, h| Integrator::BogackiShampine.step(rate, t, x, h), 3.0),
            ("Rk4", |t, x, h| Integrator::Rk4.step(rate, t, x, h), 4.0),
        ];
        for (name, step, expected) in schemes {
            let counts = if expected < 2.0 { [800, 1_600, 3_200] } else { [100, 200, 400] };
            let points = counts.map(|n| (2.0 / f64::from(n), error_at_2(step, n)));
            order(name, &points, expected, 0.1);
        }
    }
}

mod observers {
    use super::*;

    const fn held(integrator: Integrator, hold: Hold) -> Discretisation {
        Discretisation::RungeKutta(RungeKutta { integrator, hold })
    }

    /// Each scheme with its order where the sample y is constant, so that holding it is exact.
    const SCHEMES: [(&str, Discretisation, f64); 6] = [
        ("euler", Discretisation::Euler, 1.0),
        ("staggered-euler", Discretisation::StaggeredEuler, 1.0),
        ("bogacki-shampine", held(Integrator::BogackiShampine, Hold::Measurement), 3.0),
        ("rk4", held(Integrator::Rk4, Hold::Measurement), 4.0),
        ("rk4, euler within", held(Integrator::Euler, Hold::Measurement), 1.0),
        ("rk4-innovation-held", held(Integrator::Rk4, Hold::Innovation), 1.0),
    ];

    fn after<L>(
        law: L,
        scheme: Discretisation,
        z0: L::State,
        y: f64,
        t: f64,
        steps: u32,
    ) -> L::State
    where
        L: ContinuousLaw<f64, Input = SVector<f64, 0>>,
    {
        let observer = Discretised { law, scheme };
        let dt = t / f64::from(steps);
        let mut z = z0;
        for k in 0..steps {
            observer.step(&mut z, &y, &no_input(), f64::from(k) * dt, dt);
        }
        z
    }

    fn distance<Z: Memory<f64>>(a: &Z, b: &Z) -> f64 {
        let mut largest = 0.0_f64;
        a.zip(b, |a, b| a - b).visit(&mut |d| largest = largest.max(d.abs()));
        largest
    }

    /// k = (3, 2), ℓ = 1, y constant: e = y − x̂₁ obeys ë + 3ė + 2e = 0, so from x̂ = 0 it is
    /// e = y(2e^{−2t} − e^{−t}), and x̂₂ = −ė − 3e = 2y(e^{−t} − e^{−2t}).
    #[test]
    fn of_the_standard_law_against_its_closed_form() {
        let gain = ConstantGain::new(1.0).unwrap();
        let law = StandardObserver::new([3.0, 2.0], gain, Unknown).unwrap();
        let (y, t) = (1.7, 1.0_f64);
        let (slow, fast) = ((-t).exp(), (-2.0 * t).exp());
        let x_hat = Vector2::new(y * (1.0 - 2.0 * fast + slow), 2.0 * y * (slow - fast));
        let exact = StandardState { x_hat, r: () };
        for (name, scheme, expected) in SCHEMES {
            let counts = if expected < 2.0 { [200, 400, 800] } else { [10, 20, 40] };
            let points = counts.map(|n| {
                let z = after(law, scheme, law.initial(), y, t, n);
                (t / f64::from(n), distance(&z, &exact))
            });
            order(name, &points, expected, 0.12);
        }
    }

    /// Low-power and peaking-free laws, staggered and not, all tend to the flow of the same rate,
    /// which here is the fine RK4 solution with 20 times as many steps.
    #[test]
    fn of_the_low_power_laws() {
        let gain = ConstantGain::new(2.0).unwrap();
        let (alpha, beta) = ([3.0, 3.0, 2.0], [3.2, 1.4, 0.0]);
        let low_power =
            LowPowerObserver::<f64, _, _, 3>::new(alpha, beta, gain, Unknown, NoSaturation)
                .unwrap();
        // the saturation cuts at the start: η₁ reaches 2.6, η₂ 1.2
        let clip = HardClip::new([0.8, 0.5, 0.0]).unwrap();
        let clipped =
            PeakingFreeObserver::<f64, _, _, _, 3>::new(alpha, beta, gain, Unknown, clip).unwrap();
        let rk4 = held(Integrator::Rk4, Hold::Measurement);
        let start = Memory::read(&[0.3, -0.1, 0.2, 2.5, 1.0]);
        let flow = after(low_power, rk4, start, 1.0, 1.0, 16_000);
        let cut_flow = after(clipped, rk4, start, 1.0, 1.0, 16_000);
        assert!(distance(&flow, &cut_flow) > 0.05, "the saturation matters");
        for (name, scheme, expected) in SCHEMES {
            // from the last stage on the innovation e₁ is frozen: first order
            let counts = if expected < 2.0 { [200, 400, 800] } else { [20, 40, 80] };
            let error = |n| distance(&after(low_power, scheme, start, 1.0, 1.0, n), &flow);
            let points = counts.map(|n| (1.0 / f64::from(n), error(n)));
            order(name, &points, expected, 0.15);
            // a corner in the rate costs the higher orders, and no scheme its convergence
            let error = |n| distance(&after(clipped, scheme, start, 1.0, 1.0, n), &cut_flow);
            let points = counts.map(|n| (1.0 / f64::from(n), error(n)));
            let found = slope(&points);
            assert!(found > 0.8 * expected.min(2.0), "{name} with a clip: {found}, {points:?}");
        }
    }

    /// φ = cos t and no samples: x̂ is sin t, if every stage is told its own time.
    #[test]
    fn of_a_model_that_depends_on_time() {
        #[derive(Clone, Copy)]
        struct Driven;
        impl Model<f64, 1> for Driven {
            fn f_hat(&self, t: f64, x_hat: &Vector1<f64>, u: &SVector<f64, 0>) -> Vector1<f64> {
                last(self.phi(t, x_hat, u))
            }
        }
        impl PhaseVariable<f64, 1> for Driven {
            fn phi(&self, t: f64, _: &Vector1<f64>, _: &SVector<f64, 0>) -> f64 {
                t.cos()
            }
        }
        let gain = ConstantGain::new(5.0).unwrap();
        let standard = StandardObserver::<f64, _, _, 1>::new([1.0], gain, Driven).unwrap();
        let low_power =
            LowPowerObserver::<f64, _, _, 1>::new([1.0], [0.0], gain, Driven, NoSaturation)
                .unwrap();
        // with nothing measured, holding the innovation holds nothing
        let schemes = SCHEMES.map(|(name, scheme, expected)| match name {
            "rk4-innovation-held" => (name, scheme, 4.0),
            _ => (name, scheme, expected),
        });
        for (name, scheme, expected) in schemes {
            let counts = if expected < 2.0 { [200, 400, 800] } else { [10, 20, 40] };
            for by_low_power in [false, true] {
                let points = counts.map(|n| {
                    let x_hat = if by_low_power {
                        after(low_power, scheme, low_power.initial(), f64::NAN, 2.0, n).x_hat.x
                    } else {
                        after(standard, scheme, standard.initial(), f64::NAN, 2.0, n).x_hat.x
                    };
                    (2.0 / f64::from(n), (x_hat - 2_f64.sin()).abs())
                });
                order(name, &points, expected, 0.1);
            }
        }
    }

    /// One step maps the error of k = (a, w²) by a matrix whose determinant is the product of the
    /// two multipliers: forward Euler gives 1 − ah + w²h² (damping a − w²h), the staggered step
    /// 1 − ah, as undamped by the step as the flow itself to first order.
    #[test]
    fn staggered_euler_keeps_the_damping() {
        let (a, w2, h) = (0.3, 4.0, 0.05);
        let law = StandardObserver::new([a, w2], ConstantGain::new(1.0).unwrap(), Unknown).unwrap();
        let determinant = |scheme| {
            let start = |x_hat| StandardState { x_hat, r: () };
            let image = |x_hat: Vector2<f64>| after(law, scheme, start(x_hat), 0.0, h, 1).x_hat;
            let (first, second) = (image(Vector2::x()), image(Vector2::y()));
            first.x * second.y - first.y * second.x
        };
        let euler = determinant(Discretisation::Euler);
        let staggered = determinant(Discretisation::StaggeredEuler);
        assert!((euler - (1.0 - a * h + w2 * h * h)).abs() < 1e-14, "{euler}");
        assert!((staggered - (1.0 - a * h)).abs() < 1e-14, "{staggered}");
    }
}

mod stochastic {
    use super::*;
    use StochasticIntegrator::{EulerMaruyama, Milstein, Taylor15};

    /// A scalar equation dX = a(X) dt + b(X) dW with the derivatives that the schemes ask for.
    #[derive(Clone, Copy)]
    enum Equation {
        /// dX = μX dt + σX dW.
        Geometric { mu: f64, sigma: f64 },
        /// dX = −θX dt + σ dW.
        OrnsteinUhlenbeck { theta: f64, sigma: f64 },
        /// dX = (c − e^X) dt + σ dW: the logarithm of a population with a limit.
        Logistic { c: f64, sigma: f64 },
    }

    use Equation::{Geometric, Logistic, OrnsteinUhlenbeck};

    impl Plant<f64> for Equation {
        type State = Vector1<f64>;
        type Input = ();
        type Output = f64;
        const TRUTH: (usize, usize) = (0, 1);
        fn drift(&self, _: f64, x: &Vector1<f64>, (): &()) -> Vector1<f64> {
            Vector1::new(match self {
                Geometric { mu, .. } => mu * x.x,
                OrnsteinUhlenbeck { theta, .. } => -theta * x.x,
                Logistic { c, .. } => c - x.x.exp(),
            })
        }
        fn output(&self, _: f64, x: &Vector1<f64>, (): &()) -> f64 {
            x.x
        }
        fn truth<'a>(&self, x: &'a Vector1<f64>) -> &'a [f64] {
            x.as_slice()
        }
        fn control(&self, _: f64, _: &Vector1<f64>, _: f64) {}
        fn supports(&self, _: StochasticIntegrator) -> bool {
            true
        }
        fn diffusion(&self, _: f64, x: &Vector1<f64>, (): &()) -> Vector1<f64> {
            Vector1::new(match self {
                Geometric { sigma, .. } => sigma * x.x,
                OrnsteinUhlenbeck { sigma, .. } | Logistic { sigma, .. } => *sigma,
            })
        }
        fn diffusion_slope(&self, _: f64, x: &Vector1<f64>, (): &()) -> Vector1<f64> {
            Vector1::new(match self {
                Geometric { sigma, .. } => sigma * sigma * x.x,
                _ => 0.0,
            })
        }
        fn jacobian_times(
            &self,
            _: f64,
            x: &Vector1<f64>,
            (): &(),
            v: &Vector1<f64>,
        ) -> Vector1<f64> {
            match self {
                Geometric { mu, .. } => v * *mu,
                OrnsteinUhlenbeck { theta, .. } => v * -*theta,
                Logistic { .. } => v * -x.x.exp(),
            }
        }
        fn curvature(&self, _: f64, x: &Vector1<f64>, (): &()) -> Vector1<f64> {
            Vector1::new(match self {
                Logistic { sigma, .. } => -0.5 * sigma * sigma * x.x.exp(),
                _ => 0.0,
            })
        }
    }

    const FINE: u32 = if cfg!(debug_assertions) { 16 } else { 32 };
    const RUNS: u64 = if cfg!(debug_assertions) { 200 } else { 1_000 };

    /// The exact X(1) from X(0) = x0 on the path that `coupled_paths` draws: `fine` steps a second.
    fn exact(equation: Equation, x0: f64, fine: u32, mut stream: Stream) -> f64 {
        let h = 1.0 / f64::from(fine);
        let (mut w, mut integral) = (0.0, 0.0);
        for i in 0..fine {
            let t = f64::from(i) * h;
            let WienerIncrement { dw, dz } = WienerIncrement::from_normals(stream.normal_pair(), h);
            match equation {
                Geometric { .. } => {}
                // ∫ e^{−θ(1−s)} dW over the step, by parts: W's own integral is ΔZ
                OrnsteinUhlenbeck { theta, .. } => {
                    integral += (-theta * (1.0 - t - h)).exp() * (dw - theta * dz);
                }
                // ∫ e^{g(s)} ds, g = cs + σW(s), to second order in the step
                Logistic { c, sigma } => {
                    let g = c * t + sigma * w;
                    let second = 0.5 * (c + 0.5 * sigma * sigma) * h * h;
                    integral += g.exp() * (h + sigma * dz + second);
                }
            }
            w += dw;
        }
        match equation {
            Geometric { mu, sigma } => x0 * (mu - 0.5 * sigma * sigma + sigma * w).exp(),
            OrnsteinUhlenbeck { theta, sigma } => x0 * (-theta).exp() + sigma * integral,
            // N = e^X: N = N₀e^g/(1 + N₀∫e^g), g = ct + σW (X has the drift c already)
            Logistic { c, sigma } => x0 + c + sigma * w - (x0.exp() * integral).ln_1p(),
        }
    }

    /// Strong errors E|X − exact| at t = 1 over the number of coarse steps.
    fn strong(equation: Equation, scheme: StochasticIntegrator, x0: f64) -> Vec<(f64, f64)> {
        let finest = match equation {
            Geometric { .. } => Milstein,
            _ => Taylor15,
        };
        let one = |coarse: u32| {
            let (mut error, mut fine_error) = (0.0, 0.0);
            for run in 0..RUNS {
                let stream = Stream::new(3, run, Channel::Process);
                let fine = FINE * 32 / coarse;
                let truth = exact(equation, x0, coarse * fine, stream);
                let (path, fine_path) = coupled_paths(
                    &equation,
                    scheme,
                    finest,
                    Vector1::new(x0),
                    1.0,
                    (coarse, fine),
                    &mut stream.clone(),
                    || false,
                );
                error += (path.x - truth).abs() / RUNS as f64;
                fine_error += (fine_path.x - truth).abs() / RUNS as f64;
            }
            assert!(fine_error < 0.2 * error, "fine path off by {fine_error}, coarse by {error}");
            (1.0 / f64::from(coarse), error)
        };
        [4, 8, 16, 32].map(one).to_vec()
    }

    #[test]
    fn multiplicative_noise() {
        let equation = Geometric { mu: 0.5, sigma: 0.5 };
        order("Euler-Maruyama", &strong(equation, EulerMaruyama, 1.0), 0.5, 0.1);
        order("Milstein", &strong(equation, Milstein, 1.0), 1.0, 0.1);
    }

    #[test]
    fn additive_noise() {
        let linear = OrnsteinUhlenbeck { theta: 1.5, sigma: 0.7 };
        order("Euler-Maruyama", &strong(linear, EulerMaruyama, 1.0), 1.0, 0.15);
        order("Milstein", &strong(linear, Milstein, 1.0), 1.0, 0.15);
        // a linear drift leaves the scheme one half better than its name
        order("Taylor 1.5", &strong(linear, Taylor15, 1.0), 2.0, 0.15);
    }

    #[test]
    fn additive_noise_and_a_curved_drift() {
        let curved = Logistic { c: 1.0, sigma: 1.0 };
        order("Euler-Maruyama", &strong(curved, EulerMaruyama, 0.5), 1.0, 0.15);
        order("Taylor 1.5", &strong(curved, Taylor15, 0.5), 1.5, 0.2);
    }

    /// ΔW and ΔZ of a whole step from its parts: variances h, h³/3, covariance h²/2.
    #[test]
    fn increments_join_exactly() {
        let first: WienerIncrement<f64> = WienerIncrement { dw: 0.3, dz: 0.01 };
        let second = WienerIncrement { dw: -0.1, dz: 0.02 };
        let joined = first.then(second, 0.25);
        assert!((joined.dw - 0.2).abs() < 1e-15);
        // W stands at ΔW of the first part during the second
        assert!((joined.dz - (0.01 + 0.02 + 0.3 * 0.25)).abs() < 1e-15);

        let (h, parts, draws) = (0.5, 8, 20_000);
        let mut stream = Stream::new(5, 0, Channel::Process);
        let mut moments = [0.0; 3];
        for _ in 0..draws {
            let part = h / f64::from(parts);
            let whole = (0..parts).fold(WienerIncrement { dw: 0.0, dz: 0.0 }, |sum, _| {
                sum.then(WienerIncrement::from_normals(stream.normal_pair(), part), part)
            });
            let products = [whole.dw * whole.dw, whole.dz * whole.dz, whole.dw * whole.dz];
            for (moment, product) in moments.iter_mut().zip(products) {
                *moment += product / f64::from(draws);
            }
        }
        for (ours, exact) in moments.iter().zip([h, h.powi(3) / 3.0, h * h / 2.0]) {
            assert!((ours / exact - 1.0).abs() < 0.04, "{ours} instead of {exact}");
        }
    }
}
