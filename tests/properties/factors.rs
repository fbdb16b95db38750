//! Covariances as L D Lᵀ: positive and right, whatever comes, in single precision too.

use super::config;
use hgo_rs::Scalar;
use hgo_rs::factor::Factor;
use hgo_rs::memory::Memory;
use hgo_rs::model::{Model, last};
use hgo_rs::observer::Observer;
use hgo_rs::observers::SampledEkf;
use nalgebra::{SMatrix, SVector, Vector2};
use proptest::prelude::*;

const N: usize = 3;

/// −a sin x₁ − b x₂ |x₂| − c x₃, random coefficients.
#[derive(Clone, Copy, Debug)]
struct Random([f64; 3]);

impl<T: Scalar> Model<T, N, 0> for Random {
    fn f_hat(&self, _: T, x: &SVector<T, N>, _: &SVector<T, 0>) -> SVector<T, N> {
        let [a, b, c] = self.0.map(T::from_f64);
        last(-(a * x[0].sin()) - b * x[1] * x[1].abs() - c * x[2])
    }
}

fn positive<T: Scalar>(p: &Factor<T, N>) -> bool {
    (0..N).all(|i| p.d(i).is_finite() && p.d(i) >= T::ZERO)
}

/// A run over samples of which some are missing, some periods long: whether D stays positive, and the
/// largest covariances and gains against those of the textbook's form in double precision.
fn run<T: Scalar>(model: Random, q: f64, r: f64, p0: f64, periods: &[(f64, bool)]) -> bool {
    let c = T::from_f64;
    let noise = SMatrix::from_fn(|i, j| c(if i == j && i == 2 { q } else { 0.0 }));
    let start = SMatrix::from_fn(|i, j| c(if i == j { p0 } else { 0.0 }));
    let law = SampledEkf::<T, _, N>::new(&noise, [c(r)], &start, [T::ONE], [N], model).unwrap();
    let (mut z, mut t, mut holds) = (law.initial(), 0.0, true);
    let none = hgo_rs::model::no_input();
    for (dt, there) in periods {
        law.predict(&mut z, &none, c(t), c(*dt));
        holds &= positive(&z.law.p);
        t += dt;
        let y = if *there { (0.7 * t).sin() } else { f64::NAN };
        law.correct(&mut z, &SVector::<T, 1>::new(c(y)), c(t));
        holds &= positive(&z.law.p) && z.law.x_hat.iter().all(|x| x.is_finite());
        let p = z.law.p.covariance();
        holds &= (0..N).all(|i| p[(i, i)] >= T::ZERO);
    }
    holds
}

proptest! {
    #![proptest_config(config(200))]

    /// Random models, noises over many decades, gaps, bursts: P is positive in both precisions.
    #[test]
    fn covariances_stay_positive(
        of in prop::array::uniform3(-2.0..2.0_f64),
        (q, r, p0) in (-6.0..4.0_f64, -10.0..2.0_f64, -4.0..4.0_f64),
        periods in prop::collection::vec((-4.0..0.0_f64, prop::bool::weighted(0.8)), 1..80),
    ) {
        let ten = |x: f64| 10.0_f64.powf(x);
        let periods: Vec<_> = periods.into_iter().map(|(dt, there)| (ten(dt), there)).collect();
        let (model, q, r, p0) = (Random(of.map(f64::abs)), ten(q), ten(r), ten(p0));
        prop_assert!(run::<f64>(model, q, r, p0, &periods));
        prop_assert!(run::<f32>(model, q, r, p0, &periods));
    }

    /// The three ways in which a covariance moves, against matrices multiplied out.
    #[test]
    fn they_move_as_matrices_do(
        root in prop::collection::vec(-1.0..1.0_f64, 9),
        w in prop::collection::vec(-1.0..1.0_f64, 9),
        v in prop::array::uniform3(-1.0..1.0_f64),
        (c, r, at) in (0.0..3.0_f64, 0.01..3.0_f64, 0..N),
    ) {
        let root = SMatrix::<f64, N, N>::from_column_slice(&root);
        let p = root * root.transpose() + SMatrix::identity() * 0.1;
        let f = Factor::of("P", &p).unwrap();
        let near = |a: &SMatrix<f64, N, N>, b: &SMatrix<f64, N, N>| (a - b).amax() < 1e-12 * (1.0 + b.amax());
        prop_assert!(near(&f.covariance(), &p));
        let w = SMatrix::<f64, N, N>::from_column_slice(&w) + SMatrix::identity();
        let det = w.column(0).dot(&w.column(1).cross(&w.column(2)));
        prop_assume!(det.abs() > 1e-2);
        let columns = core::array::from_fn(|k| w * SVector::from_fn(|i, _| f.l(i, k)));
        prop_assert!(near(&f.moved(columns).covariance(), &(w * p * w.transpose())));
        let v = SVector::from(v);
        prop_assert!(near(&f.plus_noise(c, v).covariance(), &(p + v * v.transpose() * c)));
        let s = p[(at, at)] + r;
        let k = p.column(at) / s;
        let (after, gains) = f.measured(at, r, 1.0);
        prop_assert!((gains - k).amax() < 1e-12);
        prop_assert!(near(&after.covariance(), &(p - k * k.transpose() * s)));
        let (same, none) = f.measured(at, r, 0.0);
        prop_assert_eq!(same, f);
        prop_assert_eq!(none.amax(), 0.0);
    }
}

