"""Columns of a log as a format gives them, and what is refused in them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs.errors import HgoError, nearest

RECORDINGS = {
    "a ROS bag": (".bag", ".mcap", ".db3"),
    "a ULog file": (".ulg", ".ulog"),
    "an HDF5 file": (".h5", ".hdf5", ".hdf"),
    "a TDMS file": (".tdms",),
    "an MDF file": (".mf4", ".mdf"),
    "an Excel workbook": (".xlsx", ".xlsm"),
}
"""Files that the libraries of the extra `logs` read, by their suffixes."""
READABLE = (
    *(".csv", ".txt", ".tsv", ".dat", ".npz", ".mat", ".parquet", ".pq", ".feather", ".arrow"),
    *(suffix for suffixes in RECORDINGS.values() for suffix in suffixes),
)
CHUNK = 65_536
"""Rows of a chunk."""

Columns = str | int | Sequence[str | int]
"""A name or several; a column without a name is called by its place, from 0."""


class DataError(HgoError):
    """A log that cannot be read as asked: names the file, the line and the remedy."""


class ColumnError(DataError):
    """A column that is not there, and those that are."""

    def __init__(self, told: str, known: list[str]) -> None:
        super().__init__(told)
        self.known = known


class CellError(DataError):
    """A cell of a column that holds something else than the others."""

    def __init__(self, told: str, column: str) -> None:
        super().__init__(told)
        self.column = column


@dataclass
class Table:
    """The wanted columns, where a sample stands in the file, what was found out, and the units that
    the file says of columns.

    Integers with missing cells are masked: as float64 they might lose digits.
    """

    columns: dict[str, np.ndarray]
    where: Callable[[int], str]
    remarks: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))


def rows_at(table: Table, at: np.ndarray) -> Callable[[int], str]:
    return lambda index: table.where(int(at[index]))


def by_name(given: Columns | None) -> Any:
    """Names as texts: None, one, or a list."""
    if given is None or isinstance(given, (str, int)):
        return None if given is None else str(given)
    return [str(one) for one in given]


def names_of(given: Columns, parameter: str) -> list[str]:
    named = by_name(given)
    names: list[str] = [named] if isinstance(named, str) else named
    if not names:
        raise DataError(f"{parameter}: no column is named; name one, or leave it out")
    return names


def row(index: int) -> str:
    return f"row {index} (counted from 0)"


def rows_from(first: int) -> Callable[[int], str]:
    return lambda index: row(first + index)


def refuse(table: Table, path: Path, bad: np.ndarray, what: str) -> None:
    """Raise at the first sample where `bad` holds."""
    if bad.any():
        raise DataError(f"{path}, {table.where(int(np.argmax(bad)))}: {what}")


def values_of(table: Table, path: Path, name: str) -> np.ndarray:
    """A column as float64."""
    values = table.columns[name]
    if values.dtype.kind not in "fiub":
        remedy = "; write its real part, or its magnitude" if values.dtype.kind == "c" else ""
        raise DataError(f"{path}: column {name!r} holds {values.dtype}, not numbers{remedy}")
    out = np.ascontiguousarray(np.ma.getdata(values), dtype=np.float64)
    if np.ma.isMaskedArray(values):
        out = np.where(np.ma.getmaskarray(values), np.nan, out)
    return out


def require(path: Path, wanted: list[str], known: list[str], remark: str = "") -> None:
    """Every wanted column is there, once."""
    for name in wanted:
        if name not in known:
            near = nearest(name, known)
            hint = f"; nearest: {', '.join(near)}" if near else ""
            shown = ", ".join(name or "''" for name in known[:20]) + (
                ", ..." if len(known) > 20 else ""
            )
            told = f"{path} has no column {name!r}{remark}{hint}. Columns: {shown}"
            raise ColumnError(told, known)
        if known.count(name) > 1:
            raise DataError(f"{path}: {known.count(name)} columns are called {name!r}; rename one")


def siblings(path: Path) -> list[str]:
    try:
        return sorted(p.name for p in path.parent.iterdir() if p.suffix.lower() in READABLE)
    except OSError:
        return []


def as_integers(values: np.ndarray) -> np.ndarray:
    """Whole float64 numbers as int64, masked where NaN; anything else as it is."""
    if values.dtype.kind != "f":
        return values
    gone = np.isnan(values)
    there = np.where(gone, 0.0, values)
    if not (np.all(np.abs(there) < 2.0**63) and np.all(there == np.trunc(there))):
        return values
    whole = there.astype(np.int64)
    return np.ma.array(whole, mask=gone) if gone.any() else whole
