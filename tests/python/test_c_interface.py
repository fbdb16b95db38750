"""The C library: the bits of the compiled core, the refusals, the header, the example's page."""

from __future__ import annotations

import contextlib
import ctypes
import io
import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "firmware" / "c"))

import example
import header
import toolchain

from hgo_rs import (
    AdaptiveGain,
    DeadZoneGain,
    InputGain,
    LowPowerObserver,
    PeakingFreeObserver,
    StandardObserver,
)
from hgo_rs.observers import Observer

ROOT = Path(__file__).parents[2]
C = ROOT / "firmware" / "c"
PAGE = ROOT / "docs" / "from-python-to-your-board.md"
DRIVER = Path(__file__).with_name("c_interface_driver.c")
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="written for GNU's linker")

INTERFACE = header.read()
CODES = {name: value for name, value, _ in INTERFACE.codes}
OBSERVERS = {observer.name: observer for observer in INTERFACE.observers}
FAMILIES = {"standard", "adaptive", "dead_zone", "low_power", "peaking_free"}
GUARD = 64


@pytest.fixture(scope="session")
def archive() -> Path:
    return example.library()


@pytest.fixture(scope="session")
def driver(archive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return example.compiled(tmp_path_factory.mktemp("c") / "driver", archive, DRIVER)


@pytest.fixture(scope="session")
def shared(archive: Path, tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The whole archive as a library that Python calls."""
    out = tmp_path_factory.mktemp("c") / "libhgo.so"
    whole = ["-Wl,--whole-archive", str(archive), "-Wl,--no-whole-archive"]
    # what cannot be reached is not missed: no panic handler is left
    example.execute([compiler(), "-shared", "-Wl,--gc-sections", "-Wl,-z,defs", *whole, "-o", out])
    return ctypes.CDLL(str(out))


def compiler() -> str:
    return os.environ.get("CC", "cc")


# --- the bits -------------------------------------------------------------------------------------


def python_observer(name: str, timing: str = "predictor") -> tuple[Observer, list[float]]:
    """The observer of a C type in Python, with phi as its input, and its C configuration."""
    family, n = name[:-5], int(name[-5])
    known: dict[str, Any] = {"model": InputGain(1.0), "allow_unstable": True}
    known |= {"method": "euler", "timing": timing}
    if family in ("low_power", "peaking_free"):
        more: dict[str, Any] = {} if family == "low_power" else {"saturation": [0.5] * (n - 1)}
        law = LowPowerObserver if family == "low_power" else PeakingFreeObserver
        observer: Observer = law(n, 3.7, **known, **more)
        spec = observer.spec
        levels = [] if family == "low_power" else [padded(spec["saturation"], 4)]
        arrays = [padded(spec["alpha"], 5), padded(spec["beta"], 4), *levels]
        return observer, [*np.concatenate(arrays), spec["gain"]["ell"]]
    gain: Any = {"standard": 3.7, "adaptive": AdaptiveGain, "dead_zone": DeadZoneGain}[family]
    moving = {"p1": 0.05, "p2": 0.5, "b": 0.2}
    observer = StandardObserver(n, gain if family == "standard" else gain(**moving), **known)
    fixed = [gain] if family == "standard" else list(moving.values())
    return observer, [*padded(observer.spec["k"], 5), *fixed]


def padded(values: list[float], length: int) -> list[float]:
    return [*values, *[0.0] * (length - len(values))]


STEP, CORRECT, PREDICT = 0.0, 1.0, 2.0


def calls(rng: np.random.Generator, count: int, dt_max: float) -> np.ndarray:
    """Rows (y, phi, dt): mostly sound, some of everything that goes wrong."""
    y, phi = rng.standard_normal(count), rng.standard_normal(count)
    dt = dt_max * rng.uniform(0.01, 0.2, count)
    bad = [math.nan, math.inf, -math.inf]
    y[rng.random(count) < 0.1] = rng.choice(bad)
    phi[rng.random(count) < 0.02] = rng.choice(bad)
    wrong = rng.random(count) < 0.05
    dt[wrong] = rng.choice([*bad, 0.0, -0.0, -dt_max, 1.5 * dt_max], wrong.sum())
    return np.column_stack([y, phi, dt])


def steps(rows: np.ndarray) -> np.ndarray:
    """Each row as a call of step."""
    return np.column_stack([np.full(len(rows), STEP), rows])


def halves(rng: np.random.Generator, rows: np.ndarray) -> np.ndarray:
    """Each row as a call of correct and one of predict; some halves are left out or made twice."""
    y, phi, dt = np.repeat(rows, 2, axis=0).T
    kind = np.tile([CORRECT, PREDICT], len(rows))
    return np.column_stack([kind, y, phi, dt])[rng.random(2 * len(rows)) < 0.95]


def expected(name: str, rows: np.ndarray, dt_max: float) -> np.ndarray:
    """Rows (status, memory) by the compiled core alone."""
    law, causal = (python_observer(name, timing)[0] for timing in ("predictor", "current"))
    moves = law.spec["gain"]["law"] != "constant"
    out, time, in_time = [], 0.0, True
    memory = causal.memory
    for call, y, phi, dt in rows:
        before, no_time = memory, not (dt > 0.0 and math.isfinite(dt))
        if call != CORRECT and no_time:
            out.append([CODES["STEP_REFUSED"], *memory])
            continue
        if call != CORRECT:
            r = float(law.gains(memory[:-1])) if moves else 1.0
            in_time = dt * r <= dt_max
        held = before if call == CORRECT else [*before[:-1], 0.0 if call == STEP else dt]
        sample = [y if in_time else math.nan]
        if call == CORRECT:
            memory, status = causal._core.correct(before, sample, time)
        elif not math.isfinite(phi):
            memory, status = np.array(held), CODES["MODEL_UNDEFINED"]
        elif call == STEP:
            moved, status = law._core.step(before[:-1], sample, [phi], time, dt)
            memory = np.array([*moved, 0.0])
        else:
            memory, status = causal._core.advance(before, [math.nan], [phi], time, dt)
        if not np.isfinite(memory).all():
            diverged = not np.abs(before).max() <= 1e12
            status = CODES["DIVERGED" if diverged else "MODEL_UNDEFINED"]
            memory = memory if diverged else np.array(held)
        elif status != CODES["MODEL_UNDEFINED"] and not in_time:
            status = CODES["STEP_TOO_LONG"]
        time += 0.0 if call == CORRECT else dt
        out.append([status, *memory])
    return np.array(out)


def through_c(driver: Path, name: str, config: list[float], rows: np.ndarray) -> tuple[Any, Any]:
    """The two step limits, and rows (status, memory)."""
    given = np.array(config).tobytes() + rows.tobytes()
    done = subprocess.run([driver, name], input=given, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    numbers = np.frombuffer(done.stdout)
    return numbers[:2], numbers[2:].reshape(len(rows), 1 + OBSERVERS[name].memory)


IN_DOUBLE = [name for name in OBSERVERS if name.endswith("f64")]


@pytest.mark.parametrize("name", IN_DOUBLE)
def test_the_limits_are_pythons(driver: Path, name: str) -> None:
    config = python_observer(name)[1]
    found, _ = through_c(driver, name, [*config, 0.0], np.empty((0, 4)))
    wanted = [python_observer(name, when)[0].step_limit().dt for when in ("predictor", "current")]
    assert found == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize("name", IN_DOUBLE)
def test_the_bits_are_those_of_the_core(driver: Path, name: str) -> None:
    config, rng = python_observer(name)[1], np.random.default_rng(int(name[-5]))
    limits, _ = through_c(driver, name, [*config, 0.0], np.empty((0, 4)))
    dt_max = 0.9 * float(limits.min())
    small = [0.5, 0.5, 1.0]  # a gain that moves stays where most steps are within its limit
    mixed = np.vstack([steps(calls(rng, 20, dt_max)), halves(rng, small * calls(rng, 20, dt_max))])
    for rows in (
        steps(calls(rng, 2000, dt_max)),
        halves(rng, small * calls(rng, 2000, dt_max)),
        np.vstack([mixed] * 20),
    ):
        _, found = through_c(driver, name, [*config, dt_max], rows)
        wanted = expected(name, rows, dt_max)
        assert np.array_equal(found[:, 0], wanted[:, 0])
        assert found.tobytes() == wanted.tobytes()
        assert set(found[:, 0]) <= {0.0, 1.0, 2.0, 3.0, 4.0}  # no divergence
        if len(rows) >= 2000:
            assert len(set(found[:, 0])) == 5


def test_a_correction_is_for_the_last_period_and_is_made_once(driver: Path) -> None:
    """By hand, for k = (3, 2), gain l = 4: x + c (k_1 l e, k_2 l^2 e), c the period before."""
    dt, e = 0.125, 2.0
    rows = [
        (CORRECT, 1.0, 0.0, 0.0),  # no time has passed
        (PREDICT, 0.0, 8.0, dt),
        (CORRECT, math.nan, 0.0, 0.0),
        (CORRECT, e, 0.0, 0.0),
        (CORRECT, 77.0, 0.0, 0.0),  # its period has been used
        (PREDICT, 0.0, math.nan, dt),  # held, and time passes
        (STEP, e, math.nan, dt),  # held, and the period is the step's
    ]
    _, found = through_c(driver, "standard2_f64", [3.0, 2.0, 0, 0, 0, 4.0, 0.4], np.array(rows))
    corrected = [0.125 * 12.0 * e, 1.0 + 0.125 * 32.0 * e]
    wanted = [
        [CODES["UPDATED"], 0.0, 0.0, 0.0],
        [CODES["PREDICTED"], 0.0, 1.0, dt],
        [CODES["PREDICTED"], 0.0, 1.0, dt],
        [CODES["UPDATED"], *corrected, 0.0],
        [CODES["UPDATED"], *corrected, 0.0],
        [CODES["MODEL_UNDEFINED"], *corrected, dt],
        [CODES["MODEL_UNDEFINED"], *corrected, 0.0],
    ]
    assert found.tolist() == wanted


def test_divergence_is_told(driver: Path) -> None:
    _, config = python_observer("standard2_f64")
    rows = np.array([[STEP, 1.7e308, 0.0, 0.2]])
    _, found = through_c(driver, "standard2_f64", [*config, 0.2], rows)
    assert found.tolist() == [
        [CODES["MODEL_UNDEFINED"], 0.0, 0.0, 0.0]
    ]  # of one sample: it is held
    rows = np.array([[STEP, y, 0.0, 0.2] for y in (1e300, -1.7e308, 0.0)])
    _, found = through_c(driver, "standard2_f64", [*config, 0.2], rows)
    assert found[:, 0].tolist() == [CODES["UPDATED"], CODES["DIVERGED"], CODES["DIVERGED"]]


# --- a closed loop --------------------------------------------------------------------------------

LOOPS = [f"{family}2_f64" for family in sorted(FAMILIES)]


def controlled(x_hat: np.ndarray, k: int) -> float:
    wanted = 0.3 if k % 200 < 100 else -0.3
    return float(-400.0 * (x_hat[0] - wanted) - 40.0 * x_hat[1])


def phi_of(x_hat: np.ndarray, u: float) -> float:
    return float(u - 0.5 * x_hat[1] - 9.81 * math.sin(x_hat[0]))


def loop(observer: Observer, dt: float, count: int) -> np.ndarray:
    """Rows (q, w, memory) of a pendulum under a stiff controller, as in c_interface_driver.c."""
    q, w, u, rows = 1.0, 0.0, 0.0, []
    for k in range(count):
        if observer.timing == "current":
            observer.correct(q)
            rows.append([q, w, *observer.memory])
            u = controlled(observer.x_hat, k)
            observer.predict(phi_of(observer.x_hat, u), dt=dt)
        else:  # the input of the period is not known yet: that of the one before
            rows.append([q, w, *observer.memory])
            observer.step(q, phi_of(observer.x_hat, u), dt=dt)
            u = controlled(observer.x_hat, k)
        for _ in range(10):
            w += dt / 10.0 * (u - 0.5 * w - 9.81 * math.sin(q))
            q += dt / 10.0 * w
    return np.array(rows)


def looping(name: str, timing: str) -> tuple[Observer, list[float]]:
    """An observer that is fast enough for the loop, and its C configuration."""
    more: dict[str, Any] = {"model": InputGain(1.0), "method": "euler", "timing": timing}
    family = name[:-5]
    if family in ("low_power", "peaking_free"):
        levels = [] if family == "low_power" else [30.0]
        law = LowPowerObserver if family == "low_power" else PeakingFreeObserver
        observer: Observer = law(2, 20.0, **more, **({"saturation": levels} if levels else {}))
        arrays = [padded(observer.spec["alpha"], 5), padded(observer.spec["beta"], 4)]
        arrays += [padded(levels, 4)] if levels else []
        return observer, [*np.concatenate(arrays), 20.0]
    moving = {"p1": 2000.0, "p2": 1e-4, "b": 0.2}
    gain: Any = 20.0
    if family != "standard":
        gain = {"adaptive": AdaptiveGain, "dead_zone": DeadZoneGain}[family](**moving)
    observer = StandardObserver(2, gain, **more)
    fixed = [20.0] if family == "standard" else list(moving.values())
    return observer, [*padded(observer.spec["k"], 5), *fixed]


@pytest.mark.parametrize(
    ("name", "dt"),
    [(name, 0.001) for name in LOOPS]
    + [(name, 0.01) for name in LOOPS if name.startswith(("standard", "low", "peak"))],
)
def test_a_loop_in_c_has_the_bits_of_pythons(driver: Path, name: str, dt: float) -> None:
    observer, config = looping(name, "current")
    given = np.array([*config, observer.step_limit().dt, dt, 1000.0]).tobytes()
    done = subprocess.run([driver, name, "loop"], input=given, capture_output=True, check=False)
    assert done.returncode == 0, (done.returncode, done.stderr)
    found = np.frombuffer(done.stdout).reshape(1000, -1)
    assert found.tobytes() == loop(observer, dt, 1000).tobytes()


def test_a_causal_loop_is_better_than_the_recursion() -> None:
    """What correct and predict are for: the recursion is told the input one period late."""
    causal, late = (
        loop(looping("standard2_f64", timing)[0], 0.01, 1000)[200:]
        for timing in ("current", "predictor")
    )
    errors = [np.sqrt(np.mean((rows[:, 3] - rows[:, 1]) ** 2)) for rows in (causal, late)]
    assert errors[0] < 0.25 * errors[1]


# --- the refusals ---------------------------------------------------------------------------------


class Room:
    """Memory of a C type, at an address of our choice, between guards that nobody may touch."""

    def __init__(self, size: int, shift: int = 0, fill: bytes = b"\0") -> None:
        self.buffer = ctypes.create_string_buffer(size + 2 * GUARD + 8)
        start = -ctypes.addressof(self.buffer) % 8
        self.slice = slice(start + GUARD + shift, start + GUARD + shift + size)
        self.bytes = fill * size
        self.address = ctypes.addressof(self.buffer) + self.slice.start
        self.outside = self._outside()

    @property
    def bytes(self) -> bytes:
        return self.buffer.raw[self.slice]

    @bytes.setter
    def bytes(self, value: bytes) -> None:
        self.buffer[self.slice] = value

    def _outside(self) -> bytes:
        raw = self.buffer.raw
        return raw[: self.slice.start] + raw[self.slice.stop :]

    def untouched_outside(self) -> bool:
        return self._outside() == self.outside


class Subject:
    """One C type: its functions, with addresses for pointers, and sound arguments for them."""

    def __init__(self, shared: ctypes.CDLL, name: str) -> None:
        self.shared, self.name, self.row = shared, name, OBSERVERS[name]
        self.dtype: Any = {"f32": np.float32, "f64": np.float64}[self.row.scalar]
        self.real: Any = {"f32": ctypes.c_float, "f64": ctypes.c_double}[self.row.scalar]
        self.width = np.dtype(self.dtype).itemsize
        numbers = python_observer(name[:-3] + "f64")[1]
        self.config = np.array([*numbers, 0.01], self.dtype)
        self.fields = next(s for s in INTERFACE.structs if s.name == self.row.config).fields

    def call(self, method: str, *arguments: Any) -> int:
        return int(self.shared[f"hgo_{self.name}_{method}"](*arguments))

    def init(
        self,
        state: int,
        size: int | None = None,
        version: int | None = None,
        config: int | np.ndarray | None = None,
        error: int = 0,
    ) -> int:
        numbers = self.config if config is None else config
        where = numbers if isinstance(numbers, int) else numbers.ctypes.data
        return self.call(
            "init",
            ctypes.c_void_p(state),
            ctypes.c_size_t(self.row.size if size is None else size),
            ctypes.c_uint32(INTERFACE.version if version is None else version),
            ctypes.c_void_p(where),
            ctypes.c_void_p(error),
        )

    def step(self, state: int, y: float = 1.0, phi: float = 0.0, dt: float = 0.005) -> int:
        return self.call("step", ctypes.c_void_p(state), *map(self.real, (y, phi, dt)))

    def correct(self, state: int, y: float = 1.0) -> int:
        return self.call("correct", ctypes.c_void_p(state), self.real(y))

    def predict(self, state: int, phi: float = 0.0, dt: float = 0.005) -> int:
        return self.call("predict", ctypes.c_void_p(state), *map(self.real, (phi, dt)))

    def numbers(self, method: str, state: int, numbers: int, n: int) -> int:
        """estimate or restart."""
        pointers = ctypes.c_void_p(state), ctypes.c_void_p(numbers)
        return self.call(method, *pointers, ctypes.c_size_t(n))

    def counts(self, state: int, counts: int) -> int:
        return self.call("counts", ctypes.c_void_p(state), ctypes.c_void_p(counts))

    def limit(self, of: str, config: int, dt_max: int, error: int = 0) -> int:
        return self.call(f"{of}_limit", *map(ctypes.c_void_p, (config, dt_max, error)))

    def state(self) -> Room:
        """A state after two steps and half of another."""
        room = Room(self.row.size)
        assert self.init(room.address) == CODES["UPDATED"]
        assert self.step(room.address) == CODES["UPDATED"]
        assert self.step(room.address, y=math.nan) == CODES["PREDICTED"]
        assert self.predict(room.address) == CODES["PREDICTED"]
        return room

    def memory(self, state: Room) -> np.ndarray:
        out = np.zeros(self.row.memory, self.dtype)
        done = self.numbers("estimate", state.address, out.ctypes.data, self.row.memory)
        assert done == CODES["UPDATED"]
        return out


@pytest.fixture(params=list(OBSERVERS))
def subject(request: pytest.FixtureRequest, shared: ctypes.CDLL) -> Subject:
    return Subject(shared, request.param)


def test_init_refuses_what_cannot_be_a_state(subject: Subject) -> None:
    size = subject.row.size
    room = Room(size + 8, fill=b"\x5a")
    before, config = room.bytes, subject.config
    error = Room(144)
    refused = {
        "NULL_POINTER": [{"state": 0}, {"config": 0}],
        "UNALIGNED": [
            {"state": room.address + 1},
            {"state": room.address + 2},
            {"config": config.ctypes.data + 1},
            {"error": error.address + 1},
            {"error": error.address + 4},
        ],
        "STATE_TOO_SMALL": [{"size": size - 1}, {"size": 0}],
        "WRONG_VERSION": [{"version": INTERFACE.version + 1}, {"version": 0}],
    }
    if subject.width == 8:
        refused["UNALIGNED"] += [{"state": room.address + 4}]
        refused["UNALIGNED"] += [{"config": config.ctypes.data + 4}]
    for code, cases in refused.items():
        for case in cases:
            assert subject.init(**{"state": room.address, **case}) == CODES[code], (code, case)
            assert room.bytes == before
    assert subject.init(room.address, size=size + 8) == CODES["UPDATED"]
    assert room.bytes[size:] == before[size:]
    if subject.width == 4:
        assert subject.init(room.address + 4) == CODES["UPDATED"]
    assert room.untouched_outside() and error.untouched_outside()


def test_init_says_which_parameter_and_why(subject: Subject) -> None:
    state, error = subject.state(), Room(136)
    before, place, order = state.bytes, 0, subject.row.order
    for field, kind, _ in subject.fields:
        length = int(kind[4:-1]) if kind.startswith("[") else 1
        for i in range(length):
            used = length == 1 or i < (order if length == 5 else order - 1)
            bad = [math.nan, math.inf, -math.inf, -1.0, 0.0] if used else [math.nan, 1.0]
            for value in bad:
                config = subject.config.copy()
                config[place + i] = value
                status = subject.init(state.address, config=config, error=error.address)
                assert status == CODES["BAD_PARAMETER"], (field, i, value)
                assert subject.init(state.address, config=config) == status
                parameter, allowed = (error.bytes[a:b] for a, b in ((0, 16), (16, 128)))
                # a beta that makes the law unstable is told as alpha: both make one polynomial
                named = parameter.split(b"\0")[0].decode()
                assert named in ((field, "alpha") if field == "beta" else (field,))
                assert re.fullmatch(rb"[ -~]{10,}\0+", allowed), allowed
                told = np.frombuffer(error.bytes[128:])[0]
                if length == 1 or math.isnan(value):
                    assert np.array_equal(told, subject.dtype(value), equal_nan=True)
                assert state.bytes == before
        place += length
    assert place == len(subject.config)
    assert state.untouched_outside() and error.untouched_outside()


@pytest.mark.parametrize(("of", "timing"), [("step", "predictor"), ("predict", "current")])
def test_the_limits(subject: Subject, of: str, timing: str) -> None:
    limit, config, error = Room(subject.width), subject.config, Room(136)
    where = config.ctypes.data
    assert subject.limit(of, where, limit.address) == CODES["UPDATED"]
    dt_max = np.frombuffer(limit.bytes, subject.dtype)[0]
    wanted = python_observer(subject.name[:-3] + "f64", timing)[0].step_limit().dt
    assert dt_max == pytest.approx(wanted, rel=1e-4)
    before = limit.bytes
    for arguments, code in [
        ((0, limit.address), "NULL_POINTER"),
        ((where, 0), "NULL_POINTER"),
        ((where + 1, limit.address), "UNALIGNED"),
        ((where, limit.address + 1), "UNALIGNED"),
        ((where, limit.address, error.address + 1), "UNALIGNED"),
    ]:
        assert subject.limit(of, *arguments) == CODES[code]
    unstable = config.copy()
    unstable[0] = -1.0
    status = subject.limit(of, unstable.ctypes.data, limit.address, error.address)
    assert status == CODES["BAD_PARAMETER"]
    assert error.bytes.startswith((b"k\0", b"alpha\0"))
    assert limit.bytes == before and limit.untouched_outside()


def test_what_is_no_state_is_refused_everywhere(subject: Subject, shared: ctypes.CDLL) -> None:
    size, memory = subject.row.size, subject.row.memory
    out, counts = Room(memory * subject.width), Room(24)
    start = np.ones(memory, subject.dtype)
    good = subject.state()
    others = [name for name in OBSERVERS if name != subject.name]
    index = list(OBSERVERS).index(subject.name)
    other = Subject(shared, others[index % len(others)]).state()
    noise = np.random.default_rng(1).bytes(size)
    rooms = [(0, "NULL_POINTER"), (good.address + 1, "UNALIGNED")]
    made = [Room(size), Room(size, fill=b"\xff"), Room(size), other]
    made[2].bytes = noise
    if subject.width == 8:
        rooms += [(good.address + 4, "UNALIGNED")]
    if other.slice.stop - other.slice.start < size:
        made.pop()
    rooms += [(room.address, "NOT_INITIALISED") for room in made]
    before = [room.bytes for room in (good, out, counts, *made)]
    for state, code in rooms:
        assert subject.step(state) == CODES[code]
        assert subject.correct(state) == CODES[code]
        assert subject.predict(state) == CODES[code]
        assert subject.numbers("estimate", state, out.address, memory) == CODES[code]
        assert subject.numbers("restart", state, start.ctypes.data, memory) == CODES[code]
        assert subject.counts(state, counts.address) == CODES[code]
    assert [room.bytes for room in (good, out, counts, *made)] == before


def test_every_other_type_is_told_apart(shared: ctypes.CDLL) -> None:
    subjects = [Subject(shared, name) for name in OBSERVERS]
    largest = max(OBSERVERS.values(), key=lambda row: row.size).size
    for maker in subjects:
        room = Room(largest)
        assert maker.init(room.address) == CODES["UPDATED"]
        for user in subjects:
            status = CODES["UPDATED" if user is maker else "NOT_INITIALISED"]
            assert user.step(room.address) == status, (maker.name, user.name)
            status = CODES["PREDICTED"] if user is maker else status
            assert user.predict(room.address) == status, (maker.name, user.name)


def test_buffers(subject: Subject) -> None:
    state, order, memory = subject.state(), subject.row.order, subject.row.memory
    whole = subject.memory(state)
    before = state.bytes
    for n in (0, order - 1, memory + 1, 2**31, 2**63):
        out = Room(memory * subject.width, fill=b"\x11")
        assert subject.numbers("estimate", state.address, out.address, n) == CODES["BUFFER_LENGTH"]
        assert subject.numbers("restart", state.address, out.address, n) == CODES["BUFFER_LENGTH"]
        assert out.bytes == b"\x11" * len(out.bytes)
    for n in range(order, memory + 1):
        out = Room(n * subject.width)
        assert subject.numbers("estimate", state.address, out.address, n) == CODES["UPDATED"]
        assert out.bytes == whole[:n].tobytes() and out.untouched_outside()
    for method in ("estimate", "restart"):
        assert subject.numbers(method, state.address, 0, order) == CODES["NULL_POINTER"]
        out = Room(memory * subject.width)
        unaligned = subject.numbers(method, state.address, out.address + 1, order)
        assert unaligned == CODES["UNALIGNED"]
    counts = Room(24)
    assert subject.counts(state.address, 0) == CODES["NULL_POINTER"]
    assert subject.counts(state.address, counts.address + 1) == CODES["UNALIGNED"]
    assert state.bytes == before and state.untouched_outside()


def test_restart(subject: Subject) -> None:
    state, order, memory = subject.state(), subject.row.order, subject.row.memory
    moves = subject.row.family in ("adaptive", "dead_zone")

    def restart(numbers: np.ndarray) -> int:
        where = numbers.ctypes.data
        return subject.numbers("restart", state.address, where, len(numbers))

    for bad in (math.nan, math.inf):
        for i in range(order):
            numbers = np.ones(order, subject.dtype)
            numbers[i] = bad
            before = state.bytes
            assert restart(numbers) == CODES["BAD_PARAMETER"] and state.bytes == before
    start = np.arange(1, order + 1, dtype=subject.dtype)
    assert restart(start) == CODES["UPDATED"]
    rest = np.zeros(memory - order, subject.dtype)
    if moves:
        rest[0] = 1.0
    assert np.array_equal(subject.memory(state), [*start, *rest])
    # a whole memory: the state goes on where another one stood
    other = subject.state()
    for k in range(20):
        subject.step(other.address, y=float(k))
    subject.predict(other.address)
    assert restart(subject.memory(other)) == CODES["UPDATED"]
    for k in range(20):
        assert subject.correct(state.address, y=k) == subject.correct(other.address, y=k)
        assert subject.predict(state.address, phi=k) == subject.predict(other.address, phi=k)
        assert subject.step(state.address, y=0.5 * k) == subject.step(other.address, y=0.5 * k)
    assert np.array_equal(subject.memory(state), subject.memory(other))
    for place, bad in [(-1, -0.005), *([(order, 0.5)] if moves else [])]:
        numbers = np.ones(memory, subject.dtype)
        numbers[place] = bad
        assert restart(numbers) == CODES["BAD_PARAMETER"]


def test_counts_and_codes_of_steps(subject: Subject) -> None:
    state, counts = Room(subject.row.size), Room(24)
    assert subject.init(state.address) == CODES["UPDATED"]
    huge = float(np.finfo(subject.dtype).max)
    taken = [
        ("step", {}, "UPDATED"),
        ("step", {"y": math.nan}, "PREDICTED"),
        ("step", {"y": math.inf}, "PREDICTED"),
        ("step", {"phi": math.nan}, "MODEL_UNDEFINED"),
        ("step", {"dt": 1.0}, "STEP_TOO_LONG"),
        ("step", {"dt": 0.0}, "STEP_REFUSED"),
        ("step", {"dt": -0.005}, "STEP_REFUSED"),
        ("step", {"dt": math.nan}, "STEP_REFUSED"),
        ("step", {"dt": math.inf}, "STEP_REFUSED"),
        ("step", {"phi": huge, "dt": 10.0}, "MODEL_UNDEFINED"),
        ("predict", {}, "PREDICTED"),
        ("correct", {}, "UPDATED"),
        ("predict", {}, "PREDICTED"),
        ("correct", {"y": math.nan}, "PREDICTED"),
        ("predict", {"dt": 1.0}, "STEP_TOO_LONG"),
        ("correct", {}, "STEP_TOO_LONG"),
        ("correct", {}, "STEP_TOO_LONG"),  # as long as no other period has begun
        ("predict", {}, "PREDICTED"),
        ("correct", {}, "UPDATED"),
        ("predict", {"phi": math.inf}, "MODEL_UNDEFINED"),
        ("predict", {"dt": -1.0}, "STEP_REFUSED"),
        ("predict", {"phi": huge, "dt": 10.0}, "MODEL_UNDEFINED"),
    ]
    for call, arguments, code in taken:
        before = subject.memory(state)
        assert getattr(subject, call)(state.address, **arguments) == CODES[code], (call, arguments)
        if code in ("MODEL_UNDEFINED", "STEP_REFUSED"):
            assert np.array_equal(subject.memory(state)[:-1], before[:-1])
    start = np.full(subject.row.order, 1e15, subject.dtype)

    def restart() -> int:
        return subject.numbers("restart", state.address, start.ctypes.data, len(start))

    assert restart() == CODES["UPDATED"]
    assert subject.step(state.address, phi=huge, dt=1e3) == CODES["DIVERGED"]
    assert subject.step(state.address) == CODES["DIVERGED"]
    assert subject.counts(state.address, counts.address) == CODES["UPDATED"]
    assert list(np.frombuffer(counts.bytes, np.uint32)) == [3, 3, 4, 3, 5, 2]
    assert counts.untouched_outside() and state.untouched_outside()
    start[:] = 0.0
    assert restart() == CODES["UPDATED"]
    assert subject.step(state.address) == CODES["UPDATED"]


def test_states_can_be_copied(subject: Subject) -> None:
    state = subject.state()
    copy = Room(subject.row.size, shift=8)
    copy.bytes = state.bytes
    for k in range(5):
        assert subject.step(copy.address, y=float(k)) == subject.step(state.address, y=float(k))
    assert copy.bytes == state.bytes


def test_every_code_has_a_text(shared: ctypes.CDLL) -> None:
    text = shared.hgo_status_text
    text.restype = ctypes.c_char_p
    for _, value, wanted in INTERFACE.codes:
        assert text(value).decode() == wanted
    for value in (6, 255, -8, 2**31 - 1, -(2**31)):
        assert text(value) == b"not a code of this library"
    assert shared.hgo_version() == INTERFACE.version


# --- the header -----------------------------------------------------------------------------------


def test_the_header_is_what_the_source_says() -> None:
    assert header.is_current(), "run firmware/c/header.py"


def test_every_law_order_and_precision_is_there() -> None:
    assert set(OBSERVERS) == {
        f"{family}{n}_{scalar}"
        for family in FAMILIES
        for n in (2, 3, 4, 5)
        for scalar in ("f32", "f64")
    }


def test_exported_and_declared_functions_are_the_same(archive: Path) -> None:
    declared = set(re.findall(r"^[a-z][^#\n]*?\b(hgo_\w+)\(", header.HEADER.read_text(), re.M))
    listed = subprocess.run(
        ["nm", "--defined-only", "--extern-only", str(archive)], capture_output=True, text=True
    )
    exported = set(re.findall(r" T (hgo_\w+)$", listed.stdout, re.M))
    assert exported == declared
    assert len(exported) == 2 + len(INTERFACE.methods) * len(OBSERVERS)


def test_nothing_panics_or_needs_a_library(archive: Path, tmp_path: Path) -> None:
    """With every function as a root, nothing is missing but these three of the C library."""
    source = tmp_path / "memory.c"
    source.write_text("char memcpy, memset, memcmp;")
    roots = [
        f"-Wl,-u,hgo_{name}{method.name}" for name in OBSERVERS for method in INTERFACE.methods
    ]
    roots += [f"-Wl,-u,{function.name}" for function in INTERFACE.functions]
    link = ["-nostdlib", "-static", "-ffreestanding", "-Wl,-e,hgo_version", "-Wl,--gc-sections"]
    out = tmp_path / "all"
    example.execute([compiler(), *link, *roots, source, archive, "-o", out])
    names = subprocess.run(["nm", out], capture_output=True, text=True, check=True).stdout
    assert "hgo_peaking_free5_f64_step" in names
    assert not re.search(r"panic|alloc", names)


def test_c11_compiles_without_a_warning(tmp_path: Path) -> None:
    lines = ['#include "hgo.h"', '#include "hgo.h"']
    for name, row in OBSERVERS.items():
        upper, align = name.upper(), 4 if row.scalar == "f32" else 8
        lines += [
            f'_Static_assert(sizeof(hgo_{name}) == {row.size}, "");',
            f'_Static_assert(_Alignof(hgo_{name}) == {align}, "");',
            f'_Static_assert(HGO_{upper}_SIZE == {row.size}, "");',
            f'_Static_assert(HGO_{upper}_MEMORY == {row.memory}, "");',
        ]
    for code, value in CODES.items():
        lines += [f'_Static_assert(HGO_{code} == {value}, "");']
    source = tmp_path / "all.c"
    source.write_text("\n".join([*lines, "int main(void) { return 0; }", ""]))
    flags = [*example.WARNINGS, "-Wconversion", "-Wshadow", "-Wstrict-prototypes"]
    for standard in ("c11", "c17", "gnu11"):
        command = [compiler(), f"-std={standard}", *flags, f"-I{example.INCLUDE}", "-c", source]
        example.execute([*command, "-o", tmp_path / "all.o"])


@pytest.mark.skipif(shutil.which("c++") is None, reason="no C++ compiler")
def test_cpp17_compiles_without_a_warning_and_links(archive: Path, tmp_path: Path) -> None:
    source = tmp_path / "main.cpp"
    source.write_text(
        '#include "hgo.h"\n'
        "int main() {\n"
        "    hgo_standard2_f32 observer;\n"
        "    hgo_standard_config_f32 config = {{3.0f, 2.0f}, 50.0f, 0.01f};\n"
        "    auto made = hgo_standard2_f32_init(&observer, sizeof observer, HGO_VERSION, &config,"
        " nullptr);\n"
        "    return made != HGO_OK || hgo_standard2_f32_step(&observer, 1.0f, 0.0f, 0.001f);\n"
        "}\n"
    )
    flags = [
        "-std=c++17",
        *example.WARNINGS,
        f"-I{example.INCLUDE}",
        "-Wno-missing-field-initializers",
    ]
    example.execute(["c++", *flags, source, archive, "-Wl,--gc-sections", "-o", tmp_path / "main"])
    example.execute([tmp_path / "main"])


# --- the example and its page ---------------------------------------------------------------------


@pytest.fixture(scope="session")
def printed(archive: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """What main.c prints here."""
    out = tmp_path_factory.mktemp("c") / "main"
    return example.execute([example.compiled(out, archive, C / "main.c")])


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.M | re.S)


def test_the_example_ends_well(printed: str) -> None:
    assert printed.endswith(example.LAST_LINE + "\n")


def test_the_pages_c_is_that_of_the_example() -> None:
    files = [(C / name).read_text(encoding="utf-8") for name in ("main.c", "gains.h", "minimal.c")]
    assert len(blocks("c")) >= 2
    for block in blocks("c"):
        assert any(block in text for text in files), block


def test_the_pages_python_writes_the_gains_and_finds_the_bits(
    printed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    out, namespace = io.StringIO(), {"__name__": "page"}
    with contextlib.redirect_stdout(out):
        for block in blocks("python"):
            exec(block, namespace)
    assert (tmp_path / "gains.h").read_text() == (C / "gains.h").read_text()
    lines = out.getvalue().splitlines()
    assert len(lines) == 2 and all(line in printed.splitlines() for line in lines)
    assert blocks("text") == [printed]


def test_the_board_prints_the_same(printed: str) -> None:
    if toolchain.missing(("qemu-system-arm", "arm-none-eabi-gcc"), (toolchain.THUMB,)):
        pytest.skip("no board: `make firmware` installs one, or says how")
    board, flash = example.on_the_board()
    assert board == printed
    assert flash < 4300
