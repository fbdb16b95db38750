//! Floor 0. Elementary functions, written so that they run alike everywhere.
//!
//! Sums, products, divisions, bit patterns and selections between two computed values: no branch,
//! no table, no call. A compiler makes vector code of a loop over them, a chip without an operating
//! system links nothing else, and the bits are the same on all of them.
//!
//! They are written over a [`Float`], a number with a view of its bits: `f32`, `f64`, or one that
//! writes down what is computed with it, so that programs in other languages are printed from here.
//!
//! Each reduces its argument to a short interval around 0 and takes a polynomial there whose largest
//! relative error on it is least (Remez), its coefficients rounded one after the other. Errors stay
//! within two units in the last place where nothing else is said.

use core::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Shl, Shr, Sub};

/// An answer: yes or no, for each number that a value stands for.
pub trait Truth: Copy + BitAnd<Output = Self> + BitOr<Output = Self> {}

impl Truth for bool {}

/// Bits as an unsigned whole number. Shifts are by less than its width.
pub trait Bits:
    Copy
    + BitAnd<Output = Self>
    + BitOr<Output = Self>
    + BitXor<Output = Self>
    + Shl<u32, Output = Self>
    + Shr<u32, Output = Self>
{
    /// What a comparison answers.
    type Truth: Truth;
    /// A constant, of which the lowest bits count.
    fn of(value: u64) -> Self;
    /// The sum without its carry.
    #[must_use]
    fn wrapping_add(self, other: Self) -> Self;
    /// The difference without its borrow.
    #[must_use]
    fn wrapping_sub(self, other: Self) -> Self;
    /// Whether all bits are equal.
    fn equal(self, other: Self) -> Self::Truth;
}

/// A number of one precision with a view of its bits: what elementary functions are written over.
///
/// Every operation is that of IEEE 754, rounded on its own.
pub trait Float:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// `f32` or `f64`: what its constants are.
    type Precision: Precision;
    /// Its bits.
    type Bits: Bits<Truth = Self::Truth>;
    /// What a comparison answers.
    type Truth: Truth;
    /// A constant.
    fn of(value: Self::Precision) -> Self;
    /// A constant that single precision holds.
    fn short(value: f32) -> Self;
    /// |x|.
    #[must_use]
    fn abs(self) -> Self;
    /// Magnitude of `self`, sign of `sign`.
    #[must_use]
    fn copysign(self, sign: Self) -> Self;
    /// √x.
    #[must_use]
    fn sqrt(self) -> Self;
    /// The bits of this number.
    fn to_bits(self) -> Self::Bits;
    /// The number of these bits.
    fn from_bits(bits: Self::Bits) -> Self;
    /// self < other; no for NaN.
    fn less(self, other: Self) -> Self::Truth;
    /// self ≤ other; no for NaN.
    fn less_equal(self, other: Self) -> Self::Truth;
    /// self = other; no for NaN, yes for 0 and −0.
    fn equal(self, other: Self) -> Self::Truth;
    /// Whether it is no number.
    fn is_nan(self) -> Self::Truth;
    /// `yes` where the answer is yes, else `no`. Both are computed.
    #[must_use]
    fn select(truth: Self::Truth, yes: Self, no: Self) -> Self;
}

/// A precision: its constants, and the polynomials that suit it.
pub trait Precision: Float<Precision = Self> {
    /// Explicit bits of a mantissa.
    const MANTISSA: u32;
    /// Bits of a number.
    const WIDTH: u32;
    /// Not a number.
    const NAN: Self;
    /// ∞.
    const INFINITY: Self;
    /// The largest number.
    const MAX: Self;
    /// The smallest normal number.
    const MIN_POSITIVE: Self;
    /// log₂ e.
    const LOG2_E: Self;
    /// 2/π.
    const FRAC_2_PI: Self;
    /// √½.
    const FRAC_1_SQRT_2: Self;
    /// π/4.
    const FRAC_PI_4: Self;
    /// π/2.
    const FRAC_PI_2: Self;
    /// 2ᵐ, m the bits of a mantissa.
    const POINT: Self;
    /// What is added to an exponent where it stands in bits.
    const BIAS: Self;
    /// 1.5·2ᵐ: adding it rounds to a whole number, which then stands in the lowest bits.
    const WHOLE: Self;
    /// m + 2, and 2 to the power of it: what makes a normal number of a subnormal one.
    const LIFT: [Self; 2];
    /// 2²ᵐ and its inverse.
    const LARGE: [Self; 2];
    /// ln 2 as a sum whose first term is short, so that a whole number times it is exact.
    const LN_2: [Self; 2];
    /// π/2, as such a sum.
    const HALF_PI: [Self; 3];
    /// The largest argument of sine and cosine.
    const FARTHEST: Self;
    /// The powers of 2 at which 2ˣ is 0 and infinite.
    const EXP2_ENDS: [Self; 2];
    /// The arguments at which eˣ is 0 and infinite.
    const EXP_ENDS: [Self; 2];
    /// 2x from where on tanh x is 1.
    const TANH_END: Self;
    /// A short number near ½ whose arc tangent is nearly a number of the precision; that.
    const MIDDLE: [Self; 2];

