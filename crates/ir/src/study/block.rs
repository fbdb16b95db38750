//! Floor 4. A block of runs: time in the outer loop, the runs side by side in the inner one.
//!
//! Each number of all runs is a column. Run i draws from its own streams and sees the same operations in
//! the same order as alone, so that its bits do not depend on its neighbours, on the engine or on the
//! processor's instruction set.
//!
//! Divergence is looked for in spans: all runs move over a span of samples; if a number was out of
//! bounds anywhere in it, the span is undone and moved over sample by sample, so that the run ends at the
//! very sample at which it ends alone. From then on it is put back after every span.

// The form that a compiler makes vector code of: an index, and no branch between two truths.
#![allow(clippy::needless_range_loop)]

use super::plan::{AnySchedule, DrawKind, Own, Plan};
use super::{RunResult, Study};
use crate::error::Result;
use hgo_rs::metrics::{LogHistogram, Moments, Window};
use hgo_rs::noise::{Channel, Sine, Stream};
use hgo_rs::program::Lane;
use hgo_rs::schedule::Schedule;
use hgo_rs::simulate::DIVERGED;

/// Runs in a block.
pub const LANES: usize = 32;

/// Samples between two looks at the bounds, and at whether to stop.
const SPAN: u64 = 64;
/// The same where a compiled kernel moves the runs.
const LONG_SPAN: u64 = 256;

/// Where each number of a run stands among the columns of a block.
#[derive(Clone, Debug)]
pub struct Layout {
    /// Entries of the plant's state and of the feedback's columns behind it.
    pub x: usize,
    /// Entries of the plant's state.
    pub plant: usize,
    /// Columns of the feedback that are computed at a sample: inputs in force and watched signals.
    pub now: usize,
    /// Watched signals, the last of them.
    pub watched: usize,
    /// Memory of the observer.
    pub z: usize,
    /// Measured outputs.
    pub y: usize,
    /// Columns of the drawn noise: one a measured output, and as many for each further sample before this
    /// one that coloured noise is made of.
    pub noises: usize,
    /// Inputs of the plant.
    pub u: usize,
    /// Entries of the memory that have metrics.
    pub errors: usize,
    /// The plant's states that the first entries of the memory estimate.
    pub truth: Vec<usize>,
    /// Kinds of moments that are wanted: the sum, the sum of squares, the largest magnitude.
    pub kinds: [bool; 3],
    /// Whether peaks are wanted.
    pub peaks: bool,
    /// The threshold of the settling time.
    pub settle: Option<f64>,
    /// Watched signals with a settling time, and its threshold.
    pub settles: Vec<(usize, f64)>,
}

impl Layout {
    /// Columns that a run is carried on by: all of the state but what is computed at each sample, and the
    /// memory.
    pub fn states(&self) -> impl Iterator<Item = usize> + use<> {
        (0..self.plant).chain(self.plant + self.now..self.noise())
    }
    /// First column of the memory.
    pub fn memory(&self) -> usize {
        self.x
    }
    /// First column of the drawn noise.
    pub fn noise(&self) -> usize {
        self.x + self.z
    }
    /// First column of the peaks.
    pub fn peak(&self) -> usize {
        self.noise() + self.noises
    }
    /// Signals that have metrics: entries of the memory, then what is watched.
    pub fn signals(&self) -> usize {
        self.errors + self.watched
    }
    /// First column of what is watched.
    pub fn watch(&self) -> usize {
        self.plant + self.now - self.watched
    }
    /// Column of the last time at which the error was at or above the threshold; then that of each watched
    /// signal with a threshold.
    pub fn settled(&self) -> usize {
        self.peak() + if self.peaks { self.signals() } else { 0 }
    }
    /// First column of the moments of the windows that are open.
    pub fn open(&self) -> usize {
        self.settled() + usize::from(self.settle.is_some()) + self.settles.len()
    }
    /// Columns of the moments of one window.
    pub fn moments(&self) -> usize {
        self.kinds.iter().filter(|wanted| **wanted).count() * self.signals()
    }
}

/// What is the same for all runs at one sample: a row of eight numbers, as a kernel reads it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C)]
pub struct Instant {
    /// Time of the observers, in s.
    pub t: f64,
    /// Length of their step, in s.
    pub dt: f64,
    /// Time of the plants, in s.
    pub plant_t: f64,
    /// Length of one of the plants' substeps, in s.
    pub h: f64,
    /// Sum of the sines of the noise.
    pub sines: f64,
    /// Noise that is recorded for all runs alike.
    pub noise: f64,
    /// 1 where noise is drawn anew, else 0.
    pub fresh: f64,
    /// 1 where a sample follows, else 0.
    pub more: f64,
}

