"""Loops: feedback of estimates, controllers with states, signals, costs, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

import hgo_rs as hgo
from hgo_rs import HgoError

PENDULUM = hgo.Plant(states=["x1", "x2"], inputs=["u"], drift=["x2", "-10*sin(x1) - x2 + 12*u + 1"])
"""theta'' = -10 sin theta - theta' + 12 u + 1."""
EXTENDED = hgo.Model(states=["x1", "x2", "sigma"], inputs=["u"], f=["0", "-8*sin(x1) + 10*u", "0"])
LAW = {"u": "saturate((-sigma_hat + 8*sin(x1_hat) - x1_hat - 2*x2_hat)/10, -1, 1)"}

CUBE = hgo.Plant(states=["x1", "x2"], inputs=["u"], drift=["x2", "x2**3 + u"])
CUBE_LAW = {"u": "saturate(-x2_hat**3 - x1_hat - x2_hat, -1, 1)"}


def extended(epsilon: float, method: str = "euler") -> hgo.StandardObserver:
    form = {"k": [3.0, 3.0, 1.0], "model": EXTENDED, "timing": "predictor"}
    return hgo.StandardObserver(3, 1.0 / epsilon, method=method, **form)


def standard(ell: float = 50.0, **of: Any) -> hgo.StandardObserver:
    form: dict[str, Any] = {"k": [2.0, 1.0], "method": "rk4", "timing": "predictor"}
    return hgo.StandardObserver(2, ell, **(form | of))


@pytest.mark.parametrize("backend", ["rust", "numpy"])
def test_sampled_loop_has_the_numbers_of_a_loop_by_hand(backend):
    # Extended observer, epsilon = 0.02, T = 1e-3: a float loop of its own gave these.
    want = {
        100: (
            (0.949288832190, -0.437117306682),
            (0.924234214712, -3.912646300086, -124.388548929321),
        ),
        3000: (
            (0.240830840197, -0.175143430855),
            (0.240831152182, -0.175043249766, 0.920598709971),
        ),
    }
    for steps, (x, x_hat) in want.items():
        run = hgo.simulate(
            PENDULUM,
            extended(0.02),
            x0=[1.0, 0.0],
            dt=1e-3,
            steps=steps,
            plant_method="rk4",
            feedback=LAW,
            every=1,
            backend=backend,
        )
        np.testing.assert_allclose(run.final_x[0], x, rtol=0, atol=1e-11)
        np.testing.assert_allclose(run.final_memory[0], x_hat, rtol=0, atol=2e-9)
    # the input that took the plant to sample 3000
    assert run.of("u")["frames"][0, 2999] == pytest.approx(0.109809644657, abs=1e-11)
    assert run.of("u")["peak"][0] == 1.0


@pytest.mark.parametrize(
    ("epsilon", "gaps"), [(0.05, (0.2825482, 1.7040041)), (0.01, (0.0724925, 0.3646387))]
)
def test_joint_loop_recovers_the_performance_of_the_target(epsilon, gaps):
    # suprema on a grid of 2 ms of a stiff solver of high order
    target = hgo.Plant(
        states=["x1", "x2", "s1", "s2"],
        inputs=["u"],
        drift=["x2", "-10*sin(x1) - x2 + 12*u + 1", "s2", "-s1 - 2*s2"],
        output="x1",
    )
    dt = 1e-4 if epsilon > 0.02 else 2e-5
    run = hgo.simulate(
        target,
        extended(epsilon, "rk4"),
        x0=[1.0, 0.0, 1.0, 0.0],
        dt=dt,
        t_end=8.0,
        mode="joint",
        feedback=LAW,
        signals={"gap1": "x1 - s1", "gap2": "x2 - s2"},
        every=round(2e-3 / dt),
    )
    found = [np.abs(run.of(name)["frames"]).max() for name in ("gap1", "gap2")]
    np.testing.assert_allclose(found, gaps, rtol=1e-4)
    if epsilon == 0.01:  # sigma_hat tends to 10 w/a of the equilibrium
        assert run.final_memory[0, 2] == pytest.approx(0.8353129, abs=1e-6)


