//! The high-gain observer of limited gain power: no coefficient above ℓ², 2n − 2 states.
//!
//! n − 1 blocks (pᵢ, qᵢ) of order two; block i estimates (xᵢ, xᵢ₊₁), f̂ is what is known of the system:
//!
//!   ṗᵢ = qᵢ + f̂ᵢ + αᵢ ℓ eᵢ                 e₁ = y − p₁,   eᵢ = sat(qᵢ₋₁) − pᵢ                      (1)
//!   q̇ᵢ = sat(qᵢ₊₁) + f̂ᵢ₊₁ + βᵢ ℓ² eᵢ       i = 1 … n−1,   qₙ = 0                                 (2)
//!
//! f̂ takes the estimate x̂ = (p₁ … pₙ₋₁, qₙ₋₁), which has less of the noise than (p₁, q₁ … qₙ₋₁). `sat` is
//! the identity, or a saturation that bounds what a block hands on in the transient.
//!
//! Astolfi and Marconi, IEEE TAC 60 (2015) 3059; triangular f̂: Wang, Astolfi, Marconi and Su, Automatica 75
//! (2017) 16. It is the low-power observer of [`super::LowPower`] without its last block, x̂ₙ = ηₙ₋₁.

use super::{checked, driven, folded, one_row};
use crate::Scalar;
use crate::error::{DesignError, positive};
use crate::gain::GainLaw;
use crate::laws::Sizes;
use crate::memory::{AllBut, Memory};
use crate::model::Model;
use crate::observer::ContinuousLaw;
use crate::saturation::Saturation;
use nalgebra::SVector;

crate::memory_struct! {
    /// Memory of an observer of limited gain power.
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    pub struct LimitedGainState<T, R: Memory; const N: usize> {
        /// Estimate: p₁ … pₙ₋₁, qₙ₋₁.
        pub x_hat: SVector<T, N>,
        /// q₁ … qₙ₋₂, which estimate x₂ … xₙ₋₁ too.
        pub eta: AllBut<T, N, 2>,
        /// The gain law's memory: r where the gain moves, else nothing.
        pub r: R,
    }
}

/// N − 1 blocks, saturation S.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LimitedGain<T, G, Md, S, const N: usize, const M: usize = 0> {
    /// αᵢ ℓ, ℓ the fixed part of the gain.
    alpha: SVector<T, N>,
    /// βᵢ ℓ².
    beta: SVector<T, N>,
    gain: G,
    model: Md,
    saturation: S,
}

crate::error::through_constructor! {
    [T: Scalar, G: GainLaw<T>, Md: Model<T, N, M>, S: Saturation<T>, const N: usize, const M: usize]
    LimitedGain<T, G, Md, S, N, M>: observer => {
        alpha: SVector<T, N> = super::unfolded(&observer.alpha, observer.gain.fixed(), |_| 1),
        beta: SVector<T, N> = super::unfolded(&observer.beta, observer.gain.fixed(), |_| 2),
        gain: G = observer.gain,
        model: Md = observer.model,
        saturation: S = observer.saturation,
    }
    => Self::new(alpha.into(), beta.into(), gain, model, saturation)
}

/// α, then β, from 2n − 2 poles: see [`crate::laws::Design::place`].
///
/// # Errors
/// As [`crate::polynomial::write_block_coefficients`].
pub fn limited_from_poles(
    _: &Sizes,
    poles: &[(f64, f64)],
    out: &mut [f64],
) -> Result<(), DesignError> {
    let (alpha, beta) = out.split_at_mut(out.len() / 2);
    crate::polynomial::write_block_coefficients(poles, alpha, beta)
}

