"""A process that holds one workload on a number of threads, and times what it is asked to.

Thread pools are made once in a process, so there is one process for each number of threads; it
stays warm, and the samples of all processes are taken in turn.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from compare import processor
from compare.harness import Bench, Disagreement

HERE = Path(__file__).resolve().parent
THREADS = (
    *("RAYON_NUM_THREADS", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS"),
    *("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"),
)


class WorkerError(RuntimeError):
    """The process ended, or could not do what it was asked to."""


def cores() -> list[int]:
    """The processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def environment(threads: int) -> dict[str, str]:
    """The environment under which every library uses so many threads, idle ones sleep, and none
    goes beyond the instruction set that all are held to."""
    flags = [os.environ.get("XLA_FLAGS", ""), *processor.xla_flags()]
    flags.append(f"--xla_force_host_platform_device_count={threads}")
    if threads == 1:
        flags.append("--xla_cpu_multi_thread_eigen=false")
    return {
        **os.environ,
        **dict.fromkeys(THREADS, str(threads)),
        **processor.numba_variables(),
        "OMP_WAIT_POLICY": "passive",
        "JAX_PLATFORMS": "cpu",
        "XLA_FLAGS": " ".join(flags).strip(),
    }


class Worker:
    """The other end of `serve`: so many threads in a process of its own on some processors."""

    def __init__(self, key: str, threads: int, places: Sequence[int], *, quick: bool) -> None:
        self.threads = threads
        setup = {"key": key, "threads": threads, "places": list(places), "quick": quick}
        self._process = subprocess.Popen(
            [sys.executable, str(HERE), "--serve", json.dumps(setup)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment(threads),
            text=True,
        )

    def send(self, verb: str, *arguments: Any) -> None:
        """Ask, without waiting for the answer."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps([verb, *arguments]) + "\n")
            self._process.stdin.flush()
        except OSError:
            raise WorkerError(f"the process ended with {self._process.wait()}") from None

    def receive(self) -> Any:
        """The answer."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise WorkerError(f"the process ended with {self._process.wait()}")
        answer = json.loads(line)
        if "error" in answer:
            raise WorkerError(answer["error"])
        return answer["answer"]

    def ask(self, verb: str, *arguments: Any) -> Any:
        """Ask and wait."""
        self.send(verb, *arguments)
        return self.receive()

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):  # what it did not live to read
                    pipe.close()


def serve(setup: Mapping[str, Any]) -> int:
    """Answer requests, a line of JSON each, until the input ends."""
    from compare.workloads import WORKLOADS

    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a library prints must not come between
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, setup["places"])
    workload = next(w for w in WORKLOADS if w.key == setup["key"])
    wall = len(setup["places"]) > 1  # on one processor, which others may want too, its time counts
    bench = Bench(workload, setup["threads"], quick=setup["quick"], wall=wall)
    for line in sys.stdin:
        verb, *arguments = json.loads(line)
        answer: dict[str, Any]
        try:
            if verb == "sample":
                answer = {"answer": bench.sample(*arguments)}
            else:
                done = bench.check(*arguments) if verb == "check" else bench.warm(*arguments)
                answer = {"answer": asdict(done)}
        except Disagreement as error:
            answer = {"error": str(error)}
        except Exception as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)
    return 0
