"""The high-gain EKF: figures, identities, the textbook's filter, the twin, what is built on it."""

from __future__ import annotations

import itertools
import shutil
import subprocess

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_continuous_are

from hgo_rs import (
    AdaptiveGain,
    Crackle,
    DesignError,
    HgoError,
    HighGainEKF,
    InputGain,
    Lee,
    Model,
    MultiOutputObserver,
    NormalNoise,
    SanfelicePraly,
    StandardObserver,
    VanDerPol,
    load,
    reference,
    simulate,
)
from hgo_rs.design import riccati
from hgo_rs.observers import METHODS, TIMINGS

RATES = METHODS[:5]
MIXED = Model(
    states=["a", "b"],
    inputs=["u"],
    parameters={"m": 0.5},
    phi="-sin(a) + m*(1 - a**2)*b + u*cos(t)",
)


def riccati_flow(phi, slope, theta, q, r, p0, x0, z0, end):
    """x, x_hat and P at `end` of (1), (2) with y = x_1, by DOP853."""
    n = len(x0)
    a, c, scale = np.eye(n, k=1), np.eye(n)[:1], np.diag(theta ** np.arange(float(n)))

    def rate(_, z):
        x, x_hat, p = z[:n], z[n : 2 * n], z[2 * n :].reshape(n, n)
        last = np.eye(n)[-1]
        j = a + np.outer(last, slope(x_hat))
        k = p @ c[0] * theta / r
        moved = j @ p + p @ j.T + theta * scale @ q @ scale - theta / r * p @ c.T @ c @ p
        own = a @ x_hat + last * phi(x_hat) + k * (x[0] - x_hat[0])
        return np.r_[a @ x + last * phi(x), own, moved.ravel()]

    start = np.r_[x0, z0, p0.ravel()]
    z = solve_ivp(rate, (0.0, end), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return z[:n], z[n : 2 * n], z[2 * n :].reshape(n, n)


def van_der_pol(x):
    return -x[0] + 0.5 * (1.0 - x[0] ** 2) * x[1]


def its_slope(x):
    return np.array([-1.0 - x[0] * x[1], 0.5 * (1.0 - x[0] ** 2)])


@pytest.mark.parametrize(
    ("theta", "x_hat", "p"),
    [
        (5.0, [-0.752854140, -1.405894033], [1.771424701, 5.256624609, 47.323828723]),
        (1.0, [-0.454922104, -0.874578807], None),
    ],
)
def test_figures_of_the_van_der_pol_oscillator(theta, x_hat, p):
    """With the plant as one differential equation: the figures, and DOP853 of the paper's form."""
    known = VanDerPol(epsilon=0.5, sigma=0.0)
    law = HighGainEKF(
        2, theta, R=1.0, Q=[1.0, 1.0], P0=[1.0, 1.0], model=known, method="rk4", timing="predictor"
    )
    result = simulate(known, law, x0=[1.0, 0.0], dt=1e-3, steps=2000, mode="joint")
    memory = result.final_memory[0]
    assert memory[:2] == pytest.approx(x_hat, abs=2e-9)
    found = law.covariance(memory)
    if p is not None:
        assert found[np.tril_indices(2)] == pytest.approx(p, rel=1e-9)
    x, own, covariance = riccati_flow(
        van_der_pol, its_slope, theta, np.eye(2), 1.0, np.eye(2), [1.0, 0.0], [0.0, 0.0], 2.0
    )
    assert x == pytest.approx([-0.752532298, -1.403939350], abs=2e-9)
    assert memory[:2] == pytest.approx(own, abs=1e-9)
    assert found == pytest.approx(covariance, rel=1e-9)


@pytest.mark.parametrize("theta", [1.0, 7.0])
def test_gains_at_rest_are_those_of_the_standard_law(theta):
    """Without a model: K_i = theta^i k_i, k = (1 + sqrt 2, 1 + sqrt 2, 1) for Q = I, R = 1."""
    start = np.ones(3) * theta ** np.arange(0.0, 6.0, 2.0)
    rates = {"method": "rk4", "timing": "predictor"}
    law = HighGainEKF(3, theta, R=1.0, Q=np.ones(3), P0=start, **rates)
    memory = law.run(2e-3, np.zeros(12_000)).memory[-1]
    gains = law.covariance(memory)[:, 0] * theta
    root = 1.0 + np.sqrt(2.0)
    assert gains == pytest.approx([root * theta, root * theta**2, theta**3], rel=1e-9)
    if theta == 7.0:
        assert gains == pytest.approx([16.899494937, 118.296464556, 343.0], rel=1e-9)


def test_noise_in_the_last_state_gives_butterworth():
    law = HighGainEKF(3, R=0.3, Q=7.0, P0=np.ones(3), method="rk4", timing="predictor")
    memory = law.run(2e-3, np.zeros(12_000)).memory[-1]
    gains = law.covariance(memory)[:, 0] / 0.3
    assert gains == pytest.approx([3.380851743, 5.715079255, 4.830458915], rel=1e-9)
    found = riccati(3, Q=7.0, R=0.3)
    assert found.gains == pytest.approx(gains, rel=1e-9)
    assert found.ell == pytest.approx((7.0 / 0.3) ** (1.0 / 6.0), rel=1e-12)
    assert np.abs(found.poles) == pytest.approx(np.ones(3), rel=1e-9)


def test_gains_of_sampled_data_at_rest():
    """White acceleration, q = 1, R = 1e-6, T = 0.01: the steady Kalman filter's figures."""
    law = HighGainEKF(2, R=1e-6, Q=1.0)
    memory = law.run(0.01, np.zeros(3000)).memory[-1]
    p = law.covariance(memory)
    assert np.sqrt(np.diag(p)) == pytest.approx([8.699070055e-4, 1.017002650e-1], rel=1e-9)
    steady = riccati(2, Q=1.0, R=1e-6, dt=0.01)
    assert steady.gains == pytest.approx([0.756738198274, 49.321577603113], rel=1e-9)
    assert steady.covariance == pytest.approx(p, rel=1e-8)
    assert p[:, 0] / 1e-6 == pytest.approx(steady.gains, rel=1e-8)
    y = np.sin(0.01 * np.arange(3000))
    standard = StandardObserver(2, steady.ell, poles=steady.poles)
    late = (law.run(0.01, y).x_hat - standard.run(0.01, y).x_hat)[-500:]
    assert np.max(np.abs(late)) < 1e-10


@pytest.mark.parametrize("theta", [1.0, 3.0, 20.0])
def test_theta_is_a_change_of_time(theta):
    """Without a model K(theta, T, R) = D K(1, theta T, R/theta)."""
    of = {"Q": [0.2, 0.3, 1.0], "P0": [1.0, 1.0, 1.0]}
    fast = HighGainEKF(3, theta, R=1e-2, **of).run(0.01, np.zeros(800)).memory[-1]
    slow = HighGainEKF(3, R=1e-2 / theta, **of).run(0.01 * theta, np.zeros(800)).memory[-1]
    law = HighGainEKF(3, R=1.0, Q=1.0)
    scale = theta ** np.arange(3.0)
    expected = law.covariance(slow) * np.outer(scale, scale)
    assert law.covariance(fast) == pytest.approx(expected, rel=1e-9)


def textbook(t, y, u, orders, rate, jacobian, q, r, p0, x):
    """The continuous-discrete EKF with P, (I - K C) P and Phi by four small steps of RK4, beginning
    after the first sample; rows of x_hat and P after each sample, NaN is missing.
    """
    n = len(x)
    first = np.cumsum([0, *orders[:-1]])
    a = np.zeros((n, n))
    for i, order in zip(first, orders, strict=True):
        a[i : i + order, i : i + order] = np.eye(order, k=1)
    p, rows = p0.copy(), []
    for k in range(len(t)):
        if k:
            dt, m = t[k] - t[k - 1], 2
            g, phi = dt / m, np.eye(n)

            def both(s, x, phi, k=k):
                return rate(s, x, u[k - 1]), jacobian(s, x, u[k - 1]) @ phi

            for i in range(m):
                s = t[k - 1] + i * g
                k1, f1 = both(s, x, phi)
                k2, f2 = both(s + g / 2, x + g / 2 * k1, phi + g / 2 * f1)
                k3, f3 = both(s + g / 2, x + g / 2 * k2, phi + g / 2 * f2)
                k4, f4 = both(s + g, x + g * k3, phi + g * f3)
                x = x + g / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                phi = phi + g / 6 * (f1 + 2 * f2 + 2 * f3 + f4)
            joint = expm(np.block([[-a, q], [np.zeros((n, n)), a.T]]) * dt)
            p = phi @ p @ phi.T + joint[n:, n:].T @ joint[:n, n:]
            there = np.isfinite(y[k])
            if there.any():
                c = np.eye(n)[first[there]]
                gain = p @ c.T @ np.linalg.inv(c @ p @ c.T + np.diag(r[there]))
                x = x + gain @ (y[k][there] - c @ x)
                p = p - gain @ c @ p
                p = 0.5 * (p + p.T)
        rows.append((x, p))
    return np.array([x for x, _ in rows]), np.array([p for _, p in rows])


def record(samples=400, outputs=1, seed=2):
    rng = np.random.default_rng(seed)
    t = 0.01 * np.arange(samples) + 0.003 * rng.random(samples)
    y = (
        np.sin(t)[:, None]
        + 0.3 * np.arange(outputs)
        + 0.01 * rng.standard_normal((samples, outputs))
    )
    y[100:130, 0] = np.nan
    y[120:160, -1] = np.nan
    return t, y, np.cos(3.0 * t)


def test_it_is_the_textbooks_filter():
    t, y, u = record()
    law = HighGainEKF(2, R=1e-4, Q=[[0.1, 0.02], [0.02, 0.5]], P0=[1e-3, 2.0], model=MIXED)
    result = law.run(t, y[:, 0], u, x_hat0=[0.1, -0.2])

    def rate(s, x, u):
        return np.array([x[1], -np.sin(x[0]) + 0.5 * (1 - x[0] ** 2) * x[1] + u * np.cos(s)])

    def jacobian(s, x, u):
        return np.array([[0, 1], [-np.cos(x[0]) - x[0] * x[1], 0.5 * (1 - x[0] ** 2)]])

    q = np.array([[0.1, 0.02], [0.02, 0.5]])
    p0 = np.diag([1e-3, 2.0])
    x_hat, p = textbook(
        t, y, u, [2], rate, jacobian, q, np.array([1e-4]), p0, np.array([0.1, -0.2])
    )
    assert result.x_hat == pytest.approx(x_hat, rel=1e-11, abs=1e-12)
    assert law.covariance(result.memory) == pytest.approx(p, rel=1e-9, abs=1e-14)
    assert result.missing.sum() == 60


COUPLED = Model(
    states=["e", "ve", "n", "vn"],
    inputs=["w"],
    orders=[2, 2],
    phi=["ve/sqrt(ve**2 + vn**2 + 0.25) - w*vn", "sin(e) + w*ve"],
)


def test_several_outputs_share_one_covariance():
    """Against the textbook's filter of all four states, samples of each output missing at times."""
    t, y, u = record(outputs=2)
    chains = [
        HighGainEKF(2, R=1e-4, Q=0.5, P0=[1e-3, 1.0]),
        HighGainEKF(2, R=4e-4, Q=[0.1, 1.0], P0=[1e-2, 2.0]),
    ]
    law = MultiOutputObserver(chains, model=COUPLED)
    start = np.array([0.0, 1.0, 0.3, 0.5])
    result = law.run(t, y, u, x_hat0=start)

    def speed(x):
        return np.sqrt(x[1] ** 2 + x[3] ** 2 + 0.25)

    def rate(s, x, w):
        return np.array([x[1], x[1] / speed(x) - w * x[3], x[3], np.sin(x[0]) + w * x[1]])

    def jacobian(s, x, w):
        v = speed(x) ** 3
        of_e = [0.0, (x[3] ** 2 + 0.25) / v, 0.0, -x[1] * x[3] / v - w]
        return np.array([[0, 1, 0, 0], of_e, [0, 0, 0, 1], [np.cos(x[0]), w, 0, 0]])

    q, p0 = np.diag([0.0, 0.5, 0.1, 1.0]), np.diag([1e-3, 1.0, 1e-2, 2.0])
    x_hat, p = textbook(t, y, u, [2, 2], rate, jacobian, q, np.array([1e-4, 4e-4]), p0, start)
    assert result.x_hat == pytest.approx(x_hat, rel=1e-10, abs=1e-11)
    found = law.covariance(result.memory)
    assert found == pytest.approx(p, rel=1e-8, abs=1e-13)
    assert np.max(np.abs(found[:, :2, 2:])) > 1e-4  # the chains are coupled


def test_outputs_of_one_time_may_come_one_after_the_other():
    """Each corrects once; where one is missing, its time goes on."""
    t, y, u = record(outputs=2)
    chains = [HighGainEKF(2, R=1e-4, Q=0.5), HighGainEKF(2, 2.0, R=4e-4, Q=1.0)]
    at_once, apart = (MultiOutputObserver(chains, model=COUPLED) for _ in range(2))
    for sample, control, dt in zip(y[:60], u[:60], np.diff(t), strict=False):
        at_once.correct(sample)
        for i in (0, 1, 0):  # a second sample of the same time has no time to correct for
            one = np.where(np.arange(2) == i, sample, np.nan)
            apart.correct(one)
        assert np.array_equal(at_once.memory, apart.memory)
        assert np.array_equal(at_once.memory[-2:] == 0.0, np.isfinite(sample))
        for law in (at_once, apart):
            law.predict(control, dt)
    twin = reference.Observer(apart.spec)
    memory, _ = twin.correct(apart.memory, [0.1, np.nan], t[60])
    apart.correct([0.1, np.nan])
    assert apart.memory == pytest.approx(memory, rel=1e-9, abs=1e-12)
    memory, _ = twin.correct(apart.memory, [np.nan, 0.2], t[60])
    before = apart.memory.copy()
    apart.correct([np.nan, 0.2])
    assert apart.memory == pytest.approx(memory, rel=1e-9, abs=1e-12)
    assert abs(apart.x_hat[2] - before[2]) > 1e-3


def test_an_unknown_is_a_state_in_its_own_unit():
    """A load d that enters by 2 d, against the state x_3 = 2 d of a chain."""
    load = Model(states=["a", "b"], unknown="d", phi="-sin(a) - 0.3*b + 2*d")
    chain = Model(states=["a", "b", "c"], f=["0", "-sin(a) - 0.3*b", "0"])
    noises = {"R": 1e-4, "P0": [1e-3, 1.0, 0.5]}
    unit = np.array([1.0, 1.0, 2.0])
    of_load = HighGainEKF(3, 2.0, **noises, Q=[0.0, 0.1, 0.7], model=load)
    scaled = {"R": 1e-4, "P0": noises["P0"] * unit**2}
    of_chain = HighGainEKF(3, 2.0, **scaled, Q=[0.0, 0.1, 2.8], model=chain)
    t, y, _ = record()
    ours, theirs = of_load.run(t, y[:, 0]), of_chain.run(t, y[:, 0])
    assert ours.x_hat * unit == pytest.approx(theirs.x_hat, rel=1e-9, abs=1e-10)
    p = of_load.covariance(ours.memory) * np.outer(unit, unit)
    assert p == pytest.approx(of_chain.covariance(theirs.memory), rel=1e-8, abs=1e-13)
    with pytest.raises(HgoError, match="an unknown of a model of several outputs"):
        model = Model(
            states=["a", "b", "e", "f"],
            unknown=["d", ""],
            orders=[2, 2],
            phi=["-sin(a) + 2*d", "-e"],
        )
        chains = [HighGainEKF(n, R=1e-4, Q=0.5) for n in (3, 2)]
        MultiOutputObserver(chains, model=model)


SLOPED = Model(states=["a", "b"], unknown="d", phi="-sin(a) + (2 + 0.5*sin(b))*d")

CASES = [
    (HighGainEKF(3, 2.0, R=1e-4, Q=[0.0, 0.1, 0.7], model=SLOPED), False),
    (HighGainEKF(2, 7.0, R=1e-4, Q=[[1.0, 0.3], [0.3, 2.0]], model=MIXED), True),
    (HighGainEKF(1, R=1e-4, Q=0.5), False),
    (HighGainEKF(6, 2.0, R=1e-4, Q=0.5), False),
    (HighGainEKF(5, R=1e-4, Q=0.5, model=Crackle()), False),
    (HighGainEKF(2, R=1e-4, Q=0.5, model=SanfelicePraly(nu1=0.3)), False),
    (HighGainEKF(2, 3.0, R=1e-4, Q=0.5, model=Lee()), False),
    (HighGainEKF(2, R=1e-4, Q=0.5, model=InputGain(2.0)), True),
    (HighGainEKF(2, R=1e-4, Q=0.5, model=Lee(), wrap=0.7), False),
]


@pytest.mark.parametrize(("law", "driven"), CASES)
def test_rust_is_the_twin(law, driven):
    t, y, u = record()
    result = law.run(t, y[:, 0], u if driven else None)
    twin = reference.Observer(law.spec)
    theirs = twin.run(t, y, u if driven else None, law.initial_memory())
    scale = np.max(np.abs(theirs["memory"]), axis=0) + 1e-12
    assert np.max(np.abs(result.memory - theirs["memory"]) / scale) < 1e-9
    given = np.isfinite(y[:, 0])
    assert result.innovation[given] == pytest.approx(theirs["innovation"][given], abs=1e-10)


@pytest.mark.parametrize(
    ("method", "timing", "gain"),
    [*itertools.product(RATES, TIMINGS, (5.0, AdaptiveGain(10.0, 0.0025, 0.183)))],
)
def test_rates_are_the_twins(method, timing, gain):
    noises = {"R": 1e-4, "Q": [[1e-3, 3e-4], [3e-4, 2e-3]], "P0": [1e-5, 1e-3]}
    law = HighGainEKF(2, gain, **noises, model=MIXED, method=method, timing=timing)
    _, y, u = record()
    result = law.run(2e-3, y[:, 0], u)
    theirs = reference.Observer(law.spec).run(2e-3 * np.arange(400), y, u, law.initial_memory())
    scale = np.max(np.abs(theirs["memory"]), axis=0)
    assert np.max(np.abs(result.memory - theirs["memory"]) / scale) < 1e-12


@pytest.mark.parametrize("method", RATES)
def test_rates_of_an_unknown_are_the_twins(method):
    noises = {"R": 1e-3, "Q": [0.0, 1e-3, 1e-3], "P0": [1e-4, 1e-3, 1e-3]}
    law = HighGainEKF(3, 2.0, **noises, model=SLOPED, method=method)
    _, y, _ = record()
    result = law.run(2e-3, y[:, 0])
    theirs = reference.Observer(law.spec).run(2e-3 * np.arange(400), y, None, law.initial_memory())
    scale = np.max(np.abs(theirs["memory"]), axis=0)
    assert np.max(np.abs(result.memory - theirs["memory"]) / scale) < 1e-9


def test_chains_are_the_twins():
    model = Model(
        states=["a", "b", "c", "d", "e"],
        orders=[2, 3],
        inputs=["u"],
        phi=["-a + 0.1*d*b + u", "-c - b*d + sin(a)"],
    )
    chains = [HighGainEKF(2, 2.0, R=1e-4, Q=0.5), HighGainEKF(3, R=1e-3, Q=[0.1, 0.1, 1.0])]
    law = MultiOutputObserver(chains, model=model)
    t, y, u = record(outputs=2)
    result = law.run(t, y, u)
    theirs = reference.Observer(law.spec).run(t, y, u, law.initial_memory())["memory"]
    scale = np.max(np.abs(theirs), axis=0) + 1e-12
    assert np.max(np.abs(result.memory - theirs) / scale) < 1e-9
    rates = [HighGainEKF(n, 2.0, R=1e-2, Q=0.1, method="rk4") for n in (2, 3)]
    mixed = MultiOutputObserver([rates[0], StandardObserver(3, 5.0, method="rk4")], model=model)
    result = mixed.run(2e-3, y, u)
    theirs = reference.Observer(mixed.spec)
    theirs = theirs.run(2e-3 * np.arange(400), y, u, mixed.initial_memory())["memory"]
    np.testing.assert_allclose(result.memory, theirs, rtol=1e-9, atol=1e-9)


def test_the_covariance_is_that_of_the_errors():
    """By Monte Carlo: noise as stated gives errors as wide as P says."""
    runs, n = 400, 100
    rng = np.random.default_rng(5)
    r, q, dt = 1e-4, 0.5, 0.02
    law = HighGainEKF(2, R=r, Q=q, P0=[1e-4, 1.0], model=Model(states=["a", "b"], phi="-sin(a)"))
    x = rng.standard_normal((runs, 2)) * [0.01, 1.0]
    y = np.empty((n, runs))
    for k in range(n):
        y[k], last = x[:, 0] + np.sqrt(r) * rng.standard_normal(runs), x
        for _ in range(20):
            kick = np.sqrt(q * dt / 20) * rng.standard_normal(runs)
            rate = np.stack([x[:, 1], -np.sin(x[:, 0])], axis=1)
            x = x + dt / 20 * rate + np.stack([0.0 * kick, kick], axis=1)
    memory = np.array([law.run(dt, y[:, i]).memory[-1] for i in range(runs)])
    deviation = np.sqrt(np.diagonal(law.covariance(memory), axis1=1, axis2=2))
    error = (memory[:, :2] - last) / deviation
    assert np.std(error, axis=0) == pytest.approx([1.0, 1.0], abs=0.1)


def test_studies_and_exports_have_its_bits(tmp_path):
    known = VanDerPol(epsilon=0.5, sigma=0.0)
    law = HighGainEKF(2, 2.0, R=1e-4, Q=0.5, model=known)
    of = {"x0": [1.0, 0.0], "dt": 0.01, "steps": 200, "noise": NormalNoise(0.01), "rng": 3}
    one = simulate(known, law, **of, runs=4)
    twin = simulate(known, law, **of, runs=4, backend="numpy")
    for name in ("rms", "peak"):
        assert one.metrics[name] == pytest.approx(twin.metrics[name], rel=1e-8)
    law.save(tmp_path / "observer.toml")
    again = load(tmp_path / "observer.toml").observer()
    assert type(again) is HighGainEKF and again.spec == law.spec
    t, y, _ = record()
    assert np.array_equal(again.run(t, y[:, 0]).memory, law.run(t, y[:, 0]).memory)
    files = law.export(to="c", out=tmp_path / "filter", dt=0.01)
    assert any("high-gain extended Kalman filter" in path.read_text() for path in files)
    on_line = HighGainEKF(2, 2.0, R=1e-4, Q=0.5, model=known)
    for k in range(200):
        on_line.step(y[k, 0], dt=0.01)
    assert np.array_equal(on_line.memory, law.run(0.01, y[:200, 0]).memory[-1])
    assert law.step_limit().dt == np.inf
    (gap,) = law.run(0.01, y[:, 0]).gaps
    assert gap.length == 60


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_exported_source_has_its_bits(tmp_path):
    """The source's own test: 100 steps of the law, bit for bit."""
    one = HighGainEKF(3, 2.0, R=1e-4, Q=[0.0, 0.1, 0.7], model=SLOPED)
    chains = [HighGainEKF(2, R=1e-4, Q=0.5), HighGainEKF(2, 2.0, R=4e-4, Q=1.0)]
    for i, law in enumerate([one, MultiOutputObserver(chains, model=COUPLED)]):
        out = tmp_path / str(i)
        law.export(to="c", out=out, dt=0.01)
        made = subprocess.run(["make"], cwd=out, capture_output=True, text=True)
        assert made.returncode == 0 and "every bit as expected: OK" in made.stdout, made


def test_a_file_of_its_numbers_alone(tmp_path):
    """Q by its last entry or its diagonal, R as a number, P0 left out, the gain too."""
    (tmp_path / "a.toml").write_text(
        'format = 1\nobserver = "high-gain-ekf"\norder = 2\nQ = 0.5\nR = 1e-4\n'
    )
    assert load(tmp_path / "a.toml").observer().spec == HighGainEKF(2, R=1e-4, Q=0.5).spec
    law = HighGainEKF(2, R=1e-4, Q=0.5)
    rate = (0.5 / 1e-4) ** (1.0 / 3.0)
    assert law.spec["P0"] == pytest.approx([1e-2, 0.0, 1e-2 * rate**2], rel=1e-12)
    law = HighGainEKF(2, 3.0, R=1e-4, Q=0.5, method="rk4")
    rate = (0.5 / 1e-4) ** 0.25
    assert law.spec["P0"] == pytest.approx([1e-2 * rate, 0.0, 9e-2 * rate**3], rel=1e-12)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"theta": 0.5}, "theta = 0.5: must be finite and >= 1"),
        ({"gain": 0.5}, "theta = 0.5: must be >= 1"),
        ({"R": 0.0}, "R = 0"),
        ({"Q": [[1.0, 2.0], [2.0, 1.0]]}, "Q.*positive semidefinite"),
        ({"Q": [[1.0, 0.3], [0.2, 1.0]]}, "Q.*symmetric"),
        ({"Q": 0.0}, "Q.*positive entry, or P0"),
        ({"Q": [1.0] * 4}, "Q.*4 numbers given"),
        ({"P0": [1.0, 0.0]}, "P0.*must be finite and > 0"),
        ({"P0": 1.0}, "P0.*diagonal"),
        ({"method": "zoh"}, "method = 'zoh': must be one of sampled, euler"),
        ({"timing": "predictor"}, "timing = 'predictor': must be 'current'"),
        (
            {"gain": AdaptiveGain(10.0, 0.0025, 0.183)},
            "or an InnovationGain, under method 'sampled'",
        ),
        ({"n": 7}, "n = 7: must be an integer >= 1 and <= 6"),
        ({"model": Crackle()}, "of order 2"),
    ],
)
def test_what_cannot_be_is_refused(change, match):
    with pytest.raises(HgoError, match=match):
        HighGainEKF(**{"n": 2, "R": 1e-4, "Q": 0.5, **change})


