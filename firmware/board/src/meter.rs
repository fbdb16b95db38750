//! Counts the instructions of a step and finds how deep its stack went.
//!
//! QEMU under `-icount shift=10` takes 1024 ns an instruction, and a timer of the chip runs with it,
//! so that a difference of two readings is an exact count.
//! What is counted is what the caller pays: from the function's first instruction to its return.

use crate::chip::{instructions, now, stack_pointer};
use cases::Instrument;
use core::hint::black_box;
use core::ptr::{read_volatile, write_volatile};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use hgo_rs::schedule::Schedule;
use hgo_rs::{Observer, Scalar, Status, Timing};

/// Bytes below the stack pointer that are painted, every how many steps, and with what.
const PAINTED: usize = 8192;
const PAINT_EVERY: u32 = 64;
const PAINT: u32 = 0xC0DE_50DA;

/// What was seen of one case.
pub struct Counter {
    /// Steps that were counted.
    pub steps: u32,
    /// Instructions of all steps.
    pub total: u32,
    /// Of the longest step.
    pub most: u32,
    /// Deepest stack in bytes.
    pub stack: u32,
    /// Address of the step's function, and of its first half's, 0 if there is none.
    pub step: u32,
    pub first: u32,
    /// Address of the clock's function, 0 if it was not called.
    pub clock: u32,
}

static STEPS: AtomicU32 = AtomicU32::new(0);
static TOTAL: AtomicU32 = AtomicU32::new(0);
static MOST: AtomicU32 = AtomicU32::new(0);
static STACK: AtomicU32 = AtomicU32::new(0);
static STEP: AtomicU32 = AtomicU32::new(0);
static FIRST: AtomicU32 = AtomicU32::new(0);
static CLOCK: AtomicU32 = AtomicU32::new(0);
/// Instructions of the clock and of a step's first half since the last step.
static TICKED: AtomicU32 = AtomicU32::new(0);
static CALLS: AtomicU32 = AtomicU32::new(0);

unsafe extern "C" {
    fn hgo_one_instruction();
}

/// Forget what was seen.
pub fn reset() {
    for cell in [&STEPS, &TOTAL, &MOST, &STACK, &STEP, &FIRST, &CLOCK, &TICKED, &CALLS] {
        cell.store(0, Relaxed);
    }
}

/// What was seen since the last reset.
pub fn read() -> Counter {
    Counter {
        steps: STEPS.load(Relaxed),
        total: TOTAL.load(Relaxed),
        most: MOST.load(Relaxed),
        stack: STACK.load(Relaxed),
        step: STEP.load(Relaxed),
        first: FIRST.load(Relaxed),
        clock: CLOCK.load(Relaxed),
    }
}

/// Make the call `call(function)`, count its instructions and look at its stack.
///
/// The call is made twice, by the same machine code: first with a function of one instruction in
/// the place of `function`, which gives what the measurement itself costs.
///
/// # Safety
/// F is a function pointer whose result may be any bits.
pub unsafe fn count<F: Copy, R>(function: F, mut call: impl FnMut(F) -> R) -> (R, u32) {
    let one = hgo_one_instruction as unsafe extern "C" fn();
    // SAFETY: F is a function pointer by this function's contract, and as large as `one`.
    let one = unsafe { core::mem::transmute_copy::<_, F>(&one) };
    let (_, of_one) = timed(one, false, &mut call);
    let paint = CALLS.fetch_add(1, Relaxed) % PAINT_EVERY == 0;
    let (result, ticks) = timed(function, paint, &mut call);
    (result, instructions(ticks.wrapping_sub(of_one)) + 1)
}

