"""Objects as the tables of an `observer.toml`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hgo_rs.config.keys import TOP, ConfigError
from hgo_rs.laws import LAWS
from hgo_rs.observers import Observer


def plain(value: Any) -> Any:
    """Plain numbers, texts, lists and dicts in place of NumPy's, tuples and complex numbers."""
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, (list, tuple)):
        return [plain(inner) for inner in value]
    return value


def observer_table(spec: Mapping[str, Any]) -> dict[str, Any]:
    """The keys at the head of a file, or of one of `[[observers]]`."""
    data: dict[str, Any] = {"observer": spec["kind"]}
    law = LAWS.get(spec["kind"])
    if law is not None and (len(law.orders) > 1 or "W" in spec):
        data["order"] = spec["n"]
    for key, value in spec.items():
        if key == "gain" and isinstance(value, dict):
            data["gain"] = value["ell"] if value["law"] == "constant" else dict(value)
        elif key == "shape":
            data["shape"] = plain(value)
        elif key == "observers":
            data["observers"] = [observer_table(inner) for inner in value]
        elif key == "wrap" and isinstance(value, (list, tuple)):
            data["wrap"] = [math.nan if length is None else length for length in value]
        elif key in TOP and key != "model":
            data[key] = value
    return data


def model_table(observer: Observer) -> dict[str, Any] | None:
    """`[model]` of an observer; None where it knows nothing."""
    spec = dict(observer.spec["model"])
    kind = spec.pop("kind")
    if kind == "none":
        return None
    if kind != "own":
        return {"kind": kind, **spec}
    if observer.model is None:
        raise ConfigError(
            "model: this observer does not hold its expressions; save a Config of them"
        )
    return _own_table(observer.model)


def _own_table(model: Any) -> dict[str, Any]:
    """`[model]` of an own model: names, parameters, and its right-hand sides as expressions."""
    table: dict[str, Any] = model.named_arguments()
    orders = table.get("orders")
    sides = {name: [str(node) for node in nodes] for name, nodes in model.equations.items()}
    for name, side in sides.items():
        if name == "h" or (name == "phi" and not orders):
            table[name] = side[0]
        elif name == "g":  # a row for each x
            width = len(side) // len(sides["f1"])
            table[name] = [side[i : i + width] for i in range(0, len(side), width)]
        else:
            table[name] = side
    return table
