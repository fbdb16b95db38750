"""Coefficients of the observers from poles, and back: checked faces of ``reference.polynomial``.

Polynomials are arrays of all coefficients, highest power first (as in ``numpy.polyval``).  Poles
are those of the observer at ell = 1 [1/s]; the gain multiplies them by ell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hgo_rs.errors import DesignError, check, check_integer, explain
from hgo_rs.reference import polynomial as maths

from . import _checks
from ._checks import Array, ComplexArray

Poles = Sequence[complex] | ArrayLike

_MOST_POLES = 2 * _checks.MAX_ORDER - 1


# --- standard observer ------------------------------------------------------------------------


def observer_coefficients(poles: Poles) -> Array:
    """k_1 ... k_n of the standard observer: s^n + k_1 s^(n-1) + ... + k_n = prod(s - pole_i).

    ``poles``: n = 1 ... 12 numbers with Re < 0; complex ones with their conjugates.
    Source: Astolfi et al., eq. (2); Lee et al., eq. (17); Sanfelice, Praly, eq. (9).
    """
    return maths.coefficients_from_poles(_poles(poles, 1, _checks.MAX_ORDER))


def companion(k: ArrayLike) -> Array:
    """A - K C of the standard observer, shape (n, n): ones above the diagonal, -k in column 1."""
    k = _checks.vector(k, "k")
    matrix = np.diag(np.ones(k.size - 1), 1)
    matrix[:, 0] -= k
    return matrix


def routh_hurwitz(polynomial: ArrayLike) -> bool:
    """Whether all roots of ``polynomial`` lie in Re < 0, without computing them.

    ``polynomial``: highest power first, leading coefficient not 0.
    """
    return maths.is_hurwitz(_monic(polynomial)[1:])


def _monic(polynomial: ArrayLike) -> Array:
    p = _checks.vector(polynomial, "polynomial")
    remedy = "drop leading zeros"
    _checks.demand(p[0] != 0.0, "leading coefficient of polynomial", float(p[0]), "not 0", remedy)
    return p / p[0]


def _poles(poles: Poles, least: int, most: int) -> ComplexArray:
    """The poles, checked; conjugates within 1e-9 of one another become exact ones."""
    try:
        given = np.atleast_1d(np.asarray(poles, dtype=np.complex128))
    except (TypeError, ValueError):
        raise DesignError(
            explain("poles", poles, "numbers with negative real parts", "give numbers")
        ) from None
    check(
        given.ndim == 1 and least <= given.size <= most,
        "number of poles",
        given.size if given.ndim == 1 else f"array of shape {given.shape}",
        f"{least} to {most}",
        "choose another order",
        DesignError,
    )
    for i, pole in enumerate(given):
        holds = np.isfinite(pole) and pole.real < 0.0
        allowed = "finite with a negative real part"
        remedy = "move it into the open left half plane"
        _checks.demand(holds, f"poles[{i}]", complex(pole), allowed, remedy)
    paired = [complex(pole) for pole in given[given.imag == 0.0]]
    upper = [complex(pole) for pole in given[given.imag > 0.0]]
    lower = [complex(pole) for pole in given[given.imag < 0.0]]
    while upper and lower:
        pole = upper.pop()
        other = min(lower, key=lambda z: abs(z - pole.conjugate()))
        if abs(other - pole.conjugate()) > 1e-9 * abs(pole):
            lower = [pole]  # the one to report
            break
        lower.remove(other)
        paired += [pole, pole.conjugate()]
    alone = [*upper, *lower]
    allowed, remedy = "closed under conjugation", f"add {alone[0].conjugate()}" if alone else ""
    _checks.demand(not alone, "poles", alone[0] if alone else None, allowed, remedy)
    return np.array(paired, dtype=np.complex128)


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
    poles: Poles | None = None, *, polynomial: ArrayLike | None = None
) -> LowPowerCoefficients:
    """The alpha, beta that give M_n the 2n-1 ``poles``, or the characteristic ``polynomial``.

    Any Hurwitz polynomial of degree 2n-1, n = 2 ... 12.  Any real root may become -alpha_n, and
    each gives another set: with ``poles`` it is the fastest, with ``polynomial`` the one that
    bisection meets.  The paper's alpha = 3, 3, 3, 3, 2 belong to eight poles equidistant in
    [-2, -1] and one more at -2.  Source: Astolfi et al., Lemma 1.
    """
    holds = (poles is None) != (polynomial is None)
    remedy = "give either the poles or the characteristic polynomial"
    _checks.demand(holds, "poles, polynomial", (poles, polynomial), "one of the two", remedy)
    if poles is not None:
        given = _poles(poles, 3, _MOST_POLES)
        size, name = given.size, "number of poles"
    else:
        p = _monic(polynomial)  # type: ignore[arg-type]
        size, name = p.size - 1, "degree of polynomial"
    allowed, remedy = f"odd (2n - 1), 3 to {_MOST_POLES}", "add or drop a real pole"
    _checks.demand(size % 2 == 1 and 3 <= size <= _MOST_POLES, name, size, allowed, remedy)
    with np.errstate(all="ignore"):  # judged by the result
        if poles is not None:
            wanted = maths.coefficients_from_poles(given)
            alpha, beta = maths.low_power_coefficients_from_poles(given)
        else:
            allowed = "Hurwitz (all roots in Re < 0)"
            remedy = "move the roots into the open left half plane"
            _checks.demand(maths.is_hurwitz(p[1:]), "polynomial", p.tolist(), allowed, remedy)
            wanted = p[1:]
            alpha, beta = maths.low_power_coefficients(wanted)
        found = maths.low_power_polynomial(alpha, beta)
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


_LEVANT = (1.1, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 12.0)


def levant_coefficients(n: int) -> Array:
    """k of Levant's differentiator of order n = 2 ... 8, (n,): with `HomogeneousGain.levant(L, n)`.

    kappa_(n-1) = lambda_(n-1), kappa_j = lambda_j kappa_(j+1)^(j/(j+1)), k_i = kappa_(n-i), with
    lambda = 1.1, 1.5, 2, 3, 5, 7, 10, 12.  Levant and Livne, European J. Control 55 (2020).
    """
    n = check_integer(n, "n", least=2, most=len(_LEVANT), error=DesignError)
    k = [_LEVANT[n - 1]]
    for j in range(n - 2, -1, -1):
        k.append(_LEVANT[j] * k[-1] ** (j / (j + 1)))
    return np.asarray(k)


def low_power_polynomial(alpha: ArrayLike, beta: ArrayLike) -> Array:
    """det(s I - M_n), shape (2n,), highest power first, by the recursion (no eigenvalues)."""
    return np.concatenate(([1.0], maths.low_power_polynomial(*_alpha_beta(alpha, beta))))


def low_power_matrix(alpha: ArrayLike, beta: ArrayLike) -> Array:
    """M_n, shape (2n-1, 2n-1): Astolfi et al., section 3.1.

    Coordinates (x_1, eta_1, x_2, eta_2, ..., x_n) of the error, scaled as in eq. (21); time in
    units of 1/ell.
    """
    return maths.low_power_matrix(*_alpha_beta(alpha, beta))


def _alpha_beta(alpha: ArrayLike, beta: ArrayLike) -> tuple[Array, Array]:
    alpha = _checks.vector(alpha, "alpha")
    _checks.order(alpha.size, "number of alpha", least=2)
    return alpha, _checks.vector(beta, "beta", alpha.size - 1)
