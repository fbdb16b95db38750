//! The low-power high-gain observer, Astolfi, Marconi, Praly and Teel (5).
//!
//! n − 1 blocks (x̂ᵢ, ηᵢ) of order two, and a last one of order one. Block i estimates
//! (xᵢ, xᵢ₊₁); no coefficient carries a higher power of the gain than ℓ²:
//!
//!   x̂̇ᵢ = ηᵢ + αᵢ ℓ eᵢ                      i = 1 … n−1,     x̂̇ₙ   = φ(x̂) + αₙ ℓ eₙ
//!   η̇ᵢ = sat(ηᵢ₊₁) + βᵢ ℓ² eᵢ              i = 1 … n−2,     η̇ₙ₋₁ = φ(x̂) + βₙ₋₁ ℓ² eₙ₋₁
//!   e₁ = y − x̂₁,   eᵢ = sat(ηᵢ₋₁) − x̂ᵢ      i = 2 … n
//!
//! Here `sat` is the identity; with a saturation it is the peaking-free observer (11) of
//! [`super::PeakingFreeObserver`].

use super::{chain, checked, driven, folded, one_row};
use crate::Scalar;
use crate::error::DesignError;
use crate::gain::GainLaw;
use crate::injection::{Injected, OneChain, Placement, Poles, ahead, chain_gains};
use crate::memory::{AllButLast, Memory};
use crate::model::{PhaseVariable, last};
use crate::motion::Flow;
use crate::observer::ContinuousLaw;
use crate::polynomial::{low_power_inner_polynomial, low_power_steps, roots, roots_of, times_root};
use crate::saturation::{NoSaturation, Saturation};
use crate::wide::{Number, Wide, exp_m1};
use nalgebra::SVector;

crate::memory_struct! {
    /// Memory of a low-power observer.
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    pub struct LowPowerState<T, R: Memory; const N: usize> {
        /// Estimates of x₁ … xₙ.
        pub x_hat: SVector<T, N>,
        /// Estimates of x₂ … xₙ, auxiliary; the N-th slot is never read or moved.
        pub eta: AllButLast<T, N>,
        /// The gain law's memory: r where the gain moves, else nothing.
        pub r: R,
    }
}

/// The structure of (5) and (11): N blocks, saturation S.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LowPower<T, G, Md, S, const N: usize, const M: usize = 0> {
    /// αᵢ ℓ, ℓ the fixed part of the gain.
    alpha: SVector<T, N>,
    /// βᵢ ℓ².
    beta: SVector<T, N>,
    gain: G,
    model: Md,
    saturation: S,
}

crate::error::through_constructor! {
    [T: Scalar, G: GainLaw<T>, Md: PhaseVariable<T, N, M>, S: Saturation<T>,
     const N: usize, const M: usize]
    LowPower<T, G, Md, S, N, M>: observer => {
        alpha: SVector<T, N> = super::unfolded(&observer.alpha, observer.gain.fixed(), |_| 1),
        beta: SVector<T, N> = super::unfolded(&observer.beta, observer.gain.fixed(), |_| 2),
        gain: G = observer.gain,
        model: Md = observer.model,
        saturation: S = observer.saturation,
    }
    => Self::new(alpha.into(), beta.into(), gain, model, saturation)
}

/// The low-power observer (5).
pub type LowPowerObserver<T, G, Md, const N: usize, const M: usize = 0> =
    LowPower<T, G, Md, NoSaturation, N, M>;

