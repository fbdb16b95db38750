//! Floor 4. Tables of operations translated to programs of the core.
//!
//! Operations are joined: a product and the only sum that uses it become one instruction, and equal
//! operations on consecutive registers, as a state's, become one instruction for a row. Then dependent
//! instructions are scheduled apart.

use crate::error::{Result, refused};
use crate::table::{NOT_COMPILED, Slot, Table, operands};
use crate::value::Numbers;
use hgo_rs::Scalar;
use hgo_rs::program::{Instruction, Operation, Program, REGISTERS, ROW, Registers};
use std::cmp::Reverse;

/// An operation with the values that it takes.
type Step = (Operation, [Slot; 3]);

/// How far behind an operation the others of its row may stand.
const AHEAD: usize = 64;

impl Table {
    /// As a program of the core.
    pub fn compile(&self) -> Result<Compiled> {
        if !self.calls.is_empty() {
            return Err(refused(NOT_COMPILED));
        }
        // rows need results earlier, and so more registers
        let compiled = Compiler::new(self, true).and_then(Compiler::compile);
        let compiled = compiled.or_else(|| Compiler::new(self, false)?.compile());
        compiled.ok_or_else(|| {
            refused(format!(
                "the program needs more than {NAMED} registers: simplify the expressions, or \
                 lower the order"
            ))
        })
    }

    /// Its outputs for rows of inputs, in double or single precision.
    pub fn evaluate_rows(&self, inputs: &Numbers, single: bool) -> Result<Vec<Vec<f64>>> {
        let columns = self.inputs.len();
        let Numbers { values, shape } = inputs;
        if shape.len() != 2 || shape[1] != columns {
            return Err(refused(format!(
                "inputs have shape {shape:?}; they must be (N, {columns})"
            )));
        }
        let compiled = self.compile()?;
        let rows = values.chunks_exact(columns.max(1));
        #[allow(clippy::cast_possible_truncation)]
        Ok(rows
            .map(|row| {
                if single {
                    let row: Vec<f32> = row.iter().map(|value| *value as f32).collect();
                    compiled.evaluate(&row).into_iter().map(f64::from).collect()
                } else {
                    compiled.evaluate(row)
                }
            })
            .collect())
    }

    /// Operations with those made one that no other shares the result of: a product and a sum, a
    /// lower and an upper bound.
    fn fused(&self) -> Vec<Option<Step>> {
        let base = self.base();
        let mut uses = vec![0_usize; base + self.operations.len()];
        for (operation, values) in &self.operations {
            values.iter().take(operands(*operation)).for_each(|value| uses[*value] += 1);
        }
        self.outputs.iter().for_each(|value| uses[*value] += 1);
        let mut fused: Vec<_> = self.operations.iter().copied().map(Some).collect();
        for index in 0..fused.len() {
            let Some((operation, [a, b, _])) = fused[index] else { continue };
            let made_by = |value: Slot, wanted: Operation| {
                let made = fused[value.checked_sub(base)?]?;
                (made.0 == wanted && uses[value] == 1).then_some((made.1[0], made.1[1]))
            };
            let product = |value| made_by(value, Operation::Multiply);
            let (made, gone) = match (operation, product(a), product(b)) {
                (Operation::Add, Some((x, y)), _) => ((Operation::MultiplyAdd, [x, y, b]), a),
                (Operation::Add, None, Some((x, y))) => ((Operation::MultiplyAdd, [x, y, a]), b),
                (Operation::Subtract, Some((x, y)), _) => {
                    ((Operation::MultiplySubtract, [x, y, b]), a)
                }
                (Operation::Subtract, None, Some((x, y))) => {
                    ((Operation::SubtractProduct, [x, y, a]), b)
                }
                (Operation::Min, ..) => match made_by(a, Operation::Max) {
                    Some((x, low)) => ((Operation::Clip, [x, low, b]), a),
                    None => continue,
                },
                _ => continue,
            };
            fused[index] = Some(made);
            fused[gone - base] = None;
        }
        fused
    }
}

/// A table that is being translated.
struct Compiler<'a> {
    table: &'a Table,
    /// What is left to do, in order.
    steps: Vec<Option<Step>>,
    /// How often each value is still needed.
    uses: Vec<usize>,
    /// Where each value stands that is there.
    place: Vec<Option<u8>>,
    registers: Allocation,
    constants: Vec<(u8, f64)>,
    instructions: Vec<Instruction>,
    /// What was done last, once or for a row.
    last: Option<Operation>,
    /// Whether instructions for rows are made.
    rows: bool,
}

