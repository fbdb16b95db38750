"""`observer.toml`: one file that says what an observer is and how a log is read for it.

`load` reads one, `Config.save` and `Observer.save` write one. A configuration is plain data,
checked key by key against the tables of `keys`; its numbers are checked by the classes of hgo_rs.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs import models, observers
from hgo_rs._version import __version__
from hgo_rs.config import keys
from hgo_rs.config.keys import FORMAT, MODELS, OBSERVERS, TEXT, TOP, ConfigError, Kind
from hgo_rs.config.tables import model_table, observer_table, plain
from hgo_rs.config.text import check_schema, parsed, read
from hgo_rs.design.discrete import EXACT
from hgo_rs.errors import HgoError, check, check_path, nearest
from hgo_rs.files import write_text
from hgo_rs.laws import LAWS
from hgo_rs.observers import HighGainObserver, Observer, StochasticApproximation
from hgo_rs.observers.records import STARTS
from hgo_rs.read_only import read_only

_RIVALS = (("gain", "epsilon", "theta"), ("poles", *keys.LISTS))
"""Keys that stand in place of one another: a change of one drops the others."""

_UNITS = {"gain": "1/s", "epsilon": "s", "dt": "s", "t": "s"}
_KEYS = {"n": "order", "ell": "gain", "x_hat0": "x_hat", "r0": "r", "memory0": "memory"}
"""The keys of parameters that have another name in Python."""


@dataclass(frozen=True)
class Config:
    """An observer and the columns of its log: the contents of an `observer.toml`.

    Attributes
    ----------
    data : dict
        The contents: plain numbers, texts, lists and dicts, read-only (`replace` gives another
        configuration). See the page on configuration.
    source : str
        The file, for errors; "" if there is none.

    Raises
    ------
    ConfigError
        An unknown key, a wrong type, a missing key, another format.
    """

    data: Mapping[str, Any]
    source: str = field(default="", compare=False)
    _lines: Mapping[tuple[str, ...], int] = field(default_factory=dict, compare=False, repr=False)

    def __post_init__(self) -> None:
        remedy = "give the keys of an observer.toml, or hgo_rs.load one"
        check(isinstance(self.data, Mapping), "data", self.data, "a dict", remedy, ConfigError)
        object.__setattr__(self, "data", read_only(self.data))
        self._check()

    def __hash__(self) -> int:
        """As equality, of what the file says, whatever the order of its keys."""
        return hash(frozenset(self.data))

    # --- from and to text -----------------------------------------------------------------------

    @classmethod
    def from_toml(cls, text: str, source: str = "") -> Config:
        """A configuration from the text of an `observer.toml`."""
        data, places = parsed(text, source or "configuration")
        return cls(data, source, places)

    def to_toml(self) -> str:
        """The text of this configuration; reading it gives an equal one, to the last bit."""
        import tomlkit

        def item(value: Any) -> Any:
            if not isinstance(value, dict):
                return tomlkit.item(value)
            inside = tomlkit.inline_table()
            inside.update({key: item(inner) for key, inner in value.items()})
            return inside

        def fill(into: Any, values: Mapping[str, Any]) -> Any:
            for key, value in values.items():
                written = item(value)
                if key in _UNITS and keys.is_number(value):
                    written.comment(_UNITS[key])
                into.add(key, written)
            return into

        document = tomlkit.document()
        tables = [
            key
            for key, kind in TOP.items()
            if kind in (keys.TABLE, keys.TABLES) and key in self.data
        ]
        fill(
            document, {key: self.data[key] for key in TOP if key in self.data and key not in tables}
        )
        for key in tables:
            document.add(tomlkit.nl())
            if TOP[key] is keys.TABLES:
                several = tomlkit.aot()
                for table in self.data[key]:
                    several.append(fill(tomlkit.table(), table))
                document.add(key, several)
            else:
                document.add(key, fill(tomlkit.table(), self.data[key]))
        return tomlkit.dumps(document)

    def save(self, path: str | Path) -> None:
        """Write an `observer.toml`, completely or not at all: a failed write leaves the earlier
        file."""
        path = check_path(path)
        try:
            write_text(path, self.to_toml())
        except OSError as error:
            raise ConfigError(f"cannot write {path}: {error.strerror or error}") from error

    # --- from and to objects --------------------------------------------------------------------

    @classmethod
    def of(cls, observer: Observer, **log: Any) -> Config:
        """The configuration of an observer, with its present memory as start; `log` is the table
        `[log]`."""
        spec = observer.spec
        data = {"format": FORMAT, **observer_table(spec)}
        if observer.allow_unstable:
            data["allow_unstable"] = True
        model = model_table(observer)
        if model is not None:
            data["model"] = model
        # its first sample is taken at t = 0
        under_way = observer._started or observer._time != 0.0
        moved = not np.array_equal(observer.memory, observer.initial_memory())
        if observer._told or under_way or moved:
            data["start"] = {"memory": observer.memory.tolist()}
        if under_way:
            data["start"]["t"] = observer._time
        if log:
            data["log"] = {key: value for key, value in log.items() if value is not None}
        return cls(plain(data))

    def observer(self) -> Observer:
        """A new observer of this configuration, at its start."""
        law, accepted = maker(self.data["observer"])
        given = {
            {"order": "n"}.get(key, key): value
            for key, value in self.data.items()
            if key not in ("format", "observer", "model", "start", "log")
        }
        if "observers" in given:
            given["observers"] = [inner.observer() for inner in self._inner()]
        if isinstance(given.get("gain"), dict):
            given["gain"] = self._law("gain", given["gain"], keys.GAINS)
        if "shape" in given:
            given["shape"] = self._law("shape", given["shape"], keys.SHAPES)
        if "poles" in given:
            given["poles"] = [complex(*p) if isinstance(p, list) else p for p in given["poles"]]
        if "model" in self.data:
            given["model"] = self._model()
            order = given["model"].order
            if "n" in accepted and order is not None:
                given.setdefault("n", order)
        observer: Observer = self._built((), law, given)
        start = self.data.get("start")
        if start:
            names = {"x_hat": "x_hat0", "r": "r0", "memory": "memory0", "t": "t"}
            given = {names[k]: v for k, v in start.items() if k != "from"}
            self._built(("start",), observer.reset, given)
            observer._started = "t" in start
        return observer

    @property
    def start(self) -> str | None:
        """Start of a run over a log: "first-sample"; "zero" for the memory of `observer`; None for
        the first sample if the observer's output is its first state.
        """
        start = self.data.get("start", {})
        stands = not {"x_hat", "memory"}.isdisjoint(start)
        return "zero" if stands else start.get("from")

    def _inner(self) -> list[Config]:
        """Each of `[[observers]]`, as a configuration of its own."""
        inner = []
        for i, table in enumerate(self.data["observers"]):
            path = ("observers", str(i))
            lines = {p[2:]: line for p, line in self._lines.items() if p[:2] == path and p[2:]}
            inner.append(Config({"format": FORMAT, **table}, self.source, lines))
        return inner

    @property
    def log(self) -> dict[str, Any]:
        """The arguments of `hgo_rs.data.read_log`."""
        log = {"time": None, **self.data.get("log", {})}
        if "schedule" in log:
            law = StochasticApproximation
            log["schedule"] = self._built(("log", "schedule"), law, log["schedule"])
        return log

    def replace(self, log: Mapping[str, Any] | None = None, **changes: Any) -> Config:
        """This configuration with other values; `log` changes keys of the table `[log]`.

        Keys that a new value makes meaningless are removed: `epsilon` beside a new `gain`, `motion`
        under a method that integrates the model itself.
        """
        data = dict(self.data)
        if changes.get("method", EXACT[0]) not in EXACT:
            data = {key: value for key, value in data.items() if key not in ("motion", "substeps")}
        if changes.get("motion") == "held":
            data.pop("substeps", None)
        for rivals in _RIVALS:
            if any(key in changes for key in rivals):
                data = {key: value for key, value in data.items() if key not in rivals}
        data |= changes
        if log:
            data["log"] = {**data.get("log", {}), **log}
        return Config(plain(data), self.source, self._lines)

    def wrapping(self, output: int, turn: float) -> Config:
        """This configuration with the turn of an output."""
        if "observers" not in self.data:
            return self.replace(wrap=turn)
        inner = [dict(table) for table in self.data["observers"]]
        inner[output]["wrap"] = turn
        return self.replace(observers=inner)

    def without(self, key: str) -> Config:
        """This configuration without a key at its head."""
        data = {name: value for name, value in self.data.items() if name != key}
        return Config(plain(data), self.source, self._lines)

    def _law(self, key: str, told: dict[str, Any], known: Mapping[str, Any]) -> Any:
        name, _ = known[told["law"]]
        return self._built((key,), getattr(observers, name), _without(told, "law"))

    def _model(self) -> Any:
        told = self.data["model"]
        name, _ = MODELS[_model_kind(told)]
        given = _without(told, "kind")
        if "w" in given:
            given["w"] = tuple(given["w"])
        return self._built(("model",), getattr(models, name), given)

    def _built(self, path: tuple[str, ...], make: Callable[..., Any], given: dict[str, Any]) -> Any:
        """What `make` gives; its errors name file and line."""
        for name, parameter in inspect.signature(make).parameters.items():
            needed = (
                parameter.default is parameter.empty and parameter.kind != parameter.VAR_KEYWORD
            )
            if needed and name not in given:
                key = _KEYS.get(name, name)
                raise self._error((*path, key), "is missing", f"add {key} = ...")
        try:
            return make(**given)
        except ConfigError:
            raise
        except HgoError as error:
            named = re.match(r"\w+", str(error))
            key = named[0] if named else ""
            key = _KEYS.get(key, key)
            inside = path if key not in self._at(path) else (*path, key)
            told, *shown = str(error).split("\n")  # of an expression: its text, and a caret below
            told += f", in {shown[0].strip()!r}" if shown else ""
            raise ConfigError(f"{self.place(inside)}: {told}") from error

    # --- checks ---------------------------------------------------------------------------------

    def _at(self, path: tuple[str, ...]) -> Any:
        value: Any = self.data
        for key in path:
            value = value.get(key, {}) if isinstance(value, Mapping) else {}
        return value if isinstance(value, Mapping) else {}

    def place(self, path: tuple[str, ...]) -> str:
        """File and line of a key, or of the table around it, for errors."""
        place = self.source or "configuration"
        for length in range(len(path), 0, -1):
            if path[:length] in self._lines:
                return f"{place}, line {self._lines[path[:length]]}"
        line = self._lines.get(("observer",), 1) if self._lines else 0
        return f"{place}, line {line}" if line else place

    def _error(self, path: tuple[str, ...], what: str, remedy: str) -> ConfigError:
        return ConfigError(f"{self.place(path)}: {'.'.join(path)} {what}; {remedy}")

    def _check(self) -> None:
        if "format" not in self.data:
            self._check_table((), self.data, TOP)
            raise self._error(("format",), "is missing", f"begin the file with format = {FORMAT}")
        self._check_type(("format",), self.data["format"], keys.INTEGER)
        if self.data["format"] != FORMAT:
            given = self.data["format"]
            raise self._error(
                ("format",),
                f"= {given}: the file is of format {given}, hgo_rs {__version__} reads format "
                f"{FORMAT}",
                "take the version of hgo_rs that wrote it, or write the file anew"
                + (" and say format = 1" if given < FORMAT else ""),
            )
        self._check_table((), self.data, TOP)
        if "observer" not in self.data:
            choice = ", ".join(OBSERVERS)
            raise self._error(("observer",), "is missing", f"name one of {choice}")
        self._check_choice(("observer",), self.data["observer"], OBSERVERS)
        for key, laws in (("gain", keys.GAINS), ("shape", keys.SHAPES)):
            told = self.data.get(key)
            if isinstance(told, dict):
                kind = self._check_kind((key,), told, "law", laws)
                self._check_table((key,), told, {"law": TEXT, **laws[kind][1]}, needs=True)
        self._check_use()
        model = self.data.get("model")
        if model is not None:
            if "kind" not in model and not set(model) & set(MODELS["own"][1]):
                raise self._error(
                    ("model", "kind"), "is missing", f"name one of {', '.join(MODELS)}"
                )
            kind = self._check_kind(("model",), {"kind": "own", **model}, "kind", MODELS)
            self._check_table(("model",), model, {"kind": TEXT, **MODELS[kind][1]})
        if "observers" in self.data:
            self._inner()
        self._check_table(("start",), self.data.get("start", {}), keys.START)
        if "from" in self.data.get("start", {}):
            self._check_choice(("start", "from"), self.data["start"]["from"], dict.fromkeys(STARTS))
            for key in ("x_hat", "memory"):
                if key in self.data["start"]:
                    raise self._error(("start", "from"), f"is given beside {key}", "leave one out")
        log = self.data.get("log", {})
        self._check_table(("log",), log, keys.LOG)
        self._check_table(("log", "schedule"), log.get("schedule", {}), keys.SCHEDULE)

    def _check_use(self) -> None:
        """Every key at the head is an argument of the observer's class."""
        name = self.data["observer"]
        _, accepted = maker(name)
        for key in self.data:
            if key in ("format", "observer", "start", "log"):
                continue
            if {"order": "n"}.get(key, key) not in accepted:
                raise self._error((key,), f"has no meaning for observer = {name!r}", "leave it out")

    def _check_kind(
        self, path: tuple[str, ...], table: dict[str, Any], key: str, known: Mapping[str, Any]
    ) -> str:
        if key not in table:
            raise self._error((*path, key), "is missing", f"name one of {', '.join(known)}")
        self._check_choice((*path, key), table[key], known)
        return str(table[key])

    def _check_choice(self, path: tuple[str, ...], value: Any, known: Mapping[str, Any]) -> None:
        if not isinstance(value, str) or value not in known:
            near = nearest(value, known, cutoff=0.6) if isinstance(value, str) else []
            remedy = f"nearest: {', '.join(near)}; " if near else ""
            raise self._error(
                path, f"= {value!r} is not known", f"{remedy}known: {', '.join(known)}"
            )

    def _check_table(
        self,
        path: tuple[str, ...],
        table: Mapping[str, Any],
        known: Mapping[str, Kind],
        needs: bool = False,
    ) -> None:
        """Every key is known and of its type; with `needs`, all but the optional ones are there."""
        for key, value in table.items():
            if key not in known:
                raise self._unknown((*path, key), known)
            self._check_type((*path, key), value, known[key])
        for key in known if needs else ():
            if key not in table and key not in keys.OPTIONAL:
                raise self._error((*path, key), "is missing", f"add {key} = ...")

    def _check_type(self, path: tuple[str, ...], value: Any, kind: Kind) -> None:
        if not kind.holds(value):
            shown = _toml_type(value)
            raise self._error(path, f"is {shown}", f"write {kind.wanted}")

    def _unknown(self, path: tuple[str, ...], known: Mapping[str, Kind]) -> ConfigError:
        homes = {
            "no table": TOP,
            "[model]": MODELS["own"][1],
            "[start]": keys.START,
            "[log]": keys.LOG,
        }
        home = next((name for name, table in homes.items() if path[-1] in table), None)
        near = nearest(path[-1], known, cutoff=0.6)
        if home:
            remedy = f"it belongs to {home}"
        elif near:
            remedy = f"nearest: {', '.join(near)}"
        else:
            remedy = f"known: {', '.join(known)}"
        return self._error(path, "is not a known key", remedy)


