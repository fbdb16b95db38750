//! A collection of observers that repel each other, and the observer that learns from it.
//!
//! Sanfelice and Praly, section 3. Near the edge of stability the adaptive gain (6) may
//! oscillate. C copies of the observer, pushed apart by (23), sample its limit cycle; the mean of
//! their gains is the nominal gain r̄ (24), and the modified observer (25) runs with r·r̄.

use super::{StandardObserver, StandardState, checked, driven};
use crate::Scalar;
use crate::error::{DesignError, require};
use crate::gain::{AdaptiveGain, GainLaw};
use crate::model::Model;
use crate::observer::ContinuousLaw;
use nalgebra::SVector;

/// Memory of one copy: x̂ and r.
pub type CopyState<T, const N: usize> = StandardState<T, T, N>;

crate::memory_struct! {
    /// Memory of a modified observer.
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    pub struct ModifiedState<T, C: Memory; const N: usize> {
        /// x̂ and r of the observer that runs with r·r̄.
        pub main: CopyState<T, N>,
        /// x̂ and r of each copy.
        pub copies: C,
    }
}

/// C repelled copies, Sanfelice and Praly (23); the estimate is the first copy's.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RepelledCollection<T, Md, const N: usize, const C: usize, const M: usize = 0> {
    copy: StandardObserver<T, AdaptiveGain<T>, Md, N, M>,
    k_bar: SVector<T, N>,
}

crate::error::through_constructor! {
    [T: Scalar, Md: Model<T, N, M>, const N: usize, const C: usize, const M: usize]
    RepelledCollection<T, Md, N, C, M>: collection => {
        k: SVector<T, N> = collection.copy.k,
        k_bar: SVector<T, N> = collection.k_bar,
        gain: AdaptiveGain<T> = collection.copy.gain,
        model: Md = collection.copy.model,
    }
    => Self::new(k.into(), k_bar.into(), gain, model)
}

impl<T: Scalar, Md: Model<T, N, M>, const N: usize, const C: usize, const M: usize>
    RepelledCollection<T, Md, N, C, M>
{
    /// Coefficients k, repulsion gains k̄ = μP⁻¹(1, 0, …)ᵀ, adaptive gain law, model.
    ///
    /// # Errors
    /// Coefficients that are not finite or not Hurwitz; fewer than two copies.
    pub fn new(
        k: [T; N],
        k_bar: [T; N],
        gain: AdaptiveGain<T>,
        model: Md,
    ) -> Result<Self, DesignError> {
        require("copies", T::from_f64(C as f64), C >= 2, "a collection needs at least 2 copies")?;
        Ok(Self { copy: StandardObserver::new(k, gain, model)?, k_bar: checked("k_bar", k_bar)? })
    }

    /// Nominal gain r̄ = (1/C) Σ rᵢ (24).
    #[inline(always)]
    pub fn nominal_gain(&self, copies: &[CopyState<T, N>; C]) -> T {
        let mut sum = T::ZERO;
        for copy in copies {
            sum += copy.r;
        }
        sum / T::from_f64(C as f64)
    }

    /// The rates of the copies, each pushed away from the others by its output error (23).
    #[inline(always)]
    fn repelled(
        &self,
        copies: &[CopyState<T, N>; C],
        e: &[T; C],
        rate: impl Fn(&CopyState<T, N>, &T) -> CopyState<T, N>,
    ) -> [CopyState<T, N>; C] {
        let b = self.copy.gain().b();
        // eᵢ/rᵢᵇ, the output errors in the scaled coordinates (28)
        let powers: [T; C] = core::array::from_fn(|i| copies[i].r.powf(b));
        let scaled: [T; C] = core::array::from_fn(|i| e[i] / powers[i]);
        core::array::from_fn(|i| {
            let mut rates = rate(&copies[i], &e[i]);
            let mut apart = T::ZERO;
            for (j, other) in scaled.iter().enumerate() {
                if j != i {
                    apart += scaled[i] - *other;
                }
            }
            let r = copies[i].r;
            let mut factor = powers[i] * apart;
            let apart = self.k_bar.map(|k_bar| {
                factor *= r; // r^{j+b}
                k_bar * factor
            });
            rates.x_hat -= self.copy.in_unit(&copies[i].x_hat, apart); // (23), with eᵢ = −(ŷᵢ − y)
            rates
        })
    }
}

