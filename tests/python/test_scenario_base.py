"""Rows and their criteria, the registry, the memoised backend calls."""

import math
import sys
import types

import numpy as np
import pytest

from hgo_rs import scenarios
from hgo_rs.scenarios import base
from hgo_rs.scenarios.base import Context, Outcome, Row, row, spec_key


@pytest.mark.parametrize(
    ("ours", "criterion", "ok", "tolerance"),
    [
        (1.0009, {"expected": 1.0, "rel": 1e-3}, True, "rel 0.001"),
        (1.0011, {"expected": 1.0, "rel": 1e-3}, False, "rel 0.001"),
        (-2.0, {"expected": -2.001, "abs": 2e-3}, True, "abs 0.002"),
        (0.0, {"expected": 1e-9, "rel": 1e-3}, False, "rel 0.001"),
        (0.0, {"expected": 1e-9, "rel": 1e-3, "abs": 1e-8}, True, "rel 0.001 or abs 1e-8"),
        (3.0, {"at_most": 3.0}, True, "≤ 3"),
        (3.1, {"at_most": 3.0}, False, "≤ 3"),
        (3.1, {"at_least": 3.0}, True, "≥ 3"),
        (2.9, {"at_least": 3.0}, False, "≥ 3"),
        ("stable", {"expected": "stable"}, True, "exact"),
        (True, {"expected": True}, True, "exact"),
        (np.bool_(False), {"expected": True}, False, "exact"),
        (np.int64(924), {"expected": 924}, True, "exact"),
        (math.nan, {"expected": 0.0, "abs": 1e9}, False, "abs 1e9"),
        (math.nan, {"at_most": 1.0}, False, "≤ 1"),
        (math.inf, {"expected": math.inf, "rel": 0.1}, False, "rel 0.1"),
    ],
)
def test_row_judges(ours, criterion, ok, tolerance):
    result = row("quantity", ours, **criterion)
    assert (result.ok, result.tolerance) == (ok, tolerance)


def test_row_holds_plain_values():
    result = row("q", np.float64(2.5), expected=np.float32(2.5), abs=0.1, paper=np.int64(3))
    assert result == Row("q", 3, 2.5, 2.5, "abs 0.1", True, "")
    assert {type(v) for v in (result.ours, result.expected, result.paper)} == {float, int}
    assert row("q", np.array([[1.5]]), at_most=2.0).ours == 1.5
    assert row("q", True, expected=True, paper="holds", note="why").ours == "yes"


@pytest.mark.parametrize(
    ("criterion", "message"),
    [
        ({}, "exactly one of expected, at_most, at_least; got none"),
        ({"at_most": 1.0, "at_least": 0.0}, "got at_most, at_least"),
        ({"expected": 1.0, "rel": 0.1, "at_most": 2.0}, "got expected, at_most"),
        ({"expected": 1.0}, "needs rel or abs"),
        ({"at_most": 1.0, "rel": 0.1}, "rel = 0.1 needs expected"),
        ({"expected": 1.0, "rel": -0.1}, "must be finite and >= 0"),
        ({"expected": 1.0, "abs": math.nan}, "must be finite and >= 0"),
        ({"expected": "stable", "abs": 0.1}, "a tolerance needs numbers"),
    ],
)
def test_row_refuses_a_criterion_that_does_not_judge(criterion, message):
    with pytest.raises(ValueError, match="row 'quantity'") as caught:
        row("quantity", 1.0, **criterion)
    assert message in str(caught.value)


def test_row_refuses_what_is_not_one_value():
    with pytest.raises(ValueError, match=r"shape \(2,\)"):
        row("q", np.zeros(2), at_most=1.0)
    with pytest.raises(ValueError, match="ours is None"):
        row("q", None, at_most=1.0)
    with pytest.raises(TypeError, match="a number or a string"):
        row("q", object(), at_most=1.0)


def test_outcome_is_ok_only_with_rows():
    good, bad = row("a", 1.0, at_most=2.0), row("b", 3.0, at_most=2.0)
    assert Outcome([good]).ok
    assert not Outcome([good, bad]).ok
    assert not Outcome([]).ok


@pytest.fixture
def registry(monkeypatch):
    fresh: dict = {}
    monkeypatch.setattr(base, "REGISTRY", fresh)
    monkeypatch.setattr(scenarios, "REGISTRY", fresh)
    return fresh


def test_registration(registry):
    def outcome(ctx):
        return Outcome([row("seed", ctx.seed, expected=7)])

    assert base.scenario("lee-fig1", title="A", paper="lee")(outcome) is outcome
    assert list(registry) == ["lee-fig1"]
    assert registry["lee-fig1"](Context(seed=7)).ok

    def other(ctx):
        return Outcome([])

    other.__module__ = "elsewhere"
    with pytest.raises(ValueError, match="'lee-fig1' is defined twice"):
        base.scenario("lee-fig1", title="B", paper="lee")(other)
    with pytest.raises(ValueError, match="paper 'leee' is not one of lee, sanfelice-praly"):
        base.scenario("x", title="", paper="leee")


