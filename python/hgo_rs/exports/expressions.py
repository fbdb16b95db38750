"""Tables as text: values that are used once are folded into expressions, shared ones get names.

Both languages group `a - b - c` as `(a - b) - c`, and a compiler may not re-order it: the written
order is the table's order, and so are the roundings.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hgo_rs.exports.names import Names
from hgo_rs.exports.precision import PRECISIONS, Precision
from hgo_rs.exports.table import FUNCTIONS, Graph, Term

__all__ = [
    "LENGTH",
    "PLAIN",
    "RUST",
    "C",
    "Dialect",
    "Written",
    "number",
    "written",
]

SUM, PRODUCT, SIGN, ATOM = 1, 2, 3, 4
"""How tightly an expression holds together."""

WIDEST = 60
"""A longer expression gets a name of its own."""

LENGTH = "dt"
"""The input of a table that is the length of a step."""

_INFIX = {"add": ("+", SUM), "sub": ("-", SUM), "mul": ("*", PRODUCT), "div": ("/", PRODUCT)}
_COMPARED = {"lt": "<", "le": "<=", "eq": "=="}


def number(value: float, precision: Precision) -> str:
    """The shortest digits that give the value again."""
    text = str(precision.real(value))
    return text if re.search(r"[.en]", text) else text + ".0"


@dataclass(frozen=True)
class Dialect:
    """How one language writes what the languages write differently."""

    name: str
    """Of a helper function or an elementary function, `{}` its own name."""
    function: str
    choice: str
    """condition, yes, no."""
    finite: str
    both: str
    infinity: Mapping[str, str]
    nan: Mapping[str, str]
    absolute: Mapping[str, str]
    root: Mapping[str, str]
    suffix: Mapping[str, str]

    def literal(self, value: float, precision: Precision) -> str:
        if value != value:
            return self.nan[precision.name]
        if np.isinf(value):
            return ("-" if value < 0.0 else "") + self.infinity[precision.name]
        return number(value, precision) + self.suffix[precision.name]


C = Dialect(
    name="c",
    function="{prefix}_{name}",
    choice="{} ? {} : {}",
    finite="isfinite({0})",
    both="&&",
    # of the header's, which are of type float
    infinity={"double": "(double)INFINITY", "single": "INFINITY"},
    nan={"double": "(double)NAN", "single": "NAN"},
    absolute={"double": "fabs", "single": "fabsf"},
    root={"double": "sqrt", "single": "sqrtf"},
    suffix={"double": "", "single": "f"},
)
RUST = Dialect(
    name="rust",
    function="{name}",
    choice="if {} {{ {} }} else {{ {} }}",
    finite="{1}::is_finite({0})",
    both="&&",
    infinity={"double": "f64::INFINITY", "single": "f32::INFINITY"},
    nan={"double": "f64::NAN", "single": "f32::NAN"},
    absolute={"double": "f64::abs", "single": "f32::abs"},
    root={"double": "sqrt", "single": "sqrt"},
    suffix={"double": "", "single": ""},
)
PLAIN = Dialect(
    name="plain",
    function="{name}",
    choice="{1} if {0} else {2}",
    finite="finite({0})",
    both="and",
    infinity={"double": "inf", "single": "inf"},
    nan={"double": "nan", "single": "nan"},
    absolute={"double": "abs", "single": "abs"},
    root={"double": "sqrt", "single": "sqrt"},
    suffix={"double": "", "single": ""},
)
"""Equations in a comment."""


@dataclass(frozen=True)
class Written:
    """Names and their expressions in order, and what the outputs are called."""

    steps: list[tuple[str, str]]
    outputs: list[str]
    functions: list[str]
    """Elementary functions that are used, as the core calls them, and "min", "max", "sign"."""
    inputs: Mapping[str, str]
    """How the table's inputs are written."""


def written(
    graph: Graph,
    inputs: Mapping[str, str],
    outputs: Sequence[str],
    names: Names,
    dialect: Dialect,
    precision: str,
    prefix: str = "",
) -> Written:
    """A graph as text: how each input is written, and what the outputs are to be called."""
    wishes = dict(zip(graph.outputs[::-1], outputs[::-1], strict=True))
    return _Writer(graph, inputs, wishes, names, dialect, PRECISIONS[precision], prefix).write()


