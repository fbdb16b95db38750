"""When time advances: a fixed step T, or the decreasing steps of stochastic approximation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .error import Array, Spec, choice, member, number


class FixedStep:
    """dt(k) = T."""

    def __init__(self, spec: Spec) -> None:
        self.dt = number(member(spec, "dt", "schedule"), "schedule.dt", above=0.0)

    def steps(self, k: NDArray[np.int64]) -> Array:
        """dt(k) [s] at the step indices ``k``, shape of ``k``."""
        return np.full(k.shape, self.dt, dtype=np.float64)

    def times(self, k: NDArray[np.int64], start: float) -> Array:
        """t(k) [s]; ``start`` = t(k[0]) is not needed: t(k) = k T."""
        return np.multiply(k, self.dt, dtype=np.float64)


class StochasticApproximation:
    """a(k) = alpha epsilon b(k), b(k) = (1 + k/k0)^-p: Lee, Choi, Khalil, eq. (21) and (44)."""

    def __init__(self, spec: Spec) -> None:
        self.alpha = number(member(spec, "alpha", "schedule"), "schedule.alpha", above=0.0)
        self.epsilon = number(member(spec, "epsilon", "schedule"), "schedule.epsilon", above=0.0)
        self.k0 = number(member(spec, "k0", "schedule"), "schedule.k0", above=0.0)
        self.p = number(member(spec, "p", "schedule"), "schedule.p", above=0.0)

    def steps(self, k: NDArray[np.int64]) -> Array:
        """a(k) [s] at the step indices ``k``."""
        return self.alpha * self.epsilon * (1.0 + k / self.k0) ** -self.p  # (21)

    def times(self, k: NDArray[np.int64], start: float) -> Array:
        """t(k) = a(0) + ... + a(k-1) [s] at consecutive indices ``k``, given t(k[0]) = start."""
        increments = self.steps(k)
        increments = np.concatenate(([start], increments[:-1]))
        return np.cumsum(increments)


Schedule = FixedStep | StochasticApproximation


def schedule_from(spec: Spec, where: str = "schedule") -> Schedule:
    """The schedule that ``spec`` describes."""
    kind = choice(
        member(spec, "kind", where), f"{where}.kind", ("fixed", "stochastic-approximation")
    )
    return FixedStep(spec) if kind == "fixed" else StochasticApproximation(spec)
