"""A program in C99: NAME.h, NAME.c, a test vector, a demonstration and a Makefile."""

from __future__ import annotations

import textwrap
from itertools import compress

from hgo_rs import _core
from hgo_rs.exports.expressions import C, Written
from hgo_rs.exports.held import TOLERANCE
from hgo_rs.exports.precision import PRECISIONS
from hgo_rs.exports.program import Gains, Program, wrapped
from hgo_rs.exports.traced import Move

__all__ = ["files"]

GUARD = """\
#if {mantissa}
#error "{real} is not of {width} bits here: export in the precision that this compiler has"
#endif
#if defined(__FAST_MATH__) || defined(_M_FP_FAST) || (__FINITE_MATH_ONLY__ + 0)
#error "compile without -ffast-math: every operation is meant as it stands"
#endif
#if FLT_EVAL_METHOD != 0 && FLT_EVAL_METHOD != 16
#error "compile for arithmetic that rounds every operation to its type (on x86: -mfpmath=sse)"
#endif
/* No product and sum in one rounding. GCC does not know the pragma of the standard. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC optimize("fp-contract=off")
#else
#pragma STDC FP_CONTRACT OFF
#endif
"""

MAKEFILE = """\
# make test: compile the demonstration and run it over the test vector.
CC ?= cc
CFLAGS ?= -O2
FLAGS = -std=c99 -Wall -Wextra -ffp-contract=off

test: {name}_test
\t./{name}_test

{name}_test: main.c {name}.c {name}.h {name}_vector.h
\t$(CC) $(FLAGS) $(CFLAGS) main.c {name}.c -lm -o $@

clean:
\trm -f {name}_test

.PHONY: test clean
"""


def files(program: Program) -> dict[str, str]:
    """The files of an export, by name."""
    name = program.name
    return {
        f"{name}.h": _header(program),
        f"{name}.c": _source(program),
        f"{name}_vector.h": _vector(program),
        "main.c": _main(program),
        "Makefile": MAKEFILE.format(name=name),
    }


def _real(program: Program) -> str:
    return "double" if program.precision.name == "double" else "float"


def _comment(text: str, indent: str = "") -> str:
    """A comment of one line or more."""
    plain = text.replace("*/", "* /").replace("/*", "/ *")
    lines = [part for line in plain.split("\n") for part in textwrap.wrap(line, 94) or [""]]
    if len(lines) == 1:
        return f"{indent}/* {lines[0]} */"
    return (
        "\n".join(
            [f"{indent}/* {lines[0]}", *(f"{indent} * {line}".rstrip() for line in lines[1:])]
        )
        + " */"
    )


def _signature(program: Program, verb: str, moves: tuple[Move, ...]) -> str:
    name, real = program.name, _real(program)
    # a time of hours in steps of milliseconds needs more digits than a float has
    types = {"t": "double"}
    given = [f"{types.get(word, real)}\0{word}" for word in program.arguments(*moves)]
    words = ", ".join([f"{name}_state\0*state", *given])
    line = wrapped(f"int {name}_{verb}(", f"{words})")
    return line.replace("\0", " ")


def _header(program: Program) -> str:
    name, real = program.name, _real(program)
    fields = [f"    {real} {f.name}; {_comment(f.meaning)}" for f in program.memory]
    fields += [f"    {real} {f.name}; {_comment(f.meaning)}" for f in program.parameters]
    fields += [f"    int {f.name}; {_comment(f.meaning)}" for f in program.counters]
    if program.is_current:
        fields.append(f"    int {program.words.started}; {_comment('0 until the first sample')}")
    codes = ",\n".join(
        f"    {name.upper()}_{code} = {i}" for i, code in enumerate(program.statuses)
    )
    functions = "\n\n".join(
        f"{_comment(told)}\n{_signature(program, verb, moves)};"
        for verb, moves, told in _functions(program)
    )
    if program.is_current:
        functions += f"\n\n{_comment(_loop(program))}"
    if program.periods is not None and not program.counters:
        functions += f"\n\n{_comment(program.told_count)}\n{_count(program)};"
    return f"""\
{_comment(program.description)}

#ifndef HGO_{name.upper()}_H
#define HGO_{name.upper()}_H

#ifdef __cplusplus
extern "C" {{
#endif

{_comment(_told_codes(program))}
enum {{
{codes}
}};

typedef struct {{
{chr(10).join(fields)}
}} {name}_state;

/* The initial memory{" and the parameters' values" if program.parameters else ""}. */
void {name}_init({name}_state *state);

{functions}

#ifdef __cplusplus
}}
#endif

#endif
"""


