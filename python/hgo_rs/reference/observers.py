"""The papers' observers, one class a law, the equation number at the line.

A memory is an array of columns, shape (memory_len, runs): its first n entries are x_hat, then come
the extras (eta, r, ...).  ``e`` is the innovation y - x_hat_1.  A missing sample (NaN or infinite)
makes the innovation zero: the observer predicts.
"""

from __future__ import annotations

from collections.abc import Callable
from math import factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import covariance, integrate
from . import motion as moving
from .error import Array, Spec, choice, fail, integer, known, member, number, vector
from .gain import (
    AdaptiveGain,
    ConstantGain,
    DeadZoneGain,
    GainLaw,
    HomogeneousGain,
    SwitchedGain,
    gain_from,
)
from .models import CHAINED, Chain, Own, Plant, Ship, VanDerPol, plant_from
from .placement import (
    BILINEAR_LIMIT,
    PLACED,
    ahead,
    chain_gains,
    decaying_gains,
    low_power_gains,
)
from .polynomial import is_hurwitz, low_power_polynomial
from .shape import Shape, shape_from

METHODS = (
    "euler",
    "staggered-euler",
    "rk4",
    "rk4-innovation-held",
    "bogacki-shampine",
    *PLACED,
    "proper",
    "implicit",
    "inter-sample",
)
TIMINGS = ("predictor", "current")
MAX_ORDER = 12


class Law:
    """What all laws share: sizes, and one step.

    A law with predictor timing has ``step``; one with current timing ``correct`` and ``predict``.
    Memories (memory_len, runs) are never changed in place; ``y``: (runs,), or (n_y, runs) where a
    law takes several outputs, NaN or infinite where it is missing; ``u``: (n_u, runs) or None.
    """

    n: int
    n_y = 1
    n_u = 0
    memory_len: int
    is_current = False  # predictor: the estimate at k uses samples up to k-1
    may_be_undefined = False  # whether its model may have no value somewhere

    @property
    def signals(self) -> int:
        """How many entries of the memory, the first ones, are worth a metric."""
        return self.memory_len

    def step(self, memory: Array, y: Array, u: Array | None, t: float, dt: float) -> Array:
        """The memory after the sample ``y`` at ``t``, and after the step ``dt`` that follows."""
        raise NotImplementedError

    def correct(self, memory: Array, y: Array, t: float) -> Array:
        """The memory after the use of the sample ``y`` at time ``t``."""
        raise NotImplementedError

    def predict(self, memory: Array, u: Array | None, t: float, dt: float) -> Array:
        """The memory a time ``dt`` after ``t``, under the input that is applied meanwhile."""
        raise NotImplementedError

    def residual(self, memory: Array, y: Array, u: Array | None, t: float) -> Array:
        """The innovation of a record: y - (predicted y), shape of ``y``."""
        return y - memory[0]

    def target(self, plant: Plant) -> slice:
        """Which entries of a plant's state are estimated."""
        return plant.target

    def settle(self, old: Array, new: Array) -> tuple[Array, NDArray[np.bool_]]:
        """``new``, but ``old`` where the model had no value; and where that is, one entry a run."""
        undefined: NDArray[np.bool_] = np.zeros(new.shape[1], dtype=np.bool_)
        if self.may_be_undefined:
            undefined = np.logical_not(np.isfinite(new).all(axis=0))
            if undefined.any():
                new = np.where(undefined, old, new)
        return new, undefined

    def initial(self) -> Array:
        """Memory to start from when nothing is known, (memory_len,)."""
        return np.zeros(self.memory_len)

    def check(self, memory: Array) -> None:
        """Refuse a memory from which the law cannot start."""


def innovation(y: Array, predicted: Array) -> Array:
    """y - (predicted y), 0 where y is missing."""
    present = np.isfinite(y)
    e = y - predicted
    return e if present.all() else np.where(present, e, 0.0)


class ContinuousLaw(Law):
    """A law given by a rate d(memory)/dt, discretised by a scheme: with predictor timing."""

    method: str
    model: Plant
    placed = False  # whether its eigenvalues can be placed
    motion = ("held", 1)  # how the model moves between placed corrections, steps a period
    gain_rows: tuple[int, ...] = ()  # where in the memory gains r >= 1 stand
    gain: Any
    gain_at: int | None = None  # where what a gain law remembers stands
    shape: Shape | None = None
    shape_row: int | None = None  # where its threshold sigma >= 0 stands

    def innovation(self, memory: Array, y: Array) -> Array:
        """e = y - x_hat_1, shape (runs,)."""
        return innovation(y, memory[0])

    def rate(self, memory: Array, e: Array, u: Array | None, t: float) -> Array:
        """d(memory)/dt at ``t`` for the innovation(s) ``e``."""
        raise NotImplementedError

    def injection(self, memory: Array, e: Array) -> Array:
        """What of the rate is due to ``e``: the rate less that at e = 0."""
        raise NotImplementedError

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """Staggered Euler: repeat the chain's sums with new values, from the bottom up."""
        raise NotImplementedError

    def initial(self) -> Array:
        """x_hat = 0, and r = 1 where the gain moves."""
        memory = np.zeros(self.memory_len)
        memory[list(self.gain_rows)] = 1.0
        if self.shape and self.shape_row is not None:
            memory[self.shape_row] = self.shape.sigma0
        return memory

    def clamp(self, memory: Array) -> None:
        """r >= 1, a quiet time >= 0 and sigma >= 0, in place, after a step."""
        for row in self.gain_rows:
            np.maximum(memory[row], 1.0, out=memory[row])
        if self.gain_at is not None and isinstance(self.gain, SwitchedGain):
            np.maximum(memory[self.gain_at], 0.0, out=memory[self.gain_at])
        if self.shape_row is not None:
            np.maximum(memory[self.shape_row], 0.0, out=memory[self.shape_row])

    def driven_by(self, at: int, *, alone: bool = True) -> None:
        """Where the gain law's memory stands; `alone`: the standard law, which any law drives."""
        if isinstance(self.gain, HomogeneousGain) and not alone:
            raise fail("observer.gain", "homogeneous", "of kind standard", "choose another gain")
        self.memory_len = at + self.gain.moves
        self.gain_at = at if self.gain.moves else None
        self.gain_rows = (at,) if self.gain.least is not None else ()

    def acting(self, memory: Array, e: Array) -> Array | None:
        """The gain that acts, (runs,); None for one that is folded into the coefficients."""
        if isinstance(self.gain, ConstantGain):
            return None
        return self.gain.moving(memory[self.gain_at or 0], e)

    def gain_rate(self, memory: Array, e: Array, out: Array, *, driven_only: bool = False) -> None:
        """d(memory)/dt of gain law and threshold, into `out`; or what of it is due to e."""
        zero = np.zeros_like(e)
        if self.gain_at is not None:
            now = memory[self.gain_at]
            rate = self.gain.rate(now, e, self.n)
            out[self.gain_at] = rate - self.gain.rate(now, zero, self.n) if driven_only else rate
        if self.shape_row is not None:
            rate = self.threshold(memory, e)
            out[self.shape_row] = rate - self.threshold(memory, zero) if driven_only else rate

    def gain_moved(self, memory: Array, e: Array, new: Array, dt: float, driven_only: bool) -> None:
        """`new` with these entries moved over dt."""
        rate = np.zeros_like(memory)
        self.gain_rate(memory, e, rate, driven_only=driven_only)
        for row in (self.gain_at, self.shape_row):
            if row is not None:
                new[row] += dt * rate[row]

    def jumped(self, memory: Array, y: Array) -> Array:
        """The memory at a sample, before its step."""
        if self.gain_at is None or not isinstance(self.gain, SwitchedGain):
            return memory
        new = memory.copy()
        new[self.gain_at] = self.gain.jumped(memory[self.gain_at], self.innovation(memory, y))
        return new

    def wear(self, spec: Spec, *, rows: bool = False) -> None:
        """The shape of the spec, its threshold the last entry of the memory; `rows`: whether the
        rows of the injection may differ.
        """
        self.shape = shape_from(spec, self.n)
        if self.shape is None:
            return
        if not self.shape.alike and not rows:
            raise fail("observer.shape", spec["shape"], "stubborn or dead-zone", "or kind standard")
        if not self.shape.alike and self.method in PLACED:
            raise fail("observer.method", self.method, "a method of rates", "take rk4 or euler")
        if self.shape.remembers:
            self.shape_row = self.memory_len
            self.memory_len += 1

    def shaped(self, memory: Array, e: Array) -> Array:
        """What is injected in the place of e: (runs,), or (n, runs) where rows differ."""
        if self.shape is None:
            return e
        sigma = memory[0] if self.shape_row is None else memory[self.shape_row]
        return np.asarray(self.shape.rows(sigma, e))

    def threshold(self, memory: Array, e: Array) -> Array:
        """d(sigma)/dt, (runs,)."""
        return np.asarray(self.shape.rate(memory[self.shape_row], e))  # type: ignore[union-attr]

    def step(self, memory: Array, y: Array, u: Array | None, t: float, dt: float) -> Array:
        """One step of the scheme with y held; of a placed method, correct over dt, then predict."""
        method = self.method
        if method == "inter-sample":
            return self.decayed(memory, y, u, t, dt)
        if method in PLACED:
            return self.moved(self.sampled(memory, y, dt), u, t, dt)
        memory = self.jumped(memory, y)
        if method == "proper":
            self.held_y = y
            new = moving.moved(self, self.motion, memory, u, t, dt)
            self.held_y = None
            new += dt * self.kick(memory, self.innovation(memory, y))
            self.clamp(new)
            return new
        if method == "euler" or method == "staggered-euler":
            new = memory + dt * self.rate(memory, self.innovation(memory, y), u, t)
            if method == "staggered-euler":
                self.lift(memory, new, dt)
        elif method == "rk4-innovation-held":
            held = self.innovation(memory, y)
            new = integrate.rk4(lambda s, m: self.rate(m, held, u, s), t, memory, dt)
        else:
            new = integrate.DETERMINISTIC[method](
                lambda s, m: self.rate(m, self.innovation(m, y), u, s), t, memory, dt
            )
        self.clamp(new)
        return new

    def moved(self, memory: Array, u: Array | None, t: float, dt: float) -> Array:
        """A step without a sample."""
        if self.method == "implicit":  # the chain with new values, without a sample
            new = memory + dt * self.rate(memory, np.zeros(memory.shape[1]), u, t)
            self.lift(memory, new, dt)
            self.clamp(new)
            return new
        if self.method not in PLACED:
            return self.step(memory, np.full(memory.shape[1], np.nan), u, t, dt)
        new = moving.moved(self, self.motion, memory, u, t, dt)
        self.clamp(new)
        return new

    def corrected(self, memory: Array, y: Array, dt: float) -> Array:
        """What the sample injects for the time ``dt`` > 0 that it ends."""
        new = self.sampled(memory, y, dt)
        self.clamp(new)
        return new

    def sampled(self, memory: Array, y: Array, dt: float) -> Array:
        """The same before a flow over ``dt``: by Euler, or placed."""
        memory = self.jumped(memory, y)
        e = self.innovation(memory, y)
        if self.method in PLACED:
            return self.place(memory, e, dt)
        if self.method == "implicit":
            new = memory + dt * self.closing(memory, e, dt)
            self.lift(memory, new, dt)
            return new
        return memory + dt * self.injection(memory, e)

    @property
    def signals(self) -> int:
        """All but what decays between samples."""
        return self.memory_len - (self.method == "inter-sample")

    held_y: Array | None = None  # the sample of a step by "proper", for a chain behind a filter

    def kick(self, memory: Array, e: Array) -> Array:
        """What of the rate is neither the chain's own nor known."""
        return self.injection(memory, e)

    def closing(self, memory: Array, e: Array, dt: float) -> Array:
        """What the sample injects at the end of an implicit step, as a rate."""
        raise NotImplementedError

    def decayed(self, memory: Array, y: Array, u: Array | None, t: float, dt: float) -> Array:
        """A step of the inter-sample predictor; the last entry of the memory is what decays."""
        raise NotImplementedError

    @property
    def n_terms(self) -> int:
        """Rows of ``terms``."""
        return self.n

    def terms(self, memory: Array, u: Array | None, t: float) -> Array:
        """What is known of the system, (n_terms, runs)."""
        raise NotImplementedError

    def flow(self, memory: Array, f: Array, dt: float) -> Array:
        """A step along the chain, exact, under the terms ``f``."""
        raise NotImplementedError

    def chain(self, delta: Array) -> Array:
        """A delta: each entry's rate is the next entry, but for an unknown."""
        rate = np.vstack([delta[1:], np.zeros_like(delta[:1])])
        if self.model.carries:
            rate[-2] = 0.0
        return rate

    def shifted(self, memory: Array, delta: Array) -> Array:
        """The memory, its estimate moved by ``delta``."""
        raise NotImplementedError

    def place(self, memory: Array, e: Array, dt: float) -> Array:
        """The correction that places the eigenvalues of the error."""
        raise NotImplementedError

    def check(self, memory: Array) -> None:
        """r(0) >= 1."""
        for row in self.gain_rows:
            least = float(memory[row].min())
            if least < 1.0:
                raise fail(f"memory0[{row}] (r)", least, ">= 1", "start the gain at 1 or above")


