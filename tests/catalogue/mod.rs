//! Every observer of the crate, under every scheme that it takes, in a chosen precision.

use hgo_rs::gain::{AdaptiveGain, ConstantGain, DeadZoneGain};
use hgo_rs::injection::{Injected, Placed, Placement};
use hgo_rs::integrate::Integrator;
use hgo_rs::memory::Memory;
use hgo_rs::model::{InputGain, Unknown};
use hgo_rs::models::{Correction, Crackle, Diffusion, Lee, SanfelicePraly, Ship, VanDerPol};
use hgo_rs::observer::{
    ContinuousLaw, Current, Discretisation, Discretised, Euler, Hold, RungeKutta,
};
use hgo_rs::observers::{
    HardClip, LowPowerObserver, ModifiedObserver, NoSaturation, PeakingFreeObserver,
    ReducedOrderObserver, RepelledCollection, SampledDataObserver, SmoothSaturation,
    StandardObserver,
};
use hgo_rs::polynomial::coefficients_from_poles;
use hgo_rs::{DesignError, Observer, Scalar};
use nalgebra::SVector;
use std::fmt::Debug;

/// α and β of Astolfi et al., n = 5: every eigenvalue of M₅ is real and in [−2, −1].
pub const ALPHA: [f64; 5] = [3.0, 3.0, 3.0, 3.0, 2.0];
/// The last entry is not used.
pub const BETA: [f64; 5] = [60.0 / 7.0, 3.212_245, 1.426_736, 0.534_670, 0.0];

