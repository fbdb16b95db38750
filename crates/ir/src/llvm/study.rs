//! Floor 11. Studies printed as LLVM IR: one function that moves vectors of runs over a span of samples.
//!
//! What is the same for all runs is a number, computed once; everything else is a vector, of which several
//! copies stand side by side, operation by operation, since a processor works on more of them at once than
//! one chain of operations keeps busy.

use super::SUMS;
use super::printer::{Kind, Printer, Value, with_functions};
use crate::study::{DrawKind, Instant, LANES, Study};
use crate::table::Table;
use std::collections::BTreeSet;
use std::fmt::Write as _;

/// Numbers of an [`Instant`].
const ROW: usize = size_of::<Instant>() / size_of::<f64>();

/// Numbers a register from which on a processor has 32 of them.
const MANY: usize = 8;

/// A kernel's parameters, in order.
const PARAMETERS: [&str; 9] = [
    "columns",
    "shared",
    "measurement",
    "process",
    "rows",
    "recorded",
    "shown",
    "worst",
    "distances",
];

/// A study's kernels as source.
#[derive(Clone, Debug)]
pub struct Source {
    /// LLVM IR, with the functions of the core that it calls.
    pub text: String,
    /// For each number of open windows, with and without distances, the name of its function.
    pub names: Vec<(usize, bool, String)>,
}

impl Study {
    /// The study as LLVM IR for vectors of `lanes` runs, `copies` of them side by side; `None` where
    /// functions of the user's are called, or the block is no multiple of so many runs.
    pub fn kernel(&self, lanes: usize, copies: usize) -> Option<Source> {
        if self.tables.calls() || lanes * copies == 0 || !LANES.is_multiple_of(lanes * copies) {
            return None;
        }
        let mut source = Source { text: String::new(), names: Vec::new() };
        let mut functions = BTreeSet::new();
        for (open, distances) in self.forms() {
            let name = format!("span_{open}_{}", u8::from(distances));
            let kernel = Kernel { study: self, open, distances };
            let printer = kernel.print(lanes, copies);
            let given = PARAMETERS.map(|name| format!("ptr noalias %{name}")).join(", ");
            // writing to a string does not fail
            let _ = writeln!(source.text, "define void @{name}({given}, i64 %n) {{");
            for line in &printer.lines {
                let _ = writeln!(source.text, "{line}");
            }
            let _ = writeln!(source.text, "  ret void\n}}");
            functions.extend(printer.functions);
            source.names.push((open, distances, name));
        }
        with_functions(&mut source.text, lanes, functions)?;
        Some(source)
    }

    /// How many vectors of so many runs stand side by side. Few values leave room for more chains of
    /// operations than what is carried from sample to sample has registers for; many spill even alone.
    /// (Found by timing the five papers' studies.)
    pub fn copies(&self, lanes: usize) -> usize {
        let suited = match self.tables.width() {
            9..=24 => 4,
            25..=45 if lanes >= MANY => 4,
            0..=45 => 2,
            _ => 1,
        };
        suited.min(LANES / lanes.max(1))
    }

    /// The numbers of a vector and the vectors side by side that suit a processor of so many numbers a
    /// register. With the registers of AVX-512 the copies are one long vector, which LLVM takes apart:
    /// elementary functions then stand side by side too, and lines come in an order that needs few
    /// registers (up to 1.25 times as fast; with half the registers up to 1.2 times as slow).
    pub fn shape(&self, lanes: usize) -> (usize, usize) {
        let copies = self.copies(lanes);
        if lanes < MANY { (lanes, copies) } else { (lanes * copies, 1) }
    }

    /// Numbers of windows that are open at a time, with and without distances.
    pub(crate) fn forms(&self) -> BTreeSet<(usize, bool)> {
        let windows = self.plan.windows.iter();
        let all = windows.chain(&self.plan.histogram);
        let edges = all.flat_map(|window| [window.from, window.to]).chain([0]);
        let at = edges.filter(|k| *k < self.plan.steps);
        at.map(|k| {
            let open = self.plan.windows.iter().filter(|window| window.contains(k)).count();
            (open, self.plan.histogram.is_some_and(|window| window.contains(k)))
        })
        .collect()
    }
}

