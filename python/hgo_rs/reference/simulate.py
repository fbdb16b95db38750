"""Experiments: plant, noise and observer in one loop, many runs side by side.

One Python loop over the steps serves all runs.  States are kept for a block of steps, and metrics
are taken block by block.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import integrate
from .error import Array, Spec, choice, columns, fail, integer, known, member, number
from .feedback import Feedback, SettlingTimes
from .gain import ConstantGain
from .models import OwnPlant, Plant, VanDerPol, plant_from
from .noise import MeasurementNoise, ProcessNoise
from .observers import ContinuousLaw, Law, StandardObserver, law_from
from .schedule import schedule_from

DIVERGENCE = 1e12  # |value| beyond which a run is called diverged
BINS_PER_OCTAVE = 32
OCTAVES = 64  # the histogram spans 2^-40 .. 2^24

_BLOCK_FLOATS = 1_500_000  # memory of one block of steps
_BLOCK_STEPS = 2048

KEYS = (
    "plant",
    "observer",
    "mode",
    "steps",
    "schedule",
    "plant_schedule",
    "plant_method",
    "substeps",
    "x0",
    "memory0",
    "noise",
    "runs",
    "seed",
    "first_run",
    "windows",
    "metrics",
    "settle",
    "histogram",
    "every",
    "truth",
    "feedback",
    "errors",
)
METRICS = ("mean", "rms", "max", "peak")
PLANT_METHODS = (*integrate.DETERMINISTIC, *integrate.STOCHASTIC, "held")


def histogram_edges() -> Array:
    """Edges 2^(-40 + j/32), j = 0..2048, of the histogram of ||error||^2."""
    return np.asarray(2.0 ** (-40.0 + np.arange(OCTAVES * BINS_PER_OCTAVE + 1) / BINS_PER_OCTAVE))


class _Drive:
    """How the plant moves from one sample to the next."""

    def __init__(self, plant: Plant, spec: Spec, runs: int, seed: int, first_run: int) -> None:
        self.plant = plant
        self.method = choice(spec.get("plant_method", "euler"), "plant_method", PLANT_METHODS)
        self.substeps = integer(spec.get("substeps", 1), "substeps", least=1)
        self.process: ProcessNoise | None = None
        if self.method in integrate.STOCHASTIC:
            if isinstance(plant, OwnPlant) and plant.noisy:
                own = "'euler-maruyama' for a plant of your own"
                if self.method != "euler-maruyama":
                    raise fail("plant_method", self.method, own, "change the scheme")
            elif not isinstance(plant, VanDerPol):
                raise fail(
                    "plant_method",
                    self.method,
                    "a deterministic scheme for this plant",
                    "use 'euler', 'rk4' or 'bogacki-shampine'",
                )
            elif self.method == "taylor-1.5" and plant.multiplicative:
                raise fail("plant_method", self.method, "for additive noise only", "use 'milstein'")
            self.process = ProcessNoise(runs=runs, seed=seed, first_run=first_run)
        elif plant.noisy and self.method != "held":
            raise fail(
                "plant_method",
                self.method,
                "a stochastic scheme for a plant with process noise",
                "use 'euler-maruyama', 'milstein' or 'taylor-1.5', or sigma = 0",
            )

    def draw(self, steps: int) -> tuple[Array, Array] | None:
        """Normal pairs for ``steps`` samples, or None."""
        return None if self.process is None else self.process.pairs(steps * self.substeps)

    def advance(
        self,
        x: Array,
        u: Array | None,
        t: float,
        dt: float,
        normals: tuple[Array, Array] | None,
        j: int,
    ) -> Array:
        """x after ``dt``; ``j`` is the sample's index among those drawn for."""
        if self.method == "held":
            return x
        m = self.substeps
        h = dt / m if m > 1 else dt
        plant: Any = self.plant
        if normals is not None:
            step = integrate.STOCHASTIC[self.method]
            xi1, xi2 = normals
            for i in range(m):
                dw, dz = integrate.brownian(h, xi1[j * m + i], xi2[j * m + i])
                x = step(plant, x, h, dw, dz, t + i * h, u)
            return x
        if self.method == "euler":
            for i in range(m):
                x = x + h * plant.drift(x, u, t + i * h)
            return x
        scheme = integrate.DETERMINISTIC[self.method]
        for i in range(m):
            x = scheme(lambda time, s: plant.drift(s, u, time), t + i * h, x, h)
        return x


