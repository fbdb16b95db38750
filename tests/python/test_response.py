"""Matrices of every law as it runs, against the core; what follows from them, against simulation,
Monte Carlo, SciPy and closed forms.
"""

from __future__ import annotations

import itertools
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy import signal

from hgo_rs import (
    AdaptiveGain,
    LowPowerObserver,
    PeakingFreeObserver,
    ReducedOrderObserver,
    RepelledCollection,
    SampledDataObserver,
    StandardObserver,
    VanDerPol,
)
from hgo_rs.design import (
    bandwidth,
    discrete,
    innovation_gain,
    model_gain,
    noise_gain,
    peaking,
    step_limit,
)
from hgo_rs.design.discrete import METHODS, TIMINGS, continuous, fixed_timing
from hgo_rs.errors import DesignError
from hgo_rs.observers import Observer

BUTTERWORTH = [-np.sqrt(0.5) * (1 + 1j), -np.sqrt(0.5) * (1 - 1j)]

LAWS: dict[str, dict[str, Any]] = {
    "standard 1": StandardObserver(1, 30.0, method="euler", timing="predictor").spec,
    "standard 2": StandardObserver(
        2, 50.0, poles=BUTTERWORTH, method="euler", timing="predictor"
    ).spec,
    "standard 4": StandardObserver(4, 20.0, method="euler", timing="predictor").spec,
    "low-power 2": LowPowerObserver(2, 40.0, method="euler", timing="predictor").spec,
    "low-power 5": LowPowerObserver(5, 20.0, method="euler", timing="predictor").spec,
    "peaking-free 3": PeakingFreeObserver(
        3, 20.0, saturation=1e9, method="euler", timing="predictor"
    ).spec,
}
EVERY = [method for method in METHODS if fixed_timing(method) is None]
CORES = [case for case in itertools.product(LAWS, EVERY) if case != ("low-power 5", "bilinear")]
"""Laws and methods that the core has: it refuses bilinear at such an order."""
DT = 4e-3


def core(spec: dict[str, Any]) -> Observer:
    """The compiled observer."""
    return Observer(spec, allow_unstable=True)