def test_joint_loop_with_a_controller_that_has_states_is_one_differential_equation():
    # a PI controller on the estimates, its reference a sine
    controller = hgo.Controller(
        {"u": "-4*(x1_hat - r) - 3*x2_hat - 2*c"},
        states=["c"],
        drift=["x1_hat - r"],
        start=[0.3],
        references={"r": "0.5*sin(t)"},
    )
    plant = hgo.Plant(states=["x1", "x2"], inputs=["u"], drift=["x2", "-3*sin(x1) + u"])
    run = hgo.simulate(
        plant,
        standard(20.0),
        x0=[0.4, 0.0],
        dt=1e-3,
        t_end=3.0,
        mode="joint",
        feedback=controller,
        cost="x1**2 + 0.1*u**2",
        every=1000,
    )

    def rate(t, s):
        x1, x2, z1, z2, c, _ = s
        u = -4 * (z1 - 0.5 * np.sin(t)) - 3 * z2 - 2 * c
        e = x1 - z1
        grows = x1**2 + 0.1 * u**2
        return [x2, u - 3 * np.sin(x1), z2 + 40 * e, 400 * e, z1 - 0.5 * np.sin(t), grows]

    exact = solve_ivp(rate, (0, 3), [0.4, 0, 0, 0, 0.3, 0], method="DOP853", rtol=1e-11, atol=1e-12)
    x1, x2, z1, z2, c, cost = exact.y[:, -1]
    np.testing.assert_allclose(run.final_x[0], [x1, x2], atol=1e-7)
    np.testing.assert_allclose(run.final_memory[0], [z1, z2], atol=1e-7)
    assert run.of("c")["final"][0] == pytest.approx(c, abs=1e-7)
    assert run.cost[0] == pytest.approx(cost, rel=1e-6)
    np.testing.assert_allclose(
        run.of("c")["frames"][0], [0.3, *exact_at(rate, (1, 2, 3))], atol=1e-7
    )


def exact_at(rate, times):
    exact = solve_ivp(
        rate, (0, 3), [0.4, 0, 0, 0, 0.3, 0], method="DOP853", rtol=1e-11, atol=1e-12, t_eval=times
    )
    return exact.y[4]


def by_hand(steps, delay, timing="predictor"):
    """A loop in plain floats: a double integrator, Euler everywhere, a recursion as controller."""
    dt, ell = 0.01, 20.0
    x, z, c, queue, u = [0.5, -0.2], [0.0, 0.0], 0.1, [0.0] * delay, 0.0
    rows = []

    def correct(z, y):
        e = y - z[0]
        return [z[0] + dt * 2 * ell * e, z[1] + dt * ell**2 * e]

    for k in range(steps + 1):
        y = x[0] + 0.1 * u  # the output has the input that was in force
        before = z
        if timing == "current":
            # the first correction is for no time at all
            z = correct(z, y) if k else z
        queue.append(-3 * z[0] - 2 * z[1] - c + 0.1 * y)
        u = queue.pop(0)
        rows.append((*x, *z, u, c, x[0] * u))
        if k == steps:
            break
        c = 0.9 * c + 0.01 * z[0]
        if timing == "predictor":
            e = y - before[0]
            z = [
                before[0] + dt * (before[1] + 2 * ell * e),
                before[1] + dt * (u + ell**2 * e),
            ]
        else:
            z = [z[0] + dt * z[1], z[1] + dt * u]
        x = [x[0] + dt * x[1], x[1] + dt * u]
    return np.array(rows)


