"""`tune` with nothing chosen by hand: on simulated records, whose state is known, and real ones."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hgo_rs as hgo
from hgo_rs import StandardObserver, tune
from hgo_rs.logs import Log
from hgo_rs.tuning.linear import Slopes, exponential, path, stationary
from hgo_rs.tuning.record import Record
from hgo_rs.tuning.reference import butterworth
from hgo_rs.tuning.reversal import reversed_model

DT = 2e-3
PENDULUM = hgo.Model(
    states=["q", "v"], inputs=["u"], parameters={"g": 64.0, "d": 0.3}, phi="g*sin(q) - d*v + u"
)


def swing(noise: float, seed: int, count: int = 6000) -> tuple[Any, ...]:
    """A hanging pendulum about q = pi, pushed by noise of density 1 beside the input: t, y, u, v.

    Euler-Maruyama with 20 steps a sample.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(count) * DT
    u = np.where(np.sin(2.0 * t) > 0.0, 8.0, -8.0)
    h, q, v = DT / 20, np.pi, 1.0
    path = np.empty((count, 2))
    kicks = rng.standard_normal((count, 20)) * np.sqrt(h)
    for k in range(count):
        path[k] = q, v
        for i in range(20):
            a = 64.0 * np.sin(q) - 0.3 * v + u[k]
            q, v = q + h * v, v + h * a + kicks[k, i]
    return t, path[:, 0] + noise * rng.standard_normal(count), u, path[:, 1]