/// A span of samples over which the same windows are open.
#[derive(Debug)]
pub struct Span<'a, const L: usize> {
    /// Number of its first sample.
    pub first: u64,
    /// Its samples.
    pub instants: &'a [Instant],
    /// Recorded noise of each run, or that of a law of the user's, a row a sample; empty without.
    pub recorded: &'a [Lane<f64, L>],
    /// Whether ‖x̂ − x‖² of every sample is asked for.
    pub distances: bool,
    /// How many windows are open.
    pub open: usize,
    /// Whether it is one sample of a span that went out of bounds.
    pub careful: bool,
}

/// What moves a block.
pub trait Engine<const L: usize> {
    /// Move all runs over a span.
    ///
    /// # Errors
    /// A function of the user's that failed.
    fn span(&mut self, block: &mut Block<L>, span: &Span<'_, L>) -> Result<()>;
    /// Whether long spans pay.
    fn is_compiled(&self) -> bool {
        false
    }
}

/// Random streams of all runs, in columns.
pub type Streams<const L: usize> = [Lane<u64, L>; 4];

fn streams<const L: usize>(seed: u64, first_run: u64, channel: Channel) -> Streams<L> {
    let mut columns = [Lane([0; L]); 4];
    for lane in 0..L {
        let state = Stream::new(seed, first_run.wrapping_add(lane as u64), channel).state();
        for (column, word) in columns.iter_mut().zip(state) {
            column.0[lane] = word;
        }
    }
    columns
}

/// What is drawn of one run's stream.
#[inline(always)]
pub fn in_lane<R, const L: usize>(
    streams: &mut Streams<L>,
    lane: usize,
    draw: impl FnOnce(&mut Stream) -> R,
) -> R {
    let mut stream = Stream::from_state(std::array::from_fn(|i| streams[i].0[lane]));
    let drawn = draw(&mut stream);
    for (column, word) in streams.iter_mut().zip(stream.state()) {
        column.0[lane] = word;
    }
    drawn
}

/// Where all runs of a block stand.
#[derive(Clone, Debug)]
pub struct Block<const L: usize> {
    /// See [`Layout`].
    pub columns: Vec<Lane<f64, L>>,
    /// The plants' state where it is the same for all runs; empty where it is not.
    pub shared: Vec<f64>,
    /// Random streams of the measurement and of the process.
    pub streams: [Streams<L>; 2],
    /// The last draw of a law of the user's.
    pub own: Lane<f64, L>,
    /// The largest magnitude of a state in the span, or more; NaN where one was not a number.
    pub worst: Lane<f64, L>,
    /// First sample at which the model had no value; `u64::MAX`: none.
    pub undefined_at: Lane<u64, L>,
    /// State, memory and measurement as the last sample showed them; empty where no frames are kept.
    pub shown: Vec<Lane<f64, L>>,
    /// ‖x̂ − x‖² at each sample of the span, where asked for.
    pub distances: Vec<Lane<f64, L>>,
}

impl<const L: usize> Block<L> {
    /// Before a span.
    #[inline(always)]
    pub fn begin(&mut self, span: &Span<'_, L>) {
        self.worst = Lane([0.0; L]);
        let samples = if span.distances { span.instants.len() } else { 0 };
        self.distances.resize(samples, Lane([0.0; L]));
    }

    fn put_back(&mut self, from: &Self, which: &Lane<bool, L>) {
        for (now, before) in self.columns.iter_mut().zip(&from.columns) {
            choose(now, before, which);
        }
        choose(&mut self.undefined_at, &from.undefined_at, which);
    }

    /// Whether plant, controller and observer of each run are within bounds.
    fn sound(&self, layout: &Layout) -> Lane<bool, L> {
        let mut sound = Lane([true; L]);
        let later = &self.columns[layout.plant + layout.now..layout.noise()];
        for column in self.columns[..layout.plant].iter().chain(later) {
            for lane in 0..L {
                sound.0[lane] &= column.0[lane].abs() <= DIVERGED;
            }
        }
        sound
    }

    /// Draws of a law of the user's at these samples, a row each.
    fn draw(&mut self, law: &Own, instants: &[Instant], into: &mut Vec<Lane<f64, L>>) {
        for instant in instants {
            for lane in (0..L).filter(|_| instant.fresh > 0.0) {
                self.own.0[lane] = in_lane(&mut self.streams[0], lane, |stream| (law.0)(stream));
            }
            into.push(self.own);
        }
    }

