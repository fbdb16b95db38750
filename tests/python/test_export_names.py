"""Names of users in exported source: none meets one of a language, of a header or of ours."""

from __future__ import annotations

import itertools
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from exported import STRICT, in_c, in_rust, put, run, says_ok

from hgo_rs import HighGainEKF, Model, MultiOutputObserver, SampledDataObserver, StandardObserver
from hgo_rs.errors import HgoError
from hgo_rs.exports import sources, words
from hgo_rs.exports.program import program
from hgo_rs.observers import Observer

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="written for GNU's tools")

# words of the languages, of the headers, of boards and of the export itself
TEXT = """
int double float char long signed const static struct enum union typedef volatile register restrict
inline sizeof switch case default goto auto bool true false asm typeof complex imaginary noreturn
class template this new delete private public protected operator namespace using virtual friend try
catch throw typename explicit export mutable constexpr nullptr decltype concept requires co_await
co_yield alignas alignof thread_local static_assert wchar_t char8_t xor or_eq compl bitand not_eq
fn let mut impl trait mod use pub ref self Self super crate dyn async await move match loop where
yield gen macro become box final override priv unsized abstract raw safe macro_rules union_
f32 f64 u8 u64 usize str None Some Ok Err Option Vec Result Default Clone Copy String core std alloc
isnan isinf isfinite signbit fabs fabsf copysign floor round trunc fmin fmax y0 y1 j0 jn gamma
signgam I NAN INFINITY HUGE_VAL M_PI M_E FLT_EVAL_METHOD DBL_MAX UINT64_C NULL EOF RAND_MAX
OVERFLOW DOMAIN errno stdin stdout assert signal memcpy index div remainder time
linux unix i386 near far interrupt
F PI B0 HIGH LOW INPUT OUTPUT LED_BUILTIN A0 SERIAL DEC bit word byte boolean constrain lowByte MAX
PORTB DDRB SREG GPIOA TIM1 RCC ADC SP E B1 TWO_PI EULER DEG_TO_RAD data code idata at sbit
dt state next y u y_2 u_1 t_ elapsed started x_hat r eta x1 x2 innovation h a a_2 b status real
v_dt next_q q_rate q_stage next_dt parameter_dt state_dt input_dt sample_y memory_elapsed value_a
axis axis_step axis_init axis_state axis_correct axis_predict axis_sin axis_min axis_to_bits
axis_row axis_exp_result AXIS_UPDATED AXIS_UNDEFINED Axis Status UPDATED Updated result bits x k n m
low high to_bits from_bits sin_q q_squared limited_q finite_ memory given row names steps
STEPS MEMORY q Q qq
axis_periods axis_gains axis_gains_1 gains periods gains_1 periods_1 counted nearest among GAINS
"""
NAMES = TEXT.split()

# what a board's header defines before it is included
BOARD = """\
#define HIGH 0x1
#define LOW 0x0
#define INPUT 0x0
#define OUTPUT 0x1
#define PI 3.1415926535897932384626433832795
#define TWO_PI 6.28
#define EULER 2.718
#define DEG_TO_RAD 0.017
#define SERIAL 0x0
#define DEC 10
#define LED_BUILTIN 13
#define A0 14
#define B0 0
#define B1 1
#define PORTB (*(volatile unsigned char *)(0x25))
#define DDRB (*(volatile unsigned char *)(0x24))
#define SREG (*(volatile unsigned char *)(0x5F))
#define SP (*(volatile unsigned *)(0x5D))
#define ADC (*(volatile unsigned *)(0x78))
#define GPIOA ((void *)0x40020000)
#define TIM1 ((void *)0x40010000)
#define RCC ((void *)0x40023800)
#define MAX(a, b) ((a) > (b) ? (a) : (b))
#define F(string) (string)
#define min(a, b) ((a) < (b) ? (a) : (b))
#define max(a, b) ((a) > (b) ? (a) : (b))
#define abs(x) ((x) > 0 ? (x) : -(x))
#define round(x) ((x) >= 0 ? (long)((x) + 0.5) : (long)((x) - 0.5))
#define constrain(x, low, high) ((x) < (low) ? (low) : (x) > (high) ? (high) : (x))
#define sq(x) ((x) * (x))
#define bit(b) (1UL << (b))
#define lowByte(w) ((unsigned char)((w) & 0xff))
#define interrupt
#define near
#define far
typedef unsigned int word;
typedef unsigned char byte;
typedef unsigned char boolean;
"""


