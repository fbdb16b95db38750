"""Exported programs: the bits of the core, in C and in Rust, on this computer and on a chip."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import (
    FLAGS,
    STRICT,
    checked_as_cpp,
    checked_by_clippy,
    in_c,
    in_rust,
    lacking,
    on_the_chip,
    put,
    run,
    says_ok,
)

import hgo_rs
from hgo_rs import InputGain, LowPowerObserver, Model, SampledDataObserver, StandardObserver, _core
from hgo_rs.errors import HgoError
from hgo_rs.exports import export, sources
from hgo_rs.exports.c import files as c_files
from hgo_rs.exports.names import Names
from hgo_rs.exports.precision import PRECISIONS
from hgo_rs.exports.program import Field, Move, Program, Row, Words, program
from hgo_rs.exports.rust import files as rust_files
from hgo_rs.exports.table import FUNCTIONS, graph
from hgo_rs.observers import Observer

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="written for GNU's tools")
# --- observers ------------------------------------------------------------------------------------

# what the papers write down, and what is best for data
PAPER: dict[str, Any] = {"method": "euler", "timing": "predictor"}
BEST: dict[str, Any] = {"method": "zoh", "timing": "current"}

KINDS = {
    "standard": lambda: StandardObserver(
        3, 20.0, method="rk4", timing="predictor", model=InputGain(1.7)
    ),
    "adaptive": lambda: StandardObserver(2, hgo_rs.AdaptiveGain(0.05, 0.5, 0.2), **PAPER),
    "low_power": lambda: LowPowerObserver(
        4, 5.0, method="staggered-euler", timing="predictor", model=InputGain(2.0)
    ),
    "peaking_free": lambda: hgo_rs.PeakingFreeObserver(
        5,
        4.0,
        model=hgo_rs.Crackle(),
        saturation=[1.0, 0.5, 0.5, 0.5],
        method="bogacki-shampine",
        timing="predictor",
    ),
    "sampled": hgo_rs.SampledDataObserver,
    "current": lambda: StandardObserver(
        2, 20.0, method="euler", timing="current", model=InputGain(1.7)
    ),
    "exact": lambda: StandardObserver(2, 20.0, **BEST),
    "moving": lambda: StandardObserver(
        2, hgo_rs.AdaptiveGain(0.05, 0.5, 0.2), method="rk4", timing="current"
    ),
    "arm": lambda: two_links(**PAPER),
    "filtered_arm": lambda: two_links(**BEST),
    "pendulum": lambda: pendulum(),
    "driven": lambda: driven(**BEST),
    "low_held": lambda: LowPowerObserver(3, 20.0, model=InputGain(2.0), **BEST),
    "free_held": lambda: hgo_rs.PeakingFreeObserver(
        3, 8.0, saturation=0.5, clip="smooth", method="bilinear", timing="predictor"
    ),
    "arm_held": lambda: two_links(LowPowerObserver, **BEST),
    "ship": lambda: hgo_rs.ReducedOrderObserver(0.5),
    "strict": lambda: strict_feedback(),
}
"""Observers; of those whose gains are held the period is `DT`."""

DT = 0.01


def strict_feedback() -> Observer:
    """The reduced-order observer of a model of one's own."""
    model = hgo_rs.Model(
        states=["p", "v"],
        inputs=["u"],
        parameters={"d": 0.3},
        f1=["0.1*sin(p)"],
        g=[["1 + 0.1*cos(p)"]],
        f2=["u - d*v*p + 0.3*sin(4*t)"],
    )
    return hgo_rs.ReducedOrderObserver(0.05, h_bar=[0.4], model=model)


def driven(**manner: Any) -> Observer:
    """A model with time and input in it."""
    model = hgo_rs.Model(
        states=["q", "v"], inputs=["u"], parameters={"c": 0.4}, phi="u - c*v - sin(q) + cos(3*t)"
    )
    return StandardObserver(2, 15.0, model=model, **manner)


def two_links(law: Any = StandardObserver, **manner: Any) -> Observer:
    """Two coupled joints with an encoder each."""
    model = hgo_rs.Model(
        states=["q1", "w1", "q2", "w2"],
        orders=[2, 2],
        parameters={"c": 2.0},
        phi=["-sin(q1) + c*tanh(q2 - q1)", "c*(q1 - q2) - 0.1*w2"],
    )
    joint = [law(2, ell, **manner) for ell in (12.0, 15.0)]
    return hgo_rs.MultiOutputObserver(joint, model=model)


