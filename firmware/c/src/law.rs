//! From a C configuration to an estimator of the core. Nothing here is unsafe.

use hgo_rs::error::{DesignError, require};
use hgo_rs::nalgebra::SVector;
use hgo_rs::observer::{Causal, ContinuousLaw, CurrentState, Timing};
use hgo_rs::observers::LowPower;
use hgo_rs::polynomial::{euler_current_limit, euler_limit, low_power_polynomial};
use hgo_rs::prelude::*;

/// Standard observer with a fixed gain.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct StandardConfig<T> {
    /// k_1 ... k_n, 0 beyond n; s^n + k_1 s^(n-1) + ... + k_n must be stable
    pub k: [T; 5],
    /// gain [1/s], > 0
    pub ell: T,
    /// longest step [s], > 0: at most step_limit, or predict_limit where predict is called
    pub dt_max: T,
}

/// Standard observer with a gain r >= 1 that moves: adaptive, or with a dead zone.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct AdaptiveConfig<T> {
    /// k_1 ... k_n, 0 beyond n; s^n + k_1 s^(n-1) + ... + k_n must be stable
    pub k: [T; 5],
    /// speed of the gain [1/s per squared unit of y], > 0
    pub p1: T,
    /// squared output error [squared unit of y] beyond which the gain grows, > 0
    pub p2: T,
    /// exponent, between 0 and 1/2
    pub b: T,
    /// longest step at r = 1 [s], > 0: at most step_limit, or predict_limit where predict is called;
    /// at r it is dt_max/r
    pub dt_max: T,
}

/// Low-power observer with a fixed gain.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct LowPowerConfig<T> {
    /// alpha_1 ... alpha_n; 0 beyond n
    pub alpha: [T; 5],
    /// beta_1 ... beta_(n-1); 0 beyond n - 1
    pub beta: [T; 4],
    /// gain [1/s], > 0
    pub ell: T,
    /// longest step [s], > 0: at most step_limit, or predict_limit where predict is called
    pub dt_max: T,
}

/// Peaking-free observer with a fixed gain.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct PeakingFreeConfig<T> {
    /// alpha_1 ... alpha_n; 0 beyond n
    pub alpha: [T; 5],
    /// beta_1 ... beta_(n-1); 0 beyond n - 1
    pub beta: [T; 4],
    /// bounds of |x_2| ... |x_n| [unit of the state], > 0; 0 beyond n - 1
    pub saturation: [T; 4],
    /// gain [1/s], > 0
    pub ell: T,
    /// longest step [s], > 0: at most step_limit, or predict_limit where predict is called
    pub dt_max: T,
}

/// A model whose φ the caller computes before the step and hands over as the input.
#[derive(Clone, Copy)]
pub struct Given;

impl<T: Scalar, const N: usize> Model<T, N, 1> for Given {
    #[inline(always)]
    fn f_hat(&self, _: T, _: &SVector<T, N>, phi: &SVector<T, 1>) -> SVector<T, N> {
        last(phi.x)
    }
}

impl<T: Scalar, const N: usize> PhaseVariable<T, N, 1> for Given {
    #[inline(always)]
    fn phi(&self, _: T, _: &SVector<T, N>, phi: &SVector<T, 1>) -> T {
        phi.x
    }
}

/// A law under forward Euler that holds its estimate where φ is not finite: the papers' recursion, or
/// (`CAUSAL`) the law with current timing. One memory serves both.
#[derive(Clone, Copy)]
pub struct Guarded<L, const CAUSAL: bool>(Current<L, Euler>);

impl<L: Copy> Guarded<L, true> {
    /// The papers' recursion of the same law.
    #[inline(always)]
    pub fn recursion(&self) -> Guarded<L, false> {
        Guarded(self.0)
    }
}

