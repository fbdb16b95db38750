//! Observers in plain C: see `../c/plain.c`.

use crate::beside::beside;
use crate::debugger::Console;
use crate::meter::{count, record};
use cases::{Adaptive2, LowPower5, Standard2};
use core::fmt;
use hgo_rs::nalgebra::SVector;
use hgo_rs::{Observer, Status, Timing};

/// Parameters and memory are rows of floats in C's structs too: see `../c/plain.h`.
type Function = unsafe extern "C" fn(*const f32, *mut f32, f32, f32) -> u32;

unsafe extern "C" {
    fn plain_standard2(parameters: *const f32, x: *mut f32, y: f32, dt: f32) -> u32;
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

/// Run and report them all.
pub fn report(out: &mut Console) -> fmt::Result {
    let ell = 1.0_f32 / 0.01;
    let parameters = [2.0 * ell, 2.0 * (ell * ell)];
    let standard: PlainC<2, 2> = PlainC { parameters, function: plain_standard2 };
    beside::<Standard2, _>(out, "C standard", &standard, standard.initial())?;

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
