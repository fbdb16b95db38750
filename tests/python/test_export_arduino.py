"""Observers as Arduino libraries: built for AVR and ARM and run, with the core's bits."""

from __future__ import annotations

import json
import re
import shutil
import struct
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import BOARD, LINKED, STRICT, WARNINGS, example, lacking, put, run
from test_export_every import CASES, DT

import hgo_rs as hgo
from hgo_rs.cli import main
from hgo_rs.errors import HgoError
from hgo_rs.exports import sources
from hgo_rs.exports.program import Program, program
from hgo_rs.observers import Observer

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="written for GNU's tools")

CORE = Path("/usr/share/arduino/hardware/arduino/avr")
needs_avr = pytest.mark.skipif(
    any(shutil.which(tool) is None for tool in ("avr-g++", "simavr")),
    reason="needs avr-g++ and simavr: gcc-avr, avr-libc, simavr",
)
needs_arduino = pytest.mark.skipif(not CORE.is_dir(), reason="needs arduino-core-avr")
needs_arm = pytest.mark.skipif(bool(lacking()), reason=f"needs {lacking()}")

# As the Arduino IDE compiles, but for warnings.
SMALL = ("-Os", "-ffunction-sections", "-fdata-sections")


def noisy(**manner: Any) -> Observer:
    """A model whose words are macros, types and functions of Arduino."""
    model = hgo.Model(
        states=["PI", "sq"],
        inputs=["round", "count"],
        parameters={"B0": 0.5, "word": 0.2, "F": 1.5},
        phi="(round + count - word*sq)/B0 - 9.81*sin(PI) + F",
    )
    return hgo.StandardObserver(2, 8.0, model=model, **manner)


# --- bits -----------------------------------------------------------------------------------------

LOG_T = DT * np.concatenate([np.arange(20.0), np.arange(21.0, 42.0)])  # one step is of two periods
LOG_Y = 0.4 * np.sin(0.3 * np.outer(np.arange(41), [1.0, 0.7, 0.4])) + 0.1
LOG_Y[[7, 8, 30]] = np.nan
LOG_U = np.cos(np.outer(np.arange(41), [0.2, 0.5]))

PORT = """\
// printf to the serial port of a chip of AVR
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <stdint.h>
#include <stdio.h>

static int put(char c, FILE *)
{
    while (!(UCSR0A & (1 << UDRE0))) {}
    UDR0 = (uint8_t)c;
    return 0;
}

static void begin()
{
    UCSR0B = 1 << TXEN0;
    UBRR0 = 0;
    fdevopen(put, NULL);
}

static void end()
{
    cli();
    sleep_enable();
    sleep_cpu();
}
"""

PRINTER = """\
#include <{name}.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#ifdef __AVR__
#include "port.h"
#else
static void begin() {{}}
static void end() {{}}
#endif

static const float given[][{width}] = {{
{rows}
}};

static void show(float value)
{{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    printf(" %08lx", (unsigned long)bits);
}}

int main()
{{
    begin();
    {name}_state state;
    {name}_init(&state);
    for (unsigned k = 0; k < sizeof given / sizeof *given; ++k) {{
        const float *const row = given[k];
        printf("%d", {name}_step(&state, {arguments}));
        {shows}
        printf("\\n");
    }}
    printf("end\\n");
    end();
    return 0;
}}
"""

BITS = (
    "standard, zoh, current",
    "standard, rk4, predictor",
    "low-power, zoh, current",
    "peaking-free, smooth, bilinear, predictor",
    "adaptive, rk4, current",
    "chains, zoh, current",
    "modified, staggered-euler, current",
    "sampled-data",
    "strict-feedback",
)


def in_single(case: str) -> tuple[Program, dict[str, str], Observer]:
    """The program of a case with its expected steps, and its library."""
    observer = CASES[case]()
    log = (LOG_T, LOG_Y[:, : observer.n_y], LOG_U[:, : observer.n_u])
    options: dict[str, Any] = {"dt": DT, "periods": 4, "log": log}
    described = program(observer, name="hgo_axis", precision="single", **options)
    return described, sources(observer, to="arduino", name="axis", **options), observer


