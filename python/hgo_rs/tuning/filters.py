"""The high-gain EKF among the structures of one output: its gain moves with the model's slopes.

It has no cutoff and passes no fixed share of the noise, so that a record alone can judge it. It is
tried where the slopes count beside the gain, and chosen over a constant gain, which costs less on a
chip, where it errs less over the record by more than chance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, explain
from hgo_rs.models import Model, System
from hgo_rs.observers import HighGainEKF, Observer
from hgo_rs.observers.whiteness import whiteness
from hgo_rs.tuning.candidate import Candidate
from hgo_rs.tuning.linear import slopes_beside
from hgo_rs.tuning.offers import Build, as_model, with_load
from hgo_rs.tuning.record import Record
from hgo_rs.tuning.reference import (
    FEWEST,
    MOST_OF_FILTER,
    SLOPES_COUNT,
    Reference,
    stretches,
    surely_less,
)
from hgo_rs.tuning.result import Array

NAME = "high-gain EKF"
_SPAN, _POINTS = 6.0, 13  # gains up to so many times that of the constant one, and below
_MOST = 100.0  # theta
_WORTH = 0.98  # what must be left of the error at most


def of(build: Build, dt: float, ells: npt.ArrayLike | None, *, ours: bool) -> Candidate:
    """The structure that `build` makes: of a constant gain, or of a `HighGainEKF`."""
    made = Candidate(build, dt, ells, ours=ours)
    return Filter(build, dt, ells, ours=ours) if isinstance(made.any, HighGainEKF) else made


@dataclass(eq=False)
class Kalman:
    """Filters by the gain [1/s] that a chain alone has at rest: Q = R dt ell^(2n)."""

    model: Model
    dt: float
    variance: float

    def __call__(self, ell: float) -> Observer:
        n, r = self.model.n, self.variance
        return HighGainEKF(n, R=r, Q=r * self.dt * ell ** (2 * n), model=self.model)


class Filter(Candidate):
    """A structure whose gain moves: errors and innovation over the gain, and no response."""

    any: HighGainEKF

    def grid(self, record: Record | None) -> Array:
        """The arguments of `build`: theta of a filter of one's own."""
        return np.geomspace(1.0, _MOST, _POINTS) if self.ells is None else self.ells

    def gains(self, observer: Observer) -> tuple[Array, Array]:
        unknown = np.full(observer.n, math.nan)
        return unknown, unknown

    def figures(self, observer: Observer) -> dict[str, float]:
        return dict.fromkeys(("bandwidth", "settling", "peaking", "noise", "model"), math.nan)

    def found(self, grid: Array, squares: Array, smallest: float) -> None:
        self.near, self.misfit = 0, math.nan

    def reach(self, name: str, wanted: float) -> float:
        remedy = "choose a law of constant gain, or leave it out: a log is tuned by the least error"
        raise HgoError(explain(name, wanted, "left out of a gain that moves", remedy))

    def least_error(self) -> float:
        if self.reference is None:
            remedy = "give a longer log, or choose a law of constant gain"
            told = "a log that can be smoothed, for a gain that moves"
            raise HgoError(explain("log_or_noise", None, told, remedy))
        return super().least_error()

    def refine(self, record: Record) -> None:
        """R and Q: those of the filter, by as much larger as its innovation is.

        The gains are of their ratio alone.
        """
        ell = self.least_error()
        square = float(np.mean(self.standard(record, ell) ** 2))
        spec = self.made(ell).spec
        theta, n, q = float(spec["gain"]["ell"]), self.n, np.zeros((self.n, self.n))
        q[np.tril_indices(n)] = spec["Q"]
        self.noise = math.sqrt(square * float(spec["R"][0]) / theta)
        self.model_error = math.sqrt(square * float(q[-1, -1]) * theta ** (2 * n - 1))
        if isinstance(self.build, Kalman):
            self.build.variance = self.noise**2

    def standard(self, record: Record, ell: float) -> Array:
        """Innovations over their standard deviations, of the samples that are judged."""
        observer = self.made(ell)
        assert isinstance(observer, HighGainEKF)
        run = record.run(observer, self.start(record), spare=self.ours)
        r = float(observer.spec["R"][0]) / float(observer.spec["gain"]["ell"])
        after = observer.covariance(run.memory[record.judged])[:, 0, 0]
        # P- of the sample from P of the estimate with it: P = P- r/(P- + r)
        return np.asarray(np.ravel(run.innovation)[record.judged] * np.sqrt(r - after) / r)

    def doubts(self, ell: float, record: Record, by_target: bool) -> tuple[float, list[str]]:
        """Whether the innovation is white, as the Kalman filter's is."""
        return whiteness(self.standard(record, ell)), self.of_rounding(record)


