"""Lee, Choi, Khalil: a high-gain observer (HGO) by stochastic approximation (SA).

The plant (38) is measured with uniform noise and observed twice by forward Euler: with the fixed
step T, eq. (42), and with the decreasing steps a(k) = alpha epsilon b(k), b(k) = (1 + k/k0)^-p,
eq. (44).  Under SA the plant advances by the same a(k), eq. (23), so that time is
t(k) = sum a(j), about 8 ln(1 + k/20000) s.  The error is linear in the noise, hence its mean and
covariance are computed exactly beside every Monte Carlo study.

Errors in the figures have the paper's sign, e = x - x_hat.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hgo_rs.plots import COLOURS, note_peak
from hgo_rs.scenarios.base import Context, Outcome, Row, row, scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

# --- the experiment: section VI ---------------------------------------------------------------

H = (2.0, 2.0)  # h1, h2: (43)
EPSILON = 0.01
ALPHA = 0.04
T = 0.0004  # s
K0 = 20_000
X0 = (10.0, 10.0)  # (45)
NOISE = {"kind": "uniform", "low": -0.5, "high": 0.5}
VARIANCE = 1.0 / 12.0

FIXED = {"kind": "fixed", "dt": T}


def decreasing(p: float) -> dict[str, Any]:
    """The schedule a(k) = alpha epsilon (1 + k/k0)^-p: (21)."""
    return {
        "kind": "stochastic-approximation",
        "alpha": ALPHA,
        "epsilon": EPSILON,
        "k0": K0,
        "p": p,
    }


SA = decreasing(1.0)

READINGS: dict[str, dict[str, Any]] = {
    "fixed": {"schedule": FIXED},
    "SA": {"schedule": SA},
    # Not the paper's: the plant goes on at T while the observer believes in a(k).
    "plant at T": {"schedule": SA, "plant_schedule": FIXED},
}

# --- what to expect ---------------------------------------------------------------------------

WINDOWS = (
    (20_000, 50_000),
    (50_000, 100_000),
    (100_000, 200_000),
    (200_000, 400_000),
    (400_000, 800_000),
    (800_000, 1_600_000),
)
WINDOW_NAMES = ("2e4-5e4", "5e4-1e5", "1e5-2e5", "2e5-4e5", "4e5-8e5", "8e5-1.6e6")

# RMS of e_i over each window; the tolerance is half of the last digit.
RMS: dict[tuple[str, int], tuple[tuple[float, ...], float]] = {
    ("fixed", 2): ((6.0116,) * 6, 5e-5),
    ("SA", 1): ((0.04353, 0.03299, 0.02469, 0.01801, 0.01294, 0.00923), 5e-6),
    ("SA", 2): ((3.5823, 2.7055, 2.0209, 1.4725, 1.0578, 0.7540), 5e-5),
    ("plant at T", 2): ((3.5835, 2.7134, 2.0725, 1.9626, 3.0781, 0.7540), 5e-5),
}
MONTE_CARLO_REL = 0.015
# Runs for the first two windows and for the later ones.  48 runs leave a standard error of up to
# 0.5 % (neighbouring errors are correlated over 1/(alpha b) steps), these 0.3 % or less.
MONTE_CARLO_RUNS = {"fixed": (384, 48), "SA": (384, 96), "plant at T": (384, 96)}
EARLY_WINDOWS = 2

STATIONARY_STD = (0.0721588, 6.011561)  # rel 1e-6
SMALL_STEP_STD2 = 5.7735
PEAK_X2_HAT = 669.0

SA_STEPS = 1_000_000  # samples of the figures' SA runs
SA_TIME = 31.45  # s, after SA_STEPS
UNIFORM_STD2, SA_STD2 = 1.62, 0.81  # after SA_STEPS: the same samples spread evenly, and SA

SLOPES = {1.0: -0.501, 0.75: -0.375}  # of ln RMS(e2) over ln(k + k0): -p/2
SLOPE_ABS = 0.005
SLOPE_WINDOWS = slice(2, None)  # from k = 1e5 on, where alpha b is small

SCHUR_LIMIT = 1.0  # alpha b
NORM_BOUND = 0.0890  # alpha b, (33) with Q = I
CLOCK_STOPS = {1.1: 80.0, 1.5: 16.0}  # p: s
STEP_FAMILY = (0.4, 0.5, 0.51, 0.75, 1.0, 1.01, 1.1, 1.5)
STEP_FAMILY_HOLDS = "0.51, 0.75, 1"

# --- runs -------------------------------------------------------------------------------------


def study(reading: str, steps: int, **options: Any) -> dict[str, Any]:
    """The spec of plant (38), discretised by Euler, with the observer (42) or (44)."""
    return {
        "plant": {"kind": "lee"},
        "observer": {
            "kind": "standard",
            "n": 2,
            "k": H,
            "gain": {"law": "constant", "ell": 1.0 / EPSILON},
            "model": {"kind": "none"},
            "method": "euler",
        },
        "x0": X0,
        "memory0": (0.0, 0.0),  # (46), (47)
        "steps": steps,
        **READINGS[reading],
        **options,
    }


def plot_windows() -> list[tuple[int, int]]:
    """Narrow windows, even on a logarithmic scale, for the exact RMS in the figures."""
    edges = np.unique(np.round(np.geomspace(100, WINDOWS[-1][1], 61)).astype(int)).tolist()
    return list(itertools.pairwise(edges))


def exact_rms(ctx: Context, reading: str, p: float = 1.0) -> Array:
    """Exact RMS of (e1, e2): one row a window of `WINDOWS`, then of `plot_windows`."""
    spec = study(reading, WINDOWS[-1][1], windows=[*WINDOWS, *plot_windows()], variance=VARIANCE)
    if p != 1.0:
        spec["schedule"] = decreasing(p)
    rms: Array = ctx.mean_covariance(spec)["rms"]
    return rms


def monte_carlo_rms(ctx: Context, reading: str) -> Array:
    """RMS of (e1, e2) over all runs of a study, one row a window of `WINDOWS`."""
    parts = []
    early, late = MONTE_CARLO_RUNS[reading]
    for runs, windows in ((early, WINDOWS[:EARLY_WINDOWS]), (late, WINDOWS[EARLY_WINDOWS:])):
        spec = study(
            reading, windows[-1][1], noise=NOISE, runs=runs, seed=ctx.seed, windows=windows
        )
        parts.append(np.sqrt(np.mean(ctx.simulate(spec)["rms"] ** 2, axis=0)))
    return np.concatenate(parts)


def rms_rows(ctx: Context, reading: str, i: int, note: str = "") -> list[Row]:
    """RMS of e_i over the windows: the exact recursion, then Monte Carlo."""
    expected, digits = RMS[reading, i]
    exact = exact_rms(ctx, reading)[:, i - 1]
    sampled = monte_carlo_rms(ctx, reading)[:, i - 1]
    early, late = MONTE_CARLO_RUNS[reading]
    rows = []
    for j, name in enumerate(WINDOW_NAMES):
        text = note if j == 0 else ""
        what = f"{reading}: RMS e{i}, k {name}"
        rows.append(row(f"{what}, exact", exact[j], expected=expected[j], abs=digits, note=text))
    for j, name in enumerate(WINDOW_NAMES):
        runs = early if j < EARLY_WINDOWS else late
        what = f"{reading}: RMS e{i}, k {name}, {runs} runs"
        rows.append(row(what, sampled[j], expected=expected[j], rel=MONTE_CARLO_REL))
    return rows


def trajectory(ctx: Context, reading: str, **options: Any) -> tuple[Array, Array, Array]:
    """One run over SA_TIME: t (N,), x (N, 2), x_hat (N, 2), thinned to N <= 5000 even in time."""
    steps = round(sa_time() / T) if reading == "fixed" else SA_STEPS
    run = ctx.simulate(
        study(reading, steps, **{"every": 16, "noise": NOISE, "seed": ctx.seed} | options)
    )
    t = run["t"]
    keep = np.unique(np.searchsorted(t, np.linspace(0.0, t[-1], 5_000)))
    return t[keep], run["x"][0, keep], run["memory"][0, keep]


def sa_time() -> float:
    """t(SA_STEPS) [s]."""
    from hgo_rs.design import clock

    return float(clock(SA_STEPS, ALPHA, EPSILON, K0, 1.0))


# --- figures ----------------------------------------------------------------------------------


def state_figure(
    ctx: Context, i: int, limits: tuple[float, float], unit: str
) -> Callable[[Figure], None]:
    """Figs. 1 and 2: x_i of the ODE (38), x_i_hat with the fixed step, x_i_hat with SA."""
    t_ode, ode, _ = trajectory(ctx, "fixed", plant_method="rk4")
    panels: list[tuple[str, Array, Array, str]] = [
        (rf"$x_{i}$, ODE (38)", t_ode, ode[:, i - 1], "black")
    ]
    for reading, name, colour in (
        ("fixed", rf"$\hat x_{i}$, fixed step", "blue"),
        ("SA", rf"$\hat x_{i}$, SA", "vermillion"),
    ):
        t, _, x_hat = trajectory(ctx, reading)
        panels.append((name, t, x_hat[:, i - 1], colour))

    def draw(fig: Figure) -> None:
        fig.set_size_inches(7.2, 6.0)
        axes = fig.subplots(3, 1, sharex=True)
        for ax, (name, t, values, colour) in zip(axes, panels, strict=True):
            ax.plot(t, values, color=COLOURS[colour], linewidth=1.4 if colour == "black" else 0.6)
            ax.set_title(name)
            ax.set_ylabel(unit)
            ax.set_xlim(0.0, sa_time())
            if colour != "black":
                ax.set_ylim(limits)
                if values.max() > limits[1] or values.min() < limits[0]:
                    note_peak(ax, values)
        axes[-1].set_xlabel("time (s)")

    return draw


def error_figure(ctx: Context, reading: str, i: int, limit: float) -> Callable[[Figure], None]:
    """Figs. 3 to 6: e_i = x_i - x_i_hat of one run, and the exact RMS around it."""
    from hgo_rs.design import clock

    t, x, x_hat = trajectory(ctx, reading)
    error = (x - x_hat)[:, i - 1]
    rms = exact_rms(ctx, reading)[len(WINDOWS) :, i - 1]
    middle = np.sqrt(np.prod(np.asarray(plot_windows(), dtype=float), axis=1)).astype(int)
    t_rms = T * middle if reading == "fixed" else clock(middle, ALPHA, EPSILON, K0, 1.0)
    scheme = "fixed step" if reading == "fixed" else "SA"
    unit = "" if i == 1 else " (1/s)"

    def draw(fig: Figure) -> None:
        fig.set_size_inches(7.2, 3.6)
        ax = fig.subplots()
        ax.plot(t, error, color=COLOURS["blue"], linewidth=0.5, label="one run")
        for sign, label in ((1.0, "± RMS, exact"), (-1.0, None)):
            ax.plot(t_rms, sign * rms, color=COLOURS["vermillion"], label=label)
        ax.set_title(rf"$e_{i} = x_{i} - \hat x_{i}$, {scheme}")
        ax.set_ylabel(rf"$e_{i}${unit}")
        ax.set_xlabel("time (s)")
        ax.set_xlim(0.0, sa_time())
        ax.set_ylim(-limit, limit)
        note_peak(ax, error)
        ax.legend(loc="lower right", ncols=2, frameon=True)

    return draw


# --- the scenarios ----------------------------------------------------------------------------


@scenario("lee-fig1", title="x1 and its estimates: fixed step and SA", paper="lee")
def fig1(ctx: Context) -> Outcome:
    """x1 (top), the fixed-step estimate (middle), the SA estimate (bottom)."""
    t, x, x_hat = trajectory(ctx, "fixed")
    late = (t >= 1.0) & (t < 2.0)
    _, ode, _ = trajectory(ctx, "fixed", plant_method="rk4")
    _, sa_x, _ = trajectory(ctx, "SA")
    _, sa_ode, _ = trajectory(ctx, "SA", plant_method="rk4")
    rows = [
        row(
            "time after 1e6 SA samples (s)",
            sa_time(),
            expected=SA_TIME,
            abs=0.005,
            note="plant and observer advance by the same a(k), (23): t(k) ≈ 8 ln(1 + k/20000) s",
        ),
        row(
            "largest |x1 of (41) - x1 of the ODE (38)|",
            np.abs(x - ode)[:, 0].max(),
            at_most=2e-3,
            note="the observed plant is the Euler model; the top panel is the ODE (RK4)",
        ),
        row(
            "largest |x1 of (23) - x1 of the ODE (38)|",
            np.abs(sa_x - sa_ode)[:, 0].max(),
            at_most=2e-3,
        ),
        row(
            "(42), mean |x1 - x̂1| over [1, 2) s with x̂1 = q1f",
            np.abs(x - x_hat)[late, 0].mean(),
            at_most=0.1,
        ),
        row(
            "(42), the same with x̂1 = q2f as printed",
            np.abs(x[late, 0] - EPSILON * x_hat[late, 1]).mean(),
            at_least=5.0,
            note="(42) prints x̂1 = q2f: q2f = ε x̂2 is no estimate of x1, q1f is",
        ),
    ]
    return Outcome(rows, state_figure(ctx, 1, (-1.0, 21.0), r"$x_1$"))


@scenario("lee-fig2", title="x2 and its estimates: fixed step and SA", paper="lee")
def fig2(ctx: Context) -> Outcome:
    """x2 (top), the fixed-step estimate (middle), the SA estimate (bottom)."""
    rows = []
    for reading in ("fixed", "SA"):
        quiet = ctx.simulate(study(reading, 5_000))
        rows.append(
            row(
                f"{reading}: peak |x̂2| without noise (1/s)",
                quiet["peak"][0, 1],
                expected=PEAK_X2_HAT,
                abs=0.5,
            )
        )
    rows += rms_rows(
        ctx,
        "plant at T",
        2,
        note="not the figures' reading: with the plant at T and the observer at a(k), x̂2 is "
        "biased by 1/b(k)",
    )
    return Outcome(rows, state_figure(ctx, 2, (-30.0, 30.0), r"$x_2$ (1/s)"))


@scenario("lee-fig3", title="error of x1, fixed step", paper="lee")
def fig3(ctx: Context) -> Outcome:
    """e1 with the fixed step."""
    exact, sampled = exact_rms(ctx, "fixed")[:, 0], monte_carlo_rms(ctx, "fixed")[:, 0]
    rows = [
        stationary_row(1),
        row(
            "fixed: RMS e1, k 8e5-1.6e6, exact recursion",
            exact[len(WINDOWS) - 1],
            expected=STATIONARY_STD[0],
            rel=1e-6,
        ),
        *(
            row(
                f"fixed: RMS e1, k {name}, {MONTE_CARLO_RUNS['fixed'][j >= EARLY_WINDOWS]} runs",
                sampled[j],
                expected=STATIONARY_STD[0],
                rel=MONTE_CARLO_REL,
            )
            for j, name in enumerate(WINDOW_NAMES)
        ),
        row(
            "fixed: RMS e1, last window over first",
            exact[len(WINDOWS) - 1] / exact[0],
            expected=1.0,
            abs=1e-6,
            paper="non-decreasing",
        ),
    ]
    return Outcome(rows, error_figure(ctx, "fixed", 1, 0.4))


@scenario("lee-fig4", title="error of x1, SA", paper="lee")
def fig4(ctx: Context) -> Outcome:
    """e1 with SA."""
    rows = [*rms_rows(ctx, "SA", 1), decrease_row(ctx, 1)]
    return Outcome(rows, error_figure(ctx, "SA", 1, 0.4))


@scenario("lee-fig5", title="error of x2, fixed step", paper="lee")
def fig5(ctx: Context) -> Outcome:
    """e2 with the fixed step."""
    rows = [
        stationary_row(2),
        row(
            "fixed: RMS e2, k 8e5-1.6e6, exact recursion over the Lyapunov equation",
            exact_rms(ctx, "fixed")[len(WINDOWS) - 1, 1] / stationary_std()[1],
            expected=1.0,
            rel=1e-8,
        ),
        row(
            "small-step limit of std e2 (1/s)",
            small_step_std()[1],
            expected=SMALL_STEP_STD2,
            abs=5e-5,
            note="the continuous Lyapunov equation at the same σ²T is 4 % off at αb = 0.04",
        ),
        *rms_rows(ctx, "fixed", 2),
    ]
    return Outcome(rows, error_figure(ctx, "fixed", 2, 35.0))


@scenario("lee-fig6", title="error of x2, SA", paper="lee")
def fig6(ctx: Context) -> Outcome:
    """e2 with SA, how fast it falls, and what sampling faster has to do with it."""
    from hgo_rs.design import stationary_error

    middle = np.sqrt(np.prod(np.asarray(WINDOWS, dtype=float), axis=1)) + K0
    rows = [*rms_rows(ctx, "SA", 2), decrease_row(ctx, 2)]
    for p, slope in SLOPES.items():
        rms = exact_rms(ctx, "SA", p)[: len(WINDOWS), 1]
        fit = np.polyfit(np.log(middle[SLOPE_WINDOWS]), np.log(rms[SLOPE_WINDOWS]), 1)
        rows.append(
            row(
                f"SA: slope of ln RMS(e2), p = {p:g}",
                fit[0],
                expected=slope,
                abs=SLOPE_ABS,
                note="over ln(k + k0), k ≥ 1e5: RMS falls as k^(-p/2)",
            )
        )
    end = study("SA", SA_STEPS, windows=[WINDOWS[3]], variance=VARIANCE)
    even = sa_time() / SA_STEPS
    rows += [
        row(
            "SA: std e2 after 1e6 samples (1/s)",
            np.sqrt(ctx.mean_covariance(end)["final_covariance"][1, 1]),
            expected=SA_STD2,
            abs=0.005,
        ),
        row(
            "fixed step, the same 1e6 samples spread evenly over 31.45 s: std e2 (1/s)",
            stationary_error(H, 1.0 / EPSILON, even, VARIANCE).std[1],
            expected=UNIFORM_STD2,
            abs=0.005,
            note="not in the paper: SA's gain comes from sampling ever faster, up to T/51; the "
            "even spread alone takes std e2 from 6.01 to this",
        ),
    ]
    return Outcome(rows, error_figure(ctx, "SA", 2, 35.0))


def stationary_std() -> Array:
    """Stationary std of (e1, e2) with the fixed step."""
    from hgo_rs.design import stationary_error

    return stationary_error(H, 1.0 / EPSILON, T, VARIANCE).std


def stationary_row(i: int) -> Row:
    """Stationary std of e_i with the fixed step."""
    return row(
        f"fixed: stationary std e{i}, discrete Lyapunov equation",
        stationary_std()[i - 1],
        expected=STATIONARY_STD[i - 1],
        rel=1e-6,
    )


def small_step_std() -> Array:
    """Std of e as T -> 0 at constant sigma^2 T: A_0 S + S A_0' + (T/eps) sigma^2 H_0 H_0' = 0."""
    from scipy.linalg import solve_continuous_lyapunov

    from hgo_rs.design import companion

    h0 = np.asarray(H)
    s = solve_continuous_lyapunov(companion(H), -(T / EPSILON) * VARIANCE * np.outer(h0, h0))
    return np.asarray(np.sqrt(np.diag(s)) / EPSILON ** np.arange(h0.size))


def decrease_row(ctx: Context, i: int) -> Row:
    """SA's RMS of e_i over the last window, relative to the first."""
    expected, _ = RMS["SA", i]
    exact = exact_rms(ctx, "SA")[:, i - 1]
    return row(
        f"SA: RMS e{i}, last window over first",
        exact[len(WINDOWS) - 1] / exact[0],
        expected=expected[-1] / expected[0],
        rel=1e-3,
        paper="decreasing",
    )


