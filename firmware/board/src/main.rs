//! The cases on a Cortex-M, one line each by semihosting:
//! `row <observer>|<n>|<scalar>|<digest>|<samples>|<instructions>|<most>|<stack>|<step>|<clock>`:
//! instructions of all steps and of the longest one, deepest stack of a step in bytes, addresses
//! of the step's function and of the clock's (0: none).
#![no_std]
#![no_main]

mod meter;

use cases::{Case, Visitor, run, visit_all};
use core::fmt::Write;
use cortex_m_rt::entry;
use cortex_m_semihosting::debug::{EXIT_FAILURE, EXIT_SUCCESS, exit};
use cortex_m_semihosting::hio::{HostStream, hstdout};
use hgo_rs::Scalar;
use meter::{Counter, Meter};

/// Formatting and semihosting may panic; the observers cannot (see `proof/`).
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    exit(EXIT_FAILURE);
    loop {}
}

struct Rows {
    out: HostStream,
    refused: bool,
}

impl Visitor for Rows {
    fn visit<T: Scalar, C: Case<T>>(&mut self, scalar: &'static str) {
        meter::reset();
        let Ok(digest) = run::<T, C, Meter>() else {
            self.refused = true;
            return;
        };
        let Counter { total, most, stack, step, clock } = meter::read();
        let written = writeln!(
            self.out,
            "row {}|{}|{}|{:016x}|{}|{}|{}|{}|{:x}|{:x}",
            C::NAME,
            C::N,
            scalar,
            digest.hash,
            digest.samples,
            total,
            most,
            stack,
            step,
            clock
        );
        self.refused |= written.is_err();
    }
}

#[entry]
fn main() -> ! {
    meter::start();
    let mut refused = true;
    if let Ok(out) = hstdout() {
        let mut rows = Rows { out, refused: false };
        visit_all(&mut rows);
        refused = rows.refused;
    }
    exit(if refused { EXIT_FAILURE } else { EXIT_SUCCESS });
    loop {}
}
