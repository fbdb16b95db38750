"""Logs of whole arrays: `.npz` and `.mat`."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hgo_rs.logs.table import DataError, Table, require, row

_COLUMN_KINDS = "fiubMm"
_MAT_SIZES = {"logical": 1, "single": 4} | {
    f"{sign}int{bits}": bits // 8 for sign in ("", "u") for bits in (8, 16, 32, 64)
}


def read_npz(path: Path, wanted: list[str]) -> Table:
    headers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    try:
        with zipfile.ZipFile(path) as archive:
            shapes: dict[str, tuple[tuple[int, ...], int]] = {}
            for info in archive.infolist():
                with archive.open(info) as file:
                    read = headers.get(np.lib.format.read_magic(file))
                    if read is None:
                        continue
                    shape, _, dtype = read(file)
                if dtype.kind in _COLUMN_KINDS:
                    shapes[info.filename.removesuffix(".npy")] = shape, info.file_size
            home = _columns_of(shapes)
            require(path, wanted, list(home))
            needed = {home[name][0] for name in wanted}
            _check_size(path, sum(shapes[name][1] for name in needed))
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in needed}
    except (OSError, DataError):
        raise
    except Exception as error:  # not a zip file, pickled objects, truncated members
        raise DataError(f"{path} is not a readable .npz file: {error}") from error
    return _taken(arrays, home, wanted)


def read_mat(path: Path, wanted: list[str]) -> Table:
    import scipy.io

    try:
        shapes = {
            name: (shape, math.prod(shape) * _MAT_SIZES.get(kind, 8))
            for name, shape, kind in scipy.io.whosmat(path)
            if kind == "double" or kind in _MAT_SIZES
        }
        home = _columns_of(shapes)
        require(path, wanted, list(home))
        needed = {home[name][0] for name in wanted}
        _check_size(path, sum(shapes[name][1] for name in needed))
        arrays = scipy.io.loadmat(path, variable_names=list(needed))
    except (OSError, DataError):
        raise
    except NotImplementedError as error:
        raise DataError(
            f"{path} is a MATLAB 7.3 (HDF5) file; save it with -v7 to read it here"
        ) from error
    except Exception as error:  # scipy raises many kinds on broken files
        raise DataError(f"{path} is not a readable .mat file: {error}") from error
    return _taken(arrays, home, wanted)


def _columns_of(
    shapes: Mapping[str, tuple[tuple[int, ...], int]],
) -> dict[str, tuple[str, int | None]]:
    """Each column's array, and its place there; single numbers and cubes hold none."""
    home: dict[str, tuple[str, int | None]] = {}
    for name, (shape, _) in shapes.items():
        sizes = [size for size in shape if size != 1]
        if len(sizes) == 1 and sizes[0] >= 2:
            home[name] = name, None
        elif len(sizes) == 2 and min(sizes) >= 1:
            home |= {f"{name}[{i}]": (name, i) for i in range(min(min(sizes), 10_000))}
    return home


def _check_size(path: Path, size: int) -> None:
    """Refuse what would not fit into memory, before it is unpacked."""
    import psutil

    free = psutil.virtual_memory().available
    if size > free / 2:
        raise DataError(
            f"{path}: the columns unpack to {size / 2**30:.3g} GiB, {free / 2**30:.3g} GiB of "
            "memory are free; write them as CSV or Parquet, which are read in parts"
        )


def _taken(
    arrays: Mapping[str, np.ndarray], home: Mapping[str, tuple[str, int | None]], wanted: list[str]
) -> Table:
    columns = {}
    for name in wanted:
        array, column = home[name]
        value = np.squeeze(arrays[array])
        if column is not None:
            value = (value if value.shape[0] >= value.shape[1] else value.T)[:, column]
        columns[name] = value
    return Table(columns, row)
