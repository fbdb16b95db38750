"""A record run backwards in time: an estimate that knows of the future only.

With tau = T - t and z_i = (-1)^(i-1) x_i a chain x_i' = x_{i+1} + f_i(t, x, u) is again one,

    dz_i/dtau = z_{i+1} + (-1)^i f_i(T - tau, x(z), u),     y = z_1,

and so the same law estimates it.  Its estimate before the sample k is used rests on the samples
k + 1, k + 2, ..., that of the law run forwards on those up to k: with white noise and white model
error their errors have nothing in common.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hgo_rs.errors import HgoError
from hgo_rs.expressions import nodes
from hgo_rs.expressions.derivative import neg, sub, substitute
from hgo_rs.expressions.nodes import Node
from hgo_rs.models import InputGain, Model, System, Unknown
from hgo_rs.tuning.record import Record
from hgo_rs.tuning.result import Array


def signs(orders: tuple[int, ...]) -> Array:
    """(-1)^(i-1) for the states of chains of these orders."""
    return np.concatenate([(-1.0) ** np.arange(n) for n in orders])


def reversed_model(model: System | None, n: int, end: float) -> System | None:
    """The model in tau = end - t; n is the order of its observer.

    Raises
    ------
    HgoError
        A model that is not one of chains made of expressions.
    """
    if model is None or isinstance(model, Unknown):
        return None
    if isinstance(model, InputGain):
        return InputGain(model.b0 * (-1.0) ** n)
    forms = ("phase", "chains", "triangular")
    if not (isinstance(model, Model) and model.compiled and model.form in forms):
        form = f" of form {model.form!r}" if isinstance(model, Model) and model.compiled else ""
        told = f"{type(model).__name__}{form} cannot be run backwards in time: must be a Model of "
        raise HgoError(f"{told}chains made of expressions; the record is judged without it")
    orders = model.orders or (model.n,)
    flipped = signs(orders) < 0.0
    first = np.cumsum(orders) - 1  # where the equations stand that phi enters
    if model.unknown:
        own = np.isin(model.states, model.unknown)
        flipped &= ~own  # an unknown stays what it is; its equation is that of the state before
        first = first - own[first]
    new = {
        state: neg(nodes.symbol(state))
        for state, odd in zip(model.states, flipped, strict=True)
        if odd
    }
    later = sub(nodes.constant(end), nodes.symbol("t"))

    def turned(node: Node, flip: bool) -> Node:
        node = substitute(nodes.replaced([node], new)[0], "t", later)
        return node if flip else neg(node)

    arguments = model.named_arguments()
    if model.unknown and "box" in arguments:
        turned_box = {name: (low, high) for name, (low, high) in arguments["box"].items()}
        for name in new:
            if name in turned_box:
                turned_box[name] = (-turned_box[name][1], -turned_box[name][0])
        arguments["box"] = turned_box
    if model.form == "triangular":
        sides = zip(model.known, flipped, strict=False)  # an unknown has no side
        return Model(**arguments, f=[turned(node, bool(odd)) for node, odd in sides])
    last = flipped[first]
    phi = [turned(node, bool(odd)) for node, odd in zip(model.known, last, strict=True)]
    if model.form == "chains":
        return Model(**arguments, phi=phi)
    return Model(**arguments, phi=phi[0])


def reversed_record(record: Record) -> Record:
    """The record from its end to its start; inputs are held over the same periods."""
    u = record.u
    if u is not None:
        u = np.vstack([u[-2::-1], u[:1]])
    return replace(
        record,
        t=np.ascontiguousarray(record.t[-1] - record.t[::-1]),
        y=np.ascontiguousarray(record.y[::-1]),
        u=u,
        judged=record.judged[::-1],
        two_sided=record.two_sided[::-1],
    )
