"""Studies: what they depend on, what they measure, and where their noise comes from."""

import os
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp
from scipy.stats import kstest, norm

from hgo_rs import (
    AdaptiveGain,
    ColouredNoise,
    Crackle,
    FixedStep,
    ImpulsiveNoise,
    LaplaceNoise,
    Lee,
    LowPowerObserver,
    Noise,
    NormalNoise,
    PeakingFreeObserver,
    RecordedNoise,
    ReducedOrderObserver,
    RepelledCollection,
    SampledDataObserver,
    SanfelicePraly,
    Ship,
    Sines,
    StandardObserver,
    StochasticApproximation,
    StudentTNoise,
    UniformNoise,
    VanDerPol,
    _core,
    filtered_noise,
    simulate,
)

LEE = StandardObserver(2, 20.0, model=Lee())
RECURSION = StandardObserver(2, 20.0, model=Lee(), method="euler", timing="predictor")


def lee(observer=LEE, **changes):
    settings = {"x0": [1.0, -0.5], "dt": 0.01, "steps": 400, "every": 1, "rng": 3}
    return simulate(Lee(), observer, **settings | changes)


def same(one, other):
    """Equal bits in every number of two results."""
    for key in ("mean", "rms", "max", "peak", "settling_time", "final_x", "final_memory"):
        np.testing.assert_array_equal(getattr(one, key), getattr(other, key), err_msg=key)
    for key in ("x", "memory", "y", "diverged_at"):
        np.testing.assert_array_equal(getattr(one, key), getattr(other, key), err_msg=key)


# --- what a run depends on ----------------------------------------------------------------------


def noisy(runs):
    plant, observer = VanDerPol(), SampledDataObserver()
    return simulate(
        plant,
        observer,
        x0=[1.0, 0.0],
        dt=0.02,
        steps=300,
        plant_method="taylor-1.5",
        substeps=3,
        noise=NormalNoise(0.0, 0.05),
        runs=runs,
        rng=11,
        windows=[(1.0, 6.0)],
        settle=0.3,
        every=7,
    )


def test_run_i_depends_on_seed_and_i_alone():
    together = noisy(8)
    for i in (0, 3, 7):
        alone = _core.simulate({**together.spec, "runs": 1, "first_run": i})
        for key in ("mean", "rms", "max", "peak", "settling_time", "x", "memory", "y"):
            np.testing.assert_array_equal(alone[key][0], getattr(together, key)[i], err_msg=key)
        np.testing.assert_array_equal(alone["final_memory"][0], together.final_memory[i])
    # and the runs, the two kinds of noise and the seeds are not the same
    assert len(np.unique(together.final_x, axis=0)) == 8
    assert not np.any(lee(noise=NormalNoise()).y == lee(noise=NormalNoise(), rng=4).y)


BITS = """
import hashlib
import sys
sys.path.insert(0, {here!r})
from test_simulate import noisy
out = noisy(17)
names = ("mean", "rms", "max", "peak", "settling_time", "x", "memory", "y", "final_memory")
digest = hashlib.sha256()
for name in names:
    digest.update(getattr(out, name).tobytes())
print(digest.hexdigest())
"""


