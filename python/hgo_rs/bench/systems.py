"""Systems of the bench: true states, what is known of them, and samples under each condition."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from hgo_rs.models import Model

Array = npt.NDArray[np.float64]
State = tuple[float, ...]

DT = 0.01
"""Sampling period [s]."""
COUNT = 3000
"""Samples of a record."""
_FINE = 10  # parts of a period that true states are computed at
_PARTS = ((0.7, 0.3, 0.1), (0.6, 0.6, 1.2), (0.5, 0.9, 2.5))  # amplitude, rad/s, phase
_FIRST, _GAP, _GAPS = 600, 40, (700, 1500, 2300)  # samples
_JITTER = 0.3  # of the period
_SPIKES, _HIGH = 0.01, 20.0  # part of the samples, standard deviations
_BAND = (8.0, 12.0)  # Hz
_LACK = 1.2

CONDITIONS: Mapping[str, str] = {
    "bias": "error without noise: lag and model error",
    "white": "white noise",
    "quantised": "rounding to steps, of the same RMS",
    "band": f"noise from {_BAND[0]:g} to {_BAND[1]:g} Hz, of the same RMS",
    "outliers": f"white noise, and {_SPIKES:.0%} of the samples off by {_HIGH:g} times as much",
    "gap": f"white noise, gaps of {_GAP} samples; evaluated in the gaps and as long after them",
    "jitter": f"white noise, known times that deviate by up to {_JITTER:.0%} of the period",
}
"""What a record is like, by name."""


@dataclass(frozen=True, eq=False)
class System:
    """A system whose states are known.

    ``group``: systems that are looked at together.  ``fine``: true states, ten a period.  ``u``:
    inputs at the samples, or None.  ``model``: what an observer knows, a right side that is too
    strong by a fifth; None where it knows nothing.
    """

    name: str
    group: str
    n: int
    fine: Array  # (COUNT * _FINE + 1, n)
    u: Array | None
    model: Model | None

    @cached_property
    def x(self) -> Array:
        """True states at the samples, (COUNT, n)."""
        return self.fine[: COUNT * _FINE : _FINE]

    @cached_property
    def size(self) -> float:
        """RMS of the last state."""
        return float(np.sqrt(np.mean(self.x[:, -1] ** 2)))

    def record(
        self, condition: str, noise: float
    ) -> tuple[float | Array, Array, Array, npt.NDArray[np.bool_]]:
        """Times or period, samples, true states, and which samples are judged.

        ``noise``: the RMS of what is added.
        """
        rng = np.random.default_rng(sum(map(ord, self.name)))
        white = noise * rng.standard_normal(COUNT)
        judged = np.arange(COUNT) >= _FIRST
        clock: float | Array = DT
        x, y = self.x, self.x[:, 0]
        if condition == "white":
            y = y + white
        elif condition == "quantised":
            step = noise * np.sqrt(12.0)
            y = step * np.round(y / step)
        elif condition == "band":
            rates, phases = rng.uniform(*_BAND, 12), rng.uniform(0.0, 2.0 * np.pi, 12)
            t = DT * np.arange(COUNT)
            waves = np.sin(2.0 * np.pi * rates * t[:, None] + phases)
            y = y + noise * np.sqrt(2.0 / 12.0) * waves.sum(axis=1)
        elif condition == "outliers":
            signs = np.where(rng.random(COUNT) < 0.5, -1.0, 1.0)
            y = y + white + (rng.random(COUNT) < _SPIKES) * signs * _HIGH * noise
        elif condition == "gap":
            y, judged = y + white, np.zeros(COUNT, dtype=bool)
            for first in _GAPS:
                y[first : first + _GAP] = np.nan
                judged[first : first + 2 * _GAP] = True
        elif condition == "jitter":
            off = np.round(_JITTER * _FINE * rng.uniform(-1.0, 1.0, COUNT)).astype(int)
            off[0] = 0
            places = _FINE * np.arange(COUNT) + off
            clock, x = DT / _FINE * places, self.fine[places]
            y = x[:, 0] + white
        return clock, np.asarray(y), x, judged


def _chain(n: int) -> System:
    """A signal of three sines, of which nothing is known."""
    t = DT / _FINE * np.arange(COUNT * _FINE + 1)
    x = np.zeros((len(t), n))
    for size, rate, phase in _PARTS:
        for i in range(n):
            x[:, i] += size * rate**i * np.sin(rate * t + phase + 0.5 * np.pi * i)
    return System(f"chain, n = {n}", f"chain, n = {n}", n, x, None, None)


def _moved(
    name: str,
    start: State,
    rate: Callable[[State, float], float],
    model: Model,
    u: Array | None = None,
) -> System:
    """A system by RK4, its input held over each period."""
    n, h = len(start), DT / _FINE
    fine, x = [start], start

    def on(x: State, by: float, slope: State) -> State:
        return tuple(a + by * b for a, b in zip(x, slope, strict=True))

    for k in range(COUNT * _FINE):
        told = 0.0 if u is None else float(u[k // _FINE])
        a = (*x[1:], rate(x, told))
        two = on(x, 0.5 * h, a)
        b = (*two[1:], rate(two, told))
        three = on(x, 0.5 * h, b)
        c = (*three[1:], rate(three, told))
        four = on(x, h, c)
        d = (*four[1:], rate(four, told))
        slope = tuple(p + 2.0 * (q + r) + s for p, q, r, s in zip(a, b, c, d, strict=True))
        x = on(x, h / 6.0, slope)
        fine.append(x)
    group = f"system, n = {n}, model 20 % off"
    return System(name, group, n, np.array(fine), u, model)


def _square(size: float, seconds: float) -> Array:
    """An input that changes its sign."""
    turns = (DT * np.arange(COUNT) / seconds).astype(int)
    return np.asarray(size * np.where(turns % 2 == 0, 1.0, -1.0))


def _model(phi: str, n: int = 2, inputs: tuple[str, ...] = ()) -> Model:
    """Too strong by `_LACK`."""
    states = [f"x{i + 1}" for i in range(n)]
    return Model(states=states, inputs=list(inputs), parameters={"s": _LACK}, phi=f"s*({phi})")


def systems() -> list[System]:
    """Chains of integrators, systems of the papers, a drive with friction, a pendulum."""
    crackle = "saturate(0.2*(x1**2 - 1) - x2 - x3 - 4*x4 - x5, -3, 3)"
    return [
        *(_chain(n) for n in (2, 3, 4, 5)),
        _moved(
            "Lee et al., driven",
            (1.0, 0.0),
            lambda x, u: -x[0] / (1.0 + x[0] ** 2) - x[1] + u,
            _model("-x1/(1 + x1**2) - x2 + u", inputs=("u",)),
            _square(1.0, 2.0),
        ),
        _moved(
            "Van der Pol (Fu et al.)",
            (1.0, 0.0),
            lambda x, _: -x[0] + 0.8 * (1.0 - x[0] ** 2) * x[1],
            _model("saturate(-x1 + 0.8*(1 - x1**2)*x2, -20, 20)"),
        ),
        _moved(
            "crackle (Astolfi et al.)",
            (-0.8, 0.0, 0.0, 0.0, 0.0),
            lambda x, _: 0.2 * (x[0] ** 2 - 1.0) - x[1] - x[2] - 4.0 * x[3] - x[4],
            _model(crackle, n=5),
        ),
        _moved(
            "drive with friction",
            (0.0, 0.0),
            lambda x, u: u - 0.5 * x[1] - 0.6 * math.tanh(x[1] / 0.05),
            _model("u - 0.5*x2 - 0.6*tanh(x2/0.05)", inputs=("u",)),
            _square(1.5, 3.0),
        ),
        _moved(
            "pendulum",
            (2.0, 0.0),
            lambda x, u: -9.81 * math.sin(x[0]) - 0.3 * x[1] + u,
            _model("-9.81*sin(x1) - 0.3*x2 + u", inputs=("u",)),
            _square(3.0, 1.7),
        ),
    ]
