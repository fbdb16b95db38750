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
