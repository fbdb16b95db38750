"""Instruction sets: what the processor has, and how every implementation is held to one of them."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

from compare.harness import Call, LeftOut, Size

FORCE = "HGO_INSTRUCTION_SET"
"""The variable that holds the core to an instruction set; read at every call. The kernels in C are
compiled for the same one."""
NAMES = {"avx512": "AVX-512", "avx2": "AVX2", "baseline": "SSE2", "plain": "SSE2"}
"""What `FORCE` may say, the widest first, and what the page calls it."""
_FLAGS = {"avx512": ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"), "avx2": ("avx2",)}
_MARCH = {"avx512": "x86-64-v4", "avx2": "x86-64-v3", "baseline": "x86-64", "plain": "x86-64"}
_LLVM = {"avx512": "skylake-avx512", "avx2": "haswell"}


def _flags() -> set[str]:
    """What Linux says that the processor knows; nothing elsewhere."""
    info = Path("/proc/cpuinfo")
    text = info.read_text(encoding="utf-8") if info.exists() else ""
    lines = (line.partition(":") for line in text.splitlines())
    return next((set(value.split()) for key, _, value in lines if key.strip() == "flags"), set())


def has(name: str) -> bool:
    """Whether the processor is known to have an instruction set."""
    found = _flags()
    return bool(found) and found.issuperset(_FLAGS.get(name, ()))


def widest() -> str | None:
    """The widest instruction set that is known to be there; None off x86 and off Linux."""
    return next((name for name in NAMES if has(name)), None)


def held() -> str | None:
    """What everything is held to, if anything."""
    return os.environ.get(FORCE)


def described() -> str:
    """The processor's instruction set, and what everything is held to."""
    found, limit = widest(), held()
    name = platform.machine() if found is None else NAMES[found]
    return name if limit is None else f"{name}, held to {NAMES.get(limit, limit)}"


def march() -> tuple[str, ...]:
    """What tells a C compiler the instruction set: what all are held to, or all there is."""
    target = _MARCH.get(held() or "")
    return ("-march=native",) if target is None else (f"-march={target}", "-mtune=native")


def numba_variables() -> dict[str, str]:
    """What holds Numba to the same instruction set."""
    limit = held() or ""
    return {"NUMBA_CPU_NAME": _LLVM[limit]} if limit in _LLVM else {}


def xla_flags() -> list[str]:
    """What holds JAX to the same instruction set."""
    limit = held() or ""
    return [f"--xla_cpu_max_isa={limit.upper()}"] if limit in _LLVM else []


def forced(prepare: Callable[[Size, int], Call], name: str) -> Callable[[Size, int], Call]:
    """The same implementation, held to a smaller instruction set than the others."""

    def prepared(size: Size, threads: int) -> Call:
        if not has(name):
            raise LeftOut(f"{NAMES[name]} is not known to be there")
        if name in (held(), widest()):
            raise LeftOut(f"{NAMES[name]} is what all others take here")
        call = _within(name, prepare, size, threads)
        return lambda: _within(name, call)

    return prepared


def _within(name: str, function: Callable[..., Any], *arguments: Any) -> Any:
    before = os.environ.get(FORCE)
    os.environ[FORCE] = name
    try:
        return function(*arguments)
    finally:
        if before is None:
            del os.environ[FORCE]
        else:
            os.environ[FORCE] = before
