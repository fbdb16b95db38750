"""Parameters of a model from a record: of simulated drives, and of a real pendulum."""

from __future__ import annotations

import numpy as np
import pytest
from test_smoothing import RECORDS, zero_phase

from hgo_rs import HgoError, Model, fit

PENDULUM = Model(states=["q", "v"], parameters={"g": 25.0, "d": 0.1}, phi="-g*sin(q) - d*v")


def drive(seed, count=4000, dt=2e-3):
    """Angle by an encoder of 2048 lines, and torque, of a drive with friction."""
    rng = np.random.default_rng(seed)
    t = dt * np.arange(count)
    u = 1.5 * np.sign(np.sin(2.0 * np.pi * 0.7 * t)) + np.sin(2.0 * np.pi * 2.3 * t)
    q, v, h = 0.0, 0.0, dt / 20
    y = np.empty(count)
    kicks = np.sqrt(0.01 * h) * rng.standard_normal((count, 20))
    for k in range(count):
        y[k] = q
        for kick in kicks[k]:
            a = (u[k] - 0.05 * v - 0.3 * np.tanh(v / 0.2)) / 0.02
            q, v = q + h * v, v + h * a + kick
    step = 2.0 * np.pi / 8192
    return t, step * np.round(y / step), u


def swing(seed, count=1500, dt=0.01):
    """A pendulum pushed by noise of intensity 0.04, by samples with noise of 3e-3."""
    rng = np.random.default_rng(seed)
    q, v, h, y = 2.0, 0.0, dt / 20, np.empty(count)
    for k in range(count):
        y[k] = q
        for kick in np.sqrt(0.04 * h) * rng.standard_normal(20):
            v += h * (-25.0 * np.sin(q) - 0.1 * v) + kick
            q += h * v
    return y + 3e-3 * rng.standard_normal(count)


def test_a_drives_inertia_and_friction():
    model = Model(
        states=["q", "v"],
        inputs=["u"],
        parameters={"J": 0.03, "b": 0.03, "Tc": 0.2, "v0": 0.2},
        phi="(u - b*v - Tc*tanh(v/v0))/J",
    )
    found = fit(model, drive(1), ["J", "b", "Tc"])
    true = {"J": 0.02, "b": 0.05, "Tc": 0.3}
    assert found.parameters == pytest.approx(true, rel=0.02)
    assert all(abs(found.parameters[k] - true[k]) < 3.0 * found.errors[k] for k in true)
    assert found.model.parameters == {**found.parameters, "v0": 0.2}
    assert found.start == {"J": 0.03, "b": 0.03, "Tc": 0.2}
    assert found.log_likelihood > found.before
    lines = str(found).splitlines()
    assert lines[1].split()[0] == "J" and "by the fit" in lines[4]


def test_standard_errors_are_those_of_many_records():
    """Over 12 records the errors are as large as told, and R and Q are found beside them."""
    off, noise = [], []
    for seed in range(12):
        found = fit(PENDULUM.with_parameters(g=24.5, d=0.2), (0.01, swing(seed)))
        true = np.array([25.0, 0.1])
        spread = np.array([found.errors["g"], found.errors["d"]])
        off.append((np.array([found.parameters["g"], found.parameters["d"]]) - true) / spread)
        noise.append([found.R[0], found.Q[1, 1]])
    # of 24 numbers of variance 1 (less where the larger of two standard errors is taken)
    assert 0.3 < np.mean(np.square(off)) < 1.9
    assert np.max(np.abs(off)) < 3.5
    assert np.mean(noise, axis=0) == pytest.approx([9e-6, 0.04], rel=0.15)


def test_given_noises_are_kept():
    found = fit(PENDULUM, (0.01, swing(3)), ["g"], R=9e-6, Q=0.04)
    assert found.R[0] == 9e-6 and found.Q[1, 1] == 0.04
    assert list(found.parameters) == ["g"] and abs(found.parameters["g"] - 25.0) < 0.3
    pytest.importorskip("pandas")
    assert found.to_dataframe().loc["g", "error"] == found.errors["g"]


def test_what_the_record_does_not_tell_of_is_named():
    """Two parameters of which the sum alone acts."""
    model = Model(
        states=["q", "v"], parameters={"a": 12.0, "b": 13.0}, phi="-(a + b)*sin(q) - 0.1*v"
    )
    with pytest.raises(HgoError, match="determined by the record"):
        fit(model, (0.01, swing(0, 600)))


@pytest.mark.parametrize(
    ("model", "names", "told"),
    [
        (PENDULUM, ["w"], "parameters = 'w'"),
        (PENDULUM, [], "one name or more"),
        (Model(states=["q", "v"], phi="-q"), None, "a Model with parameters"),
    ],
)
def test_refusals(model, names, told):
    with pytest.raises(HgoError, match=told):
        fit(model, (0.01, swing(0, 200)), names)


def test_a_real_pendulum():
    """Beside least squares on derivatives without phase, of the same 11.5 s."""
    from scipy.io import loadmat

    file = RECORDS / "single_pendulum.mat"
    if not file.exists():
        pytest.skip("recorded data not present")
    whole = loadmat(file, squeeze_me=True)
    q, _ = np.hstack([*whole["Y_id"], *whole["Y_vad"]])
    t = 1e-3 * np.arange(len(q))
    smooth_q, v, a = (zero_phase(t, q, 40.0, k) for k in range(3))
    some = slice(500, 12000)
    columns = np.c_[np.sin(smooth_q), v, np.tanh(v / 0.05)][some]
    identified, *_ = np.linalg.lstsq(columns, a[some], rcond=None)
    start = dict(zip(("k1", "k2", "k3"), (1.1 * identified).tolist(), strict=True))
    phi = "k1*sin(q) + k2*v + k3*tanh(v/0.05)"
    found = fit(Model(states=["q", "v"], parameters=start, phi=phi), (1e-3, q[some]))
    for name, value in zip(start, identified.tolist(), strict=True):
        assert abs(found.parameters[name] - value) < 2.0 * found.errors[name]
