"""Recorded logs in.

`read_log` reads CSV, `.npz`, `.mat`, Parquet and Feather, and by the libraries of the extra `logs`
ROS bags, MCAP, ULog, HDF5, TDMS, MDF and Excel; `read_chunks` reads CSV, Parquet and Feather piece
by piece, in constant memory. CSV and `.npz` need NumPy alone, `.mat` needs SciPy, Parquet and
Feather need pyarrow (the extras `data` and `logs`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np

from hgo_rs.errors import nearest
from hgo_rs.logs.clock import Clock
from hgo_rs.logs.columns import Conversion, Converted
from hgo_rs.logs.formats import clocks_of, is_bag_folder, tables
from hgo_rs.logs.log import Log, LogSummary
from hgo_rs.logs.merged import merged
from hgo_rs.logs.parts import timed
from hgo_rs.logs.streams import STDIN, suffix_of
from hgo_rs.logs.table import (
    CHUNK,
    READABLE,
    Columns,
    DataError,
    by_name,
    names_of,
    refuse,
    siblings,
    values_of,
)
from hgo_rs.logs.text import TEXT
from hgo_rs.observers import StochasticApproximation


def read_log(
    path: str | Path,
    time: Columns | None,
    output: Columns,
    input: Columns | None = None,
    *,
    dt: float | None = None,
    unit: str | Sequence[str] | None = None,
    resets: str = "refuse",
    unwrap: Conversion | None = None,
    scale: Conversion | None = None,
    offset: Conversion | None = None,
    schedule: StochasticApproximation | None = None,
) -> Log:
    """Read a time column, output columns and, if named, input columns.

    A CSV file may have a header or none (its columns are then named 0, 1, 2, ...), be separated by
    tabs, semicolons, commas, bars or blanks, and hold comment lines (#, %, //). What stands above
    the header is passed over; names may stand in a comment, units below the header. A first line of
    whole numbers is a header where the lines after it are written, or go on, otherwise; it is
    refused where it could be either. Numbers have decimal points or, not between commas, decimal
    commas. Times may be dates (2024-03-05T09:07:03.25+01:00) or times of day. Text is UTF-8, UTF-16
    or, where it is neither, cp1252; it may be packed by gzip. `path` = "-" is standard input. A 2-D
    variable `q` of an `.npz` or `.mat` file has the columns `q[0]`, `q[1]`, ...

    Parameters
    ----------
    path
        The file; its suffix says the format.
    time, output, input
        Column names; a list for several outputs or inputs. `time` may be None if `dt` or `schedule`
        is given, or if the file says which clock a signal has (bags, ULog, MDF, waveforms in TDMS):
        every signal is then taken with its own; "secs+nsecs" and "date+time" are the sum of two
        columns. A list of times, one for each output (and, if you like, one for each input after
        them), says that they were sampled at times of their own: the log then has a row for every
        time at which there is a sample, NaN where an output has none, and inputs held.
    dt
        Sampling period, s. With `time` too, the recorded times only have to agree with it (to half
        a period, or to the resolution of times that are repeated since they are coarse), and exact
        multiples of `dt` take their place.
    unit
        Unit of the time column: s, ms, us, ns, min, h or d; a list for several time columns.
        Default: what the column's name says (`t_ms`, `time [us]`, `TimeUS`, `millis`), the unit
        that makes it a Unix time of our days, else s where the steps can be seconds.
    resets : "refuse" or "split"
        What a clock that starts again means: an error, or a new piece of the log.
    unwrap, scale, offset
        A number for some of the outputs and inputs, by their columns. `unwrap`: the turn after
        which a column begins again, in its own unit; each sample is taken in the turn nearest to
        the sample before it. Then value = scale * column + offset.
    schedule
        Sample k was taken after the first k steps of this schedule, in place of `time` and `dt`.

    Raises
    ------
    DataError
        Unreadable or malformed file, unknown column, time that does not increase, is missing or
        of a unit that cannot be, an infinite output, a missing or infinite input. Names file, line
        and remedy.
    """
    chunks = list(
        read_chunks(
            path,
            time,
            output,
            input,
            dt=dt,
            unit=unit,
            resets=resets,
            unwrap=unwrap,
            scale=scale,
            offset=offset,
            schedule=schedule,
        )
    )
    if len(chunks) == 1:
        return chunks[0]
    first, before, starts = chunks[0], 0, []
    for chunk in chunks:
        starts += [before + k for k in chunk.starts]
        before += len(chunk.t)
    return Log(
        np.concatenate([c.t for c in chunks]),
        np.concatenate([c.y for c in chunks]),
        None if first.u is None else np.concatenate([c.u for c in chunks if c.u is not None]),
        first.names,
        first.source,
        np.concatenate([c.missing for c in chunks]),
        tuple(starts),
        chunks[-1].remarks,
        first.assumed,
    )


def read_chunks(
    path: str | Path,
    time: Columns | None,
    output: Columns,
    input: Columns | None = None,
    *,
    dt: float | None = None,
    unit: str | Sequence[str] | None = None,
    resets: str = "refuse",
    unwrap: Conversion | None = None,
    scale: Conversion | None = None,
    offset: Conversion | None = None,
    schedule: StochasticApproximation | None = None,
    rows: int | None = None,
) -> Iterator[Log]:
    """The log of `read_log` in chunks of about `rows` rows (default 65536), in constant memory.

    A chunk goes on where the one before ended, unless its `starts` hold 0. An `.npz` or `.mat`
    file, and outputs with times of their own, are one chunk. What is wrong with the whole log
    (fewer than two samples, an output without any, a usual step that no unit makes) is raised after
    the last chunk.
    """
    path = Path(path)
    output, input = by_name(output), by_name(input)
    outputs = names_of(output, "output")
    inputs = [] if input is None else names_of(input, "input")
    if time is None and dt is None and schedule is None:
        check_file(path)
        own = clocks_of(path, [*outputs, *inputs])
        if own is not None:
            time = own[0] if len(set(own)) == 1 else own
    several = time is not None and not isinstance(time, (str, int))
    clocks: Any = by_name(time)
    if unit is not None and not isinstance(unit, str) and len(unit) == 1:
        (unit,) = unit
    one = None if several else cast("str | None", unit)
    clock = Clock(path, clocks, dt, one, resets, schedule)
    check_file(path)
    converted = Converted([*outputs, *inputs], unwrap, scale, offset)
    if several:
        if dt is not None or resets == "split":
            raise DataError("time: several columns go without dt and resets; leave these out")
        yield merged(path, clocks, output, input, unit, converted)
        return
    names = {"time": clocks, "output": output, "input": input}
    wanted = [*([] if time is None else [clocks]), *outputs, *inputs]
    summary = LogSummary()
    many = CHUNK if rows is None else rows
    found = tables(path, wanted, many) if time is None else timed(path, clocks, wanted[1:], many)
    for table in filter(len, found):
        t, starts = clock(table)
        signals = {name: values_of(table, path, name) for name in [*outputs, *inputs]}
        for name in outputs:
            told = f"{name!r} is infinite; leave a missing sample empty"
            refuse(table, path, np.isinf(signals[name]), told)
        for name in inputs:
            told = f"the input {name!r} is missing or infinite; fill it in"
            refuse(table, path, ~np.isfinite(signals[name]), told)
        signals = {name: converted(name, column, starts) for name, column in signals.items()}
        y = np.column_stack([signals[name] for name in outputs])
        u = np.column_stack([signals[name] for name in inputs]) if inputs else None
        y = y[:, 0] if isinstance(output, str) else y
        u = u[:, 0] if u is not None and isinstance(input, str) else u
        remarks = table.remarks + clock.remarks
        log = Log(t, y, u, names, str(path), np.isnan(y), starts, remarks, clock.assumed)
        summary.add(log)
        yield log
    if summary.count < 2:
        raise DataError(f"{path}: {summary.count} samples; an observer needs at least 2")
    clock.finish()
    for name in summary.empty_channels:
        raise DataError(f"{path}: column {name!r} holds no sample")


_REMEDIES = {
    **dict.fromkeys((".bz2", ".xz", ".zip", ".zst", ".7z", ".tar", ".tgz"), "unpack it"),
    **dict.fromkeys((".xls", ".ods"), "save it as .xlsx or .csv"),
    **dict.fromkeys((".json", ".jsonl"), "write it as CSV, for example by pandas"),
}
"""What to do about a file of another format."""


def check_file(path: Path) -> None:
    """Refuse what is not there, is no file of known format, or might never end."""
    if path == STDIN:
        return
    try:
        there, folder, regular = path.exists(), path.is_dir(), path.is_file()
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}") from error
    if not there:
        near = nearest(path.name, siblings(path))
        raise DataError(f"no file {path}" + (f"; nearest: {', '.join(near)}" if near else ""))
    if is_bag_folder(path):
        return
    if folder:
        raise DataError(f"{path} is a folder; name a file ({', '.join(READABLE)})")
    suffix = suffix_of(path)
    if suffix not in READABLE or (path.suffix.lower() == ".gz" and suffix not in TEXT):
        suffix = "".join(path.suffixes[-2:] if path.suffix.lower() == ".gz" else [suffix])
        remedy = _REMEDIES.get(suffix, "text may be called .txt")
        raise DataError(
            f"{path}: unknown format {suffix!r}; {remedy}. Known: {', '.join(READABLE)}"
        )
    if not regular:
        raise DataError(
            f"{path} is a pipe or a device, which may have no end; write what it gives to a file, "
            "or hand it on standard input as -"
        )
