"""The low-power and the peaking-free observer."""

from __future__ import annotations

import numpy.typing as npt

from hgo_rs.models import System
from hgo_rs.observers.arguments import Gain, Poles
from hgo_rs.observers.listed import HighGainObserver
from hgo_rs.observers.shapes import Shape


class LowPowerObserver(HighGainObserver):
    """Low-power observer of order n: no coefficient above ell^2. Astolfi et al. (5).

    Parameters
    ----------
    n : int
        Order, 2 to 12.
    gain, epsilon, shape, model, method, motion, substeps, timing, wrap, allow_unstable
        As in `StandardObserver`. The model must be of phase-variable form; the rows of the shape
        must be alike (`Stubborn`, `DeadZone`).
    poles : 2 n - 1 numbers, optional
        Eigenvalues of M_n. Default: 2 n - 2 equidistant ones in [-2, -1], and -2; for n = 5 the
        paper's coefficients.
    alpha, beta : n and n - 1 numbers, optional
        The coefficients themselves, in place of `poles`.
    """

    def __init__(
        self,
        n: int,
        gain: Gain | None = None,
        *,
        epsilon: float | None = None,
        poles: Poles | None = None,
        alpha: npt.ArrayLike | None = None,
        beta: npt.ArrayLike | None = None,
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
            "low-power",
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
            alpha=alpha,
            beta=beta,
        )


class PeakingFreeObserver(HighGainObserver):
    """Low-power peaking-free observer of order n. Astolfi et al. (11).

    Parameters
    ----------
    n, gain, epsilon, poles, alpha, beta, shape, model, method, motion, substeps, timing, wrap,
    allow_unstable
        As in `LowPowerObserver`.
    saturation : float or n - 1 numbers
        Levels r_2 ... r_n >= max |x_i| (10).
    clip : "hard" or "smooth"
        Hard clip at +-r (what the paper's tables use), or the C1 saturation of its text, bounded
        by r + 1.

    Raises
    ------
    HgoError
        A saturation level below the model's own bound of |x_i|.
    """

    def __init__(
        self,
        n: int,
        gain: Gain | None = None,
        *,
        saturation: npt.ArrayLike,
        clip: str = "hard",
        epsilon: float | None = None,
        poles: Poles | None = None,
        alpha: npt.ArrayLike | None = None,
        beta: npt.ArrayLike | None = None,
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
            "peaking-free",
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
            saturation=saturation,
            clip=clip,
            wrap=wrap,
            allow_unstable=allow_unstable,
            alpha=alpha,
            beta=beta,
        )
