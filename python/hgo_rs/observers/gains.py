"""Gain laws and schedules: how the high gain is chosen, and when time advances."""

from __future__ import annotations

from dataclasses import dataclass

from hgo_rs.errors import check, check_integer, check_number
from hgo_rs.read_only import Described
from hgo_rs.times import check_period


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

    p1 > 0 is the speed, sqrt(p2) the tolerated output error, b in (0, 1/2).
    """

    _kind = ("law", "adaptive")


@dataclass(frozen=True)
class DeadZoneGain(_Adaptation):
    """r' = p1 max(0, (y_hat - y)^2 - p2) r^(1-2b). Sanfelice and Praly (4). r never decreases."""

    _kind = ("law", "dead-zone")


@dataclass(frozen=True)
class HomogeneousGain(Described):
    """r(e) = rho |e|^p (1 + mu |e|), p = degree/(1 - (n - 1) degree), for order n >= 2. Levant.

    Int. J. Control 76 (2003) 924. With `degree` -1 the standard observer is Levant's
    differentiator (`HomogeneousGain.levant`): exact without noise in finite time where |phi| <= L;
    with mu > 0 the uniform one. With `degree` 0 it is the constant gain `rho` [1/s]. Coefficients
    of the literature: `hgo_rs.design.levant_coefficients(n)`.

    Parameters
    ----------
    rho : float
        Scale > 0.
    degree : float
        Homogeneity degree in [-1, 0].
    mu : float
        >= 0 [1/unit of the output]: makes large errors vanish in a bounded time.
    """

    _kind = ("law", "homogeneous")

    rho: float
    degree: float = -1.0
    mu: float = 0.0

    def __post_init__(self) -> None:
        check_number(self.rho, "rho", above=0.0)
        check_number(self.degree, "degree", least=-1.0, most=0.0)
        check_number(self.mu, "mu", least=0.0)

    @classmethod
    def levant(cls, bound: float, n: int) -> HomogeneousGain:
        """Degree -1 and rho = L^(1/n), L = `bound` >= |phi|, the n-th derivative of the output."""
        bound = check_number(bound, "bound", above=0.0)
        return cls(bound ** (1.0 / check_integer(n, "n", least=2, most=12)))


@dataclass(frozen=True)
class SwitchedGain(Described):
    """`fast` while |e| > `zone` or was so within the last `delay`, then `slow`. Ahrens, Khalil.

    Automatica 45 (2009) 936. `fast` >= `slow` > 0 [1/s], `zone` > 0 [the output's unit], `delay`
    >= 0 [s], which keeps a zero crossing of e from switching too early.
    """

    _kind = ("law", "switched")

    fast: float
    slow: float
    zone: float
    delay: float = 0.0

    def __post_init__(self) -> None:
        check_number(self.fast, "fast", above=0.0)
        remedy = "the gain at rest is the smaller one"
        check_number(self.slow, "slow", above=0.0, most=float(self.fast), remedy=remedy)
        check_number(self.zone, "zone", above=0.0)
        check_number(self.delay, "delay", least=0.0)


@dataclass(frozen=True)
class PrescribedTimeGain(Described):
    """r(t) = mu0/(deadline - t) until it reaches `r_max` [1/s], then r_max. Holloway, Krstic.

    IEEE TAC 64 (2019) 3905. t counts from the observer's start. Without noise the errors vanish
    towards the `deadline` [s], whatever the start, if all poles lie left of -(n - 1)/mu0 after
    subtracting diag(0, ..., n - 1)/mu0 from A - k C.
    """

    _kind = ("law", "prescribed-time")

    mu0: float
    deadline: float
    r_max: float

    def __post_init__(self) -> None:
        check_number(self.mu0, "mu0", above=0.0)
        check_number(self.deadline, "deadline", above=0.0)
        remedy = "above mu0/deadline, where the gain begins"
        check_number(
            self.r_max, "r_max", above=float(self.mu0) / float(self.deadline), remedy=remedy
        )


@dataclass(frozen=True)
class InnovationGain(Described):
    """theta of a `HighGainEKF` between 1 and `most`, by the innovation of a window of samples.

    theta' = mu F_0(theta) + (1 - mu) fall (1 - theta), mu = 1/(1 + exp(-slope (I - threshold)))
    F_0 = theta^2/rise for theta <= most/2, else (theta - most)^2/rise

    with I the integral of |y - y_hat|^2 over the last `samples` samples used, y_hat by the model
    from the estimate at their beginning on, without correction. Boizot, Busvelle and Gauthier,
    Automatica 46 (2010) 1483. A wrong estimate raises theta to `most` within some 3 `rise`; where
    the model predicts the samples, theta = 1 and the filter is the extended Kalman filter.

    Parameters
    ----------
    most : float
        theta_max > 1.
    rise : float
        Delta T > 0 [s].
    fall : float
        lambda > 0 [1/s].
    threshold : float
        m > 0 [unit of y^2 s]: above the I of noise alone, its variance times the window.
    slope : float
        beta > 0, in 1 over the unit of the threshold: 10/threshold makes mu(0) small.
    samples : int
        5 or 10: the window, in samples.
    """

    _kind = ("law", "innovation")

    most: float
    rise: float
    fall: float
    threshold: float
    slope: float
    samples: int = 10

    def __post_init__(self) -> None:
        check_number(self.most, "most", above=1.0, remedy="1 is the extended Kalman filter")
        for name in ("rise", "fall", "threshold", "slope"):
            check_number(getattr(self, name), name, above=0.0)
        check(self.samples in (5, 10), "samples", self.samples, "5 or 10", "choose one of them")


GainLaw = (
    ConstantGain
    | AdaptiveGain
    | DeadZoneGain
    | HomogeneousGain
    | SwitchedGain
    | PrescribedTimeGain
    | InnovationGain
)
"""Every gain law."""

WITH_R = ("adaptive", "dead-zone", "innovation")
"""Those that remember their gain r >= 1."""


@dataclass(frozen=True)
class FixedStep(Described):
    """A fixed sampling period dt [s]."""

    _kind = ("kind", "fixed")

    dt: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "dt", check_period(self.dt))

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
