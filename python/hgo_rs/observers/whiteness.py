"""What normal distributions say of numbers: widths of bands, and whether innovations are white."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hgo_rs.errors import check_number

Array = npt.NDArray[np.float64]

LAGS = 20


def autocorrelation(values: Array, lags: int = LAGS) -> Array:
    """Of lags 1 to `lags`."""
    z = values - np.mean(values)
    whole = float(z @ z)
    if whole == 0.0:
        return np.ones(lags)
    return np.array([float(z[k:] @ z[:-k]) / whole for k in range(1, lags + 1)])


def whiteness(values: Array) -> float:
    """How probable autocorrelations as large as these are of white noise: the portmanteau test of
    Ljung and Box (Biometrika 65, 1978) with 20 lags.
    """
    from scipy.special import chdtrc

    count = len(values)
    weights = count - np.arange(1, LAGS + 1)
    square = count * (count + 2.0) * float(np.sum(autocorrelation(values) ** 2 / weights))
    return float(chdtrc(LAGS, square))


def normality(values: Array) -> float:
    """How probable a skewness and a kurtosis as far from the normal ones are: the test of Jarque
    and Bera (Economics Letters 6, 1980).
    """
    from scipy.special import chdtrc

    z = values - np.mean(values)
    spread = float(np.mean(z**2))
    if spread == 0.0:
        return 0.0
    skewness = float(np.mean(z**3)) / spread**1.5
    excess = float(np.mean(z**4)) / spread**2 - 3.0
    return float(chdtrc(2, len(z) / 6.0 * (skewness**2 + 0.25 * excess**2)))


def normal_width(level: float) -> float:
    """Standard deviations on each side of the mean that hold this probability."""
    from scipy.special import ndtri

    check_number(level, "level", above=0.0, below=1.0)
    return float(ndtri(0.5 + 0.5 * level))
