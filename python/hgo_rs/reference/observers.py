"""The papers' observers, one class a law, the equation number at the line.

A memory is an array of columns, shape (memory_len, runs): its first n entries are x_hat, then come
the extras (eta, r, ...).  ``e`` is the innovation y - x_hat_1.  A missing sample (mask ``missing``,
one entry a run) makes the innovation zero: the observer predicts.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import integrate
from .error import Array, Spec, choice, fail, integer, known, member, number, vector
from .gain import AdaptiveGain, ConstantGain, DeadZoneGain, GainLaw, gain_from
from .models import Own, Plant, Ship, VanDerPol, plant_from
from .placement import PLACED, ahead, chain_gains, low_power_gains
from .polynomial import is_hurwitz, low_power_polynomial

Missing = NDArray[np.bool_] | None

METHODS = (
    "euler",
    "staggered-euler",
    "rk4",
    "rk4-innovation-held",
    "bogacki-shampine",
    *PLACED,
)
TIMINGS = ("predictor", "current")
MAX_ORDER = 12


class Law:
    """What all laws share: sizes, and one step."""

    n: int
    n_y = 1
    n_u = 0
    memory_len: int
    filters = False  # predictor: the estimate at k uses samples up to k-1

    @property
    def signals(self) -> int:
        """How many entries of the memory, the first ones, are worth a metric."""
        return self.memory_len

    def step(
        self,
        memory: Array,
        y: Array,
        u: Array | None,
        t: float,
        dt: float,
        missing: Missing = None,
    ) -> Array:
        """The memory after the sample ``y`` at time ``t``, and after the step ``dt`` that follows.

        ``memory``: (memory_len, runs); ``y``: (runs,), or (n_y, runs) if n_y > 1; ``u``: (n_u,
        runs) or None.  ``memory`` is not changed.
        """
        raise NotImplementedError

    def residual(self, memory: Array, y: Array, t: float) -> Array:
        """The innovation of a record: y - (predicted y), shape of ``y``."""
        return y - memory[0]

    def undefined(self, memory: Array, y: Array, missing: Missing = None) -> NDArray[np.bool_]:
        """Where the model has no value at this sample, one entry a run: never, but for a ship."""
        return np.zeros(memory.shape[1], dtype=np.bool_)

    def initial(self) -> Array:
        """Memory to start from when nothing is known, (memory_len,)."""
        return np.zeros(self.memory_len)

    def check(self, memory: Array) -> None:
        """Refuse a memory from which the law cannot start."""


class ContinuousLaw(Law):
    """A law given by a rate d(memory)/dt, discretised by a scheme."""

    method: str
    gain_rows: tuple[int, ...] = ()  # where in the memory gains r >= 1 stand

    def innovation(self, memory: Array, y: Array, missing: Missing = None) -> Array:
        """e = y - x_hat_1, shape (runs,)."""
        e = y - memory[0]
        return e if missing is None else np.where(missing, 0.0, e)

    def rate(self, memory: Array, e: Array, u: Array | None = None, t: float = 0.0) -> Array:
        """d(memory)/dt at ``t`` for the innovation(s) ``e``."""
        raise NotImplementedError

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """Staggered Euler: repeat the chain's sums with new values, from the bottom up."""
        raise NotImplementedError

    def initial(self) -> Array:
        """x_hat = 0, and r = 1 where the gain moves."""
        memory = np.zeros(self.memory_len)
        memory[list(self.gain_rows)] = 1.0
        return memory

    def clamp(self, memory: Array) -> None:
        """r >= 1, in place, after a step."""
        for row in self.gain_rows:
            np.maximum(memory[row], 1.0, out=memory[row])

    def step(
        self,
        memory: Array,
        y: Array,
        u: Array | None,
        t: float,
        dt: float,
        missing: Missing = None,
    ) -> Array:
        """One step of the scheme with y held; or correct, then predict."""
        method = self.method
        if method in PLACED:
            corrected = self.correct(memory, y, u, dt, missing)
            return self.predict(corrected, u, t, dt)
        if method == "euler" or method == "staggered-euler":
            new = memory + dt * self.rate(memory, self.innovation(memory, y, missing), u, t)
            if method == "staggered-euler":
                self.lift(memory, new, dt)
        elif method == "rk4-innovation-held":
            held = self.innovation(memory, y, missing)
            new = integrate.rk4(lambda s, m: self.rate(m, held, u, s), t, memory, dt)
        else:
            new = integrate.DETERMINISTIC[method](
                lambda s, m: self.rate(m, self.innovation(m, y, missing), u, s), t, memory, dt
            )
        if self.gain_rows:
            self.clamp(new)
        return new

    def predict(self, memory: Array, u: Array | None, t: float, dt: float) -> Array:
        """A step without a sample."""
        none = np.ones(memory.shape[1], dtype=np.bool_)
        if self.method in PLACED:
            new = self.flow(memory, u, dt)
            self.clamp(new)
            return new
        return self.step(memory, memory[0], u, t, dt, none)

    def correct(
        self, memory: Array, y: Array, u: Array | None, dt: float, missing: Missing = None
    ) -> Array:
        """What the sample injects over the period ``dt`` that it ends: by Euler, or placed."""
        e = self.innovation(memory, y, missing)
        if self.method in PLACED:
            new = self.place(memory, e, dt)
        else:
            new = memory + dt * (self.rate(memory, e, u) - self.rate(memory, 0.0 * e, u))
        self.clamp(new)
        return new

    def flow(self, memory: Array, u: Array | None, dt: float) -> Array:
        """A step along the chain, exact, what is known held."""
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


