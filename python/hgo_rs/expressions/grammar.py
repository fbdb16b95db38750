r"""Expression strings: an LALR(1) grammar, read by Lark. No string reaches eval.

The parser keeps a stack of its own, so that no nesting, however deep, can exhaust Python's; the
text is at most `MAX_LENGTH` characters long. Precedence is Python's: -x**2 = -(x**2),
a < b < c is a < b and b < c.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

from hgo_rs.errors import nearest
from hgo_rs.expressions import nodes
from hgo_rs.expressions.errors import ExpressionError
from hgo_rs.expressions.library import CONSTANTS, FUNCTIONS, SUBSTITUTES
from hgo_rs.expressions.nodes import Node, function

if TYPE_CHECKING:
    from lark import Lark, Token, Tree

MAX_LENGTH = 10_000
"""Characters of one expression."""

GRAMMAR = r"""
    ?either: both | either OR both
    ?both: no | both AND no
    ?no: comparison | NOT no
    ?comparison: sum | sum (COMPARE sum)+ -> compare
    ?sum: product | sum PLUS product -> binary | sum MINUS product -> binary
    ?product: signed | product TIMES signed -> binary | product OVER signed -> binary
    ?signed: power | MINUS signed -> minus | PLUS signed -> plus
    ?power: atom | atom POWER signed
    ?atom: NUMBER -> number
         | NAME -> name
         | NAME "(" [either ("," either)*] ")" -> call
         | "(" either ")" -> inside

    OR: "or"
    AND: "and"
    NOT: "not"
    COMPARE: "<=" | ">=" | "==" | "!=" | "<" | ">"
    PLUS: "+"
    MINUS: "-"
    TIMES: "*"
    OVER: "/"
    POWER: "**"
    NUMBER: /([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?/
    NAME: /[A-Za-z_][A-Za-z0-9_]*/
    %ignore /[ \t\r\n]+/
"""

_BINARY = {"+": "add", "-": "sub", "*": "mul", "/": "div"}


def _comparison(sign: str, a: Node, b: Node) -> Node:
    if sign in (">", ">="):
        a, b = b, a
    if sign == "!=":
        return nodes.no(nodes.compare("eq", a, b))
    return nodes.compare({"<": "lt", ">": "lt", "<=": "le", ">=": "le", "==": "eq"}[sign], a, b)


_STRANGERS = {
    "^": "write ** for a power",
    "=": "write == to compare; an expression is the right-hand side only",
    "%": "there is no remainder",
    "&": "write and",
    "|": "write or",
    "!": "write not, or != to compare",
    "[": "write the state's name, such as x1",
    "{": "write ( )",
    ".": "there are no attributes; write a number as 0.5",
    "'": "there are no strings",
    '"': "there are no strings",
    ";": "write one expression; several go into a list",
}


class _Part(NamedTuple):
    """What has been read so far, and where it begins."""

    node: Node
    start: int


def parse(text: str, names: Iterable[str] | None = None) -> Node:
    """The expression that ``text`` says.

    Parameters
    ----------
    text : str
        At most `MAX_LENGTH` characters of ASCII.
    names : names that may appear, optional
        Any, where left out.

    Raises
    ------
    ExpressionError
        With a caret under the place.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionError(
            f"the expression has {len(text)} characters: must be at most {MAX_LENGTH}; "
            "split it, or give a callable"
        )
    if not text.strip():
        raise ExpressionError("the expression is empty: must be a number at least; write 0")
    from lark.exceptions import UnexpectedCharacters, UnexpectedToken

    # raised outside of `except`: the parser's error, which no worker could send, stays here
    try:
        return _Reader(text, names).read(_parser().parse(text))
    except UnexpectedCharacters as error:
        at = int(error.pos_in_stream or 0)
        what = _stranger(text[at])
    except UnexpectedToken as error:
        token = error.token
        at = len(text.rstrip()) if token.type == "$END" else int(token.start_pos or 0)
        what = _surprise(text, token, at)
    raise ExpressionError(what, text, at)


@cache
def _parser() -> Lark:
    from lark import Lark

    return Lark(GRAMMAR, start="either", parser="lalr", lexer="basic", maybe_placeholders=False)


class _Reader:
    """Makes nodes of a tree, from the leaves up, without recursion."""

    def __init__(self, text: str, names: Iterable[str] | None) -> None:
        self.text = text
        self.names = None if names is None else frozenset(names)
        self.done: dict[int, _Part] = {}

    def read(self, tree: Tree[Token]) -> Node:
        """The node of the whole tree."""
        for branch in tree.iter_subtrees():  # children first
            children = [self.done.get(id(child), child) for child in branch.children]
            self.done[id(branch)] = getattr(self, f"_{branch.data}")(*children)
        return self._number_of(self.done[id(tree)])

    def _refuse(self, message: str, at: int) -> ExpressionError:
        return ExpressionError(message, self.text, at)

    def _made(self, at: int, make: Callable[..., Node], *args: Node) -> Node:
        """``make(*args)``; an error of it stands at ``at``."""
        try:
            return make(*args)
        except ExpressionError as error:
            raise self._refuse(error.reason, at) from None

    def _number_of(self, part: _Part) -> Node:
        if part.node.is_condition:
            raise self._refuse(
                "a condition stands where a number is needed: must be inside piecewise; "
                "write piecewise(1, condition, 0)",
                part.start,
            )
        return part.node

    def _condition_of(self, part: _Part) -> Node:
        if not part.node.is_condition:
            raise self._refuse(
                "a number stands where a condition is needed: must be a comparison; "
                "write, for example, x > 0",
                part.start,
            )
        return part.node

    # --- leaves

    def _number(self, token: Token) -> _Part:
        at = _start(token)
        value = float(token)
        if not math.isfinite(value):
            raise self._refuse(f"the number {token[:40]} is too large: must be below 1.8e308", at)
        return _Part(nodes.constant(value), at)

    def _name(self, token: Token) -> _Part:
        name, at = str(token), _start(token)
        if self.names is not None and name in self.names:
            return _Part(nodes.symbol(name), at)
        if name in CONSTANTS:
            return _Part(nodes.constant(CONSTANTS[name]), at)
        if name in FUNCTIONS:
            signature = FUNCTIONS[name].signature
            raise self._refuse(f"{name} is a function: must have arguments; write {signature}", at)
        if self.names is None:
            return _Part(nodes.symbol(name), at)
        raise self._refuse(unknown(name, {*self.names, *CONSTANTS}), at)

    # --- operations

    def _inside(self, part: _Part) -> _Part:
        return part

    def _plus(self, sign: Token, part: _Part) -> _Part:
        return _Part(self._number_of(part), _start(sign))

    def _minus(self, sign: Token, part: _Part) -> _Part:
        node = self._made(_start(sign), nodes.negate, self._number_of(part))
        return _Part(node, _start(sign))

    def _binary(self, left: _Part, sign: Token, right: _Part) -> _Part:
        a, b = self._number_of(left), self._number_of(right)
        node = self._made(_start(sign), partial(function, _BINARY[str(sign)]), a, b)
        return _Part(node, left.start)

    def _power(self, left: _Part, sign: Token, right: _Part) -> _Part:
        a, b = self._number_of(left), self._number_of(right)
        return _Part(self._made(_start(sign), nodes.power, a, b), left.start)

    def _call(self, token: Token, *parts: _Part) -> _Part:
        name, at = str(token), _start(token)
        if name not in FUNCTIONS:
            if self.names is not None and name in self.names:
                message = f"{name} is not a function: must be one of the library; write {name}*( )"
                raise self._refuse(message, at)
            raise self._refuse(unknown(name, FUNCTIONS, "function"), at)
        try:
            FUNCTIONS[name].check(len(parts))
        except ExpressionError as error:
            raise self._refuse(error.reason, at) from None
        conditions = range(1, len(parts) - 1, 2) if name == "piecewise" else range(0)
        args = [
            self._condition_of(part) if i in conditions else self._number_of(part)
            for i, part in enumerate(parts)
        ]
        return _Part(self._made(at, FUNCTIONS[name], *args), at)

    # --- conditions

    def _compare(self, *parts: Any) -> _Part:
        """a < b < c is a < b and b < c."""
        result: Node | None = None
        for i in range(0, len(parts) - 2, 2):
            a, b = self._number_of(parts[i]), self._number_of(parts[i + 2])
            sign = parts[i + 1]
            node = _comparison(str(sign), a, b)
            result = node if result is None else nodes.both(result, node)
        assert result is not None
        return _Part(result, parts[0].start)

    def _both(self, left: _Part, sign: Token, right: _Part) -> _Part:
        node = nodes.both(self._condition_of(left), self._condition_of(right))
        return _Part(node, left.start)

    def _either(self, left: _Part, sign: Token, right: _Part) -> _Part:
        node = nodes.either(self._condition_of(left), self._condition_of(right))
        return _Part(node, left.start)

    def _no(self, sign: Token, part: _Part) -> _Part:
        return _Part(nodes.no(self._condition_of(part)), _start(sign))


def _start(token: Token) -> int:
    return int(token.start_pos or 0)


# --- messages ---------------------------------------------------------------------------------


def unknown(name: str, known: Iterable[str], what: str = "name") -> str:
    """What to say of a name that is not there: the nearest one, or all of them."""
    names = sorted(known)
    near = nearest(name[:64], names, count=1, cutoff=0.7)
    if what == "function" and name in SUBSTITUTES:
        remedy = f"write {SUBSTITUTES[name]}"
    elif name == "e":
        remedy = "write exp(1) for Euler's number"
    elif near:
        remedy = f"did you mean {near[0]}?"
    elif what == "name":
        remedy = "declare it as a state, an input or a parameter"
    else:
        remedy = "choose one of them"
    shown = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return f"unknown {what} {_cut(name)}: must be one of {shown}; {remedy}"


def _cut(name: str) -> str:
    return name if len(name) <= 40 else name[:37] + "..."


def _stranger(character: str) -> str:
    """What to say of a character that no token begins with."""
    if not character.isascii():
        hint = "write names and signs in ASCII, such as theta for θ"
    else:
        hint = _STRANGERS.get(character, "see the grammar of expressions")
    return f"unexpected character {character!a}: must be part of an expression; {hint}"


def _surprise(text: str, token: Token, at: int) -> str:
    """What to say of a token at a place where it cannot stand."""
    before = text[:at].rstrip()
    if token.type == "$END":
        if _unclosed(text):
            return "the expression ends early: a parenthesis is open; write )"
        return "the expression ends early: must end with a name, a number or a parenthesis"
    if token.type in ("NAME", "NUMBER", "LPAR") and (before[-1:].isalnum() or before[-1:] in "_)."):
        return "an operator is missing: must stand between two values; write * to multiply"
    if token.type == "RPAR" and text[:at].count("(") <= text[:at].count(")"):
        return "a parenthesis is closed that was not open; leave it out, or write ("
    if token.type in ("TIMES", "OVER", "POWER") and before[-1:] == "/" and token == "/":
        return "there is no integer division: must be one /"
    if token.type == "COMMA":
        return "unexpected comma: must separate the arguments of a function"
    return f"unexpected {str(token)[:40]!r}: must be a name, a number or a parenthesis"


def _unclosed(text: str) -> bool:
    return text.count("(") > text.count(")")
