"""Systems of Python callables that could not be compiled: the core calls them where its laws and
schemes ask for the system.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from hgo_rs.models.own.base import OwnSystem
from hgo_rs.models.own.sources import Group


class SlowModelWarning(UserWarning):
    """A model runs as Python, call by call."""


class _Side:
    """A right-hand side as a function of one list of numbers."""

    def __init__(self, group: Group, parameters: Mapping[str, float]) -> None:
        self.group, self.parameters = group, dict(parameters)
        self._call = group.call(parameters)

    def __reduce__(self) -> Any:
        return _Side, (self.group, self.parameters)

    def __call__(self, values: list[float]) -> list[float]:
        arguments = self.group.arguments
        given = dict(zip(arguments.symbols, values, strict=True))
        with np.errstate(all="ignore"):  # a value that is not finite is told by the observer
            made: list[float] = self._call(*arguments.given(given)).tolist()
        return made


def _table(system: OwnSystem) -> dict[str, Any]:
    """A table that calls the right-hand sides of a system."""
    symbols = list(system.arguments)
    inputs = [*symbols, *system.parameters]
    calls, results = [], 0
    for group in system.groups.values():
        places = [symbols.index(symbol) for symbol in group.arguments.symbols]
        calls.append((_Side(group, system.parameters), places, group.size))
        results += group.size
    outputs = list(range(len(inputs), len(inputs) + results))
    return {"inputs": inputs, "calls": calls, "outputs": outputs}


def runnable(spec: Mapping[str, Any], system: object) -> dict[str, Any]:
    """The spec of an observer (with its model) or of a plant as it is run: where the system
    is not compiled, its table calls it.
    """
    if not isinstance(system, OwnSystem) or system.compiled:
        return dict(spec)
    table = _table(system)
    if "model" in spec:
        return {**spec, "model": {**spec["model"], "table": table}}
    return {**spec, "table": table}


def stand_in(spec: Mapping[str, Any], model: OwnSystem) -> dict[str, Any]:
    """The spec of an observer with a model of the same size that is 0, for comparison."""
    called = _table(model)
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