def _coefficients(spec: Spec, n: int) -> Array:
    k = vector(member(spec, "k", "observer"), "observer.k", n)
    if not is_hurwitz(k):
        raise fail(
            "observer.k",
            k.tolist(),
            "such that s^n + k_1 s^(n-1) + ... + k_n is Hurwitz",
            "take coefficients_from_poles of poles in the left half plane",
        )
    return k


def _order(spec: Spec) -> int:
    return integer(member(spec, "n", "observer"), "observer.n", least=1, most=MAX_ORDER)


def _method(spec: Spec) -> str:
    return choice(spec.get("method", "euler"), "observer.method", METHODS)


def _model(spec: Spec, n: int, chain: Chain | None) -> Plant:
    if chain is not None:
        if "model" in spec:
            raise fail("observer.model", spec["model"], "left out", "the chains share one model")
        model: Plant = chain
    else:
        model = plant_from(spec.get("model", {"kind": "none"}), "model")
    if model.n not in (0, n) or model.n_y != 1:
        raise fail("observer.model", model.kind, f"a model of order {n}", "use kind 'none'")
    if isinstance(model, Own) and model.form not in ("phase", "triangular", CHAINED):
        allowed = "of phase-variable or triangular form, or a nonlinear chain"
        remedy = "use kind 'chains', 'sampled-data' or 'reduced-order'"
        raise fail("observer.model.form", model.form, allowed, remedy)
    return model


def above(model: Plant, x: Array, u: Array | None, t: float) -> Array:
    """x_2 ... x_n, as they enter the rates of x_1 ... x_{n-1}; ``x``: (n, ...)."""
    last = model.enters(x, x[-1], u, t)
    return np.concatenate((x[1:-1], last[None])) if len(x) > 1 else x[1:]


def in_unit(model: Plant, x: Array, correction: Array) -> Array:
    """A correction of a chain, each row over the product of the slopes up to its state."""
    slopes = model.slopes(x)[len(x) - len(correction) :]  # eta has no row of the first state
    return np.asarray(correction / np.cumprod(slopes, axis=0))


def known_terms(model: Plant, x: Array, u: Array | None, t: float) -> Array:
    """f_hat, (n, runs)."""
    f = model.known(x, u, t)
    return np.zeros_like(x) if f is None else f.copy()


class StandardObserver(ContinuousLaw):
    """The standard high-gain observer with any gain law.

    Astolfi et al., eq. (2); Lee et al., eq. (39) and, by Euler's scheme, (42) and (44) with
    q_i = epsilon^(i-1) x_hat_i; Sanfelice, Praly, eq. (5)-(7) with the adaptive gain.
    Memory: x_hat (n), and r if the gain moves.
    """

    placed = True

    def __init__(self, spec: Spec, chain: Chain | None = None) -> None:
        self.n = _order(spec)
        self.k = _coefficients(spec, self.n)
        self.gain: GainLaw = gain_from(member(spec, "gain", "observer"), self.n)
        self.model = _model(spec, self.n, chain)
        self.may_be_undefined = self.model.kind == "own"
        self.n_u = self.model.n_u
        self.method, self.motion = _method(spec), moving.motion_from(spec, "observer")
        self.driven_by(self.n)
        if isinstance(self.gain, ConstantGain):
            powers = self.gain.ell ** np.arange(1, self.n + 1)
            self._injection = (self.k * powers)[:, None]  # k_i ell^i
        self.wear(spec, rows=True)
        self.memory_len += self.method == "inter-sample"

    def injected(self, v: Array, g: Array | None) -> Array:
        """k_i g^i v, (n, runs); ``v`` is e, or what a shape makes of it."""
        if g is None:
            return np.asarray(self._injection * v)
        rate = np.array(np.broadcast_to(v, (self.n, v.shape[-1])))
        power = g
        for i in range(self.n):
            rate[i] = self.k[i] * power * rate[i]
            power = power * g
        return rate

    def driven(self, x_hat: Array, v: Array, g: Array | None, u: Array | None, t: float) -> Array:
        """x_hat_i' = x_hat_{i+1} + f_i(x_hat) + k_i g^i v."""
        rate = in_unit(self.model, x_hat, self.injected(v, g))
        rate[:-1] += above(self.model, x_hat, u, t)
        f = self.model.known(x_hat, u, t)
        if f is not None:
            rate += f
        return rate

    def rate(self, memory: Array, e: Array, u: Array | None, t: float) -> Array:
        """Astolfi (2); Sanfelice, Praly (5), (6)."""
        n, v = self.n, self.shaped(memory, e)
        rate = np.empty_like(memory)
        rate[:n] = self.driven(memory[:n], v, self.acting(memory, e), u, t)
        self.gain_rate(memory, e, rate)
        return rate

    def injection(self, memory: Array, e: Array) -> Array:
        """Of x_hat k_i g^i v; of r and sigma what their rates have of e."""
        n, v, rate = self.n, self.shaped(memory, e), np.empty_like(memory)
        rate[:n] = in_unit(self.model, memory[:n], self.injected(v, self.acting(memory, e)))
        self.gain_rate(memory, e, rate, driven_only=True)
        return rate

    def terms(self, memory: Array, u: Array | None, t: float) -> Array:
        """f_hat of the estimate, with what an unknown enters."""
        x_hat = memory[: self.n]
        f = known_terms(self.model, x_hat, u, t)
        if self.model.carries:
            f[-2] += self.model.enters(x_hat, x_hat[-1], u, t)
        return f

    def flow(self, memory: Array, f: Array, dt: float) -> Array:
        """x_hat along the chain; r without a sample."""
        n, new = self.n, memory.copy()
        new[:n] += ahead(self.chain(memory[:n]) + f, dt)
        self.gain_moved(memory, np.zeros_like(memory[0]), new, dt, False)
        return new

    def shifted(self, memory: Array, delta: Array) -> Array:
        """x_hat alone."""
        return np.vstack([memory[: self.n] + delta, memory[self.n :]])

    def place(self, memory: Array, e: Array, dt: float) -> Array:
        """x_hat + K v."""
        n, new, v = self.n, memory.copy(), self.shaped(memory, e)
        powers = np.arange(1, n + 1)
        self.gain_moved(memory, e, new, dt, True)
        if isinstance(self.gain, ConstantGain):
            k = chain_gains(self.k * self.gain.ell**powers, dt, self.method)
            new[:n] += in_unit(self.model, memory[:n], k[:, None] * v)
            return new
        acting = self.gain.moving(memory[self.gain_at or 0], e)
        gains = [chain_gains(self.k * r**powers, dt, self.method) for r in acting]
        new[:n] += in_unit(self.model, memory[:n], np.array(gains).T * v)
        return new

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """x_hat_i uses the new x_hat_{i+1}."""
        lift_chain(self.model, old, new, dt, 0, self.n)

    def closing(self, memory: Array, e: Array, dt: float) -> Array:
        """k_i r^i e+ at the end of the step, where e+ (1 + sum_i (r dt)^i k_i) = e."""
        n, powers = self.n, np.arange(1, self.n + 1)[:, None]
        rate = np.empty_like(memory)
        self.gain_rate(memory, e, rate, driven_only=True)
        if isinstance(self.gain, HomogeneousGain) and self.gain.power != 0.0:
            v = self.gain.closing(self.k, e, dt)
        else:
            r: Any = getattr(self.gain, "ell", None) or self.gain.moving(
                memory[self.gain_at or 0], e
            )
            of = self.k[:, None] * r**powers
            v = of * e / (1.0 + np.sum(dt**powers * of, axis=0))
        rate[:n] = in_unit(self.model, memory[:n], v)
        return rate

    def decayed(self, memory: Array, y: Array, u: Array | None, t: float, dt: float) -> Array:
        """flow(x_hat) + G c: Karafyllis, Kravaris (2009)."""
        own, kept = memory[:-1], memory[-1]
        n, powers = self.n, np.arange(1, self.n + 1)
        c = np.where(np.isfinite(y), self.innovation(own, y), kept)
        own = self.jumped(own, np.where(np.isfinite(y), y, own[0] + kept))
        new = moving.moved(self, self.motion, own, u, t, dt)
        r: Any = getattr(self.gain, "ell", None) or self.gain.moving(own[self.gain_at or 0], c)
        v = self.shaped(own, c)
        each = [decaying_gains(self.k * g**powers, dt) for g in np.broadcast_to(r, c.shape)]
        new[:n] += in_unit(self.model, own[:n], np.array([gains for gains, _ in each]).T * v)
        self.gain_moved(own, c, new, dt, True)
        self.clamp(new)
        return np.vstack([new, c - v + v * np.array([left for _, left in each])])


def driven(gain: GainLaw, r: Array, e: Array, n: int) -> Array:
    """What of a gain's rate is due to the innovation."""
    return gain.rate(r, e, n) - gain.rate(r, np.zeros_like(e), n)


def lift_chain(model: Plant, old: Array, new: Array, dt: float, first: int, n: int) -> None:
    """For rows first .. first+n-1, bottom up: x_i += dt (x_{i+1}(new) - x_{i+1}(old)), each by
    its slope.
    """
    slopes = model.slopes(old[first : first + n])
    for i in range(first + n - 2, first - 1, -1):
        new[i] += dt * ((new[i + 1] - old[i + 1]) * slopes[i + 1 - first])


