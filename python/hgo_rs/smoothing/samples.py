"""A record of one output or several, as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import check
from hgo_rs.observers import records, turns
from hgo_rs.signals import Given, of_log

__all__ = ["Array", "Given", "Samples"]

Array = npt.NDArray[np.float64]

LEAST = 20  # samples


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
        times, y, u = of_log(log)
        y = records.samples(y, n_y)
        records.check_samples(y, n_y)
        clock = records.clock(times, len(y))
        records.check_times(clock)
        t = clock * np.arange(len(y)) if isinstance(clock, float) else np.asarray(clock)
        u = records.inputs(u if n_u else None, len(y), n_u)
        records.check_inputs(u)
        for channel, there in enumerate(np.sum(np.isfinite(y), axis=0).tolist()):
            name = f"samples of output {channel + 1} that are not missing"
            check(there >= LEAST, name, there, f">= {LEAST}", "give a longer log")
        return cls(np.array(t), np.array(y), np.array(u))

    def unwrapped(self, lengths: Sequence[float | None]) -> Samples:
        """The same with outputs that go on over their turns; None: one that has none."""
        columns = [
            column if length is None else turns.unwrapped(column, length)
            for column, length in zip(self.y.T, lengths, strict=True)
        ]
        return replace(self, y=np.column_stack(columns))

    def warn_of_turns(self, stacklevel: int) -> None:
        """Warn of outputs that jump by a turn of which nobody knows."""
        count = self.y.shape[1]
        names = [f"y{i + 1}" for i in range(count)] if count > 1 else ["y"]
        turns.warn_of_turns(self.y, [None] * count, names, turns.UNWRAP, stacklevel + 1)

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
