"""An observer as source code: C99, or Rust without `std`; self-contained, readable, the same bits.

The core traces one step of an observer into a table (every operation, in its order); this package
writes the table down in a language, with the user's names, a test vector that the core computed,
and a program that runs it.
"""

from __future__ import annotations

from pathlib import Path

from hgo_rs.errors import HgoError, check_choice, check_integer, check_number
from hgo_rs.exports.names import check_name
from hgo_rs.exports.program import PERIODS, program
from hgo_rs.exports.vector import Log
from hgo_rs.files import write_text
from hgo_rs.observers import Observer

__all__ = ["LANGUAGES", "PERIODS", "export", "sources"]

LANGUAGES = ("c", "rust")


def export(
    observer: Observer,
    *,
    to: str,
    out: str | Path,
    name: str = "observer",
    precision: str = "double",
    dt: float | None = None,
    periods: int = PERIODS,
    log: Log | None = None,
) -> list[Path]:
    """Write an observer as a self-contained program; return the files.

    Its step gives the bits of `step` in Python. It begins at the observer's memory of now.

    Parameters
    ----------
    observer : Observer
    to : "c" or "rust"
        C99 (a header, a source, a Makefile), or a Rust crate without `std` and dependencies.
    out : path
        Folder to write to; made where it is missing. Files of the same names are replaced.
    name : str
        What functions and files are called: a lower-case identifier.
    precision : "double" or "single"
    dt : float, optional
        Sampling period [s]. A low-power or peaking-free law under zoh or bilinear needs it: its
        source holds the gains of corrections that are for 1, 2, ... periods, and takes no sample
        after another time. Other laws: for the comments and the test vector alone.
    periods : int
        For how many of them at most: 1 to 256.
    log : (t, y, u), optional
        What the test vector is computed from: (N,), (N, n_y), (N, n_u). Default: 101 samples made
        up, with a gap and steps of several lengths.

    Raises
    ------
    HgoError
        An unknown language or precision, a name that is no identifier, a missing `dt`, a law that
        is no table of operations, a folder that cannot be written.
    """
    texts = sources(
        observer, to=to, name=name, precision=precision, dt=dt, periods=periods, log=log
    )
    folder = Path(out)
    written = []
    try:
        for file, text in texts.items():
            path = folder / file
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(path, text)
            written.append(path)
    except OSError as error:
        told = f" (written before: {', '.join(file.name for file in written)})" if written else ""
        raise HgoError(
            f"out = {str(out)!r}: cannot be written ({error}){told}; give a folder"
        ) from None
    return written


def sources(
    observer: Observer,
    *,
    to: str,
    name: str = "observer",
    precision: str = "double",
    dt: float | None = None,
    periods: int = PERIODS,
    log: Log | None = None,
) -> dict[str, str]:
    """The files of `export` as texts, by their names."""
    check_choice("to", to, LANGUAGES)
    check_choice("precision", precision, ("double", "single"))
    check_name(name)
    if dt is not None:
        check_number(dt, "dt", above=0.0)
    check_integer(periods, "periods", least=1, most=256)
    described = program(observer, name=name, precision=precision, dt=dt, periods=periods, log=log)
    if to == "c":
        from hgo_rs.exports.c import files
    else:
        from hgo_rs.exports.rust import files
    return files(described)
