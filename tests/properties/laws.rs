//! The laws written out, in both precisions, and where one is a case of another.

use crate::catalogue::{SCHEMES, Visitor, visit_all};
use hgo_rs::dual::Dual;
use hgo_rs::for_each_law;
use hgo_rs::gain::{AdaptiveGain, ConstantGain, GainLaw};
use hgo_rs::laws::{Form, Gain, Law, Sizes};
use hgo_rs::memory::Memory;
use hgo_rs::model::{InputGain, Model, PhaseVariable, StrictFeedback, Unknown, no_input};
use hgo_rs::models::{SanfelicePraly, Ship};
use hgo_rs::observer::{ContinuousLaw, Discretised, Euler, Measurement, StaggeredEuler};
use hgo_rs::observers::{
    CopyState, HardClip, LAWS, LowPowerObserver, ModifiedObserver, ModifiedState, NoSaturation,
    PeakingFreeObserver, ReducedOrderState, RepelledCollection, Saturation, StandardObserver,
    StandardState,
};
use hgo_rs::{Observer, Scalar};
use nalgebra::{SMatrix, SVector, Vector1, Vector2, Vector3};
use std::fmt::Debug;

/// The estimates of every observer after half a second of a sine, by name.
struct Estimates(Vec<(&'static str, &'static str, Vec<f64>)>);

impl<T: Scalar> Visitor<T> for Estimates {
    fn visit<O>(
        &mut self,
        law: &'static str,
        scheme: &'static str,
        observer: O,
        input: fn(T) -> O::Input,
    ) where
        O: Observer<T>,
        O::State: PartialEq + Debug,
    {
        let dt = T::from_f64(1e-3);
        let mut z = observer.initial();
        for k in 0..500_u16 {
            let t = T::from_f64(f64::from(k)) * dt;
            let y = O::Measurement::fill(|| T::from_f64(0.5) * t.sin());
            observer.step(&mut z, &y, &input(T::from_f64(0.1)), t, dt);
        }
        let estimate = observer.estimate(&z).iter().map(|x| x.to_f64()).collect();
        self.0.push((law, scheme, estimate));
    }
}

/// Single precision is the same law: estimates agree to single precision.
#[test]
fn single_and_double_precision_agree() {
    let (mut double, mut single) = (Estimates(Vec::new()), Estimates(Vec::new()));
    visit_all::<f64>(&mut double).unwrap();
    visit_all::<f32>(&mut single).unwrap();
    for ((law, scheme, wide), (_, _, narrow)) in double.0.iter().zip(&single.0) {
        let size = wide.iter().fold(1.0_f64, |a, x| a.max(x.abs()));
        for (a, b) in wide.iter().zip(narrow) {
            assert!((a - b).abs() < 2e-3 * size, "{law}, {scheme}: {wide:?} and {narrow:?}");
        }
        assert!(wide.iter().any(|x| x.abs() > 1e-3), "{law}, {scheme} moved: {wide:?}");
    }
}

/// Copies that start alike do not repel and are the plain adaptive observer each.
#[test]
fn identical_copies_are_the_plain_observer() {
    let gain = AdaptiveGain::new(10.0, 0.0025, 0.183).unwrap();
    let model = SanfelicePraly::new(1.9, 0.1).unwrap();
    let plain = StandardObserver::new([2.0, 2.0], gain, model).unwrap();
    let collection =
        RepelledCollection::<f64, _, 2, 3>::new([2.0, 2.0], [0.06, 0.03], gain, model).unwrap();
    for (name, scheme) in SCHEMES {
        let start = StandardState { x_hat: Vector2::new(0.4, -0.1), r: 1.3 };
        let (mut one, mut three) = (start, [start; 3]);
        for k in 0..200_u16 {
            let y = (0.02 * f64::from(k)).sin();
            Discretised { law: plain, scheme }.step(&mut one, &y, &no_input(), 0.0, 0.01);
            Discretised { law: collection, scheme }.step(&mut three, &y, &no_input(), 0.0, 0.01);
        }
        assert_eq!(three, [one; 3], "{name}");
    }
}

