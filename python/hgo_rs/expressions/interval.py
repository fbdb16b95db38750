"""Guaranteed bounds of expressions on boxes, by interval arithmetic, many boxes at once.

Every bound is rounded outwards: by one ulp for the operations that IEEE 754 defines, by `_ULPS` for
the others, whose errors in NumPy and libm stay below 4 ulp. Where a part of the box is outside the
domain of a function (sqrt, log or x**p of negative numbers, division by 0) its bounds are infinite,
so that NaN, which min, max and comparisons pass over, leads to no value outside the bounds either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.expressions.derivative import sub, substitute
from hgo_rs.expressions.errors import ExpressionError
from hgo_rs.expressions.nodes import Node, order, symbols

Array = npt.NDArray[np.float64]
Interval = tuple[Array, Array]
"""Lower and upper bounds, one entry a box."""

_ULPS = 8
_CONTINUOUS = 1e-9  # a gap below this part of the values is rounding of written constants


def bounds(roots: Sequence[Node], box: Mapping[str, tuple[Any, Any]]) -> list[Interval]:
    """Lower and upper bounds of each root.

    Parameters
    ----------
    roots : expressions
    box : dict of symbol -> (low, high), numbers or arrays (one entry a box)

    Raises
    ------
    ExpressionError
        A symbol without bounds; low > high; NaN.
    """
    known: dict[Node, Interval] = {}
    with np.errstate(all="ignore"):
        for node in order(roots):
            known[node] = _bounds_of(node, [known[arg] for arg in node.args], box)
    shape = np.broadcast_shapes(*(np.shape(end) for pair in box.values() for end in pair))
    found = []
    for root in roots:
        low, high = known[root]
        found.append((np.broadcast_to(low, shape), np.broadcast_to(high, shape)))
    return found


def _bounds_of(node: Node, args: list[Interval], box: Mapping[str, tuple[Any, Any]]) -> Interval:
    if node.op == "constant":
        value = np.asarray(node.number)
        return value, value
    if node.op == "symbol":
        return _given(str(node.value), box)
    if node.op == "power":
        assert isinstance(node.value, int)
        return _sound(_power(args[0], node.value))
    if node.op == "mul" and node.args[0] is node.args[1]:
        return _sound(_power(args[0], 2))
    return _sound(_OPS[node.op](*args))


def _given(name: str, box: Mapping[str, tuple[Any, Any]]) -> Interval:
    if name not in box:
        raise ExpressionError(f"{name} has no bounds: must be given; known are {sorted(box)}")
    low, high = (np.asarray(end, dtype=np.float64) for end in box[name])
    if not np.all(low <= high):
        raise ExpressionError(f"{name} in [{low}, {high}]: must have low <= high; give (low, high)")
    return low, high


def _sound(pair: Interval) -> Interval:
    """NaN bounds nothing."""
    low, high = pair
    lost = np.isnan(low) | np.isnan(high)
    return np.where(lost, -np.inf, low), np.where(lost, np.inf, high)


def _out(low: Any, high: Any, ulps: int = 1) -> Interval:
    """Rounded outwards."""
    for _ in range(ulps):
        low, high = np.nextafter(low, -np.inf), np.nextafter(high, np.inf)
    return low, high


def _hull(values: Sequence[Any], ulps: int = 1) -> Interval:
    """From the least to the greatest of the values, rounded outwards."""
    low, high = values[0], values[0]
    for value in values[1:]:
        low, high = np.minimum(low, value), np.maximum(high, value)
    return _out(low, high, ulps)


# --- arithmetic -------------------------------------------------------------------------------


def _mul(a: Interval, b: Interval) -> Interval:
    """0 is exact where a factor is 0; where it comes from underflow it is rounded outwards."""
    lows, highs = [], []
    for x in a:
        for y in b:
            exact = (x == 0.0) | (y == 0.0)
            low, high = _out(x * y, x * y)
            lows.append(np.where(exact, 0.0, low))
            highs.append(np.where(exact, 0.0, high))
    return np.minimum.reduce(lows), np.maximum.reduce(highs)


def _add(a: Interval, b: Interval) -> Interval:
    """A sum that is 0 is exact."""
    low, high = a[0] + b[0], a[1] + b[1]
    below, above = _out(low, high)
    return np.where(low == 0.0, low, below), np.where(high == 0.0, high, above)


def _neg(a: Interval) -> Interval:
    return -a[1], -a[0]


def _div(a: Interval, b: Interval) -> Interval:
    crosses = (b[0] <= 0.0) & (b[1] >= 0.0)
    low, high = _hull([x / y for x in a for y in b])
    # A divisor that is 0 at one end only leaves one side bounded; the whole line is safe.
    return np.where(crosses, -np.inf, low), np.where(crosses, np.inf, high)


def _power(x: Interval, n: int) -> Interval:
    """x**n by repeated multiplication: at most |n| roundings, one ulp each."""
    if n < 0:
        return _div((np.asarray(1.0), np.asarray(1.0)), _power(x, -n))
    ends = [np.power(end, float(n)) for end in x]
    low, high = _hull(ends, _ULPS + n)
    if n % 2 == 0:
        low = np.where((x[0] <= 0.0) & (x[1] >= 0.0), 0.0, np.maximum(low, 0.0))
    return low, high


def _rising(f: Callable[[Any], Any], ulps: int = _ULPS) -> Callable[[Interval], Interval]:
    return lambda x: _out(f(x[0]), f(x[1]), ulps)


def _abs(x: Interval) -> Interval:
    crosses = (x[0] <= 0.0) & (x[1] >= 0.0)
    a, b = np.abs(x[0]), np.abs(x[1])
    return np.where(crosses, 0.0, np.minimum(a, b)), np.maximum(a, b)


def _min(a: Interval, b: Interval) -> Interval:
    return np.minimum(a[0], b[0]), np.minimum(a[1], b[1])


def _max(a: Interval, b: Interval) -> Interval:
    return np.maximum(a[0], b[0]), np.maximum(a[1], b[1])


# --- functions --------------------------------------------------------------------------------


def _sqrt(x: Interval) -> Interval:
    low, high = _out(np.sqrt(x[0]), np.sqrt(x[1]))  # NaN where x < 0
    return np.where(x[0] == 0.0, 0.0, low), high


def _exp(x: Interval) -> Interval:
    low, high = _rising(np.exp)(x)
    return np.maximum(low, 0.0), high


def _log(x: Interval) -> Interval:
    return _out(np.log(x[0]), np.log(x[1]), _ULPS)  # NaN where x < 0


def _tanh(x: Interval) -> Interval:
    low, high = _rising(np.tanh)(x)
    return np.maximum(low, -1.0), np.minimum(high, 1.0)


def _contains(x: Interval, offset: float, period: float) -> Any:
    """Whether x may contain offset + k period, for some integer k."""
    slack = 1e-9 + 4e-16 * np.maximum(np.abs(x[0]), np.abs(x[1]))
    first = np.ceil((x[0] - slack - offset) / period)
    return (first * period + offset <= x[1] + slack) | ~np.isfinite(x[0]) | ~np.isfinite(x[1])


def _sin(x: Interval) -> Interval:
    low, high = _hull([np.sin(x[0]), np.sin(x[1])], _ULPS)
    top = _contains(x, 0.5 * np.pi, 2.0 * np.pi)
    bottom = _contains(x, -0.5 * np.pi, 2.0 * np.pi)
    return np.where(bottom, -1.0, np.maximum(low, -1.0)), np.where(top, 1.0, np.minimum(high, 1.0))


def _cos(x: Interval) -> Interval:
    low, high = _hull([np.cos(x[0]), np.cos(x[1])], _ULPS)
    top, bottom = _contains(x, 0.0, 2.0 * np.pi), _contains(x, np.pi, 2.0 * np.pi)
    return np.where(bottom, -1.0, np.maximum(low, -1.0)), np.where(top, 1.0, np.minimum(high, 1.0))


def _tan(x: Interval) -> Interval:
    low, high = _rising(np.tan)(x)
    pole = _contains(x, 0.5 * np.pi, np.pi)
    return np.where(pole, -np.inf, low), np.where(pole, np.inf, high)


def _crosses_cut(y: Interval, x: Interval) -> Any:
    """Whether the box of (y, x) may touch the negative x axis, where atan2 jumps, or the origin."""
    return (y[0] <= 0.0) & (y[1] >= 0.0) & (x[0] <= 0.0)


def _atan2(y: Interval, x: Interval) -> Interval:
    low, high = _hull([np.arctan2(a, b) for a in y for b in x], _ULPS)
    cut = _crosses_cut(y, x)
    most = np.nextafter(np.pi, 4.0)
    return np.where(cut, -most, low), np.where(cut, most, high)


def _pow(x: Interval, p: Interval) -> Interval:
    """x**p for x >= 0: monotone in x and in p, so that the extremes are at the corners."""
    low, high = _hull([np.power(a, b) for a in x for b in p], _ULPS)
    outside = x[0] < 0.0
    return np.where(outside, np.nan, np.maximum(low, 0.0)), np.where(outside, np.nan, high)


# --- conditions: 1 is true, 0 is false, [0, 1] is undecided ----------------------------------


def _truth(certain: Any, possible: Any) -> Interval:
    return np.where(certain, 1.0, 0.0), np.where(possible, 1.0, 0.0)


def _eq(a: Interval, b: Interval) -> Interval:
    single = (a[0] == a[1]) & (b[0] == b[1]) & (a[0] == b[0])
    return _truth(single, (a[0] <= b[1]) & (b[0] <= a[1]))


def _select(condition: Interval, a: Interval, b: Interval) -> Interval:
    always, never = condition[0] == 1.0, condition[1] == 0.0
    low = np.where(always, a[0], np.where(never, b[0], np.minimum(a[0], b[0])))
    high = np.where(always, a[1], np.where(never, b[1], np.maximum(a[1], b[1])))
    return low, high


_OPS: dict[str, Callable[..., Interval]] = {
    "neg": _neg,
    "abs": _abs,
    "sign": lambda a: (np.sign(a[0]), np.sign(a[1])),
    "sqrt": _sqrt,
    "sin": _sin,
    "cos": _cos,
    "tan": _tan,
    "atan": _rising(np.arctan),
    "exp": _exp,
    "log": _log,
    "tanh": _tanh,
    "add": _add,
    "sub": lambda a, b: _add(a, _neg(b)),
    "mul": _mul,
    "div": _div,
    "min": _min,
    "max": _max,
    "pow": _pow,
    "atan2": _atan2,
    "lt": lambda a, b: _truth(a[1] < b[0], a[0] < b[1]),
    "le": lambda a, b: _truth(a[1] <= b[0], a[0] <= b[1]),
    "eq": _eq,
    "and": _min,
    "or": _max,
    "not": lambda a: (1.0 - a[1], 1.0 - a[0]),
    "select": _select,
}


# --- jumps ------------------------------------------------------------------------------------


def jumps(
    roots: Sequence[Node], box: Mapping[str, tuple[float, float]], names: Iterable[str]
) -> list[Node]:
    """The parts of the roots that may jump inside the box as the symbols ``names`` move.

    sign where its argument may be 0; atan2 where it may cross the negative x axis; piecewise where
    its condition may change, unless both branches are equal there, which is seen for a condition
    that compares a symbol with something free of it (x < 1, x <= a + y) by putting the one in
    place of the other.
    """
    nodes = order(roots)
    found = []
    ranges = dict(zip(nodes, bounds(nodes, box), strict=True))
    moving = set(names)
    for node in nodes:
        what = node.args[:1] if node.op == "select" else node.args
        if node.op not in ("sign", "atan2", "select") or moving.isdisjoint(symbols(what)):
            continue
        args = [ranges[arg] for arg in node.args]
        if node.op == "sign":
            jump = bool(args[0][0] <= 0.0 <= args[0][1]) and not bool(args[0][0] == args[0][1])
        elif node.op == "atan2":
            jump = bool(_crosses_cut(args[0], args[1]))
        else:
            undecided = bool(args[0][0] != args[0][1])
            jump = undecided and not _meets(node, box, ranges)
        if jump:
            found.append(node)
    return found


def _meets(
    node: Node, box: Mapping[str, tuple[float, float]], ranges: Mapping[Node, Interval]
) -> bool:
    """Whether both branches are equal wherever a comparison of the condition changes."""
    condition, a, b = node.args
    gap = sub(a, b)
    size = max(float(np.max(np.abs(end))) for part in (a, b) for end in ranges[part])
    scale = max(1.0, size) if np.isfinite(size) else 1.0
    for comparison in order([condition]):
        if comparison.op in ("lt", "le", "eq"):
            low, high = ranges[comparison]
            if low == high:
                continue
            there = _on_surface(gap, *comparison.args)
            if there is None:
                return False
            (low, high), *_ = bounds([there], box)
            if not max(-float(low), float(high)) <= _CONTINUOUS * scale:
                return False
    return True


def _on_surface(gap: Node, left: Node, right: Node) -> Node | None:
    """``gap`` where left = right; None if neither side is a symbol that the other is free of."""
    for name, by in ((left, right), (right, left)):
        if name.op == "symbol" and str(name.value) not in symbols([by]):
            try:
                return substitute(gap, str(name.value), by)
            except ExpressionError:  # no value there, such as 1/0
                return None
    return None
