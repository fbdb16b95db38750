"""The README states what the code gives."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from hgo_rs.cli.report import markdown_row
from hgo_rs.scenarios import Context, load

README = Path(__file__).parents[2] / "README.md"
SOURCES = "https://docs.rs/crate/hgo-rs/latest/source/"
"""Where the files of the released crate are read."""
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


def test_every_link_is_absolute_and_leads_to_a_file_of_the_crate() -> None:
    """The README is the front page of packages too, where no file stands beside it."""
    text = README.read_text(encoding="utf-8")
    text = re.sub(r"^```.*?^```|`[^`]*`", "", text, flags=re.MULTILINE | re.DOTALL)
    defined = dict(re.findall(r"^\[([^\]]+)\]: (\S+)$", text, re.MULTILINE))
    text = re.sub(r"^\[[^\]]+\]: \S+$", "", text, flags=re.MULTILINE)
    used = {label for _, label in re.findall(r"\[([^\]]+)\]\[([^\]]+)\]", text)}
    used |= set(re.findall(r"(?<!\])\[([^\]]+)\](?![\[(])", text))
    assert used == set(defined)
    targets = [*re.findall(r"\]\(([^)]*)\)", text), *defined.values()]
    assert len(targets) > 15
    assert all(target.startswith("https://") for target in targets)
    files = {t.removeprefix(SOURCES) for t in targets if t.startswith(SOURCES)}
    if not shutil.which("cargo"):
        pytest.skip("needs cargo")
    command = ["cargo", "package", "--list", "--allow-dirty", "--offline", "-p", "hgo-rs"]
    done = subprocess.run(command, cwd=README.parent, capture_output=True, text=True, check=True)
    assert files <= set(done.stdout.splitlines())
