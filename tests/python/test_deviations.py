"""Standard deviations of an observer's estimates: Lyapunov's equation, simulation, coverage."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from hgo_rs import (
    AdaptiveGain,
    HgoError,
    HighGainEKF,
    LowPowerObserver,
    Model,
    MultiOutputObserver,
    StandardObserver,
    Stubborn,
    tune,
)
from hgo_rs.design.discrete import discrete
from hgo_rs.tuning.linear import stationary

PENDULUM = Model(states=["q", "v"], phi="-25*sin(q) - 0.1*v")
R, Q, DT = 9e-6, 0.04, 0.01


def swing(seed, count=3000, steps=20):
    """States and samples of the pendulum, pushed by white noise."""
    rng = np.random.default_rng(seed)
    x, q, v, h = np.empty((count, 2)), 2.0, 0.0, DT / steps
    for k in range(count):
        x[k] = q, v
        for kick in np.sqrt(Q * h) * rng.standard_normal(steps):
            v += h * (-25.0 * np.sin(q) - 0.1 * v) + kick
            q += h * v
    return x, x[:, 0] + np.sqrt(R) * rng.standard_normal(count)


KNOWN = {"noise": np.sqrt(R), "model_error": np.sqrt(Q)}


@pytest.mark.parametrize("timing", ["current", "predictor"])
@pytest.mark.parametrize("build", [StandardObserver, LowPowerObserver])
@pytest.mark.parametrize("method", ["zoh", "bilinear"])
def test_without_a_model_they_come_to_rest_at_lyapunovs_equation(build, method, timing):
    observer = build(3, 12.0, method=method, timing=timing)
    run = observer.run(DT, np.sin(DT * np.arange(1000)), **KNOWN)
    found = stationary(observer.spec, DT)
    both = R * found.shown[0] + Q * found.shown[1]
    assert run.deviation[-1] == pytest.approx(np.sqrt(np.diag(both)), rel=1e-9)


def test_an_innovation_that_is_kept_between_samples_has_its_place():
    """The inter-sample predictor keeps the innovation beside the estimate: simulated, it has the
    deviation that is told.
    """
    observer = StandardObserver(2, 8.0, method="inter-sample", timing="predictor")
    rng = np.random.default_rng(3)
    x, kicks = np.zeros((60_000, 2)), np.sqrt(Q * DT) * rng.standard_normal(60_000)
    for k in range(1, len(x)):  # a kick at the middle of each step
        q, v = x[k - 1]
        x[k] = q + DT * v + 0.5 * DT * kicks[k], v + kicks[k]
    run = observer.run(DT, x[:, 0] + np.sqrt(R) * rng.standard_normal(len(x)), **KNOWN)
    error = (run.x_hat[: len(x)] - x)[2000:]
    assert run.deviation[-1] == pytest.approx(np.sqrt(np.mean(error**2, axis=0)), rel=0.03)


def test_constant_slopes_are_in_lyapunovs_equation():
    """A stiff spring: F by the matrix exponential, K of the law; none of it by the module."""
    from scipy.linalg import expm

    model = Model(states=["q", "v"], phi="-400*q - 2*v")
    observer = StandardObserver(2, 20.0, model=model, method="zoh", timing="current")
    run = observer.run(DT, 0.01 * np.sin(DT * np.arange(2000)), **KNOWN)
    law = discrete(observer.spec, DT)
    k = law.d  # of the correction, x_hat+ = x_hat + K e
    f = expm(np.array([[0.0, 1.0], [-400.0, -2.0]]) * DT)
    w = Q * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]])
    rest = np.eye(2) - k @ np.array([[1.0, 0.0]])
    p = solve_discrete_lyapunov(rest @ f, rest @ w @ rest.T + R * k @ k.T)
    assert run.deviation[-1] == pytest.approx(np.sqrt(np.diag(p)), rel=2e-4)


@pytest.mark.parametrize("ell", [4.0, 12.0, 40.0])
def test_bands_cover_at_any_gain(ell):
    """Not at the gain of a Kalman filter alone: the deviations are the observer's own."""
    covered = []
    for seed in range(3):
        x, y = swing(seed)
        observer = StandardObserver(2, ell, model=PENDULUM)
        run = observer.run(DT, y, x_hat0=[y[0], 0.0], **KNOWN)
        low, high = run.band(0.95)
        covered.append(np.mean(((low <= x) & (x <= high))[100:], axis=0))
    assert np.all(np.abs(np.mean(covered, axis=0) - 0.95) < 0.02)


