"""Vector code against one run at a time: a study's bits do not depend on the instruction set."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

STUDIES = """
import sys
import numpy as np
from hgo_rs import _core
from hgo_rs.scenarios import astolfi, katayama, lee, sanfelice_praly as sp

lee_study = lee.study("SA", 400, noise=lee.NOISE, seed=1, windows=[[50, 401]], settle=0.5)
law = sp.observer(1.9)
adaptive = sp.study(law, sp.printed_start(), sp.HOLD, 4.0, noise=sp.noise(-0.02, 1), seed=2)
ship = katayama.spec(0.1, 0.1, 0.5)
fu = {
    "plant": {"kind": "van-der-pol", "epsilon": 0.8, "sigma": 0.5},
    "plant_method": "taylor-1.5",
    "substeps": 3,
    "observer": {
        "kind": "sampled-data",
        "model": {"kind": "van-der-pol", "epsilon": 0.8},
        "gain": "derived",
    },
    "x0": [1.0, 0.0],
    "memory0": [0.0, 1.0],
    "schedule": {"kind": "fixed", "dt": 0.1},
    "steps": 300,
    "seed": 3,
    "windows": [[0, 301]],
}
out = {}
for name, spec in {"lee": lee_study, "adaptive": adaptive, "ship": ship, "fu": fu}.items():
    spec = {key: value for key, value in spec.items() if key != "every"} | {"runs": 37}
    spec["steps"] = min(spec["steps"], 400)
    spec["windows"] = [[10, spec["steps"]]]
    result = _core.simulate(spec)
    for key, value in result.items():
        out[f"{name}-{key}"] = np.asarray(value)
np.savez(sys.argv[1], **out)
"""


def results(folder: Path, instructions: str, threads: int) -> dict[str, np.ndarray]:
    """What the studies give in a process of its own."""
    path = folder / f"{instructions}-{threads}.npz"
    env = dict(os.environ, HGO_INSTRUCTION_SET=instructions, RAYON_NUM_THREADS=str(threads))
    subprocess.run([sys.executable, "-c", STUDIES, str(path)], env=env, check=True, timeout=120)
    with np.load(path) as stored:
        return dict(stored)


@pytest.mark.parametrize(("instructions", "threads"), [("avx2", 1), ("avx512", 2)])
def test_the_bits_do_not_depend_on_the_instructions(
    tmp_path: Path, instructions: str, threads: int
) -> None:
    """The widest that the processor has, and fewer; an odd number of runs; one thread and two."""
    plain = results(tmp_path, "plain", 1)
    vectors = results(tmp_path, instructions, threads)
    assert plain.keys() == vectors.keys() and len(plain) > 30
    for key, value in plain.items():
        assert np.array_equal(value, vectors[key], equal_nan=True), key
    assert np.isfinite(plain["lee-rms"]).all() and np.ptp(plain["lee-rms"][:, 0, 1]) > 0.0
