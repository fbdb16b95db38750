//! Floor 1. A function as a straight line of operations on numbers, their bits and answers.

use hgo_rs::elementary::{Bits, Float};

/// Of how many bits numbers are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 32.
    Single,
    /// 64.
    Double,
}

impl Precision {
    /// By the name that Python gives it: "single" or "double".
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "single" => Some(Self::Single),
            "double" => Some(Self::Double),
            _ => None,
        }
    }

    /// Bits of a number.
    pub const fn width(self) -> u32 {
        match self {
            Self::Single => 32,
            Self::Double => 64,
        }
    }
}

/// What a value is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A number of the function's precision.
    Number,
    /// The bits of one, an unsigned whole number.
    Bits,
    /// Yes or no.
    Truth,
}

/// A value: a parameter, the result of an earlier row, or a constant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Value {
    /// Parameter by its place.
    Parameter(usize),
    /// Result of a row by its place.
    Row(usize),
    /// A number, by its bits.
    Number(u64),
    /// Bits.
    Bits(u64),
    /// An answer.
    Truth(bool),
}

impl Value {
    /// The bits of a constant; 0 and 1 for an answer.
    pub const fn constant(self) -> Option<u64> {
        match self {
            Self::Number(bits) | Self::Bits(bits) => Some(bits),
            Self::Truth(truth) => Some(truth as u64),
            Self::Parameter(_) | Self::Row(_) => None,
        }
    }

    /// A constant of this kind, by its bits.
    pub const fn of(kind: Kind, bits: u64) -> Self {
        match kind {
            Kind::Number => Self::Number(bits),
            Kind::Bits => Self::Bits(bits),
            Kind::Truth => Self::Truth(bits != 0),
        }
    }
}

/// An operation of [`Float`], [`Bits`] or [`Truth`](hgo_rs::elementary::Truth).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Operation {
    /// a + b.
    Add,
    /// a − b.
    Subtract,
    /// ab.
    Multiply,
    /// a/b.
    Divide,
    /// −a.
    Negate,
    /// |a|.
    Abs,
    /// Magnitude of a, sign of b.
    CopySign,
    /// √a.
    Sqrt,
    /// The bits of a number.
    ToBits,
    /// The number of bits.
    FromBits,
    /// a < b.
    Less,
    /// a ≤ b.
    LessEqual,
    /// a = b.
    Equal,
    /// Whether a is no number.
    IsNan,
    /// b where the answer a is yes, else c.
    Select,
    /// Sum of bits without its carry.
    WrappingAdd,
    /// Difference of bits without its borrow.
    WrappingSubtract,
    /// Bits of both.
    And,
    /// Bits of either.
    Or,
    /// Bits of one alone.
    Xor,
    /// Bits moved up.
    ShiftLeft(u32),
    /// Bits moved down, zeros after them.
    ShiftRight(u32),
    /// Whether all bits are equal.
    SameBits,
    /// Yes twice.
    Both,
    /// Yes at least once.
    Either,
}

impl Operation {
    /// How many values it is made of.
    pub const fn operands(self) -> usize {
        match self {
            Self::Negate
            | Self::Abs
            | Self::Sqrt
            | Self::ToBits
            | Self::FromBits
            | Self::IsNan
            | Self::ShiftLeft(_)
            | Self::ShiftRight(_) => 1,
            Self::Select => 3,
            _ => 2,
        }
    }

    /// What its result is.
    pub const fn kind(self) -> Kind {
        match self {
            Self::Less
            | Self::LessEqual
            | Self::Equal
            | Self::IsNan
            | Self::SameBits
            | Self::Both
            | Self::Either => Kind::Truth,
            Self::ToBits
            | Self::WrappingAdd
            | Self::WrappingSubtract
            | Self::And
            | Self::Or
            | Self::Xor
            | Self::ShiftLeft(_)
            | Self::ShiftRight(_) => Kind::Bits,
            _ => Kind::Number,
        }
    }

    /// Its result, every value by its bits: that of the core, operation by operation.
    pub fn apply(self, precision: Precision, operands: [u64; 3]) -> u64 {
        match precision {
            Precision::Single => self.computed::<f32>(operands),
            Precision::Double => self.computed::<f64>(operands),
        }
    }

