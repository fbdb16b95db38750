"""Logs in every format; errors that name file, line and remedy."""

import csv
import math
import os
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hgo_rs.errors import HgoError
from hgo_rs.logs import DataError, LogSummary, TableWriter, read_chunks, read_log, write_table
from hgo_rs.logs.formats import tables
from hgo_rs.logs.read import CHUNK
from hgo_rs.logs.text import LINE

SHARED = Path(__file__).parents[3] / "shared" / "data"
needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="no ../shared/data")


def write(tmp_path, text, name="log.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def refusal(path, *args, **options):
    with pytest.raises(DataError) as caught:
        read_log(path, *args, **options)
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    return message


@pytest.mark.parametrize("delimiter", [",", ";", "\t", ", ", "  "])
def test_csv_delimiters(tmp_path, delimiter):
    lines = [("t", "q", "u"), ("0", "1.5", "-1"), ("0.1", "2.5e-3", "-2"), ("0.25", ".5", "3")]
    path = write(tmp_path, "\n".join(delimiter.join(cells) for cells in lines))
    log = read_log(path, "t", "q", "u")
    np.testing.assert_array_equal(log.t, [0.0, 0.1, 0.25])
    np.testing.assert_array_equal(log.y, [1.5, 2.5e-3, 0.5])
    np.testing.assert_array_equal(log.u, [-1.0, -2.0, 3.0])
    assert log.names == {"time": "t", "output": "q", "input": "u"}
    assert log.source == str(path)
    assert not log.missing.any()


def test_csv_without_header_is_named_by_index(tmp_path):
    path = write(tmp_path, "5,0.0\n6,0.5\n7,1.0\n")
    log = read_log(path, "1", "0")
    np.testing.assert_array_equal(log.t, [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(log.y, [5.0, 6.0, 7.0])
    assert "(no header: columns are named from 0)" in refusal(path, "t", "0")


def test_csv_comments_blank_lines_quotes_bom_and_text_columns(tmp_path):
    text = '\ufeff# made by hand\n\n"t","q, m",note\n0,1,start\n# a pause\n\n1,2,"on, off"\n2,3,\n'
    log = read_log(write(tmp_path, text), "t", "q, m")
    np.testing.assert_array_equal(log.y, [1.0, 2.0, 3.0])


def test_missing_samples_are_counted_and_placed(tmp_path):
    cells = ["1", "", "3", "nan", "NA", "null", "7", "NaN"]
    path = write(tmp_path, "t,q\n" + "".join(f"{0.5 * i},{c}\n" for i, c in enumerate(cells)))
    log = read_log(path, "t", "q")
    np.testing.assert_array_equal(np.flatnonzero(log.missing), [1, 3, 4, 5, 7])
    np.testing.assert_array_equal(np.isnan(log.y), log.missing)
    assert log.longest_gap == (3, 6)
    assert log.describe().endswith(
        "5 missing samples; the longest gap has 3, from t = 1.5 s to 2.5 s"
    )


def test_longest_gap_without_one(tmp_path):
    log = read_log(write(tmp_path, "t,q\n0,1\n1,2\n2,2\n4.5,2\n"), "t", "q")
    assert log.longest_gap == (0, 0)
    assert "missing" not in log.describe()
    assert "longest step 2.5 s at t = 2 s" in log.describe()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,q\n0,1\n1,abc\n2,3\n", "line 3, column 'q': 'abc' is not a number"),
        ("t,q\n0,1\n\n# c\n1\n2,3\n", "line 5: 1 cell where 2 cells are expected"),
        ("t,q\n0,1\n1,2,3\n", "line 3: 3 cells where 2 cells are expected"),
        ("t;q\n0.5;1\n1;2,5\n", "line 3, column 'q': '2,5' is not a number; write a decimal point"),
        ("t;q\n0,5;1\n1;2.5\n", "line 3, column 'q': '2.5' is not a number; write a decimal comma"),
        ("t,q\n0,1\n1,1_000\n", "line 3, column 'q': '1_000' is not a number"),
        ('t,q\n0,"1\n2"\n1,2\n', "line 2, column 'q': '1\\n2' is not a number"),
        ('t,q\n0,1\n1,"2\n', "line 3: unexpected end of data"),
        ("t,q\n0,1\n1,inf\n", "line 3: 'q' is infinite; leave a missing sample empty"),
        ("t,q\n0,1\n,2\n", "line 3: the time 't' is missing or infinite"),
        ("t,q\n0,1\n-inf,2\n", "line 3: the time 't' is missing or infinite"),
        ("t,q\n0,1\n2,2\n2,3\n", "line 4: time 2 does not come after 2 (line 3)"),
        ("t,q\n0,1\n# c\n2,2\n1,3\n", "line 5: time 1 does not come after 2 (line 4)"),
        ("t,q\n0,1\n", "1 samples; an observer needs at least 2"),
        ("t,q\n0,\n1,nan\n", "column 'q' holds no sample"),
        ("t,q,q\n0,1,2\n1,2,3\n", "2 columns are called 'q'; rename one"),
        ("", "is empty"),
        ("# only a comment\n", "is empty"),
    ],
)
def test_malformed_csv(tmp_path, text, message):
    assert message in refusal(write(tmp_path, text), "t", "q")


def test_missing_input_is_refused(tmp_path):
    path = write(tmp_path, "t,q,u\n0,1,0\n1,2,\n2,3,0\n")
    assert "line 3: the input 'u' is missing or infinite" in refusal(path, "t", "q", "u")


def test_unknown_column_names_the_nearest(tmp_path):
    path = write(tmp_path, "time,Position,velocity\n0,1,2\n1,2,3\n")
    message = refusal(path, "time", "position_m")
    assert "has no column 'position_m'; nearest: Position" in message
    assert message.endswith("Columns: time, Position, velocity")


def test_unknown_file_and_format(tmp_path):
    write(tmp_path, "t,q\n0,1\n", "axis_run1.csv")
    assert "nearest: axis_run1.csv" in refusal(tmp_path / "axis_run2.csv", "t", "q")
    assert "unknown format '.docx'" in refusal(write(tmp_path, "", "log.docx"), "t", "q")
    (tmp_path / "folder.csv").mkdir()
    assert "is a folder" in refusal(tmp_path / "folder.csv", "t", "q")


def test_dt_in_place_of_and_beside_a_time_column(tmp_path):
    path = write(tmp_path, "t,q\n0.001,1\n0.098,2\n0.202,3\n0.300,4\n")
    np.testing.assert_array_equal(read_log(path, None, "q", dt=0.1).t, 0.1 * np.arange(4))
    np.testing.assert_array_equal(read_log(path, "t", "q", dt=0.1).t, 0.001 + 0.1 * np.arange(4))
    assert "leave dt out to use the recorded times" in refusal(path, "t", "q", dt=0.2)
    for dt in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(DataError, match="dt"):
            read_log(path, "t", "q", dt=dt)
    with pytest.raises(DataError, match="name the time column, or give dt"):
        read_log(path, None, "q")


def test_structures_and_cells_are_columns_by_their_paths(tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    t = np.arange(5) * 0.1
    both = np.c_[3.0 * t, t**2]
    scope = {"time": t[:, None], "signals": {"values": both, "label": "pos"}, "blockName": "Scope"}
    cells = np.array([{"a": 4.0 * t}, {"a": 5.0 * t}, "text"], dtype=object)
    path = tmp_path / "scope.mat"
    scipy_io.savemat(path, {"Data": scope, "plain": t, "cells": cells, "list": [scope, scope]})
    log = read_log(path, "Data.time", ["Data.signals.values[1]", "cells[1].a", "plain"])
    np.testing.assert_array_equal(log.t, t)
    np.testing.assert_array_equal(log.y, np.c_[t**2, 5.0 * t, t])
    np.testing.assert_array_equal(read_log(path, "plain", "list[1].signals.values[0]").y, 3.0 * t)
    told = refusal(path, "plain", "Data.signals.value[1]")
    assert "nearest: Data.signals.values[1]" in told
    path = tmp_path / "records.npz"
    dtype = [("t", float), ("pose", [("q", float), ("w", float, 2)]), ("name", "U3")]
    rows = np.zeros(5, dtype)
    rows["t"], rows["pose"]["q"], rows["pose"]["w"] = t, 2.0 * t, both
    np.savez(path, log=rows, held=np.array({"t": t}, dtype=object))
    log = read_log(path, "log.t", ["log.pose.q", "log.pose.w[1]"])
    np.testing.assert_array_equal(log.y, np.c_[2.0 * t, t**2])
    told = refusal(path, "log.t", "held")
    assert "held holds Python objects: save its arrays by their names" in told
    assert "Columns: log.t, log.pose.q, log.pose.w[0], log.pose.w[1]" in told


def test_npz(tmp_path):
    path = tmp_path / "log.npz"
    t = np.arange(5) * 0.1
    np.savez(path, t=t, q=np.c_[t, 2 * t], row=t[None, :], gain=3.0, name="axis", short=t[:3])
    np.testing.assert_array_equal(read_log(path, "t", "q[1]").y, 2 * t)
    np.testing.assert_array_equal(read_log(path, "t", "row").y, t)
    assert "Columns: t, q[0], q[1], row, short" in refusal(path, "t", "gain")
    assert "differ in length (t: 5, short: 3)" in refusal(path, "t", "short")
    stuck = tmp_path / "stuck.npz"
    np.savez(stuck, t=np.zeros(3), q=np.zeros(3))
    assert "row 1 (counted from 0): time 0 does not come after 0" in refusal(stuck, "t", "q")


def test_mat(tmp_path):
    from scipy.io import savemat

    path = tmp_path / "log.mat"
    t = np.arange(6) * 0.5
    y = t.copy()
    y[2] = np.nan
    savemat(path, {"t": t, "q": y[:, None], "n": np.arange(6, dtype=np.int32)})
    log = read_log(path, "t", "q", "n")
    np.testing.assert_array_equal(log.t, t)
    np.testing.assert_array_equal(np.flatnonzero(log.missing), [2])
    np.testing.assert_array_equal(log.u, np.arange(6.0))


@pytest.mark.parametrize("name", ["log.npz", "log.mat", "log.parquet"])
def test_broken_binary_files(tmp_path, name):
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow")
    path = tmp_path / name
    path.write_bytes(b"this is not such a file, whatever its name says" * 20)
    assert "is not a readable" in refusal(path, "t", "q")


def test_parquet_with_times_of_day_and_nulls(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    t = np.datetime64("2024-01-01T12:00:00", "us") + np.arange(4) * np.timedelta64(250, "ms")
    path = tmp_path / "log.parquet"
    pq.write_table(pyarrow.table({"t": t, "q": [1.0, None, 3.0, 4.0], "s": list("abcd")}), path)
    log = read_log(path, "t", "q")
    np.testing.assert_allclose(log.t, [0.0, 0.25, 0.5, 0.75], rtol=1e-12)
    np.testing.assert_array_equal(np.flatnonzero(log.missing), [1])
    assert "not numbers" in refusal(path, "t", "s")


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_what_is_written_reads_back_bit_for_bit(tmp_path, suffix):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / f"estimates{suffix}"
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.01, 0.1, 50))
    y = rng.standard_normal(50) * 10.0 ** rng.integers(-12, 12, 50)
    y[[3, 4]] = np.nan
    write_table(path, {"t": t, "x_hat1": y, "missing": np.isnan(y).astype(int)})
    log = read_log(path, "t", "x_hat1", "missing")
    np.testing.assert_array_equal(log.t, t)
    np.testing.assert_array_equal(log.y, y)
    np.testing.assert_array_equal(log.u, np.isnan(y))


def test_what_cannot_be_written(tmp_path):
    with pytest.raises(DataError, match=r"unknown format '\.xlsx'"):
        write_table(tmp_path / "x.xlsx", {"t": np.zeros(2)})
    with pytest.raises(DataError, match="cannot write"):
        write_table(tmp_path / "absent" / "x.csv", {"t": np.zeros(2)})
    assert issubclass(DataError, HgoError)


@given(st.text(alphabet="0123456789.,;-+eEnaq\t\n\"'# _", max_size=60))
def test_any_text_is_read_or_refused(tmp_path_factory, text):
    """No text ends in anything but a log or a `DataError`."""
    path = tmp_path_factory.mktemp("fuzz") / "log.csv"
    path.write_text(text, encoding="utf-8", newline="")
    try:
        log = read_log(path, "0", "1")
    except DataError as error:
        assert str(path) in str(error)
    else:
        assert len(log.t) == len(log.y) >= 2
        assert (np.diff(log.t) > 0).all()


# --- several outputs -------------------------------------------------------------------------


def test_several_outputs_and_inputs(tmp_path):
    path = write(tmp_path, "t,a,b,u,v\n0,1,,5,6\n1,,2,5,6\n2,,,7,8\n3,4,5,7,8\n")
    log = read_log(path, "t", ["b", "a"], ["u", "v"])
    nan = np.nan
    np.testing.assert_array_equal(log.y, [[nan, 1], [2, nan], [nan, nan], [5, 4]])
    np.testing.assert_array_equal(log.u, [[5, 6], [5, 6], [7, 8], [7, 8]])
    np.testing.assert_array_equal(log.missing, np.isnan(log.y))
    assert log.longest_gap == (2, 3)
    told = log.describe().splitlines()
    assert told[1] == "b: 2 missing samples; the longest gap has 1, from t = 0 s to 0 s"
    assert told[2] == "a: 2 missing samples; the longest gap has 2, from t = 1 s to 2 s"
    assert read_log(path, "t", ["a"]).y.shape == (4, 1)
    path = write(tmp_path, "t,a,b\n0,1,\n1,2,\n")
    assert "column 'b' holds no sample" in refusal(path, "t", ["a", "b"])


def test_outputs_with_times_of_their_own(tmp_path):
    path = write(
        tmp_path,
        "ta,a,tb,b,tu,u\n0.0,1,0.05,10,0,1\n0.1,2,0.25,20,0.12,2\n0.2,3,,,,\n0.3,4,,,,\n",
    )
    nan = np.nan
    log = read_log(path, ["ta", "tb", "tu"], ["a", "b"], "u")
    np.testing.assert_array_equal(log.t, [0.0, 0.05, 0.1, 0.12, 0.2, 0.25, 0.3])
    np.testing.assert_array_equal(log.y[:, 0], [1, nan, 2, nan, 3, nan, 4])
    np.testing.assert_array_equal(log.y[:, 1], [nan, 10, nan, nan, nan, 20, nan])
    np.testing.assert_array_equal(log.u, [1, 1, 1, 2, 2, 2, 2])  # held
    both = tmp_path / "log.npz"
    np.savez(both, t1=np.arange(5.0), q=np.arange(5.0), t2=[0.5, 2.0], v=[7.0, 8.0])
    log = read_log(both, ["t1", "t2"], ["q", "v"])
    np.testing.assert_array_equal(log.t, [0, 0.5, 1, 2, 3, 4])
    np.testing.assert_array_equal(log.y[:, 1], [nan, 7, nan, 8, nan, nan])
    assert "time: 2 columns for 3 outputs" in refusal_of_names(path, ["ta", "tb"], ["a", "b", "u"])
    for options in ({"dt": 0.1}, {"resets": "split"}):
        with pytest.raises(DataError, match="several columns go without dt and resets"):
            read_log(path, ["ta", "tb"], ["a", "b"], **options)
    late = write(tmp_path, "ta,a,tu,u\n0,1,0.5,1\n1,2,0.7,2\n", "late.csv")
    assert "begins at 0.5 s, after the first sample at 0 s" in refusal(
        late, ["ta", "tu"], ["a"], "u"
    )
    back = write(tmp_path, "ta,a,tb,b\n0,1,0.5,1\n1,2,0.4,2\n", "back.csv")
    assert "line 3: time 0.4 does not come after 0.5 (line 2)" in refusal(
        back, ["ta", "tb"], ["a", "b"]
    )


def refusal_of_names(*args):
    with pytest.raises(DataError) as caught:
        read_log(*args)
    return str(caught.value)


# --- units and resets of time ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "unit", "scale", "remark"),
    [
        ("t", None, 1, ""),
        ("t", "ms", 1e3, ""),
        ("t_ms", None, 1e3, "times 't_ms' are in ms, as the name says"),
        ("t_ms", "us", 1e6, "times 't_ms' are taken in us, though the name says ms"),
        ("time [us]", None, 1e6, "times 'time [us]' are in us, as the name says"),
        ("Time (µs)", None, 1e6, "as the name says"),
        ("stamp.ns", None, 1e9, "as the name says"),
        ("time_s", None, 1, ""),
        ("ms", None, 1e3, "times 'ms' are in ms, as the name says"),
        ("items", None, 1, ""),
    ],
)
def test_units_of_time(tmp_path, name, unit, scale, remark):
    path = write(tmp_path, f"{name};q\n0;1\n5;2\n15;3\n")
    log = read_log(path, name, "q", unit=unit)
    np.testing.assert_array_equal(log.t, np.array([0.0, 5.0, 15.0]) / scale)
    assert remark in " ".join(log.remarks)
    assert bool(log.remarks) == bool(remark)
    assert log.describe().endswith(remark)


