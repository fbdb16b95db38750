"""The low-power and the peaking-free observer."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs import _core
from hgo_rs.design.discrete import DEFAULT_METHOD, DEFAULT_TIMING
from hgo_rs.errors import HgoError, check, check_array, check_choice
from hgo_rs.models import System
from hgo_rs.observers import arguments
from hgo_rs.observers.arguments import Gain, Poles
from hgo_rs.observers.base import Observer
from hgo_rs.observers.records import vector


class LowPowerObserver(Observer):
    """Low-power observer of order n: no coefficient above ell^2. Astolfi et al. (5).

    Parameters
    ----------
    n : int
        Order, 2 to 12.
    gain, epsilon, model, method, timing, allow_unstable
        As in `StandardObserver`. The model must be of phase-variable form.
    poles : 2 n - 1 numbers, optional
        Eigenvalues of M_n. Default: 2 n - 2 equidistant ones in [-2, -1], and -2; for n = 5 the
        paper's coefficients.
    alpha, beta : n and n - 1 numbers, optional
        The coefficients themselves, in place of `poles`.
    """

    def __init__(
        self,
        n: int,
        gain: Gain | None = None,
        *,
        epsilon: float | None = None,
        poles: Poles | None = None,
        alpha: npt.ArrayLike | None = None,
        beta: npt.ArrayLike | None = None,
        model: System | None = None,
        method: str | None = None,
        timing: str = DEFAULT_TIMING,
        allow_unstable: bool = False,
    ) -> None:
        spec = _low_power("low-power", n, gain, epsilon, poles, alpha, beta, model, method, timing)
        super().__init__(spec, model=model, allow_unstable=allow_unstable)


class PeakingFreeObserver(Observer):
    """Low-power peaking-free observer of order n. Astolfi et al. (11).

    Parameters
    ----------
    n, gain, epsilon, poles, alpha, beta, model, method, timing, allow_unstable
        As in `LowPowerObserver`.
    saturation : float or n - 1 numbers
        Levels r_2 ... r_n >= max |x_i| (10).
    clip : "hard" or "smooth"
        Hard clip at +-r (what the paper's tables use), or the C1 saturation of its text, bounded
        by r + 1.

    Raises
    ------
    HgoError
        A saturation level below the model's own bound of |x_i|.
    """

    def __init__(
        self,
        n: int,
        gain: Gain | None = None,
        *,
        saturation: npt.ArrayLike,
        clip: str = "hard",
        epsilon: float | None = None,
        poles: Poles | None = None,
        alpha: npt.ArrayLike | None = None,
        beta: npt.ArrayLike | None = None,
        model: System | None = None,
        method: str | None = None,
        timing: str = DEFAULT_TIMING,
        allow_unstable: bool = False,
    ) -> None:
        spec = _low_power(
            "peaking-free", n, gain, epsilon, poles, alpha, beta, model, method, timing
        )
        spec |= {
            "saturation": _saturation(saturation, spec["n"], model),
            "clip": check_choice("clip", clip, ("hard", "smooth")),
        }
        super().__init__(spec, model=model, allow_unstable=allow_unstable)


def _low_power(
    kind: str,
    n: int,
    gain: Gain | None,
    epsilon: float | None,
    poles: Poles | None,
    alpha: npt.ArrayLike | None,
    beta: npt.ArrayLike | None,
    model: System | None,
    method: str | None,
    timing: str,
) -> dict[str, Any]:
    """What (5) and (11) share, as a spec."""
    n = arguments.order(n, least=2)
    a, b = _low_power_coefficients(n, poles, alpha, beta)
    law = arguments.gain(gain, epsilon)
    usual = DEFAULT_METHOD if law["law"] == "constant" else "rk4"
    return {
        "kind": kind,
        "n": n,
        "alpha": a,
        "beta": b,
        "gain": law,
        "model": arguments.model(model, n),
        **arguments.manner(usual if method is None else method, timing),
    }


def _low_power_coefficients(
    n: int, poles: Poles | None, alpha: npt.ArrayLike | None, beta: npt.ArrayLike | None
) -> tuple[list[float], list[float]]:
    if (alpha is None) != (beta is None) or (alpha is not None and poles is not None):
        raise HgoError("alpha and beta: must be given together and without poles")
    if alpha is not None and beta is not None:
        return vector(alpha, "alpha", n).tolist(), vector(beta, "beta", n - 1).tolist()
    given = np.append(np.linspace(-1.0, -2.0, 2 * n - 2), -2.0) if poles is None else poles
    pairs = arguments.pairs(given, 2 * n - 1, f"a low-power observer of order {n}")
    return _core.low_power_coefficients_from_poles(pairs)


def _saturation(levels: npt.ArrayLike, n: int, model: System | None) -> list[float]:
    values = check_array(levels, "saturation")
    if values.ndim == 0:
        values = np.full(n - 1, float(values))
    values = vector(values, "saturation", n - 1)
    bounds = (None if model is None else model.bounds) or (0.0,) * n
    for i, (value, bound) in enumerate(zip(values, bounds[1:], strict=False), start=2):
        least = f">= {bound:g}, the model's own bound of |x_{i}|" if bound else "> 0"
        remedy = "Astolfi et al. (10); choose a larger level"
        check(value > 0.0 and value >= bound, f"saturation r_{i}", float(value), least, remedy)
    return [float(v) for v in values]
