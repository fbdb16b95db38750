"""Bags of ROS 1 and ROS 2, MCAP among them, by the library rosbags.

The fields of a topic are the columns `topic/field`, `topic/field/part`, `topic/field[i]`;
`topic/log_time` is when a message was recorded. The clock of a topic is the stamp of its header
where it is set, else `log_time`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from hgo_rs.logs.recording import Recording, elements, stamps

Steps = tuple[str | int, ...]
"""The way from a message to a number: names of fields, and places in lists."""


class Stamp(int):
    """A time of a message, ns."""


@contextmanager
def opened(path: Path) -> Iterator[Recording]:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    # a database of a folder is told of by the file beside it
    if path.suffix == ".db3" and (path.parent / "metadata.yaml").exists():
        path = path.parent
    usual = get_typestore(Stores.LATEST)  # of bags before Iron, which do not hold their types
    with AnyReader([path], default_typestore=usual) as reader:
        home: dict[str, tuple[str, Steps | None]] = {}
        clocks: dict[str, str | None] = {}
        times: set[str] = set()
        for topic in sorted({connection.topic for connection in reader.connections}):
            mine = [c for c in reader.connections if c.topic == topic]
            first = next(reader.messages(mine), None)
            if first is None:
                continue
            connection, _, raw = first
            fields = dict(_fields(topic, reader.deserialize(raw, connection.msgtype), ()))
            clock = stamp = f"{topic}/header/stamp"
            if not fields.get(stamp, ((), 0))[1]:
                clock = f"{topic}/log_time"
            times |= {name for name, (_, value) in fields.items() if isinstance(value, Stamp)}
            times.add(f"{topic}/log_time")
            home |= {name: (topic, steps) for name, (steps, _) in fields.items()}
            home[f"{topic}/log_time"] = topic, None
            clocks |= dict.fromkeys([*fields, f"{topic}/log_time"], clock)

        def load(names: list[str]) -> dict[str, np.ndarray]:
            wanted: dict[str, list[str]] = {}
            for name in names:
                wanted.setdefault(home[name][0], []).append(name)
            values: dict[str, list[Any]] = {name: [] for name in names}
            for connection, time, raw in reader.messages(
                [c for c in reader.connections if c.topic in wanted]
            ):
                message = None
                for name in wanted[connection.topic]:
                    steps = home[name][1]
                    if steps is None:
                        values[name].append(time)
                        continue
                    if message is None:
                        message = reader.deserialize(raw, connection.msgtype)
                    values[name].append(_value(message, steps))
            return {
                name: stamps(column) if name in times else np.array(column)
                for name, column in values.items()
            }

        yield Recording(clocks, load)


def _fields(name: str, value: Any, steps: Steps) -> Iterator[tuple[str, tuple[Steps, Any]]]:
    """Every number of a message: its column, and the way to it, and the number."""
    kind = getattr(value, "__msgtype__", None)
    if isinstance(value, bool | int | float | np.number | np.bool_):
        yield name, (steps, value)
    elif kind in ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"):
        yield name, (steps, _stamp(value))
    elif kind is not None:
        for field in value.__dataclass_fields__:
            if not field.startswith("__"):
                yield from _fields(f"{name}/{field}", getattr(value, field), (*steps, field))
    elif isinstance(value, list | np.ndarray):
        for i, place in enumerate(elements(name, len(value))):
            yield from _fields(place, value[i], (*steps, i))


def _value(message: Any, steps: Steps) -> Any:
    """The number there; NaN where a list is too short."""
    for step in steps:
        if isinstance(step, str):
            message = getattr(message, step)
        elif step < len(message):
            message = message[step]
        else:
            return np.nan
    return _stamp(message) if hasattr(message, "__msgtype__") else message


def _stamp(time: Any) -> Stamp:
    return Stamp(int(time.sec) * 10**9 + int(time.nanosec))