    /// (eʳ − 1 − r)/r².
    fn exp_tail<T: Float<Precision = Self>>(r: T) -> T;
    /// (2ʳ − 1)/r.
    fn exp2_ratio<T: Float<Precision = Self>>(r: T) -> T;
    /// (2 artanh s − 2s)/s³ in z = s².
    fn ln_tail<T: Float<Precision = Self>>(z: T) -> T;
    /// 2 artanh s/(s ln 2) in z = s².
    fn log2_ratio<T: Float<Precision = Self>>(z: T) -> T;
    /// (sin s − s)/s³ in z = s².
    fn sin_tail<T: Float<Precision = Self>>(z: T) -> T;
    /// (cos s − 1)/s² in z = s².
    fn cos_ratio<T: Float<Precision = Self>>(z: T) -> T;
    /// (atan s − s)/s³ in z = s².
    fn atan_tail<T: Float<Precision = Self>>(z: T) -> T;
}

/// The precision of a number.
type Of<T> = <T as Float>::Precision;

/// A constant of the precision.
macro_rules! constant {
    ($t:ident :: $name:ident) => {
        $t::of(Of::<$t>::$name)
    };
    ($t:ident :: $name:ident [$index:literal]) => {
        $t::of(Of::<$t>::$name[$index])
    };
}

/// Σ cᵢ xⁱ by Horner's rule.
macro_rules! horner {
    ($x:expr, $last:expr) => { $last };
    ($x:expr, $first:expr, $($more:expr),+) => {
        $first + $x * horner!($x, $($more),+)
    };
}

/// Σ cᵢ xⁱ by Estrin's rule: neighbours in pairs, the pairs as coefficients of the powers of x².
macro_rules! estrin {
    ($x:expr; $only:expr) => { $only };
    ($x:expr; $first:expr, $second:expr) => { $first + $x * $second };
    ($x:expr; $($more:expr),+) => {{
        let (x, square) = ($x, $x * $x);
        estrin!(@ x, square, [] $($more),+)
    }};
    (@ $x:ident, $square:ident, [$($pair:expr),*]) => { estrin!($square; $($pair),*) };
    (@ $x:ident, $square:ident, [$($pair:expr),*] $last:expr) => {
        estrin!($square; $($pair,)* $last)
    };
    (@ $x:ident, $square:ident, [$($pair:expr),*] $a:expr, $b:expr $(, $more:expr)*) => {
        estrin!(@ $x, $square, [$($pair,)* $a + $x * $b] $($more),*)
    };
}

/// Σ cᵢ xⁱ: many terms so that a processor that begins several operations before it ends one waits
/// least, few so that they are fewest.
macro_rules! polynomial {
    ($x:ident; $a:expr, $b:expr, $c:expr, $d:expr, $e:expr $(, $more:expr)*) => {
        estrin!($x; $a, $b, $c, $d, $e $(, $more)*)
    };
    ($x:ident; $($few:expr),+) => { horner!($x, $($few),+) };
}

/// 1, as bits.
#[inline(always)]
fn one<T: Float>() -> T::Bits {
    T::short(1.0).to_bits()
}

/// The whole number nearest to x, and bits whose lowest end is that number.
#[inline(always)]
fn rounded<T: Float>(x: T) -> (T, T::Bits) {
    let shifted = x + constant!(T::WHOLE);
    (shifted - constant!(T::WHOLE), shifted.to_bits())
}

/// 2ⁿ for the whole number n in the lowest bits, n within the exponents of normal numbers.
#[inline(always)]
fn power_of_2<T: Float>(n: T::Bits) -> T {
    T::from_bits((n << Of::<T>::MANTISSA).wrapping_add(one::<T>()))
}

