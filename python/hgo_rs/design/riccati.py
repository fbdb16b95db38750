"""Gains of the steady Kalman filter, as the gain and the poles of any law that takes n of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import DesignError, check, check_array

from . import _checks
from ._checks import Array


@dataclass(frozen=True, eq=False)
class SteadyGains:
    """The standard law whose gains are those of a Kalman filter that has come to rest.

    ``ell`` [1/s] and ``poles`` (n,), before scaling by ell: `StandardObserver(n, ell, poles=poles,
    model=...)`, of a sampled filter by method "zoh".  ``gains``: (n,), in units of x_i/(y s), of a
    sampled filter x_i/y.  ``covariance``: P (n, n) of the error; of a sampled filter after a
    sample.
    """

    ell: float
    poles: npt.NDArray[np.complex128]
    gains: Array
    covariance: Array


def riccati(
    n: int,
    *,
    Q: npt.ArrayLike,
    R: float,
    slopes: npt.ArrayLike | None = None,
    dt: float | None = None,
) -> SteadyGains:
    """Gains of the steady Kalman filter for a chain of order n.

    0 = J P + P J' + Q - P C' C P/R and K = P C'/R, J = A + slopes; with ``dt`` [s] the discrete
    equation of the chain sampled so, K = P C'/(C P C' + R).

    ``Q``: intensity of white noise in x', as of `HighGainEKF`; ``R``: intensity of white noise in
    y, with ``dt`` the variance of a sample.  ``slopes``: of what is known, df_hat/dx (n, n), or of
    phi alone (n,); default: none.

    Raises DesignError for noises that determine no gains, and for gains that no poles of the chain
    have, as with ``dt`` far beyond the filter's own time.
    """
    n, r = _checks.order(n), _checks.positive(R, "R")
    a = np.eye(n, k=1)
    q = _matrix(Q, "Q", n, last=True)
    j = a if slopes is None else a + _matrix(slopes, "slopes", n, row=True)
    step = None if dt is None else _checks.positive(dt, "dt")
    try:
        p, gains, decays = _steady(j, q, r, step)
    except np.linalg.LinAlgError:
        decays = False
    check(decays, "Q", Q, "such that the error decays", "give noise in x_n", DesignError)
    remedy = "choose HighGainEKF, which needs no poles"
    if step is not None:
        ell, poles = poles_of_gains(gains, step, remedy=f"give a smaller dt, or {remedy}")
        return SteadyGains(ell, poles, gains, p)
    z = np.linalg.eigvals(_error(a, gains, step)).astype(complex)
    allowed = "such that the gains are those of stable poles of the chain"
    check(bool(np.all(z.real < 0.0)), "slopes", slopes, allowed, remedy, DesignError)
    return SteadyGains(*_scaled(z), gains, p)


def poles_of_gains(
    gains: npt.ArrayLike, dt: float, *, remedy: str = "choose WindowObserver, which needs no poles"
) -> tuple[float, npt.NDArray[np.complex128]]:
    """The gain ell [1/s] and the poles (n,), before scaling by ell, whose law with method "zoh" and
    current timing corrects by K = `gains` (n,) [x_i/y] at the period ``dt`` [s].

    They are ln(z)/dt of the eigenvalues z of (I - K C) exp(A dt).

    Raises DesignError where an error does not decay, or an eigenvalue is 0 or negative, which no
    pole has.
    """
    k, step = np.atleast_1d(check_array(gains, "gains")), _checks.positive(dt, "dt")
    allowed, give = "n finite numbers", "give one gain for each state"
    check(k.ndim == 1 and bool(np.all(np.isfinite(k))), "gains", gains, allowed, give, DesignError)
    # in coordinates x_i dt^(i-1), so that all entries are of one size
    units = step ** np.arange(len(k))
    z = np.linalg.eigvals(_error(np.eye(len(k), k=1), k * units, 1.0)).astype(complex)
    allowed = "such that the error decays"
    give = "give smaller gains, with those of higher states smaller still"
    check(bool(np.all(np.abs(z) < 1.0)), "gains", gains, allowed, give, DesignError)
    placed = (np.abs(z.imag) > 1e-12) | (z.real > 1e-12)
    allowed = f"those of poles: of the eigenvalues {np.round(z, 6).tolist()} one is not above 0"
    check(bool(np.all(placed)), "gains", gains, allowed, remedy, DesignError)
    return _scaled(np.log(z) / step)


def _scaled(z: npt.NDArray[np.complex128]) -> tuple[float, npt.NDArray[np.complex128]]:
    """Poles as a gain and poles before scaling by it."""
    ell = float(np.exp(np.mean(np.log(np.abs(z)))))
    return ell, np.asarray(np.sort_complex(z) / ell, dtype=np.complex128)


def _error(j: Array, gains: Array, dt: float | None) -> Array:
    """The matrix of the error under these gains: of its rate, or with `dt` of its step."""
    from scipy.linalg import expm

    if dt is None:
        return np.asarray(j - gains[:, None] * np.eye(len(j))[0])
    return np.asarray((np.eye(len(j)) - gains[:, None] * np.eye(len(j))[0]) @ expm(j * dt))


def _steady(j: Array, q: Array, r: float, dt: float | None) -> tuple[Array, Array, bool]:
    """P (with `dt` after a sample), the gains, and whether the error decays."""
    from scipy.linalg import expm, solve_continuous_are, solve_discrete_are

    n = len(j)
    c = np.eye(n)[:, :1]
    if dt is None:
        p = solve_continuous_are(j.T, c, q, [[r]])
        gains = p[:, 0] / r
        decays = bool(np.all(np.linalg.eigvals(_error(j, gains, dt)).real < 0.0))
        return p, gains, decays
    # the exponential of [[-J, Q], [0, J']] dt holds Phi^-1 Q_d and Phi' (Van Loan)
    both = expm(np.block([[-j, q], [np.zeros((n, n)), j.T]]) * dt)
    phi = both[n:, n:].T
    p = solve_discrete_are(phi.T, c, phi @ both[:n, n:], [[r]])
    gains = p[:, 0] / (p[0, 0] + r)
    decays = bool(np.all(np.abs(np.linalg.eigvals(_error(j, gains, dt))) < 1.0))
    return p - np.outer(gains, p[0]), gains, decays


def _matrix(
    given: npt.ArrayLike, name: str, n: int, *, last: bool = False, row: bool = False
) -> Array:
    """(n, n): itself; a diagonal, or its last entry; or a last row."""
    values = check_array(given, name)
    made = np.zeros((n, n))
    if values.shape == (n, n):
        return np.asarray(values, dtype=float)
    if last and values.ndim == 0:
        made[-1, -1] = values
    else:
        allowed, remedy = f"of shape ({n},) or ({n}, {n})", "give one of these"
        check(values.shape == (n,), f"shape of {name}", values.shape, allowed, remedy, DesignError)
        made[(np.full(n, n - 1), np.arange(n)) if row else np.diag_indices(n)] = values
    return made
