"""Every law under every method and timing that it allows: exported C and Rust, compiled at once,
have the bits of Python's step; sampled as planned, over gaps, and after a time without gains.
"""

from __future__ import annotations

import itertools
import re
import struct
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import STRICT, put, run
from matrices import some

import hgo_rs as hgo
from hgo_rs.design.discrete import fixed_timing
from hgo_rs.exports.c import files as c_files
from hgo_rs.exports.expressions import RUST, C, Dialect
from hgo_rs.exports.program import Program, program
from hgo_rs.exports.rust import files as rust_files
from hgo_rs.observers import Observer

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="written for GNU's tools")

DT = 0.01
PERIODS = 3
STEPS = [DT] * 36
STEPS[7] = 2.0 * DT  # one call over two periods
STEPS[18] = 1.37 * DT
MISSING = {11, 23, 24, 28, 29, 30}  # two, three, and four periods: more than are held
rng = np.random.default_rng(11)
Y = 0.4 * np.sin(0.3 * np.outer(np.arange(36), [1.0, 0.7, 0.4])) + rng.normal(0.0, 0.01, (36, 3))
Y[sorted(MISSING)] = np.nan
U = rng.normal(0.0, 0.5, (36, 2))

KNOWN = ("euler", "rk4", "bogacki-shampine", "rk4-innovation-held", "staggered-euler")
PLACED = ("zoh", "bilinear", "implicit-map")
CHAINED = (*PLACED, "proper", "implicit", "inter-sample")
TIMINGS = ("predictor", "current")


def phase(n: int) -> hgo.Model:
    """A model with time, state, input and a parameter in it."""
    states = [f"q{i}" for i in range(n)]
    phi = f"u - c*q{n - 1} - sin(q0) + 0.3*cos(3*t)"
    return hgo.Model(states=states, inputs=["u"], parameters={"c": 0.4}, phi=phi)


def unknown(law: type[Any]) -> Callable[..., Observer]:
    """An unknown that enters nonlinearly, with a slope that moves with the states."""
    side = "u - sin(q) + 0.3*cos(3*t) - (2 + cos(q))*(d + d**3)"
    model = hgo.Model(states=["q", "w"], inputs=["u"], phi=side, unknown="d")

    def made(**manner: Any) -> Observer:
        of: Observer = law(3, 4.0, model=model, allow_unstable=True, **manner)
        return of

    return made


def nonlinear_chain(**manner: Any) -> Observer:
    """Slopes that move with the states."""
    f = ["0.3*b**3 + 0.1*sin(2*t)", "0.4*c*cos(a) - 0.1*a*b*u", "-a - c + u*cos(t)"]
    model = hgo.Model(states=["a", "b", "c"], inputs=["u"], f=f)
    return hgo.StandardObserver(3, 6.0, model=model, allow_unstable=True, **manner)


def standard(**manner: Any) -> Observer:
    return hgo.StandardObserver(3, 6.0, model=phase(3), allow_unstable=True, **manner)


def low_power(**manner: Any) -> Observer:
    return hgo.LowPowerObserver(3, 6.0, model=phase(3), allow_unstable=True, **manner)


def free(clip: str) -> Callable[..., Observer]:
    def made(**manner: Any) -> Observer:
        return hgo.PeakingFreeObserver(
            4, 5.0, saturation=[0.3, 0.6, 0.9], clip=clip, allow_unstable=True, **manner
        )

    return made


def of_high_order(**manner: Any) -> Observer:
    """Gains that are found in twice the precision."""
    return hgo.LowPowerObserver(7, 4.0, allow_unstable=True, **manner)


def adaptive(**manner: Any) -> Observer:
    gain = hgo.AdaptiveGain(0.05, 0.5, 0.2)
    return hgo.StandardObserver(2, gain, model=phase(2), allow_unstable=True, **manner)


def shaped(gain: Any, shape: Any = None) -> Callable[..., Observer]:
    """A gain of the innovation or a clock, and a shape."""

    def made(**manner: Any) -> Observer:
        given = {"shape": shape, "model": phase(3), "allow_unstable": True, **manner}
        return hgo.StandardObserver(3, gain, **given)

    return made