@pytest.mark.parametrize("backend", ["rust", "numpy"])
@pytest.mark.parametrize("delay", [0, 1, 3])
def test_delay_direct_output_and_recursion_follow_their_order_of_events(backend, delay):
    plant = hgo.Plant(states=["q", "v"], inputs=["u"], drift=["v", "u"], output="q + 0.1*u")
    model = hgo.Model(states=["q", "v"], inputs=["u"], phi="u")
    controller = hgo.Controller(
        {"u": "-3*q_hat - 2*v_hat - c + 0.1*y"},
        states=["c"],
        update=["0.9*c + 0.01*q_hat"],
        start=[0.1],
    )
    for timing in ("predictor", "current"):
        run = hgo.simulate(
            plant,
            standard(20.0, model=model, method="euler", timing=timing),
            x0=[0.5, -0.2],
            dt=0.01,
            steps=60,
            plant_method="euler",
            feedback=controller,
            feedback_delay=delay,
            signals={"power": "q*u"},
            every=1,
            backend=backend,
        )
        found = np.column_stack(
            [
                run.x[0],
                run.x_hat[0],
                run.of("u")["frames"][0],
                run.of("c")["frames"][0],
                run.of("power")["frames"][0],
            ]
        )
        np.testing.assert_allclose(found, by_hand(60, delay, timing), rtol=1e-12, atol=1e-13)


LOOPS: dict[str, dict[str, Any]] = {
    "saturated": {},
    "noise, metrics": {
        "noise": hgo.NormalNoise(std=0.01),
        "windows": [(0.1, 0.5), (0.3, 0.6)],
        "settle": 0.05,
        "settle_signals": {"x1": 0.1, "gap": 0.2},
        "signals": {"x1": "x1", "gap": "x1_hat - x1 + 0.1*sin(t)", "power": "u*x2"},
        "cost": "x1**2 + u**2",
    },
    "delay": {"feedback_delay": 2, "noise": hgo.UniformNoise(low=-0.01, high=0.01)},
    "state": {"feedback_from": "state"},
    "current": {"observer": standard(timing="current", method="zoh")},
    "with model": {
        "observer": standard(model=hgo.Model(states=["x1", "x2"], inputs=["u"], phi="x2**3 + u"))
    },
    "low-power": {
        "observer": hgo.LowPowerObserver(2, 30.0, method="rk4", timing="predictor"),
        "windows": [(0.1, 0.5)],
    },
    "controller": {
        "feedback": hgo.Controller(
            {"u": "saturate(-g*(x1_hat - r) - 2*x2_hat - c - 0*y, -2, 2)"},
            states=["c"],
            drift=["x1_hat - r - 0.1*c"],
            references={"r": "0.2*cos(3*t)"},
            parameters={"g": 3.0},
        ),
        "substeps": 3,
    },
    "joint": {
        "mode": "joint",
        "feedback": hgo.Controller(
            {"u": "saturate(-2*y - 2*x2_hat - c, -2, 2)"}, states=["c"], drift=["y"]
        ),
        "noise": hgo.NormalNoise(std=0.01, sines=[(0.02, 11.0, 0.3)]),
        "windows": [(0.1, 0.5)],
    },
    "a plant with a clock of its own": {
        "plant": hgo.Plant(
            states=["x1", "x2"],
            inputs=["u"],
            drift=["x2", "u - x1*sin(3*t)"],
            output="x1 + 0.05*t",
        ),
        "plant_schedule": hgo.FixedStep(1.1e-3),
    },
    "process noise": {
        "plant": hgo.Plant(
            states=["x1", "x2"],
            inputs=["u"],
            drift=["x2", "-x1 + u"],
            diffusion=["0", "0.3 + 0.1*u"],
        ),
        "plant_method": "euler-maruyama",
    },
}


def loop(name: str, **of: Any) -> hgo.SimulationResult:
    rng = np.random.default_rng(3)
    usual: dict[str, Any] = {
        "plant": CUBE,
        "observer": standard(),
        "x0": rng.uniform(-0.8, 0.8, (40, 2)),
        "runs": 40,
        "dt": 1e-3,
        "steps": 700,
        "feedback": CUBE_LAW,
        "every": 50,
    }
    given = usual | LOOPS[name] | of
    return hgo.simulate(given.pop("plant"), given.pop("observer"), **given)


def numbers(run: hgo.SimulationResult) -> dict[str, Any]:
    parts = {"columns": run.columns, "final": run.final_columns, "y": run.y, "memory": run.memory}
    return parts | run.metrics | {"settling_time": run.settling_time, "at": run.diverged_at}


