"""What `make bench` found, as one file of JSON; and docs/performance.md, made from it alone."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from compare import instructions, summary
from compare.instructions import Counts
from compare.summary import Machine, Measured


@dataclass(frozen=True)
class Performance:
    """The machine, how was timed, the workloads, the instructions where they could be counted."""

    machine: Machine
    timing: str
    measured: Sequence[Measured]
    counts: Counts | None

    def write(self, file: Path) -> None:
        """As JSON."""
        stored = {
            "machine": asdict(self.machine),
            "timing": self.timing,
            "workloads": [done.stored() for done in self.measured],
            "instructions": None if self.counts is None else asdict(self.counts),
        }
        text = json.dumps(stored, indent=1, ensure_ascii=False)
        file.write_text(f"{text}\n", encoding="utf-8")

    @classmethod
    def read(cls, file: Path) -> Performance:
        """What `write` wrote."""
        stored = json.loads(file.read_text(encoding="utf-8"))
        counts = stored["instructions"]
        return cls(
            Machine(**stored["machine"]),
            stored["timing"],
            [Measured.of(done) for done in stored["workloads"]],
            None if counts is None else Counts.of(counts),
        )


HEAD = """\
# Performance

The package beside what else one would take for the same work, and the instructions of a step. This
page, its [chart](performance.png) and its [data](performance.json) are made by `benches/compare`.

![Time per run and step of every workload and implementation](performance.png)

## How to read it

Times are per run and step: that of a call, divided by the runs and by the steps of each; for a
record, per sample. A call is the whole of what a user waits for once all is compiled or loaded:
arguments, the study, the result's arrays. Samples of all implementations are taken in turn; how
they are timed stands with the machine. On one thread two columns compare: *of C, rounded* is an
implementation's time over that of *C, rounded* for the same instruction set; *ours is faster by* is
its time over ours: below 1, it is the faster one.

Every implementation draws the same random numbers and starts from the same states, and its results
are compared with those of the package's NumPy reference before it is timed and again at the size
that is timed. (*Numba, plain* draws Numba's own; its means agree within standard errors.) All that
are named *ours* must have the same bits, but for an own model whose equations are rounded in
another order, as in `katayama-ship`.

| implementation | what it is |
| --- | --- |
| ours | `simulate`, `run` or `step` of the package with its own systems |
| ours, own model | the same equations as a user writes them: `hgo.Plant`, `hgo.Model` |
| ours, interpreter; ours, llvm | held to one engine; *ours* takes the one that it finds fit |
| ..., AVX2 | held to that instruction set, C compiled for it |
| C | the limit: one kernel for one experiment; *rounded*: see below |
| C, exported | the source that `export` writes: the package's sums, and its bits |
| Numba | one compiled loop a run, `fastmath`, no allocation, `prange` over the runs |
| JAX | `lax.scan` over the steps, `vmap` over the runs, `jit`, double precision |
| NumPy | the reference `hgo_rs.reference`: arrays over the runs, a Python loop over the steps |

A C kernel has its experiment's constants compiled in and is written in vectors as wide as the
registers of the instruction set, several blocks of runs interleaved so that no chain of operations
is waited for, as many as are fastest here; compiled with `-O3` for the processor. It says what the
work costs this processor. What a run starts from is read from arrays, in C as in all others, and
differs from run to run: a compiler that knows that all start alike moves once for many runs what no
run's noise reaches. (*One start* is such a study; the kernels do not know it.) In *C* the compiler
makes a·b + c one operation with one rounding wherever the processor can, so that another processor
gives other bits. *C, rounded* is the same kernel with every operation rounded, as the package
computes: the limit of what gives the same bits everywhere.

"""

REPEAT = """\
## How to repeat it

```sh
make bench                                                 # measures -> out/performance.json
python benches/compare --workload all build                # with a cold build, which takes minutes
python benches/compare --page docs/performance.md --from out/performance.json
```

`--workload` and `--implementation` take a part; `--instructions avx2` holds ours, C, Numba and JAX
to an instruction set. The extra `bench` installs what is compared with, and what is missing is
named under each table; the C compiler is `cc`, or `CC`. Times hold for the machine named, and for
what else it does; instructions do not depend on either.

"""

INSTRUCTIONS = """\
## Instructions a step

One step of each observer in double precision under each scheme: the mean over a thousand steps,
counted by callgrind in plain x86-64 code of the release profile, the call included. The steps
hardly branch, so that most take the same number every time. A test counts again and compares, where
the compiler is the one named here; `python benches/compare --page docs/performance.md` counts again
and writes the table.

"""


def page(found: Performance) -> str:
    """The whole page."""
    out = [HEAD, f"## Measured\n\nOn {found.machine}. Each time is {found.timing}.\n\n"]
    threads = found.machine.cores
    for done in found.measured:
        every = f"{threads} threads" if done.workload.parallel and threads > 1 else ""
        out.append(f"### {done.workload.key}\n\n")
        out.append(f"{summary.titled(done)}.\n\n")
        out.append(f"| implementation | 1 thread | {every} | of C, rounded | ours is faster by |\n")
        out.append("| --- | ---: | ---: | ---: | ---: |\n")
        out += ["| " + " | ".join(line) + " |\n" for line in summary.lines(done, threads)]
        out.append("\n")
        notes = summary.notes(done)
        out += [f"- {note}\n" for note in notes]
        out.append("\n" if notes else "")
    out.append(REPEAT)
    out.append(INSTRUCTIONS)
    if found.counts is None:
        out.append("They could not be counted where this page was made.\n")
    else:
        out.append(f"{instructions.table(found.counts)}\n\nMade with {found.counts.compiler}.\n")
    return "".join(out)


def publish(found: Performance, file: Path) -> list[Path]:
    """The page, and beside it under the same name what it is made from and its chart."""
    found.write(file.with_suffix(".json"))
    file.write_text(page(found), encoding="utf-8")
    written = [file, file.with_suffix(".json")]
    if summary.chart(found.measured, found.machine, file.with_suffix(".png")):
        written.append(file.with_suffix(".png"))
    return written
