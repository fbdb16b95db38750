"""Exports for a fixed period: no `dt`, and the bits of `run` at that period, in double and in
single precision, for every law under every method and timing, over gaps.
"""

from __future__ import annotations

import re
import struct
import sys
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from exported import checked_as_cpp, fixed, in_c, in_rust, lacking, put, says_ok
from matrices import some
from test_export_every import (
    CASES,
    DT,
    MISSING,
    PERIODS,
    PLACED,
    U,
    Y,
    low_power,
    places,
    printed_in,
    standard,
)

import hgo_rs as hgo
from hgo_rs import _core
from hgo_rs.errors import DesignError, HgoError
from hgo_rs.exports import sources
from hgo_rs.exports.c import files as c_files
from hgo_rs.exports.program import Program, program
from hgo_rs.observers import Observer

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="written for GNU's tools")

N = len(Y)
TIMES = [DT * k for k in range(N)]
LONGEST = 4
"""Periods of the longest gap of the samples, with that in which it ends."""


@dataclass(frozen=True)
class Case:
    """An export, and the memories of `run` after each sample."""

    described: Program
    rows: npt.NDArray[Any]
    """Those entries that are written."""


def written(observer: Observer) -> list[int]:
    """Entries of the memory that a fixed export writes: times are counts where gains are held."""
    m = observer.memory.size
    if observer.spec["kind"] == "reduced-order":  # an own model has room for eight inputs
        return [*range(observer.n + observer.n_y + observer.n_u), m - 2, m - 1]
    laws = observer.spec.get("observers", (observer.spec,))
    counted = [
        elapsed
        for law, (_, elapsed, _) in zip(laws, places(observer), strict=True)
        if law.get("method") in PLACED and law["gain"]["law"] == "constant"
    ]
    return [i for i in range(m) if i not in counted]


def memories(observer: Observer, precision: str) -> npt.NDArray[Any]:
    """After each sample: of `run` at the period, or of the core in single precision."""
    y, u, start = Y[:, : observer.n_y], U[:, : observer.n_u], observer.memory.copy()
    current = observer._core.is_current
    if precision == "double":
        made = observer.run(DT, y, u, memory0=start, until=DT * N)
        after = [] if current else [made.next_memory]
    elif any(low for _, _, low in places(observer)):
        return by_tables(observer)
    else:
        t = np.array([*TIMES, DT * N])
        assert np.array_equal(np.float32(np.diff(t)), np.full(N, np.float32(DT)))
        if not current:  # after a sample is before the next
            y, u = (np.append(of, of[-1:], axis=0) for of in (y, u))
        rows = np.array(_core.run_single(observer.spec, t[: len(y)], y, u, start), np.float32)
        return rows if current else rows[1:]
    return np.array([*made.memory[not current :], *after])


def by_tables(observer: Observer) -> npt.NDArray[np.float32]:
    """In single precision a law whose gains no operations compute: each call by a table of its own,
    with gains for the time of its correction and `dt` as a number among others.
    """
    spec, rows = observer.spec, []
    model = spec.get("model") or {}
    named = model.get("names", {}).get("parameters", ())
    known = dict(zip(named, model.get("parameters", ()), strict=True))
    z, dt = observer.memory.copy(), float(np.float32(DT))
    current, (_, elapsed, _) = observer._core.is_current, places(observer)[0]
    for k, t in enumerate(TIMES):
        time = float(z[elapsed]) if current else dt
        for part in ("correct", "predict") if current else ("step",):
            table = _core.trace_step(spec, True, dt=time or dt, part=part)
            values = known | {"t": t, "dt": dt} | {f"z[{i}]": v for i, v in enumerate(z)}
            values |= {f"y[{i}]": v for i, v in enumerate(Y[k])}
            values |= {f"u[{i}]": v for i, v in enumerate(U[k])}
            row = [values[name] for name in table["inputs"]]
            z = np.array(_core.evaluate_table(table, [row], True)[0][: z.size])
            if part != "predict":
                rows.append(z)
    return np.array(rows, dtype=np.float32)


SOME = some(CASES, "fixed")


@pytest.fixture(scope="module", params=["double", "single"])
def cases(request: Any) -> dict[str, Case]:
    made = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        for number, case in enumerate(SOME):
            observer = CASES[case]()
            described = program(
                observer, name=f"o{number}", precision=request.param, fixed_dt=DT, periods=LONGEST
            )
            rows = memories(observer, request.param)[:, written(observer)]
            made[case] = Case(described, rows)
    return made


