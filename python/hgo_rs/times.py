"""Times of a log: the unit of a column, seconds without a lost digit, and what cannot be a time.

A column holds numbers of a unit that is given, said by the column's name or seen from a Unix time's
size; or dates, or durations. Its whole ticks are subtracted as integers before they become float64.
"""

from __future__ import annotations

import datetime
import math
import re
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, check, check_number

UNITS = {
    "s": Fraction(1),
    "ms": Fraction(1, 10**3),
    "us": Fraction(1, 10**6),
    "ns": Fraction(1, 10**9),
    "min": Fraction(60),
    "h": Fraction(3600),
    "d": Fraction(86400),
}
"""Units of time, and how many seconds one has."""

RESETS = ("refuse", "split")
"""What a clock that starts again means: an error, or a new piece of the log."""

YEAR = 365.25 * 86400.0
LONGEST = YEAR
"""A step from here on [s] is no step: the unit is another, or the clock was set."""
SLOWEST = 1e6
"""A median step from here on [s] is refused, whatever the unit is said to be."""
SLOW = 100.0
"""A median step from here on [s] is refused where nobody said that the unit is the second."""
FAST = 1e-4
"""A median step below [s] is refused where the numbers look like dates in days."""
FARTHEST = 1e12
"""A time from here on [s] lies millennia away from every origin in use."""
COUNTED = 2**40
"""Ticks from here on, as of Unix times in ms, us and ns, count from the first sample: as float64
seconds they would lose digits."""
LARGEST = 2**62
"""Ticks from here on are refused: their differences may leave int64."""

_CALENDAR = {
    "W": Fraction(7 * 86400),
    "D": UNITS["d"],
    "h": UNITS["h"],
    "m": UNITS["min"],
    "s": UNITS["s"],
    "ms": UNITS["ms"],
    "us": UNITS["us"],
    "ns": UNITS["ns"],
    "ps": Fraction(1, 10**12),
    "fs": Fraction(1, 10**15),
    "as": Fraction(1, 10**18),
}
"""The units of datetime64 and timedelta64 that have a length."""

# --- the unit -----------------------------------------------------------------------------------

_PREFIXES = {
    **dict.fromkeys(("m", "milli", "mili"), "ms"),
    **dict.fromkeys(("u", "μ", "micro", "mikro"), "us"),
    **dict.fromkeys(("n", "nano"), "ns"),
}
_PREFIX = f"({'|'.join(_PREFIXES)})"
_SECOND = r"se[ckg](?:[ou]nd)?[a-z]{0,3}"  # sec, secs, seconds, Sekunden, segundos
_TIME = "(?:timestamp|time|stamp|ts|t|clock|epoch|unix|boot|uptime|elapsed|zeit)"
_PART = re.compile(
    rf"{_TIME}?{_PREFIX}(?:s|{_SECOND})|(milli|micro|mikro|nano)|[a-z]*(milli|micro|nano)s"
)
_WHOLE = re.compile(rf"s|{_TIME}?{_SECOND}")
_LONGER = {
    **dict.fromkeys(("min", "mins", "minute", "minutes", "minuten"), "min"),
    **dict.fromkeys(("hr", "hrs", "hour", "hours", "stunde", "stunden"), "h"),
    **dict.fromkeys(("day", "days", "tag", "tage"), "d"),
}
_OTHER = re.compile(
    r"ticks?|jiffies|cycles?|counts|clk|[pfcd]s|weeks?|months?|years?|filetime|datenum|[hdm]"
    rf"|[a-z]+{_SECOND}"
)
"""Words at the end of a name that say a unit which is none of `UNITS`, or may say one."""
_COUNTERS = (
    *("index", "idx", "sample", "samples", "frame", "frames", "row", "rows"),
    *("seq", "sequence", "number", "no", "nr", "unnamed"),
)
"""Names made of these words alone count samples."""


def named_unit(name: str) -> tuple[str | None, str]:
    """(unit, ""): what a column's name says, None for nothing; (None, why): the unit must be given.

    The unit is a word between signs or capital letters, or follows a word for time: `t_ms`,
    `time [us]`, `TimeUS`, `millis`, `t_min`, `ms since boot`. Seconds, minutes, hours and days
    stand at the end.
    """
    letters = name.replace("µ", "μ")
    words = _before_since(re.findall(r"[^\W\d_]+", letters.casefold()))
    if words and all(word in _COUNTERS for word in words):
        return None, "the name is that of a count of samples"
    if re.search(r"\d[mun\u03bc]?s(?![a-z\u03bc])", letters.casefold()):
        return None, "the name contains a multiple of a unit"
    units = _units(words)
    bracket = re.search(r"[\[(/]\s*([hd])\s*[\])]?\s*$", letters.casefold())
    if bracket or words in (["h"], ["d"]):
        units.add(bracket[1] if bracket else words[0])
    if not units:
        camel = re.findall(r"[^\W\d_]+", re.sub(r"(?<=[a-zμ])(?=[A-Z])", " ", letters).casefold())
        words = _before_since(camel)
        units = _units(words)
    if len(units) > 1:
        return None, f"the name contains {' and '.join(sorted(units))}"
    if units:
        return units.pop(), ""
    if words and _OTHER.fullmatch(words[-1]):
        return None, f"the name ends in {words[-1]!r}"
    return None, ""


