"""What a study gives: a table of cases, and every run behind it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import check, check_integer, need
from hgo_rs.markup import number, table
from hgo_rs.observers.labels import Labels
from hgo_rs.simulation.experiment import METRICS, Experiment, execute, result_of
from hgo_rs.simulation.result import SimulationResult
from hgo_rs.simulation.studies.cases import label, title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = npt.NDArray[Any]


class StudyInterrupted(KeyboardInterrupt):
    """Ctrl-C during a study; `result` holds the runs that are finished."""

    def __init__(self, message: str, result: StudyResult) -> None:
        super().__init__(message)
        self.result = result


class StudyError(RuntimeError):
    """A study that could not be finished; `result` holds the runs that are."""

    def __init__(self, message: str, result: StudyResult) -> None:
        super().__init__(message)
        self.result = result


@dataclass(frozen=True, eq=False, repr=False)
class StudyResult:
    """A study with C cases of R runs each. `result[i]` is case i as a `SimulationResult`, whose
    arrays are read-only.

    Runs that diverged are counted and named, and left out of every statistic of `table`; the
    metrics of their steps until then stay in `result[i]`. Of runs that are not finished (see
    `finished`) the numbers are NaN, and -1 in `diverged_at` and `undefined_at`.

    Attributes
    ----------
    parameters : list of dict
        The parameters of each case, as they were given; read-only.
    axes : dict or None
        Values of each parameter, if the cases are a full grid of them (the last varies fastest).
    finished : (C, R) bool
    seed : int
        Run i of every case draws from the streams (seed, i).
    shared : dict
        For each case the parts that are equal in all runs and were computed once.
    """

    parameters: list[dict[str, Any]]
    axes: dict[str, list[Any]] | None
    finished: npt.NDArray[np.bool_]
    seed: int
    backend: str
    experiments: list[Experiment]
    outputs: list[dict[str, Array]]
    engine: str = "auto"
    shared: dict[int, tuple[str, ...]] = field(default_factory=dict)

    # --- one case, one run ---------------------------------------------------------------------

    def __len__(self) -> int:
        return len(self.parameters)

    def __getitem__(self, case: int) -> SimulationResult:
        try:
            out: dict[str, Any] = {**self.outputs[case], "shared": self.shared.get(case, ())}
            return result_of(out, self.experiments[case])
        except IndexError:
            raise IndexError(f"case {case}: there are {len(self)} cases") from None

    def rerun(self, case: int, run: int, *, every: int = 1) -> SimulationResult:
        """One run again, with each `every`-th frame kept: to look at a run that diverged."""
        case = check_integer(case, "case", least=0, most=len(self) - 1)
        run = check_integer(run, "run", least=0, most=self.finished.shape[1] - 1)
        steps = self.experiments[case].spec["steps"]
        every = check_integer(every, "every", least=1 + steps // _FRAMES)
        spec = self.experiments[case].piece(run, 1) | {"every": every}
        return result_of(
            execute(spec, self.backend, self.engine), replace(self.experiments[case], spec=spec)
        )

    @property
    def complete(self) -> bool:
        """Whether every run is finished."""
        return bool(self.finished.all())

    @property
    def diverged(self) -> npt.NDArray[np.int64]:
        """(case, run) of each run that diverged, (D, 2)."""
        return np.argwhere(self.finished & (self._of_runs("diverged_at") >= 0))

    def _of_runs(self, key: str) -> Array:
        return np.array([out[key] for out in self.outputs])

    # --- tables --------------------------------------------------------------------------------

    @property
    def table(self) -> dict[str, Array]:
        """Columns (C,): a row a case.

        The parameters; `runs` finished and how many of them `diverged`; then the mean over the
        runs that did not diverge of each metric, and after it, with `_se`, its standard error (NaN
        for fewer than two runs). Metrics are called `rms_e2` (with several windows `rms_e2_w0`,
        ...), `peak_x_hat1`, `settling_time`; entries of the memory beyond x_hat `memory3`, ....
        In a loop those of its signals are `rms_u`, `peak_u`, `settling_time_x1`; then come `cost`
        and, of all finished runs, `converged`.
        """
        good = self.finished & (self._of_runs("diverged_at") < 0)
        out = self._parameter_columns()
        out["runs"] = self.finished.sum(axis=1)
        out["diverged"] = out["runs"] - good.sum(axis=1)
        for case, mask in enumerate(good):
            for name, values in self._measured(case, mask):
                for column, value in zip(
                    (name, f"{name}_se"), _mean_and_error(values), strict=True
                ):
                    out.setdefault(column, np.full(len(self), np.nan))[case] = value
        return out

    def _measured(self, case: int, good: npt.NDArray[np.bool_]) -> Iterator[tuple[str, Array]]:
        """Name and numbers, one a run, of each metric of a case."""
        out, one = self.outputs[case], self[case]
        for key in (*METRICS, "settling_time"):
            for name in (key, f"signal_{key}"):
                if name not in out or (
                    name == "settling_time" and "settle" not in self.experiments[case].spec
                ):
                    continue
                for column, values in zip(self._names(case, name), _flat(out[name]).T, strict=True):
                    unasked = name == "signal_settling_time" and np.isnan(values[good]).all()
                    if not unasked:
                        yield column, values[good]
        loop = self.experiments[case].loop
        if loop.has_cost:
            yield "cost", one.cost[good]
        if loop.converged is not None:
            yield "converged", one.converged[self.finished[case]].astype(float)

    def run_table(self) -> dict[str, Array]:
        """Columns with a row for each finished run: case, run, parameters, numbers of the run."""
        case, run = np.nonzero(self.finished)
        out = {"case": case, "run": run}
        out |= {name: column[case] for name, column in self._parameter_columns().items()}
        for rows, i, key, names in self._columns():
            values = _flat(self.outputs[i][key][self.finished[i]])
            for name, column in zip(names, values.T, strict=True):
                out.setdefault(name, empty((len(case),), key))[rows] = column
        return out

    def fill(self, table: Mapping[str, Array]) -> None:
        """Take finished runs from the columns of a `run_table`, of which `finished` tells."""
        for rows, i, key, names in self._columns():
            values = np.stack([table[name][rows] for name in names], axis=-1) if names else ()
            shape = (int(self.finished[i].sum()), *self.experiments[i].shapes[key])
            self.outputs[i][key][self.finished[i]] = np.reshape(values, shape)

    def _columns(self) -> Any:
        """For each case and output: its rows in the table of runs, case, output, column names."""
        stops = np.cumsum(self.finished.sum(axis=1))
        for i, stop in enumerate(stops):
            rows = slice(int(stops[i - 1]) if i else 0, int(stop))
            for key in self.experiments[i].shapes:
                if key not in FRAMES:
                    yield rows, i, key, self._names(i, key)

    def _names(self, case: int, key: str) -> list[str]:
        """Column names of an output's numbers, in their order."""
        experiment = self.experiments[case]
        shape = experiment.shapes[key]
        if not shape:
            return [key]
        loop = experiment.loop
        if key == "final_x" and loop.spec is not None:
            return [f"final_{name}" for name in loop.columns_apart]
        watched = key.startswith("signal_")
        key = key.removeprefix("signal_")
        entries = list(loop.signals) if watched else entry_names(key, shape[-1], experiment)
        if watched and key == "settling_time":
            return [f"settling_time_{name}" for name in entries]
        if len(shape) == 1:
            prefix = {"peak": "peak_", "final_memory": "final_"}.get(key, "")
            return [prefix + entry for entry in entries]
        several = max(len(e.spec["windows"]) for e in self.experiments) > 1
        windows = [f"_w{w}" if several else "" for w in range(shape[0])]
        return [f"{key}_{entry}{window}" for window in windows for entry in entries]

    def _parameter_columns(self) -> dict[str, Array]:
        columns = {}
        for name in self.parameters[0]:
            labels = [label(row[name]) for row in self.parameters]
            text = any(isinstance(value, str) for value in labels)
            columns[name] = np.array([str(v) for v in labels] if text else labels)
        return columns

    def to_dataframe(self, *, runs: bool = False) -> Any:
        """`table` as a pandas DataFrame; with `runs`, `run_table`. Needs the extra `data`."""
        pd = need("pandas", "a table needs pandas", "data")
        return pd.DataFrame(self.run_table() if runs else self.table)

    def to_xarray(self) -> Any:
        """Every run as an xarray Dataset. Needs the extra `xarray`.

        A grid has a dimension for each of its parameters, a sample has the dimension `case`; then
        come `run` and `window`, `signal`, `entry`, `state`, `frame`, `output`. Cases of other
        sizes (another order, another number of frames) are filled up with NaN.
        """
        xr = need("xarray", "a Dataset needs xarray", "xarray")
        columns = self._parameter_columns()
        if self.axes is None:
            cases: dict[str, int] = {"case": len(self)}
            coords: dict[str, Any] = {name: ("case", values) for name, values in columns.items()}
        else:
            cases = {name: len(values) for name, values in self.axes.items()}
            coords = {name: [label(v) for v in values] for name, values in self.axes.items()}
        coords["run"] = np.arange(self.finished.shape[1])
        data = {"finished": ((*cases, "run"), self.finished.reshape(*cases.values(), -1))}
        keys = dict.fromkeys(key for out in self.outputs for key in out)
        sizes: dict[str, int] = {}
        for key, out in itertools.product(keys, self.outputs):
            dims = DIMENSIONS.get(key, ())
            for dim, size in zip(dims[::-1], np.shape(out.get(key, ()))[::-1], strict=False):
                sizes[dim] = max(size, sizes.get(dim, 0))
        for key in keys:
            own = [sizes[dim] for dim in DIMENSIONS.get(key, ())]
            values = _stack([out.get(key) for out in self.outputs], key, own)
            dims = (*cases, *(() if key == "t" else ("run",)), *DIMENSIONS.get(key, ()))
            name = "time" if key == "t" else key
            data[name] = (dims, values.reshape(*cases.values(), *values.shape[1:]))
        if len({experiment.n for experiment in self.experiments}) == 1:
            first = self.experiments[0]
            for dim, key in (("signal", "rms"), ("entry", "final_memory")):
                if dim in sizes:
                    coords[dim] = entry_names(key, sizes[dim], first)
        loops = {experiment.loop.columns_apart for experiment in self.experiments}
        if len(loops) == 1 and "watched" in sizes:
            coords["state"] = list(*loops)
            coords["watched"] = list(self.experiments[0].loop.signals)
        return xr.Dataset(data, coords=coords, attrs={"seed": str(self.seed)})

    def plot(self, metric: str, x: str | None = None, figure: Figure | None = None) -> Figure:
        """Draw a column of `table`, with its standard error, over a parameter (the first).

        A line for each combination of the other parameters. Needs the extra `plot`.
        """
        from hgo_rs.plots import sweep_figure

        table, names = self.table, list(self.parameters[0])
        metrics = [name for name in table if f"{name}_se" in table]
        check(metric in metrics, "metric", metric, f"one of {', '.join(metrics)}", "choose one")
        x = names[0] if x is None else x
        check(x in names, "x", x, f"one of {', '.join(names)}", "choose a parameter")
        others = [name for name in names if name != x]
        lines: dict[str, list[int]] = {}
        for i in range(len(self)):
            told = ", ".join(f"{name} = {table[name][i]}" for name in others)
            lines.setdefault(told, []).append(i)
        return sweep_figure(
            {
                told: (table[x][rows], table[metric][rows], table[f"{metric}_se"][rows])
                for told, rows in lines.items()
            },
            x=x,
            y=metric,
            figure=figure,
        )

    def _repr_html_(self) -> str:
        """`table`, without its standard errors."""
        columns = {k: v for k, v in self.table.items() if not k.endswith("_se")}
        shown = [
            [number(v) if isinstance(v, float) else v for v in column.tolist()]
            for column in columns.values()
        ]
        return table(repr(self), list(zip(*shown, strict=True)), list(columns))

    def __repr__(self) -> str:
        cases, runs = self.finished.shape
        told = [f"StudyResult of {cases} cases x {runs} runs, seed {self.seed}"]
        if not self.complete:
            told.append(f"NOT COMPLETE: {self.finished.sum()} of {cases * runs} runs are finished")
        alike = sum("plant" in parts for parts in self.shared.values())
        if alike:
            told.append(f"plants moved once for all runs in {alike} of {cases} cases")
        lost = self.diverged
        if len(lost):
            named = ", ".join(str((int(i), int(k))) for i, k in lost[:3])
            more = ", ..." if len(lost) > 3 else ""
            are = "run diverged and is" if len(lost) == 1 else "runs diverged and are"
            told.append(f"{len(lost)} {are} left out of the table: (case, run) {named}{more}")
            counts = np.bincount(lost[:, 0])
            worst = int(counts.argmax())
            told.append(
                f"up to {counts[worst]} in one case: {title(worst, self.parameters[worst])}"
            )
        return "; ".join(told)


