"""The causal step closes loops: correct, predict and step against observers written by hand.

A pendulum under stiff feedback of its estimate: the input of a period is computed from the estimate
at its beginning, which uses the sample of that instant. Each loop is closed around a plant of its
own, once by the package and once by the law in NumPy.
"""

import copy
import itertools

import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs import HgoError

ELL = 40.0
K1, K2 = 3.0, 2.0  # poles -1, -2, the default
DAMPING, GRAVITY = 0.5, 9.81
DT = 0.01
START = (0.3, 0.0)
MODEL = {"states": ["q", "w"], "inputs": ["u"], "phi": "u - 0.5*w - 9.81*sin(q)"}
PERIODIC = np.full(1000, DT)
# of whole 2^-12 s, so that times and their differences are exact
CALLBACK = np.round(np.random.default_rng(6).uniform(0.010, 0.040, 600) * 4096) / 4096


def acceleration(q, w, u):
    return u - DAMPING * w - GRAVITY * np.sin(q)


def pendulum(x, u, dt, parts=20):
    """The plant over a period under a held input, by RK4 of short steps."""
    h = dt / parts
    for _ in range(parts):
        rates = [np.zeros(2)]
        for c in (0.0, 0.5, 0.5, 1.0):
            z = x + c * h * rates[-1]
            rates.append(np.array([z[1], acceleration(z[0], z[1], u)]))
        x = x + h / 6.0 * (rates[1] + 2.0 * rates[2] + 2.0 * rates[3] + rates[4])
    return x


def feedback(x_hat, t):
    """A square wave of half a turn is followed with stiff feedback; the drive saturates."""
    goal = np.pi / 2.0 * np.sign(np.sin(t))
    u = GRAVITY * np.sin(x_hat[0]) - 40.0 * (x_hat[0] - goal) - 12.0 * x_hat[1]
    return float(np.clip(u, -60.0, 60.0))


class ByHand:
    """The law of order 2 in NumPy: eigenvalues placed at exp(p ell dt), phi held over a period."""

    def __init__(self, x_hat):
        self.x_hat, self.elapsed = np.array(x_hat, dtype=float), 0.0

    def correct(self, y):
        dt = self.elapsed
        if dt > 0.0 and np.isfinite(y):
            # (I - L C) Phi has the eigenvalues z1, z2: trace and determinant
            z1, z2 = np.exp(-ELL * dt), np.exp(-2.0 * ELL * dt)
            gain = np.array([1.0 - z1 * z2, (1.0 - z1) * (1.0 - z2) / dt])
            self.x_hat = self.x_hat + gain * (y - self.x_hat[0])
            self.elapsed = 0.0
        return self.x_hat

    def predict(self, u, dt):
        q, w = self.x_hat
        phi = acceleration(q, w, u)
        self.x_hat = np.array([q + dt * w + 0.5 * dt**2 * phi, w + dt * phi])
        self.elapsed += dt
        return self.x_hat


def closed(lengths, estimate, apply):
    """Close a loop over periods; the errors of w at the samples, and the record (t, y, u, x_hat).

    `estimate(k, y)` is asked at each sample, then `apply(u, dt)` is told the input from there on.
    """
    x, t = np.array(START), 0.0
    rows = []
    for k, dt in enumerate(lengths):
        x_hat = np.array(estimate(k, x[0]))
        u = feedback(x_hat, t)
        rows.append((t, x[0], u, *x_hat, x_hat[1] - x[1]))
        apply(u, dt)
        x, t = pendulum(x, u, dt), t + dt
    return np.array(rows)


def rms(rows):
    return float(np.sqrt(np.mean(np.square(rows[:, -1]))))


def by_hand(lengths):
    law = ByHand(START)
    return closed(lengths, lambda _, y: law.correct(y), law.predict)


def observer(**more):
    made = hgo.StandardObserver(2, ELL, model=hgo.Model(**MODEL), **more)
    made.reset(x_hat0=START)
    return made