impl<T, L, const CAUSAL: bool> Observer<T> for Guarded<L, CAUSAL>
where
    T: Scalar,
    L: ContinuousLaw<T, Input = SVector<T, 1>>,
{
    type State = CurrentState<T, L::State>;
    type Measurement = T;
    type Input = SVector<T, 1>;
    const TIMING: Timing = if CAUSAL { Timing::Current } else { Timing::Predictor };
    const ESTIMATED: usize = L::ESTIMATED;

    #[inline(always)]
    fn initial(&self) -> Self::State {
        self.0.initial()
    }

    #[inline(always)]
    fn correct(&self, z: &mut Self::State, y: &T, t: T) -> Status {
        if CAUSAL { self.0.correct(z, y, t) } else { Status::of(y) }
    }

    #[inline(always)]
    fn advance(&self, z: &mut Self::State, y: &T, phi: &SVector<T, 1>, t: T, dt: T) -> Status {
        if !phi.x.is_finite() {
            return Status::ModelUndefined;
        }
        if CAUSAL {
            return self.0.advance(z, y, phi, t, dt);
        }
        let Current { law, scheme } = self.0;
        z.elapsed = T::ZERO; // the sample was used for the period: no correction is left
        Discretised { law, scheme }.advance(&mut z.law, y, phi, t, dt)
    }

    #[inline(always)]
    fn held(&self, z: &Self::State, dt: T) -> Self::State {
        if CAUSAL { self.0.held(z, dt) } else { CurrentState { elapsed: T::ZERO, ..*z } }
    }

    #[inline(always)]
    fn speed(&self, z: &Self::State) -> T {
        self.0.speed(z)
    }

    #[inline(always)]
    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [T] {
        self.0.estimate(z)
    }

    #[inline(always)]
    fn innovation(&self, t: T, z: &Self::State, y: &T, phi: &SVector<T, 1>) -> T {
        self.0.innovation(t, z, y, phi)
    }
}

impl<T, L> Causal<T> for Guarded<L, true>
where
    T: Scalar,
    L: ContinuousLaw<T, Input = SVector<T, 1>>,
{
}

/// What a C state's estimator remembers: the law's memory, and the time that a correction is for.
pub type Remembered<T, L> = CurrentState<T, <L as ContinuousLaw<T>>::State>;

/// A law that C can configure.
pub trait Law<T: Scalar>: ContinuousLaw<T, Input = SVector<T, 1>> {
    /// Order n: the first n numbers of the memory are x̂.
    const ORDER: usize;
    /// Where in the memory a gain r ≥ 1 stands, if it moves.
    const GAIN: Option<usize>;
    /// As C gives it.
    type Config: Copy;
    /// The law.
    fn law(config: &Self::Config) -> Result<Self, DesignError>;
    /// The longest step as configured.
    fn dt_max(config: &Self::Config) -> T;
    /// Its stability limit under forward Euler, of coefficients that make a law.
    fn euler_limit(config: &Self::Config) -> T;
    /// The same of prediction and correction by forward Euler.
    fn causal_limit(config: &Self::Config) -> T;

    /// An estimator at x̂ = 0.
    fn estimator(config: &Self::Config) -> Result<Estimator<T, Guarded<Self, true>>, DesignError> {
        let (law, dt_max) = (Self::law(config)?, Self::dt_max(config));
        let allowed = "it must be finite and > 0; step_limit computes the largest";
        require("dt_max", dt_max, dt_max.is_finite() && dt_max > T::ZERO, allowed)?;
        Estimator::new(Guarded(Current { law, scheme: Euler }), dt_max)
    }

    /// The largest `dt_max`, by one of the two limits.
    fn limit(config: &Self::Config, computed: fn(&Self::Config) -> T) -> Result<T, DesignError> {
        Self::law(config)?;
        let limit = computed(config);
        let allowed = "the computed limit is not finite and > 0; scale the coefficients";
        require("dt_max", limit, limit.is_finite() && limit > T::ZERO, allowed)
    }

    /// The memory that starts with `numbers`: the rest is 0, and r is 1.
    fn memory(numbers: &[T]) -> Remembered<T, Self> {
        let (mut z, mut place) = (Remembered::<T, Self>::zero(), 0);
        z.visit_mut(&mut |entry| {
            let start = if Some(place) == Self::GAIN { T::ONE } else { T::ZERO };
            *entry = numbers.get(place).copied().unwrap_or(start);
            place += 1;
        });
        z
    }

