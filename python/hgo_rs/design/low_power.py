"""The low-power observer's stability requirements, as computed certificates, and a design by gains.

Astolfi, Marconi, Praly, Teel, "Low-power peaking-free high-gain observers", sections 3.3 and 3.4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _checks
from ._checks import Array
from .coefficients import LowPowerCoefficients, low_power_matrix

# --- peaks of frequency responses -------------------------------------------------------------


def h_infinity_norm(a: ArrayLike, b: ArrayLike, c: ArrayLike) -> float:
    """sup over omega of |C (j omega I - A)^-1 B|, for a Hurwitz ``a`` and one input and output.

    ``a``: (n, n); ``b``, ``c``: (n,).  Relative error 1e-10.  The response crosses a level gamma
    exactly where the Hamiltonian [[A, B B^T/gamma], [-C^T C/gamma, -A^T]] has eigenvalues j omega.
    """
    a, b, c = _system(a, b, c)

    def levels(gamma: float) -> Array:
        upper, lower = np.outer(b, b) / gamma, -np.outer(c, c) / gamma
        return _imaginary(np.block([[a, upper], [lower, -a.T]]))

    return _peak(a, lambda omega: np.abs(_response(a, b, c, omega)), levels)


def largest_real_part(a: ArrayLike, b: ArrayLike, c: ArrayLike) -> float:
    """sup over omega of Re C (j omega I - A)^-1 B, for a Hurwitz ``a``.  Arguments as above.

    Below 1: A + s(t) B C is quadratically stable for all s(t) in [0, 1] (circle criterion), and
    only then.  Never negative, as the response vanishes at high frequencies.
    """
    a, b, c = _system(a, b, c)

    def levels(gamma: float) -> Array:  # zeros of 2 gamma - L(s) - L(-s)
        f = a + np.outer(b, c) / (2.0 * gamma)
        upper, lower = np.outer(b, b) / (2.0 * gamma), -np.outer(c, c) / (2.0 * gamma)
        return _imaginary(np.block([[f, upper], [lower, -f.T]]))

    return _peak(a, lambda omega: np.maximum(_response(a, b, c, omega).real, 0.0), levels)


def _system(a: ArrayLike, b: ArrayLike, c: ArrayLike) -> tuple[Array, Array, Array]:
    a = _checks.hurwitz(a, "A")
    return a, _checks.vector(b, "B", a.shape[0]), _checks.vector(c, "C", a.shape[0])


def _response(a: Array, b: Array, c: Array, omega: Array) -> NDArray[np.complex128]:
    """C (j omega I - A)^-1 B at every omega."""
    resolvents = 1j * omega[:, None, None] * np.eye(a.shape[0]) - a
    return np.linalg.solve(resolvents, b[:, None])[..., 0] @ c


def _imaginary(hamiltonian: Array) -> Array:
    """The frequencies omega >= 0 of the eigenvalues next to the imaginary axis."""
    values = np.linalg.eigvals(hamiltonian)
    near = np.abs(values.real) <= 1e-5 * np.max(np.abs(values))
    return np.unique(np.abs(values.imag[near]))


def _peak(a: Array, value: Callable[[Array], Array], levels: Callable[[float], Array]) -> float:
    """The largest ``value`` over omega >= 0 (Bruinsma, Steinbuch, 1990).

    Between two frequencies at which ``value`` crosses a level it is above that level somewhere: the
    search climbs from the midpoints, and ends where no crossing is left.
    """
    modes = np.abs(np.linalg.eigvals(a))
    edges = np.concatenate([[0.0], np.geomspace(0.1 * modes.min(), 10.0 * modes.max(), 65)])
    best = 0.0
    for _ in range(20):
        grid = value(edges)
        j = int(np.argmax(grid))
        peak = _climb(value, float(edges[max(j - 1, 0)]), float(edges[min(j + 1, edges.size - 1)]))
        peak = max(peak, float(grid[j]))
        if peak <= best * (1.0 + 1e-10):
            return best
        best = peak
        crossings = levels(best * (1.0 + 1e-10))
        if crossings.size == 0:
            return best
        edges = np.unique(np.concatenate([crossings, 0.5 * (crossings[1:] + crossings[:-1])]))
    return best


def _climb(value: Callable[[Array], Array], low: float, high: float) -> float:
    """The largest ``value`` between ``low`` and ``high``, where it has one maximum."""
    best = 0.0
    for _ in range(9):
        grid = np.linspace(low, high, 9)
        values = value(grid)
        j = int(np.argmax(values))
        best = max(best, float(values[j]))
        low, high = float(grid[max(j - 1, 0)]), float(grid[min(j + 1, 8)])
    return best


# --- strong stability -------------------------------------------------------------------------


@dataclass(frozen=True)
class LowPowerStability:
    """Definitions 1 and 2 for given alpha, beta.  Arrays have one entry for i = 2, ..., n-1.

    ``hurwitz``: M_n is (Definition 1).  ``positive``: all alpha, beta are.
    ``gamma``: the gains gamma_{i-1} of system (17).
    ``small_gain``: gamma_{i-1} beta_i/alpha_i, < 1 is sufficient (Lemma 2).
    ``circle``: sup over omega of Re L_i(j omega), < 1 is sufficient and necessary.
    """

    hurwitz: bool
    positive: bool
    gamma: Array
    small_gain: Array
    circle: Array

    @property
    def small_gain_holds(self) -> bool:
        """Lemma 2 proves strong stability."""
        return self.hurwitz and self.positive and bool(np.all(self.small_gain < 1.0))

    @property
    def strong(self) -> bool:
        """Definition 2 holds: what the peaking-free observer (11) asks for."""
        return self.hurwitz and self.positive and bool(np.all(self.circle < 1.0))


def low_power_strong_stability(alpha: ArrayLike, beta: ArrayLike) -> LowPowerStability:
    """The stability requirements of Definitions 1 and 2, computed.

    (12) is Lambda_i(s) = Lambda_i(0) + s B C: block i - 1's last row fed by block i's last state.
    With L_i(j omega) = C (j omega I - Lambda_i(0))^-1 B, one P_i of (13) for all s in [0, 1] exists
    exactly if Re L_i < 1 (circle criterion; Lambda_i(0) must be Hurwitz).  Lemma 2 bounds |L_i| by
    gamma_{i-1} beta_i/alpha_i; the printed design step "beta_i/alpha_i >= 1/gamma_{i-1}" is
    inverted.
    """
    m = low_power_matrix(alpha, beta)
    alpha, beta = _checks.vector(alpha, "alpha"), _checks.vector(beta, "beta")
    n = alpha.size
    positive = bool(np.all(alpha > 0.0) and np.all(beta > 0.0))
    hurwitz = bool(np.max(np.linalg.eigvals(m).real) < 0.0)
    gamma, circle = np.full(max(n - 2, 0), np.inf), np.full(max(n - 2, 0), np.inf)
    for i in range(2, n):  # i as in the paper
        inner = m[: 2 * i - 2, : 2 * i - 2]  # M_{i-1}
        if not positive or np.max(np.linalg.eigvals(inner).real) >= 0.0:
            break  # no gain is finite from here on
        gamma[i - 2] = h_infinity_norm(inner, _unit(2 * i - 2), _unit(2 * i - 2))
        cascade = m[: 2 * i, : 2 * i].copy()  # Lambda_i(0)
        cascade[2 * i - 3, 2 * i - 1] = 0.0
        into = np.zeros(2 * i)
        into[2 * i - 3] = 1.0
        circle[i - 2] = largest_real_part(cascade, into, _unit(2 * i))
    return LowPowerStability(hurwitz, positive, gamma, gamma * beta[1:] / alpha[1:-1], circle)


def _unit(n: int) -> Array:
    """B_n: the last unit vector."""
    unit = np.zeros(n)
    unit[-1] = 1.0
    return unit


# --- design by the recursion ------------------------------------------------------------------


def low_power_small_gain_design(
    n: int,
    alpha: ArrayLike = 3.0,
    beta_1: float | None = None,
    *,
    margin: float = 0.5,
    decay: float | None = None,
) -> LowPowerCoefficients:
    """alpha, beta that are strongly stable by Lemma 2, for any order, block by block.

    For i = 2 ... n-1: beta_i = ``margin`` alpha_i/gamma_{i-1}, with gamma_{i-1} the H-infinity norm
    of system (17).  (The paper prints the inequality the wrong way round: beta_i/alpha_i must be
    *below* 1/gamma_{i-1}.)  Pole assignment alone loses strong stability as n grows.

    ``alpha``: (n,), or one number for all, > 0.  ``beta_1``: default alpha_1^2, which makes block 1
    a pair with damping 1/2.  ``margin`` in (0, 1): the small-gain products.  ``decay`` [1/s]:
    rescale time (alpha -> c alpha, beta -> c^2 beta) so that the slowest pole of M_n lies at
    Re = -decay.
    Source: Astolfi et al., end of section 3.4.
    """
    n = _checks.order(n, least=2)
    given = np.asarray(alpha)
    alphas = _checks.positive_vector(np.full(n, alpha) if given.ndim == 0 else alpha, "alpha", n)
    margin = _checks.number(margin, "margin", above=0.0, below=1.0)
    beta = np.empty(n - 1)
    beta[0] = alphas[0] ** 2 if beta_1 is None else _checks.positive(beta_1, "beta_1")
    for i in range(1, n - 1):
        inner = low_power_matrix(np.append(alphas[:i], 1.0), beta[:i])[: 2 * i, : 2 * i]
        gamma = h_infinity_norm(inner, _unit(2 * i), _unit(2 * i))
        beta[i] = margin * alphas[i] / gamma
    if decay is not None:
        decay = _checks.positive(decay, "decay")
        slowest = -float(np.max(np.linalg.eigvals(low_power_matrix(alphas, beta)).real))
        alphas, beta = alphas * decay / slowest, beta * (decay / slowest) ** 2
    result = low_power_strong_stability(alphas, beta)
    holds = result.small_gain_holds and result.strong
    allowed, remedy = "< 1, with M_n Hurwitz", "choose a smaller margin"
    _checks.demand(holds, "small-gain products", result.small_gain.tolist(), allowed, remedy)
    return LowPowerCoefficients(alphas, beta)
