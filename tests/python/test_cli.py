"""The `hgo` command: statuses, one-line errors, what is written, Ctrl-C."""

import base64
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import hgo_rs
from hgo_rs import cli, config, plots, scenarios
from hgo_rs.cli import reproduce
from hgo_rs.cli.estimate import _Trace
from hgo_rs.config import OBSERVERS
from hgo_rs.design.discrete import METHODS
from hgo_rs.errors import MissingExtraError
from hgo_rs.logs import Log, TableWriter, read_log, write_table
from hgo_rs.scenarios.base import Context, Outcome, Row, Scenario, row

HGO = [sys.executable, "-m", "hgo_rs.cli"]


def hgo(capsys, *args):
    """(status, standard output, standard error) of a command run in this process."""
    with pytest.raises(SystemExit) as stop:
        cli.main([str(a) for a in args])
    out, err = capsys.readouterr()
    return stop.value.code, out, err


def one_line(err):
    assert err.startswith("hgo: ")
    assert err.count("\n") == 1
    assert "Traceback" not in err
    return err


def good(ctx: Context) -> Outcome:
    def draw(fig):
        ax = fig.subplots()
        ax.plot([0.0, 1.0], [0.0, float(ctx.seed)])

    rows = [
        row("rms e2", 6.0116, expected=6.011561, rel=1e-4, paper=5.77, note="small-step limit"),
        row("seed", ctx.seed, at_most=5),
    ]
    return Outcome(rows, draw)


def missing(ctx: Context) -> Outcome:
    return Outcome([row("peak <x>", 2.0, at_most=1.0), row("diverges", float("inf"), at_least=1.0)])


def failing(ctx: Context) -> Outcome:
    raise RuntimeError("no such luck & no rows")


def interrupted(ctx: Context) -> Outcome:
    raise KeyboardInterrupt


FAKES = {
    "lee-good": Scenario("lee-good", "A table", "lee", good),
    "lee-missing": Scenario("lee-missing", "Another", "lee", missing),
    "fu-failing": Scenario("fu-failing", "A third", "fu", failing),
}


@pytest.fixture
def fakes(monkeypatch):
    """Install scenarios in place of the papers'."""

    def install(known):
        monkeypatch.setattr(scenarios, "load", lambda: known)

    install(FAKES)
    return install


# --- list and run ----------------------------------------------------------------------------


def test_list(capsys, fakes):
    status, out, _ = hgo(capsys, "list")
    assert status == 0
    assert [line.split()[0] for line in out.splitlines()] == list(FAKES)
    status, out, _ = hgo(capsys, "list", "--json")
    assert json.loads(out)[0] == {"id": "lee-good", "title": "A table", "paper": "lee"}


@pytest.mark.parametrize("what", ["observers", "gains", "shapes", "models", "methods", "keys"])
def test_list_of_choices(capsys, what):
    """Every name that a file may hold, each with a description."""
    known = {
        "observers": OBSERVERS,
        "gains": config.GAINS,
        "shapes": config.SHAPES,
        "models": config.MODELS,
        "methods": METHODS,
        "keys": config.TOP,
    }[what]
    items = json.loads(hgo(capsys, "list", what, "--json")[1])
    assert {item["name"] for item in items} == set(known) and all(item["told"] for item in items)
    lines = hgo(capsys, "list", what)[1].splitlines()
    assert [line.split()[0] for line in lines] == list(known)


def test_run_json_is_one_object_and_nothing_else(capsys, fakes):
    status, out, err = hgo(capsys, "run", "lee-good", "--json", "--backend", "numpy", "--seed", 4)
    assert (status, err) == (0, "")
    result = json.loads(out)
    assert list(result) == ["id", "backend", "rows", "elapsed_s"]
    assert (result["id"], result["backend"]) == ("lee-good", "numpy")
    assert result["elapsed_s"] >= 0.0
    assert result["rows"][0] == {
        "quantity": "rms e2",
        "paper": 5.77,
        "ours": 6.0116,
        "expected": 6.011561,
        "tolerance": "rel 0.0001",
        "ok": True,
        "note": "small-step limit",
    }
    assert result["rows"][1]["ours"] == 4


def test_run_status_tells_a_miss(capsys, fakes):
    status, out, _ = hgo(capsys, "run", "lee-missing")
    assert status == 1
    assert "MISS peak <x>  ours 2  (≤ 1)" in out
    assert "2 rows, 1 missed" in out
    status, out, _ = hgo(capsys, "run", "lee-missing", "--json")
    assert status == 1
    # JSON has no infinity.
    assert json.loads(out)["rows"][1]["ours"] == "inf"


