"""What one scenario gave, ready for the report and for JSON."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from typing import Any

from hgo_rs.scenarios.base import Row


@dataclass(frozen=True)
class Record:
    """What one scenario gave.

    `elapsed_s` is the time of the computation, without drawing; `steps` counts the observer steps
    behind it (results shared with an earlier scenario count there); `error` is the traceback of a
    scenario that failed; `images` holds the figure as "png" and "svg".
    """

    id: str
    title: str
    paper: str
    backend: str
    seed: int
    rows: tuple[Row, ...] = ()
    elapsed_s: float = 0.0
    steps: int = 0
    error: str = ""
    images: dict[str, bytes] = field(default_factory=dict, repr=False)

    @property
    def missed(self) -> int:
        """Rows outside their tolerance."""
        return sum(not r.ok for r in self.rows)

    @property
    def ok(self) -> bool:
        """The scenario ran, and all of its rows (at least one) are within tolerance."""
        return not self.error and bool(self.rows) and not self.missed

    def to_dict(self) -> dict[str, Any]:
        """JSON-able; a number that JSON cannot write (nan, inf) becomes a string."""
        return {
            "id": self.id,
            "title": self.title,
            "paper": self.paper,
            "backend": self.backend,
            "seed": self.seed,
            "ok": self.ok,
            "rows": rows_to_json(self.rows),
            "elapsed_s": self.elapsed_s,
            "steps": self.steps,
            "figures": [f"{self.id}.{kind}" for kind in self.images],
            "error": self.error or None,
        }


def rows_to_json(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """Rows as JSON-able dicts."""

    def plain(value: Any) -> Any:
        if isinstance(value, float) and not math.isfinite(value):
            return str(value)
        return value

    return [{key: plain(value) for key, value in asdict(r).items()} for r in rows]
