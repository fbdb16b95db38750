"""The certificates, against the papers' figures, against each other, and on bad input."""

from __future__ import annotations

import math
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hgo_rs import LowPowerObserver, design
from hgo_rs.design import _checks, discretisation
from hgo_rs.errors import DesignError, HgoError, MissingExtraError, check_integer, check_number
from hgo_rs.reference import Observer

# --- the papers' numbers ----------------------------------------------------------------------

LEE_H = np.array([2.0, 2.0])
LEE = {"alpha": 0.04, "epsilon": 0.01, "k0": 20000}

SP_K = np.array([2.0, 2.0])
SP_P = np.array([[0.75, -0.50], [-0.50, 0.88]])
SP_B, SP_D0, SP_D1 = 0.183, 0.37, 2.66

ASTOLFI_POLES = np.append(np.linspace(-2.0, -1.0, 8), -2.0)
ASTOLFI_ALPHA = np.array([3.0, 3.0, 3.0, 3.0, 2.0])
ASTOLFI_BETA = np.array([8.571429, 3.212245, 1.426736, 0.534670])
PRINTED_BETA = np.array([8.5714, 3.2122, 1.4267, 0.5347])  # four digits: other poles
ASTOLFI_K = np.array([7.5, 22.1875, 32.34375, 23.21875, 6.5625])


def equidistant(n: int) -> np.ndarray:
    """2n-1 poles in [-2, -1] as the paper's, for any order."""
    return np.append(np.linspace(-2.0, -1.0, 2 * n - 2), -2.0)


# --- coefficients -----------------------------------------------------------------------------


def test_standard_coefficients_of_the_paper() -> None:
    k = design.observer_coefficients(np.linspace(-2.0, -1.0, 5))
    np.testing.assert_allclose(k, ASTOLFI_K, rtol=1e-13)
    np.testing.assert_allclose(design.observer_coefficients([-1 + 1j, -1 - 1j]), LEE_H)


def test_low_power_coefficients_of_the_paper() -> None:
    found = design.low_power_coefficients(ASTOLFI_POLES)
    assert found.n == 5
    np.testing.assert_allclose(found.alpha, ASTOLFI_ALPHA, rtol=1e-10)
    np.testing.assert_allclose(found.beta, ASTOLFI_BETA, atol=6e-7)
    # Nine equidistant poles cannot be the paper's: the alphas sum to minus the poles' sum.
    nine = design.low_power_coefficients(np.linspace(-2.0, -1.0, 9))
    assert nine.alpha.sum() == pytest.approx(13.5)
    assert found.alpha.sum() == pytest.approx(14.0)


def poles(least: int, most: int, odd: bool) -> st.SearchStrategy[np.ndarray]:
    """Pole sets of size least to most in a sensible part of the left half plane."""

    @st.composite
    def draw_poles(draw: st.DrawFn) -> np.ndarray:
        size = draw(st.integers(least, most).filter(lambda m: not odd or m % 2 == 1))
        pairs = draw(st.integers(0, size // 2))
        real = draw(st.lists(st.floats(-5.0, -0.2), min_size=size - 2 * pairs, max_size=size))
        real = real[: size - 2 * pairs]
        upper = [
            complex(draw(st.floats(-3.0, -0.1)), draw(st.floats(0.05, 3.0))) for _ in range(pairs)
        ]
        return np.array([*real, *upper, *[z.conjugate() for z in upper]], dtype=complex)

    return draw_poles()


@settings(max_examples=80, deadline=None)
@given(poles(1, 12, odd=False))
def test_standard_coefficients_give_back_their_polynomial(roots: np.ndarray) -> None:
    k = design.observer_coefficients(roots)
    assert design.routh_hurwitz(np.append(1.0, k))
    s = np.array([0.3, -0.7 + 0.4j, 1.5j])
    wanted = np.prod(s[:, None] - roots, axis=1)
    size = np.prod(np.abs(s)[:, None] + np.abs(roots), axis=1)  # before cancellation
    assert np.all(np.abs(np.polyval(np.append(1.0, k), s) - wanted) <= 1e-13 * size)
    determinant = np.linalg.det(s[:, None, None] * np.eye(k.size) - design.companion(k))
    assert np.all(np.abs(determinant - wanted) <= 1e-10 * size)


@settings(max_examples=120, deadline=None)
@given(poles(3, 23, odd=True))
def test_low_power_round_trip_for_any_order(roots: np.ndarray) -> None:
    wanted = np.poly(roots).real
    found = design.low_power_coefficients(roots)
    back = design.low_power_polynomial(found.alpha, found.beta)
    np.testing.assert_allclose(back, wanted, rtol=1e-7)
    again = design.low_power_coefficients(polynomial=back)
    np.testing.assert_allclose(
        design.low_power_polynomial(again.alpha, again.beta), wanted, rtol=1e-7
    )


@pytest.mark.parametrize("n", range(2, 13))
def test_low_power_matrix_has_the_polynomial(n: int) -> None:
    found = design.low_power_coefficients(equidistant(n))
    s = 0.4 + 0.9j  # determinants, not eigenvalues: these are lost from n = 7
    matrix = design.low_power_matrix(found.alpha, found.beta)
    determinant = np.linalg.det(s * np.eye(2 * n - 1) - matrix)
    wanted = np.prod(s - equidistant(n))
    assert abs(determinant / wanted - 1.0) < 1e-8


def test_low_power_matrix_by_the_papers_recursion() -> None:
    rng = np.random.default_rng(3)
    alpha, beta = rng.uniform(1, 3, 4), rng.uniform(1, 3, 3)
    a2, b2, c2 = np.array([[0, 1], [0, 0]]), np.array([[0], [1]]), np.array([[1, 0]])
    blocks = [np.array([[alpha[i]], [beta[i]]]) for i in range(3)]
    m = a2 - blocks[0] @ c2
    for i in (1, 2):
        last = np.eye(2 * i)[:, -1:]
        m = np.block([[m, last @ b2.T], [blocks[i] @ last.T, a2 - blocks[i] @ c2]])
    m = np.block([[m, np.zeros((6, 1))], [alpha[3] * np.eye(6)[-1:], -alpha[3]]])
    np.testing.assert_array_equal(design.low_power_matrix(alpha, beta), m)


@pytest.mark.parametrize(
    ("polynomial", "expected"),
    [
        ([1.0, 2.0, 2.0], True),
        ([-1.0, -2.0, -2.0], True),
        ([1.0, 1.0, 1.0, 1.0], False),  # +-j
        ([1.0, 0.0, 1.0], False),
        ([1.0, 1.0, 1.0, 3.0], False),  # positive coefficients are not enough
        ([1.0, 1.0, -1.0], False),
        ([5.0], True),
    ],
)
def test_routh_hurwitz(polynomial: list[float], expected: bool) -> None:
    assert design.routh_hurwitz(polynomial) is expected


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: design.observer_coefficients([-1, 1]), r"poles\[1\] = .*negative real part"),
        (lambda: design.observer_coefficients([-1, 0]), r"poles\[1\]"),
        (lambda: design.observer_coefficients([-1 + 1j, -2]), r"conjugation; add \(-1-1j\)"),
        (lambda: design.observer_coefficients([-1 + 1j, -1 - 1.01j]), "conjugation"),
        (lambda: design.observer_coefficients([]), "number of poles = 0: must be 1 to 12"),
        (lambda: design.observer_coefficients(-np.ones(13)), "number of poles = 13"),
        (lambda: design.observer_coefficients([np.nan]), r"poles\[0\]"),
        (lambda: design.observer_coefficients(["a"]), "must be numbers"),
        (lambda: design.low_power_coefficients(-np.ones(4)), "number of poles = 4: must be odd"),
        (lambda: design.low_power_coefficients(-np.ones(25)), "3 to 23"),
        (lambda: design.low_power_coefficients(), "one of the two"),
        (lambda: design.low_power_coefficients([-1.0], polynomial=[1.0, 1.0]), "one of the two"),
        (lambda: design.low_power_coefficients(polynomial=[1, 1, 1, 1]), "Hurwitz"),
        (lambda: design.low_power_coefficients(polynomial=[0, 1, 1, 1]), "leading coefficient"),
        (lambda: design.low_power_coefficients(polynomial=[1, 3, 2]), "degree of polynomial = 2"),
        (lambda: design.low_power_matrix([1, 2, 3], [1, 2, 3]), r"beta = .*of shape \(2,\)"),
        (lambda: design.low_power_matrix(np.ones(13), np.ones(12)), "number of alpha = 13"),
        (lambda: design.companion([1.0, np.inf]), "k = .*finite"),
        (lambda: design.companion([1j]), "must be real"),
    ],
)
def test_bad_coefficients_are_refused(call: Any, match: str) -> None:
    with pytest.raises(DesignError, match=match):
        call()


