"""Terminal runs in the documentation: repeated, they say what stands there."""

from __future__ import annotations

import importlib
import time
from pathlib import Path
from typing import Any

import pytest

DOCS = Path(__file__).parents[2] / "docs"
PAGES = [p for p in sorted(DOCS.glob("*.md")) if "```console\n" in p.read_text(encoding="utf-8")]


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(DOCS / "site"))
    return importlib.import_module("recorded")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_recorded_run_is_what_its_commands_say(page: Path, recorded: Any, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    began = time.perf_counter()
    for block in recorded.BLOCK.finditer(page.read_text(encoding="utf-8")):
        made = recorded.again(block[1], tmp_path)
        assert recorded.alike(block[1], made), made
    assert time.perf_counter() - began < 60.0  # the first minute is one


def test_runs_that_say_something_else_are_told_apart(recorded: Any) -> None:
    assert recorded.alike("gain 40.14 /s", "gain 40.2 /s")
    assert not recorded.alike("gain 40.14 /s", "gain 45 /s")
    assert not recorded.alike("gain 40.14 /s", "gain 40.14 rad/s")
    assert not recorded.alike("1 row", "1 row, 2 columns")