def test_run_writes_rows_and_figure(capsys, fakes, tmp_path):
    status, _, _ = hgo(capsys, "run", "lee-good", "--out", tmp_path / "new" / "folder")
    assert status == 0
    folder = tmp_path / "new" / "folder"
    assert sorted(p.name for p in folder.iterdir()) == [
        "lee-good.json",
        "lee-good.png",
        "lee-good.svg",
    ]
    assert (folder / "lee-good.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in (folder / "lee-good.svg").read_bytes()
    saved = json.loads((folder / "lee-good.json").read_text())
    assert saved["ok"] is True
    assert saved["figures"] == ["lee-good.png", "lee-good.svg"]


def test_a_failing_scenario_is_a_failure(capsys, fakes):
    status, out, err = hgo(capsys, "run", "fu-failing", "--json")
    assert status == 1
    assert "no such luck" in err
    assert json.loads(out)["rows"] == []


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["run", "lee-god"], "unknown scenario 'lee-god'; nearest: lee-good"),
        (["runn", "lee-good"], "unknown command 'runn'; nearest: run"),
        (["run"], "hgo run needs ID: a scenario"),
        (["run", "lee-good", "--backend", "fortran"], "'fortran' is not one of 'rust', 'numpy'"),
        (["run", "lee-good", "--seed", "-1"], "-1 is not in the range"),
        (["reproduce", "--jobs", "0"], "0 is not in the range"),
        (["run", "lee-good", "--nonsense"], "No such option"),
    ],
)
def test_bad_usage_is_one_line_and_status_2(capsys, fakes, args, message):
    status, out, err = hgo(capsys, *args)
    assert (status, out) == (2, "")
    assert message in one_line(err)


def test_a_folder_that_cannot_be_written_is_refused_before_any_work(capsys, fakes, tmp_path):
    def work(ctx):
        raise AssertionError("the scenario ran")

    fakes({"lee-good": Scenario("lee-good", "", "lee", work)})
    occupied = tmp_path / "file"
    occupied.write_text("")
    for args in (["reproduce"], ["run", "lee-good"]):
        status, out, err = hgo(capsys, *args, "--out", occupied / "out")
        assert (status, out) == (2, "")
        assert f"cannot write to the folder {occupied / 'out'}" in one_line(err)
        assert "choose another one with --out" in err


def test_figures_without_matplotlib_are_refused_before_any_work(
    capsys, fakes, tmp_path, monkeypatch
):
    def absent():
        raise MissingExtraError("figures need matplotlib: pip install 'hgo_rs[plot]'")

    monkeypatch.setattr(plots, "require_matplotlib", absent)
    status, _, err = hgo(capsys, "reproduce", "--out", tmp_path / "out")
    assert status == 2
    assert "pip install 'hgo_rs[plot]'" in one_line(err)
    assert not (tmp_path / "out").exists()
    # Without --out there is no figure to draw.
    assert hgo(capsys, "run", "lee-good")[0] == 0
    # Rows, tables and the report need none.
    status, out, _ = hgo(capsys, "reproduce", "--no-figures", "--out", tmp_path / "out")
    assert (status, "3 scenarios, 4 rows" in out) == (1, True)
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {"report.html", "results.json", "results.md"}


# --- reproduce -------------------------------------------------------------------------------


