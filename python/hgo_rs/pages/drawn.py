"""The record that a page draws."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import check
from hgo_rs.observers import Observer
from hgo_rs.pages.module import packed
from hgo_rs.tuning.record import longest

Array = npt.NDArray[np.float64]

MOST = 50_000
"""Samples of a page; a longer log is decimated."""


def check_outputs(count: int) -> None:
    """Refuse a log, or a tuning, of several outputs."""
    remedy = "tune one output, with the others' estimates as inputs, and draw that"
    check(count == 1, "outputs of the log", count, "1, for a page", remedy)


@dataclass(frozen=True)
class Drawn:
    """The record that a page draws.

    ``period``: where it was given in place of times.  ``decimated``: what was left out, in words.
    """

    t: Array
    y: Array
    u: Array | None
    period: float | None
    decimated: str

    @classmethod
    def of(cls, log: Any, most: int = MOST) -> Drawn:
        """The longest piece of a log of one output; of one of more than `most` samples every k-th.

        Raises
        ------
        HgoError
            Several outputs.
        """
        clock, y, u, whole = longest(log)
        y = y[:, 0] if y.ndim == 2 and y.shape[1] == 1 else y
        check_outputs(1 if y.ndim == 1 else y.shape[-1])
        u = u[:, None] if u is not None and u.ndim == 1 else u
        t, period = clock, None
        if not clock.ndim:
            period = float(clock)
            t = period * np.arange(len(y), dtype=np.float64)
        said = []
        if len(y) < whole:
            said.append(f"the longest piece of the log: {len(y)} of its {whole} samples")
        k = math.ceil(len(y) / most)
        if k > 1:
            means = ", inputs as the means between them" if u is not None else ""
            said.append(
                f"decimated: 1 of {k} samples is kept, of {len(y)}{means}; all numbers are for "
                "this longer step"
            )
            if u is not None:  # each is held until the next sample
                u = np.array([np.mean(u[i : i + k], axis=0) for i in range(0, len(u), k)])
            t, y, period = t[::k], y[::k], None if period is None else k * period
        return cls(t, y, u, period, "; ".join(said))

    @property
    def clock(self) -> Array | float:
        return self.t if self.period is None else self.period

    @property
    def first(self) -> Array:
        """The first sample that is there, (1,); NaN where there is none."""
        there = self.y[np.isfinite(self.y)]
        return there[:1] if there.size else np.array([np.nan])

    @property
    def usual(self) -> float:
        """The median step [s]."""
        return float(np.median(np.diff(self.t)))

    def run(self, observer: Observer, start: str) -> Array:
        """Estimates (N, n), as the page has them."""
        u = self.u if observer.n_u else None
        return observer.run(self.clock, self.y, u, start=start).x_hat

    @property
    def data(self) -> dict[str, Any]:
        """As the page holds it."""
        steps = np.diff(self.t)
        return {
            "samples": len(self.y),
            "period": self.period,
            "t": None if self.period is not None else packed(self.t),
            "y": packed(self.y),
            "u": None if self.u is None else packed(self.u),
            "inputs": 0 if self.u is None else self.u.shape[1],
            "dt": self.usual,
            "longest": float(np.max(steps)),
        }
