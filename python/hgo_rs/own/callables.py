"""Models of Python callables that could not be compiled: they run in the NumPy reference, call by
call.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.own.base import OwnSystem

__all__ = ["SlowModelWarning", "interpreted_spec", "is_interpreted", "stand_in", "warn_slow"]

Array = npt.NDArray[np.float64]


class SlowModelWarning(UserWarning):
    """A model runs as Python, call by call."""


def is_interpreted(system: object) -> bool:
    """Whether a system is made of callables that are not compiled."""
    return isinstance(system, OwnSystem) and not system.compiled


class _Called:
    """Callables in the place of a table: `inputs`, `outputs`, a call with one value an input."""

    def __init__(self, system: OwnSystem) -> None:
        spec = system.spec
        self.callables = system.callables
        n, n_u = spec["n"], spec["n_u"]
        sizes = [n, n_u]
        if spec.get("form") == "sampled":
            sizes += [None, None]  # y and T are numbers
        if spec.get("form") == "strict-feedback":
            sizes = [n, spec["n_z"], n_u]
        if spec["kind"] == "own-plant":
            sizes = [n]
        self.sizes: list[int | None] = sizes
        self.parameters = len(spec["parameters"])
        self.inputs = 1 + sum(1 if size is None else size for size in sizes) + self.parameters
        self.outputs = range(len(self._one([0.0] * self.inputs)))

    def _one(self, values: list[float]) -> list[float]:
        arguments: list[Any] = [values[0]]
        first = 1
        for size in self.sizes:
            if size is None:
                arguments.append(values[first])
                first += 1
            else:
                arguments.append(np.array(values[first : first + size]))
                first += size
        made: list[float] = []
        for name, call in self.callables.items():
            needed = len(arguments) if name == "K_T" or None not in self.sizes else 3
            made.extend(np.asarray(call(*arguments[:needed]), dtype=float).ravel().tolist())
        return made

    def __call__(self, values: list[Any]) -> list[Array]:
        rows = np.broadcast_arrays(*(np.asarray(value, dtype=float) for value in values))
        columns = np.stack([row.ravel() for row in rows], axis=1)
        made = np.array([self._one(column.tolist()) for column in columns])
        return list(made.T.reshape(made.shape[1], *rows[0].shape))


def interpreted_spec(spec: Mapping[str, Any], system: object) -> dict[str, Any]:
    """The spec of an observer ("model" in it) or of a plant, as the reference runs it."""
    if not is_interpreted(system):
        return dict(spec)
    assert isinstance(system, OwnSystem)
    if "model" in spec:
        return {**spec, "model": {**spec["model"], "table": _Called(system)}}
    return {**spec, "table": _Called(system)}


def stand_in(spec: Mapping[str, Any], system: OwnSystem) -> dict[str, Any]:
    """The spec of an observer with a model of the same size that is 0: for the sizes of things."""
    called = _Called(system)
    table = {
        "inputs": [f"input[{i}]" for i in range(called.inputs)],
        "constants": [0.0],
        "ops": [],
        "outputs": [called.inputs] * len(called.outputs),
    }
    return {**spec, "model": {**spec["model"], "table": table}}


def warn_slow(system: OwnSystem, compiled: float, interpreted: float, what: str) -> float:
    """Say by how much slower it is; the ratio of these times [s]."""
    ratio = interpreted / compiled
    warnings.warn(
        f"{what}: the model runs as Python, {ratio:.0f} times slower than a compiled one of its "
        f"size ({interpreted:.2g} s a sample; {system.why_not_compiled})",
        SlowModelWarning,
        stacklevel=4,
    )
    return ratio


def clocked(call: Any) -> tuple[Any, float]:
    """What a call gives, and the time that it took [s]."""
    start = time.perf_counter()
    made = call()
    return made, time.perf_counter() - start
