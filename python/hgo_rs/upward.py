"""Methods whose work is done on an upper floor, such as `Observer.export`.

A module imports lower floors only. A method that needs an upper one calls it by a name here; who
does the work registers it under that name. `hgo_rs/__init__.py`, the top floor, does so for all
that is loaded on its first use; an upper module of the same package for itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

_registered: dict[str, Callable[..., Any]] = {}


def register(name: str, function: Callable[..., Any]) -> None:
    """Let `call(name, ...)` call a function."""
    _registered[name] = function


def call(name: str, /, *arguments: Any, **options: Any) -> Any:
    """What the function registered under this name gives."""
    return _registered[name](*arguments, **options)