def by_halves(lengths, law):
    return closed(lengths, lambda _, y: law.correct(y), lambda u, dt: law.predict(u, dt))


def by_steps(lengths, law):
    """`step` with the input and the length of the period that is over."""
    past = [0.0, lengths[0]]  # of no meaning at the first call

    def apply(u, dt):
        past[:] = u, dt

    return closed(lengths, lambda _, y: law.step(y, past[0], dt=past[1]), apply)


# --- loops --------------------------------------------------------------------------------------


@pytest.mark.parametrize("lengths", [PERIODIC, CALLBACK], ids=["100 Hz", "callback"])
@pytest.mark.parametrize("loop", [by_halves, by_steps])
def test_a_stiff_loop_has_the_error_of_the_law_by_hand(loop, lengths):
    rows, expected = loop(lengths, observer()), by_hand(lengths)
    assert rms(rows) <= 1.1 * rms(expected)
    assert rms(expected) < 0.1  # of a velocity of several rad/s: the loop is closed well
    assert np.abs(expected[:, 4]).max() > 3.0


def test_a_step_that_is_told_the_coming_period_is_worse():
    """The measure sees what a loop loses by lengths that belong to the period that begins."""
    law, last = observer(), [0.0]

    def apply(u, dt):
        last[0] = u

    coming = np.append(CALLBACK[1:], CALLBACK[-1])
    late = closed(CALLBACK, lambda k, y: law.step(y, last[0], dt=float(coming[k])), apply)
    assert rms(late) > 2.0 * rms(by_hand(CALLBACK))


def test_the_held_model_is_the_law_by_hand():
    """Where phi does not move over a period, the numbers themselves: a chain under its input."""
    rng = np.random.default_rng(1)
    lengths = rng.uniform(0.005, 0.05, 300)
    law = hgo.StandardObserver(2, ELL, model=hgo.InputGain(1.0))
    law.reset(x_hat0=START)
    x_hat, elapsed = np.array(START), 0.0
    for k, dt in enumerate(lengths):
        y = np.nan if k % 7 == 3 else np.sin(k)
        if elapsed > 0.0 and np.isfinite(y):
            z1, z2 = np.exp(-ELL * elapsed), np.exp(-2.0 * ELL * elapsed)
            gain = np.array([1.0 - z1 * z2, (1.0 - z1) * (1.0 - z2) / elapsed])
            x_hat = x_hat + gain * (y - x_hat[0])
            elapsed = 0.0
        np.testing.assert_allclose(law.correct(y), x_hat, rtol=1e-11, atol=1e-11)
        u = rng.normal()
        x_hat = np.array([x_hat[0] + dt * x_hat[1] + 0.5 * dt**2 * u, x_hat[1] + dt * u])
        elapsed += dt
        np.testing.assert_allclose(law.predict(u, dt), x_hat, rtol=1e-11, atol=1e-11)
        assert law.memory[-1] == pytest.approx(elapsed, rel=1e-14)


@pytest.mark.parametrize("method", ["zoh", "bilinear", "euler", "rk4", "bogacki-shampine"])
@pytest.mark.parametrize("lengths", [PERIODIC[:300], CALLBACK[:300] / 4.0], ids=["even", "uneven"])
def test_loops_and_the_run_over_their_record_have_the_same_bits(method, lengths):
    law = observer(method=method)
    halves = by_halves(lengths, law)
    np.testing.assert_array_equal(halves, by_steps(lengths, observer(method=method)))
    even = lengths[0] == lengths[1]
    clock, end = (DT, DT * len(lengths)) if even else (halves[:, 0], float(lengths.sum()))
    run = observer(method=method).run(clock, *halves[:, 1:3].T, x_hat0=START, until=end)
    np.testing.assert_array_equal(run.x_hat, halves[:, 3:5])
    # and the record goes on where the loop is
    np.testing.assert_allclose(run.next_memory, law.memory, rtol=1e-13, atol=1e-13)
    if not even:
        np.testing.assert_array_equal(run.next_memory, law.memory)


