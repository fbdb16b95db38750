"""What was measured, as a table, as Markdown and as a chart, with the machine named."""

from __future__ import annotations

import os
import platform
import re
import shutil
import statistics
import subprocess
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from compare import processor
from compare.harness import OURS, Size, Workload
from compare.worker import cores

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NOISY = 0.1
"""Noisy is an implementation of which not a quarter of the samples come so near the smallest."""
LIMIT = "C, rounded"
"""What times are given in parts of; with the same instruction set where one is named."""


@dataclass(frozen=True)
class Row:
    """A line of bench.json: the smallest of the samples [ns per run and step]."""

    workload: str
    implementation: str
    threads: int
    ns_per_step: float
    runs: int
    steps: int


@dataclass
class Measured:
    """A workload: rows, what was not there and why, what was told, what failed, what was noisy."""

    workload: Workload
    rows: list[Row] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)
    told: dict[str, str] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)
    noisy: list[str] = field(default_factory=list)
    ns: dict[tuple[str, int], float] = field(default_factory=dict)

    def add(self, name: str, threads: int, values: Sequence[float], size: Size) -> None:
        """Take the samples of an implementation."""
        value = min(values)
        self._take(
            Row(self.workload.name, name + self._case, threads, value, size.runs, size.steps)
        )
        if statistics.quantiles(values, n=4)[0] > (1.0 + NOISY) * value:
            self.noisy.append(name if threads == 1 else f"{name} on {threads} threads")

    @property
    def _case(self) -> str:
        return f", {self.workload.case}" if self.workload.case else ""

    def _take(self, row: Row) -> None:
        self.rows.append(row)
        name = row.implementation.removesuffix(self._case)
        self.ns[name, row.threads] = row.ns_per_step

    def stored(self) -> dict[str, Any]:
        """As JSON takes it."""
        return {
            "key": self.workload.key,
            "rows": [asdict(row) for row in self.rows],
            "missing": self.missing,
            "told": self.told,
            "failures": self.failures,
            "noisy": self.noisy,
        }

    @classmethod
    def of(cls, stored: Mapping[str, Any]) -> Measured:
        """What `stored` gave."""
        from compare.workloads import WORKLOADS

        done = cls(next(one for one in WORKLOADS if one.key == stored["key"]))
        done.missing, done.told = dict(stored["missing"]), dict(stored["told"])
        done.failures, done.noisy = list(stored["failures"]), list(stored["noisy"])
        for row in stored["rows"]:
            done._take(Row(**row))
        return done

    def fail(self, failed: Mapping[str, str], threads: int) -> None:
        """Take what went wrong."""
        for name, text in failed.items():
            self.failures.append(f"{self.workload.key}, {name}, threads {threads}: {text}")

    def names(self) -> list[str]:
        """Implementations measured on one thread, in the workload's order."""
        return [i.name for i in self.workload.implementations if (i.name, 1) in self.ns]

    def factor(self, name: str) -> float | None:
        """How many times faster ours is on one thread."""
        ours = self.ns.get((OURS, 1))
        return None if ours is None else self.ns[name, 1] / ours

    def of_limit(self, name: str) -> float | None:
        """Its time over that of `LIMIT` for the same instruction set, on one thread."""
        held = next((h for h in processor.NAMES.values() if name.endswith(f", {h}")), None)
        limit = LIMIT if held is None else f"{LIMIT}, {held}"
        known = name != limit and (limit, 1) in self.ns
        return self.ns[name, 1] / self.ns[limit, 1] if known else None

    def together(self) -> tuple[int, float, float] | None:
        """Number of processes, what they reach together, and that over what all cores reach."""
        for (name, threads), value in self.ns.items():
            if name.endswith("processes"):
                return threads, value, value / self.ns[OURS, threads]
        return None


@dataclass(frozen=True)
class Machine:
    """Where it was measured, and with what."""

    processor: str
    cores: int
    instructions: str
    versions: str

    @classmethod
    def this(cls) -> Machine:
        """This one."""
        name, info = platform.processor() or platform.machine(), Path("/proc/cpuinfo")
        if info.exists():
            text = info.read_text(encoding="utf-8")
            model = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
            name = model.group(1) if model else name
        parts = [f"Python {platform.python_version()}"]
        for package in ("numpy", "llvmlite", "numba", "jax", "scipy", "filterpy"):
            try:
                parts.append(f"{package} {metadata.version(package)}")
            except metadata.PackageNotFoundError:
                parts.append(f"{package} not installed")
        parts.append(_compiler())
        return cls(name, len(cores()), processor.described(), ", ".join(parts))

    def __str__(self) -> str:
        return f"{self.processor}, {self.cores} cores, {self.instructions}; {self.versions}"


def _compiler() -> str:
    name = os.environ.get("CC", "cc")
    if shutil.which(name) is None:
        return f"{name} not installed"
    text = subprocess.run([name, "--version"], capture_output=True, text=True, check=False).stdout
    return text.splitlines()[0] if text else name


def short(ns: float) -> str:
    """Three digits and a unit."""
    for limit, unit in ((1e3, "ns"), (1e6, "µs"), (1e9, "ms")):
        if ns < limit:
            return f"{ns * 1e3 / limit:.3g} {unit}"
    return f"{ns * 1e-9:.3g} s"