def _before_since(words: list[str]) -> list[str]:
    """The words of a name without its origin: ms (since boot)."""
    origin = (i for i, w in enumerate(words) if i and w in ("since", "from", "after"))
    return words[: next(origin, len(words))]


def _units(words: list[str]) -> set[str]:
    """The units that the words of a name say."""
    parts = [_PART.fullmatch(word) for word in words]
    found = {_PREFIXES[next(filter(None, part.groups()))] for part in parts if part}
    if words and _WHOLE.fullmatch(words[-1]):
        found.add("s")
    if words and words[-1] in _LONGER:
        found.add(_LONGER[words[-1]])
    return found


def unix_unit(value: float) -> str | None:
    """The unit that makes this number a Unix time of the years 2000 to 2100."""
    for unit in ("s", "ms", "us", "ns"):
        if 946_684_800 <= value * float(UNITS[unit]) < 4_102_444_800:
            return unit
    return None


def unix_days(value: float) -> str | None:
    """Which count of days makes this number a date of the years 2000 to 2100."""
    counts = {"spreadsheet": 36526.0, "modified Julian": 51544.0}
    counts |= {"MATLAB": 730486.0, "Julian": 2451544.5}
    for name, begin in counts.items():
        if begin <= value < begin + 36525.0:
            return name
    return None


def likely(step: float) -> str:
    """Which units would make a usual step of this one, a number of ticks, in words."""
    steps = {unit: step * float(UNITS[unit]) for unit in ("s", "ms", "us", "ns")}
    usual = {unit: s for unit, s in steps.items() if 1e-5 <= s <= 20.0}
    order = sorted(usual, key=lambda unit: abs(math.log10(usual[unit] / 1e-2)))[:2]
    if not order:
        return "no unit of ms, us, ns makes a usual step of it"
    return "likely " + " or ".join(f"{unit} (a step of {usual[unit]:.4g} s)" for unit in order)


def span(seconds: float) -> str:
    """A duration in words: 5000 s, 11.6 days, 3.2 years."""
    for size, unit in ((YEAR, "years"), (86400.0, "days")):
        if abs(seconds) >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.6g} s"


# --- ticks --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Ticks:
    """A column as whole ticks (int64; 0 where missing), parts of ticks, and where it is missing."""

    whole: npt.NDArray[np.int64]
    part: npt.NDArray[np.float64] | None
    missing: npt.NDArray[np.bool_]
    length: Fraction | None  # of a tick [s]; None: plain numbers, whose unit is to be found
    is_date: bool = False

    def seconds(self, length: Fraction, origin: Fraction) -> npt.NDArray[np.float64]:
        """Seconds since `origin` [s], NaN where missing; one rounding of whole ticks."""
        begin = origin / length
        base = math.floor(begin)
        if abs(base) < LARGEST:
            count = (self.whole - base).astype(np.float64)
            rest = float((begin - base) * length)
        else:  # ticks too short to reach the origin
            count, rest = self.whole.astype(np.float64), float(origin)
        if self.part is not None:
            count = count + self.part
        if length.numerator != 1:
            count = count * length.numerator
        t: npt.NDArray[np.float64] = count / length.denominator
        if rest:
            t = t - rest
        t[self.missing] = np.nan
        return t

    def first(self) -> int:
        """The first tick that is there; 0: none is."""
        there = np.flatnonzero(~self.missing)
        return int(self.whole[there[0]]) if len(there) else 0


def ticks(column: npt.NDArray[np.generic]) -> Ticks | str:
    """The ticks of a column of numbers, dates or durations; a text says why there are none."""
    missing = np.array(np.ma.getmaskarray(column)) if np.ma.isMaskedArray(column) else None
    raw = np.ma.getdata(column)
    kind = raw.dtype.kind
    if kind in "Mm":
        raw = raw.astype(raw.dtype.newbyteorder("="))
        unit, count = np.datetime_data(raw.dtype)
        if kind == "M" and unit in ("Y", "M"):
            raw, unit, count = raw.astype("datetime64[D]"), "D", 1
        if unit in ("Y", "M"):
            return "is in months, which have no fixed length; give it in days or seconds"
        gone = np.isnat(raw)
        whole = np.where(gone, 0, raw.view(np.int64))
        length = None if unit == "generic" else _CALENDAR[unit] * count
        result = Ticks(whole, None, gone, length, kind == "M")
    elif kind in "iu":
        if raw.size and int(raw.max()) >= LARGEST:
            return f"holds {int(raw.max())}, which is no time; leave a missing one empty"
        whole = raw.astype(np.int64)
        gone = np.zeros(len(raw), bool) if missing is None else missing
        result = Ticks(np.where(gone, 0, whole), None, gone, None)
    elif kind == "f":
        gone = ~np.isfinite(raw) if missing is None else missing | ~np.isfinite(raw)
        there = np.where(gone, raw.dtype.type(0), raw) if gone.any() else raw
        if there.size and float(np.max(np.abs(there))) >= LARGEST:
            return f"holds {float(np.max(np.abs(there))):g}, which is no time"
        floor = np.trunc(there)
        part = (there - floor).astype(np.float64)
        result = Ticks(floor.astype(np.int64), part if part.any() else None, gone, None)
    else:
        return f"holds {raw.dtype}, not numbers"
    if result.whole.size and int(result.whole.min()) <= -LARGEST:
        return f"holds {int(result.whole.min())}, which is no time; leave a missing one empty"
    return result


