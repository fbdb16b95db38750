"""Odd arguments of the public functions: each ends in one line that names it, and a remedy."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import hgo_rs as hgo

MODEL = hgo.Model(states=["q", "v"], parameters={"k": 25.0}, phi="-k*sin(q) - 0.1*v")
T = 0.01 * np.arange(200)
Y = np.sin(10.0 * T) + 1e-3 * np.random.default_rng(0).standard_normal(200)
OBSERVER = hgo.StandardObserver(2, 12.0, model=MODEL)


def standard(ell: float) -> hgo.StandardObserver:
    return hgo.StandardObserver(2, ell)


def simulated(**manner: Any) -> Any:
    plant = hgo.Plant(states=["q", "v"], drift=["v", "-sin(q)"])
    return hgo.simulate(plant, OBSERVER, x0=[0.1, 0.0], dt=0.01, t_end=0.1, **manner)


@pytest.fixture(scope="module")
def tuned() -> hgo.Tuning:
    return hgo.tune(standard, 1e-3, 0.01, model_error=1.0)


ODD: dict[str, tuple[Callable[[], Any], str]] = {
    "smooth": (lambda: hgo.smooth(None, None), "log = None: must be a Log"),
    "fit": (lambda: hgo.fit(MODEL, None), "log = None: must be a Log"),
    "fit, a name": (
        lambda: hgo.fit(MODEL, (T, Y), "k"),
        r"parameters = 'k': .*write \[.k.\]",
    ),
    "fit, a number": (lambda: hgo.fit(MODEL, (T, Y), 3), "parameters = 3: must be a list"),
    "compare": (lambda: hgo.compare(None), "log = None: must be a Log"),
    "compare, a list": (lambda: hgo.compare((T, Y), [OBSERVER]), "observers = .*must be a dict"),
    "compare, a name": (
        lambda: hgo.compare((T, Y), baselines="Kalman"),
        "baselines = 'Kalman': must be a list",
    ),
    "load": (lambda: hgo.load(None), "path = None: must be a path"),
    "estimate": (lambda: hgo.estimate("axis.csv", None), "path = None: must be a path"),
    "save": (lambda: OBSERVER.save(None), "path = None: must be a path"),
    "run, timing": (lambda: OBSERVER.run(T, Y, timing=np.zeros(0)), "timing = .*must be one of"),
    "simulate": (lambda: simulated(metrics=3.0), "metrics = 3.0: must be a list"),
    "simulate, arrays": (lambda: simulated(metrics=np.zeros((2, 2))), "metrics = .*a list of"),
    "export, nothing": (lambda: hgo.export(None, to="c", out="o"), "observer = None: must be an"),
    "export, a text": (
        lambda: hgo.export(OBSERVER, to="c", out="o", log="axis.csv"),
        "log = 'axis.csv': must be a Log",
    ),
    "export, too few": (
        lambda: hgo.export(OBSERVER, to="c", out="o", log=(T[:-1], Y)),
        r"t of shape \(199,\): must be \(200,\)",
    ),
    "config": (lambda: hgo.Config("abc"), "data = 'abc': must be a dict"),
    "flag": (
        lambda: hgo.StandardObserver(2, 9.0, allow_unstable=np.zeros(0)),
        "allow_unstable = .*: must be True or False",
    ),
    "run, flag": (
        lambda: OBSERVER.run(T, Y, allow_unstable="no"),
        "allow_unstable = 'no': must be True or False",
    ),
    "cube": (
        lambda: hgo.HighGainEKF(2, R=1.0, Q=np.zeros((2, 2, 2))),
        "shape of Q = .*2, 2, 2.*matrix",
    ),
    "export": (lambda: hgo.export(OBSERVER, to="c", out=None), "out = None: must be a path"),
    "tune": (lambda: hgo.tune(MODEL, None), "log_or_noise = None: must be a Log"),
    "tune, a name": (lambda: hgo.tune(MODEL, "axis.csv"), "log_or_noise = 'axis.csv': must be"),
}


@pytest.mark.parametrize("case", ODD)
def test_it_is_refused_in_one_line(case: str) -> None:
    call, told = ODD[case]
    with pytest.raises(hgo.HgoError, match=told) as error:
        call()
    assert "\n" not in str(error.value) and "; " in str(error.value)


@pytest.mark.parametrize("log", [None, Y, (T,), "axis.csv", (T, Y, None, None), {}])
def test_a_tuned_observer_refuses_what_is_no_log(tuned: hgo.Tuning, log: Any) -> None:
    with pytest.raises(hgo.HgoError, match=r"log = .*: must be a Log"):
        tuned.run(log)


def test_a_record_is_taken_in_every_form(tuned: hgo.Tuning) -> None:
    """With rows of an array, a list, and no inputs said: the bits of one run."""
    wanted = tuned.observer.run(T, Y, start="first-sample").x_hat
    for log in ((T, Y), [T, Y], (T, Y, None), np.array([T, Y])):
        assert np.array_equal(tuned.run(log).x_hat, wanted)
    pd = pytest.importorskip("pandas")
    frame, series = pd.DataFrame({"t": T, "q": Y}), pd.Series(Y, index=T)
    for log in (frame, series):
        assert np.array_equal(tuned.run(log).x_hat, wanted)
    assert np.array_equal(hgo.smooth(MODEL, frame).x, hgo.smooth(MODEL, (T, Y)).x)


def test_an_estimate_that_is_right_at_once_has_settled() -> None:
    """A deadbeat law, whose gain is beyond all that rounding shows of its error."""
    assert OBSERVER.settling(4.0)[0] == 0.0
    assert np.all(OBSERVER.settling(0.01) > 0.0)
