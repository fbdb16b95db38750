"""Fu, Kang, Li: a sampled-data observer on the Euler-Maruyama (EM) model of an SDE.

The Van der Pol oscillator (18), driven by a Wiener process and integrated with a fine step, is
observed through samples of x1 by the observer (5).  l2 is right as printed, l1 is not: with
mu = epsilon (1 - y^2) the error matrix has the constant spectrum {-2, -3} for l1 = (5 + mu) T
("derived"), while the paper prints 5 - mu ("printed").  Every result stands for both.

The error is e = x_hat - x.  Subtracting the samples of the SDE from (5), the terms of l2 that
contain x_hat cancel those of f(x_hat) - f(x), and exactly

    e(k+1) = (I + T A(mu(y(k)))) e(k) + w(k),
    A = [[-(5 + mu), 1], [-(6 + 5 mu + mu^2), mu]]  (derived; printed: 5 - mu),

where w(k) is the one-step error of the EM model, which does not depend on x_hat.  Whether the
observer is stable is thus a matter of the products of I + T A(mu(y(k))) along the plant's paths.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hgo_rs.plots import COLOURS
from hgo_rs.scenarios.base import Context, Outcome, Row, row, scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

# --- the experiment: section IV ---------------------------------------------------------------

EPSILON = 0.8
SIGMA = 0.5
PLANT = {"kind": "van-der-pol", "epsilon": EPSILON, "sigma": SIGMA}  # (18)
MULTIPLICATIVE = {**PLANT, "multiplicative": True}  # g = (0, sigma x2)
X0 = (1.0, 0.0)
X_HAT0 = (0.0, 1.0)
PLANT_STEP = 0.001  # s, strong order 1.5
T_END = 99.0  # s
T_SETTLED = 21.0  # s, the stationary errors are taken from here on
RUNS = 800
GAINS = ("printed", "derived")

# --- what to expect ---------------------------------------------------------------------------

# Stationary ||e||^2: mean, median, 95 % quantile.
STATIONARY: dict[str, dict[float, tuple[float, float, float]]] = {
    "printed": {
        0.01: (0.0973, 0.0415, 0.383),
        0.03: (0.0976, 0.0415, 0.385),
        0.1: (0.1095, 0.0461, 0.434),
        0.3: (0.380, 0.136, 1.60),
    },
    "derived": {
        0.01: (0.1035, 0.0445, 0.406),
        0.03: (0.1032, 0.0442, 0.405),
        0.1: (0.1128, 0.0481, 0.443),
        0.3: (0.2947, 0.127, 1.21),
    },
}
L1_NOTE = "l1 = (5 + μ)T makes the error's spectrum constant; the paper prints 5 - μ"
STATIONARY_REL = 0.03
# Near its mean-square limit the printed gain has no fourth moment: the sample mean scatters more.
STATIONARY_REL_AT = {("printed", 0.3): 0.06}
NOISE_FLOOR_ABS = 0.02  # of E||e||^2 at T = 0.03 over T = 0.01, on the same plant paths

# Largest stable T [s].
ALMOST_SURE = {"printed": 0.403, "derived": 0.605}
MEAN_SQUARE = {"printed": 0.361, "derived": 0.579}
LIMIT_ABS = 0.02

# Runs of the EM model itself that diverge at T = 0.3: 924 of 2000, a sample too.
EM_T = 0.3
EM_DIVERGED, EM_OF = 924, 2_000
EM_RUNS = 20_000
EM_ABS = 4.0 * np.sqrt(EM_DIVERGED * (1.0 - EM_DIVERGED / EM_OF) * (1.0 + EM_OF / EM_RUNS))

# One step of EM against the SDE, E||F_e - F_a||^2 over T.
ONE_STEP_T = tuple(2.0**-j for j in range(8, 15))  # s
ONE_STEP_RUNS = 100_000
ONE_STEP_SLOPES = {"additive": 3.0, "multiplicative": 2.0}
ONE_STEP_SLOPE_ABS = 0.05
ONE_STEP_STATES = ((0.0, 0.0), (1.0, 0.0), (2.0, 1.0))
COEFFICIENT_RUNS = 500_000  # standard error 0.2 %
COEFFICIENT_REL = 0.01
LEMMA_T = 0.01  # s

# Strong orders over t in [0, 1] s: plant, scheme, order.
STRONG_ORDERS: dict[str, tuple[dict[str, Any], str, float]] = {
    "EM, additive": (PLANT, "euler-maruyama", 1.0),
    "EM, multiplicative": (MULTIPLICATIVE, "euler-maruyama", 0.5),
    "Milstein, multiplicative": (MULTIPLICATIVE, "milstein", 1.0),
    "order 1.5 Taylor, additive": (PLANT, "taylor-1.5", 2.0),
}
STRONG_STEPS = (128, 256, 512, 1024)
STRONG_RUNS = 2_000
STRONG_ABS = 0.1
FINE = 4  # steps of the reference per step of the scheme on trial

# Exponents of the error's growth.
PATH_DT, PATH_TIME, PATH_RUNS = 0.05, 400.0, 64  # s, s
COARSE_PLANT_STEP = 0.0125  # s: for exponents the plant need not be finer
EXPONENT_T = np.round(np.arange(0.05, 0.751, 0.05), 10)  # s, almost surely
MOMENT_T = {  # s, in mean square
    "printed": (0.25, 0.30, 0.35, 0.40, 0.45),
    "derived": (0.45, 0.50, 0.55, 0.60, 0.65),
}
CLONES, CLONE_BLOCKS, CLONE_BLOCK, CLONE_BURN_IN = 1_000, 60, 4, 10

# --- runs -------------------------------------------------------------------------------------


def study(gain: str, dt: float, t_end: float, **options: Any) -> dict[str, Any]:
    """The spec of the SDE (18) with the observer (5), sampled every ``dt`` up to ``t_end`` [s]."""
    return {
        "plant": PLANT,
        "observer": {"kind": "sampled-data", "model": PLANT, "gain": gain},
        "schedule": {"kind": "fixed", "dt": dt},
        "steps": round(t_end / dt),
        "plant_method": "taylor-1.5",
        "substeps": round(dt / PLANT_STEP),
        "x0": X0,
        "memory0": X_HAT0,
        **options,
    }


def stationary(ctx: Context, gain: str, dt: float) -> tuple[tuple[float, float, float], int]:
    """Mean, median and 95 % quantile of ||e||^2 on [21, 99) s, and how many runs diverged."""
    window = [round(T_SETTLED / dt), round(T_END / dt)]
    run = ctx.simulate(
        study(gain, dt, T_END, runs=RUNS, seed=ctx.seed, windows=[window], histogram=window)
    )
    mean = float(np.mean(np.sum(run["rms"][:, 0] ** 2, axis=1)))
    edges, counts = run["histogram"]["edges"], run["histogram"]["counts"]
    share = np.concatenate(([0.0], np.cumsum(counts) / counts.sum()))
    median, high = np.exp(np.interp((0.5, 0.95), share, np.log(edges)))
    return (mean, float(median), float(high)), int(np.sum(run["diverged_at"] >= 0))


def stationary_rows(ctx: Context, dt: float) -> list[Row]:
    """The stationary error at a sampling period, for both gains."""
    rows = []
    for gain in GAINS:
        found, _ = stationary(ctx, gain, dt)
        rel = STATIONARY_REL_AT.get((gain, dt), STATIONARY_REL)
        for name, ours, expected in zip(
            ("E‖e‖²", "median of ‖e‖²", "95 % quantile of ‖e‖²"),
            found,
            STATIONARY[gain][dt],
            strict=True,
        ):
            note = L1_NOTE if gain == "derived" and not name.startswith(("m", "9")) else ""
            what = f"T = {dt:g} s, {gain} l1: {name}"
            rows.append(row(what, ours, expected=expected, rel=rel, note=note))
    return rows


def growth_row(ctx: Context, gain: str, small: float, large: float) -> Row:
    """E||e||^2 at one sampling period over that at a smaller one."""
    ratio = stationary(ctx, gain, large)[0][0] / stationary(ctx, gain, small)[0][0]
    return row(
        f"{gain} l1: E‖e‖² at T = {large:g} s over T = {small:g} s",
        ratio,
        at_least=1.0,
        paper="grows",
    )


# --- figures 1 to 3 ---------------------------------------------------------------------------

SHOWN = 40.0  # s


def observer_figure(ctx: Context, dt: float) -> Callable[[Figure], None]:
    """The SDE's path, the estimates of both gains at its samples, and the squared errors."""
    fine = ctx.simulate(study("derived", 0.02, SHOWN, every=1, seed=ctx.seed))
    runs = {g: ctx.simulate(study(g, dt, SHOWN, every=1, seed=ctx.seed)) for g in GAINS}
    means = {g: stationary(ctx, g, dt)[0][0] for g in GAINS}
    colours = {"printed": COLOURS["blue"], "derived": COLOURS["vermillion"]}

    def draw(fig: Figure) -> None:
        fig.set_size_inches(7.6, 6.4)
        axes = fig.subplots(3, 1, sharex=True)
        for i, ax in enumerate(axes[:2]):
            ax.plot(fine["t"], fine["x"][0, :, i], color=COLOURS["black"], lw=1.6, label="SDE (18)")
            for gain, run in runs.items():
                ax.plot(
                    run["t"],
                    run["memory"][0, :, i],
                    color=colours[gain],
                    linewidth=0.9,
                    marker="." if dt > 0.05 else "",
                    markersize=4 if dt > 0.2 else 2.5,
                    label=f"observer (5), {gain} $l_1$",
                )
            ax.set_ylabel(rf"$x_{i + 1}$, $\hat x_{i + 1}$")
        axes[0].set_title(f"T = {dt:g} s")
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
        for gain, run in runs.items():
            square = np.sum((run["memory"][0] - run["x"][0]) ** 2, axis=1)
            axes[2].semilogy(run["t"], square, color=colours[gain], linewidth=0.8)
            label = f"stationary mean, {gain}: {means[gain]:.3g}"
            axes[2].axhline(means[gain], color=colours[gain], linestyle="--", label=label)
        axes[2].set_ylim(1e-6, 20.0)
        axes[2].set_ylabel(r"$\|e\|^2$")
        axes[2].set_xlabel("time (s)")
        axes[2].set_xlim(0.0, SHOWN)
        axes[2].legend(loc="lower right", ncols=2, frameon=True)

    return draw