def printer(described: Program) -> str:
    words = (*described.words.samples, *described.words.controls, "t", "dt")

    def text(value: float) -> str:
        return "NAN" if value != value else f"{np.float32(value)!r}".replace("np.float32", "float")

    rows = [
        "    {" + ", ".join(map(text, (*row.y, *row.u, row.t, row.dt))) + "},"
        for row in described.vector
    ]
    arguments = described.arguments(*described.moves)
    return "#include <math.h>\n" + PRINTER.format(
        name=described.name,
        width=len(words),
        rows="\n".join(rows),
        arguments=", ".join(f"row[{words.index(word)}]" for word in arguments),
        shows=" ".join(f"show(state.{field.name});" for field in described.memory),
    )


def wanted(described: Program) -> list[str]:
    """What the printer is to print."""
    return [
        " ".join([str(row.status), *(struct.pack(">f", value).hex() for value in row.memory)])
        for row in described.vector
    ]


def simulated(chip: str, program: Path, enough: Callable[[list[str]], bool]) -> list[str]:
    """The lines that a chip of AVR prints, until there are enough."""
    # simavr shows the port in colour, with a dot for the end of a line
    command = ["stdbuf", "-oL", "-eL", "simavr", "-m", chip, "-f", "16000000", str(program)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    )
    late = threading.Timer(60.0, process.kill)
    late.start()
    lines: list[str] = []
    assert process.stdout is not None
    try:
        for line in process.stdout:
            plain = re.sub(r"\x1b\[[0-9;]*m", "", line).strip().rstrip(".")
            lines += [plain] if plain and not plain.startswith("Loaded") else []
            if enough(lines):
                break
    finally:
        late.cancel()
        process.kill()
        process.wait()
    return lines


@needs_avr
@pytest.mark.parametrize("case", BITS)
def test_avr_has_the_cores_bits(tmp_path: Path, case: str) -> None:
    """Its double has 32 bits: single precision, with the bits of any other chip."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        described, texts, _ = in_single(case)
    put(tmp_path, {**texts, "printer.cpp": printer(described), "port.h": PORT})
    chip, source = ("-mmcu=atmega2560",), tmp_path / "src" / "hgo_axis.c"
    strict = [word for word in WARNINGS if word != "-Wdouble-promotion"]
    run("avr-gcc", *chip, "-std=gnu11", *SMALL, *strict, "-c", source, "-o", tmp_path / "axis.o")
    run("avr-g++", *chip, "-x", "c++", "-std=gnu++11", *strict, "-fsyntax-only", source)
    parts = (tmp_path / "printer.cpp", tmp_path / "axis.o", "-lm", "-o", tmp_path / "axis.elf")
    run("avr-g++", *chip, "-std=gnu++11", *SMALL, f"-I{tmp_path / 'src'}", *parts)
    lines = simulated("atmega2560", tmp_path / "axis.elf", lambda lines: lines[-1:] == ["end"])
    assert lines == [*wanted(described), "end"]
    assert {row.status for row in described.vector} >= {0, 1}


@needs_arm
@pytest.mark.parametrize("case", BITS[:5])
def test_arm_has_the_same_bits(tmp_path: Path, case: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        described, texts, _ = in_single(case)
    put(tmp_path, {**texts, "printer.cpp": printer(described)})
    lines = on_arm(tmp_path, tmp_path / "printer.cpp").split("\n")
    assert lines[:-1] == [*wanted(described), "end"]


def on_arm(folder: Path, *sources: Path) -> str:
    """What C++ with the library prints on QEMU's Cortex-M4F."""
    flags = ("-O2", *example.CHIP, f"-I{folder}", f"-I{folder / 'src'}")
    run("arm-none-eabi-gcc", *flags, "-c", BOARD / "board.c", "-o", folder / "board.o")
    library = folder / "src" / "hgo_axis.c"
    run("arm-none-eabi-gcc", *STRICT, *flags, "-c", library, "-o", folder / "axis.o")
    objects = [folder / "board.o", folder / "axis.o"]
    plain = ("-std=c++11", "-fno-exceptions", "-fno-rtti", "-fno-threadsafe-statics")
    program = folder / "program.elf"
    compiled = [folder / f"{source.stem}.o" for source in sources]
    for source, made in zip(sources, compiled, strict=True):
        run("arm-none-eabi-g++", *plain, *flags, "-x", "c++", "-c", source, "-o", made)
    run("arm-none-eabi-gcc", *flags, *LINKED, *objects, *compiled, "-lm", "-o", program)
    return example.run_on_board(program)


