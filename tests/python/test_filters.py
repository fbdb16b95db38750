"""Filters that users know, as observers: closed forms, other forms, what is built on them."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov
from scipy.signal import savgol_coeffs

from hgo_rs import (
    HgoError,
    InputGain,
    NormalNoise,
    Plant,
    StandardObserver,
    WindowObserver,
    load,
    reference,
    simulate,
)
from hgo_rs.design import discrete, poles_of_gains
from hgo_rs.tuning.reference import butterworth

DT = 0.01
SG = WindowObserver.savitzky_golay
DIRTY = WindowObserver.dirty_derivative


def record(count=300, seed=0):
    rng = np.random.default_rng(seed)
    return np.sin(3.0 * DT * np.arange(count)) + 0.01 * rng.standard_normal(count)


def corrections(observer, dt=DT):
    """K, by a step of the observer itself."""
    n = observer.n
    memory = observer.initial_memory()
    if observer.spec["kind"] == "standard":
        memory[-1] = dt
    return reference.Observer(observer.spec).correct(memory, 1.0, 0.0)[0][:n]


@pytest.mark.parametrize(
    ("n", "gains"),
    [
        (2, (0.451188363906, 6.717519473059)),
        (3, (0.593430340259, 17.540970444728, 174.105864963266)),
    ],
)
def test_fading_memory(n, gains):
    """ell = 30, T = 0.01; and the weighted least squares that it is."""
    theta = math.exp(-0.3)
    observer = StandardObserver.fading_memory(n, theta, DT)
    assert corrections(observer) == pytest.approx(gains, rel=1e-9)
    y = record()
    last = observer.run(DT, y).x_hat[-1]
    ages = np.arange(len(y))
    s, weight = -DT * ages, theta ** (ages / 2.0)
    basis = s[:, None] ** np.arange(n) / [math.factorial(i) for i in range(n)]
    fitted = np.linalg.lstsq(weight[:, None] * basis, weight * y[::-1], rcond=None)[0]
    assert last == pytest.approx(fitted, rel=1e-9)


def test_alpha_beta_by_its_recursion_and_its_noise():
    theta = math.exp(-0.3)
    alpha, beta = 1.0 - theta**2, (1.0 - theta) ** 2
    observer = StandardObserver.alpha_beta_gamma(alpha, beta, DT)
    assert corrections(observer) == pytest.approx((alpha, beta / DT), rel=1e-9)
    noise = (0.329529226485, 66.005956020)
    assert observer.noise_gain(DT) == pytest.approx(noise, rel=1e-8)
    for gains in ((0.5, 0.2, None), (0.4, 0.1, 0.01)):
        y, n = record(), 2 + (gains[2] is not None)
        k = np.array([g / DT**i for i, g in enumerate(gains) if g is not None])
        x, found = np.zeros(n), []
        for sample in y:  # the textbook's two lines
            x = x + k * (sample - x[0])
            found.append(x)
            x = np.array(
                [
                    sum(x[j] * DT ** (j - i) / math.factorial(j - i) for j in range(i, n))
                    for i in range(n)
                ]
            )
        for kind in (StandardObserver, WindowObserver):
            observer = kind.alpha_beta_gamma(gains[0], gains[1], DT, gains[2])
            run = observer.run(DT, y)
            if kind is StandardObserver:  # its first sample corrects for no time
                run = observer.run(DT, y, memory0=[*[0.0] * n, DT])
            assert run.x_hat == pytest.approx(np.array(found), rel=1e-9, abs=1e-9), kind


def test_kalata_and_the_steady_kalman_filter():
    observer = StandardObserver.tracking_index(0.5, DT)
    k = corrections(observer)
    assert (k[0], k[1] * DT) == pytest.approx((0.628373457205, 0.304805898399), rel=1e-9)
    # the Riccati equation of an acceleration that is held over each step
    g, phi, h = np.array([[DT**2 / 2], [DT]]), np.array([[1.0, DT], [0.0, 1.0]]), np.eye(1, 2)
    q, r, p = (0.5 / DT**2) ** 2, 1.0, np.eye(2)
    for _ in range(3000):
        gain = p @ h.T / (h @ p @ h.T + r)
        p = phi @ (p - gain @ h @ p) @ phi.T + q * g @ g.T
    assert k == pytest.approx(gain[:, 0], rel=1e-9)

    sampled = StandardObserver.steady_kalman(2, Q=1.0, R=1e-6, dt=DT)
    assert corrections(sampled) == pytest.approx((0.756738198274, 49.321577603113), rel=1e-8)
    q = DT * np.array([[DT**2 / 3, DT / 2], [DT / 2, 1.0]])
    a = (np.eye(2) - np.outer(corrections(sampled), [1.0, 0.0])) @ phi
    rest = np.eye(2) - np.outer(corrections(sampled), [1.0, 0.0])
    noise = 1e-6 * np.outer(corrections(sampled), corrections(sampled))
    p = solve_discrete_lyapunov(a, rest @ q @ rest.T + noise)
    assert np.sqrt(np.diag(p)) == pytest.approx((8.699070055e-4, 1.017002650e-1), rel=1e-8)

    continuous = StandardObserver.steady_kalman(3, Q=7.0, R=0.3)
    ell = continuous.spec["gain"]["ell"]
    gains = np.array(continuous.spec["k"]) * ell ** np.arange(1.0, 4.0)
    assert gains == pytest.approx((3.380851743, 5.715079255, 4.830458915), rel=1e-8)
    for n in (2, 3, 4, 6):  # Butterworth's poles
        found = StandardObserver.steady_kalman(n, Q=7.0, R=0.3)
        assert found.spec["gain"]["ell"] == pytest.approx((7.0 / 0.3) ** (0.5 / n), rel=1e-8)
        assert np.poly(butterworth(n))[1:].real == pytest.approx(found.spec["k"], rel=1e-8)


@pytest.mark.parametrize(
    ("window", "degree", "noise"),
    [(11, 1, 9.534625892), (11, 2, 35.445877848), (21, 3, 32.737257829)],
)
def test_savitzky_golay(window, degree, noise):
    observer = SG(window, degree, DT)
    assert np.sqrt(observer.noise_gain(DT)[1]) == pytest.approx(noise, rel=1e-9)
    if degree == 1:
        assert noise == pytest.approx(math.sqrt(12 / (DT**2 * window * (window**2 - 1))), rel=1e-9)
    y = record()
    run = observer.run(DT, y)
    for i in range(degree + 1):  # SciPy's weights, over the last samples
        weights = savgol_coeffs(window, degree, deriv=i, delta=DT, pos=window - 1, use="dot")
        theirs = np.convolve(y, weights[::-1], mode="valid")
        assert run.x_hat[window - 1 :, i] == pytest.approx(theirs, rel=1e-8, abs=1e-8), i
    weights = np.reshape(observer.spec["W"], (degree + 1, window))
    if (window, degree) == (11, 2):
        assert weights[1, :3] == pytest.approx((22.027972028, 10.629370629, 1.561771562), rel=1e-9)


@pytest.mark.parametrize("degree", range(1, 5))
def test_savitzky_golay_is_exact_on_its_degree_and_a_difference_at_its_shortest(degree):
    t = DT * np.arange(120)
    c = np.random.default_rng(degree).standard_normal(degree + 1)
    for window in (degree + 1, degree + 4, 21):
        run = SG(window, degree, DT).run(DT, np.polyval(c, t))
        for i in range(degree + 1):
            exact = np.polyval(np.polyder(c, i), t) if i else np.polyval(c, t)
            scale = 1e-11 / DT**i
            assert np.abs(run.x_hat[window:, i] - exact[window:]).max() < scale, (window, i)
    y = record()
    found = SG(degree + 1, degree, DT).run(DT, y).x_hat[:, degree]
    difference = np.diff(y, degree) / DT**degree
    assert found[degree:] == pytest.approx(difference, rel=1e-9, abs=1e-9 / DT**degree)


@pytest.mark.parametrize(
    ("rule", "noise"),
    [("tustin", 19.069251785), ("backward", 17.407765596), ("exact", 19.008809709)],
)
def test_dirty_derivative(rule, noise):
    tau = 0.05
    observer = DIRTY(tau, DT, rule)
    assert np.sqrt(observer.noise_gain(DT)[1]) == pytest.approx(noise, rel=1e-9)
    a = {
        "tustin": (2 * tau - DT) / (2 * tau + DT),
        "backward": tau / (tau + DT),
        "exact": math.exp(-DT / tau),
    }[rule]
    y, v, found = record(), 0.0, [0.0]
    b = {"tustin": 2 / (2 * tau + DT), "backward": 1 / (tau + DT), "exact": (1 - a) / DT}[rule]
    for before, sample in itertools.pairwise(y):
        v = a * v + b * (sample - before)
        found.append(v)
    run = observer.run(DT, y, x_hat0=[y[0], 0.0])
    assert run.x_hat[:, 0] == pytest.approx(y, abs=1e-14)
    assert run.x_hat[:, 1] == pytest.approx(np.array(found), rel=1e-10, abs=1e-10)


def test_dirty_derivative_forward_is_the_reduced_order_observer_by_euler():
    """eta' = -k (eta + k y), v = eta + k y, k = 1/tau."""
    tau, y = 0.05, record()
    eta, found = -y[0] / tau, []
    for sample in y:
        v = eta + sample / tau
        found.append(v)
        eta = eta - DT * v / tau
    run = DIRTY(tau, DT, "forward").run(DT, y, x_hat0=[y[0], 0.0])
    assert run.x_hat[:, 1] == pytest.approx(np.array(found), rel=1e-10, abs=1e-10)
    with pytest.raises(HgoError, match="such that the error decays"):
        DIRTY(0.4 * DT, DT, "forward")


