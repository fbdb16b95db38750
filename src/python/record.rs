//! A run over a record, block by block: taken in, checked and stepped over while it is in the cache.
//!
//! What is wrong with a record is found here and said in Python, which has the words for it.

use super::observers::{AnyObserver, Stretch};
use super::spec::empty;
use crate::observer::Status;
use numpy::PyArrayMethods;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ops::Range;

/// Samples of a block.
const BLOCK: usize = 512;
/// Samples between two looks at Ctrl-C: at most some ten milliseconds.
const STRETCH: usize = 32 * BLOCK;

/// When the samples were taken.
#[derive(Clone, Copy)]
pub enum Clock<'a> {
    /// Sample k at k times this.
    Period(f64),
    /// At these times.
    Times(&'a [f64]),
}

/// A record: its times, samples and inputs, a row a sample.
#[derive(Clone, Copy)]
pub struct Given<'a> {
    pub clock: Clock<'a>,
    pub y: &'a [f64],
    pub u: &'a [f64],
}

/// Run over a record from `memory` on, which is moved. The arrays that come back are new: times and
/// samples are copied, so that nobody changes them meanwhile or later.
pub fn run<'py>(
    py: Python<'py>,
    observer: &dyn AnyObserver,
    given: Given<'_>,
    memory: &mut [f64],
) -> PyResult<Bound<'py, PyDict>> {
    let (p, m) = (observer.n_y(), memory.len());
    let samples = given.y.len() / p;
    let time = empty::<f64, 1>(py, [samples])?;
    let missing = empty::<bool, 1>(py, [samples])?;
    let status = empty::<u8, 1>(py, [samples])?;
    let [y, innovation] = [empty::<f64, 2>(py, [samples, p])?, empty::<f64, 2>(py, [samples, p])?];
    let track = empty::<f64, 2>(py, [samples, m])?;
    let found = {
        let (mut t, mut missing, mut status) =
            (time.readwrite(), missing.readwrite(), status.readwrite());
        let (mut y, mut innovation, mut track) =
            (y.readwrite(), innovation.readwrite(), track.readwrite());
        let mut pass = Pass {
            observer,
            given,
            memory,
            t: t.as_slice_mut()?,
            y: y.as_slice_mut()?,
            missing: missing.as_slice_mut()?,
            track: track.as_slice_mut()?,
            innovation: innovation.as_slice_mut()?,
            status: status.as_slice_mut()?,
            dt: [0.0; BLOCK],
            found: Findings::default(),
        };
        pass.take_in(0..samples.min(1));
        for stretch in pieces(0..samples, STRETCH) {
            py.check_signals()?;
            py.detach(|| pieces(stretch, BLOCK).for_each(|block| pass.block(block)));
        }
        pass.found
    };
    let out = PyDict::new(py);
    out.set_item("time", time)?;
    out.set_item("y", y)?;
    out.set_item("memory", track)?;
    out.set_item("innovation", innovation)?;
    out.set_item("missing", missing)?;
    out.set_item("status", status)?;
    out.set_item("sound", !found.unsound)?;
    out.set_item("longest_step", found.longest)?;
    out.set_item("undefined", found.undefined)?;
    out.set_item("largest_sample", found.largest_sample)?;
    out.set_item("largest", if found.nan { f64::NAN } else { found.largest })?;
    Ok(out)
}

/// What there is to find fault with.
#[derive(Default)]
struct Findings {
    /// A time that is not finite or does not increase, an infinite sample, an input not finite.
    unsound: bool,
    /// Where the longest step over which a sample corrects begins, and its length.
    longest: Option<(usize, f64)>,
    /// The first sample that is there and at which the model has no value.
    undefined: Option<usize>,
    /// The largest magnitude of a sample.
    largest_sample: f64,
    /// The largest magnitude of a memory's entry that is a number, and whether one is none.
    largest: f64,
    nan: bool,
}

/// A run on its way.
struct Pass<'a> {
    observer: &'a dyn AnyObserver,
    given: Given<'a>,
    memory: &'a mut [f64],
    t: &'a mut [f64],
    y: &'a mut [f64],
    missing: &'a mut [bool],
    track: &'a mut [f64],
    innovation: &'a mut [f64],
    status: &'a mut [u8],
    /// Steps from the samples of the block to the next ones.
    dt: [f64; BLOCK],
    found: Findings,
}

