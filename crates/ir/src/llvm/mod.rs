//! Floor 11. Tables as LLVM IR: studies for vectors of runs, and records one sample after the other.

mod printer;
mod record;
mod study;

pub use record::{RecordSource, record_source};
pub use study::Source;

/// Sums of squares that bounds are watched by, so that none waits for the other.
pub const SUMS: usize = 2;
