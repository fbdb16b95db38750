"""How the known terms f of a law move over a period between placed corrections.

The chain is solved exactly.  "held" takes f at the beginning of the period; "rk4" moves the
deviation delta from that solution z(s), delta' = A delta + f(t + s, z(s) + delta) - f(t, z(0)), by
the classical Runge-Kutta scheme; "implicit" takes f at the end of the period where f falls steeply
in the state that it moves.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from .error import Array, Spec, choice, fail, integer
from .placement import PLACED

BY_MOTION = (*PLACED, "proper", "inter-sample")
"""Methods whose model moves so."""

MOTIONS = ("held", "rk4", "implicit")
SUBSTEPS = 2
MAX_SUBSTEPS = 16
HALVINGS = 7


class Moving(Protocol):
    """A law between samples: memories and terms are columns, (entries, runs)."""

    def terms(self, memory: Array, u: Array | None, t: float) -> Array:
        """f, (n, runs)."""

    def flow(self, memory: Array, f: Array, dt: float) -> Array:
        """A step along the chain, exact, under these terms."""

    def chain(self, delta: Array) -> Array:
        """A delta."""

    def shifted(self, memory: Array, delta: Array) -> Array:
        """The memory, its estimate moved by delta."""


def motion_from(spec: Spec, where: str) -> tuple[str, int]:
    """The motion and the steps that a period is cut into, of an observer's spec."""
    motion = choice(spec.get("motion", "held"), f"{where}.motion", MOTIONS)
    if "motion" in spec and spec.get("method", "euler") not in BY_MOTION:
        raise fail(f"{where}.motion", motion, "left out", f"or take a method of {BY_MOTION}")
    if motion == "held":
        if "substeps" in spec:
            raise fail(f"{where}.substeps", spec["substeps"], "left out", "or take motion 'rk4'")
        return motion, 1
    most = MAX_SUBSTEPS
    return motion, integer(spec.get("substeps", SUBSTEPS), f"{where}.substeps", least=1, most=most)


def moved(
    law: Moving, motion: tuple[str, int], memory: Array, u: Array | None, t: float, dt: float
) -> Array:
    """The memory after a period without a sample."""
    name, substeps = motion
    step = {"held": _held, "rk4": _rk4, "implicit": _implicit}[name]
    h = dt / substeps
    for i in range(substeps):
        memory = step(law, memory, u, t + i * h, h)
    return memory


def _held(law: Moving, memory: Array, u: Array | None, t: float, h: float) -> Array:
    return law.flow(memory, law.terms(memory, u, t), h)


def _rk4(law: Moving, memory: Array, u: Array | None, t: float, h: float) -> Array:
    begun = law.terms(memory, u, t)
    middle, end = law.flow(memory, begun, h / 2), law.flow(memory, begun, h)

    def slope(at: Array, delta: Array, time: float) -> Array:
        return law.chain(delta) + law.terms(law.shifted(at, delta), u, time) - begun

    k2 = slope(middle, np.zeros_like(begun), t + h / 2)
    k3 = slope(middle, h / 2 * k2, t + h / 2)
    k4 = slope(end, h * k3, t + h)
    return law.shifted(end, h / 6 * (2 * k2 + 2 * k3 + k4))


def _implicit(law: Moving, memory: Array, u: Array | None, t: float, h: float) -> Array:
    def at_end(f: Array) -> Array:
        return law.terms(law.flow(memory, f, h), u, t + h)

    most = at_end(np.zeros_like(law.terms(memory, u, t)))

    def left(theta: Array) -> Array:  # of f - F, along the largest F
        return (at_end(theta * most) - theta * most) * most

    width, theta = 0.5, np.full_like(most, 0.5)
    for _ in range(HALVINGS):
        width /= 2
        theta = theta + np.copysign(width, left(theta))
    low, high = left(theta - width), left(theta + width)
    along = low / np.where(low == high, 1.0, low - high)
    f = (theta - width + 2 * width * np.clip(along, 0.0, 1.0)) * most
    stiff = np.zeros(f.shape[1], dtype=np.bool_)
    for row in range(len(f)):
        without = f.copy()
        without[row] = 0.0
        stiff = stiff | (np.abs(at_end(without)[row]) > 2 * np.abs(f[row]))
    return np.where(stiff, law.flow(memory, f, h), _rk4(law, memory, u, t, h))