def test_load_keeps_the_papers_order_and_find_names_the_nearest(registry, monkeypatch):
    monkeypatch.setattr(scenarios.importlib, "import_module", lambda name: None)
    for id, paper in (("fu-fig1", "fu"), ("lee-fig2", "lee"), ("lee-fig1", "lee")):
        base.scenario(id, title=id, paper=paper)(lambda ctx: Outcome([]))
    assert list(scenarios.load()) == ["lee-fig2", "lee-fig1", "fu-fig1"]
    assert scenarios.find("fu-fig1").paper == "fu"
    with pytest.raises(scenarios.UnknownScenarioError, match=r"'lee-fig9'; nearest: .*lee-fig1"):
        scenarios.find("lee-fig9")
    with pytest.raises(ValueError, match=r"unknown scenario 'zzz'; see `hgo list`"):
        scenarios.find("zzz")


def test_every_scenario_belongs_to_its_paper():
    known = scenarios.load()
    assert {s.paper for s in known.values()} == set(scenarios.PAPERS)
    for id, s in known.items():
        assert id == s.id
        assert id.startswith(s.paper + "-")
        assert s.title


class Backend:
    """Counts calls; returns an array that depends on the spec."""

    def __init__(self):
        self.calls = []

    def simulate(self, spec):
        self.calls.append(("simulate", spec))
        return {"rms": np.full((2, 1), float(spec["seed"])), "nested": {"edges": np.arange(3.0)}}

    def coupled_paths(self, spec):
        self.calls.append(("coupled_paths", spec))
        return {"coarse": np.zeros((1, 2))}


def test_equal_specs_are_computed_once():
    backend = Backend()
    ctx = Context(module=backend)
    spec = {"seed": 1, "x0": [1.0, 2.0], "plant": {"kind": "lee"}, "runs": 3, "steps": 10}
    same = {"steps": 10, "runs": 3, "x0": np.array([1, 2]), "plant": {"kind": "lee"}, "seed": 1.0}
    first, second = ctx.simulate(spec), ctx.simulate(same)
    assert first["rms"] is second["rms"]
    assert len(backend.calls) == 1
    assert ctx.computed_steps == 30
    assert ctx.simulate({**spec, "seed": 2})["rms"][0, 0] == 2.0
    assert ctx.computed_steps == 60
    # The same dict for another function is another call.
    ctx.coupled_paths(spec)
    assert [name for name, _ in backend.calls] == ["simulate", "simulate", "coupled_paths"]


def test_shared_results_cannot_be_changed():
    ctx = Context(module=Backend())
    result = ctx.simulate({"seed": 1})
    with pytest.raises(ValueError, match="read-only"):
        result["rms"][0, 0] = 5.0
    with pytest.raises(ValueError, match="read-only"):
        result["nested"]["edges"][0] = 5.0
    result["added"] = 1
    assert "added" not in ctx.simulate({"seed": 1})


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 2**53 + 1},
        {"seed": -1},
        {"seed": 2**70},
        {"x0": [1.0, 2.0 + 1e-15]},
        {"x0": [[1.0, 2.0]]},
        {"x0": [1.0, 2.0, 0.0]},
        {"noise": {"kind": "none", "hold": 1}},
        {"noise": {"kind": "uniform"}},
        {"settle": 0.01},
        {"multiplicative": True},
        {"windows": [[0, 1], [1, 3]]},
    ],
)
def test_different_specs_have_different_keys(change):
    spec = {
        "seed": 2**53,
        "x0": [1.0, 2.0],
        "noise": {"kind": "none"},
        "settle": None,
        "multiplicative": False,
        "windows": [[0, 1], [1, 2]],
    }
    assert spec_key("simulate", {**spec, **change}) != spec_key("simulate", spec)


def test_spec_key_refuses_what_it_cannot_tell_apart():
    with pytest.raises(TypeError, match="a spec holds numbers"):
        spec_key("simulate", {"plant": object()})


def test_backend_names():
    with pytest.raises(ValueError, match="backend 'fortran' is not one of rust, numpy"):
        Context("fortran")


def test_backend_module_is_imported_on_first_use(monkeypatch):
    module = types.ModuleType("hgo_rs.fake_backend")
    module.simulate = lambda spec: {"got": spec["seed"]}
    monkeypatch.setitem(sys.modules, "hgo_rs.fake_backend", module)
    monkeypatch.setitem(base.BACKENDS, "numpy", "hgo_rs.fake_backend")
    assert Context("numpy").simulate({"seed": 4}) == {"got": 4}
