"""The functions and constants that an expression may use: one table for strings, callables, SymPy.

- pi is known; e is not (it is a common name of an error): write exp(1).
- sign(0) = 0. pow(x, p) and x**p with an integer p are multiplications and take any x; with any
  other p they are NaN for x < 0.
- saturate(x, low, high) = min(max(x, low), high).
- piecewise(value, condition, ..., default): the value of the first condition that holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

from hgo_rs.expressions import nodes
from hgo_rs.expressions.errors import ExpressionError
from hgo_rs.expressions.nodes import Node, function


@dataclass(frozen=True)
class Function:
    """A function: how it is written, how many arguments it takes, what it makes of them."""

    signature: str
    build: Callable[..., Node]
    least: int
    most: int | None

    def __call__(self, *args: Node) -> Node:
        """The node; ExpressionError for a wrong number of arguments."""
        self.check(len(args))
        return self.build(*args)

    def check(self, count: int) -> None:
        """Refuse a wrong number of arguments."""
        if count < self.least or (self.most is not None and count > self.most):
            raise ExpressionError(
                f"{count} argument{'' if count == 1 else 's'} given: must be {self._wanted()}; "
                f"write {self.signature}"
            )

    def _wanted(self) -> str:
        if self.most is None:
            return f"at least {self.least}"
        return str(self.least)


def _plain(op: str, signature: str, count: int = 1) -> Function:
    return Function(signature, lambda *args: function(op, *args), count, count)


def _fold(op: str) -> Callable[..., Node]:
    return lambda *args: reduce(lambda a, b: function(op, a, b), args)


def _saturate(x: Node, low: Node, high: Node) -> Node:
    return function("min", function("max", x, low), high)


def _piecewise(*args: Node) -> Node:
    if len(args) % 2 == 0:
        raise ExpressionError(
            f"{len(args)} arguments given: must be pairs and a last value that holds otherwise; "
            "write piecewise(value, condition, ..., default)"
        )
    result = args[-1]
    for i in range(len(args) - 3, -1, -2):
        result = nodes.select(args[i + 1], args[i], result)
    return result


FUNCTIONS: dict[str, Function] = {
    "abs": _plain("abs", "abs(x)"),
    "sign": _plain("sign", "sign(x)"),
    "min": Function("min(a, b, ...)", _fold("min"), 2, None),
    "max": Function("max(a, b, ...)", _fold("max"), 2, None),
    "saturate": Function("saturate(x, low, high)", _saturate, 3, 3),
    "piecewise": Function("piecewise(value, condition, ..., default)", _piecewise, 3, None),
    "sin": _plain("sin", "sin(x)"),
    "cos": _plain("cos", "cos(x)"),
    "tan": _plain("tan", "tan(x)"),
    "atan": _plain("atan", "atan(x)"),
    "atan2": _plain("atan2", "atan2(y, x)", 2),
    "exp": _plain("exp", "exp(x)"),
    "log": _plain("log", "log(x)"),
    "sqrt": _plain("sqrt", "sqrt(x)"),
    "tanh": _plain("tanh", "tanh(x)"),
    "pow": Function("pow(x, p)", nodes.power, 2, 2),
}

SUBSTITUTES: dict[str, str] = {
    "asin": "atan2(x, sqrt(1 - x**2))",
    "acos": "atan2(sqrt(1 - x**2), x)",
    "arcsin": "atan2(x, sqrt(1 - x**2))",
    "arccos": "atan2(sqrt(1 - x**2), x)",
    "arctan": "atan(x)",
    "sinh": "(exp(x) - exp(-x))/2",
    "cosh": "(exp(x) + exp(-x))/2",
    "atanh": "log((1 + x)/(1 - x))/2",
    "log10": "log(x)/log(10)",
    "log2": "log(x)/log(2)",
    "clip": "saturate(x, low, high)",
    "sat": "saturate(x, low, high)",
    "clamp": "saturate(x, low, high)",
}
"""What to write for functions that other languages have."""

CONSTANTS: dict[str, float] = {"pi": math.pi}

RESERVED = frozenset({*FUNCTIONS, *CONSTANTS, "and", "or", "not"})
"""Names that a state, an input or a parameter cannot have."""
