"""The core's elementary functions, read from their source.

`_core.ELEMENTARY` is the text of the file that the core itself is compiled from (sine, exponential
and so on from sums, products, bit patterns and selections). This module reads the few forms of Rust
that the file is written in: its macros are expanded, its functions parsed. Exports print them, so
that no second copy of a polynomial exists. A form that is not known here is refused by name.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from hgo_rs import _core
from hgo_rs.errors import HgoError

__all__ = ["PRECISIONS", "Const", "Elementary", "Function", "Node", "Precision", "Statement"]


@dataclass(frozen=True)
class Precision:
    """How one precision is called."""

    name: str
    rust: str
    bits: str
    module: str
    width: int
    real: type[np.floating[Any]]
    formats: tuple[str, str]


PRECISIONS = {
    "double": Precision("double", "f64", "u64", "double", 64, np.float64, ("<d", "<Q")),
    "single": Precision("single", "f32", "u32", "single", 32, np.float32, ("<f", "<I")),
}

# --- tokens and macros ------------------------------------------------------------------------

_TOKEN = re.compile(
    r"(?P<space>(?:\s+|//[^\n]*)+)"
    r"|(?P<number>\d[\d_]*(?:\.\d[\d_]*)?(?:e-?\d+)?(?:_?[uf]\d+)?)"
    r"|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<sign>=>|->|::|<<|>>|<=|>=|==|!=|&&|\|\||[-+*/^&|]=|\.\.|[^\s\w])"
)
_MARK = "#"
"""Between a name of a macro's own and the number of the macro's call: no name has it."""
_CLOSES = {"(": ")", "[": "]", "{": "}"}


@dataclass(frozen=True)
class Token:
    """A word of the source and the white space and comments in front of it."""

    text: str
    kind: str
    lead: str = ""


def _tokens(text: str) -> list[Token]:
    found, lead = [], ""
    for match in _TOKEN.finditer(text):
        if match.lastgroup == "space":
            lead = match[0]
        else:
            found.append(Token(match[0], str(match.lastgroup), lead))
            lead = ""
    return found


def _text(tokens: Sequence[Token]) -> str:
    """The source of these tokens, without what stands in front of them."""
    return "".join(token.lead + token.text for token in tokens).removeprefix(tokens[0].lead)


def _refuse(what: str) -> HgoError:
    return HgoError(f"the source of the elementary functions: {what} is not understood")


def _end(tokens: Sequence[Token], start: int) -> int:
    """The place of the bracket that closes the one at `start`."""
    depth = 0
    for i in range(start, len(tokens)):
        depth += tokens[i].text in _CLOSES
        depth -= tokens[i].text in _CLOSES.values()
        if depth == 0:
            return i
    raise _refuse("a bracket without its partner")


def _expression_end(tokens: Sequence[Token], start: int) -> int:
    """Where an expression ends that stands in a macro's arguments."""
    i = start
    while i < len(tokens) and tokens[i].text not in (",", ";", *_CLOSES.values()):
        i = _end(tokens, i) + 1 if tokens[i].text in _CLOSES else i + 1
    return i


Bound = dict[str, Any]
"""A macro's variables: tokens, or a list of such where they repeat."""


def _repetition(tokens: Sequence[Token], i: int) -> tuple[Sequence[Token], str, int]:
    """The parts of `$( inner ) separator *`, which begins at i, and where it ends."""
    close = _end(tokens, i + 1)
    separator = "" if tokens[close + 1].text in "*+" else tokens[close + 1].text
    return tokens[i + 2 : close], separator, close + (3 if separator else 2)


def _variables(pattern: Sequence[Token]) -> list[str]:
    pairs = pairwise(pattern)
    return [word.text for sign, word in pairs if sign.text == "$" and word.kind == "name"]


