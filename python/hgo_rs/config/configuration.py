"""`observer.toml`: one file that says what an observer is and how a log is read for it.

`load` reads one, `Config.save` and `Observer.save` write one. A configuration is plain data,
checked key by key against the tables below; its numbers are checked by the classes of hgo_rs.
"""

from __future__ import annotations

import difflib
import inspect
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hgo_rs.errors import HgoError
from hgo_rs.files import write_text
from hgo_rs.read_only import read_only

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

if TYPE_CHECKING:
    from hgo_rs.observers import Observer

__all__ = ["FORMAT", "OBSERVERS", "Config", "ConfigError", "load"]

FORMAT = 1
"""The format of `observer.toml` that this version reads and writes."""

OBSERVERS = {
    "standard": "StandardObserver",
    "low-power": "LowPowerObserver",
    "peaking-free": "PeakingFreeObserver",
    "collection": "RepelledCollection",
    "modified": "ModifiedObserver",
    "sampled-data": "SampledDataObserver",
    "reduced-order": "ReducedOrderObserver",
    "chains": "MultiOutputObserver",
}
"""The structures, and the class of hgo_rs behind each name."""


LARGEST = 2**18
"""Bytes of the largest file that is read."""
LONGEST = 300
"""Lines of the longest value that is read."""
DEEPEST = 16
"""Parts of the longest key that is read."""
_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')"""
_DEEP = re.compile(rf"(?<![\w-]){_PART}(?:[ \t]*\.[ \t]*{_PART}){{{DEEPEST},}}")


class ConfigError(HgoError):
    """A configuration that is refused: names the file, the line and the remedy."""


# --- what may stand in the file ---------------------------------------------------------------

Kind = tuple[Callable[[Any], bool], str]


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _all(value: Any, holds: Callable[[Any], bool]) -> bool:
    return isinstance(value, list) and len(value) > 0 and all(map(holds, value))


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_pole(value: Any) -> bool:
    return _is_number(value) or (_all(value, _is_number) and len(value) == 2)


NUMBER: Kind = (_is_number, "a number")
INTEGER: Kind = (lambda v: isinstance(v, int) and not isinstance(v, bool), "an integer")
FLAG: Kind = (lambda v: isinstance(v, bool), "true or false")
TEXT: Kind = (_is_text, 'text in quotes, such as "a"')
NUMBERS: Kind = (lambda v: _all(v, _is_number), "numbers in brackets, such as [1.0, 2.0]")
TEXTS: Kind = (lambda v: _all(v, _is_text), 'texts in brackets, such as ["a", "b"]')
ROWS: Kind = (
    lambda v: _all(v, lambda row: _is_text(row) or _all(row, _is_text)),
    'texts, or rows of them, in brackets, such as [["a", "b"], ["c", "d"]]',
)
TABLE: Kind = (lambda v: isinstance(v, dict), "a table")
TABLES: Kind = (lambda v: _all(v, lambda t: isinstance(t, dict)), "tables, one [[...]] for each")
INTEGERS: Kind = (lambda v: _all(v, INTEGER[0]), "integers in brackets, such as [2, 1]")
POLES: Kind = (
    lambda v: _all(v, _is_pole),
    "numbers, or pairs [real, imaginary], in brackets, such as [-1.0, [-2.0, 1.0], [-2.0, -1.0]]",
)
NUMBER_OR_NUMBERS: Kind = (lambda v: NUMBER[0](v) or NUMBERS[0](v), "a number or numbers")
TEXT_OR_TEXTS: Kind = (lambda v: TEXT[0](v) or TEXTS[0](v), 'text, or texts such as ["a", "b"]')
NAMED_NUMBERS: Kind = (
    lambda v: isinstance(v, dict) and all(map(_is_number, v.values())),
    "named numbers, such as { M = 2.0 }",
)
GAIN: Kind = (
    lambda v: _is_number(v) or isinstance(v, (str, dict)),
    'a number [1/s], or a law such as { law = "adaptive", p1 = 1.0, p2 = 1.0, b = 0.1 }',
)

