"""The `hgo` command: list, run and reproduce scenarios; run an observer over a recorded log.

Exit status: 0 all well, 1 a row missed its tolerance or a scenario failed, 2 bad usage or bad
input (one line on standard error), 130 interrupted, 143 terminated.
"""

from __future__ import annotations

import difflib
import inspect
import json
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from hgo_rs import plotting, scenarios
from hgo_rs.config import FORMAT, OBSERVERS, Config, load
from hgo_rs.data import Log, LogSummary, TableWriter, check_writable_format, read_chunks
from hgo_rs.design.discrete import DEFAULT_METHOD, DEFAULT_TIMING
from hgo_rs.errors import HgoError, MissingExtraError, printable
from hgo_rs.estimation import check_fit, run_chunks
from hgo_rs.files import together
from hgo_rs.gaps import gap_error
from hgo_rs.record import rows_to_json
from hgo_rs.report import counted, format_value
from hgo_rs.reproduce import (
    OutputError,
    OutputFolder,
    Record,
    about_this_run,
    execute,
)
from hgo_rs.reproduce import run as run_scenarios
from hgo_rs.scenarios.base import BACKENDS, Row
from hgo_rs.times import UNITS

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

    from hgo_rs.observers import Observer
    from hgo_rs.results import Gap, RunResult

__all__ = ["main"]

MISSED, USAGE, INTERRUPTED, TERMINATED = 1, 2, 130, 143


def main(args: Sequence[str] | None = None) -> None:
    """Run the command and exit with its status; every error is one clear line."""
    try:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, _terminated)  # workers end, half-written files go
        status = command.main(args=args, prog_name="hgo", standalone_mode=False)
    except click.ClickException as error:
        _complain(error.format_message())
        sys.exit(USAGE)
    except HgoError as error:
        _complain(str(error))
        sys.exit(USAGE)
    except (KeyboardInterrupt, click.Abort):
        _complain("interrupted")
        sys.exit(INTERRUPTED)
    except BrokenPipeError:  # `hgo list | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    sys.exit(status if isinstance(status, int) else 0)


def _terminated(*_: object) -> None:
    sys.exit(TERMINATED)


def _complain(message: str) -> None:
    _say("hgo: " + " ".join(message.split("\n")), err=True)


def _say(text: str, err: bool = False) -> None:
    """Print lines whose names, from files and arguments, do nothing to the terminal."""
    click.echo("\n".join(map(printable, text.split("\n"))), err=err)


