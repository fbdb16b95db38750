"""Units of an FMU's variables: texts such as "rad/s", and their dimensions in SI."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from hgo_rs.errors import HgoError, check, explain
from hgo_rs.exports.program import Program
from hgo_rs.exports.traced import model_of
from hgo_rs.exports.words import memory_words
from hgo_rs.observers import Observer

__all__ = ["Dimension", "checked", "dimension"]

_BASES = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Dimension:
    """A unit as `factor` times powers of the base units."""

    powers: tuple[int, ...]
    factor: float = 1.0

    @property
    def attributes(self) -> dict[str, str]:
        """What FMI's BaseUnit says of it."""
        named = {base: str(p) for base, p in zip(_BASES, self.powers, strict=True) if p}
        return named | ({"factor": repr(self.factor)} if self.factor != 1.0 else {})


def _of(factor: float = 1.0, **powers: int) -> Dimension:
    return Dimension(tuple(powers.get(base, 0) for base in _BASES), factor)


_UNITS = {
    "1": _of(),
    **{base: _of(**{base: 1}) for base in _BASES},
    "g": _of(1e-3, kg=1),
    "mm": _of(1e-3, m=1),
    "cm": _of(1e-2, m=1),
    "km": _of(1e3, m=1),
    "ms": _of(1e-3, s=1),
    "us": _of(1e-6, s=1),
    "min": _of(60.0, s=1),
    "h": _of(3600.0, s=1),
    "deg": _of(0.017453292519943295, rad=1),
    "rev": _of(6.283185307179586, rad=1),
    "Hz": _of(s=-1),
    "N": _of(kg=1, m=1, s=-2),
    "kN": _of(1e3, kg=1, m=1, s=-2),
    "Pa": _of(kg=1, m=-1, s=-2),
    "kPa": _of(1e3, kg=1, m=-1, s=-2),
    "bar": _of(1e5, kg=1, m=-1, s=-2),
    "J": _of(kg=1, m=2, s=-2),
    "W": _of(kg=1, m=2, s=-3),
    "kW": _of(1e3, kg=1, m=2, s=-3),
    "V": _of(kg=1, m=2, s=-3, A=-1),
    "mV": _of(1e-3, kg=1, m=2, s=-3, A=-1),
    "mA": _of(1e-3, A=1),
    "C": _of(s=1, A=1),
    "Ohm": _of(kg=1, m=2, s=-3, A=-2),
    "F": _of(kg=-1, m=-2, s=4, A=2),
    "H": _of(kg=1, m=2, s=-2, A=-2),
    "Wb": _of(kg=1, m=2, s=-2, A=-1),
    "T": _of(kg=1, s=-2, A=-1),
}


def dimension(text: str) -> Dimension | None:
    """The dimension of a product of SI's units, such as "N*m/rad" or "kg.m2/s^2".

    A sign / holds for the one factor behind it. None for a unit that is not made of these.
    """
    powers, factor = [0] * len(_BASES), 1.0
    for part in re.split(r"(?=/)|[*.·]", text.replace(" ", "")):
        found = re.fullmatch(r"(/?)([A-Za-z]+|1)(?:\^?([+-]?\d+))?", part)
        unit = _UNITS.get(found[2]) if found else None
        if found is None or unit is None:
            return None
        power = int(found[3] or 1) * (-1 if found[1] else 1)
        powers = [held + power * own for held, own in zip(powers, unit.powers, strict=True)]
        factor *= unit.factor**power
    return Dimension(tuple(powers), factor)


def checked(
    units: Mapping[str, str] | None, observer: Observer, program: Program
) -> dict[str, str]:
    """Units by the words of the source, from units by the user's words.

    Raises
    ------
    HgoError
        No dict of texts; a name that is none of the observer's.
    """
    given = {} if units is None else units
    remedy = 'write units={"q": "rad", "u": "N*m"}'
    check(isinstance(given, Mapping), "units", given, "a dict of names and units", remedy)
    words, own = program.words, model_of(observer.spec).get("names") or {}
    held = (*program.memory, *program.parameters)
    known = {word: word for word in (*words.samples, *words.controls)}
    known |= {field.name: field.name for field in held}
    states = [word for word, _ in memory_words(observer)[: observer.n]]
    for users, ours in (
        (states, words.memory),
        (own.get("inputs", ()), words.controls),
        (own.get("parameters", ()), words.parameters),
    ):
        known |= dict(zip(users, ours, strict=False))
    found = {field.name: "s" for field in program.memory if field.meaning.endswith(", s")}
    for name, unit in given.items():
        if name not in known:
            raise HgoError(explain("units", name, f"of one of {', '.join(known)}", remedy))
        fits = isinstance(unit, str) and bool(unit.strip()) and unit.isprintable()
        check(fits, f"units[{name!r}]", unit, "a text such as rad/s", remedy)
        found[known[name]] = unit.strip()
    return found
