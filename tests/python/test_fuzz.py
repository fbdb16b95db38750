"""`make fuzz` for a moment, and that it sees and tells what is wrong."""

from __future__ import annotations

import contextlib
import importlib.util
import itertools
import shutil
import subprocess
import sys
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hgo_rs import HgoError, reference

sys.path.insert(0, str(Path(__file__).parents[1] / "fuzz"))

import checks
import draw

HERE = Path(checks.__file__).parent


def cases_with(check: str, of: str = "") -> Iterator[draw.Case]:
    """The cases of seed 1 with a check, on this kind of observer."""
    for number in range(1000):
        case = draw.draw(1, number)
        made = any(line.startswith(f"observer = hgo.{of}") for line in case.lines)
        if made and check in case.checks:
            yield case


def test_some_cases() -> None:
    command = [sys.executable, str(HERE), "--seed", "1", "--cases", "16", "--seconds", "120"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "fuzz, seed 1: 16 cases" in done.stdout and "; 0 failed" in done.stdout


def test_a_case_is_its_number() -> None:
    for number in range(60):
        a, b = draw.draw(5, number), draw.draw(5, number)
        assert (a.lines, a.checks, repr(a.record)) == (b.lines, b.checks, repr(b.record))
    assert draw.draw(5, 0).lines != draw.draw(6, 0).lines


CHECKS = (
    "loop", "chunks", "twin", "innovation", "copies", "own", "long", "exported", "refusal",
    "blocks", "played_again", "twin_study",
)  # fmt: skip


@pytest.mark.parametrize("check", CHECKS)
def test_every_check_compares_numbers(check: str) -> None:
    """None passes because all is refused."""
    if check == "exported" and shutil.which("cc") is None:
        pytest.skip("no C compiler")
    before = checks.count["comparisons"]
    for case in itertools.islice(cases_with("loop" if check == "exported" else check), 8):
        with contextlib.suppress(HgoError):  # an observer that cannot be
            exec(case.told(check), {})
        if checks.count["comparisons"] > before:
            return
    raise AssertionError("nothing was compared")


@pytest.mark.parametrize("check", ["loop", "twin", "chunks"])
def test_the_lines_of_a_case_find_a_wrong_engine(check: str, monkeypatch: Any) -> None:
    """The printed lines pass as they are, and fail with a run or a twin that is off by 1e-6."""
    lines = next(cases_with(check, "HighGainObserver('standard', 2")).told(check)
    exec(lines, {})
    from hgo_rs.observers import Observer

    right = Observer.run

    def wrong(self: Any, t: Any, *arguments: Any, **options: Any) -> Any:
        result = right(self, t, *arguments, **options)
        moved = np.array(result.memory)
        moved[-1] *= 1.0 + 1e-6 * len(moved)
        result.__dict__["memory"] = moved
        return result

    monkeypatch.setattr(Observer, "run", wrong)
    for verb in ("step", "correct", "predict"):
        exact = getattr(reference.Observer, verb)

        def off(self: Any, *arguments: Any, exact: Any = exact) -> Any:
            memory, status = exact(self, *arguments)
            return memory * (1.0 + 1e-6), status

        monkeypatch.setattr(reference.Observer, verb, off)
    with pytest.raises(checks.Different):
        exec(lines, {})


def test_a_crash_is_told(tmp_path: Path, monkeypatch: Any, capsys: Any) -> None:
    """A child that aborts within case 3: its lines are printed, and the next case is 4."""
    spec = importlib.util.spec_from_file_location("fuzz_driver", HERE / "__main__.py")
    assert spec is not None and spec.loader is not None
    driver = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(driver)
    child = tmp_path / "python"
    told = '{"case": 3, "check": "loop"}'
    child.write_text(f"#!{sys.executable}\nimport os\nprint({told!r}, flush=True)\nos.abort()\n")
    child.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(child))
    fuzz = driver.Driver(Namespace(seconds=60.0, seed=1, first=0, cases=9, long=1))
    assert fuzz.child(0, 9) == 4
    out = capsys.readouterr().out
    assert "# case 3 of seed 1, loop: the process ended with -6" in out
    assert "checks.loop(observer, t, y, u, start)" in out
