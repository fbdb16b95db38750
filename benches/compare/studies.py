"""The columns that every study has: the package's, by system and by engine, and those in C."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from compare import compiled
from compare.harness import OURS, Call, Implementation, LeftOut, Size, need
from compare.processor import NAMES, forced
from hgo_rs import simulate

AVX2 = NAMES["avx2"]


class Study(Protocol):
    """Ours: on the package's own systems or on those of a user, by an engine of `simulate`."""

    def __call__(self, size: Size, threads: int, own: bool = False, **engine: Any) -> Call: ...


def by(ours: Study, engine: str) -> Callable[[Size, int], Call]:
    """Ours by one of its engines."""

    def prepare(size: Size, threads: int) -> Call:
        if "engine" not in inspect.signature(simulate).parameters:
            raise LeftOut("`simulate` of this version takes no `engine`")
        if engine == "llvm":
            need("llvmlite")
        return ours(size, threads, engine=engine)

    return prepare


def columns(
    ours: Study, in_c: Callable[[Size, int], Call], *, own_bits: bool = True
) -> tuple[Implementation, ...]:
    """Ours and C. All of ours have the same bits; an own model (``own_bits``) where its equations
    are rounded as those of the built-in one."""
    own, rounded = partial(ours, own=True), compiled.rounded(in_c)
    bits = OURS if own_bits else None
    return (
        Implementation(OURS, ours),
        Implementation("ours, own model", own, bits=bits),
        Implementation("ours, interpreter", by(ours, "interpreter"), parallel=False, bits=OURS),
        Implementation("ours, llvm", by(ours, "llvm"), parallel=False, bits=OURS),
        Implementation(f"ours, {AVX2}", forced(ours, "avx2"), parallel=False, bits=OURS),
        Implementation(f"ours, own model, {AVX2}", forced(own, "avx2"), parallel=False, bits=bits),
        Implementation("C", in_c),
        Implementation("C, rounded", rounded, parallel=False),
        Implementation(f"C, rounded, {AVX2}", forced(rounded, "avx2"), parallel=False),
    )
