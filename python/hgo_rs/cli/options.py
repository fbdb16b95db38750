"""Values of options: lists of numbers, numbers of columns."""

from __future__ import annotations

from typing import Any

import click


class Numbers(click.ParamType):
    """A list of numbers, complex ones as 1+2j: -1,-2 or "-1+1j, -1-1j"."""

    name = "numbers"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> list[Any]:
        if not isinstance(value, str):
            return list(value)
        numbers: list[Any] = []
        for part in value.split(","):
            try:
                number = complex(part.strip().replace(" ", "").replace("i", "j"))
            except ValueError:
                self.fail(f"{part.strip()!r} is not a number; write for example -1,-2", param, ctx)
            numbers.append(number if number.imag else number.real)
        return numbers


class Named(click.ParamType):
    """A number for a column: q=0.1."""

    name = "COL=NUMBER"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, float]:
        """Of the last equals sign, since a column may have one in its name."""
        column, _, number = value.rpartition("=")
        try:
            return column, float(number if column else "")
        except ValueError:
            self.fail(
                f"{value!r} names no number for a column; write for example q=0.1", param, ctx
            )