def listed(kind: str, **given: Any) -> Callable[..., Observer]:
    """A law of the list by its kind."""

    def made(**manner: Any) -> Observer:
        of = {"model": phase(3), "allow_unstable": True, **given, **manner}
        return hgo.HighGainObserver(kind, 3, 6.0, **of)

    return made


def chains(**manner: Any) -> Observer:
    """Chains under laws with gains held, and computed."""
    model = hgo.Model(
        states=["q1", "w1", "q2", "w2", "q3", "w3"],
        orders=[2, 2, 2],
        inputs=["u1", "u2"],
        phi=["u1 - sin(q1) + tanh(q2 - q1)", "u2 + q1 - q2 - 0.1*w2*cos(t)", "q2 - q3"],
    )
    parts = [
        hgo.LowPowerObserver(2, 8.0, **manner),
        hgo.StandardObserver(2, 7.0, **manner),
        hgo.PeakingFreeObserver(2, 6.0, saturation=0.5, **manner),
    ]
    return hgo.MultiOutputObserver(parts, model=model, allow_unstable=True)


def adaptive_filter() -> Observer:
    """theta by the innovation of a window: it rises and falls."""
    gain = hgo.InnovationGain(6.0, 0.02, 9.0, threshold=1e-3, slope=1e4, samples=5)
    return hgo.HighGainEKF(2, gain, R=1e-4, Q=0.3, model=phase(2))


def filters(*orders: int) -> Callable[[], Observer]:
    """High-gain EKFs of sampled data, an output each: one filter of all states."""
    names = [f"q{i}" for i in range(sum(orders))]
    sides = [f"u - sin({name}) + 0.2*q0*cos(t)" for name in names[-len(orders) :]]

    def made() -> Observer:
        model = hgo.Model(states=names, orders=list(orders), inputs=["u"], phi=sides)
        given = {"R": 1e-4, "Q": 0.3}
        parts = [hgo.HighGainEKF(n, theta=1.0 + i, **given) for i, n in enumerate(orders)]
        return hgo.MultiOutputObserver(parts, model=model)

    return made


def filtered(gain: Any) -> Callable[..., Observer]:
    def made(**manner: Any) -> Observer:
        return hgo.HighGainObserver("filtered", 3, gain, filters=2, model=phase(3), **manner)

    return made


def copies(law: type[Any]) -> Callable[..., Observer]:
    def made(**manner: Any) -> Observer:
        gain = hgo.AdaptiveGain(0.05, 0.5, 0.2)
        of = law(
            gain, k=[3.0, 2.0], k_bar=[0.3, 0.2], model=phase(2), allow_unstable=True, **manner
        )
        starts = [[0.0, 0.0], [0.1, 0.0], [0.0, 0.2]]
        given = (starts,) if law is hgo.RepelledCollection else ([0.0, 0.1], starts)
        of.reset(memory0=of.spread(*given))
        return of

    return made


def sampled() -> Observer:
    model = hgo.Model(
        states=["q", "v"],
        inputs=["u"],
        f=["v", "2*sin(5*t) - q + u"],
        K_T=["0.5*(y - q)*(1 + 0.1*t)", "0.2*cos(u)*(y - q)"],
    )
    return hgo.SampledDataObserver(model)


def strict_feedback() -> Observer:
    """f1 and g with the measured states in them, f2 with time, inputs and all states."""
    model = hgo.Model(
        states=["p", "th", "v", "w"],
        inputs=["a", "m"],
        parameters={"d": 0.3},
        f1=["0.1*sin(p)", "0.2*th*p"],
        g=[["1 + 0.1*cos(th)", "0.2*th"], ["0.1*p", "2 + sin(p)"]],
        f2=["a - d*v*w + 0.3*sin(4*t)", "m*cos(th) - v + 0.1*p*t"],
    )
    return hgo.ReducedOrderObserver(0.05, h_bar=[0.4, 0.6], model=model)


def ship() -> Observer:
    of = hgo.ReducedOrderObserver(0.05)
    of.reset(x_hat0=[0.1, 0.02, 0.01])
    return of


