"""JSON Schema of an `observer.toml`, for editors: made of the tables of `keys`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from hgo_rs._version import __version__
from hgo_rs.config import keys
from hgo_rs.config.configuration import maker
from hgo_rs.config.keys import FORMAT, GAINS, MODELS, OBSERVERS, OPTIONAL, SHAPES, TOP, Kind
from hgo_rs.config.text import schema_name

DRAFT = "http://json-schema.org/draft-07/schema#"
_ANYWHERE = ("format", "observer", "start", "log")
"""Keys at the head that every observer has."""

Schema = dict[str, Any]


def schema() -> Schema:
    """The schema, as plain data.

    It refuses what `hgo_rs.load` refuses without building the observer: keys that are unknown or
    without a meaning for the observer that is named, values of a wrong type, choices that there are
    not, another format. Ranges are left to the classes.
    """
    head = _properties(TOP) | {
        "format": {"const": FORMAT},
        "gain": {"anyOf": [*keys.GAIN.schema["anyOf"][:-1], _laws("law", GAINS, needs=True)]},
        "shape": _laws("law", SHAPES, needs=True),
        "model": _laws("kind", MODELS, usual="own"),
        "start": {**_table(keys.START), "not": _beside("from", ("x_hat", "memory"))},
        "log": _table({**keys.LOG, "schedule": keys.TABLE}),
        "observers": {**keys.TABLES.schema, "items": {"$ref": "#/definitions/observer"}},
    }
    head["log"]["properties"]["schedule"] = _table(keys.SCHEDULE)
    for key, told in keys.TOLD.items():
        head[key] = {"description": told, **head[key]}
    return {
        "$schema": DRAFT,
        "title": f"observer.toml of hgo_rs, format {FORMAT}",
        "x-hgo_rs": {"file": schema_name(FORMAT), "version": __version__},
        "definitions": {
            "observer": {
                "type": "object",
                "required": ["observer"],
                "properties": head,
                "additionalProperties": False,
                "allOf": _uses(),
            }
        },
        "allOf": [{"$ref": "#/definitions/observer"}],
        "required": ["format"],
    }


def text() -> str:
    """The schema as a file."""
    return json.dumps(schema(), indent=1, ensure_ascii=False) + "\n"


def _properties(known: Mapping[str, Kind]) -> Schema:
    return {key: dict(kind.schema) for key, kind in known.items()}


def _table(known: Mapping[str, Kind]) -> Schema:
    """A table of these keys, all of which may be left out."""
    return {"type": "object", "properties": _properties(known), "additionalProperties": False}


def _laws(
    tag: str,
    known: Mapping[str, tuple[str, Mapping[str, Kind]]],
    *,
    needs: bool = False,
    usual: str | None = None,
) -> Schema:
    """A table whose keys are those of the law that its `tag` names; `usual`: without a tag."""
    cases = []
    for name, (_, own) in known.items():
        found: Schema = {"properties": {tag: {"const": name}}}
        if name != usual:
            found["required"] = [tag]
        then = _table({tag: keys.TEXT, **own})
        then["required"] = [key for key in own if needs and key not in OPTIONAL]
        cases.append({"if": found, "then": then})
    table: Schema = {"type": "object", "properties": {tag: {"enum": list(known)}}, "allOf": cases}
    return table | ({"minProperties": 1} if usual else {"required": [tag]})


def _beside(key: str, others: tuple[str, ...]) -> Schema:
    """A key beside one of some others."""
    return {"required": [key], "anyOf": [{"required": [other]} for other in others]}


def _uses() -> list[Schema]:
    """Which keys have a meaning, by observer; those with the same ones together."""
    together: dict[tuple[str, ...], list[str]] = {}
    for kind in OBSERVERS:
        _, accepted = maker(kind)
        used = (key for key in TOP if key in _ANYWHERE or {"order": "n"}.get(key, key) in accepted)
        together.setdefault(tuple(used), []).append(kind)
    return [
        {
            "if": {"properties": {"observer": {"enum": kinds}}},
            "then": {"propertyNames": {"enum": list(used)}},
        }
        for used, kinds in together.items()
    ]
