//! Floor 1. Dual numbers: a value and its slopes along N directions, for derivatives of any model that is
//! written over a [`Scalar`] (forward mode; Wengert, Comm. ACM 7 (1964) 463).
//!
//! The value has the bits of the number alone. A slope that is 0 takes no operation with it: of a model over
//! traced numbers only the slopes that there are remain, and x² at 0 has the slope 0, though ln 0 is infinite.

use crate::scalar::{Constant, Scalar};
use core::cmp::Ordering;
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A value and its slopes.
///
/// ```
/// use hgo_rs::{Scalar, dual::Dual};
///
/// let [x, y] = [Dual::<f64, 2>::along(3.0, 0), Dual::along(2.0, 1)];
/// let z = x * y.sin() + x * x;
/// assert_eq!(z.value, 3.0 * 2.0_f64.sin() + 9.0);
/// assert_eq!(z.slopes, [2.0_f64.sin() + 6.0, 3.0 * 2.0_f64.cos()]);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Dual<T, const N: usize> {
    /// The value.
    pub value: T,
    /// Its slopes.
    pub slopes: [T; N],
}

impl<T: Scalar, const N: usize> Dual<T, N> {
    /// The variable whose slope along `direction` is 1.
    #[inline(always)]
    pub fn along(value: T, direction: usize) -> Self {
        let mut slopes = [T::NEG_ZERO; N];
        if let Some(slope) = slopes.get_mut(direction) {
            *slope = T::ONE;
        }
        Self { value, slopes }
    }

    /// A value whose slopes are these ones times `by`.
    #[inline(always)]
    fn chained(&self, value: T, by: T) -> Self {
        let mut slopes = self.slopes;
        for slope in &mut slopes {
            *slope = times(*slope, by);
        }
        Self { value, slopes }
    }

    /// A value whose slopes are these ones and the other's.
    #[inline(always)]
    fn joined(&self, other: &Self, value: T) -> Self {
        self.each(other, value, sum)
    }

    #[inline(always)]
    fn each(&self, other: &Self, value: T, slope: impl Fn(T, T) -> T) -> Self {
        let mut slopes = self.slopes;
        for (of_self, of_other) in slopes.iter_mut().zip(&other.slopes) {
            *of_self = slope(*of_self, *of_other);
        }
        Self { value, slopes }
    }
}

/// x·y, nothing where x is 0.
#[inline(always)]
pub(crate) fn times<T: Scalar>(x: T, y: T) -> T {
    if x.is_nothing() { T::NEG_ZERO } else { x * y }
}

/// x + y, which is the other one where one is 0.
#[inline(always)]
fn sum<T: Scalar>(x: T, y: T) -> T {
    if y.is_nothing() {
        x
    } else if x.is_nothing() {
        y
    } else {
        x + y
    }
}

/// A constant.
impl<T: Scalar, const N: usize> From<T> for Dual<T, N> {
    #[inline(always)]
    fn from(value: T) -> Self {
        Self { value, slopes: [T::NEG_ZERO; N] }
    }
}

impl<T: Scalar, const N: usize> Default for Dual<T, N> {
    fn default() -> Self {
        Self::ZERO
    }
}

impl<T: Scalar, const N: usize> PartialEq for Dual<T, N> {
    #[inline(always)]
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl<T: Scalar, const N: usize> PartialOrd for Dual<T, N> {
    #[inline(always)]
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&other.value)
    }
}

impl<T: Scalar, const N: usize> Neg for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.chained(-self.value, -T::ONE)
    }
}

impl<T: Scalar, const N: usize> Add for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.joined(&other, self.value + other.value)
    }
}

impl<T: Scalar, const N: usize> Sub for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.joined(&-other, self.value - other.value)
    }
}

impl<T: Scalar, const N: usize> Mul for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let value = self.value * other.value;
        self.chained(value, other.value).joined(&other.chained(value, self.value), value)
    }
}

impl<T: Scalar, const N: usize> Div for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let (value, inverse) = (self.value / other.value, T::ONE / other.value);
        let below = other.chained(value, -(value * inverse));
        self.chained(value, inverse).joined(&below, value)
    }
}

