"""Gains that place the eigenvalues of an observer's error in discrete time.

Between samples the chain moves by Phi = exp(A T), exactly; a sample corrects by K (y - x_1).  The
error then moves by (I - K C) Phi, whose eigenvalues are to be z_i = exp(T lambda_i) ("zoh") or
(2 + T lambda_i) / (2 - T lambda_i) ("bilinear") or 1 / (1 - T lambda_i) ("implicit-map"), lambda_i
those of the continuous law.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal, localcontext
from functools import lru_cache
from math import comb, factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .error import Array

PLACED = ("zoh", "bilinear", "implicit-map")
BILINEAR_LIMIT = {"standard": 6, "low-power": 4, "peaking-free": 4}
"""Orders up to which one rounding of the gains, at ell T = 100, changes the response of the error
by less than 5e-5 of its largest value.  Under "zoh" it is 1e-9 up to order 12."""


def steps(poles: ArrayLike, dt: float, method: str) -> NDArray[np.complex128]:
    """z_i - 1."""
    p = np.asarray(poles, dtype=np.complex128) * dt
    if method == "implicit-map":
        return np.asarray(p / (1.0 - p))
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
    if not np.isfinite(k).all():  # a gain to the n-th power that is beyond the numbers
        return np.full(n, np.nan)
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
    from the last one on: what is left has a factor (z - 1)(z - 1 + a_k), a_k being the root to
    which Newton's method leads from the eigenvalue of a block without company.
    """
    return _low_power_gains(tuple(alpha.tolist()), tuple(beta.tolist()), dt, method)


@lru_cache(maxsize=64)
def _low_power_gains(
    alpha: tuple[float, ...], beta: tuple[float, ...], dt: float, method: str
) -> tuple[Array, Array, Array, Array]:
    n = len(alpha)
    with localcontext() as context:
        context.prec = DIGITS
        images = _precise if n > PLAIN else _plain
        polynomial, near = images(alpha, beta, dt, method)
        a, b = _low_power_steps(polynomial, near, dt)
    alone = np.array([chain_gains(k, dt, method) for k in zip(alpha, beta, strict=False)])
    a_alone = np.append(alone[:, 0], a[-1]) if n > 1 else a
    return a, b, a_alone, alone[:, 1] if n > 1 else b


# Polynomials are of floats up to the order PLAIN, of Decimals above: the way from alpha and beta to
# a and b leads through a polynomial whose roots lie close together, and loses digits.
PLAIN = 5
DIGITS = 60


def _inner(alpha: Sequence[Any], beta: Sequence[Any]) -> list[Any]:
    """P_(n-1), by descending powers: the characteristic polynomial of all blocks but the last."""
    one = type(alpha[0])(1)
    inner, product = [one], one
    for a, b in zip(alpha[:-1], beta, strict=True):
        product = product * b
        shifted = [*inner, 0 * one, 0 * one]  # s (s + a) P + product
        inner = [c + a * d for c, d in zip(shifted, [0 * one, *shifted[:-1]], strict=True)]
        inner[-1] += product
    return inner


def _plain(
    alpha: tuple[float, ...], beta: tuple[float, ...], dt: float, method: str
) -> tuple[list[Any], list[Any]]:
    """prod (w - (z_i - 1)), by descending powers, and for each block -(z - 1) of its alpha_i."""
    polynomial = np.poly(steps(np.roots(_inner(alpha, beta)), dt, method)).real
    near = -steps(-np.array(alpha), dt, method).real
    return np.atleast_1d(polynomial).tolist(), near.tolist()


def _precise(
    alpha: tuple[float, ...], beta: tuple[float, ...], dt: float, method: str
) -> tuple[list[Any], list[Any]]:
    """The same in Decimals."""
    h, product = Decimal(dt), [(Decimal(1), Decimal(0))]
    for re, im in _precise_roots(alpha, beta):
        root = _image((re * h, im * h), method)
        pairs = zip([*product, ZERO], [ZERO, *product], strict=True)
        product = [_minus(c, _times(root, d)) for c, d in pairs]
    near = [-_image((-Decimal(a) * h, Decimal(0)), method)[0] for a in alpha]
    return [re for re, _ in product], near


Pair = tuple[Decimal, Decimal]  # a complex number
ZERO: Pair = (Decimal(0), Decimal(0))


def _minus(a: Pair, b: Pair) -> Pair:
    return a[0] - b[0], a[1] - b[1]


def _times(a: Pair, b: Pair) -> Pair:
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _over(a: Pair, b: Pair) -> Pair:
    square = b[0] * b[0] + b[1] * b[1]
    re, im = _times(a, (b[0], -b[1]))
    return re / square, im / square


@lru_cache(maxsize=64)
def _precise_roots(alpha: tuple[float, ...], beta: tuple[float, ...]) -> list[Pair]:
    """The roots of P_(n-1) by Aberth's iteration, from those that double precision finds."""
    inner = _inner([Decimal(a) for a in alpha], [Decimal(b) for b in beta])
    starts = np.roots([float(c) for c in inner])
    starts = starts * (1.0 + 1e-4 * np.exp(1j * np.arange(starts.size)))  # no two the same
    found = [(Decimal(z.real), Decimal(z.imag)) for z in starts.tolist()]
    for _ in range(200):
        largest = Decimal(0)
        for i, z in enumerate(found):
            value, slope = ZERO, ZERO
            for c in inner:
                re, im = _times(slope, z)
                slope = (re + value[0], im + value[1])
                re, im = _times(value, z)
                value = (re + c, im)
            if value == ZERO:
                continue
            step = _over(slope, value)
            for j, other in enumerate(found):
                if j != i:
                    step = _minus(step, _over((Decimal(1), Decimal(0)), _minus(z, other)))
            step = _over((Decimal(1), Decimal(0)), step)
            found[i] = _minus(z, step)
            largest = max(largest, max(map(abs, step)) / max(map(abs, z)))
        if largest < Decimal(10) ** (10 - DIGITS):
            break
    return found


