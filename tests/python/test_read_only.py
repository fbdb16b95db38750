"""What describes an object can be looked at and copied; an edit of it is refused, and an edit of
what the object was made from changes nothing."""

import copy
import json
import pickle

import numpy as np
import pytest

import hgo_rs
from hgo_rs import (
    AdaptiveGain,
    Config,
    FixedStep,
    HgoError,
    Lee,
    Model,
    ModifiedObserver,
    MultiOutputObserver,
    NormalNoise,
    PeakingFreeObserver,
    Plant,
    RecordedNoise,
    ReducedOrderObserver,
    RepelledCollection,
    SampledDataObserver,
    Ship,
    Sines,
    StandardObserver,
    WindowObserver,
    simulate,
    study,
)

OWN = Model(states=["q", "v"], inputs=["u"], parameters={"M": 2.0}, phi="u/M - q")
CHAINS = Model(states=["q", "v", "p"], orders=[2, 1], phi=["-q", "-p"])
ADAPTIVE = AdaptiveGain(10.0, 0.0025, 0.183)
COPIES = {"k": [2.0, 2.0], "k_bar": [0.0558, 0.0317]}


def experiment(**changes):
    return simulate(
        **{
            "plant": Lee(),
            "observer": StandardObserver(2, 20.0),
            "noise": RecordedNoise(values=np.ones(11)),
            "x0": [1.0, 0.0],
            "dt": 1e-3,
            "steps": 10,
            "every": 1,
            "windows": [(0.0, 0.01)],
        }
        | changes
    )


DESCRIBED = {
    "standard": StandardObserver(2, 20.0, model=OWN, method="zoh"),
    "peaking-free": PeakingFreeObserver(3, 20.0, saturation=1.0),
    "collection": RepelledCollection(ADAPTIVE, **COPIES),
    "modified": ModifiedObserver(ADAPTIVE, **COPIES),
    "sampled-data": SampledDataObserver(),
    "reduced-order": ReducedOrderObserver(0.1),
    "window": WindowObserver.savitzky_golay(5, 2, 0.01),
    "chains": MultiOutputObserver(
        [StandardObserver(2, 20.0), StandardObserver(1, 20.0)], model=CHAINS
    ),
    "model": OWN,
    "plant": Plant(states=["q", "v"], drift=["v", "-q"], output="q"),
    "ship": Ship(w=[0.1, 0.2, 0.3]),
    "gain": ADAPTIVE,
    "schedule": FixedStep(1e-3),
    "result": experiment(),
}


def parts(value):
    """All dicts and lists of a description."""
    if isinstance(value, dict):
        yield value
        for inner in value.values():
            yield from parts(inner)
    elif isinstance(value, (list, tuple)):
        if isinstance(value, list):
            yield value
        for inner in value:
            yield from parts(inner)


EDITS = {
    dict: (
        lambda d: d.__setitem__("ell", 200.0),
        lambda d: d.__delitem__(next(iter(d))),
        lambda d: d.update(ell=200.0),
        lambda d: d.setdefault("other", 1),
        lambda d: d.pop(next(iter(d))),
        lambda d: d.popitem(),
        lambda d: d.clear(),
        lambda d: d.__ior__({"ell": 1.0}),
    ),
    list: (
        lambda v: v.__setitem__(slice(0, 1), [9]),
        lambda v: v.__delitem__(slice(0, 1)),
        lambda v: v.append(1),
        lambda v: v.extend([1]),
        lambda v: v.insert(0, 1),
        lambda v: v.pop(),
        lambda v: v.remove(v[0]),
        lambda v: v.clear(),
        lambda v: v.reverse(),
        lambda v: v.sort(),
        lambda v: v.__iadd__([1]),
        lambda v: v.__imul__(2),
    ),
}


@pytest.mark.parametrize("name", DESCRIBED)
def test_every_part_of_a_spec_refuses_edits(name):
    spec = DESCRIBED[name].spec
    before = copy.deepcopy(spec)
    found = list(parts(spec))
    assert found[0] is spec
    for part in found:
        for edit in EDITS[dict if isinstance(part, dict) else list]:
            if not part and edit is not EDITS[dict][0]:
                continue
            with pytest.raises(HgoError, match="read-only") as refused:
                edit(part)
            assert isinstance(refused.value, TypeError)  # as of types.MappingProxyType
    assert repr(spec) == repr(before)
    with pytest.raises(AttributeError):
        DESCRIBED[name].spec = {}