    fn assign(&mut self, from: &Self) {
        self.columns.copy_from_slice(&from.columns);
        self.shared.copy_from_slice(&from.shared);
        self.streams = from.streams;
        self.own = from.own;
        self.undefined_at = from.undefined_at;
    }
}

fn choose<T: Copy, const L: usize>(now: &mut Lane<T, L>, from: &Lane<T, L>, which: &Lane<bool, L>) {
    for lane in 0..L {
        if which.0[lane] {
            now.0[lane] = from.0[lane];
        }
    }
}

/// Kept frames of a block's runs: for each run rows of state, memory and measurement.
pub struct Frames<'a> {
    /// One a run; each holds whole frames one after the other.
    pub runs: Vec<[&'a mut [f64]; 3]>,
}

/// The clock of a block, the same for all.
struct Clock<'a> {
    plan: &'a Plan,
    /// Whether nobody reads the time.
    timeless: bool,
    t: f64,
    plant_t: f64,
    instants: Vec<Instant>,
}

impl Clock<'_> {
    /// The samples from `from` to `to`; the clock stands at the first and is moved to the end.
    fn advance(&mut self, from: u64, to: u64) {
        let plan = self.plan;
        if !self.timeless {
            self.instants.clear();
        }
        if let (AnySchedule::Fixed(fixed), None, true) =
            (plan.schedule, plan.plant_schedule, plan.is_plain())
        {
            // without a choice or a sum: it is done for every block again
            let dt = fixed.dt(0);
            let h = dt / f64::from(plan.substeps);
            let more = if to > plan.steps { 0.0 } else { 1.0 };
            let usual = Instant { dt, h, fresh: 1.0, more, ..Instant::default() };
            if self.timeless {
                if self.instants.first().is_some_and(|first| *first != usual) {
                    self.instants.clear();
                }
                self.instants.resize(usize::try_from(to - from).unwrap_or(0), usual);
                return;
            }
            self.instants.extend((from..to).map(|k| {
                let t = k as f64 * dt;
                Instant { t, plant_t: t, ..usual }
            }));
            return;
        }
        self.instants.clear();
        let plants = plan.plant_schedule.unwrap_or(plan.schedule);
        for k in from..to {
            let (dt, plant_dt) = (plan.schedule.dt(k), plants.dt(k));
            let (t, more) = (self.t, k < plan.steps);
            let fresh = plan.hold <= 1 || k.is_multiple_of(plan.hold);
            self.instants.push(Instant {
                t,
                dt,
                plant_t: self.plant_t,
                h: plant_dt / f64::from(plan.substeps),
                sines: Sine::sum(&plan.sines, t),
                noise: plan.shared_noise(k),
                fresh: f64::from(u8::from(fresh)),
                more: f64::from(u8::from(more)),
            });
            if more {
                self.plant_t = plants.next_time(self.plant_t, k, plant_dt);
                self.t = plan.schedule.next_time(t, k, dt);
            }
        }
    }
}

/// First sample after `k` at which a window opens or closes.
fn next_edge(windows: &[Window], k: u64) -> u64 {
    let edges = windows.iter().flat_map(|window| [window.from, window.to]);
    edges.filter(|edge| *edge > k).min().unwrap_or(u64::MAX)
}

