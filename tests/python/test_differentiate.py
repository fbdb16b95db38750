"""One line for a derivative: exact on polynomials, its band at the claimed rate, clocks."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone

import numpy as np
import pytest

from hgo_rs import HgoError, differentiate, smooth, tune

DT = 0.01


@pytest.mark.parametrize("noise", [None, 0.0])
@pytest.mark.parametrize("order", [1, 2, 3])
def test_exact_on_polynomials(order, noise):
    """Degree n - 1 at most, of which the record itself tells that it has no noise."""
    t = DT * np.arange(400)
    y = 1.0 - 2.0 * t + 0.7 * t**2
    found = differentiate(y, DT, order, noise)
    exact = [1.4 * t - 2.0, 1.4 + 0.0 * t, 0.0 * t][order - 1]
    assert found.noise == 0.0 and found.order == order
    largest = 1e-15 / DT**order * 100.0
    assert np.abs(found.derivative - exact).max() < largest
    assert found.deviation.max() < largest
    assert found.x_hat[:, order] == pytest.approx(found.derivative, abs=0.0)


def test_a_constant():
    found = differentiate(np.full(60, 3.0), DT)
    assert np.all(found.derivative == 0.0) and np.all(found.deviation < 1e-12)


SWING = 3.0


def swing(seed, count=2000, noise=0.01, dt=5e-3):
    t = dt * np.arange(count)
    y = np.sin(SWING * t) + noise * np.random.default_rng(seed).standard_normal(count)
    return t, y, (SWING * np.cos(SWING * t), -(SWING**2) * np.sin(SWING * t))


@pytest.mark.parametrize("noise", [None, 0.01])
@pytest.mark.parametrize("order", [1, 2])
def test_the_band_covers_at_the_claimed_rate(order, noise):
    """Of a sine with white noise, over six records."""
    inside = []
    for seed in range(6):
        _, y, true = swing(seed)
        found = differentiate(y, 5e-3, order, noise)
        for level in (0.683, 0.95):
            low, high = found.band(level)
            inside.append(np.mean((low < true[order - 1]) & (true[order - 1] < high)))
    one, two = np.mean(np.reshape(inside, (-1, 2)), axis=0)
    assert 0.63 < one < 0.74
    assert 0.925 < two < 0.98


def test_its_choice_is_that_of_tune():
    t, y, _ = swing(1)
    found, tuned = differentiate(y, t=t), tune(None, (t, y))
    assert found.observer.spec == tuned.observer.spec
    assert found.tuning.errors[1] == tuned.errors[1]
    assert found.deviation == pytest.approx(tuned.errors[1], rel=1e-9)
    assert found.noise == pytest.approx(0.01, rel=0.05)
    # the observer goes on line with the same numbers
    on_line = differentiate(y, t=t).observer
    on_line.reset(memory0=found.run.memory[1000], t=t[1000])
    on_line.predict(dt=t[1001] - t[1000])
    assert on_line.correct(y[1001])[1] == pytest.approx(found.derivative[1001], rel=1e-12)


def test_less_than_a_difference_and_more_than_the_smoother():
    t, y, true = swing(2)
    found = differentiate(y, 5e-3)
    errors = [
        np.sqrt(np.mean((v - true[0])[100:-100] ** 2))
        for v in (smooth(None, (t, y)).x[:, 1], found.derivative, np.gradient(y, t))
    ]
    assert errors[0] < errors[1] < 0.15 * errors[2]


@pytest.mark.parametrize("noise", [None, 0.01])
def test_gaps_and_uneven_steps(noise):
    """The band is wider in a gap, and covers there."""
    rng = np.random.default_rng(4)
    inside, wide = [], []
    for _ in range(4):
        t = np.cumsum(5e-3 * rng.uniform(0.7, 1.3, 1000))
        y = np.sin(SWING * t) + 0.01 * rng.standard_normal(1000)
        y[700:740] = np.nan
        found = differentiate(y, t=t, noise=noise)
        low, high = found.band()
        true = SWING * np.cos(SWING * t)
        inside.append((low < true) & (true < high))
        wide.append(found.deviation[739] / found.deviation[600])
    assert np.mean(inside) > 0.92
    assert np.mean(np.array(inside)[:, 700:740]) > 0.9
    assert min(wide) > 2.0


def test_clocks():
    pd = pytest.importorskip("pandas")
    t, y, _ = swing(3, 300)
    plain = differentiate(y, 5e-3, noise=0.01)
    same = lambda other: np.allclose(other.derivative, plain.derivative, rtol=1e-6, atol=1e-6)  # noqa: E731
    assert same(differentiate(y, t=t, noise=0.01))
    for period in (timedelta(milliseconds=5), np.timedelta64(5, "ms"), pd.Timedelta("5ms")):
        assert np.array_equal(differentiate(y, period, noise=0.01).derivative, plain.derivative)
    dates = pd.date_range("2026-03-01", periods=300, freq="5ms")
    for index in (
        dates,
        dates.tz_localize("Europe/Rome"),
        pd.to_timedelta(t, unit="s"),
        pd.Index(t, name="time"),
    ):
        found = differentiate(pd.Series(y, index=index), noise=0.01)
        assert same(found), index
        table = found.to_dataframe()
        assert table.index.equals(index) and list(table) == ["derivative", "deviation"]
        assert np.array_equal(table["derivative"], found.derivative)
    assert same(differentiate(y, t=np.asarray(dates), noise=0.01))
    zone = [
        datetime(2026, 3, 1, tzinfo=timezone.utc) + timedelta(milliseconds=5 * k)
        for k in range(300)
    ]
    assert same(differentiate(y, t=zone, noise=0.01))
    assert same(differentiate(pd.Series(y), 5e-3, noise=0.01))
    assert differentiate(y, 5e-3, noise=0.01).to_dataframe().index.name == "time"
    with pytest.raises(HgoError, match="index that counts rows"):
        differentiate(pd.Series(y), noise=0.01)
    with pytest.raises(HgoError, match=r"dt = 0\.01: must be 0\.005 s, the median step"):
        differentiate(pd.Series(y, index=dates), 0.01, noise=0.01)


def test_refusals():
    t, y, _ = swing(5, 300)
    for arguments, message in (
        ({}, "dt = None"),
        ({"dt": 5e-3, "t": t}, "must be one of them"),
        ({"dt": -1.0}, "dt = -1.0"),
        ({"dt": 5e-3, "order": 0}, "order = 0"),
        ({"dt": 5e-3, "order": 9}, "order = 9"),
        ({"dt": 5e-3, "noise": -1.0}, "noise = -1.0"),
        ({"t": t[::-1]}, "time must increase"),
        ({"t": ["a"] * 300}, "seconds, dates or durations"),
        ({"t": t[:10]}, "one time a sample"),
    ):
        with pytest.raises(HgoError, match=message):
            differentiate(y, **arguments)
    with pytest.raises(HgoError, match="give noise="):
        differentiate(y[:30], 5e-3)
    with pytest.raises(HgoError, match="20"):
        differentiate(y[:10], 5e-3, noise=0.01)
    with pytest.raises(HgoError, match=r"y of shape \(300, 2\): must be \(N,\)"):
        differentiate(np.column_stack([y, y]), 5e-3)
    assert differentiate(y[:30], 5e-3, noise=0.01).derivative.shape == (30,)
