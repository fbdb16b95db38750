"""Recorded logs in, estimates out.

`read_log` reads CSV, `.npz`, `.mat` and Parquet; `read_chunks` reads CSV and Parquet piece by
piece, in constant memory; `write_table` and `TableWriter` write CSV and Parquet. CSV and `.npz`
need NumPy alone, `.mat` needs SciPy, Parquet needs pyarrow (the extra `data`).
"""

from __future__ import annotations

import contextlib
import csv
import difflib
import io
import itertools
import math
import re
import zipfile
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import IO, TYPE_CHECKING, Any, NoReturn, cast

import numpy as np

from hgo_rs.errors import HgoError, MissingExtraError, check_choice, check_number, printable
from hgo_rs.files import replacing
from hgo_rs.times import (
    COUNTED,
    FARTHEST,
    FAST,
    LONGEST,
    SLOW,
    SLOWEST,
    UNITS,
    Ticks,
    likely,
    named_unit,
    span,
    ticks,
    unix_days,
    unix_unit,
    wrapped,
)

if TYPE_CHECKING:
    from hgo_rs.gains import StochasticApproximation

__all__ = [
    "READABLE",
    "WRITABLE",
    "DataError",
    "Log",
    "LogSummary",
    "TableWriter",
    "read_chunks",
    "read_log",
    "write_table",
]

READABLE = (".csv", ".txt", ".tsv", ".dat", ".npz", ".mat", ".parquet", ".pq")
WRITABLE = (".csv", ".parquet", ".pq")
CHUNK = 65_536
"""Rows of a chunk."""
LINE = 2**20
"""Characters of the longest line that is read."""
BLOCK = 2**26
"""Characters of text that are held at a time, beside one line."""

_TEXT = (".csv", ".txt", ".tsv", ".dat")
_PARQUET = (".parquet", ".pq")
_EXACT = 2.0**53
"""Integers from here on are not all float64 numbers."""
_MISSING = frozenset({"", "nan", "na", "n/a", "null", "none"})

Columns = str | Sequence[str]


class DataError(HgoError):
    """A log that cannot be read as asked: names the file, the line and the remedy."""


@dataclass(frozen=True)
class Log:
    """A recorded log, or a chunk of one.

    Attributes
    ----------
    t : (N,) float, s
        Sample times, strictly increasing within a piece, steps as recorded.
    y : (N,) or (N, n_y) float
        Measured output, or outputs; NaN where a sample is missing.
    u : (N,), (N, n_u) float or None
        Known inputs.
    names : dict
        Column names: "time" (None if the time comes from `dt` or a schedule), "output", "input":
        one name, or a list.
    source : str
        The file.
    missing : as y, bool
        Where a sample is missing.
    starts : tuple of int
        Where a piece begins: 0, and each reset of the clock.
    remarks : tuple of str
        What was found out about the log and not asked for, such as the unit of its times.
    assumed : bool
        Whether the unit of its times is a guess: neither given, nor said by the column's name.
    """

    t: np.ndarray
    y: np.ndarray
    u: np.ndarray | None
    names: dict[str, Any]
    source: str
    missing: np.ndarray
    starts: tuple[int, ...] = (0,)
    remarks: tuple[str, ...] = ()
    assumed: bool = False

    @property
    def pieces(self) -> list[Log]:
        """A log for each piece between resets of the clock."""
        edges = [0, *(k for k in self.starts if k > 0), len(self.t)]
        return [self.rows(slice(a, b)) for a, b in itertools.pairwise(edges)]

    def rows(self, rows: slice) -> Log:
        """Some rows, as a log of one piece."""
        u = None if self.u is None else self.u[rows]
        t, y, missing = self.t[rows], self.y[rows], self.missing[rows]
        return Log(t, y, u, self.names, self.source, missing, (0,), self.remarks, self.assumed)

    @property
    def longest_gap(self) -> tuple[int, int]:
        """The longest run of rows without any sample, as a half-open range of indices; (0, 0):
        none.
        """
        starts, stops = _runs(np.all(self.missing.reshape(len(self.t), -1), axis=1))
        if not len(starts):
            return 0, 0
        i = int(np.argmax(stops - starts))
        return int(starts[i]), int(stops[i])

    def describe(self) -> str:
        """Samples, span, missing samples and remarks, in some lines."""
        summary = LogSummary()
        summary.add(self)
        return summary.describe()


def _runs(holds: Any) -> tuple[np.ndarray, np.ndarray]:
    """First and one-past-last indices of every run of True."""
    edges = np.flatnonzero(np.diff(np.r_[0, holds, 0]))
    return edges[::2], edges[1::2]


class LogSummary:
    """Samples, span and missing samples of a log that is seen chunk by chunk."""

    def __init__(self) -> None:
        self.count = 0
        self.pieces = 0
        self._span = (math.nan, math.nan)
        self._typical = math.nan
        self._longest = (0.0, math.nan)
        self._channels: list[_Missing] = []
        self._remarks: dict[str, None] = {}

    def add(self, log: Log) -> None:
        """Take in the next chunk."""
        self._remarks.update(dict.fromkeys(log.remarks))
        last = self._span[1]
        steps = np.diff(log.t, prepend=log.t[:1] if self.count == 0 else last)
        steps[list(log.starts)] = 0.0  # over a reset there is none
        if self.count == 0:
            self._span = (float(log.t[0]), last)
            outputs = log.names["output"]
            names = [outputs] if isinstance(outputs, str) else list(outputs)
            self._channels = [_Missing(name) for name in names]
            within = steps[steps > 0.0]
            self._typical = float(np.median(within)) if len(within) else math.nan
        self.pieces += len(log.starts)
        k = int(np.argmax(steps))
        if steps[k] > self._longest[0]:
            before = last if k == 0 else float(log.t[k - 1])
            self._longest = (float(steps[k]), before)
        for channel, none in zip(
            self._channels, log.missing.reshape(len(log.t), -1).T, strict=True
        ):
            channel.add(none, log.t)
        self._span = (self._span[0], float(log.t[-1]))
        self.count += len(log.t)

    @property
    def empty_channels(self) -> list[str]:
        """The outputs that hold no sample at all."""
        return [c.name for c in self._channels if c.count == self.count]

    def describe(self) -> str:
        """What was seen, in some lines."""
        text = (
            f"{self.count} samples from {self._span[0]:.10g} s to {self._span[1]:.10g} s, "
            f"median step {self._typical:.6g} s"
        )
        step, at = self._longest
        if step > 1.5 * self._typical:
            text += f", longest step {step:.6g} s at t = {at:.10g} s"
        if self.pieces > 1:
            text += f", {self.pieces} pieces between resets of the clock"
        several = len(self._channels) > 1
        for channel in self._channels:
            if channel.count:
                name = f"{printable(channel.name)}: " if several else ""
                text += f"\n{name}{channel.describe()}"
        return "\n".join([text, *self._remarks])


