"""Functions that FMI asks for and an observer has no use for: each is there and refuses."""

from __future__ import annotations

import re
from collections.abc import Sequence

from hgo_rs.exports.program import wrapped

__all__ = ["absent"]


def absent(prefix: str, heads: Sequence[str], *, unless: str = "", gives: str = "outcome ") -> str:
    """Functions by their heads, "Name(unit *of, arguments)".

    `unless` is a condition, in C, under which there is nothing to refuse: the result is then OK.
    What gives a pointer gives none.
    """
    return "".join(_function(prefix, head, unless, gives) for head in heads)


def _function(prefix: str, head: str, unless: str, gives: str) -> str:
    name, arguments = head.rstrip(")").split("(", 1)
    words = re.findall(r"(\w+)(?=,|$)", arguments)
    told = "of" in words
    unused = [w for w in words if w != "of" and not re.search(rf"\b{w}\b", unless)]
    lines = [wrapped(f"EXPORTED {gives}FMI({prefix}{name})(", f"{arguments})"), "{"]
    lines += [f"    (void){word};" for word in unused]
    if unless:
        lines += [f"    if ({unless}) {{", "        return OK;", "    }"]
    if told:
        lines.append(f'    refuse(of, "{prefix}{name} is no function of this unit");')
    lines.append("    return ERROR;" if told else "    return NULL;")
    return "\n".join([*lines, "}", "", ""])
