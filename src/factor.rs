//! Floor 1. A covariance as P = L D Lᵀ, L unit lower triangular, D diagonal: symmetric by what is stored, and
//! positive by how it moves, in single precision too.
//!
//! Each of the three ways in which it moves gives D by sums and quotients of numbers that are not negative:
//!
//! - P⁺ = W D Wᵀ by weighted Gram-Schmidt (Thornton), for a change of coordinates or a period of a filter;
//! - P⁺ = P + c v vᵀ (Agee and Turner), for noise;
//! - P⁺ = P − P cᵀ c P/(c P cᵀ + R), c a row of the unit matrix (Bierman), for a measurement.
//!
//! Bierman, Factorization Methods for Discrete Sequential Estimation (1977), chapters III, V and VI, which
//! writes U D Uᵀ. With L the state that is measured, the first one of a chain, comes first: its measurement
//! changes one number, d₁ to d₁ R/(d₁ + R).

use crate::Scalar;
use crate::error::{DesignError, require};
use crate::memory::{LowerTriangle, Memory};
use core::cmp::Ordering::{Equal, Greater, Less};
use nalgebra::{SMatrix, SVector};

crate::memory_struct! {
    /// L below the diagonal, D on it. As a memory: row by row, N(N + 1)/2 entries.
    #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
    #[cfg_attr(feature = "defmt", derive(defmt::Format))]
    pub struct Factor<T; const N: usize> {
        ld: LowerTriangle<T, N>,
    }
}

impl<T: Scalar, const N: usize> Factor<T, N> {
    /// Of a covariance, of which the lower triangle is read. Where a diagonal entry of D is 0, so is its
    /// column of L.
    ///
    /// # Errors
    /// One that is not positive semidefinite, naming `parameter`.
    pub fn of(parameter: &'static str, p: &SMatrix<T, N, N>) -> Result<Self, DesignError> {
        let allowed = "it must be a finite matrix, symmetric and positive semidefinite";
        let mut f = Self::zero();
        for j in 0..N {
            let mut d = p[(j, j)];
            for k in 0..j {
                d -= f.ld[(j, k)] * f.ld[(j, k)] * f.ld[(k, k)];
            }
            // what rounding leaves of a pivot that is 0
            let rounded = T::from_f64(1e-6) * p[(j, j)].abs();
            let singular = d.abs() <= rounded * T::from_f64(1e-6);
            let pivot = if singular { T::ZERO } else { d };
            require(parameter, d, d.is_finite() && pivot >= T::ZERO, allowed)?;
            f.ld[(j, j)] = pivot;
            for i in j + 1..N {
                let mut entry = p[(i, j)];
                for k in 0..j {
                    entry -= f.ld[(i, k)] * f.ld[(j, k)] * f.ld[(k, k)];
                }
                let size = T::from_f64(1e-6) * (p[(i, i)].abs() * p[(j, j)].abs()).sqrt();
                let holds = entry.is_finite() && (!singular || entry.abs() <= size);
                require(parameter, p[(i, j)], holds, allowed)?;
                f.ld[(i, j)] = if singular { T::ZERO } else { entry / pivot };
            }
        }
        Ok(f)
    }

    /// P.
    pub fn covariance(&self) -> SMatrix<T, N, N> {
        SMatrix::from_fn(|i, j| {
            let mut entry = T::NEG_ZERO;
            for k in 0..=i.min(j) {
                entry += self.l(i, k) * self.l(j, k) * self.d(k);
            }
            entry
        })
    }

    /// Entry of L.
    #[inline(always)]
    pub fn l(&self, i: usize, j: usize) -> T {
        match i.cmp(&j) {
            Less => T::NEG_ZERO,
            Equal => T::ONE,
            Greater => self.ld[(i, j)],
        }
    }

    /// Entry of D.
    #[inline(always)]
    pub fn d(&self, i: usize) -> T {
        self.ld[(i, i)]
    }

    /// L by its columns.
    #[inline(always)]
    pub fn columns(&self) -> [SVector<T, N>; N] {
        core::array::from_fn(|j| SVector::from_fn(|i, _| self.l(i, j)))
    }

    /// From its entries: (i, j) with j ≤ i.
    #[inline(always)]
    pub fn from_fn(entry: impl Fn(usize, usize) -> T) -> Self {
        Self { ld: LowerTriangle::from_fn(entry) }
    }

    /// L⁻¹ v.
    #[inline(always)]
    pub fn solve(&self, v: &SVector<T, N>) -> SVector<T, N> {
        let mut solved = *v;
        for i in 0..N {
            for k in 0..i {
                let known = self.ld[(i, k)] * solved[k];
                solved[i] -= known;
            }
        }
        solved
    }

    /// W D Wᵀ, W by its columns.
    #[inline(always)]
    #[must_use]
    pub fn moved(&self, mut w: [SVector<T, N>; N]) -> Self {
        let mut next = Self::zero();
        for i in 0..N {
            let weighted: [T; N] = core::array::from_fn(|k| self.d(k) * w[k][i]);
            let dot = |w: &[SVector<T, N>; N], row: usize| {
                let mut sum = T::NEG_ZERO;
                for k in 0..N {
                    sum += weighted[k] * w[k][row];
                }
                sum
            };
            let d = dot(&w, i);
            next.ld[(i, i)] = d;
            for a in i + 1..N {
                let l = dot(&w, a) / d.or(T::ONE);
                next.ld[(a, i)] = l;
                for column in &mut w {
                    let share = l * column[i];
                    column[a] -= share;
                }
            }
        }
        next
    }

    /// P + c v vᵀ, c ≥ 0.
    #[inline(always)]
    #[must_use]
    pub fn plus_noise(mut self, mut c: T, mut v: SVector<T, N>) -> Self {
        for j in 0..N {
            if v[j].is_nothing() {
                continue;
            }
            let share = c * v[j];
            let d = self.ld[(j, j)] + share * v[j];
            let (by, before) = (share / d.or(T::ONE), self.ld[(j, j)]);
            self.ld[(j, j)] = d;
            for i in j + 1..N {
                let known = v[j] * self.ld[(i, j)];
                v[i] -= known;
                self.ld[(i, j)] += by * v[i];
            }
            c *= before / d.or(T::ONE);
        }
        self
    }

    /// After a measurement of state `at` with noise of variance r, and the gains of its innovation. Where
    /// `taken` is 0 nothing moves; else it is 1.
    #[inline(always)]
    pub fn measured(mut self, at: usize, r: T, taken: T) -> (Self, SVector<T, N>) {
        let (mut variance, mut gains) = (r, SVector::<T, N>::from_element(T::NEG_ZERO));
        let row: [T; N] = core::array::from_fn(|j| match j.cmp(&at) {
            Less => self.ld.get((at, j)).copied().unwrap_or(T::ZERO),
            Equal => T::ONE,
            Greater => T::NEG_ZERO,
        });
        for j in (0..N).rev().filter(|j| *j <= at) {
            let f = taken * row[j];
            let v = self.d(j) * f;
            let next = variance + f * v;
            let down = f / variance;
            self.ld[(j, j)] *= variance / next;
            for i in j + 1..N {
                let l = self.ld[(i, j)];
                self.ld[(i, j)] = l - down * gains[i];
                gains[i] += v * l;
            }
            gains[j] = v;
            variance = next;
        }
        (self, gains.map(|gain| gain / variance))
    }
}
