"""Choosing a gain, and a structure, from a log or from what is known of the noise."""

from __future__ import annotations

from hgo_rs.tuning.choice import TuningWarning, tune
from hgo_rs.tuning.result import TradeOff, Tuning

__all__ = ["TradeOff", "Tuning", "TuningWarning", "tune"]
