//! What holds for every design, every observer, every sample: properties, tried on random cases.

mod catalogue;

use catalogue::{SCHEMES, Visitor, visit_all};
use hgo_rs::gain::{AdaptiveGain, ConstantGain, DeadZoneGain, GainLaw};
use hgo_rs::integrate::{Integrator, PlantScheme, StochasticIntegrator};
use hgo_rs::memory::Memory;
use hgo_rs::metrics::{LogHistogram, Moments, SettlingTime, Window};
use hgo_rs::model::{InputGain, StrictFeedback, Unknown, no_input};
use hgo_rs::models::{Crackle, Diffusion, Lee, SanfelicePraly, Ship, VanDerPol};
use hgo_rs::noise::{Channel, Draw, Noise, SecondOrderSections, Sine, Stream};
use hgo_rs::observer::{ContinuousLaw, Discretisation, Discretised, Euler, Measurement};
use hgo_rs::observers::{
    HardClip, LowPowerObserver, ModifiedObserver, NoSaturation, ReducedOrderObserver,
    RepelledCollection, Saturation, SmoothSaturation, StandardObserver,
};
use hgo_rs::polynomial::{
    coefficients_from_poles, is_hurwitz, low_power_coefficients, low_power_coefficients_from_poles,
    low_power_polynomial,
};
use hgo_rs::schedule::{FixedStep, Schedule, StochasticApproximation};
use hgo_rs::simulate::{DIVERGED, Experiment, Probe, RunMetrics, Sample};
use hgo_rs::{DesignError, Observer, Scalar, Status};
use nalgebra::{SMatrix, SVector, Vector2, Vector3};
use proptest::prelude::*;
use std::fmt::Debug;

