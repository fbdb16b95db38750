"""A model of one's own has the bits of the compiled model with the same equations: alone, over
records, in studies."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs import _core

LEE = hgo.Model(states=["x1", "x2"], phi="-x1/(1 + x1*x1) - x2")
LEE_PLANT = hgo.Plant(states=["x1", "x2"], drift=["x2", "-x1/(1 + x1*x1) - x2"])
CRACKLE = hgo.Model(
    states=["a", "b", "c", "d", "e"],
    parameters={"m": 3.0},
    phi="saturate(0.2*(a*a - 1) - b - c - 4*d - e, -m, m)",
)
CRACKLE_PLANT = hgo.Plant(
    states=["a", "b", "c", "d", "e"], drift=["b", "c", "d", "e", "0.2*(a*a - 1) - b - c - 4*d - e"]
)
GAINS: tuple[Any, ...] = (20.0, hgo.AdaptiveGain(10.0, 1e-3, 0.1))
METHODS = ("euler", "staggered-euler", "rk4", "rk4-innovation-held", "bogacki-shampine")


def law(kind: str, model: Any, gain: Any, method: str, timing: str) -> hgo.Observer:
    n = model.order
    common = {"gain": gain, "model": model, "method": method, "timing": timing}
    if kind == "standard":
        return hgo.StandardObserver(n, allow_unstable=True, **common)
    if kind == "low-power":
        return hgo.LowPowerObserver(n, allow_unstable=True, **common)
    return hgo.PeakingFreeObserver(
        n, saturation=5.0, clip=kind.split("-")[0], allow_unstable=True, **common
    )


KINDS = ("standard", "low-power", "hard-clip", "smooth-clip")
CASES = list(
    itertools.product(KINDS, GAINS, (*METHODS, "zoh", "bilinear"), ("predictor", "current"))
)


def record(samples: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(5e-4, 2e-3, samples))
    y = np.sin(3.0 * t) + 1e-3 * rng.standard_normal(samples)
    y[100:150] = np.nan
    return t, y


@pytest.mark.parametrize(
    "case",
    CASES,
    ids=lambda c: f"{c[0]}-{'constant' if c[1] == 20.0 else 'adaptive'}-{c[2]}-{c[3]}",
)
def test_records_have_the_bits_of_the_built_in_model(case: tuple[Any, ...]) -> None:
    kind, *rest = case
    for own, built_in in ((LEE, hgo.Lee()), (CRACKLE, hgo.Crackle())):
        if built_in.order == 5 and rest[0] != 20.0:
            continue
        try:
            b = law(kind, built_in, *rest)
        except hgo.HgoError:  # bilinear beyond order 4
            with pytest.raises(hgo.HgoError):
                law(kind, own, *rest)
            continue
        a = law(kind, own, *rest)
        assert a.n_u == b.n_u == 0
        t, y = record()
        for clock in (t, 1e-3):
            of_own, of_built_in = a.run(clock, y), b.run(clock, y)
            assert np.array_equal(of_own.x_hat, of_built_in.x_hat)
            assert np.array_equal(of_own.innovation, of_built_in.innovation, equal_nan=True)
            assert np.array_equal(of_own.missing, of_built_in.missing)
        for k in range(120):
            steps = [o.step(y[k], dt=float(t[k + 1] - t[k])) for o in (a, b)]
            assert np.array_equal(*steps)


def test_parameters_change_without_compiling_again() -> None:
    t, y = record(500)
    tight = hgo.LowPowerObserver(5, 5.0, model=CRACKLE.with_parameters(m=0.6), method="rk4")
    assert np.array_equal(
        tight.run(t, y).x_hat,
        hgo.LowPowerObserver(5, 5.0, model=hgo.Crackle(phi_max=0.6), method="rk4").run(t, y).x_hat,
    )


@pytest.mark.parametrize("runs", [3, 40])
@pytest.mark.parametrize(
    "mode, method, timing",
    [
        ("sampled", "euler", "predictor"),
        ("sampled", "rk4", "current"),
        ("sampled", "zoh", "current"),
        ("joint", "rk4", "predictor"),
    ],
)
def test_studies_have_the_bits_of_the_built_in_systems(
    mode: str, method: str, timing: str, runs: int
) -> None:
    law = {"method": method, "timing": timing}
    noise = hgo.UniformNoise(-0.01, 0.01)
    pairs = (
        (hgo.Lee(), LEE_PLANT, hgo.Lee(), LEE, 20.0, [1.0, -0.5]),
        (hgo.Crackle(), CRACKLE_PLANT, hgo.Crackle(), CRACKLE, 4.0, [-0.2, 0.1, 0, 0.1, 0]),
    )
    for plant, own_plant, model, own_model, gain, x0 in pairs:
        results = [
            hgo.simulate(
                some_plant,
                hgo.StandardObserver(len(x0), gain, model=some_model, **law),
                steps=700,
                dt=1e-3,
                x0=x0,
                runs=runs,
                noise=noise,
                rng=3,
                mode=mode,
                plant_method="rk4" if method == "zoh" else method,
                windows=[(0.1, 0.7)],
                every=100 if runs == 3 else 0,
            )
            for some_plant, some_model in itertools.product((plant, own_plant), (model, own_model))
        ]
        for other in results[1:]:
            assert np.array_equal(results[0].rms, other.rms)
            assert np.array_equal(results[0].peak, other.peak)
            assert np.array_equal(results[0].final_x, other.final_x)
            assert np.array_equal(results[0].final_memory, other.final_memory)


def test_process_noise_of_an_own_plant() -> None:
    own = hgo.Plant(
        states=["x1", "x2"],
        parameters={"eps": 0.8, "sigma": 0.5},
        drift=["x2", "-x1 + eps*(1 - x1*x1)*x2"],
        diffusion=[0, "sigma"],
    )
    model = hgo.Model(
        states=["x1", "x2"],
        parameters={"eps": 0.8},
        f=["x2", "-x1 + eps*(1 - x1*x1)*x2"],
        K_T=[
            "(5 + eps*(1 - y*y))*T*(y - x1)",
            "(5 - eps*(x1 + y)*x2 + (5 + eps*(1 - y*y))*(eps*(1 - y*y)))*T*(y - x1)",
        ],
    )
    results = [
        hgo.simulate(
            plant,
            observer,
            steps=400,
            dt=0.05,
            x0=[0.5, 0.5],
            runs=40,
            rng=2,
            plant_method="euler-maruyama",
            windows=[(5.0, 20.0)],
        )
        for plant, observer in (
            (hgo.VanDerPol(), hgo.SampledDataObserver()),
            (own, hgo.SampledDataObserver(model=model)),
        )
    ]
    assert np.array_equal(results[0].rms, results[1].rms)


def test_a_value_that_does_not_exist_keeps_the_state_and_names_the_sample() -> None:
    model = hgo.Model(states=["q", "v"], phi="log(q)")
    observer = hgo.StandardObserver(2, 20.0, model=model)
    with pytest.raises(hgo.HgoError, match="sample 0"):
        observer.run(1e-3, np.full(10, -1.0), x_hat0=[-1.0, 0.0])
    observer.reset(x_hat0=[-1.0, 2.0])
    observer.step(-1.0, dt=1e-3)  # the first call corrects for no time
    with pytest.raises(hgo.HgoError):
        observer.step(-1.0, dt=1e-3)
    assert observer.x_hat.tolist() == [-1.0, 2.0]


def test_a_traced_step_is_a_table_with_the_bits_of_the_step() -> None:
    rng = np.random.default_rng(4)
    for kind, gain, method, timing in CASES[::5]:
        observer = law(kind, hgo.Lee(), gain, method, timing)
        placed = method in ("zoh", "bilinear")
        if kind != "standard" and placed and gain != 20.0:
            continue  # no table
        m = observer.memory.size
        z = observer.initial_memory() + 0.1 * rng.random(m)
        if timing == "predictor":
            table = _core.trace_step(observer.spec, dt=0.001 if placed else None)
            made = _core.evaluate_table(table, [[0.3, 0.001, *z, 0.7]])[0]
        else:
            z[-1] = 0.001  # the time that the correction is for already
            predict = _core.trace_step(observer.spec, dt=0.002 if placed else None, part="predict")
            correct = _core.trace_step(observer.spec, dt=0.002 if placed else None, part="correct")
            before = _core.evaluate_table(predict, [[0.3, 0.001, *z]])[0][:m]
            made = _core.evaluate_table(correct, [[0.3 + 0.001, *before, 0.7]])[0]
        moved, _ = observer._core.step(z, [0.7], [], 0.3, 0.001)
        assert np.array_equal(made[:m], moved), (kind, method, timing)


@pytest.mark.parametrize("size", [40, 300])
def test_a_table_becomes_a_program_with_its_bits(size: int) -> None:
    """Rows, products with sums and both bounds are one instruction each, in another order; of 300
    results, of which many are alive at once, too."""
    rng = np.random.default_rng(size)
    evaluate = {
        "add": lambda a, b: a + b,
        "sub": lambda a, b: a - b,
        "mul": lambda a, b: a * b,
        "min": lambda a, b: b if b < a else a,
        "max": lambda a, b: b if b > a else a,
    }
    for _ in range(50):
        given, known = [float(value) for value in rng.normal(size=6)], 8
        ops: list[tuple[str, int, int]] = []
        while len(ops) < size:
            name, count = rng.choice(list(evaluate)), int(rng.integers(1, 8))
            a, b = (int(value) for value in rng.integers(max(0, known - 40), known, 2))
            goes = int(rng.integers(0, 2))
            for i in range(count):  # like what moves a state
                ops.append((str(name), min(a + goes * i, known - 1), min(b + i, known - 1)))
                known += 1
        values = [*given, 0.5, -0.25]
        for name, a, b in ops:
            values.append(evaluate[name](values[a], values[b]))
        outputs = [int(value) for value in rng.integers(0, known, size // 4)]
        names = [f"v{i}" for i in range(6)]
        table = {"inputs": names, "constants": values[6:8], "ops": ops, "outputs": outputs}
        made = _core.evaluate_table(table, [given])[0]
        want = [values[output] for output in outputs]
        assert np.array_equal(made, want, equal_nan=True)


def two_links() -> hgo.Model:
    return hgo.Model(
        states=["q1", "v1", "q2", "v2"],
        orders=[2, 2],
        inputs=["u1", "u2"],
        phi=["u1 - sin(q1) + 0.3*sin(q2 - q1)*v2", "u2 - sin(q2) - 0.3*sin(q2 - q1)*v1"],
    )


def test_two_outputs_share_their_states() -> None:
    chain = {"gain": 40.0, "method": "euler", "timing": "predictor"}
    observer = hgo.MultiOutputObserver(
        [hgo.StandardObserver(2, **chain), hgo.StandardObserver(2, **chain)], model=two_links()
    )
    rng = np.random.default_rng(5)
    y, u, dt = 0.1 * rng.random((200, 2)), rng.random((200, 2)), 1e-3
    y[50:60, 1] = np.nan
    result = observer.run(dt, y, u)
    # the same recursion, written out
    (k1, k2), x = hgo.StandardObserver(2, **chain).spec["k"], np.zeros(4)
    for k in range(200):
        assert np.allclose(result.x_hat[k], x, rtol=1e-12, atol=1e-15)
        q1, v1, q2, v2 = x
        e = np.where(np.isnan(y[k]), 0.0, y[k] - x[[0, 2]])
        phi = (
            u[k, 0] - np.sin(q1) + 0.3 * np.sin(q2 - q1) * v2,
            u[k, 1] - np.sin(q2) - 0.3 * np.sin(q2 - q1) * v1,
        )
        rate = [v1 + 40 * k1 * e[0], phi[0] + 1600 * k2 * e[0]]
        rate += [v2 + 40 * k1 * e[1], phi[1] + 1600 * k2 * e[1]]
        x = x + dt * np.array(rate)


def test_a_callable_that_cannot_be_compiled_runs_and_says_how_slow_it_is() -> None:
    def phi(t: float, x: np.ndarray, u: np.ndarray) -> float:
        return -1.0 if x[0] > 0.2 else 0.5 * float(x[1]) + float(u[0])

    called = hgo.Model(states=["q", "v"], inputs=["u"], phi=phi)
    same = hgo.Model(states=["q", "v"], inputs=["u"], phi="piecewise(-1, q > 0.2, 0.5*v + u)")
    assert not called.compiled
    t, y = record(400)
    u = np.cos(t)
    for timing in ("predictor", "current"):
        slow = hgo.StandardObserver(2, 30.0, model=called, timing=timing)
        fast = hgo.StandardObserver(2, 30.0, model=same, timing=timing)
        with pytest.warns(UserWarning, match="times slower"):
            result = slow.run(t, y, u)
        expected = fast.run(t, y, u)
        assert result.slowdown > 5.0 and expected.slowdown == 1.0
        assert np.allclose(result.x_hat, expected.x_hat, rtol=1e-11, atol=1e-13)
        for k in range(5):
            at = {"dt": float(t[k + 1] - t[k])}
            assert np.allclose(slow.step(y[k], u[k], **at), fast.step(y[k], u[k], **at))
    plant = hgo.Plant(states=["q", "v"], drift=lambda t, x: [x[1], -1.0 if x[0] > 0 else 1.0])
    assert not plant.compiled
    outcome = hgo.simulate(
        plant, hgo.StandardObserver(2, 20.0), x0=[0.5, 0.0], dt=1e-3, steps=200, runs=2
    )
    written = hgo.Plant(states=["q", "v"], drift=["v", "piecewise(-1, q > 0, 1)"])
    again = hgo.simulate(
        written, hgo.StandardObserver(2, 20.0), x0=[0.5, 0.0], dt=1e-3, steps=200, runs=2
    )
    assert np.allclose(outcome.final_x, again.final_x, rtol=1e-12)


def test_the_reduced_order_observer_with_a_model_of_ones_own() -> None:
    # x' = (1 + x^2/10) z, z' = -z + u: NumPy, written out from Katayama (8)
    model = hgo.Model(states=["x", "z"], inputs=["u"], f1=["0"], g=[["1 + x*x/10"]], f2=["-z + u"])
    observer = hgo.ReducedOrderObserver(0.05, h_bar=[0.5], model=model)
    rng = np.random.default_rng(6)
    y, u, dt, h = np.cumsum(rng.random(300)) * 1e-2, rng.random(300), 0.01, 0.5 / 0.05
    y[40:43] = np.nan
    estimates, z, last, elapsed = [], 0.0, None, 0.0
    for k in range(300):
        if last is not None:
            if np.isnan(y[k]):
                z = z + dt * (-z + u[k - 1])
                elapsed += dt
            else:
                psi = (y[k] - last) / elapsed / (1 + last * last / 10)
                z = z + dt * (h * (psi - z) + (-psi + u[k - 1]))
        if not np.isnan(y[k]):
            last, elapsed = y[k], dt
        estimates.append(z)
    result = observer.run(dt, y, u)
    assert np.allclose(result.x_hat[:, 0], estimates, rtol=1e-12)
