"""What must hold of an observer, whatever it is: every engine against another.

Each function takes what a case made, by name, and raises `Different` where two engines differ or
something else is wrong. A refusal is fine where the other engine refuses too.
"""

from __future__ import annotations

import copy
import ctypes
import itertools
import os
import pickle
import re
import shutil
import subprocess
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import hgo_rs as hgo
from hgo_rs import reference
from hgo_rs.observers import CopiesMetWarning

count: Counter[str] = Counter()
"""Comparisons of numbers, steps of observers, refusals."""

CLOSE = 1e-9
"""Core and twin: the core's step is that of the twin on data that differ by so much, relatively."""

NO_ANGLE = 1e8
"""Beyond about this the core's sine has no value, NumPy's has: own models are not compared."""


class Different(AssertionError):
    """What does not hold."""


def must(holds: object, what: str) -> None:
    if not holds:
        raise Different(what)


def same(a: Any, b: Any, what: str) -> None:
    """Equal numbers, bit for bit but for the sign of 0; NaN where the other is NaN."""
    a, b = np.asarray(a), np.asarray(b)
    must(a.shape == b.shape, f"{what}: shapes {a.shape} and {b.shape}")
    count["comparisons"] += a.size
    if np.array_equal(a, b, equal_nan=a.dtype.kind == "f"):
        return
    unequal = ~((a == b) | ((a != a) & (b != b)))
    place = tuple(int(i[0]) for i in np.nonzero(unequal))
    raise Different(
        f"{what}: {unequal.sum()} of {a.size} differ, first at {place}: {a[place]!r}, {b[place]!r}"
    )


def attempt(call: Callable[[], Any]) -> Any:
    """What a call gives, or its refusal."""
    try:
        return call()
    except hgo.HgoError as error:
        sound(error)
        return error


def refused(made: Any) -> bool:
    return isinstance(made, hgo.HgoError)


SUBJECTS = re.compile(
    r"\b(n|gain|epsilon|poles|k|alpha|beta|saturation|model|method|timing|estimate|memory|memory0|dt|t"
    r"|y|u|x_hat0|r0|until|to|starts|phi|f|g|h|K_T|f1|f2|t_or_dt|correct|observers?|x0)\b"
)
"""What a refusal is about."""


def sound(error: hgo.HgoError) -> None:
    """One line that can be printed and says what it is about."""
    count["refusals"] += 1
    text = str(error)
    must(text and text.isprintable() and len(text) < 2000, f"a message that is no line: {text!r}")
    must(SUBJECTS.search(text), f"a message that names no parameter: {text}")


def undefined_at(error: Any) -> int | None:
    found = re.search(r"has no value at sample (\d+)", str(error)) if refused(error) else None
    return int(found[1]) if found else None


def steps_of(t: Any, samples: int) -> list[float]:
    """The steps after each sample; after the last as before it."""
    if np.ndim(t) == 0:
        return [float(t)] * samples
    steps = np.diff(t).tolist()
    return [*steps, steps[-1] if steps else 1e-3]


def row(u: Any, k: int) -> Any:
    return None if u is None else u[k]


# --- records ------------------------------------------------------------------------------------


def stepped(observer: Any, t: Any, y: Any, u: Any, start: Any, verbs: str) -> tuple[Any, Any]:
    """Memories of a loop over the record as `run` shows them, and the refusal that ended it."""
    online = copy.copy(observer)
    online.reset(memory0=start)
    steps, shown = steps_of(t, len(y)), []
    for k, dt in enumerate(steps):
        count["steps"] += 1
        if observer.timing == "predictor":
            shown.append(online.memory.copy())
            made = attempt(lambda k=k, dt=dt: online.step(y[k], row(u, k), dt=dt))
        elif verbs == "step":
            before = max(k - 1, 0)
            told = row(u, before), steps[before]
            made = attempt(lambda k=k, told=told: online.step(y[k], told[0], dt=told[1]))
            if not refused(made):
                shown.append(online.memory.copy())
        else:
            made = attempt(lambda k=k: online.correct(y[k]))
            if not refused(made):
                shown.append(online.memory.copy())
                if k + 1 < len(y):
                    made = attempt(lambda k=k, dt=dt: online.predict(row(u, k), dt))
        if refused(made):
            return np.array(shown).reshape(-1, len(start)), (k, made)
        must(np.isfinite(online.memory).all(), f"memory after sample {k}: {online.memory}")
        same(made, online.x_hat, "estimate and memory")
    return np.array(shown), None