def _model(spec: Spec, n: int) -> Plant:
    model = plant_from(spec.get("model", {"kind": "none"}), "model")
    if model.n not in (0, n) or model.n_y != 1:
        raise fail("observer.model", model.kind, f"a model of order {n}", "use kind 'none'")
    if isinstance(model, Own) and model.form == "sampled":
        allowed = "of phase-variable or triangular form"
        raise fail("observer.model.form", model.form, allowed, "use kind 'sampled-data'")
    return model


class StandardObserver(ContinuousLaw):
    """The standard high-gain observer with any gain law.

    Astolfi et al., eq. (2); Lee et al., eq. (39) and, by Euler's scheme, (42) and (44) with
    q_i = epsilon^(i-1) x_hat_i; Sanfelice, Praly, eq. (5)-(7) with the adaptive gain.
    Memory: x_hat (n), and r if the gain moves.
    """

    def __init__(self, spec: Spec) -> None:
        self.n = _order(spec)
        self.k = _coefficients(spec, self.n)
        self.gain: GainLaw = gain_from(member(spec, "gain", "observer"))
        self.model = _model(spec, self.n)
        self.n_u = self.model.n_u
        self.method = _method(spec)
        self.memory_len = self.n + self.gain.moves
        self.gain_rows = (self.n,) if self.gain.moves else ()
        if isinstance(self.gain, ConstantGain):
            powers = self.gain.ell ** np.arange(1, self.n + 1)
            self._injection = (self.k * powers)[:, None]  # k_i ell^i

    def chain(self, x_hat: Array, e: Array, g: Array | None, u: Array | None, t: float) -> Array:
        """x_hat_i' = x_hat_{i+1} + f_i(x_hat) + k_i g^i e."""
        rate = np.empty_like(x_hat)
        if g is None:
            np.multiply(self._injection, e, out=rate)
        else:
            power = g
            for i in range(self.n):
                rate[i] = self.k[i] * power * e
                power = power * g
        rate[:-1] += x_hat[1:]
        f = self.model.known(x_hat, u, t)
        if f is not None:
            rate += f
        return rate

    def rate(self, memory: Array, e: Array, u: Array | None = None, t: float = 0.0) -> Array:
        """Astolfi (2); Sanfelice, Praly (5), (6)."""
        if not self.gain.moves:
            return self.chain(memory, e, None, u, t)
        n = self.n
        r = memory[n]
        rate = np.empty_like(memory)
        rate[:n] = self.chain(memory[:n], e, r, u, t)
        rate[n] = self.gain.rate(r, e, n)
        return rate

    def flow(self, memory: Array, u: Array | None, dt: float) -> Array:
        """x_hat along the chain; r without a sample."""
        n, new = self.n, memory.copy()
        x_hat = memory[:n]
        rates = np.vstack([x_hat[1:], np.zeros_like(x_hat[:1])])
        f = self.model.known(x_hat, u)
        if f is not None:
            rates = rates + f
        new[:n] += ahead(rates, dt)
        if self.gain.moves:
            new[n] += dt * self.gain.rate(memory[n], np.zeros_like(memory[n]), n)
        return new

    def place(self, memory: Array, e: Array, dt: float) -> Array:
        """x_hat + K e."""
        n, new = self.n, memory.copy()
        powers = np.arange(1, n + 1)
        if isinstance(self.gain, ConstantGain):
            k = chain_gains(self.k * self.gain.ell**powers, dt, self.method)
            new[:n] += k[:, None] * e
            return new
        for j, r in enumerate(memory[n]):
            new[:n, j] += chain_gains(self.k * r**powers, dt, self.method) * e[j]
        new[n] += dt * (self.gain.rate(memory[n], e, n) - self.gain.rate(memory[n], 0.0 * e, n))
        return new

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """x_hat_i uses the new x_hat_{i+1}."""
        lift_chain(old, new, dt, 0, self.n)