/// r, n in the lowest bits and eʳ − 1, where x = n ln 2 + r.
#[inline(always)]
fn exp_less_1<T: Float>(x: T) -> (T, T::Bits) {
    let (n, bits) = rounded(x * constant!(T::LOG2_E));
    let r = (x - n * constant!(T::LN_2[0])) - n * constant!(T::LN_2[1]);
    (r + r * r * T::Precision::exp_tail(r), bits)
}

/// 2ⁿ times a number, in two factors: n may be beyond the normal numbers at either end.
#[inline(always)]
fn scaled<T: Float>(x: T, n: T::Bits) -> T {
    let half = n >> 1;
    x * power_of_2(half) * power_of_2(n.wrapping_sub(half))
}

/// x brought to where eˣ or 2ˣ goes from 0 to infinity; NaN stays NaN.
#[inline(always)]
fn limited<T: Float>(x: T, [lowest, highest]: [Of<T>; 2]) -> T {
    let (lowest, highest) = (T::of(lowest), T::of(highest));
    let x = T::select(x.less(lowest), lowest, x);
    T::select(highest.less(x), highest, x)
}

/// eˣ.
#[inline(always)]
pub fn exp<T: Float>(x: T) -> T {
    let (less_1, n) = exp_less_1(limited(x, Of::<T>::EXP_ENDS));
    scaled(T::short(1.0) + less_1, n)
}

/// tanh x = (e²ˣ − 1)/(e²ˣ + 1), to 4 units in the last place.
#[inline(always)]
pub fn tanh<T: Float>(x: T) -> T {
    let end = constant!(T::TANH_END);
    let double = T::short(2.0) * x.abs();
    // beyond, the result rounds to 1; NaN stays NaN
    let double = T::select(end.less(double), end, double);
    let (less_1, n) = exp_less_1(double);
    let power = power_of_2::<T>(n);
    let less_1 = power * less_1 + (power - T::short(1.0));
    (less_1 / (less_1 + T::short(2.0))).copysign(x)
}

/// x ≥ 0 as a normal number (or 0), and by which power of 2 it was lifted to be one.
#[inline(always)]
fn lifted<T: Float>(x: T) -> (T, T) {
    let subnormal = x.less(constant!(T::MIN_POSITIVE));
    let lift = T::select(subnormal, constant!(T::LIFT[0]), T::short(0.0));
    (T::select(subnormal, x * constant!(T::LIFT[1]), x), lift)
}

/// k and f of a normal x = 2ᵏ(1 + f), √½ ≤ 1 + f < √2.
#[inline(always)]
fn parts<T: Float>(x: T) -> (T, T) {
    let mantissa = Of::<T>::MANTISSA;
    let (root, point) = (constant!(T::FRAC_1_SQRT_2).to_bits(), constant!(T::POINT));
    let shifted = x.to_bits().wrapping_add(one::<T>().wrapping_sub(root));
    // the exponent as a number: put below the point of 2ᵐ, then taken off
    let exponent = T::from_bits(point.to_bits() | (shifted >> mantissa));
    let below = shifted & T::Bits::of((1 << mantissa) - 1);
    let f = T::from_bits(below.wrapping_add(root)) - T::short(1.0);
    (exponent - (point + constant!(T::BIAS)), f)
}

/// Whether x is 0 or −0.
#[inline(always)]
fn is_zero<T: Float>(x: T) -> T::Truth {
    (x.to_bits() << 1).equal(T::Bits::of(0))
}

/// The logarithm of x where `value` is that of a positive and finite one.
#[inline(always)]
fn of_any<T: Float>(value: T, x: T) -> T {
    // ∞ where x is; else below all logarithms
    let end = x - constant!(T::MAX);
    let value = T::select(end.less(value), value, end);
    let none = T::select(is_zero(x), T::of(-Of::<T>::INFINITY), constant!(T::NAN));
    // neither a sign nor zeros alone
    let bits = x.to_bits();
    let sign = (bits | bits.wrapping_sub(T::Bits::of(1))) >> (Of::<T>::WIDTH - 1);
    T::select(sign.equal(T::Bits::of(0)), value, none)
}

