//! The papers' numbers, one case an observer.

use crate::{Case, Instrument, Scenario, State, Watched};
use hgo_rs::injection::Injected;
use hgo_rs::model::StochasticIntegrator;
use hgo_rs::models::{
    Correction, Crackle, Diffusion, Lee, SanfelicePraly, Ship, ShipState, VanDerPol,
};
use hgo_rs::nalgebra::{SMatrix, SVector, Vector2, Vector3};
use hgo_rs::observer::{Current, CurrentState};
use hgo_rs::observers::{
    CascadeObserver, CopyState, FilteredObserver, LimitedGain, ModifiedState, ReducedChainObserver,
    StandardState, WindowObserver,
};
use hgo_rs::prelude::*;

/// A case: its name and order, observer and plant, and the three functions of [`Case`].
macro_rules! case {
    (
        $(#[$doc:meta])*
        $case:ident = $name:literal, $n:literal;
        observer: $observer:ty = |$number:ident| $design:expr;
        plant: $plant:ty = || $scenario:expr;
        schedule: |$clock:ident| $schedule:expr;
    ) => {
        $(#[$doc])*
        pub struct $case;

        impl<T: Scalar> Case<T> for $case {
            const SYMBOL: &'static str = stringify!($case);
            const NAME: &'static str = $name;
            const N: usize = $n;
            type Observer = $observer;
            type Plant = $plant;
            fn observer($number: impl Fn(f64) -> T) -> Result<Self::Observer, DesignError> {
                $design
            }
            fn scenario() -> Result<Scenario<T, Self::Plant, State<T, Self>>, DesignError> {
                $scenario
            }
            fn schedule<$clock: Instrument<T>>() -> Result<impl Schedule<T>, DesignError> {
                $schedule
            }
        }
    };
}

pub(crate) use case;

/// The literature's Runge-Kutta step of a plant.
const RK4: PlantScheme = PlantScheme::Deterministic(Integrator::Rk4);

pub(crate) fn fixed<T: Scalar>(dt: f64) -> Result<FixedStep<T>, DesignError> {
    FixedStep::new(T::from_f64(dt))
}

pub(crate) type Standard<T, G, Md, const N: usize> =
    Discretised<StandardObserver<T, G, Md, N>, Euler>;

// --- Lee, Choi and Khalil: plant (38), noise uniform on [-0.5, 0.5], (42)-(47) ----------------

pub(crate) fn lee<T: Scalar, Z>(z0: Z) -> Scenario<T, Lee, Z> {
    let c = T::from_f64;
    Scenario {
        plant: Lee,
        scheme: PlantScheme::Deterministic(Integrator::Euler),
        draw: Draw::Uniform { low: c(-0.5), high: c(0.5) },
        x0: Vector2::new(c(10.0), c(10.0)),
        z0,
    }
}

fn differentiator<T: Scalar>(
    c: impl Fn(f64) -> T,
) -> Result<Standard<T, ConstantGain<T>, Unknown, 2>, DesignError> {
    let gain = ConstantGain::from_epsilon(c(0.01))?;
    Ok(Discretised { law: StandardObserver::new([c(2.0), c(2.0)], gain, Unknown)?, scheme: Euler })
}

case! {
    /// Standard, n = 2, nothing known of the system, fixed step: (42).
    Standard2 = "standard", 2;
    observer: Standard<T, ConstantGain<T>, Unknown, 2> = |number| differentiator(number);
    plant: Lee = || Ok(lee(Memory::zero()));
    schedule: |I| fixed(4e-4);
}

/// The exact chain between samples, corrected by gains that are computed once, for steps of length dt.
fn zoh<T: Scalar, L: Injected<T>>(law: L, dt: T) -> Result<Zoh<T, L>, DesignError> {
    let scheme = Placed::new(&law, Placement::Exact)?;
    Ok(Current { law, scheme }.prepared(dt))
}

type Zoh<T, L> = Current<L, Placed<T, <L as Injected<T>>::Poles, <L as Injected<T>>::Gains>>;

/// Its memory before the first sample, which corrects for a whole period.
fn whole_period<T: Scalar, const N: usize>(dt: f64) -> CurrentState<T, StandardState<T, (), N>> {
    CurrentState { elapsed: T::from_f64(dt), ..Memory::zero() }
}

case! {
    /// The same observer with eigenvalues placed for the fixed step.
    Zoh2 = "standard, zoh", 2;
    observer: Zoh<T, StandardObserver<T, ConstantGain<T>, Unknown, 2>> = |number| {
        let dt = number(4e-4);
        zoh(differentiator(number)?.law, dt)
    };
    plant: Lee = || Ok(lee(whole_period(4e-4)));
    schedule: |I| fixed(4e-4);
}

case! {
    /// The same under the decreasing steps of stochastic approximation: (44). The clock is part of
    /// the observer.
    StochasticApproximation2 = "stochastic approximation", 2;
    observer: Standard<T, ConstantGain<T>, Unknown, 2> = |number| differentiator(number);
    plant: Lee = || Ok(lee(Memory::zero()));
    schedule: |I| {
        let [alpha, epsilon, k0, p] = [0.04, 0.01, 20_000.0, 1.0].map(T::from_f64);
        Ok(Watched::<_, I>::new(StochasticApproximation::new(alpha, epsilon, k0, p)?))
    };
}

case! {
    /// The line of least squares through the last 11 samples: Savitzky and Golay's filter of degree 1.
    Window2 = "Savitzky-Golay, 11", 2;
    observer: WindowObserver<T, 2, 11> = |number| {
        let (n, dt) = (11.0, 4e-4);
        let w = SMatrix::from_fn(|i, j| {
            let age = j as f64;
            if i == 0 {
                number((4.0 * n - 2.0 - 6.0 * age) / (n * (n + 1.0)))
            } else {
                number(6.0 * (n - 1.0 - 2.0 * age) / (n * (n * n - 1.0) * dt))
            }
        });
        WindowObserver::new(w, number(dt))
    };
    plant: Lee = || Ok(lee(Memory::zero()));
    schedule: |I| fixed(4e-4);
}

// --- Astolfi, Marconi, Praly and Teel: crackle (20), n = 5 -------------------------------------

pub(crate) fn crackle<T: Scalar, Z>(z0: Z) -> Result<Scenario<T, Crackle<T>, Z>, DesignError> {
    let c = T::from_f64;
    Ok(Scenario {
        plant: Crackle::new(c(3.0))?,
        scheme: RK4,
        draw: Draw::Normal { mean: c(0.0), std: c(0.01) },
        x0: SVector::from([-0.8, 0.0, 0.0, 0.0, 0.0].map(c)),
        z0,
    })
}

const ALPHA: [f64; 5] = [3.0, 3.0, 3.0, 3.0, 2.0];
const BETA: [f64; 5] = [8.5714, 3.2122, 1.4267, 0.5347, 0.0];

case! {
    /// Standard, n = 3, as a differentiator of the measured state: poles at -1.
    Standard3 = "standard", 3;
    observer: Standard<T, ConstantGain<T>, Unknown, 3> = |number| {
        let law = StandardObserver::new([3.0, 3.0, 1.0].map(&number), ConstantGain::new(number(7.0))?, Unknown)?;
        Ok(Discretised { law, scheme: Euler })
    };
    plant: Crackle<T> = || crackle(Memory::zero());
    schedule: |I| fixed(1e-3);
}

case! {
    /// Standard, n = 5, with the model φ: (2).
    Standard5 = "standard", 5;
    observer: Standard<T, ConstantGain<T>, Crackle<T>, 5> = |number| {
        let k = [7.5, 22.1875, 32.343_75, 23.218_75, 6.5625].map(&number);
        let (gain, model) = (ConstantGain::new(number(4.17))?, Crackle::new(number(3.0))?);
        Ok(Discretised { law: StandardObserver::new(k, gain, model)?, scheme: Euler })
    };
    plant: Crackle<T> = || crackle(Memory::zero());
    schedule: |I| fixed(1e-3);
}

case! {
    /// The same observer with eigenvalues placed for the fixed step.
    Zoh5 = "standard, zoh", 5;
    observer: Zoh<T, StandardObserver<T, ConstantGain<T>, Crackle<T>, 5>> = |number| {
        let dt = number(1e-3);
        zoh(Standard5::observer(number)?.law, dt)
    };
    plant: Crackle<T> = || crackle(whole_period(1e-3));
    schedule: |I| fixed(1e-3);
}

case! {
    /// Low-power: (5).
    LowPower5 = "low-power", 5;
    observer: Discretised<LowPowerObserver<T, ConstantGain<T>, Crackle<T>, 5>, Euler> = |number| {
        let (gain, model) = (ConstantGain::new(number(7.0))?, Crackle::new(number(3.0))?);
        let (alpha, beta) = (ALPHA.map(&number), BETA.map(&number));
        Ok(Discretised { law: LowPowerObserver::new(alpha, beta, gain, model, NoSaturation)?, scheme: Euler })
    };
    plant: Crackle<T> = || crackle(Memory::zero());
    schedule: |I| fixed(1e-3);
}

case! {
    /// Peaking-free, saturated at ±3: (11).
    PeakingFree5 = "peaking-free", 5;
    observer: Discretised<PeakingFreeObserver<T, ConstantGain<T>, Crackle<T>, HardClip<T, 5>, 5>, Euler> = |number| {
        let (gain, model) = (ConstantGain::new(number(7.0))?, Crackle::new(number(3.0))?);
        let (alpha, beta) = (ALPHA.map(&number), BETA.map(&number));
        let clip = HardClip::new([3.0; 5].map(&number))?;
        Ok(Discretised { law: PeakingFreeObserver::new(alpha, beta, gain, model, clip)?, scheme: Euler })
    };
    plant: Crackle<T> = || crackle(Memory::zero());
    schedule: |I| fixed(1e-3);
}

// --- Structures beyond the paper's, on its plant ------------------------------------------------

case! {
    /// Behind a filter of its innovation, n = 2 and one filter state: all poles at -1.
    Filtered2 = "filtered", 2;
    observer: Discretised<FilteredObserver<T, ConstantGain<T>, Unknown, 2, 1>, Euler> = |number| {
        let (c, k) = ([3.0].map(&number), [1.0, 1.0 / 3.0].map(&number));
        Ok(Discretised { law: FilteredObserver::new(c, k, ConstantGain::new(number(7.0))?, Unknown)?, scheme: Euler })
    };
    plant: Crackle<T> = || crackle(Memory::zero());
    schedule: |I| fixed(1e-3);
}

case! {
    /// Limited gain power, saturated at ±3: the blocks of the low-power observer but its last one.
    LimitedGain5 = "limited-gain", 5;
    observer: Discretised<LimitedGain<T, ConstantGain<T>, Crackle<T>, HardClip<T, 5>, 5>, Euler> = |number| {
        let (gain, model) = (ConstantGain::new(number(7.0))?, Crackle::new(number(3.0))?);
        let (alpha, beta) = (ALPHA.map(&number), BETA.map(&number));
        let clip = HardClip::new([3.0; 5].map(&number))?;
        Ok(Discretised { law: LimitedGain::new(alpha, beta, gain, model, clip)?, scheme: Euler })
    };
    plant: Crackle<T> = || crackle(Memory::zero());
    schedule: |I| fixed(1e-3);
}

case! {
    /// Cascade of levels 3: all poles at -1.
    Cascade5 = "cascade", 5;
    observer: Discretised<CascadeObserver<T, ConstantGain<T>, HardClip<T, 5>, 5>, Euler> = |number| {
        let (k, beta) = ([2.0, 1.0].map(&number), [1.0; 5].map(&number));
        let (gain, clip) = (ConstantGain::new(number(7.0))?, HardClip::new([3.0; 5].map(&number))?);
        Ok(Discretised { law: CascadeObserver::new(k, beta, gain, clip)?, scheme: Euler })
    };
    plant: Crackle<T> = || crackle(Memory::zero());
    schedule: |I| fixed(1e-3);
}

case! {
    /// Reduced order of a chain, with the model φ: four poles at -1.
    ReducedChain5 = "reduced-chain", 5;
    observer: Discretised<ReducedChainObserver<T, Crackle<T>, 5>, Euler> = |number| {
        let (gain, model) = (ConstantGain::new(number(7.0))?, Crackle::new(number(3.0))?);
        let k = [4.0, 6.0, 4.0, 1.0, 0.0].map(&number);
        Ok(Discretised { law: ReducedChainObserver::new(k, gain, model)?, scheme: Euler })
    };
    plant: Crackle<T> = || crackle(Memory::zero());
    schedule: |I| fixed(1e-3);
}

// --- Sanfelice and Praly: plant (19) at rest, normal noise -------------------------------------

const NU1: f64 = 1.9;

pub(crate) fn linear<T: Scalar>(c: impl Fn(f64) -> T) -> Result<SanfelicePraly<T>, DesignError> {
    SanfelicePraly::new(c(NU1), c(0.1))
}

pub(crate) fn at_rest<T: Scalar, Z>(
    z0: Z,
) -> Result<Scenario<T, SanfelicePraly<T>, Z>, DesignError> {
    let c = T::from_f64;
    Ok(Scenario {
        plant: linear(c)?,
        scheme: PlantScheme::Held,
        draw: Draw::Normal { mean: c(-0.02), std: c(0.015) },
        x0: Vector2::new(c(-0.1 / NU1), T::ZERO),
        z0,
    })
}

fn copy<T: Scalar>(x1: f64) -> CopyState<T, 2> {
    CopyState { x_hat: Vector2::new(T::from_f64(x1), T::ZERO), r: T::ONE }
}

fn adaptive<T: Scalar>(c: impl Fn(f64) -> T) -> Result<AdaptiveGain<T>, DesignError> {
    AdaptiveGain::new(c(10.0), c(0.0025), c(0.183))
}

type Collection<T> = RepelledCollection<T, SanfelicePraly<T>, 2, 3>;

fn collection<T: Scalar>(c: impl Fn(f64) -> T) -> Result<Collection<T>, DesignError> {
    let model = linear(&c)?;
    RepelledCollection::new([2.0, 2.0].map(&c), [0.0558, 0.0317].map(&c), adaptive(c)?, model)
}

case! {
    /// Adaptive gain: (5)-(7).
    Adaptive2 = "adaptive", 2;
    observer: Standard<T, AdaptiveGain<T>, SanfelicePraly<T>, 2> = |number| {
        let model = linear(&number)?;
        let law = StandardObserver::new([2.0, 2.0].map(&number), adaptive(number)?, model)?;
        Ok(Discretised { law, scheme: Euler })
    };
    plant: SanfelicePraly<T> = || at_rest(copy(1.0));
    schedule: |I| fixed(9e-3);
}

case! {
    /// Dead zone: (4).
    DeadZone2 = "dead-zone", 2;
    observer: Standard<T, DeadZoneGain<T>, SanfelicePraly<T>, 2> = |number| {
        let model = linear(&number)?;
        let gain = DeadZoneGain::new(number(10.0), number(0.0025), number(0.183))?;
        Ok(Discretised { law: StandardObserver::new([2.0, 2.0].map(&number), gain, model)?, scheme: Euler })
    };
    plant: SanfelicePraly<T> = || at_rest(copy(1.0));
    schedule: |I| fixed(4.5e-3);
}

case! {
    /// Three copies that repel each other: (23).
    Collection2 = "collection of 3", 2;
    observer: Discretised<Collection<T>, Euler> = |number| {
        Ok(Discretised { law: collection(number)?, scheme: Euler })
    };
    plant: SanfelicePraly<T> = || at_rest([1.0, 0.5, 0.0].map(copy));
    schedule: |I| fixed(9e-3);
}

case! {
    /// The modified observer beside them: (25).
    Modified2 = "modified", 2;
    observer: Discretised<ModifiedObserver<T, SanfelicePraly<T>, 2, 3>, Euler> = |number| {
        Ok(Discretised { law: ModifiedObserver { collection: collection(number)? }, scheme: Euler })
    };
    plant: SanfelicePraly<T> = || at_rest(ModifiedState { main: copy(1.0), copies: [1.0, 0.5, 0.0].map(copy) });
    schedule: |I| fixed(9e-3);
}

// --- Fu, Kang and Li: Van der Pol (18) ---------------------------------------------------------

fn van_der_pol<T: Scalar>(c: impl Fn(f64) -> T) -> Result<VanDerPol<T>, DesignError> {
    VanDerPol::new(c(0.8), c(0.5), Diffusion::Additive, Correction::Derived)
}

case! {
    /// Sampled-data: (5).
    SampledData2 = "sampled-data", 2;
    observer: SampledDataObserver<VanDerPol<T>, 2> = |number| {
        Ok(SampledDataObserver { model: van_der_pol(number)? })
    };
    plant: VanDerPol<T> = || Ok(Scenario {
        plant: van_der_pol(T::from_f64)?,
        scheme: PlantScheme::Stochastic(StochasticIntegrator::EulerMaruyama),
        draw: Draw::None,
        x0: Vector2::new(T::ONE, T::ZERO),
        z0: Vector2::new(T::ZERO, T::ONE),
    });
    schedule: |I| fixed(0.03);
}

// --- Katayama: the ship (20) under its controller (21) -----------------------------------------

case! {
    /// Reduced-order: (8), (22).
    ReducedOrder3 = "reduced-order", 3;
    observer: ReducedOrderObserver<T, Ship<T>, 3, 3, 2> = |number| {
        let ship = Ship::new(number(0.0), [0.0; 3].map(&number))?;
        ReducedOrderObserver::new([0.1, 0.2, 0.2].map(&number), number(0.1), ship)
    };
    plant: Ship<T> = || {
        let c = T::from_f64;
        let x0: ShipState<T> = (
            Vector3::new(c(0.0), c(10.0), c(core::f64::consts::FRAC_PI_6)),
            Vector3::new(c(0.5), c(-0.5), c(-0.5)),
        );
        let z0 = <Self as Case<T>>::observer(c)?.initial();
        Ok(Scenario { plant: Ship::new(c(0.0), [T::ZERO; 3])?, scheme: RK4, draw: Draw::None, x0, z0 })
    };
    schedule: |I| fixed(0.01);
}