@scenario("fu-fig1", title="the observer at T = 0.03 s", paper="fu")
def fig1(ctx: Context) -> Outcome:
    """Paths and stationary error at T = 0.03 s; the noise floor below."""
    rows = stationary_rows(ctx, 0.03) + stationary_rows(ctx, 0.01)
    for gain in GAINS:
        floor = stationary(ctx, gain, 0.03)[0][0] / stationary(ctx, gain, 0.01)[0][0]
        rows.append(
            row(
                f"{gain} l1: E‖e‖² at T = 0.03 s over T = 0.01 s",
                floor,
                expected=1.0,
                abs=NOISE_FLOOR_ABS,
                paper="grows",
                note="a noise floor: the driving noise, not the sampling, makes the error here",
            )
        )
    return Outcome(rows, observer_figure(ctx, 0.03))


@scenario("fu-fig2", title="the observer at T = 0.1 s", paper="fu")
def fig2(ctx: Context) -> Outcome:
    """Paths and stationary error at T = 0.1 s."""
    rows = stationary_rows(ctx, 0.1)
    rows += [growth_row(ctx, gain, 0.03, 0.1) for gain in GAINS]
    return Outcome(rows, observer_figure(ctx, 0.1))


@scenario("fu-fig3", title="the observer at T = 0.3 s", paper="fu")
def fig3(ctx: Context) -> Outcome:
    """Paths and stationary error at T = 0.3 s."""
    rows = stationary_rows(ctx, 0.3)
    rows += [growth_row(ctx, gain, 0.1, 0.3) for gain in GAINS]
    for gain in GAINS:
        rows.append(
            row(
                f"T = 0.3 s, {gain} l1: runs of {RUNS} × 99 s that diverge",
                stationary(ctx, gain, 0.3)[1],
                expected=0,
            )
        )
    return Outcome(rows, observer_figure(ctx, 0.3))


