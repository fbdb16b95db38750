//! Floor 0. Memories: what a law moves from step to step, as a small vector space.
//!
//! A memory is a `Copy` struct of a fixed number of scalars. It can be added to (so that any
//! integration scheme works on it) and visited in a fixed order (so that it flattens to columns,
//! records and bytes). A law's memory is declared with [`memory_struct!`](crate::memory_struct), which
//! names its parts. Pairs and arrays of memories are memories: plant and observer together are one,
//! and so is a collection of observers.

use crate::Scalar;
use core::ops::{Deref, DerefMut};
use nalgebra::{SMatrix, SVector};

/// A fixed number of scalars of type `T` in a fixed order.
pub trait Memory<T: Scalar>: Copy {
    /// How many scalars.
    const LEN: usize;
    /// All zeros.
    fn zero() -> Self;
    /// Combine entry by entry with another memory of the same kind.
    #[must_use]
    fn zip(&self, other: &Self, f: impl Fn(T, T) -> T + Copy) -> Self;
    /// Visit every scalar in order.
    fn visit(&self, f: &mut impl FnMut(T));
    /// Visit and change every scalar in order.
    fn visit_mut(&mut self, f: &mut impl FnMut(&mut T));

    /// self + h·rate.
    #[inline(always)]
    #[must_use]
    fn plus(&self, h: T, rate: &Self) -> Self {
        self.zip(rate, |x, r| x + h * r)
    }

    /// No entry is NaN, infinite or larger in magnitude than `bound`.
    #[inline(always)]
    fn within(&self, bound: T) -> bool {
        let mut inside = true;
        self.visit(&mut |x| inside &= x.abs() <= bound);
        inside
    }

    /// Copy the scalars into `out` (as many as fit).
    #[inline(always)]
    fn write(&self, out: &mut [T]) {
        let mut slots = out.iter_mut();
        self.visit(&mut |x| {
            if let Some(slot) = slots.next() {
                *slot = x;
            }
        });
    }

    /// A memory from the first `LEN` scalars of `values`; missing ones are 0.
    #[inline(always)]
    fn read(values: &[T]) -> Self {
        let mut memory = Self::zero();
        let mut next = values.iter();
        memory.visit_mut(&mut |x| {
            if let Some(value) = next.next() {
                *x = *value;
            }
        });
        memory
    }
}

impl<T: Scalar> Memory<T> for () {
    const LEN: usize = 0;
    #[inline(always)]
    fn zero() -> Self {}
    #[inline(always)]
    fn zip(&self, (): &Self, _: impl Fn(T, T) -> T + Copy) -> Self {}
    #[inline(always)]
    fn visit(&self, _: &mut impl FnMut(T)) {}
    #[inline(always)]
    fn visit_mut(&mut self, _: &mut impl FnMut(&mut T)) {}
}

impl<T: Scalar> Memory<T> for T {
    const LEN: usize = 1;
    #[inline(always)]
    fn zero() -> Self {
        T::ZERO
    }
    #[inline(always)]
    fn zip(&self, other: &Self, f: impl Fn(T, T) -> T + Copy) -> Self {
        f(*self, *other)
    }
    #[inline(always)]
    fn visit(&self, f: &mut impl FnMut(T)) {
        f(*self);
    }
    #[inline(always)]
    fn visit_mut(&mut self, f: &mut impl FnMut(&mut T)) {
        f(self);
    }
}

/// A vector, or a matrix column by column.
impl<T: Scalar, const N: usize, const C: usize> Memory<T> for SMatrix<T, N, C> {
    const LEN: usize = N * C;
    #[inline(always)]
    fn zero() -> Self {
        SMatrix::from_element(T::ZERO)
    }
    #[inline(always)]
    fn zip(&self, other: &Self, f: impl Fn(T, T) -> T + Copy) -> Self {
        let mut zipped = *self;
        for i in 0..N * C {
            zipped[i] = f(self[i], other[i]);
        }
        zipped
    }
    #[inline(always)]
    fn visit(&self, f: &mut impl FnMut(T)) {
        for i in 0..N * C {
            f(self[i]);
        }
    }
    #[inline(always)]
    fn visit_mut(&mut self, f: &mut impl FnMut(&mut T)) {
        for i in 0..N * C {
            f(&mut self[i]);
        }
    }
}

