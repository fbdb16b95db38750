"""A model between samples: the flow of its states, its slopes and the noise that drives it.

All samples at once: the states of N samples move over the periods that follow them,

    x_{k+1} = f_k(x_k) + w_k,     F_k = df_k/dx,     cov w_k = int_0^dt exp(A s) Q exp(A s)' ds,

the flow f_k by two steps of Runge and Kutta's rule, F_k by the variational equation in the same
steps, as `HighGainEKF` moves, and A the chains alone, whose noise is exact.
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from hgo_rs.errors import HgoError, check, check_array, check_integer, explain
from hgo_rs.expressions import evaluate
from hgo_rs.models import InputGain, Model, System, Unknown
from hgo_rs.models.own.analysis import Jacobian
from hgo_rs.smoothing.samples import Array, Samples

SUBSTEPS = 2
"""Steps of the model between two samples."""

_SURE = 4.0  # a state's first deviation, of the RMS of its differences
_FORMS = ("phase", "chains", "triangular")
_MOST = 8  # states


class Motion:
    """A model of chains that is made of expressions, or chains of which nothing else is known.

    Attributes
    ----------
    model : Model or None
    orders : tuple of int
        Of the chains, an output each.
    names : tuple of str
        Of the states.
    first, last : tuple of int
        The states that are measured, and those at the ends of the chains.
    """

    model: Model | None
    orders: tuple[int, ...]
    names: tuple[str, ...]

    def __init__(self, model: System | None, order: int | None = None) -> None:
        if isinstance(model, InputGain):
            gain = {"b0": model.b0}
            model = Model(states=["x1", "x2"], inputs=["u"], parameters=gain, phi="b0*u")
        if model is None or isinstance(model, Unknown):
            n = check_integer(3 if order is None else order, "order", least=2, most=6)
            self.model, self.orders = None, (n,)
            self.names = tuple(f"x{i + 1}" for i in range(n))
        else:
            check(order is None, "order", order, "left out with a model", "leave it out")
            allowed = f"a Model of the form {', '.join(_FORMS)}, or None"
            fits = isinstance(model, Model) and model.form in _FORMS
            remedy = "write Model(states=[...], phi=...)"
            if isinstance(model, Model) and model.form == "nonlinear-chain":
                allowed += "; noise that enters a nonlinear chain is not that of a chain"
                remedy = "take y and its derivatives as states, with phi="
            check(fits, "model", model, allowed, remedy)
            assert isinstance(model, Model)
            if not model.compiled:
                told = f"made of expressions ({model.why_not_compiled})"
                raise HgoError(explain("model", model, told, "its slopes are needed: write these"))
            self.model, self.orders = model, model.orders or (model.n,)
            self.names = model.states
        ends = np.cumsum(self.orders)
        check(
            ends[-1] <= _MOST, "states of the model", int(ends[-1]), f"<= {_MOST}", "leave some out"
        )
        self.last = tuple(int(end) - 1 for end in ends)
        self.first = (0, *(end + 1 for end in self.last[:-1]))

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.names)

    @property
    def n_u(self) -> int:
        """Number of known inputs."""
        return 0 if self.model is None else self.model.n_u

    @property
    def shift(self) -> Array:
        """A of the chains."""
        a = np.eye(self.n, k=1)
        a[list(self.last), :] = 0.0
        return a

    @cached_property
    def _jacobian(self) -> Jacobian:
        assert self.model is not None
        return Jacobian(self.model.drift, self.model.states, self.model.parameters)

    def rate(self, t: Array, x: Array, u: Array) -> tuple[Array, Array]:
        """dx/dt (N, n) and its slopes (N, n, n) at N states."""
        if self.model is None:
            return x @ self.shift.T, np.broadcast_to(self.shift, (*x.shape, self.n))
        values: dict[str, Array | float] = {"t": t, **self.model.parameters}
        values |= dict(zip(self.names, x.T, strict=True))
        values |= dict(zip(self.model.inputs, u.T, strict=True))
        both = np.stack(evaluate([*self.model.drift, *self._jacobian.entries], values), axis=-1)
        return both[:, : self.n], both[:, self.n :].reshape(*x.shape, self.n)

    def ahead(self, t: Array, x: Array, u: Array, dt: Array) -> tuple[Array, Array]:
        """The states a time dt (N,) after t, (N, n), and F, (N, n, n)."""
        h = dt / SUBSTEPS
        f = np.broadcast_to(np.eye(self.n), (*x.shape, self.n))
        for substep in range(SUBSTEPS):
            begun = t + substep * h
            k: list[Array] = []
            w: list[Array] = []
            for part in (0.0, 0.5, 0.5, 1.0):
                s = part * h
                at, turned = (
                    (x, f) if not k else (x + s[:, None] * k[-1], f + s[:, None, None] * w[-1])
                )
                rate, slopes = self.rate(begun + s, at, u)
                k.append(rate)
                w.append(slopes @ turned)
            x = x + h[:, None] / 6.0 * (k[0] + 2.0 * (k[1] + k[2]) + k[3])
            f = f + h[:, None, None] / 6.0 * (w[0] + 2.0 * (w[1] + w[2]) + w[3])
        return x, f

    def noise(self, q: Array, dt: Array) -> Array:
        """Covariance of w over periods dt (N,), (N, n, n), for the intensity q (n, n)."""
        out = np.zeros((len(dt), self.n, self.n))
        powers = [np.linalg.matrix_power(self.shift, a) for a in range(max(self.orders))]
        for a, left in enumerate(powers):
            for b, right in enumerate(powers):
                whole = (a + b + 1) * math.factorial(a) * math.factorial(b)
                out += (dt ** (a + b + 1) / whole)[:, None, None] * (left @ q @ right.T)
        return out

    def intensity(self, q: object) -> Array:
        """Q as a matrix (n, n): of a number for the last state of each chain, one for each chain,
        one for each state, or a matrix.
        """
        given = check_array(q, "Q")
        sound = bool(np.all(np.isfinite(given)))
        check(sound, "Q", q, "finite", "give numbers, or leave it out")
        out = np.zeros((self.n, self.n))
        if given.shape in ((), (len(self.orders),)):
            out[self.last, self.last] = given
        elif given.shape == (self.n,):
            np.fill_diagonal(out, given)
        else:
            allowed = f"a number, ({len(self.orders)},), ({self.n},) or ({self.n}, {self.n})"
            check(given.shape == out.shape, "shape of Q", given.shape, allowed, "give one of these")
            check(np.array_equal(given, given.T), "Q", q, "symmetric", "give (Q + Q.T)/2")
            out = given
        least = float(np.min(np.linalg.eigvalsh(out)))
        positive = least >= -1e-12 * float(np.max(np.abs(out)))
        check(
            positive, "least eigenvalue of Q", least, ">= 0", "give intensities, variance a second"
        )
        return out

    def variances(self, r: object) -> Array:
        """R as one variance an output, (n_y,)."""
        given = check_array(r, "R")
        count = len(self.orders)
        check(
            given.shape in ((), (count,)),
            "shape of R",
            given.shape,
            f"({count},)",
            "give variances",
        )
        sound = bool(np.all(np.isfinite(given) & (given > 0.0)))
        check(sound, "R", r, "> 0 and finite", "give the variance of the samples' noise")
        return np.broadcast_to(given, (count,)).astype(np.float64)


def start(motion: Motion, samples: Samples) -> tuple[Array, Array]:
    """A first estimate, rest at the first samples, and its deviations: so large that they bind
    nothing.
    """
    x, deviation = np.zeros(motion.n), np.empty(motion.n)
    for channel, order in enumerate(motion.orders):
        i = motion.first[channel]
        x[i] = samples.first(channel)
        for j in range(order):
            rate = samples.rate(channel, j)
            deviation[i + j] = _SURE * max(rate, np.finfo(np.float64).tiny ** 0.25)
    return x, deviation
