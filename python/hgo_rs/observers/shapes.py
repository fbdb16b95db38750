"""Shapes: what an observer injects in the place of its innovation e."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from hgo_rs.errors import check, check_number
from hgo_rs.read_only import Described


@dataclass(frozen=True)
class Shape(Described):
    """What stands between the innovation e and the injection: `shape=` of an observer.

    `alike`: whether every row of the injection takes the same value, so that any law takes the
    shape and "zoh" places its injection.
    """

    alike: ClassVar[bool] = True


@dataclass(frozen=True)
class _Threshold(Shape):
    decay: float
    growth: float
    sigma0: float = 0.0

    def __post_init__(self) -> None:
        check_number(self.decay, "decay", above=0.0)
        check_number(self.sigma0, "sigma0", least=0.0)


@dataclass(frozen=True)
class Stubborn(_Threshold):
    """v = sat(e) at the level sqrt(sigma), sigma' = -decay sigma + growth e^2.

    Alessandri and Zaccarian, Automatica 88 (2018). An outlier is clipped to the size of earlier
    errors. `growth` >= `decay` [1/s]: a steady error is then injected completely; `sigma0` is
    sigma(0), in the square of the output's unit.
    """

    _kind = ("law", "stubborn")

    def __post_init__(self) -> None:
        super().__post_init__()
        remedy = "below decay every slow correction is weakened"
        check_number(self.growth, "growth", least=float(self.decay), remedy=remedy)


@dataclass(frozen=True)
class DeadZone(_Threshold):
    """v = e - sat(e) at the level sqrt(sigma), sigma' = -decay sigma + growth e^2.

    Astolfi, Alessandri and Zaccarian, IEEE TAC 66 (2021) 667. Persistent small noise is not
    injected. `growth` in [0, `decay`) [1/s]: of a steady error 1 - sqrt(growth/decay) is injected.
    """

    _kind = ("law", "dead-zone")

    def __post_init__(self) -> None:
        super().__post_init__()
        remedy = "from decay on a steady error is never injected"
        check_number(self.growth, "growth", least=0.0, below=float(self.decay), remedy=remedy)


@dataclass(frozen=True)
class PiecewiseLinear(Shape):
    """The gain `ratio` ell within |e| <= `zone`, ell outside. Prasov and Khalil.

    IEEE TAC 58 (2013) 569.
    v_i = e - (1 - ratio^i) sat(e) at the level `zone` [the output's unit]; `ratio` in (0, 1]. From
    order 3 on an observer refuses a ratio that fails the circle criterion.
    """

    alike = False
    _kind = ("law", "piecewise-linear")

    ratio: float
    zone: float

    def __post_init__(self) -> None:
        check_number(self.ratio, "ratio", above=0.0, most=1.0)
        check_number(self.zone, "zone", above=0.0)


def _numbers(values: Any, name: str, **limits: Any) -> tuple[float, ...]:
    """Numbers within limits, one for each state."""
    try:
        given = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        given = ()
    check(bool(given), name, values, "numbers, one for each state", "give them in a tuple")
    return tuple(check_number(value, name, **limits) for value in given)


@dataclass(frozen=True)
class Fal(Shape):
    """v_i = fal(e, alpha_i, delta). Han, IEEE TIE 56 (2009) 900.

    fal is e/delta^(1 - alpha) within |e| <= `delta` [the output's unit] and sign(e) |e|^alpha
    outside; `alpha`: one exponent in (0, 1] for each state.
    """

    alike = False
    _kind = ("law", "fal")

    alpha: tuple[float, ...]
    delta: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "alpha", _numbers(self.alpha, "alpha", above=0.0, most=1.0))
        check_number(self.delta, "delta", above=0.0)


@dataclass(frozen=True)
class BiHomogeneous(Shape):
    """One homogeneity degree near 0, `near`, another far away, `far`. Andrieu, Praly, Astolfi.

    SIAM J. Control Optim. 47 (2008) 1814; Cruz-Zavala and Moreno, IEEE TAC 64 (2019).
    v_1 = phi_1(e), v_i = phi_i(v_(i-1)), phi_i(s) = kappa_i s^p_i + theta_i s^q_i with signed
    powers, p_i = (1 - (n-i-1) near)/(1 - (n-i) near), q_i the same with `far`. -1 <= near <= far
    < 1/(n - 1); `kappa`, `theta` >= 0, one for each state, not both 0. With near = -1 and far > 0
    the errors vanish in a time that is bounded for all starts. The gain grows with the error, so
    long steps may diverge from large errors.
    """

    alike = False
    _kind = ("law", "bi-homogeneous")

    near: float
    far: float
    kappa: tuple[float, ...]
    theta: tuple[float, ...]

    def __post_init__(self) -> None:
        check_number(self.far, "far", least=-1.0)
        check_number(self.near, "near", least=-1.0, most=float(self.far))
        for name in ("kappa", "theta"):
            values = _numbers(getattr(self, name), name, least=0.0)
            object.__setattr__(self, name, values)
        remedy = "give both one number for each state, not both of them 0"
        both = list(zip(self.kappa, self.theta, strict=False))
        fits = len(self.kappa) == len(self.theta) and all(k + t > 0.0 for k, t in both)
        check(fits, "kappa, theta", (self.kappa, self.theta), "of one length, sums > 0", remedy)
        check_number(float(self.far) * (len(both) - 1), "far (n - 1)", below=1.0)
