//! Observers in plain C: see `../c/plain.c`.

use crate::beside::beside;
use crate::debugger::Console;
use crate::meter::{count, record, record_first};
use cases::{Adaptive2, Case, LowPower5, Standard2, State, Zoh2};
use core::fmt;
use hgo_rs::Timing;
use hgo_rs::injection::Injected;
use hgo_rs::nalgebra::SVector;
use hgo_rs::prelude::*;

/// Parameters and memory are rows of floats in C's structs too: see `../c/plain.h`.
type Function = unsafe extern "C" fn(*const f32, *mut f32, f32, f32) -> u32;

unsafe extern "C" {
    fn plain_standard2(parameters: *const f32, x: *mut f32, y: f32, dt: f32) -> u32;
    fn plain_zoh2_correct(parameters: *const f32, x: *mut f32, y: f32) -> u32;
    fn plain_zoh2_predict(parameters: *const f32, x: *mut f32) -> u32;
    fn plain_low_power5(parameters: *const f32, z: *mut f32, y: f32, dt: f32) -> u32;
    fn plain_adaptive2(parameters: *const f32, z: *mut f32, y: f32, dt: f32) -> u32;
}

/// An observer in C with P parameters and L numbers of memory.
#[derive(Clone, Copy)]
struct PlainC<const P: usize, const L: usize> {
    parameters: [f32; P],
    function: Function,
}

impl<const P: usize, const L: usize> Observer<f32> for PlainC<P, L> {
    type State = SVector<f32, L>;
    type Measurement = f32;
    type Input = SVector<f32, 0>;
    const TIMING: Timing = Timing::Predictor;
    const ESTIMATED: usize = 2;

    fn initial(&self) -> Self::State {
        SVector::zeros()
    }

    fn advance(&self, z: &mut Self::State, y: &f32, _: &Self::Input, _: f32, dt: f32) -> Status {
        let (parameters, z) = (self.parameters.as_ptr(), z.as_mut_slice().as_mut_ptr());
        // SAFETY: a function pointer whose result is a word; the arrays are as long as the
        // function's structs.
        let (status, instructions) =
            unsafe { count(self.function, |function| function(parameters, z, *y, dt)) };
        record(instructions, self.function as *const ());
        if status == 0 { Status::Updated } else { Status::Predicted }
    }

    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [f32] {
        z.as_slice()
    }

    fn innovation(&self, _: f32, z: &Self::State, y: &f32, _: &Self::Input) -> f32 {
        y - z[0]
    }
}

/// The zoh observer in C: gains and period.
#[derive(Clone, Copy)]
struct PlainZoh {
    parameters: [f32; 3],
}

impl Observer<f32> for PlainZoh {
    /// The crate's, so that all its bits compare; the time that a correction is for is kept here.
    type State = State<f32, Zoh2>;
    type Measurement = f32;
    type Input = SVector<f32, 0>;
    const TIMING: Timing = Timing::Current;
    const ESTIMATED: usize = 2;

    fn initial(&self) -> Self::State {
        Memory::zero()
    }

    fn correct(&self, z: &mut Self::State, y: &f32, _: f32) -> Status {
        let (parameters, x) = (self.parameters.as_ptr(), z.law.x_hat.as_mut_slice().as_mut_ptr());
        let function: unsafe extern "C" fn(*const f32, *mut f32, f32) -> u32 = plain_zoh2_correct;
        // SAFETY: as above.
        let (status, instructions) =
            unsafe { count(function, |function| function(parameters, x, *y)) };
        record_first(instructions, function as *const ());
        if status != 0 {
            return Status::Predicted;
        }
        z.elapsed = 0.0;
        Status::Updated
    }

    fn advance(&self, z: &mut Self::State, _: &f32, _: &Self::Input, _: f32, dt: f32) -> Status {
        let (parameters, x) = (self.parameters.as_ptr(), z.law.x_hat.as_mut_slice().as_mut_ptr());
        let function: unsafe extern "C" fn(*const f32, *mut f32) -> u32 = plain_zoh2_predict;
        // SAFETY: as above.
        let (_, instructions) = unsafe { count(function, |function| function(parameters, x)) };
        record(instructions, function as *const ());
        z.elapsed += dt;
        Status::Predicted
    }

    fn estimate<'a>(&self, z: &'a Self::State) -> &'a [f32] {
        z.law.x_hat.as_slice()
    }

    fn innovation(&self, _: f32, z: &Self::State, y: &f32, _: &Self::Input) -> f32 {
        y - z.law.x_hat[0]
    }
}

/// K of the zoh case, computed beforehand, and its period.
fn zoh_parameters() -> Result<[f32; 3], DesignError> {
    let (law, dt) = (<Zoh2 as Case<f32>>::observer(|number| number as f32)?.law, 4e-4);
    let poles = law.poles(Placement::Exact)?;
    let k = law.gains(Placement::Exact, &poles, &Memory::zero(), &0.0, dt);
    Ok([k[0], k[1], dt])
}

/// Run and report them all.
pub fn report(out: &mut Console) -> fmt::Result {
    let ell = 1.0_f32 / 0.01;
    let parameters = [2.0 * ell, 2.0 * (ell * ell)];
    let standard: PlainC<2, 2> = PlainC { parameters, function: plain_standard2 };
    beside::<Standard2, _>(out, "C standard", &standard, standard.initial())?;

    let zoh = PlainZoh { parameters: zoh_parameters().map_err(|_| fmt::Error)? };
    let z0 = <Zoh2 as Case<f32>>::scenario().map_err(|_| fmt::Error)?.z0;
    beside::<Zoh2, _>(out, "C standard, zoh", &zoh, z0)?;

    let (alpha, beta) = ([3.0_f32, 3.0, 3.0, 3.0, 2.0], [8.5714_f32, 3.2122, 1.4267, 0.5347]);
    let ell = 7.0;
    let mut parameters = [3.0; 10];
    for (slot, a) in parameters.iter_mut().zip(alpha) {
        *slot = a * ell;
    }
    for (slot, b) in parameters.iter_mut().skip(5).zip(beta) {
        *slot = b * (ell * ell);
    }
    let low_power: PlainC<10, 9> = PlainC { parameters, function: plain_low_power5 };
    beside::<LowPower5, _>(out, "C low-power", &low_power, low_power.initial())?;

    let b = 0.183_f32;
    let parameters = [2.0, 2.0, 10.0, 0.0025, 1.0 - (b + b), 1.9];
    let adaptive: PlainC<6, 3> = PlainC { parameters, function: plain_adaptive2 };
    beside::<Adaptive2, _>(out, "C adaptive", &adaptive, SVector::from([1.0, 0.0, 1.0]))
}