TOP: dict[str, Kind] = {
    "format": INTEGER,
    "observer": TEXT,
    "order": INTEGER,
    "gain": GAIN,
    "epsilon": NUMBER,
    "poles": POLES,
    "k": NUMBERS,
    "alpha": NUMBERS,
    "beta": NUMBERS,
    "k_bar": NUMBERS,
    "h_bar": NUMBERS,
    "copies": INTEGER,
    "saturation": NUMBER_OR_NUMBERS,
    "clip": TEXT,
    "method": TEXT,
    "timing": TEXT,
    "allow_unstable": FLAG,
    "observers": TABLES,
    "model": TABLE,
    "start": TABLE,
    "log": TABLE,
}
"""The keys at the head of the file. From `order` to `allow_unstable` they are the arguments of the
observer's class; `order` is its n. `observers` are those of a model of several chains, each with
keys as at the head. What a file leaves open is as in the class."""

GAINS: dict[str, tuple[str, dict[str, Kind]]] = {
    "constant": ("ConstantGain", {"ell": NUMBER}),
    "adaptive": ("AdaptiveGain", {"p1": NUMBER, "p2": NUMBER, "b": NUMBER}),
    "dead-zone": ("DeadZoneGain", {"p1": NUMBER, "p2": NUMBER, "b": NUMBER}),
}
"""`gain = { law = ... }`: the class behind each law, and its keys."""

MODELS: dict[str, tuple[str, dict[str, Kind]]] = {
    "unknown": ("Unknown", {}),
    "input": ("InputGain", {"b0": NUMBER}),
    "lee": ("Lee", {}),
    "sanfelice-praly": ("SanfelicePraly", {"nu1": NUMBER, "nu2": NUMBER}),
    "van-der-pol": ("VanDerPol", {"epsilon": NUMBER, "sigma": NUMBER, "multiplicative": FLAG}),
    "crackle": ("Crackle", {"phi_max": NUMBER}),
    "ship": ("Ship", {"delta": NUMBER, "w": NUMBERS}),
    "own": (
        "Model",
        {
            "states": TEXTS,
            "inputs": TEXTS,
            "parameters": NAMED_NUMBERS,
            "orders": INTEGERS,
            "phi": TEXT_OR_TEXTS,
            "f": TEXTS,
            "f1": TEXTS,
            "g": ROWS,
            "f2": TEXTS,
            "h": TEXT,
            "K_T": TEXTS,
        },
    ),
}
"""`[model]`: the class behind each `kind`, and its keys. A table without `kind` is an own model."""

START: dict[str, Kind] = {"x_hat": NUMBERS, "r": NUMBER, "memory": NUMBERS, "t": NUMBER}
"""`[start]`: estimate and gain to start from, or the whole memory; of one in use, its time."""

LOG: dict[str, Kind] = {
    "time": TEXT_OR_TEXTS,
    "output": TEXT_OR_TEXTS,
    "input": TEXT_OR_TEXTS,
    "dt": NUMBER,
    "unit": TEXT_OR_TEXTS,
    "resets": TEXT,
    "schedule": TABLE,
}
"""`[log]`: the arguments of `hgo_rs.data.read_log`, and a schedule in place of times."""

SCHEDULE: dict[str, Kind] = {"alpha": NUMBER, "epsilon": NUMBER, "k0": NUMBER, "p": NUMBER}
"""`schedule = { ... }`: decreasing steps a(k) of `hgo_rs.StochasticApproximation`."""

_RIVALS = (("gain", "epsilon"), ("poles", "k", "alpha", "beta"))
"""Keys that stand in place of one another: a change of one drops the others."""

_UNITS = {"gain": "1/s", "epsilon": "s", "dt": "s", "t": "s"}
_KEYS = {"n": "order", "ell": "gain", "x_hat0": "x_hat", "r0": "r", "memory0": "memory"}
"""The keys of parameters that have another name in Python."""


# --- the configuration ------------------------------------------------------------------------