class _Commands(click.Group):
    """A group that names the nearest command for an unknown one."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name = args[0]
        if not name.startswith("-") and self.get_command(ctx, name) is None:
            raise click.UsageError(_unknown("command", name, self.list_commands(ctx)))
        return super().resolve_command(ctx, args)


def _unknown(kind: str, name: str, known: Sequence[str]) -> str:
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.4)
    hint = f"nearest: {', '.join(near)}; " if near else ""
    return f"unknown {kind} {name!r}; {hint}known: {', '.join(known)}"


@click.group(
    cls=_Commands,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="hgo_rs", prog_name="hgo")
def command() -> None:
    """High-gain observers: recompute five papers, or estimate states from a recorded log."""


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


# --- scenarios -------------------------------------------------------------------------------


@command.command("list")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON array.")
def list_command(as_json: bool) -> None:
    """List the scenarios: id and title, paper by paper."""
    known = scenarios.load()
    if as_json:
        items = [{"id": s.id, "title": s.title, "paper": s.paper} for s in known.values()]
        click.echo(json.dumps(items, ensure_ascii=False))
        return
    width = max((len(id) for id in known), default=0)
    paper = ""
    for s in known.values():
        if s.paper != paper and sys.stdout.isatty():
            paper = s.paper
            info = scenarios.PAPERS[paper]
            click.secho(f"\n{info.title}", bold=True)
            click.secho(info.authors, dim=True)
        click.echo(f"{s.id:<{width}}  {s.title}")


@command.command("run", short_help="Run one scenario and print its rows.")
@click.argument("id")
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
        plotting.require_matplotlib()
        folder = OutputFolder(out)
    record = execute(scenario, scenarios.Context(backend, seed), figures=folder is not None)
    if record.error:
        click.echo(record.error, err=True, nl=False)
        _complain(f"{id} failed")
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
            _say(f"written to {printable(str(folder.path))}: {', '.join(names)}")
    return 0 if record.ok else MISSED


@command.command("reproduce", short_help="Run every scenario; write figures and a report.")
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
        plotting.require_matplotlib()
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
    _say(f"report: {printable(str(report))}")
    if about["interrupted"]:
        _complain(f"interrupted: {len(records)} of {about['planned']} scenarios finished")
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


# --- estimate --------------------------------------------------------------------------------


class _Numbers(click.ParamType):
    """A list of numbers, complex ones as 1+2j: -1,-2 or "-1+1j, -1-1j"."""

    name = "numbers"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> list[Any]:
        if not isinstance(value, str):
            return list(value)
        numbers: list[Any] = []
        for part in value.split(","):
            try:
                number = complex(part.strip().replace(" ", "").replace("i", "j"))
            except ValueError:
                self.fail(f"{part.strip()!r} is not a number; write for example -1,-2", param, ctx)
            numbers.append(number if number.imag else number.real)
        return numbers


@command.command("estimate", short_help="Run an observer over a recorded log.")
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--config", type=click.Path(path_type=Path), help="observer.toml; options go before.")
@click.option("--time", "time", metavar="COL", multiple=True, help="Time column.")
@click.option(
    "--unit",
    type=click.Choice(list(UNITS)),
    multiple=True,
    help="Unit of the time column; again for several.",
)
@click.option("--output", metavar="COL", multiple=True, help="Measured output.")
@click.option("--input", "input", metavar="COL", multiple=True, help="Known input.")
@click.option(
    "--input-gain",
    type=float,
    metavar="B0",
    help="n-th derivative of the output for one unit of input (with --input; default 1).",
)
@click.option("--observer", metavar="NAME", help=f"One of {', '.join(OBSERVERS)}.")
@click.option("--order", type=int, help="Number of states.")
@click.option("--gain", type=float, help="The gain L (ell), 1/s.")
@click.option("--dt", type=float, help="Sampling period, s: for a log without a time column.")
@click.option("--poles", type=_Numbers(), help="Poles at gain 1, for example -1,-2,-3.")
@click.option(
    "--method",
    help=f"Discretisation; by default the class's own: {DEFAULT_METHOD}, where the law takes it.",
)
@click.option(
    "--timing",
    help="current (the estimate at a sample uses it) or predictor; by default "
    f"{DEFAULT_TIMING}, where the law takes it.",
)
@click.option("--saturation", type=_Numbers(), help="Bounds on the states 2 to n (peaking-free).")
@click.option("--allow-unstable", is_flag=True, help="Go beyond the step limit of the method.")
@click.option(
    "--resets",
    type=click.Choice(["refuse", "split"]),
    help="A clock that starts again: an error (default), or a new start of the observer.",
)
@click.option(
    "--save-config",
    type=click.Path(path_type=Path),
    help="Write what --config and the options say as an observer.toml.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Estimates, .csv or .parquet; by default LOG.estimates.csv in this folder.",
)
@click.option(
    "--figure",
    type=click.Path(path_type=Path),
    help="Figure, .png, .svg or .pdf; by default beside the estimates, as PNG.",
)
def estimate_command(
    log: Path,
    config: Path | None,
    save_config: Path | None,
    out: Path | None,
    figure: Path | None,
    **options: Any,
) -> int:
    """Run an observer over the recorded LOG (CSV, Parquet, .mat, .npz).

    Empty cells and NaN are missing samples: the observer predicts over them. Uneven steps are
    honoured. Options may be repeated for several columns.

    \b
    Example: velocity and acceleration from a measured position
      hgo estimate axis.csv --time t --output q --observer low-power --order 3 --gain 60
    """
    out = out if out is not None else Path(f"{log.stem}.estimates.csv")
    check_writable_format(out)
    draw = _can_draw(figure)
    figure = figure if figure is not None else out.with_suffix(".png")
    told = _configuration(config, options)
    law = told.observer()
    arguments = told.log
    check_fit(law, arguments, f"{told.place(('log',))}: " if config else "")
    results = {"--out": out}
    if draw:
        results["--figure"] = figure
    if save_config is not None:
        results["--save-config"] = save_config
    _check_places(results, {"the log itself": log, "the file of --config": config})
    summary, gaps, trace = LogSummary(), _LongestGaps(), _Trace()

    def seen(chunks: Iterable[Log]) -> Iterator[Log]:
        for chunk in chunks:
            summary.add(chunk)
            yield chunk

    piece = -1
    try:
        with together(list(results.values())) as opened:
            files = dict(zip(results, opened, strict=True))
            with TableWriter(out, files["--out"]) as writer:
                for chunk, result in run_chunks(law, seen(read_chunks(log, **arguments))):
                    piece += len(chunk.starts)
                    split = arguments.get("resets") == "split"
                    writer.write(_columns(chunk, result, piece if split else None))
                    gaps.add(law, result)
                    if draw:
                        trace.add(chunk, result)
            if draw:
                drawn = trace.draw(law, arguments["output"], told.data["observer"])
                plotting.save(drawn, figure, files["--figure"])
            if save_config is not None:
                files["--save-config"].write(told.to_toml().encode())
    except OSError as error:
        named = error.filename or ", ".join(map(str, results.values()))
        raise OutputError(f"cannot write {named}: {error.strerror or error}") from error
    _say(f"{printable(str(log))}: {summary.describe()}")
    _say(f"run by {_law(law)}")
    gaps.tell()
    if not draw:
        click.echo("no figure: pip install 'hgo_rs[plot]'", err=True)
    _say(f"written: {', '.join(printable(str(path)) for path in results.values())}")
    return 0


def _law(law: Observer) -> str:
    """What ran: kind and order, gain, method and timing, as it was chosen."""
    parts = law.spec.get("observers", [law.spec])
    told = []
    for part in parts:
        gain = part.get("gain")
        ell = gain.get("ell") if isinstance(gain, dict) else None
        words = [part["kind"]]
        words += [f"order {part['n']}"] if "n" in part else []
        words += [f"gain {ell:g} 1/s"] if ell is not None else []
        words += [f"method {part['method']}"] if "method" in part else []
        told.append(", ".join(words))
    return f"{'; '.join(told)}; timing {law.timing}"


def _configuration(path: Path | None, options: dict[str, Any]) -> Config:
    """What the file says, and over it the options that were given."""
    given = {k: v for k, v in options.items() if v is not None and v is not False and v != ()}
    columns: dict[str, Any] = {
        key: given.pop(key)[0] if len(given[key]) == 1 else list(given.pop(key))
        for key in ("time", "unit", "output", "input")
        if key in given
    }
    columns |= {key: given.pop(key) for key in ("dt", "resets") if key in given}
    base = None if path is None else load(path)
    b0 = given.pop("input_gain", None)
    if b0 is not None and "input" not in {**(base.log if base else {}), **columns}:
        raise HgoError("--input-gain has no meaning without --input: name the input's column")
    if b0 is not None or (base is None and "input" in columns):
        given["model"] = {"kind": "input", "b0": 1.0 if b0 is None else b0}
    _check_options(given, base)
    if base is not None:
        return base.replace(columns, **given)
    return Config({"format": FORMAT, "observer": given.pop("observer")}).replace(columns, **given)


def _check_options(given: dict[str, Any], base: Config | None) -> None:
    """Refuse options that the observer has no use for, and without a file, missing ones."""
    import hgo_rs

    name = given.get("observer", base.data["observer"] if base else None)
    if name is None:
        raise HgoError("--observer is needed, or a --config that names one")
    if name not in OBSERVERS:
        raise HgoError(_unknown("observer", name, list(OBSERVERS)))
    accepted = inspect.signature(getattr(hgo_rs, OBSERVERS[name])).parameters
    for key in given:
        if key != "observer" and {"order": "n"}.get(key, key) not in accepted:
            option = "--" + {"model": "input"}.get(key, key).replace("_", "-")
            raise HgoError(f"{option} has no meaning for --observer {name}")
    if base is not None:
        return
    needed = [key for key, p in accepted.items() if p.default is inspect.Parameter.empty]
    for key in (*needed, *(["gain"] if "epsilon" in accepted else [])):
        key = {"n": "order"}.get(key, key)
        if key not in given:
            option = "--" + key.replace("_", "-")
            raise HgoError(f"{option} is needed for --observer {name}, or a --config that says it")


def _can_draw(figure: Path | None) -> bool:
    """A figure that is asked for needs matplotlib; the default one is left out without it."""
    if figure is None:
        try:
            plotting.require_matplotlib()
        except MissingExtraError:
            return False
        return True
    plotting.require_matplotlib()
    known = (".png", ".svg", ".pdf")
    if figure.suffix.lower() not in known:
        raise HgoError(f"{figure}: unknown format {figure.suffix!r}; known: {', '.join(known)}")
    return True


def _check_places(results: Mapping[str, Path], sources: Mapping[str, Path | None]) -> None:
    """Refuse before the work, not after it: what cannot be written, or would replace another."""
    taken = {name: path for name, path in sources.items() if path is not None}
    for option, path in results.items():
        for name, other in taken.items():
            if _same_file(path, other):
                remedy = f"choose another file with {option}"
                if name in results:
                    name = f"the file of {name} too"
                raise OutputError(f"{path} is {name}; {remedy}")
        taken[option] = path
        _check_writable(path)


def _same_file(a: Path, b: Path) -> bool:
    try:
        return a.resolve() == b.resolve() or a.samefile(b)
    except OSError:
        return False


def _check_writable(path: Path) -> None:
    if path.is_dir():
        raise OutputError(f"cannot write {path}: it is a folder")
    if path.exists() and not path.is_file():
        raise OutputError(f"cannot write {path}: it is a pipe or a device; name a file")
    existed = path.exists()
    try:
        with path.open("ab"):
            pass
        if not existed:
            path.unlink()
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error


def _columns(log: Log, result: RunResult, piece: int | None) -> dict[str, np.ndarray]:
    """t, y, u, x_hat1 ... x_hatN, innovation, missing (0 or 1), and the piece where asked for.

    Several outputs and inputs are numbered: y1, y2, ...
    """
    columns: dict[str, np.ndarray] = {"t": log.t}

    def add(name: str, values: np.ndarray) -> None:
        if values.ndim == 1:
            columns[name] = values
        else:
            columns.update({f"{name}{i + 1}": column for i, column in enumerate(values.T)})

    add("y", log.y)
    if log.u is not None:
        add("u", log.u)
    add("x_hat", result.x_hat)
    add("innovation", result.innovation.reshape(log.y.shape))
    add("missing", log.missing.astype(np.int64))
    if piece is not None:
        columns["piece"] = np.full(len(log.t), piece)
    return columns


class _LongestGaps:
    """The longest gaps of a log, and the error to expect at their ends."""

    COUNT = 3

    def __init__(self) -> None:
        self.found: list[tuple[float, float, Gap, np.ndarray]] = []

    def add(self, law: Observer, result: RunResult) -> None:
        """Look at a chunk; what a gap costs is computed for those that are among the longest."""
        if not result.missing.any():
            return
        least = self.found[-1][0] if len(self.found) == self.COUNT else 0.0
        gaps = sorted(result.gaps, key=lambda gap: -gap.duration)[: self.COUNT]
        gaps = [gap for gap in gaps if gap.duration > least]
        if not gaps:
            return
        errors = gap_error(law, result, result.inputs, gaps)
        for gap, error in zip(gaps, errors, strict=True):
            self.found.append((gap.duration, float(result.time[gap.start]), gap, error))
        self.found = sorted(self.found, key=lambda f: -f[0])[: self.COUNT]

    def tell(self) -> None:
        for duration, t, gap, error in self.found:
            states = ", ".join(
                f"x_hat{i + 1} {e:.3g}" for i, e in enumerate(error) if np.isfinite(e)
            )
            told = f"error to expect at its end: {states}" if states else "no error estimate"
            _say(f"gap of {duration:.4g} s ({gap.length} samples) at t = {t:.10g} s: {told}")


class _Trace:
    """What a figure shows of a log of any length: every row, or every 2nd, 4th, ..."""

    MOST = 200_000

    def __init__(self) -> None:
        self.parts: dict[str, list[np.ndarray]] = {}
        self.stride, self.count, self.kept = 1, 0, 0
        self.end = self.offset = math.nan

    def add(self, log: Log, result: RunResult) -> None:
        if not log.t[0] > self.end:  # the clock starts again: draw it behind what there is
            self.offset = 0.0 if math.isnan(self.end) else self.end + self.offset - log.t[0]
        self.end = float(log.t[-1])
        rows = slice(-self.count % self.stride, None, self.stride)
        single = log.y.ndim == 1
        signals: dict[str, np.ndarray] = {"time": log.t + self.offset, "x_hat": result.x_hat}
        if single:
            signals |= {"y": log.y, "innovation": result.innovation.ravel()}
        signals["missing"] = result.missing
        if result.gain is not None:
            signals["gain"] = result.gain
        for name, values in signals.items():
            self.parts.setdefault(name, []).append(np.array(values[rows]))
        self.count += len(log.t)
        self.kept += len(self.parts["time"][-1])
        while self.kept > self.MOST:
            self.stride *= 2
            self.parts = {n: [np.concatenate(p)[::2]] for n, p in self.parts.items()}
            self.kept = len(self.parts["time"][0])

    def draw(self, law: Observer, output: Any, kind: str) -> Any:
        signals: dict[str, Any] = {n: np.concatenate(p) for n, p in self.parts.items()}
        gain = f", gain {law.gain:g} 1/s" if law.spec.get("gain", {}) and law.gain else ""
        moves = law._gain_index() is not None
        if not moves:
            signals.pop("gain", None)
        title = f"{kind}, order {law.n}" + ("" if moves else gain)
        if self.stride > 1:
            title += f" (every {self.stride}th row)"
        name = f"column {output}" if str(output).isdigit() else printable(str(output))
        return plotting.estimate_figure(
            signals.pop("time"),
            signals.pop("x_hat"),
            names=_state_names(law, name),
            output=f"{name}, measured",
            title=title,
            **signals,
        )


def _state_names(law: Observer, output: str) -> list[str] | None:
    """The names of the states: the model's own, or the output and its derivatives."""
    own = law.spec["model"].get("names", {}).get("states")
    if own or law.n_y > 1:
        return list(own) if own and len(own) == law.n else None
    ordinals = ("first", "second", "third", "fourth", "fifth")
    names = [output]
    for i in range(1, law.n):
        which = f"{ordinals[i - 1]} derivative" if i <= len(ordinals) else f"derivative {i}"
        names.append(f"{which} of {output}")
    return names


