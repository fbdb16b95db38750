//! What a user would take or write instead: a Kalman filter from a crate and, on a Cortex-M, observers
//! in plain C (`plain.rs`), fed and counted as the crate's own. Single precision.

use crate::debugger::Console;
use crate::meter::{count, record, reset};
use crate::row;
use adskalman::{
    KalmanFilterNoControl, ObservationModel, StateAndCovariance, TransitionModelLinearNoControl,
};
use cases::{Case, Plain, Standard2, run_instead};
use core::fmt;
use hgo_rs::nalgebra::{
    Matrix1, Matrix1x2, Matrix2, Matrix2x1, SVector, U1, U2, Vector1, Vector2, Vector6,
};
use hgo_rs::{Observer, Status, Timing};

/// Constant velocity: x1' = x1 + dt x2, with white acceleration; x1 is measured.
#[derive(Clone, Copy)]
struct ConstantVelocity {
    f: Matrix2<f32>,
    ft: Matrix2<f32>,
    q: Matrix2<f32>,
    h: Matrix1x2<f32>,
    ht: Matrix2x1<f32>,
    r: Matrix1<f32>,
}

impl TransitionModelLinearNoControl<f32, U2> for ConstantVelocity {
    fn F(&self) -> &Matrix2<f32> {
        &self.f
    }
    fn FT(&self) -> &Matrix2<f32> {
        &self.ft
    }
    fn Q(&self) -> &Matrix2<f32> {
        &self.q
    }
}

impl ObservationModel<f32, U2, U1> for ConstantVelocity {
    fn H(&self) -> &Matrix1x2<f32> {
        &self.h
    }
    fn HT(&self) -> &Matrix2x1<f32> {
        &self.ht
    }
    fn R(&self) -> &Matrix1<f32> {
        &self.r
    }
}

/// The filter's state and covariance, one after the other.
type KalmanMemory = Vector6<f32>;

/// What is counted: predict and update.
#[inline(never)]
fn kalman_step(model: &ConstantVelocity, z: &mut KalmanMemory, y: f32) -> u32 {
    let state = Vector2::new(z[0], z[1]);
    let before = StateAndCovariance::new(state, Matrix2::new(z[2], z[3], z[4], z[5]));
    let filter = KalmanFilterNoControl::new(model, model);
    let Ok(after) = filter.step(&before, &Vector1::new(y)) else { return 2 };
    let (x, p) = (after.state(), after.covariance());
    *z = Vector6::new(x[0], x[1], p[(0, 0)], p[(0, 1)], p[(1, 0)], p[(1, 1)]);
    0
}

impl Observer<f32> for ConstantVelocity {
    type State = KalmanMemory;
    type Measurement = f32;
    type Input = SVector<f32, 0>;
    const TIMING: Timing = Timing::Current;
    const ESTIMATED: usize = 2;

    fn initial(&self) -> KalmanMemory {
        Vector6::new(0.0, 0.0, 1.0, 0.0, 0.0, 1.0)
    }

    /// The crate's step: predict over the period that has ended, then update.
    fn correct(&self, z: &mut KalmanMemory, y: &f32, _: f32) -> Status {
        let function: fn(&Self, &mut KalmanMemory, f32) -> u32 = kalman_step;
        // SAFETY: a function pointer whose result is a word.
        let (status, instructions) = unsafe { count(function, |step| step(self, z, *y)) };
        record(instructions, function as *const ());
        if status == 0 { Status::Updated } else { Status::ModelUndefined }
    }

    fn advance(&self, _: &mut KalmanMemory, _: &f32, _: &Self::Input, _: f32, _: f32) -> Status {
        Status::Predicted
    }

    fn estimate<'a>(&self, z: &'a KalmanMemory) -> &'a [f32] {
        z.as_slice().get(..2).unwrap_or(&[])
    }

    fn innovation(&self, _: f32, z: &KalmanMemory, y: &f32, _: &Self::Input) -> f32 {
        y - z[0]
    }
}

fn constant_velocity(dt: f32) -> ConstantVelocity {
    let f = Matrix2::new(1.0, dt, 0.0, 1.0);
    let acceleration = 100.0; // variance density of the white acceleration
    let cross = acceleration * dt * dt / 2.0;
    let q = Matrix2::new(acceleration * dt * dt * dt / 3.0, cross, cross, acceleration * dt);
    let h = Matrix1x2::new(1.0, 0.0);
    let r = Matrix1::new(1.0 / 12.0); // uniform on [-0.5, 0.5]
    ConstantVelocity { f, ft: f.transpose(), q, h, ht: h.transpose(), r }
}

/// Run an observer in a case's place and report it.
pub fn beside<C, O>(out: &mut Console, name: &str, observer: &O, z0: O::State) -> fmt::Result
where
    C: Case<f32>,
    O: Observer<
            f32,
            Measurement = <C::Observer as Observer<f32>>::Measurement,
            Input = <C::Observer as Observer<f32>>::Input,
        >,
{
    reset();
    let digest = run_instead::<f32, C, Plain, O>(observer, z0).map_err(|_| fmt::Error)?;
    row(out, (name, name, C::N, "f32"), digest)
}

/// Run and report them all.
pub fn report(out: &mut Console) -> fmt::Result {
    #[cfg(target_arch = "arm")] // the C compiler and its libm are of the Cortex-M
    crate::plain::report(out)?;

    let kalman = constant_velocity(4e-4);
    beside::<Standard2, _>(out, "Kalman filter", &kalman, kalman.initial())
}