/// (23)-(25) written out with ŷᵢ − y for one step of forward Euler.
#[test]
fn collection_and_modified_observer_written_out() {
    let (k, k_bar, b, nu1, p1, p2) = ([2.0, 2.1], [0.056, 0.032], 0.183, 1.9, 10.0, 0.0025);
    let gain = AdaptiveGain::new(p1, p2, b).unwrap();
    let model = SanfelicePraly::new(nu1, 0.1).unwrap();
    let collection = RepelledCollection::<f64, _, 2, 3>::new(k, k_bar, gain, model).unwrap();
    let observer = Discretised { law: ModifiedObserver { collection }, scheme: Euler };
    let main = StandardState { x_hat: Vector2::new(0.2, 0.3), r: 1.1 };
    let copies = [(0.1, -0.2, 1.2), (-0.3, 0.1, 1.5), (0.4, 0.0, 1.9)]
        .map(|(a, c, r)| StandardState { x_hat: Vector2::new(a, c), r });
    let (y, dt) = (0.25, 1e-3);
    let mut z = ModifiedState { main, copies };
    observer.step(&mut z, &y, &no_input(), 0.0, dt);

    let adapted = |r: f64, error: f64| {
        r + dt * p1 * ((error * error - p2) * r.powf(1.0 - 2.0 * b) + p2 / r.powi(4))
    };
    for (i, CopyState { x_hat: x, r }) in copies.iter().enumerate() {
        let error = x.x - y;
        let mut repulsion = 0.0;
        for (j, CopyState { x_hat: other, r: other_r }) in copies.iter().enumerate() {
            if j != i {
                repulsion += error / r.powf(b) - (other.x - y) / other_r.powf(b);
            }
        }
        let rate1 = x.y + nu1 * x.x - k[0] * r * error + k_bar[0] * r.powf(1.0 + b) * repulsion;
        let rate2 = -k[1] * r * r * error + k_bar[1] * r.powf(2.0 + b) * repulsion;
        let CopyState { x_hat: ours, r: ours_r } = z.copies[i];
        assert!((ours - (x + Vector2::new(rate1, rate2) * dt)).amax() < 1e-15, "copy {i}");
        assert!((ours_r - adapted(*r, error)).abs() < 1e-15, "copy {i}");
    }
    let (CopyState { x_hat: x, r }, error) = (main, main.x_hat.x - y);
    let nominal = (1.2 + 1.5 + 1.9) / 3.0;
    let product = r * nominal;
    let rate1 = x.y + nu1 * x.x - k[0] * product * error;
    let rate2 = -k[1] * product * product * error;
    assert!((z.main.x_hat - (x + Vector2::new(rate1, rate2) * dt)).amax() < 1e-15);
    assert!((z.main.r - adapted(r, error)).abs() < 1e-15);
    assert!((collection.nominal_gain(&copies) - nominal).abs() < 1e-15);
}

/// The standard law swept from the end of its chain, for n = 3: x̂₃ first, then x̂₂ by the new x̂₃,
/// then x̂₁ by the new x̂₂.
#[test]
fn staggered_chain_written_out() {
    let (k, ell, y, dt) = ([3.0, 3.5, 1.5], 4.0_f64, 0.6, 0.02);
    let gain = ConstantGain::new(ell).unwrap();
    let law = StandardObserver::<f64, _, _, 3>::new(k, gain, Unknown).unwrap();
    let x = Vector3::new(0.2, -0.7, 1.1);
    let mut z = StandardState { x_hat: x, r: () };
    let e = y - x.x;
    Discretised { law, scheme: StaggeredEuler }.step(&mut z, &y, &no_input(), 0.0, dt);
    let x3 = x.z + dt * k[2] * ell.powi(3) * e;
    let x2 = x.y + dt * (x3 + k[1] * ell.powi(2) * e);
    let x1 = x.x + dt * (x2 + k[0] * ell * e);
    assert!((z.x_hat - Vector3::new(x1, x2, x3)).amax() < 1e-14, "{}", z.x_hat);
}

