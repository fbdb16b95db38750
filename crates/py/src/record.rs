//! Floor 3. A run over a record, in one pass: each block of it is taken in, checked and stepped over.
//!
//! What is wrong with a record is found here and said in Python, which has the words for it.

use crate::errors::Result;
use crate::kernel::RecordKernel;
use crate::values::empty;
use hgo_ir::record::Compiled;
use hgo_ir::recursion::{AnyObserver, Block, Recursion, Samples, larger};
use hgo_rs::observer::Status;
use numpy::PyArrayMethods;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ops::Range;

/// Samples of a block.
const BLOCK: usize = 512;
/// Samples between two looks at Ctrl-C: some ten milliseconds of the slowest law.
const STRETCH: usize = 32 * BLOCK;

/// When the samples were taken.
#[derive(Clone, Copy)]
pub enum Clock<'a> {
    /// Sample k at k times this.
    Period(f64),
    /// At these times.
    Times(&'a [f64]),
}

impl Clock<'_> {
    /// Times of the samples from `first` on, as many as there are.
    fn read(&self, first: usize, t: &mut [f64]) {
        match self {
            Self::Period(period) => {
                let first = first as f64;
                for (k, t) in (0_i32..).zip(t) {
                    *t = (first + f64::from(k)) * period;
                }
            }
            Self::Times(given) => {
                t.iter_mut().zip(&given[first..]).for_each(|(t, given)| *t = *given);
            }
        }
    }

    /// Steps between samples at the times t. A period is itself, whatever rounding makes of its
    /// multiples: a record of it has the bits of steps of this length.
    fn steps(&self, t: &[f64], dt: &mut [f64]) {
        match self {
            Self::Period(period) => dt.fill(*period),
            Self::Times(_) => {
                dt.iter_mut().zip(t.windows(2)).for_each(|(dt, t)| *dt = t[1] - t[0]);
            }
        }
    }

    /// Whether all steps are positive, and the longest.
    fn judge(&self, dt: &[f64]) -> (bool, f64) {
        match self {
            Self::Period(period) if !dt.is_empty() => (*period > 0.0, *period),
            _ => (all(dt, |dt| dt > 0.0), largest(dt)),
        }
    }
}

/// A record on its way: what is given and what is written, a row a sample.
struct Pass<'a> {
    observer: &'a dyn AnyObserver,
    /// Its steps, as they are taken.
    recursion: &'a dyn Recursion,
    clock: Clock<'a>,
    given: &'a [f64],
    u: &'a [f64],
    at: &'a mut [f64],
    y: &'a mut [f64],
    missing: &'a mut [bool],
    memory: &'a mut [f64],
    innovation: &'a mut [f64],
    status: &'a mut [u8],
    /// Time after the last sample, if the record goes on elsewhere.
    until: Option<f64>,
    /// Times of the block's samples and of the one after them; the steps between; the step before.
    t: [f64; BLOCK + 1],
    dt: [f64; BLOCK],
    since: f64,
    found: Findings,
}

/// What the checks found.
#[derive(Default)]
struct Findings {
    /// A time that does not increase, or an input that is not finite.
    unsound: bool,
    /// The longest step over which a sample corrects, and where it begins.
    longest: f64,
    longest_from: usize,
    /// The first sample at which the model has no value.
    undefined: Option<usize>,
    /// The largest magnitude of a sample that is there.
    largest_sample: f64,
    /// The largest magnitude of a memory's entry; NaN where one is not finite.
    largest: f64,
}

impl Pass<'_> {
    /// Take in, check and step over some samples: block by block, while they are in the cache.
    fn block(&mut self, rows: Range<usize>) -> Result<()> {
        let (p, q, m) = (self.observer.n_y(), self.observer.n_u(), self.at.len());
        let (found, len) = (&mut self.found, rows.len());
        let last = rows.end == self.missing.len();
        let (t, dt) = (&mut self.t, &mut self.dt);
        self.clock.read(rows.start, &mut t[..len + usize::from(!last)]);
        let steps = match self.until {
            Some(until) if last => {
                t[len] = until;
                len
            }
            _ => len - usize::from(last),
        };
        self.clock.steps(&t[..=steps], &mut dt[..steps]);
        let u = &self.u[by(q, &rows)];
        let (forward, longest) = self.clock.judge(&dt[..steps]);
        found.unsound |= !forward || !all(u, f64::is_finite);
        let before = self.since;
        self.since = if steps > 0 { dt[steps - 1] } else { before };

        let y = &mut self.y[by(p, &rows)];
        let status = &mut self.status[rows.clone()];
        let innovation = self.innovation.get_mut(by(p, &rows)).unwrap_or_default();
        let most = self.recursion.over_block(
            self.at,
            Block {
                t: &t[..len],
                dt: &dt[..steps],
                y: Samples::new(&self.given[by(p, &rows)], &mut *y),
                u,
                memory: &mut self.memory[by(m, &rows)],
                innovation,
                status,
            },
        )?;
        found.largest = if most > found.largest || most.is_nan() { most } else { found.largest };

        let (y, missing) = (&*y, &mut self.missing[rows.clone()]);
        if p == 1 {
            missing.iter_mut().zip(y).for_each(|(missing, y)| *missing = y.is_nan());
        } else {
            let samples = y.chunks_exact(p);
            missing.iter_mut().zip(samples).for_each(|(none, y)| *none = !all(y, |y| !y.is_nan()));
        }
        found.largest_sample = larger(found.largest_sample, largest(y));

        // a step over which nothing is corrected may be of any length; a filter corrects at its end
        let filters = self.observer.is_current();
        if larger(before, longest) > found.longest {
            let corrections = if filters { len } else { steps };
            for (k, missing) in missing.iter().enumerate().take(corrections) {
                let step = if !filters {
                    dt[k]
                } else if k == 0 {
                    before
                } else {
                    dt[k - 1]
                };
                if !missing && step > found.longest {
                    found.longest = step;
                    found.longest_from = rows.start + k - usize::from(filters);
                }
            }
        }

        if found.undefined.is_none() {
            let undefined = Status::ModelUndefined as u8;
            let first = status.iter().position(|status| *status == undefined);
            found.undefined = first.map(|k| rows.start + k);
        }
        Ok(())
    }
}

