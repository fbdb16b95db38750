"""An observer over a recorded log, as an `observer.toml` says: whole, or chunk by chunk."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs.config import Config, load
from hgo_rs.errors import DesignError, HgoError
from hgo_rs.logs.log import Log
from hgo_rs.logs.read import read_log
from hgo_rs.logs.table import DataError
from hgo_rs.observers import Observer, RunResult


def estimate(log: str | Path | Log, config: str | Path | Config) -> RunResult:
    """Run the observer of a configuration over a log.

    Parameters
    ----------
    log
        A file, read as the configuration's `[log]` says; or what `hgo_rs.logs.read_log` gave.
    config
        An `observer.toml`, or what `hgo_rs.load` gave.

    Returns
    -------
    RunResult
        The estimates; `gaps` and `gap_error` say where samples are missing and what that costs.

    Raises
    ------
    ConfigError, DataError, HgoError
        A file that is refused; a log that does not fit the observer; a log whose clock starts again
        (run its `pieces` one by one); what `Observer.run` refuses.
    """
    config = config if isinstance(config, Config) else load(config)
    observer = config.observer()
    if not isinstance(log, Log):
        arguments = config.log
        check_fit(observer, arguments, f"{config.place(('log',))}: ")
        log = read_log(log, **arguments)
    if len(log.starts) > 1:
        raise DataError(
            f"{log.source}: the clock starts again at samples {list(log.starts[1:])}; run the "
            "pieces one by one: [estimate(piece, config) for piece in read_log(...).pieces]"
        )
    check_fit(observer, log.names)
    observer._check_start(observer.memory)
    return _run(observer, log, observer.memory)


def check_fit(observer: Observer, names: dict[str, Any], where: str = "") -> None:
    """Refuse column names that are not as many as the observer has outputs and inputs."""
    for key, count in (("output", observer.n_y), ("input", observer.n_u)):
        given = names.get(key)
        listed = [] if given is None else [given] if isinstance(given, str) else list(given)
        if len(listed) == count:
            continue
        told = f"{len(listed)} named ({', '.join(listed)})" if listed else "none is named"
        model = observer.spec["model"]["kind"]
        remedy = f"name {count}" if count else "leave it out, or give the observer a model with one"
        raise DataError(
            f"{where}{key}: {told}, the observer has {count} (model {model}); {remedy}"
            + (f" in the table [log]: {key} = ..." if count else "")
        )


def run_chunks(observer: Observer, chunks: Iterable[Log]) -> Iterator[tuple[Log, RunResult]]:
    """Run over a log that comes in chunks, each chunk with its result.

    The memory goes from chunk to chunk: the same bits as over the whole log at once. At a reset of
    the clock the observer starts again. A chunk with resets comes out as its pieces; the `starts`
    of one that begins a piece hold 0.

    Raises
    ------
    HgoError
        What `Observer.run` refuses; samples are counted within the chunk, whose begin is named.
    """
    start = observer.memory
    observer._check_start(start)
    memory = start
    stretches = itertools.chain(_stretches(chunks), [(None, True)])
    log, _ = next(stretches)
    rows = 0
    while log is not None:
        after, begins = next(stretches)
        until = None if begins or after is None else float(after.t[0])
        try:
            result = _run(observer, log, memory, until)
        except HgoError as error:
            if not rows:
                raise
            where = f"{log.source}, counting samples from t = {log.t[0]:.9g} s (sample {rows})"
            raise type(error)(f"{where}: {error}") from error
        memory = start if result.next_memory is None else result.next_memory
        yield log, result
        rows += len(log.t)
        log = after


def _stretches(chunks: Iterable[Log]) -> Iterator[tuple[Log | None, bool]]:
    """Chunks cut at resets, and whether the observer starts again there."""
    for chunk in chunks:
        edges = [k for k in chunk.starts if k > 0]
        for a, b in itertools.pairwise([0, *edges, len(chunk.t)]):
            begins = a in chunk.starts
            yield replace(chunk.rows(slice(a, b)), starts=(0,) if begins else ()), begins


FASTEST = 10.0
"""Time constants 1/gain in one step, from which on a unit of time that nobody said is refused."""


def _check_pace(observer: Observer, log: Log) -> None:
    """Refuse a guessed unit of time that leaves the observer nothing to filter."""
    parts = observer.spec.get("observers", [observer.spec])
    gains = [p["gain"].get("ell") for p in parts if isinstance(p.get("gain"), dict)]
    gain = max((g for g in gains if g is not None), default=None)
    if not log.assumed or gain is None or len(log.t) < 2:
        return
    step = float(np.median(np.diff(log.t)))
    if gain * step >= FASTEST:
        raise DataError(
            f"{log.source}: the median step {step:.6g} s is {gain * step:.3g} times 1/gain = "
            f"{1.0 / gain:.3g} s; the unit of the time {log.names['time']!r} is a guess, neither "
            "given nor said by its name: say unit = one of s, ms, us, ns; or lower the gain"
        )


def _run(observer: Observer, log: Log, memory: np.ndarray, until: float | None = None) -> RunResult:
    _check_pace(observer, log)
    try:
        return observer.run(log.t, log.y, log.u, memory0=memory, until=until)
    except DesignError as error:
        if log.names.get("time") is None or "dt" not in str(error):
            raise
        hint = "times are taken in s where neither unit nor the column's name says otherwise"
        raise type(error)(f"{error}; {hint}") from error
