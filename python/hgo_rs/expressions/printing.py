"""Expressions as text that can be parsed again, and as LaTeX."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from hgo_rs import upward
from hgo_rs.expressions.library import CONSTANTS
from hgo_rs.expressions.nodes import Node, order

LONGEST = 5000
"""Operations of the longest text; beyond it, shared parts would be written out again and again."""

# How tightly each operation binds; a part that binds less tightly stands in parentheses.
_OR, _AND, _NOT, _COMPARE, _SUM, _PRODUCT, _SIGN, _POWER, _ATOM = range(9)

_INFIX = {
    "or": ("or", _OR),
    "and": ("and", _AND),
    "lt": ("<", _COMPARE),
    "le": ("<=", _COMPARE),
    "eq": ("==", _COMPARE),
    "add": ("+", _SUM),
    "sub": ("-", _SUM),
    "mul": ("*", _PRODUCT),
    "div": ("/", _PRODUCT),
}

Written = tuple[str, int]  # text, and how tightly it binds


def text(root: Node) -> str:
    """The expression in its own syntax: ``parse(text(x)) is x``."""
    return _write(root, _as_text)


upward.register("text of an expression", text)  # of which Node makes its repr


def latex(root: Node, names: dict[str, str] | None = None) -> str:
    """The expression in LaTeX's mathematics; ``names``: how to write some symbols."""
    return _write(root, lambda node, args: _as_latex(node, args, names or {}))


def _write(root: Node, how: Callable[[Node, list[Written]], Written]) -> str:
    if root.size > LONGEST:
        return f"(an expression of {sum(bool(node.args) for node in order([root]))} operations)"
    done: dict[Node, Written] = {}
    for node in order([root]):
        done[node] = how(node, [done[arg] for arg in node.args])
    return done[root][0]


def _in(part: Written, least: int) -> str:
    """A part, in parentheses if it binds less tightly than ``least``."""
    return part[0] if part[1] >= least else f"({part[0]})"


def _number(value: float) -> Written:
    for name, known in CONSTANTS.items():
        if value == known:
            return name, _ATOM
    shown = repr(int(value)) if value.is_integer() and abs(value) < 1e15 else repr(value)
    if math.copysign(1.0, value) < 0.0:
        return (shown if shown.startswith("-") else f"-{shown}"), _SIGN
    return shown, _ATOM


def _as_text(node: Node, args: list[Written]) -> Written:
    if node.op == "symbol":
        return str(node.value), _ATOM
    if node.op == "constant":
        return _number(node.number)
    if node.op in _INFIX:
        sign, level = _INFIX[node.op]
        between = sign if level == _PRODUCT else f" {sign} "
        right = _POWER if level == _PRODUCT else level + 1  # a*(-b), though a*-b can be read
        return f"{_in(args[0], level)}{between}{_in(args[1], right)}", level
    if node.op == "neg":
        return f"-{_in(args[0], _SIGN)}", _SIGN
    if node.op == "not":
        return f"not {_in(args[0], _NOT)}", _NOT
    if node.op == "power":
        return f"{_in(args[0], _ATOM)}**{node.value}", _POWER
    if node.op == "pow":
        return f"{_in(args[0], _ATOM)}**{_in(args[1], _SIGN)}", _POWER
    if node.op == "select":
        condition, value, default = (arg[0] for arg in args)
        if node.args[2].op == "select":  # a chain of them is one piecewise
            default = default.removeprefix("piecewise(").removesuffix(")")
        return f"piecewise({value}, {condition}, {default})", _ATOM
    return f"{node.op}({', '.join(arg[0] for arg in args)})", _ATOM


# --- LaTeX ------------------------------------------------------------------------------------

_GREEK = re.compile(
    "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|iota|kappa|lambda|mu|nu|xi|pi|rho|sigma|tau|"
    "upsilon|phi|chi|psi|omega|Gamma|Delta|Theta|Lambda|Xi|Pi|Sigma|Phi|Psi|Omega"
)
_LATEX_INFIX = {
    "or": r"\lor",
    "and": r"\land",
    "lt": "<",
    "le": r"\le",
    "eq": "=",
    "add": "+",
    "sub": "-",
    "mul": r"\,",
}
_LATEX_NAMES = {
    "sign": r"\operatorname{sgn}",
    "atan": r"\arctan",
    "atan2": r"\operatorname{atan2}",
    "log": r"\ln",
}


def _latex_name(name: str) -> str:
    """x1 is x with the subscript 1, omega is a letter, Fv is F with the subscript v."""
    stem, _, rest = name.partition("_")
    if not rest:
        digits = len(stem) - len(stem.rstrip("0123456789"))
        if digits:
            stem, rest = stem[:-digits], stem[-digits:]
    if _GREEK.fullmatch(stem):
        shown = f"\\{stem}"
    else:
        shown = stem if len(stem) == 1 else rf"\mathrm{{{stem}}}"
    rest = rest.replace("_", r"\_")
    return f"{shown}_{{{rest}}}" if rest else shown


def _as_latex(node: Node, args: list[Written], names: dict[str, str]) -> Written:
    if node.op == "symbol":
        name = str(node.value)
        return names.get(name, _latex_name(name)), _ATOM
    if node.op == "constant":
        shown, level = _number(node.number)
        mantissa, e, exponent = shown.partition("e")
        if shown in CONSTANTS:
            return f"\\{shown}", level
        return (rf"{mantissa} \cdot 10^{{{int(exponent)}}}", _PRODUCT) if e else (shown, level)
    if node.op == "div":
        return rf"\frac{{{args[0][0]}}}{{{args[1][0]}}}", _PRODUCT
    if node.op in _LATEX_INFIX:
        level = _INFIX[node.op][1]
        between = _LATEX_INFIX[node.op]
        return f"{_latex_in(args[0], level)} {between} {_latex_in(args[1], level + 1)}", level
    if node.op == "neg":
        return f"-{_latex_in(args[0], _SIGN)}", _SIGN
    if node.op == "not":
        return rf"\lnot {_latex_in(args[0], _ATOM)}", _NOT
    if node.op in ("power", "pow"):
        exponent = str(node.value) if node.op == "power" else args[1][0]
        return f"{_latex_in(args[0], _ATOM)}^{{{exponent}}}", _POWER
    if node.op == "abs":
        return rf"\left|{args[0][0]}\right|", _ATOM
    if node.op == "sqrt":
        return rf"\sqrt{{{args[0][0]}}}", _ATOM
    if node.op == "select":
        rows = rf"{args[1][0]} & {args[0][0]} \\ {args[2][0]} & \text{{otherwise}}"
        return rf"\begin{{cases}} {rows} \end{{cases}}", _ATOM
    inside = ", ".join(arg[0] for arg in args)
    return rf"{_LATEX_NAMES.get(node.op, chr(92) + node.op)}\left({inside}\right)", _ATOM


def _latex_in(part: Written, least: int) -> str:
    return part[0] if part[1] >= least else rf"\left({part[0]}\right)"
