"""Recorded logs in, estimates out.

`read_log` reads CSV, `.npz`, `.mat` and Parquet; `write_table` writes CSV and Parquet. CSV and
`.npz` need NumPy alone, `.mat` needs SciPy, Parquet needs pyarrow (the extra `data`).
"""

from __future__ import annotations

import csv
import difflib
import math
from array import array
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from hgo_rs.errors import HgoError, MissingExtraError, check_number

__all__ = ["READABLE", "WRITABLE", "DataError", "Log", "read_log", "write_table"]

READABLE = (".csv", ".txt", ".tsv", ".dat", ".npz", ".mat", ".parquet", ".pq")
WRITABLE = (".csv", ".parquet", ".pq")

_TEXT = (".csv", ".txt", ".tsv", ".dat")
_PARQUET = (".parquet", ".pq")
_MISSING = frozenset({"", "nan", "na", "n/a", "null", "none"})


class DataError(HgoError):
    """A log that cannot be read as asked: names the file, the line and the remedy."""


@dataclass(frozen=True)
class Log:
    """A recorded log.

    Attributes
    ----------
    t : (N,) float, s
        Sample times, strictly increasing, steps as recorded.
    y : (N,) float
        Measured output; NaN where the sample is missing.
    u : (N,) float or None
        Known input.
    names : dict
        Column names: "time" (None if the time comes from `dt`), "output", "input".
    source : str
        The file.
    missing : (N,) bool
        Where the output is missing.
    """

    t: np.ndarray
    y: np.ndarray
    u: np.ndarray | None
    names: dict[str, str | None]
    source: str
    missing: np.ndarray

    @property
    def longest_gap(self) -> tuple[int, int]:
        """The longest run of missing samples, as a half-open range of indices; (0, 0): none."""
        edges = np.flatnonzero(np.diff(np.r_[0, self.missing.astype(np.int8), 0]))
        starts, stops = edges[::2], edges[1::2]
        if not len(starts):
            return 0, 0
        i = int(np.argmax(stops - starts))
        return int(starts[i]), int(stops[i])

    def describe(self) -> str:
        """Samples, span and missing samples in a line or two."""
        steps = np.diff(self.t)
        median = float(np.median(steps))
        text = (
            f"{len(self.t)} samples from {self.t[0]:g} s to {self.t[-1]:g} s, "
            f"median step {median:.6g} s"
        )
        widest = int(np.argmax(steps))
        if steps[widest] > 1.5 * median:
            text += f", longest step {steps[widest]:.6g} s at t = {self.t[widest]:g} s"
        count = int(self.missing.sum())
        if count:
            start, stop = self.longest_gap
            text += (
                f"\n{count} missing sample{'s' if count > 1 else ''}; the longest gap has "
                f"{stop - start}, from t = {self.t[start]:g} s to {self.t[stop - 1]:g} s"
            )
        return text


def read_log(
    path: str | Path,
    time: str | None,
    output: str,
    input: str | None = None,
    *,
    dt: float | None = None,
) -> Log:
    """Read a time column, an output column and, if named, an input column.

    A CSV file may have a header or none (its columns are then named 0, 1, 2, ...), be separated by
    tabs, semicolons, commas or blanks, and hold comment lines (#). A 2-D variable `q` of an `.npz`
    or `.mat` file has the columns `q[0]`, `q[1]`, ...

    Parameters
    ----------
    path
        The file; its suffix says the format.
    time, output, input
        Column names. `time` may be None if `dt` is given.
    dt
        Sampling period, s. With `time` too, the recorded times only have to agree with it (to half
        a period), and exact multiples of `dt` take their place.

    Raises
    ------
    DataError
        Unreadable or malformed file, unknown column, time that does not increase or is missing,
        an infinite output, a missing or infinite input. Names file, line and remedy.
    """
    path = Path(path)
    if dt is not None:
        dt = check_number(dt, "dt", above=0.0, error=DataError)
    if time is None and dt is None:
        raise DataError("name the time column, or give dt for a log without one")
    if not path.exists():
        near = _nearest(path.name, _siblings(path))
        raise DataError(f"no file {path}" + (f"; nearest: {', '.join(near)}" if near else ""))
    if path.is_dir():
        raise DataError(f"{path} is a folder; name a file ({', '.join(READABLE)})")
    suffix = path.suffix.lower()
    if suffix not in READABLE:
        raise DataError(f"{path}: unknown format {suffix!r}; known: {', '.join(READABLE)}")

    wanted = [name for name in (time, output, input) if name is not None]
    try:
        if suffix in _TEXT:
            table = _read_text(path, wanted)
        elif suffix == ".npz":
            table = _read_npz(path, wanted)
        elif suffix == ".mat":
            table = _read_mat(path, wanted)
        else:
            table = _read_parquet(path, wanted)
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}") from error

    y = _values(table, path, output)
    if len(y) < 2:
        raise DataError(f"{path}: {len(y)} samples; an observer needs at least 2")
    t = _sample_times(table, path, time, dt, len(y))
    _refuse(table, path, np.isinf(y), f"{output!r} is infinite; leave a missing sample empty")
    missing = np.isnan(y)
    if missing.all():
        raise DataError(f"{path}: column {output!r} holds no sample")
    u = None
    if input is not None:
        u = _values(table, path, input)
        _refuse(
            table, path, ~np.isfinite(u), f"the input {input!r} is missing or infinite; fill it in"
        )
    names = {"time": time, "output": output, "input": input}
    return Log(t, y, u, names, str(path), missing)