def loop(observer: Any, t: Any, y: Any, u: Any, start: Any) -> None:
    """`run` has the bits of the loops of `correct` and `predict`, and of `step`."""
    run = attempt(lambda: observer.run(t, y, u, memory0=start))
    for verbs in ("halves", "step") if observer.timing == "current" else ("step",):
        memories, end = stepped(observer, t, y, u, start, verbs)
        if not refused(run):
            must(np.isfinite(run.memory).all(), "run: a memory that is not finite")
            same(memories, run.memory[: len(memories)], f"run and {verbs}")
            if end is not None:  # the bound of `run` is that of its largest sample
                # and with predictor timing the step after the last sample is not its own
                # nor are steps over missing samples judged
                missing = "stab" in str(end[1]) and np.isnan(y).any()
                fine = "diverge" in str(end[1]) or end[0] == len(y) - 1 or missing
                must(fine, f"run goes on, {verbs} refuses sample {end[0]}: {end[1]}")
            continue
        if "diverged" in str(run):  # a step's bound is that of the memory it begins with
            continue
        must(end is not None, f"{verbs} goes on where run refuses: {run}")
        at = undefined_at(run)
        if at is not None and "diverge" not in str(end[1]) and "stab" not in str(end[1]):
            # a step begins with the prediction that `run` counts to the row before
            ends = (at, at + 1) if verbs == "step" and observer.timing == "current" else (at,)
            must(end[0] in ends, f"{verbs} has no value at {end[0]}: {end[1]}; run: {run}")


def chunks(observer: Any, t: Any, y: Any, u: Any, start: Any, order: int) -> None:
    """A record is its parts, each from where the one before ended."""
    if np.ndim(t) == 0:
        t = t * np.arange(len(y))
    whole = attempt(lambda: observer.run(t, y, u, memory0=start))
    if refused(whole):
        return
    rng = np.random.default_rng(order)
    inner = max(len(y) - 1, 0)
    cuts = [0, *sorted(1 + rng.choice(inner, min(3, inner), replace=False)), len(y)]
    memory, parts = start, []
    for first, end in itertools.pairwise(cuts):
        until = t[end] if end < len(y) else None
        part = attempt(
            lambda f=first, e=end, un=until, m=memory: observer.run(
                t[f:e], y[f:e], None if u is None else u[f:e], memory0=m, until=un
            )
        )
        if refused(part):  # the bound of a part is that of its own samples
            must("diverge" in str(part), f"a part from {first} to {end} is refused: {part}")
            return
        parts.append(part)
        memory = part.next_memory
        if memory is not None:
            must(np.isfinite(memory).all(), f"next_memory at {end}: {memory}")
    count["steps"] += 2 * len(y)
    for name in ("memory", "innovation", "missing"):
        joined = np.concatenate([getattr(part, name) for part in parts])
        same(joined, getattr(whole, name), f"{name} of a run and of its parts at {cuts}")


def close(a: Any, b: Any, near: Any, what: str) -> None:
    """|a - b| <= CLOSE |b| + 10 times what data moved by CLOSE/10 make of it."""
    allowed = CLOSE * np.abs(b) + 10.0 * np.max([np.abs(n - b) for n in near], axis=0)
    count["comparisons"] += np.size(a)
    wrong = ~(np.abs(a - b) <= allowed + 1e-300)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise Different(f"{what}[{i}]: core {a[i]!r}, twin {b[i]!r}, allowed {allowed[i]:.3g}")


