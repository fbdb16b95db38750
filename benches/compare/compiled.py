"""The C kernels: compiled for this machine when they are first needed, called through ctypes."""

from __future__ import annotations

import ctypes
import math
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from compare import processor
from compare.harness import Call, NotInstalled, Size, processor_time

HERE = Path(__file__).resolve().parent
FLAGS = (
    *("-std=gnu11", "-O3", "-fopenmp-simd"),
    *("-fno-math-errno", "-fno-trapping-math", "-Wno-psabi"),
)
ROUNDED = "-ffp-contract=off"
"""No product and sum in one rounding, which GCC makes where the processor can. With it two
processors give two results: the package, whose bits are the same everywhere, cannot."""
_extra: ContextVar[tuple[str, ...]] = ContextVar("extra", default=())
COLUMNS = 64
"""A kernel takes whole multiples of so many runs: up to eight blocks of the widest registers."""
TRIALS = 20
"""Calls of each kernel from which the fastest is chosen, in turn."""
PIECES = 8
"""Pieces of the work for each thread, so that none waits long for one that is held up."""


def compiler() -> str:
    """The C compiler: CC, or cc."""
    name = os.environ.get("CC", "cc")
    found = shutil.which(name)
    if found is None:
        raise NotInstalled(f"the C compiler {name} is not installed")
    return found


def literal(value: float | int | Sequence[float]) -> str:
    """A constant in C."""
    if isinstance(value, (float, int)):
        return f"({value!r})"
    return "{" + ", ".join(repr(float(entry)) for entry in value) + "}"


def rounded(prepare: Callable[[Size, int], Call]) -> Callable[[Size, int], Call]:
    """The same kernel with every operation rounded."""

    def prepared(size: Size, threads: int) -> Call:
        token = _extra.set((ROUNDED,))
        try:
            return prepare(size, threads)
        finally:
            _extra.reset(token)

    return prepared


def library(
    source: str, blocks: int = 1, **constants: float | int | Sequence[float]
) -> ctypes.CDLL:
    """A C source as a loaded library that takes ``blocks`` blocks of runs in turn; ``constants``
    become macros."""
    given = {"BLOCKS": blocks, **constants}
    macros = "".join(f"#define {name} {literal(value)}\n" for name, value in given.items())
    flags = *FLAGS, *processor.march(), *_extra.get(), "-shared", "-fPIC", f"-I{HERE}"
    return _loaded(f'{macros}#include "columns.h"\n{source}', (compiler(), *flags))


@cache
def _loaded(text: str, compile_: tuple[str, ...]) -> ctypes.CDLL:
    with tempfile.TemporaryDirectory() as folder:
        file, built = Path(folder, "kernel.c"), Path(folder, "kernel.so")
        file.write_text(text, encoding="utf-8")
        command = [*compile_, str(file), "-o", str(built)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"{' '.join(command)}\n{done.stderr}")
        return ctypes.CDLL(str(built))


def value(argument: int | NDArray[Any]) -> Any:
    """An argument as C takes it: a number, or where an array's numbers stand."""
    if isinstance(argument, int):
        return ctypes.c_int64(argument)
    if not argument.flags.c_contiguous:
        raise ValueError("a kernel takes contiguous arrays")
    return argument.ctypes.data_as(ctypes.c_void_p)  # keeps the array alive


def call(
    function: Any, runs: int, threads: int, *arguments: int | NDArray[Any], result: NDArray[Any]
) -> Call:
    """A call of ``function(first, last, runs, *arguments, result)`` for all runs; gives the result.

    Several threads share the runs in pieces: ctypes lets go of the interpreter's lock meanwhile.
    """
    if runs % COLUMNS:
        raise ValueError(f"runs = {runs}: the kernels take multiples of {COLUMNS}")
    given = [value(argument) for argument in (runs, *arguments, result)]
    function.restype = None

    def piece(first: int, last: int) -> None:
        function(ctypes.c_int64(first), ctypes.c_int64(last), *given)

    if threads == 1:

        def alone() -> NDArray[Any]:
            piece(0, runs)
            return result

        return alone
    count = min(runs // COLUMNS, PIECES * threads)
    edges = [COLUMNS * (runs // COLUMNS * i // count) for i in range(count + 1)]
    pool = ThreadPoolExecutor(threads)

    def together() -> NDArray[Any]:
        for done in [pool.submit(piece, *pair) for pair in pairwise(edges)]:
            done.result()
        return result

    return together


def fastest(calls: Sequence[Call]) -> Call:
    """That of several ways to do the same which takes the least time here."""
    least = [math.inf] * len(calls)
    for _ in range(TRIALS):
        least = [min(ns, processor_time(one, 1)) for ns, one in zip(least, calls, strict=True)]
    return calls[least.index(min(least))]


def study(
    source: str,
    name: str,
    blocks: Sequence[int],
    runs: int,
    threads: int,
    *arguments: int | NDArray[Any],
    result: NDArray[Any],
    **constants: float | int | Sequence[float],
) -> Call:
    """`call` of the function ``name`` of a source, with that number of ``blocks`` in turn with
    which it is fastest here: it hangs on the registers and on the delays of the processor."""
    kernels = [getattr(library(source, number, **constants), name) for number in blocks]
    calls = [call(kernel, runs, threads, *arguments, result=result) for kernel in kernels]
    return fastest(calls)
