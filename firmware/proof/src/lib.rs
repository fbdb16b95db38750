//! Each observer's construction, step and estimate as functions that a linker keeps as roots.
//!
//! An image with the roots of one observer is what that observer costs a program. It links only if
//! no panic is reachable from them: the panic handler calls a function that exists nowhere.
#![no_std]

use cases::Case;
use core::hint::black_box;
use hgo_rs::polynomial::euler_limit;
use hgo_rs::prelude::*;

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    unsafe extern "C" {
        fn hgo_panic_is_reachable() -> !;
    }
    // SAFETY: the symbol is defined nowhere, so an image with this call does not link.
    unsafe { hgo_panic_is_reachable() }
}

type Of<T, C> = <C as Case<T>>::Observer;
type Memory<T, C> = <Of<T, C> as Observer<T>>::State;

/// Construct from numbers that the compiler cannot know; whether they were accepted.
#[inline(always)]
fn new<T: Scalar, C: Case<T>>(observer: &mut Of<T, C>, z: &mut Memory<T, C>) -> bool {
    match C::observer(|number| black_box(T::from_f64(number))) {
        Ok(built) => {
            *observer = built;
            *z = observer.initial();
            true
        }
        Err(_) => false,
    }
}

#[inline(always)]
fn estimate<T: Scalar, C: Case<T>>(observer: &Of<T, C>, z: &Memory<T, C>, i: usize) -> T {
    observer.estimate(z).get(i).copied().unwrap_or(T::ZERO)
}

/// The roots `<case>_<scalar>_new`, `_step`, `_estimate` and, for use on line, `_online` of cases in
/// one precision.
macro_rules! roots {
    ($scalar:ident: $($case:ident)*) => {$(const _: () = {
        type Observer = Of<$scalar, cases::$case>;
        type State = Memory<$scalar, cases::$case>;

        #[unsafe(export_name = concat!(stringify!($case), "_", stringify!($scalar), "_new"))]
        fn new_root(observer: &mut Observer, z: &mut State) -> bool {
            new::<$scalar, cases::$case>(observer, z)
        }
        #[unsafe(export_name = concat!(stringify!($case), "_", stringify!($scalar), "_step"))]
        fn step_root(
            observer: &Observer,
            z: &mut State,
            y: &<Observer as hgo_rs::Observer<$scalar>>::Measurement,
            u: &<Observer as hgo_rs::Observer<$scalar>>::Input,
            t: $scalar,
            dt: $scalar,
        ) -> Status {
            observer.step(z, y, u, t, dt)
        }
        #[unsafe(export_name = concat!(stringify!($case), "_", stringify!($scalar), "_online"))]
        fn online_root(
            estimator: &mut Estimator<$scalar, Observer>,
            y: &<Observer as hgo_rs::Observer<$scalar>>::Measurement,
            u: &<Observer as hgo_rs::Observer<$scalar>>::Input,
            dt: $scalar,
        ) -> Status {
            estimator.step(y, u, dt)
        }
        #[unsafe(export_name = concat!(stringify!($case), "_", stringify!($scalar), "_estimate"))]
        fn estimate_root(observer: &Observer, z: &State, i: usize) -> $scalar {
            estimate::<$scalar, cases::$case>(observer, z, i)
        }
    };)*};
}

macro_rules! both {
    ($($case:ident)*) => {
        roots! { f32: $($case)* }
        roots! { f64: $($case)* }
    };
}

cases::each_case!(both);

/// Stochastic approximation is an observer and a clock: its step asks the clock first.
macro_rules! with_a_clock {
    ($($scalar:ident)*) => {$(const _: () = {
        type Case = cases::StochasticApproximation2;
        type Observer = (Of<$scalar, Case>, StochasticApproximation<$scalar>);
        type State = (Memory<$scalar, Case>, $scalar);

        #[unsafe(export_name = concat!("StochasticApproximation2_", stringify!($scalar), "_new"))]
        fn new_root((observer, clock): &mut Observer, (z, t): &mut State) -> bool {
            let [alpha, epsilon, k0, p] = black_box([0.04, 0.01, 20_000.0, 1.0]);
            let Ok(built) = StochasticApproximation::new(alpha, epsilon, k0, p) else {
                return false;
            };
            (*clock, *t) = (built, 0.0);
            new::<$scalar, Case>(observer, z)
        }
        #[unsafe(export_name = concat!("StochasticApproximation2_", stringify!($scalar), "_step"))]
        fn step_root((observer, clock): &Observer, (z, t): &mut State, y: &$scalar, k: u64) -> Status {
            let dt = clock.dt(k);
            let status = observer.step(z, y, &no_input(), *t, dt);
            *t = clock.next_time(*t, k, dt);
            status
        }
        #[unsafe(export_name = concat!("StochasticApproximation2_", stringify!($scalar), "_online"))]
        fn online_root(
            estimator: &mut Estimator<$scalar, Of<$scalar, Case>>,
            clock: &StochasticApproximation<$scalar>,
            y: &$scalar,
            k: u64,
        ) -> Status {
            estimator.step(y, &no_input(), clock.dt(k))
        }
        #[unsafe(export_name = concat!("StochasticApproximation2_", stringify!($scalar), "_estimate"))]
        fn estimate_root((observer, _): &Observer, (z, _): &State, i: usize) -> $scalar {
            estimate::<$scalar, Case>(observer, z, i)
        }
    };)*};
}

with_a_clock! { f32 f64 }

/// Designs made on the chip itself: coefficients from poles, and the step limit.
macro_rules! design {
    ($($name:literal $scalar:ident)*) => {$(const _: () = {
        #[unsafe(export_name = $name)]
        fn design(poles: &[($scalar, $scalar); 9], out: &mut [[$scalar; 5]; 3]) -> $scalar {
            let [a, b, c, d, e, ..] = *poles;
            let Ok(k) = coefficients_from_poles([a, b, c, d, e]) else { return 0.0 };
            let Ok((alpha, beta)) = low_power_coefficients_from_poles(*poles) else { return 0.0 };
            *out = [k, alpha, beta];
            euler_limit(&k)
        }
    };)*};
}

design! { "design_f32" f32 "design_f64" f64 }