@pytest.mark.parametrize(("unit", "per_s"), [("ms", 10**3), ("us", 10**6), ("ns", 10**9)])
@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_unix_times_keep_every_digit(tmp_path, unit, per_s, suffix):
    base = 1_700_000_000 * per_s + 1
    times = base + np.array([0, 3, 7, 10**6 + 1], dtype=np.int64)
    path = tmp_path / f"log{suffix}"
    if suffix == ".npz":
        np.savez(path, stamp=times, q=np.arange(4.0))
    else:
        path.write_text("stamp,q\n" + "".join(f"{t},{k}\n" for k, t in enumerate(times)))
    log = read_log(path, "stamp", "q")
    assert f"read as Unix times in {unit}" in log.describe()
    np.testing.assert_array_equal(log.t, (times - base) / per_s)
    assert f"t counts from stamp = {base}" in log.describe()


def test_units_that_make_no_sense(tmp_path):
    path = write(tmp_path, "t,q\n0,1\n5,2\n")
    with pytest.raises(HgoError, match="unit = 'year': must be one of s, ms, us, ns, min"):
        read_log(path, "t", "q", unit="year")
    with pytest.raises(DataError, match="unit: it is the time column's"):
        read_log(path, None, "q", dt=0.1, unit="ms")


RESET = "t,q\n0,1\n1,2\n2,3\n0,4\n1,5\n0.05,6\n1,7\n"


