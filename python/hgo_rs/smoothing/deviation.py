"""Standard deviations of an observer's estimates, by the recursion of its own error.

An observer need not have the gains of a Kalman filter.  Linearised along its estimates, with the
law z+ = a z + b y, x_hat = c z + d y of `hgo_rs.design.discrete` (model left out), what follows the
chain as z = L x, and the slopes F_k of the model over each period in place of the chain's A,

    e+ = [a + L (F_k - A) c] e + [b + L (F_k - A) d] nu - L w,       x_hat - x = c e + d nu,

nu of variance R, w the model error of intensity Q over the period.  Without a sample the innovation
is 0: y stands for the first entry of z.  A `HighGainEKF` corrects by K_k = P_k C'/R of its own P_k.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.linalg import matrix_power

from hgo_rs.design.discrete import discrete, following
from hgo_rs.errors import HgoError, check, check_array, check_number
from hgo_rs.observers import Observer, RunResult
from hgo_rs.smoothing.motion import Motion, start
from hgo_rs.smoothing.samples import Array, Samples

_CLOSE = 3  # decimals of a step over the usual one, that laws are computed for


class Assumed:
    """What is assumed of an observer's record: its chains, their noise and the model error.

    noise : float or (n_y,)
        Standard deviation of the samples' noise, sqrt(R).
    model_error : float or (n_y,)
        sqrt(Q), Q the intensity of white noise in the last state of each chain.
    """

    def __init__(self, observer: Observer, noise: Any, model_error: Any) -> None:
        self.observer = observer
        self.specs = [dict(part) for part in observer.spec.get("observers", [observer.spec])]
        unknown = getattr(observer.model, "unknown", ())
        remedy = "leave noise and model_error out"
        check(not unknown, "unknown of the model", unknown, "none for deviations", remedy)
        shapes = [spec["shape"] for spec in self.specs if spec.get("shape")]
        check(not shapes, "shape of the observer", shapes, "none for deviations", remedy)
        order = observer.n if observer.model is None else None
        self.motion = Motion(observer.model, order)
        fits = [int(spec["n"]) for spec in self.specs] == list(self.motion.orders)
        told = "of one chain an output, as the model's"
        check(fits, "observer", type(observer).__name__, told, remedy)
        spread = check_array(noise, "noise")
        give = "give the standard deviation of y"
        check(bool(np.all(spread > 0.0)), "noise", noise, "> 0", give)
        lack = check_array(model_error, "model_error")
        give = "give the square root of an intensity"
        check(bool(np.all(lack >= 0.0)), "model_error", model_error, ">= 0", give)
        self.r = self.motion.variances(spread**2)
        self.q = self.motion.intensity(lack**2)

    @property
    def filters(self) -> bool:
        """Whether the gains are those of a covariance."""
        return hasattr(self.observer, "covariance") and self.specs[0]["kind"] == "high-gain-ekf"


def deviation(
    observer: Observer,
    run: RunResult,
    u: Array,
    noise: Any,
    model_error: Any,
    p0: Array | None = None,
) -> Array:
    """Standard deviations (N, n) of the estimates of a run; noise and model error as `Assumed`.

    `p0` is the covariance (n, n) of the start; default: so large that it binds nothing.
    """
    assumed = Assumed(observer, noise, model_error)
    motion, specs = assumed.motion, assumed.specs
    samples = Samples(np.array(run.time), np.array(run.y), np.asarray(u, dtype=np.float64))
    f, w = _moves(motion, samples, np.asarray(run.x_hat), assumed.q)
    if assumed.filters:
        covariance = observer.covariance(run.memory)  # type: ignore[attr-defined]
        own = np.array([float(np.ravel(spec["R"])[0]) for spec in specs])
        theta = np.array([float(spec["gain"]["ell"]) for spec in specs])
        gain = covariance[:, :, list(motion.first)] / (own / theta)
        p0 = np.diag(start(motion, samples)[1] ** 2)
        return _of_filter(motion, samples, gain, f, w, p0, assumed.r)
    recursion = Recursion(assumed, samples, f, w, p0)
    present = np.isfinite(samples.y)
    return np.sqrt([recursion.step(k, present[k]) for k in range(len(present))])


def gated(
    observer: Observer,
    clock: float | Array,
    y: Array,
    u: Array,
    begin: Array,
    noise: Any,
    model_error: Any,
    gate: Any,
) -> Any:
    """Samples (N, n_y) whose innovation is more than `gate` of its standard deviations; each is
    left out before the next one is judged.

    The slopes are those along the estimate with all samples.
    """
    gate = check_number(gate, "gate", above=0.0)
    both = noise is not None and model_error is not None
    remedy = "hgo_rs.tune finds both in a log"
    check(both, "gate", gate, "given with noise and model_error", remedy)
    assumed = Assumed(observer, noise, model_error)
    motion, core = assumed.motion, observer._core
    t = np.arange(len(y), dtype=np.float64) * clock if isinstance(clock, float) else clock
    samples = Samples(np.asarray(t, dtype=np.float64), y, u)
    track = core.run(clock, y, u, begin)
    recursion = None
    if not assumed.filters:
        f, w = _moves(motion, samples, track["memory"][:, : observer.n], assumed.q)
        recursion = Recursion(assumed, samples, f, w)
    first, turns = list(motion.first), observer.wrap
    memory, out = np.array(begin), np.zeros(y.shape, dtype=bool)
    current = observer.timing == "current"
    dt = samples.dt
    for k in range(len(y)):
        e = y[k] - memory[first]
        for channel, turn in enumerate(turns):
            if turn is not None:
                e[channel] -= turn * np.round(e[channel] / turn)
        if recursion is not None:
            variance = recursion.before()
        else:
            p = observer.covariance(memory)  # type: ignore[attr-defined]
            variance = np.diagonal(p)[first] + assumed.r
        # the first sample of a filter is where its estimate starts
        out[k] = (np.abs(e) > gate * np.sqrt(variance)) & (k > 0)
        used = np.where(out[k], np.nan, y[k])
        if recursion is not None:
            recursion.step(k, np.isfinite(used))
        if current:
            memory = core.correct(memory, used, float(t[k]))[0]
        if k < len(dt):
            memory = core.advance(memory, used, u[k], float(t[k]), float(dt[k]))[0]
    return out


def _moves(motion: Motion, samples: Samples, x: Array, q: Array) -> tuple[Array, Array]:
    """F and the covariance of w over each period, (N - 1, n, n) both."""
    with np.errstate(all="ignore"):
        _, f = motion.ahead(samples.t[:-1], x[:-1], samples.u[:-1], samples.dt)
    if not np.isfinite(f).all():
        raise HgoError(
            "the model's slopes along the estimate are not finite: no deviations; check it"
        )
    return f, motion.noise(q, samples.dt)


def _of_filter(
    motion: Motion, samples: Samples, gain: Array, f: Array, w: Array, p: Array, r: Array
) -> Array:
    """Of a filter with gains K_k, (N, n)."""
    out = np.empty((len(samples.t), motion.n))
    first = list(motion.first)
    there = np.isfinite(samples.y)
    there[0] = False  # the first sample is where the estimate starts
    eye = np.eye(motion.n)
    for k in range(len(out)):
        if k:
            p = f[k - 1] @ p @ f[k - 1].T + w[k - 1]
        used = gain[k] * there[k]
        rest = eye.copy()
        rest[:, first] -= used
        p = rest @ p @ rest.T + (used * r) @ used.T
        out[k] = np.diag(p)
    return np.sqrt(out)


class Recursion:
    """The covariance of an observer's error, of laws with constant gains, from sample to sample."""

    def __init__(
        self, assumed: Assumed, samples: Samples, f: Array, w: Array, p0: Array | None = None
    ) -> None:
        self._motion, self._specs, self._r = assumed.motion, assumed.specs, assumed.r
        self._f, self._w = f, w
        self._usual = float(np.median(samples.dt))
        parts = np.round(samples.dt / self._usual, _CLOSE)
        self._parts = np.append(parts, parts[-1:])
        sizes = [len(discrete(spec, self._usual).a) for spec in self._specs]
        lifts = list(map(following, self._specs, sizes))
        self._lift = _diagonal(lifts)
        self._begins = np.cumsum([0, *(len(lift) for lift in lifts[:-1])])
        if p0 is None:
            p0 = np.diag(start(self._motion, samples)[1] ** 2)
        self._z = self._lift @ p0 @ self._lift.T
        self._law = lru_cache(maxsize=4096)(self._made)

    def _made(self, part: float, there: tuple[bool, ...]) -> tuple[Array, ...]:
        """a, b, c, d and A over a step, of a usual one, with the outputs that are there."""
        dt = self._usual * max(part, 10.0**-_CLOSE)
        found = [discrete(spec, dt) for spec in self._specs]
        a, b, c, d = (_diagonal([getattr(one, name) for one in found]) for name in "abcd")
        for channel, begin in enumerate(self._begins.tolist()):
            if not there[channel]:
                a[:, begin] += b[:, channel]
                c[:, begin] += d[:, channel]
                b[:, channel], d[:, channel] = 0.0, 0.0
        shift = self._motion.shift
        powers = range(max(self._motion.orders))
        chain = sum(matrix_power(shift, j) * dt**j / math.factorial(j) for j in powers)
        return a, b, c, d, np.asarray(chain)

    def before(self) -> Array:
        """Variances of the innovations of the sample that comes next, (n_y,)."""
        return np.asarray(np.diagonal(self._z)[self._begins] + self._r)

    def step(self, k: int, there: Any) -> Array:
        """Variances of the estimates at sample k, (n,); then on to the next one."""
        a, b, c, d, chain = self._law(float(self._parts[k]), tuple(there.tolist()))
        shown = np.diag(c @ self._z @ c.T + (d * self._r) @ d.T)
        if k < len(self._f):
            extra = self._lift @ (self._f[k] - chain)
            m, gain = a + extra @ c, b + extra @ d
            moved = m @ self._z @ m.T + (gain * self._r) @ gain.T
            self._z = moved + self._lift @ self._w[k] @ self._lift.T
        return np.asarray(shown)


def _diagonal(blocks: list[Array]) -> Array:
    """Blocks along the diagonal."""
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks), dtype=np.float64)
