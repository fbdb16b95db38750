//! Floor 0. The numbers that every law is written over: `f32` and `f64`.
//!
//! Elementary functions are the crate's own ([`crate::elementary`]) in every build, so a notebook, a
//! study and a microcontroller give the same bits. The square root is the processor's instruction
//! where `std` is there, and the crate `libm`'s elsewhere: IEEE 754 asks it to be correctly rounded,
//! so its bits are the same too.

use crate::elementary;
use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A number that is known when a program is compiled, and rounded to each precision then: a chip without double
/// precision converts nothing, also where it stands in a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constant {
    double: f64,
    single: f32,
}

impl Constant {
    /// Nearest values to it.
    #[allow(clippy::cast_possible_truncation)] // to single precision it is meant to round
    pub const fn new(value: f64) -> Self {
        Self { double: value, single: value as f32 }
    }

    /// 1/i for K numbers from i = `first` on.
    pub const fn reciprocals<const K: usize>(first: usize) -> [Self; K] {
        let (mut over, mut k) = ([Self::new(0.0); K], 0);
        while k < K {
            over[k] = Self::new(1.0 / (first + k) as f64);
            k += 1;
        }
        over
    }
}

/// A real number of the chosen precision.
pub trait Scalar:
    'static
    + Copy
    + Debug
    + Default
    + PartialEq
    + PartialOrd
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
{
    /// 0.
    const ZERO: Self;
    /// −0, the zero that is free: x + (−0) is x bit for bit, and so no instruction at all.
    const NEG_ZERO: Self;
    /// 1.
    const ONE: Self;
    /// Nearest value to an `f64`.
    fn from_f64(value: f64) -> Self;
    /// Nearest value to a whole number.
    fn from_u64(value: u64) -> Self;
    /// Nearest value to a constant, as by [`Scalar::from_f64`].
    #[inline(always)]
    fn constant(value: Constant) -> Self {
        Self::from_f64(value.double)
    }
    /// Widened to `f64` (exact).
    fn to_f64(self) -> f64;
    /// Whether it is known to be 0, or too small for all of its digits; of a trace, of constants alone.
    #[inline(always)]
    fn is_nothing(self) -> bool {
        self.to_f64().abs() < f64::MIN_POSITIVE
    }
    /// Neither NaN nor infinite.
    fn is_finite(self) -> bool;
    /// |x|.
    #[must_use]
    fn abs(self) -> Self;
    /// Magnitude of `self`, sign of `sign`.
    #[must_use]
    fn copysign(self, sign: Self) -> Self;
    /// √x.
    #[must_use]
    fn sqrt(self) -> Self;
    /// sin x, x in rad; NaN beyond 1e9 rad (`f32`: 2e4), where a float is no angle any more.
    #[must_use]
    fn sin(self) -> Self;
    /// cos x, x in rad; NaN as for [`Scalar::sin`].
    #[must_use]
    fn cos(self) -> Self;
    /// tan x, x in rad; NaN as for [`Scalar::sin`].
    #[must_use]
    fn tan(self) -> Self;
    /// atan x, in rad.
    #[must_use]
    fn atan(self) -> Self;
    /// The angle of the point (x, y), `self` being y, in rad, in [−π, π]; zeros and infinities as in
    /// IEEE 754.
    #[must_use]
    fn atan2(self, x: Self) -> Self;
    /// tanh x.
    #[must_use]
    fn tanh(self) -> Self;
    /// ln x.
    #[must_use]
    fn ln(self) -> Self;
    /// eˣ.
    #[must_use]
    fn exp(self) -> Self;
    /// xᵖ for x ≥ 0 and a real power p; NaN for x < 0.
    #[must_use]
    fn powf(self, power: Self) -> Self;

    /// The nearest whole number, of two the even one, up to 2²² in magnitude (`f64`: 2⁵¹); beyond it
    /// only near. NaN and infinities stay what they are.
    #[must_use]
    fn nearest(self) -> Self;

    /// The smaller of the two; `self` stays NaN, so that a blow-up is seen, and NaN is passed over
    /// in `other`.
    #[inline(always)]
    #[must_use]
    fn min(self, other: Self) -> Self {
        if other < self { other } else { self }
    }

    /// The larger of the two; NaN as for [`Scalar::min`].
    #[inline(always)]
    #[must_use]
    fn max(self, other: Self) -> Self {
        if other > self { other } else { self }
    }

    /// xⁿ for a whole power n ≥ 0, by repeated multiplication.
    #[inline(always)]
    #[must_use]
    fn powi(self, n: usize) -> Self {
        let mut product = Self::ONE;
        for _ in 0..n {
            product *= self;
        }
        product
    }

    /// The innovation of the sample y = `self` over its estimate: y − x̂, and 0 where y is missing.
    #[inline(always)]
    #[must_use]
    fn innovation(self, x_hat: Self) -> Self {
        if self.is_finite() { self - x_hat } else { Self::ZERO }
    }

    /// `self`, or `other` where it is 0.
    #[inline(always)]
    #[must_use]
    fn or(self, other: Self) -> Self {
        if self == Self::ZERO { other } else { self }
    }

    /// `self` where the sample y is missing, else 0.
    #[inline(always)]
    #[must_use]
    fn while_missing(self, y: Self) -> Self {
        if y.is_finite() { Self::ZERO } else { self }
    }

    /// A time `self` after dt more; one that is negative has not begun, and stays.
    #[inline(always)]
    #[must_use]
    fn passed(self, dt: Self) -> Self {
        if self < Self::ZERO { self } else { self + dt }
    }

    /// `then` where `self` > `other`, else `otherwise`: a choice between values, which both exist.
    #[inline(always)]
    #[must_use]
    fn where_above(self, other: Self, then: Self, otherwise: Self) -> Self {
        if self > other { then } else { otherwise }
    }

    /// `self` brought into [low, high]; NaN stays NaN.
    #[inline(always)]
    #[must_use]
    fn clip(self, low: Self, high: Self) -> Self {
        self.max(low).min(high)
    }
}

