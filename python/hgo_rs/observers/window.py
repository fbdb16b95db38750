"""Gains on a window of innovations: causal Savitzky-Golay, dirty derivative, any fixed gains."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from hgo_rs.design.discrete import discrete
from hgo_rs.design.discretisation import check_step
from hgo_rs.errors import (
    DesignError,
    check,
    check_array,
    check_choice,
    check_integer,
    check_number,
)
from hgo_rs.observers.base import Observer
from hgo_rs.observers.records import Array
from hgo_rs.observers.turns import turn

if TYPE_CHECKING:
    from typing_extensions import Self

LENGTHS = (*range(1, 13), 15, 17, 21, 25, 31)
"""Windows that are built."""

ORDERS = 2, 5
RULES = ("tustin", "backward", "exact", "forward")
MOST = 130
"""Entries of W, n m."""


class WindowObserver(Observer):
    """Gains W on the innovations of the last m samples, with a fixed period.

    x_hat+ = x_hat- + W d,   x_hat- = exp(A dt) x_hat

    d_0 = y - x_hat-_1, and d_j the deviation of the sample j periods ago from the polynomial of
    x_hat-. With least-squares weights it is the causal filter of Savitzky and Golay
    (`savitzky_golay`), with one column a constant gain (`dirty_derivative`, `alpha_beta_gamma`).
    Current timing, no model.

    A missing sample is replaced by the value of the polynomial. Steps more than 5 % off `dt` are
    refused: the window counts samples, not time.

    Parameters
    ----------
    W : (n, m) array
        Row i for x_i, column j for the sample j periods old, in units of x_i/y; n from 2 to 5, m
        from 1 to 12, or 15, 17, 21, 25, 31, n*m at most 130. In a file n*m numbers, row by row.
    dt : float
        Period [s].
    n, window : int, optional
        n and m, where W is a list.
    wrap : float, optional
        As in `StandardObserver`.

    Raises
    ------
    HgoError
        Sizes out of range; gains whose error does not decay.
    """

    def __init__(
        self,
        W: npt.ArrayLike,
        dt: float,
        *,
        n: int | None = None,
        window: int | None = None,
        wrap: float | None = None,
        allow_unstable: bool = False,
    ) -> None:
        gains = check_array(W, "W")
        if gains.ndim == 1 and n is not None and window is not None:
            fits, told = gains.size == n * window, f"of {n} * {window} numbers"
            check(fits, "W", gains.size, told, "give them row by row")
            gains = gains.reshape(n, window)
        for name, value, size in (("n", n, 0), ("window", window, 1)):
            fits = gains.ndim == 2 and value in (None, gains.shape[size])
            check(fits, f"shape of W with {name}", gains.shape, "(n, window)", "give a matrix")
        order = check_integer(gains.shape[0], "n", least=ORDERS[0], most=ORDERS[1])
        length = gains.shape[1]
        known = length in LENGTHS
        check(known, "window", length, "1 to 12, 15, 17, 21, 25 or 31", "choose one of these")
        few, remedy = gains.size <= MOST, "choose a shorter window, or a lower order"
        check(few, "entries of W", gains.size, f"<= {MOST}", remedy)
        finite = bool(np.all(np.isfinite(gains)))
        check(finite, "W", W, "finite", "give numbers")
        spec = {
            "kind": "window",
            "n": order,
            "window": length,
            "W": gains.ravel().tolist(),
            "dt": check_number(dt, "dt", above=0.0),
            "model": {"kind": "none"},
            **turn(wrap),
        }
        radius = discrete(spec, spec["dt"]).radius
        remedy = "give smaller gains, or allow_unstable=True to study them"
        allowed = "such that the error decays, below 1"
        sound = allow_unstable or radius < 1.0
        check(sound, "spectral radius of the error of W", radius, allowed, remedy, DesignError)
        super().__init__(spec, allow_unstable=allow_unstable)

    @classmethod
    def savitzky_golay(
        cls, window: int, degree: int, dt: float, *, wrap: float | None = None
    ) -> Self:
        """Derivatives, at the newest sample, of the polynomial of this degree through the last
        `window` samples by least squares. Savitzky and Golay, Analytical Chemistry 36 (1964) 1627.

        Order n = degree + 1, degree 1 to 4, window > degree; `window` = degree + 1 is the finite
        difference. From a start it needs `window` samples; before them it goes on from there.
        """
        degree = check_integer(degree, "degree", least=ORDERS[0] - 1, most=ORDERS[1] - 1)
        remedy = "a polynomial needs a sample more than its degree"
        length = check_integer(window, "window", least=degree + 1, most=LENGTHS[-1], remedy=remedy)
        period = check_number(dt, "dt", above=0.0)
        orders = np.array([math.factorial(i) / period**i for i in range(degree + 1)])
        return cls(orders[:, None] * polynomial(length, degree), period, wrap=wrap)

    @classmethod
    def dirty_derivative(
        cls, tau: float, dt: float, rule: str = "tustin", *, wrap: float | None = None
    ) -> Self:
        """s/(tau s + 1) as a recursion v+ = a v + b (y+ - y), and y itself: order 2.

        `tau` > 0 [s]. `rule`: "tustin", a = (2 tau - dt)/(2 tau + dt); "backward",
        a = tau/(tau + dt); "exact" of a y that moves straight between samples, a = exp(-dt/tau);
        "forward", a = 1 - dt/tau, for dt < 2 tau: Euler's form of the reduced-order observer.
        b = (1 - a)/dt in each, so that a ramp has no error.
        """
        tau, period = check_number(tau, "tau", above=0.0), check_number(dt, "dt", above=0.0)
        pole = {
            "tustin": (2.0 * tau - period) / (2.0 * tau + period),
            "backward": tau / (tau + period),
            "exact": math.exp(-period / tau),
            "forward": 1.0 - period / tau,
        }[check_choice("rule", rule, RULES)]
        return cls([[1.0], [(1.0 - pole) / period]], period, wrap=wrap)

    @classmethod
    def alpha_beta_gamma(
        cls,
        alpha: float,
        beta: float,
        dt: float,
        gamma: float | None = None,
        *,
        wrap: float | None = None,
    ) -> Self:
        """As `StandardObserver.alpha_beta_gamma`, for any gains whose error decays."""
        given = {"alpha": alpha, "beta": beta} | ({} if gamma is None else {"gamma": gamma})
        period = check_number(dt, "dt", above=0.0)
        gains = [check_number(one, name) / period**i for i, (name, one) in enumerate(given.items())]
        return cls(np.array(gains)[:, None], period, wrap=wrap)

    def _check_clock(self, clock: float | Array) -> None:
        steps = np.diff(clock) if np.ndim(clock) else np.atleast_1d(clock)
        k = int(np.argmax(np.abs(steps - self.spec["dt"]))) if len(steps) else 0
        where = f"after sample {k} (t = {np.atleast_1d(clock)[k]:g} s), " if np.ndim(clock) else ""
        try:
            for step in steps[k : k + 1].tolist():
                check_step(self.spec, step, allow_unstable=True)
        except DesignError as error:
            raise DesignError(f"{where}{error}") from None


def polynomial(window: int, degree: int) -> Array:
    """Weights (degree + 1, window) of the last samples, newest first, for the coefficients of
    1, s, s^2, ... of the least-squares polynomial, s in steps from the newest sample.
    """
    s = -np.arange(window, dtype=np.float64)
    # of an orthogonal basis of these samples, so that the normal equations are well conditioned
    q, r = np.linalg.qr(np.vander(s / max(window, 1), degree + 1, increasing=True))
    scale = float(max(window, 1)) ** -np.arange(degree + 1)
    return np.asarray(scale[:, None] * np.linalg.solve(r, q.T))
