"""Coefficients of the observers from poles, and back.

Polynomials are arrays of coefficients, highest power first (as in ``numpy.polyval``).  Poles are
those of the observer at ell = 1 [1/s]; the gain multiplies them by ell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hgo_rs.errors import DesignError, check, explain

from . import _checks
from ._checks import Array, ComplexArray

__all__ = [
    "LowPowerCoefficients",
    "RouthHurwitz",
    "companion",
    "low_power_coefficients",
    "low_power_matrix",
    "low_power_polynomial",
    "observer_coefficients",
    "routh_hurwitz",
]


# --- standard observer ------------------------------------------------------------------------


def observer_coefficients(poles: Sequence[complex] | ArrayLike) -> Array:
    """k_1 ... k_n of the standard observer: s^n + k_1 s^(n-1) + ... + k_n = prod(s - pole_i).

    ``poles``: n = 1 ... 12 numbers with Re < 0; complex ones with their conjugates.
    Source: Astolfi et al., eq. (2); Lee et al., eq. (17); Sanfelice, Praly, eq. (9).
    """
    real, upper = _conjugate_pairs(poles, "poles", 1, _checks.MAX_ORDER)
    return _product(real, upper)[1:]


def companion(k: ArrayLike) -> Array:
    """A - K C of the standard observer, shape (n, n): ones above the diagonal, -k in column 1."""
    k = _checks.vector(k, "k")
    matrix = np.diag(np.ones(k.size - 1), 1)
    matrix[:, 0] -= k
    return matrix


def _conjugate_pairs(
    poles: Sequence[complex] | ArrayLike, parameter: str, least: int, most: int
) -> tuple[Array, ComplexArray]:
    """Real poles, and of each conjugate pair the one with Im > 0."""
    try:
        given = np.atleast_1d(np.asarray(poles, dtype=np.complex128))
    except (TypeError, ValueError):
        raise DesignError(
            explain(parameter, poles, "numbers with negative real parts", "give numbers")
        ) from None
    check(
        given.ndim == 1 and least <= given.size <= most,
        f"number of {parameter}",
        given.size if given.ndim == 1 else f"array of shape {given.shape}",
        f"{least} to {most}",
        "choose another order",
        DesignError,
    )
    for pole in given:
        check(
            np.isfinite(pole) and pole.real < 0.0,
            f"a pole of {parameter}",
            complex(pole),
            "finite with a negative real part",
            "move it into the open left half plane",
            DesignError,
        )
    real = given[given.imag == 0.0].real
    lower = list(given[given.imag < 0.0])
    upper = []
    for pole in given[given.imag > 0.0]:
        distance = [abs(other - pole.conjugate()) for other in lower]
        nearest = int(np.argmin(distance)) if lower else -1
        if nearest < 0 or distance[nearest] > 1e-9 * abs(pole):
            lower.append(pole)  # reported below
            break
        upper.append(0.5 * (pole + lower.pop(nearest).conjugate()))
    check(
        not lower,
        f"a pole of {parameter}",
        complex(lower[0]) if lower else None,
        "real, or given with its complex conjugate",
        f"add {lower[0].conjugate():g}" if lower else "",
        DesignError,
    )
    return real, np.array(upper, dtype=np.complex128)


def _product(real: Array, upper: ComplexArray) -> Array:
    """The real monic polynomial with these roots (and the conjugates of ``upper``)."""
    coefficients = np.ones(1)
    for pole in real:
        coefficients = np.convolve(coefficients, [1.0, -pole])
    for pole in upper:
        coefficients = np.convolve(coefficients, [1.0, -2.0 * pole.real, abs(pole) ** 2])
    return coefficients


# --- Routh-Hurwitz ----------------------------------------------------------------------------


@dataclass(frozen=True)
class RouthHurwitz:
    """``hurwitz``: all roots have Re < 0.  ``first_column``: Routh's, up to its first entry <= 0."""

    hurwitz: bool
    first_column: Array

    def __bool__(self) -> bool:
        return self.hurwitz


