"""`hgo tune`: gain and structure of an observer from a recorded log."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import click

from hgo_rs import plots
from hgo_rs.cli.places import can_draw, check_places
from hgo_rs.cli.reproduce import OutputError
from hgo_rs.cli.terminal import say
from hgo_rs.config import Config, load
from hgo_rs.errors import HgoError, printable
from hgo_rs.files import together
from hgo_rs.logs import Log, read_log
from hgo_rs.logs.times import UNITS
from hgo_rs.models import System
from hgo_rs.tuning import Tuning, TuningWarning, tune

_COLUMNS = ("time", "unit", "output", "input")


@click.command("tune", short_help="Choose an observer and its gain by a recorded log.")
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "--config",
    type=click.Path(path_type=Path),
    help="observer.toml whose [model] and [log] are taken; its observer and gain are not needed.",
)
@click.option("--time", metavar="COL", multiple=True, help="Time column.")
@click.option("--unit", type=click.Choice(list(UNITS)), multiple=True, help="Its unit.")
@click.option("--output", metavar="COL", multiple=True, help="Measured output; again for several.")
@click.option("--input", metavar="COL", multiple=True, help="Known input; again for several.")
@click.option("--dt", type=float, help="Sampling period, s: for a log without a time column.")
@click.option(
    "--state",
    type=int,
    multiple=True,
    help="The wanted estimate, counted from 1; of several outputs one a chain. Default: the last.",
)
@click.option("--skip", type=float, help="Time at the start that is not judged, s.")
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
def tune_command(
    log: Path,
    config: Path | None,
    dt: float | None,
    state: tuple[int, ...],
    skip: float | None,
    out: Path | None,
    table: Path | None,
    figure: Path | None,
    **columns: tuple[str, ...],
) -> int:
    """Choose structure, poles and gain of an observer by the recorded LOG alone.

    The model is that of --config; without one nothing is known. What was tried, why it was chosen
    and how much each estimate errs is told; the observer is written as a file for `hgo estimate`.

    \b
    Example: velocity from a measured position, no model
      hgo tune axis.csv --time t --output q
      hgo estimate axis.csv --config axis.observer.toml
    """
    out = out if out is not None else Path(f"{log.stem}.observer.toml")
    draw = can_draw(figure)
    figure = figure if figure is not None else out.with_suffix(".png")
    told = None if config is None else load(config)
    arguments = dict(told.data.get("log", {})) if told is not None else {}
    arguments |= {key: _one(columns[key]) for key in _COLUMNS if columns[key]}
    arguments |= {} if dt is None else {"dt": dt}
    if "output" not in arguments:
        raise HgoError("--output is needed: the column that was measured; or a --config with [log]")
    results = {"--out": out}
    results |= {} if table is None else {"--table": table}
    results |= {"--figure": figure} if draw else {}
    check_places(results, {"the log itself": log, "the file of --config": config})
    recorded = read_log(log, **{"time": None, **arguments})
    say(f"{printable(str(log))}: {recorded.describe()}")
    result = _tuned(recorded, None if told is None else _model(told), state, skip)
    drawn = draw and bool(result.curves)  # gains of several outputs are not on one curve
    if not drawn:
        results.pop("--figure", None)
    try:
        with together(list(results.values())) as opened:
            files = dict(zip(results, opened, strict=True))
            saved = Config.of(result.observer, **arguments).to_toml()
            files["--out"].write(saved.encode())
            if drawn:
                plots.save(result.plot(), figure, files["--figure"])
            if table is not None:
                files["--table"].write(_table(result).encode())
    except OSError as error:
        named = error.filename or ", ".join(map(str, results.values()))
        raise OutputError(f"cannot write {named}: {error.strerror or error}") from error
    say(result.report())
    if not draw:
        click.echo("no figure: pip install 'hgo_rs[plot]'", err=True)
    say(f"written: {', '.join(printable(str(path)) for path in results.values())}")
    return 0


def _one(given: tuple[str, ...]) -> Any:
    return given[0] if len(given) == 1 else list(given)


def _model(told: Config) -> System | None:
    """The model of a file, whose gain may be left out: it is what is looked for."""
    gained = any(key in told.data for key in ("gain", "epsilon", "observers"))
    return (told if gained else told.replace(gain=1.0)).observer().model


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
