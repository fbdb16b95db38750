"""`hgo run`, `hgo reproduce`: the papers' scenarios."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hgo_rs import plots, scenarios
from hgo_rs.cli.complete import scenario_ids
from hgo_rs.cli.record import Record, rows_to_json
from hgo_rs.cli.report import counted, format_value
from hgo_rs.cli.reproduce import OutputFolder, about_this_run, execute
from hgo_rs.cli.reproduce import run as run_scenarios
from hgo_rs.cli.terminal import INTERRUPTED, MISSED, complain, say
from hgo_rs.errors import HgoError, printable
from hgo_rs.scenarios.base import BACKENDS, Row

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

_backend = click.option(
    "--backend",
    type=click.Choice(list(BACKENDS)),
    default="rust",
    show_default=True,
    help="The compiled core, or the NumPy reference.",
)
_seed = click.option(
    "--seed",
    type=click.IntRange(min=0, max=2**64 - 1),
    default=1,
    show_default=True,
    help="Seed of the random streams.",
)


@click.command("run", short_help="Run one scenario and print its rows.")
@click.argument("id", shell_complete=scenario_ids)
@_backend
@_seed
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for ID.json and the figure as PNG and SVG.",
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")
def run_command(id: str, backend: str, seed: int, out: Path | None, as_json: bool) -> int:
    """Run the scenario ID and print its rows beside the paper's values."""
    scenario = scenarios.find(id)
    folder = None
    if out is not None:
        plots.require_matplotlib()
        folder = OutputFolder(out)
    record = execute(scenario, scenarios.Context(backend, seed), figures=folder is not None)
    if record.error:
        click.echo(record.error, err=True, nl=False)
        complain(f"{id} failed")
    if folder is not None:
        text = json.dumps(record.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)
        images = {f"{id}.{kind}": image for kind, image in record.images.items()}
        folder.write_all({**images, f"{id}.json": text.encode()})
    if as_json:
        result = {
            "id": id,
            "backend": backend,
            "rows": rows_to_json(record.rows),
            "elapsed_s": record.elapsed_s,
        }
        click.echo(json.dumps(result, ensure_ascii=False, allow_nan=False))
    else:
        _print_rows(record)
        if folder is not None:
            names = [f"{id}.json", *(f"{id}.{kind}" for kind in record.images)]
            say(f"written to {printable(str(folder.path))}: {', '.join(names)}")
    return 0 if record.ok else MISSED


@click.command("reproduce", short_help="Run every scenario; write figures and a report.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("out"),
    show_default=True,
    help="Folder for results.json, report.html and the figures.",
)
@_backend
@_seed
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Papers at a time. The compiled core uses all cores by itself; useful with numpy.",
)
@click.option(
    "--figures/--no-figures",
    default=True,
    show_default=True,
    help="Draw the figures, or only compute and compare: about half of the work.",
)
def reproduce_command(out: Path, backend: str, seed: int, jobs: int, figures: bool) -> int:
    """Run every scenario; write results.json, all figures and one report.html.

    Ctrl-C ends the run cleanly: what is finished is written.
    """
    if figures:
        plots.require_matplotlib()
    folder = OutputFolder(out)
    chosen = list(scenarios.load().values())
    if not chosen:
        raise HgoError("there are no scenarios in this installation")
    records: list[Record] = []
    start = time.perf_counter()
    interrupted = False
    with _Progress(len(chosen)) as progress:
        try:
            for record in run_scenarios(
                chosen,
                backend=backend,
                seed=seed,
                jobs=jobs,
                figures=figures,
                on_start=progress.started,
            ):
                folder.write_figure(record)
                records.append(record)
                progress.finished(record)
        except KeyboardInterrupt:
            interrupted = True
    order = {s.id: i for i, s in enumerate(chosen)}
    records.sort(key=lambda r: order[r.id])
    about = about_this_run(backend, seed, time.perf_counter() - start, len(chosen))
    about["interrupted"] = interrupted
    folder.write_results(records, about)
    report = folder.write_report(records, about)
    return _print_summary(records, about, report)


