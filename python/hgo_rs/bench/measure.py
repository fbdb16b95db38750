"""Every entrant on every system: tuned by one rule, then measured.

The rule: the least speed at which a step of y, long after the start, is forgotten in `SETTLING`:
the error of the last state stays below 2 % of its peak from then on.  The noise is such that it
costs the standard law as much as its bias does.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hgo_rs import _core
from hgo_rs.bench.entrants import LEFT_OUT, STANDARD, Asked, Entrant, entrants
from hgo_rs.bench.systems import CONDITIONS, COUNT, DT, Array, System, systems
from hgo_rs.errors import HgoError
from hgo_rs.observers import Observer

SETTLING = 0.5
"""Time to which every entrant is tuned [s]."""
_WITHIN = 0.02
_REST, _LOOKED = 200, 200  # samples before the step, and after it
_STEP = 0.1  # of y
_SPEEDS = 0.5, 400.0  # 1/s
_HALVINGS = 16
_ROOM = 1.5  # of the largest state: what a saturation leaves
_FAR = 1e3  # of the last state's size: an error from here on is a loss of the state

M4F = {
    (STANDARD, 2): 66,
    (STANDARD, 5): 138,
    ("low-power", 5): 107,
    ("peaking-free", 5): 150,
    ("adaptive gain", 2): 165,
    ("dead-zone gain", 2): 164,
    ("prescribed-time gain", 2): 42,
    ("dead zone", 2): 114,
    ("piecewise-linear", 2): 48,
    ("fal", 2): 193,
    ("bi-homogeneous", 2): 356,
    ("extended Kalman filter", 2): 1221,
    ("adaptive high-gain EKF", 2): 3938,
}
"""Instructions of a step on the Cortex-M4F in single precision, as `make firmware` counts them: the
standard law by its method zoh, filters from sample to sample, all others by Euler.
"""


@dataclass(frozen=True)
class Cell:
    """What an entrant does on one system.

    ``speed`` [1/s]; ``settling`` [s]; ``peak``: the largest error of the last state after a step of
    y, over the step [s^-(n-1)]; ``errors``: RMS error of the last state under each condition, over
    its RMS; ``noise``: RMS of what white noise adds to the error, over the same; ``operations`` of
    a step with a fixed period.  ``refused``: why it has no place here.
    """

    system: str
    group: str
    entrant: str
    kind: str
    n: int
    speed: float = math.nan
    settling: float = math.nan
    peak: float = math.nan
    noise: float = math.nan
    operations: int = 0
    errors: tuple[tuple[str, float], ...] = ()
    refused: str = ""

    def error(self, condition: str) -> float:
        """Under a condition; NaN where it was not measured."""
        return dict(self.errors).get(condition, math.nan)


def measured(progress: Callable[[int, int], object] | None = None) -> list[Cell]:
    """All cells, a system after the other."""
    found: list[Cell] = []
    taking, places = entrants(), systems()
    tuned: dict[tuple[str, int, float], tuple[float, float, float]] = {}
    for done, system in enumerate(places):
        if progress is not None:
            progress(done, len(places))
        levels = _ROOM * np.abs(system.fine[:, 1:]).max(axis=0)
        asked = Asked(system.n, 1.0, 1.0, system.model, levels)
        asked = replace(asked, noise=_noise(system, asked))
        for entrant in taking:
            empty = Cell(system.name, system.group, entrant.name, entrant.kind, system.n)
            if system.n not in entrant.orders:
                found.append(replace(empty, refused=f"orders {_among(entrant.orders)}"))
                continue
            asked_of = asked if entrant.models else replace(asked, model=None)
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")
                    found.append(_cell(empty, entrant, asked_of, system, tuned))
            except HgoError as error:
                found.append(replace(empty, refused=str(error)))
    if progress is not None:
        progress(len(places), len(places))
    return found


def _among(orders: tuple[int, ...]) -> str:
    return ", ".join(map(str, orders)) + " only"


def _noise(system: System, asked: Asked) -> float:
    """The RMS of white noise that costs the standard law as much as its bias does."""
    law = next(one for one in entrants() if one.name == STANDARD)
    speed, _, _ = _tuned(law, replace(asked, model=None))
    observer = law.make(replace(asked, speed=speed))
    bias = _rms(_errors(observer, system, "bias", 0.0))
    return bias / math.sqrt(float(observer.noise_gain(DT)[-1]))


def _cell(
    empty: Cell,
    entrant: Entrant,
    asked: Asked,
    system: System,
    tuned: dict[tuple[str, int, float], tuple[float, float, float]],
) -> Cell:
    key = (entrant.name, asked.n, asked.noise)
    if key not in tuned:
        tuned[key] = _tuned(entrant, replace(asked, model=None))
    speed, settling, peak = tuned[key]
    observer = entrant.make(replace(asked, speed=speed))
    found: dict[str, Array] = {}
    said = ""
    for condition in CONDITIONS:
        try:
            found[condition] = _errors(observer, system, condition, asked.noise)
        except HgoError as error:
            said = said or f"{condition}: {error}"
    both = "white" in found and "bias" in found
    return replace(
        empty,
        speed=speed,
        settling=settling,
        peak=peak,
        noise=_share(found["white"] - found["bias"], system) if both else math.nan,
        operations=operations(observer),
        errors=tuple((name, _share(error, system)) for name, error in found.items()),
        refused=said,
    )


def _errors(observer: Observer, system: System, condition: str, noise: float) -> Array:
    """Errors of the last state at the samples that are judged."""
    clock, y, x, judged = system.record(condition, noise)
    u = system.u if observer.n_u else None
    run = observer.run(clock, y, u, x_hat0=x[0])
    return np.asarray(run.x_hat[judged, -1] - x[judged, -1])


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def _share(errors: Array, system: System) -> float:
    """RMS error over the last state's RMS; infinite where the state is lost."""
    share = _rms(errors) / system.size
    return share if share < _FAR else math.inf


