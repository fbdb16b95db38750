//! Floor 0. Elementary functions, written so that they run alike everywhere.
//!
//! Sums, products, divisions, bit patterns and selections between two computed values: no branch,
//! no table, no call. A compiler makes vector code of a loop over them, a chip without an operating
//! system links nothing else, and the bits are the same on all of them.
//!
//! Each reduces its argument to a short interval around 0 and takes a polynomial there whose largest
//! relative error on it is least (Remez), its coefficients rounded one after the other. Errors stay
//! within two units in the last place where nothing else is said.

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

/// The functions of one precision.
///
/// `mantissa`: explicit bits of a mantissa. `ln2`, `half_pi`: the constant as a sum whose first
/// terms are short, so that a whole number times them is exact. `farthest`: the largest argument of
/// sine and cosine. `powers`: the exponents at which 2ˣ is 0 and infinite. `tanh`: 2x from where
/// tanh x is 1. `middle`: a short number near ½ whose arc tangent is nearly a number of the precision.
///
/// Coefficients, lowest first. In r: `exp` of (eʳ − 1 − r)/r², `exp2` of (2ʳ − 1)/r. In s²: `ln` of
/// (2 artanh s − 2s)/s³, `log2` of 2 artanh s/(s ln 2), `sin` of (sin s − s)/s³, `cos` of
/// (cos s − 1)/s², `atan` of (atan s − s)/s³.
macro_rules! elementary {
    (
        $t:ident, $bits:ident, mantissa $mantissa:literal, bias $bias:literal;
        ln2 $ln2_high:literal + $ln2_low:literal;
        half_pi $half_pi:expr; farthest $farthest:literal;
        powers $lowest:literal to $highest:literal; tanh to $all:literal;
        exp: $($exp:expr),+;
        exp2: $($exp2:expr),+;
        ln: $($ln:expr),+;
        log2: $($log2:expr),+;
        sin: $($sin:expr),+;
        cos: $($cos:expr),+;
        middle $middle:literal at $at_middle:literal;
        atan: $($atan:expr),+;
    ) => {
        use core::$t::consts::{FRAC_1_SQRT_2, FRAC_2_PI, FRAC_PI_2, FRAC_PI_4, LN_2, LOG2_E, PI};

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

        /// r, n in the lowest bits and eʳ − 1, where x = n ln 2 + r.
        #[inline(always)]
        fn exp_less_1(x: $t) -> ($t, $bits) {
            let (n, bits) = rounded(x * LOG2_E);
            let r = (x - n * $ln2_high) - n * $ln2_low;
            let tail = polynomial!(r; $($exp),+);
            (r + r * r * tail, bits)
        }

        /// 2ⁿ times a number, in two factors: n may be beyond the normal numbers at either end.
        #[inline(always)]
        fn scaled(x: $t, n: $bits) -> $t {
            let half = n >> 1;
            x * power_of_2(half) * power_of_2(n.wrapping_sub(half))
        }

        /// x brought to where eˣ or 2ˣ goes from 0 to infinity; NaN stays NaN.
        #[inline(always)]
        fn limited(x: $t, lowest: $t, highest: $t) -> $t {
            let x = if x < lowest { lowest } else { x };
            if x > highest { highest } else { x }
        }

        /// eˣ.
        #[inline(always)]
        pub(crate) fn exp(x: $t) -> $t {
            let (less_1, n) = exp_less_1(limited(x, $lowest / LOG2_E, $highest / LOG2_E));
            scaled(1.0 + less_1, n)
        }

        /// tanh x = (e²ˣ − 1)/(e²ˣ + 1), to 4 units in the last place.
        #[inline(always)]
        pub(crate) fn tanh(x: $t) -> $t {
            let double = 2.0 * x.abs();
            // beyond, the result rounds to 1; NaN stays NaN
            let double = if double > $all { $all } else { double };
            let (less_1, n) = exp_less_1(double);
            let power = power_of_2(n);
            let less_1 = power * less_1 + (power - 1.0);
            (less_1 / (less_1 + 2.0)).copysign(x)
        }

        /// x ≥ 0 as a normal number (or 0), and by which power of 2 it was lifted to be one.
        #[inline(always)]
        #[allow(clippy::cast_lossless)] // a small whole number, for both precisions
        fn lifted(x: $t) -> ($t, $t) {
            const LIFT: $t = (1_u64 << ($mantissa + 2)) as $t;
            let subnormal = x < $t::MIN_POSITIVE;
            let lift = if subnormal { ($mantissa + 2) as $t } else { 0.0 };
            (if subnormal { x * LIFT } else { x }, lift)
        }

        /// k and f of a normal x = 2ᵏ(1 + f), √½ ≤ 1 + f < √2.
        #[inline(always)]
        fn parts(x: $t) -> ($t, $t) {
            const SQRT_HALF: $bits = FRAC_1_SQRT_2.to_bits();
            const POINT: $t = (1_u64 << $mantissa) as $t;
            let shifted = x.to_bits().wrapping_add(ONE - SQRT_HALF);
            // the exponent as a number: put below the point of 2ᵐ, then taken off
            let exponent = $t::from_bits(POINT.to_bits() | (shifted >> $mantissa));
            let f = $t::from_bits((shifted & ((1 << $mantissa) - 1)) + SQRT_HALF) - 1.0;
            (exponent - (POINT + $bias), f)
        }

        /// The logarithm of x where `value` is that of a positive and finite one.
        #[inline(always)]
        fn of_any(value: $t, x: $t) -> $t {
            let value = if x == 0.0 { $t::NEG_INFINITY } else { value };
            let value = if x == $t::INFINITY { x } else { value };
            if x >= 0.0 { value } else { $t::NAN }
        }

        /// ln x = k ln 2 + ln(1 + f), ln(1 + f) = 2 artanh s, s = f/(2 + f).
        #[inline(always)]
        pub(crate) fn ln(x: $t) -> $t {
            let (normal, lift) = lifted(x);
            let (k, f) = parts(normal);
            let k = k - lift;
            let s = f / (2.0 + f);
            let z = s * s;
            let series = z * (polynomial!(z; $($ln),+));
            let half_square = 0.5 * f * f;
            let tail = s * (half_square + series) + k * $ln2_low;
            of_any(k * $ln2_high - ((half_square - tail) - f), x)
        }

        /// k and s = f/(2 + f) of a normal x = 2ᵏ(1 + f) > 0.
        #[inline(always)]
        pub(crate) fn log2_parts(x: $t) -> ($t, $t) {
            let (k, f) = parts(x);
            (k, f / (2.0 + f))
        }

        /// log₂ x from these: k + 2 artanh s/ln 2, to 3 units in the last place.
        #[inline(always)]
        pub(crate) fn log2_of(k: $t, s: $t) -> $t {
            let z = s * s;
            k + s * (polynomial!(z; $($log2),+))
        }

        /// xᵖ for x ≥ 0, as 2 to the power of p log₂ x = n + r: NaN for x < 0. The relative error is
        /// about 1 + 2|p ln x| units in the last place.
        #[inline(always)]
        pub(crate) fn powf(x: $t, power: $t) -> $t {
            let (normal, lift) = lifted(x);
            let (k, s) = log2_parts(normal);
            let y = limited(power * of_any(log2_of(k, s) - lift, x), $lowest, $highest);
            let (n, bits) = rounded(y);
            let r = y - n;
            let value = scaled(1.0 + r * (polynomial!(r; $($exp2),+)), bits);
            if power == 0.0 { 1.0 } else { value }
        }

        /// Sine and cosine of what is left of x after n quarter turns, and n in the lowest bits;
        /// NaN beyond the largest argument, where a float is no angle any more.
        #[inline(always)]
        fn quarter(x: $t) -> ($t, $t, $bits) {
            let x = if x.abs() <= $farthest { x } else { $t::NAN };
            let (n, bits) = rounded(x * FRAC_2_PI);
            let mut r = x;
            for part in $half_pi {
                r -= n * part;
            }
            let z = r * r;
            let sin = r + r * z * (polynomial!(z; $($sin),+));
            let cos = 1.0 + z * (polynomial!(z; $($cos),+));
            (sin, cos, bits)
        }

        /// `value`, or its negative where the bit of value 2 is set in n.
        #[inline(always)]
        fn signed(value: $t, n: $bits) -> $t {
            $t::from_bits(value.to_bits() ^ ((n >> 1) << ($bits::BITS - 1)))
        }

        /// sin x.
        #[inline(always)]
        pub(crate) fn sin(x: $t) -> $t {
            let (sin, cos, n) = quarter(x);
            signed(if n & 1 == 0 { sin } else { cos }, n)
        }

        /// cos x.
        #[inline(always)]
        pub(crate) fn cos(x: $t) -> $t {
            let (sin, cos, n) = quarter(x);
            signed(if n & 1 == 0 { cos } else { sin }, n.wrapping_add(1))
        }

        /// tan x, to 4 units in the last place.
        #[inline(always)]
        pub(crate) fn tan(x: $t) -> $t {
            let (sin, cos, n) = quarter(x);
            let even = n & 1 == 0;
            (if even { sin } else { -cos }) / (if even { cos } else { sin })
        }

        /// atan(top/bottom) for 0 ≤ top ≤ bottom: less the nearest of 0, c near ½ and 1 in the sense
        /// of the addition theorem, atan t = atan c + atan((t − c)/(1 + ct)).
        #[inline(always)]
        fn first_octant(top: $t, bottom: $t) -> $t {
            let (high, middle) = (top > 0.75 * bottom, top > 0.25 * bottom);
            let c = if high { 1.0 } else if middle { $middle } else { 0.0 };
            let at_c = if high { FRAC_PI_4 } else if middle { $at_middle } else { 0.0 };
            let s = (top - c * bottom) / (bottom + c * top);
            let z = s * s;
            at_c + (s + s * z * (polynomial!(z; $($atan),+)))
        }

        /// atan x.
        #[inline(always)]
        pub(crate) fn atan(x: $t) -> $t {
            let size = x.abs();
            let inverted = size > 1.0;
            // an infinite x counts as the largest number
            let top = if inverted { 1.0 } else { size };
            let bottom = if inverted { if size > $t::MAX { $t::MAX } else { size } } else { 1.0 };
            let angle = first_octant(top, bottom);
            let angle = if inverted { FRAC_PI_2 - angle } else { angle };
            if x.is_nan() { x } else { angle.copysign(x) }
        }

        /// The angle of the point (x, y) in [−π, π], as IEEE 754 has it for zeros and infinities.
        #[inline(always)]
        pub(crate) fn atan2(y: $t, x: $t) -> $t {
            const LARGE: $t = (1_u64 << $mantissa) as $t * (1_u64 << $mantissa) as $t;
            let steep = y.abs() > x.abs();
            let (top, bottom) =
                if steep { (x.abs(), y.abs()) } else { (y.abs(), x.abs()) };
            // sums and products of the two in the middle of the numbers' range; infinite ones as 1
            let scale = if bottom < 1.0 / LARGE { LARGE } else { 1.0 };
            let scale = if bottom > LARGE { 0.25 } else { scale };
            let infinite = bottom > $t::MAX;
            let one = |x: $t| if x > $t::MAX { 1.0 } else { 0.0 };
            let top = if infinite { one(top) } else { top * scale };
            let bottom = if infinite || bottom == 0.0 { 1.0 } else { bottom * scale };
            let angle = first_octant(top, bottom);
            let behind = x.is_sign_negative();
            let from = if behind { PI } else { 0.0 };
            let from = if steep { FRAC_PI_2 } else { from };
            let angle = from + if steep == behind { angle } else { -angle };
            if x.is_nan() | y.is_nan() { $t::NAN } else { angle.copysign(y) }
        }
    };
}

