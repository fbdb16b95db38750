"""Arguments that several laws take: order, gain, poles, model, method and timing."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs import _core
from hgo_rs.design.discrete import (
    CORRECTING,
    DEFAULT_METHOD,
    DEFAULT_TIMING,
    EXACT,
    MAX_SUBSTEPS,
    METHODS,
    MOTIONS,
    SUBSTEPS,
    TIMINGS,
    defines,
    fixed_timing,
)
from hgo_rs.errors import HgoError, check, check_choice, check_integer, check_number, explain
from hgo_rs.laws import LAWS, Law
from hgo_rs.models import Ship, System, Unknown
from hgo_rs.observers.gains import ConstantGain, GainLaw, HomogeneousGain, InnovationGain
from hgo_rs.observers.records import vector
from hgo_rs.observers.shapes import BiHomogeneous, Fal, Shape

Gain = float | GainLaw
Poles = Sequence[complex] | npt.ArrayLike


LEAST = {"low-power": 2, "peaking-free": 2}
"""Orders from which on a law is no other one."""


def order(n: Any, least: int = 1, most: int = 12) -> int:
    remedy = "choose an integer in this range" + ("; StandardObserver takes 1" if least > 1 else "")
    return check_integer(n, "n", least=least, most=most, remedy=remedy)


def manner(law: Law, method: str, timing: str | None) -> dict[str, str]:
    check_choice("method", method, METHODS)
    has = ", ".join(each.kind for each in LAWS.values() if defines(each, method))
    remedy = f"this one is defined for the laws {has}"
    allowed = f"a method of the {law.title}, such as 'rk4'"
    check(defines(law, method), "method", method, allowed, remedy)
    only = fixed_timing(method)
    if timing is None:
        timing = only or DEFAULT_TIMING
    check_choice("timing", timing, TIMINGS)
    remedy = "the step of this method ends with its sample"
    if only == "predictor":
        remedy = "by this method an estimate does not jump at a sample"
    check(only in (None, timing), "timing", timing, f"{only!r} under method {method!r}", remedy)
    return {"method": method, "timing": timing}


def motion(
    method: str,
    motion: str | None,
    substeps: int | None,
    model: System | None,
    gain: Mapping[str, Any],
) -> dict[str, Any]:
    """How the model moves between corrections, by itself where it is left open; of a method that
    does not place them nothing.
    """
    if method not in EXACT:
        for name, value in (("motion", motion), ("substeps", substeps)):
            remedy = f"method {method!r} integrates the model itself; or choose method 'zoh'"
            check(value is None, name, value, "left out", remedy)
        return {}
    chosen = usual_motion(model, gain) if motion is None else motion
    check_choice("motion", chosen, MOTIONS)
    warn_of_jumps(chosen, model, stacklevel=4)
    if chosen == "held":
        remedy = "the model is held over the period; or choose motion='rk4'"
        open_ = substeps is None or motion is None
        check(open_, "substeps", substeps, "left out", remedy)
        return {"motion": chosen}
    count = SUBSTEPS if substeps is None else substeps
    remedy = "choose an integer in this range, or a smaller dt"
    count = check_integer(count, "substeps", least=1, most=MAX_SUBSTEPS, remedy=remedy)
    return {"motion": chosen, "substeps": count}


class MotionWarning(UserWarning):
    """A motion that was asked for and does not follow the model."""


def warn_of_jumps(motion: str, model: System | None, stacklevel: int) -> None:
    """Warn of a motion under which an estimate chatters where the model jumps."""
    if motion != "implicit" and model is not None and model.own_slope == math.inf:
        warnings.warn(
            f"motion = {motion!r}: an equation of the model may jump in its own state, as friction "
            'with sign(v) does, and the estimate chatters there; take motion="implicit", the '
            "default, or a smooth term, such as tanh(v/v0)",
            MotionWarning,
            stacklevel=stacklevel + 1,
        )


def usual_motion(model: System | None, gain: Mapping[str, Any]) -> str:
    """The motion where it is left open: held where nothing moves, implicit where a known term may
    jump, or is steeper than the gain, in the state that it moves.
    """
    if model is None or not model.moves:
        return "held"
    slope = model.own_slope
    least = gain["ell"] if gain["law"] == "constant" else 1.0
    return "rk4" if slope is None or slope <= least else "implicit"


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


def usual_method(law: Law, gain: dict[str, Any], shape: Shape | None) -> str:
    """The method where it is left open."""
    if gain["law"] == "homogeneous" and not law.placed:
        return "proper"
    placed = law.placed and (gain["law"] == "constant" or law.form != "phase")
    return DEFAULT_METHOD if placed and getattr(shape, "alike", True) else "rk4"


def shape_spec(shape: Any, law: Law, n: int, method: str) -> dict[str, Any]:
    """The entry of a shape, if there is one."""
    if shape is None:
        return {}
    check(
        isinstance(shape, Shape),
        "shape",
        shape,
        "a Stubborn or another Shape",
        "see docs/shapes.md",
    )
    remedy = "its sample acts at once; choose StandardObserver"
    check(law.gain != "constant", "shape", shape, f"left out of the {law.title}", remedy)
    if not shape.alike:
        remedy = "the rows of this shape differ: choose StandardObserver, Stubborn or DeadZone"
        check(law.kind == "standard", "shape", shape, f"left out of the {law.title}", remedy)
        remedy = "the rows of this shape differ, so that no eigenvalues can be placed"
        check(
            method not in CORRECTING,
            "method",
            method,
            "one that places none, such as 'rk4'",
            remedy,
        )
    name = {Fal: "alpha", BiHomogeneous: "kappa"}.get(type(shape))
    if name is not None:
        values = getattr(shape, name)
        check(len(values) == n, name, values, f"{n} numbers", "give one for each state")
    return {"shape": shape.spec}


def of_law(
    law: Law, n: int, poles: Poles | None, entries: Mapping[str, Any]
) -> dict[str, int | list[float]]:
    """The second size and the lists of coefficients of a law, given or from poles."""
    names = tuple(name for name, _ in law.coefficients)
    known = (*names, law.size[0]) if law.size else names
    for name in entries:
        check_choice(f"an entry of the {law.title}", name, known)
    out: dict[str, int | list[float]] = {}
    m = 0
    if law.size:
        name, values = law.size
        given = entries.get(name)
        usual = values[0] if given is None else given
        m = out[name] = check_integer(usual, name, least=min(values), most=max(values))
    lists = {name: entries[name] for name in names if entries.get(name) is not None}
    if lists:
        counts = law.counts(n, m)
        lists |= {name: () for name, count in counts.items() if count == 0 and name not in lists}
        if len(names) > 1:
            whole = len(lists) == len(names) and poles is None
            if not whole:
                raise HgoError(f"{' and '.join(names)}: must be given together and without poles")
        else:
            remedy = f"give poles or {names[0]}"
            check(poles is None, names[0], lists[names[0]], "given without poles", remedy)
        for name, count in counts.items():
            values = vector(lists[name], name, count).tolist()
            out[name] = hurwitz(values) if len(names) == 1 else values
        return out
    needed = law.pole_count(n, m) or 0  # all laws of one chain are designed by poles
    named = "an observer" if law.kind == "standard" else f"a {law.kind} observer"
    placed = None if poles is None else pairs(poles, needed, f"{named} of order {n}")
    found = _core.law_coefficients(law.kind, n, m, placed)
    if len(names) == 1:  # the polynomial of the poles
        hurwitz(found[0])
    return out | dict(zip(names, found, strict=True))


def hurwitz(k: list[float]) -> list[float]:
    allowed = "such that s^n + k_1 s^(n-1) + ... + k_n has all roots in the left half plane"
    check(_core.is_hurwitz(k), "k", k, allowed, "give poles in its place")
    return k


def gain(
    gain: Gain | None, epsilon: float | None, law: Law | None = None, n: int = 2
) -> dict[str, Any]:
    if (gain is None) == (epsilon is None):
        raise HgoError("gain: give either gain [1/s] or epsilon = 1/gain [s]")
    if epsilon is not None:
        return ConstantGain.from_epsilon(epsilon).spec
    if isinstance(gain, HomogeneousGain) and law is not None:
        remedy = "this gain is made for the standard law from order 2 on, and the filtered one"
        allowed = f"another gain law for the {law.title} of order {n}"
        fits = (law.kind == "standard" and n > 1) or law.kind == "filtered"
        check(fits, "gain", gain, allowed, remedy)
    if isinstance(gain, InnovationGain):
        allowed, remedy = "another gain law", "this one is for HighGainEKF"
        check(law is None, "gain", gain, allowed, remedy)
    if isinstance(gain, GainLaw):
        held = law is None or law.gain != "constant" or isinstance(gain, ConstantGain)
        check(held, "gain", gain, "a constant gain", "give ell [1/s], or take StandardObserver")
        return gain.spec
    return ConstantGain(check_number(gain, "gain", above=0.0)).spec


def model(model: System | None, n: int, law: Law | None = None) -> dict[str, Any]:
    known = Unknown() if model is None else model
    if law is not None and law.form == "unknown":
        remedy = f"the {law.title} takes no model; choose StandardObserver"
        check(isinstance(known, Unknown), "model", model, "left out", remedy)
    check(
        isinstance(known, System), "model", model, "a Model or another System", "see hgo_rs.models"
    )
    fits = known.order in (None, n) and not isinstance(known, Ship)
    remedy = f"its order is {known.order}"
    if isinstance(known, Ship):
        remedy = "a ship is for ReducedOrderObserver"
    check(fits, "model", model, f"of order {n}", remedy)
    return known.spec
