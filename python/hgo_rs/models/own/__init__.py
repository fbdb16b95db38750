"""Systems of the user's own: `Model` for an observer, `Plant` for simulation."""

from __future__ import annotations

from hgo_rs.models.own.base import OwnSystem
from hgo_rs.models.own.model import Model
from hgo_rs.models.own.plant import Plant

__all__ = ["Model", "OwnSystem", "Plant"]
