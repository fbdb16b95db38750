//! Floor 6. Observers as tables: each step, or each of its halves, a table of operations.
//!
//! The laws are the core's own. Run over [`Traced`] numbers, with the model's table in the place of a
//! compiled model, each writes down its step once; the program of that step is what runs.

use crate::choices::AnyMotion;
use crate::error::{Result, refused};
use crate::order::CHAINS;
use crate::table::Table;
use crate::tabled::{Gains, LawTables, flat};
use crate::trace::{self, Setting, Traced, input, inputs, named, trace};
use hgo_rs::Scalar;
use hgo_rs::memory::Memory;
use hgo_rs::observer::{Observer, Timing};
use std::sync::Arc;

/// For each chain, the bits of the time that a correction is for.
pub(crate) type Lengths = [u64; CHAINS];

/// Where the memory stands among the inputs of a step.
pub(crate) const MEMORY: usize = 2;

/// What a step is made of.
pub(crate) struct Shape {
    pub(crate) n: usize,
    pub(crate) n_y: usize,
    pub(crate) n_u: usize,
    pub(crate) memory: usize,
    /// Entries of the memory without the time that current timing holds beside them.
    pub(crate) signals: usize,
    pub(crate) current: bool,
    pub(crate) initial: Vec<f64>,
}

/// An observer as tables.
pub struct Tables {
    pub(crate) shape: Shape,
    /// The use of a sample with current timing: (t, dt, z, y, u, parameters, gains) → (z⁺, innovation).
    pub(crate) correct: Option<Table>,
    /// The way to the next sample, of the same inputs: z⁺, and the innovation with predictor timing.
    pub(crate) advance: Table,
    /// What takes the sample (the correction with current timing, else the way to the next one) where
    /// the sample is missing, if that is another law.
    pub(crate) missing: Option<Table>,
    /// The same with and without a sample, for a law that has not started: the entry of its memory of
    /// this index is not positive.
    pub(crate) unstarted: Option<(usize, [Table; 2])>,
    /// For each chain whose eigenvalues are placed by gains that are inputs, these gains, in order.
    pub(crate) placed: Vec<PlacedChain>,
    /// A continuous law: (t, z, y, u, parameters) → ż, and z → z within the set that it lives in.
    pub(crate) law: Option<(Table, Table)>,
    /// A law whose model moves between placed corrections, in parts, and how.
    pub(crate) moving: Option<(Box<LawTables>, AnyMotion)>,
    pub(crate) parameters: Vec<f64>,
    /// The start from first samples, if the law has one: (z, y) → z.
    pub(crate) start: Option<Table>,
}

/// A chain whose corrections are placed.
pub(crate) struct PlacedChain {
    /// Which sample corrects it.
    pub(crate) channel: usize,
    /// Where the time stands in the memory that a correction is for, with current timing; else it is the
    /// step's length.
    pub(crate) elapsed: Option<usize>,
    pub(crate) gains: Arc<Gains>,
}

impl Tables {
    /// Of a recursion: its halves alone.
    pub(crate) fn of_halves(
        shape: Shape,
        correct: Option<Table>,
        advance: Table,
        parameters: &[f64],
    ) -> Self {
        Self {
            shape,
            correct,
            advance,
            missing: None,
            unstarted: None,
            placed: Vec::new(),
            law: None,
            moving: None,
            parameters: parameters.to_vec(),
            start: None,
        }
    }

