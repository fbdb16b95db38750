//! How the model moves between placed corrections: against the law's own rate, integrated finely.

use hgo_rs::gain::{AdaptiveGain, ConstantGain};
use hgo_rs::injection::{Injected, Placed, Placement};
use hgo_rs::integrate::rk4;
use hgo_rs::memory::Memory;
use hgo_rs::model::{Model, PhaseVariable, Unknown, last, no_input};
use hgo_rs::motion::{HALVINGS, Held, ImplicitMotion, MAX_SUBSTEPS, Motion, Rk4Motion};
use hgo_rs::observer::{ContinuousLaw, Current, CurrentState};
use hgo_rs::observers::{LowPowerObserver, LowPowerState, NoSaturation, StandardObserver};
use hgo_rs::{Observer, Scalar};
use nalgebra::{SVector, Vector1};

/// φ = u − sin x₁ − 0.4 xₙ + cos(3t) x₂.
#[derive(Clone, Copy, Debug)]
struct Swing;

impl<T: Scalar, const N: usize> PhaseVariable<T, N, 1> for Swing {
    fn phi(&self, t: T, x: &SVector<T, N>, u: &SVector<T, 1>) -> T {
        let three = T::from_f64(3.0);
        u.x - x[0].sin() - T::from_f64(0.4) * x[N - 1] + (three * t).cos() * x[1]
    }
}

impl<T: Scalar, const N: usize> Model<T, N, 1> for Swing {
    fn f_hat(&self, t: T, x: &SVector<T, N>, u: &SVector<T, 1>) -> SVector<T, N> {
        last(self.phi(t, x, u))
    }
}

/// ẋ = −slope x, or −slope sign x.
#[derive(Clone, Copy, Debug)]
struct Falls {
    slope: f64,
    jumps: bool,
}

impl Model<f64, 1, 0> for Falls {
    fn f_hat(&self, _: f64, x: &Vector1<f64>, _: &SVector<f64, 0>) -> Vector1<f64> {
        let sign = if x.x == 0.0 { 0.0 } else { x.x.signum() };
        Vector1::new(-self.slope * if self.jumps { sign } else { x.x })
    }
}

const T0: f64 = 0.3;
const U: f64 = 0.7;

fn moved<L, M>(law: &L, motion: M, z: &L::State, dt: f64) -> L::State
where
    L: Injected<f64, Input = Vector1<f64>>,
    M: Motion,
{
    let scheme = Placed::new(law, Placement::Exact).unwrap().moved_by(motion);
    let mut state = CurrentState { law: *z, elapsed: 0.0 };
    Current { law: *law, scheme }.predict(&mut state, &Vector1::new(U), T0, dt);
    assert_eq!(state.elapsed.to_bits(), dt.to_bits());
    state.law
}

/// By a thousand small steps of a rate.
fn finely<Z: Memory<f64>>(rate: impl Fn(f64, &Z) -> Z, z: &Z, dt: f64) -> Z {
    let (mut z, h) = (*z, dt / 1000.0);
    for i in 0..1000 {
        z = rk4(&rate, T0 + f64::from(i) * h, &z, h);
    }
    z
}

fn distance<M: Memory<f64>>(a: &M, b: &M) -> f64 {
    let mut largest = 0.0_f64;
    a.zip(b, |a, b| a - b).visit(&mut |x| largest = largest.max(x.abs()));
    largest
}

/// The error of one period falls as its length to the motion's order + 1.
fn orders<L>(law: &L, rate: impl Fn(f64, &L::State) -> L::State, z: &L::State)
where
    L: Injected<f64, Input = Vector1<f64>>,
{
    let (rk4, implicit) = (Rk4Motion::new(1).unwrap(), ImplicitMotion::new(1).unwrap());
    for (motion, order) in [(0, 1.0), (1, 4.0), (2, 4.0)] {
        let error = |dt: f64| {
            let found = match motion {
                0 => moved(law, Held, z, dt),
                1 => moved(law, rk4, z, dt),
                _ => moved(law, implicit, z, dt),
            };
            distance(&found, &finely(&rate, z, dt))
        };
        for dt in [0.2, 0.1] {
            let found = (error(dt) / error(dt / 2.0)).log2() - 1.0;
            assert!((found - order).abs() < 0.7, "order {found}, not {order}");
        }
    }
}

#[test]
fn of_the_standard_law() {
    let gain = ConstantGain::new(10.0).unwrap();
    let law: StandardObserver<f64, _, _, 3, 1> =
        StandardObserver::new([4.0, 6.0, 4.0], gain, Swing).unwrap();
    let mut z = law.initial();
    z.x_hat = SVector::from([0.5, -1.2, 0.8]);
    orders(&law, |t, z| law.rate(t, z, &0.0, &Vector1::new(U)), &z);
}

