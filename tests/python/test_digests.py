"""Bits of this build against the digests that every wheel is tested with."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / ".ci" / "wheel.py"


def test_this_build_has_the_digests_of_every_other() -> None:
    done = subprocess.run([sys.executable, str(SCRIPT)], capture_output=True, text=True)
    assert done.returncode == 0, (
        f"bits have changed; on purpose: .ci/wheel.py --write\n{done.stdout}"
    )


def test_no_two_digests_are_alike() -> None:
    """A gain that never switches, or a level that is never reached, would show nothing."""
    lines = SCRIPT.with_suffix(".txt").read_text(encoding="utf-8").splitlines()
    digests = [line.split()[0] for line in lines]
    assert len(digests) == len(set(digests)) > 100


def test_a_wheel_is_tried_by_what_can_run_it(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = importlib.util.spec_from_file_location("wheels", SCRIPT.with_name("wheels.py"))
    assert spec is not None and spec.loader is not None
    wheels = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(wheels)
    monkeypatch.setattr(wheels.sys, "platform", "linux")
    monkeypatch.setattr(wheels.platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(wheels.os, "name", "posix")
    ways = {
        "manylinux2014_x86_64.manylinux_2_17_x86_64": wheels.here,
        "manylinux2014_aarch64.manylinux_2_17_aarch64": wheels.under_qemu,
        "musllinux_1_2_x86_64": wheels.on_musl,
        "musllinux_1_2_aarch64": None,
        "win_amd64": wheels.under_wine,
        "macosx_11_0_arm64": None,
    }
    for tag, way in ways.items():
        assert wheels.way(Path(f"hgo_rs-0.1.0-cp310-abi3-{tag}.whl")) is way
    workflow = (SCRIPT.parents[1] / ".github/workflows/release.yml").read_text(encoding="utf-8")
    assert "python .ci/wheels.py build" in workflow
    built = {target.split("-")[0] for target in wheels.TARGETS}
    assert re.search(r"arch: \[(.*)\]", workflow)[1].split(", ") == sorted(built, reverse=True)
