"""Figures, in one style. Needs matplotlib (the extra `plot`)."""

from __future__ import annotations

from hgo_rs.plots.figures import (
    error_figure,
    estimate_figure,
    note_peak,
    shade_gaps,
    structures_figure,
    sweep_figure,
    tuning_figure,
)
from hgo_rs.plots.style import COLOURS, new_figure, render, require_matplotlib, save, style

__all__ = [
    "COLOURS",
    "error_figure",
    "estimate_figure",
    "new_figure",
    "note_peak",
    "render",
    "require_matplotlib",
    "save",
    "shade_gaps",
    "structures_figure",
    "style",
    "sweep_figure",
    "tuning_figure",
]