@pytest.mark.parametrize("rows", [1, 2, 3, 100])
def test_a_clock_that_starts_again(tmp_path, rows):
    path = write(tmp_path, RESET)
    said = refusal(path, "t", "q")
    assert "line 5: time 0 does not come after 2 (line 4); the clock was set back: cut the" in said
    assert 'resets = "split"' in said
    log = read_log(path, "t", "q", resets="split")
    assert log.starts == (0, 3, 5)
    assert [piece.t.tolist() for piece in log.pieces] == [[0, 1, 2], [0, 1], [0.05, 1]]
    assert [piece.y.tolist() for piece in log.pieces] == [[1, 2, 3], [4, 5], [6, 7]]
    assert "longest" not in log.describe()
    assert "3 pieces between resets of the clock" in log.describe()
    chunks = list(read_chunks(path, "t", "q", resets="split", rows=rows))
    assert np.concatenate([c.t for c in chunks]).tolist() == log.t.tolist()
    offsets = np.cumsum([0, *(len(c.t) for c in chunks)])
    starts = [o + k for o, c in zip(offsets, chunks, strict=False) for k in c.starts]
    assert tuple(starts) == log.starts
    # a step back that is no restart stays an error
    path = write(tmp_path, "t,q\n0,1\n1,2\n2,3\n1.5,4\n")
    assert "sort the log" in refusal(path, "t", "q", resets="split")
    exact = read_log(write(tmp_path, RESET), "t", "q", resets="split", dt=1.0)
    np.testing.assert_array_equal(exact.t, [0, 1, 2, 0, 1, 0.05, 1.05])


