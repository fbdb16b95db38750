"""`hgo smooth`, `hgo fit`, `hgo compare`: what they say, write and refuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs.cli import main

MODEL = """\
format = 1
observer = "standard"
gain = 12.0
log = { time = "t", output = "q", input = "u" }
[model]
states = ["q", "v"]
inputs = ["u"]
parameters = { d = 0.8, b = 1.0 }
phi = "b*u - d*v"
"""


@pytest.fixture
def axis(tmp_path, monkeypatch):
    """A log of a driven mass with friction 0.5, and its velocity."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    t = np.arange(2000) * 4e-3
    u = np.sign(np.sin(4.0 * t)) + np.sin(9.0 * t)
    q, v = np.zeros(2000), np.zeros(2000)
    for k in range(1999):
        kicks = 0.1 * np.sqrt(4e-4) * rng.standard_normal(10)
        q[k + 1], v[k + 1] = q[k], v[k]
        for kick in kicks:
            a = u[k] - 0.5 * v[k + 1]
            q[k + 1], v[k + 1] = q[k + 1] + 4e-4 * v[k + 1], v[k + 1] + 4e-4 * a + kick
    y = q + 1e-3 * rng.standard_normal(2000)
    np.savetxt("axis.csv", np.c_[t, y, u, v], delimiter=",", header="t,q,u,v", comments="")
    Path("axis.toml").write_text(MODEL)
    return v


def run(*words):
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    return int(end.value.code or 0)


def test_smooth(axis, capsys):
    assert run("smooth", "axis.csv", "--config", "axis.toml") == 0
    told = capsys.readouterr().out
    assert "2000 samples smoothed" in told and "axis.smooth.csv" in told
    table = np.genfromtxt("axis.smooth.csv", delimiter=",", names=True)
    assert table.dtype.names == ("time", "y", "q", "v", "std_q", "std_v")
    data = np.genfromtxt("axis.csv", delimiter=",", skip_header=1)
    found = hgo.smooth(hgo.load("axis.toml").observer().model, tuple(data.T[:3]))
    assert np.allclose(table["v"], found.state("v"), rtol=1e-9, atol=1e-9)
    assert np.sqrt(np.mean((table["v"] - axis) ** 2)) < 1.3 * np.mean(table["std_v"])
    pytest.importorskip("matplotlib")
    assert Path("axis.smooth.png").stat().st_size > 10_000
    assert run("smooth", "axis.csv", "--time", "t", "--output", "q", "--order", "2") == 0


def test_fit_writes_a_file_that_estimates_better(axis, capsys):
    words = ("fit", "axis.csv", "--config", "axis.toml", "--parameter", "d", "--out", "new.toml")
    assert run(*words) == 0
    told = capsys.readouterr().out
    assert "std. error" in told and "new.toml" in told
    old, new = hgo.load("axis.toml"), hgo.load("new.toml")
    values = new.observer().model.parameters
    assert values["d"] == pytest.approx(0.5, abs=0.1) and values["b"] == 1.0
    assert new.data["gain"] == old.data["gain"] and new.data["log"] == old.data["log"]
    error = [
        np.sqrt(np.mean((hgo.estimate("axis.csv", one).x_hat[200:, 1] - axis[200:]) ** 2))
        for one in (old, new)
    ]
    assert error[1] < error[0]


def test_compare(axis, capsys):
    words = ("compare", "axis.csv", "--observer", "axis.toml", "--truth", "v=v", "--out", "all.csv")
    assert run(*words) == 0
    told = capsys.readouterr().out
    assert "the truth given" in told and "Savitzky-Golay" in told and "axis " in told
    rows = Path("all.csv").read_text().splitlines()
    assert rows[0] == "method,tuned,v" and rows[1].startswith('"axis","as given",')
    result = hgo.estimate("axis.csv", "axis.toml")
    late = result.time - result.time[0] >= 0.05 * (result.time[-1] - result.time[0])
    error = np.sqrt(np.mean((result.x_hat[late, 1] - axis[late]) ** 2))
    assert float(rows[1].rsplit(",", 1)[1]) == pytest.approx(error, rel=1e-2)
    pytest.importorskip("matplotlib")
    assert run("compare", "axis.csv", "--config", "axis.toml", "--figure", "all.svg") == 0
    assert "the smoothed state" in capsys.readouterr().out and Path("all.svg").exists()


