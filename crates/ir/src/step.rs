//! Floor 7. A step of an observer as a program, with registers in which constants and parameters stand.

use crate::compile::Compiled;
use crate::error::{Result, refused};
use crate::order::{CHAINS, MAX_INPUTS};
use crate::recursion::{AnyObserver, Block, Recursion, Tabled, Widths};
use crate::table::Table;
use crate::tables::{Lengths, MEMORY, PlacedChain, Shape, Tables, length_of};
use crate::trace::{self, Setting, Traced, input, named, trace};
use hgo_rs::Scalar;
use hgo_rs::observer::Status;
use hgo_rs::program::{REGISTERS, Registers};
use hgo_rs::simulate::DIVERGED;
use std::cell::RefCell;
use std::sync::Arc;

/// A step of an observer, or a half of it, as a program, with registers in which constants and
/// parameters stand.
pub(crate) struct Step {
    compiled: Compiled,
    at_rest: Registers<f64>,
    /// Constants and parameters alone, with their registers.
    fixed: Vec<(u8, f64)>,
    /// Where among the outputs the memory stands that a record shows; the first are the next memory.
    shown: usize,
    /// Whether an entry of the memory is handed on to a later one: it must be read before its place is
    /// written.
    hands_on: bool,
}

/// Whether a memory is within the bounds beyond which an observer counts as diverged.
pub(crate) fn within(memory: &[f64]) -> bool {
    memory.iter().all(|value| value.abs() <= DIVERGED)
}

/// A step in all its forms.
pub struct Steps<S> {
    usual: Arc<S>,
    /// The same for a missing sample, if that is another law.
    missing: Option<Arc<S>>,
    /// The same with and without a sample for a law that has not started, see [`Tables::unstarted`].
    unstarted: Option<(usize, [Arc<S>; 2])>,
}

impl<S> Steps<S> {
    /// The step for such a sample.
    pub fn choose(&self, memory: &[f64], present: bool) -> &Arc<S> {
        if let Some((index, [with, without])) = &self.unstarted
            && memory.get(*index).is_some_and(|entry| *entry <= 0.0)
        {
            return if present { with } else { without };
        }
        match &self.missing {
            Some(missing) if !present => missing,
            _ => &self.usual,
        }
    }
}

thread_local! {
    /// Registers of single steps: to fill all of them would take longer than a step.
    static SCRATCH: RefCell<Box<Registers<f64>>> = RefCell::new(Box::new(Registers::zero()));
}

/// An observer whose step is a program.
pub struct Programmed {
    pub(crate) tables: Tables,
    /// From sample to sample of a record; with current timing a correction, shown, and the way on.
    pub(crate) whole: Steps<Step>,
    /// The halves: the use of a sample with current timing, and the way to the next one.
    pub(crate) correct: Option<Steps<Step>>,
    pub(crate) advance: Steps<Step>,
}

impl Tables {
    /// A correction and the way on as one step: (next memory, innovation, memory after the correction).
    pub(crate) fn whole(&self, correct: &Table) -> Result<Table> {
        let m = self.shape.memory;
        trace(Setting::usual(false), || {
            let given: Vec<Traced> = correct.inputs.iter().map(|name| input(name)).collect();
            let corrected = trace::inline(correct, &given);
            let mut on = given;
            on[MEMORY..MEMORY + m].copy_from_slice(&corrected[..m]);
            let next = trace::inline(&self.advance, &on);
            let (z, innovation) = corrected.split_at(m);
            Ok([named("z", &next), named("innovation", innovation), named("shown", z)].concat())
        })
    }

    /// The halves of a step, as `make` makes them of their tables: the use of a sample with current
    /// timing, and the way to the next one.
    pub(crate) fn halves<S>(
        &self,
        make: impl Fn(&Table) -> Result<S>,
    ) -> Result<(Option<Steps<S>>, Steps<S>)> {
        let Some(correct) = &self.correct else {
            return Ok((None, self.forms(&self.advance, make)?));
        };
        let usual = Arc::new(make(&self.advance)?);
        let advance = Steps { usual, missing: None, unstarted: None };
        Ok((Some(self.forms(correct, make)?), advance))
    }

    /// What `make` makes of a table that takes the sample, in all forms that it has.
    pub(crate) fn forms<S>(
        &self,
        usual: &Table,
        make: impl Fn(&Table) -> Result<S>,
    ) -> Result<Steps<S>> {
        let step = |table: &Table| Ok::<_, crate::Error>(Arc::new(make(table)?));
        let unstarted = match &self.unstarted {
            None => None,
            Some((index, [with, without])) => Some((*index, [step(with)?, step(without)?])),
        };
        let missing = self.missing.as_ref().map(step).transpose()?;
        Ok(Steps { usual: step(usual)?, missing, unstarted })
    }