/// The runs `first` to `first + L − 1` of a study, or as many as there are, and how many frames were kept.
///
/// # Errors
/// A function of the user's that failed.
pub fn run<const L: usize, E: Engine<L>>(
    study: &Study,
    engine: &mut E,
    first: usize,
    counts: &mut [u64],
    frames: Option<Frames<'_>>,
    stop: &(dyn Fn() -> bool + Sync),
) -> Result<(Vec<RunResult>, usize)> {
    let (plan, layout) = (&study.plan, &study.layout);
    let runs = L.min(plan.runs - first);
    let moments = layout.moments();
    let mut block = start::<L>(study, first);
    let mut before = block.clone();
    let mut stored = vec![Lane([0.0; L]); plan.windows.len() * moments];
    let mut open: Vec<usize> = Vec::new();
    let mut recorded = Vec::new();
    let mut frames = frames;
    let mut kept = 0;
    let timeless =
        study.tables.are_timeless() && plan.settle.is_none() && layout.settles.is_empty();
    let mut clock = Clock { plan, timeless, t: 0.0, plant_t: 0.0, instants: Vec::new() };
    let (mut dead, mut sound) = (Lane([false; L]), Lane([u64::MAX; L]));
    let begun = block.sound(layout);
    for lane in 0..L {
        if !begun.0[lane] {
            (dead.0[lane], sound.0[lane]) = (true, 0);
        }
    }
    // fewer where each sample takes many substeps, so that `stop` is asked often
    let span = if engine.is_compiled() { LONG_SPAN } else { SPAN };
    let long = (span / u64::from(plan.substeps.max(1))).max(1);
    let (mut k, mut careful_until) = (0, 0);
    let histogram: Vec<Window> = plan.histogram.into_iter().collect();
    while k <= plan.steps && dead.0.contains(&false) && !stop() {
        let length = if k < careful_until { 1 } else { long };
        let mut to = k.saturating_add(length).min(plan.steps.saturating_add(1));
        to = to.min(next_edge(&plan.windows, k)).min(next_edge(&histogram, k));
        if k < plan.steps {
            to = to.min(plan.steps); // the last sample moves nothing: it is a span of its own
        }
        if let Some(last) = k.checked_next_multiple_of(plan.every).filter(|_| plan.every > 0) {
            to = to.min(last.saturating_add(1)); // a frame is the last sample of its span
        }
        let now: Vec<usize> =
            (0..plan.windows.len()).filter(|w| plan.windows[*w].contains(k)).collect();
        if now != open {
            exchange(&mut block.columns, &mut stored, (&open, &now), layout.open(), moments);
            before.columns.resize(block.columns.len(), Lane([0.0; L]));
            open = now;
        }
        let (clock_t, clock_plant) = (clock.t, clock.plant_t);
        clock.advance(k, to);
        plan.recorded(first, k..to, &mut recorded);
        before.assign(&block);
        if let DrawKind::Own(law) = &plan.draw {
            block.draw(law, &clock.instants, &mut recorded);
        }
        let distances = histogram.iter().any(|window| window.contains(k));
        let careful = to - k == 1 && k < careful_until;
        let (instants, recorded) = (clock.instants.as_slice(), recorded.as_slice());
        let span = Span { first: k, instants, recorded, distances, open: open.len(), careful };
        engine.span(&mut block, &span)?;
        let (mut fell, stands) = (Lane([false; L]), block.sound(layout));
        for lane in 0..L {
            let stands = stands.0[lane] && block.worst.0[lane] <= DIVERGED;
            fell.0[lane] = !dead.0[lane] && !stands;
        }
        if to - k > 1 && fell.0.contains(&true) {
            block.assign(&before);
            (clock.t, clock.plant_t) = (clock_t, clock_plant);
            careful_until = to;
            continue;
        }
        if distances {
            let mut histogram = LogHistogram::new(counts);
            for row in block.distances.iter().take(clock.instants.len()) {
                for lane in (0..runs).filter(|lane| !dead.0[*lane]) {
                    histogram.push(row.0[lane]);
                }
            }
        }
        if let Some(frames) = &mut frames
            && (to - 1).is_multiple_of(plan.every)
        {
            keep(frames, layout, &block.shown, (kept, &dead));
            kept += 1;
        }
        if dead.0.contains(&true) {
            block.put_back(&before, &dead);
        }
        for lane in 0..L {
            if fell.0[lane] {
                (dead.0[lane], sound.0[lane]) = (true, to);
            }
        }
        k = to;
    }
    for lane in 0..L {
        if !dead.0[lane] {
            sound.0[lane] = k;
        }
    }
    exchange(&mut block.columns, &mut stored, (&open, &[]), layout.open(), moments);
    let made = |lane| result(study, &block, &stored, lane, sound.0[lane]);
    Ok(((0..runs).map(made).collect(), kept))
}

