"""Choosing a gain, and a structure, from a log or from what is known of the noise.

A larger gain follows faster and passes more noise. `tune` computes that trade-off over the gain and
marks the point that is asked for: a cutoff frequency, a settling time, or the least mean-square
error against noise and model error together.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, check, check_integer, check_number
from hgo_rs.models import System
from hgo_rs.observers.turns import UNWRAP, warn_of_turns
from hgo_rs.signals import Given
from hgo_rs.times import check_period
from hgo_rs.tuning import filters
from hgo_rs.tuning.candidate import Candidate
from hgo_rs.tuning.chains import outputs, tune_chains
from hgo_rs.tuning.offers import LARGEST, Build, offered, sources
from hgo_rs.tuning.record import Record, check_inputs
from hgo_rs.tuning.reference import find
from hgo_rs.tuning.result import Tuning

_HOPELESS = 3.0  # of the least error at a glance, from which on a curve stays coarse


class TuningWarning(UserWarning):
    """The data do not determine the result of `tune`, which may be wrong."""


def tune(
    build: Build | Mapping[str, Build] | System | None,
    log_or_noise: Given | float,
    dt: float | None = None,
    *,
    cutoff: float | None = None,
    settling: float | None = None,
    model_error: float | None = None,
    state: int | Sequence[int] | None = None,
    ells: npt.ArrayLike | None = None,
    skip: float | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Tuning:
    """Choose the gain of an observer, and its structure if several are offered.

    By least mean-square error, unless `cutoff` or `settling` is given. On a log the error is
    measured by the distance from a smoothed state (`hgo_rs.tuning.reference`), which combines the
    observer with the same observer run backwards in time. Without a log, or without a smoothed
    state, it is

        P(ell) = R n(ell) + Q m(ell)

    from measurement noise of variance R and model error in x_n', white noise of spectral density Q.
    On a log R and Q are fitted to the variance of the innovation, S(ell) = R s_R(ell) + Q s_Q(ell),
    of the observer run with gain ell, around its minimum. Shares and gains of noise are those of
    the law's linear part, as it runs with the step `dt` (`noise_gain`, `model_gain`,
    `innovation_gain` of `hgo_rs.design`), with an own model's slopes along the estimate
    (`hgo_rs.tuning.linear`). (R and Q from innovations of a filter that is not optimal: Mehra, IEEE
    TAC 15, 1970.)

    Parameters
    ----------
    build : System or None, callable, or mapping of names to callables
        A model, for which several structures and poles are tried, or None for no model. Or ell ->
        observer with that constant gain; a refused gain is left out, with a warning. For several
        outputs a model of chains, or gains (p,) -> `MultiOutputObserver`.
    log_or_noise : Log, frame, (t, y), (t, y, u), or float
        A record (t: (N,) times or a period [s]; y: (N,) or (N, p); u: (N, n_u)), or the standard
        deviation of the measurement noise, white from sample to sample. Of a record of over 12288
        samples the stretch in which y moves most is used.
    dt : float, optional
        Sampling period [s]; of a log the median time between samples of y, and found in it.
    cutoff : float, optional
        Wanted cutoff of the estimate [rad/s]. Among structures the least noise wins.
    settling : float, optional
        Wanted settling time (2 %) of the estimate [s]. Among structures the least noise wins.
    model_error : float, optional
        sqrt(Q), unit of x_n (of the unknown, where it is one) per sqrt(s); needed for the least
        error without a log.
    state : int, optional
        The wanted estimate, 1 to n. Default: the last one common to all structures. With several
        outputs one for each chain, counted within it.
    ells : (points,), optional
        Gains to try [1/s], three or more, in any order. Default: 41, for long records 21, from
        1e-3/dt (without a smoothed state from the gain that settles within `skip`) to 5/dt or 0.9
        of the step limit.
    skip : float, optional
        Time [s] at the start of a log that is not evaluated. Default: a twentieth of it.
    progress : callable, optional
        Called after each structure with the numbers done and in all.

    Returns
    -------
    Tuning
        With several outputs `ell`, `state`, `noise`, `model_error`, `quantisation` and `horizon`
        are arrays, one entry an output.

    Warns
    -----
    TurnWarning
        An output that jumps by the turn of an angle or a counter while no observer has a `wrap`.
    TuningWarning
        The least error at the lowest or highest gain tried; a record that white noise and white
        model error do not explain, or of which a coarse step of y is all the noise; gains or
        structures that were left out, and why.

    Raises
    ------
    HgoError
        Two criteria at once; a target that no gain reaches (the message gives the range); no
        model_error for the least error without a log; a log that is too short, stands still or has
        no noise; fewer than three gains that are not refused.
    """
    asked = {"cutoff": cutoff, "settling": settling}
    free = build is None or isinstance(build, System)
    of_noise = isinstance(log_or_noise, (int, float, np.number))
    log: Any = None if of_noise else log_or_noise
    if not of_noise and outputs(log) > 1:
        others = {**asked, "model_error": model_error, "ells": ells, "dt": dt}
        for name, value in others.items():
            check(value is None, name, value, "left out with several outputs", "leave it out")
        remedy = "give a Model of chains, or gains -> MultiOutputObserver"
        check(build is not None, "build", build, "a model of chains", remedy)
        result = tune_chains(cast("Any", build), log, state, skip, progress)
        for text in result.warnings:
            warnings.warn(text, TuningWarning, stacklevel=2)
        return result
    targets = {
        name: check_number(value, name, above=0.0)
        for name, value in asked.items()
        if value is not None
    }
    check(len(targets) < 2, "cutoff, settling", targets, "given one at a time", "leave one out")
    structures: dict[str, Build]
    if build is None or isinstance(build, System):
        asked_of = 1 if state is None else check_integer(state, "state", least=1, most=LARGEST)
        structures = offered(build, asked_of)
    else:
        structures = dict(build) if isinstance(build, Mapping) else {"": build}
    check(structures, "build", build, "at least one observer", "give ell -> observer")
    for make in structures.values():
        check(callable(make), "build", make, "callable", "give ell -> observer")

    record, known = None, (math.nan, math.nan)
    if not of_noise:
        if isinstance(build, System) and build.n_u:
            check_inputs(log, build.n_u)
        record = Record.of(log, skip)
        step = record.dt
        if dt is not None:
            given = check_period(dt)
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
        step = check_period(dt)
        needed = "given with a noise level, for the least error"
        remedy = "give model_error, or a log, cutoff= or settling="
        check(targets or model_error is not None, "model_error", None, needed, remedy)
        lack = math.nan if model_error is None else model_error
        if model_error is not None:
            lack = check_number(model_error, "model_error", least=0.0)
        known = level, lack

    candidates: dict[str, Candidate] = {}
    refusals: dict[str, HgoError] = {}
    for name, make in structures.items():
        try:
            candidates[name] = filters.of(make, step, ells, ours=free)
        except HgoError as error:
            refusals[name] = error
    if not candidates:
        raise next(iter(refusals.values()))
    order = min(candidate.n for candidate in candidates.values())
    index = order if state is None else check_integer(state, "state", least=1, most=order)
    remarks: list[str] = []
    reference = None
    turns = {candidate.any.wrap[0] for candidate in candidates.values()}
    if record is not None:
        check(len(turns) == 1, "wrap", turns, "the same for all structures", "give all the same")
        turn = turns.pop()
        warn_of_turns(record.y[:, None], [turn], ["y"], UNWRAP, stacklevel=2)
        record = record if turn is None else record.unwrapped(turn)
        record.moves(order)
        models = {
            name: (candidate.any.model, candidate.n) for name, candidate in candidates.items()
        }
        reference = find(record, sources(models), index - 1, remarks.append)
    reached: dict[str, float] = {}
    count = len(candidates) + free  # and those of a gain that moves
    for candidate in candidates.values():
        candidate.begin(index - 1, *known, reference)
    lean = free and reference is not None and not targets
    glances: dict[str, float] = {}

    def look(name: str, candidate: Candidate) -> None:
        """Its curve and its gain: coarse where it errs far more than others at a glance."""
        try:
            far = glances[name] > _HOPELESS * min(glances.values()) if glances else False
            candidate.look(record, coarse=far)
            if targets:
                reached[name] = candidate.reach(*next(iter(targets.items())))
            else:
                reached[name] = candidate.least_error()
        except HgoError as error:
            refusals[name] = error

    if lean and record is not None:
        glances = {name: candidate.glance(record) for name, candidate in candidates.items()}
    for done, (name, candidate) in enumerate(candidates.items()):
        if progress is not None:
            progress(done, count)
        look(name, candidate)
    if not reached:
        raise next(iter(refusals.values()))

    def cost(name: str) -> float:
        """The noise at the target; else the error over the log, or on paper."""
        if targets:
            return candidates[name].point(reached[name])["noise"]
        if reference is not None:
            return float(np.nanmin(candidates[name].curve.measured))
        if record is not None:
            return float(np.nanmin(candidates[name].curve.innovation))
        return candidates[name].point(reached[name])["error"]

    moving: dict[str, filters.Filter] = {}
    why_none = ""
    if lean and record is not None and reference is not None:
        of_model = [name for name in reached if candidates[name].any.model is not None]
        if of_model:
            near = min(of_model, key=cost)
            moving, why_none = filters.offered(
                cast("System | None", build), candidates[near], reached[near], record, reference
            )
        for name, filter_ in moving.items():
            candidates[name] = filter_
            filter_.begin(index - 1, *known, reference)
            glances[name] = filter_.glance(record)
            look(name, filter_)
    if progress is not None:
        progress(count, count)
    costs = {name: cost(name) for name in reached}
    ranked = sorted(costs, key=costs.__getitem__)
    best = ranked[0]
    moving_gain = why_none and f"{why_none}."
    if any(name in moving for name in ranked):
        assert record is not None
        one = next(name for name in ranked if name in moving)
        other = next(name for name in ranked if name not in moving)
        filtered, constant = (
            (one, moving[one], reached[one]),
            (other, candidates[other], reached[other]),
        )
        clearly, moving_gain = filters.compared(filtered, constant, record)
        best = one if clearly else other
    chosen = candidates[best]
    if free and ells is None and record is not None and chosen.any.model is None and not targets:
        lowest = float(chosen.curve.ell[0])
        remedy = "choose a lower one, or give a model, or a log in which y moves more"
        allowed = "one that the log determines: here the error is least at the lowest gain tried"
        check(reached[best] > lowest * (1.0 + 1e-3), "state", index, allowed, remedy)
    if record is not None and reference is not None:
        chosen.refine(record)
    if record is not None:
        chosen.rounded(record)
        chosen.complete()
    criterion = "least error"
    for name, value in targets.items():
        criterion = f"{name} {value:.4g} " + ("rad/s" if name == "cutoff" else "s")
    ell = reached[best]
    remarks += [f"structure {name!r} was left out: {error}" for name, error in refusals.items()]
    for name in reached:
        of = f"{name}: " if name else ""
        remarks += [of + text for text in candidates[name].left_out()]
    said = [] if free else remarks  # of structures that nobody asked for the report alone tells
    if not targets:
        said += chosen.at_an_edge(ell)
    left = []
    if record is not None and record.u is not None and free and not chosen.any.n_u:
        left.append("u: the observer chosen takes no inputs")
    if record is not None and record.part:
        left.append(record.part)
    whiteness = math.nan
    if record is not None:
        whiteness, doubts = chosen.doubts(ell, record, bool(targets))
        said += doubts
    for text in said:
        warnings.warn(text, TuningWarning, stacklevel=2)
    errors, bounds = chosen.errors(ell, record)
    return Tuning(
        observer=chosen.made(ell),
        ell=ell,
        structure=best,
        state=index,
        criterion=criterion,
        noise=chosen.noise,
        model_error=chosen.model_error,
        point=chosen.point(ell, errors[index - 1]),
        curves={name: candidates[name].curve for name in reached},
        whiteness=whiteness,
        warnings=tuple(said),
        errors=errors,
        bounds=bounds,
        quantisation=0.0 if record is None else record.step(),
        horizon=math.nan if reference is None else reference.horizon,
        judged_by="" if reference is None else reference.name,
        moving_gain=moving_gain,
        tried=tuple((name, reached[name], costs[name]) for name in ranked),
        remarks=(*remarks, *left),
        built={name: candidates[name].made(reached[name]) for name in ranked},
        log=log,
        smoothed=None if reference is None or record is None else (record.t, reference.x),
    )
