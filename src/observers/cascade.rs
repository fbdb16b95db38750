//! A cascade of a differentiator of order two and a filter for each further derivative.
//!
//!   x̂̇₁ = x̄₂ + k₁ ℓ e,   x̄̇₂ = k₂ ℓ² e,   e = y − x̂₁                                            (1)
//!   ẇᵢ = βᵢ ℓ (x̂ᵢ₋₁ − wᵢ)                                    i = 3 … n                           (2)
//!   x̂₂ = sat(x̄₂),   x̂ᵢ = sat(βᵢ ℓ (x̂ᵢ₋₁ − wᵢ))                                                  (3)
//!
//! No power of ℓ above the second, and with levels Mᵢ ≥ max |xᵢ| no estimate above its level, however large
//! ℓ. Nothing is known of the system. Unsaturated, x̂ᵢ is y through k₂ℓ²s/(s² + k₁ℓs + k₂ℓ²) and a filter
//! βℓs/(s + βℓ) for each further derivative.
//!
//! Khalil, Automatica 80 (2017) 110.

use super::{checked, driven, folded, one_row};
use crate::Scalar;
use crate::error::{DesignError, positive, require};
use crate::gain::GainLaw;
use crate::laws::Sizes;
use crate::memory::{AllButLast, Memory};
use crate::observer::ContinuousLaw;
use crate::saturation::Saturation;
use nalgebra::{SVector, Vector2};

crate::memory_struct! {
    /// Memory of a cascade.
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    pub struct CascadeState<T, R: Memory; const N: usize> {
        /// Estimate: x̂₁, and what (3) makes of the states behind it.
        pub x_hat: SVector<T, N>,
        /// x̄₂, w₃ … wₙ.
        pub behind: AllButLast<T, N>,
        /// The gain law's memory: r where the gain moves, else nothing.
        pub r: R,
    }
}

/// Differentiator and N − 2 filters, saturation S. It takes M inputs and uses none.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CascadeObserver<T, G, S, const N: usize, const M: usize = 0> {
    /// k₁ ℓ and k₂ ℓ², ℓ the fixed part of the gain.
    k: Vector2<T>,
    /// βᵢ ℓ of i = 3 … N; the last two slots are 0.
    beta: SVector<T, N>,
    gain: G,
    saturation: S,
}

crate::error::through_constructor! {
    [T: Scalar, G: GainLaw<T>, S: Saturation<T>, const N: usize, const M: usize]
    CascadeObserver<T, G, S, N, M>: observer => {
        k: Vector2<T> = super::unfolded(&observer.k, observer.gain.fixed(), |i| i + 1),
        beta: SVector<T, N> = super::unfolded(&observer.beta, observer.gain.fixed(), |_| 1),
        gain: G = observer.gain,
        saturation: S = observer.saturation,
    }
    => Self::new(k.into(), beta.into(), gain, saturation)
}

/// k₁, k₂, then βᵢ, from n poles, of which two at most are no real numbers: see
/// [`crate::laws::Design::place`].
///
/// # Errors
/// A second complex pair; as [`crate::polynomial::coefficients_from_poles`].
pub fn cascade_from_poles(
    _: &Sizes,
    poles: &[(f64, f64)],
    out: &mut [f64],
) -> Result<(), DesignError> {
    let complex = |(_, im): &&(f64, f64)| *im != 0.0;
    let allowed = "at most two poles of a cascade may be complex, those of its differentiator; the poles \
                   of its filters are real";
    let count = poles.iter().filter(complex).count();
    require("poles", count as f64, count <= 2, allowed)?;
    let (mut pair, mut taken) = ([(0.0, 0.0); 2], 0);
    let (k, beta) = out.split_at_mut(out.len().min(2));
    let mut filters = beta.iter_mut();
    for pole in poles.iter().filter(complex).chain(poles.iter().filter(|pole| !complex(pole))) {
        if let Some(slot) = pair.get_mut(taken) {
            (*slot, taken) = (*pole, taken + 1);
        } else if let Some(slot) = filters.next() {
            *slot = -pole.0;
        }
    }
    crate::polynomial::write_coefficients(&pair, k)
}