def test_a_callback_knows_the_time_that_has_passed():
    """A callback at 10 to 40 ms has the error of a run over its record."""
    rows = by_steps(CALLBACK, observer())
    run = observer().run(rows[:, 0], rows[:, 1], rows[:, 2], x_hat0=START)
    truth = rows[:, 4] - rows[:, 5]
    over_the_record = float(np.sqrt(np.mean(np.square(run.x_hat[:, 1] - truth))))
    assert rms(rows) <= 1.1 * over_the_record
    np.testing.assert_array_equal(run.x_hat, rows[:, 3:5])


def test_a_loop_in_the_package_control():
    control = pytest.importorskip("control")
    law = observer()
    system = law.to_control(DT)
    count = 300
    memory, x = law.initial_memory(START), np.array(START)
    errors, shown = [], []
    for k in range(count):
        t = k * DT
        x_hat = np.asarray(system._out(t, memory, np.array([x[0], 0.0])))[:2]
        u = feedback(x_hat, t)
        errors.append(x_hat[1] - x[1])
        shown.append(x_hat)
        memory = np.asarray(system._rhs(t, memory, np.array([x[0], u])))
        x = pendulum(x, u, DT)
    expected = by_hand(PERIODIC[:count])
    assert float(np.sqrt(np.mean(np.square(errors)))) <= 1.1 * rms(expected)
    np.testing.assert_array_equal(shown, by_halves(PERIODIC[:count], observer())[:, 3:5])
    # closed by the package itself: the input from the estimate of the same instant, no delay
    plant = control.NonlinearIOSystem(
        lambda t, x, u, params: pendulum(x, u[0], DT),
        lambda t, x, u, params: x[:1],
        inputs=["u"],
        outputs=["y"],
        states=2,
        dt=DT,
        name="plant",
    )
    gains = control.NonlinearIOSystem(
        None,
        lambda t, x, u, params: [feedback(u, t)],
        inputs=["q_hat", "w_hat"],
        outputs=["u"],
        dt=DT,
        name="gains",
    )
    outputs, inputs = system.output_labels, system.input_labels
    loop = control.interconnect(
        [plant, gains, system],
        connections=[
            ["plant.u", "gains.u"],
            [f"observer.{inputs[0]}", "plant.y"],
            [f"observer.{inputs[1]}", "gains.u"],
            ["gains.q_hat", f"observer.{outputs[0]}"],
            ["gains.w_hat", f"observer.{outputs[1]}"],
        ],
        inplist=[],
        outlist=[f"observer.{output}" for output in outputs],
    )
    start = np.concatenate([START, law.initial_memory(START)])
    answer = control.input_output_response(loop, np.arange(count) * DT, X0=start)
    np.testing.assert_allclose(answer.outputs.T, shown, rtol=1e-12, atol=1e-12)


# --- rates and gaps -----------------------------------------------------------------------------


def chains(method, timing="current"):
    """Two joints of a pendulum that share their states, each with its own sensor."""
    model = hgo.Model(
        states=["q", "w", "p", "v", "a"],
        inputs=["u"],
        orders=[2, 3],
        phi=["u - 0.5*w - 9.81*sin(q) + 0.2*sin(3*t)*p", "-2*a - v + 0.3*w + u*cos(t)"],
    )
    laws = [
        hgo.StandardObserver(2, 20.0, method=method, timing=timing),
        hgo.LowPowerObserver(3, 10.0, method=method, timing=timing),
    ]
    return hgo.MultiOutputObserver(laws, model=model)


