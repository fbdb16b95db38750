"""`hgo tune`: what it says, what it writes, what it refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs.cli import main

MODEL = """\
format = 1
observer = "standard"
log = { time = "t", output = "q", input = "u" }
[model]
states = ["q", "v"]
inputs = ["u"]
phi = "u - 0.5*v"
"""


@pytest.fixture
def axis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Any]:
    """A log of a driven mass, and its velocity, which the log has not."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(3000) * 2e-3
    u = np.sign(np.sin(4.0 * t))
    v = np.zeros(3000)
    for k in range(2999):
        v[k + 1] = v[k] + 2e-3 * (u[k] - 0.5 * v[k] + 0.3 * np.sin(9.0 * t[k]))
    q = np.cumsum(v) * 2e-3
    rng = np.random.default_rng(0)
    y = q + 1e-3 * rng.standard_normal(3000)
    p = np.cos(2.0 * t) + 1e-3 * rng.standard_normal(3000)
    path = tmp_path / "axis.csv"
    np.savetxt(path, np.c_[t, y, u, p], delimiter=",", header="t,q,u,p", comments="")
    return path, v


def run(*words: object) -> int:
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    return int(end.value.code or 0)


def test_a_log_alone(axis: tuple[Path, Any], capsys: pytest.CaptureFixture[str]) -> None:
    path, _ = axis
    assert run("tune", path, "--time", "t", "--output", "q", "--table", "all.csv") == 0
    told = capsys.readouterr().out
    for text in ("3000 samples", "gain", "<- wanted", "no model", "axis.observer.toml, all.csv"):
        assert text in told, text
    chosen = hgo.load("axis.observer.toml")
    assert chosen.data["log"] == {"time": "t", "output": "q"}
    again = hgo.tune(None, tuple(np.loadtxt(path, delimiter=",", skiprows=1)[:, :2].T))
    assert chosen.data["gain"] == pytest.approx(again.ell, rel=1e-6)
    rows = Path("all.csv").read_text().splitlines()
    assert rows[0].startswith("structure,ell,") and len(rows) > 50
    pytest.importorskip("matplotlib")
    assert Path("axis.observer.png").stat().st_size > 10_000


def test_a_model_is_taken_from_a_file_without_a_gain(
    axis: tuple[Path, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    path, v = axis
    Path("model.toml").write_text(MODEL)
    assert run("tune", path, "--config", "model.toml", "--out", "axis.toml") == 0
    assert "model" in capsys.readouterr().out
    result = hgo.estimate(path, "axis.toml")
    late = slice(300, None)
    error = np.sqrt(np.mean((result.x_hat[:, 1] - v)[late] ** 2))
    bare = hgo.tune(None, (2e-3, np.loadtxt(path, delimiter=",", skiprows=1)[:, 1]))
    assert error < bare.errors[1]
    assert run("tune", path, "--config", "model.toml", "--state", "1", "--skip", "1") == 0


def test_what_is_missing_or_in_the_way_is_told(
    axis: tuple[Path, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    path, _ = axis
    assert run("tune", path) == 2
    assert "--output is needed" in capsys.readouterr().err
    assert run("tune", path, "--time", "t", "--output", "q", "--out", path) == 2
    assert "is the log itself" in capsys.readouterr().err
    assert run("tune", path, "--time", "t", "--output", "q", "--state", "13") == 2
    assert "state = 13" in capsys.readouterr().err
    assert not Path("axis.observer.toml").exists()