def routh_hurwitz(polynomial: ArrayLike) -> RouthHurwitz:
    """Whether all roots of ``polynomial`` lie in Re < 0, without computing them.

    ``polynomial``: highest power first, leading coefficient not 0.
    """
    p = _checks.vector(polynomial, "polynomial")
    check(
        p[0] != 0.0,
        "leading coefficient of polynomial",
        float(p[0]),
        "not 0",
        "drop leading zeros",
        DesignError,
    )
    p = p / p[0]
    width = (p.size + 1) // 2
    above, row = np.zeros(width), np.zeros(width)
    above[:width], row[: p.size // 2] = p[0::2], p[1::2]
    column = [1.0]
    for _ in range(p.size - 1):
        column.append(float(row[0]))
        if row[0] <= 0.0:
            return RouthHurwitz(False, np.array(column))
        above, row = row, np.append(above[1:] - above[0] / row[0] * row[1:], 0.0)
    return RouthHurwitz(True, np.array(column))


# --- low-power observer -----------------------------------------------------------------------


@dataclass(frozen=True)
class LowPowerCoefficients:
    """``alpha`` (n,) and ``beta`` (n-1,) of Astolfi et al., eq. (5)."""

    alpha: Array
    beta: Array

    @property
    def n(self) -> int:
        """Order of the observed system."""
        return self.alpha.size


def low_power_coefficients(
    poles: Sequence[complex] | ArrayLike | None = None,
    *,
    polynomial: ArrayLike | None = None,
) -> LowPowerCoefficients:
    """The alpha, beta that give M_n the 2n-1 ``poles``, or the characteristic ``polynomial``.

    Any Hurwitz polynomial of degree 2n-1, n = 2 ... 12.  Source: Astolfi et al., Lemma 1.  From

        P_0 = 1,  P_i = s (s + alpha_i) P_{i-1} + beta_1 ... beta_i,
        det(s I - M_n) = (s + alpha_n) P_{n-1},

    read backwards.  With poles alpha_n is minus the leftmost real one, and the remaining 2n-2
    are multiplied out exactly; a real root of ``polynomial`` must be found instead, and if it is a
    multiple one it is found to half of the digits only.  The paper's alpha = 3, 3, 3, 3, 2 are the
    eight poles equidistant in [-2, -1] and one more at -2.
    """
    check(
        (poles is None) != (polynomial is None),
        "poles, polynomial",
        (poles, polynomial),
        "one of the two",
        "give either the poles or the characteristic polynomial",
        DesignError,
    )
    most = 2 * _checks.MAX_ORDER - 1
    if poles is not None:
        real, upper = _conjugate_pairs(poles, "poles", 3, most)
        check(
            (real.size % 2) == 1,
            "number of poles",
            real.size + 2 * upper.size,
            f"odd (2n - 1), 3 to {most}",
            "add or drop a real pole",
            DesignError,
        )
        leftmost = int(np.argmin(real))
        alpha_n = -float(real[leftmost])
        inner = _product(np.delete(real, leftmost), upper)  # P_{n-1}
    else:
        given = _checks.vector(polynomial, "polynomial")  # type: ignore[arg-type]
        degree = given.size - 1
        check(
            degree % 2 == 1 and 3 <= degree <= most,
            "degree of polynomial",
            degree,
            f"odd (2n - 1), 3 to {most}",
            "give 2n coefficients, highest power first",
            DesignError,
        )
        check(
            routh_hurwitz(given),
            "polynomial",
            given.tolist(),
            "Hurwitz (all roots in Re < 0)",
            "move the roots into the open left half plane",
            DesignError,
        )
        given = given / given[0]
        root = _leftmost_real_root(given)
        alpha_n = -root
        inner = _deflate(given, root)

    wanted = np.convolve(inner, [1.0, alpha_n])
    n = (inner.size + 1) // 2
    alpha = np.empty(n)
    alpha[n - 1] = alpha_n
    c = np.ones(n)  # c_k = beta_1 ... beta_k
    for k in range(n - 1, 0, -1):
        c[k] = inner[-1]  # c_k = P_k(0)
        quotient = inner[:-1]  # (P_k - c_k)/s: odd degree, so it has a real root
        root = _leftmost_real_root(quotient)
        alpha[k - 1] = -root
        inner = _deflate(quotient, root)  # P_{k-1}
    with np.errstate(all="ignore"):
        beta = c[1:] / c[:-1]
        found = low_power_polynomial(alpha, beta) if np.all(np.isfinite(beta)) else np.nan * wanted
        mismatch = float(np.max(np.abs(found / wanted - 1.0)))
    check(
        mismatch < 1e-7,
        "relative error of the characteristic coefficients",
        mismatch,
        "< 1e-7",
        "these poles have no realisation in double precision: spread them less widely",
        DesignError,
    )
    return LowPowerCoefficients(alpha, beta)


def low_power_polynomial(alpha: ArrayLike, beta: ArrayLike) -> Array:
    """det(s I - M_n), shape (2n,), highest power first, by the recursion (no eigenvalues)."""
    alpha, beta = _low_power(alpha, beta)
    p = np.ones(1)
    c = 1.0
    for a, b in zip(alpha[:-1], beta, strict=True):
        p = np.convolve(p, [1.0, a, 0.0])  # s (s + alpha_i) P_{i-1}
        c *= b
        p[-1] = c  # + beta_1 ... beta_i
    return np.convolve(p, [1.0, alpha[-1]])


def low_power_matrix(alpha: ArrayLike, beta: ArrayLike) -> Array:
    """M_n, shape (2n-1, 2n-1): Astolfi et al., section 3.1.

    Coordinates (x_1, eta_1, x_2, eta_2, ..., x_n) of the error scaled as in eq. (21), time in 1/ell.
    """
    alpha, beta = _low_power(alpha, beta)
    n = alpha.size
    m = np.zeros((2 * n - 1, 2 * n - 1))
    for i in range(n - 1):
        x, eta = 2 * i, 2 * i + 1
        m[x, x], m[x, eta] = -alpha[i], 1.0  # E_i = A_2 - K_i C_2
        m[eta, x] = -beta[i]
        if i > 0:
            m[x, x - 1], m[eta, x - 1] = alpha[i], beta[i]  # K_i B^T: e_i = eta_{i-1} - x_i
        if i < n - 2:
            m[eta, eta + 2] = 1.0  # B B_2^T: eta_i' = eta_{i+1} + ...
    m[-1, -1] = -alpha[-1]
    m[-1, -2] = alpha[-1]
    return m


def _low_power(alpha: ArrayLike, beta: ArrayLike) -> tuple[Array, Array]:
    alpha = _checks.vector(alpha, "alpha")
    _checks.order(alpha.size, "number of alpha", least=2)
    return alpha, _checks.vector(beta, "beta", alpha.size - 1)


def _leftmost_real_root(p: Array) -> float:
    """The leftmost real root of a polynomial of odd degree, polished by Newton's method."""
    roots = np.roots(p)  # eigenvalues of a real matrix: the pairs are exact conjugates
    root = float(np.min(roots[roots.imag == 0.0].real))
    slope = np.polyder(p)
    residual = abs(np.polyval(p, root))
    for _ in range(3):
        with np.errstate(divide="ignore", invalid="ignore"):
            trial = root - np.polyval(p, root) / np.polyval(slope, root)
        if not abs(np.polyval(p, trial)) < residual:  # a multiple root, or converged
            break
        root, residual = float(trial), abs(np.polyval(p, trial))
    return root


def _deflate(p: Array, root: float) -> Array:
    """p/(s - root).

    Synthetic division from both ends, joined at the coefficient whose term is largest at the root:
    there neither direction amplifies the rounding errors.  One direction alone loses all digits
    for poles spread over two decades.
    """
    degree = p.size - 1
    join = int(np.argmax(np.abs(p) * abs(root) ** np.arange(degree, -1, -1)))
    q = np.empty(degree)
    carry = 0.0
    for i in range(join):  # q_i = p_i + root q_{i-1}
        carry = p[i] + root * carry
        q[i] = carry
    carry = 0.0
    for i in range(degree - 1, join - 1, -1):  # q_i = (q_{i+1} - p_{i+1})/root
        carry = (carry - p[i + 1]) / root
        q[i] = carry
    return q
