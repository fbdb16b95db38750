"""Families of high-gain observers beyond the papers, against numbers of independent programs.

A record y_k = sin t_k, with a step or an outlier, of an observer by Euler with predictor timing:
the memory before sample k. The numbers were computed twice, by programs that share nothing with
this package.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hgo_rs.design import (
    continuous,
    delay_limit,
    discrete,
    levant_coefficients,
    noise_gain,
)
from hgo_rs.design.discrete import fixed_timing
from hgo_rs.models import Model, Plant, VanDerPol
from hgo_rs.observers import (
    Fal,
    HighGainEKF,
    HighGainObserver,
    HomogeneousGain,
    InnovationGain,
    LowPowerObserver,
    MultiOutputObserver,
    Observer,
    PiecewiseLinear,
    PrescribedTimeGain,
    StandardObserver,
    Stubborn,
    SwitchedGain,
    WindowObserver,
)
from hgo_rs.plots.style import COLOURS
from hgo_rs.scenarios.base import Context, Outcome, Row, row, scenario
from hgo_rs.simulation import RecordedNoise

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
DT = 1e-3
REL = 1e-9
EULER: Mapping[str, Any] = {"method": "euler", "timing": "predictor"}
PRASOV = "Prasov, Khalil, IEEE TAC 58 (2013) 569"
STUBBORN = "Alessandri, Zaccarian, Automatica 88 (2018); with Astolfi, IEEE TAC 66 (2021) 667"
FILTERING = "Levant, Livne, European J. Control 55 (2020)"
INTER_SAMPLE = "Karafyllis, Kravaris, IEEE TAC 54 (2009) 2169"
NADRI = "Nadri, Hammouri, Grajales, IEEE TAC 58 (2013) 757"
LEVANT = "Levant, IJC 76 (2003) 924; Koch et al., IEEE TAC 65 (2020) 757"
AHRENS = "Ahrens, Khalil, Automatica 45 (2009) 936"
HOLLOWAY = "Holloway, Krstic, IEEE TAC 64 (2019) 3905"
BOIZOT = "Boizot, Busvelle, Gauthier, Automatica 46 (2010) 1483"
FARZA = "Farza, M'Saad, Rossignol, Automatica 40 (2004) 135"
SAVITZKY = "Savitzky, Golay, Analytical Chemistry 36 (1964) 1627"
KALATA = "Kalata, IEEE TAES 20 (1984) 174"
MORRISON = "Morrison, Sequential Smoothing and Prediction (1969)"
HAN = "Han, IEEE TIE 56 (2009) 900"
FILTERED = "Tréangle, Farza, M'Saad, Automatica 101 (2019); Astolfi et al., SCL 148 (2021) 104856"
LIMITED = "Astolfi, Marconi, IEEE TAC 60 (2015) 3059; Wang et al., Automatica 75 (2017) 16"
CASCADE = "Khalil, Automatica 80 (2017) 110"
REDUCED = "Esfandiari, Khalil, IJC 56 (1992) 1007"


def record(
    ctx: Context,
    observer: Observer,
    x_hat0: Any,
    added: Array,
    dt: float = DT,
    output: str = "sin(t)",
) -> Array:
    """Memories at each sample of `output` + `added`, (len(added), m): before it is used; with
    current timing after that.
    """
    plant = Plant(states=["s"], drift=["0"], output=output)
    start = np.array(observer.initial_memory(x_hat0))
    if observer.spec.get("method") == "implicit":  # the first sample ends a whole step
        start[-1] = dt
    run = ctx.run(
        plant,
        observer,
        x0=[0.0],
        memory0=start,
        dt=dt,
        steps=len(added) - 1,
        noise=RecordedNoise(values=added),
        every=1,
        errors=False,
    )
    assert run.memory is not None
    return np.asarray(run.memory[0])


def rows_of(
    memory: Array,
    numbers: Mapping[int, tuple[float, ...]],
    what: str,
    source: str,
    rel: float = REL,
) -> list[Row]:
    """Rows for entries of memories; the source once."""
    rows: list[Row] = []
    for k, values in numbers.items():
        for i, value in enumerate(values):
            note = "" if rows else source
            found = row(
                f"{what}, x̂{i + 1} before {k}", memory[k, i], expected=value, rel=rel, note=note
            )
            rows.append(found)
    return rows


def step_at(k: int, height: float, samples: int) -> Array:
    """A step of the output."""
    return np.asarray(height * (np.arange(samples) >= k))


@scenario("families-shapes", title="Shapes of the injection", paper="families")
def shapes(ctx: Context) -> Outcome:
    """Two gains in one law, a threshold against an outlier, and the gains of ADRC."""
    zone = StandardObserver(
        2, 100.0, k=(2.0, 1.0), shape=PiecewiseLinear(ratio=0.2, zone=0.02), **EULER
    )
    two = record(ctx, zone, (1.0, 0.0), step_at(1000, 0.5, 2001))
    numbers: dict[int, tuple[float, ...]] = {
        50: (0.006184220464, -2.651456251371),
        200: (0.192839079278, 0.835897873439),
        1050: (1.399295498571, 2.702757493190),
        2000: (1.411656524858, -0.323047522846),
    }
    rows = rows_of(two, numbers, "piecewise-linear", PRASOV)

    outlier = np.zeros(3001)
    outlier[1500] = 10.0
    shape = Stubborn(decay=5.0, growth=20.0, sigma0=0.01)
    bare = StandardObserver(2, 30.0, k=(2.0, 1.0), **EULER)
    worn = StandardObserver(2, 30.0, k=(2.0, 1.0), shape=shape, **EULER)
    standard, stubborn = (record(ctx, law, (0.0, 1.0), outlier) for law in (bare, worn))
    numbers = {1600: (1.000676197964, 0.036507776583), 3000: (0.141348379218, -0.977446902526)}
    rows += rows_of(stubborn, numbers, "stubborn", STUBBORN)
    t = DT * np.arange(3001)
    x = np.column_stack([np.sin(t), np.cos(t)])
    for name, memory, worst in (
        ("stubborn", stubborn, (1.352674e-3, 6.942940e-2)),
        ("standard", standard, (0.601099750, 9.065635540)),
    ):
        largest = np.abs(memory[1501:, :2] - x[1501:]).max(axis=0)
        for i, value in enumerate(worst):
            what = f"{name}, largest |x̂{i + 1} − x{i + 1}| after the outlier"
            rows.append(row(what, largest[i], expected=value, rel=1e-6))
    same = np.array_equal(stubborn[:1501, :2], standard[:1501])
    rows.append(row("stubborn and standard before it, bit for bit", same, expected=True))

    nothing = np.zeros(2001)
    for alpha, beta, values in (
        ((1.0, 0.5, 0.25), (100, 300, 1000), (0.909287018284, -0.417672082303, -0.943077165982)),
        ((1.0, 1.0, 1.0), (60, 1200, 8000), (0.909262910231, -0.418792057642, -0.957444791873)),
    ):
        law = StandardObserver(3, 1.0, k=beta, shape=Fal(alpha, 0.01), **EULER)
        what = "fal" if alpha[1] < 1.0 else "fal with α = 1 (LESO)"
        rows += rows_of(record(ctx, law, None, nothing), {2000: values}, what, HAN)

    def draw(fig: Figure) -> None:
        fig.set_size_inches(10.0, 4.0)
        left, right = fig.subplots(1, 2)
        at = slice(1450, 1800)
        for memory, name, colour in (
            (standard, "standard", "vermillion"),
            (stubborn, "stubborn", "blue"),
        ):
            left.plot(t[at], memory[at, 1], color=COLOURS[colour], label=name)
        left.plot(t[at], x[at, 1], color=COLOURS["black"], linestyle="--", label=r"$\cos t$")
        left.set_title(r"$\hat x_2$ around an outlier of 10 in $y$")
        left.set_xlabel("time (s)")
        left.legend()
        fast, slow = (
            record(
                ctx,
                StandardObserver(2, ell, k=(2.0, 1.0), **EULER),
                (1.0, 0.0),
                step_at(1000, 0.5, 2001),
            )
            for ell in (100.0, 20.0)
        )
        at = slice(980, 1300)
        for memory, name, colour in (
            (fast, r"$\ell = 100$", "vermillion"),
            (slow, r"$\ell = 20$", "grey"),
            (two, "both, zone 0.02", "blue"),
        ):
            right.plot(t[at], memory[at, 0], color=COLOURS[colour], label=name)
        right.set_title(r"$\hat x_1$ after a step of $y$")
        right.set_xlabel("time (s)")
        right.legend()

    return Outcome(rows, draw)


SAMPLED = {
    ("euler", 2): (0.755391520, 0.5566),
    ("euler", 3): (0.728383164, 0.611851808, 0.5808),
    ("zoh", 2): (0.752834235, 0.542737425),
    ("zoh", 3): (0.728126468, 0.604172064, 0.569180023),
    ("bilinear", 2): (0.752821387, 0.542741968),
    ("bilinear", 3): (0.728117769, 0.604149128, 0.569175252),
    ("proper", 2): (0.755391520, 0.5566),
    ("proper", 3): (0.728883454, 0.611970967, 0.5808),
    ("implicit-map", 2): (0.750157561, 0.529099460),
    ("implicit-map", 3): (0.727804772, 0.599268928, 0.557755150),
    ("implicit", 2): (0.763870726, 0.5687),
    ("implicit", 3): (0.737931243, 0.626036706, 0.5929),
}
"""Levant's differentiator of sin, L = 1.1, T = 10 ms: x_hat before sample 100 ("implicit": after
it, a period before sample 0).
"""
WORST: Mapping[str, Mapping[float, tuple[float | None, float, float | None]]] = {
    "proper": {
        0.02: (7.21e-5, 2.88e-3, 0.0910),
        0.01: (8.49e-6, 6.70e-4, 0.0430),
        0.005: (1.08e-6, 1.70e-4, 0.0215),
    },
    "euler": {0.02: (None, 1.14e-2, None), 0.01: (None, 5.32e-3, None)},
    "zoh": {0.02: (None, 1.32e-2, None), 0.01: (None, 4.14e-3, None)},
}
"""Its largest errors for t in 15 ... 20 s, n = 3, to 10 %."""


@scenario("families-gains", title="Gains of the innovation and of a clock", paper="families")
def gains(ctx: Context) -> Outcome:
    """Levant's differentiator, a gain that switches, a gain with a deadline."""
    rows: list[Row] = []
    nothing = np.zeros(2001)
    for (method, n), numbers in SAMPLED.items():
        law = StandardObserver(
            n,
            HomogeneousGain.levant(1.1, n),
            k=levant_coefficients(n),
            method=method,
            timing=fixed_timing(method) or "predictor",
        )
        start = (0.5, *[0.0] * (n - 1))
        memory = record(ctx, law, start, nothing[:101], 0.01)
        source = "" if rows else LEVANT
        rows += rows_of(memory, {100: numbers}, f"Levant, n = {n}, {method}", source, 1e-6)
    for method, errors in WORST.items():
        for dt, worst in errors.items():
            law = StandardObserver(
                3,
                HomogeneousGain.levant(1.1, 3),
                k=levant_coefficients(3),
                method=method,
                timing="predictor",
            )
            t = dt * np.arange(round(20.0 / dt) + 1)
            x = np.column_stack([np.sin(t), np.cos(t), -np.sin(t)])
            memory = record(ctx, law, (0.0, 1.0, 0.0), np.zeros(len(t)), dt)
            largest = np.abs(memory - x)[t >= 15.0].max(axis=0)
            for i, value in enumerate(worst):
                if value is not None:
                    what = f"Levant, {method}, T = {1e3 * dt:g} ms, largest |x̂{i + 1} − x{i + 1}|"
                    rows.append(row(what, largest[i], expected=value, rel=0.1))
    uniform = StandardObserver(
        2,
        HomogeneousGain(2.0, mu=1.0),
        k=(2.0, 1.0),
        method="implicit-map",
        timing="predictor",
    )
    memory = record(ctx, uniform, (0.5, 0.0), nothing[:101], 0.01)
    rows += rows_of(memory, {100: (0.841743644, 0.566299349)}, "uniform", "", 1e-6)
    k = levant_coefficients(3)
    filtering = HighGainObserver(
        "filtered",
        2,
        HomogeneousGain.levant(1.1, 3),
        filters=1,
        c=k[:1],
        k=np.asarray(k[1:]) / k[0],
        timing="predictor",
    )
    memory = record(ctx, filtering, (0.5, 0.0), nothing[:101], 0.01)
    rows += rows_of(memory, {100: (0.548561814, 0.2541)}, "filtering", FILTERING, 1e-6)
    for rho, degree, method, numbers in (
        (5.0, -0.5, "euler", (0.841471005, 0.536088959, -0.845310822)),
        (5.0, -0.5, "zoh", (0.841472176, 0.540490238, -0.825633780)),
        (20.0, 0.0, "zoh", (0.841581653, 0.545698529, -0.744846412)),
    ):
        law = StandardObserver(
            3,
            HomogeneousGain(rho, degree),
            k=(3.0, 3.0, 1.0),
            method=method,
            timing="predictor",
        )
        memory = record(ctx, law, (0.5, 0.0, 0.0), nothing[:101], 0.01)
        rows += rows_of(memory, {100: numbers}, f"degree {degree:g}, {method}", "", 1e-6)

    switching = SwitchedGain(fast=100.0, slow=20.0, zone=0.02, delay=0.0205)
    law = StandardObserver(2, switching, k=(2.0, 1.0), **EULER)
    switched = record(ctx, law, (1.0, 0.0), step_at(1000, 0.5, 2001))
    table: dict[int, tuple[float, ...]] = {
        50: (0.026217674034, -1.897545381086),
        200: (0.195848021531, 0.908944718362),
        1050: (1.379222261167, 1.942718543554),
        2000: (1.411656523948, -0.323047541899),
    }
    rows += rows_of(switched, table, "switched", AHRENS)

    timed = PrescribedTimeGain(mu0=4.0, deadline=1.0, r_max=200.0)
    law = StandardObserver(2, timed, k=(9 / 4, 15 / 16), **EULER)
    deadline = record(ctx, law, (1.0, 0.0), nothing[:1501])
    table = {
        500: (0.405794697576, -0.001367719246),
        900: (0.783979373855, 0.672806835810),
        1500: (0.997521563065, 0.082200015208),
    }
    rows += rows_of(deadline, table, "prescribed time", HOLLOWAY)

    def draw(fig: Figure) -> None:
        fig.set_size_inches(10.0, 4.0)
        left, right = fig.subplots(1, 2)
        t = DT * np.arange(2001)
        left.plot(t, switched[:, 1], color=COLOURS["blue"], label=r"$\hat x_2$")
        left.plot(t, np.cos(t), color=COLOURS["black"], linestyle="--", label=r"$\cos t$")
        left.set_title("Switched gain: a wrong start, a step of 0.5 at 1 s")
        right.plot(t[:1501], deadline[:, 0], color=COLOURS["blue"], label=r"$\hat x_1$")
        right.plot(
            t[:1501], np.sin(t[:1501]), color=COLOURS["black"], linestyle="--", label="sin t"
        )
        right.axvline(1.0, color=COLOURS["grey"], linestyle=":", label="deadline")
        right.set_title("A deadline of 1 s")
        for ax in (left, right):
            ax.set_xlabel("time (s)")
            ax.legend()

    return Outcome(rows, draw)


