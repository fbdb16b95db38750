"""What follows from the equations: Jacobian, Lipschitz bound, relative degree."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, check_number, explain
from hgo_rs.expressions import nodes
from hgo_rs.expressions.derivative import ZERO, add, derivative, gradient, mul
from hgo_rs.expressions.grammar import unknown
from hgo_rs.expressions.interval import bounds, jumps
from hgo_rs.expressions.nodes import Node
from hgo_rs.expressions.numeric import evaluate

Array = npt.NDArray[np.float64]
Box = Mapping[str, tuple[float, float]]

_BUDGET = 20_000  # boxes looked at
_SMALLEST = 1e-9  # part of the box below which a slope that has no bound is taken to have none
_ROUNDING = 1.0 + 1e-12  # of the norms, which LAPACK computes


class Jacobian:
    """Derivatives of some expressions, one row each, with respect to some names.

    `rows[i][j]` is the derivative of expression i with respect to name j: at a kink the one of the
    branch that the value comes from, abs with the slope +1 at 0 and sign with the slope 0.
    """

    def __init__(
        self, roots: Sequence[Node], names: Sequence[str], parameters: Mapping[str, float]
    ) -> None:
        self.names = tuple(names)
        self.rows = tuple(tuple(gradient(root, names)) for root in roots)
        self._parameters = dict(parameters)

    @property
    def entries(self) -> tuple[Node, ...]:
        """All, row by row."""
        return tuple(node for row in self.rows for node in row)

    @property
    def needs(self) -> tuple[str, ...]:
        """The names, without parameters, that its value depends on."""
        used = nodes.symbols(self.entries)
        return tuple(name for name in used if name not in self._parameters)

    def __call__(self, **values: npt.ArrayLike) -> Array:
        """Its value, (..., rows, columns), for values of all that it depends on, by name."""
        given = {name: np.asarray(value, dtype=float) for name, value in values.items()}
        found = evaluate(self.entries, {**self._parameters, **given})
        stacked = np.stack(found, axis=-1)
        return stacked.reshape(*stacked.shape[:-1], len(self.rows), len(self.names))

    def __repr__(self) -> str:
        return "[" + ",\n ".join("[" + ", ".join(map(repr, row)) + "]" for row in self.rows) + "]"


def lipschitz(
    roots: Sequence[Node],
    states: Sequence[str],
    others: Sequence[str],
    parameters: Mapping[str, float],
    box: Box,
    rtol: float,
) -> float:
    """A number L with |f(x) - f(z)| <= L |x - z|, Euclidean norms, for all x and z in the box.

    The largest 2-norm of the matrix of the bounds of |J_ij|, over pieces of the box that are halved
    until the bound is within ``rtol`` of a value that is reached, or `_BUDGET` pieces are used up.
    """
    check_number(rtol, "rtol", above=0.0)
    jacobian = Jacobian(roots, states, parameters)
    ends = checked_box(box, {*states, *others})
    known: dict[str, Any] = {name: (value, value) for name, value in parameters.items()}
    for name in jacobian.needs:
        if name not in ends:
            remedy = f'write lipschitz({{"{name}": (low, high), ...}})'
            raise HgoError(explain("box", dict(box), f"given with bounds of {name}", remedy))
    everywhere = dict.fromkeys((*states, *others), (-np.inf, np.inf))
    jumping = jumps(roots, {**everywhere, **known, **ends}, states)
    if jumping:
        raise HgoError(
            f"{jumping[0]} may jump inside the box, so that no Lipschitz bound exists: must be "
            "continuous there; smooth it, such as tanh(v/v0) for sign(v), or take a smaller box"
        )
    return _branch_and_bound(jacobian, ends, known, rtol)


def own_slope(
    roots: Sequence[Node], own: Sequence[str], names: Sequence[str], parameters: Mapping[str, float]
) -> float:
    """A bound of the largest |d root_i / d own_i|, inf where root_i may jump as own_i moves.

    Over all values of ``names`` (states, inputs, t); of a root whose slope has no bound there, over
    values between -1 and 1.
    """
    known: dict[str, Any] = {name: (value, value) for name, value in parameters.items()}
    found = 0.0
    for root, state in zip(roots, own, strict=True):
        slope = derivative(root, state)
        for most in (np.inf, 1.0):
            box = {**dict.fromkeys(names, (-most, most)), **known}
            if jumps([root], box, [state]):
                return np.inf
            low, high = bounds([slope], box)[0]
            size = float(np.maximum(-low, high))
            if np.isfinite(size):
                break
        found = max(found, size)
    return found


def checked_box(box: Box, allowed: set[str]) -> dict[str, tuple[float, float]]:
    ends: dict[str, tuple[float, float]] = {}
    for name, pair in box.items():
        if name not in allowed:
            raise HgoError(f"box: {unknown(name, allowed)}")
        try:
            low, high = pair
        except (TypeError, ValueError):
            raise HgoError(explain(f"box[{name!r}]", pair, "(low, high)", "give both")) from None
        low = check_number(low, f"box[{name!r}][0]")
        ends[name] = (low, check_number(high, f"box[{name!r}][1]", least=low))
    return ends


def _branch_and_bound(
    jacobian: Jacobian, ends: dict[str, tuple[float, float]], known: dict[str, Any], rtol: float
) -> float:
    needs = jacobian.needs
    full = np.array([ends[name] for name in needs]).reshape(-1, 2).T  # (2, d)
    width = np.where(full[1] > full[0], full[1] - full[0], 1.0)
    pieces = full[np.newaxis]  # (pieces, 2, d)
    settled, reached, used = 0.0, 0.0, 0
    while True:
        upper = _upper(jacobian, pieces, known)
        reached = max(reached, _reached(jacobian, pieces))
        used += len(pieces)
        open_ = ~(upper <= max(reached * (1.0 + rtol), np.finfo(float).tiny))
        settled = max(settled, float(np.max(upper[~open_], initial=0.0)))
        sides = (pieces[:, 1] - pieces[:, 0]) / width
        wide = np.any(sides > np.where(np.isinf(upper), _SMALLEST, 0.0)[:, np.newaxis], axis=1)
        if not (open_ & wide).any() or used + 2 * int(open_.sum()) > _BUDGET:
            bound = max(settled, float(np.max(upper[open_], initial=0.0)))
            break
        settled = max(settled, float(np.max(upper[open_ & ~wide], initial=0.0)))
        if np.isinf(settled):
            bound = settled
            break
        pieces = halved(pieces[open_ & wide], width)
    if not np.isfinite(bound):
        raise HgoError(
            f"the slope {jacobian!r} has no bound on the box {ends}: must be bounded for a "
            "Lipschitz bound to exist; keep the box away from where it grows"
        )
    return bound * _ROUNDING


def halved(pieces: Array, width: Array) -> Array:
    """Each piece in two, across its longest side (as a part of the box's)."""
    longest = np.argmax((pieces[:, 1] - pieces[:, 0]) / width, axis=1)
    row = np.arange(len(pieces))
    middle = 0.5 * pieces[row, 0, longest] + 0.5 * pieces[row, 1, longest]
    left, right = pieces.copy(), pieces.copy()
    left[row, 1, longest] = middle
    right[row, 0, longest] = middle
    return np.concatenate((left, right))


def _norms(matrices: Array) -> Array:
    """2-norms; infinite where an entry is."""
    fine = np.isfinite(matrices).all(axis=(1, 2))
    norms = np.full(len(matrices), np.inf)
    norms[fine] = np.linalg.norm(matrices[fine], 2, axis=(1, 2))
    return norms


def _upper(jacobian: Jacobian, pieces: Array, known: dict[str, Any]) -> Array:
    """The 2-norm of the bounds of |J_ij| on each piece."""
    box = dict(known)
    for j, name in enumerate(jacobian.needs):
        box[name] = (pieces[:, 0, j], pieces[:, 1, j])
    sizes = [np.maximum(-low, high) for low, high in bounds(jacobian.entries, box)]
    stacked = np.stack([np.broadcast_to(size, len(pieces)) for size in sizes], axis=-1)
    return _norms(stacked.reshape(len(pieces), len(jacobian.rows), len(jacobian.names)))


def _reached(jacobian: Jacobian, pieces: Array) -> float:
    """The largest 2-norm of the Jacobian at middles and, of few pieces, at corners."""
    points = [0.5 * (pieces[:, 0] + pieces[:, 1])]
    d = pieces.shape[2]
    if len(pieces) << d <= 4096:
        for ends in itertools.product((0, 1), repeat=d):
            points.append(pieces[:, list(ends), list(range(d))])
    at = np.concatenate(points)
    values = jacobian(**{name: at[:, j] for j, name in enumerate(jacobian.needs)})
    flat = values.reshape(-1, len(jacobian.rows), len(jacobian.names))
    norms = _norms(flat)
    return float(np.max(norms[np.isfinite(norms)], initial=0.0))


def relative_degree(
    drift: Sequence[Node], output: Node, states: Sequence[str], name: str
) -> int | None:
    """How often ``output`` must be differentiated until the input ``name`` appears; None: never.

    Up to once a state. Layer by layer from the output: a state that enters the k-th derivative for
    the first time does so with the sum, over the shortest ways to it, of the products of the
    slopes on the way. If this sum is 0 for the input (ways that cancel), the derivatives
    themselves are written out. Whether an expression is 0 is decided by its values at some points.
    """
    slopes = zip(states, gradient(output, states), strict=True)
    layer = {state: slope for state, slope in slopes if _moves(slope)}
    seen = set(layer)
    for count in range(1, len(states) + 1):
        entering: dict[str, Node] = {}
        for state, slope in layer.items():
            rate = drift[states.index(state)]
            for other in (*states, name):
                part = ZERO if other in seen else derivative(rate, other)
                if _moves(part):
                    entering[other] = add(entering.get(other, ZERO), mul(slope, part))
        if name in entering:
            cancels = not _moves(entering[name])
            return _by_derivatives(drift, output, states, name) if cancels else count
        layer = entering
        seen |= set(entering)
    return None


def _by_derivatives(
    drift: Sequence[Node], output: Node, states: Sequence[str], name: str
) -> int | None:
    """The relative degree from the derivatives of the output, written out."""
    y = output
    for count in range(1, len(states) + 1):
        change = derivative(y, "t")
        for slope, rate in zip(gradient(y, states), drift, strict=True):
            change = add(change, mul(slope, rate))
        y = change
        if _moves(derivative(y, name)):
            return count
    return None


def _moves(slope: Node) -> bool:
    """Whether an expression is anything but 0."""
    if slope.number == 0.0:
        return False
    rng = np.random.default_rng(0)
    values = {name: rng.uniform(-2.0, 2.0, 64) for name in nodes.symbols([slope])}
    return bool(np.any(evaluate([slope], values)[0] != 0.0))