fn config(cases: u32) -> ProptestConfig {
    let cases = if cfg!(debug_assertions) { cases / 4 } else { cases };
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

fn close(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * b.abs().max(1e-300)
}

mod polynomials {
    use super::*;

    type Complex = (f64, f64);

    fn times((a, b): Complex, (c, d): Complex) -> Complex {
        (a * c - b * d, a * d + b * c)
    }

    /// n poles from n pairs of numbers: real ones, and conjugate pairs where `complex` says so.
    fn poles<const N: usize>(drawn: &[(f64, f64, bool)]) -> [Complex; N] {
        let mut poles = [(0.0, 0.0); N];
        let mut i = 0;
        for (re, im, complex) in drawn {
            if i + 1 < N && *complex {
                (poles[i], poles[i + 1]) = ((*re, *im), (*re, -*im));
                i += 2;
            } else if i < N {
                poles[i] = (*re, 0.0);
                i += 1;
            }
        }
        poles
    }

    /// Trailing coefficients of ∏(s − pᵢ), by multiplying real factors.
    fn expanded(poles: &[Complex]) -> Vec<f64> {
        let mut c = vec![1.0];
        let mut rest = poles.iter();
        while let Some((re, im)) = rest.next() {
            let factor = if *im == 0.0 {
                vec![1.0, -re]
            } else {
                rest.next();
                vec![1.0, -2.0 * re, re * re + im * im]
            };
            let mut product = vec![0.0; c.len() + factor.len() - 1];
            for (i, a) in c.iter().enumerate() {
                for (j, b) in factor.iter().enumerate() {
                    product[i + j] += a * b;
                }
            }
            c = product;
        }
        c.split_off(1)
    }

    fn drawn(im: f64) -> impl Strategy<Value = Vec<(f64, f64, bool)>> {
        prop::collection::vec((-2.5..-0.2, 0.05..im, any::<bool>()), 23)
    }

    /// Calls `check::<N>` for N from 1 to 12.
    macro_rules! each_order {
        ($check:ident, $($argument:expr),*) => {{
            $check::<1, 1>($($argument),*)?;
            $check::<2, 3>($($argument),*)?;
            $check::<3, 5>($($argument),*)?;
            $check::<4, 7>($($argument),*)?;
            $check::<5, 9>($($argument),*)?;
            $check::<6, 11>($($argument),*)?;
            $check::<7, 13>($($argument),*)?;
            $check::<8, 15>($($argument),*)?;
            $check::<9, 17>($($argument),*)?;
            $check::<10, 19>($($argument),*)?;
            $check::<11, 21>($($argument),*)?;
            $check::<12, 23>($($argument),*)?;
        }};
    }

    fn standard<const N: usize, const R: usize>(
        drawn: &[(f64, f64, bool)],
        s: Complex,
    ) -> Result<(), TestCaseError> {
        let poles: [Complex; N] = poles(drawn);
        let k = coefficients_from_poles(poles).unwrap();
        let (mut product, mut horner, mut scale) = ((1.0, 0.0), (1.0, 0.0), 1.0);
        for (re, im) in poles {
            product = times(product, (s.0 - re, s.1 - im));
        }
        for c in k {
            horner = times(horner, s);
            horner.0 += c;
            scale = scale * s.0.hypot(s.1) + c.abs();
        }
        let off = (product.0 - horner.0).hypot(product.1 - horner.1);
        prop_assert!(off <= 1e-13 * scale, "n = {N}: {k:?}");
        prop_assert!(is_hurwitz(&k), "n = {N}: {k:?}");
        let gain = ConstantGain::new(10.0).unwrap();
        prop_assert!(StandardObserver::<f64, _, _, N>::new(k, gain, Unknown).is_ok());
        Ok(())
    }

    fn unstable<const N: usize, const R: usize>(
        drawn: &[(f64, f64, bool)],
        right: (f64, f64, bool),
    ) -> Result<(), TestCaseError> {
        let mut drawn = drawn.to_vec();
        drawn[0] = right;
        let poles: [Complex; N] = poles(&drawn);
        let k: [f64; N] = expanded(&poles).try_into().unwrap();
        prop_assert!(!is_hurwitz(&k), "n = {N}: {poles:?}");
        let gain = ConstantGain::new(10.0).unwrap();
        let refused = StandardObserver::<f64, _, _, N>::new(k, gain, Unknown).unwrap_err();
        prop_assert_eq!(refused.parameter, "k");
        prop_assert_eq!(coefficients_from_poles(poles).unwrap_err().parameter, "poles");
        let refused = low_power_coefficients_from_poles::<f64, N, N>(poles).unwrap_err();
        prop_assert_eq!(refused.parameter, "poles");
        Ok(())
    }

    fn low_power<const N: usize, const R: usize>(
        drawn: &[(f64, f64, bool)],
    ) -> Result<(), TestCaseError> {
        let poles: [Complex; R] = poles(drawn);
        let asked: [f64; R] = expanded(&poles).try_into().unwrap();
        let by_polynomial = low_power_coefficients::<f64, N>(&asked);
        prop_assert!(by_polynomial.is_ok(), "n = {N}: {poles:?}: {by_polynomial:?}");
        let by_poles = low_power_coefficients_from_poles::<f64, N, R>(poles);
        prop_assert!(by_poles.is_ok(), "n = {N}: {poles:?}: {by_poles:?}");
        for (alpha, beta) in [by_polynomial.unwrap(), by_poles.unwrap()] {
            let mut ours = [0.0; R];
            low_power_polynomial(&alpha, &beta, &mut ours);
            for (i, (ours, asked)) in ours.iter().zip(&asked).enumerate() {
                prop_assert!(close(*ours, *asked, 1e-7), "n = {N}, c{i}: {ours} for {asked}");
            }
            prop_assert!(alpha.iter().all(|a| *a > 0.0) && beta[..N - 1].iter().all(|b| *b > 0.0));
            prop_assert!(beta[N - 1] == 0.0);
            let gain = ConstantGain::new(10.0).unwrap();
            let built =
                LowPowerObserver::<f64, _, _, N>::new(alpha, beta, gain, Unknown, NoSaturation);
            prop_assert!(built.is_ok(), "n = {N}: {poles:?}: {built:?}");
        }
        Ok(())
    }

    proptest! {
        #![proptest_config(config(128))]

        #[test]
        fn coefficients_expand_the_poles(drawn in drawn(3.0), re in -3.0..3.0, im in -3.0..3.0) {
            each_order!(standard, &drawn, (re, im));
        }

        #[test]
        fn a_pole_on_the_right_is_refused(
            drawn in drawn(3.0), re in 0.05..2.0, im in 0.05..3.0, complex in any::<bool>(),
        ) {
            each_order!(unstable, &drawn, (re, im, complex));
        }

        #[test]
        fn alpha_and_beta_give_the_polynomial_back(drawn in drawn(2.0)) {
            each_order!(low_power, &drawn);
        }

        /// det(sI − M) of the matrix M that the law itself applies to its memory.
        #[test]
        fn characteristic_polynomial_is_that_of_the_law(
            alpha in prop::array::uniform4(0.5..4.0),
            beta in prop::array::uniform4(0.2..3.0),
            s in -3.0..3.0,
        ) {
            const LEN: usize = 7;
            let mut trailing = [0.0; LEN];
            low_power_polynomial(&alpha, &beta, &mut trailing);
            let gain = ConstantGain::new(1.0).unwrap();
            let law = LowPowerObserver::<f64, _, _, 4>::new(alpha, beta, gain, Unknown, NoSaturation);
            prop_assert_eq!(law.is_ok(), is_hurwitz(&trailing));
            if let Ok(law) = law {
                let mut matrix = [[0.0; LEN]; LEN];
                for column in 0..LEN {
                    let mut unit = [0.0; LEN];
                    unit[column] = 1.0;
                    let z = Memory::read(&unit);
                    let rate = law.rate(0.0, &z, &law.innovation(&z, 0.0), &no_input());
                    let mut entries = [0.0; LEN];
                    rate.write(&mut entries);
                    for row in 0..LEN {
                        matrix[row][column] = if row == column { s } else { 0.0 } - entries[row];
                    }
                }
                let polynomial = trailing.iter().fold(1.0, |value, c| value * s + c);
                let scale = trailing.iter().fold(1.0, |value, c| value * s.abs() + c);
                let gap = (determinant(matrix) - polynomial).abs();
                prop_assert!(gap <= 1e-11 * scale, "{gap} at s = {s}");
            }
        }
    }

    /// By elimination with pivoting.
    fn determinant<const N: usize>(mut m: [[f64; N]; N]) -> f64 {
        let mut det = 1.0;
        for column in 0..N {
            let largest =
                |a: &usize, b: &usize| m[*a][column].abs().total_cmp(&m[*b][column].abs());
            let pivot = (column..N).max_by(largest).unwrap();
            if pivot != column {
                m.swap(pivot, column);
                det = -det;
            }
            det *= m[column][column];
            for row in column + 1..N {
                let factor = m[row][column] / m[column][column];
                for j in column..N {
                    m[row][j] -= factor * m[column][j];
                }
            }
        }
        det
    }

    #[test]
    fn malformed_poles_are_refused() {
        let nan = f64::NAN;
        let refused: [[Complex; 3]; 6] = [
            [(-1.0, 0.0), (-1.0, 1.0), (-1.0, 1.0)], // the same one twice
            [(-1.0, 0.0), (-1.0, 1.0), (-1.5, -1.0)], // no conjugate
            [(-1.0, 0.5), (-2.0, 0.0), (-3.0, 0.0)],
            [(nan, 0.0), (-1.0, 0.0), (-2.0, 0.0)],
            [(-1.0, nan), (-1.0, nan), (-2.0, 0.0)],
            [(f64::NEG_INFINITY, 0.0), (-1.0, 0.0), (-2.0, 0.0)],
        ];
        for poles in refused {
            assert_eq!(coefficients_from_poles(poles).unwrap_err().parameter, "poles", "{poles:?}");
        }
        // degrees that do not fit the order, and an order that is too high
        assert!(low_power_coefficients::<f64, 2>(&[3.0, 3.0]).is_err());
        assert!(low_power_coefficients_from_poles::<f64, 2, 2>([(-1.0, 0.0); 2]).is_err());
        assert!(low_power_coefficients_from_poles::<f64, 13, 25>([(-1.0, 0.0); 25]).is_err());
        assert!(!is_hurwitz(&[1.0; 40]));
        assert!(!is_hurwitz(&[1.0, nan]) && !is_hurwitz(&[f64::INFINITY, 1.0]));
    }
}

mod designs {
    use super::*;

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
            refused("p1", AdaptiveGain::new(bad, 0.01, 0.2, 2));
            refused("p2", AdaptiveGain::new(1.0, bad, 0.2, 2));
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
            refused("b", AdaptiveGain::new(1.0, 0.01, bad, 2));
            refused("b", DeadZoneGain::new(1.0, 0.01, bad));
        }
        for bad in [f64::NAN, f64::INFINITY] {
            refused("nu1", SanfelicePraly::new(bad, 0.1));
            refused("nu2", SanfelicePraly::new(1.9, bad));
            refused("w", Ship::new(0.0, [0.0, bad, 0.0]));
            let gain = AdaptiveGain::new(1.0, 0.01, 0.2, 2).unwrap();
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
        let gain = AdaptiveGain::new(1.0, 0.01, 0.2, 2).unwrap();
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
        let multiplicative =
            VanDerPol::new(0.8, 0.5, Diffusion::Multiplicative, correction).unwrap();
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
}

mod samples {
    use super::*;

    const MISSING: [f64; 3] = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];

    /// Feeds every observer the same samples and inspects memory and status after each.
    struct Feed<'a> {
        samples: &'a [f64],
        seen: u32,
    }

    impl<T: Scalar> Visitor<T> for Feed<'_> {
        fn visit<O>(
            &mut self,
            law: &'static str,
            scheme: &'static str,
            observer: O,
            input: fn(T) -> O::Input,
        ) where
            O: Observer<T>,
            O::State: PartialEq + Debug,
        {
            let dt = T::from_f64(2e-3);
            let mut z = observer.initial();
            for (k, y) in self.samples.iter().enumerate() {
                let t = T::from_f64(k as f64) * dt;
                let before = z;
                let sample = O::Measurement::fill(|| T::from_f64(*y));
                let status = observer.step(&mut z, &sample, &input(T::from_f64(0.1)), t, dt);
                let mut finite = true;
                z.visit(&mut |x| finite &= x.is_finite());
                assert!(finite, "{law}, {scheme}: {y} at {k} made {before:?} into {z:?}");
                if law != "reduced-order" {
                    let expected = if y.is_finite() { Status::Updated } else { Status::Predicted };
                    assert_eq!(status, expected, "{law}, {scheme}: {y} at {k}");
                }
            }
            self.seen += 1;
        }
    }

    fn recorded() -> impl Strategy<Value = Vec<f64>> {
        let value = prop_oneof![4 => -1.0..1.0, 1 => prop::sample::select(&MISSING[..])];
        prop::collection::vec(value, 1..60)
    }

    proptest! {
        #![proptest_config(config(48))]

        #[test]
        fn a_missing_sample_never_reaches_the_memory(samples in recorded()) {
            let mut feed = Feed { samples: &samples, seen: 0 };
            visit_all::<f64>(&mut feed).unwrap();
            visit_all::<f32>(&mut feed).unwrap();
            prop_assert!(feed.seen >= 144, "{}", feed.seen);
        }

        /// Over a missing sample the law moves as if the sample had been its own estimate.
        #[test]
        fn a_missing_sample_means_no_innovation(
            x1 in -2.0..2.0, x2 in -2.0..2.0, r in 1.0..4.0, dt in 1e-4..0.1,
        ) {
            let gain = AdaptiveGain::new(10.0, 0.0025, 0.183, 2).unwrap();
            let model = SanfelicePraly::new(1.9, 0.1).unwrap();
            let law = StandardObserver::new([2.0, 2.0], gain, model).unwrap();
            for scheme in [Discretisation::Euler, Discretisation::StaggeredEuler] {
                let observer = Discretised { law, scheme };
                for y in MISSING {
                    let mut missing = (Vector2::new(x1, x2), r);
                    let mut own = missing;
                    observer.step(&mut missing, &y, &no_input(), 0.0, dt);
                    observer.step(&mut own, &x1, &no_input(), 0.0, dt);
                    prop_assert_eq!(missing, own);
                }
            }
            // without a model and under any scheme of order 2 or more: x̂₁ + x̂₂t, exactly
            let gain = ConstantGain::new(50.0).unwrap();
            let law = StandardObserver::new([2.0, 2.0], gain, Unknown).unwrap();
            for (name, scheme) in &SCHEMES[1..] {
                let mut z = (Vector2::new(x1, x2), ());
                Discretised { law, scheme: *scheme }
                    .step(&mut z, &f64::NAN, &no_input(), 0.0, dt);
                prop_assert!((z.0.x - (x1 + dt * x2)).abs() < 1e-14, "{}", name);
                prop_assert_eq!(z.0.y, x2);
            }
        }
    }

    /// After a gap the reduced-order observer divides by the whole time between present samples.
    #[test]
    fn reduced_order_bridges_a_gap() {
        let ship = Ship::new(0.0, [0.0; 3]).unwrap();
        let observer = ReducedOrderObserver::new([0.1, 0.2, 0.2], 0.1, ship).unwrap();
        let (dt, v) = (0.05, Vector3::new(0.7, 0.02, 0.1));
        let u = Vector2::new(0.01, 0.02);
        let y = |k: f64| Vector3::new(0.1, 0.2, 0.3) + v * (k * dt);
        let mut z = observer.initial();
        z.z_hat = Vector3::new(0.5, 0.1, 0.0);
        assert_eq!(observer.step(&mut z, &y(0.0), &u, 0.0, dt), Status::Updated);
        assert_eq!(z.z_hat, Vector3::new(0.5, 0.1, 0.0)); // one sample tells no velocity
        let gap = Vector3::from_element(f64::NAN);
        let mut expected = z.z_hat;
        for k in 1..3 {
            assert_eq!(observer.step(&mut z, &gap, &u, 0.0, dt), Status::Predicted);
            expected += ship.f2(&y(0.0), &expected, &u) * dt;
            assert!((z.z_hat - expected).amax() < 1e-15, "after {k} missing samples");
        }
        observer.step(&mut z, &y(3.0), &u, 0.0, dt);
        let (sin, cos) = (0.3_f64.sin(), 0.3_f64.cos());
        let psi = Vector3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z);
        let h = Vector3::new(1.0, 2.0, 2.0);
        let rate = h.component_mul(&(psi - expected)) + ship.f2(&y(0.0), &psi, &u);
        assert!((z.z_hat - (expected + rate * dt)).amax() < 1e-13, "{}", z.z_hat);
    }

    /// z at which the model has no value (atan 0/0) holds the estimate and says so.
    #[test]
    fn reduced_order_reports_an_undefined_model() {
        let ship = Ship::new(0.0, [0.0; 3]).unwrap();
        let observer = ReducedOrderObserver::new([0.1, 0.2, 0.2], 0.1, ship).unwrap();
        let mut z = observer.initial();
        let y = Vector3::new(1.0, 2.0, 0.5);
        observer.step(&mut z, &y, &Vector2::zeros(), 0.0, 0.1);
        let held = z.z_hat;
        let status = observer.step(&mut z, &y, &Vector2::zeros(), 0.1, 0.1); // at rest: Ψ = 0
        assert_eq!((status, z.z_hat), (Status::ModelUndefined, held));
    }

    /// Steps every observer through extreme samples, memories, inputs and periods.
    struct Extremes {
        steps: u64,
    }

    impl<T: Scalar> Visitor<T> for Extremes {
        fn visit<O>(
            &mut self,
            law: &'static str,
            scheme: &'static str,
            observer: O,
            input: fn(T) -> O::Input,
        ) where
            O: Observer<T>,
            O::State: PartialEq + Debug,
        {
            let values = [0.0, -0.0, 1e300, -1e300, 3e38, -3e38, 5e-324, 1e-45, f64::MAX, f64::MIN]
                .into_iter()
                .chain(MISSING)
                .map(T::from_f64);
            let adaptive = ["adaptive", "dead zone", "low-power, adaptive"].contains(&law);
            for y in values.clone() {
                for start in values.clone() {
                    for dt in [1e-3, 5e-324, 1e300].map(T::from_f64) {
                        let mut z = observer.initial();
                        z.visit_mut(&mut |entry| *entry = start);
                        for k in 0..3_u8 {
                            let sample = O::Measurement::fill(|| y);
                            let t = T::from_f64(f64::from(k)) * dt;
                            let status = observer.step(&mut z, &sample, &input(start), t, dt);
                            let present = sample.is_present();
                            assert!(present || status != Status::Updated, "{law}, {scheme}");
                            let mut last = T::ZERO;
                            z.visit(&mut |entry| last = entry);
                            assert!(!adaptive || last >= T::ONE, "{law}, {scheme}: r = {last:?}");
                            self.steps += 1;
                        }
                        observer.innovation(&z, &O::Measurement::fill(|| y));
                    }
                }
            }
        }
    }

    /// A panic in the step path (overflow checks are on in a debug build) fails this test.
    #[test]
    fn no_sample_makes_a_step_panic() {
        let mut extremes = Extremes { steps: 0 };
        visit_all::<f64>(&mut extremes).unwrap();
        visit_all::<f32>(&mut extremes).unwrap();
        assert_eq!(extremes.steps % (13 * 13 * 9), 0);
        assert!(extremes.steps >= 144 * 13 * 13 * 9, "{}", extremes.steps);
    }
}

