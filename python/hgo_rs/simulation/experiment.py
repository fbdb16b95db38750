"""Experiments: a plant, noise and an observer over many runs."""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs import _core
from hgo_rs.design.discretisation import check_step
from hgo_rs.errors import HgoError, check, check_array, check_choice, check_integer, check_number
from hgo_rs.models import Plant, Ship, System, VanDerPol
from hgo_rs.models.own.callables import runnable
from hgo_rs.observers import FixedStep, Observer, StochasticApproximation
from hgo_rs.read_only import ReadOnlyDict, shown
from hgo_rs.simulation.feedback import Controller, Loop, close
from hgo_rs.simulation.llvm import check_engine, kernel_for
from hgo_rs.simulation.noise import Noise, RecordedNoise
from hgo_rs.simulation.result import SimulationResult
from hgo_rs.times import check_period

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

BACKENDS = ("rust", "numpy")

_LONGEST = 10**15
"""Steps of the longest run."""
_LARGEST = 2**30
"""Numbers in the largest result."""

METRICS = ("mean", "rms", "max", "peak")


@dataclass(frozen=True, eq=False)
class Experiment:
    """A checked experiment: plain data, from which any of its runs can be computed anywhere.

    Attributes
    ----------
    spec : dict
        What the core and the reference read: numbers, strings, lists, dicts and arrays; read-only.
    n : int
        Order of the observer.
    shapes : dict
        Shape that each named output has for one run; a piece of R runs gives (R, *shape).
    loop : Loop
        Names of what stands behind the plant's states.
    """

    spec: dict[str, Any]
    n: int
    shapes: dict[str, tuple[int, ...]]
    loop: Loop

    @property
    def numbers(self) -> int:
        """Numbers in the result of one run."""
        return sum(math.prod(shape) for shape in self.shapes.values())

    def piece(self, first: int, runs: int) -> dict[str, Any]:
        """The spec of runs first, ..., first + runs - 1 alone."""
        rows = slice(first, first + runs)
        spec = self.spec | {"runs": runs, "first_run": first}
        for name in ("x0", "memory0"):
            spec[name] = spec[name][rows] if spec[name].ndim == 2 else spec[name]
        values = spec["noise"].get("values")
        if values is not None and values.ndim == 2:
            spec["noise"] = spec["noise"] | {"values": values[rows]}
        return spec


