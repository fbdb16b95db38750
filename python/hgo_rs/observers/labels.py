"""What the entries of an estimate are called, and their units, where a model says so."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_TAKEN = re.compile(r"t|time|[yu]\d*|gain|missing|gated|piece|innovation\d*|std\d+|std_\w+")
"""Columns of a result, or of a file of estimates, beside the estimates."""


@dataclass(frozen=True)
class Labels:
    """Names and units of an observer's estimates.

    Attributes
    ----------
    states : names of the estimated states, as the model has them; empty where none has
    unknown : those of them that are unknowns
    units : units by name, of states and inputs
    """

    states: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    units: Mapping[str, str] | None = None

    @classmethod
    def of(cls, spec: Mapping[str, Any], n: int) -> Labels:
        """Of an observer of n estimates, by its spec."""
        model = spec.get("model") or {}
        if "names" not in model:
            return cls()
        names = model["names"]
        return cls(
            tuple(names["states"])[-n:],
            tuple(names.get("unknown", ())),
            dict(model.get("units", {})),
        )

    def names(self, n: int) -> list[str]:
        """Names of all n entries: the model's, else x1, x2, ..."""
        return [*self.states[:n], *(f"x{i + 1}" for i in range(len(self.states), n))]

    def column(self, i: int) -> str:
        """The column of entry i: the state's name, else x_hat1, x_hat2, ...

        A name that another column has, such as y or time, has `_hat` behind it.
        """
        if i >= len(self.states):
            return f"x_hat{i + 1}"
        name = self.states[i]
        return f"{name}_hat" if _TAKEN.fullmatch(name) else name

    def columns(self, n: int) -> list[str]:
        """The columns of all n entries."""
        return [self.column(i) for i in range(n)]

    def entry(self, i: int) -> str:
        """Entry i beside a plant that may have a state of that name: T_load_hat, or x_hat1."""
        name = self._unknown(i)
        return f"{name}_hat" if name else f"x_hat{i + 1}"

    def error(self, i: int) -> str:
        """The error of entry i: e_T_load, or e1."""
        name = self._unknown(i)
        return f"e_{name}" if name else f"e{i + 1}"

    def _unknown(self, i: int) -> str:
        """The name of entry i if it is an unknown, else empty."""
        name = self.states[i] if i < len(self.states) else ""
        return name if name in self.unknown else ""

    def deviation(self, i: int) -> str:
        """The standard deviation of entry i: std_T_load, or std1."""
        return f"std_{self.column(i)}" if i < len(self.states) else f"std{i + 1}"

    def unit(self, i: int) -> str:
        """The unit of entry i; empty where it is not known."""
        name = self.states[i] if i < len(self.states) else ""
        return (self.units or {}).get(name, "")

    def heading(self, i: int) -> str:
        """The column of entry i with its unit, for a file: `T_load [N m]`."""
        return self.column(i) + (f" [{unit}]" if (unit := self.unit(i)) else "")

    def title(self, i: int) -> str:
        """The name of entry i with its unit, for a figure: `T_load (N m)`."""
        return self.states[i] + (f" ({unit})" if (unit := self.unit(i)) else "")

    def titles(self, n: int) -> list[str] | None:
        """Titles of all n entries, if the model names them."""
        if len(self.states) != n:
            return None
        return [self.title(i) for i in range(n)]

    def place(self, name: str) -> int | None:
        """Which entry an unknown is, by its name or the name with `_hat`; None for another name."""
        bare = name.removesuffix("_hat")
        return self.states.index(bare) if bare in self.unknown else None
