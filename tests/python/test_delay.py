"""The longest delay of samples: closed forms, and a difference equation with a buffer."""

from __future__ import annotations

import math

import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs.design import continuous, delay_limit


def test_two_poles_have_a_closed_form() -> None:
    """Poles -1: omega^4 = 4 omega^2 + 1, and D = arctan(2 omega)/omega."""
    omega = math.sqrt(2.0 + math.sqrt(5.0))
    found = delay_limit(hgo.StandardObserver(2, 10.0, k=[2.0, 1.0]).spec)
    assert found == pytest.approx(math.atan(2.0 * omega) / omega / 10.0, rel=1e-12)


@pytest.mark.parametrize(
    "observer",
    [
        hgo.StandardObserver(1, 4.0),
        hgo.StandardObserver(3, 5.0),
        hgo.StandardObserver(4, 2.0, k=[5.0, 9.0, 7.0, 2.0]),
        hgo.LowPowerObserver(3, 3.0),
        hgo.HighGainObserver("filtered", 2, 3.0, filters=1),
    ],
    ids=lambda observer: f"{observer.spec['kind']} {observer.n}",
)
def test_below_it_errors_decay_and_beyond_they_grow(observer: hgo.Observer) -> None:
    """The law by short Euler steps, its first estimate kept for the delay: eigenvalues."""
    law = continuous(observer.spec)
    limit, parts = delay_limit(observer.spec), 400
    for delay, stable in ((0.97 * limit, True), (1.03 * limit, False)):
        h, m = delay / parts, len(law.g)
        step = np.zeros((m + parts, m + parts))
        step[:m, :m] = np.eye(m) + h * law.ell * law.f
        step[:m, -1] = -h * law.ell * law.g  # x_1 of `parts` steps ago
        step[m, 0] = 1.0
        step[m + 1 :, m:-1] = np.eye(parts - 1)
        radius = float(np.max(np.abs(np.linalg.eigvals(step))))
        assert (radius < 1.0) == stable, (delay, radius)


@pytest.mark.parametrize(
    "observer",
    [hgo.SampledDataObserver(), hgo.HighGainObserver("reduced-chain", 3, 5.0)],
    ids=lambda observer: observer.spec["kind"],
)
def test_a_law_without_such_a_limit_is_refused_with_a_way_that_works(
    observer: hgo.Observer,
) -> None:
    with pytest.raises(hgo.DesignError, match="at a finite rate; let it run on late samples"):
        delay_limit(observer.spec)


def test_a_gain_that_moves_is_frozen_where_it_is_asked_for() -> None:
    moving = hgo.StandardObserver(2, hgo.AdaptiveGain(10.0, 0.0025, 0.183))
    with pytest.raises(hgo.DesignError, match="gain"):
        delay_limit(moving.spec)
    constant = hgo.StandardObserver(2, 7.0)
    assert delay_limit(moving.spec, gain=7.0) == pytest.approx(delay_limit(constant.spec))
