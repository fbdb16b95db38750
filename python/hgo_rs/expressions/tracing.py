"""Callables, called once with symbolic arguments.

A callable that computes with operators, NumPy's functions and indices alone becomes an expression
and runs compiled; a factor or a term that is the number 0 is left out. One that asks for a value
(a branch, `float(x)`, `math.sin(x)`) cannot be traced.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hgo_rs.expressions import nodes
from hgo_rs.expressions.errors import ExpressionError, UntraceableError
from hgo_rs.expressions.library import FUNCTIONS
from hgo_rs.expressions.nodes import Node, function


def as_node(value: Any) -> Node:
    """The expression of a value that a callable gave: symbolic, or a number."""
    if isinstance(value, np.ndarray) and value.shape == ():
        value = value.item()
    if isinstance(value, Symbolic):
        return value.node
    if isinstance(value, (bool, np.bool_)):
        raise ExpressionError(f"{value!r} is no number: must be a float or an expression")
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise ExpressionError(
            f"{type(value).__name__} is no number: must be a float or an expression"
        ) from None
    return nodes.constant(number)


def symbolic_vector(names: list[str]) -> Any:
    """Symbols as an array of objects, so that matrix products and slices work."""
    vector = np.empty(len(names), dtype=object)
    vector[:] = [Symbolic(nodes.symbol(name)) for name in names]
    return vector


def _operation(make: Callable[..., Node], swap: bool = False) -> Callable[..., Any]:
    def operate(*operands: Any) -> Any:
        if any(isinstance(operand, (np.ndarray, list, tuple)) for operand in operands):
            return NotImplemented
        chosen = operands[::-1] if swap else operands
        return _apply(make, *chosen)

    return operate


def _apply(make: Callable[..., Node], *operands: Any) -> Symbolic:
    return Symbolic(make(*(as_node(operand) for operand in operands)))


def _binary(op: str) -> Callable[[Node, Node], Node]:
    return lambda a, b: function(op, a, b)


def _sum(a: Node, b: Node) -> Node:
    """a + b; a term that is the number 0, as sparse matrices make them, is left out."""
    if a.number == 0.0:
        return b
    return a if b.number == 0.0 else function("add", a, b)


def _product(a: Node, b: Node) -> Node:
    """a b; the factor 0 makes 0, so that a matrix product depends on what it shows only."""
    if a.number == 0.0 or b.number == 0.0:
        return nodes.constant(0.0)
    return function("mul", a, b)


def _compared(op: str, swap: bool = False) -> Callable[[Node, Node], Node]:
    return lambda a, b: nodes.compare(op, b, a) if swap else nodes.compare(op, a, b)


def _unequal(a: Node, b: Node) -> Node:
    return nodes.no(nodes.compare("eq", a, b))


def _hypot(a: Node, b: Node) -> Node:
    return function("sqrt", function("add", function("mul", a, a), function("mul", b, b)))


def _square(a: Node) -> Node:
    return nodes.power(a, nodes.constant(2.0))


_UFUNCS: dict[str, Callable[..., Node]] = {
    **{name: FUNCTIONS[name] for name in ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh")},
    "arctan": FUNCTIONS["atan"],
    "arctan2": FUNCTIONS["atan2"],
    "atan": FUNCTIONS["atan"],
    "atan2": FUNCTIONS["atan2"],
    "absolute": FUNCTIONS["abs"],
    "fabs": FUNCTIONS["abs"],
    "sign": FUNCTIONS["sign"],
    "minimum": FUNCTIONS["min"],
    "maximum": FUNCTIONS["max"],
    "fmin": FUNCTIONS["min"],
    "fmax": FUNCTIONS["max"],
    "power": nodes.power,
    "pow": nodes.power,
    "float_power": nodes.power,
    "square": _square,
    "reciprocal": lambda a: function("div", nodes.constant(1.0), a),
    "hypot": _hypot,
    "negative": nodes.negate,
    "positive": lambda a: a,
    "add": _sum,
    "subtract": _binary("sub"),
    "multiply": _product,
    "divide": _binary("div"),
    "true_divide": _binary("div"),
    "less": _compared("lt"),
    "less_equal": _compared("le"),
    "greater": _compared("lt", swap=True),
    "greater_equal": _compared("le", swap=True),
    "equal": _compared("eq"),
    "not_equal": _unequal,
    "logical_and": nodes.both,
    "logical_or": nodes.either,
    "logical_not": nodes.no,
}


class Symbolic:
    """A value that stands for an expression. Operators and NumPy's functions build the next one."""

    __slots__ = ("node",)
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, node: Node) -> None:
        self.node = node

    def __repr__(self) -> str:
        return repr(self.node)

    __add__ = _operation(_sum)
    __radd__ = _operation(_sum, swap=True)
    __sub__ = _operation(_binary("sub"))
    __rsub__ = _operation(_binary("sub"), swap=True)
    __mul__ = _operation(_product)
    __rmul__ = _operation(_product, swap=True)
    __truediv__ = _operation(_binary("div"))
    __rtruediv__ = _operation(_binary("div"), swap=True)
    __pow__ = _operation(nodes.power)
    __rpow__ = _operation(nodes.power, swap=True)
    __neg__ = _operation(nodes.negate)
    __abs__ = _operation(FUNCTIONS["abs"])
    __lt__ = _operation(_compared("lt"))
    __le__ = _operation(_compared("le"))
    __gt__ = _operation(_compared("lt", swap=True))
    __ge__ = _operation(_compared("le", swap=True))
    __eq__ = _operation(_compared("eq"))
    __ne__ = _operation(_unequal)
    __and__ = _operation(nodes.both)
    __rand__ = _operation(nodes.both, swap=True)
    __or__ = _operation(nodes.either)
    __ror__ = _operation(nodes.either, swap=True)
    __invert__ = _operation(nodes.no)

    def __pos__(self) -> Symbolic:
        return self

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """np.sin(x) and the like, entry by entry where an array takes part."""
        make = _UFUNCS.get(ufunc.__name__)
        if make is None or method != "__call__" or options:
            raise UntraceableError(
                f"np.{ufunc.__name__} of an unknown value: must be in the function library"
            )
        if any(isinstance(value, (np.ndarray, list, tuple)) for value in inputs):
            each = np.frompyfunc(lambda *row: _apply(make, *row), len(inputs), 1)
            return each(*(np.asarray(_boxed(value), dtype=object) for value in inputs))
        return _apply(make, *inputs)

    def __array_function__(self, func: Any, types: Any, args: Any, kwargs: Any) -> Any:
        """np.where and np.clip."""
        if func is np.where and len(args) == 3 and not kwargs:
            return _apply(nodes.select, *args)
        if func is np.clip and len(args) == 3 and not kwargs:
            return _apply(FUNCTIONS["saturate"], *args)
        raise UntraceableError(f"np.{func.__name__} of an unknown value: must be a plain operation")

    def _no_value(self, *_: Any) -> Any:
        raise UntraceableError(
            "the value of an expression is needed (a branch, float(x), or a function of math): "
            "must be written with np.where, np.maximum, np.sin and the like"
        )

    __bool__ = _no_value
    __float__ = _no_value
    __int__ = _no_value
    __index__ = _no_value
    __iter__ = _no_value
    __len__ = _no_value


def _boxed(value: Any) -> Any:
    """A symbolic value as an array of one object, which np.asarray takes as it is."""
    if isinstance(value, Symbolic):
        box = np.empty((), dtype=object)
        box[()] = value
        return box
    return value


# np.sin of an array of objects calls the method `sin` of each.
for _name in ("sin", "cos", "tan", "exp", "log", "sqrt", "tanh", "arctan", "arctan2", "sign"):
    setattr(Symbolic, _name, _operation(_UFUNCS[_name]))
del _name
