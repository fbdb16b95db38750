//! Cortex-M on QEMU's MPS2 boards.

use core::arch::{asm, global_asm};
use core::ptr::{read_volatile, write_volatile};

/// CMSDK timer 0: control, value, reload.
const TIMER: *mut u32 = 0x4000_0000 as *mut u32;

global_asm!(
    ".global hgo_one_instruction",
    ".type hgo_one_instruction, %function",
    ".thumb_func",
    "hgo_one_instruction:",
    "bx lr",
);

#[cortex_m_rt::entry]
fn main() -> ! {
    // SAFETY: the board's timer lies there; it counts down from 2^32 − 1, again and again.
    unsafe {
        write_volatile(TIMER.add(2), u32::MAX);
        write_volatile(TIMER.add(1), u32::MAX);
        write_volatile(TIMER, 1);
    }
    crate::report()
}

/// The counter, counting up.
#[inline(always)]
pub fn now() -> u32 {
    // SAFETY: the board's timer lies there.
    0_u32.wrapping_sub(unsafe { read_volatile(TIMER.add(1)) })
}

/// The instructions of a difference of two readings: the timer runs at 25 MHz, 25.6 ticks in the
/// 1024 ns of an instruction.
pub fn instructions(ticks: u32) -> u32 {
    (10 * ticks + 128) / 256
}

/// Where the stack ends now.
#[inline(always)]
pub fn stack_pointer() -> usize {
    let bottom: usize;
    // SAFETY: reads a register.
    unsafe { asm!("mov {}, sp", out(reg) bottom, options(nomem, nostack)) };
    bottom
}

/// Call the debugger, which is QEMU.
///
/// # Safety
/// `argument` is what the semihosting operation takes.
pub unsafe fn semihosting(operation: usize, argument: *const ()) {
    // SAFETY: by this function's contract.
    unsafe { asm!("bkpt 0xab", inout("r0") operation => _, in("r1") argument) };
}
