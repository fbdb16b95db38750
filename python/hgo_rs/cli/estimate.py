"""`hgo estimate`: an observer over a recorded log."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np

from hgo_rs import observers, plots
from hgo_rs.cli import complete
from hgo_rs.cli.complete import any_column
from hgo_rs.cli.names import chain, symbol
from hgo_rs.cli.options import Named, Numbers
from hgo_rs.cli.places import can_draw, check_places, tell_written, written
from hgo_rs.cli.recorded import forgotten_output
from hgo_rs.cli.terminal import say, unknown
from hgo_rs.config import FORMAT, OBSERVERS, Config, load
from hgo_rs.design.discrete import DEFAULT_METHOD, DEFAULT_TIMING
from hgo_rs.errors import HgoError, printable
from hgo_rs.logs import Log, LogSummary, TableWriter, read_chunks, run_chunks
from hgo_rs.logs.estimation import check_fit, column_of
from hgo_rs.logs.streams import stem_of
from hgo_rs.logs.table import names_of
from hgo_rs.logs.write import check_writable_format
from hgo_rs.observers import Gap, HighGainEKF, HighGainObserver, Observer, RunResult
from hgo_rs.observers.labels import Labels
from hgo_rs.observers.records import STARTS
from hgo_rs.observers.told import in_words
from hgo_rs.observers.turns import Jumps, nearest, told_turn
from hgo_rs.times import RESETS, UNITS


@click.command("estimate", short_help="Run an observer over a recorded log.")
@click.argument("log", type=click.Path(path_type=Path))
@click.option(
    "--config", type=click.Path(path_type=Path), help="observer.toml; options override it."
)
@click.option("--time", "time", **any_column, help="Time column.")
@click.option(
    "--unit",
    type=click.Choice(list(UNITS)),
    multiple=True,
    help="Unit of the time column; repeat the option for several.",
)
@click.option("--output", **any_column, help="Measured output.")
@click.option("--input", "input", **any_column, help="Known input.")
@click.option(
    "--input-gain",
    type=float,
    metavar="B0",
    help="n-th derivative of the output for one unit of input (with --input; default 1).",
)
@click.option(
    "--observer",
    metavar="NAME",
    shell_complete=complete.observers,
    help=f"One of {', '.join(OBSERVERS)}; chains need a --config.",
)
@click.option("--order", type=int, help="Number of states.")
@click.option("--gain", type=float, help="The gain L (ell), 1/s.")
@click.option("--dt", type=float, help="Sampling period, s: for a log without a time column.")
@click.option("--poles", type=Numbers(), help="Poles at gain 1, for example -1,-2,-3.")
@click.option(
    "--method",
    shell_complete=complete.methods,
    help=f"Discretisation; by default the class's own: {DEFAULT_METHOD}, where the law takes it.",
)
@click.option(
    "--motion",
    shell_complete=complete.motions,
    help="Integration of the model over a period under zoh, bilinear, implicit-map, proper and "
    "inter-sample: held, rk4 or implicit; default chosen by the model.",
)
@click.option(
    "--substeps", type=int, help="Substeps of a period, for motion rk4 and implicit; default 2."
)
@click.option(
    "--timing",
    shell_complete=complete.timings,
    help="current (the estimate at a sample uses it) or predictor; by default "
    f"{DEFAULT_TIMING}, where the law takes it.",
)
@click.option(
    "--wrap",
    metavar="TURN",
    help="Period of an output that wraps, in its unit: 6.283185307179586, 65536, ...; none: it "
    "does not wrap. Default: found from jumps by a turn or a counter's range, with a message.",
)
@click.option(
    "--start",
    type=click.Choice(STARTS),
    help="Where the estimate begins: at the first sample (default), or at 0.",
)
@click.option(
    "--unwrap",
    type=Named(),
    multiple=True,
    help="COL=TURN: undo the turns of a column as it is read.",
)
@click.option("--scale", type=Named(), multiple=True, help="COL=FACTOR: multiply a column.")
@click.option("--offset", type=Named(), multiple=True, help="COL=NUMBER: add it after --scale.")
@click.option("--saturation", type=Numbers(), help="Bounds on the states 2 to n (peaking-free).")
@click.option("--allow-unstable", is_flag=True, help="Go beyond the step limit of the method.")
@click.option(
    "--resets",
    type=click.Choice(RESETS),
    help="A clock that starts again: an error (default), or a new start of the observer.",
)
@click.option(
    "--save-config",
    type=click.Path(path_type=Path),
    help="Write what --config and the options say as an observer.toml.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Estimates, .csv or .parquet; by default LOG.estimates.csv in this folder.",
)
@click.option(
    "--figure",
    type=click.Path(path_type=Path),
    help="Figure, .png, .svg or .pdf; by default beside the estimates, as PNG.",
)
def estimate_command(
    log: Path,
    config: Path | None,
    save_config: Path | None,
    out: Path | None,
    figure: Path | None,
    **options: Any,
) -> int:
    """Run an observer over the recorded LOG (CSV, Parquet, .mat, .npz, ROS bags and more).

    Empty cells and NaN are missing samples: the observer predicts over them. Uneven steps are
    used as recorded. Options may be repeated for several columns.

    \b
    Example: velocity and acceleration from a measured position
      hgo estimate axis.csv --time t --output q --observer low-power --order 3 --gain 60
    """
    out = out if out is not None else Path(f"{stem_of(log)}.estimates.csv")
    check_writable_format(out)
    draw = can_draw(figure)
    figure = figure if figure is not None else out.with_suffix(".png")
    told = _configuration(config, options)
    looks = options["wrap"] is None
    while True:
        try:
            _estimate(log, config, save_config, out, figure, draw, told, looks)
            return 0
        except _TurnFound as found:
            say(str(found))
            told = told.wrapping(found.output, found.turn)


class _TurnFound(Exception):
    """An output shows a turn of which the observer does not know: to run again, knowing it."""

    def __init__(self, source: str, name: str, turn: float, output: int) -> None:
        told = told_turn(column_of(source, name), turn)
        super().__init__(f"{told}: it is taken to wrap there; --wrap none if it does not")
        self.turn, self.output = turn, output


def _estimate(
    log: Path,
    config: Path | None,
    save_config: Path | None,
    out: Path,
    figure: Path,
    draw: bool,
    told: Config,
    looks: bool,
) -> None:
    """The command, as a configuration says it; with `looks` for turns that it does not say."""
    law = told.observer()
    arguments = told.log
    if "output" not in arguments:
        raise HgoError(forgotten_output(log, config))
    check_fit(law, arguments, f"{told.place(('log',))}: " if config else "")
    results = {"--out": out}
    if draw:
        results["--figure"] = figure
    if save_config is not None:
        results["--save-config"] = save_config
    check_places(results, {"the log itself": log, "the file of --config": config})
    summary, gaps, trace = LogSummary(), _LongestGaps(), _Trace(law.wrap[0])

    looks = looks and (law.n_y == 1 or "observers" in told.data)
    jumps = {i: Jumps() for i, turn in enumerate(law.wrap) if looks and turn is None}

    def seen(chunks: Iterable[Log]) -> Iterator[Log]:
        for chunk in chunks:
            summary.add(chunk)
            y = chunk.y.reshape(len(chunk.t), -1)
            for i, seen_so_far in jumps.items():
                turn = seen_so_far.add(y[:, i])
                if turn:
                    name = names_of(chunk.names["output"], "output")[i]
                    raise _TurnFound(str(log), name, turn, i)
            yield chunk

    piece = -1
    with written(results) as files:
        with TableWriter(out, files["--out"]) as writer:
            for chunk, result in run_chunks(
                law, seen(read_chunks(log, **arguments)), start=told.start
            ):
                piece += len(chunk.starts)
                split = arguments.get("resets") == "split"
                writer.write(_columns(chunk, result, piece if split else None))
                gaps.add(result)
                if draw:
                    trace.add(chunk, result)
        if draw:
            drawn = trace.draw(law, arguments["output"], told.data["observer"])
            plots.save(drawn, figure, files["--figure"])
        if save_config is not None:
            files["--save-config"].write(told.to_toml().encode())
    say(f"{printable(str(log))}: {summary.describe()}")
    say(f"run by {in_words(law)}; begun {_begun(law, told)}")
    gaps.tell()
    tell_written(results, draw)


def _begun(law: Observer, told: Config) -> str:
    """Where the estimate begins, in words."""
    if told.start is None:
        return "at the first sample" if law._begins else "at 0"
    if told.start == "zero" and np.any(law.memory[: law.n]):
        return "as [start] says"
    return {"zero": "at 0", "first-sample": "at the first sample"}[told.start]


def _configuration(path: Path | None, options: dict[str, Any]) -> Config:
    """What the file says, and over it the options that were given."""
    given = {k: v for k, v in options.items() if v is not None and v is not False and v != ()}
    columns: dict[str, Any] = {
        key: given.pop(key)[0] if len(given[key]) == 1 else list(given.pop(key))
        for key in ("time", "unit", "output", "input")
        if key in given
    }
    columns |= {key: given.pop(key) for key in ("dt", "resets") if key in given}
    columns |= {key: dict(given.pop(key)) for key in ("unwrap", "scale", "offset") if key in given}
    base = None if path is None else load(path)
    if "start" in given:
        given["start"] = {**(base.data.get("start", {}) if base else {}), "from": given["start"]}
    if given.get("wrap") == "none":
        given.pop("wrap")
        base = base and base.without("wrap")
    elif "wrap" in given:
        try:
            given["wrap"] = float(given["wrap"])
        except ValueError:
            shown = given["wrap"]
            raise HgoError(f"--wrap {shown}: must be a number > 0, or none") from None
    b0 = given.pop("input_gain", None)
    if b0 is not None and "input" not in {**(base.log if base else {}), **columns}:
        raise HgoError("--input-gain has no meaning without --input: name the input's column")
    if b0 is not None or (base is None and "input" in columns):
        given["model"] = {"kind": "input", "b0": 1.0 if b0 is None else b0}
    _check_options(given, base)
    if base is not None:
        return base.replace(columns, **given)
    outputs = names_of(columns.get("output", "y"), "output")
    if len(outputs) > 1 and issubclass(
        getattr(observers, OBSERVERS[given["observer"]]), (HighGainObserver, HighGainEKF)
    ):
        given = _chains(given, outputs, columns.get("input", []))
    return Config({"format": FORMAT, "observer": given.pop("observer")}).replace(columns, **given)


def _chains(given: dict[str, Any], outputs: list[str], inputs: str | list[str]) -> dict[str, Any]:
    """The same observer for each of several outputs; what one input drives they do not share."""
    count = len(outputs)
    start = {key: given.pop(key) for key in ("start",) if key in given}
    b0 = given.pop("model", {}).get("b0")
    inputs = [] if b0 is None else names_of(inputs, "input")
    if len(inputs) not in (0, count):
        raise HgoError(
            f"--input: {len(inputs)} for {count} outputs; name one for each, in their order, or "
            "write the equations into an observer.toml for --config"
        )
    n = given["order"]
    taken = ["b0"]
    states = [state for output in outputs for state in chain(output, n, taken)]
    driven = [symbol(name, taken) for name in inputs]
    model = {
        "states": states,
        "inputs": driven,
        "orders": [n] * count,
        "phi": [f"b0 * {name}" for name in driven] or ["0"] * count,
        "parameters": {"b0": b0} if inputs else {},
    }
    unstable = {k: given.pop(k) for k in ("allow_unstable",) if k in given}
    model = {key: value for key, value in model.items() if value}
    return {
        "observer": "chains",
        "observers": [dict(given) for _ in range(count)],
        "model": model,
        **unstable,
        **start,
    }


def _check_options(given: dict[str, Any], base: Config | None) -> None:
    """Refuse options that the observer has no use for, and without a file, missing ones."""
    name = given.get("observer", base.data["observer"] if base else None)
    if name is None:
        remedy = "hgo new LOG writes one, hgo tune LOG chooses one"
        raise HgoError(f"--observer is needed, or a --config that names one; {remedy}")
    if name not in OBSERVERS:
        raise HgoError(unknown("observer", name, list(OBSERVERS)))
    accepted = inspect.signature(getattr(observers, OBSERVERS[name])).parameters
    for key in given:
        if key in ("observer", "start"):
            continue
        if {"order": "n"}.get(key, key) not in accepted:
            option = "--" + {"model": "input"}.get(key, key).replace("_", "-")
            raise HgoError(f"{option} has no meaning for --observer {name}")
    if base is not None:
        return
    needed = [key for key, p in accepted.items() if p.default is inspect.Parameter.empty]
    for key in (*needed, *(["gain"] if "epsilon" in accepted else [])):
        key = {"n": "order"}.get(key, key)
        if key not in given:
            option = "--" + key.replace("_", "-")
            if key.isupper():  # matrices: a file alone holds them
                raise HgoError(
                    f"{name} needs {key}, which has no option: write it into an observer.toml, and "
                    "give that with --config"
                )
            raise HgoError(f"{option} is needed for --observer {name}, or a --config that says it")


def _columns(log: Log, result: RunResult, piece: int | None) -> dict[str, np.ndarray]:
    """t, y, u, estimates, innovation, missing (0 or 1), and the piece where asked for.

    Estimates are called as the model's states, else x_hat1 ... x_hatN; units stand behind the
    names. Several outputs and
    inputs are numbered: y1, y2, ...
    """
    columns: dict[str, np.ndarray] = {"t": log.t}

    def add(name: str, values: np.ndarray) -> None:
        if values.ndim == 1:
            columns[name] = values
        else:
            columns.update({f"{name}{i + 1}": column for i, column in enumerate(values.T)})

    add("y", log.y)
    if log.u is not None:
        add("u", log.u)
    columns |= {result.labels.heading(i): values for i, values in enumerate(result.x_hat.T)}
    add("innovation", result.innovation.reshape(log.y.shape))
    add("missing", log.missing.astype(np.int64))
    if piece is not None:
        columns["piece"] = np.full(len(log.t), piece)
    return columns


class _LongestGaps:
    """The longest gaps of a log, and the error to expect at their ends."""

    COUNT = 3

    def __init__(self) -> None:
        self.found: list[tuple[float, float, Gap, np.ndarray]] = []
        self.labels = Labels()

    def add(self, result: RunResult) -> None:
        """Look at a chunk; what a gap costs is computed for those that are among the longest."""
        if not result.missing.any():
            return
        least = self.found[-1][0] if len(self.found) == self.COUNT else 0.0
        gaps = sorted(result.gaps, key=lambda gap: -gap.duration)[: self.COUNT]
        gaps = [gap for gap in gaps if gap.duration > least]
        if not gaps:
            return
        errors, self.labels = result.error_after(gaps), result.labels
        for gap, error in zip(gaps, errors, strict=True):
            self.found.append((gap.duration, float(result.time[gap.start]), gap, error))
        self.found = sorted(self.found, key=lambda f: -f[0])[: self.COUNT]

    def tell(self) -> None:
        for duration, t, gap, error in self.found:
            states = ", ".join(
                f"{self.labels.column(i)} {e:.3g}" for i, e in enumerate(error) if np.isfinite(e)
            )
            told = f"error to expect at its end: {states}" if states else "no error estimate"
            say(f"gap of {duration:.4g} s ({gap.length} samples) at t = {t:.10g} s: {told}")


class _Trace:
    """What a figure shows of a log of any length: every row, or every 2nd, 4th, ..."""

    MOST = 200_000

    def __init__(self, turn: float | None = None) -> None:
        self.turn = turn
        self.parts: dict[str, list[np.ndarray]] = {}
        self.stride, self.count, self.kept = 1, 0, 0
        self.end = self.offset = math.nan

    def shown(self, y: np.ndarray) -> np.ndarray:
        """The samples, in the turn of the estimate."""
        return y if self.turn is None else nearest(y[:, None], [self.turn])[:, 0]

    def add(self, log: Log, result: RunResult) -> None:
        if not log.t[0] > self.end:  # the clock starts again: draw it behind what there is
            self.offset = 0.0 if math.isnan(self.end) else self.end + self.offset - log.t[0]
        self.end = float(log.t[-1])
        rows = slice(-self.count % self.stride, None, self.stride)
        single = log.y.ndim == 1
        signals: dict[str, np.ndarray] = {"time": log.t + self.offset, "x_hat": result.x_hat}
        if single:
            signals |= {"y": self.shown(log.y), "innovation": result.innovation.ravel()}
        signals["missing"] = result.missing
        if result.gain is not None:
            signals["gain"] = result.gain
        for name, values in signals.items():
            self.parts.setdefault(name, []).append(np.array(values[rows]))
        self.count += len(log.t)
        self.kept += len(self.parts["time"][-1])
        while self.kept > self.MOST:
            self.stride *= 2
            self.parts = {n: [np.concatenate(p)[::2]] for n, p in self.parts.items()}
            self.kept = len(self.parts["time"][0])

    def draw(self, law: Observer, output: Any, kind: str) -> Any:
        signals: dict[str, Any] = {n: np.concatenate(p) for n, p in self.parts.items()}
        gain = f", gain {law.gain:g} 1/s" if law.spec.get("gain", {}) and law.gain else ""
        moves = law._gain_index() is not None
        if not moves:
            signals.pop("gain", None)
        title = f"{kind}, order {law.n}" + ("" if moves else gain)
        if self.stride > 1:
            title += f" (every {self.stride}th row)"
        name = f"column {output}" if str(output).isdigit() else printable(str(output))
        return plots.estimate_figure(
            signals.pop("time"),
            signals.pop("x_hat"),
            names=_state_names(law, name),
            output=f"{name}, measured",
            title=title,
            **signals,
        )


def _state_names(law: Observer, output: str) -> list[str] | None:
    """The names of the states: the model's own, or the output and its derivatives."""
    labelled = Labels.of(law.spec, law.n).titles(law.n)
    if labelled or law.n_y > 1:
        return labelled
    ordinals = ("first", "second", "third", "fourth", "fifth")
    names = [output]
    for i in range(1, law.n):
        which = f"{ordinals[i - 1]} derivative" if i <= len(ordinals) else f"derivative {i}"
        names.append(f"{which} of {output}")
    return names