# --- consistency of the EM model --------------------------------------------------------------


def one_step_error(
    ctx: Context, plant: dict[str, Any], x0: tuple[float, float], dt: float, runs: int
) -> float:
    """E||F_e - F_a||^2: one EM step of ``dt`` against the SDE on the same Brownian path."""
    ends = ctx.coupled_paths(
        {
            "plant": plant,
            "x0": x0,
            "t_end": dt,
            "coarse": 1,
            "fine": FINE,
            "method": "euler-maruyama",
            "runs": runs,
            "seed": ctx.seed,
        }
    )
    return float(np.mean(np.sum((ends["coarse"] - ends["fine"]) ** 2, axis=1)))


def leading_term(x0: tuple[float, float], dt: float) -> float:
    """sigma^2 T^3 (1 + mu^2)/3, additive noise.

    To lowest order the step misses int (x2 - x2(0)) ds = sigma int w ds in x1, of variance
    sigma^2 T^3/3, and mu times the same in x2, mu = df2/dx2 = epsilon (1 - x1^2).
    """
    mu = EPSILON * (1.0 - x0[0] ** 2)
    return SIGMA**2 * dt**3 * (1.0 + mu * mu) / 3.0


def strong_error(ctx: Context, plant: dict[str, Any], method: str, steps: int) -> float:
    """E||x - x_ref|| at t = 1 s of a scheme with ``steps`` steps."""
    ends = ctx.coupled_paths(
        {
            "plant": plant,
            "x0": X0,
            "t_end": 1.0,
            "coarse": steps,
            "fine": FINE,
            "method": method,
            "runs": STRONG_RUNS,
            "seed": ctx.seed,
        }
    )
    return float(np.mean(np.linalg.norm(ends["coarse"] - ends["fine"], axis=1)))


