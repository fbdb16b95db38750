"""Arguments that several laws take: order, gain, poles, model, method and timing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs import _core
from hgo_rs.design.discrete import METHODS, TIMINGS
from hgo_rs.errors import HgoError, check, check_choice, check_integer, check_number, explain
from hgo_rs.models import Ship, System, Unknown
from hgo_rs.observers.gains import AdaptiveGain, ConstantGain, DeadZoneGain
from hgo_rs.observers.records import vector

Gain = float | ConstantGain | AdaptiveGain | DeadZoneGain
Poles = Sequence[complex] | npt.ArrayLike


def order(n: Any, least: int = 1) -> int:
    remedy = "choose an integer in this range" + ("; StandardObserver takes 1" if least > 1 else "")
    return check_integer(n, "n", least=least, most=12, remedy=remedy)


def manner(method: str, timing: str) -> dict[str, str]:
    return {
        "method": check_choice("method", method, METHODS),
        "timing": check_choice("timing", timing, TIMINGS),
    }


def pairs(poles: Poles, count: int, law: str) -> list[tuple[float, float]]:
    try:
        values = np.asarray(poles, dtype=complex).reshape(-1)
    except (TypeError, ValueError, OverflowError):
        raise HgoError(explain("poles", poles, "complex numbers", f"give {count}")) from None
    if len(values) != count:
        raise HgoError(f"poles: {len(values)} given; {law} needs {count}")
    for p in values:
        stable = np.isfinite(p) and p.real < 0.0
        remedy = "place it in the open left half plane"
        check(stable, "poles", complex(p), "finite with a negative real part", remedy)
        paired = np.sum(values == p) == np.sum(values == p.conjugate())
        remedy = "give both, or real poles"
        check(paired, "poles", complex(p), "accompanied by its complex conjugate", remedy)
    return [(float(p.real), float(p.imag)) for p in values]


def coefficients(n: int, poles: Poles | None, k: npt.ArrayLike | None) -> list[float]:
    if k is not None:
        check(poles is None, "k", k, "given without poles", "give poles or k")
        return hurwitz(vector(k, "k", n).tolist())
    given = np.linspace(-1.0, -2.0, n) if poles is None else poles
    placed = pairs(given, n, f"an observer of order {n}")
    return hurwitz(_core.coefficients_from_poles(placed))


def hurwitz(k: list[float]) -> list[float]:
    allowed = "such that s^n + k_1 s^(n-1) + ... + k_n has all roots in the left half plane"
    check(_core.is_hurwitz(k), "k", k, allowed, "give poles in its place")
    return k


def gain(gain: Gain | None, epsilon: float | None) -> dict[str, Any]:
    if (gain is None) == (epsilon is None):
        raise HgoError("gain: give either gain [1/s] or epsilon = 1/gain [s]")
    if epsilon is not None:
        return ConstantGain.from_epsilon(epsilon).spec
    if isinstance(gain, (ConstantGain, AdaptiveGain, DeadZoneGain)):
        return gain.spec
    return ConstantGain(check_number(gain, "gain", above=0.0)).spec


def model(model: System | None, n: int) -> dict[str, Any]:
    known = Unknown() if model is None else model
    check(
        isinstance(known, System), "model", model, "a Model or another System", "see hgo_rs.models"
    )
    fits = known.order in (None, n) and not isinstance(known, Ship)
    remedy = f"its order is {known.order}"
    if isinstance(known, Ship):
        remedy = "a ship is for ReducedOrderObserver"
    check(fits, "model", model, f"of order {n}", remedy)
    return known.spec
