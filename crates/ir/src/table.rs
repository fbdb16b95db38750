//! Floor 3. Straight-line programs in the making: tables of operations, each value computed once.

use crate::error::{Result, refused};
use crate::spec::Spec;
use crate::value::{Function, Value};
use hgo_rs::program::Operation;
use std::sync::Arc;

/// Names of the operations that a table may hold, with the number of their operands.
const OPERATIONS: [(&str, Operation, usize); 25] = [
    ("neg", Operation::Negate, 1),
    ("abs", Operation::Abs, 1),
    ("sign", Operation::Sign, 1),
    ("sqrt", Operation::Sqrt, 1),
    ("sin", Operation::Sin, 1),
    ("cos", Operation::Cos, 1),
    ("tan", Operation::Tan, 1),
    ("atan", Operation::Atan, 1),
    ("exp", Operation::Exp, 1),
    ("log", Operation::Ln, 1),
    ("tanh", Operation::Tanh, 1),
    ("add", Operation::Add, 2),
    ("sub", Operation::Subtract, 2),
    ("mul", Operation::Multiply, 2),
    ("div", Operation::Divide, 2),
    ("min", Operation::Min, 2),
    ("max", Operation::Max, 2),
    ("pow", Operation::Power, 2),
    ("atan2", Operation::Atan2, 2),
    ("copysign", Operation::CopySign, 2),
    ("lt", Operation::Less, 2),
    ("le", Operation::LessEqual, 2),
    ("eq", Operation::Equal, 2),
    ("innovation", Operation::Innovation, 2),
    ("select", Operation::Select, 3),
];

/// Number of operands of an operation of a table.
pub fn operands(operation: Operation) -> usize {
    OPERATIONS.iter().find(|(_, of, _)| *of == operation).map_or(3, |(_, _, count)| *count)
}

/// A value of a table: inputs first, then results of calls, then constants, then results of operations.
pub type Slot = usize;

/// A call of a user's function: it takes a list of numbers and gives as many as it has results.
#[derive(Clone, Debug)]
pub struct Call {
    /// What is called.
    pub function: Arc<dyn Function>,
    /// The values that it takes.
    pub arguments: Vec<Slot>,
    /// How many numbers it gives.
    pub results: usize,
}

impl Call {
    /// With its arguments elsewhere.
    fn moved(&self, place: impl Fn(Slot) -> Slot) -> Self {
        let arguments = self.arguments.iter().map(|value| place(*value)).collect();
        Self { function: self.function.clone(), arguments, results: self.results }
    }

    /// Its results.
    fn made(&self, arguments: &[f64]) -> Result<Vec<f64>> {
        let made = self.function.call(arguments)?;
        if made.len() == self.results {
            Ok(made)
        } else {
            Err(refused(format!("a function of the model gave {} numbers", made.len())))
        }
    }
}

/// Why a table with calls is neither compiled nor written down.
pub const NOT_COMPILED: &str = "this is not allowed for a system of Python functions that could not be \
    compiled: write its equations as expressions";

/// The calls of a table, each with the number of operations that come before it.
pub struct Scheduled<'a>(Vec<(&'a Call, usize)>);

impl<'a> Scheduled<'a> {
    /// The calls of this table.
    pub fn of(table: &'a Table) -> Self {
        let (inputs, base) = (table.inputs.len(), table.base());
        let mut scheduled = Vec::new();
        let mut of_result: Vec<usize> = Vec::new(); // for each result of a call
        for call in &table.calls {
            let before = call.arguments.iter().map(|value| match value.checked_sub(base) {
                Some(operation) => operation + 1,
                None => value.checked_sub(inputs).and_then(|i| of_result.get(i)).map_or(0, |i| *i),
            });
            // calls keep their order
            let earlier = scheduled.last().map_or(0, |(_, before)| *before);
            let before = before.max().unwrap_or(0).max(earlier);
            of_result.extend(std::iter::repeat_n(before, call.results));
            scheduled.push((call, before));
        }
        Self(scheduled)
    }

    /// Those that come just before operation number `index`, in order.
    pub fn before(&self, index: usize) -> impl Iterator<Item = &'a Call> {
        self.0.iter().filter(move |(_, before)| *before == index).map(|(call, _)| *call)
    }
}

impl Table {
    /// The outputs for some inputs, value by value: also of a table with calls. Functions are called
    /// without a lock; their errors end it.
    pub fn evaluate(&self, inputs: &[f64]) -> Result<Vec<f64>> {
        let Self { constants, operations, outputs, .. } = self;
        let mut values = inputs.to_vec();
        values.resize(self.inputs.len() + self.called(), 0.0);
        values.extend_from_slice(constants);
        values.reserve(operations.len());
        let calls = Scheduled::of(self);
        let mut result = self.inputs.len();
        for index in 0..=operations.len() {
            for call in calls.before(index) {
                let given: Vec<f64> = call.arguments.iter().map(|value| values[*value]).collect();
                let made = call.made(&given)?;
                values[result..result + call.results].copy_from_slice(&made);
                result += call.results;
            }
            if let Some((operation, of)) = operations.get(index) {
                let [a, b, c] = of.map(|value| values.get(value).copied().unwrap_or(0.0));
                values.push(operation.apply(a, b, c));
            }
        }
        Ok(outputs.iter().map(|output| values[*output]).collect())
    }
}

