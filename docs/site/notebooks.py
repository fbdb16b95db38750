"""Pages as notebooks: the same text, its Python blocks as cells to run."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

DOCS = Path(__file__).parents[1]
BLOCK = re.compile(r"^```(python|sh)\n(.*?)^```\n?", re.M | re.S)
LINK = re.compile(r"!?\[([^\]]*)\]\((?!https?:)[^)]*\)")


def has_code(text: str) -> bool:
    """Whether a page has Python blocks."""
    return "```python\n" in text


def pages() -> list[str]:
    """Pages that have some, by their names without `.md`."""
    found = sorted(DOCS.glob("*.md"))
    return [page.stem for page in found if has_code(page.read_text(encoding="utf-8"))]


def notebook(page: str) -> str:
    """A page as a notebook (nbformat 4.5), without results.

    Commands `hgo ...` of a shell's block are cells too; other blocks and all text stay as they are,
    but for pictures of the site and links into it, of which their words stay.
    """
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    cells: list[dict[str, Any]] = []

    def add(kind: str, source: str) -> None:
        if not source.strip():
            return
        name = f"{page}-{len(cells)}"
        lines = source.strip("\n").splitlines(keepends=True)
        cell = {"cell_type": kind, "id": name, "metadata": {}, "source": lines}
        cells.append(cell | ({"execution_count": None, "outputs": []} if kind == "code" else {}))

    end = 0
    for block in BLOCK.finditer(text):
        commands = block[2].strip().splitlines()
        if block[1] == "sh" and not all(line.startswith(("hgo ", "#")) for line in commands):
            continue
        add("markdown", LINK.sub(r"\1", text[end : block.start()]))
        source = block[2]
        if block[1] == "sh":
            source = "\n".join(f"!{line}" for line in commands if line.startswith("hgo "))
        add("code", source)
        end = block.end()
    add("markdown", LINK.sub(r"\1", text[end:]))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    whole = {
        "cells": cells,
        "metadata": {"kernelspec": kernel, "language_info": {"name": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(whole, ensure_ascii=False, indent=1) + "\n"
