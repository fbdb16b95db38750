"""The observers: one class a law, over the compiled core.

Law and memory are apart: an object holds an immutable `spec` (what it is) and one memory (where it
stands) that `step` moves. `run` works on a memory of its own and leaves the object's alone.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import numpy.typing as npt

from hgo_rs import _core
from hgo_rs.design.discrete import DEFAULT_METHOD, DEFAULT_TIMING, METHODS, TIMINGS
from hgo_rs.design.discretisation import StepLimit, check_step, step_limit
from hgo_rs.design.response import bandwidth, noise_gain, peaking, settling
from hgo_rs.errors import (
    DesignError,
    HgoError,
    check,
    check_array,
    check_choice,
    check_integer,
    check_number,
    explain,
)
from hgo_rs.gains import AdaptiveGain, ConstantGain, DeadZoneGain
from hgo_rs.models import Ship, System, Unknown, VanDerPol
from hgo_rs.read_only import ReadOnlyDict
from hgo_rs.read_only import shown as frozen
from hgo_rs.results import RunResult

if TYPE_CHECKING:
    from hgo_rs.own import Model

__all__ = [
    "CopiesMetWarning",
    "LowPowerObserver",
    "ModifiedObserver",
    "MultiOutputObserver",
    "Observer",
    "PeakingFreeObserver",
    "ReducedOrderObserver",
    "RepelledCollection",
    "SampledDataObserver",
    "StandardObserver",
]

Array = npt.NDArray[np.float64]
Gain = float | ConstantGain | AdaptiveGain | DeadZoneGain
Poles = Sequence[complex] | npt.ArrayLike

_TAMER = "choose a smaller step or gain, another method, or allow_unstable=True to look at it"
_OVERFLOW = "choose a smaller step or gain, another method, or fewer samples"
_MARK = "mark a missing sample as NaN"
_HUGE = 1e100  # beyond it a step overflows, whatever the model


class CopiesMetWarning(UserWarning):
    """Copies of a collection have become identical, which they stay."""


class Observer(_core.Online):
    """An observer of the compiled core. Use one of its subclasses.

    Attributes
    ----------
    spec : dict
        What the observer is, as plain data, read-only.
    n, n_y, n_u : int
        Numbers of estimated states, measured outputs, known inputs.
    timing : "predictor" or "current"
        Whether the estimate at sample k uses samples up to k - 1, or up to k.
    memory : (m,) ndarray
        Where it stands: x_hat first, then auxiliary states, then the gain r where it moves; with
        current timing then the time that the next correction is for [s]. A step makes a new one; an
        array that is set is copied, and neither clock nor whether a first sample was taken changes:
        `reset(memory0=..., t=...)` goes on where another observer stands.
    model : System or None
        What it knows of the system; None: nothing, or what its class takes by default.
    allow_unstable : bool
        Let `step` and `run` use a step beyond the stability limit.
    """

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
            from hgo_rs.own.callables import runnable

            self._core = _core.Observer(runnable(spec, model))
        else:
            self._core = _core.Observer(spec)
        super().__init__(self._core, _lift(spec), bool(allow_unstable))

    # what an observer is does not change

    @property
    def spec(self) -> dict[str, Any]:
        """What it is, as plain data, read-only."""
        return self._spec

    @property
    def model(self) -> System | None:
        """What it knows of the system."""
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

    def __getstate__(self) -> tuple[dict[str, Any], bool, Array, Any, Any]:
        """All that a copy needs, or a pickle."""
        own = {name: value for name, value in self.__dict__.items() if name != "_core"}
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
        Observer.__init__(self, own["_spec"], model=model, allow_unstable=allow_unstable)
        self.memory, self._clock = memory, clock
        self._started, self._open = begun
        self.__dict__.update(own)
        self._spec = ReadOnlyDict(self._spec)

    # --- memory -------------------------------------------------------------------------------

    @property
    def memory(self) -> Array:
        """Where it stands, (m,); a step makes a new one, an array that is set is copied."""
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
        """The gain ell, or r where it moves; None for laws without one."""
        index = self._gain_index()
        if index is not None:
            return float(self.memory[index])
        law = self.spec.get("gain")
        return float(law["ell"]) if isinstance(law, dict) and "ell" in law else None

    def gains(self, memory: npt.ArrayLike) -> Array | None:
        """The gain that acts, for memories (..., m): r, or ell (one number shown many times, which
        cannot be written to); None for laws without one.
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
        moves = isinstance(law, dict) and law["law"] != "constant"
        if not moves:
            return None
        if self.spec["kind"] in ("low-power", "peaking-free"):
            return 2 * self.n - 1
        return self.n

    @property
    def _law_len(self) -> int:
        """Entries of the memory without what current timing holds beside the law's own."""
        held = int(self.spec.get("timing") == "current")
        return int(self._core.memory_len) - held

    def with_timing(self, timing: str) -> Observer:
        """The same observer with this timing, at its initial memory; itself if that is its own.

        Raises
        ------
        HgoError
            A timing that is not known, or another than that of a law that is a recursion.
        """
        if check_choice("timing", timing, TIMINGS) == self.timing:
            return self
        check("timing" in self.spec, "timing", timing, repr(self.timing), "this law has no other")
        other = type(self).__new__(type(self))
        own = {name: value for name, value in self.__dict__.items() if name != "_core"}
        other.__dict__.update(own)
        spec = self.spec | {"timing": timing}
        Observer.__init__(other, spec, model=self.model, allow_unstable=self.allow_unstable)
        return other

    def _check_start(self, memory: Array, told: bool | None = None) -> None:
        """Refuse memories (..., m) from which the law cannot start.

        `told`: whether the whole memory was given, as one that a run has reached; default: as the
        observer's own was.
        """
        index = self._gain_index()
        if index is not None:
            _initial_gain(float(np.min(memory[..., index])))

    def _tell_end(self, start: Array, end: Array) -> None:
        """Warn of what a run from memory to memory has lost for good."""

    def initial_memory(
        self, x_hat0: npt.ArrayLike | None = None, *, r0: float | None = None
    ) -> Array:
        """A memory to start from: x_hat(0) = 0 unless given, auxiliary states 0, r(0) = 1.

        Parameters
        ----------
        x_hat0 : (n,) array, optional
        r0 : float, optional
            Initial gain >= 1, for laws whose gain moves.

        Raises
        ------
        HgoError
            Wrong shape; a value that is not finite; r0 < 1, or for a law whose gain is fixed.
        """
        memory = self._core.initial()
        if x_hat0 is not None:
            memory[: self.n] = _vector(x_hat0, "x_hat0", self.n)
        if r0 is not None:
            index = self._gain_index()
            if index is None:
                raise HgoError(
                    explain("r0", r0, "left out for a constant gain", "set the gain itself")
                )
            memory[index] = _initial_gain(r0)
        return memory

    def reset(
        self,
        x_hat0: npt.ArrayLike | None = None,
        *,
        r0: float | None = None,
        memory0: npt.ArrayLike | None = None,
        t: float = 0.0,
    ) -> None:
        """Start again, see `initial_memory`; or go on from the whole memory.

        Parameters
        ----------
        x_hat0, r0, memory0 : optional
            Where to start, see `initial_memory`; or the whole memory.
        t : float
            Time [s] at which it stands. Above 0 the observer is under way: with current timing the
            next `step` predicts over its period, which the first one after a start does not.

        Raises
        ------
        HgoError
            What `initial_memory` refuses; t < 0.
        """
        time = check_number(t, "t", least=0.0)
        self.memory = self._start(x_hat0, r0, memory0)
        self._told, self._time = memory0 is not None, time

    def _start(
        self,
        x_hat0: npt.ArrayLike | None,
        r0: float | None,
        memory0: npt.ArrayLike | None,
    ) -> Array:
        if memory0 is None:
            return self.initial_memory(x_hat0, r0=r0)
        alone = x_hat0 is None and r0 is None
        check(alone, "memory0", memory0, "given alone", "give memory0, or x_hat0 and r0")
        start = _vector(memory0, "memory0", self._core.memory_len)
        self._check_start(start, told=True)
        return start

    # --- use ----------------------------------------------------------------------------------
    # `step` is compiled. It asks these about what it does not know to be sound.

    def _checked_dt(self, dt: Any) -> float:
        step = check_number(dt, "dt", above=0.0)
        self._check_dt(step, self.allow_unstable)
        return step

    def _checked_sample(self, y: npt.ArrayLike) -> Array:
        sample = check_array(y, "y", remedy=_MARK).reshape(1, -1)
        _check_samples(sample, self.n_y)
        return sample[0]

    def _checked_input(self, u: npt.ArrayLike | None) -> Array:
        told = _inputs(u, 1, self.n_u)
        _check_inputs(told)
        return told[0]

    def _checked_memory(self, memory: npt.ArrayLike) -> Array:
        values = check_array(memory, "memory")
        if values.shape != (self._core.memory_len,):
            allowed = f"must have {self._core.memory_len} entries"
            raise HgoError(f"memory of shape {values.shape}: {allowed}")
        finite = bool(np.all(np.isfinite(values)))
        check(finite, "memory", memory, "finite", "leave out NaN and infinity, or call reset()")
        if self.spec.get("timing") == "current":
            elapsed = float(values[self._law_len])
            allowed = ">= 0, the time that the next correction is for [s]"
            remedy = "keep what memory shows, or 0 at a start; an input is told to predict(u, dt)"
            check(elapsed >= 0.0, f"memory[{self._law_len}]", elapsed, allowed, remedy)
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
        return HgoError(f"the estimate would diverge at t = {self._time:g} s: {_TAMER}")

    def _no_value(self, sample: list[float], told: list[float] | None = None) -> HgoError:
        given = np.abs([*sample, *(told or ())])
        if np.max(given, initial=0.0, where=given == given) > _HUGE:
            return self._divergence()
        where = f"t = {self._time:.6g} s"
        return HgoError(self._undefined(where, self._time, sample, told, self.memory))

    def _undefined(
        self,
        where: str,
        t: float,
        sample: npt.ArrayLike,
        told: npt.ArrayLike | None,
        memory: Array,
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
            return f"{head}: the numbers are too large ({shown}); {_TAMER}"
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
            f"{head}: {equations} is {how} {shown}; {remedy}, or bound in the equation what it has "
            "no value for, as max(v, 1e-3) does for a state v"
        )

    def run(
        self,
        t_or_dt: npt.ArrayLike,
        y: npt.ArrayLike,
        u: npt.ArrayLike | None = None,
        *,
        x_hat0: npt.ArrayLike | None = None,
        r0: float | None = None,
        memory0: npt.ArrayLike | None = None,
        until: float | None = None,
        timing: str | None = None,
        allow_unstable: bool | None = None,
    ) -> RunResult:
        """Run over a record of N samples.

        Predictor timing: row k of the result uses samples up to k - 1; current timing: up to k, by
        `correct(y[k])`, after which `predict(u[k], dt)` moves to the next row, with the bits of
        these calls. Uneven steps are honoured.

        Parameters
        ----------
        t_or_dt : float or (N,)
            Sampling period, or the increasing times of the samples [s].
        y : (N,) or (N, n_y)
            Samples; None or NaN is missing: the law predicts over it, `missing` says where.
        u : (N,) or (N, n_u), optional
            Known inputs, each held until the next sample.
        x_hat0, r0, memory0 : optional
            Where to start, see `initial_memory`; or the whole memory, as the first sample finds
            it.
        until : float, optional
            Time [s] of the sample after the last one, where the record goes on elsewhere:
            `next_memory` of the result is the memory there, a `memory0` to go on with.
        timing : "predictor" or "current", optional
            Default: the observer's own. The result says which.
        allow_unstable : bool, optional
            Run at a step beyond the stability limit. Default: the constructor's choice.

        Raises
        ------
        HgoError
            Shapes that do not fit; NaN or infinity in t or u, infinity in y; time that does not
            increase; a step at or above the stability limit; an estimate that diverged.
        """
        if timing is not None and timing != self.timing:
            return self.with_timing(timing).run(
                t_or_dt,
                y,
                u,
                x_hat0=x_hat0,
                r0=r0,
                memory0=memory0,
                until=until,
                allow_unstable=allow_unstable,
            )
        allow = self.allow_unstable if allow_unstable is None else bool(allow_unstable)
        samples = _samples(y, self.n_y)
        clock = _clock(t_or_dt, len(samples))
        told = _inputs(u, len(samples), self.n_u)
        start = self._start(x_hat0, r0, memory0)
        if memory0 is None:
            self._check_start(start, told=False)
        # elsewhere the innovation is y - x_hat_1, which is computed when it is asked for
        own_sampled = self.spec["kind"] == "sampled-data" and self.spec["model"]["kind"] == "own"
        tells = self._core.is_current or self.spec["kind"] == "chains" or own_sampled
        end = None if until is None else _after(until, clock, len(samples))
        slowdown = 1.0
        if self._interpreted:
            record = (clock, samples, told, start)
            track, slowdown = self._called_run(*record, innovation=tells, until=end)
        else:
            track = self._core.run(clock, samples, told, start, innovation=tells, until=end)
        if not track["sound"]:
            _check_samples(track["y"], self.n_y)
            _check_times(clock)
            _check_inputs(told)

        def time(k: int) -> float:
            return clock * k if isinstance(clock, float) else float(clock[k])

        k, longest = track["longest_step"]
        where = f"after sample {k} (t = {time(k):g} s), " if np.ndim(clock) else ""
        if self._core.is_current and self._law_len < len(start) and not track["missing"][0]:
            # the first sample corrects over the time that its start has waited
            waited = float(start[self._law_len])
            if waited > longest:
                longest, where = waited, f"before sample 0 (t = {time(0):g} s), "
        if longest > 0.0:
            try:
                self._check_dt(longest, allow)
            except DesignError as error:
                raise DesignError(f"{where}{error}") from None
        memory = track["memory"]
        bound = self._bound(float(np.max(np.abs(start))), track["largest_sample"])
        diverged = len(memory)
        if not track["largest"] <= bound:  # NaN is not within
            diverged = int(np.argmin(np.all(np.abs(memory) <= bound, axis=1)))
        undefined = track["undefined"]
        if undefined is not None and (undefined < diverged or allow):
            k = undefined
            where = f"sample {k} (t = {time(k):.6g} s)"
            raise HgoError(self._undefined(where, time(k), track["y"][k], told[k], memory[k]))
        if diverged < len(memory) and not allow:
            k = diverged
            raise HgoError(f"the estimate diverged at sample {k} (t = {time(k):g} s): {_TAMER}")
        finite = [*np.isfinite(memory[diverged:]).all(axis=1)]
        finite += [] if end is None else [np.isfinite(track["next"]).all()]
        if not all(finite):
            k = diverged + finite.index(False)
            where = f"sample {k} (t = {time(k):g} s)" if k < len(memory) else f"t = {end:g} s"
            raise HgoError(f"the estimate overflowed at {where}: {_OVERFLOW}")
        self._tell_end(start, memory[-1])
        result = RunResult.of_run(
            clock,
            track.get("innovation"),
            x_hat=memory[:, : self.n],
            auxiliary=memory[:, self.n : self._law_len],
            missing=track["missing"],
            gain=self.gains(memory),
            y=track["y"],
            memory=memory,
            timing=self.timing,
        )
        result.__dict__["slowdown"] = slowdown
        result.__dict__["next_memory"] = None if until is None else frozen(track["next"])
        if track["missing"].any():  # for the error to expect after the gaps
            result.__dict__["_run_of"] = (self, told.copy())
        return result

    def _called_run(self, *record: Any, **options: Any) -> tuple[dict[str, Any], float]:
        """The track of a model of Python functions, and by how much it is slower than a compiled
        model of its size.
        """
        from hgo_rs.own.callables import clocked, stand_in, warn_slow

        model, count = cast("Model", self.model), len(record[1])
        track, called = clocked(lambda: self._core.run(*record, **options))
        compiled = _core.Observer(stand_in(self.spec, model))
        _, fast = clocked(lambda: compiled.run(*record, **options))
        return track, warn_slow(model, fast / count, called / count, "run")

    def step_limit(self) -> StepLimit:
        """The largest stable step of this law under its discretisation, computed."""
        return step_limit(self.spec)

    def export(self, *, to: str, out: str | Path, **options: Any) -> list[Path]:
        """Write this observer as source code, see `hgo_rs.export`."""
        from hgo_rs.exports import export

        return export(self, to=to, out=out, **options)

    def to_control(self, dt: float, *, name: str = "observer") -> Any:
        """This law as a discrete-time system of the package `control`: see
        `hgo_rs.exports.control.to_control`.
        """
        from hgo_rs.exports.control import to_control

        return to_control(self, dt, name=name)

    def bandwidth(self, dt: float | None = None, *, gain: float | None = None) -> Array:
        """Cutoff of each estimate [rad/s], (n,): -3 dB against the ideal derivative of y.

        Parameters
        ----------
        dt : float, optional
            Step [s]: the observer as it runs, by its method and timing. Default: the law in
            continuous time.
        gain : float, optional
            Where to freeze a gain that moves [1/s]. Default: where it stands.

        Raises
        ------
        HgoError
            A step that is not stable; a law of several chains. See `hgo_rs.design.bandwidth`.
        """
        return bandwidth(self.spec, dt, gain=self._frozen(gain))

    def noise_gain(self, dt: float | None = None, *, gain: float | None = None) -> Array:
        """Variance of each estimate per unit variance of white measurement noise, (n,).

        Unit of entry i: s^(-2(i-1)). Exact, from a Lyapunov equation, the known part of the model
        left out. Without `dt` per unit spectral density, the limit of noise_gain(dt)/dt.
        Parameters and errors as in `bandwidth`; see `hgo_rs.design.noise_gain`.
        """
        return noise_gain(self.spec, dt, gain=self._frozen(gain))

    def peaking(self, dt: float | None = None, *, gain: float | None = None) -> Array:
        """Largest error of each estimate over time for x_hat_1 wrong by 1 at the start, (n,).

        Unit of entry i: s^(-(i-1)); it grows as ell^(i-1).
        Parameters and errors as in `bandwidth`; see `hgo_rs.design.peaking`.
        """
        return peaking(self.spec, dt, gain=self._frozen(gain))

    def settling(
        self, dt: float | None = None, *, within: float = 0.02, gain: float | None = None
    ) -> Array:
        """Time [s] after which the error of `peaking` stays below `within` of its peak, (n,).

        Parameters and errors as in `bandwidth`; see `hgo_rs.design.settling`.
        """
        return settling(self.spec, dt, within=within, gain=self._frozen(gain))

    def _frozen(self, gain: float | None) -> float | None:
        """The gain at which the law is looked at: the one that acts, if it moves."""
        return self.gain if gain is None and self._gain_index() is not None else gain

    def _check_dt(self, dt: float, allow_unstable: bool) -> None:
        check_step(self.spec, dt, allow_unstable=allow_unstable)

    def save(self, path: str | Path, **log: Any) -> None:
        """Write an `observer.toml` that says all of this observer, and where it stands.

        Parameters
        ----------
        path
            The file; `hgo_rs.load` reads it.
        log
            Keys of its table `[log]`: time, output, input, ...

        Raises
        ------
        ConfigError
            A file that cannot be written; a model that is Python code.
        """
        from hgo_rs.config import Config

        Config.of(self, **log).save(path)

    def __repr__(self) -> str:
        inside = ", ".join(f"{k}={v!r}" for k, v in self.spec.items() if k != "kind")
        return f"{type(self).__name__}({inside})"


