"""Parameters that a docstring describes together, one by one: each is shown with its own type."""

from __future__ import annotations

import re
from typing import Any

import griffe

TOGETHER = re.compile(r"^(\w+(?:, \w+)+)\n((?: +\S.*\n?)+)", re.M)


class Signatures(griffe.Extension):
    """Expands `a, b` without a type; the reference takes the types of the signature then."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        if obj.docstring is not None:
            obj.docstring.value = TOGETHER.sub(_apart, obj.docstring.value)


def _apart(found: re.Match[str]) -> str:
    text = found[2] if found[2].endswith("\n") else f"{found[2]}\n"
    return "".join(f"{name}\n{text}" for name in found[1].split(", "))
