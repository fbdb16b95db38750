//! Straight-line programs in the making: tables of operations, each value computed once.

use super::errors::refused;
use super::spec::Spec;
use crate::program::Operation;
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

    /// Without the inputs whose names begin like that, which nothing may use.
    pub fn without_inputs(&self, names: &[&str]) -> Self {
        let goes = |name: &String| {
            names
                .iter()
                .any(|start| name == start || start.ends_with('[') && name.starts_with(start))
        };
        let mut place: Vec<Value> = Vec::with_capacity(self.inputs.len());
        let mut kept = 0;
        for name in &self.inputs {
            place.push(kept);
            kept += usize::from(!goes(name));
        }
        let gone = self.inputs.len() - kept;
        let moved = |value: Value| place.get(value).copied().unwrap_or(value.saturating_sub(gone));
        Self {
            inputs: self.inputs.iter().filter(|name| !goes(name)).cloned().collect(),
            constants: self.constants.clone(),
            operations: self.operations.iter().map(|(of, from)| (*of, from.map(moved))).collect(),
            outputs: self.outputs.iter().map(|value| moved(*value)).collect(),
            output_names: self.output_names.clone(),
        }
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

    /// The first result.
    pub fn base(&self) -> usize {
        self.inputs.len() + self.constants.len()
    }
}
