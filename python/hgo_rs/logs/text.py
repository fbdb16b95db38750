"""Logs as text: CSV, and columns between blanks."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs._core import TextReader, text_kind
from hgo_rs.logs.head import Head, head_of
from hgo_rs.logs.streams import START, Stream, opened
from hgo_rs.logs.table import CellError, DataError, Table, as_integers, require

LINE = 2**20
"""Bytes of the longest line that is read."""
BLOCK = 2**21
"""Bytes of text that are read at a time."""

TEXT = (".csv", ".txt", ".tsv", ".dat")


def head_of_text(path: Path) -> Head:
    """How a log is read of which no column is asked for."""
    with opened(path) as stream:
        start, ended = _start(path, stream)
        return head_of(path, start, (), ended)


def read_text(path: Path, wanted: list[str], rows: int) -> Iterator[Table]:
    with opened(path, wanted) as stream:
        held, ended = _start(path, stream)
        head = head_of(path, held, wanted, ended)
        bare = () if head.has_header else ("no header: columns are named from 0",)
        why = "; ".join([*bare, *stream.remarks])
        require(path, wanted, head.names, f" ({why})" if why else "")
        places = [head.names.index(name) for name in wanted]
        kinds = [_taken(head.kinds[place]) for place in places]
        reader = TextReader(
            None if head.delimiter is None else ord(head.delimiter),
            len(head.names),
            list(zip(places, kinds, strict=True)),
            head.line,
            head.trailing,
        )
        pairs = zip(wanted, kinds, strict=True)
        clocks = {name: _Midnights(name) for name, kind in pairs if kind == "daytime"}
        at = head.begin
        _check_repeats(path, head, held[at:], head.line)
        while True:
            found = reader.read(held, at, rows, ended)
            if isinstance(found, dict) and "long" in found:
                raise _too_long(path, found["line"])
            if isinstance(found, dict):
                raise _fault(path, head, wanted, found, ended and held)
            columns, lines, read = found
            at += read
            if len(lines):
                values = dict(zip(wanted, map(_column, columns, kinds), strict=True))
                for name, clock in clocks.items():
                    values[name] = clock(values[name], lines)
                told = stream.remarks + head.remarks
                told += ("decimal commas are read as points",) if reader.commas else ()
                told += tuple(clock.remark for clock in clocks.values() if clock.remark)
                yield Table(values, _places(lines), told, head.units)
            elif ended:
                return
            else:
                more = stream.read(BLOCK)
                held, at, ended = held[at:] + more, 0, not more
                _check_repeats(path, head, held, reader.line)


def _start(path: Path, stream: Stream) -> tuple[bytes, bool]:
    """The begin of a log, and whether it is all of it."""
    held = stream.read(START)
    while more := stream.read(START) if len(held) < START else b"":
        held += more
    while held and b"\n" not in held[-LINE:] and (more := stream.read(START)):
        held += more
        if len(held) > LINE and b"\n" not in held:
            raise _too_long(path, 1)
    return held, len(held) < START


def _check_repeats(path: Path, head: Head, held: bytes, line: int) -> None:
    """Refuse a line that repeats a header of numbers."""
    if not head.of_numbers:
        return
    header = re.escape(head.header)
    if found := re.search(rb"^[ \t]*" + header + rb"[ \t\r]*$", held, re.MULTILINE):
        raise _repeated(path, head, line + held.count(b"\n", 0, found.start()))


def _repeated(path: Path, head: Head, line: int) -> DataError:
    shown = head.header.decode(errors="replace")
    told = f"repeats the header ({shown}); cut the log there, or remove the line"
    return DataError(f"{path}, line {line} {told}")


def _too_long(path: Path, line: int) -> DataError:
    return DataError(
        f"{path}, line {line}: has more than {LINE} characters; a log has a line for each sample"
    )


def _taken(kind: str | None) -> str:
    return kind if kind in ("moment", "daytime") else "number"


def _places(lines: np.ndarray) -> Any:
    return lambda index: f"line {lines[index]}"


def _column(found: tuple[np.ndarray, np.ndarray, np.ndarray], kind: str) -> np.ndarray:
    values, rows, large = found
    if kind != "number":
        return values.view("datetime64[ns]" if kind == "moment" else "timedelta64[ns]")
    if len(rows):
        values = as_integers(values)
        if values.dtype.kind == "i":
            values[rows] = large
    return values


_DAY = np.timedelta64(1, "D")


class _Midnights:
    """Times of day that go on over midnight, block by block."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._last: np.timedelta64 | None = None
        self._days = 0
        self.remark = ""

    def __call__(self, values: np.ndarray, lines: np.ndarray) -> np.ndarray:
        there = np.flatnonzero(~np.isnat(values))
        if not len(there):
            return values
        raw = values[there]
        before = np.r_[raw[:1] if self._last is None else self._last, raw[:-1]]
        self._last = raw[-1]
        over = (before - raw > _DAY // 2) & (before < _DAY) & (raw >= np.timedelta64(0))
        if over.any():
            self.remark = self.remark or (
                f"times {self._name!r} continue over midnight "
                f"(line {lines[there[np.argmax(over)]]})"
            )
        days = self._days + np.cumsum(over)
        self._days = int(days[-1])
        values = values.copy()
        values[there] = raw + days * _DAY
        return values


# --- what cannot be read -------------------------------------------------------------------------


def _fault(
    path: Path, head: Head, wanted: list[str], found: dict[str, Any], end: bytes | bool
) -> DataError:
    """What is wrong with a line, and the remedy."""
    line, text = found["line"], found["text"].strip()
    where = f"{path}, line {line}"
    cut = isinstance(end, bytes) and end.rstrip(b"\r").endswith(found["text"])
    if head.has_header and text == head.header:
        return _repeated(path, head, line)
    if b"\0" in text:
        return DataError(f"{where}: holds bytes that are no text; remove the line, or cut the log")
    if "quote" in found:
        if found["quote"] == "open":
            return DataError(f"{where}: unexpected end of data, a quoted cell has no end; close it")
        return DataError(f"{where}: a quote ends inside a cell; write it twice")
    if "cells" in found:
        told = f"{_cells(found['cells'])} where {_cells(len(head.names))} are expected"
        remedy = "; complete or remove the line"
        if line == head.line and head.delimiter == "," and found["cells"] > len(head.names):
            remedy = "; where commas are decimal signs, part the cells by semicolons"
        return DataError(f"{where}: {told}{CUT if cut else remedy}")
    index, raw = found.get("zone") or found["cell"]
    name, cell = wanted[index], raw.decode(errors="replace")
    if "zone" in found:
        told = "differs from earlier dates: only one has a time zone; write all in one form"
        return CellError(f"{where}, column {name!r}: {cell!r} {told}", name)
    kind = _taken(head.kinds[head.names.index(name)])
    what = {"number": "a number", "moment": "a date", "daytime": "a time of day"}[kind]
    remedy = remedy_of(cell, kind, head.delimiter != ",")
    if cut and remedy == NO_NUMBER:
        remedy = CUT
    elif line == head.line and head.has_header and remedy == NO_NUMBER:
        remedy = "; remove the line if it holds units or names"
    return CellError(f"{where}, column {name!r}: {cell!r} is not {what}{remedy}", name)


NO_NUMBER = "; write a number, or leave the cell of a missing sample empty"
CUT = "; the file is cut off there: remove the line"
_OTHER_DATES = "; write 2024-03-05 21:07:03, or seconds (pandas.to_datetime reads other dates)"
_OTHER_DATE = re.compile(
    r"(?:[a-z]{2,3},? +)?(?:\d\d?\.?[-/ ]*)?"
    r"(?:jan|feb|m[aä]r|apr|ma[iy]|jun|jul|aug|sep|o[ck]t|nov|de[cz])[a-z]*\.?[-/ ]+\d.*"
    r"|\d{8}T\d{4,6}.*",
    re.IGNORECASE,
)
"""A date with the month as a word, or without signs between its parts."""
_HEX = re.compile(r"[-+]?0[xX][0-9a-fA-F]+|(?=.*\d)(?=.*[a-dfA-DF])[0-9a-fA-F]+[hH]?")


def remedy_of(cell: str, kind: str, commas: bool) -> str:
    """What to do about a cell."""
    if kind != "number" or re.match(r"\d+[-/.:]\d+[-/.:]", cell):
        if re.search(r"[ap]\.?m\.?$", cell, re.I) or re.match(r"\d\d?/\d\d?/\d", cell):
            return _OTHER_DATES
        return "; write all as 2024-03-05T09:07:03.25, or as seconds; leave a missing one empty"
    if _OTHER_DATE.fullmatch(cell):
        return _OTHER_DATES
    if re.fullmatch(r"='?\"?.*|'.*'", cell):
        return "; write the bare number, without signs around it"
    if re.fullmatch(r"[\u2010-\u2015\u2212][\d.,].*", cell):
        return "; write its minus as -"
    if re.fullmatch(r"[-+]?(?:1\.#INF.*|∞)", cell, re.IGNORECASE):
        return "; leave the cell of a missing sample empty"
    if re.fullmatch(r"[-+]?[\d.,]+(?:[eE][-+]?\d+)?\s*(?:#|%\s|//).*", cell):
        return "; remove the comment behind the number"
    if re.fullmatch(r"[-+]?0[bB][01]+|[-+]?0[oO][0-7]+", cell):
        return "; convert it to decimal, for example by int(cell, 0)"
    if _HEX.fullmatch(cell):
        return "; it is hexadecimal: convert it to decimal, for example by int(cell, 16)"
    if re.fullmatch(r"[-+]?\d{1,3}(?:[,.' \u00a0\u202f]\d{3})+(?:[.,]\d*)?", cell) and (
        len(re.findall(r"\D", cell.lstrip("+-"))) > 1 or not re.search("[.,]", cell)
    ):
        return "; write it without separators of thousands"
    if re.fullmatch(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?", cell):
        mixed = ", as the numbers before it have" if commas else ""
        return f"; write a decimal point{mixed}"
    if re.fullmatch(r"[-+]?\d*\.\d+", cell):
        return "; write a decimal comma, as the numbers before it have, or points in all"
    if re.fullmatch(r"[-+]?[\d.]+[dD][-+]?\d+", cell):
        return "; write the exponent with E"
    if cell.casefold() in ("true", "false", "on", "off", "yes", "no"):
        return "; write 1 or 0"
    if re.fullmatch(r"[-+]?[\d_.]+(?:[eE][-+]?\d+)?", cell) and "_" in cell:
        return "; write it without underscores"
    if unit := re.fullmatch(r"([-+]?[\d.,]+(?:[eE][-+]?\d+)?)\s*([^\d\s].*)", cell):
        return f"; write {unit[1]} and the unit {unit[2]} into the header"
    if text_kind(cell.encode(), True) in ("moment", "daytime"):
        return "; it is a date among numbers: write seconds"
    return NO_NUMBER


def _cells(count: int) -> str:
    return f"{count} cell{'' if count == 1 else 's'}"