LAWS: dict[str, tuple[Callable[..., Observer], tuple[str, ...]]] = {
    "standard": (standard, KNOWN + CHAINED),
    "low-power": (low_power, KNOWN + PLACED),
    "low-power, order 7": (of_high_order, ("rk4", "zoh")),
    "peaking-free, hard": (free("hard"), KNOWN + PLACED),
    "peaking-free, smooth": (free("smooth"), KNOWN + PLACED),
    "adaptive": (adaptive, KNOWN + PLACED),
    "homogeneous": (
        shaped(hgo.HomogeneousGain(2.0, -0.7)),
        ("euler", "rk4", "zoh", "proper", "inter-sample"),
    ),
    "levant": (shaped(hgo.HomogeneousGain.levant(2.0, 3)), ("implicit",)),
    "levant, filtered": (filtered(hgo.HomogeneousGain.levant(2.0, 5)), ("proper",)),
    "switched, stubborn": (
        shaped(hgo.SwitchedGain(9.0, 3.0, 0.05, 0.05), hgo.Stubborn(5.0, 20.0, 1e-4)),
        ("euler", "rk4", "zoh"),
    ),
    "deadline, fal": (
        shaped(hgo.PrescribedTimeGain(2.0, 0.3, 12.0), hgo.Fal((1.0, 0.6, 0.4), 0.02)),
        ("euler",),
    ),
    "bi-homogeneous": (
        shaped(4.0, hgo.BiHomogeneous(-0.5, 0.2, (1.0, 1.0, 1.0), (0.5, 0.2, 0.0))),
        ("euler",),
    ),
    "nonlinear chain": (nonlinear_chain, KNOWN + PLACED),
    "filtered": (listed("filtered", filters=2), ("euler", "rk4")),
    "limited gain power": (listed("limited-gain", saturation=0.4), KNOWN),
    "cascade": (listed("cascade", model=None, saturation=0.4, clip="smooth"), KNOWN),
    "reduced order": (listed("reduced-chain"), KNOWN),
    "an unknown": (unknown(hgo.StandardObserver), KNOWN + PLACED),
    "an unknown, low-power": (unknown(hgo.LowPowerObserver), KNOWN + PLACED),
    "chains": (chains, KNOWN + PLACED),
    "collection": (copies(hgo.RepelledCollection), KNOWN),
    "modified": (copies(hgo.ModifiedObserver), KNOWN),
}
CASES: dict[str, Callable[[], Observer]] = {
    f"{law}, {method}, {timing}": lambda make=make, method=method, timing=timing: make(
        method=method, timing=timing
    )
    for law, (make, methods) in LAWS.items()
    for method, timing in itertools.product(methods, TIMINGS)
    if fixed_timing(method) in (None, timing)
}
CASES |= {"adaptive EKF": adaptive_filter}
CASES |= {"EKFs of two outputs": filters(2, 3), "EKFs of three outputs": filters(1, 2, 2)}
CASES |= {"sampled-data": sampled, "strict-feedback": strict_feedback, "ship": ship}


def places(observer: Observer) -> list[tuple[list[int], int | None, bool]]:
    """For each chain: where its law's memory stands, where the time of its correction, and whether
    its gains are held."""
    laws = observer.spec.get("observers", (observer.spec,))
    x, rest, found = 0, sum(law.get("n", observer.n) for law in laws), []
    for law in laws:
        n = law.get("n", observer.n)
        low = law["kind"] in ("low-power", "peaking-free")
        own = [*range(x, x + n), *range(rest, rest + (n - 1) * low)]
        x, rest = x + n, rest + (n - 1) * low
        current = law.get("timing") == "current"
        found.append((own, rest if current else None, low and law["method"] in PLACED))
        rest += current
    return found


