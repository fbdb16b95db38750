"""What an export says, whatever the language: names, initial values, settings, a test vector."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs import __version__, _core
from hgo_rs.errors import HgoError, check
from hgo_rs.exports.elementary import PRECISIONS, Precision
from hgo_rs.exports.expressions import PLAIN, Dialect, Names, Written, written
from hgo_rs.exports.table import Graph, graph
from hgo_rs.observers import Observer

__all__ = ["STATUS", "Field", "Program", "Row", "field_names", "order", "program", "wrapped"]

STATUS = ("UPDATED", "PREDICTED", "UNDEFINED")
"""What a step made of its sample, by number."""

LAWS = {
    "standard": "x_i' = x_(i+1) + f_i(x, u, t) + g^i k_i e,  e = y - x_1",
    "low-power": "x_i' = eta_(i+1) + alpha_i g e_i,  eta_(i+1)' = eta_(i+2) + beta_i g^2 e_i,\n"
    "e_1 = y - x_1,  e_i = eta_i - x_i,  the chain ends in phi(x, u, t)",
    "peaking-free": "x_i' = eta_(i+1) + alpha_i g e_i,  "
    "eta_(i+1)' = sat(eta_(i+2)) + beta_i g^2 e_i,\n"
    "e_1 = y - x_1,  e_i = sat(eta_i) - x_i,  the chain ends in phi(x, u, t)",
    "sampled-data": "x(k+1) = x(k) + T f(x(k), u(k)) + K_T(x(k), y(k))",
    "reduced-order": "z(k+1) = (I - T H) z(k) + T (H Psi(k) + f2(y(k), Psi(k), u(k))),\n"
    "H = diag(h)/epsilon",
}
"""The law of each kind of observer in one or two lines."""


@dataclass(frozen=True)
class Field:
    """A number of the state: its name there, what it is, and its first value."""

    name: str
    meaning: str
    value: float


@dataclass(frozen=True)
class Row:
    """One step of the test vector; the memory is that after the step."""

    t: float
    dt: float
    y: tuple[float, ...]
    u: tuple[float, ...]
    status: int
    memory: tuple[float, ...]


@dataclass(frozen=True)
class Program:
    """An observer, ready to be written in a language."""

    name: str
    precision: Precision
    memory: tuple[Field, ...]
    parameters: tuple[Field, ...]
    samples: tuple[str, ...]
    controls: tuple[str, ...]
    names: Names
    graph: Graph
    inputs: tuple[str, ...]
    description: str
    vector: tuple[Row, ...]

    def written(self, dialect: Dialect) -> Written:
        """The step in one language; inputs by the names that they have there."""
        known = ["t", "dt", *order(self)]
        names = Names()
        names.taken = set(self.names.taken)
        return written(
            self.graph,
            dict(zip(self.inputs, known, strict=True)),
            [f"next_{field.name}" for field in self.memory],
            names,
            dialect,
            self.precision.name,
            self.name,
        )


def program(
    observer: Observer,
    *,
    name: str,
    precision: str,
    dt: float | None = None,
    log: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike] | None = None,
) -> Program:
    """An observer as a program, its step traced by the core.

    Parameters
    ----------
    log : (t, y, u), optional
        Samples for the test vector, (N,), (N, n_y), (N, n_u). Default: 101 made up.
    dt : float, optional
        Sampling period, for the comment and the made-up samples [s].
    """
    if _model(observer.spec).get("table", {}) is None:
        raise HgoError(
            "the model is made of Python callables that could not be compiled: an export must be of"
            " operations; write its equations as expressions"
        )
    if observer.spec["kind"] == "reduced-order":
        raise HgoError(
            "the reduced-order observer decides on its memory, so that its step is not one table of"
            " operations: export another law"
        )
    single = precision == "single"
    step = _core.trace_step(observer.spec, single)
    missing = _core.trace_step(observer.spec, single, missing=True)
    m = len(observer.memory)
    names = Names()
    words = field_names(observer, names)
    meanings = [meaning for _, meaning in _memory_words(observer)]
    memory = tuple(map(Field, words[0], meanings, map(float, observer.memory)))
    values = [value for _, value in _parameters(observer.spec)]
    parameters = tuple(
        Field(word, "parameter", value) for word, value in zip(words[3], values, strict=True)
    )
    samples = range(2 + m, 2 + m + observer.n_y)
    return Program(
        name,
        PRECISIONS[precision],
        memory,
        parameters,
        words[1],
        words[2],
        names,
        # behind the memory, a step's table tells the innovation
        graph(
            {**step, "outputs": step["outputs"][:m]},
            precision,
            missing={**missing, "outputs": missing["outputs"][:m]},
            samples=samples,
        ),
        tuple(step["inputs"]),
        _description(observer, precision, dt),
        _vector(observer, (step, missing), values, precision, log, dt or _period(observer)),
    )


def field_names(
    observer: Observer, names: Names | None = None
) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Identifiers of memory, samples, inputs and parameters: the user's words where they fit."""
    names = Names() if names is None else names
    samples = ["y"] if observer.n_y == 1 else _numbered("y", observer.n_y)
    return (
        tuple(names.new(word) for word, _ in _memory_words(observer)),
        tuple(map(names.new, samples)),
        tuple(map(names.new, _controls(observer))),
        tuple(names.new(word) for word, _ in _parameters(observer.spec)),
    )