@scenario("families-chains", title="Nonlinear chains and coupled blocks", paper="families")
def chains(ctx: Context) -> Outcome:
    """Rows over products of slopes, and two outputs that act on each other, in continuous time."""
    model = Model(states=["x1", "x2"], f=["x2**3", "-x1 - x2"])
    rk4: Mapping[str, Any] = {"method": "rk4", "timing": "predictor"}
    law: Observer = StandardObserver(2, 20.0, k=(2.0, 1.0), model=model, **rk4)
    given: Mapping[str, Any] = {"dt": DT / 4, "plant_method": "rk4", "every": 4, "errors": False}
    run = ctx.run(model.plant(), law, x0=[1.0, 0.5], steps=4001, mode="joint", **given)
    assert run.memory is not None and run.x is not None
    x, x_hat = run.x[0], run.memory[0]
    rows: list[Row] = []
    for k, reached, estimates in (
        (200, (1.081717319, 0.219261880), (1.107924745, 0.578783437)),
        (1000, (0.913123874, -0.473380779), (0.913123868, -0.473380866)),
    ):
        for i in range(2):
            note = "" if rows else FARZA
            what = f"nonlinear chain, {k * DT:g} s"
            rows.append(row(f"{what}, x{i + 1}", x[k, i], expected=reached[i], rel=1e-7, note=note))
            rows.append(row(f"{what}, x̂{i + 1}", x_hat[k, i], expected=estimates[i], rel=1e-7))

    names = ["x1", "x2", "z"]
    both = Model(states=names, orders=[2, 1], phi=["-x1 + z*x2", "-z + x2"])
    plant = Plant(states=names, drift=["x2", "-x1 + z*x2", "-z + x2"], output=["x1", "z"])
    parts = [StandardObserver(n, 15.0, k=k, **rk4) for n, k in ((2, (2.0, 1.0)), (1, (1.0,)))]
    law = MultiOutputObserver(parts, model=both)
    ends = []
    for dt in (4e-4, 2e-4, 1e-4):
        run = ctx.run(
            plant, law, x0=[1.0, 0.0, 0.5], steps=round(0.5 / dt), dt=dt, plant_method="rk4"
        )
        ends.append(run.final_memory[0, :3])
    once = [2.0 * fine - coarse for coarse, fine in pairwise(ends)]
    limit = (4.0 * once[1] - once[0]) / 3.0  # Richardson
    numbers = (0.869990323, -0.517841347, 0.192419211), (0.874774252, -0.432450013, 0.208793842)
    for name, values, expected in (("", run.final_x[0], numbers[0]), ("̂", limit, numbers[1])):
        for i, value in enumerate(expected):
            what = f"coupled blocks, 0.5 s, {names[i][0]}{name}{names[i][1:]}"
            rows.append(row(what, values[i], expected=value, rel=1e-7))

    def draw(fig: Figure) -> None:
        fig.set_size_inches(7.0, 4.0)
        ax = fig.subplots()
        t = DT * np.arange(len(x))
        ax.plot(t, x_hat[:, 1], color=COLOURS["blue"], label=r"$\hat x_2$")
        ax.plot(t, x[:, 1], color=COLOURS["black"], linestyle="--", label="$x_2$")
        ax.set_title(r"$\dot x_1 = x_2 + x_2^3$: rows over the product of slopes")
        ax.set_xlabel("time (s)")
        ax.legend()

    return Outcome(rows, draw)