    /// The program of a step.
    pub(crate) fn program(&self, table: &Table, shown: usize) -> Result<Step> {
        let (compiled, m) = (table.compile()?, self.shape.memory);
        let of = |from: usize| compiled.outputs.iter().skip(from).take(m);
        let next = (MEMORY..).zip(of(0).zip(of(shown)));
        let before = |place, of: &u8| (MEMORY..place).contains(&usize::from(*of));
        let hands_on = { next }.any(|(place, (a, b))| before(place, a) || before(place, b));
        let parameters = (self.given()..).zip(&self.parameters);
        let parameters =
            parameters.filter_map(|(at, value)| Some((u8::try_from(at).ok()?, *value)));
        let fixed = compiled.constants().iter().copied().chain(parameters).collect();
        Ok(Step { at_rest: self.at_rest(&compiled), fixed, compiled, shown, hands_on })
    }

    /// Inputs of a step before its parameters.
    fn given(&self) -> usize {
        let Shape { memory, n_y, n_u, .. } = self.shape;
        2 + memory + n_y + n_u
    }

    /// Registers of the step's program before a run.
    fn at_rest<T: Scalar>(&self, step: &Compiled) -> Registers<T> {
        let mut registers = step.registers();
        let places = registers.0.iter_mut().skip(self.given());
        places.zip(&self.parameters).for_each(|(place, value)| *place = T::from_f64(*value));
        registers
    }

    /// Memories along a record in single precision: times (N,), samples (N, n_y), inputs (N, n_u), memory
    /// to start from. Row k stands before sample k, or after it if the law filters.
    #[allow(clippy::cast_possible_truncation)]
    pub fn run_single(
        &self,
        t: &[f64],
        (y, u): (&[f64], &[f64]),
        memory0: &[f64],
    ) -> Result<Vec<Vec<f32>>> {
        let Shape { memory, n_y, n_u, .. } = self.shape;
        let samples = t.len();
        if y.len() != samples * n_y || u.len() != samples * n_u || memory0.len() != memory {
            let message = "t, y, u and memory0 must have N, N n_y, N n_u and m entries";
            return Err(refused(message));
        }
        let compile = |table: &Table| {
            table.compile().map(|compiled| (self.at_rest::<f32>(&compiled), compiled))
        };
        let correct = self.correct.as_ref().map(compile).transpose()?;
        let advance = compile(&self.advance)?;
        let missing = self.missing.as_ref().map(compile).transpose()?;
        let unstarted = match &self.unstarted {
            Some((index, [with, without])) => Some((*index, [compile(with)?, compile(without)?])),
            None => None,
        };
        let mut z: Vec<f32> = memory0.iter().map(|value| *value as f32).collect();
        let mut rows = Vec::with_capacity(samples);
        for k in 0..samples {
            let (y, u) = (&y[k * n_y..(k + 1) * n_y], &u[k * n_u..(k + 1) * n_u]);
            let present = y.iter().all(|y| y.is_finite());
            let take = |z: &[f32], usual| {
                let fresh = unstarted.as_ref().filter(|(index, _)| z[*index] <= 0.0);
                match fresh {
                    Some((_, forms)) => &forms[usize::from(!present)],
                    None => missing.as_ref().filter(|_| !present).unwrap_or(usual),
                }
            };
            let dt = t.get(k + 1).map(|next| (next - t[k]) as f32);
            let evaluate = |z: &mut Vec<f32>, of: &(Registers<f32>, Compiled), dt: f32| {
                let (at_rest, step) = of;
                let mut r = *at_rest;
                let sample = y.iter().chain(u).map(|value| *value as f32);
                let given = [t[k] as f32, dt].into_iter().chain(z.iter().copied()).chain(sample);
                r.0.iter_mut().zip(given).for_each(|(slot, value)| *slot = value);
                step.program().run(&mut r);
                let next = step.outputs.iter().take(memory).map(|output| r.0[usize::from(*output)]);
                let next: Vec<f32> = next.collect();
                if !next.iter().all(|value| value.is_finite()) {
                    return Err(refused(format!("the model has no value at sample {k}")));
                }
                *z = next;
                Ok(())
            };
            if let Some(correct) = &correct {
                let of = take(&z, correct);
                evaluate(&mut z, of, 0.0)?;
            }
            rows.push(z.clone());
            if let Some(dt) = dt {
                let of = if correct.is_some() { &advance } else { take(&z, &advance) };
                evaluate(&mut z, of, dt)?;
            }
        }
        Ok(rows)
    }
}