def lift_chain(old: Array, new: Array, dt: float, first: int, n: int) -> None:
    """For rows first .. first+n-1, bottom up: x_i += dt (x_{i+1}(new) - x_{i+1}(old))."""
    for i in range(first + n - 2, first - 1, -1):
        new[i] += dt * (new[i + 1] - old[i + 1])


class LowPowerObserver(ContinuousLaw):
    """The low-power observer: Astolfi et al., eq. (5): powers of ell up to 2, whatever n.

    Memory: x_hat (n), eta (n-1), and r if the gain moves.  A known triangular part f enters row i
    of x_hat as f_i and row i of eta, which estimates x_{i+1}, as f_{i+1}.
    """

    def __init__(self, spec: Spec) -> None:
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
        self.gain: GainLaw = gain_from(member(spec, "gain", "observer"))
        self.model = _model(spec, n)
        self.n_u = self.model.n_u
        self.method = _method(spec)
        self.memory_len = 2 * n - 1 + self.gain.moves
        self.gain_rows = (2 * n - 1,) if self.gain.moves else ()
        self._injections: tuple[Array, Array] | None = None
        if isinstance(self.gain, ConstantGain):
            self._injections = self._scaled(self.gain.ell)

    def _scaled(self, g: float | Array) -> tuple[Array, Array]:
        """alpha_i ell and beta_i ell^2, as columns."""
        return self.alpha[:, None] * g, self.beta[:, None] * (g * g)

    def limit(self, eta: Array) -> Array:
        """What of eta is passed on: all of it; eq. (11) saturates here."""
        return eta

    def rate(self, memory: Array, e: Array, u: Array | None = None, t: float = 0.0) -> Array:
        """(5a), (5b); with ``limit`` (11a), (11b)."""
        n = self.n
        x_hat, eta = memory[:n], memory[n : 2 * n - 1]
        passed = self.limit(eta)
        alpha_ell, beta_ell2 = self._injections or self._scaled(memory[2 * n - 1])
        e_all = np.empty_like(x_hat)
        e_all[0] = e  # e_1 = y - x_hat_1
        np.subtract(passed, x_hat[1:], out=e_all[1:])  # e_i = eta_{i-1} - x_hat_i
        rate = np.empty_like(memory)
        x_rate, eta_rate = rate[:n], rate[n : 2 * n - 1]
        np.multiply(alpha_ell, e_all, out=x_rate)
        x_rate[:-1] += eta  # x_hat_i' = eta_i + alpha_i ell e_i
        np.multiply(beta_ell2, e_all[:-1], out=eta_rate)
        eta_rate[:-1] += passed[1:]  # eta_i' = eta_{i+1} + beta_i ell^2 e_i
        f = self.model.known(x_hat, u, t)
        if f is not None:
            x_rate += f  # x_hat_n' = phi_s + alpha_n ell e_n
            eta_rate += f[1:]  # eta_{n-1}' = phi_s + beta_{n-1} ell^2 e_{n-1}
        if self.gain.moves:
            r = memory[2 * n - 1]
            rate[2 * n - 1] = self.gain.rate(r, e, n)
        return rate

    def flow(self, memory: Array, u: Array | None, dt: float) -> Array:
        """Every block along the chain, by its own eta and by what those above pass on."""
        n, new = self.n, memory.copy()
        x_hat, eta = memory[:n], memory[n : 2 * n - 1]
        passed = self.limit(eta)
        phi = self.model.known(x_hat, u)
        last = np.zeros_like(x_hat[:1]) if phi is None else phi[-1:]
        moved = ahead(np.vstack([passed, last]), dt)
        new[:n] += moved
        new[: n - 1] += dt * (eta - passed)
        new[n : 2 * n - 1] += moved[1:]
        if self.gain.moves:
            r = memory[2 * n - 1]
            new[2 * n - 1] += dt * self.gain.rate(r, np.zeros_like(r), n)
        return new

    def place(self, memory: Array, e: Array, dt: float) -> Array:
        """Block i by a_i e_i and b_i e_i; what asks for more than its level by a'_i and b'_i."""
        n, new = self.n, memory.copy()
        x_hat, eta = memory[:n], memory[n : 2 * n - 1]
        e_all = np.vstack([np.asarray(e)[None], self.limit(eta) - x_hat[1:]])
        if isinstance(self.gain, ConstantGain):
            r = np.array([self.gain.ell])
        else:
            r = memory[2 * n - 1]
        parts = [low_power_gains(self.alpha * g, self.beta * g * g, dt, self.method) for g in r]
        a, b, a_alone, b_alone = (np.array(part).T for part in zip(*parts, strict=True))
        asked = b_alone * e_all[:-1]
        beyond = (asked - self.limit(asked)) / b_alone
        within = e_all[:-1] - beyond
        new[: n - 1] += a[:-1] * within + a_alone[:-1] * beyond
        new[n - 1] += a[-1] * e_all[-1]
        new[n : 2 * n - 1] += b * within + b_alone * beyond
        if self.gain.moves:
            r = memory[2 * n - 1]
            new[2 * n - 1] += dt * (self.gain.rate(r, e, n) - self.gain.rate(r, 0.0 * e, n))
        return new

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """eta_i uses the new eta_{i+1}, then x_hat_i the new eta_i."""
        n = self.n
        for i in range(2 * n - 3, n - 1, -1):
            new[i] += dt * (self._passed(new, i + 1) - self._passed(old, i + 1))
        for i in range(n - 1):
            new[i] += dt * (new[n + i] - old[n + i])

    def _passed(self, memory: Array, row: int) -> Array:
        return memory[row]


