"""What the user's own models and plants share."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError
from hgo_rs.expressions.nodes import Node
from hgo_rs.expressions.table import compile_table
from hgo_rs.models import System
from hgo_rs.own.names import Names
from hgo_rs.own.sources import Group

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = ["OwnSystem"]

Array = npt.NDArray[np.float64]


class OwnSystem(System):
    """Names, right-hand sides and their table; the base of `Model` and `Plant`."""

    _names: Names
    _groups: dict[str, Group]
    _table: dict[str, Any] | None

    def _compile(self, inputs: Mapping[str, str], outputs: Sequence[tuple[str, Group]]) -> None:
        """Make the table of the groups, if all of them are expressions."""
        self._groups = {group.name: group for _, group in outputs}
        self._table = None
        if not self.compiled:
            return
        roots: list[Node] = []
        labels: list[str] = []
        for label, group in outputs:
            assert group.nodes is not None
            roots += group.nodes
            single = group.size == 1 and label in ("phi", "h")
            labels += [label] if single else [f"{label}[{i}]" for i in range(group.size)]
        self._table = compile_table(roots, inputs, labels, fixed=tuple(self._names.parameters))

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        return self._names.states

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self._names.inputs

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
        """Whether all of it are expressions, so that it runs at native speed."""
        return all(group.nodes is not None for group in self._groups.values())

    @property
    def why_not_compiled(self) -> str:
        """What kept a callable from being compiled; empty for a compiled one."""
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

    def _need_expressions(self) -> None:
        if not self.compiled:
            raise HgoError(
                f"{type(self).__name__} is not compiled ({self.why_not_compiled}): must be made of "
                "expressions for this; write it with np.where, np.maximum, np.sin and the like"
            )

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

    def _spec(self, **own: Any) -> dict[str, Any]:
        """The spec: what is the class's own, then the table, values and names."""
        return {
            **own,
            "table": self._table,
            "parameters": list(self._names.parameters.values()),
            "names": {
                "states": list(self.states),
                "inputs": list(self.inputs),
                "parameters": list(self._names.parameters),
            },
        }

    def _same(self) -> tuple[Any, ...]:
        """What two equal systems have in common."""
        return (type(self), self.spec, [group.calls for group in self._groups.values()])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, OwnSystem) and self._same() == other._same()

    def __hash__(self) -> int:
        return hash((type(self), self._names.all, tuple(self._names.parameters.values())))
