//! Floor 1. Metrics of many runs at once, each number of all runs side by side.

// The form that a compiler makes vector code of: an index into arrays of one length.
#![allow(clippy::needless_range_loop)]

use crate::Scalar;
use crate::memory::{EachColumn, Memory};
use crate::metrics::{LogHistogram, Moments, Wanted, Window};
use core::marker::PhantomData;
use core::ops::Range;

/// Runs in a block: so many that the loop over them stays a loop of vector instructions.
pub const LANES: usize = 32;

/// One number of every run of a block.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(64))]
pub struct Lane<T>(pub [T; LANES]);

/// Columns that begin where a cache line does: no vector of theirs lies in two.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub struct Aligned<X>(pub X);

/// The metrics of a block of runs, over buffers of the caller; see
/// [`RunMetrics`](crate::simulate::RunMetrics).
///
/// Signals are the errors x̂ − x followed by the rest of the memory.
#[derive(Debug)]
pub struct LaneMetrics<'a, T> {
    windows: &'a [Window],
    signals: usize,
    wanted: Wanted,
    settle: Option<T>,
    /// Windows that the span touches lie within these.
    active: Range<usize>,
    histogram: Option<Pooled<'a>>,
    /// For each window the sums, the sums of squares and the largest magnitudes of all signals, as
    /// far as they are wanted; then the peaks; then the settling times.
    now: &'a mut [Lane<T>],
    /// The same before the span.
    before: &'a mut [Lane<T>],
}

/// ‖x̂ − x‖² of the first runs of a block over a window, in one histogram.
#[derive(Debug)]
struct Pooled<'a> {
    window: Window,
    runs: usize,
    histogram: LogHistogram<'a>,
    /// Its counts before the span.
    before: &'a mut [u64],
}

/// What a sample shows of a block of runs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Shown<'a, X, Z> {
    pub k: u64,
    /// Plant states and observer memories.
    pub x: &'a X,
    pub z: &'a Z,
    /// Where in the state the entries stand that are estimated, and how many are.
    pub truth: (usize, usize),
}

impl<'a, T: Scalar> LaneMetrics<'a, T> {
    /// Length of each buffer that [`Self::new`] takes.
    pub fn buffer(windows: usize, signals: usize, wanted: Wanted) -> usize {
        windows * kinds(wanted) * signals + signals + 1
    }

