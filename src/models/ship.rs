//! The three-degree-of-freedom ship of Katayama (20) under the tracking controller (21).
//!
//!   ẋ = R(x₃) z,   ż = (1 + δ̄)( −M⁻¹[C(z) + D]z + q(z, u) ) + w,   y = x
//!
//! x: position (m, m) and heading (rad); z: surge, sway (m/s) and yaw rate (rad/s); u: surge
//! force over mass and rudder. δ̄ and w are unknown to the observer.
//!
//! The controller is written in the only reading that cancels exactly: the last term of (21) is
//! −k z̃₃ and κ starts with −k(z₃ + Γv).

use crate::Scalar;
use crate::error::{DesignError, finite, require};
use crate::model::{Plant, StrictFeedback};
use nalgebra::{Matrix3, SVector, Vector2, Vector3};

const M11: f64 = 198.8;
const M22: f64 = 206.0;
const M23: f64 = 15.6;
const M33: f64 = 101.5;
/// Determinant of the coupled part of M.
const DET: f64 = M22 * M33 - M23 * M23;
const D11: f64 = 56.1;
const D22: f64 = 90.9;
const D23: f64 = -21.8;
const D32: f64 = -26.9;
const D33: f64 = 38.8;

/// Position x and velocity z.
pub type ShipState<T> = (Vector3<T>, Vector3<T>);

/// Plant (20) with model uncertainty δ̄ and disturbance w.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ship<T> {
    delta: T,
    w: Vector3<T>,
}

crate::error::through_constructor! {
    [T: Scalar] Ship<T>: ship => { delta: T = ship.delta, w: Vector3<T> = ship.w }
    => Self::new(delta, w.into())
}

impl<T: Scalar> Ship<T> {
    /// δ̄ with |δ̄| ≤ 0.5, w in m/s², m/s², rad/s².
    ///
    /// # Errors
    /// δ̄ outside its range; a parameter that is not finite.
    pub fn new(delta: T, w: [T; 3]) -> Result<Self, DesignError> {
        let inside = delta.abs() <= T::from_f64(0.5);
        require("delta", delta, inside, "it must lie in [-0.5, 0.5], Katayama section III")?;
        for entry in w {
            finite("w", entry)?;
        }
        Ok(Self { delta, w: Vector3::from_fn(|i, _| w[i]) })
    }

    /// [d₁, d₂, d₃] = −M⁻¹[C(z) + D]z.
    #[inline(always)]
    fn d(z: &Vector3<T>) -> Vector3<T> {
        let c = T::from_f64;
        let c1 = c(M22) * z.y + c(M23) * z.z;
        let c2 = -c(M11) * z.x;
        let f1 = -c1 * z.z + c(D11) * z.x;
        let f2 = -c2 * z.z + c(D22) * z.y + c(D23) * z.z;
        let f3 = c1 * z.x + c2 * z.y + c(D32) * z.y + c(D33) * z.z;
        Vector3::new(
            c(-1.0 / M11) * f1,
            c(M23 / DET) * f3 - c(M33 / DET) * f2,
            c(M23 / DET) * f2 - c(M22 / DET) * f3,
        )
    }

    /// λ₂₁, λ₂₂, λ₃₁, λ₃₂ of the appendix. λ₂₂ has no value at z = 0: atan(0/0). It jumps where z₁ changes
    /// its sign; a z₁ of nothing but rounding, and 0 of either sign, is +0 (without a decision, so that
    /// the model can be traced).
    #[inline(always)]
    fn lambda(z: &Vector3<T>) -> [T; 4] {
        let c = T::from_f64;
        let s = z.y - c(1.18) * z.z;
        let (zz, ss) = (z.x * z.x, s * s);
        let counts = -T::ONE.copysign(c(1e-12) * s.abs() - z.x.abs());
        let z1 = z.x * counts.max(T::ZERO) + T::ZERO;
        let l22 = -c(0.0232) * (zz + ss) * (s / z1).atan();
        [c(0.102) * zz - c(0.0232) * ss, l22, c(0.287) * zz + c(0.307) * ss, -c(13.23) * l22]
    }