@dataclass(frozen=True)
class Config:
    """What an observer is, and how a log is read for it.

    Attributes
    ----------
    data : dict
        What the file says: plain numbers, texts, lists and dicts, read-only (`replace` gives
        another configuration). See the page of configurations.
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
        object.__setattr__(self, "data", read_only(self.data))
        self._check()

    # --- from and to text -----------------------------------------------------------------------

    @classmethod
    def from_toml(cls, text: str, source: str = "") -> Config:
        """A configuration from the text of an `observer.toml`."""
        place = source or "configuration"
        if len(text) > LARGEST:
            raise _too_large(place)
        deep = _DEEP.search(text)
        if deep:
            line = text.count("\n", 0, deep.start()) + 1
            raise ConfigError(
                f"{place}, line {line}: a key of more than {DEEPEST} parts; write key = value, "
                "with at most two dots in the key"
            )
        try:
            data = tomllib.loads(text)
            places: dict[tuple[str, ...], int] = {}
            for path, number in _places(text, place):
                places.setdefault(path, number)
        except tomllib.TOMLDecodeError as error:
            said = re.fullmatch(r"(.*) \(at (.*)\)", str(error), re.S)
            what, where = said.groups() if said else (str(error), "end of document")
            where = where.replace("end of document", f"line {len(text.splitlines())}")
            raise ConfigError(
                f"{place}, {where}: not TOML: {what}; write key = value, text in quotes, each key "
                "once"
            ) from None
        except RecursionError:
            raise ConfigError(f"{place}: nested too deeply; write flat tables") from None
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
                if key in _UNITS and _is_number(value):
                    written.comment(_UNITS[key])
                into.add(key, written)
            return into

        document = tomlkit.document()
        tables = [key for key, kind in TOP.items() if kind in (TABLE, TABLES) and key in self.data]
        fill(
            document, {key: self.data[key] for key in TOP if key in self.data and key not in tables}
        )
        for key in tables:
            document.add(tomlkit.nl())
            if TOP[key] is TABLES:
                several = tomlkit.aot()
                for table in self.data[key]:
                    several.append(fill(tomlkit.table(), table))
                document.add(key, several)
            else:
                document.add(key, fill(tomlkit.table(), self.data[key]))
        return tomlkit.dumps(document)

    def save(self, path: str | Path) -> None:
        """Write an `observer.toml`, whole or not at all: a failed write leaves the earlier file."""
        try:
            write_text(path, self.to_toml())
        except OSError as error:
            raise ConfigError(f"cannot write {path}: {error.strerror or error}") from error

    # --- from and to objects --------------------------------------------------------------------

    @classmethod
    def of(cls, observer: Observer, **log: Any) -> Config:
        """The configuration of an observer, started where it stands; `log` is the table `[log]`."""
        spec = observer.spec
        data = {"format": FORMAT, **_observer_table(spec)}
        if observer.allow_unstable:
            data["allow_unstable"] = True
        model = _model_table(observer)
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
        return cls(_plain(data))

    def observer(self) -> Observer:
        """A new observer as this configuration says, at its start."""
        import hgo_rs

        law = getattr(hgo_rs, OBSERVERS[self.data["observer"]])
        given = {
            {"order": "n"}.get(key, key): value
            for key, value in self.data.items()
            if key not in ("format", "observer", "model", "start", "log")
        }
        if "observers" in given:
            given["observers"] = [inner.observer() for inner in self._inner()]
        if isinstance(given.get("gain"), dict):
            given["gain"] = self._gain(given["gain"])
        if "poles" in given:
            given["poles"] = [complex(*p) if isinstance(p, list) else p for p in given["poles"]]
        if "model" in self.data:
            given["model"] = self._model()
            order = given["model"].order
            if "n" in inspect.signature(law).parameters and order is not None:
                given.setdefault("n", order)
        observer: Observer = self._built((), law, given)
        start = self.data.get("start")
        if start:
            names = {"x_hat": "x_hat0", "r": "r0", "memory": "memory0", "t": "t"}
            self._built(("start",), observer.reset, {names[k]: v for k, v in start.items()})
            observer._started = "t" in start
        return observer

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
            import hgo_rs

            law = hgo_rs.StochasticApproximation
            log["schedule"] = self._built(("log", "schedule"), law, log["schedule"])
        return log

    def replace(self, log: Mapping[str, Any] | None = None, **changes: Any) -> Config:
        """This configuration with other values; `log` changes keys of the table `[log]`."""
        data = dict(self.data)
        for rivals in _RIVALS:
            if any(key in changes for key in rivals):
                data = {key: value for key, value in data.items() if key not in rivals}
        data |= changes
        if log:
            data["log"] = {**data.get("log", {}), **log}
        return Config(_plain(data), self.source, self._lines)

    def _gain(self, told: dict[str, Any]) -> Any:
        import hgo_rs

        name, _ = GAINS[told["law"]]
        return self._built(("gain",), getattr(hgo_rs, name), _without(told, "law"))

    def _model(self) -> Any:
        import hgo_rs

        told = self.data["model"]
        name, _ = MODELS[_model_kind(told)]
        given = _without(told, "kind")
        if "w" in given:
            given["w"] = tuple(given["w"])
        return self._built(("model",), getattr(hgo_rs, name), given)

    def _built(self, path: tuple[str, ...], make: Callable[..., Any], given: dict[str, Any]) -> Any:
        """What `make` gives; its errors name file and line."""
        for name, parameter in inspect.signature(make).parameters.items():
            if parameter.default is inspect.Parameter.empty and name not in given:
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
        self._check_type(("format",), self.data["format"], INTEGER)
        if self.data["format"] != FORMAT:
            from hgo_rs import __version__

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
        gain = self.data.get("gain")
        if isinstance(gain, dict):
            kind = self._check_kind(("gain",), gain, "law", GAINS)
            self._check_table(("gain",), gain, {"law": TEXT, **GAINS[kind][1]}, needs=True)
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
        self._check_table(("start",), self.data.get("start", {}), START)
        log = self.data.get("log", {})
        self._check_table(("log",), log, LOG)
        self._check_table(("log", "schedule"), log.get("schedule", {}), SCHEDULE)

    def _check_use(self) -> None:
        """Every key at the head is an argument of the observer's class."""
        import hgo_rs

        name = self.data["observer"]
        accepted = inspect.signature(getattr(hgo_rs, OBSERVERS[name])).parameters
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
            near = _nearest(value, known) if isinstance(value, str) else []
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
        """Every key is known and of its type; with `needs`, all known keys are there."""
        for key, value in table.items():
            if key not in known:
                raise self._unknown((*path, key), known)
            self._check_type((*path, key), value, known[key])
        for key in known if needs else ():
            if key not in table:
                raise self._error((*path, key), "is missing", f"add {key} = ...")

    def _check_type(self, path: tuple[str, ...], value: Any, kind: Kind) -> None:
        holds, wanted = kind
        if not holds(value):
            shown = _toml_type(value)
            raise self._error(path, f"is {shown}", f"write {wanted}")

    def _unknown(self, path: tuple[str, ...], known: Mapping[str, Kind]) -> ConfigError:
        homes = {"no table": TOP, "[model]": MODELS["own"][1], "[start]": START, "[log]": LOG}
        home = next((name for name, table in homes.items() if path[-1] in table), None)
        near = _nearest(path[-1], known)
        if home:
            remedy = f"it stands in {home}"
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
    """
    path = Path(path)
    try:
        if path.exists() and not path.is_file() and not path.is_dir():
            raise ConfigError(
                f"{path} is a pipe or a device, which may have no end; write what it gives to a "
                "file"
            )
        with path.open("rb") as file:
            content = file.read(LARGEST + 1)
        if len(content) > LARGEST:
            raise _too_large(str(path))
        text = content.decode("utf-8-sig")
    except FileNotFoundError:
        beside = (p.name for p in path.parent.glob("*.toml")) if path.parent.is_dir() else ()
        near = _nearest(path.name, sorted(beside))
        hint = f"; nearest: {', '.join(near)}" if near else ""
        raise ConfigError(f"no file {path}{hint}") from None
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} is not text in UTF-8: byte {error.start}") from None
    return Config.from_toml(text, str(path))


def _too_large(place: str) -> ConfigError:
    return ConfigError(
        f"{place}: has more than {LARGEST} bytes, the most that are read; name an observer.toml"
    )


# --- parts ------------------------------------------------------------------------------------


def _places(text: str, source: str) -> Iterator[tuple[tuple[str, ...], int]]:
    """(path of keys, line) of every key in a text that is TOML.

    A statement is the shortest run of lines that TOML reads by itself; its keys stand at its first
    line, under the last header.
    """
    table: tuple[str, ...] = ()
    counts: dict[str, int] = {}
    fragment, first = "", 1
    for number, line in enumerate(text.split("\n"), 1):
        fragment += line + "\n"
        try:
            found = tomllib.loads(fragment)
        except tomllib.TOMLDecodeError:
            if number - first >= LONGEST:
                raise ConfigError(
                    f"{source}, line {first}: a value of more than {LONGEST} lines; write more of "
                    "it on a line"
                ) from None
            continue
        paths = list(_paths(found))
        if fragment.lstrip().startswith("[["):  # one more of several tables
            name = paths[0][0]
            counts[name] = counts.get(name, -1) + 1
            table = (name, str(counts[name]))
            paths = [(name,), table]
        elif fragment.lstrip().startswith("["):
            table = paths[-1]
            paths = [table[:depth] for depth in range(1, len(table) + 1)]
        else:
            paths = [table + path for path in paths]
        yield from ((path, first) for path in paths)
        fragment, first = "", number + 1


def _paths(table: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    for key, value in table.items():
        yield (key,)
        if isinstance(value, dict):
            yield from ((key, *path) for path in _paths(value))


def _nearest(name: str, known: Any) -> list[str]:
    folded = {k.casefold(): k for k in known}
    near = difflib.get_close_matches(name.casefold(), folded, n=3, cutoff=0.6)
    return [folded[k] for k in near]


def _toml_type(value: Any) -> str:
    names = {bool: "a flag", int: "an integer", float: "a number", str: "text", dict: "a table"}
    if isinstance(value, list):
        return "a list of something else" if value else "an empty list"
    return names.get(type(value), f"a {type(value).__name__}")


def _without(table: Mapping[str, Any], key: str) -> dict[str, Any]:
    return {name: value for name, value in table.items() if name != key}


def _plain(value: Any) -> Any:
    """Plain numbers, texts, lists and dicts in place of NumPy's, tuples and complex numbers."""
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    return value


