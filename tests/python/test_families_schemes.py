"""Discretisations of Levant's differentiator, and the inter-sample predictor, against numbers of
independent programs, recursions written out here, and identities.

Numbers are those of a specification, computed twice by programs that share nothing with this
package: 1e-9 relative for recursions, 1e-6 where a sign is inside.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq
from test_families import BACKENDS, check, noisy

import hgo_rs
from hgo_rs import design, reference

Array = npt.NDArray[np.float64]
LEVANT: dict[tuple[str, int], tuple[float, ...]] = {
    ("proper", 2): (0.755391520, 0.5566),
    ("proper", 3): (0.728883454, 0.611970967, 0.5808),
    ("implicit-map", 2): (0.750157561, 0.529099460),
    ("implicit-map", 3): (0.727804772, 0.599268928, 0.557755150),
    ("implicit", 2): (0.763870726, 0.5687),
    ("implicit", 3): (0.737931243, 0.626036706, 0.5929),
}
SINE = np.sin(0.01 * np.arange(101))
FIRST_ORDERS = (2, 3, 4, 5)


def timing(method: str) -> str:
    return "current" if method == "implicit" else "predictor"


def levant(n: int, bound: float, method: str, **more: Any) -> hgo_rs.StandardObserver:
    given: dict[str, Any] = {"k": design.levant_coefficients(n), "timing": timing(method), **more}
    return hgo_rs.StandardObserver(
        n, hgo_rs.HomogeneousGain.levant(bound, n), method=method, **given
    )


def run(observer: hgo_rs.Observer, y: Array, start: Any, dt: float, backend: str = "core") -> Array:
    """Memories before the use of each sample; with current timing after it, a period before the
    first one.
    """
    memory = np.array(observer.initial_memory(start))
    if observer.timing == "current":
        memory[-1] = dt
    if backend == "core":
        return observer.run(dt, y, memory0=memory, allow_unstable=True).memory
    t = np.arange(len(y)) * dt
    return np.asarray(reference.Observer(observer.spec).run(t, y, None, memory, dt)["memory"])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("method", "n"), LEVANT)
def test_levants_differentiator_meets_its_numbers(method: str, n: int, backend: str) -> None:
    memory = run(levant(n, 1.1, method), SINE, (0.5, *[0.0] * (n - 1)), 0.01, backend)
    check(memory, {100: LEVANT[method, n]}, 1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_uniform_differentiator_meets_its_numbers(backend: str) -> None:
    gain = hgo_rs.HomogeneousGain(2.0, mu=1.0)
    observer = hgo_rs.StandardObserver(
        2, gain, k=(2.0, 1.0), method="implicit-map", timing="predictor"
    )
    memory = run(observer, SINE, (0.5, 0.0), 0.01, backend)
    check(memory, {100: (0.841743644, 0.566299349)}, 1e-6)


def filtering(n: int, m: int, bound: float, **more: Any) -> hgo_rs.Observer:
    k = np.asarray(design.levant_coefficients(n + m))
    gain = hgo_rs.HomogeneousGain.levant(bound, n + m)
    given: dict[str, Any] = {"timing": "predictor", **more}
    return hgo_rs.HighGainObserver(
        "filtered", n, gain, filters=m, c=k[:m], k=k[m:] / k[m - 1], **given
    )


@pytest.mark.parametrize("backend", BACKENDS)
def test_the_filtering_differentiator_meets_its_numbers(backend: str) -> None:
    observer = filtering(2, 1, 1.1)
    assert observer.spec["method"] == "proper"
    memory = run(observer, SINE, (0.5, 0.0), 0.01, backend)
    check(memory, {100: (0.548561814, 0.2541)}, 1e-6)


# --- recursions, written out ------------------------------------------------------------------


def power(s: float, p: float) -> float:
    """sign(s) |s|^p, and 0 at s = 0."""
    return 0.0 if s == 0.0 else float(np.sign(s) * abs(s) ** p)


def chain(n: int, dt: float) -> Array:
    return np.asarray(expm(np.diag(np.ones(n - 1), 1) * dt))


def injected(k: Array, rho: float, degree: float, e: float) -> Array:
    n = len(k)
    d = degree / (1.0 - (n - 1) * degree)
    return np.array([k[i] * rho ** (i + 1) * power(e, 1.0 + (i + 1) * d) for i in range(n)])


def by_proper(k: Array, rho: float, degree: float, y: Array, x: Array, dt: float) -> Array:
    rows, phi = [], chain(len(k), dt)
    for sample in y:
        rows.append(x)
        e = 0.0 if np.isnan(sample) else sample - x[0]
        x = phi @ x + dt * injected(k, rho, degree, e)
    return np.array(rows)


def by_placement(k: Array, rho: float, degree: float, y: Array, x: Array, dt: float) -> Array:
    """Ackermann's formula at each sample, the eigenvalues 1/(1 - T r lambda)."""
    n, rows, phi = len(k), [], chain(len(k), dt)
    poles = np.roots(np.append(1.0, k))
    for sample in y:
        rows.append(x)
        e = 0.0 if np.isnan(sample) else sample - x[0]
        if e != 0.0:
            r = rho * abs(e) ** (degree / (1.0 - (n - 1) * degree))
            wanted = np.poly(1.0 / (1.0 - dt * r * poles)).real
            seen = np.array([np.linalg.matrix_power(phi, i)[0] for i in range(1, n + 1)])
            of_phi = sum(
                c * np.linalg.matrix_power(phi, n - i) for i, c in enumerate(wanted.tolist())
            )
            x = x + of_phi @ np.linalg.solve(seen, np.eye(n)[:, -1]) * e
        x = phi @ x
    return np.array(rows)


