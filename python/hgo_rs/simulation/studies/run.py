"""Many runs of many cases as one study."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from hgo_rs.errors import HgoError, check, check_choice, check_integer, check_number
from hgo_rs.read_only import read_only
from hgo_rs.simulation.experiment import BACKENDS, Experiment
from hgo_rs.simulation.llvm import check_engine
from hgo_rs.simulation.studies.cases import Parameters, experiments, rows_of
from hgo_rs.simulation.studies.pieces import compute, executor_of
from hgo_rs.simulation.studies.progress import StudyProgress, Teller
from hgo_rs.simulation.studies.result import StudyError, StudyInterrupted, StudyResult, empty
from hgo_rs.simulation.studies.saved import Saved

_RUNS = 2**30
_FREE = 0.8
"""Part of the free memory that a result may take."""


def study(
    build: Callable[..., Mapping[str, Any]],
    *,
    grid: Mapping[str, Iterable[Any]] | None = None,
    sample: Mapping[str, Iterable[Any]] | Iterable[Mapping[str, Any]] | Any = None,
    runs: int = 1,
    rng: int | np.random.Generator = 0,
    executor: Any = None,
    piece: int | None = None,
    save: str | os.PathLike[str] | None = None,
    progress: bool | Callable[[StudyProgress], object] | None = None,
    max_memory: float | None = None,
    backend: str = "rust",
    engine: str = "auto",
) -> StudyResult:
    """Simulate `runs` runs of each of many cases.

    Run i of every case draws from the streams (rng, i): cases are compared on the same noise
    (common random numbers). The bits of the result depend on neither `piece`, `executor`, the
    number of threads nor on where an earlier call stopped.

    Parameters
    ----------
    build : function
        `build(**parameters)` returns the arguments of `simulate` for one case as a dict: plant,
        observer, x0, dt, ..., all but runs, rng and backend. It is called in this process only, so
        it may be a lambda with every executor.
    grid : dict of name: values
        All combinations, the last name varying fastest.
    sample : dict of columns, list of dicts, or DataFrame
        One case a row; in place of `grid`.
    runs : int
        Runs of each case.
    rng : int or numpy.random.Generator
        Seed of the study; a Generator gives one.
    executor : optional
        Where pieces are computed: anything with `submit` as of concurrent.futures, or a
        dask.distributed Client. Default: this process, on all its cores. Work that an executor
        loses is submitted again, three times at most. Processes must not be forked from this one.
    piece : int, optional
        Runs computed at once; by default as many as take about 0.2 s (an executor's: 0.5 s).
    save : path, optional
        A Parquet file that finished runs are written to, about every second and at the end.
        If it is there, the study continues from it. Needs the extra `data`.
    progress : bool or function, optional
        A bar on standard error, in a notebook a line; or a function that is called with a
        `StudyProgress` after each piece. Default: a bar if standard error is a terminal, a line in
        a notebook where it takes longer than a second.
    max_memory : float, optional
        Bytes that the result may take. Default: 0.8 of the free memory.
    backend : "rust" or "numpy"
    engine : "auto", "interpreter" or "llvm"
        As for `simulate`.

    Raises
    ------
    HgoError
        A parameter outside its range, a case that `simulate` refuses (its parameters are named), a
        result beyond the memory, a saved study with other arguments (the difference is named).
    StudyInterrupted
        Ctrl-C. A KeyboardInterrupt; its `result` holds the finished runs.
    StudyError
        The study cannot go on, for instance because the executor is broken; its `result` holds the
        finished runs.
    """
    rows, axes = rows_of(grid, sample)
    runs = check_integer(runs, "runs", least=1, most=_RUNS)
    seed = int(rng.integers(2**63)) if isinstance(rng, np.random.Generator) else rng
    seed = check_integer(seed, "rng", least=0, most=2**64 - 1)
    if piece is not None:
        piece = check_integer(piece, "piece", least=1, most=_RUNS)
    check_choice("backend", backend, BACKENDS)
    check_engine(engine, backend)
    executor, own = executor_of(executor)
    planned = experiments(build, rows, runs=runs, seed=seed, backend=backend)
    _check_memory(planned, runs, max_memory, twice=save is not None)
    result = _empty(rows, axes, planned, runs, seed, (backend, engine))
    saved = None if save is None else Saved(save, result)
    if saved is not None:
        saved.load()

    steps = np.array([experiment.spec["steps"] for experiment in planned], dtype=object)
    with Teller(
        progress, int(runs * steps.sum()), int(result.finished.sum(axis=1) @ steps)
    ) as tell:

        def finished(work: int) -> None:
            if saved is not None:
                saved.unsaved = True
                saved.keep()
            tell.add(work)

        stop: BaseException | None = None
        try:
            compute(result, executor, own, piece, finished)
        except BaseException as error:
            stop = error
        unsaved = None if saved is None else _kept(saved)
    for array in (array for out in result.outputs for array in out.values()):
        array.flags.writeable = False  # from here on they are the user's to read
    stop = unsaved if stop is None else stop
    if stop is not None:
        told = _stopped(stop, unsaved, result, saved)
        if told is stop:
            raise stop
        raise told from stop
    return result


def _kept(saved: Saved) -> BaseException | None:
    """Save what is finished; what went wrong, if anything did."""
    try:
        saved.keep(now=True)
    except (Exception, KeyboardInterrupt) as error:
        return error
    return None


def _stopped(
    stop: BaseException, unsaved: BaseException | None, result: StudyResult, saved: Saved | None
) -> BaseException:
    """The exception that says what ended a study, what is finished and what of it is saved."""
    if isinstance(stop, HgoError) or not isinstance(stop, (Exception, KeyboardInterrupt)):
        return stop
    kind = StudyInterrupted if isinstance(stop, KeyboardInterrupt) else StudyError
    if isinstance(stop, KeyboardInterrupt):
        how = "study interrupted"
    else:
        how = str(stop) if isinstance(stop, StudyError) else f"study stopped by {_named(stop)}"
    told = [
        f"{how}: {result.finished.sum()} of {result.finished.size} runs are finished, in `.result` "
        "of this exception"
    ]
    if saved is not None:
        told.append(saved.told())
        if unsaved is not None:
            if unsaved is not stop:
                told.append(f"the file could not be written ({_named(unsaved)})")
            told.append("make room for the file or choose another name, and keep `.result`")
    return kind("; ".join(told), result)


def _named(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def _empty(
    rows: list[Parameters],
    axes: dict[str, list[Any]] | None,
    planned: list[Experiment],
    runs: int,
    seed: int,
    by: tuple[str, str],
) -> StudyResult:
    """A result without a finished run."""
    outputs = []
    for experiment in planned:
        out = {key: empty((runs, *shape), key) for key, shape in experiment.shapes.items()}
        if "x" in out:
            out["t"] = empty(out["x"].shape[1:2], "t")
        outputs.append(out)
    finished = np.zeros((len(rows), runs), dtype=bool)
    shown = read_only(rows), read_only(axes)
    return StudyResult(*shown, finished, seed, by[0], planned, outputs, engine=by[1])


def _check_memory(planned: list[Experiment], runs: int, most: float | None, *, twice: bool) -> None:
    """Refuse a result that does not fit; to be saved, it is there twice for a moment."""
    needed = 8.0 * (2 if twice else 1) * runs * sum(e.numbers for e in planned)
    if most is None:
        import psutil

        most = _FREE * float(psutil.virtual_memory().available)
    most = check_number(most, "max_memory", above=0.0)
    check(
        needed <= most,
        "runs",
        runs,
        f"such that the result fits: it would take {needed / 1e9:.3g} GB of {most / 1e9:.3g} GB",
        "fewer runs, a larger every (or none), fewer windows or metrics, or set max_memory [bytes]",
    )
