"""Logs in the formats of the extra `logs`, each written by its own library."""

from __future__ import annotations

import datetime
import gc
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs.cli import main
from hgo_rs.logs import DataError, Log, read_log

N = 400
DT = 0.01
T = DT * np.arange(N)
Q = np.sin(T) + 0.1 * np.cos(7.0 * T)
FORCE = np.cos(T)
SLOW = slice(0, N, 4)  # the input, on a slower clock where the format has several
STAMPS = 1_700_000_000_000_000_000 + np.round(T * 1e9).astype(np.int64)
"""Unix times, ns."""


def held(values: np.ndarray) -> np.ndarray:
    """The slow signal at the fast times."""
    return np.repeat(values[SLOW], 4)


# --- a file of each format -----------------------------------------------------------------------


def ros1(folder: Path) -> Path:
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    kind = store.types["sensor_msgs/msg/JointState"]
    header = store.types["std_msgs/msg/Header"]
    time = store.types["builtin_interfaces/msg/Time"]
    number = store.types["std_msgs/msg/Float64"]
    path = folder / "drive.bag"
    with Writer(path) as writer:
        joints = writer.add_connection("/joints", kind.__msgtype__, typestore=store)
        forces = writer.add_connection("/force", number.__msgtype__, typestore=store)
        for k in range(N):
            stamp = time(int(STAMPS[k]) // 10**9, int(STAMPS[k]) % 10**9)
            pair = np.array([1.0, Q[k]])
            message = kind(header(k, stamp, ""), ["a", "b"], pair, np.zeros(2), np.zeros(0))
            raw = store.serialize_ros1(message, kind.__msgtype__)
            writer.write(joints, int(STAMPS[k]) + 123_456, raw)  # recorded after its stamp
            if k % 4 == 0:
                raw = store.serialize_ros1(number(FORCE[k]), number.__msgtype__)
                writer.write(forces, int(STAMPS[k]), raw)
    return path


def ros2(folder: Path, storage: str) -> Path:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = store.types["geometry_msgs/msg/Vector3"]
    number = store.types["std_msgs/msg/Float64"]
    path = folder / "bag"
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage]) as writer:
        places = writer.add_connection("/arm/place", kind.__msgtype__, typestore=store)
        forces = writer.add_connection("/force", number.__msgtype__, typestore=store)
        for k in range(N):
            raw = store.serialize_cdr(kind(0.0, Q[k], 0.0), kind.__msgtype__)
            writer.write(places, int(STAMPS[k]), raw)
            if k % 4 == 0:
                raw = store.serialize_cdr(number(FORCE[k]), number.__msgtype__)
                writer.write(forces, int(STAMPS[k]), raw)
    return path


def mcap(folder: Path) -> Path:
    return next(ros2(folder, "MCAP").glob("*.mcap"))


def ulog(folder: Path) -> Path:
    """As PX4 writes it: the format's own library writes what it has read."""
    from pyulog import ULog

    def message(kind: str, content: bytes) -> bytes:
        return struct.pack("<HB", len(content), ord(kind)) + content

    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)]
    parts.append(message("B", bytes(40)))
    parts.append(message("F", b"place:uint64_t timestamp;double[2] q;"))
    parts.append(message("F", b"force:uint64_t timestamp;float f;"))
    for multi, number, name in ((0, 0, b"place"), (0, 1, b"force"), (1, 2, b"force")):
        parts.append(message("A", struct.pack("<BH", multi, number) + name))
    for k in range(N):
        time = 5_000_000 + round(T[k] * 1e6)
        parts.append(message("D", struct.pack("<HQdd", 0, time, 1.0, Q[k])))
        if k % 4 == 0:
            for number, value in ((1, 0.0), (2, FORCE[k])):
                parts.append(message("D", struct.pack("<HQf", number, time, value)))
    raw, path = folder / "raw.ulg", folder / "flight.ulg"
    raw.write_bytes(b"".join(parts))
    ULog(str(raw)).write_ulog(str(path))
    return path


