"""What the bench found: ratios to the standard law, which law wins where, tables, figure, data."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hgo_rs.bench.entrants import STANDARD
from hgo_rs.bench.measure import M4F, SETTLING, Cell, left_out
from hgo_rs.bench.systems import CONDITIONS, COUNT, DT
from hgo_rs.plots import COLOURS, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES: Mapping[str, str] = {
    "peak": "largest error after a step of y",
    "noise": "error due to white noise",
    **CONDITIONS,
    "cost": "operations of a step",
}
"""What a law is measured by, by name."""
_TIE = 1.03  # ratios to the best up to which laws are named together
_MOST = 3  # laws that are named
_SHOWN = 1e3  # a ratio from here on is a loss of the state
_COLUMNS = ("system", "group", "entrant", "kind", "n", "speed", "settling", "peak", "noise")


@dataclass(frozen=True, eq=False)
class Report:
    """``cells``: an entrant on a system each."""

    cells: Sequence[Cell]

    @property
    def entrants(self) -> list[str]:
        """Those that were measured anywhere, in order."""
        return list(dict.fromkeys(cell.entrant for cell in self.cells if cell.errors))

    @property
    def groups(self) -> list[str]:
        """Systems that are looked at together."""
        return list(dict.fromkeys(cell.group for cell in self.cells))

    def value(self, cell: Cell, figure: str) -> float:
        """A figure of a cell."""
        plain = {"peak": cell.peak, "noise": cell.noise, "cost": float(cell.operations)}
        return plain[figure] if figure in plain else cell.error(figure)

    def ratio(self, entrant: str, figure: str, groups: Iterable[str] | None = None) -> float:
        """Geometric mean, over the systems of some groups, of a figure over the standard law's.

        NaN where it was measured on none of them; infinite where the state was lost on one.
        """
        wanted = set(self.groups if groups is None else groups)
        standard = {cell.system: cell for cell in self.cells if cell.entrant == STANDARD}
        found = [
            self.value(cell, figure) / self.value(standard[cell.system], figure)
            for cell in self.cells
            if cell.entrant == entrant and cell.group in wanted and cell.errors
        ]
        known = [one for one in found if one == one]
        return float(np.exp(np.mean(np.log(known)))) if known else math.nan

    def winners(self, figure: str, groups: Sequence[str]) -> list[tuple[str, float]]:
        """The laws of the least figure in some groups, those within 3 % of the best, and ratios.

        Only laws that were measured on every system there take part.
        """
        wanted, ratios = set(groups), {}
        for name in self.entrants:
            mine = [c for c in self.cells if c.entrant == name and c.group in wanted]
            whole = all(self.value(c, figure) == self.value(c, figure) for c in mine)
            ratio = self.ratio(name, figure, groups)
            if whole and math.isfinite(ratio):
                ratios[name] = ratio
        order = sorted(ratios, key=lambda name: ratios[name])
        near = [(name, ratios[name]) for name in order if ratios[name] <= _TIE * ratios[order[0]]]
        return near[:_MOST]

    def operations(self, entrant: str, n: int) -> int:
        """Of a step without a model; 0 where there is none."""
        return next(
            (
                cell.operations
                for cell in self.cells
                if cell.entrant == entrant and cell.n == n and cell.group == f"chain, n = {n}"
            ),
            0,
        )

    # --- text -----------------------------------------------------------------------------------

    def table(self) -> str:
        """Every law: ratios over all systems, and its cost, as Markdown."""
        head = ["law", "systems", *FIGURES, "operations, n = 2, 3, 4, 5", "M4F, n = 2, 5"]
        places = len({cell.system for cell in self.cells})
        rows = []
        for name in self.entrants:
            ratios = [_number(self.ratio(name, figure)) for figure in FIGURES]
            counts = [str(self.operations(name, n) or "–") for n in (2, 3, 4, 5)]
            counted = [str(M4F.get((name, n), "–")) for n in (2, 5)]
            taken = sum(cell.entrant == name and bool(cell.errors) for cell in self.cells)
            share = f"{taken} of {places}"
            rows.append([name, share, *ratios, " ".join(counts), " ".join(counted)])
        return markdown(head, rows)

    def winners_table(self, groups: Mapping[str, Sequence[str]] | None = None) -> str:
        """Which law wins where, as Markdown; a column for each of the named groups of systems."""
        columns = {group: [group] for group in self.groups} if groups is None else groups
        rows = []
        for figure in FIGURES:
            told = (self.winners(figure, some) for some in columns.values())
            cells = ["; ".join(f"{name} {_number(ratio)}" for name, ratio in best) for best in told]
            rows.append([figure, *cells])
        return markdown(["", *columns], rows)

    def short(self) -> str:
        """`winners_table` by order alone."""
        columns: dict[str, list[str]] = {}
        for cell in self.cells:
            name = f"n = {cell.n}" if cell.n < 4 else "n = 4, 5"
            found = columns.setdefault(name, [])
            if cell.group not in found:
                found.append(cell.group)
        return self.winners_table(columns)

    def __str__(self) -> str:
        lines = [
            "Errors of the last state over the standard law's, geometric mean of all systems",
            "",
        ]
        lines += [self.table(), "", "Which law wins where", "", self.winners_table(), ""]
        lines += [f"not compared: {name}: {why}" for name, why in left_out(self.cells).items()]
        return "\n".join(lines)

    def page(self, figure: str, data: str) -> str:
        """The page of the documentation; `figure` and `data` are names of files beside it."""
        away = markdown(["law", "why"], [[name, why] for name, why in left_out(self.cells).items()])
        parts = [[f"`{name}`", text] for name, text in FIGURES.items()]
        places = list(dict.fromkeys((cell.system, cell.group) for cell in self.cells))
        return _PAGE.format(
            figure=figure,
            data=data,
            settling=SETTLING,
            dt=DT,
            seconds=COUNT * DT,
            figures=markdown(["column", "meaning"], parts),
            systems=markdown(["system", "group"], [list(pair) for pair in places]),
            winners=self.winners_table(),
            table=self.table(),
            away=away,
        )

    # --- data -----------------------------------------------------------------------------------

    def to_csv(self) -> str:
        """A line a cell."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow([*_COLUMNS, *CONDITIONS, "operations", "refused"])
        for cell in self.cells:
            plain = [getattr(cell, name) for name in _COLUMNS]
            errors = [cell.error(condition) for condition in CONDITIONS]
            numbers = [f"{v:.6g}" if isinstance(v, float) else v for v in (*plain, *errors)]
            writer.writerow([*numbers, cell.operations, cell.refused])
        return out.getvalue()

    def to_json(self) -> str:
        """The cells as objects; what is not a number is null."""

        def plain(value: Any) -> Any:
            if isinstance(value, float):
                return value if math.isfinite(value) else None
            if isinstance(value, dict):
                return {key: plain(inner) for key, inner in value.items()}
            return value

        cells = [plain({**asdict(cell), "errors": dict(cell.errors)}) for cell in self.cells]
        told = {"settling": SETTLING, "dt": DT, "conditions": dict(CONDITIONS), "cells": cells}
        return json.dumps(told, indent=1) + "\n"

    @classmethod
    def of_csv(cls, text: str) -> Report:
        """From `to_csv`."""
        cells = []
        for line in csv.DictReader(io.StringIO(text)):
            numbers = {name: float(line[name]) for name in ("speed", "settling", "peak", "noise")}
            errors = [(name, float(line[name])) for name in CONDITIONS if line[name] != "nan"]
            words = {name: line[name] for name in ("system", "group", "entrant", "kind", "refused")}
            sizes = {"n": int(line["n"]), "operations": int(line["operations"])}
            cells.append(Cell(errors=tuple(errors), **words, **sizes, **numbers))  # type: ignore[arg-type]
        return cls(cells)

    def plot(self, figure: Figure | None = None) -> Figure:
        """Ratios to the standard law as a map, a panel a group: blue errs less, red more."""
        from matplotlib.colors import LinearSegmentedColormap

        names, kinds = self.entrants[::-1], list(FIGURES)
        size = (3.2 + 2.55 * len(self.groups), 1.6 + 0.27 * len(names))
        figure = new_figure(size) if figure is None else figure
        figure.set_size_inches(*size)
        panels = figure.subplots(1, len(self.groups), sharey=True, squeeze=False)[0]
        colours = LinearSegmentedColormap.from_list(
            "ratio", [COLOURS["blue"], "white", COLOURS["vermillion"]]
        )
        for ax, group in zip(panels, self.groups, strict=True):
            values = np.array([[self.ratio(a, b, [group]) for b in kinds] for a in names])
            with np.errstate(all="ignore"):
                shown = np.clip(np.log2(values), -2.0, 2.0)
            shown[np.isinf(values)] = 2.0
            ax.imshow(np.ma.masked_invalid(shown), cmap=colours, vmin=-2.0, vmax=2.0, aspect="auto")
            for row, line in enumerate(values):
                for column, value in enumerate(line):
                    dark = abs(shown[row, column]) > 1.4
                    ax.text(
                        column,
                        row,
                        _number(value) if value == value else "",
                        ha="center",
                        va="center",
                        fontsize=5.5,
                        color="white" if dark else COLOURS["black"],
                    )
            ax.set_title(group, fontsize=9)
            ax.set_xticks(range(len(kinds)), kinds, rotation=90, fontsize=7.5)
            ax.set_yticks(range(len(names)), names, fontsize=7.5)
            ax.grid(False)
        figure.suptitle("Errors of the last state over the standard law's, same settling time")
        return figure


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _number(value: float) -> str:
    """Two or three digits; – for none, "lost" for a state that was lost."""
    if value != value:
        return "–"
    if value >= _SHOWN:
        return "lost"
    return f"{value:.0f}" if value >= 9.95 else f"{value:.2f}"


