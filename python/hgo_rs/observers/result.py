"""What a call returns: named arrays, with a picture and tables at hand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, MissingExtraError, check_integer, check_number
from hgo_rs.read_only import shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Gap", "RunResult", "SimulationResult"]

Array = npt.NDArray[np.float64]


def timing_of(observer: Mapping[str, Any]) -> str:
    """The timing of the observer that a spec describes, "predictor" or "current"."""
    own = "current" if observer["kind"] == "reduced-order" else "predictor"
    return str(observer.get("timing", own))


@dataclass(frozen=True)
class Gap:
    """A run of missing samples: first index, number, duration until the next sample [s], and the
    output (counted from 0) that they are missing of.
    """

    start: int
    length: int
    duration: float
    channel: int = 0


@dataclass(frozen=True, eq=False)
class RunResult:
    """An observer's run over a record of N samples. Its arrays are read-only: they belong together
    (`x_hat` is a part of `memory`), so that an edit of one would change others.

    Attributes
    ----------
    time : (N,) [s]
    x_hat : (N, n)
        Estimates.
    auxiliary : (N, m - n)
        The rest of the memory: auxiliary states eta, gains r.
    innovation : (N, n_y)
        y - y_hat before the sample was used; NaN where it was missing.
    missing : (N,) bool
        Samples of which an output was missing; it was predicted over.
    gain : (N,) or None
        ell, or r where it moves.
    y : (N, n_y)
        The samples.
    memory : (N, m)
        The whole memory.
    timing : "predictor" or "current"
        Whether row k uses samples up to k - 1, or up to k.
    slowdown : float
        How many times longer the run took than with a compiled model of the same size: 1 for every
        compiled model, more for a Python callable that could not be compiled.
    next_memory : (m,) or None
        The memory at `until`, where the run was given one.
    """

    time: Array
    x_hat: Array
    auxiliary: Array
    innovation: Array
    missing: npt.NDArray[np.bool_]
    gain: Array | None
    y: Array
    memory: Array
    timing: str

    @classmethod
    def of_run(cls, clock: float | Array, innovation: Array | None, **fields: Any) -> RunResult:
        """A result at times or under a period, whose laws predict unless an innovation is given.

        The times of a period and y - x_hat_1 are computed when they are first asked for.
        """
        made = object.__new__(cls)
        made.__dict__.update({name: shown(value) for name, value in fields.items()})
        if isinstance(clock, float):
            made.__dict__["_period"] = clock
        else:
            made.__dict__["time"] = shown(np.array(clock))
        if innovation is not None:
            made.__dict__["innovation"] = shown(innovation)
        return made

    slowdown = 1.0
    next_memory: ClassVar[Array | None] = None

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name == "time" and "_period" in self.__dict__:
                value = np.arange(len(self.memory), dtype=np.float64) * self._period
            elif name == "innovation" and "y" in self.__dict__:
                value = self.y - self.x_hat[:, : self.y.shape[1]]
            else:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            self.__dict__[name] = shown(value)
            return self.__dict__[name]

    def rows(self, rows: slice) -> RunResult:
        """Some rows of it."""
        part = object.__new__(type(self))
        part.__dict__.update(self.__dict__)
        for name in ("_period", "_gap_error"):
            part.__dict__.pop(name, None)
        fields = ("time", "x_hat", "auxiliary", "innovation", "missing", "gain", "y", "memory")
        for name in fields:
            values = getattr(self, name)
            part.__dict__[name] = None if values is None else values[rows]
        if "_run_of" in self.__dict__:
            observer, u = self.__dict__["_run_of"]
            part.__dict__["_run_of"] = (observer, u[rows])
        return part

    @property
    def inputs(self) -> Array | None:
        """The inputs (N, n_u) of a run with missing samples, which what gaps cost is computed with;
        None: not kept.
        """
        run: tuple[Any, Array] = self.__dict__.get("_run_of", (None, None))
        return run[1]

    @property
    def gaps(self) -> list[Gap]:
        """Every run of missing samples, output by output.

        With several outputs each has a rate of its own: a gap of it is a wait of more than one and
        a half times its median one, and begins where its next sample was due.
        """
        out = []
        t, rows = self.time, len(self.y)
        for channel, values in enumerate(self.y.T):
            there = np.flatnonzero(~np.isnan(values))
            runs = [(0, rows)] if not len(there) else []
            if len(there):
                first, last = int(there[0]), int(there[-1])
                begins, ends = there[:-1] + 1, there[1:]
                gap = ends > begins
                head, tail = (0, first), (last + 1, rows)
                if self.y.shape[1] > 1 and len(there) > 1:
                    wait = np.diff(t[there])
                    usual = float(np.median(wait))
                    gap = wait > 1.5 * usual
                    begins = np.searchsorted(t, t[there[:-1]] + 0.75 * usual)
                    head = head if t[first] - t[0] > 1.5 * usual else (0, 0)
                    tail = (int(np.searchsorted(t, t[last] + 1.5 * usual)), rows)
                inner = zip(begins[gap].tolist(), ends[gap].tolist(), strict=True)
                runs = [run for run in (head, *inner, tail) if run[1] > run[0]]
            for start, stop in runs:
                duration = float(t[min(stop, rows - 1)] - t[start])
                out.append(Gap(start, stop - start, duration, channel))
        return out

    @property
    def gap_error(self) -> Array:
        """Error to expect at the end of each of `gaps`, (number of gaps, n), NaN where unknown.

        What the same gaps, put into the complete parts of the record, do to the estimate; see
        `hgo_rs.gaps`. Computed when it is first asked for.
        """
        if "_gap_error" not in self.__dict__:
            from hgo_rs.gaps import gap_error

            if self.gaps and "_run_of" not in self.__dict__:
                raise HgoError("gap_error: only a result of Observer.run knows its observer")
            empty = np.empty((0, self.x_hat.shape[1]))
            observer, u = self.__dict__.get("_run_of", (None, None))
            self.__dict__["_gap_error"] = gap_error(observer, self, u) if observer else empty
        error: Array = self.__dict__["_gap_error"]
        return error

    def plot(self, figure: Figure | None = None) -> Figure:
        """Draw estimates, innovation and gain. Needs the extra `plot`."""
        from hgo_rs.plotting import estimate_figure

        single = self.y.shape[1] == 1
        return estimate_figure(
            self.time,
            self.x_hat,
            y=self.y[:, 0] if single else None,
            innovation=self.innovation[:, 0] if single else None,
            missing=self.missing,
            gain=self.gain,
            figure=figure,
        )

    def columns(self) -> dict[str, Array]:
        """Every signal as a named column (N,)."""
        out = {"time": self.time}
        out |= {f"x_hat{i + 1}": column for i, column in enumerate(self.x_hat.T)}
        out |= {f"innovation{i + 1}": column for i, column in enumerate(self.innovation.T)}
        if self.gain is not None:
            out["gain"] = self.gain
        out["missing"] = self.missing.astype(float)
        return out

    def to_dataframe(self) -> Any:
        """A pandas DataFrame indexed by time. Needs the extra `data`."""
        try:
            import pandas as pd
        except ImportError as error:
            raise MissingExtraError("a table needs pandas: pip install 'hgo_rs[data]'") from error
        return pd.DataFrame(self.columns()).set_index("time")

    def to_xarray(self) -> Any:
        """An xarray Dataset over time. Needs the extra `xarray`."""
        try:
            import xarray as xr
        except ImportError as error:
            raise MissingExtraError(
                "a Dataset needs xarray: pip install 'hgo_rs[xarray]'"
            ) from error
        columns = self.columns()
        time = columns.pop("time")
        data = {name: ("time", values) for name, values in columns.items()}
        return xr.Dataset(data, coords={"time": time})


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

    @property
    def timing(self) -> str:
        """Whether the estimate at sample k uses samples up to k - 1, or up to k."""
        return timing_of(self.spec["observer"])

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
        from hgo_rs.plotting import estimate_figure

        if self.time is None or self.x is None or self.x_hat is None:
            raise HgoError("plot: simulate was called without every=, so no frame was kept")
        run = check_integer(run, "run", least=0, most=len(self.x) - 1)
        truth = self.x[run][:, self._estimated]
        return estimate_figure(self.time, self.x_hat[run], x=truth, figure=figure)
