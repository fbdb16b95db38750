"""Plain data that cannot be edited: what an object is made of, shown and not lent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any, ClassVar, NoReturn

import numpy as np

from hgo_rs.errors import HgoError


class ReadOnlyError(HgoError, TypeError):
    """An edit of what describes an object: it would no longer be what it computes with."""


def _refuse(self: Any, *_: Any, **__: Any) -> NoReturn:
    raise ReadOnlyError(
        "this description is read-only: an edit would not change the object that it describes; "
        "make a new object, or edit what copy.deepcopy gives"
    )


class ReadOnlyDict(dict[str, Any]):
    """A dict that refuses edits, all the way down. `copy.deepcopy` gives a plain one."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        super().__init__({key: read_only(value) for key, value in values.items()})

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return read_only, (plain(self),)

    def __deepcopy__(self, memo: dict[int, Any]) -> dict[str, Any]:
        return dict(plain(self))


class ReadOnlyList(list[Any]):
    """A list that refuses edits, all the way down. `copy.deepcopy` gives a plain one."""

    def __init__(self, values: Iterable[Any]) -> None:
        super().__init__(map(read_only, values))

    __setitem__ = __delitem__ = __iadd__ = __imul__ = _refuse
    append = clear = extend = insert = pop = remove = reverse = sort = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        return read_only, (plain(self),)

    def __deepcopy__(self, memo: dict[int, Any]) -> list[Any]:
        return list(plain(self))


class Described:
    """A dataclass of numbers, flags and tuples that is told as plain data."""

    _kind: ClassVar[tuple[str, str]]
    """The entry that says what it is, ("kind", "ship")."""

    @property
    def spec(self) -> dict[str, Any]:
        """The object as plain data, read-only."""
        plainly = {"float": float, "int": int, "bool": bool}
        key, kind = self._kind
        own: Any = fields(self)  # type: ignore[arg-type]
        values = {f.name: plainly.get(f.type, list)(getattr(self, f.name)) for f in own}
        return ReadOnlyDict({key: kind, **values})


def read_only(value: Any) -> Any:
    """Dicts, lists and arrays as copies that refuse edits; what is read-only already as it is."""
    if isinstance(value, (ReadOnlyDict, ReadOnlyList)):
        return value
    if isinstance(value, Mapping):
        return ReadOnlyDict(value)
    if isinstance(value, list):
        return ReadOnlyList(value)
    if isinstance(value, tuple):
        return tuple(map(read_only, value))
    if isinstance(value, np.ndarray):
        return shown(value.copy()) if value.flags.writeable else value
    return value


def plain(value: Any) -> Any:
    """Plain dicts, lists and arrays, which may be edited."""
    if isinstance(value, Mapping):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return list(map(plain, value))
    if isinstance(value, tuple):
        return tuple(map(plain, value))
    return value.copy() if isinstance(value, np.ndarray) else value


def same(a: Any, b: Any) -> bool:
    """Whether plain data is equal, all the way down; NaN equals NaN."""
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return a.keys() == b.keys() and all(same(value, b[key]) for key, value in a.items())
    if isinstance(a, (list, tuple)) and isinstance(b, (list, tuple)):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        numbers = all(np.asarray(one).dtype.kind in "fc" for one in (a, b))
        return np.array_equal(a, b, equal_nan=numbers)
    return bool(a == b or (a != a and b != b))


def shown(array: Any) -> Any:
    """The same numbers, which cannot be written to through it; what is no array as it is."""
    if not isinstance(array, np.ndarray):
        return array
    view = array.view()
    view.flags.writeable = False
    return view
