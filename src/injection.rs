//! Floor 1. Predict by the exact chain, then correct by gains that place the eigenvalues of the error:
//! discretisations that are stable at any ℓT.
//!
//! Over a step the chain of integrators is solved exactly. What is known beside it is held, or moves on
//! ([`crate::motion`]):
//!
//!   x̂⁻(k+1) = e^{AT} x̂⁺(k) + ∫₀ᵀ e^{As} ds f̂(x̂⁺(k), u(k), t)
//!
//! A sample corrects, x̂⁺ = x̂⁻ + K (y − x̂₁⁻), with the one K that gives the error matrix (I − K C) e^{AT}
//! the eigenvalues zᵢ = e^{Tλᵢ}, λᵢ those of the continuous law ([`Placement::Exact`]: from sample to sample
//! the error decays by the same eigenvalues as in continuous time), or the places to which the bilinear rule
//! takes them, zᵢ = (2 + Tλᵢ)/(2 − Tλᵢ) ([`Placement::Bilinear`]; Dabroom and Khalil, Int. J. Control 72
//! (1999)), or those of backward Euler, zᵢ = 1/(1 − Tλᵢ) ([`Placement::ImplicitMap`]). All lie within the unit
//! circle for every T > 0. With a gain that moves with e, the first is the matched discretisation of Koch,
//! Reichhartinger, Horn and Fridman, IEEE TAC 65 (2020) 757.
//!
//! K has a closed form. κ(τ) = K₁ + K₂ τ + … + Kₙ τⁿ⁻¹/(n−1)! is by how much a unit innovation moves the
//! prediction a time τ ahead, so that Σⱼ κ(jT) z⁻ʲ = Π(z − zᵢ)/(z − 1)ⁿ − 1. With δ = (z − 1)/T and
//! Π(δ − δᵢ) = δⁿ + d₁δⁿ⁻¹ + … + dₙ the right side is Σᵣ dᵣ δ⁻ʳ, and (z − 1)⁻ʳ = Σⱼ (j−1 over r−1) z⁻ʲ:
//!
//!   κ(τ) = T { d₁ + d₂ (τ − T) + d₃ (τ − T)(τ − 2T)/2! + … + dₙ (τ − T) … (τ − (n−1)T)/(n−1)! }
//!
//! As T goes to 0, δᵢ goes to λᵢ, dᵢ to kᵢℓⁱ and Kᵢ to T kᵢℓⁱ: forward Euler.

use crate::error::{DesignError, require};
use crate::memory::Memory;
use crate::motion::{Flow, Held, Motion, UnderSample};
use crate::observer::{ContinuousLaw, Scheme, StaggeredEuler, absent};
use crate::polynomial::{roots, times_root};
use crate::scalar::{Constant, Scalar};
use nalgebra::SVector;

/// Where in the unit circle the eigenvalues of the error lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Placement {
    /// e^{Tλ}: where the continuous law has them.
    Exact,
    /// (2 + Tλ)/(2 − Tλ).
    Bilinear,
    /// 1/(1 − Tλ).
    ImplicitMap,
}

impl Placement {
    /// Refuse an order above `most` under the bilinear rule, which takes all eigenvalues to −1 as ℓT grows:
    /// there, rounding moves a bundle of them out of the unit circle. `most` is the highest order at which
    /// one rounding of the gains in double precision, at ℓT = 100, changes the response of the error by
    /// less than 5e-5 of its largest value. Exact placement keeps 1e-9 up to order 12. `by_map` is the highest
    /// order under [`Self::ImplicitMap`].
    pub(crate) fn hold<const N: usize>(
        self,
        most: usize,
        by_map: usize,
    ) -> Result<(), DesignError> {
        let allowed = "method bilinear gathers the eigenvalues at -1 for long steps, where rounding \
                       moves those of high orders out of the unit circle: at most 6 (standard) or 4 \
                       (low-power, peaking-free); choose method zoh";
        let mapped = "the gains of a low-power law under method implicit-map are found up to order 5; choose \
                      method zoh";
        require("n", N as f64, self != Self::ImplicitMap || N <= by_map, mapped)?;
        let holds = self != Self::Bilinear || N <= most;
        require("n", N as f64, holds, allowed).map(|_| ())
    }

