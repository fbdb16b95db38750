"""A user's own plant, for simulation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from hgo_rs.expressions.nodes import Node
from hgo_rs.models.own.base import OwnSystem, written
from hgo_rs.models.own.names import Names
from hgo_rs.models.own.sources import Arguments, read_group


class Plant(OwnSystem):
    """A system of your own to simulate: dx = drift(t, x, u) dt + diffusion(t, x, u) dW, y =
    output(t, x, u).

    Inputs are given by a feedback; known functions of t and the states are part of the drift.

    Parameters
    ----------
    states : list of names
    inputs : list of names, optional
        Names of the inputs, given by `simulate(..., feedback=...)`.
    parameters : dict of name -> value, optional
        Constants that have names, see `with_parameters`.
    drift : list of n expressions, or a callable (t, x) or (t, x, p); (t, x, u) with inputs
        Expressions as in `Model`.
    diffusion : the same, optional
        With one Wiener process W. Default: none.
    output : expression, or a list of them, optional
        Measured outputs, one expression each. Default: the first state. An output that depends on
        an input uses the input in force when the sample is taken.

    Raises
    ------
    HgoError
        As `Model`.
    """

    def __init__(
        self,
        *,
        states: Sequence[str],
        inputs: Sequence[str] = (),
        parameters: Mapping[str, float] | None = None,
        drift: Any,
        diffusion: Any = None,
        output: Any = None,
    ) -> None:
        names = self._names = Names.of(states, inputs, parameters)
        names.leave_alone(("t",))
        arguments = self.arguments_of_sides
        h = names.states[0] if output is None else output
        given: dict[str, tuple[Any, tuple[int, ...]]] = {"drift": (drift, (self.n,))}
        if diffusion is not None:
            given["diffusion"] = (diffusion, (self.n,))
        several = isinstance(h, (list, tuple))
        given["output"] = (h, (len(h),) if several else ())
        of_table = {"t": "t", **{name: f"x[{i}]" for i, name in enumerate(names.states)}}
        of_table |= {name: f"u[{i}]" for i, name in enumerate(names.inputs)}
        self._compile(
            of_table,
            [
                read_group(name, side, arguments, names, shape)
                for name, (side, shape) in given.items()
            ],
        )

    @property
    def arguments_of_sides(self) -> Arguments:
        """What its right-hand sides may use."""
        groups = (("t", None), ("x", self.states))
        return Arguments((*groups, ("u", self.inputs)) if self.inputs else groups)

    @property
    def order(self) -> int:
        """Order of an observer of it: n."""
        return self.n

    @property
    def noisy(self) -> bool:
        """Whether there is process noise."""
        return "diffusion" in self._groups

    @property
    def _title(self) -> str:
        return f"Plant, {self.n} states" + (", with process noise" if self.noisy else "")

    @property
    def drift(self) -> tuple[Node, ...]:
        """dx/dt, one expression a state."""
        return self.equations["drift"]

    @property
    def known(self) -> tuple[Node, ...]:
        """The drift."""
        return self.drift

    @property
    def known_names(self) -> tuple[str, ...]:
        """drift[0] ..."""
        return self._groups["drift"].labels("drift")

    @property
    def outputs(self) -> tuple[Node, ...]:
        """y, one expression an output."""
        return self.equations["output"]

    def shown_equations(self) -> list[tuple[str, Node]]:
        """As for every system, and the diffusion where there is one."""
        rows = enumerate(self.equations.get("diffusion", ()))
        return super().shown_equations() + [(f"diffusion[{i}]", node) for i, node in rows]

    def as_arguments(self) -> dict[str, Any]:
        """The arguments of this plant as plain data: Plant(**plant.as_arguments()) == plant.
        Expressions are text, so they can be written to a file.

        Raises
        ------
        HgoError
            A plant that is not compiled; an expression whose text would be too long.
        """
        sides = {
            name: written(side, name, self._groups[name].shape)
            for name, side in self.equations.items()
        }
        return {**self.named_arguments(), **sides}

    @property
    def spec(self) -> dict[str, Any]:
        """What the core reads, read-only; "table" is None where it is not compiled."""
        kind = {"kind": "own-plant", "n": self.n, "n_u": self.n_u, "noisy": self.noisy}
        return self._spec(**kind, n_y=max(1, math.prod(self._groups["output"].shape)))