def log_slope(x: Iterable[float], y: Iterable[float]) -> float:
    """Least-squares slope of ln y over ln x."""
    return float(np.polyfit(np.log(list(x)), np.log(list(y)), 1)[0])


@scenario("fu-consistency", title="how far the EM model is from the SDE", paper="fu")
def consistency(ctx: Context) -> Outcome:
    """One-step consistency (Lemma 2) and strong orders."""
    one_step = {
        # From (0, 1) under multiplicative noise: at x2 = 0 its leading term vanishes.
        name: [one_step_error(ctx, plant, x0, dt, ONE_STEP_RUNS) for dt in ONE_STEP_T]
        for name, plant, x0 in (
            ("additive", PLANT, X0),
            ("multiplicative", MULTIPLICATIVE, (0.0, 1.0)),
        )
    }
    strong = {
        name: [strong_error(ctx, plant, method, steps) for steps in STRONG_STEPS]
        for name, (plant, method, _) in STRONG_ORDERS.items()
    }
    rows = [
        row(
            f"one-step E‖Fe - Fa‖² over T, {name} noise: slope",
            log_slope(ONE_STEP_T, errors),
            expected=ONE_STEP_SLOPES[name],
            abs=ONE_STEP_SLOPE_ABS,
            paper="≥ 1",
        )
        for name, errors in one_step.items()
    ]
    smallest = ONE_STEP_T[-1]
    for x0 in ONE_STEP_STATES:
        error = one_step_error(ctx, PLANT, x0, smallest, COEFFICIENT_RUNS)
        rows.append(
            row(
                f"the same over σ²T³(1 + μ²)/3 at x = ({x0[0]:g}, {x0[1]:g}), additive",
                error / leading_term(x0, smallest),
                expected=1.0,
                rel=COEFFICIENT_REL,
            )
        )
    origin = (0.0, 0.0)
    rows.append(
        row(
            f"left side of (11) at x = 0, T = {LEMMA_T:g} s, additive",
            one_step_error(ctx, PLANT, origin, LEMMA_T, COEFFICIENT_RUNS),
            expected=leading_term(origin, LEMMA_T),
            rel=COEFFICIENT_REL,
            paper="≤ 0",
            note="Lemma 2 is false here: its right side c5 T E‖x‖² is 0 at x = 0",
        )
    )
    notes = {
        "EM, multiplicative": "approached from above: the drift's own error is of order 1",
        "order 1.5 Taylor, additive": "2.0 and not 1.5, because ∂²f/∂x2² = 0",
    }
    for name, (_, _, order) in STRONG_ORDERS.items():
        rows.append(
            row(
                f"strong order: {name}",
                -log_slope(STRONG_STEPS, strong[name]),
                expected=order,
                abs=STRONG_ABS,
                note=notes.get(name, ""),
            )
        )

    def draw(fig: Figure) -> None:
        fig.set_size_inches(9.4, 4.0)
        left, right = fig.subplots(1, 2)
        dt = np.asarray(ONE_STEP_T)
        for (name, errors), colour in zip(one_step.items(), ("blue", "vermillion"), strict=True):
            slope = ONE_STEP_SLOPES[name]
            left.loglog(dt, errors, "o", color=COLOURS[colour], label=f"{name} noise")
            line = errors[-1] * (dt / dt[-1]) ** slope
            left.loglog(dt, line, color=COLOURS[colour], lw=0.9, label=f"slope {slope:g}")
        for ax in (left, right):
            ax.margins(x=0.05)
        left.set_title(r"One step of EM: $E\|F_e - F_a\|^2$")
        left.set_xlabel("T (s)")
        left.legend(loc="upper left")
        h = 1.0 / np.asarray(STRONG_STEPS)
        for (name, errors), colour in zip(
            strong.items(), ("blue", "vermillion", "green", "purple"), strict=True
        ):
            order = STRONG_ORDERS[name][2]
            right.loglog(h, errors, "o", color=COLOURS[colour], label=f"{name}: {order:g}")
            line = errors[-1] * (h / h[-1]) ** order
            right.loglog(h, line, color=COLOURS[colour], linewidth=0.9)
        right.set_xscale("log", base=2)
        right.set_title(r"Strong error $E\|x - x_{ref}\|$ at 1 s; lines: order")
        right.set_xlabel("step (s)")
        right.legend(loc="upper left", bbox_to_anchor=(0.0, 0.72))

    return Outcome(rows, draw)


