"""Files are written whole or not at all, whoever writes them."""

import os
import subprocess
import sys

import numpy as np
import pytest

from hgo_rs import Config, HgoError, LowPowerObserver, export, load
from hgo_rs.cli.reproduce import OutputFolder
from hgo_rs.files import replacing, together, write_bytes, write_text
from hgo_rs.logs import TableWriter, write_table

posix = pytest.mark.skipif(os.name == "nt", reason="modes, links and limits of POSIX")

FULL = """
import resource, signal, sys
import numpy as np
import hgo_rs
from hgo_rs import files, plots
from hgo_rs.cli import reproduce
from hgo_rs.logs import write_table
observer = hgo_rs.LowPowerObserver(12, 5.0, method="euler")
columns = {"t": np.arange(5000.0), "y": np.random.default_rng(0).normal(size=5000)}
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (300, resource.RLIM_INFINITY))
try:
    WRITE
except (OSError, hgo_rs.HgoError) as error:
    print(type(error).__name__, error)
else:
    print("nothing was said")
"""
WRITERS = {
    "configuration": ("observer.toml", "observer.save('observer.toml')"),
    "csv": ("table.csv", "write_table('table.csv', columns)"),
    "parquet": ("table.parquet", "write_table('table.parquet', columns)"),
    "result of a scenario": (
        "results.json",
        "reproduce.OutputFolder('.').write('results.json', b' ' * 1000)",
    ),
    "source": ("observer.c", "observer.export(to='c', out='.')"),
    "figure": ("a.png", "plots.save(plots.new_figure(), 'a.png')"),
}


@posix
@pytest.mark.parametrize("writer", WRITERS)
def test_a_full_disk_is_told_and_leaves_the_earlier_file(tmp_path, writer):
    """A limit of the size of files fails a write as a full disk does."""
    name, call = WRITERS[writer]
    if writer == "parquet":
        pytest.importorskip("pyarrow")
    if writer == "figure":
        pytest.importorskip("matplotlib")
    (tmp_path / name).write_text("what was here")
    done = subprocess.run(
        [sys.executable, "-c", FULL.replace("WRITE", call)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "nothing was said" not in done.stdout
    assert (tmp_path / name).read_text() == "what was here"
    assert not list(tmp_path.glob(".hgo-*"))


def test_several_files_take_their_places_together(tmp_path):
    a, b, c = (tmp_path / name for name in "abc")
    write_text(b, "earlier")
    with pytest.raises(KeyboardInterrupt), together([a, b]) as files:
        for file in files:
            file.write(b"new")
        raise KeyboardInterrupt
    assert b.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [b]
    with together([a, b]) as files:
        for file in files:
            file.write(b"new")
    assert (a.read_text(), b.read_text()) == ("new", "new")
    assert sorted(tmp_path.iterdir()) == [a, b]
    with pytest.raises(OSError, match=f"written before it: {a}") as caught, together([a, c]):
        c.mkdir()  # in the meantime
        (c / "inside").write_text("")
    assert caught.value.filename == str(c)
    assert sorted(tmp_path.iterdir()) == [a, b, c]


def test_a_block_that_fails_leaves_the_earlier_file(tmp_path):
    path = tmp_path / "a"
    write_text(path, "earlier")
    with pytest.raises(KeyboardInterrupt), replacing(path) as file:
        file.write(b"half of the new one")
        raise KeyboardInterrupt
    assert path.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [path]


@posix
def test_mode_and_link_stay(tmp_path):
    path, link = tmp_path / "a", tmp_path / "link"
    write_bytes(path, b"1")
    umask = os.umask(0)
    os.umask(umask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~umask
    path.chmod(0o640)
    link.symlink_to("a")
    write_bytes(link, b"2")
    assert link.is_symlink()
    assert path.read_bytes() == b"2"
    assert path.stat().st_mode & 0o777 == 0o640


@posix
def test_what_is_no_regular_file_stays_what_it_is(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_bytes(pipe, b"through")
    assert os.read(reader, 100) == b"through"
    os.close(reader)
    assert pipe.is_fifo()
    with pytest.raises(IsADirectoryError):
        write_bytes(tmp_path, b"")


@posix
@pytest.mark.skipif(getattr(os, "geteuid", int)() == 0, reason="root may write everything")
def test_a_protected_file_is_not_replaced(tmp_path):
    path = tmp_path / "a"
    write_bytes(path, b"1")
    path.chmod(0o444)
    with pytest.raises(PermissionError):
        write_bytes(path, b"2")
    assert path.read_bytes() == b"1"


def test_a_missing_folder_is_told(tmp_path):
    observer = LowPowerObserver(2, 5.0, method="euler")
    with pytest.raises(HgoError, match="cannot write"):
        observer.save(tmp_path / "no" / "a.toml")
    with pytest.raises(HgoError, match="cannot write"):
        write_table(tmp_path / "no" / "a.csv", {"t": np.zeros(1)})
    (tmp_path / "file").write_text("")
    with pytest.raises(HgoError, match="cannot"):
        export(observer, to="c", out=tmp_path / "file")


def test_a_table_in_pieces_comes_whole(tmp_path):
    path = tmp_path / "a.csv"
    with TableWriter(path) as writer:
        writer.write({"t": np.array([0.0, 0.5])})
        assert not path.exists()
        writer.write({"t": np.array([np.nan])})
    assert path.read_bytes() == b"t\n0.0\n0.5\n\n"
    with pytest.raises(ZeroDivisionError), TableWriter(path) as writer:
        writer.write({"t": np.array([1.0])})
        raise ZeroDivisionError
    assert path.read_bytes() == b"t\n0.0\n0.5\n\n"
    with pytest.raises(HgoError, match="no columns"), TableWriter(tmp_path / "b.csv"):
        pass
    assert list(tmp_path.iterdir()) == [path]


def test_an_observer_saved_over_itself_is_read_again(tmp_path):
    path, observer = tmp_path / "observer.toml", LowPowerObserver(3, 5.0, method="euler")
    observer.save(path)
    observer.step(1.0, dt=1e-3)
    observer.save(path)
    assert load(path) == Config.of(observer)
    assert OutputFolder(tmp_path).write("a", b"b").read_bytes() == b"b"