/// A straight-line program: every value is computed once, from values before it.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Names of the inputs.
    pub inputs: Vec<String>,
    /// In the order in which they are made; their results are values one after the other.
    pub calls: Vec<Call>,
    /// Numbers that are known.
    pub constants: Vec<f64>,
    /// Each with the values that it takes, at most three.
    pub operations: Vec<(Operation, [Slot; 3])>,
    /// The values that it gives.
    pub outputs: Vec<Slot>,
    /// Their names.
    pub output_names: Vec<String>,
}

impl Table {
    /// From a dict, of which nothing is believed.
    pub fn read(spec: &Spec<'_>) -> Result<Self> {
        spec.only(&["inputs", "calls", "constants", "ops", "outputs", "output_names"])?;
        let inputs = spec.texts("inputs")?.unwrap_or_default();
        let mut calls = Vec::new();
        let mut called = inputs.len();
        for row in list(spec, "calls")? {
            let Some((function, arguments, results)) = read_call(row) else {
                return Err(refused(format!(
                    "call {row} is not allowed: [function, values that it takes, number of results]"
                )));
            };
            if let Some(argument) = arguments.iter().find(|argument| **argument >= called) {
                return Err(refused(format!(
                    "argument {argument} of a call is not allowed: < {called}"
                )));
            }
            called += results;
            calls.push(Call { function, arguments, results });
        }
        let constants = if spec.has("constants") {
            spec.numbers("constants")?.values.clone()
        } else {
            Vec::new()
        };
        let mut known = called + constants.len();
        let mut operations = Vec::new();
        for row in list(spec, "ops")? {
            let read = read_operation(row);
            let Some(operation) = read.filter(|(_, of)| of.iter().all(|value| *value < known))
            else {
                return Err(refused(format!(
                    "table row {row} is not allowed: [operation, operands ...] with as many values \
                     before it (there are {known}) as the operation takes"
                )));
            };
            operations.push(operation);
            known += 1;
        }
        let outputs = spec.wholes("outputs")?.unwrap_or_default();
        if let Some(output) = outputs.iter().find(|output| **output >= known) {
            return Err(refused(format!("table output {output} is not allowed: < {known}")));
        }
        let output_names = spec.texts("output_names")?.unwrap_or_default();
        Ok(Self { inputs, calls, constants, operations, outputs, output_names })
    }

    /// Its operations by name, each with the values that it takes.
    pub fn rows(&self) -> Result<Vec<(&'static str, &[Slot])>> {
        if !self.calls.is_empty() {
            return Err(refused(NOT_COMPILED));
        }
        let mut rows = Vec::with_capacity(self.operations.len());
        for (operation, values) in &self.operations {
            let (name, _, count) = OPERATIONS
                .iter()
                .find(|(_, of, _)| of == operation)
                .ok_or_else(|| refused("a table holds an operation without a name"))?;
            rows.push((*name, values.get(..*count).unwrap_or(values)));
        }
        Ok(rows)
    }

    /// Without some of the inputs, told by their places, which nothing may use.
    #[must_use]
    pub fn without_inputs(&self, goes: impl Fn(usize) -> bool) -> Self {
        let mut place: Vec<Slot> = Vec::with_capacity(self.inputs.len());
        let mut kept = 0;
        for i in 0..self.inputs.len() {
            place.push(kept);
            kept += usize::from(!goes(i));
        }
        let gone = self.inputs.len() - kept;
        let moved = |value: Slot| place.get(value).copied().unwrap_or(value.saturating_sub(gone));
        Self {
            inputs: (0..)
                .zip(&self.inputs)
                .filter(|(i, _)| !goes(*i))
                .map(|(_, n)| n.clone())
                .collect(),
            calls: self.calls.iter().map(|call| call.moved(moved)).collect(),
            constants: self.constants.clone(),
            operations: self.operations.iter().map(|(of, from)| (*of, from.map(moved))).collect(),
            outputs: self.outputs.iter().map(|value| moved(*value)).collect(),
            output_names: self.output_names.clone(),
        }
    }

    /// Whether a value may be missing for finite inputs: an operation that has none everywhere. (Sines have
    /// one up to 1e9 rad.)
    pub fn may_lack_value(&self) -> bool {
        use Operation::{Divide, Ln, Power, Sqrt};
        !self.calls.is_empty()
            || self
                .operations
                .iter()
                .any(|(operation, _)| matches!(operation, Sqrt | Ln | Divide | Power))
    }