impl<T: Scalar, Md: Model<T, N, M>, const N: usize, const C: usize, const M: usize> ContinuousLaw<T>
    for RepelledCollection<T, Md, N, C, M>
{
    type State = [CopyState<T, N>; C];
    type Input = SVector<T, M>;
    type Innovation = [T; C];
    const ESTIMATED: usize = N;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        [self.copy.initial(); C]
    }

    #[inline(always)]
    fn innovation(&self, copies: &Self::State, y: T) -> [T; C] {
        core::array::from_fn(|i| self.copy.innovation(&copies[i], y))
    }

    #[inline(always)]
    fn rate(&self, t: T, copies: &Self::State, e: &[T; C], u: &Self::Input) -> Self::State {
        self.repelled(copies, e, |copy, e| self.copy.rate(t, copy, e, u))
    }

    #[inline(always)]
    fn injection(&self, copies: &Self::State, e: &[T; C]) -> Self::State {
        self.repelled(copies, e, |copy, e| self.copy.injection(copy, e))
    }

    #[inline(always)]
    fn stagger(&self, old: &Self::State, new: Self::State, dt: T) -> Self::State {
        core::array::from_fn(|i| self.copy.stagger(&old[i], new[i], dt))
    }

    #[inline(always)]
    fn admissible(&self, copies: Self::State) -> Self::State {
        copies.map(|z| self.copy.admissible(z))
    }

    /// The fastest copy's.
    #[inline(always)]
    fn speed(&self, copies: &Self::State) -> T {
        copies.iter().fold(T::ONE, |fastest, copy| fastest.max(copy.r))
    }

    #[inline(always)]
    fn estimate<'a>(&self, copies: &'a Self::State) -> &'a [T] {
        copies.first().map_or(&[], |copy| copy.x_hat.as_slice())
    }
}

/// The modified observer, Sanfelice and Praly (25): gain r·r̄, with r̄ from a collection beside it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ModifiedObserver<T, Md, const N: usize, const C: usize, const M: usize = 0> {
    /// The collection that learns the nominal gain.
    pub collection: RepelledCollection<T, Md, N, C, M>,
}

crate::error::through_constructor! {
    [T: Scalar, Md: Model<T, N, M>, const N: usize, const C: usize, const M: usize]
    ModifiedObserver<T, Md, N, C, M>: modified => {
        collection: RepelledCollection<T, Md, N, C, M> = modified.collection,
    }
    => Ok(Self { collection })
}

impl<T: Scalar, Md: Model<T, N, M>, const N: usize, const C: usize, const M: usize>
    ModifiedObserver<T, Md, N, C, M>
{
    /// What its collection is made of.
    ///
    /// # Errors
    /// As [`RepelledCollection::new`].
    pub fn new(
        k: [T; N],
        k_bar: [T; N],
        gain: AdaptiveGain<T>,
        model: Md,
    ) -> Result<Self, DesignError> {
        Ok(Self { collection: RepelledCollection::new(k, k_bar, gain, model)? })
    }
}

impl<T: Scalar, Md: Model<T, N, M>, const N: usize, const C: usize, const M: usize> ContinuousLaw<T>
    for ModifiedObserver<T, Md, N, C, M>
{
    type State = ModifiedState<T, [CopyState<T, N>; C], N>;
    type Input = SVector<T, M>;
    type Innovation = (T, [T; C]);
    const ESTIMATED: usize = N;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        ModifiedState { main: self.collection.copy.initial(), copies: self.collection.initial() }
    }

    #[inline(always)]
    fn innovation(&self, z: &Self::State, y: T) -> Self::Innovation {
        (self.collection.copy.innovation(&z.main, y), self.collection.innovation(&z.copies, y))
    }

    #[inline(always)]
    fn rate(
        &self,
        t: T,
        z: &Self::State,
        (e, errors): &Self::Innovation,
        u: &Self::Input,
    ) -> Self::State {
        let (observer, CopyState { x_hat, r }) = (&self.collection.copy, &z.main);
        let nominal = self.collection.nominal_gain(&z.copies);
        let main = CopyState {
            x_hat: observer.rate_under(t, x_hat, *r * nominal, &SVector::from_element(*e), u), // (25)
            r: observer.gain().rate::<N>(r, *e),
        };
        ModifiedState { main, copies: self.collection.rate(t, &z.copies, errors, u) }
    }

    #[inline(always)]
    fn injection(&self, z: &Self::State, (e, errors): &Self::Innovation) -> Self::State {
        let (observer, r) = (&self.collection.copy, z.main.r);
        let nominal = self.collection.nominal_gain(&z.copies);
        let main = CopyState {
            x_hat: observer.injected(&z.main.x_hat, r * nominal, &SVector::from_element(*e)),
            r: driven::<T, _, N>(observer.gain(), &r, *e),
        };
        ModifiedState { main, copies: self.collection.injection(&z.copies, errors) }
    }

    #[inline(always)]
    fn stagger(&self, old: &Self::State, new: Self::State, dt: T) -> Self::State {
        ModifiedState {
            main: self.collection.copy.stagger(&old.main, new.main, dt),
            copies: self.collection.stagger(&old.copies, new.copies, dt),
        }
    }

    #[inline(always)]
    fn admissible(&self, z: Self::State) -> Self::State {
        ModifiedState {
            main: self.collection.copy.admissible(z.main),
            copies: self.collection.admissible(z.copies),
        }
    }

    #[inline(always)]
    fn speed(&self, z: &Self::State) -> T {
        let main = z.main.r * self.collection.nominal_gain(&z.copies);
        main.max(self.collection.speed(&z.copies))
    }

    #[inline(always)]
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [T] {
        z.main.x_hat.as_slice()
    }
}
