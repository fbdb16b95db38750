"""Covariances of the high-gain extended Kalman filter, in the textbook's form.

P is a stack of matrices, (runs, n, n).  A memory holds it as the entries of P = L D L', L unit
lower triangular, row by row with D on the diagonal: (n (n + 1)/2, runs).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import factorial
from typing import Any

import numpy as np

from . import integrate
from .error import Array, fail

Rate = Callable[[Array, float], Array]
"""(x_hat (n, runs), t) -> its rate without a sample, of the same shape."""

SUBSTEPS = 2
"""Steps of the model between two samples."""


def square(packed: Array) -> Array:
    """A symmetric matrix (n, n) from its lower triangle, row by row."""
    n = round((np.sqrt(8 * len(packed) + 1) - 1) / 2)
    full = np.zeros((n, n))
    full[np.tril_indices(n)] = packed
    return full + np.tril(full, -1).T


def factors(memory: Array, n: int) -> tuple[Array, Array]:
    """L (runs, n, n) and D (runs, n) of what a memory holds."""
    lower = np.zeros((memory.shape[1], n, n))
    i, j = np.tril_indices(n)
    lower[:, i, j] = memory.T
    d = np.diagonal(lower, axis1=1, axis2=2).copy()
    lower[:, np.arange(n), np.arange(n)] = 1.0
    return lower, d


def covariance(memory: Array, n: int) -> Array:
    """P of what a memory holds."""
    lower, d = factors(memory, n)
    return np.asarray((lower * d[:, None, :]) @ np.swapaxes(lower, 1, 2))


def entries(lower: Array, d: Array) -> Array:
    """What a memory holds of L and D, or of their rates."""
    n = d.shape[1]
    both = lower.copy()
    both[:, np.arange(n), np.arange(n)] = d
    i, j = np.tril_indices(n)
    return np.asarray(both[:, i, j].T)


def held(p: Array) -> Array:
    """What a memory holds of P."""
    n = p.shape[1]
    lower, d = np.zeros_like(p) + np.eye(n), np.zeros(p.shape[:2])
    for j in range(n):
        d[:, j] = p[:, j, j] - np.sum(lower[:, j, :j] ** 2 * d[:, :j], axis=1)
        for i in range(j + 1, n):
            known = np.sum(lower[:, i, :j] * lower[:, j, :j] * d[:, :j], axis=1)
            lower[:, i, j] = (p[:, i, j] - known) / np.where(d[:, j] == 0.0, 1.0, d[:, j])
    return entries(lower, d)


def held_rate(memory: Array, rate: Array) -> Array:
    """The rate of L and D for a rate of P: with M = L^-1 P' L^-T, D' = diag M and L' = L X,
    X_ij = M_ij/d_j below the diagonal.
    """
    n = rate.shape[1]
    lower, d = factors(memory, n)
    m = np.linalg.solve(lower, np.swapaxes(np.linalg.solve(lower, rate), 1, 2))
    below = np.tril(m, -1) / d[:, None, :]
    return entries(lower @ below, np.diagonal(m, axis1=1, axis2=2))


def shift(orders: Sequence[int]) -> Array:
    """A of chains of integrators."""
    a = np.zeros((sum(orders),) * 2)
    first = 0
    for order in orders:
        a[first : first + order, first : first + order] = np.eye(order, k=1)
        first += order
    return a


def slopes(rate: Rate, x_hat: Array, t: float) -> Array:
    """J (runs, n, n) by differences of fourth order."""
    n = len(x_hat)
    out = np.empty((x_hat.shape[1], n, n))
    for j in range(n):
        h = 1e-3 * np.maximum(1.0, np.abs(x_hat[j]))

        def at(steps: float, j: int = j, h: Array = h) -> Array:
            moved = x_hat.copy()
            moved[j] += steps * h
            return rate(moved, t)

        out[:, :, j] = ((8.0 * (at(1.0) - at(-1.0)) - at(2.0) + at(-2.0)) / (12.0 * h)).T
    return out


def scaled(q: Array, theta: Sequence[float], orders: Sequence[int]) -> Array:
    """Q_theta = theta D Q D, D = diag(1, theta, ..., theta^(n-1)), for each chain."""
    powers = np.concatenate(
        [g ** (np.arange(order) + 0.5) for g, order in zip(theta, orders, strict=True)]
    )
    return np.asarray(q * np.outer(powers, powers))


def noise(a: Array, q: Array, dt: float) -> Array:
    """int_0^dt exp(A s) Q exp(A s)' ds of A (runs, n, n), by Gauss's rule, which is exact here."""
    n = a.shape[-1]
    nodes, weights = np.polynomial.legendre.leggauss(n)
    total: Array = np.zeros_like(a)
    for node, weight in zip(nodes, weights, strict=True):
        s = 0.5 * dt * (1.0 + node)
        ahead: Any = sum(np.linalg.matrix_power(a * s, k) / factorial(k) for k in range(n))
        total = total + 0.5 * dt * weight * ahead @ q @ np.swapaxes(ahead, 1, 2)
    return total


def moved(
    rate: Rate, a: Array, q: Array, x_hat: Array, p: Array, t: float, dt: float
) -> tuple[Array, Array]:
    """x_hat and P a time ``dt`` after ``t`` without a sample: x_hat and the transition matrix Phi
    by RK4, P = Phi P Phi' + noise.  ``a``: the chains, (runs, n, n).
    """
    n, runs = x_hat.shape

    def both(s: float, z: Array) -> Array:
        x, phi = z[:n], z[n:].reshape(n, n, runs)
        turned = np.einsum("rij,jkr->ikr", slopes(rate, x, s), phi)
        return np.vstack([rate(x, s), turned.reshape(n * n, runs)])

    z: Any = np.vstack([x_hat, np.repeat(np.eye(n).reshape(-1, 1), runs, axis=1)])
    for k in range(SUBSTEPS):
        z = integrate.rk4(both, t + k * dt / SUBSTEPS, z, dt / SUBSTEPS)
    phi = np.moveaxis(z[n:].reshape(n, n, runs), 2, 0)
    return z[:n], phi @ p @ np.swapaxes(phi, 1, 2) + noise(a, q, dt)


def corrected(
    x_hat: Array, p: Array, e: Array, rows: Sequence[int], r: Sequence[float]
) -> tuple[Array, Array]:
    """x_hat and P after innovations ``e`` (outputs, runs) of the states ``rows`` with noise of
    variances ``r``: K = P C'(C P C' + R)^-1, P = (I - K C) P (I - K C)' + K R K'.
    """
    n = len(x_hat)
    c = np.eye(n)[list(rows)]
    k = p @ c.T @ np.linalg.inv(c @ p @ c.T + np.diag(r))
    rest = np.eye(n) - k @ c
    p = rest @ p @ np.swapaxes(rest, 1, 2) + k @ np.diag(r) @ np.swapaxes(k, 1, 2)
    return x_hat + np.einsum("rij,jr->ir", k, e), p


def checked(p: Array, name: str, *, definite: bool) -> Array:
    """A covariance that is symmetric and positive."""
    least = float(np.min(np.linalg.eigvalsh(p)))
    holds = least > 0.0 if definite else least >= -1e-9 * float(np.max(np.abs(p)))
    if not holds:
        allowed = "positive definite" if definite else "positive semidefinite"
        raise fail(f"observer.{name}", p.tolist(), allowed, "give a covariance")
    return p