impl Step {
    /// Evaluate for a sample; the memory stands in the registers and is moved there, unless it would
    /// not be finite any more. What is shown goes to a row, as in [`keep`].
    #[inline(always)]
    fn advance(
        &self,
        r: &mut Registers<f64>,
        memory: usize,
        (t, dt): (f64, f64),
        (y, u): (&[f64], &[f64]),
        (row, largest): (&mut [f64], &mut [f64]),
    ) -> bool {
        (r.0[0], r.0[1]) = (t, dt);
        let given = r.0.get_mut(MEMORY + memory..).unwrap_or_default();
        given.iter_mut().zip(y).for_each(|(slot, y)| *slot = *y);
        let given = given.get_mut(y.len()..).unwrap_or_default();
        given.iter_mut().zip(u).for_each(|(slot, u)| *slot = *u);
        self.compiled.program().run(r);
        let next = self.compiled.outputs.get(..memory).unwrap_or(&[]);
        let shown = self.compiled.outputs.get(self.shown..self.shown + memory).unwrap_or(&[]);
        let mut spoilt = 0.0;
        for output in next {
            spoilt += 0.0 * r.0[usize::from(*output)];
        }
        // what was out of bounds before grew too large; within them the model has no value
        let grew = spoilt.is_nan() && !within(&r.0[MEMORY..MEMORY + memory]);
        let moved = !spoilt.is_nan() || grew;
        if let (true, Some(first)) = (grew, largest.first_mut()) {
            *first = f64::NAN;
        }
        if moved && !self.hands_on {
            // at once: a number that was just written is soon read again as it was written, by itself
            for (i, (output, shown)) in next.iter().zip(shown).enumerate() {
                let (value, shown) = (r.0[usize::from(*output)], r.0[usize::from(*shown)]);
                if let Some(place) = r.0.get_mut(MEMORY + i) {
                    *place = value;
                }
                keep(shown, row.get_mut(i), largest.get_mut(i));
            }
            return true;
        }
        let numbers = |outputs: &[u8], r: &Registers<f64>| -> Vec<f64> {
            outputs.iter().map(|output| r.0[usize::from(*output)]).collect()
        };
        let (next, shown) = (numbers(next, r), numbers(shown, r));
        let taken = self.shown > 0 && shown.iter().all(|value| value.is_finite());
        if moved {
            r.0[MEMORY..MEMORY + memory].copy_from_slice(&next);
        } else if taken {
            // the sample was taken, the way on has no value
            r.0[MEMORY..MEMORY + memory].copy_from_slice(&shown);
        }
        if moved || taken {
            for (i, value) in shown.iter().enumerate() {
                keep(*value, row.get_mut(i), largest.get_mut(i));
            }
        } else {
            show(r, row, largest);
        }
        moved
    }
}

impl Programmed {
    /// The times that a sample's corrections are for.
    fn lengths(&self, memory: &[f64], y: &[f64], dt: f64) -> Lengths {
        let mut lengths = [0; CHAINS];
        for (length, placed) in lengths.iter_mut().zip(&self.tables.placed) {
            *length = length_of(placed, memory, y, dt);
        }
        lengths
    }

    /// Whether these are they.
    #[inline(always)]
    fn are_lengths(&self, known: &Lengths, memory: &[f64], y: &[f64], dt: f64) -> bool {
        let mut chains = known.iter().zip(&self.tables.placed);
        chains.all(|(known, placed)| *known == length_of(placed, memory, y, dt))
    }

    /// Gains for corrections of these lengths into their registers.
    fn put_gains(&self, lengths: &Lengths, r: &mut Registers<f64>) {
        let mut place = self.tables.given() + self.tables.parameters.len();
        for (length, PlacedChain { gains, .. }) in lengths.iter().zip(&self.tables.placed) {
            if let Some(registers) = r.0.get_mut(place..place + gains.count) {
                gains.write(f64::from_bits(*length), registers);
            }
            place += gains.count;
        }
    }

    /// Step over a block with m entries of memory, at best a number that the compiler knows.
    #[inline(always)]
    fn advance_by(&self, m: usize, memory: &mut [f64], block: Block<'_>) -> f64 {
        match self.tables.shape {
            Shape { n_y: 1, n_u: 0, .. } => self.advance_with(m, (1, 0), memory, block),
            Shape { n_y, n_u, .. } => self.advance_with(m, (n_y, n_u), memory, block),
        }
    }

