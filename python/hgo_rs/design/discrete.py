"""The linear part of every observer: law x discretisation x timing, by the law's own steps.

A law with a constant gain, its model left out and its saturations at rest, is a linear filter of y.
In coordinates scaled by powers of the gain (state i holds z_i = x_hat_i / ell^(i-1), time runs in
1/ell) it is the law at gain 1, and one step depends on c = ell dt alone.  So the compiled law is
stepped over c at gain 1, from memories that are 1 in one entry and 0 in the others and once by
y = 1: what comes out are the columns of the step's matrices, whatever law, method and timing.  A
step of forward Euler gives the law in continuous time,

    z' = M z + G y,        M = F - G C,        C = (1, 0, ..., 0):    z+ = z + c (M z + G y),

and how its entries grow from gain 1 to gain 2 gives the powers of the gain.

Timing "predictor" shows z before the sample y(k) is used.  "current" corrects by it first and shows
what is then known.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from hgo_rs import _core
from hgo_rs.errors import DesignError, check, check_integer, explain
from hgo_rs.laws import LAWS, Law

from . import _checks
from ._checks import Array

RATED = ("euler", "staggered-euler", "rk4", "rk4-innovation-held", "bogacki-shampine")
"""Methods of rates: every continuous law has them."""

CORRECTING = ("zoh", "bilinear", "implicit-map")
"""Methods that correct by the sample, then move: stable for any step."""

EXACT = (*CORRECTING, "proper", "inter-sample")
"""Methods whose chain moves exactly between samples."""

METHODS = (*RATED, *EXACT, "implicit")
"""Discretisations of a continuous law.

`rk4` and `bogacki-shampine` hold the measurement over a step, `rk4-innovation-held` the innovation.
`zoh`, `bilinear` and `implicit-map` are stable at any step: between samples the chain is solved
exactly, and the correction gives the error the eigenvalues exp(dt lambda), those of the bilinear
rule, or 1/(1 - dt lambda).  `proper` moves the chain exactly and adds dt times the injection.
`inter-sample` predicts the output between samples: the injection decays.  `implicit` is backward
Euler in chain and injection.
"""

TIMINGS = ("predictor", "current")
"""Whether the estimate at sample k uses samples up to k - 1, or up to k."""

DEFAULT_METHOD = "zoh"
"""The method of a class where it is left open and the law can be placed."""
DEFAULT_TIMING = "current"
"""The timing of a class where it is left open."""

GAIN_LAWS = (
    "constant",
    "adaptive",
    "dead-zone",
    "homogeneous",
    "switched",
    "prescribed-time",
)
"""Gain laws by their words in specs."""

MOTIONS = ("held", "rk4", "implicit")
"""How the model moves over a period under an exact method: held at its beginning; by RK4; implicit
(backward Euler) where it is stiff, else by RK4."""

SUBSTEPS = 2
"""Steps that a period is cut into for "rk4" and "implicit" where it is left open."""
MAX_SUBSTEPS = 16


@dataclass(frozen=True, eq=False)
class Continuous:
    """z' = F z + G (y - z_1), the linear part of a law in coordinates scaled at ``ell``.

    ``f``: (m, m); ``g``: (m,); ``power``: (m,), state i is ell^power[i] z_i; ``n``: how many of
    them are estimates, the first.
    """

    f: Array
    g: Array
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

    ``observer``: the spec of a law of one chain; saturations are at rest.
    ``gain``: the value [1/s] at which a gain that moves is frozen; needed there, refused elsewhere.

    Raises DesignError for a law whose samples act at once ("reduced-chain").
    """
    law = linear(observer, gain=gain)
    remedy = "give dt: the response to white noise is unbounded in continuous time"
    check(not acts_at_once(unit(observer)), "dt", None, "given for this law", remedy, DesignError)
    return law


def linear(observer: Mapping[str, Any], *, gain: float | None = None) -> Continuous:
    """The same of any law of one chain; of one whose samples act at once, the chain with ell times
    what a sample moves, for its scales and its ``following``.
    """
    several = observer.get("kind") == "chains"
    remedy = "call it for the observer of each output, as passed to MultiOutputObserver"
    check(not several, "kind", "chains", "a law of one output", remedy, DesignError)
    kind = choice(observer, "kind", tuple(LAWS))
    if not LAWS[kind].continuous:
        allowed = "a law in continuous time"
        raise DesignError(explain("kind", kind, allowed, "this one is a recursion: give dt"))
    if not LAWS[kind].single:
        remedy = "analyse one copy: a StandardObserver with the same k"
        if "P0" in observer:
            remedy = "its gains move with P; analyse the law that hgo_rs.design.riccati gives"
        raise DesignError(explain("kind", kind, "a law with one chain", remedy))
    ell = _frozen(observer, gain)
    f, g, power = rates(unit(observer))
    return Continuous(f, g, power, sizes(observer)[0], ell)