# --- structures ---------------------------------------------------------------------------------


def listed(kind: str, n: int, **given: Any) -> HighGainObserver:
    """A law of the list at ell = 50, by Euler with predictor timing."""
    return HighGainObserver(kind, n, 50.0, **{**EULER, **given})


def deviations(observer: Observer, density: float) -> Array:
    """Standard deviations of all states in continuous time, under noise of this density."""
    from scipy.linalg import solve_continuous_lyapunov

    law = continuous(observer.spec)
    scale = law.scale[:, None]
    closed, g = law.ell * scale * law.closed / law.scale, law.ell * law.scale * law.g
    return np.asarray(
        np.sqrt(density * np.diag(solve_continuous_lyapunov(closed, -np.outer(g, g))))
    )


def passed(observer: Observer, omega: float) -> Array:
    """|x_hat_i / y| at `omega` [rad/s], in continuous time."""
    law = continuous(observer.spec)
    away = 1j * omega / law.ell * np.eye(len(law.g)) - law.closed
    return np.asarray(np.abs(np.linalg.solve(away, law.g) * law.scale)[: observer.n])


def values_of(
    values: Any,
    expected: tuple[float, ...],
    names: Any,
    what: str,
    source: str = "",
    rel: float = REL,
) -> list[Row]:
    """A row for each value; the source at the first."""
    rows: list[Row] = []
    for value, number, name in zip(values, expected, names, strict=True):
        note = "" if rows else source
        rows.append(row(f"{what}, {name}", value, expected=number, rel=rel, note=note))
    return rows


