"""The documentation as a site: built strictly, whole without a network, every formula readable."""

from __future__ import annotations

import html
import importlib
import os
import re
import subprocess
import sys
from pathlib import Path

import browser
import pytest

import hgo_rs

ROOT = Path(__file__).parents[2]
KATEX = Path(os.environ.get("KATEX", "/usr/share/javascript/katex"))
FORMULA = re.compile(r'<(span|div) class="arithmatex">(.*?)</\1>', re.S)
LINK = re.compile(r'(?:src|href)="([^"#?]+)[^"]*"')

pytest.importorskip("mkdocs", reason="the extra docs is not there")
pytestmark = pytest.mark.skipif(not KATEX.is_dir(), reason="no KaTeX: libjs-katex is not there")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    built = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", folder],
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    return folder


def pages(site: Path) -> dict[str, str]:
    return {
        str(path.relative_to(site)): path.read_text(encoding="utf-8")
        for path in sorted(site.rglob("*.html"))
        if path.name not in ("404.html", "live.html")
    }


def test_every_page_of_the_documentation_is_in_it(site: Path) -> None:
    names = {path.relative_to(ROOT / "docs") for path in (ROOT / "docs").rglob("*.md")}
    made = {str(name.with_suffix(".html")).replace("README", "index") for name in names}
    assert made <= pages(site).keys()
    listed = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("nav:")[1]
    assert all(str(name) in listed for name in names)


def test_every_public_name_is_in_the_reference(site: Path) -> None:
    text = pages(site)["site/api.html"]
    for name in set(hgo_rs.__all__) - {"__version__"}:
        assert f'id="hgo_rs.{name}"' in text, name


def test_nothing_that_a_page_takes_is_missing_or_of_another_host(site: Path) -> None:
    for name, text in pages(site).items():
        for link in LINK.findall(text):
            if link.startswith(("http:", "https:")):
                # a link to follow, not a part of the page
                assert f'src="{link}' not in text, (name, link)
                continue
            if not link.startswith(("data:", "mailto:", "javascript:")):
                assert ((site / name).parent / html.unescape(link)).exists(), (name, link)
        assert not re.search(r"<(?:script|link)[^>]*(?:src|href)=\"?https?:", text), name
    style = (site / "site/katex/katex.min.css").read_text(encoding="utf-8")
    for font in re.findall(r"url\(([^)]*\.woff2)\)", style):
        assert (site / "site/katex" / font).is_file(), font


def test_the_gallery_has_what_was_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "site"))
    hooks = importlib.import_module("hooks")
    monkeypatch.setattr(hooks, "OUT", tmp_path)
    assert "`make reproduce` draws them" in hooks._gallery() and "![" not in hooks._gallery()
    (tmp_path / "lee-fig1.png").touch()
    shown = hooks._gallery()
    assert "(figures/lee-fig1.png)" in shown and "## Joonho Lee" in shown and "fig2" not in shown


@pytest.mark.skipif(browser.PROGRAM is None, reason="no Chromium")
def test_katex_reads_every_formula_and_no_request_leaves(site: Path, tmp_path: Path) -> None:
    whole = pages(site)
    found = [match[0] for text in whole.values() for match in FORMULA.finditer(text)]
    assert len(found) > 700
    wrong = '<span class="arithmatex">\\(\\nothing{\\)</span>'
    every = site / "every.html"
    parts = ["katex/katex.min.js", "math.js"]
    scripts = "".join(f'<script src="site/{part}"></script>' for part in parts)
    every.write_text("<!doctype html><meta charset=utf-8>" + "\n".join([*found, wrong]) + scripts)
    with browser.Browser() as page:
        page.open(every)
        assert page.value("document.querySelectorAll('.katex').length") == len(found)
        assert page.value("document.querySelectorAll('.katex-error').length") == 1  # the wrong one
        shown = "[...document.images].every(one => one.loading === 'lazy' || one.naturalWidth > 0)"
        for name in whole:
            page.open(site / name)
            assert page.value("document.querySelectorAll('.katex-error').length") == 0, name
            assert page.value(shown), name
        assert page.requests == []
        assert [error for error in page.errors if "search" not in error] == []
