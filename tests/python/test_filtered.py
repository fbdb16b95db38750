"""The observer behind a filter of its innovation: figures, other form, what is built on it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from hgo_rs import (
    AdaptiveGain,
    HgoError,
    HighGainObserver,
    InputGain,
    Model,
    MultiOutputObserver,
    StandardObserver,
    load,
    reference,
)
from hgo_rs.design import continuous, model_gain
from hgo_rs.observers import METHODS, TIMINGS

PAPERS = {"method": "euler", "timing": "predictor"}
TRIPLE = [-1.0, -1.0, -1.0]
T = 1e-3


def companion_form(y, n, m, poles, ell):
    """x_hat before each sample, by forward Euler of w' = w_(i+1) - c_i ell^i w_1 and its chain."""
    c = np.poly(poles)[1:] * ell ** np.arange(1.0, n + m + 1)
    w, x_hat = np.zeros(n + m), np.empty((len(y), n))
    for k, sample in enumerate(y):
        x_hat[k] = w[m:]
        rate = np.append(w[1:], 0.0) - c * w[0]
        rate[m - 1] = w[m] - sample - c[m - 1] * w[0]
        w = w + T * rate
    return x_hat


def test_figures_of_second_order_behind_one_filter():
    law = HighGainObserver("filtered", 2, 50.0, poles=TRIPLE, **PAPERS)
    assert law.spec["c"] == [3.0] and law.spec["k"] == pytest.approx([1.0, 1.0 / 3.0], rel=1e-15)
    y = np.sin(3.0 * T * np.arange(1501))
    x_hat = law.run(T, y).x_hat
    assert x_hat[1500] == pytest.approx([-0.987552652672, -1.136641272811], abs=2e-12)
    assert np.max(np.abs(x_hat - companion_form(y, 2, 1, TRIPLE, 50.0))) < 3e-14
    density = np.sqrt(1e-9 * law.noise_gain())
    assert density == pytest.approx([1.936491673e-4, 2.795084972e-3], rel=1e-9)
    linear = continuous(law.spec)
    z = np.linalg.solve(2000j / 50.0 * np.eye(3) - linear.closed, linear.g)[:2] * linear.scale[:2]
    assert np.abs(z) == pytest.approx([1.873308602e-3, 3.122072600e-2], rel=1e-9)


@pytest.mark.parametrize(("n", "m"), itertools.product((1, 2, 3, 6), (1, 2, 3)))
def test_it_is_the_companion_form(n, m):
    poles = -1.0 - np.arange(n + m) / (n + m)
    law = HighGainObserver("filtered", n, 20.0, filters=m, poles=poles, **PAPERS)
    assert continuous(law.spec).power.tolist() == [*range(n), *[0] * m]
    found = np.sort(np.linalg.eigvals(continuous(law.spec).closed).real)
    assert found == pytest.approx(np.sort(poles), abs=1e-2)
    y = np.sin(3.0 * T * np.arange(800))
    ours, theirs = law.run(T, y).x_hat, companion_form(y, n, m, poles, 20.0)
    assert np.max(np.abs(ours - theirs) / np.max(np.abs(theirs), axis=0)) < 1e-11


def test_a_ramp_is_followed_without_error():
    """The error is filtered, not the measurement, which would lag by 1/(c_1 ell)."""
    t = T * np.arange(4000)
    result = HighGainObserver("filtered", 2, 50.0, poles=TRIPLE, **PAPERS).run(T, t)
    assert np.abs(result.x_hat[-1] - [t[-1], 1.0]) == pytest.approx([0.0, 0.0], abs=1e-9)
    assert result.auxiliary[-1] == pytest.approx([0.0], abs=1e-9)


@pytest.mark.parametrize("timing", TIMINGS)
@pytest.mark.parametrize("method", METHODS[:5])
def test_rust_is_the_twin(method, timing):
    y = np.sin(2.0 * T * np.arange(300))
    y[100:130] = np.nan
    u = np.cos(np.arange(300.0))
    for n, m in ((1, 1), (2, 1), (2, 3), (5, 2)):
        for gain in (15.0, AdaptiveGain(10.0, 0.0025, 0.183)):
            law = HighGainObserver(
                "filtered", n, gain, filters=m, model=InputGain(2.0), method=method, timing=timing
            )
            start = law.initial_memory()
            start[: n + m] = 0.1
            result = law.run(T, y, u, memory0=start)
            twin = reference.Observer(law.spec)
            theirs = twin.run(T * np.arange(300), y, u, start)["memory"]
            np.testing.assert_allclose(result.memory, theirs, rtol=1e-10, atol=1e-10)


