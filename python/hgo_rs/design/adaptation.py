"""The adaptive gain's conditions (8)-(10), a design for any order, and the bounds of the theorem.

Sanfelice, Praly, "On the performance of high-gain observers with gain adaptation under measurement
noise", Automatica 47 (2011).  A - K C is ``companion(k)``; R = diag(b, b+1, ..., b+n-1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hgo_rs.errors import DesignError, check_integer

from . import _checks
from ._checks import Array
from .coefficients import companion

_LogBound = Callable[[int, float], float]


# --- conditions (8)-(10) ----------------------------------------------------------------------


@dataclass(frozen=True)
class AdaptationRates:
    """The best constants that ``k``, ``p``, ``b`` admit in (9) and (10).

    ``d0``: the largest of (9); ``d1``: the smallest of (10); ``lambda_min``: the largest lambda
    with lambda P <= R P + P R, which (10) asks to be >= ``required`` = b/2.
    """

    d0: float
    d1: float
    lambda_min: float
    required: float

    @property
    def holds(self) -> bool:
        """(8)-(10) hold with some d0, d1 > 0."""
        return self.d0 > 0.0 and self.d1 > 0.0 and self.lambda_min >= self.required


def best_d(k: ArrayLike, p: ArrayLike, b: float) -> AdaptationRates:
    """The best d0, d1 and lambda_min, by generalised eigenvalues of pairs with P.

    ``k``: (n,); ``p``: symmetric positive definite (n, n); ``b`` in (0, 1/2).
    """
    k, p, b = _certificate_arguments(k, p, b)
    h = companion(k)
    n_matrix = np.diag(b + np.arange(k.size))
    left_9 = h.T @ p + p @ h
    left_10 = n_matrix @ p + p @ n_matrix
    rates = _relative_eigenvalues(left_10, p)
    return AdaptationRates(
        d0=-0.5 * float(_relative_eigenvalues(left_9, p)[-1]),
        d1=float(rates[-1]),
        lambda_min=float(rates[0]),
        required=0.5 * b,
    )


@dataclass(frozen=True)
class AdaptationCertificate:
    """By how much (8)-(10) hold, relative to P: all margins >= 0 means that they do.

    ``margin_8``: smallest eigenvalue of P over its largest; ``margin_9``: (best d0) - d0;
    ``margin_10_lower``: lambda_min - b/2; ``margin_10_upper``: d1 - (best d1).
    """

    margin_8: float
    margin_9: float
    margin_10_lower: float
    margin_10_upper: float

    @property
    def holds(self) -> bool:
        """(8)-(10) hold."""
        margins = (self.margin_9, self.margin_10_lower, self.margin_10_upper)
        return self.margin_8 > 0.0 and all(margin >= 0.0 for margin in margins)


def check_adaptation(
    k: ArrayLike, p: ArrayLike, b: float, d0: float, d1: float
) -> AdaptationCertificate:
    """(8)-(10) for given d0, d1 > 0, with the margins."""
    d0, d1 = _checks.positive(d0, "d0"), _checks.positive(d1, "d1")
    best = best_d(k, p, b)
    eigenvalues = np.linalg.eigvalsh(_checks.symmetric(p, "P"))
    return AdaptationCertificate(
        margin_8=float(eigenvalues[0] / eigenvalues[-1]),
        margin_9=best.d0 - d0,
        margin_10_lower=best.lambda_min - best.required,
        margin_10_upper=d1 - best.d1,
    )


def _certificate_arguments(k: ArrayLike, p: ArrayLike, b: float) -> tuple[Array, Array, float]:
    k = _checks.vector(k, "k")
    p = _checks.positive_definite(p, "P", k.size)
    return k, p, _checks.number(b, "b", above=0.0, below=0.5)


def _relative_eigenvalues(left: Array, p: Array) -> Array:
    """Eigenvalues, ascending, of L^-1 left L^-T for P = L L^T: those of left relative to P."""
    factor = np.linalg.cholesky(p)
    half = np.linalg.solve(factor, left)
    return np.linalg.eigvalsh(np.linalg.solve(factor, half.T))


# --- design -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class AdaptationDesign:
    """Coefficients ``k`` (n,) with ``p`` (n, n), ``b``, ``d0``, ``d1`` that satisfy (8)-(10)."""

    k: Array
    p: Array
    b: float
    d0: float
    d1: float

    @property
    def condition_number(self) -> float:
        """lambda_max(P)/lambda_min(P)."""
        return float(np.linalg.cond(self.p))

    @property
    def certificate(self) -> AdaptationCertificate:
        """The margins of (8)-(10), computed from the numbers themselves."""
        return check_adaptation(self.k, self.p, self.b, self.d0, self.d1)

    def rescaled(self, s: float) -> AdaptationDesign:
        """Time made s times faster: K -> diag(s, ..., s^n) K, d0 -> s d0; b and d1 stay.

        A - K C becomes s T (A - K C) T^-1 with T = diag(1, s, ..., s^(n-1)), and P becomes
        T^-1 P T^-1; R commutes with T, so (10) is untouched.
        """
        s = _checks.positive(s, "s")
        powers = s ** np.arange(self.k.size)
        return AdaptationDesign(
            self.k * s * powers, self.p / np.outer(powers, powers), self.b, self.d0 * s, self.d1
        )


def adaptation_design(n: int, b: float, d0: float = 0.3) -> AdaptationDesign:
    """``k`` and P of (8)-(10) for order ``n``: a linear matrix inequality in P and Y = P K.

        minimise cond P  subject to  P A - Y C + (P A - Y C)^T <= -2 d0 P,  R P + P R >= (b/2) P.

    The answer is always verified, whatever the solver reports; ``DesignError`` if it does not hold.
    n = 2 ... 6 succeed for all b in [0.05, 0.45].  Needs ``pip install "hgo_rs[design]"``.
    Source: Sanfelice, Praly, (8)-(10).
    """
    n = _checks.order(n)
    b = _checks.number(b, "b", above=0.0, below=0.5)
    d0 = _checks.positive(d0, "d0")
    cp = _checks.load_cvxpy()
    eye, a, c = np.eye(n), np.diag(np.ones(n - 1), 1), np.eye(n)[:1]
    r = np.diag(b + np.arange(n))
    p, y, t = cp.Variable((n, n), symmetric=True), cp.Variable((n, 1)), cp.Variable()
    slack = 1.0 + 1e-3  # so that the solver's rounding stays on the safe side
    unit = 0.3  # d0 of the inequality; ``rescaled`` leads to the one asked for
    left = p @ a - y @ c
    status = _checks.solve(
        cp.Problem(
            cp.Minimize(t),
            [
                p >> eye,
                p << t * eye,
                left + left.T + 2.0 * unit * slack * p << 0,
                r @ p + p @ r - 0.5 * b * slack * p >> 0,
            ],
        )
    )
    found = p.value is not None and bool(np.all(np.isfinite(p.value)))
    remedy = "choose a smaller n, or b nearer to 1/2"
    _checks.demand(found, "solver status", status, "optimal", remedy)
    p_found = 0.5 * (p.value + p.value.T)
    k = np.linalg.solve(p_found, y.value[:, 0])
    d1 = best_d(k, p_found, b).d1
    design = AdaptationDesign(k, p_found, b, unit, d1 * (1.0 + 1e-12)).rescaled(d0 / unit)
    holds = design.certificate.holds
    remedy = "the solver's answer is wrong: choose a smaller n, or b nearer to 1/2"
    _checks.demand(holds, "margins of (8)-(10)", design.certificate, ">= 0", remedy)
    return design


# --- the theorem's bounds ---------------------------------------------------------------------


def smallest_p2(k: ArrayLike, p: ArrayLike, d0: float, noise: float) -> float:
    """The smallest p2 of (12): 4 M^2 (1 + 2 lambda_max(P) |K|^2/(d0^2 lambda_min(P))).

    ``noise``: M_infinity, the bound on |m|.  1988.4 M^2 for the paper's k, P, d0.
    """
    return 4.0 * _checks.number(noise, "noise", least=0.0) ** 2 * _noise_factor(k, p, d0)


def largest_noise(k: ArrayLike, p: ArrayLike, d0: float, p2: float) -> float:
    """The largest bound on the noise that (12) admits for ``p2``: 1.12e-3 in the paper's example.

    The example's noise (mean 0.02, three standard deviations of 0.015) exceeds it sixty times.
    """
    return float(np.sqrt(_checks.positive(p2, "p2") / (4.0 * _noise_factor(k, p, d0))))


def _noise_factor(k: ArrayLike, p: ArrayLike, d0: float) -> float:
    k = _checks.vector(k, "k")
    eigenvalues = np.linalg.eigvalsh(_checks.positive_definite(p, "P", k.size))
    d0 = _checks.positive(d0, "d0")
    return 1.0 + 2.0 * float(eigenvalues[-1] / eigenvalues[0]) * float(k @ k) / d0**2


@dataclass(frozen=True)
class ErrorBound:
    """log10 of the bounds B_1 ... B_n on the mean of |x_hat_i - x_i|^2, and the s that gives each.

    ``noise_admitted``: p2 satisfies (12); if not, the numbers only extrapolate the theorem.
    """

    log10: Array
    s: Array
    noise_admitted: bool


def error_bound(
    k: ArrayLike,
    p: ArrayLike,
    b: float,
    d0: float,
    d1: float,
    *,
    p1: float,
    p2: float,
    noise: float,
    gamma: ArrayLike,
    lipschitz: ArrayLike,
) -> ErrorBound:
    """The bounds (15) of Theorem 2.2, in logarithms (they overflow any number format otherwise).

    ``noise``: M_infinity; ``gamma``, ``lipschitz``: gamma_i, L_i of Property (*), shape (n,).  For
    the paper's example they exceed 1e134: vacuous.  Source: Sanfelice, Praly, Remark 2.4.
    """
    problem = _Bound(k, p, b, d0, d1, p1, p2, noise, gamma, lipschitz)
    return problem.minimised(problem.log_bound)


def error_bound_vanishing(
    k: ArrayLike,
    p: ArrayLike,
    b: float,
    d0: float,
    d1: float,
    *,
    p1: float,
    p2: float,
    noise: float,
    lipschitz: ArrayLike,
) -> ErrorBound:
    """The bounds (16): (15) for gamma = 0, where p2 alone bounds the noise by (12)."""
    k = _checks.vector(k, "k")
    problem = _Bound(k, p, b, d0, d1, p1, p2, noise, np.zeros(k.size), lipschitz)
    return problem.minimised(problem.log_bound_vanishing)


class _Bound:
    """The functions of s in (15) and (16).  Natural logarithms; lambda_min, lambda_max are of P."""

    def __init__(
        self,
        k: ArrayLike,
        p: ArrayLike,
        b: float,
        d0: float,
        d1: float,
        p1: float,
        p2: float,
        noise: float,
        gamma: ArrayLike,
        lipschitz: ArrayLike,
    ) -> None:
        k, p, self.b = _certificate_arguments(k, p, b)
        n = self.n = k.size
        self.d0, self.d1 = _checks.positive(d0, "d0"), _checks.positive(d1, "d1")
        self.p1, self.p2 = _checks.positive(p1, "p1"), _checks.positive(p2, "p2")
        self.noise = _checks.number(noise, "noise", least=0.0)
        self.gamma = _checks.vector(gamma, "gamma", n)
        lipschitz = _checks.vector(lipschitz, "lipschitz", n)
        eigenvalues = np.linalg.eigvalsh(p)
        self.low, self.ratio = float(eigenvalues[0]), float(eigenvalues[-1] / eigenvalues[0])
        self.c0 = 2.0 * float(eigenvalues[-1]) / self.d0
        self.c1 = self.c0 * float(k @ k)
        self.l_hat = 2.0 / self.low * float(np.arange(1, n + 1) @ lipschitz**2)
        self.b2 = 4.0 / (self.d0 * self.low) * self.a1(1.0)
        self.noise_admitted = self.p2 >= smallest_p2(k, p, self.d0, self.noise)

    def a1(self, s: float) -> float:
        """a_1(s) = 2 c_0 sum gamma_i^2/s^(2i)."""
        return 2.0 * self.c0 * float(np.sum(self.gamma**2 * s ** (-2.0 * np.arange(1, self.n + 1))))

    def log_tilde_b1(self, s: float) -> float:
        """ln of B_1 with a tilde: the larger of two terms, s^-2b a_2(s) drawn out of the first."""
        n, b, d0, c1, p1, p2 = self.n, self.b, self.d0, self.c1, self.p1, self.p2
        damping = d0 - self.c0 * self.l_hat / s**2
        growth = 2.0 * (self.d1 * p1 * p2 + self.c0 * self.l_hat) / d0
        inner = p1 * (4.0 * c1 * self.noise**2 + self.a1(s) - 2.0 * c1 * p2) / damping
        inner += 4.0 * c1 * s / (2 * n + 1) * growth ** ((2 * n + 1) / (1.0 + 2.0 * b))
        second = 4.0 * p1 * (self.a1(1.0) + c1 * self.noise**2) / (d0**2 * self.low)
        log_a2 = 2.0 * (b + n - 1.0) * np.log(s) + np.log(self.ratio)  # s >= 1
        first = log_a2 - 2.0 * b * np.log(s) - np.log(d0 * self.low)
        return float(max(first + _log(inner), _log(second)))

    def log_b1(self, s: float, also: float = 0.0) -> float:
        """ln(B_1(s) + ``also``)."""
        tilde = self.log_tilde_b1(s)
        factor = 2.0 * self.d1 + 2.0 * self.c0 * self.l_hat / (self.p1 * self.p2)
        terms = [(1.0 - 2.0 * self.b) * tilde, np.log(factor) + tilde, np.log(2.0), _log(also)]
        return float(np.logaddexp.reduce(terms))

    def log_denominator(self, s: float) -> float:
        """ln(lambda_min (d_0 s^2 - c_0 L_hat))."""
        return float(np.log(self.low * (self.d0 * s**2 - self.c0 * self.l_hat)))

    def log_bound(self, i: int, s: float) -> float:
        """ln of the braces of (15)."""
        constant = 2.0 * i * np.log(s) + _log(self.a1(s) + 2.0 * self.c1 * self.noise**2)
        adaptation = np.log(2.0 * self.c1 * self.p2) - 2.0 * (self.n - i) * np.log(s)
        adaptation += 2.0 * self.n / (1.0 - 2.0 * self.b) * self.log_b1(s, self.b2 / self.p2)
        return float(np.logaddexp(constant, adaptation)) - self.log_denominator(s)

    def log_bound_vanishing(self, i: int, s: float) -> float:
        """ln of the braces of (16)."""
        power = 2.0 * self.n / (1.0 - 2.0 * self.b)
        first = -np.log(self.c1 / (self.d0 * self.low) + 1.0)
        second = np.log(4.0) + power * self.log_b1(s) - 2.0 * self.n * np.log(s)
        scale = np.log(0.5 * self.c1 * self.p2) + 2.0 * i * np.log(s) - self.log_denominator(s)
        return float(scale + np.logaddexp(first, second))

    def least_s(self) -> float:
        """s*: above the root of (43), above s_bar (2 c_1 p_2 > a_1(s_bar)), and >= 1."""
        s = self.p1 * self.p2 * (2 * self.n + 1) / self.d0 + np.sqrt(self.c0 * self.l_hat / self.d0)
        s = max(float(s), 1.0)
        if self.a1(s) >= 2.0 * self.c1 * self.p2:
            low, high = s, s
            while self.a1(high) >= 2.0 * self.c1 * self.p2:
                low, high = high, 2.0 * high
            for _ in range(60):
                middle = np.sqrt(low * high)
                above = self.a1(middle) >= 2.0 * self.c1 * self.p2
                low, high = (middle, high) if above else (low, middle)
            s = high
        return s

    def minimised(self, log_bound: _LogBound) -> ErrorBound:
        """The minimum over s > s*, for each i."""
        from scipy.optimize import minimize_scalar

        start = np.log(self.least_s())
        best, where = np.empty(self.n), np.empty(self.n)
        # s = s* (1 + e^v): open at s*, where the denominator may vanish.
        grid = np.linspace(-20.0, 20.0, 161)
        for i in range(1, self.n + 1):

            def value(v: float, i: int = i) -> float:
                return log_bound(i, float(np.exp(start + np.logaddexp(0.0, v))))

            j = int(np.argmin([value(v) for v in grid]))
            j = min(max(j, 1), grid.size - 2)
            found = minimize_scalar(
                value, bounds=(grid[j - 1], grid[j + 1]), method="bounded", options={"xatol": 1e-10}
            )
            best[i - 1] = min(float(found.fun), value(float(grid[j]))) / np.log(10.0)
            where[i - 1] = np.exp(start + np.logaddexp(0.0, float(found.x)))
        return ErrorBound(best, where, self.noise_admitted)


def _log(x: float) -> float:
    """ln x, -inf for x <= 0."""
    return float(np.log(x)) if x > 0.0 else -np.inf


# --- repelled copies --------------------------------------------------------------------------


def repulsion_gains(p: ArrayLike, mu: float) -> Array:
    """k_bar = mu P^-1 (1, 0, ..., 0)^T of the collection (23), shape (n,)."""
    p = _checks.positive_definite(p, "P")
    mu = _checks.number(mu, "mu", least=0.0)
    return np.linalg.solve(p, mu * np.eye(p.shape[0])[0])


def collection_gain(nu1: float, k1: float, k_bar1: float, copies: int) -> float:
    """The r about which the copies of (23) oscillate: nu1/(k1 - copies k_bar1).

    There the linearisation of the motion of the copies against one another is marginally stable:
    repulsion turns k into k - copies k_bar.  1.2114 for the paper's "around 1.21".
    """
    nu1 = _checks.positive(nu1, "nu1")
    k1 = _checks.positive(k1, "k1")
    k_bar1 = _checks.number(k_bar1, "k_bar1", least=0.0)
    copies = check_integer(copies, "copies", least=1, error=DesignError)
    left = k1 - copies * k_bar1
    remedy = "choose a smaller mu or fewer copies"
    _checks.demand(left > 0.0, "k1 - copies*k_bar1", left, "> 0", remedy)
    return nu1 / left
