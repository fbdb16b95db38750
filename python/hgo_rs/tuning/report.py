"""A tuning in words."""

from __future__ import annotations

import math
from typing import Any

_SHOWN = 12  # structures


def report(of: Any) -> str:
    """What was tried, what was found, and why this gain and structure were chosen.

    ``of``: a `Tuning`.
    """
    rows = [_choice(of), ""]
    names = getattr(of.observer.model, "states", ())
    rows.append("Predicted error of each estimate (RMS), and its bound:")
    for i, (error, bound) in enumerate(zip(of.errors, of.bounds, strict=True)):
        name = names[i] if i < len(names) else f"x{i + 1}"
        mark = "  <- wanted" if i + 1 == of.state else ""
        rows.append(f"  {name:12s} {error:.4g}  (at most {bound:.4g}){mark}")
    rows += ["", *_found(of)]
    if len(of.tried) > 1:
        rows += [
            "",
            f"Structures, each at its best gain, by {_decided(of)} of estimate {of.state}:",
        ]
        width = max(len(name) for name, _, _ in of.tried[:_SHOWN])
        rows += [
            f"  {name:{width}s}  gain {ell:8.4g} /s  {cost:.4g}"
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


def _choice(of: Any) -> str:
    name = f"{of.structure}, " if of.structure else ""
    return f"{name}gain {of.ell:.4g} /s: {of.criterion} of estimate {of.state}."


def _decided(of: Any) -> str:
    if of.criterion != "least error":
        return "noise at the target"
    return "predicted error" if of.judged_by or of.whiteness != of.whiteness else "innovation"


def _found(of: Any) -> list[str]:
    rows = []
    if of.judged_by:
        rows.append(
            "The gain is that of the least distance from the smoothed state, which samples on both "
            f"sides tell (by {of.judged_by}); samples speak some {of.horizon:.3g} s ahead."
        )
    elif of.criterion == "least error":
        rows.append("The gain is that of the least R n(gain) + Q m(gain), noise and model error.")
    if math.isfinite(of.noise):
        rows.append(f"Measurement noise, standard deviation: {of.noise:.4g}.")
    if math.isfinite(of.model_error):
        rows.append(f"Model error, root of its spectral density: {of.model_error:.4g}.")
    if of.quantisation:
        size = of.quantisation / math.sqrt(12.0)
        rows.append(
            f"y moves in steps of {of.quantisation:.4g}: a rounding of {size:.3g}, standard "
            "deviation."
        )
    if math.isfinite(of.whiteness):
        white = "white" if of.whiteness >= 1e-3 else "not white"
        rows.append(
            f"The innovation is {white} as far as R and Q go (probability {of.whiteness:.2g})."
        )
    return rows
