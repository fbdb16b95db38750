"""Observers and what else one would take, on one record."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from hgo_rs.errors import HgoError, check, check_array, check_choice, check_number, explain, need
from hgo_rs.markup import number, table
from hgo_rs.models import System
from hgo_rs.observers import Observer
from hgo_rs.observers.turns import nearest
from hgo_rs.smoothing import baselines as built_in
from hgo_rs.smoothing.motion import Motion
from hgo_rs.smoothing.result import Smoothed
from hgo_rs.smoothing.samples import Array, Given, Samples
from hgo_rs.smoothing.smoother import of_samples
from hgo_rs.tuning import Tuning

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SKIP = 0.05  # of the record, at its start


@dataclass(frozen=True, eq=False, repr=False)
class Comparison:
    """Errors of several estimates over one record.

    Attributes
    ----------
    states : tuple of str
        What is compared.
    methods : tuple of str
    rules : tuple of str
        How each was tuned.
    error : (methods, states)
        RMS error after `skip`; NaN where a method has no such estimate. Compared with a smoothed
        state it includes the deviation of that state: error^2 = distance^2 + deviation^2.
    truth : (N, states)
    deviation : (states,)
        Standard deviation of the truth; 0 where it was given.
    judged_by : str
        What the truth is.
    estimates : dict of method -> (N, states)
    t : (N,) [s]
    skip : float
        Time at the start that is not evaluated [s].
    remarks : tuple of str
        Baselines that were left out, and why.
    """

    states: tuple[str, ...]
    methods: tuple[str, ...]
    rules: tuple[str, ...]
    error: Array
    truth: Array = field(repr=False)
    deviation: Array
    judged_by: str
    estimates: dict[str, Array] = field(repr=False)
    t: Array = field(repr=False)
    skip: float
    remarks: tuple[str, ...] = ()

    def best(self, state: str) -> str:
        """The method of the least error in a state."""
        errors = self.error[:, self.states.index(check_choice("state", state, self.states))]
        remedy = "compare a state that a method estimates"
        check(np.isfinite(errors).any(), "state", state, "estimated by a method", remedy)
        return self.methods[int(np.nanargmin(errors))]

    def columns(self) -> dict[str, Any]:
        """The table as named columns."""
        out: dict[str, Any] = {"method": list(self.methods), "tuned": list(self.rules)}
        return out | dict(zip(self.states, self.error.T, strict=True))

    def to_csv(self) -> str:
        """`columns` as CSV."""
        columns = self.columns()
        rows = [",".join(columns)]
        for method, rule, *errors in zip(*columns.values(), strict=True):
            named = ",".join('"' + text.replace('"', '""') + '"' for text in (method, rule))
            rows.append(",".join([named, *(repr(float(error)) for error in errors)]))
        return "\n".join(rows) + "\n"

    def to_dataframe(self) -> Any:
        """A pandas DataFrame of `columns`, indexed by method. Needs the extra `data`."""
        pd = need("pandas", "a table needs pandas", "data")
        return pd.DataFrame(self.columns()).set_index("method")

    def plot(self, figure: Figure | None = None) -> Figure:
        """Draw the errors as bars, a panel a state. Needs the extra `plot`."""
        from hgo_rs.plots import error_figure

        title = f"RMS error, compared with {self.judged_by}"
        columns = dict(zip(self.states, self.error.T, strict=True))
        return error_figure(self.methods, columns, title=title, figure=figure)

    def __repr__(self) -> str:
        return f"Comparison({', '.join(self.methods)}; {', '.join(self.states)})"

    def _repr_html_(self) -> str:
        """The table, as text has it."""
        head = f"RMS error after {self.skip:.4g} s, compared with {self.judged_by}"
        rows = [
            (name, *map(number, errors), rule)
            for name, rule, errors in zip(
                self.methods, self.rules, self.error.tolist(), strict=True
            )
        ]
        return table(head, rows, ["method", *self.states, "tuned"])

    def __str__(self) -> str:
        wide = max(len(name) for name in (*self.methods, "method"))
        head = f"{'method':{wide}s} " + " ".join(f"{name:>10s}" for name in self.states)
        lines = [
            f"RMS error after {self.skip:.4g} s, compared with {self.judged_by}",
            f"{head}  tuned",
        ]
        for name, rule, errors in zip(self.methods, self.rules, self.error, strict=True):
            numbers = " ".join(f"{'-' if e != e else format(e, '.4g'):>10s}" for e in errors)
            lines.append(f"{name:{wide}s} {numbers}  {rule}")
        return "\n".join([*lines, *(f"left out: {text}" for text in self.remarks)])


def compare(
    log: Given,
    observers: Mapping[str, Any] | None = None,
    *,
    model: System | None = None,
    truth: Any = None,
    baselines: Iterable[str] | None = None,
    skip: float | None = None,
) -> Comparison:
    """Compare observers and common filters over one record, in one table.

    Parameters
    ----------
    log : Log, frame, (t, y) or (t, y, u)
        As in `smooth`.
    observers : dict of name -> Observer, Tuning or (N, n) array, optional
        An observer starts at the first sample; its present memory is not used. An array holds
        estimates of your own. An output that wraps for one of them is unwrapped for all, and the
        error of its state is taken up to whole turns.
    model : System, optional
        Model of the smoothed state and of the extended Kalman filter. Default: that of the first
        observer with one.
    truth : (N, states) array, dict of state -> (N,), or Smoothed, optional
        Reference of a better sensor; NaN where it is not known. Default: the smoothed state.
    baselines : names, optional
        Of `hgo_rs.smoothing.BASELINES`; default all, the extended Kalman filter where there is a
        model; () for none. Each is tuned by its own rule, without the truth.
    skip : float, optional
        Time at the start that is not evaluated [s]. Default: a twentieth of the record.

    Raises
    ------
    HgoError
        What `smooth` and `Observer.run` refuse; shapes that do not fit; an unknown baseline;
        observers with different turns.

    Warns
    -----
    TurnWarning
        An output that jumps by a turn while no observer has a `wrap`.
    """
    remedy = 'give names with them, such as {"mine": observer}'
    named = observers is None or isinstance(observers, Mapping)
    check(named, "observers", observers, "a dict of observers", remedy)
    given = dict(observers or {})
    listed = baselines is None or (
        isinstance(baselines, Iterable) and not isinstance(baselines, str)
    )
    remedy = 'write ["Kalman, random jerk"], or () for none'
    check(listed, "baselines", baselines, "a list of names", remedy)
    known = model if model is not None else _model_of(given.values())
    motion = Motion(known, None if known is not None else 3)
    turns = _turns(given, len(motion.orders))
    samples = Samples.of(log, len(motion.orders), motion.n_u).unwrapped(turns)
    samples.warn_of_turns(stacklevel=2)
    length = float(samples.t[-1] - samples.t[0])
    start = _SKIP * length if skip is None else check_number(skip, "skip", least=0.0, below=length)
    states, true, deviation, judged_by = _truth(truth, motion, samples)
    usual = built_in.BASELINES if known is not None else tuple(built_in.DIFFERENTIATORS)
    wanted = usual if baselines is None else tuple(baselines)
    for name in wanted:
        check_choice("baselines", name, built_in.BASELINES)
    estimates: dict[str, Array] = {}
    rules: list[str] = []
    for name, one in given.items():
        estimates[name], rule = _estimate(name, one, samples, motion)
        rules.append(rule)
    remarks: list[str] = []
    for name in wanted:
        try:
            x, rule = _baseline(name, known, motion, samples)
        except HgoError as error:
            remarks.append(f"{name}: {error}")
            continue
        estimates[f"{name} (baseline)" if name in estimates else name] = x
        rules.append(rule)
    remedy = "give an observer, or baselines"
    check(bool(estimates), "observers", observers, "at least one that runs", remedy)
    late = samples.t - samples.t[0] >= start
    kept = [motion.names.index(name) for name in states]
    chosen = {name: x[:, kept] for name, x in estimates.items()}
    lengths = np.full(motion.n, math.nan)
    lengths[list(motion.first)] = [math.nan if turn is None else turn for turn in turns]
    errors = np.array([_error(x, true, late, lengths[kept]) for x in chosen.values()])
    return Comparison(
        states=states,
        methods=tuple(chosen),
        rules=tuple(rules),
        error=np.hypot(errors, deviation),
        truth=true,
        deviation=deviation,
        judged_by=judged_by,
        estimates=chosen,
        t=samples.t,
        skip=start,
        remarks=tuple(remarks),
    )


def _turns(observers: Mapping[str, Any], count: int) -> list[float | None]:
    """The turn of each output, as the observers that know one say."""
    found: list[float | None] = [None] * count
    for name, one in observers.items():
        observer = one.observer if isinstance(one, Tuning) else one
        own = observer.wrap if isinstance(observer, Observer) and observer.n_y == count else ()
        for i, turn in enumerate(own):
            fits = turn is None or found[i] in (None, turn)
            allowed = f"{found[i]}, as of the observers before"
            check(fits, f"wrap of {name!r}", turn, allowed, "give all the same turn")
            found[i] = turn or found[i]
    return found


def _model_of(observers: Iterable[Any]) -> System | None:
    """The first model that an observer has."""
    for one in observers:
        observer = one.observer if isinstance(one, Tuning) else one
        found = getattr(observer, "model", None)
        if found is not None:
            return found if isinstance(found, System) else None
    return None


def _truth(
    truth: Any, motion: Motion, samples: Samples
) -> tuple[tuple[str, ...], Array, Array, str]:
    """States, their true values (N, states), their deviations, and what they are."""
    names, count = motion.names, len(samples.t)
    if truth is None:
        truth = of_samples(motion, samples)
    if isinstance(truth, Smoothed):
        fits = truth.x.shape == (count, motion.n) and truth.states == names
        remedy = "smooth this log with the model that is compared"
        check(fits, "truth", truth.states, f"of {count} samples and states {names}", remedy)
        spread = np.sqrt(np.mean(truth.deviation**2, axis=0))
        return names, truth.x, spread, "the smoothed state"
    if isinstance(truth, Mapping):
        for name in truth:
            check_choice("truth", name, names)
        states = tuple(name for name in names if name in truth)
        columns = [check_array(truth[name], f"truth[{name!r}]") for name in states]
        shapes = [column.shape for column in columns]
        check(
            set(shapes) == {(count,)}, "truth", shapes, f"({count},) each", "give a value a sample"
        )
        return states, np.column_stack(columns), np.zeros(len(states)), "the truth given"
    values = check_array(truth, "truth")
    allowed = f"({count}, {motion.n}), or a dict of states"
    check(values.shape == (count, motion.n), "truth", values.shape, allowed, "give one of these")
    return names, values, np.zeros(motion.n), "the truth given"


def _estimate(name: str, one: Any, samples: Samples, motion: Motion) -> tuple[Array, str]:
    """Estimates of an observer in the places of the model's states, and how it was tuned."""
    rule = "as given"
    if isinstance(one, Tuning):
        one, rule = one.observer, f"hgo.tune: {one.criterion}"
    if not isinstance(one, Observer):
        x = check_array(one, f"observers[{name!r}]")
        fits = x.ndim == 2 and len(x) == len(samples.t)
        allowed = f"an Observer, a Tuning, or ({len(samples.t)}, n) numbers"
        check(fits, f"observers[{name!r}]", x.shape, allowed, "give one of these")
        return _placed(x, None, motion, 0), "own estimates"
    u: Any = samples.u if one.n_u else None
    if one.n_u and one.n_u != samples.u.shape[1]:
        told = f"{samples.u.shape[1]}, those of the model that is compared"
        raise HgoError(explain(f"inputs of {name!r}", one.n_u, told, "give both the same model"))
    if one.n_y == len(motion.orders):
        run = one.run(samples.t, samples.y, u, start=one._usual_start)
        names = getattr(one.model, "states", None)
        return _placed(np.array(run.x_hat), names, motion, 0), rule
    told = f"{len(motion.orders)}, those of the model that is compared"
    raise HgoError(explain(f"outputs of {name!r}", one.n_y, told, "give an observer of as many"))