def two_rates(count=400):
    """Sensors at 1/3 and 1/5 of the rows, a gap of both, uneven rows."""
    rng = np.random.default_rng(9)
    t = np.r_[0.0, np.cumsum(rng.uniform(0.002, 0.006, count - 1))]
    y = np.stack([np.sin(3.0 * t), np.cos(2.0 * t)], axis=1) + 0.01 * rng.normal(size=(count, 2))
    rows = np.arange(count)
    y[rows % 3 != 0, 0] = np.nan
    y[rows % 5 != 2, 1] = np.nan
    y[150:190] = np.nan
    return t, y, rng.normal(size=(count, 1))


@pytest.mark.parametrize("method", ["zoh", "euler", "rk4-innovation-held", "rk4"])
def test_several_rates_and_gaps_of_chains_have_the_bits_of_the_loop(method):
    t, y, u = two_rates()
    law = chains(method)
    run = law.run(t, y, u)
    shown = []
    for k in range(len(t)):
        shown.append((law.correct(y[k]), law.memory)[1])
        if k + 1 < len(t):
            law.predict(u[k], float(t[k + 1] - t[k]))
    np.testing.assert_array_equal(run.memory, shown)
    assert np.abs(run.x_hat[-50:, 0] - np.sin(3.0 * t[-50:])).max() < 0.2
    law.reset()
    for k in range(len(t)):
        past = max(k - 1, 0)
        law.step(y[k], u[past], dt=float(t[past + 1] - t[past]))
        np.testing.assert_array_equal(law.memory, run.memory[k])


def test_a_correction_is_for_all_the_time_since_the_sample_before():
    """Rows without a sample change nothing of a placed correction."""
    law = hgo.StandardObserver(2, ELL)
    often = hgo.StandardObserver(2, ELL)
    rng = np.random.default_rng(2)
    for k in range(100):
        y, parts = np.sin(0.3 * k), rng.uniform(0.002, 0.02, 4)
        np.testing.assert_allclose(law.correct(y), often.correct(y), rtol=1e-10, atol=1e-10)
        law.predict(None, float(parts.sum()))
        for dt in parts:
            often.predict(None, float(dt))
            if k % 2:
                often.correct(np.nan)
        assert often.memory[-1] == pytest.approx(parts.sum(), rel=1e-14)


# --- the verbs ----------------------------------------------------------------------------------


LAWS = {
    "standard": lambda **more: hgo.StandardObserver(2, 20.0, model=hgo.InputGain(2.0), **more),
    "own": lambda **more: hgo.StandardObserver(2, 20.0, model=hgo.Model(**MODEL), **more),
    "low-power": lambda **more: hgo.LowPowerObserver(3, 10.0, model=hgo.InputGain(2.0), **more),
    "peaking-free": lambda **more: hgo.PeakingFreeObserver(
        3, 10.0, saturation=2.0, model=hgo.InputGain(2.0), **more
    ),
    "adaptive": lambda **more: hgo.StandardObserver(
        2, hgo.AdaptiveGain(10.0, 0.0025, 0.183), model=hgo.InputGain(2.0), **more
    ),
}


@pytest.mark.parametrize("name", LAWS)
def test_the_first_call_only_corrects(name):
    """Over no time: the estimate is the start, whatever the sample, the input and the length."""
    for call in ("step", "correct"):
        law = LAWS[name]()
        start = np.linspace(0.5, 1.0, law.n)
        law.reset(x_hat0=start)
        before = law.memory.copy()
        shown = law.correct(7.0) if call == "correct" else law.step(7.0, 99.0, dt=0.01)
        np.testing.assert_array_equal(shown, start)
        np.testing.assert_array_equal(law.memory, before)
        assert law._time == 0.0
        second = law.step(7.0, 0.0, dt=0.01)
        assert law._time == 0.01
        other = LAWS[name]()
        other.reset(x_hat0=start)
        other.predict(0.0, 0.01)
        np.testing.assert_array_equal(second, other.correct(7.0))
        assert not np.array_equal(second, start)


