"""The compiled core and the NumPy reference are the same laws, plants, schemes and streams."""

import pytest
from equivalence_table import CASES, STEPS, TOLERANCE, difference, record, relative


@pytest.mark.parametrize("case", CASES, ids=str)
def test_core_and_reference_agree(case, record_property):
    gap = difference(case)
    record_property("relative difference", gap)
    assert gap <= TOLERANCE


def test_names_are_unique_and_every_choice_is_there():
    """A case that is listed twice, or a choice that nobody lists, would go unseen."""
    names = [str(case) for case in CASES]
    assert len(set(names)) == len(names)
    studies = [case.spec for case in CASES if case.kind == "simulate"]
    assert min(spec["steps"] for spec in studies) >= STEPS >= 10_000
    observers = [case.spec["observer"] for case in CASES if "observer" in case.spec]
    standard = {
        (o["n"], o["gain"]["law"], o["method"]) for o in observers if o["kind"] == "standard"
    }
    assert len(standard) == 5 * 3 * 5
    kinds = {o["kind"] for o in observers}
    assert len(kinds) == 7
    for kind in kinds - {"sampled-data", "reduced-order"}:
        joint = {
            spec["observer"]["method"]
            for spec in studies
            if spec["observer"]["kind"] == kind and spec.get("mode") == "joint"
        }
        assert joint == {"euler", "rk4", "bogacki-shampine"}, kind
        assert len({o["method"] for o in observers if o["kind"] == kind}) == 5, kind
    moved = {(spec["plant"]["kind"], spec.get("plant_method", "euler")) for spec in studies}
    assert len(moved) == 3 * 4 + 7 + 3  # ships: not held
    assert {spec["noise"]["kind"] for spec in studies} == {"none", "uniform", "normal", "samples"}


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
