"""Velocity and load of a real axis from its position: observers beside what else one would take.

Usage: python examples/emps.py DATA_EMPS.mat [DATA_EMPS_PULSES.mat] [--figure FILE]

The record is the EMPS benchmark (Janot, Gautier, Brunot): a motor's position and voltage, 25 s at
1 kHz. Velocity is not measured; the reference is a zero-phase filter, which sees the future.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal
from scipy.io import loadmat
from scipy.optimize import minimize_scalar

import hgo_rs as hgo
from hgo_rs.plots import COLOURS, new_figure, save, style

# M q'' = gtau u - Fv q' - Fc sign(q') - offset, sign(v) smoothed as tanh(v/vs); the benchmark's
AXIS = {
    "M": 95.1089,
    "Fv": 203.5034,
    "Fc": 20.3935,
    "offset": -3.1648,
    "gtau": 35.15,
    "vs": 1e-3,
}

# White model error makes Butterworth's poles best; friction errs for longer than that, and asks
# for less damping, or for a state of its own that follows slowly.
SIXTY = -0.5 + 0.75**0.5 * 1j  # damping 1/2
DAMPING_HALF = [SIXTY, SIXTY.conjugate()]
WITH_LOAD = [*DAMPING_HALF, -0.1]
BUTTERWORTH = [*DAMPING_HALF, -1.0]  # of order 3

SKIP = 1.0  # s, not judged


@dataclass(frozen=True)
class Setting:
    """A record as the observers see it, and the reference."""

    name: str
    t: np.ndarray
    y: np.ndarray
    u: np.ndarray
    reference: np.ndarray

    @property
    def dt(self) -> float:
        """Sampling period [s]."""
        return float(np.median(np.diff(self.t)))

    def error(self, velocity: Any) -> float:
        """RMS difference from the reference [m/s], after SKIP."""
        late = self.t - self.t[0] >= SKIP
        with np.errstate(all="ignore"):
            rms = float(np.sqrt(np.mean((np.asarray(velocity) - self.reference)[late] ** 2)))
        return rms if np.isfinite(rms) else np.inf


def settings(path: Path) -> list[Setting]:
    """The record as it is; every tenth sample; both rounded to 10 um but the first."""
    record = loadmat(path)
    t, q, u = (record[name].ravel() for name in ("t", "qm", "vir"))
    b, a = signal.butter(4, 100.0, fs=1.0 / np.median(np.diff(t)))
    reference = signal.filtfilt(b, a, np.gradient(signal.filtfilt(b, a, q), t))
    coarse = np.round(q / 1e-5) * 1e-5
    tenth = slice(None, None, 10)
    return [
        Setting("1 kHz", t, q, u, reference),
        Setting("100 Hz, 10 um", t[tenth], coarse[tenth], u[tenth], reference[tenth]),
        Setting("1 kHz, 10 um", t, coarse, u, reference),
    ]


# --- methods: setting -> (knob -> velocity), and the knob's range --------------------------------

Estimate = Callable[[float], Any]


KNOWN = "(gtau*u - Fv*v - Fc*tanh(v/vs) - offset)/M"
MODELS = {
    2: hgo.Model(states=["q", "v"], inputs=["u"], parameters=AXIS, phi=KNOWN),
    # the load as acceleration d: v' = d + ..., d' = 0
    3: hgo.Model(states=["q", "v", "d"], inputs=["u"], parameters=AXIS, f=["0", KNOWN, "0"]),
}


def observer(n: int, model: bool, poles: Any, timing: str = "current") -> hgo.tuning.Build:
    """The standard observer of the axis, with its model and, for n = 3, a load as last state."""
    method = "zoh" if timing == "current" else "euler"
    known = MODELS[n] if model else None

    def build(ell: float) -> hgo.Observer:
        return hgo.StandardObserver(
            n, ell, poles=poles, model=known, method=method, timing=timing, allow_unstable=True
        )

    return build


def low_power(ell: float) -> hgo.Observer:
    """A differentiator of the low-power law."""
    return hgo.LowPowerObserver(3, ell, method="zoh", timing="current", allow_unstable=True)


def adaptive(root_p2: float) -> hgo.Observer:
    """A differentiator whose gain rises while its output error exceeds sqrt(p2)."""
    gain = hgo.AdaptiveGain(p1=100.0 / root_p2**2, p2=root_p2**2, b=0.1)
    paper = {"method": "euler", "timing": "predictor"}
    return hgo.StandardObserver(3, gain, k=[2.0, 2.0, 1.0], allow_unstable=True, **paper)


OURS: dict[str, hgo.tuning.Build] = {
    "standard n = 2, model": observer(2, True, DAMPING_HALF),
    "standard n = 3, model and load": observer(3, True, WITH_LOAD),
    "standard n = 2, model, Euler, predictor": observer(2, True, [-1.0, -2.0], "predictor"),
    "standard n = 3, no model": observer(3, False, BUTTERWORTH),
    "low-power n = 3, no model": low_power,
}


def run(build: hgo.tuning.Build, setting: Setting) -> Estimate:
    """gain -> velocity."""

    def velocity(ell: float) -> Any:
        made = build(ell)
        start = np.zeros(made.n)
        start[0] = setting.y[0]
        u = setting.u if made.n_u else None
        try:
            run = made.run(setting.t, setting.y, u, x_hat0=start)
        except hgo.HgoError:  # beyond the step limit, or diverged
            return np.full(setting.y.size, np.nan)
        return run.x_hat[:, 1]

    return velocity


def savitzky_golay(setting: Setting, order: int) -> Estimate:
    """window length -> slope at its last sample of the polynomial fitted to it."""

    def velocity(length: float) -> Any:
        points = max(round(length), order + 1)
        weights = signal.savgol_coeffs(points, order, 1, setting.dt, pos=points - 1)
        return np.convolve(setting.y, weights)[: setting.y.size]

    return velocity


def low_passed_difference(setting: Setting, order: int) -> Estimate:
    """cutoff as part of the Nyquist frequency -> backward difference, low-passed."""

    def velocity(cutoff: float) -> Any:
        return signal.lfilter(
            *signal.butter(order, cutoff), np.diff(setting.y, prepend=setting.y[0]) / setting.dt
        )

    return velocity


def extended_kalman(setting: Setting) -> Estimate:
    """ratio of the densities of model error and noise -> filterpy's EKF on the same model."""
    from filterpy.kalman import ExtendedKalmanFilter

    p, dt = AXIS, setting.dt
    measure = np.array([[1.0, 0.0]])

    class Filter(ExtendedKalmanFilter):
        def predict_x(self, u: Any = 0) -> None:
            q, v = self.x
            bend = np.tanh(v / p["vs"])
            a = (p["gtau"] * u - p["Fv"] * v - p["Fc"] * bend - p["offset"]) / p["M"]
            slope = -(p["Fv"] + p["Fc"] / p["vs"] * (1.0 - bend * bend)) / p["M"]
            self.x = np.array([q + dt * v + 0.5 * dt * dt * a, v + dt * a])
            self.F = np.array([[1.0, dt + 0.5 * dt * dt * slope], [0.0, 1.0 + dt * slope]])

    def velocity(ratio: float) -> Any:
        ekf = Filter(2, 1)
        ekf.x, ekf.P = np.array([setting.y[0], 0.0]), np.diag([1.0, ratio])
        ekf.R = np.eye(1)
        ekf.Q = ratio * np.array([[dt**3 / 3.0, dt**2 / 2.0], [dt**2 / 2.0, dt]])
        out = np.empty(setting.y.size)
        held = None
        for k, (y, u) in enumerate(zip(setting.y, setting.u, strict=True)):
            if held is not None:
                ekf.predict(held)
            ekf.update(np.array([y]), lambda _: measure, lambda x: x[:1])
            out[k], held = ekf.x[1], u
        return out

    return velocity


