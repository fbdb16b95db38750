"""The head of a log as text: what parts its cells, the names of its columns, where samples begin.

The header is the line that holds the wanted names, a comment too; what stands above it is passed
over. Without names it is the last line of text above the numbers.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hgo_rs._core import text_cells, text_is_idle, text_kind
from hgo_rs.logs.table import DataError

AHEAD = 200
"""Lines that are looked at."""
_DELIMITERS: tuple[str | None, ...] = ("\t", ";", ",", "|", None)
"""What may part cells, in the order of trial; None: blanks."""
_DATA = ("number", "moment", "daytime")
_UNIT = re.compile(
    r"[\[(].*[\])]|[-=+:|*_]*|(?:[munkMGpcµμ]?(?:s|m|g|V|A|N|Hz|W|J|Pa|T|F|H|rad|Nm|bar|Ω|ohm|l|L)"
    r"|sec|seconds?|min|h|hr|d|deg|degrees?|°|°C|C|K|%|rpm|rev|inc|counts?|ticks?|psi|in|ft|lb|1)"
    r"(?:[*·./^ ]?(?:[munkc]?(?:s|m|g|N|V|A|Hz|rad)|min|h|deg|rev|[-²³0-9]))*"
)
"""What a row of units may hold in a cell."""

_NOTES = ("", "comment", "comments", "note", "notes", "remark", "remarks")
"""Names of a last column below which lines may have no cell, as in LabVIEW's measurement files."""


@dataclass(frozen=True)
class Line:
    """A line of a log, or several that a quoted cell makes one."""

    number: int
    begin: int
    end: int
    text: bytes
    idle: bool

    def cells(self, delimiter: str | None) -> list[str]:
        """The cells, none where a quote is out of place."""
        found = text_cells(self.text, None if delimiter is None else ord(delimiter))
        return [] if found is None else [cell.decode(errors="replace") for cell in found]


@dataclass(frozen=True)
class Head:
    """How a log is to be read."""

    delimiter: str | None
    names: list[str]
    has_header: bool
    header: bytes
    begin: int
    """Place of the first sample in the bytes that were looked at."""
    line: int
    """And its line, counted from 1."""
    trailing: bool
    kinds: list[str | None]
    """What each column holds: "number", "moment", "daytime", "missing"; None: text."""
    cells: list[str]
    """The first cell of each column that is not missing."""
    remarks: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)

    @property
    def of_numbers(self) -> bool:
        """Whether the header is of numbers, so that a line that repeats it could be a sample."""
        return self.has_header and any(map(_is_data, self.names))


def head_of(path: Path, start: bytes, wanted: Sequence[str], whole: bool) -> Head:
    """The head of a log that begins with these bytes, or is made of them."""
    lines = list(_lines(start, whole))
    rows = [line for line in lines if not line.idle]
    if not rows:
        raise DataError(f"{path} is empty")
    notes = [line for line in lines if line.idle and line.text.strip()]
    found = _named(rows, wanted) or _commented(rows, notes, wanted) or _guessed(rows)
    header, delimiter, names, first = found
    remarks: list[str] = []
    if header is None:
        names, first, remarks = _of_numbers(path, rows, first, delimiter)
        header = rows[first - 1] if names else None
    if header is None and not (wanted and all(name.isdecimal() for name in wanted)):
        header, names = _fitting(rows[first], notes, delimiter)
    above = [row for row in rows[:first] if row is not header]
    body = rows[first:]
    units: dict[str, str] = {}
    if header is not None and body:
        cells = body[0].cells(delimiter)
        if len(cells) == len(names) and _are_units(cells):
            told = {n: c.strip("[]() ") for n, c in zip(names, cells, strict=True)}
            units = {name: unit for name, unit in told.items() if re.search(r"\w|%|°", unit)}
            remarks.append(f"line {body[0].number} is read as units ({', '.join(cells)})")
            body = body[1:]
    if header in notes:
        remarks.append(f"names are those of the comment in line {header.number}")
    if above:
        remarks.append(f"passed over above the samples: {_span(above)}")
    tables = [row.cells(delimiter) for row in body]
    width, trailing = _width(names, tables)
    has_header = bool(names)
    if not names:
        names = [str(i) for i in range(width)]
    if "".join(names[width:]):
        remarks.append(f"{names[width]!r} is left out: no line has a cell below it")
    names = names[:width]
    cells = [_first([row[i] for row in tables if len(row) > i]) for i in range(len(names))]
    begin, line = (body[0].begin, body[0].number) if body else (len(start), rows[-1].number + 1)
    return Head(
        delimiter,
        names,
        has_header,
        b"" if header is None else header.text.strip(),
        begin,
        line,
        trailing,
        [_kind(cell, delimiter) if tables else "number" for cell in cells],
        cells,
        tuple(remarks),
        units,
    )


