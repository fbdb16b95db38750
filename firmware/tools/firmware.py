"""`make firmware`: every observer on four processors, compared with this computer, counted, proven.

    python firmware/tools/firmware.py [--out out] [--readme] [--chips cortex-m4,cortex-a53]

Builds and runs the cases on this computer, as WebAssembly and on QEMU's Cortex-M4F, Cortex-M7,
Cortex-A53 and RV32IMAFC; compares the digests of every state of every step; counts instructions;
proves on the linked images that no allocator is in them and no panic is reachable, and bounds the
stack. Prints a table; writes `firmware.json` and `firmware.md`. Exits with 1 if anything does not
hold.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import interface
from image import Image
from report import Row, Run, report, update_readme
from toolchain import (
    A64,
    FIRMWARE,
    RISCV,
    THUMB,
    WASM,
    Toolchain,
    ToolchainError,
    require,
    say,
    versions,
)

TARGET = FIRMWARE / "target"


@dataclass(frozen=True)
class Board:
    """A processor: how its programs are compiled, linked for the proofs, and run."""

    target: str
    cpu: str
    linker: str
    emulator: str


BOARDS = {
    "cortex-m4": Board(THUMB, "cortex-m4", "arm-none-eabi-ld", "qemu-system-arm -M mps2-an386"),
    "cortex-m7": Board(THUMB, "cortex-m7", "arm-none-eabi-ld", "qemu-system-arm -M mps2-an500"),
    "cortex-a53": Board(
        A64, "cortex-a53", "aarch64-linux-gnu-ld", "qemu-system-aarch64 -M virt -cpu cortex-a53"
    ),
    "rv32imafc": Board(
        RISCV,
        "generic-rv32",
        "riscv64-unknown-elf-ld -m elf32lriscv",
        "qemu-system-riscv32 -M virt -cpu rv32,d=off -bios none",  # no double precision
    ),
}
RUN_SECONDS = 300  # a run takes about 6 s


class FirmwareError(RuntimeError):
    """A build or a run failed; the message says which."""


def execute(
    command: Sequence[str], env: dict[str, str] | None = None, seconds: float = 1800
) -> str:
    """A command's output; its error output if it fails."""
    try:
        done = subprocess.run(
            command,
            cwd=FIRMWARE,
            env=env,
            capture_output=True,
            text=True,
            timeout=seconds,
            check=False,
            stdin=subprocess.DEVNULL,
        )
    except subprocess.TimeoutExpired:
        raise FirmwareError(f"{command[0]} did not end in {seconds:g} s: {command}") from None
    if done.returncode:
        tail = "\n".join((done.stdout + done.stderr).strip().splitlines()[-30:])
        raise FirmwareError(f"{' '.join(command)}\nended with {done.returncode}:\n{tail}")
    return done.stdout


def rows(text: str, fields: int) -> Iterator[list[str]]:
    """The lines `row a|b|...` of a program's output; any other line is an error."""
    for line in text.splitlines():
        parts = line.removeprefix("row ").split("|")
        if not line.startswith("row ") or len(parts) != fields:
            raise FirmwareError(f"not a line of {fields} fields: {line!r}")
        yield parts


def run_host() -> dict[tuple[str, str], str]:
    """The digest of each case and precision on this computer."""
    target = ["--target-dir", str(TARGET / "host")]
    text = execute(["cargo", "run", "--quiet", "--release", "--package", "host", *target])
    return {(case, scalar): digest for case, _, _, scalar, digest, _ in rows(text, 6)}


def run_web() -> dict[tuple[str, str], str]:
    """The same as WebAssembly."""
    toolchain = Toolchain.find(WASM)
    folder = build(toolchain, "web")
    text = execute(["node", "web/run.mjs", str(folder / "web.wasm")])
    return {(case, scalar): digest for case, scalar, digest in rows(text, 3)}


def build(toolchain: Toolchain, *packages: str) -> Path:
    """Compile packages for a chip; the folder with what was made."""
    target = TARGET / toolchain.name
    env = toolchain.environment() | {"HGO_CPU": toolchain.cpu}
    chosen = [f"--package={package}" for package in packages]
    execute(toolchain.cargo("--quiet", "--target-dir", str(target), *chosen), env)
    return target / toolchain.target / "release"


def qemu(board: Board, elf: Path) -> str:
    """What an image prints by semihosting; 1024 ns of the board's time an instruction."""
    command = f"{board.emulator} -nodefaults -display none -serial none"
    command += " -monitor none -icount shift=10,align=off,sleep=off -chardev stdio,id=sh"
    command += " -semihosting-config enable=on,target=native,chardev=sh -kernel"
    return execute([*command.split(), str(elf)], seconds=RUN_SECONDS)