class _Page(HTMLParser):
    """Every tag with its attributes, the text, and a check that tags close in order."""

    VOID = frozenset({"meta", "img", "br", "link"})

    def __init__(self, text):
        super().__init__()
        self.tags, self.words, self.open = [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def test_reproduce_writes_results_figures_and_report(capsys, fakes, tmp_path):
    out_dir = tmp_path / "out"
    status, out, _ = hgo(capsys, "reproduce", "--out", out_dir)
    assert status == 1
    assert re.search(r"^\[1/3\] ok    lee-good .* 2 rows", out, re.M)
    assert re.search(r"^\[2/3\] MISS  lee-missing .* 1 of 2 rows missed", out, re.M)
    assert "MISS lee-missing: peak <x>" in out
    assert "3 scenarios, 4 rows: 1 row missed, failed: fu-failing" in out
    assert sorted(p.name for p in out_dir.iterdir()) == [
        "lee-good.png",
        "lee-good.svg",
        "report.html",
        "results.json",
        "results.md",
    ]
    table = (out_dir / "results.md").read_text(encoding="utf-8")
    assert table.startswith("| scenario | quantity | paper | here |\n|---|---|---|---|\n")
    results = json.loads((out_dir / "results.json").read_text())
    assert (results["ok"], results["rows"], results["missed"]) == (False, 4, 1)
    assert results["failed"] == ["fu-failing"]
    assert results["interrupted"] is False
    assert [s["id"] for s in results["scenarios"]] == list(FAKES)
    assert "RuntimeError: no such luck" in results["scenarios"][2]["error"]

    page = _Page((out_dir / "report.html").read_text(encoding="utf-8"))
    text = " ".join(page.words)
    ids = {attrs["id"] for _, attrs in page.tags if "id" in attrs}
    links = {a["href"][1:] for t, a in page.tags if t == "a" and a["href"].startswith("#")}
    assert links <= ids
    assert {"lee", "fu", "lee-good", "lee-missing", "fu-failing", "explained"} <= ids
    assert "1 row of 4 outside tolerance, 1 scenario failed" in text
    assert "peak <x>" in text
    assert "no such luck & no rows" in text
    assert "small-step limit" in text
    # Self-contained: nothing is fetched, and the figure inside is the one beside.
    sources = [a["src"] for _, a in page.tags if "src" in a]
    assert len(sources) == 1
    kind, data = sources[0].split(";base64,")
    assert kind == "data:image/svg+xml"
    assert base64.b64decode(data) == (out_dir / "lee-good.svg").read_bytes()
    assert not [t for t, _ in page.tags if t in ("link", "script")]


def test_reproduce_is_well_when_every_row_is(capsys, fakes, tmp_path):
    fakes({"lee-good": FAKES["lee-good"]})
    status, out, err = hgo(capsys, "reproduce", "--out", tmp_path, "--seed", 3)
    assert (status, err) == (0, "")
    assert "1 scenario, 2 rows, all within tolerance" in out
    assert json.loads((tmp_path / "results.json").read_text())["ok"] is True
    assert "all 2 rows within tolerance" in (tmp_path / "report.html").read_text()


def test_a_scenario_without_rows_is_not_well(capsys, fakes, tmp_path):
    fakes({"lee-empty": Scenario("lee-empty", "", "lee", lambda ctx: Outcome([]))})
    status, out, _ = hgo(capsys, "reproduce", "--out", tmp_path)
    assert status == 1
    assert "without rows: lee-empty" in out


def test_interruption_keeps_what_is_finished(capsys, fakes, tmp_path):
    fakes({**FAKES, "fu-failing": Scenario("fu-failing", "", "fu", interrupted)})
    status, out, err = hgo(capsys, "reproduce", "--out", tmp_path)
    assert status == 130
    assert "interrupted: 2 of 3 scenarios finished" in one_line(err)
    assert "all within tolerance" not in out
    results = json.loads((tmp_path / "results.json").read_text())
    assert (results["interrupted"], results["ok"]) == (True, False)
    assert [s["id"] for s in results["scenarios"]] == ["lee-good", "lee-missing"]
    assert "1 scenario not run (interrupted)" in (tmp_path / "report.html").read_text()


def test_scenarios_of_a_paper_share_their_runs():
    class Backend:
        calls = 0

        def simulate(self, spec):
            Backend.calls += 1
            return {"rms": np.ones(1)}

    ctx = Context(module=Backend())

    def ask(ctx):
        rms = ctx.simulate({"steps": 5, "runs": 2})["rms"][0]
        return Outcome([row("rms", rms, expected=1.0, rel=1e-9)])

    s = Scenario("lee-x", "", "lee", ask)
    records = [reproduce.execute(s, ctx, figures=False) for _ in range(2)]
    assert Backend.calls == 1
    assert [r.steps for r in records] == [10, 0]
    assert all(r.ok for r in records)


def test_a_figure_that_fails_keeps_the_rows(fakes):
    def broken(fig):
        raise ZeroDivisionError("no data")

    s = Scenario("lee-x", "", "lee", lambda ctx: Outcome([row("a", 1.0, at_most=2.0)], broken))
    record = reproduce.execute(s, Context(), figures=True)
    assert record.rows == (Row("a", None, 1.0, None, "≤ 2", True, ""),)
    assert "ZeroDivisionError" in record.error
    assert not record.ok


def test_processes_give_the_same_rows():
    chosen = [scenarios.find("katayama-fig1"), scenarios.find("astolfi-limits")]
    alone = list(reproduce.run(chosen, figures=False))
    shared = list(reproduce.run(chosen, jobs=2, figures=False))
    assert {r.id: r.rows for r in alone} == {r.id: r.rows for r in shared}
    assert all(r.ok for r in alone)


@pytest.mark.slow
def test_ctrl_c_in_a_real_run(tmp_path):
    process = subprocess.Popen(
        [*HGO, "reproduce", "--out", tmp_path],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    first = process.stdout.readline()
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert re.match(r"\[ *1/", first), first + err
    assert process.returncode == 130, out + err
    assert "Traceback" not in err
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["interrupted"] is True
    assert 1 <= len(results["scenarios"]) < results["planned"]
    assert (tmp_path / "report.html").exists()


# --- estimate --------------------------------------------------------------------------------


@pytest.fixture
def axis(tmp_path, monkeypatch):
    """A log of q = sin t with a gap, in the folder where the command runs."""
    monkeypatch.chdir(tmp_path)
    t = np.arange(2001) * 5e-3
    cells = [repr(float(v)) for v in np.sin(t)]
    cells[1000:1004] = [""] * 4
    lines = [f"{float(a)!r},{b},0" for a, b in zip(t, cells, strict=True)]
    path = tmp_path / "axis.csv"
    path.write_text("t,q,u\n" + "\n".join(lines) + "\n")
    return path


@pytest.fixture
def undrawn(monkeypatch):
    """Figures take longer than the rest: leave them out where they are not the point."""
    monkeypatch.setattr(_Trace, "draw", lambda *_: None)
    monkeypatch.setattr(plots, "save", lambda *_: None)


ESTIMATE = ["--time", "t", "--output", "q", "--order", 3, "--gain", 20]


@pytest.mark.parametrize("observer", ["standard", "low-power"])
def test_estimate_gives_the_derivatives(capsys, axis, observer):
    status, out, err = hgo(capsys, "estimate", axis, *ESTIMATE, "--observer", observer)
    assert (status, err) == (0, "")
    assert "2001 samples from 0 s to 10 s" in out
    assert "4 missing samples; the longest gap has 4, from t = 5 s to 5.015 s" in out
    assert "written: axis.estimates.csv, axis.estimates.png" in out
    assert Path("axis.estimates.png").read_bytes().startswith(b"\x89PNG")
    header = Path("axis.estimates.csv").read_text().splitlines()[0]
    assert header == "t,y,x_hat1,x_hat2,x_hat3,innovation,missing"

    log = read_log("axis.csv", "t", "q")
    law = getattr(hgo_rs, OBSERVERS[observer])(3, gain=20.0)
    expected = law.run(log.t, log.y)
    velocity = read_log("axis.estimates.csv", "t", "x_hat2").y
    np.testing.assert_array_equal(velocity, np.asarray(expected.x_hat)[:, 1])
    settled = log.t > 2.0
    assert np.abs(velocity - np.cos(log.t))[settled].max() < 0.2
    written = read_log("axis.estimates.csv", "t", "y", "missing")
    np.testing.assert_array_equal(written.missing, written.u == 1)


def test_estimate_to_parquet_and_svg(capsys, axis, tmp_path):
    pytest.importorskip("pyarrow")
    out, figure = tmp_path / "e.parquet", tmp_path / "e.svg"
    args = [*ESTIMATE, "--observer", "standard", "--out", out, "--figure", figure]
    assert hgo(capsys, "estimate", axis, *args)[0] == 0
    assert read_log(out, "t", "x_hat3").y.shape == (2001,)
    assert b"<svg" in figure.read_bytes()


def test_estimate_with_a_sampling_period_and_poles(capsys, axis):
    args = ["--output", "q", "--order", 2, "--gain", 20, "--observer", "standard"]
    poles = ["--poles", "-1+1j,-1-1j"]
    assert hgo(capsys, "estimate", axis, *args, "--dt", 5e-3, *poles)[0] == 0
    log = read_log(axis, None, "q", dt=5e-3)
    law = hgo_rs.StandardObserver(2, gain=20.0, poles=[-1 + 1j, -1 - 1j])
    velocity = read_log("axis.estimates.csv", "t", "x_hat2").y
    np.testing.assert_array_equal(velocity, np.asarray(law.run(log.t, log.y).x_hat)[:, 1])


def test_estimate_without_matplotlib_leaves_the_default_figure_out(capsys, axis, monkeypatch):
    def absent():
        raise MissingExtraError("figures need matplotlib: pip install 'hgo_rs[plot]'")

    monkeypatch.setattr(plots, "require_matplotlib", absent)
    args = [*ESTIMATE, "--observer", "standard"]
    status, _, err = hgo(capsys, "estimate", axis, *args)
    assert status == 0
    assert "no figure: pip install 'hgo_rs[plot]'" in err
    assert Path("axis.estimates.csv").exists()
    assert not Path("axis.estimates.png").exists()
    status, _, err = hgo(capsys, "estimate", axis, *args, "--figure", "e.png")
    assert status == 2
    assert "pip install 'hgo_rs[plot]'" in one_line(err)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"--observer": "lowpower"}, "unknown observer 'lowpower'; nearest: low-power"),
        ({"--output": "Q_m"}, "has no column 'Q_m'; nearest: q"),
        ({"--gain": -3}, "gain"),
        ({"--gain": "big"}, "'big' is not a valid float"),
        ({"--order": 0}, "= 0"),
        ({"--poles": "-1,x"}, "'x' is not a number"),
        ({"--poles": "1,-1,-2"}, "poles"),
        ({"--saturation": "1,2"}, "--saturation has no meaning for --observer standard"),
        ({"--out": "e.xlsx"}, "unknown format '.xlsx'"),
        ({"--out": "axis.csv"}, "is the log itself"),
        ({"--out": "absent/e.csv"}, "cannot write absent/e.csv"),
        ({"--figure": "e.bmp"}, "unknown format '.bmp'"),
        ({"--dt": 1.0}, "leave dt out"),
    ],
)
def test_estimate_refuses_in_one_line(capsys, axis, change, message):
    options = {
        "--time": "t",
        "--output": "q",
        "--order": 3,
        "--gain": 20,
        "--observer": "standard",
        **change,
    }
    args = [item for pair in options.items() for item in pair]
    status, _, err = hgo(capsys, "estimate", axis, *args)
    assert status == 2
    assert message in one_line(err)
    assert [p.name for p in Path().iterdir()] == ["axis.csv"]


