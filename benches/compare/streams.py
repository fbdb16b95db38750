"""The package's random streams, xoshiro256++ one a run, in Numba and JAX.

All start from the states that the NumPy reference derives from (seed, run), so that every
implementation of a workload draws the same numbers.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from compare.harness import SEED, Array, Call, need
from hgo_rs.reference.noise import Streams

Words = NDArray[np.uint64]


def states(runs: int, channel: int) -> Words:
    """The streams' states, (4, runs)."""
    return np.ascontiguousarray(np.stack(Streams(SEED, runs, channel).state))


def numba_draws(own: bool) -> tuple[Any, Any, Any]:
    """In Numba: ``g = start(words, run)``, then ``g, value = uniform(g)`` or ``normal(g)``.

    From the streams of `states`, or (``own``) from np.random, as one would write it first.
    """
    numba = need("numba")
    inline = numba.njit(inline="always", fastmath=True, error_model="numpy")
    if own:

        @inline
        def seed(words: Any, run: Any) -> Any:
            np.random.seed(run)  # noqa: NPY002 (Numba's own)
            return 0

        @inline
        def own_uniform(g: Any) -> Any:
            return g, np.random.random()  # noqa: NPY002

        @inline
        def own_normal(g: Any) -> Any:
            return g, np.random.standard_normal()  # noqa: NPY002

        return seed, own_uniform, own_normal
    left17, left23, right41 = np.uint64(17), np.uint64(23), np.uint64(41)
    left45, right19, right11 = np.uint64(45), np.uint64(19), np.uint64(11)

    @inline
    def start(words: Any, run: Any) -> Any:
        return words[0, run], words[1, run], words[2, run], words[3, run]

    @inline
    def bits(g: Any) -> Any:
        s0, s1, s2, s3 = g
        total = s0 + s3
        drawn = ((total << left23) | (total >> right41)) + s0
        t = s1 << left17
        s2 ^= s0
        s3 ^= s1
        s1 ^= s2
        s0 ^= s3
        s2 ^= t
        return (s0, s1, s2, (s3 << left45) | (s3 >> right19)), np.float64(drawn >> right11)

    @inline
    def uniform(g: Any) -> Any:
        g, whole = bits(g)
        return g, whole * 2.0**-53

    @inline
    def normal(g: Any) -> Any:
        g, first = bits(g)
        g, second = bits(g)
        radius = np.sqrt(-2.0 * np.log((first + 1.0) * 2.0**-53))
        return g, radius * np.cos(2.0 * np.pi * (second * 2.0**-53))  # Box, Muller

    return start, uniform, normal


def numba_study(one: Any, words: Words, starts: Array, threads: int) -> Call:
    """The call of ``one(words, run, start)``, a number, for every run; gives (runs, 1)."""
    numba, runs = need("numba"), words.shape[1]

    @numba.njit(parallel=threads > 1)
    def study(words: Words, starts: Array) -> Array:
        numbers = np.empty((runs, 1))
        for run in numba.prange(runs):
            numbers[run, 0] = one(words, run, starts[run])
        return numbers

    return lambda: study(words, starts)


def jax_draws() -> tuple[Any, Any]:
    """In JAX: ``g, value = uniform(g)`` or ``normal(g)``, g the four words of a run's stream."""
    jax = need("jax")
    jax.config.update("jax_enable_x64", True)

    def bits(g: Any) -> Any:
        s0, s1, s2, s3 = g
        total = s0 + s3
        drawn = ((total << np.uint64(23)) | (total >> np.uint64(41))) + s0
        t = s1 << np.uint64(17)
        s2, s3 = s2 ^ s0, s3 ^ s1
        s1, s0 = s1 ^ s2, s0 ^ s3
        s2, s3 = s2 ^ t, (s3 << np.uint64(45)) | (s3 >> np.uint64(19))
        return (s0, s1, s2, s3), (drawn >> np.uint64(11)).astype(np.float64)

    def uniform(g: Any) -> Any:
        g, whole = bits(g)
        return g, whole * 2.0**-53

    def normal(g: Any) -> Any:
        g, first = bits(g)
        g, second = bits(g)
        radius = jax.numpy.sqrt(-2.0 * jax.numpy.log((first + 1.0) * 2.0**-53))
        return g, radius * jax.numpy.cos(2.0 * np.pi * (second * 2.0**-53))  # Box, Muller

    return uniform, normal


def jax_study(run: Any, threads: int, *given: NDArray[Any]) -> Call:
    """The call of ``run(column, ...)`` for every run, a column each of arrays (n, runs).

    The runs are spread over as many devices as there are threads. `vmap` moves once for all runs
    what depends on no column: what a run starts from has to come in one.
    """
    jax, place = need("jax"), None
    if threads > 1:
        mesh = jax.sharding.Mesh(np.array(jax.devices()[:threads]), ("runs",))
        place = jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec(None, "runs"))
    study = jax.jit(jax.vmap(run, in_axes=1))
    placed = [jax.device_put(np.ascontiguousarray(columns), place) for columns in given]
    return lambda: study(*placed).block_until_ready()
