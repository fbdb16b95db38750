"""The installed wheel gives the bits of every other build: `python .ci/wheel.py [--write]`.

Digests of estimates, of a log, of random numbers and of studies by the interpreter are compared
with those in `.ci/wheel.txt`, which `--write` makes anew where bits change on purpose. The wheel
and what it declares are all that is needed: it runs under an emulator too.
"""

from __future__ import annotations

import hashlib
import itertools
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import hgo_rs as hgo
from hgo_rs import _core
from hgo_rs.laws import LAWS
from hgo_rs.logs import read_log, write_table
from hgo_rs.observers import METHODS, TIMINGS, DeadZone, PiecewiseLinear, Stubborn

DIGESTS = Path(__file__).with_suffix(".txt")
T = np.arange(2000) * 1e-3
Y = np.where(np.arange(2000) % 97 == 0, np.nan, (T - 1.0) * (T - 1.0) + 0.5 * T)


GAINS = {
    "constant": hgo.ConstantGain(20.0),
    "adaptive": hgo.AdaptiveGain(10.0, 0.0025, 0.183),
    "dead-zone": hgo.DeadZoneGain(0.2, 0.05, 0.183),
    "homogeneous": hgo.HomogeneousGain(2.0),
    "switched": hgo.SwitchedGain(20.0, 5.0, 0.1, 0.05),
    "prescribed-time": hgo.PrescribedTimeGain(1.0, 2.0, 20.0),
}
SHAPES = {
    "dead-zone": DeadZone(1.0, 0.5),
    "stubborn": Stubborn(1.0, 2.0),
    "piecewise-linear": PiecewiseLinear(0.5, 0.01),
}
MODELS = {"none": None, "pendulum": "-sin(q) - 0.3*tanh(20*v) + 0.1*exp(-t)*atan2(q, v)"}


def matrix() -> Iterator[tuple[str, Any]]:
    """Laws times gains or shapes, and models, under every method and timing that they have."""
    kinds = [law.kind for law in LAWS.values() if law.single]
    for kind, (model, phi), (what, option) in itertools.product(
        kinds,
        MODELS.items(),
        [
            *((f"{name} gain", {"gain": gain}) for name, gain in GAINS.items()),
            *((f"shape {name}", {"gain": 20.0, "shape": shape}) for name, shape in SHAPES.items()),
        ],
    ):
        n = 2 if phi or kind in ("standard", "filtered") else 3
        given = {"model": hgo.Model(states=["q", "v"], phi=phi)} if phi else {}
        parts = []
        for method, timing in itertools.product(METHODS, TIMINGS):
            try:
                more = {"saturation": [0.05] * (n - 1)} if kind == "peaking-free" else {}
                made = {**option, **given, **more, "method": method, "timing": timing}
                parts.append(hgo.HighGainObserver(kind, n, **made).run(T[:500], Y[:500]).x_hat)
            except hgo.HgoError:
                parts.append(np.full((1, n), np.nan))
        runs = sum(len(part) > 1 for part in parts)
        if runs:
            yield f"{kind}, {what}, model {model}: {runs} runs", np.concatenate(parts)


def cases() -> Iterator[tuple[str, Any]]:
    for n in (1, 2, 3, 5):
        for method in ("zoh", "bilinear", "rk4"):
            law = hgo.StandardObserver(n, 30.0, method=method)
            yield f"standard, n = {n}, {method}", law.run(T, Y).x_hat
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "log.csv")
        write_table(path, {"t": T, "q": Y})
        yield "a log, written", np.frombuffer(path.read_bytes(), np.uint8)
        yield "a log, read", read_log(path, "t", "q").y
    yield from matrix()
    for n in (2, 3):
        law = hgo.HighGainEKF(n, theta=3.0, R=0.01, Q=np.eye(n))
        yield f"high-gain EKF, n = {n}", law.run(T, Y).x_hat
    yield "low-power", hgo.LowPowerObserver(5, 20.0).run(T, Y).x_hat
    yield "homogeneous", hgo.StandardObserver(2, hgo.HomogeneousGain(2.0)).run(T, Y).x_hat
    model = hgo.Model(states=["q", "v"], phi="-sin(q) - 0.3*tanh(20*v) + 0.1*exp(-t)*atan2(q, v)")
    yield "own model", hgo.StandardObserver(2, 25.0, model=model).run(T, Y).x_hat
    for law in ("bits", "uniform", "normal"):
        yield f"random numbers, {law}", _core.random(law, 1000, 7, 3, 0)
    for noise in (
        hgo.UniformNoise(-0.1, 0.1),
        hgo.NormalNoise(std=0.1, hold=2e-3),
        hgo.StudentTNoise(2.5, scale=0.05),
        hgo.LaplaceNoise(scale=0.05),
        hgo.ImpulsiveNoise(0.02),
    ):
        law = hgo.StandardObserver(2, 20.0, model=hgo.Lee())
        out = hgo.simulate(
            hgo.Lee(),
            law,
            x0=[1.0, 0.0],
            dt=1e-3,
            steps=500,
            runs=40,
            noise=noise,
            rng=2,
            engine="interpreter",
        )
        yield f"study, {type(noise).__name__}", out.final_memory


def main() -> int:
    warnings.simplefilter("ignore")
    lines = []
    for name, values in cases():
        array = np.ascontiguousarray(values)
        digest = hashlib.sha256(array.astype(array.dtype.newbyteorder("<")).tobytes())
        lines.append(f"{digest.hexdigest()[:32]}  {name}")
    text = "\n".join(lines) + "\n"
    if "--write" in sys.argv:
        DIGESTS.write_text(text, encoding="utf-8")
        return 0
    wrong = set(lines) ^ set(DIGESTS.read_text(encoding="utf-8").splitlines())
    print(f"{len(lines)} digests", *sorted(wrong, key=lambda line: line[34:]), sep="\n")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
