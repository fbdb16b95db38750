"""Engines of records: the interpreter and kernels by LLVM, with the same bits."""

from __future__ import annotations

import warnings
from typing import Any

import equivalence_table as table
import numpy as np
import numpy.typing as npt
import pytest
from matrices import some

import hgo_rs as hgo
from hgo_rs import _core, llvm
from hgo_rs.observers import compiled
from hgo_rs.observers.compiled import RecordEngine

pytest.importorskip("llvmlite")

Array = npt.NDArray[np.float64]
ROWS = 1300
STEP = 2.0**-8
OBSERVERS = {
    str(case): case.spec["observer"] for case in table.CASES if case.kind in ("record", "loop")
}


def record(observer: Any) -> tuple[Array, Array, Array]:
    """Times of equal steps with some that differ, samples with gaps, inputs."""
    rng = np.random.default_rng(8)
    steps = np.full(ROWS, STEP)
    steps[[0, 40, 41, 700, 1023]] *= 2.0
    steps[900:903] *= 0.75
    t = np.cumsum(steps)
    assert np.all(np.diff(t) == steps[1:])
    waves = [0.3 * np.sin((1.0 + 0.3 * i) * t) for i in range(observer.n_y)]
    y = np.stack(waves, axis=1) + 0.01 * rng.normal(size=(ROWS, observer.n_y))
    y[[9, 10, 511, 512, ROWS - 1]] = np.nan
    y[200:230] = np.nan
    y[600, -1] = np.nan
    return t, y, 0.2 * np.sin(np.outer(t, np.arange(2.0, 2.0 + observer.n_u)))


def same(a: dict[str, Any], b: dict[str, Any]) -> None:
    for name in ("memory", "innovation", "status", "y", "missing", "next", "largest"):
        assert np.asarray(a[name]).tobytes() == np.asarray(b[name]).tobytes(), name
    for name in ("sound", "longest_step", "undefined", "largest_sample"):
        assert a[name] == b[name], name


@pytest.mark.parametrize("name", some(OBSERVERS, "kernels"))
def test_a_kernel_has_the_interpreters_bits(name: str) -> None:
    observer = _core.Observer(OBSERVERS[name])
    t, y, u = record(observer)
    engine = RecordEngine(observer)
    whole = y.copy()
    whole[np.isnan(whole)] = 0.1
    start = observer.initial()
    for clock, samples in ((t, y), (t, whole), (STEP, y), (STEP, whole)):
        by_one = engine.run("interpreter", (clock, samples, u, start), until=t[-1] + 1.0)
        by_other = engine.run("llvm", (clock, samples, u, start), until=t[-1] + 1.0)
        same(by_one, by_other)
    kernels = compiled._compiled
    key = (observer.record_source()["text"], llvm.instructions())
    assert kernels._kernels[key].agrees


def test_a_kernel_takes_what_is_plain() -> None:
    # were the interpreter to take all of it, equal bits would say nothing
    observer = hgo.StandardObserver(2, 20.0)._core
    t, y, u = record(observer)
    source = observer.record_source()
    wrong = source["text"].replace("fsub", "fadd")
    assert wrong != source["text"]
    made = llvm.compiled(wrong, "baseline")
    kernel = _core.RecordKernel(made.get_function_address(source["name"]), source["widths"])
    start = observer.initial()
    rows = [observer.run(t, y, u, start, kernel=of)["memory"] for of in (None, kernel)]
    assert not np.array_equal(*rows)


