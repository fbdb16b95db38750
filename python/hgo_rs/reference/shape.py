"""Shapes: what is injected in the place of the innovation e.  Arrays hold one entry a run."""

from __future__ import annotations

from typing import Any

import numpy as np

from .error import Array, Spec, choice, fail, member, number, vector


class Threshold:
    """sigma' = -decay sigma + growth e^2: what the stubborn and the dead-zone redesign share."""

    remembers = True
    alike = True

    def __init__(self, spec: Spec, n: int) -> None:
        self.decay = number(member(spec, "decay", "shape"), "shape.decay", above=0.0)
        self.growth = number(member(spec, "growth", "shape"), "shape.growth")
        self.sigma0 = number(spec.get("sigma0", 0.0), "shape.sigma0")
        if self.sigma0 < 0.0:
            raise fail("shape.sigma0", self.sigma0, ">= 0", "give a squared output error")

    def rate(self, sigma: Array, e: Array) -> Array:
        """d(sigma)/dt."""
        return np.asarray(self.growth * e**2 - self.decay * sigma)

    def within(self, sigma: Array, e: Array) -> Array:
        """sat_sqrt(sigma)(e)."""
        return np.sign(e) * np.minimum(np.abs(e), np.sqrt(sigma))


class Stubborn(Threshold):
    """v = sat_sqrt(sigma)(e): Alessandri, Zaccarian (2018)."""

    def __init__(self, spec: Spec, n: int) -> None:
        super().__init__(spec, n)
        if self.growth < self.decay:
            raise fail("shape.growth", self.growth, ">= decay", "or every correction is weakened")

    def rows(self, sigma: Array, e: Array) -> Array:
        """v, (runs,)."""
        return self.within(sigma, e)


class DeadZone(Threshold):
    """v = e - sat_sqrt(sigma)(e): Astolfi, Alessandri, Zaccarian (2021)."""

    def __init__(self, spec: Spec, n: int) -> None:
        super().__init__(spec, n)
        if not 0.0 <= self.growth < self.decay:
            raise fail("shape.growth", self.growth, "in [0, decay)", "or nothing is injected")

    def rows(self, sigma: Array, e: Array) -> Array:
        """v, (runs,)."""
        return e - self.within(sigma, e)


class PiecewiseLinear:
    """v_i = e - (1 - ratio^i) sat_zone(e): Prasov, Khalil (2013)."""

    remembers = False
    alike = False

    def __init__(self, spec: Spec, n: int) -> None:
        self.n = n
        self.ratio = number(member(spec, "ratio", "shape"), "shape.ratio", above=0.0)
        self.zone = number(member(spec, "zone", "shape"), "shape.zone", above=0.0)
        if self.ratio > 1.0:
            raise fail("shape.ratio", self.ratio, "<= 1", "the gain inside is the smaller one")

    def rows(self, sigma: Array, e: Array) -> Array:
        """v, (n, runs)."""
        powers = self.ratio ** np.arange(1, self.n + 1)
        return np.asarray(e - (1.0 - powers)[:, None] * np.clip(e, -self.zone, self.zone))


class Fal:
    """v_i = e/delta^(1-alpha_i) within |e| <= delta, sign(e) |e|^alpha_i outside: Han (2009)."""

    remembers = False
    alike = False

    def __init__(self, spec: Spec, n: int) -> None:
        self.alpha = vector(member(spec, "alpha", "shape"), "shape.alpha", n)
        self.delta = number(member(spec, "delta", "shape"), "shape.delta", above=0.0)
        if not np.all((self.alpha > 0.0) & (self.alpha <= 1.0)):
            raise fail("shape.alpha", self.alpha.tolist(), "in (0, 1]", "take 1, 1/2, 1/4")

    def rows(self, sigma: Array, e: Array) -> Array:
        """v, (n, runs)."""
        alpha = self.alpha[:, None]
        linear = e * self.delta ** (alpha - 1.0)
        return np.where(np.abs(e) <= self.delta, linear, np.sign(e) * np.abs(e) ** alpha)


class BiHomogeneous:
    """v_1 = phi_1(e), v_i = phi_i(v_(i-1)), phi_i(s) = kappa_i |s|^p_i + theta_i |s|^q_i, signed.

    Andrieu, Praly, Astolfi (2008); Cruz-Zavala, Moreno (2019).
    """

    remembers = False
    alike = False

    def __init__(self, spec: Spec, n: int) -> None:
        near = number(member(spec, "near", "shape"), "shape.near")
        far = number(member(spec, "far", "shape"), "shape.far")
        self.kappa = vector(member(spec, "kappa", "shape"), "shape.kappa", n)
        self.theta = vector(member(spec, "theta", "shape"), "shape.theta", n)
        holds = -1.0 <= near <= far and (n - 1) * far < 1.0
        if not holds or np.any(np.minimum(self.kappa, self.theta) < 0.0):
            raise fail("shape", (near, far), "-1 <= near <= far < 1/(n-1)", "see BiHomogeneous")
        left = np.arange(n - 1, -1, -1)
        self.p, self.q = ((1.0 - (left - 1) * d) / (1.0 - left * d) for d in (near, far))

    def rows(self, sigma: Array, e: Array) -> Array:
        """v, (n, runs)."""
        rows, s = [], e
        for kappa, theta, p, q in zip(self.kappa, self.theta, self.p, self.q, strict=True):
            s = np.sign(s) * (kappa * np.abs(s) ** p + theta * np.abs(s) ** q)
            rows.append(s)
        return np.array(rows)


Shape = Any
"""One of the classes here."""

SHAPES = {
    "stubborn": Stubborn,
    "dead-zone": DeadZone,
    "piecewise-linear": PiecewiseLinear,
    "fal": Fal,
    "bi-homogeneous": BiHomogeneous,
}


def shape_from(spec: Spec, n: int) -> Shape | None:
    """The shape of an observer's spec; None where e itself is injected."""
    told = spec.get("shape")
    if told is None:
        return None
    return SHAPES[choice(member(told, "law", "shape"), "shape.law", tuple(SHAPES))](told, n)
