"""A figure that shows itself: in a notebook once, in a script by `show`. Needs matplotlib."""

from __future__ import annotations

import io
import warnings
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from hgo_rs.markup import in_notebook

_FILES = ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template")
"""Backends of matplotlib that draw to files."""


class Picture(Figure):
    """A matplotlib figure that pyplot need not know of.

    At the end of a notebook's cell it is shown, once, whether pyplot is in use or not. `show` shows
    it elsewhere: in the midst of a cell, and in a window from a script.
    """

    def _repr_png_(self) -> bytes:
        """The picture, for notebooks in which nothing else draws figures."""
        image = io.BytesIO()
        canvas = self.canvas
        try:
            FigureCanvasAgg(self).print_png(image)
        finally:
            self.set_canvas(canvas)
        return image.getvalue()

    def show(self, warn: bool = True) -> None:
        """Show it: in a notebook here, from a script in a window, until that is closed.

        Warns
        -----
        UserWarning
            Matplotlib's backend draws to files and opens no window.
        """
        if in_notebook():
            from IPython.display import display

            display(self)
            return
        import matplotlib
        from matplotlib import pyplot
        from matplotlib._pylab_helpers import Gcf

        if self.canvas.manager is None:
            taken: Any = self
            number = max(pyplot.get_fignums(), default=0) + 1
            manager = pyplot.new_figure_manager(number, FigureClass=lambda *_, **__: taken)
            Gcf._set_new_active_manager(manager)
        backend = matplotlib.get_backend().casefold()
        if backend not in _FILES:
            pyplot.show()
        elif warn:
            remedy = 'save it by savefig("picture.png"), or choose another backend'
            warnings.warn(f"matplotlib's {backend} opens no window; {remedy}", stacklevel=2)
