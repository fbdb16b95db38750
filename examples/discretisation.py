"""Accuracy (drawn, for docs/discretisation.md) and cost (printed) of every discretisation.

Usage: python examples/discretisation.py [FILE]    default: discretisation.png
"""

from __future__ import annotations

import sys
from time import perf_counter

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

import hgo_rs as hgo
from hgo_rs.observers import METHODS, TIMINGS
from hgo_rs.plots import new_figure, save, style

ORDER, DT, COUNT = 3, 1e-3, 6_000
OMEGA, NOISE = 5.0, 1e-4  # rad/s; standard deviation
STEPS = np.geomspace(0.01, 10.0, 31)  # c = ell dt
BY_ITSELF = {"implicit": "current", "inter-sample": "predictor"}  # methods of one timing
MANNERS = [(m, t) for m in METHODS for t in TIMINGS if BY_ITSELF.get(m, t) == t]


def errors(method: str, timing: str) -> tuple[np.ndarray, np.ndarray]:
    """RMS error of the first derivative over c: of a sine without noise, and of noise alone."""
    t = np.arange(COUNT) * DT
    late = t > 2.0
    noise = NOISE * np.random.default_rng(1).normal(size=COUNT)
    out = np.full((2, STEPS.size), np.nan)
    for i, c in enumerate(STEPS):
        law = hgo.StandardObserver(ORDER, c / DT, method=method, timing=timing, allow_unstable=True)
        if law.step_limit().dt <= DT:
            break
        for j, (y, truth) in enumerate(
            ((np.sin(OMEGA * t), OMEGA * np.cos(OMEGA * t)), (noise, np.zeros(COUNT)))
        ):
            error = law.run(DT, y).x_hat[late, 1] - truth[late]
            out[j, i] = np.sqrt(np.mean(error**2))
    return out[0], out[1]


def cost(method: str, timing: str) -> float:
    """Nanoseconds a sample in a record, the least of several runs."""
    law = hgo.StandardObserver(ORDER, 50.0, method=method, timing=timing)
    y = np.random.default_rng(0).normal(size=20_000)
    law.run(DT, y)
    times = []
    for _ in range(5):
        start = perf_counter()
        law.run(DT, y)
        times.append(perf_counter() - start)
    return 1e9 * min(times) / y.size


def draw(figure: Figure) -> None:
    """Left: what lags. Right: what noise makes."""
    lag, noise = figure.subplots(1, 2)
    named = set()
    for method, timing in MANNERS[::-1]:  # current timing first: its line is the solid one
        color = colormaps["tab20"](METHODS.index(method))
        line = {"color": color, "lw": 1.4, "ls": "-" if timing == "current" else ":"}
        signal, passed = errors(method, timing)
        lag.loglog(STEPS, signal, label=None if method in named else method, **line)
        noise.loglog(STEPS, passed, **line)
        named.add(method)
    lag.set(xlabel="c = ℓT", ylabel="RMS error of the derivative", ylim=(1e-6, 1e1))
    lag.set_title("of a sine (ωT = 0.005), no noise")
    noise.set(xlabel="c = ℓT", ylabel="RMS error of the derivative")
    noise.set_title(f"of noise alone (standard deviation {NOISE:g})")
    lag.legend(
        loc="lower left",
        fontsize="x-small",
        title_fontsize="x-small",
        title="solid: current, dotted: predictor",
    )


if __name__ == "__main__":
    with style():
        picture = new_figure((10.0, 4.2))
        draw(picture)
        save(picture, sys.argv[1] if len(sys.argv) > 1 else "discretisation.png")
    for name, when in MANNERS:
        print(f"{name:20s} {when:10s} {cost(name, when):6.1f} ns a sample")
