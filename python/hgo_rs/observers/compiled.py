"""Records stepped by a function that LLVM has compiled from the observer's table.

The core prints the step from sample to sample; llvmlite (extra `fast`) compiles it for this
processor. The interpreter takes what is rare: missing samples, steps of another length. Samples
that are there are stepped by both, and every bit is compared before a kernel counts.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hgo_rs import _core, llvm
from hgo_rs.observers.records import Array

_WORTH = 1e8
"""Operations of an observer's records from which on `auto` compiles it: some 0.15 s of the
interpreter, about what the compiler takes.
"""
_LARGEST = 5_000
"""Operations of a sample that are compiled at most."""
_CHECKED = 512
"""Samples that are stepped twice at most."""
_COMPARED = 40
"""Samples that are stepped twice at least: of fewer a kernel takes none."""

_compiled = llvm.Kept("a record's step")


class RecordEngine:
    """What steps the records of one observer: the interpreter, later its kernel."""

    def __init__(self, core: Any) -> None:
        self._core = core
        self._source: Any = ()
        self._done = 0.0  # operations of the interpreter

    def run(
        self,
        engine: str,
        record: tuple[float | Array, Array, Array, Array],
        **options: Any,
    ) -> dict[str, Any]:
        """The track of a record (clock, y, u, memory0) by an engine that `check_engine` let pass.

        Raises
        ------
        HgoError
            `engine="llvm"`, and the observer cannot be compiled.
        """
        kernel = self._kernel(engine, record)
        options |= {} if kernel is None else {"kernel": kernel}
        track: dict[str, Any] = self._core.run(*record, **options)
        return track

    def _kernel(self, engine: str, record: tuple[float | Array, Array, Array, Array]) -> Any:
        if engine == "interpreter" or llvm.is_plain():
            return None
        wanted, samples = engine == "llvm", len(record[1])
        self._done += samples  # of one operation at least
        if not wanted and self._done * 500 < _WORTH:  # nothing is traced for nothing
            return None
        if isinstance(llvm.binding(), str):
            return None
        if self._source == ():
            self._source = self._core.record_source()
        source = self._source
        if not llvm.is_compiled(source, _LARGEST, wanted):
            return None
        instructions = llvm.instructions()
        key = (source["text"], instructions)
        worth = self._done * max(source["operations"], 1) >= _WORTH
        if not (wanted or worth or key in _compiled):
            return None

        def made() -> llvm.Kernel:
            made = llvm.compiled(source["text"], instructions)
            address = made.get_function_address(source["name"])
            return llvm.Kernel(made, _core.RecordKernel(address, source["widths"]))

        return _compiled.use(key, made, lambda kernel: self._agrees(kernel, record))

    def _agrees(
        self, kernel: Any, record: tuple[float | Array, Array, Array, Array]
    ) -> bool | None:
        """Whether both give the same bits, in even steps over samples that are there."""
        clock, y, u, start = record
        there = np.flatnonzero(np.isfinite(y).all(axis=1))[:_CHECKED]
        period = clock if isinstance(clock, float) else float(np.median(np.diff(clock)))
        if len(there) < _COMPARED or not period > 0.0:
            return None
        some = (period, y[there], u[there], start)
        by_both = [self._core.run(*some, innovation=True, **of) for of in ({}, {"kernel": kernel})]
        names = ("memory", "innovation", "status", "y", "next")
        return all(len({np.asarray(of[name]).tobytes() for of in by_both}) == 1 for name in names)
