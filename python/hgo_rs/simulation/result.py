"""What `simulate` returns: named arrays, with a picture at hand."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, check_integer, check_number
from hgo_rs.expressions.grammar import unknown
from hgo_rs.markup import number, table
from hgo_rs.observers.labels import Labels
from hgo_rs.read_only import shown
from hgo_rs.simulation.feedback import COST, Loop

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]

_HEADS = {"rms": "largest RMS", "max": "largest magnitude"}


@dataclass(frozen=True, eq=False, repr=False)
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
        Parts that are equal in all runs and were computed once: "plant", or nothing.
    loop : Loop
        Names of the plant's states, and of inputs, signals and the controller's states: those of
        `columns` (R, F, ·), kept frames, and `final_columns` (R, ·). `of(name)` has all of one.
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
    loop: Loop | None = None
    final_columns: Array | None = None
    columns: Array | None = None

    @property
    def timing(self) -> str:
        """Whether the estimate at sample k uses samples up to k - 1, or up to k."""
        observer = self.spec["observer"]
        own = "current" if observer["kind"] == "reduced-order" else "predictor"
        return str(observer.get("timing", own))

    @property
    def _labels(self) -> Labels:
        """Names and units of the estimates."""
        return Labels.of(self.spec["observer"], self.n)

    @property
    def _estimated(self) -> list[int]:
        """Which states of the plant are estimated."""
        first = 3 if self.spec["plant"]["kind"] == "ship" else 0
        return list(self.spec.get("truth", range(first, first + self.n)))

    def _metric(self, name: str) -> Array:
        if name not in self.metrics:
            asked = ", ".join(key for key in self.metrics if "signal" not in key) or "none"
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

    @property
    def cost(self) -> Array:
        """Integral of the cost over each run, (R,); until it diverged where it did."""
        if self.loop is None or not self.loop.has_cost:
            raise HgoError("cost: simulate was called without cost=")
        return self._column(COST)

    @property
    def converged(self) -> npt.NDArray[np.bool_]:
        """Whether each run ended within its bound, (R,)."""
        bounds = None if self.loop is None else self.loop.converged
        if bounds is None:
            raise HgoError("converged: simulate was called without converged=")
        good = np.asarray(self.diverged_at < 0)
        for name, bound in bounds.items():
            if name:
                size = np.abs(self._column(name))
            else:
                with np.errstate(over="ignore"):  # of a run that diverged
                    size = np.linalg.norm(self.final_x, axis=-1)
            good = good & (size <= bound)
        return good

    def _column(self, name: str) -> Array:
        """The last value of a column of the loop."""
        assert self.loop is not None and self.final_columns is not None
        return shown(self.final_columns[:, self.loop.place(name)])

    def of(self, name: str) -> dict[str, Array]:
        """All of a signal, an input in force, or a state of the plant or of the controller; of an
        unknown of the observer's model, `T_load_hat` (`T_load` where the plant has no such state).

        `final` (R,) and, with `every`, `frames` (R, F). A signal has besides: what was asked for of
        `mean`, `rms`, `max` (R, W) and `peak` (R,), and `settling_time` (R,) [s], NaN without a
        threshold.
        """
        entry = self._labels.place(name)
        if entry is not None and (self.loop is None or name not in self.loop.columns):
            kept = {} if self.x_hat is None else {"frames": self.x_hat[..., entry]}
            return {"final": shown(self.final_memory[:, entry]), **kept}
        if self.loop is None or self.final_columns is None:
            raise HgoError(f"of({name!r}): there are no signals here")
        if name not in self.loop.columns:
            raise HgoError(f"of: {unknown(name, self.loop.columns, 'signal')}")
        place = self.loop.place(name)
        found = {"final": shown(self.final_columns[:, place])}
        if self.columns is not None:
            found["frames"] = shown(self.columns[..., place])
        if name in self.loop.signals:
            i = self.loop.signals.index(name)
            for key, values in self.metrics.items():
                if key.startswith("signal_"):
                    found[key.removeprefix("signal_")] = shown(values[..., i])
        return found

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

    def __repr__(self) -> str:
        runs = len(self.diverged_at)
        lost = int(np.sum(self.diverged_at >= 0))
        told = [f"{runs} run{'' if runs == 1 else 's'} of {self.spec['steps']} steps"]
        told += [f"{lost} diverged"] if lost else []
        told += [f"{len(self.time)} frames kept"] if self.time is not None else []
        return f"SimulationResult({', '.join(told)}; {', '.join(self._names)})"

    def _repr_html_(self) -> str:
        """The largest RMS and magnitude of each error, but for runs that diverged."""
        good = self.diverged_at < 0
        kept = {key: self.metrics[key][good] for key in ("rms", "max") if key in self.metrics}
        kept = {key: values for key, values in kept.items() if values.size}
        rows = [
            (name, *(number(float(values[..., i].max())) for values in kept.values()))
            for i, name in enumerate(self._names)
        ]
        return table(repr(self), rows, ["error of", *(_HEADS[key] for key in kept)])

    @property
    def _names(self) -> list[str]:
        """The estimates: the model's states, else x1, x2, ..."""
        return self._labels.names(self.n)

    def plot(self, figure: Figure | None = None, run: int = 0) -> Figure:
        """Draw one run: states and estimates. Needs `every` and the extra `plot`."""
        from hgo_rs.plots import estimate_figure

        if self.time is None or self.x is None or self.x_hat is None:
            raise HgoError("plot: simulate was called without every=, so no frame was kept")
        run = check_integer(run, "run", least=0, most=len(self.x) - 1)
        there = [state for state in self._estimated if state < self.x.shape[2]]
        truth = np.full(self.x_hat[run].shape, np.nan)  # of what is no state of the plant
        truth[:, : len(there)] = self.x[run][:, there]
        names = self._labels.titles(self.n)
        return estimate_figure(self.time, self.x_hat[run], x=truth, names=names, figure=figure)
