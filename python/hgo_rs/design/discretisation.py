"""The largest stable step of an observer under each discretisation, from steps of the law itself.

At gain 1 one step of the error is a matrix that depends on c = ell dt only (`discrete.Steps`); the
limit is the smallest c at which its spectral radius passes 1.  The
known nonlinearity of the model is left out: it is small beside a gain that deserves the name high.
NumPy only, and quick: an observer refuses an unstable step when it is made.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from hgo_rs.errors import DesignError, check
from hgo_rs.laws import LAWS

from . import _checks
from ._checks import Array
from .discrete import (
    CORRECTING,
    GAIN_LAWS,
    Steps,
    Unit,
    choice,
    defines,
    member,
    method,
    timing,
    unit,
)

_ROUNDED = 200.0
_OFF = 0.05  # of a law's own period, that a step may be
_ANY_STEP = (*CORRECTING, "implicit")
_SATURATED = {
    "zoh": {1: math.inf, 2: math.inf, 3: math.inf, 4: 2.0, 5: 1.0, 6: 0.5},
    "bilinear": {3: 2.0, 4: 1.0},
    "implicit-map": {1: math.inf, 2: math.inf, 3: math.inf, 4: 5.0, 5: 1.5},
}
"""Below these c the peaking-free law of order n came back from every start that was tried."""


@dataclass(frozen=True)
class StepLimit:
    """The step below which the error stays bounded and, without noise, converges.

    ``dt``: the limit [s] (for a gain r that moves: at r = 1, its least value).
    ``c``: the limit of ell dt; reduced-order: of dt/epsilon; sampled-data: of dt itself.
    ``parts``: the limit on c of each matrix that has a say, by name.
    ``method``: the discretisation ("recursion" for a law that is one already).
    ``period``: the only step [s], to 5 %, of a law that has one.
    """

    method: str
    dt: float
    c: float
    parts: Mapping[str, float]
    period: float | None = None

    @property
    def bounded(self) -> float:
        """The c below which trajectories stay bounded, converging or not.

        Peaking-free: what enters each block from its neighbours is saturated, so the blocks alone
        decide.  Other laws: ``c``.
        """
        blocks = [limit for name, limit in self.parts.items() if name.startswith("block")]
        return min(blocks) if blocks else self.c

    def dt_at(self, r: float) -> float:
        """The limit [s] while the gain is ``r``."""
        return self.c / _checks.positive(r, "r")


def check_step(observer: Mapping[str, Any], dt: float, *, allow_unstable: bool = False) -> None:
    """Refuse a ``dt`` [s] at or above ``step_limit(observer)``, unless ``allow_unstable``; and one
    that is not the law's own period.
    """
    dt = _checks.positive(dt, "dt")
    if "dt" in observer:
        period = step_limit(observer).period or dt
        fits = abs(dt - period) <= _OFF * period
        remedy = "resample the record, mark missing samples as NaN, or choose StandardObserver"
        told = f"{period:g} s to {_OFF:.0%}, the period of this {observer['kind']}"
        check(fits, "dt", dt, told, remedy, DesignError)
    if not allow_unstable:
        limit = step_limit(observer)
        check(
            dt < limit.dt,
            "dt",
            dt,
            f"< {limit.dt:.6g} s, the stability limit of this {observer['kind']} observer"
            + (f" by {limit.method}" if limit.method != "recursion" else ""),
            "choose a smaller dt or gain, another method, or allow_unstable=True to study it",
            DesignError,
        )


def step_limit(observer: Mapping[str, Any]) -> StepLimit:
    """The largest stable step of the observer that the spec ``observer`` describes.

    - continuous laws: the step of the law itself, without a model and with its saturations at rest.
    - peaking-free, and limited-gain with a saturation: also each block alone (E_i, -alpha_n), which
      is what is left while the saturations are active.  For a complex pair of E_1 forward Euler's
      limit is alpha_1/beta_1.
    - collection, modified: copies that are alike, and their differences (if these decay in
      continuous time: else no step is to blame).
    - a gain that switches or has a deadline: at its largest.  homogeneous, in gain or shape: none;
      the last state jumps by dt k_n rho^n at each step, and its error is a few times as large.
    - a shape: at its steepest slope; a threshold sigma must not fall below 0 in one step,
      dt < 1/decay.
    - zoh, implicit-map, implicit: none, but that of a threshold.  bilinear: |lambda| dt < 200,
      where rounding takes over.  peaking-free: bounded at any step; ``c`` is up to where it was
      seen to converge from anywhere, default coefficients.
    - sampled-data (Fu et al., eq. (5)): the error matrix I + T [[-l1/T, 1], [-l2/T, mu]] with
      mu = epsilon (1 - y^2) moves with y; the limit is where the product of these matrices along
      the noise-free limit cycle ceases to contract (+- 0.01 s).  ``parts`` holds the frozen bound
      too: the smallest limit over all constant mu with |y| <= 2.1.  It is neither necessary nor
      sufficient, and asks too much of the printed gain.
      A model of the user's own: no limit is known, its K_T may depend on T at will.
    - reduced-order (Katayama, A5): T < 2 epsilon/max h_bar, exact.
    - window: none beside its period, to which the observer keeps.
    - high-gain EKF: none is known before P is; "sampled" has none.
    - chains: the least of the chains' own; ``parts`` are in s there.
    """
    kind = choice(observer, "kind", (*LAWS, "chains"))
    return _LIMITS.get(kind, _continuous)(observer)


# --- continuous laws --------------------------------------------------------------------------


def _continuous(observer: Mapping[str, Any]) -> StepLimit:
    rule, now, law = method(observer), timing(observer), LAWS[observer["kind"]]
    remedy = f"choose another: this one is not defined for the {law.title}"
    check(defines(law, rule), "method", rule, "a method of this law", remedy, DesignError)
    of = unit(observer, steepest=True)
    parts = {"linear": _critical(of, rule, now)}
    if "saturation" in observer and "alpha" in observer:
        parts |= _saturated(dict(of), rule, now)
    if law.size and law.size[0] == "copies":
        apart = _critical(of, rule, now, "apart")
        if apart is not None:
            parts["copies apart"] = apart
    return _limit(observer, rule, parts)


def _saturated(of: dict[str, Any], rule: str, now: str) -> dict[str, float]:
    """What is left while saturations are active: each block alone, x' = eta + alpha e,
    eta' = beta e, which is the standard law of order 2; of a last one without beta x' = alpha e.
    """
    if rule in CORRECTING:
        limit = _SATURATED[rule].get(of["n"], 0.05 if of["n"] > 4 else math.inf)
        return {"saturated": limit, "blocks": math.inf}
    # only the first block has a sample: the innovations of the others follow the stages
    inner = "rk4" if rule == "rk4-innovation-held" else rule, "predictor"
    parts = {}
    pairs = [*zip(of["alpha"], of["beta"], strict=False)]
    rest = [(alpha,) for alpha in of["alpha"][len(pairs) :]]
    for i, k in enumerate([*pairs, *rest]):
        block: Unit = (("kind", "standard"), ("n", len(k)), ("k", tuple(k)))
        parts[f"block {i + 1}"] = _critical(block, *((rule, now) if i == 0 else inner))
    return parts


def _limit(observer: Mapping[str, Any], rule: str, parts: dict[str, float]) -> StepLimit:
    """The limit in dt, from the gain law."""
    gain = member(observer, "gain")
    law = choice(gain, "law", GAIN_LAWS)
    if law == "homogeneous":  # its gain is without bound at e = 0: bounded chatter, no limit
        parts = {"homogeneous": math.inf}
    shape = observer.get("shape")
    if shape is not None and shape["law"] == "bi-homogeneous":
        parts = {"bi-homogeneous": math.inf}
    largest = {"constant": "ell", "switched": "fast", "prescribed-time": "r_max"}.get(law)
    ell = _checks.positive(member(gain, largest), f"gain.{largest}") if largest else 1.0
    if shape is not None and "decay" in shape:
        parts = {**parts, "threshold": ell / _checks.positive(shape["decay"], "shape.decay")}
    c = min(parts.values())
    current = timing(observer) == "current" and rule not in _ANY_STEP
    return StepLimit(rule + ", current timing" * current, c / ell, c, parts)


@lru_cache(maxsize=256)
def _critical(of: Unit, rule: str, now: str, part: str = "") -> Any:
    """The first c > 0 at which the step's spectral radius exceeds 1; infinite if none does.

    ``part``: "alike" or "apart" of a collection; None if that does not decay in continuous time.
    """
    starts = _copies(dict(of), part) if "copies" in dict(of) else None
    a = Steps(of, "euler", "predictor").error(1.0, starts)
    eigenvalues = np.linalg.eigvals(a - np.eye(len(a)))
    if part and np.max(eigenvalues.real) >= 0.0:
        return None
    fastest = float(np.max(np.abs(eigenvalues)))
    if rule in _ANY_STEP:  # the bilinear rule gathers eigenvalues at -1
        return _ROUNDED / fastest if rule == "bilinear" else math.inf
    steps = Steps(of, rule, now)

    def radius(grid: Array) -> Array:
        matrices = np.array([steps.error(c, starts) for c in grid.tolist()])
        return np.asarray(np.max(np.abs(np.linalg.eigvals(matrices)), axis=1), dtype=np.float64)

    return _first_crossing(radius, 8.0 / fastest)


def _copies(of: dict[str, Any], part: str) -> Array:
    """Memories of a collection: copies alike, or two that differ."""
    n, copies = of["n"], of["copies"]
    which = np.ones(copies)
    if part == "apart":
        which[:] = 0.0
        which[:2] = 1.0, -1.0
    starts = np.kron(which[:, None], np.eye(n))
    before = n * (of["kind"] == "modified")  # the observer beside them rests
    return np.vstack([np.zeros((before, n)), starts])


def _first_crossing(radius: Callable[[Array], Array], highest: float) -> float:
    """The first c in (0, highest] with radius(c) > 1: by a grid, then by halves."""
    grid = np.linspace(0.0, highest, 65)
    unstable = np.flatnonzero(radius(grid[1:]) > 1.0 + 1e-10)
    if unstable.size == 0:
        return highest
    low, high = grid[unstable[0] : unstable[0] + 2].tolist()
    for _ in range(30):
        middle = 0.5 * (low + high)
        if radius(np.array([middle]))[0] > 1.0 + 1e-10:
            high = middle
        else:
            low = middle
    return float(low)


# --- laws that are recursions already ---------------------------------------------------------


def _reduced_order(observer: Mapping[str, Any]) -> StepLimit:
    h_bar = _checks.positive_vector(member(observer, "h_bar"), "h_bar")
    epsilon = _checks.positive(member(observer, "epsilon"), "epsilon")
    parts = {f"component {i + 1}": 2.0 / h for i, h in enumerate(h_bar.tolist())}  # |1 - T h| < 1
    c = min(parts.values())
    return StepLimit("recursion", c * epsilon, c, parts)


def _sampled_data(observer: Mapping[str, Any]) -> StepLimit:
    gain = "derived"
    if "gain" in observer:
        gain = choice(observer, "gain", ("derived", "printed"))
    model = member(observer, "model")
    if choice(model, "kind", ("van-der-pol", "own")) == "own":
        return StepLimit("recursion", math.inf, math.inf, {})  # K_T may depend on T at will
    epsilon = _checks.number(model.get("epsilon", 0.8), "model.epsilon")
    parts = dict(_van_der_pol_limits(epsilon, gain))
    dt = parts["along the cycle"]
    return StepLimit("recursion", dt, dt, parts)


def _window(observer: Mapping[str, Any]) -> StepLimit:
    period = _checks.positive(member(observer, "dt"), "dt")
    return StepLimit("recursion", math.inf, math.inf, {}, period)  # stable at its period


def _filter(observer: Mapping[str, Any]) -> StepLimit:
    return StepLimit(str(member(observer, "method")), math.inf, math.inf, {})  # P moves its gains


def _chains(observer: Mapping[str, Any]) -> StepLimit:
    limits = [step_limit(chain) for chain in member(observer, "observers")]
    parts = {f"output {i + 1}": limit.dt for i, limit in enumerate(limits)}
    least = min(limits, key=lambda limit: limit.dt)
    return StepLimit(least.method, least.dt, least.c, parts)


@lru_cache(maxsize=16)
def _van_der_pol_limits(epsilon: float, gain: str) -> tuple[tuple[str, float], ...]:
    sign = 1.0 if gain == "derived" else -1.0

    def rate(mu: Array) -> tuple[Array, Array]:
        """l1/T, and l2/T with the part that cancels the nonlinearity taken off (1 is -x1's)."""
        return 5.0 + sign * mu, 6.0 + (5.0 + mu) * mu

    # Constant mu, |y| <= 2.1: [[-l1, 1], [-l2, mu]], forward Euler.
    mu = np.linspace(epsilon * (1.0 - 2.1**2), epsilon, 201)
    l1, l2 = rate(mu)
    error = np.moveaxis(np.array([[-l1, np.ones_like(mu)], [-l2, mu]]), 2, 0)
    eigenvalues = np.linalg.eigvals(error)
    frozen = float(np.min(-2.0 * eigenvalues.real / np.abs(eigenvalues) ** 2))

    # mu as it moves: the growth of the error over samples of the limit cycle.
    orbit, period = _van_der_pol_cycle(epsilon)
    times = np.linspace(0.0, period, len(orbit))

    def growth(steps: Array) -> Array:
        a, b, total = np.ones_like(steps), 0.37 * np.ones_like(steps), np.zeros_like(steps)
        samples = 250
        for k in range(samples):
            y = np.interp(k * steps, times, orbit, period=period)
            mu = epsilon * (1.0 - y * y)
            l1, l2 = rate(mu)
            a, b = a + steps * (b - l1 * a), b + steps * (mu * b - l2 * a)
            size = np.hypot(a, b)
            total += np.log(size)
            a, b = a / size, b / size
        return total / samples

    low, high = 0.0, 1.0
    for points in (40, 12):
        grid = np.linspace(low, high, points + 1)[1:]
        unstable = np.flatnonzero(growth(grid) > 0.0)
        if unstable.size == 0:
            low = high
            break
        first = int(unstable[0])
        low, high = (float(grid[first - 1]) if first else low), float(grid[first])
    return ("along the cycle", low), ("worst frozen mu", max(frozen, 0.0))


def _van_der_pol_cycle(epsilon: float) -> tuple[Sequence[float], float]:
    """x1 over one period of x1'' = -x1 + epsilon (1 - x1^2) x1', evenly spaced, and the period [s].

    The equilibrium (x1 = 0) for epsilon <= 0, where there is no cycle.
    """
    if epsilon <= 0.0:
        return [0.0, 0.0], 1.0
    h = 0.02 / max(1.0, epsilon)

    def slope(x: float, v: float) -> tuple[float, float]:
        return v, -x + epsilon * (1.0 - x * x) * v

    x, v, t = 2.0, 0.0, 0.0
    orbit: list[float] = []
    started = False
    while len(orbit) < 200_000:
        a1, b1 = slope(x, v)
        a2, b2 = slope(x + 0.5 * h * a1, v + 0.5 * h * b1)
        a3, b3 = slope(x + 0.5 * h * a2, v + 0.5 * h * b2)
        a4, b4 = slope(x + h * a3, v + h * b3)
        before = x
        x += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        v += h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
        t += h
        upward = before < 0.0 <= x
        if started and upward:
            break
        if started or (upward and t > 10.0):  # transients from (2, 0) are over
            started = True
            orbit.append(x)
    return [*orbit, orbit[0]], h * len(orbit)


# --- limits that are not a step's of a continuous law -----------------------------------------

_LIMITS: dict[str, Callable[[Mapping[str, Any]], StepLimit]] = {
    "sampled-data": _sampled_data,
    "reduced-order": _reduced_order,
    "window": _window,
    "high-gain-ekf": _filter,
    "chains": _chains,
}