X = ("x̂1", "x̂2", "x̂3", "x̂4")


@scenario(
    "families-structures", title="Filtered, limited in gain, cascaded, reduced", paper="families"
)
def structures(ctx: Context) -> Outcome:
    """Observers of other structures: what they estimate, and what they make of noise."""
    nothing = np.zeros(5000)
    filtered = listed("filtered", 2, poles=[-1.0] * 3)
    standard = StandardObserver(2, 50.0, poles=[-1.0] * 2, **EULER)
    rows = values_of(
        deviations(filtered, 1e-9)[:2],
        (1.936491673e-4, 2.795084972e-3),
        X[:2],
        "filtered, noise",
        FILTERED,
    )
    numbers: tuple[float, ...] = (2.5e-4, 5.590169944e-3)
    rows += values_of(deviations(standard, 1e-9), numbers, X[:2], "standard, noise")
    numbers = (1.873308602e-3, 3.122072600e-2)
    rows += values_of(passed(filtered, 2000.0), numbers, X[:2], "filtered at 2000 rad/s")
    numbers = (4.997267318e-2, 1.249219238)
    rows += values_of(passed(standard, 2000.0), numbers, X[:2], "standard at 2000 rad/s")
    sine = record(ctx, filtered, None, nothing[:1501], output="sin(3*t)")
    numbers = (-0.987552652672, -1.136641272811)
    rows += rows_of(sine, {1500: numbers}, "filtered", "")
    ramp = record(ctx, filtered, None, nothing[:4001], output="t")
    left = 4.0 - ramp[4000, 0]
    rows.append(row("filtered, error of a ramp", left, expected=0.0, abs=1e-9))

    alpha, beta = (3.0, 3.0, 3.0), (40.0 / 11.0, 12.0 / 11.0, 4.0 / 11.0)
    limited = listed("limited-gain", 4, alpha=alpha, beta=beta)
    found = np.poly(continuous(limited.spec).closed)[1:]
    numbers = (9, 30.636363636, 48.818181818, 36.694214876, 11.900826446, 1.442524418)
    powers = [f"coefficient of s^{6 - i}" for i in range(1, 7)]
    rows += values_of(found, numbers, powers, "limited gain power", LIMITED)
    names: tuple[str, ...] = ("p1", "p2", "p3", "q3", "q1", "q2")
    numbers = (3.273374883e-4, 1.229431330e-2, 1.818312218e-1, 1.095436945)
    numbers += (1.682912642e-2, 2.148988910e-1)
    rows += values_of(deviations(limited, 1e-9), numbers, names, "limited gain power, noise")
    whole = LowPowerObserver(4, 50.0, alpha=(*alpha, 2.0), beta=beta, **EULER)
    numbers = (0.854822664,)
    rows += values_of(deviations(whole, 1e-9)[3:4], numbers, X[3:], "low-power, noise")
    memory = record(ctx, limited, None, nothing[:1501], output="sin(2*t)")[1500]
    numbers = (0.141113291100, -1.981663467943, -0.621132327908, 7.045082736871)
    numbers += (-1.981244925786, -0.613315605590)
    rows += values_of(memory, numbers, names, "limited gain power before 1500")

    double = {"k": (2.0, 1.0), "beta": (1.0, 1.0)}
    free, held = listed("cascade", 4, **double), listed("cascade", 4, **double, saturation=3.0)
    usual = StandardObserver(4, 50.0, poles=[-1.0] * 4, **EULER)
    numbers = (1.123093108e-4, 2.518867875e-3, 1.096182698e-1, 5.028509135)
    std = np.sqrt(1e-6 * free.noise_gain(2e-4))
    rows += values_of(std, numbers, X, "cascade, noise", CASCADE)
    numbers = (1.719804280e-4, 1.219196668e-2, 4.042624877e-1, 5.028509135)
    std = np.sqrt(1e-6 * usual.noise_gain(2e-4))
    rows += values_of(std, numbers, X, "standard, noise")
    cubic = "1 + t + t**2/2 + t**3/6"
    tracks = [record(ctx, law, None, nothing, 2e-4, cubic) for law in (free, held, usual)]
    largest = [np.abs(track[:, :4]).max(axis=0) for track in tracks]
    numbers = (2.665382706665, 18.754786763816, 587.078325886596, 21464.8652148)
    rows += values_of(largest[0], numbers, X, "cascade, peak")
    numbers = (2.665382706665, 3.0, 3.0, 3.0)
    rows += values_of(largest[1], numbers, X, "cascade of levels 3, peak")
    numbers = (2.665382706665, 2.421000006667, 1.94, 1.0)
    for track, what in zip(tracks, ("cascade", "cascade of levels 3"), strict=False):
        rows += rows_of(track, {4999: numbers}, what, "")
    rows_sine = [record(ctx, law, None, nothing[:1001], output="sin(2*t)") for law in (free, usual)]
    apart = np.max(np.abs(rows_sine[0][:, 3] - rows_sine[1][:, 3]))
    rows.append(row("cascade and standard, x̂4 apart", apart, at_most=1e-9))

    reduced = listed("reduced-chain", 3, k=(2.0, 1.0), timing="current")
    memory = record(ctx, reduced, None, nothing[:1001], output="sin(2*t)")[1000]
    numbers = (-0.835214049507, -3.750081470973)
    rows += values_of(memory[1:3], numbers, X[1:3], "reduced order at 1000", REDUCED)
    # in continuous time, from short steps
    responses = []
    for dt in (1e-4, 5e-5):
        a, b, c, d = discrete({**reduced.spec, "method": "rk4"}, dt)
        z = np.exp(7j * dt)
        responses.append((c @ np.linalg.solve(z * np.eye(3) - a, b) + d)[1:, 0])
    found = (2.0 * responses[1] - responses[0]).view(float)
    numbers = (0.036953237148, 7.129389120358, -46.210400127682, 13.197584695788)
    names = ("Re x̂2/y", "Im x̂2/y", "Re x̂3/y", "Im x̂3/y")
    rows += values_of(found, numbers, names, "reduced order at 7 rad/s", rel=1e-5)

    def draw(fig: Figure) -> None:
        fig.set_size_inches(10.0, 4.0)
        left, right = fig.subplots(1, 2)
        t = 2e-4 * np.arange(5000)
        for track, name, colour in (
            (tracks[2], "standard", "vermillion"),
            (tracks[0], "cascade", "grey"),
            (tracks[1], "cascade, levels 3", "blue"),
        ):
            left.semilogy(
                t, np.maximum(np.abs(track[:, 3]), 1e-2), color=COLOURS[colour], label=name
            )
        left.set_title(r"$|\hat x_4|$ from a wrong start")
        left.set_xlabel("time (s)")
        left.legend()
        omega = np.geomspace(1.0, 5e3, 200)
        for law, name, colour in (
            (standard, "standard", "vermillion"),
            (filtered, "behind a filter", "blue"),
        ):
            response = [passed(law, w)[1] for w in omega]
            right.loglog(omega, response, color=COLOURS[colour], label=name)
        right.set_title(r"$|\hat x_2/y|$, order 2, all poles at $-50$")
        right.set_xlabel("frequency (rad/s)")
        right.legend()

    return Outcome(rows, draw)


