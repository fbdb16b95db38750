"""What a notebook shows: pictures once, tables, names, progress; what compares and what prints."""

from __future__ import annotations

import copy
import importlib
import json
import os
import re
import sys
import types
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from notebook_pages import PAGES

import hgo_rs as hgo
from hgo_rs import markup
from hgo_rs.simulation.studies.cases import label

T = np.arange(400) * 5e-3
PENDULUM = hgo.Model(
    states=["q", "w"],
    inputs=["u"],
    parameters={"d": 0.1},
    phi="u - d*w - sin(q)",
    units={"q": "rad"},
)


class Tables(HTMLParser):
    """Cells of all rows; tags that do not close are refused."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.rows: list[list[str]] = []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if "td" in self.open or "th" in self.open:
            self.rows[-1][-1] += data


def rows(shown: Any) -> dict[str, list[str]]:
    """Rows of an object's tables by their first cells."""
    return {row[0]: row[1:] for row in Tables(shown._repr_html_()).rows}


# --- a kernel ----------------------------------------------------------------------------------

SETUP = """
import sys, numpy as np, hgo_rs as hgo
t = np.arange(400) * 5e-3
observer = hgo.StandardObserver(2, 20.0)
result = observer.run(t, np.sin(t))
assert "matplotlib" not in sys.modules
"""
CELLS = {
    "last": "result.plot()",
    "midst": "result.plot().show()\n1",
    "kept": "figure = result.plot()",
    "quiet": "result.plot();",
    "table": "observer",
    "equations": 'hgo.Model(states=["q"], phi="-q")',
    "study": """
study = hgo.study(lambda ell: dict(plant=hgo.Lee(), observer=hgo.StandardObserver(2, ell),
    x0=[1.0, 0.0], dt=1e-3, steps=200, windows=[(0.0, 0.2)]), grid={"ell": [5.0, 9.0]}, runs=2,
    progress=True)
study""",
    "light": 'assert "ipywidgets" not in sys.modules and "matplotlib.pyplot" not in sys.modules',
    "pyplot": "import matplotlib.pyplot as plt\nresult.plot()",
    "inline": "%matplotlib inline\nresult.plot()",
    "inline, kept": "figure = result.plot()",
}


@pytest.fixture(scope="module")
def cells() -> dict[str, Any]:
    """The outputs of each cell of a notebook that was run once."""
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    pytest.importorskip("matplotlib")
    new = nbformat.v4
    book = new.new_notebook(cells=[new.new_code_cell(c) for c in (SETUP, *CELLS.values())])
    nbclient.NotebookClient(book, kernel_name="python3", timeout=300).execute()
    return dict(zip(CELLS, (cell.outputs for cell in book.cells[1:]), strict=True))


def pictures(outputs: Any) -> int:
    return sum("image/png" in output.get("data", {}) for output in outputs)


def test_a_picture_is_shown_exactly_once(cells: dict[str, Any]) -> None:
    for name in ("last", "midst", "pyplot", "inline"):
        assert pictures(cells[name]) == 1, name
    for name in ("kept", "quiet", "inline, kept"):
        assert pictures(cells[name]) == 0, name


def test_objects_are_tables_and_equations(cells: dict[str, Any]) -> None:
    assert "<table>" in cells["table"][-1]["data"]["text/html"]
    assert r"\dot{q}" in cells["equations"][-1]["data"]["text/latex"]
    assert "<table>" in cells["study"][-1]["data"]["text/html"]


def test_progress_needs_no_widget(cells: dict[str, Any]) -> None:
    told = "".join(o.get("text", "") for o in cells["study"] if o["output_type"] == "stream")
    assert re.search(r"study 100 %, .* run-steps/s", told)
    assert not any("ipywidgets" in str(output) for output in cells["study"])
    assert not cells["light"]


# --- pages of the documentation ----------------------------------------------------------------

SITE = Path(__file__).parents[2] / "docs" / "site"


@pytest.fixture
def notebooks(monkeypatch: pytest.MonkeyPatch) -> Any:
    """What makes notebooks of pages."""
    monkeypatch.syspath_prepend(str(SITE))
    return importlib.import_module("notebooks")


