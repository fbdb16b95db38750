"""Shapes: what an observer injects in the place of its innovation e."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

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

    Alessandri and Zaccarian, Automatica 88 (2018). An outlier moves the estimate by no more than
    the errors before it did. `growth` >= `decay`
    [1/s]: a steady error is then injected whole; `sigma0` is sigma(0), in the square of the
    output's unit.
    """

    _kind = ("law", "stubborn")

    def __post_init__(self) -> None:
        super().__post_init__()
        remedy = "below decay every slow correction is weakened"
        check_number(self.growth, "growth", least=self.decay, remedy=remedy)


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
        check_number(self.growth, "growth", least=0.0, below=self.decay, remedy=remedy)


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
        allowed, remedy = "numbers in (0, 1], one for each state", "take 1, 1/2, 1/4"
        try:
            exponents = tuple(float(alpha) for alpha in self.alpha)
        except (TypeError, ValueError):
            exponents = ()
        check(bool(exponents), "alpha", self.alpha, allowed, remedy)
        for alpha in exponents:
            check_number(alpha, "alpha", above=0.0, most=1.0, remedy=remedy)
        object.__setattr__(self, "alpha", exponents)
        check_number(self.delta, "delta", above=0.0)
