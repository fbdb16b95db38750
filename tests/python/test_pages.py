"""Pages to tune in: what they hold, what they refuse, and what a browser makes of them."""

from __future__ import annotations

import base64
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import browser
import numpy as np
import pytest

import hgo_rs as hgo
from hgo_rs import pages
from hgo_rs.cli import main
from hgo_rs.pages import module
from hgo_rs.pages.__main__ import main as pages_main
from hgo_rs.pages.module import digest
from hgo_rs.pages.showcase import shown
from hgo_rs.tuning import TuningWarning

pytestmark = pytest.mark.skipif(
    not module.MODULE.is_file(), reason="the package was built without the module: make pages"
)

DT = 2e-3
MODEL = hgo.Model(states=["q", "v"], inputs=["u"], parameters={"d": 0.5}, phi="u - d*v")


def record(count: int = 1500) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t = np.arange(count) * DT
    u = np.sign(np.sin(4.0 * t))
    v = np.zeros(count)
    for k in range(count - 1):
        v[k + 1] = v[k] + DT * (u[k] - 0.5 * v[k] + 0.3 * np.sin(9.0 * t[k]))
    y = np.cumsum(v) * DT + 1e-3 * np.random.default_rng(0).standard_normal(count)
    return t, y, u


def offered() -> dict[str, Any]:
    return {
        "model": lambda ell: hgo.StandardObserver(2, ell, model=MODEL),
        "low-power": lambda ell: hgo.LowPowerObserver(2, ell, model=MODEL),
    }


@pytest.fixture(scope="module")
def tuned() -> hgo.Tuning:
    return hgo.tune(offered(), record(), ells=[10.0, 60.0, 300.0])


def held(text: str) -> dict[str, Any]:
    """What a page holds, of its first system."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)
    assert found
    data: dict[str, Any] = json.loads(found[1])["systems"][0]
    return data


def numbers(packed: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(packed))


def test_a_page_is_one_file_with_the_log_within(tuned: hgo.Tuning, tmp_path: Path) -> None:
    path = tmp_path / "tune.html"
    tuned.page(path, title="a <b> & c", time="t", output="q")
    text = path.read_text(encoding="utf-8")
    assert "<title>a &lt;b> &amp; c</title>" in text
    assert not re.search(r"""(src|href)=["'](?!data:,)|url\(|https?://|import\(|fetch\(""", text)
    for left in ("/root", str(Path.home()), str(Path(__file__).parents[2])):
        assert left not in text and left.encode() not in module.MODULE.read_bytes()
    data = held(text)
    t, y, u = record()
    np.testing.assert_array_equal(numbers(data["log"]["t"]), t)
    np.testing.assert_array_equal(numbers(data["log"]["y"]), y)
    np.testing.assert_array_equal(numbers(data["log"]["u"]), u)
    assert {of["name"] for of in data["structures"]} == {"model", "low-power"}
    first = next(of for of in data["structures"] if of["name"] == tuned.structure)
    observer = tuned.built[tuned.structure]
    assert observer.spec == tuned.observer.spec
    assert first["digest"] == digest(tuned.run(record()).x_hat)
    for way in first["ways"]:
        saved = hgo.Config.from_toml("".join(way["toml"]), "page")
        assert saved.observer().spec["method"] == way["method"]
        assert saved.data["gain"] == tuned.ell and saved.data["log"]["output"] == "q"
    assert hgo.Config.from_toml("".join(first["ways"][0]["toml"])).observer().spec == observer.spec


def test_a_log_too_large_is_decimated_and_told(tuned: hgo.Tuning) -> None:
    text, told = pages.page(tuned, "log", most=600)
    assert told.startswith("decimated: 1 of 3 samples is kept, of 1500, inputs as the means")
    data = held(text)
    _, y, u = record()
    assert data["decimated"] == told and data["log"]["samples"] == 500
    np.testing.assert_array_equal(numbers(data["log"]["y"]), y[::3])
    np.testing.assert_allclose(numbers(data["log"]["u"]), u.reshape(-1, 3).mean(1))


