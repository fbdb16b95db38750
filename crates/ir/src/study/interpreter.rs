//! Floor 8. The interpreter of the tables, over a block of runs: everywhere, at once.

// The form that a compiler makes vector code of: an index, and no branch between two truths.
#![allow(clippy::needless_range_loop)]

use super::Study;
use super::block::{Block, Engine, Instant, Layout, Span, Streams, in_lane};
use super::plan::DrawKind;
use super::tables::StudyTables;
use crate::compile::Compiled;
use crate::error::Result;
use crate::table::Table;
use hgo_rs::noise::{Law, Stream, radius_of, radius_parts, turned};
use hgo_rs::program::{Lane, Program, Registers};
use hgo_rs::simulate::DIVERGED;

/// A table as it is evaluated.
pub enum Form {
    /// As a program.
    Compiled(Compiled),
    /// Value by value, since functions of the user's are called.
    Called(Table),
}

impl Form {
    fn of(table: &Table) -> Result<Self> {
        if table.calls.is_empty() {
            Ok(Self::Compiled(table.compile()?))
        } else {
            Ok(Self::Called(table.clone()))
        }
    }
}

/// The tables of a study, as they are evaluated.
pub struct Programs {
    sample: Form,
    predict: Option<Form>,
    plant: Option<Form>,
}

impl Programs {
    /// # Errors
    /// A table that needs more registers than there are.
    pub fn of(tables: &StudyTables) -> Result<Self> {
        let form = |table: &Option<Table>| table.as_ref().map(Form::of).transpose();
        Ok(Self {
            sample: Form::of(&tables.sample)?,
            predict: form(&tables.predict)?,
            plant: form(&tables.plant)?,
        })
    }
}

/// A table with inputs of its own, constants in their places.
struct Loaded<'a, const L: usize> {
    form: &'a Form,
    registers: Box<Registers<Lane<f64, L>>>,
    /// Results of a table with calls.
    made: Vec<Lane<f64, L>>,
}

impl<'a, const L: usize> Loaded<'a, L> {
    fn of(form: &'a Form) -> Self {
        let (registers, results) = match form {
            Form::Compiled(compiled) => (compiled.registers::<f64>(), 0),
            Form::Called(table) => (Registers::zero(), table.outputs.len()),
        };
        let registers = Box::new(Registers::in_lanes(&registers));
        Self { form, registers, made: vec![Lane([0.0; L]); results] }
    }

    /// Numbers that are the same for all runs, then columns, into the first registers.
    #[inline(always)]
    fn put(&mut self, numbers: &[f64], columns: &[&[Lane<f64, L>]]) {
        let (first, rest) = self.registers.0.split_at_mut(numbers.len());
        for (register, number) in first.iter_mut().zip(numbers) {
            *register = Lane([*number; L]);
        }
        let mut at = 0;
        for columns in columns {
            rest[at..at + columns.len()].copy_from_slice(columns);
            at += columns.len();
        }
    }

    #[inline(always)]
    fn evaluate(&mut self) -> Result<()> {
        match self.form {
            Form::Compiled(compiled) => {
                compiled.program().run_lanes(&mut self.registers);
                Ok(())
            }
            Form::Called(table) => self.call(table),
        }
    }

    fn call(&mut self, table: &Table) -> Result<()> {
        for lane in 0..L {
            let given = self.registers.0.iter().take(table.inputs.len());
            let given: Vec<f64> = given.map(|register| register.0[lane]).collect();
            for (made, value) in self.made.iter_mut().zip(table.evaluate(&given)?) {
                made.0[lane] = value;
            }
        }
        Ok(())
    }

    /// Results from number `first` on into columns.
    #[inline(always)]
    fn take(&self, first: usize, to: &mut [Lane<f64, L>]) {
        match self.form {
            Form::Compiled(compiled) => {
                for (to, output) in to.iter_mut().zip(&compiled.outputs[first..]) {
                    *to = self.registers.0[usize::from(*output)];
                }
            }
            Form::Called(_) => to.copy_from_slice(&self.made[first..first + to.len()]),
        }
    }
}

/// What moves a block of runs.
pub struct Interpreter<'a, const L: usize> {
    study: &'a Study,
    sample: Loaded<'a, L>,
    predict: Option<Loaded<'a, L>>,
    plant: Option<Loaded<'a, L>>,
    /// The plants' step for numbers alone, where it is the same for all runs.
    shared: Option<(Program<'a>, Box<Registers<f64>>)>,
    /// Inputs of the plants, and memories before a step.
    u: Vec<Lane<f64, L>>,
    held: Vec<Lane<f64, L>>,
}

