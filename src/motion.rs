//! Floor 1. How what is known of a system moves over a period, where the chain of integrators is exact.
//!
//! Between samples a law is its chain A, driven by the known terms f̂(t, x̂, u):
//!
//!   x̂̇ = A x̂ + f̂(t, x̂, u),   u held                                                        (1)
//!
//! [`Held`] freezes f̂ at the beginning of the period and solves (1) exactly: order 1, and exact where f̂
//! depends on inputs alone. [`Rk4Motion`] keeps that solution z(s) and moves the deviation δ = x̂ − z from it,
//!
//!   δ̇ = A δ + f̂(t + s, z(s) + δ, u) − f̂(t, x̂, u),   δ(0) = 0,                              (2)
//!
//! by the classical Runge-Kutta scheme, whose first stage is 0: order 4, with the chain as exact as before.
//!
//! [`ImplicitMotion`] is for f̂ᵢ that jump or are steep in the state xᵢ that they move, such as dry friction.
//! It freezes f̂ at the end of the period (backward Euler),
//!
//!   x̂⁺ = e^{Ah} x̂ + ∫₀ʰ e^{As} ds F,   F = f̂(t + h, x̂⁺, u),                                (3)
//!
//! Where f̂ᵢ falls in xᵢ, Fᵢ lies between 0 and aᵢ = f̂ᵢ(t + h, x̂⁺ of F = 0, u). It is searched there by
//! [`HALVINGS`] bisections and a chord: |error of xᵢ| ≤ h |aᵢ| / 2^[`HALVINGS`], also at a jump, and none where
//! f̂ᵢ is linear. Steps with |fᵢ⁰| ≤ 2 |Fᵢ| in every row i, fᵢ⁰ the value of f̂ᵢ at (3) without Fᵢ, are not stiff
//! (h |∂f̂ᵢ/∂xᵢ| ≤ 1 along the secant) and are those of [`Rk4Motion`], so that smooth motion keeps its order.

use crate::Scalar;
use crate::error::{DesignError, require};
use crate::memory::Memory;

/// The parts of (1), for a memory Z and inputs U.
pub trait Flow<T: Scalar, Z, U> {
    /// Known terms, or a deviation: the first ones by the states of the estimate.
    type Terms: Memory<T>;
    /// f̂(t, x̂, u).
    fn terms(&self, t: T, z: &Z, u: &U) -> Self::Terms;
    /// The memory after a time dt along the chain, exact, under the terms `f`.
    fn flow(&self, z: &Z, f: &Self::Terms, dt: T) -> Z;
    /// The same under a sample that is held, where the chain leads into a filter of y − x̂₁.
    #[inline(always)]
    fn flow_under(&self, z: &Z, _y: T, f: &Self::Terms, dt: T) -> Z {
        self.flow(z, f, dt)
    }
    /// A δ.
    fn chain(&self, delta: &Self::Terms) -> Self::Terms;
    /// The memory with its estimate, and all that stands for an entry of it, moved by δ.
    fn shifted(&self, z: &Z, delta: &Self::Terms) -> Z;
    /// How many of the terms are those of a state: the first ones.
    #[inline(always)]
    fn rows(&self) -> usize {
        Self::Terms::LEN
    }
}

/// A law under a sample that is held over the period.
pub(crate) struct UnderSample<'a, T, L> {
    pub(crate) law: &'a L,
    pub(crate) y: T,
}

impl<T: Scalar, Z, U, L: Flow<T, Z, U>> Flow<T, Z, U> for UnderSample<'_, T, L> {
    type Terms = L::Terms;
    #[inline(always)]
    fn terms(&self, t: T, z: &Z, u: &U) -> L::Terms {
        self.law.terms(t, z, u)
    }
    #[inline(always)]
    fn flow(&self, z: &Z, f: &L::Terms, dt: T) -> Z {
        self.law.flow_under(z, self.y, f, dt)
    }
    #[inline(always)]
    fn chain(&self, delta: &L::Terms) -> L::Terms {
        self.law.chain(delta)
    }
    #[inline(always)]
    fn shifted(&self, z: &Z, delta: &L::Terms) -> Z {
        self.law.shifted(z, delta)
    }
    #[inline(always)]
    fn rows(&self) -> usize {
        self.law.rows()
    }
}

/// How the known terms move over a period.
pub trait Motion: Copy {
    /// The memory after the period dt that begins at time t, without a sample.
    fn moved<T, Z, U, L>(&self, law: &L, t: T, z: &Z, u: &U, dt: T) -> Z
    where
        T: Scalar,
        Z: Memory<T>,
        L: Flow<T, Z, U>;
}

/// f̂ of the period's beginning, held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Held;

impl Motion for Held {
    #[inline(always)]
    fn moved<T, Z, U, L>(&self, law: &L, t: T, z: &Z, u: &U, dt: T) -> Z
    where
        T: Scalar,
        Z: Memory<T>,
        L: Flow<T, Z, U>,
    {
        law.flow(z, &law.terms(t, z, u), dt)
    }
}

/// Steps that a period may be cut into.
pub const MAX_SUBSTEPS: u8 = 16;

/// Steps that a period is cut into where nothing else is said.
pub const SUBSTEPS: u8 = 2;

fn substeps(count: u8) -> Result<u8, DesignError> {
    let allowed = "a period is cut into 1 to 16 steps; choose 1 to 16, or a smaller dt";
    let holds = (1..=MAX_SUBSTEPS).contains(&count);
    require("substeps", f64::from(count), holds, allowed).map(|_| count)
}

/// The deviation (2) from what [`Held`] gives, by RK4.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Rk4Motion {
    substeps: u8,
}