def test_estimate_of_an_absent_or_broken_log(capsys, axis):
    args = [*ESTIMATE, "--observer", "standard"]
    status, _, err = hgo(capsys, "estimate", "axes.csv", *args)
    assert status == 2
    assert "no file axes.csv; nearest: axis.csv" in one_line(err)
    with axis.open("a") as file:
        file.write("10.005,0.1")
    status, _, err = hgo(capsys, "estimate", axis, *args)
    assert status == 2
    assert "line 2003: 2 cells where 3 cells are expected" in one_line(err)


# --- what is written, and where ---


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--out", "e.csv", "--save-config", "e.csv"], "e.csv is the file of --out too; choose"),
        (["--figure", "e.png", "--save-config", "./e.png"], "e.png is the file of --figure too"),
        (["--save-config", "axis.csv"], "axis.csv is the log itself; choose another file with --s"),
        (["--out", "linked.csv"], "linked.csv is the log itself"),
        (["--out", "hard.csv"], "hard.csv is the log itself"),
        (["--config", "o.toml", "--save-config", "o.toml"], "o.toml is the file of --config"),
        (["--config", "o.toml", "--save-config", "axis.estimates.png"], "is the file of --figure"),
        (["--out", "pipe.csv"], "cannot write pipe.csv: it is a pipe or a device"),
    ],
)
def test_no_file_is_written_over_another(capsys, axis, args, message):
    Path("linked.csv").symlink_to("axis.csv")
    Path("hard.csv").hardlink_to("axis.csv")
    Path("o.toml").write_text(OBSERVER.replace("poles = [-1, -2]\n", ""))
    os.mkfifo("pipe.csv")
    before = {p.name: p.read_bytes() for p in Path().iterdir() if p.is_file()}
    status, out, err = hgo(capsys, "estimate", axis, *ESTIMATE, "--observer", "standard", *args)
    assert (status, out) == (2, "")
    assert message in one_line(err)
    assert {p.name: p.read_bytes() for p in Path().iterdir() if p.is_file()} == before


