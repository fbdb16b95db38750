//! Laws beyond the papers', on the papers' plants: shapes of the innovation, gains that move, schemes of their
//! own, filters that see the model's slopes.

use crate::papers::{Standard, at_rest, case, crackle, fixed, lee, linear};
use crate::{Case, Instrument, Scenario, State};
use hgo_rs::gain::GainLaw;
use hgo_rs::injection::{Implicit, Proper};
use hgo_rs::inter_sample::InterSample;
use hgo_rs::models::{Crackle, Lee, SanfelicePraly};
use hgo_rs::nalgebra::{SMatrix, SVector, Vector1, Vector2};
use hgo_rs::observers::{AdaptiveEkf, FilteredObserver, InnovationGain};
use hgo_rs::prelude::*;
use hgo_rs::shape::{BiHomogeneous, DeadZone, Fal, PiecewiseLinear, Stubborn};

// --- Homogeneous of degree -1: Levant's differentiator, bound 1.1, n = 3 -----------------------

type Levant3<T> = StandardObserver<T, HomogeneousGain<T>, Unknown, 3>;

fn levant<T: Scalar>(c: impl Fn(f64) -> T) -> Result<Levant3<T>, DesignError> {
    let gain = HomogeneousGain::levant(c(1.1), 3)?;
    StandardObserver::new([2.0, 2.121, 1.1].map(&c), gain, Unknown)
}

case! {
    /// Its proper discretisation.
    Proper3 = "Levant, proper", 3;
    observer: Discretised<Levant3<T>, Proper<Held>> = |number| {
        Ok(Discretised { law: levant(number)?, scheme: Proper { motion: Held } })
    };
    plant: Crackle<T> = || crackle(Memory::zero());
    schedule: |I| fixed(1e-3);
}

case! {
    /// The injection of the error after it: implicit.
    Implicit3 = "Levant, implicit", 3;
    observer: Current<Levant3<T>, Implicit> = |number| {
        Ok(Current { law: levant(number)?, scheme: Implicit })
    };
    plant: Crackle<T> = || crackle(Memory::zero());
    schedule: |I| fixed(1e-3);
}

case! {
    /// The output predicted between samples.
    InterSample3 = "Levant, inter-sample", 3;
    observer: InterSample<Levant3<T>, Rk4Motion> = |number| {
        Ok(InterSample { law: levant(number)?, motion: Rk4Motion::default() })
    };
    plant: Crackle<T> = || crackle(Memory::zero());
    schedule: |I| fixed(1e-3);
}

case! {
    /// Behind a filter of its innovation, n = 2 and one filter state.
    FilteredLevant2 = "Levant, filtered", 2;
    observer: Discretised<FilteredObserver<T, HomogeneousGain<T>, Unknown, 2, 1>, Proper<Rk4Motion>> = |number| {
        let gain = HomogeneousGain::levant(number(1.1), 3)?;
        let law = FilteredObserver::new([2.0].map(&number), [1.0607, 0.55].map(&number), gain, Unknown)?;
        Ok(Discretised { law, scheme: Proper { motion: Rk4Motion::default() } })
    };
    plant: Crackle<T> = || crackle(Memory::zero());
    schedule: |I| fixed(1e-3);
}

// --- Gains that move and shapes of the innovation, n = 2 ----------------------------------------

case! {
    /// A gain that switches down within a zone, behind a stubborn saturation.
    Switched2 = "switched, stubborn", 2;
    observer: Standard<T, Shaped<SwitchedGain<T>, Stubborn<T>>, Unknown, 2> = |number| {
        let gain = SwitchedGain::new(number(20.0), number(5.0), number(0.1), number(0.05))?;
        let shape = Stubborn::new(number(5.0), number(20.0), number(0.01))?;
        let law = StandardObserver::new([2.0, 2.0].map(&number), Shaped { gain, shape }, Unknown)?;
        Ok(Discretised { law, scheme: Euler })
    };
    plant: Lee = || Ok(lee(Memory::zero()));
    schedule: |I| fixed(4e-4);
}

