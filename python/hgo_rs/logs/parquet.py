"""Logs in Parquet and in Feather (Arrow files), by the library pyarrow."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs.errors import need
from hgo_rs.logs.table import DataError, Table, require, rows_from

PARQUET = (".parquet", ".pq")
_FEATHER = (".feather", ".arrow")
ARROW = (*PARQUET, *_FEATHER)


def read_arrow(path: Path, wanted: list[str], rows: int) -> Iterator[Table]:
    kind = "Feather" if path.suffix.lower() in _FEATHER else "Parquet"
    need("pyarrow", f"{path}: {kind} needs pyarrow", "data")
    import pyarrow

    first = 0
    try:
        for batch in (_feather if kind == "Feather" else _parquet)(path, wanted, rows):
            columns = {name: _from_arrow(batch.column(name)) for name in wanted}
            yield Table(columns, rows_from(first))
            first += len(batch)
    except pyarrow.ArrowException as error:
        raise DataError(f"{path} is not a readable {kind} file: {error}") from error


def _parquet(path: Path, wanted: list[str], rows: int) -> Iterator[Any]:
    import pyarrow.parquet

    with pyarrow.parquet.ParquetFile(path) as file:
        require(path, wanted, list(file.schema_arrow.names))
        yield from file.iter_batches(rows, columns=list(dict.fromkeys(wanted)))


def _feather(path: Path, wanted: list[str], rows: int) -> Iterator[Any]:
    import pyarrow

    with pyarrow.memory_map(str(path)) as source, pyarrow.ipc.open_file(source) as file:
        require(path, wanted, list(file.schema.names))
        for number in range(file.num_record_batches):
            batch = file.get_batch(number).select(list(dict.fromkeys(wanted)))
            yield from (batch.slice(first, rows) for first in range(0, len(batch), rows))


def _from_arrow(column: Any) -> np.ndarray:
    import pyarrow

    if column.null_count and pyarrow.types.is_integer(column.type):
        gone = column.is_null().to_numpy(zero_copy_only=False)
        return np.ma.array(column.fill_null(0).to_numpy(), mask=gone)
    return np.asarray(column.to_numpy(zero_copy_only=False))
