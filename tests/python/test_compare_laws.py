"""Every law on one bench: its rule, its conditions, and the page that is built from its data."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from hgo_rs import HgoError, StandardObserver
from hgo_rs.bench import Cell, Report
from hgo_rs.bench.entrants import LEFT_OUT, STANDARD, Asked, entrants
from hgo_rs.bench.measure import SETTLING, _tuned, left_out, operations
from hgo_rs.bench.systems import CONDITIONS, COUNT, DT, systems
from hgo_rs.laws import LAWS

DOCS = Path(__file__).parents[2] / "docs"
PLACES = systems()


def test_every_law_of_the_list_takes_part_or_is_told_of():
    taking = {one.kind for one in entrants()}
    assert entrants()[0].name == STANDARD
    for kind, law in LAWS.items():
        assert kind in taking or kind in LEFT_OUT or not law.single, kind
    assert {law.kind for law in LAWS.values() if law.single} <= taking


def test_chains_are_derivatives_of_their_signals():
    for system in PLACES:
        step = DT / 10.0
        for i in range(system.n - 1):
            slope = np.gradient(system.fine[:, i], step)
            size = np.abs(system.fine[:, i + 1]).max()
            off = np.abs(slope - system.fine[:, i + 1])[2:-2].max() / size
            assert off < 0.02, (system.name, i)  # an input that jumps bends the last state
        assert system.x.shape == (COUNT, system.n)


@pytest.mark.parametrize("condition", CONDITIONS)
def test_records_are_what_they_say(condition):
    system, noise = PLACES[1], 0.02
    clock, y, x, judged = system.record(condition, noise)
    off = y - x[:, 0]
    assert judged.any() and np.array_equal(y, system.record(condition, noise)[1], True)
    rms = np.sqrt(np.nanmean(off**2))
    if condition == "bias":
        assert rms == 0.0
    elif condition == "outliers":
        assert rms == pytest.approx(noise * math.sqrt(1.0 + 0.01 * 20.0**2), rel=0.25)
    else:
        assert rms == pytest.approx(noise, rel=0.06)
    if condition == "quantised":
        steps = y / (noise * math.sqrt(12.0))
        assert np.abs(steps - np.round(steps)).max() < 1e-9
    if condition == "band":
        power = np.abs(np.fft.rfft(off)) ** 2
        rates = np.fft.rfftfreq(COUNT, DT)
        assert power[(rates > 7.5) & (rates < 12.5)].sum() > 0.95 * power.sum()
    if condition == "gap":
        assert np.isnan(y).sum() == 120 and np.isnan(y[judged]).sum() == 120
    if condition == "jitter":
        assert np.all(np.diff(clock) > 0.0)
        assert np.abs(clock - DT * np.arange(COUNT)).max() == pytest.approx(0.3 * DT, rel=1e-9)


def test_the_rule_is_the_settling_time():
    """Of a linear law the one that the design computes, of the same poles; and no less speed."""
    law = entrants()[0]
    for n in (2, 3, 4):
        asked = Asked(n, 1.0, 0.01, None, np.ones(n - 1))
        speed, settling, peak = _tuned(law, asked)
        assert settling == pytest.approx(SETTLING, abs=1.5 * DT)
        observer = StandardObserver(n, speed)
        assert observer.settling(DT)[-1] == pytest.approx(SETTLING, abs=2.5 * DT)
        assert peak == pytest.approx(observer.peaking(DT)[-1], rel=0.3)
        slower = StandardObserver(n, 0.97 * speed).settling(DT)[-1]
        assert slower >= SETTLING - DT


def test_operations_are_those_of_the_table():
    """A chain of two, by its exact step: x_1 + T x_2, e, x_1 + K_1 e, x_2 + K_2 e and no more than
    what tells a missing sample."""
    count = operations(StandardObserver(2, 10.0))
    assert 7 <= count <= 25
    assert count < operations(StandardObserver(3, 10.0)) < operations(StandardObserver(4, 10.0))


def test_a_report_by_hand():
    def cell(system, group, entrant, white, noise=1.0):
        errors = tuple((name, white) for name in CONDITIONS)
        return Cell(system, group, entrant, entrant, 2, 1.0, 0.5, 2.0, noise, 10, errors)

    cells = [
        cell("a", "one", STANDARD, 0.1),
        cell("a", "one", "better", 0.05),
        cell("a", "one", "near", 0.051),
        cell("b", "one", STANDARD, 0.4),
        cell("b", "one", "better", 0.1),
        cell("b", "one", "near", 0.099),
        cell("b", "one", "lost", math.inf),
        Cell("a", "one", "lost", "lost", 2, refused="why"),
        Cell("a", "one", "away", "away", 2, refused="no speed"),
    ]
    report = Report(cells)
    assert report.ratio("better", "white") == pytest.approx(math.sqrt(0.5 * 0.25))
    assert [name for name, _ in report.winners("white", ["one"])] == ["better", "near"]
    assert math.isinf(report.ratio("lost", "white")) and "lost" in report.table()
    assert left_out(cells)["away"] == "no speed"
    again = Report.of_csv(report.to_csv())
    assert again.to_csv() == report.to_csv() and again.table() == report.table()


def test_the_page_and_the_readme_are_built_from_the_data():
    """By `hgo compare-laws --out docs --page README.md --page docs/index.md`."""
    report = Report.of_csv((DOCS / "which-observer.csv").read_text(encoding="utf-8"))
    page = (DOCS / "which-observer.md").read_text(encoding="utf-8")
    assert page == report.page("which-observer.png", "which-observer.csv")
    for path in (DOCS.parent / "README.md", DOCS / "index.md"):
        text = path.read_text(encoding="utf-8")
        block = text.split("<!-- laws -->\n")[1].split("\n<!-- end of laws -->")[0]
        assert block == report.short(), path.name
    assert {cell.system for cell in report.cells} == {system.name for system in PLACES}
    names = {one.name for one in entrants()}
    assert {cell.entrant for cell in report.cells} <= names


def test_one_cell_is_measured_anew():
    """The standard law on a chain of two, as the data has it."""
    from hgo_rs.bench.measure import _cell, _noise

    report = Report.of_csv((DOCS / "which-observer.csv").read_text(encoding="utf-8"))
    system, law = PLACES[0], entrants()[0]
    asked = Asked(2, 1.0, 1.0, None, np.ones(1))
    asked = Asked(2, 1.0, _noise(system, asked), None, np.ones(1))
    empty = Cell(system.name, system.group, law.name, law.kind, 2)
    found = _cell(empty, law, asked, system, {})
    kept = next(c for c in report.cells if c.system == system.name and c.entrant == law.name)
    assert found.noise == pytest.approx(found.error("bias"), rel=0.1)  # by the rule of the noise
    for name in CONDITIONS:
        assert found.error(name) == pytest.approx(kept.error(name), rel=1e-4)


def test_the_command_writes_what_it_found(tmp_path, monkeypatch, capsys):
    """On the first system alone, whose cells are enough for every table."""
    from hgo_rs import bench
    from hgo_rs.bench import measure
    from hgo_rs.cli.command import command

    monkeypatch.setattr(measure, "systems", lambda: PLACES[:1])
    assert bench.measured is measure.measured
    out, page = tmp_path / "found", tmp_path / "page.md"
    page.write_text("before\n<!-- laws -->\nold\n<!-- end of laws -->\nafter\n", encoding="utf-8")
    words = ["compare-laws", "--out", str(out), "--page", str(page)]
    assert command.main(words, standalone_mode=False) == 0
    names = {path.name for path in out.iterdir()}
    assert {f"which-observer.{end}" for end in ("md", "csv", "json")} <= names
    report = Report.of_csv((out / "which-observer.csv").read_text(encoding="utf-8"))
    assert report.groups == ["chain, n = 2"]
    assert page.read_text(encoding="utf-8") == (
        f"before\n<!-- laws -->\n{report.short()}\n<!-- end of laws -->\nafter\n"
    )
    page.write_text("nothing", encoding="utf-8")
    with pytest.raises(HgoError, match="must be a page with"):
        command.main(words, standalone_mode=False)
    said = capsys.readouterr().out
    assert "Which law wins where" in said and "not compared: collection" in said
    assert (out / "which-observer.md").read_text(encoding="utf-8").startswith("# Which observer")
    kept = Report.of_csv((DOCS / "which-observer.csv").read_text(encoding="utf-8"))
    for mine in report.cells:
        other = next(c for c in kept.cells if (c.system, c.entrant) == (mine.system, mine.entrant))
        if mine.errors:
            assert mine.error("white") == pytest.approx(other.error("white"), rel=0.02)


def test_a_folder_or_a_page_of_no_use_is_refused_before_the_work(tmp_path, monkeypatch):
    from hgo_rs import bench
    from hgo_rs.cli.command import command

    monkeypatch.setattr(bench, "measured", lambda progress: pytest.fail("measured"))
    blocked = tmp_path / "file"
    blocked.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(HgoError, match=r"cannot write to the folder .*with --out"):
        command.main(["compare-laws", "--out", str(blocked / "in")], standalone_mode=False)
    with pytest.raises(HgoError, match=str(blocked)):
        command.main(["compare-laws", "--page", str(blocked)], standalone_mode=False)


def test_instructions_are_those_of_the_readme():
    from hgo_rs.bench.measure import M4F

    text = (DOCS.parent / "README.md").read_text(encoding="utf-8")
    block = text.split("<!-- firmware -->")[1].split("<!-- end of firmware -->")[0]
    rows = [[cell.strip() for cell in line.split("|")[1:4]] for line in block.splitlines()]
    counted = {(row[0], row[1]): row[2].split()[0] for row in rows if len(row) == 3 and row[2]}
    named = {
        "adaptive gain": "adaptive",
        "dead-zone gain": "dead-zone",
        STANDARD: "standard, zoh",
        "prescribed-time gain": "prescribed time",
        "dead zone": "dead zone of the innovation",
        "piecewise-linear": "piecewise linear",
        "extended Kalman filter": "high-gain EKF, sampled",
        "adaptive high-gain EKF": "high-gain EKF, adaptive",
    }
    for (name, n), count in M4F.items():
        assert counted[named.get(name, name), str(n)] == str(count), name
