"""Studies by executors: the same bits from threads, processes and a cluster, whatever is lost."""

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import psutil
import pytest

from hgo_rs import (
    HgoError,
    Lee,
    NormalNoise,
    RecordedNoise,
    StandardObserver,
    StudyError,
    simulate,
    study,
)
from hgo_rs.simulation.studies import pieces

SPAWN = multiprocessing.get_context("spawn")


def arguments(steps=300, **changes):
    """A study whose `build` no process could be sent."""
    rows = np.random.default_rng(1).normal(size=(50, steps + 1))
    start = np.random.default_rng(2).normal(size=(50, 2))
    noises = {"recorded": RecordedNoise(values=rows), "normal": NormalNoise(std=0.1)}
    return {
        "build": lambda ell, noise: {
            "plant": Lee(),
            "observer": StandardObserver(2, ell, k=[2.0, 2.0]),
            "x0": start,
            "dt": 0.005,
            "steps": steps,
            "noise": noises[noise],
            "windows": [(0.5, 1.0)],
        },
        "grid": {"ell": [20.0, 40.0], "noise": ["recorded", "normal"]},
        "runs": 50,
        "rng": 6,
        "piece": 7,
    } | changes


def same(one, other):
    for a, b in zip(one.outputs, other.outputs, strict=True):
        assert a.keys() == b.keys()
        for key in a:
            np.testing.assert_array_equal(a[key], b[key], err_msg=key)
    np.testing.assert_array_equal(one.finished, other.finished)


@pytest.fixture(scope="module")
def alone():
    result = study(**arguments())
    assert result.complete
    return result


@pytest.fixture(autouse=True)
def many_tasks(monkeypatch):
    """Work that takes milliseconds is cut in many tasks all the same."""
    monkeypatch.setattr(pieces, "_ELSEWHERE", 1e-9)
    monkeypatch.setattr(pieces, "_FIRST", 1)


def test_threads_give_the_same_bits(alone):
    with ThreadPoolExecutor(3) as executor:
        same(study(**arguments(), executor=executor), alone)


def test_processes_give_the_same_bits(alone):
    with ProcessPoolExecutor(2, mp_context=SPAWN) as executor:
        same(study(**arguments(), executor=executor), alone)


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="needs fork")
def test_a_forked_process_is_refused_in_place_of_hanging():
    simulate(Lee(), StandardObserver(2, 5.0), x0=[1.0, 0.0], dt=0.01, steps=9)
    context = multiprocessing.get_context("fork")
    with (
        ProcessPoolExecutor(1, mp_context=context) as executor,
        pytest.raises(HgoError, match="executor: this process was forked"),
    ):
        study(**arguments(), executor=executor)


class Backwards:
    """Does its work at once, and gives the latest result first."""

    def __init__(self):
        self.waiting = []

    def submit(self, function, specs, backend):
        future = Future()
        self.waiting.append((future, function(specs, backend)))
        threading.Timer(0.05, self.give).start()
        return future

    def give(self):
        future, outs = self.waiting.pop()
        future.set_result(outs)


def test_the_order_of_arrival_changes_no_bit(alone):
    same(study(**arguments(), executor=Backwards()), alone)


# --- executors that lose work -------------------------------------------------------------------


class Losing:
    """Does its work at once, but spoils every task the first `times` times, in one of many ways."""

    def __init__(self, how, times):
        self.how, self.times, self.seen = how, times, {}

    def submit(self, function, specs, backend):
        task = tuple((spec["first_run"], spec["observer"]["gain"]["ell"]) for spec in specs)
        task += tuple(spec["noise"]["kind"] for spec in specs)
        self.seen[task] = self.seen.get(task, 0) + 1
        future = Future()
        if self.seen[task] > self.times:
            future.set_result(function(specs, backend))
        elif self.how == "refuses":
            raise RuntimeError("cannot schedule new futures")
        elif self.how == "cancels":
            future.cancel()
            future.set_running_or_notify_cancel()
        elif self.how == "breaks":
            future.set_exception(BrokenProcessPool("a process died"))
        elif self.how == "interrupts":
            future.set_exception(KeyboardInterrupt())
        elif self.how == "gives nothing":
            future.set_result(None)
        else:
            outs, seconds = function(specs, backend)
            if self.how == "gives a run less":
                outs = [{key: value[:-1] for key, value in out.items()} for out in outs]
            elif self.how == "gives a piece less":
                outs = outs[:-1]
            elif self.how == "gives a name less":
                del outs[0]["rms"]
            future.set_result((outs, seconds))
        return future


WAYS = (
    *("refuses", "cancels", "breaks", "interrupts"),
    *("gives nothing", "gives a run less", "gives a piece less", "gives a name less"),
)


@pytest.mark.parametrize("how", WAYS)
def test_lost_work_is_done_again(alone, how):
    executor = Losing(how, times=3)
    same(study(**arguments(), executor=executor), alone)
    assert set(executor.seen.values()) == {4}


@pytest.mark.parametrize("how", WAYS)
def test_work_that_stays_lost_is_named_and_the_rest_kept(alone, how):
    class Partly(Losing):
        """Loses the runs from 14 on of the last case for good."""

        def submit(self, function, specs, backend):
            lost = any(
                spec["first_run"] == 14
                and spec["observer"]["gain"]["ell"] == 40.0
                and spec["noise"]["kind"] == "normal"
                for spec in specs
            )
            self.times = 10**9 if lost else 0
            return super().submit(function, specs, backend)

    with pytest.raises(StudyError) as stopped:
        study(**arguments(), executor=Partly(how, 0))
    told = str(stopped.value)
    assert "runs 14 to 20 of case 3 (ell = 40.0, noise = normal)" in told
    assert "lost work 4 times" in told
    result = stopped.value.result
    assert result.finished[:3].all()
    assert not result.finished[3, 14:21].any()
    assert f"{result.finished.sum()} of 200 runs are finished" in told
    for i in range(3):
        np.testing.assert_array_equal(result[i].rms, alone[i].rms)
    np.testing.assert_array_equal(result[3].rms[:14], alone[3].rms[:14])


