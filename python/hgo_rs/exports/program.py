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
from hgo_rs.exports.expressions import LENGTH, PLAIN, Dialect, Written, written
from hgo_rs.exports.names import Names, names_of_export
from hgo_rs.exports.precision import PRECISIONS, Precision
from hgo_rs.exports.table import Graph, graph
from hgo_rs.observers import Observer

__all__ = ["STATUS", "Field", "Move", "Program", "Row", "Words", "program", "words_of", "wrapped"]

STATUS = ("UPDATED", "PREDICTED", "UNDEFINED")
"""What a step made of its sample, by number."""

UNDEFINED = STATUS.index("UNDEFINED")

Array = npt.NDArray[np.float64]

ELAPSED = "time that the next correction is for, s"

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
class Words:
    """Identifiers: the user's words where they are free."""

    memory: tuple[str, ...]
    samples: tuple[str, ...]
    controls: tuple[str, ...]
    parameters: tuple[str, ...]
    started: str
    """Whether a sample was taken, which current timing knows."""
    renamed: tuple[str, ...]
    """What is told of the user's words that could not stay."""


@dataclass(frozen=True)
class Move:
    """A function of the program, made of one table: its verb and what it takes.

    `inputs` are the table's, in order, under the names t, dt, z[i], y[i], u[i] and p[i].
    """

    verb: str
    graph: Graph
    inputs: tuple[str, ...]

    @property
    def used(self) -> set[str]:
        """The inputs that the outputs need."""
        return {term.name for term in self.graph.terms if term.kind == "input"}

    def takes(self, kind: str) -> bool:
        """Whether samples (y), inputs (u), t or dt are among the table's inputs."""
        return any(name.split("[")[0] == kind for name in self.inputs)