class _Metrics:
    """Streaming metrics over blocks of steps; arrays hold one column a run."""

    def __init__(self, spec: Spec, runs: int, n: int, kept: int, n_peak: int) -> None:
        windows = spec.get("windows", ()) or ()
        self.windows = [_window(w, f"windows[{i}]") for i, w in enumerate(windows)]
        settle = spec.get("settle")
        self.settle = None if settle is None else number(settle, "settle", above=0.0)
        bins = spec.get("histogram")
        self.bins = None if bins is None else _window(bins, "histogram")
        self.n = n
        shape = (len(self.windows), kept, runs)
        self.sum = np.zeros(shape)
        self.sum_squares = np.zeros(shape)
        self.max = np.zeros(shape)
        self.count = np.zeros((len(self.windows), runs))
        self.peak = np.zeros((n_peak, runs))
        self.settling_time = np.full(runs, 0.0 if self.settle is not None else np.nan)
        self.counts = np.zeros(OCTAVES * BINS_PER_OCTAVE, dtype=np.int64)

    def update(
        self, start: int, t: Array, error: Array, memory: Array, length: NDArray[np.int64]
    ) -> None:
        """``error`` (steps, n, runs) and ``memory`` from step ``start`` on; of each run only the
        first ``length`` steps count."""
        stop = start + len(t)
        n = self.n
        whole = bool(np.all(length == len(t)))
        inside: NDArray[np.bool_] | None = None if whole else np.arange(len(t))[:, None] < length
        self._peaks(memory, inside)
        for i, (k0, k1) in enumerate(self.windows):
            a, b = max(k0, start) - start, min(k1, stop) - start
            if a >= b:
                continue
            kept = self.sum.shape[1]
            parts = [error[a:b], memory[a:b, n:kept]] if kept > n else [error[a:b, :kept]]
            row = 0
            for part in parts:
                rows = slice(row, row + part.shape[1])
                row += part.shape[1]
                if inside is not None:
                    part = np.where(inside[a:b, None], part, 0.0)
                self.sum[i, rows] += part.sum(axis=0)
                self.sum_squares[i, rows] += (part * part).sum(axis=0)
                self.max[i, rows] = np.maximum(self.max[i, rows], np.abs(part).max(axis=0))
            self.count[i] += b - a if inside is None else inside[a:b].sum(axis=0)
        if self.settle is None and self.bins is None:
            return
        square = (error * error).sum(axis=1)
        if self.settle is not None:
            late = np.sqrt(square) >= self.settle
            if inside is not None:
                late &= inside
            last = len(t) - 1 - np.argmax(late[::-1], axis=0)
            self.settling_time = np.where(late.any(axis=0), t[last], self.settling_time)
        if self.bins is not None:
            a, b = max(self.bins[0], start) - start, min(self.bins[1], stop) - start
            if a < b:
                values = square[a:b] if inside is None else square[a:b][inside[a:b]]
                self._bin(values.reshape(-1))

    def _peaks(self, memory: Array, inside: NDArray[np.bool_] | None) -> None:
        part = memory[:, : self.peak.shape[0]]
        if inside is not None:
            part = np.where(inside[:, None], part, 0.0)
        np.maximum(self.peak, np.abs(part).max(axis=0), out=self.peak)

    def _bin(self, values: Array) -> None:
        with np.errstate(divide="ignore"):
            place = np.floor((np.log2(values) + 40.0) * BINS_PER_OCTAVE)
        last = len(self.counts) - 1
        index = np.clip(place, 0, last).astype(np.int64)
        self.counts += np.bincount(index, minlength=last + 1)

    def result(self) -> dict[str, Any]:
        """The metrics with runs first."""
        with np.errstate(invalid="ignore", divide="ignore"):
            count = self.count[:, None]
            mean = self.sum / count
            rms = np.sqrt(self.sum_squares / count)
            peak_error = np.where(count > 0, self.max, np.nan)
        out: dict[str, Any] = {
            name: np.ascontiguousarray(np.moveaxis(value, -1, 0))
            for name, value in (("mean", mean), ("rms", rms), ("max", peak_error))
        }
        out["peak"] = np.ascontiguousarray(self.peak.T)
        out["settling_time"] = self.settling_time
        if self.bins is not None:
            out["histogram"] = {"edges": histogram_edges(), "counts": self.counts.copy()}
        return out