# --- the laws ---------------------------------------------------------------------------------


class StandardObserver(Observer):
    """Standard high-gain observer of order n, any gain law.

    x_hat' = A x_hat + f_hat(x_hat, u, t) + diag(r, ..., r^n) K (y - x_hat_1)

    Sanfelice and Praly (5)-(7); with a constant gain Astolfi et al. (2) and, with f_hat = 0, Lee,
    Choi and Khalil (39), (42).

    Parameters
    ----------
    n : int
        Order, 1 to 12.
    gain : float, ConstantGain, AdaptiveGain or DeadZoneGain
        High gain ell [1/s] or the law that moves it.
    epsilon : float, optional
        1/ell [s], in place of `gain`.
    poles : n numbers, optional
        Roots of s^n + k_1 s^(n-1) + ... + k_n, before scaling by ell. Default: equidistant in
        [-2, -1].
    k : n numbers, optional
        The coefficients themselves, in place of `poles`.
    model : System, optional
        What is known of the system. Default: nothing, phi = 0.
    method : str, optional
        Discretisation, one of `METHODS`; the papers' recursions are "euler". Default: "zoh", or
        "rk4" for a low-power or peaking-free law with a gain that moves.
    timing : "predictor" or "current"
        Whether the estimate at sample k uses samples up to k - 1, as the papers' recursions do, or
        up to k.
    allow_unstable : bool
        Let `step` and `run` use a step beyond the stability limit.

    Raises
    ------
    HgoError
        Poles that are not Hurwitz or lack a conjugate; an order, gain or model out of range.
    """

    def __init__(
        self,
        n: int,
        gain: Gain | None = None,
        *,
        epsilon: float | None = None,
        poles: Poles | None = None,
        k: npt.ArrayLike | None = None,
        model: System | None = None,
        method: str | None = None,
        timing: str = DEFAULT_TIMING,
        allow_unstable: bool = False,
    ) -> None:
        n = _order(n)
        spec = {
            "kind": "standard",
            "n": n,
            "k": _coefficients(n, poles, k),
            "gain": _gain(gain, epsilon),
            "model": _model(model, n),
            **_manner(DEFAULT_METHOD if method is None else method, timing),
        }
        super().__init__(spec, model=model, allow_unstable=allow_unstable)


