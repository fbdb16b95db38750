"""How far a study is."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hgo_rs.errors import check
from hgo_rs.markup import in_notebook

if TYPE_CHECKING:
    from rich.progress import Progress


_SOON, _EVERY = 1.0, 0.2
"""Seconds of work from which on a notebook is told, and between two tellings."""


@dataclass(frozen=True)
class StudyProgress:
    """How far a study is; work is counted in steps of runs.

    Attributes
    ----------
    done, total : int
        Run-steps finished (a continued study's earlier ones too) and to do in all.
    rate : float
        Run-steps per second since this call began.
    time_left : float [s]
        At this rate; infinite before the first piece is finished.
    """

    done: int
    total: int
    rate: float
    time_left: float


class Teller:
    """Tells how far the work is, on a terminal's bar, in a notebook's line or to a function; a
    context.
    """

    def __init__(
        self, progress: bool | Callable[[StudyProgress], object] | None, total: int, done: int
    ) -> None:
        known = progress is None or isinstance(progress, bool) or callable(progress)
        check(known, "progress", progress, "True, False or a function", "leave it out")
        self.total, self.done, self.before = total, done, done
        self.start = time.perf_counter()
        self.function = progress if callable(progress) else None
        self.bar: Any = None
        if in_notebook() and progress in (True, None):
            self.bar = _Line(0.0 if progress else _SOON)
        elif progress is True or (
            progress is None and sys.stderr is not None and sys.stderr.isatty()
        ):
            self.bar = _bar(required=progress is True)

    def __enter__(self) -> Teller:
        if self.bar is not None:
            self.bar.start()
            self.task = self.bar.add_task("study", total=self.total, completed=self.done, rate="")
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        if self.bar is not None:
            self.bar.stop()

    def add(self, work: int) -> None:
        """So many run-steps more are finished."""
        self.done += work
        rate = (self.done - self.before) / max(time.perf_counter() - self.start, 1e-9)
        left = (self.total - self.done) / rate if rate > 0.0 else float("inf")
        if self.bar is not None:
            self.bar.update(self.task, completed=self.done, rate=f"{rate / 1e6:.3g} M run-steps/s")
        if self.function is not None:
            self.function(StudyProgress(self.done, self.total, rate, left))


class _Line:
    """A line that is written over: what a notebook shows without widgets.

    Nothing is written of work that takes less than `after` [s].
    """

    def __init__(self, after: float) -> None:
        self.after, self.next = after, 0.0
        self.total, self.width = 1.0, 0

    def start(self) -> None:
        self.began = time.perf_counter()
        self.next = self.began + self.after

    def add_task(self, name: str, *, total: float, **state: Any) -> str:
        self.total = max(total, 1.0)
        return name

    def update(self, name: str, *, completed: float, rate: str) -> None:
        now = time.perf_counter()
        if now >= self.next or (self.width and completed >= self.total):
            self.next = now + _EVERY
            told = (
                f"{name} {100.0 * completed / self.total:.0f} %, {rate}, {now - self.began:.0f} s"
            )
            self.width = max(self.width, len(told))
            sys.stdout.write(f"\r{told:<{self.width}}")
            sys.stdout.flush()

    def stop(self) -> None:
        if self.width:
            sys.stdout.write("\n")


def _bar(*, required: bool) -> Progress | None:
    """A bar on standard error; None without rich, unless it is required."""
    try:
        from rich import progress as rich
        from rich.console import Console
    except ImportError:
        if required:
            raise
        return None
    columns: list[Any] = [
        rich.TextColumn("{task.description}"),
        rich.BarColumn(),
        rich.TaskProgressColumn(),
        rich.TextColumn("{task.fields[rate]}"),
        rich.TimeRemainingColumn(),
    ]
    return rich.Progress(*columns, console=Console(stderr=True))
