"""What else one would take: differentiators and Kalman filters, each tuned by the record alone.

Each rule looks at y only; none sees the truth.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hgo_rs.errors import HgoError, explain
from hgo_rs.observers import StandardObserver
from hgo_rs.observers.window import polynomial
from hgo_rs.smoothing.forward import forward
from hgo_rs.smoothing.likelihood import likeliest
from hgo_rs.smoothing.motion import Motion
from hgo_rs.smoothing.samples import Array, Samples

_EVEN = 0.05  # of the step, that those of an even clock may be off, RMS
_LONGEST = 400  # samples of a window
_SPAN = 2e-3, 3.0  # of ell dt
_POINTS = 30


@dataclass(frozen=True, eq=False)
class Baseline:
    """Estimates of y and its derivatives, (N, states), and the rule that tuned them."""

    x: Array
    rule: str


def of_channel(samples: Samples, channel: int) -> Samples:
    """One output, without inputs."""
    empty = np.empty((len(samples.t), 0))
    return Samples(samples.t, samples.y[:, channel : channel + 1], empty)


def _even(samples: Samples, name: str) -> float:
    """The step of a record that has one, and every sample."""
    dt = float(np.median(samples.dt))
    off = float(np.sqrt(np.mean((samples.dt - dt) ** 2))) / dt
    if off > _EVEN or samples.missing.any():
        told = f"even to {_EVEN:.0%} and complete; resample it, or leave this baseline out"
        raise HgoError(explain(f"record for {name}", f"steps off by {off:.1%}", told, "as it is"))
    return dt


def difference(samples: Samples) -> Baseline:
    """Backward difference through a Butterworth low-pass of order 1 or 2.

    Its cutoff predicts the next sample best: y_{k+1} = y_k + dt v_k.
    """
    from scipy import signal

    dt, y = _even(samples, "the filtered difference"), samples.y[:, 0]
    slope = np.diff(y, prepend=y[0]) / dt
    best, least = slope, np.inf
    for order in (1, 2):
        for cutoff in np.geomspace(1e-3, 0.98, 40).tolist():
            v = signal.lfilter(*signal.butter(order, cutoff), slope)
            left = float(np.mean((y[1:] - y[:-1] - dt * v[:-1]) ** 2))
            if left < least:
                best, least = v, left
    return Baseline(np.column_stack([y, best]), "cutoff by one-step prediction")


def savitzky_golay(samples: Samples) -> Baseline:
    """Derivative at the newest sample of the polynomial through the last ones by least squares.

    Degree 1 to 3 and window predict the next sample best. Savitzky and Golay (1964).
    """
    dt, y = _even(samples, "Savitzky-Golay"), samples.y[:, 0]
    longest = min(_LONGEST, len(y) // 4)
    best, least = np.column_stack([y, np.zeros(len(y))]), np.inf
    for degree in (1, 2, 3):
        for window in np.unique(np.geomspace(degree + 2, longest, 28).astype(int)).tolist():
            weights = polynomial(window, degree)
            ahead = np.convolve(y, weights.sum(axis=0))[: len(y)]
            left = float(np.mean((y[window:] - ahead[window - 1 : -1]) ** 2))
            if left < least:
                least = left
                fitted = [np.convolve(y, weights[i])[: len(y)] / dt**i for i in (0, 1)]
                best = np.column_stack(fitted)
                best[: window - 1] = np.column_stack([y, np.zeros(len(y))])[: window - 1]
    return Baseline(best, "window and degree by one-step prediction")


def alpha_beta_gamma(samples: Samples) -> Baseline:
    """The critically damped alpha-beta-gamma filter: fading memory of order 3.

    It is the standard observer without a model, all poles -1, placed. Its memory gives the least
    innovation.
    """
    usual = samples.usual(0)
    start = [samples.first(0), 0.0, 0.0]
    found, least = None, np.inf
    for ell in (np.geomspace(*_SPAN, _POINTS) / usual).tolist():
        observer = StandardObserver.fading_memory(3, math.exp(-ell * usual), usual)
        run = observer.run(samples.t, samples.y[:, 0], x_hat0=start)
        left = float(np.nanmean(run.innovation[len(run.y) // 20 :] ** 2))
        if left < least:
            found, least = run, left
    assert found is not None
    return Baseline(np.array(found.x_hat), "memory by least innovation")


def random_jerk(samples: Samples) -> Baseline:
    """Kalman filter of a chain of order 3 whose third derivative is white noise."""
    motion = Motion(None, 3)
    r, q = likeliest(motion, samples, None, None)
    return Baseline(forward(motion, samples, r, q).x, "R and Q by maximum likelihood")


def extended(motion: Motion, samples: Samples) -> Baseline:
    """Extended Kalman filter of a model."""
    r, q = likeliest(motion, samples, None, None)
    return Baseline(forward(motion, samples, r, q).x, "R and Q by maximum likelihood")


DIFFERENTIATORS: dict[str, Callable[[Samples], Baseline]] = {
    "filtered difference": difference,
    "Savitzky-Golay, causal": savitzky_golay,
    "alpha-beta-gamma": alpha_beta_gamma,
    "Kalman, random jerk": random_jerk,
}
"""By their names; of one output each."""

EXTENDED = "extended Kalman filter"
BASELINES = (*DIFFERENTIATORS, EXTENDED)
