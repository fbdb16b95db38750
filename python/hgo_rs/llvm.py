"""Functions compiled by LLVM for this processor, where llvmlite (extra `fast`) is installed."""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

from hgo_rs.errors import HgoError, check_choice

ENGINES = ("auto", "interpreter", "llvm")
"""What steps: `auto` takes llvm where it is there and the work is worth compiling."""

OF_FUNCTIONS = (
    "for a model of Python functions that could not be compiled: write its equations as "
    "expressions, or leave engine out"
)
"""Why a system is not compiled."""

KEPT = 64
"""Kernels of a kind that are kept."""

WIDTHS = {
    "avx512": (8, "+avx512f,+avx512bw,+avx512cd,+avx512dq,+avx512vl,-prefer-256-bit"),
    "avx2": (4, "+avx2,-avx512f"),
    "baseline": (2, "-avx,-avx2,-avx512f"),
}
"""Numbers in a vector, and what is asked of the processor, by instruction set."""

K = TypeVar("K")


def check_engine(engine: str) -> str:
    """The engine, if it is one and is there.

    Raises
    ------
    HgoError
        `engine="llvm"`, and llvmlite is missing or does not know this processor.
    """
    check_choice("engine", engine, ENGINES)
    if engine == "llvm" and isinstance(binding(), str):
        raise HgoError(f"engine = 'llvm' is not allowed: {binding()}")
    return engine


def refused(wanted: bool, why: str) -> None:
    """Refuse an engine that was asked for; else the interpreter does the work."""
    if wanted:
        raise HgoError(f"engine = 'llvm' is not allowed {why}")


def is_plain() -> bool:
    """Whether the environment asks for no kernels at all."""
    return os.environ.get("HGO_INSTRUCTION_SET") == "plain"


@cache
def binding() -> Any:
    """llvmlite's binding, ready for this processor; or why it is not there."""
    try:
        import llvmlite.binding as found
    except ImportError:
        return "llvmlite is not installed; pip install 'hgo_rs[fast]', or leave engine out"
    try:
        found.initialize_native_target()
        found.initialize_native_asmprinter()
        found.Target.from_default_triple()
    except RuntimeError as error:
        return f"llvmlite {version()} does not know this processor ({error}); leave engine out"
    return found


def version() -> str:
    """Of llvmlite."""
    from importlib.metadata import version

    return version("llvmlite")


def instructions() -> str:
    """The instruction set of kernels: the widest that is there, or the one that is asked for."""
    asked = os.environ.get("HGO_INSTRUCTION_SET")
    if asked in WIDTHS:
        return asked
    features = binding().get_host_cpu_features()
    if all(features.get(f"avx512{part}") for part in ("f", "bw", "cd", "dq", "vl")):
        return "avx512"
    return "avx2" if features.get("avx2") else "baseline"


def compiled(text: str, instruction_set: str) -> Any:
    """The engine that holds the functions of a source."""
    llvm, (_, features) = binding(), WIDTHS[instruction_set]
    host = llvm.get_host_cpu_features().flatten()
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=f"{host},{features}", opt=3
    )
    module = llvm.parse_assembly(text)
    module.triple = machine.triple
    module.data_layout = str(machine.target_data)
    module.verify()
    # the code is vectors already, or one number after the other: LLVM's own vectorisers stay away
    options = llvm.create_pipeline_tuning_options(speed_level=2)
    options.slp_vectorization = options.loop_vectorization = False
    options.loop_unrolling = False
    passes = llvm.create_pass_builder(machine, options)
    passes.getModulePassManager().run(module, passes)
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    return engine


class Kept:
    """Kernels by their source and instruction set: the ones used last."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kernels: OrderedDict[tuple[str, str], Any] = OrderedDict()

    def __contains__(self, key: tuple[str, str]) -> bool:
        return key in self._kernels

    def clear(self) -> None:
        """Forget all."""
        self._kernels.clear()

    def use(self, key: tuple[str, str], make: Callable[[], K], then: Callable[[K], Any]) -> Any:
        """What `then` gives for the kernel of a key, which is made once; one caller at a time."""
        with self._lock:
            if key not in self._kernels:
                self._kernels[key] = make()
                while len(self._kernels) > KEPT:
                    self._kernels.popitem(last=False)
            self._kernels.move_to_end(key)
            return then(self._kernels[key])
