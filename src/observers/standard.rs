//! The standard high-gain observer.
//!
//! Sanfelice and Praly (5)-(7), any order n, any gain law:
//!
//!   x̂̇ = A x̂ + f̂(x̂, u, t) + Λ(r) K (y − x̂₁),   Λ(r) = diag(r, r², …, rⁿ)
//!
//! With a constant gain r = ℓ and f̂ = B φ it is Astolfi et al. (2); with r = 1/ε and f̂ = 0 it is
//! Lee, Choi and Khalil (39), whose forward Euler form under a fixed step is (42) and under the
//! decreasing steps a(k) of [`crate::schedule::StochasticApproximation`] is (44).

use super::{chain, checked, driven, folded, swept};
use crate::Scalar;
use crate::error::DesignError;
use crate::gain::GainLaw;
use crate::injection::{Injected, OneChain, Placement, Poles, ahead, chain_gains};
use crate::inter_sample::phi;
use crate::memory::Memory;
use crate::model::Model;
use crate::motion::Flow;
use crate::observer::ContinuousLaw;
use nalgebra::SVector;

crate::memory_struct! {
    /// Memory of a standard observer.
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    pub struct StandardState<T, R: Memory; const N: usize> {
        /// Estimate x̂.
        pub x_hat: SVector<T, N>,
        /// The gain law's memory: r where the gain moves, else nothing.
        pub r: R,
    }
}

/// Standard high-gain observer of order N with M known inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StandardObserver<T, G, Md, const N: usize, const M: usize = 0> {
    /// kᵢ ℓⁱ, ℓ the fixed part of the gain.
    pub(super) k: SVector<T, N>,
    pub(super) gain: G,
    pub(super) model: Md,
}

crate::error::through_constructor! {
    [T: Scalar, G: GainLaw<T>, Md: Model<T, N, M>, const N: usize, const M: usize]
    StandardObserver<T, G, Md, N, M>: observer => {
        k: SVector<T, N> = super::unfolded(&observer.k, observer.gain.fixed(), |i| i + 1),
        gain: G = observer.gain,
        model: Md = observer.model,
    }
    => Self::new(k.into(), gain, model)
}

impl<T, G, Md, const N: usize, const M: usize> StandardObserver<T, G, Md, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: Model<T, N, M>,
{
    /// Coefficients k (sⁿ + k₁ sⁿ⁻¹ + … + kₙ Hurwitz, see [`crate::polynomial`]), gain law, model.
    ///
    /// # Errors
    /// A coefficient that is not finite; N outside 1 to 12; a polynomial that is not Hurwitz; a
    /// gain whose N-th power is too large or too small for the precision.
    pub fn new(k: [T; N], gain: G, model: Md) -> Result<Self, DesignError> {
        let k = checked("k", k)?;
        crate::polynomial::require_hurwitz(k.as_slice())?;
        gain.fits(Some(N), Some(k.as_slice()))?;
        Ok(Self { k: folded(&k, gain.fixed(), |i| i + 1)?, gain, model })
    }

    /// Rate of x̂ under the moving gain r and what its rows take in the place of the innovation.
    #[inline(always)]
    pub(super) fn rate_under(
        &self,
        t: T,
        x_hat: &SVector<T, N>,
        r: T,
        rows: &SVector<T, N>,
        u: &SVector<T, M>,
    ) -> SVector<T, N> {
        let known = self.known(t, x_hat, u);
        chain(x_hat, self.model.carries()) + known + self.injected(x_hat, r, rows) // (5)
    }

    /// What the rows take in the place of the innovation e.
    #[inline(always)]
    fn rows(&self, m: &G::Memory, e: T) -> SVector<T, N> {
        let mut rows: SVector<T, N> = SVector::from_element(e);
        self.gain.rows(m, e, rows.as_mut_slice());
        rows
    }

    /// f̂, with what an unknown [enters](Model::enters).
    #[inline(always)]
    pub(super) fn known(&self, t: T, x_hat: &SVector<T, N>, u: &SVector<T, M>) -> SVector<T, N> {
        let (f, carries) = (self.model.f_hat(t, x_hat, u), self.model.carries());
        SVector::from_fn(|i, _| {
            if carries && i + 2 == N {
                self.model.enters(t, x_hat, x_hat[i + 1], u) + f[i]
            } else {
                f[i]
            }
        })
    }

