"""Bits of this build against the digests that every wheel is tested with."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / ".ci" / "wheel.py"


def test_this_build_has_the_digests_of_every_other() -> None:
    done = subprocess.run([sys.executable, str(SCRIPT)], capture_output=True, text=True)
    assert done.returncode == 0, (
        f"bits have changed; on purpose: .ci/wheel.py --write\n{done.stdout}"
    )
