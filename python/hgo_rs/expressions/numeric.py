"""Evaluation by NumPy, vectorised; it knows nothing of tables and of the core."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.expressions.errors import ExpressionError
from hgo_rs.expressions.nodes import Node, order

Array = npt.NDArray[Any]


def _power(x: Array, p: Array) -> Array:
    return np.where(x < 0.0, np.nan, np.power(np.where(x < 0.0, 1.0, x), p))


def _sign(x: Array) -> Array:
    return np.where(x == 0.0, x, np.sign(x))  # of a zero itself, as in the core


_OPS: dict[str, Callable[..., Any]] = {
    "neg": np.negative,
    "abs": np.abs,
    "sign": _sign,
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "atan": np.arctan,
    "exp": np.exp,
    "log": np.log,
    "tanh": np.tanh,
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "min": lambda a, b: np.where(b < a, b, a),
    "max": lambda a, b: np.where(b > a, b, a),
    "pow": _power,
    "atan2": np.arctan2,
    "lt": np.less,
    "le": np.less_equal,
    "eq": np.equal,
    "and": np.logical_and,
    "or": np.logical_or,
    "not": np.logical_not,
    "select": np.where,
}


def evaluate(roots: Sequence[Node], values: Mapping[str, npt.ArrayLike]) -> list[Array]:
    """The value of each root; ``values`` of the symbols are broadcast against one another.

    NaN and infinity come as IEEE 754 has them, without a warning.
    """
    known: dict[Node, Any] = {}
    with np.errstate(all="ignore"):
        for node in order(roots):
            args = [known[arg] for arg in node.args]
            if node.op == "constant":
                known[node] = np.float64(node.number)
            elif node.op == "symbol":
                if node.value not in values:
                    raise ExpressionError(
                        f"{node.value} has no value: must be given; known are {sorted(values)}"
                    )
                known[node] = np.asarray(values[str(node.value)], dtype=np.float64)
            elif node.op == "power":
                assert isinstance(node.value, int)
                known[node] = _integer_power(args[0], node.value)
            else:
                known[node] = _OPS[node.op](*args)
    shape = np.broadcast_shapes(*(np.shape(v) for v in values.values()))
    return [np.broadcast_to(np.asarray(known[root], dtype=np.float64), shape) for root in roots]


def _integer_power(x: Array, exponent: int) -> Array:
    product = x
    for _ in range(abs(exponent) - 1):
        product = product * x
    return product if exponent > 0 else 1.0 / product