@scenario("lee-stability", title="step sizes that keep the observer stable", paper="lee")
def stability(ctx: Context) -> Outcome:
    """Limits on alpha b(k), condition (A.2), and where the clock stops."""
    from hgo_rs import design

    a0 = design.companion(H)
    limit = design.schur_limit(a0)
    bound = design.norm_bound(a0)
    first = design.lmi_step(a0, ALPHA)  # P found at b(0) = 1
    b = (1.0 + np.arange(0, SA_STEPS + 1, 1000) / K0) ** -1.0
    margins = np.array([design.step_margin(a0, first.p, ALPHA * bk) for bk in b])
    printed = ALPHA * b * margins  # c of (36) as printed
    family = {p: design.step_sizes(ALPHA, EPSILON, K0, p) for p in STEP_FAMILY}
    alive = {c: survives(ctx, c * EPSILON) for c in (0.99, 1.01)}
    rows = [
        row("αb below which I + αb A0 is Schur", limit, expected=SCHUR_LIMIT, rel=1e-9),
        row(
            "αb below which the LMI (36) is feasible", lmi_limit(a0), expected=SCHUR_LIMIT, abs=1e-3
        ),
        row("largest fixed step T_max (s)", limit * EPSILON, expected=EPSILON, rel=1e-9),
        row("fixed step 0.99 ε, 5000 steps: bounded", alive[0.99], expected="yes"),
        row("fixed step 1.01 ε, 5000 steps: bounded", alive[1.01], expected="no"),
        row(
            "αb below which the bound (33) is negative, Q = I",
            bound,
            expected=NORM_BOUND,
            abs=5e-5,
            note="sufficient only: the exact limit is 11 times larger",
        ),
        row("α of (43) over that bound", ALPHA / bound, at_most=1.0),
        row(
            "one step of the core against (29) with H0",
            recursion_error(ctx),
            at_most=1e-12,
            note="(32) writes B for the H0 of (29)",
        ),
        row(
            "b(0)",
            design.clock(1, ALPHA, EPSILON, K0, 1.0) / (ALPHA * EPSILON),
            expected=1.0,
            abs=1e-15,
            paper="< 1",
            note="the text asks b(k) < 1; its b(k) = 1/(1 + k/20000) begins at 1",
        ),
        row(
            "c of (36) as printed, at k = 1e6 over k = 0",
            printed[-1] / printed[0],
            at_most=0.03,
            note="no one c serves all k: the left side vanishes with b(k)",
        ),
        row(
            "c of (36) divided by αb, with P found at b(0): smallest over k ≤ 1e6",
            margins.min() / margins[0],
            at_least=1.0,
            note="relative to k = 0: divided by αb first, one P found at b(0) serves every k",
        ),
        row(
            f"(A.2) holds, of p = {', '.join(f'{p:g}' for p in STEP_FAMILY)}",
            ", ".join(f"{p:g}" for p, sizes in family.items() if sizes.holds),
            expected=STEP_FAMILY_HOLDS,
            note="exactly for 1/2 < p ≤ 1",
        ),
        *(
            row(
                f"time at which the clock stops, p = {p:g} (s)",
                family[p].final_time,
                expected=stop,
                rel=1e-4,
            )
            for p, stop in CLOCK_STOPS.items()
        ),
    ]
    return Outcome(rows, stability_figure(a0, limit, bound))


