"""The README states what the code gives."""

from __future__ import annotations

from pathlib import Path

from hgo_rs.cli.report import markdown_row
from hgo_rs.scenarios import Context, load

README = Path(__file__).parents[2] / "README.md"
START, END = "<!-- results -->", "<!-- end of results -->"


def table() -> list[str]:
    """The table's lines, without its head."""
    text = README.read_text(encoding="utf-8")
    lines = text[text.index(START) + len(START) : text.index(END)].strip().splitlines()
    return lines[2:]


def test_every_line_of_the_table_is_what_the_scenario_gives(ctx: Context) -> None:
    lines = table()
    assert len(lines) >= 10
    scenarios = load()
    outcomes = {}
    for line in lines:
        id = line.split("|")[1].strip()
        if id not in outcomes:
            outcomes[id] = [markdown_row(id, row) for row in scenarios[id](ctx).rows]
        assert line in outcomes[id]
