"""`hgo new`, `hgo completion`, and what a verb says of what it was not given."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.shell_completion import ShellComplete

import hgo_rs as hgo
from hgo_rs.cli import main, new
from hgo_rs.cli.command import command
from hgo_rs.cli.complete import SHELLS
from hgo_rs.config import OBSERVERS


@pytest.fixture
def axis(tmp_path, monkeypatch):
    """A driven mass: its angle, also within one turn, its input, and its velocity."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    t = np.arange(1000) * 4e-3
    u = np.sign(np.sin(4.0 * t))
    v = 3.0 + np.cumsum(u) * 4e-3 + 0.1 * np.sin(9.0 * t)
    q = np.cumsum(v) * 4e-3 + 1e-3 * rng.standard_normal(1000)
    table = np.c_[t, q, np.mod(q, 2.0 * np.pi), u, v]
    header = "t,q [rad],turned,u,rate"
    np.savetxt("axis.csv", table, delimiter=",", header=header, comments="", fmt="%.9g")
    return t, v


@pytest.fixture
def untuned(monkeypatch):
    """Gains by the rule of thumb, where they are not the point: looking for them takes longer."""

    def refused(*_):
        raise hgo.HgoError("not looked for")

    monkeypatch.setattr(new, "tune", refused)


def run(*words):
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    return int(end.value.code or 0)


def test_a_log_alone_gives_a_file_that_estimates(axis, capsys):
    t, v = axis
    assert run("new", "axis.csv") == 0
    told = capsys.readouterr().out
    assert "1000 samples" in told and "next: hgo estimate axis.csv --config axis.toml" in told
    found = hgo.load("axis.toml")
    assert found.data["log"] == {"time": "t", "output": "q [rad]"}
    late = t > 1.0
    error = hgo.estimate("axis.csv", found).x_hat[late, 1] - v[late]
    assert np.sqrt(np.mean(error**2)) < 0.1 * np.std(np.diff(v)) / 4e-3  # of a unit gain's lag
    assert run("new", "axis.csv") == 2
    assert "axis.toml exists already" in capsys.readouterr().err


def uncommented(text):
    """Files that follow a hint each: a key alone, or a table with the keys below it."""
    lines = text.split("\n")
    hint = re.compile(r"# (\w+ = [^.]|\[\w+\])(?!\.\.)")
    k = 0
    while k < len(lines):
        if not hint.match(lines[k]) or '"..."' in lines[k]:
            k += 1
            continue
        end = k + 1
        if lines[k].startswith("# ["):
            while end < len(lines) and lines[end].startswith("# "):
                end += 1
        yield "\n".join([*lines[:k], *(line[2:] for line in lines[k:end]), *lines[end:]])
        k = end


def test_every_hint_is_good_as_it_stands(axis, untuned):
    assert run("new", "axis.csv", "--output", "turned", "--order", "2") == 0
    text = Path("axis.toml").read_text()
    assert hgo.load("axis.toml").observer().wrap == (2.0 * np.pi,)
    files = list(uncommented(text))
    assert len(files) == 7  # poles, method, timing, model, start, unit, scale
    for file in files:
        config = hgo.Config.from_toml(file)
        config.observer()
        assert config != hgo.load("axis.toml")


def test_inputs_and_several_outputs(axis, capsys, untuned):
    words = ("new", "axis.csv", "--time", "t", "--input", "u")
    assert run(*words, "--output", "q [rad]", "--out", "one.toml") == 0
    one = hgo.load("one.toml")
    assert one.observer().model.states == ("q", "dq") and one.observer().n_u == 1
    assert hgo.estimate("axis.csv", one).x_hat.shape == (1000, 2)
    assert run(*words, "--output", "q [rad]", "--output", "turned", "--out", "two.toml") == 0
    both = hgo.load("two.toml").observer()
    assert both.wrap == (None, 2.0 * np.pi) and (both.n_y, both.n_u) == (2, 1)
    assert set(both.model.parameters) == {"b1_u", "b2_u"}
    assert run("estimate", "axis.csv", "--config", "two.toml") == 0


