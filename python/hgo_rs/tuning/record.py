"""A record to choose a gain by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import check, check_array, check_number
from hgo_rs.observers import Observer
from hgo_rs.tuning.result import Array


@dataclass(frozen=True, eq=False)
class Record:
    """A log, and the part of it that is judged."""

    arguments: tuple[Any, ...]
    y: Array
    dt: float
    skip: float
    judged: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, log: tuple[npt.ArrayLike, ...], skip: float | None) -> Record:
        fits = len(log) in (2, 3)
        check(fits, "log_or_noise", f"{len(log)} arrays", "(t, y) or (t, y, u)", "give these")
        clock, y = check_array(log[0], "t"), check_array(log[1], "y")
        y = y[:, 0] if y.ndim == 2 and y.shape[1] == 1 else y
        one = y.ndim == 1 and clock.shape in ((), y.shape)
        shapes = f"{clock.shape}, {y.shape}"
        check(one, "shapes of t and y", shapes, "(N,) each, or t a period", "give one output")
        longer = "give a longer log"
        check(len(y) >= 50, "samples of the log", len(y), ">= 50", longer)
        t = clock
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
        there = np.flatnonzero(np.isfinite(y))
        check(
            there.size >= 50, "samples of the log that are not missing", there.size, ">= 50", longer
        )
        waits = np.diff(t[there])
        period = float(np.median(waits))
        # After a gap the estimate has to be found again, for as long as it was left alone.
        gap = np.flatnonzero(waits > 1.5 * period)
        found = np.full(len(y), -np.inf)
        found[there[gap + 1]] = t[there[gap + 1]] + np.minimum(waits[gap] - period, start)
        judged = np.isfinite(y) & (t - t[0] >= start) & (t >= np.maximum.accumulate(found))
        enough = int(np.sum(judged))
        remedy = f"{longer}, steadier steps (their median is {period:.4g} s), or a shorter skip"
        check(enough >= 50, "samples after skip and gaps", enough, ">= 50", remedy)
        arguments = (clock if clock.ndim else float(clock), y, *log[2:])
        return cls(arguments, y, period, start, judged)

    def innovation(self, observer: Observer) -> Array:
        """The innovation y - y_hat, NaN where it is not judged."""
        start = np.zeros(observer.n)
        start[0] = self.y[np.argmax(np.isfinite(self.y))]
        run = observer.run(*self.arguments, x_hat0=start)
        return np.where(self.judged, np.ravel(run.innovation), np.nan)

    def moves(self, n: int) -> None:
        """Refuse a record that stands still."""
        values = np.unique(self.y[self.judged]).size
        allowed = f"> {n}, the order: a record that stands still tells of no gain"
        remedy = "give a log in which y moves, or the noise level in its place"
        check(values > n, "distinct values of y after skip", values, allowed, remedy)

    def coarse_step(self) -> float:
        """The step of y where most samples move by one of it or not at all; else 0.

        All increments are whole numbers of it.
        """
        both = self.judged[1:] & self.judged[:-1]
        moved = np.abs(np.diff(self.y)[both])
        rounding = 64.0 * np.finfo(np.float64).eps * float(np.max(np.abs(self.y[self.judged])))
        if not np.any(moved > rounding):
            return 0.0
        step = float(np.min(moved[moved > rounding]))
        counts = np.rint(moved / step)
        whole = np.mean(np.abs(moved / step - counts) < 0.05) > 0.99
        coarse = np.mean(counts <= 1.0) > 0.5 and np.unique(counts).size > 1
        return step if whole and coarse else 0.0
