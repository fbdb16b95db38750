"""What the tests share."""

from __future__ import annotations

import matrices
import pytest

from hgo_rs.scenarios import Context


def pytest_report_header() -> str:
    """What part of the matrices runs."""
    whole = matrices.PART == 1
    return "matrices of cases: " + ("whole" if whole else f"one case in {matrices.PART}")


@pytest.fixture(scope="session")
def ctx() -> Context:
    """One context on the compiled core for the whole session: equal experiments run once."""
    return Context("rust", seed=1)
