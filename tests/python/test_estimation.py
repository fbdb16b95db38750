"""Observers over logs: chunks, configurations, gaps and the error to expect after them."""

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hgo_rs
from hgo_rs import Config, HgoError
from hgo_rs.logs import DataError, Log, read_log, run_chunks

ADAPTIVE = hgo_rs.AdaptiveGain(5.0, 1e-4, 0.2)
LAWS = {
    "standard": hgo_rs.StandardObserver(3, gain=12.0),
    "input": hgo_rs.StandardObserver(2, gain=12.0, model=hgo_rs.InputGain(0.7), method="rk4"),
    "held": hgo_rs.StandardObserver(2, gain=12.0, method="rk4-innovation-held"),
    "adaptive": hgo_rs.StandardObserver(2, gain=ADAPTIVE),
    "low-power": hgo_rs.LowPowerObserver(3, gain=8.0),
    "peaking-free": hgo_rs.PeakingFreeObserver(3, gain=8.0, saturation=9.0),
    "sampled-data": hgo_rs.SampledDataObserver(),
    "current": hgo_rs.StandardObserver(2, gain=12.0, model=hgo_rs.InputGain(0.7), timing="current"),
    "current-low-power": hgo_rs.LowPowerObserver(3, gain=8.0, method="zoh", timing="current"),
}