/// ln x = k ln 2 + ln(1 + f), ln(1 + f) = 2 artanh s, s = f/(2 + f).
#[inline(always)]
pub fn ln<T: Float>(x: T) -> T {
    let (normal, lift) = lifted(x);
    let (k, f) = parts(normal);
    let k = k - lift;
    let s = f / (T::short(2.0) + f);
    let z = s * s;
    let series = z * T::Precision::ln_tail(z);
    let half_square = T::short(0.5) * f * f;
    let tail = s * (half_square + series) + k * constant!(T::LN_2[1]);
    of_any(k * constant!(T::LN_2[0]) - ((half_square - tail) - f), x)
}

/// k and s = f/(2 + f) of a normal x = 2ᵏ(1 + f) > 0.
#[inline(always)]
pub fn log2_parts<T: Float>(x: T) -> (T, T) {
    let (k, f) = parts(x);
    (k, f / (T::short(2.0) + f))
}

/// log₂ x from these: k + 2 artanh s/ln 2, to 3 units in the last place.
#[inline(always)]
pub fn log2_of<T: Float>(k: T, s: T) -> T {
    k + s * T::Precision::log2_ratio(s * s)
}

/// xᵖ for x ≥ 0, as 2 to the power of p log₂ x = n + r: NaN for x < 0. The relative error is
/// about 1 + 2|p ln x| units in the last place.
#[inline(always)]
pub fn powf<T: Float>(x: T, power: T) -> T {
    let (normal, lift) = lifted(x);
    let (k, s) = log2_parts(normal);
    let y = limited(power * of_any(log2_of(k, s) - lift, x), Of::<T>::EXP2_ENDS);
    let (n, bits) = rounded(y);
    let r = y - n;
    let value = scaled(T::short(1.0) + r * T::Precision::exp2_ratio(r), bits);
    T::select(is_zero(power), T::short(1.0), value)
}

/// Sine and cosine of what is left of x after n quarter turns, and n in the lowest bits;
/// NaN beyond the largest argument, where a float is no angle any more.
#[inline(always)]
fn quarter<T: Float>(x: T) -> (T, T, T::Bits) {
    let near = x.abs().less_equal(constant!(T::FARTHEST));
    let x = T::select(near, x, constant!(T::NAN));
    let (n, bits) = rounded(x * constant!(T::FRAC_2_PI));
    let r = x - n * constant!(T::HALF_PI[0]);
    let r = r - n * constant!(T::HALF_PI[1]);
    let r = r - n * constant!(T::HALF_PI[2]);
    let z = r * r;
    let sin = r + r * z * T::Precision::sin_tail(z);
    let cos = T::short(1.0) + z * T::Precision::cos_ratio(z);
    (sin, cos, bits)
}

/// Whether n is even.
#[inline(always)]
fn is_even<T: Float>(n: T::Bits) -> T::Truth {
    (n & T::Bits::of(1)).equal(T::Bits::of(0))
}

/// `value`, or its negative where the bit of value 2 is set in n.
#[inline(always)]
fn signed<T: Float>(value: T, n: T::Bits) -> T {
    T::from_bits(value.to_bits() ^ ((n >> 1) << (Of::<T>::WIDTH - 1)))
}

/// sin x.
#[inline(always)]
pub fn sin<T: Float>(x: T) -> T {
    let (sin, cos, n) = quarter(x);
    signed(T::select(is_even::<T>(n), sin, cos), n)
}

/// cos x.
#[inline(always)]
pub fn cos<T: Float>(x: T) -> T {
    let (sin, cos, n) = quarter(x);
    signed(T::select(is_even::<T>(n), cos, sin), n.wrapping_add(T::Bits::of(1)))
}

/// tan x, to 4 units in the last place.
#[inline(always)]
pub fn tan<T: Float>(x: T) -> T {
    let (sin, cos, n) = quarter(x);
    let even = is_even::<T>(n);
    T::select(even, sin, -cos) / T::select(even, cos, sin)
}

/// atan(top/bottom) for 0 ≤ top ≤ bottom: less the nearest of 0, c near ½ and 1 in the sense
/// of the addition theorem, atan t = atan c + atan((t − c)/(1 + ct)).
#[inline(always)]
fn first_octant<T: Float>(top: T, bottom: T) -> T {
    let (zero, one) = (T::short(0.0), T::short(1.0));
    let high = (T::short(0.75) * bottom).less(top);
    let middle = (T::short(0.25) * bottom).less(top);
    let c = T::select(high, one, T::select(middle, constant!(T::MIDDLE[0]), zero));
    let at_middle = T::select(middle, constant!(T::MIDDLE[1]), zero);
    let at_c = T::select(high, constant!(T::FRAC_PI_4), at_middle);
    let s = (top - c * bottom) / (bottom + c * top);
    let z = s * s;
    at_c + (s + s * z * T::Precision::atan_tail(z))
}