def test_step_limits_are_those_of_its_matrix():
    """A stable and an unstable step on either side of each limit, from the twin's own steps."""
    for method, timing in itertools.product(METHODS[:5], TIMINGS):
        law = HighGainObserver("filtered", 3, 1.0, filters=2, method=method, timing=timing)
        limit = law.step_limit().dt
        twin = reference.Observer(law.spec)

        def radius(dt, twin=twin, timing=timing):
            columns = []
            for unit in np.eye(5):
                if timing == "predictor":
                    columns.append(twin.step(unit, 0.0, None, 0.0, dt)[0])
                else:
                    used, _ = twin.correct(np.append(unit, dt), 0.0, 0.0)
                    columns.append(twin.predict(used, None, 0.0, dt)[0][:5])
            return np.max(np.abs(np.linalg.eigvals(np.array(columns).T)))

        assert radius(0.999 * limit) < 1.0 < radius(1.001 * limit), (method, timing)


def test_responses_are_measured_ones():
    """By Monte Carlo: what noise and what a model that lacks white noise in x_n' cost."""
    law = HighGainObserver("filtered", 2, 30.0, **PAPERS)
    rng = np.random.default_rng(3)
    noise = rng.standard_normal(400_000)
    x_hat = law.run(T, noise).x_hat[1000:]
    assert np.var(x_hat, axis=0) == pytest.approx(law.noise_gain(T), rel=0.05)
    drift, x = rng.standard_normal(400_000) * np.sqrt(T), np.zeros((400_000, 2))
    for k in range(1, len(x)):
        x[k] = x[k - 1, 0] + T * x[k - 1, 1] + 0.5 * T * drift[k], x[k - 1, 1] + drift[k]
    error = (law.run(T, x[:, 0]).x_hat - x)[1000:]
    assert np.var(error, axis=0) == pytest.approx(model_gain(law.spec, T), rel=0.1)
    free = StandardObserver(2, 30.0, **PAPERS)
    assert np.all(law.noise_gain(T) < free.noise_gain(T))


def test_it_goes_wherever_laws_go(tmp_path):
    law = HighGainObserver("filtered", 2, 40.0, filters=2, method="rk4")
    law.save(tmp_path / "observer.toml")
    again = load(tmp_path / "observer.toml").observer()
    assert type(again) is HighGainObserver and again.spec == law.spec
    y = np.sin(T * np.arange(200))
    assert np.array_equal(again.run(T, y).x_hat, law.run(T, y).x_hat)
    files = law.export(to="c", out=tmp_path / "filtered.c", dt=T)
    assert any("observer behind a filter" in path.read_text() for path in files)
    model = Model(states=["a", "b", "c"], orders=[2, 1], phi=["-a + c", "-c"])
    both = MultiOutputObserver(
        [law, HighGainObserver("filtered", 1, 40.0, method="rk4")], model=model
    )
    twin = reference.Observer(both.spec)
    rows = np.column_stack([y, 0.1 * y])
    theirs = twin.run(T * np.arange(200), rows, None, both.initial_memory())["memory"]
    np.testing.assert_allclose(both.run(T, rows).memory, theirs, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"method": "zoh"}, "defined for the laws standard, low-power, peaking-free"),
        ({"filters": 4}, "filters = 4: must be an integer >= 1 and <= 3"),
        ({"n": 7}, "n = 7: must be an integer >= 1 and <= 6"),
        ({"poles": [-1.0]}, "poles: 1 given; a filtered observer of order 2 needs 3"),
        ({"c": [3.0]}, "c and k: must be given together and without poles"),
        ({"c": [1.0], "k": [1.0, 9.0]}, "left half plane"),
        ({"alpha": [1.0]}, "an entry of the observer behind a filter"),
        ({"saturation": 1.0}, "has no saturation"),
    ],
)
def test_what_cannot_be_is_refused(change, match):
    with pytest.raises(HgoError, match=match):
        HighGainObserver(**{"kind": "filtered", "n": 2, "gain": 40.0, **change})
