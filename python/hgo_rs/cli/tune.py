"""`hgo tune`: gain and structure of an observer from a recorded log."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import click

from hgo_rs import pages, plots
from hgo_rs.cli.places import can_draw, tell_written, written
from hgo_rs.cli.recorded import Asked, of_log
from hgo_rs.cli.terminal import say
from hgo_rs.logs import Log
from hgo_rs.logs.streams import stem_of
from hgo_rs.models import System
from hgo_rs.observers.told import in_words
from hgo_rs.tuning import Tuning, TuningWarning, tune


@click.command("tune", short_help="Choose an observer and its gain from a recorded log.")
@of_log
@click.option(
    "--state",
    type=int,
    multiple=True,
    help="The wanted estimate, counted from 1; one for each chain. Default: the last that all "
    "structures have.",
)
@click.option("--skip", type=float, help="Time at the start that is not evaluated, s.")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="The chosen observer; by default LOG.observer.toml in this folder.",
)
@click.option("--table", type=click.Path(path_type=Path), help="All curves over the gain, .csv.")
@click.option(
    "--figure",
    type=click.Path(path_type=Path),
    help="Figure, .png, .svg or .pdf; by default beside the observer, as PNG.",
)
@click.option(
    "--page",
    type=click.Path(path_type=Path),
    help="A page to tune in, .html: sliders for gain, structure, method and noise. One file.",
)
def tune_command(
    log: Path,
    config: Path | None,
    dt: float | None,
    state: tuple[int, ...],
    skip: float | None,
    out: Path | None,
    table: Path | None,
    figure: Path | None,
    page: Path | None,
    **columns: tuple[str, ...],
) -> int:
    """Choose structure, poles and gain of an observer from the recorded LOG alone.

    The model is that of --config; without it there is none. The report lists the structures
    tried, the reason for the choice and the predicted error of each estimate. The observer is
    written as a file for `hgo estimate`.

    \b
    Example: velocity from a measured position, no model
      hgo tune axis.csv --time t --output q
      hgo estimate axis.csv --config axis.observer.toml

    \b
    Example: the same, and a page with sliders
      hgo tune axis.csv --time t --output q --page tune.html
    """
    if page is not None:
        pages.require_module()
    out = out if out is not None else Path(f"{stem_of(log)}.observer.toml")
    draw = can_draw(figure)
    figure = figure if figure is not None else out.with_suffix(".png")
    asked = Asked.of(log, config, dt, columns)
    results = {"--out": out}
    results |= {} if table is None else {"--table": table}
    results |= {"--figure": figure} if draw else {}
    results |= {} if page is None else {"--page": page}
    recorded = asked.read(results)
    if page is not None:
        pages.check_outputs(1 if recorded.y.ndim == 1 else recorded.y.shape[1])
    result = _tuned(recorded, asked.model, state, skip)
    text, said = "", ""
    if page is not None:
        text, said = pages.page(result, recorded.source, asked.saved)
    with written(results) as files:
        saved = asked.saved(result.observer).to_toml()
        files["--out"].write(saved.encode())
        if draw:
            plots.save(result.plot(), figure, files["--figure"])
        if table is not None:
            files["--table"].write(_table(result).encode())
        if page is not None:
            files["--page"].write(text.encode())
    say(result.report())
    say(f"\nchosen: {in_words(result.observer)}")
    if said:
        say(f"the page: {said}")
    tell_written(results, draw)
    return 0


def _tuned(
    recorded: Log, model: System | None, state: tuple[int, ...], skip: float | None
) -> Tuning:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", TuningWarning)  # the report tells them
        several: Any = list(state) or None
        wanted = state[0] if len(state) == 1 else several
        if not sys.stdout.isatty():
            return tune(model, recorded, state=wanted, skip=skip)
        bar: Any
        with click.progressbar(length=1, label="tuning") as bar:

            def moved(done: int, count: int) -> None:
                bar.length = count
                bar.update(done - bar.pos)

            return tune(model, recorded, state=wanted, skip=skip, progress=moved)


def _table(result: Tuning) -> str:
    """The curves as CSV."""
    columns = result.columns()
    rows = zip(*columns.values(), strict=True)
    lines = [",".join(columns)]
    for structure, *numbers in rows:
        quoted = '"' + structure.replace('"', '""') + '"'
        lines.append(",".join([quoted, *(repr(float(number)) for number in numbers)]))
    return "\n".join(lines) + "\n"