def _told_codes(program: Program) -> str:
    used = "What a call made of its sample: used it; predicted over a missing one (NaN or infinite)"
    kept = "the model has no finite value there, and the estimate was kept"
    if program.periods is None:
        return f"{used}; or {kept}."
    time = "the time since the last sample used" if program.is_current else "dt"
    return f"{used}; {kept}; or {time} is not {program.told_periods}, and no sample was used."


def _count(program: Program) -> str:
    """Signature of the function that counts periods."""
    return f"int {program.name}_periods({_real(program)} time)"


def _loop(program: Program) -> str:
    """An interrupt, in a comment."""
    correct, predict = program.moves
    name, controls = program.name, program.words.controls
    calls = [", ".join(["&state", *program.arguments(move)]) for move in (correct, predict)]
    them = "it" if len(controls) == 1 else "them"
    first = f"state.{program.memory[0].name}"
    computed = [f"compute {', '.join(controls)} from {first}, ...; apply {them};"] * bool(controls)
    lines = [f"{name}_correct({calls[0]});", *computed, f"{name}_predict({calls[1]});"]
    return "In an interrupt, at every sample:\n" + "\n".join(f"    {line}" for line in lines)


def _functions(program: Program) -> list[tuple[str, tuple[Move, ...], str]]:
    """Verbs, the moves that they are made of, and what they do."""
    parts = {move.verb: (move,) for move in program.moves}
    start = {"start": (program.start,)} if program.start else {}
    whole = {"step": program.moves} if program.is_current else {}
    return [
        (verb, moves, program.told(verb)) for verb, moves in {**start, **parts, **whole}.items()
    ]


def _source(program: Program) -> str:
    name = program.name
    moves = [*program.moves, *([program.start] if program.start else [])]
    texts = [program.written(move, C) for move in moves]
    helpers = _helpers(program, list(dict.fromkeys(f for text in texts for f in text.functions)))
    double = _real(program) == "double"
    guard = (
        GUARD.replace("{mantissa}", "DBL_MANT_DIG != 53" if double else "FLT_MANT_DIG != 24")
        .replace("{real}", _real(program))
        .replace("{width}", str(program.precision.width))
    )
    parts = [_comment(f"{name}: see {name}.h."), f'#include "{name}.h"\n', _includes(helpers)]
    parts += [guard, *helpers]
    values = [
        f"    state->{f.name} = {C.literal(f.value, program.precision)};"
        for f in (*program.memory, *program.parameters)
    ]
    values += [f"    state->{f.name} = {f.value:.0f};" for f in program.counters]
    if program.is_current:
        values.append(f"    state->{program.words.started} = 0;")
    parts.append(f"void {name}_init({name}_state *state)\n{{\n" + "\n".join(values) + "\n}\n")
    parts += _held(program)
    parts += [_move(program, move, text) for move, text in zip(moves, texts, strict=True)]
    if program.is_current:
        parts.append(_both(program))
    return "\n".join(parts)


def _includes(helpers: list[str]) -> str:
    words = ["float", "math"]
    if any("memcpy" in helper for helper in helpers):
        words += ["stdint", "string"]
    return "".join(f"#include <{word}.h>\n" for word in words)


def _held(program: Program) -> list[str]:
    """The gains that are held, and which of them are for a time."""
    if program.periods is None:
        return []
    rows = [_rows(program, gains) for gains in program.gains]
    if program.counters:
        return rows
    real, precision = _real(program), program.precision
    fabs = "fabs" if real == "double" else "fabsf"
    dt, half, least, most, tolerance = (
        C.literal(value, precision)
        for value in (program.periods.dt, 0.5, 0.5, program.periods.most + 0.5, TOLERANCE)
    )
    count = f"""\
{_count(program)}
{{
    const {real} counted = time / {dt};
    const int nearest = counted > {least} && counted < {most} ? (int)(counted + {half}) : 0;
    return {fabs}(counted - ({real})nearest) <= {tolerance} * counted ? nearest : 0;
}}
"""
    return [*rows, count]


def _rows(program: Program, gains: Gains) -> str:
    rows = ",\n".join(
        wrapped("    ", f"{{{', '.join(C.literal(value, program.precision) for value in row)}}}")
        for row in gains.rows
    )
    size = f"[{len(gains.rows)}][{len(gains.columns)}]"
    head = f"static const {_real(program)} {_table(program, gains)}{size} = {{"
    return f"{_comment(gains.told)}\n{head}\n{rows},\n}};\n"


