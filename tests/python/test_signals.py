"""Records of other libraries: the same bits as from arrays of seconds."""

import datetime

import numpy as np
import pytest

import hgo_rs
from hgo_rs import HgoError, StandardObserver
from hgo_rs.logs import Log

COUNT = 300
T = np.arange(COUNT) / 200
Y = np.sin(2.0 * T)
U = np.cos(2.0 * T)
LAW = StandardObserver(2, 20.0, model=hgo_rs.InputGain(1.5))
BEGIN = np.datetime64("2024-03-05T09:07:03", "ns")
STEPS = 5_000_000 * np.arange(COUNT)
"""Nanoseconds."""


def same(*record, **options):
    found, wanted = LAW.run(*record, **options), LAW.run(T, Y, U)
    np.testing.assert_array_equal(found.time, T)
    np.testing.assert_array_equal(found.x_hat, wanted.x_hat)


def dates():
    return BEGIN + STEPS.astype("timedelta64[ns]")


@pytest.mark.parametrize("unit", ["ns", "us", "ms"])
def test_dates_and_durations_of_numpy(unit):
    same(dates().astype(f"datetime64[{unit}]"), Y, U)
    same((dates() - BEGIN).astype(f"timedelta64[{unit}]"), Y, U)


def test_dates_and_durations_of_the_standard_library():
    zone = datetime.timezone(datetime.timedelta(hours=2))
    steps = [datetime.timedelta(milliseconds=5 * k) for k in range(COUNT)]
    for origin in (datetime.datetime(2024, 3, 5), datetime.datetime(2024, 3, 5, tzinfo=zone)):
        same([origin + step for step in steps], Y, U)
    same(steps, Y, U)


def test_a_duration_is_a_period():
    pandas = pytest.importorskip("pandas")
    wanted = LAW.run(0.005, Y, U).x_hat
    for dt in (
        datetime.timedelta(milliseconds=5),
        np.timedelta64(5, "ms"),
        np.timedelta64(5_000_000, "ns"),
        pandas.Timedelta("5ms"),
    ):
        np.testing.assert_array_equal(LAW.run(dt, Y, U).x_hat, wanted)
        one, other = (StandardObserver(2, 20.0, model=hgo_rs.InputGain(1.5)) for _ in range(2))
        for y, u in zip(Y[:5], U[:5], strict=True):
            np.testing.assert_array_equal(one.step(y, u, dt=dt), other.step(y, u, dt=0.005))
        assert hgo_rs.FixedStep(dt).dt == 0.005
    with pytest.raises(HgoError, match="dt: t holds durations without a unit"):
        LAW.step(0.0, 0.0, dt=np.timedelta64(5))
    with pytest.raises(HgoError, match=r"must be a number"):
        StandardObserver(2, np.timedelta64(20, "s"))


@pytest.mark.parametrize("zone", [None, "UTC", "Europe/Berlin"])
def test_pandas(zone):
    pandas = pytest.importorskip("pandas")
    stamps = pandas.DatetimeIndex(dates()).tz_localize(zone)
    same(stamps, Y, U)
    same(pandas.Series(stamps), pandas.Series(Y), pandas.Series(U))
    same(stamps - stamps[0], Y, U)
    for index in (stamps, stamps - stamps[0], pandas.Index(T, name="t")):
        series = pandas.Series(Y, index=index)
        same(series, u=U)
        frame = pandas.DataFrame({"q": Y, "tau": U, "note": ["a"] * COUNT}, index=index)
        same(frame, "q", "tau")
        same(frame[["q", "tau"]], u="tau")
    same(pandas.DataFrame({"stamp": stamps, "q": Y, "tau": U}), "q", "tau")
    same(pandas.DataFrame({"time [ms]": 5 * np.arange(COUNT), 7: Y, "u": U}), 7, "u")


