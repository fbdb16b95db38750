"""The time column: from what was recorded to seconds, and times that cannot be."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction
from pathlib import Path
from typing import NoReturn

import numpy as np

from hgo_rs import times
from hgo_rs.errors import check_choice, printable
from hgo_rs.logs.table import Columns, DataError, Table, refuse
from hgo_rs.observers import StochasticApproximation
from hgo_rs.times import RESETS, UNITS, Ticks, check_period, span

WINDOW = 1000
"""Steps whose median is looked at, all along a log, however it is cut into chunks."""


class Clock:
    """Times in seconds, block by block; it remembers where the block before ended."""

    def __init__(
        self,
        path: Path,
        time: Columns | None,
        dt: float | None,
        unit: str | None,
        resets: str,
        schedule: StochasticApproximation | None,
    ) -> None:
        if dt is not None:
            dt = check_period(dt, error=DataError)
        if schedule is not None and (time is not None or dt is not None):
            raise DataError("schedule: give it alone, in place of the time column and dt")
        if time is None and dt is None and schedule is None:
            raise DataError("name the time column, or give dt for a log without one")
        if unit is not None:
            check_choice("unit", unit, tuple(UNITS))
            if time is None:
                raise DataError("unit: it is the time column's, and none is named")
        self.split = check_choice("resets", resets, RESETS) == "split"
        self.path, self.time, self.dt, self.schedule = path, time, dt, schedule
        self.unit = unit
        self.assumed = False  # the unit is neither given nor said by the name
        self.remarks: tuple[str, ...] = ()
        self.length: Fraction | None = None  # of a tick [s]
        self.origin: Fraction | None = None  # what is subtracted [s]
        self._count = 0  # samples of the piece so far
        self._begin = math.nan  # of the piece
        self._pieces = 0
        self._rows = 0  # of the log
        self._last: tuple[float, str] | None = None
        self._next = 0.0  # of the schedule
        self._steps = np.empty(0)  # those that no window of `_check_steps` holds yet
        self._windows = 0
        self._first = math.nan  # of the log [s], from the recorded origin
        self._grain = 0.0  # what the recorded numbers resolve [s]
        self._sample, self._zero = 0, math.nan  # of the piece, where dt is given
        self._grid, self._repeats = math.inf, False  # least step; whether times are repeated

    def __call__(self, table: Table) -> tuple[np.ndarray, tuple[int, ...]]:
        """Times of the block, and where pieces begin in it."""
        if self.time is None:
            t = self._made(len(table))
            starts: tuple[int, ...] = () if self._count else (0,)
            self._count += len(table)
            return t, starts
        assert isinstance(self.time, str)
        found = self.ticks(table)
        self.learn(found, table)
        t = self.seconds(found)
        told = f"the time {self.time!r} is missing or infinite; remove the row, or give dt for time"
        refuse(table, self.path, ~np.isfinite(t), told)
        starts = self._starts(t, table)
        if self.dt is not None:
            t = self._regular(t, starts, table)
        return t, starts

    def _made(self, count: int) -> np.ndarray:
        if self.schedule is None:
            assert self.dt is not None
            return self.dt * np.arange(self._count, self._count + count)
        law = self.schedule
        k = np.arange(self._count, self._count + count)
        steps = law.alpha * law.epsilon * (1.0 + k / law.k0) ** -law.p
        made = np.cumsum(np.r_[self._next, steps])
        self._next = float(made[-1])
        return np.asarray(made[:-1])

    # --- from ticks to seconds ------------------------------------------------------------------

    def ticks(self, table: Table) -> Ticks:
        """The column as whole ticks."""
        assert isinstance(self.time, str)
        found = times.ticks(table.columns[self.time])
        if isinstance(found, str):
            raise DataError(f"{self.path}: column {self.time!r} {found}")
        return found

    def learn(self, found: Ticks, table: Table) -> None:
        """The length of a tick, from the first block that has one."""
        if self.length is not None or found.missing.all():
            return
        assert isinstance(self.time, str)
        if found.length is not None:
            self.length = found.length
            if self.unit is not None:
                self.remarks += (f"times {self.time!r} have a unit of their own, not {self.unit}",)
                self.unit = None
        else:
            self.length = UNITS[self._found_unit(found, table)]
        self._first = float(found.first() * self.length)
        if found.length is None and abs(found.first() * self.length) >= times.FARTHEST:
            self._refuse_unit(
                f"the time {self.time!r} begins at {found.first()}, taken in {self.unit}: "
                f"{span(self._first)} from its origin"
            )
        values = table.columns[self.time]
        if values.dtype.kind == "f":
            there = np.abs(values[np.isfinite(values)])
            self._grain = float(np.spacing(there.max())) * float(self.length)

    def _found_unit(self, found: Ticks, table: Table) -> str:
        assert isinstance(self.time, str)
        label = self.time
        if times.named_unit(told := f"t [{table.units.get(label, '')}]")[0]:
            label = told
        if self.unit is not None:
            named, _ = times.named_unit(label)
            if named not in (None, self.unit):
                told = f"times {self.time!r} are taken in {self.unit}, though the name says {named}"
                self.remarks += (told,)
        else:
            self.unit, why = times.named_unit(label)
            if why:
                raise DataError(
                    f"{self.path}: the unit of the time {self.time!r} is unknown: {why}; give "
                    f"unit = one of {', '.join(UNITS)}, or dt in place of the time"
                )
            if self.unit not in (None, "s"):
                self.remarks += (f"times {self.time!r} are in {self.unit}, as the name says",)
        if self.unit is None:
            self.assumed = True
            self.unit = times.unix_unit(found.first())
            if self.unit not in (None, "s"):
                self.remarks += (
                    f"times {self.time!r} are read as Unix times in {self.unit} (unit says "
                    "another)",
                )
        self.unit = self.unit or "s"
        return self.unit

    def begin(self, found: Ticks) -> tuple[Fraction, bool]:
        """The first time [s], exactly, and whether times must count from about there."""
        assert self.length is not None
        return found.first() * self.length, found.is_date or abs(found.first()) >= times.COUNTED

    def seconds(self, found: Ticks) -> np.ndarray:
        """Seconds, NaN where missing; they count from the origin, set with the first block."""
        if self.length is None:
            return np.full(len(found.whole), np.nan)
        if self.origin is None:
            first, needed = self.begin(found)
            self.origin = first if needed else Fraction(0)
            if needed:
                assert isinstance(self.time, str)
                begin = moment(first, found, self)
                self.remarks += (f"t counts from {printable(self.time)} = {begin}",)
        return found.seconds(self.length, self.origin)

    # --- what cannot be -------------------------------------------------------------------------

    def _starts(self, t: np.ndarray, table: Table) -> tuple[int, ...]:
        """Where pieces begin; refuses time that stands still or runs back."""
        starts = []
        if self._last is None:
            starts.append(0)
            self._begin = float(t[0])
            self._pieces = 1
        before = np.r_[t[:1] - 1.0 if self._last is None else self._last[0], t[:-1]]
        back = np.flatnonzero(t <= before if self.dt is None else t < before).tolist()
        inner = np.diff(t) if back else np.empty(0)
        newest_first = len(inner) > 1 and bool(np.mean(inner < 0.0) > 0.75)
        usual = float(np.median(inner)) if len(inner) > 1 else math.inf
        since = -self._count  # where the piece began, in rows of this block
        for k in back:
            fell = before[k] - t[k]
            reset = t[k] - self._begin <= 0.1 * (before[k] - self._begin) and fell > 0.0
            reset = reset and k - since > 1 and not newest_first  # one row is no piece
            bits = self._wrapped(fell, usual)
            if not (reset and self.split):
                remedy = self._remedy(fell, bits, reset, newest_first) if fell else _repeated(t)
                where = table.where(k - 1) if k else self._last[1] if self._last else ""
                raise DataError(
                    f"{self.path}, {table.where(k)}: time {t[k]:.12g} does not come after "
                    f"{before[k]:.12g} ({where}); {remedy}"
                )
            if bits:
                self.remarks += (
                    f"{table.where(k)}: a counter of {bits} bits began again; the pieces of "
                    f"{self.time!r} have no origin in common",
                )
            starts.append(k)
            self._pieces += 1
            self._begin, since = float(t[k]), k
        self._count = len(t) - since
        self._rows += len(t)
        self._last = (float(t[-1]), table.where(len(t) - 1))
        steps = t - before
        self._repeats = self._repeats or bool(np.any(steps == 0.0))
        steps[starts] = 0.0
        self._grid = min(self._grid, float(np.min(steps, initial=math.inf, where=steps > 0.0)))
        self._check_steps(steps, table)
        return tuple(starts)

    def _wrapped(self, fell: float, usual: float) -> int | None:
        """The bits of a counter that came to its end where the time fell."""
        ticks = float(self.length or 1)
        return times.wrapped(fell / ticks, usual / ticks) if 0.0 < usual < fell else None

    def _remedy(self, fell: float, bits: int | None, reset: bool, newest_first: bool) -> str:
        if newest_first:
            return "the log runs backwards, newest first: sort it by time"
        if bits:
            return (
                f"a counter of {bits} bits began again: make it run on, for example by "
                f"numpy.unwrap(column, period=2**{bits})"
            )
        if reset:
            return (
                "the clock was set back: cut the log there, or take it as pieces with "
                'resets = "split"'
            )
        return "time must increase: sort the log or remove repeated rows"

    def _check_steps(self, steps: np.ndarray, table: Table) -> None:
        """Refuse steps that no record has; 0 where a piece begins."""
        within = steps[steps > 0.0]
        if self._grain and len(within):
            usual = float(np.median(within))
            if self.dt is None and self._grain > 1e-2 * usual:
                self.remarks += (
                    f"times {self.time!r} have a resolution of only {self._grain:.3g} s at a "
                    f"median step of {usual:.3g} s; give dt in their place for exact times",
                )
            self._grain = 0.0
        waiting = np.r_[self._steps, within]
        full = len(waiting) // WINDOW * WINDOW
        doubtful = full and (waiting.min() < times.FAST or waiting.max() >= times.SLOW)
        if doubtful:  # else every median lies between
            middle = WINDOW // 2
            medians = np.partition(waiting[:full].reshape(-1, WINDOW), middle, axis=1)[:, middle]
            self._check_median(float(medians.min()))
            self._check_median(float(medians.max()))
        self._steps = waiting[full:]
        self._windows += full // WINDOW
        k = int(np.argmax(steps))
        if steps[k] >= times.LONGEST:
            self._check_median(float(np.median(within)))
            other = f", or give a unit other than {self.unit}" if self.unit else ""
            raise DataError(
                f"{self.path}, {table.where(k)}: the time {self.time!r} leaps by "
                f"{span(steps[k])}, as if the clock were set; cut the log there{other}"
            )

    def _check_median(self, median: float) -> None:
        """Refuse a usual step that no record has, or that seconds nobody spoke of would make."""
        days = times.unix_days(self._first) if self.assumed and median < times.FAST else None
        if days:
            raise DataError(
                f"{self.path}: the times {self.time!r} begin at {self._first:.9g} with a median "
                f"step of {median:.3g}, a {days} date in days, taken in s; say unit = one of s, d"
            )
        if median < (times.SLOW if self.assumed else times.SLOWEST):
            return
        told = f"the median step of the time {self.time!r} is {span(median)}"
        if self.length is not None and self.unit is None:  # dates
            raise DataError(f"{self.path}: {told}; give dt in place of the time")
        self._refuse_unit(f"{told}, taken in {self.unit}", median)

    def _refuse_unit(self, told: str, step: float | None = None) -> NoReturn:
        if self.assumed:
            told += ", which neither unit nor the name says"
        guess = f"{times.likely(step / float(self.length))}; " if step and self.length else ""
        kept = "say unit = one of " + ", ".join(UNITS)
        if not self.assumed:
            kept = "say another unit, or give dt in place of the time"
        raise DataError(f"{self.path}: {told}; {guess}{kept}")

    def finish(self) -> None:
        """What is wrong with the whole log."""
        if self.time is None or self._last is None:
            return
        if self._repeats and math.isinf(self._grid):
            raise DataError(
                f"{self.path}: the time {self.time!r} is constant; leave it out, dt is enough"
            )
        if len(self._steps) >= (WINDOW // 10 if self._windows else 1):
            self._check_median(float(np.median(self._steps)))
        if self._pieces > 1 and self._count < 2:
            raise DataError(
                f"{self.path}, {self._last[1]}: the last piece has 1 row, an observer needs at "
                "least 2; remove the row"
            )
        if self._pieces >= 10 and self._rows < 5 * self._pieces:
            raise DataError(
                f"{self.path}: {self._pieces} pieces of {self._rows / self._pieces:.3g} rows on "
                "average are no resets of a clock; sort the log by time"
            )

    def _regular(self, t: np.ndarray, starts: tuple[int, ...], table: Table) -> np.ndarray:
        """Exact multiples of dt from the begin of each piece on."""
        assert self.dt is not None
        coarse = self._repeats and self._grid > 1.5 * self.dt
        within = self._grid if coarse else 0.5 * self.dt
        if coarse and math.isfinite(within):
            told = (
                f"times {self.time!r} have a resolution of only {within:.3g} s; samples are dt "
                "apart"
            )
            self.remarks += (told,) if told not in self.remarks else ()
        out = np.empty_like(t)
        edges = [*starts, len(t)] if 0 in starts else [0, *starts, len(t)]
        for a, b in itertools.pairwise(edges):
            if a in starts:
                self._sample, self._zero = 0, float(t[a])
            out[a:b] = self._zero + self.dt * np.arange(self._sample, self._sample + b - a)
            off = np.abs(t[a:b] - out[a:b]) > within * (1.0 + 1e-9)
            if off.any():
                k = a + int(np.argmax(off))
                raise DataError(
                    f"{self.path}, {table.where(k)}: time {t[k]:g} s is not sample "
                    f"{self._sample + k - a} of a record with dt = {self.dt:g} s ({out[k]:g} s); "
                    "leave dt out to use the recorded times"
                    + (f", or give a unit other than {self.unit}" if self.assumed else "")
                )
            self._sample += b - a
        return out


def _repeated(t: np.ndarray) -> str:
    """What to do about times that stand still: in some rows, or since they are coarse."""
    steps = np.diff(t)
    moves = np.flatnonzero(steps > 0.0)
    if len(moves) > 1 and np.all(steps >= 0.0) and len(moves) < 0.9 * len(steps):
        usual = (t[moves[-1]] - t[moves[0]]) / (moves[-1] - moves[0])
        return (
            f"the times have a resolution of only {steps[moves].min():.3g} s; give dt, the "
            f"sampling period, on average {usual:.4g} s"
        )
    return "time must increase: remove repeated rows, or write times with all their digits"


def moment(first: Fraction, found: Ticks, clock: Clock) -> str:
    """A time as its column writes it."""
    assert clock.length is not None
    nanoseconds = math.floor(first / UNITS["ns"])
    if found.is_date and abs(nanoseconds) < 2**63:
        return str(np.datetime64(nanoseconds, "ns"))
    if found.length is not None and not found.is_date:
        return f"{float(first):.12g} s"
    count = first / clock.length
    return str(count) if count.denominator == 1 else f"{float(count):.17g}"
