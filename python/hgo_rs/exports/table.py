"""Tables: straight-line programs, as the core traces them, and their values.

A table is a dict of inputs (names), constants, ops (a word and the registers it works on) and
outputs (registers). Registers are the inputs, then the constants, then the results of the ops.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hgo_rs.errors import HgoError
from hgo_rs.exports.elementary import PRECISIONS, Elementary

__all__ = ["FUNCTIONS", "Graph", "Term", "evaluate", "graph"]

FUNCTIONS = {
    **{name: name for name in ("sin", "cos", "tan", "atan", "atan2", "exp", "tanh")},
    "log": "ln",
    "pow": "powf",
}
"""Ops that are elementary functions, and their names in the core."""

_OPERANDS = {
    **dict.fromkeys(("neg", "abs", "sign", "sqrt", "sin", "cos", "tan", "atan", "exp", "log"), 1),
    **dict.fromkeys(("add", "sub", "mul", "div", "min", "max", "pow", "atan2"), 2),
    **dict.fromkeys(("lt", "le", "eq", "innovation", "copysign"), 2),
    "tanh": 1,
    "select": 3,
}


@dataclass(frozen=True)
class Term:
    """One value: kind "input" (`name`), "constant" (`value`) or an op on earlier terms."""

    kind: str
    parts: tuple[int, ...] = ()
    name: str = ""
    value: float = 0.0


@dataclass(frozen=True)
class Graph:
    """The live part of a table: equal values once, constants of the chosen precision."""

    terms: list[Term]
    outputs: list[int]

    def uses(self) -> list[int]:
        """How many terms and outputs use each term."""
        counts = [0] * len(self.terms)
        for term in self.terms:
            for part in term.parts:
                counts[part] += 1
        for output in self.outputs:
            counts[output] += 1
        return counts


def graph(table: Mapping[str, Any], precision: str) -> Graph:
    """A table without what is not used, what is there twice, and what changes no bit.

    x * 1, x / 1, x + (-0) and x - 0 are x, bit for bit.

    Raises
    ------
    HgoError
        An op that is not known; an operand that is not an earlier register.
    """
    real = PRECISIONS[precision].real
    terms: list[Term] = []
    place: dict[tuple[Any, ...], int] = {}

    def term(new: Term) -> int:
        # 0 and -0 are two constants, and NaN is one
        same = (new.kind, new.parts, new.name, float(new.value).hex())
        if same not in place:
            place[same] = len(terms)
            terms.append(new)
        return place[same]

    registers = [term(Term("input", name=name)) for name in table["inputs"]]
    registers += [term(Term("constant", value=float(real(c)))) for c in table["constants"]]

    def is_constant(index: int, value: float) -> bool:
        found = terms[index]
        same_sign = np.signbit(found.value) == np.signbit(value)
        return bool(found.kind == "constant" and found.value == value and same_sign)

    for number, (op, *operands) in enumerate(table["ops"]):
        if _OPERANDS.get(op) != len(operands):
            raise HgoError(f"table: op {number} is {op!r} on {len(operands)} registers: not known")
        if not all(0 <= register < len(registers) for register in operands):
            raise HgoError(f"table: op {number} uses a register that is not an earlier one")
        parts = tuple(registers[register] for register in operands)
        a, b = parts[0], parts[-1]
        if (op in ("mul", "div") and is_constant(b, 1.0)) or (op == "sub" and is_constant(b, 0.0)):
            registers.append(a)
        elif op == "mul" and is_constant(a, 1.0):
            registers.append(b)
        elif op == "add" and is_constant(b, -0.0):
            registers.append(a)
        elif op == "add" and is_constant(a, -0.0):
            registers.append(b)
        else:
            registers.append(term(Term(op, parts)))
    return _live(Graph(terms, [registers[output] for output in table["outputs"]]))


def _live(whole: Graph) -> Graph:
    """What the outputs need."""
    needed = set(whole.outputs)
    for index in range(len(whole.terms) - 1, -1, -1):
        if index in needed:
            needed.update(whole.terms[index].parts)
    kept = sorted(needed)
    moved = {old: new for new, old in enumerate(kept)}
    terms = [
        Term(t.kind, tuple(moved[part] for part in t.parts), t.name, t.value)
        for t in (whole.terms[index] for index in kept)
    ]
    return Graph(terms, [moved[output] for output in whole.outputs])


def evaluate(
    table: Mapping[str, Any], inputs: Sequence[float], precision: str = "double"
) -> list[Any]:
    """The outputs of a table, each operation rounded once, with the core's elementary functions.

    Parameters
    ----------
    inputs : sequence of float
        Values of the table's inputs, in order.
    precision : "double" or "single"
        Inputs, constants and every operation are of this precision.
    """
    elementary = Elementary.read(precision)
    real = PRECISIONS[precision].real
    registers = [real(value) for value in (*inputs, *table["constants"])]
    with np.errstate(all="ignore"):
        for op, *operands in table["ops"]:
            values = [registers[register] for register in operands]
            if op in FUNCTIONS:
                registers.append(elementary.call(FUNCTIONS[op], *values))
            else:
                registers.append(real(_OPERATIONS[op](*values)))
    return [registers[output] for output in table["outputs"]]


def _sign(x: Any) -> Any:
    return x * 0 if x == 0 else x if np.isnan(x) else np.copysign(1.0, x)


_OPERATIONS: dict[str, Any] = {
    "neg": lambda a: -a,
    "abs": np.abs,
    "sign": _sign,
    "sqrt": np.sqrt,
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "copysign": np.copysign,
    "min": lambda a, b: b if b < a else a,
    "max": lambda a, b: b if b > a else a,
    "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b,
    "eq": lambda a, b: a == b,
    "select": lambda c, a, b: a if c != 0 else b,
    "innovation": lambda y, x: y - x if np.isfinite(y) else 0.0,
}