def twin(observer: Any, t: Any, y: Any, u: Any, start: Any, order: int) -> None:
    """Each step from the core's memory against the NumPy twin, verbs in any order."""
    theirs = reference.Observer(observer.spec)
    rng = np.random.default_rng(order)
    online = copy.copy(observer)
    online.reset(memory0=start)
    current = observer.timing == "current"

    def moved(values: Any) -> Any:
        """Data moved a little."""
        given = np.asarray(values, dtype=float)
        return given * (1.0 + 0.1 * CLOSE * rng.uniform(-1.0, 1.0, given.shape))

    def both(verb: str, k: int, *told: Any) -> bool:
        """Whether the step was taken."""
        before, time = online.memory.copy(), online._time
        if verb == "correct":
            made = attempt(lambda: online.correct(told[0]))
        elif verb == "predict":
            made = attempt(lambda: online.predict(*told))
        else:
            made = attempt(lambda: online.step(told[0], told[1], dt=told[2]))
        act = getattr(theirs, verb)

        def call(memory: Any, *values: Any) -> tuple[Any, int]:
            if verb == "correct":
                return act(memory, values[0], time)
            if verb == "predict":
                return act(memory, values[0], time, values[1])
            return act(memory, values[0], values[1], time, values[2])

        expected, status = call(before, *told)
        count["steps"] += 2
        where = f"{verb} at sample {k}"
        if refused(made):
            sizes = (before, expected, y[np.isfinite(y)])
            largest = max(np.abs(values).max(initial=0.0) for values in sizes)
            absent = status == 2 or not np.isfinite(expected).all()
            agreed = largest > NO_ANGLE or absent or "has no value" not in str(made)
            must(agreed, f"{where}: the twin has {expected.tolist()}, the core: {made}")
            return False
        if status == 2 or not np.isfinite(expected).all():
            told_large = max(np.abs(before).max(), np.abs(online.memory).max()) > 1e50
            must(told_large, f"{where}: the twin has no value, the core {online.memory}")
            return False
        made_own = (observer.spec.get("model") or {}).get("kind") == "own"
        if made_own and max(np.abs(before).max(), np.abs(expected).max()) > NO_ANGLE:
            return False
        near = []
        scale = np.abs(before[:1] if observer.n_y == 1 else before[: observer.n]).max()
        for _ in range(3):
            values = [None if value is None else moved(value) for value in told]
            if verb != "predict":  # a sample of 0 moves as its prediction does
                values[0] = values[0] + scale * (moved(1.0) - 1.0)
            if verb == "predict":
                values[1] = float(values[1])
            if verb == "step":
                values[2] = float(values[2])
            data = moved(before)
            index = observer._gain_index()
            if index is not None:
                data[index] = max(data[index], 1.0)
            near.append(call(data, *values)[0])
        close(online.memory, expected, near, where)
        return True

    for k, dt in enumerate(steps_of(t, len(y))):
        if not current:
            if not both("step", k, y[k], row(u, k), dt):
                return
            continue
        for verb in ("correct", "predict"):
            for _ in range(2 if rng.random() < 0.1 else 1):
                told = (y[k],) if verb == "correct" else (row(u, k), dt)
                if not both(verb, k, *told):
                    return


