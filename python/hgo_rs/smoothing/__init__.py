"""States, parameters and standard deviations from a whole record; filters compared on it."""

from __future__ import annotations

from hgo_rs.smoothing.baselines import BASELINES
from hgo_rs.smoothing.comparison import Comparison, compare
from hgo_rs.smoothing.derivative import Derivative, differentiate
from hgo_rs.smoothing.fitting import Fit, fit
from hgo_rs.smoothing.result import Smoothed
from hgo_rs.smoothing.smoother import smooth

__all__ = [
    "BASELINES",
    "Comparison",
    "Derivative",
    "Fit",
    "Smoothed",
    "compare",
    "differentiate",
    "fit",
    "smooth",
]
