//! Observers over records as a WebAssembly module without imports: what a page computes with.
//!
//! An observer comes as numbers (`hgo_ir::live`): its step is a program for the core's interpreter, so that
//! any law and any model of the user's runs here, with the bits of every other engine. All arrays are of
//! f64, in memory that [`room`] gives.
//!
//! # Floors
//!
//! `numbers`, `spectrum` (0); `gains` (1); `record` (2); `linear` (3).

// A plain C interface: its pointers are what a page hands over.
#![allow(unsafe_code)]

mod gains;
mod linear;
mod numbers;
mod record;
mod spectrum;

use linear::Linear;
use nalgebra::DMatrix;
use numbers::Live;
use record::{Clock, Record, Running};

/// Room for so many numbers, all 0. It is the caller's until [`give_back`].
#[unsafe(no_mangle)]
pub extern "C" fn room(count: usize) -> *mut f64 {
    Box::into_raw(vec![0.0; count].into_boxed_slice()).cast()
}

/// Give back room.
///
/// # Safety
/// What [`room`] gave for the same count, and once.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn give_back(numbers: *mut f64, count: usize) {
    // SAFETY: as the caller says
    drop(unsafe { Box::from_raw(std::ptr::slice_from_raw_parts_mut(numbers, count)) });
}

/// # Safety
/// `count` numbers are there; with 0 of them any pointer will do.
unsafe fn given<'a>(numbers: *const f64, count: usize) -> &'a [f64] {
    if count == 0 {
        return &[];
    }
    // SAFETY: as the caller says
    unsafe { std::slice::from_raw_parts(numbers, count) }
}

/// # Safety
/// As [`given`], and nothing else refers to them.
unsafe fn taken<'a>(numbers: *mut f64, count: usize) -> &'a mut [f64] {
    if count == 0 {
        return &mut [];
    }
    // SAFETY: as the caller says
    unsafe { std::slice::from_raw_parts_mut(numbers, count) }
}

/// An observer from its numbers; null where they are none of one. It stays.
///
/// # Safety
/// `count` numbers are there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn observer(numbers: *const f64, count: usize) -> *mut Live {
    // SAFETY: as the caller says
    let numbers = unsafe { given(numbers, count) };
    Live::read(numbers).map_or(std::ptr::null_mut(), |live| Box::into_raw(Box::new(live)))
}

/// Estimates (N, n) and innovations (N,) of an observer at a gain, over N samples at the times t, or at multiples
/// of `period` where t is null, from a memory on. Gives how many samples have finite estimates, −1 where the law
/// refuses the gain.
///
/// # Safety
/// `live` is an [`observer`]; `t`, `y` and `e` have N numbers, `u` has N n_u, `memory` has m and `x_hat` N n.
#[unsafe(no_mangle)]
#[allow(clippy::too_many_arguments)]
pub unsafe extern "C" fn run(
    live: *const Live,
    ell: f64,
    samples: usize,
    t: *const f64,
    period: f64,
    y: *const f64,
    u: *const f64,
    memory: *const f64,
    x_hat: *mut f64,
    e: *mut f64,
) -> f64 {
    // SAFETY: as the caller says
    let (live, record, memory, x_hat, e) = unsafe {
        let live = &*live;
        let clock =
            if t.is_null() { Clock::Period(period) } else { Clock::Times(given(t, samples)) };
        let record = Record { clock, y: given(y, samples), u: given(u, samples * live.n_u) };
        let out = (taken(x_hat, samples * live.n), taken(e, samples));
        (live, record, given(memory, live.memory()), out.0, out.1)
    };
    match Running::new(live, ell) {
        Some(running) => running.over(record, memory, x_hat, e) as f64,
        None => -1.0,
    }
}

/// A law at gain 1, and the memory that follows a chain, as if its gain were `ell` and its step `dt`.
fn linear_of(unit: &Live, ell: f64, dt: f64) -> Option<Linear> {
    let size = unit.memory() - usize::from(unit.current);
    Some(Linear::new(&Running::new(unit, 1.0)?, unit.n, size, ell, dt))
}

