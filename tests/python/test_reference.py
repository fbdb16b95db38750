"""The NumPy reference against truths that it does not contain.

Exact covariances (SciPy's Lyapunov solver), DOP853, matrix exponentials, spectral radii, known
answers of the random generators, and figures of the papers.
"""

from __future__ import annotations

import ast
import itertools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy import signal, stats
from scipy.integrate import simpson, solve_ivp
from scipy.linalg import expm, solve_discrete_lyapunov

from hgo_rs import reference
from hgo_rs.reference import Observer, coupled_paths, mean_covariance, polynomial, simulate
from hgo_rs.reference.integrate import brownian
from hgo_rs.reference.models import Ship
from hgo_rs.reference.noise import Streams, filtered, mix
from hgo_rs.reference.observers import law_from
from hgo_rs.reference.placement import chain_gains, low_power_gains

Spec = dict[str, Any]

NONE = {"kind": "none"}
CRACKLE = {"kind": "crackle", "phi_max": 3.0}
LEE = {"kind": "lee"}
VAN_DER_POL = {"kind": "van-der-pol", "epsilon": 0.8, "sigma": 0.5}
ADAPTIVE = {"law": "adaptive", "p1": 10.0, "p2": 0.0025, "b": 0.183}
K5 = [7.5, 22.1875, 32.34375, 23.21875, 6.5625]
ALPHA, BETA = polynomial.low_power_coefficients_from_poles([*np.linspace(-1.0, -2.0, 8), -2.0])
# The paper's tables were computed with the four digits that it prints.
PRINTED_BETA = np.array([8.5714, 3.2122, 1.4267, 0.5347])
METHODS = ("euler", "staggered-euler", "rk4", "rk4-innovation-held", "bogacki-shampine")


def constant(ell: float) -> Spec:
    return {"law": "constant", "ell": ell}


def fixed(dt: float) -> Spec:
    return {"kind": "fixed", "dt": dt}


def standard(k: Any, gain: Spec, model: Spec = NONE, method: str = "euler") -> Spec:
    return {
        "kind": "standard",
        "n": len(k),
        "k": k,
        "gain": gain,
        "model": model,
        "method": method,
    }


def low_power(
    ell: float, model: Spec = NONE, method: str = "euler", kind: str = "low-power", clip: str = ""
) -> Spec:
    spec: Spec = {"kind": kind, "n": 5, "alpha": ALPHA, "beta": BETA, "gain": constant(ell)}
    spec |= {"model": model, "method": method}
    if kind == "peaking-free":
        spec |= {"saturation": [3.0] * 4, "clip": clip or "hard"}
    return spec


def integrated(rate: Callable[[float, Any], Any], t_end: float, start: Any) -> np.ndarray:
    """The solution at ``t_end`` by DOP853 at its tightest tolerance."""
    solution = solve_ivp(
        rate, (0.0, t_end), np.asarray(start, float), "DOP853", rtol=1e-13, atol=1e-13
    )
    return np.asarray(solution.y[:, -1])


def order(errors: list[float], ratio: float = 2.0) -> float:
    """Convergence order from errors at steps h, h/ratio, h/ratio^2, ..."""
    slopes = np.diff(-np.log(errors)) / np.log(ratio)
    return float(slopes[-1])


# --- floors -----------------------------------------------------------------------------------