@pytest.mark.parametrize("name", LOOPS)
def test_engines_have_the_same_bits_and_the_twin_agrees(name):
    ours = loop(name)
    for other in (
        loop(name, engine="interpreter", runs=1, x0=np.random.default_rng(3).uniform(-0.8, 0.8, 2)),
        loop(name, engine="llvm"),
    ):
        rows = len(other.final_x)
        for key, values in numbers(ours).items():
            np.testing.assert_array_equal(numbers(other)[key], values[:rows], err_msg=key)
    twin = loop(name, backend="numpy")
    for key, values in numbers(ours).items():
        np.testing.assert_allclose(
            numbers(twin)[key], values, rtol=1e-8, atol=1e-9, err_msg=f"{name}: {key}"
        )


@pytest.mark.parametrize("engine", ["interpreter", "llvm", "numpy"])
def test_signals_leave_a_plant_with_inputs_of_its_own_as_it_is(engine):
    by = {"backend": "numpy"} if engine == "numpy" else {"engine": engine}
    given: dict[str, Any] = {"x0": [0, 6, 0, 1, 0, 0], "dt": 0.02, "steps": 60, "every": 20}
    observer = hgo.ReducedOrderObserver(0.2, h_bar=[0.5] * 3)
    alone = hgo.simulate(hgo.Ship(), observer, **given, **by)
    signals = {"surge": "x4", "gap": "x4_hat - x4"}
    seen = hgo.simulate(hgo.Ship(), observer, signals=signals, **given, **by)
    np.testing.assert_array_equal(seen.x, alone.x)
    np.testing.assert_array_equal(seen.memory, alone.memory)
    np.testing.assert_array_equal(seen.of("surge")["frames"], alone.x[..., 3])
    gap = alone.memory[..., 0] - alone.x[..., 3]
    np.testing.assert_array_equal(seen.of("gap")["frames"], gap)


def test_a_model_with_an_input_that_no_plant_has_is_refused():
    model = hgo.Model(states=["x1", "x2"], inputs=["u"], phi="u")
    for of in (model, hgo.InputGain(1.0)):
        with pytest.raises(HgoError, match=r"n_u of the observer = 1: must be 0 .*feedback"):
            hgo.simulate(hgo.Lee(), standard(model=of), x0=[1, 0], dt=1e-3, steps=3)


def test_metrics_of_signals_are_those_of_their_frames():
    run = loop("noise, metrics", every=1)
    for name in ("x1", "gap", "power"):
        of = run.of(name)
        frames, t = of["frames"], run.time
        for w, (first, end) in enumerate([(0.1, 0.5), (0.3, 0.6)]):
            part = frames[:, (t > first - 1e-9) & (t < end - 1e-9)]
            np.testing.assert_allclose(of["mean"][:, w], part.mean(axis=1), atol=1e-12)
            np.testing.assert_allclose(of["rms"][:, w], np.sqrt((part**2).mean(axis=1)), rtol=1e-12)
            np.testing.assert_allclose(of["max"][:, w], np.abs(part).max(axis=1), rtol=0)
        np.testing.assert_array_equal(of["peak"], np.abs(frames).max(axis=1))
    for name, level in {"x1": 0.1, "gap": 0.2}.items():
        late = np.abs(run.of(name)["frames"]) >= level
        last = np.where(late.any(axis=1), run.time[::-1][np.argmax(late[:, ::-1], axis=1)], 0.0)
        np.testing.assert_array_equal(run.of(name)["settling_time"], last)
    assert np.isnan(run.of("power")["settling_time"]).all()


def test_cost_of_a_linear_loop_is_the_lyapunov_integral():
    plant = hgo.Plant(states=["x1", "x2"], inputs=["u"], drift=["x2", "u"])
    run = hgo.simulate(
        plant,
        standard(),
        x0=[1.0, 0.5],
        dt=1e-3,
        t_end=30.0,
        mode="joint",
        feedback={"u": "-2*x1_hat - 3*x2_hat"},
        feedback_from="state",
        cost="x1**2 + x2**2 + u**2",
    )
    a, k = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.array([[2.0, 3.0]])
    p = solve_continuous_lyapunov(a.T, -(np.eye(2) + k.T @ k))
    x = np.array([1.0, 0.5])
    assert run.cost[0] == pytest.approx(x @ p @ x, rel=1e-9)


