"""import: how long the import takes in a fresh interpreter, that of NumPy included.

Processor time around the import statement, so that the interpreter's own start does not count.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import numpy as np

from compare.harness import OURS, TWIN, Call, Implementation, NotInstalled, Size, Workload

TIMED = """
import time
start = time.process_time_ns()
import {}
print(time.process_time_ns() - start)
"""


def of(name: str, module: str) -> Implementation:
    """The import of a module."""

    def prepare(size: Size, threads: int) -> Call:
        if importlib.util.find_spec(module.partition(".")[0]) is None:
            raise NotInstalled(f"{module} is not installed")
        command = [sys.executable, "-I", "-c", TIMED.format(module)]
        return lambda: float(subprocess.check_output(command, text=True))

    return Implementation(name, prepare)


def reported(call: Call, calls: int) -> float:
    """The smallest of what the interpreters report [ns]."""
    return min(call() for _ in range(calls))


WORKLOAD = Workload(
    "import",
    "the import in a fresh interpreter",
    (
        of(OURS, "hgo_rs"),
        of(TWIN, "numpy"),
        of("Numba", "numba"),
        of("JAX", "jax"),
    ),
    full=Size(1, 1),
    quick=Size(1, 1),
    check=Size(1, 1),
    parallel=False,
    statistics=lambda _: np.ones((1, 1)),  # there is nothing to compare
    clock=reported,
)
