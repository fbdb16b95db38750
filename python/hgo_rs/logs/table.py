"""Columns of a log as a format gives them, and what is refused in them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

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

Columns = str | Sequence[str]


class DataError(HgoError):
    """A log that cannot be read as asked: names the file, the line and the remedy."""


@dataclass
class Table:
    """The wanted columns, where a sample stands in the file, and what was found out.

    Integers with missing cells are masked: as float64 they might lose digits.
    """

    columns: dict[str, np.ndarray]
    where: Callable[[int], str]
    remarks: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))


def rows_at(table: Table, at: np.ndarray) -> Callable[[int], str]:
    return lambda index: table.where(int(at[index]))


def names_of(given: Columns, parameter: str) -> list[str]:
    names = [given] if isinstance(given, str) else list(given)
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
        raise DataError(f"{path}: column {name!r} holds {values.dtype}, not numbers")
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
            shown = ", ".join(known[:20]) + (", ..." if len(known) > 20 else "")
            raise DataError(f"{path} has no column {name!r}{remark}{hint}. Columns: {shown}")
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
