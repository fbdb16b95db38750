//! Placed eigenvalues: the characteristic polynomial of one step, computed from the step itself.

use hgo_rs::gain::ConstantGain;
use hgo_rs::injection::{Injected, Placed, Placement};
use hgo_rs::memory::Memory;
use hgo_rs::model::{Unknown, no_input};
use hgo_rs::observer::{Discretised, Observer};
use hgo_rs::observers::{HardClip, LowPower, NoSaturation, StandardObserver};
use hgo_rs::polynomial::{coefficients_from_poles, low_power_coefficients_from_poles, roots};
use hgo_rs::{DesignError, Scalar};
use nalgebra::SVector;

const STEPS: [f64; 6] = [1e-3, 0.1, 1.0, 3.0, 10.0, 100.0];
const ELL: f64 = 7.0;

/// One step from each unit memory, y = 0, in coordinates scaled by `powers` of dt.
fn matrix<T, L>(law: L, at: Placement, dt: f64, powers: &[usize]) -> Vec<Vec<f64>>
where
    T: Scalar,
    L: Injected<T, Input = SVector<T, 0>>,
{
    let scheme = Placed::new(&law, at).unwrap();
    let observer = Discretised { law, scheme }.prepared(T::from_f64(dt));
    let len = L::State::LEN;
    let column = |j: usize| {
        let mut values = vec![T::ZERO; len];
        values[j] = T::ONE;
        let mut z = L::State::read(&values);
        observer.step(&mut z, &T::ZERO, &no_input(), T::ZERO, T::from_f64(dt));
        z.write(&mut values);
        let power = |i: usize| dt.powi(i32::try_from(powers[i]).unwrap());
        values.iter().enumerate().map(|(i, z)| z.to_f64() * power(i) / power(j)).collect()
    };
    (0..len).map(column).collect() // transposed, which changes no eigenvalue
}

/// By Faddeev and LeVerrier: the trailing coefficients of det(z − A).
fn characteristic(a: &[Vec<f64>]) -> Vec<f64> {
    let n = a.len();
    let (mut m, mut out) = (vec![vec![0.0; n]; n], Vec::new());
    let mut last = 1.0;
    for k in 1..=n {
        for (i, row) in m.iter_mut().enumerate() {
            row[i] += last;
        }
        let product: Vec<Vec<f64>> = (0..n)
            .map(|i| (0..n).map(|j| (0..n).map(|l| a[i][l] * m[l][j]).sum()).collect())
            .collect();
        last = -(0..n).map(|i| product[i][i]).sum::<f64>() / k as f64;
        m = product;
        out.push(last);
    }
    out
}

/// Trailing coefficients of Π(z − z(λ)).
fn wanted(poles: &[f64], at: Placement, dt: f64) -> Vec<f64> {
    let mut p = vec![1.0];
    for pole in poles {
        let h = pole * dt;
        let z = if at == Placement::Exact { h.exp() } else { (2.0 + h) / (2.0 - h) };
        let above = p.clone();
        p.push(0.0);
        for (slot, c) in p[1..].iter_mut().zip(above) {
            *slot -= z * c;
        }
    }
    p.split_off(1)
}

fn off(found: &[f64], wanted: &[f64]) -> f64 {
    let largest = wanted.iter().fold(1.0_f64, |largest, c| largest.max(c.abs()));
    found.iter().zip(wanted).fold(0.0, |off, (a, b)| (a - b).abs().max(off)) / largest
}

fn spread<const N: usize>() -> [f64; N] {
    core::array::from_fn(|i| -1.0 - i as f64 / (N as f64 - 1.0).max(1.0))
}

fn standard<T: Scalar, const N: usize>(tolerance: f64) {
    let poles = spread::<N>();
    let k = coefficients_from_poles(poles.map(|p| (T::from_f64(p), T::ZERO))).unwrap();
    let gain = ConstantGain::new(T::from_f64(ELL)).unwrap();
    let law = StandardObserver::<T, _, _, N>::new(k, gain, Unknown).unwrap();
    let powers: Vec<usize> = (0..N).collect();
    for at in [Placement::Exact, Placement::Bilinear] {
        for c in STEPS {
            if Placed::new(&law, at).is_err() {
                assert!(at == Placement::Bilinear && N > 6);
                continue;
            }
            let dt = c / ELL;
            let found = characteristic(&matrix::<T, _>(law, at, dt, &powers));
            let off = off(&found, &wanted(&poles.map(|p| p * ELL), at, dt));
            assert!(off < tolerance, "n = {N}, c = {c}, {at:?}: off by {off:e}");
        }
    }
}

