//! Floor 3. Functions in LLVM's intermediate representation, of one number or of several side by side.
//!
//! Without fast-math flags every operation is rounded on its own: the bits are the core's.

use super::function::{Function, Kind, Operation, Precision, Value};
use std::fmt::Write;

/// `double`, `i64`, `i1`, or a vector of them.
pub fn type_of(precision: Precision, kind: Kind, lanes: usize) -> String {
    let one = scalar(precision, kind);
    if lanes == 1 { one.to_owned() } else { format!("<{lanes} x {one}>") }
}

const fn scalar(precision: Precision, kind: Kind) -> &'static str {
    match (precision, kind) {
        (Precision::Single, Kind::Number) => "float",
        (Precision::Double, Kind::Number) => "double",
        (Precision::Single, Kind::Bits) => "i32",
        (Precision::Double, Kind::Bits) => "i64",
        (_, Kind::Truth) => "i1",
    }
}

/// What a function is called: `@hgo_sin_v8` for eight lanes, `@hgo_sin` for one, `@hgo_sinf…` in single precision.
pub fn name(function: &Function, lanes: usize) -> String {
    let f = if function.precision == Precision::Single { "f" } else { "" };
    let lanes = if lanes == 1 { String::new() } else { format!("_v{lanes}") };
    format!("@hgo_{}{f}{lanes}", function.name)
}

/// The type of what a function gives: of several results, a structure.
pub fn result_type(function: &Function, lanes: usize) -> String {
    let each = |value: &Value| type_of(function.precision, function.kind(*value), lanes);
    match function.results.as_slice() {
        [one] => each(one),
        several => format!("{{ {} }}", several.iter().map(each).collect::<Vec<_>>().join(", ")),
    }
}

/// A constant; a float is written as the double of its value.
fn constant(precision: Precision, value: Value, lanes: usize) -> String {
    let (kind, one) = match value {
        Value::Number(bits) => {
            #[allow(clippy::cast_possible_truncation)] // a number of 32 bits
            let bits = match precision {
                Precision::Single => f64::from(f32::from_bits(bits as u32)).to_bits(),
                Precision::Double => bits,
            };
            (Kind::Number, format!("0x{bits:016X}"))
        }
        // decimal digits: hexadecimal ones are read as a float's
        Value::Bits(bits) => (Kind::Bits, bits.to_string()),
        Value::Truth(truth) => (Kind::Truth, truth.to_string()),
        Value::Parameter(_) | Value::Row(_) => return String::new(),
    };
    if lanes == 1 {
        return one;
    }
    let one = format!("{} {one}", scalar(precision, kind));
    format!("<{}>", vec![one; lanes].join(", "))
}

/// The intrinsic of an operation, of `v8f64`, `f64`, … numbers.
fn intrinsic(operation: Operation, precision: Precision, lanes: usize) -> Option<(String, usize)> {
    let (name, count) = match operation {
        Operation::Abs => ("fabs", 1),
        Operation::Sqrt => ("sqrt", 1),
        Operation::CopySign => ("copysign", 2),
        _ => return None,
    };
    let vector = if lanes == 1 { String::new() } else { format!("v{lanes}") };
    Some((format!("@llvm.{name}.{vector}f{}", precision.width()), count))
}

/// The lines that declare the intrinsics which functions of these lanes call, each once.
pub fn declarations<'a>(
    functions: impl IntoIterator<Item = &'a Function>,
    lanes: usize,
) -> Vec<String> {
    let mut lines = Vec::new();
    for Function { precision, rows, .. } in functions {
        for row in rows {
            if let Some((name, count)) = intrinsic(row.operation, *precision, lanes) {
                let number = type_of(*precision, Kind::Number, lanes);
                let line = format!("declare {number} {name}({})", vec![&*number; count].join(", "));
                if !lines.contains(&line) {
                    lines.push(line);
                }
            }
        }
    }
    lines
}