# --- Lyapunov and ell* ------------------------------------------------------------------------


def test_ell_star_of_the_paper() -> None:
    box = [(-2.5, 2.5), (-1, 1), (-0.5, 0.5), (-0.5, 0.5), (-0.5, 0.5)]  # |x_i| of section 4
    slope = design.lipschitz_constant(design.crackle_gradient, box)
    assert slope == pytest.approx(math.sqrt(20.0), rel=1e-14)

    found = design.low_power_coefficients(ASTOLFI_POLES)
    p = design.lyapunov(design.low_power_matrix(found.alpha, found.beta))
    assert np.linalg.norm(p, 2) == pytest.approx(126.18, rel=1e-4)
    assert design.ell_star(slope, p) == pytest.approx(1128.5, rel=1e-4)

    p = design.lyapunov(design.companion(ASTOLFI_K))
    assert np.linalg.norm(p, 2) == pytest.approx(15.084, rel=1e-4)
    assert design.ell_star(slope, p) == pytest.approx(134.9, rel=1e-4)


@pytest.mark.parametrize("low_power", [True, False])
def test_frozen_gain_lies_far_below_ell_star(low_power: bool) -> None:
    gradients = [design.crackle_gradient([x1, 0, 0, 0, 0]) for x1 in np.linspace(-2.5, 2.5, 11)]
    if low_power:
        matrix, used = design.low_power_matrix(ASTOLFI_ALPHA, ASTOLFI_BETA), 7.0
    else:
        matrix, used = design.companion(ASTOLFI_K), 4.17
    frozen = design.ell_frozen(matrix, gradients)
    slope = math.sqrt(20.0)
    assert 0.0 < frozen < used < design.ell_star(slope, design.lyapunov(matrix))

    # Unscaled error dynamics of (2), (5), at that gain: the rightmost eigenvalue crosses zero.
    def rightmost(ell: float) -> float:
        n = 5
        worst = -np.inf
        for gradient in gradients:
            if low_power:
                size = 2 * n - 1  # x_1, eta_1, x_2, ...
                powers = ell ** np.array([0, 1, 1, 2, 2, 3, 3, 4, 4], dtype=float)
                real = ell * powers[:, None] * matrix / powers[None]
                real[-1, 0:size:2] += gradient
                real[-2, 0:size:2] += gradient
            else:
                powers = ell ** np.arange(n, dtype=float)
                real = ell * powers[:, None] * matrix / powers[None]
                real[-1] += gradient
            worst = max(worst, float(np.max(np.linalg.eigvals(real).real)))
        return worst

    assert rightmost(1.001 * frozen) < 0.0 < rightmost(0.999 * frozen)


def test_lyapunov_solves_its_equation_and_refuses_unstable_matrices() -> None:
    rng = np.random.default_rng(5)
    a = rng.normal(size=(4, 4)) - 4.0 * np.eye(4)
    q = np.diag([1.0, 2.0, 3.0, 4.0])
    p = design.lyapunov(a, q)
    np.testing.assert_allclose(a.T @ p + p @ a, -q, atol=1e-12)
    with pytest.raises(DesignError, match=r"real part of the eigenvalues of A = .*< 0"):
        design.lyapunov([[0.0, 1.0], [-1.0, 0.0]])
    with pytest.raises(DesignError, match="smallest eigenvalue of Q"):
        design.lyapunov(a, np.diag([1.0, 1.0, 1.0, -1.0]))
    with pytest.raises(DesignError, match="symmetric"):
        design.lyapunov(a, np.triu(np.ones((4, 4))))
    with pytest.raises(DesignError, match="box"):
        design.lipschitz_constant(design.crackle_gradient, [(1.0, -1.0)] * 5)
    with pytest.raises(DesignError, match="gradients"):
        design.ell_frozen(design.companion(LEE_H), [[1.0, 2.0, 3.0]])


