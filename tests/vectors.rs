//! Laws over a record against the same laws one operation at a time, which no compiler can make vectors
//! of. Made for `cargo test --release`: a fault of LLVM's vectoriser (docs/llvm-slp) shows there alone.

#![allow(clippy::float_cmp)] // equal bits are meant

use hgo_rs::observer::BogackiShampine;
use hgo_rs::polynomial::low_power_coefficients_from_poles;
use hgo_rs::prelude::*;
use std::hint::black_box;

/// Samples of a record.
const ROWS: usize = 40;

/// Samples that are copied as they are taken.
struct Samples<'a> {
    given: &'a [f64],
    kept: &'a mut [f64],
}

impl Samples<'_> {
    #[inline(always)]
    fn take(&mut self, k: usize, p: usize) -> &[f64] {
        let kept = &mut self.kept[k * p..(k + 1) * p];
        kept.iter_mut().zip(&self.given[k * p..(k + 1) * p]).for_each(|(kept, y)| *kept = *y);
        kept
    }
}

/// What is given of a record, and what is written.
struct Block<'a> {
    t: &'a [f64],
    dt: &'a [f64],
    y: Samples<'a>,
    u: &'a [f64],
    memory: &'a mut [f64],
    innovation: &'a mut [f64],
    status: &'a mut [u8],
}

#[inline(always)]
fn larger(largest: f64, value: f64) -> f64 {
    if value.abs() > largest { value.abs() } else { largest }
}

/// A loop over a record, as a program may have it.
#[inline(never)]
fn over_record<O>(observer: &O, memory: &mut [f64], block: Block<'_>) -> f64
where
    O: Observer<f64>,
    O::Input: Memory<f64>,
{
    let Block { t, dt, y: mut samples, u, memory: rows, innovation, status } = block;
    let (p, m) = (O::Measurement::LEN, O::State::LEN);
    let q = u.len().checked_div(t.len()).unwrap_or(0);
    let mut z = O::State::read(memory);
    let (mut largest, mut spoilt) = (O::State::zero(), O::State::zero());
    let made = rows.chunks_exact_mut(m).zip(status);
    for (k, (t, (row, status))) in t.iter().zip(made).enumerate() {
        let y = O::Measurement::read(samples.take(k, p));
        let u = O::Input::read(u.get(k * q..).unwrap_or(&[]));
        if let Some(row) = innovation.get_mut(k * p..(k + 1) * p) {
            observer.innovation(*t, &z, &y, &u).write(row);
        }
        let corrected = observer.correct(&mut z, &y, *t);
        z.write(row);
        largest = largest.zip(&z, larger);
        spoilt = spoilt.zip(&z, |sum, z| sum + 0.0 * z);
        let moved = dt.get(k).map(|dt| observer.advance(&mut z, &y, &u, *t, *dt));
        let undefined = moved == Some(Status::ModelUndefined);
        *status = if undefined { Status::ModelUndefined } else { corrected } as u8;
    }
    z.write(memory);
    let mut most = 0.0;
    largest.visit(&mut |z| most = larger(most, z));
    spoilt.visit(&mut |sum| most += sum);
    most
}

/// Bogacki and Shampine's step of the low-power law (5) without a model, each operation by itself.
fn by_operations(ell: f64, alpha: &[f64], beta: &[f64], z: &[f64], y: f64, dt: f64) -> Vec<f64> {
    let (b, n) = (black_box::<f64>, alpha.len());
    let rate = |z: &[f64]| -> Vec<f64> {
        let e = |i: usize| match i {
            0 if y.is_finite() => b(y - z[0]),
            0 => 0.0,
            _ => b(z[n + i - 1] - z[i]),
        };
        let sum = |above: Option<&f64>, moved: f64| above.map_or(moved, |above| b(above + moved));
        let x = (0..n).map(|i| {
            let above = if i + 1 < n { z.get(n + i) } else { None };
            sum(above, b(b(alpha[i] * ell) * e(i)))
        });
        let eta = (0..n - 1).map(|i| {
            let above = if i + 2 < n { z.get(n + i + 1) } else { None };
            sum(above, b(b(beta[i] * b(ell * ell)) * e(i)))
        });
        x.chain(eta).collect()
    };
    let plus = |z: &[f64], h: f64, rate: &[f64]| -> Vec<f64> {
        z.iter().zip(rate).map(|(z, rate)| b(z + b(h * rate))).collect()
    };
    let k1 = rate(z);
    let k2 = rate(&plus(z, b(0.5 * dt), &k1));
    let k3 = rate(&plus(z, b(0.75 * dt), &k2));
    let two: Vec<f64> = k1.iter().zip(&k2).map(|(a, c)| b(b(2.0 * a) + b(3.0 * c))).collect();
    plus(z, b(dt / 9.0), &plus(&two, 4.0, &k3))
}

fn compare<const N: usize, const R: usize>() {
    let poles = core::array::from_fn::<_, R, _>(|i| (-1.0 - i as f64 / R as f64, 0.0));
    let (alpha, beta) = low_power_coefficients_from_poles::<f64, N, R>(poles).unwrap();
    let ell = 2.0;
    let gain = ConstantGain::new(ell).unwrap();
    let law = LowPowerObserver::<f64, _, _, N>::new(alpha, beta, gain, Unknown, NoSaturation);
    let observer = Discretised { law: law.unwrap(), scheme: BogackiShampine };
    let y: Vec<f64> = (0..ROWS)
        .map(|k| if (7..10).contains(&k) { f64::NAN } else { (0.7 * k as f64).sin() })
        .collect();
    let dt: Vec<f64> = (0..ROWS).map(|k| 1e-3 * (1.0 + 0.3 * (k as f64).cos())).collect();
    let t: Vec<f64> = (0..ROWS).map(|k| dt[..k].iter().sum()).collect();
    let (mut kept, mut innovation, mut status) = ([0.0; ROWS], [0.0; ROWS], [0; ROWS]);
    let mut rows = vec![0.0; ROWS * R];
    let block = Block {
        t: &t,
        dt: &dt,
        y: Samples { given: &y, kept: &mut kept },
        u: &[],
        memory: &mut rows,
        innovation: &mut innovation,
        status: &mut status,
    };
    black_box(over_record(&observer, &mut vec![0.0; R], block));
    let mut z = vec![0.0; R];
    for (k, row) in rows.chunks_exact(R).enumerate() {
        assert_eq!(row, z, "order {N}, sample {k}: see docs/llvm-slp");
        z = by_operations(ell, &alpha, &beta, &z, y[k], dt[k]);
    }
}

#[test]
fn a_record_has_the_bits_of_single_operations() {
    compare::<2, 3>();
    compare::<3, 5>();
    compare::<4, 7>();
    compare::<5, 9>();
    compare::<6, 11>();
    compare::<7, 13>();
    compare::<8, 15>();
}
