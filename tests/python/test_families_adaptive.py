"""The adaptive high-gain EKF: numbers, its window run again from samples, the twin, refusals."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import hgo_rs
from hgo_rs import reference
from hgo_rs.errors import HgoError

GAIN = hgo_rs.InnovationGain(10.0, rise=0.1, fall=2.0, threshold=0.2, slope=50.0, samples=5)
SWING = hgo_rs.Model(states=["a", "b"], inputs=["u"], phi="u - 4*sin(a) - 0.3*b*cos(t)")
TUNED = hgo_rs.InnovationGain(6.0, rise=0.05, fall=12.0, threshold=2e-3, slope=5e3, samples=10)


def adaptive(gain: Any = TUNED, **more: Any) -> hgo_rs.HighGainEKF:
    given: Any = {"R": 1e-4, "Q": [0.0, 0.5], "P0": [0.01, 1.0], "model": SWING, **more}
    return hgo_rs.HighGainEKF(2, gain, **given)


def record(samples: int = 300) -> tuple[Any, Any, Any]:
    """Uneven times, the swing with a kick after a second, gaps, noise."""
    rng = np.random.default_rng(9)
    t = np.cumsum(np.where(np.arange(samples) % 7 == 3, 2.0**-6, 2.0**-7)) - 2.0**-7
    u, x, y = np.cos(2.0 * t), np.array([0.4, 0.0]), np.empty(samples)
    for k in range(samples):
        y[k] = x[0]
        dt = 2.0**-7 if k + 1 == samples else t[k + 1] - t[k]
        for _ in range(20):
            x = x + dt / 20 * np.array([x[1], u[k] - 4 * np.sin(x[0]) - 0.3 * x[1] * np.cos(t[k])])
        if k == 90:
            x = x + np.array([0.0, 6.0])
    y += rng.normal(0.0, 0.01, samples)
    y[rng.random(samples) < 0.1] = np.nan
    return t, y, u


def at(theta: float, innovation: float) -> hgo_rs.HighGainEKF:
    """One at this gain, every run of whose window has come to this innovation, and 0."""
    law = adaptive(GAIN)
    memory = law.initial_memory()
    memory[5], memory[16:21] = theta, innovation
    law.memory = memory
    return law


@pytest.mark.parametrize(
    ("theta", "innovation", "rate"),
    [
        (1.0, 0.2, 5.0),
        (5.0, 1.0, 250.0),
        (8.0, 0.2, 13.0),
        (10.0, 0.2, -9.0),
        (1.0, 0.0, 4.539786870e-4),
    ],
)
def test_the_rate_of_theta_meets_its_numbers(theta: float, innovation: float, rate: float) -> None:
    dt = 1e-7
    law = at(theta, innovation)
    memory = law.memory.copy()
    memory[-1] = dt  # the time of the correction; the runs stand at the sample
    law.memory = memory
    law.correct(0.0)
    assert law.gain is not None
    moved = (law.gain - theta) / dt
    assert moved == pytest.approx(rate, rel=1e-4, abs=2e-8)
    twin = reference.Observer(law.spec).law
    assert twin.rate_of(np.float64(theta), np.float64(innovation)) == pytest.approx(rate, rel=1e-9)  # type: ignore[attr-defined]


def test_theta_rises_as_derived() -> None:
    """mu = 1: 5 at 0.08 s, 105/11 at 0.28 s."""
    law, seen = at(1.0, 100.0), []
    for _ in range(1120):
        law.predict(0.0, dt=2.5e-4)
        memory = law.memory.copy()
        memory[16:21] = 100.0
        law.memory = memory
        law.correct(0.0)
        seen.append(law.gain)
    assert seen[319] == pytest.approx(5.0, rel=1e-7)
    assert seen[1119] == pytest.approx(105.0 / 11.0, rel=1e-7)


def rk4(f: Any, t: float, x: Any, h: float) -> Any:
    k1 = f(t, x)
    k2 = f(t + h / 2, x + h / 2 * k1)
    k3 = f(t + h / 2, x + h / 2 * k2)
    k4 = f(t + h, x + h * k3)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def again(t: Any, y: Any, u: Any, gain: Any) -> tuple[Any, Any]:
    """x_hat and theta of a filter of full matrices, its window run anew from kept samples."""

    def rate(s: float, x: Any, v: float) -> Any:
        return np.array([x[1], v - 4 * np.sin(x[0]) - 0.3 * x[1] * np.cos(s)])

    def moved(k: int, x: Any) -> Any:
        h = (t[k + 1] - t[k]) / 2
        for i in range(2):
            x = rk4(lambda s, z: rate(s, z, u[k]), t[k] + i * h, x, h)
        return x

    x, p, theta = np.zeros(2), np.diag([0.01, 1.0]), 1.0
    used: list[tuple[int, Any]] = []
    shown, gains, last = [], [], 0.0
    for k in range(len(t)):
        if np.isfinite(y[k]):
            if used:
                begun, z = used[-gain.samples] if len(used) >= gain.samples else used[0]
                innovation, since = 0.0, t[begun]
                for j in range(begun, k):
                    z = moved(j, z)
                    if np.isfinite(y[j + 1]):
                        innovation += (t[j + 1] - since) * (y[j + 1] - z[0]) ** 2
                        since = t[j + 1]

                def f(s: float, g: Any, i: float = innovation) -> Any:
                    mu = 1 / (1 + np.exp(-gain.slope * (i - gain.threshold)))
                    half = g <= gain.most / 2
                    f0 = (g * g if half else (g - gain.most) ** 2) / gain.rise
                    return mu * f0 + (1 - mu) * gain.fall * (1 - g)

                theta = float(np.clip(rk4(f, 0.0, theta, t[k] - last), 1.0, gain.most))
                s = p[0, 0] + 1e-4 / theta
                kalman = p[:, 0] / s
                x, p = x + kalman * (y[k] - x[0]), p - np.outer(kalman, p[0])
            used.append((k, x))
            last = t[k]
        shown.append(x)
        gains.append(theta)
        if k + 1 < len(t):
            dt = t[k + 1] - t[k]

            def both(s: float, z: Any, v: float = u[k]) -> Any:
                j = np.array([[0, 1], [-4 * np.cos(z[0]), -0.3 * np.cos(s)]])
                return np.concatenate((rate(s, z[:2], v), (j @ z[2:].reshape(2, 2)).ravel()))

            z = np.concatenate((x, np.eye(2).ravel()))
            for i in range(2):
                z = rk4(both, t[k] + i * dt / 2, z, dt / 2)
            x, phi = z[:2], z[2:].reshape(2, 2)
            q = 0.5 * theta**3 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
            p = phi @ p @ phi.T + q
    return np.array(shown), np.array(gains)


def test_it_is_the_filter_with_its_window_run_again() -> None:
    t, y, u = record()
    result = adaptive().run(t, y, u)
    x_hat, theta = again(t, y, u, TUNED)
    assert result.x_hat == pytest.approx(x_hat, rel=1e-8, abs=1e-9)
    assert result.gain == pytest.approx(theta, rel=1e-7)
    assert theta[60:90].max() < 1.2 and theta[90:130].max() > 4.0 and theta[-30:].max() < 1.5


def test_core_and_twin_agree() -> None:
    for samples, model, n in ((5, SWING, 2), (10, None, 4)):
        gain = hgo_rs.InnovationGain(6.0, 0.05, 3.0, 2e-3, 5e3, samples=samples)
        law = hgo_rs.HighGainEKF(n, gain, R=1e-4, Q=0.5, model=model)
        t, y, u = record(150)
        told = u if law.n_u else None
        ours = law.run(t, y, told)
        start = law.initial_memory()
        theirs = reference.Observer(law.spec).run(t, y, None if told is None else u[:, None], start)
        size = 1.0 + np.abs(ours.memory).max(axis=0)
        assert np.abs((ours.memory - theirs["memory"]) / size).max() < 1e-8
        law.reset()
        for k, shown in enumerate(ours.memory[:-1]):
            law.correct(y[k])
            assert np.array_equal(law.memory, shown)
            law.predict(u[k] if law.n_u else None, t[k + 1] - t[k])


def test_without_an_innovation_it_is_the_kalman_filter_bit_for_bit() -> None:
    quiet = hgo_rs.InnovationGain(6.0, 0.05, 3.0, threshold=1e6, slope=1.0)
    t, y, u = record()
    one, two = (adaptive(gain).run(t, y, u) for gain in (quiet, 1.0))
    assert np.array_equal(one.x_hat, two.x_hat)
    assert one.gain is not None and np.array_equal(one.gain, np.ones(len(t)))
    law = adaptive(quiet)
    assert np.array_equal(law.covariance(one.memory), adaptive(1.0).covariance(two.memory))


def test_a_kick_is_followed_faster() -> None:
    t, y, u = record()
    fast, slow = (adaptive(gain, Q=[0.0, 0.01]).run(t, y, u) for gain in (TUNED, 1.0))
    innovation = [np.nanmean(np.abs(run.innovation[92:115])) for run in (fast, slow)]
    assert innovation[0] < 0.6 * innovation[1]


def test_a_kernel_has_its_bits() -> None:
    pytest.importorskip("llvmlite")
    t, y, u = np.arange(600) * 2.0**-7, np.sin(np.arange(600) * 2.0**-7), np.zeros(600)
    y[300] = np.nan
    for engine in ("interpreter", "llvm"):
        law = adaptive()
        run = law.run(t, y, u, engine=engine)
        if engine == "interpreter":
            right = run.memory
    assert np.array_equal(run.memory, right)


def test_it_is_kept(tmp_path: Any) -> None:
    law = adaptive()
    law.save(tmp_path / "a.toml")
    assert hgo_rs.load(tmp_path / "a.toml").observer().spec == law.spec
    _, y, u = record(60)
    for k in range(40):
        law.correct(y[k])
        law.predict(u[k], 0.01)
    other = copy.deepcopy(law)
    assert np.array_equal(other.correct(0.3), law.correct(0.3))
    assert law.initial_memory(r0=2.0)[5] == 2.0
    assert law.gain is not None and law.step_limit().dt == np.inf


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: hgo_rs.InnovationGain(1.0, 0.1, 2.0, 0.2, 50.0), "most = 1"),
        (
            lambda: hgo_rs.InnovationGain(5.0, 0.1, 2.0, 0.2, 50.0, samples=7),
            "samples = 7: must be 5 or 10",
        ),
        (lambda: hgo_rs.StandardObserver(2, TUNED), "this one is for HighGainEKF"),
        (lambda: adaptive(method="rk4"), "its window holds samples"),
        (lambda: hgo_rs.HighGainEKF(5, TUNED, R=1.0, Q=1.0), "takes n = 1 to 4, and 5 or 10"),
        (
            lambda: hgo_rs.MultiOutputObserver(
                [hgo_rs.HighGainEKF(1, TUNED, R=1.0, Q=1.0)] * 2,
                model=hgo_rs.Model(states=["a", "b"], orders=[1, 1], phi=["-a", "-b"]),
            ),
            "of one output also the gain",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(make: Any, told: str) -> None:
    with pytest.raises(HgoError, match=told):
        make()