@pytest.mark.parametrize("what", ["figure", "configuration", "table"])
def test_a_result_that_cannot_be_written_leaves_all_as_it_was(capsys, axis, monkeypatch, what):
    for name in ("e.csv", "e.png", "e.toml"):
        Path(name).write_text("earlier")

    def full(*_):
        raise OSError(28, "No space left on device")

    owner, name = {
        "figure": (plots, "save"),
        "configuration": (hgo_rs.Config, "to_toml"),
        "table": (TableWriter, "_write_text"),
    }[what]
    monkeypatch.setattr(owner, name, full)
    args = [*ESTIMATE, "--observer", "standard", "--out", "e.csv", "--save-config", "e.toml"]
    status, out, err = hgo(capsys, "estimate", axis, *args)
    assert (status, out) == (2, "")
    assert "No space left on device" in one_line(err)
    assert sorted(p.name for p in Path().iterdir()) == ["axis.csv", "e.csv", "e.png", "e.toml"]
    assert {Path(name).read_text() for name in ("e.csv", "e.png", "e.toml")} == {"earlier"}


def test_an_error_says_what_a_folder_holds_already(tmp_path):
    folder = reproduce.OutputFolder(tmp_path)
    folder.write_all({"a.png": b"a", "a.svg": b"a"})
    (tmp_path / "b.png").mkdir()
    with pytest.raises(reproduce.OutputError, match=r"b\.png: Is a dir.*written before: a\.png, a"):
        folder.write_all({"b.svg": b"b", "b.png": b"b"})
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.png", "a.svg", "b.png"]


@pytest.mark.parametrize(
    "args",
    [
        ["\x1b[2Jfoo"],
        ["run", "\x1b[2Jfoo"],
        ["estimate", "a\x1b[2J.csv", *ESTIMATE, "--observer", "standard"],
        ["estimate", "no\x9b\x07.csv", *ESTIMATE, "--observer", "standard"],
        ["estimate", "axis.csv", *ESTIMATE, "--observer", "\u202estandard"],
        ["estimate", "axis.csv", *ESTIMATE, "--observer", "standard", "--input", "\x1b[2J"],
        ["estimate", "axis.csv", "--gain", "\x1b[2J"],
        ["estimate", "odd\x1b[2J\n.csv", "--time", "t\x1b]0x\x07", "--output", "q\n\x1b[2J"],
        ["estimate", "axis.csv", "--config", "o.toml"],
    ],
)
def test_no_control_character_reaches_the_terminal(capsys, axis, args):
    rows = "".join(f"{k * 0.01!r},{math.sin(k * 0.01)!r}\n" for k in range(100))
    Path("odd\x1b[2J\n.csv").write_text('"t\x1b]0x\x07","q\n\x1b[2J"\n' + rows)
    Path("o.toml").write_text('format = 1\n"\\u001b[2J" = 1\n')
    well = args[-1].endswith("q\n\x1b[2J")
    if well:
        args = [*args, *ESTIMATE[4:], "--observer", "standard"]
    status, out, err = hgo(capsys, *args)
    assert status == (0 if well else 2), err
    assert all(line.isprintable() for line in (out + err).splitlines())
    assert "\\x1b[2J" in out + err or "\\x9b" in err or "\\u202e" in err


