"""`hgo simulate`: the observer of a file on the system that its model describes."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from hgo_rs import plots
from hgo_rs.cli.complete import of
from hgo_rs.cli.options import Numbers
from hgo_rs.cli.places import can_draw, check_places, tell_written, written
from hgo_rs.cli.terminal import say
from hgo_rs.config import load
from hgo_rs.errors import HgoError
from hgo_rs.logs import TableWriter
from hgo_rs.logs.write import check_writable_format
from hgo_rs.models import InputGain, Model, System, Unknown
from hgo_rs.observers.told import in_words
from hgo_rs.simulation import NormalNoise, SimulationResult, simulate
from hgo_rs.simulation.experiment import PLANT_METHODS


@click.command("simulate", short_help="Simulate an observer and the system of its model.")
@click.argument("config", type=click.Path(path_type=Path))
@click.option("--x0", type=Numbers(), required=True, help="Initial state of the system: 0.5,0.")
@click.option("--dt", type=float, help="Sampling period, s; by default that of [log].")
@click.option("--t-end", type=float, required=True, help="Duration, s.")
@click.option(
    "--input",
    "inputs",
    multiple=True,
    metavar="NAME=EXPR",
    help='Input as a function of time, "u=sin(3*t)", or of estimates, "u=-2*q_hat"; again for '
    "several.",
)
@click.option("--noise", type=float, help="Standard deviation of the measurement noise.")
@click.option("--seed", type=int, default=0, show_default=True, help="Seed of the noise.")
@click.option(
    "--substeps", type=int, default=4, show_default=True, help="Steps of the system per period."
)
@click.option(
    "--plant-method",
    shell_complete=of(PLANT_METHODS),
    help="Integration method of the system; default rk4.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Samples, states and estimates, .csv or .parquet; by default CONFIG.simulated.csv.",
)
@click.option(
    "--figure",
    type=click.Path(path_type=Path),
    help="Figure, .png, .svg or .pdf; by default beside it, as PNG.",
)
def simulate_command(
    config: Path,
    x0: list[float],
    dt: float | None,
    t_end: float,
    inputs: tuple[str, ...],
    noise: float | None,
    seed: int,
    substeps: int,
    plant_method: str | None,
    out: Path | None,
    figure: Path | None,
) -> int:
    """Simulate the system of [model] in CONFIG, an observer.toml, and its observer on samples of
    the output.

    The observer begins at the [start] of the file, or at 0. Its errors are printed. Samples, true
    states and estimates are written to one file, which `hgo estimate` reads too.

    \b
    Example: a driven pendulum with a noisy encoder
      hgo simulate axis.toml --x0 0.5,0 --dt 0.01 --t-end 10 --input "u=sin(3*t)" --noise 1e-3
    """
    out = out if out is not None else Path(f"{config.stem}.simulated.csv")
    check_writable_format(out)
    draw = can_draw(figure)
    figure = figure if figure is not None else out.with_suffix(".png")
    results = {"--out": out} | ({"--figure": figure} if draw else {})
    check_places(results, {"the file of the observer": config})
    told = load(config)
    observer = told.observer()
    dt = dt if dt is not None else told.log.get("dt")
    if dt is None:
        raise HgoError(f"--dt is needed: the sampling period [s]; or dt = ... in [log] of {config}")
    given = dict(map(_input, inputs))
    system = _plant(observer.model, config)
    lacking = [name for name in getattr(system, "inputs", ()) if name not in given]
    if lacking:
        remedy = " ".join(f'--input "{name}=0"' for name in lacking)
        raise HgoError(f"--input is needed for {', '.join(lacking)}; write for example {remedy}")
    found = simulate(
        system,
        observer,
        x0=x0,
        dt=dt,
        t_end=t_end,
        memory0=observer.memory,
        noise=None if noise is None else NormalNoise(std=noise),
        rng=seed,
        substeps=substeps,
        plant_method=plant_method,
        feedback=given or None,
        windows=[(0.5 * t_end, t_end)],
        every=1,
    )
    with written(results) as files:
        with TableWriter(out, files["--out"]) as writer:
            writer.write(_columns(found))
        if draw:
            plots.save(found.plot(), figure, files["--figure"])
    assert found.time is not None
    say(f"{len(found.time)} samples, a period of {dt:g} s, seed {seed}")
    say(f"run by {in_words(observer)}")
    _tell(found)
    tell_written(results, draw)
    return 0


def _plant(model: System | None, config: Path) -> System:
    """The system itself."""
    if model is None or isinstance(model, (Unknown, InputGain)):
        remedy = 'states = ["q", "v"] and phi = "..." in [model]'
        raise HgoError(f"{config}: there is nothing to simulate without equations; write {remedy}")
    return model.plant() if isinstance(model, Model) else model


def _input(text: str) -> tuple[str, str]:
    """Name and expression."""
    name, equals, expression = text.partition("=")
    if not equals or not name.strip():
        raise HgoError(f'--input {text}: must be NAME=EXPR; write for example "u=sin(3*t)"')
    return name.strip(), expression


def _columns(found: SimulationResult) -> dict[str, np.ndarray]:
    """Times and samples, inputs, states, estimates."""
    assert found.time is not None and found.x is not None and found.y is not None
    assert found.x_hat is not None
    columns = {"t": found.time}
    y = found.y[0].reshape(len(found.time), -1)
    columns |= {"y" if y.shape[1] == 1 else f"y{i + 1}": v for i, v in enumerate(y.T)}
    states = [f"x{i + 1}" for i in range(found.x.shape[2])]
    if found.loop is not None:
        states = list(found.loop.states) or states
        columns |= {name: found.of(name)["frames"][0] for name in found.loop.inputs}
    columns |= dict(zip(states, found.x[0].T, strict=False))
    names = zip(found._names, found.x_hat[0].T, strict=True)
    return columns | {f"{name}_hat": values for name, values in names}


def _tell(found: SimulationResult) -> None:
    """The error of each estimate."""
    for i, name in enumerate(found._names):
        rms, largest = found.rms[0, 0, i], found.peak[0, i]
        say(f"{name:12s} RMS error of the second half {rms:.4g}; largest estimate {largest:.4g}")
    if found.diverged_at[0] >= 0:
        say(f"the run diverged at step {found.diverged_at[0]}")