def error(observer: hgo.Observer, t: Any, y: Any, u: Any, v: Any) -> float:
    start = [y[0], *[0.0] * (observer.n - 1)]
    try:
        run = observer.run(t, y, u if observer.n_u else None, x_hat0=start)
    except hgo.HgoError:  # a gain beyond the step limit
        return np.inf
    return float(np.sqrt(np.mean((run.x_hat[:, 1] - v)[len(t) // 20 :] ** 2)))


@pytest.mark.parametrize("noise", [2e-2, 2e-3])
def test_a_model_and_a_log_are_enough(noise: float) -> None:
    t, y, u, v = swing(noise, seed=1)
    result = tune(PENDULUM, (t, y, u))
    assert result.state == 2 and result.observer.model is not None
    found = error(result.observer, t, y, u, v)
    poles = {"Butterworth": butterworth(2), "real": None}
    least = min(
        error(StandardObserver(2, g, poles=p, model=PENDULUM), t, y, u, v)
        for p in poles.values()
        for g in np.geomspace(2.0, 300.0, 25)
    )
    assert found < 1.1 * least
    assert result.errors[1] == pytest.approx(found, rel=0.2)
    assert np.all(result.errors <= result.bounds) and found < result.bounds[1]
    assert result.noise == pytest.approx(noise, rel=0.15)
    told = result.report()
    for text in ("v ", "<- wanted", "model, Butterworth", "no model", "Measurement noise"):
        assert text in told, text


def test_a_log_object_and_a_noise_level() -> None:
    t, y, u, _ = swing(5e-3, seed=2, count=3000)
    names = {"time": "t", "output": "q", "input": "u"}
    log = Log(t, y, u, names, "pendulum.csv", np.isnan(y))
    by_log, by_arrays = tune(PENDULUM, log), tune(PENDULUM, (t, y, u))
    assert by_log.ell == by_arrays.ell and by_log.structure == by_arrays.structure
    np.testing.assert_array_equal(by_log.run(log).x_hat, by_arrays.run((t, y, u)).x_hat)
    paper = tune(PENDULUM, 5e-3, DT, model_error=1.0)
    assert paper.observer.model is not None
    assert paper.errors[1] == pytest.approx(paper.point["error"])
    np.testing.assert_array_equal(paper.bounds, paper.errors)


def test_nothing_known_and_an_input_gain() -> None:
    t = np.arange(4000) * 1e-3
    u = np.sign(np.sin(5.0 * t))
    v = np.cumsum(2.0 * u + np.cos(11.0 * t)) * 1e-3
    y = np.cumsum(v) * 1e-3 + 1e-4 * np.random.default_rng(3).standard_normal(t.size)
    bare, known = tune(None, (t, y)), tune(hgo.InputGain(2.0), (t, y, u))
    assert bare.observer.model is None and "no model" in bare.structure
    assert error(known.observer, t, y, u, v) < 0.7 * error(bare.observer, t, y, u, v)
    assert "input" not in bare.report()


def test_slow_poles_leave_the_lowest_gain_alone() -> None:
    """A load that changes seldom has a pole at 0.1 ell, and the best gain is low."""
    t = np.arange(8000) * 1e-3
    y = np.sin(1.5 * t) + 3e-2 * np.random.default_rng(5).standard_normal(t.size)
    slow = [complex(-0.5, 0.75**0.5), complex(-0.5, -(0.75**0.5)), -0.1]

    def build(ell: float) -> StandardObserver:
        return StandardObserver(3, ell, poles=slow)

    result = tune(build, (t, y), state=2)
    curve = result.curves[""]
    assert curve.ell[0] < 2.0 and not any("gain tried" in text for text in result.warnings)
    v = 1.5 * np.cos(1.5 * t)
    least = min(error(build(g), t, y, None, v) for g in np.geomspace(1.0, 60.0, 30))
    assert error(result.observer, t, y, None, v) < 1.1 * least


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_butterworth_poles(n: int) -> None:
    from scipy.signal import butter

    expected = np.sort_complex(butter(n, 1.0, analog=True, output="zpk")[1])
    np.testing.assert_allclose(np.sort_complex(np.array(butterworth(n))), expected, atol=1e-12)


def test_a_model_run_backwards_retraces_its_path() -> None:
    """Against an ODE solver, with phi of t, x and u, of orders 2 and 3, and with a triangle."""
    end = 1.7
    models = [
        hgo.Model(states=["a", "b"], inputs=["u"], phi="u*cos(3*t) - 2*a*b - b**3"),
        hgo.Model(states=["a", "b", "c"], inputs=["u"], phi="u*t - a - 2*b*c - c"),
        hgo.Model(states=["a", "b", "c"], inputs=["u"], f=["sin(a)", "a*b + u", "t - b*c"]),
    ]
    for model in models:
        back = reversed_model(model, model.n, end)
        assert isinstance(back, hgo.Model)

        def rate(of: hgo.Model) -> Callable[[float, Any], list[float]]:
            from hgo_rs.expressions.numeric import evaluate

            def f(t: float, x: Any) -> list[float]:
                values = {**dict(zip(of.states, x, strict=True)), "t": t, "u": 0.4}
                return [float(r) for r in evaluate(of.drift, values)]

            return f

        x0 = np.array([0.3, -0.2, 0.5])[: model.n]
        turn = (-1.0) ** np.arange(model.n)
        options = {"rtol": 1e-11, "atol": 1e-12}
        forward = solve_ivp(rate(model), (0.0, end), x0, **options).y[:, -1]
        returned = solve_ivp(rate(back), (0.0, end), turn * forward, **options).y[:, -1]
        np.testing.assert_allclose(turn * returned, x0, atol=1e-8)


def test_covariances_are_those_of_a_simulated_chain() -> None:
    dt, noise, lack, n, count = 1e-2, 3e-3, 0.8, 2, 200_000
    rng = np.random.default_rng(6)
    law = StandardObserver(n, 12.0, poles=butterworth(n))
    cov = lack**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    w = rng.multivariate_normal(np.zeros(2), cov, size=count)
    v = np.r_[0.0, np.cumsum(w[:-1, 1])]
    x = np.r_[0.0, np.cumsum(dt * v[:-1] + w[:-1, 0])]
    y = x + noise * rng.standard_normal(count)
    truth = np.c_[x, v]
    for timing, side in (("current", "shown"), ("predictor", "before")):
        errors = (law.run(dt, y, timing=timing).x_hat - truth)[2000:]
        both = getattr(stationary(law.spec, dt), side)
        computed = noise**2 * both[0] + lack**2 * both[1]
        np.testing.assert_allclose(np.cov(errors.T), computed, rtol=0.06)


def test_a_model_of_python_code_is_judged_without_it() -> None:
    """What cannot be traced cannot be run backwards; the order without a model judges."""

    def phi(t: float, x: Any, u: Any) -> float:
        return float(-4.0 * x[0]) if float(x[0]) > -9.0 else 0.0

    t = np.arange(1200) * 1e-2
    y = np.cos(2.0 * t) + 1e-3 * np.random.default_rng(8).standard_normal(t.size)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = hgo.Model(states=["q", "v"], phi=phi)
        few = np.geomspace(0.5, 50.0, 9)
        result = tune(lambda ell: StandardObserver(2, ell, model=model), (t, y), ells=few)
    assert not model.compiled and "no model" in result.judged_by
    assert any("cannot be run backwards" in text for text in result.remarks)


# --- the variational equation -------------------------------------------------------------------


def test_exponentials_are_scipys() -> None:
    from scipy.linalg import expm

    some = np.random.default_rng(0).normal(size=(40, 3, 3))
    some *= 2.0 / np.linalg.norm(some, 2, axis=(1, 2))[:, None, None]
    np.testing.assert_allclose(exponential(some), expm(some), rtol=1e-12, atol=1e-13)


def oscillator(omega: float, count: int, seed: int) -> tuple[Any, Any, Any]:
    """q'' = -omega^2 q + w, w white of density 1, exact over a step: y with noise 1e-2, states."""
    from scipy.linalg import expm

    rng = np.random.default_rng(seed)
    a = np.array([[0.0, 1.0], [-(omega**2), 0.0]])
    # Van Loan's integral of the noise
    big = np.zeros((4, 4))
    big[:2, :2], big[2:, 2:], big[1, 3] = -a, a.T, 1.0
    f = expm(big * DT)
    step = f[2:, 2:].T
    kicks = rng.multivariate_normal(np.zeros(2), step @ f[:2, 2:], size=count)
    x = np.empty((count, 2))
    now = np.array([0.1, 0.0])
    for k in range(count):
        x[k] = now
        now = step @ now + kicks[k]
    return np.arange(count) * DT, x[:, 0] + 1e-2 * rng.standard_normal(count), x


def test_the_models_slopes_are_in_noise_and_model_error() -> None:
    """Gains below the resonance, where the chain alone says something else by a factor."""
    omega = 60.0
    model = hgo.Model(states=["q", "v"], parameters={"w2": omega**2}, phi="-w2*q")
    t, y, x = oscillator(omega, 60_000, seed=4)
    record = Record.of((t, y), None)
    ells = np.geomspace(8.0, 60.0, 4)
    laws = [StandardObserver(2, g, poles=butterworth(2), model=model) for g in ells]
    runs = [law.run(t, y, x_hat0=[y[0], 0.0]) for law in laws]
    moves = path(record, model, runs[0].x_hat[: len(record.t)], 4, 600)
    slopes = Slopes.of([law.spec for law in laws], DT, moves)
    assert slopes is not None
    innovation = slopes.innovation(ells) @ [1e-4, 1.0]
    shown = slopes.shown(ells)[0] * 1e-4 + slopes.shown(ells)[1]
    for k, run in enumerate(runs):
        errors = (run.x_hat - x)[3000:]
        assert np.mean(run.innovation[3000:] ** 2) == pytest.approx(innovation[k], rel=0.1)
        np.testing.assert_allclose(np.mean(errors**2, axis=0), shown[k], rtol=0.2)
    flat = stationary(laws[0].spec, DT).shown[1, 1, 1]
    assert not 0.5 < flat / slopes.shown(ells[:1])[1, 0, 1] < 2.0  # what the slopes are worth

    def build(ell: float) -> StandardObserver:
        return StandardObserver(2, ell, poles=butterworth(2), model=model)

    result = tune(build, (t, y))
    assert result.noise == pytest.approx(1e-2, rel=0.1)
    assert result.model_error == pytest.approx(1.0, rel=0.35)


@pytest.mark.filterwarnings("ignore::hgo_rs.TuningWarning")
def test_a_long_record_is_judged_by_its_busiest_stretch() -> None:
    t = np.arange(40_000) * 1e-3
    y = np.where(t < 20.0, 0.0, np.sin(4.0 * t)) + 1e-3 * np.random.default_rng(1).normal(
        size=t.size
    )
    record = Record.of((t, y), None)
    assert len(record.t) == 12_288 and record.t[0] > 18.0 and record.whole == 40_000
    result = tune(lambda ell: StandardObserver(2, ell), (t, y), ells=[5.0, 10.0, 20.0, 40.0])
    (told,) = [text for text in result.remarks if "samples" in text]
    first, last = f"t = {record.t[0]:.6g} s", f"to {record.t[-1]:.6g} s"
    assert told.startswith("27712 of the log's 40000 samples") and first in told and last in told
    assert told in result.report()


@pytest.mark.filterwarnings("ignore::hgo_rs.TuningWarning")
def test_the_longest_piece_is_said() -> None:
    t = np.arange(3000) * 1e-3
    y = np.sin(9.0 * t) + 1e-3 * np.random.default_rng(1).normal(size=t.size)
    names = {"time": "t", "output": "q", "input": None}
    clock = np.where(t < 1.0, t, t - 1.0)
    log = Log(clock, y, None, names, "axis.csv", np.zeros(3000, bool), (0, 1000))
    result = tune(lambda ell: StandardObserver(2, ell), log, ells=[20.0, 40.0, 80.0])
    assert any(text.startswith("1000 of the log's 3000 samples") for text in result.remarks)
    again = tune(lambda ell: StandardObserver(2, ell), (t[:2000], y[1000:]), ells=[20, 40, 80])
    np.testing.assert_allclose(again.curves[""].measured, result.curves[""].measured, rtol=1e-6)
    assert not any("samples" in text for text in again.remarks)


DRIVEN = hgo.Model(states=["q", "v"], inputs=["u"], phi="u - 0.5*v")
PAIR = hgo.Model(
    states=["a", "b", "c", "d"], inputs=["u"], orders=[2, 2], phi=["u - 0.5*b", "-u - 0.5*d"]
)


@pytest.mark.parametrize("model", [DRIVEN, hgo.InputGain(1.0), PAIR])
@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda u: None, "u is missing: .* 1 known input"),
        (lambda u: np.where(np.arange(u.size) == 7, np.nan, u), "u at sample 7 is not finite"),
        (lambda u: np.column_stack([u, u]), r"u of shape \(2000, 2\): must be \(2000, 1\)"),
        (lambda u: u[:-1], r"u.* \(1999.*must be \(2000, "),
    ],
)
def test_a_model_with_inputs_is_not_given_up_for_none(model, spoil, told) -> None:
    t = np.arange(2000) * 2e-3
    u = np.sign(np.sin(4.0 * t))
    y = np.cumsum(np.cumsum(u)) * 4e-6 + 1e-4 * np.random.default_rng(0).normal(size=t.size)
    y = np.column_stack([y, -y]) if model is PAIR else y
    with pytest.raises(hgo.HgoError, match=told):
        tune(model, (t, y, spoil(u)))


def test_inputs_that_nothing_takes_are_said() -> None:
    t = np.arange(2000) * 2e-3
    y = np.sin(4.0 * t) + 1e-3 * np.random.default_rng(0).normal(size=t.size)
    assert any(text.startswith("u: ") for text in tune(None, (t, y, y)).remarks)
    assert not any(text.startswith("u: ") for text in tune(None, (t, y)).remarks)


def test_a_load_is_judged_by_what_it_means() -> None:
    """State 3 of an order without a model is the acceleration, not the load: it does not judge."""
    model = hgo.Model(states=["q", "v", "d"], parameters={"g": 9.0}, f=["0", "-g*q", "0"])
    t = np.arange(6000) * DT
    load = np.where(t > 6.0, 3.0, 0.0) + 0.5 * np.sin(0.7 * t)
    q, v, path_ = 0.2, 0.0, []
    for k in range(len(t)):
        path_.append((q, v))
        for _ in range(10):
            v += DT / 10 * (-9.0 * q + load[k])
            q += DT / 10 * v
    y = np.array(path_)[:, 0] + 1e-4 * np.random.default_rng(9).standard_normal(t.size)

    def build(ell: float) -> StandardObserver:
        return StandardObserver(3, ell, poles=butterworth(3), model=model)

    def miss(ell: float) -> float:
        x_hat = build(ell).run(t, y, x_hat0=[y[0], 0.0, 0.0]).x_hat
        return float(np.sqrt(np.mean((x_hat[:, 2] - load)[400:] ** 2)))

    result = tune(build, (t, y), state=3)
    assert "no model" not in result.judged_by and result.judged_by
    assert miss(result.ell) < 1.2 * min(miss(g) for g in np.geomspace(2.0, 200.0, 30))
    assert result.errors[2] == pytest.approx(miss(result.ell), rel=0.4)


def test_an_unknown_of_a_model_is_tuned_too() -> None:
    model = hgo.Model(
        states=["q", "v"], parameters={"J": 0.2}, phi="(-v + T)/J", unknown="T", units={"T": "N m"}
    )
    t = np.arange(5000) * DT
    torque = 2.0 * np.sin(1.3 * t)
    q, v, path_ = 0.0, 0.0, []
    for k in range(len(t)):
        path_.append((q, v))
        for _ in range(10):
            v += DT / 10 * (-v + torque[k]) / 0.2
            q += DT / 10 * v
    truth = np.array(path_)
    y = truth[:, 0] + 1e-4 * np.random.default_rng(9).standard_normal(t.size)
    result = tune(model, (t, y), state=2)
    assert error(result.observer, t, y, None, truth[:, 1]) == pytest.approx(
        result.errors[1], rel=0.3
    )


def test_an_output_that_wraps() -> None:
    t = np.arange(5000) * DT
    v = 3.0 + np.sin(2.0 * t)
    y = np.cumsum(v) * DT + 1e-2 * np.random.default_rng(0).standard_normal(t.size)
    turn = 2.0 * np.pi
    whole = tune(lambda ell: StandardObserver(2, ell), (t, y))
    wrapped = tune(lambda ell: StandardObserver(2, ell, wrap=turn), (t, np.mod(y, turn)))
    assert wrapped.ell == pytest.approx(whole.ell, rel=1e-6)
    np.testing.assert_allclose(wrapped.errors, whole.errors, rtol=1e-6)
