"""`hgo smooth`, `hgo fit` and `hgo compare`: a whole record at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from hgo_rs import plots
from hgo_rs.cli.places import can_draw, tell_written, written
from hgo_rs.cli.recorded import Asked, counted, of_log
from hgo_rs.cli.terminal import say
from hgo_rs.config import load
from hgo_rs.errors import HgoError, check
from hgo_rs.logs.streams import stem_of
from hgo_rs.models import Model
from hgo_rs.observers.told import in_words
from hgo_rs.smoothing import compare, fit, smooth

_PATH = click.Path(path_type=Path)


@click.command("smooth", short_help="Estimate states from all samples of a recorded log.")
@of_log
@click.option("--order", type=int, help="Order of the chain, without a model; default 3.")
@click.option("--out", type=_PATH, help="States, .csv; by default LOG.smooth.csv in this folder.")
@click.option("--figure", type=_PATH, help="Figure, .png, .svg or .pdf; by default beside it.")
def smooth_command(
    log: Path,
    config: Path | None,
    dt: float | None,
    order: int | None,
    out: Path | None,
    figure: Path | None,
    **columns: tuple[str, ...],
) -> int:
    """Smooth the recorded LOG: states from all samples, with standard deviations.

    The model is that of --config; without it, the model is a chain of --order.

    \b
    Example: velocity and acceleration of a measured position, no model
      hgo smooth axis.csv --time t --output q
    """
    out = out if out is not None else Path(f"{stem_of(log)}.smooth.csv")
    draw = can_draw(figure)
    figure = figure if figure is not None else out.with_suffix(".png")
    asked = Asked.of(log, config, dt, columns)
    results = {"--out": out} | ({"--figure": figure} if draw else {})
    recorded = asked.read(results)
    with counted("smoothing") as count:
        found = smooth(asked.model, recorded, order=order, progress=count)
    with written(results) as files:
        found.write_csv(files["--out"])
        if draw:
            plots.save(found.plot(), figure, files["--figure"])
    say(str(found))
    tell_written(results, draw)
    return 0


@click.command("fit", short_help="Estimate parameters of a model from a recorded log.")
@of_log
@click.option(
    "--parameter", multiple=True, help="To estimate; repeat the option for several. Default: all."
)
@click.option("--out", type=_PATH, help="observer.toml with the values found; needs --config.")
def fit_command(
    log: Path,
    config: Path | None,
    dt: float | None,
    parameter: tuple[str, ...],
    out: Path | None,
    **columns: tuple[str, ...],
) -> int:
    """Estimate parameters of the model of --config from the recorded LOG, with standard errors.

    The search starts at the values of the file.

    \b
    Example: inertia and friction of a drive
      hgo fit drive.csv --config drive.toml --parameter J --parameter b --out fitted.toml
    """
    asked = Asked.of(log, config, dt, columns)
    model = asked.model
    if asked.told is None or not isinstance(model, Model):
        raise HgoError("--config is needed: an observer.toml whose [model] has parameters")
    results = {} if out is None else {"--out": out}
    recorded = asked.read(results)
    with counted("fitting") as count:
        found = fit(model, recorded, list(parameter) or None, progress=count)
    if out is not None:
        values = {**asked.told.data["model"], "parameters": dict(found.model.parameters)}
        with written(results) as files:
            files["--out"].write(asked.told.replace(model=values).to_toml().encode())
    say(str(found))
    tell_written(results)
    return 0


@click.command("compare", short_help="Compare observers and other filters on a recorded log.")
@of_log
@click.option(
    "--observer",
    "observers",
    type=_PATH,
    multiple=True,
    help="observer.toml to compare; repeat the option for several.",
)
@click.option("--truth", metavar="STATE=COL", multiple=True, help="Column of a reference sensor.")
@click.option("--skip", type=float, help="Time at the start that is not evaluated, s.")
@click.option("--out", type=_PATH, help="The table, .csv.")
@click.option("--figure", type=_PATH, help="Figure, .png, .svg or .pdf.")
def compare_command(
    log: Path,
    config: Path | None,
    dt: float | None,
    observers: tuple[Path, ...],
    truth: tuple[str, ...],
    skip: float | None,
    out: Path | None,
    figure: Path | None,
    **columns: tuple[str, ...],
) -> int:
    """Compare observers and other filters on the recorded LOG.

    Each --observer begins at the first sample; the start in its file is not used. The other
    filters are a filtered difference, Savitzky-Golay, alpha-beta-gamma and Kalman filters, tuned
    on the log alone. Errors are taken from the smoothed state, or from the columns of --truth.

    \b
    Example: the choice of `hgo tune` compared with other filters
      hgo compare axis.csv --time t --output q --observer axis.observer.toml
    """
    draw = figure is not None and can_draw(figure)
    config = config if config is not None or not observers else observers[0]
    asked = Asked.of(log, config, dt, columns)
    results: dict[str, Path] = {} if out is None else {"--out": out}
    results |= {} if figure is None else {"--figure": figure}
    recorded = asked.read(results)
    given = _named(observers)
    found = compare(recorded, given, model=asked.model, truth=_truth(asked, truth), skip=skip)
    if results:
        with written(results) as files:
            if out is not None:
                files["--out"].write(found.to_csv().encode())
            if draw and figure is not None:
                plots.save(found.plot(), figure, files["--figure"])
    for name, observer in given.items():
        say(f"{name}: {in_words(observer)}; begun at the first sample")
    say(str(found))
    tell_written(results)
    return 0


def _named(files: tuple[Path, ...]) -> dict[str, Any]:
    """Observers by the names of their files, by their whole paths where these are the same."""
    stems = [path.stem for path in files]
    names = [
        stem if stems.count(stem) == 1 else str(path)
        for path, stem in zip(files, stems, strict=True)
    ]
    for name in names:
        check(names.count(name) == 1, "--observer", name, "given once", "leave the second one out")
    return {name: load(path).observer() for name, path in zip(names, files, strict=True)}


def _truth(asked: Asked, pairs: tuple[str, ...]) -> Any:
    """Columns of the log by the states that they show."""
    if not pairs:
        return None
    found = {}
    for pair in pairs:
        state, _, column = pair.partition("=")
        if not state or not column:
            raise HgoError(f"--truth {pair}: must be STATE=COL; write for example v=velocity")
        found[state] = asked.column(column)
    return found
