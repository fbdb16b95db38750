"""The observers of the package against truths of their own: calculus, SciPy, the papers' lines."""

import itertools
import math

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from hgo_rs import (
    AdaptiveGain,
    ConstantGain,
    Crackle,
    DeadZoneGain,
    Gap,
    HgoError,
    InputGain,
    Lee,
    LowPowerObserver,
    ModifiedObserver,
    PeakingFreeObserver,
    ReducedOrderObserver,
    RepelledCollection,
    SampledDataObserver,
    SanfelicePraly,
    StandardObserver,
    VanDerPol,
    WindowObserver,
)
from hgo_rs.observers import METHODS, TIMINGS

DT = 2.0**-7  # k * DT is exact, so that a record of times and a period give the same bits
ADAPTIVE = AdaptiveGain(10.0, 0.0025, 0.183)
COPIES = {"k": (2.0, 2.0), "k_bar": (0.0558, 0.0317), "copies": 3}
STARTS = [[0.0, 0.1], [0.05, 0.0], [-0.05, -0.1]]


def every_law():
    """Every law with a start, under a name: by the papers' recursions, and with current timing."""
    given = {"timing": "predictor"}
    collection = RepelledCollection(ADAPTIVE, model=SanfelicePraly(1.9), **COPIES, **given)
    modified = ModifiedObserver(ADAPTIVE, model=SanfelicePraly(1.9), **COPIES, **given)
    euler = {"method": "euler", **given}
    recursions = {
        "standard": (StandardObserver(3, 10.0, **euler), None),
        "adaptive": (StandardObserver(2, ADAPTIVE, model=Lee(), method="rk4", **given), None),
        "dead-zone": (
            StandardObserver(2, DeadZoneGain(1.0, 0.1, 0.2), method="rk4", **given),
            None,
        ),
        "input": (StandardObserver(2, 10.0, model=InputGain(2.0), **euler), None),
        "placed": (StandardObserver(2, 10.0, model=InputGain(2.0), **given), None),
        "low-power": (LowPowerObserver(3, 10.0, method="bogacki-shampine", **given), None),
        "peaking-free": (
            PeakingFreeObserver(3, 10.0, saturation=1.0, clip="smooth", **euler),
            None,
        ),
        "collection": (collection, collection.spread(STARTS)),
        "modified": (modified, modified.spread([0.0, 0.0], STARTS)),
    }
    filters = {
        f"{name}, current": (
            observer.with_timing("current"),
            None if start is None else np.append(start, 0.0),
        )
        for name, (observer, start) in recursions.items()
    }
    fixed = {
        "sampled-data": (SampledDataObserver(), None),
        "reduced-order": (ReducedOrderObserver(0.2), None),
        "window": (WindowObserver.savitzky_golay(5, 2, DT), None),
    }
    return recursions | filters | fixed


LAWS = sorted(every_law())


def law(name):
    return every_law()[name]


