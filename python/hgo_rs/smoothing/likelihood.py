"""R and Q of a record: those that make it most likely, by the innovations of the filter.

One step ahead, noise that lasts for some samples (steps of an encoder, samples read twice) looks
like motion, and Q is found too large.  So the search is repeated on every second sample, every
fourth, ...: of white noise Q comes out the same; where it falls by a third the noise lasted, and
the search goes on.  A sample then counts as the part of one that it is: R is m times its variance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hgo_rs.errors import HgoError
from hgo_rs.smoothing.forward import Forward, forward
from hgo_rs.smoothing.motion import Motion
from hgo_rs.smoothing.samples import Array, Samples

_SPAN = 1e-3, 5.0
"""Of ell dt, ell = (Q/(R dt))^(1/(2n)) the rate at which Q and R are of one size."""
_POINTS = 18
_FALLS = 1.5
"""Q on twice the distance is smaller by more where noise lasts."""
_FEWEST = 500  # samples of a search on fewer of them
_SLOW = 2.0  # of ell m dt, up to which a record has samples to spare
_GROWS = 30.0  # of the third differences' variance, what noise that lasts may have
_CLOSE = 0.02  # of ln(Q/R): a hundredth of the standard deviation of most estimates

Progress = Callable[[int], None]


def ratio(samples: Samples, motion: Motion, channel: int, reach: float) -> float:
    """Q/R of a chain for ell dt = reach."""
    dt, order = samples.usual(channel), motion.orders[channel]
    return float(dt * (reach / dt) ** (2 * order))


def noises(
    motion: Motion,
    samples: Samples,
    r: Array | None,
    q: Array | None,
    note: Callable[[str], None],
    progress: Progress | None = None,
) -> tuple[Array, Array]:
    """R (n_y,) and Q (n, n): given, or, for the last state of each chain, the most likely ones.

    Raises
    ------
    HgoError
        A record that no R and Q fit, as the filter diverges or y is exact.
    """
    if r is not None and q is not None:
        return r, q
    tried = 0

    def count() -> None:
        nonlocal tried
        tried += 1
        if progress is not None:
            progress(tried)

    found = likeliest(motion, samples, r, q, note, count)
    if r is not None or q is not None:
        return found
    m = 1
    while _to_spare(motion, samples, found, m):
        y = np.full_like(samples.y, np.nan)
        y[:: 2 * m] = samples.y[:: 2 * m]
        try:
            fewer = likeliest(motion, replace(samples, y=y), None, None, count=count)
        except HgoError:
            break
        before, after = (np.diag(q)[list(motion.last)] for q in (found[1], fewer[1]))
        lasts = np.all(after < before) and np.any(after * _FALLS < before)
        most = [_GROWS * samples.noise(c) for c in range(len(motion.orders))]
        if not lasts or np.any(fewer[0] > most):
            break
        found, m = fewer, 2 * m
    if m > 1:
        note(f"the noise of y is correlated over some {m} samples, which count as one")
    return m * found[0], found[1]


def _to_spare(motion: Motion, samples: Samples, found: tuple[Array, Array], m: int) -> bool:
    """Whether R and Q on every m-th sample leave enough of them for half as many."""
    r, q = found
    there = np.isfinite(samples.y[:: 2 * m])
    if np.min(np.sum(there, axis=0)) < _FEWEST or not np.isfinite(samples.y).all():
        return False
    for c, (end, order) in enumerate(zip(motion.last, motion.orders, strict=True)):
        dt = m * samples.usual(c)
        if (q[end, end] / (r[c] * dt)) ** (0.5 / order) * dt > _SLOW:
            return False
    return True


def likeliest(
    motion: Motion,
    samples: Samples,
    r: Array | None,
    q: Array | None,
    note: Callable[[str], None] = lambda _: None,
    count: Callable[[], None] = lambda: None,
) -> tuple[Array, Array]:
    """R and Q that make the record most likely; `count` is called for each filter that is run."""
    from scipy.optimize import minimize, minimize_scalar

    channels = range(len(motion.orders))
    guess = np.array([samples.noise(c) for c in channels])
    if not np.all(guess > 0.0):
        raise HgoError(
            "y is constant or a straight line: must move otherwise for an estimate of R and Q; "
            "give R and Q"
        )

    def filtered(own: Array, intensities: Array) -> Forward | None:
        count()
        matrix = np.zeros((motion.n, motion.n))
        matrix[motion.last, motion.last] = intensities
        try:
            return forward(motion, samples, own, matrix if q is None else q)
        except HgoError:
            return None

    def both(free: Array) -> tuple[Array, Array]:
        """R and Q from ln of Q/R of each chain, then of the variances of all outputs but the first
        if they are open; or of R alone where Q is known.
        """
        if q is not None:
            return np.exp(free), np.zeros(len(guess))
        own = guess if r is None else r
        own = own.copy()
        if r is None:
            own[1:] = np.exp(free[len(own) :])
        return own, own * np.exp(free[: len(own)])

    def loss(free: Array) -> float:
        found = filtered(*both(free))
        if found is None:
            return math.inf
        value = found.scaled_loss if r is None and q is None else found.loss
        return value if math.isfinite(value) else math.inf

    others = np.log(guess[1:]) if r is None and q is None else np.empty(0)
    if q is None:
        grid = np.geomspace(*_SPAN, _POINTS)
        points = [
            np.r_[[math.log(ratio(samples, motion, c, reach)) for c in channels], others]
            for reach in grid.tolist()
        ]
    else:
        points = [np.log(guess) - shift for shift in np.linspace(-2.0, 16.0, _POINTS)]
    values = np.array([loss(point) for point in points])
    if not np.isfinite(values).any():
        raise HgoError(
            "the filter diverges for every R and Q that was tried: the model must follow the "
            "record; check its parameters, units and signs, or give R and Q"
        )
    k = int(np.argmin(values))
    if len(points[k]) == 1:
        ends = [points[max(k - 1, 0)][0], points[min(k + 1, len(points) - 1)][0]]
        best = minimize_scalar(
            lambda z: loss(np.array([z])),
            bounds=sorted(ends),
            method="bounded",
            options={"xatol": _CLOSE},
        )
        free = np.array([best.x]) if best.fun < values[k] else points[k]
    else:
        best = minimize(
            loss,
            points[k],
            method="Nelder-Mead",
            options={"xatol": 2.0 * _CLOSE, "fatol": 0.05, "maxfev": 60 * len(points[k])},
        )
        free = np.asarray(best.x if best.fun < values[k] else points[k])
    if k in (0, len(points) - 1) and q is None:
        side = "smallest: the record shows no model error" if k == 0 else "largest"
        note(f"the most likely Q is the {side} of those tried")
    own, intensities = both(free)
    matrix = np.zeros((motion.n, motion.n))
    matrix[motion.last, motion.last] = intensities
    if q is not None:
        return own, q
    if r is not None:
        return r, matrix
    scale = forward(motion, samples, own, matrix).scale
    if not scale > 0.0:
        raise HgoError("the model fits every sample exactly: no noise is left; give R and Q")
    return own * scale, matrix * scale