    /// Whether a memory that starts with `numbers` is one of this law's.
    fn admits(numbers: &[T]) -> bool {
        let gain = Self::GAIN.and_then(|place| numbers.get(place));
        let elapsed = numbers.get(Self::State::LEN);
        numbers.iter().all(|x| x.is_finite())
            && gain.is_none_or(|r| *r >= T::ONE)
            && elapsed.is_none_or(|time| *time >= T::ZERO)
    }
}

/// The first `count` of the numbers in an array of a configuration; the others must be 0.
fn head<T: Scalar, const N: usize>(
    name: &'static str,
    numbers: &[T],
    count: usize,
) -> Result<[T; N], DesignError> {
    for beyond in numbers.iter().skip(count) {
        let allowed = "entries beyond the observer's order must be 0";
        require(name, *beyond, *beyond == T::ZERO, allowed)?;
    }
    let entry = |i| numbers.iter().take(count).nth(i).copied().unwrap_or(T::ZERO);
    Ok(core::array::from_fn(entry))
}

/// Degree of the characteristic polynomial of a low-power law of order 5.
const DEGREE: usize = 9;

/// What the limits of a low-power law of order N need. In double precision, as its products do.
struct LowPowerBlocks<const N: usize> {
    alpha: [f64; 5],
    beta: [f64; 4],
}

impl<const N: usize> LowPowerBlocks<N> {
    fn new<T: Scalar>(alpha: &[T; 5], beta: &[T; 4]) -> Self {
        Self { alpha: alpha.map(T::to_f64), beta: beta.map(T::to_f64) }
    }

    /// c of all blocks together.
    fn whole(&self, limit: impl Fn(&[f64], &[f64]) -> f64) -> f64 {
        let Self { mut alpha, mut beta } = *self;
        let (mut p, mut d) = ([0.0; DEGREE], [0.0; DEGREE]);
        low_power_polynomial(alpha.get(..N).unwrap_or(&[]), &beta, &mut p);
        (alpha[0], beta[0]) = (0.0, 0.0);
        low_power_polynomial(alpha.get(..N).unwrap_or(&[]), &beta, &mut d);
        limit(p.get(..2 * N - 1).unwrap_or(&[]), d.get(..2 * N - 1).unwrap_or(&[]))
    }

    /// The least c of the blocks that clips have cut off from the next ones: x̂' = η + α e, η' = β e.
    /// The first one alone has a sample.
    fn alone(&self, limit: impl Fn(&[f64], &[f64]) -> f64) -> f64 {
        let mut least = limit(&[self.alpha[0], self.beta[0]], &[]);
        for (i, a) in self.alpha.iter().enumerate().take(N).skip(1) {
            let block = [*a, self.beta.get(i).copied().unwrap_or(0.0)];
            let length = if i + 1 < N { 2 } else { 1 };
            least = least.min(euler_limit(block.get(..length).unwrap_or(&[])));
        }
        least
    }
}

/// Forward Euler's c, whatever the law is without a sample.
fn whole_limit(p: &[f64], _: &[f64]) -> f64 {
    euler_limit(p)
}

/// Standard observer, fixed gain.
pub type Standard<T, const N: usize> = StandardObserver<T, ConstantGain<T>, Given, N, 1>;

impl<T: Scalar, const N: usize> Law<T> for Standard<T, N> {
    const ORDER: usize = N;
    const GAIN: Option<usize> = None;
    type Config = StandardConfig<T>;
    fn law(c: &Self::Config) -> Result<Self, DesignError> {
        StandardObserver::new(head("k", &c.k, N)?, ConstantGain::new(c.ell)?, Given)
    }
    fn dt_max(c: &Self::Config) -> T {
        c.dt_max
    }
    fn euler_limit(c: &Self::Config) -> T {
        euler_limit(c.k.get(..N).unwrap_or(&[])) / c.ell
    }
    fn causal_limit(c: &Self::Config) -> T {
        euler_current_limit(c.k.get(..N).unwrap_or(&[]), &[]) / c.ell
    }
}

