"""The C interface: `c/main.c` on the board and on this computer must print the same."""

from __future__ import annotations


def check() -> list[str]:
    """What does not hold."""
    return []
