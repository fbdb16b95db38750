"""The extended Kalman filter over a record, and how likely it makes the record.

With the innovations e of covariance S,

    -2 ln L = sum ln det S + e' S^-1 e.

A correction leaves e_+ = R S^-1 e of the samples and R - H P_+ H' = R S^-1 R of their covariance,
and so both terms follow from the filter's estimates alone, e' S^-1 e = e' R^-1 e_+ and
det S = det R^2 / det(R - H P_+ H'), of the outputs that are there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hgo_rs.observers import HighGainEKF, MultiOutputObserver
from hgo_rs.smoothing.motion import Motion, start
from hgo_rs.smoothing.samples import Array, Samples


@dataclass(frozen=True, eq=False)
class Forward:
    """What the filter knows at each sample by those up to it.

    Attributes
    ----------
    x : (N, n)
    p : (N, n, n)
    innovation : (N, n_y)
        y - y_hat before the sample is used; NaN where it is missing, or not used.
    squares : (N,)
        e' S^-1 e.
    log_det : (N,)
        ln det S.
    count : (N,)
        Outputs that are there.
    """

    x: Array
    p: Array
    innovation: Array
    squares: Array
    log_det: Array
    count: Array

    @property
    def scale(self) -> float:
        """By how much R, Q and P are to be larger for the innovations' size: the mean of
        e' S^-1 e an output.
        """
        return float(np.sum(self.squares) / np.sum(self.count))

    @property
    def loss(self) -> float:
        """-2 ln L."""
        constant = np.sum(self.count) * np.log(2.0 * np.pi)
        return float(np.sum(self.squares) + np.sum(self.log_det) + constant)

    @property
    def scaled_loss(self) -> float:
        """-2 ln L where R, Q and P are multiplied by `scale`, the best common factor."""
        count = np.sum(self.count)
        each = 1.0 + np.log(2.0 * np.pi * self.scale)
        return float(np.sum(self.log_det) + count * each)


def forward(motion: Motion, samples: Samples, r: Array, q: Array, scale: float = 1.0) -> Forward:
    """The filter with variances r (n_y,) and intensity q (n, n).

    ``scale``: of the first estimate's variances, where r and q are of a unit of their own.
    """
    x0, deviation = start(motion, samples)
    variances = scale * deviation**2
    for channel, i in enumerate(motion.first):
        if np.isfinite(samples.y[0, channel]):
            variances[i] = r[channel]
    chains = []
    for i, end, variance in zip(motion.first, motion.last, r.tolist(), strict=True):
        rows = slice(i, end + 1)
        own = {"R": variance, "Q": q[rows, rows], "P0": variances[rows]}
        chains.append((end + 1 - i, own))
    if len(chains) == 1:
        order, own = chains[0]
        observer: HighGainEKF | MultiOutputObserver
        observer = HighGainEKF(order, model=motion.model, allow_unstable=True, **own)
    else:
        assert motion.model is not None
        parts = [HighGainEKF(order, **own) for order, own in chains]
        observer = MultiOutputObserver(parts, model=motion.model, allow_unstable=True)
    u = samples.u if motion.n_u else None
    run = observer.run(samples.t, samples.y, u, x_hat0=x0)
    x, p = np.asarray(run.x_hat), observer.covariance(run.memory)
    e = np.array(run.innovation)
    e[0] = np.nan  # the first sample is where the estimate starts
    measured = list(motion.first)
    there = np.isfinite(e)
    after = np.where(there, samples.y - x[:, measured], 0.0)
    squares = np.sum(np.where(there, e, 0.0) * after / r, axis=1)
    # R - H P+ H', of unit size; an output that is missing takes part with ln det = 0
    root = np.sqrt(r)
    left = np.eye(len(measured)) - p[:, measured][:, :, measured] / np.outer(root, root)
    both = there[:, :, None] & there[:, None, :]
    left = np.where(both, left, np.eye(len(measured)))
    det = left[:, 0, 0] if len(measured) == 1 else np.linalg.det(left)
    with np.errstate(all="ignore"):
        log_det = np.where(there, np.log(r), 0.0).sum(axis=1) - np.log(det)
    return Forward(x, p, e, squares, log_det, there.sum(axis=1).astype(np.float64))
