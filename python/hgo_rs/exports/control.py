"""An observer as a system of the package `control`."""

from __future__ import annotations

from typing import Any

import numpy as np

from hgo_rs.errors import HgoError, MissingExtraError, explain
from hgo_rs.exports.program import words_of
from hgo_rs.exports.vector import UNDEFINED
from hgo_rs.observers import Observer
from hgo_rs.times import check_period

__all__ = ["to_control"]


def to_control(observer: Observer, dt: float, *, name: str = "observer") -> Any:
    """A discrete-time `control.NonlinearIOSystem` with the observer's memory as its state.

    Inputs are the samples and the known inputs, outputs the estimates; a sample that is NaN is
    missing. The state at an instant is the memory before the use of its sample. A law with
    predictor timing gives the estimate for the instant of the sample from the samples before it. A
    law with current timing corrects by the sample itself, and the state moves on under the input of
    the same instant: the input may be computed from the estimate.

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
    period = check_period(dt)
    observer._check_dt(period, observer.allow_unstable)
    core, n, n_y = observer._core, observer.n, observer.n_y

    def corrected(t: float, memory: Any, values: Any) -> Any:
        return core.correct(np.asarray(memory, dtype=float), values[:n_y], t)

    def update(t: float, memory: Any, given: Any, params: Any) -> Any:
        values = np.atleast_1d(np.asarray(given, dtype=float))
        memory, status = corrected(t, memory, values)
        if status != UNDEFINED:
            memory, status = core.advance(memory, values[:n_y], values[n_y:], t, period)
        if status == UNDEFINED:
            told = explain("x_hat", memory[:n], "where the model has a value", "start nearer")
            raise HgoError(f"t = {t:g} s: {told}")
        return memory

    def output(t: float, memory: Any, given: Any, params: Any) -> Any:
        values = np.atleast_1d(np.asarray(given, dtype=float))
        return corrected(t, memory, values)[0][:n]

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