# --- best settings --------------------------------------------------------------------------------


def best(error: Callable[[float], float], low: float, high: float, points: int = 25) -> float:
    """The least error over a knob: a grid, then golden section."""
    grid = np.geomspace(low, high, points)
    errors = [error(knob) for knob in grid.tolist()]
    k = int(np.argmin(errors))
    ends = np.log(grid[[max(k - 1, 0), min(k + 1, points - 1)]])
    found = minimize_scalar(
        lambda x: error(float(np.exp(x))), bounds=ends, method="bounded", options={"maxiter": 10}
    )
    return float(min(found.fun, errors[k]))


def rows(setting: Setting) -> Iterator[tuple[str, float, float]]:
    """(method, error at its best setting, error at the gain that `tune` finds or NaN) [m/s]."""
    nyquist = 0.5 / setting.dt

    def least(estimate: Estimate, low: float, high: float, points: int = 25) -> float:
        return best(lambda knob: setting.error(estimate(knob)), low, high, points)

    for name, build in OURS.items():
        estimate = run(build, setting)
        log = (setting.t, setting.y, setting.u)
        blind = log[:2] if "no model" in name else log
        chosen = hgo.tune(build, blind, state=2, skip=SKIP)
        tuned = setting.error(estimate(chosen.ell))
        yield name, least(estimate, 0.005 / setting.dt, 5.0 / setting.dt), tuned
    yield "adaptive n = 3, no model, predictor", least(run(adaptive, setting), 1e-8, 1e-3), np.nan
    fits = [least(savitzky_golay(setting, order), order + 1, 300) for order in (1, 2, 3)]
    yield "Savitzky-Golay, causal", min(fits), np.nan
    filters = [least(low_passed_difference(setting, order), 1e-3, 0.999) for order in (1, 2)]
    yield "backward difference, low-pass", min(filters), np.nan
    try:
        estimate = extended_kalman(setting)
    except ImportError:
        return
    low, high = 1e3 * nyquist, 1e8 * nyquist
    yield "extended Kalman filter (filterpy), model", least(estimate, low, high, 11), np.nan


