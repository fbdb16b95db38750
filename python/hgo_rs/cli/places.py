"""Where results are written: checked before the work."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import click

from hgo_rs import plots
from hgo_rs.cli.reproduce import OutputError
from hgo_rs.cli.terminal import say
from hgo_rs.errors import HgoError, MissingExtraError, printable
from hgo_rs.files import together


def can_draw(figure: Path | None) -> bool:
    """A figure that is asked for needs matplotlib; the default one is left out without it."""
    if figure is None:
        try:
            plots.require_matplotlib()
        except MissingExtraError:
            return False
        return True
    plots.require_matplotlib()
    known = (".png", ".svg", ".pdf")
    if figure.suffix.lower() not in known:
        raise HgoError(f"{figure}: unknown format {figure.suffix!r}; known: {', '.join(known)}")
    return True


def check_places(results: Mapping[str, Path], sources: Mapping[str, Path | None]) -> None:
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


@contextmanager
def written(results: Mapping[str, Path]) -> Iterator[dict[str, IO[bytes]]]:
    """Open files by their options, all written or none; what was written is told."""
    try:
        with together(list(results.values())) as opened:
            yield dict(zip(results, opened, strict=True))
    except OSError as error:
        named = error.filename or ", ".join(map(str, results.values()))
        raise OutputError(f"cannot write {named}: {error.strerror or error}") from error


def tell_written(results: Mapping[str, Path], draws: bool = True) -> None:
    """The end of a command: what it wrote; ``draws``: whether figures can be drawn."""
    if not draws:
        click.echo("no figure: pip install 'hgo_rs[plot]'", err=True)
    if results:
        say(f"written: {', '.join(printable(str(path)) for path in results.values())}")