def test_the_command_says_what_ran(capsys, axis, undrawn):
    """Whatever is left open is as in the class."""
    for name, law in (
        ("standard", hgo_rs.StandardObserver(3, gain=20.0)),
        ("low-power", hgo_rs.LowPowerObserver(3, gain=20.0)),
    ):
        _, out, _ = hgo(capsys, "estimate", axis, *ESTIMATE, "--observer", name)
        chosen = f"method {law.spec['method']}; timing {law.timing}"
        told = f"run by {name}, order 3, gain 20 1/s, {chosen}; begun at the first sample\n"
        assert told in out
        other = ["--method", "rk4", "--timing", "current"]
        _, out, _ = hgo(capsys, "estimate", axis, *ESTIMATE, "--observer", name, *other)
        assert "method rk4; timing current; begun at the first sample\n" in out
        _, out, _ = hgo(capsys, "estimate", axis, *ESTIMATE, "--observer", name, "--start", "zero")
        assert "; begun at 0\n" in out


def test_units_of_several_clocks(capsys, tmp_path, monkeypatch, undrawn):
    monkeypatch.chdir(tmp_path)
    t = np.arange(400) * 5
    signals = {"p": np.sin(1e-3 * t), "q": np.cos(1e-3 * t[::8])}
    np.savez("two.npz", ta=t, tb=t[::8] * 1000, **signals)
    model = hgo_rs.Model(states=["p", "v", "q", "w"], orders=[2, 2], phi=["0*p", "0*q"])
    chains = [hgo_rs.StandardObserver(2, 20.0), hgo_rs.StandardObserver(2, 10.0)]
    law = hgo_rs.MultiOutputObserver(chains, model=model)
    law.save("o.toml", time=["ta", "tb"], output=["p", "q"])
    args = ["two.npz", "--config", "o.toml"]
    assert "say unit = one of" in hgo(capsys, "estimate", *args)[2]
    units = ["--unit", "ms", "--unit", "us"]
    status, out, err = hgo(capsys, "estimate", *args, *units, "--save-config", "s.toml")
    assert (status, err) == (0, "")
    assert "400 samples from 0 s to 1.995 s" in out
    assert hgo_rs.load("s.toml").log["unit"] == ["ms", "us"]
    y = np.full((400, 2), np.nan)
    y[:, 0], y[::8, 1] = signals.values()
    written = read_log("two.estimates.csv", "t", ["v", "w"]).y
    expected = law.run(t / 1e3, y, start="first-sample").x_hat
    np.testing.assert_array_equal(written, expected[:, 1::2])


OBSERVER = """\
format = 1
observer = "standard"
order = 2
gain = 20.0
poles = [-1, -2]

[log]
time = "t"
output = "q"
"""


def test_estimate_from_a_configuration(capsys, axis, undrawn):
    Path("observer.toml").write_text(OBSERVER)
    assert hgo(capsys, "estimate", axis, "--config", "observer.toml")[0] == 0
    log = read_log(axis, "t", "q")
    law = hgo_rs.StandardObserver(2, gain=20.0, poles=[-1, -2])
    velocity = read_log("axis.estimates.csv", "t", "x_hat2").y
    np.testing.assert_array_equal(velocity, law.run(log.t, log.y).x_hat[:, 1])
    # options go before the file, and both can be written down
    args = ["--config", "observer.toml", "--order", 3, "--gain", 30, "--poles", "-1,-1+1j,-1-1j"]
    status, out, err = hgo(
        capsys,
        "estimate",
        axis,
        *args,
        "--input",
        "u",
        "--input-gain",
        2,
        "--save-config",
        "o.toml",
    )
    assert (status, err) == (0, "")
    assert "written: axis.estimates.csv, axis.estimates.png, o.toml" in out
    law = hgo_rs.StandardObserver(
        3, gain=30.0, poles=[-1, -1 + 1j, -1 - 1j], model=hgo_rs.InputGain(2.0)
    )
    saved = hgo_rs.load("o.toml")
    assert saved.observer().spec == law.spec
    log = read_log(axis, "t", "q", "u")
    expected = law.run(log.t, log.y, log.u).x_hat
    acceleration = read_log("axis.estimates.csv", "t", "x_hat3").y
    np.testing.assert_array_equal(acceleration, expected[:, 2])
    np.testing.assert_array_equal(hgo_rs.estimate(axis, saved).x_hat, expected)