mod gains {
    use super::*;

    fn r_after<G, S>(gain: G, scheme: S, samples: &[f64], dt: f64, start: f64) -> Vec<f64>
    where
        G: GainLaw<f64, Memory = f64>,
        S: hgo_rs::observer::Scheme<f64>,
    {
        let law = StandardObserver::<f64, _, _, 2>::new([2.0, 2.0], gain, Unknown).unwrap();
        let observer = Discretised { law, scheme };
        let mut z = (Vector2::zeros(), start);
        let mut trace = Vec::new();
        for y in samples {
            observer.step(&mut z, y, &no_input(), 0.0, dt);
            trace.push(z.1);
        }
        trace
    }

    proptest! {
        #![proptest_config(config(256))]

        #[test]
        fn the_adapted_gain_stays_at_or_above_1(
            p1 in 0.1..50.0, p2 in 1e-5..1.0, b in 0.01..0.49, dt in 1e-4..0.5,
            start in 1.0..8.0, samples in prop::collection::vec(-3.0..3.0, 40),
            scheme in 0_usize..5,
        ) {
            let (_, scheme) = SCHEMES[scheme];
            let adaptive = AdaptiveGain::new(p1, p2, b, 2).unwrap();
            let dead_zone = DeadZoneGain::new(p1, p2, b).unwrap();
            prop_assert!(r_after(adaptive, scheme, &samples, dt, start).iter().all(|r| *r >= 1.0));
            // the dead zone's never comes back (until too long a step lets the run diverge)
            let mut trace = r_after(dead_zone, scheme, &samples, dt, start);
            trace.truncate(trace.iter().position(|r| *r > DIVERGED).unwrap_or(40));
            prop_assert!(trace.first().is_none_or(|r| *r >= start) && trace.is_sorted(), "{:?}", trace);
        }

        /// (6) at r = 1 is p₁e² ≥ 0, so [1, ∞) is invariant; it falls where r is large and e small.
        #[test]
        fn the_adaptive_law_points_inwards(
            p1 in 0.1..50.0, p2 in 1e-5..1.0, b in 0.01..0.49, e in -3.0..3.0, n in 1_usize..12,
        ) {
            let gain = AdaptiveGain::new(p1, p2, b, n).unwrap();
            prop_assert!(close(gain.rate(&1.0, e), p1 * e * e, 1e-9 * (1.0 + p2 / (e * e))));
            prop_assert!(gain.rate(&2.0, 0.0) < 0.0);
            let dead_zone = DeadZoneGain::new(p1, p2, b).unwrap();
            prop_assert_eq!(dead_zone.rate(&2.0, 0.99 * p2.sqrt()), 0.0);
            prop_assert!(dead_zone.rate(&2.0, 1.01 * p2.sqrt()) > 0.0);
            // the law of e and of −e is the same
            prop_assert_eq!(gain.rate(&1.7, e), gain.rate(&1.7, -e));
        }

        /// Σ a(k) and its limits: a(0) = αε, decreasing, b(k₀) = 2^{−p}.
        #[test]
        fn the_steps_decrease(alpha in 0.01..0.9, epsilon in 1e-3..0.1, p in 0.51..1.5) {
            let a = StochasticApproximation::new(alpha, epsilon, 1000.0, p).unwrap();
            prop_assert_eq!(a.dt(0), alpha * epsilon);
            prop_assert!((1..2000).all(|k| a.dt(k) < a.dt(k - 1)));
            prop_assert!(close(a.b(1000), 0.5_f64.powf(p), 1e-14));
        }
    }
}

