"""What `simulate` returns: named arrays, with a picture at hand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, check_integer, check_number
from hgo_rs.read_only import shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SimulationResult:
    """An experiment with R runs, W windows, S signals and F kept frames.

    Signals are the errors x_hat - x (n of them), then the rest of the observer's memory.

    Attributes
    ----------
    metrics : dict
        What was asked for of `mean`, `rms`, `max` and `peak`.
    settling_time : (R,) [s]
        Last time at which ||x_hat - x|| >= settle; NaN if `settle` was not given.
    diverged_at : (R,) int
        First step at which a state was not finite or beyond 1e12, -1 if none. Such a run stops
        there and its metrics cover the steps before.
    undefined_at : (R,) int
        First step at which the observer's model had no value and the estimate was held, -1 if none.
    final_x, final_memory : (R, ·)
    time : (F,) [s];  x : (R, F, nx);  memory : (R, F, m);  y : (R, F, n_y)
        Kept frames, None without `every`.
    spec : dict
        The experiment as plain data, read-only.
    shared : tuple of str
        What moved alike in all runs and so was moved once: "plant", or nothing.
    """

    metrics: dict[str, Array]
    settling_time: Array
    diverged_at: npt.NDArray[np.int64]
    undefined_at: npt.NDArray[np.int64]
    final_x: Array
    final_memory: Array
    time: Array | None
    x: Array | None
    memory: Array | None
    y: Array | None
    histogram: dict[str, Array] | None
    n: int
    spec: dict[str, Any]
    shared: tuple[str, ...] = ()

    @property
    def timing(self) -> str:
        """Whether the estimate at sample k uses samples up to k - 1, or up to k."""
        observer = self.spec["observer"]
        own = "current" if observer["kind"] == "reduced-order" else "predictor"
        return str(observer.get("timing", own))

    @property
    def _estimated(self) -> list[int]:
        """Which states of the plant are estimated."""
        first = 3 if self.spec["plant"]["kind"] == "ship" else 0
        return list(self.spec.get("truth", range(first, first + self.n)))

    def _metric(self, name: str) -> Array:
        if name not in self.metrics:
            asked = ", ".join(self.metrics) or "none"
            raise HgoError(f"{name} was not asked for: metrics = {asked}; add {name!r} to metrics")
        return self.metrics[name]

    @property
    def mean(self) -> Array:
        """Mean of each signal in each window, (R, W, S)."""
        return self._metric("mean")

    @property
    def rms(self) -> Array:
        """Root mean square of each signal in each window, (R, W, S)."""
        return self._metric("rms")

    @property
    def max(self) -> Array:
        """Largest magnitude of each signal in each window, (R, W, S)."""
        return self._metric("max")

    @property
    def peak(self) -> Array:
        """Largest magnitude of each memory entry, (R, m)."""
        return self._metric("peak")

    @property
    def std(self) -> Array:
        """Standard deviation of each signal in each window, (R, W, S)."""
        return np.asarray(np.sqrt(np.maximum(self.rms**2 - self.mean**2, 0.0)))

    @property
    def x_hat(self) -> Array | None:
        """Estimates at the kept frames, (R, F, n); a part of `memory`, read-only."""
        return None if self.memory is None else shown(self.memory[..., : self.n])

    def quantile(self, q: float) -> float:
        """Quantile of ||x_hat - x||^2 over all runs in the histogram's window (to about 1 %)."""
        q = check_number(q, "q", least=0.0, most=1.0)
        if self.histogram is None:
            raise HgoError("quantile: simulate was called without histogram=(from, to)")
        counts = np.cumsum(self.histogram["counts"])
        if counts[-1] == 0:
            raise HgoError("quantile: every run diverged before the histogram's window")
        edges = self.histogram["edges"]
        return float(np.interp(q, counts / counts[-1], edges[1:]))

    def plot(self, figure: Figure | None = None, run: int = 0) -> Figure:
        """Draw one run: states and estimates. Needs `every` and the extra `plot`."""
        from hgo_rs.plots import estimate_figure

        if self.time is None or self.x is None or self.x_hat is None:
            raise HgoError("plot: simulate was called without every=, so no frame was kept")
        run = check_integer(run, "run", least=0, most=len(self.x) - 1)
        truth = self.x[run][:, self._estimated]
        return estimate_figure(self.time, self.x_hat[run], x=truth, figure=figure)
