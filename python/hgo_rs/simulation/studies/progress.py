"""How far a study is."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hgo_rs.errors import check

if TYPE_CHECKING:
    from rich.progress import Progress


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
    """Tells how far the work is, on a terminal's bar or to a function; a context."""

    def __init__(
        self, progress: bool | Callable[[StudyProgress], object] | None, total: int, done: int
    ) -> None:
        known = progress is None or isinstance(progress, bool) or callable(progress)
        check(known, "progress", progress, "True, False or a function", "leave it out")
        self.total, self.done, self.before = total, done, done
        self.start = time.perf_counter()
        self.function = progress if callable(progress) else None
        self.bar: Progress | None = None
        if progress is True or (
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
