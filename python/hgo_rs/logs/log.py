"""A recorded log, and what is told of one."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hgo_rs.errors import printable


@dataclass(frozen=True, repr=False)
class Log:
    """A recorded log, or a chunk of one.

    Attributes
    ----------
    t : (N,) float, s
        Sample times, strictly increasing within a piece, steps as recorded.
    y : (N,) or (N, n_y) float
        Measured output, or outputs; NaN where a sample is missing.
    u : (N,), (N, n_u) float or None
        Known inputs.
    names : dict
        Column names: "time" (None if the time comes from `dt` or a schedule), "output", "input":
        one name, or a list.
    source : str
        The file.
    missing : as y, bool
        Where a sample is missing.
    starts : tuple of int
        Where a piece begins: 0, and each reset of the clock.
    remarks : tuple of str
        What was found out about the log and not asked for, such as the unit of its times.
    assumed : bool
        Whether the unit of its times is a guess: neither given, nor said by the column's name.
    """

    t: np.ndarray
    y: np.ndarray
    u: np.ndarray | None
    names: dict[str, Any]
    source: str
    missing: np.ndarray
    starts: tuple[int, ...] = (0,)
    remarks: tuple[str, ...] = ()
    assumed: bool = False

    def __repr__(self) -> str:
        signals = {key: self.names.get(key) for key in ("output", "input")}
        told = ", ".join(f"{key} = {name!r}" for key, name in signals.items() if name)
        return f"Log({len(self.t)} samples of {printable(self.source)}: {told})"

    @property
    def pieces(self) -> list[Log]:
        """A log for each piece between resets of the clock."""
        edges = [0, *(k for k in self.starts if k > 0), len(self.t)]
        return [self.rows(slice(a, b)) for a, b in itertools.pairwise(edges)]

    def rows(self, rows: slice) -> Log:
        """Some rows, as a log of one piece."""
        u = None if self.u is None else self.u[rows]
        t, y, missing = self.t[rows], self.y[rows], self.missing[rows]
        return Log(t, y, u, self.names, self.source, missing, (0,), self.remarks, self.assumed)

    @property
    def longest_gap(self) -> tuple[int, int]:
        """The longest run of rows without any sample, as a half-open range of indices; (0, 0):
        none.
        """
        starts, stops = _runs(np.all(self.missing.reshape(len(self.t), -1), axis=1))
        if not len(starts):
            return 0, 0
        i = int(np.argmax(stops - starts))
        return int(starts[i]), int(stops[i])

    def describe(self) -> str:
        """Samples, span, missing samples and remarks, in some lines."""
        summary = LogSummary()
        summary.add(self)
        return summary.describe()


def _runs(holds: Any) -> tuple[np.ndarray, np.ndarray]:
    """First and one-past-last indices of every run of True."""
    edges = np.flatnonzero(np.diff(np.r_[0, holds, 0]))
    return edges[::2], edges[1::2]


class LogSummary:
    """Samples, span and missing samples of a log that is seen chunk by chunk."""

    def __init__(self) -> None:
        self.count = 0
        self.pieces = 0
        self._span = (math.nan, math.nan)
        self._typical = math.nan
        self._longest = (0.0, math.nan)
        self._channels: list[_Missing] = []
        self._remarks: dict[str, None] = {}

    def add(self, log: Log) -> None:
        """Take in the next chunk."""
        self._remarks.update(dict.fromkeys(log.remarks))
        last = self._span[1]
        steps = np.diff(log.t, prepend=log.t[:1] if self.count == 0 else last)
        steps[list(log.starts)] = 0.0  # over a reset there is none
        if self.count == 0:
            self._span = (float(log.t[0]), last)
            outputs = log.names["output"]
            names = [outputs] if isinstance(outputs, str) else list(outputs)
            self._channels = [_Missing(name) for name in names]
            within = steps[steps > 0.0]
            self._typical = float(np.median(within)) if len(within) else math.nan
        self.pieces += len(log.starts)
        k = int(np.argmax(steps))
        if steps[k] > self._longest[0]:
            before = last if k == 0 else float(log.t[k - 1])
            self._longest = (float(steps[k]), before)
        for channel, none in zip(
            self._channels, log.missing.reshape(len(log.t), -1).T, strict=True
        ):
            channel.add(none, log.t)
        self._span = (self._span[0], float(log.t[-1]))
        self.count += len(log.t)

    @property
    def empty_channels(self) -> list[str]:
        """The outputs that hold no sample at all."""
        return [c.name for c in self._channels if c.count == self.count]

    def describe(self) -> str:
        """What was seen, in some lines."""
        text = (
            f"{self.count} samples from {self._span[0]:.10g} s to {self._span[1]:.10g} s, "
            f"median step {self._typical:.6g} s"
        )
        step, at = self._longest
        if step > 1.5 * self._typical:
            text += f", longest step {step:.6g} s at t = {at:.10g} s"
        if self.pieces > 1:
            text += f", {self.pieces} pieces between resets of the clock"
        several = len(self._channels) > 1
        for channel in self._channels:
            if channel.count:
                name = f"{printable(channel.name)}: " if several else ""
                text += f"\n{name}{channel.describe()}"
        return "\n".join([text, *self._remarks])


class _Missing:
    """The missing samples of one output."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.count = 0
        self._open = (0, math.nan)  # the run that the last chunk ended in: length, begin
        self._longest = (0, math.nan, math.nan)

    def add(self, none: np.ndarray, t: np.ndarray) -> None:
        self.count += int(none.sum())
        starts, stops = _runs(none)
        carried, begin = self._open
        self._open = (0, math.nan)
        for a, b in zip(starts.tolist(), stops.tolist(), strict=True):
            joined = a == 0 and carried > 0
            length = b - a + (carried if joined else 0)
            first = begin if joined else float(t[a])
            if length > self._longest[0]:
                self._longest = (length, first, float(t[b - 1]))
            if b == len(t):
                self._open = (length, first)

    def describe(self) -> str:
        length, first, last = self._longest
        return (
            f"{self.count} missing sample{'s' if self.count > 1 else ''}; the longest gap has "
            f"{length}, from t = {first:.10g} s to {last:.10g} s"
        )
