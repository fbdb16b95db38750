"""The moves of an observer as tables, as the core traces them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs import _core
from hgo_rs.errors import HgoError
from hgo_rs.exports.table import Graph, graph

__all__ = ["Move", "Traced", "indexed", "model_of", "numbered_parameters"]

Array = npt.NDArray[np.float64]

_UNUSED = "unused"
"""Inputs of a table that are always 0."""


@dataclass(frozen=True)
class Move:
    """A function of the program, made of one table: its verb and what it takes.

    `inputs` are the table's, in order, under the names t, dt, z[i], y[i], u[i], p[i] and those of
    gains that are held.
    """

    verb: str
    graph: Graph
    inputs: tuple[str, ...]

    @property
    def used(self) -> set[str]:
        """The inputs that the outputs need."""
        return {term.name for term in self.graph.terms if term.kind == "input"}

    @property
    def moving(self) -> list[bool]:
        """For each output whether it is more than a constant."""
        return [self.graph.terms[output].kind != "constant" for output in self.graph.outputs]

    def takes(self, kind: str) -> bool:
        """Whether samples (y), inputs (u), t or dt are among the table's inputs."""
        return any(name.split("[")[0] == kind for name in self.inputs)


@dataclass(frozen=True)
class Traced:
    """Tables of one move of an observer: with its sample, and without."""

    verb: str
    precision: str
    with_sample: dict[str, Any]
    without: dict[str, Any]

    @classmethod
    def of(
        cls,
        spec: Mapping[str, Any],
        verb: str,
        precision: str,
        memory: Sequence[int],
        fixed: float | None = None,
    ) -> Traced:
        """The move `verb` of an observer, over these entries of its memory; the others are 0.

        With a `fixed` period [s] its length is no input: what depends on it is constant.
        """
        spec, single = numbered_parameters(spec), precision == "single"
        kept = {f"z[{entry}]": f"z[{i}]" for i, entry in enumerate(memory)}
        # with predictor timing every correction is for the fixed period
        how: dict[str, Any] = {"gains": "held"}
        if fixed is not None:
            how = {"fixed_dt": fixed, **({"dt": fixed} if verb == "step" else {"gains": "given"})}

        def table(missing: bool) -> dict[str, Any]:
            given = _core.trace_step(spec, single, missing=missing, part=verb, **how)
            inputs = [
                kept.get(name, f"{_UNUSED}{name}") if name.startswith("z[") else name
                for name in given["inputs"]
            ]
            # behind the memory, a table tells the innovation
            return {
                **given,
                "inputs": inputs,
                "outputs": [given["outputs"][entry] for entry in memory],
            }

        return cls(verb, precision, table(False), table(True))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        names = self.with_sample["inputs"]
        return tuple(name for name in names if not name.startswith(_UNUSED))

    def move(self, counted: Sequence[int] = ()) -> Move:
        """What of it is written. Entries of the whole memory that are `counted` elsewhere, times,
        must not be needed.
        """
        zeros = {name: 0.0 for name in self.with_sample["inputs"] if name.startswith(_UNUSED)}
        for entry in counted:
            zeros.pop(f"{_UNUSED}z[{entry}]", None)
        samples = [name for name in self.inputs if name.startswith("y[")]
        missing = self.without if samples else None
        made = graph(
            self.with_sample, self.precision, missing=missing, samples=samples, constant=zeros
        )
        move = Move(self.verb, made, self.inputs)
        if any(name.startswith(_UNUSED) for name in move.used):
            raise HgoError(
                f"fixed_dt: {self.verb} of this law needs the time since the last sample itself; "
                "export with dt="
            )
        return move

    def evaluate(self, numbers: Mapping[str, Array], values: Mapping[str, float]) -> Array:
        """The memory after the move, for numbers by their letter and other inputs by their name."""
        known = dict(values)
        for word, given in numbers.items():
            known |= dict(zip(indexed(word, len(given)), given, strict=True))
        table = self.with_sample if np.isfinite(numbers["y"]).all() else self.without
        row = [[0.0 if name.startswith(_UNUSED) else known[name] for name in table["inputs"]]]
        return np.array(_core.evaluate_table(table, row, self.precision == "single")[0])


def numbered_parameters(spec: Mapping[str, Any]) -> dict[str, Any]:
    """A spec whose parameters are called p[0], p[1], ...: names that no user can give."""
    model = model_of(spec)
    if model.get("kind") != "own":
        return dict(spec)
    table = model["table"]
    count = len(model["parameters"])
    first = len(table["inputs"]) - count
    inputs = [*table["inputs"][:first], *indexed("p", count)]
    return {**spec, "model": {**model, "table": {**table, "inputs": inputs}}}


def model_of(spec: Mapping[str, Any]) -> Mapping[str, Any]:
    """The model of a spec, empty where it has none."""
    model = spec.get("model")
    return model if isinstance(model, Mapping) else {}


def indexed(word: str, count: int) -> list[str]:
    """word[0], word[1], ..."""
    return [f"{word}[{i}]" for i in range(count)]