def run_board(board: Board, elf: Path) -> list[Run]:
    """Run an image of the cases on a board."""
    runs = []
    for case, observer, n, scalar, digest, _, *counts in rows(qemu(board, elf), 13):
        steps, instructions, most, stack = map(int, counts[:4])
        functions = tuple(int(address, 16) & ~1 for address in counts[4:] if address != "0")
        key = (case, observer, int(n), scalar, digest)
        runs.append(Run(*key, steps, instructions, most, stack, functions))
    return runs


def panic_free(linker: str, archive: Path, roots: Sequence[str], image: Path) -> bool:
    """Link an image with nothing but the roots: it links only if they reach no panic."""
    wanted = [option for root in roots for option in ("--undefined", root)]
    command = [*linker.split(), "--gc-sections", "--entry", roots[0], *wanted]
    try:
        execute([*command, str(archive), "-o", str(image)])
    except FirmwareError as error:
        if "hgo_panic_is_reachable" not in str(error):
            raise
        return False
    return True


@dataclass(frozen=True)
class Chip:
    """What one processor gave: a row for each observer, and what runs beside them."""

    rows: list[Row]
    beside: list[Run]
    failures: list[str]


def chip(cpu: str, expected: Callable[[], list[dict[tuple[str, str], str]]]) -> Chip:
    """Build, run, compare, count and prove for one processor."""
    board = BOARDS[cpu]
    toolchain = Toolchain.find(board.target, board.cpu)
    say(f"{cpu}: compiling (core: {toolchain.kind})")
    folder = build(toolchain, "board", "proof")
    say(f"{cpu}: running")
    runs = run_board(board, folder / "board")
    whole = Image.load(folder / "board")
    references = expected()
    proofs = TARGET / "proofs" / cpu
    proofs.mkdir(parents=True, exist_ok=True)
    say(f"{cpu}: proving")
    lines, failures = [], []
    archive = folder / "libproof.a"
    panicking = design_panics(board.linker, archive)
    failures += [f"{cpu}: a panic is reachable from {root}" for root in panicking]
    for run in runs:
        digests = [reference.get((run.case, run.scalar)) for reference in references]
        if digests == [None] * len(references):
            continue  # a program of others, run beside
        name = f"{run.case}_{run.scalar}"
        elf = proofs / f"{name}.elf"
        roots = [f"{name}_{what}" for what in ("step", "new", "estimate")]
        proven = panic_free(board.linker, archive, roots, elf)
        online = proofs / f"{name}-online.elf"
        proven_online = panic_free(board.linker, archive, [f"{name}_online"], online)
        image = Image.load(elf) if proven else None
        heap = whole.allocator_symbols() + (image.allocator_symbols() if image else [])
        functions = [whole.functions[address].name for address in run.functions]
        bound = max(map(whole.stack_bound, functions))
        lines.append(
            Row(
                observer=run.observer,
                n=run.n,
                scalar=run.scalar,
                cpu=cpu,
                instructions_per_step=run.instructions / run.steps,
                instructions_most=run.most,
                text_bytes=image.text_total() if image else 0,
                step_text_bytes=sum(map(whole.text_bytes, functions)),
                stack_bytes=bound,
                stack_painted_bytes=run.stack,
                identical=all(digest == run.digest for digest in digests),
                panic_free=proven and proven_online,
                heap_free=not heap,
            )
        )
        if len(functions) == 1:
            failures += miscounted(f"{cpu}, {name}", run, whole.executed(functions[0]))
        if run.scalar == "f32":
            failures += doubles(f"{cpu}, {name}", whole, functions)
        if run.stack > bound:
            failures.append(f"{cpu}, {name}: a step took {run.stack} B of stack, bound {bound} B")
    failures += [f"{cpu}: {name}" for name in unlike(runs)]
    if len(lines) != len(references[0]):
        failures.append(f"{cpu}: {len(lines)} of {len(references[0])} cases ran")
    beside = [run for run in runs if run.case == run.observer]
    return Chip(lines, beside, failures)


def miscounted(name: str, run: Run, executed: tuple[int, int] | None) -> Iterator[str]:
    """Whether the counts of a run leave what the paths of its code allow."""
    if executed is None:
        return
    least, most = executed
    if not least * run.steps <= run.instructions or run.most > most:
        mean = run.instructions / run.steps
        yield f"{name}: counted {mean:g} (≤ {run.most}); its code executes {least} to {most}"


# As compilers name it: __aeabi_dadd, __aeabi_f2d, __aeabi_ui2d for Arm; __adddf3, __floatsidf else.
DOUBLE = re.compile(r"__aeabi_(c?d\w+|\w+2d)|__[a-z]+df\d?|__\w+df[st][fi]\d?")


def doubles(name: str, image: Image, functions: Sequence[str]) -> Iterator[str]:
    """Arithmetic of double precision in software that a step in single precision reaches."""
    reached = sorted(set().union(*map(image.reachable, functions)))
    found = [function for function in reached if DOUBLE.fullmatch(function)]
    if found:
        yield f"{name}: a step in single precision reaches {', '.join(found)}"


