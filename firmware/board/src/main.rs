//! The cases on a bare processor, one line each by semihosting:
//! `row <case>|<observer>|<n>|<scalar>|<digest>|<samples>|<steps>|<instructions>|<most>|<stack>|<step>|<first>|<clock>`:
//! instructions of all steps and of the longest one, deepest stack of a step in bytes, addresses
//! of the step's function, of its first half's and of the clock's (0: none).
#![no_std]
#![no_main]

mod beside;
mod chip;
mod debugger;
mod meter;
#[cfg(target_arch = "arm")]
mod plain;

use cases::{Case, Digest, Visitor, run, visit_all};
use core::fmt::Write;
use debugger::{Console, exit};
use hgo_rs::Scalar;
use meter::{Counter, Meter};

/// Formatting and semihosting may panic; the observers cannot (see `proof/`).
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    exit(1)
}

/// Report a run: who, its digest, and what the meter saw.
fn row(
    out: &mut Console,
    (symbol, name, n, scalar): (&str, &str, usize, &str),
    digest: Digest,
) -> core::fmt::Result {
    let Counter { steps, total, most, stack, step, first, clock } = meter::read();
    let Digest { hash, samples } = digest;
    writeln!(
        out,
        "row {symbol}|{name}|{n}|{scalar}|{hash:016x}|{samples}|{steps}|{total}|{most}|{stack}|{step:x}|{first:x}|{clock:x}"
    )
}

struct Rows {
    out: Console,
    refused: bool,
}

impl Visitor for Rows {
    fn visit<T: Scalar, C: Case<T>>(&mut self, scalar: &'static str) {
        meter::reset();
        let Ok(digest) = run::<T, C, Meter>() else {
            self.refused = true;
            return;
        };
        self.refused |= row(&mut self.out, (C::SYMBOL, C::NAME, C::N, scalar), digest).is_err();
    }
}

/// Run and report everything, then end the simulation: what `chip` calls after a reset.
pub extern "C" fn report() -> ! {
    let mut rows = Rows { out: Console, refused: false };
    visit_all(&mut rows);
    rows.refused |= beside::report(&mut rows.out).is_err();
    exit(usize::from(rows.refused))
}
