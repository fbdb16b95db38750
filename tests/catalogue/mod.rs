//! Every observer of the crate, under every scheme that it takes, in a chosen precision: the laws of the one
//! list, and what the papers and the bounds of the orders add to them.
#![allow(clippy::extra_unused_type_parameters)] // every row of the list has the same ones

use hgo_rs::dual::Dual;
use hgo_rs::for_each_law;
use hgo_rs::gain::{
    AdaptiveGain, ConstantGain, DeadZoneGain, GainLaw, HomogeneousGain, PrescribedTimeGain, Shaped,
    SwitchedGain,
};
use hgo_rs::injection::{Implicit, Injected, Placed, Placement, Proper};
use hgo_rs::integrate::Integrator;
use hgo_rs::inter_sample::InterSample;
use hgo_rs::laws::{Design, Law, Sizes};
use hgo_rs::memory::Memory;
use hgo_rs::model::{Model, PhaseVariable, Unknown, last};
use hgo_rs::models::{Correction, Crackle, Diffusion, SanfelicePraly, Ship, VanDerPol};
use hgo_rs::motion::{Held, Rk4Motion};
use hgo_rs::observer::{
    ContinuousLaw, Current, Discretisation, Discretised, Euler, Hold, RungeKutta,
};
use hgo_rs::observers::{
    AdaptiveEkf, FilteredObserver, HardClip, InnovationGain, LAWS, LowPowerObserver, NoSaturation,
    PeakingFreeObserver, ReducedOrderObserver, SampledDataObserver, SampledEkf, Saturation,
    SmoothSaturation, StandardObserver, WindowObserver,
};
use hgo_rs::polynomial::coefficients_from_poles;
use hgo_rs::shape::{Fal, Stubborn};
use hgo_rs::{DesignError, Observer, Scalar};
use nalgebra::{SMatrix, SVector};
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
    visitor.visit(name, "euler, current", Current { law, scheme: Euler }, input);
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

/// ẍ⋯ = u + sin t − sin x₁, of any order.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Swing;

impl<T: Scalar, const N: usize> PhaseVariable<T, N, 1> for Swing {
    fn phi(&self, t: T, x_hat: &SVector<T, N>, u: &SVector<T, 1>) -> T {
        u.x + t.sin() - x_hat[0].sin()
    }
}

/// A nonlinear chain: ẋ₁ = x₂ + x₂³/3.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Stiffening;

impl<T: Scalar> Model<T, 2> for Stiffening {
    fn f_hat(&self, _: T, x: &SVector<T, 2>, _: &SVector<T, 0>) -> SVector<T, 2> {
        SVector::<T, 2>::new(x.y.powi(3) / T::from_f64(3.0), -x.x - x.y)
    }
    fn slopes(&self, x: &SVector<T, 2>) -> SVector<T, 2> {
        SVector::<T, 2>::new(T::ONE, T::ONE + x.y * x.y)
    }
}

impl<T: Scalar, const N: usize> Model<T, N, 1> for Swing {
    fn f_hat(&self, t: T, x_hat: &SVector<T, N>, u: &SVector<T, 1>) -> SVector<T, N> {
        last(self.phi(t, x_hat, u))
    }
}

/// What constructors of the list take.
struct Given<T, G, S> {
    gain: G,
    adaptive: AdaptiveGain<T>,
    constant: ConstantGain<T>,
    model: Swing,
    saturation: S,
    open_saturation: S,
    no_saturation: S,
}

/// Coefficients of a law of the list, for poles between −1 and −2.
struct Numbers {
    law: &'static Law,
    sizes: Sizes,
    values: [f64; 32],
}