impl<'a> Compiler<'a> {
    /// With inputs and constants in their places; `None` where they have no room.
    fn new(table: &'a Table, rows: bool) -> Option<Self> {
        let (base, length) = (table.base(), table.base() + table.operations.len());
        let mut steps = table.fused();
        let mut uses = vec![0; length];
        table.outputs.iter().for_each(|value| uses[*value] += 1);
        for index in (0..steps.len()).rev() {
            if uses[base + index] == 0 {
                steps[index] = None; // no output needs it
            }
            if let Some((operation, values)) = steps[index] {
                values.iter().take(operands(operation)).for_each(|value| uses[*value] += 1);
            }
        }
        let (mut registers, mut place) = (Allocation::new(), vec![None; length]);
        for place in place.iter_mut().take(table.inputs.len()) {
            *place = Some(registers.single()?);
        }
        let mut constants = Vec::new();
        for (value, constant) in (table.inputs.len()..).zip(&table.constants) {
            if uses[value] > 0 {
                let register = registers.single()?;
                place[value] = Some(register);
                constants.push((register, *constant));
            }
        }
        let instructions = Vec::new();
        let last = None;
        Some(Self { table, steps, uses, place, registers, constants, instructions, last, rows })
    }

    /// `None` where there are too few registers.
    fn compile(mut self) -> Option<Compiled> {
        for index in 0..self.steps.len() {
            let Some((operation, values)) = self.steps[index] else { continue };
            if self.rows && self.row(index).is_some() {
                continue;
            }
            let at = self.places(index)?;
            self.used_up(operation, values);
            // alike, and so perhaps the operands of a row
            let alike = self.rows && self.last == Some(operation);
            let behind = if alike { self.registers.behind() } else { None };
            let result = behind.or_else(|| self.registers.single())?;
            self.last = Some(operation);
            self.made(index, result);
            self.push(operation, result, at);
        }
        let outputs = self.table.outputs.iter().map(|value| self.place[*value]);
        let outputs = outputs.collect::<Option<_>>()?;
        let (instructions, constants) = (apart(&self.instructions), self.constants);
        Some(Compiled { instructions, outputs, constants })
    }

    /// One instruction for an operation and others like it; `None` where there are none, or no room.
    fn row(&mut self, index: usize) -> Option<()> {
        let (operation, _) = self.steps[index]?;
        let [x, y, z] = self.places(index)?;
        for (row, _, goes) in Operation::ROWS.iter().filter(|(_, single, _)| *single == operation) {
            for at in [[x, y, z], [y, x, z]] {
                let Some(entries) = self.entries(index, at, *goes) else { continue };
                // the operands stay until all is there
                let result = self.registers.row()?;
                for (i, entry) in (0..).zip(entries) {
                    self.made(entry, result + i);
                }
                for entry in entries {
                    if let Some((operation, values)) = self.steps[entry].take() {
                        self.used_up(operation, values);
                    }
                }
                self.last = Some(operation);
                self.push(*row, result, at);
                return Some(());
            }
        }
        None
    }

    /// The operations of a row that begins with one whose operands stand at these places.
    fn entries(&self, first: usize, at: [u8; 3], goes: [u8; 3]) -> Option<[usize; ROW]> {
        let (operation, _) = self.steps[first]?;
        let ahead = first + 1..self.steps.len().min(first + AHEAD);
        let mut entries = [first; ROW];
        for (i, entry) in (0..).zip(&mut entries).skip(1) {
            let [x, y, z] = std::array::from_fn(|k| usize::from(at[k]) + usize::from(goes[k]) * i);
            *entry = ahead.clone().find(|index| {
                self.steps[*index].is_some_and(|(of, _)| of == operation)
                    && self.places(*index).is_some_and(|places| {
                        let places = places.map(usize::from);
                        places == [x, y, z] || places == [y, x, z]
                    })
            })?;
        }
        Some(entries)
    }

    /// Where the operands of an operation stand; `None` where one is not there yet.
    fn places(&self, index: usize) -> Option<[u8; 3]> {
        let (operation, values) = self.steps[index]?;
        let mut at = [0; 3];
        for (register, value) in at.iter_mut().zip(values).take(operands(operation)) {
            *register = self.place[value]?;
        }
        Some(at)
    }

    /// Operands were read: inputs and constants keep their places, results that nothing needs any more
    /// make room.
    fn used_up(&mut self, operation: Operation, values: [Slot; 3]) {
        for value in values.into_iter().take(operands(operation)) {
            self.uses[value] -= 1;
            if let (0, true, Some(register)) =
                (self.uses[value], value >= self.table.base(), self.place[value])
            {
                self.registers.give_back(register);
            }
        }
    }

    /// The result of an operation stands there from now on.
    fn made(&mut self, index: usize, register: u8) {
        self.place[self.table.base() + index] = Some(register);
    }

    fn push(&mut self, operation: Operation, result: u8, [a, b, c]: [u8; 3]) {
        self.instructions.push(Instruction { operation, result, a, b, c });
    }
}

/// How far an instruction may be put forward.
const FORWARD: usize = 32;

