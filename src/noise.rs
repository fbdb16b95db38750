//! Floor 1. Random streams and noise signals.
//!
//! Run i of a study draws from streams that depend on (seed, i) alone: never on the thread, the
//! chunk or what else runs beside it.
//!
//! A [`Stream`] is a generator of the crate `rand`, so every law of `rand_distr` draws from it. Here
//! measurement noise with heavy tails, drawn ahead for one run:
//!
//! ```
//! use hgo_rs::noise::{Channel, Draw, Noise, Stream};
//! use rand_distr::{Distribution, StudentT};
//!
//! let mut stream = Stream::new(7, 0, Channel::Measurement);
//! let law = StudentT::new(3.0)?;
//! let values: Vec<f64> = law.map(|v| 0.01 * v).sample_iter(&mut stream).take(1000).collect();
//! let noise = Noise { draw: Draw::Samples(&values), hold: 1, sines: &[] };
//! assert_eq!(noise.fresh(&mut stream, 2), values[2]);
//! # Ok::<(), rand_distr::ChiSquaredError>(())
//! ```

use crate::Scalar;
use crate::elementary::{Bits, Float, exp, log2_of, log2_parts, sin_of_turns};
use core::convert::Infallible;
use core::f64::consts::LN_2;
use rand::rand_core::utils::fill_bytes_via_next_word;
use rand::{SeedableRng, TryRng};

const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;

/// One step of the `SplitMix64` generator from state z: a strong mixing of 64 bits.
#[inline(always)]
const fn mix(z: u64) -> u64 {
    let z = z.wrapping_add(GOLDEN);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// What a stream is for. Each purpose has a stream of its own, so that adding process noise does
/// not change the measurement noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Channel {
    /// Measurement noise.
    Measurement = 0,
    /// Process noise.
    Process = 1,
}

/// A stream of random numbers: the generator xoshiro256++ of Blackman and Vigna.
///
/// It is an infallible generator of the crate `rand` (`Rng`, `SeedableRng`), whose words are those of
/// [`Stream::next_u64`] in order. A seed is the four words of its state, little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Stream {
    s: [u64; 4],
}

crate::error::through_constructor! {
    [] Stream<>: stream => { s: [u64; 4] = stream.s }
    => crate::error::require("s", 0.0, s != [0; 4], "a generator's state must not be 0 throughout")
        .map(|_| Self { s })
}

impl Stream {
    /// The stream of run `run` under `seed` for `channel`.
    pub const fn new(seed: u64, run: u64, channel: Channel) -> Self {
        Self::spread(mix(mix(mix(seed) ^ run) ^ channel as u64))
    }

    /// The state that `SplitMix64` makes of 64 bits.
    const fn spread(base: u64) -> Self {
        Self {
            s: [
                mix(base),
                mix(base.wrapping_add(GOLDEN)),
                mix(base.wrapping_add(GOLDEN.wrapping_mul(2))),
                mix(base.wrapping_add(GOLDEN.wrapping_mul(3))),
            ],
        }
    }

    /// From the generator's own 256 bits of state, which must not all be 0.
    pub const fn from_state(s: [u64; 4]) -> Self {
        Self { s }
    }

    /// The generator's 256 bits of state.
    pub const fn state(&self) -> [u64; 4] {
        self.s
    }

    /// The next 64 random bits.
    #[inline(always)]
    pub fn next_u64(&mut self) -> u64 {
        let (bits, state) = advanced(self.s);
        self.s = state;
        bits
    }

    /// Uniform on [0, 1), 53 bits.
    #[inline(always)]
    pub fn uniform(&mut self) -> f64 {
        fraction(self.next_u64())
    }

    /// Two independent standard normal values (Box and Muller).
    #[inline(always)]
    pub fn normal_pair(&mut self) -> (f64, f64) {
        let radius = radius_of(radius_parts(self.uniform()));
        turned(radius, self.uniform())
    }

    /// A standard normal value: the first of a pair, the second is not kept.
    #[inline(always)]
    pub fn normal(&mut self) -> f64 {
        self.normal_pair().0
    }
}

/// 64 random bits of a generator's state, and its next state.
#[inline(always)]
pub fn advanced<B: Bits>([s0, s1, s2, s3]: [B; 4]) -> (B, [B; 4]) {
    let turned = |bits: B, by: u32| (bits << by) | (bits >> (64 - by));
    let result = turned(s0.wrapping_add(s3), 23).wrapping_add(s0);
    let s2 = s2 ^ s0;
    let s3 = s3 ^ s1;
    (result, [s0 ^ s3, s1 ^ s2, s2 ^ (s1 << 17), turned(s3, 45)])
}

impl TryRng for Stream {
    type Error = Infallible;

    /// The upper half of the next word: the lowest bits are the weaker ones.
    #[inline(always)]
    fn try_next_u32(&mut self) -> Result<u32, Infallible> {
        Ok((self.next_u64() >> 32) as u32)
    }

    #[inline(always)]
    fn try_next_u64(&mut self) -> Result<u64, Infallible> {
        Ok(self.next_u64())
    }