def following(observer: Mapping[str, Any], size: int | None = None) -> Array:
    """L, (m, n): on the chain's own motion x' = A x, y = x_1, the memory of a continuous law of one
    chain is z = L x.  Estimates are x, eta of the low-power laws too; states of a filter are 0.

    M L - L A + G C = 0, in scaled coordinates, which are also those of the law at gain 1.
    ``size``: rows of a memory that keeps more than the law's, which stays 0: an innovation that is
    kept between samples.
    """
    f, g, _ = rates(unit(observer))
    n, m = sizes(observer)[0], len(g)
    closed, given = f.copy(), np.zeros((m, n))
    closed[:, 0] -= g
    given[:, 0] = g
    sum_of = np.kron(np.eye(n), closed) - np.kron(np.eye(n, k=1).T, np.eye(m))
    found = np.linalg.solve(sum_of, -given.ravel(order="F")).reshape(m, n, order="F")
    whole = np.rint(found)
    near = np.where(np.abs(found - whole) < 1e-6, whole, found)
    return np.pad(near, ((0, (size or m) - m), (0, 0)))


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
    law = linear(observer, gain=gain)
    a, b, seen, direct = _step(unit(observer), method(observer), timing(observer), law.ell * dt)
    kept = np.zeros(len(a) - len(law.power))  # an innovation that decays has the unit of y
    power = np.append(law.power, kept)
    each, n = law.ell**power, law.n
    scale = each[:, None]
    back = scale / each
    shown = (back * seen)[:n], (scale * direct)[:n]
    return Discrete(back * a, scale * b, *shown, dt, law.ell, power)


def defines(law: Law, rule: str) -> bool:
    """Whether a method is defined for a law."""
    if rule in CORRECTING:
        return law.placed
    if rule == "proper":
        return law.flows
    return rule in RATED or law.kind == "standard"


def fixed_timing(rule: str) -> str | None:
    """The timing of a method that has only one: a step that ends with its sample; an estimate that
    does not jump at one.
    """
    return {"implicit": "current", "inter-sample": "predictor"}.get(rule)


# --- the law's own steps ----------------------------------------------------------------------

Unit = tuple[tuple[str, Any], ...]
"""A law at gain 1: kind, n, the second size, lists of coefficients, as entries of a spec."""

_AT_REST = 1e150
"""A level that no memory of a linear law reaches."""


def unit(observer: Mapping[str, Any], *, steepest: bool = False) -> Unit:
    """What of a continuous law's spec its steps at gain 1 depend on, under a shape at small
    innovations, or where it is steepest.
    """
    law = LAWS[observer["kind"]]
    n, m = sizes(observer)
    entries: list[tuple[str, Any]] = [("kind", law.kind), ("n", n)]
    if law.size:
        entries.append((law.size[0], m))
    for name, count in law.counts(n, m).items():
        values = _checks.vector(member(observer, name), name, count)
        if name == "k":
            values = values * slopes(observer, count, steepest)
        entries.append((name, tuple(values.tolist())))
    return tuple(entries)


def slopes(observer: Mapping[str, Any], n: int, steepest: bool) -> Array:
    """The slope of each row of a shape at small innovations, or where it is steepest.

    `fal`: delta^(alpha_i - 1), both.  `piecewise-linear`: ratio^i within its zone, 1 outside.
    Thresholds: 1 below that of the stubborn, beyond that of the dead zone; flat elsewhere.
    """
    shape = observer.get("shape")
    if shape is not None and shape["law"] == "fal":
        exponents = _checks.vector(member(shape, "alpha"), "shape.alpha", n) - 1.0
        return np.asarray(_checks.positive(member(shape, "delta"), "shape.delta") ** exponents)
    if shape is not None and shape["law"] == "piecewise-linear" and not steepest:
        ratio = _checks.positive(member(shape, "ratio"), "shape.ratio")
        return np.asarray(ratio ** np.arange(1, n + 1))
    return np.ones(n)