# --- stochastic approximation -----------------------------------------------------------------


def test_schur_limit_and_the_papers_bound() -> None:
    a0 = design.companion(LEE_H)
    assert design.schur_limit(a0) == pytest.approx(1.0, rel=1e-12)
    assert design.norm_bound(a0) == pytest.approx(0.0890, abs=5e-5)


@settings(max_examples=50, deadline=None)
@given(poles(1, 6, odd=False))
def test_schur_limit_is_where_the_spectral_radius_passes_one(roots: np.ndarray) -> None:
    limit = float(np.min(-2.0 * roots.real / np.abs(roots) ** 2))
    radius = [np.max(np.abs(1.0 + c * limit * roots)) for c in (0.999, 1.001)]
    assert radius[0] < 1.0 < radius[1]
    if min([abs(a - b) for i, a in enumerate(roots) for b in roots[:i]], default=1.0) > 0.3:
        a0 = design.companion(design.observer_coefficients(roots))
        assert design.schur_limit(a0) == pytest.approx(limit, rel=1e-6)


@pytest.mark.parametrize(
    ("h", "limit", "nearest"),
    [
        ([2.0, 2.0], 1.0, 0.9999),
        ([2.0, 1.0], 2.0, 0.99),
        ([3.0, 3.0, 1.0], 2.0, 0.95),  # a triple pole: cond P exceeds 1e9 at 0.99
    ],
)
def test_lmi_is_feasible_exactly_below_the_schur_limit(
    h: list[float], limit: float, nearest: float
) -> None:
    a0 = design.companion(h)
    for fraction in (0.01, 0.5, 0.9, nearest):
        found = design.lmi_step(a0, fraction * limit)
        assert found and found.margin > 0.0
        assert np.linalg.eigvalsh(found.p)[0] > 0.0
        step = np.eye(len(h)) + fraction * limit * a0
        assert np.linalg.eigvalsh(step.T @ found.p @ step - found.p)[-1] < 0.0  # (36) as printed
    for fraction in (1.0, 1.0001, 1.01, 2.0):
        found = design.lmi_step(a0, fraction * limit)
        assert not found and found.margin == 0.0


def test_one_p_serves_every_later_step() -> None:
    a0 = design.companion(LEE_H)
    found = design.lmi_step(a0, 0.9)
    b = (1.0 + np.arange(0, 10**6, 10**5) / 20000.0) ** -1.0
    margins = [design.step_margin(a0, found.p, 0.9 * b_k) for b_k in b]
    assert margins[0] == pytest.approx(found.margin)
    assert np.all(np.diff(margins) > 0.0)
    # as printed, not divided by alpha b, no c > 0 holds for all k
    printed = [0.9 * b_k * margin for b_k, margin in zip(b, margins, strict=True)]
    assert printed[-1] < 0.2 * max(printed)


@pytest.mark.parametrize(
    ("p", "holds", "final"),
    [
        (0.4, False, np.inf),
        (0.5, False, np.inf),
        (0.51, True, np.inf),
        (1.0, True, np.inf),
        (1.1, False, 80.0),
        (1.5, False, 16.0),
    ],
)
def test_step_size_conditions(p: float, holds: bool, final: float) -> None:
    found = design.step_sizes(p=p, **LEE)
    assert found.holds is holds
    assert found.final_time == pytest.approx(final, rel=1e-4)


def test_clock_is_the_exact_sum() -> None:
    from scipy.special import digamma, zeta

    k = np.array([10**6, 0, 3, 10**6])
    exact = 8.0 * (digamma(20000.0 + k) - digamma(20000.0))
    found = design.clock(k, p=1.0, **LEE)
    np.testing.assert_allclose(found, exact, rtol=1e-12, atol=1e-13)
    assert found[2] == pytest.approx(4e-4 * (1 + 20000 / 20001 + 20000 / 20002), rel=1e-14)
    assert found[0] == pytest.approx(8.0 * np.log(51.0), rel=1e-5)
    tail = 4e-4 * 20000.0**1.5 * zeta(1.5, 20000.0 + 10**6)
    whole = design.step_sizes(p=1.5, **LEE).final_time
    assert design.clock(10**6, p=1.5, **LEE) == pytest.approx(whole - tail, rel=1e-11)
    with pytest.raises(DesignError, match=r"k = .*integers"):
        design.clock(1.5, p=1.0, **LEE)
    with pytest.raises(DesignError, match=r"p = 0.*> 0"):
        design.clock(1, p=0.0, **LEE)


def test_stationary_error_of_the_fixed_step() -> None:
    found = design.stationary_error(LEE_H, ell=100.0, dt=4e-4, variance=1.0 / 12.0)
    np.testing.assert_allclose(found.std, [0.0721588, 6.011561], rtol=1e-6)
    # the covariance of x_hat - x by its own recursion, unscaled
    step = np.array([[1.0 - 4e-4 * 200.0, 4e-4], [-4e-4 * 20000.0, 1.0]])
    into = 4e-4 * np.array([200.0, 20000.0])
    s = np.zeros((2, 2))
    for _ in range(3000):
        s = step @ s @ step.T + np.outer(into, into) / 12.0
    np.testing.assert_allclose(found.covariance, s, rtol=1e-9)
    small = design.stationary_error(LEE_H, ell=100.0, dt=1e-8, variance=1.0 / 12.0 * 4e-4 / 1e-8)
    assert small.std[1] == pytest.approx(5.7735, rel=1e-4)
    with pytest.raises(DesignError, match=r"ell\*dt = 1.0: must be < 1"):
        design.stationary_error(LEE_H, ell=100.0, dt=0.01, variance=1.0)


# --- adaptive gain ----------------------------------------------------------------------------


