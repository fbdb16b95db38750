"""Observers and baselines on one record: figures of the baselines, and errors that are right."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import savgol_coeffs

from hgo_rs import HgoError, Model, StandardObserver, compare, smooth, tune
from hgo_rs.smoothing import BASELINES
from hgo_rs.smoothing.baselines import alpha_beta_gamma, difference, of_channel, polynomial
from hgo_rs.smoothing.samples import Samples

PENDULUM = Model(states=["q", "v"], phi="-25*sin(q) - 0.1*v")


@pytest.fixture(scope="module")
def record():
    """States and samples of a pendulum pushed by white noise."""
    rng = np.random.default_rng(4)
    q, v, h, x = 2.0, 0.0, 5e-4, []
    for k in range(40_000):
        if k % 20 == 0:
            x.append((q, v))
        v += h * (-25.0 * np.sin(q) - 0.1 * v) + np.sqrt(0.04 * h) * rng.standard_normal()
        q += h * v
    x = np.array(x)
    return x, x[:, 0] + 3e-3 * rng.standard_normal(2000)


@pytest.mark.parametrize(
    ("window", "degree", "gain"),
    [(11, 1, 9.534625892), (11, 2, 35.445877848), (21, 3, 32.737257829)],
)
def test_weights_of_the_causal_polynomial(window, degree, gain):
    """Noise gains of the slope at T = 0.01, and SciPy's own weights."""
    weights = polynomial(window, degree)
    assert np.linalg.norm(weights[1]) / 0.01 == pytest.approx(gain, rel=1e-9)
    for derivative in (0, 1):
        scipy = savgol_coeffs(window, degree, derivative, pos=window - 1)
        assert np.allclose(weights[derivative], scipy, atol=1e-10)
    if (window, degree) == (11, 2):
        newest = weights[1, :3] / 0.01
        assert newest == pytest.approx([22.027972028, 10.629370629, 1.561771562], rel=1e-9)


def test_baselines_follow_a_parabola():
    """Without noise: the fading memory of order 3 is exact, a difference lags by half a step."""
    t = 0.01 * np.arange(400)
    samples = Samples.of((t, 3.0 + 2.0 * t - t**2), 1, 0)
    fading = alpha_beta_gamma(samples).x
    assert fading[-1] == pytest.approx([3.0 + 2.0 * t[-1] - t[-1] ** 2, 2.0 - 2.0 * t[-1], -2.0])
    lag = difference(samples).x[200:, 1] - (2.0 - 2.0 * t[200:])
    assert np.all(lag > 0.0) and np.all(lag < 0.1)


def test_judged_by_the_smoother_as_by_the_truth(record):
    x, y = record
    some = {
        "low": StandardObserver(2, 3.0, model=PENDULUM),
        "right": StandardObserver(2, 12.0, model=PENDULUM),
        "high": StandardObserver(2, 60.0, model=PENDULUM),
        "no model": StandardObserver(3, 30.0),
        "tuned": tune(PENDULUM, (0.01, y)),
    }
    blind = compare((0.01, y), some)
    seen = compare((0.01, y), some, truth=x)
    assert blind.methods == seen.methods == (*some, *BASELINES)
    assert blind.judged_by == "the smoothed state" and seen.judged_by == "the truth given"
    assert np.allclose(blind.error, seen.error, rtol=0.08)
    run = some["right"].run(0.01, y, x_hat0=[y[0], 0.0])
    late = blind.t >= blind.skip
    own = np.sqrt(np.mean((run.x_hat - x)[late] ** 2, axis=0))
    assert seen.error[1] == pytest.approx(own, rel=1e-12)
    assert seen.best("v") in ("tuned", "extended Kalman filter")
    rules = dict(zip(blind.methods, blind.rules, strict=True))
    assert rules["tuned"].startswith("hgo.tune") and rules["low"] == "as given"
    # a model beats what has none, and filters the bare difference
    v = dict(zip(seen.methods, seen.error[:, 1], strict=True))
    assert v["tuned"] < 0.6 * v["Savitzky-Golay, causal"] < 0.6 * v["filtered difference"]


def test_a_truth_of_some_states_and_samples(record):
    x, y = record
    v = x[:, 1].copy()
    v[::2] = np.nan
    own = np.column_stack([y, x[:, 1] + 0.25])
    found = compare((0.01, y), {"mine": own}, model=PENDULUM, truth={"v": v}, baselines=())
    assert found.states == ("v",) and found.methods == ("mine",)
    assert found.error[0, 0] == pytest.approx(0.25, rel=1e-12)
    smoothed = smooth(PENDULUM, (0.01, y))
    again = compare((0.01, y), {"mine": smoothed.x}, model=PENDULUM, truth=smoothed, baselines=())
    assert again.error[0] == pytest.approx(np.sqrt(np.mean(smoothed.deviation**2, axis=0)))


def test_several_outputs(record):
    """Two pendulums that do not touch: of each the errors of one alone."""
    x, y = record
    pair = Model(
        states=["a", "b", "c", "d"],
        orders=[2, 2],
        phi=["-25*sin(a) - 0.1*b", "-25*sin(c) - 0.1*d"],
    )
    t, both = 0.01 * np.arange(2000), np.column_stack([y, y[::-1]])
    names = ("Savitzky-Golay, causal", "alpha-beta-gamma")
    found = compare((t, both), model=pair, truth={"b": x[:, 1]}, baselines=names)
    alone = compare((t, y), model=PENDULUM, truth={"v": x[:, 1]}, baselines=names)
    assert np.array_equal(found.error[:, 0], alone.error[:, 0])
    assert of_channel(Samples.of((t, both), 2, 0), 1).y[0, 0] == y[-1]


def test_uneven_steps_leave_some_out_and_say_so(record):
    _, y = record
    t = 0.01 * np.arange(2000)
    t[::2] += 0.002
    found = compare((t, y), baselines=("Savitzky-Golay, causal", "alpha-beta-gamma"))
    assert found.methods == ("alpha-beta-gamma",)
    assert "Savitzky-Golay" in found.remarks[0] and "resample" in str(found)


def test_table_and_figure(record):
    _, y = record
    found = compare((0.01, y), {"mine": StandardObserver(2, 12.0, model=PENDULUM)})
    lines = str(found).splitlines()
    assert lines[1].split()[:3] == ["method", "q", "v"] and lines[2].startswith("mine")
    pytest.importorskip("pandas")
    frame = found.to_dataframe()
    assert frame.loc["mine", "v"] == found.error[0, 1]
    pytest.importorskip("matplotlib")
    axes = found.plot().get_axes()
    assert [ax.get_title(loc="left") for ax in axes] == ["q", "v"]
    assert axes[1].patches[0].get_width() == found.error[0, 1]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"baselines": ["Kalman"]}, "baselines = 'Kalman'"),
        ({"truth": np.zeros((3, 2))}, r"truth = \(3, 2\)"),
        ({"truth": {"w": np.zeros(200)}}, "truth = 'w'"),
        ({"truth": {"q": np.zeros(3)}}, "truth"),
        ({"observers": {"own": np.zeros((3, 2))}}, r"observers\['own'\]"),
        ({"skip": 5.0}, "skip = 5.0"),
        ({"baselines": []}, "observers = None"),
    ],
)
def test_refusals(given, told):
    y = np.sin(0.1 * np.arange(200)) + 1e-3 * np.random.default_rng(0).standard_normal(200)
    with pytest.raises(HgoError, match=told):
        compare((0.01, y), model=PENDULUM, **given)
