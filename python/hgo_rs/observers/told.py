"""An observer and its result in words: a line for a prompt, a table for a notebook."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hgo_rs.laws import LAWS
from hgo_rs.markup import number, table
from hgo_rs.models import System
from hgo_rs.observers.labels import Labels

_KEPT = ("method", "motion", "timing", "wrap")


def shortly(spec: Mapping[str, Any], model: System | None) -> str:
    """The arguments of a constructor that say the most, as text."""
    if "observers" in spec:
        laws = [f"{inner['kind']} of {shortly(inner, None)}" for inner in spec["observers"]]
        given = [f"[{'; '.join(laws)}]"]
    else:
        given = [f"n={spec['n']}"] if "n" in spec else []
        given += [f"{key}={_law(spec[key])}" for key in ("gain", "shape") if key in spec]
        if "saturation" in spec:
            given.append(f"saturation={[float(f'{v:.4g}') for v in spec['saturation']]}")
    if model is not None:
        given.append(f"model={model!r}")
    return ", ".join([*given, *(f"{key}={spec[key]!r}" for key in _kept(spec, model))])


def in_words(observer: Any) -> str:
    """Law, order, gain and choices as a terminal shows them."""
    told = []
    for part in observer.spec.get("observers", [observer.spec]):
        words = [part["kind"]]
        words += [f"order {part['n']}"] if "n" in part else []
        words += [f"gain {_law(part['gain'], ' 1/s')}"] if "gain" in part else []
        kept = _kept(part, observer.model)
        words += [f"{key} {part[key]}" for key in kept if key != "timing"]
        told.append(", ".join(words))
    return f"{'; '.join(told)}; timing {observer.timing}"


def _kept(spec: Mapping[str, Any], model: System | None) -> list[str]:
    """Choices that are shown: of the motion only where the model has one."""
    moves = model is not None and model.moves
    return [key for key in _KEPT if key in spec and (moves or key != "motion")]


def _law(told: Any, unit: str = "") -> str:
    """A gain or a shape: its number, or its law with its numbers."""
    if not isinstance(told, Mapping):
        return repr(told)
    if told["law"] == "constant":
        return f"{told['ell']:.6g}{unit}"
    return f"{told['law']}({', '.join(f'{k}={v}' for k, v in told.items() if k != 'law')})"


def as_html(observer: Any) -> str:
    """Law, numbers and choices, what it knows, and where it stands."""
    spec, model = observer.spec, observer.model
    rows: list[Sequence[object]] = []
    for inner in spec.get("observers", [spec]):
        law = LAWS.get(inner["kind"])
        rows.append(("law", f"{law.title if law else inner['kind']}, order {inner.get('n', '')}"))
        rows += [(key, _law(inner[key], " 1/s")) for key in ("gain", "shape") if key in inner]
        for name, _ in law.coefficients if law else ():
            if name in inner:
                values = np.atleast_1d(inner[name]).ravel().tolist()
                rows.append((name, ", ".join(map(number, values))))
    if model is not None:
        rows.append(("model", knowledge(model)))
    rows += [(key, spec[key]) for key in _kept(spec, model)]
    names = Labels.of(spec, observer.n).columns(observer.n)
    stands = zip(names, observer.x_hat.tolist(), strict=True)
    rows.append(("estimate", ", ".join(f"{name} = {number(value)}" for name, value in stands)))
    return table(type(observer).__name__, rows)


def knowledge(model: System) -> object:
    """A model's equations where they are known in LaTeX, else its text."""
    latex = model._repr_latex_() if hasattr(model, "_repr_latex_") else None
    return repr(model) if latex is None else latex


def result_line(result: Any) -> str:
    """Samples, span and states of a run."""
    count = len(result.y)
    names = ", ".join(result.labels.columns(result.x_hat.shape[1]))
    span = f" from {result.time[0]:g} to {result.time[-1]:g} s" if count else ""
    missing = int(result.missing.sum())
    told = f", {missing} missing" if missing else ""
    return f"RunResult({count} samples{span}{told}; {names}; timing={result.timing!r})"


def result_html(result: Any) -> str:
    """Each estimate: range, last value, and its deviation where that is known."""
    rows = []
    known = result.deviation is not None
    for i, x in enumerate(result.x_hat.T):
        row = [result.labels.heading(i), *map(number, (x.min(), x.max(), x[-1]))] if len(x) else []
        if known:
            row.append(number(float(np.sqrt(np.mean(result.deviation[:, i] ** 2)))))
        rows.append(row)
    heads = ["estimate", "least", "largest", "last", *(["deviation (RMS)"] if known else [])]
    return table(result_line(result), rows, heads)