def test_conditions_of_the_printed_set() -> None:
    best = design.best_d(SP_K, SP_P, SP_B)
    assert best.d0 == pytest.approx(0.37526, abs=5e-6)
    assert best.d1 == pytest.approx(2.63476, abs=5e-6)
    assert best.lambda_min == pytest.approx(0.09724, abs=5e-6)
    assert best.required == pytest.approx(0.09150)
    assert best.holds
    assert design.check_adaptation(SP_K, SP_P, SP_B, SP_D0, SP_D1).holds
    assert not design.check_adaptation(SP_K, SP_P, SP_B, 0.38, SP_D1).holds
    assert not design.check_adaptation(SP_K, SP_P, SP_B, SP_D0, 2.63).holds
    assert not design.best_d(SP_K, np.eye(2), SP_B).holds  # (9) fails with P = I


def assert_conditions(found: design.AdaptationDesign) -> None:
    """(8)-(10) by the definiteness of the matrices themselves."""
    n = found.k.size
    h = np.diag(np.ones(n - 1), 1) - np.outer(found.k, np.eye(n)[0])
    r = np.diag(found.b + np.arange(n))
    scale = 1e-9 * np.linalg.norm(found.p, 2)
    p = found.p
    assert np.linalg.eigvalsh(p)[0] > 0.0
    assert np.linalg.eigvalsh(h.T @ p + p @ h + 2.0 * found.d0 * p)[-1] <= scale
    assert np.linalg.eigvalsh(r @ p + p @ r - 0.5 * found.b * p)[0] >= -scale
    assert np.linalg.eigvalsh(found.d1 * p - r @ p - p @ r)[0] >= -scale


@pytest.mark.parametrize("n", range(2, 7))
@pytest.mark.parametrize("b", [0.05, 0.183, 0.3, 0.45])
def test_adaptation_design(n: int, b: float) -> None:
    found = design.adaptation_design(n, b)
    assert (found.d0, found.b) == (0.3, b)
    assert found.certificate.holds
    assert_conditions(found)
    assert found.condition_number < 500.0
    assert np.max(np.linalg.eigvals(design.companion(found.k)).real) < -0.29


def test_adaptation_design_rescales() -> None:
    found = design.adaptation_design(3, 0.2)
    faster = design.adaptation_design(3, 0.2, d0=1.2)
    assert faster.d0 == pytest.approx(1.2)
    assert_conditions(faster)
    scaled = found.rescaled(4.0)
    np.testing.assert_allclose(scaled.k, found.k * [4.0, 16.0, 64.0], rtol=1e-14)
    np.testing.assert_allclose(scaled.k, faster.k, rtol=1e-12)
    assert scaled.d1 == found.d1
    assert_conditions(scaled)


def test_a_wrong_answer_of_the_solver_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    solve = _checks.solve

    def spoiled(problem: Any) -> str:
        status = solve(problem)
        for variable in problem.variables():
            if variable.shape == (4, 1):
                variable.value = 0.1 * variable.value
        return status

    monkeypatch.setattr(_checks, "solve", spoiled)
    with pytest.raises(DesignError, match=r"margins of \(8\)-\(10\)"):
        design.adaptation_design(4, 0.2)


def test_bounds_on_noise() -> None:
    assert design.smallest_p2(SP_K, SP_P, SP_D0, 1.0) == pytest.approx(1988.4, abs=0.05)
    # mean 0.02 and three standard deviations of 0.015
    assert design.smallest_p2(SP_K, SP_P, SP_D0, 0.065) == pytest.approx(8.4, abs=0.05)
    noise = design.largest_noise(SP_K, SP_P, SP_D0, 0.0025)
    assert noise == pytest.approx(1.12e-3, abs=5e-6)
    assert design.smallest_p2(SP_K, SP_P, SP_D0, noise) == pytest.approx(0.0025, rel=1e-12)


TABLES = [
    pytest.param(0.0025, 0.065, 1.9, (134.2, 136.9), 0.05, False, id="table1"),
    pytest.param(0.0025, 0.0, 2.22, (139.15, 141.98), 0.005, True, id="table2"),
    pytest.param(0.0001, 0.0, 2.22, (146.6, 149.4), 0.05, True, id="table3"),
]


@pytest.mark.parametrize(("p2", "noise", "nu1", "expected", "digits", "admitted"), TABLES)
def test_bounds_of_the_theorem(
    p2: float,
    noise: float,
    nu1: float,
    expected: tuple[float, float],
    digits: float,
    admitted: bool,
) -> None:
    found = design.error_bound(
        SP_K,
        SP_P,
        SP_B,
        SP_D0,
        SP_D1,
        p1=20.0,
        p2=p2,
        noise=noise,
        gamma=[0.1, 0.0],
        lipschitz=[nu1, 0.0],
    )
    np.testing.assert_allclose(found.log10, expected, atol=digits)
    assert found.noise_admitted is admitted
    for i in (1, 2):  # the minimum, of (15) as printed
        at = printed_bound(i, float(found.s[i - 1]), p2, noise, nu1)
        assert found.log10[i - 1] == pytest.approx(at, abs=1e-9)
        for factor in (0.99, 1.01):
            beside = printed_bound(i, factor * float(found.s[i - 1]), p2, noise, nu1)
            assert beside > found.log10[i - 1]


def printed_bound(i: int, s: float, p2: float, noise: float, nu1: float) -> float:
    """log10 of the braces of (15), term by term as printed (n = 2: it does not overflow)."""
    n, p1, b, d0, d1 = 2, 20.0, SP_B, SP_D0, SP_D1
    low, high = np.linalg.eigvalsh(SP_P)
    c0 = 2.0 * high / d0
    c1 = c0 * float(SP_K @ SP_K)
    l_hat = 2.0 / low * nu1**2

    def a1(at: float) -> float:
        return 2.0 * c0 * 0.1**2 / at**2

    a2 = max(s**b, s ** (b + n - 1)) ** 2 * high / low
    common = s ** (2 * b) * d0 * low * (d0 - c0 * l_hat / s**2)
    tilde = p1 * (4 * a2 * c1 * noise**2 + a2 * a1(s)) / common - p1 * p2 * 2 * a2 * c1 / common
    tilde += (4 * c1 * s ** (1 - 2 * b) * a2 / (d0 * low * (2 * n + 1))) * (
        2 * (d1 * p1 * p2 + c0 * l_hat) / d0
    ) ** ((2 * n + 1) / (1 + 2 * b))
    tilde = max(tilde, 4 * p1 * (a1(1.0) + c1 * noise**2) / (d0**2 * low))
    b1 = tilde ** (1 - 2 * b) + (2 * d1 + 2 * c0 * l_hat / (p1 * p2)) * tilde + 2
    b2 = 4.0 / (d0 * low) * a1(1.0)
    denominator = low * (d0 * s**2 - c0 * l_hat)
    first = s ** (2 * i) * (a1(s) + 2 * c1 * noise**2) / denominator
    second = 2 * c1 * (b1 + b2 / p2) ** (2 * n / (1 - 2 * b)) * p2
    return math.log10(first + second / (s ** (2 * (n - i)) * denominator))


