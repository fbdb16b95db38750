"""The forms in which a model is written: what each asks for, checks, and makes of it.

y is the measured output, t the time [s]; the equations stand at the classes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hgo_rs.errors import HgoError, check, check_integer, explain
from hgo_rs.expressions import nodes
from hgo_rs.expressions.derivative import ZERO, add, derivative, mul
from hgo_rs.expressions.errors import ExpressionError
from hgo_rs.expressions.nodes import Node, constant
from hgo_rs.models.own.sources import Arguments, Group

Sides = Mapping[str, Sequence[Node]]


class Form:
    """What all forms share. `sides` are the right-hand sides of the table, by name, with shapes."""

    name: str
    title: str
    known: str
    """The right-hand side that an observer adds to its own structure."""
    taken: tuple[str, ...] = ("t",)
    """Names that have a meaning in this form."""
    sides: dict[str, tuple[int, ...]]
    n_x = 0
    """Measured states of the strict-feedback form."""
    orders: tuple[int, ...] = ()
    """Orders of several chains."""
    unknown: tuple[str, ...] = ()
    """The unknowns that are among the states, one a chain, "" where it has none."""
    carries = True
    """Whether it may have unknowns."""

    def __init__(self, states: Sequence[str], inputs: Sequence[str]) -> None:
        self.states = tuple(states)
        self.inputs = tuple(inputs)
        self.n = len(states)

    @property
    def own(self) -> dict[str, Any]:
        """The form's part of the spec."""
        unknown = {"unknown": [int(name != "") for name in self.unknown]} if self.unknown else {}
        return {"form": self.name, "n": self.n, **unknown}

    def carry(self, unknown: Sequence[str]) -> None:
        """Take some of the states as unknowns."""
        allowed = "left out in this form, which has no chain to extend"
        remedy = "write the model with phi= or f=, or the unknown as a state"
        check(self.carries or not unknown, "unknown", list(unknown), allowed, remedy)
        self.unknown = tuple(unknown)

    def entered(self, groups: Mapping[str, Group]) -> list[tuple[str, Node]]:
        """Label and right-hand side of the equation of each chain that an unknown may enter."""
        group = groups[self.known]
        labels = zip(group.labels(self.known), group.nodes or (), strict=True)
        return list(labels)[-max(1, len(self.orders)) :]

    def chained(self, groups: Mapping[str, Group]) -> list[tuple[str, Node]]:
        """Label and rate of every state but the last, of a nonlinear chain; else nothing."""
        return []

    def arguments(self, side: str) -> Arguments:
        """What a right-hand side may use."""
        return Arguments((("t", None), ("x", self.states), ("u", self.inputs)))

    def table_inputs(self) -> dict[str, str]:
        """Symbol -> name of the table's input, without the parameters."""
        found: dict[str, str] = {}
        for side in self.sides:
            for letter, members in self.arguments(side).groups:
                if members is None:
                    found.setdefault(letter, letter)
                else:
                    found |= {name: f"{letter}[{i}]" for i, name in enumerate(members)}
        return found

    def check(self, groups: Mapping[str, Group], parameters: Mapping[str, float]) -> None:
        """Refuse what is not of this form."""

    def drift(self, sides: Sides) -> list[Node]:
        """dx/dt, one expression a state."""
        raise NotImplementedError

    def outputs(self, sides: Sides) -> list[Node]:
        """y, one expression a measured output."""
        return self._symbols[:1]

    @property
    def _symbols(self) -> list[Node]:
        return [nodes.symbol(name) for name in self.states]


class Phase(Form):
    """x_1' = x_2, ..., x_n' = phi(t, x, u), y = x_1."""

    name = "phase"
    title = "phase-variable form"
    known = "phi"

    def __init__(self, states: Sequence[str], inputs: Sequence[str]) -> None:
        super().__init__(states, inputs)
        self.sides = {"phi": ()}

    def drift(self, sides: Sides) -> list[Node]:
        return _chain(self._symbols, sides["phi"][0], self.unknown)