class LowPowerObserver(ContinuousLaw):
    """The low-power observer: Astolfi et al., eq. (5): powers of ell up to 2, whatever n.

    Memory: x_hat (n), eta (n-1), and r if the gain moves.  A known triangular part f enters row i
    of x_hat as f_i and row i of eta, which estimates x_{i+1}, as f_{i+1}.
    """

    placed = True

    def __init__(self, spec: Spec, chain: Chain | None = None) -> None:
        n = self.n = _order(spec)
        if n < 2:
            raise fail("observer.n", n, ">= 2 for a low-power law", "use the standard observer")
        self.alpha = vector(member(spec, "alpha", "observer"), "observer.alpha", n)
        self.beta = vector(member(spec, "beta", "observer"), "observer.beta", n - 1)
        if not is_hurwitz(low_power_polynomial(self.alpha, self.beta)):
            raise fail(
                "observer.alpha, observer.beta",
                (self.alpha.tolist(), self.beta.tolist()),
                "such that M_n is Hurwitz (low-power stability requirement)",
                "take low_power_coefficients_from_poles",
            )
        self.gain: GainLaw = gain_from(member(spec, "gain", "observer"), n)
        self.model = _model(spec, n, chain)
        self.may_be_undefined = self.model.kind == "own"
        self.n_u = self.model.n_u
        self.method, self.motion = _method(spec), moving.motion_from(spec, "observer")
        self.driven_by(2 * n - 1, alone=False)
        self._injections: tuple[Array, Array] | None = None
        if isinstance(self.gain, ConstantGain):
            self._injections = self._scaled(self.gain.ell)
        self.wear(spec)

    def _scaled(self, g: float | Array) -> tuple[Array, Array]:
        """alpha_i ell and beta_i ell^2, as columns."""
        return self.alpha[:, None] * g, self.beta[:, None] * (g * g)

    def _above(self, x_hat: Array, eta: Array, u: Array | None, t: float) -> Array:
        """eta as it enters the rates of x_1 ... x_{n-1}."""
        last = self.model.enters(x_hat, eta[-1], u, t)
        return np.concatenate((eta[:-1], last[None]))

    def limit(self, eta: Array) -> Array:
        """What of eta is passed on: all of it; eq. (11) saturates here."""
        return eta

    def rate(self, memory: Array, e: Array, u: Array | None, t: float) -> Array:
        """(5a), (5b); with ``limit`` (11a), (11b)."""
        n = self.n
        x_hat, eta = memory[:n], memory[n : 2 * n - 1]
        passed = self.limit(eta)
        alpha_ell, beta_ell2 = self._injections or self._scaled(
            self.gain.moving(memory[self.gain_at or 0], e)
        )
        e_all = np.empty_like(x_hat)
        e_all[0] = self.shaped(memory, e)  # e_1 = y - x_hat_1
        np.subtract(passed, x_hat[1:], out=e_all[1:])  # e_i = eta_{i-1} - x_hat_i
        rate = np.empty_like(memory)
        x_rate, eta_rate = rate[:n], rate[n : 2 * n - 1]
        np.multiply(alpha_ell, e_all, out=x_rate)
        x_rate[:-1] += self._above(x_hat, eta, u, t)  # x_hat_i' = eta_i + alpha_i ell e_i
        eta_rate[:] = in_unit(self.model, x_hat, beta_ell2 * e_all[:-1])
        # eta_i' = eta_{i+1} + beta_i ell^2 e_i
        eta_rate[:-1] += self._above(x_hat, passed, u, t)[1:]
        f = self.model.known(x_hat, u, t)
        if f is not None:
            x_rate += f  # x_hat_n' = phi_s + alpha_n ell e_n
            eta_rate += f[1:]  # eta_{n-1}' = phi_s + beta_{n-1} ell^2 e_{n-1}
        self.gain_rate(memory, e, rate)
        return rate

    def injection(self, memory: Array, e: Array) -> Array:
        """The first block's alpha_1 ell e and beta_1 ell^2 e; of r what its law has of e."""
        n, rate = self.n, np.zeros_like(memory)
        alpha_ell, beta_ell2 = self._injections or self._scaled(
            self.gain.moving(memory[self.gain_at or 0], e)
        )
        v = self.shaped(memory, e)
        rate[0] = alpha_ell[0] * v
        first = np.zeros_like(memory[n : 2 * n - 1])
        first[0] = beta_ell2[0] * v
        rate[n : 2 * n - 1] = in_unit(self.model, memory[:n], first)
        self.gain_rate(memory, e, rate, driven_only=True)
        return rate

    def kick(self, memory: Array, e: Array) -> Array:
        """alpha_i ell e_i and beta_i ell^2 e_i of all blocks."""
        n, rate = self.n, self.injection(memory, e)
        x_hat, eta = memory[:n], memory[n : 2 * n - 1]
        alpha_ell, beta_ell2 = self._injections or self._scaled(
            self.gain.moving(memory[self.gain_at or 0], e)
        )
        e_all = np.vstack([np.asarray(self.shaped(memory, e))[None], self.limit(eta) - x_hat[1:]])
        rate[:n] = alpha_ell * e_all
        rate[n : 2 * n - 1] = in_unit(self.model, x_hat, beta_ell2 * e_all[:-1])
        return rate

    @property
    def n_terms(self) -> int:
        """Those of the estimate, and one for the unknown."""
        return self.n + self.model.carries

    def terms(self, memory: Array, u: Array | None, t: float) -> Array:
        """(0, ..., 0, phi) of the estimate; with an unknown, what the limited eta of it enters, and
        below all what eta itself does.
        """
        n, x_hat, eta = self.n, memory[: self.n], memory[self.n : 2 * self.n - 1]
        f = known_terms(self.model, x_hat, u, t)
        if not self.model.carries:
            return f
        limited, own = (self.model.enters(x_hat, of[-1], u, t) for of in (self.limit(eta), eta))
        f[n - 2] += limited
        return np.vstack([f, own[None]])

    def chain(self, delta: Array) -> Array:
        """Of the estimate; nothing below it."""
        rate = super().chain(delta[: self.n])
        return np.vstack([rate, np.zeros_like(delta[self.n :])])

    def shifted(self, memory: Array, delta: Array) -> Array:
        """x_hat, and eta, which estimates x_2 ... x_n."""
        n = self.n
        x_hat, eta = memory[:n] + delta[:n], memory[n : 2 * n - 1] + delta[1:n]
        return np.vstack([x_hat, eta, memory[2 * n - 1 :]])

    def flow(self, memory: Array, f: Array, dt: float) -> Array:
        """Every block along the chain, by its own eta and by what those above pass on."""
        n, new = self.n, memory.copy()
        eta = memory[n : 2 * n - 1]
        own, passed = eta.copy(), self.limit(eta).copy()
        if self.model.carries:
            own[-1], passed[-1] = f[-1], f[n - 2]
        moved = ahead(np.vstack([passed, f[n - 1 : n]]), dt)
        new[:n] += moved
        new[: n - 1] += dt * (own - passed)
        new[n : 2 * n - 1] += moved[1:]
        self.gain_moved(memory, np.zeros_like(memory[0]), new, dt, False)
        return new

    def place(self, memory: Array, e: Array, dt: float) -> Array:
        """Block i by a_i e_i and b_i e_i; what asks for more than its level by a'_i and b'_i."""
        n, new = self.n, memory.copy()
        x_hat, eta = memory[:n], memory[n : 2 * n - 1]
        v = self.shaped(memory, e)
        e_all = np.vstack([np.asarray(v)[None], self.limit(eta) - x_hat[1:]])
        if isinstance(self.gain, ConstantGain):
            r = np.array([self.gain.ell])
        else:
            r = self.gain.moving(memory[self.gain_at or 0], e)
        parts = [low_power_gains(self.alpha * g, self.beta * g * g, dt, self.method) for g in r]
        a, b, a_alone, b_alone = (np.array(part).T for part in zip(*parts, strict=True))
        b, b_alone = (
            in_unit(self.model, x_hat, np.broadcast_to(of, eta.shape)) for of in (b, b_alone)
        )
        asked = b_alone * e_all[:-1]
        beyond = (asked - self.limit(asked)) / b_alone
        within = e_all[:-1] - beyond
        new[: n - 1] += a[:-1] * within + a_alone[:-1] * beyond
        new[n - 1] += a[-1] * e_all[-1]
        new[n : 2 * n - 1] += b * within + b_alone * beyond
        self.gain_moved(memory, e, new, dt, True)
        return new

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """eta_i uses the new eta_{i+1}, then x_hat_i the new eta_i."""
        n = self.n
        slope = np.ones_like(old[: n - 1])
        slope[-1] = self.model.slope(old[:n])
        for i in range(2 * n - 3, n - 1, -1):
            moved = self._passed(new, i + 1) - self._passed(old, i + 1)
            new[i] += dt * (moved * slope[i + 1 - n])
        for i in range(n - 1):
            new[i] += dt * ((new[n + i] - old[n + i]) * slope[i])

    def _passed(self, memory: Array, row: int) -> Array:
        return memory[row]


class FilteredObserver(StandardObserver):
    """The standard law behind a low-pass filter of its innovation, of m states eta.

    Tréangle, Farza, M'Saad (2019); Astolfi, Zaccarian, Jungers (2021), scaled so that eta has the
    unit of y and e passes c_m/(s^m + c_1 s^(m-1) + ... + c_m), s in units of the gain.
    Memory: x_hat (n), eta (m), and r if the gain moves.
    """

    placed = False

    def __init__(self, spec: Spec, chain: Chain | None = None) -> None:
        m = integer(
            member(spec, "filters", "observer"), "observer.filters", least=1, most=MAX_ORDER
        )
        c = self.c = vector(member(spec, "c", "observer"), "observer.c", m)
        n = _order(spec)
        k = vector(member(spec, "k", "observer"), "observer.k", n)
        if not is_hurwitz(np.concatenate([c, c[-1] * k])):
            raise fail("observer.c, observer.k", (c.tolist(), k.tolist()), "Hurwitz", "use poles")
        self.n, self.k = n, k
        self.gain = gain_from(member(spec, "gain", "observer"), n + m)
        self.model = _model(spec, n, chain)
        self.may_be_undefined, self.n_u = self.model.kind == "own", self.model.n_u
        self.method, self.motion = _method(spec), moving.motion_from(spec, "observer")
        self.driven_by(n + m)
        if isinstance(self.gain, ConstantGain):
            self._injection = (k * self.gain.ell ** np.arange(1, n + 1))[:, None]
        self.wear(spec)

    @property
    def _ell(self) -> float:
        """The part of the gain that is fixed: it scales the filter's states."""
        return float(
            getattr(self.gain, "ell", getattr(self.gain, "rho", getattr(self.gain, "fast", 1.0)))
        )

    def _w(self, eta: Array) -> Array:
        """The filter's states in companion form: w_i' = w_(i+1) - c_i g^i w_1."""
        m, ell = len(self.c), self._ell
        return -eta / (self.c[-1] * ell ** (m - np.arange(m))[:, None])

    def _eta(self, w: Array) -> Array:
        m, ell = len(self.c), self._ell
        return -w * (self.c[-1] * ell ** (m - np.arange(m))[:, None])

    def kick(self, memory: Array, e: Array) -> Array:
        """What w_1 injects: -c_i g^i w_1, and k_j c_m g^(m+j) of its opposite."""
        n, m = self.n, len(self.c)
        w = self._w(memory[n : n + m])
        seen = -w[0] if isinstance(self.gain, HomogeneousGain) else e
        g: Any = self._ell if isinstance(self.gain, ConstantGain) else self.acting(memory, seen)
        polynomial = np.append(self.c, self.c[-1] * self.k)[:, None]
        injected = polynomial * g ** np.arange(1, n + m + 1)[:, None] * -w[0]
        rate = np.zeros_like(memory)
        rate[:n] = in_unit(self.model, memory[:n], injected[m:])
        rate[n : n + m] = self._eta(injected[:m])
        self.gain_rate(memory, e, rate, driven_only=True)
        return rate

    def rate(self, memory: Array, e: Array, u: Array | None, t: float) -> Array:
        """The chain w, x_hat, into which y - x_hat_1 comes, with the kick of w_1."""
        n, m, rate = self.n, len(self.c), self.kick(memory, e)
        w = self._w(memory[n : n + m])
        into = np.concatenate([w[1:], -np.asarray(self.shaped(memory, e))[None]])
        rate[n : n + m] += self._eta(into)
        rate[:n] += drift(self.model, memory[:n], u, t)
        self.gain_rate(memory, e, rate)
        return rate

    def injection(self, memory: Array, e: Array) -> Array:
        """e into the filter; of r what its law has of e."""
        n, m, rate = self.n, len(self.c), np.zeros_like(memory)
        into = np.zeros((m, memory.shape[1]))
        into[-1] = -self.shaped(memory, e)
        rate[n : n + m] = self._eta(into)
        self.gain_rate(memory, e, rate, driven_only=True)
        return rate

    def flow(self, memory: Array, f: Array, dt: float) -> Array:
        """w, x_hat along one chain, the sample of the step held; without one y is x_hat_1."""
        n, m = self.n, len(self.c)
        new = super().flow(memory, f, dt)
        y = np.full(memory.shape[1], np.nan) if self.held_y is None else self.held_y
        present = np.isfinite(y)
        rates = self.chain(memory[:n]) + f
        w = self._w(memory[n : n + m])
        e = np.asarray(self.shaped(memory, self.innovation(memory, y)))
        behind = np.concatenate([w[1:], -e[None], np.where(present, rates, 0.0)])
        new[n : n + m] = self._eta(w + ahead(behind, dt)[:m])
        return new

    def shifted(self, memory: Array, delta: Array) -> Array:
        """x_hat alone."""
        return np.vstack([memory[: self.n] + delta, memory[self.n :]])


