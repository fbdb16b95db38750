"""The wheel by itself: one file for every Python >= 3.10, in an empty environment."""

import json
import os
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (shutil.which("cargo") and (ROOT / "Cargo.toml").exists()),
        reason="needs cargo and the sources",
    ),
]


def run(*command, status=0, cwd=None):
    """Standard output (or, for a failure that is wanted, standard error) of a command."""
    # No path of this environment leaks into the empty one.
    env = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))}
    words = [str(c) for c in command]
    result = subprocess.run(words, capture_output=True, text=True, env=env, cwd=cwd)
    assert result.returncode == status, f"{words}\n{result.stdout}\n{result.stderr}"
    return result.stderr if status else result.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    pytest.importorskip("maturin")
    dist = tmp_path_factory.mktemp("dist")
    run(
        *(sys.executable, "-m", "maturin", "build", "--release", "--out", dist),
        *("--interpreter", sys.executable),
        cwd=ROOT,
    )
    (path,) = dist.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def bin_folder(wheel, tmp_path_factory):
    """An environment that holds the wheel and what it declares."""
    home = tmp_path_factory.mktemp("empty")
    venv.create(home, with_pip=True)
    folder = home / ("Scripts" if os.name == "nt" else "bin")
    run(folder / "python", "-m", "pip", "install", "--quiet", wheel)
    return folder


def test_one_wheel_for_every_python(wheel):
    assert wheel.name.startswith("hgo_rs-0.1.0-cp310-abi3-")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    assert {
        "hgo_rs/__init__.py",
        "hgo_rs/_core.pyi",
        "hgo_rs/py.typed",
        "hgo_rs/reference/__init__.py",
        "hgo_rs/scenarios/astolfi.py",
        "hgo_rs/pages/page.html",
    } <= names
    built = (ROOT / "python/hgo_rs/pages/hgo.wasm").is_file()
    assert ("hgo_rs/pages/hgo.wasm" in names) == built
    assert sum(name.startswith("hgo_rs/_core.") and ".pyi" not in name for name in names) == 1
    assert not [name for name in names if name.startswith("tests/") or "__pycache__" in name]
    licences = {Path(name).name for name in names if "dist-info" in name}
    assert {"LICENSE-MIT", "LICENSE-APACHE"} <= licences


def test_a_scenario_runs_in_an_empty_environment(bin_folder, tmp_path):
    result = json.loads(run(bin_folder / "hgo", "run", "astolfi-design", "--json", cwd=tmp_path))
    assert (result["id"], result["backend"]) == ("astolfi-design", "rust")
    assert result["rows"]
    assert all(r["ok"] for r in result["rows"])
    assert not list(tmp_path.iterdir())


def test_import_needs_numpy_alone(bin_folder, tmp_path):
    heavy = ["scipy", "click", "rich", "matplotlib", "pandas"]
    code = f"import sys, hgo_rs; print([m for m in {heavy} if m in sys.modules])"
    assert run(bin_folder / "python", "-c", code, cwd=tmp_path).strip() == "[]"


def test_a_log_is_estimated_and_the_missing_figure_told(bin_folder, tmp_path):
    lines = ["t,q", *(f"{0.01 * i:.2f},{0.5 * (0.01 * i) ** 2!r}" for i in range(300))]
    (tmp_path / "log.csv").write_text("\n".join(lines))
    args = "log.csv --time t --output q --observer low-power --order 3 --gain 10"
    out = run(bin_folder / "hgo", "estimate", *args.split(), cwd=tmp_path)
    assert "written: log.estimates.csv\n" in out
    last = (tmp_path / "log.estimates.csv").read_text().splitlines()[-1].split(",")
    # q = t^2/2: the velocity is t, the acceleration 1.
    assert abs(float(last[3]) - 2.99) < 0.05
    assert abs(float(last[4]) - 1.0) < 0.05


def test_reproduce_without_matplotlib_says_what_to_install(bin_folder, tmp_path):
    error = run(bin_folder / "hgo", "reproduce", "--out", "out", status=2, cwd=tmp_path)
    assert error == "hgo: figures need matplotlib: pip install 'hgo_rs[plot]'\n"
    assert not (tmp_path / "out").exists()