def lmi_limit(a0: Array) -> float:
    """The alpha b at which the LMI (36) ceases to be feasible, by bisection to 2^-12."""
    from hgo_rs.design import lmi_step

    low, high = 0.5, 1.5
    if not lmi_step(a0, low) or lmi_step(a0, high):
        return float("nan")
    while high - low > 2.0**-12:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if lmi_step(a0, middle) else (low, middle)
    return 0.5 * (low + high)


def survives(ctx: Context, dt: float) -> bool:
    """Whether the observer by forward Euler stays bounded for 5000 steps of ``dt`` [s].

    The plant is at rest, so that nothing but the observer's step is on trial.
    """
    spec = study("fixed", 5_000, plant_method="held")
    spec["schedule"] = {"kind": "fixed", "dt": dt}
    return bool(ctx.simulate(spec)["diverged_at"][0] < 0)


def recursion_error(ctx: Context) -> float:
    """Largest relative difference of one observer step from (29), in q = D x_hat."""
    from hgo_rs.design import companion

    q = np.array([1.0, 2.0])
    scale = EPSILON ** np.arange(2)  # D
    after = ctx.simulate(study("SA", 1) | {"memory0": q / scale})["final_memory"][0] * scale
    expected = q + ALPHA * (companion(H) @ q + np.asarray(H) * X0[0])
    return float(np.max(np.abs(after - expected) / np.abs(expected)))