class _Progress:
    """A live display on a terminal, a line a scenario elsewhere."""

    def __init__(self, total: int) -> None:
        from rich.console import Console

        self.total = total
        self.done = 0
        self.steps = 0
        self.start = time.perf_counter()
        self.running: list[str] = []
        self.console: Console = Console(highlight=False)
        self.bar: Progress | None = None
        if self.console.is_terminal:
            from rich import progress as rich

            self.bar = rich.Progress(
                rich.SpinnerColumn(),
                rich.TextColumn("{task.description}"),
                rich.BarColumn(),
                rich.MofNCompleteColumn(),
                rich.TextColumn("{task.fields[rate]}"),
                rich.TimeElapsedColumn(),
                console=self.console,
                transient=True,
            )
            self.task = self.bar.add_task("starting", total=total, rate="")

    def __enter__(self) -> _Progress:
        if self.bar is not None:
            self.bar.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self.bar is not None:
            self.bar.stop()

    def started(self, id: str) -> None:
        self.running.append(id)
        self._refresh()

    def finished(self, record: Record) -> None:
        from rich.text import Text

        self.done += 1
        self.steps += record.steps
        self.running.remove(record.id)
        if record.error:
            told = "failed: " + record.error.strip().splitlines()[-1]
        elif record.missed or not record.rows:
            told = f"{record.missed} of {counted(len(record.rows), 'row')} missed"
        else:
            told = counted(len(record.rows), "row")
        mark = "ok  " if record.ok else "MISS"
        line = f"{mark}  {record.id:<24} {record.elapsed_s:7.2f} s  {told}"
        if self.bar is None:
            line = f"[{self.done:{len(str(self.total))}}/{self.total}] {line}  ({self._rate()})"
        # A Text of its own: a style given to print() would colour the bar too.
        self.console.print(Text(line, "" if record.ok else "bold red"), soft_wrap=True)
        self._refresh(advance=1)

    def _rate(self) -> str:
        elapsed = max(time.perf_counter() - self.start, 1e-9)
        return f"{self.steps / elapsed / 1e6:.3g} M steps/s, {elapsed:.1f} s"

    def _refresh(self, advance: int = 0) -> None:
        if self.bar is not None:
            self.bar.update(
                self.task,
                advance=advance,
                description=", ".join(self.running) or "writing the report",
                rate=self._rate().split(",")[0],
            )


def _print_summary(records: Sequence[Record], about: dict[str, Any], report: Path) -> int:
    rows = [r for record in records for r in record.rows]
    missed = sum(not r.ok for r in rows)
    failed = [r.id for r in records if r.error]
    empty = [r.id for r in records if not r.rows and not r.error]
    told = f"{counted(len(records), 'scenario')}, {counted(len(rows), 'row')}"
    if missed or failed or empty:
        told += f": {counted(missed, 'row')} missed"
        told += f", failed: {', '.join(failed)}" if failed else ""
        told += f", without rows: {', '.join(empty)}" if empty else ""
        for record in records:
            for r in record.rows:
                if not r.ok:
                    click.echo(_row_line(r, record.id))
    elif not about["interrupted"]:
        told += ", all within tolerance"
    click.echo(f"{told} ({about['elapsed_s']:.1f} s)")
    say(f"report: {printable(str(report))}")
    if about["interrupted"]:
        complain(f"interrupted: {len(records)} of {about['planned']} scenarios finished")
        return INTERRUPTED
    return 0 if all(r.ok for r in records) else MISSED


def _print_rows(record: Record) -> None:
    from rich.console import Console

    console = Console(highlight=False)
    if not console.is_terminal:
        click.echo(f"{record.id}: {record.title}")
        for r in record.rows:
            click.echo(_row_line(r))
    else:
        from rich.table import Table
        from rich.text import Text

        table = Table(title=record.title, title_justify="left", title_style="bold", box=None)
        table.add_column("")
        table.add_column("quantity", overflow="fold")
        for name in ("paper", "ours", "expected"):
            table.add_column(name, justify="right")
        table.add_column("tolerance")
        table.add_column("note", overflow="fold", style="dim")
        for r in record.rows:
            mark = Text("ok", style="green") if r.ok else Text("MISS", style="bold red")
            cells = [r.quantity, *map(format_value, (r.paper, r.ours, r.expected))]
            table.add_row(mark, *map(Text, (*cells, r.tolerance, r.note)))
        console.print(table)
    told = "all ok" if record.ok else f"{record.missed} missed"
    click.echo(
        f"{counted(len(record.rows), 'row')}, {told}, {record.elapsed_s:.2f} s, {record.backend}"
    )


def _row_line(r: Row, scenario: str = "") -> str:
    """A row on a line: for pipes and logs."""
    parts = [
        f"{'ok  ' if r.ok else 'MISS'} {scenario + ': ' if scenario else ''}{r.quantity}",
        f"ours {format_value(r.ours)}",
    ]
    if r.expected is not None:
        parts.append(f"expected {format_value(r.expected)}")
    parts.append(f"({r.tolerance})")
    if r.paper is not None:
        parts.append(f"paper {format_value(r.paper)}")
    if r.note:
        parts.append(f"[{r.note}]")
    return "  ".join(parts)