def unlike(runs: Sequence[Run]) -> Iterator[str]:
    """The plain C observers that do not give the bits of the crate's. (The adaptive one calls powf
    of the C library, which rounds in its own way.)"""
    own = {(run.observer, run.n, run.scalar): run.digest for run in runs}
    for run in runs:
        name = run.observer.removeprefix("C ")
        if name not in (run.observer, "adaptive") and own[name, run.n, run.scalar] != run.digest:
            yield f"{run.observer} does not give the bits of {name}, n = {run.n}"


def design_panics(linker: str, archive: Path) -> list[str]:
    """Which of the functions for designs on the chip reach a panic."""
    image = archive.parent / "design.elf"
    roots = [f"design_{scalar}" for scalar in ("f32", "f64")]
    return [root for root in roots if not panic_free(linker, archive, [root], image)]


def limits(found: Sequence[Row], beside: Sequence[Run]) -> Iterator[str]:
    """What is promised for single precision on the Cortex-M4F, and does not hold."""
    most = {("standard", 2): 30, ("standard", 5): 75, ("low-power", 5): 140}
    yardstick = {
        "C standard": ("standard", 2),
        "C low-power": ("low-power", 5),
        "C adaptive": ("adaptive", 2),
    }
    several = {"collection of 3", "modified", "high-gain EKF, adaptive"}  # each of many copies
    small = {row.observer for row in found} - several
    for row in found:
        if (row.scalar, row.cpu) != ("f32", "cortex-m4"):
            continue
        key = (row.observer, row.n)
        if row.instructions_most > most.get(key, row.instructions_most):
            yield f"{key}: {row.instructions_most} instructions, promised {most[key]}"
        if row.observer in small and row.stack_bytes > 512:
            yield f"{key}: {row.stack_bytes} B of stack, promised 512"
        if key == ("standard", 2) and row.text_bytes >= 4096:
            yield f"{key}: an image of {row.text_bytes} B, promised under 4096"
        for run in beside:
            plain = run.instructions / run.steps
            if yardstick.get(run.observer) == key and row.instructions_per_step > 1.1 * plain:
                yield f"{key}: {row.instructions_per_step:.1f} instructions, plain C {plain:.1f}"


def main() -> int:
    """The whole of it."""
    parser = argparse.ArgumentParser(
        description="Observers on the chip: run, compare, count, prove."
    )
    parser.add_argument("--out", type=Path, default=FIRMWARE.parent / "out")
    parser.add_argument("--readme", action="store_true", help="write the table into README.md")
    parser.add_argument("--chips", default=",".join(BOARDS), help="some of them, by commas")
    options = parser.parse_args()
    chosen = options.chips.split(",")
    if unknown := set(chosen) - BOARDS.keys():
        parser.error(f"--chips {', '.join(sorted(unknown))}: not one of {', '.join(BOARDS)}")
    whole = set(chosen) == BOARDS.keys()
    if options.readme and not whole:
        parser.error("--readme writes a table of all chips: leave --chips out")
    require()
    with ThreadPoolExecutor(max_workers=max(2, os.cpu_count() or 2)) as pool:
        say("this computer and WebAssembly: compiling and running")
        references = [pool.submit(run_host), pool.submit(run_web)]
        chips = [
            pool.submit(chip, cpu, lambda: [reference.result() for reference in references])
            for cpu in chosen
        ]
        done = [future.result() for future in chips]
    found = [row for result in done for row in result.rows]
    failures = [failure for result in done for failure in result.failures]
    for row in found:
        for claim in ("identical", "panic_free", "heap_free"):
            if not getattr(row, claim):
                failures.append(
                    f"{row.observer}, n = {row.n}, {row.scalar}, {row.cpu}: not {claim}"
                )
    beside = dict(zip(chosen, (result.beside for result in done), strict=True))
    failures += limits(found, beside.get("cortex-m4", []))
    say("the C interface: board and this computer")
    failures += interface.check()
    tools = versions(Toolchain.find(THUMB))
    text = report(found, beside, tools)
    print(text)
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "firmware.md").write_text(text, encoding="utf-8")
    listed = json.dumps([asdict(row) for row in found], indent=1)
    (options.out / "firmware.json").write_text(listed + "\n", encoding="utf-8")
    readme = FIRMWARE.parent / "README.md"
    if whole:
        failures += update_readme(readme, found, beside, tools, options.readme)
    else:
        say(f"{options.chips} alone: the README's table is not compared")
    for failure in failures:
        say(f"FAILED: {failure}")
    say(f"{len(found)} rows, {len(failures)} failures; {options.out / 'firmware.json'}")
    return 1 if failures else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (FirmwareError, ToolchainError) as error:
        say(f"FAILED: {error}")
        sys.exit(1)
    except KeyboardInterrupt:
        say("interrupted")
        sys.exit(130)