def own(states: list[str], inputs: list[str], parameters: list[str]) -> Observer:
    """A model in which every name counts, and every elementary function."""
    every = [*states, *inputs, *parameters]
    calls = ("sin", "cos", "tan", "exp", "atan", "tanh", "abs", "sign")
    body = [f"{call}({word})" for call, word in zip(calls, itertools.cycle(every), strict=False)]
    body += [f"{(i % 7 + 1) / 8}*{word}" for i, word in enumerate(every)]
    body += [
        f"min({every[0]}, {every[-1]})",
        f"atan2({every[-1]}, {every[0]})",
        f"sqrt(abs({every[1]}))",
    ]
    values = {word: 0.5 + i / 16 for i, word in enumerate(parameters)}
    model = Model(
        states=states, inputs=inputs, parameters=values, phi=f"4*tanh({' + '.join(body)})"
    )
    return StandardObserver(model.order, 3.0, model=model, method="euler", timing="predictor")


def batches() -> Iterator[tuple[list[str], list[str], list[str]]]:
    """All names, in turn as states, as inputs and as parameters."""
    for first in range(0, len(NAMES), 40):
        names = NAMES[first : first + 40]
        yield names[:4], names[4:8], names[8:]
        yield names[-4:], names[-8:-4], names[:-8]


def test_any_name_compiles_and_gives_the_bits_of_a_plain_one(tmp_path: Path) -> None:
    assert len(set(NAMES)) == len(NAMES) >= 280
    for number, roles in enumerate(batches()):
        folder = tmp_path / str(number)
        plain = [
            [f"{kind}_{i}_" for i in range(len(role))]
            for kind, role in zip("suv", roles, strict=True)
        ]
        described = [program(own(*r), name="axis", precision="double") for r in (roles, plain)]
        # what the numbers are does not depend on what they are called
        made = [[(row.status, row.memory) for row in of.vector] for of in described]
        assert made[0] == made[1], roles
        assert {row.status for row in described[0].vector} == {0, 1}
        put(folder / "c", sources(own(*roles), to="c", name="axis"))
        assert says_ok(in_c(folder / "c", "axis", (*STRICT, "-O1")), 100), roles
        if number % 2:
            put(folder / "rust", sources(own(*roles), to="rust", name="axis"))
            assert says_ok(in_rust(folder / "rust", "axis"), 100), roles


@pytest.mark.parametrize("standard", ["c99", "gnu11", "c++11", "gnu++20"])
def test_any_name_stands_behind_a_boards_header(tmp_path: Path, standard: str) -> None:
    language = "c++" if "+" in standard else "c"
    complex_h = "" if "+" in standard else "#include <complex.h>\n"
    for number, roles in enumerate(batches()):
        folder = put(tmp_path / str(number), sources(own(*roles), to="c", name="axis"))
        user = f'{complex_h}#include <math.h>\n{BOARD}#include "axis.h"\n'
        user += "int use(axis_state *s);\n"
        user += "int use(axis_state *s) { axis_init(s); return AXIS_UPDATED; }\n"
        put(folder, {"user.txt": user})
        run("gcc", "-x", language, f"-std={standard}", "-Wall", "-Wextra", "-Werror",
            "-fsyntax-only", folder / "user.txt")  # fmt: skip


def test_a_name_that_is_free_stays() -> None:
    text = sources(own(["q", "v"], ["torque"], ["J", "Fv", "abs_max"]), to="c", name="axis")[
        "axis.h"
    ]
    for line in (
        "double q; /* estimate of q */",
        "double J; /* parameter */",
        "double torque, double t,",
    ):
        assert line in text


def test_a_name_that_cannot_stay_is_told() -> None:
    model = Model(states=["q", "int"], inputs=["class"], parameters={"dt": 2.0, "PI": 3.0},
                  phi="class - dt*int - PI*q")  # fmt: skip
    text = sources(StandardObserver(2, 20.0, model=model, method="euler", timing="predictor"),
                   to="c", name="axis")  # fmt: skip
    for line in (
        "state int is called state_int",
        "input class is called input_class",
        "double parameter_dt; /* parameter dt */",
        "phi = class - dt * int - PI * q",
        "double y, double input_class, double t, double dt);",
    ):
        assert line in text["axis.h"], line
    # Euler's step with the step's own length
    assert "next_q = q + dt * (state_int + 60.0 * innovation);" in text["axis.c"]


