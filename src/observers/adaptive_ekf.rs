//! The adaptive high-gain EKF of sampled data, Boizot, Busvelle and Gauthier, Automatica 46 (2010) 1483.
//!
//! θ lies between 1, where the filter is the extended Kalman filter, and θ_max. It moves by the innovation of a
//! window of d seconds, the last W samples used,
//!
//!   I(t) = ∫ |y(s) − ŷ(s)|² ds from t − d to t,   ŷ by the model from x̂(t − d) on, without correction    (1)
//!   θ̇ = μ(I) F₀(θ) + (1 − μ(I)) λ (1 − θ),   μ(I) = 1/(1 + e^{−β(I − m)})                               (2)
//!   F₀(θ) = θ²/ΔT for θ ≤ θ_max/2, else (θ − θ_max)²/ΔT                                                 (3)
//!
//! A large innovation raises θ to θ_max within about 2 ΔT; where it is small θ falls back to 1 at the rate λ.
//! The window is W runs of the model, begun at the last W samples, each with its part of (1): a step moves each
//! of them once, and neither samples nor inputs are kept.

use super::{HighGainEkfState, SampledEkf};
use crate::Scalar;
use crate::dual::Dual;
use crate::error::{DesignError, positive, require};
use crate::integrate::{RightHandSide, rk4};
use crate::memory::Memory;
use crate::model::Model;
use crate::observer::{Causal, Observer, Status, Timing};
use nalgebra::{SMatrix, SVector};

/// How θ moves by the innovation of a window: (2) and (3).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct InnovationGain<T> {
    most: T,
    rise: T,
    fall: T,
    slope: T,
    threshold: T,
}

crate::error::through_constructor! {
    [T: Scalar]
    InnovationGain<T>: gain => {
        most: T = gain.most, rise: T = gain.rise, fall: T = gain.fall,
        slope: T = gain.slope, threshold: T = gain.threshold,
    }
    => Self::new(most, rise, fall, slope, threshold)
}

impl<T: Scalar> InnovationGain<T> {
    /// θ_max > 1, ΔT > 0 (s), λ > 0 (1/s), β > 0 and m > 0, in 1 over and in the output's unit squared times s.
    ///
    /// # Errors
    /// A parameter outside its range.
    pub fn new(most: T, rise: T, fall: T, slope: T, threshold: T) -> Result<Self, DesignError> {
        Ok(Self {
            most: require("most", most, most > T::ONE && most.is_finite(), "it must be above 1")?,
            rise: positive("rise", rise)?,
            fall: positive("fall", fall)?,
            slope: positive("slope", slope)?,
            threshold: positive("threshold", threshold)?,
        })
    }

    /// θ̇ under the innovation I of the window.
    #[inline(always)]
    pub fn rate(&self, theta: T, innovation: T) -> T {
        let mu = T::ONE / (T::ONE + (self.slope * (self.threshold - innovation)).exp());
        let below = theta - self.most;
        let grown = theta.where_above(self.most * T::from_f64(0.5), below * below, theta * theta);
        mu * (grown / self.rise) + (T::ONE - mu) * (self.fall * (T::ONE - theta)) // (2), (3)
    }

    /// θ after a time dt under that innovation, within [1, θ_max].
    #[inline(always)]
    fn moved(&self, theta: T, innovation: T, dt: T) -> T {
        let moved = rk4(Under { gain: self, innovation }, T::ZERO, &theta, dt);
        moved.max(T::ONE).min(self.most)
    }
}

/// (2) under an innovation that is held.
struct Under<'a, T> {
    gain: &'a InnovationGain<T>,
    innovation: T,
}

impl<T: Scalar> RightHandSide<T, T> for Under<'_, T> {
    #[inline(always)]
    fn at(&self, _: T, theta: &T) -> T {
        self.gain.rate(*theta, self.innovation)
    }
}

crate::memory_struct! {
    /// Memory of the filter.
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    pub struct AdaptiveEkfState<T; const N: usize, const W: usize> {
        /// Estimate, covariance and θ.
        pub law: HighGainEkfState<T, T, N>,
        /// Where the model has come to from the estimates of the last W samples, a column each, the oldest first.
        pub runs: SMatrix<T, N, W>,
        /// I of each of them; −1 of one that has not begun.
        pub innovations: SVector<T, W>,
        /// Time since the last sample that was used, in s.
        pub elapsed: T,
    }
}

/// Adaptive high-gain EKF of N states with a window of W samples and M known inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AdaptiveEkf<T: Scalar, Md, const N: usize, const W: usize, const M: usize = 0> {
    /// The filter at θ = 1.
    filter: SampledEkf<T, Md, N, 1, M>,
    gain: InnovationGain<T>,
}

crate::error::through_constructor! {
    [T: Scalar, Md: Model<Dual<T, N>, N, M>, const N: usize, const W: usize, const M: usize]
    AdaptiveEkf<T, Md, N, W, M>: law => {
        q: SMatrix<T, N, N> = law.filter.q,
        r: T = law.filter.r[0],
        p0: SMatrix<T, N, N> = law.filter.p0,
        gain: InnovationGain<T> = law.gain,
        model: Md = law.filter.driven.model,
    }
    => Self::new(&q, r, &p0, gain, model)
}