mod saturations {
    use super::*;

    proptest! {
        #![proptest_config(config(512))]

        #[test]
        fn bounded_odd_monotone_and_smooth(level in 0.1..10.0, s in -50.0..50.0, step in 1e-6..5.0) {
            let hard = HardClip::<f64, 2>::new([level, 0.0]).unwrap();
            let smooth = SmoothSaturation::<f64, 2>::new([level, 0.0]).unwrap();
            let (h, c) = (|s| hard.apply(0, s), |s| smooth.apply(0, s));
            prop_assert!(h(s).abs() <= level && c(s).abs() < level + 1.0);
            prop_assert!(h(-s) == -h(s) && c(-s) == -c(s));
            prop_assert!(h(s + step) >= h(s));
            prop_assert!(c(s + step) > c(s), "strictly");
            // no steeper than the identity, and the identity within the level
            prop_assert!(h(s + step) - h(s) <= step * (1.0 + 1e-9));
            prop_assert!(c(s + step) - c(s) <= step * (1.0 + 1e-9));
            let inner = s / 50.0 * level;
            prop_assert!(h(inner) == inner && c(inner) == inner);
            // C¹: the slope 1/(1 + u)² outside, which is 1 at the level, as inside
            let (u, width) = (s.abs() / 10.0, 1e-6);
            let slope = (c(level + u + width) - c(level + u)) / width;
            prop_assert!((slope - (1.0 + u).powi(-2)).abs() < 1e-5, "{}", slope);
            let across = (c(level + width) - c(level - width)) / (2.0 * width);
            prop_assert!((across - 1.0).abs() < 1e-5, "{}", across);
        }
    }

    #[test]
    fn extreme_arguments() {
        let hard = HardClip::<f64, 2>::new([3.0, 0.0]).unwrap();
        let smooth = SmoothSaturation::<f64, 2>::new([3.0, 0.0]).unwrap();
        for (s, sign) in [(1e300, 1.0), (-1e300, -1.0), (f64::INFINITY, 1.0)] {
            assert!((hard.apply(0, s) - 3.0 * sign).abs() < 1e-15);
            if s.is_finite() {
                assert!((smooth.apply(0, s) - 4.0 * sign).abs() < 1e-15);
            }
        }
    }
}

mod memories {
    use super::*;

