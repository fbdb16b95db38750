"""Run scenarios and write what they yield: figures, `results.json`, `results.md` and `report.html`.

`run` yields a `Record` a scenario, in this process or in several; `OutputFolder` writes as it
goes, so that an interrupted run loses nothing that was finished.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import platform
import queue
import signal
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs import plots
from hgo_rs.cli import report
from hgo_rs.cli.record import Record
from hgo_rs.errors import HgoError
from hgo_rs.files import together
from hgo_rs.scenarios import Context, Row, Scenario, find
from hgo_rs.simulation.workers import end_with_parent


class OutputError(HgoError):
    """A file or folder cannot be written."""


def execute(scenario: Scenario, ctx: Context, *, figures: bool) -> Record:
    """Run one scenario; a failure becomes the record's `error` (Ctrl-C passes through)."""
    rows: tuple[Row, ...] = ()
    error = ""
    images: dict[str, bytes] = {}
    steps = ctx.computed_steps
    start = time.perf_counter()
    elapsed = None
    try:
        outcome = scenario(ctx)
        rows = tuple(outcome.rows)
        elapsed = time.perf_counter() - start
        if figures and outcome.figure is not None:
            images = plots.render(outcome.figure)
    except Exception:
        error = traceback.format_exc()
    if elapsed is None:
        elapsed = time.perf_counter() - start
    return Record(
        scenario.id,
        scenario.title,
        scenario.paper,
        ctx.backend,
        ctx.seed,
        rows,
        elapsed,
        ctx.computed_steps - steps,
        error,
        images,
    )


def run(
    scenarios: Sequence[Scenario],
    *,
    backend: str = "rust",
    seed: int = 1,
    jobs: int = 1,
    figures: bool = True,
    on_start: Callable[[str], None] = lambda id: None,
) -> Iterator[Record]:
    """Run scenarios and yield their records as they finish.

    The scenarios of a paper share their runs, so a paper is never split: `jobs` > 1 runs that many
    papers at a time, each in a process of its own. (The compiled core uses every core by itself;
    more jobs help the NumPy backend.)
    """
    papers: dict[str, list[Scenario]] = {}
    for scenario in scenarios:
        papers.setdefault(scenario.paper, []).append(scenario)
    if jobs > 1 and len(papers) > 1:
        yield from _run_in_processes(papers, backend, seed, jobs, figures, on_start)
        return
    for group in papers.values():
        ctx = Context(backend, seed)
        for scenario in group:
            on_start(scenario.id)
            yield execute(scenario, ctx, figures=figures)


def _run_in_processes(
    papers: dict[str, list[Scenario]],
    backend: str,
    seed: int,
    jobs: int,
    figures: bool,
    on_start: Callable[[str], None],
) -> Iterator[Record]:
    mp = multiprocessing.get_context("spawn")
    tasks, messages = mp.Queue(), mp.Queue()
    for group in papers.values():
        tasks.put([s.id for s in group])
    count = min(jobs, len(papers))
    for _ in range(count):
        tasks.put(None)
    workers = [
        mp.Process(target=_work, args=(tasks, messages, backend, seed, figures), daemon=True)
        for _ in range(count)
    ]
    waiting = sum(len(group) for group in papers.values())
    try:
        for worker in workers:
            worker.start()
        while waiting:
            try:
                message = messages.get(timeout=0.5)
            except queue.Empty:
                if messages.empty() and not any(worker.is_alive() for worker in workers):
                    raise HgoError(f"every worker ended with {waiting} scenarios left") from None
                continue
            if isinstance(message, str):
                on_start(message)
            else:
                waiting -= 1
                yield message
    finally:
        for worker in workers:
            if worker.pid is not None:
                worker.terminate()
                worker.join()


def _work(tasks: Any, messages: Any, backend: str, seed: int, figures: bool) -> None:
    """One process: papers until there are none. Ctrl-C is the parent's to handle."""
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while (ids := tasks.get()) is not None:
        ctx = Context(backend, seed)
        for id in ids:
            messages.put(id)
            messages.put(execute(find(id), ctx, figures=figures))


def made_folder(path: str | Path) -> Path:
    """A folder that can be written, made where it is not there.

    Raises
    ------
    OutputError
        If it cannot be made or written.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=folder, prefix=".hgo-"):
            pass
    except OSError as error:
        raise OutputError(
            f"cannot write to the folder {folder}: {error.strerror or error}; "
            "choose another one with --out"
        ) from error
    return folder


class OutputFolder:
    """A folder for figures, `results.json`, `results.md` and `report.html`.

    Raises
    ------
    OutputError
        At once, if the folder cannot be made or written.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = made_folder(path)
        self._written: list[str] = []

    def write_figure(self, record: Record) -> None:
        """ID.png and ID.svg, if the scenario has a figure."""
        self.write_all({f"{record.id}.{kind}": image for kind, image in record.images.items()})

    def write_results(self, records: Sequence[Record], about: dict[str, Any]) -> None:
        """results.json: where and how it ran, totals, every record. results.md: rows of papers."""
        rows = [r for record in records for r in record.rows]
        results = {
            **about,
            "ok": bool(records) and all(r.ok for r in records) and not about.get("interrupted"),
            "rows": len(rows),
            "missed": sum(not r.ok for r in rows),
            "failed": [r.id for r in records if r.error],
            "scenarios": [r.to_dict() for r in records],
        }
        text = json.dumps(results, indent=1, ensure_ascii=False, allow_nan=False)
        table = report.markdown(records).encode()
        self.write_all({"results.json": text.encode(), "results.md": table})

    def write_report(self, records: Sequence[Record], about: dict[str, Any]) -> Path:
        """report.html: one file that needs no other. Returns its path."""
        return self.write("report.html", report.build(records, about).encode())

    def write(self, name: str, content: bytes) -> Path:
        """Write a file whole or not at all."""
        self.write_all({name: content})
        return self.path / name

    def write_all(self, contents: Mapping[str, bytes]) -> None:
        """Write files by their names, all or none; an error says what was written before them."""
        paths = [self.path / name for name in contents]
        try:
            with together(paths) as files:
                for file, content in zip(files, contents.values(), strict=True):
                    file.write(content)
        except OSError as error:
            told = f"cannot write {', '.join(map(str, paths))}: {error.strerror or error}"
            if self._written:
                told += f"; written before: {', '.join(self._written)}"
            raise OutputError(told) from error
        self._written += contents


def about_this_run(backend: str, seed: int, elapsed_s: float, planned: int) -> dict[str, Any]:
    """Where and how scenarios ran, for results.json and the report."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        package = version("hgo_rs")
    except PackageNotFoundError:
        package = "not installed"
    return {
        "version": package,
        "backend": backend,
        "seed": seed,
        "elapsed_s": elapsed_s,
        "planned": planned,
        "interrupted": False,
        "machine": {
            "platform": platform.platform(),
            "processor": platform.machine(),
            "cpus": os.cpu_count(),
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
    }
