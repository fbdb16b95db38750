"""The observer of a model in discrete time."""

from __future__ import annotations

from hgo_rs.errors import check, check_choice
from hgo_rs.models import Model, VanDerPol
from hgo_rs.observers.base import Observer
from hgo_rs.observers.turns import turn

GAINS = ("derived", "printed")
"""Gains of the paper's oscillator."""


class SampledDataObserver(Observer):
    """Sampled-data observer on an Euler-Maruyama model. Fu, Kang and Li (5).

    x_hat(k+1) = x_hat(k) + T f(x_hat(k)) + K_T(x_hat(k), y(k))

    Parameters
    ----------
    model : VanDerPol, or a Model of sampled-data form
    gain : "derived" or "printed"
        Of VanDerPol: l1 = (5 + mu) T, which gives the error matrix the constant spectrum {-2, -3};
        or the paper's (5 - mu) T. mu = epsilon (1 - y^2).
    wrap
        As in `StandardObserver`; of a model whose output h is its first state.
    """

    def __init__(
        self,
        model: VanDerPol | Model | None = None,
        *,
        gain: str = "derived",
        wrap: float | None = None,
        allow_unstable: bool = False,
    ) -> None:
        known = VanDerPol() if model is None else model
        fits = isinstance(known, VanDerPol) or getattr(known, "form", None) == "sampled"
        remedy = "leave it out, or write Model(states=..., f=[...], K_T=[...])"
        check(fits, "model", model, "a VanDerPol, or a Model of sampled-data form", remedy)
        choice = check_choice("gain", gain, GAINS)
        spec = {"kind": "sampled-data", "model": known.spec, "gain": choice, **turn(wrap)}
        super().__init__(spec, model=model, allow_unstable=allow_unstable)
