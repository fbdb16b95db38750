"""Times in two columns: seconds and nanoseconds, a date and a time of day."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from hgo_rs.logs.formats import tables
from hgo_rs.logs.table import ColumnError, DataError, Table, as_integers
from hgo_rs.times import UNITS, named_unit

_DAY = np.timedelta64(1, "D")


def timed(path: Path, time: str, signals: list[str], rows: int) -> Iterator[Table]:
    """The tables of a log with its time column, which may be called as the sum of two."""
    parts = [part.strip() for part in time.split("+")]
    if len(parts) != 2 or not all(parts):
        yield from tables(path, [time, *signals], rows)
        return
    try:
        found = tables(path, [*parts, *signals], rows)
        first = list(itertools.islice(found, 1))
    except ColumnError as error:
        try:
            yield from tables(path, [time, *signals], rows)
        except ColumnError:
            raise error from None
        return
    for table in itertools.chain(first, found):
        columns = {name: table.columns[name] for name in signals}
        yield replace(table, columns={time: _sum(path, table, parts), **columns})


def _sum(path: Path, table: Table, parts: list[str]) -> np.ndarray:
    """Both columns as one: a date and a time of day, or whole ticks of two units."""
    a, b = (table.columns[name] for name in parts)
    kinds = a.dtype.kind + b.dtype.kind
    if kinds in ("Mm", "mM"):
        date, clock = (a, b) if kinds == "Mm" else (b, a)
        return np.asarray(date + clock % _DAY)  # a time of day that goes on over midnight
    length = [_nanoseconds(path, table, name) for name in parts]
    whole = [as_integers(np.ma.getdata(column)) for column in (a, b)]
    for name, column in zip(parts, whole, strict=True):
        if column.dtype.kind not in "iu" or np.ma.is_masked(column):
            told = "must hold whole numbers to be a part of the time"
            raise DataError(f"{path}: column {name!r} {told}; fill in missing cells")
    total = np.asarray(whole[0], np.int64) * length[0] + np.asarray(whole[1], np.int64) * length[1]
    return total.astype("timedelta64[ns]")


def _nanoseconds(path: Path, table: Table, name: str) -> int:
    unit, _ = named_unit(f"t [{table.units[name]}]" if name in table.units else name)
    if unit is None:
        raise DataError(
            f"{path}: the unit of {name!r} is unknown; name the columns for example secs and nsecs"
        )
    return int(UNITS[unit] / UNITS["ns"])