    /// z − 1 for hλ = a + ib.
    #[inline(always)]
    pub fn shift<T: Scalar>(self, (a, b): (T, T)) -> (T, T) {
        let two = T::from_f64(2.0);
        match self {
            Self::Exact => {
                // where nothing is left of eᵃ no angle counts, however large: 1, or 0
                let b = b * T::ONE.copysign(a - T::from_f64(GONE)).max(T::ZERO);
                let (grown, half) = (exp_m1(a), (T::from_f64(0.5) * b).sin());
                (grown * b.cos() - two * half * half, (grown + T::ONE) * b.sin())
            }
            Self::Bilinear => {
                let square = (two - a) * (two - a) + b * b;
                (two * (a * (two - a) - b * b) / square, two * two * b / square)
            }
            Self::ImplicitMap => {
                let square = (T::ONE - a) * (T::ONE - a) + b * b;
                ((a * (T::ONE - a) - b * b) / square, b / square)
            }
        }
    }

    /// d₁ … dₙ of Π(δ − δᵢ), δ = (z − 1)/T, for the poles λᵢ of a law whose gain has grown by r.
    #[inline(always)]
    pub fn images<T: Scalar, const N: usize>(
        self,
        poles: &Poles<T, N>,
        r: T,
        dt: T,
    ) -> SVector<T, N> {
        let mut d = [(T::ZERO, T::ZERO); N];
        for (i, pole) in poles.iter().enumerate() {
            times_root(&mut d, i, self.image(pole, r, dt));
        }
        SVector::from_fn(|i, _| d[i].0)
    }

    /// δ = (z − 1)/T for a pole λ of a law whose gain has grown by r.
    #[inline(always)]
    pub fn image<T: Scalar>(self, (re, im): (T, T), r: T, dt: T) -> (T, T) {
        let h = r * dt;
        let (re, im) = self.shift((h * re, h * im));
        let dt = dt.or(T::ONE); // no time: nothing moves
        (re / dt, im / dt)
    }
}

/// From here on down eˣ − 1 is −1 to the last bit.
const GONE: f64 = -50.0;

/// eˣ − 1 for x ≤ 0, as exact for small |x|: a series for x/128, which doubles seven times by
/// e²ˣ − 1 = (eˣ − 1)(2 + (eˣ − 1)).
#[inline(always)]
fn exp_m1<T: Scalar>(x: T) -> T {
    let x = x.max(T::from_f64(GONE)) * T::from_f64(1.0 / 128.0);
    let mut sum = T::ONE;
    for over in const { Constant::reciprocals::<11>(2) }.into_iter().rev() {
        sum = T::ONE + sum * x * T::constant(over);
    }
    let (mut grown, two) = (sum * x, T::from_f64(2.0));
    for _ in 0..7 {
        grown *= two + grown;
    }
    grown
}

/// Poles λᵢ.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Poles<T, const N: usize> {
    re: SVector<T, N>,
    im: SVector<T, N>,
}

crate::error::through_constructor! {
    [T: Scalar, const N: usize]
    Poles<T, N>: poles => { re: SVector<T, N> = poles.re, im: SVector<T, N> = poles.im }
    => Ok(Self { re, im })
}

impl<T: Scalar, const N: usize> Poles<T, N> {
    /// The roots of sⁿ + k₁sⁿ⁻¹ + … + kₙ.
    pub fn of(k: &SVector<T, N>) -> Self {
        let mut found = [(0.0, 0.0); N];
        let k: [f64; N] = core::array::from_fn(|i| k[i].to_f64());
        roots(&k, &mut found);
        Self::from(found)
    }

    /// λᵢ as (real part, imaginary part).
    #[inline(always)]
    pub fn iter(&self) -> impl Iterator<Item = (T, T)> {
        self.re.iter().zip(self.im.iter()).map(|(re, im)| (*re, *im))
    }
}

impl<T: Scalar, const N: usize> From<[(f64, f64); N]> for Poles<T, N> {
    fn from(found: [(f64, f64); N]) -> Self {
        Self {
            re: SVector::from_fn(|i, _| T::from_f64(found[i].0)),
            im: SVector::from_fn(|i, _| T::from_f64(found[i].1)),
        }
    }
}

