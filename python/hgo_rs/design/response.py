"""What an observer does to noise, to signals and to a wrong start, from its matrices.

All of it is exact for a law with a constant gain (a gain that moves is frozen) with its model left
out: the known nonlinearity is small beside a gain that deserves the name high.  Each function
takes the spec of an observer; with ``dt`` [s] the observer as it runs, by its discretisation and
timing, without it the law in continuous time.  Results have one entry an estimate, shape (n,).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from . import _checks
from ._checks import Array
from .discrete import Continuous, Discrete, continuous, discrete, following, linear

_POINTS = 300  # frequencies looked at before a crossing is refined
_LONGEST = 2**20  # samples of a decay


def bandwidth(
    observer: Mapping[str, Any], dt: float | None = None, *, gain: float | None = None
) -> Array:
    """Cutoff [rad/s] of y -> x_hat_i: the first frequency at which it gives less than 1/sqrt(2)
    (-3 dB) of the ideal derivative's amplitude, omega^(i-1); infinite where it never does below
    the Nyquist frequency pi/dt.

    The response is x_hat_i(z)/y(z) = c_i (z - a)^-1 b + d_i at z = exp(j omega dt), or
    [(s - M)^-1 G]_i at s = j omega: Astolfi et al., section 5, for the laws in continuous time.

    Raises DesignError for a step that is not stable.
    """
    system = _system(observer, dt, gain)
    if isinstance(system, Continuous):
        poles = np.abs(np.linalg.eigvals(system.closed))
        slow, highest = float(np.min(poles)), 1e3 * float(np.max(poles))
        a, b, c = system.closed, system.g[:, None], np.eye(system.g.size)[: system.n]
        d = np.zeros((system.n, 1))
    else:
        a, b, c, d = system.scaled
        step = system.ell * system.dt
        slow, highest = -math.log(max(system.radius, 1e-9)) / step, np.pi / step

    def amplitude(w: Array, i: int, channel: int, power: int) -> Array:
        """|x_hat_i/y| over omega^power, at frequencies in units of ell."""
        z = 1j * w if dt is None else np.exp(1j * w * step)
        states = np.linalg.solve(z[:, None, None] * np.eye(len(a)) - a, b[:, channel, None])
        return np.asarray(np.abs((c[i] @ states)[:, 0] + d[i, channel]) / w**power)

    level = math.sqrt(0.5)
    out = np.full(len(c), math.inf)
    several = b.shape[1] > 1  # reduced-order: estimate i is the first derivative of output i
    for i in range(len(c)):
        channel, power = (i, 1) if several else (0, i)
        # below 1e-10^(1/power), rounding drowns what is left of the derivative
        lowest = max(0.02 * slow, 1e-10 ** (1.0 / power) if power else 0.0)
        grid = np.geomspace(min(lowest, 0.5 * highest), highest, _POINTS)
        below = np.flatnonzero(amplitude(grid, i, channel, power) < level)
        if below.size:
            ends = grid[max(int(below[0]), 1) - 1], grid[max(int(below[0]), 1)]
            found = _crossing(
                lambda w, *which: float(amplitude(np.array([w]), *which)[0]) - level,
                *ends,
                (i, channel, power),
            )
            out[i] = system.ell * found
    return out


def _crossing(
    f: Callable[..., float], low: float, high: float, arguments: tuple[int, ...]
) -> float:
    from scipy.optimize import brentq

    if f(low, *arguments) <= 0.0:
        return low
    return float(brentq(f, low, high, args=arguments, rtol=1e-12))


def noise_gain(
    observer: Mapping[str, Any], dt: float | None = None, *, gain: float | None = None
) -> Array:
    """Variance of each estimate per unit variance of white measurement noise, one value a sample.

    diag(c P c' + d d') with P = a P a' + b b' (discrete Lyapunov equation).  Without ``dt``: per
    unit spectral density of white noise in continuous time, diag(P) with M P + P M' + G G' = 0;
    noise of variance R sampled with a small period dt has the density R dt, so that
    noise_gain(dt)/dt tends to noise_gain() as dt -> 0.

    Raises DesignError for a step that is not stable.
    """
    from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

    system = _system(observer, dt, gain)
    if isinstance(system, Continuous):
        p = solve_continuous_lyapunov(system.closed, -np.outer(system.g, system.g))
        # in time of 1/ell the noise has ell times the density
        return np.asarray((system.scale**2 * np.diag(p) * system.ell)[: system.n])
    a, b, c, d = system.scaled
    p = solve_discrete_lyapunov(a, b @ b.T)
    n = len(c)
    scale = system.scale[:n]
    return np.asarray(scale**2 * (np.diag(c @ p @ c.T) + np.sum(d * d, axis=1)))


def model_gain(
    observer: Mapping[str, Any], dt: float | None = None, *, gain: float | None = None
) -> Array:
    """Variance of each estimate's error per unit spectral density of white noise in x_n'.

    Such noise w, x_n' = phi + w, stands for what the model lacks; its density has the unit
    (that of x_n)^2/s.  M P + P M' + B B' = 0; with ``dt`` P = a P a' + W, where the plant moves by
    noise of covariance W = int_0^dt exp(A s) B B' exp(A s)' ds.  What a method errs by
    on a moving signal is not counted ("zoh" does not).

    Raises DesignError for a step that is not stable, and for a law that lags behind ("cascade" from
    order 3 on).
    """
    return _covariance_of_model(observer, dt, gain)[1]


def innovation_gain(
    observer: Mapping[str, Any], dt: float, *, gain: float | None = None
) -> tuple[float, float]:
    """Variance of the innovation y - x_hat_1 (before the sample is used) per unit variance of the
    measurement noise, and per unit spectral density of white noise in x_n'.
    """
    of_noise, of_model = innovation_covariance(observer, dt, 0, gain=gain)[:, 0].tolist()
    return of_noise, of_model


def innovation_covariance(
    observer: Mapping[str, Any], dt: float, lags: int, *, gain: float | None = None
) -> Array:
    """Autocovariance of the innovation at the lags 0, 1, ..., `lags` samples, (2, lags + 1): per
    unit variance of white measurement noise; per unit spectral density of white noise in x_n'.

    With the error z+ = a z + b v - w and the innovation v - z_1: the first entry of
    a^(j-1) (a P C' - b R) at lag j > 0 (Mehra, IEEE TAC 15, 1970).  Zero at all of them for the
    Kalman filter alone.
    """
    from scipy.linalg import solve_discrete_lyapunov

    system = _system(observer, dt, gain)
    assert isinstance(system, Discrete)
    a, b, _, _ = system.scaled
    p = solve_discrete_lyapunov(a, b @ b.T)
    out = np.empty((2, lags + 1))
    model = _covariance_of_model(observer, dt, gain)[0]
    out[:, 0] = 1.0 + p[0, 0], model[0]
    moved = np.stack([a @ p[:, 0] - b[:, 0], a @ model])
    for j in range(1, lags + 1):
        out[:, j] = moved[:, 0]
        moved = moved @ a.T
    return out


def _covariance_of_model(
    observer: Mapping[str, Any], dt: float | None, gain: float | None
) -> tuple[Array, Array]:
    """Covariances of x_1 - x_hat_1 with the errors of all states before the sample is used (scaled
    by powers of the gain), and variances of the shown errors.
    """
    from scipy.linalg import solve_continuous_lyapunov, solve_discrete_lyapunov

    law = linear(observer, gain=gain)
    system = _system(observer, dt, gain)
    n = law.n
    factor = law.ell ** (1.0 - 2.0 * n)
    size = None if isinstance(system, Continuous) else len(system.a)
    lift = following(observer, size)  # z = L x without errors
    kind, allowed = observer["kind"], "a law that follows the chain's own motion"
    remedy = "its lag behind a random walk is unbounded; take another law"
    follows = bool(np.allclose(lift[:n], np.eye(n), atol=1e-6))
    _checks.demand(follows, "kind", kind, allowed, remedy)
    if isinstance(system, Continuous):
        end = lift[:, -1]  # x_n and, in low-power laws, eta_{n-1}
        p = solve_continuous_lyapunov(law.closed, -np.outer(end, end))
        # in time of 1/ell and scaled by ell^(n-1) the noise has the density ell^(1-2n)
        errors = law.scale**2 * np.diag(p) * factor
        return p[:, 0] * factor, errors[:n]
    a, _, c, _ = system.scaled
    step = law.ell * system.dt
    # The plant in the same scaled coordinates moves by int exp(A s) B dw.
    left = np.arange(n - 1, -1, -1)
    each = step**left / np.array([math.factorial(j) for j in left])
    covariance = step * np.outer(each, each) / (left[:, None] + left + 1.0)
    # z - L x; a method that moves the chain inexactly errs more.
    p = solve_discrete_lyapunov(a, lift @ covariance @ lift.T)
    shown = np.diag(c @ p @ c.T)
    return p[:, 0] * factor, np.asarray(system.scale[:n] ** 2 * shown * factor)


def peaking(
    observer: Mapping[str, Any], dt: float | None = None, *, gain: float | None = None
) -> Array:
    """Largest |x_hat_i - x_i| over time after a start with x_hat_1 wrong by 1, all else right.

    Grows as ell^(i-1): Astolfi et al., section 2; Lee et al., section 2.  max_t |[exp(M t)]_{i1}|,
    or over the samples k of |c a^k|, with ``dt`` (reduced-order: estimate i itself starts wrong by
    1).  Peaking-free: as if its saturations were not there; they bound what is passed on.

    Raises DesignError for a step that is not stable.
    """
    _, errors = _decay(observer, dt, gain)
    return np.asarray(np.max(errors, axis=1))


def settling(
    observer: Mapping[str, Any],
    dt: float | None = None,
    *,
    within: float = 0.02,
    gain: float | None = None,
) -> Array:
    """Time [s] after which the error of x_hat_i stays below ``within`` times its largest value,
    from the start of ``peaking``.

    Raises DesignError for a step that is not stable, or ``within`` outside (1e-6, 1).
    """
    part = _checks.number(within, "within", above=1e-6, below=1.0)
    period, errors = _decay(observer, dt, gain)
    out = np.empty(len(errors))
    for i, error in enumerate(errors):
        above = np.flatnonzero(error > part * np.max(error))
        out[i] = (above[-1] + 1) * period if above.size else 0.0  # never wrong
    return out


def _decay(
    observer: Mapping[str, Any], dt: float | None, gain: float | None
) -> tuple[float, Array]:
    """The time between samples and |errors| (n, samples) after unit starts, until they are gone."""
    from scipy.linalg import expm

    system = _system(observer, dt, gain)
    if isinstance(system, Continuous):
        poles = np.linalg.eigvals(system.closed)
        period = 0.01 / float(np.max(np.abs(poles)))
        a = expm(period * system.closed)
        c = np.eye(len(a))[: system.n]
        period /= system.ell
        scale = system.scale
    else:
        a, _, c, _ = system.scaled
        period, scale = system.dt, system.scale
    radius = float(np.max(np.abs(np.linalg.eigvals(a))))
    samples = 16.0 if radius < 0.3 else 32.0 + 1.5 * len(a) + math.log(1e-9) / math.log(radius)
    remedy = "choose a larger step or gain, or poles that are nearer to one another"
    _checks.demand(samples <= _LONGEST, "samples of the decay", samples, f"<= {_LONGEST}", remedy)
    each = observer["kind"] == "reduced-order"
    errors = np.empty((len(c), math.ceil(samples)))
    states: Array = np.eye(len(a))[:, : len(c) if each else 1]
    # a^k for all k, by doubling: (m, starts, 2^j)
    track, power = states[:, :, None], a
    while track.shape[2] < errors.shape[1]:
        track = np.concatenate([track, np.tensordot(power, track, axes=1)], axis=2)
        power = power @ power
    shown = np.tensordot(c, track[:, :, : errors.shape[1]], axes=1)
    for i in range(len(c)):
        errors[i] = np.abs(shown[i, i if each else 0])
    return period, errors * scale[: len(c), None]


# --- systems ----------------------------------------------------------------------------------


def _system(
    observer: Mapping[str, Any], dt: float | None, gain: float | None
) -> Continuous | Discrete:
    """The law in continuous time, or as it runs; stable."""
    if dt is None:
        return continuous(observer, gain=gain)
    system = discrete(observer, dt, gain=gain)
    allowed = f"a stable step (its spectral radius is {system.radius:.6g})"
    remedy = 'choose a smaller dt or gain, or method "zoh"'
    _checks.demand(system.radius < 1.0, "dt", dt, allowed, remedy)
    return system
