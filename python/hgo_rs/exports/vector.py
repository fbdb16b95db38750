"""The test vector of an export: the core's own steps over samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, check
from hgo_rs.exports.expressions import LENGTH
from hgo_rs.exports.held import TOLERANCE, Held, Periods
from hgo_rs.exports.precision import Precision
from hgo_rs.exports.traced import Traced
from hgo_rs.observers import Observer, records
from hgo_rs.signals import of_log

__all__ = ["OTHER_PERIOD", "STATUS", "UNDEFINED", "Log", "Recursion", "Row", "vector"]

Array = npt.NDArray[np.float64]
Log = tuple[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike]

STATUS = ("UPDATED", "PREDICTED", "UNDEFINED", "OTHER_PERIOD")
"""What a call made of its sample, by number; the last one of laws whose gains are held."""

UPDATED, PREDICTED, UNDEFINED, OTHER_PERIOD = range(len(STATUS))


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
class Recursion:
    """The moves of an observer as its export makes them, by the tables, each against the core."""

    observer: Observer
    traced: Mapping[str, Traced]
    memory: Sequence[int]
    """Entries of the observer's memory that are used."""
    parameters: Sequence[float]
    precision: Precision
    periods: Periods | None
    held: tuple[Held, ...]
    elapsed: tuple[int, ...]
    """Where these entries hold times."""
    shown: Sequence[int]
    """Which of them stand in a row."""
    fixed: float | None
    """The length of every period [s], if it is fixed."""

    @property
    def is_current(self) -> bool:
        """Whether a step is a prediction and a correction."""
        return "step" not in self.traced

    def counts(self, z: Array, y: Array, dt: float) -> list[int]:
        """For each chain whose gains are held, how many periods its correction is for."""
        return [
            0 if self.periods is None else self.periods.count(self._time(held, z, y, dt))
            for held in self.held
        ]

    def refuses(self, z: Array, y: Array, dt: float) -> bool:
        """Whether a sample is not used because there are no gains for its time."""
        counts = self.counts(z, y, dt)
        times = [self._time(held, z, y, dt) for held in self.held]
        return any(count == 0 and time > 0.0 for count, time in zip(counts, times, strict=True))

    def moved(self, verb: str, z: Array, y: Array, u: Array, t: float, dt: float) -> Array:
        """The memory after a move.

        Raises
        ------
        HgoError
            A move of the core that is not that of the table.
        """
        counts = self.counts(z, y, dt)
        gains = {
            name: value
            for held, count in zip(self.held, counts, strict=True)
            for name, value in held.named(count).items()
        }
        numbers = {"z": z, "y": y, "u": u, "p": np.asarray(self.parameters)}
        values = {"t": float(self.precision.real(t)), LENGTH: dt, **gains}
        made = self.traced[verb].evaluate(numbers, values)
        if self.precision.name == "double" and np.isfinite(made).all():
            core = self._by_core(verb, z, y, u, t, dt, counts)
            same = core is None or np.array_equal(core[0][self.memory], made)
            if not same or (core is not None and core[1] == UNDEFINED):
                raise HgoError(
                    f"{verb} at t = {t:g} s of the test vector (y = {y.tolist()}) is not that of "
                    "the observer's table: this law cannot be exported"
                )
        return made

    def _time(self, held: Held, z: Array, y: Array, dt: float) -> float:
        """The time that a chain's correction is for; none where its sample is missing."""
        if held.elapsed is None:
            return dt
        return float(z[held.elapsed]) if np.isfinite(y[held.sample]) else 0.0

    def _by_core(
        self, verb: str, z: Array, y: Array, u: Array, t: float, dt: float, counts: list[int]
    ) -> tuple[Array, int] | None:
        """The same by the core: the whole memory, and the status. None where the core has other
        gains, those of a step that is no whole periods, or is but for rounding.
        """
        core = self.observer._core
        whole = np.zeros(core.memory_len)
        whole[self.memory] = z
        nothing = np.full(len(y), np.nan)
        times = [0.0, *(self.periods.lengths if self.periods else ())]
        if verb == "predict":
            if self.observer.spec["kind"] == "reduced-order" and whole[-1] > 0.0:
                whole, _ = core.correct(whole, nothing, t)  # the period before, left open
            return core.advance(whole, nothing, u, t, dt)
        if verb == "correct":
            for held, count in zip(self.held, counts, strict=True):
                if np.isfinite(y[held.sample]):
                    whole[held.elapsed] = times[count]
            return core.correct(whole, y, t)
        if any(times[count] != dt for count in counts):
            return None
        return core.step(whole, y, u, t, dt)


