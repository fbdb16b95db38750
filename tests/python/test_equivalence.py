"""The compiled core and the NumPy reference are the same laws, plants, schemes and streams."""

import itertools
import multiprocessing
import os
import traceback
import types
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
from equivalence_table import (
    CASES,
    JOINT,
    METHODS,
    PLACED,
    STEPS,
    TOLERANCE,
    difference,
    record,
    relative,
    uneven,
)
from matrices import some


def measured(case):
    """The difference of a case, or what went wrong."""
    try:
        return difference(case)
    except Exception:
        return traceback.format_exc()


@pytest.fixture(scope="module")
def gaps(request):
    """The differences of all cases that were asked for, on two processors if there are two."""
    chosen = [
        item.callspec.params["case"]
        for item in request.session.items
        if item.path == request.path and "case" in getattr(item, "fixturenames", ())
    ]
    context = multiprocessing.get_context("spawn")  # threads do not survive a fork
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1), context) as pool:
        results = pool.map(measured, chosen, chunksize=4)
        return dict(zip(map(str, chosen), results, strict=True))


@pytest.mark.parametrize("case", some(CASES, "equivalence"), ids=str)
def test_core_and_reference_agree(case, gaps, record_property):
    gap = gaps[str(case)]
    record_property("relative difference", gap)
    assert isinstance(gap, float), gap
    assert gap <= TOLERANCE


def test_names_are_unique_and_every_choice_is_there():
    """A case that is listed twice, or a choice that nobody lists, would go unseen."""
    names = [str(case) for case in CASES]
    assert len(set(names)) == len(names)
    for kind in ("simulate", "record"):
        long, steps = set(), []
        for case in CASES:
            if case.kind == kind:
                steps.append(case.spec.get("steps", STEPS))
                long |= {case.law} if steps[-1] >= 10_000 else set()
        assert long == {case.law for case in CASES if case.kind == kind}, kind
        assert min(steps) >= 1_000
    built_in = [case for case in CASES if not case.law.startswith("own")]
    studies = [case.spec for case in built_in if case.kind == "simulate"]
    observers = [case.spec["observer"] for case in built_in if "observer" in case.spec]
    timed = [o for o in observers if o.get("timing") == "current" or o.get("method") in PLACED]
    assert {o["method"] for o in timed} > set(PLACED) and len(timed) >= 12
    observers = [o for o in observers if o not in timed]
    chosen = {(o["n"], o["gain"]["law"], o["method"]) for o in observers if o["kind"] == "standard"}
    for i, j, pairs in ((0, 1, 5 * 3), (0, 2, 5 * 5), (1, 2, 3 * 5)):
        assert len({(choice[i], choice[j]) for choice in chosen}) == pairs
    assert sum(n == 2 for n, _, _ in chosen) == 3 * 5
    kinds = {o["kind"] for o in observers}
    assert len(kinds) == 8
    for kind in kinds - {"sampled-data", "reduced-order", "window"}:
        joint = {
            spec["observer"]["method"]
            for spec in studies
            if spec["observer"]["kind"] == kind and spec.get("mode") == "joint"
        }
        assert joint == ({"rk4"} if kind == "modified" else set(JOINT)), kind
        assert len({o["method"] for o in observers if o["kind"] == kind}) == 5, kind
    moved = {(spec["plant"]["kind"], spec.get("plant_method", "euler")) for spec in studies}
    assert len(moved) == 3 * 4 + 7 + 3  # ships: not held
    laws = {"none", "uniform", "normal", "student-t", "laplace", "impulsive", "samples"}
    assert {spec["noise"]["kind"] for spec in studies} == laws


def test_own_models_of_every_form_meet_every_method_and_timing():
    own = [case for case in CASES if case.kind == "loop"]
    manners = set(itertools.product((*METHODS, *PLACED), ("predictor", "current")))
    met = {}
    for case in own:
        observer = case.spec["observer"]
        form = observer["model"].get("form", "none")
        chain = observer.get("observers", (observer,))[0]
        met.setdefault(form, set()).add((chain.get("method"), chain.get("timing")))
    forms = {"phase", "chains", "triangular", "nonlinear-chain", "sampled", "strict-feedback"}
    assert met.keys() == forms | {"none"}
    of_phase = {("proper", timing) for timing in ("predictor", "current")}
    of_phase |= {("implicit", "current"), ("inter-sample", "predictor")}
    for form in ("phase", "chains", "triangular", "nonlinear-chain"):
        of_form = of_phase if form in ("phase", "triangular") else set()
        assert met[form] == manners | of_form, form
    for law in ("standard", "low-power"):
        beside = [case for case in own if case.law == f"own beside built-in, {law}"]
        assert {case.spec["built_in"]["kind"] for case in beside} == {"lee", "input"}
        assert len(beside) == 2 * len(manners)


def test_a_record_of_several_outputs_has_gaps_of_each_and_of_all():
    """Uneven steps, inputs that move, and outputs at rates of their own."""
    observer = types.SimpleNamespace(n_y=3, n_u=2)
    t, y, u = uneven(observer)
    assert np.ptp(np.diff(t)) > 0.5 * np.diff(t).mean()
    seen = np.isfinite(y)
    assert {tuple(row) for row in seen.tolist()} >= {
        (True, False, False),
        (True, True, False),
        (True, False, True),
        (False, False, False),
    }
    assert np.ptp(u, axis=0).min() > 1.0


def test_a_difference_is_seen():
    """The measure itself: one part in 1e11 in one sample, a sign, a lost NaN."""
    y = record()["position"]
    assert relative(y, y, axis=0) == 0.0
    other = y.copy()
    other[5000, 1] *= 1.0 + 1e-11
    assert TOLERANCE < relative(other, y, axis=0) < 1e-10
    assert relative(-y, y, axis=0) > 1.0
    other = y.copy()
    other[5, 1] = 0.0  # missing there
    assert relative(other, y, axis=0) == float("inf")