/// The same instructions, dependent ones apart: of those that are ready, the one that begins the longest
/// chain of dependent instructions comes next.
fn apart(instructions: &[Instruction]) -> Vec<Instruction> {
    let before = before(instructions);
    let mut chain = vec![0; instructions.len()];
    for (index, before) in before.iter().enumerate().rev() {
        for (earlier, reads) in before {
            chain[*earlier] = chain[*earlier].max(chain[index] + usize::from(*reads));
        }
    }
    let mut done = vec![false; instructions.len()];
    let mut left: Vec<usize> = (0..instructions.len()).collect();
    let mut order = Vec::new();
    while !left.is_empty() {
        let may_come = |index: usize| before[index].iter().all(|(earlier, _)| done[*earlier]);
        let next = left.iter().take(FORWARD).enumerate().filter(|(_, index)| may_come(**index));
        let next = next.min_by_key(|(_, index)| Reverse(chain[**index]));
        let index = left.remove(next.map_or(0, |(at, _)| at)); // the first that is left may always come
        done[index] = true;
        order.push(instructions[index]);
    }
    order
}

/// For each instruction those that must come before it, and whether because it reads their results: or
/// else it writes to registers that they use.
fn before(instructions: &[Instruction]) -> Vec<Vec<(usize, bool)>> {
    let mut written = [None; REGISTERS];
    let mut read = vec![Vec::new(); REGISTERS];
    let mut all = Vec::new();
    for (index, instruction) in instructions.iter().enumerate() {
        let Instruction { operation, result, a, b, c } = *instruction;
        let row = Operation::ROWS.iter().find(|(row, ..)| *row == operation);
        let (single, entries, goes) =
            row.map_or((operation, 1, [0; 3]), |(_, single, goes)| (*single, ROW, *goes));
        let mut before = Vec::new();
        for (first, goes) in [a, b, c].into_iter().zip(goes).take(operands(single)) {
            for register in (0..entries).map(|i| usize::from(first) + usize::from(goes) * i) {
                before.extend(written[register].map(|writer| (writer, true)));
                read[register].push(index);
            }
        }
        for register in usize::from(result)..usize::from(result) + entries {
            before.extend(written[register].map(|writer| (writer, false)));
            let readers = read[register].drain(..).filter(|reader| *reader != index);
            before.extend(readers.map(|reader| (reader, false)));
            written[register] = Some(index);
        }
        all.push(before);
    }
    all
}

/// Registers that an instruction can name.
const NAMED: usize = u8::MAX as usize + 1;

/// Which registers are taken.
struct Allocation {
    taken: [bool; NAMED],
    /// The one behind the last that was taken.
    next: usize,
}

impl Allocation {
    fn new() -> Self {
        Self { taken: [false; NAMED], next: 0 }
    }

    /// So many in a row, the first of them at `first`.
    fn take(&mut self, first: usize, count: usize) -> Option<u8> {
        self.taken.get_mut(first..first + count)?.fill(true);
        self.next = first + count;
        u8::try_from(first).ok()
    }

    fn is_free(&self, first: usize, count: usize) -> bool {
        self.taken.get(first..first + count).is_some_and(|taken| !taken.contains(&true))
    }

    /// The first free one.
    fn single(&mut self) -> Option<u8> {
        self.take((0..NAMED).find(|first| self.is_free(*first, 1))?, 1)
    }

    /// The one behind the last that was taken, if it is free.
    fn behind(&mut self) -> Option<u8> {
        self.is_free(self.next, 1).then(|| self.take(self.next, 1))?
    }

    /// The first of a row, at best of one that can go on.
    fn row(&mut self) -> Option<u8> {
        let gap = |count| (0..NAMED).find(|first| self.is_free(*first, count));
        let first = gap(2 * ROW).or_else(|| gap(ROW))?;
        self.take(first, ROW)
    }

    fn give_back(&mut self, register: u8) {
        self.taken[usize::from(register)] = false;
    }
}

/// A program of the core that is kept here. Its inputs stand in the first registers.
#[derive(Clone, Debug)]
pub struct Compiled {
    instructions: Vec<Instruction>,
    /// Registers of the outputs.
    pub outputs: Vec<u8>,
    constants: Vec<(u8, f64)>,
}

impl Compiled {
    /// The program itself.
    pub fn program(&self) -> Program<'_> {
        Program { instructions: &self.instructions, outputs: &self.outputs }
    }

    /// Registers with the constants in their places.
    pub fn registers<T: Scalar>(&self) -> Registers<T> {
        let mut registers = Registers::zero();
        for (register, constant) in &self.constants {
            registers.0[usize::from(*register)] = T::from_f64(*constant);
        }
        registers
    }

    /// The constants, with their registers.
    pub fn constants(&self) -> &[(u8, f64)] {
        &self.constants
    }

    /// Evaluate for some inputs.
    pub fn evaluate<T: Scalar>(&self, inputs: &[T]) -> Vec<T> {
        let mut registers = self.registers();
        registers.0.iter_mut().zip(inputs).for_each(|(register, input)| *register = *input);
        self.program().run(&mut registers);
        self.outputs.iter().map(|output| registers.0[usize::from(*output)]).collect()
    }
}