def test_two_outputs_and_missing_samples():
    """Two pendulums that do not touch: each as alone; without samples the band grows."""
    pair = Model(
        states=["a", "b", "c", "d"],
        orders=[2, 2],
        phi=["-25*sin(a) - 0.1*b", "-25*sin(c) - 0.1*d"],
    )
    (_, one), (_, two) = swing(1, 400), swing(2, 400)
    two = two.copy()
    two[200:230] = np.nan
    law = [StandardObserver(2, ell) for ell in (10.0, 15.0)]
    both = MultiOutputObserver(law, model=pair).run(DT, np.column_stack([one, two]), **KNOWN)
    for columns, ell, y in ((slice(0, 2), 10.0, one), (slice(2, 4), 15.0, two)):
        alone = StandardObserver(2, ell, model=PENDULUM).run(DT, y, **KNOWN)
        # chains hold each other's states over a step, which moves estimates and slopes a little
        assert np.allclose(both.deviation[50:, columns], alone.deviation[50:], rtol=0.02)
    assert np.all(both.deviation[229, 2:] > 1.5 * both.deviation[199, 2:])


def test_uneven_steps_are_a_record_with_samples_left_out():
    """Twice the step, without a model and the placed law, is not one missing sample: another gain.
    So against the law by hand.
    """
    t = np.cumsum(np.tile([0.01, 0.02, 0.015], 100))
    observer = StandardObserver(2, 15.0)
    run = observer.run(t, np.sin(t), **KNOWN)
    z = np.diag(run.deviation[0] ** 2)
    steps = np.diff(t)
    law = [discrete(observer.spec, float(dt)) for dt in steps]
    z = np.eye(2)
    for dt, of in zip(steps, law, strict=True):
        w = Q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        z = of.a @ z @ of.a.T + R * of.b @ of.b.T + w
    last = law[-1]
    shown = last.c @ z @ last.c.T + R * last.d @ last.d.T
    assert run.deviation[-1] == pytest.approx(np.sqrt(np.diag(shown)), rel=1e-3)


def test_a_filter_with_its_own_noises_tells_its_own_covariance():
    """P of a high-gain EKF, by another recursion; with other noises its gains are not the best."""
    x, y = swing(8)
    observer = HighGainEKF(2, R=R, Q=Q, P0=[R, 64.0], model=PENDULUM)
    run = observer.run(DT, y, x_hat0=[y[0], 0.0], **KNOWN)
    own = np.sqrt(np.diagonal(observer.covariance(run.memory), axis1=1, axis2=2))
    assert np.allclose(run.deviation[200:], own[200:], rtol=1e-3)
    slow = HighGainEKF(2, R=100.0 * R, Q=Q, P0=[R, 64.0], model=PENDULUM)
    run = slow.run(DT, y, x_hat0=[y[0], 0.0], **KNOWN)
    assert np.all(run.deviation[200:] > own[200:])
    low, high = run.band(0.95)
    covered = np.mean(((low <= x) & (x <= high))[200:], axis=0)
    assert np.all(np.abs(covered - 0.95) < 0.04)


LAWS = {
    "standard": lambda: StandardObserver(2, 12.0, model=PENDULUM),
    "predictor": lambda: StandardObserver(2, 12.0, model=PENDULUM, timing="predictor"),
    "low-power": lambda: LowPowerObserver(3, 25.0),
    "filter": lambda: HighGainEKF(2, R=R, Q=Q, P0=[R, 64.0], model=PENDULUM),
}


