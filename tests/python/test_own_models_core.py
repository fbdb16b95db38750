"""Own models on the compiled core: bits of the built-in systems, numbers of the twin."""

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from test_expressions import grown, steps

import hgo_rs as hgo
from hgo_rs import HgoError, Model, reference

LEE = Model(states=["x1", "x2"], phi="-x1/(1 + x1*x1) - x2")

CRACKLE = "saturate(0.2*(a*a - 1) - b - c - 4*d - s, -3, 3)"
SAME = {
    "lee": (2, hgo.Lee(), LEE),
    "crackle": (5, hgo.Crackle(), Model(states=["a", "b", "c", "d", "s"], phi=CRACKLE)),
    "input": (3, hgo.InputGain(2.0), Model(states=["a", "b", "c"], inputs=["u"], phi="2*u")),
}


def record(n_u):
    t = 1e-3 * np.arange(400)
    y = np.sin(5 * t) + 1e-3 * np.random.default_rng(2).standard_normal(len(t))
    y[100:103] = np.nan
    return t, y, np.cos(3 * t)[:, None] if n_u else None


@pytest.mark.parametrize("law", [hgo.StandardObserver, hgo.LowPowerObserver])
@pytest.mark.parametrize("method", ["euler", "staggered-euler", "rk4"])
@pytest.mark.parametrize("name", SAME)
def test_an_own_model_gives_the_bits_of_the_built_in_one(name, law, method):
    n, built_in, own = SAME[name]
    runs = []
    for model in (built_in, own):
        observer = law(n, 30.0, model=model, method=method)
        t, y, u = record(observer.n_u)
        runs.append(observer.run(t, y, u, allow_unstable=True))
    np.testing.assert_array_equal(runs[1].memory, runs[0].memory)
    np.testing.assert_array_equal(runs[1].innovation, runs[0].innovation)


def test_other_parameters_without_a_new_table():
    own = Model(states=["a", "b"], inputs=["u"], phi="b0*u", parameters={"b0": 1.0})
    t, y, u = record(1)
    for b0 in (1.0, 2.5):
        want = hgo.StandardObserver(2, 30.0, model=hgo.InputGain(b0)).run(t, y, u)
        have = hgo.StandardObserver(2, 30.0, model=own.with_parameters(b0=b0)).run(t, y, u)
        np.testing.assert_array_equal(have.memory, want.memory)


programs = st.lists(steps, min_size=1, max_size=8)
constants = st.lists(st.floats(-3.0, 3.0, allow_subnormal=False), max_size=2)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(constants, programs)
def test_any_expression_gives_the_numbers_of_the_twin(constants, program):
    """But for elementary functions, which are the core's own, within rounding."""
    phi = grown(constants, program)
    model = Model(states=["x", "y"], parameters={"z": 0.3}, phi=phi)
    observer = hgo.StandardObserver(2, 5.0, model=model)
    t = 0.01 * np.arange(8)
    y = np.sin(7 * t) + 0.2
    start = [0.21, 0.1]
    try:
        have = observer.run(t, y, x_hat0=start, allow_unstable=True).memory
    except HgoError:  # no value, or a huge one
        assume(False)
    want = reference.Observer(observer.spec).run(t, y, None, observer.initial_memory(start))[
        "memory"
    ]
    np.testing.assert_allclose(have, want, rtol=1e-8, atol=1e-8)