/// K of a chain from d₁ … dₙ: κ by Horner, in powers of τ.
#[inline(always)]
pub fn chain_gains<T: Scalar, const N: usize>(d: &SVector<T, N>, dt: T) -> SVector<T, N> {
    let mut kappa = [T::ZERO; N];
    for r in (1..=N).rev() {
        let over = T::ONE / T::from_u64(r as u64);
        let mut below = T::ZERO;
        for p in &mut kappa {
            (*p, below) = (below * over - dt * *p, *p); // times (τ − rT)/r
        }
        if let Some(p) = kappa.first_mut() {
            *p += d[r - 1];
        }
    }
    let mut factorial = dt;
    SVector::from_fn(|i, _| {
        if i > 1 {
            factorial *= T::from_u64(i as u64);
        }
        kappa[i] * factorial
    })
}

/// xᵢ + T ẋᵢ + T²/2 ẋᵢ₊₁ + …: a chain after a step under a rate of which only the chain's part moves.
#[inline(always)]
pub fn ahead<T: Scalar, const N: usize>(
    x: &SVector<T, N>,
    rate: &SVector<T, N>,
    dt: T,
) -> SVector<T, N> {
    let steps = const { Constant::reciprocals::<N>(1) }.map(|over| dt * T::constant(over));
    SVector::from_fn(|i, _| {
        let mut moved = T::NEG_ZERO;
        for m in (0..N - i).rev() {
            moved = (rate[i + m] + moved) * steps[m];
        }
        x[i] + moved
    })
}

/// A law whose injection can be placed.
pub trait Injected<T: Scalar>:
    OneChain<T> + Flow<T, <Self as ContinuousLaw<T>>::State, <Self as ContinuousLaw<T>>::Input>
{
    /// What its poles are.
    type Poles: Copy;
    /// Gains of a correction.
    type Gains: Copy;
    /// Whether the gains depend on the length of a step alone.
    const CONSTANT: bool;
    /// Whether [`Self::gains`] is a sequence of operations that decides on no value, so that it can be
    /// written down as a table.
    const TRACEABLE: bool = true;
    /// Its poles (at r = 1).
    ///
    /// # Errors
    /// An order for which rounding would undo the placement.
    fn poles(&self, at: Placement) -> Result<Self::Poles, DesignError>;
    /// The gains of the correction that ends a step of length dt, for the innovation e.
    fn gains(
        &self,
        at: Placement,
        poles: &Self::Poles,
        z: &Self::State,
        e: &Self::Innovation,
        dt: T,
    ) -> Self::Gains;
    /// The memory after the use of the innovation e that ends a step of length dt.
    fn inject(&self, z: &Self::State, e: &Self::Innovation, k: &Self::Gains, dt: T) -> Self::State;
}

/// A law whose innovation enters one chain: what [`Implicit`] and the
/// [inter-sample predictor](crate::inter_sample) ask of it.
pub trait OneChain<T: Scalar>: ContinuousLaw<T> {
    /// Refuse the implicit step.
    ///
    /// # Errors
    /// A law or a gain whose implicit step is not the root of a polynomial.
    fn closed(&self) -> Result<(), DesignError> {
        Err(several_chains(Self::ESTIMATED))
    }
    /// What the sample injects at the end of an implicit step of length dt, as a rate; e is the innovation of
    /// the prediction.
    #[inline(always)]
    fn closing(&self, z: &Self::State, e: &Self::Innovation, _dt: T) -> Self::State {
        self.injection(z, e)
    }
    /// Refuse the inter-sample predictor.
    ///
    /// # Errors
    /// A law with more chains than one; rows of an injection that are not alike.
    fn decays(&self) -> Result<(), DesignError> {
        Err(several_chains(Self::ESTIMATED))
    }
    /// By how much an innovation e that decays moves the memory over a step of length dt, and what is left of
    /// it.
    #[inline(always)]
    fn decaying(
        &self,
        z: &Self::State,
        e: &Self::Innovation,
        _dt: T,
    ) -> (Self::State, Self::Innovation) {
        (self.injection(z, e), *e)
    }
}

fn several_chains(n: usize) -> DesignError {
    let allowed =
        "methods implicit and inter-sample are for the standard observer; choose method zoh";
    DesignError { parameter: "n", value: n as f64, allowed }
}

/// Backward Euler in the chain and its correction: x̂ᵢ⁺ = x̂ᵢ + T (x̂ᵢ₊₁⁺ + f̂ᵢ + vᵢ(e⁺)), e⁺ = y − x̂₁⁺, f̂ of
/// the beginning. Without chattering under a gain whose last term is a sign.
///
/// Acary and Brogliato, Systems & Control Letters 59 (2010); Mojallizadeh, Brogliato and Acary, Int. J.
/// Robust Nonlinear Control 31 (2021). For current timing: the sample is that of the step's end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Implicit;

