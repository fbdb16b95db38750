"""Own systems: what depends on time and input, written out in NumPy; what has no value."""

from __future__ import annotations

import math
import threading
import time
import warnings
from typing import Any

import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs import _core

TIMINGS = ("predictor", "current")


def jitter(samples: int, seed: int = 0) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).uniform(0.5e-2, 1.5e-2, samples))


# --- time and input -----------------------------------------------------------------------------


def test_a_sampled_data_model_knows_time_and_input() -> None:
    model = hgo.Model(
        states=["q", "v"],
        inputs=["u"],
        f=["v + 0.1*u", "2*sin(5*t) - q"],
        K_T=["(0.5 + 0.2*u)*(y - h0*q)", "(0.3 + 0.1*sin(3*t))*(y - h0*q)"],
        h="h0*q",
        parameters={"h0": 2.0},
    )
    observer = hgo.SampledDataObserver(model)
    t = jitter(80)
    rng = np.random.default_rng(1)
    y, u = rng.random(80), rng.random(80)
    y[30:33] = np.nan
    x, x_hat, innovation = np.array([0.4, -0.2]), [], []
    for k in range(80):
        x_hat.append(x.copy())
        e = y[k] - 2.0 * x[0]
        innovation.append(e)
        dt = t[k + 1] - t[k] if k < 79 else 0.0
        rate = np.array([x[1] + 0.1 * u[k], 2.0 * math.sin(5 * t[k]) - x[0]])
        gain = np.array([0.5 + 0.2 * u[k], 0.3 + 0.1 * math.sin(3 * t[k])])
        x = x + dt * rate + (0.0 if np.isnan(e) else gain * e)
    result = observer.run(t, y, u, x_hat0=[0.4, -0.2])
    assert np.allclose(result.x_hat, x_hat, rtol=1e-12, atol=1e-14)
    assert np.allclose(result.innovation[:, 0], innovation, rtol=1e-12, equal_nan=True)
    observer.reset([0.4, -0.2])
    observer._time = t[0]
    for k in range(79):
        stepped = observer.step(y[k], u[k], dt=t[k + 1] - t[k])
        assert np.allclose(stepped, x_hat[k + 1], rtol=1e-9)


