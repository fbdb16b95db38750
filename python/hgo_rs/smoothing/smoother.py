"""The state at each sample of a record, by all samples before and after it.

Rauch, Tung and Striebel (AIAA Journal 3, 1965), over the extended Kalman filter: with what the
filter knows, x_k of covariance P_k, and what it predicts, x-_{k+1} = f_k(x_k) of covariance
P-_{k+1} = F_k P_k F_k' + W_k, from the end on

    G_k = P_k F_k' (P-_{k+1})^-1,
    x^s_k = x_k + G_k (x^s_{k+1} - x-_{k+1}),
    P^s_k = (1 - G_k F_k) P_k (1 - G_k F_k)' + G_k (P^s_{k+1} + W_k) G_k',

whose sum of positive terms is P_k + G_k (P^s_{k+1} - P-_{k+1}) G_k' and stays positive.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hgo_rs.errors import HgoError, check_choice
from hgo_rs.models import System
from hgo_rs.observers.whiteness import normality, whiteness
from hgo_rs.smoothing.forward import Forward, forward
from hgo_rs.smoothing.likelihood import noises
from hgo_rs.smoothing.motion import Motion
from hgo_rs.smoothing.result import Smoothed
from hgo_rs.smoothing.samples import Array, Given, Samples

_BETTER = 1.4  # by which a chain must meet left-out samples better than the model
_LEAST_LEFT = 1e-9  # of a sample's weight


def smooth(
    model: System | None,
    log: Given,
    *,
    R: Any = None,
    Q: Any = None,
    order: int | None = None,
    structure: str = "auto",
    progress: Callable[[int], None] | None = None,
) -> Smoothed:
    """The states of a record, each from all samples before and after it, with standard deviations.

    Fixed-interval smoothing (Rauch, Tung, Striebel 1965) over the extended Kalman filter of the
    model. It uses the whole record; a filter uses past samples only.

    Parameters
    ----------
    model : Model, InputGain or None
        Of one chain or several, or triangular; made of expressions. None: a chain of order
        `order` whose last derivative is white noise.
    log : Log, frame, (t, y) or (t, y, u)
        t (N,) [s], or a period; y (N,) or (N, n_y), NaN where a sample is missing; u (N,) or
        (N, n_u), each held until the next sample. A frame or series holds its times.
    R : float or (n_y,), optional
        Variance of the noise of a sample [unit of y^2]. Default: by maximum likelihood.
    Q : float, (n_y,), (n,) or (n, n), optional
        Intensity of white noise in x': for the last state of the chains, for each state, or a
        matrix; entry (i, j) in units of x_i x_j/s. Default: as R, for the last state of each
        chain.
    order : int, optional
        Without a model, 2 to 6. Default: 3.
    structure : "auto" or "model"
        With one chain and without R and Q, "auto" also smooths the samples by a chain two orders
        higher without the model, and uses it if cross-validation is much better: fast samples with
        little noise may determine the states better than a wrong model.
    progress : callable, optional
        Called with the number of filters run so far.

    Returns
    -------
    Smoothed

    Raises
    ------
    HgoError
        A model of another form or of Python functions; shapes that do not fit; fewer than 20
        samples; times that do not increase; a filter that diverges.

    Warns
    -----
    TurnWarning
        An output that jumps by the turn of an angle or a counter.
    """
    check_choice("structure", structure, ("auto", "model"))
    motion = Motion(model, order)
    samples = Samples.of(log, len(motion.orders), motion.n_u)
    samples.warn_of_turns(stacklevel=2)
    return of_samples(motion, samples, R, Q, structure, progress)


def of_samples(
    motion: Motion,
    samples: Samples,
    R: Any = None,
    Q: Any = None,
    structure: str = "auto",
    progress: Callable[[int], None] | None = None,
) -> Smoothed:
    """As `smooth`."""
    r = None if R is None else motion.variances(R)
    q = None if Q is None else motion.intensity(Q)
    remarks: list[str] = []
    found = noises(motion, samples, r, q, remarks.append, progress)
    known = forward(motion, samples, *found)
    own = smoothed(motion, samples, known, *found, tuple(remarks))
    # of states that are derivatives of y, each in its place
    phase = motion.model is not None and motion.model.form == "phase" and not motion.model.unknown
    if structure == "model" or R is not None or Q is not None or not phase or motion.n > 4:
        return own
    chain = Motion(None, motion.n + 2)
    bare = Samples(samples.t, samples.y, samples.u[:, :0])
    try:
        found = noises(chain, bare, None, None, remarks.append, progress)
        other = smoothed(chain, bare, forward(chain, bare, *found), *found, tuple(remarks))
    except HgoError:  # of a record that moves too fast for a chain
        return own
    if not _BETTER * left_out(other) < left_out(own):
        return own
    told = (
        f"cross-validation error {left_out(other):.3g} for a chain of order {chain.n} without the "
        f"model, {left_out(own):.3g} for the model: the chain is used"
    )
    return other.of_states(motion.names, told)


def left_out(run: Smoothed) -> float:
    """RMS of what a sample is off the state by all others: its residual over 1 - P^s/R."""
    there = np.isfinite(run.y[:, 0])
    there[[0, -1]] = False  # the ends have neighbours on one side
    i = run.outputs[0]
    share = run.covariance[there, i, i] / run.R[0]
    rest = (run.y[there, 0] - run.x[there, i]) / np.maximum(1.0 - share, _LEAST_LEFT)
    return float(np.sqrt(np.mean(rest**2)))


def smoothed(
    motion: Motion, samples: Samples, known: Forward, r: Array, q: Array, remarks: tuple[str, ...]
) -> Smoothed:
    """The result, from what the filter knows."""
    x, p = backward(motion, samples, known, q)
    used = known.count > 0.0
    standard = np.sqrt(known.squares[used] / known.count[used])
    standard = np.copysign(standard, known.innovation[used, 0])
    return Smoothed(
        t=samples.t,
        x=x,
        covariance=p,
        filtered=known.x,
        y=samples.y,
        innovation=known.innovation,
        states=motion.names,
        outputs=motion.first,
        R=r,
        Q=q,
        log_likelihood=-0.5 * known.loss,
        whiteness=whiteness(standard),
        normality=normality(standard),
        remarks=remarks,
    )


def backward(motion: Motion, samples: Samples, known: Forward, q: Array) -> tuple[Array, Array]:
    """Smoothed states (N, n) and their covariances (N, n, n)."""
    t, dt, u = samples.t[:-1], samples.dt, samples.u[:-1]
    x, p = known.x.copy(), known.p.copy()
    ahead, f = motion.ahead(t, x[:-1], u, dt)
    noise = motion.noise(q, dt)
    fp = f @ p[:-1]
    predicted = fp @ np.swapaxes(f, 1, 2) + noise
    # of unit diagonal, so that the units of the states do not matter
    unit = np.sqrt(np.diagonal(predicted, axis1=1, axis2=2))
    unit = np.where(unit > 0.0, unit, 1.0)
    scaled = predicted / unit[:, :, None] / unit[:, None, :]
    gain = np.swapaxes(np.linalg.solve(scaled, fp / unit[:, :, None]), 1, 2) / unit[:, None, :]
    rest = np.eye(motion.n) - gain @ f
    own = rest @ p[:-1] @ np.swapaxes(rest, 1, 2) + gain @ noise @ np.swapaxes(gain, 1, 2)
    own = 0.5 * (own + np.swapaxes(own, 1, 2))
    for k in range(len(t) - 1, -1, -1):
        g = gain[k]
        x[k] += g @ (x[k + 1] - ahead[k])
        p[k] = own[k] + g @ p[k + 1] @ g.T
    return x, p
