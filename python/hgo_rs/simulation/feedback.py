"""Feedback: a controller on estimates, and what is watched in the loop that it closes."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hgo_rs.errors import HgoError, check, check_array, check_choice, check_integer, check_number
from hgo_rs.expressions import nodes
from hgo_rs.expressions.errors import ExpressionError
from hgo_rs.expressions.grammar import unknown
from hgo_rs.expressions.nodes import Node
from hgo_rs.expressions.table import compile_table
from hgo_rs.models import Plant, Ship, System
from hgo_rs.models.own.names import Names
from hgo_rs.models.own.sources import Arguments, Group, read_group
from hgo_rs.observers import Observer
from hgo_rs.read_only import ReadOnlyDict

SOURCES = ("estimate", "state")
"""What a feedback sees: the observer's estimates, or the true states in their place."""

COST = "cost"
"""The state that a cost is integrated in."""

_LONGEST_DELAY = 64
"""Sampling periods of the longest delay."""
_ORDER = 16
"""States that a controller may have."""


class Controller:
    """A feedback with states of its own: u = outputs(t, y, x_hat, c), c' = drift(t, y, x_hat, c).

    Expressions name the time `t`, the measured output `y` (`y1`, `y2`, ... where there are
    several), the estimate of each state by its name with `_hat`, the controller's own states,
    references and parameters. A callable takes (t, y, x_hat), then c where there are states and r
    where there are references.

    Parameters
    ----------
    outputs : dict of input of the plant: expression or callable
    states : list of names, optional
    drift : list of expressions or a callable, optional
        Rates of the states. Between samples y and the estimates are held (RK4); in mode "joint"
        they are a part of the one differential equation.
    update : the same, optional
        In place of `drift`: the states at the next sample. Mode "sampled" only.
    start : (n_c,), optional
        The states at the start. Default: 0.
    references : dict of name: expression of t, optional
        Signals to follow.
    parameters : dict of name: value, optional
        Constants that have names.

    Raises
    ------
    HgoError
        A name that is reserved or doubled; both of drift and update, or none for states; a start of
        another length.
    """

    def __init__(
        self,
        outputs: Mapping[str, Any],
        *,
        states: Sequence[str] = (),
        drift: Any = None,
        update: Any = None,
        start: Any = None,
        references: Mapping[str, Any] | None = None,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        given = isinstance(outputs, Mapping) and bool(outputs)
        check(given, "feedback", outputs, "a dict of input: expression", 'write {"u": "-x1_hat"}')
        self.outputs = dict(outputs)
        self.references = dict(references or {})
        # a controller may have no state, a list of names must have one
        names = Names.of([*states, *self.references] or ["no_state"], (), parameters)
        names.leave_alone(("t", "y"))
        self.states, self.parameters = tuple(states), dict(names.parameters)
        most = f"at most {_ORDER} names"
        check(len(self.states) <= _ORDER, "states", list(states), most, "use fewer states")
        one = (drift is None) != (update is None) if self.states else drift is update is None
        allowed = "either drift or update for states, neither without"
        check(one, "drift", "both" if drift is not None else drift, allowed, "give one of them")
        self.drift, self.update = drift, update
        values = np.zeros(len(self.states)) if start is None else check_array(start, "start")
        fits = values.shape == (len(self.states),) and bool(np.all(np.isfinite(values)))
        check(fits, "start", start, f"{len(self.states)} finite numbers", "give one a state")
        self.start = values

    @property
    def moves(self) -> Any:
        """Rates of the states, or their next values."""
        return self.update if self.drift is None else self.drift


@dataclass(frozen=True)
class Loop:
    """A plant in a loop, and where its numbers stand behind the plant's own states.

    Attributes
    ----------
    plant : System
        What moves: with the integral of the cost as its last state where there is one.
    states : names of the plant's own states
    inputs, signals : names
    controller : names of the controller's states
    waits : inputs that are computed and not yet in force
    has_cost : whether there is the integral of a cost
    converged : signal -> bound, or "" -> bound of the norm of the plant's state
    spec : what the core and the reference read, None without a loop
    """

    plant: System
    states: tuple[str, ...]
    inputs: tuple[str, ...] = ()
    signals: tuple[str, ...] = ()
    controller: tuple[str, ...] = ()
    waits: int = 0
    has_cost: bool = False
    converged: Mapping[str, float] | None = None
    spec: Mapping[str, Any] | None = None

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of all numbers of a frame of the state: the plant's, then the loop's."""
        cost = (COST,) if self.has_cost else ()
        turns = range(1, self.waits // max(1, len(self.inputs)) + 1)
        waiting = tuple(f"{name}_waiting{i}" for i in turns for name in self.inputs)
        return (*self.states, *cost, *self.inputs, *self.signals, *waiting, *self.controller)

    @property
    def columns_apart(self) -> tuple[str, ...]:
        """The same, each name once: a signal that is called like another column has `_signal`."""
        names: list[str] = []
        for name in self.columns:
            names.append(f"{name}_signal" if name in names else name)
        return tuple(names)

    def place(self, name: str) -> int:
        """The column of a name: of the signal, where one is called like a state or an input."""
        if name in self.signals:
            return len(self.states) + self.has_cost + len(self.inputs) + self.signals.index(name)
        return self.columns.index(name)


def close(
    plant: System,
    observer: Observer,
    sizes: tuple[int, int],
    *,
    feedback: Controller | Mapping[str, Any] | None,
    feedback_from: str,
    feedback_delay: int,
    signals: Mapping[str, Any] | Sequence[str] | None,
    settle_signals: Mapping[str, float] | None,
    cost: Any,
    converged: float | Mapping[str, float] | None,
) -> Loop:
    """The loop that the arguments of `simulate` describe; `sizes`: the plant's states and outputs.

    Raises
    ------
    HgoError
        A plant with inputs without feedback, and the reverse; an expression of what a controller
        does not see; a signal, threshold or cost that cannot be.
    """
    inputs = tuple(plant.inputs) if isinstance(plant, Plant) else ()
    if feedback is None:
        remedy = f'write feedback={{"{inputs[0] if inputs else "u"}": "0"}}, or an expression of t'
        check(not inputs, "feedback", None, f"given for the inputs {list(inputs)}", remedy)
        controller = None
    else:
        allowed = "for a Plant with inputs"
        check(inputs, "feedback", "...", allowed, "write Plant(..., inputs=['u'])")
        controller = feedback if isinstance(feedback, Controller) else Controller(feedback)
        strangers = [name for name in controller.outputs if name not in inputs]
        if strangers:
            raise HgoError(f"feedback: {unknown(str(strangers[0]), inputs, 'input of the plant')}")
        missing = [name for name in inputs if name not in controller.outputs]
        allowed = f"given for every input: {missing} missing"
        check(not missing, "feedback", list(controller.outputs), allowed, 'write "0" for none')
    check_choice("feedback_from", feedback_from, SOURCES)
    delay = check_integer(feedback_delay, "feedback_delay", least=0, most=_LONGEST_DELAY)
    words = _Words.of(plant, observer, sizes, inputs, controller)
    moved, has_cost = plant, cost is not None
    if has_cost:
        moved, words = _with_cost(plant, cost), replace(words, cost=(COST,))
    watched = _watched(words, signals, controller is not None)
    apart = not has_cost or COST not in watched
    check(apart, "signals", COST, "another name beside cost=", "the result uses it; rename it")
    levels = _levels("settle_signals", settle_signals or {}, watched)
    ends = _converged(converged, watched)
    if controller is None and not watched:
        return Loop(moved, words.states, has_cost=has_cost, converged=ends)
    spec = _spec(words, controller, feedback_from, delay, watched, levels, observer)
    return Loop(
        moved,
        words.states,
        inputs,
        tuple(watched),
        words.controller,
        delay * len(inputs),
        has_cost,
        ends,
        spec,
    )


@dataclass(frozen=True)
class _Words:
    """Names that expressions of a loop may use."""

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    estimates: tuple[str, ...]
    controller: tuple[str, ...]
    known: int
    """Estimates, from the first on, that have a true value."""
    cost: tuple[str, ...] = ()
    """The state in which a cost is integrated."""

    @classmethod
    def of(
        cls,
        plant: System,
        observer: Observer,
        sizes: tuple[int, int],
        inputs: tuple[str, ...],
        controller: Controller | None,
    ) -> _Words:
        nx, n_y = sizes
        states = plant.states if isinstance(plant, Plant) else _numbered("x", nx)
        model = observer.spec.get("model") or {}
        named = tuple(model["names"]["states"])[-observer.n :] if "names" in model else ()
        # an observer that knows no names estimates a ship's velocities, of others the first states
        first = 3 if isinstance(plant, Ship) else 0
        named = named or states[first : first + observer.n]
        rest = _numbered("x", observer.n)[len(named) :]
        estimates = tuple(f"{name}_hat" for name in (*named, *rest))
        outputs = ("y",) if n_y == 1 else _numbered("y", n_y)
        mine = controller.states if controller else ()
        groups = {
            "state of the plant": states,
            "input": inputs,
            "output": outputs,
            "estimate": estimates,
            "state of the controller": mine,
            "reference": tuple(controller.references) if controller else (),
            "parameter of the controller": tuple(controller.parameters) if controller else (),
        }
        taken: dict[str, str] = {}
        for role, names in groups.items():
            for name in names:
                if name in taken and controller is not None:
                    allowed, remedy = "a name of its own", f"it is a {taken[name]} too; rename it"
                    check(False, role, name, allowed, remedy)
                taken[name] = role
        return cls(states, inputs, outputs, estimates, mine, min(len(named), len(states)))

    @property
    def y(self) -> tuple[str, tuple[str, ...] | None]:
        """The measured outputs, as an argument."""
        return ("y", None) if self.outputs == ("y",) else ("y", self.outputs)

    def arguments(self) -> Arguments:
        """What a controller sees."""
        groups = [("t", None), self.y, ("x_hat", self.estimates)]
        return Arguments((*groups, *([("c", self.controller)] if self.controller else [])))

    def all_arguments(self) -> Arguments:
        """What a signal is made of."""
        own = [("x", (*self.states, *self.cost)), *([("u", self.inputs)] if self.inputs else [])]
        first, *rest = self.arguments().groups
        return Arguments((first, *own, *rest))


def _numbered(name: str, count: int) -> tuple[str, ...]:
    return tuple(f"{name}{i + 1}" for i in range(count))


def _compiled(group: Group, label: str) -> tuple[Node, ...]:
    """The expressions of a group; a loop runs compiled, or not at all."""
    if group.nodes is None:
        raise HgoError(
            f"{label} is not compiled ({group.reason}): must be made of expressions; write it with "
            "np.where, np.maximum, np.sin and the like"
        )
    return group.nodes


def _law(words: _Words, controller: Controller) -> dict[str, tuple[Node, ...]]:
    """The expressions of a controller, its references in their places."""
    names = Names(words.controller, (), controller.parameters)
    references: dict[str, Node] = {}
    for name, source in controller.references.items():
        label = f"references[{name!r}]"
        group = read_group(label, source, Arguments((("t", None),)), names, ())
        (references[name],) = _compiled(group, label)
    # a string may name more than a controller sees, so that it is told what it does not see
    hidden = (*words.states, *words.inputs)
    seen = words.arguments()
    symbols = (*seen.groups, ("r", tuple(references)))
    wide = Arguments((*symbols, ("hidden", hidden)))
    narrow = Arguments(symbols) if references else seen

    def read(label: str, source: Any, shape: tuple[int, ...]) -> tuple[Node, ...]:
        arguments = narrow if callable(source) else wide
        try:
            found = _compiled(read_group(label, source, arguments, names, shape), label)
        except ExpressionError:
            read_group(label, source, narrow, names, shape)  # names what a controller sees alone
            raise
        for name in nodes.symbols(found):
            if name in words.states:
                remedy = (
                    f"write {name}_hat, and feedback_from='state' where it is to be the true value"
                    if f"{name}_hat" in words.estimates
                    else f"choose among {', '.join(words.estimates)}"
                )
                allowed = f"of what a controller sees: {name} is a state of the plant"
                check(False, label, str(source), allowed, remedy)
            if name in words.inputs:
                allowed = f"of what a controller sees: {name} is an input of the plant"
                check(False, label, str(source), allowed, "write its expression again")
        return tuple(nodes.replaced(found, references))

    sides = {
        name: read(f"feedback[{name!r}]", controller.outputs[name], ()) for name in words.inputs
    }
    if words.controller:
        label = "update" if controller.drift is None else "drift"
        sides["moves"] = read(label, controller.moves, (len(words.controller),))
    return sides


def _watched(words: _Words, signals: Any, closed: bool) -> dict[str, Node]:
    """Name -> expression of each signal; in a loop the plant's states and inputs by default."""
    if signals is None:
        signals = (*words.states, *words.inputs) if closed else ()
    if not isinstance(signals, Mapping):
        listed = isinstance(signals, Sequence) and not isinstance(signals, str)
        allowed = "names, or a dict of name: expression"
        check(listed, "signals", signals, allowed, 'write {"gap": "x1 - sin(t)"}')
        signals = {name: name for name in signals}
    found: dict[str, Node] = {}
    arguments = words.all_arguments()
    for name, source in signals.items():
        check(isinstance(name, str) and name.isidentifier(), "signals", name, "a name", "rename it")
        taken = re.fullmatch(r"(e|x_hat|memory)\d+", name) is not None
        check(not taken, "signals", name, "no column of the estimates' metrics", "rename it")
        label = f"signals[{name!r}]"
        group = read_group(label, source, arguments, Names((), (), {}), ())
        (found[name],) = _compiled(group, label)
    return found


def _levels(label: str, levels: Any, watched: Mapping[str, Node]) -> dict[str, float]:
    """Signal -> threshold."""
    listed = isinstance(levels, Mapping)
    check(listed, label, levels, "a dict of signal: threshold", 'write {"x1": 0.01}')
    for name in levels:
        if name not in watched:
            raise HgoError(f"{label}: {unknown(str(name), watched, 'signal')}")
    return {
        name: check_number(value, f"{label}[{name!r}]", above=0.0) for name, value in levels.items()
    }


def _converged(bound: Any, watched: Mapping[str, Node]) -> dict[str, float] | None:
    if bound is None:
        return None
    if isinstance(bound, Mapping):
        return _levels("converged", bound, watched)
    return {"": check_number(bound, "converged", above=0.0)}


def _with_cost(plant: System, cost: Any) -> Plant:
    """The plant with the integral of a cost as its last state."""
    own = isinstance(plant, Plant)
    check(own, "cost", cost, "used with a Plant", "write the plant's equations as a Plant")
    assert isinstance(plant, Plant)
    free = COST not in plant.states
    check(free, "cost", cost, "used with states of other names", f"rename the state {COST!r}")
    arguments = plant.arguments_of_sides
    names = Names(plant.states, plant.inputs, plant.parameters)
    (rate,) = _compiled(read_group("cost", cost, arguments, names, ()), "cost")
    sides = plant.equations
    more = {"diffusion": [*sides["diffusion"], 0.0]} if plant.noisy else {}
    return Plant(
        states=[*plant.states, COST],
        inputs=plant.inputs,
        parameters=plant.parameters,
        drift=[*plant.drift, rate],
        output=list(plant.outputs),
        **more,
    )


def _spec(
    words: _Words,
    controller: Controller | None,
    source: str,
    delay: int,
    watched: Mapping[str, Node],
    levels: Mapping[str, float],
    observer: Observer,
) -> Mapping[str, Any]:
    """The loop as plain data."""
    sides = _law(words, controller) if controller else {}
    parameters = controller.parameters if controller else {}
    roots = [node for side in sides.values() for node in side]
    if source == "state":
        lost = words.estimates[words.known :]
        for name in nodes.symbols(roots):
            allowed = f"of estimates that have a true value: {name} has none"
            remedy = "write another feedback for the state"
            check(name not in lost, "feedback_from", source, allowed, remedy)
    seen = words.arguments().symbols
    law = compile_table(
        roots,
        {name: name for name in (*seen, *parameters)},
        [*words.inputs, *words.controller],
        fixed=tuple(parameters),
    )
    everything = words.all_arguments().symbols
    shown = compile_table(
        list(watched.values()),
        {name: name for name in (*everything, *parameters)},
        list(watched),
        fixed=tuple(parameters),
    )
    return ReadOnlyDict(
        {
            "law": law,
            "signals": shown,
            "parameters": list(parameters.values()),
            "delay": delay,
            "from": source,
            "continuous": controller is None or controller.update is None,
            "start": controller.start if controller else np.zeros(0),
            "tells": _told(observer, words.inputs) if words.inputs else [],
            "settle": np.array([levels.get(name, math.nan) for name in watched]),
        }
    )


def _told(observer: Observer, inputs: tuple[str, ...]) -> list[int]:
    """For each input of the observer's model the plant's of that name."""
    model = observer.spec.get("model") or {}
    if "names" not in model:
        count = observer.n_u
        fits = count in (0, len(inputs))
        allowed = f"{count}, as the observer's model has"
        check(fits, "inputs of the plant", list(inputs), allowed, "give a Model with named inputs")
        return list(range(count))
    names = list(model["names"]["inputs"])
    for name in names:
        remedy = "give the inputs of the plant and of the model the same names, or with_inputs"
        allowed = f"such that {names}, which the observer's model takes, are among them"
        check(name in inputs, "inputs of the plant", list(inputs), allowed, remedy)
    return [inputs.index(name) for name in names]


__all__ = ["COST", "SOURCES", "Controller", "Loop", "close"]
