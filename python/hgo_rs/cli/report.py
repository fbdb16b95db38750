"""The report: one HTML file that needs no other, no script and no network.

A summary, the rows that needed explaining, then a section a paper: each scenario's figure and its
rows (paper's value, ours, expected, tolerance, note). Misses are told by word and sign as well as
by colour; it reads on a telephone and on paper, by day and by night.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from hgo_rs.scenarios.base import PAPERS, Row, format_number

if TYPE_CHECKING:
    from hgo_rs.cli.record import Record

INLINE_SVG_LIMIT = 400_000
"""Bytes of SVG up to which a figure goes into the report as SVG; a heavier one goes in as PNG."""


_TITLE = "High-gain observers: five papers and a textbook, recomputed"


def format_value(value: Any) -> str:
    """A number to six significant digits, a string as it is, an en dash for nothing."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return format_number(value).replace("-", "−")
    return str(value)


def markdown(records: Iterable[Record]) -> str:
    """Every row with a value in the paper, as a Markdown table."""
    lines = ["| scenario | quantity | paper | here |", "|---|---|---|---|"]
    lines += [markdown_row(r.id, row) for r in records for row in r.rows if row.paper is not None]
    return "\n".join(lines) + "\n"


def markdown_row(id: str, row: Row) -> str:
    """One line of `markdown`."""
    quantity = row.quantity.replace("|", "\\|")
    return f"| {id} | {quantity} | {format_value(row.paper)} | {format_value(row.ours)} |"


def build(records: Sequence[Record], about: Mapping[str, Any]) -> str:
    """The report as HTML text; `about` is that of `reproduce.about_this_run`."""
    by_paper = {
        paper: [r for r in records if r.paper == paper]
        for paper in PAPERS
        if any(r.paper == paper for r in records)
    }
    body = [
        _head(records, about),
        _overview(by_paper),
        _misses(records),
        _explained(records),
        *(_paper(paper, group) for paper, group in by_paper.items()),
        _foot(about),
    ]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{_TITLE}</title>\n<style>{_CSS}</style>\n"
        "</head>\n<body>\n<main>\n" + "\n".join(part for part in body if part) + "\n</main>\n"
        "</body>\n</html>\n"
    )


# --- parts -----------------------------------------------------------------------------------


def _head(records: Sequence[Record], about: Mapping[str, Any]) -> str:
    rows = [r for record in records for r in record.rows]
    missed = sum(not r.ok for r in rows)
    failed = sum(bool(r.error) for r in records)
    left = about["planned"] - len(records)
    if missed or failed:
        verdict, sign = "bad", "✗"
        parts = []
        if missed:
            parts.append(f"{counted(missed, 'row')} of {len(rows)} outside tolerance")
        if failed:
            parts.append(f"{counted(failed, 'scenario')} failed")
        told = ", ".join(parts)
    elif left:
        verdict, sign, told = "part", "…", f"{len(rows)} rows so far, all within tolerance"
    else:
        verdict, sign, told = "good", "✓", f"all {len(rows)} rows within tolerance"
    if left:
        told += f"; {counted(left, 'scenario')} not run"
        told += " (interrupted)" if about["interrupted"] else ""
    backend = {"rust": "the compiled core", "numpy": "the NumPy reference"}[about["backend"]]
    return f"""<header>
<p class="kicker">hgo_rs {escape(str(about["version"]))}</p>
<h1>{_TITLE}</h1>
<p class="lead">Every table and figure, computed by {backend} with seed {about["seed"]} in
{_duration(about["elapsed_s"])}. Each row shows the paper's value, ours, and the value and tolerance
that a correct implementation meets. Where the paper and the equations disagree, the note says why.
</p>
<p class="verdict {verdict}"><span class="sign" aria-hidden="true">{sign}</span> {escape(told)}</p>
</header>"""