def test_what_a_page_cannot_draw_is_refused(
    tuned: hgo.Tuning, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "tune.html"
    alone = hgo.tune(lambda ell: hgo.StandardObserver(2, ell), 1e-3, DT, model_error=0.1)
    with pytest.raises(hgo.HgoError, match="log of the tuning = None: must be given, for a page"):
        alone.page(path)
    two = replace(tuned, ell=np.array([1.0, 2.0]), curves={}, built={})
    with pytest.raises(hgo.HgoError, match="outputs of the log = 2: must be 1, for a page"):
        two.page(path)
    slow = hgo.Model(states=["q", "v"], phi=lambda t, x, u: -float(x[0]) * x[1])
    of_functions = replace(tuned, built={"model": hgo.StandardObserver(2, 20.0, model=slow)})
    with pytest.raises(hgo.HgoError, match="write the model as expressions"):
        of_functions.page(path)
    monkeypatch.setattr(module, "MODULE", tmp_path / "none.wasm")
    with pytest.raises(hgo.HgoError, match="make pages"):
        tuned.page(path)
    assert not path.exists()


def test_a_choice_that_cannot_be_drawn_is_told(tuned: hgo.Tuning, tmp_path: Path) -> None:
    """The gains of a Kalman filter move: the page begins with the next best, and says so."""
    pendulum = hgo.Model(states=["q", "v"], phi="-9.81*sin(q)")
    moving = hgo.HighGainEKF(2, 1.0, model=pendulum, R=1e-6, Q=[[0.0, 0.0], [0.0, 0.1]])
    curve = next(iter(tuned.curves.values()))
    chosen = replace(
        tuned,
        structure="filter",
        built={"filter": moving, **tuned.built},
        curves={"filter": curve, **tuned.curves},
        tried=(("filter", 1.0, 0.1), *tuned.tried),
    )
    next_best = tuned.tried[0][0]
    with pytest.warns(TuningWarning, match="it cannot draw the chosen structure, filter") as told:
        chosen.page(tmp_path / "tune.html")
    assert told[0].filename == __file__
    data = held((tmp_path / "tune.html").read_text())
    assert data["chosen"] == next_best in [of["name"] for of in data["structures"]]
    assert "the chosen structure, filter" in data["text"]
    assert any("move with the slopes of the model" in left for left in data["left"])


def test_several_outputs_are_refused_before_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    t, y, _ = record(200)
    np.savetxt("axis.csv", np.c_[t, y, y], delimiter=",", header="t,q,p", comments="")
    monkeypatch.setattr("hgo_rs.cli.tune.tune", lambda *_, **__: pytest.fail("it tuned"))
    words = "tune axis.csv --time t --output q --output p --page tune.html"
    with pytest.raises(SystemExit) as end:
        main(words.split())
    assert end.value.code == 2
    assert "outputs of the log = 2: must be 1, for a page" in capsys.readouterr().err


def test_the_command_writes_a_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    t, y, _ = record(200)
    np.savetxt("axis.csv", np.c_[t, y], delimiter=",", header="t,q", comments="")
    words = ["tune", "axis.csv", "--time", "t", "--output", "q", "--page", "tune.html"]

    def tuned_fast(_: Any, log: Any, **__: Any) -> hgo.Tuning:
        laws = {"order 2": lambda ell: hgo.StandardObserver(2, ell)}
        return hgo.tune(laws, log, ells=[10.0, 40.0, 160.0])

    monkeypatch.setattr("hgo_rs.cli.tune.tune", tuned_fast)
    with pytest.raises(SystemExit) as end:
        main(words)
    assert not end.value.code and "tune.html" in capsys.readouterr().out
    data = held(Path("tune.html").read_text(encoding="utf-8"))
    assert data["title"] == "axis.csv"
    assert 'output = "q"' in data["structures"][0]["ways"][0]["toml"][2]
    monkeypatch.setattr(module, "MODULE", tmp_path / "none.wasm")
    with pytest.raises(SystemExit) as end:
        main([*words[:-1], "other.html"])
    assert end.value.code == 2 and "make pages" in capsys.readouterr().err
    assert not Path("other.html").exists()


@pytest.mark.skipif(browser.PROGRAM is None, reason="needs Chromium")
def test_a_browser_has_pythons_bits_as_the_slider_moves(tuned: hgo.Tuning, tmp_path: Path) -> None:
    log = record(10_000)
    tuned = replace(tuned, log=log)
    path = tmp_path / "tune.html"
    tuned.page(path)
    move = """(async () => {
      const page = window.hgo, told = {};
      page.box.value = %d; page.box.dispatchEvent(new Event("change"));
      page.boxOfWays.value = %d; page.boxOfWays.dispatchEvent(new Event("change"));
      page.gain.bar.value = %d; page.gain.bar.dispatchEvent(new Event("input"));
      await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
      return { ell: page.gain.value, digest: digest(page.last.run.x), toml: page.toml(),
        noise: page.last.figures.noise, peak: page.last.peak, settled: page.last.settled };
    })()"""
    with browser.Browser() as opened:
        opened.open(path)
        assert opened.value("window.hgo.same") is True
        seen = set()
        for at, by, bar in ((0, 0, 300), (0, 0, 900), (0, 3, 500), (1, 0, 700), (1, 2, 650)):
            told = opened.value(move % (at, by, bar))
            observer = hgo.Config.from_toml(told["toml"]).observer()
            assert observer.spec["gain"]["ell"] == told["ell"]
            u = log[2] if observer.n_u else None
            run = observer.run(log[0], log[1], u, start="first-sample")
            assert told["digest"] == digest(run.x_hat), observer
            dt, i = float(np.median(np.diff(log[0]))), min(tuned.state, observer.n) - 1
            np.testing.assert_allclose(told["noise"], observer.noise_gain(dt), rtol=1e-6)
            assert told["peak"] == pytest.approx(observer.peaking(dt)[i], rel=1e-6)
            assert told["settled"] == pytest.approx(observer.settling(dt)[i], abs=1.01 * dt)
            seen.add(told["digest"])
        assert len(seen) == 5
        euler = 'window.hgo.structure.ways.findIndex((way) => way.method === "euler")'
        told = opened.value(
            f"(() => {{ const page = window.hgo; page.by = {euler}; page.gain.set(5000);"
            "page.draw(); return [document.getElementById('notice').innerText, page.limit(5000),"
            "page.structure.name]; })()"
        )
        of_euler = (
            hgo.Config.of(tuned.built[told[2]])
            .replace(method="euler", timing="predictor")
            .observer()
        )
        longest = float(np.max(np.diff(log[0])))
        assert told[1] == pytest.approx(of_euler.step_limit().c / longest, rel=1e-3)
        assert "Not stable: method euler holds up to" in told[0]
        before = opened.processor_time()
        opened.value(
            "for (let i = 0; i < 20; i += 1) { window.hgo.gain.set(10 + i); window.hgo.draw(); }"
        )
        spent = (opened.processor_time() - before) / 20.0
        print(f"{1e3 * spent:.1f} ms a picture of {len(log[0])} samples")
        assert spent < 0.05  # 20 pictures a second
        assert opened.requests == [] and opened.errors == []
        opened.open(path, before="delete window.WebAssembly;")
        assert "needs WebAssembly" in opened.value("document.getElementById('notice').innerText")
        assert f"{tuned.ell}"[:8] in opened.value("document.getElementById('notice').innerText")


def test_a_notebook_has_the_page_and_its_observer(tuned: hgo.Tuning) -> None:
    pytest.importorskip("anywidget")
    shown_page = tuned.widget(title="axis", output="q", time="t")
    assert held(shown_page.page)["title"] == "axis"
    assert shown_page.observer.spec == tuned.observer.spec
    shown_page.toml = shown_page.toml.replace(f"gain = {tuned.ell!r}", "gain = 33.0")
    assert shown_page.observer.spec["gain"]["ell"] == 33.0


@pytest.mark.skipif(browser.PROGRAM is None, reason="needs Chromium")
def test_what_the_page_in_a_notebook_comes_to_goes_back(tuned: hgo.Tuning, tmp_path: Path) -> None:
    """The widget's script with a model that keeps what it is given."""
    pytest.importorskip("anywidget")
    from hgo_rs.pages.widget import SCRIPT

    text = json.dumps(tuned.widget().page).replace("</", "<\\/")
    script = SCRIPT.read_text(encoding="utf-8").replace("export default", "const made =")
    harness = tmp_path / "notebook.html"
    harness.write_text(
        f"""<meta charset="utf-8"><body><script>{script}
        const values = {{ page: {text}, toml: "" }}, model = {{ get: (name) => values[name],
            set: (name, value) => {{ values[name] = value; }}, save_changes: () => {{}} }};
        made.render({{ model, el: document.body }});</script>""",
        encoding="utf-8",
    )
    with browser.Browser() as opened:
        opened.open(harness)
        opened.value(
            "new Promise((done) => { const ask = () => values.toml ? done() : setTimeout(ask, 20);"
            "ask(); })"
        )
        assert hgo.Config.from_toml(opened.value("values.toml")).observer() == tuned.observer
        opened.value(
            "(() => { const page = document.querySelector('iframe').contentWindow.hgo;"
            "page.gain.set(33.5); page.draw(); })()"
        )
        opened.value("new Promise((done) => setTimeout(done, 100))")
        moved = hgo.Config.from_toml(opened.value("values.toml")).observer()
        assert moved.spec["gain"]["ell"] == pytest.approx(33.5, rel=0.01)
        assert opened.requests == [] and opened.errors == []


@pytest.mark.skipif(browser.PROGRAM is None, reason="needs Chromium")
def test_the_showcase_runs_in_a_browser(tmp_path: Path) -> None:
    path = tmp_path / "showcase.html"
    assert pages_main([str(path)]) == 0 and pages_main([]) == 2
    systems = shown()
    with browser.Browser() as opened:
        opened.open(path)
        for i, of in enumerate(systems):
            opened.value(f"document.querySelectorAll('#systems button')[{i}].click()")
            told = opened.value(
                "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() =>"
                "done({ same: window.hgo.same, title: window.hgo.data.title,"
                "missed: window.hgo.missed(window.hgo.reference, 0) }))))"
            )
            assert told["same"] and told["title"] == of.title
            assert told["missed"] < 0.3  # RMS error of x1
        assert opened.requests == [] and opened.errors == []
