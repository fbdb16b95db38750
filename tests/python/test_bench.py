"""benches/compare: what is timed has been compared, and what is not there is named."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benches"))

from compare import command, summary
from compare.harness import (
    Array,
    Bench,
    Call,
    Disagreement,
    Implementation,
    NotInstalled,
    Size,
    Workload,
    distance,
    need,
    standard_errors,
)
from compare.workloads import WORKLOADS

ROOT = Path(__file__).parents[2]
FIELDS = {"workload", "implementation", "threads", "ns_per_step", "runs", "steps"}
SMALL = Size(8, 20)


def compare(
    out: Path, *arguments: str, **environment: str
) -> tuple[subprocess.CompletedProcess[str], list[dict[str, object]]]:
    """The command in quick mode, and its bench.json."""
    done = subprocess.run(
        [sys.executable, str(ROOT / "benches/compare"), "--quick", "--out", str(out), *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, **environment},
    )
    file = out / "bench.json"
    return done, json.loads(file.read_text(encoding="utf-8")) if file.exists() else []


def test_two_workloads_in_quick_mode(tmp_path: Path) -> None:
    asked = {"lee-mc": ["ours", "C", "NumPy"], "online-step": ["ours", "Python, floats", "NumPy"]}
    names = sorted({name for names in asked.values() for name in names})
    done, rows = compare(tmp_path, "--workload", *asked, "--implementation", *names)
    assert done.returncode == 0, done.stderr
    page = (tmp_path / "bench.md").read_text(encoding="utf-8")
    for workload, wanted in asked.items():
        measured = {r["implementation"] for r in rows if r["workload"] == workload}
        for name in wanted:
            # the C compiler may be missing, and is then named
            assert name in measured or f"{name}: the C compiler" in done.stdout
            assert f"| {workload} | {name} |" in page or f"- {name}: the C compiler" in page
    for row in rows:
        assert set(row) == FIELDS
        assert isinstance(row["ns_per_step"], float)
        assert 0.0 < row["ns_per_step"] < 1e9
        assert min(int(str(row[key])) for key in ("threads", "runs", "steps")) >= 1
    assert "left out by --implementation" in done.stdout
    cores = summary.Machine.this().cores
    assert f"{cores} cores" in page
    if cores > 1:
        assert f"{cores} processes of one thread each" in done.stdout
        assert {r["threads"] for r in rows if r["workload"] == "lee-mc"} == {1, cores}
    if "matplotlib is not installed" not in done.stdout:
        assert (tmp_path / "bench.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("compiler", "code", "said"),
    [
        ("no-such-compiler", 0, "C: the C compiler no-such-compiler is not installed"),
        ("false", 1, "FAILED record-1e6, standard n = 2, C, threads 1: RuntimeError"),
    ],
)
def test_what_is_not_there_and_what_fails_is_named(
    tmp_path: Path, compiler: str, code: int, said: str
) -> None:
    arguments = ("--workload", "record-1e6", "--implementation", "C")
    done, rows = compare(tmp_path, *arguments, CC=compiler)
    assert (done.returncode, rows) == (code, [])
    assert said in done.stdout
    assert said in (tmp_path / "bench.md").read_text(encoding="utf-8")


def test_unknown_names_are_refused(tmp_path: Path) -> None:
    done, _ = compare(tmp_path, "--workload", "lee")
    assert done.returncode == 2
    assert "lee-mc" in done.stderr
    done, _ = compare(tmp_path, "--implementation", "Fortran")
    assert done.returncode == 2
    assert "'Fortran': choose from C," in done.stderr


def test_the_workloads_of_the_page() -> None:
    names = [workload.name for workload in WORKLOADS]
    assert list(dict.fromkeys(names)) == [
        *("lee-mc", "fu-mc", "astolfi-vertices", "sanfelice-praly-mc", "katayama-ship"),
        *("record-1e6", "online-step", "import"),
    ]
    assert len({workload.key for workload in WORKLOADS}) == len(WORKLOADS)


@pytest.mark.parametrize("workload", WORKLOADS[:5], ids=lambda w: w.name)
def test_ours_and_the_twin_agree(workload: Workload) -> None:
    bench = Bench(replace(workload, check=Size(workload.check.runs, 60)), 1, quick=True)
    checked = bench.check(["ours", "NumPy"])
    assert set(checked.distances) == {"ours", "NumPy"}, checked.failed
    assert checked.distances["ours"] <= workload.tolerance


# --- broken implementations -------------------------------------------------------------------


def true(size: Size, threads: int) -> Call:
    """Statistics of random walks."""
    walks = np.random.default_rng(0).standard_normal((size.runs, size.steps)).cumsum(axis=1)
    return lambda: np.column_stack([walks.mean(axis=1), 1e6 * walks.std(axis=1)])


def broken(kind: str) -> Implementation:
    """`true` with something wrong."""

    def prepare(size: Size, threads: int) -> Call:
        if kind == "not installed":
            need("surely_not_there")
        if kind == "crash":
            raise ZeroDivisionError("in its preparation")
        result: Array = true(size, threads)()
        if kind == "perturbed":
            result[3, 0] *= 1.0 + 1e-6
        elif kind == "NaN":
            result[-1, -1] = math.nan
        elif kind == "shape":
            result = result[:-1]
        elif kind == "large sizes only" and size.steps > SMALL.steps:
            result[0, 0] += 1.0
        return lambda: result

    return Implementation(kind, prepare)


def walks(*others: Implementation) -> Workload:
    implementations = (Implementation("NumPy", true), *others)
    return Workload("walks", "", implementations, full=Size(8, 500), quick=SMALL, check=SMALL)


@pytest.mark.parametrize("kind", ["perturbed", "NaN", "shape"])
def test_a_wrong_result_is_caught_before_the_timing(kind: str) -> None:
    checked = Bench(walks(broken(kind)), 1, quick=True).check()
    assert f"walks: {kind} differs from NumPy" in checked.failed[kind]
    assert list(checked.distances) == ["NumPy"]


def test_a_result_that_is_wrong_at_the_timed_size_only_is_caught_too() -> None:
    kind = "large sizes only"
    bench = Bench(walks(broken(kind)), 1, quick=False)
    assert kind in bench.check().distances
    bench.warm("NumPy")
    with pytest.raises(Disagreement, match=kind):
        bench.warm(kind)


def test_a_crash_is_a_failure_and_a_missing_library_is_not() -> None:
    checked = Bench(walks(broken("crash"), broken("not installed")), 1, quick=True).check()
    assert checked.failed == {"crash": "ZeroDivisionError: in its preparation"}
    assert checked.missing == {"not installed": "surely_not_there is not installed"}
    with pytest.raises(NotInstalled):
        need("surely_not_there.inside")


def test_random_numbers_of_its_own_agree_within_standard_errors() -> None:
    def other(shift: float) -> Implementation:
        def prepare(size: Size, threads: int) -> Call:
            values = np.random.default_rng(7).standard_normal((size.runs, 1)) + shift
            return lambda: values

        return Implementation(f"shifted by {shift:g}", prepare, independent=True)

    base = Implementation(
        "NumPy", lambda s, _: lambda: np.random.default_rng(1).normal(size=(s.runs, 1))
    )
    size = Size(400, 1)
    workload = Workload("", "", (base, other(0.0), other(0.5)), full=size, quick=size, check=size)
    checked = Bench(workload, 1, quick=True).check()
    assert checked.distances["shifted by 0"] < 4.0
    assert "standard errors" in checked.failed["shifted by 0.5"]


def test_distances() -> None:
    a = np.array([[1.0, 1e-9], [2.0, 2e-9]])
    assert distance(a, a) == 0.0
    assert distance(a + np.array([0.0, 1e-9]), a) == pytest.approx(0.5)
    assert distance(a, a[:1]) == math.inf
    assert distance(a * math.nan, a) == math.inf
    assert standard_errors(a * math.nan, a) == math.inf


def test_tables_say_what_ours_gains() -> None:
    workload = replace(WORKLOADS[0], implementations=WORKLOADS[0].implementations[:3])
    done = summary.Measured(workload)
    for name, threads, value in (("ours", 1, 2.0), ("C", 1, 1.0), ("ours", 2, 1.1)):
        done.add(name, threads, [value] * 5, SMALL)
    done.add("ours, 2 processes", 2, [1.0, 1.0, 1.0, 1.0, 9.0], SMALL)
    done.missing["JAX"] = "jax is not installed"
    text = summary.table(done, 2)
    assert "0.5" in text
    assert "JAX: jax is not installed" in text
    assert "reach 1 ns together; all cores in one process reach 0.91 of that rate" in text
    assert done.rows[0] == summary.Row("lee-mc", "ours", 1, 2.0, 8, 20)


def test_a_process_that_ends_is_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "executable", "false")
    assert command.main(["--quick", "--out", str(tmp_path), "--workload", "import"]) == 1
    assert "FAILED import: the process ended with 1" in capfd.readouterr().err
