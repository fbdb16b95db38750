"""Systems of Python callables that could not be compiled: observers call them where the core's law
asks for the model, simulations run in the NumPy reference.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.own.base import OwnSystem
from hgo_rs.own.model import Model
from hgo_rs.own.sources import Arguments

__all__ = [
    "SlowModelWarning",
    "called_spec",
    "interpreted_spec",
    "is_interpreted",
    "stand_in",
    "warn_slow",
]

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


def called_spec(spec: Mapping[str, Any], model: Model) -> dict[str, Any]:
    """The spec of an observer as the core runs it: its table calls the model's right-hand sides."""
    symbols = model.arguments
    calls, results = [], 0
    for group in model.groups.values():
        arguments = [symbols.index(symbol) for symbol in group.arguments.symbols]
        call = group.call(model.parameters)
        calls.append((_called(call, group.arguments), arguments, group.size))
        results += group.size
    inputs = [*symbols, *model.parameters]
    outputs = list(range(len(inputs), len(inputs) + results))
    table = {"inputs": inputs, "calls": calls, "outputs": outputs}
    return {**spec, "model": {**spec["model"], "table": table}}


def _called(
    call: Callable[..., Array], arguments: Arguments
) -> Callable[[list[float]], list[float]]:
    """A right-hand side as a function of one list of numbers."""

    def flat(values: list[float]) -> list[float]:
        given = dict(zip(arguments.symbols, values, strict=True))
        with np.errstate(all="ignore"):  # a value that is not finite is told by the observer
            made: list[float] = call(*arguments.given(given)).tolist()
        return made

    return flat


def stand_in(spec: Mapping[str, Any], model: Model) -> dict[str, Any]:
    """The spec of an observer with a model of the same size that is 0, for comparison."""
    called = called_spec(spec, model)["model"]["table"]
    inputs, outputs = called["inputs"], called["outputs"]
    table = {"inputs": inputs, "constants": [0.0], "outputs": [len(inputs)] * len(outputs)}
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
