//! Straight-line programs in the making: tables of operations, each value computed once, and their
//! translation to the core's [`Program`].

use super::errors::refused;
use super::spec::Spec;
use crate::Scalar;
use crate::program::{Instruction, Operation, Program, REGISTERS, Registers};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};

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

/// A value of a table: inputs first, then constants, then results.
pub type Value = usize;

/// A straight-line program: every value is computed once, from values before it.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// Names of the inputs.
    pub inputs: Vec<String>,
    pub constants: Vec<f64>,
    pub operations: Vec<(Operation, [Value; 3])>,
    pub outputs: Vec<Value>,
    pub output_names: Vec<String>,
}

impl Table {
    /// From a dict, of which nothing is believed.
    pub fn read(spec: &Spec<'_>) -> PyResult<Self> {
        spec.only(&["inputs", "constants", "ops", "outputs", "output_names"])?;
        let inputs = spec.texts("inputs")?.unwrap_or_default();
        let constants = if spec.get("constants")?.is_some() {
            spec.numbers("constants")?.values
        } else {
            Vec::new()
        };
        let mut known = inputs.len() + constants.len();
        let mut operations = Vec::new();
        let rows: Vec<Bound<'_, PyAny>> = match spec.get("ops")? {
            Some(rows) => rows.try_iter()?.collect::<PyResult<_>>()?,
            None => Vec::new(),
        };
        for row in rows {
            let wrong = || {
                refused(&format!(
                    "table row {row} is not allowed: [operation, operands ...] with as many values \
                     before it (there are {known}) as the operation takes"
                ))
            };
            let name: String =
                row.get_item(0).and_then(|name| name.extract()).map_err(|_| wrong())?;
            let (_, operation, count) =
                *OPERATIONS.iter().find(|(known, ..)| *known == name).ok_or_else(wrong)?;
            let mut values = [0; 3];
            if row.len().map_err(|_| wrong())? != count + 1 {
                return Err(wrong());
            }
            for (i, value) in values.iter_mut().take(count).enumerate() {
                *value = row.get_item(i + 1).and_then(|v| v.extract()).map_err(|_| wrong())?;
                if *value >= known {
                    return Err(wrong());
                }
            }
            operations.push((operation, values));
            known += 1;
        }
        let outputs: Vec<Value> = match spec.get("outputs")? {
            Some(outputs) => outputs.extract()?,
            None => Vec::new(),
        };
        if let Some(output) = outputs.iter().find(|output| **output >= known) {
            return Err(refused(&format!("table output {output} is not allowed: < {known}")));
        }
        let output_names = spec.texts("output_names")?.unwrap_or_default();
        Ok(Self { inputs, constants, operations, outputs, output_names })
    }

    /// As a dict.
    pub fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        out.set_item("inputs", &self.inputs)?;
        out.set_item("constants", &self.constants)?;
        let rows = PyList::empty(py);
        for (operation, values) in &self.operations {
            let (name, _, count) = OPERATIONS
                .iter()
                .find(|(_, of, _)| of == operation)
                .ok_or_else(|| refused("a table holds an operation without a name"))?;
            let mut row = vec![name.into_pyobject(py)?.into_any()];
            for value in values.iter().take(*count) {
                row.push(value.into_pyobject(py)?.into_any());
            }
            rows.append(PyTuple::new(py, row)?)?;
        }
        out.set_item("ops", rows)?;
        out.set_item("outputs", &self.outputs)?;
        out.set_item("output_names", &self.output_names)?;
        Ok(out)
    }

    /// With some of the outputs only.
    pub fn with_outputs(&self, outputs: std::ops::Range<usize>) -> Self {
        let mut table = self.clone();
        table.outputs = self.outputs.get(outputs).unwrap_or(&[]).to_vec();
        table.trimmed()
    }

    /// Without the constants and operations that no output needs.
    pub fn trimmed(&self) -> Self {
        let (inputs, base) = (self.inputs.len(), self.base());
        let mut needed = vec![false; base + self.operations.len()];
        self.outputs.iter().for_each(|value| needed[*value] = true);
        for (i, (operation, values)) in self.operations.iter().enumerate().rev() {
            if needed[base + i] {
                values.iter().take(operands(*operation)).for_each(|value| needed[*value] = true);
            }
        }
        let mut place: Vec<Value> = (0..inputs).collect();
        let mut next = inputs;
        for needed in &needed[inputs..] {
            place.push(next);
            next += usize::from(*needed);
        }
        let kept = |(i, _): &(usize, _)| needed[inputs + i];
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
        Self { inputs, constants, operations, outputs, output_names }
    }

    /// The value before the first result.
    fn base(&self) -> usize {
        self.inputs.len() + self.constants.len()
    }

    /// Operations with a product and the sum that alone uses it made one.
    fn fused(&self) -> Vec<Option<(Operation, [Value; 3])>> {
        let base = self.base();
        let mut uses = vec![0_usize; base + self.operations.len()];
        for (operation, values) in &self.operations {
            values.iter().take(operands(*operation)).for_each(|value| uses[*value] += 1);
        }
        self.outputs.iter().for_each(|value| uses[*value] += 1);
        let mut fused: Vec<_> = self.operations.iter().copied().map(Some).collect();
        for index in 0..fused.len() {
            let Some((operation, [a, b, _])) = fused[index] else { continue };
            let product = |value: Value| match value.checked_sub(base).map(|i| fused[i]) {
                Some(Some((Operation::Multiply, [x, y, _]))) if uses[value] == 1 => Some((x, y)),
                _ => None,
            };
            let (made, gone) = match (operation, product(a), product(b)) {
                (Operation::Add, Some((x, y)), _) => (Some((Operation::MultiplyAdd, [x, y, b])), a),
                (Operation::Add, None, Some((x, y))) => {
                    (Some((Operation::MultiplyAdd, [x, y, a])), b)
                }
                (Operation::Subtract, Some((x, y)), _) => {
                    (Some((Operation::MultiplySubtract, [x, y, b])), a)
                }
                (Operation::Subtract, None, Some((x, y))) => {
                    (Some((Operation::SubtractProduct, [x, y, a])), b)
                }
                _ => continue,
            };
            fused[index] = made;
            fused[gone - base] = None;
        }
        fused
    }

    /// As a program of the core.
    pub fn compile(&self) -> PyResult<Compiled> {
        let (base, length) = (self.base(), self.base() + self.operations.len());
        let mut operations = self.fused();
        // what no output needs is not computed
        let mut last_use = vec![None; length];
        self.outputs.iter().for_each(|value| last_use[*value] = Some(usize::MAX));
        for index in (0..operations.len()).rev() {
            if last_use[base + index].is_none() {
                operations[index] = None;
            }
            if let Some((operation, values)) = operations[index] {
                for value in values.iter().take(operands(operation)) {
                    last_use[*value] = last_use[*value].or(Some(index));
                }
            }
        }
        let mut registers = Allocation::default();
        let mut place = vec![0_u8; length];
        for slot in place.iter_mut().take(self.inputs.len()) {
            *slot = registers.take()?;
        }
        let mut constants = Vec::new();
        for (i, constant) in self.constants.iter().enumerate() {
            let value = self.inputs.len() + i;
            if last_use[value].is_some() {
                place[value] = registers.take()?;
                constants.push((place[value], *constant));
            }
        }
        let mut instructions = Vec::new();
        for (index, operation) in operations.iter().enumerate() {
            let Some((operation, values)) = operation else { continue };
            let mut at = [0_u8; 3];
            for (register, value) in at.iter_mut().zip(values).take(operands(*operation)) {
                *register = place[*value];
            }
            // inputs and constants keep their places; results make room when they are used up
            let mut ends: Vec<Value> = values.iter().take(operands(*operation)).copied().collect();
            ends.sort_unstable();
            ends.dedup();
            for value in ends {
                if value >= base && last_use[value] == Some(index) {
                    registers.free(place[value]);
                }
            }
            let result = registers.take()?;
            place[base + index] = result;
            let [a, b, c] = at;
            instructions.push(Instruction { operation: *operation, result, a, b, c });
        }
        let outputs = self.outputs.iter().map(|value| place[*value]).collect();
        Ok(Compiled { instructions, outputs, constants })
    }
}

