"""Structures and poles to choose among, from a model or from none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hgo_rs.expressions import nodes
from hgo_rs.expressions.nodes import Node
from hgo_rs.models import InputGain, Model, System, Unknown
from hgo_rs.observers import LowPowerObserver, Observer, StandardObserver
from hgo_rs.tuning.reference import MOTION, Source, butterworth

Build = Callable[[float], Observer]
"""An observer with the gain given [1/s]."""

SIXTY = complex(-0.5, 0.75**0.5)
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
    """A model whose expressions are known: an own one that is one chain, or an input's gain."""
    if isinstance(model, InputGain):
        return Model(states=["x1", "x2"], inputs=["u"], parameters={"b0": model.b0}, phi="b0*u")
    if isinstance(model, Model) and model.compiled and model.form in ("phase", "triangular"):
        return model
    return None


def sources(model: System | None, n: int) -> list[Source]:
    """What the smoothed state may rest on, for an observer of order n with this model."""
    own = as_model(model)
    out: list[Source] = []
    if own is not None and own.n == n:
        out = [("the model", own, n)]
        if n < 12:
            out.append(("the model and a load", with_load(own), n + 1))
    elif model is not None and not isinstance(model, Unknown):
        out = [("the model", model, n)]
    bare = max(n, 2)
    return [
        *out,
        (f"order {bare}, no model", None, bare),
        (f"order {bare + 1}, no model", None, bare + 1),
    ]


def offered(model: System | None) -> dict[str, Build]:
    """Structures for a model by name, each ell -> observer."""
    out: dict[str, Build] = {}

    def add(
        name: str, kind: type[Any], n: int, poles: Any, known: System | None, **manner: Any
    ) -> None:
        def build(ell: float) -> Observer:
            made: Observer = kind(n, ell, poles=poles, model=known, **manner)
            return made

        out[name] = build

    own = as_model(model)
    n = model.order if model is not None and model.order else 2
    n = own.n if own is not None else n
    known = own if own is not None else None if isinstance(model, Unknown) else model
    if known is not None:
        loaded = with_load(own) if own is not None and n < 12 else None
        for told, manner in (("", {}), (", RK4", {"method": MOTION})):
            add(f"model, Butterworth{told}", StandardObserver, n, butterworth(n), known, **manner)
            if n >= 2:
                add(
                    f"model, damping 1/2{told}",
                    StandardObserver,
                    n,
                    damped_half(n),
                    known,
                    **manner,
                )
            add(f"model, real poles{told}", StandardObserver, n, None, known, **manner)
            if loaded is not None:
                poles = butterworth(n + 1)
                add(
                    f"model and load, Butterworth{told}",
                    StandardObserver,
                    n + 1,
                    poles,
                    loaded,
                    **manner,
                )
                slow = [*damped_half(n), SLOW] if n >= 2 else [-1.0, SLOW]
                add(f"model and load, slow{told}", StandardObserver, n + 1, slow, loaded, **manner)
    for order in (max(n, 2), max(n, 2) + 1):
        if order <= 12:
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
