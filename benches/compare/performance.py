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

Times of the package and of other implementations of the same work, and the instructions of a step.
`benches/compare` writes this page, its [chart](performance.png) and its [data](performance.json).

![Time per run and step of every workload and implementation](performance.png)

## How to read it

Times are per run and step: the time of a call, divided by the runs and by the steps of each; for a
record, per sample. A call includes arguments, the study and the arrays of the result, but no
compilation and no loading. The implementations are timed in turn; the section Measured names the
machine and the method. On one thread two columns compare: *of C, rounded* is the time of an
implementation over that of *C, rounded* for the same instruction set; *ours is faster by* is its
time over ours: below 1, it is the faster one.

Every implementation draws the same random numbers and starts from the same states. Its results are
compared with those of the package's NumPy reference before the timing and again at the timed size.
(*Numba, plain* draws Numba's own numbers; its means agree within standard errors.) All rows named
*ours* must have the same bits, except an own model whose equations are rounded in another order, as
in `katayama-ship`.

| implementation | description |
| --- | --- |
| ours | `simulate`, `run` or `step` of the package with its own systems |
| ours, own model | the same equations written by a user: `hgo.Plant`, `hgo.Model` |
| ours, interpreter; ours, llvm | restricted to one engine; *ours* chooses the engine by itself |
| ..., AVX2 | restricted to that instruction set; C compiled for it |
| C | a kernel for one experiment, as the limit; *rounded*: see below |
| C, exported | the source that `export` writes, with the operations and bits of the package |
| Numba | one compiled loop a run, `fastmath`, no allocation, `prange` over the runs |
| JAX | `lax.scan` over the steps, `vmap` over the runs, `jit`, double precision |
| NumPy | the reference `hgo_rs.reference`: arrays over the runs, a Python loop over the steps |

A C kernel has the constants of its experiment compiled in and uses vectors as wide as the registers
of the instruction set. It interleaves several blocks of runs, as many as are fastest here, to hide
the latency of dependent operations, and is compiled with `-O3` for the processor. It shows what the
work costs on this processor. The starts of the runs are read from arrays and differ, in C as in all
others, so that no compiler can compute equal runs once. (In *one start* all runs start alike; the
kernels make no use of it.) In *C* the compiler fuses a·b + c to one operation with one rounding
where the processor can, so another processor gives other bits. *C, rounded* is the same kernel with
every operation rounded, as in the package: the limit for equal bits on all processors.

"""

REPEAT = """\
## How to repeat it

```sh
make bench                                                 # measures -> out/performance.json
python benches/compare --workload all build                # with a cold build, which takes minutes
python benches/compare --page docs/performance.md --from out/performance.json
```

`--workload` and `--implementation` select some; `--instructions avx2` restricts ours, C, Numba and
JAX to an instruction set. The extra `bench` installs the other implementations; missing ones are
named under each table. The C compiler is `cc`, or `CC`. Times depend on the machine and on its
load; instructions do not.

"""

INSTRUCTIONS = """\
## Instructions a step

One step of each observer in double precision under each scheme: the mean over a thousand steps,
counted by callgrind in plain x86-64 code of the release profile, including the call. The steps
hardly branch, so most take the same number every time. A test counts again and compares if the
compiler is the one named here; `python benches/compare --page docs/performance.md` counts again
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