impl Pass<'_> {
    /// Copy and check times, samples and inputs.
    fn take_in(&mut self, rows: Range<usize>) {
        let t = &mut self.t[rows.clone()];
        match self.given.clock {
            Clock::Period(period) => {
                let first = rows.start as f64;
                for (k, t) in (0_i32..).zip(t) {
                    *t = (first + f64::from(k)) * period;
                }
            }
            Clock::Times(given) => t.copy_from_slice(&given[rows.clone()]),
        }
        let (p, q) = (self.observer.n_y(), self.observer.n_u());
        let (y, u) = (by(p, &rows), by(q, &rows));
        let (given, y) = (&self.given.y[y.clone()], &mut self.y[y]);
        y.copy_from_slice(given);
        let missing = &mut self.missing[rows.clone()];
        for (missing, y) in missing.iter_mut().zip(y.chunks_exact(p)) {
            *missing = y.iter().fold(false, |none, y| none | y.is_nan());
        }
        let largest = largest(y).0;
        self.found.largest_sample = self.found.largest_sample.max(largest);
        let known = all(&self.given.u[u], f64::is_finite) && all(&self.t[rows], f64::is_finite);
        self.found.unsound |= largest == f64::INFINITY || !known;
    }

    /// Step over a block; the row after it is taken in as well.
    fn block(&mut self, rows: Range<usize>) {
        let samples = self.t.len();
        let next = rows.start + 1..samples.min(rows.end + 1);
        self.take_in(next.clone());
        let t = &self.t[rows.start..next.end];
        let dt = &mut self.dt[..rows.len()];
        for (dt, pair) in dt.iter_mut().zip(t.windows(2)) {
            *dt = pair[1] - pair[0];
        }
        self.found.unsound |= !all(&dt[..next.len()], |dt| dt > 0.0);
        if next.len() < rows.len() {
            // the last sample of all: as long as the step before it
            let before = self.t[rows.end.saturating_sub(2)];
            dt[rows.len() - 1] = self.t[rows.end - 1] - before;
        }
        // a step over which nothing is corrected may be of any length
        let corrects = if self.observer.is_current() { next.clone() } else { rows.clone() };
        let mut longest = self.found.longest.map_or(0.0, |(_, dt)| dt);
        for (k, (dt, missing)) in
            dt.iter().zip(&self.missing[corrects]).take(next.len()).enumerate()
        {
            if !missing && *dt > longest {
                longest = *dt;
                self.found.longest = Some((rows.start + k, longest));
            }
        }
        let (p, q, m) = (self.observer.n_y(), self.observer.n_u(), self.memory.len());
        self.observer.recursion().advance(
            self.memory,
            Stretch {
                t: &t[..rows.len()],
                dt,
                y: &self.y[by(p, &rows)],
                u: &self.given.u[by(q, &rows)],
                memory: &mut self.track[by(m, &rows)],
                innovation: &mut self.innovation[by(p, &rows)],
                status: &mut self.status[rows.clone()],
            },
        );
        let (largest, nan) = largest(&self.track[by(m, &rows)]);
        self.found.largest = self.found.largest.max(largest);
        self.found.nan |= nan;
        let undefined = Status::ModelUndefined as u8;
        if self.found.undefined.is_none() && self.status[rows.clone()].contains(&undefined) {
            let there = |k: &usize| self.status[*k] == undefined && !self.missing[*k];
            self.found.undefined = rows.into_iter().find(there);
        }
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

/// The largest magnitude of the numbers among `values`, and whether there is a NaN. Eight at a time,
/// so that it is done in vectors.
fn largest(values: &[f64]) -> (f64, bool) {
    let (rows, rest) = values.as_chunks::<8>();
    let (mut largest, mut nan) = ([0.0_f64; 8], [false; 8]);
    let mut look = |lane: usize, value: f64| {
        let size = value.abs();
        largest[lane] = if size > largest[lane] { size } else { largest[lane] };
        nan[lane] |= value.is_nan();
    };
    for row in rows {
        for (lane, value) in row.iter().enumerate() {
            look(lane, *value);
        }
    }
    rest.iter().for_each(|value| look(0, *value));
    (largest.into_iter().fold(0.0, f64::max), nan.contains(&true))
}
