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
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from hgo_rs.errors import HgoError, MissingExtraError, check_choice, check_number
from hgo_rs.files import replacing

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
UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
"""Units of time, and how many of them a second has."""
CHUNK = 65_536
"""Rows of a chunk."""

_TEXT = (".csv", ".txt", ".tsv", ".dat")
_PARQUET = (".parquet", ".pq")
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
    """

    t: np.ndarray
    y: np.ndarray
    u: np.ndarray | None
    names: dict[str, Any]
    source: str
    missing: np.ndarray
    starts: tuple[int, ...] = (0,)
    remarks: tuple[str, ...] = ()

    @property
    def pieces(self) -> list[Log]:
        """A log for each piece between resets of the clock."""
        edges = [0, *(k for k in self.starts if k > 0), len(self.t)]
        return [self.rows(slice(a, b)) for a, b in itertools.pairwise(edges)]

    def rows(self, rows: slice) -> Log:
        """Some rows, as a log of one piece."""
        u = None if self.u is None else self.u[rows]
        t, y, missing = self.t[rows], self.y[rows], self.missing[rows]
        return Log(t, y, u, self.names, self.source, missing, (0,), self.remarks)

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
            f"{self.count} samples from {self._span[0]:g} s to {self._span[1]:g} s, "
            f"median step {self._typical:.6g} s"
        )
        step, at = self._longest
        if step > 1.5 * self._typical:
            text += f", longest step {step:.6g} s at t = {at:g} s"
        if self.pieces > 1:
            text += f", {self.pieces} pieces between resets of the clock"
        several = len(self._channels) > 1
        for channel in self._channels:
            if channel.count:
                text += "\n" + (f"{channel.name}: " if several else "") + channel.describe()
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
            f"{length}, from t = {first:g} s to {last:g} s"
        )


def read_log(
    path: str | Path,
    time: Columns | None,
    output: Columns,
    input: Columns | None = None,
    *,
    dt: float | None = None,
    unit: str | None = None,
    resets: str = "refuse",
    schedule: StochasticApproximation | None = None,
) -> Log:
    """Read a time column, output columns and, if named, input columns.

    A CSV file may have a header or none (its columns are then named 0, 1, 2, ...), be separated by
    tabs, semicolons, commas or blanks, and hold comment lines (#). A 2-D variable `q` of an `.npz`
    or `.mat` file has the columns `q[0]`, `q[1]`, ...

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
        Unit of the time column: s, ms, us or ns. Default: what the column's name says (`t_ms`,
        `time [us]`), ms, us or ns where only these make it a Unix time, else s.
    resets : "refuse" or "split"
        What a clock that starts again means: an error, or a new piece of the log.
    schedule
        Sample k was taken after the first k steps of this schedule, in place of `time` and `dt`.

    Raises
    ------
    DataError
        Unreadable or malformed file, unknown column, time that does not increase or is missing,
        an infinite output, a missing or infinite input. Names file, line and remedy.
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
        first.remarks,
    )


def read_chunks(
    path: str | Path,
    time: Columns | None,
    output: Columns,
    input: Columns | None = None,
    *,
    dt: float | None = None,
    unit: str | None = None,
    resets: str = "refuse",
    schedule: StochasticApproximation | None = None,
    rows: int | None = None,
) -> Iterator[Log]:
    """The log of `read_log` in chunks of about `rows` rows (default 65536), in constant memory.

    A chunk goes on where the one before ended, unless its `starts` hold 0. An `.npz` or `.mat`
    file, and outputs with times of their own, are one chunk. What is wrong with the whole log
    (fewer than two samples, an output without any) is raised after the last chunk.
    """
    path = Path(path)
    clock = _Clock(path, time, dt, unit, resets, schedule)
    if not path.exists():
        near = _nearest(path.name, _siblings(path))
        raise DataError(f"no file {path}" + (f"; nearest: {', '.join(near)}" if near else ""))
    if path.is_dir():
        raise DataError(f"{path} is a folder; name a file ({', '.join(READABLE)})")
    if path.suffix.lower() not in READABLE:
        suffix = path.suffix.lower()
        raise DataError(f"{path}: unknown format {suffix!r}; known: {', '.join(READABLE)}")
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
        log = Log(t, y, u, names, str(path), np.isnan(y), starts, clock.remarks)
        summary.add(log)
        yield log
    if summary.count < 2:
        raise DataError(f"{path}: {summary.count} samples; an observer needs at least 2")
    for name in summary.empty_channels:
        raise DataError(f"{path}: column {name!r} holds no sample")


