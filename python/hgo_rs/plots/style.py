"""The style of every figure, and how figures are made and saved.

Needs matplotlib (the extra `plot`), which is imported inside the functions. Figures are drawn with
the object interface, so nothing here changes pyplot's state or needs a display.
"""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from hgo_rs.errors import need
from hgo_rs.files import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = {
    "black": "#1a1a1a",
    "blue": "#0072b2",
    "vermillion": "#d55e00",
    "green": "#009e73",
    "orange": "#e69f00",
    "sky": "#56b4e9",
    "purple": "#cc79a7",
    "grey": "#8c8c8c",
}
"""Okabe and Ito's palette, distinct for every kind of colour vision (yellow left out on white)."""

_WINDOWS = ("gtk", "macosx", "qt", "tk", "wx")
"""How the names of matplotlib's backends begin that open windows."""

STYLE: dict[str, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#4d4d4d",
    "axes.facecolor": "white",
    "axes.grid": True,
    "axes.labelsize": 10,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 10,
    "axes.titleweight": "bold",
    "axes.xmargin": 0.0,
    "figure.constrained_layout.use": True,
    "figure.dpi": 100,
    "figure.facecolor": "white",
    "figure.figsize": (7.2, 4.4),
    "figure.titlesize": 11,
    "figure.titleweight": "bold",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.5,
    "grid.alpha": 1.0,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.7,
    "legend.fontsize": 9,
    "legend.framealpha": 0.9,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.solid_capstyle": "round",
    "mathtext.fontset": "dejavusans",
    "path.simplify_threshold": 0.3,
    "savefig.dpi": 160,
    "savefig.facecolor": "white",
    "svg.fonttype": "path",
    "svg.hashsalt": "hgo_rs",
    "xtick.color": "#4d4d4d",
    "xtick.labelcolor": "#1a1a1a",
    "ytick.color": "#4d4d4d",
    "ytick.labelcolor": "#1a1a1a",
}


def require_matplotlib() -> None:
    """Raise `MissingExtraError`, with the remedy, if there is no matplotlib."""
    need("matplotlib", "figures need matplotlib", "plot")


@contextlib.contextmanager
def style() -> Iterator[None]:
    """The package's style, for as long as the context lasts."""
    require_matplotlib()
    import matplotlib
    from cycler import cycler

    cycle = [COLOURS[c] for c in ("blue", "vermillion", "green", "purple", "orange", "sky", "grey")]
    settings: Any = {**STYLE, "axes.prop_cycle": cycler(color=cycle)}
    with matplotlib.rc_context(settings):
        yield


def new_figure(size: tuple[float, float] | None = None) -> Figure:
    """An empty figure in the package's style, which shows itself in a notebook and by `show`.

    Where pyplot is in use and opens windows it is one of pyplot's, so that `pyplot.show` shows it.
    """
    with style():
        from hgo_rs.plots.picture import Picture

        pyplot = sys.modules.get("matplotlib.pyplot")
        if pyplot is not None and _opens_windows():
            figure: Figure = pyplot.figure(figsize=size, FigureClass=Picture)
            return figure
        return Picture(figsize=size)


def _opens_windows() -> bool:
    """Whether matplotlib's backend is one of windows."""
    import matplotlib

    return matplotlib.get_backend().casefold().startswith(_WINDOWS)


def render(draw: Callable[[Figure], None]) -> dict[str, bytes]:
    """Draw on a fresh figure; {"png": ..., "svg": ...}; equal input gives equal bytes."""
    with style():
        import matplotlib
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.backends.backend_svg import FigureCanvasSVG
        from matplotlib.figure import Figure

        figure = Figure(dpi=matplotlib.rcParams["savefig.dpi"])
        draw(figure)
        # by the canvases themselves: savefig draws each figure twice
        png, svg = io.BytesIO(), io.BytesIO()
        FigureCanvasAgg(figure).print_png(png, metadata={"Software": None})
        figure.set_layout_engine("none")  # the next one is laid out as the first
        FigureCanvasSVG(figure).print_svg(svg, metadata={"Date": None})
        return {"png": png.getvalue(), "svg": svg.getvalue()}


def save(figure: Figure, path: str | Path, into: IO[bytes] | None = None) -> None:
    """Write a figure in the package's style; the suffix of `path` says the format, also of what is
    written to the open file `into` in its place.
    """
    path = Path(path)
    place = replacing(path) if into is None else contextlib.nullcontext(into)
    with style(), place as file:
        figure.savefig(file, format=path.suffix[1:] or None)
