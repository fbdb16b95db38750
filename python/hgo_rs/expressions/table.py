"""Compilation to a table: a straight-line program that the core evaluates.

A table is plain data, {"inputs", "constants", "ops", "outputs", "output_names"}: registers are the
inputs, then the constants, then the result of each operation; an operation names lower registers
only. Equal operations on equal registers are done once. Operations that use neither time, state
nor input (parameters and constants only) stand first. Within that, the order is the written one,
and each operation is the written one, but that x/4 is x*0.25, which is quicker and has the same
bits: no rounding differs from the text read from left to right.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from hgo_rs.expressions.errors import ExpressionError
from hgo_rs.expressions.nodes import Node, order

Register = tuple[str, int]  # ("input" | "constant" | "op", index)


def compile_table(
    roots: Sequence[Node],
    inputs: Mapping[str, str],
    output_names: Sequence[str],
    fixed: Sequence[str] = (),
) -> dict[str, Any]:
    """The table of the expressions ``roots``.

    Parameters
    ----------
    roots : expressions, one an output
    inputs : dict of symbol -> name of the input in the table, in order
    output_names : names of the outputs, one a root
    fixed : symbols that stand still over a run (parameters)

    Raises
    ------
    ExpressionError
        A symbol that is no input.
    """
    writer = _Writer(list(inputs), fixed)
    places: dict[Node, Register] = {}
    for node in order(roots):
        places[node] = writer.place(node, places)
    return {
        "inputs": list(inputs.values()),
        **writer.numbered([places[root] for root in roots]),
        "output_names": list(output_names),
    }


def _is_power_of_two(value: float) -> bool:
    """Whether 1/value is exact, in single precision too."""
    return math.isfinite(value) and abs(math.frexp(value)[0]) == 0.5 and 1e-30 < abs(value) < 1e30


class _Writer:
    """Collects constants and operations; numbers them at the end."""

    def __init__(self, symbols: Sequence[str], fixed: Sequence[str]) -> None:
        self.symbols = {name: i for i, name in enumerate(symbols)}
        self.still: set[Register] = {("input", self.symbols[name]) for name in fixed}
        self.constants: dict[str, tuple[Register, float]] = {}  # by bits: -0.0 is not 0.0
        self.ops: dict[tuple[str, tuple[Register, ...]], Register] = {}

    def place(self, node: Node, places: Mapping[Node, Register]) -> Register:
        """Where the value of ``node`` stands."""
        args = [places[arg] for arg in node.args]
        if node.op == "symbol":
            name = str(node.value)
            if name not in self.symbols:
                raise ExpressionError(f"{name} has no value: must be one of {list(self.symbols)}")
            return "input", self.symbols[name]
        if node.op == "constant":
            return self.constant(node.number)
        if node.op == "power":
            assert isinstance(node.value, int)
            return self.power(args[0], node.value)
        if node.op == "not":
            return self.op("sub", self.constant(1.0), args[0])
        if node.op == "div" and _is_power_of_two(node.args[1].number):
            return self.op("mul", args[0], self.constant(1.0 / node.args[1].number))
        return self.op({"and": "min", "or": "max"}.get(node.op, node.op), *args)

    def constant(self, value: float) -> Register:
        """A constant, once."""
        new = ("constant", len(self.constants))
        place, _ = self.constants.setdefault(value.hex(), (new, value))
        self.still.add(place)
        return place

    def op(self, name: str, *args: Register) -> Register:
        """An operation, once."""
        key = (name, args)
        if key not in self.ops:
            self.ops[key] = ("op", len(self.ops))
            if all(arg in self.still for arg in args):
                self.still.add(self.ops[key])
        return self.ops[key]

    def power(self, x: Register, exponent: int) -> Register:
        """x**3 = (x*x)*x, x**-2 = 1/(x*x)."""
        product = x
        for _ in range(abs(exponent) - 1):
            product = self.op("mul", product, x)
        return product if exponent > 0 else self.op("div", self.constant(1.0), product)

    def numbered(self, outputs: Sequence[Register]) -> dict[str, Any]:
        """Constants, operations and outputs with register numbers."""
        used = {arg for _, args in self.ops for arg in args} | set(outputs)
        constants = [pair for pair in self.constants.values() if pair[0] in used]
        n, c = len(self.symbols), len(constants)
        numbers: dict[Register, int] = {("input", i): i for i in range(n)}
        numbers |= {place: n + i for i, (place, _) in enumerate(constants)}
        early = [item for item in self.ops.items() if item[1] in self.still]
        late = [item for item in self.ops.items() if item[1] not in self.still]
        ops: list[list[Any]] = []
        for (name, args), place in early + late:
            numbers[place] = n + c + len(ops)
            ops.append([name, *(numbers[arg] for arg in args)])
        return {
            "constants": [value for _, value in constants],
            "ops": ops,
            "outputs": [numbers[place] for place in outputs],
        }