@pytest.mark.parametrize("name", LAWS)
def test_outliers_hardly_raise_the_error_behind_a_gate(name):
    """50 standard deviations in 1 % of the samples: at most 10 % more error."""
    x, y = swing(9, 4000)
    rng = np.random.default_rng(1)
    wild = np.flatnonzero(rng.random(4000) < 0.01)
    wild = wild[wild > 100]
    hit = y.copy()
    hit[wild] += 50.0 * np.sqrt(R) * rng.choice([-1.0, 1.0], wild.size)
    observer, start = LAWS[name](), [y[0], 0.0]
    start += [0.0] * (observer.n - 2)
    known = KNOWN if observer.n == 2 else {"noise": np.sqrt(R), "model_error": 60.0}
    clean = observer.run(DT, y, x_hat0=start)
    gated = observer.run(DT, hit, x_hat0=start, gate=6.0, **known)
    open_gate = observer.run(DT, hit, x_hat0=start)
    error, of_gated, of_open = (
        np.sqrt(np.mean((run.x_hat[100:, :2] - x[100:]) ** 2, axis=0))
        for run in (clean, gated, open_gate)
    )
    assert set(wild) <= set(np.flatnonzero(gated.gated[:, 0]))
    assert gated.gated.sum() <= 1.1 * wild.size
    assert np.all(of_gated < 1.1 * error) and np.all(of_open > 1.2 * error)
    assert np.array_equal(gated.columns()["gated"], gated.gated[:, 0].astype(float))
    # the decisions are those of a run that leaves these samples out
    left = np.where(gated.gated[:, 0], np.nan, hit)
    assert np.array_equal(observer.run(DT, left, x_hat0=start).x_hat, gated.x_hat)


def test_a_jump_opens_the_gate_again():
    """y stays off by far: deviations grow while samples are left out, until they are taken."""
    _, y = swing(10, 1500)
    y[700:] += 0.5
    observer = StandardObserver(2, 12.0, model=PENDULUM)
    run = observer.run(DT, y, x_hat0=[y[0], 0.0], gate=5.0, **KNOWN)
    assert run.gated[700, 0] and not run.gated[-300:].all()


def test_a_tuned_observer_tells_them():
    x, y = swing(5)
    tuned = tune(PENDULUM, (DT, y))
    run = tuned.run((DT, y))
    assert run.deviation is not None
    error = np.sqrt(np.mean((run.x_hat[:, :2] - x)[100:] ** 2, axis=0))
    told = np.sqrt(np.mean(run.deviation[100:, :2] ** 2, axis=0))
    assert told == pytest.approx(error, rel=0.25)
    assert 0.0 <= run.whiteness <= 1.0 and 0.0 <= run.normality <= 1.0


def test_whiteness_and_normality_of_innovations():
    """Of the right gain white; of a low one not; outliers are not normal."""
    _, y = swing(6)
    high = StandardObserver(2, 3.0, model=PENDULUM).run(DT, y, x_hat0=[y[0], 0.0])
    assert high.whiteness < 1e-6
    rng = np.random.default_rng(0)
    noise = StandardObserver(1, 1e-3).run(DT, rng.standard_normal(4000))
    assert noise.whiteness > 1e-3 and noise.normality > 1e-3
    wild = rng.standard_normal(4000)
    wild[::100] *= 20.0
    assert StandardObserver(1, 1e-3).run(DT, wild).normality < 1e-6


def test_table_and_figure():
    _, y = swing(7, 300)
    run = StandardObserver(2, 12.0, model=PENDULUM).run(DT, y, **KNOWN)
    assert np.array_equal(run.columns()["std_v"], run.deviation[:, 1])
    assert np.array_equal(run.rows(slice(10, 20)).deviation, run.deviation[10:20])
    with pytest.raises(ValueError, match="read-only"):
        run.deviation[0, 0] = 1.0
    pytest.importorskip("matplotlib")
    axes = run.plot().get_axes()
    assert len(axes[0].collections) == len(axes[1].collections) == 1
    bare = StandardObserver(2, 12.0, model=PENDULUM).run(DT, y)
    assert bare.deviation is None and "std_q" not in bare.columns()
    assert not bare.plot().get_axes()[1].collections


