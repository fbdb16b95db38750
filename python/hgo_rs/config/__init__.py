"""`observer.toml`: one file that says what an observer is and how a log is read for it."""

from __future__ import annotations

from hgo_rs.config import schema
from hgo_rs.config.configuration import Config, load, save
from hgo_rs.config.keys import (
    FORMAT,
    GAINS,
    LOG,
    MODELS,
    OBSERVERS,
    SHAPES,
    START,
    TOLD,
    TOP,
    ConfigError,
)
from hgo_rs.config.text import SchemaWarning

__all__ = [
    "FORMAT",
    "GAINS",
    "LOG",
    "MODELS",
    "OBSERVERS",
    "SHAPES",
    "START",
    "TOLD",
    "TOP",
    "Config",
    "ConfigError",
    "SchemaWarning",
    "load",
    "save",
    "schema",
]