    /// The same with p entries of a sample and q inputs.
    #[inline(always)]
    fn advance_with(
        &self,
        m: usize,
        (p, q): (usize, usize),
        memory: &mut [f64],
        block: Block<'_>,
    ) -> f64 {
        let Block { t, dt, mut y, u, memory: rows, innovation, status: made } = block;
        let current = self.tables.shape.current;
        let place = MEMORY..MEMORY + m;
        let one = self.whole.missing.is_none() && self.whole.unstarted.is_none();
        let mut lengths: Option<Lengths> = None;
        let mut step = self.whole.choose(memory, true).clone();
        let mut r = step.at_rest;
        r.0[place.clone()].copy_from_slice(memory);
        let mut largest = [0.0_f64; REGISTERS];
        if !current {
            show(&r, rows.get_mut(..m).unwrap_or_default(), &mut largest);
        }
        for (k, made) in made.iter_mut().enumerate() {
            let shown = k + usize::from(!current); // before the next sample, or after this one
            let row = rows.get_mut(shown * m..(shown + 1) * m).unwrap_or_default();
            let sample = y.take(k, p);
            let present = sample.iter().all(|y| y.is_finite());
            // a record's last sample: nothing comes after it
            let last = dt.get(k).is_none();
            if last && !current {
                *made = status(true, present) as u8;
                if let Some(slots) = innovation.get_mut(k * p..(k + 1) * p) {
                    self.told(
                        &step,
                        &mut r.clone(),
                        (t[k], 1.0),
                        (sample, &u[k * q..(k + 1) * q]),
                        slots,
                    );
                }
                continue;
            }
            if !one || last {
                let steps = self.correct.as_ref().filter(|_| last).unwrap_or(&self.whole);
                let wanted = steps.choose(&r.0[place.clone()], present);
                if !Arc::ptr_eq(wanted, &step) {
                    let mut fresh = wanted.at_rest;
                    fresh.0[place.clone()].copy_from_slice(&r.0[place.clone()]);
                    (step, r, lengths) = (wanted.clone(), fresh, None);
                }
            }
            let dt = dt.get(k).copied().unwrap_or(0.0);
            if !self.tables.placed.is_empty() {
                let memory = &r.0[place.clone()];
                if !lengths.is_some_and(|known| self.are_lengths(&known, memory, sample, dt)) {
                    let new = self.lengths(memory, sample, dt);
                    self.put_gains(&new, &mut r);
                    lengths = Some(new);
                }
            }
            let given = (sample, &u[k * q..(k + 1) * q]);
            let moved = step.advance(&mut r, m, (t[k], dt), given, (row, &mut largest));
            *made = status(moved, present) as u8;
            if let Some(slots) = innovation.get_mut(k * p..(k + 1) * p) {
                for (slot, output) in slots.iter_mut().zip(&step.compiled.outputs[m..]) {
                    *slot = r.0[usize::from(*output)];
                }
            }
        }
        memory.copy_from_slice(&r.0[place]);
        let larger =
            |most: f64, value: &f64| if most.is_nan() || *value <= most { most } else { *value };
        largest.iter().fold(0.0, larger)
    }

    /// The innovation of a sample over which nothing is stepped.
    fn told(
        &self,
        step: &Step,
        r: &mut Registers<f64>,
        of: (f64, f64),
        given: (&[f64], &[f64]),
        slots: &mut [f64],
    ) {
        let m = self.tables.shape.memory;
        step.advance(r, m, of, given, (&mut [], &mut []));
        for (slot, output) in slots.iter_mut().zip(&step.compiled.outputs[m..]) {
            *slot = r.0[usize::from(*output)];
        }
    }

    /// One half of a step for one sample.
    fn one(
        &self,
        steps: &Steps<Step>,
        memory: &mut [f64],
        (y, u): (&[f64], &[f64]),
        (t, dt): (f64, f64),
    ) -> Status {
        let present = y.iter().all(|y| y.is_finite());
        let step = steps.choose(memory, present);
        let moved = SCRATCH.with_borrow_mut(|r| {
            // what else stands there is written before it is read
            for (register, value) in &step.fixed {
                r.0[usize::from(*register)] = *value;
            }
            if !self.tables.placed.is_empty() {
                self.put_gains(&self.lengths(memory, y, dt), r);
            }
            r.0[MEMORY..MEMORY + memory.len()].copy_from_slice(memory);
            step.advance(r, memory.len(), (t, dt), (y, u), (memory, &mut []))
        });
        status(moved, present)
    }
}

