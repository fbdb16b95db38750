"""A file of any format as tables."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from hgo_rs.logs.arrays import read_mat, read_npz
from hgo_rs.logs.parquet import PARQUET, read_parquet
from hgo_rs.logs.table import CHUNK, DataError, Table, as_integers
from hgo_rs.logs.text import TEXT, read_text


def tables(path: Path, wanted: list[str], rows: int) -> Iterator[Table]:
    """The wanted columns, in blocks of about so many rows where the format allows it."""
    suffix = path.suffix.lower()
    try:
        if suffix in TEXT:
            yield from read_text(path, wanted, rows)
        elif suffix in PARQUET:
            yield from read_parquet(path, wanted, rows)
        else:
            yield _same_length(path, whole(path, wanted))
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}") from error


def whole(path: Path, wanted: list[str]) -> Table:
    """All of the wanted columns; those of `.npz` and `.mat` may differ in length."""
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return read_npz(path, wanted)
    if suffix == ".mat":
        return read_mat(path, wanted)
    blocks = list(tables(path, wanted, CHUNK))
    if len(blocks) == 1:
        return blocks[0]
    if not blocks:
        raise DataError(f"{path}: 0 samples; an observer needs at least 2")
    columns = {n: joined([b.columns[n] for b in blocks]) for n in blocks[0].columns}
    ends = np.cumsum([len(block) for block in blocks])

    def where(index: int) -> str:
        i = int(np.searchsorted(ends, index, side="right"))
        return blocks[i].where(index - (int(ends[i - 1]) if i else 0))

    return Table(columns, where, blocks[0].remarks)


def joined(parts: list[np.ndarray]) -> np.ndarray:
    """Parts of one column; where some hold integers, whole numbers of the others become such."""
    if any(part.dtype.kind in "iu" for part in parts):
        parts = [as_integers(part) for part in parts]
    masked = any(np.ma.isMaskedArray(part) for part in parts)
    return np.ma.concatenate(parts) if masked else np.concatenate(parts)


def _same_length(path: Path, table: Table) -> Table:
    lengths = {name: len(values) for name, values in table.columns.items()}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name}: {length}" for name, length in lengths.items())
        raise DataError(f"{path}: the columns differ in length ({told})")
    return table