    /// Nothing taken yet; `settle` is the threshold of the settling time. `None` where the buffers
    /// are shorter than [`Self::buffer`] says.
    pub fn new(
        windows: &'a [Window],
        signals: usize,
        wanted: Wanted,
        settle: Option<T>,
        [now, before]: [&'a mut [Lane<T>]; 2],
    ) -> Option<Self> {
        let length = Self::buffer(windows.len(), signals, wanted);
        let (now, before) = (now.get_mut(..length)?, before.get_mut(..length)?);
        now.fill(Lane([T::ZERO; LANES]));
        Some(Self { windows, signals, wanted, settle, active: 0..0, histogram: None, now, before })
    }

    /// Collect ‖x̂ − x‖² of the first `runs` runs in `counts` over a window; `before` is a buffer of
    /// the same length.
    #[must_use]
    pub fn with_histogram(
        mut self,
        window: Window,
        runs: usize,
        [counts, before]: [&'a mut [u64]; 2],
    ) -> Self {
        let histogram = LogHistogram::new(counts);
        self.histogram = Some(Pooled { window, runs, histogram, before });
        self
    }

    /// Rows of one window.
    #[inline(always)]
    fn stride(&self) -> usize {
        kinds(self.wanted) * self.signals
    }

    /// What window number `window` holds of a signal in a run that lived for `sound` samples; 0
    /// where it was not wanted.
    pub fn moments(&self, window: usize, signal: usize, lane: usize, sound: u64) -> Moments<T> {
        let count = self.windows.get(window).map_or(0, |w| w.to.min(sound).saturating_sub(w.from));
        let mut row = window * self.stride() + signal;
        let mut take = |wanted: bool| {
            let value = if wanted { self.value(row, lane) } else { T::ZERO };
            row += if wanted { self.signals } else { 0 };
            value
        };
        let Wanted { mean, rms, max, .. } = self.wanted;
        Moments::from_sums(count, take(mean), take(rms), take(max))
    }

    /// Largest magnitude of a memory entry; 0 where it was not wanted.
    pub fn peak(&self, entry: usize, lane: usize) -> T {
        self.value(self.windows.len() * self.stride() + entry, lane)
    }

    /// Last time at which ‖x̂ − x‖ was at or above the threshold, in s.
    pub fn settling_time(&self, lane: usize) -> T {
        self.value(self.windows.len() * self.stride() + self.signals, lane)
    }

    /// Counts of the histogram's bins; empty without one.
    pub fn counts(&self) -> &[u64] {
        self.histogram.as_ref().map_or(&[], |pooled| pooled.histogram.counts())
    }

    fn value(&self, row: usize, lane: usize) -> T {
        self.now.get(row).and_then(|row| row.0.get(lane)).copied().unwrap_or(T::ZERO)
    }

    /// Take a sample of every run; the histogram passes over those that are `dead`.
    #[inline(always)]
    pub(crate) fn sample<X: Memory<T>, Z: Memory<T>>(
        &mut self,
        t: T,
        shown: &Shown<'_, X::Columns<LANES>, Z::Columns<LANES>>,
        dead: &Lane<bool>,
    ) {
        let truth = Truth::<T, X> { x: shown.x, from: shown.truth.0, known: shown.truth.1 };
        let (signals, stride, wanted) = (self.signals, self.stride(), self.wanted);
        let (rows, rest) = self.now.split_at_mut(self.windows.len() * stride);
        let (peaks, settled) = rest.split_at_mut(signals);
        for window in self.active.clone() {
            if !self.windows.get(window).is_some_and(|w| w.contains(shown.k)) {
                continue;
            }
            let rows = rows.get_mut(window * stride..).unwrap_or_default();
            let mut kinds = rows.chunks_exact_mut(signals.max(1));
            if wanted.mean {
                truth.take::<Z, Sum>(shown.z, kinds.next());
            }
            if wanted.rms {
                truth.take::<Z, SumOfSquares>(shown.z, kinds.next());
            }
            if wanted.max {
                truth.take::<Z, Largest>(shown.z, kinds.next());
            }
        }
        if wanted.peak {
            Truth { known: 0, ..truth }.take::<Z, Largest>(shown.z, Some(peaks));
        }
        if self.settle.is_none() && self.histogram.is_none() {
            return;
        }
        let mut distance = Lane([T::ZERO; LANES]);
        for i in 0..truth.known {
            if let Some(z) = Z::column(shown.z, i) {
                SumOfSquares::take(&mut distance.0, z, truth.of(i).unwrap_or(&[T::ZERO; LANES]));
            }
        }
        if let (Some(threshold), [last]) = (self.settle, settled) {
            mark(&mut last.0, &distance.0, threshold, t);
        }
        if let Some(pooled) = &mut self.histogram
            && pooled.window.contains(shown.k)
        {
            for (square, dead) in distance.0.iter().zip(&dead.0).take(pooled.runs) {
                if !dead {
                    pooled.histogram.push(square.to_f64());
                }
            }
        }
    }

    /// The rows that the span can change: those of its windows, and the last.
    fn changed(&self) -> [Range<usize>; 2] {
        let (stride, last) = (self.stride(), self.windows.len() * self.stride());
        [self.active.start * stride..self.active.end * stride, last..last + self.signals + 1]
    }

    /// Begin a span, samples `from` to `to`: remember what it will change.
    pub(crate) fn begin(&mut self, from: u64, to: u64) {
        let touched = |w: &Window| w.from < to && w.to > from;
        let first = self.windows.iter().position(touched).unwrap_or(0);
        let end = self.windows.iter().rposition(touched).map_or(first, |last| last + 1);
        self.active = first..end;
        for rows in self.changed() {
            if let (Some(now), Some(before)) =
                (self.now.get(rows.clone()), self.before.get_mut(rows))
            {
                copy(before, now);
            }
        }
        if let Some(Pooled { histogram, before, .. }) = &mut self.histogram {
            copy(before, histogram.counts());
        }
    }

    /// Undo the span.
    pub(crate) fn undo(&mut self) {
        self.undo_where(&Lane([true; LANES]));
        if let Some(Pooled { histogram, before, .. }) = &mut self.histogram {
            copy(histogram.counts_mut(), before);
        }
    }

    /// The same for some of the runs; the histogram has passed over them.
    pub(crate) fn undo_where(&mut self, which: &Lane<bool>) {
        for rows in self.changed() {
            if let (Some(now), Some(before)) =
                (self.now.get_mut(rows.clone()), self.before.get(rows))
            {
                for (now, before) in now.iter_mut().zip(before) {
                    now.put_back(before, which);
                }
            }
        }
    }
}

impl<T: Copy> Lane<T> {
    /// Some of the runs from elsewhere.
    pub(crate) fn put_back(&mut self, from: &Self, which: &Lane<bool>) {
        for lane in 0..LANES {
            if which.0[lane] {
                self.0[lane] = from.0[lane];
            }
        }
    }
}

/// The states that the first entries of a memory estimate.
#[derive(Clone, Copy)]
struct Truth<'a, T: Scalar, X: Memory<T>> {
    x: &'a X::Columns<LANES>,
    /// The first of them, and how many are known.
    from: usize,
    known: usize,
}

impl<T: Scalar, X: Memory<T>> Truth<'_, T, X> {
    /// What entry i estimates; `None` where it estimates nothing.
    #[inline(always)]
    fn of(&self, i: usize) -> Option<&[T; LANES]> {
        if i < self.known { X::column(self.x, self.from + i) } else { None }
    }