    /// Flattens the memory of every observer and reads it back.
    struct RoundTrip<'a> {
        values: &'a [f64],
    }

    impl<T: Scalar> Visitor<T> for RoundTrip<'_> {
        fn visit<O>(&mut self, law: &'static str, _: &'static str, _: O, _: fn(T) -> O::Input)
        where
            O: Observer<T>,
            O::State: PartialEq + Debug,
        {
            let length = O::State::LEN;
            let values: Vec<T> = self.values[..length].iter().map(|v| T::from_f64(*v)).collect();
            let memory = O::State::read(&values);
            let mut count = 0;
            memory.visit(&mut |_| count += 1);
            assert_eq!(count, length, "{law}");
            let mut written = vec![T::from_f64(-7.0); length + 2];
            memory.write(&mut written);
            assert_eq!(written[..length], values[..], "{law}");
            assert_eq!(written[length..], [T::from_f64(-7.0); 2], "{law}: wrote too far");
            assert_eq!(O::State::read(&written), memory, "{law}");
            // a short buffer fills what it has; a short record leaves zeros
            let mut short = vec![T::ZERO; length - 1];
            memory.write(&mut short);
            assert_eq!(short[..], values[..length - 1], "{law}");
            let mut last = T::ONE;
            O::State::read(&short).visit(&mut |x| last = x);
            assert_eq!(last, T::ZERO, "{law}");
            // the vector space: x + 2x − 3x = 0
            let twice = memory.plus(T::from_f64(2.0), &memory);
            let none = twice.plus(T::from_f64(-3.0), &memory);
            assert!(none.within(T::from_f64(1e-4)), "{law}: {none:?}");
            assert!(!O::State::read(&[T::from_f64(f64::NAN)]).within(T::from_f64(1e300)));
        }
    }

    proptest! {
        #![proptest_config(config(64))]

        #[test]
        fn flatten_and_read_back(values in prop::collection::vec(-100.0..100.0, 32)) {
            let mut trip = RoundTrip { values: &values };
            visit_all::<f64>(&mut trip).unwrap();
            visit_all::<f32>(&mut trip).unwrap();
        }
    }
}

mod laws {
    use super::*;

    /// The estimates of every observer after half a second of a sine, by name.
    struct Estimates(Vec<(&'static str, &'static str, Vec<f64>)>);

    impl<T: Scalar> Visitor<T> for Estimates {
        fn visit<O>(
            &mut self,
            law: &'static str,
            scheme: &'static str,
            observer: O,
            input: fn(T) -> O::Input,
        ) where
            O: Observer<T>,
            O::State: PartialEq + Debug,
        {
            let dt = T::from_f64(1e-3);
            let mut z = observer.initial();
            for k in 0..500_u16 {
                let t = T::from_f64(f64::from(k)) * dt;
                let y = O::Measurement::fill(|| T::from_f64(0.5) * t.sin());
                observer.step(&mut z, &y, &input(T::from_f64(0.1)), t, dt);
            }
            let estimate = observer.estimate(&z).iter().map(|x| x.to_f64()).collect();
            self.0.push((law, scheme, estimate));
        }
    }

    /// Single precision is the same law: estimates agree to single precision.
    #[test]
    fn single_and_double_precision_agree() {
        let (mut double, mut single) = (Estimates(Vec::new()), Estimates(Vec::new()));
        visit_all::<f64>(&mut double).unwrap();
        visit_all::<f32>(&mut single).unwrap();
        for ((law, scheme, wide), (_, _, narrow)) in double.0.iter().zip(&single.0) {
            let size = wide.iter().fold(1.0_f64, |a, x| a.max(x.abs()));
            for (a, b) in wide.iter().zip(narrow) {
                assert!((a - b).abs() < 2e-3 * size, "{law}, {scheme}: {wide:?} and {narrow:?}");
            }
            assert!(wide.iter().any(|x| x.abs() > 1e-3), "{law}, {scheme} moved: {wide:?}");
        }
    }

    /// Copies that start alike do not repel and are the plain adaptive observer each.
    #[test]
    fn identical_copies_are_the_plain_observer() {
        let gain = AdaptiveGain::new(10.0, 0.0025, 0.183, 2).unwrap();
        let model = SanfelicePraly::new(1.9, 0.1).unwrap();
        let plain = StandardObserver::new([2.0, 2.0], gain, model).unwrap();
        let collection =
            RepelledCollection::<f64, _, 2, 3>::new([2.0, 2.0], [0.06, 0.03], gain, model).unwrap();
        for (name, scheme) in SCHEMES {
            let start = (Vector2::new(0.4, -0.1), 1.3);
            let (mut one, mut three) = (start, [start; 3]);
            for k in 0..200_u16 {
                let y = (0.02 * f64::from(k)).sin();
                Discretised { law: plain, scheme }.step(&mut one, &y, &no_input(), 0.0, 0.01);
                Discretised { law: collection, scheme }.step(
                    &mut three,
                    &y,
                    &no_input(),
                    0.0,
                    0.01,
                );
            }
            assert_eq!(three, [one; 3], "{name}");
        }
    }

    /// (23)-(25) written out with ŷᵢ − y for one step of forward Euler.
    #[test]
    fn collection_and_modified_observer_written_out() {
        let (k, k_bar, b, nu1, p1, p2) = ([2.0, 2.1], [0.056, 0.032], 0.183, 1.9, 10.0, 0.0025);
        let gain = AdaptiveGain::new(p1, p2, b, 2).unwrap();
        let model = SanfelicePraly::new(nu1, 0.1).unwrap();
        let collection = RepelledCollection::<f64, _, 2, 3>::new(k, k_bar, gain, model).unwrap();
        let observer = Discretised { law: ModifiedObserver { collection }, scheme: Euler };
        let main = (Vector2::new(0.2, 0.3), 1.1);
        let copies = [(0.1, -0.2, 1.2), (-0.3, 0.1, 1.5), (0.4, 0.0, 1.9)]
            .map(|(a, c, r)| (Vector2::new(a, c), r));
        let (y, dt) = (0.25, 1e-3);
        let mut z = (main, copies);
        observer.step(&mut z, &y, &no_input(), 0.0, dt);

        let adapted = |r: f64, error: f64| {
            r + dt * p1 * ((error * error - p2) * r.powf(1.0 - 2.0 * b) + p2 / r.powi(4))
        };
        for (i, (x, r)) in copies.iter().enumerate() {
            let error = x.x - y;
            let mut repulsion = 0.0;
            for (j, (other, other_r)) in copies.iter().enumerate() {
                if j != i {
                    repulsion += error / r.powf(b) - (other.x - y) / other_r.powf(b);
                }
            }
            let rate1 = x.y + nu1 * x.x - k[0] * r * error + k_bar[0] * r.powf(1.0 + b) * repulsion;
            let rate2 = -k[1] * r * r * error + k_bar[1] * r.powf(2.0 + b) * repulsion;
            let (ours, ours_r) = z.1[i];
            assert!((ours - (x + Vector2::new(rate1, rate2) * dt)).amax() < 1e-15, "copy {i}");
            assert!((ours_r - adapted(*r, error)).abs() < 1e-15, "copy {i}");
        }
        let ((x, r), error) = (main, main.0.x - y);
        let nominal = (1.2 + 1.5 + 1.9) / 3.0;
        let product = r * nominal;
        let rate1 = x.y + nu1 * x.x - k[0] * product * error;
        let rate2 = -k[1] * product * product * error;
        assert!((z.0.0 - (x + Vector2::new(rate1, rate2) * dt)).amax() < 1e-15);
        assert!((z.0.1 - adapted(r, error)).abs() < 1e-15);
        assert!((collection.nominal_gain(&copies) - nominal).abs() < 1e-15);
    }

