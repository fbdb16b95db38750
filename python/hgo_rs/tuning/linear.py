"""Covariances of an observer's error: what noise and model error make of it.

On x+ = A x + w, y = x_1 + v, the law z+ = a z + b y, x_hat = c z + d y errs by e = z - L x:

    e+ = a e + b v - L w,        x_hat - x = c e + d v,

where z = L x without errors (`design.discrete`, `following`).  Before the sample is used the error
is that of the first n entries of z.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hgo_rs.design.discrete import discrete, following
from hgo_rs.models import Model
from hgo_rs.models.own.analysis import Jacobian
from hgo_rs.tuning.record import Record
from hgo_rs.tuning.result import Array

_TERMS = 9


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
    lift = following(spec, len(a))
    spread = lift @ (motion_noise(n, dt) / np.outer(scale, scale)) @ lift.T
    of_noise, of_model = (solve_discrete_lyapunov(a, q) for q in (b @ b.T, spread))
    units = np.outer(scale, scale)
    before = [p[:n, :n] * units for p in (of_noise, of_model)]
    shown = [(c @ p @ c.T) * units for p in (of_noise, of_model)]
    shown[0] = shown[0] + (d @ d.T) * units
    return Covariances(np.array(before), np.array(shown))


def transitions(model: Model, t: Array, x: Array, u: Array | None, dt: Array) -> Array:
    """exp(J dt) with the model's Jacobian J at t, x and u: (K, n, n), for K samples.

    t, dt: (K,); x: (K, n); u: (K, n_u).
    """
    jacobian = Jacobian(model.drift, model.states, model.parameters)
    values: dict[str, Array] = {name: x[:, i] for i, name in enumerate(model.states)}
    values["t"] = t
    if u is not None:
        values |= {name: u[:, i] for i, name in enumerate(model.inputs)}
    slopes = jacobian(**values)
    return exponential(np.nan_to_num(slopes) * dt[:, None, None])


def exponential(matrices: Array) -> Array:
    """exp of each of a stack, by a series of the 16th part and four squarings.

    To 1e-12 relative for norms up to 2.
    """
    part = matrices / 16.0
    eye = np.eye(matrices.shape[-1])
    out = np.broadcast_to(eye, matrices.shape)
    for j in range(_TERMS, 0, -1):
        out = eye + part @ out / j
    for _ in range(4):
        out = out @ out
    return np.asarray(out)


def along(specs: Sequence[Mapping[str, Any]], dt: float, moves: Array) -> Covariances:
    """Along a path on which the error moves by the model's own slopes: (2, G, n, n) for G gains.

    The variational equation of the law: between samples F_k (``moves``, (S, L, n, n): S stretches
    of L steps) stands where the chain alone has A,

        e+ = [a + L (F_k - A) c] e + [b + L (F_k - A) d] v - L w.

    From no error on; the means over the later half of the steps, by which the start should be
    forgotten.
    """
    laws = [discrete(spec, dt) for spec in specs]
    n = len(laws[0].c)
    a, b, c, d = (np.array([getattr(law, name) for law in laws]) for name in "abcd")
    lift = following(specs[0], a.shape[1])
    # in the law's own units, entry i of z has those of x_hat_1 times s^-power
    power = laws[0].power
    scale = np.array([law.ell for law in laws])[:, None] ** power
    lifts = scale[:, :, None] * lift / scale[:, None, :n]
    chain = sum(np.eye(n, k=j) * dt**j / math.factorial(j) for j in range(n))
    spread = lifts @ motion_noise(n, dt) @ np.swapaxes(lifts, 1, 2)
    stretches, steps = moves.shape[:2]
    p = np.zeros((2, len(laws), stretches, *a.shape[1:]))
    sums = np.zeros((2, 2, len(laws), n, n))
    with np.errstate(all="ignore"):
        for k in range(steps):
            extra = lifts[:, None] @ (moves[:, k] - chain)  # (G, S, m, n)
            m = a[:, None] + extra @ c[:, None]
            gain = b[:, None] + extra @ d[:, None]
            p = m @ p @ np.swapaxes(m, -1, -2)
            p[0] += gain @ np.swapaxes(gain, -1, -2)
            p[1] += spread[:, None]
            if 2 * k >= steps:
                sums[0] += np.mean(p[..., :n, :n], axis=2)
                shown = c[:, None] @ p @ np.swapaxes(c[:, None], -1, -2)
                shown[0] += (d @ np.swapaxes(d, -1, -2))[:, None]
                sums[1] += np.mean(shown, axis=2)
    count = steps - (steps + 1) // 2
    return Covariances(sums[0] / count, sums[1] / count)


def path(record: Record, model: Model, x_hat: Array, stretches: int, steps: int) -> Array:
    """F_k on some stretches of a record, evenly spread: (S, L, n, n)."""
    first = int(np.argmax(record.judged))
    last = len(record.t) - 1 - steps
    begins = np.unique(np.linspace(first, max(last, first), stretches).astype(int))
    rows = np.minimum(begins[:, None] + np.arange(steps), len(record.t) - 2).ravel()
    u = None if record.u is None else record.u[rows]
    dt = np.full(len(rows), record.dt)
    found = transitions(model, record.t[rows], x_hat[rows, : model.n], u, dt)
    return found.reshape(len(begins), steps, model.n, model.n)


def slopes_beside(model: Model, record: Record, x_hat: Array, ell: float) -> float:
    """How much of the error's motion the model's slopes are, beside a gain: the RMS along an
    estimate of the norm of df_i/dx_j ell^(j-i-1).
    """
    rows = np.flatnonzero(record.judged)
    values: dict[str, Array] = dict(zip(model.states, x_hat[rows].T, strict=False))
    values["t"] = record.t[rows]
    if record.u is not None:
        values |= dict(zip(model.inputs, record.u[rows].T, strict=True))
    slopes = Jacobian(model.drift, model.states, model.parameters)(**values)
    i, j = np.indices((model.n, model.n))
    off = (slopes - np.eye(model.n, k=1)) * ell ** (j - i - 1.0)
    return float(np.sqrt(np.mean(np.sum(np.nan_to_num(off) ** 2, axis=(-2, -1)))))


@dataclass(frozen=True, eq=False)
class Slopes:
    """Covariances along a path at some gains, beside and between them by powers of the gain."""

    ells: Array
    covariances: Covariances

    @classmethod
    def of(cls, specs: Sequence[Mapping[str, Any]], dt: float, moves: Array) -> Slopes | None:
        """At gains of one law, rising; None where they are finite at fewer than three."""
        found = along(specs, dt, moves)
        sound = np.isfinite(found.before).all((0, 2, 3)) & np.isfinite(found.shown).all((0, 2, 3))
        diagonals = np.diagonal(found.shown, axis1=2, axis2=3)
        sound &= (diagonals > 0.0).all((0, 2)) & (found.before[..., 0, 0] > 0.0).all(0)
        if np.sum(sound) < 3:
            return None
        ells = np.array([spec["gain"]["ell"] for spec in specs])[sound]
        return cls(ells, Covariances(found.before[:, sound], found.shown[:, sound]))

    def innovation(self, ells: Array) -> Array:
        """Variances of the innovation per unit R and per unit Q, (k, 2)."""
        of = np.array([self._between(one, ells) for one in self.covariances.before[..., 0, 0]])
        return np.asarray((of + np.array([[1.0], [0.0]])).T)

    def shown(self, ells: Array) -> Array:
        """Variances of all estimates per unit R and per unit Q, (2, k, n)."""
        diagonals = np.diagonal(self.covariances.shown, axis1=2, axis2=3)
        n = diagonals.shape[2]
        both = [[self._between(one[:, i], ells) for i in range(n)] for one in diagonals]
        return np.swapaxes(np.array(both), 1, 2)

    def _between(self, values: Array, ells: Array) -> Array:
        at, of, x = np.log(self.ells), np.log(values), np.log(ells)
        inside = np.interp(x, at, of)
        below = of[0] + (x - at[0]) * (of[1] - of[0]) / (at[1] - at[0])
        above = of[-1] + (x - at[-1]) * (of[-1] - of[-2]) / (at[-1] - at[-2])
        return np.asarray(np.exp(np.where(x < at[0], below, np.where(x > at[-1], above, inside))))
