//! An unknown as the last state of a chain, in its own unit: a model in Rust that says how it enters.

use hgo_rs::nalgebra::{SVector, Vector1, Vector3};
use hgo_rs::observer::{ContinuousLaw, CurrentState};
use hgo_rs::prelude::*;

/// ẋ₁ = x₂, ẋ₂ = u − sin x₁ − (2 + cos x₁)(d + d³), ḋ = 0.
#[derive(Clone, Copy)]
struct Loaded;

fn phi(x: &Vector3<f64>, d: f64, u: f64) -> f64 {
    u - x.x.sin() - (2.0 + x.x.cos()) * (d + d * d * d)
}

fn slope(x: &Vector3<f64>) -> f64 {
    -(2.0 + x.x.cos()) * (1.0 + 3.0 * x.z * x.z)
}

impl Model<f64, 3, 1> for Loaded {
    fn f_hat(&self, _: f64, _: &Vector3<f64>, _: &Vector1<f64>) -> Vector3<f64> {
        Vector3::zeros()
    }
    fn enters(&self, _: f64, x: &Vector3<f64>, d: f64, u: &Vector1<f64>) -> f64 {
        phi(x, d, u.x)
    }
    fn carries(&self) -> bool {
        true
    }
    fn slope(&self, x: &Vector3<f64>) -> f64 {
        slope(x)
    }
}

impl PhaseVariable<f64, 3, 1> for Loaded {
    fn phi(&self, _: f64, _: &Vector3<f64>, _: &Vector1<f64>) -> f64 {
        0.0
    }
}

fn close(a: &[f64], b: &[f64]) {
    assert_eq!(a.len(), b.len());
    for (a, b) in a.iter().zip(b) {
        assert!((a - b).abs() <= 1e-13 * (1.0 + b.abs()), "{a} {b}");
    }
}

#[test]
fn the_standard_law_divides_by_the_slope() {
    let (k, ell, dt, u) = ([3.0, 3.0, 1.0], 5.0_f64, 1e-3, 0.4);
    let law: StandardObserver<f64, _, _, 3, 1> =
        StandardObserver::new(k, ConstantGain::new(ell).unwrap(), Loaded).unwrap();
    let x = Vector3::new(0.3, -0.7, 0.2);
    let e = 1.1 - x.x;
    for staggered in [false, true] {
        let mut memory = law.initial();
        memory.x_hat = x;
        let (input, y) = (Vector1::new(u), 1.1);
        if staggered {
            let scheme = StaggeredEuler;
            Discretised { law, scheme }.step(&mut memory, &y, &input, 0.0, dt);
        } else {
            let scheme = Euler;
            Discretised { law, scheme }.step(&mut memory, &y, &input, 0.0, dt);
        }
        let d = x.z + dt * ell.powi(3) * e / slope(&x);
        let mut v = x.y + dt * (phi(&x, x.z, u) + 3.0 * ell.powi(2) * e);
        let mut q = x.x + dt * (x.y + 3.0 * ell * e);
        if staggered {
            v += dt * (d - x.z) * slope(&x);
            q += dt * (v - x.y);
        }
        close(memory.x_hat.as_slice(), &[q, v, d]);
    }
}

#[test]
fn the_low_power_law_has_the_unknown_twice() {
    let (alpha, beta, ell, dt, u) = ([3.0, 3.0, 3.0], [3.0, 1.0, 0.0], 5.0_f64, 1e-3, 0.4);
    let law: LowPowerObserver<f64, _, _, 3, 1> =
        LowPowerObserver::new(alpha, beta, ConstantGain::new(ell).unwrap(), Loaded, NoSaturation)
            .unwrap();
    let (x, eta) = (Vector3::new(0.3, -0.7, 0.2), [-0.6, 0.25]);
    let mut memory = law.initial();
    memory.x_hat = x;
    memory.eta = SVector::from([eta[0], eta[1], 0.0]).into();
    Discretised { law, scheme: Euler }.step(&mut memory, &1.1, &Vector1::new(u), 0.0, dt);
    let e = [1.1 - x.x, eta[0] - x.y, eta[1] - x.z];
    let above = phi(&x, eta[1], u);
    let new = [
        x.x + dt * (eta[0] + 3.0 * ell * e[0]),
        x.y + dt * (above + 3.0 * ell * e[1]),
        x.z + dt * 3.0 * ell * e[2],
    ];
    close(memory.x_hat.as_slice(), &new);
    let new = [
        eta[0] + dt * (above + 3.0 * ell * ell * e[0]),
        eta[1] + dt * ell * ell * e[1] / slope(&x),
    ];
    close(&memory.eta.as_slice()[..2], &new);
}

#[test]
fn a_placed_correction_is_that_of_the_chain_over_the_slope() {
    let law: StandardObserver<f64, _, _, 3, 1> =
        StandardObserver::new([3.0, 3.0, 1.0], ConstantGain::new(5.0).unwrap(), Loaded).unwrap();
    let free: StandardObserver<f64, _, _, 3, 1> =
        StandardObserver::new([3.0, 3.0, 1.0], ConstantGain::new(5.0).unwrap(), Unknown).unwrap();
    let (x, y, dt) = (Vector3::new(0.3, -0.7, 0.2), 1.1, 0.02);
    let corrected = |z: Vector3<f64>, loaded: bool| {
        let mut memory = CurrentState { law: law.initial(), elapsed: dt };
        memory.law.x_hat = z;
        if loaded {
            let scheme = Placed::new(&law, Placement::Exact).unwrap();
            Current { law, scheme }.correct(&mut memory, &y, 0.0);
        } else {
            let scheme = Placed::new(&free, Placement::Exact).unwrap();
            Current { law: free, scheme }.correct(&mut memory, &y, 0.0);
        }
        memory.law.x_hat - z
    };
    let (of_chain, of_model) = (corrected(x, false), corrected(x, true));
    close(of_model.as_slice(), &[of_chain.x, of_chain.y, of_chain.z / slope(&x)]);
}
