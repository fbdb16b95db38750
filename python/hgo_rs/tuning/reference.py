"""The state, from both sides of each sample: what an observer is judged by.

The law run forwards knows of the past, x_f, run backwards of the future, x_b (`reversal`).  With
errors that have nothing in common, of covariances P_f and P_b,

    x_s = W x_f + (1 - W) x_b,        W = P_b (P_f + P_b)^-1,        P_s = W P_f,

is the fixed-interval smoother in its form of two filters (Fraser and Potter, IEEE TAC 14, 1969).
Its error is orthogonal to all that samples tell.  So, for any estimate x_hat made of samples,

    E|x_hat - x|^2 = E|x_hat - x_s|^2 + E|x_s - x|^2,

and the least distance from x_s is the least error, whatever the law.  All samples up to several
1/ell ahead speak for or against an estimate: noise that lasts for some samples, as rounding does,
is not taken for motion.

The smoother's own gain is the one that it says is the best: a fixed point.  Which model it rests on
is decided by how well both sides together tell a sample that neither has used.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hgo_rs.design.discretisation import step_limit
from hgo_rs.errors import HgoError
from hgo_rs.laws import LAWS
from hgo_rs.models import Model, System
from hgo_rs.observers import HighGainEKF, RunResult, StandardObserver
from hgo_rs.tuning.linear import Covariances, along, path, slopes_beside, stationary
from hgo_rs.tuning.record import Record
from hgo_rs.tuning.result import Array
from hgo_rs.tuning.reversal import reversed_model, reversed_record, signs

_LEAST = 50  # samples with others on both sides
_SPAN = 2e-3, 5.0  # of ell dt
_RATIO = 1.25  # of a gain to the one below
_ROUNDS = 8
_LOWER = 1.0, 4.0, 16.0  # the fixed point is looked for from the least innovation's gain, and below
_CLEAR = 2.0  # a lower one must halve what both sides differ by
_LOST = 4.0  # of the least innovation: what is left of y beside a smoothed state that is of use
_FOLLOWS = 0.5  # of a rounding that lasts: less left of y, and the state follows the rounding
_STEPS, _WORK = (60, 600), 1200  # of the variational equation: a stretch's, and of all together
_BELOW, _ABOVE, _WIDER = 30.0, 4.0, 1.4  # gains of filters beside the least innovation's
_LONG, _STRETCHES = 4.0, 50  # of a stretch in horizons; stretches at most
_SURE = 2.0  # standard errors of a mean
FEWEST = 6
"""Stretches that tell what is chance."""
SLOPES_COUNT = 0.05
"""Slopes beside the gain, from which on they are worth a covariance."""
MOST_OF_FILTER = max(LAWS["high-gain-ekf"].orders)
_SHIFT = 1.07  # of the gain, for a derivative by differences


def butterworth(n: int) -> list[complex]:
    """Poles of the stationary Kalman filter of a chain moved by white noise."""
    angles = np.pi * (2.0 * np.arange(1, n + 1) + n - 1.0) / (2.0 * n)
    upper = [complex(math.cos(a), math.sin(a)) for a in angles if math.sin(a) > 1e-9]
    return [*upper, *(p.conjugate() for p in upper), *([-1.0 + 0j] if n % 2 else [])]


@dataclass(frozen=True, eq=False)
class Reference:
    """Smoothed states of a record.

    Attributes
    ----------
    name : str
        What it rests on.
    x : (N, n)
    start : (n,)
        The state at the first sample, as all later ones have it.
    left : float
        RMS of what x_s leaves of y.
    spread : (n,)
        Standard deviation of its error, as far as R and Q say.
    difference : (n,)
        RMS of what both sides differ by, over sqrt(2): the error of one of them, where theirs have
        nothing in common.
    ell : float
        Its gain [1/s].
    horizon : float
        How far ahead samples speak [s]: 1/ell.
    noise, model_error : float
        Of the white noise and the white model error for which its gain is the best one and errs as
        it does: sqrt(R), sqrt(Q).
    """

    name: str
    x: Array
    start: Array
    left: float
    spread: Array
    difference: Array
    ell: float
    noise: float
    model_error: float

    @property
    def horizon(self) -> float:
        return 1.0 / self.ell

    def first(self, count: int) -> Reference:
        """The first states alone."""
        some = slice(0, count)
        short = {name: getattr(self, name)[some] for name in ("start", "spread", "difference")}
        return replace(self, x=self.x[:, some], **short)

    def distance(self, x_hat: Array, record: Record, index: int) -> float:
        """RMS of x_hat - x_s of state `index`; infinite where it overflows."""
        with np.errstate(all="ignore"):
            square = float(np.mean(self.off(x_hat, record, index) ** 2))
        return math.sqrt(square) if math.isfinite(square) else math.inf

    def off(self, x_hat: Array, record: Record, index: int) -> Array:
        """x_hat - x_s of state `index`, of the samples that others are on both sides of."""
        some = record.inner
        with np.errstate(all="ignore"):
            off = np.asarray(x_hat[some, index] - self.x[some, index])
            if index == 0 and record.turn is not None:
                off -= record.turn * np.rint(off / record.turn)
        return off


Source = tuple[str, System | None, int, int]
"""A name, a model, the order of its observer, and how many of its states mean what they do in the
structures that are judged."""


def find(
    record: Record, sources: Iterable[Source], index: int, note: Callable[[str], None]
) -> Reference | None:
    """The reference that tells samples best which it has not used; None where there is none.

    Filters take the place of constant gains where they do so by more than chance.  Beside a step of
    y that lasts for samples: the one of which both sides differ least in `index`.
    """
    if np.sum(record.two_sided) < _LEAST:
        note("too few samples have others on both sides: there is no smoothed state")
        return None
    searches: list[_Search] = []
    for source in sources:
        if index >= source[3]:
            continue
        try:
            search = _Search(record, source, index)
        except HgoError as error:
            note(f"{source[0]}: {error}")
        else:
            if np.isfinite(search.innovation).any():
                searches.append(search)
                searches += search.filters()
    least = min((float(np.min(search.innovation)) for search in searches), default=math.nan)
    step = record.coarse_step()
    limits = _FOLLOWS * step / math.sqrt(12.0), max(_LOST * math.sqrt(least), step)
    found = [(search, best) for search in searches if (best := search.best(*limits)) is not None]
    if not found:
        return None
    if step:  # that lasts: the neighbours are wrong by the same
        return min((best for _, best in found), key=lambda best: float(best.difference[index]))
    missed = [(search.missed(best.ell) ** 2, search, best) for search, best in found]
    # constant gains first
    missed.sort(key=lambda one: (isinstance(one[1], _Filters), float(np.mean(one[0]))))
    squares, _, chosen = missed[0]
    for other, search, best in missed[1:]:
        longest = max(best.horizon, chosen.horizon) / record.dt
        if isinstance(search, _Filters) and surely_less(stretches(other - squares, longest)):
            squares, chosen = other, best
    return chosen


def stretches(values: Array, horizon: float) -> Array:
    """Means of some values in stretches of several times a horizon, in samples: at most 50."""
    count = min(_STRETCHES, max(int(len(values) / (_LONG * horizon)), 1))
    return np.array([np.mean(part) for part in np.array_split(values, count)])


def surely_less(differences: Array) -> bool:
    """Whether independent differences are below 0 by more than chance; never of a few."""
    if len(differences) < FEWEST:
        return False
    error = float(np.std(differences, ddof=1)) / math.sqrt(len(differences))
    return float(np.mean(differences)) < -_SURE * error


class _Search:
    """The fixed point of one model."""

    def __init__(self, record: Record, source: Source, index: int) -> None:
        name, model, n, self.valid = source
        self.record, self.name, self.n, self.index = record, name, n, index
        self.model, self.back_model = model, reversed_model(model, n, float(record.t[-1]))
        self.back_record = reversed_record(record)
        self.source, self.grid = source, self.gains()
        self.estimates: list[Array | None] = []
        self.innovation = np.full(len(self.grid), np.inf)
        self.tried: dict[int, Reference | None] = {}
        some = record.two_sided
        for k, ell in enumerate(self.grid.tolist()):
            try:
                run = record.run(self.forward(ell), spare=True)
            except HgoError:
                self.estimates.append(None)
                continue
            self.estimates.append(np.array(self.kept(run)))
            with np.errstate(all="ignore"):
                square = float(np.mean(run.innovation[some, 0] ** 2))
            self.innovation[k] = square if math.isfinite(square) else np.inf

    def gains(self) -> Array:
        """Those that are tried, rising."""
        dt = self.record.dt
        limit = step_limit(self.forward(1.0 / dt).spec).c / dt
        low, high = _SPAN[0] / dt, min(_SPAN[1] / dt, 0.9 * limit)
        return np.geomspace(low, high, round(math.log(high / low) / math.log(_RATIO)))

    def kept(self, run: RunResult) -> Array:
        """What is kept of a run forwards, the estimate in front."""
        return run.x_hat

    def filters(self) -> list[_Search]:
        """The same with gains that move with the model's slopes, where these count."""
        model, k = self.model, int(np.argmin(self.innovation))
        x, ell = self.estimates[k], float(self.grid[k])
        if not isinstance(model, Model) or x is None or self.record.turn is not None:
            return []
        fits = model.compiled and model.n <= MOST_OF_FILTER and not model.unknown
        if not (fits and slopes_beside(model, self.record, x, ell) > SLOPES_COUNT):
            return []
        try:
            return [_Filters(self.record, self.source, self.index, ell)]
        except HgoError:  # a model without slopes
            return []

    def forward(self, ell: float) -> Any:
        poles = butterworth(self.n)
        return StandardObserver(self.n, ell, poles=poles, model=self.model)

    def backward(self, ell: float) -> Any:
        poles, known = butterworth(self.n), self.back_model
        return StandardObserver(self.n, ell, poles=poles, model=known, timing="predictor")

    def best(self, closest: float, farthest: float) -> Reference | None:
        """The fixed point that leaves of y, beside x_s, no less and no more than this."""
        best = None
        least = int(np.argmin(self.innovation))
        for lower in _LOWER:
            start = int(np.argmin(np.abs(np.log(self.grid * lower / self.grid[least]))))
            found = self.settled(start)
            if found is None or not closest <= found.left <= farthest:
                continue
            if found.ell <= self.grid[0] and least > 0:
                continue  # both sides agree on nothing where they follow nothing
            clear = _CLEAR * found.difference[self.index]
            if best is None or clear < best.difference[self.index]:
                best = found
        return best

    def settled(self, k: int) -> Reference | None:
        """The fixed point from gain k on."""
        found, seen = self.at(k), {k}
        for _ in range(_ROUNDS):
            if found is None:
                return None
            far = [
                np.inf if x is None else found.distance(x, self.record, self.index)
                for x in self.estimates
            ]
            k = int(np.argmin(far))
            found = self.at(k)
            if k in seen:
                break
            seen.add(k)
        return found

    def at(self, k: int) -> Reference | None:
        """The smoothed state by gain k."""
        if k not in self.tried:
            ell, x_f, made = float(self.grid[k]), self.estimates[k], None
            try:
                run = self.back_record.run(self.backward(ell), spare=True)
                if x_f is not None:
                    # in the units of a chain, in which the covariances are
                    s_f, s_b = _slopes(self.model, x_f), _slopes(self.back_model, run.x_hat)
                    x_b = (run.x_hat * s_b)[::-1] * signs((self.n,))
                    made = _smoothed(
                        self.record, self.name, self.forward, ell, x_f * s_f, x_b, self.index
                    )
                    made = None if made is None else _in_units(made, s_f)
                    made = made and made.first(self.valid)
            except HgoError:
                made = None
            self.tried[k] = made
        return self.tried[k]

    def missed(self, ell: float) -> Array:
        """What both sides together miss each sample by, which neither of them has used.

        Their covariances have the model's slopes along the path, where these are known.
        """
        record, turn = self.record, signs((self.n,))
        forward, backward = self.forward(ell), self.backward(ell)
        x_p = record.run(forward.with_timing("predictor"), spare=True).x_hat
        x_b = self.back_record.run(backward, spare=True).x_hat
        past = self._covariances(forward, self.model, record, x_p)
        future = self._covariances(backward, self.back_model, self.back_record, x_b)
        ratio = _ratio(past.shown, self.index) or 0.0
        p_p, p_b = (one.before[0, 1] + ratio * one.before[1, 1] for one in (past, future))
        w = _weight(p_p, p_b * np.outer(turn, turn))
        both = x_b[::-1] * turn
        both = both + (x_p - both) @ w.T
        return np.asarray(record.y[record.inner] - both[record.inner, 0])

    def _covariances(
        self, law: StandardObserver, model: System | None, record: Record, x: Array
    ) -> Covariances:
        """At the law's gain, the middle one, and a little beside it."""
        ell, dt = float(law.spec["gain"]["ell"]), record.dt
        specs = [
            {**law.spec, "gain": {"law": "constant", "ell": ell * part}}
            for part in (1.0 / _SHIFT, 1.0, _SHIFT)
        ]
        chain = isinstance(model, Model) and model.form in ("phase", "triangular")
        if isinstance(model, Model) and chain and not model.unknown:
            steps = math.ceil(np.clip(8.0 / (ell * dt), *_STEPS))
            return along(specs, dt, path(record, model, x, max(_WORK // steps, 2), steps))
        each = [stationary(spec, dt) for spec in specs]
        before, shown = (np.array([getattr(c, side) for c in each]) for side in ("before", "shown"))
        return Covariances(before.swapaxes(0, 1), shown.swapaxes(0, 1))


class _Filters(_Search):
    """The fixed point of one model by Kalman filters on both sides, with the covariances of each
    sample.
    """

    def __init__(self, record: Record, source: Source, index: int, near: float) -> None:
        self._near = near
        super().__init__(record, (f"{source[0]}, by filters", *source[1:]), index)

    def gains(self) -> Array:
        low, high = self._near / _BELOW, self._near * _ABOVE
        return np.geomspace(low, high, round(math.log(high / low) / math.log(_WIDER)))

    def filters(self) -> list[_Search]:
        return []

    def kept(self, run: RunResult) -> Array:
        return run.memory

    def forward(self, ell: float) -> HighGainEKF:
        return self._filter(ell, self.model)

    def backward(self, ell: float) -> HighGainEKF:
        return self._filter(ell, self.back_model)

    def _filter(self, ell: float, model: System | None) -> HighGainEKF:
        """Of R = 1."""
        return HighGainEKF(self.n, R=1.0, Q=self._intensity(ell), model=model)

    def _intensity(self, ell: float) -> float:
        return float(self.record.dt * ell ** (2 * self.n))

    def at(self, k: int) -> Reference | None:
        if k not in self.tried:
            memory, made = self.estimates[k], None
            with contextlib.suppress(HgoError, np.linalg.LinAlgError):
                if memory is not None:
                    made = self._both(float(self.grid[k]), memory)
            self.tried[k] = made
        return self.tried[k]

    def _both(self, ell: float, memory: Array) -> Reference | None:
        observer = self.forward(ell)
        x_f, p_f = memory[:, : self.n], observer.covariance(memory)
        x_b, p_b = self._before(self.back_record, self.backward(ell), back=True)
        w = _weight(p_f, p_b)
        x = x_b + _each(w, x_f - x_b)
        p_s, some = w @ p_f, self.record.inner
        of_f, of_s = (np.mean(np.diagonal(p[some], axis1=1, axis2=2), axis=0) for p in (p_f, p_s))
        ratio = self._intensity(ell)
        made = _finished(self.record, self.name, ell, x_f, x_b, x, of_f, of_s, self.index, ratio)
        return made and made.first(self.valid)

    def _before(
        self, record: Record, observer: HighGainEKF, *, back: bool = False
    ) -> tuple[Array, Array]:
        """Estimates and covariances before each sample is used, in the record's order.

        From those after it: K = P+ C'/R, x- = x+ - K e and P- = P+ + P+ C' C P+/(R - C P+ C').
        """
        run = record.run(observer, spare=True)
        after, used = observer.covariance(run.memory), np.isfinite(record.y)
        used[0] = False  # the first sample is where the estimate starts
        column = after[:, :, 0]
        e = np.where(used, np.nan_to_num(np.ravel(run.innovation)), 0.0)
        x = run.x_hat - column * e[:, None]
        more = used / np.maximum(1.0 - column[:, 0], np.finfo(float).tiny)
        p = after + column[:, :, None] * column[:, None, :] * more[:, None, None]
        if back:
            turn = signs((self.n,))
            return x[::-1] * turn, p[::-1] * np.outer(turn, turn)
        return x, p

    def missed(self, ell: float) -> Array:
        x_p, p_p = self._before(self.record, self.forward(ell))
        x_b, p_b = self._before(self.back_record, self.backward(ell), back=True)
        both = x_b + _each(_weight(p_p, p_b), x_p - x_b)
        some = self.record.inner
        return np.asarray(self.record.y[some] - both[some, 0])


def _each(matrices: Array, vectors: Array) -> Array:
    """Products of matrices (N, n, n) and vectors (N, n)."""
    return np.asarray(np.squeeze(matrices @ vectors[:, :, None], axis=-1))


def _ratio(shown: Array, index: int) -> float | None:
    """Q/R for which the middle one of gains (2, G, n, n) is the best for a state; None: none is."""
    rise, fall = (shown[:, -1] - shown[:, 0])[:, index, index]
    return float(-rise / fall) if rise > 0.0 > fall else None


def _weight(p_f: Array, p_b: Array) -> Array:
    """W of the state from both sides, x_b + W (x_f - x_b)."""
    other = np.linalg.solve(np.swapaxes(p_f + p_b, -1, -2), np.swapaxes(p_b, -1, -2))
    return np.asarray(np.swapaxes(other, -1, -2))


def _slopes(model: System | None, x: Array) -> Array:
    """What turns states x (N, n) into those of a chain: of an unknown its slope."""
    return model.slopes_at(x) if isinstance(model, Model) else np.ones_like(x)


def _in_units(found: Reference, slopes: Array) -> Reference:
    """The states in units of the model, where an unknown is the last one."""
    if np.all(slopes == 1.0):
        return found
    usual = np.sqrt(np.mean(slopes**2, axis=0))
    return replace(
        found,
        x=found.x / slopes,
        start=found.start / slopes[0],
        spread=found.spread / usual,
        difference=found.difference / usual,
        model_error=found.model_error / float(usual[-1]),
    )


def _smoothed(
    record: Record,
    name: str,
    build: Callable[[float], StandardObserver],
    ell: float,
    x_f: Array,
    x_b: Array,
    index: int,
) -> Reference | None:
    """Both sides together, with the covariances of the noises for which `ell` is the best gain."""
    near = [stationary(build(g).spec, record.dt).shown for g in (ell / _SHIFT, ell * _SHIFT)]
    ratio = _ratio(np.stack(near, axis=1), index)
    if ratio is None:
        return None
    here = stationary(build(ell).spec, record.dt)
    weight = np.array([1.0, ratio])[:, None, None]
    p_f, p_b = np.sum(weight * here.shown, axis=0), np.sum(weight * here.before, axis=0)
    turn = signs((len(p_b),))
    p_b = p_b * np.outer(turn, turn)
    w = _weight(p_f, p_b)
    p_s = w @ p_f
    x = x_b + (x_f - x_b) @ w.T
    return _finished(record, name, ell, x_f, x_b, x, np.diag(p_f), np.diag(p_s), index, ratio)


def _finished(
    record: Record,
    name: str,
    ell: float,
    x_f: Array,
    x_b: Array,
    x: Array,
    p_f: Array,
    p_s: Array,
    index: int,
    ratio: float,
) -> Reference | None:
    """The reference of both sides and of what they make together, with variances (n,) of the side
    forwards and of both, as R = 1 and Q = ratio give them.
    """
    some = record.inner
    with np.errstate(all="ignore"):
        difference = np.sqrt(0.5 * np.mean((x_f[some] - x_b[some]) ** 2, axis=0))
        far = np.sqrt(np.mean((x_f[some] - x[some]) ** 2, axis=0))
    if not (np.isfinite(difference).all() and np.isfinite(far).all()):
        return None
    share = np.clip(p_s / p_f, 0.0, 0.95)
    spread = far * np.sqrt(share / (1.0 - share))
    # of the variance that the forward estimate has, the part that R = 1 and Q = ratio give
    unit = math.hypot(far[index], spread[index]) / math.sqrt(p_f[index])
    with np.errstate(all="ignore"):
        left = math.sqrt(float(np.mean((record.y[some] - x[some, 0]) ** 2)))
    return Reference(name, x, x_b[0], left, spread, difference, ell, unit, unit * math.sqrt(ratio))
