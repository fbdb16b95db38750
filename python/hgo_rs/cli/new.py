"""`hgo new`: a commented observer.toml from a recorded log."""

from __future__ import annotations

import re
import shlex
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np

from hgo_rs.cli.complete import any_column
from hgo_rs.cli.names import chain, free, symbol
from hgo_rs.cli.places import check_places, tell_written, written
from hgo_rs.cli.recorded import one_or_all
from hgo_rs.cli.terminal import say
from hgo_rs.config import FORMAT, Config
from hgo_rs.config.text import toml
from hgo_rs.design.discrete import DEFAULT_METHOD, DEFAULT_TIMING
from hgo_rs.errors import HgoError, printable
from hgo_rs.logs import Log, Look, look, read_log
from hgo_rs.logs.estimation import check_fit
from hgo_rs.logs.streams import stem_of
from hgo_rs.logs.table import names_of
from hgo_rs.observers import StandardObserver
from hgo_rs.observers.turns import Jumps, told_turn, unwrapped
from hgo_rs.times import UNITS
from hgo_rs.tuning import tune

_ORDER, _DRIVEN = 3, 2
"""States of a chain without and with a known input."""
_SLOW = 0.2
"""Gain times step where no gain can be found in the log."""
_LISTED = 8
"""Columns that are told beside those that are read."""


@click.command("new", short_help="Write a commented observer.toml from a log.")
@click.argument("log", type=click.Path(path_type=Path))
@click.option("--time", **any_column, help="Time column; default: as `hgo look` finds it.")
@click.option(
    "--unit", type=click.Choice(list(UNITS)), multiple=True, help="Unit of the time column."
)
@click.option(
    "--output", **any_column, help="Measured output; default: the first column that moves."
)
@click.option("--input", **any_column, help="Known input; repeat the option for several.")
@click.option("--dt", type=float, help="Sampling period, s: for a log without a time column.")
@click.option(
    "--order",
    type=click.IntRange(1, 12),
    help=f"States of each output; default {_ORDER}, with an input {_DRIVEN}.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="The file; by default LOG.toml in this folder. An existing file is not overwritten.",
)
def new_command(
    log: Path,
    dt: float | None,
    order: int | None,
    out: Path | None,
    **columns: tuple[str, ...],
) -> int:
    """Write an observer.toml for the recorded LOG: its columns and a gain tuned on it. Further
    choices are comments to edit.

    \b
    Example: a file for an unknown log, then its states
      hgo new axis.csv
      hgo estimate axis.csv --config axis.toml
    """
    out = out if out is not None else Path(f"{stem_of(log)}.toml")
    check_places({"--out": out}, {"the log itself": log})
    if out.exists():
        raise HgoError(f"{out} exists already; name another file with --out, or remove it")
    found = look(log)
    arguments = {key: one_or_all(given) for key, given in columns.items() if given}
    arguments |= {} if dt is None else {"dt": dt}
    if "output" not in arguments:
        if found.output is None:
            raise HgoError(f"{log}: no column of numbers changes, so there is nothing to estimate")
        arguments["output"] = found.output
    if "time" not in arguments and dt is None:
        arguments |= {} if found.time is None else {"time": found.time}
        if found.time is None and "PERIOD" in shlex.split(found.command):
            told = "no time column was found; name it with --time, or give --dt PERIOD"
            raise HgoError(f"{log}: {told}")
    recorded = read_log(log, **{"time": None, **arguments})
    n = order if order is not None else (_DRIVEN if "input" in arguments else _ORDER)
    text = _Draft(log, out, found, arguments, n, _gains(recorded, n), recorded.assumed).text()
    config = Config.from_toml(text, str(out))
    check_fit(config.observer(), config.log)  # what is written is read
    with written({"--out": out}) as files:
        files["--out"].write(text.encode())
    say(f"{printable(str(log))}: {recorded.describe()}")
    tell_written({"--out": out})
    given = shlex.quote(str(log)), shlex.quote(str(out))
    say("next: hgo estimate {} --config {}".format(*given))
    return 0


