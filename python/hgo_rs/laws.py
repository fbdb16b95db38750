"""The one list of laws, as the core has it: what a spec holds, and how many numbers of each."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from hgo_rs import _core


@dataclass(frozen=True)
class Law:
    """A row of the list.

    ``kind``: the word for the law in specs and `observer.toml`; ``title``: its name.
    ``coefficients``, ``memory``: names and counts, in words.  ``size``: name and values of a second
    size beside the order, the usual one first.  ``orders``: those that are built (of a recursion
    none: its model's).  ``poles``: how many make the coefficients, in words.  ``gain``: "any",
    "adaptive" or "none".  ``form``: of the model.  ``continuous``: given by a rate.  ``placed``:
    whether "zoh", "bilinear" and "implicit-map" are defined.  ``flows``: whether "proper" is.
    """

    kind: str
    title: str
    coefficients: tuple[tuple[str, str], ...]
    size: tuple[str, list[int]] | None
    orders: tuple[int, ...]
    poles: str | None
    gain: str
    saturated: bool
    open: bool
    form: str
    continuous: bool
    placed: bool
    flows: bool
    memory: tuple[tuple[str, str], ...]
    source: str

    @property
    def single(self) -> bool:
        """Whether it is one chain with poles: linear where its model is left out."""
        return self.continuous and self.poles is not None

    def counts(self, n: int, m: int = 0) -> dict[str, int]:
        """How many coefficients each list has."""
        return dict(_core.law_sizes(self.kind, n, m, False)["coefficients"])

    def memory_counts(self, n: int, m: int = 0, *, moves: bool = False) -> dict[str, int]:
        """How many entries each part of the memory has."""
        return dict(_core.law_sizes(self.kind, n, m, moves)["memory"])

    def pole_count(self, n: int, m: int = 0) -> int | None:
        """How many poles make the coefficients; None where they are not found from poles."""
        count: int | None = _core.law_sizes(self.kind, n, m, False)["poles"]
        return count


LAWS = MappingProxyType({row["kind"]: Law(**row) for row in _core.laws()})
"""Every law by its kind, in the order of the list."""