@pytest.mark.parametrize("name", [name for name in DESCRIBED if name != "result"])
def test_a_spec_is_plain_data_to_look_at(name):
    spec = DESCRIBED[name].spec
    plain = copy.deepcopy(spec)
    assert type(plain) is dict
    assert all(type(part) in (dict, list) for part in parts(plain))
    assert plain == spec
    assert spec == plain
    assert repr(plain) == repr(spec)
    assert json.loads(json.dumps(spec)) == json.loads(json.dumps(plain))
    again = pickle.loads(pickle.dumps(spec))
    assert again == spec
    with pytest.raises(HgoError):
        again["kind"] = "other"
    other = spec | {"kind": "other"}
    assert type(other) is dict
    assert other["kind"] == "other"
    assert spec == plain
    plain["edited"] = True
    assert "edited" not in spec


def test_an_edit_changes_no_step():
    """A step of a new length makes the table of gains anew, from the law as it was made."""
    observer, untouched = (StandardObserver(2, 20.0, model=OWN, method="zoh") for _ in range(2))
    for dt in (1e-3, 2e-3):
        with pytest.raises(HgoError):
            observer.spec["gain"]["ell"] = 200.0
        with pytest.raises(HgoError):
            observer.spec["model"]["table"]["constants"][0] = 3.0
        with pytest.raises(HgoError):
            OWN.spec["table"]["ops"].clear()
        a, b = observer.step(1.0, 0.5, dt=dt), untouched.step(1.0, 0.5, dt=dt)
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("attribute", ["model", "n", "n_y", "n_u", "timing", "gain", "x_hat"])
def test_what_an_observer_is_cannot_be_set(attribute):
    observer = StandardObserver(2, 20.0)
    with pytest.raises(AttributeError):
        setattr(observer, attribute, 1)


def test_copies_and_pickles_of_observers_are_read_only_too():
    observer = StandardObserver(2, 20.0, model=OWN)
    observer.step(1.0, 0.0, dt=1e-3)
    others = [copy.copy(observer), copy.deepcopy(observer), pickle.loads(pickle.dumps(observer))]
    expected = observer.step(1.0, 0.0, dt=1e-3)
    for other in others:
        assert other.spec == observer.spec
        assert other.spec["model"] == other.model.spec
        with pytest.raises(HgoError):
            other.spec["gain"]["ell"] = 1.0
        np.testing.assert_array_equal(other.step(1.0, 0.0, dt=1e-3), expected)


def test_what_an_observer_was_made_from_may_be_edited():
    k, poles, level = [2.0, 2.0], np.array([-1.0, -2.0]), np.array([1.0, 2.0])
    by_k, by_poles = StandardObserver(2, 20.0, k=k), StandardObserver(2, 20.0, poles=poles)
    saturated = PeakingFreeObserver(3, 20.0, saturation=level)
    parameters = {"M": 2.0}
    model = Model(states=["q", "v"], parameters=parameters, phi="-q/M")
    before = [o.spec for o in (by_k, by_poles, saturated, model)]
    before = copy.deepcopy(before)
    k[0], poles[0], level[0], parameters["M"] = 3.0, -9.0, 7.0, 5.0
    assert [o.spec for o in (by_k, by_poles, saturated, model)] == before
    assert model.parameters == {"M": 2.0}
    given = {"kind": "standard", "n": 1, "k": [1.0], "gain": {"law": "constant", "ell": 5.0}}
    given |= {"model": {"kind": "none"}, "method": "euler", "timing": "predictor"}
    observer = hgo_rs.Observer(given)
    given["gain"]["ell"] = 50.0
    assert observer.gain == 5.0
    w = [0.1, 0.2, 0.3]
    ship = Ship(w=w)
    w[0] = 9.0
    assert ship.w == (0.1, 0.2, 0.3)


def test_a_memory_that_was_given_may_be_edited():
    observer = StandardObserver(2, 20.0, method="euler", timing="predictor")
    start = np.array([1.0, 2.0])
    observer.memory = start
    start[0] = 9.0
    assert observer.memory.tolist() == [1.0, 2.0]
    observer.reset(memory0=start)
    start[0] = -9.0
    assert observer.memory.tolist() == [9.0, 2.0]
    observer.memory[0] = 5.0  # where it stands may be written to
    assert observer.x_hat.tolist() == [5.0, 2.0]
    assert start.tolist() == [-9.0, 2.0]
    result = observer.run(1e-3, np.zeros(5))
    kept = result.memory.copy()
    observer.memory = result.memory[-1]
    observer.memory[0] = 100.0
    np.testing.assert_array_equal(result.memory, kept)