def order(program: Program) -> list[str]:
    """Names of memory, samples, inputs and parameters, in the table's order."""
    memory, parameters = (
        [field.name for field in fields] for fields in (program.memory, program.parameters)
    )
    return [*memory, *program.samples, *program.controls, *parameters]


def wrapped(head: str, text: str) -> str:
    """A line of code, broken at blanks where it is long."""
    indent = head[: len(head) - len(head.lstrip())]
    lines = textwrap.wrap(
        head.lstrip() + text,
        98,
        initial_indent=indent,
        subsequent_indent=indent + "    ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "\n".join(lines)


def _numbered(word: str, count: int) -> list[str]:
    return [f"{word}{i + 1}" for i in range(count)]


def _model(spec: Mapping[str, Any]) -> Mapping[str, Any]:
    model = spec.get("model")
    return model if isinstance(model, Mapping) else {}


def _own_names(spec: Mapping[str, Any]) -> Mapping[str, Sequence[str]]:
    """The user's names of states, inputs and parameters."""
    return dict(_model(spec).get("names") or {})


def _parameters(spec: Mapping[str, Any]) -> list[tuple[str, float]]:
    model = _model(spec)
    if model.get("kind") != "own":
        return []
    values = [float(value) for value in model.get("parameters", ())]
    return list(zip(_own_names(spec).get("parameters", ()), values, strict=True))


def _memory_words(observer: Observer) -> list[tuple[str, str]]:
    """A name and a meaning for every entry of the memory."""
    n, kind = observer.n, observer.spec["kind"]
    states = list(_own_names(observer.spec).get("states", ()))
    if len(states) < n:
        states = _numbered("z" if kind == "reduced-order" else "x", n)
    words = [(word, f"estimate of {word}") for word in list(states)[-n:]]
    if kind in ("low-power", "peaking-free"):
        words += [(f"eta_{word}", f"auxiliary state, follows {word}") for word, _ in words[1:]]
    if kind == "reduced-order":
        n_y, n_u = observer.n_y, observer.n_u
        words += [(f"last_{word}", "last sample") for word in _numbered("y", n_y)]
        words += [(f"held_{word}", "input since then") for word in _numbered("u", n_u)]
        words += [("elapsed", "time since that sample, s"), ("period", "its step, s")]
    if observer._gain_index() == len(words):
        words.append(("r", "gain"))
    if observer._core.is_current and kind != "reduced-order":
        words.append(("elapsed", "time from the last sample used to the next one, s"))
        words.append(("period", "length of the step that the next sample ends, s"))
        words += [(f"held_{word}", f"{word} over that step") for word in _controls(observer)]
    rest = range(len(words), len(observer.memory))
    return words + [(f"z{i + 1}", "auxiliary state") for i in rest]


def _controls(observer: Observer) -> list[str]:
    own = _own_names(observer.spec).get("inputs")
    return list(own or (["u"] if observer.n_u == 1 else _numbered("u", observer.n_u)))


def _period(observer: Observer) -> float:
    """A step that is surely stable."""
    try:
        period = float(observer.step_limit().dt) / 10.0
    except HgoError:
        return 1e-3
    return period if np.isfinite(period) else 1e-3  # zoh and bilinear are stable at any step


# --- the test vector --------------------------------------------------------------------------


def _vector(
    observer: Observer,
    tables: tuple[dict[str, Any], dict[str, Any]],
    parameters: list[float],
    precision: str,
    log: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike] | None,
    period: float,
) -> tuple[Row, ...]:
    """The core's own steps over a log: in single precision those of its tables.

    Raises
    ------
    HgoError
        Steps of the core that are not those of the tables.
    """
    real = PRECISIONS[precision].real
    t, y, u = _made_up(observer, period) if log is None else _given(observer, log)
    rows: list[Row] = []
    memory = np.asarray(observer.memory, dtype=float)
    m = len(memory)
    for k in range(len(t) - 1):
        at, dt = float(real(t[k])), float(real(t[k + 1] - t[k]))
        sample, control = y[k].astype(real).astype(float), u[k].astype(real).astype(float)
        status = 0 if np.isfinite(sample).all() else 1
        given = [[at, dt, *memory, *sample, *control, *parameters]]
        table = np.array(_core.evaluate_table(tables[status], given, precision == "single")[0][:m])
        fine = bool(np.isfinite(table).all())
        if precision == "double":
            moved, told = observer._core.step(memory, sample, control, at, dt)
            if fine and not np.array_equal(moved, table):
                raise HgoError(
                    f"step {k} of the test vector (y = {sample.tolist()}) is not that of the "
                    "observer's table: this law cannot be exported"
                )
            fine = fine and told != 2
        memory, status = (table, status) if fine else (memory, 2)
        taken, held, after = (tuple(values.tolist()) for values in (sample, control, memory))
        rows.append(Row(at, dt, taken, held, status, after))
    return tuple(rows)