def write_table(path: str | Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write columns of equal length as CSV (NaN: empty cell) or Parquet, as the suffix says.

    Raises
    ------
    DataError
        Unknown suffix, or the file cannot be written.
    MissingExtraError
        Parquet without pyarrow.
    """
    path = Path(path)
    check_writable_format(path)
    try:
        if path.suffix.lower() in _PARQUET:
            import pyarrow
            import pyarrow.parquet

            pyarrow.parquet.write_table(pyarrow.table(dict(columns)), path)
            return
        cells = [
            ["" if isinstance(v, float) and math.isnan(v) else v for v in column.tolist()]
            for column in columns.values()
        ]
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*cells, strict=True))
    except OSError as error:
        raise DataError(f"cannot write {path}: {error.strerror or error}") from error


def check_writable_format(path: Path) -> None:
    """Refuse what `write_table` could not write, before any work is done for it."""
    suffix = path.suffix.lower()
    if suffix not in WRITABLE:
        raise DataError(f"{path}: unknown format {suffix!r}; known: {', '.join(WRITABLE)}")
    if suffix in _PARQUET:
        _need_pyarrow(path)


# --- checks ----------------------------------------------------------------------------------


@dataclass
class _Table:
    """The wanted columns, and where a sample stands in the file."""

    columns: dict[str, np.ndarray]
    where: Callable[[int], str]


def _row(index: int) -> str:
    return f"row {index} (counted from 0)"


def _refuse(table: _Table, path: Path, bad: np.ndarray, what: str) -> None:
    """Raise at the first sample where `bad` holds."""
    if bad.any():
        raise DataError(f"{path}, {table.where(int(np.argmax(bad)))}: {what}")


def _sample_times(
    table: _Table, path: Path, time: str | None, dt: float | None, count: int
) -> np.ndarray:
    if time is None:
        assert dt is not None
        return dt * np.arange(count)
    t = _values(table, path, time)
    if len(t) != count:
        raise DataError(f"{path}: {time!r} has {len(t)} samples, the output has {count}")
    _refuse(table, path, ~np.isfinite(t), f"the time {time!r} is missing or infinite")
    stuck = np.flatnonzero(np.diff(t) <= 0.0)
    if len(stuck):
        k = int(stuck[0]) + 1
        raise DataError(
            f"{path}, {table.where(k)}: time {t[k]:.12g} does not come after {t[k - 1]:.12g} "
            f"({table.where(k - 1)}); time must increase: sort the log or remove repeated rows"
        )
    if dt is None:
        return t
    regular: np.ndarray = t[0] + dt * np.arange(count)
    off = np.abs(t - regular) > 0.5 * dt
    if off.any():
        k = int(np.argmax(off))
        raise DataError(
            f"{path}, {table.where(k)}: time {t[k]:g} s is not sample {k} of a record with "
            f"dt = {dt:g} s ({regular[k]:g} s); leave dt out to honour uneven steps"
        )
    return regular


def _values(table: _Table, path: Path, name: str) -> np.ndarray:
    """A column as float64; times of day become seconds since the first sample."""
    values = table.columns[name]
    if values.dtype.kind in "Mm":
        since = values - values[:1] if values.dtype.kind == "M" else values
        seconds = since.astype("timedelta64[ns]").astype(np.float64) * 1e-9
        seconds[np.isnat(values)] = np.nan
        return seconds
    if values.dtype.kind not in "fiub":
        raise DataError(f"{path}: column {name!r} holds {values.dtype}, not numbers")
    return np.ascontiguousarray(values, dtype=np.float64)


def _require(path: Path, wanted: list[str], known: list[str], remark: str = "") -> None:
    """Every wanted column is there, once."""
    for name in wanted:
        if name not in known:
            near = _nearest(name, known)
            hint = f"; nearest: {', '.join(near)}" if near else ""
            shown = ", ".join(known[:20]) + (", ..." if len(known) > 20 else "")
            raise DataError(f"{path} has no column {name!r}{remark}{hint}. Columns: {shown}")
        if known.count(name) > 1:
            raise DataError(f"{path}: {known.count(name)} columns are called {name!r}; rename one")


def _nearest(name: str, known: list[str]) -> list[str]:
    """The nearest known names, whatever the case."""
    folded = {k.casefold(): k for k in reversed(known)}
    return [folded[k] for k in difflib.get_close_matches(name.casefold(), folded, n=3, cutoff=0.4)]


def _siblings(path: Path) -> list[str]:
    try:
        return sorted(p.name for p in path.parent.iterdir() if p.suffix.lower() in READABLE)
    except OSError:
        return []


# --- formats ---------------------------------------------------------------------------------


def _read_text(path: Path, wanted: list[str]) -> _Table:
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        records = _records(path, file)
        first = next(records, None)
        if first is None:
            raise DataError(f"{path} is empty")
        line, cells = first
        has_header = any(_as_number(cell) is None for cell in cells)
        known = cells if has_header else [str(i) for i in range(len(cells))]
        remark = "" if has_header else " (no header: columns are named from 0)"
        _require(path, wanted, known, remark)
        at = [(name, known.index(name)) for name in wanted]
        columns = {name: array("d") for name in wanted}
        lines = array("q")

        def take(line: int, cells: list[str]) -> None:
            if len(cells) != len(known):
                raise DataError(
                    f"{path}, line {line}: {_cells(len(cells))} where {_cells(len(known))} are "
                    "expected; complete or remove the line"
                )
            for name, index in at:
                number = _as_number(cells[index])
                if number is None:
                    comma = "; write a decimal point" if "," in cells[index] else ""
                    raise DataError(
                        f"{path}, line {line}, column {name!r}: {cells[index]!r} is not a "
                        f"number{comma}"
                    )
                columns[name].append(number)
            lines.append(line)

        if not has_header:
            take(line, cells)
        for line, cells in records:
            take(line, cells)
    return _Table(
        {name: np.array(values, dtype=np.float64) for name, values in columns.items()},
        lambda index: f"line {lines[index]}",
    )


def _records(path: Path, file: IO[str]) -> Iterator[tuple[int, list[str]]]:
    """(line number, stripped cells) of every line that is neither blank nor a comment."""
    start = file.tell()
    delimiter = None
    for text in iter(file.readline, ""):
        if text.strip() and not text.lstrip().startswith("#"):
            delimiter = next((d for d in "\t;," if d in text), None)
            break
    file.seek(start)
    if delimiter is None:  # blanks
        for number, text in enumerate(file, 1):
            if text.strip() and not text.lstrip().startswith("#"):
                yield number, text.split()
        return
    reader = csv.reader(file, delimiter=delimiter, skipinitialspace=True, strict=True)
    line = 1
    try:
        for cells in reader:
            blank = len(cells) <= 1 and not "".join(cells).strip()
            if not blank and not cells[0].lstrip().startswith("#"):
                yield line, [cell.strip() for cell in cells]
            line = reader.line_num + 1
    except csv.Error as error:
        raise DataError(f"{path}, line {line}: {error}") from error


def _as_number(cell: str) -> float | None:
    """The cell's number, NaN for a missing one, None for anything else."""
    if cell.casefold() in _MISSING:
        return math.nan
    if "_" in cell:  # Python's float would read 1_0 as 10
        return None
    try:
        return float(cell)
    except ValueError:
        return None


def _cells(count: int) -> str:
    return f"{count} cell{'' if count == 1 else 's'}"


def _read_npz(path: Path, wanted: list[str]) -> _Table:
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except OSError:
        raise
    except Exception as error:  # not a zip file, pickled objects, truncated members
        raise DataError(f"{path} is not a readable .npz file: {error}") from error
    return _from_arrays(path, arrays, wanted)


def _read_mat(path: Path, wanted: list[str]) -> _Table:
    import scipy.io

    try:
        variables = scipy.io.loadmat(path)
    except OSError:
        raise
    except NotImplementedError as error:
        raise DataError(
            f"{path} is a MATLAB 7.3 (HDF5) file; save it with -v7 to read it here"
        ) from error
    except Exception as error:  # scipy raises many kinds on broken files
        raise DataError(f"{path} is not a readable .mat file: {error}") from error
    arrays = {name: value for name, value in variables.items() if not name.startswith("__")}
    return _from_arrays(path, arrays, wanted)


def _from_arrays(path: Path, arrays: Mapping[str, Any], wanted: list[str]) -> _Table:
    columns: dict[str, np.ndarray] = {}
    for name, value in arrays.items():
        if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiubMm" or value.size < 2:
            continue  # text, structures, single numbers: not a column
        value = np.squeeze(value)
        if value.ndim == 1:
            columns[name] = value
        elif value.ndim == 2:
            long = value if value.shape[0] >= value.shape[1] else value.T
            columns.update({f"{name}[{i}]": long[:, i] for i in range(long.shape[1])})
    _require(path, wanted, list(columns))
    lengths = {name: len(columns[name]) for name in wanted}
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{name}: {length}" for name, length in lengths.items())
        raise DataError(f"{path}: the columns differ in length ({told})")
    return _Table({name: columns[name] for name in wanted}, _row)


def _read_parquet(path: Path, wanted: list[str]) -> _Table:
    _need_pyarrow(path)
    import pyarrow
    import pyarrow.parquet

    try:
        _require(path, wanted, list(pyarrow.parquet.read_schema(path).names))
        table = pyarrow.parquet.read_table(path, columns=list(dict.fromkeys(wanted)))
    except pyarrow.ArrowException as error:
        raise DataError(f"{path} is not a readable Parquet file: {error}") from error
    return _Table({name: table[name].to_numpy() for name in wanted}, _row)


def _need_pyarrow(path: Path) -> None:
    try:
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise MissingExtraError(f"{path}: Parquet needs pip install 'hgo_rs[data]'") from error