@scenario("families-adaptive", title="High-gain EKF, adaptive", paper="families")
def adaptive(ctx: Context) -> Outcome:
    """Covariances in continuous time, gains at rest, and theta under a window's innovation."""
    rows: list[Row] = []
    rates: Mapping[str, Any] = {"method": "rk4", "timing": "predictor"}
    known = VanDerPol(epsilon=0.5, sigma=0.0)
    for theta, x_hat, p in (
        (5.0, (-0.752854140, -1.405894033), (1.771424701, 5.256624609, 47.323828723)),
        (1.0, (-0.454922104, -0.874578807), ()),
    ):
        one: Mapping[str, Any] = {"R": 1.0, "Q": [1.0, 1.0], "P0": [1.0, 1.0]}
        law = HighGainEKF(2, theta, **one, model=known, **rates)
        run = ctx.run(known, law, x0=[1.0, 0.0], dt=1e-3, steps=2000, mode="joint")
        memory = run.final_memory[0]
        found = law.covariance(memory)[np.tril_indices(2)]
        for i, value in enumerate(x_hat):
            what, note = f"θ = {theta:g}, 2 s, x̂{i + 1}", "" if rows else BOIZOT
            rows.append(row(what, memory[i], expected=value, rel=1e-8, note=note))
        for name, value, expected in zip(("P11", "P21", "P22"), found, p, strict=False):
            rows.append(row(f"θ = {theta:g}, 2 s, {name}", value, expected=expected, rel=1e-8))
    start = 7.0 ** np.arange(0.0, 6.0, 2.0)
    law = HighGainEKF(3, 7.0, R=1.0, Q=[1.0, 1.0, 1.0], P0=start, **rates)
    memory = law.run(2e-3, np.zeros(12_000)).memory[-1]
    for i, value in enumerate((16.899494937, 118.296464556, 343.0)):
        gain = 7.0 * law.covariance(memory)[i, 0]
        rows.append(row(f"θ = 7, gain K{i + 1} at rest", gain, expected=value, rel=1e-8))

    window = InnovationGain(10.0, 0.1, 2.0, threshold=0.2, slope=50.0, samples=5)
    law = HighGainEKF(2, window, R=1.0, Q=[1.0, 1.0], P0=[1.0, 1.0])
    theta_at, parts = 5, slice(16, 21)  # in the memory: x̂, P, θ, runs, their innovations

    def under(innovation: float, theta: float, dt: float, steps: int) -> list[float]:
        """θ after each step while every run of the window has this innovation."""
        law.reset()
        memory, seen = law.memory.copy(), []
        memory[theta_at] = theta
        for _ in range(steps):
            memory[parts], memory[-1] = innovation, dt
            memory[:2] = memory[6:16] = 0.0  # model and estimate stand at the sample
            law.memory = memory
            law.correct(0.0)
            memory = law.memory.copy()
            seen.append(float(memory[theta_at]))
        return seen

    for theta, innovation, value in (
        (1.0, 0.2, 5.0),
        (5.0, 1.0, 250.0),
        (8.0, 0.2, 13.0),
        (10.0, 0.2, -9.0),
    ):
        slope = (under(innovation, theta, 1e-7, 1)[0] - theta) / 1e-7
        rows.append(row(f"F({theta:g}, {innovation:g})", slope, expected=value, rel=1e-4))
    rise = under(100.0, 1.0, 2.5e-4, 1120)
    rows.append(row("θ after 0.08 s, μ = 1", rise[319], expected=5.0, rel=1e-7))
    rows.append(row("θ after 0.28 s, μ = 1", rise[1119], expected=105.0 / 11.0, rel=1e-7))

    def draw(fig: Figure) -> None:
        fig.set_size_inches(7.0, 4.0)
        ax = fig.subplots()
        fall = under(0.0, rise[-1], 2.5e-4, 6000)
        ax.plot(2.5e-4 * np.arange(7120), [*rise, *fall], color=COLOURS["blue"])
        ax.set_title(r"$\theta$ under a large innovation for 0.28 s, then none")
        ax.set_xlabel("time (s)")

    return Outcome(rows, draw)