/// Between samples its blocks leave each other alone: x̂̇ᵢ = ηᵢ, η̇ᵢ = ηᵢ₊₁, φ at the end.
#[test]
fn of_the_low_power_law() {
    let gain = ConstantGain::new(10.0).unwrap();
    let law: LowPowerObserver<f64, _, _, 3, 1> =
        LowPowerObserver::new([2.0, 2.0, 2.0], [1.0, 1.0, 0.0], gain, Swing, NoSaturation).unwrap();
    let mut z = law.initial();
    z.x_hat = SVector::from([0.5, -1.2, 0.8]);
    let eta: SVector<f64, 3> = SVector::from([-1.1, 0.9, 0.0]);
    z.eta = eta.into();
    let rate = |t: f64, z: &LowPowerState<f64, (), 3>| {
        let phi: f64 = Swing.phi(t, &z.x_hat, &Vector1::new(U));
        let eta: SVector<f64, 3> = SVector::from([z.eta[1], phi, 0.0]);
        let x_hat = SVector::from([z.eta[0], z.eta[1], phi]);
        LowPowerState { x_hat, eta: eta.into(), r: () }
    };
    orders(&law, rate, &z);
}

/// Substeps are the same as periods, and the gain moves over them.
#[test]
fn substeps() {
    let gain = AdaptiveGain::new(10.0, 2.5e-3, 0.183).unwrap();
    let law: StandardObserver<f64, _, _, 2, 1> =
        StandardObserver::new([2.0, 1.0], gain, Swing).unwrap();
    let mut z = law.initial();
    (z.x_hat, z.r) = (SVector::from([0.5, -1.2]), 3.0);
    let whole = moved(&law, Rk4Motion::default(), &z, 0.1);
    let one = Rk4Motion::new(1).unwrap();
    let half = moved(&law, one, &z, 0.05);
    let scheme = Placed::new(&law, Placement::Exact).unwrap().moved_by(one);
    let mut state = CurrentState { law: half, elapsed: 0.05 };
    Current { law, scheme }.predict(&mut state, &Vector1::new(U), T0 + 0.05, 0.05);
    assert_eq!(whole, state.law);

    for count in [0, MAX_SUBSTEPS + 1] {
        assert_eq!(Rk4Motion::new(count).unwrap_err().parameter, "substeps");
        assert_eq!(ImplicitMotion::new(count).unwrap_err().parameter, "substeps");
    }
}

/// Without known terms every motion is the chain's own.
#[test]
fn nothing_known() {
    let k = [4.0, 6.0, 4.0];
    let gain = ConstantGain::new(10.0).unwrap();
    let law: StandardObserver<f64, _, _, 3, 1> = StandardObserver::new(k, gain, Unknown).unwrap();
    let mut z = law.initial();
    z.x_hat = SVector::from([0.5, -1.2, 0.8]);
    let wanted = SVector::from([0.5 - 0.12 + 0.004, -1.2 + 0.08, 0.8]);
    for substeps in 1..=MAX_SUBSTEPS {
        let rk4 = moved(&law, Rk4Motion::new(substeps).unwrap(), &z, 0.1);
        let implicit = moved(&law, ImplicitMotion::new(substeps).unwrap(), &z, 0.1);
        assert_eq!(rk4, implicit);
        assert!((rk4.x_hat - wanted).amax() < 1e-14);
    }
}

fn after(model: Falls, x0: f64, h: f64) -> f64 {
    let gain = ConstantGain::new(1.0).unwrap();
    let law: StandardObserver<f64, _, _, 1> = StandardObserver::new([1.0], gain, model).unwrap();
    let motion = ImplicitMotion::new(1).unwrap();
    let scheme = Placed::new(&law, Placement::Exact).unwrap().moved_by(motion);
    let observer = Current { law, scheme };
    let mut z = observer.initial();
    z.law.x_hat = Vector1::new(x0);
    observer.predict(&mut z, &no_input(), 0.0, h);
    z.law.x_hat.x
}

/// Backward Euler where h|∂f/∂x| > 1, RK4 where it is less, to any steepness.
#[test]
fn stiff_terms() {
    for (steep, stiff) in [(0.9, false), (1.1, true), (30.0, true), (1e9, true)] {
        let found = after(Falls { slope: steep / 0.1, jumps: false }, 1.0, 0.1);
        let z: f64 = -steep;
        let rk4 = 1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0)));
        let wanted = if stiff { 1.0 / (1.0 + steep) } else { rk4 };
        assert!((found - wanted).abs() < 1e-12, "{steep}: {found} for {wanted}");
    }
    // a jump: to rest where it is reached within the step, to the stated error
    let (h, jump) = (1e-3, 20.0);
    for x0 in [0.0, 1e-5, 4e-3, -9e-3] {
        let found = after(Falls { slope: jump, jumps: true }, x0, h);
        assert!(found.abs() <= h * jump / f64::from(1_u32 << HALVINGS), "{x0}: {found}");
    }
    let sliding = after(Falls { slope: jump, jumps: true }, 0.5, h);
    assert!((sliding - (0.5 - h * jump)).abs() < 1e-15);
}