@dataclass(frozen=True)
class Program:
    """An observer, ready to be written in a language.

    With predictor timing there is one move, the step. With current timing there are two, correct
    and predict, and a step is made of them.
    """

    name: str
    precision: Precision
    memory: tuple[Field, ...]
    parameters: tuple[Field, ...]
    words: Words
    names: Names
    moves: tuple[Move, ...]
    elapsed: tuple[int, ...]
    """Where the memory holds times that corrections are for."""
    description: str
    vector: tuple[Row, ...]

    @property
    def is_current(self) -> bool:
        """Whether a step is a prediction and a correction."""
        return len(self.moves) > 1

    @property
    def places(self) -> dict[str, str]:
        """What each input of the tables is called."""
        words = self.words
        groups = {
            "z": words.memory,
            "y": words.samples,
            "u": words.controls,
            "p": words.parameters,
        }
        named = {f"{key}[{i}]": w for key, group in groups.items() for i, w in enumerate(group)}
        return {"t": "t", LENGTH: "dt", **named}

    def arguments(self, *moves: Move) -> list[str]:
        """What a function takes that is made of these moves."""
        words: list[str] = []
        if any(move.takes("y") for move in moves):
            words += self.words.samples
        if any(move.takes("u") for move in moves):
            words += self.words.controls
        # a step always takes t, so that the steps of two models are called alike
        if moves == self.moves or any("t" in move.used for move in moves):
            words.append("t")
        return words + ["dt"] * any(move.takes(LENGTH) for move in moves)

    def told(self, verb: str) -> str:
        """What a function does."""
        sample = _list("sample", self.words.samples)
        control = _list("input", self.words.controls)
        at = any("t" in move.used for move in self.moves)
        if not self.is_current:
            taken = f"{sample} and {control}" if control else sample
            return f"Take {taken} at time t [s]; advance by dt [s]."
        if verb == "correct":
            return (
                f"Take {sample} of now: the estimate is then that of now. The correction is for "
                "the time since the last sample used."
            )
        under = f", under {control}, which is applied from now on" if control else ""
        if verb == "predict":
            begins = f", from time t [s]{under}" if at else under
            return f"Move over the period of length dt [s] that begins now{begins}."
        belong = [*self.words.controls, "dt [s]", "t [s], the time of its beginning,"]
        return (
            f"One call a sample: predict over the period that has just ended, then correct by "
            f"{sample} of now. {_and(belong)} to the period that has ended; the first call only "
            "corrects and does not use them."
        )

    def written(self, move: Move, dialect: Dialect) -> Written:
        """A move in one language."""
        names = Names(self.names.taken)
        places = self.places
        if self.precision.name == "single":
            places["t"] = names.local("time")
        return written(
            move.graph,
            {name: places[name] for name in move.inputs},
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
    """An observer as a program, its moves traced by the core.

    Parameters
    ----------
    log : (t, y, u), optional
        Samples for the test vector, (N,), (N, n_y), (N, n_u). Default: 101 made up.
    dt : float, optional
        Sampling period, for the comment and the made-up samples [s].
    """
    _check_table(observer.spec)
    if precision == "single":
        _check_single(observer)
    verbs = ("correct", "predict") if observer._core.is_current else ("step",)
    traced = [_Traced.of(observer, verb, precision) for verb in verbs]
    names = Names(names_of_export(name))
    words = words_of(observer, names)
    meanings = [meaning for _, meaning in _memory_words(observer)]
    elapsed = tuple(i for i, meaning in enumerate(meanings) if meaning.startswith(ELAPSED))
    parameters = _parameters(observer.spec)
    return Program(
        name,
        PRECISIONS[precision],
        tuple(map(Field, words.memory, meanings, map(float, observer.memory))),
        tuple(
            Field(word, "parameter" if word == own else f"parameter {own}", value)
            for word, (own, value) in zip(words.parameters, parameters, strict=True)
        ),
        words,
        names,
        tuple(of.move() for of in traced),
        elapsed,
        _description(observer, precision, dt, words),
        _vector(
            observer,
            {of.verb: of for of in traced},
            [value for _, value in parameters],
            precision,
            log,
            dt or _period(observer),
            elapsed,
        ),
    )


def _check_table(spec: Mapping[str, Any]) -> None:
    """Refuse laws that are no tables of operations."""
    if _model(spec).get("table", {}) is None:
        raise HgoError(
            "the model is made of Python callables that could not be compiled: an export must be of"
            " operations; write its equations as expressions"
        )
    if spec["kind"] == "reduced-order":
        raise HgoError(
            "the reduced-order observer decides on its memory, so that its step is not one table of"
            " operations: export another law"
        )
    for law in spec.get("observers", (spec,)):
        placed = law.get("method") in ("zoh", "bilinear")
        check(
            not (placed and law["kind"] in ("low-power", "peaking-free")),
            "method",
            law.get("method"),
            f"another in an export of the {law['kind']} law, whose placed gains are found by "
            "decisions on the length of a period",
            'choose method="rk4", or the standard law',
        )


def _check_single(observer: Observer) -> None:
    """Refuse numbers that single precision does not hold."""
    real, spec = PRECISIONS["single"].real, observer.spec
    given = [(f"parameter {word}", value) for word, value in _parameters(spec)]
    given += [
        (f"memory {word}", float(value))
        for (word, _), value in zip(_memory_words(observer), observer.memory, strict=True)
    ]
    table = _model(spec).get("table", {})
    given += [("a constant of the model", float(value)) for value in table.get("constants", ())]
    remedy = 'scale the model, or export with precision="double"'
    for what, value in given:
        with np.errstate(over="ignore", under="ignore"):
            held = float(real(value))
        lost = np.isinf(held) != np.isinf(value) or (held == 0.0) != (value == 0.0)
        check(
            not lost, what, value, "within the range of single precision, 1.4e-45 to 3.4e38", remedy
        )


@dataclass(frozen=True)
class _Traced:
    """Tables of one move of an observer: with its sample, and without."""

    verb: str
    precision: str
    with_sample: dict[str, Any]
    without: dict[str, Any]

    @classmethod
    def of(cls, observer: Observer, verb: str, precision: str) -> _Traced:
        spec, single, m = (
            _numbered_parameters(observer.spec),
            precision == "single",
            observer.memory,
        )

        def table(missing: bool) -> dict[str, Any]:
            given = _core.trace_step(spec, single, missing=missing, part=verb)
            # behind the memory, a table tells the innovation
            return {**given, "outputs": given["outputs"][: len(m)]}

        return cls(verb, precision, table(False), table(True))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(self.with_sample["inputs"])

    def move(self) -> Move:
        samples = [i for i, name in enumerate(self.inputs) if name.startswith("y[")]
        both = graph(self.with_sample, self.precision, missing=self.without, samples=samples)
        return Move(
            self.verb, both if samples else graph(self.with_sample, self.precision), self.inputs
        )

    def evaluate(
        self, t: float, dt: float, numbers: Mapping[str, Sequence[float] | Array]
    ) -> Array:
        """The memory after the move."""
        values = {"t": t, LENGTH: dt}
        for word, given in numbers.items():
            values |= dict(zip(_indexed(word, len(given)), given, strict=True))
        table = self.with_sample if np.isfinite(numbers["y"]).all() else self.without
        row = [[values[name] for name in self.inputs]]
        return np.array(_core.evaluate_table(table, row, self.precision == "single")[0])


def _numbered_parameters(spec: Mapping[str, Any]) -> dict[str, Any]:
    """A spec whose parameters are called p[0], p[1], ...: names that no user can give."""
    model = _model(spec)
    if model.get("kind") != "own":
        return dict(spec)
    table = model["table"]
    count = len(model["parameters"])
    first = len(table["inputs"]) - count
    inputs = [*table["inputs"][:first], *_indexed("p", count)]
    return {**spec, "model": {**model, "table": {**table, "inputs": inputs}}}


def _indexed(word: str, count: int) -> list[str]:
    return [f"{word}[{i}]" for i in range(count)]


def words_of(observer: Observer, names: Names | None = None) -> Words:
    """Identifiers of memory, samples, inputs and parameters."""
    names = Names() if names is None else names
    memory = [word for word, _ in _memory_words(observer)]
    controls = _controls(observer)
    parameters = [word for word, _ in _parameters(observer.spec)]
    n, n_u, n_p = observer.n, len(controls), len(parameters)
    samples = ["y"] if observer.n_y == 1 else _numbered("y", observer.n_y)
    users = [("state", word) for word in memory[:n]]
    users += [("input", word) for word in controls]
    users += [("parameter", word) for word in parameters]
    ours = [("memory", word) for word in [*memory[n:], "started"]]
    ours += [("sample", word) for word in samples]
    found = names.several([(word, role) for role, word in users + ours])
    renamed = [
        f"{role} {word} is called {new}"
        for (role, word), new in zip(users, found, strict=False)
        if new != word
    ]
    rest = found[n + n_u + n_p :]
    at = len(memory) - n
    return Words(
        (*found[:n], *rest[:at]),
        tuple(rest[at + 1 :]),
        tuple(found[n : n + n_u]),
        tuple(found[n + n_u : n + n_u + n_p]),
        rest[at],
        tuple(renamed),
    )


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


def _and(words: Sequence[str]) -> str:
    *first, last = words
    return f"{', '.join(first)} and {last} belong" if first else f"{last} belongs"


def _list(what: str, words: Sequence[str]) -> str:
    plural = "s" if len(words) > 1 else ""
    return f"the {what}{plural} {', '.join(words)}" if words else ""


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
    n, spec = observer.n, observer.spec
    states = list(_own_names(spec).get("states", ()))
    if len(states) < n:
        states = _numbered("z" if spec["kind"] == "reduced-order" else "x", n)
    states = states[-n:]
    words = [(word, f"estimate of {word}") for word in states]
    count = len(observer.memory) - n
    if spec["kind"] == "reduced-order":
        n_y, n_u = observer.n_y, observer.n_u
        words += [(f"last_{word}", "last sample") for word in _numbered("y", n_y)]
        words += [(f"held_{word}", "input since then") for word in _numbered("u", n_u)]
        return [*words, ("elapsed", "time since that sample, s"), ("period", "its step, s")]
    if spec["kind"] != "chains":
        return words + _rest_of(spec, states, count)
    for i, chain in enumerate(spec["observers"], start=1):
        of_chain, states = states[: chain["n"]], states[chain["n"] :]
        rest = _rest_of(chain, of_chain, _core.Observer(chain).memory_len - chain["n"])
        words += [(f"{word}_{i}", f"{meaning} (output {i})") for word, meaning in rest]
    return words


def _rest_of(spec: Mapping[str, Any], states: Sequence[str], count: int) -> list[tuple[str, str]]:
    """The entries, `count` in number, that a continuous law remembers behind its estimates."""
    words = []
    if spec["kind"] in ("low-power", "peaking-free"):
        words += [(f"eta_{word}", f"auxiliary state, follows {word}") for word in states[1:]]
    gain = spec.get("gain")
    if isinstance(gain, Mapping) and gain["law"] != "constant":
        words.append(("r", "gain"))
    last = [("elapsed", ELAPSED)] if spec.get("timing") == "current" else []
    rest = range(len(words), count - len(last))
    return words + [(f"z{len(states) + i + 1}", "auxiliary state") for i in rest] + last


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
    traced: Mapping[str, _Traced],
    parameters: list[float],
    precision: str,
    log: tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike] | None,
    period: float,
    elapsed: tuple[int, ...],
) -> tuple[Row, ...]:
    """The core's own steps over a log: in single precision those of its tables.

    Raises
    ------
    HgoError
        Moves of the core that are not those of the tables.
    """
    real = PRECISIONS[precision].real
    t, y, u = _made_up(observer, period) if log is None else _given(observer, log)
    y, u = y.astype(real).astype(float), u.astype(real).astype(float)
    current = "step" not in traced

    def moved(verb: str, z: Array, k: int, i: int, at: float, dt: float) -> Array:
        """The memory after a move by sample k under input i."""
        numbers = {"z": z, "y": y[k], "u": u[i], "p": parameters}
        table = traced[verb].evaluate(float(real(at)), dt, numbers)
        if precision == "double" and np.isfinite(table).all():
            core = observer._core
            made = (
                core.step(z, y[k], u[i], at, dt)
                if verb == "step"
                else core.correct(z, y[k], at)
                if verb == "correct"
                else core.advance(z, np.full(observer.n_y, np.nan), u[i], at, dt)
            )
            if made[1] == UNDEFINED or not np.array_equal(made[0], table):
                raise HgoError(
                    f"step {k} of the test vector (y = {y[k].tolist()}) is not that of the "
                    "observer's table: this law cannot be exported"
                )
        return table

    rows: list[Row] = []
    memory: Array = np.asarray(observer.memory, dtype=float)
    for k in range(len(t) - 1):
        # with current timing a step is over the period that ends with its sample
        i = max(k - 1, 0) if current else k
        at, dt = float(t[i]), float(real(t[i + 1] - t[i]))
        status = 0 if np.isfinite(y[k]).all() else 1
        after = memory
        if current and k > 0:
            after = moved("predict", memory, k, i, at, dt)
            if np.isfinite(after).all():
                memory = after
            else:  # the estimate is held, and time goes on
                memory = np.where(np.isin(np.arange(len(memory)), elapsed), after, memory)
        if np.isfinite(after).all():
            now = at + dt if current and k > 0 else at
            after = moved("correct" if current else "step", memory, k, i, now, dt)
        memory, status = (after, status) if np.isfinite(after).all() else (memory, UNDEFINED)
        sample, control, moved_to = (tuple(v.tolist()) for v in (y[k], u[i], memory))
        rows.append(Row(at, dt, sample, control, status, moved_to))
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


def _description(observer: Observer, precision: str, dt: float | None, words: Words) -> str:
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
        lines += words.renamed
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
    table = _model(_numbered_parameters(spec))["table"]
    known |= dict(zip(_indexed("p", len(own["parameters"])), own["parameters"], strict=True))
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