def test_a_strict_feedback_model_knows_time_and_input() -> None:
    model = hgo.Model(
        states=["x", "z"], inputs=["u"], f1=["0"], g=[["1"]], f2=["3*sin(5*t) - z + u*cos(t)"]
    )
    observer = hgo.ReducedOrderObserver(0.05, h_bar=[0.5], model=model)
    t = jitter(100)
    rng = np.random.default_rng(2)
    y, u, h = np.cumsum(rng.random(100)) * 1e-2, rng.random(100), 0.5 / 0.05
    z, x_hat = 0.0, [0.0]
    for k in range(1, 100):
        dt = t[k] - t[k - 1]
        psi = (y[k] - y[k - 1]) / dt
        f2 = 3 * math.sin(5 * t[k - 1]) - psi + u[k - 1] * math.cos(t[k - 1])
        z = z + dt * (h * (psi - z) + f2)
        x_hat.append(z)
    result = observer.run(t, y, u)
    assert np.allclose(result.x_hat[:, 0], x_hat, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("runs", [1, 40])
def test_output_and_diffusion_of_a_plant_know_the_time(runs: int) -> None:
    plant = hgo.Plant(
        states=["q", "v"],
        drift=["v", "-q"],
        diffusion=["0", "0.1*sin(5*t)"],
        output="q + 10*sin(5*t)",
    )
    still = hgo.Plant(states=["q", "v"], drift=["v", "-q"], diffusion=["0", "0.1"], output="q")
    observer = hgo.StandardObserver(2, 20.0, method="euler", timing="predictor")
    every: dict[str, Any] = {"every": 1} if runs == 1 else {}
    common = {"x0": [1.0, 0.0], "dt": 1e-2, "steps": 60, "runs": runs, "rng": 3}
    a = hgo.simulate(plant, observer, **common, **every)
    b = hgo.simulate(still, observer, **common, **every)
    # Euler-Maruyama: x(k+1) = A x(k) + b(t(k)) dW(k), with dW of the plant of constant diffusion
    if runs == 1:
        assert a.x is not None and b.x is not None and a.y is not None
        t = np.arange(61) * 1e-2
        assert np.allclose(a.y[0, :, 0], a.x[0, :, 0] + 10 * np.sin(5 * t), atol=1e-12)
        x = b.x[0]
        dw = (x[1:, 1] - x[:-1, 1] + 1e-2 * x[:-1, 0]) / 0.1
        q, v = 1.0, 0.0
        for k in range(60):
            q, v = q + 1e-2 * v, v - 1e-2 * q + 0.1 * math.sin(5 * t[k]) * dw[k]
        assert np.allclose(a.final_x[0], [q, v], rtol=1e-9)
    # the observer sees that output
    gain, x_hat = 20.0 * np.array(observer.spec["k"]) * [1.0, 20.0], np.zeros(2)
    one = hgo.simulate(plant, observer, **{**common, "runs": 1}, every=1)
    assert one.y is not None
    for y in one.y[0, :-1, 0]:
        x_hat = x_hat + 1e-2 * (np.array([x_hat[1], 0.0]) + gain * (y - x_hat[0]))
    assert np.allclose(one.final_memory[0], x_hat, rtol=1e-9)
    assert np.array_equal(one.final_memory[0], a.final_memory[0])


@pytest.mark.parametrize("timing", TIMINGS)
def test_chains_know_time_and_input(timing: str) -> None:
    chain = {"gain": 20.0, "method": "zoh", "timing": timing}
    both = hgo.MultiOutputObserver(
        [hgo.StandardObserver(2, **chain), hgo.StandardObserver(2, **chain)],
        model=hgo.Model(
            states=["p", "v", "q", "w"],
            inputs=["a"],
            orders=[2, 2],
            phi=["3*sin(5*t) - p + a", "a*cos(t) - w"],
        ),
    )
    t = jitter(120)
    rng = np.random.default_rng(3)
    y, a = rng.random((120, 2)), rng.random(120)
    y[40:50, 0] = np.nan
    result = both.run(t, y, a)
    for i, phi in enumerate(("3*sin(5*t) - x + a", "a*cos(t) - d")):
        alone = hgo.StandardObserver(
            2, model=hgo.Model(states=["x", "d"], inputs=["a"], phi=phi), **chain
        ).run(t, y[:, i], a)
        assert np.array_equal(alone.x_hat, result.x_hat[:, 2 * i : 2 * i + 2])


CHAINS = hgo.Model(states=["a", "b", "c"], orders=[2, 1], phi=["-a + c", "-c"])


def two_outputs(law: str, timing: str = "current") -> hgo.MultiOutputObserver:
    if law == "filter":
        parts: list[Any] = [hgo.HighGainEKF(n, R=1e-4, Q=1.0) for n in (2, 1)]
    else:
        gains = hgo.AdaptiveGain(1.0, 0.1, 0.2), 20.0
        makers = hgo.LowPowerObserver, hgo.StandardObserver
        manner: dict[str, Any] = {"timing": timing, "method": "rk4"}
        parts = [make(n, g, **manner) for make, n, g in zip(makers, (2, 1), gains, strict=True)]
    return hgo.MultiOutputObserver(parts, model=CHAINS)


@pytest.mark.parametrize("law", ["chains", "filter"])
def test_errors_of_several_outputs_are_of_estimates(law: str) -> None:
    plant = hgo.Plant(states=["a", "b", "c"], drift=["b", "-a + c", "-c"], output=["a", "c"])
    given = {
        "dt": 0.01,
        "steps": 50,
        "x0": [1.0, 0.3, 0.5],
        "runs": 2,
        "noise": hgo.NormalNoise(std=0.01),
    }
    both = [
        hgo.simulate(plant, two_outputs(law), backend=backend, **given)
        for backend in ("rust", "numpy")
    ]
    for name in ("rms", "max", "mean", "peak"):
        ours, theirs = (getattr(result, name) for result in both)
        assert ours.shape[-1] == 3
        assert np.allclose(ours, theirs, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("law", ["chains", "filter"])
def test_times_of_corrections_are_checked_of_each_output(law: str) -> None:
    observer = two_outputs(law)
    start = observer.initial_memory()
    y = np.full((20, 2), 0.2)
    times = [len(start) - 2, len(start) - 1]
    if law == "chains":  # x_hat (3), eta, r and the time of the first, the time of the second
        times = [5, 6]
    shown = observer.run(0.01, y)
    rest = np.delete(shown.memory, [0, 1, 2, *times], axis=1)
    assert np.array_equal(shown.auxiliary, rest)
    for at in times:
        assert np.allclose(shown.memory[1:, at], 0.0)
        wrong = start.copy()
        wrong[at] = -0.1
        with pytest.raises(hgo.HgoError, match=rf"memory\[{at}\] = -0.1: must be >= 0"):
            observer.memory = wrong
    # a first correction for too long a time, of one output
    waits = start.copy()
    waits[times[1]] = 5.0
    if law == "filter":
        assert observer.run(0.01, y, memory0=waits).x_hat.shape == (20, 3)
        return
    with pytest.raises(hgo.HgoError, match=r"before sample 0.*standard observer by rk4"):
        observer.run(0.01, y, memory0=waits)
    y[0, 1] = np.nan  # nothing is corrected for that time
    assert observer.run(0.01, y, memory0=waits).x_hat.shape == (20, 3)


def test_what_several_outputs_and_filters_do_not_take_is_told_in_a_line() -> None:
    both = two_outputs("chains")
    for figure in (both.bandwidth, both.noise_gain, both.peaking, both.settling):
        with pytest.raises(hgo.HgoError, match="'chains': must be a law of one output; call"):
            figure()
    with pytest.raises(hgo.HgoError, match=r"wrap = 6.28: must be left out; give it where"):
        hgo.MultiOutputObserver([], model=CHAINS, wrap=6.28)  # type: ignore[arg-type]
    with pytest.raises(hgo.HgoError, match=r"shape = .*must be left out: P assumes"):
        hgo.HighGainEKF(2, R=1.0, Q=1.0, shape=hgo.Stubborn(5.0, 20.0))  # type: ignore[arg-type]


def test_another_timing_of_several_outputs_is_that_of_each() -> None:
    with pytest.raises(hgo.HgoError, match="make the observer of each output with timing="):
        two_outputs("chains").with_timing("predictor")


def test_a_slope_that_a_correction_cannot_know_is_refused() -> None:
    """Also where a spec comes without the class that sees to it."""
    model = hgo.Model(states=["q", "v"], inputs=["u"], unknown="d", phi="u - q + (2 + cos(q))*d")
    spec = hgo.StandardObserver(3, 5.0, model=model).spec
    table = spec["model"]["table"]
    _core.Observer(spec)
    at = len(table["outputs"]) - 1
    for index in (0, table["inputs"].index("u[0]")):
        outputs = [*table["outputs"][:at], index]
        wrong = {**spec, "model": {**spec["model"], "table": {**table, "outputs": outputs}}}
        with pytest.raises(ValueError, match="nonlinear chain depends on time or an input"):
            _core.Observer(wrong)


# --- models without a value ---------------------------------------------------------------------


@pytest.mark.parametrize("timing", TIMINGS)
@pytest.mark.parametrize("sample", [1.0, np.nan])
def test_step_and_run_tell_the_equation_and_keep_the_memory(timing: str, sample: float) -> None:
    model = hgo.Model(states=["depth", "rate"], phi="log(depth)")
    observer = hgo.StandardObserver(2, 3.0, model=model, timing=timing)
    told = r"phi = log\(depth\) is not finite at depth = -?[\d.]+, rate = .*; start x_hat0"
    with pytest.raises(hgo.HgoError, match=rf"sample 0 \(t = 0 s\).*{told}"):
        observer.run(0.01, np.full(9, sample), x_hat0=[-1.0, 5.0])
    observer.reset([-1.0, 5.0])
    observer._started = True  # the call is for the end of a period
    before = observer.memory.copy()
    with pytest.raises(hgo.HgoError, match=told):
        observer.step(sample, dt=0.01)
    assert np.array_equal(observer.memory, before) and observer._time == 0.0


def test_the_start_that_is_proposed_helps() -> None:
    observer = hgo.StandardObserver(2, 25.0, model=hgo.Model(states=["q", "v"], phi="1/q"))
    y = 2 + 0.5 * np.sin(4e-3 * np.arange(2000))
    with pytest.raises(hgo.HgoError, match=r"phi = 1/q .* x_hat0 = \[2, 0\]"):
        observer.run(2e-3, y)
    assert np.isfinite(observer.run(2e-3, y, x_hat0=[2.0, 0.0]).x_hat).all()


@pytest.mark.parametrize("timing", TIMINGS)
def test_several_outputs_of_which_one_is_missing(timing: str) -> None:
    model = hgo.Model(states=["p", "v", "q", "w"], orders=[2, 2], phi=["-log(q)", "0*q"])
    chain = {"gain": 20.0, "method": "zoh", "timing": timing}
    both = hgo.MultiOutputObserver(
        [hgo.StandardObserver(2, **chain) for _ in range(2)], model=model
    )
    y = np.column_stack((1.0 + 1e-2 * np.arange(50), np.full(50, np.nan)))
    start = both.initial_memory([0, 0, -1.0, 0])
    with pytest.raises(hgo.HgoError, match=r"sample 0.*phi\[0\] = -log\(q\).* q = -1"):
        both.run(1e-2, y, memory0=start)
    both.memory = start
    both._started = True
    with pytest.raises(hgo.HgoError, match=r"phi\[0\] = -log\(q\)"):
        both.step([1.0, np.nan], dt=1e-2)


def test_no_other_model_is_a_ship() -> None:
    with pytest.raises(hgo.HgoError) as told:
        hgo.StandardObserver(2, 20.0, model=hgo.Model(states=["q", "v"], phi="sqrt(q - 1)")).run(
            1e-3, np.zeros(5)
        )
    assert "ship" not in str(told.value)
    ship = hgo.ReducedOrderObserver(0.1)
    with pytest.raises(hgo.HgoError, match="a ship at rest has no course angle"):
        ship.run(0.01, np.zeros((5, 3)), np.zeros((5, 2)))


@pytest.mark.parametrize("timing", TIMINGS)
@pytest.mark.parametrize("mode", ["sampled", "joint"])
def test_studies_say_undefined_at(timing: str, mode: str) -> None:
    if mode == "joint" and timing == "current":
        return
    model = hgo.Model(states=["q", "v"], phi="-q + 0*sqrt(1.5 - t)")
    plant = hgo.Plant(states=["q", "v"], drift=["v", "-q"])
    observer = hgo.StandardObserver(2, 5.0, model=model, method="rk4", timing=timing)
    for runs in (1, 40):
        result = hgo.simulate(
            plant, observer, x0=[0.5, 0.0], dt=0.1, steps=30, runs=runs, mode=mode, rng=1
        )
        # the step from 1.4 s ends at 1.5 s, that from 1.5 s lies beyond it
        assert set(result.undefined_at.tolist()) <= {14, 15}
        assert len(set(result.undefined_at.tolist())) == 1
        assert set(result.diverged_at.tolist()) == {-1}
        assert np.isfinite(result.final_memory).all()


# --- what a study compares with -----------------------------------------------------------------


@pytest.mark.parametrize("runs", [1, 40])
def test_a_reduced_order_observer_is_compared_with_its_states(runs: int) -> None:
    model = hgo.Model(states=["x", "z"], f1=["0"], g=[["1"]], f2=["-x - 0.5*z"])
    observer = hgo.ReducedOrderObserver(0.05, h_bar=[0.5], model=model)
    plant = hgo.Plant(states=["x", "z"], drift=["z", "-x - 0.5*z"])
    common = {"x0": [1.0, 0.3], "dt": 1e-2, "steps": 100}
    kept = hgo.simulate(plant, observer, every=1, windows=[(0.5, 1.01)], **common)
    assert kept.y is not None and kept.x is not None and kept.x_hat is not None
    alone = observer.run(1e-2, kept.y[0, :, 0])
    assert np.array_equal(kept.x_hat[0], alone.x_hat)
    error = alone.x_hat[50:, 0] - kept.x[0, 50:, 1]
    assert 0.0 < np.sqrt(np.mean(error**2)) < 0.05
    many = hgo.simulate(plant, observer, windows=[(0.5, 1.01)], runs=runs, **common)
    for result in (kept, many):
        assert result.rms[0, 0, 0] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
    for other in (
        hgo.Plant(states=["a", "b"], drift=["b", "-a"]),
        hgo.Plant(states=["x", "b"], drift=["b", "-x"]),
    ):
        with pytest.raises(hgo.HgoError, match="states of the plant"):
            hgo.simulate(other, observer, **common)


@pytest.mark.parametrize("runs", [1, 40])
def test_states_are_compared_by_name(runs: int) -> None:
    model = hgo.Model(states=["q", "v"], phi="-q")
    observer = hgo.StandardObserver(2, 20.0, model=model)
    a = hgo.Plant(states=["q", "v"], drift=["v", "-q - 0.1*sin(3*t)"])
    b = hgo.Plant(states=["v", "q"], drift=["-q - 0.1*sin(3*t)", "v"], output="q")
    common: dict[str, Any] = {"dt": 1e-2, "t_end": 2, "runs": runs, "windows": [(0.5, 1)]}
    common["noise"] = hgo.UniformNoise(-0.1, 0.1)
    if runs == 1:
        common["every"] = 10
    one = hgo.simulate(a, observer, x0=[1, 0.5], **common)
    two = hgo.simulate(b, observer, x0=[0.5, 1], **common)
    assert np.array_equal(one.rms, two.rms)
    assert np.array_equal(one.final_x, two.final_x[:, ::-1])
    if runs == 1:
        assert one.x is not None and two.x is not None
        assert np.array_equal(one.x, two.x[..., ::-1])
    with pytest.raises(hgo.HgoError, match=r"give the states .* the same names"):
        hgo.simulate(hgo.Plant(states=["a", "q"], drift=["q", "-a"]), observer, x0=[1, 1], **common)


# --- uneven times, threads, interrupts ----------------------------------------------------------


def test_uneven_times_cost_no_table_a_sample() -> None:
    t = np.cumsum(np.random.default_rng(0).uniform(0.5e-3, 1e-3, 4000))
    y = np.sin(t)
    model = hgo.Model(states=list("abcdefgh"), phi="-a")
    own = hgo.LowPowerObserver(8, 20.0, model=model, method="zoh")
    built_in = hgo.LowPowerObserver(8, 20.0, method="zoh")

    def seconds(observer: hgo.Observer) -> float:
        best = math.inf
        for _ in range(3):
            start = time.process_time()
            observer.run(t, y)
            best = min(best, time.process_time() - start)
        return best

    assert seconds(own) < 5.0 * seconds(built_in)


def test_a_run_and_steps_of_one_observer_in_two_threads() -> None:
    t = np.cumsum(np.random.default_rng(0).uniform(0.5e-3, 1e-3, 2000))
    observer = hgo.LowPowerObserver(
        4, 20.0, model=hgo.Model(states=list("abcd"), phi="-a"), method="zoh"
    )
    expected = observer.run(t, np.sin(t)).memory
    found = []
    other = threading.Thread(
        target=lambda: found.extend(observer.run(t, np.sin(t)).memory for _ in range(3)),
        daemon=True,
    )
    other.start()
    for dt in np.random.default_rng(1).uniform(0.5e-3, 1e-3, 2000):
        observer.step(0.1, dt=float(dt))
    other.join(60.0)
    assert not other.is_alive() and len(found) == 3
    assert all(np.array_equal(memory, expected) for memory in found)


# --- callables that cannot be traced ------------------------------------------------------------

FORMS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "phase": (
        {"phi": lambda t, x, u: math.sin(5 * float(t)) - float(x[0]) + float(u[0])},
        {"phi": "sin(5*t) - a + u"},
    ),
    "triangular": (
        {
            "f": lambda t, x, u: [
                -0.1 * float(x[0]),
                math.sin(5 * float(t)) - float(x[1]) + float(u[0]),
            ]
        },
        {"f": ["-0.1*a", "sin(5*t) - b + u"]},
    ),
    "sampled": (
        {
            "f": lambda t, x, u: [float(x[1]), math.sin(5 * float(t)) - float(x[0])],
            "K_T": lambda t, x, u, y, T: [
                (float(y) - 2 * float(x[0])) * float(u[0]) * float(T),
                0.0,
            ],
            "h": lambda t, x, u: 2 * float(x[0]),
        },
        {"f": ["b", "sin(5*t) - a"], "K_T": ["(y - 2*a)*u*T", "0"], "h": "2*a"},
    ),
    "strict-feedback": (
        {
            "f1": ["0"],
            "g": [["1"]],
            "f2": lambda t, x, z, u: math.sin(5 * float(t)) - float(z[0]) + float(u[0]),
        },
        {"f1": ["0"], "g": [["1"]], "f2": ["sin(5*t) - b + u"]},
    ),
}


def observers_of(model: hgo.Model) -> list[hgo.Observer]:
    if model.form == "sampled":
        return [hgo.SampledDataObserver(model)]
    if model.form == "strict-feedback":
        return [hgo.ReducedOrderObserver(0.05, h_bar=[0.5], model=model)]
    laws: list[Any] = [hgo.StandardObserver]
    if model.form == "phase":
        laws.append(hgo.LowPowerObserver)
    return [
        law(2, 5.0, model=model, method=method, timing=timing)
        for law in laws
        for method in ("euler", "rk4", "bogacki-shampine", "zoh")
        for timing in TIMINGS
    ]


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("form", FORMS)
def test_a_callable_has_the_law_of_the_core(form: str) -> None:
    called, written = (hgo.Model(states=["a", "b"], inputs=["u"], **sides) for sides in FORMS[form])
    assert not called.compiled and written.compiled
    t = jitter(60)
    rng = np.random.default_rng(4)
    y, u = rng.random(60), rng.random(60)
    y[20:24] = np.nan
    for slow, fast in zip(observers_of(called), observers_of(written), strict=True):
        a, b = slow.run(t, y, u), fast.run(t, y, u)
        assert np.allclose(a.memory, b.memory, rtol=1e-11, atol=1e-13), fast.spec
        assert np.allclose(a.innovation, b.innovation, rtol=1e-9, atol=1e-12, equal_nan=True)
        for k in range(30):
            at = {"dt": float(t[k + 1] - t[k])}
            stepped = slow.step(y[k], u[k], **at), fast.step(y[k], u[k], **at)
            assert np.allclose(*stepped, rtol=1e-11, atol=1e-13)


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError])
def test_an_error_of_a_callable_ends_the_run(error: type[BaseException]) -> None:
    late = [10**9]

    def phi(t: float, x: np.ndarray, u: np.ndarray) -> float:
        late[0] -= 1
        if late[0] < 0:
            raise error("asked for")
        return -float(x[0])

    observer = hgo.StandardObserver(
        2, 20.0, model=hgo.Model(states=["q", "v"], phi=phi), method="zoh"
    )
    t = jitter(200)
    for count in (0, 3, 150):
        late[0] = count
        with pytest.raises(error, match="asked for"):
            observer.run(t, np.sin(t))
    late[0] = 0
    observer._started = True
    before = observer.memory.copy()
    with pytest.raises(error, match="asked for"):
        observer.step(0.1, dt=0.01)
    assert np.array_equal(observer.memory, before)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_callable_without_a_value_is_not_called_again_and_again() -> None:
    calls = [0]

    def phi(t: float, x: np.ndarray, u: np.ndarray) -> float:
        calls[0] += 1
        return math.nan if float(x[0]) < 0 else 0.0

    observer = hgo.StandardObserver(2, 20.0, model=hgo.Model(states=["q", "v"], phi=phi))
    calls[0] = 0
    with pytest.raises(hgo.HgoError, match="phi = a Python function is not finite at q = -1"):
        observer.run(1e-3, np.zeros(400), x_hat0=[-1.0, 0.0])
    assert calls[0] < 50