impl<T, G, Md, S, const N: usize, const M: usize> LowPower<T, G, Md, S, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: PhaseVariable<T, N, M>,
    S: Saturation<T>,
{
    /// Coefficients α (N) and β (N; the last entry is not used), gain law, model, saturation.
    /// [`crate::polynomial::low_power_coefficients`] finds α and β for any Hurwitz polynomial.
    ///
    /// # Errors
    /// A coefficient that is not finite; N outside 1 to 12; the characteristic polynomial of the
    /// matrix Mₙ not Hurwitz (the paper's low-power stability requirement); a gain whose square
    /// is too large or too small for the precision.
    pub fn new(
        alpha: [T; N],
        beta: [T; N],
        gain: G,
        model: Md,
        saturation: S,
    ) -> Result<Self, DesignError> {
        let (alpha, beta) = (checked("alpha", alpha)?, checked("beta", beta)?);
        crate::polynomial::require_low_power_hurwitz(alpha.as_slice(), beta.as_slice())?;
        gain.fits(None, None)?;
        let ell = gain.fixed();
        let (alpha, beta) = (folded(&alpha, ell, |_| 1)?, folded(&beta, ell, |_| 2)?);
        Ok(Self { alpha, beta, gain, model, saturation })
    }

    /// What the value `eta` of slot i stands for in the rate of the state before: the last one as the model
    /// has it [enter](crate::model::Model::enters).
    #[inline(always)]
    fn above(&self, t: T, x_hat: &SVector<T, N>, (i, eta): (usize, T), u: &SVector<T, M>) -> T {
        if self.model.carries() && i + 2 == N { self.model.enters(t, x_hat, eta, u) } else { eta }
    }

    /// By how much the state before moves faster where slot i grows: the last one times its
    /// [slope](crate::model::Model::slope).
    #[inline(always)]
    fn moves(&self, x_hat: &SVector<T, N>, i: usize, grown: T) -> T {
        if i + 2 == N { grown * self.model.slope(x_hat) } else { grown }
    }

    /// A correction of η, its last one in the [unit](crate::model::Model::slope) of the last state.
    #[inline(always)]
    fn in_unit(&self, x_hat: &SVector<T, N>, of_chain: SVector<T, N>) -> SVector<T, N> {
        let slope = self.model.slope(x_hat);
        SVector::from_fn(|i, _| if i + 2 == N { of_chain[i] / slope } else { of_chain[i] })
    }
}

impl<T, G, Md, S, const N: usize, const M: usize> ContinuousLaw<T> for LowPower<T, G, Md, S, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: PhaseVariable<T, N, M>,
    S: Saturation<T>,
{
    type State = LowPowerState<T, G::Memory, N>;
    type Input = SVector<T, M>;
    type Innovation = T;
    const ESTIMATED: usize = N;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        LowPowerState { r: self.gain.initial(), ..LowPowerState::zero() }
    }

    #[inline(always)]
    fn innovation(&self, z: &Self::State, y: T) -> T {
        y.innovation(z.x_hat[0]) // (5b)
    }

    #[inline(always)]
    fn rate(&self, t: T, z: &Self::State, e1: &T, u: &Self::Input) -> Self::State {
        let LowPowerState { x_hat, eta, r: m } = z;
        let phi = self.model.phi(t, x_hat, u);
        // sat(ηᵢ) at slot i estimates x of index i + 2 in the paper's count
        let eta_s: SVector<T, N> =
            SVector::from_fn(
                |i, _| {
                    if i + 1 < N { self.saturation.apply(i, eta[i]) } else { T::ZERO }
                },
            );
        let kick = self.kick(z, e1);
        let x_rate = SVector::from_fn(|i, _| {
            let above = if i + 1 < N { self.above(t, x_hat, (i, eta[i]), u) } else { phi };
            above + kick.x_hat[i]
        });
        let eta_rate: SVector<T, N> = SVector::from_fn(|i, _| {
            if i + 1 == N {
                T::ZERO
            } else {
                let above =
                    if i + 2 < N { self.above(t, x_hat, (i + 1, eta_s[i + 1]), u) } else { phi };
                above + kick.eta[i]
            }
        });
        LowPowerState { x_hat: x_rate, eta: eta_rate.into(), r: self.gain.rate::<N>(m, *e1) }
    }

    #[inline(always)]
    fn injection(&self, z: &Self::State, e1: &T) -> Self::State {
        let r = self.gain.moving(&z.r, *e1);
        let v = one_row(&self.gain, &z.r, *e1);
        let first = |i: usize, injected: T| if i == 0 { injected } else { T::ZERO };
        let eta: SVector<T, N> =
            SVector::from_fn(|i, _| first(i + usize::from(N < 2), self.beta[0] * (r * r) * v));
        let eta = self.in_unit(&z.x_hat, eta);
        LowPowerState {
            x_hat: SVector::from_fn(|i, _| first(i, self.alpha[0] * r * v)),
            eta: eta.into(),
            r: driven::<T, G, N>(&self.gain, &z.r, *e1),
        }
    }

    /// αᵢ r eᵢ and βᵢ r² eᵢ.
    #[inline(always)]
    fn kick(&self, z: &Self::State, e1: &T) -> Self::State {
        let LowPowerState { x_hat, eta, r: m } = z;
        let r = self.gain.moving(m, *e1);
        let v = one_row(&self.gain, m, *e1);
        let e: SVector<T, N> = SVector::from_fn(|i, _| {
            if i == 0 { v } else { self.saturation.apply(i - 1, eta[i - 1]) - x_hat[i] } // (11b)
        });
        let injected = self.in_unit(x_hat, SVector::from_fn(|i, _| self.beta[i] * (r * r) * e[i]));
        let eta: SVector<T, N> =
            SVector::from_fn(|i, _| if i + 1 < N { injected[i] } else { T::ZERO });
        LowPowerState {
            x_hat: SVector::from_fn(|i, _| self.alpha[i] * r * e[i]),
            eta: eta.into(),
            r: driven::<T, G, N>(&self.gain, m, *e1),
        }
    }

    #[inline(always)]
    fn stagger(&self, old: &Self::State, mut new: Self::State, dt: T) -> Self::State {
        for i in (1..N - 1).rev() {
            let moved = self.saturation.apply(i, new.eta[i]) - self.saturation.apply(i, old.eta[i]);
            new.eta[i - 1] += dt * self.moves(&old.x_hat, i, moved);
        }
        for i in 0..N - 1 {
            new.x_hat[i] += dt * self.moves(&old.x_hat, i, new.eta[i] - old.eta[i]);
        }
        new
    }

    super::of_gain_and_estimate!(LowPowerState, gain, e in e);
}