class LowPowerObserver(Observer):
    """Low-power observer of order n: no coefficient above ell^2. Astolfi et al. (5).

    Parameters
    ----------
    n : int
        Order, 2 to 12.
    gain, epsilon, model, method, timing, allow_unstable
        As in `StandardObserver`. The model must be of phase-variable form.
    poles : 2 n - 1 numbers, optional
        Eigenvalues of M_n. Default: 2 n - 2 equidistant ones in [-2, -1], and -2; for n = 5 the
        paper's coefficients.
    alpha, beta : n and n - 1 numbers, optional
        The coefficients themselves, in place of `poles`.
    """

    def __init__(
        self,
        n: int,
        gain: Gain | None = None,
        *,
        epsilon: float | None = None,
        poles: Poles | None = None,
        alpha: npt.ArrayLike | None = None,
        beta: npt.ArrayLike | None = None,
        model: System | None = None,
        method: str | None = None,
        timing: str = DEFAULT_TIMING,
        allow_unstable: bool = False,
    ) -> None:
        spec = _low_power("low-power", n, gain, epsilon, poles, alpha, beta, model, method, timing)
        super().__init__(spec, model=model, allow_unstable=allow_unstable)


class PeakingFreeObserver(Observer):
    """Low-power peaking-free observer of order n. Astolfi et al. (11).

    Parameters
    ----------
    n, gain, epsilon, poles, alpha, beta, model, method, timing, allow_unstable
        As in `LowPowerObserver`.
    saturation : float or n - 1 numbers
        Levels r_2 ... r_n >= max |x_i| (10).
    clip : "hard" or "smooth"
        Hard clip at +-r (what the paper's tables use), or the C1 saturation of its text, bounded
        by r + 1.

    Raises
    ------
    HgoError
        A saturation level below the model's own bound of |x_i|.
    """

    def __init__(
        self,
        n: int,
        gain: Gain | None = None,
        *,
        saturation: npt.ArrayLike,
        clip: str = "hard",
        epsilon: float | None = None,
        poles: Poles | None = None,
        alpha: npt.ArrayLike | None = None,
        beta: npt.ArrayLike | None = None,
        model: System | None = None,
        method: str | None = None,
        timing: str = DEFAULT_TIMING,
        allow_unstable: bool = False,
    ) -> None:
        spec = _low_power(
            "peaking-free", n, gain, epsilon, poles, alpha, beta, model, method, timing
        )
        spec |= {
            "saturation": _saturation(saturation, spec["n"], model),
            "clip": check_choice("clip", clip, ("hard", "smooth")),
        }
        super().__init__(spec, model=model, allow_unstable=allow_unstable)


