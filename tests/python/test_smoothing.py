"""The smoother: against the joint normal distribution, on simulated records, and on real ones."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy import signal
from scipy.io import loadmat
from scipy.linalg import expm
from scipy.stats import multivariate_normal

from hgo_rs import HgoError, InputGain, Lee, Model, smooth
from hgo_rs.logs import Log
from hgo_rs.smoothing.forward import forward
from hgo_rs.smoothing.likelihood import likeliest
from hgo_rs.smoothing.motion import Motion, start
from hgo_rs.smoothing.samples import Samples
from hgo_rs.smoothing.smoother import left_out

PENDULUM = Model(states=["q", "v"], phi="-25*sin(q) - 0.1*v")
LINEAR = Model(states=["q", "v"], inputs=["u"], phi="-9*q - 0.4*v + 2*u")
COUPLED = Model(
    states=["a", "b", "c", "d"],
    orders=[2, 2],
    phi=["-4*a + 1.5*c - 0.2*b", "3*a - 6*c + 0.5*b"],
)


def swing(count, dt, q, noise, seed, steps=20):
    """States and samples of the pendulum, pushed by white noise of intensity q, by Heun's rule."""
    rng = np.random.default_rng(seed)
    x = np.empty((count, 2))
    z, h = np.array([2.0, 0.0]), dt / steps

    def rate(z):
        return np.array([z[1], -25.0 * np.sin(z[0]) - 0.1 * z[1]])

    for k in range(count):
        x[k] = z
        for _ in range(steps):
            push = np.array([0.0, np.sqrt(q * h) * rng.standard_normal()])
            first = rate(z)
            z = z + 0.5 * h * (first + rate(z + h * first + push)) + push
    return x, x[:, 0] + noise * rng.standard_normal(count)


def joint(motion, samples, a, b, r, q):
    """Mean and covariance of all states given all samples but the first, and the samples' log
    density, by the normal distribution of all of them together; a, b of x' = a x + b u.
    """
    count, n = len(samples.t), motion.n
    x0, deviation = start(motion, samples)
    variances = deviation**2
    variances[list(motion.first)] = r
    mean, cov = np.zeros((count, n)), np.zeros((count * n, count * n))
    mean[0], cov[:n, :n] = x0, np.diag(variances)
    for k in range(count - 1):
        dt = samples.dt[k]
        block = expm(np.block([[a, b], [np.zeros((b.shape[1], n + b.shape[1]))]]) * dt)
        f = block[:n, :n]
        mean[k + 1] = f @ mean[k] + block[:n, n:] @ samples.u[k]
        here, new = slice(k * n, k * n + n), slice(k * n + n, k * n + 2 * n)
        cov[new, : new.start] = f @ cov[here, : new.start]
        cov[: new.start, new] = cov[new, : new.start].T
        cov[new, new] = f @ cov[here, here] @ f.T + motion.noise(q, np.array([dt]))[0]
    rows, y, spread = [], [], []
    for k in range(1, count):
        for c, i in enumerate(motion.first):
            if np.isfinite(samples.y[k, c]):
                rows.append(k * n + i)
                y.append(samples.y[k, c])
                spread.append(r[c])
    s = cov[np.ix_(rows, rows)] + np.diag(spread)
    gain = np.linalg.solve(s, cov[rows]).T
    centre = mean.ravel()[rows]
    x = (mean.ravel() + gain @ (np.array(y) - centre)).reshape(count, n)
    p = cov - gain @ cov[rows]
    blocks = np.array([p[k * n : k * n + n, k * n : k * n + n] for k in range(count)])
    return x, blocks, multivariate_normal(centre, s).logpdf(y)