def test_bound_for_vanishing_mismatch() -> None:
    arguments = (SP_K, SP_P, SP_B, SP_D0, SP_D1)
    noise = design.largest_noise(SP_K, SP_P, SP_D0, 0.0025) * (1.0 - 1e-12)
    known: dict[str, Any] = {"p1": 20.0, "p2": 0.0025, "lipschitz": [1.9, 0.0]}
    sixteen = design.error_bound_vanishing(*arguments, noise=noise, **known)
    fifteen = design.error_bound(*arguments, noise=noise, gamma=[0.0, 0.0], **known)
    np.testing.assert_allclose(sixteen.log10, fifteen.log10, atol=1e-9)
    assert sixteen.noise_admitted
    quiet = design.error_bound_vanishing(
        *arguments, noise=0.0, p1=20.0, p2=1e-12, lipschitz=[0.0, 0.0]
    )
    assert np.all(quiet.log10 < sixteen.log10)  # Corollary 2.7: small with p2


def test_bound_does_not_overflow_at_order_six() -> None:
    found = design.adaptation_design(6, 0.45)
    bound = design.error_bound(
        found.k,
        found.p,
        found.b,
        found.d0,
        found.d1,
        p1=10.0,
        p2=0.01,
        noise=0.0,
        gamma=np.full(6, 0.1),
        lipschitz=np.full(6, 1.0),
    )
    assert np.all(np.isfinite(bound.log10)) and np.all(bound.log10 > 308.0)


def test_repulsion() -> None:
    k_bar = design.repulsion_gains(SP_P, 0.026)
    np.testing.assert_allclose(k_bar, [0.0558, 0.0317], atol=5e-5)
    np.testing.assert_allclose(SP_P @ k_bar, [0.026, 0.0], atol=1e-15)
    assert design.collection_gain(2.22, 2.0, k_bar[0], 3) == pytest.approx(1.2114, abs=5e-5)
    with pytest.raises(DesignError, match=r"k1 - copies\*k_bar1"):
        design.collection_gain(2.22, 2.0, 0.7, 3)


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: design.best_d(SP_K, SP_P, 0.5), "b = 0.5: must be finite and > 0 and < 0.5"),
        (lambda: design.best_d(SP_K, -SP_P, 0.2), "smallest eigenvalue of P"),
        (lambda: design.best_d([1.0, 2.0, 3.0], SP_P, 0.2), "P = "),
        (lambda: design.check_adaptation(SP_K, SP_P, 0.2, -1.0, 1.0), "d0 = -1.0"),
        (lambda: design.adaptation_design(13, 0.2), "n = 13: must be an integer >= 1 and <= 12"),
        (lambda: design.adaptation_design(2, 0.2, d0=0.0), "d0 = 0.0"),
        (lambda: design.repulsion_gains(SP_P, -1.0), "mu = -1.0"),
        (lambda: design.largest_noise(SP_K, SP_P, 0.3, np.inf), "p2 = inf: must be finite"),
    ],
)
def test_bad_adaptation_arguments_are_refused(call: Any, match: str) -> None:
    with pytest.raises(DesignError, match=match):
        call()


# --- low power --------------------------------------------------------------------------------


def test_strong_stability_of_the_paper() -> None:
    for alpha, beta in (
        (ASTOLFI_ALPHA, ASTOLFI_BETA),
        (lambda c: (c.alpha, c.beta))(design.low_power_coefficients(ASTOLFI_POLES)),
    ):
        found = design.low_power_strong_stability(alpha, beta)
        assert found.hurwitz and found.positive and found.strong and found.small_gain_holds
        np.testing.assert_allclose(found.small_gain, [0.5327, 0.6320, 0.4212], atol=5e-5)
        np.testing.assert_allclose(found.circle, [0.4783, 0.5268, 0.3802], atol=5e-5)


def test_circle_criterion_is_the_dense_maximum() -> None:
    found = design.low_power_strong_stability(ASTOLFI_ALPHA, ASTOLFI_BETA)
    m = design.low_power_matrix(ASTOLFI_ALPHA, ASTOLFI_BETA)
    omega = np.geomspace(1e-2, 1e2, 40001)
    for i in (2, 3, 4):
        inner, block = m[: 2 * i - 2, : 2 * i - 2], m[2 * i - 2 : 2 * i, 2 * i - 2 : 2 * i]
        alpha, beta = -block[0, 0], -block[1, 0]
        s = 1j * omega
        # (B^T (s - M)^-1 B) and eta_i over eta_{i-1}: beta s/(s^2 + alpha s + beta)
        first = np.linalg.solve(s[:, None, None] * np.eye(2 * i - 2) - inner, np.eye(2 * i - 2))
        second = beta * s / (s**2 + alpha * s + beta)
        assert np.max(np.abs(first[:, -1, -1])) == pytest.approx(found.gamma[i - 2], rel=1e-6)
        assert np.max((first[:, -1, -1] * second).real) == pytest.approx(
            found.circle[i - 2], abs=1e-6
        )


def common_lyapunov_matrix(alpha: np.ndarray, beta: np.ndarray, i: int) -> bool:
    """Whether one P_i of (13) serves Lambda_i(0) and Lambda_i(1), hence all s between."""
    import cvxpy as cp

    full = design.low_power_matrix(alpha, beta)[: 2 * i, : 2 * i]
    cut = full.copy()
    cut[2 * i - 3, 2 * i - 1] = 0.0
    p = cp.Variable((2 * i, 2 * i), symmetric=True)
    eye = np.eye(2 * i)
    constraints = [p >> 0, p << eye]
    t = cp.Variable()
    constraints += [a.T @ p + p @ a + t * eye << 0 for a in (full, cut)]
    cp.Problem(cp.Maximize(t), constraints).solve(solver=cp.CLARABEL)
    worst = max(np.linalg.eigvalsh(a.T @ p.value + p.value @ a)[-1] for a in (full, cut))
    return bool(np.linalg.eigvalsh(p.value)[0] > 0.0 and worst < -1e-7)