class LimitedGainObserver(ContinuousLaw):
    """The observer of limited gain power: Astolfi, Marconi (2015); triangular: Wang et al. (2017).

    p_i' = q_i + f_i + alpha_i g e_i, q_i' = sat(q_(i+1)) + f_(i+1) + beta_i g^2 e_i, i = 1 ... n-1,
    e_1 = y - p_1, e_i = sat(q_(i-1)) - p_i; f takes x_hat = (p_1 ... p_(n-1), q_(n-1)).
    Memory: x_hat (n), q_1 ... q_(n-2), and r if the gain moves.
    """

    def __init__(self, spec: Spec, chain: Chain | None = None) -> None:
        n = self.n = _order(spec)
        if n < 2:
            raise fail("observer.n", n, ">= 2", "use the standard observer")
        alpha = vector(member(spec, "alpha", "observer"), "observer.alpha", n - 1)
        beta = vector(member(spec, "beta", "observer"), "observer.beta", n - 1)
        sound = min(*alpha, *beta) > 0.0
        if not (sound and is_hurwitz(low_power_polynomial(np.append(alpha, 1.0), beta))):
            given = (alpha.tolist(), beta.tolist())
            raise fail("observer.alpha, observer.beta", given, "> 0 and Hurwitz", "use poles")
        self.alpha, self.beta = alpha[:, None], beta[:, None]
        self.gain: GainLaw = gain_from(member(spec, "gain", "observer"), n)
        self.model = _model(spec, n, chain)
        self.may_be_undefined, self.n_u = self.model.kind == "own", self.model.n_u
        self.method, self.motion = _method(spec), moving.motion_from(spec, "observer")
        self.limit = limit_from(spec, n)
        self.driven_by(2 * n - 2, alone=False)
        self.wear(spec)

    def _parts(self, memory: Array) -> tuple[Array, Array, Array]:
        """p (n - 1), q (n - 1) and x_hat (n)."""
        n = self.n
        return memory[: n - 1], np.vstack([memory[n : 2 * n - 2], memory[n - 1 : n]]), memory[:n]

    def _whole(self, p: Array, q: Array, memory: Array) -> Array:
        """A memory of them, its other entries 0."""
        rest = np.zeros_like(memory[2 * self.n - 2 :])
        return np.vstack([p, q[-1:], q[:-1], rest])

    def _gain(self, memory: Array, e: Array) -> Any:
        acting = self.acting(memory, e)
        return self.gain.ell if isinstance(self.gain, ConstantGain) else acting

    def rate(self, memory: Array, e: Array, u: Array | None, t: float) -> Array:
        """Of every block, and of r."""
        p, q, x_hat = self._parts(memory)
        g, f, passed = self._gain(memory, e), known_terms(self.model, x_hat, u, t), self.limit(q)
        own, coming = q.copy(), passed[1:].copy()
        own[-1] = self.model.enters(x_hat, q[-1], u, t)
        if len(coming):
            coming[-1] = self.model.enters(x_hat, passed[-1], u, t)
        errors = np.vstack([np.asarray(self.shaped(memory, e))[None], passed[:-1] - p[1:]])
        p_rate = own + f[:-1] + self.alpha * g * errors
        q_rate = in_unit(self.model, x_hat, self.beta * g * g * errors) + f[1:]
        q_rate[:-1] += coming
        rate = self._whole(p_rate, q_rate, memory)
        self.gain_rate(memory, e, rate)
        return rate

    def injection(self, memory: Array, e: Array) -> Array:
        """Into the first block; of r what its law has of e."""
        p, q, x_hat = self._parts(memory)
        g, v = self._gain(memory, e), self.shaped(memory, e)
        p_rate, q_rate = np.zeros_like(p), np.zeros_like(q)
        p_rate[0], q_rate[0] = self.alpha[0] * g * v, self.beta[0] * g * g * v
        rate = self._whole(p_rate, in_unit(self.model, x_hat, q_rate), memory)
        self.gain_rate(memory, e, rate, driven_only=True)
        return rate

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """q_i uses the new q_(i+1), then p_i the new q_i."""
        n = self.n
        (_, before, x_hat), (p, after, _) = self._parts(old), self._parts(new)
        slope = np.ones_like(before)
        slope[-1] = self.model.slope(x_hat)
        for i in range(n - 2, 0, -1):
            moved = (self.limit(after) - self.limit(before))[i]
            after[i - 1] += dt * moved * slope[i]
        p += dt * (after - before) * slope
        new[n - 1], new[n : 2 * n - 2] = after[-1], after[:-1]


class CascadeObserver(ContinuousLaw):
    """The cascade of Khalil, Automatica 80 (2017) 110: a differentiator, then a filter a state.

    x_1' = xb_2 + k_1 g e, xb_2' = k_2 g^2 e, w_i' = beta_i g (x_(i-1) - w_i), i = 3 ... n;
    shown x_2 = sat(xb_2), x_i = sat(beta_i g (x_(i-1) - w_i)).
    Memory: x_hat (n), xb_2, w_3 ... w_n, and r if the gain moves.
    """

    def __init__(self, spec: Spec, chain: Chain | None = None) -> None:
        n = self.n = _order(spec)
        if n < 2:
            raise fail("observer.n", n, ">= 2", "use the standard observer")
        self.k = vector(member(spec, "k", "observer"), "observer.k", 2)
        beta = spec.get("beta", []) if n == 2 else member(spec, "beta", "observer")
        self.beta = vector(beta, "observer.beta", n - 2)
        if not min(*self.k, *self.beta) > 0.0:
            given = (self.k.tolist(), self.beta.tolist())
            raise fail("observer.k, observer.beta", given, "> 0", "use poles")
        self.gain: GainLaw = gain_from(member(spec, "gain", "observer"), n)
        if chain is not None or spec.get("model", {"kind": "none"})["kind"] != "none":
            raise fail("observer.model", spec.get("model"), "left out", "a cascade knows none")
        self.model = _model(spec, n, None)
        self.method, self.motion = _method(spec), moving.motion_from(spec, "observer")
        self.limit = limit_from(spec, n)
        self.driven_by(2 * n - 1, alone=False)
        self.wear(spec)

    def _speed(self, memory: Array) -> Any:
        """The gain of the filters."""
        if isinstance(self.gain, (ConstantGain, SwitchedGain)):
            return self.gain.ell if isinstance(self.gain, ConstantGain) else self.gain.fast
        return self.gain.moving(memory[self.gain_at or 0], np.zeros_like(memory[0]))

    def shown(self, memory: Array) -> Array:
        """x_2 ... x_n."""
        n, speed, x = self.n, self._speed(memory), np.empty_like(memory[1 : self.n])
        for i in range(n - 1):
            w = memory[n + i]
            x[i] = w if i == 0 else self.beta[i - 1] * speed * (x[i - 1] - w)
            x[i] = self.limit(x)[i]
        return x

    def rate(self, memory: Array, e: Array, u: Array | None, t: float) -> Array:
        """Of the differentiator and the filters, and of r."""
        n, rate = self.n, self.injection(memory, e)
        rate[0] += memory[n]
        behind = self.shown(memory)[:-1] - memory[n + 1 : 2 * n - 1]
        rate[n + 1 : 2 * n - 1] = self.beta[:, None] * self._speed(memory) * behind
        self.gain_rate(memory, e, rate)
        return rate

    def injection(self, memory: Array, e: Array) -> Array:
        """Into the differentiator; of r what its law has of e."""
        rate, v, acting = np.zeros_like(memory), self.shaped(memory, e), self.acting(memory, e)
        g: Any = self.gain.ell if isinstance(self.gain, ConstantGain) else acting
        rate[0], rate[self.n] = self.k[0] * g * v, self.k[1] * g * g * v
        self.gain_rate(memory, e, rate, driven_only=True)
        return rate

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """x_1 uses the new xb_2."""
        new[0] += dt * (new[self.n] - old[self.n])

    def clamp(self, memory: Array) -> None:
        """And the estimates are shown anew."""
        super().clamp(memory)
        memory[1 : self.n] = self.shown(memory)


class ReducedChainObserver(ContinuousLaw):
    """The reduced-order observer of a chain: Esfandiari, Khalil (1992).

    x_1 = y, x_(i+1) = eta_i + k_i ell^i y, eta_i' = x_(i+2) + f_(i+1) - k_i ell^i (x_2 + f_1),
    without eta: between samples the chain alone, at a sample x_(i+1) += k_i ell^i e, x_1 += e.
    Memory: x_hat (n).
    """

    def __init__(self, spec: Spec, chain: Chain | None = None) -> None:
        n = self.n = self.memory_len = _order(spec)
        if n < 2:
            raise fail("observer.n", n, ">= 2", "use the standard observer")
        k = _coefficients(spec, n - 1)
        gain = gain_from(member(spec, "gain", "observer"), n)
        if not isinstance(gain, ConstantGain):
            raise fail("observer.gain.law", spec["gain"]["law"], "'constant'", "give a number")
        self.gain = gain
        self.jump = np.append(1.0, k)[:, None] * gain.ell ** np.arange(n)[:, None]
        self.model = _model(spec, n, chain)
        self.may_be_undefined, self.n_u = self.model.kind == "own", self.model.n_u
        self.method, self.motion = _method(spec), moving.motion_from(spec, "observer")

    def jumped(self, memory: Array, y: Array) -> Array:
        """The memory after a sample."""
        e = self.innovation(memory, y)
        return memory + in_unit(self.model, memory, self.jump * e)

    def rate(self, memory: Array, e: Array, u: Array | None, t: float) -> Array:
        """The chain's."""
        return drift(self.model, memory, u, t)

    def injection(self, memory: Array, e: Array) -> Array:
        """Nothing: a sample acts at once."""
        return np.zeros_like(memory)

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """x_hat_i uses the new x_hat_{i+1}."""
        lift_chain(self.model, old, new, dt, 0, self.n)


def limit_from(spec: Spec, n: int) -> Callable[[Array], Array]:
    """The saturation of states 2 ... n, (n - 1, runs), that a spec gives or leaves out."""
    if "saturation" not in spec and "clip" not in spec:
        return lambda q: q
    levels = vector(member(spec, "saturation", "observer"), "observer.saturation", n - 1)
    if not np.all(levels > 0.0):
        raise fail("observer.saturation", levels.tolist(), "> 0", "bound each |x_i| from above")
    clip = choice(spec.get("clip", "hard"), "observer.clip", ("hard", "smooth"))
    return lambda q: saturate(q, levels[:, None], clip)


SAMPLED = "sampled"


def drift(model: Plant, x: Array, u: Array | None, t: float) -> Array:
    """A x + f_hat, the rate of a chain without a sample."""
    rate = np.concatenate((above(model, x, u, t), np.zeros_like(x[:1])))
    f = model.known(x, u, t)
    return rate if f is None else rate + f


def _noises(spec: Spec, n: int) -> tuple[Array, float, Array]:
    """Q, R and P(0) of a spec."""
    packed = n * (n + 1) // 2
    q, p0 = (
        covariance.square(vector(member(spec, name, "observer"), f"observer.{name}", packed))
        for name in ("Q", "P0")
    )
    (r,) = vector(member(spec, "R", "observer"), "observer.R", 1)
    q = covariance.checked(q, "Q", definite=False)
    p0 = covariance.checked(p0, "P0", definite=True)
    return q, number(r, "observer.R", above=0.0), p0


class HighGainEkf(ContinuousLaw):
    """The high-gain extended Kalman filter, Deza, Busvelle, Gauthier, Rakotopara (1992).

    x_hat' = A x_hat + f_hat + P C' theta/R e, P' = J P + P J' + Q_theta - P C' theta/R C P.
    Memory: x_hat (n), P as L and D of L D L' (n (n + 1)/2), and r if the gain moves.
    """

    def __init__(self, spec: Spec, chain: Chain | None = None) -> None:
        self.n = n = _order(spec)
        self.q, self.r, self.p0 = _noises(spec, n)
        self.gain = gain_from(member(spec, "gain", "observer"), n)
        if not isinstance(self.gain, ConstantGain | AdaptiveGain):
            allowed = "constant, adaptive or dead-zone"
            raise fail("observer.gain.law", spec["gain"]["law"], allowed, "choose one of them")
        self.model = _model(spec, n, chain)
        self.may_be_undefined, self.n_u = self.model.kind == "own", self.model.n_u
        self.method = _method(spec)
        self.rows = n + n * (n + 1) // 2
        self.memory_len = self.rows + self.gain.moves
        self.gain_rows = (self.rows,) if self.gain.moves else ()
        self.gain_at = self.rows if self.gain.moves else None

    def initial(self) -> Array:
        memory = super().initial()
        memory[self.n : self.rows] = covariance.held(self.p0[None])[:, 0]
        return memory

    def _theta(self, memory: Array) -> Array:
        if isinstance(self.gain, ConstantGain):
            return np.full(memory.shape[1], self.gain.ell)
        return memory[self.rows]

    def innovation(self, memory: Array, y: Array) -> Array:
        """e, and 1 where there is a sample, else 0: (2, runs)."""
        return np.stack([innovation(y, memory[0]), np.isfinite(y) * np.ones_like(memory[0])])

    def rate(self, memory: Array, e: Array, u: Array | None, t: float) -> Array:
        """(1), (2)."""
        n = self.n
        x_hat, theta = memory[:n], self._theta(memory)

        def free(x: Array, s: float) -> Array:
            return drift(self.model, x, u, s)

        p = covariance.covariance(memory[n : self.rows], n)
        jp = covariance.slopes(free, x_hat, t) @ p
        powers = theta[:, None] ** (np.arange(n) + 0.5)
        moved = jp + np.swapaxes(jp, 1, 2) + powers[:, :, None] * powers[:, None, :] * self.q
        rate = np.zeros_like(memory)
        rate[:n] = free(x_hat, t)
        rate[n : self.rows] = covariance.held_rate(memory[n : self.rows], moved)
        if self.gain.moves:
            rate[-1] = self.gain.rate(memory[-1], np.zeros_like(e[0]), n)
        return rate + self.injection(memory, e)

    def injection(self, memory: Array, e: Array) -> Array:
        """P C' theta/R e, and -P C' theta/R C P where there is a sample."""
        n, weight = self.n, self._theta(memory) / self.r
        p = covariance.covariance(memory[n : self.rows], n)
        down = -p[:, :, :1] * p[:, :1, :] * (weight * e[1])[:, None, None]
        rate = np.zeros_like(memory)
        rate[:n] = p[:, :, 0].T * weight * e[0]
        rate[n : self.rows] = covariance.held_rate(memory[n : self.rows], down)
        if self.gain.moves:
            rate[-1] = driven(self.gain, memory[-1], e[0], n)
        return rate

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """x_hat_i uses the new x_hat_{i+1}."""
        lift_chain(self.model, old, new, dt, 0, self.n)


