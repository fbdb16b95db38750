"""Random streams and measurement noise.

One stream a (seed, run, channel): run i of a study draws the same numbers whatever the number of
runs beside it.  The generator is xoshiro256++ (Blackman, Vigna 2021), its state filled by
SplitMix64 (Steele, Lea, Flood 2014).  All runs step together: arrays of uint64, one entry a run.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .error import Array, Spec, choice, fail, integer, member, number

Words = NDArray[np.uint64]

MEASUREMENT = 0  # channel of v(k)
PROCESS = 1  # channel of dw

_MASK = (1 << 64) - 1
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)


def _word(value: int) -> Words:
    return np.array([value & _MASK], dtype=np.uint64)


def mix(z: Words) -> Words:
    """One step of SplitMix64, elementwise mod 2^64: a bijection that scatters its bits."""
    with np.errstate(over="ignore"):  # wrap-around is what is meant
        z = z + _GOLDEN
        z = (z ^ (z >> np.uint64(30))) * _MIX_1
        z = (z ^ (z >> np.uint64(27))) * _MIX_2
        mixed: Words = z ^ (z >> np.uint64(31))
    return mixed


class Streams:
    """xoshiro256++ streams of runs ``first_run .. first_run + runs``, stepped together."""

    def __init__(self, seed: int, runs: int, channel: int, first_run: int = 0) -> None:
        run = np.arange(runs, dtype=np.uint64) + _word(first_run)
        base = mix(mix(mix(_word(seed)) ^ run) ^ _word(channel))
        with np.errstate(over="ignore"):
            self.state: list[Words] = [mix(base + np.uint64(j) * _GOLDEN) for j in range(4)]
        self.runs = runs

    @classmethod
    def from_state(cls, words: ArrayLike) -> Streams:
        """Streams with the given state words, shape (4, runs)."""
        given = np.asarray(words, dtype=np.uint64)
        streams = cls.__new__(cls)
        streams.state = [given[j].copy() for j in range(4)]
        streams.runs = given.shape[1]
        return streams

    def words(self, count: int) -> Words:
        """The next ``count`` outputs of every stream, shape (count, runs)."""
        s0, s1, s2, s3 = self.state
        first = np.empty((count, self.runs), dtype=np.uint64)
        last = np.empty_like(first)
        t = np.empty_like(s0)
        left17, left45, right19 = np.uint64(17), np.uint64(45), np.uint64(19)
        shift_left, shift_right = np.left_shift, np.right_shift
        for j in range(count):
            first[j] = s0
            last[j] = s3
            shift_left(s1, left17, out=t)
            s2 ^= s0
            s3 ^= s1
            s1 ^= s2
            s0 ^= s3
            s2 ^= t
            shift_right(s3, right19, out=t)  # s3 = rotl(s3, 45)
            shift_left(s3, left45, out=s3)
            s3 |= t
        with np.errstate(over="ignore"):
            last += first  # s0 + s3
            result: Words = last << np.uint64(23)  # rotl(s0 + s3, 23) + s0
            result |= last >> np.uint64(41)
            result += first
        return result

    def uniform(self, count: int) -> Array:
        """``count`` draws from [0, 1), shape (count, runs)."""
        return np.multiply(self.words(count) >> np.uint64(11), 2.0**-53, dtype=np.float64)

    def normal_pairs(self, count: int) -> tuple[Array, Array]:
        """``count`` pairs of independent standard normals (Box-Muller), each (count, runs)."""
        words = (self.words(2 * count) >> np.uint64(11)).reshape(count, 2, self.runs)
        u1 = (words[:, 0] + np.uint64(1)) * 2.0**-53  # in (0, 1]
        radius = np.sqrt(-2.0 * np.log(u1))
        # The angle counted from half a turn and folded at the quarters, exactly, as far as the sine
        # of a quarter: what is near 0 keeps its relative precision.
        turn = words[:, 1] * 2.0**-53 - 0.5
        folded = np.abs(turn) - 0.25
        other = np.copysign(0.25 - np.abs(folded), -turn)
        return radius * np.sin(2.0 * np.pi * folded), radius * np.sin(2.0 * np.pi * other)


def _sines(spec: Spec) -> list[tuple[float, float, float]]:
    waves = []
    for i, wave in enumerate(spec.get("sines", ())):
        if len(wave) != 3:
            raise fail(f"noise.sines[{i}]", wave, "[amplitude, omega, phase]", "give three numbers")
        amplitude, omega, phase = (number(part, f"noise.sines[{i}]") for part in wave)
        waves.append((amplitude, omega, phase))
    return waves


def _normal(streams: Streams, count: int) -> Array:
    return streams.normal_pairs(count)[0]  # the pair's sine is discarded


def _numbers(streams: Streams, count: int, each: int) -> Array:
    """``count`` draws of ``each`` uniform numbers, shape (each, count, runs)."""
    return np.swapaxes(streams.uniform(each * count).reshape(count, each, -1), 0, 1)


def _student_t(streams: Streams, count: int, nu: float) -> Array:
    """sqrt(nu (u^(-2/nu) - 1)) cos(2 pi v) (Bailey 1994)."""
    u, v = _numbers(streams, count, 2)
    grown = np.expm1(-2.0 / nu * np.log(u + 2.0**-53))
    return np.sqrt(nu * grown) * np.cos(2.0 * np.pi * v)


def _laplace(streams: Streams, count: int) -> Array:
    """An exponential number, its sign that of v - 1/2."""
    u, v = _numbers(streams, count, 2)
    return np.copysign(-np.log(u + 2.0**-53), v - 0.5)


def _impulsive(streams: Streams, count: int, probability: float, ratio: float) -> Array:
    """A normal number, ``ratio`` times as large with a probability."""
    u, v, w = _numbers(streams, count, 3)
    normal = np.sqrt(-2.0 * np.log(u + 2.0**-53)) * np.cos(2.0 * np.pi * v)
    return np.where(w < probability, ratio, 1.0) * normal


LAWS: dict[str, tuple[Callable[..., Array], tuple[str, ...]]] = {
    "normal": (_normal, ()),
    "student-t": (_student_t, ("nu",)),
    "laplace": (_laplace, ()),
    "impulsive": (_impulsive, ("probability", "ratio")),
}
"""What is drawn of a stream, times the scale, and the names of its parameters."""


class MeasurementNoise:
    """v(k) of a study: draws held ``hold`` steps, plus sines that are functions of time."""

    def __init__(
        self, spec: Spec, *, runs: int, steps: int, seed: int, first_run: int, outputs: int = 1
    ) -> None:
        self.kind = choice(
            member(spec, "kind", "noise"), "noise.kind", ("none", "uniform", "samples", *LAWS)
        )
        self.runs = runs
        self.hold = integer(spec.get("hold", 1), "noise.hold", least=1)
        self.sines = _sines(spec)
        self.outputs = outputs  # a draw for each entry of y
        self._last = np.zeros((1, outputs, runs))
        if self.kind == "uniform":
            self.low = number(member(spec, "low", "noise"), "noise.low")
            self.high = number(member(spec, "high", "noise"), "noise.high", least=self.low)
        elif self.kind in LAWS:
            self.mean = number(member(spec, "mean", "noise"), "noise.mean")
            key = "std" if self.kind == "normal" else "scale"
            self.scale = number(member(spec, key, "noise"), f"noise.{key}", least=0.0)
            self.law, names = LAWS[self.kind]
            self.parameters = [number(member(spec, name, "noise"), name) for name in names]
        elif self.kind == "samples":
            self.values = _samples(member(spec, "values", "noise"), steps, runs)
        self._streams = Streams(seed, runs, MEASUREMENT, first_run)
        self.ar = np.asarray(spec.get("ar", ()), dtype=np.float64)
        if self.ar.size:  # v(-1), v(-2), ..., shape (p, outputs, runs)
            normal = self._streams.normal_pairs(outputs * self.ar.size)[0]
            normal = normal.reshape(outputs, self.ar.size, runs)
            self._past = np.einsum("ij,ojr->ior", np.asarray(spec["start"]), normal)

    def _draw(self, count: int) -> Array:
        total = count * self.outputs
        if self.kind == "uniform":
            drawn = self.low + (self.high - self.low) * self._streams.uniform(total)
        else:
            drawn = self.mean + self.scale * self.law(self._streams, total, *self.parameters)
        drawn = drawn.reshape(count, self.outputs, self.runs)
        if self.ar.size:
            for k in range(count):
                drawn[k] += np.tensordot(self.ar, self._past, 1)
                self._past = np.concatenate((drawn[k][None], self._past[:-1]))
        return drawn

    def block(self, start: int, stop: int) -> Array:
        """Values held at steps start <= k < stop (no sines), shape (stop - start, outputs, runs).

        Blocks must follow one another from 0: the streams are sequential.
        """
        shape = (stop - start, self.outputs, self.runs)
        if self.kind == "none":
            return np.zeros(shape)
        k = np.arange(start, stop)
        if self.kind == "samples":  # given value j is held over the steps j hold .. (j+1) hold - 1
            given = self.values[:, k // self.hold].T
            return np.array(np.broadcast_to(given[:, None], shape))
        fresh = k % self.hold == 0
        held = np.concatenate((self._last, self._draw(int(fresh.sum()))))
        values = held[np.cumsum(fresh)]
        self._last = values[-1:].copy()
        return values

    def wave(self, t: Array | float) -> Array | float:
        """Sum of the sines A sin(omega t + phase) at time(s) ``t`` [s]."""
        total: Array | float = 0.0
        for amplitude, omega, phase in self.sines:
            total = total + amplitude * np.sin(omega * t + phase)
        return total


def filtered(values: ArrayLike, sections: ArrayLike) -> Array:
    """``values`` (..., N) coloured along the last axis by second-order sections, at rest before.

    ``sections`` (S, 6), rows b0, b1, b2, a0 = 1, a1, a2 as SciPy's; transposed direct form II.
    """
    rows = np.asarray(sections, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 6:
        raise fail("sections", rows.shape, "of shape (S, 6)", "give second-order sections")
    if not np.all(rows[:, 3] == 1.0):
        raise fail("sections[:, 3]", rows[:, 3].tolist(), "1", "divide each row by its a0")
    signal = np.array(values, dtype=np.float64)
    for b0, b1, b2, _, a1, a2 in rows.tolist():
        m1 = m2 = np.zeros(signal.shape[:-1])
        for k in range(signal.shape[-1]):
            given = signal[..., k].copy()
            out = b0 * given + m1
            m1 = b1 * given - a1 * out + m2
            m2 = b2 * given - a2 * out
            signal[..., k] = out
    return signal


def _samples(values: ArrayLike, steps: int, runs: int) -> Array:
    given = np.asarray(values, dtype=np.float64)
    if given.shape not in ((steps + 1,), (runs, steps + 1)):
        raise fail(
            "noise.values",
            f"array of shape {given.shape}",
            f"of shape ({steps + 1},) or ({runs}, {steps + 1})",
            "give one value a sample, k = 0..steps",
        )
    return np.broadcast_to(given, (runs, steps + 1))


class ProcessNoise:
    """Standard normal pairs (xi1, xi2) that drive a stochastic plant, one pair a substep."""

    def __init__(self, *, runs: int, seed: int, first_run: int) -> None:
        self._streams = Streams(seed, runs, PROCESS, first_run)

    def pairs(self, count: int) -> tuple[Array, Array]:
        """The next ``count`` pairs, each of shape (count, runs)."""
        return self._streams.normal_pairs(count)


__all__ = [
    "MEASUREMENT",
    "PROCESS",
    "MeasurementNoise",
    "ProcessNoise",
    "Streams",
    "filtered",
    "mix",
]