case! {
    /// A gain that grows until a deadline.
    PrescribedTime2 = "prescribed time", 2;
    observer: Standard<T, PrescribedTimeGain<T>, Unknown, 2> = |number| {
        let gain = PrescribedTimeGain::new(number(4.0), number(1.0), number(20.0))?;
        let law = StandardObserver::new([2.25, 0.9375].map(&number), gain, Unknown)?;
        Ok(Discretised { law, scheme: Euler })
    };
    plant: Crackle<T> = || crackle(<Self as Case<T>>::observer(T::from_f64)?.initial());
    schedule: |I| fixed(1e-3);
}

/// The standard observer of poles (-1, -1) at ℓ = 5, its innovation shaped.
fn shaped<T: Scalar, S>(
    c: impl Fn(f64) -> T,
    shape: S,
) -> Result<Standard<T, Shaped<ConstantGain<T>, S>, Unknown, 2>, DesignError>
where
    Shaped<ConstantGain<T>, S>: GainLaw<T>,
{
    let gain = Shaped { gain: ConstantGain::new(c(5.0))?, shape };
    let law = StandardObserver::new([2.0, 1.0].map(&c), gain, Unknown)?;
    Ok(Discretised { law, scheme: Euler })
}

/// A case of one shape over the crackle.
macro_rules! shape {
    ($(#[$doc:meta])* $case:ident = $name:literal: $shape:ty = |$number:ident| $new:expr;) => {
        case! {
            $(#[$doc])*
            $case = $name, 2;
            observer: Standard<T, Shaped<ConstantGain<T>, $shape>, Unknown, 2> = |$number| {
                let shape = $new?;
                shaped($number, shape)
            };
            plant: Crackle<T> = || crackle(<Self as Case<T>>::observer(T::from_f64)?.initial());
            schedule: |I| fixed(1e-3);
        }
    };
}

shape! {
    /// A dead zone that follows the noise.
    DeadZoneShape2 = "dead zone of the innovation": DeadZone<T> = |number|
        DeadZone::new(number(20.0), number(5.0), number(0.01));
}

shape! {
    /// A smaller gain for small innovations.
    PiecewiseLinear2 = "piecewise linear": PiecewiseLinear<T> = |number|
        PiecewiseLinear::new(number(0.2), number(0.05));
}

shape! {
    /// Han's function.
    Fal2 = "fal": Fal<T, 2> = |number| Fal::new([1.0, 0.5].map(&number), number(0.05));
}

shape! {
    /// Degrees -1/2 near 0 and 1/2 far away.
    BiHomogeneous2 = "bi-homogeneous": BiHomogeneous<T, 2> = |number|
        BiHomogeneous::new(number(-0.5), number(0.5), [number(1.0); 2], [number(0.5); 2]);
}

/// ẋ₁ = x₂ + x₂³/3, of slope 1 + x₂².
#[derive(Clone, Copy)]
pub struct Stiffening;

impl<T: Scalar> Model<T, 2> for Stiffening {
    fn f_hat(&self, _: T, x: &Vector2<T>, _: &SVector<T, 0>) -> Vector2<T> {
        Vector2::new(x.y * x.y * x.y / T::from_f64(3.0), -x.x - x.y)
    }
    fn slopes(&self, x: &Vector2<T>) -> Vector2<T> {
        Vector2::new(T::ONE, T::ONE + x.y * x.y)
    }
}

case! {
    /// A chain whose slope is the state's: the second gain is divided by it.
    NonlinearChain2 = "nonlinear chain", 2;
    observer: Standard<T, ConstantGain<T>, Stiffening, 2> = |number| {
        let gain = ConstantGain::new(number(9.0))?;
        let law = StandardObserver::new([2.0, 1.0].map(&number), gain, Stiffening)?;
        Ok(Discretised { law, scheme: Euler })
    };
    plant: Crackle<T> = || crackle(Memory::zero());
    schedule: |I| fixed(1e-3);
}

// --- Filters that see the model's slopes: plant (19) of Sanfelice and Praly ---------------------

/// A diagonal of `first` and 1.
fn diagonal<T: Scalar>(c: impl Fn(f64) -> T, first: f64) -> SMatrix<T, 2, 2> {
    SMatrix::from_fn(|i, j| match (i, j) {
        (0, 0) => c(first),
        (1, 1) => c(1.0),
        _ => c(0.0),
    })
}

case! {
    /// High-gain EKF in continuous time.
    HighGainEkf2 = "high-gain EKF", 2;
    observer: Discretised<HighGainEkf<T, ConstantGain<T>, SanfelicePraly<T>, 2>, Euler> = |number| {
        let (q, p0, model) = (diagonal(&number, 1.0), diagonal(&number, 1.0), linear(&number)?);
        let law = HighGainEkf::with(&q, number(1.0), &p0, ConstantGain::new(number(4.0))?, model)?;
        Ok(Discretised { law, scheme: Euler })
    };
    plant: SanfelicePraly<T> = || at_rest(<Self as Case<T>>::observer(T::from_f64)?.initial());
    schedule: |I| fixed(4e-3);
}

/// A plant whose output is a vector of one entry, as filters of several outputs take it.
#[derive(Clone, Copy)]
pub struct Column<P>(P);

impl<T: Scalar, P: Plant<T, Output = T>> Plant<T> for Column<P> {
    type State = P::State;
    type Input = P::Input;
    type Output = Vector1<T>;
    const TRUTH: (usize, usize) = P::TRUTH;
    fn drift(&self, t: T, x: &P::State, u: &P::Input) -> P::State {
        self.0.drift(t, x, u)
    }
    fn output(&self, t: T, x: &P::State, u: &P::Input) -> Vector1<T> {
        Vector1::new(self.0.output(t, x, u))
    }
    fn truth<'a>(&self, x: &'a P::State) -> &'a [T] {
        self.0.truth(x)
    }
    fn control(&self, t: T, x: &P::State, dt: T) -> P::Input {
        self.0.control(t, x, dt)
    }
}

