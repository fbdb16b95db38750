"""What a log holds, before anything is asked of it."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hgo_rs.logs.formats import recording, recording_kind, tables, whole
from hgo_rs.logs.log import LogSummary
from hgo_rs.logs.parquet import ARROW
from hgo_rs.logs.read import check_file, read_chunks
from hgo_rs.logs.streams import suffix_of
from hgo_rs.logs.table import CHUNK, CellError, ColumnError, DataError, Table
from hgo_rs.logs.text import NO_NUMBER, TEXT, head_of_text, remedy_of
from hgo_rs.markup import table
from hgo_rs.signals import speaks_of_time
from hgo_rs.times import named_unit

_MOST = 200
"""Columns that are looked at."""
_STILL = 20
"""Rows without a change that are told."""
_TITLES = ["column", "type", "unit", "missing", "range", "resolution", "standstill"]


@dataclass
class Column:
    """What a column holds, seen block by block.

    Attributes
    ----------
    kind : str
        "number", "integer", "date", "time" (a duration or a time of day), "text" or "empty".
    count, missing : int
        Rows, and those without a value.
    low, high : float
        Range; of times in s, from the first on.
    resolution : float
        The least difference between samples that differ; 0: none do.
    still, still_at : int
        The longest run of rows without a change, and the row at which it begins.
    rises : bool
        Whether no value is below or at the one before.
    unit : str
        What the file or the name says.
    """

    name: str
    kind: str = "empty"
    unit: str = ""
    count: int = 0
    missing: int = 0
    low: float = math.inf
    high: float = -math.inf
    resolution: float = math.inf
    still: int = 0
    still_at: int = 0
    rises: bool = True
    _whole: bool = True
    _run: int = 1
    _last: float = math.nan
    _origin: int | None = None

    def add(self, values: np.ndarray) -> None:
        """Take in the next block."""
        kind = values.dtype.kind
        if kind not in "fiubMm":
            self.kind = "text"
            return
        names = {"M": "date", "m": "time", "f": "number", "b": "integer"}
        self.kind = names.get(kind, "integer")
        numbers = self._numbers(values)
        there = ~np.isnan(numbers)
        first, self.count = self.count, self.count + len(numbers)
        self.missing += int(len(numbers) - there.sum())
        seen = numbers[there]
        if not len(seen):
            return
        self._whole &= bool(np.all(seen == np.trunc(seen)))
        if self.kind == "number" and self._whole:
            self.kind = "integer"
        self.low, self.high = min(self.low, seen.min()), max(self.high, seen.max())
        before = np.r_[self._last, seen[:-1]]
        steps = np.abs(seen - before)
        self.rises &= not bool(np.any(seen <= before))
        moved = steps[steps > 0.0]
        self.resolution = min(self.resolution, float(moved.min(initial=math.inf)))
        self._stand(steps, np.flatnonzero(there) + first)
        self._last = float(seen[-1])

    def _numbers(self, values: np.ndarray) -> np.ndarray:
        if values.dtype.kind not in "Mm":
            numbers = np.ma.getdata(values).astype(np.float64)
            return np.where(np.ma.getmaskarray(values), np.nan, numbers)
        ticks = values.astype(values.dtype.str.split("[")[0] + "[ns]")
        there = ticks[~np.isnat(ticks)].view(np.int64)
        if self._origin is None and len(there):
            self._origin = int(there[0])
        seconds = (ticks.view(np.int64) - (self._origin or 0)) / 1e9
        return np.where(np.isnat(ticks), np.nan, seconds)

    def _stand(self, steps: np.ndarray, rows: np.ndarray) -> None:
        """The runs of rows without a change; one may go on from the block before."""
        edges = np.r_[0, np.flatnonzero(steps != 0.0), len(steps)]
        lengths = np.diff(edges)
        if steps[0] == 0.0:  # the first of the block goes on with the last one's run
            lengths[lengths.nonzero()[0][0]] += self._run
        k = int(np.argmax(lengths))
        if lengths[k] > self.still:
            self.still = int(lengths[k])
            self.still_at = int(rows[min(edges[k + 1], len(rows)) - 1]) - self.still + 1
        self._run = int(lengths[-1])

    @property
    def is_signal(self) -> bool:
        """Whether it holds numbers that move, but no count of rows."""
        counts = self.rises and self.kind == "integer"
        return self.kind in ("number", "integer") and self.high > self.low and not counts

    def row(self) -> list[str]:
        """Name, type, unit, missing, range, resolution, standstill, as texts."""
        if self.kind in ("text", "empty"):
            return [self.name, self.kind, self.unit, "", "", "", ""]
        spread = f"{self.low:.6g} .. {self.high:.6g}" if self.high >= self.low else "no sample"
        moves = math.isfinite(self.resolution)
        still = f"{self.still} rows from row {self.still_at}" if self.still >= _STILL else ""
        return [
            self.name,
            self.kind,
            "s" if self.kind in ("date", "time") else self.unit,
            str(self.missing) if self.missing else "",
            spread,
            f"{self.resolution:.3g}" if moves else "stands still",
            still if moves else "",
        ]


@dataclass(repr=False)
class Look:
    """What a log holds; its text is a report.

    Attributes
    ----------
    source : str
    rows : int
    columns : list of Column
    remarks : list of str
        How the file was read, what cannot be read, and what was left out.
    time : str or None
        The column of times, or two as "a+b"; None: none was found, or the file says each signal's.
    output : str or None
        A signal.
    timing : list of str
        Rate, jitter and gaps, or why the log cannot be read so.
    command : str
        One that reads it; empty where none is known.
    """

    source: str
    rows: int = 0
    columns: list[Column] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    time: str | None = None
    output: str | None = None
    timing: list[str] = field(default_factory=list)
    command: str = ""

    def __repr__(self) -> str:
        return f"Look({self._head})"

    def _repr_html_(self) -> str:
        end = [*self.remarks, *self.timing, *([f"next: {self.command}"] if self.command else [])]
        rows = [column.row() for column in self.columns]
        return table(self._head, rows, _TITLES) + table("", [(line,) for line in end])

    @property
    def _head(self) -> str:
        count = len(self.columns)
        return f"{self.source}: {self.rows} rows, {count} column{'' if count == 1 else 's'}"

    def __str__(self) -> str:
        head, rows = self._head, [_TITLES, *(column.row() for column in self.columns)]
        widths = [max(map(len, cells)) for cells in zip(*rows, strict=True)]
        shown = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]
        end = [f"next: {self.command}"] if self.command else []
        return "\n".join([head, *self.remarks, "", *shown, "", *self.timing, *end])


def look(path: str | Path) -> Look:
    """What a log of any format holds, read in blocks where its format allows it.

    Raises
    ------
    DataError
        A file that cannot be read, or of which no column can.
    """
    path = Path(path)
    check_file(path)
    found = Look(str(path))
    clocks = _columns(path, found)
    known = {column.name: column for column in found.columns}
    while True:
        names = [name for name, column in known.items() if column.kind != "text"]
        try:
            for table in _blocks(path, names):
                for name in names:
                    known[name].add(table.columns[name])
                    known[name].unit = table.units.get(name) or known[name].unit
                found.remarks += [r for r in table.remarks if r not in found.remarks]
            break
        except CellError as error:
            found.remarks.append(str(error))
            for name in names:
                known[name] = Column(name, "text" if name == error.column else "empty")
    found.columns = list(known.values())
    for column in found.columns:
        column.unit = column.unit or _bracketed(column.name)
    found.rows = max((column.count for column in found.columns), default=0)
    _suggest(path, found, clocks)
    return found


def column_names(path: str | Path) -> list[str]:
    """Names of the columns of a log, of which nothing else is read where its format allows it.

    Raises
    ------
    DataError
        A file that cannot be read.
    """
    path = Path(path)
    check_file(path)
    found = Look(str(path))
    _columns(path, found)
    return [column.name for column in found.columns]


def _columns(path: Path, found: Look) -> dict[str, str]:
    """The columns, still empty; of a file that says it, the clock of each."""
    clocks: dict[str, str] = {}
    suffix = suffix_of(path)
    if suffix in TEXT:
        head = head_of_text(path)
        pairs = zip(head.names, head.kinds, strict=True)
        found.columns = [Column(n, "empty" if kind else "text") for n, kind in pairs]
        for name, kind, cell in zip(head.names, head.kinds, head.cells, strict=True):
            remedy = remedy_of(cell, "number", head.delimiter != ",")
            if kind is None and remedy != NO_NUMBER:
                found.remarks.append(f"column {name!r} begins with {cell!r}{remedy}")
    elif kind := recording_kind(path):
        with recording(path, kind) as opened:
            found.columns = [Column(name) for name in opened.clocks]
            clocks = {name: clock for name, clock in opened.clocks.items() if clock}
    else:
        try:
            list(tables(path, ["\0"], CHUNK))  # no column is called so: the refusal lists all
        except ColumnError as error:
            found.columns = [Column(name) for name in error.known]
    names = [column.name for column in found.columns]
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        shown = ", ".join(name or "''" for name in twice)
        found.remarks.append(f"several columns are called {shown}: rename them")
        found.columns = [column for column in found.columns if column.name not in twice]
    if len(found.columns) > _MOST:
        found.remarks.append(f"the first {_MOST} of {len(found.columns)} columns")
        found.columns = found.columns[:_MOST]
    return clocks


def _blocks(path: Path, names: list[str]) -> Iterable[Table]:
    if not names:
        return []
    if suffix_of(path) in (*TEXT, *ARROW):
        return tables(path, names, CHUNK)
    return [whole(path, names)]


def _bracketed(name: str) -> str:
    """The unit in a name: q [rad], or of times t_ms."""
    for opening, closing in ("[]", "()"):
        if name.rstrip().endswith(closing) and opening in name:
            unit = name.rstrip()[name.index(opening) + 1 : -1]
            return "" if unit.isdecimal() else unit  # q[0] is a column of an array
    return (named_unit(name)[0] or "") if speaks_of_time(name) else ""


def _suggest(path: Path, found: Look, clocks: dict[str, str]) -> None:
    """Times and a signal, how they go, and the command that takes them."""
    found.time = _time(found.columns)
    apart = {found.time, *(found.time or "").split("+"), *clocks.values()}
    signals = [c.name for c in found.columns if c.is_signal and c.name not in apart]
    if found.time is None and not clocks:  # a column that rises may be the times
        signals = [c.name for c in found.columns if c.name in signals and not c.rises] or signals
    if clocks:
        signals = [name for name in signals if name in clocks] or signals
    elif found.time is not None:
        signals = _beside(found, signals)
    found.output = signals[0] if signals else None
    if found.output is None:
        found.timing.append("no column of numbers moves: there is nothing to estimate")
        return
    if clocks and clocks.get(found.output):
        found.time = None
    words = ["hgo", "tune", str(path)]
    if found.time is None and not clocks.get(found.output):
        found.timing.append("no time column was found: name it with --time, or give --dt")
        words += ["--dt", "PERIOD"]
    elif found.time is not None:
        words += ["--time", found.time]
    words += ["--output", found.output]
    if "PERIOD" not in words:
        try:
            found.timing += _timing(path, found.time, found.output)
        except DataError as error:
            found.timing.append(str(error))
        said = "\n".join(found.timing).split("\n")
        found.remarks = [remark for remark in found.remarks if remark not in said]
    found.command = shlex.join(words)


def _beside(found: Look, signals: list[str]) -> list[str]:
    """Those that may have these times: as long, and first those of the same group of a file."""
    time = (found.time or "").split("+")[0]
    lengths = {column.name: column.count for column in found.columns}
    groups = {name: re.split(r"[./](?!.*[./])", name)[0] for name in lengths}
    fitting = [name for name in signals if lengths[name] == lengths[time]] or signals
    return sorted(fitting, key=lambda name: groups[name] != groups[time])


def _time(columns: list[Column]) -> str | None:
    """The column of times, or the sum of two."""
    dates = [c for c in columns if c.kind == "date"]
    clocks = [c for c in columns if c.kind == "time"]
    if dates and clocks and not any(c.rises for c in dates):
        return f"{dates[0].name}+{clocks[0].name}"
    units = {c.name: named_unit(c.name)[0] for c in columns if c.kind in ("integer", "number")}
    parts = [name for name, unit in units.items() if unit == "ns"]
    wholes = [c for c in columns if units.get(c.name) == "s" and c.resolution == int(c.resolution)]
    if parts and wholes and not wholes[0].rises and len(parts) == 1:
        return f"{wholes[0].name}+{parts[0]}"
    last = {c.name: re.split(r"[./]", c.name)[-1] for c in columns}
    numbers = [c for c in columns if c.kind in ("integer", "number")]
    named = [c for c in numbers if speaks_of_time(c.name) or speaks_of_time(last[c.name])]
    for found in (dates, clocks, named):
        if found:
            return max(found, key=lambda column: column.rises).name
    rising = [c for c in numbers if c.rises and c.count > 1]
    if not rising:
        return None
    first = rising[0]
    index = first is columns[0] and not first.name and first.kind == "number"  # of a pandas table
    return first.name if index or units.get(first.name) else None


def _timing(path: Path, time: str | None, output: str) -> list[str]:
    """Rate, jitter and gaps of a signal."""
    summary, usual = LogSummary(), math.nan
    square, regular, gaps = 0.0, 0, 0
    last = math.nan
    for chunk in read_chunks(path, time, output, resets="split" if time else "refuse"):
        summary.add(chunk)
        steps = np.diff(chunk.t, prepend=last)
        steps = steps[steps > 0.0]
        last = float(chunk.t[-1])
        if math.isnan(usual) and len(steps):
            usual = float(np.median(steps))
        near = steps[steps <= 1.5 * usual]
        square, regular = square + float(np.sum((near - usual) ** 2)), regular + len(near)
        gaps += len(steps) - len(near)
    jitter = math.sqrt(square / max(regular, 1))
    shown = f"jitter {jitter:.2g} s ({100.0 * jitter / usual:.2g} %)"
    told = f"rate {1.0 / usual:.6g} Hz, {shown if jitter > 1e-9 * usual else 'no jitter'}"
    many = f", {gaps} longer step{'' if gaps == 1 else 's'}" if gaps else ""
    return [summary.describe(), told + many]
