"""Structures beyond the papers': limited gain power, cascade, reduced order of a chain.

Each is compared with its equations stepped by NumPy here, in the coordinates of its source, with
numbers of independent programs, and with the laws that it becomes.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import hgo_rs
from hgo_rs import HighGainObserver, LowPowerObserver, StandardObserver, load, reference
from hgo_rs.design import continuous, model_gain
from hgo_rs.observers import METHODS, TIMINGS

Array = NDArray[np.float64]
EULER: dict[str, Any] = {"method": "euler", "timing": "predictor"}
T = 1e-3
SINE = np.sin(2.0 * T * np.arange(1501))
ALPHA, BETA = (3.0, 3.0, 3.0), (40.0 / 11.0, 12.0 / 11.0, 4.0 / 11.0)
ORDERS = (2, 3, 4, 5)


def deviations(law: hgo_rs.Observer, density: float) -> Array:
    """Standard deviations of all states of a law in continuous time under noise of this density."""
    from scipy.linalg import solve_continuous_lyapunov

    linear = continuous(law.spec)
    scale, ell = linear.ell**linear.power, linear.ell
    m, g = ell * scale[:, None] * linear.closed / scale, ell * scale * linear.g
    return np.asarray(np.sqrt(density * np.diag(solve_continuous_lyapunov(m, -np.outer(g, g)))))


def clipped(levels: Any) -> Any:
    """The saturation of state i, 2 ... n."""
    return lambda i, s: s if levels is None else min(max(s, -levels[i - 2]), levels[i - 2])


# --- limited gain power -------------------------------------------------------------------------


def blocks(y: Array, n: int, alpha: Any, beta: Any, ell: float, levels: Any = None) -> Array:
    """(p_1, q_1, p_2, q_2, ...) before each sample, by forward Euler."""
    sat, z, out = clipped(levels), np.zeros((n - 1, 2)), np.empty((len(y), 2 * n - 2))
    for k, sample in enumerate(y):
        out[k], rate = z.ravel(), np.zeros_like(z)
        for i in range(n - 1):
            e = sample - z[0, 0] if i == 0 else sat(i + 1, z[i - 1, 1]) - z[i, 0]
            above = sat(i + 3, z[i + 1, 1]) if i + 2 < n else 0.0
            rate[i] = z[i, 1] + alpha[i] * ell * e, above + beta[i] * ell**2 * e
        z = z + T * rate
    return out


def in_blocks(memory: Array, n: int) -> Array:
    """The same of a memory."""
    p, q = memory[:, : n - 1], np.hstack([memory[:, n : 2 * n - 2], memory[:, n - 1 : n]])
    return np.stack([p, q], axis=2).reshape(len(memory), -1)


def limited(n: int, ell: float = 50.0, **given: Any) -> HighGainObserver:
    return HighGainObserver("limited-gain", n, ell, **{**EULER, **given})


def test_figures_of_limited_gain_power() -> None:
    law = limited(4, alpha=ALPHA, beta=BETA)
    found = np.poly(continuous(law.spec).closed)
    named = [1, 9, 30.636363636, 48.818181818, 36.694214876, 11.900826446, 1.442524418]
    assert found == pytest.approx(named, rel=1e-9)
    std = deviations(law, 1e-9)
    assert std[:4] == pytest.approx(
        [3.273374883e-4, 1.229431330e-2, 1.818312218e-1, 1.095436945], rel=1e-8
    )
    assert std[4:] == pytest.approx([1.682912642e-2, 2.148988910e-1], rel=1e-8)
    assert np.sqrt(1e-9 * law.noise_gain()) == pytest.approx(std[:4], rel=1e-12)
    whole = LowPowerObserver(4, 50.0, alpha=(*ALPHA, 2.0), beta=BETA, **EULER)
    assert deviations(whole, 1e-9)[3] == pytest.approx(0.854822664, rel=1e-8)
    row = [0.1411132911, -1.981244925786, -1.981663467943]
    row += [-0.613315605590, -0.621132327908, 7.045082736871]
    assert in_blocks(law.run(T, SINE).memory, 4)[1500] == pytest.approx(row, rel=1e-9)


@pytest.mark.parametrize("levels", [None, 0.9, 3.0])
@pytest.mark.parametrize("n", [*ORDERS, 8])
def test_limited_gain_power_is_its_blocks(n: int, levels: float | None) -> None:
    poles = [*(-1.0 - 0.1 * np.arange(2 * n - 4)), -1.2 + 0.4j, -1.2 - 0.4j]
    each = None if levels is None else levels * np.arange(1.0, n)
    law = limited(n, 12.0, poles=poles, saturation=each)
    assert np.poly(continuous(limited(n, poles=poles).spec).closed) == pytest.approx(
        np.poly(poles).real, rel=1e-6
    )
    y = SINE[:900] + 0.3
    theirs = blocks(y, n, law.spec["alpha"], law.spec["beta"], 12.0, each)
    ours = in_blocks(law.run(T, y).memory, n)
    assert np.max(np.abs(ours - theirs) / np.max(np.abs(theirs), axis=0)) < 1e-11


@pytest.mark.parametrize("n", ORDERS)
def test_it_is_the_low_power_law_without_its_last_block(n: int) -> None:
    law = limited(n)
    alpha, beta = law.spec["alpha"], law.spec["beta"]
    whole = LowPowerObserver(n, 50.0, alpha=[*alpha, 1.7], beta=beta, **EULER)
    ours, theirs = law.run(T, SINE).memory, whole.run(T, SINE).memory
    assert ours[:, : n - 1] == pytest.approx(theirs[:, : n - 1], rel=1e-9, abs=1e-9)
    assert ours[:, n - 1] == pytest.approx(theirs[:, -1], rel=1e-9, abs=1e-9)
    assert ours[:, n:] == pytest.approx(theirs[:, n:-1], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("timing", TIMINGS)
@pytest.mark.parametrize("method", METHODS[:5])
def test_two_states_are_the_standard_law(method: str, timing: str) -> None:
    manner: dict[str, Any] = {"method": method, "timing": timing}
    standard = StandardObserver(2, 40.0, k=(2.0, 1.5), **manner).run(T, SINE).x_hat
    for kind, given in (
        ("limited-gain", {"alpha": [2.0], "beta": [1.5]}),
        ("cascade", {"k": [2.0, 1.5]}),
    ):
        law = HighGainObserver(kind, 2, 40.0, **given, **manner)
        assert law.run(T, SINE).x_hat == pytest.approx(standard, rel=1e-12, abs=1e-12)


# --- cascade ------------------------------------------------------------------------------------


def stages(y: Array, n: int, k: Any, beta: Any, ell: float, levels: Any = None) -> Array:
    """Estimates before each sample, by forward Euler."""
    sat, out = clipped(levels), np.empty((len(y), n))
    x1 = x2 = 0.0
    w = np.zeros(n - 2)
    for j, sample in enumerate(y):
        out[j, :2] = x1, sat(2, x2)
        for i in range(n - 2):
            out[j, i + 2] = sat(i + 3, beta[i] * ell * (out[j, i + 1] - w[i]))
        e = sample - x1
        x1, x2 = x1 + T * (x2 + k[0] * ell * e), x2 + T * k[1] * ell**2 * e
        w = w + T * np.array([b * ell * (out[j, i + 1] - w[i]) for i, b in enumerate(beta)])
    return out


def cascade(n: int, ell: float = 50.0, **given: Any) -> HighGainObserver:
    return HighGainObserver("cascade", n, ell, **{**EULER, **given})


def test_figures_of_a_cascade() -> None:
    double = {"k": (2.0, 1.0), "beta": (1.0, 1.0)}
    law = cascade(4, **double)
    std = np.sqrt(1e-6 * law.noise_gain(2e-4))
    assert std == pytest.approx(
        [1.123093108e-4, 2.518867875e-3, 1.096182698e-1, 5.028509135], rel=1e-8
    )
    standard = StandardObserver(4, 50.0, poles=[-1.0] * 4, **EULER)
    std = np.sqrt(1e-6 * standard.noise_gain(2e-4))
    assert std == pytest.approx(
        [1.719804280e-4, 1.219196668e-2, 4.042624877e-1, 5.028509135], rel=1e-8
    )
    t = 2e-4 * np.arange(5000)
    y = 1.0 + t + t**2 / 2.0 + t**3 / 6.0
    free, held = law.run(2e-4, y).x_hat, cascade(4, **double, saturation=3.0).run(2e-4, y).x_hat
    assert np.abs(free).max(axis=0) == pytest.approx(
        [2.665382706665, 18.754786763816, 587.078325886596, 21464.8652148], rel=1e-9
    )
    assert np.abs(held).max(axis=0) == pytest.approx([2.665382706665, 3, 3, 3], rel=1e-9)
    row = [2.665382706665, 2.421000006667, 1.94, 1.0]
    assert free[4999] == pytest.approx(row, rel=1e-9)
    assert held[4999] == pytest.approx(row, rel=1e-9)


@pytest.mark.parametrize("levels", [None, 0.5, 4.0])
@pytest.mark.parametrize("n", [*ORDERS, 8])
def test_a_cascade_is_its_stages(n: int, levels: float | None) -> None:
    k, beta = (1.3, 0.8), 0.7 + 0.2 * np.arange(n - 2)
    each = None if levels is None else levels * np.arange(1.0, n)
    law = cascade(n, 25.0, k=k, beta=beta, saturation=each)
    y = SINE[:900] + 0.3
    theirs = stages(y, n, k, beta, 25.0, each)
    ours = law.run(T, y).x_hat
    assert np.max(np.abs(ours - theirs) / np.max(np.abs(theirs), axis=0)) < 1e-11
    assert each is None or np.all(np.abs(ours[:, 1:]) <= each)


@pytest.mark.parametrize("n", [*ORDERS, 8])
def test_the_last_state_of_a_cascade_is_the_standard_laws(n: int) -> None:
    law = cascade(n, 30.0, poles=[-1.0] * n)
    standard = StandardObserver(n, 30.0, poles=[-1.0] * n, **EULER)
    ours, theirs = law.run(T, SINE).x_hat[:, -1], standard.run(T, SINE).x_hat[:, -1]
    assert np.max(np.abs(ours - theirs)) < 1e-10 * np.max(np.abs(theirs))


def test_a_cascade_lags() -> None:
    t = T * np.arange(4000)
    law, standard = cascade(3, poles=[-1.0] * 3), StandardObserver(3, 50.0, poles=[-1.0] * 3)
    end = t[-1]
    assert law.run(T, t**2 / 2.0).x_hat[-1, 1] - end == pytest.approx(-0.04, abs=1e-3)
    assert standard.run(T, t**2 / 2.0).x_hat[-1, 1] - end == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("timing", TIMINGS)
def test_a_cascade_begins_where_it_is_told(timing: str) -> None:
    for levels in (None, 9.0):
        law = cascade(4, 40.0, saturation=levels, timing=timing)
        start = law.initial_memory([1.0, -2.0, 3.0, 0.5])
        missing = law.run(1e-12, [np.nan, np.nan], memory0=start).x_hat
        assert missing[0] == pytest.approx([1.0, -2.0, 3.0, 0.5], abs=1e-9)
        assert missing[1] == pytest.approx([1.0, -2.0, 3.0, 0.5], abs=1e-6)
    with pytest.raises(hgo_rs.HgoError, match="within the saturation"):
        cascade(4, 40.0, saturation=1.0).initial_memory([1.0, -2.0, 3.0, 0.5])


# --- reduced order ------------------------------------------------------------------------------


def behind(y: Array, n: int, k: Any, ell: float, phi: Any = lambda x, u: 0.0, u: Any = None) -> Any:
    """x_hat of eta before the sample and the sample, by forward Euler of eta."""
    eta, gains = np.zeros(n - 1), np.asarray(k) * ell ** np.arange(1.0, n)
    out = np.empty((len(y), n))
    for j, sample in enumerate(y):
        x = out[j] = np.append(sample, eta + gains * sample)
        last = phi(x, 0.0 if u is None else u[j])
        eta = eta + T * (np.append(x[2:], last) - gains * x[1])
    return out


def reduced(n: int, ell: float = 50.0, **given: Any) -> HighGainObserver:
    manner = {"method": "euler", "timing": "current"}
    return HighGainObserver("reduced-chain", n, ell, **{**manner, **given})


def test_figures_of_reduced_order() -> None:
    law = reduced(3, k=(2.0, 1.0))
    x_hat = law.run(T, SINE).x_hat
    assert x_hat[1000] == pytest.approx([SINE[1000], -0.835214049507, -3.750081470973], rel=1e-9)
    # the response in continuous time, from that of short steps
    named = [0.036953237148 + 7.129389120358j, -46.210400127682 + 13.197584695788j]
    found = []
    for dt in (1e-4, 5e-5):
        a, b, c, d = hgo_rs.design.discrete({**law.spec, "method": "rk4"}, dt)
        z = np.exp(7j * dt)
        found.append((c @ np.linalg.solve(z * np.eye(3) - a, b) + d)[1:, 0])
    assert 2.0 * found[1] - found[0] == pytest.approx(named, rel=1e-5)


@pytest.mark.parametrize("n", [*ORDERS, 8])
def test_reduced_order_is_its_equations(n: int) -> None:
    poles = [*(-1.0 - 0.2 * np.arange(n - 1))]
    states = [f"x{i + 1}" for i in range(n)]
    model = hgo_rs.Model(states=states, inputs=["u"], phi="u - 2*sin(x1) - 0.5*x2")
    law = reduced(n, 15.0, poles=poles, model=model)
    u = np.cos(5.0 * T * np.arange(900))
    y = SINE[:900] + 0.3

    def phi(x: Array, u: float) -> float:
        return float(u - 2.0 * np.sin(x[0]) - 0.5 * x[1])

    theirs = behind(y, n, law.spec["k"], 15.0, phi, u)
    current = law.run(T, y, u).x_hat
    assert np.max(np.abs(current - theirs) / np.max(np.abs(theirs), axis=0)) < 1e-11
    before = law.run(T, y, u, timing="predictor").x_hat[1:, 1:]
    eta = theirs[1:, 1:] - np.asarray(law.spec["k"]) * 15.0 ** np.arange(1.0, n) * y[1:, None]
    seen = eta + np.asarray(law.spec["k"]) * 15.0 ** np.arange(1.0, n) * (
        y[:-1, None] + T * theirs[:-1, 1:2]
    )
    assert np.max(np.abs(before - seen) / np.max(np.abs(seen), axis=0)) < 1e-10


def test_reduced_order_of_two_states_is_the_dirty_derivative() -> None:
    tau = 0.05
    law = reduced(2, 1.0 / tau, k=(1.0,))
    v, x_hat = 0.0, law.run(T, SINE).x_hat
    last = 0.0
    for k, sample in enumerate(SINE):
        v, last = (1.0 - T / tau) * v + (sample - last) / tau, sample
        assert x_hat[k, 1] == pytest.approx(v, rel=1e-10, abs=1e-12)
    a, b = 1.0 - T / tau, 1.0 / tau
    assert law.noise_gain(T)[1] == pytest.approx(2.0 * b**2 / (1.0 + a), rel=1e-9)


def test_reduced_order_of_two_states_is_that_of_sampled_data() -> None:
    """Katayama's law of one output and one unmeasured state; it takes f2 of y, not of its slope."""
    model = hgo_rs.Model(states=["x", "v"], f1=["0"], g=[["1"]], f2=["-2*sin(x)"])
    other = hgo_rs.ReducedOrderObserver(0.05, h_bar=[0.4], model=model)
    ours = reduced(2, 8.0, k=(1.0,), model=hgo_rs.Model(states=["x", "v"], phi="-2*sin(x)"))
    x_hat, z_hat = ours.run(T, SINE, start="first-sample").x_hat, other.run(T, SINE).x_hat
    assert x_hat[1:, 1] == pytest.approx(z_hat[1:, 0], rel=1e-10, abs=1e-12)


