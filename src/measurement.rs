//! Floor 0. Measurements: memories of a few scalars that may be missing.

use crate::Scalar;
use crate::memory::Memory;
use nalgebra::SVector;

/// A measured value: one scalar, or a vector of them.
pub trait Measurement<T: Scalar>: Memory<T> {
    /// No entry is NaN or infinite.
    fn is_present(&self) -> bool;
    /// Every entry from `entries`, in order.
    fn fill(entries: impl FnMut() -> T) -> Self;
    /// Entry by entry sum.
    #[must_use]
    fn plus(self, other: Self) -> Self;
    /// Every entry in order.
    fn each(&self, f: &mut impl FnMut(T));
}

impl<T: Scalar> Measurement<T> for T {
    #[inline(always)]
    fn is_present(&self) -> bool {
        self.is_finite()
    }
    #[inline(always)]
    fn fill(mut entries: impl FnMut() -> T) -> T {
        entries()
    }
    #[inline(always)]
    fn plus(self, other: T) -> T {
        self + other
    }
    #[inline(always)]
    fn each(&self, f: &mut impl FnMut(T)) {
        f(*self);
    }
}

impl<T: Scalar, const N: usize> Measurement<T> for SVector<T, N> {
    #[inline(always)]
    fn is_present(&self) -> bool {
        self.iter().all(|y| y.is_finite())
    }
    #[inline(always)]
    fn fill(mut entries: impl FnMut() -> T) -> Self {
        let mut filled = Self::zero();
        for slot in filled.iter_mut() {
            *slot = entries();
        }
        filled
    }
    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self + other
    }
    #[inline(always)]
    fn each(&self, f: &mut impl FnMut(T)) {
        self.iter().for_each(|y| f(*y));
    }
}
