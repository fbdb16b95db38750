"""A program in Rust without `std` and dependencies: a crate with its test vector."""

from __future__ import annotations

import textwrap
from itertools import compress

from hgo_rs import _core
from hgo_rs.exports.expressions import RUST, Written
from hgo_rs.exports.held import TOLERANCE
from hgo_rs.exports.precision import PRECISIONS
from hgo_rs.exports.program import Gains, Program, wrapped
from hgo_rs.exports.traced import Move

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
<other>}
"""

OTHER_PERIOD = """\
    /// <time> is not <periods>: no sample was used.
    OtherPeriod = 3,
"""

ALLOWED = """\
// Names and numbers are the model's; operations stand as they were traced.
#![allow(non_snake_case)]
#![allow(clippy::approx_constant, clippy::disallowed_names, clippy::eq_op)]
#![allow(clippy::excessive_precision, clippy::too_many_arguments, clippy::unnecessary_cast)]
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
        "src/lib.rs": _library(program),
        "src/vector.rs": _vector(program),
        "src/main.rs": _main(program),
    }


def _doc(text: str, mark: str) -> str:
    lines = [part for line in text.split("\n") for part in textwrap.wrap(line, 94) or [""]]
    return "\n".join(f"{mark} {line}".rstrip() for line in lines)


def _fenced(description: str) -> str:
    """Equations and settings as they stand: a sign at a line's beginning makes no list."""
    first, _, rest = description.partition("\n")
    return f"{first}\n\n```text\n{rest.strip()}\n```"


def _library(program: Program) -> str:
    real = program.precision.rust
    traced = [*program.moves, *([program.start] if program.start else [])]
    texts = [program.written(move, RUST) for move in traced]
    fields = [
        f"{_doc(_sentence(field.meaning), '    ///')}\n    pub {field.name}: {real},"
        for field in (*program.memory, *program.parameters)
    ]
    values = [
        f"            {field.name}: {RUST.literal(field.value, program.precision)},"
        for field in (*program.memory, *program.parameters)
    ]
    for counter in program.counters:
        fields.append(f"    /// {_sentence(counter.meaning)}\n    pub {counter.name}: usize,")
        values.append(f"            {counter.name}: {counter.value:.0f},")
    if program.is_current:
        fields.append(
            f"    /// Whether a sample was taken.\n    pub {program.words.started}: bool,"
        )
        values.append(f"            {program.words.started}: false,")
    moves = zip(traced, texts, strict=True)
    functions = _count(program) + [_move(program, move, text) for move, text in moves]
    if program.is_current:
        functions.append(_both(program))
    kind = _type(program)
    what = "The memory" + (", and the parameters' values" if program.parameters else "")
    parts = [
        f"""\
{_doc(_fenced(program.description), "//!")}

#![no_std]
#![forbid(unsafe_code)]
{ALLOWED}
{_statuses(program)}
{"".join(_rows(program, gains) for gains in program.gains)}/// {what}.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct {kind} {{
{chr(10).join(fields)}
}}

impl {kind} {{
    /// The initial memory{" and the parameters' values" if program.parameters else ""}.
    #[must_use]
    pub const fn new() -> Self {{
        Self {{
{chr(10).join(values)}
        }}
    }}
{"".join(functions)}}}

impl Default for {kind} {{
    fn default() -> Self {{
        Self::new()
    }}
}}
""",
        *_helpers(program, list(dict.fromkeys(f for text in texts for f in text.functions))),
    ]
    return "\n".join(parts)


def _statuses(program: Program) -> str:
    if program.periods is None:
        return STATUS.replace("<other>", "")
    time = "The time since the last sample used" if program.is_current else "`dt`"
    other = OTHER_PERIOD.replace("<time>", time).replace("<periods>", program.told_periods)
    return STATUS.replace("<other>", other)


def _table(gains: Gains) -> str:
    return f"GAINS_{gains.held.number}" if gains.held.number else "GAINS"


def _rows(program: Program, gains: Gains) -> str:
    """The gains that are held."""
    rows = "\n".join(
        wrapped("    ", f"[{', '.join(RUST.literal(value, program.precision) for value in row)}],")
        for row in gains.rows
    )
    kind = f"[[{program.precision.rust}; {len(gains.columns)}]; {len(gains.rows)}]"
    doc = _doc(gains.told, "///")
    return f"{doc}\n#[rustfmt::skip]\nstatic {_table(gains)}: {kind} = [\n{rows}\n];\n\n"