class _Missing:
    """The missing samples of one output."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.count = 0
        self._open = (0, math.nan)  # the run that the last chunk ended in: length, begin
        self._longest = (0, math.nan, math.nan)

    def add(self, none: np.ndarray, t: np.ndarray) -> None:
        self.count += int(none.sum())
        starts, stops = _runs(none)
        carried, begin = self._open
        self._open = (0, math.nan)
        for a, b in zip(starts.tolist(), stops.tolist(), strict=True):
            joined = a == 0 and carried > 0
            length = b - a + (carried if joined else 0)
            first = begin if joined else float(t[a])
            if length > self._longest[0]:
                self._longest = (length, first, float(t[b - 1]))
            if b == len(t):
                self._open = (length, first)

    def describe(self) -> str:
        length, first, last = self._longest
        return (
            f"{self.count} missing sample{'s' if self.count > 1 else ''}; the longest gap has "
            f"{length}, from t = {first:.10g} s to {last:.10g} s"
        )


def read_log(
    path: str | Path,
    time: Columns | None,
    output: Columns,
    input: Columns | None = None,
    *,
    dt: float | None = None,
    unit: str | Sequence[str] | None = None,
    resets: str = "refuse",
    schedule: StochasticApproximation | None = None,
) -> Log:
    """Read a time column, output columns and, if named, input columns.

    A CSV file may have a header or none (its columns are then named 0, 1, 2, ...), be separated by
    tabs, semicolons, commas or blanks, and hold comment lines (#). A first line of whole numbers is
    a header where the lines after it are written, or go on, otherwise; it is refused where it could
    be either. A 2-D variable `q` of an `.npz` or `.mat` file has the columns `q[0]`, `q[1]`, ...

    Parameters
    ----------
    path
        The file; its suffix says the format.
    time, output, input
        Column names; a list for several outputs or inputs. `time` may be None if `dt` or `schedule`
        is given. A list of times, one for each output (and, if you like, one for each input after
        them), says that they were sampled at times of their own: the log then has a row for every
        time at which there is a sample, NaN where an output has none, and inputs held.
    dt
        Sampling period, s. With `time` too, the recorded times only have to agree with it (to half
        a period), and exact multiples of `dt` take their place.
    unit
        Unit of the time column: s, ms, us, ns, min, h or d; a list for several time columns.
        Default: what the column's name says (`t_ms`, `time [us]`, `TimeUS`, `millis`), the unit
        that makes it a Unix time of our days, else s where the steps can be seconds.
    resets : "refuse" or "split"
        What a clock that starts again means: an error, or a new piece of the log.
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
        read_chunks(path, time, output, input, dt=dt, unit=unit, resets=resets, schedule=schedule)
    )
    if len(chunks) == 1:
        return chunks[0]
    first, offset, starts = chunks[0], 0, []
    for chunk in chunks:
        starts += [offset + k for k in chunk.starts]
        offset += len(chunk.t)
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
    if unit is not None and not isinstance(unit, str) and len(unit) == 1:
        (unit,) = unit
    several = time is not None and not isinstance(time, str)
    one = None if several else cast("str | None", unit)
    clock = _Clock(path, time, dt, one, resets, schedule)
    _check_file(path)
    outputs = _names(output, "output")
    inputs = [] if input is None else _names(input, "input")
    if time is not None and not isinstance(time, str):
        if dt is not None or resets == "split":
            raise DataError("time: several columns go without dt and resets; leave these out")
        yield _merged(path, list(time), output, input, unit)
        return
    names = {"time": time, "output": output, "input": input}
    wanted = [*([] if time is None else [time]), *outputs, *inputs]
    summary = LogSummary()
    for table in filter(len, _tables(path, wanted, CHUNK if rows is None else rows)):
        t, starts = clock(table)
        y = np.column_stack([_values(table, path, name) for name in outputs])
        for name, column in zip(outputs, y.T, strict=True):
            told = f"{name!r} is infinite; leave a missing sample empty"
            _refuse(table, path, np.isinf(column), told)
        u = np.column_stack([_values(table, path, name) for name in inputs]) if inputs else None
        for name, column in zip(inputs, () if u is None else u.T, strict=True):
            told = f"the input {name!r} is missing or infinite; fill it in"
            _refuse(table, path, ~np.isfinite(column), told)
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


def _check_file(path: Path) -> None:
    """Refuse what is not there, is no file of known format, or might never end."""
    try:
        there, folder, regular = path.exists(), path.is_dir(), path.is_file()
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}") from error
    if not there:
        near = _nearest(path.name, _siblings(path))
        raise DataError(f"no file {path}" + (f"; nearest: {', '.join(near)}" if near else ""))
    if folder:
        raise DataError(f"{path} is a folder; name a file ({', '.join(READABLE)})")
    if path.suffix.lower() not in READABLE:
        suffix = path.suffix.lower()
        raise DataError(f"{path}: unknown format {suffix!r}; known: {', '.join(READABLE)}")
    if not regular:
        raise DataError(
            f"{path} is a pipe or a device, which may have no end; write what it gives to a file"
        )


class TableWriter:
    """Writes columns chunk by chunk as CSV (NaN: empty cell) or Parquet, as the suffix says.

    A context manager: the file takes its name when the block ends well; a block that fails leaves
    nothing behind. With `into`, an open binary file, rows are written there, and `path` says the
    format alone.
    """

    def __init__(self, path: str | Path, into: IO[bytes] | None = None) -> None:
        self.path = Path(path)
        check_writable_format(self.path)
        self._into = into
        self._file = contextlib.ExitStack()
        self._text: io.TextIOWrapper | None = None
        self._parquet: Any = None

    def __enter__(self) -> TableWriter:
        return self

    def write(self, columns: Mapping[str, np.ndarray]) -> None:
        """Append rows; the first call says the columns."""
        try:
            if self.path.suffix.lower() in _PARQUET:
                self._write_parquet(columns)
            else:
                self._write_text(columns)
        except OSError as error:
            raise self._refused(error) from error

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._file.__exit__(kind, error, trace)
        except OSError as failure:
            raise self._refused(failure) from failure
        if kind is None and self._text is None and self._parquet is None:
            raise DataError(f"cannot write {self.path}: no columns were given; call write before")

    def _refused(self, error: OSError) -> DataError:
        return DataError(f"cannot write {self.path}: {error.strerror or error}")

    def _place(self) -> contextlib.AbstractContextManager[IO[bytes]]:
        return replacing(self.path) if self._into is None else contextlib.nullcontext(self._into)

    def _write_text(self, columns: Mapping[str, np.ndarray]) -> None:
        if self._text is None:
            file = self._file.enter_context(self._place())
            self._text = io.TextIOWrapper(file, newline="", encoding="utf-8")
            self._file.push(self._end_text)
            csv.writer(self._text, lineterminator="\n").writerow(columns)
        cells = [
            map(repr, column.tolist())
            if column.dtype.kind != "f" or not np.isnan(column).any()
            else ["" if v != v else repr(v) for v in column.tolist()]
            for column in columns.values()
        ]
        self._text.writelines(map("{}\n".format, map(",".join, zip(*cells, strict=True))))

    def _end_text(self, kind: type[BaseException] | None, *_: object) -> None:
        """Hand on what waits; of a file that is given up its failure says no more."""
        with contextlib.suppress(*((OSError,) if kind else ())):
            cast("io.TextIOWrapper", self._text).detach()

    def _write_parquet(self, columns: Mapping[str, np.ndarray]) -> None:
        import pyarrow
        import pyarrow.parquet

        table = pyarrow.table(dict(columns))
        if self._parquet is None:
            file = self._file.enter_context(self._place())
            writer = pyarrow.parquet.ParquetWriter(file, table.schema)
            self._parquet = self._file.enter_context(writer)
        self._parquet.write_table(table)


