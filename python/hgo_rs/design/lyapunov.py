"""Lyapunov matrices, the gain bound ell*, and a frozen-coefficient figure to set beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from hgo_rs.errors import DesignError, check

from . import _checks
from ._checks import Array


def lyapunov(a: ArrayLike, q: ArrayLike | None = None) -> Array:
    """P = P^T > 0 of A^T P + P A = -Q, shape (n, n).

    ``a``: Hurwitz; ``q``: symmetric positive definite, default I.
    Source: Lee et al., eq. (31); Astolfi et al., eq. (6).
    """
    from scipy.linalg import solve_continuous_lyapunov

    a = _checks.hurwitz(a, "A")
    n = a.shape[0]
    q = np.eye(n) if q is None else _checks.positive_definite(q, "Q", n)
    p = np.asarray(solve_continuous_lyapunov(a.T, -q), dtype=np.float64)
    p = 0.5 * (p + p.T)
    residual = float(np.max(np.abs(a.T @ p + p @ a + q)) / np.max(np.abs(q)))
    holds = residual < 1e-6
    remedy = "the poles are too close to the imaginary axis or too widely spread"
    _checks.demand(holds, "relative residual of the Lyapunov equation", residual, "< 1e-6", remedy)
    return _checks.positive_definite(p, "P")


def lipschitz_constant(
    gradient: Callable[[Array], ArrayLike], box: Sequence[tuple[float, float]] | ArrayLike
) -> float:
    """The largest |gradient(x)|_2 over the vertices of the ``box``, [(low, high)] per state.

    This is the Lipschitz constant of phi on the box if the gradient is affine in x (phi quadratic,
    as the crackle system's is), for then |gradient| is convex and largest at a vertex; otherwise a
    lower bound.
    """
    sides = np.asarray(box, dtype=np.float64)
    check(
        sides.ndim == 2
        and sides.shape[1] == 2
        and 1 <= sides.shape[0] <= _checks.MAX_ORDER
        and np.all(np.isfinite(sides))
        and np.all(sides[:, 0] <= sides[:, 1]),
        "box",
        sides.tolist(),
        "n finite pairs (low, high), low <= high, n = 1 to 12",
        "give one pair for each state",
        DesignError,
    )
    largest = 0.0
    for vertex in product(*sides):
        slope = _checks.vector(gradient(np.array(vertex)), "gradient(x)", sides.shape[0])
        largest = max(largest, float(np.linalg.norm(slope)))
    return largest


def crackle_gradient(x: ArrayLike) -> Array:
    """d(phi)/dx of phi = 0.2 (x1^2 - 1) - x2 - x3 - 4 x4 - x5: Astolfi et al., eq. (20)."""
    x = _checks.vector(x, "x", 5)
    return np.array([0.4 * x[0], -1.0, -1.0, -4.0, -1.0])


def ell_star(phi_lipschitz: float, p: ArrayLike) -> float:
    """ell* = 2 phi_bar_x |P|: above it Theorem 1 of Astolfi et al. guarantees convergence.

    ``phi_lipschitz``: Lipschitz constant phi_bar_x of phi on X; ``p``: P of ``lyapunov(A - K C)``
    (standard) or ``lyapunov(M_n)`` (low-power).  Far from necessary: set ``ell_frozen`` and a
    simulation beside it.
    """
    phi_lipschitz = _checks.number(phi_lipschitz, "phi_lipschitz", least=0.0)
    return 2.0 * phi_lipschitz * float(np.linalg.eigvalsh(_checks.positive_definite(p, "P"))[-1])


def ell_frozen(matrix: ArrayLike, gradients: ArrayLike) -> float:
    """The gain above which the error dynamics with a frozen d(phi)/dx is Hurwitz.

    ``matrix``: A - K C (n, n) or M_n (2n-1, 2n-1); ``gradients``: (m, n), values of d(phi)/dx to
    try.  In the scaled error chi of eq. (21) the dynamics is
    ell M + B grad(phi)^T diag(ell^(i-n)), where grad(phi) acts on the x_hat entries and B feeds the
    last row (and, low-power, eta_{n-1}: the row before it).  An indication, neither necessary nor
    sufficient for a gradient that moves; it shows how far off ell* is.
    Source: Astolfi et al., section 5.1.
    """
    m = _checks.hurwitz(matrix, "matrix")
    slopes = np.atleast_2d(np.asarray(gradients, dtype=np.float64))
    size, n = m.shape[0], slopes.shape[1]
    holds = size in (n, 2 * n - 1) and np.all(np.isfinite(slopes))
    allowed = f"finite, of shape (m, {size})" + (f" or (m, {(size + 1) // 2})" if size % 2 else "")
    remedy = "give one row for each gradient to try"
    _checks.demand(holds, "gradients", f"array of shape {slopes.shape}", allowed, remedy)
    low_power = size == 2 * n - 1 and n > 1
    estimates = np.arange(0, size, 2) if low_power else np.arange(n)

    def worst(ell: float) -> float:
        scaled = np.zeros((slopes.shape[0], size))
        scaled[:, estimates] = slopes * ell ** (np.arange(1.0, n + 1.0) - n)
        full = np.repeat(ell * m[None], slopes.shape[0], axis=0)
        full[:, -1] += scaled  # x_hat_n' = phi_s + ...
        if low_power:
            full[:, -2] += scaled  # eta_{n-1}' = phi_s + ..., scaled by the same ell^(n-1)
        return float(np.max(np.linalg.eigvals(full).real))

    grid = np.geomspace(1e-3, 1e5, 321)
    unstable = [ell for ell in grid if worst(float(ell)) >= 0.0]
    if not unstable:
        return 0.0
    low = float(unstable[-1])
    check(
        low < grid[-1],
        "gradients",
        f"largest norm {float(np.max(np.linalg.norm(slopes, axis=1))):g}",
        "small enough for a gain below 1e5",
        "rescale time or the state",
        DesignError,
    )
    high = low * float(grid[1] / grid[0])
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if worst(middle) >= 0.0 else (low, middle)
    return high
