"""`make bench`: lets every implementation do the same work, compares, times, and writes it down."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path

from compare import instructions, processor, summary
from compare.harness import OURS, Checked, LeftOut, Size, Workload
from compare.instructions import Counts
from compare.performance import Performance, publish
from compare.summary import Measured, Row
from compare.worker import Worker, WorkerError, cores, serve

ROUNDS = {False: 30, True: 5}
"""Samples of each implementation, full and quick; the smallest are reported."""
TIMING = (
    "the smallest of {} samples, of processor time on one thread and by the clock on the wall on"
    f" several; *noisy*: not a quarter of them came within {summary.NOISY:.0%} of it"
)
"""How that is said on the page."""

ALL = "all"
"""Every workload that is not optional."""


def measure(
    workload: Workload, places: Sequence[int], *, quick: bool, only: list[str] | None = None
) -> Measured:
    """Check, warm up and time a workload; samples are taken in turn, so that all share the weather.

    On one processor, by its time; on all, by the clock on the wall; and, ours alone, on all by as
    many processes of one thread each, which the system may place as it places the threads of one.
    """
    done = Measured(workload)
    with ExitStack() as stack:

        def start(threads: int, where: Sequence[int]) -> Worker:
            worker = Worker(workload.key, threads, where, quick=quick)
            stack.callback(worker.close)
            return worker

        workers, together = [start(1, places[:1])], []
        if workload.parallel and len(places) > 1:
            workers.append(start(len(places), places))
            together = [start(1, places) for _ in places]

        timed: list[tuple[Worker, str, Size]] = []
        for worker in workers:
            checked = Checked(**worker.ask("check", only))
            done.missing |= checked.missing
            done.told |= checked.told
            done.fail(checked.failed, worker.threads)
            for name in checked.distances:
                if name in checked.failed:
                    continue
                try:
                    timed.append((worker, name, Size(**worker.ask("warm", name))))
                except WorkerError as error:
                    done.fail({name: str(error)}, worker.threads)
        if not {(worker, name) for worker, name, _ in timed} >= {(w, OURS) for w in workers}:
            together = []
        for worker in together:
            worker.ask("warm", OURS)

        samples: dict[tuple[str, int], list[float]] = {}
        sizes: dict[tuple[str, int], Size] = {}
        for _ in range(ROUNDS[quick]):
            for worker, name, size in timed:
                samples.setdefault((name, worker.threads), []).append(worker.ask("sample", name))
                sizes[name, worker.threads] = size
                if together and name == OURS and worker.threads > 1:
                    for one in together:
                        one.send("sample", OURS)
                    rate = sum(1.0 / one.receive() for one in together)
                    key = f"{OURS}, {len(together)} processes", len(together)
                    samples.setdefault(key, []).append(1.0 / rate)
                    sizes[key] = size
    for (name, threads), values in samples.items():
        done.add(name, threads, values, sizes[name, threads])
    return done


def counted() -> Counts | None:
    """The instructions of a step, printed; None, and why, where they cannot be counted."""
    try:
        counts = instructions.count()
    except LeftOut as error:
        print(f"instructions of a step: not counted: {error}\n")
        return None
    print(f"instructions of a step, {counts.compiler}\n\n{instructions.table(counts)}\n")
    return counts


def make_page(page: Path, source: Path | None) -> int:
    """A page from its source; without one, from its own data with the instructions of today."""
    found = Performance.read(source or page.with_suffix(".json"))
    if source is None:
        counts = counted()
        if counts is None:
            return 1
        found = replace(found, counts=counts)
    print("wrote " + ", ".join(map(str, publish(found, page))))
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; 0, or 1 if implementations disagree or fail."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given[:1] == ["--serve"]:
        return serve(json.loads(given[1]))
    from compare.workloads import WORKLOADS

    names = list(dict.fromkeys(workload.name for workload in WORKLOADS))
    optional = [workload.name for workload in WORKLOADS if workload.optional]
    parser = argparse.ArgumentParser(prog="benches/compare", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder (default: out)")
    parser.add_argument(
        "--workload",
        nargs="+",
        choices=(ALL, *names),
        metavar="NAME",
        help=f"{', '.join(names)}; {ALL} (default): all but {', '.join(optional)}",
    )
    parser.add_argument(
        "--instructions",
        choices=("avx2", "avx512"),
        help="hold ours, C, Numba and JAX to an instruction set of x86 processors (default: what"
        f" {processor.FORCE} says, or all that this one has)",
    )
    parser.add_argument(
        "--implementation", nargs="+", metavar="NAME", help="time these alone, and say so"
    )
    parser.add_argument(
        "--quick", action="store_true", help="small sizes, to try whether all works"
    )
    parser.add_argument(
        "--page",
        type=Path,
        metavar="FILE.md",
        help="measure nothing; make the page of what --from holds, or, without it, of what the page"
        " holds, with the instructions counted anew",
    )
    parser.add_argument(
        "--from", type=Path, dest="source", metavar="FILE.json", help="a performance.json"
    )
    options = parser.parse_args(given)
    if options.page is not None:
        source = options.source or options.page.with_suffix(".json")
        if not source.exists():
            parser.error(f"{source} is not there: `make bench` writes out/performance.json")
        return make_page(options.page, options.source)
    known = {one.name for workload in WORKLOADS for one in workload.implementations}
    for name in options.implementation or ():
        if name not in known:
            parser.error(f"--implementation {name!r}: choose from {', '.join(sorted(known))}")

    if options.instructions is not None:
        if not processor.has(options.instructions):
            parser.error(f"--instructions {options.instructions}: not known to be there")
        os.environ[processor.FORCE] = options.instructions
    asked = options.workload or [ALL]

    options.out.mkdir(parents=True, exist_ok=True)
    machine = summary.Machine.this()
    print(f"{machine}\n")
    everything = []
    for workload in WORKLOADS:
        if workload.name not in asked and (workload.optional or ALL not in asked):
            continue
        try:
            done = measure(workload, cores(), quick=options.quick, only=options.implementation)
        except WorkerError as error:
            done = Measured(workload, failures=[f"{workload.key}: {error}"])
        print(summary.table(done, machine.cores), end="\n\n", flush=True)
        everything.append(done)
    whole = ALL in asked and options.implementation is None and not options.quick
    Performance(
        machine, TIMING.format(ROUNDS[options.quick]), everything, counted() if whole else None
    ).write(options.out / "performance.json")
    rows: list[Row] = [row for done in everything for row in done.rows]
    listed = json.dumps([asdict(row) for row in rows], indent=1)
    (options.out / "bench.json").write_text(f"{listed}\n", encoding="utf-8")
    page = summary.markdown(everything, machine, left_out=options.implementation)
    (options.out / "bench.md").write_text(page, encoding="utf-8")
    written = ["performance.json", "bench.json", "bench.md"]
    if not rows:
        print("nothing was measured: no chart")
    elif summary.chart(everything, machine, options.out / "bench.png"):
        written.append("bench.png")
    else:
        print("matplotlib is not installed: no chart")
    print("wrote " + ", ".join(str(options.out / name) for name in written))
    if options.implementation is not None:
        print(f"left out by --implementation: all but {'; '.join(options.implementation)}")
    failures = [text for done in everything for text in done.failures]
    for text in failures:
        print(f"FAILED {text}", file=sys.stderr)
    return 1 if failures else 0