/// atan x.
#[inline(always)]
pub fn atan<T: Float>(x: T) -> T {
    let (one, largest) = (T::short(1.0), constant!(T::MAX));
    let size = x.abs();
    let inverted = one.less(size);
    let (top, bottom) = (T::select(inverted, one, size), T::select(inverted, size, one));
    // an infinite x counts as the largest number
    let bottom = T::select(largest.less(bottom), largest, bottom);
    let from = T::select(inverted, constant!(T::FRAC_PI_2), T::short(0.0));
    (from - first_octant(top, bottom)).copysign(x)
}

/// The angle of the point (x, y) in [−π, π], as IEEE 754 has it for zeros and infinities.
#[inline(always)]
pub fn atan2<T: Float>(y: T, x: T) -> T {
    let (zero, one, largest) = (T::short(0.0), T::short(1.0), constant!(T::MAX));
    let (wide, high) = (x.abs(), y.abs());
    let steep = wide.less(high);
    let (top, bottom) = (T::select(steep, wide, high), T::select(steep, high, wide));
    // sums and products of the two in the middle of the numbers' range; infinite ones as 1
    let large = constant!(T::LARGE[0]);
    let scale = T::select(bottom.less(constant!(T::LARGE[1])), large, one);
    let scale = T::select(large.less(bottom), T::short(0.25), scale);
    let infinite = largest.less(bottom);
    let at_end = T::select(largest.less(top), one, zero);
    let top = T::select(infinite, at_end, top * scale);
    let bottom = T::select(infinite | bottom.equal(zero), one, bottom * scale);
    // from the nearest axis, towards the positive x or away from it
    let towards = first_octant(top, bottom).copysign(x);
    let quarter = constant!(T::FRAC_PI_2);
    let from = T::select(steep, quarter, quarter - quarter.copysign(x));
    let angle = from + T::select(steep, -towards, towards);
    T::select(x.is_nan() | y.is_nan(), constant!(T::NAN), angle.copysign(y))
}

/// sin 2πx for |x| ≤ ¼, to 3 units in the last place (the polynomial to 2^-54.5).
#[inline(always)]
pub fn sin_of_turns<T: Float<Precision = f64>>(x: T) -> T {
    let z = x * x;
    let ratio = polynomial!(
        z;
        T::of(core::f64::consts::TAU), T::of(-41.341_702_240_399_28),
        T::of(81.605_249_275_918_9), T::of(-76.705_859_733_614_76),
        T::of(42.058_692_747_956_684), T::of(-15.094_602_325_376_657),
        T::of(3.819_197_264_624_205_6), T::of(-0.710_648_467_613_533_2),
        T::of(0.072_934_850_156_866_1)
    );
    x * ratio
}

