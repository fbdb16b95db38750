"""A tuning in words."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hgo_rs.markup import number, table
from hgo_rs.observers.labels import Labels

_SHOWN = 12  # structures


def report(of: Any) -> str:
    """The report: structures tried, estimates of noise and model error, and the reasons for the
    choice.

    ``of``: a `Tuning`.
    """
    rows = [f"{choice(of)}.", ""]
    names = _labels(of).names(of.observer.n)
    wanted = _wanted(of)
    rows.append("Predicted error of each estimate (RMS), and its bound:")
    for i, (error, bound) in enumerate(zip(of.errors, of.bounds, strict=True)):
        mark = "  <- wanted" if i in wanted else ""
        rows.append(f"  {names[i]:12s} {error:.4g}  (at most {bound:.4g}){mark}")
    rows += ["", *_found(of)]
    if len(of.tried) > 1:
        rows += [
            "",
            f"Structures, each at the best gain of a grid, by {_decided(of)} of {_estimates(of)}:",
        ]
        width = max(len(name) for name, _, _ in of.tried[:_SHOWN])
        rows += [
            f"  {name:{width}s}  gain {_shown(ell):>8s} /s  {cost:.4g}"
            for name, ell, cost in of.tried[:_SHOWN]
        ]
        if len(of.tried) > _SHOWN:
            rows.append(f"  and {len(of.tried) - _SHOWN} more")
    if of.warnings:
        rows += ["", "Open:", *(f"  {text}" for text in of.warnings)]
    left = [text for text in of.remarks if text not in of.warnings]
    if left:
        rows += ["", "Left out:", *(f"  {text}" for text in left)]
    return "\n".join(rows)


def as_html(of: Any) -> str:
    """The choice, the predicted errors, and the structures that were tried."""
    wanted, names = _wanted(of), _labels(of).names(of.observer.n)
    errors = [
        (name, number(error), number(bound), "wanted" if i in wanted else "")
        for i, (name, error, bound) in enumerate(
            zip(names, of.errors.tolist(), of.bounds.tolist(), strict=False)
        )
    ]
    tried = [(name, _shown(ell), number(cost)) for name, ell, cost in of.tried]
    parts = [table(choice(of), errors, ["estimate", "error (RMS)", "at most", ""])]
    if len(tried) > 1:
        parts.append(table("Structures", tried, ["structure", "gain [1/s]", _decided(of)]))
    if of.warnings:
        parts.append(table("Open", [(text,) for text in of.warnings]))
    return "".join(parts)


def _labels(of: Any) -> Labels:
    return Labels.of(of.observer.spec, of.observer.n)


def _shown(value: Any) -> str:
    """A number, or one for each output."""
    values = np.atleast_1d(value)
    return ", ".join(f"{one:.4g}" for one in values.tolist())


def _wanted(of: Any) -> set[int]:
    """Rows of the wanted estimates."""
    orders = getattr(of.observer.model, "orders", ())
    begins = np.cumsum([0, *orders[:-1]]) if np.ndim(of.state) else 0
    return set(np.atleast_1d(begins + np.asarray(of.state) - 1).tolist())


def _estimates(of: Any) -> str:
    if np.ndim(of.state):
        return f"estimates {_shown(of.state)} of the chains (geometric mean)"
    return f"estimate {of.state}"


def choice(of: Any) -> str:
    """Structure, gain and why, on one line."""
    name = f"{of.structure}, " if of.structure else ""
    return f"{name}gain {_shown(of.ell)} /s: {of.criterion} of {_estimates(of)}"


def _decided(of: Any) -> str:
    if of.criterion != "least error":
        return "noise at the target"
    return "predicted error" if of.judged_by or of.whiteness != of.whiteness else "innovation"


def _found(of: Any) -> list[str]:
    rows = []
    if of.judged_by:
        rows.append(
            "At this gain the estimate is closest to the smoothed state. The smoother "
            f"({of.judged_by}) uses samples within some {_shown(of.horizon)} s before and after."
        )
    elif of.criterion == "least error":
        rows.append(
            "The gain minimises the variance by noise and model error, R n(gain) + Q m(gain)."
        )
    if of.moving_gain:
        rows.append(of.moving_gain)
    if np.isfinite(of.noise).all():
        rows.append(f"Measurement noise, standard deviation: {_shown(of.noise)}.")
    if np.isfinite(of.model_error).all():
        rows.append(f"Model error, root of its spectral density: {_shown(of.model_error)}.")
    if np.any(of.quantisation):
        size = _shown(np.asarray(of.quantisation) / math.sqrt(12.0))
        rows.append(
            f"y moves in steps of {_shown(of.quantisation)}: rounding with a standard deviation of "
            f"{size}."
        )
    if math.isfinite(of.whiteness):
        white = "white" if of.whiteness >= 1e-3 else "not white"
        rows.append(
            f"Beyond what R and Q explain, the innovation is {white} (p = {of.whiteness:.2g})."
        )
    return rows
