"""`tune` with several outputs: a simulated pair of coupled chains, whose states are known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

import hgo_rs as hgo
from hgo_rs import MultiOutputObserver, StandardObserver, tune
from hgo_rs.tuning.chains import chain_model

DT = 5e-3
RECORD = Path(__file__).parents[3] / "shared" / "records" / "gnss_drive.csv"
MODEL = hgo.Model(
    states=["a", "va", "b", "vb"],
    inputs=["u"],
    orders=[2, 2],
    parameters={"k": 30.0, "c": 20.0},
    phi=["-k*sin(a) + c*(b - a) - 0.4*va + u", "-k*sin(b) + c*(a - b) - 0.4*vb - va*vb"],
)


def coupled(noise: tuple[float, float], seed: int, count: int = 3000) -> tuple[Any, ...]:
    """Two coupled pendulums pushed by white noise of densities 1 and 4: t, y, u, states."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) * DT
    u = 6.0 * np.sign(np.sin(3.0 * t))
    kicks = rng.standard_normal((count, 20, 2)) * np.sqrt(DT / 20) * [1.0, 2.0]
    x, path, h = np.array([0.2, 0.0, -0.1, 0.0]), np.empty((count, 4)), DT / 20
    for k in range(count):
        path[k] = x
        for i in range(20):
            a, va, b, vb = x
            f = -30.0 * np.sin(a) + 20.0 * (b - a) - 0.4 * va + u[k]
            g = -30.0 * np.sin(b) + 20.0 * (a - b) - 0.4 * vb - va * vb
            x = x + h * np.array([va, f, vb, g])
            x[[1, 3]] += kicks[k, i]
    return t, path[:, [0, 2]] + rng.standard_normal((count, 2)) * noise, u, path


def build(ells: Any) -> MultiOutputObserver:
    chains = [StandardObserver(2, float(ell), k=[2.0**0.5, 1.0]) for ell in ells]
    return MultiOutputObserver(chains, model=MODEL)


def errors(observer: Any, t: Any, y: Any, u: Any, path: Any) -> Any:
    try:
        x_hat = observer.run(t, y, u, x_hat0=[y[0, 0], 0.0, y[0, 1], 0.0]).x_hat
    except hgo.HgoError:
        return np.full(4, np.inf)
    return np.sqrt(np.mean((x_hat - path)[300:] ** 2, axis=0))


def test_two_outputs_are_near_the_best_gains_together() -> None:
    record = coupled((1e-2, 2e-3), seed=1)
    t, y, u, _ = record
    result = tune(MODEL, (t, y, u))
    found = errors(result.observer, *record)

    def cost(log_ells: Any) -> float:
        return float(np.sum(np.log(errors(build(np.exp(log_ells)), *record)[[1, 3]])))

    best = minimize(cost, np.log([15.0, 30.0]), method="Nelder-Mead", options={"maxfev": 60})
    assert np.sum(np.log(found[[1, 3]])) < best.fun + 2.0 * np.log(1.05)
    np.testing.assert_allclose(result.errors, found, rtol=0.25)
    assert np.all(found < result.bounds)
    np.testing.assert_allclose(result.noise, [1e-2, 2e-3], rtol=0.4)
    assert list(result.state) == [2, 2] and len(result.ell) == 2
    told = result.report()
    for text in ("va ", "Butterworth", "high-gain EKF", "the model", str(result)[:20]):
        assert text in told, text
    again = result.run((t, y, u)).x_hat
    np.testing.assert_array_equal(
        again, result.observer.run(t, y, u, x_hat0=[y[0, 0], 0.0, y[0, 1], 0.0]).x_hat
    )
    assert "whose gains follow the model's Jacobian, has" in told
    pytest.importorskip("matplotlib")
    (ax,) = result.plot().axes
    assert [bar.get_width() for bar in ax.patches] == [cost for _, _, cost in result.tried]


def test_an_own_structure_of_several_outputs() -> None:
    record = coupled((5e-3, 5e-3), seed=2)
    t, y, u, _ = record
    own = tune(build, (t, y, u), state=[2, 1])
    assert list(own.state) == [2, 1] and own.structure == ""
    assert errors(own.observer, *record)[2] < 5e-3  # less than the noise
    period = tune({"one": build}, (DT, y, u), state=2)
    times = tune({"one": build}, (t, y, u), state=2)
    np.testing.assert_allclose(period.ell, times.ell, rtol=1e-3)


def test_one_chain_of_a_model() -> None:
    alone = chain_model(MODEL, 1)
    assert alone.states == ("b", "vb") and alone.inputs == ("u", "a", "va")
    values = {"a": 0.3, "va": -0.2, "b": 0.7, "vb": 1.1, "u": 0.5}
    whole = MODEL.jacobian()(**values)
    np.testing.assert_allclose(alone.jacobian()(**values)[0], whole[1, 2:])


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda t, y, u: tune(MODEL, (t, y, u), cutoff=3.0), "cutoff = 3.0: must be left out"),
        (lambda t, y, u: tune(None, (t, y)), "build = None: must be a model of chains"),
        (lambda t, y, u: tune(MODEL, (t, np.c_[y, y], u)), "outputs of the log = 4: must be 2"),
        (lambda t, y, u: tune(MODEL, (t, y, u), state=[1]), "state = .1.: must be 2 integers"),
        (lambda t, y, u: tune(MODEL, (t, y, u), state=3), "state.0. = 3"),
        (lambda t, y, u: tune(lambda g: 3, (t, y, u)), "build = 3: must be one"),  # type: ignore[arg-type, return-value]
        (lambda t, y, u: tune(hgo.Lee(), (t, y)), "build = Lee.*: must be callable"),
        (lambda t, y, u: tune(chain_model(MODEL, 0), (t, y, u)), "a Model of chains; write orders"),
    ],
)
def test_refusals(call: Any, match: str) -> None:
    t, y, u, _ = coupled((1e-2, 1e-2), seed=3, count=400)
    with pytest.raises(hgo.HgoError, match=match):
        call(t, y, u)


@pytest.mark.skipif(not RECORD.exists(), reason="recorded data not present")
@pytest.mark.filterwarnings("ignore::hgo_rs.TuningWarning")
def test_a_car_by_its_fixes() -> None:
    """Doppler velocity, another observable, judges; the extended Kalman filter on the same model,
    its ratios by maximum likelihood, errs 0.0396 and 0.0432 m/s; with 1 m 0.3516 and 0.4404.
    """
    data = np.genfromtxt(RECORD, delimiter=",", skip_header=1)
    data = data[int(0.4 * len(data)) :]
    t, y, doppler, u = data[:, 0] - data[0, 0], data[:, 1:3], data[:, 3:5], data[:, 5:7]
    speed = "sqrt(ve**2 + vn**2 + 0.25)"
    phi = [f"a*ve/{speed} - w*vn", f"a*vn/{speed} + w*ve"]
    model = hgo.Model(states=["e", "ve", "n", "vn"], inputs=["a", "w"], orders=[2, 2], phi=phi)
    coarse = y + np.random.default_rng(0).standard_normal(y.shape)  # fixes to 1 m
    for fixes, bounds in ((y, (0.0396, 0.0432)), (coarse, (1.02 * 0.3516, 1.02 * 0.4404))):
        x_hat = tune(model, (t, fixes, u)).run((t, fixes, u)).x_hat
        rms = np.sqrt(np.mean((x_hat[:, [1, 3]] - doppler)[t >= 20.0] ** 2, axis=0))
        assert rms[0] < bounds[0] and rms[1] < bounds[1]