class SampledEkf(Law):
    """The high-gain EKF of sampled data, of one chain or of all chains of a model.

    Between samples x_hat and P by the model; K = P C'(C P C' + R/theta)^-1.
    Memory: x_hat (n), P as L and D of L D L' (n (n + 1)/2), of each output the time
    since its last sample used.
    """

    is_current = True

    def __init__(self, specs: list[Spec], model: Plant) -> None:
        orders = [_order(spec) for spec in specs]
        noises = [_noises(spec, order) for spec, order in zip(specs, orders, strict=True)]
        gains = [gain_from(member(spec, "gain", "observer"), 2) for spec in specs]
        theta = [gain.ell for gain in gains if isinstance(gain, ConstantGain)]
        timings = [spec.get("timing", "predictor") for spec in specs]
        if len(theta) < len(specs):
            raise fail("observer.gain", "a moving gain", "constant", "choose another method")
        if any(timing != "current" for timing in timings):
            raise fail("observer.timing", timings, "'current'", "choose another method")
        self.model, self.n, self.n_y = model, sum(orders), len(orders)
        self.n_u, self.may_be_undefined = model.n_u, model.kind == "own"
        self.first = np.cumsum([0, *orders[:-1]])
        self.rows = self.n + self.n * (self.n + 1) // 2
        self.memory_len = self.rows + self.n_y
        self.a = covariance.shift(orders)
        q, self.p0 = np.zeros_like(self.a), np.zeros_like(self.a)
        for first, order, (one, _, p0) in zip(self.first, orders, noises, strict=True):
            place = slice(first, first + order)
            q[place, place], self.p0[place, place] = one, p0
        self.q = covariance.scaled(q, theta, orders)
        self.r = np.array([r / g for (_, r, _), g in zip(noises, theta, strict=True)])

    @property
    def signals(self) -> int:
        """All but the time; of several outputs the estimates, as of other chains."""
        return self.rows if self.n_y == 1 else self.n

    def initial(self) -> Array:
        memory = np.zeros(self.memory_len)
        memory[self.n : self.rows] = covariance.held(self.p0[None])[:, 0]
        return memory

    def residual(self, memory: Array, y: Array, u: Array | None, t: float) -> Array:
        """y_q - x_hat of the first state of chain q."""
        e = np.reshape(y, (self.n_y, -1)) - memory[self.first]
        return e if self.n_y > 1 else e[0]

    def correct(self, memory: Array, y: Array, t: float) -> Array:
        """By the samples that there are; nothing for no time."""
        new, n = memory.copy(), self.n
        y = np.reshape(y, (self.n_y, -1))
        present = np.isfinite(y) & (memory[self.rows :] > 0.0)
        for given in np.unique(present, axis=1).T:
            some = np.all(present == given[:, None], axis=0)
            if given.any():
                rows = self.first[given]
                p = covariance.covariance(memory[n : self.rows, some], n)
                e = y[given][:, some] - memory[rows][:, some]
                x_hat, p = covariance.corrected(memory[:n, some], p, e, rows, self.r[given])
                new[:n, some], new[n : self.rows, some] = x_hat, covariance.held(p)
        new[self.rows :] = np.where(np.isfinite(y), 0.0, memory[self.rows :])
        return new

    def predict(self, memory: Array, u: Array | None, t: float, dt: float) -> Array:
        """Without a sample."""

        def free(x: Array, s: float) -> Array:
            if isinstance(self.model, Own) and self.model.form == "chains":
                f = self.a @ x
                f[[*(self.first[1:] - 1), -1]] += self.model.values(x, u, s)
                return f
            return drift(self.model, x, u, s)

        a = np.repeat(self.a[None], memory.shape[1], axis=0)
        if self.n_y == 1 and self.n > 1:
            a[:, -2, -1] = self.model.slope(memory[: self.n])
        n = self.n
        p = covariance.covariance(memory[n : self.rows], n)
        x_hat, p = covariance.moved(free, a, self.q, memory[:n], p, t, dt)
        return np.vstack([x_hat, covariance.held(p), memory[self.rows :] + dt])


class AdaptiveEkf(SampledEkf):
    """The EKF of sampled data whose theta moves by the innovation of a window of samples.

    Boizot, Busvelle, Gauthier, Automatica 46 (2010) 1483. Memory: x_hat (n), P as L and D, theta,
    runs of the model from the last W estimates (n W), the innovation of each (W, -1 before it
    begins), the time since the last sample used.
    """

    def __init__(self, spec: Spec, model: Plant) -> None:
        super().__init__([{**spec, "gain": {"law": "constant", "ell": 1.0}}], model)
        gain = member(spec, "gain", "observer")
        names = ("most", "rise", "fall", "slope", "threshold")
        known(gain, "gain", ("law", "samples", *names))
        given = (number(member(gain, name, "gain"), f"gain.{name}", above=0.0) for name in names)
        self.most, self.rise, self.fall, self.slope, self.threshold = given
        self.window = integer(member(gain, "samples", "gain"), "gain.samples", least=2)
        self.runs = slice(self.rows + 1, self.rows + 1 + self.n * self.window)
        self.parts = slice(self.runs.stop, self.runs.stop + self.window)
        self.memory_len = self.parts.stop + 1

    @property
    def signals(self) -> int:
        """All but the time."""
        return self.memory_len - 1

    def initial(self) -> Array:
        memory = super().initial()
        memory[self.rows], memory[self.parts] = 1.0, -1.0
        return memory

    def rate_of(self, theta: Array, innovation: Array) -> Array:
        """dtheta/dt."""
        mu = 1.0 / (1.0 + np.exp(-self.slope * (innovation - self.threshold)))
        slow = theta <= self.most / 2.0
        rise = np.where(slow, theta**2, (theta - self.most) ** 2) / self.rise
        return np.asarray(mu * rise + (1.0 - mu) * self.fall * (1.0 - theta))

    def correct(self, memory: Array, y: Array, t: float) -> Array:
        """(1) of the window, then theta, then the filter; the window goes on by a run."""
        new, n, w = memory.copy(), self.n, self.window
        y = np.reshape(y, -1)
        present, elapsed = np.isfinite(y), memory[-1]
        taken = present & (elapsed > 0.0)
        runs = memory[self.runs].reshape(w, n, -1).copy()
        parts = memory[self.parts].copy()
        error = np.where(present, y - runs[:, 0], 0.0)
        begun = parts >= 0.0
        parts = np.where(begun, parts + np.where(present, elapsed, 0.0) * error**2, parts)
        innovation = np.maximum(parts[0], 0.0)

        passed = np.where(present, elapsed, 0.0)

        def rate(s: float, theta: Array) -> Array:  # over the time that has passed, each its own
            return passed * self.rate_of(theta, innovation)

        theta = np.clip(integrate.rk4(rate, 0.0, memory[self.rows], 1.0), 1.0, self.most)
        new[self.rows] = np.where(present, theta, memory[self.rows])
        p = covariance.covariance(memory[n : self.rows], n)
        r, e = self.r[0] / theta, np.where(present, y, 0.0) - memory[0]
        k = p[:, :, 0].T / (p[:, 0, 0] + r)
        left = np.eye(n)[None] - k.T[:, :, None] * np.eye(n)[0]
        p = left @ p @ np.swapaxes(left, 1, 2) + r[:, None, None] * k.T[:, :, None] * k.T[:, None]
        new[:n] = np.where(taken, memory[:n] + k * e, memory[:n])
        new[n : self.rows] = np.where(taken, covariance.held(p), memory[n : self.rows])
        later = np.concatenate((runs[1:], new[None, :n]))
        runs = np.where(taken, later, runs)
        parts = np.where(taken, np.concatenate((parts[1:], np.zeros_like(parts[:1]))), parts)
        begins = present & (parts < 0.0)
        runs = np.where(begins[:, None], new[None, :n], runs)
        new[self.runs] = runs.reshape(n * w, -1)
        new[self.parts] = np.where(begins, 0.0, parts)
        new[-1] = np.where(present, 0.0, elapsed)
        return new

    def predict(self, memory: Array, u: Array | None, t: float, dt: float) -> Array:
        """The filter at theta, and each run by the model."""
        n, new = self.n, memory.copy()

        def free(x: Array, s: float) -> Array:
            return drift(self.model, x, u, s)

        a = np.repeat(self.a[None], memory.shape[1], axis=0)
        if n > 1:
            a[:, -2, -1] = self.model.slope(memory[:n])
        powers = memory[self.rows][:, None] ** (np.arange(n) + 0.5)
        q = self.q * powers[:, :, None] * powers[:, None, :]
        p = covariance.covariance(memory[n : self.rows], n)
        new[:n], p = covariance.moved(free, a, q, memory[:n], p, t, dt)
        new[n : self.rows] = covariance.held(p)
        runs, begun = memory[self.runs].reshape(self.window, n, -1), memory[self.parts] >= 0.0
        for j, run in enumerate(runs):
            x = np.where(begun[j], run, memory[:n])
            h = dt / covariance.SUBSTEPS
            for step in range(covariance.SUBSTEPS):
                x = integrate.rk4(lambda s, z: free(z, s), t + step * h, x, h)
            new[self.runs.start + j * n : self.runs.start + (j + 1) * n] = x
        new[-1] = memory[-1] + dt
        return new


class PeakingFreeObserver(LowPowerObserver):
    """The peaking-free low-power observer: Astolfi et al., eq. (11).

    ``saturation`` = [r_2, ..., r_n]: eta_i passes through sat at level r_{i+1}.
    """

    def __init__(self, spec: Spec, chain: Chain | None = None) -> None:
        super().__init__(spec, chain)
        self.levels = vector(
            member(spec, "saturation", "observer"), "observer.saturation", self.n - 1
        )
        if not np.all(self.levels > 0.0):
            raise fail(
                "observer.saturation", self.levels.tolist(), "> 0", "bound each |x_i| from above"
            )
        self.clip = choice(spec.get("clip", "hard"), "observer.clip", ("hard", "smooth"))

    def limit(self, eta: Array) -> Array:
        """sat_{r_{i+1}}(eta_i)."""
        return saturate(eta, self.levels[:, None], self.clip)

    def _passed(self, memory: Array, row: int) -> Array:
        return saturate(memory[row], self.levels[row - self.n], self.clip)


def saturate(s: Array, level: Any, clip: str) -> Array:
    """sat_r(s) = s for |s| <= r; beyond, +-r ("hard"), or +-(r + u/(1+u)), u = |s| - r.

    The second is C1, strictly increasing and bounded by r + 1, as the text of Astolfi et al. asks
    ("Notation"); the first gives their tables.
    """
    if clip == "hard":
        return np.minimum(np.maximum(s, -level), level)
    u = np.maximum(np.abs(s) - level, 0.0)
    return np.where(u > 0.0, np.sign(s) * (level + u / (1.0 + u)), s)