def _table(program: Program, gains: Gains) -> str:
    number = f"_{gains.held.number}" if gains.held.number else ""
    return f"{program.name}_gains{number}"


def _chosen(program: Program, gains: Gains) -> list[str]:
    """The row of the time that a correction is for."""
    real, zero = _real(program), C.literal(0.0, program.precision)
    if program.periods and gains.counter:
        known = f"isfinite({program.words.samples[gains.held.sample]})"
        known += f" && {gains.since} <= {program.periods.most}"
        return [
            f"    const int {gains.since} = state->{gains.counter.name};",
            f"    const int {gains.periods} = {known} ? {gains.since} : 0;",
            f"    const {real} *const {gains.row} = {_table(program, gains)}[{gains.periods}];",
        ]
    time = "dt"
    if gains.held.elapsed is not None:
        sample = program.words.samples[gains.held.sample]
        time = f"isfinite({sample}) ? {program.memory[gains.held.elapsed].name} : {zero}"
    table = f"{_table(program, gains)}[{gains.periods}]"
    return [
        f"    const int {gains.periods} = {program.name}_periods({time});",
        f"    const {real} *const {gains.row} = {table};",
    ]


def _move(program: Program, move: Move, text: Written) -> str:
    """A function that is one table."""
    real, up, places = _real(program), program.name.upper(), program.places
    used = {places[name] for name in move.used}
    arguments = program.arguments(move)
    stored = (*program.memory, *program.parameters)
    lines = [_signature(program, move.verb, (move,)), "{"]
    lines += [f"    {program.name}_init(state);"] * (move is program.start)
    lines += [f"    const {real} {f.name} = state->{f.name};" for f in stored if f.name in used]
    if "t" in used and text.inputs["t"] != "t":
        lines.append(f"    const {real} {text.inputs['t']} = ({real})t;")
    corrects = move is program.moves[0]
    for gains in program.gains if corrects else ():
        lines += _chosen(program, gains)
    most = program.periods.most if program.periods else 0
    for counter in () if corrects else program.counters:
        count = f"state->{counter.name}"  # one more than gains are held for stands for any more
        lines.append(wrapped(f"    {count} = ", f"{count} > {most} ? {count} : {count} + 1;"))
    lines += [wrapped(f"    const {real} {name} = ", f"{value};") for name, value in text.steps]
    idle = [word for word in arguments if word not in used and word not in program.words.samples]
    lines += [f"    (void){word};" for word in idle]
    asked = dict.fromkeys(compress(text.outputs, move.moving))
    alone = len(asked) == 1
    finite = " && ".join(f"isfinite({value})" for value in asked)
    lines.append(wrapped("    if (!", f"{finite if alone else f'({finite})'}) {{"))
    for i in program.elapsed if move.verb == "predict" else ():
        value = text.outputs[i]
        kept = f"state->{program.memory[i].name} = {value};"
        lines += (
            [f"        if (isfinite({value})) {{", f"            {kept}", "        }"]
            if move.moving[i]
            else [f"        {kept}"]
        )
    lines += [f"        return {up}_UNDEFINED;", "    }"]
    lines += [
        f"    state->{field.name} = {value};"
        for field, value in zip(program.memory, text.outputs, strict=True)
        if field.name != value
    ]
    for gains in program.gains if corrects else ():
        if gains.counter:
            sample = program.words.samples[gains.held.sample]
            kept = f"isfinite({sample}) ? 0 : {gains.since}"
            lines.append(f"    state->{gains.counter.name} = {kept};")
    if move.verb == "correct":
        lines.append(f"    state->{program.words.started} = 1;")
    if program.gains and corrects:
        refused = program.refused("isfinite({})", C.literal(0.0, program.precision))
        refused = wrapped("    if (", f"{refused}) {{")
        lines += [refused, f"        return {up}_OTHER_PERIOD;", "    }"]
    if move.takes("y"):
        present = " && ".join(f"isfinite({word})" for word in program.words.samples)
        lines.append(wrapped("    return ", f"{present} ? {up}_UPDATED : {up}_PREDICTED;"))
    else:
        lines.append(f"    return {up}_PREDICTED;")
    return "\n".join([*lines, "}", ""])