/// A trait that stands for `bounds` where `feature` is on, and for nothing where it is off.
macro_rules! under_feature {
    ($feature:literal, $(#[$doc:meta])* $name:ident: $($bounds:tt)+) => {
        $(#[$doc])*
        #[cfg(feature = $feature)]
        pub trait $name: $($bounds)+ {}
        #[cfg(feature = $feature)]
        impl<X: $($bounds)+> $name for X {}
        $(#[$doc])*
        #[cfg(not(feature = $feature))]
        pub trait $name {}
        #[cfg(not(feature = $feature))]
        impl<X> $name for X {}
    };
}
under_feature! { "serde",
    /// Can be written and read again.
    Stored: serde::Serialize + serde::de::DeserializeOwned
}
under_feature! { "defmt",
    /// Can be logged by a chip.
    Logged: defmt::Format
}

/// What a test does with each observer.
pub trait Visitor<T: Scalar> {
    /// `law` and `scheme` name the observer; `input` fills its known input with one value.
    fn visit<O>(
        &mut self,
        law: &'static str,
        scheme: &'static str,
        observer: O,
        input: fn(T) -> O::Input,
    ) where
        O: Observer<T> + Debug + Stored + Logged,
        O::State: PartialEq + Debug + Stored + Logged;
}

/// The schemes of a continuous law, by their names.
pub const SCHEMES: [(&str, Discretisation); 5] = [
    ("euler", Discretisation::Euler),
    ("staggered-euler", Discretisation::StaggeredEuler),
    ("rk4", held(Integrator::Rk4, Hold::Measurement)),
    ("rk4-innovation-held", held(Integrator::Rk4, Hold::Innovation)),
    ("bogacki-shampine", held(Integrator::BogackiShampine, Hold::Measurement)),
];

const fn held(integrator: Integrator, hold: Hold) -> Discretisation {
    Discretisation::RungeKutta(RungeKutta { integrator, hold })
}

fn each_scheme<T, L>(
    visitor: &mut impl Visitor<T>,
    name: &'static str,
    law: L,
    input: fn(T) -> L::Input,
) where
    T: Scalar + Stored + Logged,
    L: ContinuousLaw<T> + Debug + Stored + Logged,
    L::State: PartialEq + Debug + Stored + Logged,
{
    for (scheme_name, scheme) in SCHEMES {
        visitor.visit(name, scheme_name, Discretised { law, scheme }, input);
    }
}

/// A law whose eigenvalues can be placed, under both timings.
fn each_placement<T, L>(
    visitor: &mut impl Visitor<T>,
    name: &'static str,
    law: L,
    input: fn(T) -> L::Input,
) -> Result<(), DesignError>
where
    T: Scalar + Stored + Logged,
    L: Injected<T, Input: Memory<T> + PartialEq + Debug + Stored + Logged>,
    L: Debug + PartialEq + Stored + Logged,
    L::State: PartialEq + Debug + Stored + Logged,
    L::Poles: PartialEq + Debug + Stored + Logged,
    L::Gains: PartialEq + Debug + Stored + Logged,
{
    each_scheme(visitor, name, law, input);
    visitor.visit(name, "euler, current", Current { law, scheme: Euler }, input);
    let scheme = Placed::new(&law, Placement::Exact)?;
    let prepared = Discretised { law, scheme }.prepared(T::from_f64(1e-3));
    visitor.visit(name, "zoh", prepared, input);
    let prepared = Current { law, scheme }.prepared(T::from_f64(1e-3));
    visitor.visit(name, "zoh, current", prepared, input);
    Ok(())
}

fn fill<T: Scalar, const M: usize>(value: T) -> SVector<T, M> {
    SVector::from_element(value)
}

/// Construct every observer and show it to the visitor.
pub fn visit_all<T>(visitor: &mut impl Visitor<T>) -> Result<(), DesignError>
where
    T: Scalar + Stored + Logged,
{
    let c = T::from_f64;
    let ell = |value: f64| ConstantGain::new(c(value));
    let adaptive = AdaptiveGain::new(c(10.0), c(0.0025), c(0.183))?;
    let dead_zone = DeadZoneGain::new(c(10.0), c(0.0025), c(0.183))?;
    let two = [c(2.0), c(2.0)];
    let linear = SanfelicePraly::new(c(1.9), c(0.1))?;
    let crackle = Crackle::new(c(3.0))?;
    let five = [7.5, 22.1875, 32.343_75, 23.218_75, 6.5625].map(c);
    let (alpha, beta) = (ALPHA.map(c), BETA.map(c));
    let levels = [c(3.0); 5];
    let twelve = coefficients_from_poles([(c(-1.0), c(0.0)); 12])?;

    let standard = StandardObserver::<T, _, _, 1>::new([c(1.0)], ell(20.0)?, Unknown)?;
    each_scheme(visitor, "standard, n = 1", standard, fill::<T, 0>);
    let standard = StandardObserver::<T, _, _, 2>::new(two, ell(20.0)?, Lee)?;
    each_placement(visitor, "standard, n = 2", standard, fill::<T, 0>)?;
    let standard = StandardObserver::<T, _, _, 5>::new(five, ell(4.0)?, crackle)?;
    each_placement(visitor, "standard, n = 5", standard, fill::<T, 0>)?;
    let standard = StandardObserver::<T, _, _, 12>::new(twelve, ell(2.0)?, Unknown)?;
    each_scheme(visitor, "standard, n = 12", standard, fill::<T, 0>);
    let driven = InputGain { b0: c(3.0) };
    let standard = StandardObserver::<T, _, _, 2, 1>::new(two, ell(20.0)?, driven)?;
    each_scheme(visitor, "standard with an input", standard, fill::<T, 1>);
    let standard = StandardObserver::<T, _, _, 2>::new(two, adaptive, linear)?;
    each_placement(visitor, "adaptive", standard, fill::<T, 0>)?;
    let standard = StandardObserver::<T, _, _, 2>::new(two, dead_zone, linear)?;
    each_scheme(visitor, "dead zone", standard, fill::<T, 0>);

    let low_power =
        LowPowerObserver::<T, _, _, 1>::new([c(1.0)], [c(0.0)], ell(7.0)?, Unknown, NoSaturation)?;
    each_scheme(visitor, "low-power, n = 1", low_power, fill::<T, 0>);
    let low_power =
        LowPowerObserver::<T, _, _, 5>::new(alpha, beta, ell(7.0)?, crackle, NoSaturation)?;
    each_placement(visitor, "low-power, n = 5", low_power, fill::<T, 0>)?;
    let low_power = LowPowerObserver::<T, _, _, 2>::new(
        [c(2.0), c(2.0)],
        [c(2.0), c(0.0)],
        adaptive,
        Unknown,
        NoSaturation,
    )?;
    each_placement(visitor, "low-power, adaptive", low_power, fill::<T, 0>)?;
    let hard = HardClip::new(levels)?;
    let peaking_free =
        PeakingFreeObserver::<T, _, _, _, 5>::new(alpha, beta, ell(7.0)?, crackle, hard)?;
    each_placement(visitor, "peaking-free, hard clip", peaking_free, fill::<T, 0>)?;
    let smooth = SmoothSaturation::new(levels)?;
    let peaking_free =
        PeakingFreeObserver::<T, _, _, _, 5>::new(alpha, beta, ell(7.0)?, crackle, smooth)?;
    each_scheme(visitor, "peaking-free, smooth", peaking_free, fill::<T, 0>);

    let k_bar = [c(0.0558), c(0.0317)];
    let collection = RepelledCollection::<T, _, 2, 3>::new(two, k_bar, adaptive, linear)?;
    each_scheme(visitor, "collection of 3", collection, fill::<T, 0>);
    let modified = ModifiedObserver { collection };
    each_scheme(visitor, "modified", modified, fill::<T, 0>);

    let model = VanDerPol::new(c(0.8), c(0.5), Diffusion::Additive, Correction::Derived)?;
    let sampled = SampledDataObserver::<_, 2> { model };
    visitor.visit("sampled-data", "recursion", sampled, fill::<T, 0>);
    let ship = Ship::new(c(0.0), [c(0.0); 3])?;
    let reduced = ReducedOrderObserver::new([0.1, 0.2, 0.2].map(c), c(0.1), ship)?;
    visitor.visit("reduced-order", "recursion", reduced, fill::<T, 2>);
    Ok(())
}