impl Numbers {
    fn new(kind: &str, n: usize, m: usize) -> Result<Self, DesignError> {
        let law = Law::find(LAWS, kind).unwrap();
        let sizes = Sizes { n, m, ..Sizes::default() };
        let mut values = [0.0; 32];
        if let Some(Design { poles, place, .. }) = law.design {
            let (count, mut given) = ((poles.len)(&sizes), [(0.0, 0.0); 24]);
            for (i, pole) in given.iter_mut().enumerate() {
                pole.0 = -1.0 - i as f64 / count as f64;
            }
            let coefficients = law.coefficients.iter().map(|part| (part.len)(&sizes)).sum();
            place(&sizes, &given[..count], &mut values[..coefficients])?;
        } else if law.coefficients[0].name == "Q" {
            // R amid the triangles of Q and P(0), whose diagonals are 1
            let packed = n * (n + 1) / 2;
            for i in 0..n {
                (values[i * (i + 3) / 2], values[packed + 1 + i * (i + 3) / 2]) = (1.0, 1.0);
            }
            values[packed] = 1.0;
        } else {
            values[..4].copy_from_slice(&[2.0, 2.0, 0.0558, 0.0317]); // k, k_bar: Sanfelice and Praly
        }
        Ok(Self { law, sizes, values })
    }

    /// One list, with zeros behind it.
    fn list<T: Scalar, const L: usize>(&self, name: &str) -> [T; L] {
        let mut first = 0;
        for part in self.law.coefficients {
            let count = (part.len)(&self.sizes);
            if part.name == name {
                let value = |i| if i < count { self.values[first + i] } else { 0.0 };
                return core::array::from_fn(|i| T::from_f64(value(i)));
            }
            first += count;
        }
        panic!("{name} is no list of {}", self.law.kind)
    }
}

/// The smallest of these sizes.
const fn smallest(sizes: &[usize]) -> usize {
    let (mut smallest, mut i) = (usize::MAX, 0);
    while i < sizes.len() {
        if sizes[i] < smallest {
            smallest = sizes[i];
        }
        i += 1;
    }
    smallest
}

/// A function that shows the laws of the list, of order 2 and, where that is built, 5.
macro_rules! list {
    (
        $(rates {
            kind: $kind:literal, title: $title:literal,
            law: $law:ty,
            new: [$($name:ident $count:tt)*] [$($taken:ident),*],
            orders: $orders:tt, size: [$($size:ident $first:literal $($others:literal)*)?],
            design: $design:tt,
            form: $form:ident, steps: $steps:ident,
            memory: $memory:tt,
            source: $source:literal,
        })*
        $(recursions { $($rest:tt)* })*
    ) => {
        fn visit_list<T>(visitor: &mut impl Visitor<T>) -> Result<(), DesignError>
        where
            T: Scalar + Stored + Logged,
        {
            let c = T::from_f64;
            let adaptive = AdaptiveGain::new(c(10.0), c(0.0025), c(0.183))?;
            $({
                fn build<T, G, Md, S, const N: usize, const K: usize, const M: usize>(
                    given: Given<T, G, S>,
                ) -> Result<$law, DesignError>
                where
                    T: Scalar,
                    G: GainLaw<T>,
                    Md: PhaseVariable<T, N, M> + Model<T, N, M> + Model<Dual<T, N>, N, M> + From<Swing>,
                    S: Saturation<T>,
                {
                    let numbers = Numbers::new($kind, N, K)?;
                    <$law>::new($(numbers.list(stringify!($name)),)* $(given.$taken.into()),*)
                }
                const K: usize = list!(@size $($first $($others)*)?);
                list!(@orders $orders $kind, $steps, visitor, adaptive, K, [$($taken)*]);
            })*
            Ok(())
        }
    };
    (@size) => { 0 };
    (@size $($value:literal)+) => { smallest(&[$($value),+]) };
    (@orders [2] $($rest:tt)*) => {
        list!(@moving $($rest)*);
    };
    (@orders $orders:tt $($rest:tt)*) => {
        list!(@constant 2 $($rest)*);
        list!(@constant 5 $($rest)*);
        list!(@moving $($rest)*);
    };
    (@constant $n:literal $kind:literal, $($rest:tt)*) => {
        let gain = ConstantGain::new(T::from_f64(4.0))?;
        list!(@gain $n, gain, concat!($kind, ", n = ", $n), $($rest)*);
    };
    (@moving $kind:literal, $steps:ident, $visitor:ident, $adaptive:ident, $k:ident, $taken:tt) => {
        let name = concat!($kind, ", adaptive");
        list!(@gain 2, $adaptive, name, $steps, $visitor, $adaptive, $k, $taken);
    };
    (
        @gain $n:literal, $gain:expr, $name:expr,
        $steps:ident, $visitor:ident, $adaptive:ident, $k:ident, $taken:tt
    ) => {
        let saturation = list!(@saturation $taken, $n);
        let given = Given {
            gain: $gain,
            adaptive: $adaptive,
            constant: ConstantGain::new(T::from_f64(4.0))?,
            model: Swing,
            saturation,
            open_saturation: saturation,
            no_saturation: saturation,
        };
        let law = build::<T, _, Swing, _, $n, $k, 1>(given)?;
        list!(@steps $steps, $visitor, $name, law);
    };
    (@saturation [$gain:ident model saturation], $n:literal) => {
        HardClip::new([T::from_f64(3.0); $n])?
    };
    (@saturation [$gain:ident $(model)? open_saturation], $n:literal) => {
        HardClip::new([T::from_f64(3.0); $n])?
    };
    (@saturation $taken:tt, $n:literal) => {
        NoSaturation
    };
    (@steps placed, $visitor:ident, $name:expr, $law:ident) => {
        each_placement($visitor, $name, $law, fill::<T, 1>)?;
    };
    (@steps $other:ident, $visitor:ident, $name:expr, $law:ident) => {
        each_scheme($visitor, $name, $law, fill::<T, 1>);
    };
}
for_each_law!(list);

