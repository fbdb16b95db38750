"""An observer: `step` on line, `run` over a record, and what its law does to noise and errors.

Law and memory are apart: an object holds an immutable `spec` (what it is) and one memory (where it
stands) that `step` moves. `run` works on a memory of its own and leaves the object's alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from hgo_rs import _core, upward
from hgo_rs.design.discrete import TIMINGS
from hgo_rs.design.discretisation import StepLimit, step_limit
from hgo_rs.design.response import bandwidth, noise_gain, peaking, settling
from hgo_rs.errors import DesignError, HgoError, check, check_choice, check_flag
from hgo_rs.llvm import OF_FUNCTIONS, check_engine, refused
from hgo_rs.models import Model
from hgo_rs.models.own.callables import clocked, stand_in, warn_slow
from hgo_rs.observers import records
from hgo_rs.observers.compiled import RecordEngine
from hgo_rs.observers.gaps import gap_error
from hgo_rs.observers.labels import Labels
from hgo_rs.observers.online import TAMER, OnlineObserver
from hgo_rs.observers.records import INPUT_HOLDS, STARTS, Array
from hgo_rs.observers.result import Gap, RunResult
from hgo_rs.observers.told import as_html, shortly
from hgo_rs.observers.turns import check_motion
from hgo_rs.read_only import shown as frozen
from hgo_rs.signals import arrays

_OVERFLOW = "choose a smaller step or gain, another method, or fewer samples"


class Observer(OnlineObserver):
    """An observer of the compiled core. Use one of its subclasses.

    Attributes
    ----------
    spec : dict
        The observer as plain data, read-only.
    n, n_y, n_u : int
        Numbers of estimated states, measured outputs, known inputs.
    timing : "predictor" or "current"
        Whether the estimate at sample k uses samples up to k - 1, or up to k.
    wrap : tuple
        The turn of each output, None where it does not wrap.
    memory : (m,) ndarray
        The present memory: x_hat, then auxiliary states, then the gain r where it moves; with
        current timing last the interval that the next correction covers [s]. A step makes a new
        array; an assigned array is copied and does not change the clock. `reset(memory0=...,
        t=...)` continues from the memory of another observer.
    model : System or None
        The model; None: none, or the default of the class.
    allow_unstable : bool
        Let `step` and `run` use a step beyond the stability limit.
    """

    def run(
        self,
        t_or_dt: Any,
        y: Any = None,
        u: Any = None,
        *,
        x_hat0: npt.ArrayLike | None = None,
        r0: float | None = None,
        memory0: npt.ArrayLike | None = None,
        until: float | None = None,
        start: str = "zero",
        timing: str | None = None,
        input_hold: str = "previous",
        allow_unstable: bool | None = None,
        engine: str = "auto",
        noise: npt.ArrayLike | None = None,
        model_error: npt.ArrayLike | None = None,
        gate: float | None = None,
    ) -> RunResult:
        """Run over a record of N samples.

        Predictor timing: row k of the result uses samples up to k - 1; current timing: up to k, by
        `correct(y[k])`, after which `predict(u[k], dt)` moves to the next row, with the bits of
        these calls. Uneven steps are used as they are.

        Parameters
        ----------
        t_or_dt : float, (N,), or a record
            Sampling period, or the increasing times of the samples: seconds, dates or durations. Or
            a record with times and samples: a `Log`, a frame, or a series with times as index; y
            and u are then names of columns of a frame, by default all columns are outputs.
        y : (N,) or (N, n_y)
            Samples; None or NaN is missing: the law predicts, and `missing` marks it.
        u : (N,) or (N, n_u), optional
            Known inputs, each held until the next sample by default; see `input_hold`.
        x_hat0, r0, memory0 : optional
            The start, see `initial_memory`; or the whole memory before the first sample.
        until : float, optional
            Time [s] of the sample after the last one, if the record continues: `next_memory` of the
            result is the memory there, a `memory0` for the next run.
        start : "zero" or "first-sample"
            Start without x_hat0 and memory0: 0, or x_hat_1 at the first present sample of each
            output and the rest at 0. A record far from 0 then makes no peak. A reduced-order
            observer always begins at its first sample.
        timing : "predictor" or "current", optional
            Default: that of the observer.
        input_hold : "previous" or "mean"
            The input over a period: its value at the beginning, for an actuator that holds it, or
            the mean of both ends, for an input that is measured and changes. The mean needs current
            timing.
        allow_unstable : bool, optional
            Run at a step beyond the stability limit. Default: the constructor's choice.
        engine : "auto", "interpreter" or "llvm"
            The engine, with the same bits: "auto" compiles the step by LLVM (extra `fast`) after
            enough samples, some millions for a law of order two.
        noise, model_error : float or (n_y,), optional
            Standard deviations, not variances, as estimated by `tune`, for `deviation` of the
            result: sqrt(R) of the noise of a sample [unit of y], and sqrt(Q), Q the intensity of
            white noise in the last state of each chain [its unit per sqrt(s)].
        gate : float, optional
            With noise and model error: a sample whose innovation exceeds this number of its
            standard deviations is an outlier; it counts as missing and is marked in `gated`. The
            test runs in Python.

        Raises
        ------
        HgoError
            Shapes that do not fit; NaN or infinity in t or u, infinity in y; time that does not
            increase; a step at or above the stability limit; an estimate that diverged;
            `engine="llvm"` where llvmlite is missing or the observer cannot be compiled.
        """
        t_or_dt, y, u = arrays(t_or_dt, y, u)
        if timing is not None and check_choice("timing", timing, TIMINGS) != self.timing:
            given: dict[str, Any] = {"x_hat0": x_hat0, "r0": r0, "memory0": memory0}
            given |= {
                "until": until,
                "start": start,
                "input_hold": input_hold,
                "allow_unstable": allow_unstable,
                "noise": noise,
                "model_error": model_error,
                "gate": gate,
                "engine": engine,
            }
            return self.with_timing(timing).run(t_or_dt, y, u, **given)
        allow = self.allow_unstable
        if allow_unstable is not None:
            allow = check_flag(allow_unstable, "allow_unstable")
        check_engine(engine)
        samples = records.samples(y, self.n_y)
        clock = records.clock(t_or_dt, len(samples))
        told = records.inputs(u, len(samples), self.n_u)
        applied = told
        if check_choice("input_hold", input_hold, INPUT_HOLDS) == "mean":
            remedy = 'take timing="current", or give the means as u'
            allowed = "'previous' with predictor timing"
            check(self._core.is_current, "input_hold", input_hold, allowed, remedy)
            applied = records.averaged(told)
        if check_choice("start", start, STARTS) == "first-sample":
            given = {"x_hat0": x_hat0, "memory0": memory0}
            for name, value in given.items():
                remedy = 'leave it out, or take start="zero"'
                check(value is None, name, value, 'left out with start="first-sample"', remedy)
            begin = self._begun(self.initial_memory(r0=r0), records.first_of(samples))
        else:
            begin = self._start(x_hat0, r0, memory0)
        if memory0 is None:
            self._check_start(begin, told=False)
        outliers = None
        if gate is not None:
            records.check_samples(samples, self.n_y)
            records.check_times(clock)
            records.check_inputs(told)
            known = (noise, model_error, gate)
            outliers = upward.call("gated", self, clock, samples, applied, begin, *known)
            samples = np.where(outliers, np.nan, samples)
        # elsewhere the innovation is y - x_hat_1, which is computed when it is asked for
        own_sampled = self.spec["kind"] == "sampled-data" and self.spec["model"]["kind"] == "own"
        tells = self._core.is_current or self.spec["kind"] == "chains" or own_sampled
        wraps = any(self.wrap)
        tells |= wraps
        end = None if until is None else records.after(until, clock, len(samples))
        slowdown = 1.0
        if self._interpreted:
            refused(engine == "llvm", OF_FUNCTIONS)
            record = (clock, samples, applied, begin)
            track, slowdown = self._called_run(*record, innovation=tells, until=end)
        else:
            record = (clock, samples, applied, begin)
            track = self._records.run(engine, record, innovation=tells, until=end)
        if not track["sound"]:
            records.check_samples(track["y"], self.n_y)
            records.check_times(clock)
            records.check_inputs(told)

        def time(k: int) -> float:
            return clock * k if isinstance(clock, float) else float(clock[k])

        self._check_clock(clock)
        k, longest = track["longest_step"]
        where = f"after sample {k} (t = {time(k):g} s), " if np.ndim(clock) else ""
        steps: list[tuple[str, float, Mapping[str, Any]]]
        steps = [(where, longest, self.spec)] if longest > 0.0 else []
        for k, longest, law in self._partly(track["y"], track["missing"], clock, end):
            steps.append((f"after sample {k} (t = {time(k):g} s), ", longest, law))
        for at, law, outputs in self._waiting:
            # the first sample corrects over the time that its begin has waited
            waited, missing = float(begin[at]), np.isnan(track["y"][0, outputs]).all()
            if waited > 0.0 and not missing:
                steps.append((f"before sample 0 (t = {time(0):g} s), ", waited, law))
        for where, length, law in steps:
            try:
                self._check_dt(length, allow, law)
            except DesignError as error:
                raise DesignError(f"{where}{error}") from None
        memory = track["memory"]
        bound = self._bound(float(np.max(np.abs(begin))), track["largest_sample"])
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
            raise HgoError(f"the estimate diverged at sample {k} (t = {time(k):g} s): {TAMER}")
        finite = [*np.isfinite(memory[diverged:]).all(axis=1)]
        finite += [] if end is None else [np.isfinite(track["next"]).all()]
        if not all(finite):
            k = diverged + finite.index(False)
            where = f"sample {k} (t = {time(k):g} s)" if k < len(memory) else f"t = {end:g} s"
            raise HgoError(f"the estimate overflowed at {where}: {_OVERFLOW}")
        self._tell_end(begin, memory[-1])
        if wraps:
            check_motion(track["y"], self.wrap, stacklevel=2)
        result = RunResult.of_run(
            clock,
            track.get("innovation"),
            x_hat=memory[:, : self.n],
            auxiliary=self._auxiliary(memory),
            missing=track["missing"],
            gain=self.gains(memory),
            y=track["y"],
            memory=memory,
            timing=self.timing,
        )
        result.__dict__["slowdown"] = slowdown
        result.__dict__["labels"] = Labels.of(self.spec, self.n)
        result.__dict__["next_memory"] = None if until is None else frozen(track["next"])
        if outliers is not None:
            result.__dict__["gated"] = frozen(outliers)
        if noise is not None or model_error is not None:
            both = noise is not None and model_error is not None
            remedy = "hgo_rs.tune finds both in a log"
            check(both, "noise, model_error", (noise, model_error), "given together", remedy)
            self._deviate(result, applied, noise, model_error)
        if track["missing"].any():  # for the error to expect after the gaps
            result.__dict__["_run_of"] = (self, applied.copy())
        return result

    def _partly(
        self, y: Array, missing: Array, clock: float | Array, end: float | None
    ) -> Iterator[tuple[int, float, Mapping[str, Any]]]:
        """The longest step over which each chain corrects by samples that miss other outputs: the
        sample at which it begins, its length [s], the chain's law.
        """
        partly = missing[:, None] & ~np.isnan(y)
        if self.spec["kind"] != "chains" or not partly.any():
            return
        t = clock * np.arange(len(y)) if isinstance(clock, float) else clock
        steps = np.full(len(y) - 1, clock) if isinstance(clock, float) else np.diff(t)
        if self._core.is_current:  # a filter corrects at a step's end
            corrected = partly[1:]
        else:
            steps = steps if end is None else np.append(steps, end - t[-1])
            corrected = partly[: len(steps)]
        for law, by in zip(self.spec["observers"], corrected.T, strict=True):
            if by.any():
                k = int(np.argmax(np.where(by, steps, 0.0)))
                yield k, float(steps[k]), law

    @cached_property
    def _records(self) -> RecordEngine:
        return RecordEngine(self._core)

    def _deviate(self, result: RunResult, u: Any, noise: Any, model_error: Any) -> None:
        """Give a result of this observer its deviations; u as it was applied."""
        u = records.inputs(u if self.n_u else None, len(result.y), self.n_u)
        spread = upward.call("deviation", self, result, u, noise, model_error)
        result.__dict__["deviation"] = frozen(spread)

    def _gap_error(self, result: RunResult, u: Array, gaps: Sequence[Gap]) -> Array:
        """What gaps cost a result of this observer, (number of gaps, n)."""
        if self._interpreted:
            return np.full((len(gaps), self.n), np.nan)
        return gap_error(self._core, self.spec, result, u, gaps, index=self._gain_index())

    def _called_run(self, *record: Any, **options: Any) -> tuple[dict[str, Any], float]:
        """The track of a model of Python functions, and by how much it is slower than a compiled
        model of its size.
        """
        model, count = cast("Model", self.model), len(record[1])
        track, called = clocked(lambda: self._core.run(*record, **options))
        compiled = _core.Observer(stand_in(self.spec, model))
        _, fast = clocked(lambda: compiled.run(*record, **options))
        return track, warn_slow(model, fast / count, called / count, "run")

    def step_limit(self) -> StepLimit:
        """The largest stable step of this law under its discretisation, computed."""
        return step_limit(self.spec)

    def export(self, *, to: str, out: str | Path, **options: Any) -> list[Path]:
        """Write this observer as source code, Arduino library or FMU: see `hgo_rs.export`."""
        return cast("list[Path]", upward.call("export", self, to=to, out=out, **options))

    def to_control(self, dt: float, *, name: str = "observer") -> Any:
        """This law as a discrete-time system of the package `control`: see
        `hgo_rs.exports.control.to_control`.
        """
        return upward.call("to_control", self, dt, name=name)

    def bandwidth(self, dt: float | None = None, *, gain: float | None = None) -> Array:
        """Cutoff of each estimate [rad/s], (n,): -3 dB against the ideal derivative of y.

        Parameters
        ----------
        dt : float, optional
            Step [s]: the observer as it runs, by its method and timing. Default: the law in
            continuous time.
        gain : float, optional
            Value of a gain that moves [1/s]. Default: its present value.

        Raises
        ------
        HgoError
            A step that is not stable; a law of several chains. See `hgo_rs.design.bandwidth`.
        """
        return bandwidth(self.spec, dt, gain=self._frozen(gain))

    def noise_gain(self, dt: float | None = None, *, gain: float | None = None) -> Array:
        """Variance of each estimate per unit variance of white measurement noise, (n,).

        Unit of entry i: s^(-2(i-1)); of an unknown its own, with the slope at the present estimate.
        Exact, from a Lyapunov equation, without the model. Without `dt` per unit spectral density,
        the limit of noise_gain(dt)/dt.
        Parameters and errors as in `bandwidth`; see `hgo_rs.design.noise_gain`.
        """
        return self._in_units(noise_gain(self.spec, dt, gain=self._frozen(gain)), 2)

    def peaking(self, dt: float | None = None, *, gain: float | None = None) -> Array:
        """Largest error of each estimate over time for x_hat_1 wrong by 1 at the start, (n,).

        Unit of entry i: s^(-(i-1)); it grows as ell^(i-1). An unknown is in its own, with the slope
        at the present estimate.
        Parameters and errors as in `bandwidth`; see `hgo_rs.design.peaking`.
        """
        return self._in_units(peaking(self.spec, dt, gain=self._frozen(gain)), 1)

    def _in_units(self, figures: Array, power: int) -> Array:
        """Figures of a chain, of an unknown in its own unit: over a power of its slope."""
        return np.asarray(figures / self.units**power)

    @property
    def units(self) -> Array:
        """Factors from an estimate to the unit of a state of a chain, (n,).

        1 for each state, for an unknown the size of its slope at the present estimate; of a
        nonlinear chain the product of the slopes.
        """
        model = self.model
        if not isinstance(model, Model) or not model.sloped:
            return np.ones(self.n)
        return np.abs(model.slopes_at(self.memory[: self.n]))

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

    def save(self, path: str | Path, **log: Any) -> None:
        """Write an `observer.toml` of this observer and its present memory.

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
        upward.call("save", self, path, **log)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({shortly(self.spec, self.model)})"

    def _repr_html_(self) -> str:
        return as_html(self)
