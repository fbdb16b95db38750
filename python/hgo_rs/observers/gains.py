"""Gain laws and schedules: how the high gain is chosen, and when time advances."""

from __future__ import annotations

from dataclasses import dataclass

from hgo_rs.errors import check_number
from hgo_rs.read_only import Described


@dataclass(frozen=True)
class ConstantGain(Described):
    """A fixed gain ell [1/s]; ell = 1/epsilon in Khalil's notation."""

    _kind = ("law", "constant")

    ell: float

    def __post_init__(self) -> None:
        check_number(self.ell, "ell", above=0.0)

    @classmethod
    def from_epsilon(cls, epsilon: float) -> ConstantGain:
        """Gain 1/epsilon, epsilon > 0 [s]."""
        return cls(1.0 / check_number(epsilon, "epsilon", above=0.0))


@dataclass(frozen=True)
class _Adaptation(Described):
    p1: float
    p2: float
    b: float

    def __post_init__(self) -> None:
        check_number(self.p1, "p1", above=0.0)
        check_number(self.p2, "p2", above=0.0)
        check_number(self.b, "b", above=0.0, below=0.5, remedy="Sanfelice and Praly (8)-(10)")


@dataclass(frozen=True)
class AdaptiveGain(_Adaptation):
    """r' = p1 (((y_hat - y)^2 - p2) r^(1-2b) + p2/r^(2n)). Sanfelice and Praly (6).

    p1 > 0 is the speed, sqrt(p2) the output error that is tolerated, b in (0, 1/2).
    """

    _kind = ("law", "adaptive")


@dataclass(frozen=True)
class DeadZoneGain(_Adaptation):
    """r' = p1 max(0, (y_hat - y)^2 - p2) r^(1-2b). Sanfelice and Praly (4). r never decreases."""

    _kind = ("law", "dead-zone")


@dataclass(frozen=True)
class FixedStep(Described):
    """A fixed sampling period dt [s]."""

    _kind = ("kind", "fixed")

    dt: float

    def __post_init__(self) -> None:
        check_number(self.dt, "dt", above=0.0)

    @property
    def longest(self) -> float:
        """The longest step [s]."""
        return float(self.dt)


@dataclass(frozen=True)
class StochasticApproximation(Described):
    """Decreasing steps a(k) = alpha epsilon (1 + k/k0)^-p. Lee, Choi and Khalil (21).

    alpha > 0, epsilon > 0 [s], k0 > 0 [steps], p > 0; (A.2) of the paper holds for 1/2 < p <= 1.
    """

    _kind = ("kind", "stochastic-approximation")

    alpha: float
    epsilon: float
    k0: float
    p: float = 1.0

    def __post_init__(self) -> None:
        for name in ("alpha", "epsilon", "k0", "p"):
            check_number(getattr(self, name), name, above=0.0)

    @property
    def longest(self) -> float:
        """The longest step a(0) [s]."""
        return float(self.alpha * self.epsilon)