def stability_figure(a0: Array, limit: float, bound: float) -> Callable[[Figure], None]:
    """Spectral radius of I + alpha b A_0, and the clock of the step families."""
    from hgo_rs.design import clock

    alpha_b = np.linspace(0.0, 1.3, 261)
    radius = [np.abs(np.linalg.eigvals(np.eye(2) + c * a0)).max() for c in alpha_b]
    k = np.unique(np.round(np.geomspace(1e3, 1e7, 200)).astype(int))
    powers: Sequence[float] = (0.5, 0.75, 1.0, 1.1, 1.5)
    clocks = {p: clock(k, ALPHA, EPSILON, K0, p) for p in powers}

    def draw(fig: Figure) -> None:
        fig.set_size_inches(9.4, 4.0)
        left, right = fig.subplots(1, 2)
        left.plot(alpha_b, radius, color=COLOURS["black"])
        left.axhline(1.0, color=COLOURS["grey"], linewidth=0.8)
        for at, name, colour in (
            (ALPHA, f"α = {ALPHA:g}, the paper's", "green"),
            (bound, f"bound (33): {bound:.4f}", "blue"),
            (limit, f"Schur, LMI: {limit:.4g}", "vermillion"),
        ):
            left.axvline(at, color=COLOURS[colour], linestyle="--", label=name)
        left.set_title("Spectral radius of I + αb A₀")
        left.set_xlabel("αb")
        left.legend(loc="upper center", frameon=True)
        for p, t in clocks.items():
            law = "solid" if 0.5 < p <= 1.0 else "dashed"
            line = right.semilogx(k, t, linestyle=law, label=f"p = {p:g}")[0]
            if p in CLOCK_STOPS:
                right.axhline(CLOCK_STOPS[p], color=line.get_color(), linewidth=0.8, linestyle=":")
        right.set_ylim(0.0, 125.0)
        right.set_title("t(k); dashed: (A.2) fails, dotted: the clock stops")
        right.set_xlabel("k")
        right.set_ylabel("t (s)")
        right.legend(loc="upper left", frameon=True)

    return draw