class _Copies(Observer):
    """What the collection and the modified observer share."""

    def __init__(
        self,
        kind: str,
        gain: AdaptiveGain,
        k: npt.ArrayLike,
        k_bar: npt.ArrayLike,
        copies: int,
        model: System | None,
        method: str,
        timing: str,
        allow_unstable: bool,
    ) -> None:
        check(
            isinstance(gain, AdaptiveGain),
            "gain",
            gain,
            "an AdaptiveGain",
            "the collection is defined for law (6) only",
        )
        spec = {
            "kind": kind,
            "n": 2,
            "k": _vector(k, "k", 2).tolist(),
            "k_bar": _vector(k_bar, "k_bar", 2).tolist(),
            "copies": check_integer(copies, "copies", least=2, most=5),
            "gain": gain.spec,
            "model": _model(model, 2),
            **_manner(method, timing),
        }
        super().__init__(spec, model=model, allow_unstable=allow_unstable)

    @property
    def copies(self) -> int:
        """Number of copies."""
        return int(self.spec["copies"])

    def _starts(self, x_hat0: npt.ArrayLike, r0: npt.ArrayLike) -> Array:
        """Flat memory [x_hat_1, r_1, x_hat_2, r_2, ...] of starts that differ."""
        starts, gains = check_array(x_hat0, "x_hat0"), check_array(r0, "r0")
        shape = (self.copies, self.n)
        if starts.shape != shape or not np.all(np.isfinite(starts)):
            raise HgoError(
                f"x_hat0 of shape {starts.shape}: must be finite and of shape {shape}; one row a "
                "copy"
            )
        fits = gains.shape in ((), (self.copies,))
        check(fits, "r0", r0, f"one number, or {self.copies}", "give one a copy")
        for value in gains.flat:
            _initial_gain(float(value))
        rows = np.column_stack([starts, np.broadcast_to(gains, (self.copies,))]).ravel()
        self._check_apart(rows)
        return np.asarray(rows)

    def _held(self, memory: Array) -> Array:
        """The whole memory from the law's: no sample has been seen."""
        return np.concatenate([memory, np.zeros(self._core.memory_len - self._law_len)])

    def _copies_of(self, memory: npt.ArrayLike) -> Array:
        """What of memories (..., m) is the copies', (..., copies (n + 1))."""
        end = self._law_len
        return np.asarray(memory, dtype=float)[..., end - self.copies * (self.n + 1) : end]

    def _check_start(self, memory: Array, told: bool | None = None) -> None:
        """Every r_i >= 1, and copies that start apart.

        In a memory that was given as a whole copies may have met: `step` goes on from there, so all
        goes on, with a warning.
        """
        for value in np.ravel(memory[..., self.n : self._law_len : self.n + 1]):
            _initial_gain(float(value))
        if not (self._told if told is None else told):
            self._check_apart(self._copies_of(memory))
        else:
            self._warn_met(memory)

    def _tell_end(self, start: Array, end: Array) -> None:
        if self._distinct(end) < self._distinct(start):
            self._warn_met(end)

    def _distinct(self, memory: Array) -> int:
        """How many copies differ; of several memories in the worst of them."""
        rows = self._copies_of(memory).reshape(-1, self.copies, self.n + 1)
        return min(len(np.unique(copies, axis=0)) for copies in rows)

    def _warn_met(self, memory: Array) -> None:
        if (left := self._distinct(memory)) < self.copies:
            warnings.warn(
                f"copies have met: {left} of {self.copies} differ, and identical copies never "
                f"separate; for {self.copies} again, start from spread(...)",
                CopiesMetWarning,
                stacklevel=4,
            )

    def _check_apart(self, copies: Array) -> None:
        for starts in copies.reshape(-1, self.copies, self.n + 1):
            check(
                len(np.unique(starts, axis=0)) == self.copies,
                "starts of the copies",
                starts.tolist(),
                "different from one another",
                "identical copies never separate; spread them with spread(...)",
            )

    def nominal_gain(self, memory: npt.ArrayLike) -> Array:
        """r_bar = mean r_i (24) of the copies in memories (..., m)."""
        gains = self._copies_of(memory)[..., self.n :: self.n + 1]
        return np.asarray(gains.mean(axis=-1))


