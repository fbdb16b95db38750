//! Floor 2. Outputs that wrap: an angle that begins again after a turn, a counter that overflows.
//!
//! Such an output is known to a whole number of turns. An observer of it takes the sample by its innovation
//! reduced to the nearest turn, y − ŷ − L ⌊(y − ŷ)/L⌉ for turns of the length L, and keeps its estimate
//! within half a turn of 0, so that the digits of a float are those of an angle however long the axis turns.

use crate::Scalar;
use crate::error::{DesignError, positive};

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
