"""Studies compiled by LLVM: the tables of a study as a function for vectors of runs.

The core prints a study as LLVM IR; llvmlite (extra `fast`) compiles it for this processor. A kernel
is checked against the interpreter, bit for bit, before its results count.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

from hgo_rs import _core, llvm
from hgo_rs.errors import check, check_choice
from hgo_rs.llvm import ENGINES

__all__ = ["ENGINES", "check_engine", "kernel_for"]

_WORTH = 3e9
"""Operations of a study, and of its repetitions, from which on `auto` compiles it: some 0.3 s of
the interpreter.
"""
_SMALL = 5e5
"""Samples of a study up to which `auto` does not look: to print it would take longer."""
_LARGEST = 20_000
"""Operations of a sample that are compiled at most: beyond, LLVM takes minutes."""


_compiled = llvm.Kept("a study")
_done: OrderedDict[tuple[str, str], float] = OrderedDict()
"""Operations of studies that the interpreter took, for as many as kernels are kept."""


def check_engine(engine: str, backend: str) -> str:
    """The engine, if it is one and is there.

    Raises
    ------
    HgoError
        `engine="llvm"`, and llvmlite is missing or does not know this processor; an engine for the
        NumPy reference.
    """
    check_choice("engine", engine, ENGINES)
    if backend != "rust" and engine != "auto":
        check(False, "engine", engine, "for backend 'rust'", "leave it out")
    return llvm.check_engine(engine)


def _is_worth(key: tuple[str, str], operations: float) -> bool:
    """Whether this study, with what was done of it before, is worth the compiler's time."""
    _done[key] = _done.pop(key, 0.0) + operations
    while len(_done) > llvm.KEPT:
        _done.popitem(last=False)
    return _done[key] >= _WORTH


def kernel_for(spec: Mapping[str, Any], engine: str, runs: int) -> Any:
    """The kernel of a spec, a piece of a study of `runs` runs; None: the interpreter is to take it.

    Raises
    ------
    HgoError
        `engine="llvm"`, and the study cannot be compiled.
    """
    if engine == "interpreter" or llvm.is_plain():
        return None
    wanted = engine == "llvm"
    if isinstance(llvm.binding(), str):
        return None  # `check_engine` has refused it where it was asked for
    work = spec["steps"] * runs
    if not wanted and work < _SMALL:
        return None
    instructions = llvm.instructions()
    source = _core.study_source(spec, llvm.WIDTHS[instructions][0])
    if not llvm.is_compiled(source, _LARGEST, wanted):
        return None
    key = (source["text"], instructions)
    if not (wanted or key in _compiled or _is_worth(key, work * source["operations"])):
        return None

    def made() -> llvm.Kernel:
        engine = llvm.compiled(source["text"], instructions)
        forms = [
            (opened, distances, engine.get_function_address(name))
            for opened, distances, name in source["forms"]
        ]
        return llvm.Kernel(engine, _core.StudyKernel(source["runs"], forms))

    return _compiled.use(key, made, lambda kernel: _core.kernel_agrees(spec, kernel))
