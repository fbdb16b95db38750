"""Workbooks of Excel (.xlsx), by the library openpyxl.

The first row of a sheet that is not empty holds the names; columns are `name`, and `sheet/name` in
every sheet but the first. What begins with text is no column.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs.logs.recording import Recording
from hgo_rs.logs.table import DataError


@contextmanager
def opened(path: Path) -> Iterator[Recording]:
    from openpyxl import load_workbook

    book = load_workbook(path, read_only=True, data_only=True)
    try:
        cells: dict[str, tuple[str, list[Any]]] = {}
        for number, sheet in enumerate(book.worksheets):
            rows = (row for row in sheet.iter_rows(values_only=True) if any(_filled(row)))
            header = next(rows, ())
            for name, *values in zip(header, *rows, strict=False):
                first = next((value for value in values if value is not None), None)
                if name is not None and not isinstance(first, str):
                    column = f"{sheet.title}/{name}" if number else str(name)
                    cells[column] = sheet.title, values
    finally:
        book.close()

    def load(names: list[str]) -> dict[str, np.ndarray]:
        return {name: _array(path, name, cells[name][1]) for name in names}

    yield Recording(dict.fromkeys(cells), load)


def _filled(row: tuple[Any, ...]) -> Iterator[bool]:
    return (cell is not None for cell in row)


def _array(path: Path, name: str, values: list[Any]) -> np.ndarray:
    """Numbers, dates or durations; NaN and NaT where a cell is empty."""
    while values and values[-1] is None:
        values.pop()
    there = [value for value in values if value is not None]
    if all(isinstance(value, int | float) for value in there):
        if len(there) == len(values) and all(isinstance(value, int) for value in there):
            return np.array(values)
        return np.array([np.nan if value is None else value for value in values], dtype=float)
    if all(isinstance(value, datetime.datetime) for value in there):
        return np.array(values, dtype="datetime64[us]")
    if all(isinstance(value, datetime.timedelta | datetime.time) for value in there):
        return np.array([_duration(value) for value in values], dtype="timedelta64[us]")
    wrong = next(value for value in there if not isinstance(value, int | float))
    raise DataError(
        f"{path}, column {name!r}, cell {values.index(wrong) + 1} below its name: {wrong!r} is no "
        "number; leave a missing sample empty"
    )


def _duration(value: datetime.timedelta | datetime.time | None) -> datetime.timedelta | None:
    """A time of day as the duration since midnight."""
    if not isinstance(value, datetime.time):
        return value
    return datetime.datetime.combine(datetime.date.min, value) - datetime.datetime.min
