"""Copies that meet: a start of copies alike is refused, a memory that a run has reached goes on."""

import copy
import pickle

import numpy as np
import pytest

from hgo_rs import (
    AdaptiveGain,
    Config,
    HgoError,
    ModifiedObserver,
    RepelledCollection,
    SanfelicePraly,
    cli,
    estimate,
    load,
    simulate,
)
from hgo_rs.observers import CopiesMetWarning

LAW = {"gain": AdaptiveGain(10.0, 1.0, 0.183), "k": [2.0, 2.0], "k_bar": [0.0558, 0.0317]}
FIVE = LAW | {"copies": 5, "method": "euler", "timing": "predictor"}
DT, COUNT = 0.2, 6000
REST = np.zeros(COUNT)
"""A record at rest: the copies sink into the smallest numbers there are, and two meet."""


def spread():
    observer = RepelledCollection(**FIVE)
    observer.memory = observer.spread([[0.05 * i * (-1) ** i, 0.0] for i in range(5)])
    return observer


def distinct(memory):
    return len(np.unique(memory.reshape(5, 3), axis=0))


@pytest.fixture(scope="module")
def whole():
    observer = spread()
    with pytest.warns(CopiesMetWarning, match="of 5 differ"):
        result = observer.run(DT, REST, memory0=observer.memory)
    assert distinct(result.memory[0]) == 5
    assert distinct(result.memory[-1]) < 5
    return result


@pytest.fixture
def met(whole):
    """An observer where copies have met, and what a run says of the steps after."""
    first = next(k for k in range(COUNT) if distinct(whole.memory[k]) < 5)
    observer = RepelledCollection(**FIVE)
    observer.memory = whole.memory[first]
    return observer, whole.memory[first : first + 9]


def test_steps_go_on_where_a_run_stopped(met):
    observer, expected = met
    with pytest.warns(CopiesMetWarning, match="identical copies never separate"):
        observer.step(0.0, dt=DT)
    np.testing.assert_array_equal(observer.memory, expected[1])
    others = [copy.deepcopy(observer), pickle.loads(pickle.dumps(observer))]
    for other in (observer, *others):
        other.step(0.0, dt=DT)
        np.testing.assert_array_equal(other.memory, expected[2])


def test_runs_go_on_where_a_run_stopped(met):
    observer, expected = met
    with pytest.warns(CopiesMetWarning):
        again = observer.run(DT, REST[:9], memory0=observer.memory)
    np.testing.assert_array_equal(again.memory, expected)
    with pytest.warns(CopiesMetWarning):
        observer.reset(memory0=expected[4])
    with pytest.warns(CopiesMetWarning):
        observer.step(0.0, dt=DT)
    np.testing.assert_array_equal(observer.memory, expected[5])


@pytest.mark.filterwarnings("ignore::hgo_rs.observers.CopiesMetWarning")
@pytest.mark.parametrize("way", ["file", "copy", "pickle"])
def test_what_was_saved_goes_on(met, tmp_path, way):
    observer, expected = met
    if way == "file":
        observer.save(tmp_path / "observer.toml")
        other = load(tmp_path / "observer.toml").observer()
    else:
        other = copy.copy(observer) if way == "copy" else pickle.loads(pickle.dumps(observer))
    np.testing.assert_array_equal(other.memory, expected[0])
    for row in expected[1:]:
        other.step(0.0, dt=DT)
        np.testing.assert_array_equal(other.memory, row)
    assert Config.of(other).observer().memory.tolist() == expected[-1].tolist()


def test_a_memory_that_is_that_of_the_start_by_chance_is_saved(tmp_path):
    observer = RepelledCollection(**FIVE)
    observer.memory = observer.initial_memory()
    observer.save(tmp_path / "observer.toml")
    with pytest.warns(CopiesMetWarning, match="1 of 5 differ"):
        load(tmp_path / "observer.toml").observer().step(0.0, dt=DT)


