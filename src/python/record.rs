//! A run over a record, in one pass: each sample is taken in, checked and stepped over.
//!
//! What is wrong with a record is found here and said in Python, which has the words for it.

use super::observers::AnyObserver;
use super::spec::empty;
use crate::memory::Memory;
use crate::observer::{Observer, Status, Timing};
use numpy::PyArrayMethods;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ops::Range;

/// Samples between two looks at Ctrl-C: some ten milliseconds of the slowest law.
const STRETCH: usize = 1 << 14;

/// When the samples were taken.
#[derive(Clone, Copy)]
pub enum Clock<'a> {
    /// Sample k at k times this.
    Period(f64),
    /// At these times.
    Times(&'a [f64]),
}

impl Clock<'_> {
    /// Time of sample k, which is also given as a number; NaN after the last one.
    #[inline(always)]
    fn at(&self, k: usize, number: f64) -> f64 {
        match self {
            Self::Period(period) => number * period,
            Self::Times(t) => t.get(k).copied().unwrap_or(f64::NAN),
        }
    }
}

/// A record on its way: what is given and what is written, a row a sample.
pub struct Pass<'a> {
    pub clock: Clock<'a>,
    pub given: &'a [f64],
    pub u: &'a [f64],
    /// The samples once more: nobody changes these later.
    pub y: &'a mut [f64],
    pub missing: &'a mut [bool],
    pub memory: &'a mut [f64],
    /// Empty where it is not asked for.
    pub innovation: &'a mut [f64],
    pub status: &'a mut [u8],
    pub found: Findings,
}

/// What there is to find fault with.
#[derive(Clone, Copy, Default)]
pub struct Findings {
    /// A time that does not increase, or an input that is not finite.
    unsound: bool,
    /// The longest step over which a sample corrects, and where it begins.
    longest: f64,
    longest_from: usize,
    /// The first sample that is there and at which the model has no value.
    undefined: Option<usize>,
    /// The largest magnitude of a sample that is there.
    largest_sample: f64,
    /// The largest magnitude of a memory's entry; NaN where one is not finite.
    largest: f64,
}

/// Step over some samples of a record.
#[inline(always)]
pub fn advance<O>(observer: &O, memory: &mut [f64], samples: Range<usize>, pass: &mut Pass<'_>)
where
    O: Observer<f64>,
    O::Input: Memory<f64>,
{
    let (p, m, count) = (O::Measurement::LEN, O::State::LEN, pass.missing.len());
    let q = pass.u.len().checked_div(count).unwrap_or(0);
    let filters = O::TIMING == Timing::Current;
    let (clock, u, mut found) = (pass.clock, pass.u, pass.found);
    let given = pass.given[by(p, &samples)].chunks_exact(p);
    let kept = pass.y[by(p, &samples)].chunks_exact_mut(p);
    let marks = pass.missing[samples.clone()].iter_mut().zip(&mut pass.status[samples.clone()]);
    let rows = pass.memory[by(m, &samples)].chunks_exact_mut(m);

    let mut z = O::State::read(memory);
    let (mut largest, mut spoilt) = (O::State::zero(), O::State::zero());
    let mut number = samples.start as f64;
    let mut t = clock.at(samples.start, number);
    let mut before = clock.at(samples.start.saturating_sub(1), (number - 1.0).max(0.0));
    for ((((given, kept), (missing, status)), row), k) in
        given.zip(kept).zip(marks).zip(rows).zip(samples.clone())
    {
        number += 1.0;
        let (is_last, next) = (k + 1 == count, clock.at(k + 1, number));
        let since = t - before;
        let dt = if is_last { since } else { next - t };
        found.unsound |= !(dt > 0.0 || is_last);

        *missing = false;
        for (kept, y) in kept.iter_mut().zip(given) {
            *kept = *y;
            found.largest_sample = larger(found.largest_sample, *y);
            *missing |= y.is_nan();
        }
        // a step over which nothing is corrected may be of any length
        let (corrected, from) = if filters { (since, k.saturating_sub(1)) } else { (dt, k) };
        if corrected > found.longest && !*missing && (filters || !is_last) {
            (found.longest, found.longest_from) = (corrected, from);
        }
        let mut told = O::Input::read(&[]);
        if O::Input::LEN > 0 {
            let u = u.get(k * q..(k + 1) * q).unwrap_or(&[]);
            found.unsound |= !u.iter().all(|u| u.is_finite());
            told = O::Input::read(u);
        }

        let y = O::Measurement::read(given);
        if filters && let Some(row) = pass.innovation.get_mut(k * p..(k + 1) * p) {
            observer.innovation(&z, &y).write(row);
        }
        let start = z;
        let made = observer.step(&mut z, &y, &told, t, dt);
        let shown = if filters { z } else { start };
        shown.write(row);
        largest = largest.zip(&shown, larger);
        spoilt = spoilt.zip(&shown, |sum, z| sum + (z - z)); // NaN once z is not finite
        *status = made as u8;
        if made == Status::ModelUndefined && !*missing && found.undefined.is_none() {
            found.undefined = Some(k);
        }
        (before, t) = (t, next);
    }
    z.write(memory);
    largest.visit(&mut |z| found.largest = larger(found.largest, z));
    spoilt.visit(&mut |sum| found.largest += sum);
    pass.found = found;
    if !filters && let Some(innovation) = pass.innovation.get_mut(by(p, &samples)) {
        let rows = pass.memory[by(m, &samples)].chunks_exact(m);
        let y = pass.y[by(p, &samples)].chunks_exact(p);
        for ((innovation, z), y) in innovation.chunks_exact_mut(p).zip(rows).zip(y) {
            let (z, y) = (O::State::read(z), O::Measurement::read(y));
            observer.innovation(&z, &y).write(innovation);
        }
    }
}

/// Where `rows` of this width stand in a flat array.
fn by(width: usize, rows: &Range<usize>) -> Range<usize> {
    rows.start * width..rows.end * width
}

/// The larger magnitude; NaN is passed over in `value`.
#[inline(always)]
fn larger(largest: f64, value: f64) -> f64 {
    if value.abs() > largest { value.abs() } else { largest }
}

/// Run over a record from `memory` on, which is moved. The innovation is written if asked for.
pub fn run<'py>(
    py: Python<'py>,
    observer: &dyn AnyObserver,
    memory: &mut [f64],
    (clock, given, u): (Clock<'_>, &[f64], &[f64]),
    innovation: bool,
) -> PyResult<Bound<'py, PyDict>> {
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
            clock,
            given,
            u,
            y: y.as_slice_mut()?,
            missing: missing.as_slice_mut()?,
            memory: track.as_slice_mut()?,
            innovation: innovations.as_slice_mut()?,
            status: status.as_slice_mut()?,
            found: Findings::default(),
        };
        for start in (0..samples).step_by(STRETCH) {
            py.check_signals()?;
            let stretch = start..samples.min(start + STRETCH);
            py.detach(|| observer.recursion().advance(memory, stretch, &mut pass));
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
    let ends = [0, samples.saturating_sub(1)].map(|k| clock.at(k, k as f64)); // the others lie between
    let finite = ends.iter().all(|t| t.is_finite()) && found.largest_sample.is_finite();
    out.set_item("sound", finite && !found.unsound)?;
    out.set_item("longest_step", (found.longest_from, found.longest))?;
    out.set_item("undefined", found.undefined)?;
    out.set_item("largest_sample", found.largest_sample)?;
    out.set_item("largest", found.largest)?;
    Ok(out)
}