/// (5) and (11) of the low-power and peaking-free laws written out for n = 3, by forward Euler and
/// swept from the end of the chain: η₁ by the new sat(η₂), then every x̂ᵢ by the new ηᵢ.
#[test]
fn low_power_and_peaking_free_written_out() {
    let (alpha, beta, ell, b0) = ([3.0, 2.5, 2.0], [3.2, 1.4, 0.0], 5.0, 1.5);
    let (x, eta, y, u, dt) = ([0.2, -0.4, 0.9], [2.5, -1.7], 0.35, 0.7, 1e-2);
    let gain = ConstantGain::new(ell).unwrap();
    let model = InputGain { b0 };
    let start = Memory::read(&[x[0], x[1], x[2], eta[0], eta[1]]);
    let input = SVector::<f64, 1>::new(u);
    let clip = HardClip::new([1.1, 1.6, 0.0]).unwrap();
    let low = LowPowerObserver::<f64, _, _, 3, 1>::new(alpha, beta, gain, model, NoSaturation);
    let free = PeakingFreeObserver::<f64, _, _, _, 3, 1>::new(alpha, beta, gain, model, clip);
    let (low, free) = (low.unwrap(), free.unwrap());
    for staggered in [false, true] {
        let (mut by_low, mut by_free) = (start, start);
        let scheme = SCHEMES[usize::from(staggered)].1;
        Discretised { law: low, scheme }.step(&mut by_low, &y, &input, 0.0, dt);
        Discretised { law: free, scheme }.step(&mut by_free, &y, &input, 0.0, dt);
        for (ours, levels) in [(by_low, [f64::MAX; 2]), (by_free, [1.1, 1.6])] {
            let sat = |i: usize, eta: f64| eta.clamp(-levels[i], levels[i]);
            let s = [sat(0, eta[0]), sat(1, eta[1])];
            let e = [y - x[0], s[0] - x[1], s[1] - x[2]];
            let phi = b0 * u;
            let mut new_eta = [
                eta[0] + dt * (s[1] + beta[0] * ell * ell * e[0]),
                eta[1] + dt * (phi + beta[1] * ell * ell * e[1]),
            ];
            let mut above = [eta[0], eta[1]];
            if staggered {
                new_eta[0] += dt * (sat(1, new_eta[1]) - s[1]);
                above = new_eta;
            }
            let expected = [
                x[0] + dt * (above[0] + alpha[0] * ell * e[0]),
                x[1] + dt * (above[1] + alpha[1] * ell * e[1]),
                x[2] + dt * (phi + alpha[2] * ell * e[2]),
                new_eta[0],
                new_eta[1],
            ];
            let mut entries = [0.0; 5];
            ours.write(&mut entries);
            for (i, (ours, expected)) in entries.iter().zip(expected).enumerate() {
                assert!((ours - expected).abs() < 1e-15, "staggered: {staggered}, entry {i}");
            }
        }
    }
}