def mean_input(setting: Setting) -> Setting:
    """The same, with the mean of the inputs at both ends of a step, known when it has ended."""
    return replace(setting, u=np.append(0.5 * (setting.u[1:] + setting.u[:-1]), setting.u[-1]))


# --- the load -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Load:
    """The load found on the pulses record [N], and the known one."""

    t: np.ndarray
    known: np.ndarray
    found: np.ndarray
    ell: float

    @property
    def step(self) -> float:
        """Height of a pulse [N]."""
        return float(np.ptp(self.known))

    @property
    def rms(self) -> float:
        """RMS difference from 0.2 s after each step of the load to the next one [N]."""
        since = np.zeros(self.t.size)
        for k in range(1, self.t.size):
            same = self.known[k] == self.known[k - 1]
            since[k] = since[k - 1] + self.t[k] - self.t[k - 1] if same else 0.0
        plateau = since >= 0.2
        return float(np.sqrt(np.mean((self.found - self.known)[plateau] ** 2)))


def load(path: Path, poles: Any = BUTTERWORTH, ell: float | None = None) -> Load:
    """The load pulses, of which the observer is told nothing."""
    record = loadmat(path)
    t, q, volts, pulses = (record[name].ravel() for name in ("t", "qm", "vir", "pulses_N"))
    told = volts - pulses  # the pulses' column is in volts, and part of the motor's voltage
    build = observer(3, True, poles)
    gain = hgo.tune(build, (t, q, told), state=3, skip=SKIP).ell if ell is None else ell
    found = AXIS["M"] * build(gain).run(t, q, told, x_hat0=[q[0], 0.0, 0.0]).x_hat[:, 2]
    return Load(t, AXIS["gtau"] * pulses, found, gain)


# --- output ---------------------------------------------------------------------------------------


