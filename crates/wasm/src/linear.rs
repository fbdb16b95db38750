//! Floor 3. What an observer does to noise, to signals and to a wrong start, from the matrices of its step at
//! gain 1: the formulae of `hgo_rs.design.response`, with which they are compared.
//!
//! A law without its model is z⁺ = a z + b y, x̂ = c z + d y. Scaled by powers of the gain it depends on ℓT
//! alone, and the columns of its matrices are steps from unit memories.

use crate::record::Running;
use nalgebra::{Complex, DMatrix};

type Matrix = DMatrix<f64>;

/// m p mᵀ.
fn around(m: &Matrix, p: &Matrix) -> Matrix {
    m * p * m.transpose()
}

/// Doublings after which nothing is left of a stable matrix's powers.
const DOUBLINGS: usize = 60;
/// Frequencies looked at before a crossing is refined.
const POINTS: usize = 300;
/// What of a decay is left at its end.
const LEFT: f64 = 1e-9;
/// Samples of a decay at most.
const LONGEST: f64 = 1_048_576.0;

/// The linear part of an observer as it runs, in time of 1/ℓ, state i in units of ℓⁱ⁻¹.
pub struct Linear {
    n: usize,
    a: Matrix,
    b: Matrix,
    c: Matrix,
    d: Matrix,
    ell: f64,
    dt: f64,
}

impl Linear {
    /// Of a law at gain 1, as if its gain were `ell` and its step `dt`.
    pub fn new(unit: &Running<'_>, n: usize, size: usize, ell: f64, dt: f64) -> Self {
        let step = ell * dt;
        let start = |j: usize| (0..size).map(|i| f64::from(u8::from(i == j))).collect::<Vec<_>>();
        let columns: Vec<_> = (0..=size)
            .map(|j| unit.step(&start(j), f64::from(u8::from(j == size)), step))
            .collect();
        Self {
            n,
            a: Matrix::from_fn(size, size, |i, j| columns[j].1[i]),
            b: Matrix::from_fn(size, 1, |i, _| columns[size].1[i]),
            c: Matrix::from_fn(n, size, |i, j| columns[j].0[i]),
            d: Matrix::from_fn(n, 1, |i, _| columns[size].0[i]),
            ell,
            dt,
        }
    }

    fn scale(&self, i: usize) -> f64 {
        (0..i).fold(1.0, |scale, _| scale * self.ell)
    }

    /// Largest magnitude of an eigenvalue of a: below 1 the step is stable.
    pub fn radius(&self) -> f64 {
        let (mut power, mut log, mut weight) = (self.a.clone(), 0.0, 1.0);
        for _ in 0..40 {
            let size = power.amax();
            if size == 0.0 || !size.is_finite() {
                return if size == 0.0 { 0.0 } else { f64::INFINITY };
            }
            log += weight * size.ln();
            power /= size;
            power = &power * &power;
            weight *= 0.5;
        }
        log.exp()
    }

    /// P = a P aᵀ + Q.
    fn lyapunov(&self, q: &Matrix) -> Matrix {
        let (mut p, mut power) = (q.clone(), self.a.clone());
        for _ in 0..DOUBLINGS {
            if power.amax() < 1e-200 {
                break;
            }
            p = &p + around(&power, &p);
            power = &power * &power;
        }
        p
    }

    /// Variance of each estimate per unit variance of white noise of the samples.
    pub fn noise(&self) -> Vec<f64> {
        let p = self.lyapunov(&(&self.b * self.b.transpose()));
        let shown = around(&self.c, &p);
        let of = |i: usize| self.scale(i).powi(2) * (shown[(i, i)] + self.d[i].powi(2));
        (0..self.n).map(of).collect()
    }

    /// Variance of each estimate's error per unit spectral density of white noise in ẋₙ; `lift` (m, n) is the
    /// memory that follows a chain.
    pub fn model(&self, lift: &Matrix) -> Vec<f64> {
        let (n, step) = (self.n, self.ell * self.dt);
        let each = |i: usize| (1..n - i).fold(1.0, |part, j| part * step / j as f64);
        let spread =
            Matrix::from_fn(n, n, |i, j| step * each(i) * each(j) / ((2 * n - 1 - i - j) as f64));
        let shown = around(&self.c, &self.lyapunov(&around(lift, &spread)));
        let factor = (1..2 * n).fold(1.0, |factor, _| factor / self.ell);
        (0..n).map(|i| self.scale(i).powi(2) * shown[(i, i)] * factor).collect()
    }

