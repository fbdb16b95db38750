"""Peaking and noise: three observers on the same chaotic system (the picture of the README).

Usage: python examples/overview.py [FILE]    default: overview.png
"""

from __future__ import annotations

import sys

import numpy as np
from matplotlib.figure import Figure

import hgo_rs as hgo
from hgo_rs.plots import new_figure, save, style

ORDER, STATE = 5, 3  # the fourth state of the crackle system is drawn
GAINS = {"standard": 4.17, "low-power": 7.0, "peaking-free": 7.0}  # equal speed of convergence


def observers(model: hgo.Crackle) -> dict[str, hgo.Observer]:
    """The three laws with the gains at which they converge equally fast."""
    # mode "joint" integrates plant and law as one differential equation
    joint = {"model": model, "method": "bogacki-shampine", "timing": "predictor"}
    return {
        "standard": hgo.StandardObserver(ORDER, GAINS["standard"], **joint),
        "low-power": hgo.LowPowerObserver(ORDER, GAINS["low-power"], **joint),
        "peaking-free": hgo.PeakingFreeObserver(
            ORDER, GAINS["peaking-free"], saturation=3.0, **joint
        ),
    }


def draw(figure: Figure) -> None:
    """Left: the transient without noise. Right: the error once a noisy output is all there is."""
    model = hgo.Crackle()
    noise = hgo.Sines(sines=[(0.05, 100.0, 0.0)])  # amplitude, rad/s, phase
    transient, steady = figure.subplots(1, 2)
    for name, observer in observers(model).items():
        for axes, disturbance, t_end in ((transient, None, 4.0), (steady, noise, 8.6)):
            result = hgo.simulate(
                model,
                observer,
                x0=[-0.8, 0.0, 0.0, 0.0, 0.0],
                memory0=observer.initial_memory([1.0] * ORDER),
                mode="joint",
                dt=1e-3,
                t_end=t_end,
                noise=disturbance,
                rng=1,
                every=1,
            )
            assert result.time is not None and result.x is not None and result.x_hat is not None
            error = result.x_hat[0, :, STATE] - result.x[0, :, STATE]
            late = result.time > (8.0 if disturbance else -1.0)
            label = f"{name}, ℓ = {GAINS[name]:g}"
            if disturbance:
                rms = float(np.sqrt(np.mean(error[late] ** 2)))
                label = f"{name}: RMS {rms:.2g}"
            width = 3.0 if name == "low-power" else 1.4  # the two low-power laws coincide here
            axes.plot(result.time[late], error[late], label=label, lw=width)
    transient.set_yscale("symlog", linthresh=1.0)
    transient.set_title("Transient, no noise")
    steady.set_title("Steady state, noise 0.05 sin(100 t) on y")
    for axes in (transient, steady):
        axes.set_xlabel("time (s)")
        axes.set_ylabel("error of the third derivative, x̂₄ − x₄")
        axes.legend(loc="upper right")
    steady.set_ylim(top=8.0)


if __name__ == "__main__":
    with style():
        picture = new_figure((10.0, 3.8))
        draw(picture)
        save(picture, sys.argv[1] if len(sys.argv) > 1 else "overview.png")
