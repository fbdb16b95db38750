"""Nonlinear chains, and blocks of several outputs: numbers, identities, the twin, refusals."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_continuous_lyapunov

import hgo_rs
from hgo_rs import _core, reference
from hgo_rs.errors import HgoError

METHODS = ("euler", "staggered-euler", "rk4", "rk4-innovation-held", "bogacki-shampine")
SLOPED = hgo_rs.Model(
    states=["a", "b", "c"],
    inputs=["u"],
    parameters={"p": 0.3},
    f=["b**3 + 0.2*sin(2*t)", "p*c*cos(a) - 0.1*a*b + u", "-a - c + 0.4*u*cos(t)"],
)
"""Slopes 1 + 3 b^2 and 1 + p cos(a), which time and input do not move."""


def noisy(samples: int = 200) -> tuple[Any, Any, Any]:
    """Uneven times, samples with gaps, inputs."""
    rng = np.random.default_rng(4)
    t = np.cumsum(np.where(np.arange(samples) % 9 == 4, 2.0**-6, 2.0**-7)) - 2.0**-7
    y = np.sin(t) + rng.normal(0.0, 0.01, samples)
    y[rng.random(samples) < 0.1] = np.nan
    return t, y, np.cos(3.0 * t)


@pytest.mark.parametrize("backend", ["rust", "numpy"])
def test_a_nonlinear_chain_meets_its_numbers(backend: Any) -> None:
    model = hgo_rs.Model(states=["x1", "x2"], f=["x2**3", "-x1 - x2"])
    manner: Any = {"method": "rk4", "timing": "predictor"}
    law = hgo_rs.StandardObserver(2, 20.0, k=(2.0, 1.0), model=model, **manner)
    run = hgo_rs.simulate(
        model.plant(), law, dt=2.5e-4, steps=4001, x0=[1.0, 0.5], every=800, mode="joint",
        plant_method="rk4", backend=backend,
    )  # fmt: skip
    assert run.memory is not None and run.x is not None
    told = {
        1: ((1.081717319, 0.219261880), (1.107924745, 0.578783437)),
        5: ((0.913123874, -0.473380779), (0.913123868, -0.473380866)),
    }
    for row, (x, x_hat) in told.items():
        assert run.x[0, row] == pytest.approx(x, rel=1e-7)
        assert run.memory[0, row] == pytest.approx(x_hat, rel=1e-7)


@pytest.mark.parametrize("timing", ["predictor", "current"])
@pytest.mark.parametrize("method", [*METHODS, "zoh", "bilinear"])
@pytest.mark.parametrize("law", ["standard", "filtered"])
def test_core_and_twin_agree(law: str, method: str, timing: str) -> None:
    if law == "filtered" and method in ("zoh", "bilinear"):
        return
    more: Any = {"filters": 2} if law == "filtered" else {}
    observer = hgo_rs.HighGainObserver(
        law, 3, 6.0, model=SLOPED, method=method, timing=timing, **more
    )
    t, y, u = noisy()
    start = observer.initial_memory([0.2, 0.1, 0.0])
    ours = observer.run(t, y, u, memory0=start).memory
    theirs = reference.Observer(observer.spec).run(t, y, u[:, None], start)["memory"]
    assert ours == pytest.approx(theirs, rel=1e-10, abs=1e-10)
    observer.reset(memory0=start)
    for k, shown in enumerate(ours[:-1]):  # on line too
        if timing == "current":
            observer.correct(y[k])
            assert np.array_equal(observer.memory, shown)
            observer.predict(u[k], dt=t[k + 1] - t[k])
        else:
            assert np.array_equal(observer.memory, shown)
            observer.step(y[k], u[k], dt=t[k + 1] - t[k])


@pytest.mark.parametrize("n", range(1, 7))
def test_the_gain_of_the_lyapunov_equation_has_all_poles_at_minus_1(n: int) -> None:
    """S + A'S + SA = C'C: S^-1 C' is what the standard law takes for n poles at -1."""
    moved, c = np.eye(n, k=1) + 0.5 * np.eye(n), np.eye(n)[0]
    s = solve_continuous_lyapunov(moved.T, np.outer(c, c))
    poles: Any = [-1.0] * n
    k = hgo_rs.StandardObserver(n, 9.0, poles=poles, method="euler").spec["k"]
    assert np.linalg.solve(s, c) == pytest.approx(list(k), rel=1e-7)