def _overview(by_paper: Mapping[str, Sequence[Record]]) -> str:
    lines = []
    for paper, records in by_paper.items():
        info = PAPERS[paper]
        rows = sum(len(r.rows) for r in records)
        lines.append(
            f'<tr><td data-label="Paper"><a href="#{paper}">{escape(info.title)}</a>'
            f'<span class="by">{escape(info.authors)}</span></td>'
            f'<td class="num" data-label="Scenarios">{len(records)}</td>'
            f'<td class="num" data-label="Rows">{rows}</td>'
            f'<td class="num" data-label="Time">'
            f"{_duration(sum(r.elapsed_s for r in records))}</td>"
            f'<td data-label="Result">{_badge(all(r.ok for r in records))}</td></tr>'
        )
    return _section(
        "Summary", "summary", _table(["Paper", "Scenarios#", "Rows#", "Time#", "Result"], lines)
    )


def _misses(records: Sequence[Record]) -> str:
    """What is out of tolerance, before anything else."""
    missed = [(r, record.id) for record in records for r in record.rows if not r.ok]
    body = _rows(missed) if missed else ""
    for record in records:
        if record.error:
            body += (
                f'<p><a href="#{record.id}"><code>{record.id}</code></a> failed: '
                f"{escape(_last_line(record.error))}</p>"
            )
    return _section("Out of tolerance", "missed", body) if body else ""


def _explained(records: Sequence[Record]) -> str:
    lines = [
        f'<tr><td data-label="Quantity"><a href="#{record.id}"><code>{record.id}</code></a> '
        f"{escape(r.quantity)}</td>"
        f'<td class="num" data-label="Paper">{_cell(r.paper)}</td>'
        f'<td class="num" data-label="Ours">{_cell(r.ours)}</td>'
        f'<td class="note" data-label="Why">{escape(r.note)}</td></tr>'
        for record in records
        for r in record.rows
        if r.note and r.paper is not None
    ]
    if not lines:
        return ""
    return _section(
        "Rows that needed explaining",
        "explained",
        f"<details><summary>{counted(len(lines), 'row')} where the paper's value needs a remark"
        f"</summary>{_table(['Quantity', 'Paper#', 'Ours#', 'Why'], lines)}</details>",
    )


def _paper(paper: str, records: Sequence[Record]) -> str:
    info = PAPERS[paper]
    where = f"<br>{escape(info.where)}" if info.where else ""
    links = " ".join(
        f'<a class="chip{"" if r.ok else " bad"}" href="#{r.id}">'
        f"{'' if r.ok else '✗ '}{escape(_short(r))}</a>"
        for r in records
    )
    body = f'<p class="by">{escape(info.authors)}{where}</p><nav class="chips">{links}</nav>'
    return _section(info.title, paper, body + "\n".join(_scenario(r) for r in records))


def _scenario(record: Record) -> str:
    figure = _figure(record)
    body = ""
    if record.rows:
        body = _rows([(r, "") for r in record.rows])
    if record.error:
        body += (
            '<details class="error" open><summary>The scenario failed: '
            f"{escape(_last_line(record.error))}</summary><pre>{escape(record.error)}</pre>"
            "</details>"
        )
    return f"""<article id="{record.id}">
<h3>{escape(record.title)} {_badge(record.ok)}</h3>
<p class="by"><code>hgo run {record.id}</code> · {_duration(record.elapsed_s)}{_speed(record)}</p>
{figure}
{body}
</article>"""


def _figure(record: Record) -> str:
    """The figure as a data URI: an image of its own, so that ids in two SVGs cannot meet."""
    svg, png = record.images.get("svg"), record.images.get("png")
    if svg is not None and (png is None or len(svg) <= INLINE_SVG_LIMIT):
        kind, image = "svg+xml", svg
    elif png is not None:
        kind, image = "png", png
    else:
        return ""
    data = base64.b64encode(image).decode()
    return (
        f'<figure><img alt="{escape(record.title)}" loading="lazy" '
        f'src="data:image/{kind};base64,{data}"></figure>'
    )


def _foot(about: Mapping[str, Any]) -> str:
    m = about["machine"]
    return (
        f"<footer><p>{escape(m['platform'])}, {m['cpus']} processors, Python {m['python']}, "
        f"NumPy {m['numpy']}. The same numbers, with full digits, are in results.json; "
        "figures as PNG and SVG lie beside it.</p></footer>"
    )


# --- pieces ----------------------------------------------------------------------------------


