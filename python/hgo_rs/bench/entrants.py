"""What takes part: every law of the list, its gain laws and shapes, and filters that users know.

An entrant makes an observer from one number, its speed [1/s].  Laws come from the list: one that is
added there takes part, as far as `HighGainObserver` makes it of an order and a gain.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hgo_rs.bench.systems import DT, Array
from hgo_rs.design import levant_coefficients
from hgo_rs.laws import LAWS, Law
from hgo_rs.models import System
from hgo_rs.observers import (
    AdaptiveGain,
    BiHomogeneous,
    DeadZone,
    DeadZoneGain,
    Fal,
    HighGainEKF,
    HighGainObserver,
    HomogeneousGain,
    InnovationGain,
    Observer,
    PiecewiseLinear,
    PrescribedTimeGain,
    StandardObserver,
    Stubborn,
    SwitchedGain,
    WindowObserver,
)
from hgo_rs.observers.window import LENGTHS
from hgo_rs.tuning.reference import butterworth

STANDARD = "standard"
"""What the others are compared with."""


@dataclass(frozen=True)
class Asked:
    """What an observer is made for: order, speed [1/s], RMS of the noise, model, and levels
    (n - 1,) that the states x_2 ... x_n keep below.
    """

    n: int
    speed: float
    noise: float
    model: System | None
    levels: Array


@dataclass(frozen=True)
class Entrant:
    """``name``, ``make``; ``kind``: the law by its word in the list; ``models``: whether it takes a
    model; ``orders``: those that it is made for.
    """

    name: str
    make: Callable[[Asked], Observer]
    kind: str
    models: bool = True
    orders: tuple[int, ...] = (2, 3, 4, 5)


LEFT_OUT = {
    "collection": "each copy has its own gain: there is no common speed",
    "modified": "each copy has its own gain: there is no common speed",
    "sampled-data": "needs a model in discrete time with gains of its own",
    "reduced-order": "needs all positions of a system and a strict-feedback model",
    "stochastic approximation": "a schedule of decreasing steps: its speed is not constant",
}
"""Laws that have no place on this bench, and why."""


def entrants() -> list[Entrant]:
    """All of them, the standard law first."""
    found = [_of_law(law) for law in LAWS.values() if law.single]
    found.sort(key=lambda one: one.name != STANDARD)
    return [*found, *_filters(), *_poles(), *_gains(), *_shapes()]


def _of_law(law: Law) -> Entrant:
    def make(asked: Asked) -> Observer:
        more: dict[str, Any] = {"saturation": asked.levels} if law.saturated else {}
        return HighGainObserver(law.kind, asked.n, asked.speed, model=asked.model, **more)

    return Entrant(
        law.kind, make, law.kind, orders=tuple(n for n in (2, 3, 4, 5) if n in law.orders)
    )


def _filters() -> list[Entrant]:
    def kalman(asked: Asked) -> Observer:
        variance = asked.noise**2
        q = variance * DT * asked.speed ** (2 * asked.n)
        return HighGainEKF(asked.n, R=variance, Q=q, model=asked.model)

    def adaptive(asked: Asked) -> Observer:
        window, variance = 5, asked.noise**2
        threshold = 4.0 * variance * window * DT
        gain = InnovationGain(
            most=5.0,
            rise=window * DT,
            fall=asked.speed,
            threshold=threshold,
            slope=10.0 / threshold,
            samples=window,
        )
        q = variance * DT * asked.speed ** (2 * asked.n)
        return HighGainEKF(asked.n, R=variance, Q=q, gain=gain, model=asked.model)

    def savitzky_golay(asked: Asked) -> Observer:
        wanted = max(1.0 / (asked.speed * DT), asked.n)
        length = max(m for m in LENGTHS if m <= wanted)
        return WindowObserver.savitzky_golay(length, asked.n - 1, DT)

    def dirty(asked: Asked) -> Observer:
        return WindowObserver.dirty_derivative(1.0 / asked.speed, DT)

    return [
        Entrant("extended Kalman filter", kalman, "high-gain-ekf"),
        Entrant("adaptive high-gain EKF", adaptive, "high-gain-ekf"),
        Entrant("Savitzky-Golay", savitzky_golay, "window", models=False),
        Entrant("dirty derivative", dirty, "window", models=False, orders=(2,)),
    ]


def _poles() -> list[Entrant]:
    def memory(asked: Asked) -> Observer:
        theta = math.exp(-asked.speed * DT)
        return StandardObserver.fading_memory(asked.n, theta, DT, model=asked.model)

    def steady(asked: Asked) -> Observer:
        return _standard(asked, asked.speed, poles=butterworth(asked.n))

    return [
        Entrant("alpha-beta-gamma, fading memory", memory, STANDARD),
        Entrant("steady Kalman, Butterworth", steady, STANDARD),
    ]


def _standard(asked: Asked, gain: Any, **more: Any) -> Observer:
    return StandardObserver(asked.n, gain, model=asked.model, **more)


def _gains() -> list[Entrant]:
    """The standard law under each gain law: levels from the noise, times from the speed."""

    def add(name: str, gain: Callable[[Asked], Any], **more: Any) -> Entrant:
        return Entrant(name, lambda asked: _standard(asked, gain(asked), **more), STANDARD)

    def levant(method: str) -> Entrant:
        def make(asked: Asked) -> Observer:
            k = levant_coefficients(asked.n)
            return _standard(asked, HomogeneousGain(asked.speed), k=k, method=method)

        return Entrant(f"Levant's differentiator, {method}", make, STANDARD)

    def homogeneous(asked: Asked) -> Observer:
        return _standard(asked, HomogeneousGain(asked.speed, -0.5))

    def inter_sample(asked: Asked) -> Observer:
        return _standard(asked, asked.speed, method="inter-sample")

    return [
        *map(levant, ("zoh", "proper", "implicit", "inter-sample")),
        Entrant("homogeneous gain, degree -1/2", homogeneous, STANDARD),
        Entrant("inter-sample predictor", inter_sample, STANDARD),
        add("adaptive gain", lambda of: AdaptiveGain(of.speed, (6.0 * of.noise) ** 2, 0.183)),
        add("dead-zone gain", lambda of: DeadZoneGain(of.speed, (6.0 * of.noise) ** 2, 0.183)),
        add(
            "switched gain",
            lambda of: SwitchedGain(of.speed, 0.5 * of.speed, 5.0 * of.noise, 5.0 * DT),
        ),
        add(
            "prescribed-time gain",
            lambda of: PrescribedTimeGain(2.0 * of.n, 10.0 * of.n / of.speed, of.speed),
        ),
    ]


def _shapes() -> list[Entrant]:
    def add(name: str, shape: Callable[[Asked], Any]) -> Entrant:
        return Entrant(name, lambda of: _standard(of, of.speed, shape=shape(of)), STANDARD)

    def stubborn(of: Asked) -> Stubborn:
        decay = 0.1 * of.speed
        return Stubborn(decay, 4.0 * decay, (4.0 * of.noise) ** 2)

    def dead_zone(of: Asked) -> DeadZone:
        decay = 0.1 * of.speed
        return DeadZone(decay, 0.25 * decay)

    def fal(of: Asked) -> Fal:
        return Fal(tuple(1.0 - 0.5 * i / of.n for i in range(of.n)), 10.0 * of.noise)

    def both(of: Asked) -> BiHomogeneous:
        ones = np.ones(of.n)
        return BiHomogeneous(-0.3, 0.3 / of.n, tuple(ones), tuple(0.3 * ones))

    return [
        add("stubborn", stubborn),
        add("dead zone", dead_zone),
        add("piecewise-linear", lambda of: PiecewiseLinear(0.6, 5.0 * of.noise)),
        add("fal", fal),
        add("bi-homogeneous", both),
    ]