    /// Response of each estimate to y at a frequency ω/ℓ: c (z − a)⁻¹ b + d. NaN where z is an eigenvalue.
    fn response(&self, w: f64) -> Vec<Complex<f64>> {
        let angle = w * self.ell * self.dt;
        let z = Complex::new(angle.cos(), angle.sin());
        let complex = |matrix: &Matrix| matrix.map(Complex::from);
        let mut free = complex(&-&self.a);
        for i in 0..free.nrows() {
            free[(i, i)] += z;
        }
        match free.lu().solve(&complex(&self.b)) {
            Some(x) => (complex(&self.c) * x + complex(&self.d)).iter().copied().collect(),
            None => vec![Complex::from(f64::NAN); self.n],
        }
    }

    /// The response x̂ᵢ/y at a frequency [rad/s], for each estimate.
    pub fn bode(&self, omega: f64) -> Vec<Complex<f64>> {
        let found = self.response(omega / self.ell);
        found.iter().enumerate().map(|(i, of)| of * self.scale(i)).collect()
    }

    /// Cutoff of each estimate [rad/s]: the first frequency with less than 1/√2 of the derivative's amplitude;
    /// infinite where there is none below the Nyquist frequency.
    pub fn bandwidth(&self) -> Vec<f64> {
        let step = self.ell * self.dt;
        let (slow, highest) = (-self.radius().max(1e-9).ln() / step, std::f64::consts::PI / step);
        // below 1e-10^(1/i), rounding drowns what is left of the derivative
        let least = |i: usize| if i > 0 { 1e-10_f64.powf(1.0 / i as f64) } else { 0.0 };
        let lowest = |i: usize| (0.02 * slow).max(least(i)).min(0.5 * highest);
        let amplitude = |of: Complex<f64>, w: f64, i: usize| {
            of.re.hypot(of.im) / (0..i).fold(1.0, |power, _| power * w)
        };
        let level = 0.5_f64.sqrt();
        let grid =
            |k: usize| lowest(0) * (highest / lowest(0)).powf(k as f64 / (POINTS - 1) as f64);
        let found: Vec<_> = (0..POINTS).map(|k| (grid(k), self.response(grid(k)))).collect();
        let of = |i: usize| {
            let below = |(w, of): &(f64, Vec<Complex<f64>>)| amplitude(of[i], *w, i) < level;
            let first = found.iter().position(|at| at.0 >= lowest(i) && below(at));
            let Some(first) = first else { return f64::INFINITY };
            let (mut under, mut above) = (found[first.max(1) - 1].0.max(lowest(i)), found[first].0);
            for _ in 0..50 {
                let middle = 0.5 * (under + above);
                if amplitude(self.response(middle)[i], middle, i) < level {
                    above = middle;
                } else {
                    under = middle;
                }
            }
            self.ell * above
        };
        (0..self.n).map(of).collect()
    }

    /// Samples after which the error of a wrong start is gone.
    pub fn decay(&self) -> usize {
        let radius = self.radius();
        let long = 32.0 + 1.5 * self.a.nrows() as f64 + LEFT.ln() / radius.ln();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        if radius < 0.3 { 16 } else { long.clamp(1.0, LONGEST).ceil() as usize }
    }

    /// Errors of all estimates, sample by sample, after a start with x̂₁ wrong by 1, a row a sample.
    pub fn errors(&self, samples: usize) -> Vec<f64> {
        let mut z = Matrix::from_fn(self.a.nrows(), 1, |i, _| f64::from(u8::from(i == 0)));
        let mut out = Vec::with_capacity(samples * self.n);
        for _ in 0..samples {
            let shown = &self.c * &z;
            out.extend((0..self.n).map(|i| self.scale(i) * shown[i]));
            z = &self.a * z;
        }
        out
    }
}
