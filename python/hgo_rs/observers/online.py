"""An observer on line: what it is, where it stands, and what `step` asks of its arguments."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from itertools import accumulate
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

from hgo_rs import _core
from hgo_rs.design.discrete import TIMINGS
from hgo_rs.design.discretisation import check_step
from hgo_rs.errors import (
    HgoError,
    check,
    check_array,
    check_choice,
    check_flag,
    check_number,
    explain,
)
from hgo_rs.laws import LAWS
from hgo_rs.models import Model, System
from hgo_rs.models.own.callables import runnable
from hgo_rs.observers.gains import WITH_R
from hgo_rs.observers.records import MARK, Array, check_inputs, check_samples, inputs, vector
from hgo_rs.observers.turns import turns_of
from hgo_rs.read_only import ReadOnlyDict, same
from hgo_rs.times import check_period

if TYPE_CHECKING:
    from typing_extensions import Self

TAMER = "choose a smaller step or gain, another method, or allow_unstable=True to look at it"
_HUGE = 1e100  # beyond it a step overflows, whatever the model
_MADE = "_core", "_records", "_waiting"  # what a copy makes anew from its spec


class OnlineObserver(_core.Online):
    """Spec and memory of an observer, and the checks of its compiled `step`."""

    _model: System | None = None
    _told = False  # whether the whole memory was given

    def __init__(
        self, spec: dict[str, Any], *, model: System | None = None, allow_unstable: bool = False
    ) -> None:
        spec = self._spec = ReadOnlyDict(spec)
        self._told = False
        if model is not None:
            self._model = model
        self._interpreted = getattr(model, "compiled", True) is False
        if self._interpreted:
            self._core = _core.Observer(runnable(spec, model))
        else:
            self._core = _core.Observer(spec)
        super().__init__(self._core, _lift(spec), check_flag(allow_unstable, "allow_unstable"))

    # what an observer is does not change

    @property
    def spec(self) -> dict[str, Any]:
        """The observer as plain data, read-only."""
        return self._spec

    @property
    def model(self) -> System | None:
        """The model."""
        return self._model

    @property
    def n(self) -> int:
        """Number of estimated states."""
        return self._core.n

    @property
    def n_y(self) -> int:
        """Number of measured outputs."""
        return self._core.n_y

    @property
    def n_u(self) -> int:
        """Number of known inputs."""
        return self._core.n_u

    @property
    def timing(self) -> str:
        """ "predictor" or "current"."""
        return TIMINGS[self._core.is_current]

    @property
    def wrap(self) -> tuple[float | None, ...]:
        """The turn of each output, (n_y,); None where it does not wrap."""
        return turns_of(self.spec, self.n_y)

    def __getstate__(self) -> tuple[dict[str, Any], bool, Array, Any, Any]:
        """All that a copy needs, or a pickle."""
        own = {name: value for name, value in self.__dict__.items() if name not in _MADE}
        return (
            own,
            self.allow_unstable,
            self.memory.copy(),
            self._clock,
            (self._started, self._open),
        )

    def __setstate__(self, state: tuple[dict[str, Any], bool, Array, Any, Any]) -> None:
        own, allow_unstable, memory, clock, begun = state
        model = own.get("_model")
        OnlineObserver.__init__(self, own["_spec"], model=model, allow_unstable=allow_unstable)
        self.memory, self._clock = memory, clock
        self._started, self._open = begun
        self.__dict__.update(own)
        self._spec = ReadOnlyDict(self._spec)

    def __eq__(self, other: object) -> bool:
        """Whether both are the same observer and stand at the same place."""
        if not isinstance(other, OnlineObserver):
            return NotImplemented
        alike = type(self) is type(other) and self._model == other._model
        return alike and same(self._place(), other._place())

    __hash__ = None  # type: ignore[assignment]  # a step moves it

    def _place(self) -> tuple[Any, ...]:
        """What it is, but for the model, and where it stands."""
        begun = self._started, self._open
        return self.spec, self.allow_unstable, self.memory, self._time, begun

    # --- memory -------------------------------------------------------------------------------

    @property
    def memory(self) -> Array:
        """The present memory, (m,); a step makes a new array, an assigned array is copied."""
        return super().memory

    @memory.setter
    def memory(self, memory: npt.ArrayLike) -> None:
        _core.Online.__dict__["memory"].__set__(self, self._checked_memory(memory))
        self._told = True

    @property
    def x_hat(self) -> Array:
        """The estimate, (n,)."""
        return self.memory[: self.n].copy()

    @property
    def gain(self) -> float | None:
        """The gain ell, or r where it is in the memory; None for laws without one, and for gains of
        the innovation or of a clock.
        """
        index = self._gain_index()
        if index is not None:
            return float(self.memory[index])
        law = self.spec.get("gain")
        return float(law["ell"]) if isinstance(law, dict) and "ell" in law else None

    def gains(self, memory: npt.ArrayLike) -> Array | None:
        """The gain for memories (..., m): r, or ell (a read-only view of one number); None as for
        `gain`.
        """
        values = np.asarray(memory, dtype=float)
        index = self._gain_index()
        if index is not None:
            return values[..., index].copy()
        constant = self.gain
        return None if constant is None else np.broadcast_to(constant, values.shape[:-1])

    def _gain_index(self) -> int | None:
        """Where r stands in the memory."""
        law = self.spec.get("gain")
        if not (isinstance(law, dict) and law["law"] in WITH_R):
            return None
        row = LAWS[self.spec["kind"]]
        m = self.spec[row.size[0]] if row.size else 0
        before = 0
        for name, count in row.memory_counts(self.n, m, moves=True).items():
            if name == "r":
                return before
            before += count
        return self.n  # of the first copy

    @property
    def _law_len(self) -> int:
        """Entries of the memory without what current timing holds behind the law's own."""
        held = int(self.spec.get("timing") == "current")
        return int(self._core.memory_len) - held

    @cached_property
    def _waiting(self) -> tuple[tuple[int, Mapping[str, Any], list[int]], ...]:
        """Where the memory holds the times that next corrections are for, with the law that
        corrects and its outputs; none with predictor timing.
        """
        end, chains = int(self._core.memory_len), self.spec.get("observers", ())
        timed = chains or "timing" in self.spec
        if not (timed and self._core.is_current):
            return ()
        if not chains or is_one_filter(self.spec):
            return tuple((end - self.n_y + i, self.spec, [i]) for i in range(self.n_y))
        rests = [int(_core.Observer(chain).memory_len) - chain["n"] for chain in chains]
        ends = [self.n + end - 1 for end in accumulate(rests)]
        pairs = zip(ends, chains, strict=True)
        return tuple((end, chain, [i]) for i, (end, chain) in enumerate(pairs))

    def _auxiliary(self, memory: Array) -> Array:
        """What memories (..., m) hold beside estimates and times, the gain included."""
        times = [at for at, _, _ in self._waiting]
        if not times or times[0] == self._law_len:
            return memory[..., self.n : self._law_len]
        return np.delete(memory, [*range(self.n), *times], axis=-1)

    def with_timing(self, timing: str) -> Self:
        """The same observer with this timing, at its initial memory; itself if that is its own.

        Raises
        ------
        HgoError
            An unknown timing, or another one than that of a law that is a recursion.
        """
        if check_choice("timing", timing, TIMINGS) == self.timing:
            return self
        remedy = "this law has no other"
        if self.spec["kind"] == "chains":
            remedy = "make the observer of each output with timing="
        check("timing" in self.spec, "timing", timing, repr(self.timing), remedy)
        other = type(self).__new__(type(self))
        own = {name: value for name, value in self.__dict__.items() if name not in _MADE}
        other.__dict__.update(own)
        spec = self.spec | {"timing": timing}
        OnlineObserver.__init__(other, spec, model=self.model, allow_unstable=self.allow_unstable)
        return other

    def _check_start(self, memory: Array, told: bool | None = None) -> None:
        """Refuse memories (..., m) from which the law cannot start.

        `told`: whether the whole memory was given, as one that a run has reached; default: as the
        observer's own was.
        """
        index = self._gain_index()
        if index is not None:
            initial_gain(float(np.min(memory[..., index])))

    def _tell_end(self, start: Array, end: Array) -> None:
        """Warn of what a run from memory to memory has lost for good."""

    def initial_memory(
        self,
        x_hat0: npt.ArrayLike | None = None,
        *,
        r0: float | None = None,
        y0: npt.ArrayLike | None = None,
    ) -> Array:
        """A memory to start from: x_hat(0) = 0 unless given, auxiliary states 0, r(0) = 1.

        Parameters
        ----------
        x_hat0 : (n,) array, optional
        r0 : float, optional
            Initial gain >= 1, for laws whose gain moves.
        y0 : float or (n_y,) array, optional
            First samples, in place of x_hat0: x_hat_1(0) = y0 for each chain; NaN for a missing
            sample gives 0.

        Raises
        ------
        HgoError
            Wrong shape; a value that is not finite; r0 < 1, or for a law whose gain is fixed; y0
            with x_hat0, or for a law whose output is not its first state.
        """
        memory = self._core.initial()
        if x_hat0 is not None:
            memory[: self.n] = vector(x_hat0, "x_hat0", self.n)
        if r0 is not None:
            index = self._gain_index()
            if index is None:
                raise HgoError(
                    explain("r0", r0, "left out for a constant gain", "set the gain itself")
                )
            memory[index] = initial_gain(r0)
        if x_hat0 is not None:
            self._put_behind(memory)
        if y0 is not None:
            remedy = "give one of them"
            check(x_hat0 is None, "y0", y0, "given without x_hat0", remedy)
            reduced = self.spec["kind"] == "reduced-order"
            remedy = "this law begins at its first sample by itself"
            check(not reduced, "y0", y0, "left out", remedy)
            sample = check_array(y0, "y0", remedy=MARK).reshape(1, -1)
            check_samples(sample, self.n_y)
            memory = self._begun(memory, sample[0])
        return memory

    def _put_behind(self, memory: Array) -> None:
        """Entries from which estimates are shown, where a law has such, that show those given."""
        law = LAWS.get(self.spec["kind"])
        if law is None or "behind" not in dict(law.memory):
            return
        n, behind = self.n, slice(self.n, 2 * self.n - 1)
        nothing = np.full(1, np.nan), np.zeros(self.n_u), 0.0, 0.0

        def shown(entries: Array) -> Array:
            start = memory.copy()
            start[behind] = entries
            return np.asarray(self._core.advance(start, *nothing)[0][1:n])

        tiny = 1e-100  # where no saturation acts
        map_ = np.array([shown(row) for row in tiny * np.eye(n - 1)]).T / tiny
        memory[behind] = np.linalg.solve(map_, memory[1:n])
        held = np.allclose(shown(memory[behind]), memory[1:n], rtol=1e-9, atol=0.0)
        remedy = "start below the levels, or raise them"
        check(held, "x_hat0", memory[:n].tolist(), "within the saturation", remedy)

    @property
    def _begins(self) -> bool:
        """Whether its outputs are states of its own, so that it can begin at first samples."""
        if self.spec["kind"] == "reduced-order":
            return True
        return self._core.begin(self._core.initial(), np.zeros(self.n_y)) is not None

    @property
    def _usual_start(self) -> str:
        """Where it begins on a record of which nothing else is known."""
        return "first-sample" if self._begins else "zero"

    def _begun(self, memory: Array, y0: Array) -> Array:
        """A memory with its estimates of the outputs at first samples, NaN where there is none."""
        if self.spec["kind"] == "reduced-order":
            return memory  # it begins there by itself
        begun = self._core.begin(memory, y0)
        allowed = "zero, or where x_hat0 says, for a model whose output h is not its first state"
        remedy = "give an x_hat0 whose output is the first sample"
        check(begun is not None, "start", "first-sample", allowed, remedy)
        return cast("Array", begun)

    def reset(
        self,
        x_hat0: npt.ArrayLike | None = None,
        *,
        r0: float | None = None,
        memory0: npt.ArrayLike | None = None,
        y0: npt.ArrayLike | None = None,
        t: float = 0.0,
    ) -> None:
        """Start again, see `initial_memory`; or continue from a whole memory.

        Parameters
        ----------
        x_hat0, r0, y0, memory0 : optional
            The start, see `initial_memory`; or the whole memory.
        t : float
            Present time [s]. Above 0 the observer is in use: with current timing the next `step`
            predicts over its period, which the first step after a start does not.

        Raises
        ------
        HgoError
            What `initial_memory` refuses; t < 0.
        """
        time = check_number(t, "t", least=0.0)
        self.memory = self._start(x_hat0, r0, memory0, y0)
        self._told, self._time = memory0 is not None, time

    def _start(
        self,
        x_hat0: npt.ArrayLike | None,
        r0: float | None,
        memory0: npt.ArrayLike | None,
        y0: npt.ArrayLike | None = None,
    ) -> Array:
        if memory0 is None:
            return self.initial_memory(x_hat0, r0=r0, y0=y0)
        alone = x_hat0 is None and r0 is None and y0 is None
        check(alone, "memory0", memory0, "given alone", "give memory0, or x_hat0 (or y0) and r0")
        start = vector(memory0, "memory0", self._core.memory_len)
        self._check_start(start, told=True)
        return start

    # --- use ----------------------------------------------------------------------------------
    # `step` is compiled. It asks these about what it does not know to be sound.

    def _checked_dt(self, dt: Any) -> float:
        step = check_period(dt)
        self._check_dt(step, self.allow_unstable)
        return step

    def _checked_sample(self, y: npt.ArrayLike) -> Array:
        sample = check_array(y, "y", remedy=MARK).reshape(1, -1)
        check_samples(sample, self.n_y)
        return sample[0]

    def _checked_input(self, u: npt.ArrayLike | None) -> Array:
        told = inputs(u, 1, self.n_u)
        check_inputs(told)
        return told[0]

    def _checked_memory(self, memory: npt.ArrayLike) -> Array:
        values = check_array(memory, "memory")
        if values.shape != (self._core.memory_len,):
            allowed = f"must have {self._core.memory_len} entries"
            raise HgoError(f"memory of shape {values.shape}: {allowed}")
        finite = bool(np.all(np.isfinite(values)))
        check(finite, "memory", memory, "finite", "leave out NaN and infinity, or call reset()")
        for at, _, _ in self._waiting:
            elapsed = float(values[at])
            allowed = ">= 0, the interval that the next correction covers [s]"
            remedy = "keep the value of memory, or 0 at a start; give an input to predict(u, dt)"
            check(elapsed >= 0.0, f"memory[{at}]", elapsed, allowed, remedy)
        return values

    def _no_place(self, out: Any) -> HgoError:
        allowed = f"a writeable, contiguous float64 array of shape ({self.n},)"
        remedy = f"give numpy.empty({self.n})"
        if not isinstance(out, np.ndarray):
            return HgoError(explain("out", out, allowed, remedy))
        flags = {"writeable": "read-only", "c_contiguous": "strided", "aligned": "unaligned"}
        lacks = [word for flag, word in flags.items() if not getattr(out.flags, flag)]
        shown = ", ".join([f"out of shape {out.shape}", str(out.dtype), *lacks])
        return HgoError(f"{shown}: must be {allowed}; {remedy}")

    def _divergence(self) -> HgoError:
        return HgoError(f"the estimate would diverge at t = {self._time:g} s: {TAMER}")

    def _no_value(self, sample: list[float], told: list[float] | None = None) -> HgoError:
        given = np.abs([*sample, *(told or ())])
        if np.max(given, initial=0.0, where=given == given) > _HUGE:
            return self._divergence()
        where = f"t = {self._time:.6g} s"
        return HgoError(self._undefined(where, self._time, sample, told, self.memory))

    def _undefined(
        self, where: str, t: float, sample: npt.ArrayLike, told: npt.ArrayLike | None, memory: Array
    ) -> str:
        """What to say where the model has no value at a sample: of which equation, and for what."""
        y = np.asarray(sample, dtype=float)
        told = np.full(self.n_u, np.nan) if told is None else np.asarray(told, dtype=float)
        measured = "" if np.isnan(y).all() else f", y = {_row(y)}"
        head = f"the model has no value at {where}{measured}"
        known = self.spec.get("model") or {"kind": "none"}
        if known["kind"] == "ship":
            return (
                f"{head}: a ship at rest has no course angle, z_1 = 0 makes atan(0/0) (Katayama, "
                "assumption A1); start the record where the ship moves, or x_hat0 at its velocity"
            )
        estimate = f"x_hat = [{_row(memory[: self.n])}]"
        if known["kind"] != "own":
            return (
                f"{head}: the step from {estimate} is not finite; start x_hat0 nearer to the states"
            )
        model = cast("Model", self.model)
        x_hat = memory[: self.n]
        if model.n_x:  # measured states, then the estimated ones
            last = memory[self.n : self.n + model.n_x]
            x_hat = np.append(np.where(np.isnan(y), last, y), x_hat)
        values = dict(zip(model.states, x_hat.tolist(), strict=True))
        shown = ", ".join(f"{name} = {value:.6g}" for name, value in values.items())
        if np.max(np.abs(x_hat)) > _HUGE:
            return f"{head}: the numbers are too large ({shown}); {TAMER}"
        values |= {"t": t, **dict(zip(model.inputs, told.tolist(), strict=True))}
        if known["form"] == "sampled":
            values["y"] = float(y[0])
        found = model.not_finite(values)
        labels = found or model.shown_sides()
        equations = " and ".join(f"{label} = {_short(text)}" for label, text in labels[:3])
        how = "not finite at" if found else "not finite within the step from"
        remedy = "start x_hat0 where it has one"
        start = np.zeros(self.n)
        start[0] = 0.0 if np.isnan(y[0]) else y[0]
        helps = t == 0.0 and not model.n_x and self.n_y == 1 and found
        if helps and not model.not_finite(values | dict(zip(model.states, start, strict=True))):
            remedy += f", for example x_hat0 = [{_row(start)}]"
        return (
            f"{head}: {equations} is {how} {shown}; {remedy}, or bound the argument in the "
            "equation, for example max(v, 1e-3) for a state v"
        )

    def _check_clock(self, clock: float | Array) -> None:
        """Refuse steps of a record that the law cannot take."""

    def _check_dt(
        self, dt: float, allow_unstable: bool, spec: Mapping[str, Any] | None = None
    ) -> None:
        """Refuse a step [s] of the observer, or a correction of one of its chains for so long."""
        check_step(spec or self.spec, dt, allow_unstable=allow_unstable)


EKF, SAMPLED = "high-gain-ekf", "sampled"


def is_one_filter(spec: Mapping[str, Any]) -> bool:
    """Whether an observer remembers one covariance: of its chain, or of all chains."""
    chains = spec.get("observers")
    if chains:
        return all(one["kind"] == EKF and one["method"] == SAMPLED for one in chains)
    return bool(spec["kind"] == EKF)


def _lift(spec: dict[str, Any]) -> float:
    """By how much estimates may exceed the samples before a run counts as diverged: start-up peaks
    reach ell^(n-1), Astolfi et al."""
    law, n = spec.get("gain"), spec.get("n", 1)
    largest = ("ell", "fast", "r_max", "rho")
    given = [law[key] for key in largest if key in law] if isinstance(law, dict) else []
    ell = given[0] if given else 1.0
    with np.errstate(over="ignore"):
        lifts = [float(np.power(max(1.0, ell), n)), *map(_lift, spec.get("observers", ()))]
    return max(lifts)


def initial_gain(value: Any) -> float:
    return check_number(value, "r0", least=1.0, remedy="law (6) needs r >= 1; start at 1")


def _row(values: Array) -> str:
    return ", ".join(f"{value:.6g}" for value in values)


def _short(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:77]}..."
