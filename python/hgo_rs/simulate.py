"""Experiments: a plant, noise and an observer over many runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs import _core
from hgo_rs.design.discretisation import check_step
from hgo_rs.errors import HgoError, check, check_integer, check_number
from hgo_rs.gains import FixedStep, StochasticApproximation
from hgo_rs.models import Model, Ship
from hgo_rs.noise import Noise
from hgo_rs.observers import Observer
from hgo_rs.results import SimulationResult

__all__ = ["simulate"]

PLANT_METHODS = (
    "euler",
    "rk4",
    "bogacki-shampine",
    "held",
    "euler-maruyama",
    "milstein",
    "taylor-1.5",
)
"""How the plant moves; `held` keeps it at x0, the last three need process noise."""


def simulate(
    plant: Model,
    observer: Observer,
    *,
    x0: npt.ArrayLike,
    dt: float | None = None,
    schedule: FixedStep | StochasticApproximation | None = None,
    plant_schedule: FixedStep | StochasticApproximation | None = None,
    t_end: float | None = None,
    steps: int | None = None,
    memory0: npt.ArrayLike | None = None,
    mode: str = "sampled",
    plant_method: str = "rk4",
    substeps: int = 1,
    noise: Noise | None = None,
    runs: int = 1,
    rng: int | np.random.Generator = 0,
    windows: Sequence[tuple[float, float]] = (),
    settle: float | None = None,
    histogram: tuple[float, float] | None = None,
    every: int = 0,
    allow_unstable: bool = False,
    backend: str = "rust",
) -> SimulationResult:
    """Simulate a plant with an observer.

    Run i depends on (rng, i) alone, not on threads or on what else runs.

    Parameters
    ----------
    plant : Model
        A plant of `hgo_rs.models`, of the observer's order.
    observer : Observer
    x0 : (nx,) or (runs, nx)
        Initial state of the plant.
    dt : float
        Sampling period [s]; or `schedule` for another clock.
    plant_schedule : optional
        Clock of the plant, if not the observer's.
    t_end, steps : one of the two
        Duration [s] (fixed steps only) or number of steps.
    memory0 : (m,) or (runs, m), optional
        Initial memory of the observer; see `Observer.initial_memory`.
    mode : "sampled" or "joint"
        The observer steps on samples; or plant and observer are integrated as one differential
        equation by the observer's method.
    plant_method, substeps
        One of `PLANT_METHODS`; equal substeps of the plant in each step.
    noise : Noise, optional
        Measurement noise.
    runs : int
    rng : int or numpy.random.Generator
        Seed of the study; a Generator gives one.
    windows : sequence of (from, to)
        Where mean, RMS and largest magnitude are taken: in seconds for fixed steps, in step
        indices for other schedules; half open.
    settle : float, optional
        Threshold of ||x_hat - x|| for the settling time.
    histogram : (from, to), optional
        Window in which the distribution of ||x_hat - x||^2 is collected.
    every : int
        Keep each `every`-th frame of every run; 0 keeps none.
    allow_unstable : bool
        Allow a step beyond the stability limit.
    backend : "rust" or "numpy"
        The compiled core, or the NumPy reference.

    Raises
    ------
    HgoError
        A parameter outside its range, a plant and an observer that do not fit, an unstable step.
    """
    check(isinstance(plant, Model), "plant", plant, "a Model", "see hgo_rs.models")
    check(isinstance(observer, Observer), "observer", observer, "an Observer", "see hgo_rs")
    if (dt is None) == (schedule is None):
        raise HgoError("dt: give either dt [s] or schedule")
    clock = FixedStep(check_number(dt, "dt", above=0.0)) if schedule is None else schedule
    assert clock is not None
    if mode == "sampled":
        allowed = allow_unstable or observer.allow_unstable
        check_step(observer.spec, clock.longest, allow_unstable=allowed)
    fixed = isinstance(clock, FixedStep)
    if (t_end is None) == (steps is None):
        raise HgoError("steps: give either t_end [s] or steps")
    if t_end is not None:
        check(fixed, "t_end", t_end, "used with fixed steps", "give steps for this schedule")
        steps = max(1, round(check_number(t_end, "t_end", above=0.0) / clock.longest))
    runs = check_integer(runs, "runs", least=1)

    def window(pair: tuple[float, float], name: str) -> list[int]:
        first, last = pair
        if fixed:
            first, last = round(first / clock.longest), round(last / clock.longest)
        inside = 0 <= first < last
        check(inside, name, pair, "(from, to) with 0 <= from < to", "give a longer window")
        return [int(first), int(last)]

    start = observer.initial_memory() if memory0 is None else np.asarray(memory0, dtype=float)
    index = observer._gain_index()
    if index is not None and start.shape[-1:] == observer.memory.shape:
        low = float(np.min(start[..., index]))
        check_number(low, "r(0)", least=1.0, remedy="law (6) lives on r >= 1; start at 1")
    _check_apart(observer, start)
    seed = int(rng.integers(2**63)) if isinstance(rng, np.random.Generator) else rng
    spec: dict[str, Any] = {
        "plant": plant.spec,
        "observer": observer.spec,
        "mode": mode,
        "steps": check_integer(steps, "steps", least=1),
        "schedule": clock.spec,
        "plant_method": plant_method,
        "substeps": check_integer(substeps, "substeps", least=1),
        "x0": np.asarray(x0, dtype=float),
        "memory0": start,
        "noise": (Noise() if noise is None else noise).spec(clock.longest),
        "runs": runs,
        "seed": check_integer(seed, "rng", least=0, most=2**64 - 1),
        "windows": [window(pair, "windows") for pair in windows],
        "every": check_integer(every, "every", least=0),
    }
    if plant_schedule is not None:
        spec["plant_schedule"] = plant_schedule.spec
    if settle is not None:
        spec["settle"] = check_number(settle, "settle", above=0.0)
    if histogram is not None:
        spec["histogram"] = window(histogram, "histogram")
    if isinstance(plant, Ship) and np.any(spec["x0"][..., 3:4] == 0.0):
        raise HgoError(
            "x0: z_1 = 0 makes atan(0/0) in the ship's model (Katayama, assumption A1); start "
            "with a surge speed that is not 0"
        )
    if backend == "rust":
        out = _core.simulate(spec)
    elif backend == "numpy":
        from hgo_rs import reference

        out = reference.simulate(spec)
    else:
        raise HgoError(f"backend = {backend!r}: must be rust or numpy")
    return SimulationResult(
        mean=out["mean"],
        rms=out["rms"],
        max=out["max"],
        peak=out["peak"],
        settling_time=out["settling_time"],
        diverged_at=out["diverged_at"],
        final_x=out["final_x"],
        final_memory=out["final_memory"],
        time=out.get("t"),
        x=out.get("x"),
        memory=out.get("memory"),
        y=out.get("y"),
        histogram=out.get("histogram"),
        n=observer.n,
        spec=spec,
    )


def _check_apart(observer: Observer, memory: npt.NDArray[np.float64]) -> None:
    """Refuse copies that start alike: they would never separate."""
    if observer.spec["kind"] not in ("collection", "modified"):
        return
    copies, width = observer.spec["copies"], observer.n + 1
    rows = np.atleast_2d(memory)[:, -copies * width :].reshape(-1, copies, width)
    for run, starts in enumerate(rows):
        if len(np.unique(starts, axis=0)) < copies:
            raise HgoError(
                f"memory0 of run {run}: copies with identical starts never separate; spread them, "
                "for example with observer.spread(...)"
            )