def test_the_reference_imports_numpy_only() -> None:
    folder = Path(reference.__file__).parent
    files = sorted(folder.glob("*.py"))
    assert len(files) >= 9
    for file in files:
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                roots = [alias.name.split(".")[0] for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                assert node.level <= 1, f"{file.name} imports from outside the reference"
                roots = [] if node.level else [str(node.module).split(".")[0]]
            else:
                continue
            for root in roots:
                assert root == "numpy" or root in sys.stdlib_module_names, (file.name, root)


# --- random numbers ---------------------------------------------------------------------------


def test_xoshiro_known_answers() -> None:
    streams = Streams.from_state([[1, 5], [2, 6], [3, 7], [4, 8]])
    words = streams.words(10)
    assert words[:, 0].tolist() == [
        41943041,
        58720359,
        3588806011781223,
        3591011842654386,
        9228616714210784205,
        9973669472204895162,
        14011001112246962877,
        12406186145184390807,
        15849039046786891736,
        10450023813501588000,
    ]
    assert words[:, 1].tolist() == xoshiro_in_integers([5, 6, 7, 8], 10)


def xoshiro_in_integers(state: list[int], count: int) -> list[int]:
    mask = (1 << 64) - 1
    s = list(state)
    out = []
    for _ in range(count):
        total = (s[0] + s[3]) & mask
        out.append(((((total << 23) | (total >> 41)) & mask) + s[0]) & mask)
        t = (s[1] << 17) & mask
        s[2] ^= s[0]
        s[3] ^= s[1]
        s[1] ^= s[2]
        s[0] ^= s[3]
        s[2] ^= t
        s[3] = ((s[3] << 45) | (s[3] >> 19)) & mask
    return out


def test_splitmix_known_answers() -> None:
    seed = 1477776061723855037
    states = np.array([seed], dtype=np.uint64) + np.arange(3, dtype=np.uint64) * np.uint64(
        0x9E3779B97F4A7C15
    )
    assert mix(states).tolist() == [
        1985237415132408290,
        2979275885539914483,
        13511426838097143398,
    ]


def test_a_run_draws_the_same_whatever_the_runs_beside_it() -> None:
    all_runs = Streams(7, 5, 0).words(20)
    later = Streams(7, 2, 0, first_run=3).words(20)
    np.testing.assert_array_equal(all_runs[:, 3:], later)
    assert len(np.unique(all_runs)) == all_runs.size
    assert not np.any(Streams(7, 5, 1).words(20) == all_runs)
    assert not np.any(Streams(8, 5, 0).words(20) == all_runs)


def test_blocks_of_draws_join_without_a_seam() -> None:
    whole, parts = Streams(1, 3, 0), Streams(1, 3, 0)
    np.testing.assert_array_equal(
        whole.words(50), np.concatenate([parts.words(n) for n in (1, 20, 29)])
    )


def test_uniform_and_normal_draws_have_their_distributions() -> None:
    streams = Streams(3, 50, 0)
    uniform = streams.uniform(400).reshape(-1)
    assert uniform.min() >= 0.0
    assert uniform.max() < 1.0
    assert stats.kstest(uniform, "uniform").pvalue > 1e-3
    first, second = streams.normal_pairs(400)
    assert stats.kstest(first.reshape(-1), "norm").pvalue > 1e-3
    assert stats.kstest(second.reshape(-1), "norm").pvalue > 1e-3
    assert abs(np.mean(first * second)) < 4.0 / np.sqrt(first.size)


def test_brownian_increments_have_the_exact_covariance() -> None:
    h = 0.3
    dw, dz = brownian(h, *Streams(5, 200, 1).normal_pairs(1000))
    measured = np.cov(dw.reshape(-1), dz.reshape(-1))
    exact = np.array([[h, h**2 / 2.0], [h**2 / 2.0, h**3 / 3.0]])
    np.testing.assert_allclose(measured, exact, rtol=0.02)


def test_second_order_sections_filter_as_scipy_does() -> None:
    sections = signal.butter(
        6, [50.0, 200.0], "bandpass", fs=10_000.0 / (2.0 * np.pi), output="sos"
    )
    white = Streams(2, 3, 0).normal_pairs(500)[0].T
    expected = signal.sosfilt(sections, white, axis=-1)
    np.testing.assert_allclose(filtered(white, sections), expected, rtol=1e-9, atol=1e-12)


# --- coefficients -----------------------------------------------------------------------------


def test_coefficients_of_the_papers() -> None:
    k = polynomial.coefficients_from_poles(np.linspace(-1.0, -2.0, 5))
    np.testing.assert_allclose(k, K5, rtol=1e-14)
    np.testing.assert_allclose(ALPHA, [3.0, 3.0, 3.0, 3.0, 2.0], rtol=1e-12)
    np.testing.assert_allclose(BETA, [8.571429, 3.212245, 1.426736, 0.534670], atol=5e-7)
    np.testing.assert_allclose(
        polynomial.coefficients_from_poles([-1.0 + 1.0j, -1.0 - 1.0j]), [2.0, 2.0], rtol=1e-15
    )


@pytest.mark.parametrize("n", range(1, 13))
def test_low_power_coefficients_give_back_any_hurwitz_polynomial(n: int) -> None:
    rng = np.random.default_rng(n)
    sets = [np.linspace(-1.0, -2.0, 2 * n - 1), -np.ones(2 * n - 1)]
    for _ in range(10):
        pairs = int(rng.integers(0, n))
        real = -rng.uniform(0.05, 3.0, pairs)
        imaginary = rng.uniform(0.1, 3.0, pairs)
        left = -rng.uniform(0.3, 3.0, 2 * n - 1 - 2 * pairs)
        sets.append(np.concatenate((real + 1j * imaginary, real - 1j * imaginary, left)))
    for poles in sets:
        asked = polynomial.coefficients_from_poles(poles)
        for alpha, beta in (
            polynomial.low_power_coefficients(asked),
            polynomial.low_power_coefficients_from_poles(poles),
        ):
            assert len(alpha) == n
            assert len(beta) == n - 1
            given = polynomial.low_power_polynomial(alpha, beta)
            np.testing.assert_allclose(given, asked, rtol=1e-12)


@pytest.mark.parametrize("n", [2, 3, 5])
def test_low_power_polynomial_is_that_of_the_papers_matrix(n: int) -> None:
    rng = np.random.default_rng(n)
    alpha, beta = rng.uniform(0.5, 3.0, n), rng.uniform(0.5, 3.0, n - 1)
    matrix = polynomial.low_power_matrix(alpha, beta)
    np.testing.assert_allclose(
        polynomial.low_power_polynomial(alpha, beta), np.poly(matrix)[1:], rtol=1e-10
    )


def test_routh_hurwitz_agrees_with_the_roots() -> None:
    rng = np.random.default_rng(0)
    verdicts = []
    for _ in range(300):
        c = rng.uniform(-0.5, 4.0, int(rng.integers(1, 6)))
        stable = bool(np.all(np.roots([1.0, *c]).real < 0.0))
        assert polynomial.is_hurwitz(c) == stable
        verdicts.append(stable)
    assert 30 < sum(verdicts) < 270
    assert not polynomial.is_hurwitz([1.0, np.nan])


# --- schemes ----------------------------------------------------------------------------------


def lee_rate(_: float, x: Any) -> Any:
    return [x[1], -x[0] / (1.0 + x[0] ** 2) - x[1]]


@pytest.mark.parametrize(
    ("method", "expected"), [("euler", 1), ("bogacki-shampine", 3), ("rk4", 4)]
)
def test_order_of_the_plant_schemes(method: str, expected: int) -> None:
    exact = integrated(lee_rate, 2.0, [10.0, 10.0])
    errors = []
    for steps in (10, 20, 40, 80):
        spec = {
            "plant": LEE,
            "observer": standard([2.0, 2.0], constant(1.0)),
            "steps": steps // 2,
            "schedule": fixed(4.0 / steps),
            "substeps": 2,
            "plant_method": method,
            "x0": [10.0, 10.0],
            "memory0": [0.0, 0.0],
        }
        errors.append(float(np.abs(simulate(spec)["final_x"][0] - exact).max()))
    assert order(errors) == pytest.approx(expected, abs=0.2)


def crackle_phi(x: Any) -> float:
    return float(0.2 * (x[0] ** 2 - 1.0) - x[1] - x[2] - 4.0 * x[3] - x[4])


def peaking_free_rate(
    memory: Any, y: float, ell: float, r: float, phi_max: float = 3.0
) -> np.ndarray:
    """Astolfi et al. (11) written out, for n = 5."""
    x, eta = memory[:5], memory[5:]
    s = np.clip(eta, -r, r)
    e = np.array([y - x[0], *(s - x[1:])])
    phi = np.clip(crackle_phi(x), -phi_max, phi_max)
    x_rate = np.array([*eta, phi]) + ALPHA * ell * e
    eta_rate = np.array([*s[1:], phi]) + BETA * ell**2 * e[:4]
    return np.concatenate((x_rate, eta_rate))


@pytest.mark.parametrize(
    ("method", "expected"), [("euler", 1), ("bogacki-shampine", 3), ("rk4", 4)]
)
def test_order_of_the_joint_integration(method: str, expected: int) -> None:
    wave = (0.3, 5.0, 0.4)

    def rate(t: float, s: Any) -> np.ndarray:
        y = s[0] + wave[0] * np.sin(wave[1] * t + wave[2])
        plant = [*s[1:5], crackle_phi(s)]
        return np.concatenate((plant, peaking_free_rate(s[5:], y, 2.0, 1e6, 1e6)))

    start = [-0.8, 0.0, 0.0, 0.0, 0.0]
    memory0 = [0.5, 0.2, -0.1, 0.1, 0.2, 0.0, 0.1, 0.0, -0.2]
    exact = integrated(rate, 1.0, [*start, *memory0])
    errors = []
    for steps in (16, 32, 64):
        spec = {
            "plant": CRACKLE,
            "observer": low_power(2.0, CRACKLE | {"phi_max": 1e6}, method),  # smooth
            "mode": "joint",
            "steps": steps,
            "schedule": fixed(1.0 / steps),
            "x0": start,
            "memory0": memory0,
            "noise": {"kind": "none", "sines": [wave]},
        }
        out = simulate(spec)
        final = np.concatenate((out["final_x"][0], out["final_memory"][0]))
        errors.append(float(np.abs(final - exact).max()))
    assert order(errors) == pytest.approx(expected, abs=0.25)


@pytest.mark.parametrize(
    ("method", "expected"),
    [("euler", 1), ("staggered-euler", 1), ("bogacki-shampine", 3), ("rk4", 4)],
)
def test_order_with_the_measurement_held(method: str, expected: int) -> None:
    """With a plant at rest y is constant, so a scheme converges to the law itself."""
    p1, p2, b, nu1 = 10.0, 0.0025, 0.183, 1.9

    def rate(_: float, z: Any) -> list[float]:
        e = -0.3 - z[0]
        r = z[2]
        return [
            z[1] + nu1 * z[0] + 2.0 * r * e,
            2.0 * r**2 * e,
            p1 * ((e**2 - p2) * r ** (1.0 - 2.0 * b) + p2 / r**4),
        ]

    memory0 = [1.0, 0.0, 1.5]
    exact = integrated(rate, 0.5, memory0)
    plant = {"kind": "sanfelice-praly", "nu1": nu1, "nu2": 0.1}
    errors = []
    for steps in (40, 80, 160):
        spec = {
            "plant": plant,
            "observer": standard([2.0, 2.0], ADAPTIVE, plant, method),
            "plant_method": "held",
            "steps": steps,
            "schedule": fixed(0.5 / steps),
            "x0": [-0.3, 0.0],
            "memory0": memory0,
        }
        errors.append(float(np.abs(simulate(spec)["final_memory"][0] - exact).max()))
    assert order(errors) == pytest.approx(expected, abs=0.25)


def test_innovation_held_freezes_the_output_error_only() -> None:
    """One small step of RK4 against DOP853 with e_1 frozen and the inner errors moving."""
    ell, y = 3.0, 0.7
    memory0 = np.array([0.2, -0.1, 0.3, 0.1, -0.2, 0.1, 0.0, 0.2, -0.3])
    e1 = y - memory0[0]
    dt = 0.001

    def rate(_: float, z: Any) -> np.ndarray:
        return peaking_free_rate(z, z[0] + e1, ell, 3.0)

    exact = integrated(rate, dt, memory0)
    spec = low_power(ell, CRACKLE, "rk4-innovation-held", "peaking-free")
    stepped, status = Observer(spec).step(memory0, y, None, 0.0, dt)
    assert status == 0
    np.testing.assert_allclose(stepped, exact, atol=1e-10)
    held = low_power(ell, CRACKLE, "rk4", "peaking-free")
    assert np.abs(Observer(held).step(memory0, y, None, 0.0, dt)[0] - exact).max() > 1e-6


def test_staggered_euler_moves_each_state_by_the_new_one_below() -> None:
    """Written as one sweep: eta_4 first, x_hat_1 last."""
    ell, y, dt, r = 3.0, 0.7, 0.05, 0.1
    memory = np.array([0.2, -0.1, 0.3, 0.1, -0.2, 0.3, -0.2, 0.2, -0.3])
    x, eta = memory[:5].copy(), memory[5:].copy()
    e = np.array([y - x[0], *(np.clip(eta, -r, r) - x[1:])])
    phi = np.clip(crackle_phi(x), -3.0, 3.0)
    new_eta, new_x = eta.copy(), x.copy()
    for i in (3, 2, 1, 0):
        below = phi if i == 3 else np.clip(new_eta[i + 1], -r, r)
        new_eta[i] = eta[i] + dt * (below + BETA[i] * ell**2 * e[i])
    for i in range(5):
        below = phi if i == 4 else new_eta[i]
        new_x[i] = x[i] + dt * (below + ALPHA[i] * ell * e[i])
    spec = low_power(ell, CRACKLE, "staggered-euler", "peaking-free") | {"saturation": [r] * 4}
    stepped, _ = Observer(spec).step(memory, y, None, 0.0, dt)
    np.testing.assert_allclose(stepped, np.concatenate((new_x, new_eta)), rtol=1e-13)


@pytest.mark.parametrize("clip", ["hard", "smooth"])
def test_saturations(clip: str) -> None:
    """One Euler step isolates sat(eta_2), level 0.5, in the rate of eta_1."""
    spec = low_power(1.0, NONE, "euler", "peaking-free", clip) | {
        "saturation": [9.0, 0.5, 9.0, 9.0]
    }
    law = Observer(spec)
    for s in (-2.0, -0.5, -0.2, 0.4, 0.5, 0.6, 30.0):
        memory = np.zeros(9)
        memory[6] = s
        passed = law.step(memory, 0.0, None, 0.0, 1.0)[0][5]
        if abs(s) <= 0.5:
            expected = s
        elif clip == "hard":
            expected = np.sign(s) * 0.5
        else:
            expected = np.sign(s) * (0.5 + (abs(s) - 0.5) / (abs(s) + 0.5))
        assert passed == pytest.approx(expected, rel=1e-14)
        assert abs(passed) < 1.5


# --- stochastic schemes -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "multiplicative", "expected"),
    [
        ("euler-maruyama", False, 1.0),
        ("euler-maruyama", True, 0.5),
        ("milstein", False, 1.0),
        ("milstein", True, 1.0),
        ("taylor-1.5", False, 2.0),  # 1.5 in general; here d2a/dx2^2 = 0
    ],
)
def test_strong_orders(method: str, multiplicative: bool, expected: float) -> None:
    coarse = np.array([16, 32, 64, 128])
    fine = 512
    errors = []
    for n in coarse:
        spec = {
            "plant": VAN_DER_POL | {"sigma": 1.0, "multiplicative": multiplicative},
            "x0": [1.0, 0.5],
            "t_end": 1.0,
            "coarse": int(n),
            "fine": int(fine // n),
            "method": method,
            "runs": 400,
            "seed": 4,
        }
        paths = coupled_paths(spec)
        gap = paths["coarse"] - paths["fine"]
        errors.append(float(np.sqrt(np.mean(np.sum(gap**2, axis=1)))))
    slope = np.polyfit(np.log(1.0 / coarse), np.log(errors), 1)[0]
    assert slope == pytest.approx(expected, abs=0.17)


def test_coarse_path_at_the_fine_step_is_the_fine_path() -> None:
    spec = {"plant": VAN_DER_POL, "x0": [1.0, 0.0], "t_end": 1.0, "coarse": 50, "fine": 1}
    paths = coupled_paths(spec | {"method": "taylor-1.5", "runs": 3})
    np.testing.assert_allclose(paths["coarse"], paths["fine"], rtol=1e-14)
    assert np.unique(paths["fine"][:, 0]).size == 3


def test_linear_diffusion_has_the_exact_mean_and_covariance() -> None:
    """epsilon = 0 is a harmonic oscillator under white noise: matrix exponential (van Loan)."""
    sigma, t_end, runs = 0.5, 2.0, 4000
    a = np.array([[0.0, 1.0], [-1.0, 0.0]])
    noise = np.array([[0.0, 0.0], [0.0, sigma**2]])
    block = expm(np.block([[-a, noise], [np.zeros((2, 2)), a.T]]) * t_end)
    transition = block[2:, 2:].T
    covariance = transition @ block[:2, 2:]
    spec = {
        "plant": {"kind": "van-der-pol", "epsilon": 0.0, "sigma": sigma},
        "observer": {"kind": "sampled-data", "model": VAN_DER_POL},
        "steps": 20,
        "schedule": fixed(t_end / 20),
        "plant_method": "taylor-1.5",
        "substeps": 4,
        "x0": [1.0, 0.0],
        "memory0": [0.0, 0.0],
        "runs": runs,
        "seed": 2,
    }
    ends = simulate(spec)["final_x"]
    spread = np.sqrt(np.diag(covariance) / runs)
    assert np.all(np.abs(ends.mean(axis=0) - transition @ [1.0, 0.0]) < 4.0 * spread)
    np.testing.assert_allclose(np.cov(ends.T), covariance, atol=0.08 * covariance.max())


# --- Lee, Choi, Khalil ------------------------------------------------------------------------

LEE_STUDY: Spec = {
    "plant": LEE,
    "observer": standard([2.0, 2.0], constant(100.0)),
    "steps": 20_000,
    "schedule": fixed(0.0004),
    "x0": [10.0, 10.0],
    "memory0": [0.0, 0.0],
    "noise": {"kind": "uniform", "low": -0.5, "high": 0.5},
}
SA = {"kind": "stochastic-approximation", "alpha": 0.04, "epsilon": 0.01, "k0": 20_000.0, "p": 1.0}


def lee_stationary() -> np.ndarray:
    """Stationary standard deviations of the error, from SciPy's Lyapunov solver."""
    t, ell = 0.0004, 100.0
    injection = np.array([2.0 * ell, 2.0 * ell**2])
    transition = np.eye(2) + t * np.array([[-injection[0], 1.0], [-injection[1], 0.0]])
    added = t**2 * np.outer(injection, injection) / 12.0
    return np.asarray(np.sqrt(np.diag(solve_discrete_lyapunov(transition, added))))


def test_stationary_covariance_of_the_fixed_step_observer() -> None:
    exact = lee_stationary()
    np.testing.assert_allclose(exact, [0.0721588, 6.011561], rtol=1e-6)
    final = mean_covariance(LEE_STUDY)["final_covariance"]
    np.testing.assert_allclose(np.sqrt(np.diag(final)), exact, rtol=1e-9)
    out = simulate(LEE_STUDY | {"runs": 48, "seed": 1, "windows": [[5000, 20_001]]})
    spread = np.sqrt(np.mean(out["rms"][:, 0] ** 2 - out["mean"][:, 0] ** 2, axis=0))
    np.testing.assert_allclose(spread, exact, rtol=0.015)


def test_stochastic_approximation_reaches_the_exact_rms() -> None:
    windows = [[20_000, 50_000], [50_000, 100_000]]
    study = LEE_STUDY | {"schedule": SA, "steps": 100_000, "windows": windows}
    rms = mean_covariance(study)["rms"]
    np.testing.assert_allclose(rms, [[0.04353, 3.5823], [0.03299, 2.7055]], rtol=3e-4)
    other = mean_covariance(study | {"plant_schedule": fixed(0.0004)})["rms"]
    np.testing.assert_allclose(other[:, 1], [3.5835, 2.7134], rtol=3e-5)


def test_mean_covariance_is_the_limit_of_many_runs() -> None:
    study = LEE_STUDY | {"schedule": SA | {"k0": 200.0}, "steps": 400, "windows": [[0, 401]]}
    exact = mean_covariance(study)
    out = simulate(study | {"runs": 4000, "seed": 9})
    measured = np.sqrt(np.mean(out["rms"][:, 0] ** 2, axis=0))
    np.testing.assert_allclose(exact["rms"][0], measured, rtol=2e-3)
    gap = out["final_memory"] - out["final_x"]
    np.testing.assert_allclose(np.cov(gap.T), exact["final_covariance"], rtol=0.1)


def test_peak_of_the_observer_without_noise() -> None:
    """The paper's observer (42) written in its own coordinates q."""
    t, epsilon = 0.0004, 0.01
    x, q = np.array([10.0, 10.0]), np.zeros(2)
    peak = 0.0
    for _ in range(2001):
        peak = max(peak, abs(q[1] / epsilon))
        e = x[0] - q[0]
        q = q + t / epsilon * np.array([q[1] + 2.0 * e, 2.0 * e])
        x = x + t * np.array(lee_rate(0.0, x))
    out = simulate(LEE_STUDY | {"noise": NONE, "steps": 2000})
    assert out["peak"][0, 1] == pytest.approx(peak, rel=1e-12)
    assert peak == pytest.approx(669.0, abs=0.5)


def test_clock_of_the_decreasing_schedule() -> None:
    """t(k) = sum a(j), close to 8 ln(1 + k/20000) s; for p > 1 it stops."""
    out = simulate(LEE_STUDY | {"schedule": SA, "steps": 40_000, "every": 20_000, "noise": NONE})
    k = np.arange(40_000)
    total = np.sum(0.0004 / (1.0 + k / 20_000.0))
    assert out["t"][-1] == pytest.approx(total, rel=1e-12)
    assert out["t"][-1] == pytest.approx(8.0 * np.log(3.0), rel=1e-4)


# --- Sanfelice, Praly -------------------------------------------------------------------------


def oscillation(method: str, h: float, t_end: float) -> tuple[np.ndarray, float]:
    """Means over whole periods: std e1, std e2, mean r; and the period."""
    plant = {"kind": "sanfelice-praly", "nu1": 2.22, "nu2": 0.1}
    steps = round(t_end / h)
    spec = {
        "plant": plant,
        "observer": standard([2.0, 2.0], ADAPTIVE, plant, method),
        "plant_method": "held",
        "steps": steps,
        "schedule": fixed(h),
        "x0": [-0.1 / 2.22, 0.0],
        "memory0": [0.0, 0.1, 1.1],
        "every": 1,
    }
    memory = simulate(spec)["memory"][0, steps // 2 :]
    e1 = memory[:, 0] + 0.1 / 2.22
    up = np.flatnonzero((e1[:-1] < 0.0) & (e1[1:] >= 0.0))
    crossing = up - e1[up] / (e1[up + 1] - e1[up])
    period = (crossing[-1] - crossing[0]) / (len(up) - 1) * h
    whole = memory[up[0] + 1 : up[-1] + 1]
    return np.array([whole[:, 0].std(), whole[:, 1].std(), whole[:, 2].mean()]), float(period)


def test_limit_cycle_of_the_adaptive_gain() -> None:
    """Table 2: 3.12e-2 and 4.90e-2; the cycle by DOP853 from the same start."""
    figures, period = oscillation("rk4", 0.02, 260.0)
    np.testing.assert_allclose(figures, [3.1197e-2, 4.9024e-2, 1.11230], rtol=2e-3)
    assert period == pytest.approx(3.98999, rel=2e-4)


def test_forward_euler_shifts_the_cycle_and_staggered_euler_does_not() -> None:
    exact, _ = oscillation("rk4", 0.02, 260.0)
    euler, _ = oscillation("euler", 0.05, 400.0)
    staggered, _ = oscillation("staggered-euler", 0.05, 400.0)
    assert euler[0] / exact[0] == pytest.approx(1.18, abs=0.01)
    assert staggered[0] / exact[0] == pytest.approx(1.0, abs=2e-3)


def test_noise_row_of_table_1() -> None:
    plant = {"kind": "sanfelice-praly", "nu1": 1.9, "nu2": 0.1}
    spec = {
        "plant": plant,
        "observer": standard([2.0, 2.0], ADAPTIVE, plant, "rk4"),
        "plant_method": "held",
        "steps": 30_000,
        "schedule": fixed(0.009),
        "x0": [-0.1 / 1.9, 0.0],
        "memory0": [1.0, 0.0, 1.0],
        "noise": {"kind": "normal", "mean": -0.02, "std": 0.015},
        "runs": 16,
        "seed": 1,
        "windows": [[15_000, 30_000]],
    }
    out = simulate(spec)
    mean = out["mean"][:, 0].mean(axis=0)
    std = np.sqrt(out["rms"][:, 0] ** 2 - out["mean"][:, 0] ** 2).mean(axis=0)
    np.testing.assert_allclose(mean[:2], [-0.02, 0.138], atol=3e-4)
    np.testing.assert_allclose(std[:2], [6.61e-3, 9.13e-3], rtol=0.15)


def test_identity_of_the_adaptive_law() -> None:
    """mean e^2 = p2 (1 - mean r^-(2n+1-2b)) + change of r^(2b) / (2 b p1 T), law (6) integrated."""
    plant = {"kind": "sanfelice-praly", "nu1": 2.22, "nu2": 0.1}
    h, steps = 0.002, 10_000
    spec = {
        "plant": plant,
        "observer": standard([2.0, 2.0], ADAPTIVE, plant, "rk4"),
        "plant_method": "held",
        "steps": steps,
        "schedule": fixed(h),
        "x0": [-0.1 / 2.22, 0.0],
        "memory0": [0.1, 0.1, 2.0],
        "every": 1,
    }
    memory = simulate(spec)["memory"][0]
    e, r = -0.1 / 2.22 - memory[:, 0], memory[:, 2]
    p1, p2, b = ADAPTIVE["p1"], ADAPTIVE["p2"], ADAPTIVE["b"]
    span = h * steps

    def mean(values: np.ndarray) -> float:
        return float(simpson(values, dx=h) / span)

    change = (r[-1] ** (2 * b) - r[0] ** (2 * b)) / (2 * b * p1 * span)
    assert mean(e**2) == pytest.approx(p2 * (1.0 - mean(r ** -(5.0 - 2.0 * b))) + change, rel=1e-6)


def repelled(p1: float, kind: str, method: str = "rk4") -> Spec:
    plant = {"kind": "sanfelice-praly", "nu1": 2.22, "nu2": 0.1}
    k_bar = 0.026 * np.linalg.solve([[0.75, -0.5], [-0.5, 0.88]], [1.0, 0.0])
    spec = standard([2.0, 2.0], ADAPTIVE | {"p1": p1}, plant, method)
    return spec | {"kind": kind, "k_bar": k_bar, "copies": 3}


SPREAD = [0.0, 0.1, 1.1, 0.02, 0.05, 1.1, -0.05, 0.12, 1.15]


def test_nominal_gain_of_the_collection() -> None:
    spec = {
        "plant": {"kind": "sanfelice-praly", "nu1": 2.22, "nu2": 0.1},
        "observer": repelled(20.0, "collection"),
        "plant_method": "held",
        "steps": 8000,
        "schedule": fixed(0.05),
        "x0": [-0.1 / 2.22, 0.0],
        "memory0": SPREAD,
        "windows": [[5600, 8000]],
    }
    mean = simulate(spec)["mean"][0, 0]
    assert mean[[2, 5, 8]].mean() == pytest.approx(1.2189, abs=1e-3)


@pytest.mark.parametrize("kind", ["collection", "modified"])
def test_collection_rates_written_out(kind: str) -> None:
    """(23) and (25) by loops over copies, from the equations' own signs, y_hat - y."""
    rng = np.random.default_rng(3)
    n, copies, nu1, b = 2, 3, 2.22, 0.183
    spec = repelled(10.0, kind, "euler")
    k, k_bar = spec["k"], spec["k_bar"]
    blocks = copies + (kind == "modified")
    memory = rng.normal(size=(blocks, n + 1))
    memory[:, n] = rng.uniform(1.5, 3.0, blocks)
    y, h = 0.3, 1e-3
    expected = np.zeros_like(memory)
    first = blocks - copies
    r_bar = memory[first:, n].mean()
    for i, (x1, x2, r) in enumerate(memory):
        error = x1 - y  # y_hat - y
        gain = r * r_bar if i < first else r
        repulsion = 0.0
        if i >= first:
            for x1_other, _, r_other in memory[first:]:
                repulsion += error / r**b - (x1_other - y) / r_other**b
        expected[i] = [
            x2 + nu1 * x1 - k[0] * gain * error + k_bar[0] * r ** (1 + b) * repulsion,
            -k[1] * gain**2 * error + k_bar[1] * r ** (2 + b) * repulsion,
            10.0 * ((error**2 - 0.0025) * r ** (1 - 2 * b) + 0.0025 / r**4),
        ]
    stepped, _ = Observer(spec).step(memory.reshape(-1), y, None, 0.0, h)
    np.testing.assert_allclose(stepped, (memory + h * expected).reshape(-1), rtol=1e-12)


def test_gain_stays_at_or_above_one() -> None:
    observer = Observer(standard([2.0, 2.0], ADAPTIVE, NONE, "euler"))
    memory, _ = observer.step([0.0, 0.0, 1.0001], 0.0, None, 0.0, 50.0)
    assert memory[2] == 1.0


# --- Fu, Kang, Li -----------------------------------------------------------------------------


@pytest.mark.parametrize(("gain", "constant_spectrum"), [("derived", True), ("printed", False)])
def test_error_matrix_of_the_sampled_observer(gain: str, constant_spectrum: bool) -> None:
    """With y on the trajectory, the error of (5) is linear to first order: spectrum {-2, -3}."""
    dt, h = 1e-3, 1e-6
    observer = Observer({"kind": "sampled-data", "model": VAN_DER_POL, "gain": gain})
    spectra = []
    for x in ([0.3, -1.0], [1.7, 0.4], [-2.0, 0.1]):
        columns = []
        for j in range(2):
            steps = []
            for sign in (1.0, -1.0):
                start = np.array(x)
                start[j] += sign * h
                steps.append(observer.step(start, x[0], None, 0.0, dt)[0])
            columns.append((steps[0] - steps[1]) / (2.0 * h))
        error_matrix = (np.array(columns).T - np.eye(2)) / dt
        spectra.append(np.sort(np.linalg.eigvals(error_matrix).real))
    gap = np.abs(np.array(spectra) - [-3.0, -2.0]).max()
    assert (gap < 1e-5) == constant_spectrum


def test_mean_square_error_of_the_sampled_observer() -> None:
    spec = {
        "plant": VAN_DER_POL,
        "observer": {"kind": "sampled-data", "model": VAN_DER_POL, "gain": "derived"},
        "steps": 990,
        "schedule": fixed(0.1),
        "plant_method": "taylor-1.5",
        "substeps": 10,
        "x0": [1.0, 0.0],
        "memory0": [0.0, 1.0],
        "runs": 400,
        "seed": 1,
        "windows": [[210, 990]],
        "histogram": [210, 990],
    }
    out = simulate(spec)
    assert np.all(out["diverged_at"] == -1)
    square = (out["rms"][:, 0] ** 2).sum(axis=1).mean()
    assert square == pytest.approx(0.1128, rel=0.03)
    counts, edges = out["histogram"]["counts"], out["histogram"]["edges"]
    assert counts.sum() == 400 * 780
    share = np.cumsum(counts) / counts.sum()
    assert edges[np.searchsorted(share, 0.5)] == pytest.approx(0.0481, rel=0.05)
    assert edges[np.searchsorted(share, 0.95)] == pytest.approx(0.443, rel=0.05)


# --- Katayama ---------------------------------------------------------------------------------


def ship_study(dt: float, epsilon: float, delta: float, t_end: float, **more: Any) -> Spec:
    steps = round(t_end / dt)
    spec: Spec = {
        "plant": {"kind": "ship", "delta": delta, "w": more.pop("w", [0.0, 0.0, 0.0])},
        "observer": {
            "kind": "reduced-order",
            "model": {"kind": "ship"},
            "h_bar": [0.1, 0.2, 0.2],
            "epsilon": epsilon,
        },
        "steps": steps,
        "schedule": fixed(dt),
        "plant_method": "rk4",
        "substeps": max(1, round(dt / 0.02)),
        "x0": [0.0, 10.0, np.pi / 6.0, 0.5, -0.5, -0.5],
        "memory0": [0.0] * 10,
    }
    return spec | more


def ship_rate(x: np.ndarray, u: np.ndarray, delta: float, w: np.ndarray) -> np.ndarray:
    """Katayama (20) in the matrices of the paper."""
    z1, z2, z3 = z = x[3:]
    mass = np.array([[198.8, 0.0, 0.0], [0.0, 206.0, 15.6], [0.0, 15.6, 101.5]])
    damping = np.array([[56.1, 0.0, 0.0], [0.0, 90.9, -21.8], [0.0, -26.9, 38.8]])
    c_bar = np.array([206.0 * z2 + 15.6 * z3, -198.8 * z1])
    coriolis = np.zeros((3, 3))
    coriolis[:2, 2] = -c_bar
    coriolis[2, :2] = c_bar
    s = z2 - 1.18 * z3
    l22 = -0.0232 * (z1**2 + s**2) * np.arctan(s / z1)
    q = np.array(
        [
            u[0],
            (0.102 * z1**2 - 0.0232 * s**2) * u[1] + l22,
            (0.287 * z1**2 + 0.307 * s**2) * u[1] - 13.23 * l22,
        ]
    )
    rotation = np.array(
        [
            [np.cos(x[2]), -np.sin(x[2]), 0.0],
            [np.sin(x[2]), np.cos(x[2]), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    f2 = np.linalg.solve(mass, -(coriolis + damping) @ z) + q
    return np.concatenate((rotation @ z, (1.0 + delta) * f2 + w))


def test_ship_moves_as_the_papers_matrices_say() -> None:
    """One sampling period under the control held, by DOP853; u from the simulation's own z1."""
    dt, delta, w = 0.1, 0.5, np.array([0.4, 0.2, 0.1])
    spec = ship_study(dt, 0.1, delta, dt, w=w.tolist(), substeps=20, every=1)
    out = simulate(spec)
    u = out["memory"][0, 1, 6:8]  # held over the step that the last sample closed
    start = np.array(spec["x0"])
    end = integrated(lambda _, x: ship_rate(x, u, delta, w), dt, start)
    np.testing.assert_allclose(out["x"][0, 1], end, rtol=1e-9)


def test_controller_cancels_the_drift_exactly() -> None:
    """Under a fast hold z1 -> 0.8 and x3 + atan(x2/6) obey linear second-order dynamics."""
    out = simulate(ship_study(0.001, 1.0, 0.0, 1.0, every=1, substeps=1))
    x = out["x"][0]
    k = 0.3 / 0.301
    t = out["t"]
    z1 = 0.8 + (0.5 - 0.8) * np.exp(-t / 0.301)
    np.testing.assert_allclose(x[:, 3], z1, atol=2e-3)
    angle = x[:, 2] + np.arctan(x[:, 1] / 6.0)
    rate0 = (angle[1] - angle[0]) / 0.001
    both = expm(np.array([[0.0, 1.0], [-(k**2), -2.0 * k]]) * 1.0) @ [angle[0], rate0]
    assert angle[-1] == pytest.approx(both[0], abs=3e-3)


@pytest.mark.parametrize(
    ("dt", "epsilon", "delta", "expected"),
    [
        (0.1, 1.0, 0.0, [0.16195, 0.07768, 0.07184]),
        (0.1, 0.1, 0.5, [0.00037, 0.00209, 0.00189]),
        (0.01, 0.1, 0.5, [0.00073, 0.00263, 0.00210]),
    ],
)
def test_rms_of_the_reduced_order_observer(
    dt: float, epsilon: float, delta: float, expected: list[float]
) -> None:
    window = [round(5.0 / dt), round(20.0 / dt)]
    out = simulate(ship_study(dt, epsilon, delta, 20.0, windows=[window]))
    np.testing.assert_allclose(out["rms"][0, 0], expected, atol=5.1e-6)


def test_disturbance_leaves_the_predicted_error() -> None:
    """e_inf = (epsilon / h_bar_i) w_i / (1 + delta_bar)."""
    w, epsilon, delta = np.array([0.4, 0.2, 0.1]), 0.05, 0.5
    spec = ship_study(0.05, epsilon, delta, 140.0, w=w.tolist(), windows=[[2400, 2800]])
    out = simulate(spec)
    expected = epsilon / np.array([0.1, 0.2, 0.2]) * w / (1.0 + delta)
    np.testing.assert_allclose(-out["mean"][0, 0], expected, rtol=1e-4)
    np.testing.assert_allclose(out["max"][0, 0], expected, rtol=1e-4)


def test_sampling_limit_a5_is_exact() -> None:
    """T < 2 epsilon / max h_bar = 10 epsilon."""
    for dt, stable in ((0.099, True), (0.101, False)):
        spec = ship_study(dt, 0.01, 0.0, 200.0)
        spec["windows"] = [[spec["steps"] - 100, spec["steps"]]]
        out = simulate(spec)
        settled = bool(out["diverged_at"][0] < 0 and out["max"][0, 0].max() < 0.1)
        assert settled == stable


def test_reduced_order_observer_over_missing_samples() -> None:
    """Psi spans the gap; meanwhile z_hat follows the model; the error stays small."""
    rng = np.random.default_rng(0)
    steps = 1000
    gaps = np.where(rng.random(steps + 1) < 0.3, np.nan, 0.0)
    spec = ship_study(0.01, 0.05, 0.0, 10.0, windows=[[500, 1000]])
    out = simulate(spec | {"noise": {"kind": "samples", "values": gaps}})
    assert np.isnan(gaps).sum() > 250
    assert np.all(np.isfinite(out["final_memory"]))
    assert np.all(out["rms"][0, 0] < 3e-3)


def test_a_ship_at_rest_has_no_model_value() -> None:
    observer = Observer(ship_study(0.1, 0.1, 0.0, 1.0)["observer"])
    memory = observer.initial()
    memory[:3] = 0.2
    u = [0.0, 0.0]
    memory, status = observer.step(memory, [1.0, 2.0, 0.0], u, 0.0, 0.1)
    assert status == 0
    memory, status = observer.step(memory, [1.0, 2.0, 0.0], u, 0.1, 0.1)
    assert status == 2
    np.testing.assert_array_equal(memory[:3], 0.2)
    record = observer.run([0.0, 0.1], [[1.0, 2.0, 0.0]] * 2, [u] * 2, observer.initial())
    assert record["status"].tolist() == [0, 2]


# --- Astolfi, Marconi, Praly, Teel ------------------------------------------------------------


def vertices(count: int) -> np.ndarray:
    return np.array(list(itertools.product((-3.0, 3.0), repeat=count)))


def peak_study(observer: Spec, memory0: np.ndarray, dt: float, t_end: float) -> Spec:
    return {
        "plant": CRACKLE,
        "observer": observer,
        "mode": "joint",
        "steps": round(t_end / dt),
        "schedule": fixed(dt),
        "x0": [-0.8, 0.0, 0.0, 0.0, 0.0],
        "memory0": memory0,
        "runs": len(memory0),
        "settle": 0.01,
    }


def peaking_free(ell: float, method: str) -> Spec:
    return low_power(ell, CRACKLE, method, "peaking-free") | {"beta": PRINTED_BETA}


def test_table_1_at_the_papers_step() -> None:
    """l = 70, all 512 vertices, Bogacki-Shampine at 1 ms: the printed digits."""
    out = simulate(peak_study(peaking_free(70.0, "bogacki-shampine"), vertices(9), 1e-3, 1.5))
    peak = out["peak"].max(axis=0)
    np.testing.assert_allclose(peak[:5], [3.0, 4.03, 3.59, 3.29, 3.02], atol=5.1e-3)
    np.testing.assert_allclose(peak[5:], [421.98, 312.22, 159.90, 68.35], atol=5.1e-3)
    assert out["settling_time"].max() == pytest.approx(0.471, abs=1e-9)


def test_table_1_converged() -> None:
    """A second scheme with steps 20 times smaller."""
    peak = simulate(peak_study(peaking_free(70.0, "rk4"), vertices(9), 5e-5, 0.12))["peak"]
    exact = [4.0277, 3.5912, 3.2857, 3.0203, 422.20, 312.58, 159.883, 68.357]
    np.testing.assert_allclose(peak.max(axis=0)[1:], exact, rtol=2e-5)


def test_table_2_at_the_papers_step() -> None:
    observer = standard(K5, constant(4.17), CRACKLE, "bogacki-shampine")
    out = simulate(peak_study(observer, vertices(5), 1e-3, 6.0))
    peak = out["peak"].max(axis=0)
    np.testing.assert_allclose(peak, [3.0, 41.84, 222.59, 613.59, 690.71], atol=1.1e-2)
    assert out["settling_time"].max() == pytest.approx(4.901, abs=1e-9)


def test_sinusoidal_noise_row_of_table_4() -> None:
    """Column (b): 0.298 sin(100 t), sup over [4.901, 10] s."""
    spec = peak_study(
        standard(K5, constant(4.17), CRACKLE, "bogacki-shampine"), np.ones((1, 5)), 5e-4, 10.0
    )
    spec["noise"] = {"kind": "none", "sines": [[0.298, 100.0, 0.0]]}
    spec["windows"] = [[9802, 20_001]]
    worst = simulate(spec)["max"][0, 0]
    np.testing.assert_allclose(worst, [0.0923, 1.1380, 6.9186, 20.7128, 24.4165], rtol=1e-3)


def iteration_matrix(spec: Spec, dt: float) -> np.ndarray:
    """The law is linear (model none): one step on every unit vector, with y = 0."""
    law = law_from(spec)
    m = law.memory_len
    return law.step(np.eye(m), np.zeros(m), None, 0.0, dt)


def step_limit(spec: Spec) -> float:
    """Largest stable c = ell T at ell = 1, by bisection on the spectral radius."""
    low, high = 0.01, 4.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        radius = np.abs(np.linalg.eigvals(iteration_matrix(spec, middle))).max()
        low, high = (middle, high) if radius < 1.0 else (low, middle)
    return low


@pytest.mark.parametrize(
    ("spec", "expected"),
    [
        (standard(K5, constant(1.0), method="euler"), 1.000),
        (standard(K5, constant(1.0), method="rk4"), 1.392),
        (standard(K5, constant(1.0), method="rk4-innovation-held"), 0.273),
        (low_power(1.0, method="euler"), 1.000),
        (low_power(1.0, method="euler") | {"beta": PRINTED_BETA}, 0.979),
        (low_power(1.0, method="rk4"), 1.392),
        (low_power(1.0, method="rk4") | {"beta": PRINTED_BETA}, 1.369),
        (low_power(1.0, method="rk4-innovation-held"), 0.636),
    ],
)
def test_step_limits(spec: Spec, expected: float) -> None:
    """Four printed digits of beta destroy the real poles, and cost 2 % of the step."""
    limit = step_limit(spec)
    assert limit == pytest.approx(expected, rel=0.01)
    study = {
        "plant": CRACKLE,
        "observer": spec,
        "plant_method": "held",
        "steps": 20_000,
        "x0": [0.0] * 5,
        "memory0": np.ones(law_from(spec).memory_len),
    }
    for factor, diverges in ((0.98, False), (1.02, True)):
        out = simulate(study | {"schedule": fixed(factor * limit)})
        assert (out["diverged_at"][0] >= 0) == diverges


def test_low_power_rate_is_the_matrix_of_the_paper() -> None:
    """In the scaled coordinates (21) the error obeys chi' = ell M_n chi."""
    ell = 7.0
    scale = np.zeros((9, 9))  # chi = scale @ (x_hat, eta)
    for i in range(5):
        scale[2 * i, i] = ell**-i
        if i < 4:
            scale[2 * i + 1, 5 + i] = ell ** -(i + 1)
    rate = iteration_matrix(low_power(ell), 1.0) - np.eye(9)
    expected = ell * polynomial.low_power_matrix(ALPHA, BETA)
    np.testing.assert_allclose(scale @ rate @ np.linalg.inv(scale), expected, atol=1e-9)


# --- the loop ---------------------------------------------------------------------------------


def noisy_study(**more: Any) -> Spec:
    return {
        "plant": LEE,
        "observer": standard([2.0, 2.0], ADAPTIVE, NONE, "euler"),
        "steps": 700,
        "schedule": fixed(0.01),
        "x0": [1.0, -1.0],
        "memory0": [0.0, 0.0, 1.0],
        "noise": {"kind": "normal", "mean": 0.1, "std": 0.2, "hold": 3, "sines": [[0.1, 2.0, 0.3]]},
        "runs": 4,
        "seed": 6,
        "windows": [[10, 300], [300, 701]],
        "settle": 2.0,
        "histogram": [100, 600],
        "every": 1,
    } | more


def test_metrics_are_those_of_the_trajectory() -> None:
    before = simulate(noisy_study())
    distance = np.sqrt(((before["memory"][..., :2] - before["x"]) ** 2).sum(axis=2))
    settle = 0.8 * float(distance.max(axis=1).min())  # every run crosses it
    out = simulate(noisy_study(settle=settle))
    x, memory, t = out["x"], out["memory"], out["t"]
    np.testing.assert_allclose(t, 0.01 * np.arange(701), rtol=1e-15)
    signals = np.concatenate((memory[..., :2] - x, memory[..., 2:]), axis=2)
    for i, (k0, k1) in enumerate([(10, 300), (300, 701)]):
        part = signals[:, k0:k1]
        np.testing.assert_allclose(out["mean"][:, i], part.mean(axis=1), rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(out["rms"][:, i], np.sqrt((part**2).mean(axis=1)), rtol=1e-12)
        np.testing.assert_array_equal(out["max"][:, i], np.abs(part).max(axis=1))
    np.testing.assert_array_equal(out["peak"], np.abs(memory).max(axis=1))
    last = np.array([np.flatnonzero(d >= settle)[-1] for d in distance])
    assert len(set(last)) > 1
    np.testing.assert_array_equal(out["settling_time"], t[last])
    edges = out["histogram"]["edges"]
    np.testing.assert_allclose(edges, 2.0 ** (-40.0 + np.arange(2049) / 32.0), rtol=1e-15)
    counts, _ = np.histogram(distance[:, 100:600] ** 2, bins=edges)
    np.testing.assert_array_equal(out["histogram"]["counts"], counts)
    np.testing.assert_array_equal(out["final_x"], x[:, -1])
    np.testing.assert_array_equal(out["final_memory"], memory[:, -1])


def test_the_loop_written_out() -> None:
    """Euler's scheme of plant and observer step by step, on the measurements that were seen."""
    out = simulate(noisy_study())
    wave = 0.1 * np.sin(2.0 * out["t"] + 0.3)
    drawn = out["y"][..., 0] - out["x"][..., 0] - wave
    np.testing.assert_allclose(drawn[:, :699:3], drawn[:, 1:700:3], atol=1e-14)  # held 3 steps
    np.testing.assert_allclose(drawn[:, :699:3], drawn[:, 2:701:3], atol=1e-14)
    assert abs(drawn[:, ::3].mean() - 0.1) < 4.0 * 0.2 / np.sqrt(drawn[:, ::3].size)
    x, z = np.array([1.0, -1.0]), np.array([0.0, 0.0, 1.0])
    for k in range(700):
        np.testing.assert_allclose(out["x"][2, k], x, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(out["memory"][2, k], z, rtol=1e-11, atol=1e-13)
        e = out["y"][2, k, 0] - z[0]
        r = z[2]
        r_rate = 10.0 * ((e**2 - 0.0025) * r**0.634 + 0.0025 / r**4)
        z = z + 0.01 * np.array([z[1] + 2.0 * r * e, 2.0 * r**2 * e, r_rate])
        z[2] = max(z[2], 1.0)
        x = x + 0.01 * np.array(lee_rate(0.0, x))


def test_blocks_leave_no_seam(monkeypatch: pytest.MonkeyPatch) -> None:
    module = sys.modules[simulate.__module__]
    whole = simulate(noisy_study())
    monkeypatch.setattr(module, "_BLOCK_STEPS", 64)
    monkeypatch.setattr(module, "_BLOCK_FLOATS", 1)
    parts = simulate(noisy_study())
    for key in ("x", "memory", "y", "t", "peak", "settling_time", "final_memory"):
        np.testing.assert_array_equal(parts[key], whole[key])
    np.testing.assert_allclose(parts["rms"], whole["rms"], rtol=1e-13)
    np.testing.assert_array_equal(parts["histogram"]["counts"], whole["histogram"]["counts"])


def test_first_run_continues_a_study() -> None:
    whole = simulate(noisy_study())
    rest = simulate(noisy_study(runs=2, first_run=2))
    np.testing.assert_array_equal(rest["memory"], whole["memory"][2:])


def test_divergence_is_found_at_its_first_sample() -> None:
    observer = standard([2.0, 2.0], constant(1.0))
    spec = {
        "plant": LEE,
        "observer": observer,
        "plant_method": "held",
        "steps": 400,
        "schedule": fixed(3.0),
        "x0": [0.0, 0.0],
        "memory0": [[1.0, 0.0], [0.0, 0.0]],
        "runs": 2,
        "windows": [[0, 401]],
        "every": 1,
    }
    transition = iteration_matrix(observer, 3.0)
    z, k = np.array([1.0, 0.0]), 0
    squares = []
    while np.all(np.abs(z) <= 1e12):
        squares.append(z**2)
        z, k = transition @ z, k + 1
    out = simulate(spec)
    assert out["diverged_at"].tolist() == [k, -1]
    np.testing.assert_allclose(out["final_memory"][0], z, rtol=1e-10)
    np.testing.assert_allclose(out["rms"][0, 0], np.sqrt(np.mean(squares, axis=0)), rtol=1e-10)
    assert np.all(np.isfinite(out["memory"][0, :k]))
    assert np.all(np.isnan(out["memory"][0, k:]))
    assert np.all(out["memory"][1] == 0.0)
    alone = simulate(spec | {"runs": 1, "memory0": [1.0, 0.0]})
    assert alone["memory"].shape == (1, k, 2)
    assert alone["t"].shape == (k,)


@pytest.mark.parametrize("method", METHODS)
def test_a_missing_sample_is_predicted_over(method: str) -> None:
    """Without samples the observer runs its model alone, whatever the gain."""
    values = np.full(51, np.nan)
    spec = {
        "plant": CRACKLE,
        "observer": standard(K5, constant(3.0), CRACKLE, method),
        "plant_method": "rk4",
        "steps": 50,
        "schedule": fixed(0.01),
        "x0": [-0.8, 0.0, 0.1, 0.0, 0.0],
        "memory0": [-0.8, 0.0, 0.1, 0.0, 0.0],
        "noise": {"kind": "samples", "values": values},
        "windows": [[0, 51]],
    }
    blind = simulate(spec)
    tolerance = 1e-8 if method.startswith("rk4") else 5e-3
    np.testing.assert_allclose(blind["final_memory"], blind["final_x"], atol=tolerance)
    faster = spec | {"observer": standard(K5, constant(9.0), CRACKLE, method)}
    np.testing.assert_array_equal(simulate(faster)["final_memory"], blind["final_memory"])


def test_a_record_gives_what_the_simulation_gave() -> None:
    spec = noisy_study(runs=1)
    out = simulate(spec)
    record = Observer(spec["observer"]).run(out["t"], out["y"][0], None, spec["memory0"])
    np.testing.assert_allclose(record["memory"], out["memory"][0], rtol=1e-11, atol=1e-13)
    innovation = out["y"][0, :, 0] - out["memory"][0, :, 0]
    np.testing.assert_allclose(record["innovation"][:, 0], innovation, rtol=1e-10, atol=1e-12)
    assert not record["missing"].any()
    ship = ship_study(0.1, 0.1, 0.5, 3.0, every=1)
    out = simulate(ship)
    u = np.roll(out["memory"][0, :, 6:8], -1, axis=0)  # row k + 1 holds u(k); the last is not used
    record = Observer(ship["observer"]).run(out["t"], out["y"][0], u, ship["memory0"])
    np.testing.assert_allclose(record["memory"], out["memory"][0], rtol=1e-10, atol=1e-12)


def test_a_record_with_uneven_steps_and_gaps() -> None:
    """Every step uses its own dt; NaN and inf are missing and never reach the memory."""
    t = np.array([0.0, 0.1, 0.15, 0.4, 0.5])
    y = np.array([1.0, np.nan, 2.0, np.inf, 1.5])
    record = Observer(standard([2.0, 2.0], constant(3.0))).run(t, y, None, [0.0, 0.5])
    z = np.array([0.0, 0.5])
    for k in range(5):
        np.testing.assert_allclose(record["memory"][k], z, rtol=1e-14)
        e = y[k] - z[0] if np.isfinite(y[k]) else 0.0
        if k < 4:
            z = z + (t[k + 1] - t[k]) * np.array([z[1] + 6.0 * e, 18.0 * e])
    assert record["missing"].tolist() == [False, True, False, True, False]
    assert record["status"].tolist() == [0, 1, 0, 1, 0]


def test_known_input_drives_the_chain() -> None:
    """Model "input": x_n' = b0 u; with the exact model the double integrator is followed."""
    dt, b0 = 0.01, 2.0
    t = dt * np.arange(200)
    u = np.cos(3.0 * t)
    x = np.zeros((200, 2))
    for k in range(199):
        x[k + 1] = x[k] + dt * np.array([x[k, 1], b0 * u[k]])
    observer = Observer(standard([2.0, 2.0], constant(5.0), {"kind": "input", "b0": b0}))
    assert observer.n_u == 1
    record = observer.run(t, x[:, 0], u, [0.0, 0.0])
    np.testing.assert_allclose(record["memory"], x, atol=1e-12)


def test_a_ship_that_moves_sideways_counts_as_moving_ahead() -> None:
    """lambda22 jumps with the sign of z1: a z1 of rounding alone, and -0, are +0."""
    ship = Ship()
    z1 = np.array([0.0, -0.0, 1e-17, -1e-17])
    z = np.stack([z1, np.full(4, 0.3), np.full(4, -0.2)])
    rate = ship.f2(np.zeros((3, 4)), z, np.ones((2, 4)), 0.0)
    np.testing.assert_allclose(rate, rate[:, :1] * np.ones(4), rtol=1e-12)
    s = 0.3 + 1.18 * 0.2
    assert ship.rudder(z)[1][3] == pytest.approx(-0.0232 * s * s * np.pi / 2.0, rel=1e-12)


# --- time and input reach every function ------------------------------------------------------


class Formula:
    """A function in the place of a table."""

    def __init__(self, inputs: int, outputs: int, call: Callable[..., Any]) -> None:
        self.inputs, self.outputs, self.call = inputs, range(outputs), call

    def __call__(self, values: list[Any]) -> list[Any]:
        return [np.asarray(made) for made in self.call(*values)]


def own(form: str, n: int, outputs: int, call: Callable[..., Any], **more: Any) -> Spec:
    """A model of one's own: ``call`` is told (t, x_1 ... x_n, u ...) one by one."""
    told = 1 + n + more.get("n_z", 0) + more.get("n_u", 0) + 2 * (form == "sampled")
    spec = {"kind": "own", "form": form, "n": n, "table": Formula(told, outputs, call)}
    return spec | {"parameters": []} | more


def driven_phi(t: Any, x1: Any, x2: Any, u: Any) -> list[Any]:
    return [3.0 * np.sin(5.0 * t) + u * np.cos(3.0 * t) - x1]


DRIVEN = own("phase", 2, 1, driven_phi, n_u=1)
PLACED = ("zoh", "bilinear", "implicit-map")
TIMINGS = ("predictor", "current")
PAIR: Spec = {"n": 2, "gain": constant(5.0), "model": DRIVEN}
LAWS: dict[str, Spec] = {
    "standard": {"kind": "standard", "k": [3.0, 2.0], **PAIR},
    "low-power": {"kind": "low-power", "alpha": [3.0, 2.0], "beta": [2.0], **PAIR},
    "peaking-free": {
        "kind": "peaking-free",
        "alpha": [3.0, 2.0],
        "beta": [2.0],
        "saturation": [50.0],
        **PAIR,
    },
    "collection": {
        **PAIR,
        "kind": "collection",
        "k": [2.0, 2.0],
        "k_bar": [0.05, 0.03],
        "copies": 2,
        "gain": ADAPTIVE,
    },
}
LAWS["modified"] = {**LAWS["collection"], "kind": "modified"}


def driven_truth(t: np.ndarray, u: np.ndarray, start: Any) -> np.ndarray:
    """x at the times ``t`` under the input held between them, by DOP853."""
    rows = [np.asarray(start, float)]
    for k in range(len(t) - 1):

        def rate(s: float, x: Any, k: int = k) -> Any:
            return [x[1], driven_phi(t[k] + s, x[0], x[1], u[k])[0]]

        rows.append(integrated(rate, t[k + 1] - t[k], rows[-1]))
    return np.array(rows)


@pytest.mark.parametrize("timing", TIMINGS)
@pytest.mark.parametrize("method", [*METHODS, *PLACED])
@pytest.mark.parametrize("kind", LAWS)
def test_time_and_input_reach_the_model(kind: str, method: str, timing: str) -> None:
    """Without samples the estimate follows x' = (x2, phi(t, x, u)), to the order of the scheme."""
    spec = {**LAWS[kind], "method": method, "timing": timing}
    if kind in ("collection", "modified") and method in PLACED:
        with pytest.raises(ValueError, match="method"):
            Observer(spec)
        return
    rng = np.random.default_rng(1)
    t = np.append(0.0, np.cumsum(rng.uniform(0.005, 0.015, 60)))
    u = np.cos(2.0 * t)
    x = driven_truth(t, u, [0.4, -0.2])
    observer = Observer(spec)
    start = observer.initial()
    start[:2] = x[0]
    if kind in ("low-power", "peaking-free"):
        start[2] = x[0, 1]
    for row in range(0, observer.memory_len - 2 if kind in ("collection", "modified") else 0, 3):
        start[row : row + 2] = x[0] + 1e-9 * row
    shown = observer.run(t, np.full(len(t), np.nan), u, start)["memory"][:, :2]
    exact = {"rk4": 1e-8, "rk4-innovation-held": 1e-8, "bogacki-shampine": 1e-6}
    np.testing.assert_allclose(shown, x, atol=exact.get(method, 0.04))
    assert np.abs(x[-1]).max() > 0.5


def test_placed_predictor_written_out() -> None:
    """zoh of order 2 over an uneven record: gains from the wanted eigenvalues, phi at t(k)."""
    rng = np.random.default_rng(2)
    t = np.append(0.0, np.cumsum(rng.uniform(0.01, 0.05, 40)))
    y, u = np.sin(3.0 * t), np.cos(t)
    record = Observer({**LAWS["standard"], "method": "zoh"}).run(t, y, u, [0.1, 0.2])
    z = np.array([0.1, 0.2])
    for k in range(len(t) - 1):
        np.testing.assert_allclose(record["memory"][k], z, rtol=1e-11)
        dt = t[k + 1] - t[k]
        z = z + pair_gains(5.0, dt) * (y[k] - z[0])
        phi = driven_phi(t[k], *z, u[k])[0]
        z = np.array([z[0] + dt * z[1] + 0.5 * dt * dt * phi, z[1] + dt * phi])


def pair_gains(ell: float, time: float) -> np.ndarray:
    """(I - K C) exp(A T) of order 2 has the eigenvalues exp(-ell T), exp(-2 ell T)."""
    wanted = np.exp(-ell * time * np.array([1.0, 2.0]))
    k1 = 1.0 - wanted.prod()
    return np.array([k1, (2.0 - k1 - wanted.sum()) / time])


# --- placed eigenvalues, in 60 digits ---------------------------------------------------------


def precise(values: Any) -> np.ndarray:
    """As an array of mpmath's numbers."""
    return np.vectorize(mpmath.mpf, otypes=[object])(np.asarray(values, dtype=float))


def characteristic(a: np.ndarray) -> list[Any]:
    """Coefficients of det(z - A), 1 first: Faddeev and LeVerrier."""
    n, out = len(a), [mpmath.mpf(1)]
    m = np.zeros_like(a)
    for k in range(1, n + 1):
        m = a @ m + out[-1] * np.eye(n, dtype=int)
        out.append(-np.trace(a @ m) / k)
    return out


def step_matrix(k: np.ndarray) -> np.ndarray:
    """(I - K C) exp(A T) of a chain; in coordinates with T = 1."""
    n = len(k)
    phi = [
        [mpmath.mpf(1) / mpmath.factorial(j - i) if j >= i else mpmath.mpf(0) for j in range(n)]
        for i in range(n)
    ]
    kept = np.eye(n, dtype=int) + precise(np.zeros((n, n)))
    kept[:, 0] -= k
    return np.asarray(np.array(phi) @ kept)


def low_power_step_matrix(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """One step of the error of the low-power law, correction and flow, with T = 1."""
    n = len(a)
    columns = []
    for unit in np.eye(2 * n - 1, dtype=int):
        x, eta = precise(unit[:n]), precise(unit[n:])
        e = np.append(precise([0.0]), eta) - x  # e_1 = -x_1, e_i = eta_(i-1) - x_i
        x, eta = x + a * e, eta + b * e[:-1]
        above = np.append(eta, precise([0.0]))
        moved = [
            sum(above[i + j] / mpmath.factorial(j + 1) for j in range(n - i)) for i in range(n)
        ]
        columns.append(np.concatenate((x + moved, eta + moved[1:])))
    return np.array(columns).T


@pytest.mark.parametrize(
    ("n", "c"), [(5, 1e-3), (5, 1.0), (5, 10.0), (8, 1e-3), (8, 10.0), (12, 1.0)]
)
def test_high_orders_are_placed_where_the_papers_matrix_says(n: int, c: float) -> None:
    """det(z - A) of the step in 60 digits is prod(z - exp(T lambda)), lambda those of M_n."""
    poles = [*np.linspace(-1.0, -2.0, 2 * n - 2), -2.0]
    alpha, beta = polynomial.low_power_coefficients_from_poles(poles)
    a, b, _, _ = low_power_gains(alpha * c, beta * c * c, 1.0, "zoh")
    with mpmath.workdps(60):
        found = characteristic(low_power_step_matrix(precise(a), precise(b)))
        continuous = characteristic(precise(polynomial.low_power_matrix(alpha, beta)))
        lambdas = mpmath.polyroots(continuous, maxsteps=500, extraprec=400)
        wanted = [mpmath.mpf(1)]
        for pole in lambdas:
            z = mpmath.exp(pole * mpmath.mpf(c))
            shifted = [mpmath.mpf(0), *(z * w for w in wanted)]
            wanted = [p - q for p, q in zip([*wanted, mpmath.mpf(0)], shifted, strict=True)]
        largest = max(abs(w) for w in wanted)
        off = max(abs(p - q) for p, q in zip(found, wanted, strict=True)) / largest
    assert off < (1e-10 if c > 1.0 else 1e-13)


@pytest.mark.parametrize(
    ("kind", "method", "n", "c", "changed"),
    [
        ("standard", "bilinear", 6, 100.0, (0.0, 5e-5)),
        ("standard", "bilinear", 7, 100.0, (5e-5, np.inf)),
        ("low-power", "bilinear", 4, 100.0, (0.0, 5e-5)),
        ("low-power", "bilinear", 5, 100.0, (5e-5, np.inf)),
        ("standard", "zoh", 12, 100.0, (0.0, 1e-9)),
        ("low-power", "zoh", 12, 10.0, (0.0, 1e-9)),
    ],
)
def test_limits_of_the_order(
    kind: str, method: str, n: int, c: float, changed: tuple[float, float]
) -> None:
    """By how much one rounding of the gains changes the powers of the step's matrix."""
    ulp = 2.0**-53
    with mpmath.workdps(40):
        if kind == "standard":
            k = polynomial.coefficients_from_poles(-np.linspace(1.0, 2.0, n))
            gains = chain_gains(k * c ** np.arange(1, n + 1), 1.0, method)
            rounded = precise(gains) * (1 + ulp * precise((-1.0) ** np.arange(n)))
            both = step_matrix(precise(gains)), step_matrix(rounded)
        else:
            poles = [*np.linspace(-1.0, -2.0, 2 * n - 2), -2.0]
            alpha, beta = polynomial.low_power_coefficients_from_poles(poles)
            a, b, _, _ = low_power_gains(alpha * c, beta * c * c, 1.0, method)
            first = low_power_step_matrix(precise(a), precise(b))
            signs = precise((-1.0) ** np.arange(n))
            second = low_power_step_matrix(
                precise(a) * (1 + ulp * signs), precise(b) * (1 - ulp * signs[1:])
            )
            both = first, second
        powers, largest, apart = list(both), mpmath.mpf(0), mpmath.mpf(0)
        for _ in range(300 if method == "bilinear" else 25):
            largest = max(largest, np.abs(powers[0]).max())
            apart = max(apart, np.abs(powers[0] - powers[1]).max())
            powers = [power @ one for power, one in zip(powers, both, strict=True)]
        low, high = changed
        assert low <= apart / largest < high
    spec = {"kind": kind, "n": n, "gain": constant(1.0), "method": method}
    if kind == "standard":
        spec |= {"k": polynomial.coefficients_from_poles(-np.linspace(1.0, 2.0, n))}
    else:
        spec |= {"alpha": alpha, "beta": beta}
    if low > 0.0:
        with pytest.raises(ValueError, match="choose method zoh"):
            Observer(spec)
    else:
        Observer(spec)


# --- correct and predict ----------------------------------------------------------------------


def loop(observer: Observer, t: Any, y: Any, u: Any, memory: Any) -> np.ndarray:
    """Row k: ``correct`` with y(k), whereupon ``predict`` moves under u(k)."""
    rows = []
    for k in range(len(t)):
        memory, _ = observer.correct(memory, y[k], t[k])
        rows.append(memory)
        if k + 1 < len(t):
            memory, _ = observer.predict(memory, u[k], t[k], t[k + 1] - t[k])
    return np.array(rows)


@pytest.mark.parametrize("method", ["euler", "zoh"])
def test_current_timing_written_out(method: str) -> None:
    """Jitter and gaps: a placed correction is for all that has passed, Euler's for a period."""
    rng = np.random.default_rng(3)
    t = np.append(0.0, np.cumsum(rng.uniform(0.01, 0.05, 60)))
    y, u = np.sin(3.0 * t), np.cos(t)
    y[[4, 5, 6, 30]] = np.nan
    observer = Observer({**LAWS["standard"], "method": method, "timing": "current"})
    shown = observer.run(t, y, u, [0.1, 0.2, 0.0])["memory"]
    np.testing.assert_array_equal(shown, loop(observer, t, y, u[:, None], [0.1, 0.2, 0.0]))
    z, last = np.array([0.1, 0.2]), t[0]
    for k in range(len(t)):
        if np.isfinite(y[k]) and k > 0:
            euler = np.array([15.0, 50.0]) * (t[k] - t[k - 1])
            gains = euler if method == "euler" else pair_gains(5.0, t[k] - last)
            z = z + gains * (y[k] - z[0])
            last = t[k]
        np.testing.assert_allclose(shown[k, :2], z, rtol=1e-10)
        if k + 1 < len(t):
            dt, phi = t[k + 1] - t[k], driven_phi(t[k], *z, u[k])[0]
            bend = 0.0 if method == "euler" else 0.5 * dt * dt * phi
            z = np.array([z[0] + dt * z[1] + bend, z[1] + dt * phi])


@pytest.mark.parametrize("method", [*METHODS, *PLACED])
@pytest.mark.parametrize("kind", LAWS)
def test_a_correction_is_for_the_time_elapsed(kind: str, method: str) -> None:
    """For no time, and without a sample, it changes nothing; else it asks no model."""
    if kind in ("collection", "modified") and method in PLACED:
        return
    observer = Observer({**LAWS[kind], "method": method, "timing": "current"})
    rng = np.random.default_rng(4)
    memory = rng.uniform(1.1, 1.9, observer.memory_len)
    memory[-1] = 0.0
    corrected, status = observer.correct(memory, 7.0, 0.0)
    np.testing.assert_array_equal(corrected, memory)
    assert status == 0
    memory[-1] = 0.03
    missed, status = observer.correct(memory, np.nan, 0.3)
    np.testing.assert_array_equal(missed, memory)
    assert status == 1
    corrected, _ = observer.correct(memory, 7.0, 0.3)
    assert corrected[-1] == 0.0
    assert corrected[0] != memory[0]
    autonomous = Observer({**observer.spec, "model": NONE})
    np.testing.assert_array_equal(autonomous.correct(memory, 7.0, 9.0)[0], corrected)
    if method not in PLACED:  # Euler's: dt (rate(e) - rate(0))
        law = law_from({**LAWS[kind], "method": "euler", "model": NONE})
        bare = memory[:-1, None]
        moved = [law.step(bare, np.array([y]), None, 0.0, 0.03) for y in (7.0, np.nan)]
        want = memory[:-1] + (moved[0] - moved[1])[:, 0]
        np.testing.assert_allclose(corrected[:-1], want, rtol=1e-12)


def test_a_step_is_the_past_period_and_then_the_sample() -> None:
    observer = Observer({**LAWS["low-power"], "method": "zoh", "timing": "current"})
    rng = np.random.default_rng(5)
    t = np.append(0.0, np.cumsum(rng.uniform(0.01, 0.05, 20)))
    y, u = np.sin(3.0 * t), np.cos(t)
    y[7] = np.nan
    memory, rows = observer.initial(), []
    for k in range(len(t)):
        past, held = (t[k] - t[k - 1], u[k - 1]) if k else (0.0, 0.0)
        memory, status = observer.step(memory, y[k], [held], t[k], past)
        assert status == (1 if k == 7 else 0)
        rows.append(memory)
    shown = observer.run(t, y, u, observer.initial())["memory"]
    np.testing.assert_allclose(rows, shown, rtol=1e-12, atol=1e-14)


def test_predictor_timing_has_no_halves() -> None:
    observer = Observer({**LAWS["standard"], "method": "zoh"})
    with pytest.raises(ValueError, match="timing='current'"):
        observer.correct([0.0, 0.0], 1.0, 0.0)
    with pytest.raises(ValueError, match="timing='current'"):
        observer.predict([0.0, 0.0], [0.0], 0.0, 0.1)


def sampled_parts(t: Any, x1: Any, x2: Any, u: Any, y: Any, period: Any) -> list[Any]:
    h = 2.0 * x1 + np.sin(t) * u
    correction = [(0.4 + 0.1 * np.sin(t)) * (y - h), period * u * (y - h)]
    return [x2, np.cos(2.0 * t) * u - x1, *correction, h]


def test_sampled_data_law_written_out() -> None:
    """(5) with f(t, x, u), K_T(t, x, u, y, T) and y = h(t, x, u), over jitter and a gap."""
    rng = np.random.default_rng(6)
    t = np.append(0.0, np.cumsum(rng.uniform(0.01, 0.05, 30)))
    y, u = rng.normal(size=31), rng.normal(size=31)
    y[[3, 4]] = np.nan
    model = own("sampled", 2, 5, sampled_parts, n_u=1)
    record = Observer({"kind": "sampled-data", "model": model}).run(t, y, u, [1.0, 0.5])
    x = np.array([1.0, 0.5])
    for k in range(len(t)):
        np.testing.assert_allclose(record["memory"][k], x, rtol=1e-12)
        h = 2.0 * x[0] + np.sin(t[k]) * u[k]
        np.testing.assert_allclose(record["innovation"][k], [y[k] - h], rtol=1e-12)
        dt = t[k + 1] - t[k] if k < 30 else 0.0
        e = y[k] - h if np.isfinite(y[k]) else 0.0
        injected = np.array([(0.4 + 0.1 * np.sin(t[k])) * e, dt * u[k] * e])
        x = x + dt * np.array([x[1], np.cos(2.0 * t[k]) * u[k] - x[0]]) + injected


def feedback(t: Any, x1: Any, x2: Any, z: Any, u: Any) -> list[Any]:
    """f1, g (2 by 1), f2."""
    return [0.3 * x2, -x1, 1.0 + x1 * x1, 0.5 + 0.0 * x1, np.sin(4.0 * t) * u - z * x1]


def test_reduced_order_law_written_out() -> None:
    """(8) with least squares for Psi, f2(t, y, z, u) at the beginning of the step, and gaps."""
    rng = np.random.default_rng(7)
    t = np.append(0.0, np.cumsum(rng.uniform(0.01, 0.05, 40)))
    y = np.stack([np.sin(t), np.cos(2.0 * t)], axis=1)
    u = rng.normal(size=41)
    gaps = [0, 5, 6, 20]
    y[gaps, 1] = np.nan
    model = own("strict-feedback", 2, 5, feedback, n_z=1, n_u=1)
    spec = {"kind": "reduced-order", "model": model, "h_bar": [0.2], "epsilon": 0.05}
    observer = Observer(spec)
    start = observer.initial()
    start[0] = 0.7
    record = observer.run(t, y, u, start)
    np.testing.assert_array_equal(record["memory"], loop(observer, t, y, u[:, None], start))
    z, last = 0.7, -1
    for k in range(len(t)):
        present = k not in gaps
        if last >= 0:
            x, dt = y[last], t[k] - t[k - 1]
            f1, g = np.array([0.3 * x[1], -x[0]]), np.array([[1.0 + x[0] ** 2], [0.5]])
            elapsed = t[k] - t[last]
            psi = np.linalg.lstsq(g, (y[k] - x) / elapsed - f1)[0][0] if present else z
            np.testing.assert_allclose(
                record["innovation"][k], y[k] - x - elapsed * (f1 + g[:, 0] * z), rtol=1e-9
            )
            f2 = np.sin(4.0 * t[k - 1]) * u[k - 1] - psi * x[0]
            z = z + dt * (4.0 * (psi - z) + f2)
        if present:
            last = k
        assert record["memory"][k, 0] == pytest.approx(z, rel=1e-10)
        elapsed = t[k] - t[last] if last >= 0 else -1.0  # no sample yet
        assert record["memory"][k, -2] == pytest.approx(elapsed, abs=1e-12)
    assert record["status"].tolist() == [int(k in gaps) for k in range(41)]


def test_reduced_order_law_when_nobody_corrects() -> None:
    """``predict`` twice is ``predict``, a missing sample, ``predict``."""
    observer = Observer(ship_study(0.1, 0.1, 0.0, 1.0)["observer"])
    memory, _ = observer.correct([0.5, 0.1, 0.1] + [0.0] * 7, [1.0, 2.0, 0.3], 0.0)
    memory, _ = observer.predict(memory, [0.2, 0.1], 0.0, 0.1)
    twice, _ = observer.predict(memory, [0.4, 0.0], 0.1, 0.2)
    missed, status = observer.correct(memory, [np.nan] * 3, 0.1)
    assert status == 1
    between, _ = observer.predict(missed, [0.4, 0.0], 0.1, 0.2)
    np.testing.assert_array_equal(twice, between)
    assert twice[8] == pytest.approx(0.3)


def coupled(t: Any, p: Any, v: Any, q: Any, u: Any) -> list[Any]:
    return [u * np.sin(t) - 0.5 * v + 2.0 * q, np.cos(3.0 * t) - p * q]


def chains(timing: str, *methods: str) -> Spec:
    one = {"kind": "standard", "n": 2, "k": [3.0, 2.0], "gain": constant(5.0)}
    two = {"kind": "standard", "n": 1, "k": [1.0], "gain": constant(4.0)}
    both = [
        {**law, "method": m, "timing": timing} for law, m in zip((one, two), methods, strict=True)
    ]
    model = own("chains", 3, 2, coupled, orders=[2, 1], n_u=1)
    return {"kind": "chains", "observers": both, "model": model}


def test_chains_written_out() -> None:
    """Two outputs at rates of their own: each has its own elapsed time; the states are shared."""
    rng = np.random.default_rng(8)
    t = np.append(0.0, np.cumsum(rng.uniform(0.01, 0.05, 50)))
    y, u = np.stack([np.sin(t), np.cos(t)], axis=1), np.cos(2.0 * t)
    y[np.arange(51) % 4 != 3, 1] = np.nan
    y[20, 0] = np.nan
    observer = Observer(chains("current", "zoh", "zoh"))
    assert (observer.n, observer.n_y, observer.n_u, observer.memory_len) == (3, 2, 1, 5)
    start = [0.1, 0.2, 0.3, 0.0, 0.0]
    record = observer.run(t, y, u, start)
    np.testing.assert_array_equal(record["memory"], loop(observer, t, y, u[:, None], start))
    x, last = np.array(start[:3]), [0.0, 0.0]
    for k in range(len(t)):
        np.testing.assert_allclose(record["innovation"][k], y[k] - x[[0, 2]], atol=1e-12)
        if np.isfinite(y[k, 0]) and k:
            x[:2] += pair_gains(5.0, t[k] - last[0]) * (y[k, 0] - x[0])
            last[0] = t[k]
        if np.isfinite(y[k, 1]):
            x[2] += (1.0 - np.exp(-4.0 * (t[k] - last[1]))) * (y[k, 1] - x[2])
            last[1] = t[k]
        np.testing.assert_allclose(record["memory"][k, :3], x, rtol=1e-10)
        if k + 1 < len(t):
            dt, (a, b) = t[k + 1] - t[k], coupled(t[k], *x, u[k])
            x += [dt * x[1] + 0.5 * dt * dt * a, dt * a, dt * b]
    assert set(record["status"].tolist()) == {0, 1}


def test_chains_by_runge_kutta_hold_the_other_chains() -> None:
    """Predictor timing: one step against DOP853 with the other chain's states held."""
    observer = Observer(chains("predictor", "rk4", "rk4"))
    start, u, t, dt = np.array([0.1, 0.2, 0.3]), 0.7, 0.4, 0.02
    moved, _ = observer.step(start, [np.nan, np.nan], [u], t, dt)
    first = integrated(
        lambda s, x: [x[1], coupled(t + s, x[0], x[1], start[2], u)[0]], dt, start[:2]
    )
    second = integrated(lambda s, x: [coupled(t + s, *start[:2], x[0], u)[1]], dt, start[2:])
    np.testing.assert_allclose(moved, [*first, *second], rtol=1e-9)


def test_the_output_of_a_plant_is_told_the_time() -> None:
    """y of the trajectories, and what the observer sees."""
    table = Formula(3, 3, lambda t, x1, x2: [x2, -x1, x1 + 10.0 * np.sin(5.0 * t)])
    spec: Spec = {
        "plant": {"kind": "own-plant", "n": 2, "table": table, "parameters": []},
        "observer": standard([3.0, 2.0], constant(5.0)),
        "steps": 50,
        "schedule": fixed(0.01),
        "x0": [1.0, 0.0],
        "memory0": [1.0, 0.0],
        "every": 1,
    }
    for mode in ("sampled", "joint"):
        out = simulate(spec | {"mode": mode})
        y, t = out["y"][0, :, 0], out["t"]
        np.testing.assert_allclose(y, out["x"][0, :, 0] + 10.0 * np.sin(5.0 * t), rtol=1e-12)
    seen = Observer(spec["observer"]).run(t, simulate(spec)["y"][0], None, [1.0, 0.0])
    np.testing.assert_allclose(seen["memory"], simulate(spec)["memory"][0], rtol=1e-9, atol=1e-12)


def test_the_diffusion_of_a_plant_is_told_the_time() -> None:
    """dx = cos(5t) dW: E x^2 = int cos^2(5t) dt."""
    table = Formula(2, 3, lambda t, x: [0.0 * x, np.cos(5.0 * t) + 0.0 * x, x])
    spec: Spec = {
        "plant": {"kind": "own-plant", "n": 1, "noisy": True, "table": table, "parameters": []},
        "observer": standard([1.0], constant(1.0)),
        "plant_method": "euler-maruyama",
        "substeps": 4,
        "steps": 100,
        "runs": 4000,
        "schedule": fixed(0.01),
        "x0": [0.0],
        "memory0": [0.0],
    }
    variance = np.mean(simulate(spec)["final_x"] ** 2)
    assert variance == pytest.approx(0.5 + np.sin(10.0) / 20.0, rel=0.08)


# --- where the model has no value -------------------------------------------------------------


@pytest.mark.parametrize("y", [1.0, np.nan])
@pytest.mark.parametrize("timing", TIMINGS)
@pytest.mark.parametrize("method", ["euler", "rk4", "zoh"])
def test_where_the_model_has_no_value_the_memory_is_kept(
    method: str, timing: str, y: float
) -> None:
    """log x_1 for x_1 < 0: refused, with a sample and without one, by step, run and study."""
    model = own("phase", 2, 1, lambda t, x1, x2: [np.log(x1)])
    spec = {**LAWS["standard"], "model": model, "method": method, "timing": timing}
    observer = Observer(spec)
    start = observer.initial()
    start[:2] = [-1.0, 5.0]
    if timing == "current":
        kept, status = observer.predict(start, None, 0.0, 0.01)
        assert status == 2
        np.testing.assert_array_equal(kept, start)
    kept, status = observer.step(start, y, None, 0.01, 0.01)
    assert status == 2
    np.testing.assert_array_equal(kept, start)
    t = 0.01 * np.arange(6)
    record = observer.run(t, np.full(6, y), None, start)
    assert record["status"][0] == 2
    np.testing.assert_array_equal(record["memory"][:5], [start] * 5)
    table = Formula(3, 3, lambda t, x1, x2: [x2, -x1, x1])
    study: Spec = {
        "plant": {"kind": "own-plant", "n": 2, "table": table, "parameters": []},
        "observer": spec,
        "steps": 5,
        "schedule": fixed(0.01),
        "x0": [1.0, 0.0],
        "memory0": start,
        "noise": {"kind": "samples", "values": np.full(6, 0.0 * y)},
    }
    out = simulate(study)
    assert out["undefined_at"].tolist() == [0]
    np.testing.assert_array_equal(out["final_memory"][0], start)


@pytest.mark.parametrize("timing", TIMINGS)
def test_one_chain_without_a_value_refuses_the_step(timing: str) -> None:
    """Samples of one output alone: the good one's estimate may not stand still in silence."""
    spec = chains(timing, "zoh", "zoh")
    call = lambda t, p, v, q, u: [-np.log(q), 0.0 * q]  # noqa: E731
    observer = Observer({**spec, "model": own("chains", 3, 2, call, orders=[2, 1], n_u=1)})
    start = np.zeros(observer.memory_len)
    start[2] = -1.0
    t = 0.01 * np.arange(5)
    y = np.stack([1.0 + t, np.full(5, np.nan)], axis=1)
    record = observer.run(t, y, np.zeros(5), start)
    assert record["status"][0] == 2
    assert record["missing"].all()


def test_a_study_of_an_own_reduced_order_observer() -> None:
    """z_hat is compared with z, which stands after x in the plant."""
    call = lambda t, x, z: [0.0 * x, 1.0 + 0.0 * x, np.sin(t) - x - 0.5 * z]  # noqa: E731
    model = own("strict-feedback", 1, 3, call, n_z=1)
    observer = {"kind": "reduced-order", "model": model, "h_bar": [0.5], "epsilon": 0.05}
    table = Formula(3, 3, lambda t, x, z: [z, np.sin(t) - x - 0.5 * z, x])
    spec: Spec = {
        "plant": {"kind": "own-plant", "n": 2, "table": table, "parameters": []},
        "observer": observer,
        "plant_method": "rk4",
        "steps": 200,
        "schedule": fixed(0.01),
        "x0": [1.0, 0.3],
        "memory0": np.zeros(Observer(observer).memory_len),
        "every": 1,
        "windows": [[100, 200]],
    }
    out = simulate(spec)
    error = out["memory"][0, 100:200, 0] - out["x"][0, 100:200, 1]
    assert out["rms"][0, 0, 0] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
    assert out["rms"][0, 0, 0] < 5e-3 < np.std(out["x"][0, :, 1])


# --- bad input --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "names"),
    [
        ({"steps": 0}, "steps"),
        ({"steps": 1.5}, "steps"),
        ({"schedule": fixed(0.0)}, "schedule.dt"),
        ({"schedule": fixed(float("nan"))}, "schedule.dt"),
        ({"schedule": {"kind": "random"}}, "schedule.kind"),
        ({"x0": [1.0]}, "x0"),
        ({"x0": [1.0, np.inf]}, "x0"),
        ({"memory0": [0.0, 0.0, 0.5]}, "memory0"),
        ({"memory0": [0.0, 0.0]}, "memory0"),
        ({"plant": {"kind": "pendulum"}}, "plant.kind"),
        ({"plant": CRACKLE}, "x0"),
        ({"plant_method": "taylor-1.5"}, "plant_method"),
        ({"plant_method": "rk5"}, "plant_method"),
        ({"noise": {"kind": "uniform", "low": 1.0, "high": 0.0}}, "noise.high"),
        ({"noise": {"kind": "normal", "mean": 0.0, "std": -1.0}}, "noise.std"),
        ({"noise": {"kind": "samples", "values": [0.0]}}, "noise.values"),
        ({"noise": {"kind": "none", "hold": 0}}, "noise.hold"),
        ({"windows": [[5, 5]]}, "windows"),
        ({"settle": 0.0}, "settle"),
        ({"runs": 0}, "runs"),
        ({"mode": "both"}, "mode"),
        ({"stepz": 3}, "stepz"),
        ({"observer": standard([2.0, -2.0], constant(1.0))}, "observer.k"),
        ({"observer": standard([2.0, 2.0], constant(-1.0))}, "gain.ell"),
        ({"observer": standard([2.0, 2.0], ADAPTIVE | {"b": 0.5})}, "gain.b"),
        ({"observer": standard([2.0, 2.0], constant(1.0), method="rk5")}, "observer.method"),
        ({"observer": standard([2.0, 2.0], constant(1.0), CRACKLE)}, "observer.model"),
        ({"observer": {"kind": "kalman"}}, "observer.kind"),
    ],
)
def test_bad_specs_are_refused_by_name(change: Spec, names: str) -> None:
    with pytest.raises(ValueError, match=names.replace(".", r"\.")):
        simulate(noisy_study() | change)


def test_equal_starts_of_repelled_copies_are_refused() -> None:
    spec = {
        "plant": {"kind": "sanfelice-praly", "nu1": 2.22, "nu2": 0.1},
        "observer": repelled(10.0, "collection"),
        "steps": 10,
        "schedule": fixed(0.01),
        "x0": [0.0, 0.0],
        "memory0": [0.0, 0.1, 1.1] * 3,
    }
    with pytest.raises(ValueError, match="copies 1 and 2"):
        simulate(spec)


@pytest.mark.parametrize(
    ("poles", "names"),
    [([-1.0, 0.5], "poles"), ([-1.0 + 1.0j, -2.0], "conjugate"), ([-1.0, np.nan], "poles")],
)
def test_bad_poles_are_refused(poles: list[complex], names: str) -> None:
    with pytest.raises(ValueError, match=names):
        polynomial.coefficients_from_poles(poles)


def test_bad_records_are_refused() -> None:
    observer = Observer(standard([2.0, 2.0], constant(3.0)))
    with pytest.raises(ValueError, match=r"t\[2\]"):
        observer.run([0.0, 0.1, 0.1], [0.0, 0.0, 0.0], None, [0.0, 0.0])
    with pytest.raises(ValueError, match="y"):
        observer.run([0.0, 0.1], [0.0, 0.0, 0.0], None, [0.0, 0.0])
    with pytest.raises(ValueError, match="memory0"):
        observer.run([0.0, 0.1], [0.0, 0.0], None, [0.0])


def test_stochastic_approximation_has_no_covariance_law_for_nonlinear_observers() -> None:
    with pytest.raises(ValueError, match="observer"):
        mean_covariance(LEE_STUDY | {"observer": standard([2.0, 2.0], constant(100.0), LEE)})
    biased = {"kind": "uniform", "low": 0.0, "high": 1.0}
    with pytest.raises(ValueError, match=r"noise\.low"):
        mean_covariance(LEE_STUDY | {"noise": biased})
