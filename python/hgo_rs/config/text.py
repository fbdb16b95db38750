"""The text of an `observer.toml`: what is read of it, and the lines of its keys."""

from __future__ import annotations

import json
import re
import sys
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hgo_rs._version import __version__
from hgo_rs.config.keys import FORMAT, ConfigError
from hgo_rs.errors import nearest

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

LARGEST = 2**18
"""Bytes of the largest file that is read."""
LONGEST = 300
"""Lines of the longest value that is read."""
DEEPEST = 16
"""Parts of the longest key that is read."""
_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')"""
_DEEP = re.compile(rf"(?<![\w-]){_PART}(?:[ \t]*\.[ \t]*{_PART}){{{DEEPEST},}}")


def parsed(text: str, place: str) -> tuple[dict[str, Any], dict[tuple[str, ...], int]]:
    """What a text says, and the line of each key."""
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
            f"{place}, {where}: not TOML: {what}; write key = value, text in quotes, each key once"
        ) from None
    except RecursionError:
        raise ConfigError(f"{place}: nested too deeply; write flat tables") from None
    return data, places


def read(path: Path) -> str:
    """The text of a file."""
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
        near = nearest(path.name, sorted(beside), cutoff=0.6)
        hint = f"; nearest: {', '.join(near)}" if near else ""
        raise ConfigError(f"no file {path}{hint}") from None
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} is not text in UTF-8: byte {error.start}") from None
    return text


_DIRECTIVE = re.compile(r"#:schema[ \t]+(\S.*?)[ \t]*$", re.M)
_SCHEMA = re.compile(r"observer-(\d+)\.schema\.json$")


def schema_name(format: int) -> str:
    """The file of the JSON Schema of a format."""
    return f"observer-{format}.schema.json"


class SchemaWarning(UserWarning):
    """A JSON Schema that an editor takes is of another version of hgo_rs."""


def check_schema(text: str, path: Path) -> None:
    """Look at the schema that a comment `#:schema FILE` names for editors.

    Raises
    ------
    ConfigError
        It is of another format.

    Warns
    -----
    SchemaWarning
        It is of another version of hgo_rs; of a file beside this one alone.
    """
    said = _DIRECTIVE.search(text)
    if not said:
        return
    place = f"{path}, line {text.count(chr(10), 0, said.start()) + 1}: the schema {said[1]}"
    number = _SCHEMA.search(said[1])
    if number and int(number[1]) != FORMAT:
        raise ConfigError(
            f"{place} is of format {number[1]}, hgo_rs {__version__} reads format {FORMAT}; name "
            f"{schema_name(FORMAT)}, which `hgo list schema` prints"
        )
    try:
        made = json.loads((path.parent / said[1]).read_text(encoding="utf-8"))["x-hgo_rs"]
    except (OSError, ValueError, KeyError, TypeError):
        return  # elsewhere, or of another kind: it is the editor's to tell
    if isinstance(made, dict) and made != {"file": schema_name(FORMAT), "version": __version__}:
        told = f"{place} is {made.get('file')} of hgo_rs {made.get('version')}, this is "
        remedy = "write it anew: hgo list schema"
        warnings.warn(f"{told}hgo_rs {__version__}; {remedy}", SchemaWarning, stacklevel=3)


def toml(value: Any) -> str:
    """Plain data on one line of TOML; reading it gives the same."""
    import tomlkit

    if isinstance(value, Mapping):
        pairs = (f"{tomlkit.key(key).as_string()} = {toml(inner)}" for key, inner in value.items())
        return f"{{ {', '.join(pairs)} }}" if value else "{}"
    return tomlkit.item(value).as_string()


def _too_large(place: str) -> ConfigError:
    return ConfigError(
        f"{place}: has more than {LARGEST} bytes, the most that are read; name an observer.toml"
    )


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