def vector(moves: Recursion, log: Log | None, period: float) -> tuple[Row, ...]:
    """Steps over a log, or over samples made up for this period [s]."""
    real = moves.precision.real
    if log is None:
        t, steps, y, u = _made_up(moves.observer, period, moves.periods, moves.fixed)
    else:
        t, steps, y, u = _given(moves.observer, log, moves.fixed)
    y, u = y.astype(real).astype(float), u.astype(real).astype(float)
    rows: list[Row] = []
    memory: Array = np.asarray(moves.observer.memory, dtype=float)[moves.memory]
    for k in range(len(steps)):
        # with current timing a step is over the period that ends with its sample
        i = max(k - 1, 0) if moves.is_current else k
        at, dt = float(t[i]), float(real(steps[i]))
        after, status = memory, UPDATED if np.isfinite(y[k]).all() else PREDICTED
        if moves.is_current and k > 0:
            after = moves.moved("predict", memory, y[k], u[i], at, dt)
            if np.isfinite(after).all():
                memory = after
            else:  # the estimate is held, and time goes on
                counts = np.isin(np.arange(len(memory)), moves.elapsed) & np.isfinite(after)
                memory = np.where(counts, after, memory)
        if np.isfinite(after).all():
            now = at + dt if moves.is_current and k > 0 else at
            verb = "correct" if moves.is_current else "step"
            if moves.refuses(memory, y[k], dt):
                status = OTHER_PERIOD
            after = moves.moved(verb, memory, y[k], u[i], now, dt)
        memory, status = (after, status) if np.isfinite(after).all() else (memory, UNDEFINED)
        shown = memory[moves.shown]
        sample, control, moved_to = (tuple(v.tolist()) for v in (y[k], u[i], shown))
        rows.append(Row(at, dt, sample, control, status, moved_to))
    return tuple(rows)


def _made_up(
    observer: Observer, period: float, periods: Periods | None, fixed: float | None
) -> tuple[Any, Any, Any, Any]:
    """101 samples of slow sines at uneven times, with a gap; where gains are held at even ones,
    with a period of double length and one that is no whole number of them; at even ones where the
    period is fixed.
    """
    k = np.arange(101.0)
    if fixed is not None:
        t, steps = fixed * k, np.full(100, fixed)
    elif periods is None:
        t = period * (k + 0.2 * np.sin(k))
        steps = np.diff(t)
    else:
        steps = np.full(100, periods.dt)
        steps[20] *= 2.0
        steps[60] *= 1.37
        t = np.concatenate([[0.0], np.cumsum(steps)])
    phase = np.arange(observer.n_y) + 0.5
    y = 0.5 + 0.25 * np.sin(2.0 * np.pi * np.outer(k, 1.0 / (20.0 + phase)) + phase)
    y[40:45] = np.nan
    u = 0.1 * np.cos(np.outer(k, 0.05 + 0.02 * np.arange(observer.n_u)))
    return t, steps, y, u


def _given(observer: Observer, log: Log, fixed: float | None) -> tuple[Any, Any, Any, Any]:
    times, y, u = of_log(log)
    y = records.samples(y, observer.n_y)
    records.check_samples(y, observer.n_y)
    clock = records.clock(times, len(y))
    records.check_times(clock)
    t = clock * np.arange(len(y)) if isinstance(clock, float) else clock
    u = records.inputs(u if observer.n_u else None, len(y), observer.n_u)
    steps = np.diff(t)
    if fixed is not None:
        apart = np.abs(steps - fixed)
        check(
            np.all(apart <= TOLERANCE * fixed),
            "a step of log",
            float(steps[np.argmax(apart)]),
            f"fixed_dt = {fixed:g} s, the period of every call",
            "resample it, put NaN where a sample is missing, or leave log out",
        )
        steps = np.full(len(steps), fixed)
    return t, steps, y, u
