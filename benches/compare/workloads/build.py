"""build: a cold `pip install .`, and how large the wheel is.

The processor time of pip, maturin, cargo and the compilers together, from a fresh clone of the
commit that is checked out, without anything compiled before; the registry of cargo is warm, what it
downloads takes none. It takes minutes, is done only when it is asked for by name, and once.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from compare.harness import OURS, Call, Implementation, LeftOut, NotInstalled, Size, Workload, need

ROOT = Path(__file__).resolve().parents[3]
UNSET = (
    *("CARGO_TARGET_DIR", "CARGO_BUILD_TARGET_DIR", "CARGO_INCREMENTAL", "RUSTFLAGS"),
    *("RUSTC_WRAPPER", "CARGO_BUILD_RUSTC_WRAPPER", "CARGO_ENCODED_RUSTFLAGS", "PYTHONPATH"),
)
"""Variables under which less is compiled, or something else."""


@dataclass(frozen=True)
class Built:
    """Processor time [ns]; bytes of the wheel and of the module in it."""

    ns: float
    wheel: int
    module: int


def spent() -> float:
    """Processor time of all processes that this one has started and that have ended [ns]."""
    resource = need("resource")
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return float(used.ru_utime + used.ru_stime) * 1e9


def run(*command: str | Path) -> None:
    """A command; what it says is shown if it fails."""
    env = {name: value for name, value in os.environ.items() if name not in UNSET}
    words = list(map(str, command))
    done = subprocess.run(words, capture_output=True, text=True, env=env, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(words)}\nended with {done.returncode}:\n{done.stderr}")


@cache
def built(source: Path = ROOT) -> Built:
    """Clone, compile, install: once in a process."""
    with tempfile.TemporaryDirectory() as folder:
        clone, site = Path(folder, "clone"), Path(folder, "site")
        run("git", "clone", "--quiet", source, clone)
        run("cargo", "fetch", "--quiet", "--locked", "--manifest-path", clone / "Cargo.toml")
        before = spent()
        pip = (sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target")
        run(*pip, site, clone)
        ns = spent() - before
        [wheel] = clone.glob("target/wheels/*.whl")
        with zipfile.ZipFile(wheel) as archive:
            files = archive.infolist()
        compiled = (".so", ".pyd")
        module = sum(one.file_size for one in files if one.filename.endswith(compiled))
        return Built(ns, wheel.stat().st_size, module)


def ours(size: Size, threads: int) -> Call:
    for tool in ("cargo", "git"):
        if shutil.which(tool) is None:
            raise NotInstalled(f"{tool} is not installed")
    if not (ROOT / ".git").exists():
        raise LeftOut(f"{ROOT} is no clone")
    need("resource")
    return built


def told(result: Built) -> str:
    """The sizes."""
    return f"wheel {result.wheel / 1e6:.2f} MB, module in it {result.module / 1e6:.2f} MB"


WORKLOAD = Workload(
    "build",
    "a cold `pip install .` from a fresh clone, processor time of all its processes",
    (Implementation(OURS, ours),),
    full=Size(1, 1),
    quick=Size(1, 1),
    check=Size(1, 1),
    parallel=False,
    statistics=lambda _: np.ones((1, 1)),  # there is nothing to compare
    clock=lambda call, _: float(call().ns),
    tell=told,
    optional=True,
)