def _match(pattern: Sequence[Token], given: Sequence[Token], j: int) -> tuple[Bound, int] | None:
    """What a pattern's variables stand for from place j on, and where it ends; None: no fit."""
    bound: Bound = {}
    i = 0
    while i < len(pattern):
        if pattern[i].text == "$" and pattern[i + 1].text == "(":
            inner, separator, i = _repetition(pattern, i)
            bound.update({name: [] for name in _variables(inner)})
            while (row := _match(inner, given, j)) is not None and row[1] > j:
                for name, value in row[0].items():
                    bound[name].append(value)
                j = row[1]
                if separator:
                    if j >= len(given) or given[j].text != separator:
                        break
                    j += 1
        elif pattern[i].text == "$":
            name, kind = pattern[i + 1].text, pattern[i + 3].text
            stop = j + 1
            if kind == "expr":
                stop = _expression_end(given, j)
            elif kind == "literal" and j < len(given) and given[j].text == "-":
                stop = j + 2
            fits = j < stop <= len(given) and (kind != "ident" or given[j].kind == "name")
            if not fits:
                return None
            bound[name] = list(given[j:stop])
            i, j = i + 4, stop
        elif j < len(given) and given[j].text == pattern[i].text:
            i, j = i + 1, j + 1
        else:
            return None
    return bound, j


def _is_rows(value: list[Any]) -> bool:
    return not isinstance(value[0], Token)


def _fill(body: Sequence[Token], bound: Bound) -> list[Token]:
    """A macro's body with its variables replaced."""
    out: list[Token] = []
    i = 0
    while i < len(body):
        token = body[i]
        if token.text == "$" and body[i + 1].text == "(":
            inner, separator, i = _repetition(body, i)
            repeated = [
                name for name in _variables(inner) if not bound[name] or _is_rows(bound[name])
            ]
            for k in range(len(bound[repeated[0]])):
                row = _fill(inner, {**bound, **{name: bound[name][k] for name in repeated}})
                out += [Token(separator, "sign")] if separator and k else []
                out += [Token(row[0].text, row[0].kind, " " if k else token.lead), *row[1:]]
        elif token.text == "$":
            value = bound[body[i + 1].text]
            out += [Token(value[0].text, value[0].kind, token.lead), *value[1:]]
            i += 2
        else:
            out.append(token)
            i += 1
    return out


def _grouped(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _grouped(inner) for name, inner in value.items()}
    if not value or _is_rows(value):
        return [_grouped(inner) for inner in value]
    return value if len(value) == 1 else [Token("(", "sign"), *value, Token(")", "sign")]


@dataclass(frozen=True)
class Macro:
    """A `macro_rules!`: its arms, and the text that defines it."""

    arms: list[tuple[list[Token], list[Token]]]
    source: str

    def expand(self, given: Sequence[Token], number: int | None = None) -> list[Token]:
        """What a call stands for.

        With a number, as an expression: what a variable stands for is in parentheses, and names
        that the body itself gives carry the number, so that they are not those of an argument.
        """
        for pattern, body in self.arms:
            found = _match(pattern, given, 0)
            if found is not None and found[1] == len(given):
                if number is None:
                    return _fill(body, found[0])
                return _fill(_numbered(body, number), _grouped(found[0]))
        raise _refuse(f"the macro call {_text(given)[:60]!r}")


def _numbered(body: Sequence[Token], number: int) -> list[Token]:
    own: set[str] = set()
    for i, token in enumerate(body):
        if token.text == "let":
            end = _end(body, i + 1) if body[i + 1].text == "(" else i + 1
            own |= {word.text for word in body[i + 1 : end + 1] if word.kind == "name"}
    out: list[Token] = []
    for i, token in enumerate(body):
        is_own = token.text in own and (i == 0 or body[i - 1].text != "$")
        text = f"{token.text}{_MARK}{number}" if is_own else token.text
        out.append(Token(text, token.kind, token.lead))
    return out


def _macros(tokens: Sequence[Token]) -> dict[str, Macro]:
    found = {}
    for i, token in enumerate(tokens):
        if token.text != "macro_rules":
            continue
        close = _end(tokens, i + 3)
        arms, j = [], i + 4
        while j < close:
            end = _end(tokens, j)
            body_end = _end(tokens, end + 2)
            arms.append((list(tokens[j + 1 : end]), list(tokens[end + 3 : body_end])))
            j = body_end + (2 if tokens[body_end + 1].text == ";" else 1)
        found[tokens[i + 2].text] = Macro(arms, _text(tokens[i : close + 1]))
    return found


