"""benches/compare: what is timed has been compared, and what is not there is named."""

from __future__ import annotations

import functools
import json
import math
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benches"))

from compare import command, compiled, processor, studies, summary, worker
from compare.harness import (
    Array,
    Bench,
    Call,
    Disagreement,
    Implementation,
    LeftOut,
    NotInstalled,
    Size,
    Workload,
    differing,
    distance,
    need,
    standard_errors,
)
from compare.workloads import WORKLOADS, build

STUDIES = [w for w in WORKLOADS if any(i.name == "ours, llvm" for i in w.implementations)]
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
        timeout=300,
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
        "loop-mc",
        *("record-1e6", "online-step", "import", "build"),
    ]
    assert len({workload.key for workload in WORKLOADS}) == len(WORKLOADS)
    assert [workload.name for workload in WORKLOADS if workload.optional] == ["build"]


@pytest.mark.parametrize("workload", STUDIES, ids=lambda w: w.key)
def test_ours_and_the_twin_agree(workload: Workload) -> None:
    bench = Bench(replace(workload, check=Size(workload.check.runs, 60)), 1, quick=True)
    names = {one.name for one in workload.implementations if one.name.startswith("ours")}
    checked = bench.check([*names, "NumPy"])
    assert checked.failed == {}
    assert {"ours", "NumPy"} <= set(checked.distances)
    assert names <= checked.distances.keys() | checked.missing.keys()
    assert all(apart <= workload.tolerance for apart in checked.distances.values())
    # no plant of a user has the ship's controller, every plant of a loop is a user's own
    if workload.name not in ("katayama-ship", "loop-mc"):
        assert "ours, own model" in checked.distances
        own = next(i for i in workload.implementations if i.name == "ours, own model")
        assert own.bits == "ours"


@pytest.mark.parametrize("workload", STUDIES, ids=lambda w: w.key)
def test_a_kernel_moves_every_run_from_its_own_start(workload: Workload) -> None:
    """Its starts are data, and differ: what a compiler moved once for several runs is wrong."""
    size = Size(workload.check.runs, 60)
    names = ["C, rounded", "C, rounded, AVX2", "NumPy"]
    checked = Bench(replace(workload, check=size), 1, quick=True).check(names)
    assert checked.failed == {}
    if "C, rounded" in checked.missing:
        pytest.skip(checked.missing["C, rounded"])
    assert "C, rounded" in checked.distances


@pytest.mark.parametrize("workload", STUDIES, ids=lambda w: w.key)
def test_every_run_starts_elsewhere(workload: Workload) -> None:
    ours = next(one for one in workload.implementations if one.name == "ours")
    size = Size(workload.check.runs, 60)
    rows = workload.statistics(ours.prepare(size, 1)())
    assert len(np.unique(rows, axis=0)) == len(rows)


# --- engines and instruction sets ----------------------------------------------------------------


def test_a_version_without_engines_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def ours(size: Size, threads: int, own: bool = False, **engine: str) -> Call:
        return lambda: engine

    monkeypatch.setattr(studies, "simulate", lambda plant: None)
    with pytest.raises(LeftOut, match="takes no `engine`"):
        studies.by(ours, "interpreter")(SMALL, 1)
    monkeypatch.setattr(studies, "simulate", lambda plant, engine="auto": None)
    assert studies.by(ours, "interpreter")(SMALL, 1)() == {"engine": "interpreter"}
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    with pytest.raises(NotInstalled, match="llvmlite is not installed"):
        studies.by(ours, "llvm")(SMALL, 1)


def known(monkeypatch: pytest.MonkeyPatch, *flags: str) -> None:
    """A processor that knows these instructions, and nothing held."""
    monkeypatch.setattr(processor, "_flags", lambda: set(flags))
    monkeypatch.delenv(processor.FORCE, raising=False)


AVX512 = ("avx2", "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")


def test_c_is_compiled_for_the_instructions_that_ours_takes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known(monkeypatch, *AVX512)
    assert processor.march() == ("-march=native",)
    assert processor.described() == "AVX-512"
    seen = []

    def prepare(size: Size, threads: int) -> Call:
        seen.append((processor.march()[0], os.environ[processor.FORCE]))
        return lambda: seen.append((processor.march()[0], os.environ[processor.FORCE]))

    processor.forced(prepare, "avx2")(SMALL, 1)()
    assert seen == [("-march=x86-64-v3", "avx2")] * 2
    assert processor.FORCE not in os.environ
    monkeypatch.setenv(processor.FORCE, "avx2")
    assert processor.described() == "AVX-512, held to AVX2"
    environment = worker.environment(1)
    assert environment["NUMBA_CPU_NAME"] == "haswell"
    assert "--xla_cpu_max_isa=AVX2" in environment["XLA_FLAGS"].split()


def test_what_all_others_take_is_no_column_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    def held() -> None:
        processor.forced(true, "avx2")(SMALL, 1)

    known(monkeypatch, "avx2")
    with pytest.raises(LeftOut, match="AVX2 is what all others take"):
        held()
    known(monkeypatch, *AVX512)
    held()
    monkeypatch.setenv(processor.FORCE, "avx2")
    with pytest.raises(LeftOut, match="AVX2 is what all others take"):
        held()
    known(monkeypatch)
    with pytest.raises(LeftOut, match="AVX2 is not known to be there"):
        held()