class CollectionObserver(ContinuousLaw):
    """n_obs copies that repel one another: Sanfelice, Praly, eq. (23), for any n.

    Memory: x_hat (n) and r of copy 1, then of copy 2, ...  Nominal gain (24): the mean of the r_i.
    """

    def __init__(self, spec: Spec) -> None:
        self.n = _order(spec)
        self.k = _coefficients(spec, self.n)
        self.k_bar = vector(member(spec, "k_bar", "observer"), "observer.k_bar", self.n)
        self.copies = integer(member(spec, "copies", "observer"), "observer.copies", least=2)
        gain = gain_from(member(spec, "gain", "observer"), 2)
        if not isinstance(gain, AdaptiveGain) or isinstance(gain, DeadZoneGain):
            raise fail(
                "observer.gain.law", spec["gain"]["law"], "'adaptive'", "copies adapt by (6)"
            )
        self.gain = gain
        self.model = _model(spec, self.n, None)
        self.may_be_undefined = self.model.kind == "own"
        self.n_u = self.model.n_u
        self.method, self.motion = _method(spec), moving.motion_from(spec, "observer")
        self.memory_len = self.copies * (self.n + 1)
        self.gain_rows = tuple(range(self.n, self.memory_len, self.n + 1))

    def by_copy(self, memory: Array) -> Array:
        """View of shape (copies, n + 1, runs)."""
        return memory.reshape(self.copies, self.n + 1, -1)

    def innovation(self, memory: Array, y: Array) -> Array:
        """e_i = y - x_hat_{i,1}, shape (copies, runs)."""
        return innovation(y, self.by_copy(memory)[:, 0])

    def injected(self, copies: Array, e: Array) -> Array:
        """k_j r_i^j e_i and the repulsion of (23), with e_i = -(y_hat_i - y): (copies, n, runs)."""
        r = copies[:, self.n]
        scale = r**self.gain.b
        scaled = e / scale
        repulsion = (scaled[:, None] - scaled[None, :]).sum(axis=1)  # sum_l (e_i/r_i^b - e_l/r_l^b)
        rate = np.empty_like(copies[:, : self.n])
        power = r
        for j in range(self.n):
            rate[:, j] = self.k[j] * power * e - self.k_bar[j] * power * scale * repulsion
            power = power * r
        return rate

    def rate(self, memory: Array, e: Array, u: Array | None, t: float) -> Array:
        """(23)."""
        n = self.n
        copies = self.by_copy(memory)
        rate = np.empty_like(copies)
        x = np.moveaxis(copies[:, :n], 1, 0)
        rate[:, :n] = self._in_units(copies, self.injected(copies, e))
        rate[:, : n - 1] += np.moveaxis(above(self.model, x, u, t), 0, 1)
        f = self.model.known(x, u, t)
        if f is not None:
            rate[:, :n] += np.moveaxis(f, 0, 1)
        rate[:, n] = self.gain.rate(copies[:, n], e, n)
        return rate.reshape(memory.shape)

    def injection(self, memory: Array, e: Array) -> Array:
        """The copies' injection and repulsion; of r_i what (6) has of e_i."""
        copies = self.by_copy(memory)
        rate = np.empty_like(copies)
        rate[:, : self.n] = self._in_units(copies, self.injected(copies, e))
        rate[:, self.n] = driven(self.gain, copies[:, self.n], e, self.n)
        return rate.reshape(memory.shape)

    def _in_units(self, copies: Array, correction: Array) -> Array:
        """``in_unit`` of every copy."""
        x, of = (np.moveaxis(part, 1, 0) for part in (copies[:, : self.n], correction))
        return np.moveaxis(in_unit(self.model, x, of), 0, 1)

    def nominal_gain(self, memory: Array) -> Array:
        """r_bar = mean of the r_i, shape (runs,): (24)."""
        return self.by_copy(memory)[:, self.n].sum(axis=0) / self.copies  # (24)

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """The chain of every copy."""
        for i in range(self.copies):
            lift_chain(self.model, old, new, dt, i * (self.n + 1), self.n)

    def check(self, memory: Array) -> None:
        """r >= 1; two copies that start alike would never separate."""
        super().check(memory)
        copies = self.by_copy(memory)
        for i in range(self.copies):
            for j in range(i + 1, self.copies):
                if bool(np.any(np.all(copies[i] == copies[j], axis=0))):
                    raise fail(
                        f"memory0 of copies {i + 1} and {j + 1}",
                        copies[i, :, 0].tolist(),
                        "different",
                        "spread the starts: equal copies never separate",
                    )


class ModifiedObserver(CollectionObserver):
    """The observer with gain r r_bar, beside a collection that yields r_bar: (25).

    Memory: x_hat (n), r, then the collection's memory.
    """

    def __init__(self, spec: Spec) -> None:
        super().__init__(spec)
        self.collection = CollectionObserver(spec)
        self.memory_len = self.n + 1 + self.collection.memory_len
        self.gain_rows = tuple(range(self.n, self.memory_len, self.n + 1))

    def innovation(self, memory: Array, y: Array) -> Array:
        """e of the observer, then of the copies, shape (1 + copies, runs)."""
        return innovation(y, memory[:: self.n + 1])

    def main(self, memory: Array, e: Array) -> Array:
        """k_j (r r_bar)^j e, (n, runs): the injection of (25)."""
        g = memory[self.n] * self.nominal_gain(memory)
        rate = np.empty((self.n, *e.shape))
        power = g
        for j in range(self.n):
            rate[j] = self.k[j] * power * e
            power = power * g
        return in_unit(self.model, memory[: self.n], rate)

    def rate(self, memory: Array, e: Array, u: Array | None, t: float) -> Array:
        """(25) over (23) and (24)."""
        n = self.n
        x_hat = memory[:n]
        rate = np.empty_like(memory)
        rate[:n] = self.main(memory, e[0])
        rate[: n - 1] += above(self.model, x_hat, u, t)
        f = self.model.known(x_hat, u, t)
        if f is not None:
            rate[:n] += f
        rate[n] = self.gain.rate(memory[n], e[0], n)
        rate[n + 1 :] = self.collection.rate(memory[n + 1 :], e[1:], u, t)
        return rate

    def injection(self, memory: Array, e: Array) -> Array:
        """That of (25), and the collection's."""
        n = self.n
        own = [self.main(memory, e[0]), driven(self.gain, memory[n], e[0], n)]
        return np.vstack([*own, self.collection.injection(memory[n + 1 :], e[1:])])

    def nominal_gain(self, memory: Array) -> Array:
        """r_bar of the collection: (24)."""
        return self.collection.nominal_gain(memory[self.n + 1 :])

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """The observer's chain and every copy's."""
        for i in range(self.copies + 1):
            lift_chain(self.model, old, new, dt, i * (self.n + 1), self.n)

    def check(self, memory: Array) -> None:
        """As the collection's; the observer itself may start anywhere."""
        ContinuousLaw.check(self, memory)
        self.collection.check(memory[self.n + 1 :])


class SampledDataObserver(Law):
    """x_hat+ = x_hat + f(x_hat) T + K_T(x_hat, y): Fu, Kang, Li, eq. (5), for Van der Pol (18).

    With mu = epsilon (1 - y^2), l1 = (5 + mu) T gives the error matrix the constant spectrum
    {-2, -3} ("derived"); the paper prints 5 - mu ("printed").  Memory: x_hat (2).
    """

    n = 2
    memory_len = 2

    def __init__(self, spec: Spec) -> None:
        model = plant_from(member(spec, "model", "observer"), "model")
        if not isinstance(model, VanDerPol):
            raise fail("observer.model.kind", model.kind, "'van-der-pol'", "change the model")
        self.model = model
        self.gain = choice(spec.get("gain", "derived"), "observer.gain", ("derived", "printed"))

    def step(self, memory: Array, y: Array, u: Array | None, t: float, dt: float) -> Array:
        """(5)."""
        y = np.where(np.isfinite(y), y, memory[0])  # innovation 0
        epsilon = self.model.epsilon
        x1_hat, x2_hat = memory[0], memory[1]
        mu = epsilon * (1.0 - y * y)
        l1 = (5.0 + mu if self.gain == "derived" else 5.0 - mu) * dt
        l2 = (5.0 - epsilon * (x1_hat + y) * x2_hat + (5.0 + mu) * mu) * dt
        e = y - x1_hat
        new = memory + self.model.drift(memory, u, t) * dt
        new[0] += l1 * e
        new[1] += l2 * e
        return new


class OwnSampledDataObserver(Law):
    """x_hat+ = x_hat + T f(t, x_hat, u) + K_T(t, x_hat, u, y): Fu, Kang, Li, (5), any f and K_T."""

    may_be_undefined = True

    def __init__(self, spec: Spec) -> None:
        model = plant_from(member(spec, "model", "observer"), "model")
        if not isinstance(model, Own) or model.form != "sampled":
            raise fail("observer.model.kind", model.kind, "'own' of form 'sampled'", "change it")
        self.model = model
        self.n = self.memory_len = model.n
        self.n_u = model.n_u

    def residual(self, memory: Array, y: Array, u: Array | None, t: float) -> Array:
        """y - h(t, x_hat, u)."""
        return y - self.model.sampled(memory, u, y, t, 1.0)[2]

    def step(self, memory: Array, y: Array, u: Array | None, t: float, dt: float) -> Array:
        """(5); without a sample x_hat + T f."""
        f, correction, _ = self.model.sampled(memory, u, y, t, dt)
        return memory + f * dt + np.where(np.isfinite(y), correction, 0.0)


SLOTS = 8  # of an own model's memory for its inputs, as the core has them