/// A function for spans in which so many windows are open.
struct Kernel<'a> {
    study: &'a Study,
    open: usize,
    distances: bool,
}

/// What a span carries from sample to sample.
struct State {
    x: Vec<Value>,
    z: Vec<Value>,
    noise: Vec<Value>,
    measurement: [Value; 4],
    process: [Value; 4],
    /// Peaks, the settling time, the moments of the open windows.
    sums: Vec<Value>,
    worst: [Value; SUMS],
}

impl Kernel<'_> {
    /// Columns of the state, the memory and the noise that a sample needs of the one before. The others are
    /// computed anew, also by the interpreter, which takes the last sample and all of a run that diverges.
    fn carried(&self) -> Vec<usize> {
        let (layout, plan) = (&self.study.layout, &self.study.plan);
        let now = layout.plant..layout.plant + layout.now;
        let noise = if plan.noise_lasts() { layout.noises } else { 0 };
        let anew = |column: &usize| now.contains(column) && !self.study.needs(*column);
        (0..layout.noise() + noise).filter(|column| !anew(column)).collect()
    }

    /// Every number that is carried, with its kind, where it is kept, and whether it is uniform.
    fn places(&self) -> Vec<(Kind, &'static str, usize, bool)> {
        let layout = &self.study.layout;
        let shared = self.study.plants_are_shared;
        let column = |at: usize| (Kind::Float, "columns", at * LANES, false);
        let carried = self.carried().into_iter();
        let mut places: Vec<_> =
            carried
                .map(|i| {
                    if shared && i < layout.x {
                        (Kind::Float, "shared", i, true)
                    } else {
                        column(i)
                    }
                })
                .collect();
        for name in ["measurement", "process"] {
            places.extend((0..4).map(|i| (Kind::Bits, name, i * LANES, false)));
        }
        let end = layout.open() + self.open * layout.moments();
        places.extend((layout.peak()..end).map(column));
        places.extend((0..SUMS).map(|i| (Kind::Float, "worst", i * LANES, false)));
        places
    }

    /// The numbers of [`Self::places`] by their names.
    fn state(&self, values: &[Value]) -> State {
        let layout = &self.study.layout;
        let mut rest = values.iter().cloned();
        let mut take = |count: usize| -> Vec<Value> { rest.by_ref().take(count).collect() };
        let four = |values: Vec<Value>| -> [Value; 4] {
            std::array::from_fn(|i| values.get(i).cloned().unwrap_or(Printer::constant(0.0)))
        };
        let carried = self.carried();
        let mut columns = vec![Printer::constant(0.0); layout.noise() + layout.noises];
        for (column, value) in carried.iter().zip(take(carried.len())) {
            columns[*column] = value;
        }
        let noise = columns.split_off(layout.noise());
        let z = columns.split_off(layout.memory());
        let x = columns;
        let (measurement, process) = (four(take(4)), four(take(4)));
        let mut sums = take(values.len());
        let worst = sums.split_off(sums.len().saturating_sub(SUMS));
        let worst =
            std::array::from_fn(|i| worst.get(i).cloned().unwrap_or(Printer::constant(0.0)));
        State { x, z, noise, measurement, process, sums, worst }
    }

    fn values(&self, state: State) -> Vec<Value> {
        let State { x, z, noise, measurement, process, sums, worst } = state;
        let columns = [x, z, noise].concat();
        let carried: Vec<Value> = self.carried().iter().map(|at| columns[*at].clone()).collect();
        [carried, measurement.into(), process.into(), sums, worst.into()].concat()
    }

    fn print(&self, lanes: usize, copies: usize) -> Printer {
        let mut printer = Printer::new(lanes, copies);
        let p = &mut printer;
        p.begin("entry");
        let places = self.places();
        let mut starts = Vec::new();
        for (kind, base, at, uniform) in &places {
            starts.push(p.load(*kind, base, &at.to_string(), *uniform));
        }
        p.leave("br label %loop");
        p.begin("loop");
        // what is carried has a name now, and a line once it is known where it comes from
        let header = p.lines.len();
        let mut now = Vec::new();
        for (_, _, _, uniform) in &places {
            let count = if *uniform { 1 } else { copies };
            let names: Vec<String> = (0..count).map(|_| p.name()).collect();
            now.push(if *uniform { Value::Uniform(names[0].clone()) } else { Value::Each(names) });
        }
        let (next, shown) = self.sample(p, self.state(&now));
        let next = self.values(next);
        p.line("  %k.next = add i64 %k, 1".into());
        p.line("  %more = icmp ult i64 %k.next, %n".into());
        let latch = p.label.clone();
        let mut phis = vec![format!("  %k = phi i64 [ 0, %entry ], [ %k.next, %{latch} ]")];
        for (((kind, _, _, uniform), now), (start, next)) in
            places.iter().zip(&now).zip(starts.iter().zip(&next))
        {
            let of = p.of(*kind, *uniform);
            let of_copy = |value: &Value, copy: usize| match value {
                Value::Uniform(name) => name.clone(),
                Value::Each(names) => names[copy].clone(),
            };
            for copy in 0..if *uniform { 1 } else { copies } {
                let [now, start, next] = [now, start, next].map(|value| of_copy(value, copy));
                phis.push(format!("  {now} = phi {of} [ {start}, %entry ], [ {next}, %{latch} ]"));
            }
        }
        p.insert(header, phis);
        p.leave("br i1 %more, label %loop, label %done");
        p.begin("done");
        for ((kind, base, at, uniform), value) in places.iter().zip(&next) {
            p.store(*kind, base, &at.to_string(), value, *uniform);
            if *uniform {
                p.store(Kind::Float, "columns", &(at * LANES).to_string(), value, false);
            }
        }
        for (i, value) in shown.iter().enumerate() {
            p.store(Kind::Float, "shown", &(i * LANES).to_string(), value, false);
        }
        printer
    }

    /// A number of the sample's row.
    fn of_row(p: &mut Printer, row: &str, at: usize) -> Value {
        let (place, result) = (p.name(), p.name());
        p.line(format!("  {place} = getelementptr double, ptr {row}, i64 {at}"));
        p.line(format!("  {result} = load double, ptr {place}, align 8"));
        Value::Uniform(result)
    }

    /// A sample: the state after it, and what a frame shows.
    fn sample(&self, p: &mut Printer, mut state: State) -> (State, Vec<Value>) {
        let (study, tables) = (self.study, &self.study.tables);
        let (offset, row) = (p.name(), p.name());
        p.line(format!("  {offset} = mul i64 %k, {ROW}"));
        p.line(format!("  {row} = getelementptr double, ptr %rows, i64 {offset}"));
        let clock: Vec<Value> = (0..5).map(|at| Self::of_row(p, &row, at)).collect();
        let [t, dt, plant_t, h, sines] = &clock[..] else { return (state, Vec::new()) };
        self.draw(p, &mut state, &row);
        let later = study.layout.plant + study.layout.now;
        let (x, _) = state.x.split_at(study.layout.plant);
        let waiting = state.x.iter().skip(later);
        for (i, value) in state.z.iter().chain(x).chain(waiting).enumerate() {
            let sum = &mut state.worst[i % SUMS];
            *sum = p.bounded(sum, value);
        }
        let given = [t.clone(), dt.clone(), plant_t.clone(), sines.clone()];
        let noise = &state.noise[..study.layout.y];
        let inputs: [&[Value]; 4] = [&given, &state.z, &state.x, noise];
        let mut made = p.table(&tables.sample, &inputs, study.samples_are_there).into_iter();
        let layout = &study.layout;
        let next = made.by_ref().take(layout.z).collect();
        let y: Vec<Value> = made.by_ref().take(layout.y).collect();
        let u: Vec<Value> = made.by_ref().take(layout.u).collect();
        let now = made.by_ref().take(layout.now).collect();
        let (plant, later) = (layout.plant, layout.plant + layout.now);
        let now = Self::each(p, now);
        state.x.splice(plant..later, now);
        if !tables.is_current {
            self.show(p, &mut state, t);
        }
        let before = std::mem::replace(&mut state.z, Self::each(p, next));
        if tables.is_current {
            self.show(p, &mut state, t);
        }
        let mut shown = Vec::new();
        if study.plan.every > 0 {
            let z = if tables.is_current { state.z.clone() } else { before };
            shown = [state.x.clone(), z, y].concat();
        }
        let waiting = made.by_ref().take(layout.x - later).collect();
        let waiting = Self::each(p, waiting);
        state.x.splice(later.., waiting);
        if tables.is_joint {
            let moved = Self::each(p, made.collect());
            state.x.splice(..plant, moved);
        }
        if let Some(predict) = &tables.predict {
            let inputs: [&[Value]; 3] = [&[t.clone(), dt.clone()], &state.z, &u];
            let next = p.table(predict, &inputs, study.samples_are_there);
            state.z = Self::each(p, next);
        }
        if let Some(plant) = &tables.plant {
            self.plants(p, &mut state, (plant_t, h), (plant, &u));
        }
        (state, shown)
    }

    /// The drawn or recorded noise.
    fn draw(&self, p: &mut Printer, state: &mut State, row: &str) {
        let plan = &self.study.plan;
        match plan.draw {
            DrawKind::None => {}
            DrawKind::Shared(_) => {
                let noise = Self::of_row(p, row, 5);
                // carried as a vector: the interpreter takes it from there
                let noise = Value::Each((0..p.copies).map(|copy| p.vector(&noise, copy)).collect());
                state.noise.fill(noise);
            }
            DrawKind::Recorded { .. } | DrawKind::Own(_) => {
                let at = p.name();
                p.line(format!("  {at} = mul i64 %k, {LANES}"));
                let noise = p.load(Kind::Float, "recorded", &at, false);
                state.noise.fill(noise);
            }
            DrawKind::Uniform(..) | DrawKind::Normal(..) | DrawKind::Law(..) if plan.hold <= 1 => {
                self.fresh(p, state);
            }
            DrawKind::Uniform(..) | DrawKind::Normal(..) | DrawKind::Law(..) => {
                let fresh = Self::of_row(p, row, 6);
                let (Value::Uniform(fresh), truth, from) = (fresh, p.name(), p.label.clone())
                else {
                    return;
                };
                p.line(format!("  {truth} = fcmp une double {fresh}, 0x{:016X}", 0));
                p.leave(&format!("br i1 {truth}, label %draw, label %drawn"));
                let held = [&state.noise[..], &state.measurement[..]].concat();
                p.begin("draw");
                self.fresh(p, state);
                p.leave("br label %drawn");
                let new = [&state.noise[..], &state.measurement[..]].concat();
                let by = p.label.clone();
                p.begin("drawn");
                let noises = state.noise.len();
                let mut joined = Vec::new();
                for (i, (held, new)) in held.iter().zip(&new).enumerate() {
                    let kind = if i < noises { Kind::Float } else { Kind::Bits };
                    let of = p.of(kind, false);
                    let (Value::Each(held), Value::Each(new)) = (held, new) else { continue };
                    let names = held.iter().zip(new).map(|(held, new)| {
                        let name = p.name();
                        p.line(format!(
                            "  {name} = phi {of} [ {held}, %{from} ], [ {new}, %{by} ]"
                        ));
                        name
                    });
                    joined.push(Value::Each(names.collect()));
                }
                let streams = joined.split_off(noises);
                state.noise = joined;
                for (word, stream) in state.measurement.iter_mut().zip(streams) {
                    *word = stream;
                }
            }
        }
    }

    /// New draws.
    fn fresh(&self, p: &mut Printer, state: &mut State) {
        let (plan, outputs) = (&self.study.plan, self.study.layout.y);
        for i in 0..outputs {
            let (from, drawn, by) = match (plan.draw.clone(), plan.law()) {
                (DrawKind::Uniform(low, high), _) => {
                    (low, p.uniform(&mut state.measurement), high - low)
                }
                (_, Some((law, mean, scale))) => {
                    let drawn = match law {
                        None => p.normal_pair(&mut state.measurement)[0].clone(),
                        Some(law) => p.of_law(law, &mut state.measurement),
                    };
                    (mean, drawn, scale)
                }
                _ => return,
            };
            let part = p.binary("fmul", &Printer::constant(by), &drawn);
            let mut new = p.binary("fadd", &Printer::constant(from), &part);
            for (j, a) in plan.ar.iter().enumerate() {
                let past = state.noise[j * outputs + i].clone();
                let part = p.binary("fmul", &Printer::constant(*a), &past);
                new = p.binary("fadd", &new, &part);
            }
            for later in (1..plan.ar.len()).rev() {
                state.noise[later * outputs + i] = state.noise[(later - 1) * outputs + i].clone();
            }
            state.noise[i] = new;
        }
    }

    /// A sample in the metrics.
    fn show(&self, p: &mut Printer, state: &mut State, t: &Value) {
        let layout = &self.study.layout;
        let (zero, signals) = (Printer::constant(0.0), layout.signals());
        let watched = state.x[layout.watch()..][..layout.watched].to_vec();
        let values = [&state.z[..layout.errors], &watched].concat();
        let largest = |p: &mut Printer, so_far: &Value, value: &Value| {
            let size = p.intrinsic("fabs", &[value]);
            p.choose(("ogt", &size, so_far), &size, so_far)
        };
        let peaks = if layout.peaks { signals } else { 0 };
        for (sum, value) in state.sums.iter_mut().zip(&values).take(peaks) {
            *sum = largest(p, sum, value);
        }
        let settled = peaks;
        let times = settled + usize::from(layout.settle.is_some());
        for (at, (signal, threshold)) in layout.settles.iter().enumerate() {
            let size = p.intrinsic("fabs", &[&watched[*signal]]);
            let far = ("oge", &size, &Printer::constant(*threshold));
            state.sums[times + at] = p.choose(far, t, &state.sums[times + at].clone());
        }
        let open = times + layout.settles.len();
        if self.open > 0 {
            let errors: Vec<Value> = (0..signals)
                .map(|i| {
                    let known = layout.truth.get(i).filter(|_| i < layout.errors);
                    let x = known.map(|at| state.x[*at].clone());
                    p.binary("fsub", &values[i], &x.unwrap_or_else(|| zero.clone()))
                })
                .collect();
            let [mean, rms, max] = layout.kinds;
            let squares: Vec<Value> = if rms {
                errors.iter().map(|e| p.binary("fmul", e, e)).collect()
            } else {
                Vec::new()
            };
            let mut at = open;
            for _ in 0..self.open {
                if mean {
                    for (i, e) in errors.iter().enumerate() {
                        state.sums[at + i] = p.binary("fadd", &state.sums[at + i].clone(), e);
                    }
                    at += signals;
                }
                if rms {
                    for (i, square) in squares.iter().enumerate() {
                        state.sums[at + i] = p.binary("fadd", &state.sums[at + i].clone(), square);
                    }
                    at += signals;
                }
                if max {
                    for (i, e) in errors.iter().enumerate() {
                        state.sums[at + i] = largest(p, &state.sums[at + i].clone(), e);
                    }
                    at += signals;
                }
            }
        }
        if layout.settle.is_none() && !self.distances {
            return;
        }
        let mut square = zero;
        for (i, at) in layout.truth.iter().enumerate() {
            let e = p.binary("fsub", &state.z[i].clone(), &state.x[*at].clone());
            let part = p.binary("fmul", &e, &e);
            square = p.binary("fadd", &square, &part);
        }
        if let Some(threshold) = layout.settle {
            let distance = p.intrinsic("sqrt", &[&square]);
            let far = ("oge", &distance, &Printer::constant(threshold));
            let last = state.sums[settled].clone();
            state.sums[settled] = p.choose(far, t, &last);
        }
        if self.distances {
            let at = p.name();
            p.line(format!("  {at} = mul i64 %k, {LANES}"));
            p.store(Kind::Float, "distances", &at, &square, false);
        }
    }

    /// The plants over their substeps.
    fn plants(
        &self,
        p: &mut Printer,
        state: &mut State,
        (plant_t, h): (&Value, &Value),
        (plant, u): (&Table, &[Value]),
    ) {
        let substeps = self.study.plan.substeps;
        if substeps == 1 {
            // the plant's time + 0·h is the plant's time, but for the sign of 0, which no sum keeps
            let zero = p.binary("fmul", &Printer::constant(0.0), h);
            let time = p.binary("fadd", plant_t, &zero);
            self.substep(p, state, (&time, h), (plant, u));
            return;
        }
        let from = p.label.clone();
        p.leave("br label %substep");
        p.begin("substep");
        let header = p.lines.len();
        let random = self.study.tables.is_random;
        let started = [&state.x[..], if random { &state.process[..] } else { &[] }].concat();
        let states = state.x.len();
        let mut inside = Vec::new();
        for value in &started {
            inside.push(match value {
                Value::Uniform(_) => Value::Uniform(p.name()),
                Value::Each(names) => Value::Each(names.iter().map(|_| p.name()).collect()),
            });
        }
        state.x = inside[..states].to_vec();
        for (word, value) in state.process.iter_mut().zip(&inside[states..]) {
            *word = value.clone();
        }
        let number = p.name();
        p.line(format!("  {number} = uitofp i64 %s to double"));
        let offset = p.binary("fmul", &Value::Uniform(number), h);
        let time = p.binary("fadd", plant_t, &offset);
        self.substep(p, state, (&time, h), (plant, u));
        let ended = [&state.x[..], if random { &state.process[..] } else { &[] }].concat();
        p.line("  %s.next = add i64 %s, 1".into());
        p.line(format!("  %s.more = icmp ult i64 %s.next, {substeps}"));
        let latch = p.label.clone();
        let mut phis = vec![format!("  %s = phi i64 [ 0, %{from} ], [ %s.next, %{latch} ]")];
        for (i, ((inside, start), end)) in inside.iter().zip(&started).zip(&ended).enumerate() {
            let kind = if i < states { Kind::Float } else { Kind::Bits };
            let each: Vec<[String; 3]> = match (inside, start, end) {
                (Value::Uniform(a), Value::Uniform(b), Value::Uniform(c)) => {
                    vec![[a.clone(), b.clone(), c.clone()]]
                }
                (Value::Each(a), Value::Each(b), Value::Each(c)) => {
                    let rows = a.iter().zip(b).zip(c);
                    rows.map(|((a, b), c)| [a.clone(), b.clone(), c.clone()]).collect()
                }
                _ => Vec::new(),
            };
            let of = p.of(kind, matches!(inside, Value::Uniform(_)));
            for [name, start, end] in each {
                phis.push(format!("  {name} = phi {of} [ {start}, %{from} ], [ {end}, %{latch} ]"));
            }
        }
        p.insert(header, phis);
        p.leave("br i1 %s.more, label %substep, label %moved");
        p.begin("moved");
    }

    fn substep(
        &self,
        p: &mut Printer,
        state: &mut State,
        (time, h): (&Value, &Value),
        (plant, u): (&Table, &[Value]),
    ) {
        let tables = &self.study.tables;
        let mut xi = [Printer::constant(0.0), Printer::constant(0.0)];
        if tables.is_random {
            xi = p.normal_pair(&mut state.process);
        }
        let n = self.study.layout.plant;
        let inputs: [&[Value]; 4] = [&[time.clone(), h.clone()], &state.x[..n], u, &xi];
        let next = p.table(plant, &inputs, true);
        let next = if self.study.plants_are_shared { next } else { Self::each(p, next) };
        state.x.splice(..n, next);
    }

    /// Values that are carried as vectors.
    fn each(p: &mut Printer, values: Vec<Value>) -> Vec<Value> {
        values
            .into_iter()
            .map(|value| match value {
                Value::Uniform(_) => {
                    Value::Each((0..p.copies).map(|copy| p.vector(&value, copy)).collect())
                }
                each @ Value::Each(_) => each,
            })
            .collect()
    }
}