def load(path: str | Path) -> Config:
    """Read an `observer.toml`.

    Raises
    ------
    ConfigError
        A file that cannot be read, is not TOML or of another format; a key that is unknown, missing
        or of a wrong type: names file, line and remedy.

    Warns
    -----
    SchemaWarning
        A comment `#:schema FILE` names a JSON Schema of another version of hgo_rs.
    """
    path = check_path(path)
    text = read(path)
    check_schema(text, path)
    return Config.from_toml(text, str(path))


def save(observer: Observer, path: str | Path, **log: Any) -> None:
    """`Observer.save`."""
    Config.of(observer, **log).save(path)


def maker(kind: str) -> tuple[Callable[..., Any], set[str]]:
    """What makes the observer of a structure, and the arguments that it takes."""
    make = getattr(observers, OBSERVERS[kind])
    accepted = set(inspect.signature(make).parameters)
    if make is not HighGainObserver:
        return make, accepted
    law = LAWS[kind]
    accepted -= {"kind", "entries", *(() if law.saturated else ("saturation", "clip"))}
    accepted |= {*(name for name, _ in law.coefficients), *(law.size[:1] if law.size else ())}
    return partial(make, kind), accepted


def _toml_type(value: Any) -> str:
    names = {bool: "a flag", int: "an integer", float: "a number", str: "text", dict: "a table"}
    if isinstance(value, list):
        return "a list of something else" if value else "an empty list"
    return names.get(type(value), f"a {type(value).__name__}")


def _without(table: Mapping[str, Any], key: str) -> dict[str, Any]:
    return {name: value for name, value in table.items() if name != key}


def _model_kind(table: Mapping[str, Any]) -> str:
    return str(table.get("kind", "own"))