def test_a_gap_is_moved_over_by_the_chain() -> None:
    """A missing sample is one that the estimate foretells."""
    law = reduced(3)
    y = SINE[:400].copy()
    y[200:220] = np.nan
    x_hat = law.run(T, y).x_hat
    step = np.eye(3) + T * np.eye(3, k=1)
    for k in range(200, 220):
        assert x_hat[k] == pytest.approx(step @ x_hat[k - 1], rel=1e-12)


# --- all ----------------------------------------------------------------------------------------

KINDS = ("limited-gain", "cascade", "reduced-chain")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("timing", TIMINGS)
@pytest.mark.parametrize("method", METHODS[:5])
def test_rust_is_the_twin(kind: str, method: str, timing: str) -> None:
    y = np.sin(2.0 * T * np.arange(300))
    y[100:130] = np.nan
    u = np.cos(np.arange(300.0))
    gains: list[Any] = [15.0]
    more: list[dict[str, Any]] = [{}]
    if kind != "reduced-chain":
        gains += [hgo_rs.AdaptiveGain(10.0, 0.0025, 0.183)]
        gains += [hgo_rs.SwitchedGain(fast=30.0, slow=10.0, zone=0.05, delay=0.0123)]
        more += [{"saturation": 1.2}, {"saturation": 1.2, "clip": "smooth"}]
        more += [{"shape": hgo_rs.Stubborn(decay=5.0, growth=20.0, sigma0=0.01)}]
    for n, gain, given in itertools.product((2, 3, 5), gains, more):
        model = None if kind == "cascade" else hgo_rs.InputGain(2.0)
        law = HighGainObserver(kind, n, gain, model=model, method=method, timing=timing, **given)
        start = law.initial_memory()
        start[: law.n] = 0.1
        told = None if model is None else u
        result = law.run(T, y, told, memory0=start)
        twin = reference.Observer(law.spec)
        theirs = twin.run(T * np.arange(300), y, told, start)["memory"]
        np.testing.assert_allclose(result.memory, theirs, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_step_limits_are_those_of_its_matrix(kind: str) -> None:
    """A stable and an unstable step on either side of each limit, from the twin's own steps."""
    for method, timing in itertools.product(METHODS[:5], TIMINGS):
        law = HighGainObserver(kind, 3, 1.0, method=method, timing=timing)
        limit = law.step_limit().dt
        twin = reference.Observer(law.spec)
        size = twin.memory_len - (timing == "current")

        def radius(dt: float, twin: Any = twin, timing: str = timing, size: int = size) -> float:
            columns = []
            for unit in np.eye(size):
                if timing == "predictor":
                    columns.append(twin.step(unit, 0.0, None, 0.0, dt)[0])
                else:
                    used, _ = twin.correct(np.append(unit, dt), 0.0, 0.0)
                    columns.append(twin.predict(used, None, 0.0, dt)[0][:size])
            return float(np.max(np.abs(np.linalg.eigvals(np.array(columns).T))))

        assert radius(0.999 * limit) < 1.0 < radius(1.001 * limit), (method, timing)


@pytest.mark.parametrize("kind", KINDS)
def test_noise_is_measured(kind: str) -> None:
    law = HighGainObserver(kind, 3, 30.0, **EULER)
    noise = np.random.default_rng(3).standard_normal(400_000)
    x_hat = law.run(T, noise).x_hat[1000:]
    assert np.var(x_hat, axis=0) == pytest.approx(law.noise_gain(T), rel=0.05)
    with np.errstate(all="ignore"):
        assert np.all(np.isfinite(law.bandwidth(T)[1:]))


@pytest.mark.parametrize(
    ("kind", "timing"),
    [("limited-gain", "current"), ("reduced-chain", "current"), ("reduced-chain", "predictor")],
)
def test_what_a_model_lacks_is_measured(kind: str, timing: str) -> None:
    law = HighGainObserver(kind, 2, 30.0, method="rk4", timing=timing)
    drift, x = (
        np.random.default_rng(3).standard_normal(200_000) * np.sqrt(T),
        np.zeros((200_000, 2)),
    )
    other = np.random.default_rng(4).standard_normal(200_000) * np.sqrt(T / 12.0)
    for k in range(1, len(x)):
        x[k, 0] = x[k - 1, 0] + T * (x[k - 1, 1] + 0.5 * drift[k] + other[k])
        x[k, 1] = x[k - 1, 1] + drift[k]
    error = (law.run(T, x[:, 0]).x_hat - x)[1000:]
    expected = model_gain(law.spec, T)
    found = np.var(error, axis=0)
    assert found == pytest.approx(expected, rel=0.1, abs=1e-20)


def test_a_lag_has_no_deviation() -> None:
    law = cascade(3)
    with pytest.raises(hgo_rs.HgoError, match="lag behind a random walk"):
        model_gain(law.spec, T)


@pytest.mark.parametrize("kind", KINDS)
def test_it_goes_wherever_laws_go(kind: str, tmp_path: Any) -> None:
    law = HighGainObserver(kind, 3, 40.0, method="rk4")
    law.save(tmp_path / "observer.toml")
    again = load(tmp_path / "observer.toml").observer()
    assert type(again) is HighGainObserver and again.spec == law.spec
    y = np.sin(T * np.arange(200))
    assert np.array_equal(again.run(T, y).x_hat, law.run(T, y).x_hat)
    files = law.export(to="c", out=tmp_path / "law.c", dt=T)
    assert any(hgo_rs.laws.LAWS[kind].title in path.read_text() for path in files)


@pytest.mark.parametrize("timing", TIMINGS)
def test_they_go_with_other_chains(timing: str) -> None:
    model = hgo_rs.Model(states=["a", "b", "c", "d", "e"], orders=[3, 2], phi=["-a + d", "-d + b"])
    parts: list[Any] = [
        HighGainObserver("limited-gain", 3, 30.0, timing=timing, saturation=4.0),
        HighGainObserver("reduced-chain", 2, 25.0, timing=timing),
    ]
    both = hgo_rs.MultiOutputObserver(parts, model=model)
    rows = np.column_stack([SINE[:300], np.cos(4.0 * T * np.arange(300))])
    rows[100:120] = np.nan
    theirs = reference.Observer(both.spec).run(
        T * np.arange(300), rows, None, both.initial_memory()
    )["memory"]
    np.testing.assert_allclose(both.run(T, rows).memory, theirs, rtol=1e-10, atol=1e-10)
    other = HighGainObserver("cascade", 3, 30.0, timing=timing)
    with pytest.raises(hgo_rs.HgoError, match="a model is not allowed"):
        hgo_rs.MultiOutputObserver([other, parts[1]], model=model)


@pytest.mark.parametrize(
    ("kind", "change", "match"),
    [
        ("cascade", {"model": hgo_rs.InputGain(2.0)}, "model.* left out"),
        ("cascade", {"k": (1.0, 1.0)}, "k and beta: must be given together"),
        ("cascade", {"k": (1.0, 1.0), "beta": (-1.0,)}, "beta = -1"),
        ("cascade", {"poles": [-1 + 1j, -1 - 1j, -1 + 2j, -1 - 2j], "n": 4}, "two poles"),
        ("cascade", {"clip": "smooth"}, "saturation"),
        ("limited-gain", {"alpha": (1.0, 0.0), "beta": (1.0, 1.0)}, "alpha = 0"),
        ("limited-gain", {"alpha": (1.0, 1.0), "beta": (1.0, 9.0)}, "Hurwitz"),
        ("limited-gain", {"saturation": 0.0}, "saturation"),
        ("limited-gain", {"n": 9}, "n = 9: must be an integer >= 2 and <= 8"),
        ("limited-gain", {"method": "zoh"}, "defined for the laws standard, low-power"),
        ("limited-gain", {"gain": hgo_rs.HomogeneousGain(1.0)}, "gain"),
        ("reduced-chain", {"gain": hgo_rs.AdaptiveGain(1.0, 1.0, 0.2)}, "a constant gain"),
        ("reduced-chain", {"shape": hgo_rs.Stubborn(1.0, 2.0)}, "acts at once"),
        ("reduced-chain", {"k": (1.0, -1.0)}, "left half plane"),
        ("reduced-chain", {"saturation": 1.0}, "has no saturation"),
        ("reduced-chain", {"n": 1}, "n = 1"),
    ],
)
def test_what_cannot_be_is_refused(kind: str, change: dict[str, Any], match: str) -> None:
    with pytest.raises(hgo_rs.HgoError, match=match):
        HighGainObserver(**{"kind": kind, "n": 3, "gain": 40.0, **change})


def test_reduced_order_has_no_response_in_continuous_time() -> None:
    with pytest.raises(hgo_rs.HgoError, match="give dt"):
        reduced(3).noise_gain()


def test_a_cascade_without_a_filter_is_saved_and_read(tmp_path: Path) -> None:
    observer = HighGainObserver("cascade", 2, 20.0)
    observer.save(tmp_path / "observer.toml")
    assert load(tmp_path / "observer.toml").observer().spec == observer.spec


def test_the_text_of_an_observer_says_which_law_it_is() -> None:
    for kind in ("cascade", "limited-gain"):
        assert repr(HighGainObserver(kind, 3, 20.0)).startswith(f"HighGainObserver('{kind}', n=3,")
    assert repr(LowPowerObserver(3, 20.0)).startswith("LowPowerObserver(n=3,")