/// A precision and its numbers. Coefficients are given lowest first.
macro_rules! precision {
    (
        $t:ident, $bits:ident, mantissa $mantissa:literal, bias $bias:literal;
        ln2 $ln2_high:literal + $ln2_low:literal;
        half_pi $half_pi:expr; farthest $farthest:literal;
        powers $lowest:literal to $highest:literal; tanh to $tanh_end:literal;
        exp: $($exp:expr),+;
        exp2: $($exp2:expr),+;
        ln: $($ln:expr),+;
        log2: $($log2:expr),+;
        sin: $($sin:expr),+;
        cos: $($cos:expr),+;
        middle $middle:literal at $at_middle:literal;
        atan: $($atan:expr),+;
    ) => {
        impl Bits for $bits {
            type Truth = bool;
            #[inline(always)]
            #[allow(clippy::cast_possible_truncation)]
            fn of(value: u64) -> Self {
                value as $bits
            }
            #[inline(always)]
            fn wrapping_add(self, other: Self) -> Self {
                <$bits>::wrapping_add(self, other)
            }
            #[inline(always)]
            fn wrapping_sub(self, other: Self) -> Self {
                <$bits>::wrapping_sub(self, other)
            }
            #[inline(always)]
            fn equal(self, other: Self) -> bool {
                self == other
            }
        }

        impl Float for $t {
            type Precision = $t;
            type Bits = $bits;
            type Truth = bool;
            #[inline(always)]
            fn of(value: $t) -> Self {
                value
            }
            #[inline(always)]
            fn short(value: f32) -> Self {
                value.into()
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
                square_root::$t(self)
            }
            #[inline(always)]
            fn to_bits(self) -> $bits {
                <$t>::to_bits(self)
            }
            #[inline(always)]
            fn from_bits(bits: $bits) -> Self {
                <$t>::from_bits(bits)
            }
            #[inline(always)]
            fn less(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
            fn less_equal(self, other: Self) -> bool {
                self <= other
            }
            #[inline(always)]
            #[allow(clippy::float_cmp)] // equal numbers are meant
            fn equal(self, other: Self) -> bool {
                self == other
            }
            #[inline(always)]
            fn is_nan(self) -> bool {
                <$t>::is_nan(self)
            }
            #[inline(always)]
            fn select(truth: bool, yes: Self, no: Self) -> Self {
                if truth { yes } else { no }
            }
        }

        impl Precision for $t {
            const MANTISSA: u32 = $mantissa;
            const WIDTH: u32 = $bits::BITS;
            const NAN: Self = $t::NAN;
            const INFINITY: Self = $t::INFINITY;
            const MAX: Self = $t::MAX;
            const MIN_POSITIVE: Self = $t::MIN_POSITIVE;
            const LOG2_E: Self = core::$t::consts::LOG2_E;
            const FRAC_2_PI: Self = core::$t::consts::FRAC_2_PI;
            const FRAC_1_SQRT_2: Self = core::$t::consts::FRAC_1_SQRT_2;
            const FRAC_PI_4: Self = core::$t::consts::FRAC_PI_4;
            const FRAC_PI_2: Self = core::$t::consts::FRAC_PI_2;
            const POINT: Self = (1_u64 << $mantissa) as $t;
            const BIAS: Self = $bias;
            const WHOLE: Self = 1.5 * Self::POINT;
            const LIFT: [Self; 2] = [$mantissa as $t + 2.0, 4.0 * Self::POINT];
            const LARGE: [Self; 2] =
                [Self::POINT * Self::POINT, 1.0 / (Self::POINT * Self::POINT)];
            const LN_2: [Self; 2] = [$ln2_high, $ln2_low];
            const HALF_PI: [Self; 3] = $half_pi;
            const FARTHEST: Self = $farthest;
            const EXP2_ENDS: [Self; 2] = [$lowest, $highest];
            const EXP_ENDS: [Self; 2] = [$lowest / Self::LOG2_E, $highest / Self::LOG2_E];
            const TANH_END: Self = $tanh_end;
            const MIDDLE: [Self; 2] = [$middle, $at_middle];

            #[inline(always)]
            fn exp_tail<T: Float<Precision = Self>>(r: T) -> T {
                polynomial!(r; $(T::of($exp)),+)
            }
            #[inline(always)]
            fn exp2_ratio<T: Float<Precision = Self>>(r: T) -> T {
                polynomial!(r; $(T::of($exp2)),+)
            }
            #[inline(always)]
            fn ln_tail<T: Float<Precision = Self>>(z: T) -> T {
                polynomial!(z; $(T::of($ln)),+)
            }
            #[inline(always)]
            fn log2_ratio<T: Float<Precision = Self>>(z: T) -> T {
                polynomial!(z; $(T::of($log2)),+)
            }
            #[inline(always)]
            fn sin_tail<T: Float<Precision = Self>>(z: T) -> T {
                polynomial!(z; $(T::of($sin)),+)
            }
            #[inline(always)]
            fn cos_ratio<T: Float<Precision = Self>>(z: T) -> T {
                polynomial!(z; $(T::of($cos)),+)
            }
            #[inline(always)]
            fn atan_tail<T: Float<Precision = Self>>(z: T) -> T {
                polynomial!(z; $(T::of($atan)),+)
            }
        }
    };
}

// Double precision. Above a list: the largest relative error that its polynomial leaves.
precision! {
    f64, u64, mantissa 52, bias 1023.0;
    ln2 0.693_147_180_601_954_5 + -4.200_915_072_681_084_6e-11;
    half_pi [1.570_796_251_296_997, 7.549_789_415_861_596e-8, 5.390_302_858_158_119e-15];
    farthest 1e9;
    powers -1076.0 to 1025.0; tanh to 44.0;
    // 2^-55.9
    exp: 0.500_000_000_000_001_1, 0.166_666_666_666_658_2,
        0.041_666_666_666_520_226, 0.008_333_333_333_514_393, 0.001_388_888_894_896_976_2,
        0.000_198_412_700_410_703_23, 2.480_148_501_115_737_4e-5, 2.755_670_799_906_435e-6,
        2.763_386_688_773_765e-7, 2.537_981_717_692_442_5e-8;
    // 2^-57.1
    exp2: core::f64::consts::LN_2, 0.240_226_506_959_101_72, 0.055_504_108_664_824_574,
        0.009_618_129_107_577_12, 0.001_333_355_814_556_65, 0.000_154_035_304_787_616_52,
        1.525_273_473_950_628_4e-5, 1.321_542_453_993_62e-6, 1.017_765_536_318_700_1e-7,
        7.075_605_440_454_941e-9, 4.519_421_097_949_173e-10;
    // 2^-59.5
    ln: 0.666_666_666_666_673_4, 0.399_999_999_994_165_3, 0.285_714_287_420_691_55,
        0.222_221_985_995_595_67, 0.181_835_631_928_195_52, 0.153_140_748_579_779_02,
        0.147_957_443_838_991_48;
    // 2^-56.0
    log2: 2.885_390_081_777_926_8, 0.961_796_693_926_117_1, 0.577_078_016_275_182_4,
        0.412_198_600_356_325_6, 0.320_597_111_942_527_16, 0.262_405_831_551_289,
        0.219_135_091_555_638_43, 0.231_015_062_866_352_43;
    // 2^-57.9
    sin: -0.166_666_666_666_666_3, 0.008_333_333_333_321_84, -0.000_198_412_698_293_585_03,
        2.755_731_353_849_223_2e-6, -2.505_073_438_309_582_5e-8, 1.589_543_274_537_395_9e-10;
    // 2^-63.9
    cos: -0.5, 0.041_666_666_666_666_595, -0.001_388_888_888_887_333_8,
        2.480_158_728_899_746e-5, -2.755_731_421_528_497e-7, 2.087_570_511_183_020_5e-9,
        -1.135_873_254_710_709_6e-11;
    middle 0.499_134_540_557_861_33 at 0.462_955_001_788_425_2;
    // 2^-57.5
    atan: -0.333_333_333_333_325_4, 0.199_999_999_995_855_72, -0.142_857_142_118_540_17,
        0.111_111_047_344_930_24, -0.090_906_036_945_631_22, 0.076_837_426_295_332_19,
        -0.065_259_432_893_030_34, 0.046_083_728_038_317_4;
}

// Single precision.
precision! {
    f32, u32, mantissa 23, bias 127.0;
    ln2 0.693_115_23 + 3.194_618_5e-5;
    half_pi [1.570_312_5, 0.000_483_989_72, -1.629_206_8e-7];
    farthest 2e4;
    powers -151.0 to 129.0; tanh to 20.0;
    // 2^-28.2
    exp: 0.499_999_94, 0.166_665_17, 0.041_668_102, 0.008_369_198,
        0.001_383_908_7;
    // 2^-26.3
    exp2: core::f32::consts::LN_2, 0.240_225_94, 0.055_503_663, 0.009_625_44, 0.001_338_790_5,
        0.000_133_346_29;
    // 2^-30.2
    ln: 0.666_667_76, 0.399_775_8, 0.298_709_27;
    // 2^-26.2
    log2: 2.885_39, 0.961_822, 0.574_584_66, 0.480_437_93;
    // 2^-27.9
    sin: -0.166_666_55, 0.008_332_189, -0.000_195_182_92;
    // 2^-33.0
    cos: -0.5, 0.041_666_646, -0.001_388_731, 2.443_232_7e-5;
    middle 0.501_709 at 0.465_013_86;
    // 2^-26.1
    atan: -0.333_328_84, 0.199_558_81, -0.130_395_87;
}

#[cfg(feature = "std")]
mod square_root {
    pub(super) use std::primitive::f32 as f32_type;
    pub(super) use std::primitive::f64 as f64_type;
    #[inline(always)]
    pub(super) fn f32(x: f32_type) -> f32_type {
        x.sqrt()
    }
    #[inline(always)]
    pub(super) fn f64(x: f64_type) -> f64_type {
        x.sqrt()
    }
}
#[cfg(not(feature = "std"))]
mod square_root {
    pub(super) use libm::{sqrt as f64, sqrtf as f32};
}
