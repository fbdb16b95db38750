//! Cortex-A53 on QEMU's machine `virt`, at exception level 1 with the MMU off.

use core::arch::{asm, global_asm};

// The floating-point unit is off at reset.
global_asm!(
    ".section .text.start, \"ax\"",
    ".global _start",
    "_start:",
    "mrs x0, cpacr_el1",
    "orr x0, x0, #(3 << 20)",
    "msr cpacr_el1, x0",
    "isb",
    "adrp x0, stack_top",
    "add x0, x0, :lo12:stack_top",
    "mov sp, x0",
    "b {report}",
    ".section .text.hgo_one_instruction, \"ax\"",
    ".global hgo_one_instruction",
    ".type hgo_one_instruction, %function",
    "hgo_one_instruction:",
    "ret",
    ".size hgo_one_instruction, 4",
    ".text",
    report = sym crate::report,
);

/// The counter of the generic timer.
#[inline(always)]
pub fn now() -> u32 {
    let ticks: u64;
    // SAFETY: reads a register that every exception level may read.
    unsafe { asm!("mrs {}, cntvct_el0", out(reg) ticks) };
    ticks as u32 // a step is shorter than 2^32 ticks
}

/// The instructions of a difference of two readings: the timer runs at 62.5 MHz, 64 ticks in the
/// 1024 ns of an instruction.
pub fn instructions(ticks: u32) -> u32 {
    (ticks + 32) / 64
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
    unsafe { asm!("hlt 0xf000", inout("x0") operation => _, in("x1") argument) };
}