WINDOWS = {
    "Savitzky-Golay": SG(11, 2, DT),
    "shortest": SG(3, 2, DT),
    "longest": SG(31, 3, DT),
    "dirty derivative": DIRTY(0.05, DT),
    "alpha-beta-gamma": WindowObserver.alpha_beta_gamma(1.1, 0.3, DT, 0.02),
}


@pytest.mark.parametrize("name", WINDOWS)
def test_rust_is_the_twin(name):
    observer = WINDOWS[name]
    y = record()
    y[100:110] = np.nan
    y[3] = np.nan
    start = observer.initial_memory(0.1 * np.arange(observer.n))
    twin = reference.Observer(observer.spec)
    theirs = twin.run(DT * np.arange(300), y, None, start)["memory"]
    run = observer.run(DT, y, memory0=start)
    scale = np.max(np.abs(theirs), axis=0)
    scale[observer.n :] = 1.0  # residuals, in the unit of y
    assert np.max(np.abs(run.memory - theirs) / scale) < 1e-11
    compiled = observer.run(DT, y, memory0=start, engine="llvm")
    assert np.array_equal(compiled.memory, run.memory)
    online = []
    observer.reset(memory0=start)
    for k, sample in enumerate(y):
        online.append(observer.correct(sample))
        if k + 1 < len(y):
            observer.predict(dt=DT)
    assert np.array_equal(np.array(online), run.x_hat)


