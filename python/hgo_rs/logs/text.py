"""Logs as text: CSV, and columns between blanks."""

from __future__ import annotations

import contextlib
import csv
import itertools
import math
import re
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO

import numpy as np

from hgo_rs.logs.table import DataError, Table, as_integers, require

LINE = 2**20
"""Characters of the longest line that is read."""
BLOCK = 2**26
"""Characters of text that are held at a time, beside one line."""

TEXT = (".csv", ".txt", ".tsv", ".dat")
_EXACT = 2.0**53
"""Integers from here on are not all float64 numbers."""
_MISSING = frozenset({"", "nan", "na", "n/a", "null", "none"})


def read_text(path: Path, wanted: list[str], rows: int) -> Iterator[Table]:
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
        require(path, wanted, known, remark)
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
                yield Table(table.columns, table.where, remarks)


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
) -> Table | None:
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
    return Table(table, lambda index: f"line {line + index}")


def _slow(
    path: Path, block: _Counted, delimiter: str | None, at: Mapping[str, int], width: int, line: int
) -> Table:
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
            table[name] = as_integers(table[name])
        if table[name].dtype.kind == "i":
            for k, value in large[name].items():
                table[name][k] = value
    return Table(table, lambda index: f"line {places[index]}")


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
