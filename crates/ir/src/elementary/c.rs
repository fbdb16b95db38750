//! Floor 3. Functions in C99.
//!
//! They need `math.h`, and `stdint.h` and `string.h` where bits are looked at; compiled without
//! contraction of products and sums, they give the core's bits.

use super::function::{Function, Kind, Operation, Precision};
use super::text::{Expression, Language, Rank, digits, infinite, listed, wrapped, written};
use std::fmt::Write;

/// C99, functions called `prefix_name`.
struct C99<'a> {
    prefix: &'a str,
}

const fn real(precision: Precision) -> &'static str {
    match precision {
        Precision::Single => "float",
        Precision::Double => "double",
    }
}

fn type_of(precision: Precision, kind: Kind) -> String {
    match kind {
        Kind::Number => real(precision).to_owned(),
        Kind::Bits => format!("uint{}_t", precision.width()),
        Kind::Truth => "int".to_owned(),
    }
}

impl Language for C99<'_> {
    fn number(&self, precision: Precision, bits: u64) -> String {
        let (suffix, cast) = match precision {
            Precision::Single => ("f", ""),
            // the header's are of type float
            Precision::Double => ("", "(double)"),
        };
        match (digits(precision, bits), infinite(precision, bits)) {
            (Some(digits), _) => format!("{digits}{suffix}"),
            (None, Some(sign)) => format!("{sign}{cast}INFINITY"),
            (None, None) => format!("{cast}NAN"),
        }
    }

    fn bits(&self, precision: Precision, bits: u64) -> String {
        if bits < 1 << 15 {
            return bits.to_string();
        }
        format!("UINT{}_C(0x{bits:x})", precision.width())
    }

    fn call(&self, precision: Precision, operation: Operation, of: &[Expression]) -> Expression {
        let f = if precision == Precision::Single { "f" } else { "" };
        let wrapping = |sign: &str| {
            let held: Vec<String> = of.iter().map(|one| one.held(Rank::Atom)).collect();
            Expression { text: held.join(sign), rank: Rank::Logic }
        };
        let name = match operation {
            Operation::WrappingAdd => return wrapping(" + "),
            Operation::WrappingSubtract => return wrapping(" - "),
            Operation::Abs => format!("fabs{f}"),
            Operation::CopySign => format!("copysign{f}"),
            Operation::IsNan => "isnan".to_owned(),
            Operation::ToBits => format!("{}_to_bits", self.prefix),
            Operation::FromBits => format!("{}_from_bits", self.prefix),
            _ => format!("sqrt{f}"),
        };
        Expression::atom(format!("{name}({})", listed(of)))
    }

    fn choice(&self, truth: &Expression, yes: &Expression, no: &Expression) -> String {
        let (yes, no) = (yes.held(Rank::Sum), no.held(Rank::Sum));
        format!("{} ? {yes} : {no}", truth.held(Rank::Comparison))
    }
}

/// The views of a number's bits and back that functions call.
pub fn views(precision: Precision, prefix: &str) -> [String; 2] {
    let (number, bits) = (real(precision), type_of(precision, Kind::Bits));
    let view = |name: &str, from: &str, to: &str| {
        format!(
            "static {to} {prefix}_{name}({from} x)\n{{\n    {to} y;\n    memcpy(&y, &x, sizeof y);\n    \
             return y;\n}}\n"
        )
    };
    [view("to_bits", number, &bits), view("from_bits", &bits, number)]
}

/// A function, called `prefix_name`; one with several results gives a structure of them, r0, r1, …
pub fn function(function: &Function, prefix: &str) -> String {
    let Function { name, meaning, precision, parameters, results, .. } = function;
    let text = written(function, &C99 { prefix });
    let given: Vec<String> = parameters
        .iter()
        .map(|(name, kind)| format!("{} {name}", type_of(*precision, *kind)))
        .collect();
    let mut out = String::new();
    let mut result = results
        .first()
        .map_or_else(String::new, |first| type_of(*precision, function.kind(*first)));
    if results.len() > 1 {
        let members = results
            .iter()
            .enumerate()
            .map(|(i, value)| format!("{} r{i};", type_of(*precision, function.kind(*value))));
        let members = members.collect::<Vec<_>>().join(" ");
        result = format!("{prefix}_{name}_result");
        let _ = writeln!(out, "typedef struct {{ {members} }} {result};");
    }
    let _ = writeln!(out, "/* {meaning} */");
    let head = format!("static {result} {prefix}_{name}({})", given.join(", "));
    let _ = writeln!(out, "{}\n{{", wrapped(0, &head));
    for (name, kind, value) in &text.steps {
        let kind = type_of(*precision, *kind);
        let _ = writeln!(out, "{}", wrapped(4, &format!("const {kind} {name} = {value};")));
    }
    if results.len() > 1 {
        let made = format!("const {result} result = {{{}}};", text.results.join(", "));
        let _ = writeln!(out, "{}\n    return result;\n}}", wrapped(4, &made));
    } else {
        let made = format!("return {};", text.results.join(", "));
        let _ = writeln!(out, "{}\n}}", wrapped(4, &made));
    }
    out
}