@pytest.mark.parametrize("timing", ["predictor", "current"])
@pytest.mark.parametrize("method", [*METHODS, "zoh"])
def test_constant_slopes_are_units_of_the_states(method: str, timing: str) -> None:
    """s b in the place of x_2: the standard law, its estimate over s. Under zoh what is beside the
    chain moves by RK4.
    """
    s, r = 2.5, -0.7
    scaled = hgo_rs.Model(
        states=["a", "b", "c"],
        inputs=["u"],
        f=[f"{s - 1.0}*b", f"{r - 1.0}*c", "u - sin(a) - c"],
    )
    side = f"{s * r}*u - {s * r}*sin(a) - c"
    plain = hgo_rs.Model(states=["a", "b", "c"], inputs=["u"], phi=side)
    manner: Any = {"method": method, "timing": timing}
    t, y, u = noisy()
    one, two = (
        hgo_rs.StandardObserver(3, 8.0, model=model, **manner).run(t, y, u).x_hat
        for model in (scaled, plain)
    )
    assert one * [1.0, s, s * r] == pytest.approx(
        two, rel=1e-9, abs=1e-6 if method == "zoh" else 1e-11
    )
    assert scaled.slopes_at(np.zeros(3)) == pytest.approx([1.0, s, s * r], rel=1e-14)


def test_the_error_converges_where_the_plain_law_has_the_wrong_slope() -> None:
    """Under a slope of 13 the gain of the plain chain would be 13 times too high."""
    model = hgo_rs.Model(states=["x1", "x2"], f=["x2**3", "-x1 - 0.1*(x2 - 2)"])
    solved = solve_ivp(
        lambda _, x: [x[1] + x[1] ** 3, -x[0] - 0.1 * (x[1] - 2.0)],
        (0.0, 2.0), [0.0, 2.0], rtol=1e-10, atol=1e-10, t_eval=np.arange(2001) * 1e-3,
    )  # fmt: skip
    law = hgo_rs.StandardObserver(2, 40.0, model=model)
    result = law.run(1e-3, solved.y[0], x_hat0=[0.0, 1.0])
    error = np.abs(result.x_hat[:, 1] - solved.y[1])
    assert error[0] > 0.9 and error[500:].max() < 1e-4
    assert law.noise_gain(1e-3)[1] < hgo_rs.StandardObserver(2, 40.0).noise_gain(1e-3)[1] * 1.01
    law.memory = result.memory[0]
    at = law.units
    assert at == pytest.approx([1.0, 4.0]) and np.isfinite(result.error_after(result.gaps)).all()


def test_a_box_keeps_the_slope() -> None:
    with pytest.raises(HgoError, match=r"slope of f\[0\] in b, 1 \+ cos\(b\), .*give box=\{\"b\""):
        hgo_rs.Model(states=["a", "b"], f=["sin(b)", "-a"])
    model = hgo_rs.Model(states=["a", "b"], f=["sin(b)", "-a"], box={"b": (-2.0, 2.0)})
    assert model.slopes_at([0.0, 3.0])[1] == pytest.approx(1.0 + np.cos(2.0))
    assert hgo_rs.Model(**model.as_arguments()) == model
    assert model.unknown == () and model.form == "nonlinear-chain"
    assert model.unknown_slope()["b"][0] == pytest.approx(1.0 + np.cos(2.0), rel=1e-6)


@pytest.mark.parametrize(
    ("f", "told"),
    [
        (["b", "-a"], "with the slope 1, which the chain .* has already"),
        (["b*u", "-a"], "depends on u: must depend on states and parameters only"),
        (["b*sin(t)", "-a"], "depends on t: must depend on states and parameters only"),
        (["c + b**3", "0", "-a"], "depends on c, so that the model is not triangular"),
    ],
)
def test_what_is_no_such_chain_is_refused(f: list[str], told: str) -> None:
    with pytest.raises(HgoError, match=told):
        hgo_rs.Model(states=["a", "b", "c"][: len(f)], inputs=["u"], f=f)


