"""Covariances of an observer's error: what noise and model error make of it.

On x+ = A x + w, y = x_1 + v, the law z+ = a z + b y, x_hat = c z + d y errs by e = z - L x:

    e+ = a e + b v - L w,        x_hat - x = c e + d v,

where z = L x without errors (`design.discrete`, `following`).  Before the sample is used the error
is that of the first n entries of z.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hgo_rs.design.discrete import discrete, following
from hgo_rs.tuning.result import Array


@dataclass(frozen=True, eq=False)
class Covariances:
    """Of the errors of all estimates, (2, n, n): per unit variance R of the measurement noise, and
    per unit spectral density Q of white noise in x_n'.

    ``before``, ``shown``: before the sample is used, and as the observer shows them.
    """

    before: Array
    shown: Array


def motion_noise(n: int, dt: float) -> Array:
    """Covariance of a chain's states after `dt`, moved by white noise of unit density in x_n'."""
    left = np.arange(n - 1, -1, -1)
    each = dt**left / np.array([math.factorial(j) for j in left])
    return np.asarray(dt * np.outer(each, each) / (left[:, None] + left + 1.0))


def stationary(spec: Mapping[str, Any], dt: float) -> Covariances:
    """With the model left out, from Lyapunov equations.

    Raises DesignError for a law that is not one chain.
    """
    from scipy.linalg import solve_discrete_lyapunov

    law = discrete(spec, dt)
    n = len(law.c)
    a, b, c, d = law.scaled
    scale = law.scale[:n]
    lift = following(spec)
    spread = lift @ (motion_noise(n, dt) / np.outer(scale, scale)) @ lift.T
    of_noise, of_model = (solve_discrete_lyapunov(a, q) for q in (b @ b.T, spread))
    units = np.outer(scale, scale)
    before = [p[:n, :n] * units for p in (of_noise, of_model)]
    shown = [(c @ p @ c.T) * units for p in (of_noise, of_model)]
    shown[0] = shown[0] + (d @ d.T) * units
    return Covariances(np.array(before), np.array(shown))
