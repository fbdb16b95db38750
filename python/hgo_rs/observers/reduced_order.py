"""The reduced-order observer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import check, check_number
from hgo_rs.models import Model, Ship
from hgo_rs.observers.base import Observer
from hgo_rs.observers.records import vector
from hgo_rs.observers.turns import turns


class ReducedOrderObserver(Observer):
    """High-gain reduced-order observer for sampled data. Katayama (8), (22).

    Estimates z (n_z,) of a system in strict-feedback form from samples of its measured states y
    (N, n_x) and its inputs u (N, n_u): of a ship the velocity (3,) from position and heading. It
    filters: the estimate at k uses y(k).

    Parameters
    ----------
    epsilon : float
        Small parameter > 0 [s]; stable for dt < 2 epsilon/max h_bar (A5).
    h_bar : n_z numbers in (0, 1)
        Default: the paper's (0.1, 0.2, 0.2) for the ship, 0.2 each for another model.
    model : Ship, or a Model of strict-feedback form, optional
    wrap : n_y numbers or None, optional
        For each measured state the length of its turn as in `StandardObserver`, None where it does
        not wrap: (None, None, 2*pi) for a ship's heading.
    """

    def __init__(
        self,
        epsilon: float,
        *,
        h_bar: npt.ArrayLike | None = None,
        model: Ship | Model | None = None,
        wrap: Sequence[float | None] | None = None,
        allow_unstable: bool = False,
    ) -> None:
        known = Ship() if model is None else model
        ship = isinstance(known, Ship)
        fits = ship or getattr(known, "form", None) == "strict-feedback"
        remedy = "leave it out, or write Model(states=..., f1=[...], g=[...], f2=[...])"
        check(fits, "model", model, "a Ship, or a Model of strict-feedback form", remedy)
        n_x = known.n_x if isinstance(known, Model) else 3
        n_z = 3 if ship else known.order or 0
        if h_bar is None:
            h_bar = (0.1, 0.2, 0.2) if ship else np.full(n_z, 0.2)
        spec = {
            "kind": "reduced-order",
            "model": known.spec,
            "h_bar": vector(h_bar, "h_bar", n_z).tolist(),
            "epsilon": check_number(epsilon, "epsilon", above=0.0),
            **turns(wrap, n_x),
        }
        super().__init__(spec, model=model, allow_unstable=allow_unstable)