def pendulum() -> Observer:
    """An own model with a sine, a parameter and user's names, as its spec."""
    table = {
        "inputs": ["t", "x[0]", "x[1]", "u[0]", "g_l", "Fv"],
        "constants": [],
        "ops": [
            ["sin", 1],
            ["mul", 4, 6],
            ["neg", 7],
            ["mul", 5, 2],
            ["sub", 8, 9],
            ["add", 10, 3],
        ],
        "outputs": [11],
        "output_names": ["phi"],
    }
    observer = StandardObserver(2, 15.0, **PAPER)
    names = {"states": ["theta", "omega"], "inputs": ["torque"], "parameters": ["g_l", "Fv"]}
    model = {"kind": "own", "form": "phase", "n": 2, "n_u": 1, "table": table}
    return Observer(
        {**observer.spec, "model": {**model, "parameters": [9.81, 0.3], "names": names}}
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_program_has_the_bits_of_the_core(tmp_path: Path, kind: str) -> None:
    observer = KINDS[kind]()
    held = {"dt": DT} if "held" in kind else {}
    observer.export(to="c", out=tmp_path, name=kind, **held)
    # every step of the vector has a value
    assert ", 2, {" not in (tmp_path / f"{kind}_vector.h").read_text()
    every = FLAGS.values() if kind == "pendulum" else [FLAGS["gnu11 -O3 native"]]
    for flags in every:
        assert says_ok(in_c(tmp_path, kind, flags), 100)
    if kind not in ("standard", "low_power", "peaking_free", "exact", "moving"):
        observer.export(to="rust", out=tmp_path, name=kind, **held)
        assert says_ok(in_rust(tmp_path, kind), 100)


SINGLE = ["pendulum", "sampled", "filtered_arm", "driven", "low_held", "arm_held", "strict"]


@pytest.mark.parametrize("kind", SINGLE)
def test_single_precision_is_the_cores_in_both_languages(tmp_path: Path, kind: str) -> None:
    observer = KINDS[kind]()
    given: dict[str, Any] = {"name": kind, "precision": "single"}
    given |= {"dt": DT} if "held" in kind else {}
    observer.export(to="c", out=tmp_path, **given)
    assert says_ok(in_c(tmp_path, kind, FLAGS["gnu11 -O3 native"]), 100)
    observer.export(to="rust", out=tmp_path, **given)
    assert says_ok(in_rust(tmp_path, kind), 100)


def test_the_vector_is_what_run_gives(tmp_path: Path) -> None:
    observer = pendulum()
    observer.reset([0.4, -0.2])
    t = np.cumsum([0.0, 0.01, 0.012, 0.01, 0.02, 0.01])
    y, u = [0.5, 0.49, np.nan, 0.46, 0.41, 0.0], [0.1, 0.2, 0.0, -0.1, 0.3, 0.0]
    described = program(observer, name="p", precision="double", log=(t, y, u))
    result = observer.run(t, y, u, memory0=observer.memory)
    assert [row.memory for row in described.vector] == [tuple(m) for m in result.memory[1:]]
    assert [row.status for row in described.vector] == [0, 0, 1, 0, 0]


def test_the_vector_of_current_timing_is_what_run_gives() -> None:
    observer = driven(**BEST)
    start = observer.initial_memory([0.4, -0.2])
    observer.reset(memory0=start)
    t = np.cumsum([0.0, 0.01, 0.012, 0.01, 0.02, 0.01, 0.01])
    y, u = [0.5, 0.49, np.nan, np.nan, 0.46, 0.41, 0.0], [0.1, 0.2, 0.0, -0.1, 0.3, 0.0, 0.0]
    described = program(observer, name="p", precision="double", log=(t, y, u))
    # a row of run stands behind the use of its sample, as a step does
    result = observer.run(t, y, u, memory0=start)
    assert [row.memory for row in described.vector] == [tuple(m) for m in result.memory[:-1]]
    assert [row.status for row in described.vector] == [0, 0, 1, 1, 0, 0]
    # u and dt are those of the period that ends with the sample
    assert [row.u[0] for row in described.vector[1:]] == u[:5]
    assert [row.dt for row in described.vector[1:]] == list(np.diff(t)[:5])


@pytest.mark.parametrize("manner", [PAPER, BEST], ids=["predictor", "current"])
def test_the_single_vector_is_what_the_core_runs_in_single_precision(manner: Any) -> None:
    observer = driven(**manner)
    t = np.cumsum(np.full(40, 0.0125)).astype(np.float32).astype(float)
    y, u = np.sin(t), 0.2 * np.cos(t)
    y[7] = np.nan
    described = program(observer, name="p", precision="single", log=(t, y, u))
    start = observer.memory.tolist()
    memory = _core.run_single(observer.spec, t.tolist(), y[:, None], u[:, None], start)
    rows = memory[:-1] if manner is BEST else memory[1:]
    assert [row.memory for row in described.vector] == [tuple(map(float, m)) for m in rows]


def test_time_and_input_of_a_sampled_model_reach_the_source(tmp_path: Path) -> None:
    model = hgo_rs.Model(
        states=["q", "v"],
        inputs=["u"],
        f=["v", "20*sin(5*t) - q + u"],
        K_T=["0.5*(y - q)*(1 + t)", "u*(y - q)"],
    )
    t = 0.01 * np.arange(30)
    y, u = np.cos(t), 0.5 + np.sin(t)
    observer = hgo_rs.SampledDataObserver(model)
    observer.export(to="c", out=tmp_path, name="sd", log=(t, y, u))
    assert says_ok(in_c(tmp_path, "sd"), 29)
    rows = program(observer, name="sd", precision="double", log=(t, y, u)).vector
    q, v = 0.0, 0.0
    for k, row in enumerate(rows):
        e = y[k] - q
        rate = 20.0 * np.sin(5.0 * t[k]) - q + u[k]
        q, v = q + 0.01 * v + 0.5 * e * (1.0 + t[k]), v + 0.01 * rate + u[k] * e
        np.testing.assert_allclose(row.memory, [q, v], rtol=1e-12)


def test_time_keeps_its_digits_in_single_precision(tmp_path: Path) -> None:
    model = hgo_rs.Model(states=["q", "v"], phi="t - 36000")
    observer = StandardObserver(2, 2.0, model=model, **PAPER)
    t = 36000.0 + 0.001 * np.arange(9)
    log = (t, np.full(9, np.nan), np.zeros((9, 0)))
    observer.export(to="c", out=tmp_path, name="slow", precision="single", log=log)
    assert "float y, double t, float dt" in (tmp_path / "slow.h").read_text()
    assert says_ok(in_c(tmp_path, "slow"), 8)
    v = np.float32(0.0)
    for row, now in zip(program(observer, name="slow", precision="single", log=log).vector, t,
                        strict=False):  # fmt: skip
        v += np.float32(row.dt) * (np.float32(now) - np.float32(36000.0))
        assert row.memory[1] == v
    assert v > 0.0  # a sum of 0.001 in single precision stands still from 16384 s on


def test_a_source_is_readable() -> None:
    text = sources(pendulum(), to="c", name="arm", dt=0.01)
    header, source = text["arm.h"], text["arm.c"]
    for line in (
        "Standard observer of order 2.",
        "phi = -(g_l * sin(theta)) - Fv * omega + torque",
        "method: euler",
        "sampling: 0.01 s",
        "double theta; /* estimate of theta */",
        "double Fv; /* parameter */",
        "int arm_step(arm_state *state, double y, double torque, double t, double dt);",
    ):
        assert line in header, line
    for line in (
        "state->g_l = 9.81;",
        "const double innovation = isfinite(y) ? y - theta : 0.0;",
        "const double next_theta = theta + dt * (omega + 45.0 * innovation);",
    ):
        assert line in source, line


def test_a_step_without_a_value_keeps_the_memory(tmp_path: Path) -> None:
    observer = pendulum()
    y, u = [0.5, 0.49, 0.46, 0.41], [0.1, np.nan, 1e308, 0.0]
    observer.export(to="c", out=tmp_path, name="arm", log=(np.arange(4.0) / 100.0, y, u))
    assert ", 2, {" in (tmp_path / "arm_vector.h").read_text()
    assert says_ok(in_c(tmp_path, "arm"), 3)


def test_a_prediction_without_a_value_keeps_the_estimate_and_counts_the_time(
    tmp_path: Path,
) -> None:
    model = hgo_rs.Model(states=["q", "v"], inputs=["u"], phi="sqrt(u)")
    observer = StandardObserver(2, 5.0, model=model, **BEST)
    observer.reset([1.0, 2.0])
    t, y, u = 0.25 * np.arange(5), [1.0, 1.0, 1.0, 1.0, 1.0], [-1.0, -1.0, 4.0, 4.0, 4.0]
    observer.export(to="c", out=tmp_path, name="root", log=(t, y, u))
    assert says_ok(in_c(tmp_path, "root"), 4)
    observer.export(to="rust", out=tmp_path, name="root", log=(t, y, u))
    assert says_ok(in_rust(tmp_path, "root"), 4)
    rows = program(observer, name="root", precision="double", log=(t, y, u)).vector
    assert [row.status for row in rows] == [0, 2, 2, 0]
    assert rows[2].memory == (1.0, 2.0, 0.5)
    # moved by 2 dt + sqrt(4) dt^2/2 to 1.5625; corrected with the poles exp(-5 * 0.75 * [1, 2])
    poles = np.exp(-3.75 * np.array([1.0, 2.0]))
    q = 1.5625 + (1.0 - poles.prod()) * (1.0 - 1.5625)
    np.testing.assert_allclose(rows[3].memory[0], q, rtol=1e-12)


def test_a_wrong_bit_is_found(tmp_path: Path) -> None:
    texts = sources(StandardObserver(2, 37.0, **PAPER), to="c", name="axis")
    texts["axis.c"] = texts["axis.c"].replace("isfinite(y) ? y - x1", "isfinite(y) ? x1 - y")
    put(tmp_path, texts)
    run("cc", *STRICT, tmp_path / "main.c", tmp_path / "axis.c", "-o", tmp_path / "d")
    done = subprocess.run([tmp_path / "d"], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert re.match(r"step 0: x1 = \S+, expected \S+\n", done.stdout)


# --- gains that are held --------------------------------------------------------------------------


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("kind", ["low_held", "arm_held"])
def test_held_gains_are_those_of_a_table_for_their_time_alone(kind: str, precision: str) -> None:
    observer = KINDS[kind]()
    spec, single = observer.spec, precision == "single"
    real = PRECISIONS[precision].real
    rows = program(observer, name="p", precision=precision, dt=DT, periods=5)
    assert rows.periods is not None
    time = real(0.0)
    rng = np.random.default_rng(1)
    for k, length in enumerate(rows.periods.lengths, start=1):
        time = real(time + real(DT))
        assert length == time and rows.periods.count(length) == k
        z = rng.standard_normal(observer.memory.size)
        elapsed = [gains.held.elapsed for gains in rows.gains]
        z[elapsed] = length
        y = rng.standard_normal(observer.n_y)
        alone = _core.trace_step(spec, single, part="correct", dt=float(length))
        any_time = _core.trace_step(spec, single, part="correct", gains="held")
        gains = [gain for of in rows.gains for gain in of.held.rows[k]]
        given = [0.0, *z, *y, *([2.0] if kind == "arm_held" else [])]
        made = [
            _core.evaluate_table(table, [[*given, *more]], single)
            for table, more in ((alone, []), (any_time, gains))
        ]
        assert made[0] == made[1]
    assert not any(any(of.held.rows[0]) for of in rows.gains)


@pytest.mark.parametrize("precision", ["double", "single"])
def test_periods_are_counted_through_rounding_and_jitter_is_not(
    tmp_path: Path, precision: str
) -> None:
    observer = LowPowerObserver(2, 20.0, **BEST)
    rows = program(observer, name="axis", precision=precision, dt=1e-3, periods=7)
    times: list[tuple[float, int]] = [(0.0, 0), (-1e-3, 0), (math.inf, 0), (math.nan, 0), (1e30, 0)]
    times += [(k * 1e-3 * (1.0 + 1e-6), k if k <= 7 else 0) for k in range(1, 20)]
    times += [(k * 1e-3 * (1.0 - 1e-6), k if k <= 7 else 0) for k in range(1, 20)]
    times += [(k * 1e-3 + 2e-5, 0) for k in range(20)]
    times += [(5e-4, 0), (1.5e-3, 0), (1e-3 * (1.0 + 1e-4), 0), (7.5e-3, 0)]
    assert rows.periods is not None
    assert [rows.periods.count(time) for time, _ in times] == [k for _, k in times]
    calls = "\n".join(
        f'    printf("%d ", axis_periods({float(time)!r}));'.replace("inf", "INFINITY").replace(
            "nan", "NAN"
        )
        for time, _ in times
    )
    text = '#include "axis.h"\n#include <math.h>\n#include <stdio.h>\nint main(void)\n{\n'
    put(tmp_path, {**c_files(rows), "driver.c": f"{text}{calls}\n    return 0;\n}}\n"})
    run("cc", "-std=c99", tmp_path / "driver.c", tmp_path / "axis.c", "-lm", "-o", tmp_path / "d")
    assert [int(k) for k in run(tmp_path / "d").split()] == [k for _, k in times]


def test_after_a_time_without_gains_the_estimate_follows_again() -> None:
    """A sample is refused, its period is predicted over, and the next one is used."""
    observer = LowPowerObserver(2, 20.0, **BEST)
    t = 0.01 * np.arange(400.0)
    t[200:] += 0.0043
    log = (t, 1.0 + 2.0 * t, np.zeros((400, 0)))
    rows = program(observer, name="p", precision="double", dt=0.01, log=log).vector
    assert [k for k, row in enumerate(rows) if row.status == 3] == [200]
    assert rows[200].memory[-1] == 0.0
    assert abs(rows[-1].memory[1] - 2.0) < 1e-6 and abs(rows[201].memory[1] - 2.0) < 1e-3


# --- every operation ------------------------------------------------------------------------------

ELEMENTARY = sorted(FUNCTIONS.values())
TWO = ("powf", "atan2")


def some_numbers(rng: np.random.Generator, count: int) -> np.ndarray:
    """Of all sizes and signs, with every special one."""
    special = [0.0, -0.0, 1.0, -1.0, 0.5, math.inf, -math.inf, math.nan, 5e-324, 1e-310, 1e-42,
               2.0**-149, 1.5, 709.0, -745.0, 88.0, -103.0, 1e9, 2e4, 3.0e38, 1.7e308]  # fmt: skip
    wide = rng.standard_normal(count) * 10.0 ** rng.uniform(-12, 12, count)
    near = rng.uniform(-30.0, 30.0, count)
    return np.concatenate([special, wide, near])


INPUTS = ("t", "dt", "z[0]", "z[1]", "y[0]", "u[0]")


def random_table(rng: np.random.Generator, count: int) -> dict[str, Any]:
    """A program of all operations on two inputs beside t, dt and two states."""
    names = [*INPUTS]
    constants = [0.5, -1.25, 3.0, 1.0, -0.0, 0.0, 0.1]
    unary = ["neg", "abs", "sign", "sqrt"]
    binary = ["add", "sub", "mul", "div", "min", "max", "lt", "le", "eq", "innovation", "copysign"]
    words = [*unary, *binary, "select", *(w for w, f in FUNCTIONS.items() if f in ELEMENTARY)]
    ops: list[list[Any]] = []
    for i in range(count):
        word = words[i % len(words)]
        arity = 3 if word == "select" else 2 if word in (*binary, "pow", "atan2") else 1
        known = len(names) + len(constants) + i
        ops.append([word, *rng.integers(max(0, known - 14), known, arity).tolist()])
        if rng.random() < 0.3:
            ops[-1][1] = int(rng.integers(0, len(names)))
    last = len(names) + len(constants) + count
    return {"inputs": names, "constants": constants, "ops": ops, "outputs": [last - 1, last - 2]}


def bare(table: dict[str, Any], rows: np.ndarray, precision: str) -> Program:
    """A program without an observer; the vector is evaluated here."""
    real = PRECISIONS[precision].real
    memory, vector = [0.5, -0.25], []
    for row in rows.astype(real).astype(float):
        t, dt, y, u = row.tolist()
        [moved] = _core.evaluate_table(table, [[t, dt, *memory, y, u]], precision == "single")
        fine = np.isfinite(moved).all()
        memory = moved if fine else memory
        status = 2 if not fine else 0 if math.isfinite(y) else 1
        vector.append(Row(t, dt, (y,), (u,), status, tuple(memory)))
    fields = (Field("alpha", "one", 0.5), Field("Beta", "two", -0.25))
    words = Words(("alpha", "Beta"), ("y",), ("u",), (), "started", ())
    names = Names(("alpha", "Beta", "y", "u"))
    step = Move("step", graph(table, precision), INPUTS)
    return Program(
        "maze",
        PRECISIONS[precision],
        fields,
        (),
        words,
        names,
        (step,),
        (),
        "A maze.",
        tuple(vector),
    )


@pytest.mark.parametrize("precision", ["double", "single"])
def test_random_programs_have_the_same_bits_everywhere(tmp_path: Path, precision: str) -> None:
    rng = np.random.default_rng(5)
    for size in (40, 110):
        table = random_table(rng, size)
        rows = rng.standard_normal((60, 4)) * [1.0, 0.1, 2.0, 3.0]
        rows[10:13, 2] = np.nan
        program = bare(table, rows, precision)
        put(tmp_path, c_files(program))
        assert says_ok(in_c(tmp_path, "maze", FLAGS["gnu11 -O3 native"]), 60)
        if size > 100:
            put(tmp_path, rust_files(program))
            assert says_ok(in_rust(tmp_path, "maze"), 60)


# --- no warning -----------------------------------------------------------------------------------


def odd() -> Observer:
    """Numbers and names that linters know, and terms that cancel."""
    model = hgo_rs.Model(
        states=["foo", "baz"],
        inputs=["quux", "a1", "a2", "a3", "a4", "a5", "a6"],
        parameters={"near_pi": 3.14159, "e": 2.7182818284, "long": 0.1234567890123456},
        phi="near_pi*foo - e*long + (foo - foo) + foo*0 + piecewise(foo, baz > 0, foo) + quux/3"
        " - (-foo) + min(foo, foo) + a1*a2 - a3*t + t*t + a4 + a5 + a6 + 1.5707963267948966",
    )
    return StandardObserver(2, 5.0, model=model, method="euler", timing="predictor")


@pytest.mark.parametrize("precision", ["double", "single"])
def test_no_compiler_and_no_linter_warns(tmp_path: Path, precision: str) -> None:
    rng = np.random.default_rng(2)
    rows = rng.standard_normal((20, 4)) * [1.0, 0.1, 2.0, 3.0]
    rows[10:13, 2] = np.nan
    programs = [bare(random_table(rng, size), rows, precision) for size in (20, 60, 120)]
    observers = [odd(), *(make() for make in KINDS.values())]
    programs += [program(of, name="maze", precision=precision, dt=DT) for of in observers]
    for number, described in enumerate(programs):
        folder = put(tmp_path / str(number), c_files(described))
        run("gcc", *STRICT, "-fsyntax-only", folder / "maze.c", folder / "main.c")
        checked_as_cpp(folder, "maze")
    if shutil.which("cargo-clippy") is None:
        pytest.skip("not installed: cargo clippy")
    held = [described for described in programs if described.gains]
    for described in [programs[0], programs[2], programs[3], *held, programs[-1]]:
        checked_by_clippy(put(tmp_path / "rust", rust_files(described)))


# --- elementary functions -------------------------------------------------------------------------

CORE = """\
#![allow(dead_code)]
#[path = "{source}"]
mod elementary;
mod double {{ {double} }}
mod single {{ {single} }}
use std::io::Read;
fn main() {{
    let mut bytes = Vec::new();
    std::io::stdin().read_to_end(&mut bytes).unwrap();
    let numbers: Vec<f64> =
        bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect();
    for pair in numbers.windows(2) {{
        let (x, p) = (pair[0], pair[1]);
        let (xs, ps) = (x as f32, p as f32);
{lines}
    }}
}}
"""

IN_C = """\
#include "{name}.c"
#include <inttypes.h>
#include <stdio.h>
int main(void)
{{
    double pair[2];
    pair[0] = 0.0;
    if (fread(&pair[1], 8, 1, stdin) != 1) return 1;
    for (;;) {{
        {real} x, p;
        pair[0] = pair[1];
        if (fread(&pair[1], 8, 1, stdin) != 1) return 0;
        x = ({real})pair[0];
        p = ({real})pair[1];
{lines}
    }}
}}
"""


def all_functions(precision: str) -> Program:
    """A program that uses every elementary function and the square root."""
    calls = [["sqrt", 4], *[[word, 4, 5] if function in TWO else [word, 4]
             for word, function in FUNCTIONS.items() if function in ELEMENTARY]]  # fmt: skip
    table = {"inputs": [*INPUTS], "constants": [], "ops": calls}
    first = len(table["inputs"])
    ops: list[list[Any]] = [*calls]
    for i in range(1, len(calls)):
        ops.append(["add", first + len(ops) - (1 if i > 1 else len(calls)), first + i])
    table = {**table, "ops": ops, "outputs": [first + len(ops) - 1, 3]}
    return bare(table, np.zeros((0, 4)), precision)


@pytest.fixture(scope="module")
def numbers() -> np.ndarray:
    return some_numbers(np.random.default_rng(3), 2000)


@pytest.fixture(scope="module")
def core_bits(tmp_path_factory: pytest.TempPathFactory, numbers: np.ndarray) -> dict[str, Any]:
    """Every function of the core's own source, and of the exported Rust, by rustc."""
    folder = tmp_path_factory.mktemp("core")
    lines = []
    for precision, x, p in (("double", "x", "p"), ("single", "xs", "ps")):
        for name in ELEMENTARY:
            given = f"{x}, {p}" if name in TWO else x
            for place in ("elementary", precision):
                lines.append(f'        print!("{{:x}} ", {place}::{name}({given}).to_bits());')
        lines.append(f'        print!("{{:x}} {{:x}} ", {x}.sqrt().to_bits(), '
                     f"{precision}::sqrt({x}).to_bits());")  # fmt: skip
    lines.append("        println!();")
    texts = {}
    for precision in PRECISIONS:
        text = rust_files(all_functions(precision))["src/lib.rs"]
        text = re.sub(r"^(//!|#!).*\n", "", text, flags=re.M)
        texts[precision] = re.sub(r"^fn ", "pub fn ", text, flags=re.M)
    source = CORE.format(source=ROOT / "src" / "elementary.rs", lines="\n".join(lines), **texts)
    put(folder, {"main.rs": source})
    std = ("--cfg", 'feature="std"')
    run("rustc", "--edition=2024", *std, "-Copt-level=1", "-o", folder / "main", folder / "main.rs")
    done = subprocess.run(
        [folder / "main"], input=numbers.tobytes(), capture_output=True, check=True
    )
    words = np.array([line.split() for line in done.stdout.decode().splitlines()])
    columns: dict[str, Any] = {}
    count = 2 * len(ELEMENTARY) + 2
    for i, precision in enumerate(("double", "single")):
        part = words[:, i * count : (i + 1) * count]
        for j, name in enumerate([*ELEMENTARY, "sqrt"]):
            columns[precision, name, "core"] = part[:, 2 * j]
            columns[precision, name, "rust"] = part[:, 2 * j + 1]
    return columns


def as_numbers(words: np.ndarray, precision: str) -> np.ndarray:
    width = PRECISIONS[precision].width
    kind = np.uint64 if width == 64 else np.uint32
    return np.array([int(word, 16) for word in words], kind).view(PRECISIONS[precision].real)


def same(a: np.ndarray, b: np.ndarray) -> bool:
    """The same bits; one NaN is as good as another."""
    kind = np.uint64 if a.dtype == np.float64 else np.uint32
    return bool(np.all((a.view(kind) == b.view(kind)) | (np.isnan(a) & np.isnan(b))))


@pytest.mark.parametrize("precision", ["double", "single"])
def test_exported_rust_has_the_cores_functions(core_bits: dict[str, Any], precision: str) -> None:
    for name in [*ELEMENTARY, "sqrt"]:
        core, rust = (core_bits[precision, name, place] for place in ("core", "rust"))
        assert same(as_numbers(core, precision), as_numbers(rust, precision)), name


@pytest.mark.parametrize("precision", ["double", "single"])
def test_exported_c_has_the_cores_functions(
    tmp_path: Path, core_bits: dict[str, Any], numbers: np.ndarray, precision: str
) -> None:
    put(tmp_path, c_files(all_functions(precision)))
    real, width, code = (
        ("double", 64, "PRIx64") if precision == "double" else ("float", 32, "PRIx32")
    )
    calls = [f"maze_{name}({'x, p' if name in TWO else 'x'})" for name in ELEMENTARY]
    lines = [f'        printf("%" {code} " ", maze_to_bits({call}));' for call in calls]
    lines.append('        printf("\\n");')
    driver = IN_C.format(name="maze", real=real, lines="\n".join(lines))
    put(tmp_path, {"driver.c": driver})
    assert width == PRECISIONS[precision].width
    for flags in FLAGS.values():
        run("cc", *flags, tmp_path / "driver.c", "-lm", "-o", tmp_path / "driver")
        done = subprocess.run(
            [tmp_path / "driver"], input=numbers.tobytes(), capture_output=True, check=True
        )
        words = np.array([line.split() for line in done.stdout.decode().splitlines()])
        for j, name in enumerate(ELEMENTARY):
            core = as_numbers(core_bits[precision, name, "core"], precision)
            assert same(core, as_numbers(words[:, j], precision)), (name, flags)


def test_only_functions_that_are_used_are_printed() -> None:
    text = sources(StandardObserver(2, 37.0, **PAPER), to="c")["observer.c"]
    assert "_exp" not in text and "memcpy" not in text


def test_a_lower_bound_alone_prints_no_upper_one() -> None:
    """A minimum that is a line of its own, of a part that is used twice."""
    model = Model(
        states=["q", "v"], f=["0", "min(v*v, q)*(1 + min(v*v, q))"], K_T=["T*(y - q)", "T*(y - q)"]
    )
    text = sources(SampledDataObserver(model), to="c")["observer.c"]
    assert text.count("observer_min(") == 2
    assert "observer_max" not in text


# --- on a chip ------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", ["double", "single"])
def test_a_cortex_m4f_gives_the_same_bits(tmp_path: Path, precision: str) -> None:
    if lacking():
        pytest.skip(f"not installed: {lacking()}")
    pendulum().export(to="c", out=tmp_path, name="arm", precision=precision)
    assert says_ok(on_the_chip(tmp_path, "arm"), 100)
    rng = np.random.default_rng(7)
    rows = rng.standard_normal((40, 4)) * [1.0, 0.1, 2.0, 3.0]
    rows[20, 2] = np.nan
    put(tmp_path, c_files(bare(random_table(rng, 100), rows, precision)))
    assert says_ok(on_the_chip(tmp_path, "maze"), 40)


# --- names, refusals ------------------------------------------------------------------------------


def test_names_are_identifiers_and_never_the_same_twice() -> None:
    names = Names(("axis_step",))
    wishes = (
        "x",
        "for",
        "t",
        "state_t",
        "2nd",
        "\u03b8",
        "Fv",
        "J",
        "PI",
        "a b",
        "axis_step",
        "q_",
    )
    made = names.several([(wish, "state") for wish in wishes])
    assert made == ["x", "state_for", "state_t_2", "state_t", "v2nd", "u3b8", "Fv", "J",
                    "state_PI", "a_b", "state_axis_step", "q_"]  # fmt: skip
    assert [names.local(wish) for wish in ("x", "x", "dt", "h")] == ["x_2", "x_3", "value_dt", "h"]


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    observer = StandardObserver(2, 37.0, **PAPER)
    with pytest.raises(HgoError, match="to = 'ada': must be one of c, rust"):
        sources(observer, to="ada")
    with pytest.raises(HgoError, match="precision = 'half'"):
        sources(observer, to="c", precision="half")
    for name in ("Axis", "2nd", "a-b", "for", "core", ""):
        with pytest.raises(HgoError, match="name = "):
            sources(observer, to="c", name=name)
    with pytest.raises(HgoError, match="dt = -1"):
        sources(observer, to="c", dt=-1.0)
    with pytest.raises(HgoError, match="t at sample 1 is 0 s after 0 s"):
        sources(observer, to="c", log=([0.0, 0.0], [1.0, 2.0], []))
    table = {"inputs": ["t"], "constants": [], "outputs": [1]}
    with pytest.raises(HgoError, match="op 0 is 'cosh'"):
        graph({**table, "ops": [["cosh", 0]]}, "double")
    with pytest.raises(HgoError, match="op 0 uses a register"):
        graph({**table, "ops": [["neg", 9]]}, "double")
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(HgoError, match="cannot be written"):
        export(observer, to="c", out=blocked)
    for method in ("zoh", "bilinear"):
        observer = LowPowerObserver(3, 5.0, method=method)
        with pytest.raises(HgoError, match=r"dt is missing: .* --dt, .*\"rk4\""):
            observer.export(to="c", out=tmp_path)
        for periods in (0, 257, 1.5):
            with pytest.raises(HgoError, match="periods = "):
                observer.export(to="c", out=tmp_path, dt=0.1, periods=periods)
        with pytest.raises(HgoError, match="dt = 1e-60"):
            observer.export(to="c", out=tmp_path, dt=1e-60, precision="single")
        moving = LowPowerObserver(3, hgo_rs.AdaptiveGain(0.05, 0.5, 0.2), method=method)
        with pytest.raises(HgoError, match=r"gain = 'adaptive': .* by iteration .*\"rk4\""):
            moving.export(to="c", out=tmp_path, dt=0.1)


def test_the_command_writes_what_the_file_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from hgo_rs.cli import main

    config = tmp_path / "my-axis.toml"
    config.write_text(
        'format = 1\nobserver = "standard"\norder = 2\ngain = 20.0\n[log]\ndt = 0.001\n'
    )
    with pytest.raises(SystemExit) as ended:
        main(["export", str(config), "--to", "c", "--out", str(tmp_path / "c")])
    assert ended.value.code == 0
    assert capsys.readouterr().out.endswith(
        "my_axis.h, my_axis.c, my_axis_vector.h, main.c, Makefile\n"
    )
    assert "sampling: 0.001 s" in (tmp_path / "c" / "my_axis.h").read_text()
    assert says_ok(in_c(tmp_path / "c", "my_axis"), 100)
    config.write_text(config.read_text().replace("standard", "low-power"))
    given = ["export", str(config), "--to", "c", "--out", str(tmp_path / "low"), "--dt", "0.002"]
    with pytest.raises(SystemExit) as ended:
        main([*given, "--periods", "2"])
    assert ended.value.code == 0
    assert "1 to 2 periods of 0.002 s" in (tmp_path / "low" / "my_axis.h").read_text()
    with pytest.raises(SystemExit) as ended:
        main(["export", str(config), "--to", "c", "--out", str(config)])
    assert ended.value.code == 2
    assert "cannot be written" in capsys.readouterr().err


# --- python-control -------------------------------------------------------------------------------


def test_a_control_system_runs_as_the_observer_does() -> None:
    control = pytest.importorskip("control")
    observer = StandardObserver(2, 20.0, model=InputGain(1.5), **PAPER)
    t = np.arange(300) * 0.005
    y, u = np.sin(3.0 * t), np.cos(2.0 * t)
    system = observer.to_control(0.005)
    assert system.state_labels == ["x1", "x2"] and system.output_labels == ["x1_hat", "x2_hat"]
    start = observer.initial_memory([0.5, 0.0])
    response = control.input_output_response(system, t, np.vstack([y, u]), start)
    result = observer.run(0.005, y, u, memory0=start)
    # control interpolates its inputs, which rounds
    np.testing.assert_allclose(response.outputs.T, result.x_hat, rtol=0, atol=1e-12)
    # beside a plant in one diagram
    plant = control.ss([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.5]], [[1.0, 0.0]], 0.0,
                       inputs="u", outputs="y", name="plant")  # fmt: skip
    sampled = control.c2d(plant, 0.005)
    both = control.interconnect([sampled, system], inputs="u", outputs=["x1_hat", "x2_hat", "y"])
    response = control.input_output_response(both, t, u)
    assert np.max(np.abs(response.outputs[0] - response.outputs[2])[100:]) < 0.02


def test_a_control_system_of_a_law_that_filters() -> None:
    control = pytest.importorskip("control")
    observer: Observer = hgo_rs.ReducedOrderObserver(0.5)
    rng = np.random.default_rng(2)
    y = np.cumsum(0.1 + 0.01 * rng.standard_normal((50, 3)), axis=0)
    u = np.full((50, 2), 0.01)
    t = np.arange(50) * 0.1
    system = observer.to_control(0.1)
    response = control.input_output_response(system, t, np.hstack([y, u]).T, observer.memory)
    np.testing.assert_allclose(response.outputs.T, observer.run(0.1, y, u).x_hat, atol=1e-9)
    own = strict_feedback()
    system = own.to_control(0.1)
    assert len(set(system.state_labels)) == own.memory.size
    response = control.input_output_response(system, t, np.vstack([y[:, 0], u[:, 0]]), own.memory)
    run_of = own.run(0.1, y[:, :1], u[:, :1])
    np.testing.assert_allclose(response.outputs.T, run_of.x_hat, atol=1e-9)


def test_a_control_system_of_current_timing() -> None:
    control = pytest.importorskip("control")
    observer = StandardObserver(2, 20.0, timing="current", model=InputGain(1.5))
    t = np.arange(200) * 0.005
    y, u = np.sin(3.0 * t), np.cos(2.0 * t)
    system = observer.to_control(0.005)
    assert system.state_labels == ["x1", "x2", "elapsed"]
    response = control.input_output_response(system, t, np.vstack([y, u]), observer.memory)
    np.testing.assert_allclose(response.outputs.T, observer.run(0.005, y, u).x_hat, atol=1e-12)


@pytest.mark.parametrize("timing", ["predictor", "current"])
def test_control_closes_a_loop(timing: str) -> None:
    """State feedback from the estimates: the package's loop against correct, predict and step."""
    control = pytest.importorskip("control")
    dt, count, gains = 0.01, 300, np.array([-40.0, -12.0])
    model = Model(states=["q", "w"], inputs=["u"], phi="u - 9.81*sin(q) + cos(5*t)")
    observer = StandardObserver(2, 40.0, model=model, timing=timing)

    def plant(t: float, x: Any, u: Any, params: Any) -> Any:
        q, w = x
        rate = u[0] - 9.81 * np.sin(q) + np.cos(5.0 * t)
        return [q + dt * w + 0.5 * dt**2 * rate, w + dt * rate]

    x, by_hand = np.array([1.0, 0.0]), []
    observer.reset()
    for k in range(count):
        if timing == "current":
            observer.correct(x[0])
        estimate = observer.x_hat.copy()
        u = float(gains @ estimate)
        by_hand.append([*x, *estimate])
        if timing == "current":
            observer.predict(u, dt)
        else:
            observer.step(x[0], u, dt=dt)
        x = np.asarray(plant(k * dt, x, [u], {}))
    observer.reset()
    loop = control.interconnect(
        [
            control.NonlinearIOSystem(plant, inputs="u", outputs=["y", "w"], states=2, dt=dt),
            control.NonlinearIOSystem(
                None,
                lambda t, x, u, params: gains @ u,
                inputs=["q_hat", "w_hat"],
                outputs="u",
                dt=dt,
            ),
            observer.to_control(dt),
        ],
        inputs=[],
        outputs=["y", "w", "q_hat", "w_hat"],
    )
    start = [1.0, 0.0, *observer.initial_memory()]
    told = control.input_output_response(loop, dt * np.arange(count), X0=start)
    np.testing.assert_allclose(told.outputs.T, by_hand, rtol=0, atol=1e-9)
    assert abs(by_hand[-1][0]) < 0.1 and by_hand[0][0] == 1.0  # the loop is stable


def test_a_control_system_needs_a_stable_step() -> None:
    pytest.importorskip("control")
    with pytest.raises(HgoError, match="dt"):
        StandardObserver(2, 20.0, **PAPER).to_control(1.0)
    with pytest.raises(HgoError, match="dt = nan"):
        StandardObserver(2, 20.0).to_control(math.nan)


@pytest.mark.parametrize("length", ["dt", "fixed_dt"])
@pytest.mark.parametrize("shape", [hgo_rs.Stubborn(5.0, 20.0, 1e-4), hgo_rs.DeadZone(5.0, 2.0)])
def test_a_threshold_beside_held_gains_is_refused(length, shape, tmp_path):
    """For the reason that it is, with remedies that work."""
    given = {"shape": shape, "method": "zoh", "timing": "current"}
    with pytest.raises(
        HgoError, match=r"shape = .*without a moving threshold.*stored for whole periods"
    ):
        LowPowerObserver(3, 5.0, **given).export(to="c", out=tmp_path, **{length: 0.01})
    LowPowerObserver(3, 5.0, **given | {"method": "rk4"}).export(to="c", out=tmp_path / "a")
    given["timing"] = "predictor"
    LowPowerObserver(3, 5.0, **given).export(to="c", out=tmp_path / "b", dt=0.01)
