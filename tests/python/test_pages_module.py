"""The module of pages gives Python's bits, and figures that Python computes by other means."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
import pytest
from wasm_module import Module

import hgo_rs as hgo
from hgo_rs.design import response
from hgo_rs.design.discrete import discrete
from hgo_rs.pages.live import ways

RNG = np.random.default_rng(5)
T = np.cumsum(RNG.uniform(2e-3, 6e-3, 400))
T[200:] += 0.05  # a gap
U = np.sin(3.0 * T)
Y = np.cos(2.0 * T) + 1e-3 * RNG.standard_normal(400)
Y[[0, 1, 30, 31, 399]] = np.nan
EVEN = 4e-3

PENDULUM = hgo.Model(
    states=["q", "v"],
    inputs=["u"],
    parameters={"s": 9.81, "d": 0.4},
    phi="u - s*sin(q) - d*v*abs(v) + 0.1*t",
)
OBSERVERS: dict[str, hgo.Observer] = {
    "standard 3": hgo.StandardObserver(3, 20.0),
    "oscillating poles": hgo.StandardObserver(
        4, 8.0, poles=[-1 + 1j, -1 - 1j, -0.5 + 0.8j, -0.5 - 0.8j]
    ),
    "pendulum": hgo.StandardObserver(2, 25.0, model=PENDULUM),
    "paper's model": hgo.StandardObserver(2, 15.0, model=hgo.VanDerPol()),
    "low-power 7": hgo.LowPowerObserver(7, 6.0),
    "wraps": hgo.StandardObserver(2, 20.0, wrap=1.5),
    "filtered": hgo.HighGainObserver("filtered", 2, 15.0, filters=1),
    "cascade": hgo.HighGainObserver("cascade", 3, 15.0, method="rk4"),
}


@pytest.fixture(scope="module")
def module() -> Module:
    return Module()


def all_ways(observer: hgo.Observer) -> list[tuple[dict[str, Any], hgo.Observer]]:
    """Each way as the page has it, and the same observer in Python."""
    found = ways(observer, Y[2:3], lambda of: hgo.Config.of(of).to_toml())
    table = hgo.Config.of(observer)
    return [
        (way, table.replace(method=way["method"], timing=way["timing"]).observer()) for way in found
    ]


@pytest.mark.parametrize("name", OBSERVERS)
def test_estimates_have_the_bits_of_run(module: Module, name: str) -> None:
    observer = OBSERVERS[name]
    own = observer.spec["gain"]["ell"]
    compared = 0
    for way, other in all_ways(observer):
        u = U if observer.n_u else None
        for ell, clock in ((own, T), (0.731 * own, EVEN)):
            of = hgo.Config.of(other).replace(gain=ell).observer()
            given = (clock, Y) if u is None else (clock, Y, u)
            run = of.run(*given, start="first-sample", allow_unstable=True)
            x, e, done = module.run(way, observer.n, ell, clock, Y, u)
            assert done == len(Y), (way["method"], way["timing"])
            assert x.tobytes() == run.x_hat.tobytes(), (way["method"], way["timing"], ell)
            there = np.isfinite(Y)
            np.testing.assert_array_equal(e[there], run.innovation[there, 0])
            compared += 1
    assert compared >= 6


@pytest.mark.parametrize("name", ["oscillating poles", "filtered"])
def test_figures_are_those_of_the_design(module: Module, name: str) -> None:
    observer, dt = OBSERVERS[name], 5e-3
    n, ell = observer.n, 30.0
    for way, other in all_ways(observer):
        of = hgo.Config.of(other).replace(gain=ell).observer()
        law = discrete(of.spec, dt)
        found = module.figures(way, n, ell, dt)
        where = f"{way['method']}, {way['timing']}"
        assert found["radius"] == pytest.approx(law.radius, rel=1e-6), where
        if law.radius >= 1.0:
            continue
        expected = {
            "noise": of.noise_gain(dt),
            "model": response.model_gain(of.spec, dt),
            "cutoff": of.bandwidth(dt),
        }
        for key, value in expected.items():
            np.testing.assert_allclose(found[key], value, rtol=1e-6, err_msg=f"{where}, {key}")
        errors = module.errors(way, n, ell, dt, 2000)
        np.testing.assert_allclose(np.abs(errors).max(0), of.peaking(dt), rtol=1e-9, err_msg=where)
        omega = np.geomspace(1.0, 0.99 * np.pi / dt, 7)
        z = np.exp(1j * omega * dt)
        exact = [law.c @ np.linalg.solve(w * np.eye(len(law.a)) - law.a, law.b) + law.d for w in z]
        np.testing.assert_allclose(
            module.bode(way, n, ell, dt, omega), np.array(exact)[:, :, 0], rtol=1e-8, err_msg=where
        )


def test_spectra_are_welchs(module: Module) -> None:
    values, n = np.cumsum(RNG.standard_normal(1000)), 128
    parts = np.array([values[k : k + n] for k in range(0, 1000 - n + 1, n // 2)])
    window = np.hanning(n + 1)[:-1]
    powers = np.abs(np.fft.rfft((parts - parts.mean(1, keepdims=True)) * window)) ** 2
    expected = powers.mean(0) * EVEN / np.sum(window**2)
    expected[1:-1] *= 2.0
    np.testing.assert_allclose(module.density(values, n, EVEN), expected, rtol=1e-9)
    assert not module.density(np.full(100, np.nan), 64, 1.0).any()


def test_an_estimate_that_is_lost_ends_the_run(module: Module) -> None:
    blown = hgo.Model(states=["q", "v"], phi="exp(q)*v**3")
    (way, observer), *_ = all_ways(hgo.StandardObserver(2, 50.0, model=blown))
    y = 40.0 * np.arange(400.0)
    x, _, done = module.run(way, 2, 50.0, EVEN, y)
    assert 0 < done < 400
    start = np.frombuffer(base64.b64decode(way["memory"]))
    part = observer.run(EVEN, y[:done], memory0=start, allow_unstable=True)
    assert np.isfinite(x[:done]).all() and x[:done].tobytes() == part.x_hat.tobytes()
    assert module.run(way, 2, -1.0, EVEN, y)[2] == -1


def test_numbers_of_no_observer_are_not_read(module: Module) -> None:
    for values in ([], [1.0], [0.0, 2.0, 0.0, 1e12]):
        assert module.call("observer", module.put(values), len(values)) == 0
