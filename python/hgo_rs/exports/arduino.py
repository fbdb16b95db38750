"""A program as an Arduino library: the C in src/, two manifests and a sketch."""

from __future__ import annotations

import json

from hgo_rs._version import __version__
from hgo_rs.exports.c import files as c_files
from hgo_rs.exports.expressions import C
from hgo_rs.exports.names import Names
from hgo_rs.exports.program import Program

__all__ = ["library", "name_of"]

SKETCH = """\
// Estimates from analog inputs, at a fixed rate, to the serial port.
// Put your own samples, and the input of your own control law, in their places.

#include <{name}.h>

static const unsigned long PERIOD = {period}UL;  // sampling period, us
{length}static const unsigned long EVERY = {every}UL;  // samples from one line of text to the next

static {name}_state state;
static unsigned long due, count;

// One sample, in its unit; NAN where there is none.
static {real} sample(uint8_t pin)
{{
    return ({real})analogRead(pin) * ({real})(5.0 / 1023.0);  // volt
}}

void setup()
{{
    Serial.begin(115200);
    {name}_init(&state);
    due = micros();
}}

void loop()
{{
    if ((long)(micros() - due) < 0) {{
        return;
    }}
    due += PERIOD;
{calls}
    if (count % EVERY == 0) {{  // the estimate for the next sample
{prints}
    }}
    ++count;
    if ((long)(micros() - due) >= 0) {{
        Serial.println(F("late: PERIOD is too short for this board"));
    }}
}}
"""

_OF_THE_SKETCH = (
    *("sample", "setup", "loop", "due", "count", "pin"),
    *("micros", "analogRead", "Serial", "uint8_t"),
)
"""Words of the sketch that an input could hide."""


def name_of(name: str) -> str:
    """What the library and all in it are called: no header and no macro of a board begins so."""
    return name if name.startswith("hgo_") else f"hgo_{name}"


def library(program: Program, n: int, dt: float) -> dict[str, str]:
    """The files of a library, by name; n states, `dt` is the sketch's sampling period [s]."""
    name, texts = program.name, c_files(program)
    return {
        "library.properties": _properties(program),
        "library.json": _manifest(program),
        **{f"src/{name}.{end}": texts[f"{name}.{end}"] for end in ("h", "c")},
        "examples/Estimate/Estimate.ino": _sketch(program, n, dt),
    }


def _told(program: Program) -> str:
    return program.description.splitlines()[0]


def _properties(program: Program) -> str:
    """What the Arduino IDE reads."""
    told = {
        "name": program.name,
        "version": __version__,
        "author": "hgo_rs",
        "maintainer": "hgo_rs",
        "sentence": _told(program),
        "paragraph": "Correct by a sample, predict over a period: C without heap or dependencies, "
        "exported by hgo_rs.",
        "category": "Data Processing",
        "url": "",
        "architectures": "*",
        "includes": f"{program.name}.h",
    }
    return "".join(f"{key}={value}\n" for key, value in told.items())


def _manifest(program: Program) -> str:
    """What PlatformIO reads."""
    told = {
        "name": program.name,
        "version": __version__,
        "description": _told(program),
        "keywords": ["observer", "estimation", "control"],
        "authors": [{"name": "hgo_rs"}],
        "frameworks": "*",
        "platforms": "*",
        "headers": f"{program.name}.h",
        "examples": [{"name": "Estimate", "base": "examples/Estimate", "files": ["Estimate.ino"]}],
    }
    return json.dumps(told, indent=2) + "\n"


def _sketch(program: Program, n: int, dt: float) -> str:
    name, words = program.name, program.words
    real = "double" if program.precision.name == "double" else "float"
    names = Names(_OF_THE_SKETCH)
    own = {word: names.local(word) for word in (*words.samples, *words.controls)}
    own |= {"t": f"(double)count * {dt!r}", "dt": "DT"}
    taken = [f"const {real} {own[word]} = sample(A{i});" for i, word in enumerate(words.samples)]
    zero, length = (
        C.literal(v, program.precision) for v in (0.0, float(program.precision.real(dt)))
    )
    given = [
        f"const {real} {own[word]} = {zero};  // the input: compute and apply it here"
        for word in words.controls
    ]

    def call(verb: str, arguments: list[str]) -> str:
        return f"{name}_{verb}({', '.join(['&state', *(own[word] for word in arguments)])});"

    if program.is_current:
        correct, predict = program.moves
        calls = [*taken, call("correct", program.arguments(correct)), *given]
        calls.append(call("predict", program.arguments(predict)))
    else:
        calls = [*taken, *given, call("step", program.arguments(*program.moves))]
    shown = [f"Serial.print(state.{field.name}, 6);" for field in program.memory[:n]]
    shown = [line for text in shown for line in (text, "Serial.print(' ');")][:-1]
    return SKETCH.format(
        name=name,
        real=real,
        period=max(1, round(dt * 1e6)),
        length=f"static const {real} DT = {length};  // the same, s\n" * (program.fixed is None),
        every=max(1, round(0.1 / dt)),
        calls="\n".join(f"    {line}" for line in calls),
        prints="\n".join(f"        {line}" for line in [*shown, "Serial.println();"]),
    )
