"""Records as other libraries hold them, as arrays: frames, series, indices of dates, `Log`s."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hgo_rs.errors import HgoError, check, nearest
from hgo_rs.times import UNITS, clock_of, in_seconds, is_clock, named_unit, unix_unit

_TIMES = frozenset(["t", "time", "timestamp", "stamp", "datetime", "date", "zeit", "ts", "clock"])
"""First words of the names that columns of times have."""


def is_record(log: Any) -> bool:
    """Whether it holds times and samples together: a `Log`, a frame, a series with its times."""
    return _is_log(log) or _is_frame(log) or _is_series(log)


def arrays(t_or_dt: Any, y: Any = None, u: Any = None) -> tuple[Any, Any, Any]:
    """Times [s] or a period, samples and inputs, of whatever holds them.

    Parameters
    ----------
    t_or_dt : array, float, duration, or a record
        Times, as numbers [s], dates or durations; a period; or samples together with their times:
        a `Log`; a pandas or xarray series whose index is its times; a pandas or polars frame, whose
        index or column of times is taken.
    y, u : arrays, or names of the frame's columns
        Left out with a record: all other columns of a frame are outputs.

    Raises
    ------
    HgoError
        A record without times, an unknown column, a `Log` whose clock starts again.
    """
    if _is_log(t_or_dt):
        alone = y is None and u is None
        check(alone, "y, u", "given", "left out with a Log", "a Log has its own")
        remedy = "take one of log.pieces: between them the states are not related"
        check(len(t_or_dt.starts) < 2, "pieces of the log", len(t_or_dt.starts), "1", remedy)
        return t_or_dt.t, t_or_dt.y, t_or_dt.u
    if _is_frame(t_or_dt):
        return _of_frame(t_or_dt, y, u)
    if y is None and _is_series(t_or_dt):
        return _index(t_or_dt), _values(t_or_dt), u
    check(y is not None, "y", None, "given", "give the samples, or a frame that holds them")
    y, u = (_values(v) if hasattr(v, "isna") else v for v in (y, u))
    return (clock_of(t_or_dt) if is_clock(t_or_dt) else t_or_dt), y, u


Given = Any
"""A `Log`, a frame or series with its times, (t, y) or (t, y, u)."""


def of_log(log: Given, parameter: str = "log") -> tuple[Any, Any, Any]:
    """Times [s] or a period, samples and inputs of one whole record; errors as of `arrays`."""
    if is_record(log):
        return arrays(log)
    several = isinstance(log, (tuple, list)) or (isinstance(log, np.ndarray) and log.ndim > 1)
    fits = several and len(log) in (2, 3)
    allowed = "a Log, a frame or series with its times, (t, y) or (t, y, u)"
    check(fits, parameter, log, allowed, "give these arrays as a tuple")
    return arrays(*log)


def _is_log(log: Any) -> bool:
    return all(hasattr(log, name) for name in ("t", "y", "u", "starts"))


def _is_frame(log: Any) -> bool:
    return hasattr(log, "columns") and hasattr(log, "to_numpy")


def _is_series(log: Any) -> bool:
    """A pandas series or an xarray array; a polars series has no times."""
    return hasattr(log, "to_numpy") and (hasattr(log, "index") or hasattr(log, "coords"))


def _of_frame(frame: Any, y: Any, u: Any) -> tuple[Any, Any, Any]:
    names = list(frame.columns)
    many = [name for name in names if names.count(name) > 1]
    check(not many, "columns of the frame", many, "different", "rename one of them")
    time, t = _times_of(frame, names)
    inputs = _named(frame, u, "u", names)
    taken = {time, *([] if u is None else [u] if isinstance(u, str) else u)}
    if y is None:
        y = [name for name in names if name not in taken]
        y = y[0] if len(y) == 1 else y
    return t, _named(frame, y, "y", names), inputs


def _named(frame: Any, wanted: Any, parameter: str, names: list[Any]) -> Any:
    """One column, (N,), or several, (N, count)."""
    if wanted is None:
        return None
    listed = isinstance(wanted, Sequence) and not isinstance(wanted, str)
    asked = list(wanted) if listed else [wanted]
    if not asked or not all(isinstance(name, (str, int)) for name in asked):
        remedy = "or give times and samples as arrays"
        raise HgoError(f"{parameter}: must be names of the frame's columns; {remedy}")
    for name in asked:
        near = nearest(str(name), [str(known) for known in names])
        remedy = f"nearest: {', '.join(near)}" if near else "name one of them"
        shown = ", ".join(map(str, names[:20]))
        check(name in names, parameter, name, f"a column of the frame ({shown})", remedy)
    columns = [_values(frame[name], f"column {name!r}") for name in asked]
    return np.column_stack(columns) if listed else columns[0]


def _values(column: Any, told: str = "y") -> np.ndarray:
    """Numbers, NaN where missing."""
    values = np.asanyarray(column)
    if values.dtype.kind == "O" and hasattr(column, "isna"):  # pandas' own missing value
        try:
            values = column.to_numpy(dtype=np.float64, na_value=np.nan)
        except (TypeError, ValueError):
            values = np.asanyarray(column)
    if values.dtype.kind not in "biuf":
        raise HgoError(f"{told}: must hold numbers, not {values.dtype}; convert it")
    return np.asarray(values, dtype=np.float64)


def _index(held: Any, remedy: str = "give the times: (t, y)") -> np.ndarray:
    """The times of the index of a pandas or xarray object [s]."""
    index = held.coords[held.dims[0]] if hasattr(held, "dims") else held.index
    if is_clock(index):
        return np.asarray(clock_of(index))
    if hasattr(index, "to_timestamp"):  # periods of time, at their begin
        return np.asarray(clock_of(index.to_timestamp()))
    values = np.asanyarray(index)
    counts = values.dtype.kind in "iu" and len(values) > 1 and bool(np.all(np.diff(values) == 1))
    if values.dtype.kind not in "iuf" or counts or getattr(index, "nlevels", 1) > 1:
        what = "counts its rows" if counts else f"holds {values.dtype}"
        what = "has several levels" if getattr(index, "nlevels", 1) > 1 else what
        if values.dtype.kind in "OUS" and "levels" not in what:
            remedy = f"text becomes times by pandas.to_datetime; {remedy}"
        raise HgoError(f"the index {what}: must be the times of the samples; {remedy}")
    return _numbers(values, str(index.name or "times of the index"))


def _times_of(frame: Any, names: list[Any]) -> tuple[Any, np.ndarray]:
    """The column of times, None for the index, and the times [s]."""
    index = getattr(frame, "index", None)
    if index is not None and is_clock(index):
        return None, np.asarray(clock_of(index))
    stamped = [name for name in names if is_clock(frame[name])]
    named = [name for name in names if speaks_of_time(str(name))]
    for found in (stamped, named):
        if len(found) == 1:
            column = frame[found[0]]
            if is_clock(column):
                return found[0], np.asarray(clock_of(column))
            return found[0], _numbers(_values(column, f"column {found[0]!r}"), str(found[0]))
        if found:
            several = ", ".join(map(str, found))
            raise HgoError(f"the frame has several columns of times ({several}): give (t, y)")
    remedy = "set it by frame.set_index(...), name a column t, or give (t, y) as arrays"
    if index is None:
        raise HgoError(f"the frame has no column of times ({', '.join(names[:20])}); {remedy}")
    return None, _index(frame, remedy)


def speaks_of_time(name: str) -> bool:
    """Whether a column of this name holds times, as `t`, `time [ms]`, `Timestamp`."""
    words = "".join(c if c.isalpha() else " " for c in name.casefold()).split()
    return bool(words) and words[0] in _TIMES


def _numbers(values: np.ndarray, name: str) -> np.ndarray:
    """Times that are numbers, in the unit that their name says, else s."""
    unit, why = named_unit(name)
    first = float(values[0]) if len(values) else 0.0
    if unit is None and not why and unix_unit(first) not in (None, "s"):
        why = f"{first:.0f} is a Unix time in {unix_unit(first)}"
    if why:
        raise HgoError(f"the unit of the times {name!r} is unknown: {why}; give them in s")
    return in_seconds(values, f"the times {name!r}", UNITS[unit or "s"])
