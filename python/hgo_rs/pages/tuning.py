"""A page to tune in: the observers of a tuning over their log, redrawn as a slider moves."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs.config import Config
from hgo_rs.errors import HgoError, check
from hgo_rs.files import replacing
from hgo_rs.observers import Observer
from hgo_rs.pages.drawn import MOST, Drawn
from hgo_rs.pages.live import structure
from hgo_rs.pages.module import assembled, packed, require_module
from hgo_rs.tuning import Tuning, TuningWarning


def page(
    tuning: Tuning,
    title: str = "",
    saved: Callable[[Observer], Config] = Config.of,
    most: int = MOST,
) -> tuple[str, str]:
    """A page of a tuning, as text, and what of the log it leaves out, in words.

    Parameters
    ----------
    tuning : Tuning
        On a log of one output.
    title : str
        What the log is called.
    saved : callable
        observer -> its `Config`, for the page's `observer.toml`.
    most : int
        Samples of a page: of a longer log every k-th is drawn.

    Raises
    ------
    HgoError
        No WebAssembly module in this installation; no log; several outputs; no structure that a
        page can run.
    """
    require_module()
    remedy = "tune one output, with the others' estimates as inputs, and draw that"
    check(not np.ndim(tuning.ell), "outputs", np.size(tuning.ell), "1, for a page", remedy)
    remedy = "tune on a log: tune(model, (t, y))"
    check(tuning.log is not None, "log of the tuning", None, "given, for a page", remedy)
    drawn = Drawn.of(tuning.log, most)
    structures, left = [], []
    for name, observer in tuning.built.items():
        try:
            curve = tuning.curves[name]
            span = float(curve.ell[0]), float(curve.ell[-1])
            columns = (curve.ell, curve.innovation, curve.measured)
            made = structure(name, observer, drawn, span, saved, observer._usual_start, columns)
            structures.append(made)
        except HgoError as error:
            left.append(f"{name or 'the structure'}: {error}")
    remedy = "; ".join(left[:1])
    check(bool(structures), "build", list(tuning.built), "an observer that a page can run", remedy)
    data = {
        "title": title,
        "text": "",
        "log": drawn.data,
        "decimated": drawn.decimated,
        "left": left,
        "structures": structures,
        "chosen": tuning.structure,
        "state": tuning.state,
        "criterion": tuning.criterion,
        "noise": _finite(tuning.noise),
        "model_error": _finite(tuning.model_error),
        "judged_by": tuning.judged_by,
        "horizon": _finite(tuning.horizon),
        "warnings": list(tuning.warnings),
        "truth": False,
        "reference": _smoothed(tuning),
    }
    return assembled(title or "Tuning", [data]), drawn.decimated


def write(tuning: Tuning, path: str | Path, title: str, log: Mapping[str, Any]) -> None:
    """`Tuning.page`."""
    text, decimated = page(tuning, title, lambda observer: Config.of(observer, **log))
    with replacing(path) as file:
        file.write(text.encode())
    if decimated:
        warnings.warn(f"the page: {decimated}", TuningWarning, stacklevel=4)


def _finite(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def _smoothed(tuning: Tuning) -> dict[str, Any] | None:
    """The smoothed states that the gain was judged by."""
    if tuning.smoothed is None:
        return None
    t, x = tuning.smoothed
    name = "smoothed state, which samples on both sides tell"
    return {"name": name, "t": packed(t), "x": packed(x), "n": x.shape[1]}