impl<'a, const L: usize> Interpreter<'a, L> {
    pub fn new(study: &'a Study) -> Self {
        let (programs, zeros) = (&study.programs, |count| vec![Lane([0.0; L]); count]);
        let shared = match &programs.plant {
            Some(Form::Compiled(plant)) if study.plants_are_shared => {
                Some((plant.program(), Box::new(plant.registers())))
            }
            _ => None,
        };
        Self {
            study,
            sample: Loaded::of(&programs.sample),
            predict: programs.predict.as_ref().map(Loaded::of),
            plant: programs.plant.as_ref().map(Loaded::of),
            shared,
            u: zeros(study.layout.u),
            held: zeros(study.layout.z),
        }
    }

    /// A sample of every run, and the way to the next one.
    #[inline(always)]
    fn sample(&mut self, block: &mut Block<L>, span: &Span<'_, L>, number: usize) -> Result<()> {
        let (study, at) = (self.study, &span.instants[number]);
        let (k, more) = (span.first + number as u64, at.more > 0.0);
        let (layout, tables) = (&study.layout, &study.tables);
        let (memory, noise) = (layout.memory(), layout.noise());
        draw(study, block, span, number);
        look(layout, block);
        let (x, rest) = block.columns.split_at(memory);
        let (z, rest) = rest.split_at(layout.z);
        self.sample.put(&[at.t, at.dt, at.plant_t, at.sines], &[z, x, &rest[..layout.y]]);
        self.sample.evaluate()?;
        let of_u = layout.z + layout.y;
        let of_now = of_u + layout.u;
        self.sample.take(of_u, &mut self.u);
        self.sample.take(of_now, &mut block.columns[layout.plant..layout.plant + layout.now]);
        if !tables.is_current {
            show(layout, block, (at.t, span, number));
        }
        let frames = !block.shown.is_empty();
        if frames {
            block.shown[..noise].copy_from_slice(&block.columns[..noise]);
            self.sample.take(layout.z, &mut block.shown[noise..]);
        }
        if more || tables.is_current {
            self.held.copy_from_slice(&block.columns[memory..noise]);
            self.sample.take(0, &mut block.columns[memory..noise]);
            if tables.is_joint {
                let moved = of_now + layout.x - layout.plant;
                self.sample.take(moved, &mut block.columns[..layout.plant]);
            }
            hold(layout, block, &self.held, k);
        }
        if tables.is_current {
            if frames {
                block.shown[memory..noise].copy_from_slice(&block.columns[memory..noise]);
            }
            show(layout, block, (at.t, span, number));
        }
        if more {
            let later = layout.plant + layout.now;
            self.sample.take(of_now + layout.now, &mut block.columns[later..memory]);
            self.predict(block, at, k)?;
            self.plants(block, at)?;
        }
        Ok(())
    }

    /// With current timing: the way on.
    #[inline(always)]
    fn predict(&mut self, block: &mut Block<L>, at: &Instant, k: u64) -> Result<()> {
        let Some(predict) = &mut self.predict else { return Ok(()) };
        let layout = &self.study.layout;
        let (memory, noise) = (layout.memory(), layout.noise());
        predict.put(&[at.t, at.dt], &[&block.columns[memory..noise], &self.u]);
        predict.evaluate()?;
        self.held.copy_from_slice(&block.columns[memory..noise]);
        predict.take(0, &mut block.columns[memory..noise]);
        hold(layout, block, &self.held, k);
        Ok(())
    }

    /// The plants over their substeps.
    #[inline(always)]
    fn plants(&mut self, block: &mut Block<L>, at: &Instant) -> Result<()> {
        let Some(plant) = &mut self.plant else { return Ok(()) };
        let (study, n) = (self.study, self.study.layout.plant);
        for i in 0..study.plan.substeps {
            let time = at.plant_t + f64::from(i) * at.h;
            if let Some((program, r)) = &mut self.shared {
                (r.0[0], r.0[1]) = (time, at.h);
                r.0[2..2 + n].copy_from_slice(&block.shared);
                program.run(r);
                for (i, output) in program.outputs.iter().enumerate() {
                    block.shared[i] = r.0[usize::from(*output)];
                    block.columns[i] = Lane([block.shared[i]; L]);
                }
                continue;
            }
            let x = &block.columns[..n];
            if study.tables.is_random {
                let xi = normal_pairs(&mut block.streams[1], study.tables.draws_both);
                plant.put(&[time, at.h], &[x, &self.u, &xi]);
            } else {
                plant.put(&[time, at.h], &[x, &self.u]);
            }
            plant.evaluate()?;
            plant.take(0, &mut block.columns[..n]);
        }
        Ok(())
    }
}