/// The definition of a function for `lanes` numbers side by side (1: a single one), to be inlined.
///
/// A module needs the [`declarations`] beside it. No parameter is a pointer.
pub fn function_ir(function: &Function, lanes: usize) -> String {
    let Function { precision, parameters, rows, results, .. } = function;
    let value = |value: Value| match value {
        Value::Parameter(index) => {
            format!("%{}", parameters.get(index).map_or("", |parameter| parameter.0))
        }
        Value::Row(index) => format!("%r{index}"),
        known => constant(*precision, known, lanes),
    };
    let of = |kind: Kind| type_of(*precision, kind, lanes);
    let given: Vec<String> =
        parameters.iter().map(|(name, kind)| format!("{} %{name}", of(*kind))).collect();
    let result = result_type(function, lanes);
    let mut out = format!(
        "define internal {result} {}({}) alwaysinline nounwind readnone {{\n",
        name(function, lanes),
        given.join(", ")
    );
    let (number, bits, truth) = (of(Kind::Number), of(Kind::Bits), of(Kind::Truth));
    for (index, row) in rows.iter().enumerate() {
        let operands: Vec<String> = row.operands().iter().map(|one| value(*one)).collect();
        let listed = operands.join(", ");
        let shift = |by: u32| constant(*precision, Value::Bits(by.into()), lanes);
        let made = match row.operation {
            Operation::Add => format!("fadd {number} {listed}"),
            Operation::Subtract => format!("fsub {number} {listed}"),
            Operation::Multiply => format!("fmul {number} {listed}"),
            Operation::Divide => format!("fdiv {number} {listed}"),
            Operation::Negate => format!("fneg {number} {listed}"),
            Operation::ToBits => format!("bitcast {number} {listed} to {bits}"),
            Operation::FromBits => format!("bitcast {bits} {listed} to {number}"),
            Operation::Less => format!("fcmp olt {number} {listed}"),
            Operation::LessEqual => format!("fcmp ole {number} {listed}"),
            Operation::Equal => format!("fcmp oeq {number} {listed}"),
            Operation::IsNan => format!("fcmp uno {number} {listed}, {listed}"),
            Operation::WrappingAdd => format!("add {bits} {listed}"),
            Operation::WrappingSubtract => format!("sub {bits} {listed}"),
            Operation::And => format!("and {bits} {listed}"),
            Operation::Or => format!("or {bits} {listed}"),
            Operation::Xor => format!("xor {bits} {listed}"),
            Operation::ShiftLeft(by) => format!("shl {bits} {listed}, {}", shift(by)),
            Operation::ShiftRight(by) => format!("lshr {bits} {listed}, {}", shift(by)),
            Operation::SameBits => format!("icmp eq {bits} {listed}"),
            Operation::Both => format!("and {truth} {listed}"),
            Operation::Either => format!("or {truth} {listed}"),
            Operation::Select => {
                let mut typed = [&truth, &number, &number].into_iter().zip(&operands);
                let typed: Vec<String> = typed.by_ref().map(|(t, v)| format!("{t} {v}")).collect();
                format!("select {}", typed.join(", "))
            }
            Operation::Abs | Operation::Sqrt | Operation::CopySign => {
                let name =
                    intrinsic(row.operation, *precision, lanes).map_or_else(String::new, |i| i.0);
                let typed: Vec<String> = operands.iter().map(|v| format!("{number} {v}")).collect();
                format!("call {number} {name}({})", typed.join(", "))
            }
        };
        let _ = writeln!(out, "  %r{index} = {made}");
    }
    let last = match results.as_slice() {
        [one] => value(*one),
        several => {
            let mut whole = "poison".to_owned();
            for (index, one) in several.iter().enumerate() {
                let part = format!("{} {}", of(function.kind(*one)), value(*one));
                let _ = writeln!(
                    out,
                    "  %whole{index} = insertvalue {result} {whole}, {part}, {index}"
                );
                whole = format!("%whole{index}");
            }
            whole
        }
    };
    let _ = writeln!(out, "  ret {result} {last}\n}}");
    out
}