/// A call and its ticks, with the stack below it painted before if so wanted, and looked at after.
#[inline(never)]
fn timed<F: Copy, R>(function: F, paint: bool, call: &mut impl FnMut(F) -> R) -> (R, u32) {
    let function = black_box(function);
    let lowest = (stack_pointer() - PAINTED) as *mut u32;
    if paint {
        for i in 0..PAINTED / 4 {
            // SAFETY: below the stack pointer, within the stack's memory; nothing lives there.
            unsafe { write_volatile(lowest.add(i), PAINT) };
        }
    }
    let before = now();
    let result = call(function);
    let ticks = now().wrapping_sub(before);
    if paint {
        let mut untouched = 0;
        // SAFETY: as above.
        while untouched < PAINTED / 4 && unsafe { read_volatile(lowest.add(untouched)) } == PAINT {
            untouched += 1;
        }
        STACK.fetch_max((PAINTED - 4 * untouched) as u32, Relaxed);
    }
    (result, ticks)
}

/// Take down a step of so many instructions by the function at `address`.
pub fn record(instructions: u32, address: *const ()) {
    let count = instructions + TICKED.swap(0, Relaxed);
    STEPS.fetch_add(1, Relaxed);
    TOTAL.fetch_add(count, Relaxed);
    MOST.fetch_max(count, Relaxed);
    STEP.store(address as u32, Relaxed);
}

/// Take down the first half of a step, which the second half's [`record`] ends.
pub fn record_first(instructions: u32, address: *const ()) {
    TICKED.fetch_add(instructions, Relaxed);
    FIRST.store(address as u32, Relaxed);
}

/// The instrument of the cases on the board.
pub struct Meter;

/// What is counted: a step as a user's program calls it, or its two halves where it has two. The
/// status is a number, so that a function of one instruction can stand in for it.
#[inline(never)]
fn advance<T: Scalar, O: Observer<T>>(
    observer: &O,
    z: &mut O::State,
    y: &O::Measurement,
    u: &O::Input,
    t: T,
    dt: T,
) -> u8 {
    observer.advance(z, y, u, t, dt) as u8
}

#[inline(never)]
fn correct<T: Scalar, O: Observer<T>>(
    observer: &O,
    z: &mut O::State,
    y: &O::Measurement,
    t: T,
) -> u8 {
    observer.correct(z, y, t) as u8
}

type Advance<T, O> = fn(
    &O,
    &mut <O as Observer<T>>::State,
    &<O as Observer<T>>::Measurement,
    &<O as Observer<T>>::Input,
    T,
    T,
) -> u8;

type Correct<T, O> =
    fn(&O, &mut <O as Observer<T>>::State, &<O as Observer<T>>::Measurement, T) -> u8;

const fn status(number: u8) -> Status {
    match number {
        0 => Status::Updated,
        1 => Status::Predicted,
        _ => Status::ModelUndefined,
    }
}

#[inline(never)]
fn dt<T: Scalar, S: Schedule<T>>(schedule: &S, k: u64) -> T {
    schedule.dt(k)
}

impl<T: Scalar> Instrument<T> for Meter {
    fn correct<O: Observer<T>>(observer: &O, z: &mut O::State, y: &O::Measurement, t: T) -> Status {
        if O::TIMING == Timing::Predictor {
            return observer.correct(z, y, t); // no half of a step: nothing moves
        }
        let function: Correct<T, O> = correct::<T, O>;
        // SAFETY: a function pointer; any byte is a result.
        let (number, instructions) =
            unsafe { count(function, |correct| correct(observer, z, y, t)) };
        record_first(instructions, function as *const ());
        status(number)
    }

    fn advance<O: Observer<T>>(
        observer: &O,
        z: &mut O::State,
        y: &O::Measurement,
        u: &O::Input,
        t: T,
        dt: T,
    ) -> Status {
        let function: Advance<T, O> = advance::<T, O>;
        // SAFETY: a function pointer; any byte is a result.
        let (number, instructions) =
            unsafe { count(function, |advance| advance(observer, z, y, u, t, dt)) };
        record(instructions, function as *const ());
        status(number)
    }

    /// The next length is asked for before the step that it is of.
    fn dt<S: Schedule<T>>(schedule: &S, k: u64) -> T {
        let function: fn(&S, u64) -> T = dt::<T, S>;
        // SAFETY: a function pointer; any bits are a number.
        let (value, instructions) = unsafe { count(function, |dt| dt(schedule, k)) };
        TICKED.store(instructions, Relaxed);
        CLOCK.store(function as *const () as u32, Relaxed);
        value
    }
}