def test_a_missing_sample_counts_as_what_the_polynomial_is_there():
    y = record()
    y[150:160] = np.nan
    run = SG(9, 2, DT).run(DT, y)
    filled = y.copy()
    for k in range(150, 160):
        x = run.x_hat[k - 1]
        filled[k] = x[0] + DT * x[1] + DT**2 / 2 * x[2]
    again = SG(9, 2, DT).run(DT, filled)
    assert again.x_hat == pytest.approx(run.x_hat, rel=1e-9, abs=1e-9 / DT**2)
    # after as many samples as the window nothing is left of the gap, nor of any start
    other = SG(9, 2, DT).run(DT, y[160:], x_hat0=[1.0, -2.0, 3.0])
    assert other.x_hat[8:] == pytest.approx(run.x_hat[168:], rel=1e-7, abs=1e-7)


def test_its_matrices_are_those_of_its_steps():
    for observer in WINDOWS.values():
        found, twin = discrete(observer.spec, DT), reference.Observer(observer.spec)
        size = twin.memory_len
        for i, unit in enumerate(np.eye(size)):
            used = twin.correct(unit, 0.0, 0.0)[0]
            after = twin.predict(used, None, 0.0, DT)[0]
            assert found.a[:, i] == pytest.approx(after, rel=1e-9, abs=1e-9)
            assert found.c[:, i] == pytest.approx(used[: observer.n], rel=1e-9, abs=1e-9)


