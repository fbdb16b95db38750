"""An observer as a system of the package `control`."""

from __future__ import annotations

from typing import Any

import numpy as np

from hgo_rs.errors import MissingExtraError, check_number
from hgo_rs.exports.program import words_of
from hgo_rs.observers import Observer

__all__ = ["to_control"]


def to_control(observer: Observer, dt: float, *, name: str = "observer") -> Any:
    """A discrete-time `control.NonlinearIOSystem` with the observer's memory as its state.

    Inputs are the samples and the known inputs, outputs the estimates; a sample that is NaN is
    missing. A law with predictor timing gives the estimate for the instant of the sample from the
    samples before it, a law with current timing uses the sample itself.

    Parameters
    ----------
    observer : Observer
        It is not moved. Start the simulation at its `memory`, or at one of `initial_memory`.
    dt : float
        Sampling period [s].
    name : str
        Name of the system.

    Raises
    ------
    HgoError
        dt not positive, or at or above the stability limit.
    MissingExtraError
        The package `control` is not installed.
    """
    try:
        import control
    except ImportError:
        raise MissingExtraError(
            "to_control needs the package control: pip install 'hgo_rs[control]'"
        ) from None
    period = check_number(dt, "dt", above=0.0)
    observer._check_dt(period, observer.allow_unstable)
    core, n, n_y = observer._core, observer.n, observer.n_y

    def moved(t: float, memory: Any, given: Any) -> Any:
        values = np.atleast_1d(np.asarray(given, dtype=float))
        return core.step(np.asarray(memory, dtype=float), values[:n_y], values[n_y:], t, period)[0]

    def update(t: float, memory: Any, given: Any, params: Any) -> Any:
        return moved(t, memory, given)

    def output(t: float, memory: Any, given: Any, params: Any) -> Any:
        return (moved(t, memory, given) if core.is_current else np.asarray(memory))[:n]

    words = words_of(observer)
    return control.NonlinearIOSystem(
        update,
        output,
        inputs=[*words.samples, *words.controls],
        outputs=[f"{word}_hat" for word in words.memory[:n]],
        states=list(words.memory),
        dt=period,
        name=name,
    )