def test_the_arrays_of_a_run_are_read_only():
    law = AdaptiveGain(10.0, 0.0025, 0.183)
    observer = StandardObserver(2, law, method="euler", timing="predictor")
    y = np.array([0.1, np.nan, 0.3, 0.4])
    t = np.arange(4) * 1e-3
    for clock in (1e-3, t):
        result = observer.run(clock, y)
        for name in ("time", "x_hat", "auxiliary", "innovation", "missing", "gain", "y", "memory"):
            with pytest.raises(ValueError, match="read-only"):
                getattr(result, name)[0] = 1
            with pytest.raises(ValueError, match="read-only"):
                getattr(result.rows(slice(1, 3)), name)[0] = 1
        expected = y[2] - result.x_hat[2, 0]
        y[2], t[2] = 7.0, 8.0  # the caller's own, which stay writeable
        assert result.y[2, 0] == 0.3
        assert result.time[2] == 2e-3
        assert result.innovation[2, 0] == expected
        y[2], t[2] = 0.3, 2e-3


def test_the_arrays_of_a_study_are_read_only():
    def build(ell):
        return {"plant": Lee(), "observer": StandardObserver(2, ell), "x0": [1.0, 0.0], "dt": 1e-3,
                "steps": 10, "every": 1, "windows": [(0.0, 0.01)]}  # fmt: skip

    several = study(build, grid={"ell": [20.0, 40.0]}, runs=2)
    table, result = several.table, several[1]
    arrays = [result.rms, result.peak, result.final_x, result.x, result.x_hat, result.time]
    for array in (*arrays, result.diverged_at, result.spec["x0"], several.outputs[1]["rms"]):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    assert all(np.array_equal(several.table[name], table[name]) for name in table)


def test_the_record_of_a_simulation_is_the_callers():
    result = experiment()
    memory = result.memory.copy()
    result.y[0, 3:5] = np.nan  # to try a gap
    with pytest.raises(ValueError, match="read-only"):
        result.x_hat[...] *= 180.0
    np.testing.assert_array_equal(result.memory, memory)
    with pytest.raises(ValueError, match="read-only"):
        result.spec["x0"][0] = 0.0


def test_what_a_simulation_was_made_from_may_be_edited():
    values, x0, windows, sines = np.ones(11), np.array([1.0, 0.0]), [[0.0, 0.01]], [[1.0, 2.0, 0.0]]
    noise = RecordedNoise(values=values, sines=sines)
    result = experiment(noise=noise, x0=x0, windows=windows)
    values[:], x0[:], windows[0][1], sines[0][0] = 5.0, 3.0, 0.005, 4.0
    again = experiment(noise=noise, x0=result.spec["x0"], windows=[(0.0, 0.01)])
    np.testing.assert_array_equal(again.rms, result.rms)
    assert result.spec["x0"].tolist() == [1.0, 0.0]
    assert Sines(sines=sines).spec(1e-3)["sines"] == [[4.0, 2.0, 0.0]]
    spec = NormalNoise(std=0.1).spec(1e-3)  # made for the caller
    spec["std"] = 5.0
    assert NormalNoise(std=0.1).spec(1e-3)["std"] == 0.1


def test_what_a_study_was_made_from_may_be_edited():
    poles = [-1.0, -2.0]

    def build(poles):
        return {"plant": Lee(), "observer": StandardObserver(2, 20.0, poles=poles),
                "x0": [1.0, 0.0], "dt": 1e-3, "steps": 10}  # fmt: skip

    result = study(build, grid={"poles": [poles, [-3.0, -4.0]]})
    poles[0] = -9.0
    assert result.table["poles"].tolist() == ["[-1.0, -2.0]", "[-3.0, -4.0]"]
    assert result.parameters[0]["poles"] == [-1.0, -2.0]
    for edit in (
        lambda: result.parameters[0].update(poles=[-5.0]),
        lambda: result.parameters[0]["poles"].append(-5.0),
        lambda: result.parameters.clear(),
        lambda: result.axes["poles"].reverse(),
    ):
        with pytest.raises(HgoError, match="read-only"):
            edit()


def test_a_configuration_is_read_only():
    given = {"format": 1, "observer": "standard", "order": 2, "gain": 20.0, "poles": [-1.0, -2.0]}
    config = Config(given)
    given["gain"] = "twenty"
    given["poles"][0] = -9.0
    assert config.data["gain"] == 20.0
    assert config.data["poles"] == [-1.0, -2.0]
    with pytest.raises(HgoError, match="read-only"):
        config.data["gain"] = 200.0
    with pytest.raises(HgoError, match="read-only"):
        config.data["poles"][0] = 200.0
    assert config.replace(gain=30.0).observer().gain == 30.0
    assert Config.from_toml(config.to_toml()) == config
    assert pickle.loads(pickle.dumps(config)) == config
