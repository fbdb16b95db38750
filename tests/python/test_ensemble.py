"""Vector code against one run at a time: a study's bits do not depend on the instruction set."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hgo_rs import HgoError, Lee, SimulationResult, StandardObserver, UniformNoise, simulate

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
draws = np.random.default_rng(4).normal(size=(37, 201))
own = lee_study | {"noise": {"kind": "samples", "values": draws, "hold": 2}}
studies = {"lee": lee_study, "adaptive": adaptive, "ship": ship, "fu": fu, "own": own}
out = {}
for name, spec in studies.items():
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
    if not instructions:
        del env["HGO_INSTRUCTION_SET"]
    command = [sys.executable, "-c", STUDIES, str(path)]
    subprocess.run(command, env=env, check=True, timeout=120, stderr=subprocess.PIPE)
    with np.load(path) as stored:
        return dict(stored)


@pytest.mark.parametrize(("instructions", "threads"), [("baseline", 2), ("avx2", 1), ("", 2)])
def test_the_bits_do_not_depend_on_the_instructions(
    tmp_path: Path, instructions: str, threads: int
) -> None:
    """Every kind that the processor has, last the widest; an odd number of runs; two threads."""
    plain = results(tmp_path, "plain", 1)
    try:
        vectors = results(tmp_path, instructions, threads)
    except subprocess.CalledProcessError as error:
        assert b"this processor has no " in error.stderr
        pytest.skip(f"this processor has no {instructions}")
    assert plain.keys() == vectors.keys() and len(plain) > 30
    for key, value in plain.items():
        numbers = np.asarray(value).dtype.kind == "f"
        assert np.array_equal(value, vectors[key], equal_nan=numbers), key
    for name in ("lee", "own"):
        rms = plain[f"{name}-rms"]
        assert np.isfinite(rms).all() and len(np.unique(rms[:, 0, 1])) == 37


def test_an_unknown_instruction_set_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HGO_INSTRUCTION_SET", "sse9")
    with pytest.raises(HgoError, match=r"HGO_INSTRUCTION_SET = \"sse9\".*plain, baseline, avx2"):
        a_study()


def a_study(**changes: Any) -> SimulationResult:
    """Lee's plant, 40 runs; at this gain and step the estimate does not settle."""
    given = {"runs": 40, "steps": 300, "windows": [(0.02, 0.1), (0.05, 0.12)]} | changes
    observer = StandardObserver(2, gain=100.0, k=[2.0, 1.0], method="euler", timing="predictor")
    noise = UniformNoise(-0.5, 0.5)
    return simulate(Lee(), observer, x0=[1.0, 1.0], dt=4e-4, noise=noise, rng=3, **given)


@pytest.mark.parametrize("backend", ["rust", "numpy"])
@pytest.mark.parametrize("asked", [["rms"], ["max", "peak"], ["mean"], []])
@pytest.mark.parametrize("runs", [3, 40])
def test_what_is_asked_for_is_what_all_would_give(
    backend: str, asked: list[str], runs: int
) -> None:
    """Overlapping windows; a single run and a block; nothing else is there."""
    every = a_study(runs=runs, backend=backend)
    some = a_study(runs=runs, backend=backend, metrics=asked)
    assert sorted(some.metrics) == sorted(asked)
    for name in asked:
        np.testing.assert_array_equal(some.metrics[name], every.metrics[name])
    np.testing.assert_array_equal(some.final_memory, every.final_memory)
    if "mean" not in asked:
        with pytest.raises(
            HgoError, match=r"mean was not asked for: metrics = .* add 'mean' to metrics"
        ):
            _ = some.mean


def test_metrics_are_names() -> None:
    for wrong in ("rms", ["median"]):
        with pytest.raises(HgoError, match=r"metrics = .*mean, rms, max, peak"):
            a_study(metrics=wrong)


def test_a_block_pools_its_runs_in_one_histogram() -> None:
    """37 runs fill a block and a part of one; the twin counts the same, but for rounding."""
    ours = a_study(runs=37, histogram=(0.02, 0.12)).histogram
    twin = a_study(runs=37, histogram=(0.02, 0.12), backend="numpy").histogram
    assert ours is not None and twin is not None
    assert ours["counts"].sum() == twin["counts"].sum() == 37 * 250
    assert np.abs(ours["counts"] - twin["counts"]).sum() <= 4