def test_circle_criterion_agrees_with_a_common_lyapunov_matrix() -> None:
    for i in (2, 3, 4):
        assert common_lyapunov_matrix(ASTOLFI_ALPHA, ASTOLFI_BETA, i)
    seven = design.low_power_coefficients(equidistant(7))
    found = design.low_power_strong_stability(seven.alpha, seven.beta)
    assert [bool(value < 1.0) for value in found.circle] == [True, True, False, True, True]
    assert not common_lyapunov_matrix(seven.alpha, seven.beta, 4)


def test_pole_placement_alone_fails_from_order_seven() -> None:
    strong = []
    for n in range(2, 13):
        found = design.low_power_coefficients(equidistant(n))
        result = design.low_power_strong_stability(found.alpha, found.beta)
        assert result.hurwitz and result.positive
        strong.append(result.strong)
    assert strong == [n < 7 for n in range(2, 13)]


def test_lemma_2_is_sufficient_not_necessary() -> None:
    seven = design.low_power_coefficients(equidistant(7))
    found = design.low_power_strong_stability(seven.alpha, seven.beta)
    assert found.small_gain[1] > 1.0 > found.circle[1]
    assert np.all(found.circle <= found.small_gain)


@pytest.mark.parametrize("n", range(2, 13))
def test_small_gain_design(n: int) -> None:
    found = design.low_power_small_gain_design(n, decay=1.0)
    result = design.low_power_strong_stability(found.alpha, found.beta)
    assert result.strong
    np.testing.assert_allclose(result.small_gain, 0.5, rtol=1e-6)
    poles_found = np.linalg.eigvals(design.low_power_matrix(found.alpha, found.beta))
    assert np.max(poles_found.real) == pytest.approx(-1.0, rel=1e-5)


def test_the_printed_inequality_is_inverted() -> None:
    found = design.low_power_small_gain_design(5, ASTOLFI_ALPHA, ASTOLFI_BETA[0], margin=0.9)
    result = design.low_power_strong_stability(found.alpha, found.beta)
    np.testing.assert_allclose(result.small_gain, 0.9, rtol=1e-9)
    # beta_i/alpha_i = 2.5/gamma_{i-1}, as the paper prints (">= 1/gamma")
    beta = found.beta.copy()
    beta[1] *= 2.5 / 0.9
    inverted = design.low_power_strong_stability(found.alpha, beta)
    assert inverted.small_gain[0] == pytest.approx(2.5, rel=1e-9)
    assert not inverted.strong


def test_peaks_of_random_systems() -> None:
    rng = np.random.default_rng(11)
    for _ in range(60):
        n = int(rng.integers(1, 8))
        a = rng.normal(size=(n, n))
        a -= np.eye(n) * (np.max(np.linalg.eigvals(a).real) + 10.0 ** rng.uniform(-2, 0))
        b, c = rng.normal(size=(2, n))
        norm, real = design.h_infinity_norm(a, b, c), design.largest_real_part(a, b, c)
        modes = np.linalg.eigvals(a)
        omega = np.concatenate(
            [
                np.linspace(0.0, 3.0 * np.max(np.abs(modes)), 1000),
                *[abs(z.imag) + abs(z.real) * np.linspace(-3.0, 3.0, 400) for z in modes],
            ]
        )
        values = np.linalg.solve(
            1j * omega[:, None, None] * np.eye(n) - a,
            np.broadcast_to(b[:, None], (omega.size, n, 1)),
        )
        response = (c @ values)[:, 0]
        assert norm == pytest.approx(np.max(np.abs(response)), rel=1e-3)
        assert norm >= np.max(np.abs(response)) * (1.0 - 1e-9)
        assert real >= np.max(response.real) - 1e-9 * norm
        assert real <= max(np.max(response.real), 0.0) + 1e-3 * norm


def test_peak_of_a_known_system() -> None:
    # |1/(s^2 + 2 zeta s + 1)| peaks at 1/(2 zeta sqrt(1 - zeta^2))
    zeta = 0.1
    a, b, c = [[0.0, 1.0], [-1.0, -2.0 * zeta]], [0.0, 1.0], [1.0, 0.0]
    expected = 1.0 / (2.0 * zeta * math.sqrt(1.0 - zeta**2))
    assert design.h_infinity_norm(a, b, c) == pytest.approx(expected, rel=1e-10)
    omega = np.linspace(0.8, 1.0, 2_000_001)
    real = (1.0 / (1.0 - omega**2 + 2j * zeta * omega)).real
    assert design.largest_real_part(a, b, c) == pytest.approx(np.max(real), rel=1e-9)
    assert design.h_infinity_norm(a, b, [0.0, 0.0]) == 0.0


def test_low_power_refusals() -> None:
    with pytest.raises(DesignError, match=r"margin = 1\.0: must be finite and > 0 and < 1"):
        design.low_power_small_gain_design(4, margin=1.0)
    with pytest.raises(DesignError, match=r"alpha = .*> 0 in every entry"):
        design.low_power_small_gain_design(3, [1.0, -1.0, 1.0])
    with pytest.raises(DesignError, match="n = 1"):
        design.low_power_small_gain_design(1)
    with pytest.raises(DesignError, match="eigenvalues of A"):
        design.h_infinity_norm([[1.0]], [1.0], [1.0])
    negative = design.low_power_strong_stability([1.0, -1.0, 1.0], [1.0, 1.0])
    assert not negative.positive and not negative.strong


# --- step limits ------------------------------------------------------------------------------

