"""Measurement noise for simulations.

A draw is held for `hold` seconds (default: one step); `sines` are added in continuous time.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import HgoError, check, check_array, check_integer, check_number
from hgo_rs.read_only import shown
from hgo_rs.times import check_period

Sine = tuple[float, float, float]


@dataclass(frozen=True)
class Noise:
    """No noise; the base of all kinds.

    Parameters
    ----------
    hold : float, optional
        Seconds for which a draw is held; a whole number of steps. Default: one step.
    sines : sequence of (amplitude, omega [rad/s], phase [rad])
        Sines added to the draw.
    """

    hold: float | None = field(default=None, kw_only=True)
    sines: Sequence[Sine] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        # no list or array of the caller's, who may edit it later
        object.__setattr__(self, "sines", copy.deepcopy(self.sines))

    def draw(self) -> dict[str, Any]:
        """The drawn part as a spec."""
        return {"kind": "none"}

    def spec(self, dt: float) -> dict[str, Any]:
        """The plain dict for steps of length dt [s].

        Raises
        ------
        HgoError
            A parameter out of range; `hold` is not a whole number of steps.
        """
        out = self.draw()
        if self.hold is not None:
            hold = check_number(self.hold, "hold", above=0.0)
            steps = round(min(hold / dt, 1e15))
            whole = steps >= 1 and abs(steps * dt - hold) <= 1e-9 * hold
            remedy = "choose dt so that it divides hold"
            check(whole, "hold", hold, f"a whole number of steps of dt = {dt:g} s", remedy)
            out["hold"] = steps
        sines = check_array(self.sines, "sines")
        if sines.size:
            fits = sines.ndim == 2 and sines.shape[1] == 3 and np.isfinite(sines).all()
            rows = "rows of three finite numbers"
            check(fits, "sines", self.sines, rows, "give (amplitude, omega [rad/s], phase) each")
            out["sines"] = sines.tolist()
        return out


@dataclass(frozen=True)
class Sines(Noise):
    """Sines only: Sines(sines=[(amplitude, omega, phase), ...])."""


@dataclass(frozen=True)
class UniformNoise(Noise):
    """Uniform on [low, high)."""

    low: float = -0.5
    high: float = 0.5

    def draw(self) -> dict[str, Any]:
        check_number(self.low, "low")
        check_number(self.high, "high", least=float(self.low))
        return {"kind": "uniform", "low": float(self.low), "high": float(self.high)}


@dataclass(frozen=True)
class NormalNoise(Noise):
    """Normal with `mean` and standard deviation `std`."""

    mean: float = 0.0
    std: float = 1.0

    def draw(self) -> dict[str, Any]:
        check_number(self.mean, "mean")
        check_number(self.std, "std", least=0.0)
        return {"kind": "normal", "mean": float(self.mean), "std": float(self.std)}


@dataclass(frozen=True)
class StudentTNoise(Noise):
    """`mean` + `scale` times Student's t with `nu` degrees of freedom, 0.5 to 1e6: heavy tails.

    Its variance is scale^2 nu/(nu - 2) for nu > 2, else infinite. Two uniform numbers a draw
    (Bailey, Math. Comp. 62 (1994), without the rejection).
    """

    nu: float = 4.0
    mean: float = 0.0
    scale: float = 1.0

    def draw(self) -> dict[str, Any]:
        nu = check_number(self.nu, "nu", least=0.5, most=1e6)
        return {"kind": "student-t", "nu": nu, **_placed(self.mean, self.scale)}


@dataclass(frozen=True)
class LaplaceNoise(Noise):
    """Laplace's law about `mean`: density exp(-|v - mean|/scale)/(2 scale), variance 2 scale^2."""

    mean: float = 0.0
    scale: float = 1.0

    def draw(self) -> dict[str, Any]:
        return {"kind": "laplace", **_placed(self.mean, self.scale)}


@dataclass(frozen=True)
class ImpulsiveNoise(Noise):
    """Normal noise of standard deviation `std`, `ratio` times as large with a `probability`.

    A mixture of two normal laws of the same `mean`; its variance is
    std^2 (1 + probability (ratio^2 - 1)).
    """

    std: float = 1.0
    probability: float = 0.01
    ratio: float = 10.0
    mean: float = 0.0

    def draw(self) -> dict[str, Any]:
        check_number(self.std, "std", least=0.0)
        probability = check_number(self.probability, "probability", least=0.0, most=1.0)
        ratio = check_number(self.ratio, "ratio", least=0.0)
        law = {"kind": "impulsive", "probability": probability, "ratio": ratio}
        return {**law, **_placed(self.mean, self.std)}