    /// Estimated states.
    pub fn n(&self) -> usize {
        self.shape.n
    }
    /// Measured outputs.
    pub fn n_y(&self) -> usize {
        self.shape.n_y
    }
    /// Known inputs.
    pub fn n_u(&self) -> usize {
        self.shape.n_u
    }
    /// Entries of the memory.
    pub fn memory_len(&self) -> usize {
        self.shape.memory
    }
    /// Entries of the memory that studies have metrics of.
    pub fn signals(&self) -> usize {
        self.shape.signals
    }
    /// Whether the estimate at k uses y(k).
    pub fn is_current(&self) -> bool {
        self.shape.current
    }
    /// The use of a sample with current timing.
    pub fn correct(&self) -> Option<&Table> {
        self.correct.as_ref()
    }
    /// What takes the sample, whether the law has started or not: the correction with current timing,
    /// else the way to the next sample. Where samples may be `missing`, also without one.
    pub fn taking(&self, missing: bool) -> Result<Table> {
        let usual = self.correct.as_ref().unwrap_or(&self.advance);
        let without = self.missing.as_ref().filter(|_| missing);
        if self.unstarted.is_none() && without.is_none() {
            return Ok(usual.clone());
        }
        trace(Setting::usual(false), || {
            let given: Vec<Traced> = usual.inputs.iter().map(|name| input(name)).collect();
            let mut chosen = self.form(false, &given);
            if without.is_some() {
                let y = MEMORY + self.shape.memory;
                let nothing = given[y..y + self.shape.n_y]
                    .iter()
                    .fold(Traced::ZERO, |sum, y| sum + trace::nothing(*y));
                let choose = |a, b| trace::if_equal([nothing; 2], a, b);
                chosen = chosen_of(&chosen, &self.form(true, &given), choose);
            }
            Ok(usual.output_names.iter().cloned().zip(chosen).collect())
        })
    }
    /// Within a trace: the memory and the innovation after what takes a sample that is there, or is
    /// `missing`, of a law that has started and of one that has not.
    fn form(&self, missing: bool, given: &[Traced]) -> Vec<Traced> {
        let usual = self.correct.as_ref().unwrap_or(&self.advance);
        let usual = self.missing.as_ref().filter(|_| missing).unwrap_or(usual);
        let made = trace::inline(usual, given);
        let Some((index, forms)) = &self.unstarted else { return made };
        let (elapsed, first) = (given[MEMORY + index], &forms[usize::from(missing)]);
        let first = trace::inline(first, given);
        chosen_of(&made, &first, |a, b| trace::if_positive(elapsed, a, b))
    }
    /// Within a trace: the memory after the way to the next sample, as [`Observer::predict`]. A law that
    /// closes its periods by samples closes one that was left open first, and holds its estimate where
    /// the model has no value.
    fn predicted(&self, given: &[Traced]) -> Vec<Traced> {
        let usual = trace::inline(&self.advance, given);
        let Some((index, _)) = self.unstarted else { return usual };
        let (n, memory) = (self.shape.n, MEMORY..MEMORY + self.shape.memory);
        let made = self.form(true, given);
        let spoilt = made.iter().take(n).fold(Traced::NEG_ZERO, |sum, z| sum + trace::nothing(*z));
        let held = chosen_of(&made, &given[memory.clone()], |made, before| {
            trace::if_equal([spoilt; 2], made, before)
        });
        let mut closed = given.to_vec();
        closed[memory.clone()].copy_from_slice(&held);
        let late = trace::inline(&self.advance, &closed);
        let open = given[memory][index + 1]; // length of the period
        chosen_of(&late, &usual, |late, usual| trace::if_positive(open, late, usual))
    }
    /// The way to the next sample.
    pub fn advance(&self) -> &Table {
        &self.advance
    }
    /// Rate and admissible set of a continuous law.
    pub fn law(&self) -> Option<&(Table, Table)> {
        self.law.as_ref()
    }
    /// The memory `z` with its estimates at first samples, those that are there. False where the law
    /// has no such start, which changes nothing: its first sample is where it begins (reduced-order),
    /// or its output is not its first state.
    pub fn begin(&self, z: &mut [f64], y: &[f64]) -> Result<bool> {
        let Some(start) = &self.start else { return Ok(false) };
        let made = start.evaluate(&[&*z, y].concat())?;
        z.iter_mut().zip(made).for_each(|(slot, value)| *slot = value);
        Ok(true)
    }
    /// The values of the model's parameters.
    pub fn parameters(&self) -> &[f64] {
        &self.parameters
    }

    /// Memory to start from when nothing is known.
    pub fn initial(&self) -> &[f64] {
        &self.shape.initial
    }

