"""What importing costs, what the reference may import, and the stub of the compiled module."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import hgo_rs

ROOT = Path(__file__).parents[2]
PACKAGE = Path(hgo_rs.__file__).parent
REFERENCE = sorted((PACKAGE / "reference").glob("*.py"))
HEAVY = {"scipy", "matplotlib", "pandas", "pyarrow", "click", "rich", "xarray", "cvxpy"}
HEAVY |= {"psutil", "dask", "distributed", "lark", "sympy"}


def imported(statement):
    """Top-level modules that a fresh interpreter has after a statement."""
    code = f"{statement}\nimport sys\nprint(*sorted({{m.split('.')[0] for m in sys.modules}}))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd="/"
    )
    return set(done.stdout.split())


def test_import_is_light():
    """The package itself loads nothing: each module comes with the first use of a name of it."""
    modules = imported("import hgo_rs; dir(hgo_rs); hgo_rs.__all__")
    assert "hgo_rs" in modules
    assert modules.isdisjoint({"numpy", *HEAVY})
    modules = imported("from hgo_rs import *; StandardObserver, simulate, HgoError, Lee")
    assert "numpy" in modules
    assert modules.isdisjoint(HEAVY)


def test_use_is_light():
    """Design by poles, a run and a study need NumPy alone."""
    modules = imported(
        "import hgo_rs as h\n"
        "o = h.LowPowerObserver(3, 10.0)\n"
        "o.run(0.01, [0.0, 0.1, 0.2])\n"
        "h.simulate(h.Lee(), h.StandardObserver(2, 5.0), x0=[1, 0], dt=0.01, steps=9)"
    )
    assert modules.isdisjoint(HEAVY)


def test_names_come_when_they_are_used():
    """In a fresh interpreter: a name of each module, and modules themselves."""
    names = ("HgoError", "FixedStep", "Lee", "Sines", "Observer", "Gap", "simulate", "__version__")
    for name in (*names, "observers", "design", "reference", "_core"):
        imported(f"import hgo_rs; assert hgo_rs.{name} is not None; from hgo_rs import {name}")
    imported(
        "import hgo_rs.simulation, hgo_rs\n"
        "assert callable(hgo_rs.simulate)\n"
        "assert hgo_rs.simulate is hgo_rs.simulation.simulate"
    )
    assert set(hgo_rs.__all__) <= set(dir(hgo_rs))
    with pytest.raises(AttributeError, match="'hgo_rs' has no attribute 'observer'"):
        _ = hgo_rs.observer


def test_type_checkers_are_told_every_name():
    """What they read in place of `__getattr__` is `__all__`, from where it is defined."""
    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    told = {
        alias.name: node.module
        for branch in tree.body
        if isinstance(branch, ast.If)
        for node in branch.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert {*told, "__version__"} == set(hgo_rs.__all__)
    for name, module in told.items():
        assert getattr(importlib.import_module(module), name) is getattr(hgo_rs, name)


def test_public_names_are_there():
    assert sorted(hgo_rs.__all__) == sorted(set(hgo_rs.__all__))
    for name in hgo_rs.__all__:
        assert getattr(hgo_rs, name) is not None


def modules_of(path):
    """Absolute names of the modules that a file of the reference imports, wherever it does."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            here = ["hgo_rs", "reference"][: 3 - node.level] if node.level else []
            yield ".".join([*here, *([node.module] if node.module else [])])
            if node.level:  # from . import x
                yield from (".".join([*here, alias.name]) for alias in node.names)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in ("__import__", "exec", "eval"), f"{path}: {node.lineno}"


@pytest.mark.parametrize("path", REFERENCE, ids=lambda path: path.name)
def test_the_reference_imports_numpy_only(path):
    standard = {"__future__", "collections", "dataclasses", "decimal", "functools", "math"}
    standard |= {"typing"}
    allowed = standard | {"numpy", "hgo_rs"}
    names = list(modules_of(path))
    assert names
    for name in names:
        assert name.split(".")[0] in allowed, name
        assert "_core" not in name.split("."), name
        if name.startswith("hgo_rs"):
            assert name.startswith("hgo_rs.reference"), name


def test_the_reference_is_all_there():
    assert {path.stem for path in REFERENCE} >= {"observers", "simulate", "models", "noise"}


def test_the_stub_holds_for_the_compiled_module():
    pytest.importorskip("mypy")
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "mypy.stubtest",
            "hgo_rs._core",
            "--mypy-config-file",
            str(ROOT / "pyproject.toml"),
        ],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_earlier_name_of_the_logs_stays():
    from hgo_rs import data, logs

    assert data.read_log is logs.read_log and data.Log is logs.Log