/// Orders up to which double precision finds the gains to nine digits. Above, the way from αᵢ and βᵢ to
/// aᵢ and bᵢ, through the coefficients of a polynomial of degree 2n − 2 whose roots lie close together,
/// loses up to all sixteen of them, and is gone in twice the precision.
const PLAIN: usize = 5;

/// A power of 2 near the poles, so that polynomials in s over it have no large or small coefficients.
fn unit<const N: usize>(alpha: &[f64; N]) -> f64 {
    const POWER_OF_2: u64 = f64::INFINITY.to_bits();
    let sum = alpha.iter().take(N.saturating_sub(1)).sum::<f64>();
    f64::from_bits((sum / (2.0 * N as f64)).to_bits() & POWER_OF_2)
}

/// The roots of Pₙ₋₁ over the unit; the last one of each half is not used.
#[inline(never)]
fn wide_roots<const N: usize>(
    alpha: &[f64; N],
    beta: &[f64; N],
    unit: f64,
) -> [[(Wide, Wide); N]; 2] {
    let alpha = alpha.map(|alpha| Wide::new(alpha / unit));
    let beta = beta.map(|beta| Wide::new(beta / (unit * unit)));
    let mut trailing = [[Wide::ZERO; N]; 2];
    let mut found = [[(Wide::ZERO, Wide::ZERO); N]; 2];
    let degree = 2 * N.saturating_sub(1);
    if let (Some(inner), Some(trailing), Some(found)) = (
        alpha.get(..N.saturating_sub(1)),
        trailing.as_flattened_mut().get_mut(..degree),
        found.as_flattened_mut().get_mut(..degree),
    ) {
        low_power_inner_polynomial(inner, &beta, trailing);
        roots_of(trailing, found);
    }
    found
}

/// [`low_power_steps`] for [`Placement::Exact`] in twice the precision, time counted in 1/(r unit).
#[inline(never)]
fn wide_steps<const N: usize>(
    alpha: &[f64; N],
    poles: &[[(Wide, Wide); N]; 2],
    unit: f64,
    r: f64,
    dt: f64,
) -> ([f64; N], [f64; N]) {
    let h = (Wide::new(r) * Wide::new(dt)).scaled(unit);
    let image = |(re, im): (Wide, Wide)| {
        let (re, im) = exp_m1((h * re, h * im));
        (re / h, im / h)
    };
    let mut d = [[(Wide::ZERO, Wide::ZERO); N]; 2];
    let mut polynomial = [[Wide::ZERO; N]; 2];
    let degree = 2 * N.saturating_sub(1);
    for (i, (re, im)) in poles.as_flattened().iter().take(degree).enumerate() {
        let pole = (re.scaled(1.0 / unit), im.scaled(1.0 / unit));
        times_root(d.as_flattened_mut(), i, image(pole));
    }
    for (c, (re, _)) in polynomial.as_flattened_mut().iter_mut().zip(d.as_flattened()) {
        *c = *re;
    }
    let near = alpha.map(|alpha| -image((Wide::new(-alpha / unit), Wide::ZERO)).0);
    let inner = polynomial.as_flattened().get(..degree).unwrap_or(&[]);
    let (a, b) = low_power_steps::<Wide, N>(inner, near, h);
    let rate = r * unit;
    (a.map(|a| a.to_f64() * rate), b.map(|b| b.to_f64() * rate * rate))
}

