"""The linear part of every observer as matrices: law x discretisation x timing, in one place.

A law with a constant gain, its model left out, is a linear filter of y.  In continuous time, in
coordinates scaled by powers of the gain (state i holds x_hat_i / ell^(i-1), time runs in 1/ell),

    z' = M z + G y,        M = F - G C,        C = (1, 0, ..., 0),

where F is what the law does between samples (the chain; in the low-power laws the inner errors
too) and G y - G C z the injection of the innovation.  One step depends on c = ell dt alone:

- euler:  z+ = (1 + c M) z + c G y.
- staggered-euler:  z+ = z + (1 - c N)^-1 c (M z + G y), as d_i += c d_{i+1} from the bottom.
- rk4, bogacki-shampine:  Taylor polynomials of exp(c M), with y held over the step.
- rk4-innovation-held:  Taylor polynomials of exp(c F), with y - z_1 held.
- zoh:  correct, then move over the step exactly:  z <- z + K (y - z_1),  z+ = exp(c A) z with the
  chain A alone, and the K(c) that gives (1 - K C) exp(c A) the eigenvalues exp(c lambda(M)): those
  of the continuous error at the sampling instants.  Low-power laws correct every block by its e_i.
- bilinear:  as zoh, with the eigenvalues (1 + c lambda/2)/(1 - c lambda/2) of the trapezoidal rule.

Timing "predictor" shows z before the sample y(k) is used.  "current" corrects by it first and shows
what is then known; methods that do not correct by themselves do it by z <- z + c G (y - z_1), and
then step with the innovation 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hgo_rs.errors import DesignError, check, explain
from hgo_rs.reference.placement import low_power_gains

from . import _checks
from ._checks import Array
from .coefficients import companion, low_power_matrix

METHODS = (
    "euler",
    "staggered-euler",
    "rk4",
    "rk4-innovation-held",
    "bogacki-shampine",
    "zoh",
    "bilinear",
)
"""Discretisations of a continuous law.

`rk4` and `bogacki-shampine` hold the measurement over a step, `rk4-innovation-held` the innovation.
`zoh` and `bilinear` are stable at any step: between samples the chain is solved exactly, and the
correction gives the error the eigenvalues exp(dt lambda), or those of the bilinear rule.
"""

TIMINGS = ("predictor", "current")
"""Whether the estimate at sample k uses samples up to k - 1, or up to k."""

DEFAULT_METHOD = "zoh"
"""The method of a class where it is left open and the law can be placed."""
DEFAULT_TIMING = "current"
"""The timing of a class where it is left open."""

CORRECTING = ("zoh", "bilinear")
"""Methods that correct by the sample, then move: stable for any step."""
ORDERS = {"euler": 1, "rk4": 4, "rk4-innovation-held": 4, "bogacki-shampine": 3}


@dataclass(frozen=True, eq=False)
class Continuous:
    """z' = F z + G (y - z_1), the linear part of a law in coordinates scaled at ``ell``.

    ``f``: (m, m); ``g``: (m,); ``links``: (m, m), which state lifts which in staggered Euler;
    ``power``: (m,), state i is ell^power[i] z_i; ``n``: how many of them are estimates, the first.
    """

    f: Array
    g: Array
    links: Array
    power: Array
    n: int
    ell: float

    @property
    def closed(self) -> Array:
        """M = F - G C, the matrix of the error."""
        m = self.f.copy()
        m[:, 0] -= self.g
        return m

    @property
    def scale(self) -> Array:
        """ell^power: the states in their own units, for scaled ones."""
        return np.asarray(self.ell**self.power)


@dataclass(frozen=True, eq=False)
class Discrete:
    """z+ = a z + b y, shown x_hat = c z + d y, in the units of the estimates.

    ``a``: (m, m), ``b``: (m, n_y), ``c``: (n, m), ``d``: (n, n_y); ``dt`` [s].  The memory z is
    the law's own just before the sample y(k) is used: x_hat (n), then its auxiliary states.
    In the coordinates z_i/ell^power[i] the numbers are of one size: ``scaled``.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    dt: float
    ell: float
    power: Array

    @property
    def scale(self) -> Array:
        """ell^power: the states in their own units, for scaled ones."""
        return np.asarray(self.ell**self.power)

    @property
    def scaled(self) -> tuple[Array, Array, Array, Array]:
        """(a, b, c, d) in scaled coordinates."""
        down, shown = self.scale[:, None], self.scale[: len(self.c), None]
        a, c = self.a * self.scale, self.c * self.scale
        return a / down, self.b / down, c / shown, self.d / shown

    def __iter__(self) -> Iterator[Array]:
        """(a, b, c, d), as scipy.signal takes them."""
        return iter((self.a, self.b, self.c, self.d))

    @property
    def radius(self) -> float:
        """The spectral radius of ``a``: stable below 1."""
        return float(np.max(np.abs(np.linalg.eigvals(self.a))))