class Chains(Form):
    """One chain for each output, of orders n_1, n_2, ..., with phi_i(t, x, u) of all states."""

    name = "chains"
    known = "phi"

    def __init__(self, states: Sequence[str], inputs: Sequence[str], orders: Any) -> None:
        super().__init__(states, inputs)
        if isinstance(orders, str) or not isinstance(orders, Sequence):
            raise HgoError(explain("orders", orders, "a list of integers", "write orders=[2, 2]"))
        self.orders = tuple(
            check_integer(order, f"orders[{i}]", least=1) for i, order in enumerate(orders)
        )
        allowed = f"orders that add up to {self.n}, the number of states"
        fits = sum(self.orders) == self.n
        check(fits, "orders", list(self.orders), allowed, "list the states chain by chain")
        self.title = f"phase-variable form, {len(self.orders)} chains"
        self.sides = {"phi": (len(self.orders),)}

    @property
    def own(self) -> dict[str, Any]:
        return {**super().own, "orders": list(self.orders)}

    def drift(self, sides: Sides) -> list[Node]:
        rates: list[Node] = []
        unknown = self.unknown or ("",) * len(self.orders)
        for order, phi, name in zip(self.orders, sides["phi"], unknown, strict=True):
            rates += _chain(self._symbols[len(rates) : len(rates) + order], phi, (name,))
        return rates

    def outputs(self, sides: Sides) -> list[Node]:
        starts = [0, *itertools.accumulate(self.orders)][:-1]
        return [self._symbols[start] for start in starts]


class Triangular(Form):
    """x_i' = x_{i+1} + f_i(t, x_1 ... x_i, u), y = x_1: f_i stands beside the chain.

    Where an f_i is of x_{i+1} too, a nonlinear chain: see `chained`.
    """

    name = "triangular"
    title = "triangular form"
    known = "f"

    def __init__(self, states: Sequence[str], inputs: Sequence[str]) -> None:
        super().__init__(states, inputs)
        self.sides = {"f": (self.n,)}

    def carry(self, unknown: Sequence[str]) -> None:
        super().carry(unknown)
        self.sides = {"f": (self.n - len(unknown),)}

    def check(self, groups: Mapping[str, Group], parameters: Mapping[str, float]) -> None:
        given = groups["f"].nodes or ()
        for i, node in enumerate(given):
            used, (after, *later) = set(nodes.symbols([node])), [*self.states[i + 1 :], ""]
            if i + 1 == len(given):
                continue
            if after in used and derivative(node, after) == constant(1.0):
                raise ExpressionError(
                    f"{node} contains {after} with the slope 1, which the chain "
                    "x_i' = x_{i+1} + f_i has already: must be the other terms only; leave it out",
                    name=f"f[{i}]",
                )
            for name in used.intersection(later):
                raise ExpressionError(
                    f"{node} depends on {name}, so that the model is not triangular: must depend "
                    f"on {', '.join(self.states[: i + 2])} only (f_i on x_1 ... x_(i+1)); reorder "
                    "the states",
                    name=f"f[{i}]",
                )
            if after in used:
                allowed = "x_1 ... x_i where an unknown enters"
                remedy = "make the unknown a state, or leave unknown out"
                check(not any(self.unknown), f"f[{i}]", f"of {after}", allowed, remedy)
                self.name, self.title = "nonlinear-chain", "the form of a nonlinear chain"

    def chained(self, groups: Mapping[str, Group]) -> list[tuple[str, Node]]:
        """x_(i+1) + f_i."""
        if self.name == "triangular":
            return []
        rates = map(add, self._symbols[1:], groups["f"].nodes or ())
        return list(zip(groups["f"].labels("f"), rates, strict=False))

    def drift(self, sides: Sides) -> list[Node]:
        *rest, last = sides["f"]
        above = self._symbols[1 : len(rest) + 1]
        return [*map(add, above, rest), *_chain(self._symbols[len(rest) :], last, self.unknown)]


class Sampled(Form):
    """x' = f(t, x, u), corrected by K_T(t, x, u, y, T) at each sample; y = h(x). Fu et al. (5)."""

    name = "sampled"
    title = "sampled-data form"
    known = "f"
    carries = False
    taken = ("t", "y", "T")

    def __init__(self, states: Sequence[str], inputs: Sequence[str]) -> None:
        super().__init__(states, inputs)
        self.sides = {"f": (self.n,), "K_T": (self.n,), "h": ()}

    def arguments(self, side: str) -> Arguments:
        common = super().arguments(side)
        return Arguments((*common.groups, ("y", None), ("T", None))) if side == "K_T" else common

    def check(self, groups: Mapping[str, Group], parameters: Mapping[str, float]) -> None:
        h = groups["h"]
        if h.nodes is None:
            return
        used = nodes.symbols(h.nodes)
        for name in used:
            if name in h.arguments.symbols and name not in self.states:
                raise ExpressionError(
                    f"{h.nodes[0]} depends on {name}: must depend on the states only, y = h(x)",
                    name="h",
                )
        if not set(used) & set(self.states):
            raise ExpressionError(
                f"{h.nodes[0]} depends on no state, so that y has no relative degree: must depend "
                f"on one of {', '.join(self.states)}; give the measured output",
                name="h",
            )

    def drift(self, sides: Sides) -> list[Node]:
        return list(sides["f"])

    def outputs(self, sides: Sides) -> list[Node]:
        return list(sides["h"])