def test_bits_do_not_depend_on_threads():
    here = os.path.dirname(__file__)  # noqa: PTH120
    digests = {
        subprocess.run(
            [sys.executable, "-c", BITS.format(here=here)],
            env={**os.environ, "RAYON_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for threads in ("1", "2", "5")
    }
    assert len(digests) == 1
    assert len(digests.pop()) == 65


def test_a_generator_gives_a_seed():
    rng = np.random.default_rng(5)
    seed = int(np.random.default_rng(5).integers(2**63))
    same(lee(rng=rng, noise=UniformNoise()), lee(rng=seed, noise=UniformNoise()))
    # it moves on: the next study is another one
    assert not np.array_equal(
        lee(rng=rng, noise=UniformNoise()).y, lee(rng=seed, noise=UniformNoise()).y
    )


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"observer": RECURSION},
        {"observer": RECURSION, "mode": "joint"},
        {"noise": NormalNoise(0.1, 0.2, hold=0.03, sines=[(0.1, 30.0, 0.2)]), "runs": 3},
        {"schedule": StochasticApproximation(0.2, 0.05, 100.0), "dt": None},
        {"plant_schedule": FixedStep(0.005), "plant_method": "euler", "substeps": 2},
        {"plant_method": "held", "windows": [(1.0, 2.0), (2.0, 4.0)], "histogram": (1.0, 4.0)},
        {"settle": 0.01},
    ],
    ids=lambda settings: str({k: v for k, v in settings.items() if k != "observer"}),
)
def test_both_backends_give_the_same(settings):
    rust, numpy = lee(**settings), lee(backend="numpy", **settings)
    for key in ("mean", "rms", "max", "peak", "settling_time", "final_x", "final_memory"):
        np.testing.assert_allclose(
            getattr(rust, key), getattr(numpy, key), rtol=1e-10, atol=1e-13, err_msg=key
        )
    for key in ("time", "x", "memory", "x_hat", "y", "diverged_at", "undefined_at"):
        np.testing.assert_allclose(
            getattr(rust, key), getattr(numpy, key), rtol=1e-10, atol=1e-13, err_msg=key
        )
    if rust.histogram is not None:
        np.testing.assert_array_equal(rust.histogram["counts"], numpy.histogram["counts"])
        assert rust.quantile(0.3) == pytest.approx(numpy.quantile(0.3), rel=1e-12)


# --- the plant and the observer -----------------------------------------------------------------


def test_the_plant_is_the_plant():
    """Lee (38) and crackle (20) by SciPy's DOP853."""
    out = lee(dt=0.01, steps=500)
    x = solve_ivp(
        lambda _, x: [x[1], -x[0] / (1.0 + x[0] ** 2) - x[1]],
        (0.0, 5.0),
        [1.0, -0.5],
        "DOP853",
        t_eval=out.time,
        rtol=1e-12,
        atol=1e-12,
    ).y.T
    np.testing.assert_allclose(out.x[0], x, atol=1e-8)
    np.testing.assert_array_equal(out.y[0, :, 0], out.x[0, :, 0])

    start = [-0.8, 0.0, 0.0, 0.0, 0.0]
    observer = LowPowerObserver(5, 7.0, model=Crackle())
    out = simulate(Crackle(), observer, x0=start, dt=1e-3, t_end=5.0, every=100)
    x = solve_ivp(
        lambda _, x: [*x[1:], 0.2 * (x[0] ** 2 - 1.0) - x[1] - x[2] - 4.0 * x[3] - x[4]],
        (0.0, 5.0),
        start,
        "DOP853",
        t_eval=out.time,
        rtol=1e-12,
        atol=1e-12,
    ).y.T
    np.testing.assert_allclose(out.x[0], x, atol=1e-10)


@pytest.mark.parametrize(
    ("plant", "observer", "settings"),
    [
        (Lee(), LEE, {"x0": [1.0, 0.0]}),
        (VanDerPol(sigma=0.0), SampledDataObserver(), {"x0": [1.0, 0.0]}),
        (
            SanfelicePraly(1.9),
            StandardObserver(2, AdaptiveGain(10.0, 0.0025, 0.183), k=(2, 2), method="rk4"),
            {"x0": SanfelicePraly(1.9).equilibrium, "plant_method": "held"},
        ),
    ],
    ids=["lee", "van-der-pol", "sanfelice-praly"],
)
def test_a_study_is_a_run_over_its_own_samples(plant, observer, settings):
    out = simulate(
        plant, observer, dt=2.0**-7, steps=300, noise=UniformNoise(-0.1, 0.1), every=1, **settings
    )
    run = observer.run(2.0**-7, out.y[0, :, 0])
    np.testing.assert_array_equal(run.memory, out.memory[0])
    np.testing.assert_array_equal(run.time, out.time)
    np.testing.assert_array_equal(out.final_memory[0], out.memory[0, -1])
    np.testing.assert_array_equal(out.x_hat[0], run.x_hat)
    assert out.diverged_at.tolist() == out.undefined_at.tolist() == [-1]