class RepelledCollection(_Copies):
    """A collection of observers that repel each other. Sanfelice and Praly (23), (24).

    The estimate is the first copy's; `nominal_gain` is the mean of the gains r_i.

    Parameters
    ----------
    gain : AdaptiveGain
    k, k_bar : two numbers each
        Coefficients, and repulsion gains mu P^-1 (1, 0)' (`hgo_rs.design.repulsion_gains`).
    copies : int
        2 to 5.
    model, method, timing, allow_unstable
        As in `StandardObserver`.
    """

    def __init__(
        self,
        gain: AdaptiveGain,
        *,
        k: npt.ArrayLike,
        k_bar: npt.ArrayLike,
        copies: int = 3,
        model: System | None = None,
        method: str = "rk4",
        timing: str = DEFAULT_TIMING,
        allow_unstable: bool = False,
    ) -> None:
        super().__init__(
            "collection", gain, k, k_bar, copies, model, method, timing, allow_unstable
        )

    def spread(self, x_hat0: npt.ArrayLike, r0: npt.ArrayLike = 1.0) -> Array:
        """A memory from starts (copies, 2) that differ, and initial gains r >= 1."""
        return self._held(self._starts(x_hat0, r0))


class ModifiedObserver(_Copies):
    """The observer with gain r r_bar, r_bar from a collection beside it. Sanfelice and Praly (25).

    Parameters as in `RepelledCollection`.
    """

    def __init__(
        self,
        gain: AdaptiveGain,
        *,
        k: npt.ArrayLike,
        k_bar: npt.ArrayLike,
        copies: int = 3,
        model: System | None = None,
        method: str = "rk4",
        timing: str = DEFAULT_TIMING,
        allow_unstable: bool = False,
    ) -> None:
        super().__init__("modified", gain, k, k_bar, copies, model, method, timing, allow_unstable)

    @property
    def gain(self) -> float:
        """The gain that acts: r r_bar."""
        return float(self.gains(self.memory))

    def gains(self, memory: npt.ArrayLike) -> Array:
        """The gain that acts, r r_bar, for memories (..., m)."""
        values = np.asarray(memory, dtype=float)
        return np.asarray(values[..., self.n] * self.nominal_gain(values))

    def spread(
        self,
        x_hat0: npt.ArrayLike,
        copies_x_hat0: npt.ArrayLike,
        r0: float = 1.0,
        copies_r0: npt.ArrayLike = 1.0,
    ) -> Array:
        """A memory from the main observer's start (2,) and the copies' starts (copies, 2)."""
        main = [*_vector(x_hat0, "x_hat0", self.n), _initial_gain(r0)]
        return self._held(np.concatenate([main, self._starts(copies_x_hat0, copies_r0)]))


