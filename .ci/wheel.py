"""The installed wheel gives the bits of every other build: `python .ci/wheel.py [--write]`.

Digests of estimates, of random numbers and of studies by the interpreter are compared with those in
`.ci/wheel.txt`, which `--write` makes anew where bits change on purpose. The wheel and what it
declares are all that is needed: it runs under an emulator too.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import hgo_rs as hgo
from hgo_rs import _core

DIGESTS = Path(__file__).with_suffix(".txt")
T = np.arange(2000) * 1e-3
Y = np.where(np.arange(2000) % 97 == 0, np.nan, (T - 1.0) * (T - 1.0) + 0.5 * T)


def cases() -> Iterator[tuple[str, Any]]:
    for n in (1, 2, 3, 5):
        for method in ("zoh", "bilinear", "rk4"):
            law = hgo.StandardObserver(n, 30.0, method=method)
            yield f"standard, n = {n}, {method}", law.run(T, Y).x_hat
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