/// Which registers are taken.
#[derive(Default)]
struct Allocation {
    taken: usize,
    free: Vec<u8>,
}

impl Allocation {
    fn take(&mut self) -> PyResult<u8> {
        if let Some(register) = self.free.pop() {
            return Ok(register);
        }
        let register = u8::try_from(self.taken).map_err(|_| {
            refused(&format!(
                "the program needs more than {REGISTERS} registers: simplify the expressions, or \
                 lower the order"
            ))
        })?;
        self.taken += 1;
        Ok(register)
    }

    fn free(&mut self, register: u8) {
        self.free.push(register);
    }
}

/// A program of the core that is kept here. Its inputs stand in the first registers.
#[derive(Clone, Debug)]
pub struct Compiled {
    instructions: Vec<Instruction>,
    pub outputs: Vec<u8>,
    constants: Vec<(u8, f64)>,
}

impl Compiled {
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

    /// Evaluate for some inputs.
    pub fn evaluate<T: Scalar>(&self, inputs: &[T]) -> Vec<T> {
        let mut registers = self.registers();
        registers.0.iter_mut().zip(inputs).for_each(|(register, input)| *register = *input);
        self.program().run(&mut registers);
        self.outputs.iter().map(|output| registers.0[usize::from(*output)]).collect()
    }
}