def write_table(path: str | Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns of equal length as CSV (NaN: empty cell) or Parquet, as the suffix says.

    Raises
    ------
    DataError
        Unknown suffix, or the file cannot be written.
    MissingExtraError
        Parquet without pyarrow.
    """
    with TableWriter(path) as writer:
        writer.write(columns)


def check_writable_format(path: Path) -> None:
    """Refuse what `write_table` could not write, before any work is done for it."""
    suffix = path.suffix.lower()
    if suffix not in WRITABLE:
        raise DataError(f"{path}: unknown format {suffix!r}; known: {', '.join(WRITABLE)}")
    if suffix in _PARQUET:
        _need_pyarrow(path)


# --- time ------------------------------------------------------------------------------------

WINDOW = 1000
"""Steps whose median is looked at, all along a log, however it is cut into chunks."""


class _Clock:
    """Times in seconds, block by block; it remembers where the block before ended."""

    def __init__(
        self,
        path: Path,
        time: Columns | None,
        dt: float | None,
        unit: str | None,
        resets: str,
        schedule: StochasticApproximation | None,
    ) -> None:
        if dt is not None:
            dt = check_number(dt, "dt", above=0.0, error=DataError)
        if schedule is not None and (time is not None or dt is not None):
            raise DataError("schedule: give it alone, in place of the time column and dt")
        if time is None and dt is None and schedule is None:
            raise DataError("name the time column, or give dt for a log without one")
        if unit is not None:
            check_choice("unit", unit, tuple(UNITS))
            if time is None:
                raise DataError("unit: it is the time column's, and none is named")
        self.split = check_choice("resets", resets, ("refuse", "split")) == "split"
        self.path, self.time, self.dt, self.schedule = path, time, dt, schedule
        self.unit = unit
        self.assumed = False  # the unit is neither given nor said by the name
        self.remarks: tuple[str, ...] = ()
        self.length: Fraction | None = None  # of a tick [s]
        self.origin: Fraction | None = None  # what is subtracted [s]
        self._count = 0  # samples of the piece so far
        self._begin = math.nan  # of the piece
        self._pieces = 0
        self._rows = 0  # of the log
        self._last: tuple[float, str] | None = None
        self._next = 0.0  # of the schedule
        self._steps = np.empty(0)  # those that no window of `_check_steps` holds yet
        self._windows = 0
        self._first = math.nan  # of the log [s], from the recorded origin
        self._grain = 0.0  # what the recorded numbers resolve [s]
        self._sample, self._zero = 0, math.nan  # of the piece, where dt is given

    def __call__(self, table: _Table) -> tuple[np.ndarray, tuple[int, ...]]:
        """Times of the block, and where pieces begin in it."""
        if self.time is None:
            t = self._made(len(table))
            starts: tuple[int, ...] = () if self._count else (0,)
            self._count += len(table)
            return t, starts
        assert isinstance(self.time, str)
        found = self.ticks(table)
        self.learn(found, table)
        t = self.seconds(found)
        _refuse(table, self.path, ~np.isfinite(t), f"the time {self.time!r} is missing or infinite")
        starts = self._starts(t, table)
        if self.dt is not None:
            t = self._regular(t, starts, table)
        return t, starts

    def _made(self, count: int) -> np.ndarray:
        if self.schedule is None:
            assert self.dt is not None
            return self.dt * np.arange(self._count, self._count + count)
        law = self.schedule
        k = np.arange(self._count, self._count + count)
        steps = law.alpha * law.epsilon * (1.0 + k / law.k0) ** -law.p
        times = np.cumsum(np.r_[self._next, steps])
        self._next = float(times[-1])
        return np.asarray(times[:-1])

    # --- from ticks to seconds ------------------------------------------------------------------

    def ticks(self, table: _Table) -> Ticks:
        """The column as whole ticks."""
        assert isinstance(self.time, str)
        found = ticks(table.columns[self.time])
        if isinstance(found, str):
            raise DataError(f"{self.path}: column {self.time!r} {found}")
        return found

    def learn(self, found: Ticks, table: _Table) -> None:
        """The length of a tick, from the first block that has one."""
        if self.length is not None or found.missing.all():
            return
        assert isinstance(self.time, str)
        if found.length is not None:
            self.length = found.length
            if self.unit is not None:
                self.remarks += (f"times {self.time!r} have a unit of their own, not {self.unit}",)
                self.unit = None
        else:
            self.length = UNITS[self._found_unit(found)]
        self._first = float(found.first() * self.length)
        if found.length is None and abs(found.first() * self.length) >= FARTHEST:
            self._refuse_unit(
                f"the time {self.time!r} begins at {found.first()}, taken in {self.unit}: "
                f"{span(self._first)} from its origin"
            )
        values = table.columns[self.time]
        if values.dtype.kind == "f":
            there = np.abs(values[np.isfinite(values)])
            self._grain = float(np.spacing(there.max())) * float(self.length)

    def _found_unit(self, found: Ticks) -> str:
        assert isinstance(self.time, str)
        if self.unit is not None:
            named, _ = named_unit(self.time)
            if named not in (None, self.unit):
                told = f"times {self.time!r} are taken in {self.unit}, though the name says {named}"
                self.remarks += (told,)
        else:
            self.unit, why = named_unit(self.time)
            if why:
                raise DataError(
                    f"{self.path}: the unit of the time {self.time!r} cannot be told: {why}; say "
                    f"unit = one of {', '.join(UNITS)}, or give dt in place of the time"
                )
            if self.unit not in (None, "s"):
                self.remarks += (f"times {self.time!r} are in {self.unit}, as the name says",)
        if self.unit is None:
            self.assumed = True
            self.unit = unix_unit(found.first())
            if self.unit not in (None, "s"):
                self.remarks += (
                    f"times {self.time!r} are read as Unix times in {self.unit} (unit says "
                    "another)",
                )
        self.unit = self.unit or "s"
        return self.unit

    def begin(self, found: Ticks) -> tuple[Fraction, bool]:
        """The first time [s], exactly, and whether times must count from about there."""
        assert self.length is not None
        return found.first() * self.length, found.is_date or abs(found.first()) >= COUNTED

    def seconds(self, found: Ticks) -> np.ndarray:
        """Seconds, NaN where missing; they count from the origin, set with the first block."""
        if self.length is None:
            return np.full(len(found.whole), np.nan)
        if self.origin is None:
            first, needed = self.begin(found)
            self.origin = first if needed else Fraction(0)
            if needed:
                assert isinstance(self.time, str)
                moment = _moment(first, found, self)
                self.remarks += (f"t counts from {printable(self.time)} = {moment}",)
        return found.seconds(self.length, self.origin)

    # --- what cannot be -------------------------------------------------------------------------

    def _starts(self, t: np.ndarray, table: _Table) -> tuple[int, ...]:
        """Where pieces begin; refuses time that stands still or runs back."""
        starts = []
        if self._last is None:
            starts.append(0)
            self._begin = float(t[0])
            self._pieces = 1
        before = np.r_[t[:1] - 1.0 if self._last is None else self._last[0], t[:-1]]
        back = np.flatnonzero(t <= before).tolist()
        inner = np.diff(t)
        newest_first = len(inner) > 1 and bool(np.mean(inner < 0.0) > 0.75)
        usual = float(np.median(inner)) if len(inner) > 1 else math.inf
        since = -self._count  # where the piece began, in rows of this block
        for k in back:
            fell = before[k] - t[k]
            reset = t[k] - self._begin <= 0.1 * (before[k] - self._begin) and fell > 0.0
            reset = reset and k - since > 1 and not newest_first  # one row is no piece
            bits = self._wrapped(fell, usual)
            if not (reset and self.split):
                where = table.where(k - 1) if k else self._last[1] if self._last else ""
                raise DataError(
                    f"{self.path}, {table.where(k)}: time {t[k]:.12g} does not come after "
                    f"{before[k]:.12g} ({where}); {self._remedy(fell, bits, reset, newest_first)}"
                )
            if bits:
                self.remarks += (
                    f"{table.where(k)}: a counter of {bits} bits began again; the pieces of "
                    f"{self.time!r} have no origin in common",
                )
            starts.append(k)
            self._pieces += 1
            self._begin, since = float(t[k]), k
        self._count = len(t) - since
        self._rows += len(t)
        self._last = (float(t[-1]), table.where(len(t) - 1))
        steps = t - before
        steps[starts] = 0.0
        self._check_steps(steps, table)
        return tuple(starts)

    def _wrapped(self, fell: float, usual: float) -> int | None:
        """The bits of a counter that came to its end where the time fell."""
        ticks = float(self.length or 1)
        return wrapped(fell / ticks, usual / ticks) if 0.0 < usual < fell else None

    def _remedy(self, fell: float, bits: int | None, reset: bool, newest_first: bool) -> str:
        if newest_first:
            return "the log runs backwards, newest first: sort it by time"
        if bits:
            return (
                f"a counter of {bits} bits began again: make it run on, for example by "
                f"numpy.unwrap(column, period=2**{bits})"
            )
        if reset:
            return (
                "the clock was set back: cut the log there, or take it as pieces with "
                'resets = "split"'
            )
        if fell == 0.0:
            return "time must increase: remove repeated rows, or write times with all their digits"
        return "time must increase: sort the log or remove repeated rows"

    def _check_steps(self, steps: np.ndarray, table: _Table) -> None:
        """Refuse steps that no record has; 0 where a piece begins."""
        within = steps[steps > 0.0]
        if self._grain and len(within):
            usual = float(np.median(within))
            if self.dt is None and self._grain > 1e-2 * usual:
                self.remarks += (
                    f"times {self.time!r} resolve {self._grain:.3g} s only, beside a median step "
                    f"of {usual:.3g} s; dt in their place makes them exact",
                )
            self._grain = 0.0
        waiting = np.r_[self._steps, within]
        full = len(waiting) // WINDOW * WINDOW
        if full:
            medians = np.median(waiting[:full].reshape(-1, WINDOW), axis=1)
            self._check_median(float(medians.min()))
            self._check_median(float(medians.max()))
        self._steps = waiting[full:]
        self._windows += full // WINDOW
        k = int(np.argmax(steps))
        if steps[k] >= LONGEST:
            self._check_median(float(np.median(within)))
            other = f", or say a unit other than {self.unit}" if self.unit else ""
            raise DataError(
                f"{self.path}, {table.where(k)}: the time {self.time!r} leaps by "
                f"{span(steps[k])}, as if the clock were set; cut the log there{other}"
            )

    def _check_median(self, median: float) -> None:
        """Refuse a usual step that no record has, or that seconds nobody spoke of would make."""
        days = unix_days(self._first) if self.assumed and median < FAST else None
        if days:
            raise DataError(
                f"{self.path}: the times {self.time!r} begin at {self._first:.9g} with a median "
                f"step of {median:.3g}, a {days} date in days, taken in s; say unit = one of s, d"
            )
        if median < (SLOW if self.assumed else SLOWEST):
            return
        told = f"the median step of the time {self.time!r} is {span(median)}"
        if self.length is not None and self.unit is None:  # dates
            raise DataError(f"{self.path}: {told}; give dt in place of the time")
        self._refuse_unit(f"{told}, taken in {self.unit}", median)

    def _refuse_unit(self, told: str, step: float | None = None) -> NoReturn:
        if self.assumed:
            told += ", which neither unit nor the name says"
        guess = f"{likely(step / float(self.length))}; " if step and self.length else ""
        kept = "say unit = one of " + ", ".join(UNITS)
        if not self.assumed:
            kept = "say another unit, or give dt in place of the time"
        raise DataError(f"{self.path}: {told}; {guess}{kept}")

    def finish(self) -> None:
        """What is wrong with the whole log."""
        if self.time is None or self._last is None:
            return
        if len(self._steps) >= (WINDOW // 10 if self._windows else 1):
            self._check_median(float(np.median(self._steps)))
        if self._pieces > 1 and self._count < 2:
            raise DataError(
                f"{self.path}, {self._last[1]}: the last piece has 1 row, an observer needs at "
                "least 2; remove the row"
            )
        if self._pieces >= 10 and self._rows < 5 * self._pieces:
            raise DataError(
                f"{self.path}: {self._pieces} pieces of {self._rows / self._pieces:.3g} rows on "
                "average are no resets of a clock; sort the log by time"
            )

    def _regular(self, t: np.ndarray, starts: tuple[int, ...], table: _Table) -> np.ndarray:
        """Exact multiples of dt from the begin of each piece on."""
        assert self.dt is not None
        out = np.empty_like(t)
        edges = [*starts, len(t)] if 0 in starts else [0, *starts, len(t)]
        for a, b in itertools.pairwise(edges):
            if a in starts:
                self._sample, self._zero = 0, float(t[a])
            out[a:b] = self._zero + self.dt * np.arange(self._sample, self._sample + b - a)
            off = np.abs(t[a:b] - out[a:b]) > 0.5 * self.dt
            if off.any():
                k = a + int(np.argmax(off))
                raise DataError(
                    f"{self.path}, {table.where(k)}: time {t[k]:g} s is not sample "
                    f"{self._sample + k - a} of a record with dt = {self.dt:g} s ({out[k]:g} s); "
                    "leave dt out to honour uneven steps"
                    + (f", or say a unit other than {self.unit}" if self.assumed else "")
                )
            self._sample += b - a
        return out


def _moment(first: Fraction, found: Ticks, clock: _Clock) -> str:
    """A time as its column writes it."""
    assert clock.length is not None
    nanoseconds = math.floor(first / UNITS["ns"])
    if found.is_date and abs(nanoseconds) < 2**63:
        return str(np.datetime64(nanoseconds, "ns"))
    count = first / clock.length
    return str(count) if count.denominator == 1 else f"{float(count):.17g}"


def _merged(
    path: Path,
    times: list[str],
    output: Columns,
    input: Columns | None,
    unit: str | Sequence[str] | None,
) -> Log:
    """Outputs and inputs with times of their own, as one log."""
    outputs = _names(output, "output")
    inputs = [] if input is None else _names(input, "input")
    signals = [*outputs, *inputs]
    if unit is not None and not isinstance(unit, str) and len(unit) != len(times):
        raise DataError(f"unit: {len(unit)} for {len(times)} time columns; give one, or one each")
    told = dict(
        zip(times, [unit] * len(times) if isinstance(unit, str) else unit or (), strict=False)
    )
    if len(times) == len(outputs):
        times = times + times[:1] * len(inputs)
    if len(times) != len(signals):
        raise DataError(
            f"time: {len(times)} columns for {len(outputs)} outputs and {len(inputs)} inputs; name "
            "one, or one for each output (inputs then go with the first), or one for each of all"
        )
    table = _whole(path, [*times, *signals])
    parts: dict[str, tuple[_Clock, Ticks, np.ndarray]] = {}
    for name in dict.fromkeys(times):
        clock = _Clock(path, name, None, told.get(name), "refuse", None)
        found = clock.ticks(table)
        mine = [s for s, t in zip(signals, times, strict=True) if t == name]
        lengths = {len(table.columns[s]) for s in mine} | {len(found.whole)}
        if len(lengths) > 1:
            raise DataError(f"{path}: {', '.join([name, *mine])} differ in length")
        kept = ~found.missing
        kept |= ~np.all([np.isnan(_values(table, path, s)) for s in mine], axis=0)
        at = np.flatnonzero(kept)  # the rest pads the shorter columns
        if not len(at):
            raise DataError(f"{path}: column {name!r} holds no time")
        own = _Table({name: table.columns[name][at]}, _rows_at(table, at))
        clock.learn(clock.ticks(own), own)
        parts[name] = (clock, clock.ticks(own), at)
    origin = _common_origin([(clock, found) for clock, found, _ in parts.values()])
    clocks: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    remarks: tuple[str, ...] = table.remarks
    assumed = False
    for name, (clock, _, at) in parts.items():
        clock.origin = origin
        own = _Table({name: table.columns[name][at]}, _rows_at(table, at))
        clocks[name] = (clock(own)[0], at)
        clock.finish()
        remarks += clock.remarks
        assumed = assumed or clock.assumed
    if origin:
        clock, found, _ = parts[times[0]]
        remarks += (f"t counts from {printable(times[0])} = {_moment(origin, found, clock)}",)
    _check_together(
        path, {n: (clocks[n][0], parts[n][0].assumed) for n in parts}, set(times[: len(outputs)])
    )
    t = np.unique(np.concatenate([seconds for seconds, _ in clocks.values()]))
    t = t[np.diff(t, prepend=-math.inf) > 4.0 * np.spacing(np.abs(t))]  # one time, rounded apart
    row = {name: np.searchsorted(t, s, side="right") - 1 for name, (s, _) in clocks.items()}
    y = np.full((len(t), len(outputs)), np.nan)
    for j, (name, own_time) in enumerate(zip(outputs, times, strict=False)):
        at = clocks[own_time][1]
        values = _values(table, path, name)[at]
        own = _Table({}, _rows_at(table, at))
        _refuse(own, path, np.isinf(values), f"{name!r} is infinite; leave a missing sample empty")
        if np.isnan(values).all():
            raise DataError(f"{path}: column {name!r} holds no sample")
        y[row[own_time], j] = values
    u = np.empty((len(t), len(inputs)))
    for j, (name, own_time) in enumerate(zip(inputs, times[len(outputs) :], strict=True)):
        seconds, at = clocks[own_time]
        values = _values(table, path, name)[at]
        what = f"the input {name!r} is missing or infinite; fill it in"
        _refuse(_Table({}, _rows_at(table, at)), path, ~np.isfinite(values), what)
        held = np.searchsorted(row[own_time], np.arange(len(t)), side="right") - 1
        if held[0] < 0:
            raise DataError(
                f"{path}: the input {name!r} begins at {seconds[0]:g} s, after the first sample at "
                f"{t[0]:g} s; give it from the start, or cut the outputs before"
            )
        u[:, j] = values[held]
    if len(t) < 2:
        raise DataError(f"{path}: {len(t)} samples; an observer needs at least 2")
    names = {"time": times, "output": output, "input": input}
    shaped = y[:, 0] if isinstance(output, str) else y
    known = None if not inputs else u[:, 0] if isinstance(input, str) else u
    missing = np.isnan(shaped)
    return Log(t, shaped, known, names, str(path), missing, (0,), remarks, assumed)


def _common_origin(clocks: list[tuple[_Clock, Ticks]]) -> Fraction:
    """The one time [s] that all clocks count from: 0, or a tick of each about the first sample."""
    begins = [clock.begin(found) for clock, found in clocks if clock.length is not None]
    if not any(needed for _, needed in begins):
        return Fraction(0)
    coarsest = max(clock.length for clock, _ in clocks if clock.length is not None)
    return math.floor(min(first for first, _ in begins) / coarsest) * coarsest


def _check_together(
    path: Path, clocks: Mapping[str, tuple[np.ndarray, bool]], of_outputs: set[str]
) -> None:
    """Refuse clocks that have no origin, or no unit, in common."""
    (first, (a, _)), *others = clocks.items()
    for name, (b, _) in others:
        apart = max(b[0] - a[-1], a[0] - b[-1])
        spans = a[-1] - a[0], b[-1] - b[0]
        limit = max(sum(spans), 1.0) if {first, name} <= of_outputs else 86400.0
        if apart > max(limit, sum(spans)):
            raise DataError(
                f"{path}: the times {first!r} and {name!r} do not overlap, they lie "
                f"{span(apart)} apart; give both one origin and say each unit: unit = [...]"
            )
        if not (clocks[first][1] or clocks[name][1]) or min(len(a), len(b)) < 8:
            continue
        ratio = max(spans) / min(spans)
        if any(abs(ratio / scale - 1.0) < 0.1 for scale in (1e3, 1e6, 1e9)):
            raise DataError(
                f"{path}: the times {first!r} and {name!r} span {spans[0]:g} and {spans[1]:g} "
                "as if of different units; say each: unit = [...], one for each time column"
            )


# --- checks ----------------------------------------------------------------------------------


@dataclass
class _Table:
    """The wanted columns, where a sample stands in the file, and what was found out.

    Integers with missing cells are masked: as float64 they might lose digits.
    """

    columns: dict[str, np.ndarray]
    where: Callable[[int], str]
    remarks: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))


def _rows_at(table: _Table, at: np.ndarray) -> Callable[[int], str]:
    return lambda index: table.where(int(at[index]))


def _names(given: Columns, parameter: str) -> list[str]:
    names = [given] if isinstance(given, str) else list(given)
    if not names:
        raise DataError(f"{parameter}: no column is named; name one, or leave it out")
    return names


def _row(index: int) -> str:
    return f"row {index} (counted from 0)"


def _rows_from(first: int) -> Callable[[int], str]:
    return lambda index: _row(first + index)


def _refuse(table: _Table, path: Path, bad: np.ndarray, what: str) -> None:
    """Raise at the first sample where `bad` holds."""
    if bad.any():
        raise DataError(f"{path}, {table.where(int(np.argmax(bad)))}: {what}")


def _values(table: _Table, path: Path, name: str) -> np.ndarray:
    """A column as float64."""
    values = table.columns[name]
    if values.dtype.kind not in "fiub":
        raise DataError(f"{path}: column {name!r} holds {values.dtype}, not numbers")
    out = np.ascontiguousarray(np.ma.getdata(values), dtype=np.float64)
    if np.ma.isMaskedArray(values):
        out = np.where(np.ma.getmaskarray(values), np.nan, out)
    return out


def _require(path: Path, wanted: list[str], known: list[str], remark: str = "") -> None:
    """Every wanted column is there, once."""
    for name in wanted:
        if name not in known:
            near = _nearest(name, known)
            hint = f"; nearest: {', '.join(near)}" if near else ""
            shown = ", ".join(known[:20]) + (", ..." if len(known) > 20 else "")
            raise DataError(f"{path} has no column {name!r}{remark}{hint}. Columns: {shown}")
        if known.count(name) > 1:
            raise DataError(f"{path}: {known.count(name)} columns are called {name!r}; rename one")


def _nearest(name: str, known: list[str]) -> list[str]:
    """The nearest known names, whatever the case."""
    folded = {k.casefold(): k for k in reversed(known)}
    return [folded[k] for k in difflib.get_close_matches(name.casefold(), folded, n=3, cutoff=0.4)]


def _siblings(path: Path) -> list[str]:
    try:
        return sorted(p.name for p in path.parent.iterdir() if p.suffix.lower() in READABLE)
    except OSError:
        return []


# --- formats ---------------------------------------------------------------------------------


def _tables(path: Path, wanted: list[str], rows: int) -> Iterator[_Table]:
    """The wanted columns, in blocks of about so many rows where the format allows it."""
    suffix = path.suffix.lower()
    try:
        if suffix in _TEXT:
            yield from _read_text(path, wanted, rows)
        elif suffix in _PARQUET:
            yield from _read_parquet(path, wanted, rows)
        else:
            yield _same_length(path, _whole(path, wanted))
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}") from error


def _whole(path: Path, wanted: list[str]) -> _Table:
    """All of the wanted columns; those of `.npz` and `.mat` may differ in length."""
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return _read_npz(path, wanted)
    if suffix == ".mat":
        return _read_mat(path, wanted)
    blocks = list(_tables(path, wanted, CHUNK))
    if len(blocks) == 1:
        return blocks[0]
    if not blocks:
        raise DataError(f"{path}: 0 samples; an observer needs at least 2")
    columns = {n: _joined([b.columns[n] for b in blocks]) for n in blocks[0].columns}
    ends = np.cumsum([len(block) for block in blocks])

    def where(index: int) -> str:
        i = int(np.searchsorted(ends, index, side="right"))
        return blocks[i].where(index - (int(ends[i - 1]) if i else 0))

    return _Table(columns, where, blocks[0].remarks)


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    """Parts of one column; where some hold integers, whole numbers of the others become such."""
    if any(part.dtype.kind in "iu" for part in parts):
        parts = [_as_integers(part) for part in parts]
    masked = any(np.ma.isMaskedArray(part) for part in parts)
    return np.ma.concatenate(parts) if masked else np.concatenate(parts)


def _as_integers(values: np.ndarray) -> np.ndarray:
    """Whole float64 numbers as int64, masked where NaN; anything else as it is."""
    if values.dtype.kind != "f":
        return values
    gone = np.isnan(values)
    there = np.where(gone, 0.0, values)
    if not (np.all(np.abs(there) < 2.0**63) and np.all(there == np.trunc(there))):
        return values
    whole = there.astype(np.int64)
    return np.ma.array(whole, mask=gone) if gone.any() else whole


def _read_text(path: Path, wanted: list[str], rows: int) -> Iterator[_Table]:
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        lines = _lines(path, file)
        line, text = next(((n, t) for n, t in enumerate(lines, 1) if not _is_idle(t)), (0, ""))
        if not line:
            raise DataError(f"{path} is empty")
        delimiter = next((d for d in "\t;," if d in text), None)
        lines = itertools.chain([text], lines)
        taken: list[str] = []
        spied = (taken.append(text) or text for text in lines)  # type: ignore[func-returns-value]
        first, cells = next(_records(path, spied, delimiter, line))
        ahead = list(itertools.islice(lines, _AHEAD))
        lines = itertools.chain(ahead, lines)
        has_header, remarks = _header(path, first, cells, "".join(taken), ahead, delimiter)
        known = cells if has_header else [str(i) for i in range(len(cells))]
        remark = "" if has_header else " (no header: columns are named from 0)"
        _require(path, wanted, known, remark)
        at = {name: known.index(name) for name in wanted}
        if has_header:
            line += len(taken)
        else:
            lines = itertools.chain(taken, lines)
        head = "".join(taken).strip()
        while block := _block(lines, rows):
            if remarks and head in map(str.strip, block):
                raise DataError(
                    f"{path}: line {line} or one after it repeats the header ({head}); cut the log "
                    "there, or remove the line"
                )
            table = _fast(block, delimiter, at, len(known), line)
            if table is None:
                counted = _Counted(block, lines)
                table = _slow(path, counted, delimiter, at, len(known), line)
                line += counted.count
            else:
                line += len(block)
            if len(table):
                yield _Table(table.columns, table.where, remarks)


def _lines(path: Path, file: IO[str]) -> Iterator[str]:
    """The lines of a file, none of them without an end."""
    number = 0
    while text := file.readline(LINE + 1):
        number += 1
        if len(text) > LINE:
            raise DataError(
                f"{path}, line {number}: has more than {LINE} characters; a log has a line for "
                "each sample"
            )
        yield text


def _block(lines: Iterator[str], rows: int) -> list[str]:
    """The next lines: so many, or fewer long ones."""
    block: list[str] = []
    held = 0
    for text in itertools.islice(lines, rows):
        block.append(text)
        held += len(text)
        if held > BLOCK:
            break
    return block


_AHEAD = 200
"""Lines after the first that are looked at to see whether it is a header."""
_BARE = re.compile(r"0|[1-9]\d{0,8}")
_ZEROS_KEPT = re.compile(r"[-+]?\d+\.(?:\d*0)?(?:[eE][-+]?\d+)?")


def _header(
    path: Path, line: int, cells: list[str], text: str, ahead: list[str], delimiter: str | None
) -> tuple[bool, tuple[str, ...]]:
    """Whether the first line is a header, and a remark where it is one of numbers.

    Text makes a header. So do different whole numbers without a point where the lines after them
    keep their decimal zeros, or are unquoted; and those that count from 0, as pandas names columns,
    where the first sample would leap. What could be either is refused.
    """
    if any(_as_number(cell) is None for cell in cells):
        return True, ()
    names = cells[1:] if not cells[0] and len(cells) > 1 else cells  # an index has no name
    if not all(map(_BARE.fullmatch, names)) or len(set(names)) < len(names):
        return False, ()
    rows: list[list[str]] = []
    with contextlib.suppress(DataError):  # a quoted cell may go on beyond
        rows.extend(c for _, c in _records(path, ahead, delimiter, 1) if len(c) == len(cells))
    if not rows:
        return False, ()
    shown = ", ".join(cells)
    header = (True, (f"line {line} ({shown}) is read as a header",))
    columns = list(zip(*rows, strict=True))[len(cells) - len(names) :]
    if ('"' in text and '"' not in "".join(ahead)) or any(map(_keeps_zeros, columns)):
        return header
    leaps = any(_leaps(float(a), column) for a, column in zip(names, columns, strict=True))
    counts = names == [str(i) for i in range(len(names))]
    if counts and (leaps or len(names) < len(cells)):
        return header
    if counts or leaps:
        raise DataError(
            f"{path}, line {line}: {shown} may be a header or a sample; write names above the "
            "columns, or the sample with a decimal point"
        )
    return False, ()


def _keeps_zeros(column: Sequence[str]) -> bool:
    """Whether numbers of this column are never written without a point."""
    there = [cell for cell in column if not math.isnan(_as_number(cell) or 0.0)]
    pointed = all("." in cell and _as_number(cell) is not None for cell in there)
    return pointed and any(map(_ZEROS_KEPT.fullmatch, there))


def _leaps(first: float, column: Sequence[str]) -> bool:
    """Whether the step from a first number to the column is unlike all steps in it."""
    numbers = np.array([_as_number(cell) for cell in column], dtype=float)
    numbers = numbers[np.isfinite(numbers)]
    if len(numbers) < 3:
        return False
    most = float(np.max(np.abs(np.diff(numbers))))
    return most > 0.0 and abs(float(numbers[0]) - first) > 10.0 * most


def _is_idle(text: str) -> bool:
    """A blank line, or a comment."""
    bare = text.strip()
    return not bare or bare.startswith("#")


class _Counted:
    """The lines of a block, and of those after it what a quoted cell that goes on needs."""

    def __init__(self, block: list[str], after: Iterator[str]) -> None:
        self.block, self.after, self.count = block, after, 0

    def __iter__(self) -> Iterator[str]:
        for text in itertools.chain(self.block, self.after):
            self.count += 1
            yield text

    @property
    def done(self) -> bool:
        return self.count >= len(self.block)


def _fast(
    block: list[str], delimiter: str | None, at: Mapping[str, int], width: int, line: int
) -> _Table | None:
    """A block of numbers and empty cells alone, parsed by NumPy; None: look at every cell, also
    where integers are too large for float64.
    """
    text = "".join(block)
    if delimiter is None or any(sign in text for sign in '"#_'):
        return None
    if {row.count(delimiter) for row in block} != {width - 1} or width < 2:
        return None
    columns = list(dict.fromkeys(at.values()))
    empty = re.compile(rf"(?:^|(?<={delimiter}))(?=[{delimiter}\r\n]|\Z)")

    def parse(rows: list[str], dtype: type, use: list[int]) -> np.ndarray | None:
        try:
            out: np.ndarray = np.loadtxt(
                rows, dtype=dtype, delimiter=delimiter, comments=None, usecols=use, ndmin=2
            )
        except (ValueError, OverflowError, IndexError):
            return None
        return out if out.shape == (len(rows), len(use)) else None

    values = parse(block, float, columns)
    if values is None:
        values = parse([empty.sub("nan", row) for row in block], float, columns)
    if values is None:
        return None
    table = {}
    for name, column in at.items():
        one = np.ascontiguousarray(values[:, columns.index(column)])
        if np.abs(one).max(initial=0.0, where=~np.isnan(one)) >= _EXACT:
            whole = parse(block, np.int64, [column])
            if whole is None:
                return None
            one = whole[:, 0]
        table[name] = one
    return _Table(table, lambda index: f"line {line + index}")


def _slow(
    path: Path,
    block: _Counted,
    delimiter: str | None,
    at: Mapping[str, int],
    width: int,
    line: int,
) -> _Table:
    """A block, cell by cell: comments, quotes, words for missing samples, and every complaint."""
    columns = {name: array("d") for name in at}
    large: dict[str, dict[int, int]] = {name: {} for name in at}
    places = array("q")
    for place, cells in _records(path, block, delimiter, line):
        if len(cells) != width:
            raise DataError(
                f"{path}, line {place}: {_cells(len(cells))} where {_cells(width)} are expected; "
                "complete or remove the line"
            )
        for name, index in at.items():
            number = _as_number(cells[index])
            if number is None:
                comma = "; write a decimal point" if "," in cells[index] else ""
                raise DataError(
                    f"{path}, line {place}, column {name!r}: {cells[index]!r} is not a "
                    f"number{comma}"
                )
            if abs(number) >= _EXACT and cells[index].lstrip("+-").isdecimal():
                large[name][len(columns[name])] = int(cells[index])
            columns[name].append(number)
        places.append(place)
        if block.done:
            break
    table = {}
    for name, values in columns.items():
        table[name] = np.array(values, np.float64)
        if large[name]:
            table[name] = _as_integers(table[name])
        if table[name].dtype.kind == "i":
            for k, value in large[name].items():
                table[name][k] = value
    return _Table(table, lambda index: f"line {places[index]}")


def _records(
    path: Path, lines: Iterable[str], delimiter: str | None, line: int
) -> Iterator[tuple[int, list[str]]]:
    """(line number, stripped cells) of every line that is neither blank nor a comment."""
    if delimiter is None:  # blanks
        for number, text in enumerate(lines, line):
            if not _is_idle(text):
                yield number, text.split()
        return
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True, strict=True)
    first = line
    try:
        for cells in reader:
            blank = len(cells) <= 1 and not "".join(cells).strip()
            if not blank and not cells[0].lstrip().startswith("#"):
                yield line, [cell.strip() for cell in cells]
            line = first + reader.line_num
    except csv.Error as error:
        raise DataError(f"{path}, line {line}: {error}") from error


def _as_number(cell: str) -> float | None:
    """The cell's number, NaN for a missing one, None for anything else."""
    if cell.casefold() in _MISSING:
        return math.nan
    if "_" in cell:  # Python's float would read 1_0 as 10
        return None
    try:
        return float(cell)
    except ValueError:
        return None


def _cells(count: int) -> str:
    return f"{count} cell{'' if count == 1 else 's'}"


def _read_npz(path: Path, wanted: list[str]) -> _Table:
    headers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    try:
        with zipfile.ZipFile(path) as archive:
            shapes: dict[str, tuple[tuple[int, ...], int]] = {}
            for info in archive.infolist():
                with archive.open(info) as file:
                    read = headers.get(np.lib.format.read_magic(file))
                    if read is None:
                        continue
                    shape, _, dtype = read(file)
                if dtype.kind in _COLUMN_KINDS:
                    shapes[info.filename.removesuffix(".npy")] = shape, info.file_size
            home = _columns_of(shapes)
            _require(path, wanted, list(home))
            needed = {home[name][0] for name in wanted}
            _check_size(path, sum(shapes[name][1] for name in needed))
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in needed}
    except (OSError, DataError):
        raise
    except Exception as error:  # not a zip file, pickled objects, truncated members
        raise DataError(f"{path} is not a readable .npz file: {error}") from error
    return _taken(arrays, home, wanted)