/// [`LowPower::gains`] as numbers, the same for every scalar, gain law, model and saturation.
fn placed_gains<const N: usize>(
    at: Placement,
    (alpha, beta): (&[f64; N], &[f64; N]),
    poles: &[[[(f64, f64); N]; 2]; 2],
    r: f64,
    dt: f64,
) -> [[f64; N]; 4] {
    let alone = alpha.map(|alpha| -at.image((-alpha, 0.0), r, dt).0);
    let [first, rest] = poles;
    let degree = 2 * N.saturating_sub(1);

    let (mut a, b) = if const { N > PLAIN } && dt > 0.0 {
        let unit = unit(alpha);
        let mut wide = [[(Wide::ZERO, Wide::ZERO); N]; 2];
        let parts = first.as_flattened().iter().zip(rest.as_flattened());
        for (pole, (first, rest)) in wide.as_flattened_mut().iter_mut().zip(parts) {
            *pole = (Wide::of(first.0, rest.0), Wide::of(first.1, rest.1));
        }
        wide_steps(alpha, &wide, unit, r, dt)
    } else {
        let (mut d, mut polynomial) = ([[(0.0, 0.0); N]; 2], [[0.0; N]; 2]);
        for (i, pole) in first.as_flattened().iter().take(degree).enumerate() {
            times_root(d.as_flattened_mut(), i, at.image(*pole, r, dt));
        }
        for (c, (re, _)) in polynomial.as_flattened_mut().iter_mut().zip(d.as_flattened()) {
            *c = *re;
        }
        let inner = polynomial.as_flattened().get(..degree).unwrap_or(&[]);
        low_power_steps::<f64, N>(inner, alone, dt)
    };
    if let (Some(a), Some(alone)) = (a.last_mut(), alone.last()) {
        *a = *alone; // it moves no other block: its eigenvalue is its own
    }
    let blocks: [[f64; 2]; N] = core::array::from_fn(|i| {
        if i + 1 == N {
            return [a[i] * dt, 0.0];
        }
        let mut pair = [(0.0, 0.0); 2];
        roots(&[alpha[i], beta[i]], &mut pair);
        chain_gains::<f64, 2>(&at.images(&Poles::from(pair), r, dt), dt).into()
    });
    // no time: nothing moves, whatever the division by it gave
    let over = |value: f64| if dt > 0.0 { value * dt } else { 0.0 };
    [a.map(over), b.map(over), blocks.map(|block| block[0]), blocks.map(|block| block[1])]
}

impl<T, G, Md, S, const N: usize, const M: usize> OneChain<T> for LowPower<T, G, Md, S, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: PhaseVariable<T, N, M>,
    S: Saturation<T>,
{
}

/// What a correction moves: block i moves x̂ᵢ by aᵢ eᵢ and ηᵢ by bᵢ eᵢ.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BlockGains<T, const N: usize> {
    /// aᵢ.
    pub a: SVector<T, N>,
    /// bᵢ.
    pub b: SVector<T, N>,
}

crate::error::through_constructor! {
    [T: Scalar, const N: usize]
    BlockGains<T, N>: gains => { a: SVector<T, N> = gains.a, b: SVector<T, N> = gains.b }
    => Ok(Self { a, b })
}