def offered(
    system: System | None, constant: Candidate, ell: float, record: Record, reference: Reference
) -> tuple[dict[str, Filter], str]:
    """Filters for a model by name, around the best constant gain; else why there are none."""
    model = as_model(system)
    if model is None:
        return {}, ""
    most = MOST_OF_FILTER
    if model.n > most:
        return {}, f"The {NAME} was not tried: order {model.n} is above {most}, its highest"
    run = record.run(constant.made(ell), constant.start(record), spare=True)
    count = slopes_beside(model, record, run.x_hat, ell)
    if not count > SLOPES_COUNT:
        told = f"The {NAME} was not tried: the model's slopes make {100.0 * count:.2g} % of the "
        return {}, f"{told}gain's effect on the error, so its gains would be nearly constant"
    found = {}
    grid = ell * np.geomspace(1.0 / _SPAN, _SPAN, _POINTS)
    variance = max(reference.noise**2, record.smallest**2)
    models = {NAME: model, f"{NAME} and load": with_load(model) if model.n < most else model}
    for name, known in models.items():
        if name == NAME or known is not model:
            build = Kalman(known, record.dt, variance)
            found[name] = Filter(build, record.dt, grid, ours=True)
    return found, ""


def compared(
    moving: tuple[str, Filter, float], constant: tuple[str, Candidate, float], record: Record
) -> tuple[bool, str]:
    """Whether a gain that moves errs less than a constant one by more than chance, in words too.

    Of squares of both distances from the smoothed state the differences, stretch by stretch of
    some 1/gain: their mean must be below 0 by two of its standard errors.  Each: name, structure
    and gain.
    """
    reference, index = moving[1].reference, moving[1].index
    assert reference is not None
    squares = []
    for _, structure, ell in (moving, constant):
        run = record.run(structure.made(ell), structure.start(record), spare=True)
        squares.append(reference.off(run.x_hat, record, index) ** 2)
    spread = float(reference.spread[index])
    first, second = (math.hypot(math.sqrt(float(np.mean(s))), spread) for s in squares)
    less = 100.0 * (1.0 - first / second)
    told = f"The {moving[0]}, whose gain follows the model's Jacobian, has "
    told += (
        f"{abs(less):.2g} % {'less' if less > 0.0 else 'more'} error over the log than the best "
    )
    told += f"constant gain ({constant[0]})"
    if less <= 0.0:
        return False, f"{told}: the constant gain is chosen."
    horizon = 1.0 / min(moving[2], constant[2], reference.ell)
    each = stretches(squares[0] - squares[1], horizon / record.dt)
    if len(each) < FEWEST:
        told += f", which is too short to be sure ({len(each)} of {FEWEST} stretches)"
        return False, f"{told}: the constant gain is taken."
    told += f", in {int(np.sum(each < 0.0))} of {len(each)} stretches"
    if not surely_less(each):
        return False, f"{told}, which may be chance: the constant gain is chosen."
    if not first < _WORTH * second:
        return False, f"{told}: not enough to justify a covariance: the constant gain is chosen."
    return True, f"{told}, which is significant: it is chosen."
