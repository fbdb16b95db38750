"""The work of a study: cut in pieces, computed here or by an executor, put into the result."""

from __future__ import annotations

import asyncio
import copy
import os
import queue
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError, Future
from typing import Any, NamedTuple

import numpy as np

from hgo_rs.errors import HgoError, check
from hgo_rs.simulation.experiment import execute
from hgo_rs.simulation.studies.cases import title
from hgo_rs.simulation.studies.result import FRAMES, StudyError, StudyResult
from hgo_rs.simulation.workers import end_with_parent

_HERE, _ELSEWHERE = 0.2, 0.5
"""Seconds that a task should take: in this process, by an executor."""
_FIRST = 200_000
"""Run-steps of the first task, before anything is known of the rate."""
_BLOCK = 16
"""Runs that the core moves at once."""
_ROOM = 2**22
"""Numbers that a task may give."""
_FLYING = 200
"""Tasks that an executor holds at most."""
_AGAIN = 3
"""How often lost work is submitted again."""


class Piece(NamedTuple):
    """Runs first, ..., first + runs - 1 of a case."""

    case: int
    first: int
    runs: int


class Task(NamedTuple):
    """Pieces that travel together, and how often they were submitted before."""

    pieces: list[Piece]
    again: int = 0


def cost(result: StudyResult, piece: Piece) -> int:
    """Run-steps of a piece."""
    return piece.runs * int(result.experiments[piece.case].spec["steps"])


class Work(NamedTuple):
    """What a worker does for the process `home`, with which it ends; cases have `runs` runs."""

    home: int
    engine: str
    runs: int

    def __call__(
        self, specs: list[dict[str, Any]], backend: str
    ) -> tuple[list[dict[str, Any]], float]:
        """The outputs of specs, and the seconds that they took."""
        end_with_parent(self.home)
        start = time.perf_counter()
        # Arrays may have travelled to addresses that are no multiple of 8; copies are aligned.
        by = (backend, self.engine, self.runs)
        outs = [execute(copy.deepcopy(spec), *by) for spec in specs]
        return outs, time.perf_counter() - start


class Here:
    """An executor that does the work at once, in this thread: Ctrl-C reaches it."""

    def shutdown(self, wait: bool) -> None:
        """There is nothing that waits."""

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future


def executor_of(executor: Any) -> tuple[Any, bool]:
    """Something that submits, and whether it serves this study alone.

    None means this thread; a dask Client is asked for an executor.
    """
    if executor is None:
        return Here(), True
    if hasattr(executor, "get_executor"):
        return executor.get_executor(pure=False), True
    allowed = "an executor as of concurrent.futures, or a dask.distributed Client"
    remedy = "leave it out to compute in this process"
    check(callable(getattr(executor, "submit", None)), "executor", executor, allowed, remedy)
    return executor, False


class Todo:
    """The runs that are not finished, handed out in tasks of about a wanted cost."""

    def __init__(self, result: StudyResult, piece: int | None, block: int) -> None:
        self.result, self.piece, self.block = result, piece, block
        self.gaps: deque[Piece] = deque()
        for case, finished in enumerate(result.finished):
            edges = np.flatnonzero(np.diff(np.concatenate([[True], finished, [True]])))
            for first, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
                self.gaps.append(Piece(case, first, stop - first))

    def take(self, wanted: float) -> Task:
        """The next task, of about `wanted` run-steps and at most `_ROOM` numbers."""
        pieces: list[Piece] = []
        room = float(_ROOM)
        while self.gaps and (not pieces or (wanted > 0.0 and room > 0.0)):
            case, first, left = self.gaps.popleft()
            experiment = self.result.experiments[case]
            fits = min(wanted / experiment.spec["steps"], room / experiment.numbers)
            # whole blocks, so that none is filled up with runs that nobody needs
            blocks = self.block * max(1, round(fits / self.block))
            runs = min(left, self.piece or max(1, min(blocks, int(_ROOM / experiment.numbers))))
            pieces.append(Piece(case, first, runs))
            if runs < left:
                self.gaps.appendleft(Piece(case, first + runs, left - runs))
            wanted -= cost(self.result, pieces[-1])
            room -= runs * experiment.numbers
        return Task(pieces)