def test_times_of_a_schedule(tmp_path):
    from hgo_rs import StochasticApproximation

    law = StochasticApproximation(0.5, 0.1, 20.0, 0.9)
    path = write(tmp_path, "q\n" + "1\n" * 50)
    log = read_log(path, None, "q", schedule=law)
    steps = [0.5 * 0.1 * (1 + k / 20.0) ** -0.9 for k in range(49)]
    np.testing.assert_allclose(log.t, np.r_[0.0, np.cumsum(steps)], rtol=1e-14)
    chunks = list(read_chunks(path, None, "q", schedule=law, rows=7))
    np.testing.assert_array_equal(np.concatenate([c.t for c in chunks]), log.t)
    with pytest.raises(DataError, match="schedule: give it alone"):
        read_log(path, None, "q", schedule=law, dt=0.1)


# --- clocks: one origin, exact differences -----------------------------------------------------

BEGIN = 1_709_629_623_000_000_000  # a Unix time in ns
FAST = BEGIN + np.arange(200) * 5_000_000
SLOW = BEGIN + 500_000_000 + np.arange(20) * 50_000_000
CLOCKS = {
    "ns": lambda t: t,
    "unsigned ns": lambda t: t.astype(np.uint64),
    "big-endian ns": lambda t: t.astype(">i8"),
    "us": lambda t: t // 10**3,
    "ms": lambda t: t // 10**6,
    "float s": lambda t: t / 1e9,
    "float ms": lambda t: t / 1e6,
    "float ns": lambda t: t.astype(float),
    "date in ns": lambda t: t.astype("M8[ns]"),
    "date in us": lambda t: t.astype("M8[ns]").astype("M8[us]"),
    "date in ms": lambda t: t.astype("M8[ns]").astype(">M8[ms]"),
}


def lag(log):
    """From the first sample of the first output to that of the second."""
    there = ~np.isnan(log.y)
    return log.t[there[:, 1]][0] - log.t[there[:, 0]][0]


@pytest.mark.parametrize("second", CLOCKS)
@pytest.mark.parametrize("first", CLOCKS)
def test_clocks_of_any_types_and_units_have_one_origin(tmp_path, first, second):
    path = tmp_path / "two.npz"
    np.savez(path, ta=CLOCKS[first](FAST), a=np.ones(200), tb=CLOCKS[second](SLOW), b=np.ones(20))
    log = read_log(path, ["ta", "tb"], ["a", "b"])
    resolved = 3e-7 if "float" in first + second else 1e-12
    assert lag(log) == pytest.approx(0.5, abs=resolved)
    assert log.t[-1] - log.t[0] == pytest.approx(1.45, abs=resolved)
    if "float" not in first + second:  # equal times are one row
        assert len(log.t) == 200 + 20 - 10


