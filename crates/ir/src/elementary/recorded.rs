//! Floor 2. Numbers that write down what is computed with them: the core's elementary functions, run over
//! them, become a [`Function`].
//!
//! Constants are computed with at once; equal rows are written once.

use super::function::{Function, Kind, Operation, Precision, Row, Value};
use hgo_rs::elementary::{Bits, Float, Truth};
use std::cell::RefCell;
use std::collections::HashMap;
use std::marker::PhantomData;
use std::ops::{Add, BitAnd, BitOr, BitXor, Div, Mul, Neg, Shl, Shr, Sub};

/// A number of the core's own.
pub trait Native: hgo_rs::elementary::Precision<Bits: Into<u64>, Truth = bool> {
    /// Its precision.
    const PRECISION: Precision;
}

impl Native for f32 {
    const PRECISION: Precision = Precision::Single;
}

impl Native for f64 {
    const PRECISION: Precision = Precision::Double;
}

/// What was computed so far in this thread.
struct Record {
    precision: Precision,
    rows: Vec<Row>,
    known: HashMap<Row, usize>,
}

impl Record {
    fn new(precision: Precision) -> Self {
        Self { precision, rows: Vec::new(), known: HashMap::new() }
    }
}

thread_local! {
    static RECORD: RefCell<Record> = RefCell::new(Record::new(Precision::Double));
}

fn apply<const K: usize>(operation: Operation, operands: [Value; K]) -> Value {
    RECORD.with_borrow_mut(|record| {
        let row = Row::new(operation, operands);
        if let Some(constant) = row.folded(record.precision) {
            return constant;
        }
        let next = record.rows.len();
        let index = *record.known.entry(row).or_insert(next);
        if index == next {
            record.rows.push(row);
        }
        Value::Row(index)
    })
}

/// What `body` computes from these parameters.
pub fn recorded<P: Native>(
    name: &'static str,
    meaning: &'static str,
    parameters: Vec<(&'static str, Kind)>,
    body: impl FnOnce(&dyn Fn(usize) -> Value) -> Vec<Value>,
) -> Function {
    RECORD.set(Record::new(P::PRECISION));
    let results = body(&Value::Parameter);
    let Record { precision, rows, .. } = RECORD.replace(Record::new(P::PRECISION));
    Function { name, meaning, precision, parameters, rows, results }.live()
}

/// A number of the precision of `P`.
#[derive(Clone, Copy, Debug)]
pub struct Number<P>(pub Value, PhantomData<P>);

/// The bits of a number.
#[derive(Clone, Copy, Debug)]
pub struct Word(pub Value);

/// The answer of a comparison.
#[derive(Clone, Copy, Debug)]
pub struct Answer(pub Value);

impl<P> Number<P> {
    /// A number that is known as this value.
    pub const fn at(value: Value) -> Self {
        Self(value, PhantomData)
    }
}

macro_rules! operators {
    ($($name:ident $method:ident $operation:ident of $type:ident<$($p:ident)?> by $make:path;)+) => {$(
        impl<$($p)?> $name for $type<$($p)?> {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                $make(apply(Operation::$operation, [self.0, other.0]))
            }
        }
    )+};
}

operators! {
    Add add Add of Number<P> by Self::at;
    Sub sub Subtract of Number<P> by Self::at;
    Mul mul Multiply of Number<P> by Self::at;
    Div div Divide of Number<P> by Self::at;
    BitAnd bitand And of Word<> by Self;
    BitOr bitor Or of Word<> by Self;
    BitXor bitxor Xor of Word<> by Self;
    BitAnd bitand Both of Answer<> by Self;
    BitOr bitor Either of Answer<> by Self;
}

impl<P> Neg for Number<P> {
    type Output = Self;
    fn neg(self) -> Self {
        Self::at(apply(Operation::Negate, [self.0]))
    }
}

impl Shl<u32> for Word {
    type Output = Self;
    fn shl(self, by: u32) -> Self {
        Self(apply(Operation::ShiftLeft(by), [self.0]))
    }
}

impl Shr<u32> for Word {
    type Output = Self;
    fn shr(self, by: u32) -> Self {
        Self(apply(Operation::ShiftRight(by), [self.0]))
    }
}

impl Truth for Answer {}

impl Bits for Word {
    type Truth = Answer;
    fn of(value: u64) -> Self {
        Self(Value::Bits(value))
    }
    fn wrapping_add(self, other: Self) -> Self {
        Self(apply(Operation::WrappingAdd, [self.0, other.0]))
    }
    fn wrapping_sub(self, other: Self) -> Self {
        Self(apply(Operation::WrappingSubtract, [self.0, other.0]))
    }
    fn equal(self, other: Self) -> Answer {
        Answer(apply(Operation::SameBits, [self.0, other.0]))
    }
}

impl<P: Native> Float for Number<P> {
    type Precision = P;
    type Bits = Word;
    type Truth = Answer;
    fn of(value: P) -> Self {
        Self::at(Value::Number(value.to_bits().into()))
    }
    fn short(value: f32) -> Self {
        Self::of(P::short(value))
    }
    fn abs(self) -> Self {
        Self::at(apply(Operation::Abs, [self.0]))
    }
    fn copysign(self, sign: Self) -> Self {
        Self::at(apply(Operation::CopySign, [self.0, sign.0]))
    }
    fn sqrt(self) -> Self {
        Self::at(apply(Operation::Sqrt, [self.0]))
    }
    fn to_bits(self) -> Word {
        Word(apply(Operation::ToBits, [self.0]))
    }
    fn from_bits(bits: Word) -> Self {
        Self::at(apply(Operation::FromBits, [bits.0]))
    }
    fn less(self, other: Self) -> Answer {
        Answer(apply(Operation::Less, [self.0, other.0]))
    }
    fn less_equal(self, other: Self) -> Answer {
        Answer(apply(Operation::LessEqual, [self.0, other.0]))
    }
    fn equal(self, other: Self) -> Answer {
        Answer(apply(Operation::Equal, [self.0, other.0]))
    }
    fn is_nan(self) -> Answer {
        Answer(apply(Operation::IsNan, [self.0]))
    }
    fn select(truth: Answer, yes: Self, no: Self) -> Self {
        Self::at(apply(Operation::Select, [truth.0, yes.0, no.0]))
    }
}