# --- how large may T be? ----------------------------------------------------------------------


def error_matrix(y: Array, dt: float, gain: str) -> Array:
    """I + T A(mu(y)) for each y: shape y.shape + (2, 2)."""
    mu = EPSILON * (1.0 - y * y)
    a = np.empty((*np.shape(y), 2, 2))
    a[..., 0, 0] = -(5.0 + mu) if gain == "derived" else -(5.0 - mu)
    a[..., 0, 1] = 1.0
    a[..., 1, 0] = -(6.0 + 5.0 * mu + mu * mu)
    a[..., 1, 1] = mu
    return np.eye(2) + dt * a


def grow(e: Array, matrices: Array) -> tuple[Array, Array]:
    """Carry unit vectors e (runs, 2) through matrices (runs, steps, 2, 2).

    Returns the directions reached, and the logarithm of each step's growth (runs, steps).
    """
    sizes = np.empty(matrices.shape[1::-1])
    e1, e2 = e.T
    by_step = np.ascontiguousarray(np.moveaxis(matrices, 0, -1))  # (steps, 2, 2, runs)
    for ((m11, m12), (m21, m22)), size in zip(by_step, sizes, strict=True):
        e1, e2 = m11 * e1 + m12 * e2, m21 * e1 + m22 * e2
        size[:] = np.sqrt(e1 * e1 + e2 * e2)
        e1, e2 = e1 / size, e2 / size
    return np.column_stack([e1, e2]), np.log(sizes).T


def almost_sure_exponents(ctx: Context, gain: str) -> Array:
    """Top Lyapunov exponent lim (1/t) ln||prod (I + T A(mu(y(k))))|| [1/s] at `EXPONENT_T`.

    By Oseledets' theorem the limit is almost surely the same for every path; where it is negative,
    the homogeneous error dies out almost surely.  The products are taken along stationary paths of
    the SDE, of which every (T/PATH_DT)-th sample is y(k).
    """
    run = ctx.simulate(
        study(
            "derived",
            PATH_DT,
            PATH_TIME,
            substeps=round(PATH_DT / COARSE_PLANT_STEP),
            every=1,
            runs=PATH_RUNS,
            seed=ctx.seed,
        )
    )
    y = run["x"][:, round(T_SETTLED / PATH_DT) :, 0]
    exponents = []
    for dt in EXPONENT_T:
        matrices = error_matrix(y[:, :: round(dt / PATH_DT)], dt, gain)
        _, logs = grow(np.tile((1.0, 0.0), (PATH_RUNS, 1)), matrices)
        exponents.append(logs[:, 10:].mean() / dt)  # the first steps find the direction
    return np.asarray(exponents)


