"""Gain laws: how the gain g of an observer (ell or r) moves.  Arrays hold one entry a run."""

from __future__ import annotations

from typing import Any

import numpy as np

from .error import Array, Spec, choice, member, number


class ConstantGain:
    """g = ell, no memory."""

    moves = False

    def __init__(self, ell: Any) -> None:
        self.ell = number(ell, "gain.ell", above=0.0)

    def rate(self, r: Array, e: Array, n: int) -> Array:
        """dr/dt = 0."""
        return np.zeros_like(r)


class AdaptiveGain:
    """r' = p1 (((y_hat - y)^2 - p2) r^(1-2b) + p2 / r^(2n)): Sanfelice, Praly, eq. (6)."""

    moves = True

    def __init__(self, p1: Any, p2: Any, b: Any) -> None:
        self.p1 = number(p1, "gain.p1", above=0.0)
        self.p2 = number(p2, "gain.p2", above=0.0)
        self.b = number(b, "gain.b", above=0.0, below=0.5)

    def rate(self, r: Array, e: Array, n: int) -> Array:
        """dr/dt [1/s] for the gain ``r`` >= 1, the innovation ``e`` and the order ``n``."""
        return self.p1 * (
            (e * e - self.p2) * r ** (1.0 - 2.0 * self.b) + self.p2 / r ** (2 * n)
        )  # (6)


class DeadZoneGain(AdaptiveGain):
    """r' = p1 max(0, (y_hat - y)^2 - p2) r^(1-2b): Sanfelice, Praly, eq. (4)."""

    def rate(self, r: Array, e: Array, n: int) -> Array:
        """dr/dt [1/s]: never negative."""
        return self.p1 * np.maximum(0.0, e * e - self.p2) * r ** (1.0 - 2.0 * self.b)  # (4)


GainLaw = ConstantGain | AdaptiveGain


def gain_from(spec: Spec) -> GainLaw:
    """The gain law that ``spec`` describes."""
    law = choice(member(spec, "law", "gain"), "gain.law", ("constant", "adaptive", "dead-zone"))
    if law == "constant":
        return ConstantGain(member(spec, "ell", "gain"))
    kind = AdaptiveGain if law == "adaptive" else DeadZoneGain
    return kind(*(member(spec, key, "gain") for key in ("p1", "p2", "b")))