_Found = tuple[Line | None, str | None, list[str], int]
"""The header, what parts cells, the names, and the row at which samples begin."""


def _lines(start: bytes, whole: bool) -> list[Line]:
    """The lines at the begin, those of a quoted cell as one; the last only if it has its end."""
    found: list[Line] = []
    begin, number, rows = 0, 1, 0
    while begin < len(start) and rows < AHEAD + 2:
        end, count = begin, 0
        while True:
            end = start.find(b"\n", end) + 1
            if not end and not whole:
                return found
            end = end or len(start)
            count += 1
            text = start[begin:end]
            idle = text_is_idle(text)
            if idle or text.count(b'"') % 2 == 0 or end == len(start) or count > AHEAD:
                break
        found.append(Line(number, begin, end, text.rstrip(b"\r\n"), idle))
        begin, number, rows = end, number + count, rows + (not idle)
    return found


def _named(rows: list[Line], wanted: Sequence[str]) -> _Found | None:
    """The first line that holds all wanted names and is not of numbers alone."""
    for i, row in enumerate(rows) if wanted else ():
        for delimiter in _DELIMITERS:
            cells = row.cells(delimiter)
            if set(wanted) <= set(cells) and not all(map(_is_data, cells)):
                return row, delimiter, cells, i + 1
    return None


def _commented(rows: list[Line], notes: list[Line], wanted: Sequence[str]) -> _Found | None:
    """The last comment that holds all wanted names."""
    if not wanted or not notes:
        return None
    delimiter = _delimiter(rows)
    for note in reversed(notes):
        first = next((i for i, row in enumerate(rows) if row.number > note.number), None)
        if first is None:
            continue
        names = _names_of(note, wanted)
        if names and len(rows[first].cells(delimiter)) in (len(names), len(names) + 1):
            return note, delimiter, names, first
    return None


def _names_of(note: Line, wanted: Sequence[str]) -> list[str]:
    """The names in a comment, where it holds all that are wanted."""
    text = re.sub(rb"^\s*(?:#+|%+|//+)\s*", b"", note.text)
    bare = Line(note.number, note.begin, note.end, text, False)
    for delimiter in _DELIMITERS:
        cells = bare.cells(delimiter)
        if len(cells) > 1 and set(wanted) <= set(cells):
            return cells
    return []


def _fitting(row: Line, notes: list[Line], delimiter: str | None) -> tuple[Line | None, list[str]]:
    """The last comment above the samples that has a word for each column, none of them a number."""
    width = len(row.cells(delimiter))
    for note in [note for note in notes if note.number < row.number][-1:]:
        names = _names_of(note, ())
        if len(set(names)) == len(names) == width > 1 and not any(map(_is_data, names)):
            return note, names
    return None, []


def _guessed(rows: list[Line]) -> _Found:
    """The line of text above the numbers, where there is one."""
    delimiter = _delimiter(rows)
    tables = [row.cells(delimiter) for row in rows]
    width = _usual([len(cells) for cells in tables])
    first = _first_sample([len(cells) == width and _is_sample(cells) for cells in tables])
    if first is None:
        return rows[0], delimiter, tables[0], 1
    header = first
    while header and _fits(tables[header - 1], tables[first]):
        header -= 1
    if header == first:
        return None, delimiter, [], first
    last = first - 1
    header = last - 1 if header < last and _are_units(tables[last]) else last
    return rows[header], delimiter, tables[header], header + 1


def _first_sample(found: list[bool]) -> int | None:
    """Where samples begin: at the first of three on end, since a setting above the header may look
    like one (`Rate;200`), else at the first.
    """
    places = [i for i, is_sample in enumerate(found) if is_sample]
    runs = (i for i in places if found[i : i + 3] == [True] * 3)
    return next(runs, places[0] if places else None)


