//! The standard observer behind a filter of its innovation.
//!
//! m filter states η in front of the chain of n, e = y − x̂₁ and f̂ what is known of the system:
//!
//!   η̇ᵢ = ℓ (ηᵢ₊₁ − cᵢ η₁)                 i = 1 … m−1,     η̇ₘ = cₘ ℓ (e − η₁)          (1)
//!   x̂̇ⱼ = x̂ⱼ₊₁ + f̂ⱼ(x̂, u, t) + kⱼ ℓʲ η₁     j = 1 … n,       x̂ₙ₊₁ = 0                   (2)
//!
//! e passes cₘ/(σᵐ + c₁σᵐ⁻¹ + … + cₘ), σ = s/ℓ, a low-pass filter of gain 1 at rest. With kⱼ = cₘ₊ⱼ/cₘ the
//! poles are ℓ times the roots of sⁿ⁺ᵐ + c₁sⁿ⁺ᵐ⁻¹ + … + cₙ₊ₘ, and each state has less of the noise by m more
//! integrations. The innovation is filtered and not y, so that x̂ = x, η = 0 remains a solution.
//!
//! Filters of the output error in front of a high-gain observer: Tréangle, Farza and M'Saad, Automatica 101
//! (2019); Astolfi, Zaccarian and Jungers, Systems & Control Letters 148 (2021) 104856. In their coordinates
//! w₁ = −η₁/(cₘℓᵐ) is the first state of a companion form, from which (1), (2) come by scaling.

use super::{StandardObserver, checked, driven, folded, one_row};
use crate::Scalar;
use crate::error::DesignError;
use crate::gain::GainLaw;
use crate::laws::Sizes;
use crate::memory::Memory;
use crate::model::Model;
use crate::observer::ContinuousLaw;
use nalgebra::SVector;

crate::memory_struct! {
    /// Memory of a filtered observer.
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    pub struct FilteredState<T, R: Memory; const N: usize, const K: usize> {
        /// Estimate x̂.
        pub x_hat: SVector<T, N>,
        /// States of the filter, in the unit of y; the first one is what corrects.
        pub eta: SVector<T, K>,
        /// The gain law's memory: r where the gain moves, else nothing.
        pub r: R,
    }
}

/// Observer of order N behind a filter of K states, with M known inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FilteredObserver<T, G, Md, const N: usize, const K: usize, const M: usize = 0> {
    /// cᵢ ℓ, ℓ the fixed part of the gain.
    c: SVector<T, K>,
    /// (2): the chain that η₁ corrects.
    chain: StandardObserver<T, G, Md, N, M>,
}

crate::error::through_constructor! {
    [T: Scalar, G: GainLaw<T>, Md: Model<T, N, M>, const N: usize, const K: usize, const M: usize]
    FilteredObserver<T, G, Md, N, K, M>: observer => {
        c: SVector<T, K> = super::unfolded(&observer.c, observer.chain.gain.fixed(), |_| 1),
        k: SVector<T, N> =
            super::unfolded(&observer.chain.k, observer.chain.gain.fixed(), |i| i + 1),
        gain: G = observer.chain.gain,
        model: Md = observer.chain.model,
    }
    => Self::new(c.into(), k.into(), gain, model)
}

/// cᵢ, then kⱼ, of the polynomial of these poles: see [`crate::laws::Design::place`].
///
/// # Errors
/// As [`crate::polynomial::coefficients_from_poles`].
pub fn filter_from_poles(
    sizes: &Sizes,
    poles: &[(f64, f64)],
    out: &mut [f64],
) -> Result<(), DesignError> {
    crate::polynomial::write_coefficients(poles, out)?;
    let (c, k) = out.split_at_mut(sizes.m.min(out.len()));
    for k in k {
        *k /= c.last().copied().unwrap_or(1.0);
    }
    Ok(())
}

impl<T, G, Md, const N: usize, const K: usize, const M: usize> FilteredObserver<T, G, Md, N, K, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: Model<T, N, M>,
{
    /// Coefficients c of the filter and k of the chain, gain law, model.
    ///
    /// # Errors
    /// A coefficient that is not finite; N or K outside 1 to 12, or both together above 23; a polynomial
    /// sᴺ⁺ᴷ + … + c_K sᴺ + c_K k₁ sᴺ⁻¹ + … + c_K k_N that is not Hurwitz; a gain whose N-th power is too large
    /// or too small for the precision.
    pub fn new(c: [T; K], k: [T; N], gain: G, model: Md) -> Result<Self, DesignError> {
        let (c, k) = (checked("c", c)?, checked("k", k)?);
        let last = c.iter().last().copied().unwrap_or(T::ONE);
        let mut polynomial = [T::ZERO; 2 * super::MAX_ORDER];
        let entries = c.iter().copied().chain(k.iter().map(|k| last * *k));
        for (slot, entry) in polynomial.iter_mut().zip(entries) {
            *slot = entry;
        }
        crate::polynomial::require_hurwitz(polynomial.get(..N + K).unwrap_or(&[]))?;
        gain.fits(None)?;
        let ell = gain.fixed();
        let c = folded(&c, ell, |_| 1)?;
        Ok(Self { c, chain: StandardObserver { k: folded(&k, ell, |i| i + 1)?, gain, model } })
    }
}

impl<T, G, Md, const N: usize, const K: usize, const M: usize> ContinuousLaw<T>
    for FilteredObserver<T, G, Md, N, K, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: Model<T, N, M>,
{
    type State = FilteredState<T, G::Memory, N, K>;
    type Input = SVector<T, M>;
    type Innovation = T;
    const ESTIMATED: usize = N;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        FilteredState { r: self.chain.gain.initial(), ..FilteredState::zero() }
    }

    #[inline(always)]
    fn innovation(&self, z: &Self::State, y: T) -> T {
        y.innovation(z.x_hat[0])
    }

    #[inline(always)]
    fn rate(&self, t: T, z: &Self::State, e: &T, u: &Self::Input) -> Self::State {
        let FilteredState { x_hat, eta, r: m } = z;
        let r = self.chain.gain.moving(m, *e);
        let v = one_row(&self.chain.gain, m, *e);
        let speed = self.chain.gain.fixed() * r;
        let eta_rate = SVector::from_fn(|i, _| {
            if i + 1 < K {
                speed * eta[i + 1] - self.c[i] * r * eta[0] // (1)
            } else {
                self.c[i] * r * (v - eta[0])
            }
        });
        FilteredState {
            x_hat: self.chain.rate_under(t, x_hat, r, &SVector::from_element(eta[0]), u), // (2)
            eta: eta_rate,
            r: self.chain.gain.rate::<N>(m, *e),
        }
    }

    #[inline(always)]
    fn injection(&self, z: &Self::State, e: &T) -> Self::State {
        let r = self.chain.gain.moving(&z.r, *e);
        let v = one_row(&self.chain.gain, &z.r, *e);
        FilteredState {
            x_hat: SVector::zero(),
            eta: SVector::from_fn(|i, _| if i + 1 < K { T::ZERO } else { self.c[i] * r * v }),
            r: driven::<T, G, N>(&self.chain.gain, &z.r, *e),
        }
    }

    /// The chain of (2) is swept; the filter is not.
    #[inline(always)]
    fn stagger(&self, old: &Self::State, new: Self::State, dt: T) -> Self::State {
        FilteredState { x_hat: self.chain.staggered(&old.x_hat, new.x_hat, dt), ..new }
    }

    super::of_gain_and_estimate!(FilteredState, chain.gain, e in e);
}
