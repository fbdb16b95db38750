"""The state, from both sides of each sample: what an observer is judged by.

The law run forwards knows of the past, x_f, run backwards of the future, x_b (`reversal`).  With
errors that have nothing in common, of covariances P_f and P_b,

    x_s = W x_f + (1 - W) x_b,        W = P_b (P_f + P_b)^-1,        P_s = W P_f,

is the fixed-interval smoother in its form of two filters (Fraser and Potter, IEEE TAC 14, 1969).
Its error is orthogonal to all that samples tell.  So, for any estimate x_hat made of samples,

    E|x_hat - x|^2 = E|x_hat - x_s|^2 + E|x_s - x|^2,

and the least distance from x_s is the least error, whatever the law.  All samples up to several
1/ell ahead speak for or against an estimate: noise that lasts for some samples, as rounding does,
is not taken for motion.

The smoother's own gain is the one that it says is the best: a fixed point.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from hgo_rs.design.discretisation import step_limit
from hgo_rs.errors import HgoError
from hgo_rs.models import System
from hgo_rs.observers import StandardObserver
from hgo_rs.tuning.linear import stationary
from hgo_rs.tuning.record import Record
from hgo_rs.tuning.result import Array
from hgo_rs.tuning.reversal import reversed_model, reversed_record, signs

MOTION = "rk4-innovation-held"
"""Moves a model over a step by Runge and Kutta's rule."""

_SPAN = 2e-3, 5.0  # of ell dt
_RATIO = 1.25  # of a gain to the one below
_ROUNDS = 8
_LOWER = 1.0, 4.0, 16.0  # the fixed point is looked for from the least innovation's gain, and below
_CLEAR = 2.0  # a lower one must halve what both sides differ by
_LOST = 4.0  # of the least innovation: what is left of y beside a smoothed state that is of use
_FOLLOWS = 0.5  # of a rounding that lasts: less left of y, and the state follows the rounding
_SHIFT = 1.07  # of the gain, for a derivative by differences


def butterworth(n: int) -> list[complex]:
    """Poles of the stationary Kalman filter of a chain moved by white noise."""
    angles = np.pi * (2.0 * np.arange(1, n + 1) + n - 1.0) / (2.0 * n)
    upper = [complex(math.cos(a), math.sin(a)) for a in angles if math.sin(a) > 1e-9]
    return [*upper, *(p.conjugate() for p in upper), *([-1.0 + 0j] if n % 2 else [])]


@dataclass(frozen=True, eq=False)
class Reference:
    """Smoothed states of a record.

    Attributes
    ----------
    name : str
        What it rests on.
    x : (N, n)
    start : (n,)
        The state at the first sample, as all later ones have it.
    spread : (n,)
        Standard deviation of its error, as far as R and Q say.
    difference : (n,)
        RMS of what both sides differ by, over sqrt(2): the error of one of them, where theirs have
        nothing in common.
    ell : float
        Its gain [1/s].
    horizon : float
        How far ahead samples speak [s]: 1/ell.
    noise, model_error : float
        Of the white noise and the white model error for which its gain is the best one and errs as
        it does: sqrt(R), sqrt(Q).
    """

    name: str
    x: Array
    start: Array
    spread: Array
    difference: Array
    ell: float
    noise: float
    model_error: float

    @property
    def horizon(self) -> float:
        return 1.0 / self.ell

    def distance(self, x_hat: Array, record: Record, index: int) -> float:
        """RMS of x_hat - x_s of state `index`; infinite where it overflows."""
        some = record.two_sided
        with np.errstate(all="ignore"):
            square = float(np.mean((x_hat[some, index] - self.x[some, index]) ** 2))
        return math.sqrt(square) if math.isfinite(square) else math.inf


Source = tuple[str, System | None, int]
"""A name, a model and the order of its observer."""


def find(
    record: Record, sources: Iterable[Source], index: int, note: Callable[[str], None]
) -> Reference | None:
    """The reference of which both sides differ least in state `index`; None where there is none."""
    best: Reference | None = None
    if np.sum(record.two_sided) < 50:
        note("no samples on both sides of a stretch: too few to smooth")
        return None
    for name, model, n in sources:
        try:
            found = _of(record, name, model, n, index)
        except HgoError as error:
            note(f"{name}: {error}")
            continue
        if found is not None and (best is None or found.difference[index] < best.difference[index]):
            best = found
    return best


