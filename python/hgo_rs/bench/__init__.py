"""Every law on one bench: the same systems, noises and settling time for all."""

from __future__ import annotations

from hgo_rs.bench.measure import Cell, measured
from hgo_rs.bench.report import Report

__all__ = ["Cell", "Report", "measured"]
