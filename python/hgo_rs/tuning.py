"""Choosing a gain, and a structure, from a log or from what is known of the noise.

A larger gain follows faster and passes more noise. `tune` computes that trade-off over the gain and
marks the point that is asked for: a cutoff frequency, a settling time, or the least mean-square
error against noise and model error together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from hgo_rs.design.discretisation import step_limit
from hgo_rs.design.response import (
    bandwidth,
    innovation_gain,
    model_gain,
    noise_gain,
    peaking,
    settling,
)
from hgo_rs.errors import (
    DesignError,
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

__all__ = ["TradeOff", "Tuning", "tune"]

Array = npt.NDArray[np.float64]
Build = Callable[[float], "Observer"]
"""An observer with the gain given [1/s]."""

_POINTS = 41
_SPAN = 1e-3, 5.0  # of ell dt; beyond, an observer is all but deadbeat
_NEAR = 2.0  # innovations up to this many times the least variance tell of noise and model error


@dataclass(frozen=True, eq=False)
class TradeOff:
    """What one structure does at each gain `ell`, all (points,), for the estimate `tune` was asked
    about.

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
        RMS of y - x_hat_1 over the log; NaN without a log, or where the run diverged.
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

    def __str__(self) -> str:
        name = f"{self.structure}: " if self.structure else ""
        rows = [f"{name}gain {self.ell:.4g} /s, {self.criterion} of estimate {self.state}"]
        units = {"bandwidth": " rad/s", "settling": " s"}
        rows += [f"  {k:10s} {v:.4g}{units.get(k, '')}" for k, v in self.point.items() if v == v]
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
    are found from the record alone: the innovation y - x_hat_1 of the observer run with gain ell
    has the variance S(ell) = R s_R(ell) + Q s_Q(ell) (`innovation_gain`), and R, Q >= 0 are fitted
    to the measured S around its minimum, where the observer is nearest to the Kalman filter of
    this noise. (Prediction errors as criterion: Ljung, System Identification, 1999, chapter 7. R
    and Q from innovations of a filter that is not optimal: Mehra, IEEE TAC 15, 1970.)

    Parameters
    ----------
    build : callable, or mapping of names to callables
        ell -> observer with that constant gain.
    log_or_noise : (t, y), (t, y, u), or float
        A record (t: (N,) times or a period [s]; y: (N,); u: (N, n_u)), or the standard deviation of
        the measurement noise, white from sample to sample.
    dt : float, optional
        Sampling period [s]; with a log its median step.
    cutoff : float, optional
        Wanted cutoff of the estimate [rad/s]. Among structures the least noise wins.
    settling : float, optional
        Wanted settling time (2 %) of the estimate [s]. Among structures the least noise wins.
    model_error : float, optional
        sqrt(Q), unit of x_n per sqrt(s); needed for the least error without a log.
    state : int, optional
        The estimate the choice is about, 1 to n. Default: the last one all structures have.
    ells : (points,), optional
        Gains to look at [1/s]; those beyond the step limit are left out. Default: 41 from 1e-3/dt
        (on a log: from where what was wrong at the start is forgotten after `skip`) to 5/dt or 0.9
        of the step limit.
    skip : float, optional
        Time [s] at the start of a log that is not judged. Default: a twentieth of it.

    Returns
    -------
    Tuning

    Raises
    ------
    HgoError
        Two criteria at once; a target no gain reaches, with what can be reached; no model_error
        for the least error without a log; a log too short, or over which every observer diverged.
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
    if isinstance(log_or_noise, tuple):
        record = _Record.of(log_or_noise, skip)
        step = record.dt if dt is None else check_number(dt, "dt", above=0.0)
        found = "it is found in the log; give a noise level in place of the log to use it"
        check(model_error is None, "model_error", model_error, "left out with a log", found)
    else:
        check(skip is None, "skip", skip, "left out without a log", "leave it out")
        check(dt is not None, "dt", dt, "given with a noise level", "give the sampling period")
        step = check_number(dt, "dt", above=0.0)
        needed = "given with a noise level, for the least error"
        remedy = "say how much the model lacks, or give a log, cutoff= or settling="
        check(targets or model_error is not None, "model_error", None, needed, remedy)
        lack = math.nan if model_error is None else model_error
        if model_error is not None:
            lack = check_number(model_error, "model_error", least=0.0)
        known = check_number(log_or_noise, "log_or_noise", above=0.0), lack

    candidates = {name: _Candidate(make, step) for name, make in structures.items()}
    order = min(candidate.n for candidate in candidates.values())
    index = order if state is None else check_integer(state, "state", least=1, most=order)
    reached: dict[str, float] = {}
    refusals: list[HgoError] = []
    for name, candidate in candidates.items():
        candidate.look(index - 1, ells, record, *known)
        try:
            if targets:
                reached[name] = candidate.reach(*next(iter(targets.items())))
            else:
                reached[name] = candidate.least_error()
        except HgoError as error:
            refusals.append(error)
    if not reached:
        raise refusals[0]

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
    return Tuning(
        observer=structures[best](reached[best]),
        ell=reached[best],
        structure=best,
        state=index,
        criterion=criterion,
        noise=chosen.noise,
        model_error=chosen.model_error,
        point=chosen.point(reached[best]),
        curves={name: candidate.curve for name, candidate in candidates.items()},
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
        t = clock if clock.ndim else float(clock) * np.arange(len(y))
        check(len(y) > 1 and np.all(np.diff(t) > 0.0), "t", t, "increasing", "sort the record")
        length = float(t[-1] - t[0])
        start = length / 20.0
        if skip is not None:
            start = check_number(skip, "skip", above=0.0, below=length)
        judged = (t - t[0] >= start) & np.isfinite(y)
        enough = int(np.sum(judged))
        remedy = "give a longer log, or a shorter skip"
        check(enough >= 50, "samples after skip", enough, ">= 50", remedy)
        arguments = (clock if clock.ndim else float(clock), y, *log[2:])
        return cls(arguments, y, float(np.median(np.diff(t))), start, judged)

    def innovation(self, observer: Observer) -> float:
        """Mean square of the innovation where it is judged; NaN if unstable or diverged."""
        start = np.zeros(observer.n)
        start[0] = self.y[np.argmax(np.isfinite(self.y))]
        try:
            run = observer.run(*self.arguments, x_hat0=start)
        except DesignError:  # a step too long for the gain
            return math.nan
        except HgoError as error:
            if "diverge" not in str(error):
                raise
            return math.nan
        with np.errstate(over="ignore"):
            return float(np.mean(np.ravel(run.innovation)[self.judged] ** 2))


# --- one structure ----------------------------------------------------------------------------


class _Candidate:
    """One structure: its trade-off over the gain."""

    curve: TradeOff
    noise: float
    model_error: float

    def __init__(self, build: Build, dt: float) -> None:
        self.build, self.dt = build, dt
        spec = self.spec(0.1 / dt)
        law = spec.get("gain")
        constant = isinstance(law, dict) and law.get("law") == "constant"
        kinds = ("standard", "low-power", "peaking-free")
        allowed = f"one with a constant gain: {', '.join(kinds)}"
        remedy = "build ell -> StandardObserver(n, ell), for example"
        check(constant and spec["kind"] in kinds, "observer", spec["kind"], allowed, remedy)
        self.n: int = spec["n"]

    def spec(self, ell: float) -> dict[str, Any]:
        return self.build(ell).spec

    def look(
        self,
        index: int,
        ells: npt.ArrayLike | None,
        record: _Record | None,
        noise: float,
        model_error: float,
    ) -> None:
        """Compute the curve of estimate `index`, over a record where there is one."""
        self.index, self.noise, self.model_error = index, noise, model_error
        grid = self.grid(record) if ells is None else self.asked(ells)
        measured = np.full(grid.size, math.nan)
        if record is not None:
            squares = np.array([record.innovation(self.build(ell)) for ell in grid.tolist()])
            remedy = "look at other gains (ells=), or at the model"
            alive = int(np.sum(np.isfinite(squares)))
            check(alive >= 3, "gains that did not diverge", alive, ">= 3", remedy)
            self.noise, self.model_error = self.found(grid, squares)
            measured = np.sqrt(squares)
        points = [self.point(ell) for ell in grid.tolist()]
        names = ("bandwidth", "settling", "peaking", "noise", "model")
        columns = {name: np.array([point[name] for point in points]) for name in names}
        self.curve = TradeOff(ell=grid, innovation=measured, **columns)

    def limit(self) -> float:
        """The gain of the step limit [1/s]."""
        return step_limit(self.spec(0.1 / self.dt)).c / self.dt

    def asked(self, ells: npt.ArrayLike) -> Array:
        """Of the gains that the caller gave, those that are stable."""
        grid, limit = np.unique(check_array(ells, "ells")), self.limit()
        stable = grid[grid < limit]
        sound = stable.size >= 3 and np.all(np.isfinite(grid)) and grid[0] > 0.0
        allowed = f"three gains or more in (0, {limit:.4g}), of steps that are stable"
        check(sound, "ells", ells, allowed, "leave it out")
        return stable

    def grid(self, record: _Record | None) -> Array:
        """Gains that are stable and, on a record, forget their start before they are judged."""
        low, high = _SPAN
        low, high = low / self.dt, min(high / self.dt, 0.9 * self.limit())
        if record is not None:
            unit = self.spec(1.0)
            low = max(low, float(np.max(settling(unit))) / record.skip)
        remedy = "give a longer log or a longer skip, or ells="
        check(low < high, "least gain that settles within skip", low, f"< {high:.4g}", remedy)
        return np.geomspace(low, high, _POINTS)

    def found(self, grid: Array, squares: Array) -> tuple[float, float]:
        """sqrt(R) and sqrt(Q) from innovations: S(ell) = R s_R(ell) + Q s_Q(ell) near its least."""
        from scipy.optimize import nnls

        order = np.argsort(squares)  # NaN comes last
        near = int(np.sum(squares <= _NEAR * np.nanmin(squares)))
        used = order[: max(near, 3)]
        shares = np.array([innovation_gain(self.spec(ell), self.dt) for ell in grid[used].tolist()])
        unit = np.max(shares, axis=0)
        relative = shares / unit / squares[used, None]
        fit, _ = nnls(relative, np.ones(used.size))
        noise, lack = np.sqrt(fit / unit)
        return float(noise), float(lack)

    def point(self, ell: float) -> dict[str, float]:
        """All columns at one gain."""
        spec, i = self.spec(ell), self.index
        noise = self.noise * math.sqrt(noise_gain(spec, self.dt)[i])
        model = self.model_error * math.sqrt(model_gain(spec, self.dt)[i])
        return {
            "bandwidth": float(bandwidth(spec, self.dt)[i]),
            "settling": float(settling(spec, self.dt)[i]),
            "peaking": float(peaking(spec, self.dt)[i]),
            "noise": noise,
            "model": model,
            "error": math.hypot(noise, model),
        }

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
            if sign * figure(self.spec(math.exp(middle)), self.dt)[self.index] >= sign * wanted:
                high = middle
            else:
                low = middle
        return math.exp(high)

    def least_error(self) -> float:
        """The gain of the least R n(ell) + Q m(ell)."""
        from scipy.optimize import minimize_scalar

        def error(log_ell: float) -> float:
            spec, i = self.spec(math.exp(log_ell)), self.index
            of_noise = self.noise**2 * noise_gain(spec, self.dt)[i]
            return float(of_noise + self.model_error**2 * model_gain(spec, self.dt)[i])

        k = int(np.argmin(self.curve.error))
        ends = np.log(self.curve.ell[[max(k - 1, 0), min(k + 1, len(self.curve.ell) - 1)]])
        best = minimize_scalar(error, bounds=ends, method="bounded", options={"xatol": 1e-6})
        return float(math.exp(best.x))