CONSTANT = {"law": "constant", "ell": 1.0}
STANDARD: dict[str, Any] = {
    "kind": "standard",
    "n": 5,
    "k": ASTOLFI_K,
    "gain": CONSTANT,
    "model": {"kind": "none"},
}
LOW_POWER: dict[str, Any] = {
    "kind": "low-power",
    "n": 5,
    "alpha": ASTOLFI_ALPHA,
    "beta": PRINTED_BETA,
    "gain": CONSTANT,
    "model": {"kind": "none"},
}
PEAKING_FREE: dict[str, Any] = {**LOW_POWER, "kind": "peaking-free", "saturation": [3.0] * 4}
METHODS = ("euler", "staggered-euler", "rk4", "rk4-innovation-held", "bogacki-shampine")


@pytest.mark.parametrize(
    ("method", "expected"),
    [
        ("euler", (1.000, 0.979, 0.350)),
        ("rk4", (1.392, 1.369, 0.894)),
        ("rk4-innovation-held", (0.273, 0.636, 0.665)),
    ],
)
def test_step_limits_of_the_paper(method: str, expected: tuple[float, float, float]) -> None:
    for spec, c in zip((STANDARD, LOW_POWER, PEAKING_FREE), expected, strict=True):
        found = design.step_limit({**spec, "method": method})
        assert found.bounded == pytest.approx(c, rel=0.01)
        assert found.c <= found.bounded


@pytest.mark.parametrize(
    ("law", "timing", "expected"),
    [
        ("standard", "predictor", (1.0, 0.34925, 1.392646, 0.44949, 1.256372)),
        ("standard", "current", (0.359051, 0.34925, 0.353959, 0.353959, 0.353959)),
        ("complex", "predictor", (0.4, 0.424527, 1.18651, 0.718096, 1.134333)),
        ("complex", "current", (0.460197, 0.424527, 0.440394, 0.440394, 0.440394)),
        ("low-power", "predictor", (1.0, 0.552467, 1.392646, 0.637537, 1.256372)),
        ("low-power", "current", (0.385783, 0.391192, 0.424494, 0.424494, 0.414749)),
    ],
)
def test_step_limits_of_matrices(law: str, timing: str, expected: tuple[float, ...]) -> None:
    """The law's own steps against figures from its matrices, A - K C and M_n written out, and from
    each method's polynomial in them.
    """
    complex_pair = design.observer_coefficients([-1, -1 + 2j, -1 - 2j])
    spec: dict[str, Any] = {
        "standard": {**STANDARD, "n": 3, "k": design.observer_coefficients([-1, -1.5, -2])},
        "complex": {**STANDARD, "n": 3, "k": complex_pair},
        "low-power": LowPowerObserver(5, 1.0).spec,
    }[law]
    for method, c in zip(METHODS, expected, strict=True):
        found = design.step_limit({**spec, "method": method, "timing": timing})
        assert found.c == pytest.approx(c, rel=1e-4)


def test_block_1_decides_while_saturated() -> None:
    euler = design.step_limit({**PEAKING_FREE, "method": "euler"})
    assert euler.parts["block 1"] == pytest.approx(3.0 / 8.5714, rel=1e-4)  # alpha_1/beta_1
    for method in ("euler", "rk4", "bogacki-shampine", "staggered-euler"):
        found = design.step_limit({**PEAKING_FREE, "method": method})
        assert found.c == found.bounded == found.parts["block 1"] == min(found.parts.values())
    held = design.step_limit({**PEAKING_FREE, "method": "rk4-innovation-held"})
    assert held.c == held.parts["linear"] < held.bounded == held.parts["block 1"]


def radius_of(spec: dict[str, Any], c: float) -> float:
    """Spectral radius of one step of the reference observer, from steps of the unit vectors."""
    observer = Observer(spec)
    columns = [observer.step(unit, 0.0, None, 0.0, c)[0] for unit in np.eye(observer.memory_len)]
    return float(np.max(np.abs(np.linalg.eigvals(np.array(columns).T))))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["standard", "low-power", "order-1", "complex", "order-9"])
def test_step_limit_is_where_the_observer_turns_unstable(method: str, kind: str) -> None:
    nine = design.low_power_small_gain_design(9, decay=1.0)
    spec: dict[str, Any] = {
        "standard": STANDARD,
        "low-power": LOW_POWER,
        "order-1": {**STANDARD, "n": 1, "k": [2.0]},
        "complex": {**STANDARD, "n": 3, "k": design.observer_coefficients([-1, -1 + 2j, -1 - 2j])},
        "order-9": {**LOW_POWER, "n": 9, "alpha": nine.alpha, "beta": nine.beta},
    }[kind]
    spec = {**spec, "method": method}
    c = design.step_limit(spec).c
    assert radius_of(spec, 0.999 * c) < 1.0 < radius_of(spec, 1.001 * c)
    assert all(radius_of(spec, fraction * c) < 1.0 for fraction in (0.02, 0.3, 0.6, 0.9))


@pytest.mark.parametrize(
    ("method", "c", "bounded"),
    [
        ("euler", 0.345, True),
        ("euler", 0.36, False),
        ("rk4-innovation-held", 0.655, True),  # M_n is unstable here, the saturations hold it
        ("rk4-innovation-held", 0.68, False),
    ],
)
def test_saturation_bounds_what_block_1_admits(method: str, c: float, bounded: bool) -> None:
    spec = {**PEAKING_FREE, "method": method}
    assert (c < design.step_limit(spec).bounded) is bounded
    observer = Observer(spec)
    memory = np.full(observer.memory_len, 1e3)  # far into the saturation
    largest = 0.0
    for _ in range(1500):
        memory, _ = observer.step(memory, 0.0, None, 0.0, c)
        largest = max(largest, float(np.max(np.abs(memory))))
        if largest > 1e9:
            break
    assert (largest < 1e6) is bounded


def test_gain_sets_the_step() -> None:
    fast = design.step_limit({**STANDARD, "gain": {"law": "constant", "ell": 70.0}})
    assert fast.dt == pytest.approx(1.0 / 70.0)
    adaptive = {"law": "adaptive", "p1": 10.0, "p2": 0.0025, "b": 0.183}
    moving = design.step_limit({**STANDARD, "n": 2, "k": SP_K, "gain": adaptive})
    assert moving.dt == pytest.approx(1.0) and moving.dt_at(4.0) == pytest.approx(0.25)


