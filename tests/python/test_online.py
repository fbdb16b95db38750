"""Steps from Python: what they take, where they write, what they allocate; and runs beside them."""

import copy
import dataclasses
import itertools
import pickle
import sys
import tracemalloc

import numpy as np
import pytest
from test_observers import ADAPTIVE, DT, LAWS, at, by_steps, law, record

from hgo_rs import (
    HgoError,
    InputGain,
    LowPowerObserver,
    Model,
    Observer,
    ReducedOrderObserver,
    StandardObserver,
    reference,
)

# --- the same numbers everywhere ----------------------------------------------------------------


@pytest.mark.parametrize("name", LAWS)
def test_step_run_and_the_twin_agree(name):
    """Uneven steps and gaps: step and run bit for bit, the NumPy twin to rounding."""
    observer, start = law(name)
    y, u = record(observer)
    y[7] = y[20:23] = np.nan
    least = 1.0 if name == "window" else 0.5  # a window has a period of its own
    t = np.cumsum(np.random.default_rng(3).uniform(least, 1.0, len(y))) * DT
    first = observer.initial_memory() if start is None else start
    run = observer.run(t, y, u, memory0=start)
    twin = reference.Observer(observer.spec).run(t, y, u, first)
    np.testing.assert_allclose(run.memory, twin["memory"], rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(run.innovation, twin["innovation"], rtol=1e-11, atol=1e-11)
    observer.reset(memory0=start)
    observer._time, observer._started = t[0], False  # the clock of the record
    out = np.empty(observer.n)
    for k, memory in enumerate(by_steps(observer, y, u, np.diff(t), out)):
        np.testing.assert_array_equal(memory, run.memory[k])
        if observer.timing == "current":
            np.testing.assert_array_equal(out, run.x_hat[k])
    np.testing.assert_array_equal(out, observer.x_hat)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("method", ["euler", "staggered-euler", "rk4-innovation-held"])
def test_a_long_record_is_its_parts(name, method):
    """40,000 samples at once, and in three parts, each from where the one before ended."""
    observer, start = law(name)
    if "method" in observer.spec:
        placed = ("motion", "substeps")
        spec = {key: value for key, value in observer.spec.items() if key not in placed}
        Observer.__init__(observer, spec | {"method": method})
    y, u = record(observer, count=40_000)
    if observer.n_y == 1:
        y = 0.3 * np.sin(0.01 * np.arange(len(y)))
    y[16_383:16_386] = np.nan
    whole = observer.run(DT, y, u, memory0=start)
    np.testing.assert_array_equal(whole.missing, np.isnan(y.reshape(len(y), -1)).any(axis=1))
    for a, b in ((0, 16_384), (16_384, 30_001), (30_001, 40_000)):
        t = np.arange(a, b) * DT
        part = observer.run(t, y[a:b], at(u, slice(a, b)), memory0=start, until=b * DT)
        np.testing.assert_array_equal(part.memory, whole.memory[a:b])
        np.testing.assert_array_equal(part.innovation, whole.innovation[a:b])
        start = part.next_memory
        if observer.timing == "predictor" and b < len(y):
            np.testing.assert_array_equal(start, whole.memory[b])


# --- out= ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LAWS)
def test_out_is_filled_and_returned(name):
    observer, start = law(name)
    other, _ = law(name)
    for each in (observer, other):
        each.reset(memory0=start)
    y, u = record(observer)
    out = np.full(observer.n, np.nan)
    for k in range(20):
        x_hat = observer.step(y[k], at(u, k), dt=DT, out=out)
        assert x_hat is out
        np.testing.assert_array_equal(out, other.step(y[k], at(u, k), dt=DT))
    row = np.zeros((3, observer.n))
    observer.step(y[20], at(u, 20), dt=DT, out=row[1])
    np.testing.assert_array_equal(row, [out * 0.0, observer.x_hat, out * 0.0])


def read_only():
    array = np.zeros(2)
    array.flags.writeable = False
    return array


WRONG_OUT = {
    "a list": ([0.0, 0.0], "out = [0.0, 0.0]:"),
    "float32": (np.zeros(2, np.float32), "out of shape (2,), float32:"),
    "integers": (np.zeros(2, np.int64), "out of shape (2,), int64:"),
    "bytes the other way round": (np.zeros(2, ">f8"), "out of shape (2,), >f8:"),
    "three entries": (np.zeros(3), "out of shape (3,), float64:"),
    "a column": (np.zeros((2, 1)), "out of shape (2, 1), float64:"),
    "read-only": (read_only(), "out of shape (2,), float64, read-only:"),
    "strided": (np.zeros(4)[::2], "out of shape (2,), float64, strided:"),
    "unaligned": (
        np.frombuffer(bytearray(17), np.float64, 2, 1),
        "out of shape (2,), float64, unaligned:",
    ),
}


@pytest.mark.parametrize("name", WRONG_OUT)
def test_a_wrong_out_is_refused_and_nothing_is_done(name):
    out, subject = WRONG_OUT[name]
    observer = StandardObserver(2, 10.0)
    observer.step(1.0, dt=0.01)
    before, time = observer.memory.copy(), observer._time
    with pytest.raises(HgoError) as caught:
        observer.step(1.0, dt=0.01, out=out)
    message = str(caught.value)
    assert message.startswith(subject)
    assert message.endswith(
        "must be a writeable, contiguous float64 array of shape (2,); give numpy.empty(2)"
    )
    np.testing.assert_array_equal(observer.memory, before)
    assert observer._time == time


def test_a_refused_sample_leaves_out_alone():
    observer, out = StandardObserver(2, 10.0, method="euler"), np.array([7.0, 8.0])
    observer.step(1.0, dt=0.01)
    for y, dt in ((np.inf, 0.01), ("a", 0.01), (1.0, 0.5), (1.7e308, 0.01)):
        with pytest.raises(HgoError):
            observer.step(y, dt=dt, out=out)
    assert out.tolist() == [7.0, 8.0]


@pytest.mark.parametrize("kind", ["standard", "predictor", "low-power", "input", "missing"])
def test_steps_into_out_allocate_nothing(kind):
    """Over 20,000 steps: no block more, no byte at the peak beyond the loop's own."""
    observer = {
        "standard": lambda: StandardObserver(2, 10.0),
        "predictor": lambda: StandardObserver(2, 10.0, method="euler", timing="predictor"),
        "low-power": lambda: LowPowerObserver(5, 10.0),
        "input": lambda: StandardObserver(2, 10.0, model=InputGain(2.0)),
        "missing": lambda: StandardObserver(2, ADAPTIVE),
    }[kind]()
    samples = np.sin(np.arange(20_000) * 1e-3).tolist()
    if kind == "missing":
        samples[::3] = [None] * len(samples[::3])
    u, out = (0.5 if kind == "input" else None), np.empty(observer.n)

    def steps(kept):
        for y in samples:
            kept(observer.step(y, u, dt=1e-3, out=out))

    def nothing(x_hat):
        pass

    def grown(call):
        """Blocks and bytes by which the call made the interpreter grow; the bytes at the peak."""
        tracemalloc.start()
        try:
            begin, blocks = tracemalloc.get_traced_memory()[0], sys.getallocatedblocks()
            tracemalloc.reset_peak()
            call()
            return sys.getallocatedblocks() - blocks, tracemalloc.get_traced_memory()[1] - begin
        finally:
            tracemalloc.stop()

    steps(nothing)
    blocks, peak = grown(lambda: steps(nothing))
    assert blocks < 20
    assert peak < 2000  # frames and the measurement, whatever the number of steps
    kept = []
    blocks, peak = grown(lambda: [kept.append(observer.step(0.0, u, dt=1e-3)) for _ in range(999)])
    assert blocks > 999 and peak > 999 * out.nbytes  # the measure sees an array a step


# --- what a step takes --------------------------------------------------------------------------


def test_a_sample_and_an_input_come_in_many_forms():
    def after(y, u):
        observer = StandardObserver(2, 10.0, model=InputGain(2.0))
        observer.step(0.5, 0.0, dt=0.01)
        return observer.step(y, u, dt=0.01)

    expected = after(3.0, 2.0)
    masked = np.ma.masked_array([3.0], [False])
    forms = [3, np.float64(3.0), np.float32(3.0), np.int8(3), np.array(3.0), np.array([3.0])]
    forms += [[3.0], (3.0,), [[3.0]], masked, np.array([3.0], ">f8"), np.array([3.0, 9.0])[::2]]
    for form in forms:
        np.testing.assert_array_equal(after(form, 2.0), expected)
        np.testing.assert_array_equal(after(2.0, form), after(2.0, 3.0))
    missing = after(None, 2.0)
    assert not np.array_equal(missing, expected)
    for form in (np.nan, np.array([np.nan]), np.ma.masked_array([3.0], [True]), [None]):
        np.testing.assert_array_equal(after(form, 2.0), missing)
    ship = ReducedOrderObserver(0.2)
    for y in ([1.0, 0.1, 0.1], np.array([1.0, 0.2, 0.1]), (1.0, 0.3, None)):
        ship.step(y, np.array([1.0, 0.0]), dt=0.01)
    for bad in ([1.0, 0.1], 1.0, [1.0, 0.1, np.inf]):
        with pytest.raises(HgoError):
            ship.step(bad, [1.0, 0.0], dt=0.01)
    for u in (None, [1.0], [1.0, np.nan], np.array([np.inf, 0.0])):
        with pytest.raises(HgoError, match="u "):
            ship.step([1.0, 0.1, 0.1], u, dt=0.01)


def test_every_new_step_is_held_against_the_limit():
    """0.1 s here: steps below pass in any order, one at the limit never."""
    observer = StandardObserver(2, 10.0, method="euler", timing="predictor")
    for dt in (0.01, 0.05, 0.03, np.float64(0.099), 1e-9):
        observer.step(1.0, dt=dt)
    for dt in (0.1, 0.2, 0.0, -0.01, np.nan, np.inf, None, "0.01"):
        with pytest.raises(HgoError, match="dt = "):
            observer.step(1.0, dt=dt)
    observer.allow_unstable = True
    observer.step(1.0, dt=0.2)
    with pytest.raises(HgoError, match="dt = "):
        observer.step(1.0, dt=-0.01)
    observer.allow_unstable = False
    with pytest.raises(HgoError, match="stability limit"):
        observer.step(1.0, dt=0.2)


# --- the memory ---------------------------------------------------------------------------------


def test_the_memory_is_an_array_of_its_user():
    observer, other = StandardObserver(2, 10.0), StandardObserver(2, 10.0)
    for each in (observer, other):
        each.step(0.0, dt=0.01)
    before = observer.memory
    observer.step(1.0, dt=0.01)
    assert before.tolist() == [0.0, 0.0, 0.0]  # what was shown does not move
    assert observer.memory is observer.memory
    observer.memory[1] = 3.0  # and may be written to
    other.memory = [observer.memory[0], 3.0, 0.0]
    assert other.x_hat[1] == 3.0
    np.testing.assert_array_equal(observer.step(2.0, dt=0.01), other.step(2.0, dt=0.01))
    saved = observer.memory
    other.memory = saved
    np.testing.assert_array_equal(observer.step(1.0, dt=0.01), other.step(1.0, dt=0.01))
    for wrong in ([1.0], np.zeros(2), np.zeros((3, 1)), "abc", None):
        with pytest.raises(HgoError, match="memory"):
            other.memory = wrong


def test_the_clock_runs_and_is_reset():
    """With current timing the first step is over no period."""
    for timing, expected in (("predictor", [0.0, 0.05, 0.1]), ("current", [0.0, 0.0, 0.05])):
        observer = StandardObserver(2, 10.0, timing=timing)
        times = []
        for _ in range(3):
            times.append(observer._time)
            observer.step(1.0, dt=0.1 - 0.05)
        assert times == expected
        observer.reset(x_hat0=[1.0, 2.0])
        assert observer._time == 0.0
        assert observer.memory.tolist() == [1.0, 2.0, 0.0][: 2 + (timing == "current")]
        observer.step(1.0, dt=0.05)
        assert observer._time == expected[1]


@pytest.mark.parametrize(
    "again", [copy.copy, copy.deepcopy, lambda o: pickle.loads(pickle.dumps(o))]
)
@pytest.mark.parametrize("name", LAWS)
def test_copies_go_their_own_way(name, again):
    observer, start = law(name)
    observer.reset(memory0=start)
    y, u = record(observer)
    for k in range(5):
        observer.step(y[k], at(u, k), dt=DT)
    twin = again(observer)
    assert type(twin) is type(observer) and twin.spec == observer.spec
    assert twin._time == observer._time
    expected = observer.step(y[5], at(u, 5), dt=DT)
    assert not np.array_equal(twin.memory, observer.memory)
    np.testing.assert_array_equal(twin.step(y[5], at(u, 5), dt=DT), expected)


def test_an_observer_that_was_not_made_says_so():
    class Forgetful(Observer):
        def __init__(self):
            pass

    with pytest.raises(HgoError, match="__init__ was not called"):
        Forgetful().step(1.0, dt=0.01)


# --- runs ---------------------------------------------------------------------------------------


def test_what_a_run_tells_by_the_way():
    """Times and innovations are there when asked for, and in tables, copies and pickles."""
    y = np.sin(np.arange(50.0))
    y[3] = np.nan
    for timing, clock in itertools.product(("predictor", "current"), (0.1, np.arange(50) * 0.1)):
        observer = StandardObserver(2, 1.0, timing=timing)
        run = observer.run(clock, y)
        y_before, y[5] = y[5], 99.0  # the result is not the caller's array
        assert run.y[5, 0] == y_before
        y[5] = y_before
        predicted = run.x_hat[:, 0]
        if timing == "current":  # the chain of integrators from the row before
            predicted = np.append(0.0, run.x_hat[:-1] @ [1.0, 0.1])
        for result in (run, pickle.loads(pickle.dumps(run)), dataclasses.replace(run)):
            np.testing.assert_array_equal(result.time, np.arange(50) * 0.1)
            np.testing.assert_allclose(result.innovation[:, 0], y - predicted, atol=1e-14)
            assert result.innovation is result.innovation
            assert result.gaps == run.gaps and run.gaps[0].start == 3
        assert dataclasses.asdict(run).keys() == {f.name for f in dataclasses.fields(run)}
        assert run.gain.tolist() == [1.0] * 50
        with pytest.raises(AttributeError, match="'RunResult' object has no attribute 'times'"):
            _ = run.times
    times = np.arange(50) * 0.1
    run = observer.run(times, y)
    times[:] = 0.0
    assert run.time[-1] == 49 * 0.1


def test_faults_are_found_wherever_they_are():
    """Deep in a long record, one at a time."""
    n = 50_000
    t, y, u = np.arange(n) * 0.01, np.zeros(n), np.zeros(n)
    model = InputGain(1.0)
    observer = StandardObserver(2, 10.0, model=model, method="euler", timing="predictor")
    observer.run(t, y, u)

    def spoilt(values, k, value):
        values = values.copy()
        values[k] = value
        return values

    for k in (1, 16_384, 33_333, n - 1):
        for call, message in (
            (lambda k=k: observer.run(t, spoilt(y, k, np.inf), u), f"y at sample {k} is inf"),
            (lambda k=k: observer.run(0.01, y, spoilt(u, k, np.nan)), f"u at sample {k} is not"),
            (lambda k=k: observer.run(spoilt(t, k, np.nan), y, u), f"t at sample {k} is not"),
            (lambda k=k: observer.run(spoilt(t, k, -1.0), y, u), f"t at sample {k} is -1 s after"),
        ):
            with pytest.raises(HgoError, match=message):
                call()
    for k in (0, 16_383, 33_333, n - 2):  # a pause after sample k
        with pytest.raises(HgoError, match=f"after sample {k} "):
            observer.run(t + np.where(np.arange(n) > k, 0.2, 0.0), y, u)
        late = spoilt(y, k, np.nan)  # over which nothing is corrected
        observer.run(t + np.where(np.arange(n) > k, 0.2, 0.0), late, u)
    with pytest.raises(HgoError, match="diverged at sample 20001 "):
        observer.run(t, spoilt(y, 20_000, 1.0), spoilt(u, 20_000, 1e300))


def test_a_memory_that_is_not_finite_is_never_given():
    """Euler at ten times its limit: x+ = -19 x; the rate 100 x is beyond 1.8e308 at x = 19^240."""
    observer = StandardObserver(1, 100.0, k=[1.0], method="euler", timing="predictor")
    fine = observer.run(0.2, np.zeros(240), x_hat0=[1.0], allow_unstable=True)
    np.testing.assert_allclose(fine.x_hat[:5, 0], (-19.0) ** np.arange(5))
    with pytest.raises(HgoError, match="overflowed at sample 241"):
        observer.run(0.2, np.zeros(300), x_hat0=[1.0], allow_unstable=True)
    with pytest.raises(HgoError, match=r"overflowed at t = 48\.2 s"):
        observer.run(0.2, np.zeros(241), x_hat0=[1.0], allow_unstable=True, until=48.2)


def test_an_own_model_that_explodes_overflows_as_a_built_in_one_does():
    model = Model(states=["x"], phi="x*x")  # x' = x^2 + ..., explodes
    observer = StandardObserver(1, 1.0, model=model, method="euler", timing="predictor")
    with pytest.raises(HgoError, match="overflowed at sample 10 "):
        observer.run(1.0, np.full(60, np.nan), x_hat0=[3.0], allow_unstable=True)


def test_another_timing_after_a_record_of_its_own():
    """What a record was run by belongs to one timing; a copy and a pickle make it anew."""
    observer = StandardObserver(2, 12.0)
    y = np.sin(np.arange(50) * 0.1)
    first = observer.run(0.01, y)
    fresh = StandardObserver(2, 12.0, timing="predictor").run(0.01, y)
    np.testing.assert_array_equal(observer.run(0.01, y, timing="predictor").x_hat, fresh.x_hat)
    for other in (copy.deepcopy(observer), pickle.loads(pickle.dumps(observer))):
        np.testing.assert_array_equal(other.run(0.01, y).x_hat, first.x_hat)
