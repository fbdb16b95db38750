"""How late a sample may come."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from hgo_rs.errors import DesignError, check
from hgo_rs.laws import LAWS

from ._checks import Array
from .discrete import acts_at_once, linear, unit


def delay_limit(observer: Mapping[str, Any], *, gain: float | None = None) -> float:
    """The longest delay D [s] of the samples up to which an observer is stable that compares each
    with its own estimate of D ago,

        x_hat'(t) = f(x_hat(t)) + gains (y(t) - x_hat_1(t - D)),   y(t) = x_1(t - D) + noise.

    At it stands the first root of P(s) + Q(s) exp(-s D) on the imaginary axis, with P of the law
    without samples and P + Q of the law without delay; for the standard law s^n and
    k_1 ell s^(n-1) + ... + k_n ell^n (Van Assche et al., IFAC World Congress 2011).

    ``gain``: where to freeze a gain that moves [1/s].  The model is left out.  `inf` where no delay
    is too long.

    Raises DesignError for a law that is not one chain, a recursion, or a law that a sample moves at
    once ("reduced-chain").

    Examples
    --------
    >>> from hgo_rs import StandardObserver
    >>> round(delay_limit(StandardObserver(2, 10.0, k=[2.0, 1.0]).spec), 7)
    0.0647409
    """
    kind = observer.get("kind")
    remedy = "let it run on late samples, and move a copy on by the delay"
    allowed = "a law in continuous time that a sample moves at a finite rate"
    known = LAWS.get(kind) if isinstance(kind, str) else None
    check(known is None or known.continuous, "kind", kind, allowed, remedy, DesignError)
    law = linear(observer, gain=gain)
    check(not acts_at_once(unit(observer)), "kind", kind, allowed, remedy, DesignError)
    p = np.asarray(np.poly(law.f), dtype=np.float64)
    q = np.asarray(np.poly(law.closed), dtype=np.float64) - p
    crossings = np.roots(_square(p) - _square(q))
    real = np.abs(crossings.imag) < 1e-7 * np.abs(crossings)
    omega = crossings.real[real & (crossings.real > 1e-9)]
    if not omega.size:
        return math.inf
    turn = -np.polyval(q, 1j * omega) / np.polyval(p, 1j * omega)  # exp(j omega D)
    delays = np.mod(np.angle(turn), 2.0 * math.pi) / omega
    return float(np.min(delays) / law.ell)


def _square(polynomial: Array) -> Array:
    """|c(j omega)|^2 as a polynomial in omega."""
    along = polynomial * 1j ** np.arange(len(polynomial) - 1, -1, -1)
    return np.asarray(np.convolve(along, along.conj()).real)