@pytest.mark.parametrize(("instructions", "runs"), [("avx512", 8), ("avx2", 4), ("baseline", 2)])
def test_the_width_of_a_kernel(
    instructions: str, runs: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not processor.has(instructions):
        pytest.skip(f"{instructions} is not known to be there")
    monkeypatch.setenv(processor.FORCE, instructions)
    try:
        kernel = compiled.library("int64_t width(void) { return RUNS; }").width
    except NotInstalled as error:
        pytest.skip(str(error))
    assert kernel() == runs


def test_instructions_that_are_not_there_are_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    known(monkeypatch, "avx2")
    with pytest.raises(SystemExit):
        command.main(["--instructions", "avx512"])
    assert "--instructions avx512: not known to be there" in capsys.readouterr().err


def test_the_extra_installs_what_is_compared_with() -> None:
    tomllib = pytest.importorskip("tomllib")
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    extra = tomllib.loads(text)["project"]["optional-dependencies"]["bench"]
    assert {"filterpy", "jax", "numba"} <= {entry.partition(">=")[0] for entry in extra}


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


def test_bits_that_must_be_the_same_and_are_not() -> None:
    def close(size: Size, threads: int) -> Call:
        result = true(size, threads)()
        result[2, 0] = np.nextafter(result[2, 0], np.inf)
        return lambda: result

    base, free = Implementation("ours", true), Implementation("close", close)
    workload = walks(base, free, replace(free, name="own", bits="ours"))
    bench = Bench(workload, 1, quick=True)
    message = "walks: own must have the bits of ours; 1 of 16 numbers have others"
    checked = bench.check()
    assert checked.failed == {"own": message}
    assert checked.distances["close"] > 0.0
    bench.warm("ours")
    bench.warm("close")
    with pytest.raises(Disagreement, match="1 of 16"):
        bench.warm("own")
    assert bench.check(["own", "NumPy"]).failed == {}  # nothing to compare the bits with
    zero = np.zeros((2, 1))
    assert (differing(zero, -zero), differing(zero, zero), differing(zero, zero[:1])) == (2, 0, 2)


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
    done = summary.Measured(WORKLOADS[0])
    ns = {"ours": 2.0, "ours, AVX2": 6.0, "C": 1.0, "C, rounded": 1.6, "C, rounded, AVX2": 4.0}
    for name, value in ns.items():
        done.add(name, 1, [value] + [1.09 * value] * 4, SMALL)
    done.add("ours", 2, [1.1] * 5, SMALL)
    done.add("ours, 2 processes", 2, [1.0, 9.0, 9.0, 9.0, 9.0], SMALL)
    done.missing |= dict.fromkeys(("JAX", "Numba"), "not installed")
    done.told["ours"] = "wheel 3.00 MB"
    assert [line[0] for line in summary.lines(done, 2)] == list(ns)
    ratios = {line[0]: line[3:] for line in summary.lines(done, 2)}
    assert ratios == {
        "ours": ("1.25", ""),
        "ours, AVX2": ("1.5", "3"),  # of C for the same instructions
        "C": ("0.625", "0.5"),
        "C, rounded": ("", "0.8"),
        "C, rounded, AVX2": ("", "2"),
    }
    text = summary.table(done, 2)
    assert "JAX; Numba: not installed" in text
    assert "ours: wheel 3.00 MB" in text
    assert "reach 1 ns together; all cores in one process reach 0.91 of that rate" in text
    assert "noisy: ours, 2 processes on 2 threads" in text
    assert done.rows[0] == summary.Row("lee-mc", "ours", 1, 2.0, 8, 20)
    assert summary.Measured.of(done.stored()) == done


def test_one_thread_is_timed_by_the_processor_and_several_by_the_wall() -> None:
    workload = walks(Implementation("asleep", lambda s, t: lambda: time.sleep(0.02)))
    workload = replace(workload, statistics=lambda _: np.ones((1, 1)))
    for wall in (False, True):
        bench = Bench(workload, 1, quick=True, wall=wall)
        bench.seconds = 0.0
        bench.warm("asleep")
        waited = bench.sample("asleep") * SMALL.runs * SMALL.steps
        assert (waited >= 0.02e9) == wall


def test_a_build_is_done_once_and_tells_its_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[int] = []

    def built() -> build.Built:
        done.append(1)
        return build.Built(3e11, 4_000_000, 12_000_000)

    monkeypatch.setattr(build, "built", functools.cache(built))
    bench = Bench(build.WORKLOAD, 1, quick=True)
    checked = bench.check()
    if checked.missing:
        pytest.skip(str(checked.missing))
    assert checked.told == {"ours": "wheel 4.00 MB, module in it 12.00 MB"}
    bench.warm("ours")
    assert (bench.sample("ours"), len(done)) == (3e11, 1)


def test_processor_time_of_what_was_started_counts() -> None:
    need("resource")
    before = build.spent()
    busy = "import time\nwhile time.process_time() < 0.2: pass"
    code = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {busy!r}])"
    build.run(sys.executable, "-c", code)
    assert build.spent() - before >= 0.2e9
    with pytest.raises(RuntimeError, match="ended with 3"):
        build.run(sys.executable, "-c", "import sys; sys.exit(3)")


def test_a_process_that_ends_is_a_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "executable", "false")
    assert command.main(["--quick", "--out", str(tmp_path), "--workload", "import"]) == 1
    assert "FAILED import: the process ended with 1" in capfd.readouterr().err