class _Writer:
    def __init__(
        self,
        graph: Graph,
        inputs: Mapping[str, str],
        wishes: Mapping[int, str],
        names: Names,
        dialect: Dialect,
        precision: Precision,
        prefix: str,
    ) -> None:
        self.graph, self.inputs, self.names = graph, inputs, names
        self.dialect, self.precision, self.prefix = dialect, precision, prefix
        self.ends = set(graph.outputs)
        self.wishes = {**self.rates(), **wishes}
        self.text: list[tuple[str, int]] = []
        self.functions: list[str] = []

    def write(self) -> Written:
        steps: list[tuple[str, str]] = []
        for index, (term, uses) in enumerate(zip(self.graph.terms, self.graph.uses(), strict=True)):
            text, holds = self.term(term)
            leaf = term.kind in ("input", "constant", "present")
            folded = uses == 1 and len(text) <= WIDEST and term.kind != "innovation"
            if not leaf and (index in self.ends or not folded):
                name = self.names.local(self.wishes.get(index) or self.wish(term))
                steps.append((name, text))
                text, holds = name, ATOM
            self.text.append((text, holds))
        outputs = [self.text[index][0] for index in self.graph.outputs]
        return Written(steps, outputs, self.functions, self.inputs)

    def rates(self) -> dict[int, str]:
        """Names for h, the rate and x + h rate, of which the stages of a scheme are made."""
        wishes: dict[int, str] = {}
        lengths: set[int] = set()
        terms = self.graph.terms
        for index, term in enumerate(terms):
            whole = [part for part in term.parts if terms[part].kind != "constant"]
            if term.kind == "input" and term.name == LENGTH:
                lengths.add(index)
            elif term.kind in _INFIX and whole and lengths.issuperset(whole):
                lengths.add(index)
                wishes[index] = "h"
            elif term.kind == "add" and terms[term.parts[0]].kind == "input":
                moved = terms[term.parts[1]]
                if moved.kind == "mul" and moved.parts[0] in lengths:
                    word = self.inputs[terms[term.parts[0]].name]
                    wishes |= {index: f"{word}_stage", moved.parts[1]: f"{word}_rate"}
        return {i: wish for i, wish in wishes.items() if terms[i].kind != "innovation"}

    def wish(self, term: Term) -> str:
        """A name that says what it is, for the simplest; `a`, `a_2`, ... for the others."""
        if term.kind == "innovation":
            return "innovation"
        words = [self.text[part][0] for part in term.parts]
        if term.kind in FUNCTIONS and all(re.fullmatch(r"\w+", word) for word in words):
            return "_".join((term.kind, *words))
        first = self.graph.terms[term.parts[0]] if term.parts else term
        if term.kind == "min" and first.kind == "max" and "(" in words[0]:
            inner = self.graph.terms[first.parts[0]]
            if inner.kind == "input":
                return f"limited_{self.inputs[inner.name]}"
        if term.kind == "mul" and words[0] == words[1] and re.fullmatch(r"[A-Za-z]\w*", words[0]):
            return f"{words[0]}_squared"
        return "a"

    def term(self, term: Term) -> tuple[str, int]:
        """The text of a term, and how tightly it holds together."""
        dialect, kind, parts = self.dialect, term.kind, term.parts
        if kind == "input":
            return self.inputs[term.name], ATOM
        if kind == "constant":
            negative = bool(np.signbit(term.value)) and term.value == term.value
            return dialect.literal(term.value, self.precision), SIGN if negative else ATOM
        if kind in _INFIX:
            sign, rank = _INFIX[kind]
            return f"{self.held(parts[0], rank)} {sign} {self.held(parts[1], rank + 1)}", rank
        if kind == "neg":
            return f"-{self.held(parts[0], ATOM)}", SIGN
        if kind in _COMPARED:
            one, zero = (dialect.literal(v, self.precision) for v in (1.0, 0.0))
            return dialect.choice.format(self.condition(term), one, zero), 0
        if kind == "select":
            # in Rust each stands in braces
            rank = 0 if dialect is RUST else SUM
            chosen = [self.held(part, rank) for part in parts[1:]]
            return dialect.choice.format(self.truth(parts[0]), *chosen), 0
        if kind == "present":
            each = (dialect.finite.format(self.text[p][0], self.precision.rust) for p in parts)
            return f" {dialect.both} ".join(each), 0
        if kind == "innovation":
            zero = dialect.literal(0.0, self.precision)
            apart = f"{self.held(parts[0], SUM)} - {self.held(parts[1], PRODUCT)}"
            return dialect.choice.format(
                dialect.finite.format(self.text[parts[0]][0], self.precision.rust), apart, zero
            ), 0
        return f"{self.function(kind)}({', '.join(self.text[part][0] for part in parts)})", ATOM

    def function(self, kind: str) -> str:
        if kind == "abs":
            return self.dialect.absolute[self.precision.name]
        if kind == "copysign" and self.dialect.name != "plain":
            single = self.precision.name == "single"
            in_c = "copysignf" if single else "copysign"
            return in_c if self.dialect.name == "c" else f"{self.precision.rust}::copysign"
        if kind == "sqrt" and self.dialect.name == "c":
            return self.dialect.root[self.precision.name]
        name = FUNCTIONS.get(kind, kind)
        if name not in self.functions:
            self.functions.append(name)
        return self.dialect.function.format(prefix=self.prefix, name=name)

    def held(self, index: int, rank: int) -> str:
        """An operand, in parentheses where it holds less tightly than it must."""
        text, holds = self.text[index]
        return text if holds >= rank else f"({text})"

    def condition(self, term: Term) -> str:
        left, right = (self.held(part, SUM) for part in term.parts)
        return f"{left} {_COMPARED[term.kind]} {right}"

    def truth(self, index: int) -> str:
        """A condition: the comparison itself where it is written here."""
        term, text = self.graph.terms[index], self.text[index][0]
        if term.kind == "present":
            return text
        if term.kind in _COMPARED and not re.fullmatch(r"\w+", text):
            return self.condition(term)
        return f"{self.held(index, SUM)} != {self.dialect.literal(0.0, self.precision)}"