impl<T, Md, const N: usize, const W: usize, const M: usize> AdaptiveEkf<T, Md, N, W, M>
where
    T: Scalar,
    Md: Model<Dual<T, N>, N, M>,
{
    /// As [`SampledEkf::new`] of one output at θ = 1, and how θ moves.
    ///
    /// # Errors
    /// As there; powers of θ_max that the precision does not hold.
    pub fn new(
        q: &SMatrix<T, N, N>,
        r: T,
        p0: &SMatrix<T, N, N>,
        gain: InnovationGain<T>,
        model: Md,
    ) -> Result<Self, DesignError> {
        SampledEkf::<T, Md, N, 1, M>::new(q, [r], p0, [gain.most], [N], model)?; // at its largest
        let filter = SampledEkf::new(q, [r], p0, [T::ONE], [N], model)?;
        Ok(Self { filter, gain })
    }
}

impl<T, Md, const N: usize, const W: usize, const M: usize> Observer<T>
    for AdaptiveEkf<T, Md, N, W, M>
where
    T: Scalar,
    Md: Model<Dual<T, N>, N, M>,
{
    type State = AdaptiveEkfState<T, N, W>;
    type Measurement = T;
    type Input = SVector<T, M>;
    const TIMING: Timing = Timing::Current;
    const ESTIMATED: usize = N;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        let law = HighGainEkfState { x_hat: SVector::zero(), p: self.filter.start, r: T::ONE };
        let innovations = SVector::from_element(-T::ONE);
        AdaptiveEkfState { law, innovations, ..AdaptiveEkfState::zero() }
    }

    #[inline(always)]
    fn correct(&self, z: &mut Self::State, y: &T, _: T) -> Status {
        let present = T::ONE - T::ONE.while_missing(*y);
        let taken = z.elapsed.where_above(T::ZERO, present, T::ZERO);
        let passed = z.elapsed - z.elapsed.while_missing(*y);
        // (1), of every run that has begun
        let grown: SVector<T, W> = SVector::from_fn(|j, _| {
            let (e, i) = (y.innovation(z.runs[(0, j)]), z.innovations[j]);
            i.where_above(-T::from_f64(0.5), i + passed * (e * e), i)
        });
        let oldest = grown.iter().next().copied().unwrap_or(T::ZERO).max(T::ZERO);
        let theta = self.gain.moved(z.law.r, oldest, passed);
        let (p, gains) = z.law.p.measured(0, self.filter.variance[0] / theta, taken);
        let e = y.innovation(z.law.x_hat[0]);
        let x_hat = SVector::from_fn(|i, _| z.law.x_hat[i] + gains[i] * e);
        // a sample that is used begins a run in the place of the oldest; the first one begins all
        let begins = |now: T, new: T, i: T| {
            let begun = i.where_above(-T::from_f64(0.5), now, new);
            present.where_above(T::ZERO, begun, now)
        };
        let innovations = SVector::from_fn(|j, _| {
            let next = if j + 1 < W { grown[j + 1] } else { T::ZERO };
            let shifted = taken.where_above(T::ZERO, next, grown[j]);
            begins(shifted, T::ZERO, shifted)
        });
        let runs = SMatrix::from_fn(|i, j| {
            let last = j + 1 == W;
            let (next, of) =
                if last { (x_hat[i], T::ZERO) } else { (z.runs[(i, j + 1)], grown[j + 1]) };
            let shifted = taken.where_above(T::ZERO, next, z.runs[(i, j)]);
            begins(shifted, x_hat[i], taken.where_above(T::ZERO, of, grown[j]))
        });
        let law = HighGainEkfState { x_hat, p, r: theta };
        let elapsed = z.elapsed.while_missing(*y);
        *z = AdaptiveEkfState { law, runs, innovations, elapsed };
        Status::of(y)
    }

    #[inline(always)]
    fn advance(&self, z: &mut Self::State, _: &T, u: &Self::Input, t: T, dt: T) -> Status {
        let (driven, HighGainEkfState { x_hat, p, r }) = (&self.filter.driven, &z.law);
        let mut runs = z.runs;
        for (j, mut run) in runs.column_iter_mut().enumerate() {
            let begun = SVector::from_fn(|i, _| {
                z.innovations[j].where_above(-T::from_f64(0.5), run[i], x_hat[i])
            });
            run.copy_from(&driven.free(t, &begun, u, dt));
        }
        let (x_hat, p) = driven.ahead(t, (x_hat, p), u, dt, *r);
        let law = HighGainEkfState { x_hat, p, r: *r };
        *z = AdaptiveEkfState { law, runs, elapsed: z.elapsed + dt, ..*z };
        Status::Predicted
    }

    #[inline(always)]
    fn held(&self, z: &Self::State, dt: T) -> Self::State {
        AdaptiveEkfState { elapsed: z.elapsed + dt, ..*z }
    }

    #[inline(always)]
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [T] {
        z.law.x_hat.as_slice()
    }

    #[inline(always)]
    fn innovation(&self, _: T, z: &Self::State, y: &T, _: &Self::Input) -> T {
        *y - z.law.x_hat[0]
    }
}

impl<T, Md, const N: usize, const W: usize, const M: usize> Causal<T>
    for AdaptiveEkf<T, Md, N, W, M>
where
    T: Scalar,
    Md: Model<Dual<T, N>, N, M>,
{
}