class PeakingFreeObserver(LowPowerObserver):
    """The peaking-free low-power observer: Astolfi et al., eq. (11).

    ``saturation`` = [r_2, ..., r_n]: eta_i passes through sat at level r_{i+1}.
    """

    def __init__(self, spec: Spec) -> None:
        super().__init__(spec)
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
        gain = gain_from(member(spec, "gain", "observer"))
        if not isinstance(gain, AdaptiveGain) or isinstance(gain, DeadZoneGain):
            raise fail(
                "observer.gain.law", spec["gain"]["law"], "'adaptive'", "copies adapt by (6)"
            )
        self.gain = gain
        self.model = _model(spec, self.n)
        self.n_u = self.model.n_u
        self.method = _method(spec)
        self.memory_len = self.copies * (self.n + 1)
        self.gain_rows = tuple(range(self.n, self.memory_len, self.n + 1))

    def by_copy(self, memory: Array) -> Array:
        """View of shape (copies, n + 1, runs)."""
        return memory.reshape(self.copies, self.n + 1, -1)

    def innovation(self, memory: Array, y: Array, missing: Missing = None) -> Array:
        """e_i = y - x_hat_{i,1}, shape (copies, runs)."""
        e = y - self.by_copy(memory)[:, 0]
        return e if missing is None else np.where(missing, 0.0, e)

    def rate(self, memory: Array, e: Array, u: Array | None = None, t: float = 0.0) -> Array:
        """(23), with e_i = -(y_hat_i - y)."""
        n, b = self.n, self.gain.b
        copies = self.by_copy(memory)
        r = copies[:, n]
        scale = r**b
        scaled = e / scale
        repulsion = (scaled[:, None] - scaled[None, :]).sum(axis=1)  # sum_l (e_i/r_i^b - e_l/r_l^b)
        rate = np.empty_like(copies)
        power = r
        for j in range(n):
            rate[:, j] = self.k[j] * power * e - self.k_bar[j] * power * scale * repulsion
            power = power * r
        rate[:, : n - 1] += copies[:, 1:n]
        f = self.model.known(np.moveaxis(copies[:, :n], 1, 0), u, t)
        if f is not None:
            rate[:, :n] += np.moveaxis(f, 0, 1)
        rate[:, n] = self.gain.rate(r, e, n)
        return rate.reshape(memory.shape)

    def nominal_gain(self, memory: Array) -> Array:
        """r_bar = mean of the r_i, shape (runs,): (24)."""
        return self.by_copy(memory)[:, self.n].sum(axis=0) / self.copies  # (24)

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """The chain of every copy."""
        for i in range(self.copies):
            lift_chain(old, new, dt, i * (self.n + 1), self.n)

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

    def innovation(self, memory: Array, y: Array, missing: Missing = None) -> Array:
        """e of the observer, then of the copies, shape (1 + copies, runs)."""
        e = y - memory[:: self.n + 1]
        return e if missing is None else np.where(missing, 0.0, e)

    def rate(self, memory: Array, e: Array, u: Array | None = None, t: float = 0.0) -> Array:
        """(25) over (23) and (24)."""
        n = self.n
        own = memory[: n + 1]
        x_hat, r = own[:n], own[n]
        others = memory[n + 1 :]
        g = r * self.collection.nominal_gain(others)
        rate = np.empty_like(memory)
        power = g
        for j in range(n):
            rate[j] = self.k[j] * power * e[0]  # k_j (r r_bar)^j e
            power = power * g
        rate[: n - 1] += x_hat[1:]
        f = self.model.known(x_hat, u, t)
        if f is not None:
            rate[:n] += f
        rate[n] = self.gain.rate(r, e[0], n)
        rate[n + 1 :] = self.collection.rate(others, e[1:], u, t)
        return rate

    def nominal_gain(self, memory: Array) -> Array:
        """r_bar of the collection: (24)."""
        return self.collection.nominal_gain(memory[self.n + 1 :])

    def lift(self, old: Array, new: Array, dt: float) -> None:
        """The observer's chain and every copy's."""
        for i in range(self.copies + 1):
            lift_chain(old, new, dt, i * (self.n + 1), self.n)

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

    def step(
        self,
        memory: Array,
        y: Array,
        u: Array | None,
        t: float,
        dt: float,
        missing: Missing = None,
    ) -> Array:
        """(5)."""
        if missing is not None:
            y = np.where(missing, memory[0], y)  # innovation 0
        epsilon = self.model.epsilon
        x1_hat, x2_hat = memory[0], memory[1]
        mu = epsilon * (1.0 - y * y)
        l1 = (5.0 + mu if self.gain == "derived" else 5.0 - mu) * dt
        l2 = (5.0 - epsilon * (x1_hat + y) * x2_hat + (5.0 + mu) * mu) * dt
        e = y - x1_hat
        new = memory + self.model.drift(memory) * dt
        new[0] += l1 * e
        new[1] += l2 * e
        return new


