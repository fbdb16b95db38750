"""Gain laws: how the gain g of an observer (ell or r) moves.  Arrays hold one entry a run.

A law `moves` if it remembers a number, `least` 1 where that is r itself.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .error import Array, Spec, choice, fail, member, number


class _Law:
    """What most laws say alike."""

    moves = True
    least: float | None = None

    def moving(self, memory: Array, e: Array) -> Array:
        """g, for what is remembered and the innovation."""
        return memory

    def rate(self, memory: Array, e: Array, n: int) -> Array:
        """d(memory)/dt."""
        return np.zeros_like(memory)

    def jumped(self, memory: Array, e: Array) -> Array:
        """What is remembered at a sample, before its step."""
        return memory


class ConstantGain(_Law):
    """g = ell, no memory."""

    moves = False

    def __init__(self, ell: Any) -> None:
        self.ell = number(ell, "gain.ell", above=0.0)


class AdaptiveGain(_Law):
    """r' = p1 (((y_hat - y)^2 - p2) r^(1-2b) + p2 / r^(2n)): Sanfelice, Praly, eq. (6)."""

    least = 1.0

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


class HomogeneousGain(_Law):
    """g = rho |e|^(d/(1 - (n-1) d)) (1 + mu |e|), 0 at e = 0: Levant (2003)."""

    moves = False

    def __init__(self, rho: Any, degree: Any, mu: Any, n: int) -> None:
        self.rho = number(rho, "gain.rho", above=0.0)
        self.mu = number(mu, "gain.mu")
        degree = number(degree, "gain.degree")
        if not -1.0 <= degree <= 0.0 or self.mu < 0.0 or n < 2:
            allowed = "degree in [-1, 0], mu >= 0, order >= 2"
            raise fail("gain", (degree, self.mu, n), allowed, "see HomogeneousGain")
        self.power = degree / (1.0 - (n - 1) * degree)

    def moving(self, memory: Array, e: Array) -> Array:
        """rho |e|^p (1 + mu |e|); what it multiplies is 0 where e is."""
        size = np.abs(e)
        grown = np.where(size > 0.0, size, 1.0) ** self.power * (1.0 + self.mu * size)
        return np.asarray(np.where(size > 0.0, self.rho * grown, self.rho))

    def closing(self, k: Array, b: Array, dt: float) -> Array:
        """k_i rho^i |e+|^((n-i)/n) sign b, (n, runs), of an implicit step: degree -1, mu = 0.

        s = |e+|^(1/n) is the root of s^n + g_1 s^(n-1) + ... + g_n = |b|, by bisection; below
        |b| = g_n it is 0, and b/g_n stands for the sign.
        """
        n = len(k)
        powers = np.arange(1, n + 1)[:, None]
        of = k[:, None] * self.rho**powers
        g = of * dt**powers
        left = np.maximum(np.abs(b) - g[-1], 0.0)
        low, high = np.zeros_like(left), left ** (1.0 / n)
        for _ in range(200):
            s = 0.5 * (low + high)
            value = s ** (n + 0.0) + np.sum(g[:-1] * s ** (n - powers[:-1]), axis=0)
            low, high = np.where(value < left, s, low), np.where(value < left, high, s)
        sign = np.where(np.abs(b) <= g[-1], b / g[-1], np.sign(b))
        last = np.ones_like(s)
        return np.asarray(of * np.vstack([s ** (n - powers[:-1]), last[None]]) * sign)


class SwitchedGain(_Law):
    """g = fast while |e| > zone or the quiet time s < delay, else slow: Ahrens, Khalil (2009)."""

    def __init__(self, fast: Any, slow: Any, zone: Any, delay: Any) -> None:
        self.fast = number(fast, "gain.fast", above=0.0)
        self.slow = number(slow, "gain.slow", above=0.0)
        self.zone = number(zone, "gain.zone", above=0.0)
        self.delay = number(delay, "gain.delay")
        if self.slow > self.fast or self.delay < 0.0:
            allowed = "slow <= fast and delay >= 0"
            raise fail("gain", (self.fast, self.slow, self.delay), allowed, "see SwitchedGain")

    def moving(self, memory: Array, e: Array) -> Array:
        """fast or slow."""
        loud = (np.abs(e) > self.zone) | (memory < self.delay)
        return np.asarray(np.where(loud, self.fast, self.slow))

    def rate(self, memory: Array, e: Array, n: int) -> Array:
        """ds/dt = 1 while it is quiet."""
        return np.where(np.abs(e) > self.zone, 0.0, 1.0) + 0.0 * memory

    def jumped(self, memory: Array, e: Array) -> Array:
        """s = 0 where |e| > zone."""
        return np.where(np.abs(e) > self.zone, 0.0, memory)


class PrescribedTimeGain(_Law):
    """g = min(mu0/(deadline - s), r_max), then r_max; s counts time: Holloway, Krstic (2019)."""

    def __init__(self, mu0: Any, deadline: Any, r_max: Any) -> None:
        self.mu0 = number(mu0, "gain.mu0", above=0.0)
        self.deadline = number(deadline, "gain.deadline", above=0.0)
        self.r_max = number(r_max, "gain.r_max", above=self.mu0 / self.deadline)

    def moving(self, memory: Array, e: Array) -> Array:
        """mu0/(time left), at most r_max."""
        left = self.deadline - memory
        growing = left > self.mu0 / self.r_max
        return np.asarray(np.where(growing, self.mu0 / np.where(growing, left, 1.0), self.r_max))

    def rate(self, memory: Array, e: Array, n: int) -> Array:
        """ds/dt = 1."""
        return np.ones_like(memory)


GainLaw = ConstantGain | AdaptiveGain | HomogeneousGain | SwitchedGain | PrescribedTimeGain

LAWS: dict[str, tuple[Any, tuple[str, ...]]] = {
    "constant": (ConstantGain, ("ell",)),
    "adaptive": (AdaptiveGain, ("p1", "p2", "b")),
    "dead-zone": (DeadZoneGain, ("p1", "p2", "b")),
    "homogeneous": (HomogeneousGain, ("rho", "degree", "mu")),
    "switched": (SwitchedGain, ("fast", "slow", "zone", "delay")),
    "prescribed-time": (PrescribedTimeGain, ("mu0", "deadline", "r_max")),
}
"""The laws and the entries of their specs."""
OPTIONAL = {"mu": 0.0, "delay": 0.0}


def gain_from(spec: Spec, n: int) -> GainLaw:
    """The gain law that ``spec`` describes, for an observer of order n."""
    law = choice(member(spec, "law", "gain"), "gain.law", tuple(LAWS))
    make, keys = LAWS[law]
    given = {key: member({**OPTIONAL, **spec}, key, "gain") for key in keys}
    made: GainLaw = make(**given, n=n) if law == "homogeneous" else make(**given)
    return made
