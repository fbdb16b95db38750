"""`tune`: its targets, what it finds in records made for it, the gains it picks on a real axis."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.optimize import minimize_scalar

import hgo_rs as hgo
from hgo_rs import LowPowerObserver, StandardObserver, tune
from hgo_rs.design import bandwidth, model_gain, noise_gain, settling

ROOT = Path(__file__).parents[2]
LOG = ROOT.parent / "shared" / "data" / "DATA_EMPS.mat"
ROOTS = [complex(-np.sqrt(0.5), s * np.sqrt(0.5)) for s in (1.0, -1.0)]
DT = 1e-3


def standard(ell: float) -> StandardObserver:
    return StandardObserver(2, ell, poles=ROOTS, method="rk4-innovation-held")


# --- from a noise level -----------------------------------------------------------------------


def test_a_cutoff_is_reached() -> None:
    result = tune(standard, 1e-5, DT, cutoff=300.0)
    assert result.state == 2 and result.criterion == "cutoff 300 rad/s"
    assert result.observer.bandwidth(DT)[1] == pytest.approx(300.0, rel=1e-6)
    assert result.point["noise"] == pytest.approx(1e-5 * result.observer.noise_gain(DT)[1] ** 0.5)
    assert np.isnan(result.model_error) and np.isnan(result.point["error"])
    first = tune(standard, 1e-5, DT, cutoff=300.0, state=1)
    assert first.observer.bandwidth(DT)[0] == pytest.approx(300.0, rel=1e-6)
    assert first.ell < result.ell


def test_a_settling_time_is_kept_by_the_least_gain() -> None:
    result = tune(standard, 1e-5, DT, settling=0.05)
    assert settling(standard(result.ell).spec, DT)[1] <= 0.05
    assert settling(standard(0.995 * result.ell).spec, DT)[1] > 0.05


def test_the_least_error_is_the_least() -> None:
    noise, lack = 2e-5, 0.3
    result = tune(standard, noise, DT, model_error=lack)

    def variance(ell: float) -> float:
        spec = standard(ell).spec
        return float(noise**2 * noise_gain(spec, DT)[1] + lack**2 * model_gain(spec, DT)[1])

    found = minimize_scalar(
        lambda x: variance(np.exp(x)), bounds=np.log([5, 900]), method="bounded"
    )
    assert result.ell == pytest.approx(np.exp(found.x), rel=1e-2)
    assert result.point["error"] == pytest.approx(found.fun**0.5, rel=1e-4)
    curve = result.curves[""]
    assert np.all(np.diff(curve.noise) > 0.0)
    assert curve.error.min() >= result.point["error"] * (1.0 - 1e-9)


def test_butterworth_poles_are_the_kalman_filters() -> None:
    """At a small step the best gain is (Q/R dt)^(1/4), and no linear filter errs less."""
    dt, noise, lack = 1e-4, 1e-4, 0.5
    result = tune(lambda ell: StandardObserver(2, ell, poles=ROOTS), noise, dt, model_error=lack)
    assert result.ell == pytest.approx((lack**2 / (noise**2 * dt)) ** 0.25, rel=0.05)
    a = np.array([[1.0, dt], [0.0, 1.0]])
    q = lack**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    riccati = solve_discrete_are(a.T, np.array([[1.0], [0.0]]), q, noise**2)
    assert 1.0 <= result.point["error"] / riccati[1, 1] ** 0.5 < 1.01


def test_the_better_structure_is_chosen() -> None:
    """At one cutoff of the second derivative the low-power law passes less noise."""
    laws = {
        "standard": lambda g: StandardObserver(3, g),
        "low-power": lambda g: LowPowerObserver(3, g),
    }
    few = np.geomspace(5.0, 100.0, 12)
    result = tune(laws, 1e-5, DT, cutoff=30.0, state=3, ells=few)
    assert result.structure == "low-power"
    assert isinstance(result.observer, LowPowerObserver)
    other = tune(laws["standard"], 1e-5, DT, cutoff=30.0, state=3, ells=few)
    assert result.point["noise"] < other.point["noise"]
    columns = result.columns()
    assert len({len(column) for column in columns.values()}) == 1
    assert set(columns["structure"]) == set(laws)


# --- from a record ----------------------------------------------------------------------------


def record(noise: float, lack: float, seed: int, count: int = 20_000) -> tuple[Any, ...]:
    """x_1'' = w sampled with noise: (t, y, x_2)."""
    rng = np.random.default_rng(seed)
    cov = lack**2 * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]])
    w = rng.multivariate_normal(np.zeros(2), cov, size=count)
    v = np.r_[0.0, np.cumsum(w[:-1, 1])]
    x = np.r_[0.0, np.cumsum(DT * v[:-1] + w[:-1, 0])]
    return np.arange(count) * DT, x + noise * rng.normal(size=count), v


@pytest.mark.parametrize(("noise", "lack"), [(1e-4, 1.0), (1e-5, 1.0)])
def test_noise_and_model_error_are_found_in_a_record(noise: float, lack: float) -> None:
    t, y, v = record(noise, lack, seed=3)
    result = tune(standard, (t, y))
    assert result.noise == pytest.approx(noise, rel=0.1)
    assert result.model_error == pytest.approx(lack, rel=0.15)

    def error(ell: float) -> float:
        return float(np.sqrt(np.mean((standard(ell).run(t, y).x_hat[:, 1] - v)[1000:] ** 2)))

    least = min(error(ell) for ell in result.curves[""].ell.tolist())
    assert error(result.ell) < 1.03 * least
    assert result.point["error"] == pytest.approx(error(result.ell), rel=0.15)


def test_gaps_and_a_period_are_taken() -> None:
    _, y, _ = record(1e-4, 1.0, seed=4, count=8000)
    y[500:520] = np.nan
    y[::37] = np.nan
    result = tune(standard, (DT, y), cutoff=100.0)
    assert result.observer.bandwidth(DT)[1] == pytest.approx(100.0, rel=1e-6)
    assert result.noise == pytest.approx(1e-4, rel=0.2)
    assert result.point["error"] > result.point["noise"] > 0.0


def test_the_order_that_predicts_best_is_chosen() -> None:
    """On a smooth motion order 3 predicts better than order 2, and the record says so."""
    t = np.arange(12_000) * DT
    y = np.sin(3.0 * t) + 1e-5 * np.random.default_rng(2).normal(size=t.size)
    laws = {
        "order 2": lambda ell: StandardObserver(2, ell, method="rk4-innovation-held"),
        "order 3": lambda ell: StandardObserver(3, ell, method="rk4-innovation-held"),
    }
    few = np.geomspace(5.0, 500.0, 16)
    result = tune(laws, (t, y), ells=few)
    assert result.structure == "order 3" and result.state == 2
    errors = {
        name: np.std((law(g).run(t, y).x_hat[:, 1] - 3.0 * np.cos(3.0 * t))[2000:])
        for name, law in laws.items()
        for g in [result.ell if name == "order 3" else tune(law, (t, y), ells=few).ell]
    }
    assert errors["order 3"] < errors["order 2"]


def test_the_figure_and_the_table(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    t, y, _ = record(1e-4, 1.0, seed=5, count=4000)
    few = np.geomspace(20.0, 1000.0, 12)
    found = tune(standard, (t, y), ells=few), tune(standard, 1e-4, DT, cutoff=90.0, ells=few)
    for result, panels in zip(found, (4, 3), strict=True):
        figure = result.plot()
        assert len(figure.axes) == panels
        marked = [
            line for ax in figure.axes for line in ax.get_lines() if line.get_label() == "chosen"
        ]
        assert len(marked) >= panels - 1
        figure.savefig(tmp_path / "tuning.png")
        assert "gain" in str(result) and "bandwidth" in str(result)
    pytest.importorskip("pandas")
    assert {"ell", "noise", "bandwidth", "peaking"} <= set(result.to_dataframe().columns)


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: tune(standard, 1e-5), "dt = None: must be given with a noise level"),
        (lambda: tune(standard, 1e-5, DT), "model_error = None"),
        (lambda: tune(standard, 1e-5, DT, cutoff=9.0, settling=1.0), "given one at a time"),
        (
            lambda: tune(standard, 1e-5, DT, cutoff=1e9),
            "cutoff = 1000000000.0: must be below pi/dt",
        ),
        (lambda: tune(standard, 1e-5, DT, cutoff=0.1), "cutoff = 0.1: must be between"),
        (lambda: tune(standard, 1e-5, DT, settling=1e-9), "settling = 1e-09: must be between"),
        (lambda: tune(standard, -1.0, DT, cutoff=9.0), "log_or_noise = -1.0"),
        (lambda: tune(standard, 1e-5, DT, cutoff=9.0, state=3), "state = 3"),
        (
            lambda: tune(standard, 1e-5, DT, cutoff=9.0, ells=[1.0, -2.0, 3.0]),
            "three gains or more in",
        ),
        (lambda: tune(standard, 1e-5, DT, cutoff=9.0, ells=[]), "three gains or more in"),
        (lambda: tune({}, 1e-5, DT, cutoff=9.0), "at least one observer"),
        (lambda: tune(3, 1e-5, DT, cutoff=9.0), "build = 3"),  # type: ignore[arg-type]
        (lambda: tune(standard, (np.arange(9.0),)), "must be .t, y. or .t, y, u."),
        (lambda: tune(standard, (np.zeros(9), np.zeros(9))), "t = .*must be increasing"),
        (lambda: tune(standard, (DT, np.zeros(40))), "samples after skip"),
        (lambda: tune(standard, (DT, np.zeros(99)), skip=1.0), "skip = 1.0"),
        (lambda: tune(standard, (DT, np.zeros(99)), model_error=1.0), "left out with a log"),
        (
            lambda: tune(lambda ell: hgo.SampledDataObserver(), 1.0, DT, cutoff=9.0),
            "one with a constant gain",
        ),
    ],
)
def test_refusals(call: Any, match: str) -> None:
    with pytest.raises(hgo.HgoError, match=match):
        call()


# --- a real axis ------------------------------------------------------------------------------


@pytest.mark.skipif(not LOG.exists(), reason="recorded data not present")
def test_tune_sees_the_record_and_picks_a_gain_near_the_best() -> None:
    """Within 15 % of the least error against a reference that it never sees, in three settings."""
    sys.path.insert(0, str(ROOT / "examples"))
    import emps

    # what an extended Kalman filter on the same model reaches at its best
    for setting, target in zip(emps.settings(LOG), (3.4e-5, 7.0e-4, 2.2e-4), strict=True):
        build = emps.observer(2, True, emps.DAMPING_HALF)
        chosen = tune(build, (setting.t, setting.y, setting.u), skip=emps.SKIP)
        velocity = emps.run(build, setting)
        error = setting.error(velocity(chosen.ell))
        least = min(setting.error(velocity(g)) for g in chosen.ell * np.geomspace(0.2, 5.0, 17))
        assert error < 1.15 * least, setting.name
        assert error < target, setting.name


@pytest.mark.skipif(not LOG.exists(), reason="recorded data not present")
def test_known_load_steps_are_recovered() -> None:
    sys.path.insert(0, str(ROOT / "examples"))
    import emps

    found = emps.load(LOG.with_name("DATA_EMPS_PULSES.mat"), ell=60.0)
    assert found.step == pytest.approx(175.75, abs=0.1)
    assert found.rms < 2.5  # N


def test_bandwidth_is_the_designs() -> None:
    np.testing.assert_array_equal(standard(50.0).bandwidth(DT), bandwidth(standard(50.0).spec, DT))
