"""Bad input gets one clear error, of one type and on one line, and nothing is lost."""

import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import hgo_rs
from hgo_rs import (
    AdaptiveGain,
    BiHomogeneous,
    ColouredNoise,
    ConstantGain,
    Crackle,
    DeadZone,
    DeadZoneGain,
    DesignError,
    Fal,
    FixedStep,
    HgoError,
    HomogeneousGain,
    ImpulsiveNoise,
    InputGain,
    LaplaceNoise,
    Lee,
    LowPowerObserver,
    ModifiedObserver,
    Noise,
    NormalNoise,
    PeakingFreeObserver,
    PiecewiseLinear,
    PrescribedTimeGain,
    RecordedNoise,
    ReducedOrderObserver,
    RepelledCollection,
    SampledDataObserver,
    SanfelicePraly,
    Ship,
    StandardObserver,
    StochasticApproximation,
    Stubborn,
    StudentTNoise,
    SwitchedGain,
    UniformNoise,
    Unknown,
    VanDerPol,
    WindowObserver,
    filtered_noise,
    scenarios,
    simulate,
)
from hgo_rs.cli.reproduce import OutputFolder
from hgo_rs.logs import read_log, write_table

NAN, INF = np.nan, np.inf
ADAPTIVE = AdaptiveGain(10.0, 0.0025, 0.183)
K = {"k": (2.0, 2.0), "k_bar": (0.0558, 0.0317)}
Y = [0.0, 0.1, 0.2]


def standard(**options):
    """Of the papers' form, which has a step limit."""
    return StandardObserver(2, 10.0, **{"method": "euler", "timing": "predictor"} | options)


def run(t=0.01, y=(0.0, 0.1, 0.2), u=None, **options):
    return standard().run(t, y, u, **options)


def step(y=1.0, u=None, dt=0.01):
    return standard().step(y, u, dt=dt)


def lee(observer=None, **changes):
    settings = {"x0": [1.0, 0.0], "dt": 0.01, "steps": 20}
    return simulate(Lee(), observer or standard(), **settings | changes)


def copies(**options):
    return RepelledCollection(ADAPTIVE, **K, **options)


def ship(**changes):
    settings = {"x0": [0.0, 6.0, 0.0, 0.5, 0.0, 0.0], "dt": 0.1, "steps": 20}
    return simulate(Ship(), ReducedOrderObserver(1.0), **settings | changes)


def ship_run(u, y=None):
    y = np.stack([np.arange(5.0), np.zeros(5), np.zeros(5)], axis=1) if y is None else y
    return ReducedOrderObserver(10.0).run(0.1, y, u)


