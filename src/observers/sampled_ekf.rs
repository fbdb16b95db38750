//! The high-gain EKF of sampled data, for one output or several.
//!
//! Between samples x̂ and P move by the model ([`super::HighGainEkf`], (1) and (2) without a sample). A sample
//! of output q, the first state of chain q, whose noise has the variance R_q, corrects by
//!
//!   K = P C_qᵀ/(C_q P C_qᵀ + R_q/θ_q),   x̂⁺ = x̂ + K (y_q − C_q x̂),   P⁺ = (I − K C_q) P              (1)
//!
//! one output after the other, which is the same as all at once where their noises are independent. P is of
//! all states, so that a sample of one output corrects the states of the others as far as the model couples
//! them. θ = 1 is the extended Kalman filter: Jazwinski, Stochastic Processes and Filtering Theory (1970),
//! theorem 8.1; Boizot, Busvelle and Gauthier, Automatica 46 (2010) 1483, for θ.

use super::HighGainEkfState;
use super::high_gain_ekf::{Driven, of_gain, started};
use crate::Scalar;
use crate::dual::Dual;
use crate::error::{DesignError, positive, require};
use crate::factor::Factor;
use crate::memory::Memory;
use crate::model::Model;
use crate::observer::{Causal, Observer, Status, Timing};
use nalgebra::{SMatrix, SVector};

crate::memory_struct! {
    /// Memory of the filter.
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    pub struct SampledEkfState<T; const N: usize, const K: usize> {
        /// Estimate and covariance.
        pub law: HighGainEkfState<T, (), N>,
        /// Of each output the time since its last sample that was used, in s.
        pub elapsed: SVector<T, K>,
    }
}

/// High-gain EKF of N states in K chains, an output each, with M known inputs.
///
/// Its memory holds, of each output, the time that has passed since its last sample used; a sample after no
/// time, as the first one at the start, corrects nothing. The outputs of one time may come in one call or one
/// after the other.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SampledEkf<T: Scalar, Md, const N: usize, const K: usize = 1, const M: usize = 0> {
    pub(super) q: SMatrix<T, N, N>,
    pub(super) p0: SMatrix<T, N, N>,
    pub(super) r: SVector<T, K>,
    theta: SVector<T, K>,
    orders: [usize; K],
    /// P(0).
    pub(super) start: Factor<T, N>,
    /// R_q/θ_q.
    pub(super) variance: SVector<T, K>,
    /// The states that are measured.
    measured: [usize; K],
    pub(super) driven: Driven<T, Md, N, M>,
}

crate::error::through_constructor! {
    [T: Scalar, Md: Model<Dual<T, N>, N, M>, const N: usize, const K: usize, const M: usize]
    SampledEkf<T, Md, N, K, M>: law => {
        q: SMatrix<T, N, N> = law.q,
        r: SVector<T, K> = law.r,
        p0: SMatrix<T, N, N> = law.p0,
        theta: SVector<T, K> = law.theta,
        orders: SVector<usize, K> = SVector::<usize, K>::from(law.orders),
        model: Md = law.driven.model,
    }
    => Self::new(&q, r.into(), &p0, theta.into(), orders.into(), model)
}