/// What an observer does at a gain and a step, of its law at gain 1 without a model: the spectral radius of the
/// step, the samples of a decay, then for each estimate, n numbers each, the variance per unit variance of
/// noise, the variance per unit density of model error, and the cutoff [rad/s], this with `cutoffs`; NaN where
/// the step is not stable. 0 where the law refuses.
///
/// # Safety
/// `unit` is an [`observer`] without inputs; `lift` (m, n), m without the time that a filter holds; `out` has
/// 2 + 3 n numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn figures(
    unit: *const Live,
    ell: f64,
    dt: f64,
    lift: *const f64,
    cutoffs: u32,
    out: *mut f64,
) -> u32 {
    // SAFETY: as the caller says
    let (unit, lift, out) = unsafe {
        let unit = &*unit;
        let size = unit.memory() - usize::from(unit.current);
        (unit, given(lift, size * unit.n), taken(out, 2 + 3 * unit.n))
    };
    let Some(linear) = linear_of(unit, ell, dt) else { return 0 };
    out.fill(f64::NAN);
    out[0] = linear.radius();
    if out[0] < 1.0 {
        let lift = DMatrix::from_row_slice(lift.len() / unit.n.max(1), unit.n, lift);
        out[1] = linear.decay() as f64;
        out[2..2 + unit.n].copy_from_slice(&linear.noise());
        out[2 + unit.n..2 + 2 * unit.n].copy_from_slice(&linear.model(&lift));
        if cutoffs > 0 {
            out[2 + 2 * unit.n..].copy_from_slice(&linear.bandwidth());
        }
    }
    1
}

/// Responses of all estimates to y at frequencies [rad/s], (frequencies, n, 2): real and imaginary parts. 0
/// where the law refuses.
///
/// # Safety
/// `unit` is an [`observer`] without inputs; `omega` has `count` numbers, `out` 2 n times as many.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn bode(
    unit: *const Live,
    ell: f64,
    dt: f64,
    omega: *const f64,
    count: usize,
    out: *mut f64,
) -> u32 {
    // SAFETY: as the caller says
    let (unit, omega, out) = unsafe {
        let unit = &*unit;
        (unit, given(omega, count), taken(out, 2 * unit.n * count))
    };
    let Some(linear) = linear_of(unit, ell, dt) else { return 0 };
    for (rows, omega) in out.chunks_exact_mut(2 * unit.n).zip(omega) {
        for (slot, of) in rows.chunks_exact_mut(2).zip(linear.bode(*omega)) {
            slot.copy_from_slice(&[of.re, of.im]);
        }
    }
    1
}

/// Errors of all estimates after a start with x̂₁ wrong by 1, (samples, n). 0 where the law refuses.
///
/// # Safety
/// `unit` is an [`observer`] without inputs; `out` has n `samples` numbers.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn decay(
    unit: *const Live,
    ell: f64,
    dt: f64,
    samples: usize,
    out: *mut f64,
) -> u32 {
    // SAFETY: as the caller says
    let (unit, out) = unsafe {
        let unit = &*unit;
        (unit, taken(out, unit.n * samples))
    };
    let Some(linear) = linear_of(unit, ell, dt) else { return 0 };
    out.copy_from_slice(&linear.errors(samples));
    1
}

/// One-sided spectral density of samples, see [`spectrum`]: `length`/2 + 1 numbers, `length` a power of two.
///
/// # Safety
/// `values` has `count` numbers, `out` `length`/2 + 1.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn density(
    values: *const f64,
    count: usize,
    length: usize,
    dt: f64,
    out: *mut f64,
) {
    // SAFETY: as the caller says
    let (values, out) = unsafe { (given(values, count), taken(out, length / 2 + 1)) };
    out.copy_from_slice(&spectrum::density(values, length, dt));
}
