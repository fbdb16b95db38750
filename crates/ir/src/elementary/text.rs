//! Floor 2. A function as expressions of a language: what is used once stands within what uses it, as far as
//! that stays readable; what is shared, or long, gets a name.
//!
//! Languages group a − b − c as (a − b) − c and may not regroup it: the written order is the function's,
//! and so are the roundings.

use super::function::{Function, Kind, Operation, Precision, Value};

/// A longer expression gets a name of its own.
const WIDEST: usize = 60;
/// Columns of a line.
const COLUMNS: usize = 98;

/// How tightly an expression holds together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rank {
    /// A choice between two.
    Choice,
    /// Bits, and answers of two answers.
    Logic,
    /// A comparison.
    Comparison,
    /// A sum or a difference.
    Sum,
    /// A product or a quotient.
    Product,
    /// A negative.
    Sign,
    /// A name, a number, a call.
    Atom,
}

/// An expression and how tightly it holds together.
#[derive(Clone, Debug)]
pub struct Expression {
    /// Its text.
    pub text: String,
    /// Of its outermost operation.
    pub rank: Rank,
}

impl Expression {
    /// What holds tightest.
    pub fn atom(text: impl Into<String>) -> Self {
        Self { text: text.into(), rank: Rank::Atom }
    }

    /// The text as an operand, in parentheses where it holds less tightly than it must.
    pub fn held(&self, rank: Rank) -> String {
        if self.rank >= rank { self.text.clone() } else { format!("({})", self.text) }
    }
}

/// Expressions between commas.
pub fn listed(of: &[Expression]) -> String {
    of.iter().map(|one| one.text.as_str()).collect::<Vec<_>>().join(", ")
}

/// What languages write differently.
pub trait Language {
    /// A number.
    fn number(&self, precision: Precision, bits: u64) -> String;
    /// Bits.
    fn bits(&self, precision: Precision, bits: u64) -> String;
    /// A call of what is no sign between operands.
    fn call(&self, precision: Precision, operation: Operation, of: &[Expression]) -> Expression;
    /// `yes` where a truth holds, else `no`.
    fn choice(&self, truth: &Expression, yes: &Expression, no: &Expression) -> String;
}

/// Names and their expressions in order, and the results.
#[derive(Clone, Debug)]
pub struct Written {
    /// Name, kind and expression.
    pub steps: Vec<(String, Kind, String)>,
    /// An expression each.
    pub results: Vec<String>,
}

/// A function in a language.
pub fn written(function: &Function, language: &impl Language) -> Written {
    let mut uses = vec![0_usize; function.rows.len()];
    let operands = function.rows.iter().flat_map(super::function::Row::operands);
    for value in operands.chain(&function.results) {
        if let Value::Row(index) = value
            && let Some(uses) = uses.get_mut(*index)
        {
            *uses += 1;
        }
    }
    let mut steps = Vec::new();
    let mut counts = [0_usize; 3];
    let mut known: Vec<Expression> = Vec::with_capacity(function.rows.len());
    let value = |known: &[Expression], value: Value| -> Expression {
        match value {
            Value::Parameter(index) => {
                Expression::atom(function.parameters.get(index).map_or("", |p| p.0))
            }
            Value::Row(index) => {
                known.get(index).cloned().unwrap_or_else(|| Expression::atom(String::new()))
            }
            Value::Number(bits) => {
                let text = language.number(function.precision, bits);
                let rank = if text.starts_with('-') { Rank::Sign } else { Rank::Atom };
                Expression { text, rank }
            }
            Value::Bits(bits) => Expression::atom(language.bits(function.precision, bits)),
            Value::Truth(truth) => Expression::atom(if truth { "true" } else { "false" }),
        }
    };
    for (index, (row, uses)) in function.rows.iter().zip(uses).enumerate() {
        let operands: Vec<Expression> =
            row.operands().iter().map(|operand| value(&known, *operand)).collect();
        let mut made = expression(function.precision, row.operation, &operands, language);
        // what is only returned needs no name
        let is_result = function.results.contains(&Value::Row(index));
        if uses != 1 || (made.text.chars().count() > WIDEST && !is_result) {
            let kind = row.operation.kind();
            let (letter, count) = match kind {
                Kind::Number => ('a', &mut counts[0]),
                Kind::Bits => ('b', &mut counts[1]),
                Kind::Truth => ('c', &mut counts[2]),
            };
            *count += 1;
            let name = format!("{letter}{count}");
            steps.push((name.clone(), kind, made.text));
            made = Expression::atom(name);
        }
        known.push(made);
    }
    let results = function.results.iter().map(|result| value(&known, *result).text).collect();
    Written { steps, results }
}

