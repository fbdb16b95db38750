"""What a fixed period saves: exported C under Euler and zoh, on QEMU's Cortex-M4F and here.

python firmware/tools/fixed.py            # prints the table
python firmware/tools/fixed.py --write    # puts it into docs/export.md
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "c"))

import example
from report import table, write_between
from toolchain import FIRMWARE, require, say

from hgo_rs import InputGain, LowPowerObserver, PeakingFreeObserver, StandardObserver
from hgo_rs.exports import sources
from hgo_rs.observers import Observer

PAGE = FIRMWARE.parent / "docs" / "export.md"
BEGIN, END = "<!-- fixed -->", "<!-- end of fixed -->"
PERIOD = 1e-3
KNOWN: dict[str, Any] = {"model": InputGain(1.0 / 95.0), "allow_unstable": True}
LAWS: dict[str, Callable[..., Observer]] = {
    "standard, n = 2": lambda **manner: StandardObserver(2, gain=60.0, **KNOWN, **manner),
    "low-power, n = 3": lambda **manner: LowPowerObserver(3, gain=60.0, **KNOWN, **manner),
    "peaking-free, n = 3": lambda **manner: PeakingFreeObserver(
        3, gain=60.0, saturation=[1.0, 1.0], **KNOWN, **manner
    ),
}
TIMED = ("standard, n = 2",)
"""Laws of which the time is in the table."""
BOARD = ("-T", str(example.HERE / "board.ld"), "--specs=rdimon.specs", "-nostartfiles")


@dataclass(frozen=True)
class Cost:
    """Of one call: instructions on the Cortex-M4F, code and constants of the source in bytes, time
    on this computer in ns.
    """

    instructions: float
    bytes: int
    ns: float


def cost(observer: Observer, precision: str, *, fixed: bool, here: bool = True) -> Cost:
    """Of an export at the period 1 ms; with current timing of a correction and a prediction. The
    time only where it is asked for.
    """
    period: dict[str, Any] = {"fixed_dt" if fixed else "dt": PERIOD}
    texts = sources(observer, to="c", name="o", precision=precision, **period)
    real = "double" if precision == "double" else "float"
    defined = [f"-DREAL={real}", f"-DU={', u' if observer.n_u else ''}"]
    defined += [f"-DDT={'' if fixed else f', ({real}){PERIOD}'}"]
    defined += ["-DCURRENT"] * (observer.timing == "current")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for file in ("o.c", "o.h"):
            (folder / file).write_text(texts[file])
        parts: list[str | Path] = [f"-I{folder}", example.HERE / "period.c", folder / "o.c"]
        chip: list[str | Path] = ["arm-none-eabi-gcc", "-std=gnu99", "-O2", *example.CHIP]
        example.execute([*chip, "-c", folder / "o.c", "-o", folder / "o.o"])
        size = example.execute(["arm-none-eabi-size", folder / "o.o"]).splitlines()[1].split()
        flags = ["-DBOARD", *defined, *BOARD, "-Wl,--gc-sections"]
        board = [*chip, *flags, *parts, example.HERE / "board.c", "-lm", "-o", folder / "board"]
        example.execute(board)
        counting = ("-icount", "shift=10,align=off,sleep=off")
        emulator = [*example.QEMU, *example.SEMIHOSTING, *counting, "-kernel"]
        instructions = example.execute([*emulator, folder / "board"])
        if not here:
            return Cost(float(instructions), int(size[0]) + int(size[1]), float("nan"))
        example.execute(["cc", "-std=gnu99", "-O2", *defined, *parts, "-lm", "-o", folder / "here"])
        ns = example.execute([folder / "here"]).split()[0]
    return Cost(float(instructions), int(size[0]) + int(size[1]), float(ns))


def beside(law: str, precision: str, timing: str, *, here: bool = True) -> tuple[Cost, Cost, Cost]:
    """Euler and zoh with a fixed period, and zoh with any."""
    euler, zoh = (LAWS[law](method=method, timing=timing) for method in ("euler", "zoh"))
    return (
        cost(euler, precision, fixed=True, here=here),
        cost(zoh, precision, fixed=True, here=here),
        cost(zoh, precision, fixed=False, here=here),
    )


def costs() -> str:
    """All of them as a table in Markdown, with the compilers."""
    head = ["law, precision, timing", "instructions: Euler", "zoh", "zoh, any `dt`"]
    head += ["bytes: Euler", "zoh", "zoh, any `dt`", "ns: Euler", "zoh", "zoh, any `dt`"]
    lines: list[Sequence[object]] = []
    for law in LAWS:
        for precision in ("single", "double"):
            for timing in ("predictor", "current"):
                timed = law in TIMED
                of = beside(law, precision, timing, here=timed)
                line = [f"{law}, {precision}, {timing}", *(f"{c.instructions:.0f}" for c in of)]
                times = [f"{c.ns:.1f}" if timed else "" for c in of]
                lines.append([*line, *(c.bytes for c in of), *times])
    names = ("arm-none-eabi-gcc", "qemu-system-arm", "cc")
    made = "; ".join(example.execute([name, "--version"]).splitlines()[0] for name in names)
    return f"{table(head, lines)}\n\nComputed with {made}."


def main(arguments: Sequence[str]) -> int:
    """The exit status."""
    require(("qemu-system-arm", "arm-none-eabi-gcc"), ())
    made = costs()
    say(made)
    if "--write" in arguments:
        write_between(PAGE, BEGIN, END, made)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except (example.ExampleError, subprocess.SubprocessError) as error:
        say(f"FAILED: {error}")
        sys.exit(1)
