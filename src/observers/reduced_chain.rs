//! The reduced-order high-gain observer of a chain: x₁ = y is measured and not estimated.
//!
//!   x̂₁ = y,   x̂ᵢ₊₁ = ηᵢ + kᵢ ℓⁱ y                                 i = 1 … m,   m = n − 1              (1)
//!   η̇ᵢ = x̂ᵢ₊₂ + f̂ᵢ₊₁ − kᵢ ℓⁱ (x̂₂ + f̂₁)                            x̂ₙ₊₁ = 0                           (2)
//!
//! For n = 2 it is the dirty derivative k₁ℓs/(s + k₁ℓ). The sample passes through: noise reaches x̂₂ with
//! k₁ℓ at any frequency, and the law has current timing by nature.
//!
//! It is written without η. Between samples the chain moves by itself, and a sample takes x̂₁ to y:
//!
//!   x̂̇ = A x̂ + f̂,   then   x̂ᵢ₊₁ += kᵢ ℓⁱ e,   x̂₁ += e,   e = y − x̂₁                                (3)
//!
//! By forward Euler that is (1), (2) by forward Euler, for x̂ᵢ₊₁ − kᵢ ℓⁱ x̂₁ = ηᵢ moves by (2) alone and no
//! sample moves it. (3) says besides what a missing sample is: e = 0.
//!
//! Esfandiari and Khalil, Int. J. Control 56 (1992) 1007; Khalil and Praly, Int. J. Robust Nonlinear Control
//! 24 (2014) 993. Another reduced-order law is [`super::ReducedOrderObserver`], of sampled strict-feedback
//! systems with as many outputs as unmeasured states; for n = 2 and one output the two agree.

use super::{StandardObserver, StandardState, chain, checked, folded};
use crate::Scalar;
use crate::error::DesignError;
use crate::gain::{ConstantGain, GainLaw};
use crate::memory::Memory;
use crate::model::Model;
use crate::observer::ContinuousLaw;
use nalgebra::SVector;

/// Reduced-order observer of a chain of N states with M known inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ReducedChainObserver<T, Md, const N: usize, const M: usize = 0> {
    /// The chain, its coefficients 1, k₁ ℓ, …, kₘ ℓᵐ.
    chain: StandardObserver<T, ConstantGain<T>, Md, N, M>,
}

crate::error::through_constructor! {
    [T: Scalar, Md: Model<T, N, M>, const N: usize, const M: usize]
    ReducedChainObserver<T, Md, N, M>: observer => {
        k: SVector<T, N> = observer.k(),
        gain: ConstantGain<T> = observer.chain.gain,
        model: Md = observer.chain.model,
    }
    => Self::new(k.into(), gain, model)
}

impl<T, Md, const N: usize, const M: usize> ReducedChainObserver<T, Md, N, M>
where
    T: Scalar,
    Md: Model<T, N, M>,
{
    /// Coefficients k (N − 1; sᵐ + k₁ sᵐ⁻¹ + … + kₘ Hurwitz; the last entry is not used), gain, model.
    ///
    /// # Errors
    /// A coefficient that is not finite; N outside 2 to 12; a polynomial that is not Hurwitz; a gain whose
    /// power N − 1 is too large or too small for the precision.
    pub fn new(k: [T; N], gain: ConstantGain<T>, model: Md) -> Result<Self, DesignError> {
        super::from_second_order::<N>()?;
        let k = checked("k", k)?;
        crate::polynomial::require_hurwitz(k.as_slice().get(..N - 1).unwrap_or(&[]))?;
        let mut below: SVector<T, N> = SVector::from_element(T::ONE);
        for i in 1..N {
            below[i] = k[i - 1];
        }
        Ok(Self {
            chain: StandardObserver { k: folded(&below, gain.fixed(), |i| i)?, gain, model },
        })
    }

    #[cfg(feature = "serde")]
    fn k(&self) -> SVector<T, N> {
        let below: SVector<T, N> = super::unfolded(&self.chain.k, self.chain.gain.fixed(), |i| i);
        SVector::from_fn(|i, _| if i + 1 < N { below[i + 1] } else { T::ZERO })
    }
}

impl<T, Md, const N: usize, const M: usize> ContinuousLaw<T> for ReducedChainObserver<T, Md, N, M>
where
    T: Scalar,
    Md: Model<T, N, M>,
{
    type State = StandardState<T, (), N>;
    type Input = SVector<T, M>;
    type Innovation = T;
    const ESTIMATED: usize = N;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        Self::State::zero()
    }

    #[inline(always)]
    fn innovation(&self, z: &Self::State, y: T) -> T {
        y.innovation(z.x_hat[0])
    }

    #[inline(always)]
    fn rate(&self, t: T, z: &Self::State, _: &T, u: &Self::Input) -> Self::State {
        let carries = self.chain.model.carries();
        StandardState { x_hat: chain(&z.x_hat, carries) + self.chain.known(t, &z.x_hat, u), r: () }
    }

    /// Nothing: a sample acts at once.
    #[inline(always)]
    fn injection(&self, _: &Self::State, _: &T) -> Self::State {
        Self::State::zero()
    }

    #[inline(always)]
    fn stagger(&self, old: &Self::State, new: Self::State, dt: T) -> Self::State {
        StandardState { x_hat: self.chain.staggered(&old.x_hat, new.x_hat, dt), r: () }
    }

    #[inline(always)]
    fn jumped(&self, z: Self::State, e: &T) -> Self::State {
        StandardState { x_hat: z.x_hat + self.chain.in_unit(&z.x_hat, self.chain.k * *e), r: () } // (3)
    }

    #[inline(always)]
    fn speed(&self, _: &Self::State) -> T {
        T::ONE
    }

    #[inline(always)]
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [T] {
        z.x_hat.as_slice()
    }
}
