"""Functions compiled by LLVM for this processor, where llvmlite (extra `fast`) is installed."""

from __future__ import annotations

import os
import sys
import threading
import warnings
from collections import OrderedDict
from collections.abc import Callable
from functools import cache
from typing import Any, TypeGuard

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


def is_compiled(
    source: dict[str, Any] | None, most: int, wanted: bool
) -> TypeGuard[dict[str, Any]]:
    """Whether a source of at most so many operations is there; refused where it was asked for.

    Raises
    ------
    HgoError
        `wanted`, and the source is of Python functions, or longer.
    """
    if source is None:
        refused(wanted, OF_FUNCTIONS)
        return False
    if source["operations"] > most:
        told = f"for {source['operations']} operations a sample, more than the {most} that are"
        refused(wanted, f"{told} compiled; leave engine out")
        return False
    return True


class Kernel:
    """A compiled function, with the engine that holds its code."""

    def __init__(self, engine: Any, function: Any) -> None:
        self.engine, self.function = engine, function
        self.agrees: bool | None = None
        """With the interpreter, bit for bit; None while nothing was compared."""


class Kept:
    """Kernels of a kind, by their source and instruction set: the ones used last."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._lock = threading.Lock()
        self._kernels: OrderedDict[tuple[str, str], Kernel] = OrderedDict()

    def __contains__(self, key: tuple[str, str]) -> bool:
        return key in self._kernels

    def use(
        self,
        key: tuple[str, str],
        make: Callable[[], Kernel],
        agrees: Callable[[Any], bool | None],
    ) -> Any:
        """The function of a key, made once; None unless it gives the interpreter's bits.

        `agrees` compares it with the interpreter, or gives None where it could not. A difference is
        warned of once. One caller at a time.
        """
        with self._lock:
            if key not in self._kernels:
                self._kernels[key] = make()
                while len(self._kernels) > KEPT:
                    self._kernels.popitem(last=False)
            self._kernels.move_to_end(key)
            kernel = self._kernels[key]
            if kernel.agrees is None:
                kernel.agrees = agrees(kernel.function)
                if kernel.agrees is False:
                    warnings.warn(
                        f"{self._what}, compiled by LLVM, gives other bits than the interpreter "
                        f"(llvmlite {version()}); the interpreter is used: the results are right",
                        RuntimeWarning,
                        stacklevel=_callers(),
                    )
            return kernel.function if kernel.agrees else None


def _callers() -> int:
    """Calls from the one who asks up to the user's."""
    frame, count = sys._getframe(1), 1
    while frame.f_back and frame.f_globals["__name__"].startswith("hgo_rs."):
        frame, count = frame.f_back, count + 1
    return count