class OwnSampledDataObserver(Law):
    """x_hat+ = x_hat + T f(x_hat, u) + K_T(x_hat, y): Fu, Kang, Li, eq. (5), for any f and K_T."""

    def __init__(self, spec: Spec) -> None:
        model = plant_from(member(spec, "model", "observer"), "model")
        if not isinstance(model, Own) or model.form != "sampled":
            raise fail("observer.model.kind", model.kind, "'own' of form 'sampled'", "change it")
        self.model = model
        self.n = self.memory_len = model.n
        self.n_u = model.n_u

    def residual(self, memory: Array, y: Array, t: float) -> Array:
        """y - h(x_hat)."""
        return y - self.model.sampled(memory, None, y, 0.0, 1.0)[2]

    def step(
        self,
        memory: Array,
        y: Array,
        u: Array | None,
        t: float,
        dt: float,
        missing: Missing = None,
    ) -> Array:
        """(5); without a sample x_hat + T f."""
        f, correction, _ = self.model.sampled(memory, u, y, t, dt)
        if missing is not None:
            correction = np.where(missing, 0.0, correction)
        return memory + f * dt + correction


class ReducedOrderObserver(Law):
    """The high-gain reduced-order observer: Katayama, eq. (8) and (22), H = diag(h_bar) / epsilon.

    z_hat(k+1) = (I - T H) z_hat(k) + T [H Psi(k) + f2(Psi(k), u(k))],
    Psi(k) = R'(y3(k)) (y(k+1) - y(k)) / T: y(k+1) closes the step k -> k+1, so the law filters.
    Memory: z_hat (3), y_last (3), u_held (2), time elapsed since y_last (0: no sample yet), and
    the period of the step that the next sample closes; the two differ after missing samples.
    """

    n = 3
    n_y = 3
    n_u = 2
    memory_len = 10
    filters = True

    def __init__(self, spec: Spec) -> None:
        model = plant_from(member(spec, "model", "observer"), "model")
        if not isinstance(model, Ship):
            raise fail("observer.model.kind", model.kind, "'ship'", "change the model")
        self.model = Ship()  # the observer knows neither delta_bar nor w
        self.h_bar = vector(member(spec, "h_bar", "observer"), "observer.h_bar", 3)
        if not np.all((self.h_bar > 0.0) & (self.h_bar < 1.0)):
            raise fail("observer.h_bar", self.h_bar.tolist(), "in (0, 1)", "see assumption A5")
        self.epsilon = number(member(spec, "epsilon", "observer"), "observer.epsilon", above=0.0)
        self._h = (self.h_bar / self.epsilon)[:, None]

    def velocity(self, memory: Array, y: Array) -> Array:
        """Psi = R'(y3_last) (y - y_last) / elapsed, shape (3, runs)."""
        y_last, elapsed = memory[3:6], memory[8]
        slope = (y - y_last) / elapsed
        sine, cosine = np.sin(y_last[2]), np.cos(y_last[2])
        return np.stack(
            (cosine * slope[0] + sine * slope[1], cosine * slope[1] - sine * slope[0], slope[2])
        )

    @property
    def signals(self) -> int:
        """The estimates."""
        return self.n

    def residual(self, memory: Array, y: Array, t: float) -> Array:
        """y - (y_last + elapsed R(y3_last) z_hat)."""
        z1, z2, z3 = memory[:3]
        y_last, elapsed = memory[3:6], memory[8]
        sine, cosine = np.sin(y_last[2]), np.cos(y_last[2])
        moved = np.stack((cosine * z1 - sine * z2, sine * z1 + cosine * z2, z3))
        return y - y_last - elapsed * moved

    def step(
        self,
        memory: Array,
        y: Array,
        u: Array | None,
        t: float,
        dt: float,
        missing: Missing = None,
    ) -> Array:
        """(22); over a missing sample z_hat += T f2(z_hat, u_held).

        Where f2 has no value (z1 = 0 = z2 - 1.18 z3: A1 fails) z_hat is held.
        """
        if u is None:
            raise fail("u", None, "of shape (2, runs)", "give the control held from this sample on")
        started = memory[8] > 0.0
        z_new = self.estimate(memory, y, missing)
        new = np.empty_like(memory)
        new[:3] = np.where(started & np.isfinite(z_new).all(axis=0), z_new, memory[:3])
        new[3:6] = y
        new[6:8] = u
        new[8:] = dt
        if missing is not None and missing.any():
            new[3:6] = np.where(missing, memory[3:6], new[3:6])
            new[8] = np.where(missing, np.where(started, memory[8] + dt, 0.0), dt)
        return new

    def estimate(self, memory: Array, y: Array, missing: Missing = None) -> Array:
        """z_hat at the sample ``y``; not finite where f2 has no value."""
        z_hat, u_held, period = memory[:3], memory[6:8], memory[9]
        psi = self.velocity(memory, y)
        # (I - T H) z_hat + T [H Psi + f2(Psi, u)] = z_hat + T [H (Psi - z_hat) + f2(Psi, u)]
        z_new = z_hat + period * (self._h * (psi - z_hat) + self.model.f2(psi, u_held))  # (22)
        if missing is not None and missing.any():
            z_new = np.where(missing, z_hat + period * self.model.f2(z_hat, u_held), z_new)
        return z_new

    def undefined(self, memory: Array, y: Array, missing: Missing = None) -> NDArray[np.bool_]:
        """Where f2 has no value, so that z_hat is held."""
        return (memory[8] > 0.0) & ~np.isfinite(self.estimate(memory, y, missing)).all(axis=0)


