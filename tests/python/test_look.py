"""`look`: what a log holds, against signals of which everything is known."""

import shlex
import subprocess
import sys

import numpy as np
import pytest

from hgo_rs.logs import DataError, look, read_log, write_table

T = np.arange(1000) / 100
Q = np.round(np.sin(3.0 * T), 3)


def column(found, name):
    return next(column for column in found.columns if column.name == name)


def test_a_log_is_described(tmp_path):
    t, q = T.copy(), Q.copy()
    t[500:] += 0.25
    q[300:340] = q[300]
    q[700:703] = np.nan
    path = tmp_path / "log.csv"
    write_table(path, {"t [s]": t, "row": np.arange(1000), "q [rad]": q, "still": np.ones(1000)})
    found = look(path)
    assert (found.rows, found.time, found.output) == (1000, "t [s]", "q [rad]")
    seen = column(found, "q [rad]")
    assert (seen.kind, seen.unit, seen.missing) == ("number", "rad", 3)
    assert (seen.low, seen.high) == (np.nanmin(q), np.nanmax(q))
    assert seen.resolution == pytest.approx(1e-3)
    moves = np.flatnonzero(np.diff(q) != 0.0)
    begin = int(moves[moves < 300][-1]) + 1
    assert (seen.still, seen.still_at) == (int(np.diff(moves).max()), begin)
    assert column(found, "row").kind == "integer" and not column(found, "row").is_signal
    assert "stands still" in str(found)
    assert "rate 100 Hz, no jitter, 1 longer step" in str(found)
    assert "longest step 0.26 s at t = 4.99 s" in str(found)
    assert found.command == f"hgo tune {path} --time 't [s]' --output 'q [rad]'"


def test_blocks_give_what_the_whole_gives(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    write_table(path, {"t": T, "q": np.repeat(Q[::50], 50)})
    whole = str(look(path))
    assert "50 rows from row 0" in whole
    for rows in (1, 7, 49, 50, 51):
        monkeypatch.setattr("hgo_rs.logs.overview.CHUNK", rows)
        assert str(look(path)) == whole


def test_jitter_is_measured(tmp_path):
    rng = np.random.default_rng(2)
    t = np.cumsum(0.01 + 1e-4 * rng.standard_normal(5000))
    write_table(tmp_path / "log.csv", {"t": t, "q": np.sin(t)})
    told = str(look(tmp_path / "log.csv"))
    jitter = float(told.split("jitter ")[1].split(" s")[0])
    assert jitter == pytest.approx(np.std(np.diff(t)), rel=0.06)


def test_times_in_two_columns_and_dates(tmp_path):
    path = tmp_path / "log.csv"
    rows = [f"{k // 100},{k % 100 * 10_000_000},{q}" for k, q in enumerate(Q)]
    path.write_text("secs,nsecs,q\n" + "\n".join(rows))
    assert look(path).command.endswith("--time secs+nsecs --output q")
    rows = [f"2024-03-05,09:07:{t:06.3f},{q}" for t, q in zip(T, Q, strict=True)]
    path.write_text("date,clock,q\n" + "\n".join(rows))
    assert look(path).command.endswith("--time date+clock --output q")


def test_what_cannot_be_read_is_told(tmp_path):
    path = tmp_path / "log.csv"
    rows = [f"{t},{q},a,0x1F" for t, q in zip(T, Q, strict=True)]
    path.write_text("t,q,note,raw\n" + "\n".join(rows).replace("0.05,0.149", "0.05,oops"))
    told = str(look(path))
    assert "line 7, column 'q': 'oops' is not a number" in told
    assert "column 'raw' begins with '0x1F'; it is hexadecimal" in told
    assert "no column of numbers moves" in told
    path.write_text("a,b\n" + "\n".join(f"{q},{q}" for q in Q))
    assert "no time column was found: name it with --time, or give --dt" in str(look(path))


def test_other_formats(tmp_path):
    pytest.importorskip("pandas").DataFrame({"t": T, "q": Q}).to_feather(tmp_path / "log.feather")
    np.savez(tmp_path / "log.npz", t=T, q=np.c_[Q, 2.0 * Q], short=Q[:9])
    for name, output in (("log.feather", "q"), ("log.npz", "'q[0]'")):
        found = look(tmp_path / name)
        assert found.command == f"hgo tune {tmp_path / name} --time t --output {output}"
        assert "rate 100 Hz, no jitter" in str(found)


def test_an_index_of_pandas_is_the_time(tmp_path):
    pandas = pytest.importorskip("pandas")
    pandas.DataFrame({"q": Q}, index=T).to_csv(tmp_path / "log.csv")
    found = look(tmp_path / "log.csv")
    assert found.command == f"hgo tune {tmp_path / 'log.csv'} --time '' --output q"
    assert "rate 100 Hz, no jitter" in str(found)
    pandas.DataFrame({"q": Q}).to_csv(tmp_path / "log.csv")  # rows that are counted
    assert "--dt PERIOD --output q" in look(tmp_path / "log.csv").command


def test_groups_of_an_hdf5_file(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        file["aside/q"] = Q[:9]
        file["drive/force"] = 2.0 * Q
        file["imu/time"], file["imu/q"] = T, np.c_[Q, 2.0 * Q]
    found = look(path)
    assert (found.time, found.output) == ("imu/time", "imu/q[0]")
    assert column(found, "imu/q[1]").unit == ""
    assert "rate 100 Hz, no jitter" in str(found)
    log = read_log(path, "/imu/time", ["/imu/q[1]", "drive/force"])
    np.testing.assert_array_equal(log.y, np.c_[2.0 * Q, 2.0 * Q])
    with pytest.raises(DataError, match=r"no column '/imu/Q\[1\]'; nearest: imu/q\[1\]"):
        read_log(path, "/imu/time", "/imu/Q[1]")


def test_cells_between_commas_are_not_one_column(tmp_path):
    path = tmp_path / "log.csv"
    rows = [f"{t},{q}" for t, q in zip(T, Q, strict=True)]
    path.write_text("\n".join(["t,q", *rows[:60], rows[60] + ",5", *rows[61:]]))
    with pytest.raises(DataError, match="line 62: 3 cells where 2 cells are expected"):
        look(path)


def test_arrays_without_a_signal(tmp_path):
    savemat = pytest.importorskip("scipy.io").savemat
    savemat(tmp_path / "log.mat", {"t": np.zeros((0, 0)), "note": "nothing"})
    assert "0 rows, 0 columns" in str(look(tmp_path / "log.mat"))
    savemat(tmp_path / "log.mat", {"t": T, "q": Q + 1j})
    with pytest.raises(DataError, match="holds complex128, not numbers; write its real part"):
        read_log(tmp_path / "log.mat", "t", "q")


def test_the_command_that_is_told_runs(tmp_path):
    path = tmp_path / "log.csv"
    noisy = Q + 1e-3 * np.random.default_rng(1).standard_normal(len(Q))
    write_table(path, {"Time [ms]": 1e3 * T, "q": noisy})
    run = [sys.executable, "-m", "hgo_rs.cli"]
    told = subprocess.run([*run, "look", path], capture_output=True, text=True, check=True).stdout
    command = shlex.split(told.split("next: hgo ")[1])
    subprocess.run([*run, *command], check=True, cwd=tmp_path, capture_output=True)
    assert (tmp_path / "log.observer.toml").exists()