def _placed(x: Array, names: Sequence[str] | None, motion: Motion, channel: int) -> Array:
    """Estimates in the places of the model's states: by name where names are shared, else down the
    chain of an output; NaN elsewhere.
    """
    out = np.full((len(x), motion.n), math.nan)
    if names is not None and set(names) & set(motion.names):
        for i, name in enumerate(names[: x.shape[1]]):
            if name in motion.names:
                out[:, motion.names.index(name)] = x[:, i]
        return out
    if x.shape[1] == motion.n:
        return x
    first = motion.first[channel]
    count = min(x.shape[1], motion.orders[channel])
    out[:, first : first + count] = x[:, :count]
    return out


def _baseline(
    name: str, model: System | None, motion: Motion, samples: Samples
) -> tuple[Array, str]:
    """A baseline in the places of the model's states, output by output."""
    if name == built_in.EXTENDED:
        remedy = "give a model, or leave this baseline out"
        check(model is not None, "model", None, "known", remedy)
        found = built_in.extended(motion, samples)
        return found.x, found.rule
    out, rule = np.full((len(samples.t), motion.n), math.nan), ""
    for channel in range(len(motion.orders)):
        found = built_in.DIFFERENTIATORS[name](built_in.of_channel(samples, channel))
        placed = _placed(found.x, None, motion, channel)
        out, rule = np.where(np.isnan(placed), out, placed), found.rule
    return out, rule


def _error(x: Array, true: Array, late: Any, lengths: Array) -> Array:
    """RMS of x - true over the samples at which the truth is known; NaN without an estimate.

    ``lengths``: turns up to which a state is known, NaN where it has none.
    """
    with np.errstate(all="ignore"):
        off = nearest(x - true, lengths)
        square = np.where(np.isfinite(true) & late[:, None], off**2, math.nan)
    there = np.isfinite(true) & late[:, None]
    missing = np.any(np.isnan(x) & there, axis=0) | ~there.any(axis=0)
    total = np.nansum(square, axis=0) / np.maximum(there.sum(axis=0), 1)
    return np.where(missing, math.nan, np.sqrt(total))
