"""How objects show themselves in a notebook: tables in HTML, in the notebook's own style."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from html import escape
from typing import Any

MOST = 20
"""Rows of a table that are shown."""


def table(title: str, rows: Iterable[Sequence[object]], heads: Sequence[str] = ()) -> str:
    """A table under a title; the first entry of a row names it. Of more than `MOST` rows the first.

    Texts are escaped.
    """
    rows = list(rows)
    left = len(rows) - MOST
    body = "".join(f"<tr>{_cells(row)}</tr>" for row in rows[:MOST])
    if left > 0:
        body += f'<tr><td colspan="{max(map(len, rows))}">and {left} more</td></tr>'
    head = "".join(f"<th>{escape(name)}</th>" for name in heads)
    head = f"<thead><tr>{head}</tr></thead>" if heads else ""
    return f"<div><b>{escape(title)}</b><table>{head}<tbody>{body}</tbody></table></div>"


def number(value: Any) -> str:
    """A number to four digits; a dash for none."""
    return "–" if value is None or value != value else f"{value:.4g}"


def _cells(row: Sequence[object]) -> str:
    return "".join(f'<td style="text-align:left">{escape(str(cell))}</td>' for cell in row)


def in_notebook() -> bool:
    """Whether this runs under the kernel of a notebook."""
    ipython: Any = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return getattr(shell, "kernel", None) is not None