    /// (5) and (11) of the low-power and peaking-free laws written out for n = 3.
    #[test]
    fn low_power_and_peaking_free_written_out() {
        let (alpha, beta, ell, b0) = ([3.0, 2.5, 2.0], [3.2, 1.4, 0.0], 5.0, 1.5);
        let (x, eta, y, u, dt) = ([0.2, -0.4, 0.9], [2.5, -1.7], 0.35, 0.7, 1e-3);
        let gain = ConstantGain::new(ell).unwrap();
        let model = InputGain { b0 };
        let start = Memory::read(&[x[0], x[1], x[2], eta[0], eta[1]]);
        let input = SVector::<f64, 1>::new(u);
        let clip = HardClip::new([1.1, 1.2, 0.0]).unwrap();
        let low = LowPowerObserver::<f64, _, _, 3, 1>::new(alpha, beta, gain, model, NoSaturation);
        let free = hgo_rs::observers::PeakingFreeObserver::<f64, _, _, _, 3, 1>::new(
            alpha, beta, gain, model, clip,
        );
        let (mut by_low, mut by_free) = (start, start);
        Discretised { law: low.unwrap(), scheme: Euler }.step(&mut by_low, &y, &input, 0.0, dt);
        Discretised { law: free.unwrap(), scheme: Euler }.step(&mut by_free, &y, &input, 0.0, dt);
        for (ours, s) in [(by_low, eta), (by_free, [1.1, -1.2])] {
            let e = [y - x[0], s[0] - x[1], s[1] - x[2]];
            let phi = b0 * u;
            let rate = [
                eta[0] + alpha[0] * ell * e[0],
                eta[1] + alpha[1] * ell * e[1],
                phi + alpha[2] * ell * e[2],
                s[1] + beta[0] * ell * ell * e[0],
                phi + beta[1] * ell * ell * e[1],
            ];
            let mut entries = [0.0; 5];
            ours.write(&mut entries);
            for (i, old) in [x[0], x[1], x[2], eta[0], eta[1]].into_iter().enumerate() {
                assert!((entries[i] - (old + dt * rate[i])).abs() < 1e-15, "entry {i}");
            }
        }
    }

    /// The least squares of a general g against the rotation's transpose, and for a tall g.
    #[test]
    fn velocity_is_explained_by_least_squares() {
        #[derive(Clone, Copy)]
        struct General(Ship<f64>);
        impl StrictFeedback<f64, 3, 3, 2> for General {
            fn f1(&self, x: &Vector3<f64>) -> Vector3<f64> {
                self.0.f1(x)
            }
            fn g(&self, x: &Vector3<f64>) -> SMatrix<f64, 3, 3> {
                self.0.g(x)
            }
            fn f2(&self, x: &Vector3<f64>, z: &Vector3<f64>, u: &Vector2<f64>) -> Vector3<f64> {
                self.0.f2(x, z, u)
            }
        }
        #[derive(Clone, Copy)]
        struct Tall;
        impl StrictFeedback<f64, 3, 2, 0> for Tall {
            fn f1(&self, _: &Vector3<f64>) -> Vector3<f64> {
                Vector3::zeros()
            }
            fn g(&self, _: &Vector3<f64>) -> SMatrix<f64, 3, 2> {
                SMatrix::<f64, 3, 2>::new(1.0, 2.0, 0.5, -1.0, 3.0, 0.2)
            }
            fn f2(&self, _: &Vector3<f64>, _: &Vector2<f64>, _: &SVector<f64, 0>) -> Vector2<f64> {
                Vector2::zeros()
            }
        }
        let ship = Ship::new(0.0, [0.0; 3]).unwrap();
        let (x, v) = (Vector3::new(1.0, 2.0, 0.7), Vector3::new(0.3, -0.2, 0.1));
        assert!((General(ship).explain(&x, &v) - ship.explain(&x, &v)).amax() < 1e-15);
        // the residual of least squares is orthogonal to the columns of g
        let z = Tall.explain(&x, &v);
        let residual = v - Tall.g(&x) * z;
        assert!(Tall.g(&x).tr_mul(&residual).amax() < 1e-14 && residual.amax() > 0.05);
    }
}

mod streams {
    use super::*;
    use rand_xoshiro::rand_core::{Rng, SeedableRng};
    use rand_xoshiro::{SplitMix64, Xoshiro256PlusPlus};

    proptest! {
        #![proptest_config(config(256))]

        #[test]
        fn the_generator_is_xoshiro256_plus_plus(s in prop::array::uniform4(1_u64..)) {
            let mut bytes = [0; 32];
            for (chunk, word) in bytes.chunks_exact_mut(8).zip(s) {
                chunk.copy_from_slice(&word.to_le_bytes());
            }
            let (mut ours, mut theirs) = (Stream::from_state(s), Xoshiro256PlusPlus::from_seed(bytes));
            for _ in 0..100 {
                prop_assert_eq!(ours.next_u64(), theirs.next_u64());
            }
        }

        /// base = mix(mix(mix(seed) ^ run) ^ channel), words mix(base + jφ): SplitMix64 throughout.
        #[test]
        fn a_stream_is_seeded_by_seed_run_and_channel(seed in any::<u64>(), run in any::<u64>()) {
            let mix = |z: u64| SplitMix64::from_seed(z.to_le_bytes()).next_u64();
            for (channel, number) in [(Channel::Measurement, 0), (Channel::Process, 1)] {
                let base = mix(mix(mix(seed) ^ run) ^ number);
                let mut splitter = SplitMix64::from_seed(base.to_le_bytes());
                let words = core::array::from_fn(|_| splitter.next_u64());
                let mut ours = Stream::new(seed, run, channel);
                prop_assert_eq!(ours, Stream::from_state(words));
                let mut theirs = Xoshiro256PlusPlus::seed_from_u64(base);
                for _ in 0..20 {
                    prop_assert_eq!(ours.next_u64(), theirs.next_u64());
                }
            }
        }

        #[test]
        fn numbers_are_made_from_53_bits(seed in any::<u64>()) {
            let mut ours = Stream::new(seed, 0, Channel::Measurement);
            let mut bits = ours;
            let two_53 = 9_007_199_254_740_992.0;
            let mut number = || (bits.next_u64() >> 11) as f64;
            prop_assert_eq!(ours.uniform(), number() / two_53);
            let (u1, u2) = ((number() + 1.0) / two_53, number() / two_53);
            let (radius, angle) = ((-2.0 * u1.ln()).sqrt(), core::f64::consts::TAU * u2);
            let (a, b) = ours.normal_pair();
            prop_assert!((a - radius * angle.cos()).abs() < 1e-14 * radius.max(1.0));
            prop_assert!((b - radius * angle.sin()).abs() < 1e-14 * radius.max(1.0));
            // one alone is the first of a pair
            let mut again = Stream::new(seed, 0, Channel::Measurement);
            again.uniform();
            prop_assert_eq!(again.normal(), a);
            prop_assert_eq!(again, ours);
        }
    }

