"""A record to choose a gain by."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import check, check_array, check_number
from hgo_rs.logs import Log
from hgo_rs.observers import Observer, RunResult, records, turns
from hgo_rs.signals import Given, of_log
from hgo_rs.tuning.result import Array

_LEAST = 50  # samples
MOST = 12_288
"""Samples of a long record that are looked at."""


@dataclass(frozen=True, eq=False)
class Record:
    """A log, and the part of it that is judged.

    Attributes
    ----------
    t : (N,)
    y : (N,)
    u : (N, n_u) or None
        As it was given, with a column for each input.
    dt : float
        Median time between samples of y [s].
    skip : float
        Time at its start that is not judged [s].
    judged : (N,) bool
    two_sided : (N,) bool
        Judged, and told of by samples on both sides: not within `skip` of the end, nor before a gap
        for as long as the gap is.
    period : float or None
        The sampling period, where it was given in place of times.
    whole : int
        Samples of the log, of which the longest piece, and of a long one the busiest stretch, is
        looked at.
    turn : float or None
        What an estimate of y is known up to, where y was unwrapped.
    """

    t: Array
    y: Array
    u: Array | None
    dt: float
    skip: float
    judged: npt.NDArray[np.bool_]
    two_sided: npt.NDArray[np.bool_]
    period: float | None = None
    whole: int = 0
    turn: float | None = None

    @classmethod
    def of(cls, log: Given, skip: float | None) -> Record:
        """A log as arrays; of one whose clock starts again the longest piece."""
        clock, y, inputs, whole = longest(log)
        y = y[:, 0] if y.ndim == 2 and y.shape[1] == 1 else y
        one = y.ndim == 1 and clock.shape in ((), y.shape)
        shapes = f"{clock.shape}, {y.shape}"
        check(one, "shapes of t and y", shapes, "(N,) each, or t a period", "give one output")
        longer = "give a longer log"
        check(len(y) >= _LEAST, "samples of the log", len(y), f">= {_LEAST}", longer)
        t, period = clock, None
        if not clock.ndim:
            period = check_number(float(clock), "t, a period", above=0.0)
            t = period * np.arange(len(y), dtype=np.float64)
        steps = np.diff(t)
        k = int(np.argmin(steps > 0.0))
        increasing, remedy = bool(np.all(steps > 0.0)), "sort the record, drop repeated times"
        around = f"{t[k]:.9g}, {t[k + 1]:.9g}"
        check(increasing, f"t at samples {k} and {k + 1}", around, "increasing", remedy)
        length = float(t[-1] - t[0])
        start = length / 20.0
        if skip is not None:
            start = check_number(skip, "skip", above=0.0, below=length)
        there = int(np.sum(np.isfinite(y)))
        name = "samples of the log that are not missing"
        check(there >= _LEAST, name, there, f">= {_LEAST}", longer)
        usual = float(np.median(np.diff(t[np.isfinite(y)])))
        u = None
        if inputs is not None:
            u = inputs[:, None] if inputs.ndim == 1 else inputs
            fits = u.ndim == 2 and len(u) == len(y)
            check(fits, "shape of u", u.shape, f"({len(y)}, n_u)", "give a row a sample")
        some = busiest(y, int(np.searchsorted(t, t[0] + start)), MOST)
        if some != slice(0, len(y)):
            t, y, u = t[some], y[some], None if u is None else u[some]
            start = min(start, float(t[-1] - t[0]) / 20.0)
        judged = _judged(t, y, usual, start)
        enough = int(np.sum(judged))
        remedy = f"{longer}, steadier steps (their median is {usual:.4g} s), or a shorter skip"
        check(enough >= _LEAST, "samples after skip and gaps", enough, f">= {_LEAST}", remedy)
        back = _judged(t[-1] - t[::-1], y[::-1], usual, start)[::-1]
        return cls(t, y, u, usual, start, judged, judged & back, period, whole)

    @property
    def part(self) -> str:
        """What of the log is looked at; empty where all of it is."""
        if len(self.y) == self.whole:
            return ""
        return (
            f"{self.whole - len(self.y)} of the log's {self.whole} samples: used were those from "
            f"t = {self.t[0]:.6g} s to {self.t[-1]:.6g} s, where y moves most in the longest piece"
        )

    @cached_property
    def inner(self) -> slice | npt.NDArray[np.intp]:
        """The rows that are `two_sided`; a slice where they are neighbours."""
        rows = np.flatnonzero(self.two_sided)
        if len(rows) and rows[-1] - rows[0] + 1 == len(rows):
            return slice(int(rows[0]), int(rows[-1]) + 1)
        return rows

    def unwrapped(self, turn: float) -> Record:
        """The record with y going on over its turns, each step the shorter way round."""
        return replace(self, y=turns.unwrapped(self.y, turn), turn=turn)

    @property
    def smallest(self) -> float:
        """Differences of y below this are rounding of its numbers."""
        return float(np.finfo(np.float64).eps * np.max(np.abs(self.y[self.judged])))

    def run(
        self, observer: Observer, start: Array | None = None, *, spare: bool = False
    ) -> RunResult:
        """An observer over the record, from `start` or from rest at the first sample.

        ``spare``: inputs are kept from a model that has none, in place of a refusal.
        """
        begin: dict[str, Any] = (
            {"start": observer._usual_start} if start is None else {"x_hat0": start}
        )
        clock = self.t if self.period is None else self.period
        # Whether inputs fit is for the observer to say.
        u = None if self.u is None else self.u if self.u.shape[1] > 1 else self.u[:, 0]
        if spare and not observer.n_u:
            u = None
        return observer.run(clock, self.y, u, **begin)

    def moves(self, n: int) -> None:
        """Refuse a record that stands still."""
        values = np.unique(self.y[self.judged]).size
        allowed = f"> {n}, the order: a record that stands still determines no gain"
        remedy = "give a log in which y moves, or the noise level in its place"
        check(values > n, "distinct values of y after skip", values, allowed, remedy)

    def increments(self) -> tuple[float, Array]:
        """The step of y and how many of it each sample is from the one before; else 0 and nothing.

        y moves in steps where all increments are whole numbers of the least one.
        """
        both = self.judged[1:] & self.judged[:-1]
        moved = np.abs(np.diff(self.y)[both])
        rounding = 64.0 * self.smallest
        if not np.any(moved > rounding):
            return 0.0, np.empty(0)
        step = float(np.min(moved[moved > rounding]))
        # of many small steps, so that the step's own rounding does not add up
        few = moved[(moved > rounding) & (moved < 1.5 * step)]
        step = float(np.mean(few))
        counts = np.rint(moved / step)
        off = np.abs(moved / step - counts)
        whole = np.mean(off < 0.05) > 0.99 and np.unique(counts).size > 1
        return (step, counts) if whole else (0.0, np.empty(0))

    def step(self) -> float:
        """The step of a quantised y; 0 where it is not."""
        return self.increments()[0]

    def coarse_step(self) -> float:
        """The step of y where most samples move by one of it or not at all; else 0."""
        step, counts = self.increments()
        return step if step and np.mean(counts <= 1.0) > 0.5 else 0.0


def longest(log: Given) -> tuple[Array, Array, Array | None, int]:
    """t or a period, y, u and the number of samples of a log; of one whose clock starts again the
    arrays are those of its longest piece.
    """
    whole = len(log.t) if isinstance(log, Log) else 0
    if isinstance(log, Log):
        log = max(log.pieces, key=lambda piece: len(piece.t))
    t, y, u = of_log(log, "log_or_noise")
    clock, y = check_array(t, "t"), check_array(y, "y")
    return clock, y, None if u is None else check_array(u, "u"), whole or len(np.atleast_1d(y))


def check_inputs(log: Given, n_u: int) -> None:
    """Refuse a log without the inputs of a model, or with others."""
    _, y, given, _ = longest(log)
    u = records.inputs(given, len(y), n_u)
    records.check_inputs(u)


def busiest(y: Array, first: int, most: int) -> slice:
    """The rows of at most `most` samples, from `first` on, in which y moves most; all if few."""
    if len(y) <= most:
        return slice(0, len(y))
    moved = np.abs(np.diff(y, axis=0, prepend=y[:1]))
    scale = np.nanmean(moved, axis=0)
    way = np.nan_to_num(moved / np.where(scale > 0.0, scale, 1.0)).reshape(len(y), -1).sum(axis=1)
    along = np.cumsum(way)
    first = min(first, len(y) - most)
    k = first + int(np.argmax(along[first + most - 1 :] - along[first : len(y) - most + 1]))
    return slice(k, k + most)


def _judged(t: Array, y: Array, usual: float, skip: float) -> npt.NDArray[np.bool_]:
    """Samples after `skip`, and after a gap not before the estimate is found again: for as long as
    it was left alone.
    """
    there = np.flatnonzero(np.isfinite(y))
    waits = np.diff(t[there])
    gap = np.flatnonzero(waits > 1.5 * usual)
    found = np.full(len(y), -np.inf)
    found[there[gap + 1]] = t[there[gap + 1]] + np.minimum(waits[gap] - usual, skip)
    known = t >= np.maximum.accumulate(found)
    return np.asarray(np.isfinite(y) & (t - t[0] >= skip) & known)