def draw(
    figure: Any, table: dict[str, list[tuple[str, float, float]]], pulses: Load | None
) -> None:
    """Errors of all methods, a panel a setting; below, the load."""
    figure.set_size_inches(10.5, 7.0 if pulses else 4.4)
    upper, lower = figure.subfigures(2, 1, height_ratios=(1.5, 1.0)) if pulses else (figure, None)
    axes = upper.subplots(1, len(table), sharey=True)
    for ax, (name, results) in zip(np.atleast_1d(axes), table.items(), strict=True):
        names = [row[0] for row in results][::-1]
        least = np.array([row[1] for row in results])[::-1]
        least[~np.isfinite(least)] = np.nan  # diverged
        tuned = np.array([row[2] for row in results])[::-1]
        ours = np.isin(names, [*OURS, "adaptive n = 3, no model, predictor"])
        places = np.arange(len(names))
        for mask, colour, label in ((ours, "blue", "ours, best"), (~ours, "grey", "others, best")):
            ax.plot(least[mask], places[mask], "o", color=COLOURS[colour], label=label)
        mark = {"color": COLOURS["vermillion"], "markersize": 9, "markeredgewidth": 1.6}
        ax.plot(tuned, places, "|", label="ours, tuned", **mark)
        ax.set(xscale="log", title=name, xlabel="velocity error, RMS (m/s)")
        ax.set_yticks(places, names)
        ax.xaxis.set_minor_formatter("")
        ax.margins(x=0.08, y=0.06)
    np.atleast_1d(axes)[0].legend(loc="lower right")
    if pulses is not None and lower is not None:
        ax = lower.subplots()
        shown = (pulses.t >= 4.0) & (pulses.t <= 8.0)
        ax.plot(pulses.t[shown], pulses.known[shown], color=COLOURS["black"], label="known load")
        colour = COLOURS["vermillion"]
        ax.plot(pulses.t[shown], pulses.found[shown], color=colour, label="estimated", linewidth=1)
        ax.set(xlabel="time (s)", ylabel="load (N)")
        ax.set_title(
            f"load steps of {pulses.step:.0f} N, from position and voltage: "
            f"RMS {pulses.rms:.1f} N over the plateaus after 0.2 s"
        )
        ax.margins(y=0.2)
        ax.legend(loc="upper center", ncols=2)


def main() -> None:
    """Print the table, and draw it."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("record", type=Path)
    arguments.add_argument("pulses", type=Path, nargs="?")
    arguments.add_argument("--figure", type=Path, default=Path("emps.png"))
    given = arguments.parse_args()
    table = {setting.name: list(rows(setting)) for setting in settings(given.record)}
    print("| | " + " | ".join(f"{name}: best | tuned" for name in table) + " |")
    print("|---|" + "---:|" * (2 * len(table)))
    for i, (name, _, _) in enumerate(next(iter(table.values()))):
        cells = [cell for results in table.values() for cell in results[i][1:]]
        shown = [f"{c:.2e}" if np.isfinite(c) else "" if c != c else "diverges" for c in cells]
        print(f"| {name} | " + " | ".join(shown) + " |")
    if find_spec("filterpy") is None:
        print("left out: the extended Kalman filter, which needs filterpy (pip install filterpy)")
    slow = mean_input(settings(given.record)[1])
    name = "standard n = 2, model"
    least = best(lambda ell: slow.error(run(OURS[name], slow)(ell)), 10.0, 1e3)
    print(f"{slow.name}, mean of the inputs at both ends of a step: {name} {least:.2e}")
    pulses = load(given.pulses) if given.pulses else None
    if pulses:
        print(
            f"load: RMS {pulses.rms:.2f} N beside steps of {pulses.step:.1f} N, "
            f"gain {pulses.ell:.3g} /s"
        )
    with style():
        figure = new_figure()
        draw(figure, table, pulses)
        save(figure, given.figure)


if __name__ == "__main__":
    main()
