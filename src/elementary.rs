//! Floor 0. Elementary functions, written so that they run alike everywhere.
//!
//! Sums, products, divisions, bit patterns and selections between two computed values: no branch,
//! no table, no call. A compiler makes vector code of a loop over them, a chip without an operating
//! system links nothing else, and the bits are the same on all of them.
//!
//! Each reduces its argument to a short interval around 0 and sums the Taylor series there, as far
//! as the precision goes. Errors stay within two units in the last place (`powf`: see there).

/// Σ cᵢ xⁱ.
macro_rules! horner {
    ($x:expr, $last:expr) => { $last };
    ($x:expr, $first:expr, $($more:expr),+) => {
        $first + $x * horner!($x, $($more),+)
    };
}

/// The functions of one precision.
///
/// `mantissa`: explicit bits of a mantissa. `ln2`, `half_pi`: the constant as a sum whose first
/// terms are short, so that a whole number times them is exact. `farthest`: the largest argument of
/// sine and cosine. `exp`, `ln`, `sin`, `cos`, `atan`: the series, lowest term first.
macro_rules! elementary {
    (
        $t:ident, $bits:ident, mantissa $mantissa:literal, bias $bias:literal;
        ln2 $ln2_high:literal + $ln2_low:literal;
        half_pi $half_pi:expr; farthest $farthest:literal;
        exp $lowest:literal to $highest:literal: $($exp:expr),+;
        ln: $($ln:expr),+;
        sin: $($sin:expr),+;
        cos: $($cos:expr),+;
        atan: $($atan:expr),+;
    ) => {
        /// 1.5·2ᵐ: adding it rounds to a whole number, which then stands in the lowest bits.
        const WHOLE: $t = (3_u64 << ($mantissa - 1)) as $t;
        const ONE: $bits = (1.0 as $t).to_bits();

        /// The whole number nearest to x, and bits whose lowest end is that number.
        #[inline(always)]
        fn rounded(x: $t) -> ($t, $bits) {
            let shifted = x + WHOLE;
            (shifted - WHOLE, shifted.to_bits())
        }

        /// 2ⁿ for the whole number n in the lowest bits, n within the exponents of normal numbers.
        #[inline(always)]
        fn power_of_2(n: $bits) -> $t {
            $t::from_bits((n << $mantissa).wrapping_add(ONE))
        }

        /// eˣ: x = n ln 2 + r.
        #[inline(always)]
        pub(crate) fn exp(x: $t) -> $t {
            // beyond, the result is 0 or infinite; NaN stays NaN
            let x = if x < $lowest { $lowest } else { x };
            let x = if x > $highest { $highest } else { x };
            let (n, _) = rounded(x * core::$t::consts::LOG2_E);
            let r = (x - n * $ln2_high) - n * $ln2_low;
            let series = horner!(r, $($exp),+);
            // 2ⁿ in two factors: n may be beyond the normal numbers at either end
            let (half, half_bits) = rounded(n * 0.5);
            let (_, rest_bits) = rounded(n - half);
            series * power_of_2(half_bits) * power_of_2(rest_bits)
        }

        /// ln x: x = 2ᵏ(1 + f), √½ ≤ 1 + f < √2, ln(1 + f) = 2 artanh s, s = f/(2 + f).
        #[inline(always)]
        #[allow(clippy::cast_lossless)] // a small whole number, for both precisions
        pub(crate) fn ln(x: $t) -> $t {
            const SQRT_HALF: $bits = core::$t::consts::FRAC_1_SQRT_2.to_bits();
            const LIFT: $t = (1_u64 << ($mantissa + 2)) as $t;
            const POINT: $t = (1_u64 << $mantissa) as $t;
            let subnormal = x < $t::MIN_POSITIVE;
            let normal = if subnormal { x * LIFT } else { x };
            let lifted = if subnormal { ($mantissa + 2) as $t } else { 0.0 };
            let shifted = normal.to_bits().wrapping_add(ONE - SQRT_HALF);
            // the exponent as a number: put below the point of 2ᵐ, then taken off
            let exponent = $t::from_bits(POINT.to_bits() | (shifted >> $mantissa));
            let k = exponent - (POINT + $bias) - lifted;
            let f = $t::from_bits((shifted & ((1 << $mantissa) - 1)) + SQRT_HALF) - 1.0;
            let s = f / (2.0 + f);
            let z = s * s;
            let series = z * (horner!(z, $($ln),+));
            let half_square = 0.5 * f * f;
            let tail = s * (half_square + series) + k * $ln2_low;
            let value = k * $ln2_high - ((half_square - tail) - f);
            let value = if x == 0.0 { $t::NEG_INFINITY } else { value };
            let value = if x == $t::INFINITY { x } else { value };
            if x >= 0.0 { value } else { $t::NAN }
        }

        /// xᵖ for x ≥ 0, as exp(p ln x): NaN for x < 0. The relative error is about
        /// 1 + 2|p ln x| units in the last place.
        #[inline(always)]
        pub(crate) fn powf(x: $t, power: $t) -> $t {
            let value = exp(power * ln(x));
            if power == 0.0 { 1.0 } else { value }
        }

        /// Sine and cosine of what is left of x after n quarter turns, and n in the lowest bits.
        #[inline(always)]
        fn quarter(x: $t) -> ($t, $t, $bits) {
            let (n, bits) = rounded(x * core::$t::consts::FRAC_2_PI);
            let mut r = x;
            for part in $half_pi {
                r -= n * part;
            }
            let z = r * r;
            let sin = r + r * z * (horner!(z, $($sin),+));
            let cos = 1.0 + z * (horner!(z, $($cos),+));
            let known = x.abs() <= $farthest;
            (if known { sin } else { $t::NAN }, if known { cos } else { $t::NAN }, bits)
        }

        /// `value`, or its negative where the bit of value 2 is set in n.
        #[inline(always)]
        fn signed(value: $t, n: $bits) -> $t {
            $t::from_bits(value.to_bits() ^ ((n >> 1) << ($bits::BITS - 1)))
        }

        /// sin x; NaN beyond the largest argument, where a float is no angle any more.
        #[inline(always)]
        pub(crate) fn sin(x: $t) -> $t {
            let (sin, cos, n) = quarter(x);
            signed(if n & 1 == 0 { sin } else { cos }, n)
        }

        /// cos x; NaN as for `sin`.
        #[inline(always)]
        pub(crate) fn cos(x: $t) -> $t {
            let (sin, cos, n) = quarter(x);
            signed(if n & 1 == 0 { cos } else { sin }, n.wrapping_add(1))
        }

        /// atan x: |x| or its inverse, less the nearest of 0, ½ and 1 in the sense of the addition
        /// theorem, atan t = atan c + atan((t − c)/(1 + ct)).
        #[inline(always)]
        pub(crate) fn atan(x: $t) -> $t {
            use core::$t::consts::{FRAC_PI_2, FRAC_PI_4};
            #[allow(clippy::excessive_precision)] // one figure for both precisions
            const ATAN_HALF: $t = 0.463_647_609_000_806_1;
            let size = x.abs();
            let inverted = size > 1.0;
            // t = top/bottom in [0, 1]; an infinite x counts as the largest number
            let top = if inverted { 1.0 } else { size };
            let bottom = if inverted { if size > $t::MAX { $t::MAX } else { size } } else { 1.0 };
            let (high, middle) = (top > 0.75 * bottom, top > 0.25 * bottom);
            let c = if high { 1.0 } else if middle { 0.5 } else { 0.0 };
            let at_c = if high { FRAC_PI_4 } else if middle { ATAN_HALF } else { 0.0 };
            let s = (top - c * bottom) / (bottom + c * top);
            let z = s * s;
            let angle = at_c + (s + s * z * (horner!(z, $($atan),+)));
            let angle = if inverted { FRAC_PI_2 - angle } else { angle };
            if x.is_nan() { x } else { angle.copysign(x) }
        }
    };
}