@pytest.mark.parametrize("pad", ["", "nan"])
def test_padded_columns_keep_every_digit(tmp_path, pad):
    """Two blocks, in the second of which the slow clock has no sample at all."""
    count = CHUNK + 100
    times = BEGIN + 1 + np.arange(count) * 5_000_000
    lines = [f"{t},1,{pad},{pad}" for t in times.tolist()]
    lines[:20] = [f"{t},1,{s + 1},2" for t, s in zip(times.tolist(), SLOW.tolist(), strict=False)]
    log = read_log(write(tmp_path, "\n".join(["ta,a,tb,b", *lines])), ["ta", "tb"], ["a", "b"])
    np.testing.assert_array_equal(log.t, np.arange(count) * 5_000_000 / 1e9)
    assert lag(log) == 0.5


def test_integers_with_nulls_in_parquet_keep_every_digit(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    def padded(values, kind):
        return pyarrow.array(values.tolist() + [None] * 180, kind)

    table = {"ta": FAST + 1, "a": np.ones(200), "b": padded(np.ones(20), pyarrow.float64())}
    for kind in (pyarrow.int64(), pyarrow.uint64(), pyarrow.timestamp("ns")):
        table["tb"] = padded(SLOW + 1, kind)
        pq.write_table(pyarrow.table(table), tmp_path / "two.parquet")
        log = read_log(tmp_path / "two.parquet", ["ta", "tb"], ["a", "b"])
        assert lag(log) == 0.5
        assert len(log.t) == 210


def arrays(tmp_path, **columns):
    np.savez(tmp_path / "log.npz", **columns)
    return tmp_path / "log.npz"


def test_clocks_with_nothing_in_common_are_refused(tmp_path):
    both = {"time": ["ta", "tb"], "output": ["a", "b"]}
    boot = SLOW - BEGIN
    days, since = FAST.astype("M8[ns]"), boot.astype("m8[ns]")
    ones = {"a": np.ones(200), "b": np.ones(20)}
    path = arrays(tmp_path, ta=days, tb=since, **ones)
    assert "do not overlap, they lie 54.2 years apart" in refusal(path, **both)
    path = arrays(tmp_path, ta=FAST, tb=boot, **ones)
    assert "likely ns (a step of 0.05 s)" in refusal(path, **both)
    assert "do not overlap" in refusal(path, unit=["ns", "ns"], **both)
    path = arrays(tmp_path, ta=np.arange(200) * 5, tb=np.arange(20) * 0.05, **ones)
    assert "as if of different units; say each: unit = [...]" in refusal(path, **both)
    log = read_log(path, unit=["ms", "s"], **both)
    np.testing.assert_array_equal(log.t, np.arange(200) * 5 / 1e3)
    with pytest.raises(DataError, match="unit: 3 for 2 time columns"):
        read_log(path, unit=["ms", "s", "s"], **both)


@pytest.mark.parametrize("kind", [np.uint64, np.int64, np.uint32, np.int32, np.uint16])
def test_differences_of_integers_neither_wrap_nor_round(tmp_path, kind):
    top = min(int(np.iinfo(kind).max) // 4, 2**61)
    times = (top + np.arange(100) * 5).astype(kind)
    q = np.ones(100)
    log = read_log(arrays(tmp_path, t=times, q=q), "t", "q", unit="ns")
    np.testing.assert_allclose(np.diff(log.t), 5e-9, rtol=1e-6)
    back = refusal(arrays(tmp_path, t=times[::-1], q=q), "t", "q", unit="ns")
    assert "the log runs backwards, newest first: sort it by time" in back


@pytest.mark.parametrize(("kind", "bits"), [(np.uint16, 16), (np.int32, 32), (np.uint32, 32)])
def test_a_counter_that_wraps_is_told_to_be_unwrapped(tmp_path, kind, bits):
    end = int(np.iinfo(kind).max)
    times = (end - 500 + np.arange(200, dtype=np.int64) * 5).astype(kind)
    path = arrays(tmp_path, t_ms=times, q=np.ones(200))
    assert f"numpy.unwrap(column, period=2**{bits})" in refusal(path, "t_ms", "q")
    split = read_log(path, "t_ms", "q", resets="split")
    assert any(f"a counter of {bits} bits began again" in remark for remark in split.remarks)
    made = np.unwrap(times.astype(float), period=2.0**bits)  # the remedy works
    log = read_log(arrays(tmp_path, t_ms=made, q=np.ones(200)), "t_ms", "q")
    np.testing.assert_allclose(np.diff(log.t), 5e-3, rtol=1e-6)


def test_times_that_are_no_numbers_or_too_large(tmp_path):
    q = np.ones(4)
    for t, message in (
        (np.arange(4) > 0, "column 't' holds bool, not numbers"),
        (
            np.array([1, 2, np.iinfo(np.int64).min, 4]),
            "which is no time; leave a missing one empty",
        ),
        (np.array([1, 2, 2**64 - 1, 4], np.uint64), "which is no time; leave a missing one empty"),
        (np.arange(4).astype("m8[M]"), "is in months, which have no fixed length"),
    ):
        assert message in refusal(arrays(tmp_path, t=t, q=q), "t", "q")
    months = np.array(["2024-01", "2024-02", "2024-03", "2024-04"], "M8[M]")
    assert "median step of the time 't' is 31 days" in refusal(
        arrays(tmp_path, t=months, q=q), "t", "q"
    )
    coarse = (8192.0 + np.arange(100) * 1e-3).astype(np.float32)
    log = read_log(
        arrays(tmp_path, t=np.unique(coarse), q=np.ones(len(np.unique(coarse)))), "t", "q"
    )
    assert "a resolution of only 0.000977 s" in log.describe()


# --- units that cannot be ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "per_s"),
    [
        *(("TimeUS", 1e6), ("micros", 1e6), ("time_usec", 1e6), ("Zeit [µs]", 1e6), ("tUS", 1e6)),
        *(("millis", 1e3), ("TimeMSec", 1e3), ("ms since boot", 1e3), ("time_boot_ms", 1e3)),
        *(("nanoTime", 1e9), ("t/ns", 1e9), ("seconds", 1.0), ("t [min]", 1 / 60)),
        *(("elapsed_minutes", 1 / 60), ("hours", 1 / 3600), ("time [h]", 1 / 3600)),
    ],
)
def test_names_that_say_their_unit(tmp_path, name, per_s):
    times = np.arange(50) * 0.005 * per_s
    path = write(tmp_path, f"{name};q\n" + "".join(f"{t!r};1\n" for t in times.tolist()))
    log = read_log(path, name, "q")
    np.testing.assert_allclose(log.t, np.arange(50) * 0.005, rtol=1e-12)
    assert not log.assumed


@pytest.mark.parametrize(
    "name", ["ticks", "time_us_ms", "index", "frame", "Unnamed: 0", "t_h", "t_d", "t_m", "weeks"]
)
def test_names_that_leave_the_unit_open_are_asked(tmp_path, name):
    path = write(tmp_path, f"{name};q\n0;1\n5;2\n15;3\n")
    said = refusal(path, name, "q")
    assert f"the unit of the time {name!r} is unknown" in said and "give unit = " in said
    assert read_log(path, name, "q", unit="ms").t[1] == 0.005


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (429_617_575 + np.arange(50) * 5000, "is 5000 s, taken in s, which neither unit nor the"),
        (429_617_575 + np.arange(50) * 5000, "likely us (a step of 0.005 s) or ms (a step of 5 s)"),
        (np.arange(50) * 1e6, "is 11.6 days, taken in s"),
        (3_600_000_000_000 + np.arange(50) * 5_000_000, "taken in ms, which neither"),  # uptime, ns
        (133_542_000_000_000_000 + np.arange(50) * 50_000, "years from its origin"),  # 100 ns
        (739_000.3 + np.arange(50) * 5e-3 / 86400, "a MATLAB date in days"),
        (45_356.3 + np.arange(50) * 5e-3 / 86400, "a spreadsheet date in days"),
        (np.r_[np.arange(50) * 0.005, 1.7e9 + np.arange(50) * 0.005], "leaps by 53.9 years"),
    ],
)
def test_units_that_cannot_be(tmp_path, times, message):
    path = arrays(tmp_path, t=times, q=np.ones(len(times)))
    said = refusal(path, "t", "q")
    assert message in said
    assert "unit" in said