/// An entry of the memory into its place in a row, if there is one, and its largest magnitude so far.
#[inline(always)]
fn keep(value: f64, slot: Option<&mut f64>, largest: Option<&mut f64>) {
    let Some(slot) = slot else { return };
    *slot = value;
    if let Some(largest) = largest {
        *largest = if value.abs() > *largest { value.abs() } else { *largest };
    }
}

/// The memory into a row.
#[inline(always)]
fn show(r: &Registers<f64>, row: &mut [f64], largest: &mut [f64]) {
    for (i, value) in r.0.iter().skip(MEMORY).take(row.len()).enumerate() {
        keep(*value, row.get_mut(i), largest.get_mut(i));
    }
}

fn status(moved: bool, present: bool) -> Status {
    match (moved, present) {
        (false, _) => Status::ModelUndefined,
        (true, true) => Status::Updated,
        (true, false) => Status::Predicted,
    }
}

impl Recursion for Programmed {
    fn correct(&self, memory: &mut [f64], y: &[f64], t: f64) -> Result<Status> {
        let Some(correct) = &self.correct else {
            return Ok(status(true, y.iter().all(|y| y.is_finite())));
        };
        let u = [0.0; MAX_INPUTS];
        let u = u.get(..self.tables.shape.n_u).unwrap_or(&[]); // no correction depends on it
        Ok(self.one(correct, memory, (y, u), (t, 0.0)))
    }

    fn advance(&self, memory: &mut [f64], y: &[f64], u: &[f64], t: f64, dt: f64) -> Result<Status> {
        Ok(self.one(&self.advance, memory, (y, u), (t, dt)))
    }

    fn over_block(&self, memory: &mut [f64], block: Block<'_>) -> Result<f64> {
        Ok(match memory.len() {
            1 => self.advance_by(1, memory, block),
            2 => self.advance_by(2, memory, block),
            3 => self.advance_by(3, memory, block),
            4 => self.advance_by(4, memory, block),
            5 => self.advance_by(5, memory, block),
            6 => self.advance_by(6, memory, block),
            7 => self.advance_by(7, memory, block),
            8 => self.advance_by(8, memory, block),
            m => self.advance_by(m, memory, block),
        })
    }
}

impl AnyObserver for Programmed {
    fn n(&self) -> usize {
        self.tables.shape.n
    }
    fn n_y(&self) -> usize {
        self.tables.shape.n_y
    }
    fn n_u(&self) -> usize {
        self.tables.shape.n_u
    }
    fn is_current(&self) -> bool {
        self.tables.shape.current
    }
    fn initial(&self) -> Vec<f64> {
        self.tables.shape.initial.clone()
    }
    fn begin(&self, memory: &mut [f64], y: &[f64]) -> Result<bool> {
        self.tables.begin(memory, y)
    }
    fn recursion(&self) -> &dyn Recursion {
        self
    }
    fn tabled(&self) -> Option<&dyn Tabled> {
        Some(self)
    }
}

impl Tabled for Programmed {
    fn widths(&self) -> Widths {
        let Shape { memory, n_y, n_u, current, .. } = self.tables.shape;
        let gains: usize = self.tables.placed.iter().map(|chain| chain.gains.count).sum();
        Widths { memory, n_y, n_u, fixed: self.tables.parameters.len() + gains, current }
    }
    fn table(&self) -> Result<Table> {
        match &self.tables.correct {
            Some(correct) => self.tables.whole(correct),
            None => Ok(self.tables.advance.clone()),
        }
    }
    fn is_steady(&self, memory: &[f64], y: &[f64], dt: f64) -> bool {
        let waits = |(index, _): &(usize, _)| !memory.get(*index).is_some_and(|at| *at > 0.0);
        let mut chains = self.tables.placed.iter();
        !self.whole.unstarted.as_ref().is_some_and(waits)
            && chains.all(|chain| length_of(chain, memory, y, dt) == dt.to_bits())
    }
    fn fixed(&self, dt: f64) -> Vec<f64> {
        let mut fixed = self.tables.parameters.clone();
        for PlacedChain { gains, .. } in &self.tables.placed {
            let first = fixed.len();
            fixed.resize(first + gains.count, 0.0);
            gains.write(dt, &mut fixed[first..]);
        }
        fixed
    }
}