    /// The inputs of a step: (t, dt, z, y, u, parameters, gains).
    pub fn inputs(
        &self,
        memory: &[f64],
        (y, u): (&[f64], &[f64]),
        (t, dt): (f64, f64),
    ) -> Vec<f64> {
        let mut inputs = [&[t, dt], memory, y, u, self.parameters.as_slice()].concat();
        for placed in &self.placed {
            let (first, gains) = (inputs.len(), &placed.gains);
            inputs.resize(first + gains.count, 0.0);
            gains.write(f64::from_bits(length_of(placed, memory, y, dt)), &mut inputs[first..]);
        }
        inputs
    }
}

/// Entry by entry one of two.
fn chosen_of(a: &[Traced], b: &[Traced], of: impl Fn(Traced, Traced) -> Traced) -> Vec<Traced> {
    a.iter().zip(b).map(|(a, b)| of(*a, *b)).collect()
}

/// The time that a chain's correction is for, in bits; with current timing none for a missing sample.
#[inline(always)]
pub(crate) fn length_of(placed: &PlacedChain, memory: &[f64], y: &[f64], dt: f64) -> u64 {
    let elapsed = placed.elapsed.and_then(|place| memory.get(place)).copied();
    let sample = y.get(placed.channel).copied().unwrap_or(f64::NAN);
    elapsed.map_or(dt, |elapsed| elapsed - elapsed.while_missing(sample)).to_bits()
}

/// Gains of the corrections of one chain, held for some times.
pub struct Held {
    /// Which sample corrects.
    pub channel: usize,
    /// Where the time of the next correction stands in the memory, with current timing; else it is the
    /// step's length.
    pub elapsed: Option<usize>,
    /// For each of the times.
    pub rows: Vec<Vec<f64>>,
}

impl Tables {
    /// A part of the step as a table over (t, dt, z, y, u, parameters, gains), without the inputs that
    /// the part does not take. "step", with predictor timing: (z after the step, innovation). With current
    /// timing "correct", the use of a sample, of (t, z, y): (z, innovation); and "predict", the way to the
    /// next one, of (t, dt, z, u): z. "start", the start from first samples, of (z, y). With `missing` the
    /// part that takes the sample where it is missing.
    /// With a `fixed` length of a step, dt is this number and no input: what depends on it alone is
    /// computed here, by the operations of the table and so with their bits.
    pub fn part(
        &self,
        part: &str,
        missing: bool,
        single: bool,
        fixed: Option<f64>,
    ) -> Result<Table> {
        let Shape { memory, n_y, n_u, current, .. } = self.shape;
        let step = MEMORY - 1; // where its length stands
        let y = MEMORY + memory..MEMORY + memory + n_y;
        let u = y.end..y.end + n_u;
        let traced = |of: &Table, made: &dyn Fn(&[Traced]) -> Vec<Traced>| {
            trace(Setting::usual(single), || {
                let mut given: Vec<Traced> = of.inputs.iter().map(|name| input(name)).collect();
                if let (Some(dt), Some(length)) = (fixed, given.get_mut(step)) {
                    *length = Traced::from_f64(dt);
                }
                Ok(of.output_names.iter().cloned().zip(made(&given)).collect())
            })
        };
        if let ("start", Some(start)) = (part, &self.start) {
            return Ok(start.clone());
        }
        let known = |i: usize| i == step && fixed.is_some();
        match (part, &self.correct) {
            ("step", None) => {
                let step = traced(&self.advance, &|given| self.form(missing, given))?;
                Ok(step.without_inputs(known))
            }
            ("correct", Some(correct)) => {
                let correct = traced(correct, &|given| self.form(missing, given))?;
                Ok(correct.without_inputs(|i| i == step || u.contains(&i)))
            }
            ("predict", Some(_)) => {
                let predict = traced(&self.advance, &|given| self.predicted(given))?;
                Ok(predict.without_inputs(|i| known(i) || y.contains(&i)))
            }
            (other, _) => {
                let parts = if current { "correct or predict" } else { "step" };
                Err(refused(format!("part = {other:?} is not allowed: {parts}")))
            }
        }
    }

    /// The gains that are inputs of these tables, for corrections that are for times of these lengths:
    /// for each chain that takes any, in order.
    pub fn held(&self, lengths: &[f64]) -> Vec<Held> {
        let of_chain = |PlacedChain { channel, elapsed, gains }: &PlacedChain| {
            let row = |length: &f64| {
                let mut row = vec![0.0; gains.count];
                gains.write(*length, &mut row);
                row
            };
            let rows = lengths.iter().map(row).collect();
            Held { channel: *channel, elapsed: *elapsed, rows }
        };
        self.placed.iter().map(of_chain).collect()
    }
}

