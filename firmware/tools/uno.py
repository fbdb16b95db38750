"""Time and flash of exported observers on an Arduino Uno (ATmega328P, 16 MHz), by simavr.

python firmware/tools/uno.py            # prints the table
python firmware/tools/uno.py --write    # puts it into docs/export.md
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from report import table, write_between
from toolchain import FIRMWARE, say

from hgo_rs import LowPowerObserver, Model, StandardObserver
from hgo_rs.exports import sources
from hgo_rs.observers import Observer

PAGE = FIRMWARE.parent / "docs" / "export.md"
BEGIN, END = "<!-- uno -->", "<!-- end of uno -->"
PERIOD = 5e-3
PENDULUM = Model(states=["q", "w"], inputs=["u"], phi="u - 0.2*w - 9.81*sin(q)")
OBSERVERS: dict[str, Observer] = {
    "standard, order 2, pendulum, `euler`": StandardObserver(
        2, 20.0, model=PENDULUM, method="euler", timing="current"
    ),
    "standard, order 2, pendulum, `zoh`": StandardObserver(2, 20.0, model=PENDULUM),
    "standard, order 3, `zoh`": StandardObserver(3, 20.0),
    "low-power, order 3, `zoh`": LowPowerObserver(3, 20.0),
}
CHIP = ("-mmcu=atmega328p", "-DF_CPU=16000000L", "-Os", "-ffunction-sections", "-fdata-sections")
# Timer 1 counts every eighth cycle: the longest of 20 periods, printed to the serial port.
PROGRAM = """
#include <avr/io.h>
#include <stdio.h>
#include "src/hgo_axis.h"
static int put(char c, FILE *file) {
    (void)file;
    while (!(UCSR0A & (1 << UDRE0))) {}
    UDR0 = (unsigned char)c;
    return 0;
}
static FILE port = FDEV_SETUP_STREAM(put, NULL, _FDEV_SETUP_WRITE);
int main(void) {
    static hgo_axis_state state;
    volatile float y = 0.3f, u = 0.1f;
    unsigned long most = 0;
    (void)u;
    UCSR0B = 1 << TXEN0;
    stdout = &port;
    TCCR1A = 0;
    TCCR1B = 2;
#ifdef CALLS
    hgo_axis_init(&state);
    for (int k = 0; k < 20; k += 1) {
        TCNT1 = 0;
        hgo_axis_correct(&state, y);
        unsigned long cycles = TCNT1;
        TCNT1 = 0;
        hgo_axis_predict(&state ARGUMENTS);
        cycles += TCNT1;
        if (cycles > most) most = cycles;
        y = -y;
    }
#endif
    printf("%lu cycles\\n", 8 * most);
    for (;;) {}
}
"""


def cost(observer: Observer, fixed: bool) -> str:
    """Milliseconds of a correction and a prediction, and kB that they add to a program."""
    period: dict[str, Any] = {"fixed_dt" if fixed else "dt": PERIOD}
    texts = sources(observer, to="arduino", name="axis", **period)
    arguments = (", u" if observer.n_u else "") + ("" if fixed else f", {PERIOD}f")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "src").mkdir()
        for file in ("src/hgo_axis.c", "src/hgo_axis.h"):
            (folder / file).write_text(texts[file])
        (folder / "main.c").write_text(PROGRAM)
        sizes = []
        for calls in ([], ["-DCALLS", f"-DARGUMENTS={arguments}"]):
            code = [str(folder / "main.c"), str(folder / "src" / "hgo_axis.c")]
            parts = [*code, "-lm", "-o", str(folder / "elf")]
            execute(["avr-gcc", *CHIP, "-std=gnu11", *calls, "-Wl,--gc-sections", *parts])
            words = execute(["avr-size", folder / "elf"]).splitlines()[1].split()
            sizes.append(int(words[0]) + int(words[1]))
        cycles = counted(folder / "elf")
    assert cycles < 8 * 65_000  # the timer has 16 bits
    return f"{cycles / 16e3:.2f} ms, {(sizes[1] - sizes[0]) / 1e3:.1f} kB"


def execute(command: Sequence[str | Path]) -> str:
    """What a command prints."""
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return done.stdout


def counted(program: Path) -> int:
    """The cycles that the program prints."""
    command = ["stdbuf", "-oL", "-eL", "simavr", "-m", "atmega328p", "-f", "16000000", str(program)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
    ) as process:
        assert process.stdout is not None
        try:
            for line in process.stdout:
                if found := re.search(r"(\d+) cycles", line):
                    return int(found[1])
        finally:
            process.kill()
    raise SystemExit("simavr: the program printed nothing")


def main(arguments: Sequence[str]) -> int:
    """The exit status."""
    if lacking := [tool for tool in ("avr-gcc", "avr-size", "simavr") if not shutil.which(tool)]:
        say(f"needs {', '.join(lacking)}: install gcc-avr, avr-libc and simavr")
        return 1
    rows = [
        [name, cost(observer, False), cost(observer, True)] for name, observer in OBSERVERS.items()
    ]
    head = ["observer", "any `dt`", "[`fixed_dt=`](#for-a-fixed-period)"]
    compiler = execute(["avr-gcc", "--version"]).splitlines()[0]
    made = f"{table(head, rows)}\n\nComputed with {compiler}, by simavr."
    say(made)
    if "--write" in arguments:
        write_between(PAGE, BEGIN, END, made)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