case! {
    /// High-gain EKF that moves from sample to sample.
    SampledEkf2 = "high-gain EKF, sampled", 2;
    observer: SampledEkf<T, SanfelicePraly<T>, 2> = |number| {
        let (q, p0, model) = (diagonal(&number, 0.0), diagonal(&number, 1.0), linear(&number)?);
        SampledEkf::new(&q, [number(0.01)], &p0, [number(2.0)], [2], model)
    };
    plant: Column<SanfelicePraly<T>> = || {
        let z0 = <Self as Case<T>>::observer(T::from_f64)?.initial();
        let Scenario { plant, scheme, draw, x0, z0 } = at_rest(z0)?;
        Ok(Scenario { plant: Column(plant), scheme, draw, x0, z0 })
    };
    schedule: |I| fixed(4e-3);
}

case! {
    /// The same, its gain moved by the innovations of 5 samples.
    AdaptiveEkf2 = "high-gain EKF, adaptive", 2;
    observer: AdaptiveEkf<T, SanfelicePraly<T>, 2, 5> = |number| {
        let (q, p0, model) = (diagonal(&number, 0.0), diagonal(&number, 1.0), linear(&number)?);
        let [most, rise, fall, slope, threshold] = [6.0, 0.05, 12.0, 5e3, 2e-3].map(&number);
        let gain = InnovationGain::new(most, rise, fall, slope, threshold)?;
        AdaptiveEkf::new(&q, number(0.01), &p0, gain, model)
    };
    plant: SanfelicePraly<T> = || at_rest(<Self as Case<T>>::observer(T::from_f64)?.initial());
    schedule: |I| fixed(4e-3);
}
