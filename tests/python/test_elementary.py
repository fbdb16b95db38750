"""Elementary functions as LLVM IR: the bits of the core, one number alone and several at once."""

from __future__ import annotations

import ctypes
import math
import re
from typing import Any

import numpy as np
import pytest

from hgo_rs import _core
from hgo_rs.errors import DesignError
from hgo_rs.exports.precision import PRECISIONS
from hgo_rs.exports.table import FUNCTIONS
from hgo_rs.reference.noise import Streams

NAMES = sorted(FUNCTIONS.values())
TWO = ("atan2", "powf")
OF_NOISE = ["advanced", "fraction", "radius_parts", "radius_of", "turned"]
REALS = {"double": "double", "single": "float"}


class Compiled:
    """A module, optimised as far as LLVM does, with a function `all(in, out)`."""

    def __init__(self, ir: str) -> None:
        llvm = pytest.importorskip("llvmlite.binding")
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        module = llvm.parse_assembly(ir)
        module.verify()
        target = llvm.Target.from_default_triple()
        machine = target.create_target_machine(
            cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=3
        )
        options = llvm.create_pipeline_tuning_options(speed_level=3)
        builder = llvm.create_pass_builder(machine, options)
        builder.getModulePassManager().run(module, builder)
        self.text = str(module)
        self.engine = llvm.create_mcjit_compiler(module, machine)
        self.engine.finalize_object()
        pointers = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)
        self.function = pointers(self.engine.get_function_address("all"))

    def __call__(self, given: np.ndarray, results: np.ndarray) -> np.ndarray:
        assert given.flags.c_contiguous and results.flags.c_contiguous
        self.function(given.ctypes.data, results.ctypes.data)
        return results


def wrapper(name: str, kind: str, suffix: str) -> str:
    """`all`: loads the arguments one after the other, stores the result."""
    count = 2 if name in TWO else 1
    lines = ["define void @all(ptr %in, ptr %out) {"]
    for i in range(count):
        lines.append(f"  %p{i} = getelementptr {kind}, ptr %in, i64 {i}")
        lines.append(f"  %x{i} = load {kind}, ptr %p{i}, align 4")
    given = ", ".join(f"{kind} %x{i}" for i in range(count))
    lines.append(f"  %y = call {kind} @hgo_{name}{suffix}({given})")
    lines.append(f"  store {kind} %y, ptr %out, align 4")
    return "\n".join([*lines, "  ret void", "}", ""])


def numbers(count: int) -> np.ndarray:
    rng = np.random.default_rng(8)
    special = [0.0, 1.0, 0.25, 0.5, 0.75, 1.5, 22.0, 44.0, 88.7, 103.9, 709.78, 745.14, 2e4, 1e9,
               5e-324, 1e-310, 1e-45, 1e-40, 3.4e38, 1.7e308, math.inf, math.nan]  # fmt: skip
    wide = rng.standard_normal(count) * 10.0 ** rng.uniform(-12, 12, count)
    near = rng.uniform(-30.0, 30.0, count)
    return np.concatenate([special, np.negative(special), wide, near])