@pytest.mark.parametrize("model", [LINEAR, COUPLED])
def test_smoothed_states_are_the_joint_normal_distribution(model):
    rng = np.random.default_rng(3)
    count = 50
    t = np.cumsum(rng.uniform(0.01, 0.03, count))
    outputs = len(model.outputs)
    y = np.sin(3.0 * t)[:, None] * np.arange(1, outputs + 1) + rng.normal(0, 0.05, (count, outputs))
    y[20:26, 0] = np.nan
    u = rng.standard_normal((count, model.n_u))
    r, q = np.full(outputs, 0.05**2), np.zeros((model.n, model.n))
    motion = Motion(model)
    q[motion.last, motion.last] = 0.3 + 0.2 * np.arange(outputs)
    a = model.jacobian()
    slopes = motion.shift.copy()
    slopes[list(motion.last)] += a(**dict.fromkeys(a.needs, 0.0)).reshape(outputs, -1)
    b = np.array([[0.0], [2.0]]) if model.n_u else np.zeros((model.n, 0))
    log = (t, y if outputs > 1 else y[:, 0], u) if model.n_u else (t, y)
    found = smooth(model, log, R=r, Q=q)
    samples = Samples.of(log, outputs, model.n_u)
    x, p, likely = joint(motion, samples, slopes, b, r, q)
    assert np.allclose(found.x, x, rtol=0.0, atol=2e-6)
    assert np.allclose(found.covariance, p, rtol=1e-4, atol=1e-9)
    # the first samples are where the estimate starts; all others are in the likelihood
    assert found.log_likelihood == pytest.approx(likely, abs=1e-3)


def test_loss_takes_samples_that_are_there():
    """Of two outputs, the second missing always but once: that of the first, and that one."""
    rng = np.random.default_rng(0)
    y = rng.standard_normal((40, 2))
    y[1:, 1] = np.nan
    y[30, 1] = 0.3
    motion = Motion(COUPLED)
    samples = Samples(0.02 * np.arange(40), y, np.empty((40, 0)))
    r, q = np.array([0.5, 0.7]), motion.intensity([1.0, 2.0])
    known = forward(motion, samples, r, q)
    assert known.count.sum() == 40.0
    a = motion.rate(np.zeros(1), np.zeros((1, 4)), np.empty((1, 0)))[1][0]
    _, _, likely = joint(motion, samples, a, np.zeros((4, 0)), r, q)
    assert -0.5 * known.loss == pytest.approx(likely, abs=1e-4)


def test_flow_and_slopes_are_those_of_the_differential_equation():
    from scipy.integrate import solve_ivp

    motion = Motion(PENDULUM)
    x, dt = np.array([1.1, -2.0]), 0.01

    def moved(z):
        run = solve_ivp(
            lambda _, s: [s[1], -25.0 * np.sin(s[0]) - 0.1 * s[1]],
            (0.0, dt),
            z,
            rtol=1e-12,
            atol=1e-12,
        )
        return run.y[:, -1]

    ahead, f = motion.ahead(np.zeros(1), x[None], np.empty((1, 0)), np.array([dt]))
    assert np.allclose(ahead[0], moved(x), atol=1e-8)
    by_differences = [(moved(x + e) - moved(x - e)) / 2e-4 for e in 1e-4 * np.eye(2)]
    assert np.allclose(f[0], np.transpose(by_differences), atol=1e-6)


def test_noise_of_a_period_is_the_covariance_by_quadrature():
    motion, q, dt = Motion(None, 3), np.diag([0.1, 0.2, 0.7]), 0.3
    nodes = (np.arange(2000) + 0.5) * dt / 2000
    flows = [expm(motion.shift * s) for s in nodes]
    by_sum = sum(f @ q @ f.T for f in flows) * dt / 2000
    assert np.allclose(motion.noise(q, np.array([dt]))[0], by_sum, rtol=1e-6)


def test_noises_are_found_and_bands_cover():
    covered, found = [], []
    for seed in range(4):
        x, y = swing(3000, 0.01, 0.04, 3e-3, seed)
        run = smooth(PENDULUM, (0.01, y))
        found.append([run.R[0], run.Q[1, 1]])
        low, high = run.band(0.95)
        covered.append(np.mean((low <= x) & (x <= high), axis=0))
        assert run.whiteness > 1e-3 and run.normality > 1e-3
        assert np.sqrt(np.mean((run.x - x) ** 2, axis=0)) == pytest.approx(
            np.sqrt(np.mean(run.deviation**2, axis=0)), rel=0.12
        )
        filtered = np.sqrt(np.mean((run.filtered - x)[100:] ** 2, axis=0))
        assert np.all(np.sqrt(np.mean((run.x - x)[100:] ** 2, axis=0)) < 0.75 * filtered)
    assert np.mean(found, axis=0) == pytest.approx([9e-6, 0.04], rel=0.1)
    assert np.all(np.abs(np.mean(covered, axis=0) - 0.95) < 0.02)