OPERATIONS = """\
#include "port.h"
#include <math.h>
#include <string.h>

static uint32_t seed = 1;

static uint32_t drawn()
{
    seed ^= seed << 13;
    seed ^= seed >> 17;
    return seed ^= seed << 5;
}

static float number(uint32_t bits)
{
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

int main()
{
    begin();
    for (int k = 0; k < COUNT; ++k) {
        const uint32_t x = drawn(), y = drawn();
        volatile float a = number(x), b = number(y);
        const float made[] = {a + b, a - b, a * b, a / b, sqrtf(fabsf(a))};
        printf("%08lx %08lx", (unsigned long)x, (unsigned long)y);
        for (int i = 0; i < 5; ++i) {
            uint32_t bits;
            memcpy(&bits, &made[i], sizeof bits);
            printf(" %08lx", (unsigned long)bits);
        }
        printf("\\n");
    }
    printf("end\\n");
    end();
    return 0;
}
"""


@needs_avr
def test_arithmetic_of_avr_is_ieee(tmp_path: Path) -> None:
    """Over all bit patterns, against NumPy: every result but quotients that are subnormal."""
    put(tmp_path, {"operations.cpp": OPERATIONS.replace("COUNT", "6000"), "port.h": PORT})
    made = tmp_path / "operations.elf"
    run("avr-g++", "-mmcu=atmega2560", *SMALL, tmp_path / "operations.cpp", "-lm", "-o", made)
    lines = simulated("atmega2560", made, lambda lines: lines[-1:] == ["end"])
    bits = np.array([[int(word, 16) for word in line.split()] for line in lines[:-1]], np.uint32)
    assert bits.shape == (6000, 7)
    a, b, *found = bits.T.copy().view(np.float32)
    with np.errstate(all="ignore"):
        exact = [a + b, a - b, a * b, a / b, np.sqrt(np.abs(a))]
    for i, (one, other) in enumerate(zip(found, exact, strict=True)):
        same = (one.view(np.uint32) == other.view(np.uint32)) | (np.isnan(one) & np.isnan(other))
        subnormal = (np.abs(other) < np.finfo(np.float32).tiny) & (other != 0.0)
        assert subnormal.any() or i in (0, 1, 4)
        np.testing.assert_array_equal(same | (subnormal if i == 3 else False), True)
        # what a quotient below 1.2e-38 lacks is the last bit
        np.testing.assert_allclose(one[~same], other[~same], rtol=0, atol=2.0**-149)


