//! The high-gain reduced-order observer for sampled strict-feedback systems, Katayama (8), (22):
//!
//!   Ψ(k)   = Φ⁻¹(y)gᵀ(y) { (y(k+1) − y(k))/T − f₁(y) }
//!   ẑ(k+1) = (I − T H) ẑ(k) + T [ H Ψ(k) + f₂(y(k), Ψ(k), u(k)) ],   H = diag(h̄)/ε
//!
//! It filters: the sample y(k + 1) closes the step from k, so ẑ(k + 1) is known at k + 1.

use super::checked;
use crate::Scalar;
use crate::error::{DesignError, positive, require};
use crate::memory::Memory;
use crate::model::StrictFeedback;
use crate::observer::{Causal, Measurement, Observer, Status, Timing, absent};
use nalgebra::SVector;

crate::memory_struct! {
    /// ẑ, the last sample seen, and the step that the next one closes.
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    pub struct ReducedOrderState<T; const NX: usize, const NZ: usize, const M: usize> {
        /// Estimate ẑ.
        pub z_hat: SVector<T, NZ>,
        /// Last sample y.
        pub y: SVector<T, NX>,
        /// Input held over the step that the next sample closes.
        pub u: SVector<T, M>,
        /// Time since that sample in s; −1 before the first one.
        pub elapsed: T,
        /// Length of the step that the next sample closes, in s.
        pub period: T,
    }
}

impl<T: Scalar, const NX: usize, const NZ: usize, const M: usize> ReducedOrderState<T, NX, NZ, M> {
    /// ẑ at the end of the step, and what became of it: it is held where the model has no value.
    #[inline(always)]
    #[allow(clippy::eq_op)] // entry - entry is 0, or NaN
    fn moved(&mut self, rate: &SVector<T, NZ>, status: Status) -> Status {
        let next = self.z_hat + rate * self.period;
        // 0 where all entries are finite, else NaN
        if next.fold(T::NEG_ZERO, |sum, entry| sum + (entry - entry)).is_finite() {
            self.z_hat = next;
            status
        } else {
            Status::ModelUndefined
        }
    }
}

/// Reduced-order observer for any f₁, g, f₂.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ReducedOrderObserver<T, Md, const NX: usize, const NZ: usize, const M: usize> {
    h: SVector<T, NZ>,
    model: Md,
}

crate::error::through_constructor! {
    [T: Scalar, Md: StrictFeedback<T, NX, NZ, M>, const NX: usize, const NZ: usize, const M: usize]
    ReducedOrderObserver<T, Md, NX, NZ, M>: observer => {
        h: SVector<T, NZ> = observer.h,
        model: Md = observer.model,
    }
    => Self::from_rates(h, model)
}

impl<T, Md, const NX: usize, const NZ: usize, const M: usize> ReducedOrderObserver<T, Md, NX, NZ, M>
where
    T: Scalar,
    Md: StrictFeedback<T, NX, NZ, M>,
{
    /// Gains h̄ᵢ in (0, 1), small parameter ε > 0 in s, model. Stable for T < 2ε/max h̄ (A5).
    ///
    /// # Errors
    /// An h̄ᵢ outside (0, 1); ε not finite or ≤ 0; h̄ᵢ/ε not finite.
    pub fn new(h_bar: [T; NZ], epsilon: T, model: Md) -> Result<Self, DesignError> {
        positive("epsilon", epsilon)?;
        for h in h_bar {
            let inside = h > T::ZERO && h < T::ONE;
            require("h_bar", h, inside, "every entry must lie in (0, 1), Katayama A5")?;
        }
        Self::from_rates(SVector::from_fn(|i, _| h_bar[i] / epsilon), model)
    }

    /// From the diagonal h̄/ε of H.
    fn from_rates(h: SVector<T, NZ>, model: Md) -> Result<Self, DesignError> {
        for rate in h.iter() {
            positive("h (h_bar / epsilon)", *rate)?;
        }
        Ok(Self { h: checked("h", h.into())?, model })
    }
}

impl<T, Md, const NX: usize, const NZ: usize, const M: usize> Observer<T>
    for ReducedOrderObserver<T, Md, NX, NZ, M>
where
    T: Scalar,
    Md: StrictFeedback<T, NX, NZ, M>,
{
    type State = ReducedOrderState<T, NX, NZ, M>;
    type Measurement = SVector<T, NX>;
    type Input = SVector<T, M>;
    const TIMING: Timing = Timing::Current;
    const ESTIMATED: usize = NZ;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        ReducedOrderState { elapsed: -T::ONE, ..ReducedOrderState::zero() }
    }

    /// Close the step that ends at t.
    #[inline(always)]
    fn correct(&self, z: &mut Self::State, y: &Self::Measurement, t: T) -> Status {
        let (closes, last, begun) = (z.elapsed > T::ZERO, t - z.elapsed, t - z.period);
        let status = if y.is_present() {
            let mut status = Status::Updated;
            if closes {
                let slope = (y - z.y).map(|d| d / z.elapsed);
                let moved = slope - self.model.f1(last, &z.y, &z.u);
                let psi = self.model.explain(last, &z.y, &z.u, &moved);
                let f2 = self.model.f2(begun, &z.y, &psi, &z.u);
                status = z.moved(&(self.h.component_mul(&(psi - z.z_hat)) + f2), status); // (8)
            }
            (z.y, z.elapsed) = (*y, T::ZERO);
            status
        } else if closes {
            z.moved(&self.model.f2(begun, &z.y, &z.z_hat, &z.u), Status::Predicted)
        } else {
            Status::Predicted
        };
        z.period = T::ZERO; // it is closed
        status
    }

    #[inline(always)]
    fn advance(
        &self,
        z: &mut Self::State,
        _: &Self::Measurement,
        u: &Self::Input,
        _: T,
        dt: T,
    ) -> Status {
        (z.elapsed, z.u, z.period) = (z.elapsed.passed(dt), *u, dt);
        Status::Predicted
    }

    /// After a step that was left open, which is closed without a sample.
    #[inline(always)]
    fn predict(&self, z: &mut Self::State, u: &Self::Input, t: T, dt: T) -> Status {
        let open = z.period > T::ZERO;
        let closed = if open { self.correct(z, &absent(), t) } else { Status::Predicted };
        self.advance(z, &absent(), u, t, dt);
        closed
    }

    #[inline(always)]
    fn held(&self, z: &Self::State, dt: T) -> Self::State {
        Self::State { elapsed: z.elapsed.passed(dt), ..*z }
    }

    #[inline(always)]
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [T] {
        z.z_hat.as_slice()
    }

    #[inline(always)]
    fn innovation(
        &self,
        t: T,
        z: &Self::State,
        y: &Self::Measurement,
        _: &Self::Input,
    ) -> Self::Measurement {
        let elapsed = z.elapsed.max(T::ZERO);
        let last = t - elapsed;
        let (f1, g) = (self.model.f1(last, &z.y, &z.u), self.model.g(last, &z.y, &z.u));
        SVector::from_fn(|i, _| {
            let mut rate = f1[i];
            for j in 0..NZ {
                rate += g[(i, j)] * z.z_hat[j];
            }
            y[i] - z.y[i] - elapsed * rate
        })
    }
}

impl<T, Md, const NX: usize, const NZ: usize, const M: usize> Causal<T>
    for ReducedOrderObserver<T, Md, NX, NZ, M>
where
    T: Scalar,
    Md: StrictFeedback<T, NX, NZ, M>,
{
}