def lines(done: Measured, threads: int) -> list[tuple[str, ...]]:
    """Implementation, one thread, all, over the limit, factor: what the tables show."""
    shown = []
    for name in done.names():
        many = done.ns.get((name, threads)) if threads > 1 else None
        factor = None if name == OURS else done.factor(name)
        ratios = ("" if r is None else f"{r:.3g}" for r in (done.of_limit(name), factor))
        time = short(done.ns[name, 1])
        shown.append((name, time, "" if many is None else short(many), *ratios))
    return shown


def notes(done: Measured) -> list[str]:
    """What a reader has to know beside the numbers."""
    said = [f"{name}: {text}" for name, text in done.told.items()]
    for reason in dict.fromkeys(done.missing.values()):
        without = [name for name, why in done.missing.items() if why == reason]
        said.append(f"{'; '.join(without)}: {reason}")
    together = done.together()
    if together is not None:
        count, value, ratio = together
        said.append(
            f"{count} processes of one thread each reach {short(value)} together; all cores in one "
            f"process reach {ratio:.2f} of that rate"
        )
    if done.noisy:
        said.append(f"noisy: {'; '.join(done.noisy)}")
    return said + [f"FAILED {text}" for text in done.failures]


def titled(done: Measured) -> str:
    """What the workload is, with the runs and steps of ours, or of the first."""
    row = next((row for row in done.rows if row.implementation.split(",")[0] == OURS), None)
    row = row or next(iter(done.rows), None)
    title = done.workload.title
    several = row is not None and row.runs * row.steps > 1
    return f"{title}; {row.runs} runs x {row.steps} steps" if row and several else title


def table(done: Measured, threads: int) -> str:
    """A workload as text."""
    every = f"{threads} threads" if done.workload.parallel and threads > 1 else ""
    out = [f"{done.workload.key}: {titled(done)}"]
    out.append(f"  {'':<22}{'1 thread':>12}{every:>12}{f'of {LIMIT}':>16}{'ours is faster by':>20}")
    out += [f"  {a:<22}{b:>12}{c:>12}{d:>16}{e:>20}" for a, b, c, d, e in lines(done, threads)]
    return "\n".join(out + [f"  {note}" for note in notes(done)])


def markdown(everything: Sequence[Measured], machine: Machine, left_out: object = None) -> str:
    """The page bench.md."""
    out = [
        "# Side by side",
        "",
        f"Measured on {machine}. Smallest of the samples, warm, time per run and step.",
        "",
        f"| workload | implementation | 1 thread | {machine.cores} threads | of {LIMIT} |"
        " ours is faster by |",
        "| --- | --- | ---: | ---: | ---: | ---: |",
    ]
    for done in everything:
        shown = lines(done, machine.cores)
        out += ["| " + " | ".join((done.workload.key, *line)) + " |" for line in shown]
    out.append("")
    for done in everything:
        out += [f"- {done.workload.key}: {titled(done)}"]
        out += [f"  - {note}" for note in notes(done)]
    if left_out is not None:
        out += ["", f"Asked for were these implementations alone: {left_out}."]
    return "\n".join(out) + "\n"


def chart(everything: Sequence[Measured], machine: Machine, file: Path) -> bool:
    """A panel a workload; False without matplotlib."""
    try:
        from hgo_rs.plots import new_figure, style

        figure = new_figure()
    except ImportError:
        return False
    shown = [done for done in everything if done.names()]
    columns = 2 if len(shown) > 1 else 1
    rows = max(1, -(-len(shown) // columns))
    most = max((len(done.names()) + len(done.missing) for done in shown), default=1)
    with style():
        figure.set_size_inches(5.2 * columns, (0.24 * most + 0.9) * rows + 0.9)
        for place, done in enumerate(shown, 1):
            _panel(figure.add_subplot(rows, columns, place), done, machine.cores)
        threads = f", ○ {machine.cores} threads" if machine.cores > 1 else ""
        figure.suptitle(
            "Time per run and step, on a logarithmic axis: further left is faster\n"
            f"{machine.processor}, {machine.cores} cores, {machine.instructions}; "
            f"● 1 thread{threads}"
        )
        figure.savefig(file, bbox_inches="tight")
    return True


def _panel(ax: Axes, done: Measured, threads: int) -> None:
    from hgo_rs.plots import COLOURS

    names = [*done.names(), *done.missing]
    smallest = min(done.ns.values())
    for place, name in enumerate(names):
        one, many = done.ns.get((name, 1)), done.ns.get((name, threads))
        ours, limit = name.startswith(OURS), name.split(",")[0] == "C"
        colour = COLOURS["vermillion" if ours else "black" if limit else "blue"]
        if one is None:
            said = textwrap.shorten(done.missing[name], 44, placeholder=" ...")
            ax.text(smallest, place, said, color=COLOURS["grey"], va="center")
            continue
        if many is not None and threads > 1:
            ax.plot([many, one], [place, place], color=colour, linewidth=1.0)
            ax.plot(many, place, "o", color=colour, markerfacecolor="white")
        ax.plot(one, place, "o", color=colour)
        ax.annotate(
            short(one),
            (max(one, many or 0.0), place),
            (7, 0),
            textcoords="offset points",
            va="center",
        )
    ax.set_xscale("log")
    largest = max(done.ns.values())
    largest *= 1.6 * (largest / smallest) ** 0.25  # room for the numbers
    ax.set_xlim(smallest / 1.6, max(largest, 12.0 * smallest))
    ax.set_yticks(range(len(names)), names)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.grid(axis="y", visible=False)
    ax.xaxis.set_major_formatter(lambda value, _: short(value))
    ax.xaxis.set_minor_formatter(lambda value, _: "")
    ax.set_title(done.workload.key)