def _both(program: Program) -> str:
    """The step of current timing: over the period that is over, then the sample."""
    name, up = program.name, program.name.upper()
    correct, predict = program.moves
    dt = "dt" if program.fixed is None else C.literal(program.fixed, program.precision)
    end = f"t + {dt}" if program.precision.name == "double" else f"t + (double){dt}"
    sample = [end if word == "t" else word for word in program.arguments(correct)]
    call = f"{name}_predict({', '.join(['state', *program.arguments(predict)])})"
    return "\n".join(
        [
            _signature(program, "step", program.moves),
            "{",
            *["    (void)t;"] * (not any("t" in move.used for move in program.moves)),
            wrapped("    if (", f"state->{program.words.started} && {call} == {up}_UNDEFINED) {{"),
            f"        return {up}_UNDEFINED;",
            "    }",
            f"    return {name}_correct(state, {', '.join(sample)});",
            "}",
            "",
        ]
    )


# --- functions that the step calls ------------------------------------------------------------

_PLAIN = {
    "min": "(real a, real b)\n{\n    return b < a ? b : a;\n}\n",
    "max": "(real a, real b)\n{\n    return b > a ? b : a;\n}\n",
    "sign": "(real a)\n{\n    return a > 0 ? 1 : a < 0 ? -1 : a;\n}\n",
}


def _helpers(program: Program, functions: list[str]) -> list[str]:
    name, real = program.name, _real(program)
    out = [
        f"static {real} {name}_{kind}" + _PLAIN[kind].replace("real", real)
        for kind in functions
        if kind in _PLAIN
    ]
    wanted = [kind for kind in functions if kind not in _PLAIN]
    if wanted:
        out.append(_comment("Elementary functions, bit for bit those of hgo_rs.") + "\n")
        out.append(_core.elementary_source("c", program.precision.name, wanted, name))
    return out


# --- test vector and demonstration ------------------------------------------------------------


def _vector(program: Program) -> str:
    name, real = program.name, _real(program)
    words = [*program.words.samples, *program.words.controls]

    def line(values: tuple[float, ...]) -> str:
        return ", ".join(C.literal(value, program.precision) for value in values)

    rows = [
        f"    {{{{{line((*row.y, *row.u))}}}, {C.literal(row.t, PRECISIONS['double'])}, "
        f"{line((row.dt,))}, {row.status}, {{{line(row.memory)}}}}},"
        for row in program.vector
    ]
    given = ", ".join(words)
    told = f"What each step is given ({given}; t, dt), its status, and the memory after it."
    return f"""\
{_comment(told)}

#include <math.h>

struct {name}_row {{
    {real} given[{len(words)}];
    double t;
    {real} dt;
    int status;
    {real} memory[{len(program.memory)}];
}};

static const struct {name}_row {name}_vector[] = {{
{chr(10).join(rows)}
}};
"""


def _main(program: Program) -> str:
    name, real = program.name, _real(program)
    places = [*program.words.samples, *program.words.controls]
    given = ", ".join(
        f"row.given[{places.index(word)}]" if word in places else f"row.{word}"
        for word in program.arguments(*program.moves)
    )
    memory = ", ".join(f"state.{field.name}" for field in program.memory)
    words = ", ".join(f'"{field.name}"' for field in program.memory)
    digits = 17 if real == "double" else 9
    return f"""\
{_comment(f"Runs {name} over its test vector; prints OK, or the first difference.")}

#include "{name}.h"
#include "{name}_vector.h"

#include <stdio.h>
#include <string.h>

enum {{ STEPS = sizeof {name}_vector / sizeof {name}_vector[0], MEMORY = {len(program.memory)} }};

static const char *const names[MEMORY] = {{{words}}};

int main(void)
{{
    {name}_state state;
    int k, i;

    {name}_init(&state);
    for (k = 0; k < STEPS; ++k) {{
        const struct {name}_row row = {name}_vector[k];
        const int status = {name}_step(&state, {given});
        const {real} memory[MEMORY] = {{{memory}}};

        if (status != row.status) {{
            printf("step %d: status %d, expected %d\\n", k, status, row.status);
            return 1;
        }}
        for (i = 0; i < MEMORY; ++i) {{
            if (memcmp(&memory[i], &row.memory[i], sizeof memory[i]) != 0) {{
                printf("step %d: %s = %.{digits}g, expected %.{digits}g\\n", k, names[i],
                       (double)memory[i], (double)row.memory[i]);
                return 1;
            }}
        }}
    }}
    printf("{name}: %d steps, every bit as expected: OK\\n", STEPS);
    return 0;
}}
"""
