"""Structures and poles to choose among, from a model or from none."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from hgo_rs.expressions import nodes
from hgo_rs.expressions.nodes import Node
from hgo_rs.models import InputGain, Model, System, Unknown
from hgo_rs.observers import LowPowerObserver, Observer, StandardObserver
from hgo_rs.tuning.reference import Source, butterworth

Build = Callable[[float], Observer]
"""An observer with the gain given [1/s]."""

SIXTY = complex(-0.5, 0.75**0.5)
LARGEST = 12
"""Order of a law."""
SLOW = -0.1
"""Pole of a load that changes seldom, beside those of the other states."""


def damped_half(n: int) -> list[complex]:
    """Poles at 60 degrees from the negative axis, those beyond the second at -1."""
    return [SIXTY, SIXTY.conjugate(), *[-1.0 + 0j] * (n - 2)]


def with_load(model: Model) -> Model:
    """The model with one more state, which x_n' lacks: x_n' = phi + load, load' = 0."""
    name = "load"
    taken = {*model.states, *model.inputs, *model.parameters}
    while name in taken:
        name += "_"
    zero = nodes.constant(0.0)
    sides: list[Node] = list(model.known)
    if model.form == "phase":
        sides = [zero] * (model.n - 1) + sides
    return Model(
        states=[*model.states, name],
        inputs=model.inputs,
        parameters=model.parameters,
        f=[*sides, zero],
    )


def as_model(model: System | None) -> Model | None:
    """A model whose expressions are known: an own one that is one chain, or an input's gain.

    Of one with an unknown what is left where that is 0.
    """
    if isinstance(model, InputGain):
        return Model(states=["x1", "x2"], inputs=["u"], parameters={"b0": model.b0}, phi="b0*u")
    if isinstance(model, Model) and model.compiled and model.form in ("phase", "triangular"):
        return without_unknown(model) if model.unknown else model
    return None


def without_unknown(model: Model) -> Model:
    """The model with its unknown at 0."""
    known = {name: nodes.constant(0.0) for name in model.unknown if name}
    sides = [nodes.replaced([side], known)[0] for side in model.known]
    states = [name for name in model.states if name not in known]
    arguments: dict[str, Any] = {"inputs": model.inputs, "parameters": model.parameters}
    if model.form == "phase":
        return Model(states=states, phi=sides[0], **arguments)
    return Model(states=states, f=sides, **arguments)


def derivatives(model: System | None, n: int) -> int:
    """How many of the first states are y and its derivatives, whatever is known of the system."""
    if isinstance(model, Model) and model.form == "nonlinear-chain":
        return 1
    if isinstance(model, Model) and model.compiled and model.form == "triangular":
        for i, side in enumerate(model.known):
            if not _is_zero(side):
                return min(i + 1, n)
    return n - len(model.unknown) if isinstance(model, Model) else n


def sources(models: Mapping[str, tuple[System | None, int]]) -> list[Source]:
    """What the smoothed state may rest on, for structures by name: their models and orders.

    States that are not derivatives of y are compared among structures of one model only.
    """
    common = min(derivatives(model, n) for model, n in models.values())
    several = len({repr(model) for model, _ in models.values()}) > 1
    out: dict[tuple[str, int], Source] = {}

    def add(name: str, known: System | None, n: int, valid: int) -> None:
        if n <= LARGEST:
            out.setdefault((repr(known), n), (name, known, n, min(valid, n)))

    for model, n in models.values():
        own = as_model(model)
        if own is not None and isinstance(model, Model) and model.unknown and model.n == n:
            add("the model", model, n, common if several else n)
        if own is not None and own.n in (n, n - 1):
            valid = common if several or own.n != n else n
            add("the model", own, own.n, valid)
            if not _is_zero(own.known[-1]):  # else it has a load
                add("the model and a load", with_load(own), own.n + 1, valid)
        elif model is not None and not isinstance(model, Unknown):
            add("the model", model, n, common if several else n)
    least = max(min(n for _, n in models.values()), 2)
    for order in (least, least + 1):
        add(f"order {order}, no model", None, order, common)
    return list(out.values())


def _is_zero(side: Node) -> bool:
    return side.op == "constant" and side.number == 0.0


def offered(model: System | None, state: int = 1) -> dict[str, Build]:
    """Structures for a model by name, each ell -> observer; without one all have the estimate
    `state`.
    """
    out: dict[str, Build] = {}

    def add(
        name: str, kind: type[Any], n: int, poles: Any, known: System | None, **manner: Any
    ) -> None:
        def build(ell: float) -> Observer:
            made: Observer = kind(n, ell, poles=poles, model=known, **manner)
            return made

        out[name] = build

    own = as_model(model)
    n = model.order if model is not None and model.order else max(2, state)
    n = own.n if own is not None else n
    known = own if own is not None else None if isinstance(model, Unknown) else model
    if known is not None:
        loaded = with_load(own) if own is not None and n < LARGEST else None
        add("model, Butterworth", StandardObserver, n, butterworth(n), known)
        if n >= 2:
            add("model, damping 1/2", StandardObserver, n, damped_half(n), known)
        add("model, real poles", StandardObserver, n, None, known)
        if loaded is not None:
            poles = butterworth(n + 1)
            add("model and load, Butterworth", StandardObserver, n + 1, poles, loaded)
            slow = [*damped_half(n), SLOW] if n >= 2 else [-1.0, SLOW]
            add("model and load, slow", StandardObserver, n + 1, slow, loaded)
    if derivatives(known, n) < n:  # an order without a model has other states
        return out
    for order in (max(n, 2), max(n, 2) + 1):
        if order <= LARGEST:
            add(
                f"order {order}, no model, Butterworth",
                StandardObserver,
                order,
                butterworth(order),
                None,
            )
            add(f"order {order}, no model, real poles", StandardObserver, order, None, None)
    add(f"low-power, order {max(n, 2) + 1}, no model", LowPowerObserver, max(n, 2) + 1, None, None)
    return out
