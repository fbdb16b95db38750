"""A program in Rust without `std` and dependencies: a crate with its test vector."""

from __future__ import annotations

import re
import textwrap

from hgo_rs.exports.elementary import Elementary
from hgo_rs.exports.expressions import RUST, Written
from hgo_rs.exports.program import Program, order, wrapped

__all__ = ["files"]

CARGO = """\
[package]
name = "{name}"
version = "0.1.0"
edition = "2024"
rust-version = "1.85"

# What stands in src/lib.rs needs neither `std` nor another crate.

# A package of its own, wherever the folder lies.
[workspace]
"""

STATUS = """\
/// What a step made of its sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// The sample was used.
    Updated = 0,
    /// The sample was missing (NaN or infinite): the law predicted over it.
    Predicted = 1,
    /// The model has no finite value there; the memory was kept.
    Undefined = 2,
}
"""

HELPERS = {
    "min": """\
/// The smaller of the two; NaN stays in `a` and is passed over in `b`.
fn min(a: real, b: real) -> real {
    if b < a { b } else { a }
}
""",
    "max": """\
/// The larger of the two; NaN stays in `a` and is passed over in `b`.
fn max(a: real, b: real) -> real {
    if b > a { b } else { a }
}
""",
    "sign": """\
/// -1, 0 or 1; NaN of NaN.
fn sign(a: real) -> real {
    let up = if a > 0.0 { 1.0 } else { a };
    if a < 0.0 { -1.0 } else { up }
}
""",
}

# root = floor(sqrt(mantissa)) has one bit more than a result: the last one rounds. There is no tie:
# a root that ends in one half has a square with more bits than a mantissa.
ROOT = """\
/// The square root, correctly rounded: the integer root of the mantissa, one bit longer than the
/// result, rounded. (A processor's own instruction gives the same bits.)
fn sqrt(x: real) -> real {
    const MANTISSA: i32 = <digits>;
    const BIAS: i32 = <bias>;
    if !(x > 0.0 && x.is_finite()) {
        return if x >= 0.0 { x } else { real::NAN };
    }
    // a subnormal number is lifted by an even power of 2
    let subnormal = x < real::MIN_POSITIVE;
    let (lifted, lift) = if subnormal { (x * <lift>, MANTISSA + <odd>) } else { (x, 0) };
    let bits = lifted.to_bits();
    let exponent = (bits >> MANTISSA) as i32 - BIAS - lift;
    let mantissa = <wide>::from(bits & ((1 << MANTISSA) - 1) | (1 << MANTISSA));
    let half = exponent.div_euclid(2);
    let root = (mantissa << (MANTISSA + 2 + exponent.rem_euclid(2))).isqrt() as <bits>;
    // root stands in [2^(MANTISSA + 1), 2^(MANTISSA + 2)): its leading bit adds 1 to the exponent
    let rounded = (root >> 1) + (root & 1);
    real::from_bits((((half + BIAS - 1) as <bits>) << MANTISSA) + rounded)
}
"""


def files(program: Program) -> dict[str, str]:
    """The files of an export, by name."""
    return {
        "Cargo.toml": CARGO.format(name=program.name),
        "src/lib.rs": _library(program, program.written(RUST)),
        "src/vector.rs": _vector(program),
        "src/main.rs": _main(program),
    }


def _doc(text: str, mark: str) -> str:
    lines = [part for line in text.split("\n") for part in textwrap.wrap(line, 94) or [""]]
    return "\n".join(f"{mark} {line}".rstrip() for line in lines)


def _library(program: Program, text: Written) -> str:
    real = program.precision.rust
    fields = "\n".join(
        f"    /// {field.meaning[0].upper()}{field.meaning[1:]}.\n    pub {field.name}: {real},"
        for field in (*program.memory, *program.parameters)
    )
    values = "\n".join(
        f"            {field.name}: {RUST.literal(field.value, program.precision)},"
        for field in (*program.memory, *program.parameters)
    )
    kind = _type(program)
    what = "The memory" + (", and the parameters' values" if program.parameters else "")
    parts = [
        f"""\
{_doc(program.description, "//!")}

#![no_std]
#![forbid(unsafe_code)]
{_allowed(program)}
{STATUS}
/// {what}.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct {kind} {{
{fields}
}}

impl {kind} {{
    /// The initial memory{" and the parameters' values" if program.parameters else ""}.
    #[must_use]
    pub const fn new() -> Self {{
        Self {{
{values}
        }}
    }}
{_step(program, text)}}}

impl Default for {kind} {{
    fn default() -> Self {{
        Self::new()
    }}
}}
""",
        *_helpers(program, text),
    ]
    return "\n".join(parts)


def _allowed(program: Program) -> str:
    """The user's names stay as they are."""
    return "#![allow(non_snake_case)]\n" if any(w != w.lower() for w in order(program)) else ""


def _type(program: Program) -> str:
    return "".join(word.capitalize() for word in program.name.split("_"))