def test_two_observers_of_one_name_are_both_compared(axis, capsys):
    for folder, gain in (("slow", "3.0"), ("fast", "12.0")):
        Path(folder).mkdir()
        Path(folder, "axis.toml").write_text(MODEL.replace("12.0", gain))
    files = ("slow/axis.toml", "fast/axis.toml")
    words = ("compare", "axis.csv", *(w for file in files for w in ("--observer", file)))
    assert run(*words, "--truth", "v=v", "--out", "all.csv") == 0
    rows = dict(row.rsplit(",", 1) for row in Path("all.csv").read_text().splitlines())
    own = [float(rows[f'"{file}","as given"']) for file in files]
    for file, error in zip(files, own, strict=True):
        alone = ("compare", "axis.csv", "--observer", file, "--truth", "v=v", "--out", "one.csv")
        assert run(*alone) == 0
        assert float(Path("one.csv").read_text().splitlines()[1].rsplit(",", 1)[1]) == error
    assert own[0] != own[1]
    capsys.readouterr()
    assert run("compare", "axis.csv", "--observer", "axis.toml", "--observer", "axis.toml") == 2
    assert "--observer = 'axis.toml': must be given once" in capsys.readouterr().err


def test_a_truth_beside_an_output_that_is_converted(axis, capsys):
    """The output in mm and turned round; the truth as it stands."""
    data = np.genfromtxt("axis.csv", delimiter=",", skip_header=1)
    data[:, 1] = 5.0 - 1e3 * data[:, 1]
    np.savetxt("mm.csv", data, delimiter=",", header="t,q,u,v", comments="")
    log = "scale = { q = -1e-3 }, offset = { q = 5e-3 }"
    Path("mm.toml").write_text(MODEL.replace('input = "u"', f'input = "u", {log}'))
    errors = []
    for name in ("axis", "mm"):
        words = ("compare", f"{name}.csv", "--observer", f"{name}.toml", "--truth", "v=v")
        assert run(*words, "--out", f"{name}.table.csv") == 0
        rows = Path(f"{name}.table.csv").read_text().splitlines()
        errors.append(float(rows[1].rsplit(",", 1)[1]))
    assert errors[1] == pytest.approx(errors[0], rel=1e-6)


TURNING = """\
format = 1
observer = "standard"
gain = 12.0
wrap = 360.0
log = { time = "t", output = "deg" }
[model]
states = ["q", "v"]
phi = "-0.2*v"
"""


def test_the_wrap_of_a_file_is_kept(tmp_path, monkeypatch, capsys):
    """An axis that turns some ten times, in degrees: as the same one whose angle goes on."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    t = np.arange(2000) * 4e-3
    v = 600.0 * np.exp(-0.2 * t) + np.cumsum(rng.standard_normal(2000))
    q = np.cumsum(v) * 4e-3
    y = q + 0.5 * rng.standard_normal(2000)
    table = np.c_[t, np.mod(y, 360.0), y, v]
    np.savetxt("axis.csv", table, delimiter=",", header="t,deg,whole,v", comments="")
    Path("axis.toml").write_text(TURNING)
    plain = TURNING.replace("wrap = 360.0\n", "").replace('"deg"', '"whole"')
    Path("plain.toml").write_text(plain)

    def last(*words):
        assert run(*words, "--out", "out.csv") == 0
        return Path("out.csv").read_text().splitlines()

    def table_of(name):
        rows = last("smooth", "axis.csv", "--config", name)
        return np.array([[float(cell or "nan") for cell in row.split(",")] for row in rows[1:]])

    wrapped, whole = table_of("axis.toml"), table_of("plain.toml")
    assert "unwrapped, with the turn of 360" in capsys.readouterr().out
    np.testing.assert_allclose(wrapped[:, 3:], whole[:, 3:], rtol=1e-6, atol=1e-9)
    errors = {}
    for name in ("axis", "plain"):
        words = ("--observer", f"{name}.toml", "--truth", "v=v", "--truth", "q=whole")
        rows = last("compare", "axis.csv", *words)
        errors[name] = [[float(cell) for cell in row.rsplit(",", 2)[1:]] for row in rows[1:]]
    np.testing.assert_allclose(errors["axis"], errors["plain"], rtol=1e-6)
    assert run("tune", "axis.csv", "--config", "axis.toml", "--out", "new.toml") == 0
    new = hgo.load("new.toml")
    assert new.observer().wrap == (360.0,) and new.data["log"] == {"time": "t", "output": "deg"}
    estimated = hgo.estimate("axis.csv", "new.toml")
    assert np.sqrt(np.mean((estimated.x_hat[300:, 1] - v[300:]) ** 2)) < 8.0


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("smooth", "axis.csv"), "--output is needed"),
        (("smooth", "axis.csv", "--config", "axis.toml", "--out", "axis.csv"), "is the log itself"),
        (("fit", "axis.csv", "--time", "t", "--output", "q"), "--config is needed"),
        (("fit", "axis.csv", "--config", "axis.toml", "--parameter", "J"), "parameters = 'J'"),
        (("compare", "axis.csv", "--config", "axis.toml", "--truth", "v"), "must be STATE=COL"),
        (("compare", "axis.csv", "--config", "axis.toml", "--truth", "w=v"), "truth = 'w'"),
    ],
)
def test_refusals(axis, capsys, words, told):
    assert run(*words) == 2
    assert told in capsys.readouterr().err