impl<const L: usize> Engine<L> for Interpreter<'_, L> {
    #[inline(always)]
    fn span(&mut self, block: &mut Block<L>, span: &Span<'_, L>) -> Result<()> {
        block.begin(span);
        for number in 0..span.instants.len() {
            self.sample(block, span, number)?;
        }
        Ok(())
    }
}

/// `worst` becomes the largest magnitude so far.
#[inline(always)]
fn look<const L: usize>(layout: &Layout, block: &mut Block<L>) {
    let (columns, worst) = (&block.columns, &mut block.worst);
    let later = &columns[layout.plant + layout.now..layout.noise()];
    for column in columns[..layout.plant].iter().chain(later) {
        let so_far = worst.0; // a copy: what is chosen is stored, not where
        for lane in 0..L {
            let size = column.0[lane].abs();
            worst.0[lane] = if size > so_far[lane] { size } else { so_far[lane] };
        }
    }
}

/// Where the memory after a step is not finite although all was sound before it, the model has no value:
/// the memory is held.
#[inline(always)]
fn hold<const L: usize>(layout: &Layout, block: &mut Block<L>, held: &[Lane<f64, L>], k: u64) {
    let (memory, noise) = (layout.memory(), layout.noise());
    let mut spoilt = [0.0; L]; // NaN where an entry is not finite
    for column in &block.columns[memory..noise] {
        for lane in 0..L {
            spoilt[lane] += 0.0 * column.0[lane];
        }
    }
    if spoilt.iter().fold(true, |sound, spoilt| sound & spoilt.is_finite()) {
        return;
    }
    for lane in 0..L {
        let inside = |column: &Lane<f64, L>| column.0[lane].abs() <= DIVERGED;
        if !spoilt[lane].is_finite()
            && held.iter().all(inside)
            && layout.states().take_while(|at| *at < memory).all(|at| inside(&block.columns[at]))
        {
            for (column, held) in block.columns[memory..noise].iter_mut().zip(held) {
                column.0[lane] = held.0[lane];
            }
            block.undefined_at.0[lane] = block.undefined_at.0[lane].min(k);
        }
    }
}

