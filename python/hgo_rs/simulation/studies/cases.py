"""Parameters in, experiments out: the cases of a study."""

from __future__ import annotations

import inspect
import itertools
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from hgo_rs.errors import HgoError, check, explain
from hgo_rs.observers import Observer
from hgo_rs.simulation.experiment import Experiment, execute, planned

Build = Callable[..., Mapping[str, Any]]
Parameters = dict[str, Any]

RESERVED = frozenset(
    (
        *("case", "run", "runs", "diverged", "finished", "time", "checksum"),
        *("window", "signal", "entry", "state", "frame", "output", "watched", "cost", "converged"),
        *("mean", "rms", "max", "peak", "settling_time", "diverged_at", "undefined_at"),
        *("signal_mean", "signal_rms", "signal_max", "signal_peak", "signal_settling_time"),
        *("final_x", "final_memory", "x", "memory", "y"),
    )
)
"""Names of columns and dimensions of the result."""


def rows_of(grid: Any, sample: Any) -> tuple[list[Parameters], dict[str, list[Any]] | None]:
    """The parameters of each case, and the axes if they are a full grid."""
    if (grid is None) == (sample is None):
        raise HgoError("grid: give either grid (all combinations) or sample (one row a case)")
    if grid is not None:
        table = isinstance(grid, Mapping)
        check(table, "grid", grid, "a dict of name: values", "give for example {'ell': [20, 50]}")
        axes = _columns("grid", grid)
        rows = [
            dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())
        ]
        return rows, axes
    if not hasattr(sample, "items"):
        return _records(sample), None
    columns = _columns("sample", sample)
    lengths = {name: len(values) for name, values in columns.items()}
    remedy = "give one value a case in each column"
    check(len(set(lengths.values())) == 1, "lengths of sample", lengths, "equal", remedy)
    return [
        dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)
    ], None


def _columns(name: str, table: Any) -> dict[str, list[Any]]:
    """Named columns, at least one, none of them empty."""
    columns: dict[str, list[Any]] = {}
    for key, values in table.items():
        _check_name(name, key)
        many = isinstance(values, Iterable) and not isinstance(values, (str, bytes, Mapping))
        where = f"{name}[{key!r}]"
        check(many, where, values, "a list of values", "put a single value in a list")
        columns[key] = [_plain(value) for value in values]
        check(columns[key], where, values, "at least one value", "give one, or leave it out")
    check(columns, name, table, "at least one parameter", "give for example {'ell': [20, 50]}")
    return columns


def _records(sample: Any) -> list[Parameters]:
    """Rows given as dicts, all with the same names."""
    listed = isinstance(sample, Iterable) and not isinstance(sample, (str, bytes))
    rows = list(sample) if listed else []
    fits = rows and all(isinstance(row, Mapping) and row for row in rows)
    allowed = "a dict of columns, a list of dicts or a DataFrame, with at least one case"
    check(fits, "sample", sample, allowed, "give for example [{'ell': 20}, {'ell': 50}]")
    for i, row in enumerate(rows):
        remedy = "give every case the same parameters"
        same = row.keys() == rows[0].keys()
        check(same, f"sample[{i}]", row, f"with the keys {list(rows[0])}", remedy)
    for key in rows[0]:
        _check_name("sample", key)
    return [{key: _plain(row[key]) for key in rows[0]} for row in rows]


def _check_name(name: str, key: Any) -> None:
    word = isinstance(key, str) and key.isidentifier()
    check(word, f"name in {name}", key, "a name as of a Python argument", "choose another")
    allowed = f"none of {', '.join(sorted(RESERVED))}"
    check(key not in RESERVED, f"name in {name}", key, allowed, "the result uses them")


def _plain(value: Any) -> Any:
    """A NumPy number as Python's, so that it prints and saves as one."""
    return value.item() if isinstance(value, np.generic) else value


def label(value: Any) -> Any:
    """A parameter's value as a number or a short string."""
    if isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Observer):  # all of it: its repr leaves coefficients out
        inside = ", ".join(f"{key}={inner!r}" for key, inner in value.spec.items())
        return f"{type(value).__name__}({inside})"
    # An address would differ from one session to the next.
    return getattr(value, "__name__", None) or re.sub(r" at 0x[0-9a-fA-F]+", "", str(value))


def title(case: int, parameters: Mapping[str, Any]) -> str:
    """What messages call a case: "case 3 (ell = 50, dt = 0.001)"."""
    named = ", ".join(f"{name} = {label(value)}" for name, value in parameters.items())
    return f"case {case} ({named})"


def experiments(
    build: Build, rows: list[Parameters], *, runs: int, seed: int, backend: str
) -> list[Experiment]:
    """The experiment of each case: checked, and its first step tried.

    Raises
    ------
    HgoError
        `build` does not take these parameters, or a case is refused; the message names it.
    """
    check(callable(build), "build", build, "a function", "it takes the parameters of a case")
    try:
        inspect.signature(build).bind(**rows[0])
    except TypeError as error:
        remedy = "name each parameter as an argument of build"
        raise HgoError(
            explain("parameters", list(rows[0]), f"those of build: {error}", remedy)
        ) from None
    except ValueError:  # a function without a signature
        pass
    return [_experiment(build, i, row, runs, seed, backend) for i, row in enumerate(rows)]


def _experiment(
    build: Build, case: int, parameters: Parameters, runs: int, seed: int, backend: str
) -> Experiment:
    try:
        given = build(**parameters)
        remedy = "return dict(plant=..., observer=..., x0=..., dt=..., steps=...)"
        check(isinstance(given, Mapping), "build", given, "the arguments of simulate", remedy)
        for name in given.keys() & {"runs", "rng", "backend", "engine"}:
            check(False, name, given[name], "given to study, not by build", "leave it out of build")
        remedy = "one is for all runs: call simulate for this case"
        check(given.get("histogram") is None, "histogram", "...", "left out of a study", remedy)
        experiment = planned(**given, runs=runs, rng=seed)
        _try(experiment, backend)
    except HgoError as error:
        raise type(error)(f"{title(case, parameters)}: {error}") from error
    except Exception as error:
        kind = type(error).__name__
        raise HgoError(f"{title(case, parameters)}: build: {kind}: {error}") from error
    return experiment


def _try(experiment: Experiment, backend: str) -> None:
    """One step of one run: what the backend refuses, it refuses before anything is computed."""
    spec = experiment.piece(0, 1) | {"steps": 1, "windows": [], "every": 0}
    values = spec["noise"].get("values")
    if values is not None:
        spec["noise"] = spec["noise"] | {"values": values[..., :2]}
    execute(spec, backend)
