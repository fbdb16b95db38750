"""`hgo export`: an observer as source code."""

from __future__ import annotations

from pathlib import Path

import click

from hgo_rs.cli.terminal import say
from hgo_rs.config import load
from hgo_rs.errors import printable
from hgo_rs.exports import PERIODS, export


@click.command("export", short_help="Write an observer as C or Rust source.")
@click.argument("config", type=click.Path(path_type=Path))
@click.option("--to", type=click.Choice(["c", "rust"]), required=True, help="C99 or no_std Rust.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Folder to write to.")
@click.option("--name", help="Name of files and functions; by default the file's.")
@click.option("--precision", type=click.Choice(["double", "single"]), default="double")
@click.option("--dt", type=float, help="Sampling period [s]; by default the file's.")
@click.option(
    "--periods",
    type=int,
    default=PERIODS,
    show_default=True,
    help="For how many sampling periods gains are held, where they are.",
)
def export_command(
    config: Path,
    to: str,
    out: Path,
    name: str | None,
    precision: str,
    dt: float | None,
    periods: int,
) -> int:
    """Write the observer of CONFIG, an observer.toml, as source code that needs nothing else.

    Its steps have the bits of this package's; a test vector and a program that runs it are beside
    it.
    """
    told = load(config)
    name = name if name is not None else config.stem.lower().replace("-", "_")
    files = export(
        told.observer(),
        to=to,
        out=out,
        name=name,
        precision=precision,
        dt=told.log.get("dt") if dt is None else dt,
        periods=periods,
    )
    names = ", ".join(str(file.relative_to(out)) for file in files)
    say(f"written to {printable(str(out))}: {names}")
    return 0