# --- from a spec to matrices ------------------------------------------------------------------


def continuous(observer: Mapping[str, Any], *, gain: float | None = None) -> Continuous:
    """The linear part of a continuous law.

    ``observer``: the spec of a standard, low-power or peaking-free law (its saturations at rest).
    ``gain``: the value [1/s] at which a gain that moves is frozen; needed there, refused elsewhere.
    """
    kind = choice(observer, "kind", (*_LINEAR, *_RECURSIONS, "collection", "modified"))
    if kind in _RECURSIONS:
        allowed = "a law in continuous time"
        raise DesignError(explain("kind", kind, allowed, "this one is a recursion: give dt"))
    if kind not in _LINEAR:
        remedy = "analyse one copy: a StandardObserver with the same k"
        raise DesignError(explain("kind", kind, "a law with one chain", remedy))
    return _LINEAR[kind](observer, _frozen(observer, gain))


def discrete(observer: Mapping[str, Any], dt: float, *, gain: float | None = None) -> Discrete:
    """The linear part of an observer as it runs with the step ``dt`` [s].

    ``observer``: a spec; "method" and "timing" as in this module's head ("euler", "predictor" where
    left out).  ``gain``: see ``continuous``.  Sampled-data: linearised about rest, x = 0.
    Reduced-order: at heading 0, without f2; memory (z_hat, y of the sample before); it filters.
    Not defined for collections.  Whether it is stable is for ``step_limit`` to say.
    """
    dt = _checks.positive(dt, "dt")
    kind = member(observer, "kind")
    if isinstance(kind, str) and kind in _RECURSIONS:
        check(
            gain is None, "gain", gain, "left out", "this law has no gain that moves", DesignError
        )
        return _RECURSIONS[kind](observer, dt)
    law = continuous(observer, gain=gain)
    now = timing(observer)
    c = law.ell * dt
    a, b, seen, direct = step(law, method(observer), now, c)
    scale, n = law.scale[:, None], law.n
    back = scale / law.scale
    shown = (back * seen)[:n], (scale * direct)[:n]
    return Discrete(back * a, scale * b, *shown, dt, law.ell, law.power)


def step(law: Continuous, rule: str, timing: str, c: Array | float) -> tuple[Array, ...]:
    """One step in scaled coordinates: (a, b, c, d), the last two for all states.

    ``c``: ell dt, one number; or many, (...,), for matrices (..., m, m), where the method does not
    correct.
    """
    eye, g = np.eye(law.g.size), law.g[:, None]
    first = eye[:1]  # C
    each = np.asarray(c, dtype=np.float64)[..., None, None]
    if rule in CORRECTING or timing == "current":
        if rule in CORRECTING:
            phi, kept, k = correction(law, rule, float(c))
        else:
            phi, k = _held(law.f, law, rule, each)[0], each * g
            kept = eye - k @ first
        a, b = phi @ kept, phi @ k
        return (a, b, kept, k) if timing == "current" else (a, b, eye, np.zeros_like(g))
    if rule == "rk4-innovation-held":
        a, b = _held(law.f, law, rule, each)
        a = a - b @ first
    else:
        a, b = _held(law.closed, law, rule, each)
    return a, b, eye, np.zeros_like(g)


def _held(m: Array, law: Continuous, rule: str, c: Array) -> tuple[Any, Any]:
    """(a, b) of a step of z' = m z + G w with w held."""
    eye, g = np.eye(len(m)), law.g[:, None]
    if rule == "staggered-euler":
        swept = np.linalg.inv(eye - c * law.links)
        return eye + swept @ (c * m), swept @ (c * g)
    held: Any = eye
    for j in range(ORDERS[rule], 1, -1):
        held = eye + c * m @ held / j  # 1 + c m/2 + (c m)^2/6 + ...
    return eye + c * m @ held, np.broadcast_to(held, np.shape(c)[:-2] + m.shape) @ (c * g)