def _made_up(observer: Observer, period: float) -> tuple[Any, Any, Any]:
    """100 samples of slow sines at uneven times, with a gap."""
    k = np.arange(101.0)
    t = period * (k + 0.2 * np.sin(k))
    phase = np.arange(observer.n_y) + 0.5
    y = 0.5 + 0.25 * np.sin(2.0 * np.pi * np.outer(k, 1.0 / (20.0 + phase)) + phase)
    y[40:45] = np.nan
    u = 0.1 * np.cos(np.outer(k, 0.05 + 0.02 * np.arange(observer.n_u)))
    return t, y, u


def _given(
    observer: Observer, log: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike]
) -> tuple[Any, Any, Any]:
    t, y, u = (np.asarray(values, dtype=float) for values in log)
    y, u = y.reshape(len(t), observer.n_y), u.reshape(len(t), observer.n_u)
    check(np.all(np.diff(t) > 0.0), "log", t, "at increasing times", "sort it")
    return t, y, u


# --- the comment ------------------------------------------------------------------------------


def _description(observer: Observer, precision: str, dt: float | None) -> str:
    """Equations and settings, a paragraph a line."""
    spec = observer.spec
    lines = [f"{spec['kind'].capitalize()} observer of order {observer.n}."]
    lines += LAWS.get(spec["kind"], "").splitlines()
    lines += _equations(spec)
    lines.append("")
    for key, value in spec.items():
        if key not in ("kind", "n", "model", "timing"):
            lines.append(f"{key}: {_shown(value)}")
        if key == "k":
            roots = np.sort_complex(np.roots([1.0, *value]))
            lines.append(f"poles at gain 1: {', '.join(map(_pole, roots))}")
    model = _model(spec)
    if model:
        hidden = ("table", "names", "n", "n_u", "parameters")
        lines.append(f"model: {_shown({k: v for k, v in model.items() if k not in hidden})}")
        lines += [f"{name} = {value!r}" for name, value in _parameters(spec)]
    current = observer._core.is_current
    lines.append(
        "timing: current, the estimate after a step is that at its sample"
        if current
        else "timing: predictor, the estimate after a step is that at the next sample"
    )
    lines.append(f"sampling: {f'{dt:g} s' if dt is not None else 'dt is given at every step'}")
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
    model = _model(spec)
    if model.get("kind") != "own":
        return []
    table, own = model["table"], model["names"]
    outputs = table.get("output_names") or [f"f{i + 1}" for i in range(len(table["outputs"]))]
    known = {f"u[{i}]": word for i, word in enumerate(own["inputs"])}
    n = model.get("n", 0)
    for i, word in enumerate(own["states"]):
        known |= {f"x[{i}]": word, f"z[{i - n}]": word}
    given = {word: known.get(word, word) for word in table["inputs"]}
    names = Names()
    names.taken = set(given.values())
    text = written(graph(table, "double"), given, outputs, names, PLAIN, "double")
    lines = [f"{name} = {value}" for name, value in text.steps]
    named = {name for name, _ in text.steps}
    lines += [
        f"{name} = {value}"
        for name, value in zip(outputs, text.outputs, strict=True)
        if value not in named
    ]
    return lines