/// Double precision. Above a list: the largest relative error that its polynomial leaves.
pub(crate) mod double {
    use core::f64::consts::TAU;

    elementary! {
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
        exp2: LN_2, 0.240_226_506_959_101_72, 0.055_504_108_664_824_574,
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

    /// sin 2πx for |x| ≤ ¼, to 3 units in the last place (the polynomial to 2^-54.5).
    #[inline(always)]
    pub(crate) fn sin_of_turns(x: f64) -> f64 {
        let z = x * x;
        let ratio = polynomial!(
            z;
            TAU, -41.341_702_240_399_28, 81.605_249_275_918_9,
            -76.705_859_733_614_76, 42.058_692_747_956_684, -15.094_602_325_376_657,
            3.819_197_264_624_205_6, -0.710_648_467_613_533_2, 0.072_934_850_156_866_1
        );
        x * ratio
    }
}

/// Single precision.
pub(crate) mod single {
    elementary! {
        f32, u32, mantissa 23, bias 127.0;
        ln2 0.693_115_23 + 3.194_618_5e-5;
        half_pi [1.570_312_5, 0.000_483_989_72, -1.629_206_8e-7];
        farthest 2e4;
        powers -151.0 to 129.0; tanh to 20.0;
        // 2^-28.2
        exp: 0.499_999_94, 0.166_665_17, 0.041_668_102, 0.008_369_198,
            0.001_383_908_7;
        // 2^-26.3
        exp2: LN_2, 0.240_225_94, 0.055_503_663, 0.009_625_44, 0.001_338_790_5,
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
}
