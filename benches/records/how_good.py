"""Errors of the velocity on real records: `python how_good.py FOLDER` prints the table of
docs/how-good.md.

FOLDER holds, from repositories of github.com,

    single_pendulum.mat       dynamicslab/MultiArm-Pendulum
    pendulum_identify.csv     dfki-ric-underactuated-lab/torque_limited_simple_pendulum
    pendulum_by_hand.csv      dfki-ric-underactuated-lab/torque_limited_simple_pendulum
    silverbox.csv             biaslab/nsi-silverbox
    gnss_drive.csv            rtklibexplorer/GNSS_IMU

All methods see y and u alone; the reference is for the table.  An error below the reference's own
is no figure, and is shown as less than that.  Only the column "its best gain" knows the reference:
what the observer of hgo.tune reaches at constant gains from a seventh to seven times its own.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal
from scipy.io import loadmat

import hgo_rs as hgo

Case = tuple[str, hgo.Model, tuple[Any, ...], dict[str, Any], float, float]
"""Name, model, log, truth by states, skip [s], error of the truth."""


def zero_phase(t: Any, q: Any, cutoff: float, derivatives: int) -> Any:
    """Derivatives of q through a Butterworth low-pass of order 4, both ways."""
    sos = signal.butter(4, cutoff, fs=1.0 / np.median(np.diff(t)), output="sos")
    out = signal.sosfiltfilt(sos, q)
    for _ in range(derivatives):
        out = signal.sosfiltfilt(sos, np.gradient(out, t))
    return out


def identified(columns: Any, a: Any, names: str) -> dict[str, float]:
    """Parameters by least squares on derivatives without phase."""
    found, *_ = np.linalg.lstsq(columns, a, rcond=None)
    return dict(zip(names.split(), found.tolist(), strict=True))


def free_pendulum(folder: Path) -> Iterator[Case]:
    """An encoder of 40 000 lines, at rest after a minute; the model is of the first 12 s."""
    whole = loadmat(folder / "single_pendulum.mat", squeeze_me=True)
    q, _ = np.hstack([*whole["Y_id"], *whole["Y_vad"]])
    t = 1e-3 * np.arange(len(q))
    qs, v, a = (zero_phase(t, q, 40.0, k) for k in range(3))
    some, test = slice(500, 12000), slice(12000, None)
    columns = np.c_[np.sin(qs), v, np.tanh(v / 0.05)]
    known = identified(columns[some], a[some], "k1 k2 k3")
    phi = "k1*sin(q) + k2*v + k3*tanh(v/0.05)"
    model = hgo.Model(states=["q", "v"], parameters=known, phi=phi)
    for name, step, quantum, noise in (
        ("1 kHz", 1, 0.0, 0.0),
        ("100 Hz", 10, 0.0, 0.0),
        ("100 Hz, 2048 steps a turn", 10, 2.0 * np.pi / 2048, 0.0),
        ("200 Hz, noise of 3 mrad", 5, 0.0, 3e-3),
    ):
        y = q[test][::step].copy()
        y += noise * np.random.default_rng(0).standard_normal(y.size)
        y = np.round(y / quantum) * quantum if quantum else y
        log = (1e-3 * step * np.arange(len(y)), y)
        yield f"Free pendulum, {name}", model, log, {"v": v[test][::step]}, 1.0, 1.4e-3


def driven_pendulum(folder: Path) -> Iterator[Case]:
    """Steps of 2.9 mrad; moved by a hand that the model does not know."""
    t, q, _, tau = np.genfromtxt(folder / "pendulum_identify.csv", delimiter=",", skip_header=1).T
    qs, v, a = (zero_phase(t, q, 10.0, k) for k in range(3))
    columns = np.c_[zero_phase(t, tau, 10.0, 0), np.sin(qs), v, np.tanh(v / 0.1), np.ones(len(t))]
    known = identified(columns[100:2400], a[100:2400], "k0 k1 k2 k3 k4")
    phi = "k0*u + k1*sin(q) + k2*v + k3*tanh(v/0.1) + k4"
    model = hgo.Model(states=["q", "v"], inputs=["u"], parameters=known, phi=phi)
    t, q, v, tau = np.genfromtxt(folder / "pendulum_by_hand.csv", delimiter=",", skip_header=1).T
    log = (t - t[0], q, tau)
    truth = {"v": zero_phase(t, v, 30.0, 0)}
    yield "Pendulum moved by hand, 1 kHz", model, log, truth, 1.0, 0.0


def duffing(folder: Path) -> Iterator[Case]:
    """An electronic oscillator at 68 Hz, sampled at 610 Hz."""
    u, y, *_ = np.genfromtxt(folder / "silverbox.csv", delimiter=",", skip_header=1).T
    u, period = u - u.mean(), 2**14 / 1e7
    f = np.fft.rfftfreq(len(y), period)

    def derivative(values: Any, order: int) -> Any:
        low = np.fft.rfft(values) * (f < 230.0) * (2j * np.pi * f) ** order
        return np.fft.irfft(low, len(values))

    ys, v, a = (derivative(y, k) for k in range(3))
    some, part = slice(1000, 39000), slice(60000, 80000)
    columns = np.c_[derivative(u, 0), v, ys, ys**3]
    known = identified(columns[some], a[some], "k0 k1 k2 k3")
    phi = "k0*u + k1*v + k2*q + k3*q**3"
    model = hgo.Model(states=["q", "v"], inputs=["u"], parameters=known, phi=phi)
    mean, rng = np.append(0.5 * (u[1:] + u[:-1]), u[-1]), np.random.default_rng(0)
    t = period * np.arange(20000)
    for name, given, noise in (
        ("input held", u, 0.0),
        ("mean of inputs", mean, 0.0),
        ("mean of inputs, noise of 5 mV", mean, 5e-3),
    ):
        samples = y[part] + noise * rng.standard_normal(20000)
        log = (t, samples, given[part])
        yield f"Duffing circuit, {name}", model, log, {"v": v[part]}, 1.0, 0.04


def car(folder: Path) -> Iterator[Case]:
    """Satellite fixes at 4 Hz; acceleration and turn rate are inputs."""
    d = np.genfromtxt(folder / "gnss_drive.csv", delimiter=",", skip_header=1)
    d = d[int(0.4 * len(d)) :]
    speed = "sqrt(ve**2 + vn**2 + 0.25)"
    model = hgo.Model(
        states=["e", "ve", "n", "vn"],
        inputs=["a", "w"],
        orders=[2, 2],
        phi=[f"a*ve/{speed} - w*vn", f"a*vn/{speed} + w*ve"],
    )
    for name, noise in (("as recorded", 0.0), ("noise of 1 m", 1.0)):
        y = d[:, 1:3] + noise * np.random.default_rng(0).standard_normal((len(d), 2))
        truth = {"ve": d[:, 3], "vn": d[:, 4]}
        log = (d[:, 0] - d[0, 0], y, d[:, 5:7])
        yield f"Car, {name}", model, log, truth, 20.0, 0.02


def best_gain(tuned: hgo.Tuning, log: Any, v: Any, skip: float) -> float:
    """The least error of v over constant gains of the chosen observer of one output, from a
    seventh of the chosen one to seven times.
    """
    judged = log[0] - log[0][0] > skip
    chosen = hgo.Config.of(tuned.observer)

    def error(log_ell: float) -> float:
        gain = {"law": "constant", "ell": float(np.exp(log_ell))}
        try:
            observer = chosen.replace(gain=gain).observer()
            run = replace(tuned, observer=observer, noise=np.nan).run(log)  # no deviations
        except hgo.HgoError:  # a step at or above its limit
            return np.inf
        return float(np.sqrt(np.mean((np.asarray(run.x_hat)[:, 1] - v)[judged] ** 2)))

    around = np.linspace(-2.0, 2.0, 81)
    return min(map(error, np.log(tuned.observer.spec["gain"]["ell"]) + around))


def main(folder: Path) -> None:
    """Print the table."""
    columns = ("hgo.tune", "its best gain", *hgo.smoothing.BASELINES, "hgo.smooth")
    print("| Record | " + " | ".join(columns) + " |\n|---|" + "---:|" * len(columns))
    for cases in (free_pendulum, driven_pendulum, duffing, car):
        for name, model, log, truth, skip, least in cases(folder):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                tuned = hgo.tune(model, log, skip=skip)
                run = tuned.run(log)
            places = (
                [tuned.observer.model.states.index(s) for s in model.states]
                if (tuned.observer.model is not None)
                else list(range(model.n))
            )
            offered = {
                "hgo.tune": np.asarray(run.x_hat)[:, places],
                "hgo.smooth": hgo.smooth(model, log).x,
            }
            found = hgo.compare(log, offered, model=model, truth=truth, skip=skip)
            of = dict(zip(found.methods, found.error, strict=True))
            if len(truth) == 1 and "ell" in tuned.observer.spec.get("gain", {}):
                (v,) = truth.values()
                of["its best gain"] = [best_gain(tuned, log, v, skip)]
            cells = [
                ", ".join(f"{e:.3g}" if e >= least else f"< {least:g}" for e in of.get(c, ()))
                or "-"
                for c in columns
            ]
            print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