def test_a_study_has_them():
    plant = Plant(states=["x"], drift=["0"], output="sin(3*t)")
    options = {"x0": [0.0], "dt": DT, "steps": 2000, "runs": 4, "errors": False, "every": 1}
    noise = NormalNoise(std=0.01)
    observer = SG(11, 2, DT)
    found = simulate(plant, observer, noise=noise, rng=1, **options)
    twin = simulate(plant, observer, noise=noise, rng=1, backend="numpy", **options)
    assert np.max(np.abs(found.memory - twin.memory)) < 1e-8
    with pytest.raises(HgoError, match="the period of this window"):
        simulate(plant, observer, noise=noise, **{**options, "dt": 0.02})


def test_they_go_wherever_laws_go(tmp_path):
    for name, observer in WINDOWS.items():
        observer.reset()
        observer.save(tmp_path / "observer.toml")
        again = load(tmp_path / "observer.toml").observer()
        assert type(again) is WindowObserver and again.spec == observer.spec
        y = record()
        assert np.array_equal(again.run(DT, y).x_hat, observer.run(DT, y).x_hat)
        files = observer.export(to="c", out=tmp_path / f"{name[:4].lower()}.c", dt=DT)
        text = "".join(path.read_text() for path in files)
        assert "polynomial of x(k)" in text, name


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: SG(3, 3, DT), "window = 3: must be an integer >= 4"),
        (lambda: SG(24, 2, DT), "window = 24: must be 1 to 12, 15, 17, 21, 25 or 31"),
        (lambda: SG(11, 5, DT), "degree = 5"),
        (lambda: SG(31, 4, DT), "entries of W = 155: must be <= 130"),
        (lambda: SG(11, 2, 0.0), "dt = 0.0"),
        (lambda: DIRTY(-1.0, DT), "tau = -1.0"),
        (lambda: DIRTY(0.1, DT, "euler"), "rule = 'euler': must be one of tustin, backward"),
        (lambda: WindowObserver([[0.5], [500.0]], DT), "such that the error decays"),
        (lambda: WindowObserver([[1.0], [math.nan]], DT), r"W = .*: must be finite"),
        (lambda: WindowObserver([[1.0]], DT), "n = 1: must be an integer >= 2"),
        (lambda: WindowObserver([0.5, 1.0], DT), "give a matrix"),
        (lambda: StandardObserver.alpha_beta_gamma(1.0, 0.2, DT), "choose WindowObserver"),
        (lambda: StandardObserver.alpha_beta_gamma(0.9, 1.9, DT), "choose WindowObserver"),
        (lambda: StandardObserver.alpha_beta_gamma(0.9, 9.0, DT), "give smaller gains"),
        (lambda: StandardObserver.fading_memory(2, 1.0, DT), "theta = 1.0"),
        (lambda: StandardObserver.tracking_index(0.0, DT), "index = 0.0"),
        (lambda: StandardObserver.fading_memory(2, 0.9, DT, k=[1.0]), "an option = 'k'"),
        (lambda: poles_of_gains([math.inf], DT), "n finite numbers"),
    ],
)
def test_what_cannot_be_is_refused(make, match):
    with pytest.raises(HgoError, match=match):
        make()


def test_uneven_steps_are_refused():
    t = DT * np.arange(300) + 0.002 * np.sin(np.arange(300.0))
    with pytest.raises(HgoError, match=r"after sample \d+ \(t = .*resample the record"):
        SG(11, 2, DT).run(t, record())
    with pytest.raises(HgoError, match=r"dt = 0\.02: must be 0\.01 s to 5%"):
        SG(11, 2, DT).run(0.02, record())
    SG(11, 2, DT).run(DT * np.arange(300) + 1e-4 * np.sin(np.arange(300.0)), record())


def test_constructors_take_a_model():
    observer = StandardObserver.fading_memory(2, 0.9, DT, model=InputGain(2.0))
    assert observer.n_u == 1 and observer.spec["poles" if "poles" in observer.spec else "k"]
