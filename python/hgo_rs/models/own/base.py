"""What the user's own models and plants share."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, explain
from hgo_rs.expressions import nodes
from hgo_rs.expressions.errors import ExpressionError
from hgo_rs.expressions.grammar import MAX_LENGTH, unknown
from hgo_rs.expressions.nodes import Node, symbol
from hgo_rs.expressions.printing import LONGEST, latex, text
from hgo_rs.expressions.table import compile_table
from hgo_rs.models.own import analysis
from hgo_rs.models.own.analysis import Jacobian
from hgo_rs.models.own.names import Names
from hgo_rs.models.own.sources import Group
from hgo_rs.models.papers import System
from hgo_rs.read_only import ReadOnlyDict

if TYPE_CHECKING:
    from typing_extensions import Self

Array = npt.NDArray[np.float64]


class OwnSystem(System):
    """Names, right-hand sides and their table; the base of `Model` and `Plant`."""

    _names: Names
    _groups: dict[str, Group]
    _table: dict[str, Any] | None
    _of_table: tuple[str, ...]

    def _compile(
        self,
        inputs: Mapping[str, str],
        groups: Sequence[Group],
        more: Mapping[str, Node] | None = None,
    ) -> None:
        """Make the table of the groups, if all of them are expressions.

        ``inputs``: symbol -> name of the table's input; the parameters are added. ``more``: outputs
        that follow from the groups, by name.
        """
        more = more or {}
        self._groups = {group.name: group for group in groups}
        self._of_table = tuple(inputs)
        self._table = None
        if not self.compiled:
            return
        parameters = self._names.parameters
        table = compile_table(
            [*(node for group in groups for node in group.nodes or ()), *more.values()],
            {**inputs, **{name: name for name in parameters}},
            [*(label for group in groups for label in group.labels(group.name)), *more],
            fixed=tuple(parameters),
        )
        self._table = ReadOnlyDict(table)

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        return self._names.states

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self._names.inputs

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of those states that are unknowns of a `Model`."""
        return ()

    @property
    def parameters(self) -> dict[str, float]:
        """Names and values of the parameters."""
        return dict(self._names.parameters)

    @property
    def n_u(self) -> int:
        """Number of known inputs."""
        return len(self._names.inputs)

    @property
    def compiled(self) -> bool:
        """Whether all right-hand sides are compiled expressions."""
        return all(group.nodes is not None for group in self._groups.values())

    @property
    def groups(self) -> Mapping[str, Group]:
        """The right-hand sides by name."""
        return self._groups

    @property
    def arguments(self) -> tuple[str, ...]:
        """What the right-hand sides depend on: the inputs of the table but the parameters."""
        return self._of_table

    @property
    def why_not_compiled(self) -> str:
        """The reason why a callable was not compiled; empty for a compiled system."""
        reasons = [f"{name}: {g.reason}" for name, g in self._groups.items() if g.reason]
        return "; ".join(reasons)

    @property
    def callables(self) -> dict[str, Callable[..., Array]]:
        """Right-hand side -> Python function of its arguments that gives a 1-D array.

        Empty for a compiled one. The parameters are bound to their values; x, z and u are 1-D
        arrays.
        """
        if self.compiled:
            return {}
        values = self._names.parameters
        return {name: group.call(values) for name, group in self._groups.items()}

    @property
    def equations(self) -> dict[str, tuple[Node, ...]]:
        """Right-hand side -> its expressions; HgoError where one is not compiled."""
        self._need_expressions()
        return {name: group.nodes or () for name, group in self._groups.items()}

    def _need_expressions(self, *groups: Group) -> None:
        """Refuse a system, or groups of it, with a callable that is not compiled."""
        reasons = [f"{g.name}: {g.reason}" for g in groups or self._groups.values() if g.reason]
        if reasons:
            raise HgoError(
                f"{type(self).__name__} is not compiled ({'; '.join(reasons)}): must be made of "
                "expressions for this; write it with np.where, np.maximum, np.sin and the like"
            )

    def not_finite(self, values: Mapping[str, float]) -> list[tuple[str, str]]:
        """Label and text of each right-hand side that is no finite number for these values by name.

        What depends on a value that is not given, or is NaN, is left out.
        """
        known = {name: value for name, value in values.items() if not np.isnan(value)}
        known |= self._names.parameters
        found = []
        for name, group in self._groups.items():
            for label, shown, call in group.entries(name, self._names.parameters):
                value = call(known)
                if value is not None and not np.isfinite(value):
                    found.append((label, shown))
        return found

    def shown_sides(self) -> list[tuple[str, str]]:
        """Label and text of each right-hand side."""
        groups, parameters = self._groups.items(), self._names.parameters
        return [
            (label, shown)
            for name, group in groups
            for label, shown, _ in group.entries(name, parameters)
        ]

    def with_parameters(self, values: Mapping[str, float] | None = None, /, **named: float) -> Self:
        """The same system with other values of some parameters; the table is shared.

        Raises
        ------
        HgoError
            A name that is no parameter (with the nearest one); a value that is not finite.
        """
        new = copy.copy(self)
        new._names = self._names.changed({**(values or {}), **named})
        return new

    # --- what follows from the equations ------------------------------------------------------

    @property
    def drift(self) -> tuple[Node, ...]:
        """dx/dt, one expression a state."""
        raise NotImplementedError

    @property
    def outputs(self) -> tuple[Node, ...]:
        """y, one expression a measured output."""
        raise NotImplementedError

    @property
    def known(self) -> tuple[Node, ...]:
        """The terms that an observer adds to its own structure: phi, f or f2; for a plant the
        drift."""
        raise NotImplementedError

    @property
    def known_names(self) -> tuple[str, ...]:
        """What to call each entry of `known`."""
        raise NotImplementedError

    def jacobian(self) -> Jacobian:
        """The derivatives of `known` with respect to the states: `rows` of expressions.

        Call it with values by name for numbers: model.jacobian()(q=0.1, v=0.0). At a kink it is the
        slope of the active branch; abs has the slope +1 at 0.
        """
        return Jacobian(self.known, self.states, self._names.parameters)

    def lipschitz(self, box: Mapping[str, tuple[float, float]], *, rtol: float = 0.01) -> float:
        """A Lipschitz constant of `known` on a box: |f(x) - f(z)| <= L |x - z|, Euclidean norms.

        Guaranteed, by interval arithmetic with outward rounding over the Jacobian, for the present
        values of the parameters.

        Parameters
        ----------
        box : dict of name -> (low, high)
            The states, inputs and t that the slope depends on; the others may be left out.
        rtol : float
            The box is divided until the bound is this close to a slope that is attained, into at
            most 20 000 pieces; the bound of a model of many states may be less tight.

        Raises
        ------
        HgoError
            A name without bounds; a part that may jump in the box (sign, or piecewise that is not
            seen to be continuous); a slope that is not bounded.
        """
        others = ("t", *self.inputs)
        parameters = self._names.parameters
        return analysis.lipschitz(self.known, self.states, others, parameters, box, rtol)

    def relative_degree(self, name: str | None = None) -> int | None:
        """How often the outputs must be differentiated until an input appears.

        Parameters
        ----------
        name : name of the input, optional
            Default: the one that appears first.

        Returns
        -------
        int or None
            The smallest over the outputs; None where no input reaches them.
        """
        if name is not None and name not in self.inputs:
            raise HgoError(unknown(name, self.inputs, "input"))
        found = [
            analysis.relative_degree(self.drift, y, self.states, u)
            for y in self.outputs
            for u in (self.inputs if name is None else (name,))
        ]
        return min((degree for degree in found if degree is not None), default=None)

    def shown_equations(self) -> list[tuple[str, Node]]:
        """Left-hand sides as text, and expressions."""
        shown = [(f"{name}'", node) for name, node in zip(self.states, self.drift, strict=True)]
        outputs = self.outputs
        labels = ["y"] if len(outputs) == 1 else [f"y[{i}]" for i in range(len(outputs))]
        return shown + list(zip(labels, outputs, strict=True))

    def latex(self) -> str:
        """The equations in LaTeX, aligned."""
        rows = []
        for left, node in self.shown_equations():
            shown = latex(symbol(left.removesuffix("'")))
            rows.append((rf"\dot{{{shown}}}" if left.endswith("'") else shown, node))
        return _as_latex(rows)

    def _repr_latex_(self) -> str | None:
        return f"${self.latex()}$" if self.compiled else None

    @property
    def _title(self) -> str:
        raise NotImplementedError

    def __str__(self) -> str:
        return _as_text(self, self._title)

    def __repr__(self) -> str:
        return f"<{self._title}: {', '.join(self.states)}>"

    def named_arguments(self) -> dict[str, Any]:
        """Keyword arguments but the right-hand sides; what is empty is left out."""
        given: dict[str, Any] = {
            "states": list(self.states),
            "inputs": list(self.inputs),
            "parameters": self.parameters,
        }
        return {name: value for name, value in given.items() if value}

    def _spec(self, **own: Any) -> dict[str, Any]:
        """The spec: what is the class's own, then the table, values and names."""
        return ReadOnlyDict(
            {
                **own,
                "table": self._table,
                "parameters": list(self._names.parameters.values()),
                "names": {
                    "states": list(self.states),
                    "inputs": list(self.inputs),
                    "parameters": list(self._names.parameters),
                    **({"unknown": list(self.unknown)} if self.unknown else {}),
                },
            }
        )

    def _same(self) -> tuple[Any, ...]:
        """What two equal systems have in common."""
        return (type(self), self.spec, [group.calls for group in self._groups.values()])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, OwnSystem) and self._same() == other._same()

    def __hash__(self) -> int:
        return hash((type(self), self._names.all, tuple(self._names.parameters.values())))


def written(side: Sequence[Node], name: str, shape: tuple[int, ...]) -> Any:
    """The texts of a right-hand side, which can be read again: one, a list, or a list of rows."""
    texts = []
    for i, node in enumerate(side):
        texts.append(text(node))
        if node.size > LONGEST or len(texts[i]) > MAX_LENGTH:
            allowed = f"at most {MAX_LENGTH} characters when written out"
            raise HgoError(explain(f"{name}[{i}]", node, allowed, "name shared parts as states"))
    if shape == ():
        return texts[0]
    if len(shape) == 2:
        return [texts[i : i + shape[1]] for i in range(0, len(texts), shape[1])]
    return texts


def _as_text(system: OwnSystem, title: str) -> str:
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


def _as_latex(equations: Sequence[tuple[str, Node]]) -> str:
    """The equations, aligned."""
    rows = [rf"{left} &= {latex(right)}" for left, right in equations]
    return r"\begin{aligned} " + r" \\ ".join(rows) + r" \end{aligned}"
