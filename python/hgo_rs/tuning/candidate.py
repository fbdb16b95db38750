"""Choosing a gain, and a structure, from a log or from what is known of the noise.

A larger gain follows faster and passes more noise. `tune` computes that trade-off over the gain and
marks the point that is asked for: a cutoff frequency, a settling time, or the least mean-square
error against noise and model error together.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from hgo_rs.design.discretisation import step_limit
from hgo_rs.design.response import (
    bandwidth,
    innovation_covariance,
    innovation_gain,
    model_gain,
    noise_gain,
    peaking,
    settling,
)
from hgo_rs.errors import (
    HgoError,
    MissingExtraError,
    check,
    check_array,
    check_integer,
    check_number,
    explain,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hgo_rs.observers import Observer

__all__ = ["TradeOff", "Tuning", "TuningWarning", "tune"]

Array = npt.NDArray[np.float64]
Build = Callable[[float], "Observer"]
"""An observer with the gain given [1/s]."""

_POINTS = 41
_SPAN = 1e-3, 5.0  # of ell dt; beyond, an observer is all but deadbeat
_NEAR = 2.0  # innovations up to this many times the least variance tell of noise and model error
_LAGS = 20  # of the innovations' autocorrelation
_FAR = 500  # lags after which what R and Q give of it has died out
_LEVEL = 1e-3  # of the test that they are white
# What is not white is said where it reaches the choice: see `_Candidate.doubts`.
_MISFIT, _CORRELATED = 0.15, 1.5
_DITHER = 1.2  # noise up to this many times step/sqrt(12) is rounding and little else


class TuningWarning(UserWarning):
    """What `tune` cannot know from what it was given, so that its choice may be off."""


@dataclass(frozen=True, eq=False)
class TradeOff:
    """What one structure does at each gain `ell`, all (points,), for the estimate `tune` was asked
    about. Gains that were refused are not in it.

    Attributes
    ----------
    ell : [1/s]
    bandwidth : [rad/s]
        See `Observer.bandwidth`; infinite where it has no cutoff below the Nyquist frequency.
    settling : [s]
    peaking
        Largest error after a start with x_hat_1 wrong by 1.
    noise
        Standard deviation of the estimate from measurement noise; NaN if the noise is not known.
    model
        Standard deviation of its error from what the model lacks; NaN if that is not known.
    innovation
        RMS of y - y_hat, before the sample is used, over the log; NaN without a log.
    """

    ell: Array
    bandwidth: Array
    settling: Array
    peaking: Array
    noise: Array
    model: Array
    innovation: Array

    @property
    def error(self) -> Array:
        """Standard deviation of the error: noise and model error together."""
        return np.asarray(np.hypot(self.noise, self.model))


@dataclass(frozen=True, eq=False)
class Tuning:
    """A gain, why it was chosen, and the trade-off it was chosen from.

    Attributes
    ----------
    observer : Observer
        The chosen one.
    ell : float [1/s]
    structure : str
        Its name, where several were offered.
    state : int
        The estimate that the choice is about, 1 to n.
    criterion : str
    noise : float
        Standard deviation of the measurement noise: given, or found in the log; NaN if unknown.
    model_error : float
        Square root of the spectral density of what x_n' lacks: given, or found in the log; NaN if
        unknown.
    point : dict
        The columns of `TradeOff`, and `error`, at the chosen gain.
    curves : dict
        A `TradeOff` a structure.
    whiteness : float
        On a log, how probable autocorrelations of the innovation as large as those at the chosen
        gain are (20 lags, a portmanteau test), if noise and model error are white;
        NaN without a log.
    warnings : tuple of str
        What the choice leaves open, each also given as a `TuningWarning`.
    """

    observer: Observer
    ell: float
    structure: str
    state: int
    criterion: str
    noise: float
    model_error: float
    point: dict[str, float]
    curves: dict[str, TradeOff] = field(repr=False)
    whiteness: float = math.nan
    warnings: tuple[str, ...] = ()

    def __str__(self) -> str:
        name = f"{self.structure}: " if self.structure else ""
        rows = [f"{name}gain {self.ell:.4g} /s, {self.criterion} of estimate {self.state}"]
        units = {"bandwidth": " rad/s", "settling": " s"}
        rows += [f"  {k:10s} {v:.4g}{units.get(k, '')}" for k, v in self.point.items() if v == v]
        if self.whiteness == self.whiteness:
            rows.append(f"  {'whiteness':10s} {self.whiteness:.2g}")
        rows += [f"  warning: {text}" for text in self.warnings]
        return "\n".join(rows)

    def columns(self) -> dict[str, Any]:
        """The curves of all structures, one below the other, as named columns."""
        out: dict[str, Any] = {"structure": []}
        for name, curve in self.curves.items():
            out["structure"] += [name] * len(curve.ell)
            for key, values in (*vars(curve).items(), ("error", curve.error)):
                out.setdefault(key, []).extend(values.tolist())
        return out

    def to_dataframe(self) -> Any:
        """A pandas DataFrame of `columns`. Needs the extra `data`."""
        try:
            import pandas as pd
        except ImportError as error:
            raise MissingExtraError("a table needs pandas: pip install 'hgo_rs[data]'") from error
        return pd.DataFrame(self.columns())

    def plot(self, figure: Figure | None = None) -> Figure:
        """Draw the trade-off with the chosen point marked. Needs the extra `plot`."""
        from hgo_rs.plotting import tuning_figure

        return tuning_figure(self, figure)


# --- the choice -------------------------------------------------------------------------------


def tune(
    build: Build | Mapping[str, Build],
    log_or_noise: float | tuple[npt.ArrayLike, ...],
    dt: float | None = None,
    *,
    cutoff: float | None = None,
    settling: float | None = None,
    model_error: float | None = None,
    state: int | None = None,
    ells: npt.ArrayLike | None = None,
    skip: float | None = None,
) -> Tuning:
    """Choose the gain of an observer, and its structure if several are offered.

    By least mean-square error, unless `cutoff` or `settling` is given. The law's linear part, as it
    runs with the step `dt`, gives cutoff, settling time, peaking, and the error's variance

        P(ell) = R n(ell) + Q m(ell)

    from measurement noise of variance R and from what the model lacks in x_n', taken as white
    noise of spectral density Q (`noise_gain`, `model_gain` of `hgo_rs.design`). On a log, R and Q
    are found from the record alone: the innovation y - y_hat of the observer run with gain ell
    has the variance S(ell) = R s_R(ell) + Q s_Q(ell) (`innovation_gain`), and R, Q >= 0 are fitted
    to the measured S around its minimum, where the observer is nearest to the Kalman filter of
    this noise. (Prediction errors as criterion: Ljung, System Identification, 1999, chapter 7. R
    and Q from innovations of a filter that is not optimal: Mehra, IEEE TAC 15, 1970.)

    Parameters
    ----------
    build : callable, or mapping of names to callables
        ell -> observer with that constant gain. A gain that is refused is left out, with a warning.
    log_or_noise : (t, y), (t, y, u), or float
        A record (t: (N,) times or a period [s]; y: (N,); u: (N, n_u)), or the standard deviation of
        the measurement noise, white from sample to sample.
    dt : float, optional
        Sampling period [s]; of a log the median time between samples of y, and found in it.
    cutoff : float, optional
        Wanted cutoff of the estimate [rad/s]. Among structures the least noise wins.
    settling : float, optional
        Wanted settling time (2 %) of the estimate [s]. Among structures the least noise wins.
    model_error : float, optional
        sqrt(Q), unit of x_n per sqrt(s); needed for the least error without a log.
    state : int, optional
        The estimate the choice is about, 1 to n. Default: the last one all structures have.
    ells : (points,), optional
        Gains to look at [1/s], three or more, in any order. Default: 41 from 1e-3/dt
        (on a log: from where what was wrong at the start is forgotten after `skip`) to 5/dt or 0.9
        of the step limit.
    skip : float, optional
        Time [s] at the start of a log that is not judged. Default: a twentieth of it.

    Returns
    -------
    Tuning

    Warns
    -----
    TuningWarning
        The least error at the lowest or highest gain tried; a record that white noise and white
        model error do not explain, or of which a coarse step of y is all the noise; gains or
        structures that were left out, and why.

    Raises
    ------
    HgoError
        Two criteria at once; a target no gain reaches, with what can be reached; no model_error
        for the least error without a log; a log that is too short, stands still or has no noise;
        fewer than three gains that are not refused.
    """
    asked = {"cutoff": cutoff, "settling": settling}
    targets = {
        name: check_number(value, name, above=0.0)
        for name, value in asked.items()
        if value is not None
    }
    check(len(targets) < 2, "cutoff, settling", targets, "given one at a time", "leave one out")
    structures = dict(build) if isinstance(build, Mapping) else {"": build}
    check(structures, "build", build, "at least one observer", "give ell -> observer")
    for make in structures.values():
        check(callable(make), "build", make, "callable", "give ell -> observer")

    record, known = None, (math.nan, math.nan)
    if isinstance(log_or_noise, (tuple, list)):
        record = _Record.of(tuple(log_or_noise), skip)
        step = record.dt
        if dt is not None:
            given = check_number(dt, "dt", above=0.0)
            median = f"the log's median time between samples, {step:.6g} s"
            fits = math.isclose(given, step, rel_tol=1e-2)
            check(fits, "dt", given, median, "leave it out, or correct the times")
        found = "it is found in the log; give a noise level in place of the log to use it"
        check(model_error is None, "model_error", model_error, "left out with a log", found)
    else:
        check(skip is None, "skip", skip, "left out without a log", "leave it out")
        remedy = "give the standard deviation of the noise, or a log as a tuple (t, y)"
        level = check_number(log_or_noise, "log_or_noise", above=0.0, remedy=remedy)
        check(dt is not None, "dt", dt, "given with a noise level", "give the sampling period")
        step = check_number(dt, "dt", above=0.0)
        needed = "given with a noise level, for the least error"
        remedy = "say how much the model lacks, or give a log, cutoff= or settling="
        check(targets or model_error is not None, "model_error", None, needed, remedy)
        lack = math.nan if model_error is None else model_error
        if model_error is not None:
            lack = check_number(model_error, "model_error", least=0.0)
        known = level, lack

    candidates: dict[str, _Candidate] = {}
    refusals: dict[str, HgoError] = {}
    for name, make in structures.items():
        try:
            candidates[name] = _Candidate(make, step, ells)
        except HgoError as error:
            refusals[name] = error
    if not candidates:
        raise next(iter(refusals.values()))
    order = min(candidate.n for candidate in candidates.values())
    index = order if state is None else check_integer(state, "state", least=1, most=order)
    reached: dict[str, float] = {}
    for name, candidate in candidates.items():
        try:
            candidate.look(index - 1, record, *known)
            if targets:
                reached[name] = candidate.reach(*next(iter(targets.items())))
            else:
                reached[name] = candidate.least_error()
        except HgoError as error:
            refusals[name] = error
    if not reached:
        raise next(iter(refusals.values()))

    def cost(name: str) -> float:
        """The noise at the target; else what explains the log best, or errs least on paper."""
        if targets:
            return candidates[name].point(reached[name])["noise"]
        if record is not None:
            return float(np.nanmin(candidates[name].curve.innovation))
        return candidates[name].point(reached[name])["error"]

    best = min(reached, key=cost)
    chosen = candidates[best]
    criterion = "least error"
    for name, value in targets.items():
        criterion = f"{name} {value:.4g} " + ("rad/s" if name == "cutoff" else "s")
    ell = reached[best]
    said = [f"structure {name!r} was left out: {error}" for name, error in refusals.items()]
    for name in reached:
        of = f"{name}: " if name else ""
        said += [of + text for text in candidates[name].left_out()]
    if not targets:
        said += chosen.at_an_edge(ell)
    whiteness = math.nan
    if record is not None:
        whiteness, doubts = chosen.doubts(ell, record, bool(targets))
        said += doubts
    for text in said:
        warnings.warn(text, TuningWarning, stacklevel=2)
    return Tuning(
        observer=chosen.made(ell),
        ell=ell,
        structure=best,
        state=index,
        criterion=criterion,
        noise=chosen.noise,
        model_error=chosen.model_error,
        point=chosen.point(ell),
        curves={name: candidates[name].curve for name in reached},
        whiteness=whiteness,
        warnings=tuple(said),
    )


# --- a record ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Record:
    """A log, and the part of it that is judged."""

    arguments: tuple[Any, ...]
    y: Array
    dt: float
    skip: float
    judged: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, log: tuple[npt.ArrayLike, ...], skip: float | None) -> _Record:
        fits = len(log) in (2, 3)
        check(fits, "log_or_noise", f"{len(log)} arrays", "(t, y) or (t, y, u)", "give these")
        clock, y = check_array(log[0], "t"), check_array(log[1], "y")
        y = y[:, 0] if y.ndim == 2 and y.shape[1] == 1 else y
        one = y.ndim == 1 and clock.shape in ((), y.shape)
        shapes = f"{clock.shape}, {y.shape}"
        check(one, "shapes of t and y", shapes, "(N,) each, or t a period", "give one output")
        longer = "give a longer log"
        check(len(y) >= 50, "samples of the log", len(y), ">= 50", longer)
        t = clock
        if not clock.ndim:
            period = check_number(float(clock), "t, a period", above=0.0)
            t = period * np.arange(len(y), dtype=np.float64)
        steps = np.diff(t)
        k = int(np.argmin(steps > 0.0))
        increasing, remedy = bool(np.all(steps > 0.0)), "sort the record, drop repeated times"
        around = f"{t[k]:.9g}, {t[k + 1]:.9g}"
        check(increasing, f"t at samples {k} and {k + 1}", around, "increasing", remedy)
        length = float(t[-1] - t[0])
        start = length / 20.0
        if skip is not None:
            start = check_number(skip, "skip", above=0.0, below=length)
        there = np.flatnonzero(np.isfinite(y))
        check(
            there.size >= 50, "samples of the log that are not missing", there.size, ">= 50", longer
        )
        waits = np.diff(t[there])
        period = float(np.median(waits))
        # After a gap the estimate has to be found again, for as long as it was left alone.
        gap = np.flatnonzero(waits > 1.5 * period)
        found = np.full(len(y), -np.inf)
        found[there[gap + 1]] = t[there[gap + 1]] + np.minimum(waits[gap] - period, start)
        judged = np.isfinite(y) & (t - t[0] >= start) & (t >= np.maximum.accumulate(found))
        enough = int(np.sum(judged))
        remedy = f"{longer}, steadier steps (their median is {period:.4g} s), or a shorter skip"
        check(enough >= 50, "samples after skip and gaps", enough, ">= 50", remedy)
        arguments = (clock if clock.ndim else float(clock), y, *log[2:])
        return cls(arguments, y, period, start, judged)

    def innovation(self, observer: Observer) -> Array:
        """The innovation y - y_hat, NaN where it is not judged."""
        start = np.zeros(observer.n)
        start[0] = self.y[np.argmax(np.isfinite(self.y))]
        run = observer.run(*self.arguments, x_hat0=start)
        return np.where(self.judged, np.ravel(run.innovation), np.nan)

    def moves(self, n: int) -> None:
        """Refuse a record that stands still."""
        values = np.unique(self.y[self.judged]).size
        allowed = f"> {n}, the order: a record that stands still tells of no gain"
        remedy = "give a log in which y moves, or the noise level in its place"
        check(values > n, "distinct values of y after skip", values, allowed, remedy)

    def coarse_step(self) -> float:
        """The step of y where most samples move by one of it or not at all; else 0.

        All increments are whole numbers of it.
        """
        both = self.judged[1:] & self.judged[:-1]
        moved = np.abs(np.diff(self.y)[both])
        rounding = 64.0 * np.finfo(np.float64).eps * float(np.max(np.abs(self.y[self.judged])))
        if not np.any(moved > rounding):
            return 0.0
        step = float(np.min(moved[moved > rounding]))
        counts = np.rint(moved / step)
        whole = np.mean(np.abs(moved / step - counts) < 0.05) > 0.99
        coarse = np.mean(counts <= 1.0) > 0.5 and np.unique(counts).size > 1
        return step if whole and coarse else 0.0


# --- one structure ----------------------------------------------------------------------------


class _Candidate:
    """One structure: its trade-off over the gain."""

    curve: TradeOff
    noise: float
    model_error: float
    near: int  # gains of which the innovation is near the least
    misfit: float  # RMS of what the fit of R and Q leaves there, of the measured variance

    def __init__(self, build: Build, dt: float, ells: npt.ArrayLike | None) -> None:
        self.build, self.dt, self.n = build, dt, 0
        self.refused: list[tuple[float, Exception]] = []
        self.ells = None if ells is None else np.unique(check_array(ells, "ells"))
        if self.ells is None:
            tried = [part / dt for part in (0.1, 1e-3, 1e-2, 1.0, 5.0)]
        else:
            sound = self.ells.size >= 3 and np.all((self.ells > 0.0) & np.isfinite(self.ells))
            allowed = "three gains or more, each > 0 and finite"
            check(sound, "ells", ells, allowed, "leave it out")
            tried = self.ells.tolist()
        for ell in tried:
            try:
                observer = self.made(ell)
            except HgoError as error:
                self.refused.append((ell, error))
            else:
                self.n, self.any = observer.n, observer
                self.refused.clear()
                return
        raise self.none_left()

    def made(self, ell: float) -> Observer:
        """The observer with this gain, which must be what `build` is there for."""
        from hgo_rs.observers import Observer

        call = f"build({ell:.6g})"
        try:
            observer = self.build(ell)
        except HgoError:
            raise
        except Exception as error:
            raise HgoError(f"{call} raised {type(error).__name__}: {error}") from error
        remedy = "build ell -> StandardObserver(n, ell), for example"
        check(isinstance(observer, Observer), call, observer, "an observer", remedy)
        spec = observer.spec
        law = spec.get("gain")
        law = law if isinstance(law, Mapping) else {}
        kinds = ("standard", "low-power", "peaking-free")
        sound = law.get("law") == "constant" and spec["kind"] in kinds
        shown = " with gain law ".join([spec["kind"], *([law["law"]] if "law" in law else [])])
        check(sound, "observer", shown, f"one with a constant gain: {', '.join(kinds)}", remedy)
        follows = math.isclose(law["ell"], ell, rel_tol=1e-6)
        allowed = f"{ell:.6g}, the gain that is asked for"
        check(follows, f"gain of {call}", law["ell"], allowed, remedy)
        check(self.n in (0, observer.n), f"order of {call}", observer.n, f"{self.n}", remedy)
        return observer

    def look(self, index: int, record: _Record | None, noise: float, model_error: float) -> None:
        """Compute the curve of estimate `index`, over a record where there is one."""
        self.index, self.noise, self.model_error = index, noise, model_error
        if record is not None:
            record.moves(self.n)
        kept, squares, figures = [], [], []
        for ell in self.grid(record).tolist():
            try:
                with np.errstate(all="ignore"):
                    observer = self.made(ell)
                    square, finite = math.nan, True
                    if record is not None:
                        square = float(np.nanmean(record.innovation(observer) ** 2))
                        finite = math.isfinite(square)
                    remedy = "choose a smaller gain, or a larger unit of y"
                    check(finite, "mean square innovation", square, "finite", remedy)
                    figures.append(self.figures(observer))
            except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
                self.refused.append((ell, error))
            else:
                kept.append(ell)
                squares.append(square)
        if len(kept) < 3:
            raise self.none_left()
        grid, measured = np.array(kept), np.array(squares)
        if record is not None:
            smallest = np.finfo(np.float64).eps * float(np.max(np.abs(record.y[record.judged])))
            self.found(grid, measured, smallest)
        self.curve = TradeOff(
            ell=grid,
            innovation=np.sqrt(measured),
            noise=self.noise * np.sqrt([of["noise"] for of in figures]),
            model=self.model_error * np.sqrt([of["model"] for of in figures]),
            **{
                name: np.array([of[name] for of in figures])
                for name in ("bandwidth", "settling", "peaking")
            },
        )

    def grid(self, record: _Record | None) -> Array:
        """The gains asked for; else gains that are stable and, on a record, forget their start
        before they are judged.
        """
        if self.ells is not None:
            return self.ells
        limit = step_limit(self.any.spec).c / self.dt
        low, high = _SPAN
        low, high = low / self.dt, min(high / self.dt, 0.9 * limit)
        if record is not None:
            spec = self.any.spec
            low = max(low, float(np.max(settling(spec))) * spec["gain"]["ell"] / record.skip)
        remedy = "give a longer log or a longer skip, or ells="
        check(low < high, "least gain that settles within skip", low, f"< {high:.4g}", remedy)
        return np.geomspace(low, high, _POINTS)

    def figures(self, observer: Observer) -> dict[str, float]:
        """What an observer does to the estimate that is asked about, per unit of noise and model
        error.
        """
        spec, dt, i = observer.spec, self.dt, self.index
        out = {
            "bandwidth": float(bandwidth(spec, dt)[i]),  # may be infinite
            "settling": float(settling(spec, dt)[i]),
            "peaking": float(peaking(spec, dt)[i]),
            "noise": float(noise_gain(spec, dt)[i]),
            "model": float(model_gain(spec, dt)[i]),
        }
        for name, value in out.items():
            sound = value >= 0.0 and (name == "bandwidth" or math.isfinite(value))
            check(sound, name, value, "finite", "choose gains nearer to 1/dt")
        return out

    def found(self, grid: Array, squares: Array, smallest: float) -> None:
        """sqrt(R) and sqrt(Q) from innovations: S(ell) = R s_R(ell) + Q s_Q(ell) near its least."""
        from scipy.optimize import nnls

        self.near, self.misfit = 0, math.nan
        if np.min(squares) <= smallest**2:  # no noise: nothing is left beside rounding
            return
        used = np.argsort(squares)
        self.near = int(np.sum(squares <= _NEAR * np.min(squares)))
        used = used[: max(self.near, 3)]
        specs = [self.made(ell).spec for ell in grid[used].tolist()]
        shares = np.array([innovation_gain(spec, self.dt) for spec in specs])
        unit = np.max(shares, axis=0)
        relative = shares / unit / squares[used, None]
        fit, _ = nnls(relative, np.ones(used.size))
        noise, lack = np.sqrt(fit / unit)
        left = (relative @ fit - 1.0)[: self.near]
        self.noise, self.model_error = float(noise), float(lack)
        self.misfit = float(np.sqrt(np.mean(left**2)))

    def point(self, ell: float) -> dict[str, float]:
        """All columns at one gain."""
        out = self.figures(self.made(ell))
        noise = self.noise * math.sqrt(out["noise"])
        model = self.model_error * math.sqrt(out["model"])
        return {**out, "noise": noise, "model": model, "error": math.hypot(noise, model)}

    def reach(self, name: str, wanted: float) -> float:
        """The least gain with this cutoff, or within this settling time."""
        if name == "cutoff":
            highest = math.pi / self.dt
            remedy = "sample faster, or choose a lower one"
            check(wanted < highest, name, wanted, f"below pi/dt = {highest:.4g} rad/s", remedy)
        figure = bandwidth if name == "cutoff" else settling
        values = self.curve.bandwidth if name == "cutoff" else -self.curve.settling
        sign = 1.0 if name == "cutoff" else -1.0
        there = np.flatnonzero(values >= sign * wanted)
        if there.size == 0 or there[0] == 0:
            ends = np.abs(values[[0, -1]])
            allowed = f"between {min(ends):.4g} and {max(ends):.4g}, what gains from "
            allowed += f"{self.curve.ell[0]:.4g} to {self.curve.ell[-1]:.4g} /s reach"
            raise HgoError(explain(name, wanted, allowed, "choose another, or give ells="))
        low, high = np.log(self.curve.ell[there[0] - 1 : there[0] + 1]).tolist()
        while high - low > 1e-9:
            middle = 0.5 * (low + high)
            if (
                sign * figure(self.made(math.exp(middle)).spec, self.dt)[self.index]
                >= sign * wanted
            ):
                high = middle
            else:
                low = middle
        return math.exp(high)

    def least_error(self) -> float:
        """The gain of the least R n(ell) + Q m(ell)."""
        from scipy.optimize import minimize_scalar

        remedy = "no noise is left to weigh against; give a noise level and model_error, or cutoff="
        rms = float(np.nanmin(self.curve.innovation)) if self.noise != self.noise else math.nan
        check(rms != rms, "least RMS innovation", rms, "above the rounding of y", remedy)

        def error(log_ell: float) -> float:
            spec, i = self.made(math.exp(log_ell)).spec, self.index
            of_noise = self.noise * math.sqrt(noise_gain(spec, self.dt)[i])
            return math.hypot(of_noise, self.model_error * math.sqrt(model_gain(spec, self.dt)[i]))

        k = int(np.argmin(self.curve.error))
        ends = np.log(self.curve.ell[[max(k - 1, 0), min(k + 1, len(self.curve.ell) - 1)]])
        best = minimize_scalar(error, bounds=ends, method="bounded", options={"xatol": 1e-6})
        return float(math.exp(best.x))

    # --- what it cannot know ---

    def none_left(self) -> HgoError:
        """Why there are too few gains: what all say, if it is the same; else what each says."""
        texts = self.left_out()
        first = self.refused[0][1]
        if len(texts) == 1 and isinstance(first, HgoError):
            return first
        return HgoError("fewer than three gains are left: " + "; ".join(texts))

    def left_out(self) -> list[str]:
        """The gains that were refused, and why; reasons that differ by their numbers are one."""
        groups: dict[str, list[tuple[float, Exception]]] = {}
        for ell, error in self.refused:
            groups.setdefault(re.sub(r"[-+]?\d\S*|inf|nan", "#", str(error)), []).append(
                (ell, error)
            )
        out = []
        for group in groups.values():
            gains = [f"{ell:.4g}" for ell, _ in group]
            shown = ", ".join(gains) if len(gains) < 6 else f"{gains[0]}, ..., {gains[-1]}"
            error = group[0][1]
            reason = (
                str(error) if isinstance(error, HgoError) else f"{type(error).__name__}: {error}"
            )
            out.append(f"{len(gains)} of the gains left out ({shown} /s): {reason}")
        return out

    def at_an_edge(self, ell: float) -> list[str]:
        """A least error at an end of the gains that were tried is not known to be the least."""
        low, high = self.curve.ell[[0, -1]].tolist()
        if ell <= low * (1.0 + 1e-3):
            remedy = "give ells= that begin lower, on a log with a longer skip"
            if any(refused < low for refused, _ in self.refused):
                remedy = "lower ones were left out"
            return [f"the least error is at the lowest gain tried, {low:.4g} /s: {remedy}"]
        if ell >= high * (1.0 - 1e-3):
            remedy = "give ells= that end higher, sample faster, or tell the model more"
            if any(refused > high for refused, _ in self.refused):
                remedy = "higher ones were left out"
            return [f"the least error is at the highest gain tried, {high:.4g} /s: {remedy}"]
        return []

    def doubts(self, ell: float, record: _Record, by_target: bool) -> tuple[float, list[str]]:
        """Whether the innovation at this gain is what white noise R and white model error Q give.

        A portmanteau test. Of the autocorrelations r_j, over n_j pairs, less those rho_j that R and
        Q give with this law, sqrt(n_j) (r_j - rho_j) is normal with Bartlett's covariance if so;
        their normed sum of squares is chi-squared (Box and Pierce, J. Am. Stat. Assoc. 65, 1970,
        for rho_j = 0, the Kalman filter's). A model error that lasts, as friction does,
        makes every long record fail that, at little cost for the gain. It costs where the variance
        S(ell) itself does not follow R and Q, or where the correlation is most of the innovation.
        """
        from scipy.stats import chi2

        try:
            observer = self.made(ell)
            innovation = record.innovation(observer)
        except HgoError as error:
            return math.nan, [f"the chosen gain, {ell:.4g} /s, is refused over the log: {error}"]
        said = []
        so = "so that the gain may be far too high; compare with lower ones, or choose by cutoff="
        if by_target:
            so = "so that noise and model error may be wrong; the gain does not rest on them"
        if 0 < self.near < 3:
            said.append(
                f"gains tried of which the innovation is near the least: {self.near}, too few to "
                "find noise and model error by; give ells= that are closer together"
            )
        step = record.coarse_step()
        rounding = step / math.sqrt(12.0)
        if step and self.noise < _DITHER * rounding:
            said.append(
                f"y moves in steps of {step:.4g}, by one or none from most samples to the next, "
                f"and the noise found, {self.noise:.3g}, is rounding ({rounding:.3g}) and little "
                f"else: it lasts for several samples and is not white, {so}"
            )
        whiteness = math.nan
        if math.isfinite(self.misfit):
            far = np.array([self.noise**2, self.model_error**2]) @ innovation_covariance(
                observer.spec, self.dt, _LAGS + _FAR
            )
            rho = far / far[0]
            e, there = np.nan_to_num(innovation), np.isfinite(innovation)
            lags = np.arange(1, _LAGS + 1)
            pairs = np.array([np.sum(there[j:] & there[:-j]) for j in lags])
            products = np.array([e[j:] @ e[:-j] for j in lags])
            excess = products / np.maximum(pairs, 1) / np.nanmean(innovation**2) - rho[lags]
            # Bartlett's covariance of sample autocorrelations, spread @ spread.T / N: 1 if rho = 0
            i, k = lags[:, None], np.arange(1, _FAR + 1)
            spread = rho[k + i] + rho[np.abs(k - i)] - 2.0 * rho[i] * rho[k]
            normal = np.linalg.lstsq(spread, np.sqrt(pairs) * excess, rcond=None)[0]
            whiteness = float(chi2.sf(normal @ normal, _LAGS))
            size = float(np.sqrt(np.sum(excess**2)))
            severe = self.misfit > _MISFIT or (size > _CORRELATED and not by_target)
            if whiteness < _LEVEL and severe and not said:
                said.append(
                    f"the noise found, {self.noise:.3g}, and model error, {self.model_error:.3g}, "
                    "do not explain the innovation if they are white: its autocorrelations are off "
                    f"by {size:.2g} in all (probability {whiteness:.1g}), its variance over the "
                    f"gain by {100.0 * self.misfit:.0f} %, {so}; look for hum, filtering, held "
                    "samples, or terms that the model lacks"
                )
        return whiteness, said
