//! Gains on a window of innovations: filters of finite memory, with a fixed period T.
//!
//! Between samples the chain moves exactly, x̂⁻ = e^{AT} x̂. With d₀ = e = y − x̂₁⁻ and d₁ … d_{m−1} what the
//! m − 1 samples before were off the polynomial of x̂⁻,
//!
//!   δ = W d,   x̂⁺ = x̂⁻ + δ,   dⱼ⁺ = dⱼ − Σᵢ δᵢ (−jT)ⁱ⁻¹/(i−1)!                                     (1)
//!
//! so that each dⱼ is then off the polynomial of x̂⁺, and one sample older with the next one. A missing sample
//! has e = 0: it counts as what the polynomial is there.
//!
//! - Rows of W that are weights of least squares for a polynomial of degree n − 1: the causal filter of
//!   Savitzky and Golay (Analytical Chemistry 36 (1964) 1627), x̂⁺ = W (y(k), …, y(k−m+1)), since W gives a
//!   polynomial of that degree its own derivatives. From any start nothing is left of it after m samples.
//! - m = 1: a constant gain, of any error matrix: the α-β-γ filters, and for W = (1, b) the dirty derivative
//!   v⁺ = a v + b (y⁺ − y) with a = 1 − bT.

use crate::Scalar;
use crate::error::{DesignError, finite, positive};
use crate::injection::ahead;
use crate::memory::Memory;
use crate::observer::{Causal, Observer, Status, Timing};
use nalgebra::{SMatrix, SVector};

crate::memory_struct! {
    /// Memory of gains on a window.
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    pub struct WindowState<T; const N: usize, const K: usize> {
        /// Estimate x̂.
        pub x_hat: SVector<T, N>,
        /// What the last K samples are off the polynomial of x̂, the newest first.
        pub d: SVector<T, K>,
    }
}

/// Observer of order N by gains on the innovations of K samples.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WindowObserver<T, const N: usize, const K: usize> {
    w: SMatrix<T, N, K>,
    period: T,
    /// Tⁱ/i!.
    powers: SVector<T, N>,
}

crate::error::through_constructor! {
    [T: Scalar, const N: usize, const K: usize]
    WindowObserver<T, N, K>: observer => {
        w: SMatrix<T, N, K> = observer.w,
        period: T = observer.period,
    }
    => Self::new(w, period)
}

impl<T: Scalar, const N: usize, const K: usize> WindowObserver<T, N, K> {
    /// Gains W, row i for x̂ᵢ and column j for the sample j periods old, and the period T > 0 in s.
    ///
    /// # Errors
    /// A gain that is not finite; T not finite or ≤ 0.
    pub fn new(w: SMatrix<T, N, K>, period: T) -> Result<Self, DesignError> {
        positive("dt", period)?;
        for gain in w.iter() {
            finite("W", *gain)?;
        }
        let powers = SVector::from_fn(|i, _| {
            (1..=i).fold(T::ONE, |power, q| power * period * T::from_f64(1.0 / q as f64))
        });
        Ok(Self { w, period, powers })
    }
}

impl<T: Scalar, const N: usize, const K: usize> Observer<T> for WindowObserver<T, N, K> {
    type State = WindowState<T, N, K>;
    type Measurement = T;
    type Input = SVector<T, 0>;
    const TIMING: Timing = Timing::Current;
    const ESTIMATED: usize = N;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        WindowState::zero()
    }

    #[inline(always)]
    fn correct(&self, z: &mut Self::State, y: &T, _: T) -> Status {
        let e = y.innovation(z.x_hat[0]);
        let d = SVector::<T, K>::from_fn(|j, _| if j == 0 { e } else { z.d[j - 1] });
        let delta = SVector::<T, N>::from_fn(|i, _| {
            (0..K).fold(T::NEG_ZERO, |sum, j| sum + self.w[(i, j)] * d[j])
        });
        z.x_hat += delta; // (1)
        let c = delta.component_mul(&self.powers);
        z.d = SVector::from_fn(|j, _| {
            let age = T::from_f64(-(j as f64));
            d[j] - (0..N).rev().fold(T::NEG_ZERO, |sum, i| sum * age + c[i])
        });
        Status::of(y)
    }

    #[inline(always)]
    fn advance(&self, z: &mut Self::State, _: &T, _: &Self::Input, _: T, dt: T) -> Status {
        let rate =
            SVector::<T, N>::from_fn(|i, _| if i + 1 < N { z.x_hat[i + 1] } else { T::ZERO });
        z.x_hat = ahead(&z.x_hat, &rate, dt);
        Status::Predicted
    }

    #[inline(always)]
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [T] {
        z.x_hat.as_slice()
    }

    #[inline(always)]
    fn innovation(&self, _: T, z: &Self::State, y: &T, _: &Self::Input) -> T {
        *y - z.x_hat[0]
    }
}

impl<T: Scalar, const N: usize, const K: usize> Causal<T> for WindowObserver<T, N, K> {}
