"""The derivative of a record, for those who want nothing else."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hgo_rs import signals
from hgo_rs.design.discrete import following
from hgo_rs.design.response import innovation_gain
from hgo_rs.errors import HgoError, check, check_array, check_integer, check_number, need
from hgo_rs.observers import Observer, RunResult, StandardObserver
from hgo_rs.observers.whiteness import normal_width
from hgo_rs.smoothing.deviation import deviation
from hgo_rs.smoothing.samples import Array, Samples
from hgo_rs.times import check_period, clock_of, is_clock
from hgo_rs.tuning import Tuning, tune
from hgo_rs.tuning.linear import stationary
from hgo_rs.tuning.reference import butterworth
from hgo_rs.tuning.reversal import signs

_LEAST = 50  # samples of a record that is to tell its noise by itself
_HIGHEST = 8
_EXACT = 16.0  # roundings of y, which third differences of an exact line or parabola stay below
_EVEN = 1e-6  # of the step, that those of an even clock may be off
_ENDS = 20  # part of a record that is left out at both ends where its sides are compared
_SPAN, _POINTS = (1e-2, 5.0), 41  # of ell dt
_NEAR = 1e-2  # of the median step, that a period given beside an index may be off it


@dataclass(frozen=True, eq=False, repr=False)
class Derivative:
    """A derivative of a record, and the observer that gave it.

    Attributes
    ----------
    derivative : (N,) [unit of y / s^order]
        At each sample, of the samples up to it.
    deviation : (N,) [unit of y / s^order]
        Its standard deviation.
    t : (N,) [s]
    order : int
    x_hat : (N, n)
        The filtered y and its derivatives up to n - 1 >= order.
    noise : float
        Standard deviation of the noise of y: given, or estimated from the record.
    observer : Observer
        The observer: `step` gives the same derivative online, `export` source code for a chip.
    tuning : Tuning or None
        The choice of structure and gain; None where the noise was given.
    """

    derivative: Array
    deviation: Array
    t: Array
    order: int
    x_hat: Array = field(repr=False)
    noise: float
    observer: Observer
    tuning: Tuning | None = field(repr=False)
    run: RunResult = field(repr=False)
    index: Any = field(repr=False, default=None)

    def __repr__(self) -> str:
        usual = float(np.sqrt(np.mean(self.deviation**2)))
        told = f"order {self.order}, {len(self.t)} samples, deviation {usual:.4g}"
        return f"Derivative({told}; {self.observer!r})"

    def band(self, level: float = 0.95) -> tuple[Array, Array]:
        """Lower and upper ends, (N,) each, between which the derivative lies with this
        probability.
        """
        wide = normal_width(level) * self.deviation
        return self.derivative - wide, self.derivative + wide

    def to_dataframe(self) -> Any:
        """A pandas DataFrame with columns `derivative` and `deviation`, by the index of the Series
        that was given, or by time. Needs the extra `data`.
        """
        pd = need("pandas", "a table needs pandas", "data")
        index = pd.Index(self.t, name="time") if self.index is None else self.index
        return pd.DataFrame(
            {"derivative": self.derivative, "deviation": self.deviation}, index=index
        )

    def plot(self, figure: Any = None) -> Any:
        """Draw samples, estimates and gain: see `RunResult.plot`. Needs the extra `plot`."""
        return self.run.plot(figure)


def differentiate(
    y: Any, dt: Any = None, order: int = 1, noise: float | None = None, *, t: Any = None
) -> Derivative:
    """The derivative of a record, with its standard deviation, by an observer tuned on it.

    Each value uses the samples up to its own, so the observer gives the same online; the first
    value comes from the same observer, run backwards over the record. If all samples are known,
    `smooth(None, (t, y))` has smaller errors.

    Parameters
    ----------
    y : (N,)
        Samples; NaN or None is missing. The index of a pandas Series gives the times: dates,
        durations or floats [s].
    dt : float [s], timedelta or pandas Timedelta, optional
        Sampling period.
    order : int
        Of the derivative, 1 to 8.
    noise : float, optional
        Standard deviation of the noise of y, white from sample to sample; 0 for rounding only.
        Default: estimated from the record; structure and gain are then those of `tune(None, (t,
        y))`.
    t : (N,), optional
        Increasing times [s], dates or durations, in place of `dt`.

    Returns
    -------
    Derivative

    Warns
    -----
    TuningWarning
        As `tune`.

    Raises
    ------
    HgoError
        No times, or two that differ; times that do not increase; fewer than 50 samples, or 20 with
        `noise`; a record without measurable noise.
    """
    order = check_integer(order, "order", least=1, most=_HIGHEST)
    values, clock, index = _record(y, dt, t)
    samples = Samples.of((clock, values), 1, 0)
    period = clock if isinstance(clock, float) else samples.usual(0)
    known = math.nan if noise is None else check_number(noise, "noise", least=0.0)
    there = samples.y[np.isfinite(samples.y[:, 0]), 0]
    rounding = float(np.finfo(np.float64).eps * np.max(np.abs(there)))
    rounding = max(rounding, float(np.finfo(np.float64).tiny) ** 0.25)
    if noise is None:
        remedy = "give noise=, the standard deviation of y's noise, or a longer record"
        check(len(there) >= _LEAST, "samples", len(there), f">= {_LEAST} without noise=", remedy)
        if math.sqrt(samples.noise(0)) <= _EXACT * rounding:
            known = 0.0
    tuning, scale = None, 1.0
    if known != known:
        try:
            tuning = tune(None, (clock, values), state=order + 1)
        except HgoError as error:
            raise HgoError(
                f"noise = None: must be found in the record ({error}); give noise=, the standard "
                "deviation of y's noise, or 0"
            ) from error
        observer, lack = tuning.observer, tuning.model_error
        level = tuning.noise if tuning.noise > rounding else rounding
        lack = lack if lack > 0.0 else 0.0
        shown = np.diag(_covariance(observer, period, level, lack)[1])[order]
        scale = float(tuning.errors[order] / math.sqrt(shown))
    else:
        level = max(known, rounding)
        observer, lack = _chosen(samples, clock, period, order, level)
        scale = _differing(observer, samples, clock, period, order, level, lack)
    before, after = _covariance(observer, period, level, lack)
    run = observer.run(clock, samples.y[:, 0], memory0=_start(observer, samples))
    even = np.ptp(samples.dt) <= _EVEN * period and not samples.missing.any()
    if even:
        spread = np.broadcast_to(np.sqrt(np.diag(after)), run.x_hat.shape)
    else:
        turn = signs((observer.n,))
        p0 = before * np.outer(turn, turn)
        spread = deviation(observer, run, samples.u, level, lack, p0)
    return Derivative(
        derivative=np.array(run.x_hat[:, order]),
        deviation=scale * spread[:, order],
        t=samples.t,
        order=order,
        x_hat=np.array(run.x_hat),
        noise=level if known != 0.0 else 0.0,
        observer=observer,
        tuning=tuning,
        run=run,
        index=index,
    )


def _covariance(observer: Observer, dt: float, noise: float, lack: float) -> tuple[Array, Array]:
    """Of the error at rest, (n, n): before a sample is used, and of the estimate."""
    found = stationary(observer.spec, dt)
    before, shown = (noise**2 * p[0] + lack**2 * p[1] for p in (found.before, found.shown))
    return np.asarray(before), np.asarray(shown)


def _start(observer: Observer, samples: Samples) -> Array:
    """The memory of a start where the observer ends that runs backwards, all samples but the first
    one used.
    """
    y = samples.y[::-1, 0].copy()
    y[-1] = np.nan
    run = observer.run(samples.t[-1] - samples.t[::-1], y, start="first-sample")
    return _following(observer, run.x_hat[-1] * signs((observer.n,)))


def _following(observer: Observer, x: Array) -> Array:
    """The memory of an observer that has followed the state x."""
    memory, lift = observer.initial_memory(x), following(observer.spec)
    memory[: len(lift)] = lift @ x
    return memory


def _chosen(
    samples: Samples, clock: float | Array, dt: float, order: int, noise: float
) -> tuple[Observer, float]:
    """The observer that predicts the next sample best, and sqrt(Q), for a noise that is known.

    Its innovation tells Q: S = R s_R + Q s_Q.
    """
    y, best, least = samples.y[:, 0], None, math.inf
    for n in (order + 1, order + 2):
        for ell in (np.geomspace(*_SPAN, _POINTS) / dt).tolist():
            observer = StandardObserver(n, ell, poles=butterworth(n))
            run = observer.run(clock, y, memory0=_start(observer, samples))
            square = float(np.nanmean(run.innovation**2))
            if square < least:
                best, least = observer, square
    assert best is not None
    of_noise, of_lack = innovation_gain(best.spec, dt)
    return best, math.sqrt(max(least - noise**2 * of_noise, 0.0) / of_lack)


def _differing(
    observer: Observer,
    samples: Samples,
    clock: float | Array,
    dt: float,
    order: int,
    noise: float,
    lack: float,
) -> float:
    """What the estimates from both sides of a sample differ by, over what R and Q say, if more.

    What is not white in the record, as a slow swing of y, makes the error so much larger.
    """
    past = observer.run(clock, samples.y[:, 0], memory0=_start(observer, samples)).x_hat
    back = samples.t[-1] - samples.t[::-1]
    turn, other = signs((observer.n,)), observer.with_timing("predictor")
    begin = _following(other, turn * past[-1])
    ahead = other.run(back, samples.y[::-1, 0], memory0=begin)
    future = (ahead.x_hat * turn)[::-1]
    some = slice(len(past) // _ENDS, -(len(past) // _ENDS))
    square = np.mean((past - future)[some, order] ** 2)
    before, after = _covariance(observer, dt, noise, lack)
    return max(1.0, float(np.sqrt(square / (before + after)[order, order])))


def _record(y: Any, dt: Any, t: Any) -> tuple[Any, float | Array, Any]:
    """Samples, their period or times [s], and the index that they came with."""
    check(t is None or dt is None, "dt, t", (dt, "times"), "one of them", "leave one out")
    index = getattr(y, "index", None)
    index = index if hasattr(index, "to_numpy") else None
    counts = index is not None and index.dtype.kind in "iu"
    if t is not None:
        return y, clock_of(t) if is_clock(t) else _numbers(t), index
    if signals.is_record(y) and not counts:
        times, values, _ = signals.arrays(y)
        times = _numbers(times)
        if dt is not None:
            period, usual = check_period(dt), float(np.median(np.diff(times)))
            fits = abs(period - usual) <= _NEAR * usual
            allowed = f"{usual:.6g} s, the median step of the index of y"
            check(fits, "dt", dt, allowed, "leave it out, or give y without its index")
        return values, times, index
    remedy = "give dt=, the sampling period in s, or t=, the times"
    told = "given" if index is None else "given with an index that counts rows"
    check(dt is not None, "dt", dt, told, remedy)
    return y, check_period(dt), index


def _numbers(t: Any) -> Array:
    return check_array(t, "t", remedy="give seconds, dates or durations")