def record(n_u=0, count=400, seed=3, starts=(0, 150, 151)):
    """A log with jitter, missing samples and resets of the clock."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(5e-3, 1.5e-2, count))
    y = np.sin(3.0 * t) + 1e-3 * rng.standard_normal(count)
    for k in rng.integers(0, count, 12):
        y[k : k + int(rng.integers(1, 9))] = np.nan
    for a, b in pairwise([*starts, count]):
        t[a:b] -= t[a]
    u = np.cos(t) if n_u else None
    names = {"time": "t", "output": "q", "input": "u" if n_u else None}
    return Log(t, y, u, names, "log.csv", np.isnan(y), starts)


def cut(log, size):
    for a in range(0, len(log.t), size):
        rows = slice(a, a + size)
        part = log.rows(rows)
        starts = tuple(k - a for k in log.starts if a <= k < a + size)
        yield Log(part.t, part.y, part.u, log.names, log.source, part.missing, starts)


@pytest.mark.parametrize("size", [1, 2, 7, 64, 1000])
@pytest.mark.parametrize("name", LAWS)
def test_chunks_give_the_same_bits(name, size):
    law = LAWS[name]
    # a placed law corrects over a step, which a piece of one sample does not have
    log = record(law.n_u, starts=(0, 150) if law.spec.get("method") == "zoh" else (0, 150, 151))
    whole = [law.run(p.t, p.y, p.u, memory0=law.memory) for p in log.pieces]
    parts = list(run_chunks(law, cut(log, size), start="zero"))
    assert sum(len(part.t) for part, _ in parts) == len(log.t)
    fields = ["time", "x_hat", "auxiliary", "innovation", "missing", "y", "memory"]
    for field in fields if law.gain is None else [*fields, "gain"]:
        expected = np.concatenate([getattr(r, field) for r in whole])
        got = np.concatenate([getattr(r, field) for _, r in parts])
        assert got.tobytes() == expected.tobytes(), field


def test_chunks_of_a_law_that_filters_give_the_same_bits():
    rng = np.random.default_rng(4)
    t = np.cumsum(rng.uniform(0.05, 0.1, 60))
    y = np.c_[3.0 * t, 0.4 * np.sin(t), 0.1 * t] + 1e-3 * rng.standard_normal((60, 3))
    y[20:25] = np.nan
    u = np.c_[0.3 * np.ones(60), 0.1 * np.sin(t)]
    law = hgo_rs.ReducedOrderObserver(0.3)
    law.reset([3.0, 0.1, 0.1])
    names = {"time": "t", "output": ["x", "y", "psi"], "input": ["force", "rudder"]}
    log = Log(t, y, u, names, "ship.csv", np.isnan(y))
    whole = law.run(t, y, u, memory0=law.memory)
    for size in (1, 4, 59, 60):
        parts = [result for _, result in run_chunks(law, cut(log, size))]
        assert np.concatenate([r.memory for r in parts]).tobytes() == whole.memory.tobytes()
        assert np.concatenate([r.innovation for r in parts]).tobytes() == (
            whole.innovation.tobytes()
        )


def test_what_is_wrong_in_a_later_chunk_says_where():
    log = record()
    t = np.arange(400) * 0.01
    t[300:] += 5.0
    names, none = log.names, np.zeros(400, bool)
    bad = Log(t, np.sin(t), None, names, "log.csv", none)
    for timing, told in (
        ("predictor", r"t = 2\.5 s \(sample 250\): after sample 49"),
        ("current", r"t = 8 s \(sample 300\): before sample 0"),
    ):
        law = hgo_rs.StandardObserver(3, gain=12.0, method="euler", timing=timing)
        with pytest.raises(hgo_rs.DesignError, match=rf"log\.csv, counting samples from {told}"):
            list(run_chunks(law, cut(bad, 50)))


CONFIG = 'format = 1\nobserver = "standard"\norder = 2\ngain = 12.0\n'


@pytest.fixture
def axis(tmp_path):
    """A log of q = sin t in ms, with an input and a gap."""
    t = np.arange(1000) * 5
    q = [repr(math.sin(v * 1e-3)) for v in t.tolist()]
    q[500:520] = [""] * 20
    lines = [f"{a},{b},0.5" for a, b in zip(t, q, strict=True)]
    (tmp_path / "axis.csv").write_text("t_ms,q,F\n" + "\n".join(lines) + "\n")
    (tmp_path / "observer.toml").write_text(CONFIG + '[log]\ntime = "t_ms"\noutput = "q"\n')
    return tmp_path


def test_estimate(axis):
    result = hgo_rs.estimate(axis / "axis.csv", axis / "observer.toml")
    log = read_log(axis / "axis.csv", "t_ms", "q")
    expected = hgo_rs.StandardObserver(2, gain=12.0).run(log.t, log.y, start="first-sample")
    assert result.x_hat.tobytes() == expected.x_hat.tobytes()
    assert log.t[-1] == 4.995
    config = hgo_rs.load(axis / "observer.toml")
    again = hgo_rs.estimate(log, config)
    assert again.x_hat.tobytes() == expected.x_hat.tobytes()
    (gap,) = result.gaps
    assert (gap.start, gap.length, gap.channel) == (500, 20, 0)
    assert result.gap_error.shape == (1, 2)
    # with an input, from a state of its own
    changes = {"model": {"kind": "input", "b0": -1.0}, "start": {"x_hat": [0.0, 1.0]}}
    config = config.replace({"input": "F"}, **changes)
    law = hgo_rs.StandardObserver(2, gain=12.0, model=hgo_rs.InputGain(-1.0))
    log = read_log(axis / "axis.csv", "t_ms", "q", "F")
    expected = law.run(log.t, log.y, log.u, x_hat0=[0.0, 1.0])
    result = hgo_rs.estimate(axis / "axis.csv", config)
    assert result.x_hat.tobytes() == expected.x_hat.tobytes()


@pytest.mark.parametrize(
    ("log", "message"),
    [
        ({}, "output: none is named, the observer has 1 .*; name 1 in the table .log."),
        ({"output": ["q", "F"]}, r"output: 2 named \(q, F\), the observer has 1"),
        ({"output": "q", "input": "F"}, r"input: 1 named \(F\), the observer has 0 .*leave it out"),
        ({"output": "Q"}, "has no column 'Q'; nearest: q"),
        ({"output": "q", "time": "t_s"}, "has no column 't_s'; nearest: t_ms"),
        ({"output": "q", "time": "t_ms", "unit": "s"}, "times are taken in s where neither unit"),
        ({"output": "q"}, "name the time column, or give dt"),
    ],
)
def test_logs_that_do_not_fit(axis, log, message):
    data = {"format": 1, "observer": "standard", "order": 2, "gain": 12.0, "method": "euler"}
    time = {} if log == {"output": "q"} else {"time": "t_ms"}
    with pytest.raises(HgoError, match=message):
        hgo_rs.estimate(axis / "axis.csv", Config({**data, "log": {**time, **log}}))


def test_a_guessed_unit_that_leaves_nothing_to_filter_is_refused(tmp_path):
    """Milliseconds taken as seconds, by a law that has no step limit."""
    path = tmp_path / "log.csv"
    path.write_text("t,q\n" + "".join(f"{5 * k},{math.sin(0.01 * k)}\n" for k in range(400)))
    data = {"format": 1, "observer": "standard", "order": 2, "gain": 20.0, "method": "zoh"}
    log = {"time": "t", "output": "q"}
    with pytest.raises(DataError, match=r"median step 5 s is 100 times 1/gain.*say unit = one of"):
        hgo_rs.estimate(path, Config({**data, "log": log}))
    with pytest.raises(DataError, match="the unit of the time 't' is a guess"):
        list(run_chunks(Config(data).observer(), [read_log(path, "t", "q")]))
    result = hgo_rs.estimate(path, Config({**data, "log": log | {"unit": "ms"}}))
    assert abs(result.x_hat[-1, 1] - 2.0 * math.cos(3.99)) < 0.3
    assert len(hgo_rs.estimate(path, Config({**data, "log": log | {"unit": "s"}})).time) == 400
    assert len(hgo_rs.estimate(path, Config({**data, "gain": 1.0, "log": log})).time) == 400


def test_a_log_of_pieces_is_estimated_piece_by_piece():
    log = record()
    config = Config.from_toml(CONFIG)
    with pytest.raises(DataError, match=r"starts again at samples \[150, 151\]; run the pieces"):
        hgo_rs.estimate(log, config)
    assert [len(hgo_rs.estimate(piece, config).time) for piece in log.pieces] == [150, 1, 249]


# --- gaps ------------------------------------------------------------------------------------


@lru_cache
def pendulum():
    """Times with jitter, and (x1, x2, x2') of a pendulum."""
    t = np.cumsum(np.r_[0.0, np.random.default_rng(11).uniform(6e-3, 1.4e-2, 11_999)])

    def rate(_t, x):
        return [x[1], -9.81 * np.sin(x[0]) - 0.02 * x[1]]

    solution = solve_ivp(rate, (0.0, t[-1]), [1.2, 0.0], t_eval=t, rtol=1e-8, atol=1e-9)
    return t, np.vstack([solution.y, rate(0.0, solution.y)[1]]).T


def with_gaps(sigma):
    """Samples of its angle with noise and random gaps."""
    rng = np.random.default_rng(5)
    t, x = pendulum()
    y = x[:, 0] + sigma * rng.standard_normal(len(t))
    k = 300
    while k < len(t) - 300:
        length = int(rng.integers(1, 40))
        y[k : k + length] = np.nan
        k += length + int(rng.integers(40, 160))
    return y


@pytest.mark.parametrize("sigma", [0.0, 1e-3, 1e-2])
@pytest.mark.parametrize(
    "law",
    [
        hgo_rs.StandardObserver(2, gain=20.0, method="euler", timing="predictor"),
        hgo_rs.StandardObserver(3, gain=15.0, method="rk4-innovation-held", timing="predictor"),
        hgo_rs.LowPowerObserver(3, gain=15.0, method="euler", timing="predictor"),
        hgo_rs.StandardObserver(2, gain=20.0),
        hgo_rs.LowPowerObserver(3, gain=15.0),
    ],
    ids=["standard-2", "standard-3", "low-power-3", "standard-2-placed", "low-power-3-placed"],
)
def test_the_error_expected_after_gaps_is_that_of_a_pendulum(law, sigma):
    """Within a factor of 2, over all gaps and for short, middling and long ones."""
    (t, x), y = pendulum(), with_gaps(sigma)
    result = law.run(t, y)
    gaps = result.gaps
    # with current timing the next sample has corrected its row
    ends = [gap.start + gap.length - (law.timing == "current") for gap in gaps]
    error = result.x_hat[ends] - x[ends, : law.n]
    assert np.abs(result.x_hat[300:, 0] - x[300:, 0]).max() < 2.0  # stays bounded
    duration = np.array([gap.duration for gap in gaps])
    assert len(gaps) > 80
    thirds = np.digitize(duration, np.quantile(duration, [1 / 3, 2 / 3]))
    for group in (thirds >= 0, *(thirds == i for i in range(3))):
        measured = np.sqrt(np.mean(error[group] ** 2, axis=0))
        expected = np.sqrt(np.mean(result.gap_error[group] ** 2, axis=0))
        ratio = expected / measured
        assert np.all((ratio > 0.5) & (ratio < 2.0)), ratio


def test_gaps_of_each_output():
    rng = np.random.default_rng(4)
    t = np.arange(400) * 0.05
    y = np.c_[3.0 * t, 0.4 * np.sin(t), 0.1 * t] + 1e-3 * rng.standard_normal((400, 3))
    y[100:110] = np.nan
    y[200:230, 1] = np.nan
    u = np.c_[np.full(400, 0.3), 0.1 * np.sin(t)]
    result = hgo_rs.ReducedOrderObserver(0.3).run(t, y, u, x_hat0=[3.0, 0.1, 0.1])
    told = [(gap.start, gap.length, gap.channel) for gap in result.gaps]
    assert told == [(100, 10, 0), (100, 10, 1), (200, 30, 1), (100, 10, 2)]
    assert result.gap_error.shape == (4, 3)
    assert np.isfinite(result.gap_error).all()


def test_gaps_of_a_slower_output():
    """A tenth of the samples, at times of their own: what is between them is no gap."""
    fast, slow = np.arange(2000) * 0.01, np.arange(200) * 0.1 + 4e-3
    t = np.sort(np.r_[fast, slow])
    y = np.c_[3.0 * t, 0.4 * np.sin(t), 0.1 * t]
    of_slow = np.isin(t, slow)
    y[of_slow, :2] = np.nan
    y[~of_slow, 2] = np.nan
    y[(t > 9.1) & (t < 9.35), 2] = np.nan  # the samples at 9.104, 9.204, 9.304
    y[(t > 11.995) & (t < 12.195), 0] = np.nan  # those from 12.0 to 12.19
    u = np.c_[np.full(len(t), 0.3), 0.1 * np.sin(t)]
    result = hgo_rs.ReducedOrderObserver(0.3).run(t, y, u, x_hat0=[3.0, 0.1, 0.1])
    first, second = result.gaps
    assert (first.channel, second.channel) == (0, 2)
    assert result.time[first.start] == pytest.approx(12.0)
    assert first.duration == pytest.approx(0.2)
    assert result.time[second.start] == pytest.approx(9.104, abs=0.03)
    assert second.duration == pytest.approx(0.3, abs=0.03)
    assert np.isfinite(result.gap_error).all()


def test_gaps_without_anything_to_learn_from():
    law = hgo_rs.StandardObserver(2, gain=12.0)
    y = np.sin(0.01 * np.arange(50))
    assert law.run(0.01, y).gap_error.shape == (0, 2)
    y[-1] = np.nan  # no sample ends it
    assert np.isnan(law.run(0.01, y).gap_error).all()
    y[:] = np.nan
    y[::2] = 0.5  # nothing but gaps
    assert law.run(0.01, y).gap_error.shape == (25, 2)
    y[:] = np.nan
    assert np.isnan(law.run(0.01, y).gap_error).all()
    y = np.sin(0.01 * np.arange(600))
    y[300:580] = np.nan  # longer than any complete part before it that has settled
    assert np.isfinite(law.run(0.01, y).gap_error).all()


def test_the_bound_of_a_chain_is_exact_for_its_worst_case():
    tau, mismatch = 0.7, 3.0
    e0 = np.array([0.1, 0.2, 0.3])
    expected = [
        sum(e0[j] * tau ** (j - i) / math.factorial(j - i) for j in range(i, 3))
        + mismatch * tau ** (3 - i) / math.factorial(3 - i)
        for i in range(3)
    ]
    bound = hgo_rs.gap_bound(tau, mismatch, n=3, error0=e0)
    np.testing.assert_allclose(bound, expected, rtol=1e-13)
    # with Lipschitz constants: the solution of the comparison system
    lipschitz = [9.81, 0.4]
    solution = solve_ivp(
        lambda t, e: [e[1], lipschitz[0] * e[0] + lipschitz[1] * e[1] + mismatch],
        (0.0, tau),
        [0.1, 0.2],
        rtol=1e-12,
        atol=1e-14,
    )
    bound = hgo_rs.gap_bound(tau, mismatch, n=2, error0=[0.1, 0.2], lipschitz=lipschitz)
    np.testing.assert_allclose(bound, solution.y[:, -1], rtol=1e-9)
    for bad in ({"duration": -1.0}, {"n": 0}, {"lipschitz": [1.0]}, {"error0": np.nan}):
        with pytest.raises(HgoError, match=next(iter(bad))):
            hgo_rs.gap_bound(**{"duration": 1.0, "mismatch": 1.0, "n": 2, **bad})


def test_the_bound_holds_on_a_pendulum():
    """Of a pendulum known up to a friction of 0.5 |v|, from a true start."""
    rng = np.random.default_rng(2)
    for _ in range(20):
        x0 = rng.uniform(-1.0, 1.0, 2) * [2.0, 3.0]

        def rate(_t, x, friction):
            return [x[1], -9.81 * np.sin(x[0]) - friction * x[1]]

        tau = float(rng.uniform(0.05, 0.5))
        real = solve_ivp(rate, (0, tau), x0, args=(0.5,), rtol=1e-9, atol=1e-11)
        known = solve_ivp(rate, (0, tau), x0, args=(0.0,), rtol=1e-9, atol=1e-11).y[:, -1]
        mismatch = 0.5 * np.abs(real.y[1]).max() * 1.05
        bound = hgo_rs.gap_bound(tau, mismatch, n=2, lipschitz=[9.81, 0.0])
        assert np.all(np.abs(real.y[:, -1] - known) <= bound)


def test_two_pendulums_with_gaps_jitter_and_a_slower_sensor():
    """Coupled, three quarters of the coupling known; the second sensor has a sixth of the rate."""
    rng = np.random.default_rng(3)
    fast = np.cumsum(rng.uniform(4e-3, 6e-3, 8000))
    slow = np.arange(0.02, fast[-1], 0.03)
    t = np.unique(np.r_[fast, slow])

    def rate(_t, x):
        q1, w1, q2, w2 = x
        between = 2.0 * (q1 - q2)
        first = -9.81 * np.sin(q1) - between - 0.05 * w1
        return [w1, first, w2, -9.81 * np.sin(q2) + between - 0.05 * w2]

    x = solve_ivp(rate, (0.0, t[-1]), [1.0, 0.0, -0.4, 0.0], t_eval=t, rtol=1e-8, atol=1e-9).y.T
    y = x[:, [0, 2]] + [1e-3, 2e-3] * rng.standard_normal((len(t), 2))
    y[~np.isin(t, fast), 0] = np.nan
    y[~np.isin(t, slow), 1] = np.nan
    for channel, usual, longest in ((0, 1, 80), (1, 6, 200)):
        k = 400
        while k < len(t) - 600:
            length = int(rng.integers(4 * usual, longest))
            y[k : k + length, channel] = np.nan
            k += length + int(rng.integers(250, 450))
    phi = ["-9.81*sin(q1) - c*(q1 - q2)", "-9.81*sin(q2) + c*(q1 - q2)"]
    model = hgo_rs.Model(
        states=["q1", "w1", "q2", "w2"], orders=[2, 2], parameters={"c": 1.5}, phi=phi
    )
    law = {"method": "zoh", "timing": "current"}
    chains = [hgo_rs.StandardObserver(2, ell, **law) for ell in (20.0, 10.0)]
    result = hgo_rs.MultiOutputObserver(chains, model=model).run(t, y)
    error = result.x_hat - x
    assert np.abs(error[400:]).max() < 1.0  # stays bounded, beside velocities of 4 rad/s
    for channel in (0, 1):
        mine = [i for i, gap in enumerate(result.gaps) if gap.channel == channel]
        mine = [i for i in mine if result.gaps[i].start >= 400]
        assert len(mine) > 15
        # the last row without a sample: the next one has been corrected by its own
        ends = [result.gaps[i].start + result.gaps[i].length - 1 for i in mine]
        of_chain = slice(2 * channel, 2 * channel + 2)
        measured = np.sqrt(np.mean(error[ends, of_chain] ** 2, axis=0))
        expected = np.sqrt(np.mean(result.gap_error[mine, of_chain] ** 2, axis=0))
        ratio = expected / measured
        assert np.all((ratio > 0.5) & (ratio < 2.0)), (channel, ratio)