def test_functions_without_slopes_are_refused():
    lookup = np.linspace(-1.0, 1.0, 5)

    def phi(t, x, u):
        return float(np.interp(float(x[0]), lookup, lookup**3))

    model = Model(states=["a", "b"], phi=phi)
    with pytest.raises(HgoError, match="needs the slopes of its model"):
        HighGainEKF(2, R=1e-4, Q=0.5, model=model)


def test_chains_that_do_not_fit_are_refused():
    law = HighGainEKF(2, R=1e-4, Q=0.5)
    with pytest.raises(HgoError, match="one covariance over all chains"):
        MultiOutputObserver([law, StandardObserver(2, 10.0)], model=COUPLED)
    standard = MultiOutputObserver([StandardObserver(2, 10.0)] * 2, model=COUPLED)
    with pytest.raises(HgoError, match="of high-gain EKFs"):
        standard.covariance()
    with pytest.raises(HgoError, match="wrap is not allowed for high-gain EKFs of several"):
        MultiOutputObserver([HighGainEKF(2, R=1e-4, Q=0.5, wrap=1.0)] * 2, model=COUPLED)
    with pytest.raises(DesignError, match="gains move with P"):
        law.bandwidth()


def test_riccati_sees_slopes():
    """A stiff spring and friction: the gains solve the Riccati equation of the linearised model."""
    slopes = np.array([-400.0, -3.0])
    found = riccati(2, Q=2.0, R=1e-5, slopes=slopes)
    j = np.array([[0.0, 1.0], slopes])
    p = solve_continuous_are(j.T, np.eye(2)[:, :1], np.diag([0.0, 2.0]), [[1e-5]])
    assert found.gains == pytest.approx(p[:, 0] / 1e-5, rel=1e-9)
    k = np.real(np.poly(found.poles * found.ell))[1:]
    assert k == pytest.approx(found.gains, rel=1e-9)
    spring = Model(states=["a", "b"], phi="-400*a - 3*b")
    start = {"P0": [1e-4, 1.0], "method": "rk4", "timing": "predictor"}
    law = HighGainEKF(2, R=1e-5, Q=2.0, model=spring, **start)
    memory = law.run(1e-3, np.zeros(8000)).memory[-1]
    assert law.covariance(memory)[:, 0] / 1e-5 == pytest.approx(found.gains, rel=1e-8)
    with pytest.raises(DesignError, match="Q"):
        riccati(2, Q=0.0, R=1.0)
    with pytest.raises(DesignError, match="shape of slopes"):
        riccati(2, Q=1.0, R=1.0, slopes=[1.0, 2.0, 3.0])