# --- syntax -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Node:
    """An expression: `kind` is number, name, path, unary, binary, call, method, cast, if, tuple or
    array; `text` its word; `parts` its operands.
    """

    kind: str
    text: str
    parts: tuple[Node, ...] = ()


@dataclass(frozen=True)
class Statement:
    """`names = value`, or `name op= value`, or (kind "result") a value; with its comment."""

    kind: str
    names: tuple[str, ...]
    value: Node
    comment: str = ""


@dataclass(frozen=True)
class Const:
    """A named number: its type and its text as in the source."""

    name: str
    type: str
    value: Node
    source: str


@dataclass(frozen=True)
class Function:
    """A function: arguments (name, type), types of its results, statements, doc comment, text,
    and the macros that it is made with.
    """

    name: str
    arguments: tuple[tuple[str, str], ...]
    results: tuple[str, ...]
    body: tuple[Statement, ...]
    consts: tuple[Const, ...]
    comment: str
    source: str
    macros: frozenset[str]


_RANKS = [("||",), ("&&",), ("==", "!=", "<", ">", "<=", ">="), ("|",), ("^",), ("&",),
          ("<<", ">>"), ("+", "-"), ("*", "/")]  # fmt: skip
_ASSIGN = ("+=", "-=", "*=", "/=")


@dataclass
class _Scope:
    """What the parts of one function share."""

    macros: dict[str, Macro]
    uses: dict[str, str] = field(default_factory=dict)
    hoisted: list[Statement] = field(default_factory=list)
    """Statements of blocks inside of an expression: they go in front of it."""
    calls: int = 0
    used: set[str] = field(default_factory=set)
    """Macros that were called."""
    taken: set[str] = field(default_factory=set)
    """Names of the function: a block's own names become others."""
    inner: list[dict[str, Node]] = field(default_factory=list)
    """What the names of the blocks around stand for, the innermost last."""
    closures: dict[str, tuple[list[str], Node]] = field(default_factory=dict)