/// Double precision.
pub(crate) mod double {
    elementary! {
        f64, u64, mantissa 52, bias 1023.0;
        ln2 0.693_147_180_601_954_5 + -4.200_915_072_681_084_6e-11;
        half_pi [
            1.570_796_251_296_997,
            7.549_789_415_861_596e-8,
            5.390_302_529_957_765e-15,
            3.282_003_542_873_500_5e-22,
        ];
        farthest 1e9;
        exp -746.0 to 710.0: 1.0, 1.0, 1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0,
            1.0 / 5_040.0, 1.0 / 40_320.0, 1.0 / 362_880.0, 1.0 / 3_628_800.0, 1.0 / 39_916_800.0,
            1.0 / 479_001_600.0, 1.0 / 6_227_020_800.0;
        ln: 2.0 / 3.0, 2.0 / 5.0, 2.0 / 7.0, 2.0 / 9.0, 2.0 / 11.0, 2.0 / 13.0, 2.0 / 15.0,
            2.0 / 17.0, 2.0 / 19.0, 2.0 / 21.0;
        sin: -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5_040.0, 1.0 / 362_880.0, -1.0 / 39_916_800.0,
            1.0 / 6_227_020_800.0, -1.0 / 1_307_674_368_000.0,
            1.0 / 355_687_428_096_000.0;
        cos: -1.0 / 2.0, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40_320.0, -1.0 / 3_628_800.0,
            1.0 / 479_001_600.0, -1.0 / 87_178_291_200.0, 1.0 / 20_922_789_888_000.0;
        atan: -1.0 / 3.0, 1.0 / 5.0, -1.0 / 7.0, 1.0 / 9.0, -1.0 / 11.0, 1.0 / 13.0, -1.0 / 15.0,
            1.0 / 17.0, -1.0 / 19.0, 1.0 / 21.0, -1.0 / 23.0, 1.0 / 25.0, -1.0 / 27.0;
    }
}

/// Single precision.
pub(crate) mod single {
    elementary! {
        f32, u32, mantissa 23, bias 127.0;
        ln2 0.693_115_23 + 3.194_618_5e-5;
        half_pi [1.570_312_5, 0.000_483_989_72, -1.629_206_8e-7];
        farthest 2e4;
        exp -104.0 to 89.0: 1.0, 1.0, 1.0 / 2.0, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0, 1.0 / 720.0,
            1.0 / 5_040.0;
        ln: 2.0 / 3.0, 2.0 / 5.0, 2.0 / 7.0, 2.0 / 9.0;
        sin: -1.0 / 6.0, 1.0 / 120.0, -1.0 / 5_040.0, 1.0 / 362_880.0;
        cos: -1.0 / 2.0, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40_320.0, -1.0 / 3_628_800.0;
        atan: -1.0 / 3.0, 1.0 / 5.0, -1.0 / 7.0, 1.0 / 9.0, -1.0 / 11.0, 1.0 / 13.0;
    }
}
