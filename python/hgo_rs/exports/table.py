"""Tables: straight-line programs, as the core traces them.

A table is a dict of inputs (names), constants, ops (a word and the registers it works on) and
outputs (registers). Registers are the inputs, then the constants, then the results of the ops.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hgo_rs.errors import HgoError
from hgo_rs.exports.precision import PRECISIONS

__all__ = ["FUNCTIONS", "Graph", "Term", "graph"]

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
    """One value: kind "input" (`name`), "constant" (`value`), "present" (the samples are there) or
    an op on earlier terms.
    """

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


def graph(
    table: Mapping[str, Any],
    precision: str,
    *,
    missing: Mapping[str, Any] | None = None,
    samples: Sequence[str] = (),
    constant: Mapping[str, float] | None = None,
) -> Graph:
    """A table without what is not used, what is there twice, and what changes no bit.

    x * 1, x / 1, x + (-0), x - 0 and a choice between x and x are x, bit for bit. With `missing`,
    the outputs are that table's where one of the inputs `samples` is not finite. The inputs named
    in `constant` have these values.

    Raises
    ------
    HgoError
        An op that is not known; an operand that is not an earlier register.
    """
    pool = _Pool(precision, constant or {})
    outputs = pool.add(table)
    if missing is not None:
        inputs = tuple(pool.term(Term("input", name=name)) for name in samples)
        present = pool.term(Term("present", inputs))
        pairs = zip(outputs, pool.add(missing), strict=True)
        outputs = [
            used if used == held else pool.term(Term("select", (present, used, held)))
            for used, held in pairs
        ]
    return _live(Graph(pool.terms, outputs))


class _Pool:
    """Terms, each once."""

    def __init__(self, precision: str, constant: Mapping[str, float]) -> None:
        self.real = PRECISIONS[precision].real
        self.constant = constant
        self.terms: list[Term] = []
        self.place: dict[tuple[Any, ...], int] = {}

    def term(self, new: Term) -> int:
        # 0 and -0 are two constants, and NaN is one
        same = (new.kind, new.parts, new.name, float(new.value).hex())
        if same not in self.place:
            self.place[same] = len(self.terms)
            self.terms.append(new)
        return self.place[same]

    def is_constant(self, index: int, value: float) -> bool:
        found = self.terms[index]
        same_sign = np.signbit(found.value) == np.signbit(value)
        return bool(found.kind == "constant" and found.value == value and same_sign)

    def add(self, table: Mapping[str, Any]) -> list[int]:
        """The outputs of a table."""
        constants = [float(self.real(value)) for value in table["constants"]]
        registers = [self.input(name) for name in table["inputs"]]
        registers += [self.term(Term("constant", value=value)) for value in constants]
        for number, (op, *operands) in enumerate(table["ops"]):
            if _OPERANDS.get(op) != len(operands):
                told = f"op {number} is {op!r} on {len(operands)} registers: not known"
                raise HgoError(f"table: {told}")
            if not all(0 <= register < len(registers) for register in operands):
                raise HgoError(f"table: op {number} uses a register that is not an earlier one")
            registers.append(self.op(op, tuple(registers[register] for register in operands)))
        return [registers[output] for output in table["outputs"]]

    def input(self, name: str) -> int:
        if name in self.constant:
            return self.term(Term("constant", value=self.constant[name]))
        return self.term(Term("input", name=name))

    def op(self, op: str, parts: tuple[int, ...]) -> int:
        a, b = parts[0], parts[-1]
        if op in ("mul", "div") and self.is_constant(b, 1.0):
            return a
        if op == "select" and parts[1] == b:
            return b
        if op == "sub" and self.is_constant(b, 0.0):
            return a
        if op == "add" and self.is_constant(b, -0.0):
            return a
        if op == "mul" and self.is_constant(a, 1.0):
            return b
        if op == "add" and self.is_constant(a, -0.0):
            return b
        return self.term(Term(op, parts))


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