/// Take a sample into the metrics.
#[inline(always)]
fn show<const L: usize>(
    layout: &Layout,
    block: &mut Block<L>,
    (t, span, number): (f64, &Span<'_, L>, usize),
) {
    let (states, sums) = block.columns.split_at_mut(layout.noise());
    let (x, z) = states.split_at(layout.x);
    let sums = &mut sums[layout.noises..];
    let (errors, watched) = (layout.errors, &x[layout.watch()..][..layout.watched]);
    let (peaks, sums) = sums.split_at_mut(if layout.peaks { layout.signals() } else { 0 });
    for (peak, value) in peaks.iter_mut().zip(z[..errors].iter().chain(watched)) {
        largest(&mut peak.0, &value.0, &[0.0; L]);
    }
    let (settled, sums) = sums.split_at_mut(usize::from(layout.settle.is_some()));
    let (times, open) = sums.split_at_mut(layout.settles.len());
    for (last, (signal, threshold)) in times.iter_mut().zip(&layout.settles) {
        for lane in 0..L {
            let far = watched[*signal].0[lane].abs() >= *threshold;
            last.0[lane] = if far { t } else { last.0[lane] };
        }
    }
    let zeros = Lane([0.0; L]);
    let truth = |i: usize| layout.truth.get(i).and_then(|at| x.get(*at)).unwrap_or(&zeros);
    let [mean, rms, max] = layout.kinds;
    for window in open.chunks_exact_mut(layout.moments().max(1)) {
        let mut kinds = window.chunks_exact_mut(layout.signals().max(1));
        // a name, so that the loop over the runs is compiled for it
        macro_rules! each {
            ($($wanted:ident: $take:ident),+) => {$(
                if let Some(rows) = $wanted.then(|| kinds.next()).flatten() {
                    let (of_errors, of_watched) = rows.split_at_mut(errors);
                    for (i, (row, z)) in of_errors.iter_mut().zip(z).enumerate() {
                        $take(&mut row.0, &z.0, &truth(i).0);
                    }
                    for (row, value) in of_watched.iter_mut().zip(watched) {
                        $take(&mut row.0, &value.0, &zeros.0);
                    }
                }
            )+};
        }
        each!(mean: sum, rms: sum_of_squares, max: largest);
    }
    if layout.settle.is_none() && !span.distances {
        return;
    }
    let mut square = [0.0; L];
    for (i, z) in z.iter().enumerate().take(layout.truth.len()) {
        sum_of_squares(&mut square, &z.0, &truth(i).0);
    }
    if let (Some(threshold), [last]) = (layout.settle, settled) {
        for lane in 0..L {
            let far = square[lane].sqrt() >= threshold;
            last.0[lane] = if far { t } else { last.0[lane] };
        }
    }
    if span.distances {
        block.distances[number].0 = square;
    }
}

#[inline(always)]
fn sum<const L: usize>(sum: &mut [f64; L], z: &[f64; L], x: &[f64; L]) {
    for lane in 0..L {
        sum[lane] += z[lane] - x[lane];
    }
}

#[inline(always)]
fn sum_of_squares<const L: usize>(sum: &mut [f64; L], z: &[f64; L], x: &[f64; L]) {
    for lane in 0..L {
        let e = z[lane] - x[lane];
        sum[lane] += e * e;
    }
}

/// The magnitude of what is one already: a compiler then stores every lane's number. Where some stay
/// what they are it stores the others only, which is slow.
#[inline(always)]
fn largest<const L: usize>(largest: &mut [f64; L], z: &[f64; L], x: &[f64; L]) {
    for lane in 0..L {
        let (so_far, size) = (largest[lane].abs(), (z[lane] - x[lane]).abs());
        largest[lane] = if size > so_far { size } else { so_far };
    }
}

/// The drawn or recorded noise of a sample.
#[inline(always)]
fn draw<const L: usize>(study: &Study, block: &mut Block<L>, span: &Span<'_, L>, number: usize) {
    let (layout, at) = (&study.layout, &span.instants[number]);
    let plan = &study.plan;
    let columns = &mut block.columns[layout.noise()..layout.noise() + layout.noises];
    if let (Some((law, mean, scale)), true) = (plan.law(), at.fresh > 0.0) {
        for i in 0..layout.y {
            let mut new = match law {
                None => normal_pairs(&mut block.streams[0], false)[0],
                Some(law) => of_law(law, &mut block.streams[0]),
            };
            for lane in 0..L {
                new.0[lane] = mean + scale * new.0[lane];
            }
            for (a, past) in plan.ar.iter().zip(columns.iter().skip(i).step_by(layout.y)) {
                for lane in 0..L {
                    new.0[lane] += a * past.0[lane];
                }
            }
            for later in (1..plan.ar.len()).rev() {
                columns[later * layout.y + i] = columns[(later - 1) * layout.y + i];
            }
            columns[i] = new;
        }
    }
    match plan.draw {
        DrawKind::Uniform(low, high) if at.fresh > 0.0 => {
            let streams = &mut block.streams[0];
            for column in columns {
                for lane in 0..L {
                    column.0[lane] = low + (high - low) * in_lane(streams, lane, Stream::uniform);
                }
            }
        }
        // none, held, or drawn above
        DrawKind::None | DrawKind::Uniform(..) | DrawKind::Normal(..) | DrawKind::Law(..) => {}
        DrawKind::Shared(_) => columns.fill(Lane([at.noise; L])),
        DrawKind::Recorded { .. } | DrawKind::Own(_) => columns.fill(span.recorded[number]),
    }
}

/// A draw of every run.
fn of_law<const L: usize>(law: Law, streams: &mut Streams<L>) -> Lane<f64, L> {
    let mut drawn = Lane([0.0; L]);
    for lane in 0..L {
        drawn.0[lane] = in_lane(streams, lane, |stream| law.draw(stream));
    }
    drawn
}

/// A standard normal pair of every run, the second only where it is wanted. In several passes: the
/// processor works on more runs at once where the chain of each is short.
#[inline(always)]
pub fn normal_pairs<const L: usize>(streams: &mut Streams<L>, both: bool) -> [Lane<f64, L>; 2] {
    let [mut first, mut second, mut third] = [Lane([0.0; L]); 3];
    for lane in 0..L {
        (first.0[lane], second.0[lane]) =
            in_lane(streams, lane, |stream| (stream.uniform(), stream.uniform()));
    }
    for lane in 0..L {
        (first.0[lane], third.0[lane]) = radius_parts(first.0[lane]);
    }
    for lane in 0..L {
        first.0[lane] = radius_of((first.0[lane], third.0[lane]));
    }
    for lane in 0..L {
        let pair = turned(first.0[lane], second.0[lane]);
        first.0[lane] = pair.0;
        if both {
            second.0[lane] = pair.1;
        }
    }
    [first, second]
}
