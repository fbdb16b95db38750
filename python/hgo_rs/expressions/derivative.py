"""Symbolic derivatives.

At a kink the derivative is the one of the branch that the value is taken from: abs has the slope
+1 at 0 (from the right), min(a, b) and max(a, b) that of a where both are equal, piecewise that of
the branch chosen. sign has the slope 0 everywhere; that it jumps at 0 is left to `interval`.

A derivative is new, so here terms with 0 and 1 are simplified as in algebra.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from hgo_rs.expressions import nodes
from hgo_rs.expressions.nodes import Node, compare, constant, function, order, select, symbol

ZERO, ONE, TWO = constant(0.0), constant(1.0), constant(2.0)


def gradient(root: Node, names: Sequence[str]) -> list[Node]:
    """The derivatives of ``root`` with respect to the symbols ``names``."""
    return [derivative(root, name) for name in names]


def derivative(root: Node, name: str) -> Node:
    """d(root)/d(name)."""
    x = symbol(name)
    slopes: dict[Node, Node] = {}
    for node in order([root]):
        slopes[node] = ONE if node is x else _slope(node, [slopes[arg] for arg in node.args])
    return slopes[root]


def substitute(root: Node, name: str, by: Node) -> Node:
    """``root`` with the symbol ``name`` replaced, simplified as derivatives are."""
    return nodes.replaced([root], {name: by}, _again)[0]


def _again(node: Node, args: tuple[Node, ...]) -> Node:
    """``node`` with other arguments."""
    simple: dict[str, Callable[..., Node]] = {"add": add, "sub": sub, "mul": mul, "div": div}
    return simple[node.op](*args) if node.op in simple else nodes.rebuilt(node, args)


# --- algebra ----------------------------------------------------------------------------------


def _is(node: Node, value: float) -> bool:
    return node.number == value


def neg(a: Node) -> Node:
    """-a."""
    if _is(a, 0.0):
        return ZERO
    if a.op == "sub":
        return sub(a.args[1], a.args[0])
    return nodes.negate(a)


def add(a: Node, b: Node) -> Node:
    """a + b."""
    if _is(a, 0.0):
        return b
    if _is(b, 0.0):
        return a
    if b.op == "neg":
        return sub(a, b.args[0])
    if a.op == "neg":
        return sub(b, a.args[0])
    if a is b:
        return mul(TWO, a)
    return function("add", a, b)


def sub(a: Node, b: Node) -> Node:
    """a - b."""
    if a is b:
        return ZERO
    if _is(b, 0.0):
        return a
    if _is(a, 0.0):
        return neg(b)
    if b.op == "neg":
        return add(a, b.args[0])
    return function("sub", a, b)


def mul(a: Node, b: Node) -> Node:
    """a b."""
    if _is(a, 0.0) or _is(b, 0.0):
        return ZERO
    if _is(a, 1.0):
        return b
    if _is(b, 1.0):
        return a
    if _is(a, -1.0):
        return neg(b)
    if _is(b, -1.0):
        return neg(a)
    if a.op == "neg":
        return neg(mul(a.args[0], b))
    if b.op == "neg":
        return neg(mul(a, b.args[0]))
    if a is b:
        return nodes.power(a, TWO)
    if b.op == "constant":
        a, b = b, a
    return function("mul", a, b)


def div(a: Node, b: Node) -> Node:
    """a / b."""
    if _is(a, 0.0):
        return ZERO
    if _is(b, 1.0):
        return a
    if a.op == "neg":
        return neg(div(a.args[0], b))
    return function("div", a, b)


def _square(a: Node) -> Node:
    return nodes.power(a, TWO)


# --- rules ------------------------------------------------------------------------------------


def _slope(node: Node, slopes: list[Node]) -> Node:
    """The derivative of ``node``, given those of its arguments."""
    if all(_is(slope, 0.0) for slope in slopes) or node.is_condition:
        return ZERO
    if node.op == "power":
        assert isinstance(node.value, int)
        lower = nodes.power(node.args[0], constant(node.value - 1))
        return mul(mul(constant(node.value), lower), slopes[0])
    if len(node.args) == 1:
        return mul(_outer(node, node.args[0]), slopes[0])
    if node.op == "select":
        return select(node.args[0], slopes[1], slopes[2])
    return _binary_slope(node, *node.args, *slopes)


def _outer(node: Node, x: Node) -> Node:
    """The slope of a function of one argument."""
    match node.op:
        case "neg":
            return constant(-1.0)
        case "abs":
            return select(compare("lt", x, ZERO), constant(-1.0), ONE)
        case "sqrt":
            return div(constant(0.5), node)
        case "sin":
            return function("cos", x)
        case "cos":
            return neg(function("sin", x))
        case "tan":
            return add(ONE, _square(node))
        case "atan":
            return div(ONE, add(ONE, _square(x)))
        case "exp":
            return node
        case "log":
            return div(ONE, x)
        case "tanh":
            return sub(ONE, _square(node))
    return ZERO  # sign


def _binary_slope(node: Node, a: Node, b: Node, da: Node, db: Node) -> Node:
    match node.op:
        case "add":
            return add(da, db)
        case "sub":
            return sub(da, db)
        case "mul":
            return add(mul(da, b), mul(a, db))
        case "div":
            return div(sub(da, mul(node, db)), b)
        case "min":
            return select(compare("lt", b, a), db, da)
        case "max":
            return select(compare("lt", a, b), db, da)
        case "atan2":
            return div(sub(mul(b, da), mul(a, db)), add(_square(a), _square(b)))
    # pow: a**b, a >= 0
    by_base = mul(mul(b, nodes.power(a, sub(b, ONE))), da)
    by_exponent = mul(mul(node, function("log", a)), db)
    return add(by_base, by_exponent)
