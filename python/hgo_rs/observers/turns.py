"""Outputs that wrap: angles that begin again after a turn, counters that overflow."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, check_number
from hgo_rs.observers.records import Array

NEAR_HALF = 0.4
"""Part of a turn between two samples from which on their direction is in doubt."""

_REMEDY = "give the length of a whole turn in the unit of y, such as 2*pi or 65536"


class TurnWarning(UserWarning):
    """Samples so far apart that a turn more or less between them could not be told."""


def turn(wrap: Any) -> dict[str, float]:
    """What the spec of a law of one output says of its turn."""
    return {} if wrap is None else {"wrap": check_number(wrap, "wrap", above=0.0, remedy=_REMEDY)}


def turns(wrap: Any, n_y: int) -> dict[str, list[float | None]]:
    """The same of a law of several outputs: one number, or None, for each."""
    if wrap is None:
        return {}
    given = list(wrap) if isinstance(wrap, (list, tuple, np.ndarray)) else [wrap]
    if len(given) != n_y:
        allowed = f"must have {n_y}, one for each output"
        raise HgoError(f"wrap of {len(given)} entries: {allowed}; None for one that does not wrap")
    lengths = [None if one is None or one != one else turn(one)["wrap"] for one in given]
    return {} if all(length is None for length in lengths) else {"wrap": lengths}


def turns_of(spec: Mapping[str, Any], n_y: int) -> tuple[float | None, ...]:
    """The turn of each output of an observer; None: it does not wrap."""
    if "observers" in spec:
        return tuple(inner.get("wrap") for inner in spec["observers"])
    wrap = spec.get("wrap")
    return tuple(wrap) if isinstance(wrap, (list, tuple)) else (wrap,) * n_y


def nearest(values: npt.ArrayLike, lengths: npt.ArrayLike) -> Array:
    """Values (..., m) less the whole turns nearest to them; lengths (m,), NaN: does not wrap."""
    given, length = np.asarray(values, dtype=float), np.asarray(lengths, dtype=float)
    with np.errstate(invalid="ignore"):
        whole = length * np.rint(given / length)
    return np.asarray(given - np.where(np.isfinite(length), whole, 0.0))


def unwrapped(y: Array, length: float) -> Array:
    """Samples (N,) that go on over their turns, each step the shorter way round; NaN: missing."""
    out, there = y.copy(), np.isfinite(y)
    out[there] = np.unwrap(y[there], period=length)
    return out


def check_motion(y: Array, lengths: tuple[float | None, ...], stacklevel: int) -> None:
    """Warn of neighbours among samples (N, n_y) so far apart that their direction is in doubt."""
    for channel, length in enumerate(lengths):
        if length is None or len(y) < 2:
            continue
        moved = np.abs(nearest(np.diff(y[:, channel, None], axis=0), [length]))[:, 0]
        k = int(np.argmax(np.where(np.isnan(moved), -1.0, moved)))
        if moved[k] > NEAR_HALF * length:
            output = f" of output {channel + 1}" if len(lengths) > 1 else ""
            warnings.warn(
                f"wrap = {length:g}{output}: samples {k} and {k + 1} lie {moved[k]:.4g} apart, "
                f"{moved[k] / length:.2g} of a turn; from half a turn on, by motion or by noise, "
                "direction and number of turns are unknown: sample faster, or check that wrap is "
                "the whole turn",
                TurnWarning,
                stacklevel=stacklevel + 1,
            )


COUNTERS = tuple(2.0**bits for bits in (8, 10, 12, 14, 16, 20, 24, 32))
"""Turns of counters."""
ANGLES = (2.0 * np.pi, 360.0)
"""Turns of angles in rad and in degrees."""
_FEWEST = 8
UNWRAP = "unwrap it: numpy.unwrap(y, period={0}), or read_log(..., unwrap={{...: {0}}})"
"""Remedy of `warn_of_turns` where no observer is given that could know of the turn."""


def told_turn(name: str, length: float) -> str:
    """What is said of an output that jumps by turns."""
    what = "an angle" if length in ANGLES else f"a counter of {round(np.log2(length))} bits"
    return f"{name} jumps by nearly {shown(length)}, as {what} that begins again"


def shown(length: float) -> str:
    """A turn, to the last digit."""
    return f"{length:.0f}" if length == round(length) else repr(float(length))


def warn_of_turns(
    y: Array,
    lengths: Sequence[float | None],
    names: Sequence[str],
    remedy: str,
    stacklevel: int,
) -> None:
    """Warn of outputs among samples (N, n_y) that show a turn although none is known of them.

    ``remedy``: with {} where the turn stands.
    """
    for name, column, length in zip(names, y.T, lengths, strict=True):
        found = None if length else Jumps().add(column)
        if found:
            told = f"{told_turn(name, found)}; {remedy.format(shown(found))}"
            warnings.warn(told, TurnWarning, stacklevel=stacklevel + 1)


class Jumps:
    """Looks for a turn in samples that come chunk by chunk."""

    def __init__(self) -> None:
        self._usual = dict.fromkeys((*COUNTERS, *ANGLES), 0.0)  # largest step of no turn
        self._lowest, self._highest = np.inf, -np.inf
        self._steps = 0
        self._last = np.nan
        self._whole = True  # of which no angle in rad is made

    def add(self, values: Array) -> float | None:
        """Take in samples (N,); the turn that they pass, if they show one.

        All samples so far lie within one turn of a counter (whole numbers) or an angle, and every
        step is less than a quarter of it, or by a whole turn as small as the others are.
        """
        there = values[~np.isnan(values)]
        if not len(there):
            return None
        steps = np.diff(there, prepend=self._last)
        steps = steps[~np.isnan(steps)]
        self._last = float(there[-1])
        self._lowest = min(self._lowest, float(there.min()))
        self._highest = max(self._highest, float(there.max()))
        self._steps += len(steps)
        if not np.all(there == np.rint(there)):
            self._whole = False
            self._usual = {length: u for length, u in self._usual.items() if length in ANGLES}
        passed = {length: self._passes(steps, length) for length in list(self._usual)}
        return next((length for length, passes in passed.items() if passes), None)

    def _passes(self, steps: Array, length: float) -> bool:
        """Whether some steps pass this turn; one that cannot be is not looked at again."""
        low, high = (0.0, length) if self._lowest >= 0.0 else (-0.5 * length, 0.5 * length)
        slack = 1e-6 * length
        sizes = np.abs(steps)
        jumps = sizes > 0.5 * length
        usual = max(self._usual[length], float(np.max(sizes[~jumps], initial=0.0)))
        inside = low - slack <= self._lowest and self._highest <= high + slack
        left = np.abs(nearest(steps[jumps, None], [length]))
        small = bool(np.all(left <= 2.0 * usual + (length in COUNTERS)))
        if not inside or usual >= 0.25 * length or not small:
            del self._usual[length]
            return False
        self._usual[length] = usual
        told = not (self._whole and length == ANGLES[0])
        return told and bool(jumps.any()) and self._steps >= _FEWEST
