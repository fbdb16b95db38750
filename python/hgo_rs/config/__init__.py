"""`observer.toml`: one file that says what an observer is and how a log is read for it."""

from __future__ import annotations

from hgo_rs.config.configuration import Config, load, save
from hgo_rs.config.keys import FORMAT, LOG, MODELS, OBSERVERS, START, TOP, ConfigError

__all__ = [
    "FORMAT",
    "LOG",
    "MODELS",
    "OBSERVERS",
    "START",
    "TOP",
    "Config",
    "ConfigError",
    "load",
    "save",
]
