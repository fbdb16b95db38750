"""`hgo compare-laws`: every law of the list on one bench."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from hgo_rs import plots
from hgo_rs.cli.places import can_draw, check_places, tell_written, written
from hgo_rs.cli.terminal import say

NAME = "which-observer"
"""Of the files that are written, before their endings."""


@click.command("compare-laws", short_help="Every law on one bench: which wins where.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help=f"Folder for {NAME}.md, .png, .csv and .json; else the tables are shown only.",
)
def compare_laws_command(out: Path | None) -> int:
    """Compare all observers of this package on the same systems.

    Integrator chains, systems of the papers, a drive with friction and a pendulum, with white,
    quantised and band-limited noise, outliers, gaps and jitter; every law tuned to the same
    settling time. It takes a minute or two.

    \\b
    Example: the page, the figure and the data of the documentation
      hgo compare-laws --out docs
    """
    from hgo_rs.bench import Report, measured

    endings = ["md", "csv", "json"]
    figure = out is not None and can_draw(None)
    endings += ["png"] if figure else []
    results = {} if out is None else {f".{end}": out / f"{NAME}.{end}" for end in endings}
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        check_places(results, {})
    found = Report(measured(_progress if sys.stderr.isatty() else None))
    report = Report.of_csv(found.to_csv())  # the digits of the data
    if out is not None:
        texts = {
            ".md": report.page(f"{NAME}.png", f"{NAME}.csv"),
            ".csv": report.to_csv(),
            ".json": found.to_json(),
        }
        with written(results) as files:
            for end, text in texts.items():
                files[end].write(text.encode())
            if figure:
                plots.save(report.plot(), results[".png"], files[".png"])
    say(str(report))
    tell_written(results, out is None or figure)
    return 0


def _progress(done: int, count: int) -> None:
    text = f"\rsystem {done + 1} of {count}" if done < count else "\r" + " " * 24 + "\r"
    click.echo(text, nl=False, err=True)
