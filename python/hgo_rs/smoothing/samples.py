"""A record of one output or several, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import check
from hgo_rs.logs import Log
from hgo_rs.observers import records

Array = npt.NDArray[np.float64]

Given = Log | Sequence[npt.ArrayLike]
"""A log, (t, y) or (t, y, u)."""

LEAST = 20  # samples
_SAMPLED = 256  # a step of y is told by so many increments at least


@dataclass(frozen=True, eq=False)
class Samples:
    """A record: t (N,), y (N, n_y) with NaN where a sample is missing, u (N, n_u)."""

    t: Array
    y: Array
    u: Array

    @classmethod
    def of(cls, log: Given, n_y: int, n_u: int) -> Samples:
        """A log as arrays, with as many outputs and inputs as a model has.

        Raises
        ------
        HgoError
            Shapes that do not fit; times that do not increase, or a log whose clock starts again;
            an infinite sample; an output without samples.
        """
        if isinstance(log, Log):
            remedy = "take one of log.pieces: between them the states are not related"
            check(len(log.starts) == 1, "pieces of the log", len(log.starts), "1", remedy)
            log = (log.t, log.y) if log.u is None else (log.t, log.y, log.u)
        check(len(log) in (2, 3), "log", f"{len(log)} arrays", "(t, y) or (t, y, u)", "give these")
        y = records.samples(log[1], n_y)
        records.check_samples(y, n_y)
        clock = records.clock(log[0], len(y))
        records.check_times(clock)
        t = clock * np.arange(len(y)) if isinstance(clock, float) else np.asarray(clock)
        u = records.inputs(log[2] if len(log) == 3 and n_u else None, len(y), n_u)
        records.check_inputs(u)
        for channel, there in enumerate(np.sum(np.isfinite(y), axis=0).tolist()):
            name = f"samples of output {channel + 1} that are not missing"
            check(there >= LEAST, name, there, f">= {LEAST}", "give a longer log")
        return cls(np.array(t), np.array(y), np.array(u))

    @property
    def dt(self) -> Array:
        """The steps, (N - 1,)."""
        return np.diff(self.t)

    @property
    def missing(self) -> npt.NDArray[np.bool_]:
        """Where an output is missing, (N, n_y)."""
        return ~np.isfinite(self.y)

    def first(self, channel: int) -> float:
        """The first sample of an output that is there."""
        y = self.y[:, channel]
        return float(y[np.argmax(np.isfinite(y))])

    def usual(self, channel: int) -> float:
        """The median time between samples of an output [s]."""
        return float(np.median(np.diff(self.t[np.isfinite(self.y[:, channel])])))

    def rate(self, channel: int, order: int) -> float:
        """RMS of the derivative of an output, by differences of this order."""
        there = np.isfinite(self.y[:, channel])
        values, t = self.y[there, channel], self.t[there]
        for _ in range(order):
            values = np.diff(values) / np.diff(t)
            t = 0.5 * (t[1:] + t[:-1])
        return float(np.sqrt(np.mean(values**2)))

    def noise(self, channel: int) -> float:
        """A variance that white noise in an output hardly exceeds: of third differences."""
        y = self.y[:, channel]
        differences = np.diff(y[np.isfinite(y)], 3)
        return float(np.mean(differences**2)) / 20.0

    def step(self, channel: int) -> float:
        """The step of an output that is quantised; 0 where it is not.

        All increments are then whole numbers of the least one.
        """
        moved = np.abs(np.diff(self.y[:, channel][np.isfinite(self.y[:, channel])]))
        rounding = 64.0 * np.finfo(np.float64).eps * float(np.nanmax(np.abs(self.y[:, channel])))
        moved = moved[moved > rounding]
        if moved.size < _SAMPLED:
            return 0.0
        least = float(np.min(moved))
        step = float(np.mean(moved[moved < 1.5 * least]))
        counts = np.rint(moved / step)
        whole = np.mean(np.abs(moved / step - counts) < 0.05) > 0.99
        return step if whole and np.unique(counts).size > 1 else 0.0
