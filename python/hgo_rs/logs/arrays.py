"""Logs of whole arrays: `.npz` and `.mat`."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs.logs.table import DataError, Table, require, row

_COLUMN_KINDS = "fiubMm"
_MAT_SIZES = {"logical": 1, "single": 4} | {
    f"{sign}int{bits}": bits // 8 for sign in ("", "u") for bits in (8, 16, 32, 64)
}


@dataclass(frozen=True)
class Array:
    """An array of a file: its variable, the way to it inside, its shape and its size in bytes."""

    variable: str
    way: tuple[str | int, ...]
    shape: tuple[int, ...]
    size: int


def read_npz(path: Path, wanted: list[str]) -> Table:
    headers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    found: dict[str, Array] = {}
    other: list[str] = []
    try:
        with zipfile.ZipFile(path) as archive:
            for info in archive.infolist():
                name = info.filename.removesuffix(".npy")
                with archive.open(info) as file:
                    read = headers.get(np.lib.format.read_magic(file))
                    if read is None:
                        continue
                    shape, _, dtype = read(file)
                if dtype.kind == "O":
                    other.append(f"{name} holds Python objects: save its arrays by their names")
                for way, inner, kind in _fields(dtype, shape):
                    if kind in _COLUMN_KINDS:
                        found[".".join([name, *way])] = Array(name, way, inner, info.file_size)
            home = _home(path, wanted, found, other)
            check_size(path, home, wanted)
        with np.load(path, allow_pickle=False) as file:
            held = {name: file[name] for name in {home[name][0].variable for name in wanted}}
    except (OSError, DataError):
        raise
    except Exception as error:  # not a zip file, pickled objects, truncated members
        raise DataError(f"{path} is not a readable .npz file: {error}") from error
    return taken(held, home, wanted)


def _fields(
    dtype: np.dtype[Any], shape: tuple[int, ...]
) -> Iterator[tuple[tuple[str, ...], tuple[int, ...], str]]:
    """The way to each field of a structured array, its shape and kind; of a plain one itself."""
    if dtype.names is None:
        base, inner = dtype.subdtype or (dtype, ())
        yield (), shape + inner, base.kind
        return
    for name in dtype.names:
        for way, inner, kind in _fields(dtype[name], shape):
            yield (name, *way), inner, kind


def read_mat(path: Path, wanted: list[str]) -> Table:
    import scipy.io

    found: dict[str, Array] = {}
    other: list[str] = []
    held: dict[str, Any] = {}
    try:
        listed = scipy.io.whosmat(path)
        for name, shape, kind in listed:
            if kind == "double" or kind in _MAT_SIZES:
                size = math.prod(shape) * _MAT_SIZES.get(kind, 8)
                found[name] = Array(name, (), shape, size)
            elif kind in ("opaque", "object", "function"):
                told = f"{name} is a MATLAB object: save struct(...) or table2struct(..., "
                other.append(told + "'ToScalar', true) of it")
        nested = [name for name, _, kind in listed if kind in ("struct", "cell")]
        if nested and not set(wanted) <= columns_of(found).keys():
            held = scipy.io.loadmat(path, variable_names=nested, simplify_cells=True)
            for name in nested:
                for way, array in _nested(held[name]):
                    found[name + _shown(way)] = Array(name, way, array.shape, array.nbytes)
        home = _home(path, wanted, found, other)
        needed = {home[name][0].variable for name in wanted} - held.keys()
        check_size(path, home, wanted)
        if needed:
            held |= scipy.io.loadmat(path, variable_names=list(needed))
    except (OSError, DataError):
        raise
    except Exception as error:  # scipy raises many kinds on broken files
        raise DataError(f"{path} is not a readable .mat file: {error}") from error
    return taken(held, home, wanted)


def _nested(value: Any) -> Iterator[tuple[tuple[str | int, ...], np.ndarray]]:
    """The arrays of numbers in structures and cells, each with the way to it."""
    if isinstance(value, dict):
        inner: Iterable[tuple[str | int, Any]] = value.items()
    elif isinstance(value, list) or getattr(value, "dtype", None) == np.dtype(object):
        inner = enumerate(value)
    else:
        if isinstance(value, np.ndarray) and value.dtype.kind in _COLUMN_KINDS:
            yield (), value
        return
    for key, one in inner:
        for way, array in _nested(one):
            yield (key, *way), array


def _shown(way: tuple[str | int, ...]) -> str:
    return "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in way)


def _home(
    path: Path, wanted: list[str], found: Mapping[str, Array], other: list[str]
) -> dict[str, tuple[Array, int | None]]:
    """Each column's array and its place there; refuses what is not there."""
    home = columns_of(found)
    require(path, wanted, list(home), f" ({'; '.join(other[:3])})" if other else "")
    return home


def columns_of(found: Mapping[str, Array]) -> dict[str, tuple[Array, int | None]]:
    """Each column's array, and its place there; single numbers and cubes hold none."""
    home: dict[str, tuple[Array, int | None]] = {}
    for name, array in found.items():
        sizes = [size for size in array.shape if size != 1]
        if len(sizes) == 1 and sizes[0] >= 2:
            home[name] = array, None
        elif len(sizes) == 2 and min(sizes) >= 1:
            home |= {f"{name}[{i}]": (array, i) for i in range(min(min(sizes), 10_000))}
    return home


def check_size(path: Path, home: Mapping[str, tuple[Array, int | None]], wanted: list[str]) -> None:
    """Refuse what would not fit into memory, before it is unpacked."""
    import psutil

    size = sum({home[name][0].variable: home[name][0].size for name in wanted}.values())
    free = psutil.virtual_memory().available
    if size > free / 2:
        raise DataError(
            f"{path}: the columns unpack to {size / 2**30:.3g} GiB, {free / 2**30:.3g} GiB of "
            "memory are free; write them as CSV or Parquet, which are read in parts"
        )


def taken(
    held: Mapping[str, Any], home: Mapping[str, tuple[Array, int | None]], wanted: list[str]
) -> Table:
    columns = {}
    for name in wanted:
        array, column = home[name]
        value = held[array.variable]
        for step in array.way:
            value = value[step]
        value = np.squeeze(value)
        if column is not None:
            value = (value if value.shape[0] >= value.shape[1] else value.T)[:, column]
        columns[name] = value
    return Table(columns, row)