def test_joint_mode_is_one_differential_equation():
    """Plant and observer together by DOP853; sampled mode is another thing."""
    observer = StandardObserver(2, 10.0, k=(3.0, 2.0), method="rk4", timing="predictor")
    settings = {
        "x0": [1.0, 0.0],
        "dt": 0.005,
        "steps": 400,
        "noise": Sines(sines=[(0.1, 9.0, 1.0)]),
    }
    out = simulate(Lee(), observer, mode="joint", **settings)

    def rate(t, s):
        x1, x2, h1, h2 = s
        e = x1 + 0.1 * np.sin(9.0 * t + 1.0) - h1
        return [x2, -x1 / (1.0 + x1**2) - x2, h2 + 30.0 * e, 200.0 * e]

    end = solve_ivp(rate, (0.0, 2.0), [1.0, 0.0, 0.0, 0.0], "DOP853", rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        [*out.final_x[0], *out.final_memory[0]], end.y[:, -1], rtol=1e-6, atol=1e-7
    )
    sampled = simulate(Lee(), observer, **settings)
    assert np.max(np.abs(sampled.final_memory - out.final_memory)) > 1e-3


def test_runs_may_start_apart():
    starts = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.5]])
    memories = np.array([[0.1, 0.2, 0.0], [0.3, 0.4, 0.0], [0.5, 0.6, 0.0]])
    out = lee(x0=starts, memory0=memories, runs=3)
    np.testing.assert_array_equal(out.x[:, 0], starts)
    np.testing.assert_array_equal(out.memory[:, 0], memories)
    for i in range(3):
        one = lee(x0=starts[i], memory0=memories[i])
        np.testing.assert_array_equal(one.memory[0], out.memory[i])


def test_a_decreasing_schedule_slows_the_clock():
    """a(k) = alpha epsilon (1 + k/k0)^-p, t(k) = sum of a."""
    clock = StochasticApproximation(0.5, 0.04, 50.0, 0.8)
    out = lee(dt=None, schedule=clock)
    a = 0.02 * (1.0 + np.arange(400) / 50.0) ** -0.8
    np.testing.assert_allclose(out.time, np.append(0.0, np.cumsum(a)), rtol=1e-13)
    assert clock.longest == 0.02


def test_divergence_is_told_and_the_rest_goes_on():
    """One run of two starts where x' grows without bound; its frames end in NaN."""
    observer = StandardObserver(2, 10.0)
    out = simulate(
        SanfelicePraly(1.9),
        observer,
        x0=[[1e9, 0.0], [1.0, 0.0]],
        dt=0.01,
        steps=500,
        runs=2,
        every=1,
        windows=[(0.0, 5.0)],
    )
    k = int(out.diverged_at[0])
    assert 300 < k < 500
    assert out.diverged_at[1] == -1
    assert np.isfinite(out.x[0, :k]).all()
    assert np.isnan(out.x[0, k:]).all()
    assert np.isfinite(out.x[1]).all()
    error = out.x_hat[0, :k] - out.x[0, :k]
    np.testing.assert_allclose(out.rms[0, 0], np.sqrt(np.mean(error**2, axis=0)), rtol=1e-12)


# --- what is measured ---------------------------------------------------------------------------


