//! Random streams against independent generators and their distributions, and as a generator of `rand`.

use super::config;
use hgo_rs::noise::{Channel, Draw, Law, Noise, SecondOrderSections, Sine, Stream};
use proptest::prelude::*;
use rand_distr::{Distribution, Exp1, StandardNormal, Triangular};
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use rand_xoshiro::{SplitMix64, Xoshiro256PlusPlus};

proptest! {
    #![proptest_config(config(256))]

    #[test]
    fn the_generator_is_xoshiro256_plus_plus(s in prop::array::uniform4(1_u64..)) {
        let mut bytes = [0; 32];
        for (chunk, word) in bytes.chunks_exact_mut(8).zip(s) {
            chunk.copy_from_slice(&word.to_le_bytes());
        }
        let (mut ours, mut theirs) = (Stream::from_state(s), Xoshiro256PlusPlus::from_seed(bytes));
        for _ in 0..100 {
            prop_assert_eq!(ours.next_u64(), theirs.next_u64());
        }
    }

    /// base = mix(mix(mix(seed) ^ run) ^ channel), words mix(base + jφ): SplitMix64 throughout.
    #[test]
    fn a_stream_is_seeded_by_seed_run_and_channel(seed in any::<u64>(), run in any::<u64>()) {
        let mix = |z: u64| SplitMix64::from_seed(z.to_le_bytes()).next_u64();
        for (channel, number) in [(Channel::Measurement, 0), (Channel::Process, 1)] {
            let base = mix(mix(mix(seed) ^ run) ^ number);
            let mut splitter = SplitMix64::from_seed(base.to_le_bytes());
            let words = core::array::from_fn(|_| splitter.next_u64());
            let mut ours = Stream::new(seed, run, channel);
            prop_assert_eq!(ours, Stream::from_state(words));
            let mut theirs = Xoshiro256PlusPlus::seed_from_u64(base);
            for _ in 0..20 {
                prop_assert_eq!(ours.next_u64(), theirs.next_u64());
            }
        }
    }

    /// Words, half words and bytes through the traits of `rand`, from any seed; 0 throughout is no state.
    #[test]
    fn a_stream_is_a_generator_of_rand(
        seed in prop_oneof![Just([0; 32]), prop::array::uniform32(any::<u8>())],
        small in any::<u64>(),
        len in 0_usize..70,
    ) {
        prop_assert_eq!(Stream::from_seed([0; 32]), Stream::seed_from_u64(0));
        for (mut ours, mut theirs) in [
            (Stream::from_seed(seed), Xoshiro256PlusPlus::from_seed(seed)),
            (Stream::seed_from_u64(small), Xoshiro256PlusPlus::seed_from_u64(small)),
        ] {
            let (mut a, mut b) = ([0; 70], [0; 70]);
            for _ in 0..20 {
                prop_assert_eq!(Rng::next_u64(&mut ours), theirs.next_u64());
                prop_assert_eq!(ours.next_u32(), theirs.next_u32());
                ours.fill_bytes(&mut a[..len]);
                theirs.fill_bytes(&mut b[..len]);
                prop_assert_eq!(a, b);
            }
        }
    }

    #[test]
    fn numbers_are_made_from_53_bits(seed in any::<u64>()) {
        let mut ours = Stream::new(seed, 0, Channel::Measurement);
        let mut bits = ours;
        let two_53 = 9_007_199_254_740_992.0;
        let mut number = || (bits.next_u64() >> 11) as f64;
        prop_assert_eq!(ours.uniform(), number() / two_53);
        let (u1, u2) = ((number() + 1.0) / two_53, number() / two_53);
        let (radius, angle) = ((-2.0 * u1.ln()).sqrt(), core::f64::consts::TAU * u2);
        let (a, b) = ours.normal_pair();
        prop_assert!((a - radius * angle.cos()).abs() < 1e-14 * radius.max(1.0));
        prop_assert!((b - radius * angle.sin()).abs() < 1e-14 * radius.max(1.0));
        // one alone is the first of a pair
        let mut again = Stream::new(seed, 0, Channel::Measurement);
        again.uniform();
        prop_assert_eq!(again.normal(), a);
        prop_assert_eq!(again, ours);
    }
}

const DRAWS: u32 = if cfg!(debug_assertions) { 200_000 } else { 2_000_000 };

