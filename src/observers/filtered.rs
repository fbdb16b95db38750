//! The standard observer behind a filter of its innovation.
//!
//! m filter states η in front of the chain of n, e = y − x̂₁ and f̂ what is known of the system:
//!
//!   η̇ᵢ = ℓ (ηᵢ₊₁ − cᵢ rⁱ η₁)                    i = 1 … m−1,     η̇ₘ = cₘ ℓ (e − rᵐ η₁)    (1)
//!   x̂̇ⱼ = x̂ⱼ₊₁ + f̂ⱼ(x̂, u, t) + kⱼ ℓʲ rᵐ⁺ʲ η₁     j = 1 … n,       x̂ₙ₊₁ = 0                  (2)
//!
//! with a gain ℓ that is fixed, times r = 1 where nothing moves it. At r = 1
//! e passes cₘ/(σᵐ + c₁σᵐ⁻¹ + … + cₘ), σ = s/ℓ, a low-pass filter of gain 1 at rest. With kⱼ = cₘ₊ⱼ/cₘ the
//! poles are ℓ times the roots of sⁿ⁺ᵐ + c₁sⁿ⁺ᵐ⁻¹ + … + cₙ₊ₘ, and each state has less of the noise by m more
//! integrations. The innovation is filtered and not y, so that x̂ = x, η = 0 remains a solution.
//!
//! Filters of the output error in front of a high-gain observer: Tréangle, Farza and M'Saad, Automatica 101
//! (2019); Astolfi, Zaccarian and Jungers, Systems & Control Letters 148 (2021) 104856. In their coordinates
//! wᵢ = −ηᵢ/(cₘℓᵐ⁺¹⁻ⁱ) are the states of a companion form, ẇᵢ = wᵢ₊₁ − cᵢ(ℓr)ⁱw₁, ẇₘ = x̂₁ − y − cₘ(ℓr)ᵐw₁,
//! from which (1), (2) come by scaling.
//!
//! A homogeneous gain sees −w₁ in the place of e: with degree −1 this is Levant's filtering differentiator,
//! Levant and Livne, European J. Control 55 (2020), of order n + m with its coefficients cᵢ, cₘkⱼ. Its
//! discretisation is [`Proper`](crate::injection::Proper): the chain w, x̂ moves exactly under y held.

use super::{StandardObserver, chain, checked, driven, folded, one_row};
use crate::Scalar;
use crate::error::DesignError;
use crate::gain::GainLaw;
use crate::injection::ahead;
use crate::laws::Sizes;
use crate::memory::Memory;
use crate::model::Model;
use crate::motion::Flow;
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
        gain.fits(Some(N + K), None)?;
        let ell = gain.fixed();
        let c = folded(&c, ell, |_| 1)?;
        Ok(Self { c, chain: StandardObserver { k: folded(&k, ell, |i| i + 1)?, gain, model } })
    }

    /// r, and rⁱ η₁, i = 1 … m.
    #[inline(always)]
    fn powers(&self, z: &FilteredState<T, G::Memory, N, K>, e: T) -> (T, SVector<T, K>) {
        let gain = &self.chain.gain;
        let unit = gain.fixed().powi(K - 1) * self.c[K - 1]; // cₘ ℓᵐ
        let r = gain.moving(&z.r, gain.seen(e, z.eta[0] / unit));
        let mut power = z.eta[0];
        let powers = SVector::from_fn(|_, _| {
            power *= r;
            power
        });
        (r, powers)
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
        let (r, powers) = self.powers(z, *e);
        let v = one_row(&self.chain.gain, m, *e);
        let eta_rate = SVector::from_fn(|i, _| {
            if i + 1 < K {
                self.chain.gain.fixed() * eta[i + 1] - self.c[i] * powers[i] // (1)
            } else {
                self.c[i] * (v - powers[i])
            }
        });
        FilteredState {
            x_hat: self.chain.rate_under(t, x_hat, r, &SVector::from_element(powers[K - 1]), u), // (2)
            eta: eta_rate,
            r: self.chain.gain.rate::<N>(m, *e),
        }
    }

    #[inline(always)]
    fn injection(&self, z: &Self::State, e: &T) -> Self::State {
        let v = one_row(&self.chain.gain, &z.r, *e);
        FilteredState {
            x_hat: SVector::zero(),
            eta: SVector::from_fn(|i, _| if i + 1 < K { T::ZERO } else { self.c[i] * v }),
            r: driven::<T, G, N>(&self.chain.gain, &z.r, *e),
        }
    }

    /// What η₁ injects.
    #[inline(always)]
    fn kick(&self, z: &Self::State, e: &T) -> Self::State {
        let (r, powers) = self.powers(z, *e);
        FilteredState {
            x_hat: self.chain.injected(&z.x_hat, r, &SVector::from_element(powers[K - 1])),
            eta: SVector::from_fn(|i, _| -(self.c[i] * powers[i])),
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

/// Memory of an observer under the gain law G.
type Moved<T, G, const N: usize, const K: usize> =
    FilteredState<T, <G as GainLaw<T>>::Memory, N, K>;

/// The chain w, x̂ without what η₁ injects. Without a sample y is taken to be x̂₁ all the time.
impl<T, G, Md, const N: usize, const K: usize, const M: usize>
    Flow<T, Moved<T, G, N, K>, SVector<T, M>> for FilteredObserver<T, G, Md, N, K, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: Model<T, N, M>,
{
    type Terms = SVector<T, N>;

    #[inline(always)]
    fn terms(&self, t: T, z: &Moved<T, G, N, K>, u: &SVector<T, M>) -> Self::Terms {
        self.chain.known(t, &z.x_hat, u)
    }

    #[inline(always)]
    fn flow(&self, z: &Moved<T, G, N, K>, f: &Self::Terms, dt: T) -> Moved<T, G, N, K> {
        self.flow_under(z, T::from_f64(f64::NAN), f, dt)
    }

    #[inline(always)]
    fn flow_under(&self, z: &Moved<T, G, N, K>, y: T, f: &Self::Terms, dt: T) -> Moved<T, G, N, K> {
        let gain = &self.chain.gain;
        let rate = chain(&z.x_hat, self.chain.model.carries()) + f;
        let present = |rate: T| rate - rate.while_missing(y);
        let v = one_row(gain, &z.r, y.innovation(z.x_hat[0]));
        // η₂ … ηₘ, then e and its derivatives: what moves η₁ … ηₘ, one after the other
        let above = |i: usize| match i + 1 {
            next if next < K => z.eta[next] * gain.fixed(),
            next if next == K => self.c[K - 1] * v,
            next => -(self.c[K - 1] * present(rate[next - K - 1])),
        };
        let eta = SVector::from_fn(|i, _| {
            let mut moved = T::NEG_ZERO;
            for m in (0..K - i + N).rev() {
                let step = dt * T::from_f64(1.0 / (m as f64 + 1.0));
                let inner = if i + m + 1 < K { moved * gain.fixed() } else { moved };
                moved = (above(i + m) + inner) * step;
            }
            z.eta[i] + moved
        });
        let r = z.r.plus(dt, &gain.rate::<N>(&z.r, T::ZERO));
        FilteredState { x_hat: ahead(&z.x_hat, &rate, dt), eta, r }
    }

    #[inline(always)]
    fn chain(&self, delta: &SVector<T, N>) -> Self::Terms {
        chain(delta, self.chain.model.carries())
    }

    #[inline(always)]
    fn shifted(&self, z: &Moved<T, G, N, K>, delta: &SVector<T, N>) -> Moved<T, G, N, K> {
        FilteredState { x_hat: z.x_hat + delta, ..*z }
    }
}
