"""A file of any format as tables."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import numpy as np

from hgo_rs.errors import HgoError, need
from hgo_rs.logs import bags, excel, hdf5, mf4, tdms, ulog
from hgo_rs.logs.arrays import read_mat, read_npz
from hgo_rs.logs.parquet import ARROW, read_arrow
from hgo_rs.logs.recording import Recording
from hgo_rs.logs.streams import suffix_of
from hgo_rs.logs.table import CHUNK, RECORDINGS, DataError, Table, as_integers, require, row
from hgo_rs.logs.text import TEXT, read_text


def tables(path: Path, wanted: list[str], rows: int) -> Iterator[Table]:
    """The wanted columns, in blocks of about so many rows where the format allows it."""
    suffix = suffix_of(path)
    try:
        if suffix in TEXT:
            yield from read_text(path, wanted, rows)
        elif suffix in ARROW:
            yield from read_arrow(path, wanted, rows)
        else:
            yield _same_length(path, whole(path, wanted))
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror or error}") from error


def whole(path: Path, wanted: list[str]) -> Table:
    """All of the wanted columns; those of `.npz` and `.mat` may differ in length."""
    suffix = suffix_of(path)
    if kind := recording_kind(path):
        with recording(path, kind) as found:
            places = _places(path, wanted, found)
            columns = found.load(list(dict.fromkeys(places.values())))
            return Table({name: columns[places[name]] for name in places}, row, found.remarks)
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

    return Table(columns, where, blocks[-1].remarks, blocks[0].units)


_OPENED: dict[str, tuple[str, Callable[[Path], AbstractContextManager[Recording]]]] = {
    "a ROS bag": ("rosbags", bags.opened),
    "a ULog file": ("pyulog", ulog.opened),
    "an HDF5 file": ("h5py", hdf5.opened),
    "a TDMS file": ("nptdms", tdms.opened),
    "an MDF file": ("asammdf", mf4.opened),
    "an Excel workbook": ("openpyxl", excel.opened),
}
"""The library that reads each kind of `RECORDINGS`, and how a file is opened."""
_HDF5 = b"\x89HDF\r\n\x1a\n"
_IN_MAT = 512
"""Where HDF5 begins in a MATLAB file of version 7.3."""


def recording_kind(path: Path) -> str | None:
    """Which of `RECORDINGS` a file is; None: another format."""
    suffix = path.suffix.lower()
    if is_bag_folder(path):
        return "a ROS bag"
    if suffix == ".mat":
        with path.open("rb") as file:
            file.seek(_IN_MAT)
            return "an HDF5 file" if file.read(len(_HDF5)) == _HDF5 else None
    return next((kind for kind, suffixes in RECORDINGS.items() if suffix in suffixes), None)


def is_bag_folder(path: Path) -> bool:
    """A bag of ROS 2 is a folder of data and metadata."""
    return path.is_dir() and (path / "metadata.yaml").is_file()


@contextmanager
def recording(path: Path, kind: str) -> Iterator[Recording]:
    """An open file of the extra `logs`."""
    library, opened = _OPENED[kind]
    need(library, f"{path}: {kind} is read by {library}", "logs")
    try:
        with opened(path) as found:
            yield found
    except (OSError, HgoError) as error:
        if isinstance(error, HgoError) or error.errno is not None:
            raise
        raise DataError(f"{path} is not a readable {kind.split(' ', 1)[1]}: {error}") from error
    except Exception as error:  # the libraries raise many kinds on files that are cut off
        what = f"{type(error).__name__}: {error}"
        raise DataError(f"{path} is not a readable {kind.split(' ', 1)[1]}: {what}") from error


def _places(path: Path, wanted: list[str], found: Recording) -> dict[str, str]:
    """The columns that are meant: paths may begin with a slash, as HDF5 writes them."""
    places = {n: n if n in found.clocks else n.removeprefix("/") for n in wanted}
    require(
        path, [n if places[n] not in found.clocks else places[n] for n in wanted], [*found.clocks]
    )
    return places


def clocks_of(path: Path, columns: list[str]) -> list[str] | None:
    """The column of the times of each column; None where the file does not say it of all."""
    kind = recording_kind(path)
    if kind is None:
        return None
    with recording(path, kind) as found:
        clocks = [found.clocks[place] for place in _places(path, columns, found).values()]
    told = [clock for clock in clocks if clock is not None]
    return told if len(told) == len(clocks) else None


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