def correction(law: Continuous, rule: str, c: float) -> tuple[Array, Array, Array]:
    """(Phi, kept, K) of a method that corrects, in scaled coordinates, for c = ell dt.

    z <- kept z + K y, z+ = Phi z: (m, m), (m, m), (m, 1).  Of a chain, kept = 1 - K C and
    kappa(tau) = K_1 + K_2 tau + ... + K_n tau^(n-1)/(n-1)! is by how much a unit innovation moves
    the prediction for a time tau later.  With dt = 1, wanted eigenvalues z and
    prod(delta - (z - 1)) = delta^n + d_1 delta^(n-1) + ... + d_n,

        kappa(tau) = d_1 + d_2 (tau - 1) + d_3 (tau - 1)(tau - 2)/2! + ...

    The low-power laws correct every block by its own e_i, with the gains of
    ``reference.placement.low_power_gains``.
    """
    n, size = law.n, law.g.size
    lift = c**law.power  # in the coordinates c^power z the chain does not know c
    phi, kept, k = np.eye(size), np.eye(size), np.zeros((size, 1))
    flow = chain_step(n, 1.0)
    if size == n:
        phi = flow
        poles = c * np.linalg.eigvals(law.closed)
        moved = np.expm1(poles) if rule == "zoh" else poles / (1.0 - 0.5 * poles)  # z - 1
        kappa, factor = np.polynomial.Polynomial([0.0]), np.polynomial.Polynomial([1.0])
        for r, d in enumerate(np.poly(moved).real[1:], 1):
            kappa += d * factor
            factor *= np.polynomial.Polynomial([-1.0, 1.0 / r])  # (tau - r)/r
        k[:, 0] = [kappa.deriv(i)(0.0) if i else kappa(0.0) for i in range(size)]
        kept[:, :1] -= k
    else:
        # x_i and eta_(i-1) move alike, by the eta above them
        phi[:n, n:] = (flow - np.eye(n))[:, 1:]
        phi[n:, n:] = flow[1:, 1:]
        alpha, beta = -np.diag(law.closed)[:n], -np.diag(law.closed[n:, : n - 1])
        a, b = low_power_gains(alpha * c, beta * c * c, 1.0, rule)[:2]
        innovation = np.zeros((n, size))  # e_i = eta_(i-1) - x_i; y is not a state
        innovation[:, :n] = -np.eye(n)
        innovation[1:, n:] = np.eye(n - 1)
        gains = np.vstack([np.diag(a), np.diag(b, 0) @ np.eye(n - 1, n)])
        kept += gains @ innovation
        k = gains[:, :1]
    scaled = lift / lift[:, None]
    return phi * scaled, kept * scaled, k / lift[:, None]


def chain_step(n: int, dt: float) -> Array:
    """exp(A dt) of a chain of n integrators: dt^(j-i)/(j-i)! above the diagonal."""
    powers = [dt**j / math.factorial(j) for j in range(n)]
    return np.array([[powers[j - i] if j >= i else 0.0 for j in range(n)] for i in range(n)])


# --- the laws ---------------------------------------------------------------------------------


def _standard(observer: Mapping[str, Any], ell: float) -> Continuous:
    k = _checks.vector(member(observer, "k"), "k")
    _checks.order(k.size, "number of k")
    _checks.hurwitz(companion(k), "A - K C")
    return chain(k, ell)


def chain(k: Array, ell: float = 1.0) -> Continuous:
    """The standard law."""
    n = k.size
    shift = np.diag(np.ones(n - 1), 1)  # x_i is lifted by x_{i+1}
    return Continuous(shift, k, shift, np.arange(float(n)), n, ell)


def _low_power(observer: Mapping[str, Any], ell: float) -> Continuous:
    alpha = _checks.vector(member(observer, "alpha"), "alpha")
    beta = _checks.vector(member(observer, "beta"), "beta", alpha.size - 1)
    _checks.hurwitz(low_power_matrix(alpha, beta), "M_n")
    return blocks(alpha, beta, ell)


