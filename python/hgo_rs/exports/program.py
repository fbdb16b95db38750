"""What an export says, whatever the language: names, initial values, settings, a test vector."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hgo_rs.errors import HgoError, check
from hgo_rs.exports.comment import description
from hgo_rs.exports.expressions import LENGTH, Dialect, Written, number, written
from hgo_rs.exports.held import TOLERANCE, Held, Periods, check_fixed, held_gains
from hgo_rs.exports.names import Names, names_of_export
from hgo_rs.exports.precision import PRECISIONS, Precision
from hgo_rs.exports.traced import Move, Traced, model_of
from hgo_rs.exports.vector import OTHER_PERIOD, STATUS, Log, Recursion, Row, vector
from hgo_rs.exports.words import (
    ELAPSED,
    SINCE,
    UNUSED,
    Words,
    memory_words,
    parameters_of,
    words_of,
)
from hgo_rs.observers import Observer

__all__ = [
    "PERIODS",
    "Field",
    "Gains",
    "Program",
    "Words",
    "period_of",
    "program",
    "words_of",
    "wrapped",
]

PERIODS = 16
"""For how many periods gains are held, if nothing else is asked."""

COUNT = "sampling periods since the last sample used"


@dataclass(frozen=True)
class Field:
    """A number of the state: its name there, what it is, and its first value."""

    name: str
    meaning: str
    value: float


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
    counter: Field | None = None
    """The state's count of periods since the last sample used, where the period is fixed."""
    since: str = ""
    """What it was before the correction."""

    @classmethod
    def of(cls, held: Held, move: Move, names: Names, counter: Field | None) -> Gains:
        """Of the move that corrects."""
        used = move.used
        columns = tuple(i for i, name in enumerate(held.named(0)) if name in used)
        number = f"_{held.number}" if held.number else ""
        row = names.local(f"gains{number}")
        periods = names.local(f"{'row' if counter else 'periods'}{number}")
        since = names.local(f"since{number}") if counter else ""
        return cls(held, columns, row, periods, counter, since)

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
    fixed: float | None = None
    """The length of every period [s], if it is fixed."""
    start: Move | None = None
    """The start from first samples, if the law has one."""

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
    def counters(self) -> tuple[Field, ...]:
        """Counts of periods, whole numbers of the state."""
        return tuple(gains.counter for gains in self.gains if gains.counter)

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
        if verb == "start":
            return (
                f"In place of the initial memory: the same with its estimate at {sample}, the "
                "first, which is then taken as all others are; a start far from it has no peak."
            )
        control = _list("input", self.words.controls)
        at = any("t" in move.used for move in self.moves)
        if not self.is_current:
            taken = f"{sample} and {control}" if control else sample
            return f"Take {taken} at time t [s]; advance by {self._length}{self._told_times('dt')}."
        if verb == "correct":
            told = (
                f"Use the present {sample}: the estimate is then that of its time. The correction "
                f"covers the time since the last sample used{self._told_times('it')}."
            )
            if self.periods is not None:
                told += " If it is not, the next correction covers the time from this call on."
            return told + " The first sample only starts the law." * self.closes
        under = f", under {control} applied in it" if control else ""
        if verb == "predict":
            begins = f", from time t [s]{under}" if at else under
            then = " The estimate moves when a sample ends the period." if self.closes else ""
            of = "length dt [s]" if self.fixed is None else self._length
            return f"Predict over the coming period of {of}{begins}.{then}"
        length = ["dt [s]"] * (self.fixed is None)
        belong = [*self.words.controls, *length, "t [s], the time of its beginning,"]
        return (
            f"One call for each sample: predict over the period that has just ended, then correct "
            f"by the present {sample}. {_and(belong)} to the period that has ended; the first call "
            "only corrects and does not use them."
        )

    @property
    def _length(self) -> str:
        """The length of a period."""
        return "dt [s]" if self.fixed is None else f"{number(self.fixed, self.precision)} s"

    def _told_times(self, which: str) -> str:
        """For which times there are corrections."""
        if self.periods is None:
            return ""
        return f"; {which} must be {self.told_periods}, else the sample is not used"

    @property
    def told_periods(self) -> str:
        """The times that gains are held for."""
        return _told_periods(self.periods)

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
                if gains.counter:
                    condition += f" && {sample} && {gains.since} > 0"
                else:
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
    fixed_dt: float | None = None,
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
    fixed_dt : float, optional
        The length of every period [s]: no argument then, and what depends on it is constant.
    """
    spec, current = observer.spec, observer._core.is_current
    if model_of(spec).get("table", {}) is None:
        raise HgoError(
            "the model is made of Python callables that could not be compiled: an export must be of"
            " operations; write its equations as expressions"
        )
    real = PRECISIONS[precision]
    fixed = None if fixed_dt is None else check_fixed(observer, real, fixed_dt, dt)
    times, held = held_gains(spec, real, dt, periods, fixed)
    if precision == "single":
        _check_single(observer)
    entries = memory_words(observer)
    memory = [i for i, (_, meaning) in enumerate(entries) if meaning != UNUSED]
    verbs = ("correct", "predict") if current else ("step",)
    traced = {verb: Traced.of(spec, verb, precision, memory, fixed) for verb in verbs}
    # the time of a correction whose periods are counted is no number of the state
    counted = [of.elapsed for of in held if of.elapsed is not None and fixed is not None]
    kept = [i for i in memory if i not in counted]
    moves = tuple(
        (Traced.of(spec, verb, precision, kept, fixed) if counted else of).move(counted)
        for verb, of in traced.items()
    )
    names = Names(names_of_export(name))
    words = words_of(observer, names, counted)
    counters: dict[int | None, Field] = {
        i: _counter(observer, i, words.memory[i], times) for i in counted
    }
    words = replace(words, memory=tuple(words.memory[i] for i in kept))
    meanings = [entries[i][1] for i in kept]
    parameters = parameters_of(spec)
    return Program(
        name,
        real,
        tuple(map(Field, words.memory, meanings, map(float, observer.memory[kept]))),
        tuple(
            Field(word, "parameter" if word == own else f"parameter {own}", value)
            for word, (own, value) in zip(words.parameters, parameters, strict=True)
        ),
        words,
        names,
        moves,
        _times(entries, kept),
        description(observer, precision, dt, times, words, fixed),
        vector(
            Recursion(
                observer,
                traced,
                memory,
                [value for _, value in parameters],
                real,
                times,
                held,
                _times(entries, memory),
                [memory.index(i) for i in kept],
                fixed,
            ),
            log,
            fixed or dt or period_of(observer),
        ),
        times,
        tuple(Gains.of(chain, moves[0], names, counters.get(chain.elapsed)) for chain in held),
        spec["kind"] == "reduced-order",
        fixed,
        _start(observer, precision, kept),
    )


def _times(entries: Sequence[tuple[str, str]], memory: Sequence[int]) -> tuple[int, ...]:
    """Where what is written of the memory holds times."""
    return tuple(
        place for place, i in enumerate(memory) if entries[i][1].startswith((ELAPSED, SINCE))
    )


def _counter(observer: Observer, entry: int, word: str, times: Periods | None) -> Field:
    """The count of periods in the place of a time of the memory."""
    elapsed = float(observer.memory[entry])
    count = times.count(elapsed) if times else 0
    check(
        count > 0 or elapsed == 0.0,
        "observer.memory",
        elapsed,
        f"0 or {_told_periods(times)} in entry {entry}, the time since the last sample used",
        "export after a sample was used, or after observer.reset()",
    )
    return Field(word, COUNT, count)


def _told_periods(periods: Periods | None) -> str:
    """The times that gains are held for."""
    if periods is None:
        return "any"
    length = f"{number(periods.dt, periods.precision)} s"
    most = periods.most
    return f"1 to {most} periods of {length}" if most > 1 else f"one period of {length}"


def _start(observer: Observer, precision: str, memory: Sequence[int]) -> Move | None:
    """The start from first samples; none of a law that has no such start."""
    begun = observer._core.begin(observer.memory, np.full(observer.n_y, np.nan))
    return None if begun is None else Traced.of(observer.spec, "start", precision, memory).move()


def _check_single(observer: Observer) -> None:
    """Refuse numbers that single precision does not hold."""
    real, spec = PRECISIONS["single"].real, observer.spec
    given = [(f"parameter {word}", value) for word, value in parameters_of(spec)]
    given += [
        (f"memory {word}", float(value))
        for (word, _), value in zip(memory_words(observer), observer.memory, strict=True)
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


def period_of(observer: Observer) -> float:
    """A sampling period [s] that is surely stable, or the law's own."""
    try:
        limit = observer.step_limit()
        period = float(limit.period or limit.dt / 10.0)
    except HgoError:
        return 1e-3
    return period if np.isfinite(period) else 1e-3  # zoh and bilinear are stable at any step
