//! Printing and leaving by semihosting: a processor without devices asks its debugger.

use crate::chip::semihosting;
use core::fmt;

const WRITE0: usize = 0x04;
const EXIT_EXTENDED: usize = 0x20;
const APPLICATION_EXIT: usize = 0x2_0026;

/// Bytes of one call; the last one is the end of the text.
const PIECE: usize = 64;

/// What is written here QEMU prints.
pub struct Console;

impl fmt::Write for Console {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for piece in text.as_bytes().chunks(PIECE - 1) {
            let mut ended = [0_u8; PIECE];
            for (to, from) in ended.iter_mut().zip(piece) {
                *to = *from;
            }
            // SAFETY: the operation reads up to the first zero.
            unsafe { semihosting(WRITE0, ended.as_ptr().cast()) };
        }
        Ok(())
    }
}

/// End the simulation with an exit status.
pub fn exit(status: usize) -> ! {
    let block = [APPLICATION_EXIT, status];
    // SAFETY: the operation reads two words.
    unsafe { semihosting(EXIT_EXTENDED, block.as_ptr().cast()) };
    #[expect(clippy::empty_loop, reason = "the simulation has ended")]
    loop {}
}
