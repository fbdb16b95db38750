"""Gain laws of the innovation and of a clock, against numbers of independent programs.

Numbers are those of a specification, computed twice by programs that share nothing with this
package: 1e-9 relative for recursions, 1e-6 where a sign is inside.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from test_families import BACKENDS, DT, LISTED, STEP, check, noisy, run

import hgo_rs
from hgo_rs import design

Array = npt.NDArray[np.float64]

# --- homogeneous: Levant ----------------------------------------------------------------------

LEVANT: dict[tuple[str, int], tuple[float, ...]] = {
    ("euler", 2): (0.755391520, 0.5566),
    ("euler", 3): (0.728383164, 0.611851808, 0.5808),
    ("zoh", 2): (0.752834235, 0.542737425),
    ("zoh", 3): (0.728126468, 0.604172064, 0.569180023),
    ("bilinear", 2): (0.752821387, 0.542741968),
    ("bilinear", 3): (0.728117769, 0.604149128, 0.569175252),
}
SINE = np.sin(0.01 * np.arange(101))


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("method", "n"), LEVANT)
def test_levants_differentiator_meets_its_numbers(method: str, n: int, backend: str) -> None:
    gain = hgo_rs.HomogeneousGain.levant(1.1, n)
    manner = {"method": method, "timing": "predictor"}
    k = design.levant_coefficients(n)
    observer = hgo_rs.StandardObserver(n, gain, k=k, **manner)  # type: ignore[arg-type]
    memory = run(observer, SINE, (0.5, *[0.0] * (n - 1)), backend, 0.01)
    check(memory, {100: LEVANT[method, n]}, 1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("gain", "method", "row"),
    [
        (hgo_rs.HomogeneousGain(2.0), "zoh", (0.841782550, 0.543837594, -0.805100450)),
        (hgo_rs.HomogeneousGain(5.0, -0.5), "euler", (0.841471005, 0.536088959, -0.845310822)),
        (hgo_rs.HomogeneousGain(5.0, -0.5), "zoh", (0.841472176, 0.540490238, -0.825633780)),
        (hgo_rs.HomogeneousGain(20.0, 0.0), "zoh", (0.841581653, 0.545698529, -0.744846412)),
    ],
)
def test_other_degrees_meet_their_numbers(gain: Any, method: str, row: Any, backend: str) -> None:
    observer = hgo_rs.StandardObserver(
        3, gain, k=(3.0, 3.0, 1.0), method=method, timing="predictor"
    )
    check(run(observer, SINE, (0.5, 0.0, 0.0), backend, 0.01), {100: row}, 1e-6)


def test_the_coefficients_are_those_of_the_literature() -> None:
    known = {
        2: (1.5, 1.1),
        3: (2, 2.121320344, 1.1),
        4: (3, 4.160167646, 3.059473354, 1.1),
        5: (5, 10.031104575, 9.302417654, 4.574979751, 1.1),
        8: (
            *(12, 84.141935273, 281.368270135, 455.396932314),
            *(295.742561636, 88.778107433, 14.133320265, 1.1),
        ),
    }
    for n, k in known.items():
        assert design.levant_coefficients(n) == pytest.approx(k, rel=1e-9)
    with pytest.raises(hgo_rs.HgoError, match="n = 9"):
        design.levant_coefficients(9)


@pytest.mark.parametrize("timing", ["predictor", "current"])
@pytest.mark.parametrize("method", ["euler", "staggered-euler", "rk4", "zoh", "bilinear"])
def test_degree_0_is_the_constant_gain_bit_for_bit(method: str, timing: str) -> None:
    manner: dict[str, Any] = {"method": method, "timing": timing}
    homogeneous = hgo_rs.StandardObserver(3, hgo_rs.HomogeneousGain(20.0, 0.0), **manner)
    constant = hgo_rs.StandardObserver(3, 20.0, **manner)
    assert np.array_equal(homogeneous.run(0.01, noisy()).x_hat, constant.run(0.01, noisy()).x_hat)


@pytest.mark.parametrize("method", ["euler", "zoh", "bilinear"])
@pytest.mark.parametrize(("c", "a"), [(3.0, 1.0), (0.01, 1.0), (1.0, 0.5), (1.0, 4.0)])
def test_levants_differentiator_scales(method: str, c: float, a: float) -> None:
    """(y, L) -> c (y, L) gives c x_hat; (T, L) -> (a T, L/a^n) gives a^(1-i) x_hat_i."""
    n, bound = 3, 1.1

    def estimates(bound: float, y: Array, start: Array, dt: float) -> Array:
        observer = hgo_rs.StandardObserver(
            n,
            hgo_rs.HomogeneousGain.levant(bound, n),
            k=design.levant_coefficients(n),
            method=method,
            timing="predictor",
        )
        return run(observer, y, start, "core", dt)

    start = np.array([0.5, 0.2, -0.1])
    scale = c * a ** (-np.arange(n))
    first = estimates(bound, SINE, start, 0.01)
    second = estimates(c * bound / a**n, c * SINE, scale * start, a * 0.01)
    assert second == pytest.approx(first * scale, rel=1e-8, abs=1e-9 * c)


def test_levants_differentiator_is_as_exact_as_its_sampling() -> None:
    """Largest errors for t in 15 ... 20 s at T = 20, 10, 5 ms, to 10 %."""
    k, gain = design.levant_coefficients(3), hgo_rs.HomogeneousGain.levant(1.1, 3)
    known = {
        "euler": (1.14e-2, 5.32e-3, 2.59e-3),
        "zoh": (1.32e-2, 4.14e-3, 1.21e-3),
    }
    for method, worst in known.items():
        observer = hgo_rs.StandardObserver(3, gain, k=k, method=method, timing="predictor")
        for dt, most in zip((0.02, 0.01, 0.005), worst, strict=True):
            t = dt * np.arange(round(20.0 / dt) + 1)
            x_hat = observer.run(dt, np.sin(t), x_hat0=(0.0, 1.0, 0.0)).x_hat
            error = np.abs(x_hat[:, 1] - np.cos(t))[t >= 15.0].max()
            assert error == pytest.approx(most, rel=0.1), (method, dt)


def test_nothing_is_injected_without_an_error() -> None:
    for method in ("euler", "rk4", "zoh", "bilinear"):
        observer = hgo_rs.StandardObserver(2, hgo_rs.HomogeneousGain(2.0), method=method)
        memory = observer.run(0.01, np.zeros(5)).memory
        assert not memory[:, :2].any(), method


@pytest.mark.parametrize("n", [2, 3])
def test_a_bi_homogeneous_shape_of_degree_minus_1_is_levants(n: int) -> None:
    """theta = 0, kappa = 1: the same functions, with L = ell^n."""
    manner: dict[str, Any] = {"k": design.levant_coefficients(n), **LISTED}
    ones, none = (1.0,) * n, (0.0,) * n
    shape = hgo_rs.BiHomogeneous(-1.0, 0.0, ones, none)
    start = (0.5, *none[1:])
    shaped = run(hgo_rs.StandardObserver(n, 1.5, shape=shape, **manner), SINE, start, "core", 0.01)
    gain = hgo_rs.HomogeneousGain.levant(1.5**n, n)
    levant = run(hgo_rs.StandardObserver(n, gain, **manner), SINE, start, "core", 0.01)
    assert shaped == pytest.approx(levant, rel=1e-9, abs=1e-9)


# --- switched ---------------------------------------------------------------------------------

SWITCHED = hgo_rs.SwitchedGain(fast=100.0, slow=20.0, zone=0.02, delay=0.0205)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_switched_gain_meets_its_numbers(backend: str) -> None:
    observer = hgo_rs.StandardObserver(2, SWITCHED, k=(2.0, 1.0), **LISTED)
    memory = run(observer, STEP[:2001], (1.0, 0.0), backend)
    rows = {
        50: (0.026217674034, -1.897545381086),
        200: (0.195848021531, 0.908944718362),
        1050: (1.379222261167, 1.942718543554),
        2000: (1.411656523948, -0.323047541899),
    }
    check(memory, rows)
    e = STEP[:2000] - memory[:2000, 0]
    quiet = np.where(np.abs(e) > 0.02, 0.0, memory[:2000, 2])
    fast = (np.abs(e) > 0.02) | (quiet < 0.0205)
    assert np.count_nonzero(fast) == 139
    assert np.flatnonzero(~fast)[0] == 74
    assert fast[1000:1065].all() and not fast[1065:].any() and not fast[74:1000].any()


def test_switched_gains_become_the_constant_one() -> None:
    def rows(gain: Any, **more: Any) -> Array:
        return (
            hgo_rs.StandardObserver(2, gain, k=(2.0, 1.0), **{**LISTED, **more}).run(DT, STEP).x_hat
        )

    for method in ("euler", "zoh"):
        same = hgo_rs.SwitchedGain(fast=30.0, slow=30.0, zone=0.02)
        assert np.array_equal(rows(same, method=method), rows(30.0, method=method))
        always = hgo_rs.SwitchedGain(fast=30.0, slow=2.0, zone=1e-300, delay=1.0)
        assert np.array_equal(rows(always, method=method), rows(30.0, method=method))
        never = hgo_rs.SwitchedGain(fast=30.0, slow=20.0, zone=1e300)
        assert rows(never, method=method) == pytest.approx(rows(20.0, method=method), rel=1e-9)


# --- prescribed time --------------------------------------------------------------------------


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_prescribed_time_meets_its_numbers(backend: str) -> None:
    gain = hgo_rs.PrescribedTimeGain(mu0=4.0, deadline=1.0, r_max=200.0)
    observer = hgo_rs.StandardObserver(2, gain, k=(9 / 4, 15 / 16), **LISTED)
    memory = run(observer, np.sin(np.arange(1501) * DT), (1.0, 0.0), backend)
    rows = {
        500: (0.405794697576, -0.001367719246),
        900: (0.783979373855, 0.672806835810),
        1500: (0.997521563065, 0.082200015208),
    }
    check(memory, rows)


@pytest.mark.parametrize(
    ("mu0", "k", "start", "rows"),
    [
        (4.0, (9 / 4, 15 / 16), (1.0, 2.0), {0.9: (-4.85e-5, -2.455e-3)}),
        (6.0, (4.0, 40 / 9, 35 / 27), (1.0, 0.0, 0.0), {0.9: (1.104895e-6, 1.990674e-4)}),
    ],
)
def test_errors_die_towards_the_deadline_as_derived(
    mu0: float, k: Any, start: Any, rows: dict[float, tuple[float, ...]]
) -> None:
    """The error of x = 0 in continuous time, by small steps of RK4: e = -x_hat."""
    gain = hgo_rs.PrescribedTimeGain(mu0=mu0, deadline=1.0, r_max=200.0)
    observer = hgo_rs.StandardObserver(len(k), gain, k=k, method="rk4", timing="predictor")
    dt = 2e-4
    memory = observer.run(dt, np.zeros(4501), x_hat0=-np.array(start)).memory
    for t, row in rows.items():
        assert -memory[round(t / dt), : len(row)] == pytest.approx(row, rel=1e-5)


# --- all of them ------------------------------------------------------------------------------

GAINS: dict[str, Any] = {
    "homogeneous": hgo_rs.HomogeneousGain(2.0, -0.7),
    "uniform": hgo_rs.HomogeneousGain(2.0, -1.0, mu=0.5),
    "switched": hgo_rs.SwitchedGain(fast=12.0, slow=4.0, zone=0.05, delay=0.0932),
    "prescribed-time": hgo_rs.PrescribedTimeGain(mu0=4.0, deadline=1.0, r_max=20.0),
}
WORN: dict[str, Any] = {
    "bare": None,
    "stubborn": hgo_rs.Stubborn(decay=5.0, growth=20.0, sigma0=1e-4),
    "rows": hgo_rs.Fal(alpha=(1.0, 0.6, 0.4), delta=0.02),
}


@pytest.mark.parametrize("gain", GAINS)
@pytest.mark.parametrize("shape", WORN)
@pytest.mark.parametrize("law", ["standard", "low-power", "filtered"])
@pytest.mark.parametrize("method", ["euler", "rk4", "zoh"])
@pytest.mark.parametrize("timing", ["predictor", "current"])
def test_gains_agree_with_the_twin(
    gain: str, shape: str, law: str, method: str, timing: str
) -> None:
    given: dict[str, Any] = {"shape": WORN[shape], "method": method, "timing": timing}
    more = {"filters": 1} if law == "filtered" else {}

    def build() -> hgo_rs.Observer:
        return hgo_rs.HighGainObserver(law, 3, GAINS[gain], **given, **more)

    homogeneous = gain in ("homogeneous", "uniform")
    if (law != "standard" and shape == "rows") or (law == "low-power" and homogeneous):
        with pytest.raises(hgo_rs.HgoError):
            build()
        return
    if method == "zoh" and (law == "filtered" or shape == "rows"):
        with pytest.raises(hgo_rs.HgoError):
            build()
        return
    observer, y = build(), noisy()[:250]
    memory = run(observer, y, (0.5, 0.0, 0.0), "core", 0.01)
    twin = run(observer, y, (0.5, 0.0, 0.0), "twin", 0.01)
    rel = 1e-6 if homogeneous else 1e-9
    assert memory == pytest.approx(twin, rel=rel, abs=rel)
    assert np.ptp(memory[:, 0]) > 0.3


@pytest.mark.parametrize("gain", GAINS)
def test_files_and_copies_hold_a_gain(gain: str, tmp_path: Any) -> None:
    observer = hgo_rs.StandardObserver(3, GAINS[gain])
    observer.save(tmp_path / "observer.toml")
    again = hgo_rs.load(tmp_path / "observer.toml").observer()
    assert again.spec == observer.spec
    y = noisy()
    assert np.array_equal(again.run(0.01, y).memory, observer.run(0.01, y).memory)
    observer.reset()
    for k in range(50):  # a sample a call has the bits of the record
        observer.step(y[k], dt=0.01)
    assert np.array_equal(observer.x_hat, again.run(0.01, y[:50]).x_hat[-1])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: hgo_rs.HomogeneousGain(2.0, 0.5), "degree = 0.5"),
        (lambda: hgo_rs.HomogeneousGain(2.0, -1.1), "degree = -1.1"),
        (lambda: hgo_rs.HomogeneousGain(0.0), "rho = 0"),
        (lambda: hgo_rs.HomogeneousGain(1.0, mu=-1.0), "mu = -1"),
        (lambda: hgo_rs.StandardObserver(1, hgo_rs.HomogeneousGain(1.0)), "order 1"),
        (lambda: hgo_rs.LowPowerObserver(3, hgo_rs.HomogeneousGain(1.0)), "low-power"),
        (lambda: hgo_rs.SwitchedGain(1.0, 2.0, 0.1), "slow = 2"),
        (lambda: hgo_rs.SwitchedGain(2.0, 1.0, 0.1, -1.0), "delay = -1"),
        (lambda: hgo_rs.PrescribedTimeGain(4.0, 1.0, 4.0), "r_max = 4"),
        (lambda: hgo_rs.StandardObserver(2, hgo_rs.HomogeneousGain(1.0)).bandwidth(), "linear"),
    ],
)
def test_what_makes_no_sense_is_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


def test_step_limits_are_those_of_the_largest_gain() -> None:
    c = hgo_rs.StandardObserver(2, 1.0, **LISTED).step_limit().c

    def limit(gain: Any) -> float:
        return hgo_rs.StandardObserver(2, gain, **LISTED).step_limit().dt

    assert limit(SWITCHED) == pytest.approx(c / 100.0)
    assert limit(hgo_rs.PrescribedTimeGain(4.0, 1.0, 50.0)) == pytest.approx(c / 50.0)
    assert limit(hgo_rs.HomogeneousGain(2.0)) == np.inf
