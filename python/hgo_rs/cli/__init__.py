"""The `hgo` command: list, run and reproduce scenarios; run an observer over a recorded log."""

from __future__ import annotations

from hgo_rs.cli.command import main

__all__ = ["main"]
