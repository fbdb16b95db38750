//! Elementary functions against the operating system's and mpmath's, in units in the last place.

use super::exact::VALUES;
use hgo_rs::Scalar;
use hgo_rs::elementary;
use hgo_rs::noise::{Channel, Stream, turned};

/// Distance of two numbers in units in the last place of the second; 0 if both are NaN.
fn ulps(ours: f64, exact: f64, mantissa: i32) -> f64 {
    if ours == exact || (ours.is_nan() && exact.is_nan()) {
        return 0.0;
    }
    let exponent = exact.abs().log2().floor().max(if mantissa == 23 { -126.0 } else { -1022.0 });
    (ours - exact).abs() / 2.0_f64.powf(exponent - f64::from(mantissa)).max(5e-324)
}

/// The largest error of `ours` over 400,000 arguments, uniform on [low, high) or, for low > 0, on a
/// logarithmic scale.
fn worst<T: Scalar>(
    name: &str,
    (low, high): (f64, f64),
    ours: impl Fn(T) -> T,
    exact: impl Fn(f64) -> f64,
) -> f64 {
    let mantissa = if size_of::<T>() == 4 { 23 } else { 52 };
    let mut stream = Stream::new(7, 0, Channel::Measurement);
    let (mut largest, mut at) = (0.0, 0.0);
    for _ in 0..400_000 {
        let u = stream.uniform();
        let drawn = if low > 0.0 { low * (high / low).powf(u) } else { low + (high - low) * u };
        let x = T::from_f64(drawn);
        let error = ulps(ours(x).to_f64(), exact(x.to_f64()), mantissa);
        if error > largest || error.is_nan() {
            (largest, at) = (error, x.to_f64());
        }
    }
    println!("{name}: {largest} at {at}");
    largest
}

/// The bound that `exact`, itself good to a unit in double precision, leaves.
fn all<T: Scalar>(far: f64, smallest: f64, tiny: f64) {
    let close = |error: f64| assert!(error <= 2.0, "{error}");
    close(worst::<T>("exp", (-80.0, 80.0), T::exp, f64::exp));
    close(worst::<T>("exp", (-1.0, 1.0), T::exp, f64::exp));
    close(worst::<T>("ln", (1e-30, 1e30), T::ln, f64::ln));
    close(worst::<T>("ln", (0.5, 2.0), T::ln, f64::ln));
    close(worst::<T>("ln of subnormals", (tiny, smallest), T::ln, f64::ln));
    for span in [1.0, 10.0, far] {
        // around a zero only the absolute error is kept small: the angle itself is rounded there
        let sin = |x: T| if x.sin().abs() < T::from_f64(1e-3) { x } else { x.sin() };
        let cos = |x: T| if x.cos().abs() < T::from_f64(1e-3) { x } else { x.cos() };
        let exact_sin =
            |x: f64| if T::from_f64(x).sin().abs() < T::from_f64(1e-3) { x } else { x.sin() };
        let exact_cos =
            |x: f64| if T::from_f64(x).cos().abs() < T::from_f64(1e-3) { x } else { x.cos() };
        close(worst::<T>("sin", (-span, span), sin, exact_sin));
        close(worst::<T>("cos", (-span, span), cos, exact_cos));
    }
    close(worst::<T>("sin of little", (tiny, 0.1), T::sin, f64::sin));
    let few = |error: f64| assert!(error <= 4.0, "{error}");
    few(worst::<T>("tan", (-1.5, 1.5), T::tan, f64::tan));
    few(worst::<T>("tan", (1.6, 3.1), T::tan, f64::tan));
    few(worst::<T>("tan of little", (tiny, 0.1), T::tan, f64::tan));
    few(worst::<T>("tanh", (-1.0, 1.0), T::tanh, f64::tanh));
    few(worst::<T>("tanh", (-30.0, 30.0), T::tanh, f64::tanh));
    few(worst::<T>("tanh of little", (tiny, 0.5), T::tanh, f64::tanh));
    for x in [-2.0, -1e-3, 0.7, 3.0] {
        let atan2 = |y: T| y.atan2(T::from_f64(x));
        let exact = |y: f64| y.atan2(T::from_f64(x).to_f64());
        few(worst::<T>("atan2", (-5.0, 5.0), atan2, exact));
        few(worst::<T>("atan2", (1e-30, 1e30), atan2, exact));
    }
    close(worst::<T>("atan", (-3.0, 3.0), T::atan, f64::atan));
    close(worst::<T>("atan", (1e-30, 1e30), T::atan, f64::atan));
    for power in [-1.0, 0.183, 0.634, 2.5] {
        let p = T::from_f64(power);
        let error = worst::<T>("powf", (1e-3, 1e3), |x| x.powf(p), |x| x.powf(p.to_f64()));
        assert!(error < 2.0 * (1.0 + power.abs() * 1e3_f64.ln()), "{error}");
    }
}

