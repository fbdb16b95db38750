"""Exported programs built and run: on this computer, and on QEMU's Cortex-M4F."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "firmware" / "c"))
sys.path.insert(0, str(Path(__file__).parents[2] / "firmware" / "tools"))

import example
import fixed as fixed
import toolchain

WARNINGS = (
    "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror",
)  # fmt: skip
STRICT = ("-std=c99", *WARNINGS, "-ffp-contract=off")
FLAGS = {
    "-O0": (*STRICT, "-O0"),
    "-O2": (*STRICT, "-O2"),
    "-O3 native": (*STRICT, "-O3", "-march=native"),
    # what a careless build does: the source itself forbids contraction
    "gnu11 -O3 native": ("-std=gnu11", "-O3", "-march=native"),
}


BOARD = example.HERE
LINKED = (
    *("-T", BOARD / "board.ld"),
    *("--specs=rdimon.specs", "-nostartfiles", "-Wl,--gc-sections"),
)
"""How a program for QEMU's board is linked."""


def run(*command: str | Path, **options: Any) -> str:
    done = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, check=False, **options
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout


def put(folder: Path, texts: dict[str, str]) -> Path:
    for name, text in texts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def in_c(folder: Path, name: str, flags: tuple[str, ...] = FLAGS["-O2"]) -> str:
    """What the demonstration prints."""
    program = folder / "demonstration"
    run("cc", *flags, folder / "main.c", folder / f"{name}.c", "-lm", "-o", program)
    return run(program)


def checked_as_cpp(folder: Path, name: str) -> None:
    """All of an export read as C++ too."""
    for standard in ("c++11", "c++20"):
        flags = ("-x", "c++", f"-std={standard}", *WARNINGS, "-ffp-contract=off", "-fsyntax-only")
        run("g++", *flags, folder / f"{name}.c", folder / "main.c")


def checked_by_clippy(folder: Path) -> None:
    """Cargo's clippy as it is, warnings as errors."""
    build = {**os.environ, "CARGO_TARGET_DIR": str(folder / "target")}
    run("cargo", "clippy", "--offline", "--quiet", "--", "-D", "warnings", cwd=folder, env=build)


def in_rust(folder: Path, name: str) -> str:
    """The same, by rustc alone: warnings are errors."""
    flags = ("--edition=2024", "-Copt-level=1", "-Dwarnings", "--out-dir", folder)
    library = folder / f"lib{name}.rlib"
    run("rustc", *flags, "--crate-type=rlib", "--crate-name", name, folder / "src" / "lib.rs")
    extern = f"--extern={name}={library}"
    run("rustc", *flags, "--crate-name=demonstration", extern, folder / "src" / "main.rs")
    return run(folder / "demonstration")


def says_ok(text: str, steps: int) -> bool:
    return text.rstrip().endswith(f"{steps} steps, every bit as expected: OK")


def lacking() -> str:
    """Programs that a run on the chip needs and that are not installed."""
    return ", ".join(toolchain.missing(("qemu-system-arm", "arm-none-eabi-gcc"), ()))


def on_the_chip(folder: Path, name: str) -> str:
    """What the demonstration prints on QEMU's Cortex-M4F."""
    program = folder / f"{name}.elf"
    flags = ("-O2", *example.CHIP)
    # board.c is not strict C
    run("arm-none-eabi-gcc", *flags, "-c", BOARD / "board.c", "-o", folder / "board.o")
    parts = [folder / file for file in ("board.o", "main.c", f"{name}.c")]
    run("arm-none-eabi-gcc", *STRICT, *flags, *LINKED, *parts, "-lm", "-o", program)
    return example.run_on_board(program)