def _tuned(entrant: Entrant, asked: Asked) -> tuple[float, float, float]:
    """Speed, settling time and peak by the rule.

    Raises
    ------
    HgoError
        An entrant that no speed of those tried makes settle.
    """

    def looked(speed: float) -> tuple[float, float]:
        try:
            observer = entrant.make(replace(asked, speed=speed))
            y = np.where(np.arange(_REST + _LOOKED) < _REST, 0.0, _STEP)
            x = np.abs(observer.run(DT, y).x_hat[_REST:, -1])
        except HgoError:
            return math.inf, math.nan
        peak = float(np.max(x))
        late = np.flatnonzero(x > _WITHIN * peak)
        end = int(late[-1]) + 1 if late.size else 0
        return (DT * end if 0 < end < _LOOKED else math.inf), peak / _STEP

    grid = np.geomspace(*_SPEEDS, 40)
    fits = [looked(float(speed))[0] <= SETTLING for speed in grid]
    if not any(fits):
        raise HgoError(
            f"no speed from {_SPEEDS[0]:g} to {_SPEEDS[1]:g} /s settles within {SETTLING:g} s "
            f"after a step of {_STEP:g}"
        )
    k = fits.index(True)
    high = float(grid[k])
    low = float(grid[max(k - 1, 0)])
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        if looked(middle)[0] <= SETTLING:
            high = middle
        else:
            low = middle
    return (high, *looked(high))


def operations(observer: Observer) -> int:
    """Operations of a step with a fixed period: of both halves with current timing."""
    parts = ("correct", "predict") if observer.timing == "current" else ("step",)
    spec = dict(observer.spec)
    tables = [_core.trace_step(spec, True, False, DT, part, "computed", DT) for part in parts]
    return sum(len(table["ops"]) for table in tables)


def left_out(cells: Sequence[Cell]) -> dict[str, str]:
    """What has no cell that was measured, and why."""
    out = dict(LEFT_OUT)
    for name in dict.fromkeys(cell.entrant for cell in cells):
        mine = [cell for cell in cells if cell.entrant == name]
        if not any(cell.errors for cell in mine):
            out[name] = mine[0].refused
    return out


__all__ = ["CONDITIONS", "COUNT", "M4F", "SETTLING", "Cell", "left_out", "measured", "operations"]