def test_windows_are_in_seconds_and_half_open():
    out = lee(noise=NormalNoise(0.0, 0.1), runs=2, windows=[(0.5, 1.5), (1.5, 4.0), (3.0, 100.0)])
    error = out.x_hat - out.x
    for i, (first, last) in enumerate([(50, 150), (150, 400), (300, 401)]):
        part = error[:, first:last]
        np.testing.assert_allclose(out.mean[:, i], part.mean(axis=1), rtol=1e-11, atol=1e-15)
        np.testing.assert_allclose(out.rms[:, i], np.sqrt((part**2).mean(axis=1)), rtol=1e-12)
        np.testing.assert_array_equal(out.max[:, i], np.abs(part).max(axis=1))
        np.testing.assert_allclose(out.std[:, i], part.std(axis=1), rtol=1e-9)
    np.testing.assert_array_equal(out.peak, np.abs(out.x_hat).max(axis=1))


def test_windows_of_another_schedule_are_in_steps():
    clock = StochasticApproximation(0.5, 0.04, 50.0)
    out = lee(dt=None, schedule=clock, windows=[(10, 30)], noise=UniformNoise())
    part = (out.x_hat - out.x)[:, 10:30]
    np.testing.assert_allclose(out.rms[:, 0], np.sqrt((part**2).mean(axis=1)), rtol=1e-12)


def test_signals_beyond_the_error_are_the_rest_of_the_memory():
    observer = PeakingFreeObserver(5, 7.0, saturation=3.0, model=Crackle())
    out = simulate(
        Crackle(),
        observer,
        x0=[-0.8, 0, 0, 0, 0],
        dt=1e-3,
        t_end=1.0,
        every=1,
        windows=[(0.2, 0.8)],
    )
    eta = out.memory[..., 5:9]  # the time of the next correction is no signal
    signals = np.concatenate([out.x_hat - out.x, eta], axis=-1)[:, 200:800]
    np.testing.assert_allclose(out.mean[:, 0], signals.mean(axis=1), rtol=1e-10)
    np.testing.assert_array_equal(out.max[:, 0], np.abs(signals).max(axis=1))


def test_the_settling_time_is_the_last_violation():
    out = lee(settle=0.02)
    distance = np.linalg.norm(out.x_hat - out.x, axis=-1)[0]
    assert out.settling_time[0] == out.time[np.flatnonzero(distance >= 0.02)[-1]]
    assert 0.0 < out.settling_time[0] < 4.0
    assert np.isnan(lee().settling_time).all()
    assert lee(settle=1e9).settling_time.tolist() == [0.0]


def test_quantiles_are_those_of_the_frames():
    out = lee(noise=NormalNoise(0.0, 0.1), runs=40, histogram=(1.0, 4.0))
    square = np.sum((out.x_hat - out.x) ** 2, axis=-1)[:, 100:400]
    assert out.histogram["counts"].sum() == square.size
    for q in (0.05, 0.5, 0.95):
        assert out.quantile(q) == pytest.approx(np.quantile(square, q), rel=0.012)


def test_every_keeps_every_so_manieth_frame():
    whole, part = lee(noise=NormalNoise()), lee(noise=NormalNoise(), every=7)
    for key in ("x", "memory", "y"):
        np.testing.assert_array_equal(getattr(part, key), getattr(whole, key)[:, ::7])
    np.testing.assert_array_equal(part.time, whole.time[::7])
    none = lee(every=0)
    assert none.time is none.x is none.memory is none.x_hat is none.y is None
    assert lee(t_end=4.0, steps=None).spec["steps"] == 400


def test_a_ship_is_seen_in_its_velocity():
    out = simulate(
        Ship(),
        ReducedOrderObserver(0.1),
        x0=[0.0, 6.0, 0.0, 0.5, 0.0, 0.0],
        dt=0.1,
        t_end=20.0,
        every=1,
        windows=[(5.0, 20.0)],
    )
    assert out.x.shape == (1, 201, 6)
    assert out.y.shape == (1, 201, 3)
    error = out.x_hat - out.x[..., 3:]
    np.testing.assert_allclose(out.max[:, 0], np.abs(error[:, 50:200]).max(axis=1), rtol=1e-12)
    figure = out.plot()
    np.testing.assert_array_equal(figure.axes[0].get_lines()[0].get_ydata(), out.x[0, :, 3])