@pytest.mark.parametrize(
    "make",
    [
        lambda model: hgo_rs.LowPowerObserver(2, 5.0, model=model),
        lambda model: hgo_rs.HighGainEKF(2, R=1.0, Q=1.0, model=model),
        lambda model: hgo_rs.HighGainEKF(2, R=1.0, Q=1.0, model=model, method="rk4"),
    ],
)
def test_laws_without_slopes_are_refused(make: Any) -> None:
    model = hgo_rs.Model(states=["a", "b"], f=["b**3", "-a"])
    with pytest.raises(
        HgoError, match=r"a nonlinear chain is not allowed here: .*standard observer"
    ):
        make(model)
    spec = hgo_rs.StandardObserver(2, 5.0, model=model).spec
    table = {**spec["model"]["table"]}
    table["outputs"] = [*table["outputs"][:-1], 0]  # the time
    with pytest.raises(ValueError, match="slope of an unknown or of a nonlinear chain depends on"):
        _core.Observer({**spec, "model": {**spec["model"], "table": table}})


def test_files_hold_a_nonlinear_chain(tmp_path: Any) -> None:
    observer = hgo_rs.StandardObserver(3, 6.0, model=SLOPED)
    observer.save(tmp_path / "a.toml")
    assert hgo_rs.load(tmp_path / "a.toml").observer().spec == observer.spec


def test_coupled_blocks_meet_their_numbers() -> None:
    """In the limit of small steps, by Richardson's extrapolation."""
    model = hgo_rs.Model(states=["x1", "x2", "z"], orders=[2, 1], phi=["-x1 + z*x2", "-z + x2"])
    plant = hgo_rs.Plant(
        states=["x1", "x2", "z"], drift=["x2", "-x1 + z*x2", "-z + x2"], output=["x1", "z"]
    )
    manner: Any = {"method": "rk4", "timing": "predictor"}
    parts = [
        hgo_rs.StandardObserver(2, 15.0, k=(2.0, 1.0), **manner),
        hgo_rs.StandardObserver(1, 15.0, k=(1.0,), **manner),
    ]
    law = hgo_rs.MultiOutputObserver(parts, model=model)
    ends = []
    for dt in (4e-4, 2e-4, 1e-4):
        run = hgo_rs.simulate(
            plant, law, dt=dt, steps=round(0.5 / dt), x0=[1.0, 0.0, 0.5], plant_method="rk4"
        )
        ends.append(run.final_memory[0, :3])
        assert run.final_x[0, :3] == pytest.approx(
            (0.869990323, -0.517841347, 0.192419211), rel=1e-8
        )
    once = [2.0 * fine - coarse for coarse, fine in pairwise(ends)]
    limit = (4.0 * once[1] - once[0]) / 3.0
    assert limit == pytest.approx((0.874774252, -0.432450013, 0.208793842), rel=1e-7)


@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize("timing", ["predictor", "current"])
def test_a_step_is_judged_by_the_outputs_that_correct(timing: str, uneven: bool) -> None:
    """A step of 0.1 s is too long for ell = 60 and not for ell = 2, whose sample may come alone."""
    model = hgo_rs.Model(states=["p", "v", "q", "w"], orders=[2, 2], phi=["-p", "-q"])
    fast, slow = (
        hgo_rs.StandardObserver(2, ell, method="euler", timing=timing) for ell in (60.0, 2.0)
    )
    observer = hgo_rs.MultiOutputObserver([fast, slow], model=model)
    t: Any = 0.001 * np.arange(20)
    t[10:] += 0.1  # the step from sample 9 to sample 10
    if not uneven:
        t = 0.1
    at = {"predictor": 9, "current": 10}[timing]
    apart = np.full((20, 2), 0.01) if uneven else np.full((20, 2), np.nan)
    for missing, refused in ((0, False), (1, True)):
        y = apart.copy()
        y[at] = 0.01
        y[at, missing] = np.nan
        if not refused:
            assert np.isfinite(observer.run(t, y).x_hat).all()
            continue
        told = r"after sample 9 .*dt = 0.1.*must be < .*standard observer by euler"
        with pytest.raises(HgoError, match=told):
            observer.run(t, y)
        assert observer.run(t, y, allow_unstable=True).missing[at]
