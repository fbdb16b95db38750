"""The standard high-gain observer."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy.typing as npt

from hgo_rs.design.riccati import poles_of_gains, riccati
from hgo_rs.errors import check_choice, check_integer, check_number
from hgo_rs.models import System
from hgo_rs.observers.arguments import Gain, Poles
from hgo_rs.observers.listed import HighGainObserver
from hgo_rs.observers.shapes import Shape

if TYPE_CHECKING:
    from typing_extensions import Self


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
        Function of the innovation that is injected: `Stubborn`, `DeadZone`, `PiecewiseLinear`,
        `Fal`, `BiHomogeneous`. Default: the innovation itself.
    model : System, optional
        The model. Default: none, phi = 0.
    method : str, optional
        Discretisation, one of `METHODS`; the papers' recursions are "euler". Default: "zoh", or
        "rk4" for a low-power or peaking-free law with a gain that moves, and for a shape whose rows
        differ (`PiecewiseLinear`, `Fal`).
    motion : "held", "rk4" or "implicit", optional
        Integration of the model over a period under "zoh", "bilinear", "implicit-map", "proper" and
        "inter-sample": held at its value at the beginning; by RK4; implicit (backward Euler) where
        f_i is stiff in x_i, otherwise by RK4. Default: "held" for no model or a model of inputs
        alone; "implicit" where f_i may jump in x_i or has a slope above the gain, such as dry
        friction (`model.own_slope`); otherwise "rk4".
    substeps : int, optional
        Substeps of a period for the last two, 1 to 16. Default: 2.
    timing : "predictor" or "current", optional
        Whether the estimate at sample k uses samples up to k - 1, as the papers' recursions do, or
        up to k. Default: "current"; "predictor" for the method "inter-sample", which has no other.
    wrap : float, optional
        Length of a turn of an output that wraps, in its unit: 2*pi, or the counts of a counter. The
        innovation is then that to the nearest turn, and x_hat_1 stays within half a turn of 0, also
        in the model. A sample may be given in any turn.
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
        timing: str | None = None,
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

    @classmethod
    def alpha_beta_gamma(
        cls, alpha: float, beta: float, dt: float, gamma: float | None = None, **options: Any
    ) -> Self:
        """The alpha-beta filter, with `gamma` the alpha-beta-gamma filter.

        Corrections are K = (alpha, beta/dt, gamma/dt^2) in units x_i/y at the period `dt` [s];
        texts whose third gain is gamma/(2 dt^2) or 2 gamma/dt^2 have another gamma. It is this law
        with method "zoh" and current timing; at another period its poles are placed anew.

        Raises
        ------
        HgoError
            Gains whose error does not decay, or that correspond to no poles: alpha >= 1, or errors
            that change their sign from sample to sample; `WindowObserver` takes these.
        """
        period = check_number(dt, "dt", above=0.0)
        given = {"alpha": alpha, "beta": beta} | ({} if gamma is None else {"gamma": gamma})
        gains = [check_number(one, name) / period**i for i, (name, one) in enumerate(given.items())]
        return cls._placed(*poles_of_gains(gains, period), **options)

    @classmethod
    def fading_memory(cls, n: int, theta: float, dt: float, **options: Any) -> Self:
        """Fading memory: the polynomial of degree n - 1 that fits all samples best, weights
        theta^age; the critically damped alpha-beta(-gamma) filter for n = 2 (3). Morrison (1969).

        All poles are -1 and ell = -ln(theta)/dt, 0 < theta < 1: `n`, `dt` [s].
        """
        period = check_number(dt, "dt", above=0.0)
        ell = -math.log(check_number(theta, "theta", above=0.0, below=1.0)) / period
        return cls._placed(ell, [-1.0] * check_integer(n, "n", least=1, most=12), **options)

    @classmethod
    def tracking_index(cls, index: float, dt: float, **options: Any) -> Self:
        """The steady Kalman filter of order 2 by its tracking index. Kalata, IEEE TAES 20 (1984).

        `index` = dt^2 sigma_w/sigma_v > 0, of an acceleration of standard deviation sigma_w that is
        held over each period `dt` [s], and samples of standard deviation sigma_v.
        """
        of = check_number(index, "index", above=0.0)
        r = (4.0 + of - math.sqrt(8.0 * of + of**2)) / 4.0
        alpha = 1.0 - r**2
        beta = 2.0 * (2.0 - alpha) - 4.0 * math.sqrt(1.0 - alpha)
        return cls.alpha_beta_gamma(alpha, beta, dt, **options)

    @classmethod
    def steady_kalman(
        cls, n: int, *, Q: npt.ArrayLike, R: float, dt: float | None = None, **options: Any
    ) -> Self:
        """The steady-state Kalman differentiator: gains of `hgo_rs.design.riccati`.

        `Q`: intensity of white noise in x_n' (or of each state, or a matrix). `R`: with the period
        `dt` [s] the variance of a sample; without it the intensity of white noise in y, of the law
        in continuous time: Butterworth's poles and ell = (Q/R)^(1/(2n)).
        """
        found = riccati(n, Q=Q, R=R, dt=dt)
        return cls._placed(found.ell, found.poles, **options)

    @classmethod
    def _placed(cls, ell: float, poles: Any, **options: Any) -> Self:
        allowed = ("model", "motion", "substeps", "wrap", "allow_unstable")
        for name in options:
            check_choice("an option", name, allowed)
        return cls(len(poles), ell, poles=poles, method="zoh", timing="current", **options)