def _placed(mean: float, scale: float) -> dict[str, float]:
    return {"mean": check_number(mean, "mean"), "scale": check_number(scale, "scale", least=0.0)}


@dataclass(frozen=True)
class ColouredNoise(Noise):
    """Autoregressive normal noise v_k = a_1 v_(k-1) + a_2 v_(k-2) + ... + white noise.

    Parameters
    ----------
    ar : sequence of float, 1 to 16
        Coefficients a_1, a_2, ...; the noise must be stationary: the roots of
        z^p - a_1 z^(p-1) - ... - a_p lie within the unit circle. A time constant tau [s] is
        ar = [exp(-dt/tau)].
    std : float
        Standard deviation of v, from the first sample on.
    """

    ar: Sequence[float] = (0.9,)
    std: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "ar", copy.deepcopy(self.ar))

    def draw(self) -> dict[str, Any]:
        ar = check_array(self.ar, "ar")
        std = check_number(self.std, "std", least=0.0)
        fits = ar.ndim == 1 and 1 <= ar.size <= 16 and bool(np.isfinite(ar).all())
        check(fits, "ar", self.ar, "1 to 16 finite numbers", "give a_1, a_2, ...")
        companion = np.eye(ar.size, k=-1)
        companion[0] = ar
        radius = float(np.max(np.abs(np.linalg.eigvals(companion))))
        remedy = "give smaller coefficients"
        check(radius < 1.0 - 1e-9, "largest root of ar", radius, "< 1: stationary", remedy)
        # covariance of (v_k, ..., v_(k-p+1)) for white noise of variance 1: P = F P F' + e_1 e_1'
        size = ar.size**2
        white = np.eye(size)[0]
        system = np.eye(size) - np.kron(companion, companion)
        covariance = np.linalg.solve(system, white).reshape(ar.size, ar.size)
        scale = std / float(np.sqrt(covariance[0, 0]))
        start = scale * np.linalg.cholesky(covariance)
        return {"kind": "normal", "mean": 0.0, "std": scale, "ar": ar, "start": start}


@dataclass(frozen=True)
class RecordedNoise(Noise):
    """A given sequence: values (steps + 1,) for all runs, or (runs, steps + 1)."""

    values: npt.ArrayLike = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "values", copy.deepcopy(self.values))

    def draw(self) -> dict[str, Any]:
        values = check_array(self.values, "values")
        if values.ndim not in (1, 2) or not np.all(np.isfinite(values)):
            raise HgoError(
                f"values of shape {values.shape}: must be finite and of shape (steps + 1,) or "
                "(runs, steps + 1); give one value a sample"
            )
        return {"kind": "samples", "values": shown(values)}


def filtered_noise(
    samples: int,
    dt: float,
    band: tuple[float | None, float | None],
    *,
    order: int = 6,
    peak: float | None = None,
    seed: int = 0,
    run: int = 0,
) -> npt.NDArray[np.float64]:
    """White normal noise, one value a step, coloured by a Butterworth filter.

    Parameters
    ----------
    samples : int
        Number of values.
    dt : float
        Step [s].
    band : (low, high)
        Pass band [rad/s]; None leaves a side open.
    order : int
        Order of the filter (of the low-pass prototype).
    peak : float, optional
        Scale the sequence so that its largest magnitude is this.
    seed, run : int
        Which random stream.

    Returns
    -------
    ndarray (samples,)

    Raises
    ------
    HgoError
        A band that is empty, not positive, or at or above the Nyquist frequency pi/dt.
    """
    from scipy.signal import butter

    from hgo_rs import _core

    samples = check_integer(samples, "samples", least=1)
    dt = check_period(dt)
    order = check_integer(order, "order", least=1, most=12)
    seed = check_integer(seed, "seed", least=0, most=2**64 - 1)
    run = check_integer(run, "run", least=0, most=2**64 - 1)
    nyquist = np.pi / dt
    pair = isinstance(band, Sequence) and not isinstance(band, str) and len(band) == 2
    check(pair, "band", band, "a pair (low, high) in rad/s", "None leaves a side open")
    edges = [check_number(w, "band", above=0.0, below=nyquist) for w in band if w is not None]
    check(edges, "band", band, "a pair with at least one frequency", "give low, high or both")
    check(edges == sorted(set(edges)), "band", band, "increasing", "give low < high")
    kind = "bandpass" if len(edges) == 2 else "highpass" if band[1] is None else "lowpass"
    sections = butter(
        order, edges if len(edges) == 2 else edges[0], kind, fs=2 * nyquist, output="sos"
    )
    values = _core.filtered(_core.random("normal", samples, seed, run, 0), sections)
    if peak is not None:
        values = values * (check_number(peak, "peak", above=0.0) / np.max(np.abs(values)))
    return values
