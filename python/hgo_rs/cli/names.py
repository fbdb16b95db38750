"""Names for equations, made of the names of columns."""

from __future__ import annotations

import re
from collections.abc import Sequence

from hgo_rs.expressions.library import RESERVED


def chain(output: str, order: int, taken: list[str]) -> list[str]:
    """Names of an output and its derivatives: q, dq, ddq."""
    name = symbol(output, taken)
    return [name, *(symbol("d" * i + name, taken) for i in range(1, order))]


def free(name: str, taken: Sequence[str]) -> str:
    """A name unlike those that are taken."""
    while name in taken:
        name += "_"
    return name


def symbol(name: str, taken: list[str]) -> str:
    """A name for equations, made of a column's; it is added to those that are taken."""
    bare = re.split(r"[\[(]", re.split(r"[./]", name.strip())[-1] or name)[0]
    bare = re.sub(r"[^A-Za-z0-9_]+", "_", bare).strip("_")[:40]
    if not re.match(r"[A-Za-z]", bare):
        bare = f"x{bare}"
    made = free(bare, [*taken, *RESERVED, "t"])
    taken.append(made)
    return made
