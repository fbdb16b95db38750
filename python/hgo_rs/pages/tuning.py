"""A page to tune in: the observers of a tuning over their log, redrawn as a slider moves."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.config import Config
from hgo_rs.errors import HgoError, check
from hgo_rs.files import replacing
from hgo_rs.observers import Observer
from hgo_rs.pages.live import ways
from hgo_rs.pages.module import assembled, digest, packed, require_module
from hgo_rs.tuning import Tuning, TuningWarning
from hgo_rs.tuning.record import longest

Array = npt.NDArray[np.float64]

MOST = 50_000
"""Samples of a page; a longer log is decimated."""


@dataclass(frozen=True)
class Drawn:
    """The record that a page draws.

    ``period``: where it was given in place of times.  ``decimated``: what was left out, in words.
    """

    t: Array
    y: Array
    u: Array | None
    period: float | None
    decimated: str

    @classmethod
    def of(cls, log: Any, most: int = MOST) -> Drawn:
        """The longest piece of a log of one output; of one of more than `most` samples every k-th.

        Raises
        ------
        HgoError
            Several outputs.
        """
        clock, y, u, whole = longest(log)
        y = y[:, 0] if y.ndim == 2 and y.shape[1] == 1 else y
        remedy = "tune one output, with the others' estimates as inputs, and draw that"
        check(y.ndim == 1, "outputs of the log", y.shape[-1], "1, for a page", remedy)
        u = u[:, None] if u is not None and u.ndim == 1 else u
        t, period = clock, None
        if not clock.ndim:
            period = float(clock)
            t = period * np.arange(len(y), dtype=np.float64)
        said = []
        if len(y) < whole:
            said.append(f"the longest piece of the log: {len(y)} of its {whole} samples")
        k = math.ceil(len(y) / most)
        if k > 1:
            means = ", inputs as the means between them" if u is not None else ""
            said.append(
                f"decimated: one sample of every {k} of {len(y)}{means}; all figures are those of "
                "this longer step"
            )
            if u is not None:  # each is held until the next sample
                u = np.array([np.mean(u[i : i + k], axis=0) for i in range(0, len(u), k)])
            t, y, period = t[::k], y[::k], None if period is None else k * period
        return cls(t, y, u, period, "; ".join(said))

    @property
    def clock(self) -> Array | float:
        return self.t if self.period is None else self.period

    @property
    def usual(self) -> float:
        """The median step [s]."""
        return float(np.median(np.diff(self.t)))

    def run(self, observer: Observer) -> Array:
        """Estimates (N, n), as the page has them."""
        u = self.u if observer.n_u else None
        return observer.run(self.clock, self.y, u, start=observer._usual_start).x_hat


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
    there = np.flatnonzero(np.isfinite(drawn.y))
    first = drawn.y[there[:1]] if there.size else np.array([np.nan])
    structures, left = [], []
    for name, observer in tuning.built.items():
        try:
            structures.append(_structure(tuning, name, observer, drawn, first, saved))
        except HgoError as error:
            left.append(f"{name or 'the structure'}: {error}")
    remedy = "; ".join(left[:1])
    check(bool(structures), "build", list(tuning.built), "an observer that a page can run", remedy)
    data = {
        "title": title,
        "text": "",
        "log": {
            "samples": len(drawn.y),
            "period": drawn.period,
            "t": None if drawn.period is not None else packed(drawn.t),
            "y": packed(drawn.y),
            "u": None if drawn.u is None else packed(drawn.u),
            "inputs": 0 if drawn.u is None else drawn.u.shape[1],
            "dt": drawn.usual,
            "longest": float(np.max(np.diff(drawn.t))),
        },
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


def _structure(
    tuning: Tuning, name: str, observer: Observer, drawn: Drawn, first: Array, saved: Any
) -> dict[str, Any]:
    curve = tuning.curves[name]
    ell = float(observer.spec["gain"]["ell"])
    found = ways(observer, first, lambda other: saved(other).to_toml())
    states = list(getattr(observer.model, "states", ()))
    states += [f"x{i + 1}" for i in range(len(states), observer.n)]
    return {
        "name": name,
        "n": observer.n,
        "inputs": observer.n_u,
        "states": states,
        "units": observer.units.tolist(),
        "ell": ell,
        "range": [float(curve.ell[0]), float(curve.ell[-1])],
        "digest": digest(drawn.run(observer)),
        "curve": {
            "ell": packed(curve.ell),
            "innovation": packed(curve.innovation),
            "measured": packed(curve.measured),
        },
        "ways": found,
    }


def _smoothed(tuning: Tuning) -> dict[str, Any] | None:
    """The smoothed states that the gain was judged by."""
    if tuning.smoothed is None:
        return None
    t, x = tuning.smoothed
    name = "smoothed state, which samples on both sides tell"
    return {"name": name, "t": packed(t), "x": packed(x), "n": x.shape[1]}