def _image(z: Pair, method: str) -> Pair:
    """exp(z) - 1, 2 z / (2 - z), or z / (1 - z)."""
    if method == "implicit-map":
        return _over(z, (1 - z[0], -z[1]))
    if method == "bilinear":
        return _over((2 * z[0], 2 * z[1]), (2 - z[0], -z[1]))
    halvings = 0
    while max(map(abs, z)) > Decimal("0.25"):
        z, halvings = (z[0] / 2, z[1] / 2), halvings + 1
    series: Pair = (Decimal(1), Decimal(0))
    for i in range(40, 1, -1):
        re, im = _times(series, z)
        series = (1 + re / i, im / i)
    grown = _times(series, z)
    for _ in range(halvings):  # exp(2 z) - 1 = (exp(z) - 1) (2 + (exp(z) - 1))
        grown = _times(grown, (2 + grown[0], grown[1]))
    return grown


def _low_power_steps(p: list[Any], near: list[Any], dt: float) -> tuple[Array, Array]:
    """a and b from the polynomial of the eigenvalues in w, term by term from the last one on."""
    n, number = len(near), type(p[0])
    h, a, c = number(dt), list(near), [number(1)] * len(near)
    for k in range(n - 1, 0, -1):
        spread = [h**k / number(factorial(k)) * number(x) for x in _numerator(k).tolist()]
        c[k] = p[-1] / spread[-1]
        padded = [number(0)] * (len(p) - len(spread)) + spread
        left = [x - c[k] * y for x, y in zip(p, padded, strict=True)][:-1]
        root = _real_root_near(left, -near[k - 1], number(1))
        a[k - 1] = -root
        p = _divided(left, root)
    b = [float(c[k] / c[k - 1]) for k in range(1, n)]
    return np.array([float(x) for x in a]), np.array(b)


def _real_root_near(p: list[Any], start: Any, unit: Any) -> Any:
    """A real root of a polynomial of odd degree: the one to which Newton's method leads from
    ``start`` within 12 steps between 0 and 2 ``start``; where there is none, the leftmost one that
    a grid of ``unit``/4 shows, by bisection.
    """
    number = type(start)
    settled = number(4) * number(10) ** (-16 if number is float else 10 - DIGITS)
    s = start
    for _ in range(12):
        step = _newton(p, s)
        s -= step
        if abs(s - start) > abs(start):
            break
        if abs(step) <= abs(s) / 10**6:
            for _ in range(10):
                step = _newton(p, s)
                s -= step
                if abs(step) <= settled * abs(s):
                    break
            return s
    bound = 1 + max(abs(c) for c in p[1:])  # Cauchy's
    places = [-bound, *(unit * k / 4 for k in range(-64, 17)), bound]
    above = (k for k, place in enumerate(places) if k and _value(p, place) >= 0)
    right = next(above, len(places) - 1)
    low, high = places[right - 1], places[right]
    for _ in range(2200):
        middle = (low + high) / 2
        if not low < middle < high:
            break
        low, high = (middle, high) if _value(p, middle) < 0 else (low, middle)
    return (low + high) / 2


def _value(p: list[Any], s: Any) -> Any:
    value = 0 * s
    for c in p:
        value = value * s + c
    return value


def _newton(p: list[Any], s: Any) -> Any:
    """Newton's step."""
    degree = len(p) - 1
    return _value(p, s) / _value([c * (degree - i) for i, c in enumerate(p[:-1])], s)


def _divided(p: list[Any], root: Any) -> list[Any]:
    """p / (w - root), the remainder dropped."""
    quotient, carry = [], 0 * root
    for c in p[:-1]:
        carry = c + root * carry
        quotient.append(carry)
    return quotient


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


def decaying_gains(k: Array, dt: float) -> tuple[Array, float]:
    """G_i = sum_j k_j int_0^T exp(-k_1 s) (T - s)^(j-i)/(j-i)! ds, (n,), and exp(-k_1 T).

    By the exponential of the matrix of x' = A x + k c, c' = -k_1 c, from x = 0 and c = 1.
    """
    n = len(k)
    system = np.zeros((n + 1, n + 1))
    system[: n - 1, 1:n] = np.eye(n - 1)
    system[:n, n], system[n, n] = k, -k[0]
    scale = np.append(dt ** np.arange(n), 1.0)
    moved = _expm(scale[:, None] * system / scale * dt)[:, n]
    return np.asarray(moved[:n] / scale[:n]), float(moved[n])


def _expm(a: Array) -> Array:
    """exp(a): a series for a/2^s, squared s times."""
    halvings = max(0, int(np.ceil(np.log2(max(float(np.abs(a).sum(axis=0).max()), 1e-300)))) + 3)
    a = a / 2.0**halvings
    total, term = np.eye(len(a)), np.eye(len(a))
    for i in range(1, 20):
        term = term @ a / i
        total = total + term
    for _ in range(halvings):
        total = total @ total
    return total