@pytest.mark.parametrize("page", PAGES)
def test_a_page_runs_as_a_notebook(
    page: str, notebooks: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    book = nbformat.reads(notebooks.notebook(page), as_version=4)
    nbformat.validate(book)
    here = str(Path(sys.executable).parent)
    monkeypatch.setenv("PATH", os.pathsep.join([here, os.environ["PATH"]]))
    resources = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(book, kernel_name="python3", timeout=300, resources=resources).execute()
    done = [cell for cell in book.cells if cell.cell_type == "code"]
    assert done and all(cell.execution_count for cell in done)
    for cell in done:  # a command's failure is no exception in a notebook
        told = "".join(out.get("text", "") for out in cell.outputs)
        assert "Error" not in told and "must be" not in told, told


def test_a_notebook_holds_all_of_its_page(notebooks: Any) -> None:
    for page in notebooks.pages():
        text = (SITE.parent / f"{page}.md").read_text(encoding="utf-8")
        cells = json.loads(notebooks.notebook(page))["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        blocks = re.findall(r"^```python\n(.*?)^```", text, re.M | re.S)
        assert [block.strip("\n") for block in blocks] == [
            source for source in code if not source.startswith("!")
        ]
        told = "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "markdown")
        assert told.count("\n#") + told.startswith("#") >= text.count("\n## ") + 1
        assert "```python" not in told


# --- a script ----------------------------------------------------------------------------------


def test_show_opens_a_window_from_a_script(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a backend that notes which figure it is to show."""
    matplotlib = pytest.importorskip("matplotlib")
    from matplotlib import pyplot
    from matplotlib.backend_bases import FigureManagerBase
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    seen: list[Any] = []

    class Manager(FigureManagerBase):
        @classmethod
        def pyplot_show(cls, *, block: bool | None = None) -> None:
            seen.extend(pyplot.figure(number) for number in pyplot.get_fignums())

    class Canvas(FigureCanvasAgg):
        manager_class = Manager

    backend = types.ModuleType("noting")
    backend.FigureCanvas, backend.FigureManager = Canvas, Manager  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "noting", backend)
    before = matplotlib.get_backend()
    try:
        pyplot.switch_backend("module://noting")
        picture = hgo.StandardObserver(2, 20.0).run(T, np.sin(T)).plot()
        assert not pyplot.get_fignums()
        picture.show()
        assert seen == [picture]
    finally:
        pyplot.close("all")
        pyplot.switch_backend(before)


def test_show_without_a_window_is_told() -> None:
    pytest.importorskip("matplotlib").use("agg")
    picture = hgo.StandardObserver(2, 20.0).run(T, np.sin(T)).plot()
    with pytest.warns(UserWarning, match="agg opens no window; save it"):
        picture.show()
    from matplotlib import pyplot

    pyplot.close("all")


# --- reprs and names ---------------------------------------------------------------------------


def test_an_observer_and_its_result_name_the_states() -> None:
    observer = hgo.StandardObserver(2, 20.0, model=PENDULUM)
    assert repr(observer) == (
        "StandardObserver(n=2, gain=20, model=<Model in phase-variable form, 2 states: q, w>, "
        "method='zoh', motion='rk4', timing='current')"
    )
    shown = rows(observer)
    assert shown["gain"] == ["20 1/s"] and shown["estimate"] == ["q = 0, w = 0"]
    assert shown["model"][0].startswith("$") and r"\dot{w}" in shown["model"][0]
    y = np.sin(T)
    y[100:110] = np.nan
    result = observer.run(T, y, 0.0 * T, noise=1e-3, model_error=0.1)
    assert repr(result) == (
        "RunResult(400 samples from 0 to 1.995 s, 10 missing; q, w; timing='current')"
    )
    table = rows(result)
    assert list(table) == ["estimate", "q [rad]", "w"]
    assert float(table["w"][2]) == pytest.approx(result.x_hat[-1, 1], rel=1e-3)
    assert list(result.columns())[:5] == ["time", "q", "w", "std_q", "std_w"]
    if "pandas" in sys.modules or pytest.importorskip("pandas"):
        assert list(result.to_dataframe().columns[:2]) == ["q", "w"]
    pytest.importorskip("matplotlib")
    titles = [ax.get_title(loc="left") for ax in result.plot().axes]
    assert titles == ["q (rad)", "w", "innovation"]


def test_states_that_are_called_as_other_columns_are_kept() -> None:
    """No column replaces another."""
    model = hgo.Model(states=["y", "gain"], phi="-y")
    result = hgo.StandardObserver(2, 20.0, model=model).run(T, np.sin(T))
    columns = result.columns()
    assert list(columns) == ["time", "y_hat", "gain_hat", "innovation1", "gain", "missing"]
    assert np.array_equal(columns["gain_hat"], result.x_hat[:, 1]) and columns["gain"][0] == 20.0


def test_cases_of_a_study_are_told_apart() -> None:
    """By all that an observer is, though its repr is short."""
    laws = [hgo.StandardObserver(2, 20.0, poles=[-1.0, -p]) for p in (2.0, 3.0)]
    assert repr(laws[0]) == repr(laws[1]) and label(laws[0]) != label(laws[1])


def test_results_are_short_and_have_tables() -> None:
    rng = np.random.default_rng(0)
    t = np.arange(300) * 1e-2
    y = np.sin(3.0 * t) + 1e-3 * rng.standard_normal(300)
    smoothed = hgo.smooth(None, (t, y), order=2, R=1e-6, Q=10.0)
    tuned = hgo.tune({"mine": lambda ell: hgo.StandardObserver(2, ell)}, (t, y))
    compared = hgo.compare((t, y), {"mine": tuned}, baselines=())
    derivative = hgo.differentiate(y, 1e-2, noise=1e-3)
    plant = hgo.Lee()
    law = hgo.StandardObserver(2, 20.0)
    run = hgo.simulate(plant, law, x0=[1.0, 0.0], dt=1e-3, steps=100, windows=[(0.0, 0.1)])
    for one in (smoothed, tuned, compared, derivative, run, tuned.curves["mine"]):
        text = repr(one)
        assert text.startswith(f"{type(one).__name__}(") and "array" not in text
        assert "\n" not in text and len(text) < 200, text
    assert f"{tuned.ell:.4g}" in repr(tuned)
    assert rows(tuned)["x2"][0] == markup.number(tuned.errors[1])
    assert rows(compared)["mine"][1] == markup.number(compared.error[0, 1])
    states = [name for name in rows(smoothed) if name != "state"]
    assert states == list(smoothed.states)
    assert rows(run)["x2"] == [markup.number(run.rms[0, 0, 1]), markup.number(run.max[0, 0, 1])]


def test_a_table_is_escaped_and_not_endless() -> None:
    text = markup.table("<b>", [("<i>", k) for k in range(30)], ["&"])
    assert "<i>" not in text and "&lt;i&gt;" in text and "&lt;b&gt;" in text
    assert len(Tables(text).rows) == 1 + markup.MOST + 1 and "and 10 more" in text


# --- equality ----------------------------------------------------------------------------------


def test_observers_compare_by_value() -> None:
    def made(**changes: Any) -> hgo.StandardObserver:
        model = hgo.Model(states=["q", "w"], phi="-w", parameters={})
        return hgo.StandardObserver(**{"n": 2, "gain": 20.0, "model": model, **changes})

    one = made()
    assert one == made() == copy.deepcopy(one)
    others = [made(gain=21.0), made(poles=[-1.0, -3.0]), made(timing="predictor")]
    others += [made(model=None), made(allow_unstable=True), hgo.LowPowerObserver(2, 20.0)]
    assert all(one != other for other in others) and one != "standard"
    moved = made()
    moved.step(0.3, dt=0.01)
    assert moved != one
    moved.reset()
    assert moved == one
    with pytest.raises(TypeError, match="unhashable"):
        hash(one)
    ship = [hgo.ReducedOrderObserver(0.2, wrap=[None, None, 6.0]) for _ in range(2)]
    assert ship[0] == ship[1]


def test_what_cannot_change_has_a_hash_by_value() -> None:
    pairs = [
        lambda: hgo.AdaptiveGain(1.0, 0.1, 0.1),
        lambda: hgo.Fal([0.5, 0.5], 0.1),
        lambda: hgo.Lee(),
        lambda: hgo.Ship(0.1, (0.0, 0.0, 0.1)),
        lambda: hgo.NormalNoise(std=0.1),
        lambda: hgo.FixedStep(0.1),
        lambda: hgo.Model(states=["q"], phi="-q"),
        lambda: hgo.Config({"format": 1, "observer": "standard", "gain": 2.0, "order": 1}),
    ]
    for make in pairs:
        assert make() == make() and hash(make()) == hash(make())
    turned = hgo.Config({"order": 1, "gain": 2.0, "observer": "standard", "format": 1})
    assert turned == pairs[-1]() and hash(turned) == hash(pairs[-1]())


def test_dir_holds_public_names_alone() -> None:
    modules = {name for name in dir(hgo) if isinstance(getattr(hgo, name), types.ModuleType)}
    assert set(dir(hgo)) == modules | set(hgo.__all__)
    assert {"design", "logs", "plots"} <= modules and "upward" not in modules