def simulate(
    plant: System,
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
    plant_method: str | None = None,
    substeps: int = 1,
    noise: Noise | None = None,
    runs: int = 1,
    rng: int | np.random.Generator = 0,
    windows: Sequence[tuple[float, float]] = (),
    metrics: Sequence[str] | None = None,
    errors: bool = True,
    settle: float | None = None,
    histogram: tuple[float, float] | None = None,
    every: int = 0,
    feedback: Controller | Mapping[str, Any] | None = None,
    feedback_from: str = "estimate",
    feedback_delay: int = 0,
    signals: Mapping[str, Any] | Sequence[str] | None = None,
    settle_signals: Mapping[str, float] | None = None,
    cost: Any = None,
    converged: float | Mapping[str, float] | None = None,
    allow_unstable: bool = False,
    backend: str = "rust",
    engine: str = "auto",
) -> SimulationResult:
    """Simulate a plant with an observer.

    Run i depends on (rng, i) alone, not on threads or other runs.

    Parameters
    ----------
    plant : System
        A plant of `hgo_rs.models`, or a `Plant`. Of a `Plant` an observer with a `Model` estimates
        the states of the model's names, any other the first n states. Entries of an estimate beyond
        the plant's states (a disturbance, say) have no truth: their metrics are those of the entry.
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
        One of `PLANT_METHODS` (default: rk4; with process noise taylor-1.5, milstein where it is
        multiplicative, euler-maruyama for a `Plant`); equal substeps of the plant in each step.
    noise : Noise, optional
        Measurement noise.
    runs : int
    rng : int or numpy.random.Generator
        Seed of the study; a Generator gives one.
    windows : sequence of (from, to)
        Where mean, RMS and largest magnitude are taken: in seconds for fixed steps, in step
        indices for other schedules; half open.
    metrics : sequence of str, optional
        Those of `METRICS` that are computed. Default: all.
    errors : bool
        Whether the errors and the rest of the observer's memory have `metrics`; False leaves them
        to `signals`, as in signals={"gap": "x2_hat - x2"}.
    settle : float, optional
        Threshold of ||x_hat - x|| for the settling time.
    histogram : (from, to), optional
        Window in which the distribution of ||x_hat - x||^2 is collected.
    every : int
        Keep each `every`-th frame of every run; 0 keeps none.
    feedback : dict of input: expression, or Controller, optional
        What gives the plant's inputs: of t, the measured output `y` and the estimates, each called
        as its state with `_hat`: {"u": "saturate(-x1_hat - 2*x2_hat, -1, 1)"}. In mode "sampled" it
        is evaluated at each sample, on the estimate that the observer's timing gives there, and
        held; in mode "joint" at every moment. The observer's model is told the input in force.
    feedback_from : "estimate" or "state"
        "state": the true states replace the estimates in the feedback; the ideal loop to compare
        with.
    feedback_delay : int
        Sampling periods between a sample and the use of the input that is computed from it; 0 until
        then.
    signals : list of names or dict of name: expression, optional
        Further signals with metrics and frames, see `SimulationResult.of`: of t, the plant's states
        and inputs, y, estimates and the controller's states. Default in a loop: the states and
        inputs.
    settle_signals : dict of signal: threshold, optional
        Last time at which the magnitude of a signal was at or above its threshold.
    cost : expression of t, states and inputs of a Plant, optional
        Its integral over the run, by the plant's scheme, is the result's `cost`.
    converged : float, or dict of signal: bound, optional
        Whether a run stayed finite and ended within the bound of the norm of the plant's state, or
        of the magnitude of each signal: the result's `converged`.
    allow_unstable : bool
        Allow a step beyond the stability limit.
    backend : "rust" or "numpy"
        The compiled core, or the NumPy reference.
    engine : "auto", "interpreter" or "llvm"
        Engine of the core, with the same bits: the interpreter of the tables, or a kernel that
        llvmlite (extra `fast`) compiles from them. "auto" compiles if llvmlite is installed and the
        study is long enough.

    Raises
    ------
    HgoError
        A parameter outside its range, a plant and an observer that do not fit, an unstable step.
    """
    given = locals()
    backend = check_choice("backend", given.pop("backend"), BACKENDS)
    engine = check_engine(given.pop("engine"), backend)
    experiment = plan(**given)
    kept = runs * experiment.numbers
    remedy = f"as it is the result would hold {kept:.3g} numbers; fewer runs or a larger every"
    check(kept <= _LARGEST, "runs", runs, f"such that {_LARGEST:.3g} numbers do", remedy)
    return result_of(execute(experiment.spec, backend, engine), experiment)