def compute(
    result: StudyResult,
    executor: Any,
    own: bool,
    piece: int | None,
    finished: Callable[[int], None],
) -> None:
    """Compute all runs that are not finished; `finished` is told the run-steps of each task.

    An executor of this study alone (`own`) is shut down at the end.

    Raises
    ------
    StudyError
        The executor lost pieces that were submitted `1 + _AGAIN` times.
    """
    here = isinstance(executor, Here)
    work = Work(os.getpid(), result.engine, result.finished.shape[1])
    todo = Todo(result, piece, _BLOCK * (os.cpu_count() or 1) if here else _BLOCK)
    wanted, done_tasks = float(_FIRST), 0
    again: list[Task] = []
    given_up: list[tuple[Task, BaseException]] = []
    flying: dict[Any, Task] = {}
    done: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def lost(task: Task, error: BaseException) -> None:
        if isinstance(error, HgoError):  # refused, not lost
            raise error
        if task.again == _AGAIN:
            given_up.append((task, error))
        else:
            again.append(task._replace(again=task.again + 1))

    def submit() -> None:
        task = again.pop() if again else todo.take(wanted)
        specs = [result.experiments[p.case].piece(p.first, p.runs) for p in task.pieces]
        try:
            future = executor.submit(work, specs, result.backend)
        except Exception as error:
            lost(task, error)
        else:
            flying[future] = task
            future.add_done_callback(done.put)

    def collect(future: Any) -> None:
        nonlocal wanted, done_tasks
        task = flying.pop(future)
        try:
            error = future.exception()
            if error is None:
                outs, seconds = future.result()
                put(result, task, outs)
        except (Exception, CancelledError, asyncio.CancelledError) as raised:
            error = raised
        if error is not None:
            return lost(task, error)
        done_tasks += 1
        spent = sum(cost(result, p) for p in task.pieces)
        wanted = spent / max(seconds, 1e-6) * (_HERE if here else _ELSEWHERE)
        finished(spent)

    try:
        while flying or ((todo.gaps or again) and not given_up):
            # Few tasks at first, while the rate is unknown; then as many as keep all workers busy.
            most = 1 if here else min(_FLYING, 8 + 2 * done_tasks)
            while (todo.gaps or again) and not given_up and len(flying) < most:
                submit()
            if flying:
                try:
                    collect(done.get(timeout=0.1))
                except queue.Empty:
                    continue
    finally:
        if own:
            executor.shutdown(wait=False)  # cancels all at once
        else:
            for future in list(flying):
                future.cancel()
        while not done.empty():  # what was finished meanwhile is kept
            future = done.get()
            if future in flying and not future.cancelled():
                collect(future)
    if given_up:
        pieces = [p for task in [task for task, _ in given_up] + again for p in task.pieces]
        named = "; ".join(
            f"runs {p.first} to {p.first + p.runs - 1} of "
            f"{title(p.case, result.parameters[p.case])}"
            for p in pieces[:3]
        )
        more = f"; and {len(pieces) - 3} more pieces" if len(pieces) > 3 else ""
        cause = given_up[0][1]
        raise StudyError(
            f"the executor lost work {1 + _AGAIN} times ({type(cause).__name__}: {cause}): {named}"
            f"{more}",
            result,
        ) from cause


def put(result: StudyResult, task: Task, outs: list[dict[str, Any]]) -> None:
    """Put a task's outputs into the result; ValueError if they are not what was asked for."""
    if len(outs) != len(task.pieces):
        raise ValueError(f"{len(outs)} outputs came back for {len(task.pieces)} pieces")
    for piece, out in zip(task.pieces, outs, strict=True):
        experiment, kept = result.experiments[piece.case], result.outputs[piece.case]
        for key, shape in experiment.shapes.items():
            size = np.shape(out[key])
            short = key in FRAMES and size[1:2] < shape[:1]  # all runs of the piece stopped early
            wanted = (piece.runs, *(size[1:2] if short else shape[:1]), *shape[1:])
            if size != wanted:
                raise ValueError(f"{key} came back with shape {size} in place of {wanted}")
    for piece, out in zip(task.pieces, outs, strict=True):
        kept, rows = result.outputs[piece.case], slice(piece.first, piece.first + piece.runs)
        for key in result.experiments[piece.case].shapes:
            values = np.asarray(out[key])
            if key in FRAMES:
                kept[key][rows, : values.shape[1]] = values
            else:
                kept[key][rows] = values
        if "t" in kept:
            kept["t"][: len(out["t"])] = out["t"]
        result.shared[piece.case] = tuple(out.get("shared", ()))
        result.finished[piece.case, rows] = True
