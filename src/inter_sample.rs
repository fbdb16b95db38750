//! Floor 1. The inter-sample predictor: between samples the output is predicted too, and a correction decays.
//!
//! Karafyllis and Kravaris, IEEE TAC 54 (2009) 2169. Between samples, with w(tₖ) = yₖ,
//!
//!   ẇ = x̂₂ + f̂₁,    x̂̇ = A x̂ + f̂ + Λ(ℓ)K (w − x̂₁)
//!
//! so that c = w − x̂₁ decays by itself, ċ = −k₁ℓ c. With a = k₁ℓ and f̂ moved by a [`Motion`], a step is
//!
//!   x̂⁺ = flow(x̂) + G c,    Gᵢ = Σⱼ kⱼℓʲ ∫₀ᵀ e^{−as} (T − s)ʲ⁻ⁱ/(j − i)! ds = Σⱼ kⱼℓʲ Tʲ⁻ⁱ⁺¹ φⱼ₋ᵢ₊₁(−aT)
//!
//! with φₘ(−h) = ∫₀¹ e^{−h(1−s)} sᵐ⁻¹/(m−1)! ds. The memory c becomes y − x̂₁ at a sample and goes on decaying
//! where one is missing: m periods without a sample are one step of the length mT. As T goes to 0 it is Euler's
//! method. A gain that moves is that of the step's beginning.

use crate::injection::OneChain;
use crate::memory::Memory;
use crate::motion::{Flow, Held, Motion};
use crate::observer::{ContinuousLaw, Observer, Status, Timing};
use crate::scalar::{Constant, Scalar};

/// A law under the inter-sample predictor, with predictor timing: its estimate moves on at a sample without a
/// jump. Its memory is the law's and c.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct InterSample<L, M = Held> {
    /// The law.
    pub law: L,
    /// How the known terms move.
    pub motion: M,
}

impl<T, L, M> Observer<T> for InterSample<L, M>
where
    T: Scalar,
    L: OneChain<T>
        + ContinuousLaw<T, Innovation: Memory<T>>
        + Flow<T, <L as ContinuousLaw<T>>::State, <L as ContinuousLaw<T>>::Input>,
    M: Motion,
{
    type State = (L::State, L::Innovation);
    type Measurement = T;
    type Input = L::Input;
    const TIMING: Timing = Timing::Predictor;
    const ESTIMATED: usize = L::ESTIMATED;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        (self.law.initial(), Memory::zero())
    }

    #[inline(always)]
    fn advance(&self, z: &mut Self::State, y: &T, u: &L::Input, t: T, dt: T) -> Status {
        let (law, (before, kept)) = (&self.law, *z);
        let c = law.innovation(&before, *y).zip(&kept, |e, kept| e + kept.while_missing(*y));
        let begin = law.jumped(before, &c);
        let (moves, left) = law.decaying(&begin, &c, dt);
        let moved = self.motion.moved(law, t, &begin, u, dt).plus(T::ONE, &moves);
        *z = (before.zip(&law.admissible(moved), |_, new| new), left);
        Status::of(y)
    }

    #[inline(always)]
    fn speed(&self, (z, _): &Self::State) -> T {
        self.law.speed(z)
    }

    #[inline(always)]
    fn estimate<'a>(&self, (z, _): &'a Self::State) -> &'a [T] {
        self.law.estimate(z)
    }

    #[inline(always)]
    fn innovation(&self, _: T, (z, _): &Self::State, y: &T, _: &L::Input) -> T {
        self.law.estimate(z).first().map_or(*y, |x1| *y - *x1)
    }
}

/// From this h on e⁻ʰ is nothing beside 1.
const GONE: f64 = 50.0;

/// 1/m! for m from 0 on.
const fn over_factorials<const N: usize>() -> [Constant; N] {
    let (mut over, mut made, mut m) = ([Constant::new(1.0); N], 1.0, 1);
    while m < N {
        made /= m as f64;
        over[m] = Constant::new(made);
        m += 1;
    }
    over
}

/// φ₀(−h) = e⁻ʰ, and φ₁ … φ_N for h ≥ 0: by a series at h/128, doubled seven times, where all terms are
/// positive; beyond [`GONE`] from φₘ₊₁(−h) = (1/m! − φₘ(−h))/h.
#[inline(always)]
pub(crate) fn phi<T: Scalar, const N: usize>(h: T) -> (T, [T; N]) {
    let over = const { over_factorials::<N>() }.map(T::constant);
    let x = h.min(T::from_f64(GONE)) * T::from_f64(1.0 / 128.0);
    let mut series = T::ONE;
    for over in const { Constant::reciprocals::<12>(N + 1) }.into_iter().rev() {
        series = T::ONE - series * x * T::constant(over);
    }
    let mut phi = [T::ZERO; N];
    let mut below = series * T::from_f64(1.0 / N as f64);
    for m in (0..N).rev() {
        phi[m] = if m + 1 == N { below * over[m] } else { below };
        below = over[m] - x * phi[m];
    }
    let mut zeroth = below;
    for _ in 0..7 {
        let old = phi;
        let mut half = T::from_f64(0.5);
        for m in 0..N {
            let mut sum = zeroth * old[m];
            for j in 0..=m {
                sum += old[j] * over[m - j];
            }
            phi[m] = sum * half;
            half *= T::from_f64(0.5);
        }
        zeroth *= zeroth;
    }
    let far = T::from_f64(GONE);
    let mut beyond = T::ZERO;
    for m in 0..N {
        beyond = (over[m] - beyond) / h.max(far);
        phi[m] = h.where_above(far, beyond, phi[m]);
    }
    (h.where_above(far, T::ZERO, zeroth), phi)
}