@pytest.mark.skipif(os.name == "nt", reason="SIGKILL")
def test_a_broken_pool_ends_the_study_and_the_next_one_continues(alone, tmp_path):
    pytest.importorskip("pyarrow")
    path, pool = tmp_path / "study.parquet", ProcessPoolExecutor(2, mp_context=SPAWN)

    def kill(progress):
        for pid in list(pool._processes or ()):
            with contextlib.suppress(ProcessLookupError):  # it has ended
                os.kill(pid, signal.SIGKILL)

    with pytest.raises(StudyError, match="BrokenProcessPool") as stopped:
        study(**arguments(), executor=pool, save=path, progress=kill)
    kept = stopped.value.result
    assert 0 < kept.finished.sum() < 200
    for i in range(4):
        np.testing.assert_array_equal(kept[i].rms[kept.finished[i]], alone[i].rms[kept.finished[i]])
    pool.shutdown()
    seen = []
    with ProcessPoolExecutor(2, mp_context=SPAWN) as again:
        same(study(**arguments(), executor=again, save=path, progress=seen.append), alone)
    assert len(seen) < 32  # 4 cases of 8 pieces: those that were there are not computed again


def test_an_interrupt_cancels_what_waits(alone):
    release, seen = threading.Event(), []

    class Slow(ThreadPoolExecutor):
        def submit(self, function, *given):
            number = len(seen)
            future = super().submit(lambda: (number < 2 or release.wait(20)) and function(*given))
            seen.append(future)
            return future

    def stop(progress):
        raise KeyboardInterrupt

    with Slow(1) as executor:
        with pytest.raises(KeyboardInterrupt) as stopped:
            study(**arguments(), executor=executor, progress=stop)
        assert sum(future.cancelled() for future in seen) >= len(seen) - 3
        release.set()
    result = stopped.value.result
    assert result.finished.sum() in (7, 14)
    np.testing.assert_array_equal(result[0].rms[:7], alone[0].rms[:7])


# --- a cluster ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=3, threads_per_worker=1, processes=True, dashboard_address=None
    ) as made:
        yield made


@pytest.fixture
def client(cluster):
    from distributed import Client

    with Client(cluster) as made:
        made.wait_for_workers(3, timeout=60)
        yield made


@pytest.mark.parametrize("form", ["client", "executor"])
def test_a_cluster_gives_the_same_bits(alone, client, form):
    executor = client if form == "client" else client.get_executor()
    same(study(**arguments(), executor=executor), alone)


@pytest.mark.skipif(os.name == "nt" or sys.platform == "darwin", reason="SIGKILL and slow start")
def test_a_worker_killed_in_mid_study_loses_nothing(client, tmp_path):
    pytest.importorskip("pyarrow")
    longer = arguments(steps=100_000, save=tmp_path / "study.parquet")
    pids = list(client.run(os.getpid).values())
    assert len(set(pids)) == 3
    assert os.getpid() not in pids
    seen = []

    def kill(progress):
        seen.append(progress.done)
        if len(seen) == 2:
            os.kill(pids[0], signal.SIGKILL)

    result = study(**longer, executor=client, progress=kill)
    assert len(seen) == 32  # every piece came once, and the killing was in between
    assert result.complete
    deadline = time.monotonic() + 60.0
    while pids[0] in client.run(os.getpid).values() and time.monotonic() < deadline:
        time.sleep(0.1)
    assert pids[0] not in client.run(os.getpid).values()
    same(result, study(**arguments(steps=100_000)))


# --- a process that is killed -------------------------------------------------------------------

STUDY = """
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
import hgo_rs as hgo

def build(ell):
    return dict(plant=hgo.Lee(), observer=hgo.StandardObserver(2, ell, k=[2.0, 2.0]),
                x0=[1.0, 0.0], dt=1e-3, steps=10**6, noise=hgo.NormalNoise(std=0.01))

def told(progress):
    print("working", flush=True)

if __name__ == "__main__":
    with ProcessPoolExecutor(3, mp_context=multiprocessing.get_context("spawn")) as executor:
        hgo.study(build, grid=dict(ell=[20.0, 50.0]), runs=10**5, executor=executor, progress=told)
"""
SCENARIOS = """
import sys
from hgo_rs import scenarios
from hgo_rs.cli import reproduce

if __name__ == "__main__":
    run = reproduce.run(list(scenarios.load().values()), jobs=2, figures=False,
                        on_start=lambda id: print("working", flush=True))
    for record in run:
        pass
"""


@pytest.mark.skipif(os.name == "nt", reason="signals")
@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("script", [STUDY, SCENARIOS], ids=["study", "scenarios"])
def test_a_killed_process_leaves_no_workers(tmp_path, script, end):
    path = tmp_path / "script.py"
    path.write_text(script)
    process = subprocess.Popen([sys.executable, path], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "working\n"
        workers = psutil.Process(process.pid).children(recursive=True)
        assert len(workers) >= 2
        process.send_signal(end)
        assert process.wait(30) == -end
        _, left = psutil.wait_procs(workers, timeout=30)
    finally:
        process.kill()
        process.stdout.close()
    for worker in left:
        worker.kill()
    assert not left
