"""The C library's example: builds it for this computer and for the board, runs both, compares.

    python firmware/c/example.py

`main.c` prints every bit of its estimates, so the same text means the same bits. `minimal.c` shows
what one observer costs in flash. Both link only if no panic is reachable from what they call.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools"))

import header
from toolchain import FIRMWARE, THUMB, Toolchain, ToolchainError, require, say

HERE = FIRMWARE / "c"
TARGET = FIRMWARE / "target"
INCLUDE = HERE / "include"
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")
CHIP = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16")
QEMU = ("qemu-system-arm", "-M", "mps2-an386", "-nic", "none", "-nodefaults", "-display", "none")
SEMIHOSTING = (
    *("-serial", "none", "-monitor", "none", "-chardev", "stdio,id=sh"),
    *("-semihosting-config", "enable=on,target=native,chardev=sh"),
)
LAST_LINE = "all as expected"


class ExampleError(RuntimeError):
    """A build or a run failed; the message says which."""


def execute(command: Sequence[str | Path], env: dict[str, str] | None = None) -> str:
    """A command's output; its error output if it fails."""
    words = [str(word) for word in command]
    try:
        done = subprocess.run(
            words,
            cwd=FIRMWARE,
            env=env,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise ExampleError(f"{words[0]}: {error}") from None
    if done.returncode:
        tail = "\n".join((done.stdout + done.stderr).strip().splitlines()[-30:])
        raise ExampleError(f"{' '.join(words)}\nended with {done.returncode}:\n{tail}")
    return done.stdout


def library(toolchain: Toolchain | None = None) -> Path:
    """Compiles libhgo.a, for this computer or for a chip."""
    package = ["--quiet", "--package", "hgo-c", "--target-dir"]
    if toolchain is None:
        execute(["cargo", "build", "--release", *package, TARGET / "host"])
        return TARGET / "host" / "release" / "libhgo.a"
    target = TARGET / toolchain.name
    execute(toolchain.cargo(*package, str(target)), toolchain.environment())
    return target / toolchain.target / "release" / "libhgo.a"


def compiled(out: Path, archive: Path, *sources: Path, flags: Sequence[str] = ()) -> Path:
    """A program for this computer."""
    command = [os.environ.get("CC", "cc"), "-std=c11", "-O2", *WARNINGS, f"-I{INCLUDE}", *flags]
    execute([*command, *sources, archive, "-Wl,--gc-sections", "-lm", "-o", out])
    return out


def compiled_for_board(out: Path, archive: Path, *sources: Path, flags: Sequence[str]) -> Path:
    """A program for the Cortex-M4F."""
    command = ["arm-none-eabi-gcc", "-std=c11", "-O2", *WARNINGS, f"-I{INCLUDE}", *CHIP, *flags]
    execute([*command, "-nostartfiles", *sources, archive, "-Wl,--gc-sections", "-o", out])
    return out


def run_on_board(program: Path) -> str:
    """What a program prints on QEMU's Cortex-M4F."""
    return execute([*QEMU, *SEMIHOSTING, "-kernel", program])


def on_this_computer() -> str:
    """What main.c prints here."""
    return execute([compiled(TARGET / "example", library(), HERE / "main.c")])


def on_the_board() -> tuple[str, int]:
    """What main.c prints on the board, and the bytes of flash that minimal.c takes there."""
    archive = library(Toolchain.find(THUMB, "cortex-m4"))
    script = ["-T", str(HERE / "board.ld"), "--specs=rdimon.specs"]
    sources = (HERE / "board.c", HERE / "main.c")
    text = run_on_board(compiled_for_board(TARGET / "example.elf", archive, *sources, flags=script))
    roots = ["-ffreestanding", "-nostdlib", "-Wl,-e,start_observer", "-Wl,-u,on_timer"]
    least = TARGET / "minimal.elf"
    compiled_for_board(least, archive, HERE / "minimal.c", flags=roots)
    sizes = execute(["arm-none-eabi-size", least]).splitlines()[1].split()
    return text, int(sizes[0]) + int(sizes[1])


def check() -> list[str]:
    """What does not hold."""
    if not header.is_current():
        return ["include/hgo.h is not what the source says: run firmware/c/header.py"]
    try:
        here, (board, size) = on_this_computer(), on_the_board()
    except ExampleError as error:
        return [f"the C interface: {error}"]
    failures = []
    if here != board:
        failures.append(f"c/main.c prints on this computer\n{here}and on the board\n{board}")
    for place, text in (("this computer", here), ("the board", board)):
        if not text.endswith(LAST_LINE + "\n"):
            failures.append(f"c/main.c on {place}:\n{text}")
    say(f"c/main.c: {len(here.splitlines())} lines; c/minimal.c: {size} B of flash")
    return failures


def main() -> int:
    """The exit status."""
    require(("qemu-system-arm", "arm-none-eabi-gcc"), (THUMB,))
    failures = check()
    for failure in failures:
        say(f"FAILED: {failure}")
    return 1 if failures else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except ToolchainError as error:
        say(f"FAILED: {error}")
        sys.exit(1)
