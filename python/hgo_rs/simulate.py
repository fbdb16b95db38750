"""Experiments: a plant, noise and an observer over many runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs import _core
from hgo_rs.design.discretisation import check_step
from hgo_rs.errors import HgoError, check, check_array, check_choice, check_integer, check_number
from hgo_rs.gains import FixedStep, StochasticApproximation
from hgo_rs.models import Model, Ship
from hgo_rs.noise import Noise, RecordedNoise
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


_LONGEST = 10**15
"""Steps of the longest run: a second apiece for thirty million years."""
_LARGEST = 2**30
"""Numbers in the largest result."""


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
    order = 3 if isinstance(plant, Ship) else plant.order
    check(
        order is not None, "plant", plant, "a plant, not what is known of one", "see hgo_rs.models"
    )
    fits = observer.n == order and (observer.n_y == 3) == isinstance(plant, Ship)
    check(fits, "observer", observer, f"one that fits the plant {plant!r}", "choose its order")
    check_choice("mode", mode, ("sampled", "joint"))
    check_choice("plant_method", plant_method, PLANT_METHODS)
    check_choice("backend", backend, ("rust", "numpy"))
    if (dt is None) == (schedule is None):
        raise HgoError("dt: give either dt [s] or schedule")
    clock = FixedStep(check_number(dt, "dt", above=0.0)) if schedule is None else schedule
    for name, given in (("schedule", clock), ("plant_schedule", plant_schedule)):
        known = given is None or isinstance(given, (FixedStep, StochasticApproximation))
        check(known, name, given, "a FixedStep or StochasticApproximation", "or give dt")
    allowed = allow_unstable or observer.allow_unstable
    check_step(observer.spec, clock.longest, allow_unstable=allowed)
    fixed = isinstance(clock, FixedStep)
    if (t_end is None) == (steps is None):
        raise HgoError("steps: give either t_end [s] or steps")
    if t_end is not None:
        check(fixed, "t_end", t_end, "used with fixed steps", "give steps for this schedule")
        duration = check_number(t_end, "t_end", above=0.0, most=_LONGEST * clock.longest)
        steps = max(1, round(duration / clock.longest))
    steps = check_integer(steps, "steps", least=1, most=_LONGEST)
    runs = check_integer(runs, "runs", least=1)
    every = check_integer(every, "every", least=0, most=_LONGEST)

    def window(pair: Any, name: str) -> list[int]:
        edges = check_array(pair, name)
        if fixed:
            edges = np.round(edges / clock.longest)
        else:
            edges = np.round(edges)
        inside = edges.shape == (2,) and 0 <= edges[0] < edges[1] and edges[0] <= steps
        allowed = "(from, to) with 0 <= from < to, from within the simulation"
        check(inside, name, pair, allowed, "give a window of at least one step")
        return [int(edge) for edge in np.minimum(edges, steps + 1)]

    x0 = check_array(x0, "x0")
    start = observer.initial_memory() if memory0 is None else check_array(memory0, "memory0")
    for name, values, width in (
        ("x0", x0, _width(plant)),
        ("memory0", start, len(observer.memory)),
    ):
        if values.shape not in ((width,), (runs, width)) or not np.all(np.isfinite(values)):
            raise HgoError(
                f"{name} of shape {values.shape}: must be finite and of shape ({width},) or "
                f"({runs}, {width}); give one start for all runs, or one a run"
            )
    observer._check_start(start)
    noise = Noise() if noise is None else noise
    check(isinstance(noise, Noise), "noise", noise, "a Noise", "see hgo_rs.noise")
    held = noise.spec(clock.longest)
    check(fixed or noise.hold is None, "hold", noise.hold, "left out", "it needs fixed steps")
    if isinstance(noise, RecordedNoise):
        shape = np.shape(noise.values)
        sizes = ((steps + 1,), (runs, steps + 1))
        check(shape in sizes, "shape of values", shape, f"{sizes[0]} or {sizes[1]}", "one a sample")
    windows = [] if windows is None else windows
    check(
        isinstance(windows, Sequence), "windows", windows, "a sequence of (from, to)", "give a list"
    )
    spans = [window(pair, "windows") for pair in windows]
    _check_size(runs, 0 if every == 0 else steps // every + 1, len(spans), plant, observer)
    seed = int(rng.integers(2**63)) if isinstance(rng, np.random.Generator) else rng
    spec: dict[str, Any] = {
        "plant": plant.spec,
        "observer": observer.spec,
        "mode": mode,
        "steps": steps,
        "schedule": clock.spec,
        "plant_method": plant_method,
        "substeps": check_integer(substeps, "substeps", least=1),
        "x0": x0,
        "memory0": start,
        "noise": held,
        "runs": runs,
        "seed": check_integer(seed, "rng", least=0, most=2**64 - 1),
        "windows": spans,
        "every": every,
    }
    if plant_schedule is not None:
        spec["plant_schedule"] = plant_schedule.spec
    if settle is not None:
        spec["settle"] = check_number(settle, "settle", above=0.0)
    if histogram is not None:
        spec["histogram"] = window(histogram, "histogram")
    if isinstance(plant, Ship) and np.any(x0[..., 3] == 0.0):
        raise HgoError(
            "x0: z_1 = 0 makes atan(0/0) in the ship's model (Katayama, assumption A1); start "
            "with a surge speed that is not 0"
        )
    if backend == "rust":
        out = _core.simulate(spec)
    else:
        from hgo_rs import reference

        try:
            out = reference.simulate(spec)
        except ValueError as error:
            raise HgoError(str(error)) from error
    return SimulationResult(
        mean=out["mean"],
        rms=out["rms"],
        max=out["max"],
        peak=out["peak"],
        settling_time=out["settling_time"],
        diverged_at=out["diverged_at"],
        undefined_at=out["undefined_at"],
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


def _width(plant: Model) -> int:
    """Number of states of a plant."""
    return 6 if isinstance(plant, Ship) else int(plant.order or 0)


def _check_size(runs: int, frames: int, windows: int, plant: Model, observer: Observer) -> None:
    """Refuse a result that no machine holds."""
    m, nx = len(observer.memory), _width(plant)
    numbers = runs * (frames * (nx + m + observer.n_y) + 3 * windows * m + 2 * m + nx + 3)
    if numbers > _LARGEST:
        raise HgoError(
            f"runs = {runs}: with {frames} frames each the result would hold {numbers:.3g} "
            f"numbers, must be <= {_LARGEST:.3g} (8 bytes each); take fewer runs or a larger every"
        )
