"""`hgo compare-laws`: every law of the list on one bench."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from hgo_rs import plots
from hgo_rs.cli.places import can_draw, check_places, tell_written, written
from hgo_rs.cli.reproduce import made_folder
from hgo_rs.cli.terminal import say
from hgo_rs.config.text import read
from hgo_rs.errors import check

NAME = "which-observer"
"""Of the files that are written, before their endings."""
_BEGIN, _END = "<!-- laws -->", "<!-- end of laws -->"


@click.command("compare-laws", short_help="Compare all laws on one bench.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help=f"Folder for {NAME}.md, .png, .csv and .json; without it the tables are only printed.",
)
@click.option(
    "--page",
    "pages",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    multiple=True,
    help=f"Page whose short table, from {_BEGIN} to {_END}, is replaced; repeat the option for "
    "several.",
)
def compare_laws_command(out: Path | None, pages: tuple[Path, ...]) -> int:
    """Compare all observers of this package on the same systems.

    Integrator chains, systems of the papers, a drive with friction and a pendulum, with white,
    quantised and band-limited noise, outliers, gaps and jitter. All laws are tuned to the same
    settling time. It takes a minute or two.

    \b
    Example: the page, the figure and the data of the documentation
      hgo compare-laws --out docs --page README.md --page docs/index.md
    """
    from hgo_rs.bench import Report, measured

    endings = ["md", "csv", "json"]
    figure = out is not None and can_draw(None)
    endings += ["png"] if figure else []
    results = {} if out is None else {f".{end}": out / f"{NAME}.{end}" for end in endings}
    around = {page: _around(page) for page in pages}
    results |= {f"--page {page}": page for page in pages}
    if out is not None:
        made_folder(out)
    check_places(results, {})
    found = Report(measured(_progress if sys.stderr.isatty() else None))
    report = Report.of_csv(found.to_csv())  # the digits of the data
    texts = {
        ".md": report.page(f"{NAME}.png", f"{NAME}.csv"),
        ".csv": report.to_csv(),
        ".json": found.to_json(),
        **{
            f"--page {page}": f"{before}{_BEGIN}\n{report.short()}\n{_END}{after}"
            for page, (before, after) in around.items()
        },
    }
    if results:
        with written(results) as files:
            for name, file in files.items():
                if name == ".png":
                    plots.save(report.plot(), results[name], file)
                else:
                    file.write(texts[name].encode())
    say(str(report))
    tell_written(results, out is None or figure)
    return 0


def _around(page: Path) -> tuple[str, str]:
    """What stands before and after the short table of a page."""
    text = read(page)
    before, begin, rest = text.partition(_BEGIN)
    _, end, after = rest.partition(_END)
    allowed = f"a page with {_BEGIN} and {_END} in it"
    check(begin and end, "--page", str(page), allowed, "put both on lines of their own")
    return before, after


def _progress(done: int, count: int) -> None:
    text = f"\rsystem {done + 1} of {count}" if done < count else "\r" + " " * 24 + "\r"
    click.echo(text, nl=False, err=True)
