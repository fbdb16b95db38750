"""What commands that look at a whole log share: its columns, its model, and what they write."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import click

from hgo_rs.cli.complete import any_column
from hgo_rs.cli.places import check_places
from hgo_rs.cli.terminal import say
from hgo_rs.config import Config, load
from hgo_rs.errors import HgoError, printable
from hgo_rs.logs import Log, look, read_log
from hgo_rs.logs.streams import STDIN
from hgo_rs.logs.table import names_of
from hgo_rs.models import System
from hgo_rs.observers import Observer
from hgo_rs.observers.records import Array
from hgo_rs.times import UNITS

_COLUMNS = ("time", "unit", "output", "input")
_OPTIONS = (
    click.argument("log", type=click.Path(path_type=Path)),
    click.option(
        "--config",
        type=click.Path(path_type=Path),
        help="observer.toml whose [model] and [log] are taken; its observer and gain are not "
        "needed.",
    ),
    click.option("--time", **any_column, help="Time column."),
    click.option(
        "--unit", type=click.Choice(list(UNITS)), multiple=True, help="Unit of the time column."
    ),
    click.option("--output", **any_column, help="Measured output; repeat the option for several."),
    click.option("--input", **any_column, help="Known input; repeat the option for several."),
    click.option("--dt", type=float, help="Sampling period, s: for a log without a time column."),
)

_Command = TypeVar("_Command", bound=Callable[..., Any])


def of_log(command: _Command) -> _Command:
    """The argument LOG and the options that say how it is read."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


@dataclass(frozen=True)
class Asked:
    """A log that is still to be read: how, and what is known of the system."""

    path: Path
    config: Path | None
    told: Config | None
    arguments: dict[str, Any]

    @classmethod
    def of(
        cls, log: Path, config: Path | None, dt: float | None, columns: Mapping[str, Any]
    ) -> Asked:
        """From a command's options.

        Raises
        ------
        HgoError
            No output, neither by an option nor by a file.
        """
        told = None if config is None else load(config)
        arguments = dict(told.data.get("log", {})) if told is not None else {}
        arguments |= {key: one_or_all(columns[key]) for key in _COLUMNS if columns[key]}
        arguments |= {} if dt is None else {"dt": dt}
        if "output" not in arguments:
            raise HgoError(forgotten_output(log, config))
        return cls(log, config, told, arguments)

    @cached_property
    def _observer(self) -> Observer | None:
        """That of the file, whose gain may be left out: it is not what is taken."""
        if self.told is None:
            return None
        gained = any(key in self.told.data for key in ("gain", "epsilon", "observers"))
        return (self.told if gained else self.told.replace(gain=1.0)).observer()

    @property
    def model(self) -> System | None:
        """The model of the file."""
        return None if self._observer is None else self._observer.model

    @property
    def turns(self) -> dict[str, float]:
        """The turns of outputs that wrap for the observer of the file."""
        lengths = () if self._observer is None else self._observer.wrap
        names = names_of(self.arguments["output"], "output")
        return {name: turn for name, turn in zip(names, lengths, strict=False) if turn is not None}

    def read(self, results: Mapping[str, Path]) -> Log:
        """The log, told of, once it is sure that results can be written.

        Outputs that wrap are unwrapped.
        """
        check_places(results, {"the log itself": self.path, "the file of --config": self.config})
        scale = self.arguments.get("scale", {})
        own = {name: turn / abs(scale.get(name, 1.0)) for name, turn in self.turns.items()}
        arguments = {"time": None, **self.arguments}
        if own:
            arguments["unwrap"] = own | arguments.get("unwrap", {})
        recorded = read_log(self.path, **arguments)
        say(f"{printable(str(self.path))}: {recorded.describe()}")
        for name, turn in self.turns.items():
            say(f"{name!r} is unwrapped, with the turn of {turn:g} of {self.config}")
        return recorded

    def column(self, name: str) -> Array:
        """Another column of the log, a value a sample."""
        arguments = {"time": None, **self.arguments, "output": name}
        arguments.pop("input", None)
        for key in ("unwrap", "scale", "offset"):  # of this column alone
            told = arguments.pop(key, {})
            arguments |= {key: {name: told[name]}} if name in told else {}
        return read_log(self.path, **arguments).y

    def saved(self, observer: Observer) -> Config:
        """The file of an observer for this log, whose outputs wrap as those of --config do."""
        config = Config.of(observer, **self.arguments)
        for i, name in enumerate(names_of(self.arguments["output"], "output")):
            if name in self.turns:
                config = config.wrapping(i, self.turns[name])
        return config


def forgotten_output(log: Path, config: Path | None) -> str:
    """What is said where nothing tells the measured column: the columns, and which it may be.

    Raises
    ------
    DataError
        A log that cannot be read: that is told first.
    """
    if log == STDIN:  # it can be read once
        return "--output is needed: the column that was measured"
    found = look(log)
    names = ", ".join(column.name for column in found.columns)
    where = f"; or a table [log] in {config}" if config is not None else ""
    told = f"--output is needed: the column that was measured{where}. {log} has {names}"
    if found.output is None:
        return f"{told}; none of them moves"
    words = [] if found.time is None else ["--time", found.time]
    return f"{told}; for example {shlex.join([*words, '--output', found.output])}"


def one_or_all(given: tuple[str, ...]) -> Any:
    """What an option was given: a text, or several."""
    return given[0] if len(given) == 1 else list(given)


@contextmanager
def counted(label: str) -> Iterator[Callable[[int], None] | None]:
    """A count of filters on a terminal; nothing elsewhere."""
    if not sys.stderr.isatty():
        yield None
        return

    def count(done: int) -> None:
        click.echo(f"\r{label}: {done} filters", nl=False, err=True)

    yield count
    click.echo("\r" + " " * (len(label) + 24) + "\r", nl=False, err=True)