class SampledDataObserver(Observer):
    """Sampled-data observer on an Euler-Maruyama model. Fu, Kang and Li (5).

    x_hat(k+1) = x_hat(k) + T f(x_hat(k)) + K_T(x_hat(k), y(k))

    Parameters
    ----------
    model : VanDerPol, or a Model of sampled-data form
    gain : "derived" or "printed"
        Of VanDerPol: l1 = (5 + mu) T, which gives the error matrix the constant spectrum {-2, -3};
        or the paper's (5 - mu) T. mu = epsilon (1 - y^2).
    """

    def __init__(
        self,
        model: VanDerPol | Model | None = None,
        *,
        gain: str = "derived",
        allow_unstable: bool = False,
    ) -> None:
        known = VanDerPol() if model is None else model
        fits = isinstance(known, VanDerPol) or getattr(known, "form", None) == "sampled"
        remedy = "leave it out, or write Model(states=..., f=[...], K_T=[...])"
        check(fits, "model", model, "a VanDerPol, or a Model of sampled-data form", remedy)
        choice = check_choice("gain", gain, ("derived", "printed"))
        spec = {"kind": "sampled-data", "model": known.spec, "gain": choice}
        super().__init__(spec, model=model, allow_unstable=allow_unstable)


class ReducedOrderObserver(Observer):
    """High-gain reduced-order observer for sampled data. Katayama (8), (22).

    Estimates z (n_z,) of a system in strict-feedback form from samples of its measured states y
    (N, n_x) and its inputs u (N, n_u): of a ship the velocity (3,) from position and heading. It
    filters: the estimate at k uses y(k).

    Parameters
    ----------
    epsilon : float
        Small parameter > 0 [s]; stable for dt < 2 epsilon/max h_bar (A5).
    h_bar : n_z numbers in (0, 1)
        Default: the paper's (0.1, 0.2, 0.2) for the ship, 0.2 each for another model.
    model : Ship, or a Model of strict-feedback form, optional
    """

    def __init__(
        self,
        epsilon: float,
        *,
        h_bar: npt.ArrayLike | None = None,
        model: Ship | Model | None = None,
        allow_unstable: bool = False,
    ) -> None:
        known = Ship() if model is None else model
        ship = isinstance(known, Ship)
        fits = ship or getattr(known, "form", None) == "strict-feedback"
        remedy = "leave it out, or write Model(states=..., f1=[...], g=[...], f2=[...])"
        check(fits, "model", model, "a Ship, or a Model of strict-feedback form", remedy)
        n_z = 3 if ship else known.order or 0
        if h_bar is None:
            h_bar = (0.1, 0.2, 0.2) if ship else np.full(n_z, 0.2)
        spec = {
            "kind": "reduced-order",
            "model": known.spec,
            "h_bar": _vector(h_bar, "h_bar", n_z).tolist(),
            "epsilon": check_number(epsilon, "epsilon", above=0.0),
        }
        super().__init__(spec, model=model, allow_unstable=allow_unstable)