/// The least squares of a general g against the rotation's transpose, and for a tall g that moves with
/// time and input.
#[test]
fn velocity_is_explained_by_least_squares() {
    #[derive(Clone, Copy)]
    struct General(Ship<f64>);
    impl StrictFeedback<f64, 3, 3, 2> for General {
        fn f1(&self, t: f64, x: &Vector3<f64>, u: &Vector2<f64>) -> Vector3<f64> {
            self.0.f1(t, x, u)
        }
        fn g(&self, t: f64, x: &Vector3<f64>, u: &Vector2<f64>) -> SMatrix<f64, 3, 3> {
            self.0.g(t, x, u)
        }
        fn f2(&self, t: f64, x: &Vector3<f64>, z: &Vector3<f64>, u: &Vector2<f64>) -> Vector3<f64> {
            self.0.f2(t, x, z, u)
        }
    }
    #[derive(Clone, Copy)]
    struct Tall;
    impl StrictFeedback<f64, 3, 2, 1> for Tall {
        fn f1(&self, _: f64, _: &Vector3<f64>, _: &Vector1<f64>) -> Vector3<f64> {
            Vector3::zeros()
        }
        fn g(&self, t: f64, _: &Vector3<f64>, u: &Vector1<f64>) -> SMatrix<f64, 3, 2> {
            SMatrix::<f64, 3, 2>::new(1.0 + t, 2.0, 0.5, -1.0, 3.0 * u.x, 0.2)
        }
        fn f2(&self, _: f64, _: &Vector3<f64>, _: &Vector2<f64>, _: &Vector1<f64>) -> Vector2<f64> {
            Vector2::zeros()
        }
    }
    let ship = Ship::new(0.0, [0.0; 3]).unwrap();
    let (x, v) = (Vector3::new(1.0, 2.0, 0.7), Vector3::new(0.3, -0.2, 0.1));
    let (t, u) = (0.4, Vector2::new(0.2, 0.1));
    let (ours, general) = (ship.explain(t, &x, &u, &v), General(ship).explain(t, &x, &u, &v));
    assert!((general - ours).amax() < 1e-15);
    // the residual of least squares is orthogonal to the columns of g
    for (t, u) in [(0.0, 1.0), (2.0, -0.5)] {
        let u = Vector1::new(u);
        let z = Tall.explain(t, &x, &u, &v);
        let g = Tall.g(t, &x, &u);
        let residual = v - g * z;
        assert!(g.tr_mul(&residual).amax() < 1e-14 && residual.amax() > 0.01, "{residual}");
    }
}

/// What the list says of a law's memory is what its type has.
#[test]
fn the_list_counts_the_entries_of_each_memory() {
    fn law<T: Scalar, L: ContinuousLaw<T>>(kind: &str, n: usize, m: usize, moves: bool) {
        let said = Law::find(LAWS, kind).unwrap();
        let sizes = Sizes { n, m, moves, inputs: 1, ..Sizes::default() };
        assert_eq!((said.memory_len(&sizes), n), (L::State::LEN, L::ESTIMATED), "{kind}");
        assert!(said.continuous && said.form != Form::Sampled, "{kind}");
    }
    macro_rules! count {
        (
            $(rates {
                kind: $kind:literal, title: $title:literal,
                law: $law:ty,
                $($rest:tt)*
            })*
            $(recursions {
                kind: $recursion:literal, title: $name:literal,
                law: $sampled:ty,
                $($more:tt)*
            })*
        ) => {
            $({
                fn both<T: Scalar, G, Md, S, const N: usize, const K: usize, const M: usize>(
                    moves: bool,
                ) where
                    G: GainLaw<T>,
                    Md: PhaseVariable<T, N, M> + Model<T, N, M> + Model<Dual<T, N>, N, M>,
                    S: Saturation<T>,
                {
                    law::<T, $law>($kind, N, K, moves);
                }
                both::<f64, AdaptiveGain<f64>, InputGain<f64>, NoSaturation, 2, 3, 1>(true);
                if Law::find(LAWS, $kind).unwrap().gain == Gain::Any {
                    both::<f32, ConstantGain<f32>, InputGain<f32>, NoSaturation, 5, 3, 1>(false);
                }
            })*
            let kinds = [$($kind,)* $($recursion),*];
            assert!(kinds.iter().eq(LAWS.iter().map(|law| &law.kind)), "{kinds:?}");
        };
    }
    for_each_law!(count);
    let sizes = Sizes { n: 3, outputs: 4, inputs: 2, ..Sizes::default() };
    let len = |kind| Law::find(LAWS, kind).unwrap().memory_len(&sizes);
    assert_eq!(len("sampled-data"), 3);
    assert_eq!(len("reduced-order"), ReducedOrderState::<f64, 4, 3, 2>::LEN);
}