    fn computed<P: Float<Bits: Into<u64>, Truth = bool>>(self, [a, b, c]: [u64; 3]) -> u64 {
        let number = |bits: u64| P::from_bits(P::Bits::of(bits));
        let bits = |value: P| -> u64 { value.to_bits().into() };
        let (x, y) = (number(a), number(b));
        let (m, n) = (P::Bits::of(a), P::Bits::of(b));
        match self {
            Self::Add => bits(x + y),
            Self::Subtract => bits(x - y),
            Self::Multiply => bits(x * y),
            Self::Divide => bits(x / y),
            Self::Negate => bits(-x),
            Self::Abs => bits(x.abs()),
            Self::CopySign => bits(x.copysign(y)),
            Self::Sqrt => bits(x.sqrt()),
            Self::ToBits | Self::FromBits => a,
            Self::Less => x.less(y).into(),
            Self::LessEqual => x.less_equal(y).into(),
            Self::Equal => x.equal(y).into(),
            Self::IsNan => x.is_nan().into(),
            Self::Select => bits(P::select(a != 0, y, number(c))),
            Self::WrappingAdd => m.wrapping_add(n).into(),
            Self::WrappingSubtract => m.wrapping_sub(n).into(),
            Self::And => (m & n).into(),
            Self::Or => (m | n).into(),
            Self::Xor => (m ^ n).into(),
            Self::ShiftLeft(by) => (m << by).into(),
            Self::ShiftRight(by) => (m >> by).into(),
            Self::SameBits => m.equal(n).into(),
            Self::Both => a & b,
            Self::Either => a | b,
        }
    }
}

/// An operation and what it is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Row {
    /// What is done.
    pub operation: Operation,
    /// With which values; those beyond [`Operation::operands`] count for nothing.
    values: [Value; 3],
}

impl Row {
    /// Of as many values as the operation takes.
    pub fn new<const K: usize>(operation: Operation, operands: [Value; K]) -> Self {
        let none = Value::Truth(false);
        Self { operation, values: std::array::from_fn(|i| *operands.get(i).unwrap_or(&none)) }
    }

    /// What it is made of.
    pub fn operands(&self) -> &[Value] {
        self.values.get(..self.operation.operands()).unwrap_or(&self.values)
    }

    /// The same row with other values.
    #[must_use]
    pub fn map(self, f: impl Fn(Value) -> Value) -> Self {
        Self { values: self.values.map(f), ..self }
    }

    /// Its result where all values are constants.
    pub fn folded(&self, precision: Precision) -> Option<Value> {
        let mut bits = [0; 3];
        for (bits, value) in bits.iter_mut().zip(self.operands()) {
            *bits = value.constant()?;
        }
        let result = self.operation.apply(precision, bits);
        Some(Value::of(self.operation.kind(), result))
    }
}

/// A straight line of operations, each value computed once.
#[derive(Clone, Debug, PartialEq)]
pub struct Function {
    /// Its name in the core.
    pub name: &'static str,
    /// What it computes, in a line.
    pub meaning: &'static str,
    /// Of its numbers.
    pub precision: Precision,
    /// Names and kinds.
    pub parameters: Vec<(&'static str, Kind)>,
    /// Operations, in order.
    pub rows: Vec<Row>,
    /// One value or more.
    pub results: Vec<Value>,
}

impl Function {
    /// What a value is.
    pub fn kind(&self, value: Value) -> Kind {
        match value {
            Value::Parameter(index) => self.parameters.get(index).map_or(Kind::Number, |p| p.1),
            Value::Row(index) => self.rows.get(index).map_or(Kind::Number, |r| r.operation.kind()),
            Value::Number(_) => Kind::Number,
            Value::Bits(_) => Kind::Bits,
            Value::Truth(_) => Kind::Truth,
        }
    }

    /// Its results, row by row; values by their bits.
    pub fn evaluate(&self, arguments: &[u64]) -> Vec<u64> {
        let mut results: Vec<u64> = Vec::with_capacity(self.rows.len());
        let value = |results: &[u64], value: Value| match value {
            Value::Parameter(index) => arguments.get(index).copied().unwrap_or(0),
            Value::Row(index) => results.get(index).copied().unwrap_or(0),
            constant => constant.constant().unwrap_or(0),
        };
        for row in &self.rows {
            let operands = row.values.map(|operand| value(&results, operand));
            results.push(row.operation.apply(self.precision, operands));
        }
        self.results.iter().map(|result| value(&results, *result)).collect()
    }

    /// The same without rows that no result needs.
    #[must_use]
    pub fn live(mut self) -> Self {
        let mut needed = vec![false; self.rows.len()];
        let need = |needed: &mut Vec<bool>, value: &Value| {
            if let Value::Row(index) = value
                && let Some(needed) = needed.get_mut(*index)
            {
                *needed = true;
            }
        };
        self.results.iter().for_each(|value| need(&mut needed, value));
        for (index, row) in self.rows.iter().enumerate().rev() {
            if needed[index] {
                row.operands().iter().for_each(|value| need(&mut needed, value));
            }
        }
        let mut place = Vec::with_capacity(needed.len());
        let mut next = 0;
        for needed in &needed {
            place.push(next);
            next += usize::from(*needed);
        }
        let moved = |value: Value| match value {
            Value::Row(index) => Value::Row(place.get(index).copied().unwrap_or(0)),
            other => other,
        };
        let kept = self.rows.iter().zip(&needed).filter(|(_, needed)| **needed);
        self.rows = kept.map(|(row, _)| row.map(moved)).collect();
        self.results.iter_mut().for_each(|value| *value = moved(*value));
        self
    }
}
