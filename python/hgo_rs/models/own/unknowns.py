"""Unknowns of a model: what enters an equation and is not known, estimated in a unit of its own.

An unknown d that enters phi(t, x, u, d), with d' = 0 as far as the model knows, is the last state
of its chain, in its own unit. Its correction is that of a chain of integrators over the slope
dphi/dd, so that the error, in the unit of phi, is that of the chain (the nonlinear chain of
Hammouri, Farza, ESAIM COCV 9 (2003)). The slope must keep its sign.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import Any

import numpy as np

from hgo_rs.errors import HgoError, check, explain
from hgo_rs.expressions import nodes
from hgo_rs.expressions.derivative import derivative
from hgo_rs.expressions.grammar import unknown as not_known
from hgo_rs.expressions.interval import bounds
from hgo_rs.expressions.nodes import Node, constant, function, symbol
from hgo_rs.expressions.numeric import evaluate
from hgo_rs.models.own.analysis import Box, halved

_COLUMNS = re.compile(r"(x_hat|y|u|innovation)\d*|t|time|gain|missing|piece")
_BUDGET = 4096  # boxes looked at
ONE = constant(1.0)


def names_of(unknown: Any, orders: Any) -> tuple[str, ...]:
    """The names of the unknowns, one a chain, "" where it has none; empty for a model without."""
    if unknown is None:
        return ()
    chains = len(orders) if isinstance(orders, Sequence) and not isinstance(orders, str) else 1
    given = [unknown] if isinstance(unknown, str) else unknown
    allowed = f"{chains} name" + ("s, one a chain, None where it has none" if chains > 1 else "")
    listed = isinstance(given, Sequence) and len(given) == chains
    remedy = "there is one unknown for each measured output; leave the others to the model"
    check(listed, "unknown", unknown, allowed, remedy)
    found = tuple(name or "" for name in given)
    texts = all(isinstance(name, str) for name in found) and any(found)
    check(texts, "unknown", unknown, allowed, 'write unknown="T_load"')
    for name in found:
        free = _COLUMNS.fullmatch(name) is None
        check(free, "unknown", name, "no column of its own in tables of estimates", "rename it")
    return found


def extended(states: Any, orders: Any, unknown: Sequence[str]) -> tuple[Any, list[int] | None]:
    """States and orders with each unknown at the end of its chain."""
    if isinstance(states, str) or not isinstance(states, Sequence):
        return states, orders  # the names refuse it
    if orders is None:
        return [*states, *unknown], None
    if not all(isinstance(order, int) for order in orders) or sum(orders) != len(states):
        return states, orders  # the form refuses it
    longer = [order + (name != "") for order, name in zip(orders, unknown, strict=True)]
    found = list(states)
    for end, name in reversed(list(zip(accumulate(orders), unknown, strict=True))):
        found[end:end] = [name] if name else []
    return found, longer


def units_of(units: Any, names: Sequence[str]) -> dict[str, str]:
    """Name -> unit, checked."""
    given = {} if units is None else units
    remedy = 'write {"T_load": "N m"}'
    check(isinstance(given, Mapping), "units", units, "a dict of names and units", remedy)
    for name, unit in given.items():
        if name not in names:
            raise HgoError(f"units: {not_known(str(name), names, 'state or input')}")
        fits = isinstance(unit, str) and unit.isprintable() and unit.strip() == unit and unit != ""
        fits = fits and not set(unit) & set('[]"\\') and "*/" not in unit
        allowed = "a text without brackets, quotes and backslashes"
        check(fits, f"units[{name!r}]", unit, allowed, 'write it as in "N m"')
    return dict(given)


class Slopes:
    """The slopes of a model's right-hand sides in its unknowns.

    Parameters
    ----------
    label : name of the right-hand side, such as phi
    sides : the right-hand side of each chain that its unknown enters
    unknown : the unknowns' names, one a chain, "" for none
    states : all states
    box : bounds of some states, within which the slopes keep their sign
    chained : whether these are the states of a nonlinear chain behind the first, all known
    """

    def __init__(
        self,
        sides: Sequence[tuple[str, Node]],
        unknown: Sequence[str],
        states: Sequence[str],
        box: Box,
        *,
        chained: bool = False,
    ) -> None:
        self.sides, self.unknown, self.states, self.box = sides, unknown, states, box
        self.chained = chained
        self.nodes = tuple(
            derivative(side, name) if name else ONE
            for (_, side), name in zip(sides, unknown, strict=True)
        )

    def table(self) -> dict[str, Node]:
        """The slopes by name, outside the box as at its nearest point."""
        within = {
            name: function("min", function("max", symbol(name), constant(low)), constant(high))
            for name, (low, high) in self.box.items()
        }
        labels = [f"slope[{i}]" for i in range(len(self.nodes))]
        return dict(zip(labels, nodes.replaced(self.nodes, within), strict=True))

    def at(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """The slope in each unknown at a point, or at each of several."""
        found = evaluate(list(self.table().values()), values)
        return {name: slope for name, slope in zip(self.unknown, found, strict=True) if name}

    def arguments(self, orders: Sequence[int]) -> dict[str, Any]:
        """What makes them again: states and orders without the unknowns, unknown, box."""
        given: dict[str, Any] = {}
        if not self.chained:
            states = [name for name in self.states if name not in self.unknown]
            given = {"states": states, "unknown": self.unknown[0]}
        if orders:
            ends = zip(orders, self.unknown, strict=True)
            given["orders"] = [order - (name != "") for order, name in ends]
            given["unknown"] = list(self.unknown)
        if self.box:
            given["box"] = {name: list(ends) for name, ends in self.box.items()}
        return given

    def intervals(
        self, parameters: Mapping[str, float], box: Box | None
    ) -> dict[str, tuple[float, float]]:
        """Guaranteed bounds of each slope, on the box of the model or on another."""
        ends = self.box if box is None else box
        pairs = zip(self.unknown, self.nodes, strict=True)
        return {name: self.interval(node, parameters, ends) for name, node in pairs if name}

    def check(self, parameters: Mapping[str, float]) -> None:
        """Refuse a slope that no law can divide by."""
        for (label, side), slope, name in zip(self.sides, self.nodes, self.unknown, strict=True):
            if name:
                self._check_entry(label, side, slope, name, parameters)
        for label, side in () if self.chained else self.sides:
            for (own, _), name in zip(self.sides, self.unknown, strict=True):
                if name and own != label and name in nodes.symbols([side]):
                    raise HgoError(
                        f"{label} = {side} depends on {name}: the unknown of {own} must enter "
                        f"{own} alone, the equation of its own output; take the whole term in "
                        f"{own} as the unknown and compute {name} from the estimates"
                    )

    def _check_entry(
        self, label: str, side: Node, slope: Node, name: str, parameters: Mapping[str, float]
    ) -> None:
        if name not in nodes.symbols([side]):
            raise HgoError(
                explain("unknown", name, f"a name in {label} = {side}", f"let {name} enter {label}")
            )
        allowed = {*self.states, *parameters}
        others = [used for used in nodes.symbols([slope]) if used not in allowed]
        role = "state" if self.chained else "unknown"
        if others:
            raise HgoError(
                f"the slope of {label} in {name}, {slope}, depends on {', '.join(others)}: must "
                "depend on states and parameters only, because a correction has no time or input; "
                f"take the whole term with {name} as the {role} and divide its estimate"
            )
        low, high = self.interval(slope, parameters, self.box)
        if not (low > 0.0 or high < 0.0):
            where = f"on the box {dict(self.box)}" if self.box else "for all states"
            moves = [used for used in nodes.symbols([slope]) if used in self.states]
            remedy = f"let {name} enter otherwise"
            if moves:
                remedy = f'give box={{"{moves[0]}": (low, high)}} where it keeps its sign'
            raise HgoError(
                f"the slope of {label} in {name}, {slope}, lies in [{low:.6g}, {high:.6g}] "
                f"{where}: must not be 0, as corrections of {name} are divided by it; {remedy}"
            )

    def interval(
        self, slope: Node, parameters: Mapping[str, float], box: Box
    ) -> tuple[float, float]:
        """Guaranteed bounds of a slope, of pieces of the box where it is finite."""
        known: dict[str, Any] = {name: (value, value) for name, value in parameters.items()}
        used = nodes.symbols([slope])
        names = [name for name in self.states if name in used]
        ends = [box.get(name, (-np.inf, np.inf)) for name in names]
        full = np.array(ends, dtype=float).reshape(-1, 2).T
        pieces, width = full[np.newaxis], full[1] - full[0]
        while True:
            at = {name: (pieces[:, 0, j], pieces[:, 1, j]) for j, name in enumerate(names)}
            (lows, highs), *_ = bounds([slope], {**known, **at})
            low, high = float(np.min(lows)), float(np.max(highs))
            whole = names and np.all(np.isfinite(width)) and np.any(width > 0.0)
            if low > 0.0 or high < 0.0 or not whole or 2 * len(pieces) > _BUDGET:
                return low, high
            pieces = halved(pieces, np.where(width > 0.0, width, 1.0))
