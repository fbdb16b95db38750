//! Floor 0. Memories: what a law moves from step to step, as a small vector space.
//!
//! A memory is a `Copy` struct of a fixed number of scalars. It can be added to (so that any
//! integration scheme works on it) and visited in a fixed order (so that it flattens to columns,
//! records and bytes). Tuples and arrays of memories are memories: plant and observer together
//! are one, and so is a collection of observers.

use crate::Scalar;
use nalgebra::SVector;

/// What is done with each column of a memory: a type whose method is sure to be inlined, as a
/// closure is not.
pub trait EachColumn<T, const L: usize> {
    /// Take column number `index`.
    fn take(&mut self, index: usize, column: &[T; L]);
}

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

    /// L memories by columns: each scalar of all of them side by side.
    type Columns<const L: usize>: Copy;
    /// L times this memory.
    fn in_columns<const L: usize>(&self) -> Self::Columns<L>;
    /// Memory number `lane`.
    fn load<const L: usize>(columns: &Self::Columns<L>, lane: usize) -> Self;
    /// Put this memory in the place of number `lane`.
    fn store<const L: usize>(&self, columns: &mut Self::Columns<L>, lane: usize);
    /// The column of scalar number `index`; `None` beyond the last.
    fn column<const L: usize>(columns: &Self::Columns<L>, index: usize) -> Option<&[T; L]>;
    /// Visit every column in order with its number, which is counted from `first`.
    #[inline(always)]
    fn each_column<const L: usize>(
        columns: &Self::Columns<L>,
        first: usize,
        f: &mut impl EachColumn<T, L>,
    ) {
        for i in 0..Self::LEN {
            if let Some(column) = Self::column(columns, i) {
                f.take(first + i, column);
            }
        }
    }

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

    /// The largest of `so_far` and the entries' magnitudes; NaN is passed over.
    #[inline(always)]
    #[must_use]
    fn largest(&self, so_far: T) -> T {
        let mut largest = so_far;
        self.visit(&mut |x| largest = largest.max(x.abs()));
        largest
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
    type Columns<const L: usize> = ();
    #[inline(always)]
    fn in_columns<const L: usize>(&self) {}
    #[inline(always)]
    fn load<const L: usize>((): &(), _: usize) {}
    #[inline(always)]
    fn store<const L: usize>(&self, (): &mut (), _: usize) {}
    #[inline(always)]
    fn column<const L: usize>((): &(), _: usize) -> Option<&[T; L]> {
        None
    }
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
    type Columns<const L: usize> = [T; L];
    #[inline(always)]
    fn in_columns<const L: usize>(&self) -> [T; L] {
        [*self; L]
    }
    #[inline(always)]
    fn load<const L: usize>(column: &[T; L], lane: usize) -> Self {
        column[lane]
    }
    #[inline(always)]
    fn store<const L: usize>(&self, column: &mut [T; L], lane: usize) {
        column[lane] = *self;
    }
    #[inline(always)]
    fn column<const L: usize>(column: &[T; L], index: usize) -> Option<&[T; L]> {
        (index == 0).then_some(column)
    }
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

impl<T: Scalar, const N: usize> Memory<T> for SVector<T, N> {
    const LEN: usize = N;
    type Columns<const L: usize> = [[T; L]; N];
    #[inline(always)]
    fn in_columns<const L: usize>(&self) -> [[T; L]; N] {
        core::array::from_fn(|i| [self[i]; L])
    }
    #[inline(always)]
    fn load<const L: usize>(columns: &[[T; L]; N], lane: usize) -> Self {
        Self::from_fn(|i, _| columns[i][lane])
    }
    #[inline(always)]
    fn store<const L: usize>(&self, columns: &mut [[T; L]; N], lane: usize) {
        for (column, x) in columns.iter_mut().zip(self.iter()) {
            column[lane] = *x;
        }
    }
    #[inline(always)]
    fn column<const L: usize>(columns: &[[T; L]; N], index: usize) -> Option<&[T; L]> {
        columns.get(index)
    }
    #[inline(always)]
    fn zero() -> Self {
        SVector::from_element(T::ZERO)
    }
    #[inline(always)]
    fn zip(&self, other: &Self, f: impl Fn(T, T) -> T + Copy) -> Self {
        let mut zipped = *self;
        for i in 0..N {
            zipped[i] = f(self[i], other[i]);
        }
        zipped
    }
    #[inline(always)]
    fn visit(&self, f: &mut impl FnMut(T)) {
        for i in 0..N {
            f(self[i]);
        }
    }
    #[inline(always)]
    fn visit_mut(&mut self, f: &mut impl FnMut(&mut T)) {
        for i in 0..N {
            f(&mut self[i]);
        }
    }
}

impl<T: Scalar, A: Memory<T>, B: Memory<T>> Memory<T> for (A, B) {
    const LEN: usize = A::LEN + B::LEN;
    type Columns<const L: usize> = (A::Columns<L>, B::Columns<L>);
    #[inline(always)]
    fn in_columns<const L: usize>(&self) -> Self::Columns<L> {
        (self.0.in_columns(), self.1.in_columns())
    }
    #[inline(always)]
    fn load<const L: usize>(columns: &Self::Columns<L>, lane: usize) -> Self {
        (A::load(&columns.0, lane), B::load(&columns.1, lane))
    }
    #[inline(always)]
    fn store<const L: usize>(&self, columns: &mut Self::Columns<L>, lane: usize) {
        self.0.store(&mut columns.0, lane);
        self.1.store(&mut columns.1, lane);
    }
    #[inline(always)]
    fn column<const L: usize>(columns: &Self::Columns<L>, index: usize) -> Option<&[T; L]> {
        match index.checked_sub(A::LEN) {
            None => A::column(&columns.0, index),
            Some(index) => B::column(&columns.1, index),
        }
    }
    #[inline(always)]
    fn each_column<const L: usize>(
        columns: &Self::Columns<L>,
        first: usize,
        f: &mut impl EachColumn<T, L>,
    ) {
        A::each_column(&columns.0, first, f);
        B::each_column(&columns.1, first + A::LEN, f);
    }
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
    type Columns<const L: usize> = [A::Columns<L>; C];
    #[inline(always)]
    fn in_columns<const L: usize>(&self) -> Self::Columns<L> {
        core::array::from_fn(|i| self[i].in_columns())
    }
    #[inline(always)]
    fn load<const L: usize>(columns: &Self::Columns<L>, lane: usize) -> Self {
        core::array::from_fn(|i| A::load(&columns[i], lane))
    }
    #[inline(always)]
    fn store<const L: usize>(&self, columns: &mut Self::Columns<L>, lane: usize) {
        for (column, a) in columns.iter_mut().zip(self) {
            a.store(column, lane);
        }
    }
    #[inline(always)]
    fn column<const L: usize>(columns: &Self::Columns<L>, index: usize) -> Option<&[T; L]> {
        let copy = columns.get(index.checked_div(A::LEN)?)?;
        A::column(copy, index % A::LEN)
    }
    #[inline(always)]
    fn each_column<const L: usize>(
        columns: &Self::Columns<L>,
        first: usize,
        f: &mut impl EachColumn<T, L>,
    ) {
        for (i, copy) in columns.iter().enumerate() {
            A::each_column(copy, first + i * A::LEN, f);
        }
    }
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
