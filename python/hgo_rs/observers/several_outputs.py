"""Observers of several outputs, one for each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy.typing as npt

from hgo_rs.errors import check
from hgo_rs.models import Model
from hgo_rs.observers import arguments
from hgo_rs.observers.base import Observer
from hgo_rs.observers.high_gain_ekf import HighGainEKF, covariance
from hgo_rs.observers.listed import HighGainObserver
from hgo_rs.observers.online import is_one_filter
from hgo_rs.observers.records import Array


class MultiOutputObserver(Observer):
    """An observer for each output of a model of several chains, which share their states.

    Each observer estimates the chain of its output, x_c1' = x_c2, ..., x_cn' = phi_c(t, x, u), with
    phi_c over the states of all chains. All chains are integrated together over a period; a method
    or a motion that holds the model takes the other chains' estimates at its beginning. A missing
    sample of one output is predicted for that output.

    High-gain EKFs by method "sampled", one for each output, form one filter with one covariance of
    all states: a sample of one output corrects all chains. Up to 4 outputs and 8 states;
    `covariance` gives P.

    The memory holds the estimates of all chains, one chain after the other, then the rest of each
    observer's memory. `run` takes y of shape (N, number of chains).

    Parameters
    ----------
    observers : sequence of StandardObserver, LowPowerObserver, PeakingFreeObserver or HighGainEKF
        One for each output, without a model: structure, gain, discretisation, timing. All have the
        same timing and motion; the default motion is chosen by the model.
    model : Model
        Of the form of chains: `Model(states=..., orders=[n_1, n_2, ...], phi=[phi_1, phi_2, ...])`.
    allow_unstable : bool
        As in `StandardObserver`.
    wrap : None
        Not used; give it to the observer of the output: `StandardObserver(2, 40, wrap=2*pi)`.

    Raises
    ------
    HgoError
        Observers that do not fit the chains; another form of model.
    """

    def __init__(
        self,
        observers: Sequence[Observer],
        *,
        model: Model,
        allow_unstable: bool = False,
        wrap: None = None,
    ) -> None:
        remedy = "give it where the observer of that output is made"
        check(wrap is None, "wrap", wrap, "left out", remedy)
        chains = getattr(model, "orders", ())
        remedy = "write Model(states=..., orders=[...], phi=[...])"
        check(bool(chains), "model", model, "a Model of chains", remedy)
        given = tuple(observer.n for observer in observers)
        remedy = "give one observer for each chain, in order"
        check(given == chains, "orders of the observers", given, f"{chains}", remedy)
        specs = []
        for observer in observers:
            fits = isinstance(observer, (HighGainObserver, HighGainEKF))
            free = observer.model is None and fits
            remedy = "a StandardObserver, LowPowerObserver, ... without a model"
            check(free, "observers", observer, remedy, "the model of all chains is given once")
            specs.append({k: v for k, v in observer.spec.items() if k != "model"})
        specs = _moving(observers, specs, model)
        same = len({observer.timing for observer in observers}) == 1
        timings = [observer.timing for observer in observers]
        check(same, "timing of the observers", timings, "the same", "give all the same timing=")
        spec = {"kind": "chains", "observers": specs, "model": model.spec}
        super().__init__(spec, model=model, allow_unstable=allow_unstable)

    def covariance(self, memory: npt.ArrayLike | None = None) -> Array:
        """P of memories (..., m) of high-gain EKFs, shape (..., n, n); default: where it stands.

        Raises
        ------
        HgoError
            Observers without a covariance.
        """
        remedy = "HighGainEKF(..., method='sampled') for every output has one"
        check(is_one_filter(self.spec), "covariance", None, "of high-gain EKFs", remedy)
        return covariance(self.memory if memory is None else memory, self.n)


def _moving(
    observers: Sequence[Observer], specs: list[dict[str, Any]], model: Model
) -> list[dict[str, Any]]:
    """The specs; where the motion is left open, with that of another chain, or the model's own."""
    open_ = [getattr(observer, "_motion_open", False) for observer in observers]
    placed = all("motion" in spec for spec in specs)
    for motion in {spec["motion"] for spec in specs} if placed and not all(open_) else ():
        arguments.warn_of_jumps(motion, model, stacklevel=4)
    if not any(open_) or not placed:
        return specs
    told = [spec for spec, left in zip(specs, open_, strict=True) if not left]
    if told:
        chosen: dict[str, Any] = {k: v for k, v in told[0].items() if k in ("motion", "substeps")}
    else:
        gains = [spec["gain"] for spec in specs]
        least = min(gains, key=lambda gain: gain.get("ell", 1.0))
        chosen = arguments.motion(specs[0]["method"], None, None, model, least)
    return [spec | chosen if left else spec for spec, left in zip(specs, open_, strict=True)]