_PAGE = """# Which observer when

`hgo compare-laws` · every law of this package on the same systems · written by that command

![Ratios of errors to the standard law's]({figure})

All laws estimate the last state from the same records of {seconds:g} s, sampled every {dt:g} s.
Each law has the least speed at which the response to a step of y settles in {settling:g} s: the
error of the last state is then within 2 % of its peak. The noise level is such that noise and bias
of the standard law are of equal size. Every number is an error divided by that of the
[standard observer](standard.md) with its default poles, as a geometric mean over systems: below 1
the error is smaller. "lost" is a ratio of a thousand or more.

{figures}

## Which law wins where

The laws with the least value, and those within 3 % of it.

{winners}

## Every law

{table}

"systems" is the number of systems on which the law could be tuned; means are over these.
Operations are those of one step with a fixed period, in single precision and without a model, from
the table of operations that exports use. M4F: instructions of a step, from `make firmware`: the
standard law by zoh, filters from sample to sample, others by Euler.

## Systems

For a chain the observers have no model: the last derivative is unknown. For a system they have a
model whose right-hand side is 20 % too large; filters that take no model have none.

{systems}

## Not compared

{away}

## Limits

- The last state is the hardest one. Other states differ less between laws.
- All laws have the same speed here. For a record [`tune`](tuning.md) finds the best speed, and
  [`compare`](comparing.md) compares observers on it.
- Thresholds of shapes, of switched and of adaptive gains are set from the noise in
  `hgo_rs.bench.entrants`. Other thresholds give other numbers. Data of each cell: [{data}]({data}).
- The speed of a homogeneous gain depends on the size of the error. The step here is 0.1, and the
  signals are of size 1.
"""