def record(observer, count=60, seed=0):
    """Samples and inputs that suit the observer."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) * DT
    if observer.n_y == 3:
        y = np.stack([1.0 + 0.8 * t, 0.2 * np.sin(t), 0.1 * t], axis=1)
    else:
        y = np.sin(3.0 * t) + 0.01 * rng.normal(size=count)
    u = rng.normal(size=(count, observer.n_u)) if observer.n_u else None
    return y, u


def at(values, k):
    return None if values is None else values[k]


def by_steps(observer, y, u, lengths, out=None):
    """Yield the memory at each sample, by a `step` a sample over steps of these lengths."""
    for k in range(len(y)):
        if observer.timing == "predictor":  # over the step that begins
            yield observer.memory
            if k < len(lengths):
                observer.step(y[k], at(u, k), dt=float(lengths[k]), out=out)
        else:  # over the step that has ended; there is none before the first sample
            past = max(k - 1, 0)
            observer.step(y[k], at(u, past), dt=float(lengths[past]), out=out)
            yield observer.memory


# --- what an observer is for --------------------------------------------------------------------


@pytest.mark.parametrize(
    "make",
    [
        lambda n, ell, **more: StandardObserver(n, ell, **more),
        lambda n, ell, **more: LowPowerObserver(n, ell, **more),
        lambda n, ell, **more: PeakingFreeObserver(n, ell, saturation=50.0, **more),
    ],
    ids=["standard", "low-power", "peaking-free"],
)
def test_derivatives_of_a_polynomial_are_exact(make):
    """The chain of n integrators holds every polynomial of degree n - 1: no error is left.

    Forward Euler holds forward differences, y'(t) + dt/2 y''(t) for a parabola.
    """
    t = np.arange(4000) * DT
    y, dy, ddy = 1.0 - 2.0 * t + 0.3 * t**2, -2.0 + 0.6 * t, 0.6 + 0.0 * t
    exact = make(3, 4.0, method="rk4-innovation-held").run(t, y)
    np.testing.assert_allclose(exact.x_hat[-1], [y[-1], dy[-1], ddy[-1]], rtol=1e-9)
    np.testing.assert_allclose(make(3, 4.0).run(t, y).x_hat[-1], exact.x_hat[-1], rtol=1e-9)
    euler = make(3, 4.0, method="euler", timing="predictor").run(t, y)
    expected = [y[-1], dy[-1] + 0.5 * DT * ddy[-1], ddy[-1]]
    np.testing.assert_allclose(euler.x_hat[-1], expected, rtol=1e-9)


@pytest.mark.parametrize("kind", [StandardObserver, LowPowerObserver])
def test_the_error_falls_with_powers_of_the_gain(kind):
    """Of x_i as ell^-(n+1-i): phi = y''' is unknown and only the gain holds it down."""
    t = np.arange(0.0, 3.0, 2e-5)
    truth = np.stack([np.sin(2.0 * t), 2.0 * np.cos(2.0 * t), -4.0 * np.sin(2.0 * t)], axis=1)
    late = t > 1.5

    def error(ell):
        run = kind(3, ell, method="rk4-innovation-held").run(t, truth[:, 0])
        return np.max(np.abs(run.x_hat - truth)[late], axis=0)

    ratios = error(40.0) / error(80.0)
    np.testing.assert_allclose(ratios, [8.0, 4.0, 2.0], rtol=0.1)


def test_a_known_input_leaves_no_bias():
    """x'' = b0 u: with phi = b0 u the error vanishes, without it x2 stays off."""
    t = np.arange(0.0, 8.0, 1e-3)
    u = np.where(np.sin(t) > 0.0, 1.0, -0.5)
    x = np.zeros((len(t), 2))
    for k in range(len(t) - 1):  # u held: the exact solution step by step
        x[k + 1] = x[k] + 1e-3 * np.array([x[k, 1] + 0.5e-3 * 3.0 * u[k], 3.0 * u[k]])
    known = StandardObserver(
        2, 5.0, model=InputGain(3.0), method="rk4-innovation-held", timing="predictor"
    )
    blind = StandardObserver(2, 5.0, method="rk4-innovation-held", timing="predictor")
    assert np.max(np.abs(known.run(t, x[:, 0], u).x_hat - x)[-1000:]) < 1e-9
    assert np.max(np.abs(blind.run(t, x[:, 0]).x_hat - x)[-1000:, 1]) > 0.1


def test_the_sampled_data_law_is_the_printed_recursion():
    """Fu (5): x+ = x + T f(x) + K_T(x, y), with the sign of mu in l1 put right, and as printed."""
    y = np.cos(np.arange(40) * 0.1)
    for gain, sign in (("derived", 1.0), ("printed", -1.0)):
        x1, x2 = 0.5, -1.0
        rows = []
        for sample in y:
            rows.append((x1, x2))
            mu = 0.8 * (1.0 - sample**2)
            e = sample - x1
            l1 = (5.0 + sign * mu) * 0.1
            l2 = (5.0 - 0.8 * (x1 + sample) * x2 + (5.0 + mu) * mu) * 0.1
            f2 = -x1 + 0.8 * (1.0 - x1**2) * x2
            x1, x2 = x1 + 0.1 * x2 + l1 * e, x2 + 0.1 * f2 + l2 * e
        run = SampledDataObserver(gain=gain).run(0.1, y, x_hat0=[0.5, -1.0])
        np.testing.assert_allclose(run.x_hat, rows, rtol=1e-12)


# --- against an integrator of another house -----------------------------------------------------

ELL = 2.0
ALPHA, BETA = (3.0, 3.0, 2.0), (7.0, 2.5)


def standard_rate(z, y):
    """Sanfelice and Praly (5)-(7) with the model of Lee (38) and r' of (6)."""
    x1, x2, r = z
    e = y - x1
    r_rate = 10.0 * ((e**2 - 0.0025) * r ** (1.0 - 2.0 * 0.183) + 0.0025 / r**4)
    return [x2 + 3.0 * r * e, -x1 / (1.0 + x1**2) - x2 + 2.0 * r**2 * e, r_rate]


def dead_zone_rate(z, y):
    """Law (4) at a constant model."""
    x1, x2, r = z
    e = y - x1
    r_rate = 4.0 * max(0.0, e**2 - 0.1) * r ** (1.0 - 2.0 * 0.3)
    return [x2 + 3.0 * r * e, 2.0 * r**2 * e, r_rate]


def low_power_rate(z, y, saturate=lambda s: s):
    """Astolfi et al. (5), (11) for n = 3."""
    x1, x2, x3, eta1, eta2 = z
    s1, s2 = saturate(eta1), saturate(eta2)
    e1, e2, e3 = y - x1, s1 - x2, s2 - x3
    (a1, a2, a3), (b1, b2) = ALPHA, BETA
    return [
        eta1 + a1 * ELL * e1,
        eta2 + a2 * ELL * e2,
        a3 * ELL * e3,
        s2 + b1 * ELL**2 * e1,
        b2 * ELL**2 * e2,
    ]


def smooth(s):
    """C1, s within +-1, bounded by 2."""
    beyond = max(abs(s) - 1.0, 0.0)
    return math.copysign(1.0 + beyond / (1.0 + beyond), s) if beyond else s


CONTINUOUS = {
    "adaptive": (
        lambda method: StandardObserver(
            2, ADAPTIVE, k=(3.0, 2.0), model=Lee(), method=method, timing="predictor"
        ),
        standard_rate,
        [0.0, 0.0, 1.2],
    ),
    "dead-zone": (
        lambda method: StandardObserver(
            2, DeadZoneGain(4.0, 0.1, 0.3), k=(3.0, 2.0), method=method, timing="predictor"
        ),
        dead_zone_rate,
        [0.0, 0.0, 1.2],
    ),
    "low-power": (
        lambda method: LowPowerObserver(
            3, ELL, alpha=ALPHA, beta=BETA, method=method, timing="predictor"
        ),
        low_power_rate,
        [0.0] * 5,
    ),
    "peaking-free": (
        lambda method: PeakingFreeObserver(
            3,
            ELL,
            alpha=ALPHA,
            beta=BETA,
            saturation=1.0,
            clip="smooth",
            method=method,
            timing="predictor",
        ),
        lambda z, y: low_power_rate(z, y, smooth),
        [0.0] * 5,
    ),
}


@pytest.mark.parametrize("name", CONTINUOUS)
def test_schemes_converge_to_the_continuous_observer(name):
    """DOP853 over samples that are held for 0.5 s, against ever shorter steps of each scheme."""
    make, rate, start = CONTINUOUS[name]
    levels = [1.0, 0.2, -0.7, 0.4]
    z = np.array(start)
    for y in levels:
        solution = solve_ivp(
            lambda _, s, y=y: rate(s, y), (0.0, 0.5), z, "DOP853", rtol=1e-13, atol=1e-13
        )
        z = solution.y[:, -1]

    def error(method, steps):
        count = len(levels) * steps
        y = np.append(np.repeat(levels, steps), 0.0)  # the last row is the state at the end
        run = make(method).run(np.arange(count + 1) * (0.5 / steps), y, memory0=start)
        return float(np.max(np.abs(run.memory[-1] - z)))

    for method, order, steps in (
        ("euler", 1, 400),
        ("staggered-euler", 1, 400),
        ("rk4-innovation-held", 1, 400),
        ("bogacki-shampine", 3, 50),
        ("rk4", 4, 50),
    ):
        coarse, fine = error(method, steps), error(method, 2 * steps)
        if name in ("adaptive", "low-power"):  # the others have kinks: no high order
            assert math.log2(coarse / fine) == pytest.approx(order, abs=0.35), method
        else:
            assert fine < 0.7 * coarse or fine < 1e-5, method
    assert error("rk4", 1600) < (1e-9 if name in ("adaptive", "low-power") else 1e-6)


# --- online, over a record, and where they start ------------------------------------------------


@pytest.mark.parametrize("name", LAWS)
def test_online_and_over_a_record_are_the_same(name):
    observer, start = law(name)
    y, u = record(observer)
    y[7] = y[20] = np.nan
    run = observer.run(DT, y, u, memory0=start)
    np.testing.assert_array_equal(run.time, np.arange(60) * DT)
    observer.reset(memory0=start)
    given = [None if k == 7 else row for k, row in enumerate(y)]
    for k, memory in enumerate(by_steps(observer, given, u, np.full(59, DT))):
        np.testing.assert_array_equal(memory, run.memory[k])
        np.testing.assert_array_equal(observer.x_hat, run.x_hat[k])
    held = run.memory[:, run.x_hat.shape[1] + run.auxiliary.shape[1] :]
    np.testing.assert_array_equal(run.memory, np.hstack([run.x_hat, run.auxiliary, held]))
    if name.endswith(", current"):  # the time since the last sample used
        expected = np.where(run.missing, DT, 0.0)
        np.testing.assert_array_equal(held, expected[:, None])
    else:
        assert held.size == 0


@pytest.mark.parametrize("name", LAWS)
def test_run_leaves_the_memory_alone_and_reset_starts_again(name):
    observer, start = law(name)
    y, u = record(observer)
    fresh = observer.memory.copy()
    first = observer.run(DT, y, u, memory0=start)
    np.testing.assert_array_equal(observer.memory, fresh)
    observer.reset(memory0=start)
    once = [observer.step(y[k], at(u, k), dt=DT) for k in range(10)]
    assert not np.array_equal(observer.memory, fresh)
    observer.reset(memory0=start)
    again = [observer.step(y[k], at(u, k), dt=DT) for k in range(10)]
    np.testing.assert_array_equal(once, again)
    np.testing.assert_array_equal(observer.run(DT, y, u, memory0=start).memory, first.memory)
    observer.reset()
    np.testing.assert_array_equal(observer.memory, fresh)


@pytest.mark.parametrize("name", LAWS)
def test_timing(name):
    """Predictor: row k is the same whatever comes from sample k on. Filter: from k + 1 on."""
    observer, start = law(name)
    y, u = record(observer)
    other = y.copy()
    other[30:] += 0.01
    memory = observer.run(DT, y, u, memory0=start).x_hat
    changed = observer.run(DT, other, u, memory0=start).x_hat
    first = 31 if observer.timing == "predictor" else 30
    np.testing.assert_array_equal(memory[:first], changed[:first])
    assert not np.array_equal(memory[first], changed[first])


@pytest.mark.parametrize("name", [n for n in LAWS if n not in ("reduced-order", "window")])
def test_the_first_row_is_the_start(name):
    """With current timing too: the first sample corrects over no time."""
    observer, start = law(name)
    y, u = record(observer)
    if start is None:
        run = observer.run(DT, y, u, x_hat0=np.arange(1.0, observer.n + 1.0))
        np.testing.assert_array_equal(run.x_hat[0], np.arange(1.0, observer.n + 1.0))
    else:
        np.testing.assert_array_equal(observer.run(DT, y, u, memory0=start).memory[0], start)


def test_memories_say_what_stands_where():
    observer = LowPowerObserver(3, ADAPTIVE, method="euler", timing="predictor")
    memory = observer.initial_memory([1.0, 2.0, 3.0], r0=4.0)
    np.testing.assert_array_equal(memory, [1.0, 2.0, 3.0, 0.0, 0.0, 4.0])
    observer.reset([1.0, 2.0, 3.0], r0=4.0)
    assert observer.gain == 4.0
    np.testing.assert_array_equal(observer.x_hat, [1.0, 2.0, 3.0])
    run = observer.run(1e-3, np.zeros(50), x_hat0=[1.0, 2.0, 3.0], r0=4.0)
    assert run.gain[0] == 4.0
    np.testing.assert_array_equal(run.gain, run.memory[:, 5])
    np.testing.assert_array_equal(run.auxiliary, run.memory[:, 3:])
    assert (
        StandardObserver(2, epsilon=0.05, method="euler", timing="predictor").gain,
        StandardObserver(2, 20, method="euler", timing="predictor").gain,
    ) == (20.0, 20.0)
    np.testing.assert_array_equal(
        StandardObserver(2, 20.0, method="euler", timing="predictor").run(1e-3, [1.0, 2.0]).gain,
        [20.0] * 2,
    )
    assert ConstantGain.from_epsilon(0.25).ell == 4.0
    assert SampledDataObserver().gain is None
    assert SampledDataObserver().run(0.01, [1.0, 2.0]).gain is None


@pytest.mark.parametrize("timing", TIMINGS)
def test_copies_are_spread_and_their_gains_averaged(timing):
    observer = RepelledCollection(ADAPTIVE, timing=timing, **COPIES)
    start = observer.spread(STARTS, [1.0, 2.0, 6.0])
    held = [] if timing == "predictor" else [0.0]
    starts = [0.0, 0.1, 1.0, 0.05, 0.0, 2.0, -0.05, -0.1, 6.0]
    np.testing.assert_array_equal(start, starts + held)
    assert observer.nominal_gain(start) == 3.0  # (24)
    run = observer.run(0.01, np.zeros(20), memory0=start)
    gains = run.memory[:, [2, 5, 8]].mean(axis=1)
    np.testing.assert_allclose(observer.nominal_gain(run.memory), gains, rtol=1e-15)
    modified = ModifiedObserver(ADAPTIVE, timing=timing, **COPIES)
    both = modified.spread([7.0, 8.0], STARTS, 1.5, 2.0)
    np.testing.assert_array_equal(both[:3], [7.0, 8.0, 1.5])
    np.testing.assert_array_equal(both[[5, 8, 11]], [2.0, 2.0, 2.0])
    np.testing.assert_array_equal(both[12:], held)
    modified.reset(memory0=both)
    assert modified.gain == 3.0  # r r_bar (25)
    run = modified.run(0.001, np.zeros(20), memory0=both)
    nominal = run.memory[:, [5, 8, 11]].mean(axis=1)
    np.testing.assert_allclose(run.gain, run.memory[:, 2] * nominal, rtol=1e-15)


def test_step_limits_are_the_edge_of_stability():
    """Two percent below the error dies out, two percent above it grows."""
    for observer in (
        StandardObserver(3, 20.0, allow_unstable=True, method="euler", timing="predictor"),
        LowPowerObserver(
            3, 20.0, method="rk4-innovation-held", allow_unstable=True, timing="predictor"
        ),
    ):
        limit = observer.step_limit().dt
        last = [
            np.abs(observer.run(c * limit, np.ones(3000)).innovation[-1, 0]) for c in (0.98, 1.02)
        ]
        assert last[0] < 1e-3 < 1e3 < last[1]


def test_high_orders_may_peak_high():
    """Order 12 at a gain of 100 starts with a peak of 1e20 and more; that is no divergence."""
    t = np.arange(0.0, 2.0, 1e-4)
    run = StandardObserver(12, 100.0, method="euler", timing="predictor").run(t, 1.0 + 0.0 * t)
    assert np.max(np.abs(run.x_hat)) > 1e18
    assert run.x_hat[-1, 0] == pytest.approx(1.0, abs=1e-6)


# --- uneven steps and missing samples -----------------------------------------------------------


def test_uneven_steps_are_honoured():
    """Each step has its own length: the chain moves by dt(k), computed here line by line."""
    rng = np.random.default_rng(3)
    t = 5.0 + np.cumsum(rng.uniform(0.001, 0.03, 200))
    y = np.sin(t)
    observer = StandardObserver(2, 10.0, k=(3.0, 2.0), method="euler", timing="predictor")
    run = observer.run(t, y)
    x = np.zeros(2)
    for k, dt in enumerate(np.diff(t)):
        np.testing.assert_allclose(run.x_hat[k], x, rtol=1e-12, atol=1e-12)
        e = y[k] - x[0]
        x = x + dt * np.array([x[1] + 30.0 * e, 200.0 * e])
    np.testing.assert_allclose(run.x_hat[-1], x, rtol=1e-12)
    np.testing.assert_array_equal(run.time, t)
    # all of it shifted in time: nothing changes but the clock
    np.testing.assert_allclose(observer.run(t - 5.0, y).x_hat, run.x_hat, rtol=1e-9)


def test_over_a_gap_the_observer_predicts():
    """Without samples it is the model: x_hat' = A x_hat + f(x_hat), and r comes down by (6)."""
    y = np.sin(0.5 * np.arange(300) * DT)
    y[100:160] = np.nan
    observer = StandardObserver(
        2, ADAPTIVE, k=(3.0, 2.0), model=VanDerPol(0.8), method="euler", timing="predictor"
    )
    run = observer.run(DT, y, x_hat0=[0.3, 0.4], r0=2.0)
    assert np.isfinite(run.memory).all()
    x1, x2, r = run.memory[100]
    for k in range(100, 160):
        np.testing.assert_allclose(run.memory[k], [x1, x2, r], rtol=1e-12)
        f = -x1 + 0.8 * (1.0 - x1**2) * x2
        fall = 10.0 * (-0.0025 * r ** (1.0 - 0.366) + 0.0025 / r**4)
        x1, x2, r = x1 + DT * x2, x2 + DT * f, max(1.0, r + DT * fall)
    np.testing.assert_allclose(run.memory[160], [x1, x2, r], rtol=1e-12)
    assert r < run.memory[100, 2]
    # up to the gap, as if it were not there; after it, as from the state that it left
    np.testing.assert_array_equal(
        run.memory[:101], observer.run(DT, y[:101], x_hat0=[0.3, 0.4], r0=2.0).memory
    )
    np.testing.assert_array_equal(
        run.memory[160:], observer.run(DT, y[160:], memory0=run.memory[160]).memory
    )


@pytest.mark.parametrize("name", LAWS)
def test_no_missing_sample_reaches_the_state(name):
    """Alone, in rows, at both ends; in one channel of three."""
    observer, start = law(name)
    y, u = record(observer)
    gone = [0, 1, 9, 20, 21, 22, 58, 59]
    if observer.n_y == 3:
        gone = gone[2:]  # the record begins where the ship moves
        y[gone, np.arange(len(gone)) % 3] = np.nan
    else:
        y[gone] = np.nan
    run = observer.run(DT, y, u, memory0=start)
    assert np.isfinite(run.memory).all()
    np.testing.assert_array_equal(np.flatnonzero(run.missing), gone)
    np.testing.assert_array_equal(np.isnan(run.innovation).any(axis=1), run.missing)
    np.testing.assert_array_equal(run.y, y.reshape(run.y.shape))
    as_list = [None if k in gone else row for k, row in enumerate(y.tolist())]
    again = observer.run(DT, as_list, u, memory0=start)
    np.testing.assert_array_equal(again.memory, run.memory)


def test_a_record_without_any_sample():
    """Euler's chain from (1, 1), x1 + t x2, all the way."""
    run = StandardObserver(2, 10.0, method="euler", timing="predictor").run(
        DT, np.full(50, np.nan), x_hat0=[1.0, 1.0]
    )
    np.testing.assert_allclose(run.x_hat[:, 0], 1.0 + run.time, rtol=1e-12)
    assert run.gaps == [Gap(0, 50, 49 * DT)]


def test_a_ship_whose_first_samples_are_lost():
    """At z_hat = 0 the model has no value to predict with; from its velocity it has."""
    t = np.arange(0.0, 30.0, 0.05)
    y = np.stack([0.8 * t, 0.0 * t, 0.0 * t], axis=1)
    u = np.tile([56.1 / 198.8 * 0.8, 0.0], (len(t), 1))  # the force that holds 0.8 m/s
    y[[0, 2, 3]] = np.nan
    observer = ReducedOrderObserver(0.2)
    remedy = r"no value at sample 2 \(t = 0.1 s\): a ship at rest .* or x_hat0 at its velocity"
    with pytest.raises(HgoError, match=remedy):
        observer.run(t, y, u)
    run = observer.run(t, y, u, x_hat0=[0.8, 0.0, 0.0])
    np.testing.assert_array_equal(np.flatnonzero(run.missing), [0, 2, 3])
    np.testing.assert_allclose(run.x_hat, np.tile([0.8, 0.0, 0.0], (len(t), 1)), atol=1e-5)


def test_masked_arrays_and_none_are_missing_samples():
    values = [0.0, 0.1, 0.2, 0.3, 0.4]
    observer = StandardObserver(2, 10.0, method="euler", timing="predictor")
    expected = observer.run(DT, [0.0, 0.1, np.nan, 0.3, 0.4])
    for y in (
        [0.0, 0.1, None, 0.3, 0.4],
        np.ma.masked_array(values, mask=[0, 0, 1, 0, 0]),
        np.array([[0.0], [0.1], [np.nan], [0.3], [0.4]]),
    ):
        np.testing.assert_array_equal(observer.run(DT, y).memory, expected.memory)


# --- results ------------------------------------------------------------------------------------


def gapped():
    y = np.sin(np.arange(40) * 0.1)
    y[[0, 1, 10, 38, 39]] = np.nan
    t = np.arange(40) * 0.1
    t[11:] += 1.0  # a pause after the one lost sample
    return t, y


def test_gaps_say_where_and_how_long():
    run = StandardObserver(2, 0.5, method="euler", timing="predictor").run(*gapped())
    starts = [(gap.start, gap.length) for gap in run.gaps]
    assert starts == [(0, 2), (10, 1), (38, 2)]
    # until the next sample; at the end of the record until its last
    np.testing.assert_allclose([gap.duration for gap in run.gaps], [0.2, 1.1, 0.1])
    assert (
        StandardObserver(2, 0.5, method="euler", timing="predictor").run(0.1, np.ones(5)).gaps == []
    )


def test_the_innovation_is_the_sample_minus_its_prediction():
    run = StandardObserver(2, 0.5, method="euler", timing="predictor").run(*gapped())
    np.testing.assert_array_equal(run.innovation[:, 0], run.y[:, 0] - run.x_hat[:, 0])


def test_a_run_as_a_table():
    pandas = pytest.importorskip("pandas")
    run = StandardObserver(2, AdaptiveGain(1.0, 0.01, 0.2), method="euler", timing="predictor").run(
        *gapped()
    )
    table = run.to_dataframe()
    assert isinstance(table, pandas.DataFrame)
    assert list(table.columns) == ["x_hat1", "x_hat2", "innovation1", "gain", "missing"]
    assert table.index.name == "time"
    np.testing.assert_array_equal(table.index, run.time)
    np.testing.assert_array_equal(table[["x_hat1", "x_hat2"]], run.x_hat)
    np.testing.assert_array_equal(table["gain"], run.gain)
    assert table["missing"].sum() == 5
    three = ReducedOrderObserver(0.2)
    columns = three.run(DT, *record(three)).columns()
    assert {"innovation1", "innovation2", "innovation3"} <= columns.keys()
    assert "gain" not in columns


def test_a_table_without_its_library_names_the_extra(monkeypatch):
    import sys

    from hgo_rs.errors import MissingExtraError

    run = StandardObserver(2, 0.5, method="euler", timing="predictor").run(*gapped())
    for library, call in (("pandas", run.to_dataframe), ("xarray", run.to_xarray)):
        monkeypatch.setitem(sys.modules, library, None)
        with pytest.raises(MissingExtraError, match=rf"needs {library}: pip install 'hgo_rs\["):
            call()


def test_a_run_as_a_dataset():
    xarray = pytest.importorskip("xarray")
    run = StandardObserver(2, 0.5, method="euler", timing="predictor").run(*gapped())
    data = run.to_xarray()
    assert isinstance(data, xarray.Dataset)
    np.testing.assert_array_equal(data["x_hat2"], run.x_hat[:, 1])
    np.testing.assert_array_equal(data["time"], run.time)


def titles(figure):
    return [ax.get_title(loc="left") for ax in figure.axes]


def test_plot_has_a_panel_a_state_then_innovation_and_gain():
    run = StandardObserver(2, AdaptiveGain(1.0, 0.01, 0.2), method="euler", timing="predictor").run(
        *gapped()
    )
    figure = run.plot()
    assert isinstance(figure, Figure)
    assert titles(figure) == [r"$\hat x_{1}$", r"$\hat x_{2}$", "innovation", "gain"]
    assert figure.axes[-1].get_xlabel() == "time (s)"
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == [
        "y",
        "estimate",
    ]
    for panel, expected in zip(
        figure.axes, [*run.x_hat.T, run.innovation[:, 0], run.gain], strict=True
    ):
        line = panel.get_lines()[-1]
        np.testing.assert_array_equal(line.get_xdata(), run.time)
        np.testing.assert_array_equal(line.get_ydata(), expected)
        assert len(panel.patches) == 3  # the gaps, shaded


def test_plot_leaves_out_what_there_is_not():
    """A constant gain is no signal; a ship has three outputs, none of them a state."""
    run = StandardObserver(3, 0.5, method="euler", timing="predictor").run(
        0.1, np.sin(np.arange(50.0))
    )
    own = Figure()
    assert run.plot(own) is own
    assert titles(own) == [r"$\hat x_{1}$", r"$\hat x_{2}$", r"$\hat x_{3}$", "innovation"]
    observer = ReducedOrderObserver(0.2)
    ship = observer.run(DT, *record(observer)).plot()
    assert titles(ship) == [rf"$\hat x_{{{i}}}$" for i in (1, 2, 3)]


def test_an_observer_prints_what_it_is():
    text = repr(
        PeakingFreeObserver(
            5, 70.0, saturation=3.0, model=Crackle(), method="euler", timing="predictor"
        )
    )
    assert text == (
        "PeakingFreeObserver(n=5, gain=70, saturation=[3.0, 3.0, 3.0, 3.0], "
        "model=Crackle(phi_max=3.0), method='euler', timing='predictor')"
    )


def test_a_step_that_would_diverge_is_not_taken():
    observer = StandardObserver(2, 10.0, method="euler", timing="predictor")
    observer.step(1.0, dt=0.01)
    before = observer.memory.copy()
    with pytest.raises(HgoError, match=r"would diverge at t = 0\.01 s"):
        observer.step(1.7e308, dt=0.01)
    np.testing.assert_array_equal(observer.memory, before)
    expected = observer.step(1.0, dt=0.01)
    observer.reset()
    observer.step(1.0, dt=0.01)
    np.testing.assert_array_equal(observer.step(1.0, dt=0.01), expected)


@pytest.mark.parametrize("n", range(1, 13))
def test_a_record_gives_the_bits_of_single_steps(n):
    rng = np.random.default_rng(n)
    t = np.cumsum(rng.uniform(0.5e-3, 1.5e-3, 40))
    y, u = rng.standard_normal(40), rng.standard_normal(40)
    y[7:10] = np.nan
    laws = [StandardObserver] if n == 1 else [StandardObserver, LowPowerObserver]
    # uneven steps; and a period, which is itself even where k times it is rounded
    clocks = ((t, np.diff(t)), (1e-3, np.full(39, 1e-3)))
    for law, method, timing, model, (clock, steps) in itertools.product(
        laws, METHODS, TIMINGS, (None, InputGain(2.0)), clocks
    ):
        try:
            observer = law(n, 2.0, method=method, timing=timing, model=model)
        except HgoError:
            assert method in ("bilinear", "implicit-map", "implicit", "inter-sample")
            continue
        told = None if model is None else u
        rows = observer.run(clock, y, told).memory
        for k, memory in enumerate(by_steps(observer, y, told, steps)):
            assert np.array_equal(memory, rows[k]), (law, method, timing, k)
