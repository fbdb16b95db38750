"""The papers' observers on the papers' systems, live: a page of the documentation.

What `python -m hgo_rs.pages showcase.html` writes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hgo_rs.config import Config
from hgo_rs.models import Crackle, Lee, SanfelicePraly, System, VanDerPol
from hgo_rs.observers import (
    LowPowerObserver,
    Observer,
    PeakingFreeObserver,
    StandardObserver,
)
from hgo_rs.pages.drawn import Drawn
from hgo_rs.pages.live import Reference, structure, system
from hgo_rs.pages.module import assembled, require_module
from hgo_rs.simulation import Noise, NormalNoise, UniformNoise, simulate

_REACH = 30.0
"""The slider's gains go from this part of an observer's gain to this many times it."""

_METHODS = ("zoh", "bilinear", "euler", "rk4")


@dataclass(frozen=True)
class Shown:
    """A system of a paper, simulated, and observers of it by name, the first one chosen.

    ``noise``, ``model_error``: standard deviation of a sample's noise, and root of the spectral
    density of what the observers' model lacks, which the page's sliders begin with.
    """

    title: str
    text: str
    plant: System
    x0: tuple[float, ...]
    dt: float
    steps: int
    observers: Mapping[str, Observer]
    state: int
    of: Noise | None
    noise: float
    model_error: float


def shown() -> list[Shown]:
    """The systems of the page."""
    lee, crackle, wanders, ring = Lee(), Crackle(), SanfelicePraly(2.22, 0.1), VanDerPol(0.8, 0.5)
    papers: dict[str, Any] = {"method": "euler", "timing": "predictor"}
    k = [2.0, 2.0]
    return [
        Shown(
            "Lee, Choi, Khalil",
            "x1' = x2, x2' = -x1/(1 + x1²) - x2, y = x1 + noise, uniform within ±0.5. A large gain "
            "passes the noise, a small one follows late.",
            lee,
            (10.0, 10.0),
            1e-3,
            8000,
            {
                "the paper's, Euler": StandardObserver(2, 100.0, k=k, model=lee, **papers),
                "with the model, zoh": StandardObserver(2, 10.0, k=k, model=lee),
                "without a model, zoh": StandardObserver(2, 20.0, k=k),
            },
            2,
            UniformNoise(-0.5, 0.5),
            float(np.sqrt(1.0 / 12.0)),
            0.1,
        ),
        Shown(
            "Astolfi, Marconi, Praly, Teel",
            "The chaotic crackle system, x_i' = x_{i+1}, x5' = 0.2 (x1² - 1) - x2 - x3 - 4 x4 - "
            "x5, y = x1, without noise. Estimates begin at 0: the standard observer peaks with "
            "the powers of its gain, the low-power one with the gain alone, the peaking-free one "
            "stays within its levels.",
            crackle,
            (-0.8, 0.0, 0.0, 0.0, 0.0),
            1e-3,
            10_000,
            {
                "standard (2)": StandardObserver(5, 4.17, model=crackle),
                "low-power (5)": LowPowerObserver(5, 7.0, model=crackle),
                "peaking-free (11)": PeakingFreeObserver(5, 7.0, saturation=3.0, model=crackle),
            },
            2,
            None,
            1e-4,
            1e-2,
        ),
        Shown(
            "Sanfelice, Praly",
            "x1' = x2 + 2.22 x1 + 0.1, x2' = 0, y = x1 + noise of standard deviation 0.015. The "
            "paper's gain adapts to the innovation; here it is constant and set by the slider.",
            wanders,
            (-0.1 / 2.22, 0.0),
            9e-3,
            6000,
            {
                "with the model": StandardObserver(2, 6.0, k=k, model=wanders),
                "without a model": StandardObserver(2, 6.0, k=k),
            },
            2,
            NormalNoise(std=0.015),
            0.015,
            0.05,
        ),
        Shown(
            "Fu, Kang, Li",
            "The stochastic Van der Pol oscillator, dx1 = x2 dt, dx2 = [-x1 + 0.8 (1 - x1²) x2] dt "
            "+ 0.5 dW, y = x1 without noise. The observer's model does not contain 0.5 dW. The "
            "samples have no noise, so the error falls as the gain grows.",
            ring,
            (1.0, 0.0),
            1e-2,
            6000,
            {
                "with the model": StandardObserver(2, 10.0, model=ring),
                "without a model": StandardObserver(2, 10.0),
            },
            2,
            None,
            1e-4,
            0.5,
        ),
    ]


def showcase() -> str:
    """The page, as text.

    Raises
    ------
    HgoError
        An installation without the WebAssembly module.
    """
    require_module()
    return assembled("The papers' observers, live", [_system(of) for of in shown()])


def _system(of: Shown) -> dict[str, Any]:
    any_of = next(iter(of.observers.values()))
    given: dict[str, Any] = {"x0": of.x0, "dt": of.dt, "steps": of.steps, "every": 1}
    run = simulate(of.plant, any_of, noise=of.of, errors=False, allow_unstable=True, **given)
    assert run.x is not None and run.y is not None
    x, y = run.x[0], run.y[0, :, 0]
    drawn = Drawn(of.dt * np.arange(len(y), dtype=np.float64), y, None, of.dt, "")
    spans = {name: float(made.spec["gain"]["ell"]) for name, made in of.observers.items()}
    structures = [
        structure(
            name,
            made,
            drawn,
            (spans[name] / _REACH, spans[name] * _REACH),
            Config.of,
            "zero",
            methods=_METHODS,
        )
        for name, made in of.observers.items()
    ]
    true = Reference("true state", drawn.t, x)
    chosen, numbers = next(iter(of.observers)), (of.noise, of.model_error)
    return system(
        of.title, drawn, structures, chosen, of.state, *numbers, true, text=of.text, truth=True
    )
