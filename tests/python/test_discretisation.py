"""Timing and placed eigenvalues, against exponentials, SciPy and the NumPy reference."""

import itertools

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import cont2discrete
from test_observers import by_steps

from hgo_rs import (
    AdaptiveGain,
    Crackle,
    InputGain,
    LowPowerObserver,
    PeakingFreeObserver,
    RepelledCollection,
    SampledDataObserver,
    StandardObserver,
    simulate,
)
from hgo_rs.design.discrete import fixed_timing
from hgo_rs.errors import HgoError
from hgo_rs.observers import METHODS, TIMINGS
from hgo_rs.reference import Observer as Reference

PLACED = ("zoh", "bilinear", "implicit-map")
STEPS = (0.1, 0.5, 1.0, 3.0, 10.0, 99.0)
ELL = 20.0


def chain(n, ell=ELL):
    """A - K C of the default standard law, and its poles."""
    poles = ell * np.linspace(-1.0, -2.0, n)
    closed = np.diag(np.ones(n - 1), 1)
    closed[:, 0] -= np.poly(poles)[1:]
    return closed, poles


def matrix(observer, dt):
    """One step of a linear law as a matrix on its own memory, y = 0."""
    m = observer._law_len
    unit = np.eye(observer.memory.size)[:m]
    return np.array([observer._core.step(z, [0.0], [], 0.0, dt)[0][:m] for z in unit]).T


def images(poles, dt, method):
    """Where a method places poles."""
    p = np.asarray(poles) * dt
    if method == "implicit-map":
        return 1.0 / (1.0 - p)
    return np.exp(p) if method == "zoh" else (2.0 + p) / (2.0 - p)


def low_power(n, gain=ELL, kind=LowPowerObserver, **more):
    """A law, and its poles at a gain of 1."""
    poles = np.append(np.linspace(-1.0, -2.0, 2 * n - 2), -2.0)
    return kind(n, gain, poles=poles, **more), poles


@pytest.mark.parametrize("c", STEPS)
@pytest.mark.parametrize("n", [1, 2, 3, 5])
@pytest.mark.parametrize("method", PLACED)
def test_the_error_has_the_eigenvalues_that_were_asked_for(method, n, c):
    dt = c / ELL
    closed, poles = chain(n)
    found = matrix(StandardObserver(n, ELL, method=method), dt)
    # z^n + ..., as eigenvalues that lie together are no good measure
    wanted = np.poly(images(poles, dt, method))
    scale = dt ** np.arange(n)
    got = np.poly(scale[:, None] * found / scale)
    assert np.allclose(got, wanted, rtol=0.0, atol=1e-12 * np.abs(wanted).max() * 4.0**n)
    # the same as SciPy's for the closed loop in continuous time
    system = (closed, np.zeros((n, 1)), np.eye(n), np.zeros((n, 1)))
    rule = {"implicit-map": "backward_diff"}.get(method, method)
    scipys = np.poly(cont2discrete(system, dt, rule)[0])
    assert np.allclose(got, scipys, rtol=0.0, atol=1e-11 * np.abs(wanted).max() * 4.0**n)