def plan(
    plant: System,
    observer: Observer,
    *,
    x0: npt.ArrayLike,
    dt: float | None,
    schedule: FixedStep | StochasticApproximation | None,
    plant_schedule: FixedStep | StochasticApproximation | None,
    t_end: float | None,
    steps: int | None,
    memory0: npt.ArrayLike | None,
    mode: str,
    plant_method: str | None,
    substeps: int,
    noise: Noise | None,
    runs: int,
    rng: int | np.random.Generator,
    windows: Sequence[tuple[float, float]],
    metrics: Sequence[str] | None,
    errors: bool,
    settle: float | None,
    histogram: tuple[float, float] | None,
    every: int,
    feedback: Controller | Mapping[str, Any] | None,
    feedback_from: str,
    feedback_delay: int,
    signals: Mapping[str, Any] | Sequence[str] | None,
    settle_signals: Mapping[str, float] | None,
    cost: Any,
    converged: float | Mapping[str, float] | None,
    allow_unstable: bool,
) -> Experiment:
    """The arguments of `simulate`, checked."""
    n_y = _check_fit(plant, observer)
    nx, m = 6 if isinstance(plant, Ship) else plant.order or observer.n, len(observer.memory)
    loop = close(
        plant,
        observer,
        (nx, n_y),
        feedback=feedback,
        feedback_from=feedback_from,
        feedback_delay=feedback_delay,
        signals=signals,
        settle_signals=settle_signals,
        cost=cost,
        converged=converged,
    )
    if check_choice("mode", mode, ("sampled", "joint")) == "joint":
        method = observer.spec.get("method", "a recursion")
        one, remedy = "euler, rk4 or bogacki-shampine in mode 'joint'", "or take mode 'sampled'"
        check(method in ("euler", "rk4", "bogacki-shampine"), "method", method, one, remedy)
    if plant_method is None:
        plant_method = _plant_method(plant)
    check_choice("plant_method", plant_method, PLANT_METHODS)
    if (dt is None) == (schedule is None):
        raise HgoError("dt: give either dt [s] or schedule")
    clock = FixedStep(check_period(dt)) if schedule is None else schedule
    for name, given in (("schedule", clock), ("plant_schedule", plant_schedule)):
        known = given is None or isinstance(given, (FixedStep, StochasticApproximation))
        check(known, name, given, "a FixedStep or StochasticApproximation", "see hgo_rs.observers")
    allowed = allow_unstable or observer.allow_unstable
    check_step(observer.spec, clock.longest, allow_unstable=allowed)
    period = clock.longest if isinstance(clock, FixedStep) else None

    if (t_end is None) == (steps is None):
        raise HgoError("steps: give either t_end [s] or steps")
    if t_end is not None:
        fixed = period is not None
        check(fixed, "t_end", t_end, "used with fixed steps", "give steps for this schedule")
        ratio = check_number(t_end, "t_end", above=0.0) / clock.longest
        check(ratio <= _LONGEST, "t_end", t_end, f"<= {_LONGEST:g} steps", "choose a shorter run")
        steps = max(1, round(ratio))
    steps = check_integer(steps, "steps", least=1, most=_LONGEST)
    runs = check_integer(runs, "runs", least=1, most=_LARGEST)
    every = check_integer(every, "every", least=0, most=_LONGEST)

    x0 = _start(x0, "x0", nx, runs)
    start = observer.initial_memory() if memory0 is None else _start(memory0, "memory0", m, runs)
    observer._check_start(start, told=memory0 is not None)
    if isinstance(plant, Ship) and np.any(x0[..., 3] == 0.0):
        raise HgoError(
            "x0: z_1 = 0 makes atan(0/0) in the ship's model (Katayama, assumption A1); start "
            "with a surge speed that is not 0"
        )
    pairs = check_array(windows, "windows")
    if loop.has_cost:
        x0 = np.concatenate([x0, np.zeros((*x0.shape[:-1], 1))], axis=-1)
    listed = pairs.size == 0 or (pairs.ndim == 2 and pairs.shape[1] == 2)
    check(listed, "windows", windows, "pairs (from, to)", "give a list of them")
    seed = int(rng.integers(2**63)) if isinstance(rng, np.random.Generator) else rng
    spec: dict[str, Any] = {
        "plant": runnable(loop.plant.spec, loop.plant),
        "observer": runnable(observer.spec, observer.model),
        "mode": mode,
        "steps": steps,
        "schedule": clock.spec,
        "plant_method": plant_method,
        "substeps": check_integer(substeps, "substeps", least=1, most=2**32 - 1),
        "x0": x0,
        "memory0": start,
        "noise": _noise(noise, clock, steps, runs),
        "runs": runs,
        "seed": check_integer(seed, "rng", least=0, most=2**64 - 1),
        "windows": [_window(pair, "windows", period, steps) for pair in pairs],
        "every": every,
    }
    check(isinstance(errors, bool), "errors", errors, "True or False", "choose one of them")
    if not errors:
        spec["errors"] = False
    if metrics is not None:
        listed = isinstance(metrics, Sequence) and not isinstance(metrics, str)
        known = listed and all(name in METRICS for name in metrics)
        check(known, "metrics", metrics, f"a list of {', '.join(METRICS)}", "choose among them")
        spec["metrics"] = list(metrics)
    truth = _truth(plant, observer)
    if truth is None and loop.has_cost:
        truth = list(range(nx))
    if truth is not None:
        spec["truth"] = truth
    if loop.spec is not None:
        spec["feedback"] = loop.spec
    if plant_schedule is not None:
        spec["plant_schedule"] = plant_schedule.spec
    if settle is not None:
        spec["settle"] = check_number(settle, "settle", above=0.0)
    if histogram is not None:
        spec["histogram"] = _window(check_array(histogram, "histogram"), "histogram", period, steps)
    # a ship's filters are no signals, nor what chains hold behind their estimates, nor what current
    # timing holds beside the law's memory
    behind = isinstance(plant, Ship) or observer.spec["kind"] == "chains"
    entries = observer.n if behind else observer._law_len
    sizes = (entries if errors else 0, len(loop.columns), m)
    shapes = _shapes(spec, sizes, n_y, len(loop.signals))
    return Experiment(ReadOnlyDict(spec), observer.n, shapes, loop)