class _Parser:
    def __init__(self, tokens: Sequence[Token], scope: _Scope) -> None:
        self.tokens, self.scope, self.at = list(tokens), scope, 0

    # words
    def peek(self, ahead: int = 0) -> str:
        i = self.at + ahead
        return self.tokens[i].text if i < len(self.tokens) else ""

    def next(self) -> Token:
        if self.at >= len(self.tokens):
            raise _refuse("its end")
        self.at += 1
        return self.tokens[self.at - 1]

    def take(self, *texts: str) -> bool:
        if self.peek() in texts:
            self.at += 1
            return True
        return False

    def need(self, text: str) -> None:
        if not self.take(text):
            raise _refuse(f"{self.peek()!r} where {text!r} should stand")

    def skip_group(self) -> list[Token]:
        end = _end(self.tokens, self.at)
        inner = self.tokens[self.at + 1 : end]
        self.at = end + 1
        return inner

    def comment(self) -> str:
        lead = self.tokens[self.at].lead if self.at < len(self.tokens) else ""
        lines = [line.strip().lstrip("/").strip() for line in lead.splitlines() if "//" in line]
        return " ".join(lines)

    # items
    def items(self) -> Iterator[Const | Function]:
        while self.at < len(self.tokens):
            comment = self.comment()
            while self.peek() == "#":
                self.at += 1
                self.skip_group()
            start = self.at
            if self.take("pub") and self.peek() == "(":
                self.skip_group()
            if self.take("use"):
                self.use()
            elif self.take("const"):
                yield self.const()
            else:
                yield self.function(comment, start)

    def use(self) -> None:
        """`use a::b::{C, D};`: what each name stands for."""
        path: list[str] = []
        while not self.take(";"):
            if self.peek() == "{":
                for token in self.skip_group():
                    if token.kind == "name":
                        self.scope.uses[token.text] = "::".join([*path, token.text])
            elif (token := self.next()).kind == "name":
                path.append(token.text)

    def const(self) -> Const:
        start = self.at - 1
        name = self.next().text
        self.need(":")
        kind = self.next().text
        self.need("=")
        value = self.expression()
        self.need(";")
        return Const(name, kind, value, _text(self.tokens[start : self.at]))

    def types(self) -> tuple[str, ...]:
        if self.peek() == "(":
            return tuple(t.text for t in self.skip_group() if t.kind == "name")
        return (self.next().text,)

    def function(self, comment: str, start: int) -> Function:
        self.need("fn")
        name = self.next().text
        words = [token.text for token in self.skip_group() if token.kind == "name"]
        arguments = tuple(zip(words[::2], words[1::2], strict=True))
        self.need("->")
        results = self.types()
        end = _end(self.tokens, self.at)
        source = _text(self.tokens[start : end + 1])
        scope = _Scope(self.scope.macros, taken={name for name, _ in arguments})
        body, consts = _Parser(self.skip_group(), scope).body()
        macros = frozenset(scope.used)
        return Function(name, arguments, results, body, consts, comment, source, macros)

    def body(self) -> tuple[tuple[Statement, ...], tuple[Const, ...]]:
        statements: list[Statement] = []
        consts: list[Const] = []
        while self.at < len(self.tokens):
            comment = self.comment()
            while self.take("#"):
                self.skip_group()
            made: list[Statement] = []
            if self.take("use"):
                self.use()
            elif self.take("const"):
                consts.append(self.const())
            elif self.take("let"):
                made = self.let(comment)
            elif self.take("for"):
                made = self.unrolled(comment)
            elif self.peek(1) in _ASSIGN:
                name, operator = self.next().text, self.next().text
                value = Node("binary", operator[0], (Node("name", name), self.expression()))
                made = [Statement("let", (name,), value, comment)]
                self.need(";")
            else:
                made = [Statement("result", (), self.expression(), comment)]
            statements += [*self.scope.hoisted, *made]
            self.scope.hoisted.clear()
        return tuple(statements), tuple(consts)

    def let(self, comment: str) -> list[Statement]:
        names = self.pattern()
        self.need("=")
        if self.take("|"):  # a closure: it is written out where it is called
            words = [self.next().text]
            while not self.take("|"):
                words.append(self.next().text)
            parameters = [word for word in words if word not in (":", ",")][::2]
            self.scope.closures[names[0]] = (parameters, self.expression())
            self.need(";")
            return []
        value = self.expression()
        self.need(";")
        self.scope.taken.update(names)
        return [Statement("let", names, value, comment)]

    def pattern(self) -> tuple[str, ...]:
        if self.peek() == "(":
            return tuple(t.text for t in self.skip_group() if t.kind == "name")
        self.take("mut")
        return (self.next().text,)

    def unrolled(self, comment: str) -> list[Statement]:
        """`for name in [..] { .. }`, once for each entry."""
        name = self.next().text
        self.need("in")
        entries = self.expression().parts
        inner = self.skip_group()
        out: list[Statement] = []
        for entry in entries:
            for statement in _Parser(inner, self.scope).body()[0]:
                value = _replaced(statement.value, name, entry)
                out.append(Statement("let", statement.names, value, comment))
                comment = ""
        return out

    # expressions
    def expression(self, rank: int = 0) -> Node:
        if rank == len(_RANKS):
            return self.cast()
        left = self.expression(rank + 1)
        while self.peek() in _RANKS[rank]:
            operator = self.next().text
            left = Node("binary", operator, (left, self.expression(rank + 1)))
        return left

    def cast(self) -> Node:
        value = self.unary()
        while self.take("as"):
            value = Node("cast", self.next().text, (value,))
        return value

    def unary(self) -> Node:
        if self.peek() in ("-", "!"):
            return Node("unary", self.next().text, (self.unary(),))
        value = self.primary()
        while self.take("."):
            method = self.next().text
            value = Node("method", method, (value, *self.arguments()))
        return value

    def arguments(self) -> tuple[Node, ...]:
        inner = _Parser(self.skip_group(), self.scope)
        found: list[Node] = []
        while inner.at < len(inner.tokens):
            found.append(inner.expression())
            inner.take(",")
        return tuple(found)

    def block(self) -> Node:
        """The value of a block; its statements go in front of the one that it stands in."""
        inner, known = _Parser(self.skip_group(), self.scope), dict[str, Node]()
        self.scope.inner.append(known)
        while inner.take("let"):
            names = inner.pattern()
            inner.need("=")
            value = inner.expression()
            inner.need(";")
            values = value.parts if value.kind == "tuple" else (value,)
            known.update({n: self.hoist(n, v) for n, v in zip(names, values, strict=True)})
        value = inner.expression()
        self.scope.inner.pop()
        if inner.at != len(inner.tokens):
            raise _refuse("a block with more than `let` in front of its value")
        return value

    def hoist(self, name: str, value: Node) -> Node:
        """What stands for a name of a block: a name, or a new one that gets the value."""
        if value.kind in ("name", "number"):
            return value
        wish = name.split(_MARK)[0]
        new, count = wish, 1
        while new in self.scope.taken:
            count += 1
            new = f"{wish}_{count}"
        self.scope.taken.add(new)
        self.scope.hoisted.append(Statement("let", (new,), value))
        return Node("name", new)

    def primary(self) -> Node:
        if self.peek() == "(":
            found = self.arguments()
            return found[0] if len(found) == 1 else Node("tuple", "", found)
        if self.peek() == "{":
            return self.block()
        if self.peek() == "[":
            return Node("array", "", self.arguments())
        if self.take("if"):
            condition, yes = self.expression(), self.block()
            self.need("else")
            other = self.primary() if self.peek() == "if" else self.block()
            return Node("if", "", (condition, yes, other))
        token = self.next()
        if token.kind == "number":
            return Node("number", token.text)
        if token.kind != "name":
            raise _refuse(repr(token.text))
        if self.peek() == "!" and self.peek(1) in _CLOSES:
            self.at += 1
            return self.expanded(token.text)
        path = [token.text]
        while self.take("::"):
            path.append(self.next().text)
        if self.peek() == "(":
            arguments = self.arguments()
            if token.text in self.scope.closures:
                parameters, value = self.scope.closures[token.text]
                for name, argument in zip(parameters, arguments, strict=True):
                    value = _replaced(value, name, argument)
                return value
            return Node("call", "::".join(path), arguments)
        for known in reversed(self.scope.inner):
            if token.text in known and len(path) == 1:
                return known[token.text]
        return Node("name" if len(path) == 1 else "path", "::".join(path))

    def expanded(self, name: str) -> Node:
        """The value of a macro call."""
        if name not in self.scope.macros:
            raise _refuse(f"the macro {name}!")
        self.scope.calls += 1
        self.scope.used.add(name)
        tokens = self.scope.macros[name].expand(self.skip_group(), self.scope.calls)
        inner = _Parser(tokens, self.scope)
        value = inner.expression()
        if inner.at != len(inner.tokens):
            raise _refuse(f"the macro {name}!, which is more than an expression,")
        return value