def _step(program: Program, text: Written) -> str:
    real = program.precision.rust
    places = dict(zip(program.inputs, ["t", "dt", *order(program)], strict=True))
    used = {places[key] for key in text.inputs}
    stored = [f.name for f in (*program.memory, *program.parameters) if f.name in used]
    idle = [word for word in ("t", "dt", *program.controls) if word not in used]
    given = [f"{word}: {real}" for word in (*program.samples, *program.controls, "t", "dt")]
    lines = [
        "",
        wrapped(
            "    /// ",
            f"Take {'the sample and the input' if program.controls else 'the sample'} "
            "at time t [s]; advance by dt [s].",
        ),
        f"    pub fn step(&mut self, {', '.join(given)}) -> Status {{",
    ]
    if stored:
        lines.append(wrapped("        let Self { ", f"{', '.join(stored)}, .. }} = *self;"))
    lines += [f"        let _ = {word};" for word in idle]
    lines += [wrapped(f"        let {name} = ", f"{value};") for name, value in text.steps]
    alone = len(set(text.outputs)) == 1
    finite = " && ".join(f"{real}::is_finite({value})" for value in dict.fromkeys(text.outputs))
    lines += [
        wrapped("        if !", f"{finite if alone else f'({finite})'} {{"),
        "            return Status::Undefined;",
        "        }",
    ]
    lines += [
        f"        self.{field.name} = {value};"
        for field, value in zip(program.memory, text.outputs, strict=True)
    ]
    present = " && ".join(f"{word}.is_finite()" for word in program.samples)
    lines += [
        wrapped("        ", f"if {present} {{ Status::Updated }} else {{ Status::Predicted }}"),
        "    }",
        "",
    ]
    return "\n".join(lines)


def _helpers(program: Program, text: Written) -> list[str]:
    precision = program.precision
    out = [
        HELPERS[kind].replace("real", precision.rust) for kind in text.functions if kind in HELPERS
    ]
    if "sqrt" in text.functions:
        double = precision.name == "double"
        root = ROOT.replace("real", precision.rust)
        for mark, wide, narrow in (
            ("<digits>", "52", "23"),
            ("<bias>", "1023", "127"),
            ("<lift>", "18_014_398_509_481_984.0", "33_554_432.0"),
            ("<odd>", "2", "2"),
            ("<wide>", "u128", "u64"),
            ("<bits>", "u64", "u32"),
        ):
            root = root.replace(mark, wide if double else narrow)
        out.append(root)
    wanted = [kind for kind in text.functions if kind not in HELPERS and kind != "sqrt"]
    return out + (_elementary(program, wanted) if wanted else [])


def _elementary(program: Program, wanted: list[str]) -> list[str]:
    """The core's own source of these functions, its macro's variables filled in."""
    known = Elementary.read(program.precision.name)
    consts, functions = known.needed(wanted)
    out = ["// Elementary functions: the source of hgo_rs itself.\n"]
    text = "\n".join([*(f.source for f in functions), *(c.source for c in consts)])
    used = [path for name, path in known.uses.items() if re.search(rf"\b{name}\b", text)]
    out += ["".join(f"use {path};\n" for path in used)] if used else []
    called = frozenset[str]().union(*(function.macros for function in functions))
    out += [macro.source + "\n" for name, macro in known.macros.items() if name in called]
    out += [const.source + "\n" for const in consts]
    for function in functions:
        doc = _doc(function.comment, "///") + "\n" if function.comment else ""
        source = textwrap.dedent("        " + function.source.removeprefix("pub(crate) "))
        out.append(doc + "\n".join(map(_broken, source.split("\n"))) + "\n")
    return out


def _broken(line: str) -> str:
    if len(line) <= 98:
        return line
    head = line[: len(line) - len(line.lstrip())]
    return wrapped(head, line.lstrip())


def _vector(program: Program) -> str:
    real = program.precision.rust

    def line(values: tuple[float, ...]) -> str:
        return ", ".join(RUST.literal(value, program.precision) for value in values)

    words = ", ".join((*program.samples, *program.controls, "t", "dt"))
    told = f"A test vector: what each step is given ({words}), its status, and the memory after it."
    given = len(program.vector[0].y) + len(program.vector[0].u) if program.vector else 1
    rows = [
        f"    ([{line((*row.y, *row.u, row.t, row.dt))}], {row.status}, [{line(row.memory)}]),"
        for row in program.vector
    ]
    return f"""\
{_doc(told, "//!")}

#[rustfmt::skip]
pub const VECTOR: &[([{real}; {given + 2}], u8, [{real}; {len(program.memory)}])] = &[
{chr(10).join(rows)}
];
"""


def _main(program: Program) -> str:
    name = program.name
    given = ", ".join((*program.samples, *program.controls, "t", "dt"))
    memory = ", ".join(f"state.{field.name}" for field in program.memory)
    words = ", ".join(f'"{field.name}"' for field in program.memory)
    return f"""\
//! Runs {name} over its test vector; prints OK, or the first difference.

mod vector;

use {name}::{_type(program)};
use std::process::ExitCode;

const NAMES: [&str; {len(program.memory)}] = [{words}];

fn main() -> ExitCode {{
    let mut state = {_type(program)}::new();
    for (k, ([{given}], status, expected)) in vector::VECTOR.iter().copied().enumerate() {{
        let made = state.step({given});
        if made as u8 != status {{
            println!("step {{k}}: {{made:?}}, expected status {{status}}");
            return ExitCode::FAILURE;
        }}
        let memory = [{memory}];
        for ((name, value), expected) in NAMES.iter().zip(memory).zip(expected) {{
            if value.to_bits() != expected.to_bits() {{
                println!("step {{k}}: {{name}} = {{value:e}}, expected {{expected:e}}");
                return ExitCode::FAILURE;
            }}
        }}
    }}
    println!("{name}: {{}} steps, every bit as expected: OK", vector::VECTOR.len());
    ExitCode::SUCCESS
}}
"""