impl<T: Scalar, A: Memory<T>, B: Memory<T>> Memory<T> for (A, B) {
    const LEN: usize = A::LEN + B::LEN;
    #[inline(always)]
    fn zero() -> Self {
        (A::zero(), B::zero())
    }
    #[inline(always)]
    fn zip(&self, other: &Self, f: impl Fn(T, T) -> T + Copy) -> Self {
        (self.0.zip(&other.0, f), self.1.zip(&other.1, f))
    }
    #[inline(always)]
    fn visit(&self, f: &mut impl FnMut(T)) {
        self.0.visit(f);
        self.1.visit(f);
    }
    #[inline(always)]
    fn visit_mut(&mut self, f: &mut impl FnMut(&mut T)) {
        self.0.visit_mut(f);
        self.1.visit_mut(f);
    }
}

impl<T: Scalar, A: Memory<T>, const C: usize> Memory<T> for [A; C] {
    const LEN: usize = C * A::LEN;
    #[inline(always)]
    fn zero() -> Self {
        [A::zero(); C]
    }
    #[inline(always)]
    fn zip(&self, other: &Self, f: impl Fn(T, T) -> T + Copy) -> Self {
        core::array::from_fn(|i| self[i].zip(&other[i], f))
    }
    #[inline(always)]
    fn visit(&self, f: &mut impl FnMut(T)) {
        for a in self {
            a.visit(f);
        }
    }
    #[inline(always)]
    fn visit_mut(&mut self, f: &mut impl FnMut(&mut T)) {
        for a in self {
            a.visit_mut(f);
        }
    }
}

/// The entries of a vector but its last D, which no memory counts: more slots than entries, where the
/// size N − D cannot be written.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AllBut<T: Scalar, const N: usize, const D: usize>(SVector<T, N>);

/// The entries of a vector but its last.
pub type AllButLast<T, const N: usize> = AllBut<T, N, 1>;

impl<T: Scalar, const N: usize, const D: usize> From<SVector<T, N>> for AllBut<T, N, D> {
    #[inline(always)]
    fn from(entries: SVector<T, N>) -> Self {
        Self(entries)
    }
}

impl<T: Scalar, const N: usize, const D: usize> Deref for AllBut<T, N, D> {
    type Target = SVector<T, N>;
    #[inline(always)]
    fn deref(&self) -> &SVector<T, N> {
        &self.0
    }
}

impl<T: Scalar, const N: usize, const D: usize> DerefMut for AllBut<T, N, D> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut SVector<T, N> {
        &mut self.0
    }
}

impl<T: Scalar, const N: usize, const D: usize> Memory<T> for AllBut<T, N, D> {
    const LEN: usize = N.saturating_sub(D);
    #[inline(always)]
    fn zero() -> Self {
        Self(SVector::zero())
    }
    #[inline(always)]
    fn zip(&self, other: &Self, f: impl Fn(T, T) -> T + Copy) -> Self {
        let entry = |i| if i < Self::LEN { f(self.0[i], other.0[i]) } else { T::ZERO };
        Self(SVector::from_fn(|i, _| entry(i)))
    }
    #[inline(always)]
    fn visit(&self, f: &mut impl FnMut(T)) {
        for i in 0..Self::LEN {
            f(self.0[i]);
        }
    }
    #[inline(always)]
    fn visit_mut(&mut self, f: &mut impl FnMut(&mut T)) {
        for i in 0..Self::LEN {
            f(&mut self.0[i]);
        }
    }
}

/// The lower triangle of a square matrix, row by row; no memory counts what is above.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LowerTriangle<T: Scalar, const N: usize>(SMatrix<T, N, N>);

impl<T: Scalar, const N: usize> LowerTriangle<T, N> {
    /// From its entries (row, column).
    #[inline(always)]
    pub fn from_fn(entry: impl Fn(usize, usize) -> T) -> Self {
        Self(SMatrix::from_fn(|i, j| if j <= i { entry(i, j) } else { T::ZERO }))
    }
}

