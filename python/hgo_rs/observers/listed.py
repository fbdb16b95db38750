"""An observer of any law of the list that is one chain with any gain."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import check, check_array, check_choice
from hgo_rs.laws import LAWS
from hgo_rs.models import System
from hgo_rs.observers import arguments
from hgo_rs.observers.arguments import Gain, Poles
from hgo_rs.observers.base import Observer
from hgo_rs.observers.records import vector
from hgo_rs.observers.shapes import Shape
from hgo_rs.observers.turns import turn

CLIPS = ("hard", "smooth")
"""How estimates are kept below their levels."""


class HighGainObserver(Observer):
    """An observer of order n, with the law given by name.

    It covers all laws of one chain that take any gain. Frequently used laws also have a class of
    their own, such as `StandardObserver`.

    Parameters
    ----------
    kind : str
        Name of a law in `hgo_rs.laws.LAWS`, such as "standard".
    n : int
        Order, in the range of the law.
    gain, epsilon, shape, model, method, motion, substeps, timing, wrap, allow_unstable
        As in `StandardObserver`. Default of `method`: "zoh" where the law supports it.
    poles : numbers, optional
        Poles before scaling by ell, as many as the law needs. Default: see the page of the law.
    saturation, clip
        As in `PeakingFreeObserver`, for laws with a saturation; optional for "limited-gain" and
        "cascade".
    **entries
        Coefficients of the law by their names, all of them and in place of `poles`; its second
        size.

    Raises
    ------
    HgoError
        An unknown law or a law of several chains; an unknown entry; sizes, poles, coefficients, a
        gain or a model out of range.
    """

    def __init__(
        self,
        kind: str,
        n: int,
        gain: Gain | None = None,
        *,
        epsilon: float | None = None,
        poles: Poles | None = None,
        shape: Shape | None = None,
        model: System | None = None,
        method: str | None = None,
        motion: str | None = None,
        substeps: int | None = None,
        timing: str | None = None,
        saturation: npt.ArrayLike | None = None,
        clip: str | None = None,
        wrap: float | None = None,
        allow_unstable: bool = False,
        **entries: Any,
    ) -> None:
        single = tuple(law.kind for law in LAWS.values() if law.single)
        law = LAWS[check_choice("kind", kind, single)]
        n = arguments.order(
            n, least=arguments.LEAST.get(kind, min(law.orders)), most=max(law.orders)
        )
        gain_law = arguments.gain(gain, epsilon, law, n)
        coefficients = arguments.of_law(law, n, poles, entries)
        if method is None:
            method = arguments.usual_method(law, gain_law, shape)
        shaped = arguments.shape_spec(shape, law, n, method)
        manner = arguments.manner(law, method, timing)
        spec = {
            "kind": kind,
            "n": n,
            **coefficients,
            "gain": gain_law,
            **shaped,
            "model": arguments.model(model, n, law),
            **manner,
            **arguments.motion(method, motion, substeps, model, gain_law),
            **turn(wrap),
        }
        for name, value in (("saturation", saturation), ("clip", clip)):
            remedy = f"the {law.title} has no saturation"
            check(law.saturated or value is None, name, value, "left out", remedy)
        if law.saturated and not (law.open and saturation is None and clip is None):
            allowed, remedy = "given", "give the levels r_2 ... r_n >= max |x_i|"
            check(saturation is not None, "saturation", saturation, allowed, remedy)
            spec |= {
                "saturation": _saturation(saturation, n, model),
                "clip": check_choice("clip", "hard" if clip is None else clip, CLIPS),
            }
        self._motion_open = motion is None
        super().__init__(spec, model=model, allow_unstable=allow_unstable)

    def __repr__(self) -> str:
        """As of every observer; behind the law's word, where the class has no name of its own."""
        text = super().__repr__()
        if type(self) is not HighGainObserver:
            return text
        return text.replace("(", f"({self.spec['kind']!r}, ", 1)


def _saturation(levels: Any, n: int, model: System | None) -> list[float]:
    values = check_array(levels, "saturation")
    if values.ndim == 0:
        values = np.full(n - 1, float(values))
    values = vector(values, "saturation", n - 1)
    bounds = (None if model is None else model.bounds) or (0.0,) * n
    for i, (value, bound) in enumerate(zip(values, bounds[1:], strict=False), start=2):
        least = f">= {bound:g}, the model's own bound of |x_{i}|" if bound else "> 0"
        remedy = "choose a larger level"
        check(value > 0.0 and value >= bound, f"saturation r_{i}", float(value), least, remedy)
    return [float(v) for v in values]