/// How many observers [`visit_all`] shows.
#[allow(dead_code)] // not every test counts
pub fn observers() -> u64 {
    // Euler with current timing beside the schemes; zoh under both timings
    let (schemes, placements) = (SCHEMES.len() + 1, 2);
    let of_list = |law: &Law| match (law.continuous, law.orders) {
        (false, _) => 0,
        (true, [2]) => schemes,
        (true, _) => 3 * (schemes + usize::from(law.placed()) * placements),
    };
    let listed: usize = LAWS.iter().map(of_list).sum();
    let (continuous, placed, others) = (11, 4, 9);
    (listed + continuous * schemes + placed * placements + others) as u64
}

/// Construct every observer and show it to the visitor.
pub fn visit_all<T>(visitor: &mut impl Visitor<T>) -> Result<(), DesignError>
where
    T: Scalar + Stored + Logged,
{
    visit_list(visitor)?;
    let c = T::from_f64;
    let ell = |value: f64| ConstantGain::new(c(value));
    let dead_zone = DeadZoneGain::new(c(10.0), c(0.0025), c(0.183))?;
    let linear = SanfelicePraly::new(c(1.9), c(0.1))?;
    let crackle = Crackle::new(c(3.0))?;
    let (alpha, beta) = (ALPHA.map(c), BETA.map(c));
    let levels = [c(3.0); 5];
    let twelve = coefficients_from_poles([(c(-1.0), c(0.0)); 12])?;

    let standard = StandardObserver::<T, _, _, 1>::new([c(1.0)], ell(20.0)?, Unknown)?;
    each_scheme(visitor, "standard, n = 1", standard, fill::<T, 0>);
    let standard = StandardObserver::<T, _, _, 12>::new(twelve, ell(2.0)?, Unknown)?;
    each_scheme(visitor, "standard, n = 12", standard, fill::<T, 0>);
    let standard = StandardObserver::<T, _, _, 2>::new([c(2.0); 2], dead_zone, linear)?;
    each_scheme(visitor, "dead zone", standard, fill::<T, 0>);
    let levant = HomogeneousGain::levant(c(1.1), 3)?;
    let levant = StandardObserver::<T, _, _, 3>::new([c(2.0), c(2.121), c(1.1)], levant, Unknown)?;
    each_placement(visitor, "homogeneous", levant, fill::<T, 0>)?;
    let proper = Discretised { law: levant, scheme: Proper { motion: Held } };
    visitor.visit("homogeneous", "proper", proper, fill::<T, 0>);
    let implicit = Current { law: levant, scheme: Implicit };
    visitor.visit("homogeneous", "implicit, current", implicit, fill::<T, 0>);
    let motion = Rk4Motion::default();
    let inter_sample = InterSample { law: levant, motion };
    visitor.visit("homogeneous", "inter-sample", inter_sample, fill::<T, 0>);
    let (c3, k3) = ([c(2.0)], [c(1.0607), c(0.55)]);
    let filtered = FilteredObserver::<T, _, _, 2, 1>::new(
        c3,
        k3,
        HomogeneousGain::levant(c(1.1), 3)?,
        Unknown,
    )?;
    let proper = Discretised { law: filtered, scheme: Proper { motion } };
    visitor.visit("homogeneous, filtered", "proper", proper, fill::<T, 0>);
    let gain = SwitchedGain::new(c(20.0), c(5.0), c(0.1), c(0.05))?;
    let gain = Shaped { gain, shape: Stubborn::new(c(5.0), c(20.0), c(0.01))? };
    let switched = StandardObserver::<T, _, _, 2>::new([c(2.0); 2], gain, Unknown)?;
    each_placement(visitor, "switched, stubborn", switched, fill::<T, 0>)?;
    let stiff = StandardObserver::<T, _, _, 2>::new([c(2.0), c(1.0)], ell(9.0)?, Stiffening)?;
    each_placement(visitor, "nonlinear chain", stiff, fill::<T, 0>)?;
    let gain = PrescribedTimeGain::new(c(4.0), c(1.0), c(20.0))?;
    let timed = StandardObserver::<T, _, _, 2>::new([c(2.25), c(0.9375)], gain, Unknown)?;
    each_scheme(visitor, "prescribed time", timed, fill::<T, 0>);
    let gain = Shaped { gain: ell(5.0)?, shape: Fal::new([c(1.0), c(0.5)], c(0.05))? };
    let fal = StandardObserver::<T, _, _, 2>::new([c(2.0); 2], gain, Unknown)?;
    each_scheme(visitor, "fal", fal, fill::<T, 0>);

    let low_power =
        LowPowerObserver::<T, _, _, 1>::new([c(1.0)], [c(0.0)], ell(7.0)?, Unknown, NoSaturation)?;
    each_scheme(visitor, "low-power, n = 1", low_power, fill::<T, 0>);
    let low_power =
        LowPowerObserver::<T, _, _, 5>::new(alpha, beta, ell(7.0)?, crackle, NoSaturation)?;
    each_placement(visitor, "low-power, crackle", low_power, fill::<T, 0>)?;
    let smooth = SmoothSaturation::new(levels)?;
    let peaking_free =
        PeakingFreeObserver::<T, _, _, _, 5>::new(alpha, beta, ell(7.0)?, crackle, smooth)?;
    each_scheme(visitor, "peaking-free, smooth", peaking_free, fill::<T, 0>);

    let model = VanDerPol::new(c(0.8), c(0.5), Diffusion::Additive, Correction::Derived)?;
    let sampled = SampledDataObserver::<_, 2> { model };
    visitor.visit("sampled-data", "recursion", sampled, fill::<T, 0>);
    let (q, p0) = (
        SMatrix::from_fn(|i, j| c(f64::from(i == j && i == 1))),
        SMatrix::from_fn(|i, j| c(f64::from(i == j))),
    );
    let filter = SampledEkf::<T, _, 2, 1, 1>::new(&q, [c(0.01)], &p0, [c(2.0)], [2], Swing)?;
    visitor.visit("high-gain EKF", "sampled", filter, fill::<T, 1>);
    let gain = InnovationGain::new(c(6.0), c(0.05), c(12.0), c(5e3), c(2e-3))?;
    let filter = AdaptiveEkf::<T, _, 2, 5, 1>::new(&q, c(0.01), &p0, gain, Swing)?;
    visitor.visit("high-gain EKF, adaptive", "sampled", filter, fill::<T, 1>);
    let ship = Ship::new(c(0.0), [c(0.0); 3])?;
    let reduced = ReducedOrderObserver::new([0.1, 0.2, 0.2].map(c), c(0.1), ship)?;
    visitor.visit("reduced-order", "recursion", reduced, fill::<T, 2>);
    let gains = SMatrix::from_fn(|i, j| c([[0.8, 0.2, -0.1], [3.0, 0.0, -2.0]][i][j]));
    let window = WindowObserver::<T, 2, 3>::new(gains, c(0.01))?;
    visitor.visit("window", "recursion", window, fill::<T, 0>);
    Ok(())
}