/// Where the core is worst, beside values that are good to far more digits.
#[test]
fn to_a_fraction_of_the_last_place() {
    for (name, values) in VALUES {
        let (ours, bound): (fn(f64) -> f64, f64) = match name {
            "exp" => (Scalar::exp, 1.1),
            "ln" => (Scalar::ln, 1.0),
            "sin" => (Scalar::sin, 1.6),
            "cos" => (Scalar::cos, 1.6),
            "atan" => (Scalar::atan, 1.6),
            "tan" => (Scalar::tan, 3.0),
            _ => (Scalar::tanh, 3.0),
        };
        for &[x, near, beyond] in values {
            let place = near.abs().next_up() - near.abs();
            let error = ((ours(x) - near) / place - beyond).abs();
            assert!(error <= bound, "{name} {x}: off by {error}");
        }
    }
}

#[test]
fn double_precision() {
    all::<f64>(1e5, f64::MIN_POSITIVE, 5e-324);
}

#[test]
fn single_precision() {
    all::<f32>(1e4, f64::from(f32::MIN_POSITIVE), 2e-45);
}

#[test]
fn sine_and_cosine_of_large_angles() {
    for k in 1..2000_u32 {
        let x = f64::from(k) * 499_979.3;
        assert!((Scalar::sin(x) - x.sin()).abs() < 1e-15, "{x}");
        assert!((Scalar::cos(x) - x.cos()).abs() < 1e-15, "{x}");
    }
    assert!(Scalar::sin(1.1e9_f64).is_nan() && Scalar::cos(-1.1e9_f64).is_nan());
    assert!(Scalar::sin(2.1e4_f32).is_nan() && Scalar::cos(f32::INFINITY).is_nan());
}

fn special<T: Scalar>() {
    let c = T::from_f64;
    let (nan, inf) = (c(f64::NAN), c(f64::INFINITY));
    let is_nan = |x: T| x.to_f64().is_nan();
    assert!(
        [nan.exp(), nan.ln(), nan.sin(), nan.cos(), nan.tan(), nan.tanh(), nan.atan()]
            .into_iter()
            .chain([nan.powf(T::ONE), inf.tan()])
            .all(is_nan)
    );
    assert!(
        is_nan(inf.sin()) && is_nan((-inf).cos()) && is_nan(c(-1.0).ln()) && is_nan((-inf).ln())
    );
    assert_eq!([inf.exp(), inf.ln(), c(1000.0).exp()], [inf; 3]);
    assert_eq!(
        [(-inf).exp(), c(-1000.0).exp(), T::ONE.ln(), T::ZERO.sin(), T::ZERO.atan()],
        [T::ZERO; 5]
    );
    assert_eq!(
        [T::ZERO.exp(), T::ZERO.cos(), T::ZERO.powf(T::ZERO), nan.powf(T::ZERO)],
        [T::ONE; 4]
    );
    assert_eq!([T::ZERO.ln(), -inf], [-inf; 2]);
    assert_eq!(T::ZERO.powf(c(0.5)), T::ZERO);
    assert_eq!([inf.tanh(), c(50.0).tanh(), -(-inf).tanh()], [T::ONE; 3]);
    assert_eq!([T::ZERO.tan(), T::ZERO.tanh(), T::ZERO.atan2(T::ZERO)], [T::ZERO; 3]);
    assert!((-T::ZERO).tanh().to_f64().is_sign_negative());
    assert!(is_nan(c(-2.0).powf(c(2.0))));
    assert!((inf.atan().to_f64() - core::f64::consts::FRAC_PI_2).abs() < 1e-7);
    assert!(((-inf).atan().to_f64() + core::f64::consts::FRAC_PI_2).abs() < 1e-7);
    assert!((-T::ZERO).atan().to_f64().is_sign_negative());
}

