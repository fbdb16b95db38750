//! Floor 3. Outputs that wrap: an angle that begins again after a turn, a counter that overflows.
//!
//! Such an output is known to a whole number of turns. An observer of it takes the sample by its innovation
//! reduced to the nearest turn, y − ŷ − L ⌊(y − ŷ)/L⌉ for turns of the length L, and keeps its estimate
//! within half a turn of 0, so that the digits of a float are those of an angle however long the axis turns.

use crate::Scalar;
use crate::error::{DesignError, positive};
use crate::memory::Memory;
use crate::observer::{
    Causal, ContinuousLaw, Current, Discretised, Observer, Scheme, Status, Timing,
};
use crate::observers::{FilteredObserver, LowPower, StandardObserver};

/// A turn: the length after which an output begins again.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Turn<T> {
    length: T,
    per: T,
}

crate::error::through_constructor! {
    [T: Scalar] Turn<T>: turn => { length: T = turn.length } => Self::new(length)
}

impl<T: Scalar> Turn<T> {
    /// A turn of this length > 0, in the unit of the output: 2π rad, 65 536 counts.
    ///
    /// # Errors
    /// A length that is not finite or ≤ 0, or whose reciprocal is not finite.
    pub fn new(length: T) -> Result<Self, DesignError> {
        let per = positive("wrap (its reciprocal)", T::ONE / positive("wrap", length)?)?;
        Ok(Self { length, per })
    }

    /// The whole number of turns nearest to `value`, as a length: `value` less it lies within half a turn
    /// of 0.
    #[inline(always)]
    pub fn whole(&self, value: T) -> T {
        self.length * (value * self.per).nearest()
    }
}

/// Laws of whose memory the first entry, and no other, is of the output's coordinate: those of one chain.
pub trait OneChain {}

impl<T, G, Md, const N: usize, const M: usize> OneChain for StandardObserver<T, G, Md, N, M> {}
impl<T, G, Md, S, const N: usize, const M: usize> OneChain for LowPower<T, G, Md, S, N, M> {}
impl<T, G, Md, const N: usize, const K: usize, const M: usize> OneChain
    for FilteredObserver<T, G, Md, N, K, M>
{
}
impl<L: OneChain, S> OneChain for Discretised<L, S> {}
impl<L: OneChain, S> OneChain for Current<L, S> {}

/// An observer of an output that wraps.
///
/// ```
/// use hgo_rs::prelude::*;
///
/// let k = coefficients_from_poles([(-1.0, 0.0), (-2.0, 0.0)])?;
/// let law: StandardObserver<f32, _, _, 2, 0> =
///     StandardObserver::new(k.map(|k| k as f32), ConstantGain::new(40.0)?, Unknown)?;
/// let observer = Wrapped { observer: Current { law, scheme: Euler }, turn: Turn::new(4096.0)? };
/// let mut z = observer.initial();
/// for count in (0_u16..30_000).map(|k| k.wrapping_mul(7) % 4096) {
///     observer.correct(&mut z, &f32::from(count), 0.0);
///     observer.predict(&mut z, &no_input(), 0.0, 0.001);
/// }
/// assert!((observer.estimate(&z)[1] - 7_000.0).abs() < 1.0); // counts/s
/// # Ok::<(), DesignError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Wrapped<O, T> {
    /// The same of one that does not.
    pub observer: O,
    /// Its turn.
    pub turn: Turn<T>,
}

crate::error::through_constructor! {
    [T: Scalar, O: Copy] Wrapped<O, T>: wrapped => {
        observer: O = wrapped.observer,
        turn: Turn<T> = wrapped.turn,
    }
    => Ok(Self { observer, turn })
}

impl<T: Scalar, O: Observer<T, Measurement = T> + OneChain> Wrapped<O, T> {
    /// The sample, moved by whole turns to the nearest to its prediction.
    #[inline(always)]
    fn near(&self, z: &O::State, y: T) -> T {
        match self.observer.estimate(z).first() {
            Some(x1) => y - self.turn.whole(y - *x1),
            None => y,
        }
    }

    /// The estimate brought back to within half a turn of 0.
    #[inline(always)]
    fn back(&self, z: &mut O::State, status: Status) -> Status {
        let x1 = self.observer.estimate(z).first().copied();
        let mut beyond = x1.map_or(T::ZERO, |x1| self.turn.whole(x1));
        z.visit_mut(&mut |entry| {
            *entry -= beyond;
            beyond = T::ZERO; // of all others
        });
        status
    }

    /// A memory whose estimate is a first sample, where it is there.
    #[must_use]
    pub fn from_first(&self, y: T) -> O::State {
        let mut z = self.initial();
        let mut first = y.is_finite();
        z.visit_mut(&mut |entry| {
            *entry = if first { y - self.turn.whole(y) } else { *entry };
            first = false;
        });
        z
    }
}

impl<T, O> Observer<T> for Wrapped<O, T>
where
    T: Scalar,
    O: Observer<T, Measurement = T> + OneChain,
{
    type State = O::State;
    type Measurement = T;
    type Input = O::Input;
    const TIMING: Timing = O::TIMING;
    const ESTIMATED: usize = O::ESTIMATED;

    fn initial(&self) -> O::State {
        self.observer.initial()
    }
    #[inline(always)]
    fn correct(&self, z: &mut O::State, y: &T, t: T) -> Status {
        let status = self.observer.correct(z, &self.near(z, *y), t);
        self.back(z, status)
    }
    #[inline(always)]
    fn advance(&self, z: &mut O::State, y: &T, u: &O::Input, t: T, dt: T) -> Status {
        let status = self.observer.advance(z, &self.near(z, *y), u, t, dt);
        self.back(z, status)
    }
    #[inline(always)]
    fn predict(&self, z: &mut O::State, u: &O::Input, t: T, dt: T) -> Status {
        let status = self.observer.predict(z, u, t, dt);
        self.back(z, status)
    }
    #[inline(always)]
    fn held(&self, z: &O::State, dt: T) -> O::State {
        self.observer.held(z, dt)
    }
    #[inline(always)]
    fn speed(&self, z: &O::State) -> T {
        self.observer.speed(z)
    }
    #[inline(always)]
    fn estimate<'a>(&self, z: &'a O::State) -> &'a [T] {
        self.observer.estimate(z)
    }
    #[inline(always)]
    fn innovation(&self, t: T, z: &O::State, y: &T, u: &O::Input) -> T {
        self.observer.innovation(t, z, &self.near(z, *y), u)
    }
    #[inline(always)]
    fn prepared(&self, dt: T) -> Self {
        Self { observer: self.observer.prepared(dt), turn: self.turn }
    }
}

impl<T: Scalar, L: ContinuousLaw<T> + OneChain, S: Scheme<T, L>> Causal<T>
    for Wrapped<Current<L, S>, T>
{
}