/// The observer in discrete time, with eigenvalues that are placed.
///
/// Over a step the blocks move along the chain, each by its own ηᵢ and by what the blocks above pass
/// on, s = sat(η) and φ held:
///
///   x̂ᵢ⁻ = x̂ᵢ + T ηᵢ + T²/2 sᵢ₊₁ + T³/6 sᵢ₊₂ + …        ηᵢ⁻ = ηᵢ + T sᵢ₊₁ + T²/2 sᵢ₊₂ + …
///
/// and a sample corrects them, e₁ = y − x̂₁⁻, eᵢ = sat(ηᵢ₋₁⁻) − x̂ᵢ⁻:
///
///   x̂ᵢ⁺ = x̂ᵢ⁻ + aᵢ eᵢ        ηᵢ⁺ = ηᵢ⁻ + bᵢ eᵢ
///
/// so that, as in continuous time, eᵢ⁺ = (1 − aᵢ) eᵢ + bᵢ₋₁ eᵢ₋₁, and Lemma 1 of the paper, carried over
/// to z, finds the aᵢ and bᵢ that place all 2n − 1 eigenvalues ([`crate::polynomial`]).
///
/// Without saturations these eigenvalues decide on stability. A saturated block decouples and sees bounded
/// inputs only, and aᵢ, bᵢ alone need not make it stable. So the part of eᵢ beyond the saturation,
/// eᵢ − sat(b′ᵢeᵢ)/b′ᵢ, corrects by a′ᵢ and b′ᵢ, which place the two eigenvalues of the block by itself.
/// Every block is then a stable linear system driven by bounded signals, for any T.
impl<T, G, Md, S, const N: usize, const M: usize> Injected<T> for LowPower<T, G, Md, S, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: PhaseVariable<T, N, M>,
    S: Saturation<T>,
{
    /// In two halves; of orders that need it, what rounding took from each pole stands after it.
    type Poles = [[Poles<T, N>; 2]; 2];
    /// a and b; a′ and b′.
    type Gains = [BlockGains<T, N>; 2];
    const CONSTANT: bool = G::STILL;
    const TRACEABLE: bool = false;

    /// The roots of Pₙ₋₁; the last one of each half is not used.
    fn poles(&self, at: Placement) -> Result<Self::Poles, DesignError> {
        self.gain.placed()?;
        at.hold::<N>(4, PLAIN)?;
        let alpha: [f64; N] = core::array::from_fn(|i| self.alpha[i].to_f64());
        let beta: [f64; N] = core::array::from_fn(|i| self.beta[i].to_f64());
        if const { N > PLAIN } {
            let unit = unit(&alpha);
            let found = wide_roots(&alpha, &beta, unit);
            // what T makes of a pole, and what that leaves
            let first = |x: Wide| T::from_f64(x.high * unit).to_f64();
            let rest = |x: Wide| (x.scaled(unit) - Wide::new(first(x))).to_f64();
            return Ok([
                found.map(|half| Poles::from(half.map(|(re, im)| (first(re), first(im))))),
                found.map(|half| Poles::from(half.map(|(re, im)| (rest(re), rest(im))))),
            ]);
        }
        let (mut trailing, mut found) = ([[0.0; N]; 2], [[(0.0, 0.0); N]; 2]);
        let degree = 2 * N.saturating_sub(1);
        if let (Some(inner), Some(trailing), Some(found)) = (
            alpha.get(..N.saturating_sub(1)),
            trailing.as_flattened_mut().get_mut(..degree),
            found.as_flattened_mut().get_mut(..degree),
        ) {
            low_power_inner_polynomial(inner, &beta, trailing);
            roots(trailing, found);
        }
        Ok([found.map(Poles::from), [Poles::from([(0.0, 0.0); N]); 2]])
    }

    fn gains(
        &self,
        at: Placement,
        poles: &Self::Poles,
        z: &Self::State,
        e: &T,
        dt: T,
    ) -> Self::Gains {
        let r = self.gain.moving(&z.r, *e);
        // constants of the run: in double precision, whatever T
        let (known, dt) = if dt > T::ZERO { (r.to_f64(), dt.to_f64()) } else { (1.0, 0.0) };
        let r = if r > T::ZERO { known } else { 1.0 };
        let alpha: [f64; N] = core::array::from_fn(|i| self.alpha[i].to_f64());
        let beta: [f64; N] = core::array::from_fn(|i| self.beta[i].to_f64());
        let mut numbers = [[[(0.0, 0.0); N]; 2]; 2];
        let poles = poles.iter().flatten().flat_map(Poles::iter);
        for (number, (re, im)) in
            numbers.as_flattened_mut().as_flattened_mut().iter_mut().zip(poles)
        {
            *number = (re.to_f64(), im.to_f64());
        }
        let gains = placed_gains(at, (&alpha, &beta), &numbers, r, dt);
        let [a, b, alone_a, alone_b] =
            gains.map(|part| SVector::from_fn(|i, _| T::from_f64(part[i])));
        [BlockGains { a, b }, BlockGains { a: alone_a, b: alone_b }]
    }

    #[inline(always)]
    fn inject(&self, z: &Self::State, e1: &T, k: &Self::Gains, dt: T) -> Self::State {
        let ([placed, alone], mut new) = (k, *z);
        let v = one_row(&self.gain, &z.r, *e1);
        let (placed_b, alone_b) =
            (self.in_unit(&z.x_hat, placed.b), self.in_unit(&z.x_hat, alone.b));
        for i in 0..N {
            let e =
                if i == 0 { v } else { self.saturation.apply(i - 1, z.eta[i - 1]) - z.x_hat[i] };
            if i + 1 == N {
                new.x_hat[i] += placed.a[i] * e;
                continue;
            }
            if self.saturation.is_identity() {
                new.x_hat[i] += placed.a[i] * e;
                new.eta[i] += placed_b[i] * e;
                continue;
            }
            let asked = alone_b[i] * e;
            // no time: nothing moves
            let beyond = (asked - self.saturation.apply(i, asked)) / alone_b[i].or(T::ONE);
            let within = e - beyond;
            new.x_hat[i] += placed.a[i] * within + alone.a[i] * beyond;
            new.eta[i] += placed_b[i] * within + alone_b[i] * beyond;
        }
        new.r = z.r.plus(dt, &driven::<T, G, N>(&self.gain, &z.r, *e1));
        new
    }
}