def sizes(observer: Mapping[str, Any]) -> tuple[int, int]:
    """The order, where a spec leaves it out that of its coefficients, and the second size or 0."""
    law = LAWS[observer["kind"]]
    m = 0
    if law.size:
        name, values = law.size
        least, most = min(values), max(values)
        m = check_integer(member(observer, name), name, least=least, most=most, error=DesignError)
    if "n" in observer:
        return _checks.order(observer["n"]), m
    first = law.coefficients[0][0]
    given = _checks.vector(member(observer, first), first).size
    for n in law.orders:
        if law.counts(n, m)[first] == given:
            return n, m
    return _checks.order(given, f"number of {first}"), m


def _spec(of: Unit, rule: str, now: str, ell: float = 1.0) -> dict[str, Any]:
    """The spec of the law without a model, its gain `ell`, or at rest at 1 where it must move."""
    spec: dict[str, Any] = {**dict(of), "method": rule, "timing": now}
    law = LAWS[spec["kind"]]
    if law.saturated and not law.open:
        spec["saturation"] = [_AT_REST] * (spec["n"] - 1)
    spec["gain"] = {"law": "constant", "ell": ell}
    if law.gain == "adaptive":
        spec["gain"] = {"law": "adaptive", "p1": 1.0 / _AT_REST, "p2": 1.0, "b": 0.25}
    return spec


def at_unit_gain(observer: Mapping[str, Any]) -> dict[str, Any]:
    """The spec of an observer at gain 1, its model left out: one step of it over ell dt is that of
    the observer over dt, state i in units of ell^(i-1).
    """
    return _spec(unit(observer), method(observer), timing(observer))


class Steps:
    """Steps of a law at gain 1 (or `ell`) from memories that are not 0 in one entry."""

    def __init__(self, of: Unit, rule: str, now: str, ell: float = 1.0) -> None:
        try:
            self.core = _core.Observer(_spec(of, rule, now, ell))
        except ValueError as error:
            raise DesignError(str(error)) from None
        self.rest = self.core.initial()
        own = self.rest[: len(self.rest) - self.core.is_current]
        self.entries = np.flatnonzero(own == 0.0)
        """Those of the law's memory that move linearly: all but gains."""

    def __call__(self, c: float) -> tuple[Array, ...]:
        """One step over ``c``: (a, b, c, d), the last two for all states."""
        size = self.entries.size
        starts = np.vstack([np.eye(size), np.zeros(size)])
        shown, moved = self._from(starts, c, [_NOTHING] * size + [_UNIT])
        return moved[:, :-1], moved[:, -1:], shown[:, :-1], shown[:, -1:]

    def error(self, c: float, starts: Array | None = None) -> Array:
        """``a`` alone; of the part that memories ``starts`` (m, k) span and a step keeps (k, k)."""
        if starts is None:
            starts = np.eye(self.entries.size)
        moved = self._from(starts.T, c, [_NOTHING] * starts.shape[1])[1]
        return moved if len(moved) == starts.shape[1] else np.linalg.pinv(starts) @ moved

    def _from(self, starts: Array, c: float, samples: list[Array]) -> tuple[Array, Array]:
        """What is shown and what is next, a column for each row of ``starts``."""
        memories = np.tile(self.rest, (len(starts), 1))
        memories[:, self.entries] = starts
        if self.core.is_current:
            memories[:, -1] = c
            each = zip(memories, samples, strict=True)
            memories = np.array([self.core.correct(memory, y, 0.0)[0] for memory, y in each])
        each = zip(memories, samples, strict=True)
        moved = np.array([self.core.advance(z, y, _NO_INPUT, 0.0, c)[0] for z, y in each])
        return memories[:, self.entries].T, moved[:, self.entries].T


_NOTHING, _UNIT = np.zeros(1), np.ones(1)
_NO_INPUT = np.empty(0)


@lru_cache(maxsize=1024)
def _step(of: Unit, rule: str, now: str, c: float) -> tuple[Array, ...]:
    """One step of a law at gain 1 over ``c``, as ``Steps`` has it."""
    found = Steps(of, rule, now)(c)
    for array in found:
        array.flags.writeable = False
    return found


