//! Floor 0. Numbers of twice the precision, for constants whose way to them is ill-conditioned.
//!
//! A [`Wide`] is the exact sum of two doubles, the second at most half a unit in the last place of the
//! first: some 106 bits. Sums after Knuth, products after Dekker (Numer. Math. 18 (1971)).

use crate::Scalar;
use core::cmp::Ordering;
use core::ops::{Add, Div, Mul, Neg, Sub};

/// What polynomials are computed over: a [`Scalar`], or a [`Wide`].
pub(crate) trait Number:
    Copy
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    const ZERO: Self;
    const ONE: Self;
    /// One unit in the last place of 1.
    const EPSILON: f64;
    /// Newton's step over the root, from which on the next one would change nothing that counts.
    const SETTLED: f64;
    fn from_f64(value: f64) -> Self;
    fn to_f64(self) -> f64;
    fn abs(self) -> Self;
    fn sqrt(self) -> Self;
    /// Magnitude of `self`, sign of `sign`.
    fn copysign(self, sign: Self) -> Self;
}

impl<T: Scalar> Number for T {
    const ZERO: Self = T::ZERO;
    const ONE: Self = T::ONE;
    const EPSILON: f64 = f64::EPSILON;
    const SETTLED: f64 = 4.0 * f64::EPSILON;
    fn from_f64(value: f64) -> Self {
        T::from_f64(value)
    }
    fn to_f64(self) -> f64 {
        Scalar::to_f64(self)
    }
    fn abs(self) -> Self {
        Scalar::abs(self)
    }
    fn sqrt(self) -> Self {
        Scalar::sqrt(self)
    }
    fn copysign(self, sign: Self) -> Self {
        Scalar::copysign(self, sign)
    }
}

/// high + low.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Wide {
    pub(crate) high: f64,
    pub(crate) low: f64,
}

/// a + b, and what rounding took from it.
fn sum(a: f64, b: f64) -> (f64, f64) {
    let s = a + b;
    let of_b = s - a;
    (s, (a - (s - of_b)) + (b - of_b))
}

/// x as a sum of two numbers of half its length.
#[inline(always)]
const fn halves(x: f64) -> (f64, f64) {
    let spread = 134_217_729.0 * x; // 2²⁷ + 1
    let high = spread - (spread - x);
    (high, x - high)
}

/// a·b, and what rounding took from it.
#[inline(always)]
const fn product(a: f64, b: f64) -> (f64, f64) {
    let ((a1, a2), (b1, b2), p) = (halves(a), halves(b), a * b);
    (p, a2 * b2 - (((p - a1 * b1) - a2 * b1) - a1 * b2))
}

impl Wide {
    pub(crate) const fn new(high: f64) -> Self {
        Self { high, low: 0.0 }
    }

    /// high + low, whatever their sizes.
    pub(crate) fn of(high: f64, low: f64) -> Self {
        let (high, low) = sum(high, low);
        Self { high, low }
    }

    /// Times a power of 2: exact.
    pub(crate) fn scaled(self, power: f64) -> Self {
        Self { high: self.high * power, low: self.low * power }
    }
}

impl Add for Wide {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let ((s, e), (t, f)) = (sum(self.high, other.high), sum(self.low, other.low));
        let first = Self::of(s, e + t);
        Self::of(first.high, first.low + f)
    }
}

impl Neg for Wide {
    type Output = Self;
    fn neg(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }
}

impl Sub for Wide {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Wide {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let (p, e) = product(self.high, other.high);
        Self::of(p, e + (self.high * other.low + self.low * other.high))
    }
}

impl Div for Wide {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let first = self.high / other.high;
        let rest = self - other * Self::new(first);
        let second = rest.high / other.high;
        let rest = rest - other * Self::new(second);
        Self::of(first, second) + Self::new(rest.high / other.high)
    }
}

impl PartialOrd for Wide {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        match self.high.partial_cmp(&other.high) {
            Some(Ordering::Equal) => self.low.partial_cmp(&other.low),
            order => order,
        }
    }
}

impl Number for Wide {
    const ZERO: Self = Self::new(0.0);
    const ONE: Self = Self::new(1.0);
    const EPSILON: f64 = f64::EPSILON * f64::EPSILON;
    const SETTLED: f64 = 1e-13; // steps shrink quadratically
    fn from_f64(value: f64) -> Self {
        Self::new(value)
    }
    fn to_f64(self) -> f64 {
        self.high
    }
    fn abs(self) -> Self {
        self.copysign(Self::ONE)
    }
    fn sqrt(self) -> Self {
        let root = Self::new(Scalar::sqrt(self.high));
        if root.high == 0.0 {
            return root;
        }
        root + (self - root * root) / Self::new(2.0 * root.high)
    }
    fn copysign(self, sign: Self) -> Self {
        if self.high.is_sign_negative() == sign.high.is_sign_negative() { self } else { -self }
    }
}

/// 1/2 … 1/16, and what rounding took from them.
const OVER: [Wide; 15] = {
    let (mut over, mut i) = ([Wide::ONE; 15], 0);
    while i < over.len() {
        let n = (i + 2) as f64;
        let high = 1.0 / n;
        let (p, rest) = product(high, n);
        over[i] = Wide { high, low: ((1.0 - p) - rest) / n };
        i += 1;
    }
    over
};

/// e^(a + ib) − 1, as exact for small arguments, for a below the range of [`f64::exp`]'s logarithm:
/// a series for a part of the argument, which doubles by e²ᶻ − 1 = (eᶻ − 1)(2 + (eᶻ − 1)).
pub(crate) fn exp_m1((a, b): (Wide, Wide)) -> (Wide, Wide) {
    if a.high < -80.0 {
        return (-Wide::ONE, Wide::ZERO); // to the last bit
    }
    let (mut part, mut halvings, size) = (1.0, 0, a.high.abs() + b.high.abs());
    while size * part > 0.0625 && halvings < 64 {
        part *= 0.5;
        halvings += 1;
    }
    let z = (a.scaled(part), b.scaled(part));
    let times = |(a, b): (Wide, Wide), (c, d): (Wide, Wide)| {
        if b.high == 0.0 && d.high == 0.0 {
            (a * c, Wide::ZERO)
        } else {
            (a * c - b * d, a * d + b * c)
        }
    };
    let mut series = (Wide::ONE, Wide::ZERO);
    for over in OVER.iter().rev() {
        let (re, im) = times(series, z);
        series = (Wide::ONE + re * *over, im * *over);
    }
    let mut grown = times(series, z);
    for _ in 0..halvings {
        grown = times(grown, (Wide::new(2.0) + grown.0, grown.1));
    }
    grown
}
