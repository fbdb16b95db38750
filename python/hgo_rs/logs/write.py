"""Tables out: CSV and Parquet."""

from __future__ import annotations

import contextlib
import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np

from hgo_rs._core import text_lines
from hgo_rs.errors import need
from hgo_rs.files import replacing
from hgo_rs.logs.parquet import PARQUET
from hgo_rs.logs.table import DataError

WRITABLE = (".csv", ".parquet", ".pq")


class TableWriter:
    """Writes columns chunk by chunk as CSV (NaN: empty cell) or Parquet, as the suffix says.

    A context manager: the file takes its name when the block ends well; a block that fails leaves
    nothing behind. With `into`, an open binary file, rows are written there, and `path` says the
    format alone.
    """

    def __init__(self, path: str | Path, into: IO[bytes] | None = None) -> None:
        self.path = Path(path)
        check_writable_format(self.path)
        self._into = into
        self._file = contextlib.ExitStack()
        self._text: IO[bytes] | None = None
        self._parquet: Any = None

    def __enter__(self) -> TableWriter:
        return self

    def write(self, columns: Mapping[str, np.ndarray]) -> None:
        """Append rows; the first call says the columns."""
        try:
            if self.path.suffix.lower() in PARQUET:
                self._write_parquet(columns)
            else:
                self._write_text(columns)
        except OSError as error:
            raise self._refused(error) from error

    def __exit__(self, kind: type[BaseException] | None, error: Any, trace: Any) -> None:
        try:
            self._file.__exit__(kind, error, trace)
        except OSError as failure:
            raise self._refused(failure) from failure
        if kind is None and self._text is None and self._parquet is None:
            raise DataError(f"cannot write {self.path}: no columns were given; call write before")

    def _refused(self, error: OSError) -> DataError:
        return DataError(f"cannot write {self.path}: {error.strerror or error}")

    def _place(self) -> contextlib.AbstractContextManager[IO[bytes]]:
        return replacing(self.path) if self._into is None else contextlib.nullcontext(self._into)

    def _write_text(self, columns: Mapping[str, np.ndarray]) -> None:
        if self._text is None:
            self._text = self._file.enter_context(self._place())
            header = io.StringIO()
            csv.writer(header, lineterminator="\n").writerow(columns)
            self._text.write(header.getvalue().encode())
        lengths = {name: len(column) for name, column in columns.items()}
        if len(set(lengths.values())) > 1:
            told = ", ".join(f"{name}: {length}" for name, length in lengths.items())
            raise DataError(f"cannot write {self.path}: the columns differ in length ({told})")
        self._text.write(text_lines([_plain(column) for column in columns.values()]))

    def _write_parquet(self, columns: Mapping[str, np.ndarray]) -> None:
        import pyarrow
        import pyarrow.parquet

        table = pyarrow.table(dict(columns))
        if self._parquet is None:
            file = self._file.enter_context(self._place())
            writer = pyarrow.parquet.ParquetWriter(file, table.schema)
            self._parquet = self._file.enter_context(writer)
        self._parquet.write_table(table)


def _plain(column: np.ndarray) -> np.ndarray:
    """A column as float64, or int64 where it holds whole numbers."""
    whole = column.dtype.kind in "iub"
    return np.ascontiguousarray(column, dtype=np.int64 if whole else np.float64)


def write_table(path: str | Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns of equal length as CSV (NaN: empty cell) or Parquet, as the suffix says.

    Raises
    ------
    DataError
        Unknown suffix, or the file cannot be written.
    MissingExtraError
        Parquet without pyarrow.
    """
    with TableWriter(path) as writer:
        writer.write(columns)


def check_writable_format(path: Path) -> None:
    """Refuse what `write_table` could not write, before any work is done for it."""
    suffix = path.suffix.lower()
    if suffix not in WRITABLE:
        raise DataError(f"{path}: unknown format {suffix!r}; known: {', '.join(WRITABLE)}")
    if suffix in PARQUET:
        need("pyarrow", f"{path}: Parquet needs pyarrow", "data")