/// Means of the powers x, x², x³, x⁴.
fn moments(mut draw: impl FnMut() -> f64) -> [f64; 4] {
    let mut sums = [0.0; 4];
    for _ in 0..DRAWS {
        let x = draw();
        for (power, sum) in (1..).zip(&mut sums) {
            *sum += x.powi(power) / f64::from(DRAWS);
        }
    }
    sums
}

/// Sample moments lie within five standard deviations of the distribution's.
fn matches(ours: [f64; 4], exact: [f64; 8]) {
    for i in 0..4 {
        let deviation = ((exact[2 * i + 1] - exact[i].powi(2)) / f64::from(DRAWS)).sqrt();
        let off = (ours[i] - exact[i]).abs();
        assert!(off <= 5.0 * deviation, "moment {}: {} for {}", i + 1, ours[i], exact[i]);
    }
}

#[test]
fn moments_of_the_distributions() {
    let mut stream = Stream::new(11, 0, Channel::Measurement);
    let uniform = core::array::from_fn(|i| 1.0 / (i as f64 + 2.0));
    matches(moments(|| stream.uniform()), uniform);
    let normal = [0.0, 1.0, 0.0, 3.0, 0.0, 15.0, 0.0, 105.0];
    matches(moments(|| stream.normal()), normal);
    matches(moments(|| stream.normal_pair().1), normal);
    // the members of a pair, and the streams of two runs and two channels, are uncorrelated
    let bound = 5.0 / f64::from(DRAWS).sqrt();
    let [pair, ..] = moments(|| {
        let (a, b) = stream.normal_pair();
        a * b
    });
    assert!(pair.abs() < bound, "{pair}");
    for (run, channel) in [(1, Channel::Measurement), (0, Channel::Process)] {
        let (mut first, mut second) =
            (Stream::new(1, 0, Channel::Measurement), Stream::new(1, run, channel));
        let [product, ..] = moments(|| first.normal() * second.normal());
        assert!(product.abs() < bound, "run {run}, {channel:?}: {product}");
    }
}

/// Laws of `rand_distr` draw from a stream: moments E x, E x², … E x⁸ of theirs.
#[test]
fn moments_of_the_laws_of_rand_distr() {
    let mut stream = Stream::new(12, 0, Channel::Measurement);
    let normal = [0.0, 1.0, 0.0, 3.0, 0.0, 15.0, 0.0, 105.0];
    matches(moments(|| StandardNormal.sample(&mut stream)), normal);
    let exponential = [1.0, 2.0, 6.0, 24.0, 120.0, 720.0, 5040.0, 40320.0]; // k!
    matches(moments(|| Exp1.sample(&mut stream)), exponential);
    let triangular = Triangular::new(-1.0, 1.0, 0.0).unwrap(); // 2/((k + 1)(k + 2)), k even
    let even = [0.0, 1.0 / 6.0, 0.0, 1.0 / 15.0, 0.0, 1.0 / 28.0, 0.0, 1.0 / 45.0];
    matches(moments(|| triangular.sample(&mut stream)), even);
}

/// A stream whose first output is `word`, the rest of its state from `source`.
fn beginning_with(word: u64, source: &mut SplitMix64) -> Stream {
    let [s0, s1, s2] = core::array::from_fn(|_| source.next_u64());
    let s3 = word.wrapping_sub(s0).rotate_right(23).wrapping_sub(s0);
    let mut stream = Stream::from_state([s0, s1, s2, s3]);
    assert_eq!(stream.next_u64(), word);
    Stream::from_state([s0, s1, s2, s3])
}

/// A normal value beyond t in magnitude has u₁ < exp(−t²/2). Draws on the condition u₁ ≤ 2⁻ᶻ ≥ that
/// bound are beyond t with probability erfc(t/√2)·2ᶻ, and there are many.
#[test]
fn tails_of_the_normal_beyond_six_sigma() {
    let mut source = SplitMix64::seed_from_u64(6);
    // z, t, erfc(t/√2)
    for (zeros, t, probability) in [
        (25, 6.0, 1.973_175_290e-9),
        (26, 6.25, 4.104_526_850e-10),
        (27, 6.5, 8.032_001_167e-11),
        (31, 7.0, 2.559_625_088e-12),
        (37, 7.5, 6.381_783_346e-14),
    ] {
        let mut counts = [0_u32; 2];
        for _ in 0..DRAWS {
            let x = beginning_with(source.next_u64() >> zeros, &mut source).normal();
            counts[usize::from(x < 0.0)] += u32::from(x.abs() > t);
        }
        let p = 0.5 * probability * f64::from(zeros).exp2();
        let (mean, deviation) = (p * f64::from(DRAWS), (p * (1.0 - p) * f64::from(DRAWS)).sqrt());
        for count in counts {
            let off = (f64::from(count) - mean) / deviation;
            assert!(off.abs() < 4.0, "beyond {t}: {count} for {mean}, {off} standard deviations");
        }
    }
}