    /// For each value whether it depends on one of some inputs.
    pub fn depends(&self, on: impl Fn(usize) -> bool) -> Vec<bool> {
        let mut depends: Vec<bool> = (0..self.inputs.len()).map(on).collect();
        for call in &self.calls {
            // what a function looks at is not known
            depends.extend(std::iter::repeat_n(true, call.results));
        }
        depends.resize(self.base(), false);
        for (operation, from) in &self.operations {
            let some = from.iter().take(operands(*operation)).any(|value| depends[*value]);
            depends.push(some);
        }
        depends
    }

    /// The largest number of values that are needed at a time, constants aside.
    pub fn width(&self) -> usize {
        let (inputs, base) = (self.inputs.len(), self.base());
        let mut last = vec![0; base + self.operations.len()];
        for (at, (operation, from)) in self.operations.iter().enumerate() {
            from.iter().take(operands(*operation)).for_each(|value| last[*value] = at);
        }
        self.outputs.iter().for_each(|value| last[*value] = self.operations.len());
        let is_constant = |value: usize| (inputs + self.called()..base).contains(&value);
        let mut ends = vec![0_usize; self.operations.len() + 1];
        let mut live = 0;
        for (value, end) in last.iter().enumerate().take(base) {
            if !is_constant(value) && *end > 0 {
                live += 1;
                ends[*end] += 1;
            }
        }
        let mut most = live;
        for at in 0..self.operations.len() {
            if last[base + at] > at {
                live += 1;
                ends[last[base + at]] += 1;
            }
            most = most.max(live);
            live -= ends[at].min(live);
        }
        most
    }

    /// Without the constants and operations that no output needs.
    #[must_use]
    pub fn trimmed(&self) -> Self {
        let (inputs, base) = (self.inputs.len(), self.base());
        let mut needed = vec![false; base + self.operations.len()];
        self.outputs.iter().for_each(|value| needed[*value] = true);
        loop {
            for (i, (operation, values)) in self.operations.iter().enumerate().rev() {
                if needed[base + i] {
                    values
                        .iter()
                        .take(operands(*operation))
                        .for_each(|value| needed[*value] = true);
                }
            }
            // a call is needed as a whole, and so are its arguments
            let before = needed.iter().filter(|needed| **needed).count();
            let mut first = base - self.constants.len();
            for call in self.calls.iter().rev() {
                first -= call.results;
                let results = first..first + call.results;
                if needed[results.clone()].contains(&true) {
                    needed[results].fill(true);
                    call.arguments.iter().for_each(|value| needed[*value] = true);
                }
            }
            if needed.iter().filter(|needed| **needed).count() == before {
                break;
            }
        }
        let mut place: Vec<Slot> = (0..inputs).collect();
        let mut next = inputs;
        for needed in &needed[inputs..] {
            place.push(next);
            next += usize::from(*needed);
        }
        let called = base - self.constants.len();
        let mut calls = Vec::new();
        let mut first = inputs;
        for call in &self.calls {
            if needed.get(first) == Some(&true) {
                calls.push(call.moved(|value| place[value]));
            }
            first += call.results;
        }
        let kept = |(i, _): &(usize, _)| needed[called + i];
        let constants = self.constants.iter().copied().enumerate().filter(kept);
        let constants = constants.map(|(_, constant)| constant).collect();
        let mut operations = Vec::new();
        for (i, (operation, values)) in self.operations.iter().enumerate() {
            if needed[base + i] {
                operations.push((*operation, values.map(|value| place[value])));
            }
        }
        let outputs = self.outputs.iter().map(|value| place[*value]).collect();
        let (inputs, output_names) = (self.inputs.clone(), self.output_names.clone());
        Self { inputs, calls, constants, operations, outputs, output_names }
    }

    /// Results of calls.
    pub fn called(&self) -> usize {
        self.calls.iter().map(|call| call.results).sum()
    }

    /// The first result of an operation.
    pub fn base(&self) -> usize {
        self.inputs.len() + self.called() + self.constants.len()
    }
}

/// A list, empty if it is not there.
fn list<'a>(spec: &Spec<'a>, key: &str) -> Result<&'a [Value]> {
    match spec.get(key) {
        None => Ok(&[]),
        Some(value) => {
            value.as_list().ok_or_else(|| refused(format!("table {key} must be a list")))
        }
    }
}

/// [function, values that it takes, number of results].
fn read_call(row: &Value) -> Option<(Arc<dyn Function>, Vec<Slot>, usize)> {
    match row.as_list()? {
        [Value::Function(function), arguments, results] => {
            Some((function.clone(), arguments.as_wholes()?, results.as_whole()?))
        }
        _ => None,
    }
}

/// [operation, values that it takes ...].
fn read_operation(row: &Value) -> Option<(Operation, [Slot; 3])> {
    let (name, operands) = row.as_list()?.split_first()?;
    let name = name.as_text()?;
    let (_, operation, count) = OPERATIONS.iter().find(|(known, ..)| *known == name)?;
    let mut values = [0; 3];
    if operands.len() != *count {
        return None;
    }
    for (value, operand) in values.iter_mut().zip(operands) {
        *value = operand.as_whole()?;
    }
    Some((*operation, values))
}