class ReducedOrderObserver(Law):
    """The high-gain reduced-order observer: Katayama, eq. (8) and (22), H = diag(h_bar) / epsilon.

    z_hat(k+1) = (I - T H) z_hat(k) + T [H Psi(k) + f2(y(k), Psi(k), u(k))],
    Psi(k) = Phi^-1 g' ((y(k+1) - y(k)) / T - f1(y(k))): y(k+1) closes the step k -> k+1.
    ``predict`` opens a step, ``correct`` closes it: with a sample by (8), without one by
    z_hat += T f2(y, z_hat, u).  Psi spans all the time since the last sample.

    Memory: z_hat, the last sample y, the input u held over the open step, the time elapsed since y
    (-1 before the first sample), and the length of the open step (0 after a ``correct``).
    """

    is_current = True
    may_be_undefined = True

    def __init__(self, spec: Spec) -> None:
        model = plant_from(member(spec, "model", "observer"), "model")
        if isinstance(model, Ship):
            self.model: Ship | Own = Ship()  # the observer knows neither delta_bar nor w
            self.n, self.n_y, self._slots = 3, 3, model.n_u
        elif isinstance(model, Own) and model.form == "strict-feedback":
            self.model = model
            self.n, self.n_y, self._slots = model.n_z, model.n, SLOTS
        else:
            allowed = "'ship', or 'own' of form 'strict-feedback'"
            raise fail("observer.model.kind", model.kind, allowed, "change the model")
        self.n_u = model.n_u
        self.memory_len = self.n + self.n_y + self._slots + 2
        self.h_bar = vector(member(spec, "h_bar", "observer"), "observer.h_bar", self.n)
        if not np.all((self.h_bar > 0.0) & (self.h_bar < 1.0)):
            raise fail("observer.h_bar", self.h_bar.tolist(), "in (0, 1)", "see assumption A5")
        self.epsilon = number(member(spec, "epsilon", "observer"), "observer.epsilon", above=0.0)
        self._h = (self.h_bar / self.epsilon)[:, None]

    def initial(self) -> Array:
        memory = np.zeros(self.memory_len)
        memory[-2] = -1.0  # no sample yet
        return memory

    @property
    def signals(self) -> int:
        """The estimates."""
        return self.n

    def target(self, plant: Plant) -> slice:
        """z, which stands after what is measured."""
        return slice(self.n_y, min(self.n_y + self.n, plant.n))

    def parts(self, memory: Array) -> tuple[Array, Array, Array, Array, Array]:
        """z_hat, y, the slots of u, elapsed, period."""
        ends = np.cumsum([self.n, self.n_y, self._slots])
        z_hat, y, u, (elapsed, period) = np.split(memory, ends)
        return z_hat, y, u, elapsed, period

    def residual(self, memory: Array, y: Array, u: Array | None, t: float) -> Array:
        """y - (y_last + elapsed (f1 + g z_hat))."""
        z_hat, y_last, slots, elapsed, _ = self.parts(memory)
        y, held = np.reshape(y, y_last.shape), slots[: self.n_u]
        elapsed = np.maximum(elapsed, 0.0)  # before the first sample no time
        return y - y_last - elapsed * self.model.x_rate(y_last, z_hat, held, t - elapsed)

    def correct(self, memory: Array, y: Array, t: float) -> Array:
        """Close the open step: by (8), or over a missing sample by the model."""
        z_hat, y_last, slots, elapsed, period = self.parts(memory)
        y, u = np.reshape(y, y_last.shape), slots[: self.n_u]
        present = np.isfinite(y).all(axis=0)
        opened = (elapsed > 0.0) & (period > 0.0)
        psi = self.model.explain(y_last, (y - y_last) / elapsed, u, t - elapsed)
        psi = np.where(present, psi, z_hat)
        # (I - T H) z_hat + T [H Psi + f2(y, Psi, u)] = z_hat + T [H (Psi - z_hat) + f2(y, Psi, u)]
        rate = self._h * (psi - z_hat) + self.model.f2(y_last, psi, u, t - period)
        return np.vstack(
            [
                np.where(opened, z_hat + period * rate, z_hat),  # (8), (22)
                np.where(present, y, y_last),
                slots,
                np.where(present, 0.0, elapsed),
                np.zeros_like(period),
            ]
        )

    def predict(self, memory: Array, u: Array | None, t: float, dt: float) -> Array:
        """Open a step under ``u``, after one that was left open."""
        if u is None and self.n_u:
            allowed = f"of shape ({self.n_u}, runs)"
            raise fail("u", None, allowed, "give the input held from this sample on")
        new = self.correct(memory, np.full((self.n_y, memory.shape[1]), np.nan), t)
        if u is not None:
            new[self.n + self.n_y :][: self.n_u] = u
        new[-2] += np.where(new[-2] >= 0.0, dt, 0.0)
        new[-1] = dt
        return new

    def settle(self, old: Array, new: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Where f2 has no value z_hat is held; the sample and the input are kept for the next."""
        z_hat, undefined = super().settle(old[: self.n], new[: self.n])
        return np.vstack([z_hat, new[self.n :]]), undefined


class WindowObserver(Law):
    """x_hat+ = x_hat- + W d, x_hat- = exp(A T) x_hat: gains on a window of m innovations.

    d_0 = y - x_hat-_1 and d_j, what the sample j periods ago was off the polynomial of x_hat-;
    then off that of x_hat+.  Memory: x_hat (n), d (m).
    """

    is_current = True

    def __init__(self, spec: Spec) -> None:
        self.n = integer(member(spec, "n", "observer"), "observer.n", least=1)
        m = integer(member(spec, "window", "observer"), "observer.window", least=1)
        self.memory_len = self.n + m
        gains = vector(member(spec, "W", "observer"), "observer.W", self.n * m)
        self.gains = gains.reshape(self.n, m)
        period = number(member(spec, "dt", "observer"), "observer.dt", above=0.0)
        ages = -period * np.arange(m)
        self.back = np.array([ages**i / factorial(i) for i in range(self.n)])

    def correct(self, memory: Array, y: Array, t: float) -> Array:
        """The sample and what is left of those before it."""
        x_hat, d = memory[: self.n], memory[self.n :]
        d = np.vstack([innovation(y, x_hat[0])[None], d[:-1]])
        delta = self.gains @ d
        return np.vstack([x_hat + delta, d - self.back.T @ delta])

    def predict(self, memory: Array, u: Array | None, t: float, dt: float) -> Array:
        """The chain."""
        x_hat = memory[: self.n]
        rate = np.vstack([x_hat[1:], np.zeros_like(x_hat[:1])])
        return np.vstack([x_hat + ahead(rate, dt), memory[self.n :]])


class CurrentLaw(Law):
    """A continuous law with current timing: correct, then predict over the period that begins.

    Memory: the law's, and the time that the next correction is for: of a placed method all that has
    passed since the last sample used, of another the last period.
    """

    is_current = True

    def __init__(self, law: ContinuousLaw) -> None:
        self.law = law
        self.n, self.n_u = law.n, law.n_u
        self.memory_len = law.memory_len + 1
        self.may_be_undefined = law.may_be_undefined

    @property
    def signals(self) -> int:
        """The law's memory."""
        return self.law.memory_len

    def initial(self) -> Array:
        """The law's, and no time."""
        return np.append(self.law.initial(), 0.0)

    def check(self, memory: Array) -> None:
        """As the law's."""
        self.law.check(memory[:-1])

    def correct(self, memory: Array, y: Array, t: float) -> Array:
        """What ``y`` injects for the time elapsed, and moves at once; nothing without a sample."""
        new = memory.copy()
        elapsed, present = memory[-1], np.isfinite(y)
        for time in np.unique(elapsed[present]):  # gains are those of one time
            some = present & (elapsed == time)
            used = memory[:-1, some], y[some]
            if time > 0.0:
                new[:-1, some] = self.law.corrected(*used, float(time))
            else:
                at_once = self.law.jumped(*used).copy()
                self.law.clamp(at_once)
                new[:-1, some] = at_once
        new[-1] = np.where(present, 0.0, elapsed)
        return new

    def predict(self, memory: Array, u: Array | None, t: float, dt: float) -> Array:
        """The law's step without a sample."""
        moved = self.law.moved(memory[:-1], u, t, dt)
        over_gaps = (*PLACED, "implicit")
        elapsed = memory[-1] + dt if self.law.method in over_gaps else np.full_like(memory[-1], dt)
        return np.vstack([moved, elapsed])


class ChainsObserver(Law):
    """An observer for each output of a model of several chains, which share their states.

    Over a step, an observer takes the states of the other chains as they stand at its beginning.
    Memory: the estimates of all chains, then what else each of the observers remembers.
    """

    may_be_undefined = True

    def __init__(self, spec: Spec) -> None:
        model = plant_from(member(spec, "model", "observer"), "model")
        if not isinstance(model, Own) or model.form != "chains":
            raise fail("observer.model.kind", model.kind, "'own' of form 'chains'", "change it")
        self.chains = [Chain(model, i) for i in range(len(model.orders))]
        specs = member(spec, "observers", "observer")
        if len(specs) != len(self.chains):
            allowed = f"{len(self.chains)} observers, one for each chain"
            raise fail("observer.observers", len(specs), allowed, "list them in order")
        self.laws = [_single(*both) for both in zip(specs, self.chains, strict=True)]
        self.is_current = self.laws[0].is_current
        if any(law.is_current != self.is_current for law in self.laws):
            timings = [one.get("timing", "predictor") for one in specs]
            raise fail("observer.observers timing", timings, "the same", "choose one for all")
        inner: list[Law] = self.laws
        for outer in (WrappedLaw, CurrentLaw):
            inner = [law.law if isinstance(law, outer) else law for law in inner]
        self.inner = [law for law in inner if isinstance(law, ContinuousLaw)]
        self.motion = self.inner[0].motion
        if any(law.motion != self.motion for law in self.inner):
            motions = [law.motion for law in self.inner]
            raise fail("observer.observers motion", motions, "the same", "choose one for all")
        self.n, self.n_y, self.n_u = model.n, len(self.laws), model.n_u
        self.places, rest = [], self.n
        for law, chain in zip(self.laws, self.chains, strict=True):
            more = law.memory_len - law.n
            self.places.append(np.r_[chain.place, rest : rest + more])
            rest += more
        self.memory_len = rest

    @property
    def signals(self) -> int:
        """The estimates."""
        return self.n

    def initial(self) -> Array:
        """Those of the observers."""
        memory = np.zeros(self.memory_len)
        for law, place in zip(self.laws, self.places, strict=True):
            memory[place] = law.initial()
        return memory

    def check(self, memory: Array) -> None:
        """As each observer's."""
        for law, place in zip(self.laws, self.places, strict=True):
            law.check(memory[place])

    def residual(self, memory: Array, y: Array, u: Array | None, t: float) -> Array:
        """That of each observer, by its own output."""
        y = np.reshape(y, (self.n_y, -1))
        laws = zip(self.laws, self.places, y, strict=True)
        return np.stack([law.residual(memory[place], one, u, t) for law, place, one in laws])

    def each(self, memory: Array, act: Callable[[int, Law, Array], Array]) -> Array:
        """Every observer's memory after what ``act(i, observer, memory)`` makes of it."""
        new = np.empty_like(memory)
        for i, (law, place) in enumerate(zip(self.laws, self.places, strict=True)):
            self.chains[i].stands = memory[: self.n]
            new[place] = act(i, law, memory[place])
        return new

    def step(self, memory: Array, y: Array, u: Array | None, t: float, dt: float) -> Array:
        """A step of every observer."""
        y = np.reshape(y, (self.n_y, -1))
        if self.motion[0] != "held":
            turned = zip(self.laws, self.places, y, strict=True)
            y = np.stack(
                [
                    law.near(memory[place], one, u, t) if isinstance(law, WrappedLaw) else one
                    for law, place, one in turned
                ]
            )
            sampled = self.own(memory, lambda i, law, own: law.sampled(own, y[i], dt))
            return self.together(sampled, u, t, dt)
        return self.each(memory, lambda i, law, own: law.step(own, y[i], u, t, dt))

    def correct(self, memory: Array, y: Array, t: float) -> Array:
        """Every observer by its own output, for the time since that one's last sample."""
        y = np.reshape(y, (self.n_y, -1))
        return self.each(memory, lambda i, law, own: law.correct(own, y[i], t))

    def predict(self, memory: Array, u: Array | None, t: float, dt: float) -> Array:
        """Every observer over the period."""
        if self.motion[0] != "held":
            new = self.together(memory, u, t, dt)
            for law, place in zip(self.inner, self.places, strict=True):
                new[place[law.memory_len :]] += dt  # the time of the next correction
            return new
        return self.each(memory, lambda i, law, own: law.predict(own, u, t, dt))

    # --- where the model moves: all chains at once, each stage with all states as they are -------

    def own(self, memory: Array, act: Callable[[int, ContinuousLaw, Array], Array]) -> Array:
        """As ``each``, of the laws' own memories, without the time of a next correction."""
        new = memory.copy()
        for i, (law, place) in enumerate(zip(self.inner, self.places, strict=True)):
            self.chains[i].stands = memory[: self.n]
            new[place[: law.memory_len]] = act(i, law, memory[place[: law.memory_len]])
        return new

    def together(self, memory: Array, u: Array | None, t: float, dt: float) -> Array:
        """The memory after a period without a sample."""
        new = moving.moved(self, self.motion, memory, u, t, dt)

        def clamped(i: int, law: ContinuousLaw, own: Array) -> Array:
            law.clamp(own)
            return own

        new = self.own(new, clamped)
        for outer, place in zip(self.laws, self.places, strict=True):
            if isinstance(outer, WrappedLaw):
                new[place] = outer.back(new[place])
        return new

    def terms(self, memory: Array, u: Array | None, t: float) -> Array:
        """Of all chains, one after the other."""
        f = []
        for chain, law, place in zip(self.chains, self.inner, self.places, strict=True):
            chain.stands = memory[: self.n]
            f.append(law.terms(memory[place[: law.memory_len]], u, t))
        return np.vstack(f)

    def _split(self, f: Array) -> list[Array]:
        """Terms, or a deviation, by chains."""
        return np.split(f, np.cumsum([law.n_terms for law in self.inner])[:-1])

    def flow(self, memory: Array, f: Array, dt: float) -> Array:
        """Of all chains."""
        parts = self._split(f)
        return self.own(memory, lambda i, law, own: law.flow(own, parts[i], dt))

    def chain(self, delta: Array) -> Array:
        """Of all chains."""
        parts = zip(self.inner, self._split(delta), strict=True)
        return np.vstack([law.chain(part) for law, part in parts])

    def shifted(self, memory: Array, delta: Array) -> Array:
        """Of all chains."""
        parts = self._split(delta)
        return self.own(memory, lambda i, law, own: law.shifted(own, parts[i]))


class WrappedLaw(Law):
    """A law whose outputs wrap: it takes each sample by its innovation to the nearest turn, and its
    estimate is brought back to within half a turn of 0, with all that is of the same coordinate.
    """

    def __init__(self, law: Law, lengths: Array, entries: list[list[int]]) -> None:
        self.law = law
        self.n, self.n_y, self.n_u = law.n, law.n_y, law.n_u
        self.memory_len, self.is_current = law.memory_len, law.is_current
        self.may_be_undefined = law.may_be_undefined
        self.lengths, self.entries = lengths, entries

    @property
    def signals(self) -> int:
        """The law's."""
        return self.law.signals

    def initial(self) -> Array:
        """The law's."""
        return self.law.initial()

    def check(self, memory: Array) -> None:
        """As the law's."""
        self.law.check(memory)

    def settle(self, old: Array, new: Array) -> tuple[Array, NDArray[np.bool_]]:
        """As the law's."""
        return self.law.settle(old, new)

    def near(self, memory: Array, y: Array, u: Array | None, t: float) -> Array:
        """The sample, moved by whole turns to the nearest to its prediction."""
        beyond = np.reshape(self.law.residual(memory, y, u, t), (self.n_y, -1))
        moved = np.reshape(y, (self.n_y, -1)).copy()
        for i, length in enumerate(self.lengths):
            if np.isfinite(length):
                moved[i] -= length * np.rint(beyond[i] / length)
        return np.reshape(moved, np.shape(y))

    def back(self, memory: Array) -> Array:
        """The memory within one turn."""
        new = memory.copy()
        for length, entries in zip(self.lengths, self.entries, strict=True):
            if np.isfinite(length):
                new[entries] -= length * np.rint(memory[entries[0]] / length)
        return new

    def residual(self, memory: Array, y: Array, u: Array | None, t: float) -> Array:
        """The law's innovation, to the nearest turn."""
        return self.law.residual(memory, self.near(memory, y, u, t), u, t)

    def step(self, memory: Array, y: Array, u: Array | None, t: float, dt: float) -> Array:
        """The law's step between the two reductions."""
        return self.back(self.law.step(memory, self.near(memory, y, u, t), u, t, dt))

    def correct(self, memory: Array, y: Array, t: float) -> Array:
        """The law's correction between the two."""
        return self.back(self.law.correct(memory, self.near(memory, y, None, t), t))

    def predict(self, memory: Array, u: Array | None, t: float, dt: float) -> Array:
        """The law's way to the next sample, brought back."""
        return self.back(self.law.predict(memory, u, t, dt))


LAWS: dict[str, type[Law]] = {
    "standard": StandardObserver,
    "low-power": LowPowerObserver,
    "peaking-free": PeakingFreeObserver,
    "filtered": FilteredObserver,
    "limited-gain": LimitedGainObserver,
    "cascade": CascadeObserver,
    "reduced-chain": ReducedChainObserver,
    "high-gain-ekf": HighGainEkf,
    "collection": CollectionObserver,
    "modified": ModifiedObserver,
    "sampled-data": SampledDataObserver,
    "reduced-order": ReducedOrderObserver,
    "window": WindowObserver,
    "chains": ChainsObserver,
}
SINGLE = (
    "standard",
    "low-power",
    "peaking-free",
    "filtered",
    "limited-gain",
    "cascade",
    "reduced-chain",
    "high-gain-ekf",
)


_CHAIN = ("n", "gain", "model", "method", "motion", "substeps", "timing", "wrap")
KEYS: dict[str, tuple[str, ...]] = {
    "standard": ("k", "shape", *_CHAIN),
    "low-power": ("alpha", "beta", "shape", *_CHAIN),
    "peaking-free": ("alpha", "beta", "saturation", "clip", "shape", *_CHAIN),
    "filtered": ("c", "k", "filters", "shape", *_CHAIN),
    "limited-gain": ("alpha", "beta", "saturation", "clip", "shape", *_CHAIN),
    "cascade": ("k", "beta", "saturation", "clip", "shape", *_CHAIN),
    "reduced-chain": ("k", *_CHAIN),
    "high-gain-ekf": ("Q", "R", "P0", *_CHAIN),
    "collection": ("k", "k_bar", "copies", *_CHAIN),
    "modified": ("k", "k_bar", "copies", *_CHAIN),
    "sampled-data": ("model", "gain", "wrap"),
    "reduced-order": ("model", "h_bar", "epsilon", "wrap"),
    "window": ("n", "window", "W", "dt", "model", "wrap"),
    "chains": ("observers", "model"),
}


def law_from(spec: Spec) -> Law:
    """The law that ``spec`` describes."""
    kind = choice(member(spec, "kind", "observer"), "observer.kind", tuple(LAWS))
    known(spec, "observer", ("kind", *KEYS[kind]))
    law: Any = LAWS[kind]
    if kind == "sampled-data" and member(spec, "model", "observer").get("kind") == "own":
        law = OwnSampledDataObserver
    chains = list(spec.get("observers", ())) if kind == "chains" else [spec]
    if chains and all(_is_sampled(one) for one in chains):
        return _filter(spec, chains)
    return _wrapped(_timed(law(spec), spec), spec)


def _is_sampled(spec: Spec) -> bool:
    return spec.get("kind") == "high-gain-ekf" and spec.get("method") == SAMPLED


def _filter(spec: Spec, chains: list[Spec]) -> Law:
    """The EKF of sampled data of one chain, or of all chains of a model."""
    if spec["kind"] != "chains":
        model = _model(spec, _order(spec), None)
        if member(spec, "gain", "observer").get("law") == "innovation":
            return _wrapped(AdaptiveEkf(spec, model), spec)
        return _wrapped(SampledEkf(chains, model), spec)
    for one in chains:
        known(one, "observers", ("kind", "Q", "R", "P0", *_CHAIN[:-1]))
    model = plant_from(member(spec, "model", "observer"), "model")
    orders = [_order(one) for one in chains]
    if not isinstance(model, Own) or model.form != "chains" or model.orders != orders:
        raise fail("observer.model", model.kind, f"'own' of chains {orders}", "change it")
    return SampledEkf(chains, model)


def _single(spec: Spec, chain: Chain) -> Law:
    """The law of one chain."""
    kind = choice(member(spec, "kind", "observers"), "observers.kind", SINGLE)
    known(spec, "observers", ("kind", *KEYS[kind]))
    law: Any = LAWS[kind]
    return _wrapped(_timed(law(spec, chain), spec), spec)


def _wrapped(law: Law, spec: Spec) -> Law:
    """The law of outputs that wrap, if any does: one length, or one or None for each output."""
    if spec.get("wrap") is None:
        return law
    given = np.atleast_1d(np.array(spec["wrap"], dtype=np.float64))
    if given.shape != (law.n_y,):
        raise fail("observer.wrap", spec["wrap"], f"of {law.n_y} entries", "None: does not wrap")
    for length in given[~np.isnan(given)]:
        number(float(length), "observer.wrap", above=0.0)
    entries = [[0]]
    if isinstance(law, ReducedOrderObserver):  # its last sample
        entries = [[law.n + i] for i in range(law.n_y)]
    elif "copies" in spec:  # the observer beside them, or the first copy, and all others
        copies = spec["copies"] + (spec["kind"] == "modified")
        entries = [[copy * (law.n + 1) for copy in range(copies)]]
    return WrappedLaw(law, given, entries)


def _timed(law: Law, spec: Spec) -> Law:
    """The law under its timing."""
    timing = choice(spec.get("timing", "predictor"), "observer.timing", TIMINGS)
    method = spec.get("method")
    single = isinstance(law, StandardObserver) and not isinstance(law, FilteredObserver)
    has = {
        "proper": isinstance(law, (StandardObserver, LowPowerObserver)),
        "implicit": single,
        "inter-sample": single,
    }
    placed = method not in PLACED or getattr(law, "placed", True)
    if not placed or not has.get(str(method), True):
        allowed = "a method of step-by-step rates"
        raise fail("observer.method", method, allowed, "eigenvalues are placed for single laws")
    if timing == {"implicit": "predictor", "inter-sample": "current"}.get(str(method)):
        raise fail("observer.timing", timing, "the other", "or another method")
    if method == "bilinear" and law.n > BILINEAR_LIMIT[spec["kind"]]:
        allowed = f"at most {BILINEAR_LIMIT[spec['kind']]} under method bilinear"
        remedy = "choose method zoh: rounding moves eigenvalues gathered at -1"
        raise fail("observer.n", law.n, allowed, remedy)
    if timing == "current" and isinstance(law, ContinuousLaw):
        return CurrentLaw(law)
    return law


USED, MISSED, UNDEFINED = 0, 1, 2  # what a step made of its sample


class Observer:
    """An observer to step online or to run over a record.

    Attributes: ``spec``, order ``n``, ``n_y`` outputs, ``n_u`` inputs, ``memory_len``, and
    ``is_current``: whether the estimate at k uses y(k).
    """

    def __init__(self, spec: Spec) -> None:
        self.spec = dict(spec)
        self.law = law_from(spec)
        self.n = self.law.n
        self.n_y = self.law.n_y
        self.n_u = self.law.n_u
        self.memory_len = self.law.memory_len
        self.is_current = self.law.is_current

    def initial(self) -> Array:
        """Memory to start from when nothing is known, (memory_len,)."""
        return self.law.initial()

    def correct(self, memory: ArrayLike, y: ArrayLike, t: float) -> tuple[Array, int]:
        """Take the sample ``y`` at ``t`` [s]: (memory with x_hat(k|k), status as of ``step``).

        Current timing only.  The gain is that for the time elapsed since the last sample.
        """
        self._need_current("correct")
        column, (sample, missing) = self._memory(memory), self._sample(y)
        return self._settled(
            column, lambda: self.law.correct(column, sample, number(t, "t")), missing
        )

    def predict(
        self, memory: ArrayLike, u: ArrayLike | None, t: float, dt: float
    ) -> tuple[Array, int]:
        """Move from ``t`` over ``dt`` [s] under the input now applied: (memory, status 0 or 2).

        Current timing only.
        """
        self._need_current("predict")
        column, told = self._memory(memory), self._input(u)
        number(t, "t")
        number(dt, "dt", above=0.0)
        return self._settled(column, lambda: self.law.predict(column, told, t, dt), False)

    def step(
        self, memory: ArrayLike, y: ArrayLike, u: ArrayLike | None, t: float, dt: float
    ) -> tuple[Array, int]:
        """One sample ``y`` at time ``t``: (memory after the step, status).

        Predictor timing: the step from ``t`` over the coming ``dt``, under ``u``.  Current timing:
        ``predict`` over the period ``dt`` that ends at ``t``, under the ``u`` held over it, then
        ``correct``; ``dt`` = 0 for the very first sample, which only corrects.

        ``memory``: (memory_len,); ``y``: scalar or (n_y,), NaN for a missing sample; ``u``: (n_u,)
        or None; ``t``, ``dt`` [s].  Status 0: sample used; 1: missing, the law predicted; 2: the
        model has no value here, the memory was kept (by the reduced-order law: z_hat).
        """
        if self.is_current:
            number(dt, "dt", least=0.0)
            before, status = np.asarray(memory), USED
            if dt > 0.0:
                before, status = self.predict(memory, u, t - dt, dt)
                if status == UNDEFINED:
                    return before, status
            return self.correct(before, y, t)
        column, (sample, missing), told = self._memory(memory), self._sample(y), self._input(u)
        number(t, "t")
        number(dt, "dt", above=0.0)
        return self._settled(column, lambda: self.law.step(column, sample, told, t, dt), missing)

    def _need_current(self, verb: str) -> None:
        if not self.is_current:
            raise fail(f"timing (of {verb})", "predictor", "'current'", "set timing='current'")

    def _memory(self, memory: ArrayLike) -> Array:
        return vector(memory, "memory", self.memory_len)[:, None]

    def _sample(self, y: ArrayLike) -> tuple[Array, bool]:
        sample = np.asarray(y, dtype=np.float64).reshape(-1)
        if sample.shape != (self.n_y,):
            raise fail("y", np.shape(y), f"of {self.n_y} entries", "give one sample")
        missing = not np.all(np.isfinite(sample))
        return sample if self.n_y == 1 else sample[:, None], missing

    def _input(self, u: ArrayLike | None) -> Array | None:
        return None if self.n_u == 0 else vector([] if u is None else u, "u", self.n_u)[:, None]

    def _settled(self, old: Array, move: Callable[[], Array], missing: bool) -> tuple[Array, int]:
        with np.errstate(all="ignore"):
            new, undefined = self.law.settle(old, move())
        return new[:, 0], UNDEFINED if undefined[0] else MISSED if missing else USED

    def run(
        self,
        t: ArrayLike,
        y: ArrayLike,
        u: ArrayLike | None,
        memory0: ArrayLike,
        dt: float | None = None,
    ) -> dict[str, NDArray[Any]]:
        """Over a record: ``t`` (N,) increasing, ``y`` (N, n_y), ``u`` (N, n_u), ``memory0``.

        ``dt``: length of every step [s], where it is not what lies between the times.
        Returns "memory" (N, memory_len): predictor timing, before the use of y(k); current timing,
        after ``correct`` with y(k), whereupon ``predict`` moves on under u(k).  "innovation"
        (N, n_y) = y - y_hat, not finite where y(k) is not; "status" (N,) as of ``step``; "missing".
        """
        time = np.asarray(t, dtype=np.float64)
        if time.ndim != 1 or time.size < 1:
            raise fail("t", time.shape, "of shape (N,), N >= 1", "give the sampling instants")
        for k in range(time.size):
            if not np.isfinite(time[k]) or (k > 0 and not time[k] > time[k - 1]):
                before = "-inf" if k == 0 else f"t[{k - 1}] = {time[k - 1]:g}"
                raise fail(f"t[{k}]", float(time[k]), f"finite and > {before}", "sort the record")
        samples = np.asarray(y, dtype=np.float64)
        if samples.ndim == 1:
            samples = samples[:, None]
        if samples.shape != (time.size, self.n_y):
            raise fail("y", samples.shape, f"of shape ({time.size}, {self.n_y})", "match t")
        control = None
        if self.n_u:
            control = np.asarray([] if u is None else u, dtype=np.float64)
            if control.ndim == 1:
                control = control[:, None]
            if control.shape != (time.size, self.n_u):
                raise fail("u", control.shape, f"of shape ({time.size}, {self.n_u})", "match t")
            if not np.all(np.isfinite(control)):
                raise fail("u", "an array with NaN or inf", "finite", "inputs must be known")
        law, memory = self.law, vector(memory0, "memory0", self.memory_len)[:, None]
        law.check(memory)
        steps = np.diff(time) if dt is None else np.full(time.size - 1, dt)
        steps = np.append(steps, steps[-1] if steps.size else 0.0)
        missing = ~np.all(np.isfinite(samples), axis=1)
        memories = np.empty((time.size, self.memory_len))
        innovations = np.empty((time.size, self.n_y))
        status = np.where(missing, MISSED, USED).astype(np.uint8)
        with np.errstate(all="ignore"):
            for k in range(time.size):
                t_k, dt_k = float(time[k]), float(steps[k])
                y_k = samples[k] if self.n_y == 1 else samples[k][:, None]
                u_k = None if control is None else control[k][:, None]
                innovations[k] = law.residual(memory, y_k, u_k, t_k).reshape(-1)
                undefined = np.zeros(1, dtype=np.bool_)
                if law.is_current:
                    memory, undefined = law.settle(memory, law.correct(memory, y_k, t_k))
                memories[k] = memory[:, 0]
                new = memory
                if not law.is_current and dt_k > 0.0:  # one sample alone tells no step
                    new = law.step(memory, y_k, u_k, t_k, dt_k)
                elif law.is_current and k + 1 < time.size:
                    new = law.predict(memory, u_k, t_k, dt_k)
                memory, refused = law.settle(memory, new)
                if (undefined | refused)[0]:
                    status[k] = UNDEFINED
        return {"memory": memories, "innovation": innovations, "status": status, "missing": missing}