@pytest.mark.parametrize(("law", "method"), CORES)
def test_the_matrices_are_the_cores(law: str, method: str) -> None:
    """Column by column, from unit memories and a unit sample."""
    spec = {**LAWS[law], "method": method}
    observer = core(spec)
    system = discrete(spec, DT)
    size = len(system.a)
    columns = []
    for memory, y in [*((row, 0.0) for row in np.eye(size)), (np.zeros(size), 1.0)]:
        observer.memory = memory
        observer.step(y, dt=DT)
        columns.append(observer.memory)
    found = np.array(columns).T / system.scale[:, None]
    wanted = np.hstack([system.a, system.b]) / system.scale[:, None]
    np.testing.assert_allclose(found, wanted, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.parametrize("timing", TIMINGS)
@pytest.mark.parametrize(("law", "method"), CORES)
def test_a_run_is_the_impulse_response(law: str, method: str, timing: str) -> None:
    spec = {**LAWS[law], "method": method}
    if timing != "predictor":
        spec["timing"] = timing
    observer = core(spec)
    system = discrete(spec, DT)
    y = np.r_[1.0, np.zeros(59)]
    start = observer.initial_memory()
    if timing == "current":
        start[-1] = DT  # a period has passed, over which the first sample corrects
    shown = observer.run(DT, y, memory0=start).x_hat
    wanted = impulse(system, 60)
    size = np.abs(wanted).max(axis=0)
    np.testing.assert_allclose(shown / size, wanted / size, atol=1e-10)


def impulse(system: Any, samples: int) -> np.ndarray:
    """(samples, n) by scipy.signal."""
    inputs = np.zeros((samples, system.b.shape[1]))
    inputs[0, 0] = 1.0
    _, shown, _ = signal.dlsim((*system, system.dt), inputs)
    return np.asarray(shown)


def test_recursions_of_their_own() -> None:
    """Sampled-data about x = 0, by small unit memories; reduced-order through a run."""
    small = 1e-6
    for choice in ("derived", "printed"):
        fu = SampledDataObserver(VanDerPol(), gain=choice)
        system = discrete(fu.spec, 0.01)
        for j, y in itertools.product(range(3), (0.0, small)):
            fu.memory = small * np.eye(3)[j, :2]
            start = fu.memory.copy()
            fu.step(y, dt=0.01)
            wanted = system.a @ start + system.b[:, 0] * y
            np.testing.assert_allclose(fu.memory, wanted, atol=1e-10 * small)
    ship = ReducedOrderObserver(0.1)
    system = discrete(ship.spec, 0.1)
    wanted = np.eye(3) - np.diag(ship.spec["h_bar"])  # T = epsilon: I - T H
    np.testing.assert_allclose(system.c[:, :3], wanted)
    np.testing.assert_allclose(system.c[:, 3:], -system.d)
    steady = np.linalg.solve(np.eye(6) - system.a, system.b)
    np.testing.assert_allclose(system.c @ steady + system.d, 0.0, atol=1e-12)  # of a constant y
    ramp = np.arange(400)[:, None] * 0.1 * np.array([1.0, -2.0, 3.0])
    _, shown, _ = signal.dlsim((*system, 0.1), ramp)
    np.testing.assert_allclose(shown[-1], [1.0, -2.0, 3.0], rtol=1e-6)


# --- methods that correct ---------------------------------------------------------------------


@pytest.mark.parametrize("rule", ("zoh", "bilinear"))
@pytest.mark.parametrize("c", (1e-3, 0.3, 20.0))
@pytest.mark.parametrize("law", ("standard 1", "standard 2", "standard 4", "standard 8"))
def test_the_error_has_the_eigenvalues_asked_for(law: str, c: float, rule: str) -> None:
    """The characteristic polynomial of (1 - K C) Phi, in 50 digits."""
    spec = (
        StandardObserver(8, 1.0, method="euler", timing="predictor").spec
        if law == "standard 8"
        else LAWS[law]
    )
    linear = continuous(spec)
    now = {**spec, "method": rule, "timing": "current"}
    if (law, rule) == ("standard 8", "bilinear"):
        with pytest.raises(DesignError, match="n = 8 is not allowed: method bilinear"):
            discrete(now, c)
        return
    k = discrete(now, c / linear.ell).scaled[3]  # x_hat = ... + K y
    size = len(k)
    poles = np.linalg.eigvals(linear.closed)
    with mpmath.workdps(50):
        exact = mpmath.expm(mpmath.matrix((c * linear.f).tolist()), method="pade")
        moved = exact.copy()
        for i, j in itertools.product(range(size), repeat=2):
            moved[i, j] -= mpmath.mpf(k[i, 0]) * exact[0, j]
        wanted = []
        for p in poles:
            half = mpmath.mpmathify(complex(c * p)) / 2
            wanted.append(mpmath.exp(2 * half) if rule == "zoh" else (1 + half) / (1 - half))
        away = min(c, 1.0)  # from 1, as far as the eigenvalues
        for z in (1 + away, 1 - 2.3 * away, mpmath.mpc(1, away)):
            value = mpmath.det(z * mpmath.eye(size) - moved)
            assert abs(value / mpmath.fprod(z - w for w in wanted) - 1) < 1e-6


def test_second_order_in_closed_form() -> None:
    """K1 = 1 - z1 z2, K2 = (2 - K1 - z1 - z2)/T."""
    ell = 50.0
    system = discrete({**LAWS["standard 2"], "method": "zoh", "timing": "current"}, DT)
    z = np.exp(ell * DT * np.array(BUTTERWORTH))
    k1 = 1.0 - z.prod().real
    k2 = (2.0 - k1 - z.sum().real) / DT
    np.testing.assert_allclose(system.d[:, 0], [k1, k2], rtol=1e-12)
    # the error moves as in continuous time, sample for sample
    error = np.linalg.matrix_power(system.a, 7)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(error)), np.sort(z**7), rtol=1e-9)


@pytest.mark.parametrize("timing", TIMINGS)
@pytest.mark.parametrize(
    ("law", "rule"), [case for case in CORES if case[1] in ("zoh", "bilinear", "implicit-map")]
)
def test_no_lag_on_the_chains_own_motion(law: str, rule: str, timing: str) -> None:
    """A polynomial of degree n - 1 is followed without error, whatever the step."""
    spec = {**LAWS[law], "method": rule, "timing": timing}
    n, dt = spec["n"], 0.1
    t = (np.arange(120) - 119) * dt
    motion = np.polynomial.Polynomial(1.0 / (1.0 + np.arange(n)))
    _, shown, _ = signal.dlsim((*discrete(spec, dt), dt), motion(t))
    truth = [motion.deriv(i)(0.0) if i else motion(0.0) for i in range(n)]
    np.testing.assert_allclose(shown[-1], truth, rtol=1e-5)
    limit = step_limit(spec)
    assert limit.method == rule
    if rule == "zoh":
        assert limit.c == np.inf and limit.dt == np.inf
    elif law != "peaking-free 3":
        assert limit.c > 50.0