def test_a_nearly_even_clock_is_the_interpreters() -> None:
    # times such as 0.001 k differ in the last bit: kernels of some samples each would take longer
    observer = hgo.StandardObserver(2, 20.0)._core
    t = np.cumsum(STEP + (np.arange(900) // 31 % 2) * 2.0**-48)
    steps = np.diff(t)
    ends = np.flatnonzero(np.append(steps[1:] != steps[:-1], True)) + 1
    assert np.diff(ends, prepend=0).max() == 31
    source = observer.record_source()
    wrong = source["text"].replace("fsub", "fadd")
    made = llvm.compiled(wrong, "baseline")
    kernel = _core.RecordKernel(made.get_function_address(source["name"]), source["widths"])
    given = (t, np.sin(t)[:, None], np.zeros((900, 0)), observer.initial())
    rows = [observer.run(*given, kernel=of)["memory"] for of in (None, kernel)]
    assert np.array_equal(*rows)


def test_a_kernel_that_gives_other_bits_is_told_and_not_used() -> None:
    observer = hgo.StandardObserver(3, 20.0, method="rk4")
    t, y, _ = record(observer)
    right = observer.run(t, y[:, 0], engine="interpreter")
    source = dict(observer._core.record_source())
    source["text"] = source["text"].replace("fmul", "fadd")
    observer._records._source = source
    with pytest.warns(RuntimeWarning, match=r"llvmlite .*the interpreter is used"):
        result = observer.run(t, y[:, 0], engine="llvm")
    assert np.array_equal(result.memory, right.memory)


def test_a_kernel_counts_once_it_was_compared() -> None:
    """A record without samples compares nothing; one that begins with a gap its other samples."""
    observer = hgo.StandardObserver(3, 21.0, method="rk4")
    t = np.arange(1300) * STEP
    y = np.sin(t)
    source = dict(observer._core.record_source())
    source["text"] = source["text"].replace("fmul", "fadd")
    observer._records._source = source
    key = (source["text"], llvm.instructions())
    given = {"memory0": observer.initial_memory([0.3, 0.1, 0.0]), "engine": "llvm"}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for nothing in (np.full(1300, np.nan), np.where(t < 5.0, np.nan, y), y[:39]):
            shown = observer.run(STEP, nothing, **given).memory
            right = observer.run(STEP, nothing, **given | {"engine": "interpreter"}).memory
            assert np.array_equal(shown, right)
            assert compiled._compiled._kernels[key].agrees is None
    late = np.where(t < 0.7 * t[-1], np.nan, y)
    with pytest.warns(RuntimeWarning, match=r"llvmlite .*the interpreter is used") as told:
        observer.run(t, late, **given)
    assert told[0].filename == __file__
    assert compiled._compiled._kernels[key].agrees is False


def test_an_estimate_that_diverges_or_has_no_value_is_told_as_before() -> None:
    model = hgo.Model(states=["q", "w"], phi="-log(1 - q)")
    t = np.arange(600) * STEP
    for y, gain in ((np.linspace(0.0, 3.0, 600), 20.0), (np.full(600, 1e200), 20.0)):
        said = []
        for engine in ("interpreter", "llvm"):
            observer = hgo.StandardObserver(2, gain, model=model, method="euler")
            with pytest.raises(hgo.HgoError) as error:
                observer.run(t, y, engine=engine)
            said.append(str(error.value))
        assert said[0] == said[1]
        assert "no value" in said[0] or "diverged" in said[0] or "overflow" in said[0]


def test_engines_are_refused_where_they_cannot_be(monkeypatch: pytest.MonkeyPatch) -> None:
    observer = hgo.StandardObserver(2, 20.0)
    y = np.zeros(10)
    with pytest.raises(hgo.HgoError, match="engine = 'fast': must be one of auto, interp"):
        observer.run(1e-3, y, engine="fast")
    called = hgo.Model(states=["q", "w"], phi=lambda t, x, u: -x[0] if float(x[0]) > 0 else 0.0)
    with pytest.raises(hgo.HgoError, match=r"engine = 'llvm'.*write its equations"):
        hgo.StandardObserver(2, 20.0, model=called).run(1e-3, y, engine="llvm")
    monkeypatch.setattr(llvm, "binding", lambda: "llvmlite is not installed; pip install it")
    with pytest.raises(hgo.HgoError, match=r"engine = 'llvm'.*pip install"):
        observer.run(1e-3, y, engine="llvm")
    assert np.array_equal(observer.run(1e-3, y).x_hat, np.zeros((10, 2)))


def test_auto_compiles_what_has_had_samples_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    observer = hgo.StandardObserver(4, 17.25)
    key = (observer._core.record_source()["text"], llvm.instructions())
    y = np.sin(np.arange(1000) * 1e-3)
    observer.run(1e-3, y)
    assert key not in compiled._compiled
    monkeypatch.setattr(compiled, "_WORTH", 1e4)
    right = observer.run(1e-3, y, engine="interpreter").memory
    for _ in range(2):
        assert np.array_equal(observer.run(1e-3, y).memory, right)
    assert key in compiled._compiled