@pytest.mark.parametrize("c", STEPS)
@pytest.mark.parametrize(
    ("n", "method"), [(2, "zoh"), (3, "zoh"), (4, "zoh"), (3, "bilinear"), (3, "implicit-map")]
)
def test_a_low_power_law_has_them_too(n, method, c):
    dt = c / ELL
    observer, poles = low_power(n, method=method)
    scale = dt ** np.r_[np.arange(n), np.arange(1, n)]
    got = np.poly(scale[:, None] * matrix(observer, dt) / scale)
    wanted = np.poly(images(ELL * poles, dt, method))
    assert np.allclose(got, wanted, rtol=0.0, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("c", [0.9, 1.3, 2.0, 5.0, 7.3, 20.0])
@pytest.mark.parametrize("n", [6, 7, 10, 12])
def test_of_several_sets_of_gains_that_place_them_core_and_reference_take_one(n, c):
    """Over long steps several a and b place the same eigenvalues; rounding must not choose."""
    dt = c / ELL
    observer, _ = low_power(n, method="zoh", timing="predictor", allow_unstable=True)
    twin, y, none = Reference(observer.spec), np.zeros(2), np.empty((2, 0))
    rows = [twin.run([0.0, dt], y, none, unit)["memory"][1] for unit in np.eye(2 * n - 1)]
    scale = dt ** np.r_[np.arange(n), np.arange(1, n)]
    got, wanted = (
        scale[:, None] * one / scale for one in (matrix(observer, dt), np.transpose(rows))
    )
    assert np.abs(got - wanted).max() < 1e-13 * np.abs(wanted).max()


@pytest.mark.parametrize("timing", TIMINGS)
def test_the_error_at_the_samples_is_that_of_the_matrix(timing):
    """Noise-free chain of integrators under a known input: (I - K C) Phi to the k-th power."""
    n, dt, count = 3, 0.03, 40
    phi = expm(np.diag(np.ones(n - 1), 1) * dt)
    gamma = cont2discrete((np.diag(np.ones(n - 1), 1), np.eye(n)[:, -1:], np.eye(n), 0), dt)[1]
    u = np.sin(np.arange(count))
    x = [np.array([0.3, -1.0, 2.0])]
    for k in range(count - 1):
        x.append(phi @ x[-1] + 0.7 * gamma[:, 0] * u[k])
    x = np.array(x)
    observer = StandardObserver(n, ELL, model=InputGain(0.7), method="zoh", timing=timing)
    run = observer.run(dt, x[:, 0], u)
    error = x - run.x_hat
    one = matrix(StandardObserver(n, ELL, method="zoh", timing="predictor"), dt)  # Phi (I - K C)
    if timing == "current":
        one = np.linalg.solve(phi, one) @ phi
    for k in range(1, count):
        power = np.linalg.matrix_power(one, k) @ error[0]
        assert np.allclose(error[k], power, rtol=0.0, atol=1e-11 * np.abs(error[0]).max())
    assert run.timing == timing == observer.timing


@pytest.mark.parametrize("c", STEPS)
@pytest.mark.parametrize("method", PLACED)
@pytest.mark.parametrize("timing", TIMINGS)
def test_it_is_stable_at_any_step(method, timing, c):
    rng = np.random.default_rng(int(10 * c))
    laws = [StandardObserver(n, ELL, method=method, timing=timing) for n in (1, 2, 4, 6)]
    laws += [low_power(n, method=method, timing=timing)[0] for n in (2, 3, 4)]
    laws += [
        PeakingFreeObserver(3, ELL, saturation=2.0, clip=clip, method=method, timing=timing)
        for clip in ("hard", "smooth")
    ]
    dt = c / ELL
    y = rng.normal(size=3000)
    for law in laws:
        if law.spec["kind"] == "peaking-free" and method == "bilinear" and c > 1.0:
            assert law.step_limit().dt < dt
            continue
        assert law.step_limit().dt > dt
        run = law.run(dt, y)
        scaled = np.abs(run.x_hat) * dt ** np.arange(law.n)
        assert scaled[1500:].max() < 2.0 * scaled[:1500].max()
        quiet = law.run(dt, np.zeros(4000), x_hat0=np.ones(law.n))
        assert np.all(np.abs(quiet.x_hat[-1]) <= 1e-6 * np.abs(quiet.x_hat).max(axis=0))


@pytest.mark.parametrize(("n", "c"), [(2, 0.1), (2, 1.0), (2, 100.0), (4, 0.5), (6, 0.5)])
def test_uneven_steps_are_stable_where_the_page_says_so(n, c):
    rng = np.random.default_rng(n)
    t = np.cumsum(c / ELL * rng.uniform(0.2, 1.8, size=2000))
    y = np.zeros(2000)
    y[1000:1010] = np.nan
    run = StandardObserver(n, ELL, method="zoh", timing="current").run(t, y, x_hat0=np.ones(n))
    assert np.abs(run.x_hat[-1]).max() < 1e-12 * np.abs(run.x_hat).max()


MANNERS = [
    (method, timing)
    for method, timing in itertools.product(METHODS, TIMINGS)
    if fixed_timing(method) in (None, timing)
]
OF_LAWS = [manner for manner in MANNERS if fixed_timing(manner[0]) is None]


@pytest.mark.parametrize(("method", "timing"), OF_LAWS)
def test_which_samples_a_row_uses(method, timing):
    observer = low_power(3, method=method, timing=timing)[0]
    y = np.sin(np.arange(60) * 0.1)
    other = y.copy()
    other[30] += 0.1
    moved = observer.run(0.005, other).x_hat != observer.run(0.005, y).x_hat
    first = int(np.argmax(moved[:, 0]))
    assert first == (30 if timing == "current" else 31)


@pytest.mark.parametrize(("method", "timing"), MANNERS)
def test_step_run_and_reference_agree_on_uneven_records_with_gaps(method, timing):
    rng = np.random.default_rng(4)
    t = np.cumsum(rng.uniform(0.002, 0.02, size=400))
    y = np.sin(3.0 * t) + 0.01 * rng.normal(size=400)
    y[50:60] = y[200] = np.nan
    u = np.cos(t)
    adaptive = AdaptiveGain(20.0, 1e-4, 0.2)
    laws = [
        StandardObserver(3, 8.0, model=InputGain(0.5), method=method, timing=timing),
        StandardObserver(2, adaptive, method=method, timing=timing),
    ]
    if (method, timing) in OF_LAWS:
        laws += [
            low_power(3, 6.0, model=InputGain(0.5), method=method, timing=timing)[0],
            low_power(2, adaptive, method=method, timing=timing)[0],
            PeakingFreeObserver(3, 6.0, saturation=[1.0, 3.0], method=method, timing=timing),
        ]
    for law in laws:
        law.allow_unstable = True
        told = u[:, None] if law.n_u else None
        run = law.run(t, y, told)
        inputs = np.empty((400, 0)) if told is None else told
        twin = Reference(law.spec).run(t, y, inputs, law.initial_memory())
        scale = np.abs(twin["memory"]).max(axis=0)
        assert np.all(np.abs(run.memory - twin["memory"]) <= 1e-12 * scale)
        innovation = run.innovation - twin["innovation"]
        assert np.nanmax(np.abs(innovation)) <= 1e-12 * np.nanmax(np.abs(twin["innovation"]))
        assert np.array_equal(np.isnan(run.innovation[:, 0]), np.isnan(y))
        for k, memory in enumerate(by_steps(law, y[:250], told, np.diff(t[:250]))):
            assert np.array_equal(memory, run.memory[k]), k


def test_a_missing_sample_predicts():
    n, dt = 4, 0.05
    observer = StandardObserver(n, ELL, method="zoh", timing="current")
    x = np.array([1.0, -2.0, 3.0, 0.5])
    run = observer.run(dt, [np.nan, np.nan, np.nan], x_hat0=x)
    phi = expm(np.diag(np.ones(n - 1), 1) * dt)
    assert np.allclose(run.x_hat, [x, phi @ x, phi @ phi @ x], rtol=1e-14)
    assert run.missing.all()


def test_a_chain_is_followed_without_a_lag():
    """A polynomial of degree n - 1 leaves no error, whatever the step; y held would leave T/2."""
    t = np.arange(400) * 0.1
    for method in PLACED:
        run = StandardObserver(3, 5.0, method=method, timing="current").run(0.1, 1.0 + t**2)
        truth = np.stack([1.0 + t**2, 2.0 * t, np.full_like(t, 2.0)], axis=1)
        assert np.allclose(run.x_hat[-100:], truth[-100:], rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("c", [0.1, 1.0, 10.0])
def test_peaking_free_is_low_power_where_nothing_saturates(c):
    dt = c / ELL
    rng = np.random.default_rng(1)
    y = 1e-3 * rng.normal(size=500)
    for timing in TIMINGS:
        linear = low_power(4, method="zoh", timing=timing)[0].run(dt, y)
        levels = {"kind": PeakingFreeObserver, "saturation": 1e9, "allow_unstable": True}
        free = low_power(4, method="zoh", timing=timing, **levels)[0].run(dt, y)
        assert np.array_equal(linear.memory, free.memory)


@pytest.mark.parametrize(("n", "c"), [(2, 0.1), (2, 10.0), (3, 0.1), (3, 10.0), (4, 1.0), (5, 0.5)])
def test_peaking_free_peaks_do_not_grow_with_the_gain(n, c):
    peaks = {}
    for ell in (10.0, 1000.0):
        observer = PeakingFreeObserver(n, ell, saturation=2.0, method="zoh", timing="current")
        run = observer.run(c / ell, np.zeros(3000), x_hat0=np.ones(n))
        peaks[ell] = np.abs(run.x_hat).max(axis=0)
        assert np.abs(run.x_hat[-1]).max() < 1e-6
    assert np.all(peaks[1000.0] <= 1.5 * peaks[10.0] + 1.0)


@pytest.mark.parametrize("timing", TIMINGS)
def test_a_gain_that_moves_may_be_as_large_as_it_likes(timing):
    """r dt far beyond every other method's limit."""
    gain = AdaptiveGain(500.0, 1e-3, 0.2)
    rng = np.random.default_rng(0)
    t = np.arange(2000) * 0.05
    y = np.sign(np.sin(t)) + 0.01 * rng.normal(size=2000)
    for law in (
        StandardObserver(2, gain, method="zoh", timing=timing),
        low_power(3, gain, method="zoh", timing=timing)[0],
    ):
        run = law.run(0.05, y)
        assert run.gain.max() * 0.05 > 3.0
        assert np.abs(run.x_hat[:, 0]).max() < 20.0


def test_studies_take_both_timings():
    plant, x0 = Crackle(), [-0.8, 0.0, 0.0, 0.0, 0.0]
    for method, timing in (("euler", "current"), ("zoh", "predictor"), ("zoh", "current")):
        observer = low_power(5, 30.0, model=plant, method=method, timing=timing)[0]
        start = {"x0": x0, "memory0": observer.initial_memory(x0), "dt": 0.001, "steps": 300}
        more = {"windows": [(0.0, 0.3)], "every": 1}
        run = simulate(plant, observer, **start, **more)
        twin = simulate(plant, observer, **start, **more, backend="numpy")
        for name in ("memory", "rms", "peak"):
            ours, theirs = getattr(run, name), getattr(twin, name)
            assert ours.shape == theirs.shape
            assert np.allclose(ours, theirs, rtol=1e-9, atol=1e-9)
        assert run.timing == timing
        assert run.peak.shape == (1, 9)
        # the same as a record of what was measured
        record = observer.run(0.001, run.y[0], memory0=observer.initial_memory(x0))
        assert np.allclose(record.x_hat, run.x_hat[0], rtol=1e-12, atol=1e-14)


def test_timing_is_told_and_can_be_changed_for_a_run():
    observer = StandardObserver(2, ELL)
    assert (observer.timing, observer.spec["timing"]) == ("current", "current")
    assert observer.spec["method"] == "zoh"
    y = np.sin(np.arange(50) * 0.1)
    before = observer.run(0.01, y, timing="predictor")
    assert before.timing == "predictor"
    other = StandardObserver(2, ELL, timing="predictor").run(0.01, y)
    assert np.array_equal(before.memory, other.memory)
    now = observer.run(0.01, y)
    assert now.timing == "current"
    assert now.auxiliary.shape == before.auxiliary.shape == (50, 0)
    # the prediction of a row is the row before, moved; a predictor's row is its prediction
    assert np.allclose(now.x_hat[:-1] @ [1.0, 0.01], before.x_hat[1:, 0], atol=1e-14)


@pytest.mark.parametrize("kind", [LowPowerObserver, PeakingFreeObserver])
def test_what_is_left_open_is_the_best_for_data(kind):
    """Placed and current; where a moving gain cannot be placed well, RK4."""
    more = {"saturation": 2.0} if kind is PeakingFreeObserver else {}
    for gain, method in ((ELL, "zoh"), (AdaptiveGain(10.0, 0.0025, 0.183), "rk4")):
        spec = kind(3, gain, **more).spec
        assert (spec["method"], spec["timing"]) == (method, "current")


def test_collections_take_current_timing():
    k, k_bar = [2.0, 2.0], [0.03, 0.02]
    gain = AdaptiveGain(10.0, 0.0025, 0.183)
    observer = RepelledCollection(gain, k=k, k_bar=k_bar, copies=3)
    assert (observer.timing, observer.spec["method"]) == ("current", "rk4")
    start = observer.spread([[0.1, 0.0], [0.0, 0.1], [0.2, 0.0]])
    y = np.sin(np.arange(500) * 0.01)
    run = observer.run(0.002, y, memory0=start)
    twin = Reference(observer.spec).run(np.arange(500) * 0.002, y, np.empty((500, 0)), start)
    assert np.allclose(run.memory, twin["memory"], rtol=1e-10, atol=1e-12)
    assert observer.nominal_gain(run.memory).shape == (500,)


def test_what_cannot_be_done_is_refused_with_a_reason():
    with pytest.raises(HgoError, match="timing"):
        StandardObserver(2, ELL, timing="now")
    with pytest.raises(HgoError, match="this law has no other"):
        SampledDataObserver().run(0.01, [0.0], timing="current")
    gain = AdaptiveGain(10.0, 0.0025, 0.183)
    with pytest.raises(HgoError, match="standard"):
        RepelledCollection(gain, k=[2.0, 2.0], k_bar=[0.03, 0.02], method="zoh")
    with pytest.raises(HgoError, match="n = 8"):
        StandardObserver(8, ELL, method="bilinear")
    with pytest.raises(HgoError, match="n = 5"):
        LowPowerObserver(5, ELL, method="bilinear")
    observer = StandardObserver(2, ELL, method="zoh")
    with pytest.raises(HgoError, match="joint"):
        law = low_power(5, 30.0, method="zoh")[0]
        simulate(Crackle(), law, x0=[0.1] * 5, mode="joint", dt=0.001, steps=5)
    assert np.isinf(observer.step_limit().dt)


@pytest.mark.parametrize("method", ["euler", "zoh", "bilinear"])
@pytest.mark.parametrize("timing", ["predictor", "current"])
def test_a_record_of_one_sample_has_no_time_to_move_in(method: str, timing: str) -> None:
    for observer in (
        StandardObserver(2, 50.0, method=method, timing=timing),
        LowPowerObserver(3, 50.0, method=method, timing=timing),
    ):
        result = observer.run([0.3], [0.7], x_hat0=[0.5] * observer.n)
        assert np.all(result.x_hat == 0.5)


@pytest.mark.parametrize("method", ["zoh", "bilinear"])
def test_a_row_without_a_sample_changes_nothing(method: str) -> None:
    """A placed correction is for all the time since the last sample, as if no rows were between."""
    rng = np.random.default_rng(8)
    t = np.cumsum(rng.uniform(0.01, 0.03, 300))
    y = np.where(rng.random(300) < 0.4, np.nan, np.sin(3.0 * t))
    y[100:140] = np.nan
    y[:2] = np.sin(3.0 * t[:2])  # the first correction is for the step after it
    there = np.isfinite(y)
    law = StandardObserver(3, 15.0, method=method, timing="current")
    whole, part = law.run(t, y), law.run(t[there], y[there])
    np.testing.assert_allclose(whole.x_hat[there], part.x_hat, atol=1e-9)
    euler = StandardObserver(3, 15.0, method="euler", timing="current", allow_unstable=True)
    assert not np.allclose(euler.run(t, y).x_hat[there][60:], part.x_hat[60:], atol=1e-3)