STABLE = "left half plane"
CASES = {
    # poles and coefficients
    "unstable pole": (lambda: standard(poles=[-1, 1]), "poles = (1+0j)", STABLE),
    "pole on the axis": (lambda: standard(poles=[-1, 0]), "poles = 0j", "negative real part"),
    "pole without conjugate": (lambda: standard(poles=[-1 + 2j, -1]), "poles = (-1+2j)", "conjug"),
    "conjugate given once for two": (
        lambda: StandardObserver(3, 9.0, poles=[-1 + 2j, -1 + 2j, -1 - 2j]),
        "poles = (-1+2j)",
        "give both",
    ),
    "infinite pole": (lambda: standard(poles=[-1, -INF]), "poles = (-inf+0j)", "finite"),
    "poles that overflow": (lambda: standard(poles=[-1e300, -1e300]), "k = [2e+300, inf]", STABLE),
    "too few poles": (lambda: standard(poles=[-1]), "poles: 1 given", "needs 2"),
    "poles of a text": (lambda: standard(poles="ab"), "poles = 'ab'", "complex numbers"),
    "low-power: unstable": (
        lambda: LowPowerObserver(2, 9.0, poles=[-1, -2, 3]),
        "poles = (3+0j)",
        STABLE,
    ),
    "low-power: too few": (
        lambda: LowPowerObserver(3, 9.0, poles=[-1, -2, -3]),
        "poles: 3 given",
        "order 3 needs 5",
    ),
    "k not Hurwitz": (lambda: standard(k=[1, -1]), "k = [1.0, -1.0]", "all roots in the left"),
    "k and poles": (lambda: standard(k=[1, 1], poles=[-1, -1]), "k = [1, 1]", "give poles or k"),
    "k of another order": (lambda: standard(k=[1, 2, 3]), "k of shape (3,)", "2 entries"),
    "k not finite": (lambda: standard(k=[1, NAN]), "k = [1, nan]", "finite"),
    "alpha not Hurwitz": (
        lambda: LowPowerObserver(2, 9.0, alpha=[1, -1], beta=[1]),
        "alpha = -1",
        "Hurwitz",
    ),
    "alpha without beta": (lambda: LowPowerObserver(2, 9.0, alpha=[1, 1]), "beta", "together"),
    # order
    "order 0": (lambda: StandardObserver(0, 9.0), "n = 0", ">= 1 and <= 12"),
    "order 13": (lambda: StandardObserver(13, 9.0), "n = 13", ">= 1 and <= 12"),
    "order 2.5": (lambda: StandardObserver(2.5, 9.0), "n = 2.5", "integer"),
    "low-power of order 1": (lambda: LowPowerObserver(1, 9.0), "n = 1", ">= 2 and <= 12"),
    "peaking-free of order 13": (
        lambda: PeakingFreeObserver(13, 9.0, saturation=1.0),
        "n = 13",
        ">= 2 and <= 12",
    ),
    "one copy": (lambda: copies(copies=1), "copies = 1", ">= 2 and <= 5"),
    "model of another order": (
        lambda: StandardObserver(3, 9.0, model=Lee()),
        "model = Lee()",
        "order 3; its order is 2",
    ),
    # gains
    "gain 0": (lambda: StandardObserver(2, 0.0), "gain = 0.0", "> 0"),
    "negative gain": (lambda: StandardObserver(2, -3), "gain = -3", "> 0"),
    "infinite gain": (lambda: StandardObserver(2, INF), "gain = inf", "finite"),
    "gain of a text": (lambda: StandardObserver(2, "9"), "gain = '9'", "a number"),
    "gain beyond the floats": (lambda: StandardObserver(2, 10**400), "gain = 1000", "finite"),
    "epsilon 0": (lambda: StandardObserver(2, epsilon=0), "epsilon = 0", "> 0"),
    "epsilon NaN": (lambda: StandardObserver(2, epsilon=NAN), "epsilon = nan", "finite"),
    "epsilon and gain": (lambda: StandardObserver(2, 9.0, epsilon=0.1), "gain", "either"),
    "neither of them": (lambda: StandardObserver(2), "gain", "epsilon = 1/gain"),
    "ell 0": (lambda: ConstantGain(0.0), "ell = 0.0", "> 0"),
    "p1 < 0": (lambda: AdaptiveGain(-1.0, 0.1, 0.1), "p1 = -1.0", "> 0"),
    "p2 infinite": (lambda: DeadZoneGain(1.0, INF, 0.1), "p2 = inf", "finite"),
    "b = 1/2": (lambda: AdaptiveGain(1.0, 0.1, 0.5), "b = 0.5", "< 0.5"),
    "epsilon of the ship's law": (lambda: ReducedOrderObserver(-1.0), "epsilon = -1.0", "> 0"),
    "h_bar above 1": (
        lambda: ReducedOrderObserver(1.0, h_bar=(0.1, 0.2, 1.2)),
        "h_bar = 1.2",
        "(0, 1)",
    ),
    "collection of a fixed gain": (
        lambda: RepelledCollection(10.0, **K),
        "gain = 10.0",
        "AdaptiveGain",
    ),
    # steps
    "dt 0": (lambda: step(dt=0.0), "dt = 0.0", "> 0"),
    "dt < 0 over a record": (lambda: run(-0.01), "dt = -0.01", "> 0"),
    "dt NaN": (lambda: run(NAN), "dt = nan", "finite"),
    "dt infinite": (lambda: lee(dt=INF), "dt = inf", "finite"),
    "dt of a text": (lambda: step(dt="0.01"), "dt = '0.01'", "a number"),
    "dt of a schedule": (lambda: FixedStep(0.0), "dt = 0.0", "> 0"),
    "epsilon of a schedule": (
        lambda: StochasticApproximation(1.0, -1.0, 10.0),
        "epsilon = -1.0",
        "> 0",
    ),
    "dt at the limit, online": (lambda: step(dt=0.1), "dt = 0.1", "< 0.1 s"),
    "dt beyond the limit, record": (
        lambda: run(0.2),
        "dt = 0.2",
        "stability limit of this standard observer by euler",
    ),
    "dt beyond the limit, study": (lambda: lee(dt=0.3), "dt = 0.3", "allow_unstable=True"),
    "dt beyond the limit, joint": (lambda: lee(dt=0.3, mode="joint"), "dt = 0.3", "< 0.1 s"),
    "dt beyond the limit, ship": (lambda: ship(dt=11.0), "dt = 11.0", "< 10 s"),
    "first step of a schedule": (
        lambda: lee(dt=None, schedule=StochasticApproximation(1.0, 0.2, 10.0)),
        "dt = 0.2",
        "< 0.1 s",
    ),
    "a pause in a record": (
        lambda: run([0.0, 0.01, 3.01], Y),
        "after sample 1 (t = 0.01 s), dt = 3.0",
        "< 0.1 s",
    ),
    # records
    "y of two channels": (lambda: run(y=np.ones((3, 2))), "y of shape (3, 2)", "(N,)"),
    "y of none": (lambda: run(y=[]), "y of shape (0", "N >= 1"),
    "y a number": (lambda: run(y=3.0), "y of shape ()", "(N,)"),
    "y None": (lambda: run(y=None), "y = None", "give the samples"),
    "y of a text": (lambda: run(y="abc"), "y = 'abc'", "array of numbers"),
    "y ragged": (lambda: run(y=[[1.0], [1.0, 2.0]]), "y = [[1.0], [1.0, 2.0]]", "NaN"),
    "y complex": (lambda: run(y=[1j, 1.0, 2.0]), "y = [1j, 1.0, 2.0]", "numbers"),
    "y infinite": (lambda: run(y=[0.0, INF, 0.2]), "y at sample 1 is infinite", "NaN"),
    "y -infinite online": (lambda: step(-INF), "y at sample 0 is infinite", "finite"),
    "y of two online": (lambda: step([1.0, 2.0]), "y has 2 entries", "must have 1"),
    "t of another length": (lambda: run([0.0, 0.01], Y), "t of shape (2,)", "(3,)"),
    "t NaN": (lambda: run([0.0, NAN, 0.02], Y), "t at sample 1", "not finite"),
    "t infinite": (lambda: run([0.0, 0.01, INF], Y), "t at sample 2", "not finite"),
    "t standing": (lambda: run([0.0, 0.01, 0.01], Y), "0.01 s after 0.01 s", "must increase"),
    "t going back": (lambda: run([0.0, 0.02, 0.01], Y), "t at sample 2 is 0.01 s", "sort"),
    "t None": (lambda: run(None), "dt = nan", "finite"),
    "t with a span beyond the floats": (lambda: run([-1.7e308, 0.0, 1.7e308], Y), "dt =", "< 0.1"),
    "u that nobody wants": (lambda: run(u=Y), "u is given", "InputGain"),
    "u that is missing": (lambda: ship_run(None), "u is missing", "2 known input"),
    "u transposed": (lambda: ship_run(np.zeros((2, 5))), "u of shape (2, 5)", "(5, 2)"),
    "u NaN": (lambda: ship_run(np.full((5, 2), NAN)), "u at sample 0 is not finite", "needs one"),
    "u of one too few": (
        lambda: standard(model=InputGain(1.0)).run(0.01, Y, [1.0, 2.0]),
        "u of shape (2,)",
        "(3, 1)",
    ),
    "a ship at rest": (
        lambda: ship_run(np.zeros((5, 2)), np.zeros((5, 3))),
        "sample 1 (t = 0.1 s), y = 0, 0, 0",
        "start the record where the ship moves",
    ),
    "an estimate that diverges": (
        lambda: StandardObserver(2, ADAPTIVE).run(0.1, 1e3 * (-1.0) ** np.arange(50)),
        "diverged at sample",
        "allow_unstable=True",
    ),
    # starts
    "x_hat0 of another order": (lambda: run(x_hat0=[1.0]), "x_hat0 of shape (1,)", "2 entries"),
    "x_hat0 NaN": (lambda: run(x_hat0=[1.0, NAN]), "x_hat0 = [1.0, nan]", "finite"),
    "memory0 of another length": (lambda: run(memory0=[1.0]), "memory0 of shape (1,)", "2 entries"),
    "memory0 and x_hat0": (
        lambda: run(memory0=np.zeros((2, 2)), x_hat0=[0.0, 0.0]),
        "memory0 = array([[0., 0.], [0., 0.]])",
        "given alone",
    ),
    "r(0) < 1": (lambda: StandardObserver(2, ADAPTIVE).reset(r0=0.5), "r0 = 0.5", ">= 1"),
    "r(0) < 1 in a memory": (
        lambda: StandardObserver(2, ADAPTIVE).run(0.01, Y, memory0=[0.0, 0.0, 0.9, 0.0]),
        "r0 = 0.9",
        ">= 1",
    ),
    "r(0) < 1 in a study": (
        lambda: lee(StandardObserver(2, ADAPTIVE), memory0=[0.0, 0.0, 0.9, 0.0]),
        "r0 = 0.9",
        ">= 1",
    ),
    "r(0) < 1 in a copy": (
        lambda: copies().run(0.01, Y, memory0=[0, 0, 1, 1, 0, 0.2, 2, 0, 1, 0]),
        "r0 = 0.2",
        ">= 1",
    ),
    "r(0) where the gain is fixed": (lambda: run(r0=2.0), "r0 = 2.0", "left out"),
    "copies alike: default": (
        lambda: copies().run(0.01, Y),
        "starts of the copies = [[0.0, 0.0, 1.0], [0.0",
        "spread",
    ),
    "copies alike: online": (lambda: copies().step(1.0, dt=0.01), "starts of the copies", "spread"),
    "copies alike: spread": (
        lambda: copies().spread([[0, 1], [2, 3], [0, 1]]),
        "starts of the copies",
        "different",
    ),
    "copies alike: study": (lambda: lee(copies()), "starts of the copies", "never separate"),
    "copies alike: modified": (
        lambda: ModifiedObserver(ADAPTIVE, **K).run(0.01, Y),
        "starts of the copies",
        "never separate",
    ),
    "starts of too few copies": (
        lambda: copies().spread([[0, 1], [2, 3]]),
        "x_hat0 of shape (2, 2)",
        "(3, 2)",
    ),
    "gains of too few copies": (
        lambda: copies().spread([[0, 1], [2, 3], [4, 5]], [1.0, 2.0]),
        "r0 = [1.0, 2.0]",
        "3",
    ),
    # choices
    "unknown method": (lambda: standard(method="heun"), "method = 'heun'", "one of euler, "),
    "unknown clip": (
        lambda: PeakingFreeObserver(2, 9.0, saturation=1.0, clip="soft"),
        "clip = 'soft'",
        "hard, smooth",
    ),
    "unknown gain of Fu's law": (
        lambda: SampledDataObserver(gain="both"),
        "gain = 'both'",
        "derived, printed",
    ),
    "model of a name": (lambda: standard(model="lee"), "model = 'lee'", "a Model"),
    "ship for a standard law": (
        lambda: StandardObserver(3, 9.0, model=Ship()),
        "model = Ship(",
        "ReducedOrderObserver",
    ),
    "triangular model for a low-power law": (
        lambda: LowPowerObserver(2, 9.0, model=SanfelicePraly(1.9)),
        "sanfelice-praly",
        "use the standard observer",
    ),
    "another model for Fu's law": (
        lambda: SampledDataObserver(Lee()),
        "model = Lee()",
        "a VanDerPol",
    ),
    "another model for the ship's law": (
        lambda: ReducedOrderObserver(1.0, model=Lee()),
        "model = Lee()",
        "a Ship",
    ),
    # saturations and models
    "saturation below the model's bound": (
        lambda: PeakingFreeObserver(5, 9.0, saturation=0.4, model=Crackle()),
        "saturation r_2 = 0.4",
        ">= 1, the model's own bound of |x_2|",
    ),
    "saturation of the third below": (
        lambda: PeakingFreeObserver(5, 9.0, saturation=[1, 0.4, 1, 1], model=Crackle()),
        "saturation r_3 = 0.4",
        ">= 0.5",
    ),
    "saturation 0": (
        lambda: PeakingFreeObserver(3, 9.0, saturation=0.0),
        "saturation r_2 = 0.0",
        "> 0",
    ),
    "saturations of another order": (
        lambda: PeakingFreeObserver(3, 9.0, saturation=[1, 1, 1]),
        "saturation of shape (3,)",
        "2 entries",
    ),
    "phi_max below phi": (lambda: Crackle(0.1), "phi_max = 0.1", ">= 0.5"),
    "delta": (lambda: Ship(0.6), "delta = 0.6", "<= 0.5"),
    "w of two": (lambda: Ship(w=(1.0, 2.0)), "w = (1.0, 2.0)", "three"),
    "w a number": (lambda: Ship(w=1.0), "w = 1.0", "three"),
    "sigma < 0": (lambda: VanDerPol(sigma=-0.1), "sigma = -0.1", ">= 0"),
    "no equilibrium": (lambda: SanfelicePraly(0.0).equilibrium, "nu1 = 0.0", "different from 0"),
    # studies
    "plant of a name": (lambda: simulate("lee", standard(), x0=[1, 0]), "plant = 'lee'", "Model"),
    "no plant": (
        lambda: simulate(Unknown(), standard(), x0=[1, 0]),
        "plant = Unknown()",
        "a system with equations",
    ),
    "no observer": (lambda: simulate(Lee(), "hgo", x0=[1, 0]), "observer = 'hgo'", "an Observer"),
    "plant of other outputs": (
        lambda: simulate(Ship(), StandardObserver(3, 9.0), x0=[0, 6, 0, 1, 0, 0]),
        "kind of the observer = 'standard'",
        "'reduced-order' for the plant Ship(",
    ),
    "x0 of another order": (lambda: lee(x0=[1.0]), "shape of x0 = (1,)", "(2,) or (1, 2)"),
    "x0 NaN": (lambda: lee(x0=[1.0, NAN]), "x0 = [1.0, nan]", "finite"),
    "x0 of a text": (lambda: lee(x0="ab"), "x0 = 'ab'", "numbers"),
    "memory0 of two runs": (
        lambda: lee(memory0=np.zeros((2, 2))),
        "shape of memory0 = (2, 2)",
        "(2,) or (1, 2)",
    ),
    "dt and a schedule": (lambda: lee(schedule=FixedStep(0.01)), "dt", "either"),
    "schedule of a text": (lambda: lee(dt=None, schedule="fast"), "schedule = 'fast'", "FixedStep"),
    "steps 0": (lambda: lee(steps=0), "steps = 0", ">= 1"),
    "steps and t_end": (lambda: lee(t_end=1.0), "steps", "either"),
    "t_end < 0": (lambda: lee(steps=None, t_end=-1.0), "t_end = -1.0", "> 0"),
    "t_end for ever": (lambda: lee(steps=None, t_end=1e300), "t_end = 1e+300", "<= 1e+15 steps"),
    "t_end of a schedule": (
        lambda: lee(
            dt=None, steps=None, t_end=1.0, schedule=StochasticApproximation(1.0, 0.05, 9.0)
        ),
        "t_end = 1.0",
        "fixed steps",
    ),
    "runs 0": (lambda: lee(runs=0), "runs = 0", ">= 1"),
    "runs beyond all count": (lambda: lee(runs=10**400), "runs = 1000", "<= 1073741824"),
    "runs that no machine holds": (lambda: lee(runs=10**9), "runs = 1000000000", "fewer"),
    "frames that no machine holds": (
        lambda: lee(runs=1000, steps=10**9, every=1),
        "runs = 1000",
        "a larger every",
    ),
    "seed < 0": (lambda: lee(rng=-1), "rng = -1", ">= 0"),
    "seed of a text": (lambda: lee(rng="a"), "rng = 'a'", "integer"),
    "substeps 0": (lambda: lee(substeps=0), "substeps = 0", ">= 1"),
    "unknown mode": (lambda: lee(mode="both"), "mode = 'both'", "sampled, joint"),
    "joint by staggered Euler": (
        lambda: lee(standard(method="staggered-euler"), mode="joint"),
        "method = 'staggered-euler'",
        "mode 'sampled'",
    ),
    "joint recursion": (lambda: ship(mode="joint"), "method = 'a recursion'", "mode 'sampled'"),
    "unknown plant method": (lambda: lee(plant_method="heun"), "plant_method = 'heun'", "rk4"),
    "process noise where there is none": (
        lambda: lee(plant_method="milstein"),
        "plant_method",
        "process noise",
    ),
    "unknown backend": (lambda: lee(backend="julia"), "backend = 'julia'", "rust, numpy"),
    "window backwards": (lambda: lee(windows=[(0.1, 0.0)]), "windows = [0.1, 0.0]", "from < to"),
    "window after the end": (lambda: lee(windows=[(9.0, 10.0)]), "windows = [9.0, 10.0]", "within"),
    "window without an end": (lambda: lee(windows=[(0.0,)]), "windows = [(0.0,)]", "pairs"),
    "windows not in a list": (lambda: lee(windows=(0.0, 0.1)), "windows = (0.0, 0.1)", "list"),
    "histogram of NaN": (lambda: lee(histogram=(0, NAN)), "histogram = [0.0, nan]", "from < to"),
    "settle 0": (lambda: lee(settle=0.0), "settle = 0.0", "> 0"),
    "every < 0": (lambda: lee(every=-1), "every = -1", ">= 0"),
    "a ship that does not move": (lambda: ship(x0=[0, 6, 0, 0, 0, 0]), "x0: z_1 = 0", "not 0"),
    "quantile above 1": (lambda: lee(histogram=(0, 0.1)).quantile(1.5), "q = 1.5", "<= 1"),
    "quantile without histogram": (lambda: lee().quantile(0.5), "quantile", "histogram=(from, to)"),
    "plot without frames": (lambda: lee().plot(), "plot", "every="),
    "plot of a run too many": (lambda: lee(every=1).plot(run=1), "run = 1", "<= 0"),
    # noise
    "noise of a name": (lambda: lee(noise="white"), "noise = 'white'", "a Noise"),
    "std < 0": (lambda: lee(noise=NormalNoise(0.0, -1.0)), "std = -1.0", ">= 0"),
    "nu of 0.1": (lambda: lee(noise=StudentTNoise(0.1)), "nu = 0.1", ">= 0.5"),
    "probability of 2": (lambda: lee(noise=ImpulsiveNoise(1.0, 2.0)), "probability = 2", "<= 1"),
    "scale < 0": (lambda: lee(noise=LaplaceNoise(0.0, -1.0)), "scale = -1.0", ">= 0"),
    "noise that grows": (lambda: lee(noise=ColouredNoise([1.5])), "root of ar = 1.5", "< 1"),
    "no coefficients": (lambda: lee(noise=ColouredNoise([])), "ar = []", "1 to 16"),
    "high below low": (lambda: lee(noise=UniformNoise(1.0, 0.0)), "high = 0.0", ">= 1"),
    "hold of a step and a half": (
        lambda: lee(noise=UniformNoise(hold=0.015)),
        "hold = 0.015",
        "dt = 0.01 s",
    ),
    "hold for ever": (lambda: lee(noise=UniformNoise(hold=1e300)), "hold = 1e+300", "whole number"),
    "hold of a schedule": (
        lambda: lee(
            dt=None,
            schedule=StochasticApproximation(1.0, 0.05, 9.0),
            noise=UniformNoise(hold=0.1),
        ),
        "hold = 0.1",
        "fixed steps",
    ),
    "sines of two numbers": (lambda: lee(noise=Noise(sines=[(1, 2)])), "sines = [(1, 2)]", "three"),
    "sines not finite": (lambda: lee(noise=Noise(sines=[(1, INF, 0)])), "inf", "finite"),
    "noise too short": (
        lambda: lee(noise=RecordedNoise(values=[1.0, 2.0])),
        "shape of values = (2,)",
        "(21,)",
    ),
    "noise with gaps": (
        lambda: lee(noise=RecordedNoise(values=[NAN] * 21)),
        "values of shape (21,)",
        "finite",
    ),
    "band above Nyquist": (
        lambda: filtered_noise(9, 0.01, (1.0, 400.0)),
        "band = 400.0",
        "< 314.159",
    ),
    "band backwards": (lambda: filtered_noise(9, 0.01, (9.0, 1.0)), "band = (9.0, 1.0)", "low < h"),
    "band of nothing": (lambda: filtered_noise(9, 0.01, (None, None)), "band = (None", "at least"),
    # what the commands read and write
    "unknown scenario": (lambda: scenarios.find("lee-fig99"), "'lee-fig99'", "lee-fig"),
}