def wrapped(back: float, step: float) -> int | None:
    """The size of a counter that wrapped: it fell by `back` ticks where `step` was to come."""
    for bits in (8, 16, 24, 32):
        if step < 2.0**bits / 4 and abs(back + step - 2.0**bits) <= 20.0 * step:
            return bits
    return None


# --- dates and durations of other libraries ------------------------------------------------------

_DTYPES = ("datetime64", "timedelta64", "Datetime", "Duration", "timestamp[", "duration[")
"""How the types of dates and durations begin: NumPy's and pandas', polars', pyarrow's."""
_SINGLE = (datetime.datetime, datetime.timedelta, np.datetime64, np.timedelta64)


def is_clock(values: Any) -> bool:
    """Whether these are dates or durations, or one of them."""
    if isinstance(values, _SINGLE) or str(getattr(values, "dtype", "")).startswith(_DTYPES):
        return True
    if isinstance(values, (list, tuple)) or str(getattr(values, "dtype", "")) == "object":
        return isinstance(next((v for v in values if v is not None), None), _SINGLE)
    return False


def clock_of(values: Any) -> npt.NDArray[np.float64]:
    """Dates as seconds since the first of them, durations as seconds; NaN where missing.

    Dates with a zone are compared in UTC.

    Raises
    ------
    HgoError
        Dates beside durations or numbers; durations that have no fixed length.
    """
    values = _single(values) if isinstance(values, _SINGLE) else values
    raw = np.asanyarray(values)
    if raw.dtype.kind == "O" and hasattr(values, "to_numpy"):  # pandas, with a zone
        values = values.to_numpy(dtype="datetime64[ns]")
    elif raw.dtype.kind == "O":
        single = [_single(value) for value in raw.flat]
        kinds = {getattr(value, "dtype", raw.dtype).kind for value in single if value is not None}
        allowed = "dates alone or durations alone"
        check(len(kinds) == 1 and kinds <= {"M", "m"}, "t", raw.tolist(), allowed, "convert others")
        gone = np.datetime64("NaT") if "M" in kinds else np.timedelta64("NaT")
        values = np.array([gone if value is None else value for value in single])
        values = values.reshape(raw.shape)
    return in_seconds(np.asanyarray(values), "t")


def in_seconds(
    values: npt.NDArray[np.generic], told: str, length: Fraction | None = None
) -> npt.NDArray[np.float64]:
    """Dates since the first, durations, or numbers of ticks of this length, in seconds.

    Large numbers, as of Unix times in ms, count from the first: float64 seconds would lose digits.
    """
    found = ticks(np.atleast_1d(values))
    if isinstance(found, str):
        raise HgoError(f"{told} {found}")
    length = found.length or length
    if length is None:
        raise HgoError(f"{told} holds durations without a unit; give them in seconds")
    far = found.length is None and abs(found.first()) >= COUNTED  # as in a log
    origin = found.first() * length if found.is_date or far else Fraction(0)
    return found.seconds(length, origin).reshape(np.shape(values))


def _single(value: Any) -> Any:
    """A date or a duration as NumPy's."""
    for method in ("to_datetime64", "to_timedelta64"):  # pandas
        if hasattr(value, method):
            return getattr(value, method)()
    if isinstance(value, datetime.datetime):
        zone = value.tzinfo is not None
        value = value.astimezone(datetime.timezone.utc).replace(tzinfo=None) if zone else value
        return np.datetime64(value, "us")
    if isinstance(value, datetime.timedelta):
        return np.timedelta64(value, "us")
    return value


def check_period(
    value: Any,
    parameter: str = "dt",
    *,
    remedy: str = "choose a value in this range",
    error: type[HgoError] = HgoError,
) -> float:
    """A period > 0 [s]: a number, or a duration of datetime, NumPy or pandas."""
    if isinstance(value, (datetime.timedelta, np.timedelta64)):
        try:
            value = float(clock_of(value))
        except HgoError as refused:
            raise error(f"{parameter}: {refused}") from None
    return check_number(value, parameter, above=0.0, remedy=remedy, error=error)