# --- export ----------------------------------------------------------------------------------


@command.command("export", short_help="Write an observer as C or Rust source.")
@click.argument("config", type=click.Path(path_type=Path))
@click.option("--to", type=click.Choice(["c", "rust"]), required=True, help="C99 or no_std Rust.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder to write to.")
@click.option("--name", help="Name of files and functions; by default the file's.")
@click.option("--precision", type=click.Choice(["double", "single"]), default="double")
@click.option("--dt", type=float, help="Sampling period [s]; by default the file's.")
@click.option("--periods", type=int, help="For how many periods gains are held, where they are.")
def export_command(
    config: Path,
    to: str,
    out: Path,
    name: str | None,
    precision: str,
    dt: float | None,
    periods: int | None,
) -> int:
    """Write the observer of CONFIG, an observer.toml, as source code that needs nothing else.

    Its steps have the bits of this package's; a test vector and a program that runs it are beside
    it.
    """
    from hgo_rs.config import load
    from hgo_rs.exports import PERIODS, export

    told = load(config)
    name = name if name is not None else config.stem.lower().replace("-", "_")
    files = export(
        told.observer(),
        to=to,
        out=out,
        name=name,
        precision=precision,
        dt=told.log.get("dt") if dt is None else dt,
        periods=PERIODS if periods is None else periods,
    )
    names = ", ".join(str(file.relative_to(out)) for file in files)
    _say(f"written to {printable(str(out))}: {names}")
    return 0


if __name__ == "__main__":
    main()