def python(observer: Observer, moves: Observer | None) -> tuple[list[Any], list[float]]:
    """Status and memory after every call, and the times of the clock. `moves` predicts alone."""
    rows, times, m = [], [], observer.memory.size
    held = [place for place in places(observer) if place[2]]
    kept = [*range(m)]
    if observer.spec["kind"] == "reduced-order":  # an own model has room for eight inputs
        kept = [*range(observer.n + observer.n_y + observer.n_u), m - 2, m - 1]

    def shows(status: int) -> None:
        rows.append((status, observer.memory[kept].tobytes()))

    for k, dt in enumerate(STEPS):
        y, u, told = Y[k, : observer.n_y], U[k, : observer.n_u], k not in MISSING
        times.append(observer._time)
        if observer.timing == "current":
            memory, refused = observer.memory.copy(), False
            for _, elapsed, _ in held:
                counted = abs(memory[elapsed] / DT - np.arange(PERIODS + 1))
                if counted.min() > 1e-3 and told:
                    memory[elapsed], refused = 0.0, True  # a correction for no time
            observer.memory = memory
            observer.correct(y)
            shows(3 if refused else 0 if told else 1)
            observer.predict(u, dt)
            shows(1)
            continue
        refused = bool(held) and dt not in (DT, 2.0 * DT)
        before = observer.memory.copy()
        observer.step(y, u, dt=dt)
        if refused:
            assert moves is not None
            memory, start = observer.memory.copy(), np.zeros(moves.memory.size)
            pairs = list(zip(places(observer), places(moves), strict=True))
            for (own, _, low), (other, elapsed, _) in pairs:
                start[other], start[elapsed] = before[own], 0.0 if low else dt
            moves.reset(memory0=start, t=times[-1])
            moves.correct(y)  # the other chains
            moves.predict(u, dt)  # all together
            for (own, _, _), (other, _, _) in pairs:
                memory[own] = moves.memory[other]
            observer.memory = memory
        shows(3 if refused else 0 if told else 1)
    return rows, times


SOME = some(CASES, "every")


@pytest.fixture(scope="module")
def cases() -> dict[str, tuple[Program, list[tuple[int, bytes]], list[float]]]:
    """The programs, and what Python makes of the samples."""
    made = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        for number, case in enumerate(SOME):
            observer = CASES[case]()
            described = program(
                observer, name=f"o{number}", precision="double", dt=DT, periods=PERIODS
            )
            other = CASES.get(case.replace("predictor", "current"), lambda: None)()
            made[case] = (described, *python(observer, other))
    return made


def samples_of(described: Program, times: list[float], dialect: Dialect) -> dict[str, list[str]]:
    """All calls' values of each argument, as text."""
    words = described.words
    given = dict(zip(words.samples, Y.T.tolist(), strict=False))
    given |= dict(zip(words.controls, U.T.tolist(), strict=False)) | {"dt": STEPS}
    taken = {word for move in described.moves for word in described.arguments(move)}
    text = {
        word: [dialect.literal(value, described.precision) for value in values[: len(times)]]
        for word, values in given.items()
        if word in taken
    }
    return text | ({"t": [repr(t) for t in times]} if "t" in taken else {})


C_HEAD = """\
#include <math.h>
#include <stdio.h>

static int status;

static void show(const void *memory, size_t bytes)
{
    printf("%d ", status);
    for (size_t i = 0; i < bytes; ++i) printf("%02x", ((const unsigned char *)memory)[i]);
    printf("\\n");
}
"""


def in_c(folder: Path, cases: dict[str, Any]) -> str:
    """All programs in C: one call of the compiler."""
    lines, includes, calls = [], [], []
    for described, _, times in cases.values():
        name = described.name
        put(folder, {file: text for file, text in c_files(described).items() if file[0] == "o"})
        includes.append(f'#include "{name}.h"')
        calls.append(f"    run_{name}();")
        fields = ", ".join(f"state.{field.name}" for field in described.memory)
        lines.append(f"static void run_{name}(void)\n{{\n    {name}_state state;\n")
        real = {"double": "double", "single": "float"}[described.precision.name]
        for word, values in samples_of(described, times, C).items():
            kind = "double" if word == "t" else real
            lines.append(f"    static const {kind} in_{word}[] = {{{', '.join(values)}}};")
        lines.append(f"    {name}_init(&state);")
        lines.append(f"    for (int k = 0; k < {len(times)}; ++k) {{")
        for move in described.moves:
            arguments = "".join(f", in_{word}[k]" for word in described.arguments(move))
            lines.append(f"    status = {name}_{move.verb}(&state{arguments});")
            lines.append(f"    {{ const {real} memory[] = {{{fields}}};")
            lines.append("      show(memory, sizeof memory); }")
        lines.append("    }\n}\n")
    main = ["int main(void)", "{", *calls, "    return 0;", "}", ""]
    put(folder, {"every.c": "\n".join([*includes, C_HEAD, *lines, *main])})
    run("gcc", *STRICT, "-O1", *folder.glob("*.c"), "-lm", "-o", folder / "every")
    return run(folder / "every")