class StrictFeedback(Form):
    """x' = f1(x) + g(x) z, z' = f2(t, x, z, u), y = x. Katayama (1)."""

    name = "strict-feedback"
    title = "strict-feedback form"
    known = "f2"
    carries = False

    def __init__(self, states: Sequence[str], inputs: Sequence[str], f1: Any) -> None:
        super().__init__(states, inputs)
        self.n_x = _length(f1, self.n - 1)
        self.x, self.z = self.states[: self.n_x], self.states[self.n_x :]
        self.sides = {"f1": (self.n_x,), "g": (self.n_x, len(self.z)), "f2": (len(self.z),)}

    @property
    def own(self) -> dict[str, Any]:
        return {"form": self.name, "n": self.n_x, "n_z": len(self.z)}

    def arguments(self, side: str) -> Arguments:
        return Arguments((("t", None), ("x", self.x), ("z", self.z), ("u", self.inputs)))

    def check(self, groups: Mapping[str, Group], parameters: Mapping[str, float]) -> None:
        for group in (groups["f1"], groups["g"]):
            self._check_measured(group)
        self._check_rank(groups["g"], parameters)

    def _check_measured(self, group: Group) -> None:
        """f1 and g are functions of the measured states."""
        others = {name for name in group.arguments.symbols if name not in self.x}
        for i, node in enumerate(group.nodes or ()):
            for name in nodes.symbols([node]):
                if name in others:
                    raise ExpressionError(
                        f"{node} depends on {name}: must depend on the measured states "
                        f"{', '.join(self.x)} only (Katayama (1)); move the term to f2",
                        name=f"{group.name}[{i}]",
                    )

    def _check_rank(self, g: Group, parameters: Mapping[str, float]) -> None:
        """g of full column rank (A2) somewhere: else y' does not tell z."""
        rng = np.random.default_rng(0)
        call, rank = g.call(parameters), len(self.z)
        points = [call(*g.arguments.probe(rng)).reshape(g.shape) for _ in range(5)]
        ranks = [int(np.linalg.matrix_rank(p)) for p in points if np.isfinite(p).all()]
        if ranks and max(ranks) < rank:
            raise HgoError(
                f"g has rank {max(ranks)} at every point looked at: must have the rank {rank}, one "
                "for each state z (relative degree 1, Katayama (A2)); measure more, or leave out "
                "a z"
            )

    def drift(self, sides: Sides) -> list[Node]:
        rates = list(sides["f1"])
        z = self._symbols[self.n_x :]
        for i, entry in enumerate(sides["g"]):
            row, column = divmod(i, len(z))
            rates[row] = add(rates[row], mul(entry, z[column]))
        return [*rates, *sides["f2"]]

    def outputs(self, sides: Sides) -> list[Node]:
        return self._symbols[: self.n_x]


def _chain(states: Sequence[Node], phi: Node, unknown: Sequence[str]) -> list[Node]:
    """The rates of a chain, of an unknown at its end 0."""
    if any(unknown):
        return [*states[1:-1], phi, ZERO]
    return [*states[1:], phi]


def _length(f1: Any, most: int) -> int:
    """Number of measured states."""
    if callable(f1) or isinstance(f1, str):
        remedy = "give f1 as a list: its length is the number of measured states"
        raise HgoError(explain("f1", f1, "a list of expressions", remedy))
    count = len(f1.tolist() if hasattr(f1, "tolist") else f1)
    if not 1 <= count <= most:
        raise HgoError(
            f"f1 has {count} expressions: must have 1 to {most}, one for each measured state, "
            "with at least one state z left; list x, then z in states"
        )
    return count


def form_of(
    given: Mapping[str, Any], orders: Any, states: Sequence[str], inputs: Sequence[str]
) -> Form:
    """The form whose right-hand sides are given; ``states`` with the unknowns."""
    there = {name for name, value in given.items() if value is not None}
    if there == {"phi"} and orders is not None:
        return Chains(states, inputs, orders)
    if orders is None:
        if there == {"phi"}:
            return Phase(states, inputs)
        if there == {"f"}:
            return Triangular(states, inputs)
        if {"f", "K_T"} <= there <= {"f", "K_T", "g", "h"}:
            return Sampled(states, inputs)
        if there == {"f1", "g", "f2"}:
            return StrictFeedback(states, inputs, given["f1"])
    shown = ", ".join([*sorted(there), *(["orders"] if orders is not None else [])]) or "nothing"
    raise HgoError(
        f"a model of {shown}: must be one of the forms; give phi= (phase-variable), phi= and "
        "orders= (several chains), f= (triangular), f= and K_T= with g= and h= where wanted "
        "(sampled-data), or f1=, g= and f2= (strict-feedback)"
    )