@needs_avr
def test_avr_refuses_double_precision(tmp_path: Path) -> None:
    put(tmp_path, sources(noisy(), to="arduino", name="axis", precision="double"))
    source = tmp_path / "src" / "hgo_axis.c"
    command = ["avr-gcc", "-mmcu=atmega328p", "-c", str(source), "-o", str(tmp_path / "axis.o")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert (
        "double is not of 64 bits here: export in the precision that this compiler" in done.stderr
    )


# --- the sketch -----------------------------------------------------------------------------------

STUB = """\
// What a sketch needs of Arduino, and the macros that get in its way.
#ifndef ARDUINO_H
#define ARDUINO_H
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#define PI 3.1415926535897932384626433832795
#define B0 0
#define B1 1
#define HIGH 1
#define DEFAULT 1
#define F(text) (text)
#define min(a, b) ((a) < (b) ? (a) : (b))
#define max(a, b) ((a) > (b) ? (a) : (b))
#define abs(x) ((x) > 0 ? (x) : -(x))
#define round(x) ((x) >= 0 ? (long)((x) + 0.5) : (long)((x) - 0.5))
#define sq(x) ((x) * (x))
#define bit(b) (1UL << (b))
#define interrupts() (0)
typedef unsigned int word;
typedef uint8_t byte;
typedef bool boolean;
static const uint8_t A0 = 14, A1 = 15, A2 = 16;
struct Port {
    void begin(long) {}
    void print(double value, int digits) { printf("%.*f", digits, value); }
    void print(char c) { putchar(c); }
    void println(const char *text = "") { puts(text); }
};
extern Port Serial;
unsigned long micros();
int analogRead(uint8_t pin);
void setup();
void loop();
#endif
"""

PINS = """\
Port Serial;
static unsigned long now, reads;
unsigned long micros() { return now += 7; }
int analogRead(uint8_t pin) { return (int)(37 * reads++ % 500) + pin; }
int main()
{
    setup();
    for (long i = 0; i < LOOPS; ++i) loop();
    return 0;
}
"""


def sketch(folder: Path, observer: Observer, loops: int, **options: Any) -> Path:
    """The library with its sketch as a program: what the IDE does, around a board of ours."""
    texts = sources(observer, to="arduino", name="axis", **options)
    written = f"#include <Arduino.h>\n{texts['examples/Estimate/Estimate.ino']}"
    pins = PINS.replace("LOOPS", str(loops))
    put(folder, {**texts, "Arduino.h": STUB, "sketch.cpp": f"{written}\n{pins}"})
    return folder / "sketch.cpp"


def expected(observer: Observer, count: int, every: int) -> list[list[float]]:
    """The estimates that the sketch prints, by Python."""
    rows, reads, n = [], 0, observer.n
    for k in range(count):
        y = []
        for pin in range(observer.n_y):
            y.append((37 * reads % 500 + 14 + pin) * 5.0 / 1023.0)
            reads += 1
        u = np.zeros(observer.n_u)
        if observer.timing == "current":
            observer.correct(y)
            observer.predict(u, DT)
        else:
            observer.step(y, u, dt=DT)
        if k % every == 0:
            rows.append(observer.memory[:n].tolist())
    return rows


FIXED = {
    "several outputs": {"fixed_dt": DT},
    "names of macros, predictor": {"fixed_dt": DT},
}
"""Sketches whose library is for a fixed period."""

SKETCHES: dict[str, Callable[[], Observer]] = {
    "names of macros": noisy,
    "names of macros, predictor": lambda: noisy(timing="predictor"),
    "several outputs": CASES["chains, zoh, current"],
    "time": CASES["standard, rk4, predictor"],
}


def checked_sketch(said: str, observer: Observer) -> None:
    rows = [[float(word) for word in line.split()] for line in said.strip().split("\n")]
    shown = expected(observer, 10 * len(rows), 10)
    assert len(rows) >= 20
    # the sketch is of single precision and prints six decimals
    np.testing.assert_allclose(rows, shown, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("case", SKETCHES)
def test_the_sketch_runs_on_this_computer(tmp_path: Path, case: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        observer = SKETCHES[case]()
        made = sketch(tmp_path, observer, 300_000, **FIXED.get(case, {"dt": DT}))
    flags = ("-O1", f"-I{tmp_path}", f"-I{tmp_path / 'src'}")
    warned = [word for word in WARNINGS if word not in ("-Wdouble-promotion", "-Wpedantic")]
    run("cc", *STRICT, *flags, "-c", tmp_path / "src" / "hgo_axis.c", "-o", tmp_path / "axis.o")
    parts = (made, tmp_path / "axis.o", "-lm", "-o", tmp_path / "sketch")
    run("g++", "-std=c++11", *warned, *flags, *parts)
    checked_sketch(run(tmp_path / "sketch"), observer)


@needs_arm
def test_the_sketch_runs_on_arm(tmp_path: Path) -> None:
    observer = noisy()
    made = sketch(tmp_path, observer, 300_000, dt=DT)
    checked_sketch(on_arm(tmp_path, made), observer)


@needs_avr
@needs_arduino
def test_the_sketch_runs_on_an_uno(tmp_path: Path) -> None:
    """With Arduino's own core, whose analog pins read 0 in the simulator."""
    observer = noisy()
    texts = sources(observer, to="arduino", name="axis", dt=DT)
    written = f"#include <Arduino.h>\n{texts['examples/Estimate/Estimate.ino']}"
    put(tmp_path, {**texts, "sketch.cpp": written})
    core = CORE / "cores" / "arduino"
    flags = ("-mmcu=atmega328p", "-DF_CPU=16000000L", "-DARDUINO=10819", "-DARDUINO_AVR_UNO")
    flags += (
        "-DARDUINO_ARCH_AVR",
        f"-I{core}",
        f"-I{CORE / 'variants' / 'standard'}",
        *SMALL,
        "-w",
    )
    objects = []
    mine = [tmp_path / "sketch.cpp", tmp_path / "src" / "hgo_axis.c"]
    for source in [*core.glob("*.c"), *core.glob("*.cpp"), *core.glob("*.S"), *mine]:
        if source.name == "WString.cpp":  # is not for GCC 5, and the sketch has no String
            continue
        compiler = (
            ("avr-g++", "-std=gnu++11", "-fno-threadsafe-statics")
            if source.suffix == ".cpp"
            else ("avr-gcc",)
        )
        objects.append(tmp_path / f"{source.name}.o")
        include = f"-I{tmp_path / 'src'}"
        run(*compiler, *flags, include, "-c", source, "-o", objects[-1])
    program = tmp_path / "sketch.elf"
    run("avr-g++", *flags, "-Wl,--gc-sections", *objects, "-lm", "-o", program)
    lines = simulated("atmega328p", program, lambda lines: len(lines) >= 15)
    rows = [[float(word) for word in line.split()] for line in lines[:15]]
    told = []
    for k in range(150):
        observer.correct(0.0)
        observer.predict([0.0, 0.0], DT)
        told += [observer.memory[:2].tolist()] if k % 10 == 0 else []
    assert np.abs(told[-1]).max() > 1e-3  # the constant F of the model moves it
    np.testing.assert_allclose(rows, told, atol=2e-6)
    size = run("avr-size", program).split("\n")[1].split()
    assert int(size[0]) < 16_000 and int(size[1]) + int(size[2]) < 600  # of 32 kB, and of 2 kB


# --- files ----------------------------------------------------------------------------------------


def test_the_manifests_say_the_same(tmp_path: Path) -> None:
    texts = sources(noisy(), to="arduino", name="axis")
    assert set(texts) == {
        "library.properties",
        "library.json",
        "src/hgo_axis.h",
        "src/hgo_axis.c",
        "examples/Estimate/Estimate.ino",
    }
    told = dict(line.split("=", 1) for line in texts["library.properties"].splitlines())
    needed = "name version author maintainer sentence paragraph category url architectures"
    assert set(told) == {*needed.split(), "includes"}
    platform = json.loads(texts["library.json"])
    for key in ("name", "version"):
        assert told[key] == platform[key]
    assert told["name"] == "hgo_axis" and told["includes"] == platform["headers"] == "hgo_axis.h"
    assert re.fullmatch(r"\d+\.\d+\.\d+", told["version"])
    names = {"name": "axis", "precision": "single"}
    source = texts["src/hgo_axis.c"]
    assert source == sources(noisy(), to="c", **{**names, "name": "hgo_axis"})["hgo_axis.c"]
    again = sources(noisy(), to="arduino", name="hgo_axis")
    assert again == texts


def test_the_sketch_has_the_period(tmp_path: Path) -> None:
    def line(**options: Any) -> str:
        text = sources(noisy(), to="arduino", **options)["examples/Estimate/Estimate.ino"]
        return "\n".join(text.split("\n")[5:8])

    assert "PERIOD = 2500UL" in line(dt=0.0025) and "DT = 0.0025f" in line(dt=0.0025)
    assert "EVERY = 40UL" in line(dt=0.0025) and "EVERY = 1UL" in line(dt=0.5)
    assert "const double DT = 0.0025;" in line(dt=0.0025, precision="double")
    fixed = sources(noisy(), to="arduino", fixed_dt=0.0025)["examples/Estimate/Estimate.ino"]
    assert "PERIOD = 2500UL" in fixed and " DT" not in fixed
    fast = hgo.StandardObserver(2, 2000.0, method="rk4", timing="predictor")
    text = sources(fast, to="arduino")["examples/Estimate/Estimate.ino"]
    period = int(re.findall(r"PERIOD = (\d+)UL", text)[0])
    assert 1e-6 <= period * 1e-6 <= 0.51 * fast.step_limit().dt
    slow = sources(hgo.StandardObserver(2, 1.0, method="euler"), to="arduino")
    assert "PERIOD = 10000UL" in slow["examples/Estimate/Estimate.ino"]


def test_a_sketch_that_is_too_slow_says_so(tmp_path: Path) -> None:
    """A clock that moves on by 7 us a look, and a period of 10."""
    made = sketch(tmp_path, noisy(), 100, dt=1e-5)
    flags = (f"-I{tmp_path}", f"-I{tmp_path / 'src'}")
    run("g++", "-std=c++11", *flags, made, tmp_path / "src" / "hgo_axis.c", "-o", tmp_path / "late")
    assert "late: PERIOD is too short for this board\n" in run(tmp_path / "late")


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    noisy().save(tmp_path / "my-axis.toml")
    given = ["export", str(tmp_path / "my-axis.toml"), "--to", "arduino", "--out"]
    with pytest.raises(SystemExit) as ended:
        main([*given, str(tmp_path / "library")])
    assert ended.value.code == 0 and "src/hgo_my_axis.h" in capsys.readouterr().out
    assert "precision: single" in (tmp_path / "library" / "src" / "hgo_my_axis.h").read_text()
    with pytest.raises(HgoError, match=r"units = .*only for to="):
        sources(noisy(), to="arduino", units={"q": "rad"})