def _window(value: Any, parameter: str) -> tuple[int, int]:
    if len(value) != 2:
        raise fail(parameter, value, "[k0, k1]", "give two step indices")
    k0 = integer(value[0], f"{parameter}[0]", least=0)
    k1 = integer(value[1], f"{parameter}[1]", least=k0 + 1)
    return k0, k1


class _Frames:
    """Every q-th sample, kept."""

    def __init__(self, every: int, steps: int, runs: int, sizes: tuple[int, int, int]) -> None:
        self.every = every
        frames = steps // every + 1
        self.t = np.empty(frames)
        self.kept = [np.full((runs, frames, size), np.nan) for size in sizes]
        self.filled = 0  # frames that some run has reached

    def update(self, start: int, t: Array, parts: list[Array], length: NDArray[np.int64]) -> None:
        """Keep what falls into this block; NaN from a run's divergence on."""
        rows = np.arange(-start % self.every, int(length.max()), self.every)
        if rows.size == 0:
            return
        first = (start + int(rows[0])) // self.every
        self.filled = first + rows.size
        self.t[first : self.filled] = t[rows]
        reached = rows[:, None, None] < length
        for kept, values in zip(self.kept, parts, strict=True):
            part = np.where(reached, values[rows], np.nan)
            kept[:, first : self.filled] = np.moveaxis(part, -1, 0)

    def result(self) -> dict[str, Array]:
        """Arrays "t" (frames,), "x", "memory" and "y" (runs, frames, .)."""
        names = ("x", "memory", "y")
        out = {
            name: np.ascontiguousarray(kept[:, : self.filled])
            for name, kept in zip(names, self.kept, strict=True)
        }
        return {"t": self.t[: self.filled], **out}


