"""Expressions: from text, SymPy or a traced callable to a table that the core evaluates.

`parse` reads a string, `from_sympy` walks a SymPy expression, `tracing` calls a callable with
symbols; all give a `Node`. From nodes come `compile_table` (for the core), `evaluate` (NumPy),
`derivative`, `bounds` (interval arithmetic), `text` and `latex`.
"""

from __future__ import annotations

from hgo_rs.expressions.derivative import derivative, gradient
from hgo_rs.expressions.errors import ExpressionError, UntraceableError
from hgo_rs.expressions.from_sympy import from_sympy
from hgo_rs.expressions.grammar import parse
from hgo_rs.expressions.interval import bounds, jumps
from hgo_rs.expressions.library import CONSTANTS, FUNCTIONS, RESERVED
from hgo_rs.expressions.nodes import Node, symbols
from hgo_rs.expressions.numeric import evaluate
from hgo_rs.expressions.printing import latex, text
from hgo_rs.expressions.table import compile_table

__all__ = [
    "CONSTANTS",
    "FUNCTIONS",
    "RESERVED",
    "ExpressionError",
    "Node",
    "UntraceableError",
    "bounds",
    "compile_table",
    "derivative",
    "evaluate",
    "from_sympy",
    "gradient",
    "jumps",
    "latex",
    "parse",
    "symbols",
    "text",
]
