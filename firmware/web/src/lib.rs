//! The cases as a WebAssembly module without imports: `run(i)` runs the i-th one, and the digest
//! and the name of what ran are read back by `digest()`, `name()` and `name_length()`.
#![no_std]

use cases::{Case, Plain, Visitor, run as run_case, visit_all};
use core::sync::atomic::{AtomicPtr, AtomicU32, AtomicU64, AtomicUsize, Ordering::Relaxed};
use hgo_rs::Scalar;

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    core::arch::wasm32::unreachable()
}

static DIGEST: AtomicU64 = AtomicU64::new(0);
static NAME: AtomicPtr<u8> = AtomicPtr::new(core::ptr::null_mut());
static LENGTH: AtomicUsize = AtomicUsize::new(0);
static BITS: AtomicU32 = AtomicU32::new(0);

/// Runs the case with the index `wanted`.
struct One {
    wanted: u32,
    seen: u32,
    done: bool,
}

impl Visitor for One {
    fn visit<T: Scalar, C: Case<T>>(&mut self, scalar: &'static str) {
        if self.seen == self.wanted
            && let Ok(digest) = run_case::<T, C, Plain>()
        {
            DIGEST.store(digest.hash, Relaxed);
            NAME.store(C::SYMBOL.as_ptr().cast_mut(), Relaxed);
            LENGTH.store(C::SYMBOL.len(), Relaxed);
            BITS.store(if scalar == "f32" { 32 } else { 64 }, Relaxed);
            self.done = true;
        }
        self.seen += 1;
    }
}

/// Run case `i`; 1 if there is one and it ran, else 0.
#[unsafe(no_mangle)]
pub extern "C" fn run(i: u32) -> u32 {
    let mut one = One { wanted: i, seen: 0, done: false };
    visit_all(&mut one);
    one.done.into()
}

/// The digest of the last run.
#[unsafe(no_mangle)]
pub extern "C" fn digest() -> u64 {
    DIGEST.load(Relaxed)
}

/// The precision of the last run: 32 or 64.
#[unsafe(no_mangle)]
pub extern "C" fn bits() -> u32 {
    BITS.load(Relaxed)
}

/// Where the last case's name lies in memory.
#[unsafe(no_mangle)]
pub extern "C" fn name() -> *const u8 {
    NAME.load(Relaxed)
}

/// Its length in bytes.
#[unsafe(no_mangle)]
pub extern "C" fn name_length() -> usize {
    LENGTH.load(Relaxed)
}