/// A recursion of any sizes over traced numbers: what it moves are slices, so that all that is made of it is
/// compiled once.
pub(crate) trait Halves {
    /// Estimated states, outputs, entries of the memory.
    fn sizes(&self) -> [usize; 3];
    fn is_current(&self) -> bool;
    fn initial(&self) -> Vec<Traced>;
    fn innovation(&self, t: Traced, z: &[Traced], y: &[Traced], u: &[Traced]) -> Vec<Traced>;
    fn correct(&self, t: Traced, z: &[Traced], y: &[Traced]) -> Vec<Traced>;
    fn advance(
        &self,
        at: (Traced, Traced),
        z: &[Traced],
        y: &[Traced],
        u: &[Traced],
    ) -> Vec<Traced>;
}

struct Flat<O>(O);

impl<O: Observer<Traced, Input: Memory<Traced>>> Halves for Flat<O> {
    fn sizes(&self) -> [usize; 3] {
        [O::ESTIMATED, O::Measurement::LEN, O::State::LEN]
    }
    fn is_current(&self) -> bool {
        O::TIMING == Timing::Current
    }
    fn initial(&self) -> Vec<Traced> {
        flat(&self.0.initial())
    }
    fn innovation(&self, t: Traced, z: &[Traced], y: &[Traced], u: &[Traced]) -> Vec<Traced> {
        let (z, y, u) = (O::State::read(z), O::Measurement::read(y), O::Input::read(u));
        flat(&self.0.innovation(t, &z, &y, &u))
    }
    fn correct(&self, t: Traced, z: &[Traced], y: &[Traced]) -> Vec<Traced> {
        let mut z = O::State::read(z);
        self.0.correct(&mut z, &O::Measurement::read(y), t);
        flat(&z)
    }
    fn advance(
        &self,
        (t, dt): (Traced, Traced),
        z: &[Traced],
        y: &[Traced],
        u: &[Traced],
    ) -> Vec<Traced> {
        let mut z = O::State::read(z);
        self.0.advance(&mut z, &O::Measurement::read(y), &O::Input::read(u), t, dt);
        flat(&z)
    }
}

/// A recursion as its halves.
pub(crate) fn halves<O>(observer: O) -> Box<dyn Halves>
where
    O: Observer<Traced, Input: Memory<Traced>> + 'static,
{
    Box::new(Flat(observer))
}

/// A recursion, made within a trace.
pub(crate) type Build<'a> = &'a dyn Fn() -> Result<Box<dyn Halves>>;

/// A half of a step of the observer that `build` makes within the trace: the use of a sample, or the
/// way to the next one.
pub(crate) fn half_table(
    setting: Setting,
    shape: &Shape,
    corrects: bool,
    build: Build<'_>,
) -> Result<Table> {
    trace(setting, || {
        let (t, dt) = (input("t"), input("dt"));
        let z = inputs("z", shape.memory);
        let (y, u) = (inputs("y", shape.n_y), inputs("u", shape.n_u));
        let observer = build()?;
        let mut innovation = Vec::new();
        if corrects == shape.current {
            innovation = observer.innovation(t, &z, &y, &u);
        }
        let z = if corrects {
            observer.correct(t, &z, &y)
        } else {
            observer.advance((t, dt), &z, &y, &u)
        };
        Ok([named("z", &z), named("innovation", &innovation)].concat())
    })
}

/// What a recursion of its own is made of.
pub(crate) fn shape_of(n_u: usize, build: Build<'_>) -> Result<Shape> {
    let (mut initial, mut sizes, mut current) = (Vec::new(), [0; 3], false);
    trace(Setting::usual(false), || {
        let observer = build()?;
        (sizes, current) = (observer.sizes(), observer.is_current());
        initial = observer.initial().into_iter().map(Scalar::to_f64).collect();
        Ok(Vec::new())
    })?;
    let [n, n_y, memory] = sizes;
    Ok(Shape { n, n_y, n_u, memory, signals: memory, current, initial })
}
