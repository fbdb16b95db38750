//! Floor 0. Power spectral density by Welch's method: the mean of periodograms of halves that overlap, each less
//! its mean and under Hann's window (IEEE Trans. Audio Electroacoust. 15, 1967).

use std::f64::consts::PI;

/// One-sided density [unit²/Hz] at the frequencies k/(length dt), k = 0 to length/2, of stretches of `length`
/// samples, a power of two; of the stretches in which all samples are finite, 0 where there is none.
pub fn density(values: &[f64], length: usize, dt: f64) -> Vec<f64> {
    let window = |i: usize| 0.5 - 0.5 * (2.0 * PI * i as f64 / length as f64).cos();
    let weight: f64 = (0..length).map(|i| window(i).powi(2)).sum();
    let (mut sum, mut stretches) = (vec![0.0; length / 2 + 1], 0.0);
    for some in values.windows(length).step_by((length / 2).max(1)) {
        if !some.iter().all(|value| value.is_finite()) {
            continue;
        }
        let mean = some.iter().sum::<f64>() / length as f64;
        let mut parts: Vec<(f64, f64)> =
            some.iter().enumerate().map(|(i, value)| (window(i) * (value - mean), 0.0)).collect();
        transform(&mut parts);
        for (k, (slot, (re, im))) in sum.iter_mut().zip(&parts).enumerate() {
            let both = if k == 0 || k == length / 2 { 1.0 } else { 2.0 };
            *slot += both * (re * re + im * im) * dt / weight;
        }
        stretches += 1.0;
    }
    sum.iter().map(|sum| if stretches > 0.0 { sum / stretches } else { 0.0 }).collect()
}

/// The discrete Fourier transform of a power of two of numbers, in place (Cooley and Tukey).
fn transform(x: &mut [(f64, f64)]) {
    let n = x.len();
    let mut j = 0;
    for i in 1..n {
        let mut bit = n >> 1;
        while j & bit != 0 {
            j ^= bit;
            bit >>= 1;
        }
        j |= bit;
        if i < j {
            x.swap(i, j);
        }
    }
    let mut size = 2;
    while size <= n {
        let turns: Vec<(f64, f64)> = (0..size / 2)
            .map(|k| -2.0 * PI * k as f64 / size as f64)
            .map(|angle| (angle.cos(), angle.sin()))
            .collect();
        for block in x.chunks_exact_mut(size) {
            let (low, high) = block.split_at_mut(size / 2);
            for ((a, b), (cos, sin)) in low.iter_mut().zip(high).zip(&turns) {
                let turned = (b.0 * cos - b.1 * sin, b.0 * sin + b.1 * cos);
                (*a, *b) = ((a.0 + turned.0, a.1 + turned.1), (a.0 - turned.0, a.1 - turned.1));
            }
        }
        size *= 2;
    }
}