def _count(program: Program) -> list[str]:
    """The function that counts periods."""
    if program.periods is None or program.counters:
        return []
    real, precision = program.precision.rust, program.precision
    dt, half, most, tolerance = (
        RUST.literal(value, precision)
        for value in (program.periods.dt, 0.5, program.periods.most + 0.5, TOLERANCE)
    )
    return [
        f"""
{_doc(program.told_count, "    ///")}
    #[must_use]
    pub fn periods(time: {real}) -> usize {{
        let counted = time / {dt};
        let among = counted > {half} && counted < {most};
        let nearest = if among {{ (counted + {half}) as usize }} else {{ 0 }};
        let apart = {real}::abs(counted - nearest as {real});
        if apart <= {tolerance} * counted {{ nearest }} else {{ 0 }}
    }}
"""
    ]


def _chosen(program: Program, gains: Gains) -> list[str]:
    """The row of the time that a correction is for."""
    table = _table(gains)
    row = f"        let {gains.row} = {table}.get({gains.periods}).unwrap_or(&{table}[0]);"
    if program.periods and gains.counter:
        known = f"{program.words.samples[gains.held.sample]}.is_finite()"
        known += f" && {gains.since} <= {program.periods.most}"
        return [
            f"        let {gains.since} = self.{gains.counter.name};",
            f"        let {gains.periods} = if {known} {{ {gains.since} }} else {{ 0 }};",
            row,
        ]
    time = "dt"
    if gains.held.elapsed is not None:
        sample = program.words.samples[gains.held.sample]
        elapsed = program.memory[gains.held.elapsed].name
        time = f"if {sample}.is_finite() {{ {elapsed} }} else {{ 0.0 }}"
    return [f"        let {gains.periods} = Self::periods({time});", row]


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _type(program: Program) -> str:
    return "".join(word.capitalize() for word in program.name.split("_"))


def _head(program: Program, verb: str, moves: tuple[Move, ...]) -> str:
    """Documentation and signature of a function."""
    # a time of hours in steps of milliseconds needs more digits than f32 has
    real, types = program.precision.rust, {"t": "f64"}
    given = [f"{word}: {types.get(word, real)}" for word in program.arguments(*moves)]
    told = _doc(program.told(verb), "    ///")
    head = f"    pub fn {verb}(&mut self{', ' if given else ''}"
    signature = wrapped(head, f"{', '.join(given)}) -> Status {{")
    return f"\n{told}\n{signature}"


def _move(program: Program, move: Move, text: Written) -> str:
    """A function that is one table."""
    real, places = program.precision.rust, program.places
    used = {places[name] for name in move.used}
    stored = [f.name for f in (*program.memory, *program.parameters) if f.name in used]
    lines = [_head(program, move.verb, (move,))]
    lines += ["        *self = Self::new();"] * (move is program.start)
    if stored:
        lines.append(wrapped("        let Self { ", f"{', '.join(stored)}, .. }} = *self;"))
    arguments = program.arguments(move)
    idle = [word for word in arguments if word not in used and word not in program.words.samples]
    lines += [f"        let _ = {word};" for word in idle]
    if "t" in used and text.inputs["t"] != "t":
        lines.append(f"        let {text.inputs['t']} = t as {real};")
    corrects = move is program.moves[0]
    for gains in program.gains if corrects else ():
        lines += _chosen(program, gains)
    most = program.periods.most if program.periods else 0
    for counter in () if corrects else program.counters:
        # one more than gains are held for stands for any more
        lines.append(f"        self.{counter.name} = (self.{counter.name} + 1).min({most + 1});")
    lines += [wrapped(f"        let {name} = ", f"{value};") for name, value in text.steps]
    asked = dict.fromkeys(compress(text.outputs, move.moving))
    alone = len(asked) == 1
    finite = " && ".join(f"{real}::is_finite({value})" for value in asked)
    lines.append(wrapped("        if !", f"{finite if alone else f'({finite})'} {{"))
    for i in program.elapsed if move.verb == "predict" else ():
        value = text.outputs[i]
        kept = f"self.{program.memory[i].name} = {value};"
        lines += (
            [
                f"            if {real}::is_finite({value}) {{",
                f"                {kept}",
                "            }",
            ]
            if move.moving[i]
            else [f"            {kept}"]
        )
    lines += ["            return Status::Undefined;", "        }"]
    lines += [
        f"        self.{field.name} = {value};"
        for field, value in zip(program.memory, text.outputs, strict=True)
        if field.name != value
    ]
    for gains in program.gains if corrects else ():
        if gains.counter:
            sample = program.words.samples[gains.held.sample]
            kept = f"if {sample}.is_finite() {{ 0 }} else {{ {gains.since} }}"
            lines.append(f"        self.{gains.counter.name} = {kept};")
    if move.verb == "correct":
        lines.append(f"        self.{program.words.started} = true;")
    if program.gains and corrects:
        refused = program.refused("{}.is_finite()", "0.0")
        refused = wrapped("        if ", f"{refused} {{")
        lines += [refused, "            return Status::OtherPeriod;", "        }"]
    if move.takes("y"):
        present = " && ".join(f"{word}.is_finite()" for word in program.words.samples)
        made = f"if {present} {{ Status::Updated }} else {{ Status::Predicted }}"
        lines.append(wrapped("        ", made))
    else:
        lines.append("        Status::Predicted")
    return "\n".join([*lines, "    }", ""])