def hdf5(folder: Path) -> Path:
    import h5py

    path = folder / "rig.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("rig")
        group["t_s"] = T
        group["q"] = np.column_stack([np.ones(N), Q])
        table = np.zeros(N // 4, dtype=[("t_s", "f8"), ("force", "f8")])
        table["t_s"], table["force"] = T[SLOW], FORCE[SLOW]
        file["drive"] = table
        file["note"] = "by hand"
    return path


def mat73(folder: Path) -> Path:
    """As MATLAB lays it out: a user block of 512 bytes, arrays transposed, a group a structure."""
    import h5py

    path = folder / "rig.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("rig")
        for name, values in {"t_s": T, "force": held(FORCE)}.items():
            group[name] = values[np.newaxis]
        group["q"] = np.vstack([np.ones(N), Q])
        text = group.create_dataset("name", data=np.array([[97, 98, 99]], dtype="u2"))
        text.attrs["MATLAB_class"] = np.bytes_("char")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    return path


def tdms(folder: Path) -> Path:
    from nptdms import ChannelObject, TdmsWriter

    def waveform(name: str, values: np.ndarray, dt: float) -> ChannelObject:
        start = np.datetime64("2024-05-01T10:00:00", "us")
        of = {"wf_increment": dt, "wf_start_offset": 0.0, "wf_start_time": start}
        return ChannelObject("rig", name, values, of)

    path = folder / "rig.tdms"
    with TdmsWriter(path) as writer:
        writer.write_segment([waveform("q", Q, DT), waveform("force", FORCE[SLOW], 4 * DT)])
        writer.write_segment([ChannelObject("plain", "q", Q), ChannelObject("plain", "t_s", T)])
    return path


def mf4(folder: Path) -> Path:
    from asammdf import MDF, Signal

    path = folder / "rig.mf4"
    with MDF(version="4.10") as file:
        file.append([Signal(Q, T, name="q"), Signal(2.0 * Q, T, name="load")])
        slow = [Signal(FORCE[SLOW], T[SLOW], name="force")]
        file.append([*slow, Signal(T[SLOW], T[SLOW], name="load")])
        file.save(path)
    return path


def excel(folder: Path) -> Path:
    from openpyxl import Workbook

    book = Workbook()
    sheet = book.active
    sheet.append([])
    sheet.append(["when", "q", "note"])
    start = datetime.datetime(2024, 5, 1, 10)
    for k in range(N):
        when = start + datetime.timedelta(milliseconds=10 * k)
        sheet.append([when, float(Q[k]), "begin" if k == 0 else None])
    drive = book.create_sheet("drive")
    drive.append(["when", "force"])
    for k in range(0, N, 4):
        drive.append([start + datetime.timedelta(milliseconds=10 * k), float(FORCE[k])])
    path = folder / "rig.xlsx"
    book.save(path)
    return path


def feather(folder: Path) -> Path:
    import pyarrow
    import pyarrow.feather

    path = folder / "rig.feather"
    table = pyarrow.table({"t_s": T, "q": Q, "force": held(FORCE)})
    pyarrow.feather.write_feather(table, path, chunksize=150)
    return path


Form = tuple[Callable[[Path], Path], Any, str, str]
FORMS: dict[str, Form] = {
    "ROS 1": (ros1, None, "/joints/position[1]", "/force/data"),
    "ROS 2, SQLite": (lambda folder: ros2(folder, "SQLITE3"), None, "/arm/place/y", "/force/data"),
    "ROS 2, MCAP": (lambda folder: ros2(folder, "MCAP"), None, "/arm/place/y", "/force/data"),
    "MCAP alone": (mcap, None, "/arm/place/y", "/force/data"),
    "ULog": (ulog, None, "place/q[1]", "force.1/f"),
    "HDF5": (hdf5, ["rig/t_s", "drive.t_s"], "rig/q[1]", "drive.force"),
    "MATLAB 7.3": (mat73, "rig.t_s", "rig.q[1]", "rig.force"),
    "TDMS": (tdms, None, "rig/q", "rig/force"),
    "MF4": (mf4, None, "q", "force"),
    "Excel": (excel, ["when", "drive/when"], "q", "drive/force"),
    "Feather": (feather, "t_s", "q", "force"),
}
LIBRARIES = ["rosbags", "pyulog", "h5py", "nptdms", "asammdf", "openpyxl", "pyarrow"]


@pytest.fixture(scope="module", params=FORMS)
def form(request: Any, tmp_path_factory: Any) -> Iterator[tuple[str, Path, Any, str, str]]:
    for library in LIBRARIES:
        pytest.importorskip(library)
    write, time, output, input = FORMS[request.param]
    yield request.param, write(tmp_path_factory.mktemp("log")), time, output, input


def alone(time: Any) -> Any:
    """The clock of the output."""
    return time[0] if isinstance(time, list) else time


def read(form: tuple[str, Path, Any, str, str]) -> Log:
    _, path, time, output, input = form
    return read_log(path, time, output, input)


def test_a_file_of_each_format_holds_the_signals(form: Any) -> None:
    log = read(form)
    np.testing.assert_allclose(log.t - log.t[0], T, rtol=0, atol=2e-9)
    # a workbook holds 16 digits; the force of the flight log is in single precision
    np.testing.assert_allclose(log.y, Q, rtol=0, atol=1e-15 if form[0] == "Excel" else 0.0)
    rounding = {"ULog": 1e-7, "Excel": 1e-15}.get(form[0], 0.0)
    np.testing.assert_allclose(log.u, held(FORCE), rtol=0, atol=rounding)


def test_an_estimate_of_a_file_is_that_of_the_arrays(form: Any, tmp_path: Path) -> None:
    _, path, time, output, _ = form
    given = [] if time is None else ["--time", alone(time)]
    out = tmp_path / "out.csv"
    observer = ["--observer", "standard", "--order", "2", "--gain", "20", "--start", "first-sample"]
    with pytest.raises(SystemExit) as ended:
        main(["estimate", str(path), *given, "--output", output, *observer, "--out", str(out)])
    assert ended.value.code in (None, 0)
    theirs = np.genfromtxt(out, delimiter=",", names=True)
    ours = hgo.StandardObserver(2, 20.0).run(T, Q, start="first-sample").x_hat
    assert len(theirs) == N
    for i, name in enumerate(["x_hat1", "x_hat2"]):  # times are whole ns or us in some formats
        np.testing.assert_allclose(theirs[name], ours[:, i], rtol=0, atol=1e-6)


def test_a_column_that_is_not_there_has_its_nearest(form: Any) -> None:
    _, path, time, output, _ = form
    with pytest.raises(DataError, match=f"has no column .*nearest: .*{output[:3]}"):
        read_log(path, alone(time), output + "x")


# the object that asammdf leaves behind cannot be deleted
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_file_that_is_cut_off_is_named(form: Any, tmp_path: Path) -> None:
    name, path, time, output, _ = form
    if path.is_dir():
        path = next(p for p in path.iterdir() if p.suffix != ".yaml")
    cut = tmp_path / path.name
    data = path.read_bytes()
    cut.write_bytes(data[: len(data) // 5])
    if name in ("ULog", "TDMS"):  # formats of streams: what is whole is read, and it is said
        log = read_log(cut, alone(time), output)
        assert 10 < len(log.t) < N
        assert "cut off" in log.describe() or "damaged" in log.describe()
        return
    with pytest.raises(DataError, match=r"not a readable|cannot read") as caught:
        read_log(cut, alone(time), output)
    assert str(cut) in str(caught.value)
    del caught
    gc.collect()


def test_a_library_that_is_missing_is_named(form: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    name, path, time, output, _ = form
    for library in LIBRARIES:
        monkeypatch.setitem(sys.modules, library, None)
    extra = "data" if name == "Feather" else "logs"
    with pytest.raises(hgo.HgoError, match=rf"pip install 'hgo_rs\[{extra}\]'"):
        read_log(path, alone(time), output)


def test_clocks_of_a_bag(tmp_path: Path) -> None:
    """A header's stamp is the clock where it is set, else when a message was recorded."""
    pytest.importorskip("rosbags")
    path = ros1(tmp_path)
    stamped = read_log(path, None, "/joints/position[1]")
    recorded = read_log(path, "/joints/log_time", "/joints/position[1]")
    assert stamped.names["time"] == "/joints/header/stamp"
    np.testing.assert_allclose(stamped.t, recorded.t, atol=2e-9)  # both count from their first
    assert "t counts from /joints/header/stamp = 2023-11-14T22:13:20" in stamped.describe()
    with pytest.raises(DataError, match="/joints/position"):
        read_log(path, None, "/joint/position[1]")


def test_channels_of_one_name(tmp_path: Path) -> None:
    pytest.importorskip("asammdf")
    path = mf4(tmp_path)
    np.testing.assert_array_equal(read_log(path, None, "0/load").y, 2.0 * Q)
    np.testing.assert_array_equal(read_log(path, None, "1/load").y, T[SLOW])


def test_channels_without_a_clock(tmp_path: Path) -> None:
    pytest.importorskip("nptdms")
    path = tdms(tmp_path)
    np.testing.assert_array_equal(read_log(path, "plain/t_s", "plain/q").y, Q)
    with pytest.raises(DataError, match="name the time column"):
        read_log(path, None, "plain/q")


def test_a_cell_of_text_is_named(tmp_path: Path) -> None:
    pytest.importorskip("openpyxl")
    from openpyxl import load_workbook

    path = excel(tmp_path)
    with pytest.raises(DataError, match="has no column 'note'"):
        read_log(path, "when", "note")
    book = load_workbook(path)
    book.active["B5"] = "n/a"
    book.save(path)
    with pytest.raises(DataError, match="'q', cell 3 below its name: 'n/a' is no number"):
        read_log(path, "when", "q")


def test_no_library_is_loaded_before_it_is_needed() -> None:
    code = "import sys, hgo_rs.logs, hgo_rs.cli; print(*sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {*LIBRARIES} & {*done.stdout.split()}