    /// A correction of a chain of integrators, each entry in the unit that the [slopes](Model::slopes) make.
    #[inline(always)]
    pub(super) fn in_unit(&self, x_hat: &SVector<T, N>, of_chain: SVector<T, N>) -> SVector<T, N> {
        let (slopes, mut unit) = (self.model.slopes(x_hat), T::ONE);
        SVector::from_fn(|i, _| {
            unit *= slopes[i];
            of_chain[i] / unit
        })
    }

    /// Λ(r) K v at x̂, v = e for all rows or one for each.
    #[inline(always)]
    pub(super) fn injected(
        &self,
        x_hat: &SVector<T, N>,
        r: T,
        rows: &SVector<T, N>,
    ) -> SVector<T, N> {
        let mut injection = *rows;
        for i in 0..N {
            if G::ALIKE && i > 0 {
                injection[i] = injection[i - 1] * r; // rⁱ e
            } else {
                for _ in 0..=i {
                    injection[i] *= r;
                }
            }
        }
        self.in_unit(x_hat, SVector::from_fn(|i, _| self.k[i] * injection[i]))
    }

    /// [`swept`] by its model.
    #[inline(always)]
    pub(super) fn staggered(
        &self,
        old: &SVector<T, N>,
        new: SVector<T, N>,
        dt: T,
    ) -> SVector<T, N> {
        swept(old, new, &self.model.slopes(old), dt)
    }

    /// The gain law.
    #[inline(always)]
    pub(super) fn gain(&self) -> &G {
        &self.gain
    }
}

impl<T, G, Md, const N: usize, const M: usize> ContinuousLaw<T> for StandardObserver<T, G, Md, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: Model<T, N, M>,
{
    type State = StandardState<T, G::Memory, N>;
    type Input = SVector<T, M>;
    type Innovation = T;
    const ESTIMATED: usize = N;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        StandardState { x_hat: SVector::from_element(T::ZERO), r: self.gain.initial() }
    }

    #[inline(always)]
    fn innovation(&self, z: &Self::State, y: T) -> T {
        y.innovation(z.x_hat[0]) // (7)
    }

    #[inline(always)]
    fn rate(&self, t: T, z: &Self::State, e: &T, u: &Self::Input) -> Self::State {
        StandardState {
            x_hat: self.rate_under(
                t,
                &z.x_hat,
                self.gain.moving(&z.r, *e),
                &self.rows(&z.r, *e),
                u,
            ),
            r: self.gain.rate::<N>(&z.r, *e),
        }
    }

    #[inline(always)]
    fn injection(&self, z: &Self::State, e: &T) -> Self::State {
        StandardState {
            x_hat: self.injected(&z.x_hat, self.gain.moving(&z.r, *e), &self.rows(&z.r, *e)),
            r: driven::<T, G, N>(&self.gain, &z.r, *e),
        }
    }

    #[inline(always)]
    fn stagger(&self, old: &Self::State, new: Self::State, dt: T) -> Self::State {
        StandardState { x_hat: self.staggered(&old.x_hat, new.x_hat, dt), ..new }
    }

    super::of_gain_and_estimate!(StandardState, gain, e in e);
}

impl<T, G, Md, const N: usize, const M: usize> Injected<T> for StandardObserver<T, G, Md, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: Model<T, N, M>,
{
    type Poles = Poles<T, N>;
    type Gains = SVector<T, N>;
    const CONSTANT: bool = G::STILL;

    fn poles(&self, at: Placement) -> Result<Poles<T, N>, DesignError> {
        self.gain.placed()?;
        at.hold::<N>(6, super::MAX_ORDER)?;
        Ok(Poles::of(&self.k))
    }

    #[inline]
    fn gains(
        &self,
        at: Placement,
        poles: &Self::Poles,
        z: &Self::State,
        e: &T,
        dt: T,
    ) -> SVector<T, N> {
        chain_gains(&at.images(poles, self.gain.moving(&z.r, *e), dt), dt)
    }

