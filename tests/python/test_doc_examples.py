"""Every Python block of the README and of docs/ runs as it stands, and so do their commands."""

import contextlib
import re
import shlex
from pathlib import Path

import click
import notebook_pages
import pytest

from hgo_rs import cli, scenarios
from hgo_rs.cli.command import command
from hgo_rs.laws import LAWS
from hgo_rs.scenarios import base

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^```(?:python|py)\n(.*?)^```$", re.M | re.S)
EITHER = re.compile(r"^```(python|py|sh)\n(.*?)^```$", re.M | re.S)
COMMAND = re.compile(r"^hgo .*$|(?<=`)hgo [^`\n]*(?=`)", re.M)
RUN = {"configuration.md"}
"""Pages whose blocks make all that their commands take: these run where they stand."""
BLOCK_BY_BLOCK = [page for page in PAGES if page.stem not in notebook_pages.PAGES]


@pytest.mark.parametrize("page", BLOCK_BY_BLOCK, ids=lambda page: str(page.relative_to(ROOT)))
def test_python_blocks_run(page, tmp_path, monkeypatch):
    """The blocks of a page run one after the other, in a folder of their own."""
    monkeypatch.chdir(tmp_path)
    scenarios.load()
    monkeypatch.setattr(base, "REGISTRY", dict(base.REGISTRY))  # a page may register a scenario
    text = page.read_text(encoding="utf-8")
    namespace: dict = {"__name__": page.stem}
    for block in EITHER.finditer(text):
        # Blank lines in front, so that a traceback gives the page's own line.
        line = text.count("\n", 0, block.start(2))
        if block[1] != "sh":
            exec(compile("\n" * line + block[2], str(page), "exec"), namespace)
        elif page.name in RUN:
            for told in COMMAND.findall(block[2]):
                with pytest.raises(SystemExit) as end:
                    cli.main(shlex.split(told, comments=True)[1:])
                assert not end.value.code, told


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_are_understood(page):
    """Each `hgo ...` names a verb, its options and their choices, though files may be elsewhere."""
    for told in COMMAND.findall(page.read_text(encoding="utf-8")):
        if "..." in told or "…" in told:  # in part
            continue
        verb, *words = shlex.split(told, comments=True)[1:]
        if verb.startswith("-"):
            continue
        assert verb in command.commands, told
        # a page may speak of `hgo tune`, or of `hgo tune --page`, without what they take
        with contextlib.suppress(click.MissingParameter, click.BadOptionUsage):
            command.commands[verb].make_context(verb, words)


def test_every_law_has_a_page():
    """Of its name, or of its class, which the index names."""
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    of_other_name = {"modified": "collection"}
    for kind in LAWS:
        page = of_other_name.get(kind, kind)
        assert (ROOT / "docs" / f"{page}.md").is_file() and f"({page}.md)" in index, kind


def test_the_readme_has_an_example_in_both_languages():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert BLOCK.search(text)
    # cargo runs this one: lib.rs includes the README as documentation.
    assert re.search(r"^```rust\n", text, re.M)
    assert 'include_str!("../README.md")' in (ROOT / "src" / "lib.rs").read_text(encoding="utf-8")