/// The smallest u₁, 2⁻⁵³, is drawn where s₀ + s₃ = 0 = s₀; s₁ then decides on the angle.
#[test]
fn the_normal_reaches_the_radius_of_53_bits() {
    let farthest = (106.0 * core::f64::consts::LN_2).sqrt(); // √(−2 ln 2⁻⁵³) = 8.57
    let high = Stream::from_state([0, 1, 0, 0]).normal();
    let low = Stream::from_state([0, 1 << 40, 0, 0]).normal();
    assert!((high - farthest).abs() < 1e-14, "{high}");
    assert!((low + farthest).abs() < 1e-9, "{low}");
    // and u₁ = 1 gives 0, not a NaN
    let nothing = beginning_with(u64::MAX, &mut SplitMix64::seed_from_u64(1)).normal();
    assert_eq!(nothing, 0.0);
}

#[test]
fn noise_signals() {
    let mut stream = Stream::new(1, 2, Channel::Measurement);
    let mut twin = stream;
    let quiet = Noise { draw: Draw::None, hold: 1, sines: &[] };
    let uniform = Noise { draw: Draw::Uniform { low: -0.5, high: 1.5 }, ..quiet };
    let normal = Noise { draw: Draw::Normal { mean: 0.2, std: 3.0 }, ..quiet };
    assert_eq!(quiet.fresh(&mut stream, 0), 0.0);
    assert_eq!(uniform.fresh(&mut stream, 0), -0.5 + 2.0 * twin.uniform());
    assert_eq!(normal.fresh(&mut stream, 0), 0.2 + 3.0 * twin.normal());
    let law = Law::StudentT { nu: 4.0 };
    let tails = Noise { draw: Draw::Law { law, mean: 0.2, scale: 3.0 }, ..quiet };
    assert_eq!(tails.fresh(&mut stream, 0), 0.2 + 3.0 * law.draw(&mut twin));
    assert_eq!(stream, twin);
    let recorded = Noise { draw: Draw::Samples(&[1.0, 2.0]), hold: 3, sines: &[] };
    let values: Vec<f64> = (0..8).map(|k| recorded.fresh(&mut stream, k)).collect();
    assert_eq!(values, [1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 0.0, 0.0]);
    let sines = [
        Sine { amplitude: 2.0, omega: 3.0, phase: 0.1 },
        Sine { amplitude: 0.5, omega: 7.0, phase: -1.0 },
    ];
    let tones = Noise { sines: &sines, ..quiet };
    let (t, expected) = (0.3, 2.0 * 1.0_f64.sin() + 0.5 * 1.1_f64.sin());
    assert!((tones.sines(t) - expected).abs() < 1e-14);
}

/// (1 − ρz⁻¹ cos θ)/(1 − 2ρz⁻¹ cos θ + ρ²z⁻²) has the impulse response ρᵏ cos kθ; two such
/// sections in a row convolve theirs.
#[test]
fn second_order_sections_have_their_impulse_response() {
    let section =
        |rho: f64, theta: f64| [1.0, -rho * theta.cos(), 0.0, -2.0 * rho * theta.cos(), rho * rho];
    let response = |rho: f64, theta: f64, k: i32| rho.powi(k) * (f64::from(k) * theta).cos();
    let (first, second) = ((0.9, 0.4), (0.7, 1.3));
    let mut one = SecondOrderSections::new([section(first.0, first.1)]);
    let mut two =
        SecondOrderSections::new([section(first.0, first.1), section(second.0, second.1)]);
    for k in 0..40 {
        let input = if k == 0 { 1.0 } else { 0.0 };
        assert!((one.filter(input) - response(first.0, first.1, k)).abs() < 1e-13);
        let convolved: f64 = (0..=k)
            .map(|j| response(first.0, first.1, j) * response(second.0, second.1, k - j))
            .sum();
        assert!((two.filter(input) - convolved).abs() < 1e-13, "k = {k}");
    }
}