def mean_square_exponent(ctx: Context, gain: str, dt: float) -> float:
    """Moment exponent lim (1/t) ln E||prod (I + T A(mu(y(k))))||^2 [1/s], by cloning.

    E||.||^2 is carried by rare paths, which independent runs miss.  With unit vectors u, ||e||^2 is
    the product of the weights W = ||M(k+m-1) ... M(k) u||^2 over blocks of m steps, so that the
    expectation is that of a Feynman-Kac formula: let a population of pairs (x, u) move, weigh each
    by W, add ln(mean W), and draw the next population in proportion to W (systematic resampling).
    The mean of ln(mean W) over the blocks tends to m T times the exponent, from below by O(1/N).
    """
    rng = np.random.default_rng((ctx.seed, round(1e6 * dt)))
    move: dict[str, Any] = {"substeps": round(dt / COARSE_PLANT_STEP), "runs": CLONES}
    start = study("derived", PATH_DT, T_SETTLED, runs=CLONES, seed=ctx.seed)
    start["substeps"] = round(PATH_DT / COARSE_PLANT_STEP)
    x: Array = ctx.simulate(start)["final_x"]
    u = np.tile((1.0, 0.0), (CLONES, 1))
    growth = []
    for block in range(CLONE_BLOCKS):
        # A seed of its own for every block, so that clones part and noise is never used twice.
        seed = int(np.random.default_rng((ctx.seed, 1, block)).integers(2**63))
        run = ctx.simulate(
            study(gain, dt, CLONE_BLOCK * dt, **move, every=1, seed=seed, x0=x, memory0=x)
        )
        u, logs = grow(u, error_matrix(run["x"][:, :-1, 0], dt, gain))
        weight = np.exp(2.0 * logs.sum(axis=1))
        growth.append(np.log(weight.mean()))
        share = np.cumsum(weight) / weight.sum()
        place = (rng.random() + np.arange(CLONES)) / CLONES
        chosen = np.minimum(np.searchsorted(share, place), CLONES - 1)
        x, u = run["final_x"][chosen], u[chosen]
    return float(np.mean(growth[CLONE_BURN_IN:])) / (CLONE_BLOCK * dt)


def first_zero(dt: Array, exponents: Array) -> float:
    """Where the exponent first turns positive: cubic through the four nearest points."""
    upward = np.flatnonzero((exponents[:-1] < 0.0) & (exponents[1:] >= 0.0))
    if upward.size == 0:
        return float("nan")
    i = int(upward[0])
    first = min(max(i - 1, 0), len(dt) - 4)
    near = slice(first, first + 4)
    roots = np.roots(np.polyfit(dt[near], exponents[near], 3))
    real = roots[np.abs(roots.imag) < 1e-9].real
    inside = real[(real >= dt[i]) & (real <= dt[i + 1])]
    return float(inside[0]) if inside.size else float("nan")


def recursion_error(ctx: Context, gain: str) -> float:
    """Largest relative difference of the observer's error recursion from I + T A(mu(y(k))).

    The difference of two estimates on the same record obeys it without w(k).
    """
    dt, t_end = 0.1, 2.0
    runs = [
        ctx.simulate(study(gain, dt, t_end, every=1, seed=ctx.seed, memory0=m))
        for m in (X_HAT0, (1.5, -0.5))
    ]
    d = runs[1]["memory"][0] - runs[0]["memory"][0]
    matrices = error_matrix(runs[0]["y"][0, :-1, 0], dt, gain)
    defect = d[1:] - np.einsum("kij,kj->ki", matrices, d[:-1])
    return float(np.max(np.linalg.norm(defect, axis=1) / np.linalg.norm(d[:-1], axis=1)))


def em_model(ctx: Context) -> dict[str, Any]:
    """The EM model (19) itself in the SDE's place, with the observer (5), at T = 0.3 s."""
    spec = study("derived", EM_T, T_END, runs=EM_RUNS, seed=ctx.seed)
    return ctx.simulate(spec | {"plant_method": "euler-maruyama", "substeps": 1})


