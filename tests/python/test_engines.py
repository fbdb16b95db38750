"""Engines of studies: the interpreter and kernels by LLVM, with the same bits."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs import _core
from hgo_rs import llvm as compiler
from hgo_rs.simulation import llvm
from hgo_rs.simulation.noise import (
    ColouredNoise,
    ImpulsiveNoise,
    LaplaceNoise,
    NormalNoise,
    RecordedNoise,
    StudentTNoise,
    UniformNoise,
)

RUNS, STEPS = 40, 700
RNG = np.random.default_rng(5)


def starts(*centre: float) -> np.ndarray[Any, Any]:
    return np.array(centre) + RNG.uniform(-0.5, 0.5, (RUNS, len(centre)))


def lee(**of: Any) -> hgo.StandardObserver:
    form = {"method": "euler", "timing": "predictor"} | of
    return hgo.StandardObserver(2, 20.0, k=[2.0, 2.0], model=hgo.Lee(), **form)


CASES: dict[str, dict[str, Any]] = {
    "uniform noise": {"noise": UniformNoise(low=-0.1, high=0.1), "metrics": ["rms"]},
    "normal noise, all metrics": {"noise": NormalNoise(mean=0.02, std=0.1), "settle": 0.05},
    "noise that is held": {"noise": NormalNoise(std=0.1, hold=5e-3), "substeps": 3},
    "Student-t noise": {"noise": StudentTNoise(2.5, 0.02, 0.05)},
    "Laplace noise that is held": {"noise": LaplaceNoise(scale=0.05, hold=3e-3), "every": 5},
    "impulsive noise": {"noise": ImpulsiveNoise(0.02, 0.1, 30.0)},
    "coloured noise": {"noise": ColouredNoise([1.4, -0.5], 0.05), "every": 3},
    "coloured noise that is held": {"noise": ColouredNoise([0.9, 0.2, -0.3], 0.05, hold=4e-3)},
    "sines": {"noise": UniformNoise(low=-0.1, high=0.1, sines=[(0.1, 30.0, 0.5)])},
    "plants that start alike": {"x0": [1.0, -0.5], "noise": UniformNoise(low=-0.1, high=0.1)},
    "frames": {"noise": UniformNoise(low=-0.1, high=0.1), "every": 7},
    "histogram": {"noise": NormalNoise(std=0.1), "histogram": (0.1, 0.5)},
    "windows that overlap": {"windows": [(0.0, 0.3), (0.2, 0.6), (0.25, 0.7)]},
    "recorded, one for all": {"noise": RecordedNoise(values=RNG.normal(0, 0.1, STEPS + 1))},
    "recorded, one a run": {"noise": RecordedNoise(values=RNG.normal(0, 0.1, (RUNS, STEPS + 1)))},
    "no noise": {},
    "current, placed": {
        "observer": lee(method="zoh", timing="current"),
        "noise": NormalNoise(std=0.1),
    },
    "current, rk4": {
        "observer": lee(method="rk4", timing="current"),
        "noise": NormalNoise(std=0.1),
    },
    "joint": {"mode": "joint", "observer": lee(method="rk4"), "noise": NormalNoise(std=0.1)},
    "adaptive": {
        "plant": hgo.SanfelicePraly(1.0),
        "observer": hgo.StandardObserver(
            2,
            gain=hgo.AdaptiveGain(10.0, 2.5e-3, 0.183),
            model=hgo.SanfelicePraly(1.0),
            method="rk4",
            timing="predictor",
        ),
        "noise": NormalNoise(std=0.01),
    },
    "homogeneous": {
        "observer": hgo.StandardObserver(2, hgo.HomogeneousGain(2.0), model=hgo.Lee()),
        "noise": NormalNoise(std=0.1),
    },
    "switched, stubborn": {
        "observer": hgo.StandardObserver(
            2,
            hgo.SwitchedGain(30.0, 5.0, 0.1, 0.02),
            shape=hgo.Stubborn(5.0, 20.0, 1e-3),
            model=hgo.Lee(),
            method="euler",
        ),
        "noise": NormalNoise(std=0.1),
    },
    "limited gain power": {
        "observer": hgo.HighGainObserver("limited-gain", 2, 20.0, model=hgo.Lee(), saturation=9.0),
        "noise": NormalNoise(std=0.1),
    },
    "cascade": {
        "observer": hgo.HighGainObserver("cascade", 4, 20.0, saturation=9.0),
        "noise": NormalNoise(std=0.1),
    },
    "reduced order": {
        "observer": hgo.HighGainObserver("reduced-chain", 2, 20.0, model=hgo.Lee()),
        "noise": NormalNoise(std=0.1),
    },
    "process noise": {
        "plant": hgo.VanDerPol(),
        "observer": hgo.SampledDataObserver(hgo.VanDerPol()),
        "x0": starts(1.0, 0.0),
        "noise": NormalNoise(std=0.1),
        "plant_method": "taylor-1.5",
        "substeps": 2,
    },
    "clip": {
        "plant": hgo.Crackle(),
        "observer": hgo.PeakingFreeObserver(
            5, 7.0, model=hgo.Crackle(), saturation=[3.0] * 4, method="rk4", timing="predictor"
        ),
        "x0": starts(0.0, 0.0, 0.0, 0.0, 0.0),
        "dt": 1e-2,
    },
    "ship": {
        "plant": hgo.Ship(),
        "observer": hgo.ReducedOrderObserver(0.2, h_bar=[0.5] * 3),
        "x0": starts(0.0, 6.0, 0.0, 1.0, 0.0, 0.0),
        "dt": 1e-2,
        "noise": UniformNoise(low=-0.01, high=0.01),
    },
    "own, with time": {
        "plant": hgo.Plant(
            states=["q", "w"], drift=["w", "0.1*cos(3*t) - sin(q)"], output="q + 0.1*sin(5*t)"
        ),
        "observer": hgo.LowPowerObserver(
            3, 15.0, model=hgo.Model(states=["q", "w", "d"], phi="-0.1*d*q")
        ),
        "noise": NormalNoise(std=0.01),
    },
    "two outputs": {
        "plant": hgo.Plant(
            states=["a", "va", "b"],
            drift=["va", "-sin(a) + b", "-b + 0.2*va"],
            output=["a", "b"],
        ),
        "observer": hgo.MultiOutputObserver(
            [hgo.StandardObserver(2, 20.0), hgo.StandardObserver(1, 10.0)],
            model=hgo.Model(
                states=["a", "va", "b"], orders=[2, 1], phi=["-sin(a) + b", "-b + 0.2*va"]
            ),
        ),
        "x0": starts(0.3, 0.0, 0.1),
        "noise": NormalNoise(std=0.01),
    },
    "two outputs, coloured": {
        "plant": hgo.Plant(states=["a", "b"], drift=["b", "-sin(a)"], output=["a", "b"]),
        "observer": hgo.MultiOutputObserver(
            [hgo.StandardObserver(1, 20.0), hgo.StandardObserver(1, 10.0)],
            model=hgo.Model(states=["a", "b"], orders=[1, 1], phi=["b", "-sin(a)"]),
        ),
        "x0": starts(0.3, 0.0),
        "noise": ColouredNoise([0.6, 0.3], 0.01, hold=2e-3),
    },
    "diverges, Student-t noise": {
        "observer": lee(),
        "dt": 0.4,
        "noise": StudentTNoise(1.0),
    },
    "diverges": {"observer": lee(), "dt": 0.4, "allow_unstable": True},
    "loses its value": {
        "observer": hgo.StandardObserver(
            2,
            20.0,
            model=hgo.Model(states=["q", "w"], phi="-q - w + 0*sqrt(1.3 - q)"),
            method="euler",
            timing="predictor",
        ),
        "x0": starts(1.0, 0.0),
    },
}


def arguments(case: dict[str, Any]) -> dict[str, Any]:
    usual = {
        "plant": hgo.Lee(),
        "observer": lee(),
        "x0": starts(1.0, 0.0),
        "dt": 1e-3,
        "steps": STEPS,
        "runs": RUNS,
        "rng": 3,
        "plant_method": None,
        "windows": [(0.0, 0.2), (0.3, 0.7)],
        "allow_unstable": True,
    }
    given = usual | case
    if given["dt"] != 1e-3:  # windows and the like in samples
        scale = given["dt"] / 1e-3
        given["windows"] = [(a * scale, b * scale) for a, b in given["windows"]]
    return given


def same(a: hgo.SimulationResult, b: hgo.SimulationResult) -> None:
    """The same bits everywhere."""
    pairs = [(name, a.metrics[name], b.metrics[name]) for name in a.metrics]
    for name in ("settling_time", "diverged_at", "undefined_at", "final_x", "final_memory"):
        pairs.append((name, getattr(a, name), getattr(b, name)))
    pairs += [(name, getattr(a, name), getattr(b, name)) for name in ("time", "x", "memory", "y")]
    if a.histogram is not None:
        pairs.append(("counts", a.histogram["counts"], b.histogram["counts"]))
    for name, left, right in pairs:
        if left is None:
            assert right is None
        else:
            assert np.array_equal(left, right, equal_nan=left.dtype.kind == "f"), name


@pytest.mark.parametrize("name", CASES)
def test_kernels_have_the_interpreters_bits(name: str) -> None:
    pytest.importorskip("llvmlite")
    given = arguments(CASES[name])
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)  # a kernel that fails its check
        ours = hgo.simulate(**given, engine="interpreter")
        theirs = hgo.simulate(**given, engine="llvm")
    same(ours, theirs)
    if name == "diverges":
        assert (ours.diverged_at >= 0).any()
    if name == "loses its value":
        assert (ours.undefined_at >= 0).any()
    if name == "plants that start alike":
        assert ours.shared == theirs.shared == ("plant",)


@pytest.mark.parametrize("instructions", ["baseline", "avx2", "avx512"])
def test_every_instruction_set_has_the_same_bits(
    instructions: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("llvmlite")
    given = arguments(CASES["normal noise, all metrics"])
    plain = hgo.simulate(**given, engine="interpreter")
    monkeypatch.setenv("HGO_INSTRUCTION_SET", instructions)
    try:
        same(plain, hgo.simulate(**given, engine="interpreter"))
    except hgo.HgoError as error:
        assert "this processor has no " in str(error)
        return
    same(plain, hgo.simulate(**given, engine="llvm"))


def test_one_run_and_blocks_have_the_same_bits() -> None:
    given = arguments(CASES["normal noise, all metrics"])
    whole = hgo.simulate(**given, engine="interpreter")
    for run in (0, 17, 39):
        alone = hgo.simulate(**(given | {"runs": run + 1, "x0": given["x0"][: run + 1]}))
        assert np.array_equal(alone.final_memory[run], whole.final_memory[run])


def test_a_kernel_that_gives_other_bits_is_told_and_not_used(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("llvmlite")
    given = arguments(CASES["uniform noise"])
    right = hgo.simulate(**given, engine="interpreter")
    source = _core.study_source

    def wrong(*arguments: Any) -> Any:
        made = source(*arguments)
        changed = made["text"].replace("fsub", "fadd", 1)
        assert changed != made["text"]
        return made | {"text": changed}

    monkeypatch.setattr(llvm._core, "study_source", wrong)
    with pytest.warns(RuntimeWarning, match=r"llvmlite .*the interpreter is used"):
        same(right, hgo.simulate(**given, engine="llvm"))


def test_engines_are_refused_where_they_cannot_be(monkeypatch: pytest.MonkeyPatch) -> None:
    given = arguments({})
    with pytest.raises(hgo.HgoError, match="engine = 'fast': must be one of auto, interp"):
        hgo.simulate(**given, engine="fast")
    with pytest.raises(hgo.HgoError, match="engine = 'llvm': must be for backend 'rust'; leave"):
        hgo.simulate(**given, engine="llvm", backend="numpy")
    monkeypatch.setattr(compiler, "binding", lambda: "llvmlite is not installed; pip install it")
    with pytest.raises(hgo.HgoError, match=r"engine = 'llvm'.*pip install"):
        hgo.simulate(**given, engine="llvm")
    same(hgo.simulate(**given), hgo.simulate(**given, engine="interpreter"))


def test_a_system_of_python_functions_is_not_compiled() -> None:
    pytest.importorskip("llvmlite")

    def drift(t: float, x: Any) -> Any:
        return [x[1], -x[0] if float(x[0]) > 0 else -2.0 * x[0]]

    plant = hgo.Plant(states=["q", "w"], drift=drift)
    assert not plant.compiled
    given = arguments({"plant": plant, "observer": hgo.StandardObserver(2, 20.0), "steps": 20})
    given["windows"] = []
    with pytest.raises(hgo.HgoError, match=r"engine = 'llvm'.*write its equations"):
        hgo.simulate(**given, engine="llvm")
    assert hgo.simulate(**given).shared == ()


def test_a_study_takes_its_engine() -> None:
    pytest.importorskip("llvmlite")

    def build(ell: float) -> dict[str, Any]:
        given = arguments(CASES["uniform noise"])
        given = {name: value for name, value in given.items() if name not in ("runs", "rng")}
        return given | {
            "observer": hgo.StandardObserver(2, ell, method="euler", timing="predictor"),
            "x0": [1.0, 0.0],
        }

    grid = {"ell": [10.0, 20.0]}
    ours = hgo.study(build, grid=grid, runs=RUNS, engine="interpreter", progress=False)
    theirs = hgo.study(build, grid=grid, runs=RUNS, engine="llvm", progress=False)
    for case in range(2):
        same(ours[case], theirs[case])
    assert "plants moved once for all runs in 2 of 2 cases" in repr(theirs)


def test_auto_compiles_a_study_that_is_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("llvmlite")
    given = arguments(CASES["uniform noise"] | {"observer": lee(method="euler")})
    right = hgo.simulate(**given, engine="interpreter")
    made: list[Any] = []
    compiled = compiler.compiled
    monkeypatch.setattr(compiler, "compiled", lambda *of: made.append(of) or compiled(*of))
    monkeypatch.setattr(llvm, "_compiled", compiler.Kept("a study"))
    monkeypatch.setattr(llvm, "_SMALL", 0.0)
    llvm._done.clear()
    same(right, hgo.simulate(**given))
    (operations,) = llvm._done.values()
    assert made == [] and RUNS * STEPS <= operations < llvm._WORTH
    monkeypatch.setattr(llvm, "_WORTH", 2.5 * operations)
    for count in (0, 1, 1):  # the third one has it, and so have all that come
        same(right, hgo.simulate(**given))
        assert len(made) == count
