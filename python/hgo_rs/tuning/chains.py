"""Gains of an observer of several outputs.

Each chain is smoothed by itself, the smoothed states of the other chains in place of their
estimates, round by round, from chains without a model on.  Then all gains together are those of the
least distance of the whole observer from the smoothed states (`reference`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from hgo_rs.errors import HgoError, check, check_integer
from hgo_rs.models import Model
from hgo_rs.observers import HighGainEKF, MultiOutputObserver, Observer, StandardObserver
from hgo_rs.observers.turns import UNWRAP, warn_of_turns
from hgo_rs.signals import Given
from hgo_rs.tuning.offers import damped_half, with_load
from hgo_rs.tuning.record import MOST, Record, busiest, check_inputs, longest
from hgo_rs.tuning.reference import Reference, Source, butterworth, find
from hgo_rs.tuning.result import Array, Tuning

ChainsBuild = Callable[[Array], MultiOutputObserver]
"""An observer of several outputs with the gains given [1/s], one a chain."""

_MOVING = "high-gain EKF"
_ROUNDS = 2  # of smoothing with the other chains' states
_STEPS = (1.6, 1.6, 1.25, 1.1)  # of a gain, sweep by sweep
_REACH = 24  # steps of one gain in a sweep, at most
_SPAN = 1e-3, 5.0  # of ell dt


def outputs(log: Given) -> int:
    """How many outputs a log has."""
    _, y, *_ = longest(log)
    return y.shape[1] if y.ndim == 2 else 1


def tune_chains(
    build: Model | ChainsBuild | Mapping[str, ChainsBuild],
    log: Given,
    states: Any,
    skip: float | None,
    progress: Callable[[int, int], object] | None = None,
) -> Tuning:
    """As `tune`, for a log of several outputs.

    ``build``: a model of chains, or gains (p,) -> `MultiOutputObserver`, or several of these by
    name.  ``states``: the wanted estimate of each chain, counted from 1 within it.
    """
    structures: dict[str, ChainsBuild]
    free = isinstance(build, Model)
    if isinstance(build, Model):
        structures = offered_chains(build)
    else:
        structures = dict(build) if isinstance(build, Mapping) else {"": build}
    check(bool(structures), "build", build, "at least one observer", "give a Model of chains")
    records = _records(log, skip)
    turns: Sequence[float | None] = [None] * len(records)
    model: Any = build
    if not free:
        model, turns = _model_of(structures, records)
    names = [f"y{i + 1}" for i in range(len(records))]
    whole = np.column_stack([record.y for record in records])
    warn_of_turns(whole, turns, names, UNWRAP, stacklevel=3)
    records = [
        record if turn is None else record.unwrapped(turn)
        for record, turn in zip(records, turns, strict=False)
    ]
    check(not model.unknown, "unknown", model.unknown, "left out", "tune without it")
    orders = model.orders
    told = f"{len(orders)}, a column for each chain of the model"
    check(len(records) == len(orders), "outputs of the log", len(records), told, "name them")
    if model.n_u:
        check_inputs(log, model.n_u)
    wanted = _wanted(states, orders)
    remarks: list[str] = []
    judge = _Judge(records, wanted, _smoothed(records, model, wanted, remarks), orders)
    if free:
        structures[_MOVING] = _filter(model, records, judge.references)
    found: dict[str, tuple[Array, float]] = {}
    for done, (name, make) in enumerate(structures.items()):
        try:
            found[name] = judge.least(make)
        except HgoError as error:
            remarks.append(f"structure {name!r} was left out: {error}")
        if progress is not None:
            progress(done + 1, len(structures))
    check(bool(found), "build", list(structures), "an observer that runs", "; ".join(remarks))
    order = sorted(found, key=lambda name: found[name][1])
    best = order[0]
    ells = found[best][0]
    moving_gain = _compared(order, found) if free else ""
    said = [] if free else list(remarks)
    said += [judge.edge(i, ell) for i, ell in enumerate(ells.tolist()) if judge.edge(i, ell)]
    observer = structures[best](ells)
    errors, bounds = judge.errors(observer, ells)
    each, steps = judge.references, np.array([record.step() for record in records])
    several: dict[str, Any] = {
        "ell": ells,
        "state": np.array(wanted),
        "noise": np.maximum([of.noise for of in each], steps / math.sqrt(12.0)),
        "model_error": np.array([of.model_error for of in each]),
        "quantisation": steps,
        "horizon": np.array([of.horizon for of in each]),
    }
    return Tuning(
        observer=observer,
        structure=best,
        criterion="least error",
        point={},
        curves={},
        warnings=tuple(said),
        errors=errors,
        bounds=bounds,
        judged_by="; ".join(of.name for of in each),
        moving_gain=moving_gain,
        tried=tuple((name, cast("Any", found[name][0]), found[name][1]) for name in order),
        remarks=(*remarks, *filter(None, [records[0].part])),
        **several,
    )


def _compared(order: Sequence[str], found: Mapping[str, tuple[Array, float]]) -> str:
    """How the gains that move with the model's slopes compare with the best constant ones."""
    constant = next((name for name in order if name != _MOVING), None)
    if _MOVING not in found or constant is None:
        return ""
    less = 100.0 * (1.0 - found[_MOVING][1] / found[constant][1])
    return (
        f"The {_MOVING}, whose gains follow the model's Jacobian, has {abs(less):.2g} % "
        f"{'less' if less > 0.0 else 'more'} error over the log than the best constant gains "
        f"({constant}): {'it is' if less > 0.0 else 'these are'} chosen."
    )