@scenario("fu-limits", title="the largest stable sampling period", paper="fu")
def limits(ctx: Context) -> Outcome:
    """Error recursion, stability almost surely and in mean square, and the EM model itself."""
    y = np.linspace(-3.0, 3.0, 61)
    rows = [
        row(
            f"{gain} l1: observer's error recursion against I + T A(μ)",
            recursion_error(ctx, gain),
            at_most=1e-10,
            note="l2 is right as printed: the recursion is exactly linear"
            if gain == "printed"
            else "",
        )
        for gain in GAINS
    ]
    spectra = {
        gain: np.sort(np.linalg.eigvals(error_matrix(y, 1.0, gain) - np.eye(2)).real, axis=1)
        for gain in GAINS
    }
    rows += [
        row(
            "derived l1: distance of the spectrum of A(μ) from {-2, -3}, |y| ≤ 3",
            np.abs(spectra["derived"] - np.array([-3.0, -2.0])).max(),
            at_most=1e-9,
            note=L1_NOTE,
        ),
        row(
            "printed l1: the same distance",
            np.abs(spectra["printed"] - np.array([-3.0, -2.0])).max(),
            at_least=0.1,
            note="moves with y",
        ),
    ]
    sure = {gain: almost_sure_exponents(ctx, gain) for gain in GAINS}
    square = {
        gain: np.array([mean_square_exponent(ctx, gain, dt) for dt in MOMENT_T[gain]])
        for gain in GAINS
    }
    for gain in GAINS:
        rows.append(
            row(
                f"{gain} l1: largest stable T, almost surely (s)",
                first_zero(EXPONENT_T, sure[gain]),
                expected=ALMOST_SURE[gain],
                abs=LIMIT_ABS,
            )
        )
        rows.append(
            row(
                f"{gain} l1: largest stable T, in mean square (s)",
                first_zero(np.asarray(MOMENT_T[gain]), square[gain]),
                expected=MEAN_SQUARE[gain],
                abs=LIMIT_ABS,
            )
        )
    diverged_at = em_model(ctx)["diverged_at"]
    diverged = np.sort(diverged_at[diverged_at >= 0]) * EM_T
    rows += [
        row(
            f"EM model at T = {EM_T:g} s: runs of {EM_OF} that diverge within 99 s",
            EM_OF * diverged.size / EM_RUNS,
            expected=float(EM_DIVERGED),
            abs=float(EM_ABS),
            paper="bounded",
            note="the observer works on the SDE, yet Theorem 1's hypothesis (a bounded error on "
            "the EM model) fails: the model itself diverges",
        ),
        row(
            f"SDE at T = {EM_T:g} s: runs of {RUNS} that diverge within 99 s",
            stationary(ctx, "derived", EM_T)[1],
            expected=0,
        ),
    ]

    def draw(fig: Figure) -> None:
        fig.set_size_inches(9.4, 4.0)
        left, right = fig.subplots(1, 2)
        for gain, colour in (("printed", COLOURS["blue"]), ("derived", COLOURS["vermillion"])):
            left.plot(EXPONENT_T, sure[gain], color=colour, label=f"{gain}, almost surely")
            left.plot(
                MOMENT_T[gain],
                0.5 * square[gain],
                "o--",
                color=colour,
                markersize=4,
                linewidth=0.9,
                label=f"{gain}, mean square (½)",
            )
        left.axhline(0.0, color=COLOURS["grey"], linewidth=0.8)
        left.set_ylim(-4.5, 3.0)
        left.set_title("Exponents of the error")
        left.set_xlabel("T (s)")
        left.set_ylabel("exponent (1/s)")
        left.legend(loc="upper left", fontsize=8)
        kept = 1.0 - np.arange(diverged.size + 1) / EM_RUNS
        time = np.concatenate(([0.0], diverged))
        every = max(1, time.size // 2_000)
        right.plot(time[::every], kept[::every], color=COLOURS["vermillion"], label="EM model (19)")
        right.plot([0.0, T_END], [1.0, 1.0], color=COLOURS["black"], label="SDE (18)")
        right.set_xlim(0.0, T_END)
        right.set_ylim(0.0, 1.1)
        right.set_title(f"Share of runs still bounded, T = {EM_T:g} s")
        right.set_xlabel("time (s)")
        right.legend(loc="lower left")

    return Outcome(rows, draw)