@lru_cache(maxsize=256)
def rates(of: Unit) -> tuple[Array, Array, Array]:
    """(F, G, powers of the gain) of a law in continuous time, in scaled coordinates."""
    one, two = (_euler(of, ell) for ell in (1.0, 2.0))
    f, g = one[:, :-1].copy(), one[:, -1].copy()
    f[:, 0] += g  # without a sample
    for array in (f, g):
        array.flags.writeable = False
    return f, g, _powers(one, two)


def _euler(of: Unit, ell: float) -> Array:
    """[M G] at a gain, (m, m + 1), by forward Euler over 1 s."""
    a, b, *_ = Steps(of, "euler", "predictor", ell)(1.0)
    rate = a - np.eye(len(a))
    if acts_at_once(of):
        jump = ell * Steps(of, "euler", "current", ell)(0.0)[3]
        rate[:, :1] += b - jump
        b = jump
    return np.column_stack([rate, b])


def acts_at_once(of: Unit) -> bool:
    """Whether a sample moves the memory however short its step."""
    return bool(np.any(Steps(of, "euler", "current")(0.0)[3]))


def _powers(one: Array, two: Array) -> Array:
    """State i is ell^p_i z_i: what entry j gives to the rate of i grows as ell^(1 + p_i - p_j).

    ``one``, ``two``: [M G] at gains 1 and 2.  y, the last column, has the power 0 and all else is
    found from it along the law's links.
    """
    power = np.append(np.full(len(one), np.nan), 0.0)
    for _ in power:
        for i, j in np.argwhere(np.abs(one) > 1e-12):
            grown = np.log2(np.abs(two[i, j] / one[i, j])) - 1.0
            if np.isnan(power[i]):
                power[i] = power[j] + grown
            elif np.isnan(power[j]):
                power[j] = power[i] - grown
    found = np.rint(power[:-1])
    found.flags.writeable = False
    return found


# --- recursions -------------------------------------------------------------------------------


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


def _window(observer: Mapping[str, Any], dt: float) -> Discrete:
    """Gains on a window, with its own period: memory (x_hat, d) before the sample is used."""
    n, m = int(member(observer, "n")), int(member(observer, "window"))
    gains = np.reshape(member(observer, "W"), (n, m))
    orders = np.array([math.factorial(i) for i in range(n)])
    back = (-dt * np.arange(m)) ** np.arange(n)[:, None] / orders[:, None]
    shift = np.eye(n, k=1)
    powers = (np.linalg.matrix_power(shift, j) / math.factorial(j) for j in range(n))
    chain = sum(power * dt**j for j, power in enumerate(powers))
    # d = (y - x_1, d_0, ..., d_(m-2)) of memory and sample
    aged, fresh = np.zeros((m, n + m)), np.eye(m)[:, :1]
    aged[0, 0] = -1.0
    aged[1:, n : n + m - 1] = np.eye(m - 1)
    shown = np.eye(n, n + m) + gains @ aged
    rest, rest_of_y = aged - back.T @ gains @ aged, fresh - back.T @ gains @ fresh
    a, b = np.vstack([chain @ shown, rest]), np.vstack([chain @ gains @ fresh, rest_of_y])
    return Discrete(a, b, shown, gains @ fresh, dt, 1.0, np.zeros(n + m))


_RECURSIONS = {
    "sampled-data": _sampled_data,
    "reduced-order": _reduced_order,
    "window": _window,
}


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
    law = choice(given, "law", GAIN_LAWS)
    shape = observer.get("shape")
    if shape is not None and shape["law"] == "bi-homogeneous":
        allowed = "one that is linear at small innovations"
        raise DesignError(explain("shape.law", shape["law"], allowed, "simulate it"))
    if law == "homogeneous" and given.get("degree") != 0.0:
        remedy = "the gain of this one has no bound at e = 0; simulate it"
        allowed = "one that is linear at small innovations"
        raise DesignError(explain("gain.law", law, allowed, remedy))
    if law == "homogeneous":
        return _checks.positive(member(given, "rho"), "gain.rho")
    if law == "constant":
        remedy = "set the gain itself"
        _checks.demand(gain is None, "gain", gain, "left out for a constant gain", remedy)
        return _checks.positive(member(given, "ell"), "gain.ell")
    remedy = "give the value at which to freeze it, gain=..."
    _checks.demand(gain is not None, "gain", gain, "given: this law's gain moves", remedy)
    return _checks.positive(gain, "gain")
