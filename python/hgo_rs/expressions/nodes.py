"""Expressions as a graph in which equal parts are one object.

A `Node` is made by the functions of this file only. Each looks the new node up among those alive,
so that equal expressions are the same object and common subexpressions are shared by construction.

What is written is what is computed: the constructors leave the order of operations alone and
replace an operation only where every bit of the result stays the same (arithmetic of two constants,
x*1, x/1, x - 0, --x).
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from threading import Lock
from weakref import WeakValueDictionary

from hgo_rs import upward
from hgo_rs.expressions.errors import ExpressionError

MAX_DEPTH = 1000
"""Operations inside one another; longer chains are refused."""
MAX_NODES = 20_000
"""Distinct operations of a set of expressions."""
MAX_POWER = 64
"""Largest integer exponent: a power is written out as multiplications."""

UNARY = ("neg", "abs", "sign", "sqrt", "sin", "cos", "tan", "atan", "exp", "log", "tanh")
BINARY = ("add", "sub", "mul", "div", "min", "max", "pow", "atan2")
BOOLEAN = ("lt", "le", "eq", "and", "or", "not")
"""Operations whose value is true or false; they stand in conditions only."""


class Node:
    """One operation, symbol or constant.

    Attributes
    ----------
    op : str
        "constant", "symbol", "power" (an integer one), "select", or an operation of the table.
    args : tuple of Node
        What it is applied to.
    value : float, int, str or None
        The constant, the exponent, the symbol's name.
    depth : int
        Operations on the longest way down to a symbol or constant.
    size : int
        Operations when written out as text; at most 10^9.
    """

    __slots__ = ("__weakref__", "args", "depth", "op", "size", "value")

    op: str
    args: tuple[Node, ...]
    value: float | int | str | None
    depth: int
    size: int

    def __repr__(self) -> str:
        return str(upward.call("text of an expression", self))

    def __reduce__(self) -> tuple[Callable[..., Node], tuple[object, ...]]:
        return _restore, (pack([self]),)

    @property
    def is_condition(self) -> bool:
        """Whether it is true or false."""
        return self.op in BOOLEAN

    @property
    def number(self) -> float:
        """The value of a constant; NaN for everything else."""
        return float(self.value) if self.op == "constant" and self.value is not None else math.nan


_alive: WeakValueDictionary[tuple[object, ...], Node] = WeakValueDictionary()
_lock = Lock()


def _node(op: str, args: tuple[Node, ...] = (), value: float | int | str | None = None) -> Node:
    # -0.0 and 0.0 are two constants.
    key = (op, args, value.hex() if isinstance(value, float) else value)
    with _lock:
        found = _alive.get(key)
        if found is not None:
            return found
        node = Node()
        node.op, node.args, node.value = op, args, value
        node.depth = 1 + max(arg.depth for arg in args) if args else 0
        node.size = min(10**9, 1 + sum(arg.size for arg in args))
        if node.depth > MAX_DEPTH:
            raise ExpressionError(
                f"the expression is more than {MAX_DEPTH} operations deep: must be shallower; "
                "split it, or name a part as a parameter"
            )
        _alive[key] = node
        return node


# --- leaves -----------------------------------------------------------------------------------


def constant(value: float) -> Node:
    """A finite number."""
    number = float(value)
    if not math.isfinite(number):
        raise ExpressionError(f"the number {value!r} is not finite: must be within +-1.8e308")
    return _node("constant", value=number)


def symbol(name: str) -> Node:
    """A name that gets its value later."""
    return _node("symbol", value=name)


# --- operations -------------------------------------------------------------------------------


_EXACT: dict[str, Callable[..., float]] = {
    "neg": operator.neg,
    "abs": abs,
    "sqrt": math.sqrt,
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "div": operator.truediv,
    "min": lambda a, b: b if b < a else a,
    "max": lambda a, b: b if b > a else a,
}
"""Operations that IEEE 754 defines to the bit, so that they may be done beforehand."""


def function(op: str, *args: Node) -> Node:
    """``op`` of the table applied to numbers: neg, add, sin, min, ..."""
    if op in _EXACT and all(arg.op == "constant" for arg in args):
        try:
            value = _EXACT[op](*(arg.number for arg in args))
        except (ArithmeticError, ValueError):
            value = math.nan
        if math.isfinite(value):
            return constant(value)
    first = args[0]
    last = args[-1].number
    if op == "div" and last == 0.0:
        raise ExpressionError("division by zero: must be by another number")
    if op == "neg" and first.op == "neg":
        return first.args[0]
    if (op in ("mul", "div") and last == 1.0) or (op == "sub" and _is_plus_zero(last)):
        return first
    if op == "mul" and first.number == 1.0:
        return args[1]
    return _node(op, args)


def _is_plus_zero(value: float) -> bool:
    return value == 0.0 and math.copysign(1.0, value) > 0.0


def negate(x: Node) -> Node:
    """-x."""
    return function("neg", x)


def power(base: Node, exponent: Node) -> Node:
    """base ** exponent: multiplications for a constant integer exponent, else pow (base >= 0)."""
    p = exponent.number
    if not p.is_integer():  # or no constant
        return _node("pow", (base, exponent))
    n = int(p)
    if abs(n) > MAX_POWER:
        raise ExpressionError(
            f"the exponent {n} is written out as multiplications: must be within +-{MAX_POWER}; "
            "use exp(p*log(x))"
        )
    if n == 0:
        return constant(1.0)
    if n == 1:
        return base
    if base.op == "constant":
        value = product = base.number
        for _ in range(abs(n) - 1):
            product *= value
        value = product if n > 0 else (1.0 / product if product else math.inf)
        if math.isfinite(value):
            return constant(value)
    return _node("power", (base,), n)


def compare(op: str, a: Node, b: Node) -> Node:
    """a < b ("lt"), a <= b ("le"), a == b ("eq")."""
    return _node(op, (a, b))


def both(a: Node, b: Node) -> Node:
    """a and b."""
    return _node("and", (a, b))


def either(a: Node, b: Node) -> Node:
    """a or b."""
    return _node("or", (a, b))


def no(a: Node) -> Node:
    """not a."""
    return _node("not", (a,))


def select(condition: Node, a: Node, b: Node) -> Node:
    """a where the condition holds, else b."""
    return a if a is b else _node("select", (condition, a, b))


# --- the graph --------------------------------------------------------------------------------


def order(roots: Iterable[Node]) -> list[Node]:
    """Every node that the roots use, once, arguments before what uses them, left to right."""
    done: set[Node] = set()
    result: list[Node] = []
    for root in roots:
        stack = [root]
        while stack:
            node = stack[-1]
            waiting = [arg for arg in reversed(node.args) if arg not in done]
            if node in done:
                stack.pop()
            elif waiting:
                stack.extend(waiting)
            else:
                done.add(node)
                result.append(node)
                stack.pop()
        if len(result) > MAX_NODES:
            raise ExpressionError(
                f"more than {MAX_NODES} distinct operations: must be fewer; split the model"
            )
    return result


def symbols(roots: Iterable[Node]) -> list[str]:
    """The names that the roots use, in order of appearance."""
    return [str(node.value) for node in order(roots) if node.op == "symbol"]


def rebuilt(node: Node, args: tuple[Node, ...]) -> Node:
    """The operation of ``node`` applied to other arguments."""
    if node.op == "power":
        assert isinstance(node.value, int)
        return power(args[0], constant(node.value))
    if node.op in ("lt", "le", "eq"):
        return compare(node.op, *args)
    others: dict[str, Callable[..., Node]] = {
        "and": both,
        "or": either,
        "not": no,
        "select": select,
        "pow": power,
    }
    return others[node.op](*args) if node.op in others else function(node.op, *args)


def replaced(
    roots: Sequence[Node],
    values: Mapping[str, Node],
    again: Callable[[Node, tuple[Node, ...]], Node] = rebuilt,
) -> list[Node]:
    """The roots with expressions in place of some symbols; ``again`` makes the operations anew."""
    new: dict[Node, Node] = {}
    for node in order(roots):
        args = tuple(new[arg] for arg in node.args)
        if node.op == "symbol":
            new[node] = values.get(str(node.value), node)
        else:
            new[node] = node if args == node.args else again(node, args)
    return [new[root] for root in roots]


Packed = tuple[tuple[tuple[str, tuple[int, ...], float | int | str | None], ...], tuple[int, ...]]


def pack(roots: Sequence[Node]) -> Packed:
    """The graph as plain tuples, however deep: for copies and pickles."""
    nodes = order(roots)
    place = {node: i for i, node in enumerate(nodes)}
    rows = tuple((node.op, tuple(place[arg] for arg in node.args), node.value) for node in nodes)
    return rows, tuple(place[root] for root in roots)


def unpack(packed: Packed) -> list[Node]:
    """The roots that were packed."""
    rows, roots = packed
    nodes: list[Node] = []
    for op, args, value in rows:
        nodes.append(_node(op, tuple(nodes[i] for i in args), value))
    return [nodes[i] for i in roots]


def _restore(packed: Packed) -> Node:
    return unpack(packed)[0]
