"""`hgo export`: an observer as source code, as an Arduino library or as an FMU."""

from __future__ import annotations

import warnings
from pathlib import Path

import click

from hgo_rs.cli.terminal import complain, say
from hgo_rs.config import load
from hgo_rs.errors import printable
from hgo_rs.exports import FMI, LANGUAGES, PERIODS, export
from hgo_rs.observers.told import in_words


@click.command("export", short_help="Write an observer as C, Rust, Arduino library or FMU.")
@click.argument("config", type=click.Path(path_type=Path))
@click.option(
    "--to",
    type=click.Choice(LANGUAGES),
    required=True,
    help="C99, no_std Rust, an Arduino library, or an FMU for co-simulation.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    help="Folder to write to; for an FMU also the file, NAME.fmu.",
)
@click.option("--name", help="Name of files and functions; by default that of CONFIG.")
@click.option(
    "--precision",
    type=click.Choice(["double", "single"]),
    help="Default: double; single for Arduino.",
)
@click.option("--dt", type=float, help="Sampling period, s; by default that of [log].")
@click.option(
    "--periods",
    type=int,
    default=PERIODS,
    show_default=True,
    help="Rows of the table of gains, for laws that need one: 1, 2, ... sampling periods.",
)
@click.option("--fmi-version", type=click.Choice(FMI), help="FMI version of an FMU; default 2.0.")
@click.option(
    "--unit",
    "units",
    multiple=True,
    metavar="NAME=UNIT",
    help="Unit of a variable of an FMU, such as w=rad/s; repeat the option for several.",
)
@click.option(
    "--fixed-dt",
    type=float,
    help="Fixed sampling period, s: gains are constants, and the functions take no dt.",
)
def export_command(
    config: Path,
    to: str,
    out: Path,
    name: str | None,
    precision: str | None,
    dt: float | None,
    periods: int,
    fmi_version: str | None,
    units: tuple[str, ...],
    fixed_dt: float | None,
) -> int:
    """Write the observer of CONFIG, an observer.toml, as source code without dependencies.

    Its steps give the same bits as this package. A test vector and a program that runs it are
    written too. An FMU is one file for Simulink, Modelica tools and others, with the source in it.

    \b
    Example: C in single precision for a chip
      hgo export axis.toml --to c --out axis_c --precision single
    """
    told = load(config)
    observer = told.observer()
    name = name if name is not None else config.stem.lower().replace("-", "_")
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        files = export(
            observer,
            to=to,
            out=out,
            name=name,
            precision=precision,
            dt=told.log.get("dt") if dt is None and fixed_dt is None else dt,
            periods=periods,
            version=fmi_version,
            units=dict(map(_unit, units)) or None,
            fixed_dt=fixed_dt,
        )
    for warning in warned:
        complain(str(warning.message))
    say(f"{config}: {in_words(observer)}")
    folder = out.parent if files == [out] else out
    names = ", ".join(str(file.relative_to(folder)) for file in files)
    say(f"written to {printable(str(folder))}: {names}")
    return 0


def _unit(text: str) -> tuple[str, str]:
    """Name and unit."""
    name, equals, unit = text.partition("=")
    if not equals:
        raise click.UsageError(f"--unit {text!r}: must be NAME=UNIT, such as w=rad/s")
    return name, unit