def offered_chains(model: Model) -> dict[str, ChainsBuild]:
    """Structures for a model of chains by name."""
    check(bool(model.orders), "model", model, "a Model of chains", "write orders=[...], phi=[...]")
    out: dict[str, ChainsBuild] = {}

    def add(name: str, poles: Callable[[int], Any]) -> None:
        def build(ells: Array) -> MultiOutputObserver:
            chains = [
                StandardObserver(n, float(ell), poles=poles(n))
                for n, ell in zip(model.orders, ells, strict=True)
            ]
            return MultiOutputObserver(chains, model=model)

        out[name] = build

    add("Butterworth", butterworth)
    add("damping 1/2", lambda n: damped_half(n) if n > 1 else [-1.0])
    add("real poles", lambda n: None)
    return out


def _filter(
    model: Model, records: Sequence[Record], references: Sequence[Reference]
) -> ChainsBuild:
    """Kalman filters with one covariance: R of each output as it was found, and Q for which a chain
    alone has the gain asked for, Q = R dt ell^(2n).
    """

    def build(ells: Array) -> MultiOutputObserver:
        chains = []
        each = zip(model.orders, ells.tolist(), records, references, strict=True)
        for n, ell, record, of in each:
            noise = of.noise**2
            chains.append(HighGainEKF(n, R=noise, Q=noise * record.dt * ell ** (2 * n)))
        return MultiOutputObserver(chains, model=model)

    return build


def _records(log: Given, skip: float | None) -> list[Record]:
    """One record for each output, of the same rows."""
    clock, y, u, whole = longest(log)
    t = clock if clock.ndim else float(clock) * np.arange(len(y), dtype=np.float64)
    check(t.shape == (len(y),), "shape of t", t.shape, f"({len(y)},)", "give a time a sample")
    rows = busiest(y, 0, MOST)
    some = None if u is None else u[rows]
    made = [Record.of((t[rows], column, some), skip) for column in y[rows].T]
    return [replace(record, whole=whole) for record in made]


def _model_of(
    structures: Mapping[str, ChainsBuild], records: Sequence[Record]
) -> tuple[Model, Sequence[float | None]]:
    """The model of the first structure that can be made, and the turns of its outputs."""
    remedy = "give ells -> MultiOutputObserver([...], model=model)"
    for make in structures.values():
        check(callable(make), "build", make, "callable", remedy)
        observer: Any = make(np.array([0.1 / record.dt for record in records]))
        check(isinstance(observer, MultiOutputObserver), "build", observer, "one", remedy)
        if isinstance(observer.model, Model):
            return observer.model, observer.wrap
    raise HgoError(f"build: no structure has a model: must have one; {remedy}")


def _wanted(states: Any, orders: Sequence[int]) -> list[int]:
    """The wanted estimate of each chain; by default the last one."""
    given = list(orders) if states is None else states
    given = [given] * len(orders) if isinstance(given, int) else list(given)
    fits = len(given) == len(orders)
    check(fits, "state", given, f"{len(orders)} integers, one a chain", "give one for each output")
    return [
        check_integer(one, f"state[{i}]", least=1, most=n)
        for i, (one, n) in enumerate(zip(given, orders, strict=True))
    ]


def chain_model(model: Model, chain: int) -> Model:
    """One chain alone; the states of the others are inputs behind its own."""
    ends = np.cumsum(model.orders)
    own = slice(int(ends[chain]) - model.orders[chain], int(ends[chain]))
    others = [name for name in model.states if name not in model.states[own]]
    return Model(
        states=model.states[own],
        inputs=[*model.inputs, *others],
        parameters=model.parameters,
        phi=model.known[chain],
    )


def _smoothed(
    records: Sequence[Record], model: Model, wanted: Sequence[int], remarks: list[str]
) -> list[Reference]:
    """The smoothed states of each chain."""
    orders = model.orders
    bare: list[list[Source]] = [
        [(f"order {m}, no model", None, m, n) for m in (max(n, 2), max(n, 2) + 1)] for n in orders
    ]
    found = []
    for c, record in enumerate(records):
        reference = find(record, bare[c], wanted[c] - 1, remarks.append)
        if reference is None:
            raise HgoError(
                f"output {c + 1} cannot be smoothed ({'; '.join(remarks) or 'it stands still'}); "
                "gains of several outputs are tuned against smoothed states; give a longer log, or "
                "tune each chain alone"
            )
        found.append(reference)
    for _ in range(_ROUNDS):
        for c, record in enumerate(records):
            others = [found[i].x for i in range(len(orders)) if i != c]
            middle = np.hstack(others)
            middle[:-1] = 0.5 * (middle[:-1] + middle[1:])  # over the period that begins
            u = middle if record.u is None or not model.inputs else np.hstack([record.u, middle])
            alone = chain_model(model, c)
            n = orders[c]
            sources: list[Source] = [
                ("the model", alone, n, n),
                ("the model and a load", with_load(alone), n + 1, n),
                *bare[c],
            ]
            notes: list[str] = []
            better = find(replace(record, u=u), sources, wanted[c] - 1, notes.append)
            found[c] = better or found[c]
    return found


