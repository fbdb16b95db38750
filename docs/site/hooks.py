"""What the documentation's site has beside the pages of docs/: KaTeX, the API, live pages, figures,
notebooks.

KaTeX is copied from Debian's libjs-katex and fonts-katex, or from the folder of a release of KaTeX
that the environment variable KATEX names.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import notebooks
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files

import hgo_rs
from hgo_rs.errors import HgoError
from hgo_rs.scenarios import PAPERS, load

OUT = Path(__file__).parents[2] / "out"
KATEX = Path("/usr/share/javascript/katex")
OUTSIDE = re.compile(r"\[([^\]]*)\]\(\.\./([^)]*)\)")
GROUPS = {
    "Observers": "observers",
    "Models and plants": "models",
    "Simulation": "simulation",
    "Studies": "simulation.studies",
    "Tuning": "tuning",
    "Whole records": "smoothing",
    "Files, logs, export": "config logs exports",
    "Errors": "errors",
}
"""Headings of the API page, and the modules of which it shows the public names."""


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """A link out of docs/ becomes the file's place among the sources; a page that has a notebook
    links to it behind its title.
    """
    name = Path(page.file.src_uri).stem
    if not page.file.src_uri.startswith("site/"):
        markdown = OUTSIDE.sub(r"\1 (`\2` of the sources)", markdown)
    if page.file.src_uri == f"{name}.md" and notebooks.has_code(markdown):
        title, _, rest = markdown.partition("\n")
        link = f"[This page as a notebook](site/notebooks/{name}.ipynb){{ download }}"
        markdown = f"{title}\n\n{link}\n{rest}"
    return markdown


def on_files(files: Files, config: Any) -> Files:
    """Adds what is made, and what is copied."""
    for path, text in (("site/api.md", _api()), ("site/gallery.md", _gallery())):
        files.append(File.generated(config, path, content=text))
    live, text = _showcase()
    files.append(File.generated(config, "site/showcase.md", content=text))
    if live:
        files.append(File.generated(config, "site/live.html", content=live))
    for name in notebooks.pages():
        made = notebooks.notebook(name)
        files.append(File.generated(config, f"site/notebooks/{name}.ipynb", content=made))
    for name, place in (*_katex(), *_figures()):
        files.append(File.generated(config, name, abs_src_path=str(place)))
    return files


def _katex() -> Iterator[tuple[str, Path]]:
    folder = Path(os.environ.get("KATEX", KATEX))
    names = ["katex.min.css", "katex.min.js"]
    fonts = sorted((folder / "fonts").glob("*.woff2"))
    if not fonts or not all((folder / name).is_file() for name in names):
        raise PluginError(
            f"no KaTeX in {folder}: install libjs-katex and fonts-katex (Debian), or let "
            "KATEX name the folder of a release, with katex.min.css, katex.min.js and fonts in it"
        )
    for name in (*names, *(f"fonts/{font.name}" for font in fonts)):
        yield f"site/katex/{name}", folder / name


def _api() -> str:
    """Every public name, by what it is for."""
    lines = ["# Reference of the Python package\n"]
    left = set(hgo_rs.__all__) - {"__version__"}
    for heading, modules in GROUPS.items():
        names: list[str] = []
        for module in modules.split():
            public = import_module(f"hgo_rs.{module}").__all__
            names += sorted(left & set(public))
            left -= set(public)
        lines += [f"## {heading}\n", *(f"::: hgo_rs.{name}\n" for name in names)]
    if left:
        raise PluginError(
            f"public names without a heading in {__file__}: {', '.join(sorted(left))}"
        )
    return "\n".join(lines)


def _showcase() -> tuple[str, str]:
    """The live page, and the page that holds it."""
    wide = "---\nhide: [navigation, toc]\n---\n\n"  # the page has controls beside its plots
    head = f"{wide}# Live: the papers' observers on the papers' systems\n\n"
    from hgo_rs.pages.showcase import showcase

    try:
        page = showcase()
    except HgoError as error:
        return "", f"{head}This build of the pages has none: {error}\n"
    text = "Move the gain, change structure and method: the same core runs in the browser."
    style = "width: 100%; height: 92vh; border: 0"
    frame = f'<iframe src="live.html" title="Observers, live" style="{style}"></iframe>'
    return page, f"{head}{text} [In a window of its own](live.html).\n\n{frame}\n"


def _figures() -> list[tuple[str, Path]]:
    """Figures that `make reproduce` wrote."""
    names = [f"{scenario.id}.png" for scenario in load().values()]
    return [(f"site/figures/{n}", OUT / n) for n in names if (OUT / n).is_file()]


def _gallery() -> str:
    """The scenarios' figures, paper by paper."""
    lines = ["# Gallery\n", "The figures of the [scenarios](../scenarios.md).\n"]
    made = {place.stem for _, place in _figures()}
    if not made:
        told = "`make reproduce` draws them, and `make site` runs it first"
        lines.append(f"This build of the pages has no figures: {told}.\n")
    for paper in PAPERS.values():
        drawn = [one for one in load().values() if one.paper == paper.id and one.id in made]
        lines += [f"## {paper.authors}\n\n{paper.title}\n"] if drawn else []
        for one in drawn:
            lines.append(f"### {one.title[0].upper()}{one.title[1:]}\n\n`hgo run {one.id}`\n")
            lines.append(f"![{one.title}](figures/{one.id}.png){{ loading=lazy }}\n")
    return "\n".join(lines)
