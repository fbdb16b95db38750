"""Recorded logs: read, run an observer over them, and write what it gives."""

from __future__ import annotations

from hgo_rs.logs.estimation import estimate, run_chunks
from hgo_rs.logs.log import Log, LogSummary
from hgo_rs.logs.overview import Look, column_names, look
from hgo_rs.logs.read import read_chunks, read_log
from hgo_rs.logs.table import READABLE, DataError
from hgo_rs.logs.write import WRITABLE, TableWriter, write_table

__all__ = [
    "READABLE",
    "WRITABLE",
    "DataError",
    "Log",
    "LogSummary",
    "Look",
    "TableWriter",
    "column_names",
    "estimate",
    "look",
    "read_chunks",
    "read_log",
    "run_chunks",
    "write_table",
]
