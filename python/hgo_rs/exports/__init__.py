"""An observer as source code: C99, or Rust without `std`; self-contained, readable, the same bits.
Or around that C: an Arduino library, or an FMU, a unit for co-simulation.

The core traces one step of an observer into a table (every operation, in its order); this package
writes the table down in a language, with the user's names, a test vector that the core computed,
and a program that runs it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from hgo_rs.errors import HgoError, check, check_choice, check_integer, check_path
from hgo_rs.exports.names import check_name
from hgo_rs.exports.program import PERIODS, period_of, program
from hgo_rs.exports.vector import Log
from hgo_rs.files import write_bytes
from hgo_rs.observers import Observer
from hgo_rs.times import check_period

__all__ = ["FMI", "LANGUAGES", "PERIODS", "export", "sources"]

LANGUAGES = ("c", "rust", "arduino", "fmu")
FMI = ("2.0", "3.0")
"""Versions of FMUs."""


def export(
    observer: Observer,
    *,
    to: str,
    out: str | Path,
    name: str = "observer",
    precision: str | None = None,
    dt: float | None = None,
    periods: int = PERIODS,
    log: Log | None = None,
    version: str | None = None,
    units: Mapping[str, str] | None = None,
    fixed_dt: float | None = None,
) -> list[Path]:
    """Write an observer as a self-contained program; return the files.

    Its step gives the bits of `step` in Python. It begins at the observer's present memory.

    Parameters
    ----------
    observer : Observer
    to : "c", "rust", "arduino" or "fmu"
        C99 (a header, a source, a Makefile); a Rust crate without `std` and dependencies; an
        Arduino library, for PlatformIO too (the C, manifests, a sketch); or a functional mock-up
        unit for co-simulation, which Simulink, Modelica tools and others take: the C, FMI's
        functions around it, and the binary of this computer if it has a C compiler.
    out : path
        Folder to write to, created if missing. Files of the same names are replaced. An FMU is the
        file NAME.fmu in it, or `out` itself where that ends in .fmu.
    name : str
        Name of functions and files: a lower-case identifier. An Arduino library adds the prefix
        `hgo_`.
    precision : "double" or "single", optional
        Default: double; single for Arduino, whose boards of AVR have no other.
    dt : float, optional
        Sampling period [s]. A low-power or peaking-free law under zoh, bilinear or implicit-map
        needs it: its code has a table of gains for intervals of 1, 2, ... periods and uses no
        sample after another interval. For other laws only comments, test vector and sketch use it;
        default 10 ms, or half of the step limit.
    periods : int
        Number of rows of that table: 1 to 256.
    log : (t, y, u), optional
        Record of the test vector: (N,), (N, n_y), (N, n_u). Default: 101 synthetic samples with a
        gap and steps of several lengths.
    version : "2.0" or "3.0", optional
        FMI version of an FMU. Default: 2.0.
    units : dict, optional
        Name of a state, input, parameter or sample (`y`, or `y1`, `y2`, ...) -> its unit, such as
        "rad/s" or "N*m", for an FMU.
    fixed_dt : float, optional
        Sampling period [s] of a loop that has one: gains become constants, and no function takes
        `dt`.

    Raises
    ------
    HgoError
        An unknown language or precision, a name that is no identifier, a missing `dt`, a
        `fixed_dt` that is no period or beside another `dt`, a log at other times, a law that is no
        table of operations, a folder that cannot be written; `version` or `units` of what is no
        FMU, or a unit of an unknown name.
    DesignError
        A `fixed_dt` at or beyond the limit of a stable step, as in `run`.

    Warns
    -----
    UserWarning
        An FMU without a binary, because there is no C compiler here.
    """
    texts = sources(
        observer,
        to=to,
        name=name,
        precision=precision,
        dt=dt,
        periods=periods,
        log=log,
        version=version,
        units=units,
        fixed_dt=fixed_dt,
    )
    folder = check_path(out, "out")
    contents = {file: text.encode() for file, text in texts.items()}
    if to == "fmu":
        from hgo_rs.exports.fmu import archive

        file = f"{name}.fmu"
        if folder.suffix == ".fmu":
            folder, file = folder.parent, folder.name
        contents = {file: archive(texts, name)}
    written = []
    try:
        for file, content in contents.items():
            path = folder / file
            path.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(path, content)
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
    precision: str | None = None,
    dt: float | None = None,
    periods: int = PERIODS,
    log: Log | None = None,
    version: str | None = None,
    units: Mapping[str, str] | None = None,
    fixed_dt: float | None = None,
) -> dict[str, str]:
    """The files of `export` as texts, by their names; of an FMU, the texts in it."""
    remedy = "give a StandardObserver, for example"
    check(isinstance(observer, Observer), "observer", observer, "an observer", remedy)
    check_choice("to", to, LANGUAGES)
    for word, value in (("version", version), ("units", units)):
        if value is not None and to != "fmu":
            raise HgoError(f'{word} = {value!r}: only for to="fmu"; leave {word} out')
    if version is not None:
        check_choice("version", version, FMI)
    arduino = to == "arduino"
    precision = ("single" if arduino else "double") if precision is None else precision
    check_choice("precision", precision, ("double", "single"))
    check_name(name)
    if dt is not None:
        dt = check_period(dt)
    check_integer(periods, "periods", least=1, most=256)
    if arduino:
        from hgo_rs.exports.arduino import library, name_of

        name = name_of(name)
    described = program(
        observer,
        name=name,
        precision=precision,
        dt=dt,
        periods=periods,
        log=log,
        fixed_dt=fixed_dt,
    )
    if arduino:
        period = fixed_dt or dt or min(0.01, 5.0 * period_of(observer))
        return library(described, observer.n, period)
    if to == "fmu":
        from hgo_rs.exports import fmu

        return fmu.files(observer, described, version or "2.0", dt, units)
    if to == "c":
        from hgo_rs.exports.c import files
    else:
        from hgo_rs.exports.rust import files
    return files(described)
