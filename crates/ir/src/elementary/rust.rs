//! Floor 3. Functions in Rust, without `std`; √x is called `sqrt(x)`, a function that the program has.

use super::function::{Function, Kind, Operation, Precision};
use super::text::{Expression, Language, Rank, digits, infinite, listed, wrapped, written};
use std::fmt::Write;

struct Rust;

const fn type_of(precision: Precision, kind: Kind) -> &'static str {
    match (precision, kind) {
        (Precision::Single, Kind::Number) => "f32",
        (Precision::Double, Kind::Number) => "f64",
        (Precision::Single, Kind::Bits) => "u32",
        (Precision::Double, Kind::Bits) => "u64",
        (_, Kind::Truth) => "bool",
    }
}

impl Language for Rust {
    fn number(&self, precision: Precision, bits: u64) -> String {
        let real = type_of(precision, Kind::Number);
        match (digits(precision, bits), infinite(precision, bits)) {
            (Some(digits), _) => digits,
            (None, Some(sign)) => format!("{sign}{real}::INFINITY"),
            (None, None) => format!("{real}::NAN"),
        }
    }

    fn bits(&self, _: Precision, bits: u64) -> String {
        if bits < 1 << 15 {
            return bits.to_string();
        }
        let hex = format!("{bits:X}");
        let first = hex.len() % 4;
        let mut text = format!("0x{}", hex.get(..first).unwrap_or(""));
        for (index, digit) in hex.chars().enumerate().skip(first) {
            if index % 4 == first && index > 0 {
                text.push('_');
            }
            text.push(digit);
        }
        text
    }

    fn call(&self, precision: Precision, operation: Operation, of: &[Expression]) -> Expression {
        let (number, bits) = (type_of(precision, Kind::Number), type_of(precision, Kind::Bits));
        let name = match operation {
            Operation::Abs => format!("{number}::abs"),
            Operation::CopySign => format!("{number}::copysign"),
            Operation::IsNan => format!("{number}::is_nan"),
            Operation::ToBits => format!("{number}::to_bits"),
            Operation::FromBits => format!("{number}::from_bits"),
            Operation::WrappingAdd => format!("{bits}::wrapping_add"),
            Operation::WrappingSubtract => format!("{bits}::wrapping_sub"),
            _ => "sqrt".to_owned(),
        };
        Expression::atom(format!("{name}({})", listed(of)))
    }

    fn choice(&self, truth: &Expression, yes: &Expression, no: &Expression) -> String {
        let head = format!("if {} {{ {} }}", truth.text, yes.text);
        if no.rank == Rank::Choice {
            return format!("{head} else {}", no.text);
        }
        format!("{head} else {{ {} }}", no.text)
    }
}

/// A function under its name; several results are a tuple.
pub fn function(function: &Function) -> String {
    let Function { name, meaning, precision, parameters, results, .. } = function;
    let text = written(function, &Rust);
    let given: Vec<String> = parameters
        .iter()
        .map(|(name, kind)| format!("{name}: {}", type_of(*precision, *kind)))
        .collect();
    let of_all = |texts: Vec<&str>| match texts.as_slice() {
        [one] => (*one).to_owned(),
        several => format!("({})", several.join(", ")),
    };
    let result = results.iter().map(|value| type_of(*precision, function.kind(*value)));
    let result = of_all(result.collect());
    let mut out = format!("/// {meaning}\n");
    let head = format!("fn {name}({}) -> {result} {{", given.join(", "));
    let _ = writeln!(out, "{}", wrapped(0, &head));
    for (name, _, value) in &text.steps {
        let _ = writeln!(out, "{}", wrapped(4, &format!("let {name} = {value};")));
    }
    let made = of_all(text.results.iter().map(String::as_str).collect());
    let _ = writeln!(out, "{}\n}}", wrapped(4, &made));
    out
}