    /// f₂ = d(z) + q(z, u): what the observer knows of the dynamics.
    #[inline(always)]
    fn dynamics(z: &Vector3<T>, u: &Vector2<T>) -> Vector3<T> {
        let [l21, l22, l31, l32] = Self::lambda(z);
        Self::d(z) + Vector3::new(u.x, l21 * u.y + l22, l31 * u.y + l32)
    }
}

impl<T: Scalar> Plant<T> for Ship<T> {
    type State = ShipState<T>;
    type Input = Vector2<T>;
    type Output = Vector3<T>;
    const TRUTH: (usize, usize) = (3, 3);

    #[inline(always)]
    fn drift(&self, _: T, (x, z): &ShipState<T>, u: &Vector2<T>) -> ShipState<T> {
        let (sin, cos) = (x.z.sin(), x.z.cos());
        let x_rate = Vector3::new(cos * z.x - sin * z.y, sin * z.x + cos * z.y, z.z);
        (x_rate, Self::dynamics(z, u) * (T::ONE + self.delta) + self.w) // (20)
    }
    #[inline(always)]
    fn output(&self, _: T, (x, _): &ShipState<T>, _: &Vector2<T>) -> Vector3<T> {
        *x
    }
    #[inline(always)]
    fn truth<'a>(&self, (_, z): &'a ShipState<T>) -> &'a [T] {
        z.as_slice()
    }

    /// (21), state feedback under a zero-order hold of period dt.
    #[inline(always)]
    fn control(&self, _: T, (x, z): &ShipState<T>, dt: T) -> Vector2<T> {
        let c = T::from_f64;
        let [d1, d2, d3] = Self::d(z).into();
        let [l21, l22, l31, l32] = Self::lambda(z);
        let (sin, cos) = (x.z.sin(), x.z.cos());
        let gamma = c(6.0) / (c(36.0) + x.y * x.y);
        let rate = T::ONE / (dt + c(0.3));
        let k = c(0.3) * rate;
        let x3_error = x.z - (-x.y / c(6.0)).atan();
        let v = z.x * sin + z.y * cos;
        let z3_error = z.z + k * x3_error + gamma * v;
        let kappa = -k * (z.z + gamma * v) + gamma * gamma * x.y * v * v / c(3.0)
            - gamma * (d1 * sin + (d2 + l22) * cos + (z.x * cos - z.y * sin) * z.z);
        let xi = l31 + l21 * gamma * cos;
        let u1 = (c(0.8) - z.x) * rate - d1;
        let u2 = (-d3 - l32 + kappa - k * z3_error - gamma * u1 * sin) / xi;
        Vector2::new(u1, u2)
    }
}

impl<T: Scalar> StrictFeedback<T, 3, 3, 2> for Ship<T> {
    #[inline(always)]
    fn f1(&self, _: T, _: &Vector3<T>, _: &Vector2<T>) -> Vector3<T> {
        SVector::from_element(T::ZERO)
    }
    #[inline(always)]
    fn g(&self, _: T, x: &Vector3<T>, _: &Vector2<T>) -> Matrix3<T> {
        let (sin, cos) = (x.z.sin(), x.z.cos());
        let (zero, one) = (T::ZERO, T::ONE);
        Matrix3::new(cos, -sin, zero, sin, cos, zero, zero, zero, one)
    }
    #[inline(always)]
    fn f2(&self, _: T, _: &Vector3<T>, z: &Vector3<T>, u: &Vector2<T>) -> Vector3<T> {
        Self::dynamics(z, u)
    }
    /// R⁻¹ = Rᵀ.
    #[inline(always)]
    fn explain(&self, _: T, x: &Vector3<T>, _: &Vector2<T>, v: &Vector3<T>) -> Vector3<T> {
        let (sin, cos) = (x.z.sin(), x.z.cos());
        Vector3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z)
    }
}
