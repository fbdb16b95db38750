"""Columns in the unit of the observer: unwrapped, scaled and moved as they are read."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hgo_rs.errors import check_number, nearest
from hgo_rs.logs.table import DataError
from hgo_rs.observers.turns import check_motion

Conversion = Mapping[str, float]
"""A number for each of some columns, by their names."""


class Converted:
    """Of a column first the turns are undone, then value = scale * column + offset; it remembers
    where the chunk before ended.
    """

    def __init__(
        self,
        known: Sequence[str],
        unwrap: Conversion | None,
        scale: Conversion | None,
        offset: Conversion | None,
    ) -> None:
        self._unwrap = _numbers("unwrap", unwrap, known, above=0.0)
        self._scale = _numbers("scale", scale, known)
        self._offset = _numbers("offset", offset, known)
        for name, value in self._scale.items():
            if value == 0.0:
                raise DataError(f"scale of {name!r} = 0: must not be 0; give a factor")
        self._last: dict[str, float] = {}

    def __call__(self, name: str, values: np.ndarray, starts: Sequence[int] = ()) -> np.ndarray:
        """A chunk of a column; pieces of the log begin at `starts`."""
        if name in self._unwrap:
            values = self._unwrapped(name, values, starts)
        if name in self._scale:
            values = self._scale[name] * values
        if name in self._offset:
            values = values + self._offset[name]
        return values

    def _unwrapped(self, name: str, values: np.ndarray, starts: Sequence[int]) -> np.ndarray:
        """Each sample in the turn that is the nearest to the sample before it."""
        length = self._unwrap[name]
        check_motion(values[:, np.newaxis], (length,), stacklevel=4)
        out = np.array(values, dtype=float)
        edges = sorted({0, *starts, len(values)})
        for a, b in itertools.pairwise(edges):
            if a in starts:
                self._last.pop(name, None)
            there = a + np.flatnonzero(np.isfinite(values[a:b]))
            if not len(there):
                continue
            raw = values[there]
            before = self._last.get(name, float(raw[0]))
            steps = np.diff(raw, prepend=before)
            turns = np.cumsum(np.rint(steps / length))
            out[there] = raw - length * turns
            self._last[name] = float(out[there[-1]])
        return out


def _numbers(
    parameter: str, given: Any, known: Sequence[str], above: float | None = None
) -> dict[str, float]:
    """A finite number for each column, which is one of those that are read."""
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise DataError(f"{parameter} = {given!r}: must name its columns, such as {{'q': 0.1}}")
    for name in given:
        if name not in known:
            near = nearest(str(name), known)
            hint = f"; nearest: {', '.join(near)}" if near else ""
            raise DataError(f"{parameter} of {name!r}: no output or input of this name{hint}")
    return {
        name: check_number(value, f"{parameter} of {name!r}", above=above, error=DataError)
        for name, value in given.items()
    }
