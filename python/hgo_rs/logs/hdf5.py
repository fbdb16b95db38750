"""HDF5 and the MATLAB files of version 7.3, which are HDF5, by the library h5py.

Columns are `group/dataset` (`structure.field` in a MATLAB file), `dataset[i]` of a 2-D dataset, and
`dataset.field` of a table. The file does not say which column holds the times of which.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs.logs.arrays import Array, check_size, columns_of, taken
from hgo_rs.logs.recording import Recording


@contextmanager
def opened(path: Path) -> Iterator[Recording]:
    import h5py

    with h5py.File(path, "r") as file:
        found: dict[str, Array] = {}

        def visit(name: str, item: Any) -> None:
            text = item.attrs.get("MATLAB_class") in (b"char", b"cell")
            if not isinstance(item, h5py.Dataset) or name.startswith("#") or text:
                return
            shown = name.replace("/", ".") if path.suffix.lower() == ".mat" else name
            for field in item.dtype.names or (None,):
                dtype = item.dtype if field is None else item.dtype[field]
                if dtype.base.kind not in "fiub" or item.shape is None:
                    continue
                shape = (*item.shape, *dtype.shape)
                way = () if field is None else (field,)
                column = ".".join([shown, *way])
                size = math.prod(shape) * dtype.base.itemsize
                found[column] = Array(name, way, shape, size)

        file.visititems(visit)
        home = columns_of(found)

        def load(names: list[str]) -> dict[str, np.ndarray]:
            check_size(path, home, names)
            return taken(file, home, names).columns

        yield Recording(dict.fromkeys(home), load)