def test_a_unit_that_is_said_is_taken_within_reason(tmp_path):
    hourly = arrays(tmp_path, t=np.arange(50) * 3600, q=np.ones(50))
    assert "median step of the time 't' is 3600 s" in refusal(hourly, "t", "q")
    assert read_log(hourly, "t", "q", unit="s").t[1] == 3600.0
    days = arrays(tmp_path, t=739_000.25 + np.arange(50) / 8.0, q=np.ones(50))
    np.testing.assert_array_equal(np.diff(read_log(days, "t", "q", unit="d").t), 10_800.0)
    wrong = arrays(tmp_path, t=np.arange(50) * 2_000_000, q=np.ones(50))
    assert "say another unit, or give dt in place" in refusal(wrong, "t", "q", unit="s")
    assert len(read_log(wrong, None, "q", dt=2e6).t) == 50
    assert "years from its origin" in refusal(
        arrays(tmp_path, t=1_700_000_000_000 + np.arange(50) * 5, q=np.ones(50)), "t", "q", unit="s"
    )


def test_a_unit_beside_dates_is_said_to_be_idle(tmp_path):
    path = arrays(tmp_path, t=FAST.astype("M8[ns]"), q=np.ones(200))
    log = read_log(path, "t", "q", unit="ms")
    np.testing.assert_array_equal(log.t, (FAST - BEGIN) / 1e9)
    assert "times 't' have a unit of their own, not ms" in log.remarks
    assert "t counts from t = 2024-03-05T09:07:03" in log.describe()


def test_dt_beside_times_of_a_guessed_unit(tmp_path):
    path = arrays(tmp_path, t=np.arange(50) * 5, q=np.ones(50))
    said = refusal(path, "t", "q", dt=0.005)
    assert "leave dt out to use the recorded times, or give a unit other than s" in said
    np.testing.assert_array_equal(
        read_log(path, "t", "q", dt=0.005, unit="ms").t, 0.005 * np.arange(50)
    )


def test_later_parts_are_checked_as_the_first(tmp_path):
    """The unit changes after two blocks: the steps there are those of no record in seconds."""
    first, count = CHUNK + 100, 5000
    times = np.r_[np.arange(first) * 0.005, first * 0.005 + 1e3 * np.arange(1, count)]
    path = write(tmp_path, "t,q\n" + "".join(f"{t!r},1\n" for t in times.tolist()))
    for rows in (500, None):
        with pytest.raises(DataError, match="the median step of the time 't' is 1000 s"):
            list(read_chunks(path, "t", "q", rows=rows))
    times = np.r_[np.arange(first) * 0.005, 1.7e9]
    path = write(tmp_path, "t,q\n" + "".join(f"{t!r},1\n" for t in times.tolist()))
    assert f"line {first + 2}: the time 't' leaps by 53.9 years" in refusal(path, "t", "q")


# --- order -------------------------------------------------------------------------------------


@pytest.mark.parametrize("resets", ["refuse", "split"])
@pytest.mark.parametrize("order", ["newest first", "shuffled", "interleaved", "pages"])
def test_rows_out_of_order_are_no_pieces(tmp_path, resets, order):
    t = np.arange(300) * 0.015
    t = {
        "newest first": t[::-1],
        "shuffled": np.random.default_rng(0).permutation(t),
        "interleaved": np.c_[t, t + 20.0].ravel(),
        "pages": t.reshape(6, 50)[:, ::-1].ravel(),
    }[order]
    path = arrays(tmp_path, t=t, q=np.ones(len(t)))
    said = refusal(path, "t", "q", resets=resets)
    assert "sort" in said or (order == "interleaved" and resets == "refuse")
    if order == "newest first":
        assert "newest first: sort it by time" in said


