"""The table of `make firmware`, in full and as the README has it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

BEGIN, END = "<!-- firmware -->", "<!-- end of firmware -->"


@dataclass(frozen=True)
class Run:
    """One line of a board: a case, its digest, and what was counted."""

    case: str
    observer: str
    n: int
    scalar: str
    digest: str
    steps: int
    instructions: int
    most: int
    stack: int
    functions: tuple[int, ...]
    """Addresses of the step and, if it has them, of its first half and of the clock."""


@dataclass(frozen=True)
class Row:
    """One line of the report: an observer in one precision on one processor."""

    observer: str
    n: int
    scalar: str
    cpu: str
    instructions_per_step: float
    """Mean over the run, from the step's first instruction to its return."""
    instructions_most: int
    text_bytes: int
    """Code and constants of an image with construction, step and estimate, and nothing else."""
    step_text_bytes: int
    """Code of the step with all that it calls."""
    stack_bytes: int
    """Proven bound of a step."""
    stack_painted_bytes: int
    """What steps were seen to take."""
    identical: bool
    """Every state of every step has the bits of this computer's run and of the WebAssembly run."""
    panic_free: bool
    heap_free: bool


def table(head: Sequence[str], lines: Sequence[Sequence[object]]) -> str:
    """A Markdown table; every column but the first is aligned to the right."""
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in (head, rule, *lines))


def count(mean: float, most: int) -> str:
    """A number of instructions; the largest beside the mean where they differ."""
    return str(most) if round(mean) == most else f"{mean:.0f} (≤ {most})"


def counted(row: Row) -> str:
    """An observer's number of instructions."""
    return count(row.instructions_per_step, row.instructions_most)


def report(
    rows: Sequence[Row], beside: Mapping[str, Sequence[Run]], versions: Mapping[str, str]
) -> str:
    """Everything that was counted and proven, as Markdown."""
    head = ["observer", "n", "scalar", "cpu", "instructions a step", "image text (B)"]
    head += ["step text (B)", "stack bound (B)", "stack seen (B)", "identical", "panic", "heap"]
    lines: list[Sequence[object]] = []
    for row in rows:
        proofs = [
            "yes" if row.identical else "NO",
            "none" if row.panic_free else "REACHABLE",
            "none" if row.heap_free else "USED",
        ]
        sizes = [row.text_bytes, row.step_text_bytes, row.stack_bytes, row.stack_painted_bytes]
        lines.append([row.observer, row.n, row.scalar, row.cpu, counted(row), *sizes, *proofs])
    others: list[Sequence[object]] = [
        [run.observer, run.n, "f32", cpu, count(run.instructions / run.steps, run.most), run.stack]
        for cpu, runs in beside.items()
        for run in runs
    ]
    tools = "\n".join(f"- {tool}: {version}" for tool, version in versions.items())
    return "\n\n".join(
        [
            "# On the chip",
            table(head, lines),
            "Beside them, on the same samples (C: arm-none-eabi-gcc -O2):",
            table(
                ["program", "n", "scalar", "cpu", "instructions a step", "stack seen (B)"], others
            ),
            tools + "\n",
        ]
    )


# The README's columns beside the M4F's: a processor and the precision that its unit computes in.
BESIDE = {
    "M7, f64": ("cortex-m7", "f64"),
    "A53, f64": ("cortex-a53", "f64"),
    "RV32, f32": ("rv32imafc", "f32"),
}


def short(
    rows: Sequence[Row], beside: Mapping[str, Sequence[Run]], versions: Mapping[str, str]
) -> str:
    """The README's table: each processor in the precision that its unit computes in."""
    others = {(run.observer, cpu): run for cpu, runs in beside.items() for run in runs}
    lines: list[Sequence[object]] = []
    by_key = {(row.observer, row.n, row.cpu, row.scalar): row for row in rows}
    for row in rows:
        if (row.scalar, row.cpu) != ("f32", "cortex-m4"):
            continue
        plain = others.get((f"C {row.observer}", row.cpu))
        lines.append(
            [
                row.observer,
                row.n,
                counted(row),
                f"{plain.instructions / plain.steps:.0f}" if plain and plain.n == row.n else "",
                row.text_bytes,
                row.stack_bytes,
                *(
                    counted(by_key[row.observer, row.n, cpu, scalar])
                    for cpu, scalar in BESIDE.values()
                ),
            ]
        )
    filters = [others["Kalman filter", cpu] for cpu in ("cortex-m4", "rv32imafc")]  # in f32 alone
    kalman, on_riscv = (count(run.instructions / run.steps, run.most) for run in filters)
    name, empty = "Kalman filter (crate adskalman)", [""] * (2 + len(BESIDE))
    lines.append([name, filters[0].n, kalman, *empty, on_riscv])
    head = ["observer", "n", "M4F, f32", "plain C", "image (B)", "stack (B)", *BESIDE]
    made = f"{versions['rustc']}; {versions['arm-none-eabi-gcc']}; {versions['qemu']}"
    return f"{table(head, lines)}\n\nMade with {made}.\n"


def between(text: str, begin: str, end: str) -> re.Match[str] | None:
    """The lines between two marks of a page, as group 1."""
    return re.search(re.escape(begin) + r"\n(.*?)" + re.escape(end), text, re.DOTALL)


def write_between(page: Path, begin: str, end: str, made: str) -> None:
    """Write lines between two marks of a page."""
    text = page.read_text(encoding="utf-8")
    found = between(text, begin, end)
    if found is None:
        raise SystemExit(f"{page}: must hold {begin} and {end}; put both on lines of their own")
    made = made.rstrip("\n") + "\n"
    page.write_text(text[: found.start(1)] + made + text[found.end(1) :], encoding="utf-8")


def update_readme(
    readme: Path,
    rows: Sequence[Row],
    beside: Mapping[str, Sequence[Run]],
    versions: Mapping[str, str],
    write: bool,
) -> list[str]:
    """Write the README's table, or say in which way it is not what was counted now.

    Another compiler counts a little differently: the table is held to the letter only by the tools
    that it names.
    """
    now = short(rows, beside, versions)
    if write:
        write_between(readme, BEGIN, END, now)
        return []
    found = between(readme.read_text(encoding="utf-8"), BEGIN, END)
    if found is None:
        return [f"{readme.name} has no table between {BEGIN} and {END}"]
    same_tools = found[1].rstrip().splitlines()[-1:] == now.rstrip().splitlines()[-1:]
    if same_tools and found[1] != now:
        return [f"{readme.name}: the table is not what was counted now; --readme writes it"]
    return []
