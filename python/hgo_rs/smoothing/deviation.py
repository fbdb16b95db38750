"""Standard deviations of an observer's estimates, by the recursion of its own error.

An observer need not have the gains of a Kalman filter.  Linearised along its estimates, with the
law z+ = a z + b y, x_hat = c z + d y of `hgo_rs.design.discrete` (model left out), what follows the
chain as z = L x, and the slopes F_k of the model over each period in place of the chain's A,

    e+ = [a + L (F_k - A) c] e + [b + L (F_k - A) d] nu - L w,       x_hat - x = c e + d nu,

nu of variance R, w the model error of intensity Q over the period.  Without a sample the innovation
is 0: y stands for the first entry of z.  A `HighGainEKF` corrects by K_k = P_k C'/R of its own P_k.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.linalg import matrix_power

from hgo_rs.design.discrete import discrete, following
from hgo_rs.errors import HgoError, check, check_array
from hgo_rs.observers import Observer, RunResult
from hgo_rs.smoothing.motion import Motion, start
from hgo_rs.smoothing.samples import Array, Samples

_CLOSE = 3  # decimals of a step over the usual one, that laws are computed for


def deviation(observer: Observer, run: RunResult, u: Array, noise: Any, model_error: Any) -> Array:
    """Standard deviations (N, n) of the estimates of a run.

    noise : float or (n_y,)
        Standard deviation of the samples' noise, sqrt(R).
    model_error : float or (n_y,)
        sqrt(Q), Q the intensity of white noise in the last state of each chain.
    """
    specs = [dict(part) for part in observer.spec.get("observers", [observer.spec])]
    unknown = getattr(observer.model, "unknown", ())
    remedy = "leave noise and model_error out"
    check(not unknown, "unknown of the model", unknown, "none for deviations", remedy)
    order = observer.n if observer.model is None else None
    motion = Motion(observer.model, order)
    fits = [int(spec["n"]) for spec in specs] == list(motion.orders)
    told = "of one chain an output, as the model's"
    check(fits, "observer", type(observer).__name__, told, "leave noise and model_error out")
    spread = check_array(noise, "noise")
    check(bool(np.all(spread > 0.0)), "noise", noise, "> 0", "give the standard deviation of y")
    lack = check_array(model_error, "model_error")
    sound = bool(np.all(lack >= 0.0))
    check(sound, "model_error", model_error, ">= 0", "give the square root of an intensity")
    r, q = motion.variances(spread**2), motion.intensity(lack**2)
    samples = Samples(np.array(run.time), np.array(run.y), np.asarray(u, dtype=np.float64))
    f, noise_of = _moves(motion, samples, np.asarray(run.x_hat), q)
    p0 = np.diag(start(motion, samples)[1] ** 2)
    if hasattr(observer, "covariance") and specs[0]["kind"] == "high-gain-ekf":
        covariance = observer.covariance(run.memory)
        own = np.array([float(np.ravel(spec["R"])[0]) for spec in specs])
        theta = np.array([float(spec["gain"]["ell"]) for spec in specs])
        gain = covariance[:, :, list(motion.first)] / (own / theta)
        return _of_filter(motion, samples, gain, f, noise_of, p0, r)
    return _of_law(motion, samples, specs, f, noise_of, p0, r)


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


def _of_law(
    motion: Motion,
    samples: Samples,
    specs: list[dict[str, Any]],
    f: Array,
    w: Array,
    p: Array,
    r: Array,
) -> Array:
    """Of laws with constant gains, one for each chain, (N, n)."""
    usual = float(np.median(samples.dt))
    parts = np.round(samples.dt / usual, _CLOSE)
    lift = _diagonal([following(spec) for spec in specs])
    n, size = motion.n, len(lift)
    begins = np.cumsum([0, *(len(following(spec)) for spec in specs[:-1])])

    @lru_cache(maxsize=4096)
    def law(part: float, there: tuple[bool, ...]) -> tuple[Array, ...]:
        """a, b, c, d and A over a step, of a usual one, with the outputs that are there."""
        dt = usual * max(part, 10.0**-_CLOSE)
        found = [discrete(spec, dt) for spec in specs]
        a, b, c, d = (_diagonal([getattr(one, name) for one in found]) for name in "abcd")
        for channel, begin in enumerate(begins.tolist()):
            if not there[channel]:
                a[:, begin] += b[:, channel]
                c[:, begin] += d[:, channel]
                b[:, channel], d[:, channel] = 0.0, 0.0
        chain = np.asarray(
            sum(
                matrix_power(motion.shift, j) * dt**j / _factorial(j)
                for j in range(max(motion.orders))
            )
        )
        return a, b, c, d, chain

    z = np.zeros((size, size))
    z = lift @ p @ lift.T
    out = np.empty((len(samples.t), n))
    present = np.isfinite(samples.y)
    last = float(parts[-1]) if len(parts) else 1.0
    for k in range(len(out)):
        part = float(parts[k]) if k < len(parts) else last
        a, b, c, d, chain = law(part, tuple(present[k].tolist()))
        out[k] = np.diag(c @ z @ c.T + (d * r) @ d.T)
        if k < len(parts):
            extra = lift @ (f[k] - chain)
            m, gain = a + extra @ c, b + extra @ d
            z = m @ z @ m.T + (gain * r) @ gain.T + lift @ w[k] @ lift.T
    return np.sqrt(out)


def _factorial(j: int) -> float:
    return float(np.prod(np.arange(1, j + 1)))


def _diagonal(blocks: list[Array]) -> Array:
    """Blocks along the diagonal."""
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*blocks), dtype=np.float64)