class CurrentLaw(Law):
    """A continuous law with current timing: predict over the past period, then correct.

    Memory: the law's, the time from the last sample used (or the start) to the next one, the period
    before that one (0: none yet), the inputs held over it.  Euler's correction is for the period, a
    placed one for the whole time.  The first sample corrects as if a period as long as the next one
    had passed.
    """

    filters = True

    def __init__(self, law: ContinuousLaw) -> None:
        self.law = law
        self.n, self.n_u = law.n, law.n_u
        self.memory_len = law.memory_len + 2 + law.n_u

    @property
    def signals(self) -> int:
        """The law's memory."""
        return self.law.memory_len

    def initial(self) -> Array:
        """The law's, and no sample yet."""
        return np.concatenate([self.law.initial(), np.zeros(2 + self.n_u)])

    def check(self, memory: Array) -> None:
        """As the law's."""
        self.law.check(memory[: self.law.memory_len])

    def before(self, memory: Array, t: float) -> tuple[Array, float]:
        """The law's memory predicted up to ``t``, and over which period (one for all runs)."""
        m = self.law.memory_len
        period = float(memory[m + 1, 0])
        held = memory[m + 2 :] if self.n_u else None
        if period == 0.0:
            return memory[:m].copy(), period
        return self.law.predict(memory[:m], held, t - period, period), period

    def residual(self, memory: Array, y: Array, t: float) -> Array:
        """y - predicted x_hat_1."""
        return y - self.before(memory, t)[0][0]

    def step(
        self,
        memory: Array,
        y: Array,
        u: Array | None,
        t: float,
        dt: float,
        missing: Missing = None,
    ) -> Array:
        """Predict, correct, remember."""
        before, period = self.before(memory, t)
        new = np.empty_like(memory)
        m = self.law.memory_len
        elapsed = memory[m]
        times = elapsed if self.law.method in PLACED else np.full_like(elapsed, period)
        times = np.where(times == 0.0, dt, times)
        for time in np.unique(times):  # gains are those of one time
            some = times == time
            told = None if u is None else u[:, some]
            absent = None if missing is None else missing[some]
            new[:m, some] = self.law.correct(before[:, some], y[some], told, float(time), absent)
        new[m] = dt if missing is None else np.where(missing, elapsed + dt, dt)
        new[m + 1] = dt
        if u is not None:
            new[m + 2 :] = u
        return new