@pytest.mark.filterwarnings("ignore::hgo_rs.observers.CopiesMetWarning")
def test_a_log_is_estimated_past_the_meeting(tmp_path, monkeypatch):
    """Of the whole log at once and in chunks the same, from Python and from the command line."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(COUNT) * DT
    rows = "".join(f"{time!r},0.0\n" for time in t.tolist())
    (tmp_path / "log.csv").write_text("t,q\n" + rows)
    observer = spread()
    observer.save("observer.toml", time="t", output="q")
    result = estimate("log.csv", "observer.toml")
    np.testing.assert_array_equal(
        result.memory, observer.run(t, REST, memory0=observer.memory).memory
    )
    monkeypatch.setattr("hgo_rs.logs.read.CHUNK", 100)
    with pytest.raises(SystemExit) as end:
        cli.main(["estimate", "log.csv", "--config", "observer.toml", "--out", "out.csv"])
    assert end.value.code == 0
    made = np.genfromtxt("out.csv", delimiter=",", names=True)
    np.testing.assert_array_equal(made["x_hat1"], result.x_hat[:, 0])


def test_a_simulation_goes_on_too(met):
    observer, _ = met
    plant = {"plant": SanfelicePraly(nu1=1.0), "x0": [0.0, 0.0], "dt": 0.01, "steps": 3}
    with pytest.warns(CopiesMetWarning):
        simulate(observer=observer, **plant, memory0=observer.memory)
    with pytest.raises(HgoError, match="starts of the copies"):
        simulate(observer=observer, **plant)


STARTS = {
    "run": lambda law: law.run(DT, REST[:9]),
    "run from an estimate": lambda law: law.run(DT, REST[:9], x_hat0=[1.0, 0.0]),
    "run from a gain": lambda law: law.run(DT, REST[:9], r0=2.0),
    "step": lambda law: law.step(0.0, dt=DT),
    "reset": lambda law: (law.reset(), law.step(0.0, dt=DT)),
    "reset to an estimate": lambda law: (law.reset([1.0, 0.0]), law.step(0.0, dt=DT)),
    "another timing": lambda law: law.with_timing("predictor").step(0.0, dt=DT),
    "written to": lambda law: (law.memory.__setitem__(0, 1.0), law.step(0.0, dt=DT)),
    "copied": lambda law: copy.deepcopy(law).step(0.0, dt=DT),
    "pickled": lambda law: pickle.loads(pickle.dumps(law)).step(0.0, dt=DT),
    "saved": lambda law: Config.of(law).observer().step(0.0, dt=DT),
}


@pytest.mark.parametrize("start", STARTS)
@pytest.mark.parametrize("kind", [RepelledCollection, ModifiedObserver])
def test_starts_of_copies_alike_are_refused(start, kind):
    with pytest.raises(HgoError, match=r"starts of the copies.*spread"):
        STARTS[start](kind(**LAW, timing="current"))


def test_a_reset_forgets_the_memory_that_was_given(met):
    observer, _ = met
    observer.reset()
    with pytest.raises(HgoError, match="starts of the copies"):
        observer.step(0.0, dt=DT)


def test_a_log_is_not_estimated_from_copies_alike(tmp_path):
    (tmp_path / "log.csv").write_text("t,q\n0.0,0.0\n0.2,0.0\n")
    RepelledCollection(**FIVE).save(tmp_path / "observer.toml", time="t", output="q")
    with pytest.raises(HgoError, match="starts of the copies"):
        estimate(tmp_path / "log.csv", tmp_path / "observer.toml")
    told = ["estimate", str(tmp_path / "log.csv"), "--config", str(tmp_path / "observer.toml")]
    with pytest.raises(SystemExit) as end:
        cli.main([*told, "--out", str(tmp_path / "out.csv")])
    assert end.value.code != 0
    assert not (tmp_path / "out.csv").exists()