def test_plot_draws_states_and_estimates():
    out = lee(runs=2, noise=UniformNoise())
    figure = Figure()
    assert out.plot(figure, run=1) is figure
    assert [ax.get_title(loc="left") for ax in figure.axes] == [
        r"$\hat x_{1}$",
        r"$\hat x_{2}$",
    ]
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert labels == ["true", "estimate"]
    for i, panel in enumerate(figure.axes):
        truth, estimate = panel.get_lines()
        np.testing.assert_array_equal(truth.get_ydata(), out.x[1, :, i])
        np.testing.assert_array_equal(estimate.get_ydata(), out.x_hat[1, :, i])
    assert figure.axes[-1].get_xlabel() == "time (s)"


# --- noise --------------------------------------------------------------------------------------


def drawn(noise, steps=20_000, **more):
    """The noise itself: what is measured of a plant that stands still at 0."""
    return lee(noise=noise, steps=steps, x0=[0.0, 0.0], plant_method="held", **more).y[..., 0]


def test_noise_has_the_distribution_that_it_says():
    values = drawn(UniformNoise(-1.0, 3.0))[0]
    assert kstest(values, "uniform", (-1.0, 4.0)).pvalue > 1e-3
    assert -1.0 <= values.min() < values.max() < 3.0
    values = drawn(NormalNoise(-0.02, 0.015))[0]
    assert kstest(values, "norm", (-0.02, 0.015)).pvalue > 1e-3
    assert abs(np.corrcoef(values[1:], values[:-1])[0, 1]) < 0.03
    both = drawn(NormalNoise(), runs=2)
    assert abs(np.corrcoef(both)[0, 1]) < 0.03


def test_heavy_tails_have_the_distribution_that_they_say():
    for nu in (1.0, 2.5, 30.0):
        values = drawn(StudentTNoise(nu, -0.02, 0.5))[0]
        assert kstest(values, "t", (nu, -0.02, 0.5)).pvalue > 1e-3
    values = drawn(LaplaceNoise(0.3, 2.0))[0]
    assert kstest(values, "laplace", (0.3, 2.0)).pvalue > 1e-3

    def mixture(v):
        return 0.8 * norm.cdf(v, 0.1, 0.5) + 0.2 * norm.cdf(v, 0.1, 4.0)

    values = drawn(ImpulsiveNoise(0.5, 0.2, 8.0, 0.1))[0]
    assert kstest(values, mixture).pvalue > 1e-3
    for noise in (StudentTNoise(), LaplaceNoise(), ImpulsiveNoise(), ColouredNoise()):
        whole, part = drawn(noise, 50, runs=3), drawn(noise, 50, runs=1)
        np.testing.assert_array_equal(whole[:1], part)  # a run draws alike beside others
        assert not (whole[1] == whole[2]).any()


def test_coloured_noise_is_stationary_from_its_first_sample():
    ar = [1.2, -0.5]
    values = drawn(ColouredNoise(ar, 0.3), steps=8, runs=20_000)
    assert np.abs(values.std(axis=0) / 0.3 - 1.0).max() < 0.03
    # Yule and Walker: rho_1 = a_1/(1 - a_2), rho_2 = a_1 rho_1 + a_2
    rho = [1.0, 0.8]
    rho.append(1.2 * rho[1] - 0.5)
    for first, lag in ((0, 1), (0, 2), (5, 1), (6, 2)):
        found = np.corrcoef(values[:, first], values[:, first + lag])[0, 1]
        assert abs(found - rho[lag]) < 0.03
    # the innovations of a long run are white
    v = drawn(ColouredNoise(ar, 0.3))[0]
    e = v[2:] - 1.2 * v[1:-1] + 0.5 * v[:-2]
    assert abs(np.corrcoef(e[1:], e[:-1])[0, 1]) < 0.03
    assert kstest(e / e.std(), "norm").pvalue > 1e-3


