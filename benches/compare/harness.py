"""What a workload is, how its implementations are compared, and how they are timed."""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Call = Callable[[], Any]
"""Does the whole work once and returns its result."""

SEED = 1
TWIN = "NumPy"
"""The implementation that the others are compared with: the package's NumPy reference."""
OURS = "ours"
STANDARD_ERRORS = 4.0
"""Allowed between the means of implementations that draw numbers of their own."""


class LeftOut(Exception):
    """An implementation is not there, for the reason given."""


class NotInstalled(LeftOut):
    """It needs something that this machine does not have."""


class Disagreement(Exception):
    """An implementation computes something else."""


def need(module: str) -> Any:
    """An optional module."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != module.split(".")[0]:
            raise
        raise NotInstalled(f"{error.name} is not installed") from None


@dataclass(frozen=True)
class Size:
    """Runs and steps a run."""

    runs: int
    steps: int


def around(centre: Sequence[float], spread: Sequence[float], runs: int) -> Array:
    """Starts that differ from run to run, (runs, n): up to ``spread`` away from ``centre``.

    Every implementation is handed these numbers when it runs. Starts that a compiler knows let it
    move what is alike in all runs once for many of them, which no study that varies them can.
    """
    away = np.asarray(spread, dtype=np.float64)
    drawn = np.random.default_rng(SEED).uniform(-away, away, (runs, len(centre)))
    return np.asarray(np.asarray(centre, dtype=np.float64) + drawn)


def in_seconds(window: tuple[int, int], dt: float) -> tuple[float, float]:
    """A window of steps in seconds."""
    return window[0] * dt, window[1] * dt


@dataclass(frozen=True)
class Implementation:
    """One way to do a workload's work.

    ``prepare(size, threads)`` returns the call that is timed, with everything compiled or loaded.
    ``share``: the part of the steps that is timed, for the slow.  ``parallel``: it can use threads.
    ``independent``: it draws random numbers of its own, so that it agrees in the mean alone.
    ``bits``: the implementation whose result it has to have, bit for bit.
    """

    name: str
    prepare: Callable[[Size, int], Call]
    share: float = 1.0
    parallel: bool = True
    independent: bool = False
    bits: str | None = None


def as_given(result: Any) -> Array:
    """A result that is the statistics already."""
    return np.asarray(result, dtype=np.float64)


def processor_time(call: Call, calls: int) -> float:
    """Nanoseconds that a call keeps processors busy, of all threads of this process."""
    start = time.process_time_ns()
    for _ in range(calls):
        call()
    return (time.process_time_ns() - start) / calls


def wall_time(call: Call, calls: int) -> float:
    """Nanoseconds until a call returns."""
    start = time.perf_counter_ns()
    for _ in range(calls):
        call()
    return (time.perf_counter_ns() - start) / calls


@dataclass(frozen=True)
class Workload:
    """The same work for several implementations.

    ``statistics`` of a result, (runs, quantities), are what has to agree to ``tolerance``, relative
    to each quantity's largest value; they are taken outside the timed call.  ``case`` tells
    workloads of one name apart.  ``clock`` gives the nanoseconds of a call where the harness cannot
    take them.  ``tell`` says something of a result, beside its time.  ``optional``: it is done only
    when it is asked for by name.
    """

    name: str
    title: str
    implementations: tuple[Implementation, ...]
    full: Size
    quick: Size
    check: Size
    case: str = ""
    tolerance: float = 1e-9
    parallel: bool = True
    statistics: Callable[[Any], Array] = as_given
    clock: Callable[[Call, int], float] | None = None
    tell: Callable[[Any], str] | None = None
    optional: bool = False

    @property
    def key(self) -> str:
        """Name and case."""
        return f"{self.name}, {self.case}" if self.case else self.name

    def size(self, implementation: Implementation, *, quick: bool) -> Size:
        """What is timed."""
        size = self.quick if quick else self.full
        return Size(size.runs, max(1, round(size.steps * implementation.share)))


def distance(ours: Array, theirs: Array) -> float:
    """Largest difference, relative to each quantity's largest value; infinite for NaN or shape."""
    if ours.shape != theirs.shape or not (np.isfinite(ours).all() and np.isfinite(theirs).all()):
        return math.inf
    scale = np.abs(theirs).max(axis=0)
    difference = np.abs(ours - theirs).max(axis=0)
    return float(np.max(difference / np.where(scale > 0.0, scale, 1.0)))


def standard_errors(ours: Array, theirs: Array) -> float:
    """Largest difference of the means over the runs, in standard errors; infinite for NaN."""
    variance = ours.var(axis=0) / len(ours) + theirs.var(axis=0) / len(theirs)
    apart = np.abs(ours.mean(axis=0) - theirs.mean(axis=0)) / np.sqrt(variance)
    return float(np.max(apart)) if np.isfinite(apart).all() else math.inf