/// A gap of 10 s at 0.1 m and 10 m/s: the textbook's P − K C P loses the sign in single precision, L D Lᵀ
/// keeps three digits of the variance that is left.
#[test]
fn a_gap_in_single_precision_leaves_what_is_known() {
    let p = SMatrix::<f32, 2, 2>::new(1e-6, 0.0, 0.0, 100.0);
    let f = Factor::of("P", &p).unwrap();
    let phi = [Vector2::<f32>::new(1.0, 0.0), Vector2::new(10.0, 1.0)];
    let (after, _) = f.moved(phi).measured(0, 1e-6, 1.0);
    let left = f64::from(after.covariance()[(1, 1)]);
    // exactly: 1/(1/100 + 1e2/(2e-6)), by information
    let exact = 1.0 / (0.01 + 100.0 / 2e-6);
    assert!((left / exact - 1.0).abs() < 1e-3, "{left} {exact}");
    let textbook = {
        let p = SMatrix::<f32, 2, 2>::new(1e4 + 1e-6, 1e3, 1e3, 100.0);
        p[(1, 1)] - p[(0, 1)] * p[(0, 1)] / (p[(0, 0)] + 1e-6)
    };
    assert!((f64::from(textbook) / exact - 1.0).abs() > 0.9, "{textbook}");
}

#[test]
fn what_is_no_covariance_is_refused() {
    let of = |a: f64, b: f64, c: f64| Factor::of("Q", &SMatrix::<f64, 2, 2>::new(a, b, b, c));
    assert!(of(1.0, 0.5, 1.0).is_ok() && of(0.0, 0.0, 2.0).is_ok() && of(1.0, 1.0, 1.0).is_ok());
    for (a, b, c) in [(1.0, 2.0, 1.0), (-1.0, 0.0, 1.0), (0.0, 0.5, 1.0), (f64::NAN, 0.0, 1.0)] {
        let error = of(a, b, c).unwrap_err();
        assert_eq!(error.parameter, "Q");
    }
    assert_eq!(of(0.0, 0.0, 2.0).unwrap().d(0), 0.0);
    assert_eq!(<Factor<f64, 4> as Memory<f64>>::LEN, 10);
}

/// Q of a chain over a period, against the integral by a fine sum.
#[test]
fn noise_over_a_period_is_its_integral() {
    let q = SMatrix::<f64, 3, 3>::new(0.3, 0.1, 0.0, 0.1, 0.5, 0.2, 0.0, 0.2, 0.7);
    let tiny = SMatrix::<f64, 3, 3>::identity() * 1e-12;
    let still = Random([0.0; 3]);
    let law = SampledEkf::<f64, _, 3>::new(&q, [1.0], &tiny, [2.0], [3], still).unwrap();
    let (mut z, dt) = (law.initial(), 0.4);
    law.predict(&mut z, &hgo_rs::model::no_input(), 0.0, dt);
    let found = z.law.p.covariance();
    let delta = SMatrix::<f64, 3, 3>::from_diagonal(&SVector::from([1.0, 2.0, 4.0]));
    let q = delta * q * delta * 2.0;
    let mut sum = SMatrix::<f64, 3, 3>::zeros();
    let steps = 20_000;
    for k in 0..steps {
        let s = dt * (f64::from(k) + 0.5) / f64::from(steps);
        let phi = SMatrix::<f64, 3, 3>::new(1.0, s, s * s / 2.0, 0.0, 1.0, s, 0.0, 0.0, 1.0);
        sum += phi * q * phi.transpose() * (dt / f64::from(steps));
    }
    for i in 0..3 {
        for j in 0..3 {
            assert!((found[(i, j)] - sum[(i, j)]).abs() < 1e-8, "{i} {j}");
        }
    }
}