def _both(program: Program) -> str:
    """The step of current timing: over the period that is over, then the sample."""
    correct, predict = program.moves
    dt = "dt" if program.fixed is None else RUST.literal(program.fixed, program.precision)
    end = f"t + {dt}" if program.precision.name == "double" else f"t + f64::from({dt})"
    sample = [end if word == "t" else word for word in program.arguments(correct)]
    call = f"self.predict({', '.join(program.arguments(predict))})"
    started = f"self.{program.words.started}"
    return "\n".join(
        [
            _head(program, "step", program.moves),
            *["        let _ = t;"] * (not any("t" in move.used for move in program.moves)),
            wrapped("        if ", f"{started} && {call} == Status::Undefined {{"),
            "            return Status::Undefined;",
            "        }",
            f"        self.correct({', '.join(sample)})",
            "    }",
            "",
        ]
    )


def _helpers(program: Program, functions: list[str]) -> list[str]:
    precision = program.precision
    out = [HELPERS[kind].replace("real", precision.rust) for kind in functions if kind in HELPERS]
    if "sqrt" in functions:
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
    wanted = [kind for kind in functions if kind not in HELPERS and kind != "sqrt"]
    if wanted:
        out.append("// Elementary functions, bit for bit those of hgo_rs.\n")
        out.append(_core.elementary_source("rust", precision.name, wanted))
    return out


def _vector(program: Program) -> str:
    real = program.precision.rust

    def line(values: tuple[float, ...]) -> str:
        return ", ".join(RUST.literal(value, program.precision) for value in values)

    words = ", ".join((*program.words.samples, *program.words.controls))
    told = f"What each step is given ({words}; t, dt), its status, and the memory after it."
    given = len(program.words.samples) + len(program.words.controls)
    rows = [
        f"    ([{line((*row.y, *row.u))}], {RUST.literal(row.t, PRECISIONS['double'])}, "
        f"{line((row.dt,))}, {row.status}, [{line(row.memory)}]),"
        for row in program.vector
    ]
    return f"""\
{_doc(told, "//!")}

#![allow(clippy::approx_constant, clippy::excessive_precision)]

/// Samples and inputs, t, dt, the status, the memory.
pub type Row = ([{real}; {given}], f64, {real}, u8, [{real}; {len(program.memory)}]);

#[rustfmt::skip]
pub static VECTOR: &[Row] = &[
{chr(10).join(rows)}
];
"""


def _main(program: Program) -> str:
    name = program.name
    places = [*program.words.samples, *program.words.controls]
    arguments = program.arguments(*program.moves)
    given = ", ".join(f"given[{places.index(w)}]" if w in places else w for w in arguments)
    t, dt = (word if word in arguments else "_" for word in ("t", "dt"))
    row = f"given, {t}, {dt}, status, expected"
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
    for (k, ({row})) in vector::VECTOR.iter().copied().enumerate() {{
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