def test_times_written_with_too_few_digits(tmp_path):
    times = [f"{1.7e9 + 0.005 * k:.6g}" for k in range(50)]
    path = write(tmp_path, "t,q\n" + "".join(f"{t},1\n" for t in times))
    assert "or write times with all their digits" in refusal(path, "t", "q")


def test_a_last_piece_of_one_row_is_refused(tmp_path):
    path = write(tmp_path, "t,q\n" + "".join(f"{k},1\n" for k in range(50)) + "0,1\n")
    assert "line 52: the last piece has 1 row" in refusal(path, "t", "q", resets="split")


# --- headers of numbers ------------------------------------------------------------------------

RISING = 0.005 * np.arange(1, 300)


def shown(t, q, form):
    return "".join(f"{form(a)},{form(b)}\n" for a, b in zip(t.tolist(), q.tolist(), strict=True))


@pytest.mark.parametrize(
    ("first", "rest"),
    [
        ("0,1", shown(RISING, 5.0 + np.sin(RISING), repr)),  # leaps in q
        ("0,1", shown(RISING + 1.7e9, np.cos(RISING), repr)),  # leaps in t
        ("0,1", shown(RISING, np.cos(RISING), repr)),  # 1.0 is no bare 1
        ("0,1", shown(RISING, np.cos(RISING), "{:.3f}".format)),
        ('"0","1"', shown(RISING, np.cos(RISING), "{:g}".format)),
        ("0,1", "".join(f"{5 * k},{512 + k % 7}\n" for k in range(299))),
    ],
)
def test_a_header_of_numbers_is_no_sample(tmp_path, first, rest):
    path = write(tmp_path, f"{first}\n{rest}")
    log = read_log(path, "0", "1", unit="s")
    assert len(log.t) == 299
    assert "line 1 (0, 1) is read as a header" in log.describe()
    assert "repeats the header" in refusal(
        write(tmp_path, f"{first}\n{rest}{first}\n{rest}"), "0", "1", unit="s", resets="split"
    )


def test_headers_of_other_numbers_and_with_an_index(tmp_path):
    rows = list(zip(RISING.tolist(), np.cos(RISING).tolist(), strict=True))
    index = "".join(f"{k},{a!r},{b!r}\n" for k, (a, b) in enumerate(rows))
    log = read_log(write(tmp_path, ",0,1\n" + index), "0", "1")
    assert (log.t[0], log.y[0], len(log.t)) == (*rows[0], 299)
    log = read_log(write(tmp_path, "2,7\n" + shown(RISING, np.cos(RISING), repr)), "2", "7")
    assert (log.t[0], log.y[0], len(log.t)) == (*rows[0], 299)


@pytest.mark.parametrize(
    "text",
    [
        "0,1\n" + shown(RISING, np.cos(RISING), "{:g}".format),
        "0,1\n1,2\n2,3\n3,4\n",
        "0\n" + "".join(f"{q!r}\n" for q in np.sin(RISING).tolist()),
        "100,7\n" + "".join(f"{100 + 5 * k},{512 + k % 7}\n" for k in range(1, 50)),
    ],
)
def test_what_could_be_a_header_or_a_sample_is_refused(tmp_path, text):
    first, rest = text.split("\n", 1)
    named = {"time": "0", "output": "1"} if "," in first else {"time": None, "output": "0"}
    named |= {} if "," in first else {"dt": 0.005}
    said = refusal(write(tmp_path, text), unit="s" if "," in first else None, **named)
    assert "may be a header or a sample" in said
    pointed = ",".join(f"{cell}.0" for cell in first.split(","))  # the remedies work
    count = text.count("\n")
    unit = {"unit": "s"} if "," in first else {}
    assert len(read_log(write(tmp_path, f"{pointed}\n{rest}"), **named, **unit).y) == count
    above = ",".join("tq"[2 - first.count(",") - 1 :][: first.count(",") + 1])
    named = {key: {"0": above[0], "1": above[-1]}.get(v, v) for key, v in named.items()}
    assert len(read_log(write(tmp_path, f"{above}\n{text}"), **named, **unit).y) == count


def test_a_first_sample_of_whole_numbers_stays_one(tmp_path):
    rows = "".join(f"{100 + 5 * k},{512 + k % 7}\n" for k in range(50))
    assert len(read_log(write(tmp_path, rows), "0", "1", unit="ms").t) == 50
    rows = "0,0\n" + shown(RISING, np.sin(RISING), repr)
    assert len(read_log(write(tmp_path, rows), "0", "1").t) == 300


# --- bounds ------------------------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes in the file system")
def test_what_may_have_no_end_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "device.csv").symlink_to("/dev/zero")
    for name in ("pipe.csv", "device.csv"):
        assert "is a pipe or a device" in refusal(tmp_path / name, "t", "q")
    with (tmp_path / "line.csv").open("wb") as file:
        file.truncate(2**33)  # one line of zeros, which take no room
    assert "line 1: has more than 1048576 characters" in refusal(tmp_path / "line.csv", "t", "q")
    long = "t,q\n0,1\n1," + " " * LINE + "2\n"
    assert "line 3: has more than" in refusal(write(tmp_path, long), "t", "q")


def test_only_named_arrays_are_unpacked(tmp_path, monkeypatch):
    import psutil
    from scipy.io import savemat

    t = np.arange(100) * 0.01
    np.savez_compressed(tmp_path / "log.npz", t=t, q=np.c_[t, 2 * t], other=np.zeros(3_000_000))
    savemat(tmp_path / "log.mat", {"t": t, "q": np.c_[t, 2 * t], "other": np.zeros(3_000_000)})
    free = type("Memory", (), {"available": 2**24})
    monkeypatch.setattr(psutil, "virtual_memory", lambda: free)
    for name in ("log.npz", "log.mat"):
        np.testing.assert_array_equal(read_log(tmp_path / name, "t", "q[1]").y, 2 * t)
        assert "Columns: t, q[0], q[1], other" in refusal(tmp_path / name, "t", "speed")
        assert "unpack to 0.0224 GiB" in refusal(tmp_path / name, "t", "other")