def test_a_draw_is_held_for_seconds():
    values = drawn(NormalNoise(hold=0.05), steps=1000)[0]
    blocks = values[:1000].reshape(200, 5)
    assert (blocks == blocks[:, :1]).all()
    assert len(np.unique(blocks[:, 0])) == 200
    # the draws are those of the shorter clock, held
    np.testing.assert_array_equal(blocks[:, 0], drawn(NormalNoise(), steps=199)[0])


def test_sines_are_added():
    t = 0.01 * np.arange(301)
    wave = 0.3 * np.sin(5.0 * t + 0.1) - 0.2 * np.sin(40.0 * t)
    sines = [(0.3, 5.0, 0.1), (-0.2, 40.0, 0.0)]
    np.testing.assert_allclose(drawn(Sines(sines=sines), steps=300)[0], wave, atol=1e-14)
    mixed = drawn(UniformNoise(sines=sines), steps=300)[0]
    np.testing.assert_allclose(mixed - wave, drawn(UniformNoise(), steps=300)[0], atol=1e-14)
    assert not drawn(Noise(), steps=300).any()


def test_recorded_noise_is_played_back():
    values = np.random.default_rng(1).normal(size=(3, 301))
    np.testing.assert_array_equal(drawn(RecordedNoise(values=values), steps=300, runs=3), values)
    shared = drawn(RecordedNoise(values=values[0]), steps=300, runs=2)
    np.testing.assert_array_equal(shared, values[[0, 0]])


def test_filtered_noise_has_its_band():
    """Butterworth of order 6: -3 dB at the edges, nothing left a decade away."""
    values = filtered_noise(200_000, 1e-3, (20.0, 200.0), seed=4)
    power = np.abs(np.fft.rfft(values)) ** 2
    omega = 2.0 * np.pi * np.fft.rfftfreq(200_000, 1e-3)

    def density(low, high):
        return power[(omega > low) & (omega < high)].mean()

    middle = density(40.0, 100.0)
    assert density(195.0, 205.0) / middle == pytest.approx(0.5, rel=0.25)
    assert density(19.5, 20.5) / middle == pytest.approx(0.5, rel=0.5)
    assert density(0.1, 5.0) / middle < 1e-4
    assert density(2000.0, 3000.0) / middle < 1e-7
    scaled = filtered_noise(1000, 1e-3, (None, 200.0), peak=0.7, seed=4)
    assert np.max(np.abs(scaled)) == pytest.approx(0.7)
    assert not np.array_equal(scaled, filtered_noise(1000, 1e-3, (None, 200.0), peak=0.7, run=1))


def test_copies_of_a_collection_settle_apart():
    """Repelled copies spread over the limit cycle; r_bar is near nu1/(k1 - 3 k_bar1) = 1.2114."""
    plant = SanfelicePraly(2.22)
    observer = RepelledCollection(
        AdaptiveGain(20.0, 0.0025, 0.183), k=(2.0, 2.0), k_bar=(0.0558, 0.0317), model=plant
    )
    apart = np.array([[0.05, 0.0], [-0.03, 0.05], [-0.02, -0.05]])
    out = simulate(
        plant,
        observer,
        x0=plant.equilibrium,
        memory0=observer.spread(plant.equilibrium + apart, 1.2),
        dt=0.01,
        t_end=400.0,
        plant_method="held",
        every=1,
    )
    gain = observer.nominal_gain(out.memory[0, -4000:])
    assert gain.mean() == pytest.approx(2.22 / (2.0 - 3 * 0.0558), abs=0.012)
    assert np.std(gain) < 0.1 * np.std(out.memory[0, -4000:, 2])  # out of phase: the mean is still