RUST_HEAD = """\
#![allow(dead_code)]

fn show(status: u8, memory: &[u8]) {
    print!("{status} ");
    for byte in memory {
        print!("{byte:02x}");
    }
    println!();
}
"""


def in_rust(folder: Path, cases: dict[str, Any]) -> str:
    """All programs in Rust: one crate, a module each."""
    lines, calls = [], []
    for described, _, times in cases.values():
        name, kind = described.name, described.name.capitalize()
        source = re.sub(r"^#!\[no_std\]\n", "", rust_files(described)["src/lib.rs"], flags=re.M)
        put(folder, {f"{name}.rs": source.replace("#![forbid(unsafe_code)]\n", "")})
        calls.append(f"    run_{name}();")
        fields = ", ".join(f"state.{field.name}.to_le_bytes()" for field in described.memory)
        lines += [f"mod {name};", f"fn run_{name}() {{"]
        for word, values in samples_of(described, times, RUST).items():
            lines.append(f"    let in_{word} = [{', '.join(values)}];")
        lines.append(f"    let mut state = {name}::{kind}::new();")
        lines.append(f"    for k in 0..{len(times)} {{")
        for move in described.moves:
            given = ", ".join(f"in_{word}[k]" for word in described.arguments(move))
            lines.append(f"    let status = state.{move.verb}({given});")
            lines.append(f"    show(status as u8, &[{fields}].concat());")
        lines.append("    }\n}")
    put(folder, {"main.rs": "\n".join([RUST_HEAD, *lines, "fn main() {", *calls, "}"])})
    flags = ("--edition=2024", "-Copt-level=0", "-Cdebuginfo=0", "-Dwarnings")
    run("rustc", *flags, folder / "main.rs", "-o", folder / "every")
    return run(folder / "every")


@pytest.fixture(scope="module", params=["c", "rust"])
def printed(request: Any, tmp_path_factory: Any, cases: dict[str, Any]) -> dict[str, list[Any]]:
    return printed_in(request.param, tmp_path_factory.mktemp(request.param), cases)


def printed_in(language: str, folder: Path, cases: dict[str, Any]) -> dict[str, list[Any]]:
    """What the programs print, a row each call."""
    build = in_c if language == "c" else in_rust
    rows = build(folder, cases).splitlines()
    made, first = {}, 0
    for case, (described, _, times) in cases.items():
        count = len(times) * len(described.moves)
        split = [row.split() for row in rows[first : first + count]]
        made[case] = [(int(status), bytes.fromhex(memory)) for status, memory in split]
        first += count
    assert first == len(rows)
    return made


@pytest.mark.parametrize("case", SOME)
def test_every_law_has_the_bits_of_pythons_step(
    cases: dict[str, Any], printed: dict[str, list[Any]], case: str
) -> None:
    _, expected, _ = cases[case]
    held = any(law in case for law in ("low", "free", "chains"))
    refused = [status for status, _ in expected if status == 3]
    assert bool(refused) == (held and any(method in case for method in PLACED))
    for call, (made, wanted) in enumerate(zip(printed[case], expected, strict=True)):
        numbers = [struct.unpack(f"{len(of) // 8}d", of) for _, of in (made, wanted)]
        assert made == wanted, f"call {call}: {made[0]} {numbers[0]}, not {wanted[0]} {numbers[1]}"