@pytest.mark.parametrize(
    ("change", "args", "message"),
    [
        (("gain = 20.0", "gian = 20.0"), [], "o.toml, line 4: gian is not a known key; nearest: g"),
        (("gain = 20.0\n", ""), [], "gain: give either gain"),
        (("format = 1", "format = 2"), [], "o.toml, line 1: format = 2: the file is of format 2"),
        (('"q"', '"Q_m"'), [], "has no column 'Q_m'; nearest: q"),
        (("", ""), ["--observer", "low-pover"], "unknown observer 'low-pover'; nearest: low-power"),
        (("", ""), ["--saturation", "1"], "--saturation has no meaning for --observer standard"),
        (("", ""), ["--input", "u"], "input: 1 named (u), the observer has 0"),
        (("", ""), ["--input-gain", "2"], "--input-gain has no meaning without --input"),
        (("", ""), ["--save-config", "absent/o.toml"], "cannot write absent/o.toml"),
        (("", ""), ["--unit", "ms"], "axis.csv"),
        (('output = "q"', 'output = "q"\nunit = "us"'), ["--dt", "5e-3"], "leave dt out"),
    ],
)
def test_estimate_refuses_a_configuration_in_one_line(capsys, axis, undrawn, change, args, message):
    Path("o.toml").write_text(OBSERVER.replace(*change, 1))
    status, _, err = hgo(capsys, "estimate", axis, "--config", "o.toml", *args)
    if args == ["--unit", "ms"]:  # no error: steps of 5 us
        assert (status, err) == (0, "")
        return
    assert status == 2
    assert message in one_line(err)
    assert sorted(p.name for p in Path().iterdir()) == ["axis.csv", "o.toml"]


def test_estimate_needs_an_observer(capsys, axis):
    for args, message in (
        (["--output", "q", "--dt", 1], "--observer is needed, or a --config that names one"),
        (["--observer", "standard", "--order", 2], "--gain is needed for --observer standard"),
        (["--observer", "standard", "--gain", 2], "--order is needed for --observer standard"),
        (
            ["--observer", "high-gain-ekf", "--order", 2],
            "high-gain-ekf needs R, which has no option: write it into an observer.toml",
        ),
    ):
        status, _, err = hgo(capsys, "estimate", axis, *args)
        assert status == 2
        assert message in one_line(err)


def test_an_unstable_step_names_the_option(capsys, axis):
    law = ["--observer", "standard", "--order", 2, "--gain", 3000, "--method", "euler"]
    columns = ["--time", "t", "--unit", "s", "--output", "q"]
    status, _, err = hgo(capsys, "estimate", axis, *columns, *law)
    assert status == 2
    assert "or --allow-unstable of hgo estimate to study it" in one_line(err)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_estimate_in_chunks_gives_the_same_file(capsys, axis, undrawn, monkeypatch, suffix):
    if suffix == "parquet":
        pytest.importorskip("pyarrow")
    args = [*ESTIMATE, "--observer", "low-power"]
    out = hgo(capsys, "estimate", axis, *args, "--out", f"whole.{suffix}")[1]
    monkeypatch.setattr("hgo_rs.logs.read.CHUNK", 17)
    said = hgo(capsys, "estimate", axis, *args, "--out", f"parts.{suffix}")[1]
    gaps = re.findall(r"gap of .* at its end: x_hat1 [\d.e-]+, x_hat2 [\d.e-]+, x_hat3", out)
    assert len(gaps) == 1
    assert out.splitlines()[:2] == said.splitlines()[:2]
    for column in ("t", "y", "x_hat1", "x_hat3", "innovation", "missing"):
        whole = read_log(f"whole.{suffix}", "t", column)
        parts = read_log(f"parts.{suffix}", "t", column)
        np.testing.assert_array_equal(parts.y, whole.y)
    if suffix == "csv":
        assert Path("parts.csv").read_bytes() == Path("whole.csv").read_bytes()


def test_a_figure_shows_every_so_manieth_row_of_a_long_log():
    trace = _Trace()
    trace.MOST = 100
    law = hgo_rs.StandardObserver(2, gain=5.0)
    t = np.arange(1000) * 0.01
    result = law.run(t, t)
    for a in range(0, 1000, 37):
        rows = slice(a, a + 37)
        none = np.zeros(len(t[rows]), bool)
        names = {"time": "t", "output": "q", "input": None}
        trace.add(Log(t[rows], t[rows], None, names, "", none), result.rows(rows))
    assert trace.stride == 16
    np.testing.assert_array_equal(np.concatenate(trace.parts["time"]), t[::16])
    np.testing.assert_array_equal(np.concatenate(trace.parts["x_hat"]), result.x_hat[::16])


def test_estimate_over_resets_of_the_clock(capsys, axis, undrawn):
    lines = axis.read_text().splitlines()
    axis.write_text("\n".join([*lines, *lines[1:501]]) + "\n")
    args = [*ESTIMATE, "--observer", "standard"]
    status, _, err = hgo(capsys, "estimate", axis, *args)
    assert status == 2
    assert "line 2003: time 0 does not come after 10 (line 2002); the clock was set back" in err
    assert not Path("axis.estimates.csv").exists()
    status, out, _ = hgo(capsys, "estimate", axis, *args, "--resets", "split")
    assert status == 0
    assert "2 pieces between resets of the clock" in out
    log = read_log("axis.estimates.csv", "t", ["x_hat2", "piece"], resets="split")
    first, second = log.pieces
    np.testing.assert_array_equal(second.y[:, 0], first.y[:500, 0])
    assert (first.y[:, 1] == 0).all() and (second.y[:, 1] == 1).all()


