"""Errors: each names the parameter, its value, the range it must lie in, and a remedy.

All derive from ``ValueError``, so that ``except ValueError`` catches them too.
"""

from __future__ import annotations

import difflib
import math
import operator
import os
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = [
    "DesignError",
    "HgoError",
    "MissingExtraError",
    "check",
    "check_array",
    "check_choice",
    "check_flag",
    "check_integer",
    "check_number",
    "check_path",
    "explain",
    "nearest",
    "need",
    "printable",
]


def printable(text: str) -> str:
    """Text on one line that does nothing to a terminal: what is not printable is escaped."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


class HgoError(ValueError):
    """Base of all errors about input. The message contains printable characters only."""

    def __str__(self) -> str:
        return printable(super().__str__())


class DesignError(HgoError):
    """A design that does not exist, or whose certificate does not hold."""


class MissingExtraError(HgoError, ImportError):
    """An optional library is not installed; the message names the extra that brings it."""


def nearest(name: str, known: Iterable[str], *, count: int = 3, cutoff: float = 0.4) -> list[str]:
    """The nearest known names, whatever the case."""
    folded = {k.casefold(): k for k in reversed(list(known))}
    near = difflib.get_close_matches(name.casefold(), folded, n=count, cutoff=cutoff)
    return [folded[k] for k in near]


def need(library: str, told: str, extra: str) -> Any:
    """An optional library; MissingExtraError, with what needs it, where it is not installed."""
    try:
        return import_module(library)
    except ImportError as error:
        raise MissingExtraError(f"{told}: pip install 'hgo_rs[{extra}]'") from error


def _show(value: object) -> str:
    """``repr(value)`` on one line, cut to a readable length."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 120 else text[:117] + "..."


def explain(parameter: str, value: object, allowed: str, remedy: str) -> str:
    """The one form of message: "parameter = value: must be allowed; remedy"."""
    return f"{parameter} = {_show(value)}: must be {allowed}; {remedy}"


def check(
    holds: object,
    parameter: str,
    value: object,
    allowed: str,
    remedy: str,
    error: type[HgoError] = HgoError,
) -> None:
    """Raise ``error`` with the message of ``explain`` unless ``holds`` is true."""
    if not holds:
        raise error(explain(parameter, value, allowed, remedy))


def check_number(
    value: Any,
    parameter: str,
    *,
    above: float | None = None,
    least: float | None = None,
    below: float | None = None,
    most: float | None = None,
    remedy: str = "choose a value in this range",
    error: type[HgoError] = HgoError,
) -> float:
    """``value`` as a finite float with above < value < below and least <= value <= most."""
    limits = ["finite"]
    limits += [f"> {above:g}"] if above is not None else []
    limits += [f">= {least:g}"] if least is not None else []
    limits += [f"< {below:g}"] if below is not None else []
    limits += [f"<= {most:g}"] if most is not None else []
    allowed = " and ".join(limits)
    try:
        if isinstance(value, (str, bytes, np.timedelta64, np.datetime64)):
            raise TypeError
        number = float(value)
    except (TypeError, ValueError):
        raise error(explain(parameter, value, f"a number, {allowed}", "give a number")) from None
    except OverflowError:  # an integer beyond the floats
        number = math.inf
    inside = (
        math.isfinite(number)
        and (above is None or number > above)
        and (least is None or number >= least)
        and (below is None or number < below)
        and (most is None or number <= most)
    )
    check(inside, parameter, value, allowed, remedy, error)
    return number


def check_integer(
    value: Any,
    parameter: str,
    *,
    least: int,
    most: int | None = None,
    remedy: str = "choose an integer in this range",
    error: type[HgoError] = HgoError,
) -> int:
    """``value`` as an int with least <= value <= most; 3.0 and True are refused."""
    allowed = f"an integer >= {least}" + ("" if most is None else f" and <= {most}")
    try:
        number = operator.index(value)
    except TypeError:
        raise error(explain(parameter, value, allowed, remedy)) from None
    inside = not isinstance(value, bool) and number >= least and (most is None or number <= most)
    check(inside, parameter, value, allowed, remedy, error)
    return number


def check_choice(parameter: str, value: Any, allowed: tuple[str, ...]) -> str:
    """``value`` if it is one of ``allowed``."""
    known = isinstance(value, str) and value in allowed
    check(known, parameter, value, f"one of {', '.join(allowed)}", "choose one of them")
    return str(value)


def check_flag(value: Any, parameter: str) -> bool:
    """``value`` as a bool; of numbers and other objects none is."""
    check(isinstance(value, (bool, np.bool_)), parameter, value, "True or False", "choose one")
    return bool(value)


def check_path(value: Any, parameter: str = "path") -> Path:
    """``value`` as a path."""
    named = isinstance(value, (str, os.PathLike)) and str(value)
    check(named, parameter, value, "a path", 'name a file or folder, such as "axis.toml"')
    return Path(value)


def check_array(
    value: Any, parameter: str, *, remedy: str = "give numbers"
) -> npt.NDArray[np.float64]:
    """``value`` as a new array of floats, of any shape; None and masked entries become NaN."""
    try:
        given = np.asanyarray(value)
        if given.dtype.kind not in "biufO":
            raise TypeError
        with np.errstate(over="ignore"):
            return np.array(np.ma.filled(given.astype(np.float64), np.nan))
    except (TypeError, ValueError, OverflowError):
        raise HgoError(explain(parameter, value, "an array of numbers", remedy)) from None