def pairs() -> np.ndarray:
    """Arguments x, p: (N, 2), N a multiple of 8."""
    values = numbers(600)
    ends = values[:44]
    of_ends = np.stack(np.meshgrid(ends, ends), axis=-1).reshape(-1, 2)
    rows = np.concatenate([of_ends, np.stack([values[:-1], values[1:]], axis=-1)])
    return np.ascontiguousarray(rows[: len(rows) // 8 * 8])


def core(name: str, rows: np.ndarray, precision: str) -> np.ndarray:
    """The core's values, by its interpreter."""
    word = next(word for word, function in FUNCTIONS.items() if function == name)
    operands = [0, 1] if name in TWO else [0]
    table = {"inputs": ["x", "p"], "constants": [], "ops": [[word, *operands]], "outputs": [2]}
    return np.array(_core.evaluate_table(table, rows.tolist(), precision == "single"))[:, 0]


def same(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Where the bits are the same; one NaN is as good as another."""
    kind = np.uint64 if a.dtype == np.float64 else np.uint32
    return (a.view(kind) == b.view(kind)) | (np.isnan(a) & np.isnan(b))


@pytest.mark.parametrize("lanes", [1, 8])
@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("name", NAMES)
def test_compiled_functions_have_the_cores_bits(name: str, precision: str, lanes: int) -> None:
    real, kind = PRECISIONS[precision].real, REALS[precision]
    vector = kind if lanes == 1 else f"<{lanes} x {kind}>"
    suffix = ("f" if precision == "single" else "") + ("" if lanes == 1 else f"_v{lanes}")
    ir = _core.elementary_source("llvm", precision, [name], lanes=lanes)
    compiled = Compiled(ir + wrapper(name, vector, suffix))
    assert f"@hgo_{name}" not in compiled.text  # it stands where it is called
    with np.errstate(over="ignore"):
        rows = pairs().astype(real)
    made = np.empty(len(rows), real)
    for first in range(0, len(rows), lanes):
        given = np.ascontiguousarray(rows[first : first + lanes].T)
        compiled(given, made[first : first + lanes])
    expected = core(name, rows.astype(float), precision).astype(real)
    wrong = ~same(made, expected)
    assert not wrong.any(), (name, rows[wrong][:3], made[wrong][:3], expected[wrong][:3])


def test_compiled_streams_draw_the_cores_normals() -> None:
    """Eight runs side by side: two steps of the generator, a pair of normal values."""
    bits, real = "<8 x i64>", "<8 x double>"
    state = f"{{ {', '.join([bits] * 5)} }}"
    pair = f"{{ {real}, {real} }}"
    lines = ["define void @all(ptr %in, ptr %out) {"]
    for i in range(4):
        lines.append(f"  %p{i} = getelementptr {bits}, ptr %in, i64 {i}")
        lines.append(f"  %a{i} = load {bits}, ptr %p{i}, align 8")
    for before, after in ("ab", "bc"):
        given = ", ".join(f"{bits} %{before}{i}" for i in range(4))
        lines.append(f"  %{after} = call {state} @hgo_advanced_v8({given})")
        lines.append(f"  %{after}w = extractvalue {state} %{after}, 0")
        lines.append(f"  %{after}u = call {real} @hgo_fraction_v8({bits} %{after}w)")
        for i in range(4):
            lines.append(f"  %{after}{i} = extractvalue {state} %{after}, {i + 1}")
    lines += [
        f"  %parts = call {pair} @hgo_radius_parts_v8({real} %bu)",
        f"  %k = extractvalue {pair} %parts, 0",
        f"  %s = extractvalue {pair} %parts, 1",
        f"  %radius = call {real} @hgo_radius_of_v8({real} %k, {real} %s)",
        f"  %turned = call {pair} @hgo_turned_v8({real} %radius, {real} %cu)",
        f"  %first = extractvalue {pair} %turned, 0",
        f"  store {real} %first, ptr %out, align 8",
        "  ret void",
        "}",
    ]
    ir = _core.elementary_source("llvm", "double", OF_NOISE, lanes=8)
    compiled = Compiled(ir + "\n".join(lines))
    for seed in range(20):
        states = np.array(Streams(seed, 8, 0).state)
        made = compiled(states, np.empty(8))
        core = [float(_core.random("normal", 1, seed, run)[0]) for run in range(8)]
        assert made.tolist() == core


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (("ada", "double", ["exp"]), 'language = "ada" is not known: choose "c", "rust" or "llvm"'),
        (("c", "half", ["exp"]), 'precision = "half" is not known: choose "double" or "single"'),
        (("c", "single", ["fraction"]), '"fraction" is no elementary function in single precision'),
    ],
)
def test_what_is_not_known_is_refused(given: Any, told: str) -> None:
    with pytest.raises(DesignError, match=re.escape(told)):
        _core.elementary_source(*given)
