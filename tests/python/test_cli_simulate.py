"""`hgo simulate` and `hgo plot`: numbers against the functions, pictures, refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs import plots
from hgo_rs.cli import main

PENDULUM = """\
format = 1
observer = "standard"
gain = 20.0
[model]
states = ["q", "w"]
inputs = ["u"]
phi = "12.5*u - w - 24.5*sin(q)"
"""


@pytest.fixture
def pendulum(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("axis.toml").write_text(PENDULUM)


@pytest.fixture
def drawn(monkeypatch):
    """Figures in place of files: drawing them is left out."""
    figures = []
    monkeypatch.setattr(plots, "save", lambda figure, *_: figures.append(figure))
    return figures


def run(*words):
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    return int(end.value.code or 0)


def table(name):
    return np.genfromtxt(name, delimiter=",", names=True)


SIMULATE = ("simulate", "axis.toml", "--x0", "0.5,0", "--dt", "0.01", "--t-end", "4")


def test_what_is_simulated_is_the_equation(pendulum, drawn, capsys):
    """Against another solver; and the observer's estimates against its run over the samples."""
    from scipy.integrate import solve_ivp

    assert run(*SIMULATE, "--input", "u=0.3*cos(t)", "--noise", "1e-3", "--seed", "3") == 0
    told = capsys.readouterr().out
    assert "401 samples" in told and "gain 20 1/s, method zoh, motion rk4; timing current" in told
    found = table("axis.simulated.csv")
    assert found.dtype.names == ("t", "y", "u", "q", "w", "q_hat", "w_hat")

    def held(t, x):  # the input of a period is that of its beginning
        u = 0.3 * np.cos(0.01 * np.floor(t / 0.01 + 1e-9))
        return [x[1], 12.5 * u - x[1] - 24.5 * np.sin(x[0])]

    solved = solve_ivp(held, (0.0, 4.0), [0.5, 0.0], t_eval=found["t"], max_step=2e-3, rtol=1e-9)
    np.testing.assert_allclose(found["q"], solved.y[0], atol=2e-4)
    assert np.std(found["y"] - found["q"]) == pytest.approx(1e-3, rel=0.15)
    result = hgo.load("axis.toml").observer().run(found["t"], found["y"], found["u"])
    np.testing.assert_allclose(found["w_hat"], result.x_hat[:, 1], atol=1e-9)
    late = found["t"] >= 2.0
    error = np.sqrt(np.mean((found["w_hat"] - found["w"])[late] ** 2))
    line = next(line for line in told.splitlines() if line.startswith("w "))
    assert float(line.split("half ")[1].split(";")[0]) == pytest.approx(error, rel=1e-2)
    assert len(drawn) == 1 and len(drawn[0].axes) == 2


def test_the_loop_may_be_closed_by_estimates(pendulum, drawn):
    assert run(*SIMULATE, "--input", "u=1.96*sin(q_hat) - 0.5*q_hat - w_hat", "--out", "c.csv") == 0
    found = table("c.csv")
    assert abs(found["q"][-1]) < 0.05 < abs(found["q"][0])


def test_a_log_is_drawn(pendulum, drawn, capsys):
    assert run(*SIMULATE, "--input", "u=0", "--out", "axis.csv") == 0
    assert run("plot", "axis.csv") == 0
    assert [ax.get_title(loc="left") for ax in drawn[-1].axes] == ["y", "q", "w", "q_hat", "w_hat"]
    named = ("--time", "t", "--output", "y", "--input", "u", "--from", "1", "--to", "2")
    assert run("plot", "axis.csv", *named) == 0
    assert [ax.get_title(loc="left") for ax in drawn[-1].axes] == ["y", "u"]
    line = drawn[-1].axes[0].lines[0]
    np.testing.assert_array_equal(line.get_ydata(), table("axis.csv")["y"][100:201])
    assert run("plot", "axis.csv", "--config", "axis.toml", *named) == 0
    assert "run by standard, order 2" in capsys.readouterr().out
    result = hgo.estimate("axis.csv", hgo.load("axis.toml").replace(dict(zip(*LOG, strict=True))))
    shown = drawn[-1].axes[1].lines[0].get_ydata()
    np.testing.assert_array_equal(shown, result.x_hat[100:201, 1])


LOG = (("time", "output", "input"), ("t", "y", "u"))


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (SIMULATE, '--input is needed for u; write for example --input "u=0"'),
        ((*SIMULATE, "--input", "u"), "--input u: must be NAME=EXPR"),
        ((*SIMULATE, "--input", "u=nonsense"), "nonsense"),
        (("simulate", "axis.toml", "--x0", "0,0", "--t-end", "1"), "--dt is needed"),
        ((*SIMULATE, "--out", "axis.toml"), "unknown format"),
        (("simulate", "bare.toml", *SIMULATE[2:]), "nothing to simulate without equations"),
        (("plot", "axis.csv", "--from", "9"), "must be a span within 0 to 0.3"),
        (("plot", "axis.csv", "--figure", "a.bmp"), "unknown format '.bmp'"),
        (("plot", "still.csv"), "no column of numbers moves"),
    ],
)
def test_refusals(pendulum, capsys, words, told):
    Path("bare.toml").write_text('format = 1\nobserver = "standard"\norder = 2\ngain = 9.0\n')
    Path("axis.csv").write_text("t,q\n0.0,0.1\n0.1,0.2\n0.2,0.4\n0.3,0.1\n")
    Path("still.csv").write_text("t,q\n0.0,1\n0.1,1\n0.2,1\n")
    assert run(*words) == 2
    assert told in capsys.readouterr().err
    assert not list(Path().glob("*.simulated.csv")) and not list(Path().glob("*.png"))