class MultiOutputObserver(Observer):
    """An observer for each output of a model of several chains, which share their states.

    Each observer estimates the chain of its output, x_c1' = x_c2, ..., x_cn' = phi_c(t, x, u), with
    phi_c over the states of all chains; those of the other chains stand at their estimates at the
    beginning of the step. A sample that is missing in one output is predicted over in that output.

    Parameters
    ----------
    observers : sequence of StandardObserver, LowPowerObserver or PeakingFreeObserver
        One for each output, made without a model: structure, gain, discretisation, timing. All of
        the same timing.
    model : Model
        Of the form of chains: `Model(states=..., orders=[n_1, n_2, ...], phi=[phi_1, phi_2, ...])`.
    allow_unstable : bool
        As in `StandardObserver`.

    The memory holds the estimates of all chains, one chain after the other, then the rest of each
    observer's memory. `run` takes y of shape (N, number of chains).

    Raises
    ------
    HgoError
        Observers that do not fit the chains; another form of model.
    """

    def __init__(
        self, observers: Sequence[Observer], *, model: Model, allow_unstable: bool = False
    ) -> None:
        chains = getattr(model, "orders", ())
        remedy = "write Model(states=..., orders=[...], phi=[...])"
        check(bool(chains), "model", model, "a Model of chains", remedy)
        given = tuple(observer.n for observer in observers)
        remedy = "give one observer for each chain, in order"
        check(given == chains, "orders of the observers", given, f"{chains}", remedy)
        specs = []
        for observer in observers:
            free = observer.model is None and observer.spec["kind"] in _CHAIN_KINDS
            remedy = "a StandardObserver, LowPowerObserver or PeakingFreeObserver without a model"
            check(free, "observers", observer, remedy, "the model of all chains is given once")
            specs.append({k: v for k, v in observer.spec.items() if k != "model"})
        same = len({observer.timing for observer in observers}) == 1
        timings = [observer.timing for observer in observers]
        check(same, "timing of the observers", timings, "the same", "give all the same timing=")
        spec = {"kind": "chains", "observers": specs, "model": model.spec}
        super().__init__(spec, model=model, allow_unstable=allow_unstable)


_CHAIN_KINDS = ("standard", "low-power", "peaking-free")

# --- checks -----------------------------------------------------------------------------------


def _lift(spec: dict[str, Any]) -> float:
    """By how much estimates may exceed the samples before a run counts as diverged: start-up peaks
    reach ell^(n-1), Astolfi et al."""
    law, n = spec.get("gain"), spec.get("n", 1)
    ell = law["ell"] if isinstance(law, dict) and "ell" in law else 1.0
    with np.errstate(over="ignore"):
        lifts = [float(np.power(max(1.0, ell), n)), *map(_lift, spec.get("observers", ()))]
    return max(lifts)


def _order(n: Any, least: int = 1) -> int:
    remedy = "choose an integer in this range" + ("; StandardObserver takes 1" if least > 1 else "")
    return check_integer(n, "n", least=least, most=12, remedy=remedy)


def _initial_gain(value: Any) -> float:
    return check_number(value, "r0", least=1.0, remedy="law (6) lives on r >= 1; start at 1")


def _manner(method: str, timing: str) -> dict[str, str]:
    return {
        "method": check_choice("method", method, METHODS),
        "timing": check_choice("timing", timing, TIMINGS),
    }


def _vector(values: npt.ArrayLike, parameter: str, length: int) -> Array:
    vector = check_array(values, parameter)
    if vector.shape != (length,):
        raise HgoError(f"{parameter} of shape {vector.shape}: must have {length} entries")
    check(np.all(np.isfinite(vector)), parameter, values, "finite", "leave out NaN and infinity")
    return vector


def _pairs(poles: Poles, count: int, law: str) -> list[tuple[float, float]]:
    try:
        values = np.asarray(poles, dtype=complex).reshape(-1)
    except (TypeError, ValueError, OverflowError):
        raise HgoError(explain("poles", poles, "complex numbers", f"give {count}")) from None
    if len(values) != count:
        raise HgoError(f"poles: {len(values)} given; {law} needs {count}")
    for p in values:
        stable = np.isfinite(p) and p.real < 0.0
        remedy = "place it in the open left half plane"
        check(stable, "poles", complex(p), "finite with a negative real part", remedy)
        paired = np.sum(values == p) == np.sum(values == p.conjugate())
        remedy = "give both, or real poles"
        check(paired, "poles", complex(p), "accompanied by its complex conjugate", remedy)
    return [(float(p.real), float(p.imag)) for p in values]


def _coefficients(n: int, poles: Poles | None, k: npt.ArrayLike | None) -> list[float]:
    if k is not None:
        check(poles is None, "k", k, "given without poles", "give poles or k")
        return _hurwitz(_vector(k, "k", n).tolist())
    given = np.linspace(-1.0, -2.0, n) if poles is None else poles
    pairs = _pairs(given, n, f"an observer of order {n}")
    return _hurwitz(_core.coefficients_from_poles(pairs))


def _hurwitz(k: list[float]) -> list[float]:
    allowed = "such that s^n + k_1 s^(n-1) + ... + k_n has all roots in the left half plane"
    check(_core.is_hurwitz(k), "k", k, allowed, "give poles in its place")
    return k


def _low_power(
    kind: str,
    n: int,
    gain: Gain | None,
    epsilon: float | None,
    poles: Poles | None,
    alpha: npt.ArrayLike | None,
    beta: npt.ArrayLike | None,
    model: System | None,
    method: str | None,
    timing: str,
) -> dict[str, Any]:
    """What (5) and (11) share, as a spec."""
    n = _order(n, least=2)
    a, b = _low_power_coefficients(n, poles, alpha, beta)
    law = _gain(gain, epsilon)
    usual = DEFAULT_METHOD if law["law"] == "constant" else "rk4"
    return {
        "kind": kind,
        "n": n,
        "alpha": a,
        "beta": b,
        "gain": law,
        "model": _model(model, n),
        **_manner(usual if method is None else method, timing),
    }


def _low_power_coefficients(
    n: int, poles: Poles | None, alpha: npt.ArrayLike | None, beta: npt.ArrayLike | None
) -> tuple[list[float], list[float]]:
    if (alpha is None) != (beta is None) or (alpha is not None and poles is not None):
        raise HgoError("alpha and beta: must be given together and without poles")
    if alpha is not None and beta is not None:
        return _vector(alpha, "alpha", n).tolist(), _vector(beta, "beta", n - 1).tolist()
    given = np.append(np.linspace(-1.0, -2.0, 2 * n - 2), -2.0) if poles is None else poles
    pairs = _pairs(given, 2 * n - 1, f"a low-power observer of order {n}")
    return _core.low_power_coefficients_from_poles(pairs)


