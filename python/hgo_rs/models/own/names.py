"""Names of states, inputs and parameters: which are allowed, and the parameters' values."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from hgo_rs.errors import HgoError, check, check_number, explain
from hgo_rs.expressions.grammar import unknown
from hgo_rs.expressions.library import RESERVED

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
_ALLOWED = "a letter, then letters, digits and _, at most 64 characters"


class Parameters(dict[str, Any]):
    """What a callable gets as `p`: p["M"] and p.M."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(unknown(name, self, "parameter")) from None


@dataclass(frozen=True)
class Names:
    """Names in order, and values of the parameters."""

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: dict[str, float]

    @classmethod
    def of(
        cls, states: Sequence[str], inputs: Sequence[str], parameters: Mapping[str, float] | None
    ) -> Names:
        """Checked names; HgoError for one that is reserved, doubled or no name."""
        given = {} if parameters is None else parameters
        remedy = 'write parameters={"M": 95.1}'
        check(isinstance(given, Mapping), "parameters", given, "a dict of names and values", remedy)
        names = cls(
            _list(states, "states", least=1),
            _list(inputs, "inputs"),
            {name: _value(value, name) for name, value in given.items()},
        )
        _list(list(given), "parameters")
        taken: dict[str, str] = {}
        for role, name in names._roles():
            if name in taken:
                remedy = f"{name} is already among the {taken[name]}; rename it"
                raise HgoError(explain(role, name, "a name of its own", remedy))
            taken[name] = role
        names.leave_alone(RESERVED)
        return names

    def leave_alone(self, reserved: Iterable[str]) -> None:
        """Refuse names that have a meaning of their own."""
        for role, name in self._roles():
            if name in reserved:
                remedy = f"{name} is reserved; rename it"
                raise HgoError(explain(role, name, "a name of its own", remedy))

    def _roles(self) -> list[tuple[str, str]]:
        groups = {"states": self.states, "inputs": self.inputs, "parameters": self.parameters}
        return [(role, name) for role, group in groups.items() for name in group]

    @property
    def all(self) -> tuple[str, ...]:
        """States, inputs, parameters."""
        return (*self.states, *self.inputs, *self.parameters)

    def changed(self, values: Mapping[str, float]) -> Names:
        """The same with other values of some parameters."""
        for name in values:
            if name not in self.parameters:
                raise HgoError(unknown(str(name), self.parameters, "parameter"))
        new = {name: _value(value, name) for name, value in values.items()}
        return replace(self, parameters={**self.parameters, **new})


def _value(value: Any, name: object) -> float:
    remedy = "give the parameter a finite value"
    return check_number(value, f"parameters[{name!r}]", remedy=remedy)


def _list(names: Sequence[str], role: str, least: int = 0) -> tuple[str, ...]:
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise HgoError(explain(role, names, "a list of names", f'write {role}=["q", "v"]'))
    check(len(names) >= least, role, names, "at least one name", f'write {role}=["q", "v"]')
    for name in names:
        fits = isinstance(name, str) and _NAME.fullmatch(name) is not None
        check(fits, role, name, _ALLOWED, "rename it")
    return tuple(names)
