"""How far an estimate drifts while samples are missing.

With x̂ the estimate from all samples and x̃ the one that gets none from t to t + τ, the error of x̃ at
the end of the gap is

    (x - x̃)(t + τ) = (x - x̂)(t + τ) + (x̂ - x̃)(t + τ).

The second part is what the gap leaves out, the law's corrections c(s), carried on by the law:

    (x̂ - x̃)(t + τ) = ∫ Φ(t + τ, s) c(s) ds,    s from t to t + τ,

Φ the transition matrix without corrections. For a chain of order n with nothing known, and c that
does not move, that is c_i τ + c_(i+1) τ^2/2! + ... + c_n τ^(n-i+1)/(n-i+1)!. It can be had exactly
wherever the record is complete, by leaving samples out once more. The first part is the error that
the estimate has anyway. x̂_i' = x̂_(i+1) + c_i makes it e_(i+1) = c_i - e_i', so it is c_i on
average, and y - x̂_1 for the first state; both are averaged over three times the law's slowest time
constant.

`gap_error` does this around every gap of a result. `gap_bound` is the bound beforehand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs import _core
from hgo_rs.design.discrete import following
from hgo_rs.errors import HgoError, check, check_array, check_integer, check_number
from hgo_rs.laws import LAWS
from hgo_rs.observers.result import Gap, RunResult
from hgo_rs.observers.turns import nearest, turns_of

Array = npt.NDArray[np.float64]

DURATIONS = 16
"""Gaps of more different durations are read off a curve through this many."""
REPLAYS = 128
"""Samples left out once more, for each duration, spread over the record."""
NEAREST = 64
"""Of these, those nearest to a gap that speak for it."""


def gap_error(
    core: _core.Observer,
    spec: Mapping[str, Any],
    result: RunResult,
    u: Array,
    gaps: Sequence[Gap],
    *,
    index: int | None,
) -> Array:
    """Error to expect at the end of each of a result's gaps, (number of gaps, n).

    The root mean square of x - x̃ over gaps of the same duration that are put into the complete
    parts of the same record, those nearest to the gap. Where no part is long enough: the longest
    that there is, times (τ/τ')^(n-i+1) as for a chain with nothing known. NaN if no sample can be
    left out, and for a gap that no sample ends.

    Parameters
    ----------
    core, spec
        The law that gave the result.
    result
        Its run over the record.
    u : (N, n_u)
        The record's inputs.
    gaps
        Some of the result's gaps.
    index
        Where the law's gain stands in the memory, if it moves.
    """
    n = core.n
    error = np.full((len(gaps), n), np.nan)
    record = _Record(core, spec, result, u, index)
    for channel in sorted({gap.channel for gap in gaps}):
        mine = [i for i, g in enumerate(gaps) if g.channel == channel and g.duration > 0.0]
        if not mine:
            continue
        asked = np.array([gaps[i].duration for i in mine])
        durations = np.unique(asked)
        if len(durations) > DURATIONS:
            durations = np.geomspace(durations[0], durations[-1], DURATIONS)
        at = result.time[[gaps[i].start for i in mine]]
        curves = [_around(at, *record.replays(channel, duration)) for duration in durations]
        known = _extended(durations, np.array(curves))  # (durations, gaps, n)
        for j, i in enumerate(mine):
            for state in range(n):
                error[i, state] = _interpolated(asked[j], durations, known[:, j, state])
    return error


class _Record:
    """A run whose samples can be left out once more."""

    def __init__(
        self,
        core: _core.Observer,
        spec: Mapping[str, Any],
        result: RunResult,
        u: Array,
        index: int | None,
    ) -> None:
        self.core, self.u, self.gain = core, u, index
        law = LAWS.get(spec["kind"])
        chains = spec.get("observers", (spec,))
        self.linear = core.n if any("P0" in one for one in chains) else None
        """How many entries of the memory, the first ones, move linearly; None: all but the gain."""
        self.behind = following(spec)[core.n :] if law is not None and law.single else None
        chains = spec.get("observers")  # one for each output, or one chain
        self.orders = [chain["n"] for chain in chains] if chains else [core.n]
        self.turns = np.full(core.n, np.nan)  # of estimates that are known to a turn
        if len(self.orders) == core.n_y:
            firsts = np.cumsum([0, *self.orders[:-1]])
            self.turns[firsts] = np.array(turns_of(spec, core.n_y), dtype=float)
        self.t, self.y, self.memory = result.time, result.y, result.memory
        self.innovation = result.innovation
        self.filters = core.is_current
        self.settling = 3.0 * self._time_constant()
        self._known = np.full((len(self.t), core.n), np.nan)
        self.gap = np.zeros(self.y.shape, bool)
        for gap in result.gaps:
            self.gap[gap.start : gap.start + gap.length, gap.channel] = True

    def _found(self, k: int) -> Array:
        """The memory as sample k finds it."""
        if not self.filters:
            return self.memory[k]
        none = np.full(self.y.shape[1], np.nan)
        return self._advance(k - 1, self.memory[k - 1], none)

    def _apart(self, a: Array, b: Array) -> Array:
        """a - b of memories or estimates, to the nearest turn."""
        apart = a - b
        apart[: self.core.n] = nearest(apart[: self.core.n], self.turns)
        return apart

    def _advance(self, k: int, memory: Array, y: Array) -> Array:
        dt = self.t[k + 1] - self.t[k]
        return self.core.advance(memory, y, self.u[k], self.t[k], dt)[0]

    def _step(self, k: int, memory: Array, y: Array) -> Array:
        """The memory as sample k + 1 finds it, from that which sample k finds."""
        used = self.core.correct(memory, y, self.t[k])[0]
        return self._advance(k, used, y)

    def _time_constant(self) -> float:
        """The slowest of the law, linearised amid the record; gains and covariances are held."""
        k = len(self.t) // 2
        if k < 2:
            return 0.0
        given = np.flatnonzero(~np.isnan(self.y).any(axis=1))
        y = self.y[given[np.argmin(np.abs(given - k))]] if len(given) else self.y[k]
        memory = self._found(k)
        size = 1e-6 * (1.0 + float(np.max(np.abs(memory[: self.linear]))))
        after = self._step(k, memory, y)
        columns = [
            self._apart(self._step(k, memory + size * unit, y), after) / size
            for unit in np.eye(len(memory))[: self.linear]
        ]
        states = [i for i in range(len(memory))[: self.linear] if i != self.gain]
        matrix = np.array(columns).T[np.ix_(states, states)]
        if not np.all(np.isfinite(matrix)):
            return 0.0
        radius = float(np.max(np.abs(np.linalg.eigvals(matrix))))
        dt = float(self.t[k + 1] - self.t[k])
        longest = float(self.t[-1] - self.t[0]) / 60.0
        return min(-dt / np.log(radius), longest) if 0.0 < radius < 1.0 else longest

    def replays(self, channel: int, duration: float) -> tuple[Array, Array]:
        """Times (S,) at which a gap of this duration was put into the record, and x - x̃ (S, n)."""
        t, n = self.t, self.core.n
        none = self.gap[:, channel]
        end = np.searchsorted(t, t + duration * (1.0 - 1e-9))  # of a gap that begins at an index
        before = np.r_[0, np.cumsum(none)]  # missing samples before an index
        inside = (end < len(t) - 1) & ~np.isnan(self.y[:, channel])
        inside[0] = False
        begin = np.flatnonzero(inside)
        begin = begin[before[end[begin] + 1] == before[begin]]
        # an estimate that still settles says nothing of one that has settled
        last = np.maximum.accumulate(np.where(none, np.arange(len(t)), 0))
        since = t[begin] - t[last[begin]]
        settled = begin[since >= 2.0 * self.settling]
        begin = (
            settled if len(settled) else begin[since >= np.median(since)] if len(begin) else begin
        )
        begin = begin[np.unique(np.linspace(0, len(begin) - 1, REPLAYS).astype(int))[: len(begin)]]
        drift = np.empty((len(begin), n))
        told = np.ones(len(begin), bool)
        for row, k in enumerate(begin.tolist()):
            stop = int(end[k])
            rows = slice(k, stop)
            left = self.y[rows].copy()
            left[:, channel] = np.nan
            record = (t[rows], left, self.u[rows], self._found(k))
            # as the sample that ends the gap finds it
            track = self.core.run(*record, innovation=False, until=float(t[stop]))
            told[row] = track["undefined"] is None  # else the model has no value in such a gap
            found = self._apart(self._found(stop)[:n], track["next"][:n])
            drift[row] = found + self.usual(stop)
        return t[begin][told], drift[told]

    def usual(self, stop: int) -> Array:
        """x - x̂ before a sample, (n,): the average of y - x̂_1 and of the corrections, chain by
        chain (noise that averages out is left out, which counts where no sample is missing). Of
        states that are no chain from an output on, nothing is known.
        """
        usual = np.zeros(self.core.n)
        if len(self.orders) != self.y.shape[1]:
            return usual
        first = int(np.searchsorted(self.t, self.t[stop] - self.settling))
        first = max(min(first, stop - 1), int(self.filters))
        corrections = self._corrections(first, stop).sum(axis=0) / (self.t[stop] - self.t[first])
        begin = 0
        for order, e in zip(self.orders, self.innovation[first:stop].T, strict=True):
            there = e[~np.isnan(e)]
            usual[begin] = there.mean() if len(there) else 0.0
            usual[begin + 1 : begin + order] = corrections[begin : begin + order - 1]
            begin += order
        return usual

    def _corrections(self, first: int, stop: int) -> Array:
        """What samples first to stop - 1 move beyond the model's own step, each computed once."""
        n = self.core.n
        known = self._known[first:stop]
        none = np.full(self.y.shape[1], np.nan)
        for k in (first + np.flatnonzero(np.isnan(known[:, 0]))).tolist():
            before = k - int(self.filters)  # what is used is shown at once with current timing
            found = self.memory[before].copy()
            if self.behind is not None:  # auxiliary states as x_hat has them: no correction inside
                found[n : n + len(self.behind)] = self.behind @ found[:n]
            free = self._advance(before, found, none)
            known[k - first] = self._apart(self.memory[before + 1, :n], free[:n])
        return known


def _around(at: Array, times: Array, drift: Array) -> Array:
    """Root mean square of the drifts nearest to each time, (len(at), n)."""
    if not len(times):
        return np.full((len(at), drift.shape[1]), np.nan)
    sums = np.r_[np.zeros((1, drift.shape[1])), np.cumsum(drift**2, axis=0)]
    width = min(NEAREST, len(times))
    first = np.clip(np.searchsorted(times, at) - width // 2, 0, len(times) - width)
    return np.asarray(np.sqrt((sums[first + width] - sums[first]) / width))


def _extended(durations: Array, curves: Array) -> Array:
    """Durations that no part of the record has take the longest one's value, scaled."""
    powers = np.arange(curves.shape[2], 0, -1)
    for d in range(1, len(durations)):
        scaled = curves[d - 1] * (durations[d] / durations[d - 1]) ** powers
        curves[d] = np.where(np.isnan(curves[d]), scaled, curves[d])
    return curves


def _interpolated(duration: float, durations: Array, curve: Array) -> float:
    """The curve at a duration, on logarithmic axes."""
    if not np.all(curve > 0.0):
        return float(np.interp(duration, durations, curve))
    return float(np.exp(np.interp(np.log(duration), np.log(durations), np.log(curve))))


def gap_bound(
    duration: float,
    mismatch: float,
    *,
    n: int,
    lipschitz: npt.ArrayLike = 0.0,
    error0: npt.ArrayLike = 0.0,
) -> Array:
    """Bound of |x_i - x̂_i| at the end of a gap of a chain of order n, (n,).

    e_i' = e_(i+1), |e_n'| <= sum_j lipschitz_j |e_j| + mismatch: the bound is the solution of the
    linear chain with equality, by its matrix exponential. Without a model, mismatch is the bound of
    the n-th derivative of y, and

        |e_i(τ)| <= sum_(j>=i) |e_j(0)| τ^(j-i)/(j-i)! + mismatch τ^(n-i+1)/(n-i+1)!.

    Parameters
    ----------
    duration : float
        τ [s].
    mismatch : float
        Bound of the model error in the n-th derivative of y.
    n : int
        Order.
    lipschitz : float or (n,)
        Bounds of |∂phi/∂x_j|, of x_1 to x_n; one number: the same for all.
    error0 : float or (n,)
        |x - x̂| when the gap begins.

    Raises
    ------
    HgoError
        A number out of range, or a wrong shape.
    """
    from scipy.linalg import expm

    n = check_integer(n, "n", least=1, most=12)
    duration = check_number(duration, "duration", least=0.0)
    mismatch = check_number(mismatch, "mismatch", least=0.0)
    told = {}
    for name, given in (("lipschitz", lipschitz), ("error0", error0)):
        values = check_array(given, name)
        if values.shape not in ((), (n,)):
            raise HgoError(f"{name} of shape {values.shape}: must be one number or {n}")
        fits = bool(np.all(np.isfinite(values) & (values >= 0.0)))
        check(fits, name, given, "finite and >= 0", "give bounds of magnitudes")
        told[name] = np.broadcast_to(values, (n,))
    chain = np.zeros((n + 1, n + 1))  # the last state is the mismatch, which stays
    chain[np.arange(n), np.arange(1, n + 1)] = 1.0
    chain[n - 1, :n] += told["lipschitz"]
    bound = expm(chain * duration) @ np.append(told["error0"], mismatch)
    return np.asarray(bound[:n])