LAWS: dict[str, type[Law]] = {
    "standard": StandardObserver,
    "low-power": LowPowerObserver,
    "peaking-free": PeakingFreeObserver,
    "collection": CollectionObserver,
    "modified": ModifiedObserver,
    "sampled-data": SampledDataObserver,
    "reduced-order": ReducedOrderObserver,
}


_CHAIN = ("n", "gain", "model", "method", "timing")
KEYS: dict[str, tuple[str, ...]] = {
    "standard": ("k", *_CHAIN),
    "low-power": ("alpha", "beta", *_CHAIN),
    "peaking-free": ("alpha", "beta", "saturation", "clip", *_CHAIN),
    "collection": ("k", "k_bar", "copies", *_CHAIN),
    "modified": ("k", "k_bar", "copies", *_CHAIN),
    "sampled-data": ("model", "gain"),
    "reduced-order": ("model", "h_bar", "epsilon"),
}


def law_from(spec: Spec) -> Law:
    """The law that ``spec`` describes."""
    kind = choice(member(spec, "kind", "observer"), "observer.kind", tuple(LAWS))
    known(spec, "observer", ("kind", *KEYS[kind]))
    law: Any = LAWS[kind]
    if kind == "sampled-data" and member(spec, "model", "observer").get("kind") == "own":
        law = OwnSampledDataObserver
    built: Law = law(spec)
    timing = choice(spec.get("timing", "predictor"), "observer.timing", TIMINGS)
    method = spec.get("method")
    if method in PLACED and isinstance(built, CollectionObserver):
        placed = "a method of step-by-step rates"
        raise fail("observer.method", method, placed, "eigenvalues are placed for single laws")
    if timing == "current" and isinstance(built, ContinuousLaw):
        return CurrentLaw(built)
    return built


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
        self.is_current = self.law.filters

    def initial(self) -> Array:
        """Memory to start from when nothing is known, (memory_len,)."""
        return self.law.initial()

    def step(
        self, memory: ArrayLike, y: ArrayLike, u: ArrayLike | None, t: float, dt: float
    ) -> tuple[Array, int]:
        """One sample: (memory after the step, status).

        ``memory``: (memory_len,); ``y``: scalar or (n_y,), NaN for a missing sample; ``u``: (n_u,)
        or None; ``t``, ``dt`` [s].  Status 0: sample used; 1: missing, the law predicted; 2: the
        model has no value at this sample, the estimate was held.
        """
        column = vector(memory, "memory", self.memory_len)[:, None]
        sample = np.asarray(y, dtype=np.float64).reshape(-1)
        if sample.shape != (self.n_y,):
            raise fail("y", np.shape(y), f"of {self.n_y} entries", "give one sample")
        number(t, "t")
        number(dt, "dt", above=0.0)
        control = None if self.n_u == 0 else vector([] if u is None else u, "u", self.n_u)[:, None]
        missing = np.array([not np.all(np.isfinite(sample))])
        measured = sample if self.n_y == 1 else sample[:, None]
        with np.errstate(all="ignore"):
            new = self.law.step(column, measured, control, t, dt, missing)[:, 0]
            undefined = self.law.undefined(column, measured, missing)
        return new, UNDEFINED if undefined[0] else MISSED if missing[0] else USED

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
        Returns "memory" (N, memory_len), before the use of y(k), or after it for the reduced-order
        law, which filters; "innovation" (N, n_y) = y - y_hat, not finite where y(k) is not;
        "status" (N,) as of ``step``; "missing" (N,).
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
        memory = vector(memory0, "memory0", self.memory_len)[:, None]
        self.law.check(memory)
        steps = np.diff(time) if dt is None else np.full(time.size - 1, dt)
        steps = np.append(steps, steps[-1] if steps.size else 0.0)
        missing = ~np.all(np.isfinite(samples), axis=1)
        memories = np.empty((time.size, self.memory_len))
        innovation = np.empty((time.size, self.n_y))
        status = np.where(missing, MISSED, USED).astype(np.uint8)
        with np.errstate(all="ignore"):
            for k in range(time.size):
                y_k = samples[k] if self.n_y == 1 else samples[k][:, None]
                u_k = None if control is None else control[k][:, None]
                mask = missing[k : k + 1]
                innovation[k] = self.law.residual(memory, y_k, float(time[k])).reshape(-1)
                if self.law.undefined(memory, y_k, mask)[0]:
                    status[k] = UNDEFINED
                if not self.law.filters:
                    memories[k] = memory[:, 0]
                memory = self.law.step(memory, y_k, u_k, float(time[k]), float(steps[k]), mask)
                if self.law.filters:
                    memories[k] = memory[:, 0]
        return {"memory": memories, "innovation": innovation, "status": status, "missing": missing}