fn expression(
    precision: Precision,
    operation: Operation,
    operands: &[Expression],
    language: &impl Language,
) -> Expression {
    // an operand that is missing would be a row of too few values, which cannot be made
    let none = Expression::atom(String::new());
    let operand = |index: usize| operands.get(index).unwrap_or(&none);
    let infix = |sign: &str, rank: Rank, left: Rank, right: Rank| Expression {
        text: format!("{} {sign} {}", operand(0).held(left), operand(1).held(right)),
        rank,
    };
    let compared = |sign: &str| infix(sign, Rank::Comparison, Rank::Sum, Rank::Sum);
    let of_bits = |sign: &str| infix(sign, Rank::Logic, Rank::Atom, Rank::Atom);
    let shifted = |sign: &str, by: u32| Expression {
        text: format!("{} {sign} {by}", operand(0).held(Rank::Atom)),
        rank: Rank::Logic,
    };
    match operation {
        Operation::Add => infix("+", Rank::Sum, Rank::Sum, Rank::Product),
        Operation::Subtract => infix("-", Rank::Sum, Rank::Sum, Rank::Product),
        Operation::Multiply => infix("*", Rank::Product, Rank::Product, Rank::Sign),
        Operation::Divide => infix("/", Rank::Product, Rank::Product, Rank::Sign),
        Operation::Negate => {
            Expression { text: format!("-{}", operand(0).held(Rank::Atom)), rank: Rank::Sign }
        }
        Operation::Less => compared("<"),
        Operation::LessEqual => compared("<="),
        Operation::Equal => compared("=="),
        Operation::SameBits => infix("==", Rank::Comparison, Rank::Atom, Rank::Atom),
        Operation::And => of_bits("&"),
        Operation::Or => of_bits("|"),
        Operation::Xor => of_bits("^"),
        Operation::ShiftLeft(by) => shifted("<<", by),
        Operation::ShiftRight(by) => shifted(">>", by),
        Operation::Both => infix("&&", Rank::Logic, Rank::Comparison, Rank::Comparison),
        Operation::Either => infix("||", Rank::Logic, Rank::Comparison, Rank::Comparison),
        Operation::Select => Expression {
            text: language.choice(operand(0), operand(1), operand(2)),
            rank: Rank::Choice,
        },
        Operation::Abs
        | Operation::CopySign
        | Operation::Sqrt
        | Operation::ToBits
        | Operation::FromBits
        | Operation::IsNan
        | Operation::WrappingAdd
        | Operation::WrappingSubtract => language.call(precision, operation, operands),
    }
}

/// The shortest digits that give a number again, with a point or an exponent; `None` where it has none.
pub fn digits(precision: Precision, bits: u64) -> Option<String> {
    let (text, finite) = match precision {
        Precision::Double => {
            let value = f64::from_bits(bits);
            (format!("{value:?}"), value.is_finite())
        }
        Precision::Single => {
            #[allow(clippy::cast_possible_truncation)] // a number of 32 bits
            let value = f32::from_bits(bits as u32);
            (format!("{value:?}"), value.is_finite())
        }
    };
    finite.then_some(text)
}

/// Whether a number that has no digits is ∞ (its sign), or NaN.
pub fn infinite(precision: Precision, bits: u64) -> Option<&'static str> {
    #[allow(clippy::cast_possible_truncation)]
    let value = match precision {
        Precision::Double => f64::from_bits(bits),
        Precision::Single => f64::from(f32::from_bits(bits as u32)),
    };
    let sign = if value > 0.0 { "" } else { "-" };
    value.is_infinite().then_some(sign)
}

/// Lines of code, broken at blanks where they are long.
pub fn wrapped(indent: usize, text: &str) -> String {
    let mut lines = String::new();
    let mut column = indent;
    lines.push_str(&" ".repeat(indent));
    for (index, word) in text.split(' ').enumerate() {
        let length = word.chars().count();
        if index > 0 && column + 1 + length > COLUMNS {
            lines.push('\n');
            lines.push_str(&" ".repeat(indent + 4));
            column = indent + 4;
        } else if index > 0 {
            lines.push(' ');
            column += 1;
        }
        lines.push_str(word);
        column += length;
    }
    lines
}
