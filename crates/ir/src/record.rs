//! Floor 5. Records by a compiled function, and by the interpreter where it stops.

use crate::error::Result;
use crate::recursion::{Block, Recursion, Samples, Tabled, Widths, larger};
use hgo_rs::observer::Status;
use std::sync::{Mutex, PoisonError};

/// Some samples of a record, as a compiled function takes them.
pub struct Stretch<'a> {
    /// The memory before the first of them; after the last that was taken.
    pub memory: &'a mut [f64],
    /// Times, in s.
    pub t: &'a [f64],
    /// The step to the next one, of all of them.
    pub dt: f64,
    /// A row a sample.
    pub y: &'a [f64],
    /// A row a sample.
    pub u: &'a [f64],
    /// Parameters and gains.
    pub fixed: &'a [f64],
    /// Memories to be shown, a row a sample.
    pub rows: &'a mut [f64],
    /// A row a sample.
    pub innovation: &'a mut [f64],
}

/// A compiled function that steps an observer over samples.
pub trait RecordKernel: Sync {
    /// How many samples it took, at most all. It stops before a sample that is missing, and before one
    /// after which the memory would not be finite.
    fn steps(&self, stretch: Stretch<'_>) -> usize;
}

/// An observer over records, with a compiled function.
pub struct Compiled<'a> {
    observer: &'a dyn Tabled,
    kernel: &'a dyn RecordKernel,
    /// What stands still, for steps of this length.
    fixed: Mutex<(f64, Vec<f64>)>,
}

impl<'a> Compiled<'a> {
    /// A function that was compiled from this observer's table.
    pub fn new(observer: &'a dyn Tabled, kernel: &'a dyn RecordKernel) -> Self {
        Self { observer, kernel, fixed: Mutex::new((f64::NAN, Vec::new())) }
    }
}

/// Samples that the interpreter takes before the function is tried again.
const RARE: usize = 8;
/// Steps of one length from which on the function is called: times such as 0.001 k differ in the last bit.
const ALIKE: usize = 32;

impl Recursion for Compiled<'_> {
    fn correct(&self, memory: &mut [f64], y: &[f64], t: f64) -> Result<Status> {
        self.observer.correct(memory, y, t)
    }

    fn advance(&self, memory: &mut [f64], y: &[f64], u: &[f64], t: f64, dt: f64) -> Result<Status> {
        self.observer.advance(memory, y, u, t, dt)
    }

    fn over_block(&self, memory: &mut [f64], block: Block<'_>) -> Result<f64> {
        let Block { t, dt, y, u, memory: rows, innovation, status } = block;
        let Widths { memory: m, n_y: p, n_u: q, .. } = self.observer.widths();
        let (given, kept) = y.parts();
        let told = innovation.len();
        let mut unwanted = vec![0.0; if told == 0 { t.len() * p } else { 0 }];
        let innovation = if told == 0 { &mut unwanted[..] } else { innovation };
        let mut fixed = self.fixed.lock().unwrap_or_else(PoisonError::into_inner);
        let (kept_for, fixed) = &mut *fixed;
        let (mut k, mut end, mut most) = (0, 0, 0.0);
        while k < t.len() {
            let from = dt.get(k..).unwrap_or_default();
            if end <= k {
                let alike = |first: &f64| {
                    from.iter().take_while(|dt| dt.to_bits() == first.to_bits()).count()
                };
                end = k + from.first().map_or(0, alike);
            }
            let few = end - k < ALIKE;
            let sample = &given[k * p..(k + 1) * p];
            let steady = |dt: &&f64| !few && self.observer.is_steady(memory, sample, **dt);
            if let Some(dt) = from.first().filter(steady).copied() {
                if kept_for.to_bits() != dt.to_bits() {
                    (*kept_for, *fixed) = (dt, self.observer.fixed(dt));
                }
                let taken = self.kernel.steps(Stretch {
                    memory,
                    t: &t[k..end],
                    dt,
                    y: &given[k * p..end * p],
                    u: &u[k * q..end * q],
                    fixed,
                    rows: &mut rows[k * m..end * m],
                    innovation: &mut innovation[k * p..end * p],
                });
                let to = k + taken.min(end - k);
                kept[k * p..to * p].copy_from_slice(&given[k * p..to * p]);
                status[k..to].fill(Status::Updated as u8);
                most = larger_of(most, largest(&rows[k * m..to * m]));
                k = to;
                if k == t.len() {
                    break;
                }
            }
            // a sample that is missing, steps of other lengths, the last of a record
            let to = (k + if few { ALIKE } else { RARE }).min(t.len());
            let rare = self.observer.over_block(
                memory,
                Block {
                    t: &t[k..to],
                    dt: &dt[k.min(dt.len())..to.min(dt.len())],
                    y: Samples::new(&given[k * p..to * p], &mut kept[k * p..to * p]),
                    u: &u[k * q..to * q],
                    memory: &mut rows[k * m..to * m],
                    innovation: &mut innovation[k * p..to * p],
                    status: &mut status[k..to],
                },
            )?;
            most = larger_of(most, rare);
            k = to;
        }
        Ok(most)
    }
}

/// The larger; NaN stays.
fn larger_of(most: f64, value: f64) -> f64 {
    if most.is_nan() || value <= most { most } else { value }
}

/// The largest magnitude, eight at a time.
fn largest(values: &[f64]) -> f64 {
    let (rows, rest) = values.as_chunks::<8>();
    let mut lanes = [0.0; 8];
    for row in rows {
        lanes.iter_mut().zip(row).for_each(|(lane, value)| *lane = larger(*lane, *value));
    }
    lanes.iter().chain(rest).fold(0.0, |most, value| larger(most, *value))
}