def by_inclusion(k: Array, rho: float, y: Array, x: Array, dt: float) -> Array:
    """The generalised equation of an implicit step, its root by Brent's method."""
    n, rows = len(k), []
    back = np.linalg.inv(np.eye(n) - dt * np.diag(np.ones(n - 1), 1))
    for sample in y:
        x = back @ x
        if not np.isnan(sample):
            b = sample - x[0]
            of = k * rho ** np.arange(1, n + 1)
            g = of * dt ** np.arange(1, n + 1)
            v = np.zeros(n)
            if abs(b) <= g[-1]:
                v[-1] = of[-1] * b / g[-1]
            else:

                def off(s: float, g: Array = g, b: float = b) -> float:
                    return float(np.polyval(np.append(1.0, g), s) - abs(b))

                s = brentq(off, 0.0, abs(b) ** (1.0 / n) + 1.0, xtol=1e-300, rtol=1e-15)
                v = of * s ** np.arange(n - 1, -1, -1) * np.sign(b)
            x = x + back @ (dt * v)
        rows.append(x)
    return np.array(rows)


def gapped(count: int = 150) -> Array:
    y = noisy()[:count].copy()
    y[[30, 31, 32, 70]] = np.nan
    return y


@pytest.mark.parametrize("n", FIRST_ORDERS)
@pytest.mark.parametrize("degree", [-1.0, -0.8, -0.3, 0.0])
@pytest.mark.parametrize(
    ("method", "recursion"), [("proper", by_proper), ("implicit-map", by_placement)]
)
def test_schemes_are_the_recursions_written_out(
    method: str, recursion: Any, degree: float, n: int
) -> None:
    """Poles that lie apart, one pair of them complex, and a rate far from 1."""
    poles = [-0.7 + 0.9j, -0.7 - 0.9j, -1.4, -2.3, -3.1][:n]
    k, rho, dt = np.poly(poles).real[1:], 3.7, 0.013
    observer = hgo_rs.StandardObserver(
        n, hgo_rs.HomogeneousGain(rho, degree), k=k, method=method, timing="predictor"
    )
    start = np.array([0.4, -0.3, 0.2, 0.1, -0.5])[:n]
    expected = recursion(k, rho, degree, gapped(), start, dt)
    assert run(observer, gapped(), start, dt) == pytest.approx(expected, rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("n", FIRST_ORDERS)
@pytest.mark.parametrize(("bound", "dt"), [(0.02, 0.05), (1.1, 0.01), (40.0, 0.1)])
def test_the_implicit_step_is_the_root_of_its_inclusion(bound: float, dt: float, n: int) -> None:
    """Without gaps: over one the correction is for all of the time, which is tested below."""
    k = np.asarray(design.levant_coefficients(n))
    y, start = noisy()[:60], np.array([0.4, -0.3, 0.2, 0.1, -0.5])[:n]
    expected = by_inclusion(k, bound ** (1.0 / n), y, start, dt)
    moved = np.linalg.inv(np.eye(n) - dt * np.diag(np.ones(n - 1), 1)) @ start
    found = run(levant(n, bound, "implicit"), y, moved, dt)[:, :n]
    scale = np.abs(expected).max(axis=0)
    assert np.abs(found - expected).max(axis=0) / scale == pytest.approx(np.zeros(n), abs=1e-9)


@pytest.mark.parametrize("n", [2, 5, 8])
def test_the_root_of_an_implicit_step_is_found_at_every_size(n: int) -> None:
    """One step from 0: x_hat_1+ = b - e+, and e+ = s^n solves the polynomial."""
    k, dt = np.asarray(design.levant_coefficients(n)), 0.01
    g = k * dt ** np.arange(1, n + 1)
    law = levant(n, 1.0, "implicit")
    for b in g[-1] * np.concatenate([[0.5, 1.0], 1.0 + 10.0 ** np.arange(-12, 12, dtype=float)]):
        x_hat = run(law, np.array([b]), None, dt)[0, :n]
        s = max(b - x_hat[0], 0.0) ** (1.0 / n)
        # the middle states tell s better where x_hat_1 is b to rounding
        v1 = (x_hat[0] - dt * x_hat[1]) / dt / k[0]
        s = s if b > 2.0 * g[-1] else max(v1, 0.0) ** (1.0 / (n - 1))
        value = float(np.polyval(np.append(1.0, g), s))
        assert value == pytest.approx(max(b, g[-1]), rel=1e-9), b


# --- identities -------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["proper", "implicit-map", "implicit", "inter-sample"])
def test_degree_0_is_the_constant_gain_bit_for_bit(method: str) -> None:
    homogeneous = hgo_rs.StandardObserver(3, hgo_rs.HomogeneousGain(20.0, 0.0), method=method)
    constant = hgo_rs.StandardObserver(3, 20.0, method=method)
    assert np.array_equal(homogeneous.run(0.01, noisy()).x_hat, constant.run(0.01, noisy()).x_hat)


@pytest.mark.parametrize("method", ["proper", "implicit-map", "implicit", "inter-sample"])
@pytest.mark.parametrize(("c", "a"), [(3.0, 1.0), (0.01, 1.0), (1.0, 0.5), (1.0, 4.0)])
def test_levants_differentiator_scales(method: str, c: float, a: float) -> None:
    """(y, L) -> c (y, L) gives c x_hat; (T, L) -> (a T, L/a^n) gives a^(1-i) x_hat_i."""
    n, start = 3, np.array([0.5, 0.2, -0.1])
    scale = c * a ** (-np.arange(n))
    first = run(levant(n, 1.1, method), SINE, start, 0.01)[:, :n]
    second = run(levant(n, c * 1.1 / a**n, method), c * SINE, scale * start, a * 0.01)[:, :n]
    assert second == pytest.approx(first * scale, rel=1e-8, abs=1e-9 * c)


@pytest.mark.parametrize(("c", "a"), [(3.0, 1.0), (1.0, 4.0)])
def test_the_filtering_differentiator_scales(c: float, a: float) -> None:
    n, m, start = 2, 2, np.array([0.5, 0.2])
    scale = c * a ** (-np.arange(n))
    first = run(filtering(n, m, 1.1), SINE, start, 0.01)[:, :n]
    second = run(filtering(n, m, c * 1.1 / a**n), c * SINE, scale * start, a * 0.01)
    assert second[:, :n] == pytest.approx(first * scale, rel=1e-8, abs=1e-9 * c)


@pytest.mark.parametrize("missing", [0, 3])
def test_an_implicit_step_that_slides_is_the_backward_difference(missing: int) -> None:
    """n = 2: x_hat = (y, (y - y before)/T), T the time between the samples that there are."""
    dt = 0.01
    y = SINE.copy()
    y[50 : 50 + missing] = np.nan
    x_hat = levant(2, 50.0, "implicit").run(dt, y).x_hat
    assert x_hat[10:50, 0] == pytest.approx(y[10:50], rel=1e-14)
    assert x_hat[10:50, 1] == pytest.approx(np.diff(y[9:50]) / dt, rel=1e-12)
    after = 50 + missing
    slope = (y[after] - y[49]) / (dt * (1 + missing))
    assert x_hat[after] == pytest.approx((y[after], slope), rel=1e-12)


def test_the_last_state_chatters_by_its_sign_alone() -> None:
    """A ramp: the explicit form leaves +- T k_n L in x_hat_2, the implicit form nothing."""
    t = 0.01 * np.arange(2001)
    k, bound = 1.1, 2.0
    left = {}
    for method in ("euler", "proper", "implicit"):
        x_hat = levant(2, bound, method).run(0.01, 3.0 * t).x_hat
        left[method] = np.abs(x_hat[1500:, 1] - 3.0).max()
    assert 0.0 < left["euler"] < 2.0 * 0.01 * k * bound
    assert left["proper"] == pytest.approx(left["euler"], rel=1e-6)
    assert left["implicit"] < 1e-11


def test_levants_differentiator_is_as_exact_as_its_sampling() -> None:
    """Largest errors of sin for t in 15 ... 20 s at T = 20, 10, 5 ms, to 10 %."""
    known = (
        (7.21e-5, 2.88e-3, 0.0910),
        (8.49e-6, 6.70e-4, 0.0430),
        (1.08e-6, 1.70e-4, 0.0215),
    )
    for dt, worst in zip((0.02, 0.01, 0.005), known, strict=True):
        t = dt * np.arange(round(20.0 / dt) + 1)
        x = np.column_stack([np.sin(t), np.cos(t), -np.sin(t)])
        x_hat = levant(3, 1.1, "proper").run(dt, x[:, 0], x_hat0=(0.0, 1.0, 0.0)).x_hat
        assert np.abs(x_hat - x)[t >= 15.0].max(axis=0) == pytest.approx(worst, rel=0.1), dt


def test_linear_laws_under_the_schemes_are_their_matrices() -> None:
    """Explicit: Phi - T kC; backward Euler: (1 - T (A - kC))^-1; 1/(1 - T lambda)."""
    n, dt, ell = 3, 0.02, 15.0
    k = np.array([3.0, 4.0, 2.0])
    scaled = k * ell ** np.arange(1, 4)
    a = np.diag(np.ones(n - 1), 1)
    closed = a - np.outer(scaled, np.eye(n)[0])
    manner: dict[str, Any] = {"k": k, "allow_unstable": True}
    law = hgo_rs.StandardObserver(n, ell, method="proper", timing="predictor", **manner)
    assert design.discrete(law.spec, dt).a == pytest.approx(
        chain(n, dt) + dt * (closed - a), rel=1e-9
    )
    law = hgo_rs.StandardObserver(n, ell, method="implicit", **manner)
    wanted = np.poly(1.0 / (1.0 - dt * np.linalg.eigvals(closed)))
    assert np.poly(design.discrete(law.spec, dt).a) == pytest.approx(wanted, rel=1e-8)
    law = hgo_rs.StandardObserver(n, ell, method="implicit-map", **manner)
    assert np.poly(design.discrete(law.spec, dt).a) == pytest.approx(wanted, rel=1e-8)


# --- inter-sample predictor -------------------------------------------------------------------


def test_an_inter_sample_step_meets_its_numbers() -> None:
    law = hgo_rs.StandardObserver(3, 10.0, k=(3.0, 3.0, 1.0), method="inter-sample")
    assert law.timing == "predictor"
    for backend in BACKENDS:
        memory = run(law, np.array([1.1, 0.0]), (0.3, -0.2, 0.7), 0.05, backend)
        row = (1.117112835768, 6.692741083389, 21.416529062709)
        assert memory[1, :3] == pytest.approx(row, rel=1e-11)
        assert memory[1, 3] == pytest.approx(0.8 * np.exp(-1.5), rel=1e-12)
    std = np.sqrt(law.noise_gain(0.05) * 1e-4)
    assert std == pytest.approx((1.159143975e-2, 1.037446636e-1, 3.318887717e-1), rel=1e-8)


@pytest.mark.parametrize("n", FIRST_ORDERS)
@pytest.mark.parametrize("c", [1e-6, 0.3, 30.0, 400.0])
def test_an_inter_sample_step_is_both_differential_equations(c: float, n: int) -> None:
    """G by the exponential of (x, c), or where that is too stiff by its limit 1/k_1 of moments."""
    poles = [-0.7 + 0.9j, -0.7 - 0.9j, -1.4, -2.3, -3.1][:n]
    k, ell = np.poly(poles).real[1:], 20.0
    dt = c / ell
    of = k * ell ** np.arange(1, n + 1)
    system = np.zeros((n + 1, n + 1))
    system[: n - 1, 1:n] = np.eye(n - 1)
    system[:n, n], system[n, n] = of, -of[0]
    scale = np.append(dt ** np.arange(n), 1.0)
    x0 = np.append(np.array([0.4, -0.3, 0.2, 0.1, -0.5])[:n] / scale[:n], 0.0)
    law = hgo_rs.StandardObserver(n, ell, k=k, method="inter-sample", allow_unstable=True)
    found = run(law, np.array([x0[0] + 0.7, 0.0]), x0[:n], dt)[1]
    scaled = expm(scale[:, None] * system / scale * dt)
    expected = scaled @ (scale * (x0 + 0.7 * np.eye(n + 1)[n]))
    assert scale * found == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_the_output_is_predicted_between_samples() -> None:
    """w' = x_hat_2, w = y at the sample, by an ODE solver; then Euler as dt goes to 0."""
    k, ell, dt = np.array([2.0, 3.0]), 8.0, 0.11
    of = k * ell ** np.arange(1, 3)

    def both(_: float, z: Array) -> Array:
        x1, x2, w = z
        return np.array([x2 + of[0] * (w - x1), of[1] * (w - x1), x2])

    moved = solve_ivp(both, (0.0, dt), (0.3, -1.0, 0.9), rtol=1e-12, atol=1e-13, method="DOP853")
    law = hgo_rs.StandardObserver(2, ell, k=k, method="inter-sample")
    memory = run(law, np.array([0.9, 0.0]), (0.3, -1.0), dt)
    assert memory[1, :2] == pytest.approx(moved.y[:2, -1], rel=1e-9)
    assert memory[1, 2] == pytest.approx(moved.y[2, -1] - moved.y[0, -1], rel=1e-9)
    small = 1e-6
    found = run(law, np.array([0.9, 0.0]), (0.3, -1.0), small)[1, :2]
    euler = np.array([0.3, -1.0]) + small * np.array([-1.0 + of[0] * 0.6, of[1] * 0.6])
    assert (found - euler) / small == pytest.approx(np.zeros(2), abs=2e-3)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("m", [2, 5])
def test_a_gap_is_one_long_inter_sample_step(m: int, backend: str) -> None:
    law = hgo_rs.StandardObserver(3, 6.0, method="inter-sample")
    dt, start = 0.03, (0.3, -0.2, 0.7)
    whole = noisy()[: 40 * m : m]
    y = np.full(40 * m, np.nan)
    y[::m] = whole
    by_gaps = run(law, y, start, dt, backend)[::m]
    assert by_gaps == pytest.approx(run(law, whole, start, m * dt, backend), rel=1e-9, abs=1e-11)


def test_an_inter_sample_predictor_follows_polynomials() -> None:
    t = 0.05 * np.arange(400)
    y = 1.0 + 2.0 * t - 0.3 * t**2
    x_hat = hgo_rs.StandardObserver(3, 8.0, method="inter-sample").run(0.05, y).x_hat
    wanted = np.column_stack([y, 2.0 - 0.6 * t, np.full_like(t, -0.6)])
    assert x_hat[-1] == pytest.approx(wanted[-1], rel=1e-9)


@pytest.mark.parametrize(
    ("method", "k", "limit"),
    [
        ("inter-sample", (2, 1), 4.99990919),
        ("inter-sample", (3, 3, 1), 2.89627350),
        ("inter-sample", (4, 6, 4, 1), 1.28316601),
        ("proper", (2, 1), 2.0 * (np.sqrt(2.0) - 1.0)),
        ("proper", (3, 3, 1), 0.52752523),
        ("proper", (4, 6, 4, 1), 0.38757453),
    ],
)
def test_step_limits_come_from_the_laws_own_step(method: str, k: Any, limit: float) -> None:
    law = hgo_rs.StandardObserver(len(k), 1.0, k=k, method=method)
    assert law.step_limit().c == pytest.approx(limit, rel=1e-7)
    with pytest.raises(hgo_rs.HgoError, match="stability limit"):
        law.run(1.01 * limit, np.zeros(3))


def test_methods_that_are_stable_at_any_step_have_no_limit() -> None:
    for method in ("implicit", "implicit-map"):
        law = hgo_rs.StandardObserver(4, 10.0, method=method)
        assert law.step_limit().dt == np.inf
        for dt in (0.1, 1.0, 10.0):
            assert design.discrete(law.spec, dt).radius < 1.0


# --- all of them ------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["proper", "implicit", "implicit-map", "inter-sample"])
def test_nothing_is_injected_without_an_error(method: str) -> None:
    observer = hgo_rs.StandardObserver(2, hgo_rs.HomogeneousGain(2.0), method=method)
    assert not observer.run(0.01, np.zeros(5)).memory[:, :2].any()


@pytest.mark.parametrize("method", ["proper", "implicit", "implicit-map", "inter-sample"])
def test_files_and_single_steps_have_the_bits_of_a_record(method: str, tmp_path: Any) -> None:
    model = hgo_rs.Model(states=["q", "v", "a"], phi="-sin(q) - 0.3*v + cos(3*t)")
    observer = hgo_rs.StandardObserver(3, 6.0, model=model, method=method)
    observer.save(tmp_path / "observer.toml")
    again = hgo_rs.load(tmp_path / "observer.toml").observer()
    assert again.spec == observer.spec
    y = gapped()
    record = observer.run(0.01, y)
    assert np.array_equal(again.run(0.01, y).memory, record.memory)
    observer.reset()
    for sample in y[:60]:
        observer.step(sample, dt=0.01)
    rows = record.x_hat if observer.timing == "predictor" else again.run(0.01, y[:60]).x_hat
    at = 60 if observer.timing == "predictor" else 59
    assert np.array_equal(observer.x_hat, rows[at])


def test_a_model_moves_by_its_motion_and_is_known() -> None:
    """phi known exactly: the error is that of the linear law, whatever the signal."""
    dt = 0.02
    law = {"states": ["q", "v"], "phi": "-4*sin(q)"}
    t = dt * np.arange(400)
    plant = solve_ivp(
        lambda _, x: (x[1], -4.0 * np.sin(x[0])), (0.0, t[-1]), (1.0, 0.0), t_eval=t, rtol=1e-11
    )
    for method in ("proper", "inter-sample"):
        observer = hgo_rs.StandardObserver(2, 8.0, model=hgo_rs.Model(**law), method=method)
        assert observer.spec["motion"] == "rk4"
        error = np.abs(observer.run(dt, plant.y[0], x_hat0=(0.8, 0.3)).x_hat - plant.y.T)
        assert error[-1].max() < 1e-6 < error[0].max()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: levant(2, 1.0, "implicit", timing="predictor"), "'current' under method"),
        (
            lambda: hgo_rs.StandardObserver(2, 1.0, method="inter-sample", timing="current"),
            "'predictor' under method",
        ),
        (
            lambda: hgo_rs.LowPowerObserver(3, 1.0, method="implicit"),
            "defined for the laws standard",
        ),
        (
            lambda: hgo_rs.LowPowerObserver(3, 1.0, method="inter-sample"),
            "defined for the laws standard",
        ),
        (lambda: hgo_rs.LowPowerObserver(6, 1.0, method="implicit-map"), "up to order 5"),
        (
            lambda: hgo_rs.StandardObserver(
                2, hgo_rs.HomogeneousGain(1.0, -0.5), method="implicit"
            ),
            "degree = -0.5",
        ),
        (
            lambda: hgo_rs.StandardObserver(
                2, hgo_rs.HomogeneousGain(1.0, mu=1.0), method="implicit"
            ),
            "mu = 0",
        ),
        (
            lambda: hgo_rs.StandardObserver(
                2, 1.0, shape=hgo_rs.Stubborn(5.0, 20.0), method="implicit"
            ),
            "shape",
        ),
        (
            lambda: hgo_rs.StandardObserver(
                2, 1.0, shape=hgo_rs.Fal((1.0, 0.5), 0.1), method="inter-sample"
            ),
            "rows of this shape differ",
        ),
        (
            lambda: filtering(2, 1, 1.0, method="zoh"),
            "defined for the laws standard, low-power, peaking-free",
        ),
        (
            lambda: hgo_rs.HighGainObserver("filtered", 2, 1.0, method="implicit"),
            "defined for the laws standard",
        ),
        (
            lambda: hgo_rs.StandardObserver(2, 1.0, method="implicit", motion="rk4"),
            "integrates the model itself",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(make: Any, message: str) -> None:
    with pytest.raises(hgo_rs.HgoError, match=message):
        make()