def differing(ours: Array, theirs: Array) -> int:
    """How many numbers differ in a bit; all of them for another shape."""
    if ours.shape != theirs.shape:
        return max(ours.size, theirs.size)
    a, b = (np.ascontiguousarray(one, dtype=np.float64).view(np.uint64) for one in (ours, theirs))
    return int(np.count_nonzero(a != b))


@dataclass(frozen=True)
class Checked:
    """What became of each implementation before the timing, by name."""

    distances: dict[str, float]
    missing: dict[str, str]
    failed: dict[str, str]
    told: dict[str, str] = field(default_factory=dict)


class Bench:
    """A workload in this process, on a number of threads.

    ``wall``: its samples are of the time that passes, not of the processor's.
    """

    def __init__(
        self, workload: Workload, threads: int, *, quick: bool, wall: bool = False
    ) -> None:
        self.workload, self.threads, self.quick = workload, threads, quick
        self.seconds = 0.01 if quick else 0.05  # a sample lasts at least as long
        self.clock = workload.clock or (wall_time if wall else processor_time)
        self._ready: dict[str, tuple[Call, int]] = {}
        self._first: dict[Size, tuple[str, Array]] = {}
        self._of_all: dict[tuple[str, Size], Array] = {}

    def implementations(self) -> list[Implementation]:
        """Those that can use the threads."""
        return [i for i in self.workload.implementations if i.parallel or self.threads == 1]

    def check(self, only: list[str] | None = None) -> Checked:
        """Let all do a small piece of the work and compare with the twin, or with the first."""
        results: dict[str, Array] = {}
        done = Checked({}, {}, {})
        for one in self.implementations():
            if only is not None and one.name not in only:
                continue
            try:
                result = one.prepare(self.workload.check, self.threads)()
                results[one.name] = self.workload.statistics(result)
                if self.workload.tell is not None:
                    done.told[one.name] = self.workload.tell(result)
            except LeftOut as error:
                done.missing[one.name] = str(error)
            except Exception as error:
                done.failed[one.name] = f"{type(error).__name__}: {error}"
        for name, result in results.items():
            against = TWIN if TWIN in results else next(iter(results))
            try:
                done.distances[name] = self.agree(name, result, against, results[against])
                self.same_bits(name, result, results)
            except Disagreement as error:
                done.failed[name] = str(error)
        return done

    def agree(self, name: str, result: Array, other: str, theirs: Array) -> float:
        """How far two results are apart; raises `Disagreement` if too far."""
        independent = any(i.independent for i in self.implementations() if i.name in (name, other))
        if independent and name != other:
            apart, allowed, unit = (
                standard_errors(result, theirs),
                STANDARD_ERRORS,
                "standard errors",
            )
        else:
            apart, allowed, unit = distance(result, theirs), self.workload.tolerance, "relative"
        if not apart <= allowed:
            raise Disagreement(
                f"{self.workload.key}: {name} differs from {other} by {apart:.3g} ({unit}); "
                f"allowed are {allowed:g}"
            )
        return apart

    def same_bits(self, name: str, result: Array, results: Mapping[str, Array]) -> None:
        """Compare with the result of which this one has to have the bits, where that is there."""
        other = self.implementation(name).bits
        if other is None or other not in results:
            return
        count = differing(result, results[other])
        if count:
            raise Disagreement(
                f"{self.workload.key}: {name} must have the bits of {other}; "
                f"{count} of {result.size} numbers have others"
            )

    def implementation(self, name: str) -> Implementation:
        """The one of that name."""
        return next(i for i in self.workload.implementations if i.name == name)

    def warm(self, name: str) -> Size:
        """Prepare the timed work, do it, compare, and find how many calls a sample takes."""
        one = self.implementation(name)
        size = self.workload.size(one, quick=self.quick)
        call = one.prepare(size, self.threads)
        result = self.workload.statistics(call())
        other, theirs = self._first.setdefault(size, (name, result))
        self.agree(name, result, other, theirs)
        self._of_all[name, size] = result
        self.same_bits(name, result, {n: r for (n, s), r in self._of_all.items() if s == size})
        once = max(self.clock(call, 1) * 1e-9, 1e-6)
        self._ready[name] = call, max(1, math.ceil(self.seconds / once))
        return size

    def sample(self, name: str) -> float:
        """Nanoseconds a run and step."""
        call, calls = self._ready[name]
        size = self.workload.size(self.implementation(name), quick=self.quick)
        return self.clock(call, calls) / (size.runs * size.steps)