def _rows(rows: Sequence[tuple[Row, str]]) -> str:
    """The table of rows, each with the id of its scenario if that is not clear; notes if any."""
    with_notes = any(r.note for r, _ in rows)
    heads = ["Quantity", "Paper#", "Ours#", "Expected#", "Tolerance", "Result"]
    lines = []
    for r, scenario in rows:
        link = f'<a href="#{scenario}"><code>{scenario}</code></a> ' if scenario else ""
        note = f'<td class="note" data-label="Note">{escape(r.note)}</td>' if with_notes else ""
        lines.append(
            f"<tr{'' if r.ok else ' class=miss'}>"
            f'<td data-label="Quantity">{link}{escape(r.quantity)}</td>'
            f'<td class="num{_none(r.paper)}" data-label="Paper">{_cell(r.paper)}</td>'
            f'<td class="num ours" data-label="Ours">{_cell(r.ours)}</td>'
            f'<td class="num{_none(r.expected)}" data-label="Expected">{_cell(r.expected)}</td>'
            f'<td class="tol" data-label="Tolerance">{escape(r.tolerance)}</td>'
            f'<td data-label="Result">{_badge(r.ok)}</td>{note}</tr>'
        )
    return _table([*heads, *(["Note"] if with_notes else [])], lines)


def _table(heads: Sequence[str], lines: Sequence[str]) -> str:
    """Heads that end in # stand over numbers."""
    cells = "".join(
        f'<th scope="col" class="num">{h[:-1]}</th>' if h.endswith("#") else f"<th>{h}</th>"
        for h in heads
    )
    return (
        f'<div class="scroll"><table><thead><tr>{cells}</tr></thead>\n<tbody>'
        + "\n".join(lines)
        + "</tbody></table></div>"
    )


def _section(title: str, id: str, body: str) -> str:
    return f'<section id="{id}">\n<h2>{escape(title)}</h2>\n{body}\n</section>'


def _badge(ok: bool) -> str:
    if ok:
        return '<span class="badge good">✓&nbsp;ok</span>'
    return '<span class="badge bad">✗&nbsp;miss</span>'


def _cell(value: Any) -> str:
    return escape(format_value(value))


def _none(value: Any) -> str:
    """A class for cells that a narrow screen leaves out."""
    return " none" if value is None else ""


def _short(record: Record) -> str:
    """The id without its paper: fig1, table2, limits."""
    return record.id.removeprefix(f"{record.paper}-")


def _speed(record: Record) -> str:
    if not record.steps or not record.elapsed_s:
        return ""
    return f" · {record.steps / 1e6:.3g} million steps"


def _duration(seconds: float) -> str:
    if seconds < 0.01:
        return "under 10 ms"
    if seconds < 1.0:
        return f"{1e3 * seconds:.0f} ms"
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    return f"{seconds / 60.0:.1f} min"


def counted(number: int, noun: str) -> str:
    """1 row, 2 rows."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _last_line(error: str) -> str:
    lines = error.strip().splitlines()
    return lines[-1] if lines else ""


_CSS = """
:root {
  --page: #fbfbfa; --card: #ffffff; --ink: #1c1f23; --soft: #5b636d; --line: #e2e4e8;
  --head: #f3f4f6; --link: #0b5fa5; --good: #0b6e4f; --good-bg: #e3f4ec;
  --bad: #a8320a; --bad-bg: #fdeae1; --part: #7a5b00; --part-bg: #fbf1d3; --figure: #ffffff;
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #15181c; --card: #1c2025; --ink: #e8eaed; --soft: #a2abb5; --line: #32383f;
    --head: #23282e; --link: #7cc0ff; --good: #7fdcb5; --good-bg: #123a2c;
    --bad: #ffb190; --bad-bg: #4a2010; --part: #f2d27a; --part-bg: #3d3213; --figure: #ffffff;
  }
}
* { box-sizing: border-box; }
html { scroll-behavior: smooth; -webkit-text-size-adjust: 100%; }
body {
  margin: 0; background: var(--page); color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", sans-serif;
}
main { max-width: 68rem; margin: 0 auto; padding: 2.5rem 1.25rem 4rem; }
h1 { font-size: clamp(1.6rem, 4.5vw, 2.3rem); line-height: 1.15; margin: .2rem 0 .8rem;
  letter-spacing: -.015em; text-wrap: balance; }