def blocks(alpha: Array, beta: Array, ell: float = 1.0) -> Continuous:
    """The low-power law: memory x_hat (n), eta (n - 1); M_n has them as (x_1, eta_1, x_2, ...)."""
    n = alpha.size
    order = [*range(0, 2 * n - 1, 2), *range(1, 2 * n - 1, 2)]
    f = low_power_matrix(alpha, beta)[np.ix_(order, order)]
    g = np.zeros(2 * n - 1)
    g[0], g[n] = alpha[0], beta[0]
    f[:, 0] += g
    links = np.zeros_like(f)
    for i in range(n - 1):
        links[i, n + i] = 1.0  # x_i by eta_i
        if i + 1 < n - 1:
            links[n + i, n + i + 1] = 1.0  # eta_i by eta_{i+1}
    power = np.concatenate([np.arange(float(n)), np.arange(1.0, n)])  # eta_i estimates x_{i+1}
    return Continuous(f, g, links, power, n, ell)


def _sampled_data(observer: Mapping[str, Any], dt: float) -> Discrete:
    """Fu et al. (5) about x = 0, where mu = epsilon (1 - y^2) = epsilon."""
    model = member(observer, "model")
    choice(model, "kind", ("van-der-pol",))
    mu = _checks.number(model.get("epsilon", 0.8), "model.epsilon")
    sign = 1.0
    if "gain" in observer:
        sign = 1.0 if choice(observer, "gain", ("derived", "printed")) == "derived" else -1.0
    gains = dt * np.array([5.0 + sign * mu, 5.0 + (5.0 + mu) * mu])
    a = np.eye(2) + dt * np.array([[0.0, 1.0], [-1.0, mu]])
    a[:, 0] -= gains
    return Discrete(a, gains[:, None], np.eye(2), np.zeros((2, 1)), dt, 1.0, np.zeros(2))


def _reduced_order(observer: Mapping[str, Any], dt: float) -> Discrete:
    """Katayama (22): z_hat+ = (1 - T H) z_hat + H (y - y_last)."""
    h_bar = _checks.positive_vector(member(observer, "h_bar"), "h_bar")
    h = np.diag(h_bar) / _checks.positive(member(observer, "epsilon"), "epsilon")
    eye, none = np.eye(h_bar.size), np.zeros_like(h)
    shown = np.hstack([eye - dt * h, -h])
    a, b = np.vstack([shown, np.hstack([none, none])]), np.vstack([h, eye])
    return Discrete(a, b, shown, h, dt, 1.0, np.zeros(2 * h_bar.size))


_LINEAR = {"standard": _standard, "low-power": _low_power, "peaking-free": _low_power}
_RECURSIONS = {"sampled-data": _sampled_data, "reduced-order": _reduced_order}


# --- spec entries -----------------------------------------------------------------------------


def member(spec: Mapping[str, Any], key: str) -> Any:
    """``spec[key]``, which must be there."""
    check(key in spec, key, None, "given", f"add {key!r} to the spec", DesignError)
    return spec[key]


def choice(spec: Mapping[str, Any], key: str, allowed: tuple[str, ...]) -> str:
    """``spec[key]``, one of ``allowed``."""
    value = member(spec, key)
    if not isinstance(value, str) or value not in allowed:
        names = ", ".join(repr(name) for name in allowed)
        raise DesignError(explain(key, value, f"one of {names}", "correct the name"))
    return value


def method(observer: Mapping[str, Any]) -> str:
    """The discretisation, "euler" where left out."""
    return choice(observer, "method", METHODS) if "method" in observer else "euler"


def timing(observer: Mapping[str, Any]) -> str:
    """The timing, "predictor" where left out."""
    return choice(observer, "timing", TIMINGS) if "timing" in observer else "predictor"


def _frozen(observer: Mapping[str, Any], gain: float | None) -> float:
    """The gain at which a law is linear."""
    given = member(observer, "gain")
    if choice(given, "law", ("constant", "adaptive", "dead-zone")) == "constant":
        remedy = "set the gain itself"
        _checks.demand(gain is None, "gain", gain, "left out for a constant gain", remedy)
        return _checks.positive(member(given, "ell"), "gain.ell")
    remedy = "give the value at which to freeze it, gain=..."
    _checks.demand(gain is not None, "gain", gain, "given: this law's gain moves", remedy)
    return _checks.positive(gain, "gain")
