"""docs/performance.md states what its data state, and the data what is counted."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benches"))

from compare import instructions, performance, workloads
from compare.harness import LeftOut
from compare.instructions import Count, Counts
from compare.performance import Performance

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "performance.md"
DATA = PAGE.with_suffix(".json")
UNITS = {"ns": 1.0, "µs": 1e3, "ms": 1e6, "s": 1e9}


@pytest.fixture(scope="module")
def found() -> Performance:
    return Performance.read(DATA)


def table(title: str) -> list[list[str]]:
    """The cells of the first table under a heading, without its head."""
    text = PAGE.read_text(encoding="utf-8").split(f"# {title}\n", 1)[1]
    lines = text[text.index("\n|") :].strip().split("\n\n")[0].splitlines()
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def test_the_page_is_made_from_its_data(found: Performance) -> None:
    assert PAGE.read_text(encoding="utf-8") == performance.page(found)
    assert f"{found.machine}. Each time is {found.timing}." in PAGE.read_text(encoding="utf-8")
    assert PAGE.with_suffix(".png").stat().st_size > 10_000


def test_every_time_of_the_page_is_a_time_of_its_data() -> None:
    stored = json.loads(DATA.read_text(encoding="utf-8"))
    cores = stored["machine"]["cores"]
    known = [workload.key for workload in workloads.WORKLOADS if not workload.optional]
    assert [workload["key"] for workload in stored["workloads"]] == known
    for workload in stored["workloads"]:
        case = workload["key"].partition(", ")[2]
        ns = {
            (row["implementation"].removesuffix(f", {case}"), row["threads"]): row["ns_per_step"]
            for row in workload["rows"]
        }
        lines = table(workload["key"])
        assert [line[0] for line in lines] == [name for name, threads in ns if threads == 1]
        for name, one, many, of_limit, factor in lines:
            limit_name = "C, rounded" + ", AVX2" * name.endswith(", AVX2")
            limit = ns.get((limit_name, 1))
            for shown, threads in ((one, 1), (many, cores)):
                if shown:
                    value, unit = shown.split()
                    assert float(value) * UNITS[unit] == pytest.approx(ns[name, threads], rel=6e-3)
            assert (of_limit == "") == (limit is None or name == limit_name)
            if of_limit:
                assert limit is not None
                assert float(of_limit) == pytest.approx(ns[name, 1] / limit, rel=6e-3)
            if factor:
                ratio = ns[name, 1] / ns["ours", 1]
                assert float(factor) == pytest.approx(ratio, rel=6e-3)


def test_every_count_of_the_page_is_one_of_its_data(found: Performance) -> None:
    assert found.counts is not None
    lines = table("Instructions a step")
    shown = sum(cell != "" for line in lines for cell in line[1:])
    assert shown == len(found.counts.counts) >= 60
    total = sum(float(cell) for line in lines for cell in line[1:] if cell)
    exact = sum(one.instructions for one in found.counts.counts)
    assert abs(total - exact) <= 0.5 * shown


def test_the_instructions_are_those_that_are_counted_now(found: Performance) -> None:
    assert found.counts is not None
    try:
        now = instructions.compiler()
    except LeftOut as error:
        pytest.skip(f"not compared: {error}")
    if now != found.counts.compiler:
        pytest.skip(f"not compared: the table is of {found.counts.compiler}; here is {now}")
    counted = instructions.count()
    assert all(one.instructions > 5 for one in counted.counts)  # a call alone takes some
    different = instructions.differences(found.counts, counted)
    assert different == [], (
        "a step takes another number of instructions than docs/performance.md says; if that is "
        "meant, `python benches/compare --page docs/performance.md` writes what is counted now"
    )


def test_a_changed_count_is_a_difference(found: Performance) -> None:
    assert found.counts is not None
    first, *others = found.counts.counts
    more = replace(first, instructions=first.instructions + 1.0)
    changed = Counts(found.counts.compiler, (more, *others))
    [text] = instructions.differences(found.counts, changed)
    assert text.startswith(f"{first.law}, {first.scheme}: {first.instructions} stated")
    added = Counts("", (*found.counts.counts, Count("new", "euler", 3.0)))
    assert instructions.differences(found.counts, added) == []
    [text] = instructions.differences(found.counts, Counts("", tuple(others)))
    assert text.endswith("stated, None counted")


def test_compiling_for_another_processor_is_not_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(instructions.sys, "platform", "linux")
    monkeypatch.setattr(instructions.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(instructions.shutil, "which", lambda _: "/bin/true")
    monkeypatch.setenv("RUSTFLAGS", "-Ctarget-cpu=native")
    with pytest.raises(LeftOut, match="RUSTFLAGS is set"):
        instructions.compiler()
    monkeypatch.setattr(instructions.shutil, "which", lambda tool: tool != "valgrind" or None)
    with pytest.raises(LeftOut, match="valgrind is not installed"):
        instructions.compiler()
    monkeypatch.setattr(instructions.platform, "machine", lambda: "aarch64")
    with pytest.raises(LeftOut, match="not linux on aarch64"):
        instructions.compiler()


def compare(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "benches/compare"), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def test_one_command_makes_the_page(tmp_path: Path, found: Performance) -> None:
    done = compare("--page", tmp_path / "page.md", "--from", DATA)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "page.json").read_bytes() == DATA.read_bytes()
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == performance.page(found)
    assert (tmp_path / "page.png").stat().st_size > 10_000


def test_a_page_without_data_is_refused(tmp_path: Path) -> None:
    done = compare("--page", tmp_path / "page.md")
    assert done.returncode == 2
    assert "page.json is not there: `make bench` writes" in done.stderr
    assert not (tmp_path / "page.md").exists()
