"""An observer for a page: its steps as numbers, by each method and timing, its gain free."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs import _core
from hgo_rs.config import Config
from hgo_rs.design.discrete import METHODS, TIMINGS, at_unit_gain, following
from hgo_rs.errors import HgoError, check, explain
from hgo_rs.observers import HighGainEKF, Observer
from hgo_rs.observers.labels import Labels
from hgo_rs.pages.drawn import Drawn
from hgo_rs.pages.module import digest, packed

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Reference:
    """States (N, n) at times (N,) that a page draws beside the estimates, and what they are."""

    name: str
    t: Array
    x: Array


def system(
    title: str,
    drawn: Drawn,
    structures: Sequence[dict[str, Any]],
    chosen: str,
    state: Any,
    noise: float,
    model_error: float,
    reference: Reference | None,
    *,
    text: str = "",
    left: Sequence[str] = (),
    criterion: str = "",
    judged_by: str = "",
    horizon: float = math.nan,
    warnings: Sequence[str] = (),
    truth: bool = False,
) -> dict[str, Any]:
    """A record and its observers, as a page holds them.

    ``noise``, ``model_error``: what the sliders begin with. ``truth``: whether the reference is the
    true state.
    """
    drawn_beside = None
    if reference is not None:
        t, x = packed(reference.t), packed(reference.x)
        drawn_beside = {"name": reference.name, "t": t, "x": x, "n": reference.x.shape[1]}
    return {
        "title": title,
        "text": text,
        "log": drawn.data,
        "decimated": drawn.decimated,
        "left": list(left),
        "structures": list(structures),
        "chosen": chosen,
        "state": state,
        "criterion": criterion,
        "noise": _finite(noise),
        "model_error": _finite(model_error),
        "judged_by": judged_by,
        "horizon": _finite(horizon),
        "warnings": list(warnings),
        "truth": truth,
        "reference": drawn_beside,
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def structure(
    name: str,
    observer: Observer,
    drawn: Drawn,
    span: tuple[float, float],
    saved: Callable[[Observer], Config],
    start: str,
    curve: Sequence[Any] = ((), (), ()),
    methods: Sequence[str] = METHODS,
) -> dict[str, Any]:
    """An observer over a record, begun at "zero" or at the "first-sample", its gain within `span`.

    ``curve``: gains, and at each the RMS innovation and the measured error. ``methods``: beside its
    own.
    """
    first = drawn.first if start == "first-sample" else None
    found = ways(observer, first, lambda other: saved(other).to_toml(), methods)
    return {
        "name": name,
        "n": observer.n,
        "inputs": observer.n_u,
        "states": Labels.of(observer.spec, observer.n).names(observer.n),
        "units": observer.units.tolist(),
        "ell": float(observer.spec["gain"]["ell"]),
        "range": list(span),
        "digest": digest(drawn.run(observer, start)),
        "curve": dict(zip(("ell", "innovation", "measured"), map(packed, curve), strict=True)),
        "ways": found,
    }


def ways(
    observer: Observer, first: Array | None, toml: Any, methods: Sequence[str] = METHODS
) -> list[dict[str, Any]]:
    """The observer by each of these methods and timings that its law has, its own first.

    ``first``: the first sample, where its estimate begins; None: at 0.
    ``toml``: observer -> `observer.toml`.

    Raises
    ------
    HgoError
        A gain that moves, a model of Python functions, another law than one chain.
    """
    own = observer.spec.get("method"), observer.spec.get("timing")
    found = [_way(observer, first, toml)]
    table = Config.of(observer)
    for method in methods:
        for timing in TIMINGS:
            if (method, timing) == own:
                continue
            try:
                other = table.replace(method=method, timing=timing).observer()
                found.append(_way(other, first, toml))
            except HgoError:  # a method that the law has not
                continue
    return found


def _way(observer: Observer, first: Array | None, toml: Any) -> dict[str, Any]:
    spec = observer.spec
    _check_gain(observer)
    unit = at_unit_gain(spec)
    try:
        numbers, of_unit = _core.live_numbers(spec), _core.live_numbers(unit)
    except ValueError as error:
        raise HgoError(str(error)) from None
    memory = observer.initial_memory()
    if first is not None:
        memory = observer._begun(memory, first)
    before, gain, after = _split(toml(observer), spec["gain"]["ell"])
    return {
        "method": spec["method"],
        "timing": spec["timing"],
        "numbers": packed(numbers),
        "unit": packed(of_unit),
        "lift": packed(following(spec, observer._core.memory_len - observer._core.is_current)),
        "memory": packed(memory),
        "toml": [before, gain, after],
    }


def _check_gain(observer: Observer) -> None:
    """Refuse an observer of which more than the gain changes with the gain."""
    if isinstance(observer, HighGainEKF):
        told, remedy = "one of constant gains, for a page", "draw another law"
        reason = f"{remedy}: those of this filter move with the slopes of the model"
        raise HgoError(explain("observer", "HighGainEKF", told, reason))
    spec = observer.spec
    gain = spec.get("gain", {})
    constant = gain.get("law") == "constant"
    remedy = "leave it out"
    check(constant, "gain of the observer", gain.get("law"), "constant, for a page", remedy)
    calls = observer._interpreted
    told = "compiled, for a page: its model calls Python functions"
    check(not calls, "observer", type(observer).__name__, told, "write the model as expressions")


def _split(text: str, ell: float) -> tuple[str, str, str]:
    """An `observer.toml` before its gain, the gain, and behind it."""
    lines = text.split("\n")
    for i, line in enumerate(lines):
        key, equals, value = line.partition("=")
        if key.strip() == "gain" and equals:
            number, mark, comment = value.partition("#")
            if float(number) == ell:
                head = "\n".join([*lines[:i], f"{key}= "])
                tail = (" #" + comment) if mark else ""
                return head, number.strip(), "\n".join([tail, *lines[i + 1 :]])
    raise HgoError("gain of observer.toml: must be a number at its head, for a page")
