"""Errors of the reference: every message names the parameter, its value, its range and a remedy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Spec = Mapping[str, Any]


def fail(parameter: str, value: object, allowed: str, remedy: str) -> ValueError:
    """A ``ValueError`` that says which parameter, which value, which range, and what to do."""
    return ValueError(f"{parameter} = {value!r}: must be {allowed}; {remedy}")


def member(spec: Spec, key: str, where: str) -> Any:
    """``spec[key]``, or an error that names the missing key."""
    if key not in spec:
        raise fail(f"{where}.{key}", None, "given", f"add {key!r} to {where}")
    return spec[key]


def known(spec: Spec, where: str, keys: Sequence[str]) -> None:
    """Refuse keys that nothing reads."""
    for key in spec:
        if key not in keys:
            raise fail(f"{where} key", key, "one of " + ", ".join(keys), "correct or remove it")


def choice(value: object, parameter: str, allowed: Sequence[str]) -> str:
    """``value`` if it is one of ``allowed``."""
    if not isinstance(value, str) or value not in allowed:
        names = ", ".join(repr(name) for name in allowed)
        raise fail(parameter, value, f"one of {names}", "correct the name")
    return value


def number(
    value: Any,
    parameter: str,
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
) -> float:
    """``value`` as a finite float, > ``above``, >= ``least`` and < ``below`` where given."""
    limits = ["finite"]
    if above is not None:
        limits.append(f"> {above:g}")
    if least is not None:
        limits.append(f">= {least:g}")
    if below is not None:
        limits.append(f"< {below:g}")
    allowed = " and ".join(limits)
    try:
        result = float(value)
    except (TypeError, ValueError):
        raise fail(parameter, value, f"a number, {allowed}", "give a number") from None
    if (
        not np.isfinite(result)
        or (above is not None and not result > above)
        or (least is not None and not result >= least)
        or (below is not None and not result < below)
    ):
        raise fail(parameter, value, allowed, "choose a value in this range")
    return result


def integer(value: Any, parameter: str, *, least: int, most: int | None = None) -> int:
    """``value`` as an integer >= ``least`` (and <= ``most``)."""
    allowed = f"an integer >= {least}" + ("" if most is None else f" and <= {most}")
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not whole and isinstance(value, (float, np.floating)):
        whole = bool(np.isfinite(value)) and float(value).is_integer()
    if not whole or int(value) < least or (most is not None and int(value) > most):
        raise fail(parameter, value, allowed, "choose an integer in this range")
    return int(value)


def vector(value: ArrayLike, parameter: str, length: int) -> Array:
    """``value`` as a finite float array of shape (length,)."""
    result = np.asarray(value, dtype=np.float64)
    if result.shape != (length,):
        raise fail(
            parameter, result.tolist(), f"of shape ({length},)", f"it has shape {result.shape}"
        )
    if not np.all(np.isfinite(result)):
        raise fail(parameter, result.tolist(), "finite", "remove NaN and infinities")
    return result


def columns(value: ArrayLike, parameter: str, length: int, runs: int) -> Array:
    """``value`` of shape (length,) or (runs, length) as columns, one a run: (length, runs)."""
    given = np.asarray(value, dtype=np.float64)
    if given.shape == (length,):
        given = np.broadcast_to(given, (runs, length))
    elif given.shape != (runs, length):
        raise fail(
            parameter,
            f"array of shape {given.shape}",
            f"of shape ({length},) or ({runs}, {length})",
            "give one start for all runs or one a run",
        )
    if not np.all(np.isfinite(given)):
        raise fail(parameter, "an array with NaN or inf", "finite", "give finite starts")
    return np.array(given.T, order="C")
