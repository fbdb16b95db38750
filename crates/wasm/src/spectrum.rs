//! Floor 0. Power spectral density by Welch's method: the mean of periodograms of halves that overlap, each less
//! its mean and under Hann's window (IEEE Trans. Audio Electroacoust. 15, 1967).

use std::f64::consts::PI;

use rustfft::algorithm::Radix4;
use rustfft::num_complex::Complex;
use rustfft::{Fft, FftDirection};

/// One-sided density [unit²/Hz] at the frequencies k/(length dt), k = 0 to length/2, of stretches of `length`
/// samples, a power of two; of the stretches in which all samples are finite, 0 where there is none.
pub fn density(values: &[f64], length: usize, dt: f64) -> Vec<f64> {
    let window = |i: usize| 0.5 - 0.5 * (2.0 * PI * i as f64 / length as f64).cos();
    let weight: f64 = (0..length).map(|i| window(i).powi(2)).sum();
    let transform = Radix4::new(length, FftDirection::Forward);
    let (mut sum, mut stretches) = (vec![0.0; length / 2 + 1], 0.0);
    for some in values.windows(length).step_by((length / 2).max(1)) {
        if !some.iter().all(|value| value.is_finite()) {
            continue;
        }
        let mean = some.iter().sum::<f64>() / length as f64;
        let mut parts: Vec<Complex<f64>> =
            some.iter().enumerate().map(|(i, value)| (window(i) * (value - mean)).into()).collect();
        transform.process(&mut parts);
        for (k, (slot, part)) in sum.iter_mut().zip(&parts).enumerate() {
            let both = if k == 0 || k == length / 2 { 1.0 } else { 2.0 };
            *slot += both * part.norm_sqr() * dt / weight;
        }
        stretches += 1.0;
    }
    sum.iter().map(|sum| if stretches > 0.0 { sum / stretches } else { 0.0 }).collect()
}