/// Where `rows` of this width stand in a flat array.
fn by(width: usize, rows: &Range<usize>) -> Range<usize> {
    rows.start * width..rows.end * width
}

/// A range in pieces.
fn pieces(rows: Range<usize>, length: usize) -> impl Iterator<Item = Range<usize>> {
    let end = rows.end;
    rows.step_by(length).map(move |start| start..end.min(start + length))
}

/// Without an early end, so that it is done in vectors.
fn all(values: &[f64], holds: impl Fn(f64) -> bool) -> bool {
    values.iter().fold(true, |all, value| all & holds(*value))
}

/// The largest magnitude of the numbers among `values`, eight at a time for the same reason.
fn largest(values: &[f64]) -> f64 {
    let (rows, rest) = values.as_chunks::<8>();
    let mut lanes = [0.0; 8];
    for row in rows {
        for (lane, value) in lanes.iter_mut().zip(row) {
            *lane = larger(*lane, *value);
        }
    }
    lanes.iter().chain(rest).fold(0.0, |largest, value| larger(largest, *value))
}

/// Run over a record from `memory` on, which is moved, by the compiled function where there is one: with current timing to after the last sample, or,
/// with `until`, to that time. The innovation is written if asked for.
pub fn run<'py>(
    py: Python<'py>,
    (observer, kernel): (&dyn AnyObserver, Option<&RecordKernel>),
    memory: &mut [f64],
    (clock, given, u): (Clock<'_>, &[f64], &[f64]),
    until: Option<f64>,
    innovation: bool,
) -> Result<Bound<'py, PyDict>> {
    let compiled = match (observer.tabled(), kernel) {
        (Some(tabled), Some(kernel)) => Some(Compiled::new(tabled, kernel)),
        _ => None,
    };
    let recursion: &dyn Recursion = match &compiled {
        Some(compiled) => compiled,
        None => observer.recursion(),
    };
    let (p, m) = (observer.n_y(), memory.len());
    let samples = given.len() / p;
    let y = empty::<f64, 2>(py, [samples, p])?;
    let missing = empty::<bool, 1>(py, [samples])?;
    let track = empty::<f64, 2>(py, [samples, m])?;
    let innovations = empty::<f64, 2>(py, [if innovation { samples } else { 0 }, p])?;
    let status = empty::<u8, 1>(py, [samples])?;
    let found = {
        let (mut y, mut missing) = (y.readwrite(), missing.readwrite());
        let (mut track, mut status) = (track.readwrite(), status.readwrite());
        let mut innovations = innovations.readwrite();
        let mut pass = Pass {
            observer,
            recursion,
            clock,
            until,
            given,
            u,
            at: memory,
            y: y.as_slice_mut()?,
            missing: missing.as_slice_mut()?,
            memory: track.as_slice_mut()?,
            innovation: innovations.as_slice_mut()?,
            status: status.as_slice_mut()?,
            t: [0.0; BLOCK + 1],
            dt: [0.0; BLOCK],
            since: 0.0,
            found: Findings::default(),
        };
        for stretch in pieces(0..samples, STRETCH) {
            py.check_signals()?;
            py.detach(|| pieces(stretch, BLOCK).try_for_each(|block| pass.block(block)))?;
        }
        pass.found
    };
    let out = PyDict::new(py);
    out.set_item("y", y)?;
    out.set_item("missing", missing)?;
    out.set_item("memory", track)?;
    if innovation {
        out.set_item("innovation", innovations)?;
    }
    out.set_item("status", status)?;
    let mut ends = [0.0; 2]; // the times that increase lie between
    clock.read(0, &mut ends[..1]);
    clock.read(samples.saturating_sub(1), &mut ends[1..]);
    let finite = all(&ends, f64::is_finite) && found.largest_sample.is_finite();
    out.set_item("sound", finite && !found.unsound)?;
    out.set_item("longest_step", (found.longest_from, found.longest))?;
    out.set_item("undefined", found.undefined)?;
    out.set_item("largest_sample", found.largest_sample)?;
    out.set_item("largest", found.largest)?;
    Ok(out)
}