    #[inline(always)]
    fn inject(&self, z: &Self::State, e: &T, k: &SVector<T, N>, dt: T) -> Self::State {
        let rows = self.rows(&z.r, *e);
        StandardState {
            x_hat: z.x_hat + self.in_unit(&z.x_hat, SVector::from_fn(|i, _| k[i] * rows[i])),
            r: z.r.plus(dt, &driven::<T, G, N>(&self.gain, &z.r, *e)),
        }
    }
}

impl<T, G, Md, const N: usize, const M: usize> OneChain<T> for StandardObserver<T, G, Md, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: Model<T, N, M>,
{
    fn closed(&self) -> Result<(), DesignError> {
        self.gain.closed()
    }

    /// vᵢ = kᵢℓⁱ pᵢ with pᵢ = rⁱ e⁺ = sⁿ⁻ⁱ e/(sⁿ + Σ gⱼ sⁿ⁻ʲ), s = 1/r: in sliding, s = 0, it is pₙ = e/gₙ alone.
    #[inline(always)]
    fn closing(&self, z: &Self::State, e: &T, dt: T) -> Self::State {
        let mut power = T::ONE;
        let g: SVector<T, N> = self.k.map(|k| {
            power *= dt;
            power * k
        });
        let s = self.gain.closing(&z.r, *e, g.as_slice());
        let over = *e / g.iter().fold(T::ONE, |sum, g| sum * s + *g).or(T::ONE);
        let mut left = over;
        let mut v: SVector<T, N> = SVector::zero();
        for i in (0..N).rev() {
            v[i] = self.k[i] * left;
            left *= s;
        }
        StandardState {
            x_hat: self.in_unit(&z.x_hat, v),
            r: driven::<T, G, N>(&self.gain, &z.r, *e),
        }
    }

    fn decays(&self) -> Result<(), DesignError> {
        self.gain.placed()
    }

    #[inline(always)]
    fn decaying(&self, z: &Self::State, e: &T, dt: T) -> (Self::State, T) {
        let (r, rows) = (self.gain.moving(&z.r, *e), self.rows(&z.r, *e));
        let mut power = T::ONE;
        let k = self.k.map(|k| {
            power *= r;
            power * k
        });
        let (gone, phi) = phi::<T, N>(k[0] * dt);
        let g = SVector::from_fn(|i, _| {
            let (mut sum, mut power) = (T::NEG_ZERO, T::ONE);
            for m in 0..N - i {
                power *= dt;
                sum += k[i + m] * power * phi[m];
            }
            sum * rows[i]
        });
        let r = driven::<T, G, N>(&self.gain, &z.r, *e);
        let moves = StandardState { x_hat: self.in_unit(&z.x_hat, g), r: r.zip(&r, |r, _| dt * r) };
        (moves, *e - rows[0] + rows[0] * gone)
    }
}

/// Memory of an observer under the gain law G.
type Moved<T, G, const N: usize> = StandardState<T, <G as GainLaw<T>>::Memory, N>;

impl<T, G, Md, const N: usize, const M: usize> Flow<T, Moved<T, G, N>, SVector<T, M>>
    for StandardObserver<T, G, Md, N, M>
where
    T: Scalar,
    G: GainLaw<T>,
    Md: Model<T, N, M>,
{
    type Terms = SVector<T, N>;

    #[inline(always)]
    fn terms(&self, t: T, z: &Moved<T, G, N>, u: &SVector<T, M>) -> Self::Terms {
        self.known(t, &z.x_hat, u)
    }

    #[inline(always)]
    fn flow(&self, z: &Moved<T, G, N>, f: &Self::Terms, dt: T) -> Moved<T, G, N> {
        StandardState {
            x_hat: ahead(&z.x_hat, &(self.chain(&z.x_hat) + f), dt),
            r: z.r.plus(dt, &self.gain.rate::<N>(&z.r, T::ZERO)),
        }
    }

    #[inline(always)]
    fn chain(&self, delta: &SVector<T, N>) -> Self::Terms {
        chain(delta, self.model.carries())
    }

    #[inline(always)]
    fn shifted(&self, z: &Moved<T, G, N>, delta: &SVector<T, N>) -> Moved<T, G, N> {
        StandardState { x_hat: z.x_hat + delta, ..*z }
    }
}
