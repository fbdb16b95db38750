"""An observer over a recorded log, as an `observer.toml` says: whole, or chunk by chunk."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs.config import Config, load
from hgo_rs.errors import DesignError, HgoError, check_choice, printable
from hgo_rs.logs.log import Log
from hgo_rs.logs.read import read_log
from hgo_rs.logs.table import DataError, names_of
from hgo_rs.observers import Observer, RunResult
from hgo_rs.observers.records import STARTS, first_of
from hgo_rs.observers.turns import warn_of_turns


def estimate(log: str | Path | Log, config: str | Path | Config) -> RunResult:
    """Run the observer of a configuration over a log.

    Parameters
    ----------
    log
        A file, read with `[log]` of the configuration; or a log of `hgo_rs.logs.read_log`.
    config
        An `observer.toml`, or a configuration of `hgo_rs.load`.

    Returns
    -------
    RunResult
        The estimates; `gaps` lists the gaps and `gap_error` the errors after them.

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
    _warn_of_turns(observer, log)
    memory = observer.memory
    if _begins_at_first(observer, config.start):
        memory = _at_first(observer, memory, log)
    observer._check_start(memory)
    return _run(observer, log, memory)


def _warn_of_turns(observer: Observer, log: Log) -> None:
    """Warn of an output that shows a turn of which the observer does not know."""
    names = [column_of(log.source, name) for name in names_of(log.names["output"], "output")]
    remedy = "say wrap = {} of the observer, or unwrap = {{ ... }} of the log"
    warn_of_turns(log.y.reshape(len(log.t), -1), observer.wrap, names, remedy, stacklevel=3)


def column_of(source: str, name: str) -> str:
    """A column of a file, in words."""
    return f"{printable(source)}: {printable(name)!r}"


def _begins_at_first(observer: Observer, start: str | None) -> bool:
    """Whether to begin at the first sample: as told, else where the output is the first state."""
    if start is None:
        return observer._begins
    return check_choice("start", start, STARTS) == "first-sample"


def _at_first(observer: Observer, memory: np.ndarray, *logs: Log) -> np.ndarray:
    """A memory with x_hat_1 at the first sample that is there, of each output."""
    y = np.concatenate([log.y.reshape(len(log.t), -1) for log in logs])
    return observer._begun(memory, first_of(y))


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
            + (f" in the table [log]: {key} = ..." if count and where else "")
        )


def run_chunks(
    observer: Observer, chunks: Iterable[Log], *, start: str | None = None
) -> Iterator[tuple[Log, RunResult]]:
    """Run over a log that comes in chunks, each chunk with its result.

    The memory goes from chunk to chunk: the same bits as over the whole log at once. At a reset of
    the clock the observer starts again. A chunk with resets comes out as its pieces; the `starts`
    of one that begins a piece hold 0.

    Parameters
    ----------
    start : "first-sample" or "zero", optional
        Where an observer whose x_hat is 0 begins: with x_hat_1 at the first sample that is there,
        of each output, or as it stands. One that stands elsewhere begins there. Default: at the
        first sample, but as it stands for a model whose output h is not its first state.

    Raises
    ------
    HgoError
        What `Observer.run` refuses; samples are counted within the chunk, whose begin is named.
    """
    stands = observer.memory
    rests = not np.any(stands[: observer.n]) and not observer._told
    first = _begins_at_first(observer, start) and rests
    observer._check_start(stands)
    memory = stands
    stretches = _Ahead(_stretches(chunks))
    log, _ = stretches.take()
    rows = 0
    while log is not None:
        if first and log.starts:
            memory = _at_first(observer, stands, log, *stretches.until_all_are_there(log))
        after, begins = stretches.take()
        until = None if begins or after is None else float(after.t[0])
        try:
            result = _run(observer, log, memory, until)
        except HgoError as error:
            if not rows:
                raise
            where = f"{log.source}, counting samples from t = {log.t[0]:.9g} s (sample {rows})"
            raise type(error)(f"{where}: {error}") from error
        memory = stands if result.next_memory is None else result.next_memory
        yield log, result
        rows += len(log.t)
        log = after


class _Ahead:
    """Stretches, of which some may be looked at ahead."""

    def __init__(self, stretches: Iterator[tuple[Log | None, bool]]) -> None:
        self._rest = itertools.chain(stretches, itertools.repeat((None, True)))
        self._held: deque[tuple[Log | None, bool]] = deque()

    def take(self) -> tuple[Log | None, bool]:
        """The next one, and whether the observer starts again there; None: there is none."""
        return self._held.popleft() if self._held else next(self._rest)

    def until_all_are_there(self, log: Log) -> list[Log]:
        """The stretches after `log`, of its piece, until every output has had a sample."""
        lack = np.isnan(first_of(log.y.reshape(len(log.t), -1)))
        ahead: list[Log] = []
        while lack.any():
            if len(ahead) == len(self._held):
                self._held.append(next(self._rest))
            after, begins = self._held[len(ahead)]
            if after is None or begins:
                break
            ahead.append(after)
            lack &= np.isnan(first_of(after.y.reshape(len(after.t), -1)))
        return ahead


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
