"""Systems: those of the papers, and the user's own."""

from __future__ import annotations

from hgo_rs.models.own import Model, Plant
from hgo_rs.models.papers import (
    Crackle,
    InputGain,
    Lee,
    SanfelicePraly,
    Ship,
    System,
    Unknown,
    VanDerPol,
)

__all__ = [
    "Crackle",
    "InputGain",
    "Lee",
    "Model",
    "Plant",
    "SanfelicePraly",
    "Ship",
    "System",
    "Unknown",
    "VanDerPol",
]