_COLUMN_KINDS = "fiubMm"
_MAT_SIZES = {"logical": 1, "single": 4} | {
    f"{sign}int{bits}": bits // 8 for sign in ("", "u") for bits in (8, 16, 32, 64)
}


def _read_mat(path: Path, wanted: list[str]) -> _Table:
    import scipy.io

    try:
        shapes = {
            name: (shape, math.prod(shape) * _MAT_SIZES.get(kind, 8))
            for name, shape, kind in scipy.io.whosmat(path)
            if kind == "double" or kind in _MAT_SIZES
        }
        home = _columns_of(shapes)
        _require(path, wanted, list(home))
        needed = {home[name][0] for name in wanted}
        _check_size(path, sum(shapes[name][1] for name in needed))
        arrays = scipy.io.loadmat(path, variable_names=list(needed))
    except (OSError, DataError):
        raise
    except NotImplementedError as error:
        raise DataError(
            f"{path} is a MATLAB 7.3 (HDF5) file; save it with -v7 to read it here"
        ) from error
    except Exception as error:  # scipy raises many kinds on broken files
        raise DataError(f"{path} is not a readable .mat file: {error}") from error
    return _taken(arrays, home, wanted)


def _columns_of(
    shapes: Mapping[str, tuple[tuple[int, ...], int]],
) -> dict[str, tuple[str, int | None]]:
    """Each column's array, and its place there; single numbers and cubes hold none."""
    home: dict[str, tuple[str, int | None]] = {}
    for name, (shape, _) in shapes.items():
        sizes = [size for size in shape if size != 1]
        if len(sizes) == 1 and sizes[0] >= 2:
            home[name] = name, None
        elif len(sizes) == 2 and min(sizes) >= 1:
            home |= {f"{name}[{i}]": (name, i) for i in range(min(min(sizes), 10_000))}
    return home


