"""Feedback: the controller of a loop, and the signals that are watched in it."""

from __future__ import annotations

from typing import Any

import numpy as np

from . import integrate
from .error import Array, Spec, choice, fail, integer, known, member, vector
from .models import OwnPlant, Plant
from .table import Table

KEYS = ("law", "signals", "parameters", "delay", "from", "continuous", "start", "tells", "settle")


class Feedback:
    """A controller with its states, one column a run.

    ``u`` (n_u, runs): the inputs in force; ``signals`` (k, runs): of the last sample; ``waiting``
    (delay n_u, runs): inputs that are computed and not in force; ``c`` (n_c, runs).
    """

    def __init__(self, spec: Spec, plant: Plant, law: Any, truth: list[int], runs: int) -> None:
        known(spec, "feedback", KEYS)
        self.law = Table(member(spec, "law", "feedback"), "feedback.law")
        self.table = Table(member(spec, "signals", "feedback"), "feedback.signals")
        parameters = spec.get("parameters", ())
        self.parameters = vector(parameters, "feedback.parameters", len(parameters))
        self.delay = integer(spec.get("delay", 0), "feedback.delay", least=0)
        source = choice(member(spec, "from", "feedback"), "feedback.from", ("estimate", "state"))
        self.truth = truth if source == "state" else None
        self.continuous = bool(spec.get("continuous", True))
        # other plants give their inputs themselves
        self.n_u = plant.n_u if isinstance(plant, OwnPlant) else 0
        self.n, self.watched = law.n, len(self.table.outputs)
        start = spec.get("start", ())
        start = vector(start, "feedback.start", len(start))
        self.c = np.repeat(np.asarray(start)[:, None], runs, axis=1)
        self.u = np.zeros((self.n_u, runs))
        self.signals = np.zeros((self.watched, runs))
        self.waiting = np.zeros((self.delay * self.n_u, runs))
        self.tells = list(spec.get("tells", ()))
        self.settle = np.asarray(spec.get("settle", np.full(self.watched, np.nan)), dtype=float)
        if len(self.law.outputs) != self.n_u + len(start):
            allowed = f"{self.n_u + len(start)}"
            raise fail("feedback.law outputs", len(self.law.outputs), allowed, "correct the table")

    @property
    def width(self) -> int:
        """Numbers behind the plant's state."""
        return self.n_u + self.watched + len(self.waiting) + len(self.c)

    def row(self) -> Array:
        """Those numbers, (width, runs)."""
        return np.vstack([self.u, self.signals, self.waiting, self.c])

    def told(self, u: Array, n_u: int) -> Array | None:
        """What the observer is told."""
        return u[self.tells] if n_u else None

    def control(self, t: float, x: Array, y: Array, memory: Array, c: Array) -> tuple[Any, Any]:
        """The inputs, and the rates or next values of the states."""
        runs = x.shape[1]
        seen = memory[: self.n]
        if self.truth is not None:
            seen = np.zeros_like(seen)
            seen[: len(self.truth)] = x[self.truth]
        made = self.law([t, *y.reshape(-1, runs), *seen, *c, *self.parameters])
        rows = [np.broadcast_to(value, (runs,)) for value in made]
        u, moved = np.array(rows[: self.n_u], dtype=float), np.array(rows[self.n_u :], dtype=float)
        return u.reshape(-1, runs), moved.reshape(-1, runs)

    def close(self, t: float, x: Array, y: Array, memory: Array) -> None:
        """At a sample: bring the inputs into force and take the signals."""
        new, _ = self.control(t, x, y, memory, self.c)
        self.queue = np.vstack([self.waiting, new])
        self.show(t, x, self.queue[: self.n_u], y, memory)

    def show(self, t: float, x: Array, u: Array, y: Array, memory: Array) -> None:
        """The inputs in force, and the signals under them."""
        runs, self.u = x.shape[1], u
        y = y.reshape(-1, runs)
        made = self.table([t, *x, *u, *y, *memory[: self.n], *self.c, *self.parameters])
        for i, value in enumerate(made):
            self.signals[i] = value

    def move(self, t: float, dt: float, x: Array, y: Array, memory: Array) -> None:
        """Over the step to the next sample: what was seen is held."""
        c = self.c
        self.waiting = self.queue[self.n_u :]
        if not len(c):
            return
        if self.continuous:
            self.c = integrate.rk4(lambda time, s: self.control(time, x, y, memory, s)[1], t, c, dt)
        else:
            self.c = self.control(t, x, y, memory, c)[1]


class SettlingTimes:
    """Last time at which each signal was at or above its threshold, NaN without one."""

    def __init__(self, levels: Array, runs: int) -> None:
        self.levels = levels
        self.last = np.where(np.isnan(levels), np.nan, 0.0)[:, None] * np.ones((1, runs))

    def update(self, t: Array, signals: Array, length: Any) -> None:
        """``signals`` (steps, k, runs); of each run the first ``length`` steps count."""
        inside = np.arange(len(t))[:, None, None] < length
        late = (np.abs(signals) >= self.levels[:, None]) & inside
        last = len(t) - 1 - np.argmax(late[::-1], axis=0)
        self.last = np.where(late.any(axis=0), t[last], self.last)