/// (3) where f̂ is stiff, else [`Rk4Motion`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ImplicitMotion {
    substeps: u8,
}

crate::error::through_constructor! {
    [] Rk4Motion<>: motion => { substeps: u8 = motion.substeps } => Self::new(substeps)
}
crate::error::through_constructor! {
    [] ImplicitMotion<>: motion => { substeps: u8 = motion.substeps } => Self::new(substeps)
}

macro_rules! in_substeps {
    ($name:ident by $step:ident) => {
        impl $name {
            /// With so many steps a period.
            ///
            /// # Errors
            /// None, or more than [`MAX_SUBSTEPS`].
            pub fn new(count: u8) -> Result<Self, DesignError> {
                substeps(count).map(|substeps| Self { substeps })
            }
        }

        impl Default for $name {
            /// With [`SUBSTEPS`] steps a period.
            fn default() -> Self {
                Self { substeps: SUBSTEPS }
            }
        }

        impl Motion for $name {
            #[inline(always)]
            fn moved<T, Z, U, L>(&self, law: &L, t: T, z: &Z, u: &U, dt: T) -> Z
            where
                T: Scalar,
                Z: Memory<T>,
                L: Flow<T, Z, U>,
            {
                let h = dt / T::from_u64(u64::from(self.substeps));
                let (mut moved, mut now) = ($step(law, t, z, u, h), t);
                for _ in 1..self.substeps {
                    now += h;
                    moved = $step(law, now, &moved, u, h);
                }
                moved
            }
        }
    };
}
in_substeps!(Rk4Motion by rk4);
in_substeps!(ImplicitMotion by implicit);

/// A step of (2).
#[inline(always)]
fn rk4<T, Z, U, L>(law: &L, t: T, z: &Z, u: &U, h: T) -> Z
where
    T: Scalar,
    Z: Memory<T>,
    L: Flow<T, Z, U>,
{
    let (half, sixth) = (T::from_f64(0.5) * h, h / T::from_f64(6.0));
    let begun = law.terms(t, z, u);
    let (middle, end) = (law.flow(z, &begun, half), law.flow(z, &begun, h));
    let beyond = |terms: L::Terms| terms.zip(&begun, |now, begun| now - begun);
    let scaled = |by: T, rate: &L::Terms| rate.zip(rate, |rate, _| by * rate);
    let sum = |a: &L::Terms, b: &L::Terms| a.zip(b, |a, b| a + b);

    let k2 = beyond(law.terms(t + half, &middle, u));
    let delta = scaled(half, &k2);
    let g = beyond(law.terms(t + half, &law.shifted(&middle, &delta), u));
    let k3 = sum(&law.chain(&delta), &g);
    let delta = scaled(h, &k3);
    let g = beyond(law.terms(t + h, &law.shifted(&end, &delta), u));
    let k4 = sum(&law.chain(&delta), &g);
    let inner = sum(&k2, &k3);
    law.shifted(&end, &scaled(sixth, &sum(&sum(&inner, &inner), &k4)))
}

/// Bisections of the search for F of (3).
pub const HALVINGS: u32 = 7;

/// A step of (3) where it is stiff.
#[inline(always)]
fn implicit<T, Z, U, L>(law: &L, t: T, z: &Z, u: &U, h: T) -> Z
where
    T: Scalar,
    Z: Memory<T>,
    L: Flow<T, Z, U>,
{
    let at_end = |f: &L::Terms| law.terms(t + h, &law.flow(z, f, h), u);
    let most = at_end(&L::Terms::zero());
    // Fᵢ = θᵢ aᵢ, and what is left of f̂ᵢ − Fᵢ, counted along aᵢ
    let part = |theta: &L::Terms| theta.zip(&most, |theta, most| theta * most);
    let left = |theta: &L::Terms| {
        let f = part(theta);
        at_end(&f).zip(&f, |end, f| end - f).zip(&most, |left, most| left * most)
    };
    let mut width = T::from_f64(0.5);
    let mut theta = most.zip(&most, |_, _| width);
    for _ in 0..HALVINGS {
        width *= T::from_f64(0.5);
        theta = theta.zip(&left(&theta), |theta, left| theta + width.copysign(left));
    }
    let (low, high) =
        (theta.zip(&theta, |at, _| at - width), theta.zip(&theta, |at, _| at + width));
    let along = left(&low)
        .zip(&left(&high), |low, high| (low / (low - high).or(T::ONE)).max(T::ZERO).min(T::ONE));
    let f = part(&low.zip(&along, |low, along| low + (width + width) * along));

    let mut stiff = T::ZERO;
    for row in 0..law.rows() {
        let own = entry(&at_end(&with_entry(&f, row, T::ZERO)), row);
        let f = entry(&f, row);
        stiff = stiff.max(own.abs() - (f.abs() + f.abs()));
    }
    let smooth = rk4(law, t, z, u, h);
    law.flow(z, &f, h).zip(&smooth, |held, smooth| stiff.where_above(T::ZERO, held, smooth))
}

#[inline(always)]
fn entry<T: Scalar>(of: &impl Memory<T>, row: usize) -> T {
    let (mut found, mut next) = (T::ZERO, 0);
    of.visit(&mut |value| {
        if next == row {
            found = value;
        }
        next += 1;
    });
    found
}

#[inline(always)]
fn with_entry<T: Scalar, M: Memory<T>>(of: &M, row: usize, value: T) -> M {
    let (mut changed, mut next) = (*of, 0);
    changed.visit_mut(&mut |slot| {
        if next == row {
            *slot = value;
        }
        next += 1;
    });
    changed
}