def _check_size(path: Path, size: int) -> None:
    """Refuse what would not fit into memory, before it is unpacked."""
    import psutil

    free = psutil.virtual_memory().available
    if size > free / 2:
        raise DataError(
            f"{path}: the columns unpack to {size / 2**30:.3g} GiB, {free / 2**30:.3g} GiB of "
            "memory are free; write them as CSV or Parquet, which are read in parts"
        )


def _taken(
    arrays: Mapping[str, np.ndarray], home: Mapping[str, tuple[str, int | None]], wanted: list[str]
) -> _Table:
    columns = {}
    for name in wanted:
        array, column = home[name]
        value = np.squeeze(arrays[array])
        if column is not None:
            value = (value if value.shape[0] >= value.shape[1] else value.T)[:, column]
        columns[name] = value
    return _Table(columns, _row)


def _same_length(path: Path, table: _Table) -> _Table:
    lengths = {name: len(values) for name, values in table.columns.items()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name}: {length}" for name, length in lengths.items())
        raise DataError(f"{path}: the columns differ in length ({told})")
    return table


def _read_parquet(path: Path, wanted: list[str], rows: int) -> Iterator[_Table]:
    _need_pyarrow(path)
    import pyarrow
    import pyarrow.parquet

    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            _require(path, wanted, list(file.schema_arrow.names))
            first = 0
            for batch in file.iter_batches(rows, columns=list(dict.fromkeys(wanted))):
                columns = {name: _from_arrow(batch.column(name)) for name in wanted}
                yield _Table(columns, _rows_from(first))
                first += len(batch)
    except pyarrow.ArrowException as error:
        raise DataError(f"{path} is not a readable Parquet file: {error}") from error


def _from_arrow(column: Any) -> np.ndarray:
    import pyarrow

    if column.null_count and pyarrow.types.is_integer(column.type):
        gone = column.is_null().to_numpy(zero_copy_only=False)
        return np.ma.array(column.fill_null(0).to_numpy(), mask=gone)
    return np.asarray(column.to_numpy(zero_copy_only=False))


def _need_pyarrow(path: Path) -> None:
    try:
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(f"{path}: Parquet needs pip install 'hgo_rs[data]'") from error
