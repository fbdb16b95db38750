"""`tune`: its targets, what it finds in records made for it, the gains it picks on a real axis."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.optimize import minimize_scalar

import hgo_rs as hgo
from hgo_rs import LowPowerObserver, StandardObserver, TuningWarning, tune
from hgo_rs.design import bandwidth, innovation_covariance, model_gain, noise_gain, settling

ROOT = Path(__file__).parents[2]
LOG = ROOT.parent / "shared" / "data" / "DATA_EMPS.mat"
ROOTS = [complex(-np.sqrt(0.5), s * np.sqrt(0.5)) for s in (1.0, -1.0)]
DT = 1e-3


def standard(ell: float) -> StandardObserver:
    return StandardObserver(2, ell, poles=ROOTS, method="rk4-innovation-held", timing="predictor")


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
    result = tune(
        lambda ell: StandardObserver(2, ell, poles=ROOTS, method="euler", timing="predictor"),
        noise,
        dt,
        model_error=lack,
    )
    assert result.ell == pytest.approx((lack**2 / (noise**2 * dt)) ** 0.25, rel=0.05)
    a = np.array([[1.0, dt], [0.0, 1.0]])
    q = lack**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    riccati = solve_discrete_are(a.T, np.array([[1.0], [0.0]]), q, noise**2)
    assert 1.0 <= result.point["error"] / riccati[1, 1] ** 0.5 < 1.01


def test_the_better_structure_is_chosen() -> None:
    """At one cutoff of the second derivative the low-power law passes less noise."""
    laws = {
        "standard": lambda g: StandardObserver(3, g, method="euler", timing="predictor"),
        "low-power": lambda g: LowPowerObserver(3, g, method="euler", timing="predictor"),
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
        "order 2": lambda ell: StandardObserver(
            2, ell, method="rk4-innovation-held", timing="predictor"
        ),
        "order 3": lambda ell: StandardObserver(
            3, ell, method="rk4-innovation-held", timing="predictor"
        ),
    }
    result = tune(laws, (t, y))
    assert result.structure == "order 3" and result.state == 2
    errors = {
        name: np.std((law(g).run(t, y).x_hat[:, 1] - 3.0 * np.cos(3.0 * t))[2000:])
        for name, law in laws.items()
        for g in [result.ell if name == "order 3" else tune(law, (t, y)).ell]
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
            "three gains or more",
        ),
        (lambda: tune(standard, 1e-5, DT, cutoff=9.0, ells=[]), "three gains or more"),
        (lambda: tune({}, 1e-5, DT, cutoff=9.0), "at least one observer"),
        (lambda: tune(3, 1e-5, DT, cutoff=9.0), "build = 3"),  # type: ignore[arg-type]
        (lambda: tune(standard, (np.arange(9.0),)), "must be a Log, .*.t, y. or .t, y, u."),
        (
            lambda: tune(standard, (np.zeros(99), np.zeros(99))),
            "t at samples 0 and 1 = .*increasing",
        ),
        (lambda: tune(standard, (DT, np.zeros(40))), "samples of the log = 40"),
        (lambda: tune(standard, (DT, np.zeros(51))), "samples after skip and gaps = 48"),
        (lambda: tune(standard, (0.0, np.zeros(99))), "t, a period = 0.0"),
        (lambda: tune(standard, (DT, np.full(99, np.nan))), "that are not missing = 0"),
        (
            lambda: tune(standard, (DT, np.arange(99.0)), 2 * DT),
            "median time between samples, 0.001",
        ),
        (
            lambda: tune(standard, (DT, np.full(99, 3.0))),
            "distinct values .* = 1: must be > 2.*still",
        ),
        (lambda: tune(standard, (DT, np.arange(99.0) > 50)), "distinct values .* = 2: must be > 2"),
        (lambda: tune(standard, (DT, np.maximum(5.0 - np.arange(99.0), 0.0))), "distinct .* = 1"),
        (lambda: tune(standard, (1.0, np.arange(999.0))), "least RMS innovation = .*rounding of y"),
        (
            lambda: tune(standard, 1e-5, DT, cutoff=9.0, ells=[1.0, np.nan, 3.0]),
            "three gains or more",
        ),
        (lambda: tune(standard, 1e-5, DT, cutoff=9.0, ells=5.0), "ells = 5.0: must be three gains"),
        (
            lambda: tune(lambda ell: 1 / 0, 1e-5, DT, cutoff=9.0),
            r"build\(100\) raised ZeroDivision",
        ),
        (
            lambda: tune(lambda ell: None, 1e-5, DT, cutoff=9.0),
            r"build\(100\) = None: must be an obs",
        ),
        (
            lambda: tune(lambda ell: standard(50.0), 1e-5, DT, cutoff=9.0),
            r"gain of build\(100\) = 50.0: must be 100, the gain that is asked for",
        ),
        (
            lambda: tune(
                lambda ell: StandardObserver(
                    2, ell, model=hgo.InputGain(1.0), method="zoh", timing="predictor"
                ),
                (DT, np.arange(999.0) % 7),
            ),
            "^u is missing",
        ),
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


# --- what it cannot know ----------------------------------------------------------------------


def placed(ell: float) -> StandardObserver:
    return StandardObserver(2, ell, method="zoh", timing="current")


def error_of(build: Any, t: Any, y: Any, v: Any, ell: float) -> float:
    start = [y[np.isfinite(y)][0], 0.0]
    return float(np.std((build(ell).run(t, y, x_hat0=start).x_hat[:, 1] - v)[t >= 0.05 * t[-1]]))


@pytest.mark.parametrize(
    "law",
    [placed, standard, lambda ell: LowPowerObserver(2, ell, method="zoh", timing="predictor")],
)
def test_the_innovations_covariance_is_that_of_white_noise_and_model_error(law: Any) -> None:
    t, y, _ = record(1e-4, 1.0, seed=6)
    innovation = law(300.0).run(t, y).innovation[1000:, 0]
    computed = np.array([1e-8, 1.0]) @ innovation_covariance(law(300.0).spec, DT, 5)
    measured = [np.mean(innovation[j:] * innovation[: innovation.size - j]) for j in range(6)]
    assert measured == pytest.approx(computed, abs=0.04 * computed[0])


def test_white_records_raise_no_alarm() -> None:
    """Rounded to no more than the noise, and with samples missing: 36 records, 3 laws."""
    laws = [
        placed,
        standard,
        lambda ell: LowPowerObserver(2, ell, method="zoh", timing="predictor"),
    ]
    low = 0
    for seed in range(36):
        t, y, _ = record(1e-4, 1.0, seed, count=3000)
        y = np.round(y / 1e-4) * 1e-4 if seed % 3 == 1 else y
        y[np.random.default_rng(seed).random(y.size) < (0.1 if seed % 3 == 2 else 0.0)] = np.nan
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            result = tune(laws[seed // 3 % 3], (t, y), ells=np.geomspace(50.0, 1200.0, 12))
        assert result.warnings == () and "warning" not in str(result)
        low += result.whiteness < 0.05
    assert low <= 6  # 1.8 expected; beyond 6 with probability 0.003


def test_a_model_error_that_lasts_is_seen_but_costs_little() -> None:
    t = np.arange(8000) * DT
    y = np.sin(3.0 * t) + 1e-4 * np.random.default_rng(1).normal(size=t.size)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = tune(placed, (t, y))
    assert result.whiteness < 1e-3 and "whiteness" in str(result)
    errors = [error_of(placed, t, y, 3.0 * np.cos(3.0 * t), g) for g in result.curves[""].ell]
    assert error_of(placed, t, y, 3.0 * np.cos(3.0 * t), result.ell) < 1.05 * min(errors)


@pytest.mark.parametrize("counts", [4096, 1000, 400, 100, 40])
def test_a_coarse_encoder_is_told_and_costs_little(counts: int) -> None:
    t = np.arange(8000) * DT
    v = 1.0 + 0.2 * np.sin(1.5 * t)
    step = 2.0 * np.pi / counts
    y = step * np.floor(np.cumsum(v) * DT / step)
    with pytest.warns(TuningWarning, match=f"steps of {step:.4g}.*not white") as caught:
        result = tune(placed, (t, y))
    assert tuple(str(one.message) for one in caught) == result.warnings
    assert all(f"warning: {text}" in str(result) for text in result.warnings)
    assert result.quantisation == pytest.approx(step)
    least = min(error_of(placed, t, y, v, g) for g in np.geomspace(1.0, 500.0, 40))
    assert error_of(placed, t, y, v, result.ell) < 1.25 * least
    with pytest.warns(TuningWarning, match="the gain does not depend on them"):
        assert tune(placed, (t, y), cutoff=60.0).observer.bandwidth(DT)[1] == pytest.approx(60.0)


def coloured(kind: str, t: Any) -> Any:
    from scipy.signal import lfilter

    white = 1e-2 * np.random.default_rng(0).normal(size=t.size)
    if kind == "filtered":
        return lfilter([0.6], [1.0, -0.8], white)
    if kind == "hum":
        return 0.1 * white + 1e-2 * np.sin(2.0 * np.pi * 150.0 * t)
    return white


@pytest.mark.parametrize("kind", ["filtered", "hum", "held"])
def test_noise_that_is_not_white_is_told(kind: str) -> None:
    t = np.arange(10_000) * DT
    y = np.sin(3.0 * t) + coloured(kind, t)
    y = np.repeat(y[::20], 20) if kind == "held" else y
    with pytest.warns(TuningWarning, match="do not explain the innovation"):
        result = tune(placed, (t, y))
    assert result.whiteness < 1e-3


def test_an_optimum_at_an_end_of_the_range_is_told() -> None:
    with pytest.warns(
        TuningWarning, match="at the lowest gain tried, 1 /s: give ells= that begin low"
    ):
        assert tune(placed, 1e-3, DT, model_error=0.0).ell == pytest.approx(1.0, rel=1e-3)
    with pytest.warns(TuningWarning, match="at the highest gain tried, 5000 /s"):
        assert tune(placed, 1e-9, DT, model_error=1.0).ell == pytest.approx(5000.0, rel=1e-3)
    t, y, _ = record(1e-4, 1.0, seed=3)  # where 480 is best
    with pytest.warns(TuningWarning, match="highest gain tried, 200 /s"):
        tune(placed, (t, y), ells=np.geomspace(20.0, 200.0, 9))


def test_a_gain_that_is_refused_is_left_out_and_told() -> None:
    t, y, _ = record(1e-4, 1.0, seed=3)
    gains = [300.0, 100.0, 700.0, 300.0, 500.0, 900.0]
    sound = tune(placed, (t, y), ells=gains)
    assert sound.warnings == ()
    with pytest.warns(
        TuningWarning, match=r"1 of the gains left out \(1e\+200 /s\): ell = 1e200"
    ) as told:
        overflows = tune(placed, [t, y], ells=np.array([*gains, 1e200]))
    assert len(told) == 1 and overflows.ell == sound.ell

    def careful(ell: float) -> StandardObserver:
        if ell > 800.0:
            raise KeyError("no such gain")
        return placed(ell)

    with pytest.warns(TuningWarning, match=r"\(900 /s\): build\(900\) raised KeyError: 'no such"):
        assert tune(careful, (t, y), ells=gains).ell == pytest.approx(sound.ell, rel=0.01)
    euler = [*gains, 2500.0]
    with pytest.warns(TuningWarning, match=r"\(2500 /s\): .*must be < 0.0004 s"):
        tune(
            lambda ell: StandardObserver(2, ell, method="euler", timing="predictor"),
            (t, y),
            ells=euler,
        )
    laws = {"placed": placed, "fails": lambda ell: 1 / 0}
    with pytest.warns(TuningWarning, match="structure 'fails' was left out: .*ZeroDivisionError"):
        assert tune(laws, (t, y), ells=gains).structure == "placed"
    with pytest.warns(TuningWarning, match="the innovation is near its minimum at 1 of the gains"):
        tune(placed, (t, y), ells=[4.0, 40.0, 400.0])


def test_long_gaps_and_a_log_of_two_rates() -> None:
    t = np.arange(10_000) * DT
    y = np.sin(3.0 * t) + 1e-3 * np.random.default_rng(2).normal(size=t.size)
    v = 3.0 * np.cos(3.0 * t)
    whole = tune(placed, (t, y))
    y[4000:5500] = np.nan  # of which the innovation after it would be the largest
    gap = tune(placed, (t, y))
    assert gap.warnings == () and gap.ell == pytest.approx(whole.ell, rel=0.1)
    slow = np.full(t.size, np.nan)
    slow[::5] = y[::5]
    result = tune(placed, (t, slow))
    assert result.warnings == ()
    assert result.noise == pytest.approx(1e-3, rel=0.1)
    errors = [error_of(placed, t, slow, v, g) for g in np.geomspace(20.0, 800.0, 25)]
    assert error_of(placed, t, slow, v, result.ell) < 1.05 * min(errors)


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
        assert all("gain tried" in text for text in chosen.warnings), setting.name
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