def settled(ctx: Context, observer: Observer, dt: float) -> Array:
    """K of an observer with current timing: what a sample of 1 makes of a memory of 0."""
    plant = Plant(states=["s"], drift=["0"], output="1")
    memory = observer.initial_memory()
    if observer.spec["kind"] == "standard":
        memory[-1] = dt  # the first sample corrects for a whole period
    run = ctx.run(plant, observer, x0=[0.0], memory0=memory, dt=dt, steps=1, every=1, errors=False)
    assert run.memory is not None
    return np.asarray(run.memory[0, 0, : observer.n])


@scenario("families-filters", title="Filters that users know", paper="families")
def filters(ctx: Context) -> Outcome:
    """Alpha-beta-gamma, steady Kalman filters, Savitzky-Golay, dirty derivative."""
    dt, theta = 0.01, float(np.exp(-0.3))
    rows: list[Row] = []

    def gains(observer: Observer, numbers: tuple[float, ...], what: str, source: str) -> None:
        found = settled(ctx, observer, dt)
        for i, value in enumerate(numbers):
            note = source if i == 0 else ""
            rows.append(row(f"{what}, K{i + 1}", found[i], expected=value, rel=1e-9, note=note))

    def noise(observer: Observer, i: int, value: float, what: str, source: str = "") -> None:
        found = float(np.sqrt(observer.noise_gain(dt)[i]))
        what = f"{what}, noise of x̂{i + 1}"
        rows.append(row(what, found, expected=value, rel=1e-8, note=source))

    two, three = (StandardObserver.fading_memory(n, theta, dt) for n in (2, 3))
    gains(two, (0.451188363906, 6.717519473059), "fading memory, n = 2", MORRISON)
    numbers = (0.593430340259, 17.540970444728, 174.105864963266)
    gains(three, numbers, "fading memory, n = 3", "")
    alpha_beta = StandardObserver.alpha_beta_gamma(1.0 - theta**2, (1.0 - theta) ** 2, dt)
    for i, value in enumerate((0.329529226485, 66.005956020)):
        noise(alpha_beta, i, float(np.sqrt(value)), "alpha-beta")
    kalata = StandardObserver.tracking_index(0.5, dt)
    gains(kalata, (0.628373457205, 0.304805898399 / dt), "tracking index 0.5", KALATA)
    kalman = StandardObserver.steady_kalman(2, Q=1.0, R=1e-6, dt=dt)
    gains(kalman, (0.756738198274, 49.321577603113), "steady Kalman", "")
    windows = ((11, 1, 9.534625892), (11, 2, 35.445877848), (21, 3, 32.737257829))
    for window, degree, value in windows:
        observer = WindowObserver.savitzky_golay(window, degree, dt)
        source = SAVITZKY if degree == 1 else ""
        noise(observer, 1, value, f"Savitzky-Golay, {window} samples, degree {degree}", source)
    last = settled(ctx, WindowObserver.savitzky_golay(11, 2, dt), dt)[1]
    what = "Savitzky-Golay, weight of the newest"
    rows.append(row(what, last, expected=22.027972028, rel=1e-9))
    rules = (("tustin", 19.069251785), ("backward", 17.407765596), ("exact", 19.008809709))
    for rule, value in rules:
        observer = WindowObserver.dirty_derivative(0.05, dt, rule)
        noise(observer, 1, value, f"dirty derivative, {rule}")

    laws = {
        "dirty derivative, τ = 50 ms": (WindowObserver.dirty_derivative(0.05, dt), "grey"),
        "Savitzky-Golay, 11 samples, degree 2": (
            WindowObserver.savitzky_golay(11, 2, dt),
            "orange",
        ),
        "fading memory, n = 3": (three, "blue"),
    }
    added = 0.002 * np.random.default_rng(0).standard_normal(301)
    found = {name: record(ctx, law, None, added, dt) for name, (law, _) in laws.items()}

    def draw(fig: Figure) -> None:
        fig.set_size_inches(7.5, 4.0)
        ax = fig.subplots()
        t = dt * np.arange(301)
        for name, memory in found.items():
            ax.plot(t, memory[:, 1], color=COLOURS[laws[name][1]], label=name)
        ax.plot(t, np.cos(t), color=COLOURS["black"], linestyle="--", label="cos t")
        ax.set_ylim(-2.0, 3.0)
        ax.set_title(r"$\hat x_2$ of $\sin t$ with noise of 0.002, 100 Hz")
        ax.set_xlabel("time (s)")
        ax.legend()

    return Outcome(rows, draw)