def test_noise_that_lasts_is_not_taken_for_motion():
    """Noise that stays for eight samples: one step ahead, each of its jumps is a motion."""
    t = 0.001 * np.arange(12000)
    q, v = 0.2 * np.sin(1.5 * t), 0.3 * np.cos(1.5 * t)
    rng = np.random.default_rng(0)
    lasting = 1e-3 * np.repeat(rng.standard_normal(1500), 8)
    y = q + lasting + 1e-4 * rng.standard_normal(12000)
    run = smooth(None, (t, y), order=3)
    motion = Motion(None, 3)
    samples = Samples.of((t, y), 1, 0)
    r, one_step = likeliest(motion, samples, None, None)
    taken = smooth(None, (t, y), order=3, R=r, Q=one_step)
    error, of_one_step = (
        np.sqrt(np.mean((found.x[200:-200, 1] - v[200:-200]) ** 2)) for found in (run, taken)
    )
    assert any("is correlated" in text for text in run.remarks)
    assert error < 4e-3 and of_one_step > 20.0 * error
    assert error < 2.0 * np.sqrt(np.mean(run.deviation[:, 1] ** 2))


def test_a_model_that_errs_gives_way_to_samples_that_tell_more():
    """Fast samples with hardly any noise, and a spring of half the stiffness in the model."""
    t = 0.01 * np.arange(1500)
    rng = np.random.default_rng(0)
    q, v = np.sin(6.0 * t), 6.0 * np.cos(6.0 * t)
    y = q + 1e-5 * rng.standard_normal(1500)
    half = Model(states=["q", "v"], phi="-18*q + 40*cos(40*t)")
    free, bound = smooth(half, (t, y)), smooth(half, (t, y), structure="model")
    error, of_model = (rms((x - v)[20:-20]) for x in (free.state("v"), bound.state("v")))
    assert error < 0.5 * of_model
    assert free.states == ("q", "v") and "the chain is used" in free.remarks[-1]
    assert left_out(free) < left_out(bound)
    # left out in truth: the sample is missing
    hole = y.copy()
    hole[700] = np.nan
    without = smooth(half, (t, hole), R=bound.R, Q=bound.Q)
    share = bound.covariance[700, 0, 0] / bound.R[0]
    assert (y[700] - bound.x[700, 0]) / (1.0 - share) == pytest.approx(
        y[700] - without.x[700, 0], rel=1e-2, abs=1e-8
    )


def test_an_unknown_is_smoothed_in_its_unit():
    """A load that steps, 0.1 to 0.5 N m; the third derivative of y is another thing."""
    model = Model(
        states=["q", "w"],
        inputs=["T"],
        parameters={"J": 0.02, "b": 0.05},
        phi="(T - b*w - load)/J",
        unknown="load",
    )
    rng = np.random.default_rng(0)
    t = 2e-3 * np.arange(3000)
    u, load = np.sign(np.sin(3.0 * t)), np.where(t > 3.0, 0.5, 0.1)
    q, w, y = 0.0, 0.0, np.empty(3000)
    for k in range(3000):
        y[k] = q
        for _ in range(10):
            w += 2e-4 * (u[k] - 0.05 * w - load[k]) / 0.02
            q += 2e-4 * w
    run = smooth(model, (t, y + 1e-4 * rng.standard_normal(3000), u))
    assert run.states == ("q", "w", "load") and run.Q.shape == (3, 3)
    error, of_filter = (rms((x - load)[100:-100]) for x in (run.state("load"), run.filtered[:, 2]))
    assert error < 0.6 * of_filter and error < 0.02


def test_missing_samples_widen_the_band():
    x, y = swing(2000, 0.01, 0.04, 3e-3, 5)
    y[1000:1080] = np.nan
    run = smooth(PENDULUM, (0.01, y))
    wide, usual = run.deviation[1040], np.median(run.deviation, axis=0)
    assert np.all(wide > 2.0 * usual)
    assert np.all(np.abs(run.x[1000:1080] - x[1000:1080]) < 5.0 * run.deviation[1000:1080])
    assert run.missing.sum() == 80


