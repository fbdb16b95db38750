"""Five papers and a textbook as experiments: one file a source, every table and figure a scenario.

`load()` imports the papers' files and returns their scenarios by id; `find(id)` returns one.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.util

from hgo_rs.errors import HgoError
from hgo_rs.scenarios.base import PAPERS, REGISTRY, Context, Outcome, Paper, Row, Scenario, row
from hgo_rs.scenarios.base import scenario as scenario

__all__ = [
    "PAPERS",
    "Context",
    "Outcome",
    "Paper",
    "Row",
    "Scenario",
    "UnknownScenarioError",
    "find",
    "load",
    "row",
    "scenario",
]


class UnknownScenarioError(HgoError):
    """No scenario has this id."""


def load() -> dict[str, Scenario]:
    """Every scenario by id, in the papers' order and then in the order of definition."""
    for paper in PAPERS:
        module = f"{__name__}.{paper.replace('-', '_')}"
        # A paper without a file is skipped; an error inside a file is not.
        if importlib.util.find_spec(module) is not None:
            importlib.import_module(module)
    order = list(PAPERS)
    ids = sorted(REGISTRY, key=lambda id: order.index(REGISTRY[id].paper))
    return {id: REGISTRY[id] for id in ids}


def find(id: str) -> Scenario:
    """The scenario of this id.

    Raises
    ------
    UnknownScenarioError
        Names the nearest known ids.
    """
    known = load()
    if id not in known:
        near = difflib.get_close_matches(id, known, n=4, cutoff=0.5)
        near = near or [name for name in known if name.startswith(id.split("-")[0])][:4]
        hint = f"nearest: {', '.join(near)}; " if near else ""
        raise UnknownScenarioError(f"unknown scenario {id!r}; {hint}see `hgo list`")
    return known[id]