def _of(record: Record, name: str, model: System | None, n: int, index: int) -> Reference | None:
    """The fixed point of one model."""
    back_record = reversed_record(record)
    poles = butterworth(n)
    back_model = reversed_model(model, n, float(record.t[-1]))

    method = None if model is None else MOTION

    def forward(ell: float) -> StandardObserver:
        return StandardObserver(n, ell, poles=poles, model=model, method=method)

    def backward(ell: float) -> StandardObserver:
        return StandardObserver(
            n, ell, poles=poles, model=back_model, method=method, timing="predictor"
        )

    limit = step_limit(forward(1.0 / record.dt).spec).c / record.dt
    low, high = _SPAN[0] / record.dt, min(_SPAN[1] / record.dt, 0.9 * limit)
    grid = np.geomspace(low, high, round(math.log(high / low) / math.log(_RATIO)))
    estimates: list[Array | None] = []
    innovation = np.full(len(grid), np.inf)
    some = record.two_sided
    for k, ell in enumerate(grid.tolist()):
        try:
            run = record.run(forward(ell), spare=True)
        except HgoError:
            estimates.append(None)
            continue
        estimates.append(np.array(run.x_hat))
        with np.errstate(all="ignore"):
            square = float(np.mean(run.innovation[some, 0] ** 2))
        innovation[k] = square if math.isfinite(square) else np.inf
    if not np.isfinite(innovation).any():
        return None
    step = record.coarse_step()
    most = max(_LOST * math.sqrt(float(np.min(innovation))), step)
    least_rounding = _FOLLOWS * step / math.sqrt(12.0)
    tried: dict[int, Reference | None] = {}

    def at(k: int) -> Reference | None:
        if k not in tried:
            tried[k] = None
            x_f = estimates[k]
            try:
                run = back_record.run(backward(float(grid[k])), spare=True)
            except HgoError:
                return None
            if x_f is not None:
                x_b = run.x_hat[::-1] * signs((n,))
                made = _smoothed(record, name, forward, float(grid[k]), x_f, x_b, index)
                if made is not None:
                    left = math.sqrt(float(np.mean((record.y[some] - made.x[some, 0]) ** 2)))
                    tried[k] = made if least_rounding <= left <= most else None
        return tried[k]

    def settled(k: int) -> Reference | None:
        """The fixed point from gain k on."""
        found, seen = at(k), {k}
        for _ in range(_ROUNDS):
            if found is None:
                return None
            far = [np.inf if x is None else found.distance(x, record, index) for x in estimates]
            k = int(np.argmin(far))
            if k in seen:
                return at(k)
            seen.add(k)
            found = at(k)
        return found

    best = None
    least = int(np.argmin(innovation))
    for lower in _LOWER:
        start = int(np.argmin(np.abs(np.log(grid * lower / grid[least]))))
        found = settled(start)
        if found is not None and (
            best is None or found.difference[index] < best.difference[index] / _CLEAR
        ):
            best = found
    return best


def _smoothed(
    record: Record,
    name: str,
    build: Callable[[float], StandardObserver],
    ell: float,
    x_f: Array,
    x_b: Array,
    index: int,
) -> Reference | None:
    """Both sides together, with the covariances of the noises for which `ell` is the best gain."""
    near = [stationary(build(g).spec, record.dt).shown for g in (ell / _SHIFT, ell * _SHIFT)]
    rise, fall = (near[1] - near[0])[:, index, index]
    if not (rise > 0.0 and fall < 0.0):
        return None
    ratio = -rise / fall  # Q/R
    here = stationary(build(ell).spec, record.dt)
    weight = np.array([1.0, ratio])[:, None, None]
    p_f, p_b = np.sum(weight * here.shown, axis=0), np.sum(weight * here.before, axis=0)
    turn = signs((len(p_b),))
    p_b = p_b * np.outer(turn, turn)
    w = np.linalg.solve((p_f + p_b).T, p_b.T).T
    p_s = w @ p_f
    x = x_b + (x_f - x_b) @ w.T
    some = record.two_sided
    with np.errstate(all="ignore"):
        difference = np.sqrt(0.5 * np.mean((x_f[some] - x_b[some]) ** 2, axis=0))
        far = np.sqrt(np.mean((x_f[some] - x[some]) ** 2, axis=0))
    if not (np.isfinite(difference).all() and np.isfinite(far).all()):
        return None
    share = np.clip(np.diag(p_s) / np.diag(p_f), 0.0, 0.95)
    spread = far * np.sqrt(share / (1.0 - share))
    # of the variance that the forward estimate has, the part that R = 1 and Q = ratio give
    unit = math.hypot(far[index], spread[index]) / math.sqrt(p_f[index, index])
    return Reference(name, x, x_b[0], spread, difference, ell, unit, unit * math.sqrt(ratio))