def planned(**given: Any) -> Experiment:
    """The experiment that `simulate` runs with these arguments."""
    arguments = inspect.signature(simulate).bind(**given)
    arguments.apply_defaults()
    del arguments.arguments["backend"], arguments.arguments["engine"]
    return plan(**arguments.arguments)


def _shapes(
    spec: Mapping[str, Any], sizes: tuple[int, int, int], n_y: int, watched: int
) -> dict[str, Any]:
    """Shape of each output of one run."""
    (errors, nx, m), windows = sizes, len(spec["windows"])
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("mean", "rms", "max"), (windows, errors))
    shapes["peak"] = (errors,)
    asked = spec.get("metrics")
    out: dict[str, Any] = {k: v for k, v in shapes.items() if asked is None or k in asked}
    if watched:
        out |= {f"signal_{name}": (*shape[:-1], watched) for name, shape in out.items()}
        out["signal_settling_time"] = (watched,)
    out |= dict.fromkeys(("settling_time", "diverged_at", "undefined_at"), ())
    out |= {"final_x": (nx,), "final_memory": (m,)}
    if spec["every"]:
        frames = spec["steps"] // spec["every"] + 1
        out |= {"x": (frames, nx), "memory": (frames, m), "y": (frames, n_y)}
    return out


_threads_of: int | None = None
"""The process in which the core's threads started."""


def execute(
    spec: dict[str, Any], backend: str, engine: str = "auto", runs: int | None = None
) -> dict[str, Any]:
    """Outputs of a spec: named arrays (runs, ...), and the frames' times "t".

    The spec may be a piece of a study of `runs` runs, for which a kernel is then compiled or not.
    """
    if backend == "rust":
        global _threads_of
        if _threads_of not in (None, os.getpid()):
            raise HgoError(
                "executor: this process was forked after the core's threads had started, and "
                "would wait for them for ever; start processes afresh, for example "
                "ProcessPoolExecutor(mp_context=multiprocessing.get_context('spawn'))"
            )
        _threads_of = os.getpid()
        return _core.simulate(spec, kernel_for(spec, engine, runs or spec.get("runs", 1)))
    from hgo_rs import reference

    try:
        return reference.simulate(spec)
    except ValueError as error:
        raise HgoError(str(error)) from error


def result_of(out: dict[str, Any], experiment: Experiment) -> SimulationResult:
    """The outputs of an experiment with their names."""
    states = len(experiment.loop.states)
    columns = out.get("x")
    return SimulationResult(
        metrics={
            name: out[name]
            for key in METRICS
            for name in (key, f"signal_{key}", "signal_settling_time")
            if name in out
        },
        settling_time=out["settling_time"],
        diverged_at=out["diverged_at"],
        undefined_at=out["undefined_at"],
        final_x=shown(out["final_x"][..., :states]),
        final_memory=out["final_memory"],
        time=out.get("t"),
        x=None if columns is None else shown(columns[..., :states]),
        memory=out.get("memory"),
        y=out.get("y"),
        histogram=out.get("histogram"),
        n=experiment.n,
        spec=experiment.spec,
        shared=tuple(out.get("shared", ())),
        loop=experiment.loop,
        final_columns=out["final_x"],
        columns=columns,
    )


def _plant_method(plant: System) -> str:
    """The scheme of highest order for the plant."""
    if _is_own(plant) and plant.spec["noisy"]:
        return "euler-maruyama"
    if isinstance(plant, VanDerPol) and plant.sigma != 0.0:
        return "milstein" if plant.multiplicative else "taylor-1.5"
    return "rk4"


def _is_own(plant: System) -> bool:
    return plant.spec["kind"] == "own-plant"