    const DRAWS: u32 = if cfg!(debug_assertions) { 200_000 } else { 2_000_000 };

    /// Means of the powers x, x², x³, x⁴.
    fn moments(mut draw: impl FnMut() -> f64) -> [f64; 4] {
        let mut sums = [0.0; 4];
        for _ in 0..DRAWS {
            let x = draw();
            for (power, sum) in (1..).zip(&mut sums) {
                *sum += x.powi(power) / f64::from(DRAWS);
            }
        }
        sums
    }

    /// Sample moments lie within five standard deviations of the distribution's.
    fn matches(ours: [f64; 4], exact: [f64; 8]) {
        for i in 0..4 {
            let deviation = ((exact[2 * i + 1] - exact[i].powi(2)) / f64::from(DRAWS)).sqrt();
            let off = (ours[i] - exact[i]).abs();
            assert!(off <= 5.0 * deviation, "moment {}: {} for {}", i + 1, ours[i], exact[i]);
        }
    }

    #[test]
    fn moments_of_the_distributions() {
        let mut stream = Stream::new(11, 0, Channel::Measurement);
        let uniform = core::array::from_fn(|i| 1.0 / (i as f64 + 2.0));
        matches(moments(|| stream.uniform()), uniform);
        let normal = [0.0, 1.0, 0.0, 3.0, 0.0, 15.0, 0.0, 105.0];
        matches(moments(|| stream.normal()), normal);
        matches(moments(|| stream.normal_pair().1), normal);
        // the members of a pair, and the streams of two runs and two channels, are uncorrelated
        let bound = 5.0 / f64::from(DRAWS).sqrt();
        let [pair, ..] = moments(|| {
            let (a, b) = stream.normal_pair();
            a * b
        });
        assert!(pair.abs() < bound, "{pair}");
        for (run, channel) in [(1, Channel::Measurement), (0, Channel::Process)] {
            let (mut first, mut second) =
                (Stream::new(1, 0, Channel::Measurement), Stream::new(1, run, channel));
            let [product, ..] = moments(|| first.normal() * second.normal());
            assert!(product.abs() < bound, "run {run}, {channel:?}: {product}");
        }
    }

    #[test]
    fn noise_signals() {
        let mut stream = Stream::new(1, 2, Channel::Measurement);
        let mut twin = stream;
        let quiet = Noise { draw: Draw::None, hold: 1, sines: &[] };
        let uniform = Noise { draw: Draw::Uniform { low: -0.5, high: 1.5 }, ..quiet };
        let normal = Noise { draw: Draw::Normal { mean: 0.2, std: 3.0 }, ..quiet };
        assert_eq!(quiet.fresh(&mut stream, 0), 0.0);
        assert_eq!(uniform.fresh(&mut stream, 0), -0.5 + 2.0 * twin.uniform());
        assert_eq!(normal.fresh(&mut stream, 0), 0.2 + 3.0 * twin.normal());
        assert_eq!(stream, twin);
        let recorded = Noise { draw: Draw::Samples(&[1.0, 2.0]), hold: 3, sines: &[] };
        let values: Vec<f64> = (0..8).map(|k| recorded.fresh(&mut stream, k)).collect();
        assert_eq!(values, [1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 0.0, 0.0]);
        let sines = [
            Sine { amplitude: 2.0, omega: 3.0, phase: 0.1 },
            Sine { amplitude: 0.5, omega: 7.0, phase: -1.0 },
        ];
        let tones = Noise { sines: &sines, ..quiet };
        let (t, expected) = (0.3, 2.0 * 1.0_f64.sin() + 0.5 * 1.1_f64.sin());
        assert!((tones.sines(t) - expected).abs() < 1e-14);
    }

    /// (1 − ρz⁻¹ cos θ)/(1 − 2ρz⁻¹ cos θ + ρ²z⁻²) has the impulse response ρᵏ cos kθ; two such
    /// sections in a row convolve theirs.
    #[test]
    fn second_order_sections_have_their_impulse_response() {
        let section = |rho: f64, theta: f64| {
            [1.0, -rho * theta.cos(), 0.0, -2.0 * rho * theta.cos(), rho * rho]
        };
        let response = |rho: f64, theta: f64, k: i32| rho.powi(k) * (f64::from(k) * theta).cos();
        let (first, second) = ((0.9, 0.4), (0.7, 1.3));
        let mut one = SecondOrderSections::new([section(first.0, first.1)]);
        let mut two =
            SecondOrderSections::new([section(first.0, first.1), section(second.0, second.1)]);
        for k in 0..40 {
            let input = if k == 0 { 1.0 } else { 0.0 };
            assert!((one.filter(input) - response(first.0, first.1, k)).abs() < 1e-13);
            let convolved: f64 = (0..=k)
                .map(|j| response(first.0, first.1, j) * response(second.0, second.1, k - j))
                .sum();
            assert!((two.filter(input) - convolved).abs() < 1e-13, "k = {k}");
        }
    }
}

mod metrics {
    use super::*;

    /// Keeps every sample of a run.
    #[derive(Default)]
    struct Recorder {
        t: Vec<f64>,
        error: Vec<[f64; 2]>,
        memory: Vec<[f64; 3]>,
        y: Vec<f64>,
    }