impl<T, Md, const N: usize, const K: usize, const M: usize> SampledEkf<T, Md, N, K, M>
where
    T: Scalar,
    Md: Model<Dual<T, N>, N, M>,
{
    /// Intensity Q of white noise in ẋ, variances R of the outputs' samples, covariance P(0) of the first
    /// estimate, gains θ and orders of the chains, model.
    ///
    /// # Errors
    /// Orders that are not N together; Q that is not positive semidefinite; R or P(0) that is not positive; a
    /// gain below 1, or whose powers the precision does not hold.
    pub fn new(
        q: &SMatrix<T, N, N>,
        r: [T; K],
        p0: &SMatrix<T, N, N>,
        theta: [T; K],
        orders: [usize; K],
        model: Md,
    ) -> Result<Self, DesignError> {
        let sum = orders.iter().fold(0_usize, |sum, order| sum.saturating_add(*order));
        let fits = sum == N && orders.iter().all(|order| *order > 0);
        let count = T::from_f64(sum as f64);
        require(
            "orders",
            count,
            fits,
            "the orders of the chains must add up to n, each at least 1",
        )?;
        let (mut first, mut of, mut measured) = ([0; N], [0; N], [0; K]);
        let mut begun = 0;
        for (chain, order) in orders.iter().enumerate() {
            for slot in first.iter_mut().skip(begun).take(*order) {
                *slot = begun;
            }
            of.iter_mut().skip(begun).take(*order).for_each(|slot| *slot = chain);
            measured.iter_mut().skip(chain).take(1).for_each(|slot| *slot = begun);
            begun += order;
        }
        let mut variance = SVector::<T, K>::from_element(T::ZERO);
        for (slot, (r, theta)) in variance.iter_mut().zip(r.iter().zip(&theta)) {
            *slot = positive("R", positive("R", *r)? / *theta)?;
        }
        let theta_of = |i: usize| theta.get(of[i]).copied().unwrap_or(T::ONE);
        Ok(Self {
            q: *q,
            p0: *p0,
            r: r.into(),
            theta: theta.into(),
            orders,
            start: started(p0)?,
            variance,
            measured,
            driven: Driven::new(of_gain(q, theta_of, &first)?, model, first),
        })
    }

    /// The correction by a sample.
    #[inline(always)]
    fn corrected(
        &self,
        z: &SampledEkfState<T, N, K>,
        y: &SVector<T, K>,
    ) -> HighGainEkfState<T, (), N> {
        let (mut x_hat, mut p) = (z.law.x_hat, z.law.p);
        for (q, at) in self.measured.iter().enumerate() {
            // 1 for an output that is taken, else 0
            let begun = z.elapsed[q].where_above(T::ZERO, T::ONE, T::ZERO);
            let taken = begun - begun.while_missing(y[q]);
            let e = y[q].innovation(entry(&x_hat, *at));
            let (next, gains) = p.measured(*at, self.variance[q], taken);
            x_hat = SVector::from_fn(|i, _| x_hat[i] + gains[i] * e); // (1)
            p = next;
        }
        HighGainEkfState { x_hat, p, r: () }
    }
}

/// Entry i, which is there.
#[inline(always)]
fn entry<T: Scalar, const N: usize>(x: &SVector<T, N>, i: usize) -> T {
    x.get(i).copied().unwrap_or(T::ZERO)
}

impl<T, Md, const N: usize, const K: usize, const M: usize> Observer<T>
    for SampledEkf<T, Md, N, K, M>
where
    T: Scalar,
    Md: Model<Dual<T, N>, N, M>,
{
    type State = SampledEkfState<T, N, K>;
    type Measurement = SVector<T, K>;
    type Input = SVector<T, M>;
    const TIMING: Timing = Timing::Current;
    const ESTIMATED: usize = N;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        let law = HighGainEkfState { p: self.start, ..HighGainEkfState::zero() };
        SampledEkfState { law, ..SampledEkfState::zero() }
    }

    #[inline(always)]
    fn correct(&self, z: &mut Self::State, y: &SVector<T, K>, _: T) -> Status {
        // where an output is missing, its time goes on
        let elapsed = SVector::from_fn(|q, _| z.elapsed[q].while_missing(y[q]));
        *z = SampledEkfState { law: self.corrected(z, y), elapsed };
        Status::of(y)
    }

    #[inline(always)]
    fn advance(
        &self,
        z: &mut Self::State,
        _: &SVector<T, K>,
        u: &Self::Input,
        t: T,
        dt: T,
    ) -> Status {
        let (x_hat, p) = self.driven.ahead(t, (&z.law.x_hat, &z.law.p), u, dt, T::ONE);
        let law = HighGainEkfState { x_hat, p, r: () };
        *z = SampledEkfState { law, elapsed: z.elapsed.add_scalar(dt) };
        Status::Predicted
    }

    #[inline(always)]
    fn held(&self, z: &Self::State, dt: T) -> Self::State {
        SampledEkfState { law: z.law, elapsed: z.elapsed.add_scalar(dt) }
    }

    #[inline(always)]
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [T] {
        z.law.x_hat.as_slice()
    }

    /// Of each output before any is used.
    #[inline(always)]
    fn innovation(
        &self,
        _: T,
        z: &Self::State,
        y: &SVector<T, K>,
        _: &Self::Input,
    ) -> SVector<T, K> {
        SVector::from_fn(|q, _| y[q] - entry(&z.law.x_hat, self.measured[q]))
    }
}

impl<T, Md, const N: usize, const K: usize, const M: usize> Causal<T> for SampledEkf<T, Md, N, K, M>
where
    T: Scalar,
    Md: Model<Dual<T, N>, N, M>,
{
}