    #[inline]
    fn try_fill_bytes(&mut self, dst: &mut [u8]) -> Result<(), Infallible> {
        fill_bytes_via_next_word(dst, || self.try_next_u64())
    }
}

impl SeedableRng for Stream {
    type Seed = [u8; 32];

    /// The state whose words the seed holds; from 0 throughout, which no state may be, that of
    /// `seed_from_u64(0)`.
    fn from_seed(seed: [u8; 32]) -> Self {
        let mut s = [0; 4];
        for (word, bytes) in s.iter_mut().zip(seed.as_chunks().0) {
            *word = u64::from_le_bytes(*bytes);
        }
        if s == [0; 4] { Self::spread(0) } else { Self::from_state(s) }
    }

    /// As Blackman and Vigna advise: the state that `SplitMix64` makes of 64 bits.
    fn seed_from_u64(state: u64) -> Self {
        Self::spread(state)
    }
}

/// What [`radius_of`] makes the radius √(−2 ln(u + 2⁻⁵³)) of a normal pair of, u in [0, 1).
#[inline(always)]
pub fn radius_parts<T: Float<Precision = f64>>(u: T) -> (T, T) {
    log2_parts(u + T::of(LOWEST)) // in (0, 1], exact
}

/// The radius of a normal pair.
#[inline(always)]
pub fn radius_of<T: Float<Precision = f64>>((k, s): (T, T)) -> T {
    (T::of(-2.0 * LN_2) * log2_of(k, s)).sqrt()
}

/// r cos 2πu and r sin 2πu, u in [0, 1). The turn is counted from ½ and folded at the quarters, both
/// exactly, as far as the sine of a quarter: what is near 0 keeps its relative precision.
#[inline(always)]
pub fn turned<T: Float<Precision = f64>>(radius: T, u: T) -> (T, T) {
    let quarter = T::short(0.25);
    let turn = u - T::short(0.5);
    let folded = turn.abs() - quarter;
    let other = (quarter - folded.abs()).copysign(-turn);
    (radius * sin_of_turns(folded), radius * sin_of_turns(other))
}

/// Student's t with ν degrees of freedom, of u and v in [0, 1): the radius r of a normal pair becomes
/// √(ν(e^(r²/ν) − 1)) (Bailey, Math. Comp. 62 (1994), (2): polar, his rejection replaced by sine and cosine).
#[inline(always)]
pub fn student_t<T: Float<Precision = f64>>(u: T, v: T, nu: T) -> T {
    let radius = radius_of(radius_parts(u));
    let grown = exp(radius * radius / nu) - T::short(1.0);
    turned((nu * grown).sqrt(), v).0
}

/// Laplace's law of scale 1, of u and v in [0, 1): r²/2 is exponential, v chooses the sign.
#[inline(always)]
pub fn laplace<T: Float<Precision = f64>>(u: T, v: T) -> T {
    let radius = radius_of(radius_parts(u));
    (T::short(0.5) * radius * radius).copysign(v - T::short(0.5))
}

/// A standard normal value of u and v, `ratio` times as large where w is below a probability; u, v, w in
/// [0, 1).
#[inline(always)]
pub fn impulsive<T: Float<Precision = f64>>([u, v, w]: [T; 3], probability: T, ratio: T) -> T {
    let normal = turned(radius_of(radius_parts(u)), v).0;
    T::select(w.less(probability), ratio * normal, normal)
}

/// 2⁻⁵³.
const LOWEST: f64 = 1.0 / 9_007_199_254_740_992.0;

/// The highest 53 bits as a fraction of 2⁵³, exactly: the upper 21 put below the point of 2³¹, the
/// lower 32 below that of ½, both then taken off. (Vectors of integers and floats convert only on
/// some processors.)
#[inline(always)]
pub fn fraction<T: Float<Precision = f64>>(bits: T::Bits) -> T {
    let (upper, lower) = (T::of(2_147_483_648.0), T::short(0.5));
    let high = T::from_bits(upper.to_bits() | (bits >> 43));
    let low = T::from_bits(lower.to_bits() | ((bits >> 11) & T::Bits::of(0xFFFF_FFFF)));
    (high - (upper + lower)) + low
}

/// A sine A sin(ωt + φ).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sine<T> {
    /// Amplitude A.
    pub amplitude: T,
    /// Angular frequency ω in rad/s.
    pub omega: T,
    /// Phase φ in rad.
    pub phase: T,
}

impl<T: Scalar> Sine<T> {
    /// Σ A sin(ωt + φ).
    #[inline(always)]
    pub fn sum(sines: &[Self], t: T) -> T {
        let mut sum = T::NEG_ZERO; // which changes no bit of what it is added to
        for sine in sines {
            sum += sine.amplitude * (sine.omega * t + sine.phase).sin();
        }
        sum
    }
}

/// A law with tails that are heavier than the normal law's, of mean 0 and scale 1. Every draw takes as many
/// numbers of the stream as the next.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Law {
    /// Student's t, see [`student_t`].
    StudentT {
        /// Degrees of freedom ν, ½ to 10⁶.
        nu: f64,
    },
    /// Density e^(−|v|)/2, see [`laplace`].
    Laplace,
    /// A mixture of two normal laws: impulses among noise of standard deviation 1, see [`impulsive`].
    Impulsive {
        /// Of an impulse.
        probability: f64,
        /// Standard deviation of an impulse.
        ratio: f64,
    },
}