def test_a_compiled_model_warns_of_nothing() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hgo.StandardObserver(2, 20.0, model=hgo.Model(states=["q", "v"], phi="-q")).run(
            1e-3, np.zeros(9)
        )


def called_plant() -> hgo.Plant:
    return hgo.Plant(
        states=["q", "v"],
        drift=lambda t, x: [float(x[1]), math.sin(3 * float(t)) - float(x[0])],
        output=lambda t, x: float(x[0]) + 0.1 * float(t),
    )


@pytest.mark.parametrize("timing", TIMINGS)
@pytest.mark.parametrize("method", ["euler", "rk4", "zoh"])
def test_a_simulation_of_callables_has_the_numbers_of_expressions(method: str, timing: str) -> None:
    model = hgo.Model(states=["q", "v"], phi=lambda t, x, u: math.sin(3 * float(t)) - float(x[0]))
    written = hgo.Model(states=["q", "v"], phi="sin(3*t) - q")
    plant = hgo.Plant(states=["q", "v"], drift=["v", "sin(3*t) - q"], output="q + 0.1*t")
    assert not model.compiled and not called_plant().compiled
    common: dict[str, Any] = {"x0": [1.0, 0.0], "dt": 1e-2, "steps": 60, "runs": 2, "rng": 3}
    common |= {"noise": hgo.UniformNoise(-0.01, 0.01), "windows": [(0.1, 0.6)]}
    how = {"method": method, "timing": timing}
    modes = ["sampled", "joint"] if (method, timing) == ("rk4", "predictor") else ["sampled"]
    for mode in modes:
        a = hgo.simulate(
            called_plant(), hgo.StandardObserver(2, 10.0, model=model, **how), mode=mode, **common
        )
        b = hgo.simulate(
            plant, hgo.StandardObserver(2, 10.0, model=written, **how), mode=mode, **common
        )
        assert np.allclose(a.final_x, b.final_x, rtol=1e-12)
        assert np.allclose(a.final_memory, b.final_memory, rtol=1e-10)
        assert np.allclose(a.rms, b.rms, rtol=1e-10)