def test_collection_counts_the_motion_of_the_copies() -> None:
    k_bar = design.repulsion_gains(SP_P, 0.026)
    gain = {"law": "adaptive", "p1": 10.0, "p2": 0.0025, "b": 0.183}
    spec = {"kind": "collection", "k": SP_K, "k_bar": k_bar, "copies": 3, "gain": gain}
    found = design.step_limit(spec)
    apart = design.schur_limit(design.companion(SP_K - 3 * k_bar))
    assert found.parts["linear"] == pytest.approx(1.0, rel=1e-5)
    assert found.c == found.parts["copies apart"] == pytest.approx(apart, rel=1e-5)
    modified = design.step_limit({**spec, "kind": "modified"})
    assert modified.parts == pytest.approx(dict(found.parts), rel=1e-12)
    strong = design.step_limit({**spec, "k_bar": [0.7, 0.7]})  # repulsion beyond any step's fault
    assert strong.parts == {"linear": pytest.approx(found.parts["linear"], rel=1e-12)}


def test_reduced_order_limit_is_assumption_a5() -> None:
    spec = {"kind": "reduced-order", "h_bar": [0.1, 0.2, 0.2], "epsilon": 0.01}
    found = design.step_limit(spec)
    assert found.dt == pytest.approx(0.1) and found.c == pytest.approx(10.0)
    design.check_step(spec, 0.099)
    with pytest.raises(DesignError, match=r"dt = 0.101: must be < 0.1 s"):
        design.check_step(spec, 0.101)
    design.check_step(spec, 0.101, allow_unstable=True)


@pytest.mark.parametrize(("gain", "almost_surely"), [("printed", 0.403), ("derived", 0.605)])
def test_sampled_data_limit(gain: str, almost_surely: float) -> None:
    spec = {"kind": "sampled-data", "model": {"kind": "van-der-pol", "epsilon": 0.8}, "gain": gain}
    found = design.step_limit(spec)
    assert found.dt == pytest.approx(almost_surely, abs=0.02)
    design.check_step(spec, 0.3)  # the paper's largest
    # mu constant: {-2, -3} for the derived gain, the worst mu on |y| <= 2.1 for the printed one
    if gain == "derived":
        frozen = 2.0 / 3.0
    else:
        mu = 0.8 * (1.0 - 2.1**2)
        error = np.array([[-(5.0 - mu), 1.0], [-(6.0 + (5.0 + mu) * mu), mu]])
        frozen = design.schur_limit(error)
    assert found.parts["worst frozen mu"] == pytest.approx(frozen, rel=1e-6)


def test_sampled_data_limit_without_a_cycle() -> None:
    for epsilon in (0.0, -0.5):  # y -> 0, so mu is constant
        model = {"kind": "van-der-pol", "epsilon": epsilon}
        found = design.step_limit({"kind": "sampled-data", "model": model})
        assert found.dt == pytest.approx(2.0 / 3.0, abs=0.01)


def test_step_limit_takes_few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bisection over matrices of one step: their number is bounded, whatever the machine."""
    made: list[int] = []
    steps = sys.modules["hgo_rs.design.discrete"].Steps  # type: ignore[attr-defined]
    before = steps._from

    def counted(*given: Any) -> Any:
        made.append(1)
        return before(*given)

    monkeypatch.setattr(steps, "_from", counted)
    for spec in (STANDARD, LOW_POWER, PEAKING_FREE):
        for method in METHODS:
            made.clear()
            discretisation._critical.cache_clear()
            design.step_limit({**spec, "method": method})
            assert len(made) <= 600, (spec["kind"], method, len(made))


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"kind": "kalman"}, "kind = 'kalman': must be one of 'standard'"),
        ({"method": "heun"}, "method = 'heun'"),
        ({"k": [1.0, -1.0]}, r"k = \[1.0, -1.0\]: must be of shape \(5,\)"),
        ({"n": 2, "k": [1.0, -1.0]}, r"k = 1 is not allowed: .* left half plane"),
        ({"gain": {"law": "constant", "ell": 0.0}}, "gain.ell = 0.0"),
        ({"gain": {"law": "scheduled"}}, "law = 'scheduled'"),
        ({"gain": {}}, "law = None: must be given; add 'law' to the spec"),
    ],
)
def test_bad_specs_are_refused(change: dict[str, Any], match: str) -> None:
    with pytest.raises(DesignError, match=match):
        design.step_limit({**STANDARD, **change})


def test_check_step_names_the_limit() -> None:
    spec = {**STANDARD, "gain": {"law": "constant", "ell": 100.0}}
    design.check_step(spec, 0.0099)
    with pytest.raises(DesignError, match=r"dt = 0.01: must be < 0.01 s.*by euler.*allow_unstable"):
        design.check_step(spec, 0.01)
    with pytest.raises(DesignError, match="dt = nan"):
        design.check_step(spec, np.nan)


# --- errors and imports -----------------------------------------------------------------------


def test_errors_are_value_errors_that_explain_themselves() -> None:
    assert issubclass(DesignError, HgoError) and issubclass(HgoError, ValueError)
    assert issubclass(MissingExtraError, ImportError)
    with pytest.raises(HgoError, match="dt = -1: must be finite and > 0; choose a value in this"):
        check_number(-1, "dt", above=0)
    with pytest.raises(HgoError, match=r"n = 2\.5: must be an integer >= 1 and <= 12"):
        check_integer(2.5, "n", least=1, most=12)
    with pytest.raises(HgoError, match="n = True"):
        check_integer(True, "n", least=1)
    assert check_integer(np.int64(3), "n", least=1) == 3
    with pytest.raises(HgoError, match="x = 'a': must be a number"):
        check_number("a", "x")


def test_missing_cvxpy_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cvxpy", None)
    for call in (
        lambda: design.adaptation_design(2, 0.2),
        lambda: design.lmi_step(design.companion(LEE_H), 0.5),
    ):
        with pytest.raises(MissingExtraError, match=r'pip install "hgo_rs\[design\]"'):
            call()


def test_import_loads_numpy_alone() -> None:
    code = (
        "import sys, hgo_rs.design\n"
        "hgo_rs.design.step_limit({'kind': 'standard', 'k': [2, 2],"
        " 'gain': {'law': 'constant', 'ell': 1}})\n"
        "print([m for m in ('scipy', 'cvxpy', 'clarabel', 'matplotlib', 'pandas')"
        " if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