impl Law {
    /// With parameters that are allowed.
    ///
    /// # Errors
    /// ν below ½, where the tails leave what a number holds, or above 10⁶, where the law is normal; a
    /// probability outside of [0, 1]; a ratio below 0.
    pub fn checked(self) -> Result<Self, crate::error::DesignError> {
        use crate::error::{finite, require};
        match self {
            Self::StudentT { nu } => {
                require("nu", nu, (0.5..=1e6).contains(&nu), "it must be in [0.5, 1e6]")?;
            }
            Self::Laplace => {}
            Self::Impulsive { probability, ratio } => {
                let is_one = (0.0..=1.0).contains(&probability);
                require("probability", probability, is_one, "it must be in [0, 1]")?;
                finite("ratio", ratio)?;
                require("ratio", ratio, ratio >= 0.0, "it must be at least 0")?;
            }
        }
        Ok(self)
    }

    /// The next draw.
    #[inline(always)]
    pub fn draw(self, stream: &mut Stream) -> f64 {
        let (u, v) = (stream.uniform(), stream.uniform());
        match self {
            Self::StudentT { nu } => student_t(u, v, nu),
            Self::Laplace => laplace(u, v),
            Self::Impulsive { probability, ratio } => {
                impulsive([u, v, stream.uniform()], probability, ratio)
            }
        }
    }
}

/// The part of a noise that is drawn at an instant and held. It borrows its samples: with feature
/// `serde` it can be written, not read.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Draw<'a, T> {
    /// Always 0.
    None,
    /// Uniform on [low, high).
    Uniform {
        /// Lower end.
        low: T,
        /// Upper end.
        high: T,
    },
    /// Normal.
    Normal {
        /// Mean.
        mean: T,
        /// Standard deviation.
        std: T,
    },
    /// Of heavy tails.
    Law {
        /// Its law.
        law: Law,
        /// Mean.
        mean: T,
        /// What a draw of the law is multiplied by.
        scale: T,
    },
    /// A recorded (or filtered) sequence, one value a draw; 0 after its end.
    Samples(&'a [T]),
}

/// Measurement noise: draws held over `hold` steps, plus sines in continuous time.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Noise<'a, T> {
    /// What is drawn.
    pub draw: Draw<'a, T>,
    /// Steps for which a draw is held, ≥ 1.
    pub hold: u64,
    /// Sines added to it.
    pub sines: &'a [Sine<T>],
}

impl<T: Scalar> Noise<'_, T> {
    /// A fresh draw for step k.
    #[inline(always)]
    pub fn fresh(&self, stream: &mut Stream, k: u64) -> T {
        match self.draw {
            Draw::None => T::NEG_ZERO,
            Draw::Uniform { low, high } => low + (high - low) * T::from_f64(stream.uniform()),
            Draw::Normal { mean, std } => mean + std * T::from_f64(stream.normal()),
            Draw::Law { law, mean, scale } => mean + scale * T::from_f64(law.draw(stream)),
            Draw::Samples(values) => self.recorded(values, k),
        }
    }

    /// The value of a sequence that holds at step k.
    #[inline(always)]
    fn recorded(&self, values: &[T], k: u64) -> T {
        let index = usize::try_from(k / self.hold.max(1)).unwrap_or(usize::MAX);
        values.get(index).copied().unwrap_or(T::ZERO)
    }

    /// Σ A sin(ωt + φ).
    #[inline(always)]
    pub fn sines(&self, t: T) -> T {
        Sine::sum(self.sines, t)
    }
}

/// A cascade of S second-order sections (biquads) that colours a sequence, transposed form II.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct SecondOrderSections<T, const S: usize> {
    /// b₀, b₁, b₂, a₁, a₂ of every section, a₀ = 1.
    pub coefficients: [[T; 5]; S],
    memory: [[T; 2]; S],
}

crate::error::through_constructor! {
    [T: Scalar, const S: usize]
    SecondOrderSections<T, S>: filter => {
        coefficients: [[T; 5]; S] = filter.coefficients,
        memory: [[T; 2]; S] = filter.memory,
    }
    => Ok(Self { coefficients, memory })
}

impl<T: Scalar, const S: usize> SecondOrderSections<T, S> {
    /// A filter at rest.
    pub fn new(coefficients: [[T; 5]; S]) -> Self {
        Self { coefficients, memory: [[T::ZERO; 2]; S] }
    }

    /// The next filtered value.
    #[inline(always)]
    pub fn filter(&mut self, input: T) -> T {
        let mut signal = input;
        for ([b0, b1, b2, a1, a2], [m1, m2]) in self.coefficients.iter().zip(&mut self.memory) {
            let output = *b0 * signal + *m1;
            *m1 = *b1 * signal - *a1 * output + *m2;
            *m2 = *b2 * signal - *a2 * output;
            signal = output;
        }
        signal
    }
}
