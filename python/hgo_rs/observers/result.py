"""What a run returns: named arrays, with a picture and tables at hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, check, explain, need
from hgo_rs.observers.labels import Labels
from hgo_rs.observers.told import result_html, result_line
from hgo_rs.observers.whiteness import LAGS, normal_width, normality, whiteness
from hgo_rs.read_only import shown

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Gap:
    """A run of missing samples: first index, number, duration until the next sample [s], and the
    output (counted from 0).
    """

    start: int
    length: int
    duration: float
    channel: int = 0


@dataclass(frozen=True, eq=False, repr=False)
class RunResult:
    """Result of an observer over a record of N samples. Its arrays are read-only, because they
    share memory (`x_hat` is a part of `memory`).

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
        Samples with a missing output, which was predicted.
    gain : (N,) or None
        ell, or r where it moves.
    y : (N, n_y)
        The samples.
    memory : (N, m)
        The whole memory.
    timing : "predictor" or "current"
        Whether row k uses samples up to k - 1, or up to k.
    slowdown : float
        Estimated time of the run over that with a compiled model: 1 for a compiled model, more for
        a Python callable that could not be compiled.
    next_memory : (m,) or None
        The memory at `until`, for a run with `until`.
    deviation : (N, n) or None
        Standard deviations of the estimates, for a run with noise and model error: from the
        covariance of the observer's error, linearised along the estimates.
    gated : (N, n_y) bool or None
        Outliers, for a run with a gate: `y` is NaN there, and they count as missing.
    labels : Labels
        Names and units of the estimates, where the model has some.
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
    deviation: ClassVar[Array | None] = None
    gated: ClassVar[npt.NDArray[np.bool_] | None] = None
    labels: ClassVar[Labels] = Labels()

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
        for name in ("deviation", "gated"):
            values = getattr(self, name)
            if values is not None:
                part.__dict__[name] = values[rows]
        if "_run_of" in self.__dict__:
            observer, u = self.__dict__["_run_of"]
            part.__dict__["_run_of"] = (observer, u[rows])
        return part

    @property
    def gaps(self) -> list[Gap]:
        """Every run of missing samples, output by output.

        With several outputs each has a rate of its own: a gap is an interval of more than one and a
        half times the median one, and begins where the next sample was due.
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

        From the same gaps cut into complete parts of the record; see `hgo_rs.observers.gaps`.
        Computed at the first access. Also NaN for a model that runs as Python.
        """
        if "_gap_error" not in self.__dict__:
            self.__dict__["_gap_error"] = self.error_after(self.gaps)
        error: Array = self.__dict__["_gap_error"]
        return error

    def error_after(self, gaps: Sequence[Gap]) -> Array:
        """As `gap_error`, for some of `gaps`."""
        if not gaps:
            return np.empty((0, self.x_hat.shape[1]))
        if "_run_of" not in self.__dict__:
            raise HgoError("gap_error: only a result of Observer.run knows its observer")
        observer, u = self.__dict__["_run_of"]
        error: Array = observer._gap_error(self, u, gaps)
        return error

    def band(self, level: float = 0.95) -> tuple[Array, Array]:
        """Lower and upper ends, (N, n) each, between which a state lies with this probability.

        Raises
        ------
        HgoError
            A run without noise and model error.
        """
        remedy = "run(..., noise=, model_error=)"
        check(self.deviation is not None, "deviation", None, "known", remedy)
        wide = normal_width(level) * np.asarray(self.deviation)
        return self.x_hat - wide, self.x_hat + wide

    @property
    def whiteness(self) -> float:
        """p-value of a test of the innovations for whiteness: the least over the outputs, after the
        first twentieth of the record. NaN for too few samples.
        """
        return self._probable(whiteness)

    @property
    def normality(self) -> float:
        """p-value of a test of the innovations for normality; as `whiteness`."""
        return self._probable(normality)

    def _probable(self, test: Callable[[Array], float]) -> float:
        late = self.innovation[len(self.innovation) // 20 :]
        columns = [column[np.isfinite(column)] for column in late.T]
        return min((test(c) for c in columns if len(c) > 2 * LAGS), default=float("nan"))

    def plot(self, figure: Figure | None = None) -> Figure:
        """Draw estimates, with their bands where deviations are known, innovation and gain. Needs
        the extra `plot`.
        """
        from hgo_rs.plots import estimate_figure

        single = self.y.shape[1] == 1
        return estimate_figure(
            self.time,
            self.x_hat,
            y=self.y[:, 0] if single else None,
            innovation=self.innovation[:, 0] if single else None,
            missing=self.missing,
            gain=self.gain,
            band=None if self.deviation is None else self.band(),
            names=self.labels.titles(self.x_hat.shape[1]),
            figure=figure,
        )

    def __repr__(self) -> str:
        return result_line(self)

    def _repr_html_(self) -> str:
        return result_html(self)

    def of(self, name: str) -> Array:
        """The estimate (N,) of a state or an unknown, by the name that the model gives it."""
        if name not in self.labels.states:
            remedy = "choose one of the model's states" if self.labels.states else "give a Model"
            raise HgoError(explain("of", name, f"one of {list(self.labels.states)}", remedy))
        return shown(self.x_hat[:, self.labels.states.index(name)])

    def columns(self, *, units: bool = False) -> dict[str, Array]:
        """Every signal as a named column (N,): estimates by the model's names, else x_hat1, ...

        With `units=True` the units of the model follow the names, as in "T_load [N m]".
        """
        out = {"time": self.time}
        name = self.labels.heading if units else self.labels.column
        out |= {name(i): column for i, column in enumerate(self.x_hat.T)}
        if self.deviation is not None:
            out |= {self.labels.deviation(i): column for i, column in enumerate(self.deviation.T)}
        out |= {f"innovation{i + 1}": column for i, column in enumerate(self.innovation.T)}
        if self.gain is not None:
            out["gain"] = self.gain
        out["missing"] = self.missing.astype(float)
        if self.gated is not None:
            out["gated"] = self.gated.any(axis=1).astype(float)
        return out

    def to_dataframe(self) -> Any:
        """A pandas DataFrame indexed by time; units are in its `attrs["units"]`, by column.

        Needs the extra `data`.
        """
        pd = need("pandas", "a table needs pandas", "data")
        table = pd.DataFrame(self.columns()).set_index("time")
        if self._units:
            table.attrs["units"] = self._units
        return table

    @property
    def _units(self) -> dict[str, str]:
        """Units by column."""
        n, labels = self.x_hat.shape[1], self.labels
        return {labels.column(i): labels.unit(i) for i in range(n) if labels.unit(i)}

    def to_xarray(self) -> Any:
        """An xarray Dataset over time, units as the attribute `units`. Needs the extra `xarray`."""
        xr = need("xarray", "a Dataset needs xarray", "xarray")
        columns = self.columns()
        time = columns.pop("time")
        units = {name: {"units": unit} for name, unit in self._units.items()}
        data = {name: ("time", values, units.get(name, {})) for name, values in columns.items()}
        return xr.Dataset(data, coords={"time": time})
