//! Floor 3. Exact mean and covariance of a linear observer's error under white noise.
//!
//! For the standard observer with f̂ = 0 and a constant gain ℓ under forward Euler, the error
//! e = x̂ − x obeys e(k+1) = M e(k) + dt L v(k) + (what the model lacks), with
//! M = I + dt(A − L C) and L = (k₁ℓ, …, kₙℓⁿ). Its mean is the run without noise; its covariance
//! P(k+1) = M P(k) Mᵀ + dt² L Lᵀ σ². Both hold for any schedule dt = a(k).

use crate::Scalar;
use crate::memory::Memory;
use crate::metrics::{Moments, Window};
use crate::observer::Measurement;
use crate::schedule::Schedule;
use crate::simulate::{Probe, Sample};
use nalgebra::SMatrix;

/// Probe on a run without noise that carries the covariance along.
#[derive(Debug)]
pub struct ErrorCovariance<'a, T, S, F, const N: usize> {
    /// The observer's schedule.
    pub schedule: S,
    /// Injection L = (k₁ℓ, …, kₙℓⁿ).
    pub injection: [T; N],
    /// Variance σ² of the measurement noise.
    pub variance: T,
    /// Windows over which e² is averaged.
    pub windows: &'a [Window],
    /// windows × N moments of √(mean² + variance): their `rms` is the exact RMS of the error.
    pub moments: &'a mut [Moments<T>],
    /// P at the last sample seen.
    pub covariance: SMatrix<T, N, N>,
    /// Step from the last sample seen to the next.
    last_dt: Option<T>,
    /// Asked now and then whether to stop.
    stop: F,
}

impl<'a, T: Scalar, S: Schedule<T>, F: Fn() -> bool, const N: usize>
    ErrorCovariance<'a, T, S, F, N>
{
    /// From P(0) = 0, for the injection L and the variance σ² of the noise; `moments` has N entries
    /// for each window. `stop` is asked every 4096 samples whether to end early.
    pub fn new(
        schedule: S,
        injection: [T; N],
        variance: T,
        windows: &'a [Window],
        moments: &'a mut [Moments<T>],
        stop: F,
    ) -> Self {
        let covariance = SMatrix::from_element(T::ZERO);
        Self { schedule, injection, variance, windows, moments, covariance, last_dt: None, stop }
    }

    /// P(k + 1) = M P(k) Mᵀ + dt² L Lᵀ σ².
    fn propagated(&self, dt: T) -> SMatrix<T, N, N> {
        // M X for M = I + dt(A − L C): row i gains dt·(row i+1 − Lᵢ·row 1)
        let times_m = |x: &SMatrix<T, N, N>| -> SMatrix<T, N, N> {
            SMatrix::from_fn(|i, j| {
                let above = if i + 1 < N { x[(i + 1, j)] } else { T::ZERO };
                x[(i, j)] + dt * (above - self.injection[i] * x[(0, j)])
            })
        };
        let spread = times_m(&times_m(&self.covariance).transpose());
        let noise = dt * dt * self.variance;
        SMatrix::from_fn(|i, j| spread[(i, j)] + noise * self.injection[i] * self.injection[j])
    }
}

impl<T: Scalar, S: Schedule<T>, F: Fn() -> bool, const N: usize> Probe<T>
    for ErrorCovariance<'_, T, S, F, N>
{
    fn sample<X: Memory<T>, Z: Memory<T>, Y: Measurement<T>>(
        &mut self,
        sample: &Sample<'_, T, X, Z, Y>,
    ) {
        if let Some(dt) = self.last_dt {
            self.covariance = self.propagated(dt);
        }
        self.last_dt = Some(self.schedule.dt(sample.k));
        for (window, row) in self.windows.iter().zip(self.moments.chunks_exact_mut(N)) {
            if window.contains(sample.k) {
                let errors = sample.estimate.iter().zip(sample.truth).map(|(e, x)| *e - *x);
                for (i, (moment, mean)) in row.iter_mut().zip(errors).enumerate() {
                    moment.push((mean * mean + self.covariance[(i, i)]).sqrt());
                }
            }
        }
    }

    fn interrupted(&mut self, k: u64) -> bool {
        k.is_multiple_of(4096) && (self.stop)()
    }
}