def innovation(observer: Any, t: Any, y: Any, u: Any, start: Any) -> None:
    """y less its prediction against the twin, which is given the core's memory."""
    run = attempt(lambda: observer.run(t, y, u, memory0=start))
    if refused(run):
        return
    theirs, online = reference.Observer(observer.spec), copy.copy(observer)
    online.allow_unstable = True  # `run` does not judge steps over missing samples
    rng, steps = np.random.default_rng(0), steps_of(t, len(y))
    samples = np.reshape(y, (len(y), -1))
    told = np.reshape(run.innovation, samples.shape)
    absent = np.isnan(samples)
    if observer.spec["kind"] == "reduced-order":  # takes all outputs or none
        absent = np.repeat(absent.any(axis=1, keepdims=True), samples.shape[1], axis=1)
    angles = np.abs(run.memory).max(axis=1, keepdims=True) <= NO_ANGLE
    lacks = np.isnan(told) & ~absent & angles
    must(not lacks.any(), "innovation: NaN where there is a sample")
    for k in range(len(y)):
        before, time = run.memory[k], float(run.time[k])
        if observer.timing == "current" and k:
            online.reset(memory0=run.memory[k - 1])
            online._time = float(run.time[k - 1])
            online.predict(row(u, k - 1), steps[k - 1])
            before = online.memory.copy()
        elif k == 0:
            before = np.asarray(start)
        if np.abs(before).max() > NO_ANGLE:
            return

        def made(memory: Any, sample: Any, time: float = time, k: int = k) -> Any:
            now = None if u is None else np.reshape(row(u, k), (1, -1))
            return theirs.run([time], [sample], now, memory)["innovation"][0]

        expected = made(before, samples[k])
        near = []
        for _ in range(3):
            data = before * (1.0 + 0.1 * CLOSE * rng.uniform(-1.0, 1.0, before.shape))
            data = np.where((before >= 1.0) & (data < 1.0), 1.0, data)
            near.append(made(data, samples[k] * (1.0 + 0.1 * CLOSE * rng.uniform(-1.0, 1.0))))
        there = ~absent[k]
        close(told[k][there], expected[there], [n[there] for n in near], f"innovation at {k}")


def own(observer: Any, other: Any, t: Any, y: Any, u: Any, start: Any) -> None:
    """A model of one's own has the bits of the built-in model with its equations."""
    a, b = (attempt(lambda o=o: o.run(t, y, u, memory0=start)) for o in (observer, other))
    count["steps"] += 2 * len(y)
    if "stab" in str(a) and refused(a):  # of an own sampled-data observer no limit is known
        return
    must(refused(a) == refused(b), f"built-in: {a}; own: {b}")
    if not refused(a):
        same(a.memory, b.memory, "memory of built-in and own")
        same(a.innovation, b.innovation, "innovation of built-in and own")