def _replaced(node: Node, name: str, value: Node) -> Node:
    if node.kind == "name" and node.text == name:
        return value
    return Node(node.kind, node.text, tuple(_replaced(part, name, value) for part in node.parts))


# --- the functions of one precision -----------------------------------------------------------

_CONSTANTS = {
    "LOG2_E": math.log2(math.e),
    "LN_2": math.log(2.0),
    "FRAC_1_SQRT_2": math.sqrt(0.5),
    "FRAC_2_PI": 2.0 / math.pi,
    "FRAC_1_PI": 1.0 / math.pi,
    "PI": math.pi,
    "FRAC_PI_2": math.pi / 2.0,
    "FRAC_PI_4": math.pi / 4.0,
    "INFINITY": math.inf,
    "NEG_INFINITY": -math.inf,
    "NAN": math.nan,
}


@dataclass(frozen=True)
class Elementary:
    """The functions of one precision. Make it with `Elementary.read`."""

    precision: Precision
    functions: dict[str, Function]
    consts: dict[str, Const]
    macros: dict[str, Macro]
    uses: dict[str, str]
    """Names from Rust's library, and their paths."""
    _known: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, precision: str) -> Elementary:
        """The functions that the core was compiled from."""
        return _read(_core.ELEMENTARY, precision)

    def needed(self, names: Sequence[str]) -> tuple[list[Const], list[Function]]:
        """These functions and what they use, in the order of the source."""
        used: set[str] = set()
        waiting = list(names)
        while waiting:
            name = waiting.pop()
            if name in used:
                continue
            used.add(name)
            if name in self.functions:
                function = self.functions[name]
                values = [s.value for s in function.body] + [c.value for c in function.consts]
                waiting += [word for value in values for word in _words(value)]
            elif name in self.consts:
                waiting += _words(self.consts[name].value)
        for name in names:
            if name not in self.functions:
                raise HgoError(f"the core has no elementary function {name!r} to export")
        return (
            [const for name, const in self.consts.items() if name in used],
            [function for name, function in self.functions.items() if name in used],
        )

    # values of constants: a real is a NumPy scalar, bits are an int

    def number(self, text: str) -> Any:
        """A number of the source: a real, or bits."""
        plain = re.sub(r"_?[uf]\d+$", "", text).replace("_", "")
        return self.precision.real(plain) if re.search(r"[.e]", plain) else int(plain)

    def named(self, text: str) -> Any:
        """A constant of the source or of Rust's library, by name or path."""
        if text in self._known:
            return self._known[text]
        last, kind = text.split("::")[-1], self.precision.real
        if last in self.consts:
            value = self.value(self.consts[last].value, {})
        elif last in _CONSTANTS:
            value = kind(_CONSTANTS[last])
        elif last == "BITS":
            value = self.precision.width
        elif last == "MAX":
            value = np.finfo(kind).max
        elif last == "MIN_POSITIVE":
            value = np.finfo(kind).tiny
        else:
            raise _refuse(f"the constant {text}")
        self._known[text] = value
        return value

    def to_bits(self, value: Any) -> int:
        real, whole = self.precision.formats
        return int(struct.unpack(whole, struct.pack(real, value))[0])

    def value(self, node: Node, scope: dict[str, Any]) -> Any:
        """The value of an expression of numbers and constants."""
        if node.kind == "number":
            return self.number(node.text)
        if node.kind in ("name", "path"):
            return scope[node.text] if node.text in scope else self.named(node.text)
        parts = [self.value(part, scope) for part in node.parts]
        if node.kind == "cast":
            return self.precision.real(parts[0])
        operation = _OPERATIONS.get((node.text, len(parts)))
        if operation is None:
            raise _refuse(f"the constant expression {node.text}")
        value = operation(self, *parts)
        return value & ((1 << self.precision.width) - 1) if type(value) is int else value


