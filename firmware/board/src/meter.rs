//! Counts the instructions of a step and finds how deep its stack went.
//!
//! QEMU under `-icount shift=10` takes 1024 ns an instruction, and the board's timer runs at
//! 25 MHz: 25.6 ticks an instruction, so that a difference of two readings is an exact count.
//! What is counted is what the caller pays: from the function's first instruction to its return.

use cases::Instrument;
use core::arch::asm;
use core::hint::black_box;
use core::ptr::{read_volatile, write_volatile};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use hgo_rs::schedule::Schedule;
use hgo_rs::{Observer, Scalar, Status};

/// CMSDK timer 0: control, value, reload.
const TIMER: *mut u32 = 0x4000_0000 as *mut u32;

/// Bytes below the stack pointer that are painted, every how many steps, and with what.
const PAINTED: usize = 8192;
const PAINT_EVERY: u32 = 64;
const PAINT: u32 = 0xC0DE_50DA;

/// What was seen of one case.
pub struct Counter {
    /// Instructions of all steps.
    pub total: u32,
    /// Of the longest step.
    pub most: u32,
    /// Deepest stack in bytes.
    pub stack: u32,
    /// Address of the step's function.
    pub step: u32,
    /// Address of the clock's function, 0 if it was not called.
    pub clock: u32,
}

static TOTAL: AtomicU32 = AtomicU32::new(0);
static MOST: AtomicU32 = AtomicU32::new(0);
static STACK: AtomicU32 = AtomicU32::new(0);
static STEP: AtomicU32 = AtomicU32::new(0);
static CLOCK: AtomicU32 = AtomicU32::new(0);
/// Instructions of the clock since the last step.
static TICKED: AtomicU32 = AtomicU32::new(0);
static CALLS: AtomicU32 = AtomicU32::new(0);

core::arch::global_asm!(
    ".global hgo_one_instruction",
    ".type hgo_one_instruction, %function",
    ".thumb_func",
    "hgo_one_instruction:",
    "bx lr",
);

unsafe extern "C" {
    fn hgo_one_instruction();
}

/// Start the timer: counting down from 2^32 − 1, again and again.
pub fn start() {
    // SAFETY: the board's timer lies there.
    unsafe {
        write_volatile(TIMER.add(2), u32::MAX);
        write_volatile(TIMER.add(1), u32::MAX);
        write_volatile(TIMER, 1);
    }
}

/// Forget what was seen.
pub fn reset() {
    for cell in [&TOTAL, &MOST, &STACK, &STEP, &CLOCK, &TICKED, &CALLS] {
        cell.store(0, Relaxed);
    }
}

/// What was seen since the last reset.
pub fn read() -> Counter {
    Counter {
        total: TOTAL.load(Relaxed),
        most: MOST.load(Relaxed),
        stack: STACK.load(Relaxed),
        step: STEP.load(Relaxed),
        clock: CLOCK.load(Relaxed),
    }
}

#[inline(always)]
fn now() -> u32 {
    // SAFETY: the board's timer lies there.
    unsafe { read_volatile(TIMER.add(1)) }
}

/// A call, timed and, every so often, with the stack below it painted: its result and ticks.
macro_rules! timed {
    ($function:expr, $paint:expr, $($argument:expr),+) => {{
        let function = black_box($function);
        let bottom: usize;
        // SAFETY: reads the stack pointer.
        unsafe { asm!("mov {}, sp", out(reg) bottom, options(nomem, nostack)) };
        let lowest = (bottom - PAINTED) as *mut u32;
        if $paint {
            for i in 0..PAINTED / 4 {
                // SAFETY: below the stack pointer, within the stack's memory; nothing lives there.
                unsafe { write_volatile(lowest.add(i), PAINT) };
            }
        }
        let before = now();
        let result = function($($argument),+);
        let ticks = before.wrapping_sub(now());
        if $paint {
            let mut i = 0;
            // SAFETY: as above.
            while i < PAINTED / 4 && unsafe { read_volatile(lowest.add(i)) } == PAINT {
                i += 1;
            }
            STACK.fetch_max((PAINTED - 4 * i) as u32, Relaxed);
        }
        (result, ticks)
    }};
}

/// Instructions in a call, from its ticks and those of a call of one instruction.
fn instructions(ticks: u32, of_one: u32) -> u32 {
    (10 * ticks.wrapping_sub(of_one) + 128) / 256 + 1
}

/// The instrument of the cases on the board.
pub struct Meter;

/// What is counted: a step as a user's program calls it. The status is a number so that a function
/// of one instruction can stand in for it.
#[inline(never)]
fn step<T: Scalar, O: Observer<T>>(
    observer: &O,
    z: &mut O::State,
    y: &O::Measurement,
    u: &O::Input,
    t: T,
    dt: T,
) -> u8 {
    observer.step(z, y, u, t, dt) as u8
}

type Step<T, O> = fn(
    &O,
    &mut <O as Observer<T>>::State,
    &<O as Observer<T>>::Measurement,
    &<O as Observer<T>>::Input,
    T,
    T,
) -> u8;

#[inline(never)]
fn timed_step<T: Scalar, O: Observer<T>>(
    function: Step<T, O>,
    paint: bool,
    observer: &O,
    z: &mut O::State,
    (y, u): (&O::Measurement, &O::Input),
    (t, dt): (T, T),
) -> (u8, u32) {
    timed!(function, paint, observer, z, y, u, t, dt)
}

#[inline(never)]
fn dt<T: Scalar, S: Schedule<T>>(schedule: &S, k: u64) -> T {
    schedule.dt(k)
}

#[inline(never)]
fn timed_dt<T: Scalar, S: Schedule<T>>(
    function: fn(&S, u64) -> T,
    paint: bool,
    schedule: &S,
    k: u64,
) -> (T, u32) {
    timed!(function, paint, schedule, k)
}

impl<T: Scalar> Instrument<T> for Meter {
    fn step<O: Observer<T>>(
        observer: &O,
        z: &mut O::State,
        y: &O::Measurement,
        u: &O::Input,
        t: T,
        dt: T,
    ) -> Status {
        // SAFETY: it takes nothing and returns at once; any byte is a result.
        let one: Step<T, O> =
            unsafe { core::mem::transmute(hgo_one_instruction as unsafe extern "C" fn()) };
        let paint = CALLS.fetch_add(1, Relaxed) % PAINT_EVERY == 0;
        let (_, of_one) = timed_step(one, false, observer, z, (y, u), (t, dt));
        let (status, ticks) = timed_step(step::<T, O>, paint, observer, z, (y, u), (t, dt));
        let count = instructions(ticks, of_one) + TICKED.swap(0, Relaxed);
        TOTAL.fetch_add(count, Relaxed);
        MOST.fetch_max(count, Relaxed);
        STEP.store(step::<T, O> as *const () as u32, Relaxed);
        match status {
            0 => Status::Updated,
            1 => Status::Predicted,
            _ => Status::ModelUndefined,
        }
    }

    fn dt<S: Schedule<T>>(schedule: &S, k: u64) -> T {
        // SAFETY: it takes nothing and returns at once; any bits are a number.
        let one: fn(&S, u64) -> T =
            unsafe { core::mem::transmute(hgo_one_instruction as unsafe extern "C" fn()) };
        let (_, of_one) = timed_dt(one, false, schedule, k);
        let paint = k % u64::from(PAINT_EVERY) == 0;
        let (value, ticks) = timed_dt(dt::<T, S>, paint, schedule, k);
        TICKED.store(instructions(ticks, of_one), Relaxed);
        CLOCK.store(dt::<T, S> as *const () as u32, Relaxed);
        value
    }
}