def test_region_of_attraction_counts_what_escapes():
    grid = np.array(np.meshgrid([-1.5, 0.0, 0.5, 1.5], [-1.5, 0.0, 1.5])).reshape(2, -1).T
    run = hgo.simulate(
        CUBE,
        standard(100.0, model=hgo.Model(states=["x1", "x2"], inputs=["u"], phi="x2**3 + u")),
        x0=grid,
        runs=len(grid),
        dt=1e-3,
        t_end=20.0,
        feedback=CUBE_LAW,
        converged=1e-2,
    )

    def settles(start):
        def rate(_, s):
            x1, x2, z1, z2 = s
            u = np.clip(-(z2**3) - z1 - z2, -1, 1)
            e = x1 - z1
            return [x2, x2**3 + u, z2 + 200 * e, z2**3 + u + 1e4 * e]

        def escapes(_, s):
            return 1e3 - np.abs(s[:2]).max()

        escapes.terminal = True
        done = solve_ivp(rate, (0, 20), [*start, 0, 0], method="Radau", events=escapes, rtol=1e-8)
        return done.status == 0 and np.linalg.norm(done.y[:2, -1]) < 1e-2

    np.testing.assert_array_equal(run.converged, [settles(start) for start in grid])
    assert 0 < run.converged.sum() < len(grid)
    assert (run.diverged_at[~run.converged] >= 0).all()


def test_study_of_loops_has_columns_of_their_signals(tmp_path):
    def build(epsilon):
        return {
            "plant": CUBE,
            "observer": standard(1.0 / epsilon),
            "x0": [0.3, 0.1],
            "dt": 1e-3,
            "steps": 400,
            "feedback": CUBE_LAW,
            "noise": hgo.NormalNoise(std=1e-3),
            "windows": [(0.2, 0.4)],
            "cost": "x1**2",
            "converged": 1.0,
            "settle_signals": {"x1": 0.1},
        }

    study = hgo.study(build, grid={"epsilon": [0.05, 0.02]}, runs=12, save=tmp_path / "s.parquet")
    again = hgo.study(build, grid={"epsilon": [0.05, 0.02]}, runs=12, save=tmp_path / "s.parquet")
    table = study.table
    for case in range(2):
        one = study[case]
        assert table["rms_x1"][case] == pytest.approx(one.of("x1")["rms"].mean())
        assert table["peak_u"][case] == pytest.approx(one.of("u")["peak"].mean())
        assert table["settling_time_x1"][case] == pytest.approx(
            one.of("x1")["settling_time"].mean()
        )
        assert table["cost"][case] == pytest.approx(one.cost.mean())
        assert table["converged"][case] == one.converged.mean() == 1.0
        np.testing.assert_array_equal(again[case].of("u")["rms"], one.of("u")["rms"])
    alone = hgo.simulate(**build(0.05), runs=12)
    np.testing.assert_array_equal(study[0].of("x1")["rms"], alone.of("x1")["rms"])
    data = study.to_xarray()
    rms = data["signal_rms"].sel(epsilon=0.02, watched="u").values[:, 0]
    np.testing.assert_array_equal(rms, study[1].of("u")["rms"][:, 0])
    for case in range(2):  # no column hides another
        names = [name for _, i, _, names in study._columns() if i == case for name in names]
        assert len(set(names)) == len(names)