@dataclass(frozen=True)
class _Gain:
    """Gain of an output [1/s], where it comes from, and the output's turn if it wraps."""

    ell: float
    told: str
    turn: float | None


def _gains(log: Log, n: int) -> list[_Gain]:
    """A gain for each output, found in the log by itself."""
    found = []
    for y in log.y.reshape(len(log.t), -1).T:
        turn = Jumps().add(y)
        signal = y if turn is None else unwrapped(y, turn)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                tuned = tune(lambda ell: StandardObserver(n, ell), (log.t, signal))
            told = "found in the log: the least error of the last state"
            found.append(_Gain(float(f"{tuned.ell:.4g}"), told, turn))
        except HgoError as error:
            step = float(np.median(np.diff(log.t)))
            told = f"{_SLOW} over the median step, since tuning found none: {error}"
            found.append(_Gain(float(f"{_SLOW / step:.4g}"), told, turn))
    return found


@dataclass(frozen=True)
class _Draft:
    """The text of the file, part by part."""

    log: Path
    out: Path
    found: Look
    arguments: dict[str, Any]
    order: int
    gains: list[_Gain]
    assumed: bool

    def text(self) -> str:
        parts = [self._head(), self._observer(), self._model(), self._start(), self._log()]
        return "\n\n".join(filter(None, parts)) + "\n"

    @property
    def _outputs(self) -> list[str]:
        return names_of(self.arguments["output"], "output")

    @property
    def _inputs(self) -> list[str]:
        given = self.arguments.get("input")
        return [] if given is None else names_of(given, "input")

    def _head(self) -> str:
        command = shlex.join(["hgo", "estimate", str(self.log), "--config", str(self.out)])
        return "\n".join(
            [
                f"# An observer for {_comment(self.log)}, and how the log is read. To run it:",
                f"#   {_comment(command)}",
                "# A line that begins with # is an open choice, with its default or an example.",
                "# `hgo list keys` lists all keys.",
                f"format = {FORMAT}",
            ]
        )

    def _observer(self) -> str:
        if len(self.gains) > 1:
            tables = ["\n".join(["[[observers]]", *self._law(i)]) for i in range(len(self.gains))]
            return "\n\n".join(['observer = "chains"  # one for each output', *tables])
        return "\n".join(self._law(0))

    def _law(self, i: int) -> list[str]:
        gain = self.gains[i]
        model = bool(self._inputs) and len(self.gains) == 1
        order = (
            f"order = {self.order}  # estimated states: {_states_of(self._outputs[i], self.order)}"
        )
        poles = ", ".join(["-1.0"] * self.order)
        return [
            'observer = "standard"  # the law; `hgo list observers` lists all',
            *([] if model else [order]),
            f"gain = {toml(gain.ell)}  # 1/s: a larger one is faster and passes more noise;",
            f"#   {_comment(gain.told)}",
            f"# poles = [{poles}]  # of the error at gain 1; they grow with the gain",
            f'# method = "{DEFAULT_METHOD}"  # `hgo list methods` lists all',
            f'# timing = "{DEFAULT_TIMING}"  # "predictor": an estimate uses earlier samples only',
            self._wrap(gain.turn, self._outputs[i]),
        ]

    def _wrap(self, turn: float | None, output: str) -> str:
        if turn is None:
            return "# wrap = 6.283185307179586  # an output that begins again after a turn"
        length = toml(float(turn))
        return f"wrap = {length}  # {_comment(told_turn(output, turn))}"

    def _model(self) -> str:
        several, inputs = len(self.gains) > 1, self._inputs
        taken: list[str] = []
        states = [chain(name, self.order, taken) for name in self._outputs]
        known = [symbol(name, taken) for name in inputs]
        factors, sides = _sides(len(states), known, taken)
        rows = [f"states = {toml([name for chain in states for name in chain])}"]
        if inputs:
            rows.append(f"inputs = {toml(known)}")
            rows.append(f"parameters = {toml(factors)}  # `hgo fit` finds them in a log")
        if several:
            rows.append(f"orders = {toml([self.order] * len(states))}")
            rows.append(f"phi = {toml(sides)}  # the last derivative of each output")
        elif inputs:
            rows.append(f"phi = {toml(sides[0])}  # {_last(self._outputs[0], self.order)}")
        else:
            damped = toml({free("d", taken): 0.1})
            rows.append(f"parameters = {damped}")
            side = toml(f"-{free('d', taken)}*{states[0][-1]}")
            rows.append(f"phi = {side}  # {_last(self._outputs[0], self.order)}")
        told = "# The model: equations in the names below."
        if several or inputs:
            return "\n".join([told, "[model]", *rows])
        told = "# No model as it stands. With equations, for example:"
        return "\n".join([told, "# [model]", *(f"# {row}" for row in rows)])

    def _start(self) -> str:
        return "\n".join(
            [
                "# A run begins at the first sample. To begin at 0:",
                "# [start]",
                '# from = "zero"',
            ]
        )

    def _log(self) -> str:
        rows = ["[log]"]
        known = {column.name: column for column in self.found.columns}
        for key in ("time", "dt", "unit", "output", "input"):
            if key not in self.arguments:
                continue
            value = self.arguments[key]
            told = "s" if key == "dt" else ""
            if key in ("time", "output", "input") and isinstance(value, str) and value in known:
                _, _, unit, missing, spread, *_ = known[value].row()
                missing = f"{missing} missing" if missing else ""
                told = ", ".join(filter(None, (spread, unit, missing)))
            rows.append(f"{key} = {toml(value)}" + (f"  # {_comment(told)}" if told else ""))
        if self.assumed and "unit" not in self.arguments:
            rows.append('# unit = "s"  # of the time column, whose name does not contain it')
        if "input" not in self.arguments:
            rows.append('# input = "..."  # a known input, which [model] then needs')
        output = self._outputs[0]
        if re.fullmatch(r"[\w-]+", output, re.ASCII):
            rows.append(
                f"# scale = {{ {output} = 0.001 }}  # another unit; also `unwrap`, `offset`"
            )
        used = {*self._outputs, *self._inputs, *str(self.arguments.get("time", "")).split("+")}
        used.add(str(self.arguments.get("time")))
        others = [column.name for column in self.found.columns if column.name not in used]
        if others:
            more = f" and {len(others) - _LISTED} more" if len(others) > _LISTED else ""
            rows.append(f"# other columns: {_comment(', '.join(others[:_LISTED]))}{more}")
        return "\n".join(rows)


def _comment(text: object) -> str:
    """Text that stays on the line of a comment."""
    return printable(str(text))


def _states_of(output: str, n: int) -> str:
    """An output and its derivatives, in words."""
    shown_as = _comment(output)
    if n == 1:
        return shown_as
    return f"{shown_as} and its derivative" + (f"s up to {n - 1}" if n > 2 else "")


def _last(output: str, n: int) -> str:
    """What phi is, in words."""
    return f"derivative {n} of {_comment(output)}" if n > 1 else f"derivative of {_comment(output)}"


def _sides(
    count: int, inputs: Sequence[str], taken: list[str]
) -> tuple[dict[str, float], list[str]]:
    """Factors of inputs, and the right-hand side of each of `count` outputs."""
    factors: dict[str, float] = {}
    sides = []
    for i in range(count):
        own = inputs[i : i + 1] if count == len(inputs) else inputs
        terms = []
        for name in own:
            factor = symbol(f"b_{name}" if count == 1 else f"b{i + 1}_{name}", taken)
            factors[factor] = 1.0
            terms.append(f"{factor}*{name}")
        sides.append(" + ".join(terms) or "0")
    return factors, sides
