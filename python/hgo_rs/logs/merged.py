"""Signals with times of their own, as one log."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

from hgo_rs.errors import printable
from hgo_rs.logs.clock import Clock, moment
from hgo_rs.logs.columns import Converted
from hgo_rs.logs.formats import whole
from hgo_rs.logs.log import Log
from hgo_rs.logs.table import Columns, DataError, Table, names_of, refuse, rows_at, values_of
from hgo_rs.times import Ticks, span


def merged(
    path: Path,
    times: list[str],
    output: Columns,
    input: Columns | None,
    unit: str | Sequence[str] | None,
    converted: Converted,
) -> Log:
    """Outputs and inputs with times of their own, as one log."""
    outputs = names_of(output, "output")
    inputs = [] if input is None else names_of(input, "input")
    signals = [*outputs, *inputs]
    if unit is not None and not isinstance(unit, str) and len(unit) != len(times):
        raise DataError(f"unit: {len(unit)} for {len(times)} time columns; give one, or one each")
    told = dict(
        zip(times, [unit] * len(times) if isinstance(unit, str) else unit or (), strict=False)
    )
    if len(times) == len(outputs):
        times = times + times[:1] * len(inputs)
    if len(times) != len(signals):
        raise DataError(
            f"time: {len(times)} columns for {len(outputs)} outputs and {len(inputs)} inputs; name "
            "one, or one for each output (inputs then go with the first), or one for each of all"
        )
    table = whole(path, [*times, *signals])
    parts: dict[str, tuple[Clock, Ticks, np.ndarray]] = {}
    for name in dict.fromkeys(times):
        clock = Clock(path, name, None, told.get(name), "refuse", None)
        found = clock.ticks(table)
        mine = [s for s, t in zip(signals, times, strict=True) if t == name]
        lengths = {len(table.columns[s]) for s in mine} | {len(found.whole)}
        if len(lengths) > 1:
            raise DataError(f"{path}: {', '.join([name, *mine])} differ in length")
        kept = ~found.missing
        kept |= ~np.all([np.isnan(values_of(table, path, s)) for s in mine], axis=0)
        at = np.flatnonzero(kept)  # the rest pads the shorter columns
        if not len(at):
            raise DataError(f"{path}: column {name!r} holds no time")
        own = Table({name: table.columns[name][at]}, rows_at(table, at), units=table.units)
        clock.learn(clock.ticks(own), own)
        parts[name] = (clock, clock.ticks(own), at)
    origin = _common_origin([(clock, found) for clock, found, _ in parts.values()])
    clocks: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    remarks: tuple[str, ...] = table.remarks
    assumed = False
    for name, (clock, _, at) in parts.items():
        clock.origin = origin
        own = Table({name: table.columns[name][at]}, rows_at(table, at))
        clocks[name] = (clock(own)[0], at)
        clock.finish()
        remarks += clock.remarks
        assumed = assumed or clock.assumed
    if origin:
        clock, found, _ = parts[times[0]]
        remarks += (f"t counts from {printable(times[0])} = {moment(origin, found, clock)}",)
    _check_together(
        path, {n: (clocks[n][0], parts[n][0].assumed) for n in parts}, set(times[: len(outputs)])
    )
    t = np.unique(np.concatenate([seconds for seconds, _ in clocks.values()]))
    t = t[np.diff(t, prepend=-math.inf) > 4.0 * np.spacing(np.abs(t))]  # one time, rounded apart
    row = {name: np.searchsorted(t, s, side="right") - 1 for name, (s, _) in clocks.items()}
    y = np.full((len(t), len(outputs)), np.nan)
    for j, (name, own_time) in enumerate(zip(outputs, times, strict=False)):
        at = clocks[own_time][1]
        values = values_of(table, path, name)[at]
        own = Table({}, rows_at(table, at))
        refuse(own, path, np.isinf(values), f"{name!r} is infinite; leave a missing sample empty")
        if np.isnan(values).all():
            raise DataError(f"{path}: column {name!r} holds no sample")
        y[row[own_time], j] = converted(name, values)
    u = np.empty((len(t), len(inputs)))
    for j, (name, own_time) in enumerate(zip(inputs, times[len(outputs) :], strict=True)):
        seconds, at = clocks[own_time]
        values = values_of(table, path, name)[at]
        what = f"the input {name!r} is missing or infinite; fill it in"
        refuse(Table({}, rows_at(table, at)), path, ~np.isfinite(values), what)
        held = np.searchsorted(row[own_time], np.arange(len(t)), side="right") - 1
        if held[0] < 0:
            raise DataError(
                f"{path}: the input {name!r} begins at {seconds[0]:g} s, after the first sample at "
                f"{t[0]:g} s; give it from the start, or cut the outputs before"
            )
        u[:, j] = converted(name, values)[held]
    if len(t) < 2:
        raise DataError(f"{path}: {len(t)} samples; an observer needs at least 2")
    names = {"time": times, "output": output, "input": input}
    shaped = y[:, 0] if isinstance(output, str) else y
    known = None if not inputs else u[:, 0] if isinstance(input, str) else u
    missing = np.isnan(shaped)
    return Log(t, shaped, known, names, str(path), missing, (0,), remarks, assumed)


def _common_origin(clocks: list[tuple[Clock, Ticks]]) -> Fraction:
    """The one time [s] that all clocks count from: 0, or a tick of each about the first sample."""
    begins = [clock.begin(found) for clock, found in clocks if clock.length is not None]
    if not any(needed for _, needed in begins):
        return Fraction(0)
    coarsest = max(clock.length for clock, _ in clocks if clock.length is not None)
    return math.floor(min(first for first, _ in begins) / coarsest) * coarsest


def _check_together(
    path: Path, clocks: Mapping[str, tuple[np.ndarray, bool]], of_outputs: set[str]
) -> None:
    """Refuse clocks that have no origin, or no unit, in common."""
    (first, (a, _)), *others = clocks.items()
    for name, (b, _) in others:
        apart = max(b[0] - a[-1], a[0] - b[-1])
        spans = a[-1] - a[0], b[-1] - b[0]
        limit = max(sum(spans), 1.0) if {first, name} <= of_outputs else 86400.0
        if apart > max(limit, sum(spans)):
            raise DataError(
                f"{path}: the times {first!r} and {name!r} do not overlap, they lie "
                f"{span(apart)} apart; give both one origin and say each unit: unit = [...]"
            )
        if not (clocks[first][1] or clocks[name][1]) or min(len(a), len(b)) < 8:
            continue
        ratio = max(spans) / min(spans)
        if any(abs(ratio / scale - 1.0) < 0.1 for scale in (1e3, 1e6, 1e9)):
            raise DataError(
                f"{path}: the times {first!r} and {name!r} span {spans[0]:g} and {spans[1]:g} "
                "as if of different units; say each: unit = [...], one for each time column"
            )


# --- checks ----------------------------------------------------------------------------------
