"""The reduced-order observer."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import check, check_number
from hgo_rs.models import Model, Ship
from hgo_rs.observers.base import Observer
from hgo_rs.observers.records import vector


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
    """

    def __init__(
        self,
        epsilon: float,
        *,
        h_bar: npt.ArrayLike | None = None,
        model: Ship | Model | None = None,
        allow_unstable: bool = False,
    ) -> None:
        known = Ship() if model is None else model
        ship = isinstance(known, Ship)
        fits = ship or getattr(known, "form", None) == "strict-feedback"
        remedy = "leave it out, or write Model(states=..., f1=[...], g=[...], f2=[...])"
        check(fits, "model", model, "a Ship, or a Model of strict-feedback form", remedy)
        n_z = 3 if ship else known.order or 0
        if h_bar is None:
            h_bar = (0.1, 0.2, 0.2) if ship else np.full(n_z, 0.2)
        spec = {
            "kind": "reduced-order",
            "model": known.spec,
            "h_bar": vector(h_bar, "h_bar", n_z).tolist(),
            "epsilon": check_number(epsilon, "epsilon", above=0.0),
        }
        super().__init__(spec, model=model, allow_unstable=allow_unstable)