/// Runs at their start.
fn start<const L: usize>(study: &Study, first: usize) -> Block<L> {
    let (plan, layout) = (&study.plan, &study.layout);
    let mut columns = vec![Lane([0.0; L]); layout.open()];
    for lane in 0..L {
        // the last block is filled up with its last run
        let run = (first + lane).min(plan.runs - 1);
        let start = row(&plan.x0, layout.x, run).iter().chain(row(&plan.memory0, layout.z, run));
        for (column, value) in columns.iter_mut().zip(start) {
            column.0[lane] = *value;
        }
    }
    let shared = if study.plants_are_shared { plan.x0.clone() } else { Vec::new() };
    let first_run = plan.first_run.wrapping_add(first as u64);
    let kept = if plan.every > 0 { layout.x + layout.z + layout.y } else { 0 };
    let mut streams = [Channel::Measurement, Channel::Process]
        .map(|channel| streams(plan.seed, first_run, channel));
    for lane in (0..L).filter(|_| !plan.ar.is_empty()) {
        for i in 0..layout.y {
            let past = in_lane(&mut streams[0], lane, |stream| plan.noise_before(stream));
            for (column, past) in
                columns[layout.noise() + i..].iter_mut().step_by(layout.y).zip(past)
            {
                column.0[lane] = past;
            }
        }
    }
    Block {
        columns,
        shared,
        streams,
        own: Lane([0.0; L]),
        worst: Lane([0.0; L]),
        undefined_at: Lane([u64::MAX; L]),
        shown: vec![Lane([0.0; L]); kept],
        distances: Vec::new(),
    }
}

/// Put the moments of the windows that were open where they are stored, and take those that are now.
fn exchange<const L: usize>(
    columns: &mut Vec<Lane<f64, L>>,
    stored: &mut [Lane<f64, L>],
    (were, are): (&[usize], &[usize]),
    first: usize,
    moments: usize,
) {
    for (i, window) in were.iter().enumerate() {
        let from = first + i * moments;
        stored[window * moments..(window + 1) * moments]
            .copy_from_slice(&columns[from..from + moments]);
    }
    columns.truncate(first);
    for window in are {
        columns.extend_from_slice(&stored[window * moments..(window + 1) * moments]);
    }
}

/// Write a frame of every run that still lives.
fn keep<const L: usize>(
    frames: &mut Frames<'_>,
    layout: &Layout,
    shown: &[Lane<f64, L>],
    (number, dead): (usize, &Lane<bool, L>),
) {
    for (lane, run) in frames.runs.iter_mut().enumerate() {
        let mut values = shown.iter().map(|column| column.0[lane]);
        for (part, width) in run.iter_mut().zip([layout.x, layout.z, layout.y]) {
            let frame = part.get_mut(number * width..(number + 1) * width).unwrap_or_default();
            for (slot, value) in frame.iter_mut().zip(values.by_ref().take(width)) {
                *slot = if dead.0[lane] { f64::NAN } else { value };
            }
        }
    }
}

/// What a run gave that was sound for so many samples.
fn result<const L: usize>(
    study: &Study,
    block: &Block<L>,
    stored: &[Lane<f64, L>],
    lane: usize,
    sound: u64,
) -> RunResult {
    let (plan, layout) = (&study.plan, &study.layout);
    let column = |at: usize| block.columns.get(at).map_or(0.0, |column| column.0[lane]);
    let signals = layout.signals();
    let mut moments = Vec::with_capacity(plan.windows.len() * signals);
    for (number, window) in plan.windows.iter().enumerate() {
        let count = window.to.min(sound).saturating_sub(window.from);
        for signal in 0..signals {
            let mut at = number * layout.moments() + signal;
            let values = layout.kinds.map(|wanted| {
                let value =
                    if wanted { stored.get(at).map_or(0.0, |row| row.0[lane]) } else { 0.0 };
                at += if wanted { signals } else { 0 };
                value
            });
            let [sum, squares, max] = values;
            moments.push(Moments::from_sums(count, sum, squares, max));
        }
    }
    let times = layout.settled() + usize::from(layout.settle.is_some());
    let mut settled = vec![f64::NAN; layout.watched];
    for (at, (signal, _)) in layout.settles.iter().enumerate() {
        settled[*signal] = column(times + at);
    }
    let undefined_at = block.undefined_at.0[lane];
    RunResult {
        moments,
        peak: (0..signals)
            .map(|i| if layout.peaks { column(layout.peak() + i) } else { 0.0 })
            .collect(),
        settled,
        settling_time: layout.settle.map_or(f64::NAN, |_| column(layout.settled())),
        final_x: (0..layout.x).map(column).collect(),
        final_memory: (layout.memory()..layout.noise()).map(column).collect(),
        diverged_at: Some(sound).filter(|k| *k <= plan.steps),
        undefined_at: Some(undefined_at).filter(|k| *k != u64::MAX),
    }
}

/// Row `run` of a table that has one row for all runs or one a run.
pub fn row(table: &[f64], columns: usize, run: usize) -> &[f64] {
    if table.len() == columns { table } else { &table[run * columns..(run + 1) * columns] }
}