def test_without_a_model_and_with_an_inputs_gain():
    t = 0.01 * np.arange(2000)
    rng = np.random.default_rng(2)
    y = np.sin(2.0 * t) + 1e-3 * rng.standard_normal(2000)
    free = smooth(None, (t, y), order=3)
    assert free.states == ("x1", "x2", "x3")
    v = 2.0 * np.cos(2.0 * t)
    error, of_filter = (
        np.sqrt(np.mean((x[100:-100, 1] - v[100:-100]) ** 2)) for x in (free.x, free.filtered)
    )
    assert error < 0.25 * of_filter and error < 2.0 * np.median(free.deviation[:, 1])
    u = -np.sin(2.0 * t)
    known = smooth(InputGain(4.0), (t, y, u))
    assert np.sqrt(np.mean((known.x[100:-100, 1] - v[100:-100]) ** 2)) < 2e-2


def test_a_log_a_table_and_a_figure(tmp_path):
    _, y = swing(600, 0.01, 0.04, 3e-3, 6)
    t = 0.01 * np.arange(600)
    log = Log(t, y, None, {"output": "q"}, "log.csv", np.isnan(y))
    run = smooth(PENDULUM, log, R=9e-6, Q=0.04)
    run.to_csv(tmp_path / "out.csv")
    with (tmp_path / "out.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["time", "y", "q", "v", "std q", "std v"]
    assert float(rows[300]["v"]) == pytest.approx(run.state("v")[300], rel=1e-9)
    pytest.importorskip("pandas")
    frame = run.to_dataframe()
    assert np.array_equal(frame["std v"], run.deviation[:, 1])
    pytest.importorskip("matplotlib")
    axes = run.plot().get_axes()
    assert [ax.get_title(loc="left") for ax in axes] == ["q", "v", "innovation"]
    assert len(axes[0].collections) == 1  # the band
    assert "sqrt(R) of q" in str(run)


@pytest.mark.parametrize(
    ("model", "log", "given", "told"),
    [
        (Lee(), (0.01, np.ones(99)), {}, "a Model of the form phase, chains, triangular"),
        (PENDULUM, (0.01, np.ones(9)), {}, "samples of output 1 that are not missing = 9"),
        (PENDULUM, (0.01, np.ones(99)), {}, "y is constant"),
        (PENDULUM, (0.01, np.sin(np.arange(99))), {"R": 0.0}, "R = 0.0"),
        (PENDULUM, (0.01, np.sin(np.arange(99))), {"Q": [1.0, 2.0, 3.0]}, "shape of Q"),
        (PENDULUM, (0.01, np.sin(np.arange(99))), {"Q": -1.0}, "least eigenvalue of Q"),
        (PENDULUM, (0.01, np.sin(np.arange(99))), {"order": 2}, "order = 2"),
        (PENDULUM, (0.01, np.ones((99, 2))), {}, "y of shape"),
        (None, (np.r_[0.0, 0.0, np.arange(97)], np.ones(99)), {}, "time must increase"),
    ],
)
def test_refusals(model, log, given, told):
    with pytest.raises(HgoError, match=told):
        smooth(model, log, **given)


# --- real records, where they are at hand: the error of the velocity, and the least one that any
# --- filter of `common.py` reaches there with its gain chosen by the reference

RECORDS = Path(__file__).parents[3] / "shared" / "records"


def table(name):
    """The columns of a record."""
    if not (RECORDS / name).exists():
        pytest.skip("recorded data not present")
    return np.genfromtxt(RECORDS / name, delimiter=",", skip_header=1).T


def zero_phase(t, q, cutoff, derivatives):
    """Derivatives of q through a low-pass both ways."""
    sos = signal.butter(4, cutoff, fs=1.0 / np.median(np.diff(t)), output="sos")
    out = signal.sosfiltfilt(sos, q)
    for _ in range(derivatives):
        out = signal.sosfiltfilt(sos, np.gradient(out, t))
    return out


def rms(error):
    return np.sqrt(np.mean(error**2, axis=0))


@pytest.mark.parametrize(
    ("step", "quantum", "noise", "best"),
    [
        (1, 0.0, 0.0, 0.00341),
        (10, 0.0, 0.0, 0.00477),
        (10, 2.0 * np.pi / 2048, 0.0, 0.00825),
        (5, 0.0, 3e-3, 0.0105),
    ],
)
def test_free_pendulum(step, quantum, noise, best):
    file = RECORDS / "single_pendulum.mat"
    if not file.exists():
        pytest.skip("recorded data not present")
    whole = loadmat(file, squeeze_me=True)
    q, _ = np.hstack([*whole["Y_id"], *whole["Y_vad"]])
    t = 1e-3 * np.arange(len(q))
    smooth_q, v, a = (zero_phase(t, q, 40.0, k) for k in range(3))
    columns = np.c_[np.sin(smooth_q), v, np.tanh(v / 0.05)]
    k, *_ = np.linalg.lstsq(columns[500:12000], a[500:12000], rcond=None)
    parameters = dict(zip(("k1", "k2", "k3"), k.tolist(), strict=True))
    phi = "k1*sin(q) + k2*v + k3*tanh(v/0.05)"
    model = Model(states=["q", "v"], parameters=parameters, phi=phi)
    y = q[12000::step].copy()
    y += noise * np.random.default_rng(0).standard_normal(y.size)
    y = np.round(y / quantum) * quantum if quantum else y
    run = smooth(model, (step * 1e-3, y))
    late = run.t >= 1.0
    assert rms(run.state("v")[late] - v[12000::step][late]) < 0.95 * best


def test_pendulum_moved_by_hand():
    t, q, _, tau = table("pendulum_identify.csv")
    smooth_q, v, a = (zero_phase(t, q, 10.0, k) for k in range(3))
    u = zero_phase(t, tau, 10.0, 0)
    columns = np.c_[u, np.sin(smooth_q), v, np.tanh(v / 0.1), np.ones(len(t))]
    k, *_ = np.linalg.lstsq(columns[100:2400], a[100:2400], rcond=None)
    phi = "k0*u + k1*sin(q) + k2*v + k3*tanh(v/0.1) + k4"
    parameters = {f"k{i}": value for i, value in enumerate(k.tolist())}
    model = Model(states=["q", "v"], inputs=["u"], parameters=parameters, phi=phi)
    t, q, v, tau = table("pendulum_by_hand.csv")
    run = smooth(model, (t, q, tau))
    late = t - t[0] >= 1.0
    assert rms(run.state("v")[late] - zero_phase(t, v, 30.0, 0)[late]) < 0.8 * 0.0354


@pytest.mark.parametrize(
    ("mean", "noise", "best"), [(False, 0.0, 1.223), (True, 0.0, 0.4165), (True, 5e-3, 1.434)]
)
def test_duffing_circuit(mean, noise, best):
    u, y, *_ = table("silverbox.csv")
    u, period = u - u.mean(), 2**14 / 1e7
    f = np.fft.rfftfreq(len(y), period)
    jw, low = 2j * np.pi * f, f < 230.0

    def derivative(values, order):
        return np.fft.irfft(np.fft.rfft(values) * low * jw**order, len(values))

    ys, v, a, us = derivative(y, 0), derivative(y, 1), derivative(y, 2), derivative(u, 0)
    some, part = slice(1000, 39000), slice(60000, 80000)
    k, *_ = np.linalg.lstsq(np.c_[us, v, ys, ys**3][some], a[some], rcond=None)
    parameters = {f"k{i}": value for i, value in enumerate(k.tolist())}
    model = Model(
        states=["q", "v"],
        inputs=["u"],
        parameters=parameters,
        phi="k0*u + k1*v + k2*q + k3*q**3",
    )
    u = np.append(0.5 * (u[1:] + u[:-1]), u[-1]) if mean else u
    samples = y[part] + noise * np.random.default_rng(0).standard_normal(20000)
    run = smooth(model, (period, samples, u[part]))
    late = run.t >= 1.0
    assert rms((run.state("v") - v[part])[late]) < 0.95 * best


@pytest.mark.parametrize(("noise", "best"), [(0.0, (0.0374, 0.0387)), (1.0, (0.3516, 0.4379))])
def test_car(noise, best):
    d = table("gnss_drive.csv").T
    d = d[int(0.4 * len(d)) :]
    speed = "sqrt(ve**2 + vn**2 + 0.25)"
    model = Model(
        states=["e", "ve", "n", "vn"],
        inputs=["a", "w"],
        orders=[2, 2],
        phi=[f"a*ve/{speed} - w*vn", f"a*vn/{speed} + w*ve"],
    )
    y = d[:, 1:3] + noise * np.random.default_rng(0).standard_normal((len(d), 2))
    run = smooth(model, (d[:, 0] - d[0, 0], y, d[:, 5:7]))
    late = run.t >= 20.0
    assert np.all(rms(run.x[late][:, [1, 3]] - d[late, 3:5]) < 0.8 * np.array(best))
