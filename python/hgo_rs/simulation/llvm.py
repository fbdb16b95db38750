"""Studies compiled by LLVM: the tables of a study as a function for vectors of runs.

The core prints a study as LLVM IR; llvmlite (extra `fast`) compiles it for this processor. A kernel
is checked against the interpreter, bit for bit, before its results count.
"""

from __future__ import annotations

import os
import threading
import warnings
from collections import OrderedDict
from collections.abc import Mapping
from functools import cache
from typing import Any

from hgo_rs import _core
from hgo_rs.errors import HgoError, check, check_choice

__all__ = ["ENGINES", "check_engine", "kernel_for"]

ENGINES = ("auto", "interpreter", "llvm")
"""What moves a study: `auto` takes llvm where it is there and the study is worth compiling."""

_WORTH = 3e9
"""Operations of a study from which on `auto` compiles it: some 0.3 s of the interpreter."""
_LARGEST = 20_000
"""Operations of a sample that are compiled at most: beyond, LLVM takes minutes."""
_KEPT = 64
"""Kernels that are kept."""

_WIDTHS = {
    "avx512": (8, "+avx512f,+avx512bw,+avx512cd,+avx512dq,+avx512vl,-prefer-256-bit"),
    "avx2": (4, "+avx2,-avx512f"),
    "baseline": (2, "-avx,-avx2,-avx512f"),
}
"""Runs in a vector, and what is asked of the processor, by instruction set."""


class _Compiled:
    """A kernel, with the engine that holds its code."""

    def __init__(self, engine: Any, kernel: Any) -> None:
        self.engine, self.kernel = engine, kernel
        self.agrees: bool | None = None


_lock = threading.Lock()
_compiled: OrderedDict[tuple[str, str], _Compiled] = OrderedDict()


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
    if engine == "llvm" and isinstance(_binding(), str):
        raise HgoError(f"engine = 'llvm' is not allowed: {_binding()}")
    return engine


def kernel_for(spec: Mapping[str, Any], engine: str, runs: int) -> Any:
    """The kernel of a spec, a piece of a study of `runs` runs; None: the interpreter is to take it.

    Raises
    ------
    HgoError
        `engine="llvm"`, and the study cannot be compiled.
    """
    if engine == "interpreter" or os.environ.get("HGO_INSTRUCTION_SET") == "plain":
        return None
    wanted = engine == "llvm"
    binding = _binding()
    if isinstance(binding, str):
        return None  # `check_engine` has refused it where it was asked for
    work = spec["steps"] * runs
    if not wanted and work * 10 < _WORTH:  # ten operations are few: nothing is traced for nothing
        return None
    instructions = _instructions()
    lanes, features = _WIDTHS[instructions]
    source = _core.study_source(spec, lanes)
    if source is None:
        return _refused(
            wanted,
            "for a system of Python functions that could not be compiled: write its equations as "
            "expressions, or leave engine out",
        )
    if source["operations"] > _LARGEST:
        return _refused(
            wanted,
            f"for {source['operations']} operations a sample, more than the {_LARGEST} that are "
            "compiled; leave engine out",
        )
    if not wanted and work * source["operations"] < _WORTH:
        return None
    with _lock:
        key = (source["text"], instructions)
        made = _compiled.get(key)
        if made is None:
            made = _compiled[key] = _compile(binding, source, features)
            while len(_compiled) > _KEPT:
                _compiled.popitem(last=False)
        _compiled.move_to_end(key)
        if made.agrees is None:
            made.agrees = _core.kernel_agrees(spec, made.kernel)
            if not made.agrees:
                warnings.warn(
                    "a study that LLVM compiled does not give the interpreter's bits (llvmlite "
                    f"{_version()}); the interpreter takes it, with right results",
                    RuntimeWarning,
                    stacklevel=4,
                )
    return made.kernel if made.agrees else None


def _refused(wanted: bool, why: str) -> None:
    """Refuse an engine that was asked for; else the interpreter takes the study."""
    if wanted:
        raise HgoError(f"engine = 'llvm' is not allowed {why}")


@cache
def _binding() -> Any:
    """llvmlite's binding, ready for this processor; or why it is not there."""
    try:
        import llvmlite.binding as binding
    except ImportError:
        return "llvmlite is not installed; pip install 'hgo_rs[fast]', or leave engine out"
    try:
        binding.initialize_native_target()
        binding.initialize_native_asmprinter()
        binding.Target.from_default_triple()
    except RuntimeError as error:
        return f"llvmlite {_version()} does not know this processor ({error}); leave engine out"
    return binding


def _version() -> str:
    from importlib.metadata import version

    return version("llvmlite")


def _instructions() -> str:
    """The instruction set of kernels: the widest that is there, or the one that is asked for."""
    asked = os.environ.get("HGO_INSTRUCTION_SET")
    if asked in _WIDTHS:
        return asked
    features = _binding().get_host_cpu_features()
    if all(features.get(f"avx512{part}") for part in ("f", "bw", "cd", "dq", "vl")):
        return "avx512"
    return "avx2" if features.get("avx2") else "baseline"


def _compile(binding: Any, source: Mapping[str, Any], features: str) -> _Compiled:
    """The functions of a source, compiled."""
    host = binding.get_host_cpu_features().flatten()
    machine = binding.Target.from_default_triple().create_target_machine(
        cpu=binding.get_host_cpu_name(), features=f"{host},{features}", opt=3
    )
    module = binding.parse_assembly(source["text"])
    module.triple = machine.triple
    module.data_layout = str(machine.target_data)
    module.verify()
    # the code is vectors already: LLVM's own vectorisers stay away
    options = binding.create_pipeline_tuning_options(speed_level=2)
    options.slp_vectorization = options.loop_vectorization = False
    options.loop_unrolling = False
    passes = binding.create_pass_builder(machine, options)
    passes.getModulePassManager().run(module, passes)
    engine = binding.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    forms = [
        (opened, distances, engine.get_function_address(name))
        for opened, distances, name in source["forms"]
    ]
    return _Compiled(engine, _core.StudyKernel(source["runs"], forms))