def test_a_parameter_is_told_from_the_step_of_a_sampled_law(tmp_path: Path) -> None:
    model = Model(
        states=["q", "v"],
        inputs=["torque"],
        parameters={"dt": 2.0, "elapsed": 3.0},
        f=["v + dt", "torque - elapsed*q"],
        K_T=["0.5*(y - q)", "dt*(y - q)"],
    )
    log = ([0.0, 0.25, 0.5], [1.0, 1.0, 1.0], [0.5, 0.5, 0.5])
    described = program(SampledDataObserver(model), name="axis", precision="double", log=log)
    # x + T f + K_T by hand: 0.25*(0 + 2) + 0.5*(1 - 0), 0.25*(0.5 - 3*0) + 2*(1 - 0)
    assert described.vector[0].memory == (1.0, 2.125)
    put(tmp_path, sources(SampledDataObserver(model), to="c", name="axis", log=log))
    assert says_ok(in_c(tmp_path, "axis"), 2)


TAKEN = """
int self fn gen class new main core std alloc test vector status default proc_macro math string
stdint errno features time arduino con nul com1 deps build examples incremental sem mtx pthread_attr
""".split()  # noqa: SIM905
SHAPES = (
    "",
    "A",
    "2nd",
    "_a",
    "a_",
    "a__b",
    "a-b",
    "a b",
    "a\nb",
    "../x",
    "a/b",
    "\u00e9",
    "x" * 65,
    None,
    5,
)


@pytest.mark.parametrize("to", ["c", "rust"])
def test_names_of_exports_that_are_taken_are_refused(to: str) -> None:
    observer = StandardObserver(2, 5.0, method="euler", timing="predictor")
    for name in TAKEN:
        with pytest.raises(
            HgoError, match=f"name = '{name}': .* leave free; for example {name}_obs"
        ):
            sources(observer, to=to, name=name)
    for name in SHAPES:
        with pytest.raises(HgoError, match=r"name = .*a lower-case identifier"):
            sources(observer, to=to, name=name)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "name", ["abort", "x", "state", "sin", "memcpy", "printf", "new_x", "dep", "lib", "a1_2"]
)
def test_other_names_of_exports_compile(tmp_path: Path, name: str) -> None:
    observer = StandardObserver(2, 5.0, method="euler", timing="predictor")
    put(tmp_path / "c", sources(observer, to="c", name=name))
    assert says_ok(run("make", "-s", "-C", tmp_path / "c", "test"), 100)
    put(tmp_path / "rust", sources(observer, to="rust", name=name))
    assert says_ok(in_rust(tmp_path / "rust", name), 100)


def test_text_of_a_user_cannot_leave_a_comment(tmp_path: Path) -> None:
    spec = own(["q", "v"], ["u"], ["c"]).spec
    names = {"states": ["q */ #error", "v\n#error"], "inputs": ["/* u"], "parameters": ["c\\"]}
    observer = Observer({**spec, "model": {**spec["model"], "names": names}})
    put(tmp_path / "c", sources(observer, to="c", name="axis"))
    assert says_ok(in_c(tmp_path / "c", "axis"), 100)
    put(tmp_path / "rust", sources(observer, to="rust", name="axis"))
    assert says_ok(in_rust(tmp_path / "rust", "axis"), 100)


def test_single_precision_refuses_numbers_that_it_does_not_hold() -> None:
    for value in (1e300, 1e-60):
        model = Model(states=["q", "v"], parameters={"c": value}, phi="-c*q")
        observer = StandardObserver(2, 5.0, model=model, method="euler", timing="predictor")
        with pytest.raises(HgoError, match=f"parameter c = {re.escape(repr(value))}: .* precision"):
            sources(observer, to="c", precision="single")
        assert repr(value) in sources(observer, to="c")["observer.c"]
    model = Model(states=["q", "v"], phi="-1e39*q")
    observer = StandardObserver(2, 5.0, model=model, method="euler", timing="predictor")
    with pytest.raises(HgoError, match="a constant of the model = -1e"):
        sources(observer, to="c", precision="single")
    assert np.isfinite(np.float32(3.4e38))


def test_a_memory_whose_entries_are_not_all_named_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = Model(states=["a", "b", "c", "d"], orders=[2, 2], phi=["-a", "-c"])
    parts = [HighGainEKF(2, R=1.0, Q=1.0)] * 2
    observer = MultiOutputObserver(parts, model=model)
    names = words.memory_words(observer)
    assert len(names) == len(observer.memory) and names[-1] == ("elapsed_2", words.ELAPSED)
    monkeypatch.setattr(words, "is_one_filter", lambda spec: False)
    with pytest.raises(HgoError, match="12 names for 16 entries of the memory"):
        words.memory_words(observer)
