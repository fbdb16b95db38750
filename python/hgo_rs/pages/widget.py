"""The page of a tuning in a notebook, whose observer goes back to Python."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from hgo_rs.config import Config
from hgo_rs.errors import need
from hgo_rs.observers import Observer
from hgo_rs.pages.tuning import told_page
from hgo_rs.tuning import Tuning

SCRIPT = Path(__file__).with_name("widget.js")


@cache
def _kind() -> Any:
    anywidget: Any = need("anywidget", "the page in a notebook needs anywidget", "notebook")
    import traitlets

    class TuningPage(anywidget.AnyWidget):
        """A page to tune in; `observer` is what its sliders stand at."""

        _esm = SCRIPT
        page = traitlets.Unicode().tag(sync=True)
        toml = traitlets.Unicode().tag(sync=True)

        @property
        def observer(self) -> Observer:
            return Config.from_toml(self.toml, "the page").observer()

    return TuningPage


def widget(tuning: Tuning, title: str, log: Mapping[str, Any]) -> Any:
    """`Tuning.widget`."""
    kind = _kind()
    text = told_page(tuning, title, log)
    return kind(page=text, toml=Config.of(tuning.observer, **log).to_toml())