def test_any_column_may_be_the_output(tmp_path, monkeypatch, untuned):
    """Names that are no names for equations, or have a meaning there."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(200) * 1e-2
    for k, name in enumerate(("sin", "1/x é", '"#\\', "t", "Δ", "a.b[deg]")):
        np.savez(f"{k}.npz", **{"time": t, name: np.sin(3.0 * t) + 1e-3 * np.cos(1e3 * t)})
        assert run("new", f"{k}.npz", "--time", "time", "--output", name) == 0
        found = hgo.load(f"{k}.toml")
        assert found.data["log"]["output"] == name
        for file in uncommented(Path(f"{k}.toml").read_text()):
            hgo.Config.from_toml(file).observer()


def test_a_log_of_which_too_little_is_known(axis, capsys):
    data = np.genfromtxt("axis.csv", delimiter=",", skip_header=1)
    np.savez("bare.npz", q=data[:, 1], p=data[:, 3])
    assert run("new", "bare.npz") == 2
    assert "name it with --time, or give --dt" in capsys.readouterr().err
    assert run("new", "bare.npz", "--dt", "4e-3", "--output", "p", "--order", "1") == 0
    assert hgo.load("bare.toml").data["log"] == {"dt": 4e-3, "output": "p"}
    np.savez("short.npz", q=[0.0, 0.1, 0.3])
    assert run("new", "short.npz", "--dt", "0.1") == 0
    text = Path("short.toml").read_text()
    assert "gain = 2.0" in text and "since tuning found none" in text
    np.savez("still.npz", q=np.ones(9))
    assert run("new", "still.npz") == 2
    assert "no column of numbers changes" in capsys.readouterr().err


# --- completion --------------------------------------------------------------------------------


def offered(*words):
    """What the last word may become."""
    complete = ShellComplete(command, {}, "hgo", "_HGO_COMPLETE")
    return {item.value for item in complete.get_completions(list(words[:-1]), words[-1])}


def test_choices_complete(axis):
    assert {"estimate", "export"} <= offered("e") and "tune" not in offered("e")
    assert offered("estimate", "axis.csv", "--observer", "") == set(OBSERVERS)
    assert offered("estimate", "axis.csv", "--start", "f") == {"first-sample"}
    assert "zoh" in offered("estimate", "axis.csv", "--method", "")
    assert "lee-fig6" in offered("run", "lee-")
    assert offered("completion", "") == set(SHELLS)
    for verb in ("estimate", "tune", "smooth", "fit", "compare", "new"):
        for option in ("--time", "--output", "--input"):
            assert offered(verb, "axis.csv", option, "t") == {"t", "turned"}
    assert offered("tune", "absent.csv", "--output", "") == set()


def test_every_shell_has_its_script(capsys):
    for shell in SHELLS:
        assert run("completion", shell) == 0
        script = capsys.readouterr().out
        assert "_HGO_COMPLETE" in script and f"{shell}_complete" in script
    assert run("completion", "csh") == 2


def test_bash_is_told_by_the_command_itself(axis):
    words = {"COMP_WORDS": "hgo tune axis.csv --output tu", "COMP_CWORD": "4"}
    done = subprocess.run(
        [sys.executable, "-m", "hgo_rs.cli"],
        env={**os.environ, **words, "_HGO_COMPLETE": "bash_complete"},
        capture_output=True,
        text=True,
    )
    assert done.stdout.split() == ["plain,turned"]


# --- what was left out -------------------------------------------------------------------------


def test_a_verb_without_its_argument_says_what_to_give(capsys):
    for verb in ("look", "new", "tune", "estimate", "smooth", "fit", "compare"):
        assert run(verb) == 2
        told = capsys.readouterr().err
        assert told.startswith(f"hgo: hgo {verb} needs LOG: a recorded log, such as axis.csv")
        assert f"for example hgo {verb} " in told
    for verb, name in (("export", "CONFIG"), ("run", "ID"), ("completion", "SHELL")):
        assert run(verb) == 2
        assert f"hgo {verb} needs {name}: " in capsys.readouterr().err


def test_a_forgotten_output_says_what_the_log_has(axis, capsys):
    Path("bare.toml").write_text('format = 1\nobserver = "standard"\norder = 2\ngain = 9.0\n')
    for words in (("tune",), ("estimate", "--config", "bare.toml"), ("smooth",)):
        verb, *options = words
        assert run(verb, "axis.csv", *options) == 2
        told = capsys.readouterr().err
        assert "--output is needed" in told and "axis.csv has t, q [rad], turned, u, rate" in told
        assert "for example --time t --output 'q [rad]'" in told
        assert ("or a table [log] in bare.toml" in told) == bool(options)
    assert run("tune", "absent.csv") == 2
    assert "no file absent.csv; nearest: axis.csv" in capsys.readouterr().err
