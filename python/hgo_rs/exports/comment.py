"""The comment at the head of an export: equations and settings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hgo_rs import laws
from hgo_rs._version import __version__
from hgo_rs.exports.expressions import PLAIN, number, written
from hgo_rs.exports.held import Periods
from hgo_rs.exports.names import Names
from hgo_rs.exports.precision import PRECISIONS
from hgo_rs.exports.table import graph
from hgo_rs.exports.traced import indexed, model_of, numbered_parameters
from hgo_rs.exports.words import Words, parameters_of
from hgo_rs.observers import Observer

__all__ = ["description"]

_LAWS = {
    "standard": "x_i' = x_(i+1) + f_i(x, u, t) + g^i k_i e,  e = y - x_1",
    "low-power": "x_i' = eta_(i+1) + alpha_i g e_i,  eta_(i+1)' = eta_(i+2) + beta_i g^2 e_i,\n"
    "e_1 = y - x_1,  e_i = eta_i - x_i,  the chain ends in phi(x, u, t)",
    "peaking-free": "x_i' = eta_(i+1) + alpha_i g e_i,  "
    "eta_(i+1)' = sat(eta_(i+2)) + beta_i g^2 e_i,\n"
    "e_1 = y - x_1,  e_i = sat(eta_i) - x_i,  the chain ends in phi(x, u, t)",
    "sampled-data": "x(k+1) = x(k) + T f(x(k), u(k)) + K_T(x(k), y(k))",
    "reduced-order": "z(k+1) = (I - T H) z(k) + T (H Psi(k) + f2(y(k), Psi(k), u(k))),\n"
    "H = diag(h)/epsilon",
    "window": "x(k) = x_p + W d,  x_p = exp(A T) x(k-1),  d = (y - x_p1, d_0, d_1, ...),\n"
    "d_j: deviation of the sample j periods ago from the polynomial of x(k)",
}
"""Laws in one or two lines."""


def _law(kind: str) -> str:
    """The law in one or two lines, or its name and its source."""
    row = laws.LAWS.get(kind)
    return _LAWS.get(kind, f"{row.title}: {row.source}" if row else "")


def description(
    observer: Observer,
    precision: str,
    dt: float | None,
    periods: Periods | None,
    words: Words,
    fixed: float | None,
) -> str:
    """Equations and settings, a paragraph a line."""
    spec = observer.spec
    lines = [f"{spec['kind'].capitalize()} observer of order {observer.n}."]
    lines += _law(spec["kind"]).splitlines()
    for name in (model_of(spec).get("names") or {}).get("unknown", ()):
        lines.append(f"{name}: unknown, the last state of its chain, in place of which phi enters;")
        lines.append("its correction is over the slope of phi in it")
    lines += _equations(spec)
    lines.append("")
    for key, value in spec.items():
        if key not in ("kind", "n", "model", "timing"):
            lines.append(f"{key}: {_shown(value)}")
        if key == "k":
            roots = np.sort_complex(np.roots([1.0, *value]))
            lines.append(f"poles at gain 1: {', '.join(map(_pole, roots))}")
    model = model_of(spec)
    if model:
        hidden = ("table", "names", "n", "n_u", "parameters", "unknown", "units")
        lines.append(f"model: {_shown({k: v for k, v in model.items() if k not in hidden})}")
        lines += [f"{name} = {value!r}" for name, value in parameters_of(spec)]
        lines += words.renamed
    current = observer._core.is_current
    lines.append(
        "timing: current, the estimate after a step is that at its sample"
        if current
        else "timing: predictor, the estimate after a step is that at the next sample"
    )
    sampling = "dt is given at every step" if dt is None else f"{dt:g} s"
    if fixed is not None:
        sampling = f"every {number(fixed, PRECISIONS[precision])} s, which is in the numbers below"
    lines.append(f"sampling: {sampling}")
    if periods is not None:
        lines.append(f"corrections: for times of 1 to {periods.most} sampling periods")
    lines.append(f"precision: {precision}")
    lines.append(f"written by hgo_rs {__version__}")
    return "\n".join(lines)


def _pole(root: complex) -> str:
    return f"{root:.6g}" if root.imag else f"{root.real:.6g}"


def _shown(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_shown(inner)}" for key, inner in value.items())
    if isinstance(value, (list, tuple)):
        return ", ".join(_shown(inner) for inner in value)
    return repr(value) if isinstance(value, float) else str(value)


def _equations(spec: Mapping[str, Any]) -> list[str]:
    """An own model's equations, from its table; its inputs are called x[0], u[0] and so on."""
    model = model_of(spec)
    if model.get("kind") != "own":
        return []
    table, own = model["table"], model["names"]
    outputs = table.get("output_names") or [f"f{i + 1}" for i in range(len(table["outputs"]))]
    known = {f"u[{i}]": word for i, word in enumerate(own["inputs"])}
    n = model.get("n", 0)
    for i, word in enumerate(own["states"]):
        known |= {f"x[{i}]": word, f"z[{i - n}]": word}
    table = model_of(numbered_parameters(spec))["table"]
    known |= dict(zip(indexed("p", len(own["parameters"])), own["parameters"], strict=True))
    given = {word: known.get(word, word) for word in table["inputs"]}
    text = written(graph(table, "double"), given, outputs, Names(given.values()), PLAIN, "double")
    lines = [f"{name} = {value}" for name, value in text.steps]
    named = {name for name, _ in text.steps}
    lines += [
        f"{name} = {value}"
        for name, value in zip(outputs, text.outputs, strict=True)
        if value not in named
    ]
    return lines