# --- noise ------------------------------------------------------------------------------------


@pytest.mark.parametrize("timing", TIMINGS)
@pytest.mark.parametrize("method", ("euler", "rk4-innovation-held", "zoh"))
@pytest.mark.parametrize("law", LAWS)
def test_noise_gain_is_the_energy_of_the_impulse_response(
    law: str, method: str, timing: str
) -> None:
    spec = {**LAWS[law], "method": method, "timing": timing}
    energy = np.sum(impulse(discrete(spec, DT), 4000) ** 2, axis=0)
    np.testing.assert_allclose(noise_gain(spec, DT), energy, rtol=1e-8)


def test_noise_gain_by_monte_carlo() -> None:
    observer = LowPowerObserver(3, 60.0, method="rk4-innovation-held", timing="predictor")
    rng = np.random.default_rng(5)
    runs = [observer.run(DT, rng.normal(0.0, 0.1, 40_000)).x_hat[500:] for _ in range(10)]
    measured = np.var(np.concatenate(runs), axis=0)
    np.testing.assert_allclose(observer.noise_gain(DT), measured / 0.01, rtol=0.03)


@pytest.mark.parametrize("law", LAWS)
def test_noise_gain_of_fast_sampling_is_the_continuous_laws(law: str) -> None:
    spec = LAWS[law]
    dt = 1e-5 / spec["gain"]["ell"]
    np.testing.assert_allclose(noise_gain(spec, dt) / dt, noise_gain(spec), rtol=1e-3)
    # first order: variance k ell/2 per unit density
    if law == "standard 1":
        np.testing.assert_allclose(noise_gain(spec), [spec["k"][0] * 30.0 / 2.0])


def test_model_gain_and_innovation_by_monte_carlo() -> None:
    """A chain driven by white noise, sampled exactly, and the observer as it runs."""
    rng = np.random.default_rng(8)
    count, density, noise = 40_000, 3.0, 2e-3
    cov = density * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]])
    w = rng.multivariate_normal(np.zeros(2), cov, size=count)
    v = np.cumsum(w[:, 1]) - w[:, 1]
    x = np.column_stack([np.cumsum(DT * v + w[:, 0]) - DT * v - w[:, 0], v])
    y = x[:, 0] + noise * rng.normal(size=count)
    for timing in TIMINGS:
        law = "standard 2"
        spec = {**LAWS[law], "method": "zoh", "timing": timing}
        system = discrete(spec, DT)
        z = np.zeros(len(system.a))
        memory, shown = np.empty((count, len(z))), np.empty((count, 2))
        b, d = system.b[:, 0], system.d[:, 0]
        for k in range(count):
            memory[k], shown[k] = z, system.c @ z + d * y[k]
            z = system.a @ z + b * y[k]
        late = slice(2000, None)
        errors = np.var((shown - x)[late], axis=0)
        wanted = density * model_gain(spec, DT) + noise**2 * noise_gain(spec, DT)
        np.testing.assert_allclose(errors, wanted, rtol=0.1)
        innovation = np.var((y - memory[:, 0])[late])
        of_noise, of_model = innovation_gain(spec, DT)
        assert innovation == pytest.approx(density * of_model + noise**2 * of_noise, rel=0.1)


def test_model_gain_of_fast_sampling_is_the_continuous_laws() -> None:
    for law in ("standard 2", "standard 4"):
        spec = {**LAWS[law], "method": "zoh"}
        np.testing.assert_allclose(model_gain(spec, 1e-5), model_gain(LAWS[law]), rtol=0.01)


# --- frequencies ------------------------------------------------------------------------------


def test_bandwidth_in_closed_form() -> None:
    assert StandardObserver(
        1, 30.0, method="euler", timing="predictor"
    ).bandwidth() == pytest.approx(30.0, rel=1e-9)
    # x_hat_2/(s y) is a Butterworth low-pass of order 2 with cutoff ell
    observer = StandardObserver(2, 50.0, poles=BUTTERWORTH, method="euler", timing="predictor")
    assert observer.bandwidth()[1] == pytest.approx(50.0, rel=1e-6)