/// Memory of an observer under the gain law G.
type Moved<T, G, const N: usize> = LowPowerState<T, <G as GainLaw<T>>::Memory, N>;

/// δ of x̂ᵢ₊₁ is one of ηᵢ too. The deviations of x̂ᵢ and ηᵢ₋₁ begin at 0 and move alike while no saturation
/// is at its level.
impl<T, G, Md, S, const N: usize, const M: usize> Flow<T, Moved<T, G, N>, SVector<T, M>>
    for LowPower<T, G, Md, S, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: PhaseVariable<T, N, M>,
    S: Saturation<T>,
{
    /// Of each state, and what η of an unknown enters; sat(η) of it is that state's.
    type Terms = (SVector<T, N>, T);

    #[inline(always)]
    fn terms(&self, t: T, z: &Moved<T, G, N>, u: &SVector<T, M>) -> Self::Terms {
        let LowPowerState { x_hat, eta, .. } = z;
        let mut f = (last(self.model.phi(t, x_hat, u)), T::NEG_ZERO);
        for i in 0..N {
            if self.model.carries() && i + 2 == N {
                f.0[i] = self.above(t, x_hat, (i, self.saturation.apply(i, eta[i])), u);
                f.1 = self.above(t, x_hat, (i, eta[i]), u);
            }
        }
        f
    }

    #[inline(always)]
    fn flow(&self, z: &Moved<T, G, N>, f: &Self::Terms, dt: T) -> Moved<T, G, N> {
        let LowPowerState { x_hat, eta, r: m } = z;
        let enters = |i: usize| self.model.carries() && i + 2 == N;
        let above: SVector<T, N> = SVector::from_fn(|i, _| {
            if i + 1 == N || enters(i) { f.0[i] } else { self.saturation.apply(i, eta[i]) }
        });
        let moved = ahead(&SVector::from_element(T::NEG_ZERO), &above, dt);
        let saturated = !self.saturation.is_identity();
        let x_hat = SVector::from_fn(|i, _| {
            let own = if enters(i) { f.1 } else { eta[i] };
            let own = if i + 1 < N && saturated { dt * (own - above[i]) } else { T::NEG_ZERO };
            x_hat[i] + moved[i] + own
        });
        let eta: SVector<T, N> =
            SVector::from_fn(|i, _| if i + 1 < N { eta[i] + moved[i + 1] } else { T::ZERO });
        let r = m.plus(dt, &self.gain.rate::<N>(m, T::ZERO));
        LowPowerState { x_hat, eta: eta.into(), r }
    }

    #[inline(always)]
    fn chain(&self, delta: &Self::Terms) -> Self::Terms {
        (chain(&delta.0, self.model.carries()), T::NEG_ZERO)
    }

    #[inline(always)]
    fn shifted(&self, z: &Moved<T, G, N>, (delta, _): &Self::Terms) -> Moved<T, G, N> {
        let eta: SVector<T, N> =
            SVector::from_fn(|i, _| if i + 1 < N { z.eta[i] + delta[i + 1] } else { T::ZERO });
        LowPowerState { x_hat: z.x_hat + delta, eta: eta.into(), r: z.r }
    }

    #[inline(always)]
    fn rows(&self) -> usize {
        N
    }
}