h2 { font-size: 1.35rem; line-height: 1.25; margin: 0 0 .4rem; text-wrap: balance; }
h3 { font-size: 1.06rem; line-height: 1.35; margin: 0; }
p { margin: .4rem 0; }
a { color: var(--link); text-underline-offset: .15em; }
code { font: .88em ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace; }
.kicker { color: var(--soft); font-size: .85rem; margin: 0; }
.lead { max-width: 46rem; color: var(--soft); }
.by { display: block; color: var(--soft); font-size: .86rem; font-weight: 400; }
.verdict { display: inline-flex; gap: .55rem; align-items: baseline; margin: .7rem 0 0;
  padding: .5rem .9rem; border-radius: .5rem; font-weight: 600; }
.good { color: var(--good); background: var(--good-bg); }
.bad { color: var(--bad); background: var(--bad-bg); }
.part { color: var(--part); background: var(--part-bg); }
section { margin-top: 3rem; }
article { margin-top: 1.4rem; padding: 1.2rem; background: var(--card);
  border: 1px solid var(--line); border-radius: .7rem; }
article .by { margin-bottom: .8rem; }
figure { margin: .4rem 0 1rem; background: var(--figure); border-radius: .45rem; padding: .5rem;
  text-align: center; }
figure img { width: min(100%, 52rem); height: auto; }
.badge { display: inline-block; padding: .05em .5em; border-radius: 1em; font-size: .8rem;
  font-weight: 600; white-space: nowrap; vertical-align: .08em; }
.badge.bad { outline: 1px solid currentColor; }
.chips { display: flex; flex-wrap: wrap; gap: .4rem; margin: .6rem 0; }
.chip { font-size: .84rem; padding: .1rem .6rem; border: 1px solid var(--line);
  border-radius: 1rem; text-decoration: none; background: var(--card); }
.chip.bad { color: var(--bad); border-color: currentColor; background: var(--bad-bg); }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-size: .88rem;
  font-variant-numeric: tabular-nums; }
th { text-align: left; font-weight: 600; color: var(--soft); background: var(--head);
  padding: .4rem .6rem; white-space: nowrap; }
td { padding: .42rem .6rem; border-top: 1px solid var(--line); vertical-align: top; }
#summary table, #missed table, #explained table { background: var(--card); }
th.num, td.num { text-align: right; }
td.num { white-space: nowrap; }
td.ours { font-weight: 600; }
td.tol { color: var(--soft); white-space: nowrap; }
td.note { color: var(--soft); min-width: 14rem; max-width: 24rem; }
tr.miss td { background: var(--bad-bg); }
tr.miss td:first-child { box-shadow: inset 3px 0 var(--bad); }
details > summary { cursor: pointer; padding: .3rem 0; }
pre { overflow-x: auto; font-size: .8rem; padding: .8rem; background: var(--head);
  border-radius: .4rem; }
footer { margin-top: 3rem; padding-top: 1rem; border-top: 1px solid var(--line);
  color: var(--soft); font-size: .84rem; }
@media (max-width: 44rem) {
  main { padding: 1.5rem .9rem 3rem; }
  article { padding: .9rem; }
  thead { position: absolute; left: -9999px; }
  table, tbody, tr, td { display: block; width: 100%; }
  tr { border-top: 1px solid var(--line); padding: .6rem .1rem; }
  td, td.num { border: 0; padding: .1rem 0; text-align: left; white-space: normal;
    display: grid; grid-template-columns: 6.2rem 1fr; gap: .5rem; max-width: none; min-width: 0; }
  td::before { content: attr(data-label); color: var(--soft); font-weight: 400; }
  td:first-child { display: block; font-weight: 600; padding-bottom: .25rem; }
  td:first-child::before { content: none; }
  td > .badge { justify-self: start; }
  td.num.none, td:empty { display: none; }
  tr.miss { box-shadow: inset 3px 0 var(--bad); padding-left: .7rem; }
  tr.miss td, tr.miss td:first-child { background: none; box-shadow: none; }
}
@media print {
  body { background: #fff; font-size: 10pt; }
  main { max-width: none; padding: 0; }
  article { break-inside: avoid-page; border-color: #bbb; }
  details > *:not(summary) { display: block; }
}
"""
