"""Families beyond the papers, against numbers of independent programs, and their identities.

Numbers are those of a specification, computed twice by programs that share nothing with this
package; 1e-9 relative for recursions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import hgo_rs
from hgo_rs import reference

Array = npt.NDArray[np.float64]
BACKENDS = ("core", "twin")
DT = 1e-3
STEP = np.sin(np.arange(3001) * DT) + 0.5 * (np.arange(3001) >= 1000)
LISTED = {"method": "euler", "timing": "predictor"}


def run(observer: hgo_rs.Observer, y: Array, start: Any, backend: str, dt: float = DT) -> Array:
    """The memories before each sample, (n_samples, m), from x_hat(0) = `start`."""
    memory = observer.initial_memory(start)
    if backend == "core":
        return observer.run(dt, y, memory0=memory, allow_unstable=True).memory
    t = np.arange(len(y)) * dt
    return np.asarray(reference.Observer(observer.spec).run(t, y, None, memory)["memory"])


def check(memory: Array, rows: dict[int, tuple[float, ...]], rel: float = 1e-9) -> None:
    """Rows of a record of memories against numbers, relative to each of them."""
    for k, row in rows.items():
        assert memory[k, : len(row)] == pytest.approx(row, rel=rel), k


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_piecewise_linear_gain_meets_its_numbers(backend: str) -> None:
    shape = hgo_rs.PiecewiseLinear(ratio=0.2, zone=0.02)
    observer = hgo_rs.StandardObserver(2, 100.0, k=(2.0, 1.0), shape=shape, **LISTED)
    rows = {
        50: (0.006184220464, -2.651456251371),
        200: (0.192839079278, 0.835897873439),
        1050: (1.399295498571, 2.702757493190),
        2000: (1.411656524858, -0.323047522846),
    }
    check(run(observer, STEP, (1.0, 0.0), backend), rows)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_piecewise_linear_gain_leaves_a_steady_error_as_derived(backend: str) -> None:
    """y'' = 25: a/(k_2 ell_1^2) + (1 - ratio^2) d beyond the zone."""
    shape = hgo_rs.PiecewiseLinear(ratio=0.2, zone=0.02)
    observer = hgo_rs.StandardObserver(2, 100.0, k=(2.0, 1.0), shape=shape, **LISTED)
    k = np.arange(4001)
    y = 25.0 * DT**2 * k * (k - 1) / 2  # what Euler's chain takes for y'' = 25
    memory = run(observer, y, None, backend)
    assert y[-1] - memory[-1, 0] == pytest.approx(0.0217, rel=1e-6)


OUTLIER = np.sin(np.arange(3001) * DT)
OUTLIER[1500] += 10.0


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_stubborn_observer_meets_its_numbers(backend: str) -> None:
    given: dict[str, Any] = {"k": (2.0, 1.0), **LISTED}
    shape = hgo_rs.Stubborn(decay=5.0, growth=20.0, sigma0=0.01)
    stubborn = hgo_rs.StandardObserver(2, 30.0, shape=shape, **given)
    memory = run(stubborn, OUTLIER, (0.0, 1.0), backend)
    assert memory[1500:1502, 2] == pytest.approx([9.708193774e-6, 1.999569844], rel=1e-9)
    rows = {1600: (1.000676197964, 0.036507776583), 3000: (0.141348379218, -0.977446902526)}
    check(memory, rows, 1e-8)
    t = np.arange(3001) * DT
    x = np.column_stack([np.sin(t), np.cos(t)])
    worst = np.abs(memory[1501:, :2] - x[1501:]).max(axis=0)
    assert worst == pytest.approx([1.352674e-3, 6.942940e-2], rel=1e-6)
    standard = run(hgo_rs.StandardObserver(2, 30.0, **given), OUTLIER, (0.0, 1.0), backend)
    worst = np.abs(standard[1501:] - x[1501:]).max(axis=0)
    assert worst == pytest.approx([0.601099750, 9.065635540], rel=1e-8)
    assert np.array_equal(memory[:1501, :2], standard[:1501])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("growth", "error"), [(2.5, 0.02), (20.0, 0.01)])
def test_thresholds_leave_a_steady_error_as_derived(
    growth: float, error: float, backend: str
) -> None:
    """y'' = 9, ell = 30: a/(k_2 ell^2 (1 - q)) with the dead zone, as standard if stubborn."""
    law = hgo_rs.DeadZone if growth < 10.0 else hgo_rs.Stubborn
    shape = law(decay=10.0, growth=growth)
    observer = hgo_rs.StandardObserver(2, 30.0, k=(2.0, 1.0), shape=shape, **LISTED)
    k = np.arange(20001)
    y = 9.0 * DT**2 * k * (k - 1) / 2
    memory = run(observer, y, None, backend)
    assert y[-1] - memory[-1, 0] == pytest.approx(error, rel=1e-8)
    assert memory[-1, 2] == pytest.approx(growth / 10.0 * error**2, rel=1e-8)


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("alpha", "beta", "row"),
    [
        ((1, 0.5, 0.25), (100, 300, 1000), (0.909287018284, -0.417672082303, -0.943077165982)),
        ((1, 1, 1), (60, 1200, 8000), (0.909262910231, -0.418792057642, -0.957444791873)),
    ],
)
def test_fal_meets_its_numbers(alpha: Any, beta: Any, row: Any, backend: str) -> None:
    shape = hgo_rs.Fal(alpha=alpha, delta=0.01)
    observer = hgo_rs.StandardObserver(3, 1.0, k=beta, shape=shape, **LISTED)
    memory = run(observer, np.sin(np.arange(2001) * DT), None, backend)
    check(memory, {2000: row})


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("e", "value"), [(0.005, 0.05), (0.04, 0.2), (-0.04, -0.2), (0.0, 0.0)])
def test_fal_is_the_function_of_the_paper(e: float, value: float, backend: str) -> None:
    """One Euler step from rest: the second state moves by dt k_2 ell^2 fal(e)."""
    shape = hgo_rs.Fal(alpha=(1.0, 0.5), delta=0.01)
    observer = hgo_rs.StandardObserver(2, 1.0, k=(2.0, 1.0), shape=shape, **LISTED)
    memory = run(observer, np.array([e, e]), None, backend)
    assert memory[1, 1] == pytest.approx(DT * value, rel=1e-12)


BI = {
    (2, -1.0, 0.2): {
        0.01: (0.103162277660, 1.065497557759),
        0.5: (1.127554988813, 2.154955568180),
        100.0: (326.227766016838, 1039.066334143162),
    },
    (3, -0.5, 0.2): {2.0: (4.201634930297, 8.619343605643, 16.196650726473)},
}


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("n", "near", "far"), BI)
def test_bi_homogeneous_functions_meet_their_numbers(
    n: int, near: float, far: float, backend: str
) -> None:
    """One Euler step from rest moves state i by dt k_i v_i."""
    shape = hgo_rs.BiHomogeneous(near, far, (1.0,) * n, (1.0,) * n)
    k = np.array({2: (2.0, 1.0), 3: (3.0, 3.0, 1.0)}[n])
    observer = hgo_rs.StandardObserver(n, 1.0, k=k, shape=shape, **LISTED)
    for e, v in BI[n, near, far].items():
        memory = run(observer, np.array([e, e]), None, backend)
        assert memory[1] == pytest.approx(DT * k * np.array(v), rel=1e-10)
        memory = run(observer, np.array([-e, e]), None, backend)
        assert memory[1] == pytest.approx(-DT * k * np.array(v), rel=1e-10)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_bi_homogeneous_observer_meets_its_numbers(backend: str) -> None:
    shape = hgo_rs.BiHomogeneous(-0.5, 0.2, (1.0, 1.0), (1.0, 1.0))
    observer = hgo_rs.StandardObserver(2, 8.0, k=(2.0, 1.0), shape=shape, **LISTED)
    memory = run(observer, np.sin(np.arange(301) * DT) + 2.0, None, backend)
    check(memory, {300: (2.297469730232, 0.964252662734)})


def test_a_bi_homogeneous_error_is_that_of_two_integrators() -> None:
    """y = 0 in continuous time, e = -x_hat, by small steps of RK4."""
    shape = hgo_rs.BiHomogeneous(-0.5, 0.2, (1.0, 1.0), (1.0, 1.0))
    manner = {"method": "rk4", "timing": "predictor"}
    observer = hgo_rs.StandardObserver(2, 3.0, k=(2.0, 1.0), shape=shape, **manner)  # type: ignore[arg-type]
    dt = 1e-4
    memory = observer.run(dt, np.zeros(2001), x_hat0=(-5.0, 0.0)).memory
    assert -memory[2000] == pytest.approx([-0.258729707, -10.22597024], rel=1e-6)


# --- identities -------------------------------------------------------------------------------

STANDARD_BY: dict[str, tuple[float, Any]] = {
    "one gain": (100.0, lambda: hgo_rs.PiecewiseLinear(ratio=1.0, zone=0.02)),
    "no zone": (100.0, lambda: hgo_rs.PiecewiseLinear(ratio=0.2, zone=1e-300)),
    "no outside": (20.0, lambda: hgo_rs.PiecewiseLinear(ratio=0.2, zone=1e300)),
    "never saturated": (100.0, lambda: hgo_rs.Stubborn(decay=1.0, growth=1.0, sigma0=1e6)),
    "no threshold": (100.0, lambda: hgo_rs.DeadZone(decay=1.0, growth=0.0)),
    "degree 0": (100.0, lambda: hgo_rs.BiHomogeneous(0.0, 0.0, (1.0, 1.0), (0.0, 0.0))),
    "linear": (100.0, lambda: hgo_rs.Fal(alpha=(1.0, 1.0), delta=0.01)),
}


@pytest.mark.parametrize("case", STANDARD_BY)
@pytest.mark.parametrize("timing", ["predictor", "current"])
@pytest.mark.parametrize("method", ["euler", "rk4", "zoh"])
def test_shapes_become_the_standard_law(case: str, method: str, timing: str) -> None:
    ell, shape = STANDARD_BY[case]
    manner: dict[str, Any] = {"k": (2.0, 1.0), "method": method, "timing": timing}
    if method == "zoh" and not shape().alike:
        with pytest.raises(hgo_rs.HgoError, match="rows of this shape differ"):
            hgo_rs.StandardObserver(2, 100.0, shape=shape(), **manner)
        return
    shaped = hgo_rs.StandardObserver(2, 100.0, shape=shape(), **manner).run(DT, STEP)
    standard = hgo_rs.StandardObserver(2, ell, **manner).run(DT, STEP)
    assert shaped.x_hat == pytest.approx(standard.x_hat, rel=1e-9, abs=1e-9)
    if case in ("never saturated", "linear"):
        assert np.array_equal(shaped.x_hat, standard.x_hat)


SHAPES: dict[str, hgo_rs.observers.Shape] = {
    "stubborn": hgo_rs.Stubborn(decay=5.0, growth=20.0, sigma0=1e-4),
    "dead-zone": hgo_rs.DeadZone(decay=5.0, growth=2.0, sigma0=1e-4),
    "piecewise-linear": hgo_rs.PiecewiseLinear(ratio=0.5, zone=0.05),
    "fal": hgo_rs.Fal(alpha=(1.0, 0.6, 0.4), delta=0.02),
    "bi-homogeneous": hgo_rs.BiHomogeneous(-0.4, 0.2, (1.0, 0.5, 0.3), (0.2, 0.1, 0.2)),
}


def noisy(n: int = 400) -> Array:
    """A signal with noise, an outlier and two gaps."""
    y = np.sin(np.arange(n) * 0.01) + 0.02 * np.random.default_rng(7).standard_normal(n)
    y[120] += 3.0
    y[[60, 61, 62, 200]] = np.nan
    return np.asarray(y)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("gain", ["constant", "adaptive"])
@pytest.mark.parametrize("law", [hgo_rs.StandardObserver, hgo_rs.LowPowerObserver, "filtered"])
@pytest.mark.parametrize("method", ["euler", "rk4", "zoh"])
@pytest.mark.parametrize("timing", ["predictor", "current"])
def test_shapes_agree_with_the_twin(
    shape: str, gain: str, law: Any, method: str, timing: str
) -> None:
    ell = 6.0 if gain == "constant" else hgo_rs.AdaptiveGain(5.0, 0.01, 0.2)
    worn = SHAPES[shape]
    given: dict[str, Any] = {"shape": worn, "method": method, "timing": timing}

    def build() -> hgo_rs.Observer:
        if law == "filtered":
            return hgo_rs.HighGainObserver("filtered", 3, ell, filters=1, **given)
        return law(3, ell, **given)  # type: ignore[no-any-return]

    if not worn.alike and (law is not hgo_rs.StandardObserver or method == "zoh"):
        with pytest.raises(hgo_rs.HgoError, match="rows of this shape differ"):
            build()
        return
    if law == "filtered" and method == "zoh":
        return
    observer, y = build(), noisy()
    memory = run(observer, y, (0.5, 0.0, 0.0), "core", 0.01)
    twin = run(observer, y, (0.5, 0.0, 0.0), "twin", 0.01)
    assert memory == pytest.approx(twin, rel=1e-9, abs=1e-9)
    assert np.ptp(memory[:, 0]) > 0.5


@pytest.mark.parametrize("shape", SHAPES)
def test_a_missing_sample_injects_nothing(shape: str) -> None:
    observer = hgo_rs.StandardObserver(3, 6.0, shape=SHAPES[shape], **LISTED)
    start = observer.initial_memory((0.5, -1.0, 2.0))
    (memory,) = observer.run(0.01, [np.nan], memory0=start, until=0.01).next_memory[None]
    assert memory[:3] == pytest.approx([0.49, -0.98, 2.0], rel=1e-14)
    if len(memory) > 3:
        assert memory[3] == pytest.approx(start[3] * (1 - 0.01 * 5.0), rel=1e-14)


# --- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("k", "most"),
    [
        ((3.0, 3.0, 1.0), 3.0),
        ((4.0, 6.0, 4.0, 1.0), 2.2398288),
        (None, 3.1224901),
        (None, 2.2972429),
        (None, 1.9293974),
    ],
)
def test_a_ratio_beyond_the_circle_criterion_is_refused(k: Any, most: float) -> None:
    n = len(k) if k else {3.1224901: 3, 2.2972429: 4, 1.9293974: 5}[most]

    def build(ratio: float) -> hgo_rs.Observer:
        shape = hgo_rs.PiecewiseLinear(ratio=ratio, zone=0.1)
        return hgo_rs.StandardObserver(n, 20.0, k=k, shape=shape)

    build(1.0 / (most * (1 - 1e-6)))
    with pytest.raises(hgo_rs.HgoError, match="circle criterion"):
        build(1.0 / (most * (1 + 1e-6)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: hgo_rs.Stubborn(decay=5.0, growth=4.0), "growth = 4"),
        (lambda: hgo_rs.BiHomogeneous(-1.5, 0.0, (1.0,), (1.0,)), "near = -1.5"),
        (lambda: hgo_rs.BiHomogeneous(0.0, 1.0, (1.0, 1.0), (1.0, 1.0)), "far"),
        (lambda: hgo_rs.BiHomogeneous(0.0, 0.1, (1.0, 0.0), (1.0, 0.0)), "sums > 0"),
        (lambda: hgo_rs.DeadZone(decay=5.0, growth=5.0), "growth = 5"),
        (lambda: hgo_rs.DeadZone(decay=0.0, growth=0.0), "decay = 0"),
        (lambda: hgo_rs.Stubborn(decay=1.0, growth=1.0, sigma0=-1.0), "sigma0 = -1"),
        (lambda: hgo_rs.PiecewiseLinear(ratio=1.5, zone=1.0), "ratio = 1.5"),
        (lambda: hgo_rs.PiecewiseLinear(ratio=0.5, zone=0.0), "zone = 0"),
        (lambda: hgo_rs.Fal(alpha=(1.0, 1.2), delta=0.1), "alpha = 1.2"),
        (lambda: hgo_rs.Fal(alpha=(), delta=0.1), "alpha"),
        (lambda: hgo_rs.Fal(alpha=(1.0,), delta=-0.1), "delta = -0.1"),
        (lambda: hgo_rs.StandardObserver(3, 1.0, shape=hgo_rs.Fal((1.0, 0.5), 0.1)), "3 numbers"),
        (lambda: hgo_rs.StandardObserver(2, 1.0, shape=0.5), "shape"),  # type: ignore[arg-type]
    ],
)
def test_what_makes_no_sense_is_refused(make: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


# --- design -----------------------------------------------------------------------------------


def test_the_step_limit_is_that_of_the_steepest_slope() -> None:
    """fal at a small e is the linear law of the gains beta_i delta^(alpha_i - 1)."""
    alpha, delta, k = np.array([1.0, 0.5]), 0.01, np.array([20.0, 30.0])
    shape = hgo_rs.Fal(alpha=tuple(alpha), delta=delta)
    worn = hgo_rs.StandardObserver(2, 1.0, k=k, shape=shape, method="euler", timing="predictor")
    linear = k * delta ** (alpha - 1.0)
    bare = hgo_rs.StandardObserver(2, 1.0, k=linear, method="euler", timing="predictor")
    assert worn.step_limit().dt == pytest.approx(bare.step_limit().dt, rel=1e-9)
    assert worn.bandwidth() == pytest.approx(bare.bandwidth(), rel=1e-9)


def test_a_threshold_does_not_fall_below_zero_in_one_step() -> None:
    shape = hgo_rs.Stubborn(decay=50.0, growth=50.0)
    observer = hgo_rs.StandardObserver(2, 1.0, shape=shape)
    assert observer.step_limit().dt == pytest.approx(0.02)
    with pytest.raises(hgo_rs.HgoError, match=r"dt = 0\.03"):
        observer.run(0.03, np.zeros(4))


@pytest.mark.parametrize("shape", SHAPES)
def test_files_hold_a_shape(shape: str, tmp_path: Any) -> None:
    observer = hgo_rs.StandardObserver(3, 6.0, shape=SHAPES[shape], model=hgo_rs.InputGain(2.0))
    path = tmp_path / "observer.toml"
    observer.save(path)
    again = hgo_rs.load(path).observer()
    assert again.spec == observer.spec
    y = noisy()
    assert np.array_equal(
        again.run(0.01, y, np.ones(len(y))).memory, observer.run(0.01, y, np.ones(len(y))).memory
    )


def test_noise_at_rest_is_that_of_the_gain_within_the_zone() -> None:
    shape = hgo_rs.PiecewiseLinear(ratio=0.2, zone=0.02)
    observer = hgo_rs.StandardObserver(2, 100.0, k=(2.0, 1.0), shape=shape, **LISTED)
    std = np.sqrt(1e-6 * observer.noise_gain(DT))
    assert std == pytest.approx([1.595528169e-4, 1.435695060e-3], rel=1e-8)
    fast = hgo_rs.StandardObserver(2, 100.0, k=(2.0, 1.0), **LISTED)
    std = np.sqrt(1e-6 * fast.noise_gain(DT))
    assert std == pytest.approx([3.703943986e-4, 1.707593907e-2], rel=1e-8)