_OPERATIONS: dict[tuple[str, int], Callable[..., Any]] = {
    ("+", 2): lambda _, a, b: a + b,
    ("-", 2): lambda _, a, b: a - b,
    ("*", 2): lambda _, a, b: a * b,
    ("/", 2): lambda _, a, b: a / b,
    ("<<", 2): lambda _, a, b: a << b,
    (">>", 2): lambda _, a, b: a >> b,
    ("-", 1): lambda _, a: -a,
    ("to_bits", 1): lambda self, a: self.to_bits(a),
}


def _words(node: Node) -> list[str]:
    """The functions that an expression calls, and the constants that it uses."""
    own = [node.text] if node.kind == "call" or node.text.isupper() else []
    return own + [word for part in node.parts for word in _words(part)]


@cache
def _read(source: str, precision: str) -> Elementary:
    tokens = _tokens(source)
    macros = _macros(tokens)
    chosen = PRECISIONS[precision]
    for i, token in enumerate(tokens):
        if token.text == "mod" and tokens[i + 1].text == chosen.module:
            inside = tokens[i + 3 : _end(tokens, i + 2)]
            break
    else:
        raise _refuse(f"a file without the module {chosen.module}")
    called = [token.text for token in inside].index("elementary") + 2
    body = macros["elementary"].expand(inside[called + 1 : _end(inside, called)])
    scope = _Scope(macros)
    items = list(_Parser(body, scope).items())
    return Elementary(
        chosen,
        {item.name: item for item in items if isinstance(item, Function)},
        {item.name: item for item in items if isinstance(item, Const)},
        {name: macro for name, macro in macros.items() if name != "elementary"},
        scope.uses,
    )