macro_rules! standard_with_moving_gain {
    ($(#[$doc:meta])* $name:ident, $gain:ident) => {
        $(#[$doc])*
        pub type $name<T, const N: usize> = StandardObserver<T, $gain<T>, Given, N, 1>;

        impl<T: Scalar, const N: usize> Law<T> for $name<T, N> {
            const ORDER: usize = N;
            const GAIN: Option<usize> = Some(N);
            type Config = AdaptiveConfig<T>;
            fn law(c: &Self::Config) -> Result<Self, DesignError> {
                StandardObserver::new(head("k", &c.k, N)?, $gain::new(c.p1, c.p2, c.b)?, Given)
            }
            fn dt_max(c: &Self::Config) -> T {
                c.dt_max
            }
            fn euler_limit(c: &Self::Config) -> T {
                euler_limit(c.k.get(..N).unwrap_or(&[]))
            }
            fn causal_limit(c: &Self::Config) -> T {
                euler_current_limit(c.k.get(..N).unwrap_or(&[]), &[])
            }
        }
    };
}

standard_with_moving_gain! {
    /// Standard observer, adaptive gain.
    Adaptive, AdaptiveGain
}
standard_with_moving_gain! {
    /// Standard observer, gain with a dead zone.
    DeadZone, DeadZoneGain
}

/// Low-power observer, fixed gain.
pub type LowPowerFixed<T, const N: usize> = LowPowerObserver<T, ConstantGain<T>, Given, N, 1>;

impl<T: Scalar, const N: usize> Law<T> for LowPowerFixed<T, N> {
    const ORDER: usize = N;
    const GAIN: Option<usize> = None;
    type Config = LowPowerConfig<T>;
    fn law(c: &Self::Config) -> Result<Self, DesignError> {
        let (alpha, beta) = (head("alpha", &c.alpha, N)?, head("beta", &c.beta, N - 1)?);
        LowPower::new(alpha, beta, ConstantGain::new(c.ell)?, Given, NoSaturation)
    }
    fn dt_max(c: &Self::Config) -> T {
        c.dt_max
    }
    fn euler_limit(c: &Self::Config) -> T {
        T::from_f64(LowPowerBlocks::<N>::new(&c.alpha, &c.beta).whole(whole_limit)) / c.ell
    }
    fn causal_limit(c: &Self::Config) -> T {
        T::from_f64(LowPowerBlocks::<N>::new(&c.alpha, &c.beta).whole(euler_current_limit)) / c.ell
    }
}

/// Peaking-free observer with hard clips, fixed gain.
pub type PeakingFree<T, const N: usize> =
    PeakingFreeObserver<T, ConstantGain<T>, Given, HardClip<T, N>, N, 1>;

impl<T: Scalar, const N: usize> Law<T> for PeakingFree<T, N> {
    const ORDER: usize = N;
    const GAIN: Option<usize> = None;
    type Config = PeakingFreeConfig<T>;
    fn law(c: &Self::Config) -> Result<Self, DesignError> {
        let (alpha, beta) = (head("alpha", &c.alpha, N)?, head("beta", &c.beta, N - 1)?);
        let levels = HardClip::new(head("saturation", &c.saturation, N - 1)?)?;
        LowPower::new(alpha, beta, ConstantGain::new(c.ell)?, Given, levels)
    }
    fn dt_max(c: &Self::Config) -> T {
        c.dt_max
    }
    fn euler_limit(c: &Self::Config) -> T {
        // as in Python: of the whole, and of every block alone
        let blocks = LowPowerBlocks::<N>::new(&c.alpha, &c.beta);
        T::from_f64(blocks.whole(whole_limit).min(blocks.alone(whole_limit))) / c.ell
    }
    fn causal_limit(c: &Self::Config) -> T {
        let blocks = LowPowerBlocks::<N>::new(&c.alpha, &c.beta);
        T::from_f64(blocks.whole(euler_current_limit).min(blocks.alone(euler_current_limit)))
            / c.ell
    }
}
