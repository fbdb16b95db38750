"""lee-mc: plant (38) of Lee, Choi and Khalil, the fixed-step observer (42), uniform noise.

RMS of e2 of each run from `BEGIN` on. A step: a draw, the plant's Euler step, the observer's.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from compare import compiled, streams
from compare.harness import (
    OURS,
    SEED,
    TWIN,
    Array,
    Call,
    Implementation,
    Size,
    Workload,
    forced,
    in_seconds,
    need,
)
from hgo_rs import Lee, StandardObserver, UniformNoise, reference, simulate
from hgo_rs.reference.noise import MEASUREMENT
from hgo_rs.scenarios import lee

T, ELL = lee.T, 1.0 / lee.EPSILON
(K1, K2), (X1, X2) = lee.H, lee.X0
NOISE: dict[str, Any] = lee.NOISE
LOW, HIGH = NOISE["low"], NOISE["high"]
BEGIN = 0.2  # of the steps


def window(size: Size) -> tuple[int, int]:
    """Steps over which the RMS is taken."""
    return round(BEGIN * size.steps), size.steps


def ours(size: Size, threads: int) -> Call:
    observer, noise = (
        StandardObserver(2, epsilon=lee.EPSILON, k=lee.H, method="euler", timing="predictor"),
        UniformNoise(LOW, HIGH),
    )
    seconds = in_seconds(window(size), T)

    def call() -> Array:
        return simulate(
            Lee(),
            observer,
            x0=lee.X0,
            dt=T,
            steps=size.steps,
            plant_method="euler",
            noise=noise,
            runs=size.runs,
            rng=SEED,
            windows=[seconds],
            metrics=["rms"],
        ).rms[:, 0, 1:2]

    return call


def twin(size: Size, threads: int) -> Call:
    spec = lee.study("fixed", size.steps, noise=NOISE, runs=size.runs, seed=SEED)
    spec["windows"] = [window(size)]
    return lambda: reference.simulate(spec)["rms"][:, 0, 1:2]


def in_numba(size: Size, threads: int, own: bool = False) -> Call:
    numba = need("numba")
    start, uniform, _ = streams.numba_draws(own)
    begin, end = window(size)

    @numba.njit(fastmath=True, error_model="numpy")
    def one(words: streams.Words, run: int) -> float:
        noise = start(words, run)
        x1, x2, q1, q2, squares = X1, X2, 0.0, 0.0, 0.0
        for k in range(end):
            if k >= begin:
                squares += (q2 - x2) * (q2 - x2)
            noise, u = uniform(noise)
            e = x1 + (LOW + (HIGH - LOW) * u) - q1
            q1, q2 = q1 + T * (q2 + K1 * ELL * e), q2 + T * (K2 * ELL * ELL * e)  # (42)
            x1, x2 = x1 + T * x2, x2 + T * (-x1 / (1.0 + x1 * x1) - x2)  # (38)
        return np.sqrt(squares / (end - begin))

    return streams.numba_study(one, streams.states(size.runs, MEASUREMENT), threads)


def in_jax(size: Size, threads: int) -> Call:
    jax = need("jax")
    uniform, _ = streams.jax_draws()
    begin, end = window(size)

    def run(words: Any) -> Any:
        def step(state: Any, k: Any) -> Any:
            noise, x1, x2, q1, q2, squares = state
            squares += jax.numpy.where(k >= begin, (q2 - x2) * (q2 - x2), 0.0)
            noise, u = uniform(noise)
            e = x1 + (LOW + (HIGH - LOW) * u) - q1
            q1, q2 = q1 + T * (q2 + K1 * ELL * e), q2 + T * (K2 * ELL * ELL * e)  # (42)
            x1, x2 = x1 + T * x2, x2 + T * (-x1 / (1.0 + x1 * x1) - x2)  # (38)
            return (noise, x1, x2, q1, q2, squares), None

        initial = (tuple(words), X1, X2, 0.0, 0.0, 0.0)
        squares = jax.lax.scan(step, initial, jax.numpy.arange(end))[0][-1]
        return jax.numpy.sqrt(squares / (end - begin))[None]

    return streams.jax_study(run, streams.states(size.runs, MEASUREMENT), threads)


SOURCE = """
void lee(int64_t first, int64_t last, int64_t runs, const uint64_t *words, int64_t begin,
         int64_t end, double *rms) {
  for (int64_t run = first; run < last; run += RUNS * BLOCKS) {
    stream noise[BLOCKS];
    real x1[BLOCKS], x2[BLOCKS], q1[BLOCKS], q2[BLOCKS], squares[BLOCKS];
    EACH noise[q] = stream_of(words, runs, run + RUNS * q);
    EACH x1[q] = all(X1), x2[q] = all(X2), q1[q] = q2[q] = squares[q] = all(0.0);
    for (int64_t k = 0; k < end; k++) {
      if (k >= begin) EACH squares[q] += (q2[q] - x2[q]) * (q2[q] - x2[q]);
      EACH {
        real e = x1[q] + (LOW + (HIGH - LOW) * uniform(&noise[q])) - q1[q];
        real x2_rate = -x1[q] / (1.0 + x1[q] * x1[q]) - x2[q]; /* (38) */
        x1[q] += T * x2[q], x2[q] += T * x2_rate;
        q1[q] += T * (q2[q] + K1 * ELL * e), q2[q] += T * (K2 * ELL * ELL) * e; /* (42) */
      }
    }
    EACH STORE(rms + run + RUNS * q, root(squares[q] / (double)(end - begin)));
  }
}
"""


def in_c(size: Size, threads: int) -> Call:
    kernel = compiled.library(
        SOURCE, blocks=4, T=T, ELL=ELL, K1=K1, K2=K2, X1=X1, X2=X2, LOW=LOW, HIGH=HIGH
    ).lee
    words, rms = streams.states(size.runs, MEASUREMENT), np.empty((size.runs, 1))
    return compiled.call(kernel, size.runs, threads, words, *window(size), result=rms)


WORKLOAD = Workload(
    "lee-mc",
    "RMS of e2, fixed-step observer, uniform noise",
    (
        Implementation(OURS, ours),
        Implementation("ours, AVX2", forced(ours, "avx2"), parallel=False),
        Implementation("C", in_c),
        Implementation("C, rounded", compiled.rounded(in_c), parallel=False),
        Implementation("Numba", in_numba),
        Implementation("Numba, plain", partial(in_numba, own=True), independent=True),
        Implementation("JAX", in_jax, share=0.25),
        Implementation(TWIN, twin, share=0.1, parallel=False),
    ),
    full=Size(1024, 40_000),
    quick=Size(256, 2_000),
    check=Size(64, 1_500),
)
