"""Gains that place the eigenvalues of an observer's error in discrete time.

Between samples the chain moves by Phi = exp(A T), exactly; a sample corrects by K (y - x_1).  The
error then moves by (I - K C) Phi, whose eigenvalues are to be z_i = exp(T lambda_i) ("zoh") or
(2 + T lambda_i) / (2 - T lambda_i) ("bilinear"), lambda_i those of the continuous law.
"""

from __future__ import annotations

from functools import lru_cache
from math import comb, factorial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .error import Array

PLACED = ("zoh", "bilinear")


def steps(poles: ArrayLike, dt: float, method: str) -> NDArray[np.complex128]:
    """z_i - 1."""
    p = np.asarray(poles, dtype=np.complex128) * dt
    return np.asarray(np.expm1(p) if method == "zoh" else 2.0 * p / (2.0 - p))


def chain_gains(k: ArrayLike, dt: float, method: str) -> Array:
    """K of a chain whose continuous law has the polynomial s^n + k_1 s^(n-1) + ... + k_n, (n,).

    Ackermann's formula K = q(Phi) O^-1 e_n in the coordinates w_i = T^(i-1) x_i / (i-1)!, in which
    Phi is Pascal's matrix P; O has the rows C P (P - I)^j, q(Phi) is the product of the
    P - I - (z_i - 1).
    """
    return _chain_gains(tuple(np.asarray(k, dtype=np.float64).tolist()), dt, method)


@lru_cache(maxsize=64)
def _chain_gains(k: tuple[float, ...], dt: float, method: str) -> Array:
    n = len(k)
    moved = np.array([[comb(j, i) for j in range(n)] for i in range(n)], dtype=float) - np.eye(n)
    row = moved[0] + np.eye(n)[0]
    rows = [row]
    for _ in range(n - 1):
        rows.append(rows[-1] @ moved)
    w = np.linalg.solve(np.array(rows), np.eye(n)[-1]).astype(np.complex128)
    for step in steps(np.roots([1.0, *k]), dt, method):
        w = moved @ w - step * w
    return np.asarray(w.real * [factorial(i) / dt**i for i in range(n)])


def low_power_gains(
    alpha: Array, beta: Array, dt: float, method: str
) -> tuple[Array, Array, Array, Array]:
    """a (n,) and b (n - 1,) that place all eigenvalues, a' and b' that place those of each block.

    With e_i+ = (1 - a_i) e_i + b_(i-1) e_(i-1) and S_k = sum_j (jT)^k / k! z^-j, what an innovation
    of the k-th derivative makes of the prediction, the characteristic equation is

        1 + a_1 S_0 + sum_k b_1 ... b_k S_k / ((z - 1 + a_2) ... (z - 1 + a_k)) = 0

    (and a_n stands alone).  Written over z - 1, S_k = N_k / (z - 1)^(k+1); the terms are taken off
    from the last one on: what is left has a factor (z - 1)(z - 1 + a_k).
    """
    return _low_power_gains(tuple(alpha.tolist()), tuple(beta.tolist()), dt, method)


@lru_cache(maxsize=64)
def _low_power_gains(
    alpha: tuple[float, ...], beta: tuple[float, ...], dt: float, method: str
) -> tuple[Array, Array, Array, Array]:
    n = len(alpha)
    inner, product = np.array([1.0]), 1.0
    for a_i, b_i in zip(alpha[:-1], beta, strict=True):
        product *= b_i
        inner = np.convolve(inner, [1.0, a_i, 0.0])
        inner[-1] += product
    p = np.poly(steps(np.roots(inner), dt, method)).real if n > 1 else np.array([1.0])
    a, b, c = -steps(-np.array(alpha), dt, method).real, np.zeros(n - 1), np.ones(n)
    alone = np.array([chain_gains(k, dt, method) for k in zip(alpha, beta, strict=False)])
    for k in range(n - 1, 0, -1):
        spread = dt**k / factorial(k) * _numerator(k)
        c[k] = p[-1] / spread[-1]
        left = np.polysub(p, c[k] * spread)[:-1]
        roots = np.roots(left)
        real = roots[np.abs(roots.imag) <= 1e-9 * np.abs(roots)].real
        root = real[np.argmin(np.abs(real + a[k - 1]))]
        p = np.polydiv(left, [1.0, -root])[0]
        a[k - 1] = -root
    b = c[1:] / c[:-1]
    a_alone = np.append(alone[:, 0], a[-1]) if n > 1 else a
    return a, b, a_alone, alone[:, 1] if n > 1 else b


def _numerator(k: int) -> Array:
    """N_k over w = z - 1: sum_j j^k z^-j = N_k / w^(k+1), N_(k+1) = z ((k+1) N_k - w N_k')."""
    numerator = np.array([1.0])
    for j in range(k):
        slope = numerator * np.arange(numerator.size - 1, -1, -1)  # w N'
        numerator = np.convolve([1.0, 1.0], np.polysub((j + 1) * numerator, slope))
    return np.trim_zeros(numerator, "f")


def ahead(rates: Array, dt: Array | float) -> Array:
    """sum_(m>=1) T^m / m! rates_(i+m-1): how far a chain moves, (n, runs)."""
    moved = np.zeros_like(rates)
    n = len(rates)
    for i in range(n):
        for m in range(1, n - i + 1):
            moved[i] += dt**m / factorial(m) * rates[i + m - 1]
    return moved