macro_rules! scalar {
    ($t:ident, $of:ident, $bits:ident, $shift:literal) => {
        impl Scalar for $t {
            const ZERO: Self = 0.0;
            const NEG_ZERO: Self = -0.0;
            const ONE: Self = 1.0;
            #[inline(always)]
            #[allow(clippy::cast_possible_truncation, clippy::cast_lossless)]
            fn from_f64(value: f64) -> Self {
                value as $t
            }
            #[inline(always)]
            fn from_u64(value: u64) -> Self {
                value as $t
            }
            #[inline(always)]
            fn constant(value: Constant) -> Self {
                value.$of
            }
            #[inline(always)]
            #[allow(clippy::cast_lossless)]
            fn to_f64(self) -> f64 {
                self as f64
            }
            #[inline(always)]
            fn is_nothing(self) -> bool {
                <$t>::abs(self) < <$t>::MIN_POSITIVE
            }
            #[inline(always)]
            fn is_finite(self) -> bool {
                // by the exponent's bits: a comparison of numbers costs far more on small chips
                const EXPONENT: $bits = <$t>::INFINITY.to_bits();
                self.to_bits() & EXPONENT != EXPONENT
            }
            #[inline(always)]
            fn abs(self) -> Self {
                <$t>::abs(self)
            }
            #[inline(always)]
            fn copysign(self, sign: Self) -> Self {
                <$t>::copysign(self, sign)
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                elementary::Float::sqrt(self)
            }
            #[inline(always)]
            fn sin(self) -> Self {
                elementary::sin(self)
            }
            #[inline(always)]
            fn cos(self) -> Self {
                elementary::cos(self)
            }
            #[inline(always)]
            fn tan(self) -> Self {
                elementary::tan(self)
            }
            #[inline(always)]
            fn atan(self) -> Self {
                elementary::atan(self)
            }
            #[inline(always)]
            fn atan2(self, x: Self) -> Self {
                elementary::atan2(self, x)
            }
            #[inline(always)]
            fn tanh(self) -> Self {
                elementary::tanh(self)
            }
            #[inline(always)]
            fn ln(self) -> Self {
                elementary::ln(self)
            }
            #[inline(always)]
            fn exp(self) -> Self {
                elementary::exp(self)
            }
            #[inline(always)]
            fn powf(self, power: Self) -> Self {
                elementary::powf(self, power)
            }
            #[inline(always)]
            fn nearest(self) -> Self {
                // no digit behind the point is left of a number of this size
                self + $shift - $shift
            }
        }
    };
}

scalar!(f32, single, u32, 12_582_912.0); // 3·2²²
scalar!(f64, double, u64, 6_755_399_441_055_744.0); // 3·2⁵¹