def test_callables_are_traced():
    text = loop("saturated")

    def law(t, y, x_hat):
        return np.clip(-(x_hat[1] ** 3) - x_hat[0] - x_hat[1], -1, 1)

    np.testing.assert_array_equal(loop("saturated", feedback={"u": law}).final_x, text.final_x)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "nothing for an input": ({"feedback": None}, r"feedback = None.*inputs \['u'\].*write"),
    "an input that is none": ({"feedback": {"w": "0"}}, "unknown input of the plant w.*u"),
    "a state": ({"feedback": {"u": "-x1 - x2_hat"}}, "x1 is a state of the plant; write x1_hat"),
    "an unknown name": (
        {"feedback": {"u": "-x3_hat"}},
        "unknown name x3_hat: must be one of pi, t, x1_hat, x2_hat, y;",
    ),
    "an input in a feedback": ({"feedback": {"u": "0.5*u"}}, "u is an input of the plant"),
    "no feedback": ({"feedback": {}}, "a dict of input"),
    "a direct path": (
        {
            "plant": hgo.Plant(
                states=["x1", "x2"], inputs=["u"], drift=["x2", "u"], output="x1 + u"
            ),
            "feedback": {"u": "-y"},
            "mode": "joint",
        },
        "an algebraic loop; leave y out",
    ),
    "a delay in joint mode": ({"mode": "joint", "feedback_delay": 1}, "count samples; take mode"),
    "a delay that is long": ({"feedback_delay": 100}, "feedback_delay = 100"),
    "a recursion in joint mode": (
        {
            "mode": "joint",
            "feedback": hgo.Controller({"u": "-c"}, states=["c"], update=["0.9*c"]),
        },
        "count samples",
    ),
    "a source that is none": ({"feedback_from": "truth"}, "feedback_from = 'truth'"),
    "a signal that is none": ({"settle_signals": {"x3": 0.1}}, "unknown signal x3"),
    "a bound that is none": ({"converged": 0.0}, "converged = 0"),
    "a cost of estimates": ({"cost": "x1_hat**2"}, "unknown name x1_hat"),
    "a model with another input": (
        {"observer": standard(model=hgo.Model(states=["x1", "x2"], inputs=["w"], phi="w"))},
        r"inputs of the plant = \['u'\].*\['w'\]",
    ),
    "a state without truth": (
        {"plant": PENDULUM, "observer": extended(0.05), "feedback": LAW, "feedback_from": "state"},
        "sigma_hat has none",
    ),
    "a callable that is not compiled": (
        {"feedback": {"u": lambda t, y, x_hat: float(x_hat[0])}},
        "is not compiled",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refusals_name_what_is_wrong(name):
    given, says = REFUSED[name]
    LOOPS["refused"] = given
    try:
        with pytest.raises(HgoError, match=says):
            loop("refused", steps=3)
    finally:
        del LOOPS["refused"]


def test_feedback_of_a_plant_without_inputs_is_refused():
    with pytest.raises(HgoError, match="inputs"):
        hgo.simulate(hgo.Lee(), standard(), x0=[0, 0], dt=1e-3, steps=3, feedback={"u": "0"})


def test_controllers_are_checked():
    for given, says in (
        ({"states": ["c"]}, "drift"),
        ({"states": ["c"], "drift": ["0"], "update": ["0"]}, "drift = 'both'"),
        ({"drift": ["0"]}, "drift"),
        ({"states": ["c"], "drift": ["0"], "start": [1, 2]}, "start"),
        ({"states": ["t"], "drift": ["0"]}, "reserved"),
        ({"parameters": {"a": np.nan}}, "finite"),
    ):
        with pytest.raises(HgoError, match=says):
            hgo.Controller({"u": "0"}, **given)


def test_of_names_what_is_there():
    run = loop("saturated")
    with pytest.raises(HgoError, match="unknown signal"):
        run.of("x9")
    with pytest.raises(HgoError, match="without cost"):
        _ = run.cost
    named = loop("saturated", signals={"cost": "x1**2"})
    with pytest.raises(HgoError, match="without cost"):  # a signal of that name is another thing
        _ = named.cost
    with pytest.raises(HgoError, match="signals = 'cost': must be another name beside cost="):
        loop("saturated", signals={"cost": "x1**2"}, cost="x1**2")
    with pytest.raises(HgoError, match="without converged"):
        _ = run.converged
