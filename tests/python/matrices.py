"""Matrices of cases, laws times methods times timings, and parts of them.

HGO_TESTS_PART=6 leaves a sixth of each matrix, always the same one: what `.ci/run` has time for.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterable
from typing import TypeVar

PART = int(os.environ.get("HGO_TESTS_PART", "1"))

Case = TypeVar("Case")


def some(cases: Iterable[Case], matrix: str) -> list[Case]:
    """The cases that run, spread over a matrix by their names: all of them, or one in `PART`."""
    return [case for case in cases if zlib.crc32(f"{matrix} {case}".encode()) % PART == 0]