def _observer_table(spec: Mapping[str, Any]) -> dict[str, Any]:
    """The keys at the head of a file, or of one of `[[observers]]`."""
    data: dict[str, Any] = {"observer": spec["kind"]}
    if spec["kind"] in ("standard", "low-power", "peaking-free"):
        data["order"] = spec["n"]
    for key, value in spec.items():
        if key == "gain" and isinstance(value, dict):
            data["gain"] = value["ell"] if value["law"] == "constant" else dict(value)
        elif key == "observers":
            data["observers"] = [_observer_table(inner) for inner in value]
        elif key in TOP and key != "model":
            data[key] = value
    return data


def _model_kind(table: Mapping[str, Any]) -> str:
    return str(table.get("kind", "own"))


def _model_table(observer: Observer) -> dict[str, Any] | None:
    """`[model]` of an observer; None where it knows nothing."""
    spec = dict(observer.spec["model"])
    kind = spec.pop("kind")
    if kind == "none":
        return None
    if kind != "own":
        return {"kind": kind, **spec}
    if observer.model is None:
        raise ConfigError(
            "model: this observer does not hold its expressions; save a Config of them"
        )
    return _own_table(observer.model)


def _own_table(model: Any) -> dict[str, Any]:
    """`[model]` of an own model: names, parameters, and its right-hand sides as expressions."""
    table: dict[str, Any] = {"states": list(model.states)}
    if model.inputs:
        table["inputs"] = list(model.inputs)
    if model.parameters:
        table["parameters"] = dict(model.parameters)
    orders = list(getattr(model, "orders", ()))
    if orders:
        table["orders"] = orders
    sides = {name: [str(node) for node in nodes] for name, nodes in model.equations.items()}
    for name, side in sides.items():
        if name == "h" or (name == "phi" and not orders):
            table[name] = side[0]
        elif name == "g":  # a row for each x
            width = len(side) // len(sides["f1"])
            table[name] = [side[i : i + width] for i in range(0, len(side), width)]
        else:
            table[name] = side
    return table
