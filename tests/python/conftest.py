"""What the tests share."""

from __future__ import annotations

import pytest

from hgo_rs.scenarios import Context


@pytest.fixture(scope="session")
def ctx() -> Context:
    """One context on the compiled core for the whole session: equal experiments run once."""
    return Context("rust", seed=1)
