"""A table: a straight-line program, read and run by NumPy.

Registers are the inputs, then the results of calls, then the constants, then the result of each
operation, in order. A call is (function of a list of numbers, registers, number of results).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .error import Array, Spec, fail, known, member

KEYS = ("inputs", "calls", "constants", "ops", "outputs", "output_names")


def _sign(a: Array) -> Array:
    return np.where(a == 0.0, a, np.sign(a))  # of a zero itself, as in the core


def _pow(x: Array, p: Array) -> Array:
    """x^p for x >= 0; NaN for x < 0."""
    return np.where(x < 0.0, np.nan, np.abs(x) ** p)


OPERATIONS: dict[str, tuple[int, Callable[..., Any]]] = {
    "neg": (1, lambda a: -a),
    "abs": (1, np.abs),
    "sign": (1, _sign),
    "sqrt": (1, np.sqrt),
    "sin": (1, np.sin),
    "cos": (1, np.cos),
    "tan": (1, np.tan),
    "atan": (1, np.arctan),
    "exp": (1, np.exp),
    "log": (1, np.log),
    "tanh": (1, np.tanh),
    "add": (2, lambda a, b: a + b),
    "sub": (2, lambda a, b: a - b),
    "mul": (2, lambda a, b: a * b),
    "div": (2, lambda a, b: a / b),
    "min": (2, lambda a, b: np.where(b < a, b, a)),
    "max": (2, lambda a, b: np.where(b > a, b, a)),
    "pow": (2, _pow),
    "atan2": (2, np.arctan2),
    "lt": (2, lambda a, b: np.where(a < b, 1.0, 0.0)),
    "le": (2, lambda a, b: np.where(a <= b, 1.0, 0.0)),
    "eq": (2, lambda a, b: np.where(a == b, 1.0, 0.0)),
    "select": (3, lambda c, a, b: np.where(c != 0.0, a, b)),
}
"""Name -> number of operands, and what it does."""


class Table:
    """A table that has been looked through."""

    def __init__(self, spec: Spec, where: str) -> None:
        known(spec, where, KEYS)
        self.inputs = len(member(spec, "inputs", where))
        self.calls = list(spec.get("calls", ()))
        self.constants = [np.float64(value) for value in spec.get("constants", ())]
        self.rows: list[tuple[Callable[..., Any], Sequence[int]]] = []
        registers = self.inputs + sum(results for *_, results in self.calls) + len(self.constants)
        for i, (name, *operands) in enumerate(spec.get("ops", ())):
            if name not in OPERATIONS:
                names = ", ".join(OPERATIONS)
                raise fail(f"{where}.ops[{i}]", name, f"one of {names}", "correct the table")
            count, operation = OPERATIONS[name]
            if len(operands) != count or not all(0 <= r < registers for r in operands):
                allowed = f"{count} registers below {registers}"
                raise fail(f"{where}.ops[{i}]", operands, allowed, "correct the table")
            self.rows.append((operation, operands))
            registers += 1
        self.outputs = list(member(spec, "outputs", where))
        if not all(0 <= r < registers for r in self.outputs):
            raise fail(f"{where}.outputs", self.outputs, f"registers below {registers}", "correct")

    def __call__(self, inputs: Sequence[Any]) -> list[Any]:
        """The outputs for the inputs: numbers, or arrays of equal shape (runs,)."""
        registers: list[Any] = [*map(np.asarray, inputs)]
        for function, arguments, results in self.calls:
            given = np.broadcast_arrays(*(registers[r] for r in arguments))
            rows = [
                function([float(v) for v in row]) for row in zip(*map(np.ravel, given), strict=True)
            ]
            made = np.asarray(rows, dtype=float).T.reshape(results, *given[0].shape)
            registers += list(made)
        registers += self.constants
        for operation, operands in self.rows:
            registers.append(operation(*(registers[r] for r in operands)))
        return [registers[r] for r in self.outputs]
