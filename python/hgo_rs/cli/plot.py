"""`hgo plot`: a picture of a log, or of the estimates behind it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

from hgo_rs import plots
from hgo_rs.cli.places import can_draw, check_places, tell_written, written
from hgo_rs.cli.recorded import Asked, of_log, one_or_all
from hgo_rs.cli.terminal import say
from hgo_rs.errors import HgoError, check, printable
from hgo_rs.logs import Log, estimate, look, read_log
from hgo_rs.logs.streams import stem_of
from hgo_rs.logs.table import names_of
from hgo_rs.observers.told import in_words

_MOST = 8
"""Columns that are drawn where none is named."""


@click.command("plot", short_help="Plot a log, or its estimates.")
@of_log
@click.option("--from", "begin", type=float, help="Start of the plot, s.")
@click.option("--to", "end", type=float, help="End of the plot, s.")
@click.option(
    "--figure",
    type=click.Path(path_type=Path),
    help="Figure, .png, .svg or .pdf; by default LOG.png in this folder.",
)
def plot_command(
    log: Path,
    config: Path | None,
    dt: float | None,
    begin: float | None,
    end: float | None,
    figure: Path | None,
    **columns: tuple[str, ...],
) -> int:
    """Draw the recorded LOG over time, with a panel for each --output. Default: each column of
    numbers that moves. With --config, draw the estimates of its observer.

    \b
    Example: a log, then an observer's estimates over its second minute
      hgo plot axis.csv
      hgo plot axis.csv --config axis.toml --from 60 --to 120 --figure minute.png
    """
    figure = figure if figure is not None else Path(f"{stem_of(log)}.png")
    can_draw(figure)
    if config is None and not columns["output"]:
        recorded = _all(log, dt, columns, figure)
    else:
        asked = Asked.of(log, config, dt, columns)
        recorded = asked.read({"--figure": figure})
    late = -np.inf if begin is None else begin
    rows = _rows(recorded, late, np.inf if end is None else end)
    with written({"--figure": figure}) as files:
        if config is not None:
            assert asked.told is not None
            result = estimate(recorded, asked.told)
            say(f"run by {in_words(asked.told.observer())}")
            drawn = result.rows(rows).plot()
        else:
            drawn = _drawn(recorded.rows(rows))
        plots.save(drawn, figure, files["--figure"])
    tell_written({"--figure": figure})
    return 0


def _all(log: Path, dt: float | None, columns: dict[str, tuple[str, ...]], figure: Path) -> Log:
    """The columns that move, as outputs of one log."""
    check_places({"--figure": figure}, {"the log itself": log})
    found = look(log)
    given: dict[str, Any] = {key: one_or_all(value) for key, value in columns.items() if value}
    given |= {} if dt is None else {"dt": dt}
    if "time" not in given and dt is None:
        given["time"] = found.time
    apart = {given.get("time"), *str(given.get("time") or "").split("+")}
    moving = [c.name for c in found.columns if c.is_signal and c.name not in apart]
    if not moving:
        raise HgoError(f"{log}: no column of numbers moves; name one with --output")
    if len(moving) > _MOST:
        say(f"the first {_MOST} of {len(moving)} columns that move; --output names others")
    recorded = read_log(log, output=moving[:_MOST], **{"time": None, **given})
    say(f"{printable(str(log))}: {recorded.describe()}")
    return recorded


def _rows(log: Log, begin: float, end: float) -> slice:
    """The rows of a span of time."""
    rows = slice(int(np.searchsorted(log.t, begin)), int(np.searchsorted(log.t, end, "right")))
    span = f"a span within {log.t[0]:g} to {log.t[-1]:g}"
    check(rows.stop - rows.start >= 2, "--from, --to", (begin, end), span, "choose other times")
    return rows


def _drawn(log: Log) -> Any:
    """A panel for each output and input."""
    names = [*names_of(log.names["output"], "output")]
    signals = [log.y.reshape(len(log.t), -1)]
    if log.u is not None:
        names += names_of(log.names["input"], "input")
        signals.append(log.u.reshape(len(log.t), -1))
    return plots.estimate_figure(
        log.t,
        np.hstack(signals),
        missing=log.missing.reshape(len(log.t), -1).all(axis=1),
        names=[printable(name) for name in names],
    )
