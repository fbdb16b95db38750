"""SymPy expressions, walked part by part; SymPy is asked for no string and evaluates none."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import reduce
from typing import Any

from hgo_rs.expressions import nodes
from hgo_rs.expressions.errors import ExpressionError
from hgo_rs.expressions.library import FUNCTIONS
from hgo_rs.expressions.nodes import Node, constant, function

_FUNCTIONS = {
    "Abs": "abs",
    "sign": "sign",
    "Min": "min",
    "Max": "max",
    "sin": "sin",
    "cos": "cos",
    "tan": "tan",
    "atan": "atan",
    "atan2": "atan2",
    "exp": "exp",
    "log": "log",
    "tanh": "tanh",
}


def is_sympy(value: object) -> bool:
    """Whether ``value`` is a SymPy expression; SymPy is not imported for the question."""
    sympy = sys.modules.get("sympy")
    return sympy is not None and isinstance(value, sympy.Basic)


def from_sympy(expression: Any) -> Node:
    """The expression as a node: symbols by their names, q(t) as q.

    Raises
    ------
    ExpressionError
        A part that is not in the function library (an integral, a complex number, ...).
    """
    done: dict[Any, Node] = {}
    stack = [expression]
    while stack:
        part = stack[-1]
        waiting = [] if part in done else [arg for arg in _parts(part) if arg not in done]
        if waiting:
            stack.extend(reversed(waiting))
            continue
        stack.pop()
        if part not in done:
            done[part] = _node(part, lambda arg: done[arg])
    return done[expression]


def _parts(part: Any) -> tuple[Any, ...]:
    """What must be known before ``part``."""
    if part.is_Atom or _is_signal(part):
        return ()
    if part.is_Mul:
        return tuple(piece for side in _fraction(part) for piece in side)
    if part.is_Pow and _is_root(part):
        return (part.base,)
    if part.is_Piecewise:
        return tuple(
            piece
            for pair in part.args
            for piece in pair.args
            if not piece.is_Boolean or not piece.is_Atom
        )
    return tuple(part.args)


def _is_signal(part: Any) -> bool:
    """q(t), as sympy.physics.mechanics.dynamicsymbols makes it."""
    import sympy

    return isinstance(part, sympy.core.function.AppliedUndef)


def _is_root(part: Any) -> bool:
    import sympy

    return part.exp in (sympy.Rational(1, 2), sympy.Rational(-1, 2))


def _fraction(product: Any) -> tuple[list[Any], list[Any]]:
    """Factors above and below the line."""
    above, below = [], []
    for factor in product.args:
        if factor.is_Pow and factor.exp.is_number and factor.exp.is_negative:
            below.append(factor.base ** (-factor.exp))
        elif factor.is_Rational and not factor.is_Integer:
            import sympy

            above += [sympy.Integer(factor.p)] if factor.p != 1 else []
            below.append(sympy.Integer(factor.q))
        else:
            above.append(factor)
    return above, below


def _node(part: Any, of: Callable[[Any], Node]) -> Node:
    import sympy

    if part.is_Symbol:
        return nodes.symbol(part.name)
    if _is_signal(part):
        return nodes.symbol(part.func.__name__)
    if part.is_Atom and part.is_number and part.is_real and part.is_finite:
        if part.is_Rational and not part.is_Integer:
            return function("div", constant(int(part.p)), constant(int(part.q)))
        return constant(float(part))
    if part.is_Add:
        return _sum(part, of)
    if part.is_Mul:
        return _product(part, of)
    if part.is_Pow:
        return _power(part, of)
    if isinstance(part, sympy.Piecewise):
        return _piecewise(part, of)
    if isinstance(part, sympy.core.function.Function) or part.func in (sympy.Min, sympy.Max):
        name = _FUNCTIONS.get(part.func.__name__)
        if name is not None:
            return FUNCTIONS[name](*map(of, part.args))
    condition = _condition(part, of)
    if condition is not None:
        return condition
    raise ExpressionError(
        f"{str(part)[:60]} of SymPy ({type(part).__name__}): must be made of the function library; "
        "rewrite or evaluate it"
    )


def _sum(part: Any, of: Callable[[Any], Node]) -> Node:
    result: Node | None = None
    for term in part.args:
        node = of(term)
        if result is None:
            result = node
        elif node.op == "neg":
            result = function("sub", result, node.args[0])
        else:
            result = function("add", result, node)
    assert result is not None
    return result


def _product(part: Any, of: Callable[[Any], Node]) -> Node:
    above, below = (list(map(of, side)) for side in _fraction(part))
    negative = bool(above) and above[0].number == -1.0
    factors = above[1:] if negative else above

    def multiply(a: Node, b: Node) -> Node:
        return function("mul", a, b)

    result = reduce(multiply, factors) if factors else constant(1.0)
    if below:
        result = function("div", result, reduce(multiply, below))
    return nodes.negate(result) if negative else result


def _power(part: Any, of: Callable[[Any], Node]) -> Node:
    import sympy

    if _is_root(part):
        root = function("sqrt", of(part.base))
        return root if part.exp.is_positive else function("div", constant(1.0), root)
    if part.base is sympy.E:
        return function("exp", of(part.exp))
    return nodes.power(of(part.base), of(part.exp))


def _piecewise(part: Any, of: Callable[[Any], Node]) -> Node:
    import sympy

    pairs = list(part.args)
    if pairs[-1].cond is not sympy.true:
        raise ExpressionError(
            f"{str(part)[:60]} of SymPy has no last case: must hold everywhere; add (value, True)"
        )
    result = of(pairs[-1].expr)
    for pair in reversed(pairs[:-1]):
        result = nodes.select(of(pair.cond), of(pair.expr), result)
    return result


def _condition(part: Any, of: Callable[[Any], Node]) -> Node | None:
    import sympy

    if isinstance(part, sympy.core.relational.Relational):
        a, b = map(of, part.args)
        match part.rel_op:
            case "<":
                return nodes.compare("lt", a, b)
            case "<=":
                return nodes.compare("le", a, b)
            case ">":
                return nodes.compare("lt", b, a)
            case ">=":
                return nodes.compare("le", b, a)
            case "==":
                return nodes.compare("eq", a, b)
            case "!=":
                return nodes.no(nodes.compare("eq", a, b))
    if isinstance(part, sympy.And):
        return reduce(nodes.both, map(of, part.args))
    if isinstance(part, sympy.Or):
        return reduce(nodes.either, map(of, part.args))
    if isinstance(part, sympy.Not):
        return nodes.no(of(part.args[0]))
    return None