GAP = (1.117112835768, 6.692741083389, 21.416529062709)
LIMITS = {
    "inter-sample": (4.99990919, 2.89627350, 1.28316601),
    "proper": (2.0 * (np.sqrt(2.0) - 1.0), 0.52752523, 0.38757453),
}
"""Largest ell T of poles -1, n = 2, 3, 4; "proper" with current timing is Nadri's form."""
DELAYS = {(2, 1): 0.647409203, (3, 3, 1): 0.407054160, (2, 2): 0.520494347}
"""Largest ell D of samples that come late."""


@scenario("families-sampling", title="Prediction between samples", paper="families")
def sampling(ctx: Context) -> Outcome:
    """A correction that decays between samples, the longest steps that it bears, and the longest
    delays.
    """
    law = StandardObserver(3, 10.0, k=(3.0, 3.0, 1.0), method="inter-sample")
    y = 1.1 - np.sin(0.05 * np.arange(2))
    memory = record(ctx, law, (0.3, -0.2, 0.7), y, 0.05)
    rows = rows_of(memory, {1: GAP}, "inter-sample", INTER_SAMPLE)
    std = np.sqrt(noise_gain(law.spec, 0.05) * 1e-4)
    for i, value in enumerate((1.159143975e-2, 1.037446636e-1, 3.318887717e-1)):
        rows.append(row(f"inter-sample, std of x̂{i + 1}", std[i], expected=value, rel=1e-8))
    for method, numbers in LIMITS.items():
        for k, limit in zip(((2, 1), (3, 3, 1), (4, 6, 4, 1)), numbers, strict=True):
            c = StandardObserver(len(k), 1.0, k=k, method=method).step_limit().c
            note = NADRI if method == "proper" and len(k) == 2 else ""
            what = f"{method}, n = {len(k)}, largest ℓT"
            rows.append(row(what, c, expected=limit, rel=1e-7, note=note))
    for k, limit in DELAYS.items():
        longest = delay_limit(StandardObserver(len(k), 1.0, k=k).spec)
        what = f"delayed, k = {', '.join(map(str, k))}, largest ℓD"
        rows.append(row(what, longest, expected=limit, rel=1e-8))
    gaps = np.full(201, np.nan)
    gaps[::4] = np.sin(0.05 * np.arange(201))[::4]
    by_gaps = law.run(0.05, gaps, x_hat0=(1.0, 0.0, 0.0)).memory[::4]
    long = law.run(0.2, gaps[::4], x_hat0=(1.0, 0.0, 0.0)).memory
    off = float(np.abs(by_gaps - long).max())
    rows.append(row("3 of 4 samples missing less the step 4T", off, expected=0.0, abs=1e-11))

    def draw(fig: Figure) -> None:
        ax = fig.subplots()
        t = 0.05 * np.arange(201)
        ax.plot(t, law.run(0.05, gaps, x_hat0=(1.0, 0.0, 0.0)).x_hat[:, 1], label=r"$\hat x_2$")
        ax.plot(t, np.cos(t), color=COLOURS["black"], linestyle="--", label=r"$\cos t$")
        ax.set_title("Inter-sample predictor, a sample every 0.2 s")
        ax.set_xlabel("time (s)")
        ax.legend()

    return Outcome(rows, draw)