def simulate(spec: Spec) -> dict[str, Any]:
    """Run plant and observer over ``steps`` steps in ``runs`` runs and return metrics.

    ``spec`` needs "plant", "observer", "steps", "schedule", "x0" and "memory0"; optional are
    "mode", "plant_schedule", "plant_method", "substeps", "noise", "runs", "seed", "first_run",
    "windows", "metrics", "settle", "histogram", "every", "truth", "feedback" and
    "errors".

    Returns "mean", "rms", "max" (runs, windows, signals), signals = error (n) then extras;
    "peak" (runs, memory_len), "settling_time" (runs,) [s], "histogram" (if asked for), "final_x",
    "final_memory", "diverged_at" and "undefined_at" (runs,), and with "every" > 0 the
    trajectories "t" (frames,), "x", "memory", "y" (runs, frames, .).

    Raises ValueError, naming the parameter, for a spec that cannot be run.
    """
    known(spec, "spec", KEYS)
    plant = plant_from(member(spec, "plant", "spec"))
    law = law_from(member(spec, "observer", "spec"))
    steps = integer(member(spec, "steps", "spec"), "steps", least=1)
    runs = integer(spec.get("runs", 1), "runs", least=1)
    seed = integer(spec.get("seed", 0), "seed", least=0)
    first_run = integer(spec.get("first_run", 0), "first_run", least=0)
    mode = choice(spec.get("mode", "sampled"), "mode", ("sampled", "joint"))
    every = integer(spec.get("every", 0), "every", least=0)
    asked = METRICS if spec.get("metrics") is None else spec["metrics"]
    for name in asked:
        choice(name, "metrics", METRICS)
    schedule = schedule_from(member(spec, "schedule", "spec"))
    plant_schedule = schedule
    if spec.get("plant_schedule") is not None:
        plant_schedule = schedule_from(spec["plant_schedule"], "plant_schedule")
    closed = spec.get("feedback") is not None
    if law.n_y != plant.n_y or (plant.n_u and law.n_u != plant.n_u and not closed):
        raise fail(
            "observer.n_y",
            law.n_y,
            f"{plant.n_y} outputs, with {plant.n_u} inputs, for plant {plant.kind!r}",
            "choose an observer that fits the plant",
        )
    noise_spec = spec.get("noise") or {"kind": "none"}
    noise = MeasurementNoise(
        noise_spec, runs=runs, steps=steps, seed=seed, first_run=first_run, outputs=plant.n_y
    )
    x = columns(member(spec, "x0", "spec"), "x0", plant.n, runs)
    memory = columns(member(spec, "memory0", "spec"), "memory0", law.memory_len, runs)
    law.check(memory)
    # which entries of x are estimated, where they are not the plant's own choice
    target = law.target(plant)
    truth: Any = (spec.get("truth") or list(range(plant.n))[target])[: law.n]

    loop = Feedback(spec["feedback"], plant, law, list(truth), runs) if closed else None
    width = loop.width if loop else 0
    advance: _Sampled | _Joint
    if mode == "joint":
        advance = _Joint(plant, law, spec, noise, runs, loop)
    else:
        advance = _Sampled(plant, law, _Drive(plant, spec, runs, seed, first_run), runs, loop)

    entries = law.signals if spec.get("errors", True) else 0
    metrics = _Metrics(spec, runs, len(truth), entries, entries)
    watched = settled = None
    if loop is not None and loop.watched:
        quiet: dict[str, Any] = {**spec, "settle": None, "histogram": None}
        watched = _Metrics(quiet, runs, loop.watched, loop.watched, loop.watched)
        settled = SettlingTimes(loop.settle, runs)
    sizes = (plant.n + width, law.memory_len, plant.n_y)
    frames = _Frames(every, steps, runs, sizes) if every else None
    diverged_at = np.full(runs, -1, dtype=np.int64)
    final_x, final_memory = np.vstack([x, np.zeros((width, runs))]), memory.copy()

    held_now = final_x[plant.n : plant.n + (loop.n_u + loop.watched if loop else 0)].copy()
    per_step = runs * (plant.n + law.memory_len + 4 + 2 * advance.normals_per_step)
    block = int(np.clip(_BLOCK_FLOATS // per_step, 8, _BLOCK_STEPS))
    total = steps + 1
    t_next = plant_next = 0.0
    with np.errstate(all="ignore"):  # diverging runs overflow; they are found below
        for start in range(0, total, block):
            stop = min(start + block, total)
            k = np.arange(start, stop + 1)
            t = schedule.times(k, t_next)
            plant_t = plant_schedule.times(k, plant_next)
            t_next, plant_next = float(t[-1]), float(plant_t[-1])
            t = t[:-1]
            held = noise.block(start, stop)
            part = _Block(
                start=start,
                last=stop == total,
                t=t,
                dt=schedule.steps(k[:-1]),
                plant_t=plant_t[:-1],
                plant_dt=plant_schedule.steps(k[:-1]),
                held=held,
                v=held + np.reshape(noise.wave(t), (-1, 1, 1)) if noise.sines else held,
                xs=np.empty((stop - start, plant.n + width, runs)),
                ys=np.empty((stop - start, plant.n_y, runs)),
                memories=np.empty((stop - start, law.memory_len, runs)),
            )
            x, memory = advance.through(part, x, memory)
            xs, memories = part.xs, part.memories
            length = _find_divergence(
                start, xs, memories, diverged_at, final_x, final_memory, stop - start
            )
            if loop is not None:  # of a run that diverged what is of the last sample before
                last = np.minimum(length, stop - start) - 1
                reached, now = last >= 0, slice(plant.n, plant.n + loop.n_u + loop.watched)
                seen = xs[np.maximum(last, 0), now, np.arange(runs)].T
                final_x[now] = np.where(reached, seen, held_now)
                held_now = final_x[now].copy()
            errors = memories[:, : len(truth)] - xs[:, truth]
            metrics.update(start, t, errors, memories, length)
            if loop is not None and watched is not None and settled is not None:
                first = plant.n + loop.n_u
                signals = xs[:, first : first + loop.watched]
                watched.update(start, t, signals, signals, length)
                settled.update(t, signals, length)
            if frames is not None:
                frames.update(start, t, [xs, memories, part.ys], length)
            if np.all(diverged_at >= 0):
                break
    running = diverged_at < 0
    final_x = np.where(running, x if loop is None else np.vstack([x, loop.row()]), final_x)
    final_memory = np.where(running, memory, final_memory)
    out = metrics.result()
    if watched is not None and settled is not None:
        of_signals = watched.result() | {"settling_time": np.ascontiguousarray(settled.last.T)}
        out |= {f"signal_{name}": values for name, values in of_signals.items()}
    for name in set(METRICS) - set(asked):
        del out[name]
        out.pop(f"signal_{name}", None)
    out["final_x"] = np.ascontiguousarray(final_x.T)
    out["final_memory"] = np.ascontiguousarray(final_memory.T)
    out["diverged_at"] = diverged_at
    undefined_at = advance.undefined_at
    out["undefined_at"] = np.where(
        running | (undefined_at < diverged_at), undefined_at, np.int64(-1)
    )
    if frames is not None:
        out.update(frames.result())
    return out


def _find_divergence(
    start: int,
    xs: Array,
    memories: Array,
    diverged_at: NDArray[np.int64],
    final_x: Array,
    final_memory: Array,
    steps: int,
) -> NDArray[np.int64]:
    """Note the runs that diverge in this block; how many steps of it count, one entry a run."""
    length = np.where(diverged_at < 0, steps, 0)
    largest = np.maximum(np.abs(xs).max(axis=(0, 1)), np.abs(memories).max(axis=(0, 1)))
    suspects = np.flatnonzero((diverged_at < 0) & ~(largest <= DIVERGENCE))
    for run in suspects:
        fine = np.all(np.abs(xs[:, :, run]) <= DIVERGENCE, axis=1) & np.all(
            np.abs(memories[:, :, run]) <= DIVERGENCE, axis=1
        )
        at = int(np.argmin(fine))
        diverged_at[run] = start + at
        length[run] = at
        final_x[:, run] = xs[at, :, run]
        final_memory[:, run] = memories[at, :, run]
    return length


@dataclass
class _Block:
    """Some consecutive samples of a study: what is known beforehand, and what is filled in."""

    start: int  # step index of the first one
    last: bool  # whether the study ends here
    t: Array  # (steps,)
    dt: Array  # of the observer
    plant_t: Array  # of the plant, which may have a clock of its own
    plant_dt: Array
    held: Array  # drawn noise (steps, n_y, runs)
    v: Array  # with the sines at t(k)
    xs: Array  # to fill: (steps, n, runs)
    ys: Array  # to fill: (steps, n_y, runs)
    memories: Array  # to fill: (steps, memory_len, runs)


class _Sampled:
    """The observer sees y(k); the plant moves in between."""

    def __init__(
        self, plant: Plant, law: Law, drive: _Drive, runs: int, loop: Feedback | None
    ) -> None:
        self.plant, self.law, self.drive, self.loop = plant, law, drive, loop
        self.undefined_at = np.full(runs, -1, dtype=np.int64)
        self.normals_per_step = drive.substeps if drive.process is not None else 0

    def through(self, part: _Block, x: Array, memory: Array) -> tuple[Array, Array]:
        """Steps through a block; the study's last sample is measured only."""
        plant, law, loop = self.plant, self.law, self.loop
        closed = loop if loop is not None and loop.n_u else None
        count, last = len(part.t), part.last
        normals = self.drive.draw(count - last)
        times, steps = part.t.tolist(), part.dt.tolist()
        plant_times, plant_steps = part.plant_t.tolist(), part.plant_dt.tolist()
        v = part.v[:, 0] if plant.n_y == 1 else part.v
        for j in range(count):
            t, dt, plant_t = times[j], steps[j], plant_times[j]
            part.xs[j, : plant.n] = x
            u = None
            if closed is not None:
                u = closed.u
            elif plant.n_u:
                u = plant.control(x, dt, plant_t)
            y = plant.output(x, u, plant_t) + v[j]
            part.ys[j] = y
            if law.is_current:
                memory = self._settled(j + part.start, memory, law.correct(memory, y, t))
            part.memories[j] = memory
            told = u
            if loop is not None:
                loop.close(t, x, y, memory)
                part.xs[j, plant.n :] = loop.row()
            if closed is not None:
                u, told = closed.u, closed.told(closed.u, law.n_u)
            if last and j == count - 1:
                break
            if law.is_current:
                new = law.predict(memory, told, t, dt)
            else:
                new = law.step(memory, y, told, t, dt)
            if loop is not None:
                loop.move(t, dt, x, y, memory)
            memory = self._settled(j + part.start, memory, new)
            x = self.drive.advance(x, u, plant_t, plant_steps[j], normals, j)
        return x, memory

    def _settled(self, k: int, old: Array, new: Array) -> Array:
        """The memory after sample k, and where the model had no value for the first time."""
        memory, undefined = self.law.settle(old, new)
        self.undefined_at[undefined & (self.undefined_at < 0)] = k
        return memory


class _Joint:
    """Plant and observer as one ODE; drawn noise is held over a step, sines are continuous."""

    normals_per_step = 0

    def __init__(
        self,
        plant: Plant,
        law: Law,
        spec: Spec,
        noise: MeasurementNoise,
        runs: int,
        loop: Feedback | None,
    ) -> None:
        if not isinstance(law, ContinuousLaw):
            raise fail("mode", "joint", "'sampled' for a sampled law", "set mode = 'sampled'")
        self.law: ContinuousLaw = law
        self.loop = loop
        choice(law.method, "observer.method (mode 'joint')", tuple(integrate.DETERMINISTIC))
        self.plant = plant
        self.undefined_at = np.full(runs, -1, dtype=np.int64)  # continuous laws are never so
        self.still = spec.get("plant_method") == "held"
        self.noise = noise
        self.scheme = integrate.DETERMINISTIC[law.method]

    def through(self, part: _Block, x: Array, memory: Array) -> tuple[Array, Array]:
        """Steps through a block; the study's last sample is measured only."""
        plant, law, scheme, noise = self.plant, self.law, self.scheme, self.noise
        loop, nx = self.loop, plant.n
        end = nx + law.memory_len
        times, steps = part.t.tolist(), part.dt.tolist()
        held = part.held[:, 0]
        value = held[0]
        parts = (x, memory) if loop is None else (x, memory, loop.c)
        state = np.concatenate(parts)
        with_sines, still = bool(noise.sines), self.still

        def rate(time: float, s: Array) -> Array:
            x, memory = s[:nx], s[nx:end]
            added = value + noise.wave(time) if with_sines else value
            y = plant.output(x, None, time) + added
            u = told = None
            out = np.empty_like(s)
            if loop is not None:
                u, out[end:] = loop.control(time, x, y, memory, s[end:])
                told = loop.told(u, law.n_u)
                y = plant.output(x, u, time) + added
            out[:nx] = 0.0 if still else plant.drift(x, u, time)
            out[nx:end] = law.rate(memory, law.innovation(memory, y), told, time)
            return out

        for j in range(len(times)):
            part.xs[j, :nx] = x = state[:nx]
            part.ys[j] = plant.output(x, None, times[j]) + part.v[j, 0]
            part.memories[j] = memory = state[nx:end]
            if loop is not None:
                loop.c = state[end:]
                u, _ = loop.control(times[j], x, part.ys[j], memory, loop.c)
                part.ys[j] = plant.output(x, u, times[j]) + part.v[j, 0]
                loop.show(times[j], x, u, part.ys[j], memory)
                part.xs[j, nx:] = loop.row()
            if part.last and j == len(times) - 1:
                break
            value = held[j]
            state = scheme(rate, times[j], state, steps[j])
            if law.gain_rows or law.shape_row is not None:
                law.clamp(state[nx:end])
        if loop is not None:
            loop.c = state[end:]
        return state[:nx], state[nx:end]


def coupled_paths(spec: Spec) -> dict[str, Array]:
    """A coarse path of a scheme and a fine reference path on the same Brownian motion.

    ``spec``: "plant" (van-der-pol), "x0", "t_end" [s], "coarse" steps, "fine" steps per coarse
    step, "method" (a stochastic scheme), "runs", "seed", "first_run".  The fine path is of strong
    order 1.5 (additive noise) or Milstein's (multiplicative).

    Returns "coarse" and "fine", the end points, each (runs, n).
    """
    known(
        spec,
        "spec",
        ("plant", "x0", "t_end", "coarse", "fine", "method", "runs", "seed", "first_run"),
    )
    plant = plant_from(member(spec, "plant", "spec"))
    if not isinstance(plant, VanDerPol):
        raise fail("plant.kind", plant.kind, "'van-der-pol'", "choose a stochastic plant")
    method = choice(member(spec, "method", "spec"), "method", tuple(integrate.STOCHASTIC))
    if plant.multiplicative and method == "taylor-1.5":
        raise fail("method", method, "for additive noise only", "use 'milstein'")
    runs = integer(spec.get("runs", 1), "runs", least=1)
    seed = integer(spec.get("seed", 0), "seed", least=0)
    first_run = integer(spec.get("first_run", 0), "first_run", least=0)
    coarse_steps = integer(member(spec, "coarse", "spec"), "coarse", least=1)
    fine_steps = integer(member(spec, "fine", "spec"), "fine", least=1)
    big = number(member(spec, "t_end", "spec"), "t_end", above=0.0) / coarse_steps
    h = big / fine_steps
    coarse = columns(member(spec, "x0", "spec"), "x0", plant.n, runs)
    fine = coarse.copy()
    fine_step = integrate.STOCHASTIC["milstein" if plant.multiplicative else "taylor-1.5"]
    coarse_step = integrate.STOCHASTIC[method]
    process = ProcessNoise(runs=runs, seed=seed, first_run=first_run)
    block = int(np.clip(_BLOCK_FLOATS // (4 * runs), 1, fine_steps))
    with np.errstate(all="ignore"):
        for k in range(coarse_steps):
            w = np.zeros(runs)
            z = np.zeros(runs)
            for start in range(0, fine_steps, block):
                count = min(block, fine_steps - start)
                dws, dzs = integrate.brownian(h, *process.pairs(count))
                for j, (dw, dz) in enumerate(zip(dws, dzs, strict=True), start):
                    fine = fine_step(plant, fine, h, dw, dz, k * big + j * h)
                    z = z + (dz + h * w)  # int (w(s) - w(0)) ds, exactly
                    w = w + dw
            coarse = coarse_step(plant, coarse, big, w, z, k * big)
    return {"coarse": np.ascontiguousarray(coarse.T), "fine": np.ascontiguousarray(fine.T)}


def mean_covariance(spec: Spec) -> dict[str, Array]:
    """Exact mean and covariance of the error of a linear observer, without Monte Carlo.

    ``spec`` as for ``simulate``: the standard law with constant gain, Euler's scheme and model
    "none", on a deterministic plant, with zero-mean i.i.d. noise of variance ``spec["variance"]``
    (default: that of ``spec["noise"]``).  With F = I + dt (A - K C), e = x_hat - x:
    Cov+ = F Cov F' + dt^2 K K' sigma^2, and the mean follows the noise-free recursion.

    Returns "rms" (windows, n), rms^2 = mean over k of (mean e)^2 + var e, and
    "final_covariance" (n, n).
    """
    known(spec, "spec", (*KEYS, "variance"))
    law = law_from(member(spec, "observer", "spec"))
    if not (
        isinstance(law, StandardObserver)
        and isinstance(law.gain, ConstantGain)
        and law.shape is None
        and law.method == "euler"
        and law.model.n == 0
        and spec.get("mode", "sampled") == "sampled"
    ):
        raise fail(
            "observer",
            spec["observer"],
            "the standard law with constant gain, method 'euler' and model 'none', sampled",
            "use simulate for other laws",
        )
    variance = spec.get("variance")
    if variance is None:
        variance = _variance(spec.get("noise") or {"kind": "none"})
    variance = number(variance, "variance", least=0.0)
    quiet: dict[str, Any] = {key: value for key, value in spec.items() if key != "variance"}
    steps = integer(member(spec, "steps", "spec"), "steps", least=1)
    windows = spec.get("windows", ()) or ()
    quiet.update(noise={"kind": "none"}, runs=1, settle=None, histogram=None, every=0)
    mean = simulate(quiet)["rms"][0, :, : law.n]

    schedule = schedule_from(member(spec, "schedule", "spec"))
    n = law.n
    injection = law.k * law.gain.ell ** np.arange(1, n + 1)
    chain = np.eye(n, k=1)
    chain[:, 0] -= injection  # A - K C
    noise_in = variance * np.outer(injection, injection)
    identity = np.eye(n)
    covariance = np.zeros((n, n))
    squares = np.zeros((len(windows), n))
    spans = [_window(w, f"windows[{i}]") for i, w in enumerate(windows)]
    for start in range(0, steps + 1, _BLOCK_STEPS):
        k = np.arange(start, min(start + _BLOCK_STEPS, steps + 1))
        dt = schedule.steps(k)
        transition = identity + dt[:, None, None] * chain
        transposed = np.ascontiguousarray(np.swapaxes(transition, 1, 2))
        added = (dt * dt)[:, None, None] * noise_in
        variances = np.empty((len(k), n))
        for j in range(len(k)):
            variances[j] = covariance.diagonal()
            if k[j] < steps:
                covariance = transition[j] @ covariance @ transposed[j] + added[j]
        for i, (k0, k1) in enumerate(spans):
            inside = (k >= k0) & (k < k1)
            squares[i] += variances[inside].sum(axis=0)
    lengths = np.array([[float(min(k1, steps + 1) - k0)] for k0, k1 in spans]).reshape(-1, 1)
    return {
        "rms": np.sqrt(mean * mean + squares / lengths),
        "final_covariance": covariance,
    }


def _variance(noise: Spec) -> float:
    kind = member(noise, "kind", "noise")
    if kind not in ("none", "uniform", "normal") or noise.get("sines") or noise.get("hold", 1) != 1:
        raise fail("noise", dict(noise), "zero-mean and i.i.d.", "give 'variance' for other noise")
    if kind == "none":
        return 0.0
    if kind == "normal":
        if number(noise.get("mean", 0.0), "noise.mean") != 0.0:
            raise fail("noise.mean", noise["mean"], "0", "the law of the mean error is noise-free")
        return number(noise["std"], "noise.std", least=0.0) ** 2
    low, high = number(noise["low"], "noise.low"), number(noise["high"], "noise.high")
    if low != -high:
        raise fail("noise.low", low, f"{-high:g}", "the noise must have zero mean")
    return (high - low) ** 2 / 12.0


__all__ = ["coupled_paths", "histogram_edges", "mean_covariance", "simulate"]