def test_estimate_of_several_outputs_and_inputs(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    t = np.arange(200) * 0.05
    signals = [t, 3.0 * t, 0.4 * np.sin(t), 0.1 * t, np.full(200, 0.3), 0.1 * np.sin(t)]
    lines = [",".join(map(repr, row)) for row in np.array(signals).T.tolist()]
    Path("ship.csv").write_text("t,x,y,psi,f,d\n" + "\n".join(lines) + "\n")
    law = hgo_rs.ReducedOrderObserver(0.3)
    law.save("o.toml", time="t", output=["x", "y", "psi"], input=["f", "d"])
    assert hgo(capsys, "estimate", "ship.csv", "--config", "o.toml")[0] == 0
    written = read_log("ship.estimates.csv", "t", ["x_hat1", "x_hat2", "x_hat3", "y3"], ["u2"])
    expected = law.run(t, np.array(signals[1:4]).T, np.array(signals[4:]).T)
    np.testing.assert_array_equal(written.y[:, :3], expected.x_hat)
    np.testing.assert_array_equal(written.y[:, 3], signals[3])
    np.testing.assert_array_equal(written.u[:, 0], signals[5])
    assert Path("ship.estimates.png").exists()


# --- the process itself ----------------------------------------------------------------------


@pytest.mark.parametrize("law", ["standard", "low-power"])
def test_estimate_of_independent_outputs_is_an_observer_for_each(
    capsys, tmp_path, monkeypatch, law
):
    """Each output gives what it gives alone; the shares of inputs too; a turn is seen in either."""
    monkeypatch.chdir(tmp_path)
    t = 0.01 * np.arange(400)
    a, b = np.sin(t), np.angle(np.exp(2.0j * t))
    write_table("joints.csv", {"t": t, "a": a, "b": b, "u": np.cos(t), "v": -np.cos(t)})
    options = f"joints.csv --time t --observer {law} --order 2 --gain 20 --input-gain 3".split()
    one = {"a": "u", "b": "v"}
    for name, drive in one.items():
        told = ["--output", name, "--input", drive, "--out", f"{name}.csv"]
        assert hgo(capsys, "estimate", *options, *told)[0] == 0
    both = ["--output", "a", "--output", "b", "--input", "u", "--input", "v"]
    status, told, _ = hgo(capsys, "estimate", *options, *both, "--out", "ab.csv")
    assert status == 0
    assert "'b' jumps by nearly 6.28" in told
    alone = [read_log(f"{n}.csv", "t", ["x_hat1", "x_hat2"]).y for n in one]
    names = ["a", "da", "b", "db"]
    np.testing.assert_allclose(read_log("ab.csv", "t", names).y, np.hstack(alone), atol=1e-9)
    status, _, error = hgo(capsys, "estimate", *options, *both[:6])
    assert status == 2
    assert "--input: 1 for 2 outputs; name one for each" in error


def test_import_is_light():
    """`import hgo_rs` leaves SciPy and every optional or command-line library alone."""
    heavy = [
        "scipy",
        "matplotlib",
        "pandas",
        "pyarrow",
        "xarray",
        "cvxpy",
        "click",
        "rich",
        "tomlkit",
    ]
    code = f"import sys, hgo_rs; print([m for m in {heavy} if m in sys.modules])"
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="no list of processes")
def test_a_terminated_run_leaves_no_workers(tmp_path):
    process = subprocess.Popen(
        [*HGO, "reproduce", "--jobs", "2", "--backend", "numpy", "--out", tmp_path],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )

    def alive():
        states = []
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = stat.read_text().rpartition(")")[2].split()
            except OSError:
                continue
            if fields[3] == str(process.pid) and fields[0] != "Z":  # of its session
                states.append(stat)
        return len(states)

    end = time.monotonic() + 60.0
    while alive() < 4 and time.monotonic() < end:  # itself, two workers, a tracker
        time.sleep(0.05)
    assert alive() >= 4
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=60) == 143
    while alive() and time.monotonic() < end:
        time.sleep(0.05)
    assert alive() == 0


def test_a_terminated_estimate_leaves_no_file(axis):
    lines = [f"{k * 5e-3:.3f},{k % 7},0\n" for k in range(400_000)]
    axis.write_text("t,q,u\n" + "".join(lines))
    process = subprocess.Popen(
        [*HGO, "estimate", axis, *map(str, ESTIMATE), "--observer", "standard"]
    )
    end = time.monotonic() + 60.0
    while not list(Path().glob(".hgo-*")) and time.monotonic() < end:
        time.sleep(0.01)
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=60) == 143
    assert [p.name for p in Path().iterdir()] == ["axis.csv"]


def test_closed_pipe_is_quiet():
    process = subprocess.Popen([*HGO, "list"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert b"Traceback" not in process.stderr.read()
    process.stderr.close()
    process.wait(timeout=60)
