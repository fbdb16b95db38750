"""Gains that no table of operations computes: held in the source, for some times of a correction.

A placed correction (zoh, bilinear) of a low-power law is made by gains that depend on the time that
it is for and are found by iteration. The core computes them beforehand for 1, 2, ... periods; the
source counts the periods and takes the row. Where the period is fixed, the same is done for every
law whose gain does not move.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import accumulate, repeat
from typing import Any

import numpy as np

from hgo_rs import _core
from hgo_rs.design.discrete import CORRECTING
from hgo_rs.errors import DesignError, HgoError, check
from hgo_rs.exports.precision import Precision
from hgo_rs.observers import Observer
from hgo_rs.times import check_period

__all__ = ["TOLERANCE", "Held", "Periods", "check_fixed", "held_gains"]

TOLERANCE = 1e-5
"""How far, of itself, a time may be from whole periods: more than sums of them round, and less than
a clock of quartz is off."""


@dataclass(frozen=True)
class Periods:
    """The times that corrections are possible for: 1 to `most` periods of length `dt` [s]."""

    precision: Precision
    dt: float
    most: int

    @property
    def lengths(self) -> list[float]:
        """These times as a sum forms them, period by period [s]."""
        real = self.precision.real
        return [float(time) for time in accumulate(repeat(real(self.dt), self.most))]

    def count(self, time: float) -> int:
        """How many periods a time is; 0 if it is none of these. The source's own operations."""
        real = self.precision.real
        counted = real(time) / real(self.dt)
        among = real(0.5) < counted < real(self.most + 0.5)
        nearest = int(counted + real(0.5)) if among else 0
        return nearest if abs(counted - real(nearest)) <= real(TOLERANCE) * counted else 0


@dataclass(frozen=True)
class Held:
    """Gains of the corrections of one chain."""

    place: str
    """Name of the tables' inputs: gains are place[0], place[1], ..."""
    number: int
    """Of the chain from 1; 0 if it is the only one."""
    sample: int
    """Which sample corrects."""
    elapsed: int | None
    """Where the memory holds the time that a correction is for; None: it is a step's length."""
    rows: tuple[tuple[float, ...], ...]
    """For 0, 1, 2, ... periods. Those of 0 are 0: for no time, or for one that is none of these."""
    blocks: bool
    """Whether they are those of blocks, of a low-power or peaking-free law."""

    def named(self, periods: int) -> dict[str, float]:
        """The tables' inputs for a time of so many periods."""
        return {f"{self.place}[{i}]": gain for i, gain in enumerate(self.rows[periods])}

    def column(self, index: int) -> str:
        """What a gain is called: of state i; or of block i, with others where a level is met."""
        if not self.blocks:
            return f"k{index + 1}"
        part, i = divmod(index, len(self.rows[0]) // 4)
        return f"{('a', 'b', 'alone_a', 'alone_b')[part]}{i + 1}"


def check_fixed(
    observer: Observer, precision: Precision, fixed_dt: object, dt: float | None
) -> float:
    """The period that an export is for [s], in its precision.

    Raises
    ------
    HgoError
        One that is no period, that single precision does not hold, or another `dt` beside it.
    DesignError
        One at or beyond the limit of a stable step, as `run` refuses it.
    """
    remedy = "give the sampling period [s], for example 1e-3"
    fixed = check_period(fixed_dt, "fixed_dt", remedy=remedy)
    check(
        dt is None or dt == fixed,
        "dt",
        dt,
        f"left out, or fixed_dt = {fixed:g} s, which is every period's length",
        "leave dt out",
    )
    with np.errstate(over="ignore", under="ignore"):
        rounded = float(precision.real(fixed))
    check(
        0.0 < rounded < np.inf,
        "fixed_dt",
        fixed,
        "within the range of single precision, 1.4e-45 to 3.4e38",
        'give the sampling period in seconds, or export with precision="double"',
    )
    try:
        observer._check_dt(rounded, observer.allow_unstable)
    except DesignError as error:
        raise DesignError(f"fixed_dt: {error}") from None
    return rounded


def held_gains(
    spec: Mapping[str, Any],
    precision: Precision,
    dt: float | None,
    most: int,
    fixed: float | None = None,
) -> tuple[Periods | None, tuple[Held, ...]]:
    """The gains that the source of an observer holds, and for which times; none for most laws.

    With a `fixed` period [s] those of every law whose corrections are placed and depend on time
    alone; with predictor timing they are constants of the step, and none is held.

    Raises
    ------
    HgoError
        A sampling period that is missing where gains depend on it; a gain that moves.
    """
    for law in _laws(spec):
        _check_threshold(law)
    found = [_holds(law) for law in _laws(spec)]
    if fixed is not None:
        dt, found = fixed, [_counted(law) for law in _laws(spec)]
    if not any(found):
        return None, ()
    if dt is None:
        raise HgoError(
            "dt is missing: an export of a low-power or peaking-free law under zoh, bilinear or "
            "implicit-map has a table of gains for 1, 2, ... sampling periods; give dt=, the "
            'period [s] (hgo export: --dt, or dt in [log] of the file), or choose method="rk4"'
        )
    periods = Periods(precision, float(precision.real(dt)), most)
    check(periods.dt > 0.0, "dt", dt, "> 0 in single precision", "give the sampling period [s]")
    lengths = [0.0, *periods.lengths]
    single, several = precision.name == "single", spec["kind"] == "chains"
    laws = list(_laws(spec))
    return periods, tuple(
        Held(
            f"gains{sample}" if several else "gains",
            sample + 1 if several else 0,
            sample,
            elapsed,
            tuple(map(tuple, rows)),
            _in_blocks(laws[sample]),
        )
        for sample, elapsed, rows in _core.placed_gains(
            spec, lengths, single, "held" if fixed is None else "given"
        )
    )


def _laws(spec: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """The laws of the chains, or the only one."""
    yield from spec.get("observers", (spec,))


def _placed(law: Mapping[str, Any]) -> bool:
    """Whether a law's corrections are placed."""
    return law.get("method") in CORRECTING


def _in_blocks(law: Mapping[str, Any]) -> bool:
    return law["kind"] in ("low-power", "peaking-free")


def _counted(law: Mapping[str, Any]) -> bool:
    """Whether a law's gains are held where the period is fixed: for each count of periods."""
    return _placed(law) and law["gain"]["law"] == "constant" and law.get("timing") == "current"


def _check_threshold(law: Mapping[str, Any]) -> None:
    """Refuse held gains beside a threshold that moves over a time for which none is held."""
    shape = law.get("shape") or {}
    moves = "decay" in shape and law.get("timing") == "current"
    if not (moves and _placed(law) and _in_blocks(law)):
        return
    check(
        False,
        "shape",
        shape["law"],
        f"without a moving threshold in an export of the {law['kind']} law under "
        f"{law['method']} with current timing, whose gains are stored for whole periods alone",
        'choose method="rk4", timing="predictor", or the standard law',
    )


def _holds(law: Mapping[str, Any]) -> bool:
    """Whether a law's gains are held."""
    if not _placed(law) or not _in_blocks(law):
        return False
    check(
        law["gain"]["law"] == "constant",
        "gain",
        law["gain"]["law"],
        f"constant in an export of the {law['kind']} law under {law['method']}, whose gains are "
        "found by iteration for every gain and length of a period",
        'choose method="rk4", a constant gain, or the standard law',
    )
    return True