_FRAMES = 2**24
"""Most frames of a run that is shown."""
FRAMES = ("x", "memory", "y")
"""Outputs with a row for each kept frame."""
DIMENSIONS = {
    "mean": ("window", "signal"),
    "rms": ("window", "signal"),
    "max": ("window", "signal"),
    "peak": ("entry",),
    "signal_mean": ("window", "watched"),
    "signal_rms": ("window", "watched"),
    "signal_max": ("window", "watched"),
    "signal_peak": ("watched",),
    "signal_settling_time": ("watched",),
    "final_x": ("state",),
    "final_memory": ("entry",),
    "t": ("frame",),
    "x": ("frame", "state"),
    "memory": ("frame", "entry"),
    "y": ("frame", "output"),
}
"""Dimensions of each output beyond case and run."""


def entry_names(key: str, count: int, experiment: Experiment) -> list[str]:
    """Names of signals (errors first), of states, or of entries of the memory."""
    if key == "final_x":
        return [f"final_x{i + 1}" for i in range(count)]
    n, labels = experiment.n, Labels.of(experiment.spec["observer"], experiment.n)
    first = labels.entry if key in ("peak", "final_memory") else labels.error
    return [first(i) if i < n else f"memory{i + 1}" for i in range(count)]


def empty(shape: tuple[int, ...], key: str) -> Array:
    """Numbers that are not there yet: NaN, -1 for indices."""
    return np.full(shape, -1) if key.endswith("_at") else np.full(shape, np.nan)


def _flat(values: Array) -> Array:
    """All numbers of a run in one row."""
    return values.reshape(len(values), math.prod(values.shape[1:]))


def _mean_and_error(values: Array) -> tuple[float, float]:
    """Mean and its standard error."""
    count = len(values)
    mean = float(values.mean()) if count else math.nan
    return mean, float(values.std(ddof=1)) / math.sqrt(count) if count > 1 else math.nan


def _stack(arrays: list[Array | None], key: str, sizes: Sequence[int]) -> Array:
    """The cases' arrays of one output side by side, filled up to the last dimensions `sizes`."""
    (lead,) = {a.shape[: a.ndim - len(sizes)] for a in arrays if a is not None}
    out = empty((len(arrays), *lead, *sizes), key)
    for i, array in enumerate(arrays):
        if array is not None:
            out[i][tuple(map(slice, array.shape))] = array
    return out