impl<T, G, S, const N: usize, const M: usize> CascadeObserver<T, G, S, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    S: Saturation<T>,
{
    /// Coefficients k of (1) and β₃ … β_N of (2) (the last two entries are not used), gain law, saturation.
    ///
    /// # Errors
    /// N outside 2 to 12; a coefficient that is not finite or ≤ 0; a gain whose square is too large or too
    /// small for the precision.
    pub fn new(k: [T; 2], mut beta: [T; N], gain: G, saturation: S) -> Result<Self, DesignError> {
        super::from_second_order::<N>()?;
        for entry in k {
            positive("k", entry)?;
        }
        for (i, entry) in beta.iter_mut().enumerate() {
            if i + 2 < N {
                positive("beta", *entry)?;
            } else {
                *entry = T::ZERO;
            }
        }
        gain.fits(None, None)?;
        let ell = gain.fixed();
        let k = folded(&checked("k", k)?, ell, |i| i + 1)?;
        let beta = folded(&checked("beta", beta)?, ell, |_| 1)?;
        Ok(Self { k, beta, gain, saturation })
    }

    /// (3).
    #[inline(always)]
    fn shown(&self, z: &CascadeState<T, G::Memory, N>) -> SVector<T, N> {
        let (speed, mut x_hat) = (self.gain.speed(&z.r), z.x_hat);
        for i in 1..N {
            let value = if i == 1 {
                z.behind[0]
            } else {
                self.beta[i - 2] * speed * (x_hat[i - 1] - z.behind[i - 1])
            };
            x_hat[i] = self.saturation.apply(i - 1, value);
        }
        x_hat
    }
}

impl<T, G, S, const N: usize, const M: usize> ContinuousLaw<T> for CascadeObserver<T, G, S, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    S: Saturation<T>,
{
    type State = CascadeState<T, G::Memory, N>;
    type Input = SVector<T, M>;
    type Innovation = T;
    const ESTIMATED: usize = N;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        CascadeState { r: self.gain.initial(), ..CascadeState::zero() }
    }

    #[inline(always)]
    fn innovation(&self, z: &Self::State, y: T) -> T {
        y.innovation(z.x_hat[0])
    }

    #[inline(always)]
    fn rate(&self, _: T, z: &Self::State, e: &T, _: &Self::Input) -> Self::State {
        let (mut rate, speed) = (self.injection(z, e), self.gain.speed(&z.r));
        let x_hat = self.shown(z);
        rate.x_hat[0] += z.behind[0]; // (1)
        for i in 1..N - 1 {
            rate.behind[i] = self.beta[i - 1] * speed * (x_hat[i] - z.behind[i]); // (2)
        }
        rate.r = self.gain.rate::<N>(&z.r, *e);
        rate
    }

    #[inline(always)]
    fn injection(&self, z: &Self::State, e: &T) -> Self::State {
        let r = self.gain.moving(&z.r, *e);
        let v = one_row(&self.gain, &z.r, *e);
        let mut rate =
            CascadeState { r: driven::<T, G, N>(&self.gain, &z.r, *e), ..Self::State::zero() };
        rate.x_hat[0] = self.k[0] * r * v;
        rate.behind[0] = self.k[1] * (r * r) * v;
        rate
    }

    /// x̂₁ is moved by the new x̄₂; the filters lie below it.
    #[inline(always)]
    fn stagger(&self, old: &Self::State, mut new: Self::State, dt: T) -> Self::State {
        new.x_hat[0] += dt * (new.behind[0] - old.behind[0]);
        new
    }

    /// With its estimate shown anew.
    #[inline(always)]
    fn admissible(&self, z: Self::State) -> Self::State {
        let z = CascadeState { r: self.gain.admissible(z.r), ..z };
        CascadeState { x_hat: self.shown(&z), ..z }
    }

    super::of_gain_and_estimate!(shown CascadeState, gain, e in e);
}