impl<T, G, Md, S, const N: usize, const M: usize> LimitedGain<T, G, Md, S, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: Model<T, N, M>,
    S: Saturation<T>,
{
    /// Coefficients α and β (N − 1 each; the last entries are not used), gain law, model, saturation.
    ///
    /// # Errors
    /// A coefficient that is not finite, an αᵢ or βᵢ ≤ 0; N outside 2 to 12; a characteristic polynomial
    /// that is not Hurwitz; a gain whose square is too large or too small for the precision.
    pub fn new(
        mut alpha: [T; N],
        mut beta: [T; N],
        gain: G,
        model: Md,
        saturation: S,
    ) -> Result<Self, DesignError> {
        super::from_second_order::<N>()?;
        if let (Some(alpha), Some(beta)) = (alpha.last_mut(), beta.last_mut()) {
            (*alpha, *beta) = (T::ONE, T::ZERO); // a last block would be stable
        }
        let (alpha, beta) = (checked("alpha", alpha)?, checked("beta", beta)?);
        for i in 0..N - 1 {
            positive("alpha", alpha[i])?;
            positive("beta", beta[i])?;
        }
        crate::polynomial::require_low_power_hurwitz(alpha.as_slice(), beta.as_slice())?;
        gain.fits(None, None)?;
        let ell = gain.fixed();
        let (alpha, beta) = (folded(&alpha, ell, |_| 1)?, folded(&beta, ell, |_| 2)?);
        Ok(Self { alpha, beta, gain, model, saturation })
    }

    /// qᵢ of slot i; the last one stands with the estimate.
    #[inline(always)]
    fn q(z: &LimitedGainState<T, G::Memory, N>, i: usize) -> T {
        if i + 2 == N { z.x_hat[i + 1] } else { z.eta[i] }
    }

    /// What q of slot i stands for in a rate: the last one as the model has it [enter](Model::enters).
    #[inline(always)]
    fn above(&self, t: T, x_hat: &SVector<T, N>, (i, q): (usize, T), u: &SVector<T, M>) -> T {
        if self.model.carries() && i + 2 == N { self.model.enters(t, x_hat, q, u) } else { q }
    }

    /// By how much the state before moves faster where slot i grows: see [`Model::slope`].
    #[inline(always)]
    fn moves(&self, x_hat: &SVector<T, N>, i: usize, grown: T) -> T {
        if i + 2 == N { grown * self.model.slope(x_hat) } else { grown }
    }
}

impl<T, G, Md, S, const N: usize, const M: usize> ContinuousLaw<T>
    for LimitedGain<T, G, Md, S, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: Model<T, N, M>,
    S: Saturation<T>,
{
    type State = LimitedGainState<T, G::Memory, N>;
    type Input = SVector<T, M>;
    type Innovation = T;
    const ESTIMATED: usize = N;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        LimitedGainState { r: self.gain.initial(), ..LimitedGainState::zero() }
    }

    #[inline(always)]
    fn innovation(&self, z: &Self::State, y: T) -> T {
        y.innovation(z.x_hat[0])
    }

    #[inline(always)]
    fn rate(&self, t: T, z: &Self::State, e1: &T, u: &Self::Input) -> Self::State {
        let (x_hat, f) = (&z.x_hat, self.model.f_hat(t, &z.x_hat, u));
        let r = self.gain.moving(&z.r, *e1);
        let v = one_row(&self.gain, &z.r, *e1);
        let (mut x_rate, mut q_rate) = (f, AllBut::zero());
        for i in 0..N - 1 {
            let e = if i == 0 { v } else { self.saturation.apply(i - 1, z.eta[i - 1]) - x_hat[i] };
            x_rate[i] = self.above(t, x_hat, (i, Self::q(z, i)), u) + f[i] + self.alpha[i] * r * e; // (1)
            let injected = self.beta[i] * (r * r) * e; // (2)
            if i + 2 == N {
                x_rate[i + 1] = f[i + 1] + injected / self.model.slope(x_hat);
            } else {
                let above = self.saturation.apply(i + 1, Self::q(z, i + 1));
                q_rate[i] = self.above(t, x_hat, (i + 1, above), u) + f[i + 1] + injected;
            }
        }
        let r = self.gain.rate::<N>(&z.r, *e1);
        LimitedGainState { x_hat: x_rate, eta: q_rate, r }
    }

    #[inline(always)]
    fn injection(&self, z: &Self::State, e1: &T) -> Self::State {
        let r = self.gain.moving(&z.r, *e1);
        let v = one_row(&self.gain, &z.r, *e1);
        let (mut x_hat, mut eta): (SVector<T, N>, AllBut<T, N, 2>) = Memory::zero();
        x_hat[0] = self.alpha[0] * r * v;
        let injected = self.beta[0] * (r * r) * v;
        if N == 2 {
            x_hat[1] = injected / self.model.slope(&z.x_hat);
        } else {
            eta[0] = injected;
        }
        let r = driven::<T, G, N>(&self.gain, &z.r, *e1);
        LimitedGainState { x_hat, eta, r }
    }

    #[inline(always)]
    fn stagger(&self, old: &Self::State, mut new: Self::State, dt: T) -> Self::State {
        for i in (1..N - 1).rev() {
            let passed = |z: &Self::State| self.saturation.apply(i, Self::q(z, i));
            let moved = passed(&new) - passed(old);
            new.eta[i - 1] += dt * self.moves(&old.x_hat, i, moved);
        }
        for i in 0..N - 1 {
            let moved = Self::q(&new, i) - Self::q(old, i);
            new.x_hat[i] += dt * self.moves(&old.x_hat, i, moved);
        }
        new
    }

    super::of_gain_and_estimate!(LimitedGainState, gain, e in e);
}
