"""Logs in Parquet."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs.errors import need
from hgo_rs.logs.table import DataError, Table, require, rows_from

PARQUET = (".parquet", ".pq")


def read_parquet(path: Path, wanted: list[str], rows: int) -> Iterator[Table]:
    need("pyarrow", f"{path}: Parquet needs pyarrow", "data")
    import pyarrow
    import pyarrow.parquet

    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            require(path, wanted, list(file.schema_arrow.names))
            first = 0
            for batch in file.iter_batches(rows, columns=list(dict.fromkeys(wanted))):
                columns = {name: _from_arrow(batch.column(name)) for name in wanted}
                yield Table(columns, rows_from(first))
                first += len(batch)
    except pyarrow.ArrowException as error:
        raise DataError(f"{path} is not a readable Parquet file: {error}") from error


def _from_arrow(column: Any) -> np.ndarray:
    import pyarrow

    if column.null_count and pyarrow.types.is_integer(column.type):
        gone = column.is_null().to_numpy(zero_copy_only=False)
        return np.ma.array(column.fill_null(0).to_numpy(), mask=gone)
    return np.asarray(column.to_numpy(zero_copy_only=False))