def _check_fit(plant: System, observer: Observer) -> int:
    """Refuse an observer that does not fit the plant; its number of outputs."""
    check(
        isinstance(plant, System), "plant", plant, "a Model or another System", "see hgo_rs.models"
    )
    check(isinstance(observer, Observer), "observer", observer, "an Observer", "see hgo_rs")
    ship = isinstance(plant, Ship)
    n_y = 3 if ship else int(plant.spec.get("n_y", 1))
    remedy = "this one is a model of observers only"
    check(plant.order is not None or ship, "plant", plant, "a system with equations", remedy)
    kind, reduced = observer.spec["kind"], "reduced-order"
    # the first entries of an estimate are compared with the plant's states, as many as both have
    fits = (kind == reduced) == ship or _is_own(plant)
    allowed = f"{'' if ship else 'not '}{reduced!r} for the plant {plant!r}"
    check(fits, "kind of the observer", kind, allowed, "choose another")
    allowed = f"{n_y} for the plant {plant!r}"
    check(observer.n_y == n_y, "n_y of the observer", observer.n_y, allowed, "choose another")
    own = 2 if ship else 0  # inputs that a plant gives itself
    if not (isinstance(plant, Plant) and plant.inputs):
        remedy = "give a Plant these inputs and a feedback, or the model with_inputs"
        allowed = f"{'0 or 2' if ship else '0'} for the plant {plant!r}"
        check(observer.n_u in (0, own), "n_u of the observer", observer.n_u, allowed, remedy)
    return n_y


def _truth(plant: System, observer: Observer) -> list[int] | None:
    """Which states of an own plant the observer estimates, where it is not the first n.

    They are found by their names: a reduced-order observer's must all be the plant's; of another
    observer a name of the plant's must not stand for another state.
    """
    model = observer.spec.get("model") or {}
    estimated = list(model["names"]["states"])[-observer.n :] if "names" in model else []
    states = list(plant.spec["names"]["states"]) if _is_own(plant) else []
    places = [states.index(name) for name in estimated if name in states]
    if estimated and len(places) == observer.n:
        return None if places == list(range(observer.n)) else places
    reduced = _is_own(plant) and observer.spec["kind"] == "reduced-order"
    known = all(name not in states or states.index(name) == i for i, name in enumerate(estimated))
    allowed = f"such that {estimated}, which the observer estimates, are among them"
    remedy = "give the states of the plant and of the model the same names"
    check(known and not reduced, "states of the plant", states, allowed, remedy)
    return None


def _start(values: npt.ArrayLike, name: str, width: int, runs: int) -> npt.NDArray[np.float64]:
    """Starts (width,) or (runs, width)."""
    start, shapes = check_array(values, name), ((width,), (runs, width))
    allowed, remedy = f"{shapes[0]} or {shapes[1]}", "give one start for all runs, or one a run"
    check(start.shape in shapes, f"shape of {name}", start.shape, allowed, remedy)
    check(np.all(np.isfinite(start)), name, values, "finite", "leave out NaN and infinity")
    return start


def _noise(
    noise: Noise | None, clock: FixedStep | StochasticApproximation, steps: int, runs: int
) -> dict[str, Any]:
    if noise is None:
        return {"kind": "none"}
    check(isinstance(noise, Noise), "noise", noise, "a Noise", "see hgo_rs.simulation")
    fixed = noise.hold is None or isinstance(clock, FixedStep)
    check(fixed, "hold", noise.hold, "used with fixed steps", "leave it out for this schedule")
    spec = noise.spec(clock.longest)
    if isinstance(noise, RecordedNoise):
        shape, shapes = spec["values"].shape, ((steps + 1,), (runs, steps + 1))
        allowed = f"{shapes[0]} or {shapes[1]}"
        check(shape in shapes, "shape of values", shape, allowed, "give one value a sample")
    return spec


def _window(
    pair: npt.NDArray[np.float64], name: str, period: float | None, steps: int
) -> list[int]:
    """Step indices [from, to) of a window given in seconds, or in steps without a period."""
    with np.errstate(over="ignore"):
        edges = np.round(pair if period is None else pair / period)
    inside = edges.shape == (2,) and 0.0 <= edges[0] < edges[1] and edges[0] <= steps
    allowed = "(from, to) with 0 <= from < to, beginning within the simulation"
    check(inside, name, pair.tolist(), allowed, "give a window of at least one step")
    return [int(edge) for edge in np.minimum(edges, steps + 1)]