@pytest.mark.parametrize(
    ("observer", "given", "told"),
    [
        (StandardObserver(2, 9.0), {"noise": 1.0}, "given together"),
        (StandardObserver(2, 9.0), {"gate": 5.0}, "noise and model_error"),
        (
            StandardObserver(2, 9.0, shape=Stubborn(1.0, 1.0)),
            {"noise": 1.0, "model_error": 1.0},
            "shape of the observer",
        ),
        (StandardObserver(2, 9.0), {"noise": 1.0, "model_error": 1.0, "gate": 0.0}, "gate = 0.0"),
        (StandardObserver(2, 9.0), {"noise": 0.0, "model_error": 1.0}, "noise = 0.0"),
        (StandardObserver(2, 9.0), {"noise": 1.0, "model_error": -1.0}, "model_error = -1.0"),
        (
            StandardObserver(2, AdaptiveGain(9.0, 1.0, 0.1)),
            {"noise": 1.0, "model_error": 1.0},
            "gain",
        ),
    ],
)
def test_refusals(observer, given, told):
    with pytest.raises(HgoError, match=told):
        observer.run(DT, np.sin(np.arange(99.0)), **given)
    bare = StandardObserver(2, 9.0).run(DT, np.sin(np.arange(99.0)))
    with pytest.raises(HgoError, match="deviation"):
        bare.band()


def test_deviations_follow_the_inputs_that_act():
    """A spring whose stiffness is the input: its mean over a period, given or asked for."""
    model = Model(states=["q", "v"], inputs=["k"], phi="-k*q - 2*v")
    t = DT * np.arange(600)
    y, k = np.sin(t), 400.0 * (1.0 + np.sign(np.sin(40.0 * t)))
    observer = StandardObserver(2, 10.0, model=model)
    means = np.append(0.5 * (k[1:] + k[:-1]), k[-1])
    asked = observer.run(t, y, k, input_hold="mean", **KNOWN)
    given = observer.run(t, y, means, **KNOWN)
    assert np.array_equal(asked.deviation, given.deviation)
    assert not np.allclose(asked.deviation, observer.run(t, y, k, **KNOWN).deviation, rtol=1e-2)


@pytest.mark.filterwarnings("ignore::hgo_rs.TuningWarning")
@pytest.mark.parametrize(("dt", "step", "q"), [(0.01, 0.05, 0.04), (1e-3, 0.005, 0.01)])
def test_bands_of_a_coarse_encoder_cover(dt, step, q):
    """Rounding that lasts for samples: bands of what `tune` finds, beside the state itself."""
    model = Model(states=["q", "v"], phi="-4*q - 0.1*v")
    rng, x, now = np.random.default_rng(2), np.empty((8000, 2)), np.array([0.3, 0.0])
    for k, kicks in enumerate(np.sqrt(q * dt / 5) * rng.standard_normal((8000, 5))):
        x[k] = now
        for kick in kicks:
            now[1] += dt / 5 * (-4.0 * now[0] - 0.1 * now[1]) + kick
            now[0] += dt / 5 * now[1]
    tuned = tune(model, (dt, np.round(x[:, 0] / step) * step))
    assert tuned.noise >= step / np.sqrt(12.0)
    run = tuned.run((dt, np.round(x[:, 0] / step) * step))
    low, high = run.band(0.95)
    covered = np.mean(((low[:, :2] <= x) & (x <= high[:, :2]))[500:], axis=0)
    assert np.all((covered > 0.92) & (covered < 0.985))
    usual = np.sqrt(np.mean(run.deviation[500:, :2] ** 2, axis=0))
    assert usual == pytest.approx(tuned.errors[:2], rel=0.2)
