"""A system as text: what `print(model)` shows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from hgo_rs.expressions import nodes
from hgo_rs.expressions.errors import ExpressionError
from hgo_rs.expressions.nodes import Node
from hgo_rs.expressions.printing import latex

if TYPE_CHECKING:
    from hgo_rs.own.base import OwnSystem

__all__ = ["as_latex", "as_text"]


def as_text(system: OwnSystem, title: str) -> str:
    """Equations, parameters, Jacobian and structure."""
    lines = [title, *_names(system)]
    if not system.compiled:
        return "\n".join([*lines, f"  runs as Python, slowly: {system.why_not_compiled}"])
    lines.append("  equations")
    lines += [f"    {left} = {right}" for left, right in system.shown_equations()]
    jacobian = system.jacobian()
    lines.append("  Jacobian (where it is not 0)")
    for label, row in zip(system.known_names, jacobian.rows, strict=True):
        for name, entry in zip(jacobian.names, row, strict=True):
            if entry.number != 0.0:
                lines.append(f"    d({label})/d({name}) = {entry}")
    return "\n".join([*lines, *_structure(system)])


def _names(system: OwnSystem) -> Iterable[str]:
    yield f"  states      {', '.join(system.states)}"
    if system.inputs:
        yield f"  inputs      {', '.join(system.inputs)}"
    if system.parameters:
        yield f"  parameters  {', '.join(f'{k} = {v:.9g}' for k, v in system.parameters.items())}"


def _structure(system: OwnSystem) -> Iterable[str]:
    for name in system.inputs:
        try:
            degree = system.relative_degree(name)
            shown = "none: it does not reach the output" if degree is None else str(degree)
        except ExpressionError as error:
            shown = f"not found, {error}"
        yield f"  relative degree of {name}: {shown}"
    for node in nodes.order(node for group in system.equations.values() for node in group):
        if node.op in ("sign", "atan2"):
            yield f"  jumps: {node}; no Lipschitz bound across it"


def as_latex(equations: Sequence[tuple[str, Node]]) -> str:
    """The equations, aligned."""
    rows = [rf"{left} &= {latex(right)}" for left, right in equations]
    return r"\begin{aligned} " + r" \\ ".join(rows) + r" \end{aligned}"