def copies(observer: Any, t: Any, y: Any, u: Any, start: Any) -> None:
    """An observer that was pickled, copied, or saved and loaded goes on as the original."""
    online = copy.copy(observer)
    online.reset(memory0=start)
    steps = steps_of(t, len(y))

    def go(one: Any, first: int, last: int) -> list[Any]:
        made: list[Any] = []
        for k in range(first, last):
            made.append(attempt(lambda k=k: one.step(y[k], row(u, k), dt=steps[k])))
        return [*(str(m) if refused(m) else m.tolist() for m in made), one.memory.tolist()]

    go(online, 0, len(y) // 2)
    others = {
        "pickled": pickle.loads(pickle.dumps(online)),
        "copied": copy.copy(online),
        "copied deeply": copy.deepcopy(online),
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "observer.toml"
        saved = attempt(lambda: online.save(path))
        must(not refused(saved), f"save: {saved}")
        loaded = attempt(lambda: hgo.load(path).observer())
        must(not refused(loaded), f"load: {loaded}")
    same(loaded.memory, online.memory, "memory saved and loaded")
    loaded._clock, loaded._started = online._clock, online._started  # a file holds no clock
    others["loaded"] = loaded
    for how, other in others.items():
        must(other.spec == online.spec, f"{how}: another spec, {other.spec} for {online.spec}")
    expected = go(online, len(y) // 2, len(y))
    for how, other in others.items():
        made = go(other, len(y) // 2, len(y))
        count["comparisons"] += len(made)
        must(made == expected, f"{how}: {made} for {expected}")
    count["steps"] += 5 * len(y)


def long(observer: Any, t: Any, u: Any, start: Any, samples: int, order: int) -> None:
    """A long record at once and in parts."""
    rng = np.random.default_rng(order)
    dt = t if np.ndim(t) == 0 else float(np.median(steps_of(t, len(t))))
    times = np.cumsum(dt * rng.uniform(0.5, 1.0, samples))
    y = np.sin(times * 0.01 / dt)[:, None] + 1e-3 * rng.normal(size=(samples, observer.n_y)) + 2.0
    y[rng.random(samples) < 0.02] = np.nan
    told = None if u is None else rng.normal(size=(samples, observer.n_u))
    chunks(observer, times, y if observer.n_y > 1 else y[:, 0], told, start, order)


# --- studies ------------------------------------------------------------------------------------


def options(plant: Any, observer: Any, x0: Any, dt: float, steps: int, noise: float) -> Any:
    drawn = hgo.UniformNoise(-noise, noise) if noise else None
    given = {"plant": plant, "observer": observer, "x0": x0, "dt": dt, "steps": steps}
    every = int(np.size(x0) * steps < 10**6)  # frames of short studies only
    return {**given, "noise": drawn, "every": every, "allow_unstable": True}


OUTPUTS = ("mean", "rms", "max", "peak")


def outputs_of(result: Any) -> dict[str, Any]:
    names = ("final_x", "final_memory", "diverged_at", "undefined_at", "x", "memory", "y")
    found = {name: getattr(result, name) for name in names if getattr(result, name) is not None}
    return found | {name: result.metrics[name] for name in OUTPUTS}


def study_of(plant: Any, observer: Any, x0: Any, given: Any, runs: int, seed: int, piece: int,
             executor: Any = None) -> Any:  # fmt: skip
    return hgo.study(
        lambda only: given, grid={"only": [0]}, runs=runs, rng=seed, piece=piece,
        executor=executor, progress=False,
    )[0]  # fmt: skip


def blocks(plant: Any, observer: Any, x0: Any, dt: float, steps: int, runs: int, seed: int,
           noise: float) -> None:  # fmt: skip
    """Runs of a study, one by one, in blocks, in blocks that are cut elsewhere, on one thread."""
    given = options(plant, observer, x0, dt, steps, noise) | {"windows": [(0.0, dt * steps)]}
    made = [
        attempt(lambda p=piece: study_of(plant, observer, x0, given, runs, seed, p))
        for piece in (runs, max(1, runs // 70), max(1, runs // 2))
    ]
    if runs > 32:
        alone = attempt(
            lambda: study_of(plant, observer, x0, given, runs, seed, runs, one_thread())
        )
        made.append(alone)
    count["steps"] += len(made) * runs * steps
    for one in made:
        must(not refused(one), f"a study is refused: {one}")
    first = outputs_of(made[0])
    fine = (made[0].diverged_at < 0) & (made[0].undefined_at < 0)
    must(np.isfinite(first["final_memory"][fine]).all(), "a final memory that is not finite")
    for what, other in zip(("single runs", "halves", "one thread"), made[1:], strict=False):
        for name, value in outputs_of(other).items():
            same(first[name], value, f"{name} of a block and of {what}")


def one_thread() -> Any:
    """An executor of one process with one thread."""
    global _executor
    if _executor is None:
        from concurrent.futures import ProcessPoolExecutor
        from multiprocessing import get_context

        before = os.environ.get("RAYON_NUM_THREADS")
        os.environ["RAYON_NUM_THREADS"] = "1"
        _executor = ProcessPoolExecutor(1, mp_context=get_context("spawn"))
        _executor.submit(int).result()
        os.environ.pop("RAYON_NUM_THREADS")
        if before is not None:
            os.environ["RAYON_NUM_THREADS"] = before
    return _executor


_executor: Any = None


def played_again(plant: Any, observer: Any, x0: Any, dt: float, steps: int, runs: int, seed: int,
                 noise: float) -> None:  # fmt: skip
    """`run` over a simulation's samples has its memories; NumPy its metrics from the frames."""
    runs = min(runs, 70)
    given = options(plant, observer, x0[:runs], dt, steps, noise)
    given |= {"every": 1, "windows": [(0.0, dt * steps)]}
    result = attempt(lambda: hgo.simulate(**given, runs=runs, rng=seed))
    must(not refused(result), f"a simulation is refused: {result}")
    start = observer.initial_memory()
    for i in range(min(runs, 3)):
        if result.diverged_at[i] >= 0 or result.undefined_at[i] >= 0:
            continue
        y = result.y[i, :, 0]
        run = attempt(lambda y=y: observer.run(dt, y, memory0=start, allow_unstable=True))
        must(not refused(run), f"run refuses what a study takes: {run}")
        same(run.memory, result.memory[i], f"memory of run {i} and of the record")
        error = (run.memory[:, : observer.n] - result.x[i])[:-1]
        if np.abs(error).max() < 1e100:
            rms = np.sqrt(np.mean(error**2, axis=0))
            mine = result.rms[i, 0, : observer.n]
            close(mine, rms, [rms, rms + 1e-12 * np.abs(run.memory).max()], f"rms of run {i}")
        count["steps"] += 2 * steps


def twin_study(plant: Any, observer: Any, x0: Any, dt: float, steps: int, seed: int) -> None:
    """A simulation by the core and by NumPy, without noise, as far as its conditioning goes."""
    rng = np.random.default_rng(seed)
    near = x0[:1] * (1.0 + 0.1 * CLOSE * rng.uniform(-1.0, 1.0, (6, x0.shape[1])))
    starts = np.vstack([x0[:1], near])
    given = options(plant, observer, starts, dt, min(steps, 40), 0.0)
    if getattr(plant, "noisy", False) or isinstance(plant, hgo.VanDerPol):
        return
    made = [
        attempt(lambda b=backend: hgo.simulate(**given, runs=len(starts), backend=b))
        for backend in ("rust", "numpy")
    ]
    must(not refused(made[0]), f"a simulation is refused: {made[0]}")
    must(not refused(made[1]), f"a simulation is refused by the twin: {made[1]}")
    core, theirs = made
    count["steps"] += 2 * len(starts) * min(steps, 40)
    same(core.undefined_at, theirs.undefined_at, "undefined_at of core and twin")
    same(core.diverged_at, theirs.diverged_at, "diverged_at of core and twin")
    if (core.diverged_at >= 0).any() or (core.undefined_at >= 0).any():
        return
    for name in ("x", "memory"):
        frames = getattr(theirs, name)
        flat = [getattr(core, name)[0].ravel(), *(frame.ravel() for frame in frames)]
        scale = np.abs(flat[1]).max()
        close(flat[0], flat[1], [*flat[2:], flat[1] + 0.1 * CLOSE * scale], name)


# --- exports and refusals -----------------------------------------------------------------------

FLAGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Wdouble-promotion", "-Werror")


def exported(observer: Any, t: Any, y: Any, u: Any, start: Any) -> None:
    """The exported C has the bits of the verbs; its demonstration says so too."""
    if shutil.which("cc") is None:
        return
    from hgo_rs.exports import sources

    online = copy.copy(observer)
    online.reset(memory0=start)
    # gains that are held are for whole periods: those of this record, if it has any
    period = {float(step) for step in steps_of(t, len(y))}
    given = {"to": "c", "dt": period.pop() if len(period) == 1 else None}
    texts = attempt(lambda: sources(online, **given))
    if refused(texts):
        return
    with tempfile.TemporaryDirectory() as folder:
        for precision in ("double", "single"):
            made = attempt(lambda p=precision: sources(online, precision=p, **given))
            if refused(made):
                continue
            for name, text in made.items():
                (Path(folder) / name).write_text(text)
            built = Path(folder) / "demonstration"
            files = [Path(folder) / "main.c", Path(folder) / "observer.c"]
            call("cc", *FLAGS, "-ffp-contract=off", *files, "-lm", "-o", built)
            must(call(built).rstrip().endswith("OK"), f"the demonstration in {precision} is not OK")
        for name, text in texts.items():
            (Path(folder) / name).write_text(text)
        library = Path(folder) / "observer.so"
        call("cc", *FLAGS, "-shared", "-fPIC", Path(folder) / "observer.c", "-lm", "-o", library)
        _in_c(ctypes.CDLL(str(library)), texts["observer.h"], online, t, y, u)


def call(*command: Any) -> str:
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    must(done.returncode == 0, f"{command[0]}: {done.stdout}{done.stderr}")
    return done.stdout


def _in_c(library: Any, header: str, online: Any, t: Any, y: Any, u: Any) -> None:
    numbers = re.findall(r"^    double \w+;", header, re.MULTILINE)

    class State(ctypes.Structure):
        _fields_ = (("numbers", ctypes.c_double * len(numbers)), ("started", ctypes.c_int))

    state, steps, m = State(), steps_of(t, len(y)), len(online.memory)
    kept = list(range(m))
    if online.spec["kind"] == "reduced-order":  # an own model has room for inputs that it has not
        kept = [*range(online.n + online.n_y + online.n_u), m - 2, m - 1]
    library.observer_init(ctypes.byref(state))
    declared = {
        verb: [word.split()[-1] for word in arguments.split(",")[1:]]
        for verb, arguments in re.findall(r"^int observer_(\w+)\(([^)]*)\)", header, re.MULTILINE)
    }

    def act(verb: str, k: int, dt: float) -> int:
        time = online._time
        words, values = declared[verb], []
        if verb != "predict":
            values += np.ravel(y[k]).tolist()
        if verb != "correct":
            values += [] if online.n_u == 0 else np.ravel(u[k]).tolist()
        must(len(words) - len(values) in (0, 1, 2), f"{verb} takes {words}")
        left = words[len(values) :]
        values += [{"t": time, "dt": dt}["dt" if word == words[-1] and verb != "correct" else "t"]
                   for word in left]  # fmt: skip
        function = getattr(library, f"observer_{verb}")
        return function(ctypes.byref(state), *map(ctypes.c_double, values))

    for k, dt in enumerate(steps):
        verbs = ("correct", "predict") if online.timing == "current" else ("step",)
        for verb in verbs:
            status = act(verb, k, dt)
            if verb == "correct":
                made = attempt(lambda k=k: online.correct(y[k]))
            elif verb == "predict":
                made = attempt(lambda k=k, dt=dt: online.predict(row(u, k), dt))
            else:
                made = attempt(lambda k=k, dt=dt: online.step(y[k], row(u, k), dt=dt))
            count["steps"] += 2
            if refused(made):
                absent = "has no value" in str(made)
                must(not absent or status == 2, f"{verb} at {k}: C says {status}, Python: {made}")
                return
            must(status != 2, f"{verb} at {k}: C has no value, Python {made}")
            if status == 3:  # after more missing samples than gains are held for
                return
            ours = list(state.numbers)[: len(kept)]
            same(ours, online.memory[kept], f"{verb} at sample {k} in C")


def refusal(observer: Any, t: Any, y: Any, u: Any, start: Any, line: str, names: Any) -> None:
    """What is wrong is refused, by name, and leaves the observer as it was."""
    before = observer.memory.copy()
    scope = {"np": np, "observer": observer, "t": t, "y": y, "u": u, "start": start}
    made = attempt(lambda: eval(line, scope))
    must(refused(made), f"{line} is taken: {made!r}")
    named = any(re.search(rf"\b{re.escape(name)}\b", str(made)) for name in names)
    must(named, f"{line}: the message names none of {names}: {made}")
    same(observer.memory, before, "memory after a refusal")


def hushed() -> None:
    """Warnings are errors, but for those that the library means."""
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", CopiesMetWarning)