@pytest.mark.parametrize("of", ["plant", "model"])
def test_an_error_of_a_callable_ends_a_simulation(of: str) -> None:
    late = [math.inf]

    def fails(t: float, x: np.ndarray, *_: Any) -> Any:
        if float(t) > late[0]:
            raise ZeroDivisionError("asked for")
        return -float(x[0])

    plant: hgo.System = hgo.Plant(states=["q", "v"], drift=["v", "-q"])
    model = None
    if of == "plant":
        plant = hgo.Plant(states=["q", "v"], drift=["v", fails])
    else:
        model = hgo.Model(states=["q", "v"], phi=fails)
    late[0] = 0.3
    with pytest.raises(ZeroDivisionError, match="asked for"):
        hgo.simulate(
            plant, hgo.StandardObserver(2, 10.0, model=model), x0=[1, 0], dt=1e-2, steps=90, runs=4
        )


def test_a_reduced_order_observer_tells_its_states() -> None:
    model = hgo.Model(states=["x", "z"], f1=["0"], g=[["1"]], f2=["log(z)"])
    observer = hgo.ReducedOrderObserver(0.05, h_bar=[0.5], model=model)
    told = r"f2\[0\] = log\(z\) is not finite at x = -1, z = 0"
    with pytest.raises(hgo.HgoError, match=rf"sample 1 .*{told}"):
        observer.run(1e-2, -np.arange(5.0))
    observer.step(0.0, dt=1e-2)
    with pytest.raises(hgo.HgoError, match=told):
        observer.step(-1.0, dt=1e-2)


OSCILLATOR = {"states": ["q", "w"], "drift": ["w", "-q"]}


@pytest.mark.parametrize(("output", "waited"), [("q + 0*sqrt(q + 0.8)", 0.0), ("q", 0.4)])
def test_a_studys_correction_is_for_the_time_that_has_passed(output: str, waited: float) -> None:
    """Where the plant's output has no value the sample is missing; a memory may have waited."""
    plant = hgo.Plant(**OSCILLATOR, output=output)
    observer = hgo.StandardObserver(2, 5.0)
    start = observer.initial_memory()
    start[-1] = waited
    core, twin = (
        hgo.simulate(
            plant,
            observer,
            x0=[1.0, 0.0],
            dt=0.05,
            steps=200,
            every=1,
            backend=backend,
            memory0=start,
        )
        for backend in ("rust", "numpy")
    )
    rest = np.cos(0.05 * np.arange(201))  # the exact solution
    assert np.isnan(core.y).sum() == (np.sum(rest < -0.8) if "sqrt" in output else 0)
    np.testing.assert_allclose(core.memory, twin.memory, rtol=1e-9, atol=1e-12)