    /// Every entry of a memory to its row.
    #[inline(always)]
    fn take<Z: Memory<T>, K: Kind<T>>(self, z: &Z::Columns<LANES>, rows: Option<&mut [Lane<T>]>) {
        let rows = rows.unwrap_or_default();
        Z::each_column(z, 0, &mut Collector { truth: self, rows, kind: PhantomData::<K> });
    }
}

/// The rows of a kind of sum, one a signal.
struct Collector<'a, 'b, T: Scalar, X: Memory<T>, K> {
    truth: Truth<'a, T, X>,
    rows: &'b mut [Lane<T>],
    kind: PhantomData<K>,
}

impl<T: Scalar, X: Memory<T>, K: Kind<T>> EachColumn<T, LANES> for Collector<'_, '_, T, X, K> {
    #[inline(always)]
    fn take(&mut self, i: usize, z: &[T; LANES]) {
        if let Some(row) = self.rows.get_mut(i) {
            match self.truth.of(i) {
                Some(x) => K::take(&mut row.0, z, x),
                None => K::take(&mut row.0, z, &[T::ZERO; LANES]),
            }
        }
    }
}

/// What is added up of a signal z − x. (Arguments, so that the compiler knows that they lie apart.)
trait Kind<T> {
    fn take(row: &mut [T; LANES], z: &[T; LANES], x: &[T; LANES]);
}

/// Its values.
struct Sum;
/// Its squares.
struct SumOfSquares;
/// Its largest magnitude.
struct Largest;

impl<T: Scalar> Kind<T> for Sum {
    #[inline(always)]
    fn take(sum: &mut [T; LANES], z: &[T; LANES], x: &[T; LANES]) {
        for lane in 0..LANES {
            sum[lane] += z[lane] - x[lane];
        }
    }
}

impl<T: Scalar> Kind<T> for SumOfSquares {
    #[inline(always)]
    fn take(sum: &mut [T; LANES], z: &[T; LANES], x: &[T; LANES]) {
        for lane in 0..LANES {
            let e = z[lane] - x[lane];
            sum[lane] += e * e;
        }
    }
}

impl<T: Scalar> Kind<T> for Largest {
    /// The magnitude of what is one already: a compiler then stores every lane's number. Where some
    /// stay what they are it stores the others only, which is slow.
    #[inline(always)]
    fn take(largest: &mut [T; LANES], z: &[T; LANES], x: &[T; LANES]) {
        for lane in 0..LANES {
            largest[lane] = largest[lane].abs().max((z[lane] - x[lane]).abs());
        }
    }
}

/// last = t where √square is at or above the threshold; magnitudes as in `Largest`.
#[inline(always)]
fn mark<T: Scalar>(last: &mut [T; LANES], square: &[T; LANES], threshold: T, t: T) {
    for lane in 0..LANES {
        last[lane] = if square[lane].sqrt() >= threshold { t } else { last[lane].abs() };
    }
}

/// As many entries as both have.
fn copy<X: Copy>(to: &mut [X], from: &[X]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to = *from;
    }
}

/// How many sums a window keeps of a signal.
fn kinds(wanted: Wanted) -> usize {
    usize::from(wanted.mean) + usize::from(wanted.rms) + usize::from(wanted.max)
}