class TableWriter:
    """Writes columns chunk by chunk as CSV (NaN: empty cell) or Parquet, as the suffix says.

    A context manager: the file takes its name when the block ends well; a block that fails leaves
    nothing behind.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        check_writable_format(self.path)
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

    def _write_text(self, columns: Mapping[str, np.ndarray]) -> None:
        if self._text is None:
            file = self._file.enter_context(replacing(self.path))
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
            file = self._file.enter_context(replacing(self.path))
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

_UNIT_WORDS = {
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "millis", "millisecond", "milliseconds"),
    "us": ("us", "µs", "μs", "usec", "micros", "microsecond", "microseconds"),
    "ns": ("ns", "nsec", "nanos", "nanosecond", "nanoseconds"),
}
_UNIX = (("ns", 1e17), ("us", 1e14), ("ms", 1e11))
"""Numbers from which on a time is a Unix time in this unit: in a coarser one it would be millennia
away."""
_EXACT = 2.0**53
"""Integers from here on are not all float64 numbers."""


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
        self.remarks: tuple[str, ...] = ()
        self.origin: Any = None  # what large integers and times of day count from; the first
        self._base: Any = None
        self._count = 0  # samples of the piece so far
        self._begin = math.nan  # of the piece
        self._last: tuple[float, str] | None = None
        self._next = 0.0  # of the schedule

    def __call__(self, table: _Table) -> tuple[np.ndarray, tuple[int, ...]]:
        """Times of the block, and where pieces begin in it."""
        if self.time is None:
            t = self._made(len(table))
            starts: tuple[int, ...] = () if self._count else (0,)
            self._count += len(table)
            return t, starts
        assert isinstance(self.time, str)
        t = self._seconds(table, self.time)
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

    def _seconds(self, table: _Table, name: str) -> np.ndarray:
        raw = table.columns[name]
        if raw.dtype.kind in "Mm":
            if self._base is None and raw.dtype.kind == "M":
                self._base = raw[0] if self.origin is None else self.origin
            since = raw - self._base if raw.dtype.kind == "M" else raw
            seconds = since.astype("timedelta64[ns]").astype(np.float64) / 1e9
            seconds[np.isnat(raw)] = np.nan
            return np.asarray(seconds)
        values = _values(table, self.path, name)
        if self.unit is None:
            self.unit, told = _unit_of(name, values)
            self.remarks += (told,) if told else ()
        if raw.dtype.kind in "iu" and self._base is None:
            self._base = 0
            if np.max(np.abs(values)) >= _EXACT:
                self._base = int(raw[0] if self.origin is None else self.origin)
                self.remarks += (f"t counts from {name} = {self._base}",)
        if self._base:  # exact, which float64 numbers of this size are not
            whole = raw if raw.dtype.kind in "iu" else np.array([int(v) for v in raw], dtype=object)
            values = np.asarray(whole - np.asarray(self._base, whole.dtype), dtype=np.float64)
        return values / UNITS[self.unit or "s"]

    def _starts(self, t: np.ndarray, table: _Table) -> tuple[int, ...]:
        """Where pieces begin; refuses time that stands still or runs back."""
        starts = []
        if self._last is None:
            starts.append(0)
            self._begin = float(t[0])
        before = np.r_[t[:1] - 1.0 if self._last is None else self._last[0], t[:-1]]
        for k in np.flatnonzero(t <= before).tolist():
            reset = t[k] - self._begin <= 0.1 * (before[k] - self._begin) and t[k] < before[k]
            if not (reset and self.split):
                where = table.where(k - 1) if k else self._last[1] if self._last else ""
                remedy = (
                    "the clock was set back: cut the log there, or take it as pieces with "
                    'resets = "split"'
                    if reset
                    else "time must increase: sort the log or remove repeated rows"
                )
                raise DataError(
                    f"{self.path}, {table.where(k)}: time {t[k]:.12g} does not come after "
                    f"{before[k]:.12g} ({where}); {remedy}"
                )
            starts.append(k)
            self._begin = float(t[k])
        self._last = (float(t[-1]), table.where(len(t) - 1))
        return tuple(starts)

    def _regular(self, t: np.ndarray, starts: tuple[int, ...], table: _Table) -> np.ndarray:
        """Exact multiples of dt from the begin of each piece on."""
        assert self.dt is not None
        out = np.empty_like(t)
        edges = [*starts, len(t)] if 0 in starts else [0, *starts, len(t)]
        for a, b in itertools.pairwise(edges):
            if a in starts:
                self._count, self._origin = 0, float(t[a])
            out[a:b] = self._origin + self.dt * np.arange(self._count, self._count + b - a)
            off = np.abs(t[a:b] - out[a:b]) > 0.5 * self.dt
            if off.any():
                k = a + int(np.argmax(off))
                raise DataError(
                    f"{self.path}, {table.where(k)}: time {t[k]:g} s is not sample "
                    f"{self._count + k - a} of a record with dt = {self.dt:g} s ({out[k]:g} s); "
                    "leave dt out to honour uneven steps"
                )
            self._count += b - a
        return out


def _unit_of(name: str, values: np.ndarray) -> tuple[str, str]:
    """The unit of a time column, and what to say about it."""
    word = re.search(r"(?:^|[\W_])([a-zµμ]+)\W*$", name.casefold())
    for unit, words in _UNIT_WORDS.items():
        if word and word[1] in words and word[0] != name.casefold():
            return unit, "" if unit == "s" else f"times {name!r} are in {unit}, as the name says"
    with np.errstate(invalid="ignore"):
        size = float(np.nanmedian(np.abs(values))) if np.isfinite(values).any() else 0.0
        whole = bool(np.all(values[np.isfinite(values)] % 1.0 == 0.0))
    for unit, least in _UNIX:
        if whole and size >= least:
            return unit, f"times {name!r} are read as Unix times in {unit} (unit says another)"
    return "s", ""


def _merged(
    path: Path, times: list[str], output: Columns, input: Columns | None, unit: str | None
) -> Log:
    """Outputs and inputs with times of their own, as one log."""
    outputs = _names(output, "output")
    inputs = [] if input is None else _names(input, "input")
    signals = [*outputs, *inputs]
    if len(times) == len(outputs):
        times = times + times[:1] * len(inputs)
    if len(times) != len(signals):
        raise DataError(
            f"time: {len(times)} columns for {len(outputs)} outputs and {len(inputs)} inputs; name "
            "one, or one for each output (inputs then go with the first), or one for each of all"
        )
    table = _whole(path, [*times, *signals])
    clocks: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    remarks: tuple[str, ...] = ()
    first = [table.columns[name][0] for name in times if len(table.columns[name])]
    kinds = {value.dtype.kind for value in first}
    origin = min(first) if kinds in ({"M"}, {"i"}, {"u"}) else None
    for name in dict.fromkeys(times):
        raw = table.columns[name]
        mine = [s for s, t in zip(signals, times, strict=True) if t == name]
        lengths = {len(table.columns[s]) for s in mine} | {len(raw)}
        if len(lengths) > 1:
            raise DataError(f"{path}: {', '.join([name, *mine])} differ in length")
        kept = ~np.isnat(raw) if raw.dtype.kind in "Mm" else ~np.isnan(_values(table, path, name))
        kept |= ~np.all([np.isnan(_values(table, path, s)) for s in mine], axis=0)
        at = np.flatnonzero(kept)  # the rest pads the shorter columns
        clock = _Clock(path, name, None, unit, "refuse", None)
        clock.origin = origin
        own = _Table({name: raw[at]}, _rows_at(table, at))
        clocks[name] = (clock(own)[0], at)
        remarks += clock.remarks
    t = np.unique(np.concatenate([seconds for seconds, _ in clocks.values()]))
    y = np.full((len(t), len(outputs)), np.nan)
    for j, (name, own_time) in enumerate(zip(outputs, times, strict=False)):
        seconds, at = clocks[own_time]
        values = _values(table, path, name)[at]
        _refuse(
            table, path, np.isinf(values), f"{name!r} is infinite; leave a missing sample empty"
        )
        if np.isnan(values).all():
            raise DataError(f"{path}: column {name!r} holds no sample")
        y[np.searchsorted(t, seconds), j] = values
    u = np.empty((len(t), len(inputs)))
    for j, (name, own_time) in enumerate(zip(inputs, times[len(outputs) :], strict=True)):
        seconds, at = clocks[own_time]
        values = _values(table, path, name)[at]
        told = f"the input {name!r} is missing or infinite; fill it in"
        _refuse(table, path, ~np.isfinite(values), told)
        held = np.searchsorted(seconds, t, side="right") - 1
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
    told_u = None if not inputs else u[:, 0] if isinstance(input, str) else u
    return Log(t, shaped, told_u, names, str(path), np.isnan(shaped), (0,), remarks)


# --- checks ----------------------------------------------------------------------------------


@dataclass
class _Table:
    """The wanted columns, and where a sample stands in the file."""

    columns: dict[str, np.ndarray]
    where: Callable[[int], str]

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
    return np.ascontiguousarray(values, dtype=np.float64)


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
    columns = {n: np.concatenate([b.columns[n] for b in blocks]) for n in blocks[0].columns}
    ends = np.cumsum([len(block) for block in blocks])

    def where(index: int) -> str:
        i = int(np.searchsorted(ends, index, side="right"))
        return blocks[i].where(index - (int(ends[i - 1]) if i else 0))

    return _Table(columns, where)


def _read_text(path: Path, wanted: list[str], rows: int) -> Iterator[_Table]:
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        head: list[str] = []
        delimiter = None
        for text in file:
            head.append(text)
            if not _is_idle(text):
                delimiter = next((d for d in "\t;," if d in text), None)
                break
        lines = itertools.chain(head, file)
        taken: list[str] = []
        spied = (taken.append(text) or text for text in lines)  # type: ignore[func-returns-value]
        first = next(_records(path, spied, delimiter, 1), None)
        if first is None:
            raise DataError(f"{path} is empty")
        cells = first[1]
        has_header = any(_as_number(cell) is None for cell in cells)
        known = cells if has_header else [str(i) for i in range(len(cells))]
        remark = "" if has_header else " (no header: columns are named from 0)"
        _require(path, wanted, known, remark)
        at = {name: known.index(name) for name in wanted}
        line = 1
        if has_header:
            line += len(taken)
        else:
            lines = itertools.chain(taken, lines)
        while block := list(itertools.islice(lines, rows)):
            table = _fast(block, delimiter, at, len(known), line)
            if table is None:
                counted = _Counted(block, lines)
                table = _slow(path, counted, delimiter, at, len(known), line)
                line += counted.count
            else:
                line += len(block)
            if len(table):
                yield table


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
    """A block of numbers and empty cells alone, parsed by NumPy; None: look at every cell."""
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
            one = one if whole is None else whole[:, 0]
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
    whole: dict[str, list[int]] = {name: [] for name in at}
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
            columns[name].append(number)
            if abs(number) >= _EXACT and cells[index].lstrip("+-").isdecimal():
                whole[name].append(int(cells[index]))
        places.append(place)
        if block.done:
            break
    table = {}
    for name, values in columns.items():
        exact = len(values) > 0 and len(whole[name]) == len(values)
        exact = exact and max(map(abs, whole[name])) < 2**63
        table[name] = np.array(whole[name] if exact else values, np.int64 if exact else np.float64)
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
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except OSError:
        raise
    except Exception as error:  # not a zip file, pickled objects, truncated members
        raise DataError(f"{path} is not a readable .npz file: {error}") from error
    return _from_arrays(path, arrays, wanted)


def _read_mat(path: Path, wanted: list[str]) -> _Table:
    import scipy.io

    try:
        variables = scipy.io.loadmat(path)
    except OSError:
        raise
    except NotImplementedError as error:
        raise DataError(
            f"{path} is a MATLAB 7.3 (HDF5) file; save it with -v7 to read it here"
        ) from error
    except Exception as error:  # scipy raises many kinds on broken files
        raise DataError(f"{path} is not a readable .mat file: {error}") from error
    arrays = {name: value for name, value in variables.items() if not name.startswith("__")}
    return _from_arrays(path, arrays, wanted)


def _from_arrays(path: Path, arrays: Mapping[str, Any], wanted: list[str]) -> _Table:
    columns: dict[str, np.ndarray] = {}
    for name, value in arrays.items():
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiubMm" or value.size < 2:
            continue  # text, structures, single numbers: not a column
        value = np.squeeze(value)
        if value.ndim == 1:
            columns[name] = value
        elif value.ndim == 2:
            long = value if value.shape[0] >= value.shape[1] else value.T
            columns.update({f"{name}[{i}]": long[:, i] for i in range(long.shape[1])})
    _require(path, wanted, list(columns))
    return _Table({name: columns[name] for name in wanted}, _row)


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
                columns = {
                    name: batch.column(name).to_numpy(zero_copy_only=False) for name in wanted
                }
                yield _Table(columns, _rows_from(first))
                first += len(batch)
    except pyarrow.ArrowException as error:
        raise DataError(f"{path} is not a readable Parquet file: {error}") from error


def _need_pyarrow(path: Path) -> None:
    try:
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(f"{path}: Parquet needs pip install 'hgo_rs[data]'") from error