@pytest.mark.parametrize("name", LAWS)
def test_a_step_is_a_prediction_and_a_correction(name):
    law, halves = LAWS[name](), LAWS[name]()
    rng = np.random.default_rng(0)
    for k in range(60):
        y, u, dt = rng.normal(), rng.normal(), rng.uniform(0.001, 0.01)
        if k % 9 == 4:
            y = np.nan
        if k:
            halves.predict(u, dt)
        halves.correct(y)
        law.step(y, u, dt=dt)
        np.testing.assert_array_equal(law.memory, halves.memory)
        assert law._time == halves._time


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("y", [0.4, np.nan, None])
def test_a_sample_is_used_once(name, y):
    law = LAWS[name]()
    for k in range(5):
        law.correct(np.sin(k))
        law.predict(1.0, 0.01)
    once = law.correct(y).copy()
    memory = law.memory.copy()
    np.testing.assert_array_equal(law.correct(y), once)
    np.testing.assert_array_equal(law.memory, memory)
    if y == 0.4:  # nor does another sample at the same instant change anything
        np.testing.assert_array_equal(law.correct(9.0), once)
    else:
        assert memory[-1] == 0.01


@pytest.mark.parametrize("method", ["zoh", "bilinear", "euler", "rk4", "bogacki-shampine"])
def test_two_predictions_are_a_row_without_a_sample(method):
    """The chain is moved, exactly but by Euler; a placed correction is for both periods."""
    law = hgo.StandardObserver(3, 10.0, method=method)
    law.reset(x_hat0=[1.0, -2.0, 0.5])
    law.predict(None, 0.02)
    law.predict(None, 0.03)
    moved = law.memory.copy()
    exact = [1.0 - 2.0 * 0.05 + 0.25 * 0.05**2, -2.0 + 0.5 * 0.05, 0.5]
    euler = [1.0 - 2.0 * 0.02 + 0.03 * (-2.0 + 0.5 * 0.02), exact[1], 0.5]
    expected = euler if method == "euler" else exact
    np.testing.assert_allclose(moved[:3], expected, rtol=1e-13)
    placed = method in ("zoh", "bilinear")
    assert moved[3] == pytest.approx(0.05 if placed else 0.03, rel=1e-14)
    other = copy.copy(law)
    run = law.run([0.0, 0.02, 0.05], [np.nan, np.nan, 0.7], x_hat0=[1.0, -2.0, 0.5])
    np.testing.assert_allclose(other.correct(0.7), run.x_hat[-1], rtol=1e-13)


def test_a_predictor_refuses_the_halves_with_the_remedy():
    for make, method in itertools.product(LAWS.values(), ("euler", None)):
        law = make(timing="predictor", method=method)
        before = law.memory.copy()
        for call in (lambda law=law: law.correct(1.0), lambda law=law: law.predict(1.0, 0.001)):
            with pytest.raises(HgoError, match="timing='current'"):
                call()
        np.testing.assert_array_equal(law.memory, before)
        remedy = make(timing="current", method=method)
        remedy.correct(1.0)
        remedy.predict(1.0, 0.001)
    with pytest.raises(HgoError, match="timing='current'"):
        chains("zoh", "predictor").correct([1.0, 1.0])


def test_a_correction_that_was_not_there_is_for_the_next_sample():
    """Memory at the last row of a run, then the loop goes on: as one run over all."""
    t, y = np.arange(200) * DT, np.sin(np.arange(200) * 0.05)
    law = hgo.StandardObserver(2, ELL)
    whole = law.run(DT, y)
    first = law.run(DT, y[:120], until=120 * DT)
    law.reset(memory0=first.next_memory)
    for k in range(120, 200):
        shown = law.correct(y[k])
        np.testing.assert_array_equal(shown, whole.x_hat[k])
        law.predict(None, DT)
    law.reset(memory0=first.memory[-1])  # after its correction: the period is still to be moved
    law.predict(None, DT)
    np.testing.assert_array_equal(law.correct(y[120]), whole.x_hat[120])
    assert t[120] == pytest.approx(1.2)