#[test]
fn the_standard_law_has_the_eigenvalues_asked_for() {
    standard::<f64, 1>(1e-14);
    standard::<f64, 2>(1e-14);
    standard::<f64, 3>(1e-13);
    standard::<f64, 5>(1e-12);
    standard::<f64, 8>(1e-9);
    standard::<f64, 12>(1e-6);
    standard::<f32, 1>(1e-6);
    standard::<f32, 2>(1e-6);
    standard::<f32, 3>(1e-5);
    standard::<f32, 5>(1e-4);
}

fn low_power<const N: usize, const R: usize>(tolerance: f64) {
    let mut poles = [-2.0; R];
    for (i, pole) in poles.iter_mut().enumerate().take(R - 1) {
        *pole = -1.0 - i as f64 / (R as f64 - 2.0).max(1.0);
    }
    let (alpha, beta) =
        low_power_coefficients_from_poles::<f64, N, R>(poles.map(|p| (p, 0.0))).unwrap();
    let gain = ConstantGain::new(ELL).unwrap();
    let law = LowPower::<f64, _, _, _, N>::new(alpha, beta, gain, Unknown, NoSaturation).unwrap();
    let powers: Vec<usize> = (0..N).chain(1..N).collect();
    for at in [Placement::Exact, Placement::Bilinear] {
        for c in STEPS {
            if Placed::new(&law, at).is_err() {
                assert!(at == Placement::Bilinear && N > 4);
                continue;
            }
            let dt = c / ELL;
            let found = characteristic(&matrix::<f64, _>(law, at, dt, &powers));
            let off = off(&found, &wanted(&poles.map(|p| p * ELL), at, dt));
            assert!(off < tolerance, "n = {N}, c = {c}, {at:?}: off by {off:e}");
        }
    }
}

#[test]
fn the_low_power_law_has_them_too() {
    low_power::<2, 3>(1e-13);
    low_power::<3, 5>(1e-11);
    low_power::<4, 7>(1e-9);
    low_power::<5, 9>(1e-7);
    low_power::<6, 11>(1e-5);
}

/// From far away the law stays bounded at any step, and comes back up to `returns` = ell dt.
fn bounded<const N: usize>(
    alpha: [f64; N],
    beta: [f64; N],
    returns: f64,
) -> Result<(), DesignError> {
    let gain = ConstantGain::new(ELL)?;
    let clip = HardClip::new([2.0; N])?;
    let law = LowPower::<f64, _, _, _, N>::new(alpha, beta, gain, Unknown, clip)?;
    for c in STEPS {
        let dt = c / ELL;
        let scheme = Placed::new(&law, Placement::Exact)?;
        let observer = Discretised { law, scheme }.prepared(dt);
        let mut z = observer.initial();
        z.0.x_hat.fill(1e6);
        z.0.eta.fill(-1e7);
        let steps = 200.0 + 100.0 / c.min(1.0);
        let mut k = 0.0;
        while k < steps {
            observer.step(&mut z, &0.0, &no_input(), k * dt, dt);
            k += 1.0;
        }
        // in units of the levels, 2/dt^i
        let far = if c > returns { 1e3 * (1.0 + dt.powf(1.0 - N as f64)) } else { 1e-3 };
        assert!(z.0.within(far), "n = {N}, c = {c}: {z:?}");
    }
    Ok(())
}

#[test]
fn saturations_leave_it_stable() {
    let find = |poles: [(f64, f64); 7]| low_power_coefficients_from_poles::<f64, 4, 7>(poles);
    let (alpha, beta) = find([1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.0].map(|p| (-p, 0.0))).unwrap();
    bounded(alpha, beta, 2.0).unwrap();
    bounded(crate::catalogue::ALPHA, crate::catalogue::BETA, 1.0).unwrap();
}

#[test]
fn roots_give_their_polynomial_back() {
    let poles: [(f64, f64); 23] = spread::<23>().map(|p| (p, 0.0));
    let trailing: [f64; 23] = coefficients_from_poles(poles).unwrap();
    let mut found = [(0.0, 0.0); 23];
    roots(&trailing, &mut found);
    let mut product = vec![(1.0, 0.0)];
    for (re, im) in found {
        let above = product.clone();
        product.push((0.0, 0.0));
        for (slot, c) in product[1..].iter_mut().zip(above) {
            slot.0 -= c.0 * re - c.1 * im;
            slot.1 -= c.0 * im + c.1 * re;
        }
    }
    for (found, wanted) in product[1..].iter().zip(trailing) {
        assert!((found.0 / wanted - 1.0).abs() < 1e-9, "{found:?} {wanted}");
        assert!((found.1 / wanted).abs() < 1e-9, "{found:?} {wanted}");
    }
}
