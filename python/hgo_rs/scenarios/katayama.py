"""Katayama: the high-gain reduced-order observer (22) on a ship with sampled position.

The observer knows the ship's nominal dynamics; the true one carries the uncertainty delta_bar and
the disturbance w. It closes the step k -> k+1 with the sample y(k+1): the error at t is
e = z(t) - z_hat(t), without delay. z_hat(0) = 0.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hgo_rs.plots import COLOURS
from hgo_rs.reference import integrate
from hgo_rs.reference.models import Ship
from hgo_rs.scenarios.base import BACKENDS, Context, Outcome, Row, row, scenario

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

# --- the experiment (section III) --------------------------------------------------------------

H_BAR = (0.1, 0.2, 0.2)
POSITION = (0.0, 10.0, np.pi / 6)  # x_c(0)
VELOCITY = (0.5, -0.5, -0.5)  # z_c(0)
TARGET = (0.8, 0.0, 0.0)  # z_c as t -> infinity, delta_bar = w = 0
W = (0.4, 0.2, 0.1)
CALM = (0.0, 0.0, 0.0)

T_END = 20.0  # [s]
RMS_FROM = 5.0  # [s]: the RMS is taken over [5, 20) s
PLANT_STEP = 0.01  # [s], RK4
SETTLED_FROM, SETTLED_TO = 120.0, 150.0  # [s]

# --- what a correct implementation gives --------------------------------------------------------

RMS = {  # (T, epsilon): (delta_bar = 0, delta_bar = 0.5), RMS of z - z_hat over [5, 20) s, w = 0
    (0.1, 1.0): ((0.16195, 0.07768, 0.07184), (0.19775, 0.05974, 0.02543)),
    (0.1, 0.1): ((0.00027, 0.00148, 0.00086), (0.00037, 0.00209, 0.00189)),
    (0.1, 0.05): ((0.00011, 0.00161, 0.00072), (0.00012, 0.00154, 0.00051)),
    (0.01, 1.0): ((0.16965, 0.07524, 0.07481), (0.20457, 0.05958, 0.02679)),
    (0.01, 0.1): ((0.00058, 0.00014, 0.00008), (0.00073, 0.00263, 0.00210)),
    (0.01, 0.01): ((0.00001, 0.00017, 0.00005), (0.00001, 0.00025, 0.00012)),
}
DELTAS = (0.0, 0.5)
RMS_DIGITS = 5e-6  # half a unit of the fifth decimal
PEAKING = 1.02  # max |e| / |e(0)|, w = 0
SETTLED_REL = 1e-4  # of e_inf, from 120 s on
FIRST_Z1 = 0.5019  # z1 a fifth of a period (2 ms) after the start, T = 0.01
A5_EPSILON = 0.01
A5_STABLE, A5_UNSTABLE = 0.099, 0.101  # [s], beside T = 10 epsilon
STRAIGHT = {  # at the controller's target, with the estimates of z2 and z3 off
    "x0": [0.0, 0.0, 0.0, *TARGET],
    "memory0": [0.8, 0.5, 0.5] + [0.0] * 7,
}

NOTE_STATE = "z1 rises from its start; 0.5019 is its value after the first 2 ms"
NOTE_SAMPLING = "what is left is the Euler model's error at T = 0.1 s, which ε does not lower"
NOTE_CONTROLLER = "printed z̄3 and x̃3; what cancels is k z̃3 and k (z3 + Γ v)"


def settled_error(epsilon: float, delta: float, w: Sequence[float] = W) -> Array:
    """e_inf = (epsilon/h_bar_i) w_i/(1 + delta_bar): where Psi meets f2 at rest."""
    return epsilon / np.array(H_BAR) * np.array(w) / (1.0 + delta)


def spec(
    period: float,
    epsilon: float,
    delta: float = 0.0,
    w: Sequence[float] = CALM,
    t_end: float = T_END,
    every: int = 1,
    windows: Sequence[Sequence[float]] = ((RMS_FROM, T_END),),
) -> dict[str, Any]:
    """Ship, controller (21) and observer (22), sampled every ``period`` [s]; ``windows`` in s."""
    return {
        "plant": {"kind": "ship", "delta": delta, "w": list(w)},
        "observer": {
            "kind": "reduced-order",
            "model": {"kind": "ship"},
            "h_bar": list(H_BAR),
            "epsilon": epsilon,
        },
        "plant_method": "rk4",
        "substeps": max(1, round(period / PLANT_STEP)),
        "x0": [*POSITION, *VELOCITY],
        "memory0": [0.0] * 10,
        "steps": round(t_end / period),
        "schedule": {"kind": "fixed", "dt": period},
        "windows": [[round(a / period), round(b / period)] for a, b in windows],
        "every": every,
    }


def rms_rows(ctx: Context, period: float, epsilon: float) -> list[Row]:
    """RMS of z - z_hat beside the table, both delta_bar."""
    rows = []
    for delta, expected in zip(DELTAS, RMS[period, epsilon], strict=True):
        rms = ctx.simulate(spec(period, epsilon, delta))["rms"][0, 0]
        rows += [
            row(
                f"RMS z{i + 1} − ẑ{i + 1}, T = {period:g}, ε = {epsilon:g}, δ̄ = {delta:g}",
                rms[i],
                expected=expected[i],
                abs=RMS_DIGITS,
            )
            for i in range(3)
        ]
    return rows


def error(result: dict[str, Any]) -> Array:
    """z - z_hat over the recorded frames, (frames, 3)."""
    return np.asarray(result["x"][0, :, 3:] - result["memory"][0, :, :3])


# --- figures 1 to 4 ---------------------------------------------------------------------------


@scenario(
    "katayama-fig1", title="Velocity and estimate without and with uncertainty", paper="katayama"
)
def fig1(ctx: Context) -> Outcome:
    runs = [ctx.simulate(spec(0.1, 1.0, delta)) for delta in DELTAS]
    rest = ctx.simulate(spec(0.1, 1.0, t_end=SETTLED_TO))
    first = spec(0.01, 1.0, t_end=0.01, windows=()) | {
        "plant_schedule": {"kind": "fixed", "dt": 0.002}
    }
    rows = rms_rows(ctx, 0.1, 1.0)
    rows += [
        row(f"z{i + 1} at {SETTLED_TO:g} s, δ̄ = 0", value, expected=target, abs=1e-9, paper=target)
        for i, (value, target) in enumerate(zip(rest["x"][0, -1, 3:], TARGET, strict=True))
    ]
    rows += [
        row(
            "least z1, t ≥ 0, δ̄ = 0",
            rest["x"][0, :, 3].min(),
            expected=VELOCITY[0],
            abs=1e-12,
            paper="> 0",
            note=NOTE_STATE,
        ),
        row(
            "z1 after 2 ms, T = 0.01, δ̄ = 0",
            ctx.simulate(first)["final_x"][0, 3],
            expected=FIRST_Z1,
            abs=5e-5,
        ),
    ]

    def draw(fig: Figure) -> None:
        axes = _panels(fig, "T = 0.1 s, ε = 1")
        for run, delta, colour in zip(runs, DELTAS, ("black", "blue"), strict=True):
            _lines(axes, run, run["x"][0, :, 3:], colour, "-", f"z, δ̄ = {delta:g}")
            _lines(axes, run, run["memory"][0, :, :3], colour, "--", f"ẑ, δ̄ = {delta:g}")
        _finish(axes)

    return Outcome(rows, draw)


@scenario("katayama-fig2", title="Three gains at T = 0.1 s, with uncertainty", paper="katayama")
def fig2(ctx: Context) -> Outcome:
    rows = rms_rows(ctx, 0.1, 0.1) + rms_rows(ctx, 0.1, 0.05)
    coarse, fine = (ctx.simulate(spec(0.1, eps))["rms"][0, 0, 1] for eps in (0.1, 0.05))
    rows.append(
        row(
            "RMS z2 − ẑ2 at ε = 0.05 over that at 0.1, δ̄ = 0",
            fine / coarse,
            expected=RMS[0.1, 0.05][0][1] / RMS[0.1, 0.1][0][1],
            rel=0.01,
            paper="< 1",
            note=NOTE_SAMPLING,
        )
    )
    return Outcome(rows, _three_gains(ctx, 0.1, (1.0, 0.1, 0.05), CALM))


@scenario("katayama-fig3", title="Three gains at T = 0.01 s, with uncertainty", paper="katayama")
def fig3(ctx: Context) -> Outcome:
    epsilons = (1.0, 0.1, 0.01)
    rows = [r for epsilon in epsilons for r in rms_rows(ctx, 0.01, epsilon)]
    return Outcome(rows, _three_gains(ctx, 0.01, epsilons, CALM))


@scenario("katayama-fig4", title="Three gains with uncertainty and disturbance", paper="katayama")
def fig4(ctx: Context) -> Outcome:
    epsilons = (1.0, 0.1, 0.01)
    rows = []
    for epsilon in epsilons:
        values, deviation = _settled(ctx, 0.01, epsilon, 0.5)
        rows += [
            row(f"settled z{i + 1} − ẑ{i + 1}, ε = {epsilon:g}", value, expected=e, rel=SETTLED_REL)
            for i, (value, e) in enumerate(zip(values, settled_error(epsilon, 0.5), strict=True))
        ]
        rows.append(
            row(
                f"largest |e/e∞ − 1| from {SETTLED_FROM:g} s, ε = {epsilon:g}",
                deviation,
                at_most=SETTLED_REL,
            )
        )
    return Outcome(rows, _three_gains(ctx, 0.01, epsilons, W))


def _settled(ctx: Context, period: float, epsilon: float, delta: float) -> tuple[Array, float]:
    """Mean of e over [120, 150) s, and the largest relative distance from e_inf there."""
    late = (SETTLED_FROM, SETTLED_TO)
    run = ctx.simulate(spec(period, epsilon, delta, W, SETTLED_TO, every=1, windows=(late,)))
    ratio = error(run)[run["t"] >= SETTLED_FROM] / settled_error(epsilon, delta)
    return -run["mean"][0, 0], float(np.abs(ratio - 1.0).max())


# --- limits -----------------------------------------------------------------------------------


class PrintedController(Ship):
    """The ship under (21) and kappa as printed: -k z3_bar and -k x3_tilde."""

    def control(self, x: Array, dt: float, t: float) -> Array | None:
        u = super().control(x, dt, t)
        assert u is not None
        k = 0.3 / (dt + 0.3)
        gamma = 6.0 / (36.0 + x[1] * x[1])
        v = x[3] * np.sin(x[2]) + x[4] * np.cos(x[2])
        x3_tilde = x[2] - np.arctan(-x[1] / 6.0)
        z3_bar = -k * x3_tilde - gamma * v
        lambda21, _, lambda31, _ = self.rudder(x[3:])
        xi = lambda31 + lambda21 * gamma * np.cos(x[2])
        # -k z3_tilde -> -k z3_bar, and -k (z3 + Gamma v) -> -k x3_tilde
        u[1] += k * (x[5] - 2.0 * z3_bar + x[5] + gamma * v - x3_tilde) / xi
        return u


def _closed_loop(ships: Sequence[Ship], period: float, t_end: float) -> Array:
    """z of each ship at the samples, (samples, 3, ships), by RK4 with the control held."""
    plant = Ship()  # they differ in their controllers
    x = np.tile(np.array([*POSITION, *VELOCITY])[:, None], len(ships))
    substeps = round(period / PLANT_STEP)
    z = []
    for k in range(round(t_end / period)):
        start = k * period
        controls = [ship.control(x[:, i : i + 1], period, start) for i, ship in enumerate(ships)]
        u = np.concatenate([control for control in controls if control is not None], axis=1)

        def rate(t: float, state: Array, u: Array | None = u) -> Array:
            return plant.drift(state, u, t)

        for i in range(substeps):
            x = integrate.rk4(rate, start + i * PLANT_STEP, x, PLANT_STEP)
        z.append(x[3:])
    return np.array(z)


def _growth(run: dict[str, Any], start: int, stop: int) -> float:
    """Factor by which |e2| changes per sample, k = start .. stop."""
    e2 = np.abs(error(run)[:, 1])
    return float((e2[stop] / e2[start]) ** (1.0 / (stop - start)))


@scenario(
    "katayama-limits", title="Step limit A5, no peaking, and where A1 fails", paper="katayama"
)
def limits(ctx: Context) -> Outcome:
    from hgo_rs.design import step_limit

    rows = []
    for epsilon in (1.0, 0.1, A5_EPSILON):
        observer = spec(0.1, epsilon)["observer"]
        limit = step_limit(observer).dt
        rows.append(
            row(f"largest T, ε = {epsilon:g} [s] (A5)", limit, expected=10 * epsilon, rel=1e-12)
        )

    # On the straight course the Euler model is exact: e2 is multiplied by 1 - T h2 each sample.
    below, above = (
        ctx.simulate(spec(T, A5_EPSILON, t_end=1000 * T, windows=()) | STRAIGHT)
        for T in (A5_STABLE, A5_UNSTABLE)
    )
    factors = [abs(1.0 - T * max(H_BAR) / A5_EPSILON) for T in (A5_STABLE, A5_UNSTABLE)]
    near, far = (
        ctx.simulate(spec(T, A5_EPSILON, t_end=200.0, windows=())) for T in (A5_STABLE, A5_UNSTABLE)
    )
    rows += [
        row(
            f"|e| at 200 s, T = {A5_STABLE:g}, ε = {A5_EPSILON:g}",
            np.abs(error(near)[-1]).max(),
            at_most=1e-9,
        ),
        row(
            f"growth of e2 per sample, T = {A5_STABLE:g}, ε = {A5_EPSILON:g}",
            _growth(below, 10, 800),
            expected=factors[0],
            rel=1e-6,
        ),
        row(
            f"growth of e2 per sample, T = {A5_UNSTABLE:g}, ε = {A5_EPSILON:g}",
            _growth(above, 10, 800),
            expected=factors[1],
            rel=1e-6,
        ),
        row(
            f"diverges within 200 s, T = {A5_UNSTABLE:g}, ε = {A5_EPSILON:g}",
            far["diverged_at"][0] >= 0,
            expected=True,
        ),
    ]

    ratios = []
    for period, epsilon in RMS:
        for delta in DELTAS:
            size = np.linalg.norm(error(ctx.simulate(spec(period, epsilon, delta))), axis=1)
            ratios.append(size.max() / size[0])
    rows.append(
        row("max ‖e‖/‖e(0)‖, all twelve runs, w = 0", max(ratios), at_most=PEAKING, paper="no peak")
    )

    for epsilon, delta in ((0.1, 0.0), (0.1, 0.5), (0.05, 0.0), (0.05, 0.5)):
        _, deviation = _settled(ctx, 0.1, epsilon, delta)
        rows.append(
            row(
                f"largest |e/e∞ − 1| from {SETTLED_FROM:g} s, T = 0.1, ε = {epsilon:g}, "
                f"δ̄ = {delta:g}",
                deviation,
                at_most=SETTLED_REL,
            )
        )

    late = _closed_loop((PrintedController(), Ship()), 0.1, 60.0)[-300:]
    printed, exact = late[..., 0], late[..., 1]
    rows += [
        row(
            "(21) as printed: max |z2| over the last 30 of 60 s",
            np.abs(printed[:, 1]).max(),
            at_least=0.1,
            paper=0.0,
            note=NOTE_CONTROLLER,
        ),
        row(
            "(21) as it cancels: max |z2| over the last 30 of 60 s",
            np.abs(exact[:, 1]).max(),
            at_most=0.01,
            paper=0.0,
        ),
    ]
    rows += _a1_rows(ctx)

    def draw(fig: Figure) -> None:
        fig.set_size_inches(9.0, 3.8)
        left, right = fig.subplots(1, 2)
        for run, T, colour in ((below, A5_STABLE, "blue"), (above, A5_UNSTABLE, "red")):
            e2 = np.maximum(np.abs(error(run)[:, 1]), 1e-18)
            left.semilogy(run["t"][::5], e2[::5], color=_INK[colour], label=f"T = {T:g} s")
        left.set(
            title=f"Step limit at ε = {A5_EPSILON:g}", xlabel="time (s)", ylabel="|z₂ − ẑ₂| (m/s)"
        )
        left.legend(loc="upper left")
        styles = {0.1: "o--", 0.01: "s-"}
        for period, style in styles.items():
            epsilons = [eps for T, eps in RMS if period == T]
            rms = [ctx.simulate(spec(period, eps, DELTAS[1]))["rms"][0, 0] for eps in epsilons]
            for i, colour in enumerate(("black", "blue", "red")):
                right.loglog(
                    epsilons,
                    [r[i] for r in rms],
                    style,
                    color=_INK[colour],
                    markersize=4,
                    label=f"z{_SUB[i]}, T = {period:g} s",
                )
        right.set(title="RMS error over [5, 20) s, δ̄ = 0.5", xlabel="ε", ylabel="RMS z − ẑ")
        right.margins(x=0.05)
        right.legend(fontsize=8)

    return Outcome(rows, draw)


def _a1_rows(ctx: Context) -> list[Row]:
    """lambda22 contains atan(s/z1): no value at z1 = s = 0, and the law must say so."""
    observer = importlib.import_module(BACKENDS[ctx.backend]).Observer(spec(0.1, 0.1)["observer"])
    y, u = np.array([0.0, 1.0, 0.1]), np.zeros(2)
    memory, _ = observer.step(np.zeros(10), y, u, 0.0, 0.1)
    memory, status = observer.step(memory, y, u, 0.1, 0.1)  # y(k+1) = y(k): Psi = 0
    still = spec(0.1, 0.1, windows=()) | {"x0": [*POSITION, 0.0, 0.0, 0.0], "every": 0}
    return [
        row(
            "observer at Ψ = 0 reports",
            {0: "updated", 1: "predicted", 2: "model undefined"}[int(status)],
            expected="model undefined",
            paper="A1 holds",
            note="λ22 contains atan(0/0) at z1 = z2 − 1.18 z3 = 0: ẑ is held and the step says so",
        ),
        row("ẑ after it is finite", np.all(np.isfinite(memory[:3])), expected=True),
        row(
            "ship at rest (z = 0): run reported as failed",
            ctx.simulate(still)["diverged_at"][0] >= 0,
            expected=True,
            paper="A1 holds",
            note="(20) and (21) have no value at z = 0",
        ),
    ]


# --- drawing ----------------------------------------------------------------------------------

_INK = {"black": COLOURS["black"], "blue": COLOURS["blue"], "red": COLOURS["vermillion"]}
_SUB = "₁₂₃"
_NAMES = ("surge z₁ (m/s)", "sway z₂ (m/s)", "yaw rate z₃ (rad/s)")


def _panels(fig: Figure, title: str) -> list[Any]:
    fig.set_size_inches(7.2, 6.0)
    axes = list(fig.subplots(3, 1, sharex=True))
    for ax, name in zip(axes, _NAMES, strict=True):
        ax.set_ylabel(name)
    axes[0].set_title(title)
    axes[-1].set_xlabel("time (s)")
    return axes


def _lines(
    axes: Sequence[Any], run: dict[str, Any], values: Array, colour: str, style: str, label: str
) -> None:
    step = max(1, len(run["t"]) // 500)
    width = 2.4 if label == "z" else 1.4  # the truth shows behind estimates that lie on it
    for i, ax in enumerate(axes):
        ax.plot(
            run["t"][::step],
            values[::step, i],
            style,
            color=_INK[colour],
            label=label,
            linewidth=width,
        )


def _finish(axes: Sequence[Any]) -> None:
    axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.1)


def _three_gains(ctx: Context, period: float, epsilons: Sequence[float], w: Sequence[float]) -> Any:
    """The drawing of figures 2 to 4: z black, z_hat black broken, blue, red."""
    runs = [ctx.simulate(spec(period, epsilon, 0.5, w)) for epsilon in epsilons]
    wind = ", with w" if any(w) else ""

    def draw(fig: Figure) -> None:
        axes = _panels(fig, f"T = {period:g} s, δ̄ = 0.5{wind}")
        _lines(axes, runs[0], runs[0]["x"][0, :, 3:], "black", "-", "z")
        inks = (("black", "--"), ("blue", "-"), ("red", "-"))
        for run, epsilon, (colour, style) in zip(runs, epsilons, inks, strict=True):
            _lines(axes, run, run["memory"][0, :, :3], colour, style, f"ẑ, ε = {epsilon:g}")
        _finish(axes)

    return draw
