"""The standard high-gain observer."""

from __future__ import annotations

import numpy.typing as npt

from hgo_rs.design.discrete import DEFAULT_TIMING
from hgo_rs.models import System
from hgo_rs.observers.arguments import Gain, Poles
from hgo_rs.observers.listed import HighGainObserver
from hgo_rs.observers.shapes import Shape


class StandardObserver(HighGainObserver):
    """Standard high-gain observer of order n, any gain law.

    x_hat' = A x_hat + f_hat(x_hat, u, t) + diag(r, ..., r^n) K (y - x_hat_1)

    Sanfelice and Praly (5)-(7); with a constant gain Astolfi et al. (2) and, with f_hat = 0, Lee,
    Choi and Khalil (39), (42).

    Parameters
    ----------
    n : int
        Order, 1 to 12.
    gain : float or a gain law
        High gain ell [1/s], or the law that moves it: `AdaptiveGain`, `DeadZoneGain`,
        `HomogeneousGain`, `SwitchedGain`, `PrescribedTimeGain`.
    epsilon : float, optional
        1/ell [s], in place of `gain`.
    poles : n numbers, optional
        Roots of s^n + k_1 s^(n-1) + ... + k_n, before scaling by ell. Default: equidistant in
        [-2, -1].
    k : n numbers, optional
        The coefficients themselves, in place of `poles`.
    shape : Shape, optional
        What is injected in the place of the innovation: `Stubborn`, `DeadZone`, `PiecewiseLinear`,
        `Fal`, `BiHomogeneous`. Default: the innovation itself.
    model : System, optional
        What is known of the system. Default: nothing, phi = 0.
    method : str, optional
        Discretisation, one of `METHODS`; the papers' recursions are "euler". Default: "zoh", or
        "rk4" for a low-power or peaking-free law with a gain that moves, and for a shape whose rows
        differ (`PiecewiseLinear`, `Fal`).
    motion : "held", "rk4" or "implicit", optional
        How the model moves over a period under "zoh" and "bilinear": held at the period's
        beginning; by RK4; implicit (backward Euler) where a known term is stiff in the state that
        it moves, else by RK4. Default: "held" where the model depends on inputs alone or nothing
        is known, "implicit" where a known term may jump or has a slope above the gain in the state
        that it moves, such as dry friction (`model.own_slope`), else "rk4".
    substeps : int, optional
        Steps that a period is cut into by the last two, 1 to 16. Default: 2.
    timing : "predictor" or "current"
        Whether the estimate at sample k uses samples up to k - 1, as the papers' recursions do, or
        up to k.
    wrap : float, optional
        The length of a turn of an output that begins again after it, in its unit: 2*pi, or the
        counts of a counter. The innovation is then that to the nearest turn, and x_hat_1 stays
        within half a turn of 0; a model sees that one. A sample may be given in any turn.
    allow_unstable : bool
        Let `step` and `run` use a step beyond the stability limit.

    Raises
    ------
    HgoError
        Poles that are not Hurwitz or lack a conjugate; an order, gain or model out of range.
    """

    def __init__(
        self,
        n: int,
        gain: Gain | None = None,
        *,
        epsilon: float | None = None,
        poles: Poles | None = None,
        k: npt.ArrayLike | None = None,
        shape: Shape | None = None,
        model: System | None = None,
        method: str | None = None,
        motion: str | None = None,
        substeps: int | None = None,
        timing: str = DEFAULT_TIMING,
        wrap: float | None = None,
        allow_unstable: bool = False,
    ) -> None:
        super().__init__(
            "standard",
            n,
            gain,
            epsilon=epsilon,
            poles=poles,
            shape=shape,
            model=model,
            method=method,
            motion=motion,
            substeps=substeps,
            timing=timing,
            wrap=wrap,
            allow_unstable=allow_unstable,
            k=k,
        )