def test_indices_of_pandas_that_are_no_dates():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"q": Y, "tau": U})
    stamps = 1_709_629_623_000 + 5 * np.arange(COUNT)
    for index in (
        pandas.period_range("2024-03-05", periods=COUNT, freq="5ms"),
        pandas.Index(stamps, name="stamp_ms"),
        pandas.Index(1e-3 * (stamps - stamps[0]), name="t"),
    ):
        found = LAW.run(frame.set_index(index), "q", "tau")
        np.testing.assert_allclose(found.x_hat, LAW.run(T, Y, U).x_hat, rtol=0.0, atol=1e-12)
    levels = pandas.MultiIndex.from_product([[0, 1], range(COUNT // 2)])
    for index, told in (
        (levels, "the index has several levels"),
        (dates().astype(str), "text becomes times by pandas.to_datetime"),
    ):
        with pytest.raises(HgoError, match=told):
            LAW.run(frame.set_index(index), "q", "tau")
    with pytest.raises(HgoError, match=r"must be \(N,\).*; take one of its columns, of a frame by"):
        StandardObserver(2, 20.0).run(frame.set_index(dates()))


def test_what_pandas_holds_as_missing_is_missing():
    pandas = pytest.importorskip("pandas")
    y = pandas.array([None if k == 9 else k for k in range(COUNT)], dtype="Int64")
    found = LAW.run(pandas.DataFrame({"t": T, "q": y, "u": U}), "q", "u")
    np.testing.assert_array_equal(np.flatnonzero(found.missing), [9])
    np.testing.assert_array_equal(LAW.run(T, y, U).x_hat, found.x_hat)
    np.testing.assert_array_equal(LAW.run(T, pandas.Series(y), U).x_hat, found.x_hat)
    stamps = pandas.DatetimeIndex(dates()).where(np.arange(COUNT) != 9)
    with pytest.raises(HgoError, match="t at sample 9 is not finite"):
        LAW.run(stamps, Y, U)


def test_polars():
    polars = pytest.importorskip("polars")
    frame = polars.DataFrame({"stamp": dates(), "q": Y, "tau": U})
    same(frame, "q", "tau")
    same(frame["stamp"], frame["q"], frame["tau"])
    same(polars.DataFrame({"t": T, "q": Y, "tau": U}), u="tau")


def test_xarray():
    xarray = pytest.importorskip("xarray")
    same(xarray.DataArray(Y, coords={"time": dates()}), u=U)
    same(xarray.DataArray(Y, coords={"time": T}), u=U)


def test_a_log_is_run_as_its_arrays():
    names = {"time": "t", "output": "q", "input": "u"}
    same(Log(T, Y, U, names, "log.csv", np.isnan(Y)))
    with pytest.raises(HgoError, match=r"pieces of the log = 2: .* take one of log\.pieces"):
        LAW.run(Log(T, Y, U, names, "log.csv", np.isnan(Y), (0, 100)))
    with pytest.raises(HgoError, match="left out with a Log"):
        LAW.run(Log(T, Y, U, names, "log.csv", np.isnan(Y)), Y)


def test_records_without_times_are_refused():
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"q": Y, "tau": U})
    stamped = frame.assign(t=T, stamp_ms=5 * np.arange(COUNT))
    unix = frame.assign(t=1_700_000_000_000 + 5 * np.arange(COUNT))
    cases = [
        ((frame, "q", "tau"), "the index counts its rows: must be the times"),
        ((pandas.Series(Y),), r"the index counts its rows: .* give the times: \(t, y\)"),
        ((pandas.Series(Y, index=list(map(str, T))),), "must be the times of the samples"),
        ((stamped, "q", "tau"), r"several columns of times \(t, stamp_ms\)"),
        ((unix, "q", "tau"), "1700000000000 is a Unix time in ms; give them in s"),
        ((frame.assign(t=T), "Q"), "y = 'Q': must be a column of the frame .*; nearest: q"),
        ((frame.assign(t=T), Y), "y: must be names of the frame's columns"),
        ((frame.assign(t=T, note="a"),), "column 'note': must hold numbers"),
        ((T,), "y = None: must be given"),
        (([BEGIN, datetime.timedelta(1)], [0.0, 1.0]), "must be dates alone or durations alone"),
    ]
    for record, told in cases:
        with pytest.raises(HgoError, match=told):
            LAW.run(*record)