@pytest.mark.parametrize("law", LAWS)
def test_bandwidth_by_its_definition(law: str) -> None:
    spec = LAWS[law]
    observer = Observer(spec)
    linear = continuous(spec)
    level = np.sqrt(0.5)
    for i, cutoff in enumerate(observer.bandwidth()):
        c = np.eye(len(linear.g))[i]
        w = np.linspace(0.05, 1.0, 100) * cutoff / linear.ell
        h = [(c @ np.linalg.solve(1j * v * np.eye(len(c)) - linear.closed, linear.g)) for v in w]
        ratio = np.abs(h) / w**i
        assert ratio[-1] == pytest.approx(level, rel=1e-6)
        assert np.all(ratio[:-1] > level)
    for rule, timing in itertools.product(("euler", "zoh"), TIMINGS):
        as_run = {**spec, "method": rule, "timing": timing}
        system = discrete(as_run, DT)
        for i, cutoff in enumerate(bandwidth(as_run, DT)):
            _, h = signal.dfreqresp(
                (system.a, system.b, system.c[i : i + 1], system.d[i : i + 1], DT), [cutoff * DT]
            )
            assert abs(h[0]) / cutoff**i == pytest.approx(level, rel=1e-5)


def test_no_cutoff_below_nyquist_is_infinite() -> None:
    fast = {**LAWS["standard 2"], "method": "zoh", "timing": "current"}
    assert bandwidth(fast, 1.0)[0] == np.inf  # deadbeat: x_hat_1 = y


# --- wrong starts -----------------------------------------------------------------------------


def test_peaking_and_settling_in_closed_form() -> None:
    """Both poles at -ell: x_hat_2 errs by ell^2 t e^(-ell t)."""
    ell = 40.0
    observer = StandardObserver(2, ell, poles=[-1.0, -1.0], method="euler", timing="predictor")
    np.testing.assert_allclose(observer.peaking(), [1.0, ell / np.e], rtol=1e-4)
    reached = observer.settling(within=0.1)[1] * ell
    assert reached * np.exp(1.0 - reached) == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize("law", LAWS)
def test_peaking_and_settling_of_a_run(law: str) -> None:
    spec = LAWS[law]
    observer = Observer(spec)
    start = observer.initial_memory(np.eye(observer.n)[0])
    error = np.abs(observer.run(DT, np.zeros(2000), memory0=start).x_hat)
    peak = error.max(axis=0)
    np.testing.assert_allclose(observer.peaking(DT), peak, rtol=1e-9)
    last = [np.flatnonzero(e > 0.02 * p)[-1] for e, p in zip(error.T, peak, strict=True)]
    np.testing.assert_allclose(observer.settling(DT), DT * (np.array(last) + 1))


def test_peaking_grows_with_the_gain() -> None:
    low, high = (
        peaking(LowPowerObserver(4, ell, method="euler", timing="predictor").spec)
        for ell in (10.0, 20.0)
    )
    np.testing.assert_allclose(high / low, 2.0 ** np.arange(4), rtol=1e-9)


# --- gains that move, and refusals ------------------------------------------------------------


def test_a_gain_that_moves_is_frozen_where_it_stands() -> None:
    moving = StandardObserver(
        2, AdaptiveGain(10.0, 0.01, 0.2), k=[2.0, 2.0], method="euler", timing="predictor"
    )
    moving.reset(r0=7.0)
    np.testing.assert_allclose(
        moving.bandwidth(),
        StandardObserver(2, 7.0, k=[2, 2], method="euler", timing="predictor").bandwidth(),
    )
    np.testing.assert_allclose(
        moving.noise_gain(0.01, gain=3.0),
        StandardObserver(2, 3.0, k=[2, 2], method="euler", timing="predictor").noise_gain(0.01),
    )


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (
            lambda: StandardObserver(2, 50.0, method="euler", timing="predictor").noise_gain(1.0),
            "dt = 1.0: must be a stable step",
        ),
        (
            lambda: StandardObserver(2, 50.0, method="euler", timing="predictor").bandwidth(-1.0),
            "dt = -1.0",
        ),
        (
            lambda: StandardObserver(2, 50.0, method="euler", timing="predictor").bandwidth(
                gain=2.0
            ),
            "gain = 2.0: must be left out",
        ),
        (
            lambda: StandardObserver(2, 50.0, method="euler", timing="predictor").settling(
                within=2.0
            ),
            "within",
        ),
        (lambda: SampledDataObserver().bandwidth(), "recursion: give dt"),
        (
            lambda: RepelledCollection(
                AdaptiveGain(10.0, 0.01, 0.2), k=[2, 2], k_bar=[0.1, 0.1], timing="predictor"
            ).peaking(gain=2.0),
            "a law with one chain",
        ),
        (lambda: discrete({**LAWS["standard 2"], "method": "rk5"}, 0.1), "method = 'rk5'"),
        (lambda: discrete({**LAWS["standard 2"], "timing": "late"}, 0.1), "timing = 'late'"),
    ],
)
def test_refusals(call: Any, match: str) -> None:
    with pytest.raises(DesignError, match=match):
        call()
