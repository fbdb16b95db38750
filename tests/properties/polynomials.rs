//! From poles to coefficients and back; what is not Hurwitz is refused.

use super::{close, config};
use hgo_rs::gain::ConstantGain;
use hgo_rs::memory::Memory;
use hgo_rs::model::{Unknown, no_input};
use hgo_rs::observer::ContinuousLaw;
use hgo_rs::observers::{LowPowerObserver, NoSaturation, StandardObserver, equidistant};
use hgo_rs::polynomial::{
    coefficients_from_poles, euler_current_limit, euler_limit, is_hurwitz, low_power_coefficients,
    low_power_coefficients_from_poles, low_power_polynomial, require_low_power_hurwitz,
};
use proptest::prelude::*;

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
        let built = LowPowerObserver::<f64, _, _, N>::new(alpha, beta, gain, Unknown, NoSaturation);
        prop_assert!(built.is_ok(), "n = {N}: {poles:?}: {built:?}");
    }
    Ok(())
}

/// 1 + cλ reaches the unit circle at c = −2 Re λ/|λ|².
fn euler_limit_of(poles: &[Complex]) -> f64 {
    poles.iter().map(|(re, im)| -2.0 * re / (re * re + im * im)).fold(f64::INFINITY, f64::min)
}

#[test]
fn the_limit_of_euler_at_multiple_poles() {
    assert!(close(euler_limit(&[2.0, 1.0]), 2.0, 1e-6));
    let twelve = coefficients_from_poles([(-1.0, 0.0); 12]).unwrap();
    assert!(close(euler_limit(&twelve), 2.0, 0.07), "{}", euler_limit(&twelve));
    assert_eq!(euler_limit(&[1.0, -1.0]), 0.0);
    assert_eq!(euler_limit::<f64>(&[]), 0.0);
    assert_eq!(euler_limit(&[1.0; 24]), 0.0);
}

proptest! {
    #![proptest_config(config(128))]

    #[test]
    fn the_limit_of_euler_is_where_a_pole_meets_the_circle(drawn in drawn(2.0)) {
        let poles = poles::<5>(&drawn);
        let limit = euler_limit(&coefficients_from_poles(poles).unwrap());
        prop_assert!(close(limit, euler_limit_of(&poles), 2e-3), "{} {:?}", limit, poles);
    }

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
        let largest = |a: &usize, b: &usize| m[*a][column].abs().total_cmp(&m[*b][column].abs());
        let pivot = (column..N).max_by(largest).unwrap();
        if pivot != column {
            m.swap(pivot, column);
            det = -det;
        }
        det *= m[column][column];
        for row in column + 1..N {
            let factor = m[row][column] / m[column][column];
            let above = m[column];
            for (entry, above) in m[row].iter_mut().zip(above).skip(column) {
                *entry -= factor * above;
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

#[test]
fn a_prediction_and_a_correction_have_a_limit_of_their_own() {
    // s² + (k₁ + ck₂)s + k₂ is 0 at s = −2/c where k₂c² + 2k₁c = 4
    for [k1, k2] in [[3.0_f64, 2.0], [2.0, 1.0], [1.0, 10.0]] {
        let by_hand = ((k1 * k1 + 4.0 * k2).sqrt() - k1) / k2;
        assert!(close(euler_current_limit(&[k1, k2], &[]), by_hand, 1e-6), "{k1}, {k2}");
    }
    // of a law that decays by itself, (1 − cd)(1 − c(p − d)): 1 again at c = p/(d(p − d))
    for [p, d] in [[3.0_f64, 1.0], [5.0, 2.0]] {
        assert!(close(euler_current_limit(&[p], &[d]), p / (d * (p - d)), 1e-6), "{p}, {d}");
    }
    assert_eq!(euler_current_limit(&[1.0, -1.0], &[]), 0.0);
    assert_eq!(euler_current_limit::<f64>(&[], &[]), 0.0);
}

#[test]
fn usual_poles_are_equidistant() {
    for count in [1, 2, 3, 5, 12] {
        let mut poles = vec![(0.0, 0.0); count];
        equidistant(&mut poles);
        for (i, (re, im)) in poles.into_iter().enumerate() {
            let wanted = -1.0 - i as f64 / (count as f64 - 1.0).max(1.0);
            assert!((re - wanted).abs() < 1e-15 && im == 0.0, "{count}, {i}: {re}");
        }
    }
}

#[test]
fn a_last_block_that_stands_still_is_not_low_power_stable() {
    let refused = require_low_power_hurwitz(&[3.0, 0.0], &[2.0]).unwrap_err();
    assert_eq!((refused.parameter, refused.value), ("alpha", 0.0));
    require_low_power_hurwitz(&[3.0, 1e-9], &[2.0]).unwrap();
}