def _gain(gain: Gain | None, epsilon: float | None) -> dict[str, Any]:
    if (gain is None) == (epsilon is None):
        raise HgoError("gain: give either gain [1/s] or epsilon = 1/gain [s]")
    if epsilon is not None:
        return ConstantGain.from_epsilon(epsilon).spec
    if isinstance(gain, (ConstantGain, AdaptiveGain, DeadZoneGain)):
        return gain.spec
    return ConstantGain(check_number(gain, "gain", above=0.0)).spec


def _model(model: System | None, n: int) -> dict[str, Any]:
    known = Unknown() if model is None else model
    check(
        isinstance(known, System), "model", model, "a Model or another System", "see hgo_rs.models"
    )
    fits = known.order in (None, n) and not isinstance(known, Ship)
    remedy = f"its order is {known.order}"
    if isinstance(known, Ship):
        remedy = "a ship is for ReducedOrderObserver"
    check(fits, "model", model, f"of order {n}", remedy)
    return known.spec


def _saturation(levels: npt.ArrayLike, n: int, model: System | None) -> list[float]:
    values = check_array(levels, "saturation")
    if values.ndim == 0:
        values = np.full(n - 1, float(values))
    values = _vector(values, "saturation", n - 1)
    bounds = (None if model is None else model.bounds) or (0.0,) * n
    for i, (value, bound) in enumerate(zip(values, bounds[1:], strict=False), start=2):
        least = f">= {bound:g}, the model's own bound of |x_{i}|" if bound else "> 0"
        check(
            value > 0.0 and value >= bound,
            f"saturation r_{i}",
            float(value),
            least,
            "Astolfi et al. (10); choose a larger level",
        )
    return [float(v) for v in values]


def _row(values: Array) -> str:
    return ", ".join(f"{value:.6g}" for value in values)


def _short(text: str) -> str:
    return text if len(text) <= 80 else f"{text[:77]}..."


def _floats(values: npt.ArrayLike, parameter: str, remedy: str = "give numbers") -> Array:
    """As `check_array`, but an array of floats is taken as it is."""
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    return check_array(values, parameter, remedy=remedy)


def _samples(y: npt.ArrayLike, n_y: int) -> Array:
    """Samples (N, n_y), NaN where missing; what they hold is still to be checked."""
    if isinstance(y, (list, tuple)) and n_y > 1:
        y = [[np.nan] * n_y if row is None else row for row in y]
    values = _floats(y, "y", _MARK)
    if values.ndim == 1 and n_y == 1:
        values = values[:, np.newaxis]
    if values.ndim != 2 or values.shape[1] != n_y or len(values) == 0:
        wanted = "(N,)" if n_y == 1 else f"(N, {n_y})"
        raise HgoError(f"y of shape {values.shape}: must be {wanted} with N >= 1")
    return values


def _check_samples(values: Array, channels: int) -> None:
    if values.shape[-1] != channels:
        raise HgoError(f"y has {values.shape[-1]} entries: must have {channels}")
    infinite = np.isinf(values).any(axis=1)
    if infinite.any():
        k = int(np.argmax(infinite))
        raise HgoError(f"y at sample {k} is infinite: must be finite; {_MARK}")


def _clock(t_or_dt: npt.ArrayLike, count: int) -> float | Array:
    """A sampling period, or times (N,) that are still to be checked."""
    given = _floats(t_or_dt, "t_or_dt")
    if given.ndim == 0:
        period = check_number(float(given), "dt", above=0.0)
        allowed = f"such that {count} samples end at a finite time"
        ends = np.isfinite((count - 1) * period)
        check(ends, "dt", period, allowed, "choose a smaller one")
        return period
    if given.shape != (count,):
        raise HgoError(f"t of shape {given.shape}: must be ({count},), one time a sample")
    return given


def _after(until: float, clock: float | Array, count: int) -> float:
    """A time after the last sample."""
    end = check_number(until, "until")
    last = clock * (count - 1) if isinstance(clock, float) else float(clock[-1])
    check(
        end > last, "until", until, f"after the last sample, > {last:.9g} s", "give the next time"
    )
    return end


def _check_times(clock: float | Array) -> None:
    t = np.atleast_1d(clock)
    bad = ~np.isfinite(t)
    if bad.any():
        raise HgoError(f"t at sample {int(np.argmax(bad))} is not finite: every sample needs one")
    backward = t[1:] <= t[:-1]
    if backward.any():
        k = int(np.argmax(backward)) + 1
        raise HgoError(
            f"t at sample {k} is {t[k]:.9g} s after {t[k - 1]:.9g} s: time must increase; "
            "sort the record or drop repeated samples"
        )


def _inputs(u: npt.ArrayLike | None, count: int, n_u: int) -> Array:
    """Inputs (N, n_u); what they hold is still to be checked."""
    if n_u == 0:
        if u is not None and np.size(u) > 0:
            raise HgoError(
                "u is given, but this observer's model has no input: give it one, for example "
                "model=InputGain(b0)"
            )
        return np.empty((count, 0))
    if u is None:
        raise HgoError(f"u is missing: this observer's model has {n_u} known input(s)")
    values = _floats(u, "u")
    if values.ndim < 2 and values.size == count * n_u and 1 in (count, n_u):
        values = values.reshape(count, n_u)
    if values.shape != (count, n_u):
        raise HgoError(f"u of shape {values.shape}: must be ({count}, {n_u})")
    return values


def _check_inputs(u: Array) -> None:
    bad = ~np.isfinite(u).all(axis=1)
    if bad.any():
        raise HgoError(f"u at sample {int(np.argmax(bad))} is not finite: every sample needs one")
