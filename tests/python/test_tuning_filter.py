"""`tune` where the gain must move with the model's slopes: the high-gain EKF of one output."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs import HighGainEKF, StandardObserver, tune
from hgo_rs.observers.turns import Jumps
from hgo_rs.tuning.reference import stretches, surely_less

DT, NOISE, LACK = 0.02, 0.1, 0.5
OSCILLATOR = hgo.Model(states=["q", "v"], phi="6*(1 - q**2)*v - 4*q")


def van_der_pol(count: int = 1500) -> tuple[Any, Any]:
    """y and v of an oscillator whose slope in v is 6 at rest and far below 0 outside."""
    rng = np.random.default_rng(1)
    h, q, v = DT / 20, 1.5, 0.0
    kicks = LACK * np.sqrt(h) * rng.standard_normal((count, 20))
    path = np.empty((count, 2))
    for k in range(count):
        path[k] = q, v
        for i in range(20):
            q, v = q + h * v, v + h * (6.0 * (1.0 - q * q) * v - 4.0 * q) + kicks[k, i]
    return path[:, 0] + NOISE * rng.standard_normal(count), path[:, 1]


def error(observer: hgo.Observer, y: Any, v: Any) -> float:
    try:
        x_hat = observer.run(DT, y, x_hat0=[y[0], *[0.0] * (observer.n - 1)]).x_hat
    except hgo.HgoError:
        return np.inf
    return float(np.sqrt(np.mean((x_hat[:, 1] - v)[100:] ** 2)))


def test_a_gain_that_moves_is_chosen_where_slopes_turn() -> None:
    y, v = van_der_pol()
    result = tune(OSCILLATOR, (DT, y))
    assert result.structure == "high-gain EKF" and isinstance(result.observer, HighGainEKF)
    found = error(result.observer, y, v)
    known = HighGainEKF(2, R=NOISE**2, Q=LACK**2, model=OSCILLATOR)  # by the noises as they are
    assert found < 1.1 * error(known, y, v)
    constant = min(
        error(StandardObserver(2, float(g), model=OSCILLATOR), y, v)
        for g in np.geomspace(1.0, 40.0, 20)
    )
    assert found < 0.95 * constant
    assert result.errors[1] == pytest.approx(found, rel=0.15) and result.bounds[1] > found
    assert result.noise == pytest.approx(NOISE, rel=0.1)
    assert result.model_error == pytest.approx(LACK, rel=0.5)
    assert result.whiteness > 1e-3
    told = result.report()
    assert "% less error" in told and "which is significant: it is chosen." in told
    band = result.run((DT, y)).deviation[100:, 1]
    assert np.sqrt(np.mean(band**2)) == pytest.approx(found, rel=0.2)
    pytest.importorskip("matplotlib")
    assert len(result.plot().axes) == 4


def test_a_filter_of_ones_own_is_judged_by_the_log_alone() -> None:
    y, v = van_der_pol(800)

    def build(theta: float) -> HighGainEKF:
        return HighGainEKF(2, theta=theta, R=0.1, Q=0.01, model=OSCILLATOR)

    result = tune(build, (DT, y), ells=np.geomspace(1.0, 20.0, 7))
    thetas = np.geomspace(1.0, 20.0, 20)
    assert error(result.observer, y, v) < 1.1 * min(error(build(float(g)), y, v) for g in thetas)
    with pytest.raises(hgo.HgoError, match=r"cutoff = 3\.0: must be left out of a gain that moves"):
        tune(build, (DT, y), ells=[1.0, 2.0, 4.0], cutoff=3.0)
    with pytest.raises(hgo.HgoError, match="a log that can be smoothed"):
        tune(build, 0.1, DT, model_error=1.0, ells=[1.0, 2.0, 4.0])


def test_slopes_that_do_not_count_need_no_covariance() -> None:
    t = np.arange(1500) * 2e-3
    y = np.sin(4.0 * t) + 1e-4 * np.random.default_rng(0).standard_normal(t.size)
    model = hgo.Model(states=["q", "v"], phi="-0.5*v")
    result = tune(model, (t, y))
    assert "was not tried: the model's slopes make" in result.moving_gain
    assert not any("EKF" in name for name, _, _ in result.tried)
    assert result.moving_gain in result.report()


def test_what_is_less_by_chance_is_not_less() -> None:
    rng = np.random.default_rng(0)
    values = rng.standard_normal(5000)
    assert len(stretches(values, 1.0)) == 50 and len(stretches(values[:40], 2.0)) == 5
    np.testing.assert_allclose(np.mean(stretches(values, 20.0)), np.mean(values))
    assert surely_less(stretches(values - 0.2, 1.0))
    assert not surely_less(stretches(values - 0.2, 1.0)[:5])
    wrong = sum(surely_less(rng.standard_normal(50)) for _ in range(400))
    assert 2 <= wrong <= 20  # 2.6 % of 400


def test_an_estimate_that_the_log_does_not_tell_is_refused() -> None:
    t, v = np.arange(3000) * 2e-3, np.zeros(3000)
    for k in range(2999):
        force = np.sign(np.sin(4.0 * t[k])) + 0.3 * np.sin(9.0 * t[k])
        v[k + 1] = v[k] + 2e-3 * (force - 0.5 * v[k])
    y = np.cumsum(v) * 2e-3 + 1e-3 * np.random.default_rng(0).standard_normal(3000)
    with pytest.raises(hgo.HgoError, match="state = 7: must be one that the log determines"):
        tune(None, (t, y), state=7)


def test_states_of_a_nonlinear_chain_are_not_derivatives() -> None:
    model = hgo.Model(states=["a", "b"], f=["b + 0.2*b**3", "-4*a"], box={"b": (-3.0, 3.0)})
    t = np.arange(600) * 1e-2
    y = np.cos(2.0 * t) + 1e-2 * np.random.default_rng(0).standard_normal(t.size)
    with pytest.raises(hgo.HgoError, match="noise that enters a nonlinear chain"):
        hgo.smooth(model, (t, y))
    result = tune(model, (t, y))
    assert all("no model" not in name for name, _, _ in result.tried)
    assert any("cannot be run backwards" in text for text in result.remarks)


def test_whole_numbers_are_no_angle_in_rad() -> None:
    assert Jumps().add(np.arange(60.0) % 7) is None
    assert Jumps().add(np.arange(200.0) * 5 % 360) == 360.0
    assert Jumps().add(np.arange(60) * 0.5 % (2.0 * np.pi)) == 2.0 * np.pi