/// Zeros, infinities and numbers at either end, beside the operating system's.
fn atan2_at_the_ends<T: Scalar>(tiny: f64, huge: f64) {
    let ends = [0.0, tiny, 4.0 * tiny, 1.0, huge, f64::INFINITY].map(|x| T::from_f64(x).to_f64());
    let ends: Vec<f64> = ends.into_iter().chain(ends.map(|x| -x)).collect();
    for &y in &ends {
        for &x in &ends {
            let (ours, exact) = (T::from_f64(y).atan2(T::from_f64(x)).to_f64(), y.atan2(x));
            assert!(
                (ours - exact).abs() <= 2e-7 * exact.abs() + tiny,
                "{y}, {x}: {ours}, not {exact}"
            );
            assert_eq!(ours.is_sign_negative(), y.is_sign_negative(), "{y}, {x}");
        }
        let nan = T::from_f64(f64::NAN);
        assert!(nan.atan2(T::from_f64(y)).to_f64().is_nan());
        assert!(T::from_f64(y).atan2(nan).to_f64().is_nan());
    }
}

#[test]
fn special_values() {
    atan2_at_the_ends::<f64>(5e-324, f64::MAX);
    atan2_at_the_ends::<f32>(2e-45, f64::from(f32::MAX));
    special::<f64>();
    special::<f32>();
}

/// exp between the largest number and infinity, and between the smallest and 0.
#[test]
fn exp_at_the_ends() {
    assert!(ulps(Scalar::exp(709.7), 709.7_f64.exp(), 52) < 2.0);
    assert_eq!(Scalar::exp(709.79), f64::INFINITY);
    assert!(ulps(Scalar::exp(-745.0), (-745.0_f64).exp(), 52) <= 1.0);
    assert!(ulps(Scalar::exp(-740.3), (-740.3_f64).exp(), 52) <= 1.0);
    assert!(ulps(f64::from(Scalar::exp(88.7_f32)), f64::from(88.7_f32).exp(), 23) < 2.0);
    assert!(ulps(f64::from(Scalar::exp(-103.0_f32)), f64::from(-103.0_f32).exp(), 23) <= 1.0);
}

/// Arguments at which the functions change their way, and their neighbours.
fn ends() -> Vec<f64> {
    let ends = [
        0.0,
        5e-324,
        1e-310,
        1e-45,
        f64::from(f32::MIN_POSITIVE),
        f64::MIN_POSITIVE,
        2_f64.powi(-104),
        0.25,
        0.5,
        core::f64::consts::FRAC_1_SQRT_2,
        0.75,
        1.0,
        core::f64::consts::SQRT_2,
        2.0,
        22.0,
        44.0,
        88.7,
        103.9,
        709.78,
        745.13,
        1074.0,
        2e4,
        1e9,
        2_f64.powi(104),
        f64::from(f32::MAX),
        f64::MAX,
        f64::INFINITY,
        f64::NAN,
    ];
    ends.iter().flat_map(|x| [*x, x.next_up(), x.next_down()]).flat_map(|x| [x, -x]).collect()
}

