"""The high-gain extended Kalman filter, and the covariance that it remembers."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs import _core
from hgo_rs.design.discrete import DEFAULT_TIMING, RATED, TIMINGS
from hgo_rs.errors import HgoError, check, check_array, check_choice, check_number
from hgo_rs.laws import LAWS
from hgo_rs.models import System
from hgo_rs.observers import arguments
from hgo_rs.observers.arguments import Gain
from hgo_rs.observers.base import Observer
from hgo_rs.observers.gains import WITH_R
from hgo_rs.observers.online import EKF as KIND
from hgo_rs.observers.online import SAMPLED
from hgo_rs.observers.records import Array
from hgo_rs.observers.turns import turn

WINDOW = "innovation"
"""The gain that moves by the innovation of a window."""


class HighGainEKF(Observer):
    """High-gain extended Kalman filter of order n: the gains come from a covariance P.

    x_hat' = A x_hat + f_hat(x_hat, u, t) + P C' (theta/R) (y - x_hat_1)
    P' = J P + P J' + Q_theta - P C' (theta/R) C P,   J = A + df_hat/dx(x_hat, u, t)

    with Q_theta = theta D Q D, D = diag(1, theta, ..., theta^(n-1)); theta = 1 is the extended
    Kalman filter. Deza, Busvelle, Gauthier and Rakotopara (1992). Method "sampled" moves both by
    the model without a sample, and corrects by K = P C'/(C P C' + R/theta).

    The memory holds x_hat, then P as L and D of P = L D L', L unit lower triangular, row by row
    with D on the diagonal, so that P stays positive; `covariance` gives P. Under an
    `InnovationGain` then theta, the runs of the model over the window, and the innovation of each.

    Parameters
    ----------
    n : int
        Order, 1 to 6.
    gain : float or a gain law, optional
        theta >= 1, which takes the place of the gain ell. Default: 1. `InnovationGain` moves it
        under method "sampled" (one output, order 1 to 4), the adaptive laws under a method in
        continuous time.
    theta : float, optional
        The same, under the name of the papers.
    R : float
        Variance of a sample [unit of y^2]; under a method in continuous time the intensity of white
        noise in y, variance times period.
    Q : float, (n,) or (n, n) array
        Intensity of white noise in x': in the last state, in each (a diagonal), or a matrix; entry
        (i, j) in units of x_i x_j/s. n (n + 1)/2 numbers are its lower triangle, row by row.
    P0 : (n,) or (n, n) array, optional
        Covariance of the first estimate. Default: 100 R in x_1, scaled for the other states by the
        bandwidth that Q and R imply, see the page of this law.
    model : System, optional
        The model, whose Jacobian is derived symbolically. Default: none.
    method : str
        "sampled" (default), or a method in continuous time: "euler", "rk4", ...
    timing : "predictor" or "current"
        As in `StandardObserver`; "sampled" has current timing.
    wrap : float, optional
        As in `StandardObserver`.
    allow_unstable : bool
        Continue a run that diverges.
    shape : None
        Not supported: P assumes the whole innovation.

    Raises
    ------
    HgoError
        theta < 1; R or P0 that is not positive; Q that is not positive semidefinite; an order or a
        model out of range; a model of Python functions, which has no Jacobian.
    """

    def __init__(
        self,
        n: int,
        gain: Gain | None = None,
        *,
        R: float,
        Q: npt.ArrayLike,
        P0: npt.ArrayLike | None = None,
        theta: float | None = None,
        model: System | None = None,
        method: str = SAMPLED,
        timing: str = DEFAULT_TIMING,
        wrap: float | None = None,
        allow_unstable: bool = False,
        shape: None = None,
    ) -> None:
        law = LAWS[KIND]
        remedy = "gate= of run() leaves out outliers; or take a law with constant gains"
        check(shape is None, "shape", shape, "left out: P assumes the whole innovation", remedy)
        n = arguments.order(n, least=min(law.orders), most=max(law.orders))
        remedy = "give theta, or gain"
        check(gain is None or theta is None, "theta", theta, "given without gain", remedy)
        if theta is None and gain is None:
            theta = 1.0
        if theta is not None:
            gain = check_number(theta, "theta", least=1.0, remedy="1 is the extended Kalman filter")
        gain_law = arguments.gain(gain, None)
        check_choice("gain", gain_law["law"], ("constant", *WITH_R))
        if gain_law["law"] == "constant":
            remedy = "1 is the extended Kalman filter"
            check(gain_law["ell"] >= 1.0, "theta", gain_law["ell"], ">= 1", remedy)
        methods = (SAMPLED, *RATED)
        check_choice("method", method, methods)
        check_choice("timing", timing, TIMINGS)
        if method == SAMPLED:
            remedy = (
                "a sample is used at its own time; or choose a method in continuous time: 'rk4'"
            )
            check(timing == "current", "timing", timing, "'current'", remedy)
            fits, remedy = gain_law["law"] in ("constant", WINDOW), "choose method='rk4'"
            allowed = "constant, or an InnovationGain, under method 'sampled'"
            check(fits, "gain", gain_law["law"], allowed, remedy)
        else:
            remedy = "its window holds samples: choose method='sampled'"
            allowed = "another law under a method in continuous time"
            check(gain_law["law"] != WINDOW, "gain", gain_law["law"], allowed, remedy)
        variance = check_number(_one(R), "R", above=0.0)
        q = _triangle(Q, "Q", n)
        p0 = None if P0 is None else _triangle(P0, "P0", n)
        remedy = "give its diagonal, n numbers: the states have units of their own"
        check(
            p0 is None or n == 1 or len(p0) > 1, "P0", P0, f"of shape ({n},) or ({n}, {n})", remedy
        )
        theta = float(gain_law["ell"]) if gain_law["law"] == "constant" else 1.0
        try:
            q, p0 = _core.ekf_covariances(n, method == SAMPLED, q, variance, p0, theta)
        except ValueError as error:
            raise HgoError(str(error)) from None
        spec = {
            "kind": KIND,
            "n": n,
            "Q": q,
            "R": [variance],
            "P0": p0,
            "gain": gain_law,
            "model": arguments.model(model, n),
            "method": method,
            "timing": timing,
            **turn(wrap),
        }
        super().__init__(spec, model=model, allow_unstable=allow_unstable)

    def covariance(self, memory: npt.ArrayLike | None = None) -> Array:
        """P of memories (..., m), shape (..., n, n); default: of the present memory."""
        return covariance(self.memory if memory is None else memory, self.n)


def covariance(memory: npt.ArrayLike, n: int) -> Array:
    """P = L D L' of memories (..., m) whose first entries are x_hat (n), then L and D."""
    values = np.asarray(memory, dtype=float)
    lower = np.zeros((*values.shape[:-1], n, n))
    i, j = np.tril_indices(n)
    lower[..., i, j] = values[..., n : n + n * (n + 1) // 2]
    d = np.diagonal(lower, axis1=-2, axis2=-1).copy()
    lower[..., np.arange(n), np.arange(n)] = 1.0
    return np.asarray((lower * d[..., None, :]) @ np.swapaxes(lower, -1, -2))


def _one(value: Any) -> Any:
    """The entry of a list of one."""
    return value[0] if isinstance(value, (list, tuple)) and len(value) == 1 else value


def _triangle(given: npt.ArrayLike, name: str, n: int) -> list[float]:
    """A covariance as the core takes it: one number, a diagonal, or a lower triangle."""
    values = check_array(given, name)
    if values.ndim > 1:
        allowed, remedy = f"of shape ({n}, {n})", "give a matrix, a diagonal, or a number"
        check(values.shape == (n, n), f"shape of {name}", values.shape, allowed, remedy)
        even = bool(np.all(np.abs(values - values.T) <= 1e-12 * np.max(np.abs(values))))
        check(even, name, given, "symmetric", f"give ({name} + {name}.T)/2")
        values = values[np.tril_indices(n)]
    finite = bool(np.all(np.isfinite(values)))
    check(finite, name, given, "finite", "give numbers")
    return [float(value) for value in np.atleast_1d(values)]
