//! RV32IMAFC on QEMU's machine `virt`, in machine mode.

use core::arch::{asm, global_asm};

// The floating-point unit is off at reset: mstatus.FS.
global_asm!(
    ".section .text.start, \"ax\"",
    ".global _start",
    "_start:",
    "li t0, 0x6000",
    "csrs mstatus, t0",
    "la sp, stack_top",
    "tail {report}",
    ".section .text.hgo_one_instruction, \"ax\"",
    ".global hgo_one_instruction",
    ".type hgo_one_instruction, @function",
    "hgo_one_instruction:",
    "ret",
    ".size hgo_one_instruction, . - hgo_one_instruction",
    ".text",
    report = sym crate::report,
);

/// The counter of cycles.
#[inline(always)]
pub fn now() -> u32 {
    let ticks: u32;
    // SAFETY: reads a counter.
    unsafe { asm!("csrr {}, mcycle", out(reg) ticks) };
    ticks
}

/// The instructions of a difference of two readings: QEMU counts a cycle for each of the 1024 ns of
/// an instruction.
pub fn instructions(ticks: u32) -> u32 {
    (ticks + 512) / 1024
}

/// Where the stack ends now.
#[inline(always)]
pub fn stack_pointer() -> usize {
    let bottom: usize;
    // SAFETY: reads a register.
    unsafe { asm!("mv {}, sp", out(reg) bottom, options(nomem, nostack)) };
    bottom
}

/// Call the debugger, which is QEMU. It knows the call by the two instructions around it, which
/// lie, uncompressed, in one page with it.
///
/// # Safety
/// `argument` is what the semihosting operation takes.
pub unsafe fn semihosting(operation: usize, argument: *const ()) {
    // SAFETY: by this function's contract.
    unsafe {
        asm!(
            ".balign 16",
            ".option push",
            ".option norvc",
            "slli x0, x0, 0x1f",
            "ebreak",
            "srai x0, x0, 7",
            ".option pop",
            inout("a0") operation => _,
            in("a1") argument,
        );
    }
}