@dataclass(frozen=True)
class _Judge:
    """Errors of a whole observer by its distance from the smoothed states."""

    records: Sequence[Record]
    wanted: Sequence[int]
    references: Sequence[Reference]
    orders: Sequence[int]

    def _estimates(self, observer: Observer) -> list[Array]:
        first = self.records[0]
        y = np.column_stack([record.y for record in self.records])
        start = np.concatenate([reference.start for reference in self.references])
        u = first.u if observer.n_u else None
        x_hat = observer.run(first.t, y, u, x_hat0=start).x_hat
        return np.split(x_hat, np.cumsum(self.orders)[:-1], axis=1)

    def cost(self, make: ChainsBuild, ells: Array) -> float:
        """The geometric mean of the wanted errors; infinite where the observer is refused."""
        try:
            parts = self._estimates(make(ells))
        except HgoError:
            return math.inf
        total = 0.0
        for c, part in enumerate(parts):
            index, of = self.wanted[c] - 1, self.references[c]
            far = of.distance(part, self.records[c], index)
            total += math.log(max(math.hypot(far, of.spread[index]), 1e-300))
        return math.exp(total / len(parts)) if math.isfinite(total) else math.inf

    def limits(self, chain: int) -> tuple[float, float]:
        dt = self.records[chain].dt
        return _SPAN[0] / dt, _SPAN[1] / dt

    def least(self, make: ChainsBuild) -> tuple[Array, float]:
        """Gains of the least cost, gain by gain with steps that shrink; and the cost."""
        ells = np.array([of.ell for of in self.references])
        cost = self.cost(make, ells)
        for _ in range(_REACH):  # a start that is refused is often too high for the method
            if math.isfinite(cost):
                break
            ells = ells / _STEPS[0]
            cost = self.cost(make, ells)
        check(math.isfinite(cost), "gains", ells.tolist(), "of a stable observer", "another method")
        for step in _STEPS:
            for c in range(len(ells)):
                ells, cost = self._along(make, ells, cost, c, step)
        return ells, cost

    def _along(
        self, make: ChainsBuild, ells: Array, cost: float, chain: int, step: float
    ) -> tuple[Array, float]:
        """The least cost along one gain, in steps of a factor, and between them by a parabola."""
        low, high = self.limits(chain)

        def at(power: float) -> tuple[Array, float]:
            tried = ells.copy()
            tried[chain] = np.clip(tried[chain] * step**power, low, high)
            return tried, self.cost(make, tried)

        known = {0: (ells, cost), 1: at(1), -1: at(-1)}
        k = 0
        for _ in range(_REACH):
            best = min((k - 1, k, k + 1), key=lambda j: known[j][1])
            if best == k or not low < known[best][0][chain] < high:
                k = best
                break
            k = best
            for j in (k - 1, k + 1):
                known.setdefault(j, at(j))
        if k - 1 in known and k + 1 in known:
            left, here, right = (math.log(known[j][1]) for j in (k - 1, k, k + 1))
            bend = left - 2.0 * here + right
            if math.isfinite(bend) and bend > 0.0:
                between = at(k + 0.5 * (left - right) / bend)
                if between[1] < known[k][1]:
                    return between
        return known[k]

    def errors(self, observer: Observer, ells: Array) -> tuple[Array, Array]:
        """RMS errors of all estimates, and what they hardly exceed, (n,)."""
        error, bound = [], []
        for c, part in enumerate(self._estimates(observer)):
            record, of = self.records[c], self.references[c]
            lasted = record.dt * float(np.sum(record.two_sided)) * float(ells[c])
            for i in range(part.shape[1]):
                far = of.distance(part, record, i)
                error.append(math.hypot(far, of.spread[i]))
                bound.append((far + of.spread[i]) * (1.0 + 2.0 / math.sqrt(max(lasted, 1.0))))
        return np.array(error), np.array(bound)

    def edge(self, chain: int, ell: float) -> str:
        """What to say of a gain at an end of those that are tried; nothing of others."""
        low, high = self.limits(chain)
        if low * 1.001 < ell < high * 0.999:
            return ""
        end = "lowest" if ell <= low * 1.001 else "highest"
        return f"the least error of output {chain + 1} is at the {end} gain tried, {ell:.4g} /s"
