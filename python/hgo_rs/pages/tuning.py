"""A page to tune in: the observers of a tuning over their log, redrawn as a slider moves."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs.config import Config
from hgo_rs.errors import HgoError, check
from hgo_rs.files import replacing
from hgo_rs.observers import Observer
from hgo_rs.pages.drawn import MOST, Drawn, check_outputs
from hgo_rs.pages.live import Reference, structure, system
from hgo_rs.pages.module import assembled, require_module
from hgo_rs.tuning import Tuning, TuningWarning


def page(
    tuning: Tuning,
    title: str = "",
    saved: Callable[[Observer], Config] = Config.of,
    most: int = MOST,
) -> tuple[str, str]:
    """A page of a tuning, as text, and what of log and choice it leaves out, in words.

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
    check_outputs(np.size(tuning.ell))
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
    chosen, other = _first(tuning, [made["name"] for made in structures])
    said = [text for text in (drawn.decimated, other) if text]
    data = system(
        title,
        drawn,
        structures,
        chosen,
        tuning.state,
        tuning.noise,
        tuning.model_error,
        _smoothed(tuning),
        text=other,
        left=left,
        criterion=tuning.criterion,
        judged_by=tuning.judged_by,
        horizon=tuning.horizon,
        warnings=tuning.warnings,
    )
    return assembled(title or "Tuning", [data]), "; ".join(said)


def _first(tuning: Tuning, drawn: Sequence[str]) -> tuple[str, str]:
    """The structure that a page begins with, and what to say of it: the chosen one, or the best of
    those that can be drawn.
    """
    if tuning.structure in drawn:
        return tuning.structure, ""
    ranked = [name for name, _, _ in tuning.tried if name in drawn]
    first = next(iter(ranked), drawn[0])
    return first, f"it cannot draw the chosen structure, {tuning.structure}; it begins with {first}"


def write(tuning: Tuning, path: str | Path, title: str, log: Mapping[str, Any]) -> None:
    """`Tuning.page`."""
    text = told_page(tuning, title, log)
    with replacing(path) as file:
        file.write(text.encode())


def told_page(tuning: Tuning, title: str, log: Mapping[str, Any]) -> str:
    """The page, as text; what it leaves out is a warning."""
    text, said = page(tuning, title, lambda observer: Config.of(observer, **log))
    if said:
        warnings.warn(f"the page: {said}", TuningWarning, stacklevel=6)
    return text


def _smoothed(tuning: Tuning) -> Reference | None:
    """The smoothed states that the gain was judged by."""
    if tuning.smoothed is None:
        return None
    return Reference("smoothed state, from earlier and later samples", *tuning.smoothed)
