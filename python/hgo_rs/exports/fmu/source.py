"""FMI's functions around an exported observer, in one C file."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from string import Template

from hgo_rs.exports.expressions import number
from hgo_rs.exports.fmu import fmi2, fmi3
from hgo_rs.exports.fmu.core import CORE, FUNCTIONS
from hgo_rs.exports.fmu.variables import Variable, Variables
from hgo_rs.exports.held import TOLERANCE
from hgo_rs.exports.program import Program, wrapped
from hgo_rs.exports.traced import Move

__all__ = ["Source", "source"]

OTHER = '"the time since the last sample used is not one that gains are held for"'


@dataclass(frozen=True)
class Source:
    """The text, and the token that says which description belongs to it."""

    text: str
    token: str


def source(program: Program, variables: Variables, version: str) -> Source:
    """NAME_fmu.c. Names in it that begin a line's own scope are none of the observer's: those are
    fields of its state, or have its name in front.
    """
    fmi = fmi2 if version == "2.0" else fmi3
    named = {
        "name": program.name,
        "up": program.name.upper(),
        "version": version,
        "major": version[0],
        "real": "double" if program.precision.name == "double" else "float",
        "numbers": len(variables.numbers),
        "samples": len(variables.samples),
        "declarations": fmi.DECLARATIONS,
        "settable": wrapped("", ", ".join(v.settable for v in variables.numbers)).replace(
            "\n", "\n    "
        ),
        "load": _lines(_loads(variables)),
        "unload": _lines(_unloads(variables)),
        "mirror": _lines(_mirrors(variables) or ["(void)m;"]),
        "advance": _lines(_advance(program, variables)),
        "fixed": _fixed(program),
        "other": OTHER,
    }
    for key in ("load", "unload"):
        named[key] = named[key].replace("(real)", f"({named['real']})")
    named |= fmi.WORDS
    text = CORE.safe_substitute(named) + FUNCTIONS.substitute(named) + fmi.OWN
    told = "\n".join((program.description, repr(variables), text))
    digest = hashlib.sha256(told.encode()).hexdigest()
    token = f"{{{digest[:8]}-{digest[8:12]}-{digest[12:16]}-{digest[16:20]}-{digest[20:32]}}}"
    return Source(Template(text).substitute(token=token), token)


def _fixed(program: Program) -> str:
    """A step of another length than the fixed one is refused."""
    if program.fixed is None:
        return ""
    length = number(program.fixed, program.precision)
    return f"""\
    if (fabs(dt - {length}) > {TOLERANCE!r} * {length}) {{
        refuse(of, "a step whose length is not {length} s, for which the observer was exported");
        return ERROR;
    }}
"""


def _lines(lines: Sequence[str]) -> str:
    return "\n".join(f"    {line}" for line in lines)


def _held(variables: Variables) -> list[tuple[int, Variable]]:
    """What the state of the observer holds, with its value references."""
    return [(i, v) for i, v in enumerate(variables.numbers) if v.field is not None]


def _loads(variables: Variables) -> list[str]:
    return [f"m->state.{v.field} = (real)m->number[{i}];" for i, v in _held(variables)]


def _unloads(variables: Variables) -> list[str]:
    return [f"m->number[{i}] = (double)m->state.{v.field};" for i, v in _held(variables)]


def _mirrors(variables: Variables) -> list[str]:
    first = 1 + len(variables.samples) + len(variables.controls)
    from_ = first + len(variables.memory)
    count = len(variables.corrected)
    return [f"m->number[{from_ + i}] = m->number[{first + i}];" for i in range(count)]


def _advance(program: Program, variables: Variables) -> list[str]:
    """The calls of the observer's functions."""
    if not program.is_current:
        return [f"m->status = {_call(program, program.moves, 'step')};"]
    correct, predict = program.moves
    count = len(variables.corrected)
    return [
        f"m->status = {_call(program, (correct,), correct.verb)};",
        *_unloads(variables)[:count],
        "mirror(m);",
        f"if ({_call(program, (predict,), predict.verb)} == {program.name.upper()}_UNDEFINED) {{",
        f"    m->status = {program.name.upper()}_UNDEFINED;",
        "}",
    ]


def _call(program: Program, moves: tuple[Move, ...], verb: str) -> str:
    """A call, its samples and inputs from the numbers."""
    words = (*program.words.samples, *program.words.controls)
    real = "double" if program.precision.name == "double" else "float"
    samples = len(program.words.samples)
    given = {
        word: f"({real}){f'sample(m, {i})' if i < samples else f'm->number[{1 + i}]'}"
        for i, word in enumerate(words)
    }
    given |= {"t": "t", "dt": f"({real})dt"}
    arguments = ", ".join(["state", *(given[word] for word in program.arguments(*moves))])
    return f"{program.name}_{verb}({arguments})"