def test_names_from_a_file_do_nothing_to_a_terminal(tmp_path):
    path = write(tmp_path, "t,q\x1b[2J\n0,1\n1,\n2,3\n", "a\x1b[31m.csv")
    with pytest.raises(DataError) as caught:
        read_log(path, "t", "q")
    assert "a\\x1b[31m.csv has no column 'q'. Columns: t, q\\x1b[2J" in str(caught.value)
    text = read_log(path, "t", ["q\x1b[2J"]).describe()
    assert all(line.isprintable() for line in text.splitlines())


# --- chunks ----------------------------------------------------------------------------------


@settings(deadline=None)
@given(
    st.lists(
        st.text(alphabet='0123456789.,-eNa"#_ ', max_size=12)
        | st.tuples(st.floats(0, 1e20), st.floats()).map(lambda v: f"{v[0]!r},{v[1]!r}")
        | st.sampled_from(["1,", "2,NaN", "3,nan", ",", "4,NA", '5,"6"', "7 , 8", "9,\t1"]),
        max_size=8,
    ),
    st.integers(1, 4),
)
def test_lines_are_read_as_python_reads_them(tmp_path_factory, lines, rows):
    """Cells of the module csv, numbers of `float`; any cutting into chunks gives the same."""
    path = tmp_path_factory.mktemp("fuzz") / "log.csv"
    path.write_text("t,q\n0,1\n" + "\n".join(lines), encoding="utf-8", newline="")
    whole = outcome(lambda: [table_of(path, 10**6)])
    cut = outcome(lambda: list(tables(path, ["t", "q"], rows)))
    wanted = by_python(lines)
    if wanted is None:
        assert isinstance(whole, str) and isinstance(cut, str)
    else:
        assert whole == cut == wanted


def table_of(path, rows):
    (table,) = tables(path, ["t", "q"], rows)
    return table


def outcome(read):
    try:
        found = read()
    except DataError as error:
        return str(error)
    return b"".join(np.concatenate([t.columns[n] for t in found]).tobytes() for n in ("t", "q"))


def by_python(lines):
    """The bytes of both columns; None: a line that is refused."""
    values = [[0.0, 1.0]]
    try:
        for cells in records(line + "\n" for line in lines):
            if len(cells) != 2 or any("_" in cell for cell in cells):
                return None
            empty = [cell.strip().casefold() in ("", "na", "nan") for cell in cells]
            pairs = zip(cells, empty, strict=True)
            values.append([math.nan if none else float(cell) for cell, none in pairs])
    except (csv.Error, ValueError):
        return None
    return np.array(values).T.tobytes()


def records(lines):
    """The cells of lines that begin no comment."""
    while first := next((line for line in lines if line.strip() and line.lstrip()[0] != "#"), ""):
        yield next(csv.reader(chain([first], lines), skipinitialspace=True, strict=True))


def test_lines_are_counted_over_chunks_comments_and_quotes(tmp_path):
    lines = ["t,q,note"] + [f"{k},{k},x" for k in range(10)]
    lines[4] = '3,3,"two\nlines"'
    lines.insert(8, "# a comment")
    lines.append("10,ten,x")
    path = write(tmp_path, "\n".join(lines))
    for rows in (1, 2, 3, 5, 100):
        with pytest.raises(DataError, match=r"line 14, column 'q': 'ten' is not a number"):
            list(read_chunks(path, "t", "q", rows=rows))


def test_a_summary_of_chunks_is_that_of_the_whole(tmp_path):
    t = np.cumsum(np.r_[0.0, np.full(60, 0.5)])
    t[40:] += 3.0
    y = [("" if 17 <= k < 33 or k in (3, 60) else "1") for k in range(61)]
    path = write(tmp_path, "t,q\n" + "".join(f"{a},{b}\n" for a, b in zip(t, y, strict=True)))
    whole = read_log(path, "t", "q").describe()
    assert "longest step 3.5 s at t = 19.5 s" in whole
    assert "18 missing samples; the longest gap has 16, from t = 8.5 s to 16 s" in whole
    for rows in (2, 7, 20):
        summary = LogSummary()
        for chunk in read_chunks(path, "t", "q", rows=rows):
            summary.add(chunk)
        assert summary.describe() == whole


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_is_written_in_chunks_or_not_at_all(tmp_path, suffix):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / f"table{suffix}"
    t = np.arange(10.0)
    with TableWriter(path) as writer:
        for rows in (slice(0, 4), slice(4, 10)):
            writer.write({"t": t[rows], "q": t[rows] / 3.0})
        assert not path.exists()
    chunks = list(read_chunks(path, "t", "q", rows=3))
    assert len(chunks) == 4
    np.testing.assert_array_equal(np.concatenate([c.y for c in chunks]), t / 3.0)
    before = path.read_bytes()
    with pytest.raises(RuntimeError), TableWriter(path) as writer:
        writer.write({"t": t, "q": t})
        raise RuntimeError
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@needs_shared
def test_positioning_axis():
    log = read_log(SHARED / "DATA_EMPS.mat", "t", "qm", "vir")
    assert len(log.t) == 24_841
    np.testing.assert_allclose(np.diff(log.t), 1e-3, rtol=1e-4)
    assert log.u is not None
    assert len(log.u) == len(log.t)


@needs_shared
def test_beetle_track_has_no_header():
    log = read_log(SHARED / "beetle_track.csv", "2", "0")
    assert log.y[0] == -40.321
    np.testing.assert_allclose(np.median(np.diff(log.t)), 0.4, rtol=1e-9)