macro_rules! assigned {
    ($($name:ident $method:ident $operation:ident;)+) => {$(
        impl<T: Scalar, const N: usize> $name for Dual<T, N> {
            #[inline(always)]
            fn $method(&mut self, other: Self) {
                *self = self.$operation(other);
            }
        }
    )+};
}
assigned! {
    AddAssign add_assign add;
    SubAssign sub_assign sub;
    MulAssign mul_assign mul;
    DivAssign div_assign div;
}

/// Functions of one argument: the value f, and the slope from the argument and f.
macro_rules! functions {
    ($($name:ident($x:ident, $made:ident) $slope:expr;)+) => {$(
        #[inline(always)]
        fn $name(self) -> Self {
            let ($x, $made) = (self.value, self.value.$name());
            self.chained($made, $slope)
        }
    )+};
}

#[allow(unused_variables)]
impl<T: Scalar, const N: usize> Scalar for Dual<T, N> {
    const ZERO: Self = Self { value: T::ZERO, slopes: [T::NEG_ZERO; N] };
    const NEG_ZERO: Self = Self { value: T::NEG_ZERO, slopes: [T::NEG_ZERO; N] };
    const ONE: Self = Self { value: T::ONE, slopes: [T::NEG_ZERO; N] };
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        T::from_f64(value).into()
    }
    #[inline(always)]
    fn from_u64(value: u64) -> Self {
        T::from_u64(value).into()
    }
    #[inline(always)]
    fn constant(value: Constant) -> Self {
        T::constant(value).into()
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self.value.to_f64()
    }
    #[inline(always)]
    fn is_nothing(self) -> bool {
        self.value.is_nothing()
    }
    #[inline(always)]
    fn is_finite(self) -> bool {
        self.value.is_finite()
    }
    functions! {
        abs(x, made) T::ONE.copysign(x);
        sqrt(x, made) T::ONE / (made + made);
        sin(x, made) x.cos();
        cos(x, made) -x.sin();
        tan(x, made) T::ONE + made * made;
        atan(x, made) T::ONE / (T::ONE + x * x);
        tanh(x, made) T::ONE - made * made;
        ln(x, made) T::ONE / x;
        exp(x, made) made;
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        let by = T::ONE.copysign(self.value) * T::ONE.copysign(sign.value);
        self.chained(self.value.copysign(sign.value), by)
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        let (value, square) =
            (self.value.atan2(x.value), self.value * self.value + x.value * x.value);
        let along_x = x.chained(value, -(self.value / square));
        self.chained(value, x.value / square).joined(&along_x, value)
    }
    #[inline(always)]
    fn powf(self, power: Self) -> Self {
        let value = self.value.powf(power.value);
        let by = power.value * self.value.powf(power.value - T::ONE);
        let of_power = power.chained(value, value * self.value.ln());
        self.chained(value, by).joined(&of_power, value)
    }
    #[inline(always)]
    fn nearest(self) -> Self {
        self.value.nearest().into()
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.where_above(other, other, self)
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        other.where_above(self, other, self)
    }
    #[inline(always)]
    fn innovation(self, x_hat: Self) -> Self {
        let missing = |slope: T| slope - slope.while_missing(self.value);
        let difference = self - x_hat;
        Self { value: self.value.innovation(x_hat.value), slopes: difference.slopes.map(missing) }
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        let (value, size) = (self.value.or(other.value), self.value.abs());
        self.each(&other, value, |a, b| size.where_above(T::ZERO, a, b))
    }
    #[inline(always)]
    fn while_missing(self, y: Self) -> Self {
        Self {
            value: self.value.while_missing(y.value),
            slopes: self.slopes.map(|slope| slope.while_missing(y.value)),
        }
    }
    #[inline(always)]
    fn passed(self, dt: Self) -> Self {
        let value = self.value.passed(dt.value);
        self.each(&(self + dt), value, |stays, moves| T::ZERO.where_above(self.value, stays, moves))
    }
    #[inline(always)]
    fn where_above(self, other: Self, then: Self, otherwise: Self) -> Self {
        let chosen = |a: T, b: T| self.value.where_above(other.value, a, b);
        then.each(&otherwise, chosen(then.value, otherwise.value), chosen)
    }
}
