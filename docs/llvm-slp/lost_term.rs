//! Terms of a sum are lost at `opt-level = 3`: rustc 1.95 (LLVM 22), x86-64 with SSE2.
//!
//! `record` and `by_operations` do the same operations in the same order, so that their bits are equal.

use std::hint::black_box as b;

const N: usize = 4;
const L: usize = 2 * N;
const ROWS: usize = 20;
const ALPHA: f64 = 3.0;
const BETA: f64 = 2.5;

type Z = [f64; L]; // the last entry is not used

#[inline(always)]
fn rate(law: &[[f64; N]; 2], z: &Z, y: f64) -> Z {
    let mut out = [0.0; L];
    let e1 = if y.is_finite() { y - z[0] } else { 0.0 };
    let e = |i: usize| if i == 0 { e1 } else { z[N + i - 1] - z[i] };
    for i in 0..N {
        // -0.0 + x is x: the last of these sums is a product, and the vector [+, +, +, *]
        let above = if i + 1 < N { z[N + i] } else { -0.0 };
        out[i] = above + law[0][i] * e(i);
    }
    for i in 0..N - 1 {
        let above = if i + 2 < N { z[N + i + 1] } else { -0.0 };
        out[N + i] = above + law[1][i] * e(i);
    }
    out
}

#[inline(always)]
fn plus(z: &Z, h: f64, rate: &Z) -> Z {
    let mut moved = [0.0; L];
    for i in 0..L {
        moved[i] = z[i] + h * rate[i];
    }
    moved[L - 1] = 0.0;
    moved
}

#[inline(always)]
fn step(law: &[[f64; N]; 2], z: &Z, y: f64, h: f64) -> Z {
    let k1 = rate(law, z, y);
    let k2 = rate(law, &plus(z, 0.5 * h, &k1), y);
    let k3 = rate(law, &plus(z, 0.75 * h, &k2), y);
    let mut sum = [0.0; L];
    for i in 0..L {
        sum[i] = 2.0 * k1[i] + 3.0 * k2[i]; // with k1[i] + k1[i] for 2.0 * k1[i] nothing is lost
    }
    plus(z, h / 9.0, &plus(&sum, 4.0, &k3))
}

#[inline(never)]
fn record(law: &[[f64; N]; 2], given: &[f64], steps: usize, rows: &mut [f64], status: &[u8]) {
    let mut z = [0.0; L];
    for (k, (row, _)) in rows.chunks_exact_mut(L - 1).zip(status).enumerate() {
        let y = given[k];
        for (entry, z) in row.iter_mut().zip(&z) {
            *entry = *z;
        }
        if k < steps {
            z = step(law, &z, y, 1e-3);
        }
    }
}

/// The step, with every result through memory.
fn by_operations(z: &Z, y: f64, h: f64) -> Z {
    let rate = |z: &Z| -> Z {
        let mut out = [0.0; L];
        let e = |i: usize| b(if i == 0 { y } else { z[N + i - 1] } - z[i]);
        for i in 0..N {
            let above = if i + 1 < N { z[N + i] } else { -0.0 };
            out[i] = b(above + b(ALPHA * e(i)));
        }
        for i in 0..N - 1 {
            let above = if i + 2 < N { z[N + i + 1] } else { -0.0 };
            out[N + i] = b(above + b(BETA * e(i)));
        }
        out
    };
    let plus = |z: &Z, h: f64, rate: &Z| -> Z {
        core::array::from_fn(|i| if i + 1 < L { b(z[i] + b(h * rate[i])) } else { 0.0 })
    };
    let k1 = rate(z);
    let k2 = rate(&plus(z, 0.5 * h, &k1));
    let k3 = rate(&plus(z, 0.75 * h, &k2));
    let sum: Z = core::array::from_fn(|i| b(b(2.0 * k1[i]) + b(3.0 * k2[i])));
    plus(z, h / 9.0, &plus(&sum, 4.0, &k3))
}

fn main() {
    let law = b([[ALPHA; N], [BETA; N]]);
    let y: Vec<f64> = (0..ROWS).map(|k| (0.7 * k as f64).sin()).collect();
    let (mut rows, status) = (vec![0.0_f64; ROWS * (L - 1)], vec![0; ROWS]);
    record(&law, &y, y.len(), &mut rows, &status);
    let (mut z, mut lost) = ([0.0_f64; L], 0);
    for (k, row) in rows.chunks_exact(L - 1).enumerate() {
        for (i, (ours, z)) in row.iter().zip(&z).enumerate() {
            if ours.to_bits() != z.to_bits() {
                lost += 1;
                if lost == 1 {
                    println!("row {k}, entry {i}: {ours:e} instead of {z:e}");
                }
            }
        }
        z = by_operations(&z, y[k], 1e-3);
    }
    println!("{lost} of {} values are wrong", rows.len());
    std::process::exit(i32::from(lost > 0));
}
