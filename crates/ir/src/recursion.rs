//! Floor 4. Observers whose types are chosen at run time, and their steps over a block of samples.

use crate::error::Result;
use crate::table::Table;
use hgo_rs::observer::Status;

/// A law in discrete time, with its memory as a flat vector. The verbs are [`Observer`](hgo_rs::observer::Observer)'s.
pub trait Recursion: Send + Sync {
    /// Use the sample of time t.
    fn correct(&self, memory: &mut [f64], y: &[f64], t: f64) -> Result<Status>;
    /// Move from time t over dt; with predictor timing by the sample of t.
    fn advance(&self, memory: &mut [f64], y: &[f64], u: &[f64], t: f64, dt: f64) -> Result<Status>;
    /// Step over a block; gives the largest magnitude of a memory's entry, NaN where one is not finite.
    fn over_block(&self, memory: &mut [f64], block: Block<'_>) -> Result<f64>;
}

/// Any observer.
pub trait AnyObserver: Send + Sync {
    /// Estimated states.
    fn n(&self) -> usize;
    /// Measured outputs.
    fn n_y(&self) -> usize;
    /// Known inputs.
    fn n_u(&self) -> usize;
    /// Whether the estimate at k uses y(k).
    fn is_current(&self) -> bool;
    /// Memory to start from when nothing is known.
    fn initial(&self) -> Vec<f64>;
    /// A memory with its estimates at first samples; false where the law has no such start.
    fn begin(&self, memory: &mut [f64], y: &[f64]) -> Result<bool>;
    /// Its steps.
    fn recursion(&self) -> &dyn Recursion;
    /// The same as one table, if it is one.
    fn tabled(&self) -> Option<&dyn Tabled> {
        None
    }
}

/// Numbers of a record's rows.
#[derive(Clone, Copy, Debug)]
pub struct Widths {
    /// Entries of the memory.
    pub memory: usize,
    /// Entries of a sample.
    pub n_y: usize,
    /// Known inputs.
    pub n_u: usize,
    /// Parameters and gains, which stand still.
    pub fixed: usize,
    /// Whether a row shows the memory after its sample.
    pub current: bool,
}

/// An observer whose way from sample to sample, where all are there, is one table.
pub trait Tabled: Recursion {
    /// What its rows hold.
    fn widths(&self) -> Widths;
    /// (t, dt, z, y, u, fixed) → (z⁺, innovation, and with current timing z after the correction).
    fn table(&self) -> Result<Table>;
    /// Whether the table takes the sample y, and all that follow in steps of this length.
    fn is_steady(&self, memory: &[f64], y: &[f64], dt: f64) -> bool;
    /// Parameters, and gains of corrections for steps of this length.
    fn fixed(&self, dt: f64) -> Vec<f64>;
}

/// Copies each sample as it is read, so that later changes by the caller have no effect. (The copy runs
/// beside the step, which waits for the one before it.)
pub struct Samples<'a> {
    given: &'a [f64],
    kept: &'a mut [f64],
}

impl<'a> Samples<'a> {
    /// As many of both.
    pub fn new(given: &'a [f64], kept: &'a mut [f64]) -> Self {
        Self { given, kept }
    }
    /// What is given, and where the copies go.
    pub fn parts(self) -> (&'a [f64], &'a mut [f64]) {
        (self.given, self.kept)
    }
    /// Sample number k of p entries.
    #[inline(always)]
    pub fn take(&mut self, k: usize, p: usize) -> &[f64] {
        let kept = &mut self.kept[k * p..(k + 1) * p];
        kept.iter_mut().zip(&self.given[k * p..(k + 1) * p]).for_each(|(kept, y)| *kept = *y);
        kept
    }
}

/// Some samples of a record, a row each. Every sample is to be taken.
pub struct Block<'a> {
    /// Times of the samples, in s.
    pub t: &'a [f64],
    /// Steps to the next samples; the last sample of a record has none.
    pub dt: &'a [f64],
    /// The samples.
    pub y: Samples<'a>,
    /// Inputs, held from each sample on.
    pub u: &'a [f64],
    /// The memory at each sample: before its use, or after it if the law filters.
    pub memory: &'a mut [f64],
    /// Empty where it is not asked for.
    pub innovation: &'a mut [f64],
    /// What became of each sample: [`Status`] as a number.
    pub status: &'a mut [u8],
}

/// The larger magnitude; NaN is passed over in `value`.
#[inline(always)]
pub fn larger(largest: f64, value: f64) -> f64 {
    if value.abs() > largest { value.abs() } else { largest }
}