@pytest.fixture(scope="module", params=["c", "rust"])
def printed(request: Any, tmp_path_factory: Any, cases: Mapping[str, Case]) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp(request.param)
    return printed_in(
        request.param, folder, {case: (of.described, None, TIMES) for case, of in cases.items()}
    )


@pytest.mark.parametrize("case", SOME)
def test_every_law_has_the_bits_of_run_at_the_fixed_period(
    cases: dict[str, Case], printed: dict[str, list[Any]], case: str
) -> None:
    described, rows = cases[case].described, cases[case].rows
    assert not any(move.takes("dt") for move in described.moves)
    verbs = len(described.moves)
    taking = printed[case][::verbs]  # the verb that takes the sample
    letter = "d" if rows.dtype == np.float64 else "f"
    for k, ((status, made), row) in enumerate(zip(taking, rows, strict=True)):
        assert status == (k in MISSING), f"sample {k}"
        numbers = struct.unpack(f"{row.size}{letter}", made)
        assert made == row.tobytes(), f"sample {k}: {numbers}, not {row.tolist()}"


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("case", [case for case in SOME if "zoh, current" in case])
def test_a_gap_of_more_periods_than_are_held_is_told_and_the_next_sample_is_used(
    case: str, precision: str, tmp_path: Path
) -> None:
    observer = CASES[case]()
    described = program(observer, name="o", precision=precision, fixed_dt=DT, periods=PERIODS)
    rows = printed_in("c", tmp_path, {case: (described, None, TIMES)})[case][::2]
    refused = [k for k, (status, _) in enumerate(rows) if status == 3]
    counted = len(written(observer)) < observer.memory.size
    ends = max(MISSING) + 1
    assert refused == ([ends] if counted else [])
    whole = memories(observer, precision)[:, written(observer)]
    bits = [made == row.tobytes() for (_, made), row in zip(rows, whole, strict=True)]
    # a gain that moves has its time in the memory, and takes any gap
    assert bits[:ends] == [True] * ends
    if counted and precision == "double" and observer.n_y == 1:
        # corrected for no time, then for the time since then
        [(_, elapsed, _)] = places(observer)
        u = U[:, : observer.n_u]
        start = observer.memory.copy()
        before = observer.run(DT, Y[:ends, 0], u[:ends], memory0=start, until=DT * ends)
        memory = before.next_memory.copy()
        assert memory[elapsed] == pytest.approx((PERIODS + 1) * DT)
        memory[elapsed] = 0.0
        later = observer.run(TIMES[ends:], Y[ends:, 0], u[ends:], memory0=memory).memory
        made = np.array([np.frombuffer(made) for _, made in rows[ends:]])
        # differences of times are the period but for rounding
        assert made == pytest.approx(later[:, written(observer)], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("timing", ["predictor", "current"])
def test_the_demonstration_runs_and_cpp_reads_it_without_a_warning(
    timing: str, precision: str, tmp_path: Path
) -> None:
    for make in (standard, low_power):
        observer = make(method="zoh", timing=timing)
        given: dict[str, Any] = {"name": "o", "precision": precision, "fixed_dt": DT}
        folder = put(tmp_path / make.__name__, sources(observer, to="c", **given))
        checked_as_cpp(folder, "o")
        assert says_ok(in_c(folder, "o"), 100)
        folder = put(tmp_path / f"{make.__name__}_rs", sources(observer, to="rust", **given))
        assert says_ok(in_rust(folder, "o"), 100)


def test_the_step_of_placed_gains_is_a_few_sums_and_products() -> None:
    observer = hgo.StandardObserver(2, 60.0, model=hgo.InputGain(2.0), method="zoh")
    observer = observer.with_timing("predictor")
    source = sources(observer, to="c", fixed_dt=1e-3)["observer.c"]
    step = source[source.index("int observer_step(") :]
    assert "int observer_step(observer_state *state, double y, double u, double t)" in step
    assert len(re.findall(r" [*/+] ", step)) <= 11
    assert not re.search(r"observer_(exp|sin|cos|max)", source)
    euler = hgo.StandardObserver(2, 60.0, model=hgo.InputGain(2.0), method="euler")
    euler = euler.with_timing("predictor")
    plain = sources(euler, to="c", fixed_dt=1e-3)["observer.c"]
    assert len(source) < 1.1 * len(plain)


def test_an_export_in_the_middle_of_a_gap_goes_on_as_run_does() -> None:
    observer = standard(method="zoh", timing="current")
    for y in [0.1, 0.2, np.nan, np.nan]:
        observer.correct(y)
        observer.predict(0.0, DT)
    described = program(observer, name="o", precision="double", fixed_dt=DT)
    assert [field.value for field in described.counters] == [3]
    memory = observer.memory.copy()
    memory[-1] = 1.4 * DT
    observer.memory = memory
    with pytest.raises(HgoError, match=r"observer\.memory = 0\.01.*: must be 0 or 1 to 16 periods"):
        program(observer, name="o", precision="double", fixed_dt=DT)


@pytest.mark.parametrize("value", [0.0, -1e-3, np.nan, np.inf, "fast"])
def test_a_fixed_period_that_is_none_is_refused(value: Any) -> None:
    with pytest.raises(HgoError, match=r"^fixed_dt = .*: must be .* > 0; give "):
        sources(standard(method="zoh"), to="c", fixed_dt=value)


def test_a_fixed_period_beyond_the_step_limit_is_refused_as_in_run() -> None:
    observer = hgo.StandardObserver(2, 60.0, method="euler", timing="predictor")
    limit = observer.step_limit().dt
    sources(observer, to="c", fixed_dt=0.99 * limit)
    with pytest.raises(DesignError) as refused:
        sources(observer, to="c", fixed_dt=1.01 * limit)
    with pytest.raises(DesignError) as in_run:
        observer.run(1.01 * limit, np.zeros(3))
    assert str(refused.value) == f"fixed_dt: {in_run.value}"
    free = hgo.StandardObserver(2, 60.0, method="euler", timing="predictor", allow_unstable=True)
    sources(free, to="c", fixed_dt=1.01 * limit)


def test_another_period_is_refused() -> None:
    observer = standard(method="zoh", timing="current")
    sources(observer, to="c", fixed_dt=DT, dt=DT)
    with pytest.raises(HgoError, match=r"^dt = 0\.02: must be left out, or fixed_dt = 0\.01 s"):
        sources(observer, to="c", fixed_dt=DT, dt=2.0 * DT)
    t = np.arange(5) * DT
    log = (t, np.zeros(5), np.zeros(5))
    sources(observer, to="c", fixed_dt=DT, log=log)
    t[3:] += 0.3 * DT
    with pytest.raises(HgoError, match=r"^a step of log = 0\.013.*: must be fixed_dt = 0\.01 s"):
        sources(observer, to="c", fixed_dt=DT, log=log)
    with pytest.raises(HgoError, match=r"^fixed_dt = 1e-50: must be within .* single precision"):
        sources(observer, to="c", fixed_dt=1e-50, precision="single")


def test_a_gain_that_moves_and_is_found_by_iteration_is_still_refused() -> None:
    gain = hgo.AdaptiveGain(0.05, 0.5, 0.2)
    observer = hgo.LowPowerObserver(3, gain, method="zoh")
    with pytest.raises(HgoError, match='choose method="rk4"'):
        sources(observer, to="c", fixed_dt=DT)


@pytest.mark.skipif(bool(lacking()), reason=f"{lacking()} not found")
@pytest.mark.parametrize("timing", ["predictor", "current"])
@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("law", ["standard, n = 2", "low-power, n = 3"])
def test_zoh_costs_the_chip_at_most_1_3_times_eulers_instructions(
    law: str, precision: str, timing: str
) -> None:
    euler, zoh, any_dt = fixed.beside(law, precision, timing, here=False)
    assert 20.0 < zoh.instructions <= 1.3 * euler.instructions < any_dt.instructions * 1.3
    # with current timing 16 rows of gains are held
    if timing == "predictor" or law.startswith("standard"):
        assert zoh.bytes <= 1.3 * euler.bytes
    assert zoh.bytes < any_dt.bytes


def test_a_turning_axis_has_the_bits_of_run(tmp_path: Path) -> None:
    y = np.mod(0.7 * np.arange(N), 6.28)
    y[sorted(MISSING)] = np.nan
    for timing in ("predictor", "current"):
        observer = hgo.StandardObserver(2, 20.0, wrap=6.28, method="zoh", timing=timing)
        log = (TIMES, y, np.zeros((N, 0)))
        described = program(observer, name="o", precision="double", fixed_dt=DT, log=log)
        memory = observer.run(DT, y).memory
        rows = memory[1:] if timing == "predictor" else memory[:-1]
        assert np.array_equal([row.memory for row in described.vector], rows[:, :2])
        folder = put(tmp_path / timing, c_files(described))
        assert says_ok(in_c(folder, "o"), N - 1)