    impl Probe<f64> for Recorder {
        fn sample<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
            &mut self,
            sample: &Sample<'_, f64, X, Z, Y>,
        ) {
            assert_eq!(sample.k, self.t.len() as u64);
            self.t.push(sample.t);
            self.error.push(core::array::from_fn(|i| sample.estimate[i] - sample.truth[i]));
            let mut memory = [0.0; 3];
            sample.z.write(&mut memory);
            self.memory.push(memory);
            sample.y.each(&mut |y| self.y.push(y));
        }
    }

    fn experiment(
        sines: &[Sine<f64>],
    ) -> Experiment<'_, f64, SanfelicePraly<f64>, StochasticApproximation<f64>> {
        Experiment {
            plant: SanfelicePraly::new(-0.5, 0.1).unwrap(),
            plant_scheme: PlantScheme::Deterministic(Integrator::Rk4),
            substeps: 3,
            schedule: StochasticApproximation::new(0.5, 0.05, 300.0, 0.8).unwrap(),
            plant_schedule: None,
            noise: Noise { draw: Draw::Normal { mean: 0.0, std: 0.05 }, hold: 4, sines },
            steps: 900,
            seed: 9,
        }
    }

    fn observer()
    -> Discretised<StandardObserver<f64, AdaptiveGain<f64>, SanfelicePraly<f64>, 2>, Euler> {
        let gain = AdaptiveGain::new(10.0, 0.0025, 0.183, 2).unwrap();
        let model = SanfelicePraly::new(-0.5, 0.1).unwrap();
        Discretised { law: StandardObserver::new([2.0, 2.0], gain, model).unwrap(), scheme: Euler }
    }

    /// Streaming metrics against the same quantities from a stored run.
    #[test]
    fn streaming_metrics_are_those_of_the_stored_run() {
        let sines = [Sine { amplitude: 0.02, omega: 9.0, phase: 0.4 }];
        let run = experiment(&sines);
        let (x0, z0) = (Vector2::new(1.0, 0.5), (Vector2::new(0.0, 0.0), 1.0));
        let mut stored = Recorder::default();
        run.sampled(&observer(), |u| *u, 7, x0, z0, &mut stored);
        let windows = [Window { from: 0, to: 901 }, Window { from: 500, to: 700 }];
        let (mut moments, mut peak) = ([Moments::default(); 6], [0.0; 3]);
        let mut counts = vec![0; LogHistogram::BINS];
        let mut probe = RunMetrics {
            windows: &windows,
            signals: 3,
            moments: &mut moments,
            peak: &mut peak,
            settling: Some(SettlingTime::new(0.2)),
            histogram: Some((windows[1], LogHistogram::new(&mut counts))),
        };
        run.sampled(&observer(), |u| *u, 7, x0, z0, &mut probe);
        let settling = probe.settling.unwrap().time();

        assert_eq!((stored.t.len(), stored.y.len()), (901, 901));
        for (w, range) in [(0, 0..901), (1, 500..700)] {
            for signal in 0..3 {
                let value = |k: usize| match signal {
                    2 => stored.memory[k][2],
                    _ => stored.error[k][signal],
                };
                let count = range.len() as f64;
                let mean = range.clone().map(value).sum::<f64>() / count;
                let square = range.clone().map(|k| value(k).powi(2)).sum::<f64>() / count;
                let largest = range.clone().map(|k| value(k).abs()).fold(0.0, f64::max);
                let ours = moments[3 * w + signal];
                assert!(close(ours.mean(), mean, 1e-12) && close(ours.rms(), square.sqrt(), 1e-12));
                assert_eq!(ours.max(), largest);
            }
        }
        for i in 0..3 {
            assert_eq!(peak[i], stored.memory.iter().map(|z| z[i].abs()).fold(0.0, f64::max));
        }
        let distance = |k: usize| stored.error[k][0].hypot(stored.error[k][1]);
        let last = (0..901).rev().find(|k| distance(*k) >= 0.2).unwrap();
        assert_eq!(settling, stored.t[last]);
        assert!(0 < last && last < 900, "{last}");
        // quantiles of ‖e‖² within a bin, a ratio of 2^(1/32)
        let mut squares: Vec<f64> = (500..700).map(|k| distance(k).powi(2)).collect();
        squares.sort_by(f64::total_cmp);
        assert_eq!(counts.iter().sum::<u64>(), 200);
        let histogram = LogHistogram::new(&mut counts);
        for (q, k) in [(0.1, 19), (0.5, 99), (0.95, 189)] {
            let ratio = histogram.quantile(q) / squares[k];
            assert!((ratio.log2() * 32.0).abs() < 2.0, "quantile {q}: ratio {ratio}");
        }
        // time is the sum of the decreasing steps
        let clock: f64 = (0..900).map(|k| 0.025 * (1.0 + k as f64 / 300.0).powf(-0.8)).sum();
        assert!(close(stored.t[900], clock, 1e-12));
    }

    /// y(k) = x₁(k) + a draw held for four steps + the sine at t(k); runs are independent.
    #[test]
    fn measurements_are_output_plus_noise() {
        let sines = [Sine { amplitude: 0.02, omega: 9.0, phase: 0.4 }];
        let run = experiment(&sines);
        let (x0, z0) = (Vector2::new(1.0, 0.5), (Vector2::new(0.0, 0.0), 1.0));
        let (mut noisy, mut other) = (Recorder::default(), Recorder::default());
        run.sampled(&observer(), |u| *u, 7, x0, z0, &mut noisy);
        run.sampled(&observer(), |u| *u, 8, x0, z0, &mut other);
        assert_ne!(noisy.y, other.y);
        let mut stream = Stream::new(9, 7, Channel::Measurement);
        let mut held = 0.0;
        for (k, y) in noisy.y.iter().enumerate() {
            if k % 4 == 0 {
                held = 0.05 * stream.normal();
            }
            let x1 = noisy.memory[k][0] - noisy.error[k][0];
            let sine = 0.02 * (9.0 * noisy.t[k] + 0.4).sin();
            assert!((y - (x1 + held + sine)).abs() < 1e-14, "k = {k}");
        }
    }

    /// A run that leaves 10¹² stops there, and one with a NaN start at once.
    #[test]
    fn a_diverging_run_stops() {
        let gain = ConstantGain::new(100.0).unwrap();
        let law = StandardObserver::new([2.0, 2.0], gain, Unknown).unwrap();
        let observer = Discretised { law, scheme: Euler };
        let run = Experiment {
            plant: Lee,
            plant_scheme: PlantScheme::Held,
            substeps: 1,
            schedule: FixedStep::new(0.05).unwrap(), // ℓT = 5
            plant_schedule: None,
            noise: Noise { draw: Draw::None, hold: 1, sines: &[] },
            steps: 1_000,
            seed: 0,
        };
        let mut largest = 0.0;
        struct Largest<'a>(&'a mut f64);
        impl Probe<f64> for Largest<'_> {
            fn sample<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
                &mut self,
                sample: &Sample<'_, f64, X, Z, Y>,
            ) {
                sample.z.visit(&mut |z| *self.0 = self.0.max(z.abs()));
            }
        }
        let start = (Vector2::new(1.0, 0.0), ());
        let probe = &mut Largest(&mut largest);
        let end = run.sampled(&observer, |u| *u, 0, Vector2::zeros(), start, probe);
        let stopped = end.diverged_at.unwrap();
        assert!((3..50).contains(&stopped), "{stopped}");
        assert!(largest <= 1e12 && end.z.0.amax() > 1e12);
        let nan = Vector2::new(f64::NAN, 0.0);
        let probe = &mut Largest(&mut largest);
        let end = run.sampled(&observer, |u| *u, 0, nan, start, probe);
        assert_eq!(end.diverged_at, Some(0));
        // an interrupted run is not a diverged one
        struct Stop(u64);
        impl Probe<f64> for Stop {
            fn sample<X: Memory<f64>, Z: Memory<f64>, Y: Measurement<f64>>(
                &mut self,
                sample: &Sample<'_, f64, X, Z, Y>,
            ) {
                self.0 = sample.k;
            }
            fn interrupted(&mut self, k: u64) -> bool {
                k == 1
            }
        }
        let mut stop = Stop(0);
        let end = run.sampled(&observer, |u| *u, 0, Vector2::zeros(), start, &mut stop);
        assert_eq!((stop.0, end.diverged_at), (1, None));
    }
}