impl<T: Scalar, const N: usize> Deref for LowerTriangle<T, N> {
    type Target = SMatrix<T, N, N>;
    #[inline(always)]
    fn deref(&self) -> &SMatrix<T, N, N> {
        &self.0
    }
}

impl<T: Scalar, const N: usize> DerefMut for LowerTriangle<T, N> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut SMatrix<T, N, N> {
        &mut self.0
    }
}

impl<T: Scalar, const N: usize> Memory<T> for LowerTriangle<T, N> {
    const LEN: usize = N * (N + 1) / 2;
    #[inline(always)]
    fn zero() -> Self {
        Self::from_fn(|_, _| T::ZERO)
    }
    #[inline(always)]
    fn zip(&self, other: &Self, f: impl Fn(T, T) -> T + Copy) -> Self {
        Self::from_fn(|i, j| f(self.0[(i, j)], other.0[(i, j)]))
    }
    #[inline(always)]
    fn visit(&self, f: &mut impl FnMut(T)) {
        for i in 0..N {
            for j in 0..=i {
                f(self.0[(i, j)]);
            }
        }
    }
    #[inline(always)]
    fn visit_mut(&mut self, f: &mut impl FnMut(&mut T)) {
        for i in 0..N {
            for j in 0..=i {
                f(&mut self.0[(i, j)]);
            }
        }
    }
}

/// Declare a memory: a struct of parts that are memories, in the order of its entries.
///
/// Parameters are the scalar, parts left open, and sizes after a semicolon. The struct is `Copy` and
/// has a [`Memory`](crate::memory::Memory) that visits the parts in order.
///
/// ```
/// use hgo_rs::{Scalar, memory::Memory};
/// use hgo_rs::nalgebra::SVector;
///
/// hgo_rs::memory_struct! {
///     /// Memory of an observer with a filter on its innovation.
///     pub struct FilteredState<T, R: Memory; const N: usize> {
///         /// Estimate x̂.
///         pub x_hat: SVector<T, N>,
///         /// Filter.
///         pub w: T,
///         /// Moving gain r, or nothing.
///         pub r: R,
///     }
/// }
///
/// let z = FilteredState::<f64, (), 2>::read(&[1.0, 2.0, 3.0]);
/// assert_eq!((z.x_hat[1], z.w), (2.0, 3.0));
/// assert_eq!(FilteredState::<f64, f64, 2>::LEN, 4);
/// ```
#[macro_export]
macro_rules! memory_struct {
    (
        $(#[$attribute:meta])*
        $access:vis struct $name:ident
            <$T:ident $(, $part:ident: Memory)* $(; $(const $size:ident: usize),+)?>
        {
            $($(#[$doc:meta])* $shown:vis $field:ident: $kind:ty),+ $(,)?
        }
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        $access struct $name<
            $T: $crate::Scalar
            $(, $part: $crate::memory::Memory<$T>)*
            $($(, const $size: usize)+)?
        > {
            $($(#[$doc])* $shown $field: $kind),+
        }

        impl<
            $T: $crate::Scalar
            $(, $part: $crate::memory::Memory<$T>)*
            $($(, const $size: usize)+)?
        > $crate::memory::Memory<$T> for $name<$T $(, $part)* $($(, $size)+)?> {
            const LEN: usize = 0 $(+ <$kind as $crate::memory::Memory<$T>>::LEN)+;
            #[inline(always)]
            fn zero() -> Self {
                Self { $($field: <$kind as $crate::memory::Memory<$T>>::zero()),+ }
            }
            #[inline(always)]
            fn zip(&self, other: &Self, f: impl Fn($T, $T) -> $T + Copy) -> Self {
                Self {
                    $($field: <$kind as $crate::memory::Memory<$T>>::zip(
                        &self.$field,
                        &other.$field,
                        f,
                    )),+
                }
            }
            #[inline(always)]
            fn visit(&self, f: &mut impl FnMut($T)) {
                $(<$kind as $crate::memory::Memory<$T>>::visit(&self.$field, f);)+
            }
            #[inline(always)]
            fn visit_mut(&mut self, f: &mut impl FnMut(&mut $T)) {
                $(<$kind as $crate::memory::Memory<$T>>::visit_mut(&mut self.$field, f);)+
            }
        }
    };
}
