//! What differs from processor to processor: where a program starts, the counter that QEMU moves
//! with each instruction, the call of the debugger, and a function of one instruction.

#[cfg(target_arch = "arm")]
#[path = "cortex_m.rs"]
mod here;

#[cfg(target_arch = "aarch64")]
#[path = "aarch64.rs"]
mod here;

#[cfg(target_arch = "riscv32")]
#[path = "riscv.rs"]
mod here;

pub use here::*;