/// Pairs of such arguments, and 200,000 of random ones of all sizes.
#[allow(clippy::cast_possible_truncation)] // a small number
fn pairs() -> Vec<[f64; 2]> {
    let mut stream = Stream::new(3, 0, Channel::Process);
    let mut drawn = || match stream.next_u64() % 5 {
        0 => f64::from_bits(stream.next_u64()),
        1 => (stream.uniform() - 0.5) * 60.0,
        2 => (stream.uniform() - 0.5) * 1600.0,
        3 => stream.uniform(),
        _ => (stream.uniform() - 0.5) * 2_f64.powi((80.0 * stream.uniform()) as i32 - 40),
    };
    let ends = ends();
    let of_ends = ends.iter().flat_map(|a| ends.iter().map(|b| [*a, *b]));
    of_ends.chain((0..200_000).map(|_| [drawn(), drawn()])).collect()
}

/// All results in one number (FNV-1a over words); every NaN counts as the same.
fn digest(values: impl Iterator<Item = f64>) -> u64 {
    values.fold(0xCBF2_9CE4_8422_2325, |hash, value| {
        let bits = if value.is_nan() { 0x7FF8 << 48 } else { value.to_bits() };
        (hash ^ bits).wrapping_mul(0x0100_0000_01B3)
    })
}

/// The bits of every function, which studies, exports and chips have in common, stay what they are.
#[test]
fn bits_stay() {
    macro_rules! digests {
        ($t:ident, $place:path, $pairs:expr) => {{
            use $place::{atan, atan2, cos, exp, ln, log2_of, log2_parts, powf, sin, tan, tanh};
            let pairs: Vec<[$t; 2]> = $pairs;
            let all = |f: fn($t, $t) -> $t| digest(pairs.iter().map(|&[x, p]| f(x, p).into()));
            [
                ("exp", all(|x, _| exp(x))),
                ("ln", all(|x, _| ln(x))),
                ("sin", all(|x, _| sin(x))),
                ("cos", all(|x, _| cos(x))),
                ("tan", all(|x, _| tan(x))),
                ("tanh", all(|x, _| tanh(x))),
                ("atan", all(|x, _| atan(x))),
                ("atan2", all(|y, x| atan2(y, x))),
                ("powf", all(|x, p| powf(x, p))),
                (
                    "log2",
                    all(|x, _| {
                        let (k, s) = log2_parts(x);
                        log2_of(k, s)
                    }),
                ),
            ]
        }};
    }
    let double = digests!(f64, elementary, pairs());
    #[allow(clippy::cast_possible_truncation)]
    let single =
        digests!(f32, elementary, pairs().iter().map(|pair| pair.map(|x| x as f32)).collect());
    assert_eq!(
        double,
        [
            ("exp", 0x1466_FFD3_E470_4D97),
            ("ln", 0x0931_1C26_710A_500C),
            ("sin", 0x13D7_8178_D481_B59A),
            ("cos", 0x7F4D_8FEC_EE6A_866A),
            ("tan", 0x476D_27DE_9FD4_ED3B),
            ("tanh", 0xC2CC_9E56_B248_EA14),
            ("atan", 0x411F_F60B_1930_32D5),
            ("atan2", 0x7478_9424_EAC7_AF3C),
            ("powf", 0x8383_8CD5_9BBB_20C0),
            ("log2", 0xD2D6_1E0B_4A34_C83B),
        ]
    );
    assert_eq!(
        single,
        [
            ("exp", 0xBFFF_D3D3_BA7B_0925),
            ("ln", 0x8885_9468_1A7B_0925),
            ("sin", 0x603A_56E1_1A7B_0925),
            ("cos", 0x8F6A_A810_3A7B_0925),
            ("tan", 0x2461_9A1E_FA7B_0925),
            ("tanh", 0xEF95_E3E7_BA7B_0925),
            ("atan", 0x490E_8384_9A7B_0925),
            ("atan2", 0x431D_63F7_FA7B_0925),
            ("powf", 0xA55E_D79F_DA7B_0925),
            ("log2", 0x51D2_9800_BA7B_0925),
        ]
    );
    let turns = pairs().into_iter().filter(|[u, _]| (0.0..1.0).contains(u)).flat_map(|[u, _]| {
        let (cos, sin) = turned(1.0, u);
        [cos, sin]
    });
    assert_eq!(digest(turns), 0x994A_0CFB_A661_B8F9);
}
