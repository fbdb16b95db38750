"""Stability and steps of the observer by stochastic approximation, and its stationary error.

Lee, Choi, Khalil: q(k+1) = q(k) + alpha b(k) [A_0 q(k) + H_0 y(k)], a(k) = alpha epsilon b(k), with
b(k) = (1 + k/k0)^-p and A_0 = ``companion(h)``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from . import _checks
from ._checks import Array
from .coefficients import companion
from .lyapunov import lyapunov

# --- how large may alpha b be? ----------------------------------------------------------------


def schur_limit(a0: ArrayLike) -> float:
    """The alpha b below which I + alpha b A_0 is Schur: min over eigenvalues of -2 Re/|.|^2.

    Exact: |1 + c lambda| < 1 for c < -2 Re(lambda)/|lambda|^2.  1 for h = (2, 2): T_max = epsilon.
    """
    eigenvalues = np.linalg.eigvals(_checks.hurwitz(a0, "A0"))
    return float(np.min(-2.0 * eigenvalues.real / np.abs(eigenvalues) ** 2))


def norm_bound(a0: ArrayLike, q: ArrayLike | None = None) -> float:
    """The alpha b below which Lee et al., eq. (33) is negative: lambda_min(Q)/(|A_0|^2 |P|).

    ``q``: Q of eq. (31), default I.  Sufficient only: 0.0890 where ``schur_limit`` is 1.
    """
    a0 = _checks.hurwitz(a0, "A0")
    q = np.eye(a0.shape[0]) if q is None else _checks.positive_definite(q, "Q", a0.shape[0])
    m_p = np.linalg.norm(a0, 2) ** 2 * np.linalg.norm(lyapunov(a0, q), 2)  # (34)
    return float(np.linalg.eigvalsh(q)[0] / m_p)


def step_margin(a0: ArrayLike, p: ArrayLike, alpha_b: float) -> float:
    """The largest c with A_0^T P + P A_0 + alpha b A_0^T P A_0 <= -c I: eq. (36) over alpha b.

    Positive: P proves stability at this alpha b.  As printed, "< -c I" for
    alpha b [A_0^T P + P A_0 + alpha b A_0^T P A_0] cannot hold with one c as b -> 0, for the left
    side tends to 0.  Divided by alpha b it can; and since A_0^T P A_0 >= 0 this margin falls as
    alpha b grows, so that one P found at b(0) serves every later, smaller b(k).
    """
    a0 = _checks.square(a0, "A0")
    p = _checks.symmetric(p, "P", a0.shape[0])
    alpha_b = _checks.number(alpha_b, "alpha_b", least=0.0)
    return -float(np.linalg.eigvalsh(a0.T @ p + p @ a0 + alpha_b * a0.T @ p @ a0)[-1])


@dataclass(frozen=True)
class StepCertificate:
    """``feasible``: ``p`` > 0 was found and verified, ``margin`` > 0 (``step_margin``).

    If not feasible, ``p`` is the zero matrix and ``margin`` 0.
    """

    alpha_b: float
    feasible: bool
    p: Array
    margin: float

    def __bool__(self) -> bool:
        return self.feasible


def lmi_step(a0: ArrayLike, alpha_b: float) -> StepCertificate:
    """Whether a P > 0 of eq. (36), divided by alpha b, exists: by a linear matrix inequality.

    Minimises t with I <= P <= t I and A_0^T P + P A_0 + alpha b A_0^T P A_0 <= -I, then checks the
    answer, whatever the solver reports.  Needs ``pip install "hgo_rs[design]"``.
    Source: Lee et al., Remark 1.
    """
    a0 = _checks.hurwitz(a0, "A0")
    alpha_b = _checks.positive(alpha_b, "alpha_b")
    cp = _checks.load_cvxpy()
    n = a0.shape[0]
    t_matrix = _well_scaled(a0)
    a = t_matrix @ a0 @ np.linalg.inv(t_matrix)
    p, t = cp.Variable((n, n), symmetric=True), cp.Variable()
    eye = np.eye(n)
    left = a.T @ p + p @ a + alpha_b * a.T @ p @ a
    _checks.solve(cp.Problem(cp.Minimize(t), [p >> eye, p << t * eye, left << -eye]))
    if p.value is not None and np.all(np.isfinite(p.value)):
        found = t_matrix.T @ (0.5 * (p.value + p.value.T)) @ t_matrix
        found = 0.5 * (found + found.T)
        margin = step_margin(a0, found, alpha_b)
        # Rounding in the margin is of the order of |P| times the machine's epsilon.
        noise = 1e-13 * float(np.linalg.norm(found, 2)) * (1.0 + float(np.linalg.norm(a0, 2)) ** 2)
        if margin > noise and np.linalg.eigvalsh(found)[0] > 0.0:
            return StepCertificate(alpha_b, True, found, margin)
    return StepCertificate(alpha_b, False, np.zeros((n, n)), 0.0)


def _well_scaled(a0: Array) -> Array:
    """T such that T A_0 T^-1 has a P near I: modal coordinates, or those of a Lyapunov matrix."""
    values, vectors = np.linalg.eig(a0)
    keep = values.imag >= 0.0
    modal = np.column_stack([vectors[:, keep].real, vectors[:, values.imag > 0.0].imag])
    if np.linalg.cond(modal) < 1e8:
        return np.asarray(np.linalg.inv(modal), dtype=np.float64)
    return np.asarray(np.linalg.cholesky(lyapunov(a0)).T)  # repeated poles


# --- step sizes -------------------------------------------------------------------------------


@dataclass(frozen=True)
class StepSizes:
    """Condition (A.2) for a(k) = alpha epsilon (1 + k/k0)^-p, and where the clock ends.

    ``sum_diverges``: p <= 1.  ``squares_converge``: p > 1/2.  ``final_time``: sum of all a(k) [s],
    inf unless the clock stops.
    """

    sum_diverges: bool
    squares_converge: bool
    final_time: float

    @property
    def holds(self) -> bool:
        """(A.2): the sum diverges and the sum of squares converges, exactly for 1/2 < p <= 1."""
        return self.sum_diverges and self.squares_converge


def step_sizes(alpha: float, epsilon: float, k0: float, p: float) -> StepSizes:
    """Condition (A.2), eq. (2) of Lee et al., for a(k) = alpha epsilon (1 + k/k0)^-p.

    For p > 1 the clock ends at alpha epsilon k0^p zeta(p, k0) (Hurwitz's zeta), about
    alpha epsilon k0/(p - 1).
    """
    from scipy.special import zeta

    alpha, epsilon, k0, p = _schedule(alpha, epsilon, k0, p)
    stops = p > 1.0
    final_time = (
        alpha * epsilon * float(np.exp(p * np.log(k0) + np.log(zeta(p, k0)))) if stops else np.inf
    )
    return StepSizes(not stops, p > 0.5, final_time)


def clock(k: int | ArrayLike, alpha: float, epsilon: float, k0: float, p: float) -> Array:
    """t(k) = sum over j < k of alpha epsilon (1 + j/k0)^-p [s], for an index or an array of them.

    The exact sum (about alpha epsilon k0 ln(1 + k/k0) for p = 1), shape of ``k``, 0 <= k <= 1e8.
    """
    alpha, epsilon, k0, p = _schedule(alpha, epsilon, k0, p)
    given = np.asarray(k)
    holds = np.issubdtype(given.dtype, np.integer) and np.all(given >= 0) and np.all(given <= 10**8)
    _checks.demand(holds, "k", given.tolist(), "integers, 0 to 1e8", "pass step indices")
    # Sums between the asked indices, so that no cumulative sum of all steps is stored or rounded.
    stops, where = np.unique(given, return_inverse=True)
    times = np.empty(stops.size)
    t, start = 0.0, 0
    for i, stop in enumerate(stops):
        while start < stop:
            end = min(int(stop), start + 2**20)
            base = 1.0 + np.arange(start, end) / k0
            t += float(np.sum(1.0 / base if p == 1.0 else base**-p))  # a power costs far more
            start = end
        times[i] = alpha * epsilon * t
    return times[where].reshape(given.shape)


def _schedule(
    alpha: float, epsilon: float, k0: float, p: float
) -> tuple[float, float, float, float]:
    return (
        _checks.positive(alpha, "alpha"),
        _checks.positive(epsilon, "epsilon"),
        _checks.positive(k0, "k0"),
        _checks.positive(p, "p"),
    )


# --- fixed step: stationary error -------------------------------------------------------------


@dataclass(frozen=True)
class StationaryError:
    """Stationary ``covariance`` (n, n) of x_hat - x, and its ``std`` (n,)."""

    covariance: Array
    std: Array


def stationary_error(k: ArrayLike, ell: float, dt: float, variance: float) -> StationaryError:
    """Stationary error of the standard observer by forward Euler under white noise.

    ``k``: coefficients; ``ell`` = 1/epsilon; ``dt`` [s]; ``variance``: that of the noise, drawn
    anew at every sample.  The discrete Lyapunov equation S = F S F^T + c^2 variance K K^T with
    c = ell dt and F = I + c (A - K C), in coordinates q_i = e_i/ell^(i-1).
    Source: Lee et al., eq. (20), (42).  The small-step limit is off: 4 % for e2 at c = 0.04.
    """
    from scipy.linalg import solve_discrete_lyapunov

    k = _checks.vector(k, "k")
    ell, dt = _checks.positive(ell, "ell"), _checks.positive(dt, "dt")
    variance = _checks.number(variance, "variance", least=0.0)
    c = ell * dt
    limit = schur_limit(companion(k))
    remedy = f"choose dt < {limit / ell:g}"
    _checks.demand(c < limit, "ell*dt", c, f"< {limit:g}, the limit of forward Euler", remedy)
    f = np.eye(k.size) + c * companion(k)
    s = np.asarray(solve_discrete_lyapunov(f, c * c * variance * np.outer(k, k)))
    powers = ell ** np.arange(k.size)
    covariance = 0.5 * (s + s.T) * np.outer(powers, powers)
    return StationaryError(covariance, np.sqrt(np.diag(covariance)))
