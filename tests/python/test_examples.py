"""Every Python example runs and draws what it says."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_overview_draws_the_picture_of_the_readme(tmp_path: Path) -> None:
    out = tmp_path / "overview.png"
    subprocess.run([sys.executable, EXAMPLES / "overview.py", out], check=True, timeout=120)
    assert out.read_bytes().startswith(b"\x89PNG")
    assert out.stat().st_size > 20_000


def test_discretisation_draws_the_picture_of_its_page(tmp_path: Path) -> None:
    out = tmp_path / "discretisation.png"
    subprocess.run([sys.executable, EXAMPLES / "discretisation.py", out], check=True, timeout=120)
    assert out.read_bytes().startswith(b"\x89PNG")


def test_every_example_is_tested() -> None:
    assert [p.name for p in sorted(EXAMPLES.glob("*.py"))] == [
        "discretisation.py",
        "emps.py",  # test_tuning.py
        "overview.py",
    ]
