"""Polynomials: coefficients of the observers from poles, and back.

A monic polynomial s^m + c_1 s^(m-1) + ... + c_m is the array [c_1, ..., c_m] of its trailing
coefficients.  Inside, a polynomial is an array by ascending powers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .error import Array, fail

MAX_DEGREE = 23  # 2 n - 1 for the low-power law of order n = 12


def _poles(poles: ArrayLike) -> list[complex]:
    given = [complex(pole) for pole in np.asarray(poles, dtype=np.complex128).reshape(-1)]
    for i, pole in enumerate(given):
        if not (np.isfinite(pole) and pole.real < 0.0):
            raise fail(f"poles[{i}]", pole, "finite, with negative real part", "move it left")
        if given.count(pole) != given.count(pole.conjugate()):
            raise fail(
                f"poles[{i}]", pole, "paired with its complex conjugate", "add the conjugate"
            )
    if not 1 <= len(given) <= MAX_DEGREE:
        raise fail("poles", len(given), f"1 to {MAX_DEGREE} poles", "change the order")
    return given


def coefficients_from_poles(poles: ArrayLike) -> Array:
    """[k_1, ..., k_n] of prod (s - pole): the injection coefficients of the standard observer.

    Lee et al., eq. (17); Astolfi et al., the matrix A_n - K C_n.  ValueError for a pole that is
    not finite, not in the open left half plane, or without its complex conjugate.
    """
    product = [1.0 + 0.0j]  # descending powers
    for pole in _poles(poles):
        shifted = [*product, 0.0j]
        for i, c in enumerate(product):
            shifted[i + 1] -= pole * c
        product = shifted
    return np.array([c.real for c in product[1:]])


def is_hurwitz(coefficients: ArrayLike) -> bool:
    """Routh-Hurwitz: whether all roots of s^m + c_1 s^(m-1) + ... + c_m lie in Re s < 0."""
    c = np.concatenate(([1.0], np.asarray(coefficients, dtype=np.float64).reshape(-1)))
    degree = len(c) - 1
    if not np.all(np.isfinite(c)):
        return False
    upper, lower = np.zeros(degree + 2), np.zeros(degree + 2)
    upper[: len(c[0::2])] = c[0::2]
    lower[: len(c[1::2])] = c[1::2]
    for _ in range(degree):
        if not (lower[0] > 0.0 and np.isfinite(lower[0])):
            return False
        following = np.zeros(degree + 2)
        following[:-1] = upper[1:] - upper[0] / lower[0] * lower[1:]
        upper, lower = lower, following
    return True


def low_power_matrix(alpha: ArrayLike, beta: ArrayLike) -> Array:
    """M_n of the low-power observer, (2n-1, 2n-1): Astolfi et al., before Definition 1."""
    a, b = _alpha_beta(alpha, beta)
    n = len(a)
    m = np.zeros((2 * n - 1, 2 * n - 1))
    for i in range(n):  # block i: rows 2i (x_hat_i) and 2i+1 (eta_i)
        row = 2 * i
        m[row, row] = -a[i]
        if i > 0:
            m[row, row - 1] = a[i]  # K_i B'
        if i < n - 1:
            m[row, row + 1] = 1.0  # E_i = A_2 - K_i C_2
            m[row + 1, row] = -b[i]
            if i > 0:
                m[row + 1, row - 1] = b[i]
            if i < n - 2:
                m[row + 1, row + 3] = 1.0  # B B_2': eta_i' contains eta_{i+1}
    return m


def low_power_polynomial(alpha: ArrayLike, beta: ArrayLike) -> Array:
    """Trailing coefficients of char(M_n), (2n-1,), from alpha (n,) and beta (n-1,).

    P_0 = 1, P_i = s (s + alpha_i) P_{i-1} + beta_1 ... beta_i, char(M_n) = (s + alpha_n) P_{n-1}.
    """
    a, b = _alpha_beta(alpha, beta)
    p = np.array([1.0])
    product = 1.0
    for a_i, b_i in zip(a[:-1], b, strict=True):
        product *= b_i
        p = np.concatenate(([product], _times_linear(p, a_i)))
    whole = _times_linear(p, a[-1])
    return np.ascontiguousarray(whole[-2::-1])


def low_power_coefficients(coefficients: ArrayLike) -> tuple[Array, Array]:
    """(alpha (n,), beta (n-1,)) that give M_n the Hurwitz polynomial of degree 2n - 1.

    Astolfi et al., Lemma 1, by inversion of the recursion of ``low_power_polynomial``: alpha_n is
    minus a real root.  ValueError for a degree that is even or above 23, or no Hurwitz polynomial.
    """
    c = np.asarray(coefficients, dtype=np.float64).reshape(-1)
    if len(c) % 2 == 0 or len(c) > MAX_DEGREE:
        raise fail(
            "coefficients", c.tolist(), "of odd number 2n - 1, n = 1 to 12", "change the degree"
        )
    if not is_hurwitz(c):
        raise fail("coefficients", c.tolist(), "those of a Hurwitz polynomial", "move the poles")
    p = np.concatenate((c[::-1], [1.0]))
    alpha_n = -_real_root(p)
    return _invert(_without_linear(p, alpha_n), alpha_n)


def low_power_coefficients_from_poles(poles: ArrayLike) -> tuple[Array, Array]:
    """(alpha, beta) from 2n - 1 poles; the fastest real pole becomes -alpha_n.

    The paper's set comes from 8 poles equidistant in [-2, -1] and one more at -2.
    """
    given = _poles(poles)
    if len(given) % 2 == 0:
        raise fail("poles", len(given), "2n - 1 poles, n = 1 to 12", "add or remove one")
    fastest = min(pole.real for pole in given if pole.imag == 0.0)  # an odd number has a real one
    p = np.concatenate((coefficients_from_poles(given)[::-1], [1.0]))
    return _invert(_without_linear(p, -fastest), -fastest)


def _invert(p: Array, alpha_n: float) -> tuple[Array, Array]:
    """The inverse recursion from P_{n-1}, by ascending powers, of degree 2(n-1).

    For k = n-1 ... 1: c_k = P(0); (P - c_k)/s has odd degree, so a real root -alpha_k; P becomes
    (P - c_k)/(s (s + alpha_k)); beta_k = c_k / c_{k-1}, c_0 = 1.
    """
    n = (len(p) - 1) // 2 + 1
    alpha, c = np.empty(n), np.ones(n)
    alpha[n - 1] = alpha_n
    for k in range(n - 1, 0, -1):
        c[k] = p[0]
        odd = p[1:]  # (P - c_k) / s
        alpha[k - 1] = -_real_root(odd)
        p = _without_linear(odd, alpha[k - 1])
    return alpha, c[1:] / c[:-1]


def _times_linear(p: Array, a: float) -> Array:
    """(s + a) p."""
    product = np.concatenate(([0.0], p))
    product[:-1] += a * p
    return product


def _without_linear(p: Array, a: float) -> Array:
    """p / (s + a) where -a is a root: both ways of division, joined at the largest term of p(-a).

    Division from the top leaves the root's rounding error to the constant term, division from
    the bottom to the leading one.  Joined (Peters, Wilkinson 1971), it falls where it is small.
    """
    degree = len(p) - 1
    joint = int(np.argmax(np.abs(p) * a ** np.arange(degree + 1.0)))
    quotient = np.empty(degree)
    carry = 0.0
    for i in range(degree - 1, joint - 1, -1):
        carry = p[i + 1] - a * carry
        quotient[i] = carry
    carry = 0.0
    for i in range(joint):
        carry = (p[i] - carry) / a
        quotient[i] = carry
    return quotient


def _value(p: Array, s: float) -> float:
    value = 0.0
    for c in p[::-1]:
        value = value * s + float(c)
    return value


def _real_root(p: Array) -> float:
    """A real root of a polynomial of odd degree with leading coefficient 1, by bisection.

    Bisection needs a sign only, so it stands clusters of roots that defeat companion matrices.
    """
    high = max(1.0, 1.0 + float(np.abs(p[:-1]).max()))  # Cauchy's bound
    low = -high
    while True:
        middle = 0.5 * (low + high)
        if not low < middle < high:
            return middle
        if _value(p, middle) < 0.0:
            low = middle
        else:
            high = middle


def _alpha_beta(alpha: ArrayLike, beta: ArrayLike) -> tuple[Array, Array]:
    a = np.asarray(alpha, dtype=np.float64).reshape(-1)
    b = np.asarray(beta, dtype=np.float64).reshape(-1)
    if not 1 <= len(a) <= 12:
        raise fail("alpha", a.tolist(), "of 1 to 12 entries", "change the order")
    if len(b) != len(a) - 1:
        raise fail("beta", b.tolist(), f"of {len(a) - 1} entries", "alpha has one entry more")
    return a, b
