"""What an export says, whatever the language: names, initial values, settings, a test vector."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hgo_rs import _core, laws
from hgo_rs._version import __version__
from hgo_rs.errors import HgoError, check
from hgo_rs.exports.expressions import LENGTH, PLAIN, Dialect, Written, number, written
from hgo_rs.exports.held import TOLERANCE, Held, Periods, held_gains
from hgo_rs.exports.names import Names, names_of_export
from hgo_rs.exports.precision import PRECISIONS, Precision
from hgo_rs.exports.table import graph
from hgo_rs.exports.traced import Move, Traced, indexed, model_of, numbered_parameters
from hgo_rs.exports.vector import OTHER_PERIOD, STATUS, Log, Recursion, Row, vector
from hgo_rs.observers import Observer

__all__ = ["PERIODS", "Field", "Gains", "Program", "Words", "program", "words_of", "wrapped"]

PERIODS = 16
"""For how many periods gains are held, if nothing else is asked."""

ELAPSED = "time that the next correction is for, s"
SINCE = "time since that sample, s"
UNUSED = "not used"
"""Of entries of a memory that an export leaves out."""

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
}
"""Laws in one or two lines."""


def _law(kind: str) -> str:
    """The law in one or two lines, or its name and its source."""
    row = laws.LAWS.get(kind)
    return _LAWS.get(kind, f"{row.title}: {row.source}" if row else "")


@dataclass(frozen=True)
class Field:
    """A number of the state: its name there, what it is, and its first value."""

    name: str
    meaning: str
    value: float


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
class Gains:
    """Gains that the source holds for a chain, and what they are called there."""

    held: Held
    columns: tuple[int, ...]
    """Those that are used."""
    row: str
    """The row of the time that a correction is for."""
    periods: str
    """How many periods that is."""

    @classmethod
    def of(cls, held: Held, move: Move, names: Names) -> Gains:
        """Of the move that corrects."""
        used = move.used
        columns = tuple(i for i, name in enumerate(held.named(0)) if name in used)
        number = f"_{held.number}" if held.number else ""
        return cls(held, columns, names.local(f"gains{number}"), names.local(f"periods{number}"))

    @property
    def rows(self) -> list[tuple[float, ...]]:
        """What is held, for 0, 1, 2, ... periods."""
        return [tuple(row[i] for i in self.columns) for row in self.held.rows]

    @property
    def told(self) -> str:
        """What stands in the columns."""
        output = f" (output {self.held.number})" if self.held.number else ""
        names = ", ".join(self.held.column(i) for i in self.columns)
        return f"Gains of a correction for 0, 1, 2, ... periods{output}: {names}."


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
    periods: Periods | None = None
    """For which times gains are held, if they are."""
    gains: tuple[Gains, ...] = ()
    closes: bool = False
    """Whether a sample closes the period before it: the estimate moves then."""

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
        for gains in self.gains:
            named |= {
                f"{gains.held.place}[{column}]": f"{gains.row}[{i}]"
                for i, column in enumerate(gains.columns)
            }
        return {"t": "t", LENGTH: "dt", **named}

    @property
    def statuses(self) -> tuple[str, ...]:
        """What a call may give."""
        return STATUS if self.gains else STATUS[:OTHER_PERIOD]

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
            return f"Take {taken} at time t [s]; advance by dt [s]{self._told_times('dt')}."
        if verb == "correct":
            told = (
                f"Take {sample} of now: the estimate is then that of now. The correction is for "
                f"the time since the last sample used{self._told_times('it')}."
            )
            if self.periods is not None:
                told += " If it is not, the next correction is for the time from now on."
            return told + " The first sample only begins." * self.closes
        under = f", under {control}, which is applied from now on" if control else ""
        if verb == "predict":
            begins = f", from time t [s]{under}" if at else under
            then = " The estimate moves when a sample closes the period." if self.closes else ""
            return f"Move over the period of length dt [s] that begins now{begins}.{then}"
        belong = [*self.words.controls, "dt [s]", "t [s], the time of its beginning,"]
        return (
            f"One call a sample: predict over the period that has just ended, then correct by "
            f"{sample} of now. {_and(belong)} to the period that has ended; the first call only "
            "corrects and does not use them."
        )

    def _told_times(self, which: str) -> str:
        """For which times there are corrections."""
        if self.periods is None:
            return ""
        return f"; {which} must be {self.told_periods}, else the sample is not used"

    @property
    def told_periods(self) -> str:
        """The times that gains are held for."""
        if self.periods is None:
            return "any"
        dt, most = self.periods.dt, self.periods.most
        length = f"{number(dt, self.precision)} s"
        return f"1 to {most} periods of {length}" if most > 1 else f"one period of {length}"

    @property
    def told_count(self) -> str:
        """What the function does that counts periods."""
        return (
            f"How many sampling periods a time [s] is, if it is {self.told_periods} (to "
            f"{TOLERANCE:g} of it), else 0. Gains of a correction are held for these times alone."
        )

    def refused(self, finite: str, zero: str) -> str:
        """The condition that a sample is not used because there are no gains for its time."""
        conditions = []
        for gains in self.gains:
            condition = f"{gains.periods} == 0"
            if gains.held.elapsed is not None:
                sample = finite.format(self.words.samples[gains.held.sample])
                condition += f" && {sample} && {self.memory[gains.held.elapsed].name} > {zero}"
            conditions.append(condition)
        held_in = "({})" if len(conditions) > 1 and self.is_current else "{}"
        return " || ".join(map(held_in.format, conditions))

    def written(self, move: Move, dialect: Dialect) -> Written:
        """A move in one language."""
        names = Names(self.names.taken)
        places = self.places
        if self.precision.name == "single":
            places["t"] = names.local("time")
        return written(
            move.graph,
            {name: places[name] for name in move.inputs if name in places},
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
    periods: int = PERIODS,
    log: Log | None = None,
) -> Program:
    """An observer as a program, its moves traced by the core.

    Parameters
    ----------
    log : (t, y, u), optional
        Samples for the test vector, (N,), (N, n_y), (N, n_u). Default: 101 made up.
    dt : float, optional
        Sampling period, for gains that are held, the comment and the made-up samples [s].
    periods : int
        For how many periods at most gains are held.
    """
    spec, current = observer.spec, observer._core.is_current
    if model_of(spec).get("table", {}) is None:
        raise HgoError(
            "the model is made of Python callables that could not be compiled: an export must be of"
            " operations; write its equations as expressions"
        )
    real = PRECISIONS[precision]
    times, held = held_gains(spec, real, dt, periods)
    if precision == "single":
        _check_single(observer)
    entries = _memory_words(observer)
    memory = [i for i, (_, meaning) in enumerate(entries) if meaning != UNUSED]
    verbs = ("correct", "predict") if current else ("step",)
    traced = {verb: Traced.of(spec, verb, precision, memory) for verb in verbs}
    moves = tuple(of.move() for of in traced.values())
    names = Names(names_of_export(name))
    words = words_of(observer, names)
    words = replace(words, memory=tuple(words.memory[i] for i in memory))
    meanings = [entries[i][1] for i in memory]
    elapsed = tuple(i for i, told in enumerate(meanings) if told.startswith((ELAPSED, SINCE)))
    parameters = _parameters(spec)
    return Program(
        name,
        real,
        tuple(map(Field, words.memory, meanings, map(float, observer.memory[memory]))),
        tuple(
            Field(word, "parameter" if word == own else f"parameter {own}", value)
            for word, (own, value) in zip(words.parameters, parameters, strict=True)
        ),
        words,
        names,
        moves,
        elapsed,
        _description(observer, precision, dt, times, words),
        vector(
            Recursion(
                observer,
                traced,
                memory,
                [value for _, value in parameters],
                real,
                times,
                held,
                elapsed,
            ),
            log,
            dt or _period(observer),
        ),
        times,
        tuple(Gains.of(chain, moves[0], names) for chain in held),
        spec["kind"] == "reduced-order",
    )


def _check_single(observer: Observer) -> None:
    """Refuse numbers that single precision does not hold."""
    real, spec = PRECISIONS["single"].real, observer.spec
    given = [(f"parameter {word}", value) for word, value in _parameters(spec)]
    given += [
        (f"memory {word}", float(value))
        for (word, _), value in zip(_memory_words(observer), observer.memory, strict=True)
    ]
    table = model_of(spec).get("table", {})
    given += [("a constant of the model", float(value)) for value in table.get("constants", ())]
    remedy = 'scale the model, or export with precision="double"'
    for what, value in given:
        with np.errstate(over="ignore", under="ignore"):
            held = float(real(value))
        lost = np.isinf(held) != np.isinf(value) or (held == 0.0) != (value == 0.0)
        check(
            not lost, what, value, "within the range of single precision, 1.4e-45 to 3.4e38", remedy
        )


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


def _own_names(spec: Mapping[str, Any]) -> Mapping[str, Sequence[str]]:
    """The user's names of states, inputs and parameters."""
    return dict(model_of(spec).get("names") or {})


def _parameters(spec: Mapping[str, Any]) -> list[tuple[str, float]]:
    model = model_of(spec)
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
        unused = len(observer.memory) - 2 - len(words)
        words += [(word, UNUSED) for word in _numbered("unused", unused)]
        return [*words, ("elapsed", SINCE), ("period", "length of the period since then, s")]
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


# --- the comment ------------------------------------------------------------------------------


def _description(
    observer: Observer, precision: str, dt: float | None, periods: Periods | None, words: Words
) -> str:
    """Equations and settings, a paragraph a line."""
    spec = observer.spec
    lines = [f"{spec['kind'].capitalize()} observer of order {observer.n}."]
    lines += _law(spec["kind"]).splitlines()
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