impl<T: Scalar, L: OneChain<T>> Scheme<T, L> for Implicit {
    const OVER_GAPS: bool = true;

    #[inline(always)]
    fn advance(&self, law: &L, t: T, z: &L::State, y: T, u: &L::Input, dt: T) -> L::State {
        self.correct(law, &self.predict(law, t, z, u, dt), y, dt)
    }

    #[inline(always)]
    fn predict(&self, law: &L, t: T, z: &L::State, u: &L::Input, dt: T) -> L::State {
        StaggeredEuler.predict(law, t, z, u, dt)
    }

    #[inline(always)]
    fn correct(&self, law: &L, z: &L::State, y: T, dt: T) -> L::State {
        let e = law.innovation(z, y);
        law.stagger(z, z.plus(dt, &law.closing(z, &e, dt)), dt)
    }
}

/// The exact chain, then what the innovation of the step's beginning injects in its time:
/// x̂⁺ = e^{AT} x̂ + T v. Livne and Levant, Automatica 50 (2014) 2023.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Proper<M = Held> {
    /// How the known terms move.
    pub motion: M,
}

impl<T, L, M> Scheme<T, L> for Proper<M>
where
    T: Scalar,
    L: ContinuousLaw<T> + Flow<T, L::State, L::Input>,
    M: Motion,
{
    #[inline(always)]
    fn advance(&self, law: &L, t: T, z: &L::State, y: T, u: &L::Input, dt: T) -> L::State {
        let moved = self.motion.moved(&UnderSample { law, y }, t, z, u, dt);
        moved.plus(dt, &law.kick(z, &law.innovation(z, y)))
    }
}

/// The scheme: correct, then predict. P and K are the law's [`Injected::Poles`] and
/// [`Injected::Gains`], M is how the model moves.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Placed<T, P, K, M = Held> {
    placement: Placement,
    motion: M,
    poles: P,
    /// The gains of steps of this length.
    prepared: Option<(T, K)>,
}

impl<T: Scalar, P: Copy, K: Copy> Placed<T, P, K> {
    /// For this law, its known terms held over a step. Gains are computed at every step unless the observer is
    /// [prepared](crate::Observer::prepared) for the usual length of one.
    ///
    /// # Errors
    /// An order for which rounding would undo the placement.
    pub fn new<L>(law: &L, placement: Placement) -> Result<Self, DesignError>
    where
        L: Injected<T, Poles = P, Gains = K>,
    {
        Ok(Self { placement, motion: Held, poles: law.poles(placement)?, prepared: None })
    }

    /// The same, the known terms moved so.
    #[must_use]
    pub fn moved_by<M: Motion>(self, motion: M) -> Placed<T, P, K, M> {
        let Self { placement, poles, prepared, .. } = self;
        Placed { placement, motion, poles, prepared }
    }
}

impl<T, L, M> Scheme<T, L> for Placed<T, L::Poles, L::Gains, M>
where
    T: Scalar,
    L: Injected<T>,
    M: Motion,
{
    const OVER_GAPS: bool = true;

    #[inline(always)]
    fn advance(&self, law: &L, t: T, z: &L::State, y: T, u: &L::Input, dt: T) -> L::State {
        self.predict(law, t, &self.correct(law, z, y, dt), u, dt)
    }

    #[inline(always)]
    fn predict(&self, law: &L, t: T, z: &L::State, u: &L::Input, dt: T) -> L::State {
        self.motion.moved(law, t, z, u, dt)
    }

    #[inline(always)]
    fn correct(&self, law: &L, z: &L::State, y: T, dt: T) -> L::State {
        let e = law.innovation(z, y);
        let gains = match &self.prepared {
            Some((usual, gains)) if *usual == dt => *gains,
            _ => law.gains(self.placement, &self.poles, z, &e, dt),
        };
        law.inject(z, &e, &gains, dt)
    }

    #[inline(always)]
    fn prepared(&self, law: &L, dt: T) -> Self {
        let z = law.initial();
        let gains =
            || law.gains(self.placement, &self.poles, &z, &law.innovation(&z, absent()), dt);
        Self { prepared: L::CONSTANT.then(|| (dt, gains())), ..*self }
    }
}