@pytest.mark.parametrize("name", CASES)
def test_one_clear_error(name):
    """One line that names the parameter and its value, then the range or the remedy."""
    call, subject, remedy = CASES[name]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(HgoError) as caught:
            call()
    message = str(caught.value)
    assert isinstance(caught.value, ValueError)
    assert "\n" not in message
    assert len(message) < 400
    assert message.index(subject) <= message.rindex(remedy)
    assert remedy in message.replace(subject, "", 1)


def test_what_cannot_be_read_or_written(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("t,q\n0.0,1.0\n0.1,2.0\n0.2,two\n0.3,4.0\n")
    blocked = tmp_path / "file"
    blocked.write_text("")
    for call, parts in (
        (lambda: read_log(log, "t", "q"), [str(log), "line 4", "'q'", "'two'"]),
        (lambda: read_log(log, "t", "speed"), [str(log), "'speed'", "t, q"]),
        (lambda: read_log(tmp_path / "lag.csv", "t", "q"), ["lag.csv", "log.csv"]),
        (lambda: write_table(blocked / "out.csv", {"t": np.zeros(2)}), [str(blocked), "write"]),
        (lambda: OutputFolder(blocked / "out"), [str(blocked)]),
    ):
        with pytest.raises(HgoError) as caught:
            call()
        message = str(caught.value)
        assert "\n" not in message
        for part in parts:
            assert part in message


def test_refusals_of_a_design_are_design_errors():
    for call in (lambda: step(dt=0.1), lambda: LowPowerObserver(2, 9.0, alpha=[1, -1], beta=[1])):
        with pytest.raises(DesignError):
            call()


def test_a_refusal_changes_nothing():
    """After each refused sample the observer goes on as if it had not been offered."""
    observer, other = standard(), standard()
    observer.step(1.0, dt=0.01)
    other.step(1.0, dt=0.01)
    for y, u, dt in (
        (INF, None, 0.01),
        ("a", None, 0.01),
        ([1.0, 2.0], None, 0.01),
        (1.0, 1.0, 0.01),
        (1.0, None, 0.0),
        (1.0, None, 0.5),
        (1.7e308, None, 0.01),
    ):
        with pytest.raises(HgoError):
            observer.step(y, u, dt=dt)
    np.testing.assert_array_equal(observer.step(2.0, dt=0.02), other.step(2.0, dt=0.02))


def test_unstable_steps_may_be_studied():
    """allow_unstable, in the call or the constructor, lets the same step through."""
    y = np.ones(10)
    grown = standard().run(0.2, y, allow_unstable=True).x_hat
    np.testing.assert_array_equal(standard(allow_unstable=True).run(0.2, y).x_hat, grown)
    free = standard(allow_unstable=True)
    steps = [free.step(1.0, dt=0.2) for _ in range(9)]
    np.testing.assert_allclose(steps, grown[1:], rtol=1e-9)
    assert abs(grown[-1, 0]) > abs(grown[1, 0]) > 1.0
    with pytest.raises(DesignError):
        standard(allow_unstable=True).run(0.2, y, allow_unstable=False)
    assert lee(dt=0.2, allow_unstable=True).final_memory.shape == (1, 2)


# --- whatever is thrown in ----------------------------------------------------------------------

EXTREMES = [0.0, -0.0, 1.0, -1.0, 0.01, 5e-324, -5e-324, 1e-300, 1e150, 1e300, -1e300, 1.7e308]
WEIRD = [NAN, INF, -INF, None, "", "1.0", "abc", b"1", 1j, True, 10**400, -(10**400), [], [[]], {}]
WEIRD += [object(), (), np.array(3.0), np.array([]), np.array(["a"]), slice(None), Lee(), range(3)]
anything = st.one_of(
    st.sampled_from(EXTREMES + WEIRD),
    st.floats(),
    st.integers(-3, 15),
    st.lists(st.one_of(st.floats(), st.none(), st.integers()), max_size=5),
)
numbers = st.one_of(st.sampled_from(EXTREMES), st.floats(-1e3, 1e3), st.floats())
quick = settings(
    max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True
)


def outcome(call):
    """The result of a call, or None where it was refused; anything else fails."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return call()
        except HgoError as error:
            message = str(error)
            assert message
            assert "\n" not in message
            return None


# Good arguments of each class, and all that may be given.
CONSTRUCTORS = {
    StandardObserver: ({"n": 2, "gain": 10.0}, "epsilon poles k model method"),
    LowPowerObserver: ({"n": 3, "gain": 10.0}, "epsilon poles alpha beta model method"),
    PeakingFreeObserver: (
        {"n": 3, "gain": 10.0, "saturation": 2.0},
        "clip epsilon poles alpha beta model method",
    ),
    RepelledCollection: ({"gain": ADAPTIVE, **K}, "copies model method"),
    ModifiedObserver: ({"gain": ADAPTIVE, **K}, "copies model method"),
    SampledDataObserver: ({}, "model gain"),
    ReducedOrderObserver: ({"epsilon": 1.0}, "h_bar model"),
    AdaptiveGain: ({"p1": 1.0, "p2": 0.1, "b": 0.1}, ""),
    ConstantGain: ({"ell": 1.0}, ""),
    HomogeneousGain: ({"rho": 1.0}, "degree mu"),
    SwitchedGain: ({"fast": 9.0, "slow": 1.0, "zone": 0.1}, "delay"),
    PrescribedTimeGain: ({"mu0": 4.0, "deadline": 1.0, "r_max": 9.0}, ""),
    Stubborn: ({"decay": 1.0, "growth": 2.0}, "sigma0"),
    DeadZone: ({"decay": 2.0, "growth": 1.0}, "sigma0"),
    PiecewiseLinear: ({"ratio": 0.5, "zone": 0.1}, ""),
    Fal: ({"alpha": (1.0, 0.5), "delta": 0.1}, ""),
    BiHomogeneous: ({"near": -1.0, "far": 0.1, "kappa": (1.0,), "theta": (1.0,)}, ""),
    FixedStep: ({"dt": 0.1}, ""),
    StochasticApproximation: ({"alpha": 1.0, "epsilon": 0.1, "k0": 10.0}, "p"),
    InputGain: ({"b0": 1.0}, ""),
    SanfelicePraly: ({"nu1": 1.0}, "nu2"),
    VanDerPol: ({}, "epsilon sigma"),
    Crackle: ({}, "phi_max"),
    Ship: ({}, "delta w"),
}


@pytest.mark.parametrize("kind", CONSTRUCTORS, ids=lambda kind: kind.__name__)
@given(data=st.data())
@quick
def test_constructors_take_it_or_refuse_it(kind, data):
    """A good set of arguments with one or two replaced by anything."""
    good, others = CONSTRUCTORS[kind]
    names = st.sampled_from([*good, *others.split()])
    spoilt = data.draw(st.dictionaries(names, anything, min_size=1, max_size=2))
    made = outcome(lambda: kind(**{**good, **spoilt}))
    if made is not None:
        assert isinstance(made.spec, dict)
        if isinstance(made, hgo_rs.Observer):
            assert np.isfinite(made.memory).all()


OBSERVERS = {
    "standard": (lambda: StandardObserver(2, 10.0), 1),
    "levant": (lambda: StandardObserver(3, HomogeneousGain(1.0)), 1),
    "switched": (lambda: StandardObserver(2, SwitchedGain(9.0, 1.0, 0.1, 0.1)), 1),
    "deadline": (lambda: StandardObserver(2, PrescribedTimeGain(4.0, 1.0, 9.0)), 1),
    "stubborn": (lambda: StandardObserver(2, 5.0, shape=Stubborn(1.0, 2.0)), 1),
    "fal": (lambda: StandardObserver(2, 5.0, shape=Fal((1.0, 0.5), 0.1)), 1),
    "order 12": (lambda: StandardObserver(12, 10.0, method="rk4"), 1),
    "lee": (lambda: StandardObserver(2, 10.0, model=Lee(), method="rk4-innovation-held"), 1),
    "adaptive": (lambda: StandardObserver(2, ADAPTIVE, method="rk4"), 1),
    "dead-zone": (lambda: StandardObserver(3, DeadZoneGain(1.0, 0.1, 0.2)), 1),
    "low-power": (lambda: LowPowerObserver(3, 10.0, method="staggered-euler"), 1),
    "crackle": (lambda: PeakingFreeObserver(5, 10.0, saturation=3.0, model=Crackle()), 1),
    "sampled-data": (SampledDataObserver, 1),
    "reduced-order": (lambda: ReducedOrderObserver(1.0), 3),
    "window": (lambda: WindowObserver.savitzky_golay(5, 2, 0.01), 1),
}
samples = st.lists(st.one_of(numbers, st.none()), min_size=1, max_size=12)
times = st.one_of(
    numbers,
    st.just(0.01),
    st.lists(st.floats(1e-4, 0.02), min_size=12, max_size=12).map(np.cumsum),
    anything,
)


@pytest.mark.parametrize("name", OBSERVERS)
@given(t=times, y=samples, start=st.one_of(st.none(), st.lists(numbers, max_size=13)), odd=anything)
@quick
def test_a_run_is_finite_or_refused(name, t, y, start, odd):
    """Random samples of any size, among them missing ones, times and starts."""
    make, outputs = OBSERVERS[name]
    observer = make()
    if outputs == 3:
        y = [None if v is None else [v, 0.1 * k, v] for k, v in enumerate(y)]
    u = np.ones((len(y), 2)) if outputs == 3 else None
    if isinstance(t, np.ndarray) and t.ndim == 1:
        t = t[: len(y)]
    x_hat0 = None if start is None else start[: observer.n]
    for call in (
        lambda: observer.run(t, y, u, x_hat0=x_hat0),
        lambda: observer.run(0.01, y, u),
        lambda: observer.run(0.01, odd, u),
        lambda: observer.run(odd, y, u),
        lambda: observer.run(0.01, y, odd),
        lambda: observer.run(0.01, y, u, x_hat0=odd),
        lambda: observer.run(0.01, y, u, r0=odd),
        lambda: observer.run(0.01, y, u, memory0=odd),
    ):
        result = outcome(call)
        if result is not None:
            assert np.isfinite(result.memory).all()
            assert result.x_hat.shape == (len(result.time), observer.n)
            gone = np.isnan(result.y).any(axis=1)
            np.testing.assert_array_equal(result.missing, gone)


@pytest.mark.parametrize("name", OBSERVERS)
@given(data=st.data())
@quick
def test_online_the_memory_stays_finite(name, data):
    make, outputs = OBSERVERS[name]
    observer = make()
    for _ in range(6):
        y = data.draw(st.one_of(numbers, anything))
        if outputs == 3 and data.draw(st.booleans()):
            y = [y, 0.0, 1.0]
        u = data.draw(st.one_of(st.just([1.0, 0.0]), anything)) if outputs == 3 else None
        dt = data.draw(st.one_of(st.just(0.01), numbers, anything))
        x_hat = outcome(lambda y=y, u=u, dt=dt: observer.step(y, u, dt=dt))
        assert np.isfinite(observer.memory).all()
        assert x_hat is None or np.array_equal(x_hat, observer.x_hat)


STUDY = {
    "x0": [1.0, 0.0],
    "dt": 0.01,
    "schedule": None,
    "plant_schedule": None,
    "t_end": None,
    "steps": 20,
    "memory0": None,
    "mode": "sampled",
    "plant_method": "rk4",
    "substeps": 1,
    "noise": None,
    "runs": 1,
    "rng": 0,
    "windows": (),
    "settle": None,
    "histogram": None,
    "every": 1,
    "backend": "rust",
}


@given(data=st.data())
@settings(quick, max_examples=400)
def test_a_study_takes_it_or_refuses_it(data):
    """What may be large without being wrong, the number of steps, is left alone."""
    names = st.sampled_from(sorted(STUDY.keys() - {"steps", "t_end", "substeps"}))
    spoilt = data.draw(st.dictionaries(names, anything, min_size=1, max_size=2))
    result = outcome(lambda: simulate(Lee(), standard(), **{**STUDY, **spoilt}))
    if result is not None and result.x_hat is not None:
        for frames, stopped in zip(result.x_hat, result.diverged_at, strict=True):
            kept = frames if stopped < 0 else frames[: -(-stopped // result.spec["every"])]
            assert np.isfinite(kept).all()