def _fits(cells: list[str], sample: list[str]) -> bool:
    """Whether a line has a cell for each of a sample, but for delimiters at the ends."""
    longer = len(cells) == len(sample) + 1 and cells[-1].casefold() in _NOTES
    shorter = len(cells) == len(sample) - 1 > 0 and not sample[-1]
    return len(cells) == len(sample) or longer or shorter


def _delimiter(rows: list[Line]) -> str | None:
    """What makes the most lines equally long."""
    best, most = None, 0
    for delimiter in _DELIMITERS:
        widths = [len(row.cells(delimiter)) for row in rows]
        width = _usual(widths)
        count = widths.count(width)
        if width == 1 and (delimiter is not None or 2 * most > len(rows)):
            continue  # one column, where others explain most lines
        if count > most:
            best, most = delimiter, count
    return best


def _usual(widths: list[int]) -> int:
    return Counter(widths).most_common(1)[0][0]


def _width(names: list[str], tables: list[list[str]]) -> tuple[int, bool]:
    """Cells of a line, and whether a delimiter stands behind the last one."""
    if not tables:
        return len(names), False
    usual = _usual([len(cells) for cells in tables])
    if not names:
        return len(tables[0]), False
    if usual == len(names) + 1 and all(not c[-1] for c in tables if len(c) == usual):
        return len(names), True
    if usual == len(names) - 1 and names[-1].casefold() in _NOTES:
        return usual, False
    return len(names), False


def _is_data(cell: str) -> bool:
    return text_kind(cell.encode(), True) in _DATA


def _is_sample(cells: list[str]) -> bool:
    """Whether most cells of a line are numbers, dates or empty, some not empty."""
    kinds = [text_kind(cell.encode(), True) for cell in cells]
    data = sum(kind in _DATA for kind in kinds)
    return data > 0 and 2 * (data + kinds.count("missing")) >= len(cells)


def _are_units(cells: list[str]) -> bool:
    """Whether a line below the header holds units, or a rule."""
    return any(cells) and all(_UNIT.fullmatch(cell) for cell in cells) and not _is_sample(cells)


def _first(cells: list[str]) -> str:
    """The first cell that is not missing."""
    return next((cell for cell in cells if text_kind(cell.encode(), True) != "missing"), "")


def _kind(cell: str, delimiter: str | None) -> str | None:
    """What a column holds that begins with this cell."""
    return text_kind(cell.encode(), delimiter != ",")


def _span(rows: list[Line]) -> str:
    first, last = rows[0].number, rows[-1].number
    return f"line {first}" if first == last else f"lines {first} to {last}"


# --- a header of numbers -------------------------------------------------------------------------

_BARE = re.compile(r"0|[1-9]\d{0,8}")
_ZEROS_KEPT = re.compile(r"[-+]?\d+\.(?:\d*0)?(?:[eE][-+]?\d+)?")


def _of_numbers(
    path: Path, rows: list[Line], first: int, delimiter: str | None
) -> tuple[list[str], int, list[str]]:
    """Names and the row at which samples begin, where the first line of numbers may be a header.

    Different whole numbers without a point are one where the lines after them keep their decimal
    zeros, or are unquoted; and those that count from 0, as pandas names columns, where the first
    sample would leap. What could be either is refused.
    """
    cells = rows[first].cells(delimiter)
    names = cells[1:] if not cells[0] and len(cells) > 1 else cells  # an index has no name
    if not all(map(_BARE.fullmatch, names)) or len(set(names)) < len(names):
        return [], first, []
    after = [row.cells(delimiter) for row in rows[first + 1 :]]
    after = [row for row in after if len(row) == len(cells)]
    if not after:
        return [], first, []
    line, shown = rows[first].number, ", ".join(cells)
    header = cells, first + 1, [f"line {line} ({shown}) is read as a header"]
    columns = list(zip(*after, strict=True))[len(cells) - len(names) :]
    quoted = b'"' in rows[first].text and not any(b'"' in row.text for row in rows[first + 1 :])
    if quoted or any(map(_keeps_zeros, columns)):
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
    return [], first, []


def _as_number(cell: str) -> float | None:
    """The cell's number, NaN for a missing one, None for anything else."""
    kind = text_kind(cell.encode(), False)
    return math.nan if kind == "missing" else float(cell) if kind == "number" else None


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
